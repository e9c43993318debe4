! SPDX-License-Identifier: MIT
!> Rows of constraints whose entries stand where a pattern says: which of them depend on others, solutions of least norm, and
!> projections into their null space, by the sparse factors of [I, A'; A, 0].
module tandem_model_sparse_rows
    use tandem_kinds, only: wp
    use tandem_linalg_order, only: list_type
    use tandem_linalg_sparse_lu, only: sparse_lu_type, sparse_matrix_type
    use tandem_model_neighbours, only: find_neighbours, order_unknowns
    use tandem_model_pattern, only: pattern_type
    implicit none (type, external)
    private

    public :: sparse_rows_type

    type :: sparse_rows_type
        !> Numbers of coordinates, and of rows that are used and independent.
        integer :: n = 0, rank = 0
        !> Rows of the pattern that depend on others (n_rows); they take no part.
        logical, allocatable :: is_out(:)
        !> The smallest squared distance of a row, in units of its length, from those before it in the order of elimination.
        real(wp) :: least = 1.0_wp
        integer, allocatable, private :: order(:)
        !> The unknown of each row, 0 for one that takes no part (n_rows), and 1 over its length.
        integer, allocatable, private :: number(:)
        real(wp), allocatable, private :: weight(:)
        type(sparse_matrix_type), private :: matrix
        type(sparse_lu_type), private :: lu
    contains
        procedure :: initialize, factor, solve, solve_transposed, project
        procedure, private :: assemble, solve_both
    end type sparse_rows_type

    !> The most entries of factors: 2 GB.
    integer, parameter :: most_factor_entries = 80000000
    !> A row whose pivot falls to this part of what it was depends on others: an angle of 1e-5, as the sparse chart has it.
    real(wp), parameter :: least_pivot = 1.0e-10_wp

contains

    !> Choose the order of elimination.
    subroutine initialize(self, pattern)
        class(sparse_rows_type), intent(inout) :: self
        type(pattern_type), intent(in) :: pattern
        type(list_type), allocatable :: neighbours(:)

        self%n = size(pattern%column)
        call find_neighbours(pattern, neighbours)
        call order_unknowns(pattern, neighbours, self%order)
    end subroutine initialize

    !> Factor rows, each over its length.
    subroutine factor(self, pattern, matrix, column, scale, n_used, stat)
        class(sparse_rows_type), intent(inout) :: self
        !> That of `initialize`.
        type(pattern_type), intent(in) :: pattern
        !> Entry (i, j) of A is matrix(i, column(j)) scale(j).
        real(wp), intent(in) :: matrix(:, :), scale(:)
        integer, intent(in) :: column(:)
        !> So many of the first rows take part.
        integer, intent(in) :: n_used
        !> 0; other values where the factors would fill more than the memory allowed for them.
        integer, intent(out) :: stat
        logical :: may_leave(self%n + pattern%n_rows)
        integer, allocatable :: order(:)
        integer :: i, k

        self%is_out = spread(.false., 1, pattern%n_rows)
        self%rank = n_used
        call self%assemble(pattern, matrix, column, scale, n_used, order)
        may_leave = [(i > self%n, i=1, size(may_leave))]
        call self%lu%factor(self%matrix, order, most_factor_entries, stat, may_leave(:self%matrix%n), least_pivot)
        self%least = self%lu%least
        if (stat /= 0) return
        if (size(self%lu%left_rows) == 0) return
        do i = 1, n_used
            do k = 1, size(self%lu%left_rows)
                if (self%number(i) == self%lu%left_rows(k)) self%is_out(i) = .true.
            end do
        end do
        self%rank = n_used - count(self%is_out)
        call self%assemble(pattern, matrix, column, scale, n_used, order)
        call self%lu%factor(self%matrix, order, most_factor_entries, stat)
    end subroutine factor

    !> [I, A'; A, 0] of the rows that take part.
    subroutine assemble(self, pattern, matrix, column, scale, n_used, order)
        class(sparse_rows_type), intent(inout) :: self
        type(pattern_type), intent(in) :: pattern
        real(wp), intent(in) :: matrix(:, :), scale(:)
        integer, intent(in) :: column(:), n_used
        !> Of the unknowns.
        integer, allocatable, intent(out) :: order(:)
        integer, allocatable :: next(:)
        integer :: i, j, k, n, pass
        real(wp) :: length, value

        self%number = spread(0, 1, pattern%n_rows)
        self%weight = spread(1.0_wp, 1, pattern%n_rows)
        n = self%n
        do i = 1, n_used
            if (self%is_out(i)) cycle
            n = n + 1
            self%number(i) = n
            length = 0.0_wp
            do k = pattern%row_start(i), pattern%row_start(i + 1) - 1
                do j = pattern%first(pattern%row_body(k)), pattern%first(pattern%row_body(k) + 1) - 1
                    length = length + (matrix(i, column(j))*scale(j))**2
                end do
            end do
            if (length > 0.0_wp) self%weight(i) = 1/sqrt(length)
        end do
        order = pack(self%order, [(is_used(self%order(k)), k=1, size(self%order))])
        do k = 1, size(order)
            if (order(k) > self%n) order(k) = self%number(order(k) - self%n)
        end do
        allocate (next(n + 1), source=0)
        self%matrix%n = n
        do pass = 1, 2
            do j = 1, self%n
                call put(j, j, 1.0_wp)
            end do
            do i = 1, n_used
                if (self%number(i) == 0) cycle
                do k = pattern%row_start(i), pattern%row_start(i + 1) - 1
                    do j = pattern%first(pattern%row_body(k)), pattern%first(pattern%row_body(k) + 1) - 1
                        value = self%weight(i)*matrix(i, column(j))*scale(j)
                        if (.not. abs(value) > 0.0_wp) cycle
                        call put(j, self%number(i), value)
                        call put(self%number(i), j, value)
                    end do
                end do
            end do
            if (pass == 2) exit
            self%matrix%start = spread(1, 1, n + 1)
            do j = 1, n
                self%matrix%start(j + 1) = self%matrix%start(j) + next(j)
            end do
            next = self%matrix%start
            self%matrix%row = spread(0, 1, self%matrix%start(n + 1) - 1)
            self%matrix%value = spread((0.0_wp, 0.0_wp), 1, self%matrix%start(n + 1) - 1)
        end do

    contains

        pure logical function is_used(unknown)
            integer, intent(in) :: unknown

            is_used = unknown <= self%n
            if (.not. is_used) is_used = self%number(unknown - self%n) > 0
        end function is_used

        subroutine put(row, into, entry)
            integer, intent(in) :: row, into
            real(wp), intent(in) :: entry

            if (pass == 2) then
                self%matrix%row(next(into)) = row
                self%matrix%value(next(into)) = cmplx(entry, 0.0_wp, wp)
            end if
            next(into) = next(into) + 1
        end subroutine put
    end subroutine assemble

    !> The x (n) of least norm with A x = b, rows that take no part left aside.
    subroutine solve(self, b, x)
        class(sparse_rows_type), intent(in) :: self
        !> One value for each row that is used, at least.
        real(wp), intent(in) :: b(:)
        real(wp), intent(out) :: x(:)
        real(wp) :: unused(size(b)), none(size(x))

        none = 0.0_wp
        call self%solve_both(none, b, x, unused)
    end subroutine solve

    !> The y that minimises |A'y - g|, zero in rows that take no part.
    subroutine solve_transposed(self, g, y)
        class(sparse_rows_type), intent(in) :: self
        real(wp), intent(in) :: g(:)
        real(wp), intent(out) :: y(:)
        real(wp) :: unused(size(g)), none(size(y))

        none = 0.0_wp
        call self%solve_both(g, none, unused, y)
    end subroutine solve_transposed

    !> Take off x (n) its part in the row space.
    subroutine project(self, x)
        class(sparse_rows_type), intent(in) :: self
        real(wp), intent(inout) :: x(:)
        real(wp) :: none(size(self%number)), unused(size(self%number)), rest(size(x))

        none = 0.0_wp
        call self%solve_both(x, none, rest, unused)
        x = rest
    end subroutine project

    !> [I, A'; A, 0] (x; y) = (f; g).
    subroutine solve_both(self, f, g, x, y)
        class(sparse_rows_type), intent(in) :: self
        real(wp), intent(in) :: f(:), g(:)
        real(wp), intent(out) :: x(:), y(:)
        complex(wp), dimension(self%matrix%n) :: b, z
        integer :: i

        b(:self%n) = f
        do i = 1, size(g)
            if (self%number(i) > 0) b(self%number(i)) = self%weight(i)*g(i)
        end do
        call self%lu%solve_refined(self%matrix, b, z)
        x = real(z(:self%n), wp)
        do i = 1, size(y)
            y(i) = 0.0_wp
            if (self%number(i) > 0) y(i) = self%weight(i)*real(z(self%number(i)), wp)
        end do
    end subroutine solve_both
end module tandem_model_sparse_rows
