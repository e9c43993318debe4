! SPDX-License-Identifier: MIT
!> LU factorisation of a square matrix, with its solution and condition estimate; work space allocated once.
!>
!> Up to order 16 by loops, which store factors and pivots as LAPACK does: there a call of LAPACK costs more than its arithmetic (a
!> measured factor of 2 to 4), and a threaded BLAS may start threads for it. LAPACK above.
module tandem_linalg_lu
    use tandem_kinds, only: wp
    use tandem_linalg_kernels, only: add_product, set_leading_product
    use tandem_linalg_lapack, only: dgecon, dgetrf, dgetrs
    use tandem_pack, only: pack_type
    implicit none (type, external)
    private

    public :: lu_type

    !> Largest order of the loops.
    integer, parameter :: largest_small = 16

    type :: lu_type
        private
        integer :: n = 0
        real(wp) :: norm = 0.0_wp
        real(wp), allocatable :: factors(:, :), work(:)
        integer, allocatable :: pivots(:), iwork(:)
    contains
        procedure :: allocate => allocate_lu, factor, factor_product, solve, solve_transposed, solve_rows, invert
        procedure :: reciprocal_condition, determinant_sign, smallest_pivot, pack_state
        procedure, private :: factor_small, solve_small, solve_small_transposed
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
        if (self%n <= largest_small) then
            call self%factor_small(stat)
        else
            call dgetrf(self%n, self%n, self%factors, self%n, self%pivots, stat)
        end if
        if (stat == 0 .and. .not. self%norm <= huge(1.0_wp)) stat = 1
    end subroutine factor

    !> Factor A B without the norm that estimates of the condition need. stat > 0 as in `factor`.
    subroutine factor_product(self, a, b, stat)
        class(lu_type), intent(inout) :: self
        !> At least n rows (:, k), at least n columns (k, :).
        real(wp), intent(in), contiguous :: a(:, :), b(:, :)
        integer, intent(out) :: stat

        stat = 0
        if (self%n == 0) return
        call set_leading_product(self%n, self%n, a, b, self%factors)
        self%norm = 0.0_wp
        if (self%n <= largest_small) then
            call self%factor_small(stat)
        else
            call dgetrf(self%n, self%n, self%factors, self%n, self%pivots, stat)
        end if
        if (stat == 0 .and. .not. abs(self%factors(self%n, self%n)) <= huge(1.0_wp)) stat = self%n
    end subroutine factor_product

    !> b := A^-1 b for a vector (n).
    subroutine solve(self, b)
        class(lu_type), intent(in) :: self
        real(wp), intent(inout), contiguous :: b(:)
        integer :: info

        if (self%n <= largest_small) then
            call self%solve_small(b)
        else
            call dgetrs('N', self%n, 1, self%factors, self%n, self%pivots, b, self%n, info)
        end if
    end subroutine solve

    !> b := A'^-1 b for a vector (n).
    subroutine solve_transposed(self, b)
        class(lu_type), intent(in) :: self
        real(wp), intent(inout), contiguous :: b(:)
        integer :: info

        if (self%n <= largest_small) then
            call self%solve_small_transposed(b)
        else
            call dgetrs('T', self%n, 1, self%factors, self%n, self%pivots, b, self%n, info)
        end if
    end subroutine solve_transposed

    !> B := B A^-1 for a matrix (m, n).
    subroutine solve_rows(self, b)
        class(lu_type), intent(in) :: self
        real(wp), intent(inout), contiguous :: b(:, :)
        real(wp) :: f
        integer :: i, j, p

        associate (a => self%factors, n => self%n)
            do j = 1, n
                call add_product(b(:, :j - 1), a(:j - 1, j), -1.0_wp, b(:, j))
                f = 1.0_wp/a(j, j)
                do i = 1, size(b, 1)
                    b(i, j) = b(i, j)*f
                end do
            end do
            do j = n - 1, 1, -1
                call add_product(b(:, j + 1:n), a(j + 1:n, j), -1.0_wp, b(:, j))
            end do
            do j = n, 1, -1
                p = self%pivots(j)
                if (p == j) cycle
                do i = 1, size(b, 1)
                    f = b(i, p)
                    b(i, p) = b(i, j)
                    b(i, j) = f
                end do
            end do
        end associate
    end subroutine solve_rows

    !> The inverse (n, n).
    subroutine invert(self, inverse)
        class(lu_type), intent(in) :: self
        real(wp), intent(out), contiguous :: inverse(:, :)
        integer :: i, info

        inverse = 0.0_wp
        do i = 1, self%n
            inverse(i, i) = 1.0_wp
        end do
        if (self%n <= largest_small) then
            do i = 1, self%n
                call self%solve_small(inverse(:, i))
            end do
        else
            call dgetrs('N', self%n, self%n, self%factors, self%n, self%pivots, inverse, self%n, info)
        end if
    end subroutine invert

    !> Gaussian elimination with row pivoting, column by column. stat > 0: no pivot in this column.
    subroutine factor_small(self, stat)
        class(lu_type), intent(inout) :: self
        integer, intent(out) :: stat
        real(wp) :: largest, swap, f
        integer :: i, j, k, p

        stat = 0
        associate (a => self%factors, n => self%n)
            do k = 1, n
                p = k
                largest = abs(a(k, k))
                do i = k + 1, n
                    if (.not. abs(a(i, k)) > largest) cycle
                    largest = abs(a(i, k))
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
    pure subroutine solve_small(self, b)
        class(lu_type), intent(in) :: self
        real(wp), intent(inout), contiguous :: b(:)
        real(wp) :: f
        integer :: i, k, p

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
    end subroutine solve_small

    !> Forward and back substitution with the transposed factors.
    pure subroutine solve_small_transposed(self, b)
        class(lu_type), intent(in) :: self
        real(wp), intent(inout), contiguous :: b(:)
        real(wp) :: f
        integer :: i, k, p

        do k = 1, self%n
            f = b(k)
            do i = 1, k - 1
                f = f - self%factors(i, k)*b(i)
            end do
            b(k) = f/self%factors(k, k)
        end do
        do k = self%n - 1, 1, -1
            f = b(k)
            do i = k + 1, self%n
                f = f - self%factors(i, k)*b(i)
            end do
            b(k) = f
        end do
        do k = self%n, 1, -1
            p = self%pivots(k)
            f = b(p)
            b(p) = b(k)
            b(k) = f
        end do
    end subroutine solve_small_transposed

    !> The sign of the determinant, +1 for n = 0.
    pure integer function determinant_sign(self)
        class(lu_type), intent(in) :: self
        integer :: i

        determinant_sign = 1
        do i = 1, self%n
            if (self%factors(i, i) < 0.0_wp .neqv. self%pivots(i) /= i) determinant_sign = -determinant_sign
        end do
    end function determinant_sign

    !> Smallest pivot relative to the norm of the matrix; 1 for n = 0.
    pure real(wp) function smallest_pivot(self)
        class(lu_type), intent(in) :: self
        integer :: i

        smallest_pivot = 1.0_wp
        do i = 1, self%n
            smallest_pivot = min(smallest_pivot, abs(self%factors(i, i))/max(self%norm, tiny(1.0_wp)))
        end do
    end function smallest_pivot

    !> An estimate of 1/cond in the 1-norm; 1 for n = 0.
    real(wp) function reciprocal_condition(self)
        class(lu_type), intent(inout) :: self
        integer :: info

        reciprocal_condition = 1.0_wp
        if (self%n > 0) call dgecon('1', self%n, self%factors, self%n, self%norm, reciprocal_condition, self%work, self%iwork, info)
    end function reciprocal_condition

    !> Pack the factors for later solutions.
    subroutine pack_state(self, pack)
        class(lu_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%norm)
        call pack%item(self%factors)
        call pack%item(self%pivots)
    end subroutine pack_state
end module tandem_linalg_lu
