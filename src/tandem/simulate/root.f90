! SPDX-License-Identifier: MIT
!> Zeros and minima of functions of one variable, by reverse communication: the caller evaluates the function at the points that are
!> returned here.
!>
!> Zeros: regula falsi with Illinois weights, and a bisection whenever two steps have not halved the bracket, so that the number of
!> points is bounded. Minima: parabolas through the best three points, and golden section steps if these make no progress.
!> Sources: M. Dowell, P. Jarratt, BIT 11 (1971) 168-174; R. P. Brent, Algorithms for Minimization Without Derivatives,
!> Prentice-Hall 1973, chapter 5.
module tandem_simulate_root
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: bracket_type, minimum_type, sign_of, vertex, zeros_type

    !> Bracket of a sign change between a and b.
    type :: bracket_type
        !> Ends, and the values there, which have opposite signs.
        real(wp) :: a = 0.0_wp, b = 0.0_wp, value_a = 0.0_wp, value_b = 0.0_wp
        real(wp), private :: weight_a = 1.0_wp, weight_b = 1.0_wp, last_width = huge(1.0_wp)
        integer, private :: slow = 0, last_end = 0
    contains
        procedure :: next_point => next_secant, narrow => narrow_bracket
    end type bracket_type

    !> Interval from a to b that contains a minimum, and the best point so far.
    type :: minimum_type
        !> Ends of the interval.
        real(wp) :: a = 0.0_wp, b = 0.0_wp
        !> The best point and its value.
        real(wp) :: x = 0.0_wp, value = huge(1.0_wp)
        !> Minimum of the parabola through the best three points; huge if there is none.
        real(wp) :: expected = huge(1.0_wp)
        !> Number of points evaluated so far.
        integer :: n_points = 0
        real(wp), private :: second = 0.0_wp, value_second = huge(1.0_wp), third = 0.0_wp, value_third = huge(1.0_wp)
        real(wp), private :: move = 0.0_wp, move_before = 0.0_wp
    contains
        procedure :: begin, next_point => next_of_minimum, narrow => narrow_minimum, width
    end type minimum_type

    !> Zeros found in a step, in the order of their positions.
    type :: zeros_type
        !> Number of zeros, at most the allocated size.
        integer :: n = 0
        !> Positions in the step, indices of the functions, and directions (+1 rising, -1 falling, 0 neither).
        real(wp), allocatable :: position(:)
        integer, allocatable :: number(:), direction(:)
    contains
        procedure :: allocate => allocate_zeros, add
    end type zeros_type

    !> Golden section; position tolerance of a minimum, below which rounding errors dominate.
    real(wp), parameter :: golden = 0.381966011250105_wp, finest = 1.0e-9_wp

contains

    !> Sign of a value: -1, 0 or 1.
    pure integer function sign_of(value, smallest)
        real(wp), intent(in) :: value
        !> Largest absolute value that counts as zero.
        real(wp), intent(in) :: smallest

        sign_of = merge(0, merge(1, -1, value > 0.0_wp), abs(value) <= smallest)
    end function sign_of

    !> Next point of evaluation.
    real(wp) function next_secant(self)
        class(bracket_type), intent(inout) :: self
        real(wp) :: width, value_a, value_b

        width = self%b - self%a
        self%slow = merge(self%slow + 1, 0, width > 0.5_wp*self%last_width)
        self%last_width = width
        next_secant = self%a + 0.5_wp*width
        if (self%slow > 1) then
            self%slow = 0
            return
        end if
        value_a = self%weight_a*self%value_a
        value_b = self%weight_b*self%value_b
        ! Bisect if values are infinite or equal.
        if (.not. abs(value_b - value_a) > 0.0_wp .or. .not. abs(value_b - value_a) <= huge(1.0_wp)) return
        next_secant = self%a - width*(value_a/(value_b - value_a))
        ! Keep the point away from the ends, where the bracket would not shrink.
        next_secant = min(max(next_secant, self%a + 1.0e-3_wp*width), self%b - 1.0e-3_wp*width)
    end function next_secant

    !> Narrow the bracket by a point between its ends.
    subroutine narrow_bracket(self, x, value)
        class(bracket_type), intent(inout) :: self
        !> The point and its value.
        real(wp), intent(in) :: x, value

        ! Halve the value at an end that is retained twice.
        if ((value > 0.0_wp) .eqv. (self%value_b > 0.0_wp)) then
            self%b = x
            self%value_b = value
            self%weight_b = 1.0_wp
            if (self%last_end == 2) self%weight_a = 0.5_wp*self%weight_a
            self%last_end = 2
        else
            self%a = x
            self%value_a = value
            self%weight_a = 1.0_wp
            if (self%last_end == 1) self%weight_b = 0.5_wp*self%weight_b
            self%last_end = 1
        end if
    end subroutine narrow_bracket

    !> Begin with an interval and a first point in it. The caller passes its value to `narrow`.
    subroutine begin(self, a, b)
        class(minimum_type), intent(out) :: self
        !> Ends of the interval.
        real(wp), intent(in) :: a, b

        self%a = a
        self%b = b
        self%x = a
        self%second = a
        self%third = a
    end subroutine begin

    !> Next point of evaluation (Brent, section 5.8).
    real(wp) function next_of_minimum(self)
        class(minimum_type), intent(inout) :: self
        real(wp) :: middle, r, q, p, move, s1, s2, bend

        self%expected = huge(1.0_wp)
        middle = 0.5_wp*(self%a + self%b)
        if (self%n_points > 2 .and. abs(self%move_before) > finest) then
            r = (self%x - self%second)*(self%value - self%value_third)
            q = (self%x - self%third)*(self%value - self%value_second)
            p = (self%x - self%third)*q - (self%x - self%second)*r
            q = 2*(q - r)
            if (q > 0.0_wp) p = -p
            q = abs(q)
            if (abs(p) < abs(0.5_wp*q*self%move_before) .and. p > q*(self%a - self%x) .and. p < q*(self%b - self%x)) then
                move = p/q
                self%move_before = self%move
                self%move = move
                s1 = (self%value_second - self%value)/(self%second - self%x)
                s2 = (self%value_third - self%value)/(self%third - self%x)
                bend = (s2 - s1)/(self%third - self%second)
                self%expected = self%value + move*(s1 + bend*(move - (self%second - self%x)))
                next_of_minimum = self%x + move
                ! Avoid the ends of the interval and repeated points.
                if (next_of_minimum - self%a < 2*finest .or. self%b - next_of_minimum < 2*finest) then
                    self%move = sign(finest, middle - self%x)
                end if
                if (abs(self%move) < finest) self%move = sign(finest, self%move)
                next_of_minimum = self%x + self%move
                return
            end if
        end if
        self%move_before = merge(self%b - self%x, self%a - self%x, self%x < middle)
        self%move = golden*self%move_before
        if (abs(self%move) < finest) self%move = sign(finest, self%move)
        next_of_minimum = self%x + self%move
    end function next_of_minimum

    !> Narrow the interval by a point between its ends.
    subroutine narrow_minimum(self, x, value)
        class(minimum_type), intent(inout) :: self
        !> The point and its value.
        real(wp), intent(in) :: x, value

        self%n_points = self%n_points + 1
        if (self%n_points == 1) then
            self%x = x
            self%value = value
        else if (value <= self%value) then
            if (x < self%x) self%b = self%x
            if (x > self%x) self%a = self%x
            self%third = self%second
            self%value_third = self%value_second
            self%second = self%x
            self%value_second = self%value
            self%x = x
            self%value = value
        else
            if (x < self%x) self%a = x
            if (x > self%x) self%b = x
            if (value <= self%value_second) then
                self%third = self%second
                self%value_third = self%value_second
                self%second = x
                self%value_second = value
            else if (value <= self%value_third) then
                self%third = x
                self%value_third = value
            end if
        end if
    end subroutine narrow_minimum

    !> Largest distance of the minimum from the best point.
    pure real(wp) function width(self)
        class(minimum_type), intent(in) :: self

        width = max(self%x - self%a, self%b - self%x)
    end function width

    !> Extremum of the parabola through three points and its position, which may lie outside of them; the middle point if all three
    !> lie on a line.
    pure subroutine vertex(x, value, position, extreme)
        !> Three increasing positions and the values there.
        real(wp), intent(in) :: x(3), value(3)
        real(wp), intent(out) :: position, extreme
        real(wp) :: slope1, slope2, bend

        position = x(2)
        extreme = value(2)
        slope1 = (value(2) - value(1))/(x(2) - x(1))
        slope2 = (value(3) - value(2))/(x(3) - x(2))
        bend = (slope2 - slope1)/(x(3) - x(1))
        if (.not. abs(bend) > 0.0_wp) return
        position = 0.5_wp*(x(1) + x(2)) - 0.5_wp*slope1/bend
        extreme = value(1) + (position - x(1))*(slope1 + bend*(position - x(2)))
    end subroutine vertex

    !> Allocate for a number of zeros.
    subroutine allocate_zeros(self, most)
        class(zeros_type), intent(inout) :: self
        integer, intent(in) :: most

        self%position = spread(0.0_wp, 1, most)
        self%number = spread(0, 1, most)
        self%direction = self%number
        self%n = 0
    end subroutine allocate_zeros

    !> Insert a zero in the order of positions. It is omitted if the list is full.
    pure subroutine add(self, number, position, direction)
        class(zeros_type), intent(inout) :: self
        integer, intent(in) :: number, direction
        real(wp), intent(in) :: position
        integer :: k

        if (self%n == size(self%position)) return
        k = self%n
        do while (k > 0)
            if (self%position(k) <= position) exit
            self%position(k + 1) = self%position(k)
            self%number(k + 1) = self%number(k)
            self%direction(k + 1) = self%direction(k)
            k = k - 1
        end do
        self%position(k + 1) = position
        self%number(k + 1) = number
        self%direction(k + 1) = direction
        self%n = self%n + 1
    end subroutine add
end module tandem_simulate_root
