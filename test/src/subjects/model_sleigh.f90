! SPDX-License-Identifier: MIT
!> A Chaplygin sleigh on a moving surface: n = 3, nh = 0, nd = 1, with e(t, q) /= 0 that jumps at a breakpoint.
!>
!> The blade sits at a distance `arm` from the centre of mass: sin(phi) xd - cos(phi) yd - arm phid = e,
!> e = speed(segment) + growth t + shear y. With u along and s = e + arm phid across the blade,
!> m (u' + s w) = F.along, (inertia + m arm**2) w' = arm (F.across - m e' + m u w): the reduced equations below.
module model_sleigh
    use extrapolation, only: equation_type
    use tandem, only: model_type, procedure_model_type, wp
    implicit none (type, external)
    private

    public :: sleigh_type, reduced_equation_type

    type, extends(procedure_model_type) :: sleigh_type
        !> Mass, moment of inertia about the centre of mass, distance of the blade, force along x and y.
        real(wp) :: m = 2.0_wp, inertia = 0.5_wp, arm = 0.3_wp, pull(2) = [1.5_wp, -0.4_wp]
        !> The surface's motion.
        real(wp) :: speed(2) = [0.2_wp, -0.5_wp], growth = 0.1_wp, shear = 0.05_wp
    contains
        procedure :: define
        procedure :: motion
        procedure :: reduce
        procedure :: slip
    end type sleigh_type

    !> y = (x, y, phi, u, w).
    type, extends(equation_type) :: reduced_equation_type
        type(sleigh_type) :: model
    contains
        procedure :: slope
    end type reduced_equation_type

contains

    !> Associate the procedures; the surface's speed jumps at a time.
    subroutine define(self, jump_at)
        class(sleigh_type), intent(inout) :: self
        real(wp), intent(in) :: jump_at

        self%name = 'sleigh'
        self%n = 3
        self%n_nonholonomic = 1
        self%constant_mass = .true.
        self%breakpoints = [jump_at]
        self%nu_jumps = [.true.]
        self%nonholonomic_jacobian => blade
        self%nonholonomic_rhs => surface
        self%constraint_acceleration => acceleration
        self%mass_matrix => mass
        self%applied_force => force
    end subroutine define

    !> e(t, q) in the current segment.
    pure real(wp) function slip(self, t, y)
        class(sleigh_type), intent(in) :: self
        real(wp), intent(in) :: t, y

        slip = self%speed(self%segment) + self%growth*t + self%shear*y
    end function slip

    !> Coordinates and velocities of the reduced state.
    pure subroutine motion(self, t, y, q, qd)
        class(sleigh_type), intent(in) :: self
        real(wp), intent(in) :: t, y(5)
        real(wp), intent(out) :: q(3), qd(3)
        real(wp) :: s

        q = y(:3)
        s = self%slip(t, y(2)) + self%arm*y(5)
        qd(1) = y(4)*cos(y(3)) + s*sin(y(3))
        qd(2) = y(4)*sin(y(3)) - s*cos(y(3))
        qd(3) = y(5)
    end subroutine motion

    !> The reduced state of coordinates and velocities.
    pure subroutine reduce(self, q, qd, y)
        class(sleigh_type), intent(in) :: self
        real(wp), intent(in) :: q(3), qd(3)
        real(wp), intent(out) :: y(5)

        y(:3) = q
        y(4) = qd(1)*cos(q(3)) + qd(2)*sin(q(3))
        y(5) = qd(3)
    end subroutine reduce

    subroutine slope(self, t, y, yd)
        class(reduced_equation_type), intent(in) :: self
        real(wp), intent(in) :: t, y(:)
        real(wp), intent(out) :: yd(:)
        real(wp) :: q(3), qd(3), s, slip_rate, along, across

        associate (model => self%model)
            call model%motion(t, y, q, qd)
            s = model%slip(t, y(2)) + model%arm*y(5)
            slip_rate = model%growth + model%shear*qd(2)
            along = model%pull(1)*cos(y(3)) + model%pull(2)*sin(y(3))
            across = model%pull(1)*sin(y(3)) - model%pull(2)*cos(y(3))
            yd(:3) = qd
            yd(4) = along/model%m - s*y(5)
            yd(5) = model%arm*(across - model%m*slip_rate + model%m*y(4)*y(5))/(model%inertia + model%m*model%arm**2)
        end associate
    end subroutine slope

    subroutine blade(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (sleigh_type)
            value(1, :) = [sin(q(3)), -cos(q(3)), -self%arm]
        end select
    end subroutine blade

    subroutine surface(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (sleigh_type)
            value(1) = self%slip(t, q(2))
        end select
    end subroutine surface

    subroutine acceleration(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (sleigh_type)
            value(1) = qd(3)*(cos(q(3))*qd(1) + sin(q(3))*qd(2)) - self%growth - self%shear*qd(2)
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
        class is (sleigh_type)
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
        class is (sleigh_type)
            value(:2) = self%pull
        end select
    end subroutine force
end module model_sleigh
