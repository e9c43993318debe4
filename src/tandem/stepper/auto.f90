! SPDX-License-Identifier: MIT
!> dop853 with automatic change to an implicit method for steps in which that method is cheaper. This module defines the explicit
!> part; `tandem_simulate_switching` decides, and the simulation exchanges steppers between steps.
module tandem_stepper_auto
    use tandem_stepper, only: properties_type
    use tandem_stepper_dop853, only: dop853_type, properties_of_dop853 => properties
    implicit none (type, external)
    private

    public :: auto_type

    !> dop853 with an implicit partner.
    type, extends(dop853_type) :: auto_type
    contains
        procedure, nopass :: properties
    end type auto_type

contains

    !> Properties of the method while steps are explicit.
    pure function properties() result(properties_)
        type(properties_type) :: properties_

        properties_ = properties_of_dop853()
        properties_%name = 'auto'
        properties_%stability = 'dop853, or radau5 where that is cheaper'
        properties_%partner = 'radau5'
    end function properties
end module tandem_stepper_auto
