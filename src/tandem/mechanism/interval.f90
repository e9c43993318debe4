! SPDX-License-Identifier: MIT
!> Interval arithmetic for expressions: bounds of values and of first and second partial derivatives for operands within bounds.
!> Bounds are widened by more than their rounding errors, so that they hold both for exact arithmetic and for computed values. The
!> bounds of an empty interval are NaN; it represents a result that does not exist.
module tandem_mechanism_interval
    use tandem_kinds, only: long, wp
    use tandem_mechanism_operations, only: branch_of, op_abs, op_acos, op_add, op_asin, op_atan, op_atan2, op_cos, op_cosh, &
        op_divide, op_exp, op_log, op_max, op_min, op_multiply, op_negate, op_power, op_power_constant, op_ramp, op_sign, op_sin, &
        op_sinh, op_smooth_step, op_sqrt, op_step, op_subtract, op_tan, op_tanh, pi, value_of
    implicit none (type, external)
    private

    public :: interval_type, nothing, exact, add, subtract, multiply, intersection, enclose_value, enclose_slopes, &
        enclose_curvatures, branches_between

    !> The numbers between two bounds, inclusive.
    type :: interval_type
        real(wp) :: low, high
    end type interval_type

    !> A quiet NaN, and the empty interval, whose bounds are NaN. The NaN is given by its bits, because procedures that call
    !> `ieee_value` save and restore the floating-point state of the processor.
    real(wp), parameter :: not_a_number = transfer(int(z'7FF8000000000000', long), 1.0_wp)
    type(interval_type), parameter :: nothing = interval_type(not_a_number, not_a_number)
    !> The unbounded interval.
    type(interval_type), parameter :: whole = interval_type(-huge(1.0_wp), huge(1.0_wp))
    real(wp), parameter :: rounding = 2.0_wp*epsilon(1.0_wp), half_pi = pi/2

contains

    !> Interval with the given bounds, widened by the rounding error of their computation.
    elemental type(interval_type) function widened(low, high) result(f)
        real(wp), intent(in) :: low, high

        f = interval_type(low - rounding*abs(low), high + rounding*abs(high))
        ! After overflow, use the largest number as the bound. NaN is unchanged.
        if (low > huge(low)) f%low = huge(low)
        if (high < -huge(high)) f%high = -huge(high)
        if (f%low < -huge(low)) f%low = -huge(low)
        if (f%high > huge(high)) f%high = huge(high)
    end function widened

    !> True for an empty interval.
    elemental logical function is_empty(a)
        type(interval_type), intent(in) :: a

        is_empty = .not. a%low <= a%high
    end function is_empty

    !> a + b.
    elemental type(interval_type) function add(a, b) result(f)
        type(interval_type), intent(in) :: a, b

        f = widened(a%low + b%low, a%high + b%high)
    end function add

    !> a - b.
    elemental type(interval_type) function subtract(a, b) result(f)
        type(interval_type), intent(in) :: a, b

        f = widened(a%low - b%high, a%high - b%low)
    end function subtract

    !> a b.
    elemental type(interval_type) function multiply(a, b) result(f)
        type(interval_type), intent(in) :: a, b
        real(wp) :: p(4)

        f = nothing
        if (is_empty(a) .or. is_empty(b)) return
        p = [product_of(a%low, b%low), product_of(a%low, b%high), product_of(a%high, b%low), product_of(a%high, b%high)]
        f = widened(min(p(1), p(2), p(3), p(4)), max(p(1), p(2), p(3), p(4)))
    end function multiply

    !> Product in which zero times an infinite bound is zero.
    elemental real(wp) function product_of(x, y)
        real(wp), intent(in) :: x, y

        product_of = 0.0_wp
        if (abs(x) > 0.0_wp .and. abs(y) > 0.0_wp) product_of = x*y
    end function product_of

    !> a a; not negative.
    elemental type(interval_type) function square(a) result(f)
        type(interval_type), intent(in) :: a

        f = widened(mignitude(a)**2, max(abs(a%low), abs(a%high))**2)
    end function square

    !> Smallest absolute value in an interval.
    elemental real(wp) function mignitude(a)
        type(interval_type), intent(in) :: a

        mignitude = 0.0_wp
        if (a%low > 0.0_wp .or. a%high < 0.0_wp) mignitude = min(abs(a%low), abs(a%high))
    end function mignitude

    !> 1/a.
    elemental type(interval_type) function inverse(a) result(f)
        type(interval_type), intent(in) :: a

        f = whole
        if (a%low > 0.0_wp .or. a%high < 0.0_wp) then
            f = widened(1.0_wp/a%high, 1.0_wp/a%low)
        else if (a%low < 0.0_wp .and. .not. a%high > 0.0_wp) then
            f%high = 1.0_wp/a%low
        else if (a%high > 0.0_wp .and. .not. a%low < 0.0_wp) then
            f%low = 1.0_wp/a%high
        end if
    end function inverse

    !> Interval that contains one number.
    elemental type(interval_type) function exact(x) result(f)
        real(wp), intent(in) :: x

        f = interval_type(x, x)
    end function exact

    !> Intersection of two enclosures of the same value. Disjoint bounds can only be due to rounding; the first enclosure is then
    !> returned.
    elemental type(interval_type) function intersection(a, b) result(f)
        type(interval_type), intent(in) :: a, b

        f = a
        if (is_empty(a) .or. .not. max(a%low, b%low) <= min(a%high, b%high)) return
        f = interval_type(max(a%low, b%low), min(a%high, b%high))
    end function intersection

    !> sin a.
    elemental type(interval_type) function sine(a) result(f)
        type(interval_type), intent(in) :: a
        real(wp), parameter :: largest = 1.0e15_wp
        real(wp) :: slack, s, c

        f = interval_type(-1.0_wp, 1.0_wp)
        if (.not. (a%high - a%low < 4*half_pi .and. max(abs(a%low), abs(a%high)) < largest)) return
        s = sin(a%low)
        c = sin(a%high)
        f = widened(min(s, c), max(s, c))
        slack = 4*rounding*max(abs(a%low), abs(a%high))
        if (passes(half_pi)) f%high = 1.0_wp
        if (passes(-half_pi)) f%low = -1.0_wp
        f%high = min(f%high, 1.0_wp)
        f%low = max(f%low, -1.0_wp)

    contains

        !> True if the interval contains an angle or the angle plus a multiple of 2 pi.
        pure logical function passes(angle)
            real(wp), intent(in) :: angle

            passes = angle + 4*half_pi*real(ceiling((a%low - slack - angle)/(4*half_pi), long), wp) <= a%high + slack
        end function passes
    end function sine

    !> cos a.
    elemental type(interval_type) function cosine(a) result(f)
        type(interval_type), intent(in) :: a

        f = sine(add(a, exact(half_pi)))
    end function cosine

    !> a to a constant power b.
    elemental type(interval_type) function power(a, b) result(f)
        type(interval_type), intent(in) :: a
        real(wp), intent(in) :: b
        real(wp), parameter :: large = 1.0e6_wp
        type(interval_type) :: base
        integer :: n

        base = a
        if (.not. abs(b - anint(b)) > 0.0_wp .and. abs(b) < large) then
            n = nint(b)
            if (n < 0) base = inverse(a)
            n = abs(n)
            if (modulo(n, 2) == 0) base = interval_type(mignitude(base), max(abs(base%low), abs(base%high)))
            f = widened(base%low**n, base%high**n)
        else
            base%low = max(base%low, 0.0_wp)
            if (b < 0.0_wp) base = inverse(base)
            base%low = max(base%low, 0.0_wp)
            f = widened(base%low**abs(b), base%high**abs(b))
        end if
        ! Powers are computed with more than one rounding; widen again.
        f = widened(f%low, f%high)
    end function power

    !> Logarithm of the positive part of a.
    elemental type(interval_type) function logarithm(a) result(f)
        type(interval_type), intent(in) :: a

        f = whole
        if (a%high > 0.0_wp) f%high = log(a%high) + rounding*(1.0_wp + abs(log(a%high)))
        if (a%low > 0.0_wp) f%low = log(a%low) - rounding*(1.0_wp + abs(log(a%low)))
    end function logarithm

    !> e to the power a.
    elemental type(interval_type) function exponential(a) result(f)
        type(interval_type), intent(in) :: a

        f = widened(exp(a%low), exp(a%high))
        f = widened(f%low, f%high)
    end function exponential

    !> Lowest and highest branch that an operation with a kink can take for operands within bounds.
    pure function branches_between(operation, a, b) result(branches)
        integer, intent(in) :: operation
        !> The operands.
        type(interval_type), intent(in) :: a, b
        integer :: branches(2)

        branches = [branch_of(operation, a%low, b%high), branch_of(operation, a%high, b%low)]
    end function branches_between

    !> Bounds of the value of an operation.
    pure type(interval_type) function enclose_value(operation, a, b, branches) result(f)
        integer, intent(in) :: operation
        type(interval_type), intent(in) :: a, b
        !> Lowest and highest possible branch.
        integer, intent(in) :: branches(2)
        real(wp) :: low, high

        f = nothing
        if (is_empty(a) .or. is_empty(b)) return
        if (operation >= op_abs) then
            call enclose_kinked(operation, a, b, branches, f)
            return
        end if
        select case (operation)
        case (op_add)
            f = add(a, b)
        case (op_subtract)
            f = subtract(a, b)
        case (op_multiply)
            f = multiply(a, b)
        case (op_divide)
            f = multiply(a, inverse(b))
        case (op_power_constant)
            if (a%high < 0.0_wp .and. abs(b%low - anint(b%low)) > 0.0_wp) return
            f = power(a, b%low)
        case (op_power)
            if (a%high < 0.0_wp) then
                f = whole
            else
                f = exponential(multiply(logarithm(a), b))
                if (.not. a%low > 0.0_wp) f = whole
            end if
        case (op_negate)
            f = negative(a)
        case (op_sin)
            f = sine(a)
        case (op_cos)
            f = cosine(a)
        case (op_tan)
            f = whole
            if (mignitude(cosine(a)) > 0.0_wp .and. a%high - a%low < 2*half_pi) f = widened(tan(a%low), tan(a%high))
        case (op_asin, op_acos)
            if (a%high < -1.0_wp .or. a%low > 1.0_wp) return
            low = max(a%low, -1.0_wp)
            high = min(a%high, 1.0_wp)
            f = widened(asin(low), asin(high))
            if (operation == op_acos) f = widened(acos(high), acos(low))
        case (op_atan)
            f = widened(atan(a%low), atan(a%high))
        case (op_atan2)
            f = interval_type(-2*half_pi, 2*half_pi)
            ! Monotonic in each operand, unless the intervals of the operands contain the origin or the branch cut.
            if (b%low > 0.0_wp .or. mignitude(a) > 0.0_wp) then
                associate (corners => [atan2(a%low, b%low), atan2(a%low, b%high), atan2(a%high, b%low), atan2(a%high, b%high)])
                    f = widened(minval(corners), maxval(corners))
                end associate
            end if
        case (op_sinh)
            f = widened(sinh(a%low), sinh(a%high))
        case (op_cosh)
            f = widened(cosh(mignitude(a)), cosh(max(abs(a%low), abs(a%high))))
        case (op_tanh)
            f = widened(tanh(a%low), tanh(a%high))
        case (op_exp)
            f = exponential(a)
        case (op_log)
            if (a%high < 0.0_wp) return
            f = logarithm(a)
        case default ! op_sqrt
            if (a%high < 0.0_wp) return
            f = widened(sqrt(max(a%low, 0.0_wp)), sqrt(a%high))
        end select
    end function enclose_value

    !> Bounds of the value of an operation with kinks.
    pure subroutine enclose_kinked(operation, a, b, branches, f)
        integer, intent(in) :: operation
        type(interval_type), intent(in) :: a, b
        integer, intent(in) :: branches(2)
        type(interval_type), intent(inout) :: f
        type(interval_type) :: piece
        integer :: branch

        do branch = branches(1), branches(2)
            select case (operation)
            case (op_min, op_max)
                piece = merge(a, b, (operation == op_max) .eqv. (branch == 1))
            case (op_abs)
                piece = merge(a, negative(a), branch == 1)
            case (op_ramp)
                piece = merge(a, exact(0.0_wp), branch == 1)
            case (op_smooth_step)
                piece = exact(real(branch/2, wp))
                ! Increasing.
                if (branch == 1) piece = widened(value_of(operation, a%low, 0.0_wp, 1), value_of(operation, a%high, 0.0_wp, 1))
            case default
                piece = exact(value_of(operation, 0.0_wp, 0.0_wp, branch))
            end select
            if (branch == branches(1)) then
                f = piece
            else
                f = interval_type(min(f%low, piece%low), max(f%high, piece%high))
            end if
        end do
        if (branches(1) == branches(2)) return
        ! Restrict each piece to its side of the kink.
        select case (operation)
        case (op_abs, op_ramp)
            f%low = max(f%low, 0.0_wp)
        case (op_min)
            f%high = min(a%high, b%high)
        case (op_max)
            f%low = max(a%low, b%low)
        case (op_smooth_step)
            f = interval_type(value_of(operation, a%low, 0.0_wp, branch_of(operation, a%low, 0.0_wp)), &
                value_of(operation, a%high, 0.0_wp, branch_of(operation, a%high, 0.0_wp)))
            f = widened(f%low, f%high)
        case default ! The values of op_sign and op_step are constant.
            continue
        end select
    end subroutine enclose_kinked

    !> Bounds of the partial derivatives of an operation; unbounded if its value may jump.
    pure subroutine enclose_slopes(operation, a, b, f, branches, by_a, by_b)
        integer, intent(in) :: operation
        !> The operands, and the value.
        type(interval_type), intent(in) :: a, b, f
        integer, intent(in) :: branches(2)
        type(interval_type), intent(out) :: by_a, by_b
        type(interval_type) :: s
        logical :: is_sure

        by_a = nothing
        by_b = by_a
        if (is_empty(f)) return
        by_b = exact(0.0_wp)
        is_sure = branches(1) == branches(2)
        select case (operation)
        case (op_add)
            by_a = exact(1.0_wp)
            by_b = by_a
        case (op_subtract)
            by_a = exact(1.0_wp)
            by_b = exact(-1.0_wp)
        case (op_multiply)
            by_a = b
            by_b = a
        case (op_divide)
            by_a = inverse(b)
            by_b = multiply(negative(f), by_a)
        case (op_power_constant)
            by_a = multiply(b, power(a, b%low - 1.0_wp))
        case (op_power)
            by_a = whole
            by_b = whole
            if (a%low > 0.0_wp) then
                by_a = multiply(b, multiply(f, inverse(a)))
                by_b = multiply(f, logarithm(a))
            end if
        case (op_negate)
            by_a = exact(-1.0_wp)
        case (op_sin)
            by_a = cosine(a)
        case (op_cos)
            s = sine(a)
            by_a = negative(s)
        case (op_tan)
            by_a = add(square(f), exact(1.0_wp))
            if (f%low <= -huge(1.0_wp)) by_a = whole
        case (op_asin, op_acos)
            s = subtract(exact(1.0_wp), square(a))
            by_a = power(inverse(interval_type(max(s%low, 0.0_wp), max(s%high, 0.0_wp))), 0.5_wp)
            by_a%high = max(by_a%high, by_a%low)
            if (.not. s%low > 0.0_wp) by_a%high = huge(1.0_wp)
            if (operation == op_acos) by_a = negative(by_a)
        case (op_atan)
            by_a = inverse(add(square(a), exact(1.0_wp)))
        case (op_atan2)
            by_a = whole
            by_b = whole
            if (b%low > 0.0_wp .or. mignitude(a) > 0.0_wp) then
                s = inverse(add(square(a), square(b)))
                by_a = multiply(b, s)
                by_b = multiply(negative(a), s)
            end if
        case (op_sinh)
            by_a = widened(cosh(mignitude(a)), cosh(max(abs(a%low), abs(a%high))))
        case (op_cosh)
            by_a = widened(sinh(a%low), sinh(a%high))
        case (op_tanh)
            s = subtract(exact(1.0_wp), square(f))
            by_a = interval_type(max(s%low, 0.0_wp), max(s%high, 0.0_wp))
        case (op_exp)
            by_a = f
        case (op_log)
            by_a = inverse(interval_type(max(a%low, 0.0_wp), max(a%high, 0.0_wp)))
        case (op_sqrt)
            by_a = multiply(exact(0.5_wp), inverse(f))
        case (op_abs)
            by_a = interval_type(merge(1.0_wp, -1.0_wp, branches(1) == 1), merge(1.0_wp, -1.0_wp, branches(2) == 1))
        case (op_ramp)
            by_a = interval_type(merge(1.0_wp, 0.0_wp, branches(1) == 1), merge(1.0_wp, 0.0_wp, branches(2) == 1))
        case (op_min, op_max)
            by_a = interval_type(0.0_wp, 1.0_wp)
            if (is_sure) by_a = exact(merge(1.0_wp, 0.0_wp, (operation == op_max) .eqv. (branches(1) == 1)))
            by_b = subtract(exact(1.0_wp), by_a)
            if (is_sure) by_b = exact(1.0_wp - by_a%low)
        case (op_sign, op_step)
            by_a = exact(0.0_wp)
            if (.not. is_sure) by_a = whole
        case default
            ! 30 (a (1 - a))^2: at most 15/8 between the kinks.
            by_a = exact(0.0_wp)
            if (is_sure .and. branches(1) == 1) then
                by_a = multiply(exact(30.0_wp), square(multiply(a, subtract(exact(1.0_wp), a))))
            else if (.not. is_sure) then
                by_a = interval_type(0.0_wp, 1.875_wp)
            end if
        end select
    end subroutine enclose_slopes

    !> Bounds of the second partial derivatives of an operation on one branch.
    pure subroutine enclose_curvatures(operation, a, b, f, slopes, is_inner, by_aa, by_ab, by_bb)
        integer, intent(in) :: operation
        !> The operands, the value and the first derivatives.
        type(interval_type), intent(in) :: a, b, f, slopes(2)
        !> True for the middle branch of `smooth_step`.
        logical, intent(in) :: is_inner
        type(interval_type), intent(out) :: by_aa, by_ab, by_bb
        type(interval_type) :: s

        by_aa = exact(0.0_wp)
        by_ab = by_aa
        by_bb = by_aa
        select case (operation)
        case (op_multiply)
            by_ab = exact(1.0_wp)
        case (op_divide)
            s = square(slopes(1))
            by_ab = negative(s)
            by_bb = multiply(exact(2.0_wp), multiply(f, s))
        case (op_power_constant)
            by_aa = multiply(multiply(b, subtract(b, exact(1.0_wp))), power(a, b%low - 2.0_wp))
        case (op_power)
            by_aa = whole
            by_ab = whole
            by_bb = whole
            if (a%low > 0.0_wp) then
                s = inverse(a)
                by_aa = multiply(multiply(slopes(1), subtract(b, exact(1.0_wp))), s)
                by_ab = multiply(add(multiply(slopes(2), b), f), s)
                by_bb = multiply(slopes(2), logarithm(a))
            end if
        case (op_sin, op_cos)
            by_aa = negative(f)
        case (op_tan, op_tanh)
            by_aa = multiply(multiply(exact(merge(2.0_wp, -2.0_wp, operation == op_tan)), f), slopes(1))
        case (op_asin, op_acos)
            by_aa = multiply(a, power(slopes(1), 3.0_wp))
        case (op_atan)
            by_aa = multiply(multiply(exact(-2.0_wp), a), square(slopes(1)))
        case (op_atan2)
            by_ab = subtract(square(slopes(2)), square(slopes(1)))
            by_bb = multiply(multiply(exact(-2.0_wp), slopes(1)), slopes(2))
            by_aa = negative(by_bb)
        case (op_sinh, op_cosh, op_exp)
            by_aa = f
        case (op_log)
            by_aa = negative(square(slopes(1)))
        case (op_sqrt)
            by_aa = multiply(multiply(exact(-0.5_wp), slopes(1)), inverse(a))
        case (op_smooth_step)
            ! 60 a (1 - a) (1 - 2 a).
            if (is_inner) by_aa = multiply(multiply(multiply(exact(60.0_wp), a), subtract(exact(1.0_wp), a)), &
                subtract(exact(1.0_wp), multiply(exact(2.0_wp), a)))
        case default ! Other operations are linear on each branch.
            continue
        end select
    end subroutine enclose_curvatures

    !> -a.
    elemental type(interval_type) function negative(a) result(f)
        type(interval_type), intent(in) :: a

        f = interval_type(-a%high, -a%low)
    end function negative
end module tandem_mechanism_interval
