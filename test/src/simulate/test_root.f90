! SPDX-License-Identifier: MIT
!> Tests of the searches for zeros and minima, on difficult functions.
module test_root
    use asserts, only: check_below, check_close, check_count, check_true
    use tandem, only: wp
    use tandem_simulate_root, only: bracket_type, minimum_type, vertex, zeros_type
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_root

contains

    !> The tests of this suite.
    subroutine collect_root(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('a-zero-is-found-in-bounded-work', test_bracket), &
            new_unittest('a-minimum-is-found-in-bounded-work', test_minimum), &
            new_unittest('the-vertex-of-a-parabola-is-exact', test_vertex), &
            new_unittest('zeros-come-in-order', test_zeros)]
    end subroutine collect_root

    !> Difficult functions on [0, 1] with one sign change.
    pure real(wp) function nasty(kind, x)
        integer, intent(in) :: kind
        real(wp), intent(in) :: x

        select case (kind)
        case (1)
            nasty = x - 0.3_wp
        case (2)
            nasty = (x - 0.3_wp)**9
        case (3)
            nasty = merge(1.0_wp, -1.0e-300_wp, x > 0.3_wp)
        case (4)
            nasty = exp(50*x) - exp(15.0_wp)
        case (5)
            nasty = x - 1.0e-12_wp
        case (6)
            nasty = atan(1.0e9_wp*(x - 0.3_wp))
        case default
            nasty = sign(1.0e300_wp, x - 0.3_wp)
        end select
    end function nasty

    subroutine test_bracket(error)
        type(error_type), allocatable, intent(out) :: error
        type(bracket_type) :: bracket
        real(wp) :: x, expected
        integer :: k, n

        do k = 1, 7
            expected = merge(1.0e-12_wp, 0.3_wp, k == 5)
            bracket = bracket_type(0.0_wp, 1.0_wp, nasty(k, 0.0_wp), nasty(k, 1.0_wp))
            do n = 1, 200
                if (bracket%b - bracket%a <= 1.0e-13_wp) exit
                x = bracket%next_point()
                call check_true(error, x > bracket%a .and. x < bracket%b, 'the point is inside')
                if (allocated(error)) return
                call bracket%narrow(x, nasty(k, x))
            end do
            ! Three points at most halve the bracket, and 2**-44 < 1e-13.
            call check_true(error, n <= 3*44 + 1, 'few points')
            if (k == 1) call check_true(error, n <= 8, 'a line takes few points')
            ! (x - 0.3)**9 is a zero of rounding only below 1e-36.
            call check_below(error, abs(bracket%b - expected), 1.0e-13_wp + merge(1.0e-13_wp, 0.0_wp, k == 2), 'distance')
            if (allocated(error)) return
        end do
    end subroutine test_bracket

    subroutine test_minimum(error)
        type(error_type), allocatable, intent(out) :: error
        type(minimum_type) :: minimum
        real(wp) :: x, value
        integer :: k, n
        real(wp), parameter :: place(4) = [0.3_wp, 0.3_wp, 1.0e-5_wp, 0.7_wp]

        do k = 1, 4
            call minimum%begin(0.0_wp, 1.0_wp)
            do n = 1, 200
                x = minimum%next_point()
                if (minimum%n_points > 3 .and. minimum%width() <= 2.0e-9_wp) exit
                if (x <= minimum%a .or. x >= minimum%b) exit
                select case (k)
                case (1)
                    value = (x - 0.3_wp)**2*(1 + x)
                case (2)
                    value = abs(x - 0.3_wp)
                case (3)
                    value = (x - 1.0e-5_wp)**2
                case default
                    value = -exp(-((x - 0.7_wp)/0.3_wp)**2)
                end select
                call minimum%narrow(x, value)
            end do
            ! The square root of rounding, for the Gauss bell; golden sections alone take 45 points.
            call check_below(error, abs(minimum%x - place(k)), 2.0e-8_wp, 'distance')
            call check_true(error, n <= 60, 'few points')
            if (k == 1) call check_true(error, n <= 20, 'parabolas are fast')
            if (allocated(error)) return
        end do
    end subroutine test_minimum

    subroutine test_vertex(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: x(3), place, extreme

        x = [0.0_wp, 0.1_wp, 0.7_wp]
        call vertex(x, 2*(x - 0.4_wp)**2 - 0.01_wp, place, extreme)
        call check_close(error, [place, extreme], [0.4_wp, -0.01_wp], 1.0e-15_wp, 'vertex')
        call vertex(x, x, place, extreme)
        call check_close(error, [place, extreme], [0.1_wp, 0.1_wp], 0.0_wp, 'a line')
    end subroutine test_vertex

    subroutine test_zeros(error)
        type(error_type), allocatable, intent(out) :: error
        type(zeros_type) :: zeros

        call zeros%allocate(4)
        call zeros%add(1, 0.5_wp, 1)
        call zeros%add(2, 0.2_wp, -1)
        call zeros%add(3, 0.5_wp, 0)
        call zeros%add(4, 0.1_wp, 1)
        call zeros%add(5, 0.0_wp, 1)
        call check_count(error, zeros%n, 4, 'zeros')
        call check_true(error, all(zeros%number == [4, 2, 1, 3]) .and. all(zeros%direction == [1, -1, 1, 0]), 'in order')
    end subroutine test_zeros
end module test_root
