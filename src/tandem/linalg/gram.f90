! SPDX-License-Identifier: MIT
!> Loops of `tandem_chart_dense_position` except its iteration. Matrices and vectors over the rows of Phi are padded with zeros to
!> `width`.
module tandem_linalg_gram
    use tandem_kinds, only: short, wp
    implicit none (type, external)
    private

    public :: invert_gram, multiply_columns, multiply_rows, refine_inverse, set_directions, set_row_weight, subtract_columns
    public :: smallest_gram_pivot

    !> Smallest pivot of a Gram matrix relative to its diagonal entry. The matrix squares the condition of Phi_q: beyond 1e5 U
    !> becomes an orthonormal basis.
    real(wp), parameter :: smallest_gram_pivot = 1.0e-10_wp

contains

    !> y := y - U u.
    pure subroutine subtract_columns(n, width, u_basis, u, y)
        integer, intent(in) :: n, width
        real(wp), intent(in) :: u_basis(n, width), u(width)
        real(wp), intent(inout) :: y(n)
        integer :: i, l

        do l = 0, width - short, short
            do i = 1, n
                y(i) = y(i) - ((u_basis(i, l + 1)*u(l + 1) + u_basis(i, l + 2)*u(l + 2)) + &
                    (u_basis(i, l + 3)*u(l + 3) + u_basis(i, l + 4)*u(l + 4)))
            end do
        end do
    end subroutine subtract_columns

    !> x := C y, the first nh rows; zeros after them, except that the last block may contain other rows of C.
    pure subroutine multiply_rows(m, n, nh, width, c, y, x)
        integer, intent(in) :: m, n, nh, width
        real(wp), intent(in) :: c(m, n), y(n)
        real(wp), intent(out) :: x(width)
        real(wp) :: sums(short)
        integer :: b, i, j

        do b = 0, width - short, short
            do i = 1, short
                sums(i) = 0.0_wp
            end do
            if (b + short <= m) then
                !GCC$ NOVECTOR
                !GCC$ UNROLL 1
                do j = 1, n
                    !GCC$ UNROLL 1
                    do i = 1, short
                        sums(i) = sums(i) + c(b + i, j)*y(j)
                    end do
                end do
                !GCC$ UNROLL 1
                do i = 1, short
                    x(b + i) = sums(i)
                end do
            else
                x(b + 1:b + short) = 0.0_wp
                do j = 1, n
                    do i = b + 1, nh
                        x(i) = x(i) + c(i, j)*y(j)
                    end do
                end do
            end if
        end do
    end subroutine multiply_rows

    !> y := B x, the first nh columns of B.
    pure subroutine multiply_columns(nh, width, b, x, y)
        integer, intent(in) :: nh, width
        real(wp), intent(in) :: b(width, width), x(width)
        real(wp), intent(out) :: y(width)
        real(wp) :: sums(short)
        integer :: i, j, s

        do s = 0, width - short, short
            do i = 1, short
                sums(i) = 0.0_wp
            end do
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do j = 1, nh
                !GCC$ UNROLL 1
                do i = 1, short
                    sums(i) = sums(i) + b(s + i, j)*x(j)
                end do
            end do
            !GCC$ UNROLL 1
            do i = 1, short
                y(s + i) = sums(i)
            end do
        end do
    end subroutine multiply_columns

    !> U = S Phi_q', S = diag(s)^2, and weights of the rows of Phi.
    pure subroutine set_directions(nh, c, q, scale, u, weight)
        integer, intent(in) :: nh
        !> C (height, n), q, coordinate scales.
        real(wp), intent(in), contiguous :: c(:, :), q(:), scale(:)
        !> U (n, width), weights of the rows (width).
        real(wp), intent(inout), contiguous :: u(:, :), weight(:)

        call set_blocks(size(c, 2), nh, size(c, 1), size(u, 2), c, q, scale, u, weight)
    end subroutine set_directions

    !> (Phi_q U)^-1 by elimination without a search, because the matrix is positive definite.
    pure subroutine invert_gram(nh, c, u, gram, pivots, column, can)
        integer, intent(in) :: nh
        !> C (height, n), U (n, width).
        real(wp), intent(in), contiguous :: c(:, :), u(:, :)
        !> Inverse of Phi_q U, pivots of the elimination, work space.
        real(wp), intent(inout), contiguous :: gram(:, :), pivots(:), column(:)
        !> False if the rows of Phi_q are nearly dependent.
        logical, intent(out) :: can
        integer :: k, width

        width = size(u, 2)
        call multiply(size(c, 2), nh, size(c, 1), width, c, u, gram)
        if (nh < width) gram(nh + 1:, :) = 0.0_wp
        do k = 1, width
            pivots(k) = merge(smallest_gram_pivot*gram(k, k), 1.0_wp, k <= nh)
        end do
        call invert(nh, width, gram, pivots, column, can)
    end subroutine invert_gram

    !> B := B + B (I - Phi_q U B), one step of Newton's iteration (20) for the inverse. Entries of B beyond the nh rows and columns
    !> are zero and remain so.
    pure subroutine refine_inverse(nh, c, u, weight, b, a, e, rest, can)
        integer, intent(in) :: nh
        !> C (height, n), U (n, width), weights of the rows (width).
        real(wp), intent(in), contiguous :: c(:, :), u(:, :), weight(:)
        !> B (width, width), work space.
        real(wp), intent(inout), contiguous :: b(:, :), a(:, :), e(:, :)
        !> Approximate remainder of the entries of I - Phi_q U B, of weighted rows: the square of the previous largest one.
        real(wp), intent(out) :: rest
        !> False if B is too far from the inverse; it is then unchanged.
        logical, intent(out) :: can
        !> Largest entry of I - Phi_q U B, of weighted rows, with a small remainder.
        real(wp), parameter :: too_far = 0.3_wp
        integer :: i, j, width

        width = size(u, 2)
        call multiply(size(c, 2), nh, size(c, 1), width, c, u, a)
        ! E = A B, then I - E.
        call set_product(nh, width, a, b, e)
        can = .true.
        rest = 0.0_wp
        do j = 1, nh
            e(j, j) = e(j, j) - 1.0_wp
            do i = 1, nh
                if (.not. abs(e(i, j))*weight(i) <= too_far*weight(j)) can = .false.
                rest = max(rest, abs(e(i, j))*weight(i)/weight(j))
            end do
        end do
        if (.not. can) return
        rest = rest**2
        call set_product(nh, width, b, e, a)
        do j = 1, nh
            do i = 1, width
                b(i, j) = b(i, j) - a(i, j)
            end do
        end do
    end subroutine refine_inverse

    !> Y := A X, nh columns each.
    pure subroutine set_product(nh, width, a, x, y)
        integer, intent(in) :: nh
        integer, intent(in), value :: width
        real(wp), intent(in) :: a(width, width), x(width, width)
        real(wp), intent(inout) :: y(width, width)
        integer :: i, j, l, s

        do s = 0, width - short, short
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do j = 1, nh
                !GCC$ UNROLL 1
                do i = 1, short
                    y(s + i, j) = (a(s + i, 1)*x(1, j) + a(s + i, 2)*x(2, j)) + (a(s + i, 3)*x(3, j) + a(s + i, 4)*x(4, j))
                end do
            end do
            do l = short, width - short, short
                !GCC$ NOVECTOR
                !GCC$ UNROLL 1
                do j = 1, nh
                    !GCC$ UNROLL 1
                    do i = 1, short
                        y(s + i, j) = y(s + i, j) + ((a(s + i, l + 1)*x(l + 1, j) + a(s + i, l + 2)*x(l + 2, j)) + &
                            (a(s + i, l + 3)*x(l + 3, j) + a(s + i, l + 4)*x(l + 4, j)))
                    end do
                end do
            end do
        end do
    end subroutine set_product

    !> A^-1 in place, A (width, width) of nh rows and columns, by elimination without a search.
    pure subroutine invert(nh, width, a, pivots, column, can)
        integer, intent(in) :: nh
        integer, intent(in), value :: width
        real(wp), intent(inout) :: a(width, width)
        !> Lower bounds of the pivots, positive numbers, on entry, pivots on return; work space.
        real(wp), intent(inout) :: pivots(width), column(width)
        !> False if a pivot is below its bound.
        logical, intent(out) :: can
        !> Four consecutive entries are a part of a unit vector.
        real(wp), parameter :: one_at_0(-short:short) = [0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp]
        real(wp) :: f, inverse
        integer :: b, i, j, k, p

        can = .true.
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do k = 1, nh
            f = a(k, k)
            can = f > pivots(k)
            if (.not. can) return
            pivots(k) = f
            inverse = 1.0_wp/f
            ! Row k is divided by its pivot at the end, as in `tandem_linalg_elimination`: whole columns are written.
            do b = 0, width - short, short
                p = min(max(k - b, 0), short + 1)
                !GCC$ UNROLL 1
                do i = 1, short
                    column(b + i) = a(b + i, k)*(1.0_wp - one_at_0(i - p))
                    a(b + i, k) = one_at_0(i - p)
                end do
            end do
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do j = 1, nh
                f = a(k, j)*inverse
                do b = 0, width - short, short
                    !GCC$ UNROLL 1
                    do i = 1, short
                        a(b + i, j) = a(b + i, j) - column(b + i)*f
                    end do
                end do
            end do
        end do
        do b = 0, width - short, short
            !GCC$ UNROLL 1
            do i = 1, short
                column(b + i) = 1.0_wp/pivots(b + i)
            end do
        end do
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do j = 1, nh
            do b = 0, width - short, short
                !GCC$ UNROLL 1
                do i = 1, short
                    a(b + i, j) = a(b + i, j)*column(b + i)
                end do
            end do
        end do
    end subroutine invert

    !> The same as `set_directions`, in blocks of rows.
    pure subroutine set_blocks(n, nh, height, width, c, q, scale, u, weight)
        integer, intent(in) :: n, nh, height, width
        real(wp), intent(in) :: c(height, n), q(n), scale(n)
        real(wp), intent(inout) :: u(n, width), weight(width)
        real(wp) :: row(short), mask(short), sums(short), magnitude, square
        integer :: b, i, j

        do b = 0, width - short, short
            do i = 1, short
                mask(i) = merge(1.0_wp, 0.0_wp, b + i <= nh)
                sums(i) = tiny(1.0_wp)
            end do
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do j = 1, n
                magnitude = max(abs(q(j)), scale(j))
                square = scale(j)**2
                !GCC$ UNROLL 1
                do i = 1, short
                    sums(i) = sums(i) + abs(c(b + i, j))*magnitude
                    row(i) = c(b + i, j)*mask(i)*square
                end do
                u(j, b + 1) = row(1)
                u(j, b + 2) = row(2)
                u(j, b + 3) = row(3)
                u(j, b + 4) = row(4)
            end do
            !GCC$ UNROLL 1
            do i = 1, short
                weight(b + i) = 1.0_wp/sums(i)
            end do
        end do
    end subroutine set_blocks

    !> A = C U, the first `width` rows, nh columns, and zeros in the following ones. Four columns of C at a time, in one expression,
    !> as in `multiply_all` of `tandem_linalg_null_space_kernels`.
    pure subroutine multiply(n, nh, height, width, c, u, a)
        integer, intent(in) :: n, nh, height
        integer, intent(in), value :: width
        real(wp), intent(in) :: c(height, n), u(n, width)
        real(wp), intent(inout) :: a(width, width)
        real(wp) :: u1, u2, u3, u4
        integer :: i, j, l, rest, s

        rest = iand(n, 3)
        do s = 0, width - short, short
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do l = 1, width
                !GCC$ UNROLL 1
                do i = 1, short
                    a(s + i, l) = 0.0_wp
                end do
            end do
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do j = 1, rest
                !GCC$ NOVECTOR
                !GCC$ UNROLL 1
                do l = 1, nh
                    u1 = u(j, l)
                    !GCC$ UNROLL 1
                    do i = 1, short
                        a(s + i, l) = a(s + i, l) + c(s + i, j)*u1
                    end do
                end do
            end do
            do j = rest + 1, n, 4
                !GCC$ NOVECTOR
                !GCC$ UNROLL 1
                do l = 1, nh
                    u1 = u(j, l)
                    u2 = u(j + 1, l)
                    u3 = u(j + 2, l)
                    u4 = u(j + 3, l)
                    !GCC$ UNROLL 1
                    do i = 1, short
                        a(s + i, l) = a(s + i, l) + &
                            ((c(s + i, j)*u1 + c(s + i, j + 1)*u2) + (c(s + i, j + 2)*u3 + c(s + i, j + 3)*u4))
                    end do
                end do
            end do
        end do
    end subroutine multiply

    !> Reciprocals of the natural scales of the rows of Phi.
    pure subroutine set_row_weight(m, n, nh, jacobian, q, scale, weight)
        integer, intent(in) :: m, n, nh
        real(wp), intent(in) :: jacobian(m, n), q(n), scale(n)
        real(wp), intent(inout) :: weight(nh)
        real(wp) :: magnitude
        integer :: i, j

        weight = tiny(1.0_wp)
        do j = 1, n
            magnitude = max(abs(q(j)), scale(j))
            do i = 1, nh
                weight(i) = weight(i) + abs(jacobian(i, j))*magnitude
            end do
        end do
        weight = 1.0_wp/weight
    end subroutine set_row_weight
end module tandem_linalg_gram
