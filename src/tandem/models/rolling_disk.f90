! SPDX-License-Identifier: MIT
!> The disk of section 8 that rolls without slipping on the plane z = 0.
!>
!> q = (r, p, a): centre r, Euler parameters p of the disk's frame (x' is its axis), and a = (a1, a2), the vector from the
!> centre to the contact point in the disk's plane. With alpha = (0, a1, a2) and beta = (0, -a2, a1), both in the disk's frame,
!> the contact point is r + A alpha, and A beta is the tangent of the rim there.
!>
!> The total energy is constant. The contact is bilateral: the disk can be pulled down but never lifts off.
module tandem_models_rolling_disk
    use tandem_kinds, only: wp
    use tandem_model, only: label_length, model_type
    use tandem_model_terms, only: need_force, need_gamma, need_jacobian, need_mass, need_phi, terms_type
    use tandem_rigid_euler_parameters, only: b_matrix, b_product, g_matrix, g_product, g_transposed_product, rotation
    implicit none
    private

    public :: rolling_disk_type

    type, extends(model_type) :: rolling_disk_type
        !> Mass (kg).
        real(wp) :: mass = 10.0_wp
        !> Principal moments of inertia about x', y', z' (kg m^2).
        real(wp) :: inertia(3) = [5.0_wp, 2.5001_wp, 2.5001_wp]
        !> Radius (m) and acceleration due to gravity (m/s^2).
        real(wp) :: radius = 1.0_wp, gravity = 9.6_wp
    contains
        procedure :: define
        procedure :: start
    end type rolling_disk_type

contains

    !> Associate the procedures and name everything; to be called after the parameters are set.
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
        self%evaluate => evaluate
        self%potential_energy => potential_energy
        self%provides = need_phi + need_jacobian + need_gamma + need_mass + need_force
    end subroutine define

    !> The disk over the origin with its plane turned by `tilt` (rad) about y from the vertical y-z plane, with an angular
    !> velocity in its own frame (rad/s); rolling fixes the rest.
    pure subroutine start(self, omega, tilt, q, qd)
        class(rolling_disk_type), intent(in) :: self
        !> Angular velocity in the disk's frame (rad/s).
        real(wp), intent(in) :: omega(3)
        !> Tilt (rad), less than pi/2 in modulus.
        real(wp), intent(in) :: tilt
        real(wp), intent(out) :: q(9), qd(9)
        real(wp) :: p(4), pd(4), a(3, 3), alpha(3), beta(3), contact(3), tangent(3), turn

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
        ! The contact stays at the bottom: d/dt (uz' A beta) = 0 with betad = -turn alpha, alphad = turn beta.
        tangent = b_product(p, beta, pd)
        turn = tangent(3)/dot_product(a(3, :), alpha)
        contact = b_product(p, alpha, pd)
        qd(1:2) = -contact(1:2)
        qd(3) = -contact(3) - turn*dot_product(a(3, :), beta)
        qd(4:7) = pd
        qd(8:9) = turn*beta(2:3)
    end subroutine start

    !> The terms (106)-(110).
    subroutine evaluate(self, need, t, q, qd, terms, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type), intent(inout) :: terms
        integer, intent(out) :: stat
        real(wp) :: p(4), pd(4), alpha(3), beta(3), alphad(3), betad(3), g(3, 4)
        real(wp) :: centripetal(3), mixed(3), tangent(3), a32, a33
        integer :: i, j

        stat = 0
        p = q(4:7)
        alpha = [0.0_wp, q(8), q(9)]
        beta = [0.0_wp, -q(9), q(8)]
        if (iand(need, need_gamma + need_force) /= 0) pd = qd(4:7)
        select type (self)
        class is (rolling_disk_type)
            if (iand(need, need_phi) /= 0) then
                a32 = 2*(p(4)*p(3) + p(1)*p(2))
                a33 = p(1)**2 - p(2)**2 - p(3)**2 + p(4)**2
                terms%phi(1) = q(3) + a32*q(8) + a33*q(9)
                terms%phi(2) = -a32*q(9) + a33*q(8)
                terms%phi(3) = 0.5_wp*(p(1)**2 + p(2)**2 + p(3)**2 + p(4)**2 - 1.0_wp)
                terms%phi(4) = 0.5_wp*(q(8)**2 + q(9)**2 - self%radius**2)
            end if
            if (iand(need, need_jacobian) /= 0) call set_jacobian(p, alpha, beta, terms%jacobian)
            if (iand(need, need_gamma) /= 0) then
                ! d^2/dt^2 (A alpha) without second derivatives is B(pd, alpha) pd + 2 B(p, alphad) pd; A is quadratic in p.
                alphad = [0.0_wp, qd(8), qd(9)]
                betad = [0.0_wp, -qd(9), qd(8)]
                centripetal = b_product(pd, alpha, pd)
                mixed = b_product(p, alphad, pd)
                tangent = b_product(pd, beta, pd) + 2*b_product(p, betad, pd)
                terms%gamma(1) = centripetal(3) + 2*mixed(3)
                terms%gamma(2) = tangent(3)
                terms%gamma(3) = dot_product(pd, pd)
                terms%gamma(4) = qd(8)**2 + qd(9)**2
                terms%gamma(5:6) = centripetal(1:2) + mixed(1:2)
            end if
            if (iand(need, need_mass) /= 0) then
                terms%mass = 0.0_wp
                do i = 1, 3
                    terms%mass(i, i) = self%mass
                end do
                g = g_matrix(p)
                do j = 1, 4
                    do i = 1, 4
                        terms%mass(3 + i, 3 + j) = 4*(self%inertia(1)*g(1, i)*g(1, j) + self%inertia(2)*g(2, i)*g(2, j) + &
                            self%inertia(3)*g(3, i)*g(3, j))
                    end do
                end do
            end if
            if (iand(need, need_force) /= 0) then
                terms%force = 0.0_wp
                terms%force(3) = -self%mass*self%gravity
                terms%force(4:7) = g_transposed_product(pd, 8*self%inertia*g_product(pd, p))
            end if
        end select
    end subroutine evaluate

    !> C = [Phi_q; E] (107), (109).
    pure subroutine set_jacobian(p, alpha, beta, jacobian)
        real(wp), intent(in) :: p(4), alpha(3), beta(3)
        real(wp), intent(inout) :: jacobian(:, :)
        real(wp) :: contact(3, 4), tangent(3, 4), a(3, 3)

        contact = b_matrix(p, alpha)
        tangent = b_matrix(p, beta)
        a = rotation(p)
        jacobian = 0.0_wp
        jacobian(1, 3) = 1.0_wp
        jacobian(1, 4:7) = contact(3, :)
        jacobian(1, 8:9) = a(3, 2:3)
        jacobian(2, 4:7) = tangent(3, :)
        jacobian(2, 8) = a(3, 3)
        jacobian(2, 9) = -a(3, 2)
        jacobian(3, 4:7) = p
        jacobian(4, 8) = alpha(2)
        jacobian(4, 9) = alpha(3)
        jacobian(5, 1) = 1.0_wp
        jacobian(5, 4:7) = contact(1, :)
        jacobian(6, 2) = 1.0_wp
        jacobian(6, 4:7) = contact(2, :)
    end subroutine set_jacobian

    !> V = m g rz.
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
