! SPDX-License-Identifier: MIT
!> Expressions of named variables with exact derivatives: value, gradient, first and second derivative along a direction, and
!> gradient of the derivative along a direction.
!>
!> An expression is parsed once into a list of operations. Evaluations process the list forwards for derivatives along a direction,
!> and then backwards for gradients, so that the cost of a gradient does not depend on the number of variables. Evaluations allocate
!> no memory and do not change the expression, so that threads may share it. If a value or derivative does not exist, the result is
!> not finite.
!>
!> abs, sign, step, ramp, min, max and smooth_step have kinks. By default the value and derivatives at a kink are those of the
!> positive side. With `sides`, one entry per kink, the caller selects branches, which are continued smoothly beyond the kink. A
!> simulation keeps the branches constant within a smooth piece and changes them when the argument of the kink vanishes.
module tandem_mechanism_expression
    use tandem_error, only: error_type, set_error, to_text
    use tandem_kinds, only: wp
    use tandem_mechanism_expression_code, only: code_type, max_slots
    use tandem_mechanism_expression_parser, only: compile, is_name, name_length
    use tandem_mechanism_interval, only: interval_type
    use tandem_mechanism_operations, only: branch_of, differentiate, find_function, value_of
    use tandem_status, only: status_invalid_model
    implicit none (type, external)
    private

    public :: expression_type, parse_expression, check_name

    !> Expression in a form that is ready for evaluation.
    type :: expression_type
        type(code_type), private :: code
    contains
        !> Structure.
        procedure :: is_constant, first_outside, n_operations
        procedure :: n_kinks, kink_order, kink_depends_on_others, renumber, list_parts
        !> Evaluation at a point.
        procedure :: value => evaluate_value, evaluate_gradient, evaluate_along
        procedure :: evaluate_gradient_along, evaluate_kinks, find_sides
        !> Bounds of the value while one variable varies over an interval.
        procedure :: enclose_kinks, enclose_parts, evaluate_parts
        procedure, private :: fill_leaves, branch_at, branch_with
    end type expression_type

    interface
        !> List the largest parts of the expression that depend on one variable only, excluding the variable itself.
        pure module function list_parts(self, variable) result(parts)
            implicit none (type, external)
            class(expression_type), intent(in) :: self
            !> Index of the variable in the list of names.
            integer, intent(in) :: variable
            !> Indices for `enclose_parts` and `evaluate_parts`.
            integer, allocatable :: parts(:)
        end function list_parts

        !> Bounds of the arguments of kinks and of their derivatives while one variable varies over an interval. Bounds are empty
        !> for kinks that depend on other variables. Derivatives of arguments that may jump are unbounded.
        pure module subroutine enclose_kinks(self, variable, from, to, arguments, rates, middle)
            implicit none (type, external)
            class(expression_type), intent(in) :: self
            integer, intent(in) :: variable
            !> The interval.
            real(wp), intent(in) :: from, to
            !> One entry per kink. `middle` contains bounds of the arguments at the middle of the interval, which include rounding
            !> errors.
            type(interval_type), intent(out) :: arguments(:), rates(:), middle(:)
        end subroutine enclose_kinks

        !> Bounds of the values of parts and of their derivatives while their variable varies over an interval.
        pure module subroutine enclose_parts(self, variable, parts, from, to, values, rates, sides, curvatures)
            implicit none (type, external)
            class(expression_type), intent(in) :: self
            integer, intent(in) :: variable
            !> Result of `list_parts`.
            integer, intent(in) :: parts(:)
            real(wp), intent(in) :: from, to
            type(interval_type), intent(out) :: values(:), rates(:)
            !> Side of each kink: 1 or -1. By default the values of the variables decide.
            integer, intent(in), optional :: sides(:)
            !> Bounds of the second derivatives.
            type(interval_type), intent(out), optional :: curvatures(:)
        end subroutine enclose_parts

        !> Values of parts and their derivatives with respect to the variable.
        pure module subroutine evaluate_parts(self, variable, parts, t, values, rates, sides)
            implicit none (type, external)
            class(expression_type), intent(in) :: self
            integer, intent(in) :: variable, parts(:)
            !> The variable.
            real(wp), intent(in) :: t
            real(wp), intent(out) :: values(:), rates(:)
            integer, intent(in), optional :: sides(:)
        end subroutine evaluate_parts
    end interface

contains

    !> Parse an expression, such as 'k*(length - l0) + c*rate'.
    subroutine parse_expression(expression, text, variables, error, names, values, key, column)
        type(expression_type), intent(out) :: expression
        character(len=*), intent(in) :: text
        !> Names of the variables, in the order of their values in evaluations.
        character(len=*), intent(in) :: variables(:)
        type(error_type), allocatable, intent(out) :: error
        !> Names and values of parameters, which become constants.
        character(len=*), intent(in), optional :: names(:)
        real(wp), intent(in), optional :: values(:)
        !> Key for messages, such as 'joint.motor.motion'.
        character(len=*), intent(in), optional :: key
        !> Position of an error in the text, from 1; 0 if there is no error.
        integer, intent(out), optional :: column
        character(len=:), allocatable :: problem
        integer :: position

        if (present(names) .and. present(values)) then
            call compile(text, variables, names, values, expression%code, position, problem)
        else
            call compile(text, variables, [character(len=1) ::], [real(wp) ::], expression%code, position, problem)
        end if
        if (present(column)) column = merge(position, 0, allocated(problem))
        if (.not. allocated(problem)) return
        problem = 'column '//to_text(position)//' of '//excerpt(text, position)//': '//problem
        if (present(key)) problem = key//': '//problem
        call set_error(error, status_invalid_model, problem, 'correct the expression')
    end subroutine parse_expression

    !> Refuse invalid names of variables and parameters.
    subroutine check_name(name, error)
        character(len=*), intent(in) :: name
        type(error_type), allocatable, intent(out) :: error

        if (.not. is_name(name)) then
            call set_error(error, status_invalid_model, '"'//name//'" is not a valid name in expressions', &
                'use a letter, followed by letters, digits and underscores')
        else if (len(name) > name_length) then
            call set_error(error, status_invalid_model, 'the name "'//name(:name_length)//'..." is too long', &
                'use at most '//to_text(name_length)//' characters')
        else if (name == 'pi' .or. find_function(name) > 0) then
            call set_error(error, status_invalid_model, '"'//name//'" is reserved in expressions', &
                'choose another name')
        end if
    end subroutine check_name

    !> Length of a quotation from a text.
    pure integer function excerpt_length(text, position)
        character(len=*), intent(in) :: text
        integer, intent(in) :: position
        integer, parameter :: shown = 30

        excerpt_length = min(len(text), position + shown) - max(1, position - shown) + 1 + 2 + merge(3, 0, position > shown + 1) + &
            merge(3, 0, len(text) > position + shown)
    end function excerpt_length

    !> Quotation of a text around a position, without control characters.
    pure function excerpt(text, position) result(quoted)
        character(len=*), intent(in) :: text
        integer, intent(in) :: position
        character(len=excerpt_length(text, position)) :: quoted
        integer, parameter :: shown = 30
        integer :: i, n

        quoted = '"'
        n = 1
        if (position > shown + 1) then
            quoted(2:4) = '...'
            n = 4
        end if
        do i = max(1, position - shown), min(len(text), position + shown)
            n = n + 1
            quoted(n:n) = merge(text(i:i), '?', iachar(text(i:i)) >= 32 .and. iachar(text(i:i)) < 127)
        end do
        quoted(n + 1:) = '"'
        if (len(text) > position + shown) quoted(n + 1:) = '..."'
    end function excerpt

    !> True if the expression contains no variable.
    pure logical function is_constant(self)
        class(expression_type), intent(in) :: self

        is_constant = size(self%code%variables) == 0
    end function is_constant

    !> First variable of the expression that is not in a set; 0 if all are.
    pure integer function first_outside(self, some)
        class(expression_type), intent(in) :: self
        !> True for each variable in the set.
        logical, intent(in) :: some(:)
        integer :: i

        do i = 1, size(self%code%variables)
            first_outside = self%code%variables(i)
            if (.not. some(first_outside)) return
        end do
        first_outside = 0
    end function first_outside

    !> Number of operations per evaluation.
    pure integer function n_operations(self)
        class(expression_type), intent(in) :: self

        n_operations = size(self%code%operations)
    end function n_operations

    !> Number of kinks.
    pure integer function n_kinks(self)
        class(expression_type), intent(in) :: self

        n_kinks = size(self%code%kink_left)
    end function n_kinks

    !> Lowest derivative that jumps at a kink: 0 is the value (sign, step), 1 the slope (abs, ramp, min, max), 3 (smooth_step).
    pure integer function kink_order(self, kink)
        class(expression_type), intent(in) :: self
        integer, intent(in) :: kink

        kink_order = self%code%kink_orders(kink)
    end function kink_order

    !> True if the argument of a kink depends on any variable other than the given one.
    pure logical function kink_depends_on_others(self, kink, variable) result(depends)
        class(expression_type), intent(in) :: self
        integer, intent(in) :: kink
        !> Index of this variable in the list of names.
        integer, intent(in) :: variable
        logical :: w(max_slots)
        integer :: k, n

        associate (code => self%code)
            n = size(code%variables)
            w(:n) = code%variables /= variable
            w(n + 1:n + size(code%constants)) = .false.
            n = code%n_slots - size(code%operations)
            do k = 1, size(code%operations)
                w(n + k) = w(code%left(k)) .or. w(code%right(k))
            end do
            depends = w(code%kink_left(kink)) .or. w(code%kink_right(kink))
        end associate
    end function kink_depends_on_others

    !> Renumber the variables consecutively, omitting those that do not occur.
    pure subroutine renumber(self, used)
        class(expression_type), intent(inout) :: self
        !> Previous indices: in later evaluations x(i) is the variable used(i).
        integer, allocatable, intent(out) :: used(:)
        integer :: i

        used = self%code%variables
        self%code%variables = [(i, i=1, size(used))]
    end subroutine renumber

    !> Set the slots of variables and constants.
    pure subroutine fill_leaves(self, x, w)
        class(expression_type), intent(in) :: self
        real(wp), intent(in) :: x(:)
        real(wp), intent(inout) :: w(:)
        integer :: i, n

        n = size(self%code%variables)
        do i = 1, n
            w(i) = x(self%code%variables(i))
        end do
        do i = 1, size(self%code%constants)
            w(n + i) = self%code%constants(i)
        end do
    end subroutine fill_leaves

    !> Branch of an operation with kinks.
    pure integer function branch_at(self, k, a, b, sides) result(branch)
        class(expression_type), intent(in) :: self
        !> Index of the operation, and values of its operands.
        integer, intent(in) :: k
        real(wp), intent(in) :: a, b
        integer, intent(in), optional :: sides(:)

        branch = 0
        if (self%code%first_kink(k) == 0) return
        if (present(sides)) then
            branch = self%branch_with(k, sides)
        else
            branch = branch_of(self%code%operations(k), a, b)
        end if
    end function branch_at

    !> Branch of an operation for given sides of its kinks.
    pure integer function branch_with(self, k, sides) result(branch)
        class(expression_type), intent(in) :: self
        integer, intent(in) :: k, sides(:)
        integer :: kink, last

        kink = self%code%first_kink(k)
        ! smooth_step has two kinks, first at 0, then at 1.
        last = kink
        if (self%code%kink_orders(kink) > 1) last = kink + 1
        branch = count(sides(kink:last) >= 0)
        if (last > kink .and. sides(last) >= 0) branch = 2
    end function branch_with

    !> Value of the expression.
    pure real(wp) function evaluate_value(self, x, sides) result(value)
        class(expression_type), intent(in) :: self
        !> Values of the variables, in the order of their names.
        real(wp), intent(in) :: x(:)
        !> Side of each kink: 1 or -1. By default the values of the variables decide.
        integer, intent(in), optional :: sides(:)
        real(wp) :: w(max_slots)

        call fill_values(self, x, w, sides)
        value = w(self%code%n_slots)
    end function evaluate_value

    !> Evaluate all slots.
    pure subroutine fill_values(self, x, w, sides)
        class(expression_type), intent(in) :: self
        real(wp), intent(in) :: x(:)
        real(wp), intent(inout) :: w(:)
        integer, intent(in), optional :: sides(:)
        integer :: k, n
        real(wp) :: a, b

        call self%fill_leaves(x, w)
        associate (code => self%code)
            n = code%n_slots - size(code%operations)
            do k = 1, size(code%operations)
                a = w(code%left(k))
                b = w(code%right(k))
                w(n + k) = value_of(code%operations(k), a, b, self%branch_at(k, a, b, sides))
            end do
        end associate
    end subroutine fill_values

    !> Value and gradient.
    pure subroutine evaluate_gradient(self, x, value, gradient, sides)
        class(expression_type), intent(in) :: self
        !> Values of the variables.
        real(wp), intent(in) :: x(:)
        real(wp), intent(out) :: value
        !> Derivatives with respect to the variables; zero for a variable that does not occur.
        real(wp), intent(out) :: gradient(:)
        integer, intent(in), optional :: sides(:)
        real(wp) :: w(max_slots), g(max_slots), d(5, max_slots), a, b
        integer :: k, n

        call self%fill_leaves(x, w)
        associate (code => self%code)
            n = code%n_slots - size(code%operations)
            do k = 1, size(code%operations)
                a = w(code%left(k))
                b = w(code%right(k))
                call differentiate(code%operations(k), a, b, self%branch_at(k, a, b, sides), w(n + k), d(:, k))
            end do
            value = w(code%n_slots)
            g(:code%n_slots) = 0.0_wp
            g(code%n_slots) = 1.0_wp
            do k = size(code%operations), 1, -1
                g(code%left(k)) = g(code%left(k)) + d(1, k)*g(n + k)
                g(code%right(k)) = g(code%right(k)) + d(2, k)*g(n + k)
            end do
            gradient = 0.0_wp
            do k = 1, size(code%variables)
                gradient(code%variables(k)) = g(k)
            end do
        end associate
    end subroutine evaluate_gradient

    !> Value, and first and second derivative of f(x + s v) with respect to s at s = 0.
    pure subroutine evaluate_along(self, x, v, value, first, second, sides)
        class(expression_type), intent(in) :: self
        !> Values of the variables, and direction.
        real(wp), intent(in) :: x(:), v(:)
        real(wp), intent(out) :: value, first, second
        integer, intent(in), optional :: sides(:)
        !> Values, first and second derivatives of all slots.
        real(wp) :: w(max_slots), w1(max_slots), w2(max_slots)
        real(wp) :: d(5), a1, b1
        integer :: k, n, i, j

        call self%fill_leaves(x, w)
        call fill_directions(self, v, w1)
        associate (code => self%code)
            n = code%n_slots - size(code%operations)
            w2(:n) = 0.0_wp
            do k = 1, size(code%operations)
                i = code%left(k)
                j = code%right(k)
                call differentiate(code%operations(k), w(i), w(j), self%branch_at(k, w(i), w(j), sides), w(n + k), d)
                a1 = w1(i)
                b1 = w1(j)
                w1(n + k) = d(1)*a1 + d(2)*b1
                w2(n + k) = d(1)*w2(i) + d(2)*w2(j) + (d(3)*a1 + 2.0_wp*d(4)*b1)*a1 + d(5)*b1*b1
            end do
            value = w(code%n_slots)
            first = w1(code%n_slots)
            second = w2(code%n_slots)
        end associate
    end subroutine evaluate_along

    !> Set the slots of variables to the direction, and those of constants to zero.
    pure subroutine fill_directions(self, v, w1)
        class(expression_type), intent(in) :: self
        real(wp), intent(in) :: v(:)
        real(wp), intent(inout) :: w1(:)
        integer :: i

        do i = 1, size(self%code%variables)
            w1(i) = v(self%code%variables(i))
        end do
        do i = size(self%code%variables) + 1, size(self%code%variables) + size(self%code%constants)
            w1(i) = 0.0_wp
        end do
    end subroutine fill_directions

    !> Value, derivative along a direction v, gradient, and the derivative of the gradient along v, which is the matrix of second
    !> derivatives times v.
    pure subroutine evaluate_gradient_along(self, x, v, value, first, gradient, gradient_along, sides)
        class(expression_type), intent(in) :: self
        !> Values of the variables, and direction.
        real(wp), intent(in) :: x(:), v(:)
        real(wp), intent(out) :: value, first, gradient(:), gradient_along(:)
        integer, intent(in), optional :: sides(:)
        !> Values of all slots; derivatives of the result with respect to the slots; derivatives of both along v.
        real(wp) :: w(max_slots), w1(max_slots), g(max_slots), g1(max_slots)
        real(wp) :: d(5, max_slots)
        integer :: k, n, i, j

        call self%fill_leaves(x, w)
        call fill_directions(self, v, w1)
        associate (code => self%code)
            n = code%n_slots - size(code%operations)
            do k = 1, size(code%operations)
                i = code%left(k)
                j = code%right(k)
                call differentiate(code%operations(k), w(i), w(j), self%branch_at(k, w(i), w(j), sides), w(n + k), d(:, k))
                w1(n + k) = d(1, k)*w1(i) + d(2, k)*w1(j)
            end do
            value = w(code%n_slots)
            first = w1(code%n_slots)
            g(:code%n_slots) = 0.0_wp
            g1(:code%n_slots) = 0.0_wp
            g(code%n_slots) = 1.0_wp
            do k = size(code%operations), 1, -1
                i = code%left(k)
                j = code%right(k)
                g(i) = g(i) + d(1, k)*g(n + k)
                g1(i) = g1(i) + d(1, k)*g1(n + k) + (d(3, k)*w1(i) + d(4, k)*w1(j))*g(n + k)
                g(j) = g(j) + d(2, k)*g(n + k)
                g1(j) = g1(j) + d(2, k)*g1(n + k) + (d(4, k)*w1(i) + d(5, k)*w1(j))*g(n + k)
            end do
            gradient = 0.0_wp
            gradient_along = 0.0_wp
            do k = 1, size(code%variables)
                gradient(code%variables(k)) = g(k)
                gradient_along(code%variables(k)) = g1(k)
            end do
        end associate
    end subroutine evaluate_gradient_along

    !> Argument of each kink, which vanishes at the kink, and its derivative along a direction.
    pure subroutine evaluate_kinks(self, x, v, arguments, rates, sides)
        class(expression_type), intent(in) :: self
        !> Values of the variables; direction, such as their rates.
        real(wp), intent(in) :: x(:), v(:)
        !> One entry per kink.
        real(wp), intent(out) :: arguments(:), rates(:)
        integer, intent(in), optional :: sides(:)
        real(wp) :: w(max_slots), w1(max_slots), d(5)
        integer :: k, n, i, j

        call self%fill_leaves(x, w)
        call fill_directions(self, v, w1)
        associate (code => self%code)
            n = code%n_slots - size(code%operations)
            do k = 1, size(code%operations)
                i = code%left(k)
                j = code%right(k)
                call differentiate(code%operations(k), w(i), w(j), self%branch_at(k, w(i), w(j), sides), w(n + k), d)
                w1(n + k) = d(1)*w1(i) + d(2)*w1(j)
            end do
            do k = 1, size(code%kink_left)
                i = code%kink_left(k)
                j = code%kink_right(k)
                arguments(k) = w(i) - w(j) - code%kink_offsets(k)
                rates(k) = w1(i) - w1(j)
            end do
        end associate
    end subroutine evaluate_kinks

    !> Side of each kink at a point. At the kink itself, the side into which a motion along v leads. A run that continues from the
    !> point keeps these sides.
    pure subroutine find_sides(self, x, v, sides)
        class(expression_type), intent(in) :: self
        !> Values of the variables and their rates.
        real(wp), intent(in) :: x(:), v(:)
        !> 1 or -1 for each kink.
        integer, intent(out) :: sides(:)
        real(wp) :: arguments(size(sides)), rates(size(sides))
        integer :: k

        call self%evaluate_kinks(x, v, arguments, rates)
        do k = 1, size(sides)
            sides(k) = merge(1, -1, arguments(k) > 0.0_wp .or. (.not. arguments(k) < 0.0_wp .and. rates(k) >= 0.0_wp))
        end do
    end subroutine find_sides
end module tandem_mechanism_expression
