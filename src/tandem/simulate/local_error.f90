! SPDX-License-Identifier: MIT
!> The local errors of a run: the errors of single steps, the largest and their sum.
!>
!> Steppers with an estimate of their own provide it. For fixed steps of the others it comes from windows of four equal steps,
!> without an evaluation: y_4 - y_0 less Boole's quadrature of the rates at the five points is the sum of the four local errors, up
!> to the quadrature's own error of order h^7 and a part h J of itself (theory, section 20).
module tandem_simulate_local_error
    use tandem_kinds, only: long, wp
    use tandem_pack, only: pack_type
    use tandem_stepper_state, only: go_along, state_type
    implicit none (type, external)
    private

    public :: local_error_type, steps_of_window

    !> Steps of a window, and 90/4 times Boole's weights for the ends of its steps and for its start.
    integer, parameter :: steps_of_window = 4
    real(wp), parameter :: weight(steps_of_window) = [32.0_wp, 12.0_wp, 32.0_wp, 7.0_wp], first_weight = 7.0_wp
    real(wp), parameter :: quadrature = 22.5_wp

    type :: local_error_type
        !> Largest error of a step, and sum of all, on the scale s + |y| of each coordinate and velocity, root mean square.
        real(wp) :: largest = 0.0_wp, total = 0.0_wp
        !> Number of these steps.
        integer(long) :: steps = 0
        !> 1 / (s + |y|) for q and for qd, s the coordinate scales, for steppers with an estimate; for others the error of the last
        !> window, or within a window its start plus the quadrature of the rates so far (n).
        real(wp), allocatable :: weight_q(:), weight_qd(:), error_q(:), error_qd(:)
        !> The scales (n), unless all of them are 1.
        real(wp), allocatable, private :: scale(:)
        !> Upper bound of |q| in relative errors (n), if there are angles.
        real(wp), allocatable, private :: largest_q(:)
        !> 1 over the time scale: velocities have the scale rate s.
        real(wp), private :: rate = 1.0_wp
        integer, private :: n = 0
        !> The start of the window, the size of its first step, and the end of its last step.
        real(wp), private :: t0 = 0.0_wp, h = 0.0_wp, t_last = 0.0_wp
        integer, private :: in_window = 0
        !> The gap of the velocity for which the last try of a step was rejected, and the largest gap that is not examined.
        real(wp), private :: last_gap = huge(1.0_wp), allowed_gap = huge(1.0_wp)
        !> True if the imposed part of the motion counts as an error; its error in the last try of a step beyond the tolerance and
        !> the size of that try, 0 for none; the number of tries that did not reduce it.
        logical, private :: counts_imposed = .false.
        real(wp), private :: last_imposed = 0.0_wp, imposed_step = 0.0_wp
        integer, private :: in_vain = 0
        !> The end of that try, and true while it belongs to an earlier step.
        real(wp), private :: imposed_end = -huge(1.0_wp)
        logical, private :: is_of_earlier_step = .false.
    contains
        procedure :: initialize, set_weights, add, take_back, extend, restart, pack_state
        procedure :: gap, jump, allow_gap, begin_step, find_gap, is_missed, largest_part, largest_parts, add_turn, size_of_window
        procedure :: count_imposed, add_imposed
        procedure, private :: largest_velocity, may_gap, scale_of, size_of_q
    end type local_error_type

contains

    !> Begin anew with coordinate scales (n).
    pure subroutine initialize(self, scale, rate, has_estimates, largest_q)
        class(local_error_type), intent(inout) :: self
        real(wp), intent(in) :: scale(:)
        !> 1 over the time scale.
        real(wp), intent(in) :: rate
        !> True if `set_weights` will be called, and not `extend`.
        logical, intent(in) :: has_estimates
        !> Upper bound of each |q| in relative errors (n); no bound if absent.
        real(wp), intent(in), optional :: largest_q(:)

        self%largest = 0.0_wp
        self%total = 0.0_wp
        self%steps = 0
        self%in_window = 0
        self%last_gap = huge(1.0_wp)
        self%n = size(scale)
        self%rate = rate
        if (allocated(self%largest_q)) deallocate (self%largest_q)
        if (present(largest_q)) self%largest_q = largest_q
        if (allocated(self%scale)) deallocate (self%scale)
        if (any(abs(scale - 1.0_wp) > 0.0_wp)) self%scale = scale
        if (allocated(self%weight_q)) deallocate (self%weight_q, self%weight_qd)
        if (allocated(self%error_q)) deallocate (self%error_q, self%error_qd)
        if (has_estimates) then
            allocate (self%weight_q, self%weight_qd, mold=scale)
        else
            allocate (self%error_q(self%n), self%error_qd(self%n), source=0.0_wp)
        end if
    end subroutine initialize

    !> The scale of a coordinate.
    pure real(wp) function scale_of(self, i)
        class(local_error_type), intent(in) :: self
        integer, intent(in) :: i

        scale_of = 1.0_wp
        if (allocated(self%scale)) scale_of = self%scale(i)
    end function scale_of

    !> The size to which the error of a coordinate is relative.
    pure real(wp) function size_of_q(self, i, q)
        class(local_error_type), intent(in) :: self
        integer, intent(in) :: i
        !> The coordinate.
        real(wp), intent(in) :: q

        size_of_q = abs(q)
        if (allocated(self%largest_q)) size_of_q = min(size_of_q, self%largest_q(i))
        size_of_q = self%scale_of(i) + size_of_q
    end function size_of_q

    !> Make errors relative to a state.
    pure subroutine set_weights(self, state)
        class(local_error_type), intent(inout) :: self
        type(state_type), intent(in) :: state
        integer :: i

        do i = 1, self%n
            self%weight_q(i) = 1.0_wp/self%size_of_q(i, state%q(i))
            self%weight_qd(i) = 1.0_wp/(self%rate*self%scale_of(i) + abs(state%qd(i)))
        end do
    end subroutine set_weights

    !> Add the errors of some steps.
    pure subroutine add(self, total, steps)
        class(local_error_type), intent(inout) :: self
        !> Their sum, relative.
        real(wp), intent(in) :: total
        integer, intent(in) :: steps

        ! No error is smaller than rounding.
        self%total = self%total + max(total, steps*epsilon(1.0_wp))
        self%largest = max(self%largest, total/real(steps, wp), epsilon(1.0_wp))
        self%steps = self%steps + steps
    end subroutine add

    !> Subtract the error of the last step, which was rejected, from the sum.
    pure subroutine take_back(self, total, steps)
        class(local_error_type), intent(inout) :: self
        real(wp), intent(in) :: total
        integer(long), intent(in) :: steps

        self%total = total
        self%steps = steps
        self%in_window = 0
    end subroutine take_back

    !> Add a step to the window. A step that does not continue the last one, or has another size, begins a new window.
    pure subroutine extend(self, start, arrived, is_complete)
        class(local_error_type), intent(inout) :: self
        !> The states at the ends of the step.
        type(state_type), intent(in) :: start, arrived
        !> True if `error_q` and `error_qd` are now the sum of the errors of a window, for `add`.
        logical, intent(out) :: is_complete
        real(wp) :: h, late
        integer :: i

        h = arrived%t - start%t
        if (abs(start%t - self%t_last) > 0.0_wp .or. abs(h - self%h) > 8.0_wp*spacing(abs(arrived%t))) self%in_window = 0
        self%t_last = arrived%t
        if (self%in_window == 0) then
            self%t0 = start%t
            self%h = h
            self%error_q(:) = start%q
            self%error_qd(:) = start%qd
            call go_along(self%n, first_weight*h/quadrature, start%qd, start%qdd, self%error_q, self%error_qd)
        end if
        self%in_window = self%in_window + 1
        call go_along(self%n, weight(self%in_window)*self%h/quadrature, arrived%qd, arrived%qdd, self%error_q, self%error_qd)
        is_complete = self%in_window == steps_of_window
        if (.not. is_complete) return
        self%in_window = 0
        ! Rounding error of the times.
        late = (arrived%t - self%t0) - steps_of_window*self%h
        do i = 1, self%n
            self%error_q(i) = arrived%q(i) - self%error_q(i) - late*arrived%qd(i)
            self%error_qd(i) = arrived%qd(i) - self%error_qd(i) - late*arrived%qdd(i)
        end do
    end subroutine extend

    !> Difference between a step's change of velocity and its accelerations, on the scale s + |qd|. Increments contain the full
    !> acceleration, so in a smooth motion the velocity constraints remove no more than the error of the step.
    pure real(wp) function gap(self, start, arrived)
        class(local_error_type), intent(in) :: self
        !> The states at the ends of the step.
        type(state_type), intent(in) :: start, arrived
        integer :: i

        gap = 0.0_wp
        do i = 1, self%n
            gap = max(gap, abs((arrived%qd(i) - start%qd(i)) - (arrived%dqd(i) - start%dqd(i)))/ &
                (self%rate*self%scale_of(i) + abs(arrived%qd(i))))
        end do
    end function gap

    !> The part of `gap` that a smooth motion does not explain. The trapezoidal rule misses a change of dependent velocities by h**3
    !> qdd''/12, which is a part of the step times the change of accelerations; errors of steps of higher order are negligible. Zero
    !> if it does not exceed the largest one so far.
    pure real(wp) function jump(self, start, arrived, order, so_far)
        class(local_error_type), intent(in) :: self
        !> The states at the ends of the step.
        type(state_type), intent(in) :: start, arrived
        !> Of the method.
        integer, intent(in) :: order
        real(wp), intent(in) :: so_far
        !> Smaller gaps are ignored. From rest, qdd'' h**2/2 is the change of accelerations, and the part a sixth.
        real(wp), parameter :: negligible = 1.0e-9_wp, share = 0.25_wp
        real(wp) :: bend
        integer :: i

        jump = 0.0_wp
        if (.not. self%may_gap(start, arrived, max(so_far, negligible))) return
        jump = self%gap(start, arrived)
        if (order > 2) return
        bend = 0.0_wp
        do i = 1, self%n
            bend = max(bend, abs(arrived%qdd(i) - start%qdd(i))/(self%rate*self%scale_of(i) + abs(arrived%qd(i))))
        end do
        jump = max(0.0_wp, jump - share*(arrived%t - start%t)*bend)
    end function jump

    !> True if `gap` may be larger than a limit. Usually it is not, and this test needs no division per entry.
    pure logical function may_gap(self, start, arrived, limit)
        class(local_error_type), intent(in) :: self
        !> The states at the ends of the step.
        type(state_type), intent(in) :: start, arrived
        real(wp), intent(in) :: limit

        may_gap = .false.
        if (.not. limit < huge(1.0_wp)) return
        if (allocated(self%scale)) then
            may_gap = is_larger(self%n, 0.999_wp*limit, self%rate, start%qd, start%dqd, arrived%qd, arrived%dqd, self%scale)
        else
            may_gap = is_larger(self%n, 0.999_wp*limit, self%rate, start%qd, start%dqd, arrived%qd, arrived%dqd)
        end if
    end function may_gap

    pure logical function is_larger(n, limit, rate, qd0, dqd0, qd, dqd, scale)
        integer, intent(in) :: n
        real(wp), intent(in) :: limit, rate, qd0(n), dqd0(n), qd(n), dqd(n)
        !> 1 if absent.
        real(wp), intent(in), optional :: scale(n)
        integer :: count, i

        ! Counted, so that the loops fill registers.
        count = 0
        if (present(scale)) then
            do i = 1, n
                count = count + merge(1, 0, abs((qd(i) - qd0(i)) - (dqd(i) - dqd0(i))) > limit*(rate*scale(i) + abs(qd(i))))
            end do
        else
            do i = 1, n
                count = count + merge(1, 0, abs((qd(i) - qd0(i)) - (dqd(i) - dqd0(i))) > limit*(rate + abs(qd(i))))
            end do
        end if
        is_larger = count > 0
    end function is_larger

    !> Examine gaps larger than this.
    pure subroutine allow_gap(self, largest)
        class(local_error_type), intent(inout) :: self
        real(wp), intent(in) :: largest

        self%allowed_gap = largest
        self%last_gap = huge(1.0_wp)
    end subroutine allow_gap

    !> Begin the first try of a step from a time on. Steps that end before a jump, and so approach it, must not forget the tries
    !> that crossed it: the approach would have no end.
    pure subroutine begin_step(self, t)
        class(local_error_type), intent(inout) :: self
        real(wp), intent(in) :: t

        self%last_gap = huge(1.0_wp)
        self%is_of_earlier_step = self%imposed_step > 0.0_wp .and. t < self%imposed_end
        if (self%is_of_earlier_step) return
        self%imposed_step = 0.0_wp
        self%in_vain = 0
    end subroutine begin_step

    !> Select if steps count the error of motions that constraints impose as functions of time.
    pure subroutine count_imposed(self, counts)
        class(local_error_type), intent(inout) :: self
        logical, intent(in) :: counts

        self%counts_imposed = counts
        call self%begin_step(huge(1.0_wp))
    end subroutine count_imposed

    !> Add to the error of an implicit step the error of the motion that constraints impose: the difference between its change and
    !> the increments. An estimate after the filter by the Newton matrix contains the chart's own coordinates only, of which a
    !> mechanism that is driven as a whole has none, so that steps would grow until the iteration for u converges to another branch.
    !> Increments contain the full velocity and acceleration: the contribution of the constraints falls with a power of the step. An
    !> error that does not is due to a jump of nu or a contradiction of the model, and is accepted.
    pure subroutine add_imposed(self, start, arrived, weight_q, weight_qd, power, norm)
        class(local_error_type), intent(inout) :: self
        !> The states at the ends of the step.
        type(state_type), intent(in) :: start, arrived
        !> 1 / (atol + rtol |y|) for q and qd (n).
        real(wp), intent(in), contiguous :: weight_q(:), weight_qd(:)
        !> The order of the step's error estimate over that of the step, both plus one.
        real(wp), intent(in) :: power
        !> The error of the step on the scale of the tolerances.
        real(wp), intent(inout) :: norm
        !> Tries that may fail to reduce the error. A smooth error falls faster than with this power of the step; from one step to
        !> the next, where the motion may demand more, it does not stay above this part with a step below this part.
        integer, parameter :: most_in_vain = 3
        real(wp), parameter :: slowest = 1.5_wp, constant = 0.9_wp
        real(wp) :: h, imposed

        if (.not. self%counts_imposed) return
        imposed = max(largest_miss(self, start%q, start%dq, arrived%q, arrived%dq, weight_q), &
            largest_miss(self, start%qd, start%dqd, arrived%qd, arrived%dqd, weight_qd))
        if (imposed > 1.0_wp) then
            h = arrived%t - start%t
            if (self%is_of_earlier_step) then
                if (imposed > constant*self%last_imposed .and. h < constant*self%imposed_step) self%in_vain = self%in_vain + 1
            else if (self%imposed_step > 0.0_wp) then
                if (imposed > self%last_imposed*(h/self%imposed_step)**slowest) self%in_vain = self%in_vain + 1
            end if
            self%is_of_earlier_step = .false.
            self%last_imposed = imposed
            self%imposed_step = h
            self%imposed_end = arrived%t
            if (self%in_vain >= most_in_vain) return
        end if
        norm = max(norm, imposed**power)
    end subroutine add_imposed

    !> The largest weighted entry by which increments (d0, d) miss a change from y0 to y, apart from rounding.
    pure real(wp) function largest_miss(self, y0, d0, y, d, weight)
        type(local_error_type), intent(in) :: self
        real(wp), intent(in), contiguous :: y0(:), d0(:), y(:), d(:), weight(:)
        !> Part of the largest entry that may be rounding, which the constraints transfer to smaller ones.
        real(wp), parameter :: rounding = 1.0e3_wp*epsilon(1.0_wp)
        real(wp) :: largest, miss
        integer :: i

        largest = 0.0_wp
        do i = 1, self%n
            largest = max(largest, abs(y(i))/self%scale_of(i))
        end do
        largest_miss = 0.0_wp
        do i = 1, self%n
            miss = abs((y(i) - y0(i)) - (d(i) - d0(i)))
            if (miss > rounding*largest*self%scale_of(i)) largest_miss = max(largest_miss, miss*weight(i))
        end do
    end function largest_miss

    !> True if a shorter step to the next state may leave a smaller gap of the velocity. If a chart becomes singular within a step,
    !> the stages behind that point follow another branch, which no estimate of the error shows: rates of all stages are smooth. A
    !> gap that does not fall with the step is a jump of nu, and is accepted.
    pure subroutine find_gap(self, start, arrived, is_found)
        class(local_error_type), intent(inout) :: self
        !> The states at the ends of the step.
        type(state_type), intent(in) :: start, arrived
        logical, intent(out) :: is_found
        !> A gap below this part of the largest velocity may be rounding, which the constraints transfer to the smaller ones. Steps
        !> of fewer spacings of the time than this are not shortened for it.
        real(wp), parameter :: rounding = 1.0e3_wp*epsilon(1.0_wp), shortest = 1.0e4_wp
        real(wp) :: gap

        is_found = .false.
        if (.not. self%may_gap(start, arrived, self%allowed_gap)) return
        gap = self%gap(start, arrived)
        is_found = gap > self%allowed_gap .and. gap < 0.5_wp*self%last_gap .and. &
            arrived%t - start%t > shortest*spacing(abs(start%t))
        if (is_found) is_found = gap > rounding*self%largest_velocity(arrived)
        if (is_found) self%last_gap = gap
    end subroutine find_gap

    !> The largest velocity on the scales.
    pure real(wp) function largest_velocity(self, state)
        class(local_error_type), intent(in) :: self
        type(state_type), intent(in) :: state
        integer :: i

        largest_velocity = 0.0_wp
        do i = 1, self%n
            largest_velocity = max(largest_velocity, abs(state%qd(i))/self%scale_of(i))
        end do
    end function largest_velocity

    !> True if the rates of a step miss its change by a part that a smooth motion does not leave to the constraints: unless steps
    !> are coarse, a sign of procedures that contradict each other. Increments contain the full velocity and acceleration; with a
    !> Jacobian that is not that of Phi, or a wrong gamma, they leave the manifold at once.
    pure logical function is_missed(self, start, arrived)
        class(local_error_type), intent(in) :: self
        !> The states at the ends of the step, on one chart.
        type(state_type), intent(in) :: start, arrived
        !> Parts of the change, and of the state, which is the rounding error of the change.
        real(wp), parameter :: share = 1.0e-4_wp, rounding = 1.0e-12_wp
        real(wp) :: moved, missed, moved_qd, missed_qd
        integer :: i

        moved = 0.0_wp
        missed = 0.0_wp
        moved_qd = 0.0_wp
        missed_qd = 0.0_wp
        do i = 1, self%n
            associate (s => self%scale_of(i) + abs(arrived%q(i)), s_qd => self%rate*self%scale_of(i) + abs(arrived%qd(i)))
                moved = max(moved, abs(arrived%dq(i) - start%dq(i))/s)
                missed = max(missed, abs((arrived%q(i) - start%q(i)) - (arrived%dq(i) - start%dq(i)))/s)
                moved_qd = max(moved_qd, abs(arrived%dqd(i) - start%dqd(i))/s_qd)
                missed_qd = max(missed_qd, abs((arrived%qd(i) - start%qd(i)) - (arrived%dqd(i) - start%dqd(i)))/s_qd)
            end associate
        end do
        is_missed = missed > share*moved + rounding .or. missed_qd > share*moved_qd + rounding
    end function is_missed

    !> The largest entry of errors of q and of qd (n), on the scale s + |y| of a state.
    pure real(wp) function largest_part(self, state, error_q, error_qd)
        class(local_error_type), intent(in) :: self
        type(state_type), intent(in) :: state
        real(wp), intent(in), contiguous :: error_q(:), error_qd(:)
        real(wp) :: part_q, part_qd

        call self%largest_parts(state, error_q, error_qd, part_q, part_qd)
        largest_part = max(part_q, part_qd)
    end function largest_part

    !> The largest entries of errors of q and of qd separately.
    pure subroutine largest_parts(self, state, error_q, error_qd, part_q, part_qd)
        class(local_error_type), intent(in) :: self
        type(state_type), intent(in) :: state
        real(wp), intent(in), contiguous :: error_q(:), error_qd(:)
        real(wp), intent(out) :: part_q, part_qd
        integer :: i

        part_q = 0.0_wp
        part_qd = 0.0_wp
        do i = 1, self%n
            part_q = max(part_q, abs(error_q(i))/self%size_of_q(i, state%q(i)))
            part_qd = max(part_qd, abs(error_qd(i))/(self%rate*self%scale_of(i) + abs(state%qd(i))))
        end do
    end subroutine largest_parts

    !> Constraints turn velocities with errors of the position, as a wheel's velocity turns with its heading: add this to errors of
    !> qd, as a part of the largest velocity per unit of the largest error, which may be one of a position alone.
    pure subroutine add_turn(self, state, error_q, error_qd)
        class(local_error_type), intent(in) :: self
        type(state_type), intent(in) :: state
        !> Moduli (n).
        real(wp), intent(in), contiguous :: error_q(:)
        real(wp), intent(inout), contiguous :: error_qd(:)
        real(wp), parameter :: share = 0.5_wp
        real(wp) :: error, speed
        integer :: i

        error = 0.0_wp
        speed = 0.0_wp
        do i = 1, self%n
            error = max(error, error_q(i)/self%size_of_q(i, state%q(i)))
            speed = max(speed, abs(state%qd(i))/self%scale_of(i))
        end do
        do i = 1, self%n
            error_qd(i) = error_qd(i) + share*error*speed*self%scale_of(i)
        end do
    end subroutine add_turn

    !> The error of a window on the scale s + |y| of a state, root mean square.
    pure real(wp) function size_of_window(self, state)
        class(local_error_type), intent(in) :: self
        type(state_type), intent(in) :: state
        integer :: i

        size_of_window = 0.0_wp
        do i = 1, self%n
            size_of_window = size_of_window + (self%error_q(i)*(1.0_wp/self%size_of_q(i, state%q(i))))**2 + &
                (self%error_qd(i)*(1.0_wp/(self%rate*self%scale_of(i) + abs(state%qd(i)))))**2
        end do
        size_of_window = sqrt(size_of_window/real(2*self%n, wp))
    end function size_of_window

    !> Begin a new window, at a kink or a jump of the motion.
    pure subroutine restart(self)
        class(local_error_type), intent(inout) :: self

        self%in_window = 0
        self%imposed_step = 0.0_wp
        self%in_vain = 0
    end subroutine restart

    !> The errors so far and the current window.
    subroutine pack_state(self, pack)
        class(local_error_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%largest, self%total)
        call pack%item(self%steps)
        call pack%item(self%error_q, self%error_qd)
        call pack%item(self%t0, self%h, self%t_last)
        call pack%item(self%in_window)
        call pack%item(self%last_gap)
        call pack%item(self%last_imposed, self%imposed_step)
        call pack%item(self%in_vain)
        call pack%item(self%imposed_end)
        call pack%item(self%is_of_earlier_step)
    end subroutine pack_state
end module tandem_simulate_local_error
