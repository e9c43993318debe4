! SPDX-License-Identifier: MIT
!> Reads a file of cases: comma-separated values with keys in the first line and one case per further line.
module tandem_io_sweep_columns
    use tandem, only: atom_type, is_number, is_text, is_truth, long, to_text
    use tandem_io_study_csv, only: split_csv_line
    use tandem_io_study_files, only: read_whole
    use tandem_number_text, only: read_number
    use tandem_pack, only: checksum
    implicit none (type, external)
    private

    public :: read_columns

    character(len=*), parameter :: newline = new_line('a'), byte_order_mark = char(239)//char(187)//char(191)

contains

    !> Read the complete file.
    subroutine read_columns(path, names, atoms, sum, problem)
        character(len=*), intent(in) :: path
        !> Keys, and values (columns, rows).
        character(len=*), allocatable, intent(out) :: names(:)
        type(atom_type), allocatable, intent(out) :: atoms(:, :)
        !> Checksum of the file.
        character(len=16), intent(out) :: sum
        !> Problem of the file as a sentence that continues the key `csv`; empty if there is none.
        character(len=:), allocatable, intent(out) :: problem
        character(len=:), allocatable :: text, line
        character(len=256), allocatable :: cells(:)
        logical :: is_complete
        integer, parameter :: word = storage_size(0_long)/storage_size('a')
        integer :: from, number, rows, i, n

        problem = ''
        sum = ''
        call read_whole(path, text)
        if (.not. allocated(text)) then
            problem = 'names a file that cannot be read, '//path
            return
        end if
        write (sum, '(z16.16)') checksum(transfer(text//repeat(' ', word), [0_long], len(text)/word + 1))
        from = 1
        line = next_line(text, from)
        ! Spreadsheets write a byte order mark before UTF-8.
        if (index(line, byte_order_mark) == 1) line = line(len(byte_order_mark) + 1:)
        n = 1
        do i = 1, len(line)
            if (line(i:i) == ',') n = n + 1
        end do
        allocate (names(n), cells(n))
        call split_csv_line(line, cells, is_complete)
        do i = 1, n
            names(i) = adjustl(cells(i))
        end do
        if (.not. is_complete .or. any(names == '')) then
            problem = 'names the file '//path//', whose first line is not a list of keys'
            return
        end if
        rows = count_lines(text(from:))
        if (rows == 0) problem = 'names the file '//path//', which contains no cases'
        allocate (atoms(n, rows))
        rows = 0
        number = 1
        do while (from <= len(text) .and. problem == '')
            line = next_line(text, from)
            number = number + 1
            if (line == '') cycle
            rows = rows + 1
            call split_csv_line(line, cells, is_complete)
            if (.not. is_complete) problem = 'names the file '//path//', whose line '//to_text(number)// &
                ' does not have '//to_text(n)//' values'
            do i = 1, n
                if (problem /= '') exit
                atoms(i, rows) = atom_from(trim(adjustl(cells(i))))
                if (cells(i) == '') problem = 'names the file '//path//', whose line '//to_text(number)// &
                    ' has no value of '//trim(names(i))
                if (atoms(i, rows)%kind /= atoms(i, 1)%kind) problem = 'names the file '//path//', whose line '// &
                    to_text(number)//' has "'//trim(cells(i))//'" for '//trim(names(i))//', whose type differs from earlier lines'
            end do
        end do
    end subroutine read_columns

    !> Next line without its end; `from` is advanced to the following line.
    function next_line(text, from) result(line)
        character(len=*), intent(in) :: text
        integer, intent(inout) :: from
        character(len=:), allocatable :: line
        integer :: length

        length = index(text(from:), newline) - 1
        if (length < 0) length = len(text) - from + 1
        line = text(from:from + length - 1)
        from = from + length + 1
        if (len(line) == 0) return
        if (line(len(line):) == achar(13)) line = line(:len(line) - 1)
    end function next_line

    !> Number of lines that are not empty.
    integer function count_lines(text) result(n)
        character(len=*), intent(in) :: text
        integer :: from

        n = 0
        from = 1
        do while (from <= len(text))
            if (next_line(text, from) /= '') n = n + 1
        end do
    end function count_lines

    !> Convert a text to a number, a truth value or a text.
    function atom_from(text) result(atom)
        character(len=*), intent(in) :: text
        type(atom_type) :: atom
        logical :: is_read

        atom%kind = is_number
        call read_number(text, atom%number, is_read)
        if (is_read) return
        if (text == 'true' .or. text == 'false') then
            atom%kind = is_truth
            atom%truth = text == 'true'
        else
            atom%kind = is_text
            atom%text = text
        end if
    end function atom_from
end module tandem_io_sweep_columns
