! SPDX-License-Identifier: MIT
!> The classical Runge-Kutta method: order 4, 4 stages, explicit, no error estimate.
!> Source: W. Kutta, 1901; Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, table II.1.2.
module tandem_stepper_rk4
    use tandem_kinds, only: wp
    use tandem_stepper, only: properties_type
    use tandem_stepper_explicit, only: explicit_type
    implicit none (type, external)
    private

    public :: rk4_type

    !> The classical method of order 4.
    type, extends(explicit_type) :: rk4_type
    contains
        procedure, nopass :: properties
        procedure :: set_tableau
    end type rk4_type

contains

    !> Properties of the method.
    pure function properties() result(properties_)
        type(properties_type) :: properties_

        properties_ = properties_type('rk4', 4, 4, .false., 0, 'conditional (|h lambda| < 2.8)', &
            'W. Kutta 1901; Hairer, Norsett, Wanner I, table II.1.2', stability_limit=2.5_wp)
    end function properties

    !> Set the tableau.
    subroutine set_tableau(self)
        class(rk4_type), intent(inout) :: self

        self%c = [0.0_wp, 0.5_wp, 0.5_wp, 1.0_wp]
        self%b = [1.0_wp, 2.0_wp, 2.0_wp, 1.0_wp]/6.0_wp
        if (allocated(self%a)) deallocate (self%a)
        allocate (self%a(4, 4), source=0.0_wp)
        self%a(1, 2) = 0.5_wp
        self%a(2, 3) = 0.5_wp
        self%a(3, 4) = 1.0_wp
    end subroutine set_tableau
end module tandem_stepper_rk4
