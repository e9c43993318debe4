! SPDX-License-Identifier: MIT
!> Tests of the reader of reference solutions, and of helpers of other tests.
module test_reference
    use asserts, only: check_below, check_close, check_count, check_true
    use differences, only: random_vector
    use extrapolation, only: equation_type, extrapolate
    use reference, only: read_reference, reference_type
    use runs, only: scene_names
    use tandem, only: wp
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_reference

    !> y' = t y.
    type, extends(equation_type) :: growth_type
    contains
        procedure :: slope
    end type growth_type

contains

    !> The suite.
    subroutine collect_reference(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('every-table-is-read', test_tables), &
            new_unittest('all-digits-are-read', test_digits), &
            new_unittest('times-are-found', test_find), &
            new_unittest('extrapolation-is-accurate-to-rounding', test_extrapolation), &
            new_unittest('random-numbers-spread', test_random)]
    end subroutine collect_reference

    subroutine test_tables(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: rows(5) = [42, 21, 11, 10, 12], n(5) = [6, 9, 7, 3, 3], m(5) = [5, 6, 4, 1, 1]
        type(reference_type) :: table
        integer :: i

        do i = 1, size(scene_names)
            call read_reference(trim(scene_names(i)), table)
            call check_count(error, size(table%t), rows(i), scene_names(i)//': rows')
            call check_count(error, size(table%q, 1), n(i), scene_names(i)//': coordinates')
            call check_count(error, size(table%lambda, 1), m(i), scene_names(i)//': multipliers')
            call check_true(error, all(table%t(2:) > table%t(:rows(i) - 1)), scene_names(i)//': times ascend')
        end do
    end subroutine test_tables

    !> x1 and y1 of the vehicle at t = 10, known to fifteen digits.
    subroutine test_digits(error)
        type(error_type), allocatable, intent(out) :: error
        type(reference_type) :: table

        call read_reference('vehicle', table)
        call check_close(error, table%q(1:2, 42), [155.873568637815_wp, 4.00289058254929_wp], 5.0e-13_wp, 'x1 and y1')
    end subroutine test_digits

    subroutine test_find(error)
        type(error_type), allocatable, intent(out) :: error
        type(reference_type) :: table

        call read_reference('vehicle', table)
        call check_count(error, table%find(0.0_wp), 1, 'row of t = 0')
        call check_count(error, table%find(8*atan(1.0_wp)), 27, 'row of t = 2 pi')
        call check_count(error, table%find(0.1_wp), 0, 'row of a time that is not there')
    end subroutine test_find

    subroutine slope(self, t, y, yd)
        class(growth_type), intent(in) :: self
        real(wp), intent(in) :: t, y(:)
        real(wp), intent(out) :: yd(:)

        yd = t*y
    end subroutine slope

    !> y = exp(t**2/2).
    subroutine test_extrapolation(error)
        type(error_type), allocatable, intent(out) :: error
        type(growth_type) :: equation
        real(wp) :: y(1)

        y = 1.0_wp
        call extrapolate(equation, 0.0_wp, 2.0_wp, 10, y)
        ! Rounding of ten macro steps with weights of up to ten in the tableau.
        call check_below(error, abs(y(1)/exp(2.0_wp) - 1), 1.0e-13_wp, 'relative error')
    end subroutine test_extrapolation

    subroutine test_random(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: values(1000)
        integer :: seed

        seed = 1
        call random_vector(seed, values)
        call check_below(error, maxval(abs(values)), 1.0_wp, 'largest modulus')
        ! Five standard deviations of the mean of numbers from -1 to 1.
        call check_below(error, abs(sum(values)/1000), 5*sqrt(1.0_wp/3/1000), 'mean')
        call check_true(error, maxval(values) > 0.98_wp .and. minval(values) < -0.98_wp, 'the numbers reach both ends')
    end subroutine test_random
end module test_reference
