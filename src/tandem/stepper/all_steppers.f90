! SPDX-License-Identifier: MIT
!> List of all steppers; new ones are added here.
submodule(tandem_stepper_factory) tandem_stepper_all
    use tandem_stepper_auto, only: auto_type
    use tandem_stepper_dop853, only: dop853_type
    use tandem_stepper_dopri5, only: dopri5_type
    use tandem_stepper_radau, only: radau_type
    use tandem_stepper_radau5, only: radau5_type
    use tandem_stepper_rk4, only: rk4_type
    use tandem_stepper_sdirk54, only: sdirk54_type
    use tandem_stepper_trapezoid, only: trapezoid_type
    implicit none (type, external)

contains

    module procedure new_stepper
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
    end procedure new_stepper
end submodule tandem_stepper_all
