!> A mass on a rod that turns about the origin: q = (x, y), y upward.
module pendulum
    use tandem, only: label_length, model_type, procedure_model_type, wp
    implicit none (type, external)
    private

    public :: pendulum_type

    !> The model with its parameters.
    type, extends(procedure_model_type) :: pendulum_type
        !> Mass (kg), length of the rod (m), gravity (m/s2).
        real(wp) :: mass = 1.0_wp, length = 1.0_wp, gravity = 9.81_wp
    contains
        procedure :: define
    end type pendulum_type

contains

    !> Sizes, names and procedures; to be called after the parameters are set.
    subroutine define(self)
        class(pendulum_type), intent(inout) :: self

        self%name = 'pendulum'
        self%n = 2
        self%n_holonomic = 1
        self%constant_mass = .true.
        self%coordinate_name = [character(len=label_length) :: 'x', 'y']
        self%coordinate_unit = [character(len=label_length) :: 'm', 'm']
        self%coordinate_scale = [self%length, self%length]
        self%holonomic_name = [character(len=label_length) :: 'rod']
        self%holonomic => rod
        self%holonomic_jacobian => rod_jacobian
        self%constraint_acceleration => rod_acceleration
        self%mass_matrix => masses
        self%applied_force => weight
        self%potential_energy => height_energy
    end subroutine define

    !> Phi = (x^2 + y^2 - length^2)/2.
    subroutine rod(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        select type (self)
        type is (pendulum_type)
            value(1) = (dot_product(q, q) - self%length**2)/2
        end select
        stat = 0
    end subroutine rod

    !> Phi_q = (x, y).
    subroutine rod_jacobian(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        value(1, :) = q
        stat = 0
    end subroutine rod_jacobian

    !> gamma = (Phi_q qd)_q qd = xd^2 + yd^2.
    subroutine rod_acceleration(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        value(1) = dot_product(qd, qd)
        stat = 0
    end subroutine rod_acceleration

    !> M = mass I.
    subroutine masses(self, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        value = 0.0_wp
        select type (self)
        type is (pendulum_type)
            value(1, 1) = self%mass
            value(2, 2) = self%mass
        end select
        stat = 0
    end subroutine masses

    !> Q_A = (0, -mass gravity).
    subroutine weight(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        value = 0.0_wp
        select type (self)
        type is (pendulum_type)
            value(2) = -self%mass*self%gravity
        end select
        stat = 0
    end subroutine weight

    !> V = mass gravity y.
    subroutine height_energy(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value
        integer, intent(out) :: stat

        value = 0.0_wp
        select type (self)
        type is (pendulum_type)
            value = self%mass*self%gravity*q(2)
        end select
        stat = 0
    end subroutine height_energy
end module pendulum
