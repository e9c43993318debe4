! SPDX-License-Identifier: MIT
!> A handle is the address of a tag that points to a problem. The tag remains when the problem is freed, so that a freed handle and
!> its copies are recognised as invalid. A tag takes sixteen bytes, which are freed at the end of the program. Threads share no
!> table or other state.
!>
!> A Fortran 77 handle consists of four default integers: the address and a check word, by which other arrays are recognised as
!> invalid.
module tandem_legacy_handle
    use tandem_legacy_callback_model, only: callback_model_type
    use tandem_legacy_problem, only: problem_type
    use tandem_legacy_version, only: interface_version
    use tandem_status, only: status_invalid_model
    use, intrinsic :: iso_c_binding, only: c_associated, c_f_pointer, c_funloc, c_funptr, c_int, c_intptr_t, c_loc, &
        c_null_ptr, c_ptr
    implicit none (type, external)
    private

    public :: handle_length, new_handle, free_handle, problem_of, to_handle, to_address

    !> Number of integers in a Fortran 77 handle.
    integer, parameter :: handle_length = 4
    !> Constant of the check word.
    integer, parameter :: seal = 1413630030

    !> Target of the address in a handle.
    type :: tag_type
        !> Null once the problem has been freed.
        type(problem_type), pointer :: problem => null()
        !> Address of the tag, which identifies it: other memory is very unlikely to contain its own address.
        integer(c_intptr_t) :: address = 0
    end type tag_type

    interface
        !> free() of the C library.
        subroutine c_free_memory(address) bind(C, name='free')
            import :: c_ptr
            implicit none (type, external)
            type(c_ptr), value :: address
        end subroutine c_free_memory

        !> Register a function to be called with an argument at the end of the program, in reverse order of registration.
        !> Thread-safe. Part of the C++ ABI, which every C library provides.
        integer(c_int) function at_exit(function_, argument, library) bind(C, name='__cxa_atexit')
            import :: c_funptr, c_int, c_ptr
            implicit none (type, external)
            type(c_funptr), value :: function_
            type(c_ptr), value :: argument, library
        end function at_exit
    end interface

contains

    !> Create a problem for a model without procedures, and its handle. Null if there is no memory for them; the model is then
    !> freed.
    type(c_ptr) function new_handle(model, n, n_holonomic, n_nonholonomic, stat)
        !> Model. The problem becomes the owner of the pointer.
        class(callback_model_type), pointer, intent(inout) :: model
        !> Numbers of coordinates, holonomic and nonholonomic constraints.
        integer, intent(in) :: n, n_holonomic, n_nonholonomic
        !> Status of the check of the sizes.
        integer, intent(out) :: stat
        type(tag_type), pointer :: tag

        new_handle = c_null_ptr
        allocate (tag, stat=stat)
        if (stat == 0) then
            allocate (tag%problem, stat=stat)
            if (stat /= 0) deallocate (tag)
        end if
        if (stat /= 0) then
            stat = status_invalid_model
            deallocate (model)
            return
        end if
        call tag%problem%set_up(model, n, n_holonomic, n_nonholonomic)
        stat = tag%problem%stat
        new_handle = c_loc(tag)
        tag%address = transfer(new_handle, tag%address)
    end function new_handle

    !> Problem of a handle; null for a null handle or a freed one.
    subroutine problem_of(handle, problem)
        type(c_ptr), intent(in) :: handle
        type(problem_type), pointer, intent(out) :: problem
        type(tag_type), pointer :: tag

        problem => null()
        if (.not. c_associated(handle)) return
        call c_f_pointer(handle, tag)
        if (tag%address == transfer(handle, tag%address)) problem => tag%problem
    end subroutine problem_of

    !> Free the problem of a handle. False, with a status in the problem, if called from one of its procedures.
    logical function free_handle(handle)
        !> Handle of a problem.
        type(c_ptr), intent(in) :: handle
        type(tag_type), pointer :: tag
        integer(c_int) :: stat

        call c_f_pointer(handle, tag)
        free_handle = tag%problem%release()
        if (.not. free_handle) return
        deallocate (tag%problem)
        ! If registration fails, the tag is not freed at the end of the program.
        stat = at_exit(c_funloc(c_free_memory), handle, c_null_ptr)
    end function free_handle

    !> Convert an address to the four integers of a handle; zeros for a null address.
    pure subroutine to_handle(address, handle)
        type(c_ptr), intent(in) :: address
        integer, intent(out) :: handle(handle_length)

        handle = 0
        if (transfer(address, 0_c_intptr_t) == 0) return
        handle(1:2) = transfer(address, handle, 2)
        handle(3) = check_word(handle)
        handle(4) = interface_version
    end subroutine to_handle

    !> Address in a Fortran 77 handle; null for an invalid handle.
    pure type(c_ptr) function to_address(handle)
        integer, intent(in) :: handle(handle_length)

        to_address = c_null_ptr
        if (handle(4) == interface_version .and. handle(3) == check_word(handle)) to_address = transfer(handle(1:2), to_address)
    end function to_address

    pure integer function check_word(handle)
        integer, intent(in) :: handle(handle_length)

        check_word = ieor(ieor(handle(1), ishftc(handle(2), 7)), seal)
    end function check_word
end module tandem_legacy_handle
