! SPDX-License-Identifier: MIT
!> The journal of a sweep: the records of the finished cases, appended as they arrive, each with a checksum. After any end of the
!> program the sweep can be resumed from it; a case with a truncated record is run again. It is synchronised to the disk every few
!> seconds, so that a loss of power costs the records since then, and when it is closed. The position of each case's record is
!> stored in memory, 8 bytes per case; nothing else grows with the number of cases.
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
    integer, parameter :: bytes_a_word = 8
    !> Words that wait at most.
    integer, parameter :: most_waiting = 65536
    !> Seconds between two synchronisations with the disk.
    integer(long), parameter :: seconds_unsynced = 10

    !> Cases whose places are kept together.
    integer(long), parameter :: block_length = 65536

    !> Positions of the records of consecutive cases, in bytes; 0 if there is none. Not allocated before one of the cases is done.
    type :: block_type
        integer(long), allocatable :: places(:)
    end type block_type

    type :: sweep_journal_type
        character(len=:), allocatable :: path
        !> The cases that belong to it; how many are done, how many of these failed, and how many of them were done before.
        integer(long) :: first = 1, last = 0, done = 0, failed = 0, resumed = 0
        !> Positions of the records from the first case on. Memory grows with the finished cases, not with the requested ones.
        type(block_type), allocatable, private :: blocks(:)
        !> Position of the next record, after `n` words that are not yet written.
        integer(long), private :: end = 0
        integer, private :: n = 0
        integer(c_int64_t), allocatable, private :: waiting(:)
        integer(c_int), private :: file = -1
        integer, private :: outputs = 0
        !> Time of the last synchronisation with the disk; true if something was written since.
        integer(long), private :: synced = 0
        logical, private :: is_unsynced = .false.
        !> One record.
        integer(c_int64_t), allocatable, private :: words(:)
    contains
        procedure :: open => open_journal, has, append, flush => flush_journal, read => read_record
        procedure :: take_from, close => close_journal
        procedure, private :: prepare, write_head, check_head, scan, sync, say_problem, place_of, keep_place
    end type sweep_journal_type

    interface
        function c_open(path, writes) result(file) bind(c, name='tandem_journal_open')
            import :: c_char, c_int
            implicit none (type, external)
            character(kind=c_char), intent(in) :: path(*)
            integer(c_int), value :: writes
            integer(c_int) :: file
        end function c_open

        function c_read(file, words, n, place) result(got) bind(c, name='tandem_journal_read')
            import :: c_int, c_int64_t
            implicit none (type, external)
            integer(c_int), value :: file
            integer(c_int64_t), intent(inout) :: words(*)
            integer(c_int64_t), value :: n, place
            integer(c_int64_t) :: got
        end function c_read

        function c_write(file, words, n, place) result(stat) bind(c, name='tandem_journal_write')
            import :: c_int, c_int64_t
            implicit none (type, external)
            integer(c_int), value :: file
            integer(c_int64_t), intent(in) :: words(*)
            integer(c_int64_t), value :: n, place
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

    !> Open a journal, or begin one.
    subroutine open_journal(self, path, settings, outputs, first, last, force, error)
        class(sweep_journal_type), intent(inout) :: self
        character(len=*), intent(in) :: path
        !> Data on which the records depend; records of other settings are refused.
        character(len=*), intent(in) :: settings
        !> Numbers of a record.
        integer, intent(in) :: outputs
        !> The cases that belong to it.
        integer(long), intent(in) :: first, last
        !> True to begin anew in any case.
        logical, intent(in) :: force
        type(error_type), allocatable, intent(out) :: error
        logical :: is_something, is_ours

        call self%prepare(path, outputs, first, last)
        allocate (self%waiting(most_waiting + size(self%words)))
        self%file = c_open(path//c_null_char, 1_c_int)
        if (self%file == -2) then
            call set_error(error, status_output_failed, 'another process writes '//path, &
                'wait for its end, or choose another table')
        else if (self%file < 0) then
            call self%say_problem('open', error)
        end if
        if (allocated(error)) return
        is_something = .false.
        if (.not. force) call self%check_head(settings, is_ours, is_something)
        if (.not. is_something) then
            call self%write_head(settings, error)
            if (.not. allocated(error)) call self%sync(error)
            if (.not. allocated(error)) call sync_folder_of(path, error)
        else if (is_ours) then
            call self%scan()
        else
            call set_error(error, status_invalid_option, path//' holds cases of another sweep, or of another build of tandem', &
                'finish that one, choose another table, or restart with --force')
        end if
        self%resumed = self%done
    end subroutine open_journal

    !> A journal that is not open.
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

    !> True if a case is done.
    pure logical function has(self, case)
        class(sweep_journal_type), intent(in) :: self
        integer(long), intent(in) :: case

        has = self%place_of(case) > 0
    end function has

    !> Position of the record of a case, 0 if there is none.
    pure integer(long) function place_of(self, case) result(place)
        class(sweep_journal_type), intent(in) :: self
        integer(long), intent(in) :: case

        place = 0
        associate (block => self%blocks((case - self%first)/block_length))
            if (allocated(block%places)) place = block%places(mod(case - self%first, block_length))
        end associate
    end function place_of

    !> Store the position of the record of a case.
    subroutine keep_place(self, case, place)
        class(sweep_journal_type), intent(inout) :: self
        integer(long), intent(in) :: case, place

        associate (block => self%blocks((case - self%first)/block_length))
            if (.not. allocated(block%places)) allocate (block%places(0:block_length - 1), source=0_long)
            block%places(mod(case - self%first, block_length)) = place
        end associate
    end subroutine keep_place

    !> Write what all records belong to.
    subroutine write_head(self, settings, error)
        class(sweep_journal_type), intent(inout) :: self
        character(len=*), intent(in) :: settings
        type(error_type), allocatable, intent(out) :: error
        integer(long), allocatable :: head(:)

        allocate (head, source=head_of(settings, self%outputs))
        self%end = bytes_a_word*size(head, kind=long)
        ! Earlier contents are lost.
        if (c_size(self%file, 0_c_int64_t) /= 0) then
            call self%say_problem('write', error)
        else if (c_write(self%file, head, size(head, kind=c_int64_t), 0_c_int64_t) /= 0) then
            call self%say_problem('write', error)
        end if
    end subroutine write_head

    !> The words before the records.
    pure function head_of(settings, outputs) result(head)
        character(len=*), intent(in) :: settings
        integer, intent(in) :: outputs
        integer(long), allocatable :: head(:)
        type(fletcher_type) :: sum
        integer :: n

        n = len(settings)/bytes_a_word + 1
        allocate (head(n + 5))
        head(1) = transfer(signature, 0_long)
        head(2) = version
        head(3) = outputs
        head(4) = n
        head(5:n + 4) = transfer(settings//repeat(' ', n*bytes_a_word - len(settings)), 0_long, n)
        call sum%add(head(:n + 4))
        head(n + 5) = sum%value()
    end function head_of

    !> Check that the file begins as a journal of the same settings.
    subroutine check_head(self, settings, is_ours, is_something)
        class(sweep_journal_type), intent(inout) :: self
        character(len=*), intent(in) :: settings
        logical, intent(out) :: is_ours, is_something
        integer(long), allocatable :: head(:), found(:)
        integer(c_int64_t) :: got

        allocate (head, source=head_of(settings, self%outputs))
        allocate (found(size(head)), source=0_long)
        got = c_read(self%file, found, size(found, kind=c_int64_t), 0_c_int64_t)
        is_ours = got == size(head)
        if (is_ours) is_ours = all(found == head)
        ! An empty file, and one whose head was cut, hold no records that could be lost.
        is_something = c_size(self%file, -1_c_int64_t) > 0
        if (got < size(head) .and. found(1) == head(1)) is_something = .false.
        ! So does what a loss of power left without its beginning.
        if (all(found == 0)) is_something = .false.
        self%end = bytes_a_word*size(head, kind=long)
    end subroutine check_head

    !> Find the records, up to the first that is not whole.
    subroutine scan(self)
        class(sweep_journal_type), intent(inout) :: self
        type(record_type) :: record
        logical :: is_whole

        allocate (record%values(self%outputs))
        do
            call read_at(self, self%end, record, is_whole)
            if (.not. is_whole) exit
            if (record%case >= self%first .and. record%case <= self%last) then
                if (.not. self%has(record%case)) then
                    self%done = self%done + 1
                    if (record%status /= 0) self%failed = self%failed + 1
                end if
                call self%keep_place(record%case, self%end)
            end if
            self%end = self%end + bytes_a_word*(self%words(1) + 2)
        end do
    end subroutine scan

    !> Read the record at a position.
    subroutine read_at(self, place, record, is_whole)
        class(sweep_journal_type), intent(inout) :: self
        integer(long), intent(in) :: place
        type(record_type), intent(inout) :: record
        logical, intent(out) :: is_whole
        type(fletcher_type) :: sum
        integer(c_int64_t) :: got
        integer :: n

        is_whole = .false.
        got = c_read(self%file, self%words, size(self%words, kind=c_int64_t), place)
        if (got < 3) return
        if (self%words(1) < 1 .or. self%words(1) > got - 2) return
        n = int(self%words(1))
        call sum%add(self%words(:n + 1))
        is_whole = sum%value() == self%words(n + 2)
        if (is_whole) call record%from_words(self%words(2:n + 1))
    end subroutine read_at

    !> Append a record. It is on the disk after `flush`.
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
        call self%keep_place(record%case, self%end + bytes_a_word*self%n)
        self%n = self%n + n + 2
        self%done = self%done + 1
        if (record%status /= 0) self%failed = self%failed + 1
    end subroutine append

    !> Pass the records to the system, which keeps them at any end of the program.
    subroutine flush_journal(self, error)
        class(sweep_journal_type), intent(inout) :: self
        type(error_type), allocatable, intent(out) :: error
        integer(long) :: now, rate

        if (self%n == 0) return
        if (c_write(self%file, self%waiting, int(self%n, c_int64_t), self%end) /= 0) then
            call self%say_problem('append to', error)
            return
        end if
        self%end = self%end + bytes_a_word*self%n
        self%n = 0
        self%is_unsynced = .true.
        call system_clock(now, rate)
        if (now - self%synced > seconds_unsynced*rate) call self%sync(error)
    end subroutine flush_journal

    !> Bring what was written to the disk.
    subroutine sync(self, error)
        class(sweep_journal_type), intent(inout) :: self
        type(error_type), allocatable, intent(out) :: error

        if (sync_open(self%file) /= 0) then
            call self%say_problem('write to disk', error)
            return
        end if
        self%is_unsynced = .false.
        call system_clock(self%synced)
    end subroutine sync

    !> Read the record of a case that is done.
    subroutine read_record(self, case, record, error)
        class(sweep_journal_type), intent(inout) :: self
        integer(long), intent(in) :: case
        type(record_type), intent(inout) :: record
        type(error_type), allocatable, intent(out) :: error
        logical :: is_whole

        if (.not. allocated(record%values)) allocate (record%values(self%outputs))
        call read_at(self, self%place_of(case), record, is_whole)
        if (.not. is_whole) call self%say_problem('read', error)
    end subroutine read_record

    !> Take over the records of another journal that are missing here.
    subroutine take_from(self, path, settings, is_ours, error)
        class(sweep_journal_type), intent(inout) :: self
        character(len=*), intent(in) :: path, settings
        !> True if the other journal belongs to the same sweep; otherwise nothing is taken.
        logical, intent(out) :: is_ours
        type(error_type), allocatable, intent(out) :: error
        type(sweep_journal_type) :: other
        type(record_type) :: record
        logical :: is_something
        integer(long) :: case

        is_ours = .false.
        call other%prepare(path, self%outputs, self%first, self%last)
        other%file = c_open(path//c_null_char, 0_c_int)
        if (other%file < 0) then
            call other%say_problem('open', error)
            return
        end if
        call other%check_head(settings, is_ours, is_something)
        if (is_ours) call other%scan()
        do case = self%first, self%last
            if (.not. is_ours .or. allocated(error)) exit
            if (.not. other%has(case) .or. self%has(case)) cycle
            call other%read(case, record, error)
            if (.not. allocated(error)) call self%append(record, error)
        end do
        call other%close(.false.)
        if (.not. allocated(error)) call self%flush(error)
    end subroutine take_from

    !> Close the journal, and remove it if it is no longer needed.
    subroutine close_journal(self, removes)
        class(sweep_journal_type), intent(inout) :: self
        logical, intent(in) :: removes
        integer(c_int) :: stat

        if (self%file < 0) return
        ! A failure to synchronise is not reported: later readers detect lost records by their checksums.
        stat = 0
        if (self%is_unsynced .and. .not. removes) stat = sync_open(self%file)
        if (stat /= 0) self%is_unsynced = .true.
        if (removes) call remove_file(self%path)
        call c_close(self%file)
        self%file = -1
    end subroutine close_journal

    !> An error of the file.
    subroutine say_problem(self, action, error)
        class(sweep_journal_type), intent(in) :: self
        character(len=*), intent(in) :: action
        type(error_type), allocatable, intent(out) :: error

        call set_error(error, status_output_failed, 'cannot '//action//' '//self%path, &
            'check disk space and write permission, then start again: completed cases are kept')
    end subroutine say_problem
end module tandem_io_sweep_journal
