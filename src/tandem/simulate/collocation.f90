! SPDX-License-Identifier: MIT
!> A polynomial from a state on that satisfies the equations of motion at some times (collocation). A fixed-point iteration
!> determines it: evaluate the polynomial at these times, project, find the accelerations, and integrate them twice. C may lose rank
!> between these times, where it is not evaluated. The iteration converges if the motion is not stiff.
module tandem_simulate_collocation
    use tandem_chart, only: chart_type, step_end
    use tandem_kinds, only: wp
    use tandem_simulate_local_error, only: local_error_type
    use tandem_simulate_state_polynomial, only: quadrature_nodes, quadrature_weights, state_polynomial_type
    use tandem_status, only: status_ok
    use tandem_stepper_state, only: state_type
    implicit none (type, external)
    private

    public :: collocation_type

    !> Largest number of times.
    integer, parameter :: most = 10

    type :: collocation_type
        !> Number of times, and the times in rising order; the start and its coordinates and velocities (n).
        integer, private :: n = 0
        real(wp), private :: t(most) = 0.0_wp, t0 = 0.0_wp
        real(wp), allocatable, private :: q0(:), qd0(:)
        !> Accelerations and velocities at the times (n, most).
        real(wp), allocatable, private :: qdd(:, :), qd(:, :)
        !> Velocities are sums of accelerations: qd(t_i) = qd0 + sum_j weights(i, j) qdd(t_j).
        real(wp), private :: weights(most, most) = 0.0_wp
        !> True if the first time is the start.
        logical, private :: has_start = .false.
    contains
        procedure :: begin, iterate, find_difference
    end type collocation_type

contains

    !> Begin at a state.
    subroutine begin(self, t0, q0, qd0, times, qdd0)
        class(collocation_type), intent(inout) :: self
        !> The start, its coordinates and velocities (n), and later times in rising order, at most ten with the start.
        real(wp), intent(in) :: t0, q0(:), qd0(:), times(:)
        !> The acceleration at the start (n), if C has its rank there.
        real(wp), intent(in), optional :: qdd0(:)

        if (.not. allocated(self%q0)) then
            allocate (self%q0(size(q0)), self%qd0(size(q0)), self%qdd(size(q0), most), self%qd(size(q0), most))
        end if
        self%t0 = t0
        self%q0(:) = q0
        self%qd0(:) = qd0
        self%qdd(:, :) = 0.0_wp
        self%has_start = present(qdd0)
        self%n = size(times)
        if (self%has_start) then
            self%n = self%n + 1
            self%t(1) = t0
            self%qdd(:, 1) = qdd0
        end if
        self%t(self%n - size(times) + 1:self%n) = times
    end subroutine begin

    !> Iterate until the accelerations no longer change, or changes no longer fall. The first iterations include the times
    !> successively, so that each is predicted from near ones.
    subroutine iterate(self, chart, local_error, n_first, tolerance, curve, state, work, left, off, stat)
        class(collocation_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        type(local_error_type), intent(in) :: local_error
        !> Number of times, with the start, in the first iteration.
        integer, intent(in) :: n_first
        !> Change that may be left.
        real(wp), intent(in) :: tolerance
        !> The polynomial.
        type(state_polynomial_type), intent(inout) :: curve
        !> The state at the last time, on the manifold; work space. Both are allocated.
        type(state_type), intent(inout) :: state, work
        !> What is left of the changes, as they fall, and the largest distance of the polynomial from the manifold, both relative to
        !> s + |y|.
        real(wp), intent(out) :: left, off
        !> Ok, or the status of an evaluation that has failed.
        integer, intent(out) :: stat
        !> Times that a further iteration includes; iterations with all of them, and those whose changes need not fall.
        integer, parameter :: further = 2, most_passes = 20, first_passes = 3
        !> Relative change by rounding; part to which a change must fall.
        real(wp), parameter :: rounding = 1.0e-14_wp, falls = 0.7_wp
        real(wp) :: change, last_change
        integer :: n_known, n_next, pass

        left = huge(1.0_wp)
        last_change = huge(1.0_wp)
        n_known = merge(1, 0, self%has_start)
        pass = 0
        do
            call find_weights(self, n_known)
            call build(self, n_known, curve)
            n_next = min(max(n_first, n_known + further), self%n)
            call evaluate(self, chart, local_error, n_next, curve, state, work, change, off, stat)
            if (stat /= status_ok) return
            if (n_known == self%n) then
                pass = pass + 1
                left = change
                if (pass > 1 .and. change < falls*last_change) left = change**2/(last_change - change)
                if (left <= max(tolerance, rounding) .or. pass == most_passes .or. .not. (change < falls*last_change .or. &
                    pass <= first_passes)) exit
                last_change = change
            end if
            n_known = n_next
        end do
    end subroutine iterate

    !> The accelerations at the first times, on the manifold at the points of the polynomial.
    subroutine evaluate(self, chart, local_error, n, curve, state, work, change, off, stat)
        class(collocation_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        type(local_error_type), intent(in) :: local_error
        integer, intent(in) :: n
        type(state_polynomial_type), intent(inout) :: curve
        type(state_type), intent(inout) :: state, work
        real(wp), intent(out) :: change, off
        integer, intent(out) :: stat
        integer :: i, k

        off = 0.0_wp
        change = 0.0_wp
        stat = status_ok
        associate (span => self%t(self%n) - self%t0)
            do i = merge(2, 1, self%has_start), n
                call curve%evaluate(self%t(i), work%q, work%qd, work%qdd)
                call state%begin(self%t(i), work%q, work%qd)
                call chart%project(state%t, state%q, state%qd, .true., stat, exactly=.true.)
                if (stat == status_ok) call chart%accelerate(state%t, state%q, state%qd, step_end, state%qdd, stat)
                if (stat /= status_ok) return
                do k = 1, size(work%q)
                    work%dq(k) = state%q(k) - work%q(k)
                    work%dqd(k) = state%qd(k) - work%qd(k)
                end do
                off = max(off, local_error%largest_part(state, work%dq, work%dqd))
                do k = 1, size(work%q)
                    work%dqd(k) = span*(state%qdd(k) - self%qdd(k, i))
                    work%dq(k) = span*work%dqd(k)
                    self%qdd(k, i) = state%qdd(k)
                end do
                change = max(change, local_error%largest_part(state, work%dq, work%dqd))
            end do
        end associate
    end subroutine evaluate

    !> The change of the last state if some times are left out of the polynomial: an estimate of its error.
    subroutine find_difference(self, first, last, dq, dqd)
        class(collocation_type), intent(in) :: self
        !> The first and the last time that are left out.
        integer, intent(in) :: first, last
        !> (n) each.
        real(wp), intent(out) :: dq(:), dqd(:)
        real(wp) :: of_qd(most), of_q(most), part(most), span, t
        integer :: j, k

        of_qd(:) = 0.0_wp
        of_q(:) = 0.0_wp
        span = self%t(self%n) - self%t0
        do k = 1, size(quadrature_nodes)
            t = self%t0 + quadrature_nodes(k)*span
            part(:) = quadrature_weights(k)*span*(lagrange(self, t, first, last) - lagrange(self, t, 0, 0))
            of_qd(:) = of_qd + part
            of_q(:) = of_q + (self%t(self%n) - t)*part
        end do
        dq(:) = 0.0_wp
        dqd(:) = 0.0_wp
        do j = 1, self%n
            dq(:) = dq + of_q(j)*self%qdd(:, j)
            dqd(:) = dqd + of_qd(j)*self%qdd(:, j)
        end do
    end subroutine find_difference

    !> The weights of the first accelerations.
    pure subroutine find_weights(self, n)
        class(collocation_type), intent(inout) :: self
        integer, intent(in) :: n
        integer :: i, k

        self%weights(:, :) = 0.0_wp
        do i = 1, n
            do k = 1, size(quadrature_nodes)
                self%weights(i, :) = self%weights(i, :) + (self%t(i) - self%t0)*quadrature_weights(k)* &
                    lagrange(self, self%t0 + quadrature_nodes(k)*(self%t(i) - self%t0), n + 1, self%n)
            end do
        end do
    end subroutine find_weights

    !> Form the polynomial of the first accelerations.
    pure subroutine build(self, n, curve)
        class(collocation_type), intent(inout) :: self
        integer, intent(in) :: n
        type(state_polynomial_type), intent(inout) :: curve
        integer :: i, j

        call curve%begin(self%t0, self%q0)
        call curve%add_velocity(self%t0, self%qd0)
        if (self%has_start) call curve%add_acceleration(self%t0, self%qdd(:, 1))
        do i = merge(2, 1, self%has_start), n
            self%qd(:, i) = self%qd0
            do j = 1, n
                self%qd(:, i) = self%qd(:, i) + self%weights(i, j)*self%qdd(:, j)
            end do
            call curve%add_velocity(self%t(i), self%qd(:, i))
        end do
    end subroutine build

    !> Lagrange's polynomials of the times at a time, without some of them, whose polynomials are 0.
    pure function lagrange(self, t, first_left_out, last_left_out) result(values)
        type(collocation_type), intent(in) :: self
        real(wp), intent(in) :: t
        integer, intent(in) :: first_left_out, last_left_out
        real(wp) :: values(most)
        integer :: i, j

        values(:) = 0.0_wp
        do i = 1, self%n
            if (i >= first_left_out .and. i <= last_left_out) cycle
            values(i) = 1.0_wp
            do j = 1, self%n
                if (j == i .or. (j >= first_left_out .and. j <= last_left_out)) cycle
                values(i) = values(i)*(t - self%t(j))/(self%t(i) - self%t(j))
            end do
        end do
    end function lagrange
end module tandem_simulate_collocation
