! SPDX-License-Identifier: MIT
!> Details of a failure of a chart, for messages.
module tandem_chart_failure
    use tandem_kinds, only: wp
    use tandem_pack, only: pack_type
    implicit none (type, external)
    private

    public :: chart_failure_type

    type :: chart_failure_type
        !> The constraint row at fault (0 for none) and its error on its natural scale.
        integer :: row = 0
        real(wp) :: value = 0.0_wp
        !> After `rank_deficient`: the rows that depend on each other, `row` among them.
        integer, allocatable :: rows(:)
        !> After `singular_mass`: the coordinate without mass that no constraint conditions, if known; else 0.
        integer :: coordinate = 0
        !> After `callback_failed`, `not_evaluable` or `not_finite`: the term that was being evaluated.
        character(len=:), allocatable :: term
    contains
        procedure :: pack_state
    end type chart_failure_type

contains

    !> All components.
    subroutine pack_state(self, pack)
        class(chart_failure_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%row)
        call pack%item(self%value)
        call pack%item(self%rows)
        call pack%item(self%coordinate)
        call pack%text(self%term)
    end subroutine pack_state
end module tandem_chart_failure
