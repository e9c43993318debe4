! SPDX-License-Identifier: MIT
!> Explicit method of Dormand and Prince of order 5 with an embedded method of order 4 and 6 stages. The rate at the end of a step
!> is the first stage of the next one.
!> Source: J. R. Dormand, P. J. Prince, J. Comp. Appl. Math. 6 (1980) 19-26; Hairer, Norsett, Wanner, Solving Ordinary
!> Differential Equations I, table II.5.2.
module tandem_stepper_dopri5
    use tandem_kinds, only: wp
    use tandem_stepper, only: properties_type
    use tandem_stepper_explicit, only: explicit_type
    implicit none (type, external)
    private

    public :: dopri5_type

    !> The method of order 5.
    type, extends(explicit_type) :: dopri5_type
    contains
        procedure, nopass :: properties
        procedure :: set_tableau
    end type dopri5_type

contains

    !> Properties of the method.
    pure function properties() result(properties_)
        type(properties_type) :: properties_

        properties_ = properties_type('dopri5', 5, 6, .false., 4, 'conditional (|h lambda| < 3.3)', &
            'Dormand, Prince 1980; Hairer, Norsett, Wanner I, table II.5.2', stability_limit=3.25_wp)
    end function properties

    !> Set the tableau.
    subroutine set_tableau(self)
        class(dopri5_type), intent(inout) :: self

        self%c = [0.0_wp, 1.0_wp/5, 3.0_wp/10, 4.0_wp/5, 8.0_wp/9, 1.0_wp]
        self%b = [35.0_wp/384, 0.0_wp, 500.0_wp/1113, 125.0_wp/192, -2187.0_wp/6784, 11.0_wp/84]
        if (allocated(self%a)) deallocate (self%a, self%e)
        allocate (self%a(6, 6), self%e(7, 1), source=0.0_wp)
        self%a(:1, 2) = [1.0_wp/5]
        self%a(:2, 3) = [3.0_wp/40, 9.0_wp/40]
        self%a(:3, 4) = [44.0_wp/45, -56.0_wp/15, 32.0_wp/9]
        self%a(:4, 5) = [19372.0_wp/6561, -25360.0_wp/2187, 64448.0_wp/6561, -212.0_wp/729]
        self%a(:5, 6) = [9017.0_wp/3168, -355.0_wp/33, 46732.0_wp/5247, 49.0_wp/176, -5103.0_wp/18656]
        self%e(:, 1) = [71.0_wp/57600, 0.0_wp, -71.0_wp/16695, 71.0_wp/1920, -17253.0_wp/339200, 22.0_wp/525, -1.0_wp/40]
    end subroutine set_tableau
end module tandem_stepper_dopri5
