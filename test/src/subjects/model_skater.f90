! SPDX-License-Identifier: MIT
!> A blade on a wavy rising floor, in wind: n = 4, nh = 1, nd = 1, with every term and every single derivative procedure that a
!> model can have. q = (x, y, z, phi); z = wave sin(x) cos(y) + rise t, sin(phi) xd - cos(phi) yd - arm phid = shear y + swing
!> cos(t); the moment of inertia grows with x.
module model_skater
    use tandem, only: model_type, procedure_model_type, wp
    implicit none (type, external)
    private

    public :: skater_type, single_names

    !> Its single derivative procedures.
    character(len=24), parameter :: single_names(8) = [character(len=24) :: 'jacobian_derivative', 'nu_derivative', 'gamma_q', &
        'gamma_qd', 'mass_derivative', 'reaction_derivative', 'force_q', 'force_qd']

    type, extends(procedure_model_type) :: skater_type
        !> Mass, moment of inertia, its growth with x**2, gravity.
        real(wp) :: m = 2.0_wp, inertia = 0.5_wp, growth = 0.4_wp, g = 3.0_wp
        !> Floor, distance of the blade, and motion of the surface.
        real(wp) :: wave = 0.3_wp, rise = 0.2_wp, arm = 0.6_wp, shear = 0.15_wp, swing = 0.25_wp
        !> Stiffness, damping and wind of the applied forces.
        real(wp) :: stiffness = 1.3_wp, damping = 0.7_wp, wind = 0.9_wp
        !> Name of a procedure whose entry (1, 1) is wrong by 0.125; empty for none.
        character(len=24) :: broken = ''
    contains
        procedure :: define
        procedure :: start
        procedure, private :: spoil
    end type skater_type

    !> Error of a broken procedure.
    real(wp), parameter :: amount = 0.125_wp

contains

    !> Associate the procedures.
    subroutine define(self)
        class(skater_type), intent(inout) :: self

        self%name = 'skater'
        self%n = 4
        self%n_holonomic = 1
        self%n_nonholonomic = 1
        self%holonomic_name = [character(len=32) :: 'floor']
        self%nonholonomic_name = [character(len=32) :: 'blade']
        self%holonomic => position
        self%holonomic_jacobian => position_jacobian
        self%holonomic_rate => position_rate
        self%nonholonomic_jacobian => blade
        self%nonholonomic_rhs => slip
        self%constraint_acceleration => acceleration
        self%mass_matrix => mass
        self%inertia_force => inertia_force
        self%applied_force => applied_force
        self%jacobian_derivative => jacobian_derivative
        self%nu_derivative => nu_derivative
        self%gamma_q => gamma_q
        self%gamma_qd => gamma_qd
        self%mass_derivative => mass_derivative
        self%reaction_derivative => reaction_derivative
        self%force_q => force_q
        self%force_qd => force_qd
    end subroutine define

    !> A start at t = 0 that satisfies the constraints.
    subroutine start(self, q, qd)
        class(skater_type), intent(in) :: self
        real(wp), intent(out) :: q(4), qd(4)

        q = [0.3_wp, 0.2_wp, self%wave*sin(0.3_wp)*cos(0.2_wp), 0.4_wp]
        qd(1:2) = [1.1_wp, -0.6_wp]
        qd(3) = self%wave*(cos(q(1))*cos(q(2))*qd(1) - sin(q(1))*sin(q(2))*qd(2)) + self%rise
        qd(4) = (sin(q(4))*qd(1) - cos(q(4))*qd(2) - self%shear*q(2) - self%swing)/self%arm
    end subroutine start

    !> Change the entry that is to be wrong.
    subroutine spoil(self, name, value)
        class(skater_type), intent(in) :: self
        character(len=*), intent(in) :: name
        real(wp), intent(inout) :: value

        if (self%broken == name) value = value + amount
    end subroutine spoil

    subroutine position(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (skater_type)
            value(1) = q(3) - self%wave*sin(q(1))*cos(q(2)) - self%rise*t
        end select
    end subroutine position

    subroutine position_jacobian(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (skater_type)
            value(1, :) = [-self%wave*cos(q(1))*cos(q(2)), self%wave*sin(q(1))*sin(q(2)), 1.0_wp, 0.0_wp]
            call self%spoil('holonomic_jacobian', value(1, 1))
        end select
    end subroutine position_jacobian

    subroutine position_rate(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (skater_type)
            value(1) = -self%rise
            call self%spoil('holonomic_rate', value(1))
        end select
    end subroutine position_rate

    subroutine blade(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (skater_type)
            value(1, :) = [sin(q(4)), -cos(q(4)), 0.0_wp, -self%arm]
        end select
    end subroutine blade

    subroutine slip(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (skater_type)
            value(1) = self%shear*q(2) + self%swing*cos(t)
        end select
    end subroutine slip

    subroutine acceleration(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (skater_type)
            value(1) = self%wave*(sin(q(1))*cos(q(2))*(qd(1)**2 + qd(2)**2) + 2*cos(q(1))*sin(q(2))*qd(1)*qd(2))
            value(2) = qd(4)*(cos(q(4))*qd(1) + sin(q(4))*qd(2)) - self%shear*qd(2) + self%swing*sin(t)
            call self%spoil('constraint_acceleration', value(1))
        end select
    end subroutine acceleration

    subroutine mass(self, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat
        integer :: i

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (skater_type)
            do i = 1, 3
                value(i, i) = self%m
            end do
            value(4, 4) = self%inertia + self%growth*q(1)**2
            call self%spoil('mass_matrix (symmetry)', value(1, 2))
        end select
    end subroutine mass

    subroutine inertia_force(self, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (skater_type)
            value(1) = self%growth*q(1)*qd(4)**2
            value(4) = -2*self%growth*q(1)*qd(1)*qd(4)
        end select
    end subroutine inertia_force

    subroutine applied_force(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (skater_type)
            value = [-self%stiffness*q(1) + self%wind*sin(t), -self%stiffness*q(2)**3 - self%damping*qd(2), -self%m*self%g, &
                -self%damping*qd(4) + self%stiffness*q(1)*q(2)]
        end select
    end subroutine applied_force

    !> (C x)_q.
    subroutine jacobian_derivative(self, t, q, x, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), x(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (skater_type)
            value(1, 1) = self%wave*(sin(q(1))*cos(q(2))*x(1) + cos(q(1))*sin(q(2))*x(2))
            value(1, 2) = self%wave*(cos(q(1))*sin(q(2))*x(1) + sin(q(1))*cos(q(2))*x(2))
            value(2, 4) = cos(q(4))*x(1) + sin(q(4))*x(2)
            call self%spoil('jacobian_derivative', value(1, 1))
        end select
    end subroutine jacobian_derivative

    subroutine nu_derivative(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (skater_type)
            value(2, 2) = self%shear
            call self%spoil('nu_derivative', value(1, 1))
        end select
    end subroutine nu_derivative

    subroutine gamma_q(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat
        real(wp) :: squares, product

        stat = 0
        value = 0.0_wp
        squares = qd(1)**2 + qd(2)**2
        product = 2*qd(1)*qd(2)
        select type (self)
        class is (skater_type)
            value(1, 1) = self%wave*(cos(q(1))*cos(q(2))*squares - sin(q(1))*sin(q(2))*product)
            value(1, 2) = self%wave*(-sin(q(1))*sin(q(2))*squares + cos(q(1))*cos(q(2))*product)
            value(2, 4) = qd(4)*(-sin(q(4))*qd(1) + cos(q(4))*qd(2))
            call self%spoil('gamma_q', value(1, 1))
        end select
    end subroutine gamma_q

    subroutine gamma_qd(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (skater_type)
            value(1, 1) = 2*self%wave*(sin(q(1))*cos(q(2))*qd(1) + cos(q(1))*sin(q(2))*qd(2))
            value(1, 2) = 2*self%wave*(sin(q(1))*cos(q(2))*qd(2) + cos(q(1))*sin(q(2))*qd(1))
            value(2, :) = [qd(4)*cos(q(4)), qd(4)*sin(q(4)) - self%shear, 0.0_wp, cos(q(4))*qd(1) + sin(q(4))*qd(2)]
            call self%spoil('gamma_qd', value(1, 1))
        end select
    end subroutine gamma_qd

    !> (M x)_q.
    subroutine mass_derivative(self, q, x, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: q(:), x(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (skater_type)
            value(4, 1) = 2*self%growth*q(1)*x(4)
            call self%spoil('mass_derivative', value(1, 1))
        end select
    end subroutine mass_derivative

    !> (C' x)_q.
    subroutine reaction_derivative(self, t, q, x, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), x(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (skater_type)
            value(1, 1) = self%wave*sin(q(1))*cos(q(2))*x(1)
            value(2, 1) = self%wave*cos(q(1))*sin(q(2))*x(1)
            value(1, 2) = value(2, 1)
            value(2, 2) = value(1, 1)
            value(1, 4) = cos(q(4))*x(2)
            value(2, 4) = sin(q(4))*x(2)
            call self%spoil('reaction_derivative', value(1, 1))
        end select
    end subroutine reaction_derivative

    !> (S + Q_A)_q.
    subroutine force_q(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (skater_type)
            value(1, 1) = self%growth*qd(4)**2 - self%stiffness
            value(2, 2) = -3*self%stiffness*q(2)**2
            value(4, 1) = -2*self%growth*qd(1)*qd(4) + self%stiffness*q(2)
            value(4, 2) = self%stiffness*q(1)
            call self%spoil('force_q', value(1, 1))
        end select
    end subroutine force_q

    !> (S + Q_A)_qd.
    subroutine force_qd(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (skater_type)
            value(1, 4) = 2*self%growth*q(1)*qd(4)
            value(2, 2) = -self%damping
            value(4, 1) = -2*self%growth*q(1)*qd(4)
            value(4, 4) = -2*self%growth*q(1)*qd(1) - self%damping
            call self%spoil('force_qd', value(1, 1))
        end select
    end subroutine force_qd
end module model_skater
