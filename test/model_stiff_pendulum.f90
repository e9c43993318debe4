! SPDX-License-Identifier: MIT
!> A pendulum on a stiff damped spring whose length is a coordinate without a mass: n = 3, nh = 1, nd = 0, M singular.
module model_stiff_pendulum
    use tandem, only: model_type, wp
    implicit none (type, external)
    private

    public :: stiff_pendulum_type

    type, extends(model_type) :: stiff_pendulum_type
        !> Mass, length of the spring at rest, gravity.
        real(wp) :: m = 1.0_wp, l0 = 1.0_wp, g = 9.81_wp
        !> Stiffness and damping.
        real(wp) :: k = 9810000.0_wp, c = 12.52836781069266_wp
    contains
        procedure :: define
    end type stiff_pendulum_type

contains

    !> Associate the procedures.
    subroutine define(self)
        class(stiff_pendulum_type), intent(inout) :: self

        self%name = 'stiff pendulum'
        self%n = 3
        self%n_holonomic = 1
        self%constant_mass = .true.
        self%holonomic_name = [character(len=32) :: 'length']
        self%holonomic => position
        self%holonomic_jacobian => jacobian
        self%constraint_acceleration => acceleration
        self%mass_matrix => mass
        self%applied_force => force
    end subroutine define

    !> (x**2 + y**2 - l**2)/2 = 0.
    subroutine position(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value(1) = (q(1)**2 + q(2)**2 - q(3)**2)/2
    end subroutine position

    subroutine jacobian(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        stat = 0
        value(1, :) = [q(1), q(2), -q(3)]
    end subroutine jacobian

    subroutine acceleration(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value(1) = qd(1)**2 + qd(2)**2 - qd(3)**2
    end subroutine acceleration

    subroutine mass(self, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (stiff_pendulum_type)
            value(1, 1) = self%m
            value(2, 2) = self%m
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
        class is (stiff_pendulum_type)
            value(2) = -self%m*self%g
            value(3) = -self%k*(q(3) - self%l0) - self%c*qd(3)
        end select
    end subroutine force
end module model_stiff_pendulum
