! SPDX-License-Identifier: MIT
!> A list of observers that acts as one observer.
module tandem_io_output_observers
    use tandem, only: error_type, observer_type, simulation_type
    implicit none (type, external)
    private

    public :: observer_list_type

    !> Element of an array of pointers.
    type :: item_type
        class(observer_type), pointer :: observer => null()
    end type item_type

    type, extends(observer_type) :: observer_list_type
        type(item_type), allocatable, private :: items(:)
    contains
        procedure :: add, observe
    end type observer_list_type

contains

    !> Add an observer, which must outlive the list. Observers are called in the order in which they were added.
    subroutine add(self, observer)
        class(observer_list_type), intent(inout) :: self
        class(observer_type), intent(inout), target :: observer

        if (.not. allocated(self%items)) allocate (self%items(0))
        self%items = [self%items, item_type(observer)]
    end subroutine add

    !> Call each observer in turn, even after an error; the first error is returned. An observer may itself be a list.
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
