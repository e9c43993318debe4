! SPDX-License-Identifier: MIT
!> The dense tangent-space chart at (t0, q0, qd0), for mechanisms of up to some dozens of coordinates.
!>
!> Increments are ambient: xi = dq and eta = dqd, sums of the stages' qd and qdd, unprojected. A position is
!> q = q0 + xi - U u with Phi(t, q) = 0 (11), (14), a velocity is qd = qd0 + eta - X x with C qd = nu (25), (6). As v = V' xi
!> and w = W' eta, this is the trajectory in the chart's coordinates v and w, although explicit steps form neither V nor W:
!> there the condition that qd - qd0 - eta lies in range(C0') reads D0' (qd - qd0 - eta) = 0 with any basis D0 of null(C0).
!>
!> Coordinate scales s: bases are those of C diag(s), so that diag(s) U, diag(s) X, diag(s) V, diag(s) W move q and qd, and
!> diag(s)^-1 V and diag(s)^-1 W are the duals that give coordinates.
module tandem_chart_dense
    use tandem_chart_dense_bases, only: bases_type
    use tandem_error, only: error_type, set_error
    use tandem_kinds, only: wp
    use tandem_linalg_basis, only: basis_type
    use tandem_linalg_kernels, only: add, add_product, are_same, copy, is_finite, set_product
    use tandem_linalg_lu, only: lu_type
    use tandem_linalg_row_space, only: row_space_type
    use tandem_model, only: model_type
    use tandem_model_derivatives, only: derivatives_type, need_all_derivatives
    use tandem_model_differences, only: differences_type
    use tandem_model_evaluator, only: evaluator_type
    use tandem_model_terms, only: need_force, need_gamma, need_jacobian, need_mass, need_nu, need_phi
    use tandem_option_rules, only: projects_stages
    use tandem_options, only: chart_policies, options_type
    use tandem_pack, only: pack_type
    use tandem_status, only: status_chart_left, status_invalid_model, status_not_finite, status_ok, &
        status_position_diverged, status_rank_deficient, status_singular_mass
    use tandem_chart, only: chart_memory_type, chart_type, goal_type, least_bend, measure_type, need_change, need_contraction, &
        need_independence, need_line, need_policy, need_rank, step_end
    use tandem_chart_implicit, only: implicit_chart_type
    use tandem_chart_dense_dynamics, only: dynamics_type
    use tandem_model_natural_scale, only: constraint_errors
    use tandem_model_timer, only: of_position, of_velocity
    use tandem_chart_dense_position, only: position_memory_type, position_type
    use tandem_chart_dense_free_motion, only: free_motion_type
    use tandem_chart_dense_friction, only: friction_type
    use tandem_chart_dense_rows_in_use, only: rows_in_use_type
    use tandem_chart_dense_velocity_basis, only: by_elimination, by_factor, by_refinement, &
        velocity_basis_memory_type, velocity_basis_type
    use tandem_chart_dense_visited_point, only: visited_point_type
    use tandem_chart_dense_newton_matrix, only: stage_type
    use tandem_chart_dense_stage_iterate, only: stage_iterate_type
    use tandem_chart_dense_massless_ties, only: massless_ties_type
    use tandem_chart_dense_metric, only: metric_type
    use tandem_chart_dense_health, only: length_outside, watch_type
    implicit none (type, external)
    private

    public :: dense_chart_type

    !> The start of the next step.
    type, extends(chart_memory_type) :: dense_memory_type
        type(position_memory_type) :: position
        type(velocity_basis_memory_type) :: velocity_basis
    end type dense_memory_type

    !> What a chart needs for its stepper, model and options.
    type :: mode_type
        !> True if iterates of implicit stages are restored completely: under the paper's policy, which counts corrections, with its
        !> refinement, and with friction on reactions, which needs exact reactions at each point.
        logical :: restores_iterates = .false.
        logical :: is_implicit = .false., refines = .false., has_bases = .false., uses_svd = .false.
        !> True if explicit steps restore velocities in the mass metric.
        logical :: keeps_momentum = .false.
        logical :: has_gamma = .true., has_nu = .true.
        !> True if a chart needs no orthonormal basis: for explicit steps without monitored quantities.
        logical :: skips_basis = .false.
    end type mode_type

    !> C at the start of a step (m, n), its orientation and independence, see `velocity_basis_type`.
    type :: start_type
        real(wp), allocatable :: jacobian(:, :)
        integer :: orientation = 1
        real(wp) :: independence = 1.0_wp
        !> If bases are kept: C X there (m, m), and its factors.
        real(wp), allocatable :: c_x(:, :)
        type(lu_type) :: lu
    end type start_type

    type :: work_type
        !> Sizes of the coordinates in rows of Phi (n), rows (m), coordinates (n).
        real(wp), allocatable :: magnitude(:), x(:), trial(:)
        !> Of stages: B Phi_q (nh, n), multipliers (m), changes of q and qd (n).
        real(wp), allocatable :: b_phi(:, :), lambda(:), change_q(:), change_qd(:)
    end type work_type

    !> The chart by dense matrices.
    type, extends(implicit_chart_type) :: dense_chart_type
        private
        type(evaluator_type) :: model
        type(differences_type) :: differences
        type(position_type) :: position
        type(velocity_basis_type) :: velocity_basis
        type(dynamics_type) :: dynamics
        !> Equations of motion without bases.
        type(free_motion_type) :: free_motion
        !> Friction on reactions.
        type(friction_type) :: friction
        type(stage_type), public :: stage
        !> Metric of the complements of implicit steps. True if complements may still be changed: at a chart's origin, before the
        !> first stage of a step.
        type(metric_type) :: metric
        logical :: may_lean = .false., is_at_origin = .false.
        type(derivatives_type) :: derivatives
        !> nh holonomic and m constraints.
        integer :: nh = 0, m = 0
        type(mode_type) :: mode
        !> Largest remaining constraint error, on its natural scale.
        real(wp) :: tolerance = 0.0_wp
        type(watch_type) :: watch
        !> Coordinate scales (n), and scales for bases: if masses differ much, light coordinates move more.
        real(wp), allocatable :: scale(:), basis_scale(:)
        !> 1 over the time scale of the model.
        real(wp) :: rate = 1.0_wp
        logical :: knows_masses = .true.
        !> The origin.
        real(wp), allocatable :: q0(:), qd0(:)
        !> Orthonormal bases at the origin, s the scales for bases.
        type(basis_type) :: basis
        type(bases_type) :: bases
        type(work_type) :: work
        !> The rows in use.
        type(rows_in_use_type) :: rows
        !> The start of the current step, and a detailed check of the changes of C from there.
        type(start_type) :: start
        type(row_space_type) :: row_space
        !> Conditioning of the coordinates without mass by C.
        type(massless_ties_type) :: ties
        !> The point of the terms in `model`.
        type(visited_point_type) :: point
        !> The segment of the model in which the last Newton matrix was formed.
        integer :: stage_segment = 0
        !> The last iterate of each implicit stage.
        type(stage_iterate_type), allocatable :: iterates(:)
    contains
        procedure :: do_attach, do_set_origin, start_step, get_memory, set_memory, forget, inherit
        procedure :: restore, do_accelerate, do_project, remove_normal
        procedure :: do_find_multipliers, do_find_errors, do_measure, pack_state
        procedure :: do_factor, do_reuse, do_find_residual, do_solve, do_solve_pair, do_update, do_filter
        procedure, private, non_overridable :: make_origin, restore_position, restore_velocity, place_bases, visit, move_to
        procedure, private, non_overridable :: refuse_infinite, find_velocity_basis, complete_velocity_basis
        procedure, private, non_overridable :: measure_split, measure_rank, find_loss_ahead, change_from, move_with
        procedure, private, non_overridable :: measure_independence
        procedure, private, non_overridable :: blame, blame_dependent, fail_term, judge_blocks, name_infinite
    end type dense_chart_type

    interface
        !> Attach the model and allocate the work space.
        module subroutine do_attach(self, model, options, implicit, damps, error, kept)
            implicit none (type, external)
            class(dense_chart_type), intent(inout) :: self
            class(model_type), intent(inout), target :: model
            type(options_type), intent(in) :: options
            logical, intent(in) :: implicit, damps
            type(error_type), allocatable, intent(out) :: error
            integer, intent(in), optional :: kept(:)
        end subroutine do_attach

        !> The origin, its bases, the last evaluations and factors, and the Newton matrix.
        module subroutine pack_state(self, pack)
            implicit none (type, external)
            class(dense_chart_type), intent(inout) :: self
            type(pack_type), intent(inout) :: pack
        end subroutine pack_state

        !> Make (t, q, qd) the origin.
        module subroutine make_origin(self, t, q, qd, stat)
            implicit none (type, external)
            class(dense_chart_type), intent(inout) :: self
            real(wp), intent(in) :: t
            real(wp), intent(in), contiguous :: q(:), qd(:)
            integer, intent(out) :: stat
        end subroutine make_origin

        !> Bases at the origin from the orthonormal ones, complements orthogonal in the metric.
        module subroutine place_bases(self)
            implicit none (type, external)
            class(dense_chart_type), intent(inout) :: self
        end subroutine place_bases

        !> Find the term that is not finite, if there is one, after a failure.
        module subroutine name_infinite(self, stat)
            implicit none (type, external)
            class(dense_chart_type), intent(inout) :: self
            !> Unchanged if all terms are finite.
            integer, intent(inout) :: stat
        end subroutine name_infinite

        !> Point and velocity of increments.
        module subroutine restore(self, t, dq, dqd, goal, q, qd, stat)
            implicit none (type, external)
            class(dense_chart_type), intent(inout) :: self
            real(wp), intent(in) :: t, dq(self%n), dqd(self%n)
            type(goal_type), intent(in) :: goal
            real(wp), intent(out) :: q(self%n), qd(self%n)
            integer, intent(out) :: stat
        end subroutine restore

        !> q = q0 + xi - U u with Phi(t, q) = 0.
        module subroutine restore_position(self, t, increment, goal, q, stat)
            implicit none (type, external)
            class(dense_chart_type), intent(inout) :: self
            real(wp), intent(in) :: t, increment(self%n)
            type(goal_type), intent(in) :: goal
            real(wp), intent(out) :: q(self%n)
            integer, intent(out) :: stat
        end subroutine restore_position

        !> Evaluate C, nu and M at (t, q), unless (t, q) was the last point. Splitting C later detects rank loss.
        module subroutine visit(self, t, q, stat)
            implicit none (type, external)
            class(dense_chart_type), intent(inout) :: self
            real(wp), intent(in) :: t, q(self%n)
            integer, intent(out) :: stat
        end subroutine visit

        !> Evaluate C, nu and M at (t, q), and refuse values that are not finite.
        module subroutine move_to(self, t, q, stat)
            implicit none (type, external)
            class(dense_chart_type), intent(inout) :: self
            real(wp), intent(in) :: t, q(self%n)
            integer, intent(out) :: stat
        end subroutine move_to

        !> Refuse values of C and nu that are not finite.
        module subroutine refuse_infinite(self, stat)
            implicit none (type, external)
            class(dense_chart_type), intent(inout) :: self
            integer, intent(out) :: stat
        end subroutine refuse_infinite

        !> Compute the factors of C from which R and D follow, and with `refine` also B.
        module subroutine find_velocity_basis(self, stat)
            implicit none (type, external)
            class(dense_chart_type), intent(inout) :: self
            integer, intent(out) :: stat
        end subroutine find_velocity_basis

        !> R and D at the current point as matrices.
        module subroutine complete_velocity_basis(self, stat)
            implicit none (type, external)
            class(dense_chart_type), intent(inout) :: self
            integer, intent(out) :: stat
        end subroutine complete_velocity_basis

        !> qd = qd0 + eta - X x with C qd = nu.
        module subroutine restore_velocity(self, t, q, increment, goal, qd, stat)
            implicit none (type, external)
            class(dense_chart_type), intent(inout) :: self
            real(wp), intent(in) :: t, q(self%n), increment(self%n)
            type(goal_type), intent(in) :: goal
            real(wp), intent(out) :: qd(self%n)
            integer, intent(out) :: stat
        end subroutine restore_velocity

        !> Evaluate also gamma and the forces at (t, q, qd), unless it was the last point.
        module subroutine move_with(self, t, q, qd, stat)
            implicit none (type, external)
            class(dense_chart_type), intent(inout) :: self
            real(wp), intent(in) :: t, q(self%n), qd(self%n)
            integer, intent(out) :: stat
        end subroutine move_with

        !> The acceleration at a point.
        module subroutine do_accelerate(self, t, q, qd, goal, qdd, stat)
            implicit none (type, external)
            class(dense_chart_type), intent(inout) :: self
            real(wp), intent(in) :: t, q(self%n), qd(self%n)
            type(goal_type), intent(in) :: goal
            real(wp), intent(out) :: qdd(self%n)
            integer, intent(out) :: stat
        end subroutine do_accelerate

        !> Bring a point beside the manifold onto it, by C there.
        module subroutine do_project(self, t, q, qd, moves_q, exactly, stat)
            implicit none (type, external)
            class(dense_chart_type), intent(inout) :: self
            real(wp), intent(in) :: t
            real(wp), intent(inout) :: q(self%n), qd(self%n)
            logical, intent(in) :: moves_q, exactly
            integer, intent(out) :: stat
        end subroutine do_project

        !> Remove from errors of rates the components that `project` removes from a curve.
        module subroutine remove_normal(self, error_q, error_qd)
            implicit none (type, external)
            class(dense_chart_type), intent(inout) :: self
            real(wp), intent(inout), contiguous :: error_q(:), error_qd(:)
        end subroutine remove_normal

        !> Copy the independence measures of another chart of the same run.
        module subroutine inherit(self, other)
            implicit none (type, external)
            class(dense_chart_type), intent(inout) :: self
            class(chart_type), intent(in) :: other
        end subroutine inherit

        !> Measures along a step.
        module subroutine do_measure(self, need, t_from, q_from, t, q, qd, measure, stat)
            implicit none (type, external)
            class(dense_chart_type), intent(inout) :: self
            integer, intent(in) :: need
            real(wp), intent(in) :: t_from, t
            real(wp), intent(in), contiguous :: q_from(:), q(:), qd(:)
            type(measure_type), intent(out) :: measure
            integer, intent(out) :: stat
        end subroutine do_measure

        !> Independence at (t, q), and losses since the start of the step.
        module subroutine measure_rank(self, t_from, q_from, t, q, measure, stat)
            implicit none (type, external)
            class(dense_chart_type), intent(inout) :: self
            real(wp), intent(in) :: t_from, t
            real(wp), intent(in), contiguous :: q_from(:), q(:)
            type(measure_type), intent(inout) :: measure
            integer, intent(out) :: stat
        end subroutine measure_rank

        !> The orientation and the independence of C at the current point.
        module subroutine measure_split(self)
            implicit none (type, external)
            class(dense_chart_type), intent(inout) :: self
        end subroutine measure_split

        !> The smallest singular value of the unit rows of C at a point.
        module subroutine measure_independence(self, t, q, independence, stat)
            implicit none (type, external)
            class(dense_chart_type), intent(inout) :: self
            real(wp), intent(in) :: t
            real(wp), intent(in), contiguous :: q(:)
            real(wp), intent(inout) :: independence
            integer, intent(out) :: stat
        end subroutine measure_independence

        !> Loss of C on the straight line between two points, unless C changes too much on the line; else ok.
        module integer function find_loss_ahead(self, t_from, q_from, t, q) result(loss)
            implicit none (type, external)
            class(dense_chart_type), intent(inout) :: self
            real(wp), intent(in) :: t_from, t
            real(wp), intent(in), contiguous :: q_from(:), q(:)
        end function find_loss_ahead

        !> Change of C from another point to the current point: rows of unit length at the other point, Frobenius norm.
        pure module real(wp) function change_from(self, other)
            implicit none (type, external)
            class(dense_chart_type), intent(in) :: self
            !> C elsewhere (m, n).
            real(wp), intent(in) :: other(:, :)
        end function change_from

        !> Store the rows that depend on each other at the current point.
        module subroutine blame_dependent(self, row)
            implicit none (type, external)
            class(dense_chart_type), intent(inout) :: self
            !> Row found to depend on others; if 0, it is chosen by its part in the combination.
            integer, intent(in) :: row
        end subroutine blame_dependent

        !> Form and factor the Newton matrix.
        module subroutine do_factor(self, t, q, qd, qdd, ha, ratios, stat)
            implicit none (type, external)
            class(dense_chart_type), intent(inout) :: self
            real(wp), intent(in) :: t
            real(wp), intent(in), contiguous :: q(:), qd(:), qdd(:)
            real(wp), intent(in) :: ha
            complex(wp), intent(in), contiguous :: ratios(:)
            integer, intent(out) :: stat
        end subroutine do_factor

        !> Reuse the last Newton matrix for ha.
        module subroutine do_reuse(self, ha, ratios, can)
            implicit none (type, external)
            class(dense_chart_type), intent(inout) :: self
            real(wp), intent(in) :: ha
            complex(wp), intent(in), contiguous :: ratios(:)
            logical, intent(out) :: can
        end subroutine do_reuse

        !> The point and the residual of an iterate of a stage.
        module subroutine do_find_residual(self, goal, t, increment, q, qd, rate, residual, stat)
            implicit none (type, external)
            class(dense_chart_type), intent(inout) :: self
            type(goal_type), intent(in) :: goal
            real(wp), intent(in) :: t
            real(wp), intent(in), contiguous :: increment(:, :)
            real(wp), intent(inout), contiguous :: q(:), qd(:), rate(:, :), residual(:)
            integer, intent(out) :: stat
        end subroutine do_find_residual

        !> The correction of the real system of stages that are solved together.
        module subroutine do_solve(self, x)
            implicit none (type, external)
            class(dense_chart_type), intent(inout) :: self
            real(wp), intent(inout), contiguous :: x(:)
        end subroutine do_solve

        !> The correction of one of their pairs of systems.
        module subroutine do_solve_pair(self, k, x, y)
            implicit none (type, external)
            class(dense_chart_type), intent(inout) :: self
            integer, intent(in) :: k
            real(wp), intent(inout), contiguous :: x(:), y(:)
        end subroutine do_solve_pair

        !> Add a correction to a stage's rates.
        module subroutine do_update(self, stage, q, qd, ha, correction, rate, change, stat)
            implicit none (type, external)
            class(dense_chart_type), intent(inout) :: self
            integer, intent(in) :: stage
            real(wp), intent(in), contiguous :: q(:), qd(:)
            real(wp), intent(in) :: ha
            real(wp), intent(in), contiguous :: correction(:)
            real(wp), intent(inout), contiguous :: rate(:, :)
            real(wp), intent(out) :: change
            integer, intent(out) :: stat
        end subroutine do_update

        !> Filter an error by a solve with the Newton matrix.
        module subroutine do_filter(self, error_q, error_qd)
            implicit none (type, external)
            class(dense_chart_type), intent(inout) :: self
            real(wp), intent(inout), contiguous :: error_q(:), error_qd(:)
        end subroutine do_filter

        !> lambda at (t, q, qd, qdd).
        module subroutine do_find_multipliers(self, t, q, qd, qdd, lambda, stat)
            implicit none (type, external)
            class(dense_chart_type), intent(inout) :: self
            real(wp), intent(in) :: t
            real(wp), intent(in), contiguous :: q(:), qd(:), qdd(:)
            real(wp), intent(out), contiguous :: lambda(:)
            integer, intent(out) :: stat
        end subroutine do_find_multipliers

        !> The errors of the three constraint levels at the last point.
        module subroutine do_find_errors(self, t, q, qd, qdd, errors, rows, stat)
            implicit none (type, external)
            class(dense_chart_type), intent(inout) :: self
            real(wp), intent(in) :: t
            real(wp), intent(in), contiguous :: q(:), qd(:), qdd(:)
            real(wp), intent(out) :: errors(3)
            integer, intent(out) :: rows(3), stat
        end subroutine do_find_errors
    end interface

contains

    !> Store the start of a step.
    subroutine start_step(self, qdd)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in), contiguous :: qdd(:)

        call self%position%start_step(self%start%jacobian, qdd)
    end subroutine start_step

    !> Begin steps at a point.
    subroutine do_set_origin(self, t, q, qd, keeps, dq, stat)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:)
        logical, intent(in) :: keeps
        real(wp), intent(inout), contiguous :: dq(:)
        integer, intent(out) :: stat
        logical :: is_rounding

        if (keeps) then
            call keep_origin(self, t, q, stat)
            return
        end if
        call self%position%find_remainder(self%q0, dq, q, self%scale, self%work%trial, is_rounding)
        ! More than rounding: q is not the point of that increment.
        if (.not. is_rounding) self%work%trial = 0.0_wp
        call copy(self%n, self%work%trial, dq)
        call self%make_origin(t, q, qd, stat)
    end subroutine do_set_origin

    !> Bring the row scales and the factor of Phi_q U to (t, q).
    subroutine keep_origin(self, t, q, stat)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:)
        integer, intent(out) :: stat

        self%failure%row = 0
        self%is_at_origin = .false.
        self%may_lean = .false.
        call self%move_to(t, q, stat)
        if (stat == status_ok) call self%judge_blocks(stat)
        if (stat == status_ok) then
            self%start%jacobian(:, :) = self%model%terms%jacobian
            call self%model%set_magnitudes(q, self%work%magnitude)
            call self%position%refresh(t, self%model%terms%jacobian, self%work%magnitude, self%scale, self%counts, stat)
        end if
    end subroutine keep_origin

    !> Save the start of the next step.
    subroutine get_memory(self, memory)
        class(dense_chart_type), intent(inout) :: self
        class(chart_memory_type), allocatable, intent(inout) :: memory

        if (allocated(memory)) then
            if (.not. same_type_as(memory, dense_memory_type())) deallocate (memory)
        end if
        if (.not. allocated(memory)) allocate (dense_memory_type :: memory)
        select type (memory)
        type is (dense_memory_type)
            call self%position%save(memory%position)
            call self%velocity_basis%save(memory%velocity_basis)
        end select
    end subroutine get_memory

    !> Restore the saved start of the next step, or return to the start of the current one.
    subroutine set_memory(self, memory)
        class(dense_chart_type), intent(inout) :: self
        class(chart_memory_type), intent(in), optional :: memory
        integer :: choice

        if (.not. present(memory)) then
            self%may_lean = self%is_at_origin
            call self%position%retry_step()
            return
        end if
        select type (memory)
        type is (dense_memory_type)
            call self%position%restore_saved(memory%position)
            choice = self%velocity_basis%elimination%choice
            call self%velocity_basis%restore_saved(memory%velocity_basis)
            ! Factors of an elimination with other pivots are not usable with the restored pivots.
            if (self%velocity_basis%elimination%choice /= choice) call self%point%forget_velocity_basis()
        end select
    end subroutine set_memory

    !> Invalidate the last point, and all that depends on parameters of the model.
    subroutine forget(self, parameters)
        class(dense_chart_type), intent(inout) :: self
        logical, intent(in) :: parameters

        call self%point%forget()
        if (.not. parameters) return
        self%model%mass_is_known = .false.
        self%stage_segment = 0
    end subroutine forget

    !> Store the row at fault, by its number in the model.
    subroutine blame(self, row, value)
        class(dense_chart_type), intent(inout) :: self
        !> Row among those in use, 0 for none, and its error.
        integer, intent(in) :: row
        real(wp), intent(in) :: value

        self%failure%row = row
        self%failure%value = value
        if (row > 0 .and. allocated(self%rows%dropped)) self%failure%row = self%model%kept(row)
    end subroutine blame

    !> Refuse M at the start of a step if it is not zero outside its blocks.
    subroutine judge_blocks(self, stat)
        class(dense_chart_type), intent(inout) :: self
        integer, intent(out) :: stat

        stat = status_ok
        call self%model%judge_blocks(stat)
        if (stat /= status_ok) call self%fail_term()
    end subroutine judge_blocks

    !> Store the name of the term of the model that failed.
    subroutine fail_term(self)
        class(dense_chart_type), intent(inout) :: self

        self%failure%term = trim(self%model%failed_term)
    end subroutine fail_term
end module tandem_chart_dense
