! SPDX-License-Identifier: MIT
!> The C interface. `include/tandem.h` declares and documents these functions. The Fortran procedures check pointers, convert texts,
!> and call the procedures of the problem. Every function returns the status of the problem.
module tandem_legacy_c
    use tandem_error, only: to_text
    use tandem_kinds, only: long, wp
    use tandem_legacy_c_model, only: c_model_type
    use tandem_legacy_callback_model, only: callback_model_type
    use tandem_legacy_handle, only: find => problem_of, free_handle, new_handle
    use tandem_legacy_description, only: message_of_no_problem
    use tandem_legacy_problem, only: problem_type
    use tandem_legacy_c_text, only: text_of
    use tandem_legacy_terms, only: of_direction, of_motion, of_position
    use tandem_legacy_version, only: interface_version
    use tandem_status, only: status_invalid_option
    use, intrinsic :: iso_c_binding, only: c_associated, c_char, c_double, c_f_pointer, c_funptr, c_int, c_int64_t, c_loc, &
        c_null_char, c_null_ptr, c_ptr
    implicit none (type, external)
    private

    public :: c_interface_version, c_new, c_free, c_message
    public :: c_set_position_function, c_set_motion_function, c_set_direction_function, c_set_evaluate
    public :: c_set_real, c_set_integer, c_set_text, c_set_vector, c_set_row_name
    public :: c_add_event, c_add_event_function, c_clear_events, c_count_events, c_get_event, c_get_stop
    public :: c_check, c_assemble, c_start, c_integrate, c_step, c_advance, c_watch_error, c_estimate_error
    public :: c_get_state, c_get_state_at, c_get_multipliers, c_get_energies, c_get_statistic
    public :: c_count_warnings, c_get_warning, c_get_segment, c_save_state, c_restore_state

    !> Result of `tandem_message` if there is no problem. It is never modified.
    character(kind=c_char), target :: no_problem(len(message_of_no_problem) + 1) = &
        transfer(message_of_no_problem//c_null_char, [c_null_char])

contains

    !> The version of the library's interface.
    integer(c_int) function c_interface_version() bind(C, name='tandem_interface_version')
        c_interface_version = interface_version
    end function c_interface_version

    !> Create a problem; NULL only if there is no memory for it. The message states whether the sizes are valid.
    type(c_ptr) function c_new(n, n_holonomic, n_nonholonomic, user_data) bind(C, name='tandem_new')
        !> Numbers of coordinates, holonomic and nonholonomic constraints.
        integer(c_int), value :: n, n_holonomic, n_nonholonomic
        !> Argument of all functions of the model.
        type(c_ptr), value :: user_data
        type(c_model_type), pointer :: model
        class(callback_model_type), pointer :: callback_model
        integer :: stat

        c_new = c_null_ptr
        allocate (model, stat=stat)
        if (stat /= 0) return
        model%by_rows = .true.
        model%user_data = user_data
        callback_model => model
        c_new = new_handle(callback_model, n, n_holonomic, n_nonholonomic, stat)
    end function c_new

    !> Free a problem; NULL is allowed.
    subroutine c_free(handle) bind(C, name='tandem_free')
        type(c_ptr), value :: handle
        type(problem_type), pointer :: problem

        call find(handle, problem)
        if (.not. associated(problem)) return
        if (free_handle(handle)) problem => null()
    end subroutine c_free

    !> Message of the last call. Its address never changes.
    type(c_ptr) function c_message(handle) bind(C, name='tandem_message')
        type(c_ptr), value :: handle
        type(problem_type), pointer :: problem

        call find(handle, problem)
        c_message = c_loc(no_problem)
        if (associated(problem)) c_message = c_loc(problem%message)
    end function c_message

    !> Set a function of (t, q).
    integer(c_int) function c_set_position_function(handle, name, function_) bind(C, name='tandem_set_position_function')
        type(c_ptr), value :: handle, name
        type(c_funptr), value :: function_
        type(problem_type), pointer :: problem

        if (.not. found(handle, problem, c_set_position_function)) return
        call problem%set_procedure(text_of(name), of_position, function_)
        c_set_position_function = problem%stat
    end function c_set_position_function

    !> Set a function of (t, q, qd).
    integer(c_int) function c_set_motion_function(handle, name, function_) bind(C, name='tandem_set_motion_function')
        type(c_ptr), value :: handle, name
        type(c_funptr), value :: function_
        type(problem_type), pointer :: problem

        if (.not. found(handle, problem, c_set_motion_function)) return
        call problem%set_procedure(text_of(name), of_motion, function_)
        c_set_motion_function = problem%stat
    end function c_set_motion_function

    !> Set a function of (t, q, x).
    integer(c_int) function c_set_direction_function(handle, name, function_) bind(C, name='tandem_set_direction_function')
        type(c_ptr), value :: handle, name
        type(c_funptr), value :: function_
        type(problem_type), pointer :: problem

        if (.not. found(handle, problem, c_set_direction_function)) return
        call problem%set_procedure(text_of(name), of_direction, function_)
        c_set_direction_function = problem%stat
    end function c_set_direction_function

    !> Set a function of several terms.
    integer(c_int) function c_set_evaluate(handle, function_, provides) bind(C, name='tandem_set_evaluate')
        type(c_ptr), value :: handle
        type(c_funptr), value :: function_
        !> Sum of the constants of the terms that the function provides.
        integer(c_int), value :: provides
        type(problem_type), pointer :: problem

        if (.not. found(handle, problem, c_set_evaluate)) return
        call problem%set_evaluate(function_, provides)
        c_set_evaluate = problem%stat
    end function c_set_evaluate

    !> Set a real option.
    integer(c_int) function c_set_real(handle, name, value) bind(C, name='tandem_set_real')
        type(c_ptr), value :: handle, name
        real(c_double), value :: value
        type(problem_type), pointer :: problem

        if (.not. found(handle, problem, c_set_real)) return
        call problem%set(text_of(name), number=value)
        c_set_real = problem%stat
    end function c_set_real

    !> Set an integer option.
    integer(c_int) function c_set_integer(handle, name, value) bind(C, name='tandem_set_integer')
        type(c_ptr), value :: handle, name
        integer(c_int), value :: value
        type(problem_type), pointer :: problem

        if (.not. found(handle, problem, c_set_integer)) return
        call problem%set(text_of(name), whole=value)
        c_set_integer = problem%stat
    end function c_set_integer

    !> Set an option whose value is a word.
    integer(c_int) function c_set_text(handle, name, value) bind(C, name='tandem_set_text')
        type(c_ptr), value :: handle, name, value
        type(problem_type), pointer :: problem

        if (.not. found(handle, problem, c_set_text)) return
        if (c_associated(value)) then
            call problem%set(text_of(name), word=text_of(value))
        else
            call problem%refuse('the word for "'//text_of(name)//'" is NULL', 'pass one of its values')
        end if
        c_set_text = problem%stat
    end function c_set_text

    !> Set a list of numbers.
    integer(c_int) function c_set_vector(handle, name, count, values) bind(C, name='tandem_set_vector')
        type(c_ptr), value :: handle, name
        !> Number of values.
        integer(c_int), value :: count
        type(c_ptr), value :: values
        type(problem_type), pointer :: problem
        real(wp), pointer :: list(:)
        real(wp), target :: nothing(1)

        if (.not. found(handle, problem, c_set_vector)) return
        if (count < 0 .or. (count > 0 .and. .not. c_associated(values))) then
            call problem%refuse('the list "'//text_of(name)//'" is NULL or has a negative number of entries', &
                'pass the numbers and their count')
        else
            ! gfortran treats an argument with a null address as absent, so that an empty list needs an address too.
            list => nothing(:0)
            if (count > 0) call c_f_pointer(values, list, [count])
            call problem%set_vector(text_of(name), list)
        end if
        c_set_vector = problem%stat
    end function c_set_vector

    !> Name a constraint row.
    integer(c_int) function c_set_row_name(handle, row, name) bind(C, name='tandem_set_row_name')
        type(c_ptr), value :: handle
        !> Index from 0, holonomic rows first.
        integer(c_int), value :: row
        type(c_ptr), value :: name
        type(problem_type), pointer :: problem

        if (.not. found(handle, problem, c_set_row_name)) return
        call problem%set_row_name(min(row, huge(row) - 1) + 1, text_of(name))
        c_set_row_name = problem%stat
    end function c_set_row_name

    !> Add an event at which a coordinate, a velocity or a multiplier reaches a value.
    integer(c_int) function c_add_event(handle, name, quantity, index, value, direction, stops) bind(C, name='tandem_add_event')
        type(c_ptr), value :: handle, name, quantity
        !> Index from 0.
        integer(c_int), value :: index
        real(c_double), value :: value
        !> The direction is +1 rising through the value, -1 falling, 0 both. Nonzero `stops`: the run ends at the event.
        integer(c_int), value :: direction, stops
        type(problem_type), pointer :: problem

        if (.not. found(handle, problem, c_add_event)) return
        call problem%add_event(text_of(name), direction, stops, text_of(quantity), min(index, huge(index) - 1) + 1, value)
        c_add_event = problem%stat
    end function c_add_event

    !> Add an event at zeros of a function of (t, q, qd).
    integer(c_int) function c_add_event_function(handle, name, function_, direction, stops) &
        bind(C, name='tandem_add_event_function')
        type(c_ptr), value :: handle, name
        type(c_funptr), value :: function_
        !> The direction is +1 rising through zero, -1 falling, 0 both. Nonzero `stops`: the run ends at the event.
        integer(c_int), value :: direction, stops
        type(problem_type), pointer :: problem

        if (.not. found(handle, problem, c_add_event_function)) return
        call problem%add_event(text_of(name), direction, stops, function_=function_)
        c_add_event_function = problem%stat
    end function c_add_event_function

    !> Remove all events. Takes effect at the next start.
    integer(c_int) function c_clear_events(handle) bind(C, name='tandem_clear_events')
        type(c_ptr), value :: handle
        type(problem_type), pointer :: problem

        if (.not. found(handle, problem, c_clear_events)) return
        call problem%clear_events()
        c_clear_events = problem%stat
    end function c_clear_events

    !> Return the number of recorded events.
    integer(c_int) function c_count_events(handle, count) bind(C, name='tandem_count_events')
        type(c_ptr), value :: handle
        integer(c_int), intent(out), optional :: count
        type(problem_type), pointer :: problem
        integer :: n

        if (present(count)) count = 0
        if (.not. found(handle, problem, c_count_events)) return
        call problem%count_events(n)
        if (present(count)) count = n
        c_count_events = problem%stat
    end function c_count_events

    !> Return one of the recorded events.
    integer(c_int) function c_get_event(handle, index, event, direction, t, q, qd) bind(C, name='tandem_get_event')
        type(c_ptr), value :: handle
        !> Index from 0, in the order of time.
        integer(c_int), value :: index
        !> Index of the event from 0, and the direction in which its function passed through zero.
        integer(c_int), intent(out), optional :: event, direction
        real(c_double), intent(out), optional :: t
        real(c_double), intent(inout), optional :: q(*), qd(*)
        type(problem_type), pointer :: problem
        integer :: numbers(2)
        real(wp) :: time

        if (.not. found(handle, problem, c_get_event)) return
        call problem%get_event(min(index, huge(index) - 1) + 1, numbers(1), numbers(2), time, q, qd)
        if (present(event)) event = numbers(1) - 1
        if (present(direction)) direction = numbers(2)
        if (present(t)) t = time
        c_get_event = problem%stat
    end function c_get_event

    !> Return the index of the event that has stopped the run.
    integer(c_int) function c_get_stop(handle, event) bind(C, name='tandem_get_stop')
        type(c_ptr), value :: handle
        !> Index from 0; -1 if no event has stopped the run.
        integer(c_int), intent(out), optional :: event
        type(problem_type), pointer :: problem
        integer :: number

        if (present(event)) event = -1
        if (.not. found(handle, problem, c_get_stop)) return
        call problem%get_stop(number)
        if (present(event)) event = number - 1
        c_get_stop = problem%stat
    end function c_get_stop

    !> Record the run from its start to t_end, for an estimate of its error.
    integer(c_int) function c_watch_error(handle, t_end) bind(C, name='tandem_watch_error')
        type(c_ptr), value :: handle
        real(c_double), value :: t_end
        type(problem_type), pointer :: problem

        if (.not. found(handle, problem, c_watch_error)) return
        call problem%watch_error(t_end)
        c_watch_error = problem%stat
    end function c_watch_error

    !> Estimate the error of the recorded run by a second run.
    integer(c_int) function c_estimate_error(handle) bind(C, name='tandem_estimate_error')
        type(c_ptr), value :: handle
        type(problem_type), pointer :: problem

        if (.not. found(handle, problem, c_estimate_error)) return
        call problem%estimate_error()
        c_estimate_error = problem%stat
    end function c_estimate_error

    !> Compare the functions of the model with differences of each other.
    integer(c_int) function c_check(handle, t, q, qd) bind(C, name='tandem_check')
        type(c_ptr), value :: handle
        real(c_double), value :: t
        !> Coordinates and velocities (n).
        real(c_double), intent(in), optional :: q(*), qd(*)
        type(problem_type), pointer :: problem

        if (.not. found(handle, problem, c_check)) return
        if (present(q) .and. present(qd)) then
            call problem%check(t, q, qd)
        else
            call problem%refuse('q or qd is NULL', 'pass the state at which to compare')
        end if
        c_check = problem%stat
    end function c_check

    !> Move a state to the nearest one that satisfies the constraints.
    integer(c_int) function c_assemble(handle, t, q, qd) bind(C, name='tandem_assemble')
        type(c_ptr), value :: handle
        real(c_double), value :: t
        !> Coordinates and velocities (n).
        real(c_double), intent(inout), optional :: q(*), qd(*)
        type(problem_type), pointer :: problem

        if (.not. found(handle, problem, c_assemble)) return
        if (present(q) .and. present(qd)) then
            call problem%assemble(t, q, qd)
        else
            call problem%refuse('q or qd is NULL', 'pass a state near the start')
        end if
        c_assemble = problem%stat
    end function c_assemble

    !> Start a run.
    integer(c_int) function c_start(handle, t, q, qd) bind(C, name='tandem_start')
        type(c_ptr), value :: handle
        real(c_double), value :: t
        !> Coordinates and velocities (n).
        real(c_double), intent(in), optional :: q(*), qd(*)
        type(problem_type), pointer :: problem

        if (.not. found(handle, problem, c_start)) return
        if (present(q) .and. present(qd)) then
            call problem%start(t, q, qd)
        else
            call problem%refuse('q or qd is NULL', 'pass the start')
        end if
        c_start = problem%stat
    end function c_start

    !> Integrate to t_end, which may be the current time.
    integer(c_int) function c_integrate(handle, t_end) bind(C, name='tandem_integrate')
        type(c_ptr), value :: handle
        real(c_double), value :: t_end
        type(problem_type), pointer :: problem

        if (.not. found(handle, problem, c_integrate)) return
        call problem%integrate(t_end)
        c_integrate = problem%stat
    end function c_integrate

    !> Perform one accepted step that does not go beyond t_limit.
    integer(c_int) function c_step(handle, t_limit) bind(C, name='tandem_step')
        type(c_ptr), value :: handle
        real(c_double), value :: t_limit
        type(problem_type), pointer :: problem

        if (.not. found(handle, problem, c_step)) return
        call problem%step(t_limit)
        c_step = problem%stat
    end function c_step

    !> Perform accepted steps, and store the states at times that they pass.
    integer(c_int) function c_advance(handle, t_end, max_steps, capacity, at_steps, times, q, qd, qdd, rows) &
        bind(C, name='tandem_advance')
        type(c_ptr), value :: handle
        real(c_double), value :: t_end
        !> Largest number of steps; number of rows for which there is space; nonzero `at_steps`: store a row for each step, and its
        !> time.
        integer(c_int), value :: max_steps, capacity, at_steps
        !> Times (capacity); rows of coordinates, velocities and accelerations (n each).
        real(c_double), intent(inout), optional :: times(*), q(*), qd(*), qdd(*)
        integer(c_int), intent(out), optional :: rows
        type(problem_type), pointer :: problem
        integer :: filled

        if (present(rows)) rows = 0
        if (.not. found(handle, problem, c_advance)) return
        if (capacity < 0 .or. (capacity > 0 .and. .not. present(times))) then
            call problem%refuse('times is NULL, or their number is negative', 'pass an array and its number of rows')
        else
            filled = capacity
            call problem%advance(t_end, max_steps, at_steps /= 0, filled, times, q, qd, qdd)
            if (present(rows)) rows = filled
        end if
        c_advance = problem%stat
    end function c_advance

    !> Return the current state.
    integer(c_int) function c_get_state(handle, t, q, qd, qdd) bind(C, name='tandem_get_state')
        type(c_ptr), value :: handle
        real(c_double), intent(out), optional :: t
        real(c_double), intent(inout), optional :: q(*), qd(*), qdd(*)
        type(problem_type), pointer :: problem

        if (.not. found(handle, problem, c_get_state)) return
        call problem%get_state(t, q, qd, qdd)
        c_get_state = problem%stat
    end function c_get_state

    !> Return the state at a time within the last step.
    integer(c_int) function c_get_state_at(handle, t, q, qd, qdd) bind(C, name='tandem_get_state_at')
        type(c_ptr), value :: handle
        real(c_double), value :: t
        real(c_double), intent(inout), optional :: q(*), qd(*), qdd(*)
        type(problem_type), pointer :: problem

        if (.not. found(handle, problem, c_get_state_at)) return
        call problem%get_state_at(t, q, qd, qdd)
        c_get_state_at = problem%stat
    end function c_get_state_at

    !> Return the multipliers at a time within the last step.
    integer(c_int) function c_get_multipliers(handle, t, lambda) bind(C, name='tandem_get_multipliers')
        type(c_ptr), value :: handle
        real(c_double), value :: t
        !> Multipliers (nh + nd).
        real(c_double), intent(inout), optional :: lambda(*)
        type(problem_type), pointer :: problem

        if (.not. found(handle, problem, c_get_multipliers)) return
        if (present(lambda)) then
            call problem%get_multipliers(t, lambda)
        else
            call problem%refuse('lambda is NULL', 'pass an array')
        end if
        c_get_multipliers = problem%stat
    end function c_get_multipliers

    !> Return the kinetic and the potential energy.
    integer(c_int) function c_get_energies(handle, kinetic, potential) bind(C, name='tandem_get_energies')
        type(c_ptr), value :: handle
        real(c_double), intent(out), optional :: kinetic, potential
        type(problem_type), pointer :: problem
        real(wp) :: energies(2)

        if (.not. found(handle, problem, c_get_energies)) return
        call problem%get_energies(energies(1), energies(2))
        if (present(kinetic)) kinetic = energies(1)
        if (present(potential)) potential = energies(2)
        c_get_energies = problem%stat
    end function c_get_energies

    !> Return one statistic of the run.
    integer(c_int) function c_get_statistic(handle, name, value) bind(C, name='tandem_get_statistic')
        type(c_ptr), value :: handle, name
        real(c_double), intent(out), optional :: value
        type(problem_type), pointer :: problem
        real(wp) :: figure

        if (.not. found(handle, problem, c_get_statistic)) return
        call problem%get_statistic(text_of(name), figure)
        if (present(value)) value = figure
        c_get_statistic = problem%stat
    end function c_get_statistic

    !> Return the number of warnings of the run.
    integer(c_int) function c_count_warnings(handle, count) bind(C, name='tandem_count_warnings')
        type(c_ptr), value :: handle
        integer(c_int), intent(out), optional :: count
        type(problem_type), pointer :: problem
        integer :: n

        if (present(count)) count = 0
        if (.not. found(handle, problem, c_count_warnings)) return
        call problem%count_warnings(n)
        if (present(count)) count = n
        c_count_warnings = problem%stat
    end function c_count_warnings

    !> Return one of the warnings, truncated to the available length.
    integer(c_int) function c_get_warning(handle, index, capacity, text) bind(C, name='tandem_get_warning')
        type(c_ptr), value :: handle
        !> Index from 0; size of the buffer, including the terminating NUL.
        integer(c_int), value :: index, capacity
        character(kind=c_char), intent(inout), optional :: text(*)
        type(problem_type), pointer :: problem
        character(len=:), allocatable :: warning
        integer :: i, length

        if (.not. found(handle, problem, c_get_warning)) return
        if (present(text) .and. capacity > 0) then
            call problem%get_warning(min(index, huge(index) - 1) + 1, warning)
            length = min(len(warning), capacity - 1)
            do i = 1, length
                text(i) = warning(i:i)
            end do
            text(length + 1) = c_null_char
        else
            call problem%refuse('text is NULL, or its capacity is not positive', 'pass an array and its capacity')
        end if
        c_get_warning = problem%stat
    end function c_get_warning

    !> Save the run. If `words` is NULL, only the number of words is returned.
    integer(c_int) function c_save_state(handle, capacity, words, count) bind(C, name='tandem_save_state')
        type(c_ptr), value :: handle
        !> Number of words for which there is space.
        integer(c_int), value :: capacity
        integer(c_int64_t), intent(inout), optional :: words(*)
        !> Number of words of the saved run.
        integer(c_int), intent(out), optional :: count
        type(problem_type), pointer :: problem
        integer(long), allocatable :: row(:)

        if (present(count)) count = 0
        if (.not. found(handle, problem, c_save_state)) return
        call problem%save_state(row)
        if (allocated(row)) then
            if (present(count)) count = size(row)
            if (.not. present(words)) then
                if (.not. present(count)) call problem%refuse('words and count are both NULL', 'pass one of them')
            else if (capacity < size(row)) then
                call problem%refuse('the state takes '//to_text(size(row))//' words, and the capacity is '//to_text(capacity), &
                    'call tandem_save_state without words for the required capacity')
            else
                words(:size(row)) = row
            end if
        end if
        c_save_state = problem%stat
    end function c_save_state

    !> Restore a saved run.
    integer(c_int) function c_restore_state(handle, count, words) bind(C, name='tandem_restore_state')
        type(c_ptr), value :: handle
        integer(c_int), value :: count
        integer(c_int64_t), intent(in), optional :: words(*)
        type(problem_type), pointer :: problem

        if (.not. found(handle, problem, c_restore_state)) return
        if (present(words) .and. count >= 0) then
            call problem%restore_state(words(:count))
        else
            call problem%refuse('words is NULL, or their number is negative', 'pass the words saved by tandem_save_state')
        end if
        c_restore_state = problem%stat
    end function c_restore_state

    !> Index of the current smooth piece of the model's functions of time, 1 before the first breakpoint. The functions of the model
    !> may call this function.
    integer(c_int) function c_get_segment(handle) bind(C, name='tandem_get_segment')
        type(c_ptr), value :: handle
        type(problem_type), pointer :: problem

        call find(handle, problem)
        c_get_segment = 0
        if (.not. associated(problem)) return
        if (associated(problem%model)) c_get_segment = problem%model%segment
    end function c_get_segment

    !> Find the problem of a handle, which every function of the interface does first. False, with a status, if the handle is
    !> invalid.
    logical function found(handle, problem, stat)
        type(c_ptr), intent(in) :: handle
        type(problem_type), pointer, intent(out) :: problem
        integer(c_int), intent(out) :: stat

        stat = status_invalid_option
        call find(handle, problem)
        found = associated(problem)
    end function found
end module tandem_legacy_c
