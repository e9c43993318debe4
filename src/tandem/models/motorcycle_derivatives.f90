! SPDX-License-Identifier: MIT
!> The derivatives of the motorcycle's terms.
submodule(tandem_models_motorcycle) tandem_models_motorcycle_derivatives
    use tandem_model_derivatives, only: need_acceleration_q, need_acceleration_qd, need_dynamics_q, need_dynamics_qd, &
        need_velocity_q
    use tandem_rigid_euler_parameters, only: g_sandwich, k_matrix, t_matrix
    implicit none (type, external)

    real(wp), parameter :: uy(3) = [0.0_wp, 1.0_wp, 0.0_wp], uz(3) = [0.0_wp, 0.0_wp, 1.0_wp]

contains

    !> The gradients of the velocity and acceleration constraints and of the equations of motion.
    module subroutine evaluate_derivatives(self, need, t, q, qd, qdd, lambda, derivatives, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:), qdd(:), lambda(:)
        type(derivatives_type), intent(inout) :: derivatives
        integer, intent(out) :: stat

        stat = 0
        select type (self)
        class is (motorcycle_type)
            call self%turn_fork(t)
            if (iand(need, need_velocity_q + need_acceleration_q + need_acceleration_qd) /= 0) then
                call differentiate_rear(self, need, q, qd, qdd, derivatives)
                call differentiate_front(self, need, q, qd, qdd, derivatives)
            end if
            if (iand(need, need_dynamics_q) /= 0) call differentiate_dynamics(self, t, q, qd, qdd, lambda, derivatives%dynamics_q)
            if (iand(need, need_dynamics_qd) /= 0) then
                derivatives%dynamics_qd = 0.0_wp
                derivatives%dynamics_qd(4:7, 4:7) = 8*g_sandwich(qd(4:7), self%inertia, q(4:7)) &
                    - 8*t_matrix(self%inertia*g_product(qd(4:7), q(4:7)))
                derivatives%dynamics_qd(10, 10) = self%damping
            end if
        end select
    end subroutine evaluate_derivatives

    !> velocity_q, acceleration_q, acceleration_qd: the rows of the rear wheels, of the parameters' norms, and of the rear axle.
    subroutine differentiate_rear(self, need, q, qd, qdd, derivatives)
        class(motorcycle_type), intent(in) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: q(:), qd(:), qdd(:)
        type(derivatives_type), intent(inout) :: derivatives
        real(wp), dimension(3) :: rear, right, left, n, nd, v, a
        real(wp) :: p(4), pd(4), pdd(4), frame(3, 3), axle(3, 4), block(3, 4)

        p = q(4:7)
        pd = qd(4:7)
        pdd = qdd(4:7)
        rear = [0.0_wp, -self%rear_length, 0.0_wp]
        right = rear + self%half_track*ux
        left = rear - self%half_track*ux
        ! The axle's direction and its gradient by p, velocity and acceleration of its middle.
        frame = rotation(p)
        n = frame(:, 1)
        nd = b_product(p, ux, pd)
        v = qd(1:3) + b_product(p, rear, pd)
        a = qdd(1:3) + b_product(p, rear, pdd) + b_product(pd, rear, pd)
        axle = b_matrix(p, ux)
        if (iand(need, need_velocity_q) /= 0) then
            associate (d => derivatives%velocity_q)
                d = 0.0_wp
                block = b_matrix(pd, right)
                d(1, 4:7) = block(3, :)
                block = b_matrix(pd, left)
                d(2, 4:7) = block(3, :)
                d(5, 4:7) = pd
                d(6, 8:9) = qd(8:9)
                d(7, 4:7) = along(v, axle) + along(n, b_matrix(pd, rear))
            end associate
        end if
        if (iand(need, need_acceleration_q) /= 0) then
            associate (d => derivatives%acceleration_q)
                d = 0.0_wp
                block = b_matrix(pdd, right)
                d(1, 4:7) = block(3, :)
                block = b_matrix(pdd, left)
                d(2, 4:7) = block(3, :)
                d(5, 4:7) = pdd
                d(6, 8:9) = qdd(8:9)
                d(7, 4:7) = along(a, axle) + along(n, b_matrix(pdd, rear)) + along(v, b_matrix(pd, ux)) + &
                    along(nd, b_matrix(pd, rear))
            end associate
        end if
        if (iand(need, need_acceleration_qd) /= 0) then
            associate (d => derivatives%acceleration_qd)
                d = 0.0_wp
                block = b_matrix(pd, right)
                d(1, 4:7) = 2*block(3, :)
                block = b_matrix(pd, left)
                d(2, 4:7) = 2*block(3, :)
                d(5, 4:7) = 2*pd
                d(6, 8:9) = 2*qd(8:9)
                d(7, 1:3) = nd
                d(7, 4:7) = 2*along(n, b_matrix(pd, rear)) + along(v, axle) + along(nd, b_matrix(p, rear))
            end associate
        end if
    end subroutine differentiate_rear

    !> The same, the rows of the front wheel, after those. Its contact point is r + A b + a1 (A y1) + (a2 - s) (A es), its rim's
    !> tangent a1 (A es) - a2 (A y1), so that their gradients by a and s are A y1 and A es and their time derivatives.
    subroutine differentiate_front(self, need, q, qd, qdd, derivatives)
        class(motorcycle_type), intent(in) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: q(:), qd(:), qdd(:)
        type(derivatives_type), intent(inout) :: derivatives
        type(fork_type) :: f
        real(wp) :: p(4), pd(4), pdd(4), a(3, 3)
        real(wp), dimension(3) :: y, z, yd, zd, ydd, zdd, y1, es, y1d, esd, y1dd, esdd, v_front, a_front, g, gd, k, kd
        real(wp), dimension(3, 4) :: front_p, tangent_p, front_vp, tangent_vp, block

        p = q(4:7)
        pd = qd(4:7)
        pdd = qdd(4:7)
        f = self%f
        a = rotation(p)
        y = [0.0_wp, self%fork_forward, self%fork_height] + q(8)*f%y1 + (q(9) - q(10))*f%es
        z = q(8)*f%es - q(9)*f%y1
        call move_fork(f, q, qd, yd, zd)
        call bend_fork(f, q, qd, ydd, zdd)
        ydd = ydd + qdd(8)*f%y1 + (qdd(9) - qdd(10))*f%es
        zdd = zdd + qdd(8)*f%es - qdd(9)*f%y1
        ! A y1 and A es with their first and second time derivatives.
        y1 = rotate(a, f%y1)
        es = rotate(a, f%es)
        y1d = b_product(p, f%y1, pd) + f%rate*rotate(a, f%y1_theta)
        esd = b_product(p, f%es, pd)
        y1dd = b_product(p, f%y1, pdd) + b_product(pd, f%y1, pd) + 2*f%rate*b_product(p, f%y1_theta, pd) + &
            rotate(a, f%second_rate*f%y1_theta - f%rate**2*f%y1)
        esdd = b_product(p, f%es, pdd) + b_product(pd, f%es, pd)
        ! The wheel's sideways direction; velocity and acceleration of the contact point.
        g = sideways(rotate(a, z))
        gd = sideways(b_product(p, z, pd) + rotate(a, zd))
        v_front = qd(1:3) + b_product(p, y, pd) + rotate(a, yd)
        a_front = qdd(1:3) + b_product(p, y, pdd) + rotate(a, ydd) + b_product(pd, y, pd) + 2*b_product(p, yd, pd)
        k = crossways(v_front)
        kd = crossways(a_front)
        ! Gradients by p of the positions and of the velocities of that point and of the tangent.
        front_p = b_matrix(p, y)
        tangent_p = b_matrix(p, z)
        front_vp = b_matrix(pd, y) + b_matrix(p, yd)
        tangent_vp = b_matrix(pd, z) + b_matrix(p, zd)
        if (iand(need, need_velocity_q) /= 0) then
            associate (d => derivatives%velocity_q)
                d(3, 4:7) = front_vp(3, :)
                d(3, 8:10) = [y1d(3), esd(3), -esd(3)]
                d(4, 4:7) = tangent_vp(3, :)
                d(4, 8:9) = [esd(3), -y1d(3)]
                d(8, 4:7) = along(k, tangent_p) + along(g, front_vp)
                d(8, 8:10) = [dot_product(k, es) + dot_product(g, y1d), -dot_product(k, y1) + dot_product(g, esd), &
                    -dot_product(g, esd)]
            end associate
        end if
        if (iand(need, need_acceleration_q) /= 0) then
            associate (d => derivatives%acceleration_q)
                block = b_matrix(pdd, z) + b_matrix(p, zdd) + 2*b_matrix(pd, zd)
                d(4, 4:7) = block(3, :)
                d(4, 8:9) = [esdd(3), -y1dd(3)]
                block = b_matrix(pdd, y) + b_matrix(p, ydd) + 2*b_matrix(pd, yd)
                d(3, 4:7) = block(3, :)
                d(3, 8:10) = [y1dd(3), esdd(3), -esdd(3)]
                d(8, 4:7) = along(kd, tangent_p) + along(g, block) + along(k, tangent_vp) + along(gd, front_vp)
                d(8, 8) = dot_product(kd, es) + dot_product(g, y1dd) + dot_product(k, esd) + dot_product(gd, y1d)
                d(8, 9) = -dot_product(kd, y1) + dot_product(g, esdd) - dot_product(k, y1d) + dot_product(gd, esd)
                d(8, 10) = -dot_product(g, esdd) - dot_product(gd, esd)
            end associate
        end if
        if (iand(need, need_acceleration_qd) /= 0) then
            associate (d => derivatives%acceleration_qd)
                d(3, 4:7) = 2*front_vp(3, :)
                d(3, 8:10) = 2*[y1d(3), esd(3), -esd(3)]
                d(4, 4:7) = 2*tangent_vp(3, :)
                d(4, 8:9) = 2*[esd(3), -y1d(3)]
                d(8, 1:3) = gd
                d(8, 4:7) = 2*along(g, front_vp) + along(k, tangent_p) + along(gd, front_p)
                d(8, 8) = 2*dot_product(g, y1d) + dot_product(k, es) + dot_product(gd, y1)
                d(8, 9) = 2*dot_product(g, esd) - dot_product(k, y1) + dot_product(gd, es)
                d(8, 10) = -2*dot_product(g, esd) - dot_product(gd, es)
            end associate
        end if
    end subroutine differentiate_front

    !> The gradient dynamics_q: M2(q, qdd) - S_q - Q_Aq + (C' lambda)_q. The contact forces act at the front point along
    !> lambda3 uz + lambda8 g, whose g turns with the tangent, and at the rear axle along lambda7 A ux.
    pure subroutine differentiate_dynamics(self, t, q, qd, qdd, lambda, d)
        class(motorcycle_type), intent(in) :: self
        real(wp), intent(in) :: t, q(:), qd(:), qdd(:), lambda(:)
        real(wp), intent(out) :: d(:, :)
        type(fork_type) :: f
        real(wp) :: p(4), a(3, 3), y(3), z(3), rear(3), y1(3), es(3), push(3)
        real(wp) :: rear_p(3, 4), front_p(3, 4), turn_p(3, 4), turn_1(3), turn_2(3), axle(3, 4), y1_p(3, 4), es_p(3, 4), row(4)
        integer :: i, j

        p = q(4:7)
        f = self%f
        a = rotation(p)
        rear = [0.0_wp, -self%rear_length, 0.0_wp]
        y = [0.0_wp, self%fork_forward, self%fork_height] + q(8)*f%y1 + (q(9) - q(10))*f%es
        z = q(8)*f%es - q(9)*f%y1
        y1 = rotate(a, f%y1)
        es = rotate(a, f%es)
        y1_p = b_matrix(p, f%y1)
        es_p = b_matrix(p, f%es)
        rear_p = b_matrix(p, rear)
        front_p = b_matrix(p, y)
        axle = b_matrix(p, ux)
        push = lambda(3)*uz + lambda(8)*sideways(rotate(a, z))
        ! Gradients of lambda8 g by p, a1 and a2.
        turn_p = b_matrix(p, z)
        do j = 1, 4
            turn_p(:, j) = lambda(8)*sideways(turn_p(:, j))
        end do
        turn_1 = lambda(8)*sideways(es)
        turn_2 = -lambda(8)*sideways(y1)

        d = 0.0_wp
        d(1:3, 4:7) = lambda(7)*axle + turn_p
        d(1:3, 8) = turn_1
        d(1:3, 9) = turn_2
        d(4:7, 4:7) = 4*t_matrix(self%inertia*g_product(p, qdd(4:7))) - 4*g_sandwich(p, self%inertia, qdd(4:7)) &
            - 8*g_sandwich(qd(4:7), self%inertia, qd(4:7)) &
            + lambda(1)*k_matrix(rear + self%half_track*ux, uz) + lambda(2)*k_matrix(rear - self%half_track*ux, uz) &
            + k_matrix(y, push) + lambda(4)*k_matrix(z, uz) + lambda(7)*k_matrix(rear, a(:, 1))
        do j = 1, 4
            d(3 + j, 3 + j) = d(3 + j, 3 + j) + lambda(5)
            do i = 1, 4
                d(3 + i, 3 + j) = d(3 + i, 3 + j) + dot_product(front_p(:, i), turn_p(:, j)) + &
                    lambda(7)*dot_product(rear_p(:, i), axle(:, j))
            end do
        end do
        d(4:7, 8) = along(push, y1_p) + lambda(4)*es_p(3, :) + along(turn_1, front_p)
        d(4:7, 9) = along(push, es_p) - lambda(4)*y1_p(3, :) + along(turn_2, front_p)
        d(4:7, 10) = -along(push, es_p)
        d(8, 4:7) = along(push, y1_p) + lambda(4)*es_p(3, :) + along(y1, turn_p)
        d(8, 8) = lambda(6) + dot_product(y1, turn_1)
        d(8, 9) = dot_product(y1, turn_2)
        row = along(push, es_p) + along(es, turn_p)
        d(9, 4:7) = row - lambda(4)*y1_p(3, :)
        d(9, 8) = dot_product(es, turn_1)
        d(9, 9) = lambda(6) + dot_product(es, turn_2)
        d(10, 4:7) = -row
        d(10, 8) = -dot_product(es, turn_1)
        d(10, 9) = -dot_product(es, turn_2)
        d(10, 10) = self%stiffness
        if (abs(self%driving_force) > 0.0_wp) then
            d(1:3, 4:7) = d(1:3, 4:7) - self%driving_force*b_matrix(p, uy)
            d(4:7, 4:7) = d(4:7, 4:7) - 2*self%wheel_radius*self%driving_force*t_matrix(ux)
        end if
    end subroutine differentiate_dynamics

    !> a' B (4).
    pure function along(a, block) result(row)
        real(wp), intent(in) :: a(3), block(3, 4)
        real(wp) :: row(4)

        row = a(1)*block(1, :) + a(2)*block(2, :) + a(3)*block(3, :)
    end function along

    !> uz x b: dot_product(sideways(a), b) = dot_product(a, crossways(b)).
    pure function crossways(b) result(c)
        real(wp), intent(in) :: b(3)
        real(wp) :: c(3)

        c = [-b(2), b(1), 0.0_wp]
    end function crossways
end submodule tandem_models_motorcycle_derivatives
