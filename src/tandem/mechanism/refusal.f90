! SPDX-License-Identifier: MIT
!> Checks of arguments of builder procedures, and the errors for invalid ones.
module tandem_mechanism_refusal
    use tandem_error, only: error_type, set_error, to_text
    use tandem_kinds, only: wp
    use tandem_mechanism_vector, only: in_space
    use tandem_status, only: status_invalid_model
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)
    private

    public :: refuse, take_vector

contains

    !> Set an error with its remedy.
    subroutine refuse(problem, advice, error)
        character(len=*), intent(in) :: problem, advice
        type(error_type), allocatable, intent(inout) :: error

        call set_error(error, status_invalid_model, problem, advice)
    end subroutine refuse

    !> Check a vector argument with two components in the plane or three in space, and return it with three components.
    subroutine take_vector(planar, label, what, given, vector, error)
        logical, intent(in) :: planar
        character(len=*), intent(in) :: label, what
        real(wp), intent(in) :: given(:)
        real(wp), intent(inout) :: vector(3)
        type(error_type), allocatable, intent(inout) :: error

        if (size(given) /= merge(2, 3, planar)) then
            call refuse(label//': '//what//' has '//to_text(size(given))//' entries', &
                'give two in the plane, three in space', error)
        else if (.not. all(ieee_is_finite(given))) then
            call refuse(label//': '//what//' is not finite', 'correct it', error)
        else
            vector = in_space(given)
        end if
    end subroutine take_vector
end module tandem_mechanism_refusal
