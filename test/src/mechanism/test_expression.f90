! SPDX-License-Identifier: MIT
!> Tests of expressions.
module test_expression
    use asserts, only: check_below, check_close, check_count, check_failure, check_no_failure, check_text, check_true
    use expression_trees, only: trees_type
    use tandem, only: expression_type, failure_type => error_type, is_input_error, parse_expression, to_text, wp
    use tandem_linalg_random, only: random_vector
    use testdrive, only: error_type, new_unittest, unittest_type
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite, ieee_is_nan
    implicit none (type, external)
    private

    public :: collect_expression

    character(len=6), parameter :: variables(4) = ['t     ', 'length', 'rate  ', 'rod.x ']
    real(wp), parameter :: pi = acos(-1.0_wp)

    !> A text and its value at t = 0.5, length = 2, rate = -3, rod.x = 0.25, with the constants k = 7 and l0 = 1.5.
    type :: value_case_type
        character(len=40) :: text
        real(wp) :: value
    end type value_case_type

    !> A text, and the column and a piece of the message.
    type :: error_case_type
        character(len=48) :: text
        integer :: column
        character(len=48) :: piece
    end type error_case_type

contains

    !> The suite.
    subroutine collect_expression(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('precedence-and-associativity', test_precedence), &
            new_unittest('random-expressions-have-the-derivatives-of-a-textbook', test_random), &
            new_unittest('functions-have-their-values-and-derivatives', test_functions), &
            new_unittest('powers-of-all-signs', test_powers), &
            new_unittest('constants-are-folded-and-nothing-is-done-twice', test_folding), &
            new_unittest('kinks-have-two-sides', test_kinks), &
            new_unittest('kinks-can-be-asked-for', test_kink_queries), &
            new_unittest('what-does-not-exist-is-no-number', test_not_finite), &
            new_unittest('malformed-expressions-name-their-column', test_errors), &
            new_unittest('messages-name-the-key-and-quote-a-part', test_messages), &
            new_unittest('sizes-are-bounded', test_bounds), &
            new_unittest('ten-thousand-random-texts', test_fuzz)]
    end subroutine collect_expression

    !> Parse with the variables and constants of this suite.
    subroutine parse(expression, text, failure, column)
        type(expression_type), intent(out) :: expression
        character(len=*), intent(in) :: text
        type(failure_type), allocatable, intent(out) :: failure
        integer, intent(out), optional :: column

        call parse_expression(expression, text, variables, failure, ['k ', 'l0'], [7.0_wp, 1.5_wp], column=column)
    end subroutine parse

    !> Values that depend on the precedence of operators.
    subroutine test_precedence(error)
        type(error_type), allocatable, intent(out) :: error
        type(value_case_type), parameter :: cases(*) = [ &
            value_case_type('1 + 2*3', 7.0_wp), value_case_type('(1 + 2)*3', 9.0_wp), value_case_type('2*3 + 1', 7.0_wp), &
            value_case_type('7 - 2 - 1', 4.0_wp), value_case_type('7 - (2 - 1)', 6.0_wp), value_case_type('8/4/2', 1.0_wp), &
            value_case_type('8/(4/2)', 4.0_wp), value_case_type('8/4*2', 4.0_wp), value_case_type('2^3^2', 512.0_wp), &
            value_case_type('(2^3)^2', 64.0_wp), value_case_type('2**3**2', 512.0_wp), value_case_type('-2^2', -4.0_wp), &
            value_case_type('(-2)^2', 4.0_wp), value_case_type('2^-2', 0.25_wp), value_case_type('2^-3^2*512', 1.0_wp), &
            value_case_type('2*-3', -6.0_wp), value_case_type('6/-3', -2.0_wp), value_case_type('1 - -1', 2.0_wp), &
            value_case_type('--1', 1.0_wp), value_case_type('-+-+1', 1.0_wp), value_case_type('+1', 1.0_wp), &
            value_case_type('-2*3', -6.0_wp), value_case_type('-length^2', -4.0_wp), value_case_type('length^-1', 0.5_wp), &
            value_case_type('-length^2^rate*0 + 1', 1.0_wp), value_case_type('2 - length*rate', 8.0_wp), &
            value_case_type('1e3', 1000.0_wp), value_case_type('1.5E+2', 150.0_wp), value_case_type('25e-2', 0.25_wp), &
            value_case_type('.5', 0.5_wp), value_case_type('5.', 5.0_wp), value_case_type('5.e1', 50.0_wp), &
            value_case_type('  t  ', 0.5_wp), value_case_type('rod.x*4', 1.0_wp), value_case_type('k*(length - l0)', 3.5_wp), &
            value_case_type('2*pi', 2*pi), value_case_type('max(1, 2, 3) - min(3, 2, 1)', 2.0_wp), &
            value_case_type('sin(pi/2)^2', 1.0_wp), value_case_type('atan2(1, -1)', 0.75_wp*pi), &
            value_case_type('2 * (3) ^ (2)', 18.0_wp), value_case_type('t**2*t**-2', 1.0_wp)]
        type(expression_type) :: expression
        type(failure_type), allocatable :: failure
        real(wp) :: value
        integer :: i, column

        do i = 1, size(cases)
            call parse(expression, trim(cases(i)%text), failure, column)
            call check_no_failure(error, failure)
            call check_count(error, column, 0, 'the column without a mistake')
            ! Some roundings at most.
            value = expression%value([0.5_wp, 2.0_wp, -3.0_wp, 0.25_wp])
            call check_close(error, [value], [cases(i)%value], 1.0e-14_wp*abs(cases(i)%value), cases(i)%text)
            if (allocated(error)) return
        end do
    end subroutine test_precedence

    !> Value, gradient, derivatives along a direction, and the gradient of the latter, against symbolic derivatives. The bound is
    !> 1e-12 of the sum of the magnitudes that rounding propagates, which is about 5000 roundings of each operation.
    subroutine test_random(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: bound = 1.0e-12_wp
        integer, parameter :: n_cases = 1500, n_points = 3
        type(trees_type), allocatable :: trees
        type(expression_type) :: expression
        type(failure_type), allocatable :: failure
        character(len=:), allocatable :: text
        integer :: root, gradient(3), along, second, gradient_along(3), i, j, case, seed, n_compared, least
        real(wp) :: x(3), v(3), f, f1, f2, g(3), h(3), arguments(100), rates(100)

        allocate (trees)
        seed = 20261124
        n_compared = 0
        least = 0
        do case = 1, n_cases
            call trees%clear(case)
            root = trees%make_random(1 + mod(case, 4))
            text = trees%text_of(root)
            call parse_expression(expression, text, ['x1', 'x2', 'x3'], failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            v = random_vector(seed, 3)
            along = trees%along(root, v)
            second = trees%along(along, v)
            do i = 1, 3
                gradient(i) = trees%derivative(root, i)
                gradient_along(i) = trees%derivative(along, i)
            end do
            do j = 1, n_points
                x = 2*random_vector(seed, 3)
                call trees%evaluate(x)
                ! The two may round to different sides of a kink.
                call expression%evaluate_kinks(x, v, arguments, rates)
                if (any(abs(arguments(:expression%n_kinks())) < 1.0e-9_wp)) cycle
                n_compared = n_compared + 1
                call compare(expression%value(x), root, 'the value')
                call expression%evaluate_gradient(x, f, g)
                call compare(f, root, 'the value with a gradient')
                do i = 1, 3
                    call compare(g(i), gradient(i), 'the gradient')
                end do
                call expression%evaluate_along(x, v, f, f1, f2)
                call compare(f, root, 'the value along v')
                call compare(f1, along, 'the first derivative along v')
                call compare(f2, second, 'the second derivative along v')
                call expression%evaluate_gradient_along(x, v, f, f1, g, h)
                call compare(f, root, 'the value with two gradients')
                call compare(f1, along, 'the derivative along v with two gradients')
                do i = 1, 3
                    call compare(g(i), gradient(i), 'the gradient beside that along v')
                    call compare(h(i), gradient_along(i), 'the gradient along v')
                end do
                if (allocated(error)) return
            end do
        end do
        least = n_cases*n_points*9/10
        call check_true(error, n_compared >= least, 'nine of ten random points are off kinks')

    contains

        subroutine compare(found, place, what)
            real(wp), intent(in) :: found
            integer, intent(in) :: place
            character(len=*), intent(in) :: what

            if (allocated(error)) return
            call check_below(error, abs(found - trees%values(place)), bound*trees%errors(place), what//' of '//text)
        end subroutine compare
    end subroutine test_random

    !> Each function of one variable against closed forms, with exact numbers or small rounding.
    subroutine test_functions(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: e = exp(1.0_wp), r3 = sqrt(3.0_wp), r2 = sqrt(2.0_wp)

        call check('sin(t)', pi/6, [0.5_wp, r3/2, -0.5_wp])
        call check('cos(t)', pi/3, [0.5_wp, -r3/2, -0.5_wp])
        call check('tan(t)', pi/4, [1.0_wp, 2.0_wp, 4.0_wp])
        call check('asin(t)', 0.5_wp, [pi/6, 2/r3, 4/(3*r3)])
        call check('acos(t)', 0.5_wp, [pi/3, -2/r3, -4/(3*r3)])
        call check('asin(t)', -0.5_wp, [-pi/6, 2/r3, -4/(3*r3)])
        call check('acos(t)', -0.5_wp, [2*pi/3, -2/r3, 4/(3*r3)])
        call check('atan(t)', 1.0_wp, [pi/4, 0.5_wp, -0.5_wp])
        call check('sinh(t)', log(2.0_wp), [0.75_wp, 1.25_wp, 0.75_wp])
        call check('cosh(t)', log(2.0_wp), [1.25_wp, 0.75_wp, 1.25_wp])
        call check('tanh(t)', log(2.0_wp), [0.6_wp, 0.64_wp, -0.768_wp])
        call check('exp(t)', 1.0_wp, [e, e, e])
        call check('log(t)', 2.0_wp, [log(2.0_wp), 0.5_wp, -0.25_wp])
        call check('sqrt(t)', 2.0_wp, [r2, 1/(2*r2), -1/(8*r2)])
        call check('abs(t)', -2.0_wp, [2.0_wp, -1.0_wp, 0.0_wp])
        call check('sign(t)', -2.0_wp, [-1.0_wp, 0.0_wp, 0.0_wp])
        call check('step(t)', 2.0_wp, [1.0_wp, 0.0_wp, 0.0_wp])
        call check('ramp(t)', -2.0_wp, [0.0_wp, 0.0_wp, 0.0_wp])
        call check('ramp(t)', 2.0_wp, [2.0_wp, 1.0_wp, 0.0_wp])
        call check('smooth_step(t)', 0.25_wp, [53.0_wp/512, 135.0_wp/128, 45.0_wp/8])
        call check('smooth_step(t, 1, 3)', 2.0_wp, [0.5_wp, 15.0_wp/16, 0.0_wp])
        call check('smooth_step(t, 1, 3)', 0.5_wp, [0.0_wp, 0.0_wp, 0.0_wp])
        call check('smooth_step(t, 1, 3)', 3.5_wp, [1.0_wp, 0.0_wp, 0.0_wp])
        call check('smooth_step(t, 3, 1)', 3.5_wp, [0.0_wp, 0.0_wp, 0.0_wp])
        ! All quadrants: the angle of a point on a circle has rate one.
        call check('atan2(sin(t), cos(t))', 0.5_wp, [0.5_wp, 1.0_wp, 0.0_wp])
        call check('atan2(sin(t), cos(t))', 2.5_wp, [2.5_wp, 1.0_wp, 0.0_wp])
        call check('atan2(sin(t), cos(t))', -2.5_wp, [-2.5_wp, 1.0_wp, 0.0_wp])
        call check('min(t, t^2)', 0.5_wp, [0.25_wp, 1.0_wp, 2.0_wp])
        call check('max(t, t^2)', 0.5_wp, [0.5_wp, 1.0_wp, 0.0_wp])

    contains

        !> Value and two derivatives, within ten roundings of numbers of the order of one.
        subroutine check(text, t, expected)
            character(len=*), intent(in) :: text
            real(wp), intent(in) :: t, expected(3)
            type(expression_type) :: expression
            type(failure_type), allocatable :: failure
            real(wp) :: found(3)

            call parse_expression(expression, text, ['t'], failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call expression%evaluate_along([t], [1.0_wp], found(1), found(2), found(3))
            call check_close(error, found, expected, 20*epsilon(t)*maxval([abs(expected), 1.0_wp]), text)
        end subroutine check
    end subroutine test_functions

    !> Integer powers of negative numbers exist, others not; zero has powers too.
    subroutine test_powers(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: found(3)

        call look('t^3', -2.0_wp)
        call check_close(error, found, [-8.0_wp, 12.0_wp, -12.0_wp], 0.0_wp, 'the cube')
        call look('t^-2', -2.0_wp)
        call check_close(error, found, [0.25_wp, 0.25_wp, 0.375_wp], 1.0e-15_wp, 'the inverse square')
        call look('t^2', 0.0_wp)
        call check_close(error, found, [0.0_wp, 0.0_wp, 2.0_wp], 0.0_wp, 'the square of zero')
        call look('t^1 + t^0', 0.0_wp)
        call check_close(error, found, [1.0_wp, 1.0_wp, 0.0_wp], 0.0_wp, 'first and zeroth powers')
        call look('t^3', 0.0_wp)
        call check_close(error, found, [0.0_wp, 0.0_wp, 0.0_wp], 0.0_wp, 'the cube of zero')
        call look('t^17', -1.0_wp)
        call check_close(error, found, [-1.0_wp, 17.0_wp, -272.0_wp], 1.0e-12_wp, 'a high power')
        call look('2^t', 3.0_wp)
        call check_close(error, found, 8*[1.0_wp, log(2.0_wp), log(2.0_wp)**2], 1.0e-14_wp, 'a power of two')
        call look('t^t', 2.0_wp)
        call check_close(error, found, [4.0_wp, 4*(1 + log(2.0_wp)), 4*(1 + log(2.0_wp))**2 + 2.0_wp], 1.0e-13_wp, 't^t')
        call look('t^0.5', -1.0_wp)
        call check_true(error, ieee_is_nan(found(1)), 'the root of a negative number is no number')
        call look('(-2)^t', 3.0_wp)
        call check_close(error, found(:1), [-8.0_wp], 0.0_wp, 'a negative number to an integer')
        call check_true(error, ieee_is_nan(found(2)), 'its derivative is no number')

    contains

        subroutine look(text, t)
            character(len=*), intent(in) :: text
            real(wp), intent(in) :: t
            type(expression_type) :: expression
            type(failure_type), allocatable :: failure

            call parse_expression(expression, text, ['t'], failure)
            call check_no_failure(error, failure)
            if (.not. allocated(failure)) call expression%evaluate_along([t], [1.0_wp], found(1), found(2), found(3))
        end subroutine look
    end subroutine test_powers

    !> Constant parts cost nothing later.
    subroutine test_folding(error)
        type(error_type), allocatable, intent(out) :: error

        call check('2*3 + sin(pi/2)*k', 0, .true.)
        call check('2*pi*t', 1, .false.)
        call check('t', 0, .false.)
        call check('sin(t)^2 + sin(t)*cos(t)', 5, .false.)
        call check('t*rate + rate*t', 2, .false.)
        call check('t^0*(length - length^1) + 0*0', 3, .false.)
        call check(repeat('1 + ', 900)//'1', 0, .true.)

    contains

        subroutine check(text, n, is_constant)
            character(len=*), intent(in) :: text
            integer, intent(in) :: n
            logical, intent(in) :: is_constant
            type(expression_type) :: expression
            type(failure_type), allocatable :: failure

            call parse(expression, text, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call check_count(error, expression%n_operations(), n, 'operations of '//text)
            call check_true(error, expression%is_constant() .eqv. is_constant, text//' is constant or not, as it should')
        end subroutine check
    end subroutine test_folding

    !> At a kink, the positive side counts; fixed sides extend beyond it.
    subroutine test_kinks(error)
        type(error_type), allocatable, intent(out) :: error

        ! Value, first and second derivative at the kink: by default, from above, from below.
        call check('abs(t)', 0.0_wp, [0.0_wp, 1.0_wp, 0.0_wp], [0.0_wp, 1.0_wp, 0.0_wp], [0.0_wp, -1.0_wp, 0.0_wp])
        call check('sign(t)', 0.0_wp, [1.0_wp, 0.0_wp, 0.0_wp], [1.0_wp, 0.0_wp, 0.0_wp], [-1.0_wp, 0.0_wp, 0.0_wp])
        call check('step(t - 1)', 1.0_wp, [1.0_wp, 0.0_wp, 0.0_wp], [1.0_wp, 0.0_wp, 0.0_wp], [0.0_wp, 0.0_wp, 0.0_wp])
        call check('ramp(t)', 0.0_wp, [0.0_wp, 1.0_wp, 0.0_wp], [0.0_wp, 1.0_wp, 0.0_wp], [0.0_wp, 0.0_wp, 0.0_wp])
        call check('max(t^2, t)', 1.0_wp, [1.0_wp, 2.0_wp, 2.0_wp], [1.0_wp, 2.0_wp, 2.0_wp], [1.0_wp, 1.0_wp, 0.0_wp])
        call check('min(t^2, t)', 1.0_wp, [1.0_wp, 1.0_wp, 0.0_wp], [1.0_wp, 1.0_wp, 0.0_wp], [1.0_wp, 2.0_wp, 2.0_wp])
        ! Beyond the kink, a side extends smoothly.
        call check('abs(t)', -2.0_wp, [2.0_wp, -1.0_wp, 0.0_wp], [-2.0_wp, 1.0_wp, 0.0_wp], [2.0_wp, -1.0_wp, 0.0_wp])
        call check('ramp(t)', -2.0_wp, [0.0_wp, 0.0_wp, 0.0_wp], [-2.0_wp, 1.0_wp, 0.0_wp], [0.0_wp, 0.0_wp, 0.0_wp])
        call check('max(t^2, t)', 0.5_wp, [0.5_wp, 1.0_wp, 0.0_wp], [0.25_wp, 1.0_wp, 2.0_wp], [0.5_wp, 1.0_wp, 0.0_wp])

    contains

        subroutine check(text, t, free, above, below)
            character(len=*), intent(in) :: text
            real(wp), intent(in) :: t, free(3), above(3), below(3)
            type(expression_type) :: expression
            type(failure_type), allocatable :: failure

            call parse_expression(expression, text, ['t'], failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call compare(expression, t, free, text)
            call compare(expression, t, above, text//' above', [1])
            call compare(expression, t, below, text//' below', [-1])
        end subroutine check

        !> All ways of evaluation, exactly: these numbers have no rounding.
        subroutine compare(expression, t, expected, what, sides)
            type(expression_type), intent(in) :: expression
            real(wp), intent(in) :: t, expected(3)
            character(len=*), intent(in) :: what
            integer, intent(in), optional :: sides(:)
            real(wp) :: found(3), gradient(1), along(1), value, first

            call expression%evaluate_along([t], [1.0_wp], found(1), found(2), found(3), sides)
            call check_close(error, found, expected, 0.0_wp, what)
            call check_close(error, [expression%value([t], sides)], expected(:1), 0.0_wp, 'the value of '//what)
            call expression%evaluate_gradient([t], value, gradient, sides)
            call check_close(error, [value, gradient], expected(:2), 0.0_wp, 'the gradient of '//what)
            call expression%evaluate_gradient_along([t], [1.0_wp], value, first, gradient, along, sides)
            call check_close(error, [value, first, along], expected, 0.0_wp, 'the gradient along t of '//what)
            call check_close(error, gradient, expected(2:2), 0.0_wp, 'the gradient beside it of '//what)
        end subroutine compare
    end subroutine test_kinks

    !> The arguments of kinks, their rates, their orders and the sides of a motion.
    subroutine test_kink_queries(error)
        type(error_type), allocatable, intent(out) :: error
        type(expression_type) :: expression
        type(failure_type), allocatable :: failure
        real(wp) :: arguments(6), rates(6), x(4), value, first, second
        real(wp), parameter :: v(4) = [1.0_wp, 2.0_wp, 0.0_wp, 0.0_wp]
        integer :: sides(6), i
        real(wp), parameter :: ends(3) = [0.0_wp, 0.5_wp, 1.0_wp]

        call parse(expression, 'abs(t - 1) + step(length) + max(t, 2*length) + smooth_step(t/2) + ramp(rate) + 0*t', failure)
        call check_no_failure(error, failure)
        call check_count(error, expression%n_kinks(), 6, 'kinks')
        if (allocated(error)) return
        call check_true(error, all([(expression%kink_order(i), i=1, 6)] == [1, 0, 1, 3, 3, 1]), 'the orders of kinks')
        call expression%evaluate_kinks([1.0_wp, 0.5_wp, -3.0_wp, 0.0_wp], v, arguments, rates)
        call check_close(error, arguments, [0.0_wp, 0.5_wp, 0.0_wp, 0.5_wp, -0.5_wp, -3.0_wp], 0.0_wp, 'arguments')
        call check_close(error, rates, [1.0_wp, 2.0_wp, -3.0_wp, 0.5_wp, 0.5_wp, 0.0_wp], 0.0_wp, 'rates')
        call expression%find_sides([1.0_wp, 0.5_wp, -3.0_wp, 0.0_wp], v, sides)
        call check_true(error, all(sides == [1, 1, -1, 1, -1, -1]), 'the sides of a motion')
        call expression%find_sides([1.0_wp, 0.5_wp, -3.0_wp, 0.0_wp], -v, sides)
        call check_true(error, all(sides == [-1, 1, 1, 1, -1, -1]), 'the sides of the reverse motion')
        ! Sides that agree with the point have no effect.
        x = [0.3_wp, 0.7_wp, -3.0_wp, 0.0_wp]
        call expression%find_sides(x, v, sides)
        call check_close(error, [expression%value(x, sides)], [expression%value(x)], 0.0_wp, 'the value with its own sides')
        ! A smooth step has no kink up to the second derivative: both sides agree at its ends.
        call parse(expression, 'smooth_step(t)', failure)
        do i = 1, 3, 2
            x(1) = ends(i)
            call expression%evaluate_along(x, v, value, first, second, [merge(1, -1, i == 3), -1])
            call check_close(error, [value, first, second], [ends(i), 0.0_wp, 0.0_wp], 0.0_wp, 'a side of a smooth step')
            call expression%evaluate_along(x, v, value, first, second, [1, merge(1, -1, i == 3)])
            call check_close(error, [value, first, second], [ends(i), 0.0_wp, 0.0_wp], 0.0_wp, 'the other side of a smooth step')
        end do
    end subroutine test_kink_queries

    !> A part without a value makes the result not finite.
    subroutine test_not_finite(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=24), parameter :: texts(*) = [character(len=24) :: 'log(t)', 'sqrt(t)', 'asin(2*t)', 'ramp(log(t))', &
            'step(log(t))', 'sign(sqrt(t))', 'max(log(t), 1)', 'min(1, log(t))', 'smooth_step(log(t))', 'abs(log(t))', &
            '1/(t - t)', 'exp(-1000*t)', 't^0.5', 'max(0, log(t))*0', 'ramp(log(t)) + 1']
        type(expression_type) :: expression
        type(failure_type), allocatable :: failure
        real(wp), parameter :: x(4) = [-1.0_wp, 1.0_wp, 1.0_wp, 1.0_wp]
        real(wp) :: gradient(4), value
        integer :: i

        do i = 1, size(texts)
            call parse(expression, trim(texts(i)), failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call check_true(error, .not. ieee_is_finite(expression%value(x)), texts(i)//' is no number')
            call expression%evaluate_gradient(x, value, gradient)
            call check_true(error, .not. ieee_is_finite(value), texts(i)//' is no number with a gradient')
        end do
    end subroutine test_not_finite

    !> Columns count from 1.
    subroutine test_errors(error)
        type(error_type), allocatable, intent(out) :: error
        type(error_case_type), parameter :: cases(*) = [ &
            error_case_type('', 1, 'found nothing'), error_case_type('   ', 1, 'found nothing'), &
            error_case_type('1 +', 4, 'found the end'), error_case_type('1 + * 2', 5, 'found "*"'), &
            error_case_type('* 2', 1, 'expected a number, a name or "("'), error_case_type('/ 2', 1, 'found "/"'), &
            error_case_type('-', 2, 'found the end'), error_case_type('2 ^', 4, 'found the end'), &
            error_case_type('2 ^ ^ 3', 5, 'found "^"'), error_case_type('2 *** 3', 5, 'found "*"'), &
            error_case_type('2 3', 3, 'a product needs *'), error_case_type('2t', 2, 'a product needs *'), &
            error_case_type('t length', 3, 'found "length"'), error_case_type('2(t)', 2, 'a product needs *'), &
            error_case_type('(t)(t)', 4, 'a product needs *'), &
            error_case_type('(1 + 2', 7, '"(" of column 1, found the end'), error_case_type('((1)', 5, '"(" of column 1'), &
            error_case_type('1 + 2)', 6, 'expected an operator or the end'), error_case_type('()', 2, 'found ")"'), &
            error_case_type('(1 2)', 4, 'found "2"; a product needs *'), error_case_type('1, 2', 2, 'found ","'), &
            error_case_type('lenght', 1, 'did you mean "length"?'), error_case_type('2 + raet', 5, 'did you mean "rate"?'), &
            error_case_type('rod.y', 1, 'did you mean "rod.x"?'), error_case_type('rod', 1, 'there is no "rod"'), &
            error_case_type('rod.', 1, 'there is no "rod"'), error_case_type('T2', 1, 'there is no "T2"'), &
            error_case_type('Length', 1, 'did you mean "length"?'), &
            error_case_type('quite_unknown', 1, 'there is no "quite_unknown"'), error_case_type('l00', 1, 'did you mean "l0"?'), &
            error_case_type('sinus(t)', 1, 'there is no function "sinus"'), &
            error_case_type('sine(t)', 1, 'did you mean "sin"?'), error_case_type('1 + artan(t)', 5, 'did you mean "atan"?'), &
            error_case_type('smoothstep(t)', 1, 'did you mean "smooth_step"?'), &
            error_case_type('length(t)', 1, '"length" is not a function'), error_case_type('k (2)', 1, '"k" is not a function'), &
            error_case_type('pi(2)', 1, '"pi" is not a function'), &
            error_case_type('sin', 4, 'expected "(" after the function sin'), &
            error_case_type('sin + 1', 5, 'expected "(" after'), error_case_type('sin t', 5, 'found "t"'), &
            error_case_type('sin()', 5, 'found ")"'), error_case_type('sin(t, t)', 1, 'sin takes 1 argument'), &
            error_case_type('2*atan2(t)', 3, 'atan2 takes 2 arguments'), &
            error_case_type('min(t)', 1, 'min takes 2 to 20 arguments'), &
            error_case_type('smooth_step(t, 1)', 1, 'smooth_step takes 1 or 3 arguments'), &
            error_case_type('max(1, 2', 9, 'expected ")" or "," in the arguments of max'), &
            error_case_type('max(1 2)', 7, 'found "2"; a product needs *'), error_case_type('max(, 2)', 5, 'found ","'), &
            error_case_type('max(1,)', 7, 'found ")"'), error_case_type('1e', 3, 'digits of an exponent, found the end'), &
            error_case_type('1e+', 4, 'digits of an exponent'), error_case_type('2 + 1e*3', 7, 'digits of an exponent'), &
            error_case_type('1.2.3', 4, 'expected an operator'), error_case_type('.', 1, 'digits next to the decimal point'), &
            error_case_type('1 + .e3', 5, 'digits next to the decimal point'), error_case_type('1d3', 2, 'found "d3"'), &
            error_case_type('0x10', 2, 'found "x10"'), error_case_type('1e400', 1, 'the number is too large'), &
            error_case_type('1/0', 2, 'yield a finite number'), error_case_type('t + log(0 - 1)', 5, 'yield a finite number'), &
            error_case_type('10^400*t', 3, 'yield a finite number'), error_case_type('t < 1', 3, 'comparisons are not available'), &
            error_case_type('t == 1', 3, 'comparisons are not available'), &
            error_case_type('t ? 1 : 0', 3, 'comparisons are not available'), error_case_type('t $ 1', 3, 'found "$"'), &
            error_case_type('t; 1', 2, 'found ";"'), error_case_type('_t', 1, 'found "_"'), &
            error_case_type('"t"', 1, 'found """'), error_case_type('[1, 2]', 1, 'found "["'), &
            error_case_type('t % 2', 3, 'found "%"'), error_case_type('{i}', 1, 'found "{"'), &
            error_case_type("t'", 2, "found ""'""")]
        type(expression_type) :: expression
        type(failure_type), allocatable :: failure
        integer :: i, column

        call check_true(error, size(cases) >= 60, 'there are sixty malformed expressions')
        do i = 1, size(cases)
            call parse(expression, trim(cases(i)%text), failure, column)
            call check_failure(error, failure, 'invalid_model', trim(cases(i)%piece))
            call check_count(error, column, cases(i)%column, 'the column of '//cases(i)%text)
            call check_text(error, failure%message, 'column '//to_text(cases(i)%column)//' of ')
            if (allocated(error)) then
                error%message = error%message//' ['//trim(cases(i)%text)//']'
                return
            end if
        end do
        ! Bytes beyond ASCII and control characters are not written to a terminal.
        call parse(expression, 't + '//char(195)//char(169)//achar(27), failure, column)
        call check_failure(error, failure, 'invalid_model', 'column 5 of "t + ???": ')
    end subroutine test_errors

    !> Callers may state the place of the expression.
    subroutine test_messages(error)
        type(error_type), allocatable, intent(out) :: error
        type(expression_type) :: expression
        type(failure_type), allocatable :: failure

        call parse_expression(expression, '2*x +', ['x'], failure, key='force.spring.stiffness')
        call check_failure(error, failure, 'invalid_model', &
            'invalid_model: force.spring.stiffness: column 6 of "2*x +": expected a number, a name or "(", found the end; ')
        call parse_expression(expression, repeat('x + ', 100)//'y'//repeat(' + x', 100), ['x'], failure)
        call check_failure(error, failure, 'invalid_model', 'column 401 of "...')
        call check_text(error, failure%message, '...": there is no "y"')
        call check_true(error, len(failure%message) < 200, 'a long text is quoted in part')
        call check_true(error, is_input_error(failure%stat), 'the input is at fault')
    end subroutine test_messages

    !> Depth, length and number of operations end in an error, or work just below the bound.
    subroutine test_bounds(error)
        type(error_type), allocatable, intent(out) :: error
        type(expression_type) :: expression
        type(failure_type), allocatable :: failure
        character(len=:), allocatable :: text
        integer :: i

        call parse(expression, repeat('(', 90)//'t'//repeat(')', 90), failure)
        call check_no_failure(error, failure)
        call parse(expression, repeat('(', 101)//'t'//repeat(')', 101), failure)
        call check_failure(error, failure, 'invalid_model', 'nested at most 100 deep')
        call parse(expression, repeat('t^', 200)//'t', failure)
        call check_failure(error, failure, 'invalid_model', 'nested at most 100 deep')
        call parse(expression, repeat('sin(', 200), failure)
        call check_failure(error, failure, 'invalid_model', 'nested at most 100 deep')
        call parse(expression, repeat('-', 3000)//'t', failure)
        call check_no_failure(error, failure)
        call parse(expression, repeat('t+', 2000)//'t', failure)
        call check_failure(error, failure, 'invalid_model', 'at most 4000 characters')
        text = 't'
        do i = 1, 499
            text = text//'+'//to_text(i)//'*t'
        end do
        call parse(expression, text, failure)
        call check_failure(error, failure, 'invalid_model', 'too many operations')
        text = 't'
        do i = 2, 300
            text = text//'+'//to_text(i)//'*t'
        end do
        call parse(expression, text, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        ! 1 + ... + 300, in integers.
        call check_close(error, [expression%value([1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp])], [45150.0_wp], 0.0_wp, 'a long sum')
    end subroutine test_bounds

    !> Every text gives an expression or a message with a column within the text, without hangs or crashes.
    subroutine test_fuzz(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=12), parameter :: pieces(*) = [character(len=12) :: &
            '+', '-', '*', '/', '^', '**', '(', ')', ',', '.', ' ', 't', 'length', 'rate', 'rod.x', 'k', 'pi', 'sin(', 'atan2(', &
            'max(', 'smooth_step(', 'ramp(', 'log(', '1', '2.5', '1e3', '0', 'e', '_', '$', '<', 'foo', '(t', 't)', '^2', '+1', &
            '*t', '-rate']
        character(len=12), parameter :: operands(*) = [character(len=12) :: 't', 'length', '-rate', '2.5', '(t + 1)', 'sin(t)', &
            'max(t, 2)']
        type(expression_type) :: expression
        type(failure_type), allocatable :: failure
        character(len=:), allocatable :: text
        real(wp) :: r(1), x(4), f, f1, f2, g(4), h(4)
        integer :: i, j, seed, column, n_good

        seed = 4711
        n_good = 0
        x = [0.5_wp, 2.0_wp, -3.0_wp, 0.25_wp]
        do i = 1, 10000
            text = ''
            do j = 1, draw(merge(12, 60, mod(i, 10) > 0))
                if (mod(i, 4) == 0) then
                    text = text//achar(draw(128) - 1)
                else if (mod(i, 4) == 1 .and. mod(j, 2) == 1) then
                    text = text//trim(operands(draw(size(operands))))
                else if (mod(i, 4) == 1) then
                    text = text//trim(pieces(draw(5)))
                else
                    text = text//trim(pieces(draw(size(pieces))))
                end if
            end do
            call parse(expression, text, failure, column)
            if (allocated(failure)) then
                call check_true(error, column >= 1 .and. column <= len(text) + 1, 'the column lies in the text: '//text)
                call check_true(error, len(failure%message) < 400, 'the message is short: '//text)
            else
                n_good = n_good + 1
                call check_count(error, column, 0, 'the column of '//text)
                f = expression%value(x)
                call expression%evaluate_gradient(x, f, g)
                call expression%evaluate_along(x, x, f, f1, f2)
                call expression%evaluate_gradient_along(x, x, f, f1, g, h)
            end if
            if (allocated(error)) return
        end do
        call check_true(error, n_good > 500, 'some of the texts are expressions')

    contains

        integer function draw(n)
            integer, intent(in) :: n

            r = random_vector(seed, 1)
            draw = 1 + min(n - 1, int(n*(r(1) + 1.0_wp)/2))
        end function draw
    end subroutine test_fuzz
end module test_expression
