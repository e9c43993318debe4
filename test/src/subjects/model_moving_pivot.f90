! SPDX-License-Identifier: MIT
!> A planar pendulum whose pivot moves: n = 2, nh = 1, nd = 0, rheonomic with Phi_t, Phi_tq and Phi_tt.
!>
!> The pivot is at (speed t + swing sin(rate t), -fall t**2/2). Without swing and with fall = g the pendulum is weightless
!> and turns uniformly: a closed solution. Otherwise the angle obeys length theta'' = -(g + ay) sin(theta) - ax cos(theta).
module model_moving_pivot
    use extrapolation, only: equation_type
    use tandem, only: model_type, procedure_model_type, wp
    implicit none (type, external)
    private

    public :: moving_pivot_type, angle_equation_type

    type, extends(procedure_model_type) :: moving_pivot_type
        !> Mass, length of the rod, gravity.
        real(wp) :: m = 1.5_wp, length = 0.7_wp, g = 9.81_wp
        !> The pivot's motion.
        real(wp) :: speed = 1.2_wp, swing = 0.0_wp, rate = 5.0_wp, fall = 9.81_wp
    contains
        procedure :: define
        procedure :: motion
        procedure :: tension
        procedure, private :: pivot
    end type moving_pivot_type

    !> y = (theta, theta').
    type, extends(equation_type) :: angle_equation_type
        type(moving_pivot_type) :: model
    contains
        procedure :: slope
    end type angle_equation_type

contains

    !> Associate the procedures.
    subroutine define(self)
        class(moving_pivot_type), intent(inout) :: self

        self%name = 'moving pivot'
        self%n = 2
        self%n_holonomic = 1
        self%constant_mass = .true.
        self%holonomic => position
        self%holonomic_jacobian => jacobian
        self%holonomic_rate => rate_of_position
        self%constraint_acceleration => acceleration
        self%mass_matrix => mass
        self%applied_force => force
    end subroutine define

    !> Position of the pivot, and its derivatives.
    pure subroutine pivot(self, t, p, pd, pdd)
        class(moving_pivot_type), intent(in) :: self
        real(wp), intent(in) :: t
        real(wp), intent(out) :: p(2), pd(2), pdd(2)

        p = [self%speed*t + self%swing*sin(self%rate*t), -self%fall*t**2/2]
        pd = [self%speed + self%swing*self%rate*cos(self%rate*t), -self%fall*t]
        pdd = [-self%swing*self%rate**2*sin(self%rate*t), -self%fall]
    end subroutine pivot

    !> Coordinates and velocities of an angle from the downward vertical and its rate.
    pure subroutine motion(self, t, angle, rate, q, qd)
        class(moving_pivot_type), intent(in) :: self
        real(wp), intent(in) :: t, angle, rate
        real(wp), intent(out) :: q(2), qd(2)
        real(wp) :: p(2), pd(2), pdd(2)

        call self%pivot(t, p, pd, pdd)
        q = p + self%length*[sin(angle), -cos(angle)]
        qd = pd + self%length*rate*[cos(angle), sin(angle)]
    end subroutine motion

    !> The multiplier, the tension of the rod over its length.
    pure real(wp) function tension(self, t, angle, rate)
        class(moving_pivot_type), intent(in) :: self
        real(wp), intent(in) :: t, angle, rate
        real(wp) :: p(2), pd(2), pdd(2)

        call self%pivot(t, p, pd, pdd)
        tension = self%m*(rate**2 - (pdd(1)*sin(angle) - (pdd(2) + self%g)*cos(angle))/self%length)
    end function tension

    subroutine slope(self, t, y, yd)
        class(angle_equation_type), intent(in) :: self
        real(wp), intent(in) :: t, y(:)
        real(wp), intent(out) :: yd(:)
        real(wp) :: p(2), pd(2), pdd(2)

        call self%model%pivot(t, p, pd, pdd)
        yd(1) = y(2)
        yd(2) = -((self%model%g + pdd(2))*sin(y(1)) + pdd(1)*cos(y(1)))/self%model%length
    end subroutine slope

    !> (|q - p|**2 - length**2)/2 = 0.
    subroutine position(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat
        real(wp) :: p(2), pd(2), pdd(2)

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (moving_pivot_type)
            call self%pivot(t, p, pd, pdd)
            value(1) = (dot_product(q - p, q - p) - self%length**2)/2
        end select
    end subroutine position

    subroutine jacobian(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat
        real(wp) :: p(2), pd(2), pdd(2)

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (moving_pivot_type)
            call self%pivot(t, p, pd, pdd)
            value(1, :) = q - p
        end select
    end subroutine jacobian

    subroutine rate_of_position(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat
        real(wp) :: p(2), pd(2), pdd(2)

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (moving_pivot_type)
            call self%pivot(t, p, pd, pdd)
            value(1) = -dot_product(q - p, pd)
        end select
    end subroutine rate_of_position

    subroutine acceleration(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat
        real(wp) :: p(2), pd(2), pdd(2)

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (moving_pivot_type)
            call self%pivot(t, p, pd, pdd)
            value(1) = dot_product(qd - pd, qd - pd) - dot_product(q - p, pdd)
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
        class is (moving_pivot_type)
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
        class is (moving_pivot_type)
            value(2) = -self%m*self%g
        end select
    end subroutine force
end module model_moving_pivot
