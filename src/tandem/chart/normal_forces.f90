! SPDX-License-Identifier: MIT
!> Normal forces of friction on reactions.
!>
!> At a point the multipliers are linear in the forces: with friction B N beside S + Q_A,
!>
!>   lambda = lambda_0 + P B N,
!>
!> lambda_0 without friction, so that N solves N = p(lambda_0 + P B N), one equation per friction. As p are norms, the right side
!> contracts if the matrix K of p_i(P B_j), the normal force at i due to the friction of a normal force at j, has a spectral radius
!> below one: then N is unique, and is found by Newton's iteration, or by the contraction itself if Newton's iteration does not come
!> nearer. Otherwise there may be several motions or none, which is Painleve's paradox, and the point is refused.
module tandem_chart_normal_forces
    use tandem_kinds, only: wp
    use tandem_linalg_lu, only: lu_type
    use tandem_model, only: model_type
    use tandem_model_evaluator, only: evaluator_type
    use tandem_status, only: status_not_evaluable, status_not_finite, status_ok
    implicit none (type, external)
    private

    public :: normal_forces_type

    type :: normal_forces_type
        !> Number of frictions; if it is 0 the arrays are not allocated.
        integer :: n = 0
        !> lambda_0 (m) and P B (m, frictions), set by the chart.
        real(wp), allocatable :: first(:), reach(:, :)
        class(model_type), pointer, private :: model => null()
        !> lambda (m), K and I - p' P B (frictions, frictions).
        real(wp), allocatable, private :: lambda(:), coupling(:, :), matrix(:, :)
        !> N, the residual, a trial, a step of the contraction (frictions).
        real(wp), allocatable, private :: normals(:), residual(:), trial(:), contracted(:)
        type(lu_type), private :: lu
    contains
        procedure :: allocate => allocate_normals, add_force
        procedure, private :: contracts, find_normals, find_residual
    end type normal_forces_type

contains

    !> Allocate for a model with friction and m constraints.
    subroutine allocate_normals(self, model, m)
        class(normal_forces_type), intent(inout) :: self
        !> It must outlive this.
        class(model_type), intent(inout), target :: model
        integer, intent(in) :: m

        self%model => model
        self%n = model%n_frictions
        if (allocated(self%first)) deallocate (self%first, self%reach, self%lambda, self%coupling, self%matrix, self%normals, &
            self%residual, self%trial, self%contracted)
        associate (l => self%n)
            allocate (self%first(m), self%lambda(m), self%reach(m, l), self%coupling(l, l), self%matrix(l, l), self%normals(l), &
                self%residual(l), self%trial(l), self%contracted(l), source=0.0_wp)
            call self%lu%allocate(l)
        end associate
    end subroutine allocate_normals

    !> Add B N to the forces at a point where `first` and `reach` are set.
    subroutine add_force(self, evaluator, stat)
        class(normal_forces_type), intent(inout) :: self
        type(evaluator_type), intent(inout) :: evaluator
        !> A status code.
        integer, intent(out) :: stat
        integer :: j

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
        class(normal_forces_type), intent(inout) :: self
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
        class(normal_forces_type), intent(inout) :: self
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
        class(normal_forces_type), intent(inout) :: self
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
end module tandem_chart_normal_forces
