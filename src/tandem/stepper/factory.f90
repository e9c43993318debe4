! SPDX-License-Identifier: MIT
!> Steppers by name.
module tandem_stepper_factory
    use tandem_options, only: stepper_choices, stepper_names
    use tandem_stepper, only: stepper_type
    use tandem_stepper_auto, only: auto_type
    use tandem_stepper_dop853, only: dop853_type
    use tandem_stepper_dopri5, only: dopri5_type
    use tandem_stepper_radau, only: radau_type
    use tandem_stepper_radau5, only: radau5_type
    use tandem_stepper_rk4, only: rk4_type
    use tandem_stepper_sdirk54, only: sdirk54_type
    use tandem_stepper_trapezoid, only: trapezoid_type
    implicit none (type, external)
    private

    public :: new_stepper, stepper_choices, stepper_names

contains

    !> Allocate the stepper of a name; left unallocated where the name is unknown.
    subroutine new_stepper(name, stepper)
        !> One of `stepper_choices`.
        character(len=*), intent(in) :: name
        class(stepper_type), allocatable, intent(out) :: stepper

        select case (name)
        case ('rk4')
            allocate (rk4_type :: stepper)
        case ('dopri5')
            allocate (dopri5_type :: stepper)
        case ('dop853')
            allocate (dop853_type :: stepper)
        case ('trapezoid')
            allocate (trapezoid_type :: stepper)
        case ('sdirk54')
            allocate (sdirk54_type :: stepper)
        case ('radau5')
            allocate (radau5_type :: stepper)
        case ('radau')
            allocate (radau_type :: stepper)
        case ('auto')
            allocate (auto_type :: stepper)
        case default
            return
        end select
    end subroutine new_stepper
end module tandem_stepper_factory
