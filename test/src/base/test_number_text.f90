! SPDX-License-Identifier: MIT
!> Tests of numbers from text. The expected values are written as Fortran constants.
module test_number_text
    use asserts, only: check_close, check_true
    use tandem, only: long, wp
    use tandem_number_text, only: read_number, read_numbers
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_number_text

    !> Texts that a list-directed read accepts as a number, or ignores without an error, and other typing errors.
    character(len=10), parameter :: refused(*) = [character(len=10) :: '', '2*100', '2*', ',', '/', '1,2', '1e3 xyz', '1 2', &
        '1-5', '1+5', '1e', '1e+', 'e5', '.', '+', '-', '1.2.3', '1d3', '0x10', 'nan', 'inf', '1e400', '"1"', '1;', '1_000', '--1']

contains

    !> The suite.
    subroutine collect_number_text(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('numbers-are-read', test_numbers), &
            new_unittest('other-texts-are-refused', test_refused), &
            new_unittest('whole-numbers-are-read', test_whole), &
            new_unittest('several-numbers-are-read', test_several)]
    end subroutine collect_number_text

    subroutine test_numbers(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=10), parameter :: texts(*) = [character(len=10) :: '1', ' 2.5 ', '-3.', '+.5', '1e3', '1E-3', '-1.5e+2', &
            '007']
        real(wp), parameter :: values(*) = [1.0_wp, 2.5_wp, -3.0_wp, 0.5_wp, 1.0e3_wp, 1.0e-3_wp, -150.0_wp, 7.0_wp]
        real(wp) :: number
        logical :: is_read
        integer :: i

        do i = 1, size(texts)
            call read_number(texts(i), number, is_read)
            call check_true(error, is_read, trim(texts(i))//' is read')
            call check_close(error, [number], values(i:i), 0.0_wp, texts(i))
        end do
    end subroutine test_numbers

    subroutine test_refused(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: number
        integer :: whole
        integer(long) :: wide
        logical :: is_read
        integer :: i

        do i = 1, size(refused)
            number = 5.0_wp
            call read_number(trim(refused(i)), number, is_read)
            call check_true(error, .not. is_read, '"'//trim(refused(i))//'" is refused')
            call check_close(error, [number], [0.0_wp], 0.0_wp, 'a number that is not read')
            call read_number(refused(i), whole, is_read)
            call check_true(error, .not. is_read .and. whole == 0, '"'//trim(refused(i))//'" is refused as a whole number')
            call read_number(refused(i), wide, is_read)
            call check_true(error, .not. is_read .and. wide == 0, '"'//trim(refused(i))//'" is refused as a long number')
        end do
    end subroutine test_refused

    subroutine test_whole(error)
        type(error_type), allocatable, intent(out) :: error
        integer :: number
        integer(long) :: wide
        logical :: is_read

        call read_number(' 2147483647 ', number, is_read)
        call check_true(error, is_read .and. number == huge(number), 'the largest one')
        call read_number('-12', number, is_read)
        call check_true(error, is_read .and. number == -12, 'a negative one')
        call read_number('2147483648', number, is_read)
        call check_true(error, .not. is_read, 'one more than the largest one is refused')
        call read_number('2147483648', wide, is_read)
        call check_true(error, is_read .and. wide == int(huge(number), long) + 1, 'but not as a long one')
        call read_number('9223372036854775808', wide, is_read)
        call check_true(error, .not. is_read, 'one more than the largest long one is refused')
        call read_number('1.0', number, is_read)
        call check_true(error, .not. is_read, 'a real number is refused')
        call read_number('1e3', number, is_read)
        call check_true(error, .not. is_read, 'an exponent is refused')
    end subroutine test_whole

    subroutine test_several(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: numbers(3)
        logical :: is_read
        integer :: i
        character(len=14), parameter :: wrong(*) = [character(len=14) :: '1 2', '1 2 3 4', '1,,2,3', ',1,2,3', '1 2 3,', '1;2;3', &
            '3*1', '1 2 x', '']

        call read_numbers(' 1, 2e0'//achar(9)//'3 ', numbers, is_read)
        call check_true(error, is_read, 'three numbers are read')
        call check_close(error, numbers, [1.0_wp, 2.0_wp, 3.0_wp], 0.0_wp, 'three numbers')
        do i = 1, size(wrong)
            call read_numbers(trim(wrong(i)), numbers, is_read)
            call check_true(error, .not. is_read, '"'//trim(wrong(i))//'" is refused as three numbers')
        end do
        call read_numbers('1 2 3 and more', numbers, is_read, may_be_more=.true.)
        call check_true(error, is_read, 'more may follow')
    end subroutine test_several
end module test_number_text
