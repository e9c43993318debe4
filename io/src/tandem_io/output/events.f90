! SPDX-License-Identifier: MIT
!> The group /events of a result file: one row per event (see doc/output.md). Only runs with events have it.
module tandem_io_output_events
    use hdf5, only: hid_t
    use tandem, only: label_length, long, simulation_type, wp
    use tandem_fletcher, only: fletcher_type
    use tandem_io_output_hdf5, only: hdf5_type
    implicit none (type, external)
    private

    public :: event_output_type, event_paths

    character(len=*), parameter :: group_path = '/events'
    !> Paths of the datasets, separated by blanks, in the order of their checksums.
    character(len=*), parameter :: event_paths = group_path//'/time '//group_path//'/name '//group_path//'/number '// &
        group_path//'/direction '//group_path//'/q '//group_path//'/qd'
    !> Rows per chunk of the file, and largest number of rows written at once.
    integer, parameter :: chunk = 64

    type :: event_output_type
        integer(hid_t), private :: time = -1_hid_t, name = -1_hid_t, number = -1_hid_t, direction = -1_hid_t
        integer(hid_t), private :: q = -1_hid_t, qd = -1_hid_t
        !> True if the simulation watches events; number of rows in the file.
        logical :: is_open = .false.
        integer(long) :: rows = 0
        !> Checksums of the datasets time, name, number, direction, q and qd.
        type(fletcher_type) :: sums(6)
    contains
        procedure :: open, reopen, cut, append, close
    end type event_output_type

contains

    !> Create the group, if the simulation watches events.
    subroutine open(self, file, simulation, names, q_units, qd_units)
        class(event_output_type), intent(inout) :: self
        type(hdf5_type), intent(inout) :: file
        class(simulation_type), intent(in) :: simulation
        !> Names and units of the coordinates and velocities (n).
        character(len=label_length), intent(in) :: names(:), q_units(:), qd_units(:)

        self%is_open = allocated(simulation%events)
        if (.not. self%is_open) return
        self%rows = 0
        call file%add_group(group_path)
        call file%add_dataset(group_path//'/time', 0, chunk, .false., self%time)
        call file%attach(group_path//'/time', 'unit', 's')
        call file%attach(group_path//'/time', 'meaning', 'the time of each event')
        call file%add_dataset(group_path//'/name', 0, chunk, .false., self%name, self%time, label_length)
        call file%attach(group_path//'/name', 'meaning', 'the name of the event')
        call file%add_dataset(group_path//'/number', 0, chunk, .true., self%number, self%time)
        call file%attach(group_path//'/number', 'meaning', 'its number in the scene, from 1')
        call file%add_dataset(group_path//'/direction', 0, chunk, .true., self%direction, self%time)
        call file%attach(group_path//'/direction', 'meaning', &
            '1 if its function rose through zero, -1 if it fell, 0 if it touched zero or was zero at the start')
        associate (n => size(names))
            call file%add_dataset(group_path//'/q', n, chunk, .false., self%q, self%time)
            call file%attach(group_path//'/q', 'meaning', 'coordinates at the event')
            call file%name_columns(self%q, group_path//'/q', group_path//'/coordinate', names)
            call file%attach(group_path//'/q', 'names', names)
            call file%attach(group_path//'/q', 'units', q_units)
            call file%add_dataset(group_path//'/qd', n, chunk, .false., self%qd, self%time)
            call file%attach(group_path//'/qd', 'meaning', 'velocities at the event, before its action')
            call file%name_columns(self%qd, group_path//'/qd', group_path//'/coordinate', names)
            call file%attach(group_path//'/qd', 'names', names)
            call file%attach(group_path//'/qd', 'units', qd_units)
        end associate
        call file%list_users(self%time, group_path//'/time', [self%name, self%number, self%direction, self%q, self%qd])
    end subroutine open

    !> Open the datasets of an existing file.
    subroutine reopen(self, file, simulation)
        class(event_output_type), intent(inout) :: self
        type(hdf5_type), intent(inout) :: file
        class(simulation_type), intent(in) :: simulation

        self%is_open = allocated(simulation%events)
        if (.not. self%is_open) return
        call file%open_dataset(group_path//'/time', self%time)
        call file%open_dataset(group_path//'/name', self%name)
        call file%open_dataset(group_path//'/number', self%number)
        call file%open_dataset(group_path//'/direction', self%direction)
        call file%open_dataset(group_path//'/q', self%q)
        call file%open_dataset(group_path//'/qd', self%qd)
    end subroutine reopen

    !> Remove all rows after the first `rows`. Missing rows are written again by `append`.
    subroutine cut(self, file, n, rows)
        class(event_output_type), intent(inout) :: self
        type(hdf5_type), intent(inout) :: file
        !> Number of coordinates; number of rows to keep.
        integer, intent(in) :: n
        integer(long), intent(in) :: rows

        if (.not. self%is_open) return
        call file%cut(self%time, group_path//'/time', 0, rows)
        call file%cut(self%name, group_path//'/name', 0, rows)
        call file%cut(self%number, group_path//'/number', 0, rows)
        call file%cut(self%direction, group_path//'/direction', 0, rows)
        call file%cut(self%q, group_path//'/q', n, rows)
        call file%cut(self%qd, group_path//'/qd', n, rows)
        self%rows = rows
    end subroutine cut

    !> Write the events that occurred since the last call.
    subroutine append(self, file, simulation)
        class(event_output_type), intent(inout) :: self
        type(hdf5_type), intent(inout) :: file
        class(simulation_type), intent(in) :: simulation
        real(wp) :: time(1, chunk), number(1, chunk), direction(1, chunk)
        real(wp) :: q(size(simulation%state%q), chunk), qd(size(simulation%state%q), chunk)
        character(len=label_length) :: names(chunk)
        integer :: i, n

        if (.not. self%is_open) return
        do while (self%rows < simulation%n_events .and. .not. allocated(file%problem))
            n = min(chunk, simulation%n_events - int(self%rows))
            do i = 1, n
                associate (record => simulation%events(int(self%rows) + i))
                    time(1, i) = record%t
                    number(1, i) = real(record%number, wp)
                    direction(1, i) = real(record%direction, wp)
                    names(i) = record%name
                    q(:, i) = record%q
                    qd(:, i) = record%qd
                end associate
            end do
            call file%append(self%time, group_path//'/time', 0, self%rows, n, time)
            call file%append_texts(self%name, group_path//'/name', self%rows, names(:n))
            call file%append(self%number, group_path//'/number', 0, self%rows, n, number)
            call file%append(self%direction, group_path//'/direction', 0, self%rows, n, direction)
            call file%append(self%q, group_path//'/q', size(q, 1), self%rows, n, q)
            call file%append(self%qd, group_path//'/qd', size(qd, 1), self%rows, n, qd)
            do i = 1, n
                call self%sums(1)%add(time(:, i))
                call self%sums(2)%add(transfer(names(i), [0_long]))
                call self%sums(3)%add(number(:, i))
                call self%sums(4)%add(direction(:, i))
                call self%sums(5)%add(q(:, i))
                call self%sums(6)%add(qd(:, i))
            end do
            self%rows = self%rows + n
        end do
    end subroutine append

    !> Close the datasets.
    subroutine close(self, file)
        class(event_output_type), intent(inout) :: self
        type(hdf5_type), intent(inout) :: file

        call file%close_dataset(self%name)
        call file%close_dataset(self%number)
        call file%close_dataset(self%direction)
        call file%close_dataset(self%q)
        call file%close_dataset(self%qd)
        call file%close_dataset(self%time)
        self%is_open = .false.
    end subroutine close
end module tandem_io_output_events
