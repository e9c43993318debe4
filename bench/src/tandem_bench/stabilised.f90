! SPDX-License-Identifier: MIT
!> The stabilised index-2 equations of Gear, Gupta and Leimkuhler (1985), F(t, y, yd) = 0 with the unknowns y = (q, u, lambda, mu):
!>     qd - u + Phi_q' mu = 0,  M ud + C' lambda - S - Q_A = 0,  Phi = 0,  C u - nu = 0.
!> Residual and gradients are those of the model; mu is zero in the solution, so that its derivative is omitted.
module tandem_bench_stabilised
    use tandem, only: derivatives_type, long, model_type, need_dynamics_q, need_dynamics_qd, need_force, need_gamma, &
        need_jacobian, need_mass, need_nu, need_phi, need_velocity_q, terms_type, wp
    use tandem_bench_elimination, only: dgesv
    implicit none (type, external)
    private

    public :: system_type, of_multipliers

    !> Excludes multipliers from error tests, and almost from the test of Newton's iteration.
    real(wp), parameter :: of_multipliers = 1.0e6_wp

    type :: system_type
        class(model_type), allocatable :: model
        !> Coordinates, holonomic constraints, all constraints, unknowns.
        integer :: n = 0, nh = 0, m = 0, size = 0
        !> Number of residuals so far.
        integer(long) :: evaluations = 0
        type(terms_type), private :: terms
        type(derivatives_type), private :: derivatives
    contains
        procedure :: define
        procedure :: find_residual
        procedure :: find_gradient
        procedure :: add_rates
        procedure :: multiply_rates
        procedure :: make_consistent
    end type system_type

contains

    !> Set the model.
    subroutine define(self, model)
        class(system_type), intent(inout) :: self
        class(model_type), intent(in) :: model

        if (allocated(self%model)) deallocate (self%model)
        allocate (self%model, source=model)
        self%n = model%n
        self%nh = model%n_holonomic
        self%m = model%n_constraints()
        self%size = 2*self%n + self%m + self%nh
        self%evaluations = 0
        call self%terms%allocate(self%n, self%nh, self%m - self%nh)
        call self%derivatives%allocate(self%n, self%m)
    end subroutine define

    !> F.
    subroutine find_residual(self, t, y, yd, r, stat)
        class(system_type), intent(inout) :: self
        real(wp), intent(in) :: t
        !> Unknowns and their rates (size).
        real(wp), intent(in), contiguous :: y(:), yd(:)
        real(wp), intent(inout), contiguous :: r(:)
        !> Not 0 if it cannot be evaluated.
        integer, intent(out) :: stat
        integer :: i, j

        associate (n => self%n, m => self%m, nh => self%nh, terms => self%terms)
            self%evaluations = self%evaluations + 1
            call self%model%evaluate(iand(need_phi + need_jacobian + need_nu + need_mass + need_force, &
                self%model%provides), t, y(:n), y(n + 1:2*n), terms, stat)
            do i = 1, n
                r(i) = yd(i) - y(n + i)
                do j = 1, nh
                    r(i) = r(i) + terms%jacobian(j, i)*y(2*n + m + j)
                end do
                r(n + i) = -terms%force(i)
                do j = 1, n
                    r(n + i) = r(n + i) + terms%mass(j, i)*yd(n + j)
                end do
                do j = 1, m
                    r(n + i) = r(n + i) + terms%jacobian(j, i)*y(2*n + j)
                end do
            end do
            r(2*n + 1:2*n + nh) = terms%phi
            r(2*n + nh + 1:) = -terms%nu
            do j = 1, n
                do i = 1, m
                    r(2*n + nh + i) = r(2*n + nh + i) + terms%jacobian(i, j)*y(n + j)
                end do
            end do
        end associate
    end subroutine find_residual

    !> dF/dy; M is stored for the procedures below.
    subroutine find_gradient(self, t, y, yd, a, stat)
        class(system_type), intent(inout) :: self
        real(wp), intent(in) :: t
        !> Unknowns and their rates (size).
        real(wp), intent(in), contiguous :: y(:), yd(:)
        !> (size, size).
        real(wp), intent(inout), contiguous :: a(:, :)
        integer, intent(out) :: stat
        integer :: i

        associate (n => self%n, m => self%m, nh => self%nh, terms => self%terms, d => self%derivatives)
            call self%model%evaluate(iand(need_jacobian + need_mass, self%model%provides), t, y(:n), y(n + 1:2*n), terms, stat)
            if (stat == 0) call self%model%evaluate_derivatives(need_velocity_q + need_dynamics_q + need_dynamics_qd, t, &
                y(:n), y(n + 1:2*n), yd(n + 1:2*n), y(2*n + 1:2*n + m), d, stat)
            a = 0.0_wp
            do i = 1, n
                a(i, n + i) = -1.0_wp
            end do
            a(:n, 2*n + m + 1:) = transpose(terms%jacobian(:nh, :))
            a(n + 1:2*n, :n) = d%dynamics_q
            a(n + 1:2*n, n + 1:2*n) = d%dynamics_qd
            a(n + 1:2*n, 2*n + 1:2*n + m) = transpose(terms%jacobian)
            a(2*n + 1:2*n + nh, :n) = terms%jacobian(:nh, :)
            a(2*n + nh + 1:, :n) = d%velocity_q
            a(2*n + nh + 1:, n + 1:2*n) = terms%jacobian
        end associate
    end subroutine find_gradient

    !> Add factor dF/dyd, with the last M.
    pure subroutine add_rates(self, factor, a)
        class(system_type), intent(in) :: self
        real(wp), intent(in) :: factor
        !> (size, size).
        real(wp), intent(inout), contiguous :: a(:, :)
        integer :: i, j

        associate (n => self%n)
            do j = 1, n
                a(j, j) = a(j, j) + factor
                do i = 1, n
                    a(n + i, n + j) = a(n + i, n + j) + factor*self%terms%mass(i, j)
                end do
            end do
        end associate
    end subroutine add_rates

    !> b = dF/dyd x, with the last M.
    pure subroutine multiply_rates(self, x, b)
        class(system_type), intent(in) :: self
        !> (size).
        real(wp), intent(in), contiguous :: x(:)
        real(wp), intent(inout), contiguous :: b(:)
        integer :: j

        associate (n => self%n)
            b = 0.0_wp
            b(:n) = x(:n)
            do j = 1, n
                b(n + 1:2*n) = b(n + 1:2*n) + self%terms%mass(:, j)*x(n + j)
            end do
        end associate
    end subroutine multiply_rates

    !> At a start or a breakpoint: the nearest velocity in the mass metric, then the accelerations and multipliers.
    subroutine make_consistent(self, t, y, yd, stat)
        class(system_type), intent(inout) :: self
        real(wp), intent(in) :: t
        !> Unknowns and their rates (size): coordinates and a velocity on entry.
        real(wp), intent(inout), contiguous :: y(:), yd(:)
        integer, intent(out) :: stat
        real(wp), allocatable :: a(:, :), b(:, :)
        integer, allocatable :: pivots(:)
        integer :: level, k, need

        associate (n => self%n, m => self%m, terms => self%terms, model => self%model)
            k = n + m
            allocate (a(k, k), b(k, 1), pivots(k))
            need = iand(need_jacobian + need_nu + need_gamma + need_mass + need_force, model%provides)
            do level = 1, 2
                call model%evaluate(need, t, y(:n), y(n + 1:2*n), terms, stat)
                if (stat /= 0) return
                a = 0.0_wp
                a(:n, :n) = terms%mass
                a(n + 1:, :n) = terms%jacobian
                a(:n, n + 1:) = transpose(terms%jacobian)
                if (level == 1) then
                    b(:n, 1) = 0.0_wp
                    b(n + 1:, 1) = terms%nu - matmul(terms%jacobian, y(n + 1:2*n))
                else
                    b(:n, 1) = terms%force
                    b(n + 1:, 1) = -terms%gamma
                end if
                call dgesv(k, 1, a, k, pivots, b, k, stat)
                if (stat /= 0) return
                if (level == 1) y(n + 1:2*n) = y(n + 1:2*n) + b(:n, 1)
            end do
            yd = 0.0_wp
            yd(:n) = y(n + 1:2*n)
            yd(n + 1:2*n) = b(:n, 1)
            y(2*n + 1:2*n + m) = b(n + 1:, 1)
            y(2*n + m + 1:) = 0.0_wp
        end associate
    end subroutine make_consistent
end module tandem_bench_stabilised
