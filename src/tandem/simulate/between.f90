! SPDX-License-Identifier: MIT
!> Motion between the ends of steps: dense output, and control of its error if output between steps is requested. Dense output does
!> not affect the integration, because the original state is restored.
submodule(tandem_simulation) tandem_simulate_between
    use tandem_simulate_warning, only: dense_limit
    implicit none (type, external)

    !> Ratio of the error of the interpolant's slope, times the step size, to the error of the interpolant: 7 to 10 for the
    !> polynomials of the methods here.
    real(wp), parameter :: slope_error_ratio = 7.0_wp
    !> Ratio of the resulting error of q to an error of qd times the step size; the largest value is that of Hermite's polynomial.
    real(wp), parameter :: q_by_qd = 0.25_wp

contains

    module procedure judge_between
        !> Smallest step, in spacings of the time, that is not dominated by rounding errors.
        real(wp), parameter :: shortest = 1.0e4_wp
        real(wp) :: h, norm
        integer :: order, stat

        is_refused = .false.
        h = self%state%t - self%start%t
        if (.not. (self%between%control%is_due(self%control%norm) .and. h > shortest*spacing(abs(self%state%t)))) then
            call self%between%control%skip()
            return
        end if
        call measure(self, norm, stat)
        ! Output at this time will report the failure of its evaluation.
        if (stat /= status_ok .or. .not. norm <= huge(1.0_wp)) return
        order = self%method%estimate_order
        if (self%method%varies) order = self%stepper%order_of_estimate()
        call self%between%control%judge(h, norm, self%control%norm, real(order + 1, wp), is_refused)
        if (.not. is_refused) return
        self%tally%rejected = self%tally%rejected + 1
        call self%control%reject(h, norm)
        call self%lost_rank%go_back(h)
        call self%chart%set_memory()
        self%attempts%cause = status_ok
    end procedure judge_between

    !> Error within the last step relative to its limit: at the position that the method specifies and, unless the error there is
    !> far below the limit, also near the end, where errors are largest in steps towards a sharp bend of the motion.
    subroutine measure(self, norm, stat)
        class(simulation_type), intent(inout) :: self
        real(wp), intent(out) :: norm
        integer, intent(out) :: stat
        !> Smallest ratio of the error at the second position to the largest error in the step.
        real(wp), parameter :: least_share = 0.5_wp
        real(wp), parameter :: near_end = 0.9_wp, far_below = 0.1_wp
        real(wp) :: second

        call measure_at(self%method%dense_probe, norm)
        if (stat /= status_ok .or. .not. (norm > far_below .and. norm <= 1.0_wp)) return
        call measure_at(near_end, second)
        norm = max(norm, second)

    contains

        !> Error at a position in the step, 0 at its start and 1 at its end. The chart is unchanged. The error is undefined if the
        !> position cannot be evaluated.
        subroutine measure_at(position, norm)
            real(wp), intent(in) :: position
            real(wp), intent(out) :: norm
            integer :: i

            norm = 0.0_wp
            associate (output => self%between%output, control => self%control, from => self%start%t)
                if (.not. allocated(output%measured_state%q)) call output%measured_state%allocate(self%model%n)
                call self%chart%get_memory(output%memory)
                output%measured_state%t = from + position*(self%state%t - from)
                call go_to(self%stepper, self%chart, self%start, self%state, output%measured_state, output%slope, stat)
                if (stat == status_ok) then
                    call find_errors(self%state%t - from, self%method%implicit, self%model%n_constraints() > 0, self%chart, &
                        self%local_error, output%measured_state, output%slope, output%filtered)
                    do i = 1, self%model%n
                        norm = max(norm, output%slope(i, 1)*control%weight_q(i), output%slope(i, 2)*control%weight_qd(i))
                    end do
                end if
                call self%chart%set_memory(output%memory)
            end associate
            norm = norm/(least_share*dense_limit)
        end subroutine measure_at
    end subroutine measure

    module procedure look_at
        real(wp) :: part_q, part_qd
        integer :: rows(3), stat

        call self%check_ready(error)
        if (allocated(error)) return
        call self%part_end()
        associate (output => self%between%output, state => self%state)
            if (.not. output%is_looking) then
                call output%save_state(state, self%errors)
                output%kept_segment = self%model%segment
                if (output%has_step) call self%chart%get_memory(output%memory)
                output%is_looking = .true.
            end if
            if (abs(t - output%kept%t) <= 0.0_wp) then
                call self%look_back()
                return
            end if
            if (.not. (output%has_step .and. t >= self%start%t .and. t <= output%kept%t)) then
                call set_error(error, status_invalid_option, 't = '//to_text(t)//' is not within the last step', &
                    'use times within the last step')
                call self%look_back()
                return
            end if
            call enter_segment(self, output%segment)
            state%t = t
            if (self%crossing%is_last_step) then
                call self%look_into_crossing(t, stat)
            else
                call go_to(self%stepper, self%chart, self%start, self%next, state, output%slope, stat)
            end if
            if (stat == status_ok) call self%chart%find_errors(t, state%q, state%qd, state%qdd, self%errors, rows, stat)
            if (stat /= status_ok) then
                call self%fail(stat, 'between steps at t = '//to_text(t), error)
                call self%look_back()
                return
            end if
            if (self%crossing%is_last_step) then
                output%largest_q = max(output%largest_q, self%crossing%record%error)
                output%largest_qd = max(output%largest_qd, self%crossing%record%error)
                return
            end if
            call find_errors(self%next%t - self%start%t, self%method%implicit, self%model%n_constraints() > 0, self%chart, &
                self%local_error, state, output%slope, output%filtered)
            call self%local_error%largest_parts(state, output%slope(:, 1), output%slope(:, 2), part_q, part_qd)
            output%largest_q = max(output%largest_q, part_q)
            output%largest_qd = max(output%largest_qd, part_qd)
        end associate
    end procedure look_at

    module procedure look_back
        if (.not. (self%is_ready .and. self%between%output%is_looking)) return
        associate (output => self%between%output)
            output%is_looking = .false.
            call output%restore_state(self%state, self%errors)
            if (.not. output%has_step) return
            call enter_segment(self, output%kept_segment)
            call self%chart%set_memory(output%memory)
        end associate
    end procedure look_back

    !> Set the current segment of the model.
    subroutine enter_segment(self, segment)
        class(simulation_type), intent(inout) :: self
        integer, intent(in) :: segment

        if (self%model%segment == segment) return
        self%model%segment = segment
        call self%chart%forget(.false.)
    end subroutine enter_segment

    !> Set `state` at its time within the step, on all three constraint levels, and the slope of the interpolant there.
    subroutine go_to(stepper, chart, start, arrived, state, slope, stat)
        class(stepper_type), intent(inout) :: stepper
        class(chart_type), intent(inout) :: chart
        !> States at the ends of the step.
        type(state_type), intent(in) :: start, arrived
        type(state_type), intent(inout) :: state
        !> Slopes of q and qd (n, 2).
        real(wp), allocatable, intent(inout) :: slope(:, :)
        integer, intent(out) :: stat

        if (.not. allocated(slope)) allocate (slope(size(state%q), 2))
        call stepper%interpolate(chart, start, arrived, state, slope(:, 1), slope(:, 2), stat)
        if (stat == status_ok) then
            call follow_states(start, arrived, state, slope)
            call chart%project(state%t, state%q, state%qd, .true., stat)
        end if
        if (stat == status_ok) call chart%accelerate(state%t, state%q, state%qd, step_end, state%qdd, stat)
    end subroutine go_to

    !> Set the point and the velocity for interpolated increments. Increments equal the motion except for the displacement by which
    !> the constraints have corrected it since the chart's origin. This displacement is known at both ends of the step and is
    !> interpolated linearly. The resulting curve passes through the states at both ends, and its distance from the manifold is no
    !> larger than the error of the interpolant.
    pure subroutine follow_states(a, b, state, slope)
        !> States at the ends of the step.
        type(state_type), intent(in) :: a, b
        type(state_type), intent(inout) :: state
        real(wp), intent(inout) :: slope(:, :)
        real(wp) :: h, x, off
        integer :: i

        h = b%t - a%t
        x = (state%t - a%t)/h
        do i = 1, size(state%q)
            off = (b%q(i) - a%q(i)) - (b%dq(i) - a%dq(i))
            state%q(i) = a%q(i) + (state%dq(i) - a%dq(i)) + x*off
            slope(i, 1) = slope(i, 1) + off/h
            off = (b%qd(i) - a%qd(i)) - (b%dqd(i) - a%dqd(i))
            state%qd(i) = a%qd(i) + (state%dqd(i) - a%dqd(i)) + x*off
            slope(i, 2) = slope(i, 2) + off/h
        end do
    end subroutine follow_states

    !> Replace slopes of the interpolant at a state by estimates of the absolute errors of the interpolant. Interpolants are exact
    !> at both ends, so their error is a fraction of the step size times the difference between the slope and the rates at the
    !> state. No evaluation of the model is required.
    subroutine find_errors(h, is_implicit, is_bound, chart, scales, state, error, filtered)
        !> Size of the step.
        real(wp), intent(in) :: h
        !> True for an implicit method; true if there are constraints.
        logical, intent(in) :: is_implicit, is_bound
        class(chart_type), intent(inout) :: chart
        type(local_error_type), intent(in) :: scales
        type(state_type), intent(in) :: state
        !> Slopes of q and qd on entry, errors on return (n, 2).
        real(wp), intent(inout), contiguous :: error(:, :)
        !> Errors filtered as by implicit methods (n, 2).
        real(wp), allocatable, intent(inout) :: filtered(:, :)
        real(wp) :: part
        integer :: i

        part = h/slope_error_ratio
        error(:, 1) = part*(error(:, 1) - state%qd)
        error(:, 2) = part*(error(:, 2) - state%qdd)
        call chart%remove_normal(error(:, 1), error(:, 2))
        if (is_implicit) then
            ! As for local errors: stiff modes have rates that are large compared with their errors.
            if (.not. allocated(filtered)) allocate (filtered(size(error, 1), 2))
            filtered(:, :) = error
            call filter_error(chart, filtered(:, 1), filtered(:, 2))
            if (scales%largest_part(state, filtered(:, 1), filtered(:, 2)) < &
                0.1_wp*scales%largest_part(state, error(:, 1), error(:, 2))) error(:, :) = filtered
        end if
        do i = 1, size(error, 1)
            error(i, 2) = abs(error(i, 2))
            error(i, 1) = abs(error(i, 1)) + q_by_qd*h*error(i, 2)
        end do
        if (is_bound) call scales%add_rotation(state, error(:, 1), error(:, 2))
    end subroutine find_errors
end submodule tandem_simulate_between
