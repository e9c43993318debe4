! SPDX-License-Identifier: MIT
!> Detects that stability, not accuracy, limits the steps of an explicit stepper, and estimates the work of an implicit one.
!>
!> Single steps at the limit of stability are ignored: the criterion is 15, without 6 others in a row between them.
!> Source: Hairer, Wanner, Solving Ordinary Differential Equations II, section IV.2, automatic stiffness detection.
module tandem_simulate_stiffness
    use tandem_kinds, only: long, wp
    use tandem_pack, only: pack_type
    use tandem_simulate_smoothness, only: smoothness_type
    use tandem_simulate_switching, only: cost_of_implicit
    implicit none (type, external)
    private

    public :: stiffness_type, implicit_advice

    !> The advised stepper.
    character(len=*), parameter :: implicit_advice = 'radau5'

    !> Number of steps at the limit that make a run stiff; number of others in a row that reset the count.
    integer, parameter :: enough = 15, pardon = 6

    type :: stiffness_type
        !> True if stiffness was detected; the start of the first of the steps that showed it.
        logical :: is_stiff = .false.
        real(wp) :: since = 0.0_wp
        !> Number of steps at the limit.
        integer(long) :: steps = 0
        !> Steps of the implicit method for the motion so far, under error control.
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
        !> Its start.
        real(wp), intent(in) :: t
        !> True if it was at the limit of stability.
        logical, intent(in) :: is_at_limit

        if (.not. is_at_limit) then
            self%others = self%others + 1
            if (self%others >= pardon) self%in_a_row = 0
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

    !> The work of a run with the implicit method, as a part of this run's work; 0 if unknown.
    pure real(wp) function part_of_implicit(self, tries, stages, n_differences)
        class(stiffness_type), intent(in) :: self
        !> Steps taken and rejected, and the stages of each.
        integer(long), intent(in) :: tries
        integer, intent(in) :: stages
        !> Number of coordinates with derivatives by differences; 0 if the model provides them.
        integer, intent(in) :: n_differences

        part_of_implicit = 0.0_wp
        if (tries == 0) return
        part_of_implicit = self%smoothness%needed*cost_of_implicit(n_differences)/(real(tries, wp)*real(stages, wp))
    end function part_of_implicit

    !> The state so far.
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
