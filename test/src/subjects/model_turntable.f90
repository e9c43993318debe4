! SPDX-License-Identifier: MIT
!> A ball rolls on a rotating table: n = 6 (x, y and Euler parameters), nh = 1, nd = 2, with nu = (-rate y, rate x). Its centre
!> moves on a circle at 2/7 of the table's rate. It may rotate by any angle in a step, because only the motion of its centre limits
!> the steps.
module model_turntable
    use tandem, only: model_type, need_force, need_gamma, need_jacobian, need_mass, need_nu, need_phi, terms_type, wp
    use tandem_rigid_euler_parameters, only: e_matrix
    implicit none (type, external)
    private
    public :: turntable_type

    type, extends(model_type) :: turntable_type
        !> Mass in kg, radius of the ball in m, rate of the table in rad/s.
        real(wp) :: mass = 0.2_wp, radius = 0.05_wp, rate = 5.0_wp
    contains
        procedure :: define
        procedure :: start
        procedure :: exact
    end type turntable_type

    real(wp), parameter :: r0(2) = [0.3_wp, 0.0_wp], v0(2) = [0.1_wp, 0.5_wp], spin = 4.0_wp

contains

    subroutine define(self)
        class(turntable_type), intent(inout) :: self

        self%name = 'turntable'
        self%n = 6
        self%n_holonomic = 1
        self%n_nonholonomic = 2
        self%evaluate => evaluate
        self%provides = need_phi + need_jacobian + need_nu + need_gamma + need_mass + need_force
        self%constant_mass = .true.
    end subroutine define

    !> A start at t = 0.
    subroutine start(self, q, qd)
        class(turntable_type), intent(in) :: self
        real(wp), intent(out) :: q(6), qd(6)
        real(wp) :: omega(3)

        omega = [(self%rate*r0(1) - v0(2))/self%radius, (v0(1) + self%rate*r0(2))/self%radius, spin]
        q = [r0, 1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp]
        qd = [v0, 0.5_wp*matmul(transpose(e_matrix(q(3:))), omega)]
    end subroutine start

    !> Position and velocity of its centre.
    subroutine exact(self, t, r, v)
        class(turntable_type), intent(in) :: self
        real(wp), intent(in) :: t
        real(wp), intent(out) :: r(2), v(2)
        real(wp) :: k

        k = 2*self%rate/7
        v = cos(k*t)*v0 + sin(k*t)*[-v0(2), v0(1)]
        r = r0 + (sin(k*t)*v0 + (1.0_wp - cos(k*t))*[-v0(2), v0(1)])/k
    end subroutine exact

    !> The contact point of the ball has the velocity of the table.
    subroutine evaluate(self, need, t, q, qd, terms, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type), intent(inout) :: terms
        integer, intent(out) :: stat
        real(wp) :: omega(3, 4)
        integer :: i

        stat = 0
        select type (self)
        class is (turntable_type)
            if (iand(need, need_phi) /= 0) terms%phi(1) = 0.5_wp*(sum(q(3:)**2) - 1.0_wp)
            if (iand(need, need_jacobian) /= 0) then
                omega = 2*e_matrix(q(3:))
                terms%jacobian = 0.0_wp
                terms%jacobian(1, 3:) = q(3:)
                terms%jacobian(2, 1) = 1.0_wp
                terms%jacobian(2, 3:) = -self%radius*omega(2, :)
                terms%jacobian(3, 2) = 1.0_wp
                terms%jacobian(3, 3:) = self%radius*omega(1, :)
            end if
            if (iand(need, need_nu) /= 0) terms%nu = [0.0_wp, -self%rate*q(2), self%rate*q(1)]
            ! E(pd) pd = 0.
            if (iand(need, need_gamma) /= 0) terms%gamma = [sum(qd(3:)**2), self%rate*qd(2), -self%rate*qd(1)]
            if (iand(need, need_mass) /= 0) then
                terms%mass = 0.0_wp
                do i = 1, 6
                    terms%mass(i, i) = merge(1.0_wp, 1.6_wp*self%radius**2, i <= 2)*self%mass
                end do
            end if
            if (iand(need, need_force) /= 0) terms%force = 0.0_wp
        end select
    end subroutine evaluate
end module model_turntable
