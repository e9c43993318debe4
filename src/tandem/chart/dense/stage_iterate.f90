! SPDX-License-Identifier: MIT
!> Iterates of an implicit stage near the manifold.
!>
!> Newton's iteration for the rates of a stage moves its point along V and W. Each iterate is brought back by one correction per
!> level, with factors of Phi_q U and C X made at the stage's first iterate:
!>
!>   u := u + (Phi_q U)^-1 Phi,          q = q0 + xi - U u
!>   x := x + (C X)^-1 (C qd - nu),      qd = qd0 + eta - X x
!>   z := z + (C X)^-1 (C qdd + gamma),  qdd = W wd - X z
!>   lambda := lambda + (C X)^-T X' (S + Q_A - M qdd - C' lambda)
!>
!> u, x, z and lambda continue from the iterate before, so that the errors that one correction leaves are products of the changes of
!> the point and of the factors: Newton's iteration contracts as if each iterate were restored completely. With the factors of the
!> chart's origin it would not: C turns by a large angle within a step.
module tandem_chart_dense_stage_iterate
    use tandem_kinds, only: wp
    use tandem_linalg_kernels, only: add_product, add_transposed_product
    use tandem_linalg_lu, only: lu_type
    use tandem_status, only: status_chart_left, status_ok
    implicit none (type, external)
    private

    public :: stage_iterate_type

    type :: stage_iterate_type
        !> u (nh) and lambda (m).
        real(wp), allocatable :: u(:), lambda(:)
        !> Size of the corrections of u, x and z at the last iterate, as changes of q, qd and qdd (n).
        real(wp), allocatable :: moved_q(:), moved_qd(:), moved_qdd(:)
        !> Sum of the changes of the stage's coordinates since its factors were made, relative to them.
        real(wp) :: drift = 0.0_wp
        type(lu_type), private :: phi_u_lu, c_x_lu
        !> X (C X)^-1 (n, m) for few rows: corrections are then products, which take less time than solutions. Without columns for
        !> many rows.
        real(wp), allocatable, private :: inverse(:, :)
        !> -X x and -X z (n); true until x, z and lambda have been found once.
        real(wp), allocatable, private :: shift_qd(:), shift_qdd(:), rows(:)
        logical, private :: is_new = .true.
    contains
        procedure :: allocate => allocate_iterate, factor_position, factor_velocity
        procedure :: correct_position, correct_velocity, correct_acceleration, remove_reaction
    end type stage_iterate_type

contains

    !> Allocate for n coordinates, nh holonomic constraints and m in all.
    subroutine allocate_iterate(self, n, nh, m)
        class(stage_iterate_type), intent(inout) :: self
        integer, intent(in) :: n, nh, m
        !> A stage is corrected three times per iterate, two or three iterates long: more rows are not worth n m^2 operations.
        integer, parameter :: few = 16

        if (allocated(self%u)) deallocate (self%u, self%lambda, self%moved_q, self%moved_qd, self%moved_qdd, &
            self%shift_qd, self%shift_qdd, self%rows, self%inverse)
        allocate (self%u(nh), self%lambda(m), self%moved_q(n), self%moved_qd(n), self%moved_qdd(n), &
            self%shift_qd(n), self%shift_qdd(n), self%rows(m), self%inverse(n, merge(m, 0, m <= few)), source=0.0_wp)
        call self%phi_u_lu%allocate(nh)
        call self%c_x_lu%allocate(m)
    end subroutine allocate_iterate

    !> Factor Phi_q U.
    subroutine factor_position(self, jacobian, u_basis, stat)
        class(stage_iterate_type), intent(inout) :: self
        !> C (m, n), U (n, nh).
        real(wp), intent(in), contiguous :: jacobian(:, :), u_basis(:, :)
        !> A status code.
        integer, intent(out) :: stat

        call self%phi_u_lu%factor_product(jacobian, u_basis, stat)
        stat = merge(status_ok, status_chart_left, stat == 0)
    end subroutine factor_position

    !> Factor C X; x, z and lambda begin anew.
    subroutine factor_velocity(self, jacobian, x_basis, stat)
        class(stage_iterate_type), intent(inout) :: self
        !> C (m, n), X (n, m).
        real(wp), intent(in), contiguous :: jacobian(:, :), x_basis(:, :)
        !> A status code.
        integer, intent(out) :: stat

        call self%c_x_lu%factor_product(jacobian, x_basis, stat)
        stat = merge(status_ok, status_chart_left, stat == 0)
        self%is_new = .true.
        if (size(self%inverse, 2) == 0 .or. stat /= status_ok) return
        self%inverse(:, :) = x_basis
        call self%c_x_lu%solve_rows(self%inverse)
    end subroutine factor_velocity

    !> q corrected towards Phi = 0.
    subroutine correct_position(self, phi, u_basis, q)
        class(stage_iterate_type), intent(inout) :: self
        !> Phi at q (nh), U (n, nh).
        real(wp), intent(in), contiguous :: phi(:), u_basis(:, :)
        real(wp), intent(inout), contiguous :: q(:)

        associate (du => self%rows(:size(self%u)))
            du = phi
            call self%phi_u_lu%solve(du)
            self%u = self%u + du
            self%moved_q = 0.0_wp
            call add_product(u_basis, du, -1.0_wp, self%moved_q)
        end associate
        q = q + self%moved_q
    end subroutine correct_position

    !> qd := qd - X x, corrected towards C qd = nu.
    subroutine correct_velocity(self, jacobian, nu, x_basis, qd)
        class(stage_iterate_type), intent(inout) :: self
        !> C (m, n), nu (m), X (n, m).
        real(wp), intent(in), contiguous :: jacobian(:, :), nu(:), x_basis(:, :)
        !> On entry qd0 + eta (n).
        real(wp), intent(inout), contiguous :: qd(:)

        if (.not. self%is_new) qd = qd + self%shift_qd
        self%rows = -nu
        call add_product(jacobian, qd, 1.0_wp, self%rows)
        call move_by(self, x_basis, self%shift_qd, self%moved_qd, qd)
    end subroutine correct_velocity

    !> qdd := qdd - X z, corrected towards C qdd = -gamma.
    subroutine correct_acceleration(self, jacobian, gamma, x_basis, qdd)
        class(stage_iterate_type), intent(inout) :: self
        !> C (m, n), gamma (m), X (n, m).
        real(wp), intent(in), contiguous :: jacobian(:, :), gamma(:), x_basis(:, :)
        !> On entry W wd (n).
        real(wp), intent(inout), contiguous :: qdd(:)

        if (.not. self%is_new) qdd = qdd + self%shift_qdd
        self%rows = gamma
        call add_product(jacobian, qdd, 1.0_wp, self%rows)
        call move_by(self, x_basis, self%shift_qdd, self%moved_qdd, qdd)
    end subroutine correct_acceleration

    !> y := y - X (C X)^-1 r for the r in `rows`. The first such change of a stage is no correction.
    subroutine move_by(self, x_basis, shift, moved, y)
        class(stage_iterate_type), intent(inout) :: self
        !> X (n, m).
        real(wp), intent(in), contiguous :: x_basis(:, :)
        !> Sum of the changes and this one, zero if it is the first; y (n).
        real(wp), intent(inout), contiguous :: shift(:), moved(:), y(:)

        moved = 0.0_wp
        if (size(self%inverse, 2) > 0) then
            call add_product(self%inverse, self%rows, -1.0_wp, moved)
        else
            call self%c_x_lu%solve(self%rows)
            call add_product(x_basis, self%rows, -1.0_wp, moved)
        end if
        y = y + moved
        if (self%is_new) then
            shift = moved
            moved = 0.0_wp
        else
            shift = shift + moved
        end if
    end subroutine move_by

    !> f := f - C' lambda with lambda corrected towards X' f = 0, after which W' f is D' f.
    subroutine remove_reaction(self, jacobian, x_basis, force)
        class(stage_iterate_type), intent(inout) :: self
        !> C (m, n), X (n, m).
        real(wp), intent(in), contiguous :: jacobian(:, :), x_basis(:, :)
        real(wp), intent(inout), contiguous :: force(:)

        if (self%is_new) then
            self%lambda = 0.0_wp
        else
            call add_transposed_product(jacobian, self%lambda, -1.0_wp, force)
        end if
        self%rows = 0.0_wp
        if (size(self%inverse, 2) > 0) then
            call add_transposed_product(self%inverse, force, 1.0_wp, self%rows)
        else
            call add_transposed_product(x_basis, force, 1.0_wp, self%rows)
            call self%c_x_lu%solve_transposed(self%rows)
        end if
        self%lambda = self%lambda + self%rows
        self%is_new = .false.
        call add_transposed_product(jacobian, self%rows, -1.0_wp, force)
    end subroutine remove_reaction
end module tandem_chart_dense_stage_iterate
