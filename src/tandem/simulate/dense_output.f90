! SPDX-License-Identifier: MIT
!> Dense output: the motion at times within the last step, between the steps' own. It does not affect the integration: the original
!> state is restored.
module tandem_simulate_dense_output
    use tandem_chart, only: chart_memory_type, chart_type, step_end
    use tandem_chart_implicit, only: filter_error
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
        !> Largest errors of q and of qd at the requested times, on the scale s + |y|.
        real(wp) :: largest_q = 0.0_wp, largest_qd = 0.0_wp
        !> True if there is a last step; true if the state belongs to a time within it.
        logical, private :: has_step = .false., is_looking = .false.
        !> During a request: the original state, its errors and its segment.
        type(state_type), private :: kept
        real(wp), private :: kept_errors(3) = 0.0_wp
        integer, private :: kept_segment = 1
        !> Slopes of the interpolated increments of q and of qd, later the errors computed from them; the errors after the filter of
        !> implicit methods (n, 2).
        real(wp), allocatable, private :: slope(:, :), filtered(:, :)
        !> State at the measured position of a step.
        type(state_type), private :: probe
        !> The chart's start of the next step, while other points are evaluated.
        class(chart_memory_type), allocatable, private :: memory
    contains
        procedure :: initialize, note_step, forget_step, look_at, look_back, measure, stay, keep, give_back, jump, pack_state
    end type dense_output_type

    !> Error of the slope of an interpolant, times the step, over its largest error: 7 to 10 for the methods here, by their
    !> polynomials.
    real(wp), parameter :: miss_of_error = 7.0_wp
    !> The error of q that results from an error of qd, over the step times it; the largest is that of Hermite's polynomial.
    real(wp), parameter :: q_by_qd = 0.25_wp

contains

    !> Begin a run; nothing is allocated before the first request.
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

    !> Invalidate the last step after a failed one: there is no dense output.
    pure subroutine forget_step(self)
        class(dense_output_type), intent(inout) :: self

        self%has_step = .false.
    end subroutine forget_step

    !> Set `state` and `errors` for a time within the last step, and record the largest errors.
    subroutine look_at(self, t, stepper, chart, model, is_implicit, scales, start, arrived, state, errors, stat)
        class(dense_output_type), intent(inout) :: self
        real(wp), intent(in) :: t
        !> The stepper of the last step; true if its method is implicit.
        class(stepper_type), intent(inout) :: stepper
        class(chart_type), intent(inout) :: chart
        class(model_type), intent(inout) :: model
        logical, intent(in) :: is_implicit
        !> Scales of relative errors.
        type(local_error_type), intent(in) :: scales
        !> The states at the ends of the step.
        type(state_type), intent(in) :: start, arrived
        type(state_type), intent(inout) :: state
        real(wp), intent(inout) :: errors(3)
        !> A status code; invalid_option if t is outside the last step.
        integer, intent(out) :: stat
        real(wp) :: part_q, part_qd
        integer :: rows(3)

        if (.not. self%is_looking) then
            call self%keep(state, errors)
            self%kept_segment = model%segment
            if (self%has_step) call chart%get_memory(self%memory)
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
            call chart%forget(.false.)
        end if
        call go_to(self, t, stepper, chart, start, arrived, state, stat)
        if (stat == status_ok) call chart%find_errors(t, state%q, state%qd, state%qdd, errors, rows, stat)
        if (stat /= status_ok) return
        call find_errors(self, arrived%t - start%t, is_implicit, model%n_constraints() > 0, chart, scales, state)
        call scales%largest_parts(state, self%slope(:, 1), self%slope(:, 2), part_q, part_qd)
        self%largest_q = max(self%largest_q, part_q)
        self%largest_qd = max(self%largest_qd, part_qd)
    end subroutine look_at

    !> The largest weighted error of the motion within a step, from one position at which interpolants of the method miss the rates
    !> most. The chart is unchanged.
    subroutine measure(self, place, stepper, chart, model, is_implicit, scales, start, arrived, weight_q, weight_qd, norm, stat)
        class(dense_output_type), intent(inout) :: self
        !> 0 at the start of the step, 1 at its end.
        real(wp), intent(in) :: place
        class(stepper_type), intent(inout) :: stepper
        class(chart_type), intent(inout) :: chart
        class(model_type), intent(in) :: model
        logical, intent(in) :: is_implicit
        type(local_error_type), intent(in) :: scales
        !> The states at the ends of the step.
        type(state_type), intent(in) :: start, arrived
        !> Weights of the errors of q and qd (n).
        real(wp), intent(in), contiguous :: weight_q(:), weight_qd(:)
        real(wp), intent(out) :: norm
        !> A status code: the error is undefined if the position is not evaluable.
        integer, intent(out) :: stat
        integer :: i

        norm = 0.0_wp
        if (.not. allocated(self%probe%q)) call self%probe%allocate(size(start%q))
        call chart%get_memory(self%memory)
        call go_to(self, start%t + place*(arrived%t - start%t), stepper, chart, start, arrived, self%probe, stat)
        if (stat == status_ok) then
            call find_errors(self, arrived%t - start%t, is_implicit, model%n_constraints() > 0, chart, scales, self%probe)
            do i = 1, size(weight_q)
                norm = max(norm, self%slope(i, 1)*weight_q(i), self%slope(i, 2)*weight_qd(i))
            end do
        end if
        call chart%set_memory(self%memory)
    end subroutine measure

    !> Set `state` for a time within a step, on all three constraint levels, and `slope` for the interpolant.
    subroutine go_to(self, t, stepper, chart, start, arrived, state, stat)
        class(dense_output_type), intent(inout) :: self
        real(wp), intent(in) :: t
        class(stepper_type), intent(inout) :: stepper
        class(chart_type), intent(inout) :: chart
        type(state_type), intent(in) :: start, arrived
        type(state_type), intent(inout) :: state
        integer, intent(out) :: stat

        if (.not. allocated(self%slope)) allocate (self%slope(size(start%q), 2))
        state%t = t
        associate (slope => self%slope)
            call stepper%interpolate(chart, start, arrived, t, state%dq, state%dqd, slope(:, 1), slope(:, 2), stat)
            if (stat == status_ok) then
                call follow_states(start, arrived, state, slope)
                call chart%project(t, state%q, state%qd, .true., stat)
            end if
        end associate
        if (stat == status_ok) call chart%accelerate(t, state%q, state%qd, step_end, state%qdd, stat)
    end subroutine go_to

    !> The point and the velocity of interpolated increments. Increments are the motion itself except for the part that the
    !> constraints have removed since the chart's origin, at both ends of the step; between them that part is interpolated linearly.
    !> So the curve meets the states at both ends, and deviates from the manifold by no more than the error of the interpolant.
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

    !> Turn the slope of the interpolant at a state into moduli of errors: residuals of the dense output in the equations of motion.
    !> Interpolants agree with the motion at both ends; so their errors are a part of the step times the difference between the
    !> slope and the rates at the state. Needs no evaluation of the model.
    subroutine find_errors(self, h, is_implicit, is_bound, chart, scales, state)
        type(dense_output_type), intent(inout) :: self
        !> Size of the step.
        real(wp), intent(in) :: h
        !> True if the method is implicit; true if there are constraints.
        logical, intent(in) :: is_implicit, is_bound
        class(chart_type), intent(inout) :: chart
        type(local_error_type), intent(in) :: scales
        type(state_type), intent(in) :: state
        real(wp) :: part
        integer :: i

        part = h/miss_of_error
        associate (error => self%slope)
            error(:, 1) = part*(error(:, 1) - state%qd)
            error(:, 2) = part*(error(:, 2) - state%qdd)
            call chart%remove_normal(error(:, 1), error(:, 2))
            if (is_implicit) then
                ! As for local errors: a stiff mode has a rate that is large against its error.
                if (.not. allocated(self%filtered)) allocate (self%filtered(size(error, 1), 2))
                self%filtered(:, :) = error
                call filter_error(chart, self%filtered(:, 1), self%filtered(:, 2))
                if (scales%largest_part(state, self%filtered(:, 1), self%filtered(:, 2)) < &
                    0.1_wp*scales%largest_part(state, error(:, 1), error(:, 2))) error(:, :) = self%filtered
            end if
            do i = 1, size(error, 1)
                error(i, 2) = abs(error(i, 2))
                error(i, 1) = abs(error(i, 1)) + q_by_qd*h*error(i, 2)
            end do
            if (is_bound) call scales%add_turn(state, error(:, 1), error(:, 2))
        end associate
    end subroutine find_errors

    !> Restore the original state, if it was replaced.
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
            call chart%forget(.false.)
        end if
        call chart%set_memory(self%memory)
    end subroutine look_back

    !> Continue from the current state instead of the original one.
    subroutine stay(self, chart)
        class(dense_output_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart

        if (self%is_looking) call chart%set_memory(self%memory)
        self%is_looking = .false.
    end subroutine stay

    !> Store a state, to be restored later.
    subroutine keep(self, state, errors)
        class(dense_output_type), intent(inout) :: self
        type(state_type), intent(in) :: state
        real(wp), intent(in) :: errors(3)

        call self%kept%copy(state)
        self%kept_errors = errors
    end subroutine keep

    !> Restore the stored state.
    subroutine give_back(self, state, errors)
        class(dense_output_type), intent(in) :: self
        type(state_type), intent(inout) :: state
        real(wp), intent(out) :: errors(3)

        call state%copy(self%kept)
        errors = self%kept_errors
    end subroutine give_back

    !> Difference of velocities from the stored ones, max-norm.
    pure real(wp) function jump(self, qd)
        class(dense_output_type), intent(in) :: self
        real(wp), intent(in) :: qd(:)

        jump = maxval(abs(qd - self%kept%qd))
    end function jump

    !> Data of the last step besides the states at its ends.
    subroutine pack_state(self, pack)
        class(dense_output_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%has_step)
        call pack%item(self%segment)
        call pack%item(self%largest_q, self%largest_qd)
    end subroutine pack_state
end module tandem_simulate_dense_output
