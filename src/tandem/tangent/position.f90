! SPDX-License-Identifier: MIT
!> The position level of a chart: u with Phi(t, q0 + xi - U u) = 0 by Newton's iteration (17), and the matrix B = (Phi_q U)^-1
!> (13) that it needs, factored once a step or refined at every point as in the paper (20).
module tandem_tangent_position
    use tandem_kinds, only: wp
    use tandem_linalg_kernels, only: add_product
    use tandem_linalg_lu, only: lu_type
    use tandem_model_evaluator, only: evaluator_type
    use tandem_model_terms, only: need_phi
    use tandem_pack, only: pack_type
    use tandem_status, only: status_chart_left, status_not_finite, status_ok, status_position_diverged
    use tandem_tangent_counts, only: counts_type
    use tandem_tangent_refinement, only: refinement_type
    implicit none (type, external)
    private

    public :: position_type

    type :: position_type
        !> diag(s) U (n, nh).
        real(wp), allocatable :: u_basis(:, :)
        !> After a failure: the worst row and its error on its natural scale.
        integer :: failed_row = 0
        real(wp) :: failed_value = 0.0_wp
        !> Most corrections that an iteration for u, or a refinement of B, has taken since the caller set this to zero.
        integer :: most_corrections = 0
        logical, private :: refines = .false.
        integer, private :: n = 0, nh = 0
        real(wp), private :: utol = 0.0_wp, stage_utol = 0.0_wp, btol = 0.0_wp
        !> u (nh), carried from stage to stage as a start value; Phi_q U (nh, nh); natural scales of the rows (nh).
        real(wp), allocatable, private :: u(:), correction(:), phi_u(:, :), row_scale(:), errors(:), origin(:)
        !> u and B while the caller looks elsewhere.
        real(wp), allocatable, private :: held_u(:), held_b(:, :)
        type(lu_type), private :: lu
        type(refinement_type), private :: b
    contains
        procedure :: allocate => allocate_position
        procedure :: start
        procedure :: refresh
        procedure :: refine
        procedure :: restore
        procedure :: subtract_correction
        procedure :: get_b_phi
        procedure :: hold
        procedure :: release
        procedure :: pack_state
        procedure, private :: set_phi_u
        procedure, private :: factor
    end type position_type

contains

    !> Allocate for n coordinates and nh holonomic constraints.
    subroutine allocate_position(self, n, nh, refines, utol, stage_utol, btol)
        class(position_type), intent(inout) :: self
        integer, intent(in) :: n, nh
        !> Whether B follows by the paper's refinement; tolerances of (17) on the natural scale, at the ends of steps and at stages,
        !> and of (20).
        logical, intent(in) :: refines
        real(wp), intent(in) :: utol, stage_utol, btol

        self%n = n
        self%nh = nh
        self%refines = refines
        self%utol = max(utol, 2.0e-15_wp)
        self%stage_utol = max(stage_utol, self%utol)
        self%btol = btol
        self%u = spread(0.0_wp, 1, nh)
        self%correction = self%u
        self%held_u = self%u
        self%row_scale = self%u
        self%errors = self%u
        self%origin = spread(0.0_wp, 1, n)
        if (allocated(self%u_basis)) deallocate (self%u_basis, self%phi_u, self%held_b)
        allocate (self%u_basis(n, nh), self%phi_u(nh, nh), self%held_b(nh, nh), source=0.0_wp)
        call self%lu%allocate(nh)
        call self%b%allocate(nh)
    end subroutine allocate_position

    !> Begin at the origin of a new chart; `u_basis` is set.
    subroutine start(self, jacobian, q, scale, counts, stat)
        class(position_type), intent(inout) :: self
        !> C (m, n), q (n) and coordinate scales (n).
        real(wp), intent(in), contiguous :: jacobian(:, :), q(:), scale(:)
        type(counts_type), intent(inout) :: counts
        !> A status code.
        integer, intent(out) :: stat

        stat = status_ok
        self%u = 0.0_wp
        if (self%nh == 0) return
        call self%refresh(jacobian, q, scale, counts, stat)
        if (stat /= status_ok .or. .not. self%refines) return
        call self%factor(jacobian, counts, stat)
        if (stat == status_ok) call self%lu%invert(self%b%inverse)
    end subroutine start

    !> Bring row scales and the factor of Phi_q U to a point: frozen at the origin it would be too weak on a large chart.
    subroutine refresh(self, jacobian, q, scale, counts, stat)
        class(position_type), intent(inout) :: self
        real(wp), intent(in), contiguous :: jacobian(:, :), q(:), scale(:)
        type(counts_type), intent(inout) :: counts
        integer, intent(out) :: stat
        real(wp) :: magnitude
        integer :: i, j

        stat = status_ok
        if (self%nh == 0) return
        self%row_scale = tiny(1.0_wp)
        do j = 1, self%n
            magnitude = max(abs(q(j)), scale(j))
            do i = 1, self%nh
                self%row_scale(i) = self%row_scale(i) + abs(jacobian(i, j))*magnitude
            end do
        end do
        if (.not. self%refines) call self%factor(jacobian, counts, stat)
    end subroutine refresh

    !> With `refine`: bring B to C at a point (20).
    subroutine refine(self, jacobian, counts, stat)
        class(position_type), intent(inout) :: self
        real(wp), intent(in), contiguous :: jacobian(:, :)
        type(counts_type), intent(inout) :: counts
        integer, intent(out) :: stat

        stat = status_ok
        if (self%nh == 0 .or. .not. self%refines) return
        call self%set_phi_u(jacobian)
        call self%b%refine(self%phi_u, self%btol, counts%b_corrections, stat)
        self%most_corrections = max(self%most_corrections, self%b%last_corrections)
    end subroutine refine

    !> q = origin + increment - U u with Phi(t, q) = 0; leaves Phi at q in the evaluator.
    subroutine restore(self, model, t, origin, increment, is_stage, q, counts, stat)
        class(position_type), intent(inout) :: self
        type(evaluator_type), intent(inout) :: model
        real(wp), intent(in) :: t
        !> q0 (n) and xi (n).
        real(wp), intent(in), contiguous :: origin(:), increment(:)
        !> Whether the tolerance of stages suffices.
        logical, intent(in) :: is_stage
        real(wp), intent(out), contiguous :: q(:)
        type(counts_type), intent(inout) :: counts
        !> A status code.
        integer, intent(out) :: stat
        !> A contraction by 0.5 reaches 1e-12 from 1 in 40; whatever is slower has left the chart.
        integer, parameter :: limit = 40
        real(wp) :: error, first_error, utol
        integer :: k

        stat = status_ok
        self%failed_row = 0
        self%origin = origin + increment
        q = self%origin
        if (self%nh == 0) return
        first_error = 0.0_wp
        utol = merge(self%stage_utol, self%utol, is_stage)
        do k = 0, limit
            q = self%origin
            call add_product(self%u_basis, self%u, -1.0_wp, q)
            ! Phi does not depend on the velocity; q stands in for it.
            call model%evaluate(need_phi, t, q, q, counts, stat)
            if (stat /= status_ok) return
            self%errors = abs(model%terms%phi)/self%row_scale
            error = maxval(self%errors)
            if (all(self%errors <= utol)) return
            if (.not. sum(self%errors) <= huge(1.0_wp)) then
                model%failed_term = 'phi'
                stat = status_not_finite
                self%u = 0.0_wp
                return
            end if
            if (k == 0) first_error = error
            if (k == limit .or. .not. error <= 1.0e3_wp*max(first_error, self%utol)) exit
            if (self%refines) then
                self%correction = 0.0_wp
                call add_product(self%b%inverse, model%terms%phi, 1.0_wp, self%correction)
            else
                self%correction = model%terms%phi
                call self%lu%solve(self%correction)
            end if
            self%u = self%u + self%correction
            counts%position_corrections = counts%position_corrections + 1
            self%most_corrections = max(self%most_corrections, k + 1)
        end do
        stat = status_position_diverged
        self%failed_row = maxloc(self%errors, dim=1)
        self%failed_value = maxval(self%errors)
        ! Nothing of a failed iteration may reach the next step.
        self%u = 0.0_wp
    end subroutine restore

    !> Keep what the next step starts from, so that a look at another point leaves no trace.
    subroutine hold(self)
        class(position_type), intent(inout) :: self

        self%held_u = self%u
        if (self%refines) self%held_b = self%b%inverse
    end subroutine hold

    !> Go back to what was kept.
    subroutine release(self)
        class(position_type), intent(inout) :: self

        self%u = self%held_u
        if (self%refines) self%b%inverse = self%held_b
    end subroutine release

    !> x := x - U u with the u of the last `restore`.
    pure subroutine subtract_correction(self, x)
        class(position_type), intent(in) :: self
        !> (n)
        real(wp), intent(inout), contiguous :: x(:)

        if (self%nh > 0) call add_product(self%u_basis, self%u, -1.0_wp, x)
    end subroutine subtract_correction

    !> B Phi_q (nh, n) at a point.
    subroutine get_b_phi(self, jacobian, b_phi, counts, stat)
        class(position_type), intent(inout) :: self
        real(wp), intent(in), contiguous :: jacobian(:, :)
        real(wp), intent(out), contiguous :: b_phi(:, :)
        type(counts_type), intent(inout) :: counts
        integer, intent(out) :: stat
        integer :: j, l

        stat = status_ok
        if (self%nh == 0) return
        if (.not. self%refines) then
            call self%factor(jacobian, counts, stat)
            if (stat /= status_ok) return
            call self%lu%invert(self%b%inverse)
        end if
        b_phi = 0.0_wp
        do j = 1, self%n
            do l = 1, self%nh
                b_phi(:, j) = b_phi(:, j) + self%b%inverse(:, l)*jacobian(l, j)
            end do
        end do
    end subroutine get_b_phi

    !> Factor Phi_q U at a point.
    subroutine factor(self, jacobian, counts, stat)
        class(position_type), intent(inout) :: self
        real(wp), intent(in), contiguous :: jacobian(:, :)
        type(counts_type), intent(inout) :: counts
        integer, intent(out) :: stat

        call self%set_phi_u(jacobian)
        call self%lu%factor(self%phi_u, stat)
        counts%position_factorizations = counts%position_factorizations + 1
        stat = merge(status_ok, status_chart_left, stat == 0)
    end subroutine factor

    !> Phi_q U.
    subroutine set_phi_u(self, jacobian)
        class(position_type), intent(inout) :: self
        real(wp), intent(in), contiguous :: jacobian(:, :)
        integer :: i, j, l

        self%phi_u = 0.0_wp
        do j = 1, self%nh
            do l = 1, self%n
                do i = 1, self%nh
                    self%phi_u(i, j) = self%phi_u(i, j) + jacobian(i, l)*self%u_basis(l, j)
                end do
            end do
        end do
    end subroutine set_phi_u

    !> Bases, u, B, and what they were made with.
    subroutine pack_state(self, pack)
        class(position_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%u_basis)
        call pack%item(self%failed_row)
        call pack%item(self%failed_value)
        call pack%item(self%most_corrections)
        call pack%item(self%u)
        call pack%item(self%row_scale)
        call pack%item(self%b%inverse)
        call self%lu%pack_state(pack)
    end subroutine pack_state
end module tandem_tangent_position
