! SPDX-License-Identifier: MIT
!> Systems over the degrees of freedom of one mechanism, usually one to three: calls of LAPACK cost more than their arithmetic. Each
!> procedure has copies for the orders 1 to 4, in which the compiler unrolls every loop; larger orders use the loops. Matrices have
!> `width` rows, k and padding.
module tandem_linalg_small
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: factor_definite, smallest_definite_pivot, solve_near_diagonal, substitute

    !> Limit of a relative pivot times the smallest previous one: rounding of a pivot is a few n eps over the latter.
    real(wp), parameter :: smallest_definite_pivot = 8.0e-15_wp

contains

    !> L diag(d) L' of a symmetric positive definite matrix (width, k), in place of its lower triangle, and 1/d. stat > 0: the
    !> leading minor of this order is not positive, or so small relative to its diagonal entry that solutions would be inaccurate.
    pure subroutine factor_definite(k, width, a, inverse, stat)
        integer, intent(in) :: k, width
        real(wp), intent(inout) :: a(width, k), inverse(k)
        integer, intent(out) :: stat

        select case (k)
        case (1)
            call factor_definite_of(1, width, a, inverse, stat)
        case (2)
            call factor_definite_of(2, width, a, inverse, stat)
        case (3)
            call factor_definite_of(3, width, a, inverse, stat)
        case (4)
            call factor_definite_of(4, width, a, inverse, stat)
        case default
            call factor_definite_of(k, width, a, inverse, stat)
        end select
    end subroutine factor_definite

    !> The same for a given order.
    pure subroutine factor_definite_of(k, width, a, inverse, stat)
        integer, intent(in), value :: k, width
        real(wp), intent(inout) :: a(width, k), inverse(k)
        integer, intent(out) :: stat
        real(wp) :: diagonal, f, least
        integer :: i, j, l

        stat = 0
        least = 1.0_wp
        do j = 1, k
            diagonal = a(j, j)
            do l = 1, j - 1
                f = a(j, l)*a(l, l)
                do i = j, k
                    a(i, j) = a(i, j) - a(i, l)*f
                end do
            end do
            if (.not. a(j, j)*least > smallest_definite_pivot*diagonal) then
                stat = j
                return
            end if
            inverse(j) = 1.0_wp/a(j, j)
            if (j == k) exit
            least = min(least, a(j, j)/diagonal)
            do i = j + 1, k
                a(i, j) = a(i, j)*inverse(j)
            end do
        end do
    end subroutine factor_definite_of

    !> Solve with the factors of `factor_definite`.
    pure subroutine substitute(k, width, a, inverse, b)
        integer, intent(in) :: k, width
        real(wp), intent(in) :: a(width, k), inverse(k)
        real(wp), intent(inout) :: b(k)

        select case (k)
        case (1)
            call substitute_of(1, width, a, inverse, b)
        case (2)
            call substitute_of(2, width, a, inverse, b)
        case (3)
            call substitute_of(3, width, a, inverse, b)
        case (4)
            call substitute_of(4, width, a, inverse, b)
        case default
            call substitute_of(k, width, a, inverse, b)
        end select
    end subroutine substitute

    !> The same for a given order.
    pure subroutine substitute_of(k, width, a, inverse, b)
        integer, intent(in), value :: k, width
        real(wp), intent(in) :: a(width, k), inverse(k)
        real(wp), intent(inout) :: b(k)
        integer :: i, j

        do j = 1, k
            do i = j + 1, k
                b(i) = b(i) - a(i, j)*b(j)
            end do
        end do
        do j = k, 1, -1
            b(j) = b(j)*inverse(j)
            do i = j + 1, k
                b(j) = b(j) - a(i, j)*b(i)
            end do
        end do
    end subroutine substitute_of

    !> Solve a system (width, k) by elimination without a search, for a dominant diagonal. stat > 0: a pivot has become small
    !> relative to its diagonal entry.
    pure subroutine solve_near_diagonal(k, width, a, b, stat)
        integer, intent(in) :: k, width
        real(wp), intent(inout) :: a(width, k), b(k)
        integer, intent(out) :: stat

        select case (k)
        case (1)
            call solve_near_diagonal_of(1, width, a, b, stat)
        case (2)
            call solve_near_diagonal_of(2, width, a, b, stat)
        case (3)
            call solve_near_diagonal_of(3, width, a, b, stat)
        case (4)
            call solve_near_diagonal_of(4, width, a, b, stat)
        case default
            call solve_near_diagonal_of(k, width, a, b, stat)
        end select
    end subroutine solve_near_diagonal

    !> The same for a given order.
    pure subroutine solve_near_diagonal_of(k, width, a, b, stat)
        integer, intent(in), value :: k, width
        real(wp), intent(inout) :: a(width, k), b(k)
        integer, intent(out) :: stat
        !> In the intended use the diagonal entries dominate by far.
        real(wp), parameter :: smallest_pivot = 1.0e-3_wp
        real(wp) :: diagonal, f
        integer :: i, j, l

        stat = 0
        ! Column by column, so that each diagonal entry is still unchanged; replaced by 1/pivot.
        do j = 1, k
            diagonal = abs(a(j, j))
            do l = 1, j - 1
                f = a(l, j)*a(l, l)
                a(l, j) = f
                do i = l + 1, k
                    a(i, j) = a(i, j) - a(i, l)*f
                end do
            end do
            if (.not. abs(a(j, j)) > smallest_pivot*diagonal) then
                stat = j
                return
            end if
            a(j, j) = 1.0_wp/a(j, j)
            b(j) = b(j)*a(j, j)
            do i = j + 1, k
                b(i) = b(i) - a(i, j)*b(j)
            end do
        end do
        do j = k, 2, -1
            do i = 1, j - 1
                b(i) = b(i) - a(i, j)*b(j)
            end do
        end do
    end subroutine solve_near_diagonal_of
end module tandem_linalg_small
