! SPDX-License-Identifier: MIT
!> LU factorisation of a square matrix, with its solution and condition estimate; work space allocated once.
module tandem_linalg_lu
    use tandem_kinds, only: wp
    use tandem_linalg_lapack, only: dgecon, dgetrf, dgetrs
    implicit none (type, external)
    private

    public :: lu_type

    type :: lu_type
        private
        integer :: n = 0
        real(wp) :: norm = 0.0_wp
        real(wp), allocatable :: factors(:, :), work(:)
        integer, allocatable :: pivots(:), iwork(:)
    contains
        procedure :: allocate => allocate_lu
        procedure :: factor
        procedure :: solve
        procedure :: solve_transposed
        procedure :: invert
        procedure :: reciprocal_condition
    end type lu_type

contains

    !> Allocate for matrices of order n.
    subroutine allocate_lu(self, n)
        class(lu_type), intent(inout) :: self
        integer, intent(in) :: n

        self%n = n
        if (allocated(self%factors)) deallocate (self%factors, self%work, self%pivots, self%iwork)
        allocate (self%factors(n, n), self%work(4*n), source=0.0_wp)
        allocate (self%pivots(n), self%iwork(n), source=0)
    end subroutine allocate_lu

    !> Factor a matrix (n, n). stat > 0: it is exactly singular or not finite.
    subroutine factor(self, matrix, stat)
        class(lu_type), intent(inout) :: self
        real(wp), intent(in) :: matrix(:, :)
        integer, intent(out) :: stat

        stat = 0
        if (self%n == 0) return
        self%factors = matrix
        self%norm = maxval(sum(abs(matrix), dim=1))
        call dgetrf(self%n, self%n, self%factors, self%n, self%pivots, stat)
        if (stat == 0 .and. .not. self%norm <= huge(1.0_wp)) stat = 1
    end subroutine factor

    !> b := A^-1 b for a vector (n).
    subroutine solve(self, b)
        class(lu_type), intent(in) :: self
        real(wp), intent(inout), contiguous :: b(:)
        integer :: info

        if (self%n > 0) call dgetrs('N', self%n, 1, self%factors, self%n, self%pivots, b, self%n, info)
    end subroutine solve

    !> b := A'^-1 b for a vector (n).
    subroutine solve_transposed(self, b)
        class(lu_type), intent(in) :: self
        real(wp), intent(inout), contiguous :: b(:)
        integer :: info

        if (self%n > 0) call dgetrs('T', self%n, 1, self%factors, self%n, self%pivots, b, self%n, info)
    end subroutine solve_transposed

    !> The inverse (n, n).
    subroutine invert(self, inverse)
        class(lu_type), intent(in) :: self
        real(wp), intent(out), contiguous :: inverse(:, :)
        integer :: i, info

        inverse = 0.0_wp
        do i = 1, self%n
            inverse(i, i) = 1.0_wp
        end do
        if (self%n > 0) call dgetrs('N', self%n, self%n, self%factors, self%n, self%pivots, inverse, self%n, info)
    end subroutine invert

    !> An estimate of 1/cond in the 1-norm; 1 for n = 0.
    real(wp) function reciprocal_condition(self)
        class(lu_type), intent(inout) :: self
        integer :: info

        reciprocal_condition = 1.0_wp
        if (self%n > 0) call dgecon('1', self%n, self%factors, self%n, self%norm, reciprocal_condition, self%work, self%iwork, info)
    end function reciprocal_condition
end module tandem_linalg_lu
