! SPDX-License-Identifier: MIT
!> Tests of functions given by tables.
module test_table_function
    use asserts, only: check_below, check_close, check_count, check_failure, check_no_failure, check_true
    use tandem, only: failure_type => error_type, table_type, wp
    use testdrive, only: error_type, new_unittest, unittest_type
    use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
    implicit none (type, external)
    private

    public :: collect_table_function

    real(wp), parameter :: pi = acos(-1.0_wp)

contains

    !> The suite.
    subroutine collect_table_function(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('lines-between-points', test_linear), &
            new_unittest('ends-hold-extend-or-repeat', test_ends), &
            new_unittest('splines-that-can-be-written-down', test_cubic), &
            new_unittest('splines-converge-to-their-function', test_convergence), &
            new_unittest('splines-are-smooth-at-their-points', test_smoothness), &
            new_unittest('pieces-go-on-beyond-their-ends', test_pieces), &
            new_unittest('kinks-are-listed', test_kinks), &
            new_unittest('wrong-tables-are-named', test_errors)]
    end subroutine collect_table_function

    !> Fail unless value and derivatives are exactly so: the numbers are short.
    subroutine check_at(error, table, t, expected, what, piece)
        type(error_type), allocatable, intent(inout) :: error
        type(table_type), intent(in) :: table
        real(wp), intent(in) :: t, expected(3)
        character(len=*), intent(in) :: what
        integer, intent(in), optional :: piece
        real(wp) :: found(3)

        call table%evaluate(t, found(1), found(2), found(3), piece)
        call check_close(error, found, expected, 0.0_wp, what)
    end subroutine check_at

    !> Values and slopes, at points those behind them.
    subroutine test_linear(error)
        type(error_type), allocatable, intent(out) :: error
        type(table_type) :: table
        type(failure_type), allocatable :: failure

        call table%initialize([0.0_wp, 1.0_wp, 3.0_wp], [1.0_wp, 2.0_wp, -2.0_wp], 'linear', failure)
        call check_no_failure(error, failure)
        call check_at(error, table, -1.0_wp, [1.0_wp, 0.0_wp, 0.0_wp], 'before the table')
        call check_at(error, table, 0.5_wp, [1.5_wp, 1.0_wp, 0.0_wp], 'in the first piece')
        call check_at(error, table, 1.0_wp, [2.0_wp, -2.0_wp, 0.0_wp], 'at a point')
        call check_at(error, table, 2.0_wp, [0.0_wp, -2.0_wp, 0.0_wp], 'in the second piece')
        call check_at(error, table, 3.0_wp, [-2.0_wp, 0.0_wp, 0.0_wp], 'at the end')
        call check_at(error, table, 9.0_wp, [-2.0_wp, 0.0_wp, 0.0_wp], 'behind the table')
    end subroutine test_linear

    !> Extrapolation beyond the ends.
    subroutine test_ends(error)
        type(error_type), allocatable, intent(out) :: error
        type(table_type) :: table
        type(failure_type), allocatable :: failure
        real(wp) :: value, first, second

        call table%initialize([0.0_wp, 1.0_wp, 3.0_wp], [1.0_wp, 2.0_wp, -2.0_wp], 'linear', failure, ends='extend')
        call check_no_failure(error, failure)
        call check_at(error, table, -1.0_wp, [0.0_wp, 1.0_wp, 0.0_wp], 'before an extended table')
        call check_at(error, table, 4.0_wp, [-4.0_wp, -2.0_wp, 0.0_wp], 'behind an extended table')
        call table%initialize([0.0_wp, 1.0_wp, 2.0_wp], [0.0_wp, 1.0_wp, 0.0_wp], 'linear', failure, ends='repeat')
        call check_no_failure(error, failure)
        call check_at(error, table, 1.5_wp, [0.5_wp, -1.0_wp, 0.0_wp], 'in a repeated table')
        call check_at(error, table, 2.0_wp, [0.0_wp, 1.0_wp, 0.0_wp], 'at its first repetition')
        call check_at(error, table, 101.5_wp, [0.5_wp, -1.0_wp, 0.0_wp], 'in a copy of a repeated table')
        call check_at(error, table, -0.5_wp, [0.5_wp, -1.0_wp, 0.0_wp], 'in a copy before it')
        call check_at(error, table, -2.0_wp, [0.0_wp, 1.0_wp, 0.0_wp], 'at the beginning of that')
        ! Far beyond all numbers of pieces, too.
        call check_at(error, table, 2.0e12_wp + 0.5_wp, [0.5_wp, 1.0_wp, 0.0_wp], 'in a late copy')
        ! A spline with constant ends has no slope there, a linearly extrapolated one no curvature. The numbers are of order one.
        call table%initialize([0.0_wp, 1.0_wp, 3.0_wp], [1.0_wp, 2.0_wp, -2.0_wp], 'cubic', failure, ends='hold')
        call check_no_failure(error, failure)
        call table%evaluate(0.0_wp, value, first, second)
        call check_close(error, [value, first], [1.0_wp, 0.0_wp], 1.0e-14_wp, 'the start of a spline that holds its ends')
        call table%evaluate(3.0_wp, value, first, second, 2)
        call check_close(error, [value, first], [-2.0_wp, 0.0_wp], 1.0e-14_wp, 'its end')
        call check_at(error, table, 5.0_wp, [-2.0_wp, 0.0_wp, 0.0_wp], 'behind it')
        call table%initialize([0.0_wp, 1.0_wp, 3.0_wp], [1.0_wp, 2.0_wp, -2.0_wp], 'cubic', failure)
        call check_no_failure(error, failure)
        call table%evaluate(3.0_wp, value, first, second, 2)
        call check_close(error, [value, second], [-2.0_wp, 0.0_wp], 1.0e-14_wp, 'the end of a natural spline')
    end subroutine test_ends

    !> Splines with simple closed forms.
    subroutine test_cubic(error)
        type(error_type), allocatable, intent(out) :: error
        type(table_type) :: table
        type(failure_type), allocatable :: failure
        real(wp) :: found(3), t
        integer :: i

        ! The cardinal spline through 0, 1, 0 at -1, 0, 1: 1 - 3/2 t^2 + 1/2 |t|^3.
        call table%initialize([-1.0_wp, 0.0_wp, 1.0_wp], [0.0_wp, 1.0_wp, 0.0_wp], 'cubic', failure)
        call check_no_failure(error, failure)
        do i = -10, 10
            t = i/10.0_wp
            call table%evaluate(t, found(1), found(2), found(3))
            call check_close(error, found, [1.0_wp - 1.5_wp*t**2 + 0.5_wp*abs(t)**3, -3*t + 1.5_wp*t*abs(t), -3.0_wp + 3*abs(t)], &
                1.0e-14_wp, 'a cardinal spline')
        end do
        ! The spline with flat ends through 0 and 1 is 3 t^2 - 2 t^3.
        call table%initialize([0.0_wp, 1.0_wp], [0.0_wp, 1.0_wp], 'cubic', failure, ends='hold')
        call check_no_failure(error, failure)
        do i = 0, 9
            t = i/10.0_wp
            call table%evaluate(t, found(1), found(2), found(3))
            call check_close(error, found, [t**2*(3 - 2*t), 6*t*(1 - t), 6 - 12*t], 1.0e-14_wp, 'a spline with flat ends')
        end do
        ! A line stays a line.
        call table%initialize([0.0_wp, 1.0_wp, 1.5_wp, 4.0_wp], [1.0_wp, 3.0_wp, 4.0_wp, 9.0_wp], 'cubic', failure)
        call check_no_failure(error, failure)
        call table%evaluate(2.5_wp, found(1), found(2), found(3))
        call check_close(error, found, [6.0_wp, 2.0_wp, 0.0_wp], 1.0e-14_wp, 'a line')
    end subroutine test_cubic

    !> A periodic spline of the sine: errors fall as h^4, h^3 and h^2 in value, slope and curvature. The bounds are those of Hall
    !> and Meyer (1976) with their constants 5/384, 1/24 and 3/8, as no derivative of the sine exceeds one.
    subroutine test_convergence(error)
        type(error_type), allocatable, intent(out) :: error
        type(table_type) :: table
        type(failure_type), allocatable :: failure
        real(wp) :: found(3), h, t
        real(wp), allocatable :: x(:), y(:)
        integer :: i, n

        n = 8
        do while (n <= 128)
            h = 2*pi/n
            x = [(h*i, i=0, n)]
            y = sin(x)
            call table%initialize(x, y, 'cubic', failure, ends='repeat')
            call check_no_failure(error, failure)
            if (allocated(error)) return
            do i = -500, 500
                t = 0.0371_wp*i
                call table%evaluate(t, found(1), found(2), found(3))
                call check_below(error, abs(found(1) - sin(t)), 5*h**4/384 + 1.0e-14_wp, 'the error of a spline')
                call check_below(error, abs(found(2) - cos(t)), h**3/24 + 1.0e-13_wp, 'the error of its slope')
                call check_below(error, abs(found(3) + sin(t)), 3*h**2/8 + 1.0e-12_wp, 'the error of its curvature')
            end do
            n = 2*n
        end do
    end subroutine test_convergence

    !> Pieces agree in value, slope and curvature at the points, for any ends, and pass through the points, up to rounding.
    subroutine test_smoothness(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: x(6) = [-1.0_wp, -0.3_wp, 0.1_wp, 0.9_wp, 2.0_wp, 2.2_wp]
        real(wp), parameter :: y(6) = [0.3_wp, -0.5_wp, 0.7_wp, 0.2_wp, 0.9_wp, 0.3_wp]
        character(len=6), parameter :: ends(3) = ['hold  ', 'extend', 'repeat']
        type(table_type) :: table
        type(failure_type), allocatable :: failure
        real(wp) :: before(3), behind(3)
        integer :: i, k, n

        do n = 2, 6
            do k = 1, 3
                if (k == 3 .and. n < 6) cycle
                call table%initialize(x(:n), y(:n), 'cubic', failure, trim(ends(k)))
                call check_no_failure(error, failure)
                if (allocated(error)) return
                do i = merge(1, 2, k > 1), merge(n, n - 1, k > 1)
                    call table%evaluate(x(i), before(1), before(2), before(3), i - 1)
                    call table%evaluate(x(i), behind(1), behind(2), behind(3), i)
                    call check_close(error, before, behind, 1.0e-12_wp, 'the two sides of a point')
                    call check_close(error, before(:1), y(i:i), 1.0e-14_wp, 'a point')
                end do
            end do
        end do
        ! Two and three points that repeat.
        call table%initialize([0.0_wp, 1.0_wp], [2.0_wp, 2.0_wp], 'cubic', failure, 'repeat')
        call check_no_failure(error, failure)
        call check_at(error, table, 5.3_wp, [2.0_wp, 0.0_wp, 0.0_wp], 'a constant')
        call table%initialize([0.0_wp, 1.0_wp, 2.0_wp], [0.0_wp, 1.0_wp, 0.0_wp], 'cubic', failure, 'repeat')
        call check_no_failure(error, failure)
        call table%evaluate(0.5_wp, before(1), before(2), before(3))
        ! By symmetry, the slope at each point is zero: 3 t^2 - 2 t^3.
        call check_close(error, before, [0.5_wp, 1.5_wp, 0.0_wp], 1.0e-14_wp, 'a wave of two pieces')
    end subroutine test_smoothness

    !> A selected piece is the same function on both sides of its ends.
    subroutine test_pieces(error)
        type(error_type), allocatable, intent(out) :: error
        type(table_type) :: table
        type(failure_type), allocatable :: failure
        real(wp) :: t
        integer :: i

        call table%initialize([0.0_wp, 1.0_wp, 3.0_wp], [1.0_wp, 2.0_wp, -2.0_wp], 'linear', failure)
        call check_at(error, table, 1.5_wp, [2.5_wp, 1.0_wp, 0.0_wp], 'the first piece beyond its end', 1)
        call check_at(error, table, 0.5_wp, [3.0_wp, -2.0_wp, 0.0_wp], 'the second piece before its beginning', 2)
        call check_at(error, table, 0.5_wp, [1.0_wp, 0.0_wp, 0.0_wp], 'what holds before the table', 0)
        call check_at(error, table, 0.5_wp, [-2.0_wp, 0.0_wp, 0.0_wp], 'what holds behind the table', 3)
        call check_count(error, table%piece_at(-1.0_wp), 0, 'the piece before')
        call check_count(error, table%piece_at(0.0_wp), 1, 'the first piece')
        call check_count(error, table%piece_at(2.9_wp), 2, 'the second piece')
        call check_count(error, table%piece_at(3.0_wp), 3, 'the piece behind')
        call table%initialize([0.0_wp, 1.0_wp, 2.0_wp], [0.0_wp, 1.0_wp, 0.0_wp], 'linear', failure, ends='repeat')
        do i = -9, 9
            t = i + 0.5_wp
            call check_count(error, table%piece_at(t), i + 1, 'a piece of a repeated table')
            call check_at(error, table, t, [0.5_wp, 1.0_wp - 2*modulo(i, 2), 0.0_wp], 'a copy', i + 1)
        end do
        call check_at(error, table, 4.5_wp, [-0.5_wp, -1.0_wp, 0.0_wp], 'a copy beyond its end', 4)
    end subroutine test_pieces

    !> Places and orders of kinks.
    subroutine test_kinks(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: x(4) = [0.0_wp, 1.0_wp, 2.0_wp, 4.0_wp], y(4) = [0.0_wp, 1.0_wp, 2.0_wp, 3.0_wp]
        real(wp), parameter :: none(0) = [real(wp) ::]
        type(table_type) :: table
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: places(:)
        integer, allocatable :: orders(:)

        ! No kink where two pieces are on one line.
        call table%initialize(x, y, 'linear', failure)
        call expect(-9.0_wp, 9.0_wp, [0.0_wp, 2.0_wp, 4.0_wp], [1, 1, 1], 'lines that hold their ends')
        call expect(0.0_wp, 4.0_wp, [2.0_wp], [1], 'lines within the table')
        call expect(2.0_wp, 2.0_wp, none, [integer ::], 'no time')
        call table%initialize(x, y, 'linear', failure, ends='extend')
        call expect(-9.0_wp, 9.0_wp, [2.0_wp], [1], 'lines that go on')
        call table%initialize(x, y, 'linear', failure, ends='repeat')
        call expect(1.0_wp, 9.0_wp, [2.0_wp, 4.0_wp, 6.0_wp, 8.0_wp], [1, 0, 1, 0], 'a sawtooth')
        call table%initialize(x, y, 'cubic', failure)
        call expect(-9.0_wp, 9.0_wp, x, [3, 3, 3, 3], 'a spline')
        call table%initialize(x, y, 'cubic', failure, ends='hold')
        call expect(-9.0_wp, 9.0_wp, x, [2, 3, 3, 2], 'a spline that holds its ends')
        call table%initialize(x, 7*x - 3, 'cubic', failure)
        call expect(-9.0_wp, 9.0_wp, none, [integer ::], 'a line as a spline')
        call table%initialize(x, [5.0_wp, 5.0_wp, 5.0_wp, 5.0_wp], 'linear', failure)
        call expect(-9.0_wp, 9.0_wp, none, [integer ::], 'a constant')
        call table%initialize([0.0_wp, 1.0e-3_wp], [0.0_wp, 1.0_wp], 'linear', failure, ends='repeat')
        call table%find_kinks(0.0_wp, 1.0e9_wp, places, orders, failure)
        call check_failure(error, failure, 'invalid_model', 'more than 100000 kinks')

    contains

        subroutine expect(from, to, at, of, what)
            real(wp), intent(in) :: from, to, at(:)
            integer, intent(in) :: of(:)
            character(len=*), intent(in) :: what

            call table%find_kinks(from, to, places, orders, failure)
            call check_no_failure(error, failure)
            call check_close(error, places, at, 0.0_wp, 'kinks of '//what)
            if (allocated(error)) return
            call check_true(error, all(orders == of), 'orders of kinks of '//what)
        end subroutine expect
    end subroutine test_kinks

    !> Each error has its own message.
    subroutine test_errors(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: x(3) = [0.0_wp, 1.0_wp, 2.0_wp], y(3) = [0.0_wp, 1.0_wp, 3.0_wp]
        real(wp) :: nan

        nan = ieee_value(nan, ieee_quiet_nan)
        call check(x, y, 'spline', 'hold', 'there is no table of kind "spline"')
        call check(x, y, 'linear', 'stop', 'there are no ends "stop"')
        call check(x, y(:2), 'linear', 'hold', '3 arguments and 2 values')
        call check(x(:1), y(:1), 'linear', 'hold', 'has 1 points')
        call check(x(:0), y(:0), 'cubic', 'hold', 'has 0 points')
        call check([0.0_wp, 2.0_wp, 1.0_wp], y, 'cubic', 'hold', 'argument 3 of a table')
        call check([0.0_wp, 0.0_wp, 1.0_wp], y, 'linear', 'hold', 'argument 2 of a table')
        call check([0.0_wp, nan, 1.0_wp], y, 'linear', 'hold', 'not finite')
        call check(x, [0.0_wp, 1.0_wp, nan], 'cubic', 'hold', 'not finite')
        call check(x, y, 'cubic', 'repeat', 'a repeated cubic table ends with 3')
        call check([0.0_wp, 1.0e-300_wp, 1.0_wp], [0.0_wp, 1.0e30_wp, 0.0_wp], 'linear', 'hold', 'too fast')

    contains

        subroutine check(x, y, kind, ends, piece)
            real(wp), intent(in) :: x(:), y(:)
            character(len=*), intent(in) :: kind, ends, piece
            type(table_type) :: table
            type(failure_type), allocatable :: failure

            call table%initialize(x, y, kind, failure, ends)
            call check_failure(error, failure, 'invalid_model', piece)
        end subroutine check
    end subroutine test_errors
end module test_table_function
