! SPDX-License-Identifier: MIT
!> Inverses of small symmetric matrices, such as masses and joints have. The sizes that are common are known to the compiler, which
!> makes of them what would be written out by hand: that was tried, and gained nothing at orders 2 to 4 and an eighth at 5.
module tandem_chart_sparse_inverses
    use tandem_chart_sparse_blocks, only: most_coordinates
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: invert, invert_some

contains

    !> The inverse of a symmetric matrix in place, definite with the sign; pivots are compared with what they would be alone.
    pure subroutine invert(s, x, alone, sign, least, worst)
        integer, intent(in) :: s
        real(wp), intent(inout) :: x(s*s)
        !> On entry the comparison, then the pivots against it; where one is too small it means nothing.
        real(wp), intent(inout) :: alone(s)
        real(wp), intent(in) :: sign, least
        !> The first pivot that is not larger than the least part of that, 0 for none.
        integer, intent(out) :: worst

        select case (s)
        case (5)
            call invert_sized(5, x, alone, sign, least, worst)
        case (4)
            call invert_sized(4, x, alone, sign, least, worst)
        case (3)
            call invert_sized(3, x, alone, sign, least, worst)
        case (2)
            call invert_sized(2, x, alone, sign, least, worst)
        case (1)
            call invert_sized(1, x, alone, sign, least, worst)
        case default
            call invert_sized(s, x, alone, sign, least, worst)
        end select
    end subroutine invert

    !> Pivot by pivot, x := x - u u'/p with u = x(:, k): symmetric throughout, and every column is a vector.
    pure subroutine invert_sized(s, x, alone, sign, least, worst)
        integer, intent(in), value :: s
        real(wp), intent(inout) :: x(s, s), alone(s)
        real(wp), intent(in) :: sign, least
        integer, intent(out) :: worst
        real(wp) :: pivot, u(most_coordinates), v(most_coordinates)
        integer :: i, j, k

        worst = 0
        !GCC$ UNROLL 5
        do k = 1, s
            pivot = sign*x(k, k)
            if (.not. pivot > least*alone(k)) then
                worst = k
                return
            end if
            alone(k) = pivot/alone(k)
            pivot = 1.0_wp/x(k, k)
            do i = 1, s
                u(i) = x(i, k)
                v(i) = u(i)*pivot
            end do
            do j = 1, s
                do i = 1, s
                    x(i, j) = x(i, j) - u(i)*v(j)
                end do
            end do
            do i = 1, s
                x(i, k) = v(i)
                x(k, i) = v(i)
            end do
            x(k, k) = -pivot
        end do
        do j = 1, s
            do i = 1, s
                x(i, j) = -x(i, j)
            end do
        end do
    end subroutine invert_sized

    !> The same without the rows that are left out, whose rows and columns of the inverse are zero. With `chooses` pivots are
    !> sought, the largest first, and rows are left out that have none.
    pure subroutine invert_some(s, x, alone, sign, least, chooses, is_out, worst)
        integer, intent(in) :: s
        real(wp), intent(inout) :: x(s, s), alone(s)
        real(wp), intent(in) :: sign, least
        logical, intent(in) :: chooses
        logical, intent(inout) :: is_out(s)
        integer, intent(out) :: worst
        logical :: is_done(most_coordinates)
        real(wp) :: factor
        integer :: i, j, k, pass

        worst = 0
        is_done(:s) = is_out
        do pass = 1, s
            k = 0
            do i = 1, s
                if (is_done(i)) cycle
                if (k == 0) k = i
                if (chooses .and. sign*x(i, i)*alone(k) > sign*x(k, k)*alone(i)) k = i
            end do
            if (k == 0) exit
            is_done(k) = .true.
            factor = sign*x(k, k)
            if (.not. factor > least*alone(k)) then
                if (.not. (chooses .and. abs(factor) <= huge(1.0_wp))) then
                    worst = k
                    return
                end if
                is_out(k) = .true.
                cycle
            end if
            alone(k) = factor/alone(k)
            factor = 1.0_wp/x(k, k)
            x(k, k) = 1.0_wp
            x(:, k) = x(:, k)*factor
            do j = 1, s
                if (j == k) cycle
                factor = x(k, j)
                x(k, j) = 0.0_wp
                x(:, j) = x(:, j) - factor*x(:, k)
            end do
        end do
        do i = 1, s
            if (.not. is_out(i)) cycle
            ! What of it the others do not give.
            alone(i) = max(sign*x(i, i), 0.0_wp)/max(alone(i), tiny(1.0_wp))
            x(i, :) = 0.0_wp
            x(:, i) = 0.0_wp
        end do
    end subroutine invert_some
end module tandem_chart_sparse_inverses
