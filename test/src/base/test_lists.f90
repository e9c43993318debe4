! SPDX-License-Identifier: MIT
!> doc/options.md lists exactly the options with their descriptions in the program, and the statistics of a run.
module test_lists
    use asserts, only: check_count, check_true
    use tandem, only: figure_reader_type, long, option_row_type, option_visitor_type, options_type, statistics_type, tell_figures, &
        to_text, wp
    use testdrive, only: error_type, new_unittest, test_failed, unittest_type
    implicit none (type, external)
    private

    public :: collect_lists

    character(len=*), parameter :: page = 'doc/options.md'

    type :: line_type
        character(len=:), allocatable :: text
    end type line_type

    !> Rows of a table of the page, and number of those that the program has.
    type, extends(option_visitor_type) :: option_finder_type
        type(line_type), allocatable :: rows(:)
        integer :: n_found = 0
        !> First missing row.
        character(len=:), allocatable :: missing
    contains
        procedure :: take => find_option
    end type option_finder_type

    type, extends(figure_reader_type) :: figure_finder_type
        type(line_type), allocatable :: rows(:)
        integer :: n_found = 0
        character(len=:), allocatable :: missing
    contains
        procedure :: count => find_count
        procedure :: value => find_value
    end type figure_finder_type

contains

    !> The suite.
    subroutine collect_lists(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('the-page-has-every-option', test_options), &
            new_unittest('the-page-has-every-figure', test_figures)]
    end subroutine collect_lists

    subroutine test_options(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options
        type(option_finder_type) :: finder

        call read_rows('## Options', finder%rows)
        call options%visit(finder)
        if (allocated(finder%missing)) then
            call test_failed(error, page//' lacks the line', finder%missing)
            return
        end if
        call check_count(error, size(finder%rows), finder%n_found, 'options in '//page)
    end subroutine test_options

    subroutine test_figures(error)
        type(error_type), allocatable, intent(out) :: error
        type(figure_finder_type) :: finder

        call read_rows('## Statistics', finder%rows)
        call tell_figures(statistics_type(), finder)
        if (allocated(finder%missing)) then
            call test_failed(error, page//' has no line for '//finder%missing)
            return
        end if
        call check_count(error, size(finder%rows), finder%n_found, 'statistics in '//page)
    end subroutine test_figures

    !> The rows of the table below a heading, without its head.
    subroutine read_rows(heading, rows)
        character(len=*), intent(in) :: heading
        type(line_type), allocatable, intent(out) :: rows(:)
        character(len=400) :: line
        logical :: is_below
        integer :: unit, stat

        allocate (rows(0))
        is_below = .false.
        open (newunit=unit, file=page, status='old', action='read', iostat=stat)
        if (stat /= 0) return
        do
            read (unit, '(a)', iostat=stat) line
            if (stat /= 0) exit
            if (line(:3) == '## ') is_below = line == heading
            if (is_below .and. line(:3) == '| `') rows = [rows, line_type(trim(line))]
        end do
        close (unit)
    end subroutine read_rows

    !> Expected line of an option: name, kind, default, unit, meaning; valid words.
    subroutine find_option(self, row, number, whole, word, list, choices)
        class(option_finder_type), intent(inout) :: self
        type(option_row_type), intent(in) :: row
        real(wp), intent(inout), optional :: number
        integer, intent(inout), optional :: whole
        character(len=*), intent(inout), optional :: word
        real(wp), allocatable, intent(inout), optional :: list(:)
        character(len=*), intent(in), optional :: choices(:)
        character(len=:), allocatable :: expected
        character(len=8) :: default
        integer :: i

        expected = ''
        if (present(number)) then
            default = '0'
            if (abs(number) > 0.0_wp) write (default, '(es8.1)') number
            expected = 'real | '//trim(adjustl(default))
        else if (present(whole)) then
            expected = 'integer | '//to_text(whole)
        else if (present(word)) then
            expected = 'text | `'//trim(word)//'`'
        else if (.not. allocated(list)) then
            expected = 'list (n) | none'
        end if
        expected = '| `'//trim(row%name)//'` | '//expected//' | '//trim(row%unit)//' | '//escaped(trim(row%help))
        if (present(choices)) then
            do i = 1, size(choices)
                expected = expected//trim(merge(': `', ', `', i == 1))//trim(choices(i))//'`'
            end do
        end if
        call find(self%rows, expected//' |', self%n_found, self%missing)
    end subroutine find_option

    !> A text in a table, in which a bar would end its cell.
    pure function escaped(text)
        character(len=*), intent(in) :: text
        character(len=:), allocatable :: escaped
        integer :: i

        escaped = ''
        do i = 1, len(text)
            if (text(i:i) == '|') escaped = escaped//'\'
            escaped = escaped//text(i:i)
        end do
    end function escaped

    subroutine find_count(self, name, number)
        class(figure_finder_type), intent(inout) :: self
        character(len=*), intent(in) :: name
        integer(long), intent(in) :: number

        call find(self%rows, '| `'//name//'` | counter |', self%n_found, self%missing)
    end subroutine find_count

    subroutine find_value(self, name, number)
        class(figure_finder_type), intent(inout) :: self
        character(len=*), intent(in) :: name
        real(wp), intent(in) :: number

        call find(self%rows, '| `'//name//'` | real |', self%n_found, self%missing)
    end subroutine find_value

    !> Find the row that begins as expected.
    subroutine find(rows, expected, n_found, missing)
        type(line_type), intent(in) :: rows(:)
        character(len=*), intent(in) :: expected
        integer, intent(inout) :: n_found
        character(len=:), allocatable, intent(inout) :: missing
        integer :: i

        do i = 1, size(rows)
            if (index(rows(i)%text, expected) /= 1) cycle
            n_found = n_found + 1
            return
        end do
        if (.not. allocated(missing)) missing = expected
    end subroutine find
end module test_lists
