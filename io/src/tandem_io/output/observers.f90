! SPDX-License-Identifier: MIT
!> Several observers as one.
module tandem_io_output_observers
    use tandem, only: error_type, observer_type, simulation_type
    implicit none (type, external)
    private

    public :: observer_list_type

    !> A pointer that an array can hold.
    type :: item_type
        class(observer_type), pointer :: observer => null()
    end type item_type

    type, extends(observer_type) :: observer_list_type
        type(item_type), allocatable, private :: items(:)
    contains
        procedure :: add, observe
    end type observer_list_type

contains

    !> Add an observer, which must outlive the list; it is called after those before it.
    subroutine add(self, observer)
        class(observer_list_type), intent(inout) :: self
        class(observer_type), intent(inout), target :: observer

        if (.not. allocated(self%items)) allocate (self%items(0))
        self%items = [self%items, item_type(observer)]
    end subroutine add

    !> Call each observer in turn, also after an error; the first error is returned. An observer may be a list again.
    recursive subroutine observe(self, simulation, occasion, error)
        class(observer_list_type), intent(inout) :: self
        class(simulation_type), intent(inout) :: simulation
        !> `at_start`, `at_step`, `at_event` or `at_end`.
        integer, intent(in) :: occasion
        type(error_type), allocatable, intent(out) :: error
        type(error_type), allocatable :: another
        integer :: i

        if (.not. allocated(self%items)) return
        do i = 1, size(self%items)
            call self%items(i)%observer%observe(simulation, occasion, another)
            if (allocated(another) .and. .not. allocated(error)) call move_alloc(another, error)
        end do
    end subroutine observe
end module tandem_io_output_observers
