! SPDX-License-Identifier: MIT
!> Checks with messages that contain the value and the bound.
module asserts
    use tandem, only: failure_type => error_type, long, status_name, wp
    use testdrive, only: error_type, test_failed
    implicit none (type, external)
    private

    public :: check_below, check_between, check_count, check_text, check_no_failure, check_failure, check_stopped, check_close, &
        check_true
    public :: format_real

    !> Counters have two kinds.
    interface check_count
        module procedure check_count_default
        module procedure check_count_long
    end interface check_count

contains

    !> Fail unless a condition holds. Unlike the checks of test-drive, those of this module keep an earlier failure.
    subroutine check_true(error, condition, what)
        type(error_type), allocatable, intent(inout) :: error
        logical, intent(in) :: condition
        character(len=*), intent(in) :: what

        if (allocated(error) .or. condition) return
        call test_failed(error, 'not so: '//what)
    end subroutine check_true

    !> Fail unless value <= bound. A NaN fails.
    subroutine check_below(error, value, bound, what)
        type(error_type), allocatable, intent(inout) :: error
        real(wp), intent(in) :: value, bound
        !> Description of the value.
        character(len=*), intent(in) :: what

        if (allocated(error)) return
        if (value <= bound) return
        call test_failed(error, what//' is '//format_real(value)//', allowed are '//format_real(bound))
    end subroutine check_below

    !> Fail unless low <= value <= high. A NaN fails.
    subroutine check_between(error, value, low, high, what)
        type(error_type), allocatable, intent(inout) :: error
        real(wp), intent(in) :: value, low, high
        character(len=*), intent(in) :: what

        if (allocated(error)) return
        if (value >= low .and. value <= high) return
        call test_failed(error, what//' is '//format_real(value)//', expected from '//format_real(low)//' to '//format_real(high))
    end subroutine check_between

    !> Fail unless the arrays agree within a bound in the max-norm. A NaN fails.
    subroutine check_close(error, found, expected, bound, what)
        type(error_type), allocatable, intent(inout) :: error
        real(wp), intent(in) :: found(:), expected(:), bound
        character(len=*), intent(in) :: what
        integer :: i

        if (allocated(error)) return
        if (size(found) /= size(expected)) then
            call test_failed(error, what//': sizes differ')
            return
        end if
        do i = 1, size(found)
            if (abs(found(i) - expected(i)) <= bound) cycle
            call test_failed(error, what//' differ by '//format_real(abs(found(i) - expected(i)))//', allowed are '// &
                format_real(bound))
            return
        end do
    end subroutine check_close

    !> Fail unless a counter has a value.
    subroutine check_count_default(error, found, expected, what)
        type(error_type), allocatable, intent(inout) :: error
        integer, intent(in) :: found, expected
        character(len=*), intent(in) :: what

        call check_count_long(error, int(found, long), expected, what)
    end subroutine check_count_default

    !> Fail unless a counter has a value.
    subroutine check_count_long(error, found, expected, what)
        type(error_type), allocatable, intent(inout) :: error
        integer(long), intent(in) :: found
        integer, intent(in) :: expected
        character(len=*), intent(in) :: what
        character(len=64) :: text

        if (allocated(error)) return
        if (found == expected) return
        write (text, '(a, i0, a, i0)') ': found ', found, ', expected ', expected
        call test_failed(error, what//trim(text))
    end subroutine check_count_long

    !> Fail unless a text contains a piece.
    subroutine check_text(error, text, piece)
        type(error_type), allocatable, intent(inout) :: error
        character(len=*), intent(in) :: text, piece

        if (allocated(error)) return
        if (index(text, piece) > 0) return
        call test_failed(error, 'the message "'//text//'" should contain "'//piece//'"')
    end subroutine check_text

    !> Fail if tandem reported a failure.
    subroutine check_no_failure(error, failure)
        type(error_type), allocatable, intent(inout) :: error
        type(failure_type), allocatable, intent(in) :: failure

        if (allocated(error)) return
        if (.not. allocated(failure)) return
        call test_failed(error, 'tandem reported: '//failure%message)
    end subroutine check_no_failure

    !> Fail unless tandem reported a failure of this name with a message that contains a piece.
    subroutine check_failure(error, failure, name, piece)
        type(error_type), allocatable, intent(inout) :: error
        type(failure_type), allocatable, intent(in) :: failure
        !> The expected status's name.
        character(len=*), intent(in) :: name
        character(len=*), intent(in), optional :: piece

        call check_stopped(error, failure, [name], piece)
    end subroutine check_failure

    !> Fail unless tandem reported a failure, optionally with one of some statuses and a message that contains a piece.
    subroutine check_stopped(error, failure, names, piece, place)
        type(error_type), allocatable, intent(inout) :: error
        type(failure_type), allocatable, intent(in) :: failure
        !> Names of the allowed statuses.
        character(len=*), intent(in), optional :: names(:)
        character(len=*), intent(in), optional :: piece
        !> Name of the run among many.
        character(len=*), intent(in), optional :: place
        character(len=:), allocatable :: expected

        if (allocated(error)) return
        expected = 'a failure'
        if (present(names)) then
            expected = trim(names(1))
            if (size(names) > 1) expected = expected//' or the like'
        end if
        if (.not. allocated(failure)) then
            call test_failed(error, 'tandem should have reported '//expected)
        else
            if (present(names)) then
                if (.not. any(names == status_name(failure%stat))) then
                    call test_failed(error, 'expected '//expected//', tandem reported: '//failure%message)
                end if
            end if
            if (present(piece)) call check_text(error, failure%message, piece)
            ! Every message begins with its status, has a text and gives advice.
            call check_text(error, failure%message, status_name(failure%stat)//': ')
            call check_text(error, failure%message, '; ')
        end if
        if (allocated(error) .and. present(place)) error%message = error%message//' ['//place//']'
    end subroutine check_stopped

    !> A real number as text.
    function format_real(value) result(text)
        real(wp), intent(in) :: value
        character(len=:), allocatable :: text
        character(len=16) :: buffer

        write (buffer, '(es12.4)') value
        text = trim(adjustl(buffer))
    end function format_real
end module asserts
