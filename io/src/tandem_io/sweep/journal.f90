! SPDX-License-Identifier: MIT
!> The journal of a sweep: records of the finished cases, appended as they arrive, each with a checksum. The sweep can be resumed
!> from the journal however the program ends; a case with an incomplete record is run again. The journal is synchronised with the
!> disk every few seconds and when it is closed, so that a power failure loses only the most recent records. The position of each
!> record is stored in memory, 8 bytes per case; no other memory grows with the number of cases.
module tandem_io_sweep_journal
    use tandem, only: error_type, long, set_error, status_output_failed, to_text
    use tandem_fletcher, only: fletcher_type
    use tandem_io_sweep_disk, only: sync_folder_of, sync_open
    use tandem_io_sweep_record, only: record_type, words_of_record
    use tandem_io_study_files, only: remove_file
    use tandem_status, only: status_invalid_option
    use, intrinsic :: iso_c_binding, only: c_char, c_int, c_int64_t, c_null_char
    implicit none (type, external)
    private

    public :: sweep_journal_type

    !> Signature at the beginning of the file, and version of the format.
    character(len=8), parameter :: signature = 'tandem!S'
    integer(long), parameter :: version = 1
    integer, parameter :: bytes_per_word = 8
    !> Largest number of buffered words.
    integer, parameter :: most_waiting = 65536
    !> Time between synchronisations with the disk, seconds.
    integer(long), parameter :: seconds_unsynced = 10

    !> Number of consecutive cases whose positions form a block.
    integer(long), parameter :: block_length = 65536

    !> Positions of the records of consecutive cases, in bytes; 0 if a case is not finished. Not allocated while no case of the
    !> block is finished.
    type :: block_type
        integer(long), allocatable :: positions(:)
    end type block_type

    type :: sweep_journal_type
        character(len=:), allocatable :: path
        !> First and last requested case; number of finished cases, of failed cases, and of cases finished by earlier runs of the
        !> sweep.
        integer(long) :: first = 1, last = 0, done = 0, failed = 0, resumed = 0
        !> Positions of the records in blocks, counted from `first`. Memory grows with the number of finished cases, not of
        !> requested ones.
        type(block_type), allocatable, private :: blocks(:)
        !> Position at which the `n` buffered words will be written.
        integer(long), private :: end = 0
        integer, private :: n = 0
        integer(c_int64_t), allocatable, private :: waiting(:)
        integer(c_int), private :: file = -1
        integer, private :: outputs = 0
        !> Time of the last synchronisation with the disk; true if data were written since.
        integer(long), private :: synced_at = 0
        logical, private :: is_unsynced = .false.
        !> Buffer for one record.
        integer(c_int64_t), allocatable, private :: words(:)
    contains
        procedure :: open => open_journal, has, append, flush => flush_journal, read => read_record
        procedure :: merge_from, close => close_journal
        procedure, private :: prepare, write_header, check_header, scan, sync, set_file_error, position_of, store_position
    end type sweep_journal_type

    interface
        function c_open(path, writes) result(file) bind(c, name='tandem_journal_open')
            import :: c_char, c_int
            implicit none (type, external)
            character(kind=c_char), intent(in) :: path(*)
            integer(c_int), value :: writes
            integer(c_int) :: file
        end function c_open

        function c_read(file, words, n, position) result(got) bind(c, name='tandem_journal_read')
            import :: c_int, c_int64_t
            implicit none (type, external)
            integer(c_int), value :: file
            integer(c_int64_t), intent(inout) :: words(*)
            integer(c_int64_t), value :: n, position
            integer(c_int64_t) :: got
        end function c_read

        function c_write(file, words, n, position) result(stat) bind(c, name='tandem_journal_write')
            import :: c_int, c_int64_t
            implicit none (type, external)
            integer(c_int), value :: file
            integer(c_int64_t), intent(in) :: words(*)
            integer(c_int64_t), value :: n, position
            integer(c_int) :: stat
        end function c_write

        function c_size(file, end) result(bytes) bind(c, name='tandem_journal_size')
            import :: c_int, c_int64_t
            implicit none (type, external)
            integer(c_int), value :: file
            integer(c_int64_t), value :: end
            integer(c_int64_t) :: bytes
        end function c_size

        subroutine c_close(file) bind(c, name='tandem_journal_close')
            import :: c_int
            implicit none (type, external)
            integer(c_int), value :: file
        end subroutine c_close
    end interface

contains

    !> Open a journal, or create it.
    subroutine open_journal(self, path, settings, outputs, first, last, force, error)
        class(sweep_journal_type), intent(inout) :: self
        character(len=*), intent(in) :: path
        !> Data on which the records depend; a journal with other settings is refused.
        character(len=*), intent(in) :: settings
        !> Numbers per record.
        integer, intent(in) :: outputs
        !> First and last requested case.
        integer(long), intent(in) :: first, last
        !> True to discard existing records.
        logical, intent(in) :: force
        type(error_type), allocatable, intent(out) :: error
        logical :: has_records, is_same_sweep

        call self%prepare(path, outputs, first, last)
        allocate (self%waiting(most_waiting + size(self%words)))
        self%file = c_open(path//c_null_char, 1_c_int)
        if (self%file == -2) then
            call set_error(error, status_output_failed, 'another process writes '//path, &
                'wait for its end, or choose another table')
        else if (self%file < 0) then
            call self%set_file_error('open', error)
        end if
        if (allocated(error)) return
        has_records = .false.
        if (.not. force) call self%check_header(settings, is_same_sweep, has_records)
        if (.not. has_records) then
            call self%write_header(settings, error)
            if (.not. allocated(error)) call self%sync(error)
            if (.not. allocated(error)) call sync_folder_of(path, error)
        else if (is_same_sweep) then
            call self%scan()
        else
            call set_error(error, status_invalid_option, path//' holds cases of another sweep, or of another build of tandem', &
                'finish that one, choose another table, or restart with --force')
        end if
        self%resumed = self%done
    end subroutine open_journal

    !> Define the contents of a journal without opening its file.
    subroutine prepare(self, path, outputs, first, last)
        class(sweep_journal_type), intent(inout) :: self
        character(len=*), intent(in) :: path
        integer, intent(in) :: outputs
        integer(long), intent(in) :: first, last

        self%path = path
        self%outputs = outputs
        self%first = first
        self%last = last
        allocate (self%blocks(0:(last - first)/block_length))
        allocate (self%words(words_of_record(outputs) + 2))
    end subroutine prepare

    !> True if a case is finished.
    pure logical function has(self, case)
        class(sweep_journal_type), intent(in) :: self
        integer(long), intent(in) :: case

        has = self%position_of(case) > 0
    end function has

    !> Position of the record of a case; 0 if the case is not finished.
    pure integer(long) function position_of(self, case) result(position)
        class(sweep_journal_type), intent(in) :: self
        integer(long), intent(in) :: case

        position = 0
        associate (block => self%blocks((case - self%first)/block_length))
            if (allocated(block%positions)) position = block%positions(mod(case - self%first, block_length))
        end associate
    end function position_of

    !> Store the position of the record of a case.
    subroutine store_position(self, case, position)
        class(sweep_journal_type), intent(inout) :: self
        integer(long), intent(in) :: case, position

        associate (block => self%blocks((case - self%first)/block_length))
            if (.not. allocated(block%positions)) allocate (block%positions(0:block_length - 1), source=0_long)
            block%positions(mod(case - self%first, block_length)) = position
        end associate
    end subroutine store_position

    !> Write the header, which identifies the sweep.
    subroutine write_header(self, settings, error)
        class(sweep_journal_type), intent(inout) :: self
        character(len=*), intent(in) :: settings
        type(error_type), allocatable, intent(out) :: error
        integer(long), allocatable :: header(:)

        allocate (header, source=header_of(settings, self%outputs))
        self%end = bytes_per_word*size(header, kind=long)
        ! This discards earlier contents.
        if (c_size(self%file, 0_c_int64_t) /= 0) then
            call self%set_file_error('write', error)
        else if (c_write(self%file, header, size(header, kind=c_int64_t), 0_c_int64_t) /= 0) then
            call self%set_file_error('write', error)
        end if
    end subroutine write_header

    !> Words of the header.
    pure function header_of(settings, outputs) result(header)
        character(len=*), intent(in) :: settings
        integer, intent(in) :: outputs
        integer(long), allocatable :: header(:)
        type(fletcher_type) :: sum
        integer :: n

        n = len(settings)/bytes_per_word + 1
        allocate (header(n + 5))
        header(1) = transfer(signature, 0_long)
        header(2) = version
        header(3) = outputs
        header(4) = n
        header(5:n + 4) = transfer(settings//repeat(' ', n*bytes_per_word - len(settings)), 0_long, n)
        call sum%add(header(:n + 4))
        header(n + 5) = sum%value()
    end function header_of

    !> Compare the header of the file with the header of this sweep.
    subroutine check_header(self, settings, is_same_sweep, has_records)
        class(sweep_journal_type), intent(inout) :: self
        character(len=*), intent(in) :: settings
        logical, intent(out) :: is_same_sweep, has_records
        integer(long), allocatable :: header(:), found(:)
        integer(c_int64_t) :: got

        allocate (header, source=header_of(settings, self%outputs))
        allocate (found(size(header)), source=0_long)
        got = c_read(self%file, found, size(found, kind=c_int64_t), 0_c_int64_t)
        is_same_sweep = got == size(header)
        if (is_same_sweep) is_same_sweep = all(found == header)
        ! An empty file, or one with an incomplete header, contains no records.
        has_records = c_size(self%file, -1_c_int64_t) > 0
        if (got < size(header) .and. found(1) == header(1)) has_records = .false.
        ! A file that consists of zeros after a power failure contains no records either.
        if (all(found == 0)) has_records = .false.
        self%end = bytes_per_word*size(header, kind=long)
    end subroutine check_header

    !> Find the records, up to the first incomplete one.
    subroutine scan(self)
        class(sweep_journal_type), intent(inout) :: self
        type(record_type) :: record
        logical :: is_complete

        allocate (record%values(self%outputs))
        do
            call read_at(self, self%end, record, is_complete)
            if (.not. is_complete) exit
            if (record%case >= self%first .and. record%case <= self%last) then
                if (.not. self%has(record%case)) then
                    self%done = self%done + 1
                    if (record%status /= 0) self%failed = self%failed + 1
                end if
                call self%store_position(record%case, self%end)
            end if
            self%end = self%end + bytes_per_word*(self%words(1) + 2)
        end do
    end subroutine scan

    !> Read the record at a position.
    subroutine read_at(self, position, record, is_complete)
        class(sweep_journal_type), intent(inout) :: self
        integer(long), intent(in) :: position
        type(record_type), intent(inout) :: record
        logical, intent(out) :: is_complete
        type(fletcher_type) :: sum
        integer(c_int64_t) :: got
        integer :: n

        is_complete = .false.
        got = c_read(self%file, self%words, size(self%words, kind=c_int64_t), position)
        if (got < 3) return
        if (self%words(1) < 1 .or. self%words(1) > got - 2) return
        n = int(self%words(1))
        call sum%add(self%words(:n + 1))
        is_complete = sum%value() == self%words(n + 2)
        if (is_complete) call record%from_words(self%words(2:n + 1))
    end subroutine read_at

    !> Append a record to the buffer.
    subroutine append(self, record, error)
        class(sweep_journal_type), intent(inout) :: self
        type(record_type), intent(in) :: record
        type(error_type), allocatable, intent(out) :: error
        type(fletcher_type) :: sum
        integer :: n

        if (self%has(record%case)) return
        if (self%n >= most_waiting) call self%flush(error)
        if (allocated(error)) return
        associate (words => self%waiting(self%n + 1:))
            call record%to_words(words(2:), n)
            words(1) = n
            call sum%add(words(:n + 1))
            words(n + 2) = sum%value()
        end associate
        call self%store_position(record%case, self%end + bytes_per_word*self%n)
        self%n = self%n + n + 2
        self%done = self%done + 1
        if (record%status /= 0) self%failed = self%failed + 1
    end subroutine append

    !> Write the buffered records to the file. The system keeps them however the program ends.
    subroutine flush_journal(self, error)
        class(sweep_journal_type), intent(inout) :: self
        type(error_type), allocatable, intent(out) :: error
        integer(long) :: now, rate

        if (self%n == 0) return
        if (c_write(self%file, self%waiting, int(self%n, c_int64_t), self%end) /= 0) then
            call self%set_file_error('append to', error)
            return
        end if
        self%end = self%end + bytes_per_word*self%n
        self%n = 0
        self%is_unsynced = .true.
        call system_clock(now, rate)
        if (now - self%synced_at > seconds_unsynced*rate) call self%sync(error)
    end subroutine flush_journal

    !> Synchronise the file with the disk.
    subroutine sync(self, error)
        class(sweep_journal_type), intent(inout) :: self
        type(error_type), allocatable, intent(out) :: error

        if (sync_open(self%file) /= 0) then
            call self%set_file_error('write to disk', error)
            return
        end if
        self%is_unsynced = .false.
        call system_clock(self%synced_at)
    end subroutine sync

    !> Read the record of a finished case.
    subroutine read_record(self, case, record, error)
        class(sweep_journal_type), intent(inout) :: self
        integer(long), intent(in) :: case
        type(record_type), intent(inout) :: record
        type(error_type), allocatable, intent(out) :: error
        logical :: is_complete

        if (.not. allocated(record%values)) allocate (record%values(self%outputs))
        call read_at(self, self%position_of(case), record, is_complete)
        if (.not. is_complete) call self%set_file_error('read', error)
    end subroutine read_record

    !> Copy the records of another journal that are missing in this one.
    subroutine merge_from(self, path, settings, is_same_sweep, error)
        class(sweep_journal_type), intent(inout) :: self
        character(len=*), intent(in) :: path, settings
        !> True if the other journal belongs to the same sweep; otherwise nothing is copied.
        logical, intent(out) :: is_same_sweep
        type(error_type), allocatable, intent(out) :: error
        type(sweep_journal_type) :: other
        type(record_type) :: record
        logical :: has_records
        integer(long) :: case

        is_same_sweep = .false.
        call other%prepare(path, self%outputs, self%first, self%last)
        other%file = c_open(path//c_null_char, 0_c_int)
        if (other%file < 0) then
            call other%set_file_error('open', error)
            return
        end if
        call other%check_header(settings, is_same_sweep, has_records)
        if (is_same_sweep) call other%scan()
        do case = self%first, self%last
            if (.not. is_same_sweep .or. allocated(error)) exit
            if (.not. other%has(case) .or. self%has(case)) cycle
            call other%read(case, record, error)
            if (.not. allocated(error)) call self%append(record, error)
        end do
        call other%close(.false.)
        if (.not. allocated(error)) call self%flush(error)
    end subroutine merge_from

    !> Close the journal, and remove the file if it is no longer needed.
    subroutine close_journal(self, removes)
        class(sweep_journal_type), intent(inout) :: self
        logical, intent(in) :: removes
        integer(c_int) :: stat

        if (self%file < 0) return
        ! A failed synchronisation is not reported, because later readers detect lost records by their checksums.
        stat = 0
        if (self%is_unsynced .and. .not. removes) stat = sync_open(self%file)
        if (stat /= 0) self%is_unsynced = .true.
        if (removes) call remove_file(self%path)
        call c_close(self%file)
        self%file = -1
    end subroutine close_journal

    !> Set an error about the file.
    subroutine set_file_error(self, action, error)
        class(sweep_journal_type), intent(in) :: self
        character(len=*), intent(in) :: action
        type(error_type), allocatable, intent(out) :: error

        call set_error(error, status_output_failed, 'cannot '//action//' '//self%path, &
            'check disk space and write permission, then start again: completed cases are kept')
    end subroutine set_file_error
end module tandem_io_sweep_journal
