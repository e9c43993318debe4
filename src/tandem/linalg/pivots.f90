! SPDX-License-Identifier: MIT
!> Loops of `tandem_linalg_elimination`, columns padded to `height`. A separate module, because gfortran stops inlining in files
!> with too many copies of loops for given lengths.
module tandem_linalg_pivots
    use tandem_kinds, only: lane, short, wp
    implicit none (type, external)
    private

    public :: divide_rows, load, take_all, take_pivot

    !> Largest number of pivots that are faster one by one than in pairs: measured on a vehicle with 5 and a disk with 6 rows.
    integer, parameter :: most_single = 5

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

    !> Eliminate with all stored pivots. stat > 0: they are not usable, because one of them is small in its row or an entry of Y is
    !> large. An entry that is not finite makes a pivot or an entry of Y not finite, and fails too.
    pure subroutine take_all(m, n, height, matrix, mask, order, scale, pivot_scale, row_size, unit, copy, a, column, work, &
        pivots, stat)
        integer, intent(in) :: m, n, height, order(n)
        !> C; 1 for rows and 0 for padding; scales of the unknowns and of the pivot columns, largest scaled entries of rows, unit
        !> matrix.
        real(wp), intent(in) :: matrix(m*n), mask(height), scale(n), pivot_scale(height), row_size(height), unit(height, height)
        !> C padded, [Cd^-1, Y], work space, pivots.
        real(wp), intent(inout) :: copy(height, n), a(height, n), column(height), work(height), pivots(height)
        integer, intent(out) :: stat

        ! The same loops for the most frequent length, which is a constant for the compiler.
        if (height == lane) then
            if (m > most_single) then
                call load(m, n, lane, matrix, mask, order, copy, a)
                call take_pairs(m, n, unit, a, column, work, pivots, stat)
                if (stat == 0) call divide_rows(n, lane, pivots, a, column)
            else if (m > 1) then
                call take_ahead(m, n, matrix, mask, order, unit, copy, a, column, work, pivots, stat)
            else
                call load(m, n, lane, matrix, mask, order, copy, a)
                call take_singly(m, n, lane, unit, a, column, pivots, stat)
                if (stat == 0) call divide_rows(n, lane, pivots, a, column)
            end if
            if (stat == 0) call judge(m, n, lane, order, scale, pivot_scale, row_size, a, pivots, column, stat)
        else
            call load(m, n, height, matrix, mask, order, copy, a)
            call take_singly(m, n, height, unit, a, column, pivots, stat)
            if (stat == 0) call divide_rows(n, height, pivots, a, column)
            if (stat == 0) call judge(m, n, height, order, scale, pivot_scale, row_size, a, pivots, column, stat)
        end if
    end subroutine take_all

    !> Check the pivots and Y: a row with an entry above its limit gives more than 1.
    pure subroutine judge(m, n, height, order, scale, pivot_scale, row_size, a, pivots, column, stat)
        integer, intent(in) :: m, n, order(n)
        integer, intent(in), value :: height
        real(wp), intent(in) :: scale(n), pivot_scale(height), row_size(height), a(height, n), pivots(height)
        real(wp), intent(inout) :: column(height)
        integer, intent(inout) :: stat
        !> A stored pivot below this part of the largest entry of its row is replaced by a search: it would amplify rounding.
        real(wp), parameter :: smallest_pivot = 0.05_wp
        !> Largest allowed |Y| of stored pivots.
        real(wp), parameter :: largest_growth = 10.0_wp
        real(wp) :: f, sums(short)
        integer :: b, i, j

        do b = 0, height - short, short
            !GCC$ UNROLL 1
            do i = 1, short
                column(b + i) = merge(0.0_wp, 2.0_wp, abs(pivots(b + i))*pivot_scale(b + i) >= smallest_pivot*row_size(b + i))
            end do
        end do
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
        if ((sums(1) + sums(2)) + (sums(3) + sums(4)) > 1.0_wp) stat = maxloc(column, dim=1)
    end subroutine judge

    !> Eliminate the pivots one by one.
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
    pure subroutine take_ahead(m, n, matrix, mask, order, unit, copy, a, column, inverses, pivots, stat)
        !> At least two rows.
        integer, intent(in) :: m, n, order(n)
        real(wp), intent(in) :: matrix(m, n), mask(lane), unit(lane, lane)
        !> Work space: multipliers of the pivot's row for each column; 1 over the pivots, and 1 in the padding.
        real(wp), intent(inout) :: copy(lane, n), a(lane, n), column(lane), inverses(lane), pivots(lane)
        integer, intent(out) :: stat
        real(wp) :: f, inverse, pivot
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
            column(i) = (f*(1.0_wp - unit(i, 1)))*inverse
            a(i, 1) = unit(i, 1) - column(i)
            inverses(i) = (1.0_wp - mask(i)) + unit(i, 1)*inverse
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
                    column(b + i) = (a(b + i, k)*(1.0_wp - unit(b + i, k)))*inverse
                    a(b + i, k) = unit(b + i, k) - column(b + i)
                    inverses(b + i) = inverses(b + i) + unit(b + i, k)*inverse
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
                column(b + i) = (a(b + i, m)*(1.0_wp - unit(b + i, m)))*inverse
                inverses(b + i) = inverses(b + i) + unit(b + i, m)*inverse
                a(b + i, m) = (unit(b + i, m) - column(b + i))*inverses(b + i)
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

    !> Eliminate the pivots in pairs, in one pass through the other columns.
    pure subroutine take_pairs(m, n, unit, a, column, second, pivots, stat)
        integer, intent(in) :: m, n
        real(wp), intent(in) :: unit(lane, lane)
        real(wp), intent(inout) :: a(lane, n), column(lane), second(lane), pivots(lane)
        integer, intent(out) :: stat
        real(wp) :: inverse, next, pivot
        integer :: k

        stat = 0
        do k = 1, m - 1, 2
            pivot = a(k, k)
            pivots(k) = pivot
            if (.not. is_pivot(pivot)) then
                stat = k
                return
            end if
            inverse = 1.0_wp/pivot
            ! The next pivot is computed before the columns are updated, so that the division by it need not wait for them.
            next = a(k + 1, k + 1) - a(k + 1, k)*inverse*a(k, k + 1)
            pivots(k + 1) = next
            if (.not. is_pivot(next)) then
                stat = k + 1
                return
            end if
            call take_pair(k, n, inverse, 1.0_wp/next, unit, a, column, second)
        end do
        if (iand(m, 1) == 1) then
            pivot = a(m, m)
            pivots(m) = pivot
            if (.not. is_pivot(pivot)) then
                stat = m
                return
            end if
            call take_last(m, n, 1.0_wp/pivot, unit, a, column)
        end if
    end subroutine take_pairs

    !> `take_pivot` for the last pivot of an odd number.
    pure subroutine take_last(m, n, inverse, unit, a, column)
        integer, intent(in) :: m, n
        real(wp), intent(in), value :: inverse
        real(wp), intent(in) :: unit(lane, lane)
        real(wp), intent(inout) :: a(lane, n), column(lane)
        real(wp) :: f
        integer :: b, i, j

        do b = 0, lane - short, short
            !GCC$ UNROLL 1
            do i = 1, short
                column(b + i) = a(b + i, m)*(inverse - inverse*unit(b + i, m))
            end do
        end do
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do j = 1, n
            f = a(m, j)
            do b = 0, lane - short, short
                !GCC$ UNROLL 1
                do i = 1, short
                    a(b + i, j) = a(b + i, j) - column(b + i)*f
                end do
            end do
        end do
        do b = 0, lane - short, short
            !GCC$ UNROLL 1
            do i = 1, short
                a(b + i, m) = unit(b + i, m) - column(b + i)
            end do
        end do
    end subroutine take_last

    !> True if a number is a valid divisor.
    pure logical function is_pivot(x)
        real(wp), intent(in), value :: x

        is_pivot = abs(x) > tiny(1.0_wp) .and. abs(x) <= huge(1.0_wp)
    end function is_pivot

    !> `take_pivot` for k and then for k + 1, in one pass through the other columns.
    pure subroutine take_pair(k, n, inverse, next_inverse, unit, a, column, second)
        integer, intent(in) :: k, n
        !> 1 over the two pivots, unit matrix.
        real(wp), intent(in), value :: inverse, next_inverse
        real(wp), intent(in) :: unit(lane, lane)
        real(wp), intent(inout) :: a(lane, n)
        !> Work space: multipliers of rows k and k + 1 for each column.
        real(wp), intent(inout) :: column(lane), second(lane)
        real(wp) :: below, f, g
        integer :: b, i, j

        below = a(k + 1, k)*inverse
        f = a(k, k + 1)
        do b = 0, lane - short, short
            !GCC$ UNROLL 1
            do i = 1, short
                column(b + i) = a(b + i, k)*(inverse - inverse*unit(b + i, k))
                second(b + i) = (a(b + i, k + 1) - column(b + i)*f)*(next_inverse - next_inverse*unit(b + i, k + 1))
                a(b + i, k) = (unit(b + i, k) - column(b + i)) + second(b + i)*below
                a(b + i, k + 1) = unit(b + i, k + 1) - second(b + i)
            end do
        end do
        ! The columns of the next pivots first, because they are needed first.
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do j = k + 2, n
            f = a(k, j)
            g = a(k + 1, j) - below*f
            do b = 0, lane - short, short
                !GCC$ UNROLL 1
                do i = 1, short
                    a(b + i, j) = (a(b + i, j) - column(b + i)*f) - second(b + i)*g
                end do
            end do
        end do
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do j = 1, k - 1
            f = a(k, j)
            g = a(k + 1, j) - below*f
            do b = 0, lane - short, short
                !GCC$ UNROLL 1
                do i = 1, short
                    a(b + i, j) = (a(b + i, j) - column(b + i)*f) - second(b + i)*g
                end do
            end do
        end do
    end subroutine take_pair

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
