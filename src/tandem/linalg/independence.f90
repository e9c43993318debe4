! SPDX-License-Identifier: MIT
!> Independence of the rows of C, from its elimination. A separate module, because gfortran stops inlining in files with too many
!> copies of loops for given lengths; the padding is that of `tandem_linalg_null_space_kernels`.
module tandem_linalg_independence
    use tandem_kinds, only: lane, short, wp
    implicit none (type, external)
    private

    public :: find_independence

contains

    !> 1/|C+|, where C+ = R - D (D'D)^-1 D'R is the inverse of least norm: |C+|^2 = |R|^2 - |L^-1 D'R|^2 with D'D = L L'. Rows of
    !> unit length, scaled unknowns. 0 if D'D is singular.
    pure subroutine find_independence(m, n, k, height, width, order, square, inverse_square, c, a, basis, gram, inverse, part, r, &
        column, independence)
        !> Constraints, coordinates, degrees of freedom, padded lengths; order of the columns.
        integer, intent(in) :: m, n, k, height, width, order(n)
        !> diag(s)^2 and its inverse, C, C eliminated, D'.
        real(wp), intent(in) :: square(n), inverse_square(n), c(height, n), a(height, n), basis(width, n)
        !> Work space.
        real(wp), intent(inout) :: gram(width, k), inverse(k), part(width, n), r(height), column(width)
        real(wp), intent(out) :: independence

        if (height == lane .and. width == short) then
            call find_independence_of(m, n, k, lane, short, order, square, inverse_square, c, a, basis, gram, inverse, part, r, &
                column, independence)
        else
            call find_independence_of(m, n, k, height, width, order, square, inverse_square, c, a, basis, gram, inverse, part, r, &
                column, independence)
        end if
    end subroutine find_independence

    !> The same for given lengths.
    pure subroutine find_independence_of(m, n, k, height, width, order, square, inverse_square, c, a, basis, gram, inverse, part, &
        r, column, independence)
        integer, intent(in) :: m, n, k, order(n)
        integer, intent(in), value :: height, width
        real(wp), intent(in) :: square(n), inverse_square(n), c(height, n), a(height, n), basis(width, n)
        real(wp), intent(inout) :: gram(width, k), inverse(k), part(width, n), r(height), column(width)
        real(wp), intent(out) :: independence
        real(wp) :: sums(lane), x(short), y(short), total
        integer :: b, i, j, l, stat

        independence = 0.0_wp
        ! Squared lengths of the rows, and |R|^2, summed over rows of R first.
        total = 0.0_wp
        do b = 0, height - lane, lane
            call add_squares(height, n, b, c, square, sums)
            r(b + 1:b + lane) = sums
        end do
        do b = 0, height - lane, lane
            call add_squares(height, m, b, a, r, sums)
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do i = 1, min(lane, m - b)
                total = total + sums(i)*inverse_square(order(b + i))
            end do
        end do
        call set_gram(m, n, k, height, width, order, inverse_square, a, basis, part, gram)
        call factor(m, k, width, gram, part, inverse, column, stat)
        if (stat /= 0) return
        ! L^-1 D'R without the roots of L's pivots.
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
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do i = 1, min(short, k - b)
                total = total - y(i)*inverse(b + i)
            end do
        end do
        if (total > 0.0_wp .and. total <= huge(1.0_wp)) independence = 1.0_wp/sqrt(total)
    end subroutine find_independence_of

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

    !> D' diag(s)^-2 of the pivot columns, and D'D: over the free columns, and over the pivot columns, where D' is -Y'.
    pure subroutine set_gram(m, n, k, height, width, order, inverse_square, a, basis, part, gram)
        integer, intent(in) :: m, n, k, order(n)
        integer, intent(in), value :: height, width
        real(wp), intent(in) :: inverse_square(n), a(height, n), basis(width, n)
        real(wp), intent(inout) :: part(width, n), gram(width, k)
        real(wp) :: x(short)
        integer :: b, i, j, l, p

        do b = 0, width - short, short
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do l = 1, m
                p = order(l)
                !GCC$ UNROLL 1
                do i = 1, short
                    part(b + i, l) = basis(b + i, p)*inverse_square(p)
                end do
            end do
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do j = 1, k
                p = order(m + j)
                !GCC$ UNROLL 1
                do i = 1, short
                    x(i) = basis(b + i, p)*inverse_square(p)
                end do
                !GCC$ NOVECTOR
                !GCC$ UNROLL 2
                do l = 1, m
                    !GCC$ UNROLL 1
                    do i = 1, short
                        x(i) = x(i) - part(b + i, l)*a(l, m + j)
                    end do
                end do
                !GCC$ UNROLL 1
                do i = 1, short
                    gram(b + i, j) = x(i)
                end do
            end do
        end do
    end subroutine set_gram

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
            call subtract_product(k - j, width, j, column, gram(:, j + 1:))
            if (j < k) call subtract_product(m, width, j, column, part)
        end do
    end subroutine factor

    !> A := A - x (row p of A), A (width, n).
    pure subroutine subtract_product(n, width, p, x, a)
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
    end subroutine subtract_product
end module tandem_linalg_independence
