! SPDX-License-Identifier: MIT
!> Dense output: the motion at times within the last step, between the steps' own. Looking takes no part in the integration: the
!> state that was left for it comes back.
module tandem_simulate_dense_output
    use tandem_chart, only: chart_type
    use tandem_kinds, only: wp
    use tandem_model, only: model_type
    use tandem_pack, only: pack_type
    use tandem_simulate_local_error, only: local_error_type
    use tandem_status, only: status_invalid_option, status_ok
    use tandem_stepper, only: stepper_type
    use tandem_stepper_state, only: state_type
    implicit none (type, external)
    private

    public :: dense_output_type

    type :: dense_output_type
        !> The segment of the model in which the last step lies.
        integer :: segment = 1
        !> Largest error of the motion at the times that were looked at, on the scale s + |y|.
        real(wp) :: largest_error = 0.0_wp
        !> Whether there is a last step, and whether the state is that of a time within it.
        logical, private :: has_step = .false., is_looking = .false.
        !> Where it has been looked at, the state that was left, its errors and its segment.
        type(state_type), private :: kept
        real(wp), private :: kept_errors(3) = 0.0_wp
        integer, private :: kept_segment = 1
        !> Slopes of the interpolated increments of q and of qd (n, 2).
        real(wp), allocatable, private :: slope(:, :)
    contains
        procedure :: initialize, note_step, forget_step, look_at, look_back, stay, keep, give_back, jump, pack_state
    end type dense_output_type

contains

    !> Begin a run; nothing is allocated before it is looked at.
    subroutine initialize(self)
        class(dense_output_type), intent(out) :: self
    end subroutine initialize

    !> A step was accepted in this segment of the model.
    pure subroutine note_step(self, segment)
        class(dense_output_type), intent(inout) :: self
        integer, intent(in) :: segment

        self%has_step = .true.
        self%segment = segment
    end subroutine note_step

    !> There is no last step: what a failed one leaves behind is no dense output.
    pure subroutine forget_step(self)
        class(dense_output_type), intent(inout) :: self

        self%has_step = .false.
    end subroutine forget_step

    !> Make `state` and `errors` those of a time within the last step, and take note of how wrong they are.
    subroutine look_at(self, t, stepper, chart, model, is_implicit, scales, start, arrived, state, errors, stat)
        class(dense_output_type), intent(inout) :: self
        real(wp), intent(in) :: t
        !> The stepper that has made the step, and whether its method is implicit.
        class(stepper_type), intent(inout) :: stepper
        class(chart_type), intent(inout) :: chart
        class(model_type), intent(inout) :: model
        logical, intent(in) :: is_implicit
        !> On which errors are relative.
        type(local_error_type), intent(in) :: scales
        !> The states at the ends of the step.
        type(state_type), intent(in) :: start, arrived
        type(state_type), intent(inout) :: state
        real(wp), intent(inout) :: errors(3)
        !> A status code; invalid_option where the last step has not passed t.
        integer, intent(out) :: stat
        integer :: rows(3)

        if (.not. self%is_looking) then
            call self%keep(state, errors)
            self%kept_segment = model%segment
            if (self%has_step) call chart%hold()
            if (.not. allocated(self%slope)) allocate (self%slope(model%n, 2))
            self%is_looking = .true.
        end if
        stat = status_ok
        if (abs(t - self%kept%t) <= 0.0_wp) then
            call self%look_back(state, errors, model, chart)
            return
        end if
        if (.not. (self%has_step .and. t >= start%t .and. t <= self%kept%t)) then
            stat = status_invalid_option
            return
        end if
        if (model%segment /= self%segment) then
            model%segment = self%segment
            call chart%forget()
        end if
        state%t = t
        associate (slope => self%slope)
            call stepper%interpolate(chart, start, arrived, t, state%dq, state%dqd, slope(:, 1), slope(:, 2), stat)
            if (stat == status_ok) then
                call follow_states(start, arrived, state, slope)
                call chart%restore_near(t, state%q, state%qd, stat)
            end if
        end associate
        if (stat == status_ok) call chart%solve_dynamics(t, state%q, state%qd, state%qdd, stat)
        if (stat == status_ok) call chart%constraint_errors(t, state%q, state%qd, state%qdd, errors, rows, stat)
        if (stat == status_ok) call note_error(self, arrived%t - start%t, is_implicit, chart, scales, state)
    end subroutine look_at

    !> The point and the velocity of interpolated increments. Increments are the motion itself but for what the constraints have
    !> taken of it since the chart's origin, at both ends of the step; between them that is taken in proportion to time. So the
    !> curve meets the states at both ends, and is beside the manifold by no more than the error of the interpolant.
    pure subroutine follow_states(a, b, state, slope)
        !> The states at the ends of the step.
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

    !> Take note of how well the dense output at a state solves the equations of motion, from the slope of the interpolated
    !> increments against the rates there. Interpolants agree with the motion at both ends, so that what a quarter of the step
    !> leaves at this rate is their error. Takes no evaluation of the model.
    subroutine note_error(self, h, is_implicit, chart, scales, state)
        type(dense_output_type), intent(inout) :: self
        !> Size of the step.
        real(wp), intent(in) :: h
        logical, intent(in) :: is_implicit
        class(chart_type), intent(inout) :: chart
        type(local_error_type), intent(in) :: scales
        type(state_type), intent(in) :: state
        real(wp) :: error, filtered, quarter

        quarter = 0.25_wp*h
        associate (slope => self%slope)
            slope(:, 1) = quarter*(slope(:, 1) - state%qd)
            slope(:, 2) = quarter*(slope(:, 2) - state%qdd)
            call chart%keep_tangent(slope(:, 1), slope(:, 2))
            error = scales%largest_part(state, slope(:, 1), slope(:, 2))
            if (is_implicit) then
                ! As for local errors: a stiff mode has a rate that is large against what it is off by.
                call chart%filter_error(slope(:, 1), slope(:, 2))
                filtered = scales%largest_part(state, slope(:, 1), slope(:, 2))
                if (filtered < 0.1_wp*error) error = filtered
            end if
        end associate
        self%largest_error = max(self%largest_error, error)
    end subroutine note_error

    !> Return to the state that was left, if any was.
    subroutine look_back(self, state, errors, model, chart)
        class(dense_output_type), intent(inout) :: self
        type(state_type), intent(inout) :: state
        real(wp), intent(inout) :: errors(3)
        class(model_type), intent(inout) :: model
        class(chart_type), intent(inout) :: chart

        if (.not. self%is_looking) return
        self%is_looking = .false.
        call self%give_back(state, errors)
        if (.not. self%has_step) return
        if (model%segment /= self%kept_segment) then
            model%segment = self%kept_segment
            call chart%forget()
        end if
        call chart%release()
    end subroutine look_back

    !> Go on from the state that is looked at, not from the one that was left.
    subroutine stay(self, chart)
        class(dense_output_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart

        if (self%is_looking) call chart%release()
        self%is_looking = .false.
    end subroutine stay

    !> Keep a state, while nobody looks elsewhere.
    subroutine keep(self, state, errors)
        class(dense_output_type), intent(inout) :: self
        type(state_type), intent(in) :: state
        real(wp), intent(in) :: errors(3)

        call self%kept%copy(state)
        self%kept_errors = errors
    end subroutine keep

    !> Make a state the one that was kept.
    subroutine give_back(self, state, errors)
        class(dense_output_type), intent(in) :: self
        type(state_type), intent(inout) :: state
        real(wp), intent(out) :: errors(3)

        call state%copy(self%kept)
        errors = self%kept_errors
    end subroutine give_back

    !> By how much velocities differ from those that were kept, the max-norm.
    pure real(wp) function jump(self, qd)
        class(dense_output_type), intent(in) :: self
        real(wp), intent(in) :: qd(:)

        jump = maxval(abs(qd - self%kept%qd))
    end function jump

    !> What is known of the last step besides the states at its ends.
    subroutine pack_state(self, pack)
        class(dense_output_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%has_step)
        call pack%item(self%segment)
        call pack%item(self%largest_error)
    end subroutine pack_state
end module tandem_simulate_dense_output
