! SPDX-License-Identifier: MIT
!> Steppers by name.
module tandem_stepper_factory
    use tandem_options, only: stepper_choices, stepper_names
    use tandem_stepper, only: stepper_type
    implicit none (type, external)
    private

    public :: new_stepper, stepper_choices, stepper_names

    ! The submodule alone uses the modules of the steppers, so that a change in one of them recompiles few files.
    interface
        !> Allocate the stepper of a name; left unallocated where the name is unknown.
        module subroutine new_stepper(name, stepper)
            implicit none (type, external)
            !> One of `stepper_choices`.
            character(len=*), intent(in) :: name
            class(stepper_type), allocatable, intent(out) :: stepper
        end subroutine new_stepper
    end interface
end module tandem_stepper_factory
