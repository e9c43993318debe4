! SPDX-License-Identifier: MIT
!> Rates of past stages and their extrapolation, which gives start values for the next implicit stage. Rates are stored in ambient
!> coordinates, so that they remain valid when the chart changes.
module tandem_stepper_history
    use tandem_kinds, only: short, wp
    use tandem_pack, only: pack_type
    use tandem_stepper_state, only: state_type
    implicit none (type, external)
    private

    public :: history_type

    !> Capacity for stages; default and largest number of stages in one extrapolation, whose polynomial has a degree of one less.
    integer, parameter :: capacity = 10, usual_nodes = 5, most_nodes = 9

    type :: history_type
        private
        integer :: n_kept = 0, last = 0
        real(wp) :: t(capacity) = 0.0_wp
        real(wp), allocatable :: q(:, :), qd(:, :), qdd(:, :)
    contains
        procedure, public :: allocate => allocate_history, clear, continue_from, push, extrapolate
        procedure, public :: has_order, difference, drop, curvature, pack_state
    end type history_type

contains

    !> Allocate for n coordinates.
    subroutine allocate_history(self, n)
        class(history_type), intent(inout) :: self
        integer, intent(in) :: n

        if (allocated(self%qd)) deallocate (self%q, self%qd, self%qdd)
        allocate (self%q(n, capacity), self%qd(n, capacity), self%qdd(n, capacity), source=0.0_wp)
        self%n_kept = 0
    end subroutine allocate_history

    !> Remove all rates.
    pure subroutine clear(self)
        class(history_type), intent(inout) :: self

        self%n_kept = 0
    end subroutine clear

    !> Begin a step at a state. Discard the past if this state is not the last one stored, as after a start or a breakpoint.
    subroutine continue_from(self, state, continues)
        class(history_type), intent(inout) :: self
        type(state_type), intent(in) :: state
        !> False if the past was discarded.
        logical, intent(out) :: continues

        continues = .true.
        call self%drop(state%t)
        if (self%n_kept > 0) then
            if (abs(self%t(self%last) - state%t) <= 0.0_wp .and. &
                all(abs(self%qd(:, self%last) - state%qd) <= 0.0_wp) .and. &
                all(abs(self%qdd(:, self%last) - state%qdd) <= 0.0_wp)) return
        end if
        continues = .false.
        self%n_kept = 0
        call self%push(state%t, state%q, state%qd, state%qdd)
    end subroutine continue_from

    !> Store the rates at a point.
    subroutine push(self, t, q, qd, qdd)
        class(history_type), intent(inout) :: self
        real(wp), intent(in) :: t
        !> Coordinates, velocities and accelerations (n).
        real(wp), intent(in), contiguous :: q(:), qd(:), qdd(:)

        self%last = merge(1, self%last + 1, self%n_kept == 0 .or. self%last == capacity)
        self%n_kept = min(self%n_kept + 1, capacity)
        self%t(self%last) = t
        self%q(:, self%last) = q
        self%qd(:, self%last) = qd
        self%qdd(:, self%last) = qdd
    end subroutine push

    !> Evaluate the polynomial through the stages nearest to t at t (Lagrange's form).
    subroutine extrapolate(self, t, qd, qdd, most, q)
        class(history_type), intent(in) :: self
        real(wp), intent(in) :: t
        real(wp), intent(out), contiguous :: qd(:), qdd(:)
        !> Number of stages to use.
        integer, intent(in), optional :: most
        !> Coordinates (n).
        real(wp), intent(out), contiguous, optional :: q(:)
        integer :: nodes(most_nodes), n_most, n_nodes, i, j, k
        real(wp) :: weights(most_nodes)

        n_most = usual_nodes
        if (present(most)) n_most = min(most, most_nodes)
        n_nodes = 0
        do k = 1, self%n_kept
            ! In very short steps, several stages may have equal times.
            if (any(abs(self%t(nodes(:n_nodes)) - self%t(k)) <= 0.0_wp)) cycle
            ! Insert into the sorted list of the nearest stages.
            i = n_nodes + 1
            do while (i > 1)
                if (abs(self%t(nodes(i - 1)) - t) <= abs(self%t(k) - t)) exit
                if (i <= n_most) nodes(i) = nodes(i - 1)
                i = i - 1
            end do
            if (i <= n_most) nodes(i) = k
            n_nodes = min(n_nodes + 1, n_most)
        end do
        do i = 1, n_nodes
            weights(i) = 1.0_wp
            do j = 1, n_nodes
                if (j /= i) weights(i) = weights(i)*(t - self%t(nodes(j)))/(self%t(nodes(i)) - self%t(nodes(j)))
            end do
        end do
        call combine(size(qd), n_nodes, nodes, weights, self%qd, qd)
        call combine(size(qd), n_nodes, nodes, weights, self%qdd, qdd)
        if (present(q)) call combine(size(qd), n_nodes, nodes, weights, self%q, q)
    end subroutine extrapolate

    !> y := sum_k weights(k) x(:, nodes(k)), by blocks of rows that fit into a register.
    pure subroutine combine(n, n_nodes, nodes, weights, x, y)
        integer, intent(in) :: n, n_nodes, nodes(n_nodes)
        real(wp), intent(in) :: weights(n_nodes), x(n, capacity)
        real(wp), intent(out) :: y(n)
        real(wp) :: s(short), total
        integer :: block, first, i, k

        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do block = 1, n/short
            first = short*(block - 1)
            do i = 1, short
                s(i) = 0.0_wp
            end do
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do k = 1, n_nodes
                !GCC$ UNROLL 1
                do i = 1, short
                    s(i) = s(i) + weights(k)*x(first + i, nodes(k))
                end do
            end do
            !GCC$ UNROLL 1
            do i = 1, short
                y(first + i) = s(i)
            end do
        end do
        do i = n - iand(n, short - 1) + 1, n
            total = 0.0_wp
            do k = 1, n_nodes
                total = total + weights(k)*x(i, nodes(k))
            end do
            y(i) = total
        end do
    end subroutine combine

    !> True if enough rates are stored for a divided difference of the given order.
    pure logical function has_order(self, order)
        class(history_type), intent(in) :: self
        integer, intent(in) :: order

        has_order = self%n_kept > order
    end function has_order

    !> Divided difference of the last rates: their derivative of the given order over its factorial.
    subroutine difference(self, order, qd, qdd)
        class(history_type), intent(in) :: self
        !> One less than the number of rates used.
        integer, intent(in) :: order
        real(wp), intent(out), contiguous :: qd(:), qdd(:)
        real(wp) :: weight
        integer :: i, j, nodes(capacity)

        do i = 0, order
            nodes(i + 1) = modulo(self%last - 1 - i, capacity) + 1
        end do
        qd = 0.0_wp
        qdd = 0.0_wp
        do i = 1, order + 1
            weight = 1.0_wp
            do j = 1, order + 1
                if (j /= i) weight = weight/(self%t(nodes(i)) - self%t(nodes(j)))
            end do
            qd = qd + weight*self%qd(:, nodes(i))
            qdd = qdd + weight*self%qdd(:, nodes(i))
        end do
    end subroutine difference

    !> Remove the rates after a given time, because their step was rejected.
    pure subroutine drop(self, t)
        class(history_type), intent(inout) :: self
        !> Start of the rejected step.
        real(wp), intent(in) :: t

        do while (self%n_kept > 0)
            if (self%t(self%last) <= t) exit
            self%last = merge(capacity, self%last - 1, self%last == 1)
            self%n_kept = self%n_kept - 1
        end do
    end subroutine drop

    !> Second divided difference of the last three rates, half their second derivative. With two rates only, as in a first step,
    !> return the first difference over its length: a bound for the case that the rates change by as much as they curve.
    subroutine curvature(self, qd, qdd)
        class(history_type), intent(in) :: self
        real(wp), intent(out), contiguous :: qd(:), qdd(:)
        real(wp) :: h1, h2
        integer :: i, j, k

        k = self%last
        j = merge(capacity, k - 1, k == 1)
        i = merge(capacity, j - 1, j == 1)
        h2 = self%t(k) - self%t(j)
        qd = (self%qd(:, k) - self%qd(:, j))/h2
        qdd = (self%qdd(:, k) - self%qdd(:, j))/h2
        if (self%n_kept < 3) then
            qd = qd/h2
            qdd = qdd/h2
            return
        end if
        h1 = self%t(j) - self%t(i)
        qd = (qd - (self%qd(:, j) - self%qd(:, i))/h1)/(h1 + h2)
        qdd = (qdd - (self%qdd(:, j) - self%qdd(:, i))/h1)/(h1 + h2)
    end subroutine curvature

    !> Pack all stored rates.
    subroutine pack_state(self, pack)
        class(history_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%n_kept, self%last)
        call pack%fixed(self%t)
        call pack%item(self%q, self%qd, self%qdd)
    end subroutine pack_state
end module tandem_stepper_history
