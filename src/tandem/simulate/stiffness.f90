! SPDX-License-Identifier: MIT
!> Notices that stability, not accuracy, limits the steps of an explicit stepper.
!>
!> Single steps at the limit of stability mean nothing: it takes 15, without 6 others in a row between them.
!> Source: Hairer, Wanner, Solving Ordinary Differential Equations II, section IV.2, automatic stiffness detection.
module tandem_simulate_stiffness
    use tandem_kinds, only: long, wp
    use tandem_pack, only: pack_type
    implicit none (type, external)
    private

    public :: stiffness_type

    !> So many steps at the limit make a run stiff; so many others in a row forget them.
    integer, parameter :: enough = 15, pardon = 6

    type :: stiffness_type
        !> Whether it was noticed, and the start of the first of the steps that showed it.
        logical :: is_stiff = .false.
        real(wp) :: since = 0.0_wp
        !> All steps at the limit.
        integer(long) :: steps = 0
        integer, private :: in_a_row = 0, others = 0
        real(wp), private :: first = 0.0_wp
    contains
        procedure :: observe
        procedure :: pack_state
    end type stiffness_type

contains

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

    !> What was seen so far.
    subroutine pack_state(self, pack)
        class(stiffness_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%is_stiff)
        call pack%item(self%since)
        call pack%item(self%steps)
        call pack%item(self%in_a_row)
        call pack%item(self%others)
        call pack%item(self%first)
    end subroutine pack_state
end module tandem_simulate_stiffness
