! SPDX-License-Identifier: MIT
!> Detects that stability, not accuracy, limits the steps of an explicit stepper, and estimates the work with an implicit stepper.
!>
!> The criterion is 15 steps at the limit of stability without 6 other steps in a row between them, so that single steps are
!> ignored. Source: Hairer, Wanner, Solving Ordinary Differential Equations II, section IV.2, automatic stiffness detection.
module tandem_simulate_stiffness
    use tandem_kinds, only: long, wp
    use tandem_pack, only: pack_type
    use tandem_simulate_smoothness, only: smoothness_type
    use tandem_simulate_switching, only: cost_of_implicit
    implicit none (type, external)
    private

    public :: stiffness_type, implicit_advice

    !> Stepper to be advised.
    character(len=*), parameter :: implicit_advice = 'radau5'

    !> Number of steps at the limit of stability that make a run stiff; number of other steps in a row that resets the count.
    integer, parameter :: enough = 15, reset_after = 6

    type :: stiffness_type
        !> True if stiffness was detected; start time of the first step that showed it.
        logical :: is_stiff = .false.
        real(wp) :: since = 0.0_wp
        !> Number of steps at the limit of stability.
        integer(long) :: steps = 0
        !> Number of steps that an implicit method under error control would have taken so far.
        type(smoothness_type) :: smoothness
        integer, private :: in_a_row = 0, others = 0
        real(wp), private :: first = 0.0_wp
    contains
        procedure :: pause, observe, part_of_implicit, pack_state
    end type stiffness_type

contains

    !> Pause, because another stepper continues.
    pure subroutine pause(self)
        class(stiffness_type), intent(inout) :: self

        self%in_a_row = 0
        self%others = 0
        call self%smoothness%pause()
    end subroutine pause

    !> Add an accepted step.
    pure subroutine observe(self, t, is_at_limit)
        class(stiffness_type), intent(inout) :: self
        !> Start of the step.
        real(wp), intent(in) :: t
        !> True if the step was at the limit of stability.
        logical, intent(in) :: is_at_limit

        if (.not. is_at_limit) then
            self%others = self%others + 1
            if (self%others >= reset_after) self%in_a_row = 0
            return
        end if
        self%steps = self%steps + 1
        self%others = 0
        if (self%in_a_row == 0) self%first = t
        self%in_a_row = self%in_a_row + 1
        if (self%is_stiff .or. self%in_a_row < enough) return
        self%is_stiff = .true.
        self%since = self%first
    end subroutine observe

    !> Ratio of the work with the implicit method to the work of this run; 0 if unknown.
    pure real(wp) function part_of_implicit(self, attempts, stages, n_differences)
        class(stiffness_type), intent(in) :: self
        !> Number of step attempts, and number of stages per step.
        integer(long), intent(in) :: attempts
        integer, intent(in) :: stages
        !> Number of coordinates with derivatives by differences; 0 if the model provides derivatives.
        integer, intent(in) :: n_differences

        part_of_implicit = 0.0_wp
        if (attempts == 0) return
        part_of_implicit = self%smoothness%needed*cost_of_implicit(n_differences)/(real(attempts, wp)*real(stages, wp))
    end function part_of_implicit

    !> Pack all components.
    subroutine pack_state(self, pack)
        class(stiffness_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%is_stiff)
        call pack%item(self%since)
        call pack%item(self%steps)
        call self%smoothness%pack_state(pack)
        call pack%item(self%in_a_row, self%others)
        call pack%item(self%first)
    end subroutine pack_state
end module tandem_simulate_stiffness
