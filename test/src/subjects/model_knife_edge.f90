! SPDX-License-Identifier: MIT
!> A knife edge (a skate) on an inclined plane, x downhill: n = 3, nh = 0, nd = 1, with a closed solution (Neimark and Fufaev).
module model_knife_edge
    use tandem, only: model_type, procedure_model_type, wp
    implicit none (type, external)
    private

    public :: knife_edge_type

    type, extends(procedure_model_type) :: knife_edge_type
        !> Mass, moment of inertia, downhill component of gravity.
        real(wp) :: m = 1.0_wp, inertia = 0.2_wp, g_sin_alpha = 2.8990532273477414_wp
        !> Angular velocity, forward speed and heading at t = 0.
        real(wp) :: w = 1.5_wp, u0 = 0.5_wp, phi0 = 0.25_wp
    contains
        procedure :: define
        procedure :: solution
    end type knife_edge_type

contains

    !> Associate the procedures.
    subroutine define(self)
        class(knife_edge_type), intent(inout) :: self

        self%name = 'knife edge'
        self%n = 3
        self%n_nonholonomic = 1
        self%constant_mass = .true.
        self%coordinate_name = [character(len=32) :: 'x', 'y', 'phi']
        self%coordinate_unit = [character(len=32) :: 'm', 'm', 'rad']
        self%nonholonomic_name = [character(len=32) :: 'no slip']
        self%nonholonomic_jacobian => no_slip
        self%constraint_acceleration => acceleration
        self%mass_matrix => mass
        self%applied_force => force
        self%potential_energy => potential
    end subroutine define

    !> The motion in closed form.
    subroutine solution(self, t, q, qd, qdd, lambda)
        class(knife_edge_type), intent(in) :: self
        real(wp), intent(in) :: t
        real(wp), intent(out) :: q(3), qd(3), qdd(3), lambda(1)
        real(wp) :: phi, u, ud, slope, constant

        phi = self%phi0 + self%w*t
        slope = self%g_sin_alpha/self%w
        constant = self%u0 - slope*sin(self%phi0)
        u = constant + slope*sin(phi)
        ud = self%g_sin_alpha*cos(phi)
        q(1) = (constant*(sin(phi) - sin(self%phi0)) + slope*(sin(phi)**2 - sin(self%phi0)**2)/2)/self%w
        q(2) = (-constant*(cos(phi) - cos(self%phi0)) + &
            slope*((phi - self%phi0)/2 - (sin(2*phi) - sin(2*self%phi0))/4))/self%w
        q(3) = phi
        qd = [u*cos(phi), u*sin(phi), self%w]
        qdd = [ud*cos(phi) - u*self%w*sin(phi), ud*sin(phi) + u*self%w*cos(phi), 0.0_wp]
        lambda = self%m*(self%g_sin_alpha*sin(phi) + u*self%w)
    end subroutine solution

    !> sin(phi) xd - cos(phi) yd = 0.
    subroutine no_slip(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        stat = 0
        value(1, :) = [sin(q(3)), -cos(q(3)), 0.0_wp]
    end subroutine no_slip

    subroutine acceleration(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value(1) = qd(3)*(cos(q(3))*qd(1) + sin(q(3))*qd(2))
    end subroutine acceleration

    subroutine mass(self, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (knife_edge_type)
            value(1, 1) = self%m
            value(2, 2) = self%m
            value(3, 3) = self%inertia
        end select
    end subroutine mass

    subroutine force(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (knife_edge_type)
            value(1) = self%m*self%g_sin_alpha
        end select
    end subroutine force

    subroutine potential(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (knife_edge_type)
            value = -self%m*self%g_sin_alpha*q(1)
        end select
    end subroutine potential
end module model_knife_edge
