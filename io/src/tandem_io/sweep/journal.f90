! SPDX-License-Identifier: MIT
!> The journal of a sweep: the records of the cases that are done, appended as they come, each with a checksum. Whatever ends the
!> program leaves one from which the sweep goes on; a record that was cut is done again. Where each case's record stands is kept in
!> memory, 8 bytes a case; nothing else grows with their number.
module tandem_io_sweep_journal
    use tandem, only: error_type, long, set_error, status_output_failed, to_text
    use tandem_fletcher, only: fletcher_type
    use tandem_io_output_guard, only: guard_type, is_taken
    use tandem_io_sweep_record, only: record_type, words_of_record
    use tandem_status, only: status_invalid_option
    implicit none (type, external)
    private

    public :: sweep_journal_type

    !> What it begins with, and the version of what follows.
    character(len=8), parameter :: signature = 'tandem!S'
    integer(long), parameter :: version = 1
    integer, parameter :: bytes_a_word = 8

    type :: sweep_journal_type
        character(len=:), allocatable :: path
        !> The cases that belong to it; how many are done, how many of these failed, and how many of them were done before.
        integer(long) :: first = 1, last = 0, done = 0, failed = 0, resumed = 0
        !> Where the records stand, in bytes; 0 where there is none.
        integer(long), allocatable, private :: places(:)
        !> Where the next one goes.
        integer(long), private :: end = 1
        integer, private :: unit = 0, outputs = 0
        logical, private :: is_open = .false.
        integer(long), allocatable, private :: words(:)
        type(guard_type), private :: guard
    contains
        procedure :: open => open_journal
        procedure :: has
        procedure :: append
        procedure :: flush => flush_journal
        procedure :: read => read_record
        procedure :: take_from
        procedure :: close => close_journal
        procedure, private :: write_head
        procedure, private :: check_head
        procedure, private :: scan
        procedure, private :: say_problem
    end type sweep_journal_type

contains

    !> Open a journal, or begin one.
    subroutine open_journal(self, path, settings, outputs, first, last, force, error)
        class(sweep_journal_type), intent(inout) :: self
        character(len=*), intent(in) :: path
        !> What the records depend on: those of other settings are refused.
        character(len=*), intent(in) :: settings
        !> Numbers of a record.
        integer, intent(in) :: outputs
        !> The cases that belong to it.
        integer(long), intent(in) :: first, last
        !> Whether to begin anew in any case.
        logical, intent(in) :: force
        type(error_type), allocatable, intent(out) :: error
        logical :: exists, is_ours
        integer :: stat

        self%path = path
        self%outputs = outputs
        self%first = first
        self%last = last
        allocate (self%places(first:last), source=0_long)
        allocate (self%words(words_of_record(outputs) + 2))
        inquire (file=path, exist=exists)
        if (exists) then
            if (is_taken(path)) then
                call set_error(error, status_output_failed, 'another process writes '//path, 'let it end, or choose another table')
                return
            end if
        end if
        open (newunit=self%unit, file=path, status='unknown', action='readwrite', access='stream', iostat=stat)
        if (stat /= 0) then
            call self%say_problem('open', error)
            return
        end if
        self%is_open = .true.
        call self%guard%take(path)
        if (exists .and. .not. force) then
            call self%check_head(settings, is_ours, exists)
            if (exists .and. .not. is_ours) then
                call set_error(error, status_invalid_option, path//' holds cases of another sweep, or of another build of tandem', &
                    'finish that one, choose another table, or begin anew with --force')
                return
            end if
            if (exists) call self%scan()
        end if
        if (.not. exists .or. force) call self%write_head(settings, error)
        self%resumed = self%done
    end subroutine open_journal

    !> Whether a case is done.
    pure logical function has(self, case)
        class(sweep_journal_type), intent(in) :: self
        integer(long), intent(in) :: case

        has = self%places(case) > 0
    end function has

    !> Write what all records belong to.
    subroutine write_head(self, settings, error)
        class(sweep_journal_type), intent(inout) :: self
        character(len=*), intent(in) :: settings
        type(error_type), allocatable, intent(out) :: error
        integer(long), allocatable :: head(:)
        integer :: stat

        head = head_of(settings, self%outputs)
        ! What was there before is lost: the first word last, so that nothing else passes for records of ours.
        close (self%unit, iostat=stat)
        open (newunit=self%unit, file=self%path, status='replace', action='readwrite', access='stream', iostat=stat)
        call self%guard%take(self%path)
        if (stat == 0) write (self%unit, pos=1, iostat=stat) head
        if (stat == 0) flush (self%unit, iostat=stat)
        if (stat /= 0) call self%say_problem('write', error)
        self%end = 1 + bytes_a_word*size(head, kind=long)
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

    !> Whether the file begins as one of ours of the same settings.
    subroutine check_head(self, settings, is_ours, is_something)
        class(sweep_journal_type), intent(inout) :: self
        character(len=*), intent(in) :: settings
        logical, intent(out) :: is_ours, is_something
        integer(long), allocatable :: head(:), found(:)
        integer :: stat
        integer(long) :: bytes

        head = head_of(settings, self%outputs)
        allocate (found(size(head)), source=0_long)
        inquire (unit=self%unit, size=bytes)
        ! An empty one, and one whose head was cut, hold nothing that could be lost.
        is_something = bytes > 0
        read (self%unit, pos=1, iostat=stat) found
        is_ours = stat == 0 .and. all(found == head)
        if (stat /= 0 .and. found(1) == head(1) .and. bytes < bytes_a_word*size(head)) is_something = .false.
        self%end = 1 + bytes_a_word*size(head, kind=long)
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
                self%places(record%case) = self%end
            end if
            self%end = self%end + bytes_a_word*(self%words(1) + 2)
        end do
    end subroutine scan

    !> Read what stands at a place.
    subroutine read_at(self, place, record, is_whole)
        class(sweep_journal_type), intent(inout) :: self
        integer(long), intent(in) :: place
        type(record_type), intent(inout) :: record
        logical, intent(out) :: is_whole
        type(fletcher_type) :: sum
        integer :: stat, n

        is_whole = .false.
        read (self%unit, pos=place, iostat=stat) self%words(1)
        if (stat /= 0) return
        if (self%words(1) < 1 .or. self%words(1) > size(self%words) - 2) return
        n = int(self%words(1))
        read (self%unit, iostat=stat) self%words(2:n + 2)
        if (stat /= 0) return
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
        integer :: n, stat

        if (self%has(record%case)) return
        call record%to_words(self%words(2:), n)
        self%words(1) = n
        call sum%add(self%words(:n + 1))
        self%words(n + 2) = sum%value()
        write (self%unit, pos=self%end, iostat=stat) self%words(:n + 2)
        if (stat /= 0) then
            call self%say_problem('append to', error)
            return
        end if
        self%places(record%case) = self%end
        self%end = self%end + bytes_a_word*(n + 2)
        self%done = self%done + 1
        if (record%status /= 0) self%failed = self%failed + 1
    end subroutine append

    !> Bring the records to the system, which keeps them whatever becomes of the program.
    subroutine flush_journal(self, error)
        class(sweep_journal_type), intent(inout) :: self
        type(error_type), allocatable, intent(out) :: error
        integer :: stat
        integer(long) :: bytes

        flush (self%unit, iostat=stat)
        ! A full disk may show only in what is there.
        inquire (unit=self%unit, size=bytes)
        if (stat /= 0 .or. bytes < self%end - 1) call self%say_problem('append to', error)
    end subroutine flush_journal

    !> Read the record of a case that is done.
    subroutine read_record(self, case, record, error)
        class(sweep_journal_type), intent(inout) :: self
        integer(long), intent(in) :: case
        type(record_type), intent(inout) :: record
        type(error_type), allocatable, intent(out) :: error
        logical :: is_whole

        if (.not. allocated(record%values)) allocate (record%values(self%outputs))
        call read_at(self, self%places(case), record, is_whole)
        if (.not. is_whole) call self%say_problem('read', error)
    end subroutine read_record

    !> Take over the records of another journal that are not here.
    subroutine take_from(self, path, settings, is_ours, error)
        class(sweep_journal_type), intent(inout) :: self
        character(len=*), intent(in) :: path, settings
        !> Whether it belongs to the same sweep; else nothing is taken.
        logical, intent(out) :: is_ours
        type(error_type), allocatable, intent(out) :: error
        type(sweep_journal_type) :: other
        type(record_type) :: record
        logical :: is_something
        integer(long) :: case
        integer :: stat

        is_ours = .false.
        other%path = path
        other%outputs = self%outputs
        other%first = self%first
        other%last = self%last
        allocate (other%places(self%first:self%last), source=0_long)
        allocate (other%words(size(self%words)))
        open (newunit=other%unit, file=path, status='old', action='read', access='stream', iostat=stat)
        if (stat /= 0) then
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
        close (other%unit)
        if (.not. allocated(error)) call self%flush(error)
    end subroutine take_from

    !> Close it, and remove it where it is no longer needed.
    subroutine close_journal(self, removes)
        class(sweep_journal_type), intent(inout) :: self
        logical, intent(in) :: removes
        integer :: stat

        if (.not. self%is_open) return
        if (removes) then
            close (self%unit, status='delete', iostat=stat)
        else
            close (self%unit, iostat=stat)
        end if
        self%is_open = .false.
        call self%guard%release()
    end subroutine close_journal

    !> An error of the file.
    subroutine say_problem(self, action, error)
        class(sweep_journal_type), intent(in) :: self
        character(len=*), intent(in) :: action
        type(error_type), allocatable, intent(out) :: error

        call set_error(error, status_output_failed, 'cannot '//action//' '//self%path//' ('//to_text(int(self%done))// &
            ' cases are in it)', 'see whether the disk is full and the path can be written, then start again: what is done stays')
    end subroutine say_problem
end module tandem_io_sweep_journal
