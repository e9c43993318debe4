! SPDX-License-Identifier: MIT
!> Operations of expressions: their names and numbers of arguments, their values, and their partial derivatives of first and second
!> order.
!>
!> Some have kinks or jumps, at the zeros of the difference between left and right operand (the right one of abs is zero); `branch`
!> selects the side. The branch is a separate argument, so that a run may keep it constant within a smooth piece, and each branch
!> extends smoothly beyond its end.
module tandem_mechanism_operations
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: function_type, functions, find_function, branch_of, value_of, differentiate, is_commutative, has_kink, &
        kink_order
    public :: op_add, op_subtract, op_multiply, op_divide, op_power, op_power_constant, op_negate
    public :: op_sin, op_cos, op_tan, op_asin, op_acos, op_atan, op_atan2, op_sinh, op_cosh, op_tanh, op_exp, op_log, op_sqrt
    public :: op_abs, op_sign, op_step, op_ramp, op_min, op_max, op_smooth_step
    public :: pi

    !> The constant pi of expressions.
    real(wp), parameter :: pi = acos(-1.0_wp)

    !> The operations; those from `op_abs` on have kinks.
    integer, parameter :: op_add = 1, op_subtract = 2, op_multiply = 3, op_divide = 4, op_power = 5, op_power_constant = 6, &
        op_negate = 7, op_sin = 8, op_cos = 9, op_tan = 10, op_asin = 11, op_acos = 12, op_atan = 13, op_atan2 = 14, op_sinh = 15, &
        op_cosh = 16, op_tanh = 17, op_exp = 18, op_log = 19, op_sqrt = 20, op_abs = 21, op_sign = 22, op_step = 23, op_ramp = 24, &
        op_min = 25, op_max = 26, op_smooth_step = 27

    !> A function of expressions.
    type :: function_type
        character(len=11) :: name
        integer :: operation
        !> Smallest and largest number of arguments.
        integer :: least, most
        !> Lowest derivative that jumps where the operands are equal; 0 is the value, -1 none.
        integer :: kink = -1
    end type function_type

    !> Largest number of arguments of min and max.
    integer, parameter :: many = 20

    type(function_type), parameter :: functions(*) = [ &
        function_type('sin', op_sin, 1, 1), function_type('cos', op_cos, 1, 1), function_type('tan', op_tan, 1, 1), &
        function_type('asin', op_asin, 1, 1), function_type('acos', op_acos, 1, 1), function_type('atan', op_atan, 1, 1), &
        function_type('atan2', op_atan2, 2, 2), function_type('sinh', op_sinh, 1, 1), function_type('cosh', op_cosh, 1, 1), &
        function_type('tanh', op_tanh, 1, 1), function_type('exp', op_exp, 1, 1), function_type('log', op_log, 1, 1), &
        function_type('sqrt', op_sqrt, 1, 1), function_type('abs', op_abs, 1, 1, 1), function_type('sign', op_sign, 1, 1, 0), &
        function_type('step', op_step, 1, 1, 0), function_type('ramp', op_ramp, 1, 1, 1), &
        function_type('min', op_min, 2, many, 1), function_type('max', op_max, 2, many, 1), &
        function_type('smooth_step', op_smooth_step, 1, 3, 3)]

contains

    !> Place of a function in the table; 0 if the name is unknown.
    pure integer function find_function(name)
        character(len=*), intent(in) :: name

        do find_function = size(functions), 1, -1
            if (functions(find_function)%name == name) return
        end do
    end function find_function

    !> True if the operands may be swapped.
    pure logical function is_commutative(operation)
        integer, intent(in) :: operation

        is_commutative = operation == op_add .or. operation == op_multiply
    end function is_commutative

    !> True if an operation has a kink or a jump.
    pure logical function has_kink(operation)
        integer, intent(in) :: operation

        has_kink = operation >= op_abs
    end function has_kink

    !> Lowest derivative that jumps at the kink of an operation; 0 is the value, -1 none.
    pure integer function kink_order(operation)
        integer, intent(in) :: operation
        integer :: i

        kink_order = -1
        do i = 1, size(functions)
            if (functions(i)%operation == operation) kink_order = functions(i)%kink
        end do
    end function kink_order

    !> Branch for given operands: 1 if left >= right, else 0. The second kink of a smooth step is at the first one plus 1; above it
    !> the branch is 2.
    pure integer function branch_of(operation, left, right)
        integer, intent(in) :: operation
        real(wp), intent(in) :: left, right

        branch_of = merge(1, 0, left >= right)
        if (operation == op_smooth_step .and. left >= right + 1.0_wp) branch_of = 2
    end function branch_of

    !> Value of an operation. The products with zero keep a NaN on every branch.
    pure real(wp) function value_of(operation, a, b, branch) result(f)
        integer, intent(in) :: operation
        !> Operands. The operand of a function of one argument is a; its b is zero, the place of its kink.
        real(wp), intent(in) :: a, b
        !> Side of the kink.
        integer, intent(in) :: branch

        select case (operation)
        case (op_add)
            f = a + b
        case (op_subtract)
            f = a - b
        case (op_multiply)
            f = a*b
        case (op_divide)
            f = a/b
        case (op_power, op_power_constant)
            f = power(a, b)
        case (op_negate)
            f = -a
        case (op_sin)
            f = sin(a)
        case (op_cos)
            f = cos(a)
        case (op_tan)
            f = tan(a)
        case (op_asin)
            f = asin(a)
        case (op_acos)
            f = acos(a)
        case (op_atan)
            f = atan(a)
        case (op_atan2)
            f = atan2(a, b)
        case (op_sinh)
            f = sinh(a)
        case (op_cosh)
            f = cosh(a)
        case (op_tanh)
            f = tanh(a)
        case (op_exp)
            f = exp(a)
        case (op_log)
            f = log(a)
        case (op_sqrt)
            f = sqrt(a)
        case (op_abs)
            f = merge(a, -a, branch == 1)
        case (op_sign)
            f = merge(1.0_wp, -1.0_wp, branch == 1) + 0.0_wp*a
        case (op_step)
            f = merge(1.0_wp, 0.0_wp, branch == 1) + 0.0_wp*a
        case (op_ramp)
            f = merge(a, 0.0_wp*a, branch == 1)
        case (op_min)
            f = merge(b, a, branch == 1) + 0.0_wp*(a - b)
        case (op_max)
            f = merge(a, b, branch == 1) + 0.0_wp*(a - b)
        case default
            f = real(branch/2, wp) + 0.0_wp*a
            if (branch == 1) f = a*a*a*(10.0_wp + a*(6.0_wp*a - 15.0_wp))
        end select
    end function value_of

    !> Value of an operation, and its partial derivatives with respect to a, b, aa, ab, bb.
    pure subroutine differentiate(operation, a, b, branch, f, d)
        integer, intent(in) :: operation
        !> The operands.
        real(wp), intent(in) :: a, b
        !> Side of the kink.
        integer, intent(in) :: branch
        real(wp), intent(out) :: f, d(5)
        real(wp) :: s, c

        f = value_of(operation, a, b, branch)
        d = 0.0_wp
        select case (operation)
        case (op_add)
            d(1:2) = 1.0_wp
        case (op_subtract)
            d(1) = 1.0_wp
            d(2) = -1.0_wp
        case (op_multiply)
            d(1) = b
            d(2) = a
            d(4) = 1.0_wp
        case (op_divide)
            d(1) = 1.0_wp/b
            d(2) = -f/b
            d(4) = -1.0_wp/(b*b)
            d(5) = -2.0_wp*d(2)/b
        case (op_power)
            ! For a < 0 a power is defined for integer exponents only: it has a value there and no derivative with respect to b.
            s = log(a)
            c = power(a, b - 1.0_wp)
            d = [b*c, f*s, b*(b - 1.0_wp)*power(a, b - 2.0_wp), c*(1.0_wp + b*s), f*s*s]
        case (op_power_constant)
            ! The exponent is neither 0 nor 1.
            d(1) = b*power(a, b - 1.0_wp)
            d(3) = b*(b - 1.0_wp)*power(a, b - 2.0_wp)
        case (op_negate)
            d(1) = -1.0_wp
        case (op_sin)
            d(1) = cos(a)
            d(3) = -f
        case (op_cos)
            d(1) = -sin(a)
            d(3) = -f
        case (op_tan)
            d(1) = 1.0_wp + f*f
            d(3) = 2.0_wp*f*d(1)
        case (op_asin, op_acos)
            s = merge(1.0_wp, -1.0_wp, operation == op_asin)
            d(1) = s/sqrt((1.0_wp - a)*(1.0_wp + a))
            d(3) = s*a*abs(d(1))**3
        case (op_atan)
            d(1) = 1.0_wp/(1.0_wp + a*a)
            d(3) = -2.0_wp*a*d(1)**2
        case (op_atan2)
            s = a/(a*a + b*b)
            c = b/(a*a + b*b)
            d = [c, -s, -2.0_wp*s*c, (s - c)*(s + c), 2.0_wp*s*c]
        case (op_sinh)
            d(1) = cosh(a)
            d(3) = f
        case (op_cosh)
            d(1) = sinh(a)
            d(3) = f
        case (op_tanh)
            d(1) = 1.0_wp/cosh(a)**2
            d(3) = -2.0_wp*f*d(1)
        case (op_exp)
            d(1) = f
            d(3) = f
        case (op_log)
            d(1) = 1.0_wp/a
            d(3) = -d(1)**2
        case (op_sqrt)
            d(1) = 0.5_wp/f
            d(3) = -0.5_wp*d(1)/a
        case (op_abs)
            d(1) = merge(1.0_wp, -1.0_wp, branch == 1)
        case (op_ramp)
            d(1) = merge(1.0_wp, 0.0_wp, branch == 1)
        case (op_min)
            d(merge(2, 1, branch == 1)) = 1.0_wp
        case (op_max)
            d(merge(1, 2, branch == 1)) = 1.0_wp
        case (op_sign, op_step)
            continue
        case default
            if (branch == 1) then
                d(1) = 30.0_wp*(a*(1.0_wp - a))**2
                d(3) = 60.0_wp*a*(1.0_wp - a)*(1.0_wp - 2.0_wp*a)
            end if
        end select
    end subroutine differentiate

    !> a**b, for small integers b by multiplication, which is as accurate and faster.
    pure real(wp) function power(a, b)
        real(wp), intent(in) :: a, b
        real(wp), parameter :: large = 16.0_wp

        if (abs(b) <= large .and. .not. abs(b - anint(b)) > 0.0_wp) then
            power = a**nint(b)
        else
            power = a**b
        end if
    end function power
end module tandem_mechanism_operations
