! SPDX-License-Identifier: MIT
!> Step size control for the motion between the ends of steps: controls the error of dense output if states between steps are
!> requested.
!>
!> The error of dense output is proportional to the same power of the step size as the error estimate of the step, so that both
!> limit the next step in the same way. The error is measured only if it may matter: after errors far below the limit, some steps
!> are not measured. An error that does not decrease in shorter steps, such as rounding errors or errors near a kink that is not a
!> breakpoint, is accepted.
module tandem_simulate_dense_control
    use tandem_kinds, only: wp
    use tandem_pack, only: pack_type
    implicit none (type, external)
    private

    public :: dense_control_type

    !> Target error of the next step, relative to the limit.
    real(wp), parameter :: aim = 0.5_wp
    !> If the error predicted from the last measured step is below the first number, at most `most_skipped` steps are not measured.
    !> Error estimates below the second number are replaced by it in predictions.
    real(wp), parameter :: small = 1.0e-3_wp, least_estimate = 1.0e-3_wp
    integer, parameter :: most_skipped = 2
    !> Number of attempts without a reduction of the error after which the error is accepted. A smooth error decreases faster than
    !> with the power `slowest` of the step size.
    integer, parameter :: most_ineffective = 2
    real(wp), parameter :: slowest = 1.5_wp

    type :: dense_control_type
        !> Upper limit of the next step size.
        real(wp) :: longest = huge(1.0_wp)
        !> Error of the last measured step, and error estimate of the step itself, negative if there is none; number of steps since
        !> then.
        real(wp), private :: norm = 0.0_wp, estimate = -1.0_wp
        integer, private :: skipped = 0
        !> Size and error of the last rejected attempt of the current step, 0 if there is none; number of attempts that did not
        !> reduce the error.
        real(wp), private :: rejected_size = 0.0_wp, rejected_norm = 0.0_wp
        integer, private :: ineffective = 0
    contains
        procedure :: begin, begin_step, skip, is_due, judge, pack_state
    end type dense_control_type

contains

    !> Clear the history: another method or motion begins, or no states between steps are requested any more.
    subroutine begin(self)
        class(dense_control_type), intent(out) :: self
    end subroutine begin

    !> Begin the first attempt of a step.
    pure subroutine begin_step(self)
        class(dense_control_type), intent(inout) :: self

        self%rejected_size = 0.0_wp
        self%ineffective = 0
    end subroutine begin_step

    !> Count a step that is not measured. After `most_skipped` such steps the last measurement no longer limits the step size.
    pure subroutine skip(self)
        class(dense_control_type), intent(inout) :: self

        self%skipped = self%skipped + 1
        if (self%skipped > most_skipped) self%longest = huge(1.0_wp)
    end subroutine skip

    !> True if the error in a step with the given error estimate, relative to the tolerances, is to be measured. The ratio of both
    !> errors is assumed to change little.
    pure logical function is_due(self, estimate)
        class(dense_control_type), intent(in) :: self
        real(wp), intent(in) :: estimate

        is_due = self%estimate < 0.0_wp .or. self%skipped >= most_skipped .or. &
            (self%estimate < least_estimate .and. estimate > least_estimate)
        if (.not. is_due) is_due = self%norm*(max(estimate, least_estimate)/max(self%estimate, least_estimate)) > small
    end function is_due

    !> Accept or reject an attempt, given the error between its ends, and set the upper limit of the next step size.
    pure subroutine judge(self, h, norm, estimate, power, is_rejected)
        class(dense_control_type), intent(inout) :: self
        !> Size of the step; its error relative to the limit; error estimate of the step itself; power of the step size to which
        !> both errors are proportional.
        real(wp), intent(in) :: h, norm, estimate, power
        logical, intent(out) :: is_rejected

        is_rejected = norm > 1.0_wp
        if (is_rejected) then
            if (self%rejected_size > 0.0_wp) then
                if (norm > self%rejected_norm*(h/self%rejected_size)**slowest) self%ineffective = self%ineffective + 1
            end if
            self%rejected_size = h
            self%rejected_norm = norm
            is_rejected = self%ineffective < most_ineffective
            ! Measure the next attempt in any case.
            self%estimate = -1.0_wp
            self%longest = huge(1.0_wp)
            return
        end if
        self%norm = norm
        self%estimate = estimate
        self%skipped = 0
        self%longest = h*(aim/max(norm, tiny(1.0_wp)))**(1.0_wp/power)
    end subroutine judge

    !> Pack the last measurement and the attempts of the current step.
    subroutine pack_state(self, pack)
        class(dense_control_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%longest)
        call pack%item(self%norm, self%estimate)
        call pack%item(self%rejected_size, self%rejected_norm)
        call pack%item(self%skipped)
        call pack%item(self%ineffective)
    end subroutine pack_state
end module tandem_simulate_dense_control
