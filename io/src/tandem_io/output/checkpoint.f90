! SPDX-License-Identifier: MIT
!> The group /checkpoint of a result file: states from which an interrupted run is resumed.
!>
!> A state is stored in two copies, which are written alternately, each with a running number and a checksum. A copy is written only
!> after the rows that it refers to are on the disk. Hence at least one copy is complete and has all its rows, however the program
!> ends.
module tandem_io_output_checkpoint
    use hdf5, only: hid_t
    use tandem, only: error_type, long, pack_type, set_error, to_text, wp
    use tandem_io_output_hdf5, only: hdf5_type
    use tandem_io_output_target, only: check_source
    use tandem_io_version, only: format_version, tandem_version
    use tandem_pack, only: is_whole
    use tandem_status, only: status_invalid_checkpoint
    implicit none (type, external)
    private

    public :: checkpoint_type, snapshot_type, read_snapshot, check_copies

    !> Paths of the group and of the two copies; numbers per chunk of the file.
    character(len=*), parameter :: group_path = '/checkpoint'
    character(len=*), parameter :: paths(2) = [character(len=19) :: group_path//'/first', group_path//'/second']
    integer, parameter :: chunk = 4096
    character(len=*), parameter :: kind_of_row = 'result'

    !> State from which a run is resumed.
    type :: snapshot_type
        !> The complete scene as TOML.
        character(len=:), allocatable :: scene
        !> State of the simulation, and of the error estimator that observes it.
        integer(long), allocatable :: simulation(:), watcher(:)
        !> Number of rows and events written before the snapshot, number of rows due to the output interval, and times of the first
        !> and the last row.
        integer(long) :: rows = 0, events = 0, intervals = 0
        real(wp) :: first_time = 0.0_wp, last_time = 0.0_wp
        !> Energy at the start and its largest deviation.
        real(wp) :: energy(2) = 0.0_wp
        !> Status in the file, blank if unreadable; true if the run is complete.
        character(len=:), allocatable :: status
        logical :: is_complete = .false.
        !> True if the run was killed before its first state was saved; only its scene is known.
        logical :: is_before_start = .false.
        !> Number of earlier resumptions of the run.
        integer :: times_resumed = 0
        !> Running number of the snapshot.
        integer(long), private :: number = 0
    contains
        procedure, private :: pack_state => pack_snapshot
    end type snapshot_type

    !> Writer of snapshots.
    type :: checkpoint_type
        private
        integer(hid_t) :: datasets(2) = -1_hid_t
        integer(long) :: number = 0
        type(pack_type) :: pack
        integer(long), allocatable :: words(:)
    contains
        procedure :: make, reopen, write => write_snapshot, close
    end type checkpoint_type

contains

    !> Create the group.
    subroutine make(self, file)
        class(checkpoint_type), intent(inout) :: self
        type(hdf5_type), intent(inout) :: file
        integer :: i

        call file%add_group(group_path)
        call file%attach(group_path, 'meaning', 'state for "tandem resume"; readable by the same version of tandem only')
        do i = 1, size(paths)
            call file%add_words(trim(paths(i)), chunk, self%datasets(i))
        end do
        self%number = 0
    end subroutine make

    !> Continue the checkpoints of an existing file.
    subroutine reopen(self, file, snapshot)
        class(checkpoint_type), intent(inout) :: self
        type(hdf5_type), intent(inout) :: file
        !> Contents of the checkpoint.
        type(snapshot_type), intent(in) :: snapshot
        integer :: i

        do i = 1, size(paths)
            call file%open_dataset(trim(paths(i)), self%datasets(i))
        end do
        ! The snapshot remains valid until the next one is written.
        self%number = snapshot%number
    end subroutine reopen

    !> Overwrite the older copy. The rows that the snapshot refers to must be on the disk.
    subroutine write_snapshot(self, file, snapshot)
        class(checkpoint_type), intent(inout) :: self
        type(hdf5_type), intent(inout) :: file
        type(snapshot_type), intent(inout) :: snapshot
        character(len=96) :: problem

        self%number = self%number + 1
        snapshot%number = self%number
        call self%pack%begin_writing()
        call snapshot%pack_state(self%pack, problem)
        call self%pack%end_writing(kind_of_row, self%words)
        associate (i => 1 + mod(self%number, size(paths, kind=long)))
            call file%write_words(self%datasets(i), trim(paths(i)), self%words)
        end associate
    end subroutine write_snapshot

    !> Close the datasets.
    subroutine close(self, file)
        class(checkpoint_type), intent(inout) :: self
        type(hdf5_type), intent(inout) :: file
        integer :: i

        do i = 1, size(paths)
            call file%close_dataset(self%datasets(i))
        end do
    end subroutine close

    !> Read the most recent complete snapshot of a result file, or return the reason for its absence.
    subroutine read_snapshot(path, snapshot, error)
        character(len=*), intent(in) :: path
        type(snapshot_type), intent(out) :: snapshot
        type(error_type), allocatable, intent(out) :: error
        type(hdf5_type) :: file
        type(snapshot_type) :: candidate
        type(pack_type) :: pack
        integer(long), allocatable :: words(:)
        integer(long) :: format
        logical :: is_there, is_empty
        character(len=:), allocatable :: scene
        character(len=96) :: problem, first_problem
        character(len=64) :: reason
        integer :: i

        call check_source(path, error)
        if (allocated(error)) return
        call file%open_to_read(path)
        call file%get_attribute('/', 'format_version', format, is_there)
        if (is_there .and. format > format_version) then
            call refuse('it was written by a newer version of tandem')
            call file%close()
            return
        end if
        first_problem = ''
        is_empty = .true.
        do i = 1, size(paths)
            if (allocated(file%problem)) exit
            call file%get_words(trim(paths(i)), words)
            if (allocated(file%problem)) exit
            is_empty = is_empty .and. size(words) == 0
            call pack%begin_reading(kind_of_row, words, reason)
            problem = ''
            if (reason /= '') problem = 'its checkpoint cannot be read: '//reason
            if (problem == '') call candidate%pack_state(pack, problem)
            ! The problem of a copy that was never written is the least informative.
            if (size(words) > 0 .or. first_problem == '') first_problem = problem
            if (problem == '' .and. candidate%number > snapshot%number) snapshot = candidate
        end do
        call file%get_text('/', 'status', snapshot%status)
        call file%get_text('/', 'scene', scene)
        call file%close()
        snapshot%is_before_start = is_empty .and. snapshot%status == 'running' .and. scene /= ''
        snapshot%is_complete = snapshot%status == 'complete'
        if (allocated(file%problem)) then
            call refuse('it has no checkpoint, or is damaged: '//file%problem)
        else if (snapshot%is_before_start) then
            snapshot%scene = scene
        else if (snapshot%number == 0) then
            call refuse(trim(first_problem))
        end if

    contains

        subroutine refuse(reason)
            character(len=*), intent(in) :: reason

            call set_error(error, status_invalid_checkpoint, 'cannot resume from '//path//': '//reason)
        end subroutine refuse
    end subroutine read_snapshot

    !> Report a copy that differs from the written data; copies that were never written are valid.
    subroutine check_copies(file, problem)
        type(hdf5_type), intent(inout) :: file
        !> Empty if both copies are valid.
        character(len=:), allocatable, intent(out) :: problem
        integer(long), allocatable :: words(:)
        integer :: i

        problem = ''
        if (.not. file%has(group_path)) return
        do i = 1, size(paths)
            call file%get_words(trim(paths(i)), words)
            if (allocated(file%problem)) return
            if (size(words) > 0 .and. .not. is_whole(words)) problem = trim(paths(i))//' differs from what was written'
        end do
    end subroutine check_copies

    !> Read or write all contents of a snapshot. The format after the version number depends on the version.
    subroutine pack_snapshot(self, pack, problem)
        class(snapshot_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack
        !> Reason why the snapshot is unreadable; blank if it is readable.
        character(len=*), intent(out) :: problem
        character(len=:), allocatable :: version

        problem = ''
        version = tandem_version
        call pack%text(version)
        if (.not. allocated(version)) version = 'unknown'
        if (version /= tandem_version) then
            problem = 'tandem '//version//' wrote it, and this is '//tandem_version
            return
        end if
        call pack%item(self%number)
        call pack%text(self%scene)
        call pack%item(self%simulation)
        call pack%item(self%watcher)
        call pack%item(self%rows)
        call pack%item(self%events)
        call pack%item(self%intervals)
        call pack%item(self%first_time)
        call pack%item(self%last_time)
        call pack%fixed(self%energy)
        call pack%item(self%times_resumed)
        if (.not. pack%is_reading) return
        call pack%end_reading()
        if (pack%has_failed) problem = 'its checkpoint is incomplete'
    end subroutine pack_snapshot
end module tandem_io_output_checkpoint
