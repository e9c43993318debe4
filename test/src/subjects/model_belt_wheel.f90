! SPDX-License-Identifier: MIT
!> A driven wheel that rolls on a moving belt: n = 2, nh = 1, nd = 1, so that the constraints alone give the motion.
!> q = (x, phi), phi = drive(t), xd - radius phid = belt cos(t): both rows depend on time.
module model_belt_wheel
    use tandem, only: model_type, procedure_model_type, wp
    implicit none (type, external)
    private

    public :: belt_wheel_type

    type, extends(procedure_model_type) :: belt_wheel_type
        !> Mass, moment of inertia, radius, a force along x.
        real(wp) :: m = 2.0_wp, inertia = 0.3_wp, radius = 0.5_wp, pull = 1.7_wp
        !> drive(t) = speed t + swing sin(t); amplitude of the belt's speed.
        real(wp) :: speed = 1.5_wp, swing = 0.6_wp, belt = 0.9_wp
    contains
        procedure :: define
        procedure :: solution
    end type belt_wheel_type

contains

    !> Associate the procedures.
    subroutine define(self)
        class(belt_wheel_type), intent(inout) :: self

        self%name = 'belt wheel'
        self%n = 2
        self%n_holonomic = 1
        self%n_nonholonomic = 1
        self%constant_mass = .true.
        self%holonomic => position
        self%holonomic_jacobian => jacobian
        self%holonomic_rate => rate
        self%nonholonomic_jacobian => rolling
        self%nonholonomic_rhs => belt_speed
        self%constraint_acceleration => acceleration
        self%mass_matrix => mass
        self%applied_force => force
    end subroutine define

    !> The motion in closed form.
    subroutine solution(self, t, q, qd, qdd, lambda)
        class(belt_wheel_type), intent(in) :: self
        real(wp), intent(in) :: t
        real(wp), intent(out) :: q(2), qd(2), qdd(2), lambda(2)

        q(2) = self%speed*t + self%swing*sin(t)
        qd(2) = self%speed + self%swing*cos(t)
        qdd(2) = -self%swing*sin(t)
        q(1) = self%radius*q(2) + self%belt*sin(t)
        qd(1) = self%radius*qd(2) + self%belt*cos(t)
        qdd(1) = self%radius*qdd(2) - self%belt*sin(t)
        lambda(2) = self%pull - self%m*qdd(1)
        lambda(1) = self%radius*lambda(2) - self%inertia*qdd(2)
    end subroutine solution

    subroutine position(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (belt_wheel_type)
            value(1) = q(2) - self%speed*t - self%swing*sin(t)
        end select
    end subroutine position

    subroutine jacobian(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        stat = 0
        value(1, :) = [0.0_wp, 1.0_wp]
    end subroutine jacobian

    subroutine rate(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (belt_wheel_type)
            value(1) = -self%speed - self%swing*cos(t)
        end select
    end subroutine rate

    subroutine rolling(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        stat = 0
        value = 1.0_wp
        select type (self)
        class is (belt_wheel_type)
            value(1, 2) = -self%radius
        end select
    end subroutine rolling

    subroutine belt_speed(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (belt_wheel_type)
            value(1) = self%belt*cos(t)
        end select
    end subroutine belt_speed

    subroutine acceleration(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (belt_wheel_type)
            value = [self%swing*sin(t), self%belt*sin(t)]
        end select
    end subroutine acceleration

    subroutine mass(self, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (belt_wheel_type)
            value(1, 1) = self%m
            value(2, 2) = self%inertia
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
        class is (belt_wheel_type)
            value(1) = self%pull
        end select
    end subroutine force
end module model_belt_wheel
