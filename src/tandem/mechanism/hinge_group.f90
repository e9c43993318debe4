! SPDX-License-Identifier: MIT
!> Hinges in space (`tandem_mechanism_hinge`) in large mechanisms: evaluates `lane` hinges at a time, directly from q and qd. Each
!> array has one entry per hinge of a group, so that loops fill vector registers.
module tandem_mechanism_hinge_group
    use tandem_kinds, only: lane, wp
    use tandem_mechanism_hinge, only: hinge_type
    use tandem_mechanism_pose, only: pose_type
    use tandem_model_pattern, only: pattern_type
    use tandem_model_terms, only: need_gamma, need_jacobian, need_phi, terms_type
    use tandem_rigid_euler_lanes, only: set_dots, set_gradient_rows, set_gradients, set_rotation_rates, set_rotations, take_four, &
        turn_each
    implicit none (type, external)
    private

    public :: hinge_group_type, gather_hinge_groups, place_hinge_groups, find_hinge_blocks, evaluate_hinge_groups

    !> A group of n hinges. The last one is repeated to fill the group; results of the copies are discarded.
    type :: hinge_group_type
        integer :: n = 0
        !> For the first and the second body of each hinge: index of the body, 0 for the ground; true for a side with any ground;
        !> offset of the body's coordinates in q; offset of its columns in the stored C.
        integer :: body(lane, 2) = 0
        logical :: has_ground(2) = .false.
        integer :: before(lane, 2) = 0, column(lane, 2) = 0
        !> True if the chart stores the rows in blocks; offset of the block of each body.
        logical :: has_blocks = .false.
        integer :: block(lane, 2) = -1
        !> First row of each hinge.
        integer :: row(lane) = 0
        !> Points -s1' and s2', and the three directions, each in the frame of its own body.
        real(wp) :: s(lane, 3, 2) = 0.0_wp, x(lane, 3) = 0.0_wp, y(lane, 3) = 0.0_wp, z(lane, 3) = 0.0_wp
    end type hinge_group_type

contains

    !> Form groups of hinges.
    pure subroutine gather_hinge_groups(hinges, pose, groups)
        type(hinge_type), intent(in) :: hinges(:)
        !> Poses of the bodies, with column numbers; index 0 is the ground.
        type(pose_type), intent(in) :: pose(0:)
        type(hinge_group_type), allocatable, intent(out) :: groups(:)
        integer :: i, l

        allocate (groups((size(hinges) + lane - 1)/lane))
        do i = 1, size(hinges)
            associate (group => groups((i - 1)/lane + 1), hinge => hinges(i))
                group%n = mod(i - 1, lane) + 1
                do l = group%n, lane
                    group%body(l, :) = [hinge%first, hinge%second]
                    group%before(l, :) = [max(pose(hinge%first)%place - 1, 0), max(pose(hinge%second)%place - 1, 0)]
                    group%row(l) = hinge%row
                    group%s(l, :, 1) = -hinge%s1
                    group%s(l, :, 2) = hinge%s2
                    group%x(l, :) = hinge%x
                    group%y(l, :) = hinge%y
                    group%z(l, :) = hinge%z
                end do
                group%has_ground = [any(group%body(:, 1) == 0), any(group%body(:, 2) == 0)]
            end associate
        end do
    end subroutine gather_hinge_groups

    !> Copy the columns of C from the poses.
    pure subroutine place_hinge_groups(pose, groups)
        type(pose_type), intent(in) :: pose(0:)
        type(hinge_group_type), intent(inout) :: groups(:)
        integer :: i, l, side

        do i = 1, size(groups)
            do side = 1, 2
                do l = 1, lane
                    groups(i)%column(l, side) = pose(groups(i)%body(l, side))%place_column - 1
                end do
            end do
        end do
    end subroutine place_hinge_groups

    !> Store the offsets of the chart's blocks and mark the rows that are set in blocks. All rows of a group are set in the same
    !> way.
    pure subroutine find_hinge_blocks(pattern, groups)
        type(pattern_type), intent(inout) :: pattern
        type(hinge_group_type), intent(inout) :: groups(:)
        integer :: i, l, side

        do i = 1, size(groups)
            associate (group => groups(i))
                do side = 1, 2
                    do l = 1, lane
                        group%block(l, side) = pattern%block_of(group%row(l), 5, group%body(l, side))
                    end do
                end do
                group%has_blocks = all(group%block >= 0 .or. group%body == 0)
                if (group%has_blocks) pattern%in_blocks(group%row) = .true.
            end associate
        end do
    end subroutine find_hinge_blocks

    !> Add the terms of every hinge. Other entries of C remain zero, as allocated.
    pure subroutine evaluate_hinge_groups(groups, need, n, q, qd, terms)
        type(hinge_group_type), intent(in) :: groups(:)
        integer, intent(in) :: need, n
        !> Coordinates and velocities (n). Velocities are used only if gamma is requested.
        real(wp), intent(in) :: q(n), qd(n)
        type(terms_type), intent(inout) :: terms
        integer :: i

        if (iand(need, need_phi) /= 0) then
            do i = 1, size(groups)
                call set_phi(groups(i), n, q, size(terms%phi), terms%phi)
            end do
        end if
        if (iand(need, need_jacobian) /= 0) then
            do i = 1, size(groups)
                call set_rows(groups(i), n, q, terms)
            end do
        end if
        if (iand(need, need_gamma) /= 0) then
            do i = 1, size(groups)
                call set_gamma(groups(i), n, q, qd, size(terms%gamma), terms%gamma)
            end do
        end if
    end subroutine evaluate_hinge_groups

    !> Set the residuals of the rows.
    pure subroutine set_phi(group, n, q, m, phi)
        type(hinge_group_type), intent(in) :: group
        integer, intent(in) :: n, m
        real(wp), intent(in) :: q(n)
        real(wp), intent(inout) :: phi(m)
        real(wp) :: a(lane, 3, 3), p(lane, 4), r(lane, 4, 2), v(lane, 3, 2), x(lane, 3), y(lane, 3), z(lane, 3), w(lane, 5)
        integer :: k, l

        call load_positions(group, 1, n, q, r(:, :, 1))
        call load_positions(group, 2, n, q, r(:, :, 2))
        call load_rotations(group, 1, 1.0_wp, n, q, p)
        call set_rotations(p, a)
        call turn_each(a, group%s(:, :, 1), v(:, :, 1))
        call turn_each(a, group%x, x)
        call turn_each(a, group%y, y)
        call load_rotations(group, 2, 1.0_wp, n, q, p)
        call set_rotations(p, a)
        call turn_each(a, group%s(:, :, 2), v(:, :, 2))
        call turn_each(a, group%z, z)
        do k = 1, 3
            !GCC$ UNROLL 1
            do l = 1, lane
                w(l, k) = (r(l, k, 2) - r(l, k, 1)) + (v(l, k, 2) + v(l, k, 1))
            end do
        end do
        call set_dots(x, z, w(:, 4))
        call set_dots(y, z, w(:, 5))
        call put_each(group, w, m, phi)
    end subroutine set_phi

    !> Set the five rows of C.
    pure subroutine set_rows(group, n, q, terms)
        type(hinge_group_type), intent(in) :: group
        integer, intent(in) :: n
        real(wp), intent(in) :: q(n)
        type(terms_type), intent(inout) :: terms
        real(wp) :: a(lane, 3, 3), b(lane, 3, 4), of_x(lane, 4), of_y(lane, 4), p1(lane, 4), p2(lane, 4)
        real(wp), dimension(lane, 3) :: x, y, z

        call load_rotations(group, 1, 1.0_wp, n, q, p1)
        call load_rotations(group, 2, 1.0_wp, n, q, p2)
        call set_rotations(p1, a)
        call turn_each(a, group%x, x)
        call turn_each(a, group%y, y)
        call set_rotations(p2, a)
        call turn_each(a, group%z, z)
        call set_gradients(p1, group%s(:, :, 1), b)
        call set_gradient_rows(p1, group%x, z, of_x)
        call set_gradient_rows(p1, group%y, z, of_y)
        call put_side(group, 1, -1.0_wp, b, of_x, of_y, terms)
        call set_gradients(p2, group%s(:, :, 2), b)
        call set_gradient_rows(p2, group%z, x, of_x)
        call set_gradient_rows(p2, group%z, y, of_y)
        call put_side(group, 2, 1.0_wp, b, of_x, of_y, terms)
    end subroutine set_rows

    !> Set the columns of one body: for the position `sign` times the unit matrix, for the Euler parameters b and two rows.
    pure subroutine put_side(group, side, sign, b, of_x, of_y, terms)
        type(hinge_group_type), intent(in) :: group
        integer, intent(in) :: side
        real(wp), intent(in) :: sign, b(lane, 3, 4), of_x(lane, 4), of_y(lane, 4)
        type(terms_type), intent(inout) :: terms

        if (group%has_blocks .and. allocated(terms%blocks)) then
            call put_blocks(group, side, b, of_x, of_y, size(terms%blocks), terms%blocks)
        else
            call put_columns(group, side, sign, b, of_x, of_y, size(terms%jacobian, 1), size(terms%jacobian, 2), terms%jacobian)
        end if
    end subroutine put_side

    !> Set the columns of the rotation in the blocks of a chart. The columns of the position are constant and set before.
    pure subroutine put_blocks(group, side, b, of_x, of_y, n_entries, blocks)
        type(hinge_group_type), intent(in) :: group
        integer, intent(in) :: side, n_entries
        real(wp), intent(in) :: b(lane, 3, 4), of_x(lane, 4), of_y(lane, 4)
        real(wp), intent(inout) :: blocks(n_entries)
        integer :: j, k, l

        do l = 1, group%n
            if (group%body(l, side) == 0) cycle
            associate (at => group%block(l, side))
                do j = 1, 4
                    do k = 1, 3
                        blocks(at + 10 + 5*j + k) = b(l, k, j)
                    end do
                    blocks(at + 10 + 5*j + 4) = of_x(l, j)
                    blocks(at + 10 + 5*j + 5) = of_y(l, j)
                end do
            end associate
        end do
    end subroutine put_blocks

    !> Set the columns of one body in the stored C, which may be compressed.
    pure subroutine put_columns(group, side, sign, b, of_x, of_y, m, width, jacobian)
        type(hinge_group_type), intent(in) :: group
        integer, intent(in) :: side, m, width
        real(wp), intent(in) :: sign, b(lane, 3, 4), of_x(lane, 4), of_y(lane, 4)
        real(wp), intent(inout) :: jacobian(m, width)
        integer :: j, k, l

        do l = 1, group%n
            if (group%body(l, side) == 0) cycle
            associate (row => group%row(l), column => group%column(l, side))
                do k = 1, 3
                    jacobian(row + k - 1, column + k) = sign
                end do
                do j = 1, 4
                    do k = 1, 3
                        jacobian(row + k - 1, column + 3 + j) = b(l, k, j)
                    end do
                    jacobian(row + 3, column + 3 + j) = of_x(l, j)
                    jacobian(row + 4, column + 3 + j) = of_y(l, j)
                end do
            end associate
        end do
    end subroutine put_columns

    !> Second derivatives of Phi along the motion for qdd = 0; for the matrix A this is M(pd, pd) = 2 A(pd).
    pure subroutine set_gamma(group, n, q, qd, m, gamma)
        type(hinge_group_type), intent(in) :: group
        integer, intent(in) :: n, m
        real(wp), intent(in) :: q(n), qd(n)
        real(wp), intent(inout) :: gamma(m)
        real(wp) :: a(lane, 3, 3), p(lane, 4), pd(lane, 4), v1(lane, 3), v2(lane, 3), w(lane, 5), of_x(lane), of_y(lane)
        real(wp), dimension(lane, 3, 0:2) :: x, y, z
        integer :: k, l

        call load_rotations(group, 1, 1.0_wp, n, q, p)
        call load_rotations(group, 1, 0.0_wp, n, qd, pd)
        call set_rotations(p, a)
        call turn_each(a, group%x, x(:, :, 0))
        call turn_each(a, group%y, y(:, :, 0))
        call set_rotation_rates(p, pd, a)
        call turn_each(a, group%x, x(:, :, 1))
        call turn_each(a, group%y, y(:, :, 1))
        call set_rotations(pd, a)
        call turn_each(a, group%s(:, :, 1), v1)
        call turn_each(a, group%x, x(:, :, 2))
        call turn_each(a, group%y, y(:, :, 2))
        call load_rotations(group, 2, 1.0_wp, n, q, p)
        call load_rotations(group, 2, 0.0_wp, n, qd, pd)
        call set_rotations(p, a)
        call turn_each(a, group%z, z(:, :, 0))
        call set_rotation_rates(p, pd, a)
        call turn_each(a, group%z, z(:, :, 1))
        call set_rotations(pd, a)
        call turn_each(a, group%s(:, :, 2), v2)
        call turn_each(a, group%z, z(:, :, 2))
        do k = 1, 3
            !GCC$ UNROLL 1
            do l = 1, lane
                w(l, k) = 2*(v1(l, k) + v2(l, k))
            end do
        end do
        do k = 0, 2
            call set_dots(x(:, :, 2 - k), z(:, :, k), of_x)
            call set_dots(y(:, :, 2 - k), z(:, :, k), of_y)
            if (k == 0) then
                w(:, 4) = of_x
                w(:, 5) = of_y
            else
                w(:, 4) = w(:, 4) + of_x
                w(:, 5) = w(:, 5) + of_y
            end if
        end do
        w(:, 4) = 2*w(:, 4)
        w(:, 5) = 2*w(:, 5)
        call put_each(group, w, m, gamma)
    end subroutine set_gamma

    !> Euler parameters of the bodies of a side, or their rates. The ground has the values (real_part, 0, 0, 0).
    pure subroutine load_rotations(group, side, real_part, n, q, p)
        type(hinge_group_type), intent(in) :: group
        integer, intent(in) :: side, n
        real(wp), intent(in) :: real_part, q(n)
        real(wp), intent(out) :: p(lane, 4)
        integer :: l

        call take_four(group%before(:, side), 3, n, q, p)
        if (.not. group%has_ground(side)) return
        do l = 1, lane
            if (group%body(l, side) > 0) cycle
            p(l, 1) = real_part
            p(l, 2:4) = 0.0_wp
        end do
    end subroutine load_rotations

    !> Positions of the bodies of a side, padded to four entries.
    pure subroutine load_positions(group, side, n, q, r)
        type(hinge_group_type), intent(in) :: group
        integer, intent(in) :: side, n
        real(wp), intent(in) :: q(n)
        real(wp), intent(out) :: r(lane, 4)
        integer :: l

        call take_four(group%before(:, side), 0, n, q, r)
        if (.not. group%has_ground(side)) return
        do l = 1, lane
            if (group%body(l, side) == 0) r(l, :) = 0.0_wp
        end do
    end subroutine load_positions

    !> Store the five entries of each hinge in its rows.
    pure subroutine put_each(group, w, m, x)
        type(hinge_group_type), intent(in) :: group
        real(wp), intent(in) :: w(lane, 5)
        integer, intent(in) :: m
        real(wp), intent(inout) :: x(m)
        integer :: k, l

        do l = 1, group%n
            do k = 1, 5
                x(group%row(l) + k - 1) = w(l, k)
            end do
        end do
    end subroutine put_each
end module tandem_mechanism_hinge_group
