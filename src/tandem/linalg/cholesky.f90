! SPDX-License-Identifier: MIT
!> Cholesky factorisation of a symmetric positive definite matrix; work space allocated once.
module tandem_linalg_cholesky
    use tandem_kinds, only: wp
    use tandem_linalg_lapack, only: dpotrf, dpotrs
    implicit none (type, external)
    private

    public :: cholesky_type

    type :: cholesky_type
        private
        integer :: n = 0
        real(wp), allocatable :: factor_(:, :)
    contains
        procedure :: allocate => allocate_cholesky
        procedure :: factor
        procedure :: solve
    end type cholesky_type

contains

    !> Allocate for matrices of order n.
    subroutine allocate_cholesky(self, n)
        class(cholesky_type), intent(inout) :: self
        integer, intent(in) :: n

        self%n = n
        if (allocated(self%factor_)) deallocate (self%factor_)
        allocate (self%factor_(n, n), source=0.0_wp)
    end subroutine allocate_cholesky

    !> Factor a matrix (n, n), of which the lower triangle is read. stat > 0: the leading minor of that order is not
    !> positive, or so small against its own diagonal that the solution would be noise.
    subroutine factor(self, matrix, stat)
        class(cholesky_type), intent(inout) :: self
        real(wp), intent(in) :: matrix(:, :)
        integer, intent(out) :: stat
        !> Smallest square of a pivot over its diagonal entry that still carries a digit.
        real(wp), parameter :: smallest_pivot = 1.0e-15_wp
        integer :: i

        stat = 0
        if (self%n == 0) return
        self%factor_ = matrix
        call dpotrf('L', self%n, self%factor_, self%n, stat)
        if (stat /= 0) return
        do i = 1, self%n
            if (self%factor_(i, i)**2 > smallest_pivot*matrix(i, i)) cycle
            stat = i
            return
        end do
    end subroutine factor

    !> b := A^-1 b for a vector (n).
    subroutine solve(self, b)
        class(cholesky_type), intent(in) :: self
        real(wp), intent(inout), contiguous :: b(:)
        integer :: info

        if (self%n > 0) call dpotrs('L', self%n, 1, self%factor_, self%n, b, self%n, info)
    end subroutine solve
end module tandem_linalg_cholesky
