! SPDX-License-Identifier: MIT
!> The group /checksums of a result file: checksums of its rows as written.
!>
!> HDF5's own checksums of data belong to chunks. A chunk that is not full yet is written again with every flush, and if the
!> program is killed meanwhile, earlier rows would become unreadable. So one sum per dataset grows with its rows;
!> the sums are written in two places in turn, each with a running number and a checksum of its own, after the rows and before the
!> state that counts them: after any end of the program at least one of them is whole, with all rows that the state needs.
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

    character(len=*), parameter :: place = '/checksums', paths(2) = [character(len=17) :: place//'/first', place//'/second']
    !> The attribute with the sum of the texts among the others.
    character(len=*), parameter :: texts = 'texts'
    !> A place holds the running number, rows, events, a sum for each dataset, and the checksum of these and of the names.
    integer, parameter :: number_at = 1, rows_at = 2, events_at = 3, head = 3

    !> Writer of the checksums.
    type :: checksums_type
        private
        integer(hid_t) :: datasets(2) = -1_hid_t
        !> The paths of the datasets with a blank between them; not allocated if a file has no checksums.
        character(len=:), allocatable :: names
        integer(long), allocatable :: words(:)
    contains
        procedure :: make, take_up, write => write_sums, note_texts, close
    end type checksums_type

    !> Result of the check of a file.
    type :: finding_type
        !> Reason why the file differs from what was written; empty if no difference was found.
        character(len=:), allocatable :: problem
        !> True if the file has checksums. Files of earlier programs have none.
        logical :: has_checksums = .false.
        !> Rows and events covered by the checksums, and rows after them.
        integer(long) :: rows = 0, events = 0, rows_behind = 0
        !> Number of datasets with checksums, and of unreadable texts among the attributes.
        integer :: datasets = 0, lost_texts = 0
        !> True if the file has a checksum of the texts among its attributes; true if the texts differ from it.
        logical :: has_sum_of_texts = .false., are_other_texts = .false.
        !> Checksums of the datasets after the requested rows.
        type(fletcher_type), allocatable :: sums(:)
        !> The last place that was written.
        integer(long), allocatable, private :: words(:)
        !> The paths of the datasets with a blank between them.
        character(len=:), allocatable :: names
    end type finding_type

contains

    !> Make the group, with all the space that it takes.
    subroutine make(self, file, names)
        class(checksums_type), intent(inout) :: self
        type(hdf5_type), intent(inout) :: file
        !> The paths of the datasets with a blank between them, in the order of the sums.
        character(len=*), intent(in) :: names
        integer :: i

        self%names = names
        allocate (self%words(head + count_of(names) + 1))
        self%words = 0
        call file%add_group(place)
        call file%attach(place, 'meaning', 'checksums of all rows, for "tandem verify"')
        call file%attach(place, 'datasets', names)
        do i = 1, size(paths)
            call file%add_words(trim(paths(i)), size(self%words), self%datasets(i))
            call file%write_words(self%datasets(i), trim(paths(i)), self%words)
        end do
    end subroutine make

    !> Go on in a file that was examined.
    subroutine take_up(self, file, finding)
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
    end subroutine take_up

    !> Write the sums over the older ones; the rows must have been written already.
    subroutine write_sums(self, file, rows, events, sums)
        class(checksums_type), intent(inout) :: self
        type(hdf5_type), intent(inout) :: file
        !> Rows and events that they are of.
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
            words(n) = own_sum(words(:n - 1), self%names)
            i = 1 + int(mod(words(number_at), size(paths, kind=long)))
            call file%write_words(self%datasets(i), trim(paths(i)), words)
        end associate
    end subroutine write_sums

    !> Write the sum of the texts among the attributes, all of which must exist.
    subroutine note_texts(self, file)
        class(checksums_type), intent(in) :: self
        type(hdf5_type), intent(inout) :: file
        integer(long) :: sum
        integer :: lost

        if (.not. allocated(self%names)) return
        call file%read_all(lost, sum)
        call file%attach(place, texts, sum)
    end subroutine note_texts

    !> Close the datasets.
    subroutine close(self, file)
        class(checksums_type), intent(inout) :: self
        type(hdf5_type), intent(inout) :: file
        integer :: i

        do i = 1, size(paths)
            call file%close_dataset(self%datasets(i))
        end do
    end subroutine close

    !> Read all of an open file, and compare its rows with their checksums.
    subroutine examine(file, finding, rows, events)
        type(hdf5_type), intent(inout) :: file
        type(finding_type), intent(out) :: finding
        !> Rows and events after which the sums are requested; all if absent.
        integer(long), intent(in), optional :: rows, events
        character(len=:), allocatable :: status, name
        type(fletcher_type) :: sum
        integer(long) :: asked(2), there, sum_of_texts, written
        logical :: are_events, is_torn
        integer :: i, start, last

        finding%problem = ''
        call file%read_all(finding%lost_texts, sum_of_texts)
        if (file%has(place)) then
            call file%get_attribute(place, texts, written, finding%has_sum_of_texts)
            finding%are_other_texts = finding%has_sum_of_texts .and. sum_of_texts /= written
            call read_place(file, finding, is_torn)
        else
            call read_rows(file)
        end if
        call file%get_text('/', 'status', status)
        if (.not. (finding%has_checksums .and. finding%problem == '') .or. allocated(file%problem)) then
            if (allocated(file%problem)) finding%problem = file%problem
            return
        end if
        ! One of the places may be half written, but only if the run was killed.
        if (is_torn .and. status /= 'running') finding%problem = 'its checksums are damaged'
        if (finding%are_other_texts .and. status /= 'running') then
            finding%problem = 'text attributes differ from those that were written'
        end if
        finding%rows = finding%words(rows_at)
        finding%events = finding%words(events_at)
        asked = [finding%rows, finding%events]
        if (present(rows)) asked(1) = rows
        if (present(events)) asked(2) = events
        if (any(asked > [finding%rows, finding%events])) finding%problem = 'it has more rows than checksums'
        finding%datasets = count_of(finding%names)
        allocate (finding%sums(finding%datasets))
        last = 0
        do i = 1, finding%datasets
            if (finding%problem /= '') return
            start = last + 1
            last = end_of_name(finding%names, start) + 1
            name = finding%names(start:last - 1)
            are_events = index(name, '/events/') == 1
            call file%sum_rows(name, merge(asked(2), asked(1), are_events), merge(finding%events, finding%rows, are_events), &
                finding%sums(i), sum, there)
            if (allocated(file%problem)) then
                finding%problem = file%problem
            else if (there < merge(finding%events, finding%rows, are_events)) then
                finding%problem = 'rows of '//name//' are missing'
            else if (sum%value() /= finding%words(head + i)) then
                finding%problem = 'the rows of '//name//' differ from those that were written'
            end if
            if (i == 1) finding%rows_behind = there - finding%rows
        end do
        if (status == 'complete' .and. finding%rows_behind > 0) finding%problem = 'it has more rows than checksums'
    end subroutine examine

    !> Read all rows of a file without checksums, to find unreadable ones.
    subroutine read_rows(file)
        type(hdf5_type), intent(inout) :: file
        character(len=:), allocatable :: names
        type(fletcher_type) :: early, sum
        integer(long) :: there
        integer :: i, start, last

        names = '/trajectory/time'
        do i = 1, size(fields)
            associate (path => '/'//trim(fields(i)%group)//'/'//trim(fields(i)%name))
                if (file%has(path)) names = names//' '//path
            end associate
        end do
        if (file%has('/events')) names = names//' '//event_paths
        last = 0
        do i = 1, count_of(names)
            start = last + 1
            last = end_of_name(names, start) + 1
            call file%sum_rows(names(start:last - 1), 0_long, huge(0_long), early, sum, there)
        end do
    end subroutine read_rows

    !> Read the place that was written last and is whole.
    subroutine read_place(file, finding, is_torn)
        type(hdf5_type), intent(inout) :: file
        type(finding_type), intent(inout) :: finding
        !> True if one of the places is incomplete.
        logical, intent(out) :: is_torn
        integer(long), allocatable :: words(:)
        integer :: i, n

        is_torn = .false.
        finding%has_checksums = .true.
        call file%get_text(place, 'datasets', finding%names)
        n = head + count_of(finding%names) + 1
        do i = 1, size(paths)
            call file%get_words(trim(paths(i)), words)
            if (allocated(file%problem)) return
            if (size(words) /= n) then
                finding%problem = 'its checksums are damaged'
                return
            end if
            if (all(words == 0)) then
                ! It was made, and not written yet.
                if (.not. allocated(finding%words)) finding%words = words
            else if (words(n) /= own_sum(words(:n - 1), finding%names)) then
                is_torn = .true.
            else if (.not. allocated(finding%words)) then
                finding%words = words
            else if (words(number_at) > finding%words(number_at)) then
                finding%words = words
            end if
        end do
        if (.not. allocated(finding%words)) finding%problem = 'its checksums are damaged'
        ! Nothing was added to any sum yet.
        if (allocated(finding%words)) then
            if (finding%words(number_at) == 0) finding%words(head + 1:n - 1) = empty_sum()
        end if
    end subroutine read_place

    !> The sum of no rows.
    pure integer(long) function empty_sum()
        type(fletcher_type) :: sum

        empty_sum = sum%value()
    end function empty_sum

    !> The checksum of a place.
    pure integer(long) function own_sum(words, names)
        integer(long), intent(in) :: words(:)
        character(len=*), intent(in) :: names
        type(fletcher_type) :: sum
        character(len=8*((len(names) + 7)/8)) :: padded

        padded = names
        call sum%add(words)
        call sum%add(transfer(padded, words))
        own_sum = sum%value()
    end function own_sum

    !> Position of the last letter of the name that begins at a position.
    pure integer function end_of_name(names, start)
        character(len=*), intent(in) :: names
        integer, intent(in) :: start

        end_of_name = start - 2 + index(names(start:), ' ')
        if (end_of_name < start) end_of_name = len(names)
    end function end_of_name

    !> How many names there are.
    pure integer function count_of(names)
        character(len=*), intent(in) :: names
        integer :: i

        count_of = count([(names(i:i) == ' ', i=1, len(names))]) + 1
    end function count_of
end module tandem_io_output_checksums
