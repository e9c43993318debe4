! SPDX-License-Identifier: MIT
!> Independence of the rows of C, from its elimination. A separate module, because gfortran stops inlining in files with too many
!> copies of loops for given lengths; the padding is that of `tandem_linalg_null_space_kernels`.
module tandem_linalg_independence
    use tandem_kinds, only: lane, short, wp
    use tandem_linalg_elimination, only: elimination_type
    implicit none (type, external)
    private

    public :: find_independence, independence_work_type

    !> Work space: D'D (width, k), D' of the pivot columns (width, m), pivots (k), vectors (height) and (width).
    type :: independence_work_type
        real(wp), allocatable :: gram(:, :), part(:, :), inverse(:), r(:), column(:)
    end type independence_work_type

contains

    !> 1/|C+|, where C+ = R - D (D'D)^-1 D'R is the inverse of least norm: |C+|^2 = |R|^2 - |L^-1 D'R|^2 with D'D = L L'. Rows of
    !> unit length, scaled unknowns. 0 if D'D is singular.
    pure subroutine find_independence(elimination, k, width, square, inverse_square, basis, work, independence)
        !> Of C (m, n).
        type(elimination_type), intent(in) :: elimination
        !> Degrees of freedom, and padded length.
        integer, intent(in) :: k, width
        !> diag(s)^2 and its inverse, D'.
        real(wp), intent(in) :: square(elimination%n), inverse_square(elimination%n), basis(width, elimination%n)
        type(independence_work_type), intent(inout) :: work
        real(wp), intent(out) :: independence

        if (elimination%height == lane .and. width == short) then
            call find_padded(elimination, k, lane, short, square, inverse_square, basis, work, independence)
        else
            call find_padded(elimination, k, elimination%height, width, square, inverse_square, basis, work, independence)
        end if
    end subroutine find_independence

    !> The same; the padded lengths are constants for the most frequent ones.
    pure subroutine find_padded(elimination, k, height, width, square, inverse_square, basis, work, independence)
        type(elimination_type), intent(in) :: elimination
        integer, intent(in) :: k
        integer, intent(in), value :: height, width
        real(wp), intent(in) :: square(elimination%n), inverse_square(elimination%n), basis(width, elimination%n)
        type(independence_work_type), intent(inout) :: work
        real(wp), intent(out) :: independence
        real(wp) :: sums(lane), total
        integer :: b, i, stat

        independence = 0.0_wp
        associate (e => elimination, m => elimination%m, n => elimination%n, r => work%r)
            ! Squared lengths of the rows, and |R|^2, summed over rows of R first.
            do b = 0, height - lane, lane
                call add_squares(height, n, b, e%matrix, square, sums)
                r(b + 1:b + lane) = sums
            end do
            total = 0.0_wp
            do b = 0, height - lane, lane
                call add_squares(height, m, b, e%eliminated, r, sums)
                do i = 1, min(lane, m - b)
                    total = total + sums(i)*inverse_square(e%order(b + i))
                end do
            end do
            ! D'D over the free columns, where D' is the identity, and over the pivot columns, where it is -Y'.
            call take_columns(m, n, width, e%order, inverse_square, basis, work%part)
            if (k > 0) call take_columns(k, n, width, e%order(m + 1), inverse_square, basis, work%gram)
            if (k > 0) call subtract_product(m, k, height, width, work%part, e%eliminated(1, m + 1), work%gram)
            call factor(m, k, width, work%gram, work%part, work%inverse, work%column, stat)
            if (stat /= 0) return
            call subtract_squares(m, k, height, width, work%part, e%eliminated, r, work%inverse, total)
        end associate
        if (total > 0.0_wp .and. total <= huge(1.0_wp)) independence = 1.0_wp/sqrt(total)
    end subroutine find_padded

    !> Columns of A, multiplied by factors.
    pure subroutine take_columns(l, n, width, order, factors, a, b)
        integer, intent(in) :: l, n
        integer, intent(in), value :: width
        !> The columns, and the factors of all columns.
        integer, intent(in) :: order(l)
        real(wp), intent(in) :: factors(n), a(width, n)
        real(wp), intent(inout) :: b(width, l)
        real(wp) :: f
        integer :: i, j, s

        do s = 0, width - short, short
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do j = 1, l
                f = factors(order(j))
                !GCC$ UNROLL 1
                do i = 1, short
                    b(s + i, j) = a(s + i, order(j))*f
                end do
            end do
        end do
    end subroutine take_columns

    !> C := C - A B', A (width, m), B' (m, k) padded, C (width, k).
    pure subroutine subtract_product(m, k, height, width, a, b, c)
        integer, intent(in) :: m, k, height
        integer, intent(in), value :: width
        real(wp), intent(in) :: a(width, m), b(height, k)
        real(wp), intent(inout) :: c(width, k)
        real(wp) :: x(short)
        integer :: i, j, l, s

        do s = 0, width - short, short
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do j = 1, k
                !GCC$ UNROLL 1
                do i = 1, short
                    x(i) = c(s + i, j)
                end do
                !GCC$ NOVECTOR
                !GCC$ UNROLL 2
                do l = 1, m
                    !GCC$ UNROLL 1
                    do i = 1, short
                        x(i) = x(i) - a(s + i, l)*b(l, j)
                    end do
                end do
                !GCC$ UNROLL 1
                do i = 1, short
                    c(s + i, j) = x(i)
                end do
            end do
        end do
    end subroutine subtract_product

    !> Subtract |L^-1 D'R|^2 from a total, without the roots of L's pivots.
    pure subroutine subtract_squares(m, k, height, width, part, a, r, inverse, total)
        integer, intent(in) :: m, k, height
        integer, intent(in), value :: width
        !> L^-1 D' of the pivot columns, C eliminated, weights of its rows, inverse pivots.
        real(wp), intent(in) :: part(width, m), a(height, m), r(m), inverse(k)
        real(wp), intent(inout) :: total
        real(wp) :: x(short), y(short)
        integer :: b, i, j, l

        do b = 0, width - short, short
            do i = 1, short
                y(i) = 0.0_wp
            end do
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do j = 1, m
                do i = 1, short
                    x(i) = part(b + i, 1)*a(1, j)
                end do
                !GCC$ NOVECTOR
                !GCC$ UNROLL 2
                do l = 2, m
                    !GCC$ UNROLL 1
                    do i = 1, short
                        x(i) = x(i) + part(b + i, l)*a(l, j)
                    end do
                end do
                !GCC$ UNROLL 1
                do i = 1, short
                    y(i) = y(i) + r(j)*x(i)**2
                end do
            end do
            do i = 1, min(short, k - b)
                total = total - y(i)*inverse(b + i)
            end do
        end do
    end subroutine subtract_squares

    !> Sums of w(j) a(i, j)^2 over n columns, rows b + 1 to b + lane.
    pure subroutine add_squares(height, n, b, a, w, sums)
        integer, intent(in), value :: height, n, b
        real(wp), intent(in) :: a(height, n), w(n)
        real(wp), intent(out) :: sums(lane)
        integer :: i, j, s

        do i = 1, lane
            sums(i) = 0.0_wp
        end do
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do j = 1, n
            do s = 0, lane - short, short
                !GCC$ UNROLL 1
                do i = 1, short
                    sums(s + i) = sums(s + i) + a(b + s + i, j)**2*w(j)
                end do
            end do
        end do
    end subroutine add_squares

    !> L diag(d) L' of D'D, 1/d, and L^-1 of the adjoining columns. stat > 0: the leading minor of this order is not positive, or so
    !> small relative to its diagonal entry that it is inaccurate.
    pure subroutine factor(m, k, width, gram, part, inverse, column, stat)
        integer, intent(in) :: m, k
        integer, intent(in), value :: width
        real(wp), intent(inout) :: gram(width, k), part(width, m), inverse(k), column(width)
        integer, intent(out) :: stat
        !> Limit of a relative pivot times the smallest previous one: rounding of a pivot is a few n eps over the latter.
        real(wp), parameter :: smallest_pivot = 8.0e-15_wp
        real(wp) :: diagonal, f, least, pivot
        integer :: b, i, j

        stat = 0
        least = 1.0_wp
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do j = 1, k
            inverse(j) = gram(j, j)
        end do
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do j = 1, k
            diagonal = inverse(j)
            pivot = gram(j, j)
            if (.not. pivot*least > smallest_pivot*diagonal) then
                stat = j
                return
            end if
            least = min(least, pivot/diagonal)
            f = 1.0_wp/pivot
            inverse(j) = f
            ! Column of L below its diagonal.
            do b = 0, width - short, short
                !GCC$ UNROLL 1
                do i = 1, short
                    column(b + i) = merge(gram(b + i, j)*f, 0.0_wp, b + i > j)
                end do
            end do
            call subtract_row(k - j, width, j, column, gram(:, j + 1:))
            if (j < k) call subtract_row(m, width, j, column, part)
        end do
    end subroutine factor

    !> A := A - x (row p of A), A (width, n).
    pure subroutine subtract_row(n, width, p, x, a)
        integer, intent(in), value :: n, width, p
        real(wp), intent(in) :: x(width)
        real(wp), intent(inout) :: a(width, n)
        real(wp) :: f
        integer :: b, i, j

        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do j = 1, n
            f = a(p, j)
            do b = 0, width - short, short
                !GCC$ UNROLL 1
                do i = 1, short
                    a(b + i, j) = a(b + i, j) - x(b + i)*f
                end do
            end do
        end do
    end subroutine subtract_row
end module tandem_linalg_independence
