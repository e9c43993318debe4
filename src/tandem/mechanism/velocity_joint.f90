! SPDX-License-Identifier: MIT
!> Velocity-level rows of joints: along an axis fixed to the second body, the velocity of the second body's point relative to the
!> first body is e(t); or about this axis, the angular velocity of the second body relative to the first is e(t).
!>
!> With a = A2 a', D = r2 + A2 s' - r1 and n = D x a, the row of a displacement is V = a.(rd2 - rd1) + (s' x a').w2' - n.w1 - e,
!> where w1 = 2 E(p1) pd1 is in the world frame and w2' = 2 G(p2) pd2 in the body frame. The row of a rotation is V = a'.w2' - n.w1
!> - e with n = a. The gradient blocks follow from V_q, its derivative along the motion, and the derivative of the row's
!> coefficients (section 15 of doc/theory.md).
module tandem_mechanism_velocity_joint
    use tandem_kinds, only: wp
    use tandem_mechanism_pair, only: add_block, columns, columns_of_c, n_local, place_1, place_2, put_row, turn_1, turn_2
    use tandem_mechanism_pose, only: gradient_matrix, gradient_of, pose_type, turned
    use tandem_mechanism_vector, only: cross
    use tandem_model_derivatives, only: derivatives_type, need_acceleration_q, need_acceleration_qd, need_dynamics_q, &
        need_velocity_q
    use tandem_model_terms, only: need_gamma, need_jacobian, need_nu, terms_type
    use tandem_rigid_euler_parameters, only: e_product, e_transposed_gradient, e_transposed_product, g_transposed_product, &
        skew, t_matrix
    implicit none (type, external)
    private

    public :: velocity_joint_type, evaluate_velocity_joints, differentiate_velocity_joints, put_nonholonomic, body_moment_row, &
        world_moment_row, angular_velocity

    type :: velocity_joint_type
        !> Bodies, 0 for the ground; row of C.
        integer :: first = 0, second = 0, row = 0
        !> True for a displacement, false for a rotation.
        logical :: is_displacement = .false.
        !> a', s', and s' x a' (a' for a rotation), in the frame of the second body.
        real(wp) :: axis(3) = 0.0_wp, point(3) = 0.0_wp, moment(3) = 0.0_wp
        !> Index of the function whose rate is e; 0 if none.
        integer :: motion = 0
    end type velocity_joint_type

contains

    !> Coefficients of the rates of the rotation in moment.w' for a moment fixed in the body frame, or their k-th derivative along
    !> the motion.
    pure function body_moment_row(body, k, moment) result(part)
        type(pose_type), intent(in) :: body
        integer, intent(in) :: k
        real(wp), intent(in) :: moment(3)
        real(wp) :: part(4)

        part = 0.0_wp
        if (body%n_turn == 4) then
            part = 2*g_transposed_product(body%p(:, k), moment)
        else if (body%n_turn == 1 .and. k == 0) then
            part(1) = moment(3)
        end if
    end function body_moment_row

    !> Coefficients of the rates of the rotation in moment.w for a moment fixed in the world frame, or their k-th derivative along
    !> the motion.
    pure function world_moment_row(body, k, moment) result(part)
        type(pose_type), intent(in) :: body
        integer, intent(in) :: k
        real(wp), intent(in) :: moment(3)
        real(wp) :: part(4)

        part = 0.0_wp
        if (body%n_turn == 4) then
            part = 2*e_transposed_product(body%p(:, k), moment)
        else if (body%n_turn == 1 .and. k == 0) then
            part(1) = moment(3)
        end if
    end function world_moment_row

    !> Angular velocity in the world frame (k = 0), or its derivative (k = 1).
    pure function angular_velocity(body, k) result(w)
        type(pose_type), intent(in) :: body
        integer, intent(in) :: k
        real(wp) :: w(3)

        w = 0.0_wp
        if (body%n_turn == 4) then
            ! E(pd) pd = 0.
            w = 2*e_product(body%p(:, 0), body%p(:, k + 1))
        else if (body%n_turn == 1) then
            w(3) = body%p(1, k + 1)
        end if
    end function angular_velocity

    !> n, with its derivative along the motion if `last` is 1.
    pure subroutine lever(velocity_joint, one, two, last, a, d, n)
        type(velocity_joint_type), intent(in) :: velocity_joint
        type(pose_type), intent(in) :: one, two
        integer, intent(in) :: last
        !> a and D, also with derivatives.
        real(wp), intent(inout) :: a(3, 0:1), d(3, 0:1), n(3, 0:1)
        integer :: k

        do k = 0, last
            a(:, k) = turned(two, k, velocity_joint%axis)
            if (.not. velocity_joint%is_displacement) then
                n(:, k) = a(:, k)
                cycle
            end if
            d(:, k) = two%r(:, k) + turned(two, k, velocity_joint%point) - one%r(:, k)
            n(:, k) = cross(d(:, 0), a(:, k))
            if (k == 1) n(:, 1) = n(:, 1) + cross(d(:, 1), a(:, 0))
        end do
    end subroutine lever

    !> Add the terms of every row.
    pure subroutine evaluate_velocity_joints(velocity_joints, need, pose, f, terms)
        type(velocity_joint_type), intent(in) :: velocity_joints(:)
        integer, intent(in) :: need
        type(pose_type), intent(in) :: pose(0:)
        !> Values and derivatives of the functions of time.
        real(wp), intent(in), contiguous :: f(0:, :)
        type(terms_type), intent(inout) :: terms
        real(wp) :: a(3, 0:1), d(3, 0:1), n(3, 0:1), row(n_local), w(3)
        integer :: i

        if (iand(need, need_jacobian + need_gamma + need_nu) == 0) return
        do i = 1, size(velocity_joints)
            associate (velocity_joint => velocity_joints(i), one => pose(velocity_joints(i)%first), &
                two => pose(velocity_joints(i)%second))
                if (iand(need, need_jacobian + need_gamma) /= 0) then
                    call lever(velocity_joint, one, two, merge(1, 0, iand(need, need_gamma) /= 0), a, d, n)
                end if
                if (iand(need, need_jacobian) /= 0) then
                    row = 0.0_wp
                    if (velocity_joint%is_displacement) then
                        row(place_1 + 1:place_1 + 3) = -a(:, 0)
                        row(place_2 + 1:place_2 + 3) = a(:, 0)
                    end if
                    row(turn_1 + 1:turn_1 + 4) = -world_moment_row(one, 0, n(:, 0))
                    row(turn_2 + 1:turn_2 + 4) = body_moment_row(two, 0, velocity_joint%moment)
                    call put_row(columns_of_c(one, two), row, velocity_joint%row, terms%jacobian)
                end if
                if (iand(need, need_nu) /= 0) then
                    terms%nu(velocity_joint%row) = 0.0_wp
                    if (velocity_joint%motion > 0) terms%nu(velocity_joint%row) = f(1, velocity_joint%motion)
                end if
                if (iand(need, need_gamma) /= 0) then
                    ! G(pd) pd = 0 and E(pd) pd = 0.
                    w = angular_velocity(one, 0)
                    terms%gamma(velocity_joint%row) = -sum(n(:, 1)*w)
                    if (velocity_joint%is_displacement) terms%gamma(velocity_joint%row) = terms%gamma(velocity_joint%row) + &
                        sum(a(:, 1)*(two%r(:, 1) - one%r(:, 1)))
                    if (velocity_joint%motion > 0) terms%gamma(velocity_joint%row) = terms%gamma(velocity_joint%row) - f(2, &
                        velocity_joint%motion)
                end if
            end associate
        end do
    end subroutine evaluate_velocity_joints

    !> Add the requested gradient blocks of every row.
    pure subroutine differentiate_velocity_joints(velocity_joints, need, pose, lambda, derivatives)
        type(velocity_joint_type), intent(in) :: velocity_joints(:)
        integer, intent(in) :: need
        type(pose_type), intent(in) :: pose(0:)
        real(wp), intent(in) :: lambda(:)
        type(derivatives_type), intent(inout) :: derivatives
        real(wp) :: a(3, 0:1), d(3, 0:1), n(3, 0:1), w(3, 0:1), v(3, 0:1), aw(3, 0:1), wd(3, 0:1), minus(3)
        real(wp) :: v_q(n_local, 0:1), v_p(4, 0:1), e_rate(n_local), block(n_local, n_local), b_a(3, 4), b_n(3, 4), e_a(4, 3), &
            column(3)
        integer :: i, j, k, c(n_local)

        do i = 1, size(velocity_joints)
            associate (velocity_joint => velocity_joints(i), one => pose(velocity_joints(i)%first), &
                two => pose(velocity_joints(i)%second))
                c = columns(one, two)
                call lever(velocity_joint, one, two, 1, a, d, n)
                do k = 0, 1
                    w(:, k) = angular_velocity(one, k)
                    v(:, k) = two%r(:, k + 1) - one%r(:, k + 1)
                end do
                v_q = 0.0_wp
                e_rate = 0.0_wp
                e_rate(turn_1 + 1:turn_1 + 4) = -world_moment_row(one, 1, n(:, 0)) - world_moment_row(one, 0, n(:, 1))
                e_rate(turn_2 + 1:turn_2 + 4) = body_moment_row(two, 1, velocity_joint%moment)
                ! Derivatives of -n.w1 with respect to p1, and of moment.w2' with respect to p2.
                if (one%n_turn == 4) then
                    v_q(turn_1 + 1:turn_1 + 4, 0) = world_moment_row(one, 1, n(:, 0))
                    v_q(turn_1 + 1:turn_1 + 4, 1) = world_moment_row(one, 2, n(:, 0)) + world_moment_row(one, 1, n(:, 1))
                end if
                v_p = 0.0_wp
                if (two%n_turn == 4) then
                    v_p(:, 0) = -body_moment_row(two, 1, velocity_joint%moment)
                    v_p(:, 1) = -body_moment_row(two, 2, velocity_joint%moment)
                end if
                if (velocity_joint%is_displacement) then
                    e_rate(place_1 + 1:place_1 + 3) = -a(:, 1)
                    e_rate(place_2 + 1:place_2 + 3) = a(:, 1)
                    ! n_q: -w1.(dD x a) = -dD.(a x w1), -w1.(D x da) = -da.(w1 x D).
                    aw(:, 0) = cross(a(:, 0), w(:, 0))
                    aw(:, 1) = cross(a(:, 1), w(:, 0)) + cross(a(:, 0), w(:, 1))
                    wd(:, 0) = v(:, 0) - cross(w(:, 0), d(:, 0))
                    wd(:, 1) = v(:, 1) - cross(w(:, 1), d(:, 0)) - cross(w(:, 0), d(:, 1))
                    do k = 0, 1
                        v_q(place_1 + 1:place_1 + 3, k) = aw(:, k)
                        v_q(place_2 + 1:place_2 + 3, k) = -aw(:, k)
                    end do
                    call add_turned(two, velocity_joint%point, -aw, v_p)
                    call add_turned(two, velocity_joint%axis, wd, v_p)
                else
                    call add_turned(two, velocity_joint%axis, -w, v_p)
                end if
                v_q(turn_2 + 1:turn_2 + 4, :) = v_p
                call put_nonholonomic(need, velocity_joint%row, c, v_q(:, 0), v_q(:, 1), e_rate, derivatives)
                if (iand(need, need_dynamics_q) == 0) cycle

                ! Gradients of the coefficients of the row with respect to q.
                block = 0.0_wp
                b_a = gradient_matrix(two, 0, velocity_joint%axis)
                b_n = b_a
                if (velocity_joint%is_displacement) then
                    block(place_1 + 1:place_1 + 3, turn_2 + 1:turn_2 + 4) = -b_a
                    block(place_2 + 1:place_2 + 3, turn_2 + 1:turn_2 + 4) = b_a
                    b_n = matmul(skew(d(:, 0)), b_a) - matmul(skew(a(:, 0)), gradient_matrix(two, 0, velocity_joint%point))
                    do j = 1, 3
                        ! dD x a.
                        column = 0.0_wp
                        column(j) = 1.0_wp
                        minus = cross(column, a(:, 0))
                        e_a(:, j) = world_moment_row(one, 0, minus)
                    end do
                    block(turn_1 + 1:turn_1 + 4, place_1 + 1:place_1 + 3) = e_a
                    block(turn_1 + 1:turn_1 + 4, place_2 + 1:place_2 + 3) = -e_a
                end if
                do j = 1, 4
                    block(turn_1 + 1:turn_1 + 4, turn_2 + j) = -world_moment_row(one, 0, b_n(:, j))
                end do
                if (one%n_turn == 4) block(turn_1 + 1:turn_1 + 4, turn_1 + 1:turn_1 + 4) = -2*e_transposed_gradient(n(:, 0))
                if (two%n_turn == 4) block(turn_2 + 1:turn_2 + 4, turn_2 + 1:turn_2 + 4) = 2*t_matrix(velocity_joint%moment)
                call add_block(c, derivatives%column_of(c), lambda(velocity_joint%row), block, derivatives%dynamics_q)
            end associate
        end do
    end subroutine differentiate_velocity_joints

    !> Add x.(A s')_p, and its derivative along the motion.
    pure subroutine add_turned(body, s, x, v_p)
        type(pose_type), intent(in) :: body
        real(wp), intent(in) :: s(3), x(3, 0:1)
        real(wp), intent(inout) :: v_p(4, 0:1)

        v_p(:, 0) = v_p(:, 0) + gradient_of(body, 0, s, x(:, 0))
        v_p(:, 1) = v_p(:, 1) + gradient_of(body, 1, s, x(:, 0)) + gradient_of(body, 0, s, x(:, 1))
    end subroutine add_turned

    !> Add the contributions of a velocity-level row V = E qd - e to the gradient blocks of constraints, given V_q, its derivative
    !> along the motion, and the derivative of E.
    pure subroutine put_nonholonomic(need, row, c, v_q, v_q_rate, e_rate, derivatives)
        integer, intent(in) :: need, row, c(n_local)
        real(wp), intent(in) :: v_q(n_local), v_q_rate(n_local), e_rate(n_local)
        type(derivatives_type), intent(inout) :: derivatives
        integer :: column(n_local)

        column = derivatives%column_of(c)
        if (iand(need, need_velocity_q) /= 0) call put_row(column, v_q, row, derivatives%velocity_q)
        if (iand(need, need_acceleration_q) /= 0) call put_row(column, v_q_rate, row, derivatives%acceleration_q)
        if (iand(need, need_acceleration_qd) /= 0) call put_row(column, v_q + e_rate, row, derivatives%acceleration_qd)
    end subroutine put_nonholonomic
end module tandem_mechanism_velocity_joint
