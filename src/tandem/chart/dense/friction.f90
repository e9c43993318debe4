! SPDX-License-Identifier: MIT
!> Friction on reactions: forces B(t, q, qd) N beside S + Q_A, whose normal forces N = p(lambda) are norms of the multipliers, with
!>
!>   lambda = lambda_0 + P B N,   P = R' (I - M D (D' M D)^-1 D').
!>
!> Once N is known B N is a force like any other, and explicit and implicit steps need nothing more. Its derivative along the motion
!> contains B N_x, with N_x = -(I - p' P B)^-1 p' P G, where G is the gradient of M qdd + C' lambda - S - Q_A - B N for constant N
!> on the manifold of accelerations; so that in the Newton matrix
!>
!>   D' (G - B N_x) = E' G,   E = D + P' p'' (I - p' P B)^-T B' D,
!>
!> that is E' (C' - B p') = 0: E corresponds to the multipliers together with their friction as D does to C'.
module tandem_chart_dense_friction
    use tandem_chart_dense_dynamics, only: dynamics_type
    use tandem_chart_normal_forces, only: normal_forces_type
    use tandem_kinds, only: wp
    use tandem_linalg_lu, only: lu_type
    use tandem_model, only: model_type
    use tandem_model_evaluator, only: evaluator_type
    use tandem_status, only: status_not_evaluable, status_ok
    implicit none (type, external)
    private

    public :: friction_type

    type :: friction_type
        !> Number of frictions; if it is 0 the arrays are not allocated.
        integer :: n = 0
        !> E (n, k) of the last `find_left_basis`.
        real(wp), allocatable :: left_basis(:, :)
        type(normal_forces_type), private :: normal_forces
        !> qdd and a force (n), no gamma and multipliers (m), I - p' P B and a column (frictions).
        real(wp), allocatable, private :: qdd(:), force(:), no_gamma(:), lambda(:), matrix(:, :), column(:)
        !> P' p'' (n, frictions) and B' D (frictions, k).
        real(wp), allocatable, private :: pressed(:, :), along(:, :)
        type(lu_type), private :: lu
    contains
        procedure :: allocate => allocate_friction, add_force, find_left_basis
    end type friction_type

contains

    !> Allocate for a model with friction, of n coordinates and m constraints.
    subroutine allocate_friction(self, model, n, m)
        class(friction_type), intent(inout) :: self
        !> It must outlive this.
        class(model_type), intent(inout), target :: model
        integer, intent(in) :: n, m

        self%n = model%n_frictions
        call self%normal_forces%allocate(model, m)
        if (allocated(self%qdd)) deallocate (self%left_basis, self%lambda, self%matrix, self%column, self%qdd, self%force, &
            self%no_gamma, self%pressed, self%along)
        associate (l => self%n)
            allocate (self%left_basis(n, n - m), self%lambda(m), self%matrix(l, l), self%column(l), self%qdd(n), self%force(n), &
                self%no_gamma(m), self%pressed(n, l), self%along(l, n - m), source=0.0_wp)
            call self%lu%allocate(l)
        end associate
    end subroutine allocate_friction

    !> Add B N to the forces at a point where all terms are known, R and D too. The factor of D' M D is left in `dynamics`.
    subroutine add_force(self, evaluator, dynamics, basis, right_inverse, t, q, qd, stat)
        class(friction_type), intent(inout) :: self
        type(evaluator_type), intent(inout) :: evaluator
        type(dynamics_type), intent(inout) :: dynamics
        !> D (n, k), R (n, m); time, coordinates and velocities (n).
        real(wp), intent(in), contiguous :: basis(:, :), right_inverse(:, :)
        real(wp), intent(in) :: t, q(:), qd(:)
        !> A status code.
        integer, intent(out) :: stat
        integer :: j

        call evaluator%find_directions(t, q, qd, stat)
        if (stat == status_ok) call dynamics%factor(evaluator%terms%mass, basis, stat)
        if (stat /= status_ok) return
        associate (terms => evaluator%terms)
            call dynamics%solve(terms%mass, basis, right_inverse, terms%gamma, terms%force, self%qdd, stat)
            if (stat /= status_ok) return
            call dynamics%multipliers(terms%mass, right_inverse, terms%force, self%qdd, self%normal_forces%first)
            do j = 1, self%n
                self%force = evaluator%directions(:, j)
                call dynamics%solve(terms%mass, basis, right_inverse, self%no_gamma, self%force, self%qdd, stat)
                if (stat /= status_ok) return
                call dynamics%multipliers(terms%mass, right_inverse, self%force, self%qdd, self%normal_forces%reach(:, j))
            end do
        end associate
        call self%normal_forces%add_force(evaluator, stat)
    end subroutine add_force

    !> E at the point of the last `add_force`, with the given D and R.
    subroutine find_left_basis(self, evaluator, dynamics, basis, right_inverse, stat)
        class(friction_type), intent(inout) :: self
        type(evaluator_type), intent(in) :: evaluator
        type(dynamics_type), intent(inout) :: dynamics
        !> D (n, k), R (n, m).
        real(wp), intent(in), contiguous :: basis(:, :), right_inverse(:, :)
        !> A status code.
        integer, intent(out) :: stat
        integer :: i, j

        call dynamics%factor(evaluator%terms%mass, basis, stat)
        if (stat /= status_ok) return
        do i = 1, self%n
            ! R p'_i less its part along D in the metric of M.
            self%lambda = evaluator%normals_gradient(i, :)
            self%pressed(:, i) = 0.0_wp
            call dynamics%project(basis, right_inverse, self%lambda, self%pressed(:, i))
        end do
        ! (I - p' P B)^-1 is applied from the right: its transpose is factored.
        self%matrix = -matmul(transpose(evaluator%directions), self%pressed)
        do i = 1, self%n
            self%matrix(i, i) = self%matrix(i, i) + 1.0_wp
        end do
        call self%lu%factor(self%matrix, stat)
        if (stat /= 0) then
            stat = status_not_evaluable
            return
        end if
        self%along = matmul(transpose(evaluator%directions), basis)
        self%left_basis = basis
        do j = 1, size(basis, 2)
            self%column = self%along(:, j)
            call self%lu%solve(self%column)
            do i = 1, self%n
                self%left_basis(:, j) = self%left_basis(:, j) + self%pressed(:, i)*self%column(i)
            end do
        end do
    end subroutine find_left_basis
end module tandem_chart_dense_friction
