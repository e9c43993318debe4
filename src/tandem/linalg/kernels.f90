! SPDX-License-Identifier: MIT
!> Products of small dense matrices and vectors. At the sizes of one mechanism (2 ... 16) a BLAS call or an out-of-line
!> `matmul` costs more than the product itself.
module tandem_linalg_kernels
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: add_product, add_transposed_product, set_gram, set_product

contains

    !> y := y + factor A x, A (m, n).
    pure subroutine add_product(a, x, factor, y)
        real(wp), intent(in), contiguous :: a(:, :), x(:)
        real(wp), intent(in) :: factor
        real(wp), intent(inout), contiguous :: y(:)
        real(wp) :: xj
        integer :: i, j

        do j = 1, size(a, 2)
            xj = factor*x(j)
            do i = 1, size(a, 1)
                y(i) = y(i) + a(i, j)*xj
            end do
        end do
    end subroutine add_product

    !> y := y + factor A' x, A (m, n).
    pure subroutine add_transposed_product(a, x, factor, y)
        real(wp), intent(in), contiguous :: a(:, :), x(:)
        real(wp), intent(in) :: factor
        real(wp), intent(inout), contiguous :: y(:)
        real(wp) :: total
        integer :: i, j

        do j = 1, size(a, 2)
            total = 0.0_wp
            do i = 1, size(a, 1)
                total = total + a(i, j)*x(i)
            end do
            y(j) = y(j) + factor*total
        end do
    end subroutine add_transposed_product

    !> C := A B, A (l, m), B (m, n).
    pure subroutine set_product(a, b, c)
        real(wp), intent(in), contiguous :: a(:, :), b(:, :)
        real(wp), intent(out), contiguous :: c(:, :)
        real(wp) :: bkj
        integer :: i, j, k

        do j = 1, size(b, 2)
            do i = 1, size(a, 1)
                c(i, j) = 0.0_wp
            end do
            do k = 1, size(a, 2)
                bkj = b(k, j)
                do i = 1, size(a, 1)
                    c(i, j) = c(i, j) + a(i, k)*bkj
                end do
            end do
        end do
    end subroutine set_product

    !> C := A' B, A (l, m), B (l, n).
    pure subroutine set_gram(a, b, c)
        real(wp), intent(in), contiguous :: a(:, :), b(:, :)
        real(wp), intent(out), contiguous :: c(:, :)
        real(wp) :: total
        integer :: i, j, k

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
