! SPDX-License-Identifier: MIT
!> Disk of section 8, which rolls without slip on the plane z = 0.
!>
!> q = (r, p, a): centre r, Euler parameters p of the disk's frame, whose x' axis is the axis of the disk, and a = (a1, a2), the
!> vector from the centre to the contact point in the plane of the disk. With alpha = (0, a1, a2) and beta = (0, -a2, a1) in the
!> frame of the disk, the contact point is r + A alpha, and the tangent of the rim there is A beta.
!>
!> The total energy is constant. The contact is bilateral: it can pull the disk down, and the disk never lifts off.
module tandem_models_rolling_disk
    use tandem_kinds, only: wp
    use tandem_model, only: label_length, model_type
    use tandem_model_derivatives, only: derivatives_type, need_acceleration_q, need_acceleration_qd, need_all_derivatives, &
        need_dynamics_q, need_dynamics_qd, need_velocity_q
    use tandem_model_terms, only: need_force, need_gamma, need_jacobian, need_mass, need_phi, terms_type
    use tandem_rigid_euler_parameters, only: b_matrix, b_product, c_matrix, g_product, g_sandwich, &
        g_transposed_product, k_matrix, rotation, rotation_rate, set_rotational_mass, t_matrix
    implicit none (type, external)
    private

    public :: rolling_disk_type

    !> The disk and its parameters. Set the parameters, then call `define`, then `start` for a consistent start.
    type, extends(model_type) :: rolling_disk_type
        !> Mass (kg).
        real(wp) :: mass = 10.0_wp
        !> Principal moments of inertia about x', y', z' (kg m^2).
        real(wp) :: inertia(3) = [5.0_wp, 2.5001_wp, 2.5001_wp]
        !> Radius (m) and acceleration due to gravity (m/s^2).
        real(wp) :: radius = 1.0_wp, gravity = 9.6_wp
    contains
        procedure :: define, start
    end type rolling_disk_type

contains

    !> Associate the procedures and set the names. To be called after the parameters are set.
    subroutine define(self)
        class(rolling_disk_type), intent(inout) :: self

        self%name = 'rolling_disk'
        self%n = 9
        self%n_holonomic = 4
        self%n_nonholonomic = 2
        self%coordinate_name = [character(len=label_length) :: 'rx', 'ry', 'rz', 'e0', 'e1', 'e2', 'e3', 'a1', 'a2']
        self%coordinate_unit = [character(len=label_length) :: 'm', 'm', 'm', '1', '1', '1', '1', 'm', 'm']
        self%holonomic_name = [character(len=label_length) :: 'contact height', 'contact tangent', 'Euler parameters', &
            'contact radius']
        self%nonholonomic_name = [character(len=label_length) :: 'no slip x', 'no slip y']
        self%multiplier_unit = [character(len=label_length) :: 'N', 'N', 'J', 'N/m', 'N', 'N']
        self%evaluate => evaluate
        self%evaluate_derivatives => evaluate_derivatives
        self%provides_derivatives = need_all_derivatives
        self%potential_energy => potential_energy
        ! Blocks: centre, Euler parameters, contact point on the rim.
        self%mass_blocks = [1, 1, 1, 4, 1, 1]
        self%provides = need_phi + need_jacobian + need_gamma + need_mass + need_force
    end subroutine define

    !> State of a disk above the origin. Its plane is tilted from the vertical y-z plane by `tilt` (rad) about y, and its angular
    !> velocity in the disk's frame is `omega` (rad/s). The other velocities follow from rolling.
    pure subroutine start(self, omega, tilt, q, qd)
        class(rolling_disk_type), intent(in) :: self
        !> Angular velocity in the disk's frame (rad/s).
        real(wp), intent(in) :: omega(3)
        !> Tilt (rad), of absolute value less than pi/2.
        real(wp), intent(in) :: tilt
        real(wp), intent(out) :: q(9), qd(9)
        real(wp) :: p(4), pd(4), a(3, 3), alpha(3), beta(3), contact(3), tangent(3), turn_rate

        p = [cos(tilt/2), 0.0_wp, sin(tilt/2), 0.0_wp]
        if (.not. abs(tilt) > 0.0_wp) p = [1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp]
        pd = 0.5_wp*g_transposed_product(p, omega)
        alpha = [0.0_wp, 0.0_wp, -self%radius]
        beta = [0.0_wp, self%radius, 0.0_wp]
        a = rotation(p)
        q(1:2) = 0.0_wp
        q(3) = -dot_product(a(3, :), alpha)
        q(4:7) = p
        q(8:9) = alpha(2:3)
        ! The contact point remains at the bottom: d/dt (uz' A beta) = 0, with betad = -turn_rate alpha and alphad = turn_rate beta.
        tangent = b_product(p, beta, pd)
        turn_rate = tangent(3)/dot_product(a(3, :), alpha)
        contact = b_product(p, alpha, pd)
        qd(1:2) = -contact(1:2)
        qd(3) = -contact(3) - turn_rate*dot_product(a(3, :), beta)
        qd(4:7) = pd
        qd(8:9) = turn_rate*beta(2:3)
    end subroutine start

    !> Evaluate the terms (106)-(110).
    subroutine evaluate(self, need, t, q, qd, terms, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type), intent(inout) :: terms
        integer, intent(out) :: stat

        stat = 0
        select type (self)
        class is (rolling_disk_type)
            if (iand(need, need_phi) /= 0) call set_phi(self, q, terms%phi)
            if (iand(need, need_jacobian) /= 0) call set_jacobian(q, terms%jacobian)
            if (iand(need, need_gamma) /= 0) call set_gamma(q, qd, terms%gamma)
            if (iand(need, need_mass) /= 0) call set_mass(self, q, terms%mass)
            if (iand(need, need_force) /= 0) call set_force(self, q, qd, terms%force)
        end select
    end subroutine evaluate

    !> Phi (106).
    pure subroutine set_phi(self, q, phi)
        class(rolling_disk_type), intent(in) :: self
        real(wp), intent(in) :: q(:)
        real(wp), intent(out) :: phi(4)
        real(wp) :: a32, a33

        a32 = 2*(q(7)*q(6) + q(4)*q(5))
        a33 = q(4)**2 - q(5)**2 - q(6)**2 + q(7)**2
        phi(1) = q(3) + a32*q(8) + a33*q(9)
        phi(2) = -a32*q(9) + a33*q(8)
        phi(3) = 0.5_wp*(q(4)**2 + q(5)**2 + q(6)**2 + q(7)**2 - 1.0_wp)
        phi(4) = 0.5_wp*(q(8)**2 + q(9)**2 - self%radius**2)
    end subroutine set_phi

    !> C = [Phi_q; E] (107), (109): B(p, alpha) in rows 5, 6 and 1, and the last row of B(p, beta) in row 2.
    pure subroutine set_jacobian(q, jacobian)
        real(wp), intent(in) :: q(:)
        real(wp), intent(out) :: jacobian(6, 9)
        real(wp) :: e0, e1, e2, e3, a1, a2, s, d

        e0 = 2*q(4)
        e1 = 2*q(5)
        e2 = 2*q(6)
        e3 = 2*q(7)
        a1 = q(8)
        a2 = q(9)
        s = e2*a1 + e3*a2
        d = e3*a1 - e2*a2
        jacobian = 0.0_wp
        jacobian(1, 3) = 1.0_wp
        jacobian(1, 4) = e0*a2 + e1*a1
        jacobian(1, 5) = e0*a1 - e1*a2
        jacobian(1, 6) = d
        jacobian(1, 7) = s
        jacobian(2, 4) = e0*a1 - e1*a2
        jacobian(2, 5) = -(e0*a2 + e1*a1)
        jacobian(2, 6) = -s
        jacobian(2, 7) = d
        jacobian(3, 4:7) = q(4:7)
        jacobian(5, 1) = 1.0_wp
        jacobian(5, 4) = -d
        jacobian(5, 5) = s
        jacobian(5, 6) = e0*a2 + e1*a1
        jacobian(5, 7) = e1*a2 - e0*a1
        jacobian(6, 2) = 1.0_wp
        jacobian(6, 4) = e0*a1 - e1*a2
        jacobian(6, 5) = -(e0*a2 + e1*a1)
        jacobian(6, 6) = s
        jacobian(6, 7) = -d
        jacobian(4, 8) = a1
        jacobian(4, 9) = a2
        ! Entries a32 and a33 of the last row of A.
        s = 0.5_wp*(e3*e2 + e0*e1)
        d = 0.25_wp*(e0**2 - e1**2 - e2**2 + e3**2)
        jacobian(1, 8) = s
        jacobian(1, 9) = d
        jacobian(2, 8) = d
        jacobian(2, 9) = -s
    end subroutine set_jacobian

    !> gamma. A is quadratic in p. For zero second derivatives of p and a, the second derivative of A alpha is 2 A(pd) alpha + 2 Ad
    !> alphad; that of A beta is analogous. alpha and beta lie in the plane of the disk, so that only the columns of A(pd) and Ad
    !> along y' and z' are required. Rows 5 and 6 differentiate rd + Ad alpha, the velocity of the material point in contact, in
    !> which Ad alphad occurs once.
    pure subroutine set_gamma(q, qd, gamma)
        real(wp), intent(in) :: q(:), qd(:)
        real(wp), intent(out) :: gamma(6)
        real(wp) :: centripetal(3, 2), rate(3, 2)

        associate (e0 => q(4), e1 => q(5), e2 => q(6), e3 => q(7), d0 => qd(4), d1 => qd(5), d2 => qd(6), d3 => qd(7), &
            a1 => q(8), a2 => q(9), a1d => qd(8), a2d => qd(9))
            centripetal(1, 1) = 4*(d1*d2 - d0*d3)
            centripetal(2, 1) = 2*(d0**2 - d1**2 + d2**2 - d3**2)
            centripetal(3, 1) = 4*(d2*d3 + d0*d1)
            centripetal(1, 2) = 4*(d1*d3 + d0*d2)
            centripetal(2, 2) = 4*(d2*d3 - d0*d1)
            centripetal(3, 2) = 2*(d0**2 - d1**2 - d2**2 + d3**2)
            rate(1, 1) = 2*(e1*d2 + d1*e2 - e0*d3 - d0*e3)
            rate(2, 1) = 2*(e0*d0 - e1*d1 + e2*d2 - e3*d3)
            rate(3, 1) = 2*(e2*d3 + d2*e3 + e0*d1 + d0*e1)
            rate(1, 2) = 2*(e1*d3 + d1*e3 + e0*d2 + d0*e2)
            rate(2, 2) = 2*(e2*d3 + d2*e3 - e0*d1 - d0*e1)
            rate(3, 2) = 2*(e0*d0 - e1*d1 - e2*d2 + e3*d3)
            gamma(1) = centripetal(3, 1)*a1 + centripetal(3, 2)*a2 + 2*(rate(3, 1)*a1d + rate(3, 2)*a2d)
            gamma(2) = centripetal(3, 2)*a1 - centripetal(3, 1)*a2 + 2*(rate(3, 2)*a1d - rate(3, 1)*a2d)
            gamma(3) = d0**2 + d1**2 + d2**2 + d3**2
            gamma(4) = a1d**2 + a2d**2
            gamma(5) = centripetal(1, 1)*a1 + centripetal(1, 2)*a2 + rate(1, 1)*a1d + rate(1, 2)*a2d
            gamma(6) = centripetal(2, 1)*a1 + centripetal(2, 2)*a2 + rate(2, 1)*a1d + rate(2, 2)*a2d
        end associate
    end subroutine set_gamma

    !> Mass matrix: the mass, and 4 G'J G.
    pure subroutine set_mass(self, q, mass)
        class(rolling_disk_type), intent(in) :: self
        real(wp), intent(in) :: q(:)
        real(wp), intent(out) :: mass(9, 9)
        integer :: i

        mass = 0.0_wp
        do i = 1, 3
            mass(i, i) = self%mass
        end do
        call set_rotational_mass(q(4:7), self%inertia, size(mass, 1), mass(4, 4))
    end subroutine set_mass

    !> Forces S + Q_A.
    pure subroutine set_force(self, q, qd, force)
        class(rolling_disk_type), intent(in) :: self
        real(wp), intent(in) :: q(:), qd(:)
        real(wp), intent(out) :: force(9)

        force = 0.0_wp
        force(3) = -self%mass*self%gravity
        force(4:7) = g_transposed_product(qd(4:7), 8*self%inertia*g_product(qd(4:7), q(4:7)))
    end subroutine set_force

    !> Derivatives (111), as gradients of the velocity and acceleration constraints and of the equations of motion. With v = d/dt (A
    !> alpha) and its analogues, rows 1, 5 and 6 differentiate the motion of the contact point, and row 2 that of the tangent.
    subroutine evaluate_derivatives(self, need, t, q, qd, qdd, lambda, derivatives, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:), qdd(:), lambda(:)
        type(derivatives_type), intent(inout) :: derivatives
        integer, intent(out) :: stat
        real(wp) :: p(4), pd(4), pdd(4), alpha(3), beta(3), alphad(3), betad(3), alphadd(3), betadd(3)
        real(wp) :: rate(3, 3), second_rate(3, 3), block(3, 4), mixed(3, 4)

        stat = 0
        p = q(4:7)
        pd = qd(4:7)
        pdd = qdd(4:7)
        alpha = [0.0_wp, q(8), q(9)]
        beta = [0.0_wp, -q(9), q(8)]
        alphad = [0.0_wp, qd(8), qd(9)]
        betad = [0.0_wp, -qd(9), qd(8)]
        rate = rotation_rate(p, pd)
        if (iand(need, need_velocity_q) /= 0) then
            associate (d => derivatives%velocity_q)
                ! (B(p, alpha) pd + A alphad)_p = B(pd, alpha) + B(p, alphad). Its derivative with respect to a is Ad.
                d = 0.0_wp
                block = b_matrix(pd, alpha)
                mixed = b_matrix(p, alphad)
                d(1, 4:7) = block(3, :) + mixed(3, :)
                d(1, 8:9) = rate(3, 2:3)
                d(5:6, 4:7) = block(1:2, :)
                d(5:6, 8:9) = rate(1:2, 2:3)
                block = b_matrix(pd, beta) + b_matrix(p, betad)
                d(2, 4:7) = block(3, :)
                d(2, 8:9) = [rate(3, 3), -rate(3, 2)]
                d(3, 4:7) = pd
                d(4, 8:9) = qd(8:9)
            end associate
        end if
        if (iand(need, need_acceleration_q) /= 0) then
            associate (d => derivatives%acceleration_q)
                alphadd = [0.0_wp, qdd(8), qdd(9)]
                betadd = [0.0_wp, -qdd(9), qdd(8)]
                second_rate = rotation_rate(p, pdd) + rotation_rate(pd, pd)
                d = 0.0_wp
                block = b_matrix(pdd, alpha)
                mixed = b_matrix(pd, alphad)
                d(5:6, 4:7) = block(1:2, :) + mixed(1:2, :)
                d(5:6, 8:9) = second_rate(1:2, 2:3)
                block = block + 2*mixed + b_matrix(p, alphadd)
                d(1, 4:7) = block(3, :)
                d(1, 8:9) = second_rate(3, 2:3)
                block = b_matrix(pdd, beta) + 2*b_matrix(pd, betad) + b_matrix(p, betadd)
                d(2, 4:7) = block(3, :)
                d(2, 8:9) = [second_rate(3, 3), -second_rate(3, 2)]
                d(3, 4:7) = pdd
                d(4, 8:9) = qdd(8:9)
            end associate
        end if
        if (iand(need, need_acceleration_qd) /= 0) then
            associate (d => derivatives%acceleration_qd)
                ! gamma_qd. Rows 5 and 6 contain E2 + Ed, which the paper prints as 2 E2.
                d = 0.0_wp
                block = b_matrix(pd, alpha)
                mixed = b_matrix(p, alphad)
                d(1, 4:7) = 2*(block(3, :) + mixed(3, :))
                d(1, 8:9) = 2*rate(3, 2:3)
                d(5:6, 4:7) = 2*block(1:2, :) + mixed(1:2, :)
                d(5:6, 8:9) = rate(1:2, 2:3)
                block = b_matrix(pd, beta) + b_matrix(p, betad)
                d(2, 4:7) = 2*block(3, :)
                d(2, 8:9) = 2*[rate(3, 3), -rate(3, 2)]
                d(3, 4:7) = 2*pd
                d(4, 8:9) = 2*qd(8:9)
            end associate
        end if
        select type (self)
        class is (rolling_disk_type)
            if (iand(need, need_dynamics_q) /= 0) call differentiate_dynamics(self%inertia, q, qd, qdd, lambda, &
                derivatives%dynamics_q)
            if (iand(need, need_dynamics_qd) /= 0) then
                derivatives%dynamics_qd = 0.0_wp
                derivatives%dynamics_qd(4:7, 4:7) = 8*g_sandwich(pd, self%inertia, p) &
                    - 8*t_matrix(self%inertia*g_product(pd, p))
            end if
        end select
    end subroutine evaluate_derivatives

    !> Gradient dynamics_q = M2(q, qdd) - S_q + (C' lambda)_q.
    pure subroutine differentiate_dynamics(inertia, q, qd, qdd, lambda, d)
        real(wp), intent(in) :: inertia(3), q(:), qd(:), qdd(:), lambda(:)
        real(wp), intent(out) :: d(:, :)
        real(wp) :: p(4), pd(4), pdd(4), alpha(3), beta(3), uz(3), a_uz(3), force_c(3, 4)
        integer :: j

        p = q(4:7)
        pd = qd(4:7)
        pdd = qdd(4:7)
        alpha = [0.0_wp, q(8), q(9)]
        beta = [0.0_wp, -q(9), q(8)]
        ! The contact force is (lambda5, lambda6, lambda1).
        d = 0.0_wp
        uz = [0.0_wp, 0.0_wp, 1.0_wp]
        a_uz = [lambda(5), lambda(6), lambda(1)]
        d(4:7, 4:7) = 4*t_matrix(inertia*g_product(p, pdd)) &
            - 4*g_sandwich(p, inertia, pdd) - 8*g_sandwich(pd, inertia, pd) &
            + k_matrix(alpha, a_uz) + lambda(2)*k_matrix(beta, uz)
        do j = 4, 7
            d(j, j) = d(j, j) + lambda(3)
        end do
        ! (B(p, a)' b)_a = C(p, b)'. The no-slip rows do not contain the rates of a.
        force_c = c_matrix(p, a_uz)
        d(4:7, 8) = force_c(2, :)
        d(4:7, 9) = force_c(3, :)
        force_c = c_matrix(p, uz)
        d(4:7, 8) = d(4:7, 8) + lambda(2)*force_c(3, :)
        d(4:7, 9) = d(4:7, 9) - lambda(2)*force_c(2, :)
        d(8, 4:7) = lambda(1)*force_c(2, :) + lambda(2)*force_c(3, :)
        d(9, 4:7) = lambda(1)*force_c(3, :) - lambda(2)*force_c(2, :)
        d(8, 8) = lambda(4)
        d(9, 9) = lambda(4)
    end subroutine differentiate_dynamics

    !> Potential energy V = m g rz.
    subroutine potential_energy(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (rolling_disk_type)
            value = self%mass*self%gravity*q(3)
        end select
    end subroutine potential_energy
end module tandem_models_rolling_disk
