! SPDX-License-Identifier: MIT
!> Products of dense matrices and vectors, and passes over vectors. For the sizes of most mechanisms a call of BLAS or an
!> out-of-line `matmul` costs more than its arithmetic: loops are used, and BLAS for products of matrices from order 10 on.
module tandem_linalg_kernels
    use tandem_kinds, only: short, wp
    use tandem_linalg_lapack, only: dgemm
    implicit none (type, external)
    private

    public :: add, add_product, add_transposed_product, are_same, copy, is_finite, is_zero_where, set_gram
    public :: set_leading_product, set_product

    !> Number of multiplications from which OpenBLAS is much faster than loops. Measured with square matrices: half the time for A B
    !> and A' B of order 10, four ninths and an eighth of order 128.
    integer, parameter :: worth_a_call = 1000

contains

    !> z := x + y. The last entries are added as a whole register too, which repeats some of the previous ones.
    pure subroutine add(n, x, y, z)
        integer, intent(in) :: n
        real(wp), intent(in) :: x(n), y(n)
        real(wp), intent(out) :: z(n)
        integer :: first, i

        if (n < short) then
            z = x + y
            return
        end if
        first = 0
        do
            !GCC$ UNROLL 1
            do i = 1, short
                z(first + i) = x(first + i) + y(first + i)
            end do
            if (first + short == n) exit
            first = min(first + short, n - short)
        end do
    end subroutine add

    !> y := y + factor A x, A (m, n).
    pure subroutine add_product(a, x, factor, y)
        real(wp), intent(in), contiguous :: a(:, :), x(:)
        real(wp), intent(in) :: factor
        real(wp), intent(inout), contiguous :: y(:)
        real(wp) :: x1, x2, x3
        integer :: i, j, m, n

        m = size(a, 1)
        n = size(a, 2)
        do j = 1, n - 2, 3
            x1 = factor*x(j)
            x2 = factor*x(j + 1)
            x3 = factor*x(j + 2)
            do i = 1, m
                y(i) = y(i) + (a(i, j)*x1 + a(i, j + 1)*x2 + a(i, j + 2)*x3)
            end do
        end do
        do j = n - modulo(n, 3) + 1, n
            x1 = factor*x(j)
            do i = 1, m
                y(i) = y(i) + a(i, j)*x1
            end do
        end do
    end subroutine add_product

    !> y := y + factor A' x, A (m, n).
    pure subroutine add_transposed_product(a, x, factor, y)
        real(wp), intent(in), contiguous :: a(:, :), x(:)
        real(wp), intent(in) :: factor
        real(wp), intent(inout), contiguous :: y(:)
        real(wp) :: t1, t2, t3
        integer :: i, j, m, n

        m = size(a, 1)
        n = size(a, 2)
        do j = 1, n - 2, 3
            t1 = 0.0_wp
            t2 = 0.0_wp
            t3 = 0.0_wp
            do i = 1, m
                t1 = t1 + a(i, j)*x(i)
                t2 = t2 + a(i, j + 1)*x(i)
                t3 = t3 + a(i, j + 2)*x(i)
            end do
            y(j) = y(j) + factor*t1
            y(j + 1) = y(j + 1) + factor*t2
            y(j + 2) = y(j + 2) + factor*t3
        end do
        do j = n - modulo(n, 3) + 1, n
            t1 = 0.0_wp
            do i = 1, m
                t1 = t1 + a(i, j)*x(i)
            end do
            y(j) = y(j) + factor*t1
        end do
    end subroutine add_transposed_product

    !> C := A B, A (l, m), B (m, n).
    subroutine set_product(a, b, c)
        real(wp), intent(in), contiguous :: a(:, :), b(:, :)
        real(wp), intent(out), contiguous :: c(:, :)

        call set_leading_product(size(a, 1), size(b, 2), a, b, c)
    end subroutine set_product

    !> C := the first l rows and n columns of A B, A (:, m), B (m, :).
    subroutine set_leading_product(l, n, a, b, c)
        integer, intent(in) :: l, n
        real(wp), intent(in), contiguous :: a(:, :), b(:, :)
        real(wp), intent(out) :: c(l, n)
        real(wp) :: b1, b2, b3
        integer :: i, j, k, m

        m = size(a, 2)
        if (l*m*n >= worth_a_call) then
            call dgemm('N', 'N', l, n, m, 1.0_wp, a, size(a, 1), b, m, 0.0_wp, c, l)
            return
        end if
        do j = 1, n
            do i = 1, l
                c(i, j) = 0.0_wp
            end do
            do k = 1, m - 2, 3
                b1 = b(k, j)
                b2 = b(k + 1, j)
                b3 = b(k + 2, j)
                do i = 1, l
                    c(i, j) = c(i, j) + (a(i, k)*b1 + a(i, k + 1)*b2 + a(i, k + 2)*b3)
                end do
            end do
            do k = m - modulo(m, 3) + 1, m
                b1 = b(k, j)
                do i = 1, l
                    c(i, j) = c(i, j) + a(i, k)*b1
                end do
            end do
        end do
    end subroutine set_leading_product

    !> y := x. An assignment of short slices spends more time on their bounds.
    pure subroutine copy(n, x, y)
        integer, intent(in) :: n
        real(wp), intent(in) :: x(n)
        real(wp), intent(inout) :: y(n)
        integer :: i

        do i = 1, n
            y(i) = x(i)
        end do
    end subroutine copy

    !> True if two vectors are equal; false with a NaN.
    pure logical function are_same(n, x, y)
        integer, intent(in) :: n
        real(wp), intent(in) :: x(n), y(n)
        real(wp) :: t(short), rest
        integer :: b, i

        ! They are usually equal, so that testing each entry would save nothing.
        do i = 1, short
            t(i) = 0.0_wp
        end do
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do b = 1, n/short
            !GCC$ UNROLL 1
            do i = 1, short
                t(i) = t(i) + abs(x(short*(b - 1) + i) - y(short*(b - 1) + i))
            end do
        end do
        rest = 0.0_wp
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do i = n - iand(n, short - 1) + 1, n
            rest = rest + abs(x(i) - y(i))
        end do
        are_same = rest + ((t(1) + t(2)) + (t(3) + t(4))) <= 0.0_wp
    end function are_same

    !> True if all entries are finite.
    pure logical function is_finite(n, x)
        integer, intent(in) :: n
        real(wp), intent(in) :: x(n)
        real(wp) :: t(short), rest
        integer :: b, i

        do i = 1, short
            t(i) = 0.0_wp
        end do
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do b = 1, n/short
            !GCC$ UNROLL 1
            do i = 1, short
                t(i) = t(i) + abs(x(short*(b - 1) + i))
            end do
        end do
        rest = 0.0_wp
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do i = n - iand(n, short - 1) + 1, n
            rest = rest + abs(x(i))
        end do
        is_finite = rest + ((t(1) + t(2)) + (t(3) + t(4))) <= huge(1.0_wp)
    end function is_finite

    !> True if x is zero where a mask is 1; the mask is 0 elsewhere. Also false if x has an entry that is not finite.
    pure logical function is_zero_where(n, mask, x)
        integer, intent(in) :: n
        real(wp), intent(in) :: mask(n), x(n)
        real(wp) :: t(short), rest
        integer :: b, i

        do i = 1, short
            t(i) = 0.0_wp
        end do
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do b = 1, n/short
            !GCC$ UNROLL 1
            do i = 1, short
                t(i) = t(i) + mask(short*(b - 1) + i)*abs(x(short*(b - 1) + i))
            end do
        end do
        rest = 0.0_wp
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do i = n - iand(n, short - 1) + 1, n
            rest = rest + mask(i)*abs(x(i))
        end do
        is_zero_where = rest + ((t(1) + t(2)) + (t(3) + t(4))) <= 0.0_wp
    end function is_zero_where

    !> C := A' B, A (l, m), B (l, n).
    subroutine set_gram(a, b, c)
        real(wp), intent(in), contiguous :: a(:, :), b(:, :)
        real(wp), intent(out), contiguous :: c(:, :)
        real(wp) :: total
        integer :: i, j, k

        if (size(a)*size(b, 2) >= worth_a_call) then
            call dgemm('T', 'N', size(a, 2), size(b, 2), size(a, 1), 1.0_wp, a, size(a, 1), b, size(b, 1), 0.0_wp, c, size(c, 1))
            return
        end if
        do j = 1, size(b, 2)
            do i = 1, size(a, 2)
                total = 0.0_wp
                do k = 1, size(a, 1)
                    total = total + a(k, i)*b(k, j)
                end do
                c(i, j) = total
            end do
        end do
    end subroutine set_gram
end module tandem_linalg_kernels
