! SPDX-License-Identifier: MIT
!> Expressions with kinks that depend on time alone: where they are, and the smooth piece between two of them that is held while a
!> step is within it. Kinks that depend on something else are where the state says.
module tandem_mechanism_piecewise
    use tandem_error, only: error_type, set_error, to_text
    use tandem_kinds, only: wp
    use tandem_mechanism_expression, only: expression_type
    use tandem_status, only: status_invalid_model
    implicit none (type, external)
    private

    public :: piecewise_type

    !> An expression, and of each kink whether it depends on time alone, and its side.
    type :: piecewise_type
        type(expression_type) :: expression
        !> Which variable is the time, 0 for none.
        integer :: time = 0
        !> The highest place of a variable that is used, or of the time.
        integer :: n_variables = 0
        logical, allocatable :: is_timed(:)
        integer, allocatable :: sides(:)
        !> Whether sides are held, and whether all of them are.
        logical :: holds = .false., holds_all = .false.
    contains
        procedure :: initialize, find_kinks, hold, evaluate_value
        procedure :: evaluate_gradient, evaluate_along, evaluate_gradient_along
        procedure, private :: current_sides
    end type piecewise_type

    !> Into how many parts the time of a run is divided by the search for kinks.
    integer, parameter :: n_parts = 4096
    !> How often a part with a kink is divided.
    integer, parameter :: n_halvings = 80

contains

    !> Keep an expression.
    subroutine initialize(self, expression, time)
        class(piecewise_type), intent(out) :: self
        type(expression_type), intent(in) :: expression
        !> Which of its variables is the time, 0 for none.
        integer, intent(in) :: time
        type(expression_type) :: copy
        integer, allocatable :: used(:)
        integer :: k

        self%expression = expression
        self%time = time
        copy = expression
        call copy%renumber(used)
        self%n_variables = max(time, maxval([0, used]))
        allocate (self%is_timed(expression%n_kinks()), self%sides(expression%n_kinks()))
        self%sides = 1
        do k = 1, size(self%is_timed)
            self%is_timed(k) = time > 0 .and. .not. expression%kink_depends_on_others(k, max(1, time))
        end do
    end subroutine initialize

    !> The times of the kinks within an interval, in no order, and the lowest derivative that jumps there. An argument of a kink is
    !> looked at in 4096 parts of the interval, and where it turns back towards zero within one of them, at its extremum.
    subroutine find_kinks(self, from, to, places, orders, error)
        class(piecewise_type), intent(in) :: self
        !> The interval; its ends do not count.
        real(wp), intent(in) :: from, to
        real(wp), allocatable, intent(out) :: places(:)
        integer, allocatable, intent(out) :: orders(:)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: most = 100000
        real(wp) :: a, b, middle, at_a, at_b, slope_a, slope_b, at_middle
        integer :: i, k

        allocate (places(0), orders(0))
        if (.not. to > from) return
        do k = 1, size(self%is_timed)
            if (.not. self%is_timed(k)) cycle
            b = from
            call look(self, k, b, at_b, slope_b)
            do i = 1, n_parts
                a = b
                at_a = at_b
                slope_a = slope_b
                b = from + (to - from)*i/n_parts
                call look(self, k, b, at_b, slope_b)
                if (at_a*at_b < 0.0_wp) then
                    call add(k, zero_between(self, k, a, b, at_a))
                else if (.not. abs(at_b) > 0.0_wp) then
                    ! A value that is zero all along is none of a kink.
                    if (abs(at_a) > 0.0_wp .or. abs(slope_b) > 0.0_wp) call add(k, b)
                else if (at_a*slope_a < 0.0_wp .and. at_b*slope_b > 0.0_wp) then
                    middle = extremum_between(self, k, a, b, slope_a)
                    call look(self, k, middle, at_middle, slope_a)
                    if (at_a*at_middle >= 0.0_wp) cycle
                    call add(k, zero_between(self, k, a, middle, at_a))
                    call add(k, zero_between(self, k, middle, b, at_middle))
                end if
                if (size(places) > most) then
                    call set_error(error, status_invalid_model, 'an expression has more than '//to_text(most)// &
                        ' kinks within the time of the run', 'make it smoother, or the run shorter')
                    return
                end if
            end do
        end do

    contains

        subroutine add(k, t)
            integer, intent(in) :: k
            real(wp), intent(in) :: t

            if (t <= from .or. t >= to) return
            places = [places, t]
            orders = [orders, self%expression%kink_order(k)]
        end subroutine add
    end subroutine find_kinks

    !> The argument of a kink and its rate.
    pure subroutine look(self, k, t, value, rate)
        class(piecewise_type), intent(in) :: self
        integer, intent(in) :: k
        real(wp), intent(in) :: t
        real(wp), intent(out) :: value, rate
        real(wp) :: values(size(self%is_timed)), rates(size(self%is_timed)), x(self%n_variables), v(self%n_variables)

        ! This kink does not look at others than the time.
        x = 0.0_wp
        v = 0.0_wp
        x(self%time) = t
        v(self%time) = 1.0_wp
        call self%expression%evaluate_kinks(x, v, values, rates)
        value = values(k)
        rate = rates(k)
    end subroutine look

    !> Where the argument changes its sign.
    pure real(wp) function zero_between(self, k, from_here, to_there, at_first)
        class(piecewise_type), intent(in) :: self
        integer, intent(in) :: k
        real(wp), intent(in) :: from_here, to_there, at_first
        real(wp) :: low, high, value, rate, guess
        integer :: halving

        low = from_here
        high = to_there
        zero_between = (low + high)/2
        do halving = 1, n_halvings
            call look(self, k, zero_between, value, rate)
            if (.not. abs(value) > 0.0_wp) return
            if (value*at_first > 0.0_wp) then
                low = zero_between
            else
                high = zero_between
            end if
            ! Newton's step where it stays inside, so that straight arguments give the time itself.
            guess = zero_between - value/rate
            if (.not. (guess > low .and. guess < high) .or. mod(halving, 4) == 0) guess = (low + high)/2
            if (.not. (guess > low .and. guess < high)) return
            zero_between = guess
        end do
    end function zero_between

    !> Where its rate does.
    pure real(wp) function extremum_between(self, k, from_here, to_there, slope_first)
        class(piecewise_type), intent(in) :: self
        integer, intent(in) :: k
        real(wp), intent(in) :: from_here, to_there, slope_first
        real(wp) :: low, high, value, rate
        integer :: halving

        low = from_here
        high = to_there
        do halving = 1, n_halvings
            extremum_between = (low + high)/2
            if (.not. (extremum_between > low .and. extremum_between < high)) exit
            call look(self, k, extremum_between, value, rate)
            if (rate*slope_first > 0.0_wp) then
                low = extremum_between
            else
                high = extremum_between
            end if
        end do
    end function extremum_between

    !> Hold the smooth piece that a time lies in, which is no kink.
    pure subroutine hold(self, t)
        class(piecewise_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp) :: x(self%n_variables), v(self%n_variables)
        integer :: sides(size(self%is_timed))

        if (.not. any(self%is_timed)) return
        x = 0.0_wp
        v = 0.0_wp
        x(self%time) = t
        v(self%time) = 1.0_wp
        call self%expression%find_sides(x, v, sides)
        where (self%is_timed) self%sides = sides
        self%holds = .true.
        self%holds_all = all(self%is_timed)
    end subroutine hold

    !> The sides of all kinks: those of the state, and those that are held.
    pure function current_sides(self, x) result(sides)
        class(piecewise_type), intent(in) :: self
        real(wp), intent(in) :: x(:)
        integer :: sides(size(self%is_timed))
        real(wp) :: v(size(x))

        if (self%holds_all) then
            sides = self%sides
        else
            v = 0.0_wp
            call self%expression%find_sides(x, v, sides)
            where (self%is_timed) sides = self%sides
        end if
    end function current_sides

    !> The value.
    pure real(wp) function evaluate_value(self, x) result(value)
        class(piecewise_type), intent(in) :: self
        !> The variables.
        real(wp), intent(in) :: x(:)

        if (self%holds) then
            value = self%expression%value(x, self%current_sides(x))
        else
            value = self%expression%value(x)
        end if
    end function evaluate_value

    !> Value and gradient.
    pure subroutine evaluate_gradient(self, x, value, gradient)
        class(piecewise_type), intent(in) :: self
        real(wp), intent(in) :: x(:)
        real(wp), intent(out) :: value, gradient(:)

        if (self%holds) then
            call self%expression%evaluate_gradient(x, value, gradient, self%current_sides(x))
        else
            call self%expression%evaluate_gradient(x, value, gradient)
        end if
    end subroutine evaluate_gradient

    !> Value, and first and second derivative along a direction.
    pure subroutine evaluate_along(self, x, v, value, first, second)
        class(piecewise_type), intent(in) :: self
        real(wp), intent(in) :: x(:), v(:)
        real(wp), intent(out) :: value, first, second

        if (self%holds) then
            call self%expression%evaluate_along(x, v, value, first, second, self%current_sides(x))
        else
            call self%expression%evaluate_along(x, v, value, first, second)
        end if
    end subroutine evaluate_along

    !> Value, derivative along a direction, gradient, and its derivative along it.
    pure subroutine evaluate_gradient_along(self, x, v, value, first, gradient, gradient_along)
        class(piecewise_type), intent(in) :: self
        real(wp), intent(in) :: x(:), v(:)
        real(wp), intent(out) :: value, first, gradient(:), gradient_along(:)

        if (self%holds) then
            call self%expression%evaluate_gradient_along(x, v, value, first, gradient, gradient_along, self%current_sides(x))
        else
            call self%expression%evaluate_gradient_along(x, v, value, first, gradient, gradient_along)
        end if
    end subroutine evaluate_gradient_along
end module tandem_mechanism_piecewise
