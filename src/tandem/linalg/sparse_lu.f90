! SPDX-License-Identifier: MIT
!> LU factorisation of a sparse complex matrix, column by column, in time proportional to the multiplications. For set-up: the
!> arrays grow.
!>
!> The order of columns is given. The pivot is the first row in this order among the sufficiently large ones, so that the fill stays
!> close to that of an elimination without exchanges.
!>
!> Source: J. R. Gilbert, T. Peierls, Sparse partial pivoting in time proportional to arithmetic operations, SIAM J. Sci. Stat.
!> Comput. 9, 1988.
module tandem_linalg_sparse_lu
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: sparse_lu_type, sparse_matrix_type

    !> A matrix by columns: column j has the entries start(j) to start(j + 1) - 1.
    type :: sparse_matrix_type
        integer :: n = 0
        integer, allocatable :: start(:), row(:)
        complex(wp), allocatable :: value(:)
    end type sparse_matrix_type

    !> The factors of a sparse matrix.
    type :: sparse_lu_type
        integer :: n = 0
        !> Number of pivots, and the smallest of them relative to the largest entry of its column.
        integer :: rank = 0
        real(wp) :: least = huge(1.0_wp)
        !> Rows without a pivot, if columns were omitted.
        integer, allocatable :: left_rows(:)
        !> Columns of L below its unit diagonal, and of U above its diagonal.
        integer, allocatable, private :: l_start(:), l_row(:), u_start(:), u_row(:)
        complex(wp), allocatable, private :: l(:), u(:), diagonal(:)
        !> Row and column of each pivot, and the pivot of each row, 0 for none.
        integer, allocatable, private :: row_of(:), column_of(:), pivot_of(:)
    contains
        procedure :: factor, solve, solve_refined, n_entries
        procedure, private :: eliminate, store
    end type sparse_lu_type

    !> Smallest pivot relative to the largest entry.
    real(wp), parameter :: threshold = 0.1_wp
    !> A column whose entries all decrease to this part depends on the previous ones. Rounding leaves some 1e-15.
    real(wp), parameter :: dependent = 1.0e-13_wp

contains

    !> Factor a matrix.
    subroutine factor(self, a, order, most_entries, stat, may_leave, least_left)
        class(sparse_lu_type), intent(inout) :: self
        type(sparse_matrix_type), intent(in) :: a
        !> Columns in the order of their elimination (n); rows of the same numbers are preferred.
        integer, intent(in) :: order(:)
        !> Of L and U together.
        integer, intent(in) :: most_entries
        !> 0; j if column j depends on the previous ones or is not finite; -1 if there would be more entries.
        integer, intent(out) :: stat
        !> Columns that may be omitted (n) if their entries decrease to a given part.
        logical, intent(in), optional :: may_leave(:)
        real(wp), intent(in), optional :: least_left
        complex(wp), allocatable :: x(:)
        integer, allocatable :: reached(:), stack(:, :), mark(:), place(:)
        integer :: i, k, n, column, n_reached
        real(wp) :: size_of_column, bound
        logical :: leaves

        n = a%n
        self%n = n
        self%rank = 0
        self%least = huge(1.0_wp)
        call start_factor(self, n, size(a%row))
        allocate (x(n), source=(0.0_wp, 0.0_wp))
        allocate (reached(n), stack(2, n), mark(n), place(n), source=0)
        do k = 1, n
            place(order(k)) = k
        end do
        stat = 0
        do k = 1, n
            column = order(k)
            leaves = .false.
            if (present(may_leave)) leaves = may_leave(column)
            bound = dependent
            if (leaves .and. present(least_left)) bound = least_left
            size_of_column = 0.0_wp
            do i = a%start(column), a%start(column + 1) - 1
                size_of_column = max(size_of_column, abs(a%value(i)))
            end do
            call self%eliminate(a, column, x, reached, n_reached, stack, mark)
            call self%store(column, place, bound*size_of_column, size_of_column, x, reached(:n_reached), stat)
            if (stat > 0 .and. leaves) stat = 0
            if (stat /= 0) return
            if (self%l_start(self%rank + 1) + self%u_start(self%rank + 1) > most_entries) then
                stat = -1
                return
            end if
        end do
        self%left_rows = pack([(i, i=1, n)], self%pivot_of == 0)
    end subroutine factor

    !> Initialise empty factors with initial room.
    subroutine start_factor(self, n, n_start)
        class(sparse_lu_type), intent(inout) :: self
        integer, intent(in) :: n, n_start

        if (allocated(self%l)) deallocate (self%l, self%u, self%l_row, self%u_row, self%l_start, self%u_start, self%diagonal, &
            self%row_of, self%column_of, self%pivot_of)
        allocate (self%l(2*n_start + n), self%u(2*n_start + n), self%diagonal(n), source=(0.0_wp, 0.0_wp))
        allocate (self%l_row(2*n_start + n), self%u_row(2*n_start + n), source=0)
        allocate (self%row_of(n), self%column_of(n), self%pivot_of(n), source=0)
        allocate (self%l_start(n + 1), self%u_start(n + 1), source=1)
    end subroutine start_factor

    !> x := L^-1 a(:, column) at the entries that may be nonzero; these in an order in which each follows those it depends on, from
    !> the last one on.
    pure subroutine eliminate(self, a, column, x, reached, n_reached, stack, mark)
        class(sparse_lu_type), intent(in) :: self
        type(sparse_matrix_type), intent(in) :: a
        integer, intent(in) :: column
        !> Zero on entry (n).
        complex(wp), intent(inout) :: x(:)
        !> Rows, (n); work space: (2, n) and (n), equal to `column` for reached rows.
        integer, intent(inout) :: reached(:), stack(:, :), mark(:)
        integer, intent(out) :: n_reached
        integer :: depth, i, k, row, next
        logical :: is_done

        n_reached = 0
        do i = a%start(column), a%start(column + 1) - 1
            if (mark(a%row(i)) == column) cycle
            depth = 1
            stack(1, 1) = a%row(i)
            stack(2, 1) = 0
            mark(a%row(i)) = column
            do while (depth > 0)
                row = stack(1, depth)
                k = self%pivot_of(row)
                is_done = .true.
                if (k > 0) then
                    if (stack(2, depth) == 0) stack(2, depth) = self%l_start(k)
                    do while (stack(2, depth) < self%l_start(k + 1))
                        next = self%l_row(stack(2, depth))
                        stack(2, depth) = stack(2, depth) + 1
                        if (mark(next) == column) cycle
                        mark(next) = column
                        depth = depth + 1
                        stack(1, depth) = next
                        stack(2, depth) = 0
                        is_done = .false.
                        exit
                    end do
                end if
                if (.not. is_done) cycle
                n_reached = n_reached + 1
                reached(n_reached) = row
                depth = depth - 1
            end do
        end do
        do i = a%start(column), a%start(column + 1) - 1
            x(a%row(i)) = x(a%row(i)) + a%value(i)
        end do
        do i = n_reached, 1, -1
            k = self%pivot_of(reached(i))
            if (k == 0) cycle
            do next = self%l_start(k), self%l_start(k + 1) - 1
                x(self%l_row(next)) = x(self%l_row(next)) - self%l(next)*x(reached(i))
            end do
        end do
    end subroutine eliminate

    !> Choose the pivot, store the column, and clear x.
    pure subroutine store(self, column, place, least, size_of_column, x, reached, stat)
        class(sparse_lu_type), intent(inout) :: self
        integer, intent(in) :: column, place(:), reached(:)
        !> Entries of at most this size are treated as zero.
        real(wp), intent(in) :: least, size_of_column
        complex(wp), intent(inout) :: x(:)
        !> The column if it has no pivot.
        integer, intent(inout) :: stat
        real(wp) :: largest
        integer :: i, k, nl, nu, pivot, row

        largest = 0.0_wp
        pivot = 0
        do i = 1, size(reached)
            if (self%pivot_of(reached(i)) == 0) largest = max(largest, abs(x(reached(i))))
            if (.not. abs(x(reached(i))) <= huge(1.0_wp)) pivot = -1
        end do
        if (.not. largest > least .or. pivot < 0) then
            stat = column
            x(reached) = (0.0_wp, 0.0_wp)
            return
        end if
        do i = 1, size(reached)
            row = reached(i)
            if (self%pivot_of(row) > 0 .or. abs(x(row)) < threshold*largest) cycle
            if (pivot > 0) then
                if (place(row) > place(pivot)) cycle
            end if
            pivot = row
        end do
        k = self%rank + 1
        self%rank = k
        self%least = min(self%least, largest/size_of_column)
        nl = self%l_start(k) - 1
        nu = self%u_start(k) - 1
        call make_room(nl + size(reached), self%l, self%l_row)
        call make_room(nu + size(reached), self%u, self%u_row)
        do i = 1, size(reached)
            row = reached(i)
            if (self%pivot_of(row) > 0) then
                nu = nu + 1
                self%u(nu) = x(row)
                self%u_row(nu) = self%pivot_of(row)
            else if (row /= pivot .and. abs(x(row)) > 0.0_wp) then
                nl = nl + 1
                self%l(nl) = x(row)/x(pivot)
                self%l_row(nl) = row
            end if
        end do
        self%diagonal(k) = x(pivot)
        self%row_of(k) = pivot
        self%column_of(k) = column
        self%pivot_of(pivot) = k
        self%l_start(k + 1) = nl + 1
        self%u_start(k + 1) = nu + 1
        x(reached) = (0.0_wp, 0.0_wp)
    end subroutine store

    !> Enlarge two arrays to at least n entries.
    pure subroutine make_room(n, values, numbers)
        integer, intent(in) :: n
        complex(wp), allocatable, intent(inout) :: values(:)
        integer, allocatable, intent(inout) :: numbers(:)
        complex(wp), allocatable :: more_values(:)
        integer, allocatable :: more_numbers(:)

        if (n <= size(values)) return
        allocate (more_values(n + n/2), source=(0.0_wp, 0.0_wp))
        allocate (more_numbers(n + n/2), source=0)
        more_values(:size(values)) = values
        more_numbers(:size(numbers)) = numbers
        call move_alloc(more_values, values)
        call move_alloc(more_numbers, numbers)
    end subroutine make_room

    !> x := A^-1 b; zero in omitted columns; rows without a pivot are ignored.
    pure subroutine solve(self, b, x)
        class(sparse_lu_type), intent(in) :: self
        !> (n) each; b is work space.
        complex(wp), intent(inout) :: b(:)
        complex(wp), intent(out) :: x(:)
        complex(wp) :: y(self%rank)
        integer :: i, k

        do k = 1, self%rank
            y(k) = b(self%row_of(k))
            do i = self%l_start(k), self%l_start(k + 1) - 1
                b(self%l_row(i)) = b(self%l_row(i)) - self%l(i)*y(k)
            end do
        end do
        x = (0.0_wp, 0.0_wp)
        do k = self%rank, 1, -1
            y(k) = y(k)/self%diagonal(k)
            do i = self%u_start(k), self%u_start(k + 1) - 1
                y(self%u_row(i)) = y(self%u_row(i)) - self%u(i)*y(k)
            end do
            x(self%column_of(k)) = y(k)
        end do
    end subroutine solve

    !> The same with one step of refinement.
    pure subroutine solve_refined(self, a, b, x)
        class(sparse_lu_type), intent(in) :: self
        type(sparse_matrix_type), intent(in) :: a
        complex(wp), intent(inout) :: b(:)
        complex(wp), intent(out) :: x(:)
        complex(wp), dimension(size(b)) :: rest, correction
        integer :: j, k

        rest = b
        call self%solve(b, x)
        do j = 1, a%n
            do k = a%start(j), a%start(j + 1) - 1
                rest(a%row(k)) = rest(a%row(k)) - a%value(k)*x(j)
            end do
        end do
        call self%solve(rest, correction)
        x = x + correction
    end subroutine solve_refined

    !> Number of entries of L and U.
    pure integer function n_entries(self)
        class(sparse_lu_type), intent(in) :: self

        n_entries = self%l_start(self%rank + 1) + self%u_start(self%rank + 1) - 2 + self%rank
    end function n_entries
end module tandem_linalg_sparse_lu
