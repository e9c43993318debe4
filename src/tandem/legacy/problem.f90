! SPDX-License-Identifier: MIT
!> A problem: all that a handle of the C or the Fortran 77 interface stands for, and what can be done with it. Every operation
!> leaves a status and a message in the problem; two problems share nothing.
module tandem_legacy_problem
    use tandem_error, only: error_type, set_error, to_text
    use tandem_kinds, only: long, wp
    use tandem_legacy_callback_model, only: callback_model_type
    use tandem_legacy_comparison, only: compare_procedures
    use tandem_legacy_figures, only: find_warnings, get_figure
    use tandem_legacy_settings, only: lower_case, set_option, take_flags, take_list
    use tandem_legacy_terms, only: find_term, names_of_kind, terms
    use tandem_legacy_wording, only: in_words_of
    use tandem_model, only: label_length
    use tandem_model_terms, only: need_force, need_gamma, need_jacobian, need_mass, need_nu, need_phi
    use tandem_options, only: options_type
    use tandem_simulate_assembly, only: assemble, assembly_type
    use tandem_simulate_warning, only: warning_type
    use tandem_simulation, only: simulation_type
    use tandem_status, only: status_callback_failed, status_invalid_model, status_invalid_option, status_not_evaluable, &
        status_not_finite, status_ok
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    use, intrinsic :: iso_c_binding, only: c_associated, c_char, c_funptr, c_null_char
    implicit none (type, external)
    private

    public :: problem_type, message_of_no_problem, message_length

    !> The message where there is no problem to keep one.
    character(len=*), parameter :: message_of_no_problem = &
        'invalid_option: the handle is not that of a problem; make one with tandem_new or TDNEW'
    character(len=*), parameter :: message_of_success = 'ok: all went well'
    !> More characters than any message takes; what is behind them is cut.
    integer, parameter :: message_length = 2047
    !> Matrices of more rows than this cannot be counted by default integers.
    integer, parameter :: largest_n = 32767
    !> A run keeps about so many matrices of n rows and columns.
    integer, parameter :: n_matrices = 20

    type :: problem_type
        !> The user's model.
        class(callback_model_type), pointer :: model => null()
        !> What was chosen; counts from the next start on.
        type(options_type) :: options
        !> What is asked of a start that is assembled.
        type(assembly_type), private :: assembly
        type(simulation_type) :: simulation
        !> Status of the last operation.
        integer :: stat = status_ok
        !> Message of the last operation, ended by a NUL. It never moves: callers of C keep its address, and `printf` may be handed
        !> the address before the operation that the message is of.
        character(kind=c_char) :: message(message_length + 1) = c_null_char
        logical, private :: sizes_can_be = .false.
        logical, private :: started = .false.
        !> True while the user's procedures may be called: what those use must not change. To be read only.
        logical :: busy = .false.
    contains
        procedure :: set_up
        procedure :: release
        procedure :: refuse
        procedure :: set_procedure
        procedure :: set_evaluate
        procedure :: set => set_named
        procedure :: set_vector
        procedure :: set_row_name
        procedure :: check
        procedure :: assemble => assemble_start
        procedure :: start
        procedure :: integrate
        procedure :: step
        procedure :: get_state
        procedure :: show_state
        procedure :: get_state_at
        procedure :: get_multipliers
        procedure :: get_energies
        procedure :: get_statistic
        procedure :: count_warnings
        procedure :: get_warning
        procedure :: save_state
        procedure :: restore_state
        procedure, private :: conclude
        procedure, private :: change_model
        procedure, private :: is_free
        procedure, private :: is_running
    end type problem_type

contains

    !> Make a problem of a model without procedures. The status tells whether the sizes can be.
    subroutine set_up(self, model, n, n_holonomic, n_nonholonomic)
        class(problem_type), intent(inout) :: self
        !> Now the problem's.
        class(callback_model_type), pointer, intent(in) :: model
        !> Numbers of coordinates, holonomic and nonholonomic constraints.
        integer, intent(in) :: n, n_holonomic, n_nonholonomic
        type(error_type), allocatable :: error

        self%model => model
        model%n = n
        model%n_holonomic = n_holonomic
        model%n_nonholonomic = n_nonholonomic
        call set_message(self, message_of_success)
        call check_sizes(model, error)
        self%sizes_can_be = .not. allocated(error)
        call self%conclude(error)
    end subroutine set_up

    !> Give everything back; false where a procedure of the user asks for it while it is called.
    logical function release(self)
        class(problem_type), intent(inout) :: self

        release = self%is_free()
        if (.not. release .or. .not. associated(self%model)) return
        call self%model%release()
        deallocate (self%model)
    end function release

    !> Refuse sizes for which not even the work space can be allocated.
    subroutine check_sizes(model, error)
        class(callback_model_type), intent(in) :: model
        type(error_type), allocatable, intent(out) :: error
        real(wp), allocatable :: trial(:, :)
        integer :: stat

        if (model%n < 1) then
            call set_error(error, status_invalid_model, 'n = '//to_text(model%n)//' coordinates', 'a model has at least one')
        else if (model%n > largest_n) then
            call set_error(error, status_invalid_model, 'n = '//to_text(model%n)//' coordinates', &
                'there can be '//to_text(largest_n)//' at most')
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

    !> End an operation with a status and a message.
    subroutine conclude(self, error)
        class(problem_type), intent(inout) :: self
        type(error_type), allocatable, intent(in) :: error
        character(len=:), allocatable :: message

        if (allocated(error)) then
            self%stat = error%stat
            allocate (message, source=error%message)
            call in_words_of(self%model%by_rows, message)
            call set_message(self, message)
        else if (self%stat /= status_ok) then
            self%stat = status_ok
            call set_message(self, message_of_success)
        end if
    end subroutine conclude

    !> End an operation that was asked for in a way that cannot be.
    subroutine refuse(self, message, advice)
        class(problem_type), intent(inout) :: self
        !> What is wrong, and what to do.
        character(len=*), intent(in) :: message, advice
        type(error_type), allocatable :: error

        call set_error(error, status_invalid_option, message, advice)
        call self%conclude(error)
    end subroutine refuse

    !> False, with a status, while one of the user's procedures is being called.
    logical function is_free(self)
        class(problem_type), intent(inout) :: self

        is_free = .not. self%busy
        if (self%busy) call self%refuse('a procedure of the model uses the problem that calls it', &
            'call the interface from outside of the model''s procedures')
    end function is_free

    !> False, with a status, where no run was started.
    logical function is_running(self)
        class(problem_type), intent(inout) :: self

        is_running = self%is_free()
        if (.not. is_running) return
        is_running = self%started
        if (.not. self%started) call self%refuse('no run was started since the model was made or changed', &
            'call tandem_start or TDSTRT first')
    end function is_running

    !> The model is changed: what runs with it has ended, and must be started anew.
    subroutine change_model(self)
        class(problem_type), intent(inout) :: self

        self%started = .false.
        call succeed(self)
    end subroutine change_model

    !> Give a procedure of the model.
    subroutine set_procedure(self, name, kind, address)
        class(problem_type), intent(inout) :: self
        !> Its name, in either case.
        character(len=*), intent(in) :: name
        !> Its argument list, see `tandem_legacy_terms`.
        integer, intent(in) :: kind
        !> Null takes it back.
        type(c_funptr), intent(in) :: address
        character(len=*), parameter :: arguments(3) = [character(len=10) :: '(t, q)', '(t, q, qd)', '(t, q, x)']
        integer :: term

        if (.not. self%is_free()) return
        term = find_term(lower_case(name))
        if (term > 0) then
            if (terms(term)%kind /= kind) term = 0
        end if
        if (term == 0) then
            call self%refuse('"'//trim(name)//'" is not a procedure of '//trim(arguments(kind)), &
                'there are '//trim(names_of_kind(kind)))
        else
            call self%model%set_callback(term, address)
            call self%change_model()
        end if
    end subroutine set_procedure

    !> Give a procedure of several terms.
    subroutine set_evaluate(self, address, provides)
        class(problem_type), intent(inout) :: self
        !> Null takes it back.
        type(c_funptr), intent(in) :: address
        !> What it gives, a sum of need bits; anything where it is taken back.
        integer, intent(in) :: provides
        integer, parameter :: all_terms = need_phi + need_jacobian + need_nu + need_gamma + need_mass + need_force

        if (.not. self%is_free()) return
        if (c_associated(address) .and. (provides <= 0 .or. iand(provides, not(all_terms)) /= 0)) then
            call self%refuse('what evaluate provides, '//to_text(provides)//', is not a sum of the terms'' constants', &
                'add the constants of the terms that it gives')
        else
            call self%model%set_fused(address, provides)
            call self%change_model()
        end if
    end subroutine set_evaluate

    subroutine succeed(self)
        class(problem_type), intent(inout) :: self
        type(error_type), allocatable :: no_error

        call self%conclude(no_error)
    end subroutine succeed

    !> Set an option to one of a number, an integer and a word; or constant_mass, which is the model's, to an integer that is not 0;
    !> or what is asked of a start that is assembled.
    subroutine set_named(self, name, number, whole, word)
        class(problem_type), intent(inout) :: self
        character(len=*), intent(in) :: name
        real(wp), intent(in), optional :: number
        integer, intent(in), optional :: whole
        character(len=*), intent(in), optional :: word
        type(error_type), allocatable :: error

        if (.not. self%is_free()) return
        if (present(whole) .and. lower_case(name) == 'constant_mass') then
            self%model%constant_mass = whole /= 0
            call self%change_model()
        else
            call set_option(self%options, self%assembly, name, error, number, whole, word)
            call self%conclude(error)
        end if
    end subroutine set_named

    !> Set a list of numbers of the model: coordinate_scale (n), breakpoints, nu_jumps (as many; not 0 means that nu jumps),
    !> mass_blocks (sizes of the diagonal blocks of M); of a start that is assembled: weight_q, weight_qd, fixed_q, fixed_qd (n; not
    !> 0 means that it stays); or of the options. No numbers take the list back.
    subroutine set_vector(self, name, values)
        class(problem_type), intent(inout) :: self
        character(len=*), intent(in) :: name
        !> Checked when a run starts, or a start is assembled.
        real(wp), intent(in) :: values(:)
        type(error_type), allocatable :: error

        if (.not. self%is_free()) return
        select case (lower_case(name))
        case ('coordinate_scale'); call take_list(values, self%model%coordinate_scale)
        case ('breakpoints'); self%model%breakpoints = values
        case ('nu_jumps'); call take_flags(values, self%model%nu_jumps)
        case ('mass_blocks')
            if (.not. all(values >= 1.0_wp .and. values <= real(largest_n, wp) .and. abs(values - aint(values)) <= 0.0_wp)) then
                call self%refuse('an entry of mass_blocks is no size', 'give whole numbers from 1 on')
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

    !> Name a constraint row, for messages.
    subroutine set_row_name(self, row, name)
        class(problem_type), intent(inout) :: self
        !> Row of C from 1 on, holonomic rows first.
        integer, intent(in) :: row
        character(len=*), intent(in) :: name
        character(len=label_length), allocatable :: names(:)
        integer :: i, rows

        if (.not. self%is_free()) return
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
        call succeed(self)
    end subroutine set_row_name

    !> Compare the procedures with differences of each other near (t, q, qd). A run that is under way does not notice.
    subroutine check(self, t, q, qd)
        class(problem_type), intent(inout) :: self
        !> Time, coordinates and velocities (n).
        real(wp), intent(in) :: t, q(*), qd(*)
        type(error_type), allocatable :: error

        if (.not. self%is_free()) return
        call check_sizes(self%model, error)
        if (.not. allocated(error)) then
            call self%model%prepare()
            self%busy = .true.
            call compare_procedures(self%model, t, q(:self%model%n), qd(:self%model%n), error)
            self%busy = .false.
        end if
        call self%conclude(error)
    end subroutine check

    !> Move (q, qd) to the nearest state at t that satisfies the constraints. A run that is under way does not notice.
    subroutine assemble_start(self, t, q, qd)
        class(problem_type), intent(inout) :: self
        real(wp), intent(in) :: t
        !> Coordinates and velocities (n); unchanged where there is no such state, or none near enough.
        real(wp), intent(inout) :: q(*), qd(*)
        type(error_type), allocatable :: error
        integer :: segment

        if (.not. self%is_free()) return
        call check_sizes(self%model, error)
        if (.not. allocated(error)) then
            call self%model%prepare()
            segment = self%model%segment
            self%busy = .true.
            call assemble(self%model, self%assembly, t, q(:self%model%n), qd(:self%model%n), error)
            self%busy = .false.
            self%model%segment = segment
        end if
        call self%conclude(error)
    end subroutine assemble_start

    !> Start a run at (t, q, qd) with the options of now.
    subroutine start(self, t, q, qd)
        class(problem_type), intent(inout) :: self
        !> Start time, coordinates and velocities (n).
        real(wp), intent(in) :: t, q(*), qd(*)
        type(error_type), allocatable :: error

        if (.not. self%is_free()) return
        self%started = .false.
        call check_sizes(self%model, error)
        if (.not. allocated(error)) then
            call self%model%prepare()
            self%busy = .true.
            call self%simulation%initialize(self%model, self%options, t, q(:self%model%n), qd(:self%model%n), error)
            self%busy = .false.
            self%started = .not. allocated(error)
        end if
        call self%conclude(error)
    end subroutine start

    !> Integrate to t_end. To be there already is no error: loops over times of output begin with the start.
    subroutine integrate(self, t_end)
        class(problem_type), intent(inout) :: self
        real(wp), intent(in) :: t_end
        type(error_type), allocatable :: error

        if (.not. self%is_running()) return
        if (abs(t_end - self%simulation%state%t) <= 0.0_wp) then
            call succeed(self)
            return
        end if
        self%busy = .true.
        call self%simulation%look_back()
        call self%simulation%integrate(t_end, error)
        self%busy = .false.
        call self%conclude(error)
    end subroutine integrate

    !> One accepted step that does not pass t_limit.
    subroutine step(self, t_limit)
        class(problem_type), intent(inout) :: self
        real(wp), intent(in) :: t_limit
        type(error_type), allocatable :: error

        if (.not. self%is_running()) return
        if (.not. (t_limit > self%simulation%state%t .and. ieee_is_finite(t_limit))) then
            call self%refuse('the limit '//to_text(t_limit)//' of a step must be finite and after the current time '// &
                to_text(self%simulation%state%t), 'choose a later one')
            return
        end if
        self%busy = .true.
        call self%simulation%step(t_limit, error)
        self%busy = .false.
        call self%conclude(error)
    end subroutine step

    !> The state at the end of the last accepted step, or the start. What is not present is not given.
    subroutine get_state(self, t, q, qd, qdd)
        class(problem_type), intent(inout) :: self
        real(wp), intent(out), optional :: t
        !> Coordinates, velocities, accelerations (n).
        real(wp), intent(inout), optional :: q(*), qd(*), qdd(*)

        if (.not. self%is_running()) return
        if (present(t)) t = self%simulation%state%t
        call copy_state(self, q, qd, qdd)
        call succeed(self)
    end subroutine get_state

    !> The current state without a change of status, where there is one: what was reached before a failure.
    subroutine show_state(self, t, q, qd)
        class(problem_type), intent(in) :: self
        real(wp), intent(inout) :: t, q(*), qd(*)

        if (self%busy .or. .not. self%started) return
        t = self%simulation%state%t
        call copy_state(self, q, qd)
    end subroutine show_state

    subroutine copy_state(self, q, qd, qdd)
        class(problem_type), intent(in) :: self
        real(wp), intent(inout), optional :: q(*), qd(*), qdd(*)

        associate (n => self%model%n, state => self%simulation%state)
            if (present(q)) q(:n) = state%q
            if (present(qd)) qd(:n) = state%qd
            if (present(qdd)) qdd(:n) = state%qdd
        end associate
    end subroutine copy_state

    !> The state at a time within the last step.
    subroutine get_state_at(self, t, q, qd, qdd)
        class(problem_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(inout), optional :: q(*), qd(*), qdd(*)
        type(error_type), allocatable :: error

        if (.not. self%is_running()) return
        self%busy = .true.
        call self%simulation%look_at(t, error)
        if (.not. allocated(error)) call copy_state(self, q, qd, qdd)
        call self%simulation%look_back()
        self%busy = .false.
        call self%conclude(error)
    end subroutine get_state_at

    !> The multipliers at a time within the last step, holonomic rows first.
    subroutine get_multipliers(self, t, lambda)
        class(problem_type), intent(inout) :: self
        real(wp), intent(in) :: t
        !> (nh + nd).
        real(wp), intent(inout) :: lambda(*)
        type(error_type), allocatable :: error

        if (.not. self%is_running()) return
        self%busy = .true.
        call self%simulation%look_at(t, error)
        if (.not. allocated(error)) call self%simulation%multipliers(lambda(:self%model%n_constraints()))
        call self%simulation%look_back()
        self%busy = .false.
        call self%conclude(error)
    end subroutine get_multipliers

    !> Kinetic and potential energy at the current state; the latter is 0 where the model gives none.
    subroutine get_energies(self, kinetic, potential)
        class(problem_type), intent(inout) :: self
        real(wp), intent(out) :: kinetic, potential
        type(error_type), allocatable :: error
        integer :: stat

        kinetic = 0.0_wp
        potential = 0.0_wp
        if (.not. self%is_running()) return
        self%busy = .true.
        call self%simulation%look_back()
        call self%simulation%kinetic_energy(kinetic, stat)
        if (stat == 0 .and. associated(self%model%potential_energy)) then
            call self%simulation%potential_energy(potential, stat)
        end if
        self%busy = .false.
        if (stat /= 0) then
            call set_error(error, merge(status_not_evaluable, status_callback_failed, stat > 0), &
                'an energy at t = '//to_text(self%simulation%state%t))
        else if (.not. (ieee_is_finite(kinetic) .and. ieee_is_finite(potential))) then
            call set_error(error, status_not_finite, 'an energy at t = '//to_text(self%simulation%state%t))
        end if
        call self%conclude(error)
    end subroutine get_energies

    !> One figure of the run.
    subroutine get_statistic(self, name, value)
        class(problem_type), intent(inout) :: self
        character(len=*), intent(in) :: name
        real(wp), intent(out) :: value
        type(error_type), allocatable :: error

        value = 0.0_wp
        if (.not. self%is_running()) return
        call get_figure(self%simulation, name, value, error)
        call self%conclude(error)
    end subroutine get_statistic

    !> How many warnings the run has so far; 0 where there is no run.
    subroutine count_warnings(self, n)
        class(problem_type), intent(inout) :: self
        integer, intent(out) :: n
        type(warning_type), allocatable :: warnings(:)

        n = 0
        if (.not. self%is_running()) return
        call find_warnings(self%simulation, warnings)
        n = size(warnings)
        call succeed(self)
    end subroutine count_warnings

    !> One of the warnings.
    subroutine get_warning(self, i, text)
        class(problem_type), intent(inout) :: self
        !> Its number, from 1 on.
        integer, intent(in) :: i
        !> Empty where there is no such warning.
        character(len=:), allocatable, intent(out) :: text
        type(warning_type), allocatable :: warnings(:)

        text = ''
        if (.not. self%is_running()) return
        call find_warnings(self%simulation, warnings)
        if (i < 1 .or. i > size(warnings)) then
            call self%refuse('there is no such warning', 'the run has '//to_text(size(warnings)))
            return
        end if
        text = trim(warnings(i)%text)
        call in_words_of(self%model%by_rows, text)
        call succeed(self)
    end subroutine get_warning

    !> All that the run remembers, as a row of numbers.
    subroutine save_state(self, words)
        class(problem_type), intent(inout) :: self
        integer(long), allocatable, intent(out) :: words(:)
        type(error_type), allocatable :: error

        if (.not. self%is_running()) return
        call self%simulation%save_state(words, error)
        call self%conclude(error)
    end subroutine save_state

    !> Take a run up that was saved, in a problem that is set up and started alike. Where that fails, it must be started anew.
    subroutine restore_state(self, words)
        class(problem_type), intent(inout) :: self
        !> What `save_state` gave.
        integer(long), intent(in) :: words(:)
        type(error_type), allocatable :: error

        if (.not. self%is_running()) return
        call self%simulation%restore_state(words, error)
        self%started = .not. allocated(error)
        call self%conclude(error)
    end subroutine restore_state

    !> Keep a message as C reads it, as far as there is room.
    subroutine set_message(self, text)
        class(problem_type), intent(inout) :: self
        character(len=*), intent(in) :: text
        integer :: i, length

        length = min(len(text), message_length)
        do i = 1, length
            self%message(i) = text(i:i)
        end do
        self%message(length + 1) = c_null_char
    end subroutine set_message
end module tandem_legacy_problem
