! SPDX-License-Identifier: MIT
!> LU factorisation of a square complex matrix, for pairs of stages of implicit methods; work space allocated once.
!>
!> Up to order 16 by loops over real and imaginary parts, with inverse pivots; above by LAPACK. A call of LAPACK for order 5 to 12
!> costs more than its arithmetic.
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
        !> The factors of LAPACK and a right side, or those of the loops, whose diagonal holds the inverse pivots.
        complex(wp), allocatable :: factors(:, :), b(:)
        real(wp), allocatable :: re(:, :), im(:, :)
        integer, allocatable :: pivots(:)
    contains
        procedure :: allocate => allocate_complex_lu, factor, solve, pack_state
    end type complex_lu_type

contains

    !> Allocate for matrices of order n.
    subroutine allocate_complex_lu(self, n)
        class(complex_lu_type), intent(inout) :: self
        integer, intent(in) :: n
        integer :: large

        self%n = n
        large = merge(n, 0, n > largest_small)
        if (allocated(self%factors)) deallocate (self%factors, self%b, self%pivots, self%re, self%im)
        allocate (self%factors(large, large), self%b(large), source=(0.0_wp, 0.0_wp))
        allocate (self%pivots(n), source=0)
        ! Also for checkpoints, which store real numbers.
        allocate (self%re(n, n), self%im(n, n), source=0.0_wp)
    end subroutine allocate_complex_lu

    !> Factor a matrix (n, n). stat > 0: it is exactly singular or not finite.
    subroutine factor(self, matrix, stat)
        class(complex_lu_type), intent(inout) :: self
        complex(wp), intent(in), contiguous :: matrix(:, :)
        integer, intent(out) :: stat
        integer :: i, j

        stat = 0
        if (self%n == 0) return
        if (self%n <= largest_small) then
            do j = 1, self%n
                do i = 1, self%n
                    self%re(i, j) = real(matrix(i, j), wp)
                    self%im(i, j) = aimag(matrix(i, j))
                end do
            end do
            call eliminate(self%n, self%re, self%im, self%pivots, stat)
            return
        end if
        self%factors(:, :) = matrix
        call zgetrf(self%n, self%n, self%factors, self%n, self%pivots, stat)
        if (stat == 0 .and. .not. abs(self%factors(self%n, self%n)) <= huge(1.0_wp)) stat = self%n
    end subroutine factor

    !> Gaussian elimination with row pivoting, column by column. stat > 0: no pivot in this column.
    pure subroutine eliminate(n, re, im, pivots, stat)
        integer, intent(in) :: n
        real(wp), intent(inout) :: re(n, n), im(n, n)
        integer, intent(inout) :: pivots(n)
        integer, intent(out) :: stat
        real(wp) :: column_re(largest_small), column_im(largest_small), largest, re_now, im_now, swap
        integer :: i, j, k, p

        stat = 0
        do k = 1, n
            p = k
            largest = abs(re(k, k)) + abs(im(k, k))
            do i = k + 1, n
                if (.not. abs(re(i, k)) + abs(im(i, k)) > largest) cycle
                largest = abs(re(i, k)) + abs(im(i, k))
                p = i
            end do
            pivots(k) = p
            if (.not. (largest > 0.0_wp .and. largest <= huge(1.0_wp))) then
                stat = k
                return
            end if
            if (p /= k) then
                do j = 1, n
                    swap = re(k, j)
                    re(k, j) = re(p, j)
                    re(p, j) = swap
                    swap = im(k, j)
                    im(k, j) = im(p, j)
                    im(p, j) = swap
                end do
            end if
            call invert(re(k, k), im(k, k))
            re_now = re(k, k)
            im_now = im(k, k)
            do i = k + 1, n
                column_re(i) = re(i, k)*re_now - im(i, k)*im_now
                column_im(i) = re(i, k)*im_now + im(i, k)*re_now
                re(i, k) = column_re(i)
                im(i, k) = column_im(i)
            end do
            do j = k + 1, n
                re_now = re(k, j)
                im_now = im(k, j)
                do i = k + 1, n
                    re(i, j) = re(i, j) - (column_re(i)*re_now - column_im(i)*im_now)
                    im(i, j) = im(i, j) - (column_re(i)*im_now + column_im(i)*re_now)
                end do
            end do
        end do
    end subroutine eliminate

    !> The inverse of a number, without overflow of its square.
    pure subroutine invert(re, im)
        real(wp), intent(inout) :: re, im
        real(wp) :: scale, x, y, f

        scale = 1.0_wp/max(abs(re), abs(im))
        x = re*scale
        y = im*scale
        f = scale/(x*x + y*y)
        re = x*f
        im = -y*f
    end subroutine invert

    !> x + i y := A^-1 (x + i y) for vectors (n).
    subroutine solve(self, x, y)
        class(complex_lu_type), intent(inout) :: self
        real(wp), intent(inout), contiguous :: x(:), y(:)
        integer :: i, info

        ! LAPACK would print a message for a leading dimension of 0.
        if (self%n == 0) return
        if (self%n <= largest_small) then
            call substitute(self%n, self%re, self%im, self%pivots, x, y)
            return
        end if
        do i = 1, self%n
            self%b(i) = cmplx(x(i), y(i), wp)
        end do
        call zgetrs('N', self%n, 1, self%factors, self%n, self%pivots, self%b, self%n, info)
        do i = 1, self%n
            x(i) = real(self%b(i), wp)
            y(i) = aimag(self%b(i))
        end do
    end subroutine solve

    !> Forward and back substitution.
    pure subroutine substitute(n, re, im, pivots, x, y)
        integer, intent(in) :: n
        real(wp), intent(in) :: re(n, n), im(n, n)
        integer, intent(in) :: pivots(n)
        real(wp), intent(inout) :: x(n), y(n)
        real(wp) :: re_now, im_now
        integer :: i, k, p

        do k = 1, n
            p = pivots(k)
            re_now = x(p)
            x(p) = x(k)
            x(k) = re_now
            im_now = y(p)
            y(p) = y(k)
            y(k) = im_now
        end do
        do k = 1, n
            re_now = x(k)
            im_now = y(k)
            do i = k + 1, n
                x(i) = x(i) - (re(i, k)*re_now - im(i, k)*im_now)
                y(i) = y(i) - (re(i, k)*im_now + im(i, k)*re_now)
            end do
        end do
        do k = n, 1, -1
            re_now = x(k)*re(k, k) - y(k)*im(k, k)
            im_now = x(k)*im(k, k) + y(k)*re(k, k)
            x(k) = re_now
            y(k) = im_now
            do i = 1, k - 1
                x(i) = x(i) - (re(i, k)*re_now - im(i, k)*im_now)
                y(i) = y(i) - (re(i, k)*im_now + im(i, k)*re_now)
            end do
        end do
    end subroutine substitute

    !> The factors.
    subroutine pack_state(self, pack)
        class(complex_lu_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        if (self%n > largest_small) then
            self%re = real(self%factors, wp)
            self%im = aimag(self%factors)
        end if
        call pack%item(self%re, self%im)
        if (self%n > largest_small) self%factors = cmplx(self%re, self%im, wp)
        call pack%item(self%pivots)
    end subroutine pack_state
end module tandem_linalg_complex_lu
