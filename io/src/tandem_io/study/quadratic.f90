! SPDX-License-Identifier: MIT
!> A model with quadratic constraints and linear forces, for pendulums, springs and points on surfaces.
!>
!> Phi_i = q' A_i q / 2 + b_i' q + c_i, M = diag(m), Q_A = f - K q - D qd.
module tandem_io_study_quadratic
    use tandem, only: derivatives_type, model_type, need_acceleration_q, need_acceleration_qd, need_all_derivatives, &
        need_dynamics_q, need_dynamics_qd, need_force, need_gamma, need_jacobian, need_mass, need_phi, need_velocity_q, &
        terms_type, wp
    implicit none (type, external)
    private

    public :: quadratic_type

    type, extends(model_type) :: quadratic_type
        !> A_i, symmetric (n, n, nh), b_i (n, nh), c_i (nh).
        real(wp), allocatable :: a(:, :, :), b(:, :), c(:)
        !> Masses (n), some of which may be zero; constant forces (n), stiffnesses and dampings (n, n).
        real(wp), allocatable :: masses(:), force(:), stiffness(:, :), damping(:, :)
    contains
        procedure :: prepare
    end type quadratic_type

contains

    !> Set all terms to zero for a number of coordinates and of constraints.
    subroutine prepare(self, name, n, nh)
        class(quadratic_type), intent(inout) :: self
        character(len=*), intent(in) :: name
        integer, intent(in) :: n, nh

        self%name = name
        self%n = n
        self%n_holonomic = nh
        self%constant_mass = .true.
        allocate (self%a(n, n, nh), self%b(n, nh), self%c(nh), self%masses(n), self%force(n), self%stiffness(n, n), &
            self%damping(n, n), source=0.0_wp)
        self%evaluate => evaluate
        self%provides = need_phi + need_jacobian + need_gamma + need_mass + need_force
        self%evaluate_derivatives => evaluate_derivatives
        self%provides_derivatives = need_all_derivatives
        self%potential_energy => potential_energy
    end subroutine prepare

    !> Evaluate the terms.
    subroutine evaluate(self, need, t, q, qd, terms, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type), intent(inout) :: terms
        integer, intent(out) :: stat
        integer :: i

        stat = 0
        select type (self)
        class is (quadratic_type)
            do i = 1, self%n_holonomic
                if (iand(need, need_phi) /= 0) terms%phi(i) = self%c(i) + &
                    dot_product(q, 0.5_wp*matmul(self%a(:, :, i), q) + self%b(:, i))
                if (iand(need, need_jacobian) /= 0) terms%jacobian(i, :) = matmul(self%a(:, :, i), q) + self%b(:, i)
                if (iand(need, need_gamma) /= 0) terms%gamma(i) = dot_product(qd, matmul(self%a(:, :, i), qd))
            end do
            if (iand(need, need_mass) /= 0) then
                terms%mass = 0.0_wp
                do i = 1, self%n
                    terms%mass(i, i) = self%masses(i)
                end do
            end if
            if (iand(need, need_force) /= 0) terms%force = self%force - matmul(self%stiffness, q) - matmul(self%damping, qd)
        end select
    end subroutine evaluate

    !> Evaluate the derivatives, which are gradients of quadratic forms.
    subroutine evaluate_derivatives(self, need, t, q, qd, qdd, lambda, derivatives, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:), qdd(:), lambda(:)
        type(derivatives_type), intent(inout) :: derivatives
        integer, intent(out) :: stat
        integer :: i

        stat = 0
        select type (self)
        class is (quadratic_type)
            if (iand(need, need_dynamics_q) /= 0) derivatives%dynamics_q = self%stiffness
            if (iand(need, need_dynamics_qd) /= 0) derivatives%dynamics_qd = self%damping
            do i = 1, self%n_holonomic
                if (iand(need, need_velocity_q) /= 0) derivatives%velocity_q(i, :) = matmul(self%a(:, :, i), qd)
                if (iand(need, need_acceleration_q) /= 0) derivatives%acceleration_q(i, :) = matmul(self%a(:, :, i), qdd)
                if (iand(need, need_acceleration_qd) /= 0) derivatives%acceleration_qd(i, :) = 2*matmul(self%a(:, :, i), qd)
                if (iand(need, need_dynamics_q) /= 0) derivatives%dynamics_q = derivatives%dynamics_q + lambda(i)*self%a(:, :, i)
            end do
        end select
    end subroutine evaluate_derivatives

    !> -f' q + q' K q / 2.
    subroutine potential_energy(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (quadratic_type)
            value = dot_product(q, 0.5_wp*matmul(self%stiffness, q) - self%force)
        end select
    end subroutine potential_energy
end module tandem_io_study_quadratic
