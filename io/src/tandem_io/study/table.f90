! SPDX-License-Identifier: MIT
!> A table of results: named columns of texts, counts or numbers, one row per run; and its layout on a terminal.
!>
!> Cells are stored as text in full precision, as in the CSV file. Hence values read back are equal to the written ones.
module tandem_io_study_table
    use tandem, only: long, to_text, wp
    use tandem_io_scene_text, only: to_toml
    use tandem_number_text, only: read_number
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite, ieee_is_nan, ieee_quiet_nan, ieee_value
    implicit none (type, external)
    private

    public :: table_type, column_type, cell_length, text_column, count_column, real_column, brief

    !> Largest length of a cell.
    integer, parameter :: cell_length = 256
    !> Kinds of columns.
    integer, parameter :: text_column = 1, count_column = 2, real_column = 3

    !> Largest length of a number that is shown unchanged.
    integer, parameter :: short_enough = 6

    !> A column.
    type :: column_type
        !> Name in files, and heading on the terminal; columns without a heading are not shown.
        character(len=24) :: name, heading
        !> `text_column`, `count_column` or `real_column`.
        integer :: kind
        !> Unit; `1` for dimensionless numbers.
        character(len=8) :: unit
        !> Description of the column.
        character(len=120) :: meaning
    end type column_type

    type :: table_type
        type(column_type), allocatable :: columns(:)
        !> Cells (columns, rows); an empty cell is a missing value.
        character(len=cell_length), allocatable :: cells(:, :)
    contains
        procedure :: initialize, rows, index_of, new_row, add
        generic :: put => put_text, put_count, put_real
        procedure, private :: put_text, put_count, put_real
        procedure :: text_at, real_at, count_at, header, line
        procedure, private :: width
    end type table_type

contains

    !> Define an empty table.
    subroutine initialize(self, columns)
        class(table_type), intent(inout) :: self
        type(column_type), intent(in) :: columns(:)

        self%columns = columns
        if (allocated(self%cells)) deallocate (self%cells)
        allocate (self%cells(size(columns), 0))
    end subroutine initialize

    !> Number of rows.
    pure integer function rows(self)
        class(table_type), intent(in) :: self

        rows = size(self%cells, 2)
    end function rows

    !> Index of a column; 0 if no column has the name.
    pure integer function index_of(self, name)
        class(table_type), intent(in) :: self
        character(len=*), intent(in) :: name

        do index_of = size(self%columns), 1, -1
            if (self%columns(index_of)%name == name) return
        end do
    end function index_of

    !> Empty cells of a new row.
    pure function new_row(self) result(cells)
        class(table_type), intent(in) :: self
        character(len=cell_length) :: cells(size(self%columns))

        cells = ''
    end function new_row

    !> Append a row.
    subroutine add(self, cells)
        class(table_type), intent(inout) :: self
        !> One cell per column.
        character(len=*), intent(in) :: cells(:)
        character(len=cell_length), allocatable :: more(:, :)

        allocate (more(size(self%columns), self%rows() + 1))
        more(:, :self%rows()) = self%cells
        more(:, size(more, 2)) = cells
        call move_alloc(more, self%cells)
    end subroutine add

    !> Set the text of a cell in a named column.
    subroutine put_text(self, cells, name, value)
        class(table_type), intent(in) :: self
        character(len=*), intent(inout) :: cells(:)
        character(len=*), intent(in) :: name, value

        cells(self%index_of(name)) = value
    end subroutine put_text

    !> Set the count of a cell in a named column.
    subroutine put_count(self, cells, name, value)
        class(table_type), intent(in) :: self
        character(len=*), intent(inout) :: cells(:)
        character(len=*), intent(in) :: name
        integer(long), intent(in) :: value
        character(len=24) :: buffer

        write (buffer, '(i0)') value
        cells(self%index_of(name)) = buffer
    end subroutine put_count

    !> Set the number of a cell with all digits; the cell is empty if the number is not finite.
    subroutine put_real(self, cells, name, value)
        class(table_type), intent(in) :: self
        character(len=*), intent(inout) :: cells(:)
        character(len=*), intent(in) :: name
        real(wp), intent(in) :: value

        cells(self%index_of(name)) = ''
        if (ieee_is_finite(value)) cells(self%index_of(name)) = to_toml(value)
    end subroutine put_real

    !> Text of a cell.
    pure function text_at(self, row, name) result(text)
        class(table_type), intent(in) :: self
        integer, intent(in) :: row
        character(len=*), intent(in) :: name
        character(len=:), allocatable :: text

        text = trim(self%cells(self%index_of(name), row))
    end function text_at

    !> Number in a cell; NaN if it is empty.
    pure real(wp) function real_at(self, row, name)
        class(table_type), intent(in) :: self
        integer, intent(in) :: row
        character(len=*), intent(in) :: name

        real_at = number(self%cells(self%index_of(name), row))
    end function real_at

    !> Count in a cell; 0 if it is empty.
    pure integer(long) function count_at(self, row, name)
        class(table_type), intent(in) :: self
        integer, intent(in) :: row
        character(len=*), intent(in) :: name
        logical :: is_read

        call read_number(self%cells(self%index_of(name), row), count_at, is_read)
    end function count_at

    !> Headings for the terminal.
    pure function header(self) result(text)
        class(table_type), intent(in) :: self
        character(len=:), allocatable :: text
        integer :: i

        text = ''
        do i = 1, size(self%columns)
            if (self%columns(i)%heading == '') cycle
            text = text//aligned(trim(self%columns(i)%heading), self%width(i), self%columns(i)%kind)//'  '
        end do
        text = trim(text)
    end function header

    !> Row for the terminal.
    pure function line(self, row) result(text)
        class(table_type), intent(in) :: self
        integer, intent(in) :: row
        character(len=:), allocatable :: text
        integer :: i

        text = ''
        do i = 1, size(self%columns)
            if (self%columns(i)%heading == '') cycle
            text = text//aligned(shown(self%cells(i, row), self%columns(i)%kind), self%width(i), self%columns(i)%kind)//'  '
        end do
        text = trim(text)
    end function line

    !> Width of a column on the terminal: the larger one of the widths of its heading and of its widest cell.
    pure integer function width(self, column)
        class(table_type), intent(in) :: self
        integer, intent(in) :: column
        integer :: row

        width = len_trim(self%columns(column)%heading)
        do row = 1, self%rows()
            width = max(width, len(shown(self%cells(column, row), self%columns(column)%kind)))
        end do
    end function width

    !> Cell for the terminal: numbers with two digits, a dash if the cell is empty.
    pure function shown(cell, kind) result(text)
        character(len=*), intent(in) :: cell
        integer, intent(in) :: kind
        character(len=:), allocatable :: text

        if (cell == '') then
            text = '-'
        else if (kind == real_column .and. len_trim(cell) > short_enough .and. .not. ieee_is_nan(number(cell))) then
            text = brief(number(cell))
        else
            text = trim(cell)
        end if
    end function shown

    !> Align texts left and numbers right.
    pure function aligned(text, width, kind) result(cell)
        character(len=*), intent(in) :: text
        integer, intent(in) :: width, kind
        character(len=max(width, len(text))) :: cell

        cell = text
        if (kind /= text_column) cell = adjustr(cell)
    end function aligned

    !> Number with two significant digits, without an exponent if this is not longer; infinities and NaN as words.
    pure function brief(value) result(text)
        real(wp), intent(in) :: value
        character(len=:), allocatable :: text
        character(len=16) :: buffer
        integer :: point, exponent

        if (.not. ieee_is_finite(value)) then
            buffer = to_text(value)
        else if (abs(value) <= 0.0_wp) then
            buffer = '0'
        else if (abs(value) >= 10.0_wp .and. abs(value) < 1.0e4_wp) then
            write (buffer, '(i0)') nint(value)
        else if (abs(value) >= 1.0_wp .and. abs(value) < 10.0_wp) then
            write (buffer, '(f9.1)') value
        else if (abs(value) >= 0.01_wp .and. abs(value) < 1.0_wp) then
            write (buffer, '(f9.3)') value
            if (abs(value) >= 0.1_wp) write (buffer, '(f9.2)') value
        else
            write (buffer, '(es10.1e3)') value
            point = index(buffer, 'E')
            read (buffer(point + 1:), *) exponent
            write (buffer(point:), '("e", i0)') exponent
        end if
        text = trim(adjustl(buffer))
    end function brief

    !> Number in a cell; NaN if the cell contains no number.
    pure real(wp) function number(cell)
        character(len=*), intent(in) :: cell
        logical :: is_read

        call read_number(cell, number, is_read)
        if (.not. is_read) number = ieee_value(number, ieee_quiet_nan)
    end function number
end module tandem_io_study_table
