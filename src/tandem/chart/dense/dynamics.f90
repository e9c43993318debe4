! SPDX-License-Identifier: MIT
!> The index-0 equations of motion at a point, given any right inverse R of C (C R = I) and any basis D of null(C):
!>
!>   qdd = D a - R gamma,   (D' M D) a = D' (S + Q_A + M R gamma)   (33), (42)
!>
!> and the multipliers lambda = R' (S + Q_A - M qdd), only on request. With D = (I - X H C) W and R = X H these are the paper's
!> formulas; every other choice gives the same qdd and lambda. M may be singular, as long as D' M D is not.
module tandem_chart_dense_dynamics
    use tandem_kinds, only: wp
    use tandem_linalg_cholesky, only: cholesky_type
    use tandem_linalg_kernels, only: add_product, add_transposed_product, set_gram, set_product
    use tandem_status, only: status_not_finite, status_ok, status_singular_mass
    implicit none (type, external)
    private

    public :: dynamics_type

    type :: dynamics_type
        private
        type(cholesky_type) :: reduced
        !> M D (n, k), D' M D (k, k), right sides (n), (k), and C qdd + gamma (m).
        real(wp), allocatable :: mass_times_basis(:, :), reduced_mass(:, :), ambient(:), rhs(:), defect(:)
    contains
        procedure :: allocate => allocate_dynamics, factor, solve, polish, project, multipliers
    end type dynamics_type

contains

    !> Allocate for n coordinates and k = n - m degrees of freedom.
    subroutine allocate_dynamics(self, n, k)
        class(dynamics_type), intent(inout) :: self
        integer, intent(in) :: n, k

        call self%reduced%allocate(k)
        if (allocated(self%rhs)) deallocate (self%mass_times_basis, self%reduced_mass, self%ambient, self%rhs, self%defect)
        allocate (self%ambient(n), self%rhs(k), self%defect(n - k), source=0.0_wp)
        ! Not filled: memory that explicit steps never touch costs nothing.
        allocate (self%mass_times_basis(n, k), self%reduced_mass(k, k))
    end subroutine allocate_dynamics

    !> Factor D' M D.
    subroutine factor(self, mass, basis, stat)
        class(dynamics_type), intent(inout) :: self
        !> M (n, n) and D (n, k).
        real(wp), intent(in), contiguous :: mass(:, :), basis(:, :)
        !> A status code.
        integer, intent(out) :: stat

        call set_product(mass, basis, self%mass_times_basis)
        call set_gram(basis, self%mass_times_basis, self%reduced_mass)
        call self%reduced%factor(self%reduced_mass, stat)
        stat = merge(status_ok, status_singular_mass, stat == 0)
    end subroutine factor

    !> The acceleration, with the factor of the same point.
    subroutine solve(self, mass, basis, right_inverse, gamma, force, qdd, stat)
        class(dynamics_type), intent(inout) :: self
        !> M (n, n), D (n, k), R (n, m), gamma (m), S + Q_A (n).
        real(wp), intent(in), contiguous :: mass(:, :), basis(:, :), right_inverse(:, :), gamma(:), force(:)
        real(wp), intent(out), contiguous :: qdd(:)
        !> A status code.
        integer, intent(out) :: stat

        stat = status_ok
        qdd = 0.0_wp
        call add_product(right_inverse, gamma, -1.0_wp, qdd)
        self%ambient = force
        call add_product(mass, qdd, -1.0_wp, self%ambient)
        self%rhs = 0.0_wp
        call add_transposed_product(basis, self%ambient, 1.0_wp, self%rhs)
        call self%reduced%solve(self%rhs)
        call add_product(basis, self%rhs, 1.0_wp, qdd)
        if (.not. sum(abs(qdd)) <= huge(1.0_wp)) stat = status_not_finite
    end subroutine solve

    !> Remove rounding errors of R and D from C qdd + gamma.
    subroutine polish(self, jacobian, right_inverse, gamma, qdd)
        class(dynamics_type), intent(inout) :: self
        !> C (m, n), R (n, m), gamma (m).
        real(wp), intent(in), contiguous :: jacobian(:, :), right_inverse(:, :), gamma(:)
        real(wp), intent(inout), contiguous :: qdd(:)

        self%defect = gamma
        call add_product(jacobian, qdd, 1.0_wp, self%defect)
        call add_product(right_inverse, self%defect, -1.0_wp, qdd)
    end subroutine polish

    !> The velocity with C qd = nu that is nearest to qd in the mass metric, with the factor of the same point.
    subroutine project(self, basis, right_inverse, nu, qd)
        class(dynamics_type), intent(inout) :: self
        !> D (n, k), R (n, m), nu (m).
        real(wp), intent(in), contiguous :: basis(:, :), right_inverse(:, :), nu(:)
        real(wp), intent(inout), contiguous :: qd(:)

        call add_product(right_inverse, nu, -1.0_wp, qd)
        self%rhs = 0.0_wp
        call add_transposed_product(self%mass_times_basis, qd, 1.0_wp, self%rhs)
        call self%reduced%solve(self%rhs)
        qd = 0.0_wp
        call add_product(right_inverse, nu, 1.0_wp, qd)
        call add_product(basis, self%rhs, 1.0_wp, qd)
    end subroutine project

    !> lambda = R' (S + Q_A - M qdd).
    subroutine multipliers(self, mass, right_inverse, force, qdd, lambda)
        class(dynamics_type), intent(inout) :: self
        !> M (n, n), R (n, m), S + Q_A (n), qdd (n).
        real(wp), intent(in), contiguous :: mass(:, :), right_inverse(:, :), force(:), qdd(:)
        !> lambda (m).
        real(wp), intent(out), contiguous :: lambda(:)

        self%ambient = force
        call add_product(mass, qdd, -1.0_wp, self%ambient)
        lambda = 0.0_wp
        call add_transposed_product(right_inverse, self%ambient, 1.0_wp, lambda)
    end subroutine multipliers
end module tandem_chart_dense_dynamics
