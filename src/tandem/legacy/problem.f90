! SPDX-License-Identifier: MIT
!> A problem, the object of a handle of the C or Fortran 77 interface, and its operations. Every operation sets a status and a
!> message in the problem. Problems share no data.
module tandem_legacy_problem
    use tandem_error, only: error_type, set_error, to_text
    use tandem_kinds, only: long, wp
    use tandem_legacy_description, only: description_type
    use tandem_legacy_error_watch, only: error_watch_type
    use tandem_legacy_figures, only: find_warnings, get_figure
    use tandem_legacy_wording, only: in_words_of
    use tandem_simulate_warning, only: warning_type
    use tandem_simulation, only: simulation_type
    use tandem_status, only: status_callback_failed, status_not_evaluable, status_not_finite
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)
    private

    public :: problem_type

    !> Description of a problem, and its run.
    type, extends(description_type) :: problem_type
        type(simulation_type) :: simulation
        type(error_watch_type), private :: watch
    contains
        procedure :: start, integrate, step, advance
        procedure :: watch_error, estimate_error
        procedure :: get_state, show_state, get_state_at, get_multipliers, get_energies
        procedure :: get_statistic, count_events, get_event, get_stop, count_warnings, get_warning
        procedure :: save_state, restore_state
        procedure, private :: is_running
    end type problem_type

contains

    !> False, with a status, if no run has been started.
    logical function is_running(self)
        class(problem_type), intent(inout) :: self

        is_running = self%is_free()
        if (.not. is_running) return
        is_running = self%started
        if (.not. self%started) call self%refuse('no run was started since the model was created or changed', &
            'call tandem_start or TDSTRT first')
    end function is_running

    !> Start a run at (t, q, qd) with the current options.
    subroutine start(self, t, q, qd)
        class(problem_type), intent(inout) :: self
        !> Start time, coordinates and velocities (n).
        real(wp), intent(in) :: t, q(*), qd(*)
        type(error_type), allocatable :: error

        if (.not. self%is_free()) return
        self%started = .false.
        call self%watch%discard()
        call self%prepare(error)
        if (.not. allocated(error)) then
            self%busy = .true.
            call self%simulation%initialize(self%model, self%options, t, q(:self%model%n), qd(:self%model%n), error)
            self%busy = .false.
            self%started = .not. allocated(error)
            if (self%started) call self%events%watch(self%simulation)
        end if
        call self%conclude(error)
    end subroutine start

    !> Integrate to t_end, or to an event that stops the run. If t_end is the current time, no action is taken, so that loops over
    !> output times may begin with the start.
    subroutine integrate(self, t_end)
        class(problem_type), intent(inout) :: self
        real(wp), intent(in) :: t_end
        type(error_type), allocatable :: error

        if (.not. self%is_running()) return
        if (abs(t_end - self%simulation%state%t) <= 0.0_wp) then
            call self%succeed()
            return
        end if
        self%busy = .true.
        call self%simulation%look_back()
        call self%watch%integrate(self%simulation, t_end, error)
        self%busy = .false.
        call self%conclude(error)
    end subroutine integrate

    !> Perform one accepted step that does not go beyond t_limit.
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
        call self%watch%step(self%simulation, t_limit, error)
        self%busy = .false.
        call self%conclude(error)
    end subroutine step

    !> Perform at most `most` accepted steps that do not go beyond t_end, and store rows of states: at given times, or one per step.
    !> Ends early at an event that stops the run, and when all rows are used; if there are no rows, continues to t_end. After a
    !> failure, the results contain all states reached before it.
    subroutine advance(self, t_end, most, at_steps, rows, times, q, qd, qdd)
        class(problem_type), intent(inout) :: self
        real(wp), intent(in) :: t_end
        integer, intent(in) :: most
        !> True to store a row for each step, and its time; false to store rows at given increasing times.
        logical, intent(in) :: at_steps
        !> Number of available rows on entry; number of stored rows on return.
        integer, intent(inout) :: rows
        real(wp), intent(inout), optional :: times(*)
        !> Coordinates, velocities, accelerations (n, rows). The shape refers to `callbacks`, because a mechanism that is not built
        !> has no model.
        real(wp), intent(inout), optional :: q(self%callbacks%n, *), qd(self%callbacks%n, *), qdd(self%callbacks%n, *)
        type(error_type), allocatable :: error
        integer :: capacity, taken

        capacity = rows
        rows = 0
        if (.not. self%is_running()) return
        if (.not. (t_end >= self%simulation%state%t .and. ieee_is_finite(t_end))) then
            call self%refuse('the end '//to_text(t_end)//' must be finite and not before the current time '// &
                to_text(self%simulation%state%t), 'choose a later one')
            return
        end if
        self%busy = .true.
        call self%simulation%start_clock()
        call self%simulation%look_back()
        if (.not. at_steps) call store_rows()
        do taken = 1, most
            if (allocated(error) .or. .not. self%simulation%state%t < t_end) exit
            ! The next requested time may lie within the last step. Another step would overwrite its dense output.
            if (rows >= capacity .and. (at_steps .or. capacity > 0)) exit
            if (.not. at_steps .and. rows < capacity) call self%simulation%expect_look(times(rows + 1))
            call self%watch%step(self%simulation, t_end, error)
            if (allocated(error)) exit
            call store_rows()
            if (self%simulation%is_stopped) exit
        end do
        call self%simulation%stop_clock()
        self%busy = .false.
        call self%conclude(error)

    contains

        !> Store the rows whose times lie within the last step.
        subroutine store_rows()
            associate (simulation => self%simulation, n => self%model%n)
                do while (rows < capacity)
                    if (.not. at_steps) then
                        if (.not. times(rows + 1) <= simulation%state%t) exit
                        call simulation%look_at(times(rows + 1), error)
                        if (allocated(error)) exit
                    end if
                    rows = rows + 1
                    if (at_steps) times(rows) = simulation%state%t
                    if (present(q)) q(:, rows) = simulation%state%q
                    if (present(qd)) qd(:, rows) = simulation%state%qd
                    if (present(qdd)) qdd(:, rows) = simulation%state%qdd
                    if (at_steps) exit
                    call simulation%look_back()
                end do
            end associate
        end subroutine store_rows
    end subroutine advance

    !> Begin to record the run, which must be at its start, for an estimate of its error at t_end.
    subroutine watch_error(self, t_end)
        class(problem_type), intent(inout) :: self
        real(wp), intent(in) :: t_end
        type(error_type), allocatable :: error

        if (.not. self%is_running()) return
        call self%watch%begin(self%simulation, t_end, error)
        call self%conclude(error)
    end subroutine watch_error

    !> Estimate the error of the recorded run by a second one.
    subroutine estimate_error(self)
        class(problem_type), intent(inout) :: self
        type(error_type), allocatable :: error

        if (.not. self%is_running()) return
        self%busy = .true.
        call self%watch%estimate(self%model, self%simulation, error)
        self%busy = .false.
        call self%conclude(error)
    end subroutine estimate_error

    !> Return the state at the end of the last accepted step, or at the start. Absent arguments are not set.
    subroutine get_state(self, t, q, qd, qdd)
        class(problem_type), intent(inout) :: self
        real(wp), intent(out), optional :: t
        !> Coordinates, velocities, accelerations (n).
        real(wp), intent(inout), optional :: q(*), qd(*), qdd(*)

        if (.not. self%is_running()) return
        if (present(t)) t = self%simulation%state%t
        call copy_state(self, q, qd, qdd)
        call self%succeed()
    end subroutine get_state

    !> Return the current state, if there is one, without changing the status: the state that was reached before a failure.
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

    !> Return the state at a time within the last step.
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

    !> Return the multipliers at a time within the last step, holonomic rows first.
    subroutine get_multipliers(self, t, lambda)
        class(problem_type), intent(inout) :: self
        real(wp), intent(in) :: t
        !> Multipliers (nh + nd).
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

    !> Return the kinetic and potential energy at the current state; the latter is 0 if the model has none.
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
        if (stat == 0 .and. associated(self%model%potential_energy)) call self%simulation%potential_energy(potential, stat)
        self%busy = .false.
        if (stat /= 0) then
            call set_error(error, merge(status_not_evaluable, status_callback_failed, stat > 0), &
                'an energy at t = '//to_text(self%simulation%state%t))
        else if (.not. (ieee_is_finite(kinetic) .and. ieee_is_finite(potential))) then
            call set_error(error, status_not_finite, 'an energy at t = '//to_text(self%simulation%state%t))
        end if
        call self%conclude(error)
    end subroutine get_energies

    !> Return one statistic of the run.
    subroutine get_statistic(self, name, value)
        class(problem_type), intent(inout) :: self
        character(len=*), intent(in) :: name
        real(wp), intent(out) :: value
        type(error_type), allocatable :: error

        value = 0.0_wp
        if (.not. self%is_running()) return
        call get_figure(self%simulation, self%watch%global_error, name, value, error)
        call self%conclude(error)
    end subroutine get_statistic

    !> Return the number of events recorded so far.
    subroutine count_events(self, n)
        class(problem_type), intent(inout) :: self
        integer, intent(out) :: n

        n = 0
        if (.not. self%is_running()) return
        n = self%simulation%n_events
        call self%succeed()
    end subroutine count_events

    !> Return one of the recorded events. Absent arguments are not set.
    subroutine get_event(self, i, number, direction, t, q, qd)
        class(problem_type), intent(inout) :: self
        !> Index in the order of time, from 1.
        integer, intent(in) :: i
        !> Index of the event from 1, and direction: 1, -1, or 0 if its function touched zero or was zero at the start.
        integer, intent(out) :: number, direction
        real(wp), intent(out) :: t
        !> Coordinates and velocities (n).
        real(wp), intent(inout), optional :: q(*), qd(*)

        number = 0
        direction = 0
        t = 0.0_wp
        if (.not. self%is_running()) return
        if (i < 1 .or. i > self%simulation%n_events) then
            call self%refuse('there is no such event', 'the run has recorded '//to_text(self%simulation%n_events))
            return
        end if
        associate (event => self%simulation%events(i), n => self%model%n)
            number = event%number
            direction = event%direction
            t = event%t
            if (present(q)) q(:n) = event%q
            if (present(qd)) qd(:n) = event%qd
        end associate
        call self%succeed()
    end subroutine get_event

    !> Return the index of the event that has stopped the run at its current state.
    subroutine get_stop(self, number)
        class(problem_type), intent(inout) :: self
        !> Index from 1; 0 if no event has stopped the run.
        integer, intent(out) :: number

        number = 0
        if (.not. self%is_running()) return
        number = self%events%stopped_by(self%simulation)
        call self%succeed()
    end subroutine get_stop

    !> Return the number of warnings so far; 0 without a run.
    subroutine count_warnings(self, n)
        class(problem_type), intent(inout) :: self
        integer, intent(out) :: n
        type(warning_type), allocatable :: warnings(:)

        n = 0
        if (.not. self%is_running()) return
        call find_warnings(self%simulation, self%watch, warnings)
        n = size(warnings)
        call self%succeed()
    end subroutine count_warnings

    !> Return one of the warnings.
    subroutine get_warning(self, i, text)
        class(problem_type), intent(inout) :: self
        !> Index of the warning, from 1.
        integer, intent(in) :: i
        !> Text; empty if there is no such warning.
        character(len=:), allocatable, intent(out) :: text
        type(warning_type), allocatable :: warnings(:)

        text = ''
        if (.not. self%is_running()) return
        call find_warnings(self%simulation, self%watch, warnings)
        if (i < 1 .or. i > size(warnings)) then
            call self%refuse('there is no such warning', 'the run has '//to_text(size(warnings)))
            return
        end if
        text = trim(warnings(i)%text)
        call in_words_of(self%callbacks%by_rows, text)
        call self%succeed()
    end subroutine get_warning

    !> Save the state of the run as an array of numbers.
    subroutine save_state(self, words)
        class(problem_type), intent(inout) :: self
        integer(long), allocatable, intent(out) :: words(:)
        type(error_type), allocatable :: error

        if (.not. self%is_running()) return
        call self%simulation%save_state(words, error)
        call self%conclude(error)
    end subroutine save_state

    !> Restore a saved run in a problem with the same definition and start. After a failure the run must be started again.
    subroutine restore_state(self, words)
        class(problem_type), intent(inout) :: self
        !> Result of `save_state`.
        integer(long), intent(in) :: words(:)
        type(error_type), allocatable :: error

        if (.not. self%is_running()) return
        call self%watch%discard()
        call self%simulation%restore_state(words, error)
        self%started = .not. allocated(error)
        call self%conclude(error)
    end subroutine restore_state
end module tandem_legacy_problem
