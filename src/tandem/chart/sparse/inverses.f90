! SPDX-License-Identifier: MIT
!> Inverses of small symmetric matrices, such as masses and joints have. The common sizes are compile-time constants; writing them
!> out by hand was tried, and gained nothing at orders 2 to 4 and an eighth at 5.
module tandem_chart_sparse_inverses
    use tandem_chart_sparse_blocks, only: most_coordinates
    use tandem_kinds, only: short, wp
    implicit none (type, external)
    private

    public :: invert, invert_fives, invert_nodes, invert_some, side_by_side

    !> Number of blocks of order 5 that are inverted side by side.
    integer, parameter :: side_by_side = short

contains

    !> The inverse of a symmetric matrix x in place, definite with the sign; pivots are compared with given values.
    pure subroutine invert(s, x, alone, sign, least, worst)
        integer, intent(in) :: s
        real(wp), intent(inout) :: x(s*s)
        !> On entry the values for comparison, then the ratios of the pivots to them; undefined if a pivot is too small.
        real(wp), intent(inout) :: alone(s)
        real(wp), intent(in) :: sign, least
        !> The first pivot that is not larger than `least` times its value, 0 for none.
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

    !> Inverses of blocks of order 5 side by side, entry by entry in registers: every pivot waits for a division, and the divisions
    !> of several blocks overlap. A pivot is swept as in `invert_sized`, always the first remaining one; it then moves behind the
    !> others, so that the statements are the same for all pivots.
    pure subroutine invert_fives(x, alone, least, worst)
        !> The upper triangles are used.
        real(wp), intent(inout) :: x(side_by_side, 5, 5)
        !> On entry the values for comparison with the sign of the pivot, then the ratios of the pivots to them.
        real(wp), intent(inout) :: alone(side_by_side, 5)
        real(wp), intent(in) :: least
        !> As of `invert`, for each block.
        integer, intent(out) :: worst(side_by_side)
        real(wp), dimension(side_by_side) :: x11, x12, x22, x13, x23, x33, x14, x24, x34, x44, x15, x25, x35, x45, x55
        real(wp), dimension(side_by_side) :: pivot, v2, v3, v4, v5
        integer :: k

        x11 = x(:, 1, 1)
        x12 = x(:, 1, 2)
        x22 = x(:, 2, 2)
        x13 = x(:, 1, 3)
        x23 = x(:, 2, 3)
        x33 = x(:, 3, 3)
        x14 = x(:, 1, 4)
        x24 = x(:, 2, 4)
        x34 = x(:, 3, 4)
        x44 = x(:, 4, 4)
        x15 = x(:, 1, 5)
        x25 = x(:, 2, 5)
        x35 = x(:, 3, 5)
        x45 = x(:, 4, 5)
        x55 = x(:, 5, 5)
        !GCC$ UNROLL 5
        do k = 1, 5
            alone(:, k) = x11/alone(:, k)
            pivot = 1.0_wp/x11
            v2 = x12*pivot
            v3 = x13*pivot
            v4 = x14*pivot
            v5 = x15*pivot
            x22 = x22 - x12*v2
            x23 = x23 - x12*v3
            x33 = x33 - x13*v3
            x24 = x24 - x12*v4
            x34 = x34 - x13*v4
            x44 = x44 - x14*v4
            x25 = x25 - x12*v5
            x35 = x35 - x13*v5
            x45 = x45 - x14*v5
            x55 = x55 - x15*v5
            x11 = x22
            x12 = x23
            x22 = x33
            x13 = x24
            x23 = x34
            x33 = x44
            x14 = x25
            x24 = x35
            x34 = x45
            x44 = x55
            x15 = v2
            x25 = v3
            x35 = v4
            x45 = v5
            x55 = -pivot
        end do
        x(:, 1, 1) = -x11
        x(:, 1, 2) = -x12
        x(:, 2, 2) = -x22
        x(:, 1, 3) = -x13
        x(:, 2, 3) = -x23
        x(:, 3, 3) = -x33
        x(:, 1, 4) = -x14
        x(:, 2, 4) = -x24
        x(:, 3, 4) = -x34
        x(:, 4, 4) = -x44
        x(:, 1, 5) = -x15
        x(:, 2, 5) = -x25
        x(:, 3, 5) = -x35
        x(:, 4, 5) = -x45
        x(:, 5, 5) = -x55
        worst = 0
        do k = 5, 1, -1
            where (.not. alone(:, k) > least) worst = k
        end do
    end subroutine invert_fives

    !> The inverses of the negative definite blocks of some nodes of five rows, in place.
    pure subroutine invert_nodes(n_nodes, node, blocks, alone, least, worst)
        !> As of `tandem_chart_sparse_analysis`.
        integer, intent(in) :: n_nodes, node(4, n_nodes)
        !> The blocks of all nodes; for all rows the values for comparison, then the ratios of the pivots to them.
        real(wp), intent(inout) :: blocks(*), alone(*)
        real(wp), intent(in) :: least
        integer, intent(out) :: worst(side_by_side)
        real(wp) :: x(side_by_side, 5, 5), ratio(side_by_side, 5)
        integer :: i, j, l

        do l = 1, side_by_side
            ! Unused lanes repeat the first block.
            associate (diagonal => node(3, merge(l, 1, l <= n_nodes)), origin => node(4, merge(l, 1, l <= n_nodes)))
                !GCC$ UNROLL 5
                do j = 1, 5
                    ratio(l, j) = -alone(origin + j - 1)
                    !GCC$ UNROLL 5
                    do i = 1, j
                        x(l, i, j) = blocks(diagonal + 5*(j - 1) + i)
                    end do
                end do
            end associate
        end do
        call invert_fives(x, ratio, least, worst)
        do l = 1, n_nodes
            associate (diagonal => node(3, l), origin => node(4, l))
                !GCC$ UNROLL 5
                do j = 1, 5
                    alone(origin + j - 1) = ratio(l, j)
                    !GCC$ UNROLL 5
                    do i = 1, j
                        blocks(diagonal + 5*(j - 1) + i) = x(l, i, j)
                        blocks(diagonal + 5*(i - 1) + j) = x(l, i, j)
                    end do
                end do
            end associate
        end do
    end subroutine invert_nodes

    !> The inverse without the rows that are left out, whose rows and columns of the inverse are zero. With `chooses` the largest
    !> pivots are taken first, and rows without a pivot are left out.
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
            ! Independent part of the row.
            alone(i) = max(sign*x(i, i), 0.0_wp)/max(alone(i), tiny(1.0_wp))
            x(i, :) = 0.0_wp
            x(:, i) = 0.0_wp
        end do
    end subroutine invert_some
end module tandem_chart_sparse_inverses
