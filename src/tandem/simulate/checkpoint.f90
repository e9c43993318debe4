! SPDX-License-Identifier: MIT
!> Conversion of the state of a run to a row of numbers, and back, for checkpoints. Bases and factors are stored, never recomputed:
!> a recomputed basis would differ by rounding.
submodule(tandem_simulation) tandem_simulate_checkpoint
    use tandem_pack, only: pack_type
    use tandem_status, only: status_invalid_checkpoint
    implicit none (type, external)

    character(len=*), parameter :: kind_of_row = 'run'
    !> Length for two names and the text around them.
    integer, parameter :: problem_length = 2*label_length + 64

contains

    module procedure save_state
        type(pack_type) :: pack
        character(len=problem_length) :: problem

        if (.not. self%is_ready) then
            call set_error(error, status_invalid_checkpoint, 'there is no run to save', 'call initialize first')
            return
        end if
        call self%look_back()
        if (self%watch%has_to_act) then
            call set_error(error, status_invalid_checkpoint, 'an event at t = '//to_text(self%state%t)// &
                ' is pending', 'save the state after the step')
            return
        end if
        call self%tally%book_time()
        call pack%begin_writing()
        call pack_identity(self, pack, problem)
        call pack_run(self, pack)
        call pack%end_writing(kind_of_row, words)
    end procedure save_state

    module procedure restore_state
        type(pack_type) :: pack
        character(len=problem_length) :: problem

        if (.not. self%is_ready) then
            call set_error(error, status_invalid_checkpoint, 'there is no simulation to restore', 'call initialize first')
            return
        end if
        call self%look_back()
        call pack%begin_reading(kind_of_row, words, problem)
        if (problem /= '') then
            call refuse('use a state saved by save_state of this version, or restart the run')
            return
        end if
        call pack_identity(self, pack, problem)
        if (problem /= '') then
            call refuse('set up the simulation as when it was saved: the same model, options, start and events')
            return
        end if
        call pack_run(self, pack)
        call pack%end_reading()
        if (.not. pack%has_failed) return
        self%is_ready = .false.
        problem = 'its items differ from those read here'
        call refuse('make pack_state of your model and events list the same items in every call')

    contains

        subroutine refuse(advice)
            character(len=*), intent(in) :: advice

            call set_error(error, status_invalid_checkpoint, 'the state cannot be restored: '//trim(problem), advice)
        end subroutine refuse
    end procedure restore_state

    !> Data that must agree when the run is restored.
    subroutine pack_identity(self, pack, problem)
        class(simulation_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack
        !> When reading: the first difference, blank if there is none.
        character(len=*), intent(out) :: problem
        type(options_type) :: options
        character(len=label_length) :: name
        real(wp), allocatable :: scale(:), blocks(:)
        logical :: constant_mass
        integer :: sizes(5), i

        problem = ''
        associate (model => self%model)
            sizes = [model%n, model%n_holonomic, model%n_nonholonomic, self%chart%n_dropped, self%watch%n]
            name = ''
            if (allocated(model%name)) name = model%name
        end associate
        options = self%options
        call compare_text(pack, name, 'the model', problem)
        call compare(pack, sizes(1), 'coordinates', problem)
        call compare(pack, sizes(2), 'holonomic constraints', problem)
        call compare(pack, sizes(3), 'nonholonomic constraints', problem)
        call compare(pack, sizes(4), 'redundant rows', problem)
        if (problem /= '') return
        call options%pack_state(pack)
        if (self%options%first_difference(options) /= '') then
            problem = 'it was saved with a different '//trim(self%options%first_difference(options))
            return
        end if
        ! The stored mass matrix and pivots were chosen with these scales.
        scale = [real(wp) ::]
        blocks = [real(wp) ::]
        if (allocated(self%model%coordinate_scale)) scale = self%model%coordinate_scale
        if (allocated(self%model%mass_blocks)) blocks = real(self%model%mass_blocks, wp)
        call compare_numbers(pack, scale, 'scales of coordinates', problem)
        call compare_numbers(pack, blocks, 'blocks of the mass matrix', problem)
        constant_mass = self%model%constant_mass
        call pack%item(constant_mass)
        if (problem == '' .and. (constant_mass .neqv. self%model%constant_mass)) problem = 'its mass matrix is '// &
            trim(merge('constant    ', 'not constant', constant_mass))
        if (problem /= '') return
        call compare_breakpoints(pack, self%model, problem)
        if (problem /= '') return
        call compare(pack, sizes(5), 'events watched', problem)
        do i = 1, sizes(5)
            if (problem /= '') return
            name = self%watch%name(i)
            call compare_text(pack, name, 'event '//to_text(i), problem)
        end do
    end subroutine pack_identity

    !> Breakpoints that must agree, up to rounding: from the last one passed until the end of the breakpoints that one of the two
    !> models knows, for example if the end of a run was postponed. The number of the segment refers to these alone.
    subroutine compare_breakpoints(pack, model, problem)
        type(pack_type), intent(inout) :: pack
        class(model_type), intent(inout) :: model
        character(len=*), intent(inout) :: problem
        real(wp), parameter :: rounding = 1.0e-12_wp
        real(wp), allocatable :: ours(:), theirs(:), our_jumps(:), their_jumps(:)
        type(error_type), allocatable :: error
        real(wp) :: until
        integer :: first, n

        first = max(1, model%segment - 1)
        call pack%item(first)
        theirs = [real(wp) ::]
        their_jumps = [real(wp) ::]
        if (.not. pack%is_reading) then
            if (allocated(model%breakpoints)) theirs = model%breakpoints(first:)
            their_jumps = jumps_of(model, first, size(theirs))
        end if
        call pack%item(theirs)
        call pack%item(their_jumps)
        until = model%state%breakpoints_until
        call pack%item(until)
        if (.not. pack%is_reading .or. problem /= '' .or. pack%has_failed) return
        call model%know_breakpoints(first + size(theirs), error)
        if (allocated(error)) then
            problem = error%message
            return
        end if
        if (allocated(model%breakpoints)) then
            allocate (ours, source=model%breakpoints(min(first, size(model%breakpoints) + 1):))
        else
            allocate (ours(0))
        end if
        our_jumps = jumps_of(model, first, size(ours))
        until = min(until, model%state%breakpoints_until)
        n = count(ours < until)
        if (n /= count(theirs < until)) then
            problem = 'it was saved with different breakpoints'
        else if (any(abs(ours(:n) - theirs(:n)) > rounding*abs(ours(:n)))) then
            problem = 'it was saved with different breakpoints'
        else if (any(abs(our_jumps(:n) - their_jumps(:n)) > 0.0_wp)) then
            problem = 'it was saved with different jumps of nu'
        end if
    end subroutine compare_breakpoints

    !> 1 for each of n breakpoints from a given one at which nu jumps, 0 for the others.
    pure function jumps_of(model, first, n) result(jumps)
        class(model_type), intent(in) :: model
        integer, intent(in) :: first, n
        real(wp) :: jumps(n)

        jumps = 0.0_wp
        if (allocated(model%nu_jumps)) jumps = merge(1.0_wp, 0.0_wp, model%nu_jumps(first:first + n - 1))
    end function jumps_of

    !> Compare a number, which must agree.
    subroutine compare(pack, number, what, problem)
        type(pack_type), intent(inout) :: pack
        integer, intent(in) :: number
        character(len=*), intent(in) :: what
        !> Unchanged if not blank.
        character(len=*), intent(inout) :: problem
        integer :: theirs

        theirs = number
        call pack%item(theirs)
        if (problem == '' .and. theirs /= number) problem = 'it has '//to_text(theirs)//' '//what//', not '//to_text(number)
    end subroutine compare

    !> Compare numbers, which must agree.
    subroutine compare_numbers(pack, numbers, what, problem)
        type(pack_type), intent(inout) :: pack
        real(wp), intent(in) :: numbers(:)
        character(len=*), intent(in) :: what
        character(len=*), intent(inout) :: problem
        real(wp), allocatable :: theirs(:)
        logical :: differ

        allocate (theirs, source=numbers)
        call pack%item(theirs)
        if (problem /= '') return
        differ = pack%has_failed .or. size(theirs) /= size(numbers)
        if (.not. differ) differ = any(theirs > numbers .or. theirs < numbers)
        if (differ) problem = 'it was saved with different '//what
    end subroutine compare_numbers

    !> Compare a name, which must agree.
    subroutine compare_text(pack, text, what, problem)
        type(pack_type), intent(inout) :: pack
        character(len=label_length), intent(in) :: text
        character(len=*), intent(in) :: what
        character(len=*), intent(inout) :: problem
        character(len=label_length) :: theirs

        theirs = text
        call pack%item(theirs)
        if (problem == '' .and. theirs /= text) problem = what//' is "'//trim(theirs)//'" there, not "'//trim(text)//'"'
    end subroutine compare_text

    !> State of the run.
    subroutine pack_run(self, pack)
        class(simulation_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        if (self%auto%switching%is_on) call pack_stepper(self, pack)
        call self%model%pack_state(pack)
        call pack%item(self%model%segment)
        call self%state%pack_state(pack)
        ! The last step, for its dense output.
        if (.not. allocated(self%start%q)) call self%start%copy(self%state)
        if (.not. pack%is_reading) call self%part_end()
        call self%start%pack_state(pack)
        call self%next%pack_state(pack)
        self%end_is_apart = .true.
        call self%between%output%pack_state(pack)
        call self%between%control%pack_state(pack)
        call pack%item(self%between%next_look)
        call pack%item(self%last_step)
        call pack%item(self%grid_steps)
        call pack%item(self%on_grid)
        call pack%item(self%t_start)
        call pack%fixed(self%errors)
        call self%chart%pack_state(pack)
        call self%energy%pack_state(self%model, pack)
        call pack%item(self%renewal%is_done)
        call pack%item(self%renewal%reason)
        call self%lost_rank%pack_state(pack)
        call self%crossing%pack_state(pack)
        call pack_crossings(self, pack)
        call self%attempts%reach%pack_state(pack)
        call pack%item(self%attempts%cause)
        call pack%item(self%attempts%is_interrupted, self%attempts%has_failed)
        call pack%item(self%attempts%has_overlooked)
        call pack%item(self%attempts%count)
        call pack%item(self%attempts%count_of_look)
        call pack%item(self%attempts%n_collapsed)
        call pack%item(self%attempts%counted_from, self%attempts%creeps_from)
        call self%attempts%slowing%pack_state(pack)
        call self%stepper%pack_state(pack)
        call self%control%pack_state(pack)
        call self%work%pack_state(pack)
        call self%auto%stiffness%pack_state(pack)
        call self%local_error%pack_state(pack)
        call self%tally%pack_state(pack)
        call pack_warnings(self, pack)
        call pack%item(self%is_stopped)
        call pack%item(self%stopped_by)
        if (self%watch%n > 0) call pack_events(self, pack)
    end subroutine pack_run

    !> Index of the current one of two methods; when reading, activate the method before its state is read.
    subroutine pack_stepper(self, pack)
        class(simulation_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack
        logical :: is_implicit
        integer :: stat

        is_implicit = self%auto%switching%is_implicit
        call pack%item(is_implicit)
        if (is_implicit .neqv. self%auto%switching%is_implicit) call self%take_stepper(is_implicit, stat)
        self%auto%switching%is_implicit = is_implicit
        call self%auto%switching%pack_state(pack)
    end subroutine pack_stepper

    !> Warnings.
    subroutine pack_warnings(self, pack)
        class(simulation_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack
        integer :: i, n

        call pack%item(self%n_redundant)
        n = 0
        if (allocated(self%warnings)) n = size(self%warnings)
        call pack%item(n)
        if (pack%is_reading) then
            if (allocated(self%warnings)) deallocate (self%warnings)
            if (n > 0 .and. .not. pack%has_failed) allocate (self%warnings(n))
        end if
        if (.not. allocated(self%warnings)) return
        do i = 1, size(self%warnings)
            call pack%text(self%warnings(i)%text)
            call pack%item(self%warnings(i)%is_note)
        end do
    end subroutine pack_warnings

    !> Records of singular configurations that were passed.
    subroutine pack_crossings(self, pack)
        class(simulation_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack
        integer :: i

        call pack%item(self%n_crossings)
        if (pack%is_reading) then
            if (pack%has_failed) self%n_crossings = 0
            if (allocated(self%crossings)) deallocate (self%crossings)
            if (self%n_crossings > 0) allocate (self%crossings(self%n_crossings))
        end if
        do i = 1, self%n_crossings
            associate (crossing => self%crossings(i))
                call pack%item(crossing%t, crossing%t_from, crossing%t_to, crossing%error)
            end associate
        end do
    end subroutine pack_crossings

    !> Watched events, and records of past ones.
    subroutine pack_events(self, pack)
        class(simulation_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack
        integer :: i

        call self%watch%pack_state(pack)
        call pack%item(self%n_events)
        if (pack%is_reading) then
            deallocate (self%events)
            if (pack%has_failed) self%n_events = 0
            allocate (self%events(self%n_events))
        end if
        do i = 1, self%n_events
            associate (event => self%events(i))
                call pack%item(event%number)
                call pack%item(event%name)
                call pack%item(event%direction)
                call pack%item(event%t)
                call pack%item(event%q)
                call pack%item(event%qd)
            end associate
            if (pack%has_failed) return
        end do
    end subroutine pack_events
end submodule tandem_simulate_checkpoint
