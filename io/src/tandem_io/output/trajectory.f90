! SPDX-License-Identifier: MIT
!> The observer that writes a result file: /trajectory and /diagnostics row by row, /report at the end (see doc/output.md).
!>
!> Rows are gathered in memory and written to the disk in blocks, at the latest a second later. Written rows are not lost, however
!> the program ends. A field that was not requested is neither computed nor written.
module tandem_io_output_trajectory
    use tandem, only: at_end, at_event, at_start, at_step, error_type, global_error_type, label_length, long, mark_type, &
        model_type, observer_type, pack_type, part_blocks, part_checkpoint, profile_type, set_error, simulation_type, &
        status_output_failed, to_text, wp
    use tandem_fletcher, only: fletcher_type
    use tandem_io_output_checkpoint, only: checkpoint_type, snapshot_type
    use tandem_io_output_checksums, only: checksums_type, examine, finding_type
    use tandem_io_output_crossings, only: write_crossings
    use tandem_io_output_drawing, only: put_drawing, renew_drawing
    use tandem_io_output_events, only: event_output_type, event_paths
    use tandem_io_output_fields, only: field_kinetic_energy, field_potential_energy, field_q, field_qd, fields, index_of, &
        output_type
    use tandem_io_output_guard, only: claim_type
    use tandem_io_output_hdf5, only: hdf5_type
    use tandem_io_output_profile, only: write_profile
    use tandem_io_output_report, only: write_global_error, write_report
    use tandem_io_output_series, only: label_columns, series_type, width_of
    use tandem_io_output_target, only: check_target, in_use, remove_file
    use tandem_io_path, only: is_regular
    use tandem_status, only: status_interrupted, status_invalid_checkpoint, status_invalid_option
    implicit none (type, external)
    private

    public :: trajectory_type, energy_type

    !> Largest number of numbers in the row buffer, and largest and smallest number of rows. The lower limit exists because each
    !> dataset is written by a separate call, which costs far more than the numbers of a row.
    integer, parameter :: largest_buffer = 2**22, most_rows = 4096, least_rows = 16
    !> Rows per chunk of the file. A chunk is stored completely even for a single row. Largest number of rows, approximate number of
    !> numbers in the chunks of all datasets, and smallest number of rows if `spacing` produces some hundred rows in every run.
    integer, parameter :: longest_chunk = 512, numbers_in_chunks = 2**17, least_chunk = 128
    !> Bytes for the attributes of the report: twice their size without the warnings of the start, which leaves room for the few
    !> warnings of a run; bytes per warning of the start; and upper limit.
    integer, parameter :: room = 8192, room_for_warning = 16, most_room = 60000
    !> Largest number of warnings added with the report.
    integer, parameter :: most_late_warnings = 8
    !> Largest number of steps between readings of the clock if steps take less than a millisecond; a reading costs more than a row.
    integer, parameter :: most_clock_interval = 16

    !> Change of a written energy since the start.
    type :: energy_type
        !> True if the kinetic energy was written; true if the potential energy was written.
        logical :: has_kinetic = .false., has_potential = .false.
        !> Energy at the start; largest deviation from it at the written rows.
        real(wp) :: at_start = 0.0_wp, deviation = 0.0_wp
    end type energy_type

    type, extends(observer_type) :: trajectory_type
        !> The energy at the rows.
        type(energy_type) :: energy
        !> Number of rows in the file.
        integer(long) :: rows = 0
        !> Profile to which the time of writing is added, if any.
        type(profile_type), pointer :: profile => null()
        type(hdf5_type), private :: file
        type(claim_type), private :: file_claim
        !> Checkpoint, its contents and the time of its last writing. The error estimator observes the run too; its state is saved
        !> as well.
        type(checkpoint_type), private :: checkpoint
        type(checksums_type), private :: checksums
        type(snapshot_type), private :: snapshot
        type(pack_type), private :: pack
        integer(long), private :: saved_at = 0
        real(wp), private :: seconds_unflushed = 1.0_wp
        !> Steps since the last reading of the clock, steps between readings, and the last reading.
        integer, private :: steps_since_clock = 0, clock_interval = 1
        integer(long), private :: clock_read_at = 0
        class(global_error_type), pointer, private :: watcher => null()
        !> End of the last step whose intermediate rows have been gathered.
        real(wp), private :: spaced_until = -huge(1.0_wp)
        !> True if the state lies within a step.
        logical, private :: is_between = .false.
        !> True until a resumed run starts: its first row exists already.
        logical, private :: is_resumed = .false.
        !> True if `add_error` or `add_profile` may follow `close`; the file then stays locked until `release`.
        logical, private :: more_follows = .false.
        type(event_output_type), private :: events
        type(series_type), allocatable, private :: series(:)
        integer, private :: every = 1, capacity = 1, gathered = 0
        !> Values of the model's quantities, one after the other.
        real(wp), allocatable, private :: quantities(:)
        !> Multipliers and integrands of the model's integrals, and the time up to which the integrals are computed.
        real(wp), allocatable, private :: lambda(:), rates(:)
        real(wp), private :: integrated_until = 0.0_wp
        real(wp), private :: last_time = 0.0_wp, interval = 0.0_wp, spacing = 0.0_wp, first_time = 0.0_wp
        !> Number of rows due to `interval` so far.
        integer(long), private :: intervals = 0
        character(len=:), allocatable, private :: path
    contains
        procedure :: claim, open, resume, observe, close, add_error, add_profile, release
        procedure, private :: gather, gather_between, gather_spaced, measure, integrate, write_rows, write_to_disk
        procedure, private :: save_if_due, save, save_simulation, close_datasets, prepare, set_file_error
    end type trajectory_type

    interface
        !> Compute the fields of the current state and store them as a row in the buffer.
        module subroutine gather(self, simulation, error)
            implicit none (type, external)
            class(trajectory_type), intent(inout) :: self
            class(simulation_type), intent(inout) :: simulation
            type(error_type), allocatable, intent(out) :: error
        end subroutine gather

        !> Evaluate the quantities of the model at the current state.
        module subroutine measure(self, simulation, error)
            implicit none (type, external)
            class(trajectory_type), intent(inout) :: self
            class(simulation_type), intent(inout) :: simulation
            type(error_type), allocatable, intent(out) :: error
        end subroutine measure

        !> Advance the integrals of the model to the current time, which is within the last step.
        module subroutine integrate(self, simulation, error)
            implicit none (type, external)
            class(trajectory_type), intent(inout) :: self
            class(simulation_type), intent(inout) :: simulation
            type(error_type), allocatable, intent(out) :: error
        end subroutine integrate

        !> Gather rows within the last step at the smallest number of equal distances that do not exceed `spacing`. A time at which
        !> the model cannot be evaluated is omitted, because no row was requested there.
        module subroutine gather_spaced(self, simulation)
            implicit none (type, external)
            class(trajectory_type), intent(inout) :: self
            class(simulation_type), intent(inout) :: simulation
        end subroutine gather_spaced

        !> Gather rows at the multiples of `interval` within the last step.
        module subroutine gather_between(self, simulation, error, is_before_event)
            implicit none (type, external)
            class(trajectory_type), intent(inout) :: self
            class(simulation_type), intent(inout) :: simulation
            type(error_type), allocatable, intent(out) :: error
            !> True to exclude the end of the step, whose row is gathered after the event has changed the state.
            logical, intent(in) :: is_before_event
        end subroutine gather_between

        !> Write the rows of the buffer.
        module subroutine write_rows(self)
            implicit none (type, external)
            class(trajectory_type), intent(inout) :: self
        end subroutine write_rows
    end interface

    interface
        !> Create the groups of the quantities.
        module subroutine add_groups(file, model)
            implicit none (type, external)
            type(hdf5_type), intent(inout) :: file
            class(model_type), intent(in) :: model
        end subroutine add_groups

        !> Write the attributes of the root.
        module subroutine attach_head(file, scene, command)
            implicit none (type, external)
            type(hdf5_type), intent(inout) :: file
            character(len=*), intent(in), optional :: scene, command
        end subroutine attach_head

        !> Reset the outcome in the file of a resumed run, and delete the old report. The message is always written: readers may be
        !> unable to read a text that was being written when the program was killed.
        module subroutine reset_outcome(file, scene)
            implicit none (type, external)
            type(hdf5_type), intent(inout) :: file
            character(len=*), intent(in) :: scene
        end subroutine reset_outcome

        !> The local time as ISO 8601.
        module function time_stamp() result(text)
            implicit none (type, external)
            character(len=25) :: text
        end function time_stamp
    end interface

contains

    !> Claim an existing file before it is read and changed; this excludes other processes until `release`.
    subroutine claim(self, path, error)
        class(trajectory_type), intent(inout) :: self
        character(len=*), intent(in) :: path
        !> Set if another process is writing the file.
        type(error_type), allocatable, intent(out) :: error
        logical :: is_refused

        if (.not. is_regular(path)) return
        call self%file_claim%make(path, is_refused)
        if (is_refused) call set_error(error, status_output_failed, 'cannot write '//path//': '//in_use, &
            'wait until that process ends, or choose another file')
    end subroutine claim

    !> Create the file for an initialized simulation. After an error no file is left behind.
    subroutine open(self, output, simulation, error, scene, command, force, watcher)
        class(trajectory_type), intent(inout) :: self
        !> Fields and file to write.
        type(output_type), intent(in) :: output
        class(simulation_type), intent(in) :: simulation
        type(error_type), allocatable, intent(out) :: error
        !> The complete scene and the command line, for the file.
        character(len=*), intent(in), optional :: scene, command
        !> True if an existing file may be overwritten.
        logical, intent(in), optional :: force
        !> Error estimator that observes the run and is saved with it; must outlive the run.
        class(global_error_type), intent(inout), optional, target :: watcher
        logical :: is_new, force_
        integer :: n_warnings

        force_ = .false.
        if (present(force)) force_ = force
        if (output%problem(simulation%model) /= '') then
            call set_error(error, status_invalid_option, 'the fields '//output%problem(simulation%model), 'remove it')
            return
        end if
        call check_target(output%file, force_, is_new, error)
        if (.not. allocated(error)) call self%claim(output%file, error)
        if (allocated(error)) return
        self%path = output%file
        self%first_time = simulation%state%t
        self%snapshot = snapshot_type()
        if (present(scene)) self%snapshot%scene = scene
        nullify (self%watcher)
        if (present(watcher)) self%watcher => watcher
        call self%file%create(self%path, count_datasets(output, simulation%model))
        call attach_head(self%file, scene, command)
        call self%file%add_group('/trajectory')
        call self%file%add_group('/diagnostics')
        call self%file%add_group('/report')
        n_warnings = most_late_warnings
        if (allocated(simulation%warnings)) n_warnings = most_late_warnings + min(size(simulation%warnings), most_room)
        call self%file%reserve('/report', min(room + room_for_warning*n_warnings, most_room), &
            'cost and errors of the run, written when the status is not "running"')
        call self%checkpoint%make(self%file)
        call self%prepare(output, simulation)
        call open_events(self, simulation)
        call put_drawing(self%file, simulation%model)
        call self%checksums%make(self%file, checksum_paths(self, simulation))
        call self%checksums%write_text_checksum(self%file)
        ! This text must come after all others, which would otherwise occupy the reserved space.
        call self%file%reserve_text('/', 'status_message')
        call self%file%start_appending(self%path)
        if (allocated(self%file%problem)) then
            call self%set_file_error(error)
            call self%file%close()
            if (is_new) call remove_file(self%path)
            call self%file_claim%drop()
        end if
    end subroutine open

    !> Continue the file of an interrupted run, for a simulation restored from the same snapshot. Later rows are removed.
    subroutine resume(self, output, simulation, snapshot, scene, error, watcher)
        class(trajectory_type), intent(inout) :: self
        !> Output settings of the interrupted run, with the present path of the file.
        type(output_type), intent(in) :: output
        class(simulation_type), intent(in) :: simulation
        type(snapshot_type), intent(in) :: snapshot
        !> The complete scene, whose end time may have changed.
        character(len=*), intent(in) :: scene
        type(error_type), allocatable, intent(out) :: error
        !> As for `open`; restored as well.
        class(global_error_type), intent(inout), target :: watcher
        type(finding_type) :: finding
        integer :: i

        self%path = output%file
        self%snapshot = snapshot
        self%snapshot%scene = scene
        self%snapshot%times_resumed = snapshot%times_resumed + 1
        self%watcher => watcher
        self%is_resumed = .true.
        call self%file%open_to_append(self%path, count_datasets(output, simulation%model))
        call self%checkpoint%reopen(self%file, snapshot)
        call self%prepare(output, simulation)
        call self%events%reopen(self%file, simulation)
        do i = 0, ubound(self%series, 1)
            if (self%file%rows_of(self%series(i)%dataset) >= snapshot%rows .or. allocated(self%file%problem)) cycle
            call refuse('rows of '//self%series(i)%path//' are missing')
            return
        end do
        ! The complete file is examined before any part of it is changed.
        call examine(self%file, finding, snapshot%rows, snapshot%events)
        if (finding%problem == '' .and. finding%has_checksums) then
            if (finding%names /= checksum_paths(self, simulation)) finding%problem = 'its checksums are those of another run'
        end if
        if (finding%problem /= '') then
            call refuse('it is damaged: '//finding%problem)
            return
        end if
        call self%checksums%reopen(self%file, finding)
        if (finding%has_checksums) call set_checksums(self, finding%sums)
        if (snapshot%scene /= scene) call renew_drawing(self%file, simulation%model)
        call self%file%start_appending(self%path)
        call self%file%attach('/', 'status', 'running')
        ! The last written checksums include the rows that are removed below, and must be replaced first.
        call self%checksums%write(self%file, snapshot%rows, snapshot%events, checksums_of(self))
        call self%file%flush()
        do i = 0, ubound(self%series, 1)
            call self%file%cut(self%series(i)%dataset, self%series(i)%path, self%series(i)%width, snapshot%rows)
        end do
        call self%events%cut(self%file, simulation%model%n, snapshot%events)
        call self%file%flush()
        call reset_outcome(self%file, scene)
        if (finding%has_text_checksum) call self%checksums%write_text_checksum(self%file)
        call system_clock(self%saved_at)
        self%rows = snapshot%rows
        self%first_time = snapshot%first_time
        self%last_time = snapshot%last_time
        self%intervals = snapshot%intervals
        self%energy%at_start = snapshot%energy(1)
        self%energy%deviation = snapshot%energy(2)
        if (.not. allocated(self%file%problem)) return
        call self%set_file_error(error)
        if (snapshot%status /= '') call self%file%replace_text(self%path, 'status', snapshot%status)
        call self%file%close()

    contains

        subroutine refuse(reason)
            character(len=*), intent(in) :: reason

            call set_error(error, status_invalid_checkpoint, 'cannot resume from '//self%path//': '//reason)
            call self%close_datasets()
            call self%file%close()
            call self%file_claim%drop()
        end subroutine refuse
    end subroutine resume

    !> Number of datasets that grow with the rows.
    pure integer function count_datasets(output, model)
        type(output_type), intent(in) :: output
        class(model_type), intent(in) :: model

        count_datasets = 1 + size(output%fields)
        if (allocated(model%quantities)) count_datasets = count_datasets + size(model%quantities)
    end function count_datasets

    !> Paths of the datasets with checksums, separated by blanks.
    function checksum_paths(self, simulation) result(paths)
        class(trajectory_type), intent(in) :: self
        class(simulation_type), intent(in) :: simulation
        character(len=:), allocatable :: paths
        integer :: i, n

        n = sum([(len(self%series(i)%path) + 1, i=0, ubound(self%series, 1))]) - 1
        if (allocated(simulation%events)) n = n + 1 + len(event_paths)
        allocate (character(len=n) :: paths)
        paths(:) = self%series(0)%path
        n = len(self%series(0)%path)
        do i = 1, ubound(self%series, 1)
            paths(n + 2:n + 1 + len(self%series(i)%path)) = self%series(i)%path
            n = n + 1 + len(self%series(i)%path)
        end do
        if (allocated(simulation%events)) paths(n + 2:) = event_paths
    end function checksum_paths

    !> Checksums of the datasets; those of events come last, and are empty without events.
    pure function checksums_of(self) result(sums)
        class(trajectory_type), intent(in) :: self
        type(fletcher_type) :: sums(size(self%series) + merge(size(self%events%sums), 0, self%events%is_open))
        integer :: i

        do i = 1, size(self%series)
            sums(i) = self%series(i - 1)%sum
        end do
        do i = 1, size(sums) - size(self%series)
            sums(size(self%series) + i) = self%events%sums(i)
        end do
    end function checksums_of

    !> Set the checksums of the datasets.
    subroutine set_checksums(self, sums)
        class(trajectory_type), intent(inout) :: self
        type(fletcher_type), intent(in) :: sums(:)
        integer :: i

        do i = 1, size(self%series)
            self%series(i - 1)%sum = sums(i)
        end do
        do i = 1, size(sums) - size(self%series)
            self%events%sums(i) = sums(size(self%series) + i)
        end do
    end subroutine set_checksums

    !> Common part of `open` and `resume`: the datasets of the rows and their buffers.
    subroutine prepare(self, output, simulation)
        class(trajectory_type), intent(inout) :: self
        type(output_type), intent(in) :: output
        class(simulation_type), intent(in) :: simulation
        integer :: i, n, n_fields, width, chunk

        self%every = output%every
        self%interval = output%interval
        self%spacing = output%spacing
        self%spaced_until = -huge(1.0_wp)
        self%intervals = 0
        self%seconds_unflushed = output%flush
        associate (model => simulation%model)
            width = 1
            n_fields = size(output%fields)
            do i = 1, n_fields
                width = width + width_of(index_of(output%fields(i)), model)
            end do
            n = 0
            allocate (self%quantities(0))
            if (allocated(model%quantities)) then
                n = size(model%quantities)
                self%quantities = [(0.0_wp, i=1, sum(max(1, model%quantities%width)))]
            end if
            width = width + size(self%quantities)
            self%lambda = [(0.0_wp, i=1, merge(model%n_constraints(), 0, model%measures_multipliers))]
            self%rates = [real(wp) ::]
            if (allocated(model%state%integrals)) self%rates = 0*model%state%integrals
            self%integrated_until = simulation%state%t
            if (.not. self%is_resumed) call begin_measuring(self, simulation)
            self%capacity = max(least_rows, min(most_rows, largest_buffer/width))
            chunk = max(merge(least_chunk, least_rows, self%spacing > 0.0_wp), min(longest_chunk, numbers_in_chunks/width))
            allocate (self%series(0:n_fields + n))
            call self%series(0)%make(self%file, 0, model, self%capacity, chunk, self%is_resumed)
            do i = 1, n_fields
                call self%series(i)%make(self%file, index_of(output%fields(i)), model, self%capacity, chunk, self%is_resumed, &
                    self%series(0)%dataset)
            end do
            if (.not. self%is_resumed) call add_groups(self%file, model)
            do i = 1, n
                call self%series(n_fields + i)%make(self%file, -i, model, self%capacity, chunk, self%is_resumed, &
                    self%series(0)%dataset)
            end do
            if (.not. self%is_resumed) call self%file%list_users(self%series(0)%dataset, self%series(0)%path, &
                [(self%series(i)%dataset, i=1, n_fields + n)])
        end associate
        self%energy%has_kinetic = output%asks_for(field_kinetic_energy)
        self%energy%has_potential = output%asks_for(field_potential_energy)
    end subroutine prepare

    !> Pass the start to the model before its quantities are evaluated.
    subroutine begin_measuring(self, simulation)
        class(trajectory_type), intent(inout) :: self
        class(simulation_type), intent(in) :: simulation
        integer :: stat

        associate (model => simulation%model, state => simulation%state)
            ! After a failure, which is ignored, quantities without a unique value are not marked as such.
            call model%begin_measuring(state%t, state%q, state%qd, self%lambda, stat)
        end associate
    end subroutine begin_measuring

    !> Write rows at the start and at the end of a run. In between, write rows at every `every`-th step of the grid, at multiples of
    !> `interval`, or at all steps and at intermediate times according to `spacing`. Before an event changes the motion, write the
    !> rows up to the event.
    subroutine observe(self, simulation, occasion, error)
        class(trajectory_type), intent(inout) :: self
        class(simulation_type), intent(inout) :: simulation
        !> `at_start`, `at_step`, `at_end` or `at_event`.
        integer, intent(in) :: occasion
        type(error_type), allocatable, intent(out) :: error
        logical :: is_due

        if (allocated(self%file%problem)) return
        select case (occasion)
        case (at_start)
            is_due = .not. self%is_resumed
            self%is_resumed = .false.
        case (at_end)
            ! A row due only to the end of the run is not part of the run if it is resumed: save the state first.
            call self%save(simulation)
            is_due = simulation%state%t > self%last_time
        case (at_event)
            is_due = .false.
            if (self%interval > 0.0_wp) call self%gather_between(simulation, error, .true.)
            if (self%spacing > 0.0_wp) call self%gather_spaced(simulation)
            if (.not. allocated(error) .and. size(self%rates) > 0) call self%integrate(simulation, error)
            if (allocated(error)) return
        case default
            is_due = .not. self%interval > 0.0_wp .and. simulation%on_grid .and. &
                mod(simulation%grid_steps, int(self%every, long)) == 0 .or. self%spacing > 0.0_wp
            if (self%interval > 0.0_wp) call self%gather_between(simulation, error, .false.)
            if (self%spacing > 0.0_wp) call self%gather_spaced(simulation)
            if (.not. allocated(error) .and. .not. is_due .and. simulation%model%measures_every_step) then
                call self%measure(simulation, error)
            else if (.not. allocated(error) .and. size(self%rates) > 0) then
                call self%integrate(simulation, error)
            end if
            if (allocated(error)) return
        end select
        if (is_due) then
            call self%gather(simulation, error)
            if (allocated(error)) return
            if (self%gathered == self%capacity) call self%write_to_disk(simulation)
        end if
        call announce_next_time(self, simulation)
        if (occasion == at_start) call self%save(simulation)
        if (occasion == at_step) call self%save_if_due(simulation)
        if (allocated(self%file%problem)) call self%set_file_error(error)
    end subroutine observe

    !> Announce the next time between steps at which rows or integrals are evaluated.
    subroutine announce_next_time(self, simulation)
        class(trajectory_type), intent(in) :: self
        class(simulation_type), intent(inout) :: simulation

        if (size(self%rates) > 0) call simulation%expect_look(simulation%state%t)
        if (self%interval > 0.0_wp) call simulation%expect_look(self%first_time + real(self%intervals + 1, wp)*self%interval)
        if (self%spacing > 0.0_wp) call simulation%expect_look(simulation%state%t + self%spacing)
    end subroutine announce_next_time

    !> Write the remaining rows, the report and the outcome, and close the file.
    subroutine close(self, simulation, run_error, error, more_follows)
        class(trajectory_type), intent(inout) :: self
        class(simulation_type), intent(in) :: simulation
        !> Error that ended the run; not allocated if the run was complete.
        type(error_type), allocatable, intent(in) :: run_error
        !> Set if the rows or the report could not be written.
        type(error_type), allocatable, intent(out) :: error
        !> True to keep the file locked against other writers until `release`; default false.
        logical, intent(in), optional :: more_follows
        character(len=:), allocatable :: message

        self%more_follows = .false.
        if (present(more_follows)) self%more_follows = more_follows
        call self%write_to_disk(simulation)
        if (allocated(self%series)) call self%checksums%write(self%file, self%rows, self%events%rows, checksums_of(self))
        call self%close_datasets()
        if (.not. allocated(self%file%problem)) call write_outcome(self, simulation, run_error)
        ! After the texts of the outcome, for which space is reserved.
        if (simulation%n_crossings > 0 .and. .not. allocated(self%file%problem)) then
            call self%file%reopen(self%path)
            call write_crossings(self%file, simulation%crossings(:simulation%n_crossings))
            call self%file%flush()
            call self%file%close(self%more_follows)
        end if
        if (.not. self%more_follows) call self%file_claim%drop()
        if (.not. allocated(self%file%problem)) return
        call self%set_file_error(error)
        message = error%message
        if (allocated(run_error)) message = run_error%message
        call self%file%replace_text(self%path, 'status', 'failed')
        call self%file%replace_text(self%path, 'status_message', message)
        call self%file%close()
    end subroutine close

    !> Write the report and the outcome into the file, and close it.
    subroutine write_outcome(self, simulation, run_error)
        class(trajectory_type), intent(inout) :: self
        class(simulation_type), intent(in) :: simulation
        type(error_type), allocatable, intent(in) :: run_error
        integer(long) :: status_code
        character(len=:), allocatable :: status

        if (self%snapshot%times_resumed > 0) call self%file%attach('/', 'resumed', int(self%snapshot%times_resumed, long))
        status = 'complete'
        status_code = 0
        if (allocated(run_error)) then
            status = trim(merge('interrupted', 'failed     ', run_error%stat == status_interrupted))
            status_code = run_error%stat
            call self%file%attach('/', 'status_message', run_error%message)
        else if (simulation%is_stopped) then
            call self%file%attach('/', 'status_message', 'stopped by "'//trim(simulation%stopped_by)//'" at t = '// &
                to_text(simulation%state%t))
        end if
        call write_report(self%file, simulation)
        call self%file%flush()
        ! The outcome comes last: a file that is incomplete must not be marked complete.
        call self%file%attach('/report', 'status_code', status_code)
        call self%file%attach('/', 'status', status)
        call self%file%flush()
        call self%file%close(self%more_follows .or. simulation%n_crossings > 0)
    end subroutine write_outcome

    !> Write the global error of the run into the file after `close`.
    subroutine add_error(self, simulation, global_error, error)
        class(trajectory_type), intent(inout) :: self
        class(simulation_type), intent(in) :: simulation
        class(global_error_type), intent(in) :: global_error
        type(error_type), allocatable, intent(out) :: error

        if (.not. global_error%is_known) return
        call self%file%reopen(self%path)
        call write_global_error(self%file, simulation, global_error)
        call self%file%flush()
        call self%file%close(self%more_follows)
        if (allocated(self%file%problem)) call self%set_file_error(error)
    end subroutine add_error

    !> Write the profile of the run into the file after `close`.
    subroutine add_profile(self, profile, error)
        class(trajectory_type), intent(inout) :: self
        type(profile_type), intent(in) :: profile
        type(error_type), allocatable, intent(out) :: error

        call self%file%reopen(self%path)
        call write_profile(self%file, profile)
        call self%file%flush()
        call self%file%close(self%more_follows)
        if (allocated(self%file%problem)) call self%set_file_error(error)
    end subroutine add_profile

    !> Unlock the file for other writers.
    subroutine release(self)
        class(trajectory_type), intent(inout) :: self

        self%more_follows = .false.
        call self%file%unlock()
        call self%file_claim%drop()
    end subroutine release

    !> Close all datasets.
    subroutine close_datasets(self)
        class(trajectory_type), intent(inout) :: self
        integer :: i

        call self%events%close(self%file)
        call self%checkpoint%close(self%file)
        call self%checksums%close(self%file)
        if (.not. allocated(self%series)) return
        do i = lbound(self%series, 1), ubound(self%series, 1)
            call self%file%close_dataset(self%series(i)%dataset)
        end do
        deallocate (self%series)
    end subroutine close_datasets

    !> Create the group of events.
    subroutine open_events(self, simulation)
        class(trajectory_type), intent(inout) :: self
        class(simulation_type), intent(in) :: simulation
        character(len=label_length), allocatable :: names(:), q_units(:), qd_units(:)

        call label_columns(simulation%model, fields(field_q), names, q_units)
        call label_columns(simulation%model, fields(field_qd), names, qd_units)
        call self%events%open(self%file, simulation, names, q_units, qd_units)
    end subroutine open_events

    !> Write gathered rows and events to the disk.
    subroutine write_to_disk(self, simulation)
        class(trajectory_type), intent(inout) :: self
        class(simulation_type), intent(in) :: simulation
        type(mark_type) :: mark

        if (associated(self%profile)) call self%profile%enter(part_blocks, mark)
        call self%write_rows()
        call self%events%append(self%file, simulation)
        call self%file%flush()
        if (associated(self%profile)) call self%profile%leave(mark)
    end subroutine write_to_disk

    !> Save the state if the last save was more than `seconds_unflushed` ago.
    subroutine save_if_due(self, simulation)
        class(trajectory_type), intent(inout) :: self
        class(simulation_type), intent(inout) :: simulation
        integer(long) :: now, rate

        self%steps_since_clock = self%steps_since_clock + 1
        if (self%steps_since_clock < self%clock_interval) return
        call system_clock(now, rate)
        self%clock_interval = merge(min(2*self%clock_interval, most_clock_interval), 1, &
            1000*(now - self%clock_read_at) < rate .and. self%seconds_unflushed > 0.0_wp)
        self%steps_since_clock = 0
        self%clock_read_at = now
        if (real(now - self%saved_at, wp) >= self%seconds_unflushed*real(rate, wp)) call self%save(simulation)
    end subroutine save_if_due

    !> Write the rows, then the state of the run, to the disk.
    subroutine save(self, simulation)
        class(trajectory_type), intent(inout) :: self
        class(simulation_type), intent(inout) :: simulation
        type(mark_type) :: mark

        call system_clock(self%saved_at)
        call self%write_to_disk(simulation)
        if (associated(self%profile)) call self%profile%enter(part_checkpoint, mark)
        call self%save_simulation(simulation)
        if (associated(self%profile)) call self%profile%leave(mark)
    end subroutine save

    !> Write the state of the run to the disk, after its rows.
    subroutine save_simulation(self, simulation)
        class(trajectory_type), intent(inout) :: self
        class(simulation_type), intent(inout) :: simulation
        type(error_type), allocatable :: error

        ! Between an event and its action, no state can be saved; the previous one remains valid.
        call simulation%save_state(self%snapshot%simulation, error)
        if (allocated(error)) return
        self%snapshot%rows = self%rows
        self%snapshot%events = self%events%rows
        self%snapshot%intervals = self%intervals
        self%snapshot%first_time = self%first_time
        self%snapshot%last_time = self%last_time
        self%snapshot%energy = [self%energy%at_start, self%energy%deviation]
        if (associated(self%watcher)) then
            call self%pack%begin_writing()
            call self%watcher%pack_state(self%pack)
            call self%pack%end_writing('watcher', self%snapshot%watcher)
        end if
        ! Checksums are written first, so that the saved state never refers to rows without checksums.
        call self%checksums%write(self%file, self%rows, self%events%rows, checksums_of(self))
        call self%checkpoint%write(self%file, self%snapshot)
        call self%file%flush()
    end subroutine save_simulation

    !> Convert the problem of the file to an error.
    subroutine set_file_error(self, error)
        class(trajectory_type), intent(in) :: self
        type(error_type), allocatable, intent(out) :: error

        call set_error(error, status_output_failed, self%path//': '//self%file%problem)
    end subroutine set_file_error
end module tandem_io_output_trajectory
