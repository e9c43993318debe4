! SPDX-License-Identifier: MIT
!> A pendulum on a stiff damped spring whose length, or its stretch, is a coordinate without a mass: n = 3, nh = 1, nd = 0, M
!> singular.
module model_stiff_pendulum
    use tandem, only: derivatives_type, model_type, procedure_model_type, need_all_derivatives, wp
    implicit none (type, external)
    private

    public :: stiff_pendulum_type

    type, extends(procedure_model_type) :: stiff_pendulum_type
        !> Mass, length of the spring at rest, gravity.
        real(wp) :: m = 1.0_wp, l0 = 1.0_wp, g = 9.81_wp
        !> Stiffness and damping.
        real(wp) :: k = 9810000.0_wp, c = 12.52836781069266_wp
        !> Time from which the stiffness grows a thousandfold within `fading` seconds, and the damping by the root of that.
        real(wp) :: stiffens_at = huge(1.0_wp), fading = 1.0e-2_wp
        !> Time from which that is undone, within the same duration.
        real(wp) :: softens_at = huge(1.0_wp)
        !> True if the third coordinate is the stretch l - l0, which resolves a force that the length does not.
        logical :: has_stretch = .false.
        !> True if the derivatives are given.
        logical :: has_derivatives = .false.
    contains
        procedure :: define
        procedure, private :: length
        procedure, private :: times
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
        if (.not. self%has_derivatives) return
        self%evaluate_derivatives => derivatives
        self%provides_derivatives = need_all_derivatives
    end subroutine define

    !> Ratio of the stiffness to that at the start.
    pure real(wp) function times(self, t)
        class(stiff_pendulum_type), intent(in) :: self
        real(wp), intent(in) :: t

        times = 1.0_wp
        if (t > self%stiffens_at) times = grown(min(1.0_wp, (t - self%stiffens_at)/self%fading))
        if (t > self%softens_at) times = times/grown(min(1.0_wp, (t - self%softens_at)/self%fading))
    end function times

    !> From 1 to 1000.
    pure real(wp) function grown(x)
        !> 0 to 1.
        real(wp), intent(in) :: x

        grown = 1.0e3_wp**(x**3*(10.0_wp - x*(15.0_wp - 6.0_wp*x)))
    end function grown

    !> l.
    pure real(wp) function length(self, q)
        class(stiff_pendulum_type), intent(in) :: self
        real(wp), intent(in) :: q(:)

        length = q(3) + merge(self%l0, 0.0_wp, self%has_stretch)
    end function length

    !> (x**2 + y**2 - l**2)/2 = 0.
    subroutine position(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        select type (self)
        class is (stiff_pendulum_type)
            value(1) = (q(1)**2 + q(2)**2 - self%length(q)**2)/2
        end select
    end subroutine position

    subroutine jacobian(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        stat = 0
        select type (self)
        class is (stiff_pendulum_type)
            value(1, :) = [q(1), q(2), -self%length(q)]
        end select
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
            value(3) = -self%times(t)*self%k*(q(3) - merge(0.0_wp, self%l0, self%has_stretch)) - sqrt(self%times(t))*self%c*qd(3)
        end select
    end subroutine force

    subroutine derivatives(self, need, t, q, qd, qdd, lambda, derivatives_, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:), qdd(:), lambda(:)
        type(derivatives_type), intent(inout) :: derivatives_
        integer, intent(out) :: stat

        stat = 0
        derivatives_%velocity_q(1, :) = [qd(1), qd(2), -qd(3)]
        derivatives_%acceleration_q(1, :) = [qdd(1), qdd(2), -qdd(3)]
        derivatives_%acceleration_qd(1, :) = 2*[qd(1), qd(2), -qd(3)]
        select type (self)
        class is (stiff_pendulum_type)
            derivatives_%dynamics_q = 0.0_wp
            derivatives_%dynamics_q(1, 1) = lambda(1)
            derivatives_%dynamics_q(2, 2) = lambda(1)
            derivatives_%dynamics_q(3, 3) = self%times(t)*self%k - lambda(1)
            derivatives_%dynamics_qd = 0.0_wp
            derivatives_%dynamics_qd(3, 3) = sqrt(self%times(t))*self%c
        end select
    end subroutine derivatives
end module model_stiff_pendulum
