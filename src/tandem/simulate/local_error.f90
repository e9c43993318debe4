! SPDX-License-Identifier: MIT
!> Local errors of a run: the largest error of a single step, and the sum over all steps.
!>
!> Steppers with an error estimate provide these errors. For fixed steps of other steppers, windows of four equal steps give an
!> estimate without additional evaluations: y_4 - y_0 minus Boole's quadrature of the rates at the five points is the sum of the
!> four local errors. Its own errors are that of the quadrature, of order h^7, and a part h J of the estimate (theory, section 20).
module tandem_simulate_local_error
    use tandem_kinds, only: long, wp
    use tandem_pack, only: pack_type
    use tandem_stepper_state, only: go_along, state_type
    implicit none (type, external)
    private

    public :: local_error_type, steps_of_window

    !> Number of steps in a window; Boole's weights times 90/4 for the ends of its steps and for its start.
    integer, parameter :: steps_of_window = 4
    real(wp), parameter :: weight(steps_of_window) = [32.0_wp, 12.0_wp, 32.0_wp, 7.0_wp], first_weight = 7.0_wp
    real(wp), parameter :: quadrature = 22.5_wp

    type :: local_error_type
        !> Largest error of a step, and sum over all steps: root mean square over coordinates and velocities, relative to scale +
        !> |y|.
        real(wp) :: largest = 0.0_wp, total = 0.0_wp
        !> Number of steps with an error estimate.
        integer(long) :: steps = 0
        !> Steppers with an error estimate: 1/(scale + |y|) for q and qd (n). Other steppers: error of the last window, or within a
        !> window its start plus the quadrature of the rates so far (n).
        real(wp), allocatable :: weight_q(:), weight_qd(:), error_q(:), error_qd(:)
        !> Coordinate scales (n), if any of them is not 1.
        real(wp), allocatable, private :: scale(:)
        !> Upper bounds of |q| in relative errors (n), if any coordinate is an angle.
        real(wp), allocatable, private :: largest_q(:)
        !> Reciprocal of the time scale: velocities have the scale rate*scale.
        real(wp), private :: rate = 1.0_wp
        integer, private :: n = 0
        !> Start of the window, size of its first step, end of its last step.
        real(wp), private :: t0 = 0.0_wp, h = 0.0_wp, t_last = 0.0_wp
        integer, private :: in_window = 0
        !> Velocity gap for which the last attempt of a step was rejected; largest gap that is accepted without examination.
        real(wp), private :: last_gap = huge(1.0_wp), allowed_gap = huge(1.0_wp)
        !> Number of gaps in a row in steps of a few spacings of the time.
        integer, private :: n_in_place = 0
        !> True if the error of imposed motions counts. Excess of this error and size of the last attempt in which it exceeded the
        !> tolerance, 0 if there is none; number of attempts that did not reduce it.
        logical, private :: counts_imposed = .false.
        real(wp), private :: last_imposed = 0.0_wp, imposed_step = 0.0_wp
        integer, private :: failures = 0
        !> End of this attempt; true while it belongs to an earlier step.
        real(wp), private :: imposed_end = -huge(1.0_wp)
        logical, private :: is_of_earlier_step = .false.
    contains
        procedure :: initialize, set_weights, add, take_back, extend, restart, pack_state
        procedure :: gap, jump, allow_gap, begin_step, find_gap, has_jumped, is_missed, size_of_window
        procedure :: largest_part, largest_parts, add_rotation, count_imposed, add_imposed
        procedure, private :: largest_velocity, gap_is_possible, scale_of, size_of_q
    end type local_error_type

contains

    !> Begin a run with the given coordinate scales (n).
    pure subroutine initialize(self, scale, rate, has_estimates, largest_q)
        class(local_error_type), intent(inout) :: self
        real(wp), intent(in) :: scale(:)
        !> Reciprocal of the time scale.
        real(wp), intent(in) :: rate
        !> True if the stepper has an error estimate: `set_weights` is called, and `extend` is not.
        logical, intent(in) :: has_estimates
        !> Upper bound of each |q| in relative errors (n); unbounded by default.
        real(wp), intent(in), optional :: largest_q(:)

        self%largest = 0.0_wp
        self%total = 0.0_wp
        self%steps = 0
        self%in_window = 0
        self%last_gap = huge(1.0_wp)
        self%n_in_place = 0
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

    !> Scale of a coordinate.
    pure real(wp) function scale_of(self, i)
        class(local_error_type), intent(in) :: self
        integer, intent(in) :: i

        scale_of = 1.0_wp
        if (allocated(self%scale)) scale_of = self%scale(i)
    end function scale_of

    !> Size to which the error of a coordinate is related.
    pure real(wp) function size_of_q(self, i, q)
        class(local_error_type), intent(in) :: self
        integer, intent(in) :: i
        !> Value of the coordinate.
        real(wp), intent(in) :: q

        size_of_q = abs(q)
        if (allocated(self%largest_q)) size_of_q = min(size_of_q, self%largest_q(i))
        size_of_q = self%scale_of(i) + size_of_q
    end function size_of_q

    !> Set the weights that relate errors to a state.
    pure subroutine set_weights(self, state)
        class(local_error_type), intent(inout) :: self
        type(state_type), intent(in) :: state
        integer :: i

        do i = 1, self%n
            self%weight_q(i) = 1.0_wp/self%size_of_q(i, state%q(i))
            self%weight_qd(i) = 1.0_wp/(self%rate*self%scale_of(i) + abs(state%qd(i)))
        end do
    end subroutine set_weights

    !> Add the errors of several steps.
    pure subroutine add(self, total, steps)
        class(local_error_type), intent(inout) :: self
        !> Sum of the relative errors.
        real(wp), intent(in) :: total
        integer, intent(in) :: steps

        ! Errors are at least rounding errors.
        self%total = self%total + max(total, steps*epsilon(1.0_wp))
        self%largest = max(self%largest, total/real(steps, wp), epsilon(1.0_wp))
        self%steps = self%steps + steps
    end subroutine add

    !> Subtract the error of a step that was rejected afterwards.
    pure subroutine take_back(self, total, steps)
        class(local_error_type), intent(inout) :: self
        real(wp), intent(in) :: total
        integer(long), intent(in) :: steps

        self%total = total
        self%steps = steps
        self%in_window = 0
    end subroutine take_back

    !> Add a step to the window. A step that does not continue the last step, or has another size, begins a new window.
    pure subroutine extend(self, start, arrived, is_complete)
        class(local_error_type), intent(inout) :: self
        !> States at the ends of the step.
        type(state_type), intent(in) :: start, arrived
        !> True if a window is complete. `error_q` and `error_qd` then contain the sum of its errors, for `add`.
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
        ! Rounding error of the time.
        late = (arrived%t - self%t0) - steps_of_window*self%h
        do i = 1, self%n
            self%error_q(i) = arrived%q(i) - self%error_q(i) - late*arrived%qd(i)
            self%error_qd(i) = arrived%qd(i) - self%error_qd(i) - late*arrived%qdd(i)
        end do
    end subroutine extend

    !> Velocity gap of a step: the difference between the change of velocity and the integral of the accelerations, relative to
    !> scale + |qd|. Increments contain the full acceleration, so that in a smooth motion the projection onto the velocity
    !> constraints removes no more than the error of the step.
    pure real(wp) function gap(self, start, arrived)
        class(local_error_type), intent(in) :: self
        !> States at the ends of the step.
        type(state_type), intent(in) :: start, arrived
        integer :: i

        gap = 0.0_wp
        do i = 1, self%n
            gap = max(gap, abs((arrived%qd(i) - start%qd(i)) - (arrived%dqd(i) - start%dqd(i)))/ &
                (self%rate*self%scale_of(i) + abs(arrived%qd(i))))
        end do
    end function gap

    !> Part of the velocity gap that a smooth motion cannot cause. For dependent velocities, the error of the trapezoidal rule is
    !> h**3 qdd''/12, which is a fraction of the step size times the change of accelerations; errors of steps of higher order are
    !> negligible. The result is zero if it does not exceed the largest one so far.
    pure real(wp) function jump(self, start, arrived, order, so_far)
        class(local_error_type), intent(in) :: self
        !> States at the ends of the step.
        type(state_type), intent(in) :: start, arrived
        !> Order of the method.
        integer, intent(in) :: order
        real(wp), intent(in) :: so_far
        !> Size of gaps that are ignored; ratio of the allowed gap to the step size times the change of accelerations. From rest,
        !> this change is qdd'' h**2/2, so that the ratio is a sixth.
        real(wp), parameter :: negligible = 1.0e-9_wp, share = 0.25_wp
        real(wp) :: bend
        integer :: i

        jump = 0.0_wp
        if (.not. self%gap_is_possible(start, arrived, max(so_far, negligible))) return
        jump = self%gap(start, arrived)
        if (order > 2) return
        bend = 0.0_wp
        do i = 1, self%n
            bend = max(bend, abs(arrived%qdd(i) - start%qdd(i))/(self%rate*self%scale_of(i) + abs(arrived%qd(i))))
        end do
        jump = max(0.0_wp, jump - share*(arrived%t - start%t)*bend)
    end function jump

    !> True if the velocity gap may exceed a limit. This is rare, and the test requires no division per entry.
    pure logical function gap_is_possible(self, start, arrived, limit)
        class(local_error_type), intent(in) :: self
        !> States at the ends of the step.
        type(state_type), intent(in) :: start, arrived
        real(wp), intent(in) :: limit

        gap_is_possible = .false.
        if (.not. limit < huge(1.0_wp)) return
        if (allocated(self%scale)) then
            gap_is_possible = is_larger(self%n, 0.999_wp*limit, self%rate, start%qd, start%dqd, arrived%qd, arrived%dqd, self%scale)
        else
            gap_is_possible = is_larger(self%n, 0.999_wp*limit, self%rate, start%qd, start%dqd, arrived%qd, arrived%dqd)
        end if
    end function gap_is_possible

    pure logical function is_larger(n, limit, rate, qd0, dqd0, qd, dqd, scale)
        integer, intent(in) :: n
        real(wp), intent(in) :: limit, rate, qd0(n), dqd0(n), qd(n), dqd(n)
        !> Scales of the velocities; 1 by default.
        real(wp), intent(in), optional :: scale(n)
        integer :: count, i

        ! Counting lets the compiler vectorise the loops.
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

    !> Set the largest gap that is accepted without examination.
    pure subroutine allow_gap(self, largest)
        class(local_error_type), intent(inout) :: self
        real(wp), intent(in) :: largest

        self%allowed_gap = largest
        self%last_gap = huge(1.0_wp)
    end subroutine allow_gap

    !> Begin the first attempt of a step at time t. Attempts of earlier steps remain recorded until their end is passed. Otherwise
    !> steps that end before a jump would approach it endlessly.
    pure subroutine begin_step(self, t)
        class(local_error_type), intent(inout) :: self
        real(wp), intent(in) :: t

        self%last_gap = huge(1.0_wp)
        self%is_of_earlier_step = self%imposed_step > 0.0_wp .and. t < self%imposed_end
        if (self%is_of_earlier_step) return
        self%imposed_step = 0.0_wp
        self%failures = 0
    end subroutine begin_step

    !> Select whether the error of motions that constraints impose as functions of time counts.
    pure subroutine count_imposed(self, counts)
        class(local_error_type), intent(inout) :: self
        logical, intent(in) :: counts

        self%counts_imposed = counts
        call self%begin_step(huge(1.0_wp))
    end subroutine count_imposed

    !> Add to the error of an implicit step the error of motions that constraints impose: the difference between the imposed change
    !> and the increments. The filtered error estimate contains only the chart's own coordinates. A mechanism whose motion is
    !> entirely imposed has none, so that steps would grow until the iteration for u converges to another branch. Increments contain
    !> the full velocity and acceleration, so that the contribution of the constraints decreases with a power of the step size. An
    !> error that does not decrease is due to a jump of nu or to a contradiction in the model, and is accepted.
    pure subroutine add_imposed(self, start, arrived, weight_q, weight_qd, power, norm)
        class(local_error_type), intent(inout) :: self
        !> States at the ends of the step.
        type(state_type), intent(in) :: start, arrived
        !> 1/(atol + rtol |y|) for q and qd (n).
        real(wp), intent(in), contiguous :: weight_q(:), weight_qd(:)
        !> Order of the error estimate plus one, divided by the order of the method plus one.
        real(wp), intent(in) :: power
        !> Error of the step relative to the tolerances.
        real(wp), intent(inout) :: norm
        !> Number of attempts without a reduction of the error after which the error is accepted. A smooth error decreases faster
        !> than with the power `slowest` of the step size. From one step to the next, in which the motion may be less smooth, it
        !> does not remain above the fraction below in a step shorter by this fraction.
        integer, parameter :: most_ineffective = 3
        real(wp), parameter :: slowest = 1.5_wp, constant = 0.9_wp
        real(wp) :: h, imposed

        if (.not. self%counts_imposed) return
        imposed = max(largest_difference(self, start%q, start%dq, arrived%q, arrived%dq, weight_q), &
            largest_difference(self, start%qd, start%dqd, arrived%qd, arrived%dqd, weight_qd))
        if (imposed > 1.0_wp) then
            h = arrived%t - start%t
            if (self%is_of_earlier_step) then
                if (imposed > constant*self%last_imposed .and. h < constant*self%imposed_step) self%failures = self%failures + 1
            else if (self%imposed_step > 0.0_wp) then
                if (imposed > self%last_imposed*(h/self%imposed_step)**slowest) self%failures = self%failures + 1
            end if
            self%is_of_earlier_step = .false.
            self%last_imposed = imposed
            self%imposed_step = h
            self%imposed_end = arrived%t
            if (self%failures >= most_ineffective) return
        end if
        norm = max(norm, imposed**power)
    end subroutine add_imposed

    !> Largest weighted difference between increments (d0, d) and a change from y0 to y, except for rounding.
    pure real(wp) function largest_difference(self, y0, d0, y, d, weight)
        type(local_error_type), intent(in) :: self
        real(wp), intent(in), contiguous :: y0(:), d0(:), y(:), d(:), weight(:)
        !> Fraction of the largest entry below which differences may be rounding errors, which the constraints transfer to smaller
        !> entries.
        real(wp), parameter :: rounding = 1.0e3_wp*epsilon(1.0_wp)
        real(wp) :: largest, miss
        integer :: i

        largest = 0.0_wp
        do i = 1, self%n
            largest = max(largest, abs(y(i))/self%scale_of(i))
        end do
        largest_difference = 0.0_wp
        do i = 1, self%n
            miss = abs((y(i) - y0(i)) - (d(i) - d0(i)))
            if (miss > rounding*largest*self%scale_of(i)) largest_difference = max(largest_difference, miss*weight(i))
        end do
    end function largest_difference

    !> True if a shorter step may reduce the velocity gap. If a chart becomes singular within a step, the stages beyond the singular
    !> point follow another branch. The error estimate does not show this, because the rates of all stages are smooth. A gap that
    !> does not decrease with the step size is a jump of nu, and is accepted. Several gaps in a row in steps of a few spacings of
    !> the time are none: constraints turn the velocity without a motion. Rounding then determines it, and the steps must fail.
    pure subroutine find_gap(self, start, arrived, is_found)
        class(local_error_type), intent(inout) :: self
        !> States at the ends of the step.
        type(state_type), intent(in) :: start, arrived
        logical, intent(out) :: is_found
        !> Fraction of the largest velocity below which a gap may be a rounding error, which the constraints transfer to smaller
        !> velocities; smallest step, in spacings of the time, that is shortened because of a gap.
        real(wp), parameter :: rounding = 1.0e3_wp*epsilon(1.0_wp), shortest = 1.0e4_wp
        !> Number of such gaps that are accepted in a row, and the size above which they are no rounding errors.
        integer, parameter :: most_in_place = 3
        real(wp), parameter :: distinct = 1.0e-7_wp
        real(wp) :: gap

        is_found = .false.
        if (.not. self%allowed_gap < huge(1.0_wp)) return
        if (arrived%t - start%t <= shortest*spacing(abs(start%t))) then
            if (self%gap(start, arrived) > distinct) then
                self%n_in_place = self%n_in_place + 1
            else
                self%n_in_place = 0
            end if
            is_found = self%n_in_place > most_in_place
            return
        end if
        if (.not. self%gap_is_possible(start, arrived, self%allowed_gap)) then
            self%n_in_place = 0
            return
        end if
        gap = self%gap(start, arrived)
        is_found = gap > self%allowed_gap .and. gap < 0.5_wp*self%last_gap
        if (is_found) is_found = gap > rounding*self%largest_velocity(arrived)
        if (is_found) self%last_gap = gap
    end subroutine find_gap

    !> True if coordinates have changed in a step by far more than the velocities at its ends explain: corrections beside a singular
    !> configuration may end far away.
    pure logical function has_jumped(self, start, arrived)
        class(local_error_type), intent(in) :: self
        !> States at the ends of the step.
        type(state_type), intent(in) :: start, arrived
        !> Part of the scale, and multiple of the motion at the larger velocity, that no step exceeds.
        real(wp), parameter :: part = 0.5_wp, multiple = 2.0_wp
        real(wp) :: h, jump, moved
        integer :: i

        h = arrived%t - start%t
        jump = 0.0_wp
        moved = 0.0_wp
        do i = 1, self%n
            associate (scale => self%scale_of(i))
                jump = max(jump, abs(arrived%q(i) - start%q(i) - 0.5_wp*h*(arrived%qd(i) + start%qd(i)))/scale)
                moved = max(moved, h*max(abs(arrived%qd(i)), abs(start%qd(i)))/scale)
            end associate
        end do
        has_jumped = jump > part + multiple*moved
    end function has_jumped

    !> Largest velocity relative to the scales.
    pure real(wp) function largest_velocity(self, state)
        class(local_error_type), intent(in) :: self
        type(state_type), intent(in) :: state
        integer :: i

        largest_velocity = 0.0_wp
        do i = 1, self%n
            largest_velocity = max(largest_velocity, abs(state%qd(i))/self%scale_of(i))
        end do
    end function largest_velocity

    !> True if the rates of a step differ from its change by more than constraints of a smooth motion can cause. Unless steps are
    !> coarse, this indicates contradictory procedures of the model: increments contain the full velocity and acceleration, and
    !> leave the manifold at once if the Jacobian is not that of Phi or gamma is wrong.
    pure logical function is_missed(self, start, arrived)
        class(local_error_type), intent(in) :: self
        !> States at the ends of the step, on one chart.
        type(state_type), intent(in) :: start, arrived
        !> Allowed fraction of the change, and of the state, which bounds the rounding error of the change.
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

    !> Largest error of q and qd (n) relative to scale + |y| of a state.
    pure real(wp) function largest_part(self, state, error_q, error_qd)
        class(local_error_type), intent(in) :: self
        type(state_type), intent(in) :: state
        real(wp), intent(in), contiguous :: error_q(:), error_qd(:)
        real(wp) :: part_q, part_qd

        call self%largest_parts(state, error_q, error_qd, part_q, part_qd)
        largest_part = max(part_q, part_qd)
    end function largest_part

    !> Largest errors of q and of qd separately.
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

    !> Add to the errors of qd the effect of position errors, since the constraints rotate velocities with the position, such as the
    !> velocity of a wheel with its heading. The effect is the largest velocity times the largest relative error, which may be the
    !> error of a single position.
    pure subroutine add_rotation(self, state, error_q, error_qd)
        class(local_error_type), intent(in) :: self
        type(state_type), intent(in) :: state
        !> Absolute errors (n).
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
    end subroutine add_rotation

    !> Root mean square of the errors of a window, relative to scale + |y| of a state.
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

    !> Begin a new window, because the motion has a kink or jump.
    pure subroutine restart(self)
        class(local_error_type), intent(inout) :: self

        self%in_window = 0
        self%imposed_step = 0.0_wp
        self%failures = 0
    end subroutine restart

    !> Pack the errors so far and the current window.
    subroutine pack_state(self, pack)
        class(local_error_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%largest, self%total)
        call pack%item(self%steps)
        call pack%item(self%error_q, self%error_qd)
        call pack%item(self%t0, self%h, self%t_last)
        call pack%item(self%in_window)
        call pack%item(self%last_gap)
        call pack%item(self%n_in_place)
        call pack%item(self%last_imposed, self%imposed_step)
        call pack%item(self%failures)
        call pack%item(self%imposed_end)
        call pack%item(self%is_of_earlier_step)
    end subroutine pack_state
end module tandem_simulate_local_error
