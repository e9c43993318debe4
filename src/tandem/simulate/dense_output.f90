! SPDX-License-Identifier: MIT
!> Data of dense output, the motion at times within the last step, between the steps' own: the state to which a run returns, and the
!> interpolant at a requested time. `tandem_simulate_between` evaluates it.
module tandem_simulate_dense_output
    use tandem_chart, only: chart_memory_type, chart_type
    use tandem_kinds, only: wp
    use tandem_pack, only: pack_type
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
        logical :: has_step = .false., is_looking = .false.
        !> During a request: the original state, its errors and its segment.
        type(state_type) :: kept
        real(wp) :: kept_errors(3) = 0.0_wp
        integer :: kept_segment = 1
        !> Slopes of the interpolated increments of q and of qd, later the errors computed from them; the errors after the filter of
        !> implicit methods (n, 2).
        real(wp), allocatable :: slope(:, :), filtered(:, :)
        !> State at the measured position of a step.
        type(state_type) :: probe
        !> The chart's start of the next step, while other points are evaluated.
        class(chart_memory_type), allocatable :: memory
    contains
        procedure :: initialize, note_step, forget_step, stay, keep, give_back, jump, pack_state
    end type dense_output_type

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
