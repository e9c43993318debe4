! SPDX-License-Identifier: MIT
!> Saddle-point systems by sparse factors of [H/unit, C'; C, 0], with the rows of C over their lengths, in memory and time
!> proportional to the number of bodies of a chain. Coordinates and rows are eliminated body by body. Rows that depend on others are
!> left out. Entries are complex: the analysis of eigenvalues factors H = s^2 M + s D + K.
module tandem_saddle_sparse
    use tandem_kinds, only: wp
    use tandem_linalg_order, only: list_type
    use tandem_linalg_sparse_lu, only: sparse_lu_type, sparse_matrix_type
    use tandem_model_neighbours, only: order_unknowns
    use tandem_model_pattern, only: pattern_type
    use tandem_saddle, only: saddle_singular, saddle_too_large, saddle_type
    implicit none (type, external)
    private

    public :: most_factor_entries, sparse_saddle_type

    !> Largest number of entries of factors: 2 GB.
    integer, parameter :: most_factor_entries = 80000000
    !> A row depends on others if its pivot falls to this part of its initial value: an angle of 1e-5, as in the sparse chart.
    real(wp), parameter :: least_pivot = 1.0e-10_wp

    !> A saddle-point system with sparse factors.
    type, extends(saddle_type) :: sparse_saddle_type
        !> Divisor of H; 1 over the length of each row (m).
        real(wp) :: unit = 1.0_wp
        real(wp), allocatable :: weight(:)
        !> Unknown of each row in the matrix, 0 for one that takes no part (m).
        integer, allocatable :: number(:)
        type(sparse_matrix_type) :: matrix
        type(sparse_lu_type) :: lu
        !> Order of elimination of coordinates and rows (n + m), and of the unknowns of the matrix.
        integer, allocatable, private :: all_unknowns(:), order(:)
        !> True to factor the transposed matrix.
        logical :: is_transposed = .false.
    contains
        procedure :: analyse, load, load_complex, load_rows, factor, solve, solve_complex, independence
        procedure, private :: remove_rows
    end type sparse_saddle_type

contains

    !> Choose the order of elimination.
    subroutine analyse(self, pattern, scale)
        class(sparse_saddle_type), intent(inout) :: self
        type(pattern_type), intent(in), target :: pattern
        real(wp), intent(in) :: scale(:)
        type(list_type), allocatable :: neighbours(:)

        call self%attach(pattern, scale, neighbours)
        call order_unknowns(pattern, neighbours, self%all_unknowns)
    end subroutine analyse

    !> Set a real matrix.
    subroutine load(self, h, c)
        class(sparse_saddle_type), intent(inout) :: self
        real(wp), intent(in) :: h(:), c(:, :)

        call self%load_complex(cmplx(h, 0.0_wp, wp), c)
    end subroutine load

    !> Set a matrix whose rows at the bottom may differ from the columns of C'.
    subroutine load_complex(self, h, c, more, factor_of_more)
        class(sparse_saddle_type), intent(inout) :: self
        !> Entries of H in the order of `columns`.
        complex(wp), intent(in) :: h(:)
        !> C (m, width).
        real(wp), intent(in) :: c(:, :)
        !> Added to the rows at the bottom, with a factor (m, width); both or neither.
        real(wp), intent(in), optional :: more(:, :)
        complex(wp), intent(in), optional :: factor_of_more
        complex(wp) :: block(size(h)), value
        integer, allocatable :: next(:)
        integer :: i, j, k, n, pass
        real(wp) :: length

        self%number = spread(0, 1, self%m)
        self%weight = spread(1.0_wp, 1, self%m)
        n = self%n
        associate (pattern => self%pattern, a => self%matrix)
            do i = 1, self%m
                if (self%is_out(i)) cycle
                n = n + 1
                self%number(i) = n
                length = 0.0_wp
                do k = pattern%row_start(i), pattern%row_start(i + 1) - 1
                    do j = pattern%first(pattern%row_body(k)), pattern%first(pattern%row_body(k) + 1) - 1
                        length = length + c(i, pattern%column(j))**2
                    end do
                end do
                if (length > 0.0_wp) self%weight(i) = 1/sqrt(length)
            end do
            self%order = [self%all_unknowns]
            do k = 1, size(self%order)
                if (self%order(k) > self%n) self%order(k) = self%number(self%order(k) - self%n)
            end do
            self%order = pack(self%order, self%order > 0)
            self%unit = maxval([0.0_wp, size_of(h)])
            if (.not. self%unit > 0.0_wp) self%unit = 1.0_wp
            block = h/self%unit
            allocate (next(n + 1), source=0)
            a%n = n
            do pass = 1, 2
                do j = 1, self%n
                    do k = self%columns%start(j), self%columns%start(j + 1) - 1
                        if (size_of(block(k)) > 0.0_wp) call put(self%columns%row(k), j, block(k))
                    end do
                end do
                do i = 1, self%m
                    if (self%number(i) == 0) cycle
                    do k = pattern%row_start(i), pattern%row_start(i + 1) - 1
                        do j = pattern%first(pattern%row_body(k)), pattern%first(pattern%row_body(k) + 1) - 1
                            value = c(i, pattern%column(j))*self%weight(i)
                            if (size_of(value) > 0.0_wp) call put(j, self%number(i), value)
                            if (present(more)) value = value + factor_of_more*more(i, pattern%column(j))*self%weight(i)
                            if (size_of(value) > 0.0_wp) call put(self%number(i), j, value)
                        end do
                    end do
                end do
                if (pass == 2) exit
                a%start = spread(1, 1, n + 1)
                do j = 1, n
                    a%start(j + 1) = a%start(j) + next(j)
                end do
                next = a%start
                a%row = spread(0, 1, a%start(n + 1) - 1)
                a%value = spread((0.0_wp, 0.0_wp), 1, a%start(n + 1) - 1)
            end do
        end associate

    contains

        !> A measure of size without a square root.
        elemental real(wp) function size_of(number)
            complex(wp), intent(in) :: number

            size_of = abs(real(number, wp)) + abs(aimag(number))
        end function size_of

        subroutine put(row, column, entry)
            integer, intent(in) :: row, column
            complex(wp), intent(in) :: entry
            integer :: into

            into = merge(row, column, self%is_transposed)
            if (pass == 2) then
                self%matrix%row(next(into)) = merge(column, row, self%is_transposed)
                self%matrix%value(next(into)) = entry
            end if
            next(into) = next(into) + 1
        end subroutine put
    end subroutine load_complex

    !> Set H = I and the first rows of C; the others take no part.
    subroutine load_rows(self, rows, is_full)
        class(sparse_saddle_type), intent(inout) :: self
        !> Full (any, n), or compressed (any, width).
        real(wp), intent(in) :: rows(:, :)
        logical, intent(in) :: is_full
        real(wp) :: h(size(self%columns%row)), c(size(rows, 1), self%pattern%width)
        integer :: i, j, k

        self%is_out = [(i > size(rows, 1), i=1, self%m)]
        h = 0.0_wp
        call self%columns%add_diagonal(spread(1.0_wp, 1, self%n), h)
        if (.not. is_full) then
            call self%load(h, rows)
            return
        end if
        c = 0.0_wp
        associate (pattern => self%pattern)
            do i = 1, size(rows, 1)
                do k = pattern%row_start(i), pattern%row_start(i + 1) - 1
                    do j = pattern%first(pattern%row_body(k)), pattern%first(pattern%row_body(k) + 1) - 1
                        c(i, pattern%column(j)) = rows(i, j)
                    end do
                end do
            end do
        end associate
        call self%load(h, c)
    end subroutine load_rows

    !> Factor the matrix, and leave out rows that depend on others.
    subroutine factor(self, stat)
        class(sparse_saddle_type), intent(inout) :: self
        integer, intent(out) :: stat
        logical :: may_leave(self%matrix%n)
        integer :: i

        may_leave = .false.
        may_leave(self%n + 1:) = self%drops_dependent
        call self%lu%factor(self%matrix, self%order, most_factor_entries, stat, may_leave, least_pivot)
        if (stat == 0) then
            if (size(self%lu%left_rows) == 0) return
            stat = saddle_singular
            if (any(self%lu%left_rows <= self%n)) return
            do i = 1, self%m
                if (any(self%lu%left_rows == self%number(i))) self%is_out(i) = .true.
            end do
            call self%remove_rows()
            call self%lu%factor(self%matrix, self%order, most_factor_entries, stat)
        end if
        if (stat > 0) stat = saddle_singular
        if (stat < 0) stat = saddle_too_large
    end subroutine factor

    !> Remove rows that take no part from the loaded matrix.
    subroutine remove_rows(self)
        class(sparse_saddle_type), intent(inout) :: self
        type(sparse_matrix_type) :: a
        integer :: new(self%matrix%n), i, j, k, n

        new = [(i, i=1, self%matrix%n)]
        n = self%n
        do i = 1, self%m
            if (self%number(i) == 0) cycle
            if (self%is_out(i)) then
                new(self%number(i)) = 0
                self%number(i) = 0
            else
                n = n + 1
                new(self%number(i)) = n
                self%number(i) = n
            end if
        end do
        self%order = pack(new(self%order), new(self%order) > 0)
        a%n = n
        a%start = [(1, i=1, n + 1)]
        a%row = self%matrix%row
        a%value = self%matrix%value
        n = 0
        do j = 1, self%matrix%n
            if (new(j) == 0) cycle
            do k = self%matrix%start(j), self%matrix%start(j + 1) - 1
                if (new(self%matrix%row(k)) == 0) cycle
                n = n + 1
                a%row(n) = new(self%matrix%row(k))
                a%value(n) = self%matrix%value(k)
            end do
            a%start(new(j) + 1) = n + 1
        end do
        self%matrix%n = a%n
        self%matrix%start = a%start
        self%matrix%row = a%row(:n)
        self%matrix%value = a%value(:n)
    end subroutine remove_rows

    !> Solve, with one step of refinement.
    subroutine solve(self, f, g, x, lambda)
        class(sparse_saddle_type), intent(in) :: self
        real(wp), intent(in) :: f(:), g(:)
        real(wp), intent(out) :: x(:), lambda(:)
        complex(wp) :: complex_x(self%n), complex_lambda(self%m)

        call self%solve_complex(cmplx(f, 0.0_wp, wp), cmplx(g, 0.0_wp, wp), complex_x, complex_lambda)
        x = real(complex_x, wp)
        lambda = real(complex_lambda, wp)
    end subroutine solve

    !> The same with complex right-hand sides.
    pure subroutine solve_complex(self, f, g, x, lambda)
        class(sparse_saddle_type), intent(in) :: self
        !> (n), (m).
        complex(wp), intent(in) :: f(:), g(:)
        complex(wp), intent(out) :: x(:), lambda(:)
        complex(wp), dimension(self%matrix%n) :: b, y
        integer :: i

        b(:self%n) = f/self%unit
        do i = 1, self%m
            if (self%number(i) > 0) b(self%number(i)) = g(i)*self%weight(i)
        end do
        call self%lu%solve_refined(self%matrix, b, y)
        x = y(:self%n)
        do i = 1, self%m
            lambda(i) = (0.0_wp, 0.0_wp)
            if (self%number(i) > 0) lambda(i) = self%unit*self%weight(i)*y(self%number(i))
        end do
    end subroutine solve_complex

    !> Smallest pivot over the largest entry of its column.
    pure real(wp) function independence(self)
        class(sparse_saddle_type), intent(in) :: self

        independence = self%lu%least
    end function independence
end module tandem_saddle_sparse
