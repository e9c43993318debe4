! SPDX-License-Identifier: MIT
!> Lines of comma-separated values according to RFC 4180: cells are quoted if necessary, and quotes in them are doubled.
module tandem_io_study_csv
    implicit none (type, external)
    private

    public :: csv_line, split_csv_line

contains

    !> Line of cells without trailing blanks. Cells must not contain newlines.
    pure function csv_line(cells) result(line)
        character(len=*), intent(in) :: cells(:)
        character(len=:), allocatable :: line
        integer :: i, j

        line = ''
        do i = 1, size(cells)
            if (i > 1) line = line//','
            if (scan(trim(cells(i)), ',"') == 0) then
                line = line//trim(cells(i))
            else
                line = line//'"'
                do j = 1, len_trim(cells(i))
                    if (cells(i) (j:j) == '"') line = line//'"'
                    line = line//cells(i) (j:j)
                end do
                line = line//'"'
            end if
        end do
    end function csv_line

    !> Split a line into cells. `whole` is false if the number of cells differs from the requested number, or if a quote is not
    !> closed.
    subroutine split_csv_line(line, cells, whole)
        character(len=*), intent(in) :: line
        character(len=*), intent(out) :: cells(:)
        logical, intent(out) :: whole
        logical :: quoted
        integer :: i, cell, filled

        cells = ''
        whole = .false.
        quoted = .false.
        cell = 1
        filled = 0
        i = 1
        do while (i <= len(line))
            if (line(i:i) == '"') then
                if (quoted .and. i < len(line)) then
                    if (line(i + 1:i + 1) == '"') then
                        i = i + 1
                        call append('"')
                        i = i + 1
                        cycle
                    end if
                end if
                quoted = .not. quoted
            else if (line(i:i) == ',' .and. .not. quoted) then
                cell = cell + 1
                filled = 0
                if (cell > size(cells)) return
            else
                call append(line(i:i))
            end if
            i = i + 1
        end do
        whole = cell == size(cells) .and. .not. quoted
    contains
        !> Append a letter to the current cell; letters that exceed its length are dropped.
        subroutine append(letter)
            character(len=1), intent(in) :: letter

            filled = filled + 1
            if (filled <= len(cells)) cells(cell) (filled:filled) = letter
        end subroutine append
    end subroutine split_csv_line
end module tandem_io_study_csv
