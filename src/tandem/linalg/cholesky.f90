! SPDX-License-Identifier: MIT
!> Cholesky factorisation of a symmetric positive definite matrix; work space allocated once. Up to order 16 by loops, above by
!> LAPACK, for the reasons given for the LU factorisation.
module tandem_linalg_cholesky
    use tandem_kinds, only: wp
    use tandem_linalg_lapack, only: dpotrf, dpotrs
    use tandem_pack, only: pack_type
    implicit none (type, external)
    private

    public :: cholesky_type

    !> Largest order of the loops.
    integer, parameter :: largest_small = 16

    type :: cholesky_type
        private
        integer :: n = 0
        real(wp), allocatable :: factor_(:, :)
    contains
        procedure :: allocate => allocate_cholesky, factor, solve, solve_rows, pack_state
        procedure, private :: factor_small, solve_small
    end type cholesky_type

contains

    !> Allocate for matrices of order n.
    subroutine allocate_cholesky(self, n)
        class(cholesky_type), intent(inout) :: self
        integer, intent(in) :: n

        self%n = n
        if (allocated(self%factor_)) deallocate (self%factor_)
        allocate (self%factor_(n, n))
    end subroutine allocate_cholesky

    !> Factor a matrix (n, n), of which the lower triangle is used. stat > 0: the leading minor of this order is not positive, or so
    !> small relative to its diagonal entry that the solution would be inaccurate.
    subroutine factor(self, matrix, stat)
        class(cholesky_type), intent(inout) :: self
        real(wp), intent(in) :: matrix(:, :)
        integer, intent(out) :: stat
        !> Limit of a relative pivot times the smallest previous one: rounding of a pivot is a few n eps over the latter.
        real(wp), parameter :: smallest_pivot = 8.0e-15_wp
        real(wp) :: ratio, least
        integer :: i

        stat = 0
        if (self%n == 0) return
        self%factor_ = matrix
        if (self%n <= largest_small) then
            call self%factor_small(stat)
        else
            call dpotrf('L', self%n, self%factor_, self%n, stat)
        end if
        if (stat /= 0) return
        least = 1.0_wp
        do i = 1, self%n
            ratio = self%factor_(i, i)**2/matrix(i, i)
            if (.not. ratio*least > smallest_pivot) then
                stat = i
                return
            end if
            least = min(least, ratio)
        end do
    end subroutine factor

    !> b := A^-1 b for a vector (n).
    subroutine solve(self, b)
        class(cholesky_type), intent(in) :: self
        real(wp), intent(inout), contiguous :: b(:)
        integer :: info

        if (self%n <= largest_small) then
            call self%solve_small(b)
        else
            call dpotrs('L', self%n, 1, self%factor_, self%n, b, self%n, info)
        end if
    end subroutine solve

    !> X := X A^-1 for a matrix (l, n), column by column: its rows are solved simultaneously.
    pure subroutine solve_rows(self, x)
        class(cholesky_type), intent(in) :: self
        real(wp), intent(inout), contiguous :: x(:, :)
        real(wp) :: f
        integer :: i, j, k

        do k = 1, self%n
            do j = 1, k - 1
                f = self%factor_(k, j)
                do i = 1, size(x, 1)
                    x(i, k) = x(i, k) - f*x(i, j)
                end do
            end do
            f = 1.0_wp/self%factor_(k, k)
            do i = 1, size(x, 1)
                x(i, k) = f*x(i, k)
            end do
        end do
        do k = self%n, 1, -1
            do j = k + 1, self%n
                f = self%factor_(j, k)
                do i = 1, size(x, 1)
                    x(i, k) = x(i, k) - f*x(i, j)
                end do
            end do
            f = 1.0_wp/self%factor_(k, k)
            do i = 1, size(x, 1)
                x(i, k) = f*x(i, k)
            end do
        end do
    end subroutine solve_rows

    !> The factor, column by column. stat > 0: the leading minor of this order is not positive.
    subroutine factor_small(self, stat)
        class(cholesky_type), intent(inout) :: self
        integer, intent(out) :: stat
        real(wp) :: f
        integer :: i, j, k

        stat = 0
        associate (l => self%factor_, n => self%n)
            do j = 1, n
                do k = 1, j - 1
                    f = l(j, k)
                    do i = j, n
                        l(i, j) = l(i, j) - l(i, k)*f
                    end do
                end do
                if (.not. l(j, j) > 0.0_wp) then
                    stat = j
                    return
                end if
                l(j, j) = sqrt(l(j, j))
                f = 1.0_wp/l(j, j)
                do i = j + 1, n
                    l(i, j) = l(i, j)*f
                end do
            end do
        end associate
    end subroutine factor_small

    !> Forward and back substitution.
    pure subroutine solve_small(self, b)
        class(cholesky_type), intent(in) :: self
        real(wp), intent(inout), contiguous :: b(:)
        integer :: i, k

        do k = 1, self%n
            b(k) = b(k)/self%factor_(k, k)
            do i = k + 1, self%n
                b(i) = b(i) - self%factor_(i, k)*b(k)
            end do
        end do
        do k = self%n, 1, -1
            do i = k + 1, self%n
                b(k) = b(k) - self%factor_(i, k)*b(i)
            end do
            b(k) = b(k)/self%factor_(k, k)
        end do
    end subroutine solve_small

    !> The factor.
    subroutine pack_state(self, pack)
        class(cholesky_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%factor_)
    end subroutine pack_state
end module tandem_linalg_cholesky
