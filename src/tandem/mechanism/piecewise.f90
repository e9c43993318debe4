! SPDX-License-Identifier: MIT
!> Expressions with kinks that depend only on time: finds the times of these kinks, and selects the smooth piece that is used while
!> a step lies within it. All other kinks take the side that belongs to the state.
module tandem_mechanism_piecewise
    use tandem_error, only: error_type, set_error, to_text
    use tandem_kinds, only: wp
    use tandem_mechanism_expression, only: expression_type
    use tandem_mechanism_expression_code, only: max_slots
    use tandem_mechanism_interval, only: intersection, interval_type
    use tandem_status, only: status_invalid_model
    implicit none (type, external)
    private

    public :: piecewise_type

    !> An expression; for each kink, true if it depends only on time, and its selected side.
    type :: piecewise_type
        type(expression_type) :: expression
        !> Index of the time among the variables, 0 if it does not occur.
        integer :: time = 0
        !> Largest index of a variable that occurs, or of the time.
        integer :: n_variables = 0
        logical, allocatable :: is_timed(:)
        integer, allocatable :: sides(:)
        !> Parts that depend only on time, see `expression_type`.
        integer, allocatable :: parts(:)
        !> True if a smooth piece is selected; true if this determines the sides of all kinks.
        logical :: is_selected = .false., all_selected = .false.
        !> Interval in which all parts are monotonic, so that no step can miss a variation; length of the next interval to be
        !> examined; number of steps to wait after a failure, and number that remains.
        real(wp), private :: monotonic_interval(2) = [huge(1.0_wp), -huge(1.0_wp)], next_length = 0.0_wp
        integer, private :: n_waits = 0, n_left = 0
    contains
        procedure :: initialize, find_kinks, hides, select_piece, evaluate_value
        procedure :: evaluate_gradient, evaluate_along, evaluate_gradient_along
        procedure, private :: current_sides
    end type piecewise_type

    !> Largest number of bisections of an interval that contains a kink.
    integer, parameter :: n_halvings = 80

contains

    !> Construct from an expression.
    subroutine initialize(self, expression, time)
        class(piecewise_type), intent(out) :: self
        type(expression_type), intent(in) :: expression
        !> Index of the time among the variables, 0 if it does not occur.
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
        if (time > 0) then
            self%parts = expression%list_parts(time)
        else
            allocate (self%parts(0))
        end if
        do k = 1, size(self%is_timed)
            self%is_timed(k) = time > 0 .and. .not. expression%kink_depends_on_others(k, max(1, time))
        end do
    end subroutine initialize

    !> Find all kinks within an interval, unsorted, with the lowest derivative that jumps at each. A kink is a change of sign of its
    !> argument. The interval is subdivided until bounds from interval arithmetic show for each argument that it keeps its sign, is
    !> monotonic, or vanishes up to rounding. Its signs at the ends of the subintervals then give the kinks. The search ends early
    !> after many kinks or much work.
    subroutine find_kinks(self, from, to, places, orders, error)
        class(piecewise_type), intent(in) :: self
        !> Interval, excluding its ends. On return `to` is the end of the searched interval.
        real(wp), intent(in) :: from
        real(wp), intent(inout) :: to
        real(wp), allocatable, intent(out) :: places(:)
        integer, allocatable, intent(out) :: orders(:)
        !> Set if kinks are too close to be distinguished.
        type(error_type), allocatable, intent(out) :: error
        !> Numbers of kinks and of subintervals at which the search ends once all signs are known, and number of subintervals that
        !> it may take longer.
        integer, parameter :: most_kinks = 512, most_intervals = 20000, most_extra = 64
        !> Largest number of adjacent subintervals of the smallest possible length.
        integer, parameter :: most_narrow = 64
        !> Ends of the subintervals that remain to be searched.
        real(wp) :: ends(200), left, right, middle, of_sign(size(self%is_timed))
        integer :: signs(size(self%is_timed)), n, n_parts, n_narrow, n_late, k
        logical :: is_narrow

        allocate (places(0), orders(0))
        if (.not. (to > from .and. any(self%is_timed))) return
        left = from
        call find_signs(self, left, signs)
        of_sign = left
        n = 1
        ends(1) = to
        n_parts = 0
        n_narrow = 0
        n_late = 0
        do while (n > 0)
            right = ends(n)
            middle = left + (right - left)/2
            n_parts = n_parts + 1
            if (.not. is_simple(self, left, right)) then
                is_narrow = n == size(ends) .or. right - left <= 4*spacing(max(abs(left), abs(right), 1.0e-3_wp*(to - from)))
                if (.not. is_narrow) then
                    n = n + 1
                    ends(n) = middle
                    cycle
                end if
                n_narrow = n_narrow + 1
                if (n_narrow > most_narrow) then
                    call set_error(error, status_invalid_model, 'the kinks of an expression at t = '//to_text(left)// &
                        ' are too close to each other to be distinguished', &
                        'make the expression smoother there, or end the run earlier')
                    return
                end if
            else
                n_narrow = 0
            end if
            call compare_signs()
            left = right
            n = n - 1
            if (size(places) < most_kinks .and. n_parts < most_intervals) cycle
            n_late = n_late + 1
            if (all(signs /= 0 .or. .not. self%is_timed) .or. n_late > most_extra) exit
        end do
        to = left

    contains

        !> Record a kink at each change of sign of an argument.
        subroutine compare_signs()
            integer :: now(size(signs))
            real(wp) :: t

            call find_signs(self, right, now)
            do k = 1, size(signs)
                if (now(k) == 0) cycle
                if (now(k)*signs(k) < 0) then
                    t = zero_between(self, k, of_sign(k), right, real(signs(k), wp))
                    if (t > from .and. t < to) then
                        places = [places, t]
                        orders = [orders, self%expression%kink_order(k)]
                    end if
                end if
                signs(k) = now(k)
                of_sign(k) = right
            end do
        end subroutine compare_signs
    end subroutine find_kinks

    !> True if each argument of a kink that depends only on time keeps its sign within an interval, is monotonic there, or vanishes
    !> throughout up to rounding.
    pure logical function is_simple(self, left, right)
        class(piecewise_type), intent(in) :: self
        real(wp), intent(in) :: left, right
        !> Ratio of the width of bounds over an interval to the width at one point below which rounding errors dominate.
        real(wp), parameter :: rounding_ratio = 4.0_wp
        type(interval_type), dimension(size(self%is_timed)) :: arguments, rates, middle
        integer :: k

        call self%expression%enclose_kinks(self%time, left, right, arguments, rates, middle)
        is_simple = .true.
        do k = 1, size(self%is_timed)
            if (.not. self%is_timed(k)) cycle
            if (arguments(k)%low > 0.0_wp .or. arguments(k)%high < 0.0_wp) cycle
            if (rates(k)%low > 0.0_wp .or. rates(k)%high < 0.0_wp) cycle
            if (arguments(k)%low >= rounding_ratio*middle(k)%low .and. arguments(k)%high <= rounding_ratio*middle(k)%high) cycle
            ! The argument does not exist here.
            if (.not. arguments(k)%low <= arguments(k)%high) cycle
            is_simple = .false.
            return
        end do
    end function is_simple

    !> Signs of the arguments at a time; zero within rounding errors, and for arguments that depend on other variables.
    pure subroutine find_signs(self, t, signs)
        class(piecewise_type), intent(in) :: self
        real(wp), intent(in) :: t
        integer, intent(out) :: signs(:)
        type(interval_type), dimension(size(self%is_timed)) :: arguments, rates, middle

        call self%expression%enclose_kinks(self%time, t, t, arguments, rates, middle)
        signs = merge(1, 0, self%is_timed .and. arguments%low > 0.0_wp) - &
            merge(1, 0, self%is_timed .and. arguments%high < 0.0_wp)
    end subroutine find_signs

    !> True if parts that depend only on time take values between two times that are far from all values that a step samples, such
    !> as a pulse that is shorter than the step. Two groups of sample times are used, and each must come close to the bounds of
    !> interval arithmetic, because a step may sample such a value by chance. No check is needed while all parts are monotonic,
    !> which is examined for many steps at once.
    logical function hides(self, from, to, between, rates)
        class(piecewise_type), intent(inout) :: self
        !> Two times within the current smooth piece.
        real(wp), intent(in) :: from, to
        !> True if the step evaluates at times between its ends; true if the derivatives are checked too.
        logical, intent(in) :: between, rates
        !> Sample times of both groups in addition to the ends, as fractions of the step.
        real(wp), parameter :: sample_times(3, 2) = reshape([0.5_wp, 0.29_wp, 0.77_wp, 0.62_wp, 0.13_wp, 0.91_wp], [3, 2])
        !> Largest number of subintervals that are examined.
        integer, parameter :: most_searches = 40
        !> Values of the parts, followed by their derivatives. Fixed sizes avoid allocation in a step.
        type(interval_type), dimension(2*max_slots) :: now, at_ends, sampled, allowed
        integer :: i, j, k, m, n

        hides = .false.
        m = size(self%parts)
        if (m == 0) return
        if (is_clear(self, from, to)) return
        call examine(self, from, to - from, rates)
        if (is_clear(self, from, to)) return
        n = merge(2*m, m, rates)
        call get_values(self, from, at_ends)
        call get_values(self, to, now)
        call include(at_ends(:n), now(:n))
        allowed(:n) = widen(at_ends(:n))
        if (.not. violation(from, to) > 0.0_wp) return
        do j = 1, merge(size(sample_times, 2), 0, between)
            sampled(:n) = at_ends(:n)
            do i = 1, size(sample_times, 1)
                call get_values(self, from + sample_times(i, j)*(to - from), now)
                call include(sampled(:n), now(:n))
            end do
            do k = 1, n
                if (j == 1) allowed(k) = widen(sampled(k))
                if (j > 1) allowed(k) = intersection(allowed(k), widen(sampled(k)))
            end do
        end do
        if (violation(from, to) > 0.0_wp) call search()

    contains

        !> Largest excess of the bounds within a subinterval over the allowed range, relative to the width of this range.
        real(wp) function violation(left, right)
            real(wp), intent(in) :: left, right

            call get_bounds(self, left, right, now(:m), now(m + 1:2*m))
            violation = largest_excess()
        end function violation

        !> Largest excess of the current values or bounds over the allowed range, relative to the width of this range.
        real(wp) function largest_excess()
            real(wp) :: excess

            largest_excess = 0.0_wp
            do k = 1, n
                excess = max(allowed(k)%low - now(k)%low, now(k)%high - allowed(k)%high)
                if (excess > 0.0_wp) largest_excess = max(largest_excess, excess/(allowed(k)%high - allowed(k)%low))
            end do
        end function largest_excess

        !> Search for a value outside of the allowed range, first in subintervals with the largest excess, until bounds exclude one.
        subroutine search()
            real(wp) :: places(2, most_searches + 1), violations(2), middle, left, right
            integer :: n_places, n_halvings, first

            n_places = 1
            places(:, 1) = [from, to]
            do n_halvings = 1, most_searches
                if (n_places == 0) return
                left = places(1, n_places)
                right = places(2, n_places)
                middle = left + (right - left)/2
                n_places = n_places - 1
                if (.not. (middle > left .and. middle < right)) cycle
                ! Values that do not exist, as at a pole, are detected by the step itself.
                call get_values(self, middle, now)
                hides = largest_excess() > 0.0_wp .and. all(abs(now(:n)%low) <= huge(middle))
                if (hides) return
                violations = [violation(left, middle), violation(middle, right)]
                first = maxloc(violations, dim=1)
                if (violations(3 - first) > 0.0_wp) then
                    n_places = n_places + 1
                    places(:, n_places) = merge([left, middle], [middle, right], first == 2)
                end if
                if (violations(first) > 0.0_wp) then
                    n_places = n_places + 1
                    places(:, n_places) = merge([left, middle], [middle, right], first == 1)
                end if
            end do
        end subroutine search
    end function hides

    !> True if all parts are known to be monotonic between two times.
    pure logical function is_clear(self, from, to)
        class(piecewise_type), intent(in) :: self
        real(wp), intent(in) :: from, to

        is_clear = from >= self%monotonic_interval(1) .and. to <= self%monotonic_interval(2)
    end function is_clear

    !> Examine whether the parts are monotonic in an interval that begins at a time. Its length is doubled after success and divided
    !> by four after failure. After a failure some steps pass before the next attempt, which limits the work for functions that are
    !> never monotonic within a step.
    subroutine examine(self, from, step, rates)
        class(piecewise_type), intent(inout) :: self
        real(wp), intent(in) :: from, step
        !> True if the derivatives must be monotonic too.
        logical, intent(in) :: rates
        integer, parameter :: most_waits = 15
        real(wp), parameter :: most_steps = 1000.0_wp
        !> Fixed sizes avoid allocation in a step.
        type(interval_type), dimension(max_slots) :: values, slopes, curvatures
        logical :: is_monotonic
        integer :: m

        m = size(self%parts)
        if (self%n_left > 0) then
            self%n_left = self%n_left - 1
            return
        end if
        self%next_length = min(max(self%next_length, step), most_steps*step)
        do
            if (rates) then
                call get_bounds(self, from, from + self%next_length, values(:m), slopes(:m), curvatures(:m))
            else
                call get_bounds(self, from, from + self%next_length, values(:m), slopes(:m))
            end if
            is_monotonic = all(slopes(:m)%low >= 0.0_wp .or. slopes(:m)%high <= 0.0_wp)
            if (rates) is_monotonic = is_monotonic .and. &
                all(curvatures(:m)%low >= 0.0_wp .or. curvatures(:m)%high <= 0.0_wp)
            if (is_monotonic) then
                self%monotonic_interval = [from, from + self%next_length]
                self%next_length = 2*self%next_length
                self%n_waits = 0
                return
            end if
            if (.not. self%next_length > step) exit
            self%next_length = max(self%next_length/4, step)
        end do
        self%n_waits = min(2*self%n_waits + 1, most_waits)
        self%n_left = self%n_waits
    end subroutine examine

    !> Values at a time of the parts that depend only on time, followed by their derivatives.
    pure subroutine get_values(self, t, values)
        class(piecewise_type), intent(in) :: self
        real(wp), intent(in) :: t
        type(interval_type), intent(inout) :: values(:)
        real(wp) :: now(2*max_slots)
        integer :: m

        m = size(self%parts)
        if (self%is_selected) then
            call self%expression%evaluate_parts(self%time, self%parts, t, now(:m), now(m + 1:2*m), self%sides)
        else
            call self%expression%evaluate_parts(self%time, self%parts, t, now(:m), now(m + 1:2*m))
        end if
        values(:2*m)%low = now(:2*m)
        values(:2*m)%high = now(:2*m)
    end subroutine get_values

    !> Bounds of the parts and of their derivatives between two times.
    pure subroutine get_bounds(self, left, right, values, rates, curvatures)
        class(piecewise_type), intent(in) :: self
        real(wp), intent(in) :: left, right
        type(interval_type), intent(out) :: values(:), rates(:)
        type(interval_type), intent(out), optional :: curvatures(:)

        if (self%is_selected) then
            call self%expression%enclose_parts(self%time, self%parts, left, right, values, rates, self%sides, curvatures)
        else
            call self%expression%enclose_parts(self%time, self%parts, left, right, values, rates, curvatures=curvatures)
        end if
    end subroutine get_bounds

    !> Extend a range so that it contains another one.
    elemental subroutine include(range, other)
        type(interval_type), intent(inout) :: range
        type(interval_type), intent(in) :: other

        range = interval_type(min(range%low, other%low), max(range%high, other%high))
    end subroutine include

    !> A range that is extended by a margin on both sides.
    elemental type(interval_type) function widen(range)
        type(interval_type), intent(in) :: range
        !> Margin relative to the width of the range, relative to its magnitude, and absolute.
        real(wp), parameter :: relative_margin = 2.0_wp, rounding = 1.0e-9_wp, smallest = 1.0e-200_wp
        real(wp) :: margin

        margin = relative_margin*(range%high - range%low) + rounding*max(abs(range%low), abs(range%high)) + smallest
        widen = interval_type(range%low - margin, range%high + margin)
    end function widen

    !> Argument of a kink, and its rate, at a time.
    pure subroutine evaluate_argument(self, k, t, value, rate)
        class(piecewise_type), intent(in) :: self
        integer, intent(in) :: k
        real(wp), intent(in) :: t
        real(wp), intent(out) :: value, rate
        real(wp) :: values(size(self%is_timed)), rates(size(self%is_timed)), x(self%n_variables), v(self%n_variables)

        ! Other variables are irrelevant, because this kink depends only on time.
        x = 0.0_wp
        v = 0.0_wp
        x(self%time) = t
        v(self%time) = 1.0_wp
        call self%expression%evaluate_kinks(x, v, values, rates)
        value = values(k)
        rate = rates(k)
    end subroutine evaluate_argument

    !> Time at which the argument of a kink vanishes, between two times at which it has different signs.
    pure real(wp) function zero_between(self, k, left, right, left_value)
        class(piecewise_type), intent(in) :: self
        integer, intent(in) :: k
        real(wp), intent(in) :: left, right, left_value
        real(wp) :: low, high, value, rate, guess
        integer :: halving

        low = left
        high = right
        zero_between = (low + high)/2
        do halving = 1, n_halvings
            call evaluate_argument(self, k, zero_between, value, rate)
            if (.not. abs(value) > 0.0_wp) return
            if (value*left_value > 0.0_wp) then
                low = zero_between
            else
                high = zero_between
            end if
            ! Use Newton's step, which is exact for linear arguments, if it remains inside the bracket.
            guess = zero_between - value/rate
            if (.not. (guess > low .and. guess < high) .or. mod(halving, 4) == 0) guess = (low + high)/2
            if (.not. (guess > low .and. guess < high)) return
            zero_between = guess
        end do
    end function zero_between

    !> Select the smooth piece around a time, which is not a kink.
    pure subroutine select_piece(self, t)
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
        self%is_selected = .true.
        self%all_selected = all(self%is_timed)
        self%monotonic_interval = [huge(t), -huge(t)]
    end subroutine select_piece

    !> Sides of all kinks: the selected ones, and those that belong to the state.
    pure function current_sides(self, x) result(sides)
        class(piecewise_type), intent(in) :: self
        real(wp), intent(in) :: x(:)
        integer :: sides(size(self%is_timed))
        real(wp) :: v(size(x))

        if (self%all_selected) then
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
        !> Values of the variables.
        real(wp), intent(in) :: x(:)

        if (self%is_selected) then
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

        if (self%is_selected) then
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

        if (self%is_selected) then
            call self%expression%evaluate_along(x, v, value, first, second, self%current_sides(x))
        else
            call self%expression%evaluate_along(x, v, value, first, second)
        end if
    end subroutine evaluate_along

    !> Value, derivative along a direction, gradient, and derivative of the gradient along the direction.
    pure subroutine evaluate_gradient_along(self, x, v, value, first, gradient, gradient_along)
        class(piecewise_type), intent(in) :: self
        real(wp), intent(in) :: x(:), v(:)
        real(wp), intent(out) :: value, first, gradient(:), gradient_along(:)

        if (self%is_selected) then
            call self%expression%evaluate_gradient_along(x, v, value, first, gradient, gradient_along, self%current_sides(x))
        else
            call self%expression%evaluate_gradient_along(x, v, value, first, gradient, gradient_along)
        end if
    end subroutine evaluate_gradient_along
end module tandem_mechanism_piecewise
