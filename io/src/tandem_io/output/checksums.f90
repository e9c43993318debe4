! SPDX-License-Identifier: MIT
!> The group /checksums of a result file: checksums of its rows as written.
!>
!> The checksums that HDF5 computes itself belong to chunks. A partly filled chunk is written again with every flush, and if the
!> program is killed during that write, earlier rows become unreadable. Therefore one checksum per dataset is updated as its rows
!> are written.
!>
!> The checksums are stored in two copies, which are written alternately, after the rows and before the saved state that refers to
!> these rows. Each copy contains a running number and a checksum of its own contents. Hence at least one copy is complete, and
!> covers all rows of the saved state, however the program ends.
module tandem_io_output_checksums
    use hdf5, only: hid_t
    use tandem, only: long
    use tandem_fletcher, only: fletcher_type
    use tandem_io_output_events, only: event_paths
    use tandem_io_output_fields, only: fields
    use tandem_io_output_hdf5, only: hdf5_type
    implicit none (type, external)
    private

    public :: checksums_type, finding_type, examine

    !> Paths of the group and of the two copies.
    character(len=*), parameter :: group_path = '/checksums'
    character(len=*), parameter :: paths(2) = [character(len=17) :: group_path//'/first', group_path//'/second']
    !> Attribute that holds the checksum of all other text attributes.
    character(len=*), parameter :: text_checksum_name = 'texts'
    !> Layout of a copy: running number, number of rows, number of events, one checksum per dataset, and the checksum of these words
    !> and of the names of the datasets.
    integer, parameter :: number_at = 1, rows_at = 2, events_at = 3, head = 3

    !> Writer of the checksums.
    type :: checksums_type
        private
        integer(hid_t) :: datasets(2) = -1_hid_t
        !> Paths of the datasets, separated by blanks; not allocated if the file has no checksums.
        character(len=:), allocatable :: names
        integer(long), allocatable :: words(:)
    contains
        procedure :: make, reopen, write => write_sums, write_text_checksum, close
    end type checksums_type

    !> Result of the check of a file.
    type :: finding_type
        !> Difference between the file and the written data; empty if no difference was found.
        character(len=:), allocatable :: problem
        !> True if the file has checksums. Files of older versions of tandem have none.
        logical :: has_checksums = .false.
        !> Rows and events covered by the checksums; rows not covered.
        integer(long) :: rows = 0, events = 0, rows_without_checksums = 0
        !> Number of datasets with checksums; number of unreadable text attributes.
        integer :: datasets = 0, unreadable_texts = 0
        !> True if the file has a checksum of its text attributes; true if the text attributes do not match it.
        logical :: has_text_checksum = .false., text_checksum_differs = .false.
        !> Checksum of each dataset up to the requested rows.
        type(fletcher_type), allocatable :: sums(:)
        !> Contents of the most recent copy.
        integer(long), allocatable, private :: words(:)
        !> Paths of the datasets, separated by blanks.
        character(len=:), allocatable :: names
    end type finding_type

contains

    !> Create the group and allocate all space it needs.
    subroutine make(self, file, names)
        class(checksums_type), intent(inout) :: self
        type(hdf5_type), intent(inout) :: file
        !> Paths of the datasets, separated by blanks, in the order of the checksums.
        character(len=*), intent(in) :: names
        integer :: i

        self%names = names
        allocate (self%words(head + count_names(names) + 1))
        self%words = 0
        call file%add_group(group_path)
        call file%attach(group_path, 'meaning', 'checksums of all rows, for "tandem verify"')
        call file%attach(group_path, 'datasets', names)
        do i = 1, size(paths)
            call file%add_words(trim(paths(i)), size(self%words), self%datasets(i))
            call file%write_words(self%datasets(i), trim(paths(i)), self%words)
        end do
    end subroutine make

    !> Continue the checksums of an examined file.
    subroutine reopen(self, file, finding)
        class(checksums_type), intent(inout) :: self
        type(hdf5_type), intent(inout) :: file
        type(finding_type), intent(in) :: finding
        integer :: i

        if (.not. finding%has_checksums) return
        self%names = finding%names
        self%words = finding%words
        do i = 1, size(paths)
            call file%open_dataset(trim(paths(i)), self%datasets(i))
        end do
    end subroutine reopen

    !> Overwrite the older copy. The rows must have been written already.
    subroutine write_sums(self, file, rows, events, sums)
        class(checksums_type), intent(inout) :: self
        type(hdf5_type), intent(inout) :: file
        !> Number of rows and events covered by `sums`.
        integer(long), intent(in) :: rows, events
        type(fletcher_type), intent(in) :: sums(:)
        integer :: i

        if (.not. allocated(self%names)) return
        associate (words => self%words, n => size(self%words))
            words(number_at) = words(number_at) + 1
            words(rows_at) = rows
            words(events_at) = events
            do i = 1, size(sums)
                words(head + i) = sums(i)%value()
            end do
            words(n) = checksum_of_copy(words(:n - 1), self%names)
            i = 1 + int(mod(words(number_at), size(paths, kind=long)))
            call file%write_words(self%datasets(i), trim(paths(i)), words)
        end associate
    end subroutine write_sums

    !> Write the checksum of the text attributes, all of which must exist.
    subroutine write_text_checksum(self, file)
        class(checksums_type), intent(in) :: self
        type(hdf5_type), intent(inout) :: file
        integer(long) :: sum
        integer :: lost

        if (.not. allocated(self%names)) return
        call file%read_all(lost, sum)
        call file%attach(group_path, text_checksum_name, sum)
    end subroutine write_text_checksum

    !> Close the datasets.
    subroutine close(self, file)
        class(checksums_type), intent(inout) :: self
        type(hdf5_type), intent(inout) :: file
        integer :: i

        do i = 1, size(paths)
            call file%close_dataset(self%datasets(i))
        end do
    end subroutine close

    !> Read an open file completely, and compare its rows with their checksums.
    subroutine examine(file, finding, rows, events)
        type(hdf5_type), intent(inout) :: file
        type(finding_type), intent(out) :: finding
        !> Numbers of rows and events up to which checksums are requested; all if absent.
        integer(long), intent(in), optional :: rows, events
        character(len=:), allocatable :: status, name
        type(fletcher_type) :: sum
        integer(long) :: requested(2), available, text_checksum, written
        logical :: are_events, is_incomplete
        integer :: i, start, last

        finding%problem = ''
        call file%read_all(finding%unreadable_texts, text_checksum)
        if (file%has(group_path)) then
            call file%get_attribute(group_path, text_checksum_name, written, finding%has_text_checksum)
            finding%text_checksum_differs = finding%has_text_checksum .and. text_checksum /= written
            call read_latest_copy(file, finding, is_incomplete)
        else
            call read_rows(file)
        end if
        call file%get_text('/', 'status', status)
        if (.not. (finding%has_checksums .and. finding%problem == '') .or. allocated(file%problem)) then
            if (allocated(file%problem)) finding%problem = file%problem
            return
        end if
        ! An incomplete copy is valid only if the run was killed.
        if (is_incomplete .and. status /= 'running') finding%problem = 'its checksums are damaged'
        if (finding%text_checksum_differs .and. status /= 'running') then
            finding%problem = 'text attributes differ from those that were written'
        end if
        finding%rows = finding%words(rows_at)
        finding%events = finding%words(events_at)
        requested = [finding%rows, finding%events]
        if (present(rows)) requested(1) = rows
        if (present(events)) requested(2) = events
        if (any(requested > [finding%rows, finding%events])) finding%problem = 'it has more rows than checksums'
        finding%datasets = count_names(finding%names)
        allocate (finding%sums(finding%datasets))
        last = 0
        do i = 1, finding%datasets
            if (finding%problem /= '') return
            start = last + 1
            last = end_of_name(finding%names, start) + 1
            name = finding%names(start:last - 1)
            are_events = index(name, '/events/') == 1
            call file%sum_rows(name, merge(requested(2), requested(1), are_events), &
                merge(finding%events, finding%rows, are_events), finding%sums(i), sum, available)
            if (allocated(file%problem)) then
                finding%problem = file%problem
            else if (available < merge(finding%events, finding%rows, are_events)) then
                finding%problem = 'rows of '//name//' are missing'
            else if (sum%value() /= finding%words(head + i)) then
                finding%problem = 'the rows of '//name//' differ from those that were written'
            end if
            if (i == 1) finding%rows_without_checksums = available - finding%rows
        end do
        if (status == 'complete' .and. finding%rows_without_checksums > 0) finding%problem = 'it has more rows than checksums'
    end subroutine examine

    !> Read all rows of a file without checksums; unreadable rows set `file%problem`.
    subroutine read_rows(file)
        type(hdf5_type), intent(inout) :: file
        character(len=:), allocatable :: names
        type(fletcher_type) :: early, sum
        integer(long) :: available
        integer :: i, start, last

        names = '/trajectory/time'
        do i = 1, size(fields)
            associate (path => '/'//trim(fields(i)%group)//'/'//trim(fields(i)%name))
                if (file%has(path)) names = names//' '//path
            end associate
        end do
        if (file%has('/events')) then
            if (file%has('/events/time')) names = names//' '//event_paths
        end if
        last = 0
        do i = 1, count_names(names)
            start = last + 1
            last = end_of_name(names, start) + 1
            call file%sum_rows(names(start:last - 1), 0_long, huge(0_long), early, sum, available)
        end do
    end subroutine read_rows

    !> Read the most recent complete copy.
    subroutine read_latest_copy(file, finding, is_incomplete)
        type(hdf5_type), intent(inout) :: file
        type(finding_type), intent(inout) :: finding
        !> True if one of the copies is incomplete.
        logical, intent(out) :: is_incomplete
        integer(long), allocatable :: words(:)
        integer :: i, n

        is_incomplete = .false.
        finding%has_checksums = .true.
        call file%get_text(group_path, 'datasets', finding%names)
        n = head + count_names(finding%names) + 1
        do i = 1, size(paths)
            call file%get_words(trim(paths(i)), words)
            if (allocated(file%problem)) return
            if (size(words) /= n) then
                finding%problem = 'its checksums are damaged'
                return
            end if
            if (all(words == 0)) then
                ! This copy was created but not written yet.
                if (.not. allocated(finding%words)) finding%words = words
            else if (words(n) /= checksum_of_copy(words(:n - 1), finding%names)) then
                is_incomplete = .true.
            else if (.not. allocated(finding%words)) then
                finding%words = words
            else if (words(number_at) > finding%words(number_at)) then
                finding%words = words
            end if
        end do
        if (.not. allocated(finding%words)) finding%problem = 'its checksums are damaged'
        ! No copy was written yet: all checksums are those of empty datasets.
        if (allocated(finding%words)) then
            if (finding%words(number_at) == 0) finding%words(head + 1:n - 1) = empty_sum()
        end if
    end subroutine read_latest_copy

    !> Checksum of an empty dataset.
    pure integer(long) function empty_sum()
        type(fletcher_type) :: sum

        empty_sum = sum%value()
    end function empty_sum

    !> Checksum of the contents of a copy and of the names of the datasets.
    pure integer(long) function checksum_of_copy(words, names)
        integer(long), intent(in) :: words(:)
        character(len=*), intent(in) :: names
        type(fletcher_type) :: sum
        character(len=8*((len(names) + 7)/8)) :: padded

        padded = names
        call sum%add(words)
        call sum%add(transfer(padded, words))
        checksum_of_copy = sum%value()
    end function checksum_of_copy

    !> Position of the last letter of the name that begins at `start`.
    pure integer function end_of_name(names, start)
        character(len=*), intent(in) :: names
        integer, intent(in) :: start

        end_of_name = start - 2 + index(names(start:), ' ')
        if (end_of_name < start) end_of_name = len(names)
    end function end_of_name

    !> Number of names in a list separated by blanks.
    pure integer function count_names(names)
        character(len=*), intent(in) :: names
        integer :: i

        count_names = count([(names(i:i) == ' ', i=1, len(names))]) + 1
    end function count_names
end module tandem_io_output_checksums
