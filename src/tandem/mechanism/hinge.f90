! SPDX-License-Identifier: MIT
!> Hinges in space, the joint that large mechanisms have most: two points that meet and a direction of the second body that stays
!> perpendicular to two of the first,
!>     Phi = [r2 + A2 s2' - r1 - A1 s1'; (A1 x').(A2 z'); (A1 y').(A2 z')].
!> These five rows stand among the meetings and the dots too, where derivatives take them from. Here they are evaluated `lane`
!> hinges at a time, straight from q and qd: every number below is one of each hinge of a group, so that loops fill vector
!> registers.
module tandem_mechanism_hinge
    use tandem_kinds, only: lane, wp
    use tandem_mechanism_dot, only: dot_type
    use tandem_mechanism_pose, only: pose_type
    use tandem_mechanism_span, only: span_type
    use tandem_model_terms, only: need_gamma, need_jacobian, need_phi, terms_type
    use tandem_rigid_euler_lanes, only: set_dots, set_gradient_rows, set_gradients, set_rotation_rates, set_rotations, take_four, &
        turn_each
    implicit none (type, external)
    private

    public :: hinge_group_type, gather_hinges, place_hinges, evaluate_hinges

    !> So many hinges; those behind the last one repeat it and go nowhere.
    type :: hinge_group_type
        integer :: n = 0
        !> The first and the second bodies, 0 for the ground; whether any of them is that; before which coordinate each begins, and
        !> before which column of the C that is set.
        integer :: body(lane, 2) = 0
        logical :: has_ground(2) = .false.
        integer :: before(lane, 2) = 0, column(lane, 2) = 0
        !> The first rows.
        integer :: row(lane) = 0
        !> -s1' and s2', and the directions, each in its body's frame.
        real(wp) :: s(lane, 3, 2) = 0.0_wp, x(lane, 3) = 0.0_wp, y(lane, 3) = 0.0_wp, z(lane, 3) = 0.0_wp
    end type hinge_group_type

contains

    !> The meetings that two dots behind them make hinges, and the numbers of the meetings and dots that are left.
    pure subroutine gather_hinges(meetings, dots, pose, n_rows, groups, loose_meetings, loose_dots)
        type(span_type), intent(in) :: meetings(:)
        type(dot_type), intent(in) :: dots(:)
        !> Of the bodies, whose coordinates are numbered; 0 the ground.
        type(pose_type), intent(in) :: pose(0:)
        !> How many rows there are.
        integer, intent(in) :: n_rows
        type(hinge_group_type), allocatable, intent(out) :: groups(:)
        integer, allocatable, intent(out) :: loose_meetings(:), loose_dots(:)
        integer :: dot_of_row(n_rows + 2), i, n
        logical :: is_hinge(size(meetings)), is_taken(size(dots))

        dot_of_row = 0
        do i = 1, size(dots)
            dot_of_row(dots(i)%row) = i
        end do
        is_taken = .false.
        do i = 1, size(meetings)
            associate (span => meetings(i))
                is_hinge(i) = is_solid(span%first) .and. is_solid(span%second) .and. span%row + 4 <= n_rows
                if (.not. is_hinge(i)) cycle
                associate (x => dot_of_row(span%row + 3), y => dot_of_row(span%row + 4))
                    is_hinge(i) = x > 0 .and. y > 0
                    if (is_hinge(i)) is_hinge(i) = fits(span, dots(x)) .and. fits(span, dots(y)) .and. &
                        .not. any(abs(dots(x)%b - dots(y)%b) > 0.0_wp)
                    if (.not. is_hinge(i)) cycle
                    is_taken([x, y]) = .true.
                end associate
            end associate
        end do
        loose_meetings = pack([(i, i=1, size(meetings))], .not. is_hinge)
        loose_dots = pack([(i, i=1, size(dots))], .not. is_taken)
        allocate (groups((count(is_hinge) + lane - 1)/lane))
        n = 0
        do i = 1, size(meetings)
            if (.not. is_hinge(i)) cycle
            call put(meetings(i), dots(dot_of_row(meetings(i)%row + 3)), dots(dot_of_row(meetings(i)%row + 4)), mod(n, lane) + 1, &
                groups(n/lane + 1))
            n = n + 1
        end do

    contains

        !> Whether a side is the ground or a body that turns in space.
        pure logical function is_solid(body)
            integer, intent(in) :: body

            is_solid = body == 0 .or. pose(body)%n_turn == 4
        end function is_solid

        !> Whether a dot is that of two directions of the bodies that meet, without a function of time.
        pure logical function fits(span, dot)
            type(span_type), intent(in) :: span
            type(dot_type), intent(in) :: dot

            fits = dot%first == span%first .and. dot%second == span%second .and. dot%motion == 0 .and. .not. dot%is_point .and. &
                .not. dot%is_turning .and. .not. abs(dot%c) > 0.0_wp
        end function fits

        !> Put a hinge in a place of a group, and in those behind it.
        pure subroutine put(span, x, y, place, group)
            type(span_type), intent(in) :: span
            type(dot_type), intent(in) :: x, y
            integer, intent(in) :: place
            type(hinge_group_type), intent(inout) :: group
            integer :: l

            group%n = place
            do l = place, lane
                group%body(l, :) = [span%first, span%second]
                group%before(l, :) = [max(pose(span%first)%place - 1, 0), max(pose(span%second)%place - 1, 0)]
                group%row(l) = span%row
                group%s(l, :, 1) = -span%s1
                group%s(l, :, 2) = span%s2
                group%x(l, :) = x%a
                group%y(l, :) = y%a
                group%z(l, :) = y%b
            end do
            group%has_ground = [any(group%body(:, 1) == 0), any(group%body(:, 2) == 0)]
        end subroutine put
    end subroutine gather_hinges

    !> Take note of the columns of C that the poses say.
    pure subroutine place_hinges(pose, groups)
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
    end subroutine place_hinges

    !> Every hinge's part of the terms. What of C is not set here stays zero, as it was allocated.
    pure subroutine evaluate_hinges(groups, need, n, q, qd, terms)
        type(hinge_group_type), intent(in) :: groups(:)
        integer, intent(in) :: need, n
        !> (n) each; qd may be anything where gamma is not wanted.
        real(wp), intent(in) :: q(n), qd(n)
        type(terms_type), intent(inout) :: terms
        integer :: i

        if (iand(need, need_phi) /= 0) then
            do i = 1, size(groups)
                call set_phi(groups(i), n, q, terms%phi)
            end do
        end if
        if (iand(need, need_jacobian) /= 0) then
            do i = 1, size(groups)
                call set_rows(groups(i), n, q, size(terms%jacobian, 1), size(terms%jacobian, 2), terms%jacobian)
            end do
        end if
        if (iand(need, need_gamma) /= 0) then
            do i = 1, size(groups)
                call set_gamma(groups(i), n, q, qd, terms%gamma)
            end do
        end if
    end subroutine evaluate_hinges

    pure subroutine set_phi(group, n, q, phi)
        type(hinge_group_type), intent(in) :: group
        integer, intent(in) :: n
        real(wp), intent(in) :: q(n)
        real(wp), intent(inout) :: phi(*)
        real(wp) :: a(lane, 3, 3), p(lane, 4), r(lane, 4, 2), v(lane, 3, 2), x(lane, 3), y(lane, 3), z(lane, 3), w(lane, 5)
        integer :: k, l

        call take_place(group, 1, n, q, r(:, :, 1))
        call take_place(group, 2, n, q, r(:, :, 2))
        call take_turn(group, 1, 1.0_wp, n, q, p)
        call set_rotations(p, a)
        call turn_each(a, group%s(:, :, 1), v(:, :, 1))
        call turn_each(a, group%x, x)
        call turn_each(a, group%y, y)
        call take_turn(group, 2, 1.0_wp, n, q, p)
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
        call put_each(group, w, phi)
    end subroutine set_phi

    !> The five rows of C.
    pure subroutine set_rows(group, n, q, m, width, jacobian)
        type(hinge_group_type), intent(in) :: group
        integer, intent(in) :: n
        real(wp), intent(in) :: q(n)
        !> The shape of the C that is set, which may be compressed.
        integer, intent(in) :: m, width
        real(wp), intent(inout) :: jacobian(m, width)
        real(wp) :: a(lane, 3, 3), b(lane, 3, 4), of_x(lane, 4), of_y(lane, 4), p1(lane, 4), p2(lane, 4)
        real(wp), dimension(lane, 3) :: x, y, z

        call take_turn(group, 1, 1.0_wp, n, q, p1)
        call take_turn(group, 2, 1.0_wp, n, q, p2)
        call set_rotations(p1, a)
        call turn_each(a, group%x, x)
        call turn_each(a, group%y, y)
        call set_rotations(p2, a)
        call turn_each(a, group%z, z)
        call set_gradients(p1, group%s(:, :, 1), b)
        call set_gradient_rows(p1, group%x, z, of_x)
        call set_gradient_rows(p1, group%y, z, of_y)
        call put_side(group, 1, -1.0_wp, b, of_x, of_y, m, width, jacobian)
        call set_gradients(p2, group%s(:, :, 2), b)
        call set_gradient_rows(p2, group%z, x, of_x)
        call set_gradient_rows(p2, group%z, y, of_y)
        call put_side(group, 2, 1.0_wp, b, of_x, of_y, m, width, jacobian)
    end subroutine set_rows

    !> The columns of one of the bodies: its place enters with a sign, its Euler parameters by b and two rows.
    pure subroutine put_side(group, side, sign, b, of_x, of_y, m, width, jacobian)
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
    end subroutine put_side

    !> The second derivatives of Phi along the motion without qdd: that of A is M(pd, pd) = 2 A(pd).
    pure subroutine set_gamma(group, n, q, qd, gamma)
        type(hinge_group_type), intent(in) :: group
        integer, intent(in) :: n
        real(wp), intent(in) :: q(n), qd(n)
        real(wp), intent(inout) :: gamma(*)
        real(wp) :: a(lane, 3, 3), p(lane, 4), pd(lane, 4), v1(lane, 3), v2(lane, 3), w(lane, 5), of_x(lane), of_y(lane)
        real(wp), dimension(lane, 3, 0:2) :: x, y, z
        integer :: k, l

        call take_turn(group, 1, 1.0_wp, n, q, p)
        call take_turn(group, 1, 0.0_wp, n, qd, pd)
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
        call take_turn(group, 2, 1.0_wp, n, q, p)
        call take_turn(group, 2, 0.0_wp, n, qd, pd)
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
        call put_each(group, w, gamma)
    end subroutine set_gamma

    !> Euler parameters of the bodies of a side, or their rates; those of the ground are (real part, 0, 0, 0).
    pure subroutine take_turn(group, side, real_part, n, q, p)
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
    end subroutine take_turn

    !> Their places, and a fourth entry that stands for nothing.
    pure subroutine take_place(group, side, n, q, r)
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
    end subroutine take_place

    !> Five entries of each hinge where its rows are.
    pure subroutine put_each(group, w, x)
        type(hinge_group_type), intent(in) :: group
        real(wp), intent(in) :: w(lane, 5)
        real(wp), intent(inout) :: x(*)
        integer :: k, l

        do l = 1, group%n
            do k = 1, 5
                x(group%row(l) + k - 1) = w(l, k)
            end do
        end do
    end subroutine put_each
end module tandem_mechanism_hinge
