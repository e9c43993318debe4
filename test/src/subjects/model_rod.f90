! SPDX-License-Identifier: MIT
!> A uniform rod on a pivot, with the angle as a third coordinate: n = 3, nh = 2, nd = 0. q contains lengths and an angle, so that
!> an orthonormal basis depends on the unit of length unless `coordinate_scale` compensates it.
module model_rod
    use tandem, only: model_type, procedure_model_type, wp
    implicit none (type, external)
    private

    public :: rod_type

    type, extends(procedure_model_type) :: rod_type
        !> Mass, distance of the centre from the pivot in metres, gravity in metres per second squared.
        real(wp) :: m = 3.0_wp, half = 0.4_wp, g = 9.81_wp
        !> Units of length per metre.
        real(wp) :: units = 1.0_wp
    contains
        procedure :: define
        procedure :: start
    end type rod_type

contains

    !> Associate the procedures.
    subroutine define(self)
        class(rod_type), intent(inout) :: self

        self%name = 'rod'
        self%n = 3
        self%n_holonomic = 2
        self%constant_mass = .true.
        self%holonomic => position
        self%holonomic_jacobian => jacobian
        self%constraint_acceleration => acceleration
        self%mass_matrix => mass
        self%applied_force => force
    end subroutine define

    !> A start at an angle from the downward vertical, with an angular velocity.
    subroutine start(self, angle, rate, q, qd)
        class(rod_type), intent(in) :: self
        real(wp), intent(in) :: angle, rate
        real(wp), intent(out) :: q(3), qd(3)

        q = [self%half*self%units*sin(angle), -self%half*self%units*cos(angle), angle]
        qd = [self%half*self%units*rate*cos(angle), self%half*self%units*rate*sin(angle), rate]
    end subroutine start

    !> x = half sin(phi), y = -half cos(phi).
    subroutine position(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat
        real(wp) :: l

        stat = 0
        l = arm(self)
        value = [q(1) - l*sin(q(3)), q(2) + l*cos(q(3))]
    end subroutine position

    subroutine jacobian(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat
        real(wp) :: l

        stat = 0
        l = arm(self)
        value(1, :) = [1.0_wp, 0.0_wp, -l*cos(q(3))]
        value(2, :) = [0.0_wp, 1.0_wp, -l*sin(q(3))]
    end subroutine jacobian

    subroutine acceleration(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value = arm(self)*qd(3)**2*[sin(q(3)), -cos(q(3))]
    end subroutine acceleration

    subroutine mass(self, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (rod_type)
            value(1, 1) = self%m
            value(2, 2) = self%m
            value(3, 3) = self%m*arm(self)**2/3
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
        class is (rod_type)
            value(2) = -self%m*self%g*self%units
        end select
    end subroutine force

    !> The distance of the centre from the pivot in the model's unit.
    pure real(wp) function arm(self)
        class(model_type), intent(in) :: self

        arm = 0.0_wp
        select type (self)
        class is (rod_type)
            arm = self%half*self%units
        end select
    end function arm
end module model_rod
