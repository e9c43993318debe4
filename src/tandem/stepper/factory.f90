! SPDX-License-Identifier: MIT
!> Steppers by name.
module tandem_stepper_factory
    use tandem_error, only: error_type, set_error
    use tandem_status, only: status_invalid_option
    use tandem_stepper, only: stepper_type
    use tandem_stepper_dop853, only: dop853_type
    use tandem_stepper_dopri5, only: dopri5_type
    use tandem_stepper_radau5, only: radau5_type
    use tandem_stepper_rk4, only: rk4_type
    use tandem_stepper_sdirk54, only: sdirk54_type
    use tandem_stepper_trapezoid, only: trapezoid_type
    implicit none (type, external)
    private

    public :: check_stepper, new_stepper, stepper_names

    !> Every name that `new_stepper` knows.
    character(len=16), parameter :: stepper_names(6) = [character(len=16) :: 'rk4', 'dopri5', 'dop853', 'trapezoid', 'sdirk54', &
        'radau5']

contains

    !> Allocate the stepper of a name; left unallocated where the name is unknown.
    subroutine new_stepper(name, stepper)
        !> One of `stepper_names`.
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
        case default
            return
        end select
    end subroutine new_stepper

    !> Refuse a name that `new_stepper` does not know.
    subroutine check_stepper(name, error)
        character(len=*), intent(in) :: name
        !> invalid_option with the names that there are.
        type(error_type), allocatable, intent(out) :: error

        if (any(stepper_names == name)) return
        call set_error(error, status_invalid_option, 'stepper = "'//trim(name)//'" is unknown', &
            'use '//names_in_a_row(stepper_names))
    end subroutine check_stepper

    !> Names joined by commas.
    pure function names_in_a_row(names) result(text)
        character(len=*), intent(in) :: names(:)
        character(len=sum(len_trim(names)) + 2*(size(names) - 1)) :: text
        integer :: i

        text = names(1)
        do i = 2, size(names)
            text = trim(text)//', '//names(i)
        end do
    end function names_in_a_row
end module tandem_stepper_factory
