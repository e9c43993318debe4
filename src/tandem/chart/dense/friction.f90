! SPDX-License-Identifier: MIT
!> Friction on reactions: forces B(t, q, qd) N beside S + Q_A, whose normal forces N = p(lambda) are norms of the multipliers.
!>
!> At a point qdd and lambda are linear in the forces,
!>
!>   lambda = lambda_0 + P B N,   P = R' (I - M D (D' M D)^-1 D'),
!>
!> lambda_0 without friction, so that N solves N = p(lambda_0 + P B N), one equation per friction. As p are norms, the right side
!> contracts if the matrix K of p_i(P B_j), the normal force at i due to the friction of a normal force at j, has a spectral radius
!> below one: then N is unique, and is found by Newton's iteration, or by the contraction itself if Newton's iteration does not come
!> nearer. Otherwise there may be several motions or none, which is Painleve's paradox, and the point is refused.
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
    use tandem_kinds, only: wp
    use tandem_linalg_lu, only: lu_type
    use tandem_model, only: model_type
    use tandem_model_evaluator, only: evaluator_type
    use tandem_status, only: status_not_evaluable, status_not_finite, status_ok
    implicit none (type, external)
    private

    public :: friction_type

    type :: friction_type
        !> Number of frictions; if it is 0 the arrays are not allocated.
        integer :: n = 0
        !> E (n, k) of the last `find_left_basis`.
        real(wp), allocatable :: left_basis(:, :)
        class(model_type), pointer, private :: model => null()
        !> lambda_0 and lambda (m), P B (m, frictions), K and I - p' P B (frictions, frictions).
        real(wp), allocatable, private :: first(:), lambda(:), reach(:, :), coupling(:, :), matrix(:, :)
        !> N, the residual, a trial, a step of the contraction (frictions), qdd and a force (n), no gamma (m).
        real(wp), allocatable, private :: normals(:), residual(:), trial(:), contracted(:), qdd(:), force(:), no_gamma(:)
        !> P' p'' (n, frictions) and B' D (frictions, k).
        real(wp), allocatable, private :: pressed(:, :), along(:, :)
        type(lu_type), private :: lu
    contains
        procedure :: allocate => allocate_friction, add_force, find_left_basis
        procedure, private :: contracts, find_normals, find_residual
    end type friction_type

contains

    !> Allocate for a model with friction, of n coordinates and m constraints.
    subroutine allocate_friction(self, model, n, m)
        class(friction_type), intent(inout) :: self
        !> It must outlive this.
        class(model_type), intent(inout), target :: model
        integer, intent(in) :: n, m

        self%model => model
        self%n = model%n_frictions
        if (allocated(self%first)) deallocate (self%left_basis, self%first, self%lambda, self%reach, self%coupling, self%matrix, &
            self%normals, self%residual, self%trial, self%contracted, self%qdd, self%force, self%no_gamma, self%pressed, self%along)
        associate (l => self%n)
            allocate (self%left_basis(n, n - m), self%first(m), self%lambda(m), self%reach(m, l), self%coupling(l, l), &
                self%matrix(l, l), self%normals(l), self%residual(l), self%trial(l), self%contracted(l), self%qdd(n), &
                self%force(n), self%no_gamma(m), self%pressed(n, l), self%along(l, n - m), source=0.0_wp)
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
            call dynamics%solve(terms%mass, terms%jacobian, basis, right_inverse, terms%gamma, terms%force, .false., self%qdd, stat)
            if (stat /= status_ok) return
            call dynamics%multipliers(terms%mass, right_inverse, terms%force, self%qdd, self%first)
            do j = 1, self%n
                self%force = evaluator%directions(:, j)
                call dynamics%solve(terms%mass, terms%jacobian, basis, right_inverse, self%no_gamma, self%force, .false., &
                    self%qdd, stat)
                if (stat /= status_ok) return
                call dynamics%multipliers(terms%mass, right_inverse, self%force, self%qdd, self%reach(:, j))
            end do
        end associate
        if (self%contracts(evaluator)) then
            call self%find_normals(evaluator, stat)
        else
            stat = status_not_evaluable
        end if
        if (stat /= status_ok) then
            evaluator%failed_term = 'friction (jammed)'
            return
        end if
        do j = 1, self%n
            evaluator%terms%force = evaluator%terms%force + self%normals(j)*evaluator%directions(:, j)
        end do
        if (.not. sum(abs(evaluator%terms%force)) <= huge(1.0_wp)) stat = status_not_finite
    end subroutine add_force

    !> True if the spectral radius of K is below one. For any x > 0 it is at most the largest (K x)_i/x_i; powers of K improve x.
    logical function contracts(self, evaluator)
        class(friction_type), intent(inout) :: self
        type(evaluator_type), intent(inout) :: evaluator
        integer, parameter :: most = 30
        integer :: j, k

        do j = 1, self%n
            call self%model%normal_forces(self%reach(:, j), self%coupling(:, j), evaluator%normals_gradient)
        end do
        contracts = .true.
        self%trial = 1.0_wp
        do k = 1, most
            self%residual = matmul(self%coupling, self%trial)
            if (all(self%residual < self%trial)) return
            ! Half of x itself keeps x positive.
            self%trial = self%residual + 0.5_wp*self%trial
            self%trial = self%trial/maxval(self%trial)
        end do
        contracts = .false.
    end function contracts

    !> Solve N = p(lambda_0 + P B N).
    subroutine find_normals(self, evaluator, stat)
        class(friction_type), intent(inout) :: self
        type(evaluator_type), intent(inout) :: evaluator
        !> A status code.
        integer, intent(out) :: stat
        !> A contraction by a half reaches rounding level in fifty steps; Newton's iteration takes two or three.
        integer, parameter :: most = 200
        !> Rounding error of the sums for N, and the largest one allowed, when the spectral radius of K is near one.
        real(wp), parameter :: enough = 8*epsilon(1.0_wp), most_left = 1.0e-12_wp
        real(wp) :: size_of, last
        integer :: k, i

        stat = status_ok
        self%normals = 0.0_wp
        call self%find_residual(evaluator, self%normals)
        last = sum(abs(self%residual))
        size_of = 0.0_wp
        do k = 1, most
            if (.not. last <= huge(last)) exit
            do i = 1, self%n
                self%matrix(:, i) = -matmul(evaluator%normals_gradient, self%reach(:, i))
                self%matrix(i, i) = self%matrix(i, i) + 1.0_wp
            end do
            self%trial = -self%residual
            call self%lu%factor(self%matrix, stat)
            if (stat == 0) call self%lu%solve(self%trial)
            ! p(...) is N less the residual.
            if (stat /= 0) self%trial = -self%residual
            stat = status_ok
            self%trial = max(0.0_wp, self%normals + self%trial)
            self%contracted = self%normals - self%residual
            call self%find_residual(evaluator, self%trial)
            if (.not. sum(abs(self%residual)) < last) then
                self%trial = self%contracted
                call self%find_residual(evaluator, self%trial)
            end if
            self%normals = self%trial
            last = sum(abs(self%residual))
            size_of = sum(abs(self%normals)) + sum(abs(self%first))
            if (last <= enough*size_of) return
        end do
        if (.not. last <= most_left*size_of) stat = status_not_evaluable
    end subroutine find_normals

    !> N - p(lambda_0 + P B N), and the gradient of p there.
    subroutine find_residual(self, evaluator, normals)
        class(friction_type), intent(inout) :: self
        type(evaluator_type), intent(inout) :: evaluator
        real(wp), intent(in) :: normals(:)
        integer :: j

        self%lambda = self%first
        do j = 1, self%n
            self%lambda = self%lambda + self%reach(:, j)*normals(j)
        end do
        call self%model%normal_forces(self%lambda, self%residual, evaluator%normals_gradient)
        self%residual = normals - self%residual
    end subroutine find_residual

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
            self%trial = self%along(:, j)
            call self%lu%solve(self%trial)
            do i = 1, self%n
                self%left_basis(:, j) = self%left_basis(:, j) + self%pressed(:, i)*self%trial(i)
            end do
        end do
    end subroutine find_left_basis
end module tandem_chart_dense_friction
