! SPDX-License-Identifier: MIT
!> Description of a problem of the C or Fortran 77 interface: its model, options and events, and the status and message of the last
!> operation. `tandem_legacy_problem` adds the run.
module tandem_legacy_description
    use tandem_analysis_linearisation, only: linearisation_type
    use tandem_analysis_equilibrium_search, only: equilibrium_search_type
    use tandem_analysis_steady_words, only: find_steady_from_text
    use tandem_error, only: error_type, set_error, to_text
    use tandem_kinds, only: wp
    use tandem_legacy_callback_model, only: callback_model_type
    use tandem_legacy_comparison, only: compare_procedures
    use tandem_legacy_events, only: callback_event_type, event_list_type
    use tandem_legacy_settings, only: set_option, copy_flags, copy_list
    use tandem_legacy_terms, only: find_term, names_of_kind, terms
    use tandem_legacy_wording, only: in_words_of
    use tandem_mechanism_entries, only: entries_type
    use tandem_model, only: label_length, model_type
    use tandem_model_terms, only: need_force, need_gamma, need_jacobian, need_mass, need_nu, need_phi
    use tandem_names, only: lower_case
    use tandem_options, only: options_type
    use tandem_simulate_assembly, only: assemble, assembly_type
    use tandem_status, only: status_invalid_model, status_invalid_option, status_ok
    use, intrinsic :: iso_c_binding, only: c_associated, c_char, c_funptr, c_null_char
    implicit none (type, external)
    private

    public :: description_type, check_sizes, message_of_no_problem, message_length

    !> Message if there is no problem that could contain one.
    character(len=*), parameter :: message_of_no_problem = &
        'invalid_option: invalid handle; create a problem with tandem_new or TDNEW'
    character(len=*), parameter :: message_of_success = 'ok: success'
    !> Largest length of messages; longer ones are truncated.
    integer, parameter :: message_length = 2047
    !> Largest number of rows of a matrix whose number of entries is a default integer.
    integer, parameter :: largest_n = 32767
    !> Approximate number of matrices of n rows and columns in a run.
    integer, parameter :: n_matrices = 20

    type :: description_type
        !> Model of the run: the user's procedures, or a mechanism; for the latter null until it is built.
        class(model_type), pointer :: model => null()
        !> User procedures; for a mechanism only those of events.
        class(callback_model_type), pointer :: callbacks => null()
        !> True if the model is a mechanism; its keys.
        logical :: is_mechanism = .false.
        type(entries_type) :: keys
        !> Options. Changes take effect at the next start.
        type(options_type) :: options
        !> Options of an assembly of the start.
        type(assembly_type), private :: assembly
        type(event_list_type) :: events
        !> Status of the last operation.
        integer :: stat = status_ok
        !> Message of the last operation, terminated by a NUL. Its address never changes, because C callers may store it, and
        !> `printf` may evaluate it before another argument performs the operation.
        character(kind=c_char) :: message(message_length + 1) = c_null_char
        logical, private :: sizes_can_be = .false.
        !> True while there is a run. Changing the model ends the run.
        logical :: started = .false.
        !> True during calls of user procedures, in which data in use must not be changed. Read only.
        logical :: busy = .false.
    contains
        procedure :: set_up, set_up_mechanism, prepare, release, refuse
        procedure :: set_procedure, set_evaluate, set => set_named, set_vector, set_row_name
        procedure :: add_event, clear_events
        procedure :: check, linearise, find_equilibrium, find_steady_motion, assemble => assemble_start
        procedure :: conclude, succeed, is_free
        procedure, private :: change_model, is_by_procedures
    end type description_type

contains

    !> Create a problem for a model without procedures. The status states whether the sizes are valid.
    subroutine set_up(self, model, n, n_holonomic, n_nonholonomic)
        class(description_type), intent(inout) :: self
        !> Model. The problem becomes the owner of the pointer.
        class(callback_model_type), pointer, intent(in) :: model
        !> Numbers of coordinates, holonomic and nonholonomic constraints.
        integer, intent(in) :: n, n_holonomic, n_nonholonomic
        type(error_type), allocatable :: error

        self%model => model
        self%callbacks => model
        model%n = n
        model%n_holonomic = n_holonomic
        model%n_nonholonomic = n_nonholonomic
        call set_message(self, message_of_success)
        call check_sizes(model, error)
        self%sizes_can_be = .not. allocated(error)
        call self%conclude(error)
    end subroutine set_up

    !> Create a problem for a mechanism that has no keys yet.
    subroutine set_up_mechanism(self)
        class(description_type), intent(inout) :: self

        self%is_mechanism = .true.
        self%model => null()
        call self%succeed()
    end subroutine set_up_mechanism

    !> Allocate the work space of the user's procedures, whose sizes must be valid. A mechanism must have been built.
    subroutine prepare(self, error)
        class(description_type), intent(inout) :: self
        type(error_type), allocatable, intent(out) :: error

        if (.not. self%is_mechanism) then
            call check_sizes(self%callbacks, error)
            if (.not. allocated(error)) call self%callbacks%prepare()
        else if (.not. associated(self%model)) then
            call set_error(error, status_invalid_model, 'the mechanism is not complete', &
                'call tandem_define or TDDEFN after its keys')
        end if
    end subroutine prepare

    !> True if the model consists of user procedures; false, with a status, for a mechanism.
    logical function is_by_procedures(self)
        class(description_type), intent(inout) :: self

        is_by_procedures = .not. self%is_mechanism
        if (self%is_mechanism) call self%refuse('the library supplies the equations of a mechanism', 'describe it by keys')
    end function is_by_procedures

    !> Release all memory. False if called from a user procedure.
    logical function release(self)
        class(description_type), intent(inout) :: self

        release = self%is_free()
        if (.not. release .or. .not. associated(self%callbacks)) return
        call self%events%release()
        if (self%is_mechanism .and. associated(self%model)) deallocate (self%model)
        self%model => null()
        call self%callbacks%release()
        deallocate (self%callbacks)
    end function release

    !> Refuse sizes for which the work space cannot be allocated.
    subroutine check_sizes(model, error)
        class(callback_model_type), intent(in) :: model
        type(error_type), allocatable, intent(out) :: error
        real(wp), allocatable :: trial(:, :)
        integer :: stat

        if (model%n < 1) then
            call set_error(error, status_invalid_model, 'n = '//to_text(model%n)//' coordinates', &
                'a model has at least one coordinate')
        else if (model%n > largest_n) then
            call set_error(error, status_invalid_model, 'n = '//to_text(model%n)//' coordinates', &
                'the maximum is '//to_text(largest_n))
        else if (min(model%n_holonomic, model%n_nonholonomic) < 0) then
            call set_error(error, status_invalid_model, to_text(model%n_holonomic)//' holonomic and '// &
                to_text(model%n_nonholonomic)//' nonholonomic constraints', 'numbers of constraints are not negative')
        else if (model%n_holonomic > model%n - model%n_nonholonomic) then
            call set_error(error, status_invalid_model, to_text(model%n_holonomic)//' holonomic and '// &
                to_text(model%n_nonholonomic)//' nonholonomic constraints on '//to_text(model%n)//' coordinates', &
                'there are at most as many constraints as coordinates')
        else
            allocate (trial(n_matrices*model%n, model%n), stat=stat)
            if (stat /= 0) call set_error(error, status_invalid_model, 'there is no memory for matrices with n = '// &
                to_text(model%n), 'make the model smaller, or use a larger machine')
        end if
    end subroutine check_sizes

    !> Conclude an operation with a status and a message.
    subroutine conclude(self, error)
        class(description_type), intent(inout) :: self
        type(error_type), allocatable, intent(in) :: error
        character(len=:), allocatable :: message

        if (allocated(error)) then
            self%stat = error%stat
            allocate (message, source=error%message)
            call in_words_of(self%callbacks%by_rows, message)
            call set_message(self, message)
        else if (self%stat /= status_ok) then
            self%stat = status_ok
            call set_message(self, message_of_success)
        end if
    end subroutine conclude

    !> Conclude an operation that has invalid arguments.
    subroutine refuse(self, message, advice)
        class(description_type), intent(inout) :: self
        !> Problem and remedy.
        character(len=*), intent(in) :: message, advice
        type(error_type), allocatable :: error

        call set_error(error, status_invalid_option, message, advice)
        call self%conclude(error)
    end subroutine refuse

    !> False, with a status, during a call of a user procedure.
    logical function is_free(self)
        class(description_type), intent(inout) :: self

        is_free = .not. self%busy
        if (self%busy) call self%refuse('a procedure of the model uses the calling problem', &
            'do not call the interface within procedures of the model')
    end function is_free

    !> Prepare a change of the model, which ends its run.
    subroutine change_model(self)
        class(description_type), intent(inout) :: self

        self%started = .false.
        call self%succeed()
    end subroutine change_model

    !> Set a procedure of the model.
    subroutine set_procedure(self, name, kind, address)
        class(description_type), intent(inout) :: self
        !> Name of the procedure in upper or lower case.
        character(len=*), intent(in) :: name
        !> Kind of its argument list, see `tandem_legacy_terms`.
        integer, intent(in) :: kind
        !> Address of the procedure; null removes it.
        type(c_funptr), intent(in) :: address
        character(len=*), parameter :: arguments(3) = [character(len=10) :: '(t, q)', '(t, q, qd)', '(t, q, x)']
        integer :: term

        if (.not. self%is_free()) return
        if (.not. self%is_by_procedures()) return
        term = find_term(lower_case(name))
        if (term > 0) then
            if (terms(term)%kind /= kind) term = 0
        end if
        if (term == 0) then
            call self%refuse('"'//trim(name)//'" is not a procedure of '//trim(arguments(kind)), &
                'there are '//trim(names_of_kind(kind)))
        else
            call self%callbacks%set_callback(term, address)
            call self%change_model()
        end if
    end subroutine set_procedure

    !> Set the fused procedure.
    subroutine set_evaluate(self, address, provides)
        class(description_type), intent(inout) :: self
        !> Address of the procedure; null removes it.
        type(c_funptr), intent(in) :: address
        !> Terms that it provides, a sum of need bits; ignored if the procedure is removed.
        integer, intent(in) :: provides
        integer, parameter :: all_terms = need_phi + need_jacobian + need_nu + need_gamma + need_mass + need_force

        if (.not. self%is_free()) return
        if (.not. self%is_by_procedures()) return
        if (c_associated(address) .and. (provides <= 0 .or. iand(provides, not(all_terms)) /= 0)) then
            call self%refuse('provides = '//to_text(provides)//' is not a sum of constants of terms', &
                'add the constants of the terms that evaluate returns')
        else
            call self%callbacks%set_fused(address, provides)
            call self%change_model()
        end if
    end subroutine set_evaluate

    !> Conclude a successful operation.
    subroutine succeed(self)
        class(description_type), intent(inout) :: self
        type(error_type), allocatable :: no_error

        call self%conclude(no_error)
    end subroutine succeed

    !> Set a value by name: an option, to a number, an integer or a word; constant_mass, a property of the model, to an integer,
    !> nonzero for true; or an option of the assembly of a start.
    subroutine set_named(self, name, number, whole, word)
        class(description_type), intent(inout) :: self
        character(len=*), intent(in) :: name
        real(wp), intent(in), optional :: number
        integer, intent(in), optional :: whole
        character(len=*), intent(in), optional :: word
        type(error_type), allocatable :: error

        if (.not. self%is_free()) return
        if (present(whole) .and. lower_case(name) == 'constant_mass') then
            if (.not. self%is_by_procedures()) return
            self%model%constant_mass = whole /= 0
            call self%change_model()
        else
            call set_option(self%options, self%assembly, name, error, number, whole, word)
            call self%conclude(error)
        end if
    end subroutine set_named

    !> Set a list of numbers by name. Lists of the model: coordinate_scale (n), breakpoints, nu_jumps (one per breakpoint, nonzero
    !> if nu jumps), mass_blocks (sizes of the diagonal blocks of M). Lists of the assembly of a start: weight_q, weight_qd,
    !> fixed_q, fixed_qd (n, nonzero if fixed). Or lists of the options. An empty list removes the values.
    subroutine set_vector(self, name, values)
        class(description_type), intent(inout) :: self
        character(len=*), intent(in) :: name
        !> Values. They are checked when a run is started or a start is assembled.
        real(wp), intent(in) :: values(:)
        type(error_type), allocatable :: error

        if (.not. self%is_free()) return
        select case (lower_case(name))
        case ('coordinate_scale', 'breakpoints', 'nu_jumps', 'mass_blocks')
            if (.not. self%is_by_procedures()) return
        case default
        end select
        select case (lower_case(name))
        case ('coordinate_scale'); call copy_list(values, self%model%coordinate_scale)
        case ('breakpoints'); self%model%breakpoints = values
        case ('nu_jumps'); call copy_flags(values, self%model%nu_jumps)
        case ('mass_blocks')
            if (.not. all(values >= 1.0_wp .and. values <= real(largest_n, wp) .and. abs(values - aint(values)) <= 0.0_wp)) then
                call self%refuse('an entry of mass_blocks is not a valid size', 'use positive integers')
                return
            end if
            if (allocated(self%model%mass_blocks)) deallocate (self%model%mass_blocks)
            if (size(values) > 0) self%model%mass_blocks = nint(values)
        case default
            call set_option(self%options, self%assembly, name, error, list=values)
            call self%conclude(error)
            return
        end select
        call self%change_model()
    end subroutine set_vector

    !> Set the name of a constraint row for messages.
    subroutine set_row_name(self, row, name)
        class(description_type), intent(inout) :: self
        !> Index of the row of C from 1, holonomic rows first.
        integer, intent(in) :: row
        character(len=*), intent(in) :: name
        character(len=label_length), allocatable :: names(:)
        integer :: i, rows

        if (.not. self%is_free()) return
        if (.not. self%is_by_procedures()) return
        associate (model => self%model)
            rows = 0
            if (self%sizes_can_be) rows = model%n_constraints()
            if (row < 1 .or. row > rows) then
                call self%refuse('there is no such constraint row', 'the model has '//to_text(rows))
                return
            end if
            allocate (names(rows))
            do i = 1, rows
                names(i) = model%row_name(i)
            end do
            names(row) = name
            model%holonomic_name = names(:model%n_holonomic)
            model%nonholonomic_name = names(model%n_holonomic + 1:)
        end associate
        call self%succeed()
    end subroutine set_row_name

    !> Add an event, which takes effect at the next start.
    subroutine add_event(self, name, direction, stops, quantity, index, value, function_)
        class(description_type), intent(inout) :: self
        character(len=*), intent(in) :: name
        !> The direction is +1 rising, -1 falling, 0 both. Nonzero `stops`: the run ends at the event.
        integer, intent(in) :: direction, stops
        !> Watched quantity, index of its entry from 1, and the value to be reached; or a function.
        character(len=*), intent(in), optional :: quantity
        integer, intent(in), optional :: index
        real(wp), intent(in), optional :: value
        type(c_funptr), intent(in), optional :: function_
        type(callback_event_type) :: event
        type(error_type), allocatable :: error

        if (.not. self%is_free()) return
        event%model => self%callbacks
        event%direction = direction
        event%stops = stops /= 0
        if (present(index)) event%index = index
        if (present(value)) event%value = value
        if (present(function_)) event%function_ = function_
        call self%events%add(name, event, error, quantity)
        call self%conclude(error)
    end subroutine add_event

    !> Remove all events. Takes effect at the next start.
    subroutine clear_events(self)
        class(description_type), intent(inout) :: self

        if (.not. self%is_free()) return
        call self%events%clear()
        call self%succeed()
    end subroutine clear_events

    !> Compare the procedures with differences of each other near (t, q, qd). A run in progress is not affected.
    subroutine check(self, t, q, qd)
        class(description_type), intent(inout) :: self
        !> Time, coordinates and velocities (n).
        real(wp), intent(in) :: t, q(*), qd(*)
        type(error_type), allocatable :: error

        if (.not. self%is_free()) return
        if (.not. self%is_by_procedures()) return
        call self%prepare(error)
        if (.not. allocated(error)) then
            self%busy = .true.
            call compare_procedures(self%callbacks, t, q(:self%model%n), qd(:self%model%n), error)
            self%busy = .false.
        end if
        call self%conclude(error)
    end subroutine check

    !> Eigenvalues of small motions about (t, q, qd), which must satisfy the constraints. A run in progress is not affected.
    subroutine linearise(self, t, q, qd, count, re, im, a)
        class(description_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(*), qd(*)
        !> Number of eigenvalues, at most 2 n.
        integer, intent(out) :: count
        !> Real and imaginary parts (count), sorted by the real parts.
        real(wp), intent(inout) :: re(*), im(*)
        !> Matrix (count, count), by columns.
        real(wp), intent(inout), optional :: a(*)
        type(linearisation_type), allocatable :: it
        type(error_type), allocatable :: error

        count = 0
        if (.not. self%is_free()) return
        call self%prepare(error)
        if (.not. allocated(error)) then
            self%busy = .true.
            allocate (it)
            call it%make(self%model, t, q(:self%model%n), qd(:self%model%n), error)
            self%busy = .false.
        end if
        if (.not. allocated(error)) then
            count = size(it%spectrum%values)
            re(:count) = real(it%spectrum%values, wp)
            im(:count) = aimag(it%spectrum%values)
            if (present(a)) a(:count**2) = reshape(it%a, [count**2])
        end if
        call self%conclude(error)
    end subroutine linearise

    !> Find the equilibrium nearest to q at t, whether stable or not. A run in progress is not affected.
    subroutine find_equilibrium(self, t, q)
        class(description_type), intent(inout) :: self
        real(wp), intent(in) :: t
        !> Coordinates (n): a guess on entry, the equilibrium on return; unchanged if none is found.
        real(wp), intent(inout) :: q(*)
        type(equilibrium_search_type), allocatable :: search
        type(error_type), allocatable :: error

        if (.not. self%is_free()) return
        call self%prepare(error)
        if (.not. allocated(error)) then
            self%busy = .true.
            allocate (search)
            call search%find_equilibrium(self%model, t, q(:self%model%n), error)
            self%busy = .false.
        end if
        if (.not. allocated(error)) q(:self%model%n) = search%q
        call self%conclude(error)
    end subroutine find_equilibrium

    !> Find the steady motion nearest to (q, qd) at t. A run in progress is not affected.
    subroutine find_steady_motion(self, t, q, qd, motions)
        class(description_type), intent(inout) :: self
        real(wp), intent(in) :: t
        !> Coordinates and velocities (n): a guess on entry, the steady motion on return; unchanged if none is found.
        real(wp), intent(inout) :: q(*), qd(*)
        !> Motions along which the result is steady, in the syntax of `find_steady_from_words`, separated by blanks or commas.
        character(len=*), intent(in) :: motions
        type(equilibrium_search_type), allocatable :: search
        type(error_type), allocatable :: error

        if (.not. self%is_free()) return
        call self%prepare(error)
        if (.not. allocated(error)) then
            self%busy = .true.
            allocate (search)
            call find_steady_from_text(search, self%model, t, q(:self%model%n), qd(:self%model%n), motions, error)
            self%busy = .false.
        end if
        if (.not. allocated(error)) then
            q(:self%model%n) = search%q
            qd(:self%model%n) = search%qd
        end if
        call self%conclude(error)
    end subroutine find_steady_motion

    !> Find the state nearest to (q, qd) at t that satisfies the constraints. A run in progress is not affected.
    subroutine assemble_start(self, t, q, qd)
        class(description_type), intent(inout) :: self
        real(wp), intent(in) :: t
        !> Coordinates and velocities (n); unchanged if there is no such state, or none close enough.
        real(wp), intent(inout) :: q(*), qd(*)
        type(error_type), allocatable :: error
        integer :: segment

        if (.not. self%is_free()) return
        call self%prepare(error)
        if (.not. allocated(error)) then
            segment = self%model%segment
            self%busy = .true.
            call assemble(self%model, self%assembly, t, q(:self%model%n), qd(:self%model%n), error)
            self%busy = .false.
            self%model%segment = segment
        end if
        call self%conclude(error)
    end subroutine assemble_start

    !> Store the message for C, truncated to the available length.
    subroutine set_message(self, text)
        class(description_type), intent(inout) :: self
        character(len=*), intent(in) :: text
        integer :: i, length

        length = min(len(text), message_length)
        do i = 1, length
            self%message(i) = text(i:i)
        end do
        self%message(length + 1) = c_null_char
    end subroutine set_message
end module tandem_legacy_description
