! SPDX-License-Identifier: MIT
!> Zeros and extrema of a function of one variable that is given point by point: the caller evaluates, these say where.
!>
!> Zeros: regula falsi with the Illinois weights, with a bisection wherever the bracket has not halved in two steps, so that the
!> number of points is bounded. Extrema: golden sections. Sources: M. Dowell, P. Jarratt, BIT 11 (1971) 168-174; R. P. Brent,
!> Algorithms for Minimization Without Derivatives, Prentice-Hall 1973.
module tandem_simulate_root
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: bracket_type, extremum_type, vertex

    !> A sign change between a and b.
    type :: bracket_type
        !> Ends and values there, of opposite signs.
        real(wp) :: a = 0.0_wp, b = 0.0_wp, value_a = 0.0_wp, value_b = 0.0_wp
        real(wp), private :: weight_a = 1.0_wp, weight_b = 1.0_wp, last_width = huge(1.0_wp)
        integer, private :: slow = 0, last_end = 0
    contains
        procedure :: next_point
        procedure :: narrow
    end type bracket_type

    !> An extremum of |value| between a and b, with a point c between them where |value| is smaller than at both.
    type :: extremum_type
        real(wp) :: a = 0.0_wp, b = 0.0_wp, c = 0.0_wp, value_c = 0.0_wp
    contains
        procedure :: next_point => next_section
        procedure :: narrow => narrow_section
    end type extremum_type

contains

    !> Where to evaluate next.
    real(wp) function next_point(self)
        class(bracket_type), intent(inout) :: self
        real(wp) :: width, value_a, value_b

        width = self%b - self%a
        self%slow = merge(self%slow + 1, 0, width > 0.5_wp*self%last_width)
        self%last_width = width
        next_point = 0.5_wp*(self%a + self%b)
        if (self%slow > 1) return
        value_a = self%weight_a*self%value_a
        value_b = self%weight_b*self%value_b
        next_point = self%a - width*value_a/(value_b - value_a)
        ! At an end the bracket would not narrow.
        next_point = min(max(next_point, self%a + 1.0e-3_wp*width), self%b - 1.0e-3_wp*width)
    end function next_point

    !> Narrow the bracket by a point between its ends.
    subroutine narrow(self, x, value)
        class(bracket_type), intent(inout) :: self
        real(wp), intent(in) :: x, value

        ! An end that stays twice pulls with half its value.
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
    end subroutine narrow

    !> A point in the longer part.
    pure real(wp) function next_section(self)
        class(extremum_type), intent(in) :: self
        real(wp), parameter :: section = 0.381966011250105_wp

        if (self%c - self%a > self%b - self%c) then
            next_section = self%c - section*(self%c - self%a)
        else
            next_section = self%c + section*(self%b - self%c)
        end if
    end function next_section

    !> Keep the three points around the smaller value.
    subroutine narrow_section(self, x, value)
        class(extremum_type), intent(inout) :: self
        real(wp), intent(in) :: x, value

        if (abs(value) < abs(self%value_c)) then
            if (x < self%c) self%b = self%c
            if (x > self%c) self%a = self%c
            self%c = x
            self%value_c = value
        else
            if (x < self%c) self%a = x
            if (x > self%c) self%b = x
        end if
    end subroutine narrow_section

    !> The extremum of the parabola through three points, and its place; the middle point where there is none between the outer two.
    pure subroutine vertex(x, value, place, extreme)
        !> Three ascending places and the values there.
        real(wp), intent(in) :: x(3), value(3)
        real(wp), intent(out) :: place, extreme
        real(wp) :: slope1, slope2, bend

        place = x(2)
        extreme = value(2)
        slope1 = (value(2) - value(1))/(x(2) - x(1))
        slope2 = (value(3) - value(2))/(x(3) - x(2))
        bend = (slope2 - slope1)/(x(3) - x(1))
        if (.not. abs(bend) > 0.0_wp) return
        place = 0.5_wp*(x(1) + x(2)) - 0.5_wp*slope1/bend
        if (place <= x(1) .or. place >= x(3)) then
            place = x(2)
            return
        end if
        extreme = value(1) + (place - x(1))*(slope1 + bend*(place - x(2)))
    end subroutine vertex
end module tandem_simulate_root
