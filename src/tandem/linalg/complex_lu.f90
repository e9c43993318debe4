! SPDX-License-Identifier: MIT
!> LU factorisation of a square complex matrix, for pairs of stages of implicit methods; work space allocated once. Up to order 16
!> by loops of our own, LAPACK above, for the reasons given with the real one.
module tandem_linalg_complex_lu
    use tandem_kinds, only: wp
    use tandem_linalg_lapack, only: zgetrf, zgetrs
    use tandem_pack, only: pack_type
    implicit none (type, external)
    private

    public :: complex_lu_type

    !> Largest order of the loops.
    integer, parameter :: largest_small = 16

    type :: complex_lu_type
        private
        integer :: n = 0
        complex(wp), allocatable :: factors(:, :), b(:)
        integer, allocatable :: pivots(:)
        !> For checkpoints, which know real numbers (n, n).
        real(wp), allocatable :: part(:, :)
    contains
        procedure :: allocate => allocate_complex_lu
        procedure :: factor
        procedure :: solve
        procedure :: pack_state
        procedure, private :: factor_small
        procedure, private :: solve_small
    end type complex_lu_type

contains

    !> Allocate for matrices of order n.
    subroutine allocate_complex_lu(self, n)
        class(complex_lu_type), intent(inout) :: self
        integer, intent(in) :: n

        self%n = n
        if (allocated(self%factors)) deallocate (self%factors, self%b, self%pivots, self%part)
        allocate (self%factors(n, n), self%b(n), source=(0.0_wp, 0.0_wp))
        allocate (self%pivots(n), source=0)
        allocate (self%part(n, n), source=0.0_wp)
    end subroutine allocate_complex_lu

    !> Factor a matrix (n, n). stat > 0: it is exactly singular or not finite.
    subroutine factor(self, matrix, stat)
        class(complex_lu_type), intent(inout) :: self
        complex(wp), intent(in), contiguous :: matrix(:, :)
        integer, intent(out) :: stat

        stat = 0
        if (self%n == 0) return
        self%factors(:, :) = matrix
        if (self%n <= largest_small) then
            call self%factor_small(stat)
        else
            call zgetrf(self%n, self%n, self%factors, self%n, self%pivots, stat)
        end if
        if (stat == 0 .and. .not. abs(self%factors(self%n, self%n)) <= huge(1.0_wp)) stat = self%n
    end subroutine factor

    !> x + i y := A^-1 (x + i y) for vectors (n).
    subroutine solve(self, x, y)
        class(complex_lu_type), intent(inout) :: self
        real(wp), intent(inout), contiguous :: x(:), y(:)
        integer :: i, info

        do i = 1, self%n
            self%b(i) = cmplx(x(i), y(i), wp)
        end do
        if (self%n <= largest_small) then
            call self%solve_small()
        else
            call zgetrs('N', self%n, 1, self%factors, self%n, self%pivots, self%b, self%n, info)
        end if
        do i = 1, self%n
            x(i) = real(self%b(i), wp)
            y(i) = aimag(self%b(i))
        end do
    end subroutine solve

    !> Gaussian elimination with row pivoting, column by column. stat > 0: no pivot in that column.
    subroutine factor_small(self, stat)
        class(complex_lu_type), intent(inout) :: self
        integer, intent(out) :: stat
        complex(wp) :: swap, f
        real(wp) :: largest, size_
        integer :: i, j, k, p

        stat = 0
        associate (a => self%factors, n => self%n)
            do k = 1, n
                p = k
                largest = 0.0_wp
                do i = k, n
                    size_ = abs(real(a(i, k), wp)) + abs(aimag(a(i, k)))
                    if (.not. size_ > largest) cycle
                    largest = size_
                    p = i
                end do
                self%pivots(k) = p
                if (.not. largest > 0.0_wp) then
                    stat = k
                    return
                end if
                if (p /= k) then
                    do j = 1, n
                        swap = a(k, j)
                        a(k, j) = a(p, j)
                        a(p, j) = swap
                    end do
                end if
                f = 1.0_wp/a(k, k)
                do i = k + 1, n
                    a(i, k) = a(i, k)*f
                end do
                do j = k + 1, n
                    f = a(k, j)
                    do i = k + 1, n
                        a(i, j) = a(i, j) - a(i, k)*f
                    end do
                end do
            end do
        end associate
    end subroutine factor_small

    !> Forward and back substitution.
    pure subroutine solve_small(self)
        class(complex_lu_type), intent(inout) :: self
        complex(wp) :: f
        integer :: i, k, p

        associate (b => self%b)
            do k = 1, self%n
                p = self%pivots(k)
                f = b(p)
                b(p) = b(k)
                b(k) = f
            end do
            do k = 1, self%n
                f = b(k)
                do i = k + 1, self%n
                    b(i) = b(i) - self%factors(i, k)*f
                end do
            end do
            do k = self%n, 1, -1
                b(k) = b(k)/self%factors(k, k)
                f = b(k)
                do i = 1, k - 1
                    b(i) = b(i) - self%factors(i, k)*f
                end do
            end do
        end associate
    end subroutine solve_small

    !> The factors.
    subroutine pack_state(self, pack)
        class(complex_lu_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        self%part = real(self%factors, wp)
        call pack%item(self%part)
        self%factors = cmplx(self%part, aimag(self%factors), wp)
        self%part = aimag(self%factors)
        call pack%item(self%part)
        self%factors = cmplx(real(self%factors, wp), self%part, wp)
        call pack%item(self%pivots)
    end subroutine pack_state
end module tandem_linalg_complex_lu
