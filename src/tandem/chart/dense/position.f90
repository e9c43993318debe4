! SPDX-License-Identifier: MIT
!> The position level of a chart: u with Phi(t, q0 + xi - U u) = 0 by Newton's iteration (17), and the matrix B = (Phi_q U)^-1
!> (13) that it needs, factored once per step or refined at every point as in the paper (20). On a chart without bases
!> U = diag(s)^2 Phi_q0' spans the same space, and B is the inverse of a Gram matrix, which then follows the motion: by Broyden's
!> updates, and by one refinement (20) at stages that took many corrections.
module tandem_chart_dense_position
    use tandem_chart_goal, only: goal_type
    use tandem_kinds, only: lane, short, wp
    use tandem_linalg_aligned, only: allocate_aligned
    use tandem_linalg_elimination, only: largest_small
    use tandem_linalg_kernels, only: add, add_product, copy
    use tandem_linalg_lu, only: lu_type
    use tandem_linalg_products, only: invert_definite, multiply_first
    use tandem_model_evaluator, only: evaluator_type
    use tandem_pack, only: pack_type
    use tandem_status, only: status_chart_left, status_not_finite, status_ok, status_position_diverged
    use tandem_model_counts, only: counts_type
    use tandem_linalg_gram, only: invert_gram, multiply_columns, multiply_rows, refine_inverse, set_directions, set_row_weight, &
        smallest_gram_pivot, subtract_columns
    use tandem_linalg_refinement, only: refinement_type
    implicit none (type, external)
    private

    public :: position_type, position_memory_type
    ! For tests: the operations of the iteration of `restore`.
    public :: correct, place

    !> Largest number of stages with a memory.
    integer, parameter :: most_stages = 16
    !> Stands for an unknown error or part of an error.
    real(wp), parameter :: unknown = 1.0e100_wp

    !> u, B and the data of its updates.
    type :: position_memory_type
        private
        real(wp), allocatable :: u(:), b(:, :), gram(:, :)
        real(wp) :: b_time = 0.0_wp, b_rest = 0.0_wp, ageing = unknown
        integer :: most_corrections = 0
        logical :: has_learnt = .false.
    end type position_memory_type

    !> Prediction of u at the stages of explicit steps.
    type :: prediction_type
        !> u at the start of the step and B Phi_q qdd there (width).
        real(wp), allocatable :: u_start(:), curvature(:)
        !> Error of the prediction from these, stage by stage (width, most_stages, 2): in the last accepted step, at `known`, and in
        !> the current attempt, at the other index if `has_tried`. The sizes of these steps, 0 if it needed no correction.
        real(wp), allocatable :: missed(:, :, :)
        real(wp) :: step(most_stages, 2) = 0.0_wp
        integer :: known = 1
        logical :: has_tried = .false.
    end type prediction_type

    !> The position level.
    type :: position_type
        !> diag(s) U (n, width): nh columns, and zeros up to `width`.
        real(wp), allocatable :: u_basis(:, :)
        !> After a failure: the worst row and its error on its natural scale.
        integer :: failed_row = 0
        real(wp) :: failed_value = 0.0_wp
        !> Largest number of corrections of an iteration for u, or a refinement of B, since the caller set this to zero.
        integer :: most_corrections = 0
        !> True if stages are predicted and their last correction is not checked: false if the paper's iterations are counted.
        logical :: predicts = .false.
        logical, private :: refines = .false.
        integer, private :: n = 0, nh = 0
        real(wp), private :: utol = 0.0_wp, stage_utol = 0.0_wp, btol = 0.0_wp
        !> u (width), carried from stage to stage as a start value; Phi_q U (nh, nh); weights of the rows of Phi, the reciprocals of
        !> their natural scales (width).
        real(wp), allocatable :: u(:)
        real(wp), allocatable, private :: correction(:), z(:), phi_u(:, :), weight(:)
        !> Prediction of stages.
        type(prediction_type), private :: prediction
        !> B of a chart without basis (width, width), width is nh padded: the stored inverse of a Gram matrix at its origin, later
        !> updated by other points and corrections if `has_learnt`; the last Phi with its change (width, 2) and the first u of an
        !> iteration (width); true if B is in use; work space.
        real(wp), allocatable, private :: gram(:, :), origin_gram(:, :), product(:, :), residual(:, :), last_phi(:, :), first_u(:)
        logical, private :: has_learnt = .false.
        integer, private :: width = 0
        logical, private :: has_gram = .false.
        !> The time of B and of the origin. A correction with a B of age t recently left the part `ageing` t of an error. Number of
        !> corrections at the last point.
        real(wp), private :: b_time = 0.0_wp, origin_time = 0.0_wp, ageing = unknown
        !> Remaining part of an error after a refinement, at the time of B.
        real(wp), private :: b_rest = 0.0_wp
        integer, private :: n_taken = 0
        type(lu_type), private :: lu
        type(refinement_type), private :: b
    contains
        procedure :: allocate => allocate_position, start, start_without_basis
        procedure :: start_step, retry_step, follow, refresh, refine, restore
        procedure :: find_remainder, judge, is_restored, get_b_phi, contraction
        procedure :: save, restore_saved, pack_state
        procedure, private :: forget_motion, factor
    end type position_type

    interface
        !> q = origin + increment - U u with Phi(t, q) = 0. Leaves Phi at q in the evaluator, unless it is a stage.
        module subroutine restore(self, model, t, origin, increment, goal, q, counts, stat)
            implicit none (type, external)
            class(position_type), intent(inout) :: self
            type(evaluator_type), intent(inout) :: model
            real(wp), intent(in) :: t
            !> q0 (n) and xi (n).
            real(wp), intent(in) :: origin(self%n), increment(self%n)
            !> At a stage the last correction may be assumed to contract like the previous ones. Without a known defect the last u
            !> is the start value.
            type(goal_type), intent(in) :: goal
            real(wp), intent(out) :: q(self%n)
            type(counts_type), intent(inout) :: counts
            !> A status code.
            integer, intent(out) :: stat
        end subroutine restore

        !> q := origin + increment - U u.
        pure module subroutine place(n, width, u_basis, u, origin, increment, q)
            implicit none (type, external)
            integer, intent(in) :: n, width
            real(wp), intent(in) :: u_basis(n, width), u(width), origin(n), increment(n)
            real(wp), intent(out) :: q(n)
        end subroutine place

        !> u := u + B Phi, see `correct_of`.
        pure module subroutine correct(width, nh, phi, weight, learns, last_phi, b, u, w)
            implicit none (type, external)
            integer, intent(in) :: width, nh
            real(wp), intent(in) :: phi(nh), weight(width)
            logical, intent(in) :: learns
            real(wp), intent(inout) :: last_phi(width, 2), b(width, width), u(width), w(width)
        end subroutine correct

        !> The error of a Phi (nh) on the natural scale of its rows, not finite if Phi is not; `failed_row` is the worst one.
        pure module subroutine judge(self, phi, error)
            implicit none (type, external)
            class(position_type), intent(inout) :: self
            real(wp), intent(in) :: phi(self%nh)
            real(wp), intent(out) :: error
        end subroutine judge
    end interface

contains

    !> Allocate for n coordinates and nh holonomic constraints.
    subroutine allocate_position(self, n, nh, refines, utol, stage_utol, btol)
        class(position_type), intent(inout) :: self
        integer, intent(in) :: n, nh
        !> True if B follows by the paper's refinement; tolerances of (17) on the natural scale, at the ends of steps and at stages,
        !> and of (20).
        logical, intent(in) :: refines
        real(wp), intent(in) :: utol, stage_utol, btol

        self%n = n
        self%nh = nh
        self%refines = refines
        self%utol = max(utol, 2.0e-15_wp)
        self%stage_utol = max(stage_utol, self%utol)
        self%btol = btol
        self%width = short*((nh + short - 1)/short)
        call allocate_aligned(self%u, self%width)
        call allocate_aligned(self%correction, self%width)
        call allocate_aligned(self%z, self%width)
        self%has_gram = .false.
        self%last_phi = spread(self%u, 2, 2)
        self%first_u = self%u
        self%prediction%u_start = self%u
        self%prediction%curvature = self%u
        self%prediction%step = 0.0_wp
        self%prediction%known = 1
        self%prediction%has_tried = .false.
        self%ageing = unknown
        self%weight = self%u
        if (allocated(self%phi_u)) deallocate (self%phi_u, self%origin_gram, self%product, self%residual, self%prediction%missed)
        allocate (self%prediction%missed(self%width, most_stages, 2), source=0.0_wp)
        call allocate_aligned(self%gram, self%width, self%width)
        call allocate_aligned(self%u_basis, n, self%width)
        allocate (self%origin_gram(self%width, self%width), self%product(self%width, self%width), &
            self%residual(self%width, self%width), source=0.0_wp)
        allocate (self%phi_u(nh, nh), source=0.0_wp)
        call self%lu%allocate(nh)
        call self%b%allocate(nh)
    end subroutine allocate_position

    !> Begin at the origin of a new chart; `u_basis` is set.
    subroutine start(self, t, jacobian, magnitude, scale, counts, stat)
        class(position_type), intent(inout) :: self
        real(wp), intent(in) :: t
        !> C (m, n), sizes and scales of the coordinates (n).
        real(wp), intent(in), contiguous :: jacobian(:, :), magnitude(:), scale(:)
        type(counts_type), intent(inout) :: counts
        !> A status code.
        integer, intent(out) :: stat

        stat = status_ok
        self%u = 0.0_wp
        ! The orientation of another basis may differ.
        self%prediction%step = 0.0_wp
        if (self%nh == 0) return
        call self%refresh(t, jacobian, magnitude, scale, counts, stat)
        if (stat /= status_ok .or. .not. self%refines) return
        call self%factor(jacobian, counts, stat)
        if (stat == status_ok) call self%lu%invert(self%b%inverse)
    end subroutine start

    !> Begin at the origin of a new chart with U = diag(s)^2 Phi_q'.
    subroutine start_without_basis(self, t, height, matrix, magnitude, scale, counts, can)
        class(position_type), intent(inout) :: self
        real(wp), intent(in) :: t
        !> C with its columns padded (height, n).
        integer, intent(in) :: height
        real(wp), intent(in) :: matrix(height, self%n)
        real(wp), intent(in), contiguous :: magnitude(:), scale(:)
        type(counts_type), intent(inout) :: counts
        !> False if the rows of Phi_q are so nearly dependent that U must be an orthonormal basis.
        logical, intent(out) :: can

        can = .true.
        self%u = 0.0_wp
        if (self%nh == 0) return
        call set_directions(self%nh, matrix, magnitude, scale, self%u_basis, self%weight)
        if (self%nh > largest_small) then
            call multiply_first(self%nh, matrix, self%u_basis, self%gram)
            call invert_definite(self%nh, smallest_gram_pivot, self%gram, self%z, can)
        else
            call invert_gram(self%nh, matrix, self%u_basis, self%gram, self%correction, self%z, can)
        end if
        self%has_gram = can
        self%b_time = t
        self%b_rest = 0.0_wp
        self%origin_time = t
        self%has_learnt = .false.
        call copy(size(self%gram), self%gram, self%origin_gram)
        counts%position_factorizations = counts%position_factorizations + 1
    end subroutine start_without_basis

    !> Store the start of a step, from which stages of an explicit method are predicted.
    subroutine start_step(self, jacobian, qdd)
        class(position_type), intent(inout) :: self
        !> C (m, n) and the acceleration (n) at the start of the step.
        real(wp), intent(in), contiguous :: jacobian(:, :), qdd(:)

        if (self%nh == 0 .or. .not. self%predicts) return
        call multiply_rows(size(jacobian, 1), self%n, self%nh, self%width, jacobian, qdd, self%correction)
        call copy(self%width, self%u, self%prediction%u_start)
        if (self%prediction%has_tried) self%prediction%known = 3 - self%prediction%known
        self%prediction%has_tried = .false.
        if (self%has_gram) then
            call multiply_columns(self%nh, self%width, self%gram, self%correction, self%prediction%curvature)
        else
            call self%lu%solve(self%correction(:self%nh))
            ! Behind the first nh entries `multiply_rows` may leave other rows of C; the padding of u stays zero.
            call copy(self%nh, self%correction, self%prediction%curvature)
        end if
    end subroutine start_step

    !> Begin a step anew with its initial u instead of the u of a rejected longer step.
    subroutine retry_step(self)
        class(position_type), intent(inout) :: self

        if (self%nh > 0) call copy(self%width, self%prediction%u_start, self%u)
        self%prediction%has_tried = .false.
    end subroutine retry_step

    !> Update B to the point that was restored last, by one refinement (20), if that took many corrections.
    subroutine follow(self, t, height, matrix, counts)
        class(position_type), intent(inout) :: self
        real(wp), intent(in) :: t
        !> C at that point with its columns padded (height, n).
        integer, intent(in) :: height
        real(wp), intent(in) :: matrix(height, self%n)
        type(counts_type), intent(inout) :: counts
        !> A refinement costs about as much as a correction with its evaluation of Phi.
        integer, parameter :: many = 3
        real(wp) :: rest
        logical :: can

        if (self%n_taken < many .or. .not. (self%has_gram .and. self%predicts)) return
        counts%b_corrections = counts%b_corrections + 1
        call refine_inverse(self%nh, matrix, self%u_basis, self%weight, self%gram, self%product, self%residual, rest, can)
        if (.not. can) return
        self%has_learnt = .true.
        self%b_time = t
        self%b_rest = rest
    end subroutine follow

    !> The part of the correction U u of a displacement into the tangent space of the origin that B of the origin leaves at another
    !> point, in the rows on their natural scales.
    real(wp) function contraction(self, origin, there, way, least)
        class(position_type), intent(inout) :: self
        !> C of the origin and of the point (m, n).
        real(wp), intent(in), contiguous :: origin(:, :), there(:, :)
        !> The displacement (n); below this part of the natural scale of every row the correction is too small.
        real(wp), intent(in), contiguous :: way(:)
        real(wp), intent(in) :: least
        real(wp) :: above, below, bend
        integer :: i, j

        contraction = 0.0_wp
        if (self%nh == 0) return
        associate (g => self%correction, u => self%z, weight => self%weight)
            call multiply_rows(size(origin, 1), self%n, self%nh, self%width, origin, way, g)
            below = 0.0_wp
            do i = 1, self%nh
                below = max(below, abs(g(i))*weight(i))
            end do
            if (.not. below > least) return
            if (self%has_gram) then
                call multiply_columns(self%nh, self%width, self%origin_gram, g, u)
            else
                u(:self%nh) = g(:self%nh)
                call self%lu%solve(u(:self%nh))
            end if
            do j = 1, self%n
                bend = 0.0_wp
                do i = 1, self%nh
                    bend = bend + self%u_basis(j, i)*u(i)
                end do
                do i = 1, self%nh
                    g(i) = g(i) - there(i, j)*bend
                end do
            end do
            above = 0.0_wp
            do i = 1, self%nh
                above = max(above, abs(g(i))*weight(i))
            end do
            contraction = above/below
        end associate
    end function contraction

    !> Go back to the B of the chart's origin: if that is nearer in time, or if updates of B are unsuitable.
    subroutine forget_motion(self)
        class(position_type), intent(inout) :: self

        self%gram(:, :) = self%origin_gram
        self%b_time = self%origin_time
        self%b_rest = 0.0_wp
        self%has_learnt = .false.
    end subroutine forget_motion

    !> Bring row scales and the factor of Phi_q U to a point: on a large chart those of the origin would be too inaccurate.
    subroutine refresh(self, t, jacobian, magnitude, scale, counts, stat)
        class(position_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: jacobian(:, :), magnitude(:), scale(:)
        type(counts_type), intent(inout) :: counts
        integer, intent(out) :: stat

        stat = status_ok
        if (self%nh == 0) return
        call copy(self%width, self%u, self%prediction%u_start)
        call set_row_weight(size(jacobian, 1), self%n, self%nh, jacobian, magnitude, scale, self%weight)
        self%has_gram = .false.
        self%b_time = t
        self%b_rest = 0.0_wp
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
        call multiply_first(self%nh, jacobian, self%u_basis, self%phi_u)
        call self%b%refine(self%phi_u, self%btol, counts%b_corrections, stat)
        self%most_corrections = max(self%most_corrections, self%b%last_corrections)
    end subroutine refine

    !> Save the start of the next step, so that other points can be evaluated without effect.
    subroutine save(self, memory)
        class(position_type), intent(in) :: self
        type(position_memory_type), intent(inout) :: memory

        memory%u = self%u
        memory%ageing = self%ageing
        memory%b_time = self%b_time
        memory%b_rest = self%b_rest
        memory%has_learnt = self%has_learnt
        memory%most_corrections = self%most_corrections
        if (self%has_gram) memory%gram = self%gram
        if (self%refines) memory%b = self%b%inverse
    end subroutine save

    !> Restore the saved start.
    subroutine restore_saved(self, memory)
        class(position_type), intent(inout) :: self
        type(position_memory_type), intent(in) :: memory

        self%u(:) = memory%u
        self%ageing = memory%ageing
        self%b_time = memory%b_time
        self%b_rest = memory%b_rest
        self%has_learnt = memory%has_learnt
        self%most_corrections = memory%most_corrections
        if (self%has_gram) self%gram(:, :) = memory%gram
        if (self%refines) self%b%inverse = memory%b
    end subroutine restore_saved

    !> Rounding error of q = origin + increment - U u with the u of the last `restore`.
    pure subroutine find_remainder(self, origin, increment, q, scale, left, is_rounding)
        class(position_type), intent(in) :: self
        !> All (n), `scale` the coordinate scales.
        real(wp), intent(in), contiguous :: origin(:), increment(:), q(:), scale(:)
        real(wp), intent(out), contiguous :: left(:)
        !> True if the remainder is no more than rounding.
        logical, intent(out) :: is_rounding
        real(wp), parameter :: most = 8*epsilon(1.0_wp)
        integer :: i

        do i = 1, self%n
            left(i) = increment(i) - (q(i) - origin(i))
        end do
        call subtract_columns(self%n, self%width, self%u_basis, self%u, left)
        is_rounding = .true.
        do i = 1, self%n
            is_rounding = is_rounding .and. abs(left(i)) <= most*(abs(q(i)) + abs(increment(i)) + scale(i))
        end do
    end subroutine find_remainder

    !> True if an error satisfies the tolerance of the iteration.
    pure logical function is_restored(self, error)
        class(position_type), intent(in) :: self
        real(wp), intent(in) :: error

        is_restored = error <= self%utol
    end function is_restored

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

        call multiply_first(self%nh, jacobian, self%u_basis, self%phi_u)
        call self%lu%factor(self%phi_u, stat)
        counts%position_factorizations = counts%position_factorizations + 1
        stat = merge(status_ok, status_chart_left, stat == 0)
    end subroutine factor

    !> Bases, u, B, and the data from which they were computed.
    subroutine pack_state(self, pack)
        class(position_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%u_basis)
        call pack%item(self%failed_row)
        call pack%item(self%failed_value)
        call pack%item(self%most_corrections)
        call pack%item(self%u, self%prediction%u_start, self%prediction%curvature)
        call pack%item(self%prediction%missed)
        call pack%fixed(self%prediction%step(:, 1))
        call pack%fixed(self%prediction%step(:, 2))
        call pack%item(self%prediction%known)
        call pack%item(self%prediction%has_tried)
        call pack%item(self%ageing, self%b_time, self%b_rest, self%origin_time)
        call pack%item(self%gram, self%origin_gram)
        call pack%item(self%has_gram, self%has_learnt)
        call pack%item(self%weight)
        call pack%item(self%b%inverse)
        call self%lu%pack_state(pack)
    end subroutine pack_state
end module tandem_chart_dense_position
