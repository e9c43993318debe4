! SPDX-License-Identifier: MIT
!> Notices that stability, not accuracy, limits the steps of an explicit stepper, and whether an implicit one would be faster.
!>
!> Single steps at the limit of stability mean nothing: it takes 15, without 6 others in a row between them.
!> Source: Hairer, Wanner, Solving Ordinary Differential Equations II, section IV.2, automatic stiffness detection.
module tandem_simulate_stiffness
    use tandem_kinds, only: long, wp
    use tandem_pack, only: pack_type
    use tandem_simulate_smoothness, only: smoothness_type
    use tandem_simulate_switching, only: cost_of_implicit
    implicit none (type, external)
    private

    public :: stiffness_type, implicit_advice

    !> What is advised.
    character(len=*), parameter :: implicit_advice = 'radau5'

    !> So many steps at the limit make a run stiff; so many others in a row forget them.
    integer, parameter :: enough = 15, pardon = 6

    type :: stiffness_type
        !> Whether it was noticed, and the start of the first of the steps that showed it.
        logical :: is_stiff = .false.
        real(wp) :: since = 0.0_wp
        !> All steps at the limit.
        integer(long) :: steps = 0
        !> Steps that the implicit method would have taken so far, under error control.
        type(smoothness_type) :: smoothness
        integer, private :: in_a_row = 0, others = 0
        real(wp), private :: first = 0.0_wp
    contains
        procedure :: pause, observe, part_of_implicit, pack_state
    end type stiffness_type

contains

    !> Another stepper goes on.
    pure subroutine pause(self)
        class(stiffness_type), intent(inout) :: self

        self%in_a_row = 0
        self%others = 0
        call self%smoothness%pause()
    end subroutine pause

    !> Take note of an accepted step.
    pure subroutine observe(self, t, is_at_limit)
        class(stiffness_type), intent(inout) :: self
        !> Its start.
        real(wp), intent(in) :: t
        !> Whether it was at the limit of stability.
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

    !> The work of a run with the implicit method, as a part of that of this run; 0 where that is not known.
    pure real(wp) function part_of_implicit(self, tries, stages, n_differences)
        class(stiffness_type), intent(in) :: self
        !> Steps taken and rejected, and the stages of each.
        integer(long), intent(in) :: tries
        integer, intent(in) :: stages
        !> Coordinates by which derivatives are made by differences; 0 where the model gives them.
        integer, intent(in) :: n_differences

        part_of_implicit = 0.0_wp
        if (tries == 0) return
        part_of_implicit = self%smoothness%needed*cost_of_implicit(n_differences)/(real(tries, wp)*real(stages, wp))
    end function part_of_implicit

    !> What was seen so far.
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
