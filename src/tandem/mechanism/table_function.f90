! SPDX-License-Identifier: MIT
!> Functions given by a table: piecewise linear, or a cubic spline. Provides two derivatives and a list of kinks.
module tandem_mechanism_table_function
    use tandem_error, only: error_type, set_error, to_text
    use tandem_kinds, only: wp
    use tandem_status, only: status_invalid_model
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)
    private

    public :: table_type, table_kinds, table_ends

    !> Kinds of interpolation.
    character(len=*), parameter :: table_kinds(2) = ['linear', 'cubic ']
    !> Kinds of extrapolation: constant, linear with the slope at the end, or periodic.
    character(len=*), parameter :: table_ends(3) = ['hold  ', 'extend', 'repeat']

    !> Relative difference below which values are equal up to rounding.
    real(wp), parameter :: rounding = 1.0e-10_wp

    !> A table. Piece i extends from point i to point i + 1; piece 0 lies before the first point, and piece n after the last. Copies
    !> of a repeated table continue this numbering, with n - 1 pieces per copy.
    type :: table_type
        private
        !> Number of points.
        integer :: n = 0
        logical :: is_cubic = .false., is_repeated = .false.
        !> Pieces 0 to n: start, and coefficients of the powers 0 to 3 of the distance from the start.
        real(wp), allocatable :: x(:), c(:, :)
        !> Lowest derivative that jumps at each point; -1 if none does.
        integer, allocatable :: orders(:)
    contains
        procedure :: initialize, piece_at, evaluate, find_kinks, search_length
        procedure, private :: point_before
    end type table_type

contains

    !> Construct a table from points.
    subroutine initialize(self, x, y, kind, error, ends)
        class(table_type), intent(out) :: self
        !> Points with increasing x.
        real(wp), intent(in) :: x(:), y(:)
        !> One of `table_kinds`.
        character(len=*), intent(in) :: kind
        type(error_type), allocatable, intent(out) :: error
        !> One of `table_ends`. By default a linear table is extended by constants and a cubic one linearly, which gives no kinks. A
        !> cubic table that is extended by constants has zero slopes at its ends.
        character(len=*), intent(in), optional :: ends
        character(len=len(table_ends)) :: beyond
        real(wp), allocatable :: values(:), m(:), h(:)
        real(wp) :: last
        integer :: i, n

        n = size(x)
        self%n = n
        self%is_cubic = kind == 'cubic'
        beyond = merge('extend', 'hold  ', self%is_cubic)
        if (present(ends)) beyond = ends
        self%is_repeated = beyond == 'repeat'
        call check_points(x, y, kind, beyond, error)
        if (allocated(error)) return
        values = y
        h = x(2:) - x(:n - 1)
        if (self%is_cubic .and. self%is_repeated) then
            if (abs(y(n) - y(1)) > rounding*maxval(abs(y))) then
                call set_error(error, status_invalid_model, 'a repeated cubic table ends with '//to_text(y(n))// &
                    ' and begins with '//to_text(y(1)), 'make its first and last value equal')
                return
            end if
            values(n) = y(1)
        end if
        allocate (m(n), source=0.0_wp)
        if (self%is_cubic) call solve_spline(h, values, beyond, m)
        allocate (self%x(0:n), self%c(0:3, 0:n), source=0.0_wp)
        self%x(0) = x(1)
        self%x(1:) = x
        self%c(0, 0) = values(1)
        self%c(0, 1:) = values
        do i = 1, n - 1
            self%c(1, i) = (values(i + 1) - values(i))/h(i) - h(i)*(2.0_wp*m(i) + m(i + 1))/6.0_wp
            self%c(2, i) = m(i)/2.0_wp
            self%c(3, i) = (m(i + 1) - m(i))/(6.0_wp*h(i))
        end do
        if (beyond == 'extend') then
            last = h(n - 1)
            self%c(1, 0) = self%c(1, 1)
            self%c(1, n) = self%c(1, n - 1) + last*(2.0_wp*self%c(2, n - 1) + 3.0_wp*last*self%c(3, n - 1))
        end if
        self%orders = kink_orders(self, minval(h))
        if (all(ieee_is_finite(self%c))) return
        call set_error(error, status_invalid_model, 'a table changes too fast for finite derivatives', &
            'choose points farther apart')
    end subroutine initialize

    !> Refuse invalid points.
    subroutine check_points(x, y, kind, beyond, error)
        real(wp), intent(in) :: x(:), y(:)
        character(len=*), intent(in) :: kind, beyond
        type(error_type), allocatable, intent(out) :: error
        integer :: i

        if (.not. any(kind == table_kinds)) then
            call set_error(error, status_invalid_model, 'there is no table of kind "'//trim(kind)//'"', 'choose linear or cubic')
        else if (.not. any(beyond == table_ends)) then
            call set_error(error, status_invalid_model, 'there are no ends "'//trim(beyond)//'" of a table', &
                'choose hold, extend or repeat')
        else if (size(x) /= size(y)) then
            call set_error(error, status_invalid_model, 'a table has '//to_text(size(x))//' arguments and '//to_text(size(y))// &
                ' values', 'give equal numbers of both')
        else if (size(x) < 2) then
            call set_error(error, status_invalid_model, 'a table has '//to_text(size(x))//' points', 'give two or more')
        else if (.not. (all(ieee_is_finite(x)) .and. all(ieee_is_finite(y)))) then
            call set_error(error, status_invalid_model, 'a table has a point that is not finite', 'correct it')
        else
            do i = 2, size(x)
                if (x(i) > x(i - 1)) cycle
                call set_error(error, status_invalid_model, 'argument '//to_text(i)//' of a table, '//to_text(x(i))// &
                    ', is not greater than the previous one, '//to_text(x(i - 1)), 'make arguments ascend')
                return
            end do
        end if
    end subroutine check_points

    !> Second derivatives of a cubic spline at its points. Conditions at the ends: zero second derivative, zero slope, or
    !> periodicity.
    pure subroutine solve_spline(h, y, beyond, m)
        !> Lengths of the pieces; values at the points.
        real(wp), intent(in) :: h(:), y(:)
        character(len=*), intent(in) :: beyond
        real(wp), intent(out) :: m(:)
        !> Diagonal; right-hand side; correction for the corner entries of a periodic system.
        real(wp) :: diagonal(size(y)), z(size(y)), slope(size(h))
        real(wp) :: gamma, corner
        integer :: n

        n = size(y)
        slope = (y(2:) - y(:n - 1))/h
        diagonal(2:n - 1) = 2.0_wp*(h(:n - 2) + h(2:))
        m(2:n - 1) = 6.0_wp*(slope(2:) - slope(:n - 2))
        select case (beyond)
        case ('repeat')
            ! Points 1 and n coincide. The corner entries of the cyclic matrix are treated as a correction of rank one.
            corner = h(n - 1)
            diagonal(1) = 2.0_wp*(h(1) + corner)
            m(1) = 6.0_wp*(slope(1) - slope(n - 1))
            if (n > 2) then
                gamma = -diagonal(1)
                diagonal(1) = diagonal(1) - gamma
                diagonal(n - 1) = diagonal(n - 1) - corner**2/gamma
                z = 0.0_wp
                z(1) = gamma
                z(n - 1) = corner
                call solve_tridiagonal(diagonal(:n - 1), h(:n - 2), m(:n - 1))
                call solve_tridiagonal(diagonal(:n - 1), h(:n - 2), z(:n - 1))
                m(:n - 1) = m(:n - 1) - z(:n - 1)*(m(1) + corner/gamma*m(n - 1))/(1.0_wp + z(1) + corner/gamma*z(n - 1))
            end if
            m(n) = m(1)
        case ('hold')
            diagonal(1) = 2.0_wp*h(1)
            diagonal(n) = 2.0_wp*h(n - 1)
            m(1) = 6.0_wp*slope(1)
            m(n) = -6.0_wp*slope(n - 1)
            call solve_tridiagonal(diagonal, h, m)
        case default
            m(1) = 0.0_wp
            m(n) = 0.0_wp
            call solve_tridiagonal(diagonal(2:n - 1), h(2:n - 2), m(2:n - 1))
        end select
    end subroutine solve_spline

    !> Solve a symmetric tridiagonal system that is diagonally dominant, so that no pivoting is required.
    pure subroutine solve_tridiagonal(diagonal, off_diagonal, b)
        real(wp), intent(in) :: diagonal(:), off_diagonal(:)
        !> Right-hand side on entry, solution on return.
        real(wp), intent(inout) :: b(:)
        real(wp) :: d(size(b)), factor
        integer :: i

        d = diagonal
        do i = 2, size(b)
            factor = off_diagonal(i - 1)/d(i - 1)
            d(i) = d(i) - factor*off_diagonal(i - 1)
            b(i) = b(i) - factor*b(i - 1)
        end do
        do i = size(b), 1, -1
            if (i < size(b)) b(i) = b(i) - off_diagonal(i)*b(i + 1)
            b(i) = b(i)/d(i)
        end do
    end subroutine solve_tridiagonal

    !> Index of the last point at or before t; 0 if there is none.
    pure integer function point_before(self, t) result(low)
        class(table_type), intent(in) :: self
        real(wp), intent(in) :: t
        integer :: high, middle

        low = 0
        high = self%n + 1
        do while (high - low > 1)
            middle = (low + high)/2
            if (t >= self%x(middle)) then
                low = middle
            else
                high = middle
            end if
        end do
    end function point_before

    !> Piece that contains t; a point belongs to the piece that follows it. For a repeated table, call `find_kinks` first, which
    !> checks t.
    pure integer function piece_at(self, t) result(piece)
        class(table_type), intent(in) :: self
        real(wp), intent(in) :: t
        real(wp) :: period
        integer :: copy

        if (self%is_repeated) then
            period = self%x(self%n) - self%x(1)
            copy = floor((t - self%x(1))/period)
            piece = copy*(self%n - 1) + self%point_before(t - copy*period)
        else
            piece = self%point_before(t)
        end if
    end function piece_at

    !> Value and two derivatives.
    pure subroutine evaluate(self, t, value, first, second, piece)
        class(table_type), intent(in) :: self
        real(wp), intent(in) :: t
        real(wp), intent(out) :: value, first, second
        !> Piece to evaluate, also beyond its ends; by default the piece that contains t.
        integer, intent(in), optional :: piece
        real(wp) :: s, period
        integer :: i

        s = t
        if (.not. self%is_repeated) then
            if (present(piece)) then
                i = piece
            else
                i = self%point_before(t)
            end if
        else
            period = self%x(self%n) - self%x(1)
            if (present(piece)) then
                i = modulo(piece - 1, self%n - 1) + 1
                s = t - (piece - i)/(self%n - 1)*period
            else
                s = self%x(1) + modulo(t - self%x(1), period)
                i = max(1, min(self%n - 1, self%point_before(s)))
            end if
        end if
        s = s - self%x(i)
        associate (c => self%c(:, i))
            value = c(1) + s*(c(2) + s*(c(3) + s*c(4)))
            first = c(2) + s*(2.0_wp*c(3) + 3.0_wp*s*c(4))
            second = 2.0_wp*c(3) + 6.0_wp*s*c(4)
        end associate
    end subroutine evaluate

    !> Longest interval for one search for kinks, which contains several thousand points of a repeated table.
    pure real(wp) function search_length(self) result(length)
        class(table_type), intent(in) :: self
        integer, parameter :: many = 1000

        length = huge(length)
        if (self%is_repeated) length = (1 + many/self%n)*(self%x(self%n) - self%x(1))
    end function search_length

    !> Kinks within an interval in increasing order, with the lowest derivative that jumps at each; 0 is the value.
    subroutine find_kinks(self, from, to, places, orders, error)
        class(table_type), intent(in) :: self
        !> Interval, excluding its ends.
        real(wp), intent(in) :: from, to
        real(wp), allocatable, intent(out) :: places(:)
        integer, allocatable, intent(out) :: orders(:)
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: period, place
        integer :: copy, i, n, first, last, pass
        integer, parameter :: most = 100000

        period = self%x(self%n) - self%x(1)
        first = 0
        last = 0
        allocate (places(0), orders(0))
        if (.not. to > from) return
        if (self%is_repeated) then
            if ((to - from)/period*self%n > most .or. max(abs(from), abs(to))/period > huge(1)/(2*self%n)) then
                call set_error(error, status_invalid_model, 'a repeated table has more than '//to_text(most)// &
                    ' kinks within the time of the run', 'choose a longer table or a shorter run')
                return
            end if
            first = floor((from - self%x(1))/period)
            last = floor((to - self%x(1))/period)
        end if
        do pass = 1, 2
            n = 0
            do copy = first, last
                ! The last point of a copy is the first point of the next one.
                do i = 1, merge(self%n - 1, self%n, self%is_repeated)
                    place = self%x(i) + copy*period
                    if (place <= from .or. place >= to .or. self%orders(i) < 0) cycle
                    n = n + 1
                    if (pass == 1) cycle
                    places(n) = place
                    orders(n) = self%orders(i)
                end do
            end do
            if (pass == 2) exit
            deallocate (places, orders)
            allocate (places(n), orders(n))
        end do
    end subroutine find_kinks

    !> Lowest derivative that jumps at each point: the first one that differs between adjacent pieces by more than rounding.
    pure function kink_orders(self, narrowest) result(orders)
        type(table_type), intent(in) :: self
        !> Length of the shortest piece.
        real(wp), intent(in) :: narrowest
        integer :: orders(self%n)
        real(wp) :: before(0:3), tolerance(0:3), h
        integer :: i, k, left

        ! Coefficients are differences of values divided by powers of lengths.
        do k = 0, 3
            tolerance(k) = rounding*maxval(abs(self%c(k, :))) + 100.0_wp*epsilon(h)*maxval(abs(self%c(0, :)))/narrowest**k
        end do
        do i = 1, self%n
            left = i - 1
            if (self%is_repeated .and. i == 1) left = self%n - 1
            h = 0.0_wp
            if (left > 0) h = self%x(left + 1) - self%x(left)
            associate (c => self%c(:, left))
                before = [c(1) + h*(c(2) + h*(c(3) + h*c(4))), c(2) + h*(2.0_wp*c(3) + 3.0_wp*h*c(4)), c(3) + 3.0_wp*h*c(4), c(4)]
            end associate
            do k = 0, 3
                if (abs(before(k) - self%c(k, i)) > tolerance(k)) exit
            end do
            orders(i) = merge(k, -1, k <= 3)
        end do
    end function kink_orders
end module tandem_mechanism_table_function
