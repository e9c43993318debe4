! SPDX-License-Identifier: MIT
!> The dense tangent-space chart at (t0, q0, qd0), for mechanisms of up to some dozens of coordinates.
!>
!> Increments are ambient: xi = dq and eta = dqd, sums of the stages' qd and qdd, unprojected. A position is
!> q = q0 + xi - U u with Phi(t, q) = 0 (11), (14), a velocity is qd = qd0 + eta - X x with C qd = nu (25), (6). As v = V' xi
!> and w = W' eta, this is the trajectory in the chart's coordinates v and w, although explicit steps form neither V nor W:
!> there the condition that qd - qd0 - eta lies in range(C0') reads N0' (qd - qd0 - eta) = 0 with any basis N0 of null(C0).
!>
!> Coordinate scales s: bases are those of C diag(s), so that diag(s) U, diag(s) X, diag(s) V, diag(s) W move q and qd, and
!> diag(s)^-1 V and diag(s)^-1 W are the duals that give coordinates.
module tandem_tangent_dense
    use tandem_error, only: error_type
    use tandem_kinds, only: wp
    use tandem_linalg_basis, only: basis_type
    use tandem_linalg_dependence, only: keeps_orientation, solve_least_norm, weakest_combination
    use tandem_linalg_kernels, only: add_product, add_transposed_product, set_gram, set_product
    use tandem_linalg_lu, only: lu_type
    use tandem_model, only: model_type
    use tandem_model_derivatives, only: derivatives_type, need_all_derivatives
    use tandem_model_differences, only: differences_type
    use tandem_model_evaluator, only: evaluator_type
    use tandem_model_terms, only: need_force, need_gamma, need_jacobian, need_mass, need_nu, need_phi, terms_type
    use tandem_options, only: options_type
    use tandem_status, only: status_chart_left, status_not_finite, status_ok, status_rank_deficient
    use tandem_tangent_chart, only: chart_type, health_type
    use tandem_tangent_dynamics, only: dynamics_type
    use tandem_tangent_natural_scale, only: acceleration_errors, position_errors, velocity_errors
    use tandem_tangent_position, only: position_type
    use tandem_tangent_split, only: by_elimination, by_factor, by_refinement, split_type
    use tandem_tangent_stage, only: stage_type
    use tandem_tangent_watch, only: length_outside, watch_type
    implicit none (type, external)
    private

    public :: dense_chart_type

    !> The chart by dense matrices.
    type, extends(chart_type) :: dense_chart_type
        private
        type(evaluator_type) :: model
        type(differences_type) :: differences
        type(position_type) :: position
        type(split_type) :: split
        type(dynamics_type) :: dynamics
        type(stage_type), public :: stage
        type(derivatives_type) :: derivatives
        !> n coordinates, nh holonomic and m constraints.
        integer :: n = 0, nh = 0, m = 0
        logical :: is_implicit = .false., refines = .false., has_bases = .false., uses_svd = .false., has_gamma = .true.
        type(watch_type) :: watch
        !> Coordinate scales (n).
        real(wp), allocatable :: scale(:)
        !> The origin.
        real(wp), allocatable :: q0(:), qd0(:)
        !> Orthonormal bases at the origin.
        type(basis_type) :: basis
        !> diag(s) X (n, m), diag(s) V (n, n - nh), diag(s) W (n, n - m) and the duals of V and W: only where they are kept.
        real(wp), allocatable :: x_basis(:, :), v_basis(:, :), w_basis(:, :), v_dual(:, :), w_dual(:, :)
        !> diag(s)^-2 N0 (n, n - m), N0' D and its factors, right sides (n - m), (m), (n).
        real(wp), allocatable :: null_origin(:, :), overlap(:, :), z(:), x(:), trial(:)
        type(lu_type) :: overlap_lu
        !> Where rows were dropped: their numbers, the derivatives, gamma and the multipliers of all rows.
        integer, allocatable :: dropped(:)
        type(derivatives_type) :: all_derivatives
        real(wp), allocatable :: all_gamma(:), all_lambda(:)
        !> The orientation of C at the origin, see `split_type`.
        integer :: origin_orientation = 1
        !> The smallest pivot at the last state.
        real(wp) :: last_weakness = 1.0_wp
        !> C where the current step starts (m, n).
        real(wp), allocatable :: step_jacobian(:, :)
        !> Where bases are kept: C X there (m, m), and its factors.
        real(wp), allocatable :: origin_c_x(:, :)
        type(lu_type) :: origin_lu
        !> The point where C, nu and M were evaluated last; whether R and D, Phi, and gamma and the forces (with the velocity
        !> `qd_point`) are those of it.
        logical :: has_point = .false., is_split = .false., phi_is_current = .false., has_motion = .false.
        real(wp) :: t_point = 0.0_wp
        real(wp), allocatable :: q_point(:), qd_point(:)
        !> The segment of the model where the last Newton matrix was formed, and what a new one costs in corrections.
        integer :: stage_segment = 0
        real(wp) :: cost = 0.0_wp
        !> Work space for stages.
        real(wp), allocatable :: b_phi(:, :), lambda(:), change_q(:), change_qd(:)
    contains
        procedure :: initialize
        procedure :: renew
        procedure :: remainder
        procedure :: refresh
        procedure :: forget
        procedure :: forget_model
        procedure :: hold
        procedure :: release
        procedure :: restore_position
        procedure :: restore_velocity
        procedure :: solve_dynamics
        procedure :: factor_stage
        procedure :: reuse_stage
        procedure :: matrix_cost
        procedure :: correct_stage
        procedure :: filter_error
        procedure :: multipliers
        procedure :: project_velocity
        procedure :: constraint_errors
        procedure :: measure_rank
        procedure :: loses_rank_ahead
        procedure :: measure_health
        procedure :: kinetic_energy
        procedure, private :: move_to
        procedure, private :: split_here
        procedure, private :: split_fully
        procedure, private :: measure_origin
        procedure, private :: move_with
        procedure, private :: load_bases
        procedure, private :: evaluate_gamma
        procedure, private :: evaluate_derivatives
        procedure, private :: blame
        procedure, private :: blame_dependent
        procedure, private :: fail_term
        procedure, private :: name_infinite
    end type dense_chart_type

contains

    !> Attach the model and allocate the work space.
    subroutine initialize(self, model, options, implicit, error, kept)
        class(dense_chart_type), intent(inout) :: self
        class(model_type), intent(inout), target :: model
        type(options_type), intent(in) :: options
        logical, intent(in) :: implicit
        type(error_type), allocatable, intent(out) :: error
        integer, intent(in), optional :: kept(:)
        real(wp) :: utol
        integer :: way, i

        self%refines = options%refresh == 'refine'
        self%is_implicit = implicit
        self%uses_svd = options%basis == 'svd'
        call self%model%initialize(model, kept)
        self%n = model%n
        self%nh = size(self%model%terms%phi)
        self%m = size(self%model%terms%nu)
        if (present(kept)) then
            self%n_dropped = model%n_constraints() - size(kept)
            self%dropped = pack([(i, i=1, model%n_constraints())], [(all(kept /= i), i=1, model%n_constraints())])
            self%all_gamma = spread(0.0_wp, 1, model%n_constraints())
            self%all_lambda = self%all_gamma
            if (implicit) call self%all_derivatives%allocate(model%n, model%n_constraints())
        end if
        call self%watch%allocate(options, self%n, self%nh, self%m)
        ! The condition of (38) is that of the paper's D, which needs W.
        self%has_bases = implicit .or. self%refines .or. self%watch%condition
        self%scale = spread(1.0_wp, 1, model%n)
        if (allocated(model%coordinate_scale)) self%scale = model%coordinate_scale
        self%has_gamma = iand(self%model%has, need_gamma) /= 0 .or. self%m == 0
        associate (n => self%n, nh => self%nh, m => self%m)
            way = by_elimination
            if (self%has_bases) way = merge(by_refinement, by_factor, self%refines)
            ! Rows are judged by their scales at the start of a step during the iteration, by those at its end afterwards: what was
            ! accepted must not miss the tolerance for that.
            utol = options%position_tolerance()
            if (.not. self%refines) utol = min(utol, 0.25_wp*max(utol, options%constraint_tolerance))
            call self%position%allocate(n, nh, self%refines, utol, options%b_tolerance())
            call self%split%allocate(n, m, way, options%h_tolerance())
            call self%dynamics%allocate(n, n - m)
            call self%basis%allocate(n, nh, m)
            if (.not. self%has_gamma .or. implicit) call self%differences%initialize(model, self%scale)
            self%q0 = spread(0.0_wp, 1, n)
            self%x = spread(0.0_wp, 1, m)
            self%z = spread(0.0_wp, 1, n - m)
            if (self%has_bases) then
                allocate (self%origin_c_x(m, m), source=0.0_wp)
                call self%origin_lu%allocate(m)
                allocate (self%x_basis(n, m), self%w_basis(n, n - m), self%w_dual(n, n - m), source=0.0_wp)
                allocate (self%v_basis(n, n - nh), self%v_dual(n, n - nh), source=0.0_wp)
            else
                allocate (self%x_basis(0, 0), self%w_basis(0, 0))
                allocate (self%null_origin(n, n - m), self%overlap(n - m, n - m), source=0.0_wp)
                call self%overlap_lu%allocate(n - m)
            end if
            if (implicit) then
                call self%stage%allocate(n, nh, m)
                call self%derivatives%allocate(n, m)
                self%stage_segment = 0
                ! Measured: two and a half corrections with the model's own derivatives; differences take 2 (n + 1) evaluations.
                self%cost = 2.5_wp
                if (model%provides_derivatives /= need_all_derivatives) self%cost = self%cost + 0.35_wp*real(n + 1, wp)
                allocate (self%b_phi(nh, n), self%lambda(m), self%change_q(n), self%change_qd(n), source=0.0_wp)
            end if
        end associate
        self%qd0 = self%q0
        self%trial = self%q0
        self%q_point = self%q0
        self%qd_point = self%q0
    end subroutine initialize

    !> Make (t, q, qd) the origin: bases and the rank decision, then what the position and velocity levels start from.
    subroutine renew(self, t, q, qd, stat)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:)
        integer, intent(out) :: stat
        integer :: j

        self%failed_row = 0
        self%q0 = q
        self%qd0 = qd
        call self%move_to(t, q, stat)
        if (stat /= status_ok) return
        call self%load_bases(stat)
        if (stat /= status_ok) return
        if (self%is_implicit) call self%stage%enter_chart()
        call self%position%start(self%model%terms%jacobian, q, self%scale, self%counts, stat)
        if (stat /= status_ok) return
        if (self%has_bases) then
            self%is_split = .false.
            call self%split%start(self%model%terms%jacobian, self%x_basis, stat)
            if (stat /= status_ok) return
        end if
        self%step_jacobian = self%model%terms%jacobian
        ! Implicit steps split where they need it.
        if (self%has_bases) return
        call self%split_here(stat)
        if (stat /= status_ok) return
        self%origin_orientation = self%split%orientation
        self%last_weakness = self%split%weakness
        do j = 1, self%n - self%m
            self%null_origin(:, j) = self%split%null_space(:, j)/self%scale**2
        end do
    end subroutine renew

    !> What rounding took from q = q0 + xi - U u.
    pure subroutine remainder(self, increment, q, left)
        class(dense_chart_type), intent(in) :: self
        real(wp), intent(in), contiguous :: increment(:), q(:)
        real(wp), intent(out), contiguous :: left(:)

        left = increment - (q - self%q0)
        call self%position%subtract_correction(left)
        ! More than rounding: q is not the point of that increment.
        if (any(abs(left) > 8*epsilon(1.0_wp)*(abs(q) + abs(increment) + self%scale))) left = 0.0_wp
    end subroutine remainder

    !> Orthonormal bases at the current point, as many columns as are needed, and the rank decision.
    subroutine load_bases(self, stat)
        class(dense_chart_type), intent(inout) :: self
        integer, intent(out) :: stat
        integer :: columns, j

        stat = status_ok
        ! U is all that explicit steps need; |w| and |D| need X, kept bases are whole.
        columns = self%nh
        if (self%watch%w .or. self%watch%secants) columns = self%m
        if (self%has_bases) columns = self%n
        if (self%uses_svd) then
            call self%basis%factor_svd(self%model%terms%jacobian, self%scale)
        else
            call self%basis%factor_qr(self%model%terms%jacobian, self%scale, columns)
        end if
        self%counts%basis_factorizations = self%counts%basis_factorizations + min(self%m, 1)
        self%independence = self%basis%smallest
        self%best_independence = max(self%best_independence, self%independence)
        if (self%basis%deficient) then
            call self%blame_dependent(self%basis%dependent_row)
            stat = status_rank_deficient
            return
        end if
        do j = 1, self%nh
            self%position%u_basis(:, j) = self%scale*self%basis%q(:, j)
        end do
        if (.not. self%has_bases) return
        do j = 1, self%m
            self%x_basis(:, j) = self%scale*self%basis%q(:, j)
        end do
        do j = 1, self%n - self%nh
            self%v_basis(:, j) = self%scale*self%basis%q(:, self%nh + j)
            self%v_dual(:, j) = self%basis%q(:, self%nh + j)/self%scale
        end do
        do j = 1, self%n - self%m
            self%w_basis(:, j) = self%scale*self%basis%q(:, self%m + j)
            self%w_dual(:, j) = self%basis%q(:, self%m + j)/self%scale
        end do
    end subroutine load_bases

    !> Bring the row scales and the factor of Phi_q U to (t, q).
    subroutine refresh(self, t, q, stat)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:)
        integer, intent(out) :: stat

        self%failed_row = 0
        call self%move_to(t, q, stat)
        if (stat == status_ok) then
            self%step_jacobian = self%model%terms%jacobian
            call self%position%refresh(self%model%terms%jacobian, q, self%scale, self%counts, stat)
        end if
    end subroutine refresh

    !> Forget the last point.
    subroutine forget(self)
        class(dense_chart_type), intent(inout) :: self

        self%has_point = .false.
        self%is_split = .false.
        self%has_motion = .false.
        self%phi_is_current = .false.
    end subroutine forget

    !> Forget the last point and the constant mass matrix.
    subroutine forget_model(self)
        class(dense_chart_type), intent(inout) :: self

        call self%forget()
        self%model%mass_is_known = .false.
    end subroutine forget_model

    !> Keep what the next step starts from.
    subroutine hold(self)
        class(dense_chart_type), intent(inout) :: self

        call self%position%hold()
        call self%split%hold()
    end subroutine hold

    !> Go back to what was kept.
    subroutine release(self)
        class(dense_chart_type), intent(inout) :: self

        call self%position%release()
        call self%split%release()
    end subroutine release

    !> q = q0 + xi - U u with Phi(t, q) = 0.
    subroutine restore_position(self, t, increment, q, stat)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: increment(:)
        real(wp), intent(out), contiguous :: q(:)
        integer, intent(out) :: stat

        call self%position%restore(self%model, t, self%q0, increment, q, self%counts, stat)
        self%phi_is_current = stat == status_ok .and. self%nh > 0
        call self%blame(self%position%failed_row, self%position%failed_value)
        if (stat /= status_ok) call self%fail_term()
    end subroutine restore_position

    !> Evaluate C, nu and M at (t, q), unless it was done last.
    subroutine move_to(self, t, q, stat)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:)
        integer, intent(out) :: stat

        stat = status_ok
        if (self%has_point .and. .not. (t > self%t_point .or. t < self%t_point)) then
            if (all(abs(q - self%q_point) <= 0.0_wp)) return
        end if
        self%has_point = .false.
        self%is_split = .false.
        self%has_motion = .false.
        ! None of these depends on the velocity; q stands in for it.
        call self%model%evaluate(need_jacobian + need_nu + need_mass, t, q, q, self%counts, stat)
        if (stat /= status_ok) then
            call self%fail_term()
            return
        end if
        if (.not. sum(abs(self%model%terms%jacobian)) + sum(abs(self%model%terms%nu)) <= huge(1.0_wp)) then
            call self%name_infinite(stat)
            return
        end if
        self%has_point = .true.
        self%t_point = t
        self%q_point = q
    end subroutine move_to

    !> What R and D at the current point follow from, and with `refine` B too.
    subroutine split_here(self, stat)
        class(dense_chart_type), intent(inout) :: self
        integer, intent(out) :: stat

        stat = status_ok
        if (self%is_split) return
        associate (jacobian => self%model%terms%jacobian)
            call self%position%refine(jacobian, self%counts, stat)
            if (stat /= status_ok) return
            call self%split%update(jacobian, self%scale, self%x_basis, self%w_basis, self%counts, stat)
        end associate
        call self%blame(self%split%failed_row, 0.0_wp)
        self%is_split = stat == status_ok
    end subroutine split_here

    !> R and D at the current point as matrices.
    subroutine split_fully(self, stat)
        class(dense_chart_type), intent(inout) :: self
        integer, intent(out) :: stat

        call self%split_here(stat)
        if (stat == status_ok) call self%split%complete(self%model%terms%jacobian, self%x_basis, self%w_basis)
    end subroutine split_fully

    !> qd = qd0 + eta - X x with C qd = nu.
    subroutine restore_velocity(self, t, q, increment, qd, stat)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), increment(:)
        real(wp), intent(out), contiguous :: qd(:)
        integer, intent(out) :: stat
        integer :: pass

        self%failed_row = 0
        call self%move_to(t, q, stat)
        if (stat == status_ok) call self%split_here(stat)
        if (stat /= status_ok) return
        qd = self%qd0 + increment
        if (self%m == 0) return
        associate (terms => self%model%terms, r => self%split%right_inverse, d => self%split%null_space)
            if (.not. self%has_bases) then
                ! qd = R nu + D z with N0' (qd - qd0 - eta) = 0.
                call set_gram(self%null_origin, d, self%overlap)
                call self%overlap_lu%factor(self%overlap, stat)
                if (stat /= 0) then
                    stat = status_chart_left
                    return
                end if
                self%trial = qd
                qd = 0.0_wp
                call add_product(r, terms%nu, 1.0_wp, qd)
                self%trial = self%trial - qd
                self%z = 0.0_wp
                call add_transposed_product(self%null_origin, self%trial, 1.0_wp, self%z)
                call self%overlap_lu%solve(self%z)
                call add_product(d, self%z, 1.0_wp, qd)
            end if
            ! qd - R (C qd - nu); twice where rounding is to be removed, once for what H gives with the paper's tolerance.
            do pass = 1, merge(2, 1, self%has_bases .and. .not. self%refines)
                self%x = -terms%nu
                call add_product(terms%jacobian, qd, 1.0_wp, self%x)
                call self%split%subtract_right_inverse(self%x_basis, self%x, qd)
            end do
        end associate
    end subroutine restore_velocity

    !> Evaluate gamma and the forces at (t, q, qd) too, unless it was done last.
    subroutine move_with(self, t, q, qd, stat)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:)
        integer, intent(out) :: stat

        call self%move_to(t, q, stat)
        if (stat /= status_ok) return
        if (self%has_motion) then
            if (all(abs(qd - self%qd_point) <= 0.0_wp)) return
        end if
        self%has_motion = .false.
        self%counts%right_hand_sides = self%counts%right_hand_sides + 1
        call self%model%evaluate(need_gamma + need_force, t, q, qd, self%counts, stat)
        if (stat == status_ok .and. .not. self%has_gamma) then
            call self%evaluate_gamma(t, q, qd, stat)
        end if
        if (stat /= status_ok) then
            call self%fail_term()
            return
        end if
        self%has_motion = .true.
        self%qd_point = qd
    end subroutine move_with

    !> The acceleration at the point of `restore_velocity`.
    subroutine solve_dynamics(self, t, q, qd, qdd, stat)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:)
        real(wp), intent(out), contiguous :: qdd(:)
        integer, intent(out) :: stat

        self%failed_row = 0
        call self%move_with(t, q, qd, stat)
        if (stat == status_ok) call self%split_fully(stat)
        if (stat /= status_ok) return
        associate (terms => self%model%terms, r => self%split%right_inverse, d => self%split%null_space)
            call self%dynamics%factor(terms%mass, d, stat)
            self%counts%mass_factorizations = self%counts%mass_factorizations + min(self%n - self%m, 1)
            if (stat == status_ok) call self%dynamics%solve(terms%mass, terms%jacobian, d, r, terms%gamma, terms%force, &
                .not. self%refines, qdd, stat)
            if (stat /= status_ok) call self%name_infinite(stat)
        end associate
    end subroutine solve_dynamics

    !> Something failed here: was a term not finite, and which? Nothing of the point is kept, so that it can be tried again.
    subroutine name_infinite(self, stat)
        class(dense_chart_type), intent(inout) :: self
        !> Kept as it is where all terms are finite.
        integer, intent(inout) :: stat

        call self%forget()
        associate (terms => self%model%terms)
            if (.not. sum(abs(terms%phi)) <= huge(1.0_wp)) then
                self%failed_term = 'phi'
            else if (.not. sum(abs(terms%jacobian)) <= huge(1.0_wp)) then
                self%failed_term = 'jacobian'
            else if (.not. sum(abs(terms%nu)) <= huge(1.0_wp)) then
                self%failed_term = 'nu'
            else if (.not. sum(abs(terms%mass)) <= huge(1.0_wp)) then
                self%failed_term = 'mass'
            else if (.not. sum(abs(terms%gamma)) <= huge(1.0_wp)) then
                self%failed_term = 'gamma'
            else if (.not. sum(abs(terms%force)) <= huge(1.0_wp)) then
                self%failed_term = 'force'
            else
                self%failed_term = 'the velocity'
                return
            end if
        end associate
        stat = status_not_finite
    end subroutine name_infinite

    !> Form and factor the Newton matrix at the last point of `solve_dynamics`.
    subroutine factor_stage(self, t, q, qd, qdd, ha, stat)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:), qdd(:)
        real(wp), intent(in) :: ha
        integer, intent(out) :: stat

        self%failed_row = 0
        call self%move_with(t, q, qd, stat)
        if (stat == status_ok) call self%split_fully(stat)
        if (stat /= status_ok) return
        associate (terms => self%model%terms, r => self%split%right_inverse, d => self%split%null_space)
            call self%dynamics%multipliers(terms%mass, r, terms%force, qdd, self%lambda)
            call self%evaluate_derivatives(t, q, qd, qdd, stat)
            if (stat /= status_ok) then
                self%failed_term = 'a derivative'
                return
            end if
            call self%position%get_b_phi(terms%jacobian, self%b_phi, self%counts, stat)
            if (stat /= status_ok) return
            call self%stage%form(terms, self%derivatives, self%v_basis, self%v_dual, self%w_dual, self%position%u_basis, &
                self%b_phi, d, r)
            call self%stage%factor(ha, stat)
        end associate
        self%stage_segment = self%model%segment()
        self%counts%newton_matrices = self%counts%newton_matrices + 1
        self%counts%newton_factorizations = self%counts%newton_factorizations + 1
    end subroutine factor_stage

    !> Make the last Newton matrix serve ha.
    subroutine reuse_stage(self, ha, can)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: ha
        logical, intent(out) :: can

        can = self%stage_segment == self%model%segment()
        if (can) call self%stage%adapt(ha, self%counts%newton_factorizations, can)
    end subroutine reuse_stage

    !> What a new Newton matrix costs, in corrections.
    pure real(wp) function matrix_cost(self)
        class(dense_chart_type), intent(in) :: self

        matrix_cost = self%cost
    end function matrix_cost

    !> One Newton correction of a stage's rates at the restored point.
    subroutine correct_stage(self, t, q, qd, ha, rate_q, rate_qd, change, stat)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:)
        real(wp), intent(in) :: ha
        real(wp), intent(inout), contiguous :: rate_q(:), rate_qd(:)
        real(wp), intent(out) :: change
        integer, intent(out) :: stat
        integer :: j

        self%failed_row = 0
        change = 0.0_wp
        call self%move_with(t, q, qd, stat)
        if (stat == status_ok) call self%split_here(stat)
        if (stat /= status_ok) return
        call self%stage%correct(self%model%terms, self%split, self%v_basis, self%v_dual, self%x_basis, self%w_basis, self%w_dual, &
            qd, rate_q, rate_qd, self%change_q, self%change_qd)
        do j = 1, self%n
            change = max(change, abs(ha*self%change_q(j))/max(abs(q(j)), self%scale(j)), &
                abs(ha*self%change_qd(j))/max(abs(qd(j)), self%scale(j)))
        end do
        if (.not. sum(abs(rate_qd)) + sum(abs(rate_q)) <= huge(1.0_wp)) then
            stat = status_not_finite
            call self%name_infinite(stat)
        end if
        self%counts%newton_corrections = self%counts%newton_corrections + 1
    end subroutine correct_stage

    !> The error through the Newton matrix.
    subroutine filter_error(self, error_q, error_qd)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(inout), contiguous :: error_q(:), error_qd(:)

        call self%stage%filter(self%v_basis, self%v_dual, self%w_basis, self%w_dual, self%split%null_space, error_q, error_qd)
    end subroutine filter_error

    !> lambda at (t, q, qd, qdd).
    subroutine multipliers(self, t, q, qd, qdd, lambda, stat)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:), qdd(:)
        real(wp), intent(out), contiguous :: lambda(:)
        integer, intent(out) :: stat

        lambda = 0.0_wp
        call self%move_with(t, q, qd, stat)
        if (stat == status_ok) call self%split_fully(stat)
        if (stat /= status_ok) return
        self%counts%multipliers = self%counts%multipliers + 1
        if (allocated(self%dropped)) then
            associate (terms => self%model%all_rows)
                call solve_least_norm(transpose(terms%jacobian), terms%force - matmul(terms%mass, qdd), lambda)
            end associate
        else
            call self%dynamics%multipliers(self%model%terms%mass, self%split%right_inverse, self%model%terms%force, qdd, lambda)
        end if
    end subroutine multipliers

    !> The nearest velocity in the mass metric that satisfies the constraints at (t, q).
    subroutine project_velocity(self, t, q, qd, stat)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:)
        real(wp), intent(inout), contiguous :: qd(:)
        integer, intent(out) :: stat

        self%failed_row = 0
        call self%move_to(t, q, stat)
        if (stat == status_ok) call self%split_fully(stat)
        if (stat /= status_ok) return
        associate (r => self%split%right_inverse, d => self%split%null_space)
            call self%dynamics%factor(self%model%terms%mass, d, stat)
            if (stat /= status_ok) return
            call self%dynamics%project(d, r, self%model%terms%nu, qd)
        end associate
        if (.not. sum(abs(qd)) <= huge(1.0_wp)) stat = status_not_finite
    end subroutine project_velocity

    !> The errors of the three constraint levels at the last point.
    subroutine constraint_errors(self, t, q, qd, qdd, errors, rows, stat)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:), qdd(:)
        real(wp), intent(out) :: errors(3)
        integer, intent(out) :: rows(3)
        integer, intent(out) :: stat

        errors = 0.0_wp
        rows = 0
        if (self%m == 0) then
            stat = status_ok
            return
        end if
        call self%move_with(t, q, qd, stat)
        if (stat /= status_ok) return
        ! Of redundant rows all count, those that were dropped too.
        if (self%nh > 0 .and. .not. self%phi_is_current) then
            call self%model%evaluate(need_phi, t, q, qd, self%counts, stat)
            if (stat /= status_ok) then
                call self%fail_term()
                return
            end if
        end if
        if (allocated(self%dropped)) then
            call measure(self%model%all_rows)
        else
            call measure(self%model%terms)
        end if
        if (.not. maxval(errors) < huge(1.0_wp)) call self%name_infinite(stat)

    contains

        !> The three errors of a set of rows.
        subroutine measure(terms)
            type(terms_type), intent(in) :: terms

            if (size(terms%phi) > 0) call position_errors(terms%phi, terms%jacobian, q, self%scale, errors(1), rows(1))
            call velocity_errors(terms%nu, terms%jacobian, qd, self%scale, errors(2), rows(2))
            call acceleration_errors(terms%gamma, terms%jacobian, qdd, self%scale, errors(3), rows(3))
        end subroutine measure
    end subroutine constraint_errors

    !> How many steps as the one that ends at (t, q) C is away from losing rank.
    subroutine measure_rank(self, t, q, room, stat)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:)
        real(wp), intent(out) :: room
        integer, intent(out) :: stat
        !> A redundant row leaves at most this of itself in the motions that the others allow; rounding is far below.
        real(wp), parameter :: largest_rest = 1.0e-6_wp
        !> A loss of rank further away than so many steps is not looked for.
        real(wp), parameter :: horizon = 8.0_wp
        real(wp) :: share(self%m), smallest, smallest_before, fall
        integer :: i, j

        self%failed_row = 0
        self%fallen = 1.0_wp
        room = huge(1.0_wp)
        stat = status_ok
        if (self%m == 0) return
        call self%move_to(t, q, stat)
        if (stat == status_ok) call self%split_here(stat)
        if (stat /= status_ok) return
        if (self%has_bases) call self%measure_origin()
        call self%split%measure_orientation()
        if (allocated(self%dropped)) then
            call self%split_fully(stat)
            if (stat /= status_ok) return
            do i = 1, size(self%dropped)
                associate (row => self%model%all_rows%jacobian(self%dropped(i), :), d => self%split%null_space)
                    do j = 1, size(d, 2)
                        if (abs(dot_product(row, d(:, j))) <= largest_rest*norm2(row*self%scale)*norm2(d(:, j)/self%scale)) cycle
                        call self%blame_dependent(0)
                        self%failed_row = self%dropped(i)
                        room = 0.0_wp
                        return
                    end do
                end associate
            end do
        end if
        ! Pivots are at hand. They fall towards a loss of rank, and for the choice of their columns alone.
        fall = self%last_weakness - self%split%weakness
        self%last_weakness = self%split%weakness
        if (self%split%orientation == self%origin_orientation .and. self%split%weakness > horizon*fall) return
        call weakest_combination(self%step_jacobian, self%scale, share, smallest_before)
        call weakest_combination(self%model%terms%jacobian, self%scale, share, smallest)
        if (smallest_before > smallest) room = smallest/(smallest_before - smallest)
        self%fallen = smallest/max(self%best_independence, tiny(1.0_wp))
        if (self%split%orientation /= self%origin_orientation) then
            if (.not. keeps_orientation(self%step_jacobian, self%model%terms%jacobian, self%scale)) room = 0.0_wp
            self%origin_orientation = self%split%orientation
        end if
        if (room <= horizon) call self%blame_dependent(0)
    end subroutine measure_rank

    !> The orientation of C and its smallest pivot at the start of the step, where bases are kept: both of C X.
    subroutine measure_origin(self)
        class(dense_chart_type), intent(inout) :: self
        integer :: stat

        call set_product(self%step_jacobian, self%x_basis, self%origin_c_x)
        call self%origin_lu%factor(self%origin_c_x, stat)
        if (stat /= 0) return
        self%origin_orientation = self%origin_lu%determinant_sign()
        self%last_weakness = self%origin_lu%smallest_pivot()
    end subroutine measure_origin

    !> Whether C loses rank on the straight way ahead of a state, soon enough for that way to mean something.
    logical function loses_rank_ahead(self, t, q, qd, h)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t, h
        real(wp), intent(in), contiguous :: q(:), qd(:)
        !> Halvings of the way; how much C may change until the loss.
        integer, parameter :: most_halvings = 12
        real(wp), parameter :: largest_change = 0.5_wp
        real(wp), allocatable :: here(:, :)
        real(wp) :: near, far, middle
        integer :: k, stat

        loses_rank_ahead = .false.
        if (self%m == 0) return
        call self%move_to(t, q, stat)
        if (stat /= status_ok) return
        here = self%model%terms%jacobian
        near = 0.0_wp
        far = h
        if (keeps_until(h)) return
        do k = 1, most_halvings
            middle = 0.5_wp*(near + far)
            if (keeps_until(middle)) then
                near = middle
            else
                far = middle
            end if
        end do
        loses_rank_ahead = .not. keeps_until(far)
        if (loses_rank_ahead) loses_rank_ahead = relative_change() <= largest_change
        if (loses_rank_ahead) call self%blame_dependent(0)

    contains

        !> Whether C has its orientation still; what cannot be evaluated counts as no loss.
        logical function keeps_until(ahead)
            real(wp), intent(in) :: ahead

            self%trial = q + ahead*qd
            call self%move_to(t + ahead, self%trial, stat)
            keeps_until = stat /= status_ok
            if (.not. keeps_until) keeps_until = keeps_orientation(here, self%model%terms%jacobian, self%scale)
        end function keeps_until

        !> The change of C since, rows of unit length, Frobenius norm.
        real(wp) function relative_change()
            integer :: i

            relative_change = 0.0_wp
            do i = 1, self%m
                relative_change = relative_change + sum(((self%model%terms%jacobian(i, :) - here(i, :))*self%scale)**2)/ &
                    max(sum((here(i, :)*self%scale)**2), tiny(1.0_wp))
            end do
            relative_change = sqrt(relative_change)
        end function relative_change
    end function loses_rank_ahead

    !> What the policy watches: |v|, |w|, the condition and the iterations, or |D| and |Fbar|.
    subroutine measure_health(self, t, q, qd, health, stat)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:)
        type(health_type), intent(out) :: health
        integer, intent(out) :: stat

        self%failed_row = 0
        call self%move_to(t, q, stat)
        if (stat == status_ok .and. self%watch%condition) call self%split_fully(stat)
        if (stat /= status_ok) return
        health%corrections = max(self%position%most_corrections, self%split%most_corrections)
        self%position%most_corrections = 0
        self%split%most_corrections = 0
        associate (terms => self%model%terms, watch => self%watch)
            if (watch%v) health%v = length_outside(self%basis%q(:, :self%nh), (q - self%q0)/self%scale)
            if (watch%w) health%w = length_outside(self%basis%q(:, :self%m), (qd - self%qd0)/self%scale)
            if (watch%condition .and. self%is_implicit) then
                ! That of the Newton matrix (81), reduced.
                health%condition = 1.0_wp/max(self%stage%reciprocal_condition(), tiny(1.0_wp))
            else if (watch%condition) then
                call watch%condition_of(terms%mass, self%split%null_space, terms%jacobian, health%condition)
            end if
            if (watch%secants) then
                self%counts%basis_factorizations = self%counts%basis_factorizations + 1
                call watch%measure_secants(terms%jacobian, self%scale, self%basis%q(:, :self%m), health%d, health%fbar)
            end if
        end associate
    end subroutine measure_health

    !> qd' M qd / 2 at (t, q, qd).
    subroutine kinetic_energy(self, t, q, qd, energy, stat)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:)
        real(wp), intent(out) :: energy
        integer, intent(out) :: stat

        energy = 0.0_wp
        call self%move_to(t, q, stat)
        if (stat /= status_ok) return
        self%counts%kinetic_energies = self%counts%kinetic_energies + 1
        energy = 0.5_wp*dot_product(qd, matmul(self%model%terms%mass, qd))
    end subroutine kinetic_energy

    !> gamma by differences.
    subroutine evaluate_gamma(self, t, q, qd, stat)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:)
        integer, intent(out) :: stat

        if (allocated(self%dropped)) then
            call self%differences%evaluate_gamma(t, q, qd, self%all_gamma, self%counts, stat)
            self%model%all_rows%gamma = self%all_gamma
            self%model%terms%gamma = self%all_gamma(self%model%kept)
        else
            call self%differences%evaluate_gamma(t, q, qd, self%model%terms%gamma, self%counts, stat)
        end if
    end subroutine evaluate_gamma

    !> The derivatives of the rows in use; rows that were dropped carry no load here.
    subroutine evaluate_derivatives(self, t, q, qd, qdd, stat)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:), qdd(:)
        integer, intent(out) :: stat

        if (.not. allocated(self%dropped)) then
            call self%differences%evaluate_derivatives(t, q, qd, qdd, self%lambda, self%derivatives, self%counts, stat)
            return
        end if
        self%all_lambda = 0.0_wp
        self%all_lambda(self%model%kept) = self%lambda
        call self%differences%evaluate_derivatives(t, q, qd, qdd, self%all_lambda, self%all_derivatives, self%counts, stat)
        associate (all_rows => self%all_derivatives, kept => self%model%kept)
            self%derivatives%velocity_q = all_rows%velocity_q(kept, :)
            self%derivatives%acceleration_q = all_rows%acceleration_q(kept, :)
            self%derivatives%acceleration_qd = all_rows%acceleration_qd(kept, :)
            self%derivatives%dynamics_q = all_rows%dynamics_q
            self%derivatives%dynamics_qd = all_rows%dynamics_qd
        end associate
    end subroutine evaluate_derivatives

    !> Remember which row is to blame, by its number in the model.
    subroutine blame(self, row, value)
        class(dense_chart_type), intent(inout) :: self
        !> Row among those in use, 0 for none, and its error.
        integer, intent(in) :: row
        real(wp), intent(in) :: value

        self%failed_row = row
        self%failed_value = value
        if (row > 0 .and. allocated(self%dropped)) self%failed_row = self%model%kept(row)
    end subroutine blame

    !> Remember which rows depend on each other at the current point.
    subroutine blame_dependent(self, row)
        class(dense_chart_type), intent(inout) :: self
        !> The one found to depend on others; 0 leaves the choice to the combination.
        integer, intent(in) :: row
        !> Smaller parts of the combination are not named.
        real(wp), parameter :: smallest_part = 0.01_wp
        real(wp) :: share(self%m), smallest
        integer :: i

        call weakest_combination(self%model%terms%jacobian, self%scale, share, smallest)
        if (row > 0) share(row) = 1.0_wp
        call self%blame(merge(row, maxloc(abs(share), dim=1), row > 0), smallest)
        self%failed_rows = pack([(i, i=1, self%m)], abs(share) > smallest_part)
        if (allocated(self%dropped)) self%failed_rows = self%model%kept(self%failed_rows)
    end subroutine blame_dependent

    !> Remember which term of the model failed.
    subroutine fail_term(self)
        class(dense_chart_type), intent(inout) :: self

        self%failed_term = trim(self%model%failed_term)
    end subroutine fail_term
end module tandem_tangent_dense
