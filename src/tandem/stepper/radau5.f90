! SPDX-License-Identifier: MIT
!> Radau IIA, 3 stages: order 5, stage order 3, L-stable, stiffly accurate.
!> Source: Hairer, Wanner, Solving Ordinary Differential Equations II, 2nd ed., sections IV.5 and IV.8.
module tandem_stepper_radau5
    use tandem_kinds, only: wp
    use tandem_stepper, only: properties_type
    use tandem_stepper_radau, only: radau_type
    implicit none (type, external)
    private

    public :: radau5_type

    !> The method of order 5.
    type, extends(radau_type) :: radau5_type
    contains
        procedure, nopass :: properties
        procedure :: initialize
    end type radau5_type

contains

    !> Properties of the method.
    pure function properties() result(properties_)
        type(properties_type) :: properties_

        properties_ = properties_type('radau5', 5, 3, .true., 3, 'L-stable, stiffly accurate', &
            'Hairer, Wanner II, sections IV.5, IV.8', dense_order=3, damps=.true., is_predictive=.true.)
    end function properties

    !> Allocate the work space.
    subroutine initialize(self, scale, newton_tolerance)
        class(radau5_type), intent(inout) :: self
        real(wp), intent(in) :: scale(:), newton_tolerance

        self%least = 3
        self%most = 3
        call self%radau_type%initialize(scale, newton_tolerance)
    end subroutine initialize
end module tandem_stepper_radau5
