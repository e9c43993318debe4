! SPDX-License-Identifier: MIT
!> Products of large matrices by BLAS, and inverses of large Gram matrices by LAPACK.
module tandem_linalg_products
    use tandem_kinds, only: wp
    use tandem_linalg_lapack, only: dgemm, dpotrf, dpotri, dsyrk, dtrtri
    implicit none (type, external)
    private

    public :: find_inverse_trace, invert_definite, multiply_by_block, multiply_by_transpose, multiply_first
    public :: multiply_rows_by_themselves

contains

    !> Columns first to last of C := A B, where B (n, n) is a diagonal block in these rows and columns; A and C (l, n).
    subroutine multiply_by_block(l, n, first, last, a, b, c)
        integer, intent(in) :: l, n, first, last
        real(wp), intent(in) :: a(l, n), b(n, n)
        real(wp), intent(inout) :: c(l, n)

        associate (width => last - first + 1)
            call dgemm('N', 'N', l, width, width, 1.0_wp, a(1, first), l, b(first, first), n, 0.0_wp, c(1, first), l)
        end associate
    end subroutine multiply_by_block

    !> C := A B', A (l, n), B (l, n), C (l, k), the first k rows of B.
    subroutine multiply_by_transpose(a, b, c)
        real(wp), intent(in), contiguous :: a(:, :), b(:, :)
        real(wp), intent(inout), contiguous :: c(:, :)

        call dgemm('N', 'T', size(a, 1), size(c, 2), size(a, 2), 1.0_wp, a, size(a, 1), b, size(b, 1), 0.0_wp, c, size(c, 1))
    end subroutine multiply_by_transpose

    !> C := A B, the first m rows of A (l, n) and the first m columns of B (n, k), in those of C (h, k).
    subroutine multiply_first(m, a, b, c)
        integer, intent(in) :: m
        real(wp), intent(in), contiguous :: a(:, :), b(:, :)
        real(wp), intent(inout), contiguous :: c(:, :)

        call dgemm('N', 'N', m, m, size(a, 2), 1.0_wp, a, size(a, 1), b, size(b, 1), 0.0_wp, c, size(c, 1))
    end subroutine multiply_first

    !> Inverse of the first m rows and columns of A (l, l), symmetric and positive definite.
    subroutine invert_definite(m, smallest_pivot, a, diagonal, is_done)
        integer, intent(in) :: m
        !> Smallest pivot relative to the diagonal entry.
        real(wp), intent(in) :: smallest_pivot
        real(wp), intent(inout), contiguous :: a(:, :)
        !> Work space (m).
        real(wp), intent(inout), contiguous :: diagonal(:)
        logical, intent(out) :: is_done
        integer :: i, j, info

        do i = 1, m
            diagonal(i) = a(i, i)
        end do
        call dpotrf('L', m, a, size(a, 1), info)
        is_done = info == 0
        do i = 1, m
            is_done = is_done .and. a(i, i)**2 > smallest_pivot*diagonal(i)
        end do
        if (.not. is_done) return
        call dpotri('L', m, a, size(a, 1), info)
        do j = 1, m
            do i = 1, j - 1
                a(i, j) = a(j, i)
            end do
        end do
    end subroutine invert_definite

    !> The lower triangle of A A', of the first m rows of A (l, n), in C (m, m).
    subroutine multiply_rows_by_themselves(a, c)
        real(wp), intent(in), contiguous :: a(:, :)
        real(wp), intent(inout), contiguous :: c(:, :)

        call dsyrk('L', 'N', size(c, 1), size(a, 2), 1.0_wp, a, size(a, 1), 0.0_wp, c, size(c, 1))
    end subroutine multiply_rows_by_themselves

    !> Trace of the inverse of a Gram matrix (m, m), given by its lower triangle and overwritten, after scaling its rows to unit
    !> length. stat > 0: the matrix is not positive definite.
    subroutine find_inverse_trace(gram, trace, stat)
        real(wp), intent(inout), contiguous :: gram(:, :)
        real(wp), intent(out) :: trace
        integer, intent(out) :: stat
        real(wp) :: square
        integer :: i, j

        trace = 0.0_wp
        associate (m => size(gram, 1))
            call dpotrf('L', m, gram, m, stat)
            if (stat /= 0) return
            ! The rows of the factor have the lengths of the rows whose Gram matrix this is.
            do i = 1, m
                square = sum(gram(i, :i)**2)
                gram(i, :i) = gram(i, :i)/sqrt(square)
            end do
            call dtrtri('L', 'N', m, gram, m, stat)
            if (stat /= 0) return
            do j = 1, m
                trace = trace + sum(gram(j:, j)**2)
            end do
        end associate
    end subroutine find_inverse_trace
end module tandem_linalg_products
