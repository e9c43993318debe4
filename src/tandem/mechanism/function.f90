! SPDX-License-Identifier: MIT
!> Functions of time: imposed motions, lengths, forces. Each returns its value and two derivatives, so that gamma is exact for rows
!> that depend on time. Each also lists its kinks; steps end at these times.
module tandem_mechanism_function
    use tandem_error, only: error_type
    use tandem_kinds, only: wp
    use tandem_mechanism_expression, only: expression_type
    use tandem_mechanism_piecewise, only: piecewise_type
    use tandem_mechanism_table_function, only: table_type
    implicit none (type, external)
    private

    public :: function_type, constant_type, polynomial_type, sine_type, ramp
    public :: expression_function_type, expression_function, table_function_type, table_function

    !> A function of time. Extend this type to define other functions.
    type, abstract :: function_type
    contains
        procedure(evaluate_interface), deferred :: evaluate
        !> Override for functions with kinks only: find the kinks; select the smooth piece around a time; detect variation that a
        !> step misses between the times at which it evaluates.
        procedure :: find_kinks => find_no_kinks, hold => hold_nothing, hides => hides_nothing
    end type function_type

    abstract interface
        !> Return the value and the first and second derivative.
        pure subroutine evaluate_interface(self, t, f)
            import :: function_type, wp
            implicit none (type, external)
            class(function_type), intent(in) :: self
            !> Time (s).
            real(wp), intent(in) :: t
            !> f, f', f''.
            real(wp), intent(out) :: f(0:2)
        end subroutine evaluate_interface
    end interface

    !> A constant.
    type, extends(function_type) :: constant_type
        real(wp) :: value = 0.0_wp
    contains
        procedure :: evaluate => evaluate_constant
    end type constant_type

    !> sum over k of coefficient(k) t**(k - 1).
    type, extends(function_type) :: polynomial_type
        real(wp), allocatable :: coefficient(:)
    contains
        procedure :: evaluate => evaluate_polynomial
    end type polynomial_type

    !> offset + amplitude sin(rate t + phase).
    type, extends(function_type) :: sine_type
        real(wp) :: offset = 0.0_wp, amplitude = 1.0_wp, rate = 1.0_wp, phase = 0.0_wp
    contains
        procedure :: evaluate => evaluate_sine
    end type sine_type

    !> An expression of the time.
    type, extends(function_type) :: expression_function_type
        type(piecewise_type) :: pieces
    contains
        procedure :: evaluate => evaluate_expression, find_kinks => find_expression_kinks, hold => hold_expression, &
            hides => expression_hides
    end type expression_function_type

    !> A table of values at given times.
    type, extends(function_type) :: table_function_type
        type(table_type) :: table
        !> True if `piece` is selected, which is then evaluated beyond its ends too.
        logical :: holds = .false.
        integer :: piece = 0
    contains
        procedure :: evaluate => evaluate_table, find_kinks => find_table_kinks, hold => hold_table
    end type table_function_type

contains

    !> List the kinks within an interval of time; none by default.
    subroutine find_no_kinks(self, from, to, places, orders, error)
        class(function_type), intent(in) :: self
        !> Interval (s), excluding its start. If the search ends early, `to` is lowered to the end of the searched interval.
        real(wp), intent(in) :: from
        real(wp), intent(inout) :: to
        !> Times of the kinks in any order, and the lowest derivative that jumps at each: 0 is the value.
        real(wp), allocatable, intent(out) :: places(:)
        integer, allocatable, intent(out) :: orders(:)
        type(error_type), allocatable, intent(out) :: error

        allocate (places(0), orders(0))
    end subroutine find_no_kinks

    !> Select the smooth piece around a time; a function without kinks has only one.
    pure subroutine hold_nothing(self, t)
        class(function_type), intent(inout) :: self
        !> A time inside the piece, not at a kink (s).
        real(wp), intent(in) :: t
    end subroutine hold_nothing

    !> True if the function varies between two times in a way that a step of this length would miss; false for a function without
    !> kinks.
    logical function hides_nothing(self, from, to, between, rates) result(hides)
        class(function_type), intent(inout) :: self
        !> Two times within the current piece (s).
        real(wp), intent(in) :: from, to
        !> True if the step also evaluates between its ends; true if the derivative is to be checked too.
        logical, intent(in) :: between, rates

        hides = .false.
    end function hides_nothing

    !> Function of a parsed expression whose only variable is the time.
    function expression_function(expression) result(f)
        type(expression_type), intent(in) :: expression
        type(expression_function_type) :: f

        call f%pieces%initialize(expression, 1)
    end function expression_function

    !> Function of a table with respect to time.
    function table_function(table) result(f)
        type(table_type), intent(in) :: table
        type(table_function_type) :: f

        f%table = table
    end function table_function

    pure subroutine evaluate_expression(self, t, f)
        class(expression_function_type), intent(in) :: self
        real(wp), intent(in) :: t
        real(wp), intent(out) :: f(0:2)
        real(wp), parameter :: one(1) = 1.0_wp
        real(wp) :: x(1)

        x(1) = t
        call self%pieces%evaluate_along(x, one, f(0), f(1), f(2))
    end subroutine evaluate_expression

    subroutine find_expression_kinks(self, from, to, places, orders, error)
        class(expression_function_type), intent(in) :: self
        real(wp), intent(in) :: from
        real(wp), intent(inout) :: to
        real(wp), allocatable, intent(out) :: places(:)
        integer, allocatable, intent(out) :: orders(:)
        type(error_type), allocatable, intent(out) :: error

        call self%pieces%find_kinks(from, to, places, orders, error)
    end subroutine find_expression_kinks

    pure subroutine hold_expression(self, t)
        class(expression_function_type), intent(inout) :: self
        real(wp), intent(in) :: t

        call self%pieces%select_piece(t)
    end subroutine hold_expression

    logical function expression_hides(self, from, to, between, rates) result(hides)
        class(expression_function_type), intent(inout) :: self
        real(wp), intent(in) :: from, to
        logical, intent(in) :: between, rates

        hides = self%pieces%hides(from, to, between, rates)
    end function expression_hides

    pure subroutine evaluate_table(self, t, f)
        class(table_function_type), intent(in) :: self
        real(wp), intent(in) :: t
        real(wp), intent(out) :: f(0:2)

        if (self%holds) then
            call self%table%evaluate(t, f(0), f(1), f(2), self%piece)
        else
            call self%table%evaluate(t, f(0), f(1), f(2))
        end if
    end subroutine evaluate_table

    subroutine find_table_kinks(self, from, to, places, orders, error)
        class(table_function_type), intent(in) :: self
        real(wp), intent(in) :: from
        real(wp), intent(inout) :: to
        real(wp), allocatable, intent(out) :: places(:)
        integer, allocatable, intent(out) :: orders(:)
        type(error_type), allocatable, intent(out) :: error

        ! For a repeated table, search a limited number of periods. Include a kink at the end of the interval.
        to = min(to, from + self%table%search_length())
        call self%table%find_kinks(from, nearest(to, 1.0_wp), places, orders, error)
    end subroutine find_table_kinks

    pure subroutine hold_table(self, t)
        class(table_function_type), intent(inout) :: self
        real(wp), intent(in) :: t

        self%holds = .true.
        self%piece = self%table%piece_at(t)
    end subroutine hold_table

    !> start + rate t.
    pure function ramp(start, rate) result(f)
        real(wp), intent(in) :: start, rate
        type(polynomial_type) :: f

        allocate (f%coefficient, source=[start, rate])
    end function ramp

    pure subroutine evaluate_constant(self, t, f)
        class(constant_type), intent(in) :: self
        real(wp), intent(in) :: t
        real(wp), intent(out) :: f(0:2)

        ! The products with t avoid a warning about an unused argument.
        f = [self%value, 0.0_wp*t, 0.0_wp*t]
    end subroutine evaluate_constant

    !> Value and derivatives by Horner's scheme.
    pure subroutine evaluate_polynomial(self, t, f)
        class(polynomial_type), intent(in) :: self
        real(wp), intent(in) :: t
        real(wp), intent(out) :: f(0:2)
        integer :: k

        f = 0.0_wp
        if (.not. allocated(self%coefficient)) return
        do k = size(self%coefficient), 1, -1
            f(2) = f(2)*t + 2*f(1)
            f(1) = f(1)*t + f(0)
            f(0) = f(0)*t + self%coefficient(k)
        end do
    end subroutine evaluate_polynomial

    pure subroutine evaluate_sine(self, t, f)
        class(sine_type), intent(in) :: self
        real(wp), intent(in) :: t
        real(wp), intent(out) :: f(0:2)
        real(wp) :: s, c

        s = self%amplitude*sin(self%rate*t + self%phase)
        c = self%amplitude*cos(self%rate*t + self%phase)
        f = [self%offset + s, self%rate*c, -self%rate**2*s]
    end subroutine evaluate_sine
end module tandem_mechanism_function
