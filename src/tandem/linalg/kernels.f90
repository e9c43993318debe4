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

        call add_product_of(size(a, 1), size(a, 2), a, x, factor, y)
    end subroutine add_product

    !> The same with explicit sizes: blocks of rows that fit a register, the last one with rows of the one before if need be.
    pure subroutine add_product_of(m, n, a, x, factor, y)
        integer, intent(in) :: m, n
        real(wp), intent(in) :: a(m, n), x(n), factor
        real(wp), intent(inout) :: y(m)
        real(wp) :: s(short), total
        integer :: block, first, i, j, rest

        if (m < short) then
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do i = 1, m
                total = 0.0_wp
                !GCC$ NOVECTOR
                !GCC$ UNROLL 1
                do j = 1, n
                    total = total + a(i, j)*x(j)
                end do
                y(i) = y(i) + factor*total
            end do
            return
        end if
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do block = 1, m/short
            first = short*(block - 1)
            do i = 1, short
                s(i) = 0.0_wp
            end do
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do j = 1, n
                !GCC$ UNROLL 1
                do i = 1, short
                    s(i) = s(i) + a(first + i, j)*x(j)
                end do
            end do
            !GCC$ UNROLL 1
            do i = 1, short
                y(first + i) = y(first + i) + factor*s(i)
            end do
        end do
        rest = iand(m, short - 1)
        if (rest == 0) return
        do i = 1, short
            s(i) = 0.0_wp
        end do
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do j = 1, n
            !GCC$ UNROLL 1
            do i = 1, short
                s(i) = s(i) + a(m - short + i, j)*x(j)
            end do
        end do
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do i = short - rest + 1, short
            y(m - short + i) = y(m - short + i) + factor*s(i)
        end do
    end subroutine add_product_of

    !> y := y + factor A' x, A (m, n).
    pure subroutine add_transposed_product(a, x, factor, y)
        real(wp), intent(in), contiguous :: a(:, :), x(:)
        real(wp), intent(in) :: factor
        real(wp), intent(inout), contiguous :: y(:)

        call add_transposed_product_of(size(a, 1), size(a, 2), a, x, factor, y)
    end subroutine add_transposed_product

    !> The same with explicit sizes: two columns at once, in partial sums that fit a register.
    pure subroutine add_transposed_product_of(m, n, a, x, factor, y)
        integer, intent(in) :: m, n
        real(wp), intent(in) :: a(m, n), x(m), factor
        real(wp), intent(inout) :: y(n)
        real(wp) :: s(short), t(short), t1, t2
        integer :: block, first, i, j, pair

        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do pair = 1, n/2
            j = 2*pair - 1
            do i = 1, short
                s(i) = 0.0_wp
                t(i) = 0.0_wp
            end do
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do block = 1, m/short
                first = short*(block - 1)
                !GCC$ UNROLL 1
                do i = 1, short
                    s(i) = s(i) + a(first + i, j)*x(first + i)
                    t(i) = t(i) + a(first + i, j + 1)*x(first + i)
                end do
            end do
            t1 = (s(1) + s(2)) + (s(3) + s(4))
            t2 = (t(1) + t(2)) + (t(3) + t(4))
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do i = m - iand(m, short - 1) + 1, m
                t1 = t1 + a(i, j)*x(i)
                t2 = t2 + a(i, j + 1)*x(i)
            end do
            y(j) = y(j) + factor*t1
            y(j + 1) = y(j + 1) + factor*t2
        end do
        if (iand(n, 1) == 0) return
        do i = 1, short
            s(i) = 0.0_wp
        end do
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do block = 1, m/short
            first = short*(block - 1)
            !GCC$ UNROLL 1
            do i = 1, short
                s(i) = s(i) + a(first + i, n)*x(first + i)
            end do
        end do
        t1 = (s(1) + s(2)) + (s(3) + s(4))
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do i = m - iand(m, short - 1) + 1, m
            t1 = t1 + a(i, n)*x(i)
        end do
        y(n) = y(n) + factor*t1
    end subroutine add_transposed_product_of

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

        if (l*size(a, 2)*n >= worth_a_call) then
            call dgemm('N', 'N', l, n, size(a, 2), 1.0_wp, a, size(a, 1), b, size(b, 1), 0.0_wp, c, l)
        else
            call set_product_of(l, size(a, 2), n, size(a, 1), a, b, c)
        end if
    end subroutine set_leading_product

    !> The same with explicit sizes: blocks of rows that fit a register, the last one with rows of the one before if need be.
    pure subroutine set_product_of(l, m, n, height, a, b, c)
        integer, intent(in) :: l, m, n, height
        real(wp), intent(in) :: a(height, m), b(m, n)
        real(wp), intent(out) :: c(l, n)
        real(wp) :: s(short), t(short), total
        integer :: first, i, j, k, pair

        if (l < short) then
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do j = 1, n
                !GCC$ NOVECTOR
                !GCC$ UNROLL 1
                do i = 1, l
                    total = 0.0_wp
                    !GCC$ NOVECTOR
                    !GCC$ UNROLL 1
                    do k = 1, m
                        total = total + a(i, k)*b(k, j)
                    end do
                    c(i, j) = total
                end do
            end do
            return
        end if
        first = 0
        do
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do pair = 1, n/2
                j = 2*pair - 1
                do i = 1, short
                    s(i) = 0.0_wp
                    t(i) = 0.0_wp
                end do
                !GCC$ NOVECTOR
                !GCC$ UNROLL 1
                do k = 1, m
                    !GCC$ UNROLL 1
                    do i = 1, short
                        s(i) = s(i) + a(first + i, k)*b(k, j)
                        t(i) = t(i) + a(first + i, k)*b(k, j + 1)
                    end do
                end do
                !GCC$ UNROLL 1
                do i = 1, short
                    c(first + i, j) = s(i)
                    c(first + i, j + 1) = t(i)
                end do
            end do
            if (iand(n, 1) == 1) then
                do i = 1, short
                    s(i) = 0.0_wp
                end do
                !GCC$ NOVECTOR
                !GCC$ UNROLL 1
                do k = 1, m
                    !GCC$ UNROLL 1
                    do i = 1, short
                        s(i) = s(i) + a(first + i, k)*b(k, n)
                    end do
                end do
                !GCC$ UNROLL 1
                do i = 1, short
                    c(first + i, n) = s(i)
                end do
            end if
            if (first + short == l) exit
            first = min(first + short, l - short)
        end do
    end subroutine set_product_of

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
        integer :: j

        if (size(a)*size(b, 2) >= worth_a_call) then
            call dgemm('T', 'N', size(a, 2), size(b, 2), size(a, 1), 1.0_wp, a, size(a, 1), b, size(b, 1), 0.0_wp, c, size(c, 1))
            return
        end if
        c = 0.0_wp
        do j = 1, size(b, 2)
            call add_transposed_product_of(size(a, 1), size(a, 2), a, b(:, j), 1.0_wp, c(:, j))
        end do
    end subroutine set_gram
end module tandem_linalg_kernels
