! SPDX-License-Identifier: MIT
!> Limits of the step size for the motion between the ends of steps, if states there are requested: error control of dense output.
!>
!> Its error is proportional to the same power of the step as the error estimate of the step, so that both bound the next step
!> alike. Steps are measured if it may matter: errors far below the limit leave some steps unmeasured. An error that shorter tries
!> do not reduce, as behind an unannounced kink, or of rounding, is accepted.
module tandem_simulate_dense_control
    use tandem_kinds, only: wp
    use tandem_pack, only: pack_type
    implicit none (type, external)
    private

    public :: dense_control_type

    !> The target of the next step's error, relative to its limit.
    real(wp), parameter :: aim = 0.5_wp
    !> Below this error, predicted from the last measured step, at most the following number of steps is left unmeasured. Estimates
    !> below the other bound are raised to it, and predict nothing for steps above it.
    real(wp), parameter :: small = 1.0e-3_wp, least_estimate = 1.0e-3_wp
    integer, parameter :: most_skipped = 2
    !> Tries of a step that may fail to reduce the error. A smooth error falls faster than with this power of the step.
    integer, parameter :: most_in_vain = 2
    real(wp), parameter :: slowest = 1.5_wp

    type :: dense_control_type
        !> The longest next step.
        real(wp) :: longest = huge(1.0_wp)
        !> The error of the last measured step, and the error estimate of that step itself, below 0 for none; number of steps not
        !> measured since.
        real(wp), private :: norm = 0.0_wp, estimate = -1.0_wp
        integer, private :: skipped = 0
        !> The last refused try of a step and its error, 0 for none, and the number of tries that did not reduce it.
        real(wp), private :: refused = 0.0_wp, refused_norm = 0.0_wp
        integer, private :: in_vain = 0
    contains
        procedure :: begin, begin_step, skip, is_due, judge, pack_state
    end type dense_control_type

contains

    !> Clear the history of steps: another method, another motion, or no more requests between steps.
    subroutine begin(self)
        class(dense_control_type), intent(out) :: self
    end subroutine begin

    !> Begin the first try of a step.
    pure subroutine begin_step(self)
        class(dense_control_type), intent(inout) :: self

        self%refused = 0.0_wp
        self%in_vain = 0
    end subroutine begin_step

    !> Count a step that is not measured; after some of them the last measurement no longer predicts the next one.
    pure subroutine skip(self)
        class(dense_control_type), intent(inout) :: self

        self%skipped = self%skipped + 1
        if (self%skipped > most_skipped) self%longest = huge(1.0_wp)
    end subroutine skip

    !> True if a step with this error estimate, on the scale of the tolerances, is to be measured. Between steps the error is
    !> proportional to the estimate, even if the motion changes.
    pure logical function is_due(self, estimate)
        class(dense_control_type), intent(in) :: self
        real(wp), intent(in) :: estimate

        is_due = self%estimate < 0.0_wp .or. self%skipped >= most_skipped .or. &
            (self%estimate < least_estimate .and. estimate > least_estimate)
        if (.not. is_due) is_due = self%norm*(max(estimate, least_estimate)/max(self%estimate, least_estimate)) > small
    end function is_due

    !> Judge a try by the error between its ends, and choose the longest next step.
    pure subroutine judge(self, h, norm, estimate, power, is_refused)
        class(dense_control_type), intent(inout) :: self
        !> Its length, its error relative to the limit, the error estimate of the step itself, and the power of the length to which
        !> both are proportional.
        real(wp), intent(in) :: h, norm, estimate, power
        logical, intent(out) :: is_refused

        is_refused = norm > 1.0_wp
        if (is_refused) then
            if (self%refused > 0.0_wp) then
                if (norm > self%refused_norm*(h/self%refused)**slowest) self%in_vain = self%in_vain + 1
            end if
            self%refused = h
            self%refused_norm = norm
            is_refused = self%in_vain < most_in_vain
            ! The next try is measured unconditionally.
            self%estimate = -1.0_wp
            self%longest = huge(1.0_wp)
            return
        end if
        self%norm = norm
        self%estimate = estimate
        self%skipped = 0
        self%longest = h*(aim/max(norm, tiny(1.0_wp)))**(1.0_wp/power)
    end subroutine judge

    !> The last measurement, and the tries of the step that is made.
    subroutine pack_state(self, pack)
        class(dense_control_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%longest)
        call pack%item(self%norm, self%estimate)
        call pack%item(self%refused, self%refused_norm)
        call pack%item(self%skipped)
        call pack%item(self%in_vain)
    end subroutine pack_state
end module tandem_simulate_dense_control
