! SPDX-License-Identifier: MIT
!> Creates steppers from their names.
module tandem_stepper_factory
    use tandem_options, only: stepper_choices, stepper_names
    use tandem_stepper, only: stepper_type
    implicit none (type, external)
    private

    public :: new_stepper, stepper_choices, stepper_names

    ! Only the submodule uses the modules of the steppers, so that a change in one of them recompiles few files.
    interface
        !> Allocate the stepper with the given name; leave it unallocated if the name is unknown.
        module subroutine new_stepper(name, stepper)
            implicit none (type, external)
            !> One of `stepper_choices`.
            character(len=*), intent(in) :: name
            class(stepper_type), allocatable, intent(out) :: stepper
        end subroutine new_stepper
    end interface
end module tandem_stepper_factory
