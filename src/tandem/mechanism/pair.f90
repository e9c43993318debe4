! SPDX-License-Identifier: MIT
!> Common procedures for elements between two bodies: a scalar function of their coordinates has a gradient of 14 entries, (r, p) of
!> the first body and (r, p) of the second, and `columns` maps them to columns of the mechanism. Entries without a column are
!> ignored: those of the ground, of coordinates absent in the plane, and of rotations of point masses.
!>
!> The gradient of a holonomic row and its derivatives along the motion give all five gradient blocks (section 14 of doc/theory.md):
!> (Phi_q qd + Phi_t)_q = d/dt Phi_q, (Phi_q qdd + gamma)_q = d2/dt2 Phi_q, gamma_qd = 2 d/dt Phi_q.
module tandem_mechanism_pair
    use tandem_kinds, only: wp
    use tandem_mechanism_pose, only: pose_type
    use tandem_model_derivatives, only: derivatives_type, need_acceleration_q, need_acceleration_qd, need_dynamics_q, &
        need_dynamics_qd, need_velocity_q
    implicit none (type, external)
    private

    public :: n_local, place_1, turn_1, place_2, turn_2, columns, columns_of_c, add_outer, add_block, put_row, add_row, &
        put_holonomic, &
        add_holonomic, put_force

    !> Number of entries of a gradient, and offsets of its parts.
    integer, parameter :: n_local = 14, place_1 = 0, turn_1 = 3, place_2 = 7, turn_2 = 10

contains

    !> Columns of the entries of a gradient, 0 for ignored entries.
    pure function columns(first, second) result(c)
        type(pose_type), intent(in) :: first, second
        integer :: c(n_local), i

        c = 0
        do i = 1, first%n_place
            c(place_1 + i) = first%place + i - 1
        end do
        do i = 1, first%n_turn
            c(turn_1 + i) = first%turn + i - 1
        end do
        do i = 1, second%n_place
            c(place_2 + i) = second%place + i - 1
        end do
        do i = 1, second%n_turn
            c(turn_2 + i) = second%turn + i - 1
        end do
    end function columns

    !> Columns in the stored C, which may be compressed.
    pure function columns_of_c(first, second) result(c)
        type(pose_type), intent(in) :: first, second
        integer :: c(n_local), i

        c = 0
        do i = 1, first%n_place
            c(place_1 + i) = first%place_column + i - 1
        end do
        do i = 1, first%n_turn
            c(turn_1 + i) = first%turn_column + i - 1
        end do
        do i = 1, second%n_place
            c(place_2 + i) = second%place_column + i - 1
        end do
        do i = 1, second%n_turn
            c(turn_2 + i) = second%turn_column + i - 1
        end do
    end function columns_of_c

    !> Set the entries of a gradient in a row.
    pure subroutine put_row(c, gradient, row, matrix)
        integer, intent(in) :: c(n_local)
        real(wp), intent(in) :: gradient(n_local)
        integer, intent(in) :: row
        real(wp), intent(inout) :: matrix(:, :)
        integer :: i

        do i = 1, n_local
            if (c(i) > 0) matrix(row, c(i)) = gradient(i)
        end do
    end subroutine put_row

    !> Add the entries of a gradient to a row whose columns several elements share.
    pure subroutine add_row(c, weight, gradient, row, matrix)
        integer, intent(in) :: c(n_local)
        real(wp), intent(in) :: weight, gradient(n_local)
        integer, intent(in) :: row
        real(wp), intent(inout) :: matrix(:, :)
        integer :: i

        do i = 1, n_local
            if (c(i) > 0) matrix(row, c(i)) = matrix(row, c(i)) + weight*gradient(i)
        end do
    end subroutine add_row

    !> matrix := matrix + weight block.
    pure subroutine add_block(c, column, weight, block, matrix)
        !> The rows of the block's entries, 0 for one that goes nowhere, and their columns.
        integer, intent(in) :: c(n_local), column(n_local)
        real(wp), intent(in) :: weight, block(n_local, n_local)
        real(wp), intent(inout) :: matrix(:, :)
        integer :: at(n_local), i, j, k, l, n

        ! Entries with a column.
        n = 0
        do i = 1, n_local
            if (c(i) == 0) cycle
            n = n + 1
            at(n) = i
        end do
        do k = 1, n
            j = at(k)
            l = column(j)
            !GCC$ UNROLL 2
            do i = 1, n
                matrix(c(at(i)), l) = matrix(c(at(i)), l) + weight*block(at(i), j)
            end do
        end do
    end subroutine add_block

    !> block := block + weight x y'.
    pure subroutine add_outer(weight, x, y, block)
        real(wp), intent(in) :: weight, x(n_local), y(n_local)
        real(wp), intent(inout) :: block(n_local, n_local)
        integer :: j

        do j = 1, n_local
            block(:, j) = block(:, j) + weight*y(j)*x
        end do
    end subroutine add_outer

    !> Set the gradient blocks of a holonomic row; the blocks are zero before the first row.
    pure subroutine put_holonomic(need, row, c, gradient, second, lambda, derivatives)
        integer, intent(in) :: need, row, c(n_local)
        !> Phi_q with first and second derivatives along the motion; Phi_qq.
        real(wp), intent(in) :: gradient(n_local, 0:2), second(n_local, n_local)
        !> The row's multiplier.
        real(wp), intent(in) :: lambda
        type(derivatives_type), intent(inout) :: derivatives
        integer :: column(n_local)

        column = derivatives%column_of(c)
        if (iand(need, need_velocity_q) /= 0) call put_row(column, gradient(:, 1), row, derivatives%velocity_q)
        if (iand(need, need_acceleration_q) /= 0) call put_row(column, gradient(:, 2), row, derivatives%acceleration_q)
        if (iand(need, need_acceleration_qd) /= 0) call put_row(column, 2*gradient(:, 1), row, derivatives%acceleration_qd)
        if (iand(need, need_dynamics_q) /= 0) call add_block(c, column, lambda, second, derivatives%dynamics_q)
    end subroutine put_holonomic

    !> Add a weighted scalar function as part of a holonomic row that is a sum of them.
    pure subroutine add_holonomic(need, row, c, weight, gradient, second, lambda, derivatives)
        integer, intent(in) :: need, row, c(n_local)
        real(wp), intent(in) :: weight, gradient(n_local, 0:2), second(n_local, n_local), lambda
        type(derivatives_type), intent(inout) :: derivatives
        integer :: column(n_local)

        column = derivatives%column_of(c)
        if (iand(need, need_velocity_q) /= 0) call add_row(column, weight, gradient(:, 1), row, derivatives%velocity_q)
        if (iand(need, need_acceleration_q) /= 0) call add_row(column, weight, gradient(:, 2), row, derivatives%acceleration_q)
        if (iand(need, need_acceleration_qd) /= 0) call add_row(column, 2*weight, gradient(:, 1), row, derivatives%acceleration_qd)
        if (iand(need, need_dynamics_q) /= 0) call add_block(c, column, lambda*weight, second, derivatives%dynamics_q)
    end subroutine add_holonomic

    !> Add the gradient blocks of a force -f(x, xd) x_q along a scalar coordinate x.
    pure subroutine put_force(need, c, gradient, second, f, derivatives)
        integer, intent(in) :: need, c(n_local)
        !> x_q with its first derivative along the motion; x_qq.
        real(wp), intent(in) :: gradient(n_local, 0:1), second(n_local, n_local)
        !> f, f_x and f_xd.
        real(wp), intent(in) :: f(0:2)
        type(derivatives_type), intent(inout) :: derivatives
        real(wp) :: block(n_local, n_local)
        integer :: column(n_local)

        column = derivatives%column_of(c)
        if (iand(need, need_dynamics_q) /= 0) then
            block = f(0)*second
            call add_outer(1.0_wp, gradient(:, 0), f(1)*gradient(:, 0) + f(2)*gradient(:, 1), block)
            call add_block(c, column, 1.0_wp, block, derivatives%dynamics_q)
        end if
        if (iand(need, need_dynamics_qd) /= 0) then
            block = 0.0_wp
            call add_outer(f(2), gradient(:, 0), gradient(:, 0), block)
            call add_block(c, column, 1.0_wp, block, derivatives%dynamics_qd)
        end if
    end subroutine put_force
end module tandem_mechanism_pair
