! SPDX-License-Identifier: MIT
!> C interface to mechanisms that are described by keys; see `tandem_legacy_c`.
module tandem_legacy_c_mechanism
    use tandem_legacy_c_model, only: c_model_type
    use tandem_legacy_c_text, only: text_of, value_of
    use tandem_legacy_callback_model, only: callback_model_type
    use tandem_legacy_mechanism_keys, only: define_mechanism, get_name, get_reference_state, set_key
    use tandem_legacy_handle, only: find => problem_of, new_handle
    use tandem_legacy_problem, only: problem_type
    use tandem_status, only: status_invalid_option
    use, intrinsic :: iso_c_binding, only: c_char, c_double, c_int, c_null_char, c_null_ptr, c_ptr
    implicit none (type, external)
    private

    public :: c_new_mechanism, c_set_key, c_define, c_get_sizes, c_get_drawing, c_get_name

contains

    !> Create a problem for a mechanism; NULL only if there is no memory for it.
    type(c_ptr) function c_new_mechanism(user_data) bind(C, name='tandem_new_mechanism')
        !> Argument of all functions of events.
        type(c_ptr), value :: user_data
        type(c_model_type), pointer :: model
        class(callback_model_type), pointer :: callbacks
        type(problem_type), pointer :: problem
        integer :: stat

        c_new_mechanism = c_null_ptr
        allocate (model, stat=stat)
        if (stat /= 0) return
        model%by_rows = .true.
        model%user_data = user_data
        callbacks => model
        c_new_mechanism = new_handle(callbacks, 0, 0, 0, stat)
        call find(c_new_mechanism, problem)
        if (associated(problem)) call problem%set_up_mechanism()
    end function c_new_mechanism

    !> Set the value of a key.
    integer(c_int) function c_set_key(handle, key, value) bind(C, name='tandem_set_key')
        type(c_ptr), value :: handle, key, value
        type(problem_type), pointer :: problem

        c_set_key = status_invalid_option
        call find(handle, problem)
        if (.not. associated(problem)) return
        call set_key(problem, text_of(key), value_of(value))
        c_set_key = problem%stat
    end function c_set_key

    !> Build the mechanism from its keys.
    integer(c_int) function c_define(handle, planar, may_be_open, t_start, t_end) bind(C, name='tandem_define')
        type(c_ptr), value :: handle
        integer(c_int), value :: planar, may_be_open
        real(c_double), value :: t_start, t_end
        type(problem_type), pointer :: problem

        c_define = status_invalid_option
        call find(handle, problem)
        if (.not. associated(problem)) return
        call define_mechanism(problem, planar /= 0, may_be_open /= 0, [t_start, t_end])
        c_define = problem%stat
    end function c_define

    !> Return the numbers of coordinates and constraints; zeros before the mechanism is built.
    integer(c_int) function c_get_sizes(handle, n, n_holonomic, n_nonholonomic) bind(C, name='tandem_get_sizes')
        type(c_ptr), value :: handle
        integer(c_int), intent(inout), optional :: n, n_holonomic, n_nonholonomic
        type(problem_type), pointer :: problem

        c_get_sizes = status_invalid_option
        call find(handle, problem)
        if (.not. associated(problem)) return
        if (problem%is_free()) then
            if (present(n)) n = problem%callbacks%n
            if (present(n_holonomic)) n_holonomic = problem%callbacks%n_holonomic
            if (present(n_nonholonomic)) n_nonholonomic = problem%callbacks%n_nonholonomic
            call problem%succeed()
        end if
        c_get_sizes = problem%stat
    end function c_get_sizes

    !> Return the state of the reference configuration.
    integer(c_int) function c_get_drawing(handle, q, qd) bind(C, name='tandem_get_drawing')
        type(c_ptr), value :: handle
        !> Coordinates and velocities (n).
        real(c_double), intent(inout), optional :: q(*), qd(*)
        type(problem_type), pointer :: problem

        c_get_drawing = status_invalid_option
        call find(handle, problem)
        if (.not. associated(problem)) return
        if (present(q) .and. present(qd)) then
            call get_reference_state(problem, q, qd)
        else
            call problem%refuse('q or qd is NULL', 'pass arrays of n numbers')
        end if
        c_get_drawing = problem%stat
    end function c_get_drawing

    !> Return the name or the unit of a coordinate, or the name of a row.
    integer(c_int) function c_get_name(handle, what, index, capacity, text) bind(C, name='tandem_get_name')
        type(c_ptr), value :: handle, what
        !> Index from 0; size of the buffer, including the terminating NUL.
        integer(c_int), value :: index, capacity
        character(kind=c_char), intent(inout), optional :: text(*)
        type(problem_type), pointer :: problem
        character(len=:), allocatable :: name
        integer :: i, length

        c_get_name = status_invalid_option
        call find(handle, problem)
        if (.not. associated(problem)) return
        if (present(text) .and. capacity > 0) then
            call get_name(problem, text_of(what), min(index, huge(index) - 1) + 1, name)
            length = min(len(name), capacity - 1)
            do i = 1, length
                text(i) = name(i:i)
            end do
            text(length + 1) = c_null_char
        else
            call problem%refuse('text is NULL, or its capacity is not positive', 'pass an array and its capacity')
        end if
        c_get_name = problem%stat
    end function c_get_name
end module tandem_legacy_c_mechanism
