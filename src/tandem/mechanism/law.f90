! SPDX-License-Identifier: MIT
!> Force laws f(t, x, xd) for a coordinate x, such as the length of a spring or the angle of a joint, with the derivatives with
!> respect to x and xd that the gradient blocks require. For the length of a spring, f is a tension: positive if it pulls the ends
!> together. For a joint coordinate, a positive f accelerates the coordinate.
module tandem_mechanism_law
    use tandem_error, only: error_type
    use tandem_kinds, only: wp
    use tandem_mechanism_expression, only: expression_type
    use tandem_mechanism_piecewise, only: piecewise_type
    use tandem_mechanism_table_function, only: table_type
    implicit none (type, external)
    private

    public :: law_type, law_item_type, expression_law_type, expression_law, table_law_type, table_law, friction_law_type, &
        law_rate_type

    !> A force law. Extend this type to define other laws.
    type, abstract :: law_type
    contains
        procedure(evaluate_interface), deferred :: evaluate
        !> Force without its derivatives; override where these cost more.
        procedure :: force => force_of_any
        !> Override for laws with kinks in time only: find the kinks; select the smooth piece around a time; detect variation that a
        !> step misses between the times at which it evaluates.
        procedure :: find_kinks => find_no_kinks, hold => hold_nothing, hides => hides_nothing
        !> Partial derivative of the force with respect to time, zero by default.
        procedure :: by_time => zero_by_time
    end type law_type

    abstract interface
        !> Return the force and its derivatives.
        pure subroutine evaluate_interface(self, t, x, v, f)
            import :: law_type, wp
            implicit none (type, external)
            class(law_type), intent(in) :: self
            !> Time (s), coordinate (m or rad) and its rate.
            real(wp), intent(in) :: t, x, v
            !> f (N or N m), and its derivatives with respect to x and v.
            real(wp), intent(out) :: f(0:2)
        end subroutine evaluate_interface
    end interface

    !> Element of a list of laws.
    type :: law_item_type
        class(law_type), allocatable :: law
    end type law_item_type

    !> An expression of time, coordinate and rate.
    type, extends(law_type) :: expression_law_type
        type(piecewise_type) :: pieces
    contains
        procedure :: evaluate => evaluate_expression, find_kinks => find_expression_kinks, hold => hold_expression, &
            hides => expression_hides
        procedure :: force => force_of_expression
        procedure :: by_time => expression_by_time
    end type expression_law_type

    !> Partial derivative of a law with respect to time, as a law. Its own derivatives are zero, since they are never used.
    type, extends(law_type) :: law_rate_type
        class(law_type), allocatable :: law
    contains
        procedure :: evaluate => evaluate_rate
    end type law_rate_type

    !> A table of forces at given values of the coordinate.
    type, extends(law_type) :: table_law_type
        type(table_type) :: table
    contains
        procedure :: evaluate => evaluate_table
    end type table_law_type

    !> Regularised friction for a constant normal force N: N (mu_d tanh 4 u + (mu_s - mu_d) u/(u^2/4 + 3/4)^2) + c v with u = v/v_t.
    !> It rises steeply with the rate v to its maximum at the transition speed v_t and falls to sliding friction beyond. The law of
    !> a joint coordinate has the opposite sign, so that friction opposes the rate. Source: P. Brown, J. McPhee, A continuous
    !> velocity-based friction model for dynamics and control with physically meaningful parameters, J. Comput. Nonlinear Dynam. 11
    !> (2016) 054502, eq. 6.
    type, extends(law_type) :: friction_law_type
        !> N (N; for a rotation N m, the product of force and radius); coefficients mu_s and mu_d of static and sliding friction;
        !> v_t (m/s, rad/s); viscous coefficient c (N s/m, N m s/rad).
        real(wp) :: normal = 0.0_wp, static = 0.0_wp, dynamic = 0.0_wp, speed = 1.0_wp, viscous = 0.0_wp
    contains
        procedure :: evaluate => evaluate_friction
    end type friction_law_type

contains

    !> Force.
    pure real(wp) function force_of_any(self, t, x, v) result(force)
        class(law_type), intent(in) :: self
        !> Time (s), coordinate (m or rad) and its rate.
        real(wp), intent(in) :: t, x, v
        real(wp) :: f(0:2)

        call self%evaluate(t, x, v, f)
        force = f(0)
    end function force_of_any

    !> List the kinks within an interval of time; none by default.
    subroutine find_no_kinks(self, from, to, places, orders, error)
        class(law_type), intent(in) :: self
        !> Interval (s), excluding its start. If the search ends early, `to` is lowered to the end of the searched interval.
        real(wp), intent(in) :: from
        real(wp), intent(inout) :: to
        !> Times of the kinks in any order, and the lowest derivative that jumps at each: 0 is the value.
        real(wp), allocatable, intent(out) :: places(:)
        integer, allocatable, intent(out) :: orders(:)
        type(error_type), allocatable, intent(out) :: error

        allocate (places(0), orders(0))
    end subroutine find_no_kinks

    !> Select the smooth piece around a time; a law without kinks in time has only one.
    pure subroutine hold_nothing(self, t)
        class(law_type), intent(inout) :: self
        !> A time inside the piece, not at a kink (s).
        real(wp), intent(in) :: t
    end subroutine hold_nothing

    !> True if the law varies between two times in a way that a step of this length would miss; false for a law without kinks in
    !> time.
    logical function hides_nothing(self, from, to, between) result(hides)
        class(law_type), intent(inout) :: self
        !> Two times within the current piece (s).
        real(wp), intent(in) :: from, to
        !> True if the step also evaluates between its ends.
        logical, intent(in) :: between

        hides = .false.
    end function hides_nothing

    !> Law of a parsed expression of the variables time, coordinate, rate, in this order.
    function expression_law(expression) result(law)
        type(expression_type), intent(in) :: expression
        type(expression_law_type) :: law

        call law%pieces%initialize(expression, 1)
    end function expression_law

    !> Law of a table with respect to the coordinate.
    function table_law(table) result(law)
        type(table_type), intent(in) :: table
        type(table_law_type) :: law

        law%table = table
    end function table_law

    pure subroutine evaluate_expression(self, t, x, v, f)
        class(expression_law_type), intent(in) :: self
        real(wp), intent(in) :: t, x, v
        real(wp), intent(out) :: f(0:2)
        real(wp) :: gradient(3), variables(3)

        variables(1) = t
        variables(2) = x
        variables(3) = v
        call self%pieces%evaluate_gradient(variables, f(0), gradient)
        f(1) = gradient(2)
        f(2) = gradient(3)
    end subroutine evaluate_expression

    pure real(wp) function force_of_expression(self, t, x, v) result(force)
        class(expression_law_type), intent(in) :: self
        real(wp), intent(in) :: t, x, v
        real(wp) :: variables(3)

        variables(1) = t
        variables(2) = x
        variables(3) = v
        force = self%pieces%evaluate_value(variables)
    end function force_of_expression

    pure real(wp) function zero_by_time(self, t, x, v) result(rate)
        class(law_type), intent(in) :: self
        !> Time (s), coordinate (m or rad) and its rate.
        real(wp), intent(in) :: t, x, v

        rate = 0.0_wp
    end function zero_by_time

    pure real(wp) function expression_by_time(self, t, x, v) result(rate)
        class(expression_law_type), intent(in) :: self
        real(wp), intent(in) :: t, x, v
        real(wp) :: value, gradient(3)

        call self%pieces%evaluate_gradient([t, x, v], value, gradient)
        rate = gradient(1)
    end function expression_by_time

    pure subroutine evaluate_rate(self, t, x, v, f)
        class(law_rate_type), intent(in) :: self
        real(wp), intent(in) :: t, x, v
        real(wp), intent(out) :: f(0:2)

        f = [self%law%by_time(t, x, v), 0.0_wp, 0.0_wp]
    end subroutine evaluate_rate

    subroutine find_expression_kinks(self, from, to, places, orders, error)
        class(expression_law_type), intent(in) :: self
        real(wp), intent(in) :: from
        real(wp), intent(inout) :: to
        real(wp), allocatable, intent(out) :: places(:)
        integer, allocatable, intent(out) :: orders(:)
        type(error_type), allocatable, intent(out) :: error

        call self%pieces%find_kinks(from, to, places, orders, error)
    end subroutine find_expression_kinks

    pure subroutine hold_expression(self, t)
        class(expression_law_type), intent(inout) :: self
        real(wp), intent(in) :: t

        call self%pieces%select_piece(t)
    end subroutine hold_expression

    logical function expression_hides(self, from, to, between) result(hides)
        class(expression_law_type), intent(inout) :: self
        real(wp), intent(in) :: from, to
        logical, intent(in) :: between

        hides = self%pieces%hides(from, to, between, .false.)
    end function expression_hides

    pure subroutine evaluate_friction(self, t, x, v, f)
        class(friction_law_type), intent(in) :: self
        real(wp), intent(in) :: t, x, v
        real(wp), intent(out) :: f(0:2)
        real(wp) :: u, g, th

        u = v/self%speed
        g = u**2/4 + 0.75_wp
        th = tanh(4*u)
        f(0) = -(self%normal*(self%dynamic*th + (self%static - self%dynamic)*u/g**2) + self%viscous*v)
        f(1) = 0.0_wp
        f(2) = -(self%normal/self%speed*(4*self%dynamic*(1 - th**2) + (self%static - self%dynamic)*0.75_wp*(1 - u**2)/g**3) + &
            self%viscous)
    end subroutine evaluate_friction

    pure subroutine evaluate_table(self, t, x, v, f)
        class(table_law_type), intent(in) :: self
        real(wp), intent(in) :: t, x, v
        real(wp), intent(out) :: f(0:2)
        real(wp) :: curvature

        call self%table%evaluate(x, f(0), f(1), curvature)
        f(2) = 0.0_wp
    end subroutine evaluate_table
end module tandem_mechanism_law
