! SPDX-License-Identifier: MIT
!> Handles of the Fortran 77 interface: four default integers that hold the address of a problem and a check word, so that
!> neither a table nor any other global state is needed, and an array that is no handle is noticed.
module tandem_legacy_handle
    use tandem_legacy_problem, only: problem_type
    use tandem_legacy_version, only: interface_version
    use, intrinsic :: iso_c_binding, only: c_f_pointer, c_intptr_t, c_loc, c_null_ptr, c_ptr
    implicit none (type, external)
    private

    public :: handle_length, to_handle, to_problem

    !> Integers in a handle.
    integer, parameter :: handle_length = 4
    !> Mixed into the check word.
    integer, parameter :: seal = 1413630030

contains

    !> The handle of a problem; zeros where there is none.
    subroutine to_handle(problem, handle)
        type(problem_type), pointer, intent(in) :: problem
        integer, intent(out) :: handle(handle_length)
        integer(c_intptr_t) :: address

        handle = 0
        if (.not. associated(problem)) return
        address = transfer(c_loc(problem), address)
        handle(1:2) = transfer(address, handle, 2)
        handle(3) = check_word(handle)
        handle(4) = interface_version
    end subroutine to_handle

    !> The problem of a handle; none where the integers are no handle.
    subroutine to_problem(handle, problem)
        integer, intent(in) :: handle(handle_length)
        type(problem_type), pointer, intent(out) :: problem
        integer(c_intptr_t) :: address

        problem => null()
        if (handle(4) /= interface_version .or. handle(3) /= check_word(handle)) return
        address = transfer(handle(1:2), address)
        call c_f_pointer(transfer(address, c_null_ptr), problem)
    end subroutine to_problem

    pure integer function check_word(handle)
        integer, intent(in) :: handle(handle_length)

        check_word = ieor(ieor(handle(1), ishftc(handle(2), 7)), seal)
    end function check_word
end module tandem_legacy_handle
