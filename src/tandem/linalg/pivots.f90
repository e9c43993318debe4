! SPDX-License-Identifier: MIT
!> Loops of `tandem_linalg_elimination`, columns padded to `height`. A separate module, because gfortran stops inlining in files
!> with too many copies of loops for given lengths.
module tandem_linalg_pivots
    use tandem_kinds, only: lane, short, wp
    implicit none (type, external)
    private

    public :: check_growth, check_pivots, divide_rows, load, take_ahead, take_pivot, take_singly

    !> The identity matrix.
    real(wp), parameter :: unit_matrix(lane, lane) = reshape(spread([1.0_wp, spread(0.0_wp, 1, lane)], 2, lane), [lane, lane])

contains

    !> Copy C twice, unchanged and in the order of elimination.
    pure subroutine load(m, n, height, matrix, mask, order, copy, a)
        integer, intent(in) :: m, n, order(n)
        integer, intent(in), value :: height
        real(wp), intent(in) :: matrix(m*n), mask(height)
        real(wp), intent(inout) :: copy(height, n), a(height, n)
        integer :: j, p

        ! Without rows there is no first row.
        if (height == 0) return
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do j = 1, n
            p = order(j)
            call load_column(m, height, mask, matrix((p - 1)*m + 1), copy(1, p), a(1, j))
        end do
    end subroutine load

    !> Copy a column, with zeros where the mask is zero.
    pure subroutine load_column(m, height, mask, x, copy, a)
        integer, intent(in) :: m
        integer, intent(in), value :: height
        real(wp), intent(in) :: mask(height), x(m)
        real(wp), intent(inout) :: copy(height), a(height)
        real(wp) :: f
        integer :: i

        !GCC$ IVDEP
        !GCC$ UNROLL 1
        do i = 1, height
            f = 0.0_wp
            if (mask(i) > 0.0_wp) f = x(i)
            copy(i) = f
            a(i) = f
        end do
    end subroutine load_column

    !> Mark rows with a small pivot by 2 in `column`, others by 0.
    pure subroutine check_pivots(height, row_size, pivot_scale, pivots, column)
        integer, intent(in), value :: height
        !> Largest scaled entries of rows, scales of the pivot columns.
        real(wp), intent(in) :: row_size(height), pivot_scale(height), pivots(height)
        real(wp), intent(inout) :: column(height)
        !> A stored pivot below this part of the largest entry of its row is replaced by a search: it would amplify rounding.
        real(wp), parameter :: smallest_pivot = 0.05_wp
        integer :: b, i

        do b = 0, height - short, short
            !GCC$ UNROLL 1
            do i = 1, short
                column(b + i) = merge(0.0_wp, 2.0_wp, abs(pivots(b + i))*pivot_scale(b + i) >= smallest_pivot*row_size(b + i))
            end do
        end do
    end subroutine check_pivots

    !> Mark rows with a large entry of Y too. stat > 0: a row is marked.
    pure subroutine check_growth(m, n, height, order, scale, pivot_scale, a, column, stat)
        integer, intent(in) :: m, n, order(n)
        integer, intent(in), value :: height
        !> Scales of the unknowns.
        real(wp), intent(in) :: scale(n), pivot_scale(height), a(height, n)
        real(wp), intent(inout) :: column(height)
        integer, intent(out) :: stat
        !> Largest allowed |Y| of stored pivots.
        real(wp), parameter :: largest_growth = 10.0_wp
        real(wp) :: f, sums(short)
        integer :: b, i, j

        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do j = m + 1, n
            f = scale(order(j))/largest_growth
            do b = 0, height - short, short
                !GCC$ UNROLL 1
                do i = 1, short
                    column(b + i) = merge(column(b + i), 2.0_wp, abs(a(b + i, j))*f <= pivot_scale(b + i))
                end do
            end do
        end do
        do i = 1, short
            sums(i) = 0.0_wp
        end do
        do b = 0, height - short, short
            !GCC$ UNROLL 1
            do i = 1, short
                sums(i) = sums(i) + column(b + i)
            end do
        end do
        stat = 0
        if ((sums(1) + sums(2)) + (sums(3) + sums(4)) > 1.0_wp) stat = maxloc(column, dim=1)
    end subroutine check_growth

    !> Eliminate the pivots one by one. stat > 0: the pivot of this row is not usable.
    pure subroutine take_singly(m, n, height, unit, a, column, pivots, stat)
        integer, intent(in) :: m, n
        integer, intent(in), value :: height
        real(wp), intent(in) :: unit(height, height)
        real(wp), intent(inout) :: a(height, n), column(height), pivots(height)
        integer, intent(out) :: stat
        integer :: k

        stat = 0
        do k = 1, m
            pivots(k) = a(k, k)
            if (.not. is_pivot(pivots(k))) then
                stat = k
                return
            end if
            call take_pivot(k, n, height, 1.0_wp/pivots(k), unit, a, column)
        end do
    end subroutine take_singly

    !> Eliminate the pivots of few rows one by one, in a pass through the columns for each: the first while C is copied, the last
    !> while rows are divided by their pivots. A pivot is known before its column, so that the division by it need not wait for the
    !> previous pass. Rounding is that of `load`, `take_pivot` and `divide_rows`.
    pure subroutine take_ahead(m, n, matrix, mask, order, copy, a, pivots, stat)
        !> At least two rows.
        integer, intent(in) :: m, n, order(n)
        !> C; 1 for rows and 0 for padding.
        real(wp), intent(in) :: matrix(m, n), mask(lane)
        !> C padded, [Cd^-1, Y], pivots.
        real(wp), intent(inout) :: copy(lane, n), a(lane, n), pivots(lane)
        !> > 0: the pivot of this row is not usable.
        integer, intent(out) :: stat
        !> Multipliers of the pivot's row for each column; 1 over the pivots, and 1 in the padding.
        real(wp) :: column(lane), inverses(lane), f, inverse, pivot
        integer :: b, i, j, k, p

        stat = 1
        p = order(1)
        pivot = matrix(1, p)
        pivots(1) = pivot
        if (.not. is_pivot(pivot)) then
            ! A search for pivots needs the copy too.
            call load(m, n, lane, matrix, mask, order, copy, a)
            return
        end if
        inverse = 1.0_wp/pivot
        pivot = matrix(2, order(2)) - matrix(2, p)*inverse*matrix(1, order(2))
        !GCC$ IVDEP
        !GCC$ UNROLL 1
        do i = 1, lane
            f = 0.0_wp
            if (mask(i) > 0.0_wp) f = matrix(i, p)
            copy(i, p) = f
            column(i) = (f*(1.0_wp - unit_matrix(i, 1)))*inverse
            a(i, 1) = unit_matrix(i, 1) - column(i)
            inverses(i) = (1.0_wp - mask(i)) + unit_matrix(i, 1)*inverse
        end do
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do j = 2, n
            p = order(j)
            call load_less(m, mask, matrix(1, p), column, copy(1, p), a(1, j))
        end do
        do k = 2, m - 1
            stat = k
            pivots(k) = pivot
            if (.not. is_pivot(pivot)) return
            inverse = 1.0_wp/pivot
            pivot = a(k + 1, k + 1) - a(k + 1, k)*inverse*a(k, k + 1)
            do b = 0, lane - short, short
                !GCC$ UNROLL 1
                do i = 1, short
                    column(b + i) = (a(b + i, k)*(1.0_wp - unit_matrix(b + i, k)))*inverse
                    a(b + i, k) = unit_matrix(b + i, k) - column(b + i)
                    inverses(b + i) = inverses(b + i) + unit_matrix(b + i, k)*inverse
                end do
            end do
            ! The columns of the next pivots first, because they are needed first.
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do j = k + 1, n
                call subtract(a(k, j), column, a(1, j))
            end do
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do j = 1, k - 1
                call subtract(a(k, j), column, a(1, j))
            end do
        end do
        stat = m
        pivots(m) = pivot
        if (.not. is_pivot(pivot)) return
        inverse = 1.0_wp/pivot
        do b = 0, lane - short, short
            !GCC$ UNROLL 1
            do i = 1, short
                column(b + i) = (a(b + i, m)*(1.0_wp - unit_matrix(b + i, m)))*inverse
                inverses(b + i) = inverses(b + i) + unit_matrix(b + i, m)*inverse
                a(b + i, m) = (unit_matrix(b + i, m) - column(b + i))*inverses(b + i)
            end do
        end do
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do j = m + 1, n
            call subtract_and_divide(a(m, j), column, inverses, a(1, j))
        end do
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do j = 1, m - 1
            call subtract_and_divide(a(m, j), column, inverses, a(1, j))
        end do
        stat = 0
    end subroutine take_ahead

    !> Copy a column of C, with zeros where the mask is zero; and the same minus f times another column, f its first entry. In two
    !> loops, which gfortran fuses: around a single one it would take two columns at once, entry by entry.
    pure subroutine load_less(m, mask, x, column, copy, a)
        integer, intent(in) :: m
        real(wp), intent(in) :: mask(lane), x(m), column(lane)
        real(wp), intent(inout) :: copy(lane), a(lane)
        real(wp) :: f, first
        integer :: i

        first = x(1)
        !GCC$ IVDEP
        !GCC$ UNROLL 1
        do i = 1, lane
            f = 0.0_wp
            if (mask(i) > 0.0_wp) f = x(i)
            copy(i) = f
            a(i) = f
        end do
        !GCC$ IVDEP
        !GCC$ UNROLL 1
        do i = 1, lane
            a(i) = a(i) - column(i)*first
        end do
    end subroutine load_less

    !> Subtract f times another column.
    pure subroutine subtract(f, column, a)
        real(wp), intent(in), value :: f
        real(wp), intent(in) :: column(lane)
        real(wp), intent(inout) :: a(lane)
        integer :: b, i

        do b = 0, lane - short, short
            !GCC$ UNROLL 1
            do i = 1, short
                a(b + i) = a(b + i) - column(b + i)*f
            end do
        end do
    end subroutine subtract

    !> The same, and divide each row by its pivot.
    pure subroutine subtract_and_divide(f, column, inverses, a)
        real(wp), intent(in), value :: f
        real(wp), intent(in) :: column(lane), inverses(lane)
        real(wp), intent(inout) :: a(lane)
        integer :: b, i

        do b = 0, lane - short, short
            !GCC$ UNROLL 1
            do i = 1, short
                a(b + i) = (a(b + i) - column(b + i)*f)*inverses(b + i)
            end do
        end do
    end subroutine subtract_and_divide

    !> True if a number is a valid divisor.
    pure logical function is_pivot(x)
        real(wp), intent(in), value :: x

        is_pivot = abs(x) > tiny(1.0_wp) .and. abs(x) <= huge(1.0_wp)
    end function is_pivot

    !> Eliminate with the pivot a(k, k): subtract multiples of column k that make the other rows zero there, and store the column of
    !> the inverse in its place. Row k itself is divided by its pivot later, see `divide_rows`: each entry then takes one fused
    !> multiplication and subtraction, whose rounding is relative to the result, not to the cancelling terms; and whole columns are
    !> written, because a load of data stored in parts would wait for the store.
    pure subroutine take_pivot(k, n, height, inverse, unit, a, column)
        integer, intent(in) :: k, n
        integer, intent(in), value :: height
        !> 1/a(k, k), unit matrix.
        real(wp), intent(in) :: inverse, unit(height, height)
        real(wp), intent(inout) :: a(height, n)
        !> Work space: multiplier of row k for each column.
        real(wp), intent(inout) :: column(height)
        real(wp) :: f
        integer :: b, i, j

        do b = 0, height - short, short
            !GCC$ UNROLL 1
            do i = 1, short
                column(b + i) = a(b + i, k)*(inverse - inverse*unit(b + i, k))
                a(b + i, k) = unit(b + i, k) - column(b + i)
            end do
        end do
        ! The columns of the next pivots first, because they are needed first.
        !GCC$ NOVECTOR
        !GCC$ UNROLL 3
        do j = k + 1, n
            f = a(k, j)
            do b = 0, height - short, short
                !GCC$ UNROLL 1
                do i = 1, short
                    a(b + i, j) = a(b + i, j) - column(b + i)*f
                end do
            end do
        end do
        !GCC$ NOVECTOR
        !GCC$ UNROLL 3
        do j = 1, k - 1
            f = a(k, j)
            do b = 0, height - short, short
                !GCC$ UNROLL 1
                do i = 1, short
                    a(b + i, j) = a(b + i, j) - column(b + i)*f
                end do
            end do
        end do
    end subroutine take_pivot

    !> Divide each row by its pivot; 1 in the padding.
    pure subroutine divide_rows(n, height, pivots, a, inverse)
        integer, intent(in) :: n
        integer, intent(in), value :: height
        real(wp), intent(in) :: pivots(height)
        real(wp), intent(inout) :: a(height, n)
        !> Work space.
        real(wp), intent(inout) :: inverse(height)
        integer :: b, i, j

        do b = 0, height - short, short
            !GCC$ UNROLL 1
            do i = 1, short
                inverse(b + i) = 1.0_wp/pivots(b + i)
            end do
        end do
        !GCC$ NOVECTOR
        !GCC$ UNROLL 3
        do j = 1, n
            do b = 0, height - short, short
                !GCC$ UNROLL 1
                do i = 1, short
                    a(b + i, j) = a(b + i, j)*inverse(b + i)
                end do
            end do
        end do
    end subroutine divide_rows
end module tandem_linalg_pivots
