! SPDX-License-Identifier: MIT
!> Data of dense output at times within the last step: the state to be restored after a request, and the interpolant at the
!> requested time. `tandem_simulate_between` evaluates it.
module tandem_simulate_dense_output
    use tandem_chart, only: chart_memory_type, chart_type
    use tandem_kinds, only: wp
    use tandem_pack, only: pack_type
    use tandem_stepper_state, only: state_type
    implicit none (type, external)
    private

    public :: dense_output_type

    type :: dense_output_type
        !> Segment of the model that contains the last step.
        integer :: segment = 1
        !> Largest errors of q and of qd at the requested times, relative to scale + |y|.
        real(wp) :: largest_q = 0.0_wp, largest_qd = 0.0_wp
        !> True if there is a last step; true if the current state is a state within it.
        logical :: has_step = .false., is_looking = .false.
        !> During a request: the state at the end of the step, its errors, and its segment.
        type(state_type) :: kept
        real(wp) :: kept_errors(3) = 0.0_wp
        integer :: kept_segment = 1
        !> Slopes of the interpolated increments of q and qd, later replaced by the errors computed from them; errors filtered as by
        !> implicit methods (n, 2).
        real(wp), allocatable :: slope(:, :), filtered(:, :)
        !> State at which the error of a step is measured.
        type(state_type) :: measured_state
        !> Saved chart for the next step, while other points are evaluated.
        class(chart_memory_type), allocatable :: memory
    contains
        procedure :: initialize, note_step, forget_step, discard_saved_state, save_state, restore_state, jump, pack_state
    end type dense_output_type

contains

    !> Begin a run. Nothing is allocated before the first request.
    subroutine initialize(self)
        class(dense_output_type), intent(out) :: self
    end subroutine initialize

    !> Record that a step in the given segment of the model was accepted.
    pure subroutine note_step(self, segment)
        class(dense_output_type), intent(inout) :: self
        integer, intent(in) :: segment

        self%has_step = .true.
        self%segment = segment
    end subroutine note_step

    !> Invalidate the last step after a failed one; there is then no dense output.
    pure subroutine forget_step(self)
        class(dense_output_type), intent(inout) :: self

        self%has_step = .false.
    end subroutine forget_step

    !> Continue from the current state and discard the saved one.
    subroutine discard_saved_state(self, chart)
        class(dense_output_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart

        if (self%is_looking) call chart%set_memory(self%memory)
        self%is_looking = .false.
    end subroutine discard_saved_state

    !> Save a state and its errors.
    subroutine save_state(self, state, errors)
        class(dense_output_type), intent(inout) :: self
        type(state_type), intent(in) :: state
        real(wp), intent(in) :: errors(3)

        call self%kept%copy(state)
        self%kept_errors = errors
    end subroutine save_state

    !> Restore the saved state and its errors.
    subroutine restore_state(self, state, errors)
        class(dense_output_type), intent(in) :: self
        type(state_type), intent(inout) :: state
        real(wp), intent(out) :: errors(3)

        call state%copy(self%kept)
        errors = self%kept_errors
    end subroutine restore_state

    !> Largest change of velocities since the saved state.
    pure real(wp) function jump(self, qd)
        class(dense_output_type), intent(in) :: self
        real(wp), intent(in) :: qd(:)

        jump = maxval(abs(qd - self%kept%qd))
    end function jump

    !> Pack the data of the last step, except for the states at its ends.
    subroutine pack_state(self, pack)
        class(dense_output_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%has_step)
        call pack%item(self%segment)
        call pack%item(self%largest_q, self%largest_qd)
    end subroutine pack_state
end module tandem_simulate_dense_output
