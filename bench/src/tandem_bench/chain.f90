! SPDX-License-Identifier: MIT
!> A planar chain of N equal rods that hang in a row from a fixed point, in absolute coordinates, to measure cost against system
!> size.
!>
!> q = (x, y, phi) of each rod: its centre, and its angle from the downward vertical. Each revolute joint is two holonomic
!> constraints; the chain has N degrees of freedom.
module tandem_bench_chain
    use tandem, only: derivatives_type, label_length, model_type, need_acceleration_q, need_acceleration_qd, &
        need_all_derivatives, need_dynamics_q, need_dynamics_qd, need_force, need_gamma, need_jacobian, need_mass, need_phi, &
        need_velocity_q, terms_type, wp
    implicit none (type, external)
    private

    public :: chain_type

    type, extends(model_type) :: chain_type
        !> Number of rods.
        integer :: rods = 1
        !> Mass (kg) and length (m) of a rod, acceleration due to gravity (m/s^2).
        real(wp) :: mass = 1.0_wp, length = 1.0_wp, gravity = 9.81_wp
    contains
        procedure :: define
        procedure :: start
    end type chain_type

contains

    !> Associate the procedures; to be called after the parameters are set.
    subroutine define(self)
        class(chain_type), intent(inout) :: self

        self%name = 'chain'
        self%n = 3*self%rods
        self%n_holonomic = 2*self%rods
        self%constant_mass = .true.
        self%evaluate => evaluate
        self%provides = need_phi + need_jacobian + need_gamma + need_mass + need_force
        self%evaluate_derivatives => evaluate_derivatives
        self%provides_derivatives = need_all_derivatives
        self%potential_energy => potential_energy
    end subroutine define

    !> All rods in one line at an angle (rad) from the vertical, at rest.
    pure subroutine start(self, angle, q, qd)
        class(chain_type), intent(in) :: self
        real(wp), intent(in) :: angle
        real(wp), intent(out) :: q(:), qd(:)
        integer :: i

        do i = 1, self%rods
            q(3*i - 2:3*i) = [(i - 0.5_wp)*self%length*sin(angle), -(i - 0.5_wp)*self%length*cos(angle), angle]
        end do
        qd = 0.0_wp
    end subroutine start

    !> Evaluate the terms. Joint i is at the upper end of rod i and at the lower end of rod i - 1, with the same signs.
    subroutine evaluate(self, need, t, q, qd, terms, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type), intent(inout) :: terms
        integer, intent(out) :: stat
        real(wp) :: c, s, half
        integer :: i, j

        stat = 0
        select type (self)
        class is (chain_type)
            half = 0.5_wp*self%length
            if (iand(need, need_phi) /= 0) terms%phi = 0.0_wp
            if (iand(need, need_jacobian) /= 0) terms%jacobian = 0.0_wp
            if (iand(need, need_gamma) /= 0) terms%gamma = 0.0_wp
            if (iand(need, need_mass) /= 0) terms%mass = 0.0_wp
            do i = 1, self%rods
                c = half*cos(q(3*i))
                s = half*sin(q(3*i))
                do j = i, min(i + 1, self%rods)
                    associate (x => 2*j - 1, y => 2*j, side => merge(1.0_wp, -1.0_wp, j == i))
                        if (iand(need, need_phi) /= 0) then
                            terms%phi(x) = terms%phi(x) + side*q(3*i - 2) - s
                            terms%phi(y) = terms%phi(y) + side*q(3*i - 1) + c
                        end if
                        if (iand(need, need_jacobian) /= 0) then
                            terms%jacobian(x, 3*i - 2) = side
                            terms%jacobian(y, 3*i - 1) = side
                            terms%jacobian(x, 3*i) = -c
                            terms%jacobian(y, 3*i) = -s
                        end if
                        if (iand(need, need_gamma) /= 0) then
                            terms%gamma(x) = terms%gamma(x) + s*qd(3*i)**2
                            terms%gamma(y) = terms%gamma(y) - c*qd(3*i)**2
                        end if
                    end associate
                end do
                if (iand(need, need_mass) /= 0) then
                    terms%mass(3*i - 2, 3*i - 2) = self%mass
                    terms%mass(3*i - 1, 3*i - 1) = self%mass
                    terms%mass(3*i, 3*i) = self%mass*self%length**2/12
                end if
                if (iand(need, need_force) /= 0) terms%force(3*i - 2:3*i) = [0.0_wp, -self%mass*self%gravity, 0.0_wp]
            end do
        end select
    end subroutine evaluate

    !> Gradients of the velocity and acceleration constraints and of the equations of motion: with respect to the angles only.
    subroutine evaluate_derivatives(self, need, t, q, qd, qdd, lambda, derivatives, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:), qdd(:), lambda(:)
        type(derivatives_type), intent(inout) :: derivatives
        integer, intent(out) :: stat
        real(wp) :: c, s, half
        integer :: i, j

        stat = 0
        select type (self)
        class is (chain_type)
            half = 0.5_wp*self%length
            if (iand(need, need_velocity_q) /= 0) derivatives%velocity_q = 0.0_wp
            if (iand(need, need_acceleration_q) /= 0) derivatives%acceleration_q = 0.0_wp
            if (iand(need, need_acceleration_qd) /= 0) derivatives%acceleration_qd = 0.0_wp
            if (iand(need, need_dynamics_q) /= 0) derivatives%dynamics_q = 0.0_wp
            if (iand(need, need_dynamics_qd) /= 0) derivatives%dynamics_qd = 0.0_wp
            do i = 1, self%rods
                c = half*cos(q(3*i))
                s = half*sin(q(3*i))
                associate (k => 3*i, rate => qd(3*i), second => qdd(3*i))
                    do j = i, min(i + 1, self%rods)
                        associate (x => 2*j - 1, y => 2*j)
                            if (iand(need, need_velocity_q) /= 0) then
                                derivatives%velocity_q(x, k) = s*rate
                                derivatives%velocity_q(y, k) = -c*rate
                            end if
                            if (iand(need, need_acceleration_q) /= 0) then
                                derivatives%acceleration_q(x, k) = s*second + c*rate**2
                                derivatives%acceleration_q(y, k) = -c*second + s*rate**2
                            end if
                            if (iand(need, need_acceleration_qd) /= 0) then
                                derivatives%acceleration_qd(x, k) = 2*s*rate
                                derivatives%acceleration_qd(y, k) = -2*c*rate
                            end if
                            if (iand(need, need_dynamics_q) /= 0) then
                                derivatives%dynamics_q(k, k) = derivatives%dynamics_q(k, k) + s*lambda(x) - c*lambda(y)
                            end if
                        end associate
                    end do
                end associate
            end do
        end select
    end subroutine evaluate_derivatives

    !> V = sum m g y.
    subroutine potential_energy(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (chain_type)
            value = self%mass*self%gravity*sum(q(2::3))
        end select
    end subroutine potential_energy
end module tandem_bench_chain
