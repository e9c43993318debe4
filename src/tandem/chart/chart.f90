! SPDX-License-Identifier: MIT
!> The chart's contract: operations of local coordinates on the constraint manifold for steppers and the simulation.
!>
!> A stepper integrates increments from the chart's origin and requests the points that belong to them. It uses neither constraints
!> nor bases. The order of the calls at a stage is fixed: `restore_position`, `restore_velocity`, `solve_dynamics`, all at one time;
!> each may use the evaluations of the call before. `restore_motion` combines the three.
module tandem_chart
    use tandem_error, only: error_type
    use tandem_kinds, only: wp
    use tandem_model, only: model_type
    use tandem_options, only: options_type
    use tandem_pack, only: pack_type
    use tandem_status, only: status_rank_deficient
    use tandem_model_counts, only: counts_type
    implicit none (type, external)
    private

    public :: chart_type, health_type, least_bend

    !> Distance of a point from the chart's origin, and measures of the chart's quality there.
    type :: health_type
        !> |v|_2 and |w|_2, in scaled coordinates.
        real(wp) :: v = 0.0_wp, w = 0.0_wp
        !> |D|_2 and |Fbar|_2: 1 at the origin, then the secant of the angle between the tangent spaces.
        real(wp) :: d = 1.0_wp, fbar = 1.0_wp
        !> Condition number of (38) or (81), and the most corrections of an iteration for u, B or H since the last look.
        real(wp) :: condition = 1.0_wp
        integer :: corrections = 0
    end type health_type

    !> The contract that steppers and the simulation rely on.
    type, abstract :: chart_type
        !> Number of coordinates. Stage arrays have explicit shape (n), which avoids array descriptors.
        integer :: n = 0
        !> Entries of the residual of a stage, for stages that are solved together. Changes with the rows in use.
        integer :: n_residual = 0
        !> True if complements follow stiff directions: stages that are hard to solve have then turned too far.
        logical :: follows_stiffness = .false.
        !> Operation counts of the chart.
        type(counts_type) :: counts
        !> After a failure: the constraint row at fault (0 for none) and its error on its natural scale.
        integer :: failed_row = 0
        real(wp) :: failed_value = 0.0_wp
        !> After `rank_deficient`: the rows that depend on each other, `failed_row` among them.
        integer, allocatable :: failed_rows(:)
        !> After `singular_mass`: the coordinate without mass that no constraint conditions, if known; else 0.
        integer :: failed_coordinate = 0
        !> Set before `initialize`: true if the stepper damps stiff modes. Its steps may then be long, if the chart follows those.
        logical :: damps = .false.
        !> Set by a stepper while it evaluates stages: their positions need only satisfy its tolerance, and rounding errors of the
        !> constraints may remain.
        logical :: is_stage = .false.
        !> Set by a stepper while it evaluates a stage whose increment misses the second derivative of the motion by this times qdd
        !> at the start of the step: h^2 (c^2/2 - sum a c). Huge if unknown.
        real(wp) :: defect = huge(1.0_wp)
        !> Number of that stage, 0 for none, and the size of the step: the errors of a stage are nearly equal in successive steps.
        integer :: stage_number = 0
        real(wp) :: step_size = 0.0_wp
        !> Largest errors of q and qd that the iteration may leave in this step, for charts that solve by refinement.
        real(wp) :: iterate_tolerance = 0.0_wp
        !> The smallest singular value of the unit rows of C at the origin.
        real(wp) :: independence = 1.0_wp
        !> The largest of these so far, the largest since the rows in use were chosen, and the number of redundant rows left out.
        real(wp) :: best_independence = 0.0_wp, chosen_independence = 0.0_wp
        !> Remaining part of the independence according to `measure_rank`; 1 if not measured.
        real(wp) :: fallen = 1.0_wp
        !> Remaining part of the conditioning of massless coordinates, likewise.
        real(wp) :: loosened = 1.0_wp
        integer :: n_dropped = 0
        !> Their numbers after `leave_out_dependent`, ascending.
        integer, allocatable :: left_out(:)
        !> After `callback_failed`, `not_evaluable` or `not_finite`: the term that was being evaluated.
        character(len=:), allocatable :: failed_term
    contains
        procedure(initialize_interface), deferred :: initialize
        procedure(renew_interface), deferred :: renew
        procedure(remainder_interface), deferred :: remainder
        procedure(refresh_interface), deferred :: refresh
        procedure(start_step_interface), deferred :: start_step
        procedure(retry_step_interface), deferred :: retry_step
        procedure(forget_interface), deferred :: forget
        procedure(forget_interface), deferred :: forget_model
        procedure(forget_interface), deferred :: hold
        procedure(forget_interface), deferred :: release
        procedure(restore_position_interface), deferred :: restore_position
        procedure(restore_velocity_interface), deferred :: restore_velocity
        procedure(solve_dynamics_interface), deferred :: solve_dynamics
        procedure(restore_motion_interface), deferred :: restore_motion
        procedure(restore_near_interface), deferred :: restore_near
        procedure(tangent_interface), deferred :: keep_tangent
        procedure(factor_stage_interface), deferred :: factor_stage
        procedure(reuse_stage_interface), deferred :: reuse_stage
        procedure(matrix_cost_interface), deferred :: matrix_cost
        procedure(expect_pairs_interface), deferred :: expect_pairs
        procedure(stage_residual_interface), deferred :: stage_residual
        procedure(solve_real_interface), deferred :: solve_real
        procedure(solve_pair_interface), deferred :: solve_pair
        procedure(update_stage_interface), deferred :: update_stage
        procedure(filter_error_interface), deferred :: filter_error
        procedure(multipliers_interface), deferred :: multipliers
        procedure(project_velocity_interface), deferred :: project_velocity
        procedure(errors_interface), deferred :: constraint_errors
        procedure(rank_interface), deferred :: measure_rank
        procedure(ahead_interface), deferred :: loss_ahead
        procedure(change_interface), deferred :: relative_change
        procedure(health_interface), deferred :: measure_health
        procedure(energy_interface), deferred :: kinetic_energy
        procedure :: inherit, is_firm, note_independence, wants_other_rows, leave_out_dependent, find_partners, contraction
        procedure(pack_interface), deferred :: pack_state
        procedure :: pack_contract
    end type chart_type

    !> Other rows are chosen when the smallest singular value has fallen to this part of its largest value. Errors of an
    !> acceleration with the rows in use grow with the third power of the inverse in the rows that were left out.
    real(wp), parameter :: near_rank_loss = 0.5_wp

    !> Corrections below this part of the natural scale of every row are too small to measure the reach of a chart.
    real(wp), parameter :: least_bend = 2.0e-4_wp

    abstract interface
        !> Attach the model and allocate the work space, once.
        subroutine initialize_interface(self, model, options, implicit, error, kept)
            import :: chart_type, model_type, options_type, error_type
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
            !> The model; it must outlive the chart.
            class(model_type), intent(inout), target :: model
            type(options_type), intent(in) :: options
            !> True if the stepper is implicit: the operations of stages are then used.
            logical, intent(in) :: implicit
            type(error_type), allocatable, intent(out) :: error
            !> Numbers of the constraint rows to use if some are redundant, ascending; all rows if absent.
            integer, intent(in), optional :: kept(:)
        end subroutine initialize_interface

        !> Make (t, q, qd) the chart's origin; the increments there are zero.
        subroutine renew_interface(self, t, q, qd, stat)
            import :: chart_type, wp
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
            !> Time, coordinates (n) and velocities (n) that satisfy the constraints.
            real(wp), intent(in) :: t
            real(wp), intent(in), contiguous :: q(:), qd(:)
            !> A status code.
            integer, intent(out) :: stat
        end subroutine renew_interface

        !> Rounding error of the last restored point q = q0 + xi - U u; becomes the initial increment of the next chart, so that the
        !> errors of many small steps do not add up.
        pure subroutine remainder_interface(self, increment, q, left)
            import :: chart_type, wp
            implicit none (type, external)
            class(chart_type), intent(in) :: self
            !> xi (n) and the point restored from it (n).
            real(wp), intent(in), contiguous :: increment(:), q(:)
            !> (n)
            real(wp), intent(out), contiguous :: left(:)
        end subroutine remainder_interface

        !> Bring the stored quantities to (t, q); called before a step on an old chart.
        subroutine refresh_interface(self, t, q, stat)
            import :: chart_type, wp
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
            real(wp), intent(in) :: t
            real(wp), intent(in), contiguous :: q(:)
            integer, intent(out) :: stat
        end subroutine refresh_interface

        !> Store the start of a step with stages of known `defect`.
        subroutine start_step_interface(self, qdd)
            import :: chart_type, wp
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
            !> The acceleration (n) at the start, the point of the last renewal or refresh.
            real(wp), intent(in), contiguous :: qdd(:)
        end subroutine start_step_interface

        !> Go back to the start of the step, after a rejected attempt.
        subroutine retry_step_interface(self)
            import :: chart_type
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
        end subroutine retry_step_interface

        !> `forget`: invalidate the last point, because the model has changed there (a new segment). `forget_model`: also a constant
        !> mass matrix, because parameters may have changed. `hold`: save the start of the next step. `release`: restore it after
        !> evaluations of other points.
        subroutine forget_interface(self)
            import :: chart_type
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
        end subroutine forget_interface

        !> The point q(t) of the manifold that belongs to a position increment: Phi(t, q) = 0 (14).
        subroutine restore_position_interface(self, t, increment, q, stat)
            import :: chart_type, wp
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
            real(wp), intent(in) :: t
            !> Position increment (n).
            real(wp), intent(in) :: increment(self%n)
            real(wp), intent(out) :: q(self%n)
            integer, intent(out) :: stat
        end subroutine restore_position_interface

        !> The velocity at (t, q) that belongs to a velocity increment: C qd = nu (6).
        subroutine restore_velocity_interface(self, t, q, increment, qd, stat)
            import :: chart_type, wp
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
            !> Time and coordinates (n) from `restore_position`.
            real(wp), intent(in) :: t
            real(wp), intent(in) :: q(self%n)
            !> Velocity increment (n).
            real(wp), intent(in) :: increment(self%n)
            real(wp), intent(out) :: qd(self%n)
            integer, intent(out) :: stat
        end subroutine restore_velocity_interface

        !> The acceleration at (t, q, qd): C qdd = -gamma and the equations of motion (35).
        subroutine solve_dynamics_interface(self, t, q, qd, qdd, stat)
            import :: chart_type, wp
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
            !> Time, coordinates (n) and velocities (n) from the calls before.
            real(wp), intent(in) :: t
            real(wp), intent(in) :: q(self%n), qd(self%n)
            real(wp), intent(out) :: qdd(self%n)
            integer, intent(out) :: stat
        end subroutine solve_dynamics_interface

        !> The point, velocity and acceleration that belong to increments, before any evaluation there.
        subroutine restore_motion_interface(self, t, increment, increment_qd, q, qd, qdd, stat)
            import :: chart_type, wp
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
            real(wp), intent(in) :: t
            !> Increments of position and velocity (n).
            real(wp), intent(in) :: increment(self%n), increment_qd(self%n)
            real(wp), intent(out) :: q(self%n), qd(self%n), qdd(self%n)
            integer, intent(out) :: stat
        end subroutine restore_motion_interface

        !> Bring a point beside the manifold onto it, position and velocity: independently of the directions of the origin, so that
        !> a singular chart does not matter.
        subroutine restore_near_interface(self, t, q, qd, stat)
            import :: chart_type, wp
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
            real(wp), intent(in) :: t
            !> Coordinates and velocities (n).
            real(wp), intent(inout) :: q(self%n), qd(self%n)
            integer, intent(out) :: stat
        end subroutine restore_near_interface

        !> Remove from the errors of rates at the point of the last `restore_near` the components normal to the manifold.
        subroutine tangent_interface(self, error_q, error_qd)
            import :: chart_type, wp
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
            !> Errors of the derivatives of q and of qd (n).
            real(wp), intent(inout), contiguous :: error_q(:), error_qd(:)
        end subroutine tangent_interface

        !> Form and factor the Newton matrix of implicit stages at the last point of `solve_dynamics` (97).
        subroutine factor_stage_interface(self, t, q, qd, qdd, ha, stat)
            import :: chart_type, wp
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
            real(wp), intent(in) :: t
            real(wp), intent(in), contiguous :: q(:), qd(:), qdd(:)
            !> h a_ii.
            real(wp), intent(in) :: ha
            integer, intent(out) :: stat
        end subroutine factor_stage_interface

        !> Reuse the matrix of the last `factor_stage` for stages with another ha, on another chart too: no derivatives, at most a
        !> factorisation.
        subroutine reuse_stage_interface(self, ha, can)
            import :: chart_type, wp
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
            !> h a_ii.
            real(wp), intent(in) :: ha
            !> False if there is no such matrix, or if the model has entered another segment since.
            logical, intent(out) :: can
        end subroutine reuse_stage_interface

        !> Cost of `factor_stage` in units of a stage's correction; steppers use it to decide how long to keep a matrix.
        pure real(wp) function matrix_cost_interface(self)
            import :: chart_type, wp
            implicit none (type, external)
            class(chart_type), intent(in) :: self
        end function matrix_cost_interface

        !> For a method whose stages are solved together, 2 size(ratios) + 1 of them: from now on `factor_stage` and `reuse_stage`
        !> also form the matrices of complex pairs of systems. A method may call it with other ratios at the start of a later step,
        !> when its number of stages changes; unchanged ratios cost nothing.
        subroutine expect_pairs_interface(self, ratios)
            import :: chart_type, wp
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
            !> Ratio of each pair's ha to the real ha.
            complex(wp), intent(in), contiguous :: ratios(:)
        end subroutine expect_pairs_interface

        !> The point and the residual of an iterate of an implicit stage, in coordinates of the chart. A point need only be so near
        !> the manifold that Newton's iteration contracts as on it. The parts of the stage's rates that the chart ignores are set
        !> to those of the point.
        subroutine stage_residual_interface(self, stage, is_first, defect, t, increment, increment_qd, q, qd, rate_q, rate_qd, &
            residual, stat)
            import :: chart_type, wp
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
            !> Number of the stage, under which a chart may store data until the next step.
            integer, intent(in) :: stage
            !> True for the first iterate, with predicted rates and coordinates.
            logical, intent(in) :: is_first
            !> The defect of the stage's increment at the first iterate, see `defect`, with its own rate; huge if unknown.
            real(wp), intent(in) :: defect
            real(wp), intent(in) :: t
            !> Increments of position and velocity (n).
            real(wp), intent(in), contiguous :: increment(:), increment_qd(:)
            !> Coordinates (n): predicted ones at the first iterate, later those of the iterate before; those of the iterate on
            !> return.
            real(wp), intent(inout), contiguous :: q(:)
            !> Velocities of the iterate (n).
            real(wp), intent(inout), contiguous :: qd(:)
            !> Rates of the increments (n).
            real(wp), intent(inout), contiguous :: rate_q(:), rate_qd(:)
            !> (n_residual)
            real(wp), intent(inout), contiguous :: residual(:)
            integer, intent(out) :: stat
        end subroutine stage_residual_interface

        !> The correction for a residual of the real system, in place.
        subroutine solve_real_interface(self, x)
            import :: chart_type, wp
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
            !> (n_residual)
            real(wp), intent(inout), contiguous :: x(:)
        end subroutine solve_real_interface

        !> The correction x + i y for a residual of one of the pairs of systems, in place.
        subroutine solve_pair_interface(self, k, x, y)
            import :: chart_type, wp
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
            !> The number of the pair in `expect_pairs`.
            integer, intent(in) :: k
            !> (n_residual) each.
            real(wp), intent(inout), contiguous :: x(:), y(:)
        end subroutine solve_pair_interface

        !> Add a correction to a stage's rates.
        subroutine update_stage_interface(self, stage, q, qd, ha, correction, rate_q, rate_qd, change, stat)
            import :: chart_type, wp
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
            !> As of `stage_residual`.
            integer, intent(in) :: stage
            !> Coordinates and velocities of the stage (n), the scale that turns rates into increments, the correction (n_residual).
            real(wp), intent(in), contiguous :: q(:), qd(:)
            real(wp), intent(in) :: ha
            real(wp), intent(in), contiguous :: correction(:)
            real(wp), intent(inout), contiguous :: rate_q(:), rate_qd(:)
            !> Changes of q and qd by the correction, and the errors that the iterate may have left, largest entry against |q| or
            !> |qd| and the coordinate scales.
            real(wp), intent(out) :: change
            integer, intent(out) :: stat
        end subroutine update_stage_interface

        !> Filter the error of an implicit step by a solve with its Newton matrix, which removes components that stiff modes damp.
        subroutine filter_error_interface(self, error_q, error_qd)
            import :: chart_type, wp
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
            !> Errors of the position and velocity increments (n).
            real(wp), intent(inout), contiguous :: error_q(:), error_qd(:)
        end subroutine filter_error_interface

        !> The multipliers lambda of all rows of the model (nh + nd) at a point where `solve_dynamics` gave qdd; the least-norm
        !> solution if rows are redundant.
        subroutine multipliers_interface(self, t, q, qd, qdd, lambda, stat)
            import :: chart_type, wp
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
            real(wp), intent(in) :: t
            real(wp), intent(in), contiguous :: q(:), qd(:), qdd(:)
            real(wp), intent(out), contiguous :: lambda(:)
            integer, intent(out) :: stat
        end subroutine multipliers_interface

        !> The velocity nearest to qd in the mass metric that satisfies C qd = nu at (t, q), as after an impact-free jump of nu.
        subroutine project_velocity_interface(self, t, q, qd, stat)
            import :: chart_type, wp
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
            real(wp), intent(in) :: t
            real(wp), intent(in), contiguous :: q(:)
            real(wp), intent(inout), contiguous :: qd(:)
            integer, intent(out) :: stat
        end subroutine project_velocity_interface

        !> The constraint errors at a point, max-norms on the natural scale of each row.
        subroutine errors_interface(self, t, q, qd, qdd, errors, rows, stat)
            import :: chart_type, wp
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
            real(wp), intent(in) :: t
            real(wp), intent(in), contiguous :: q(:), qd(:), qdd(:)
            !> Position, velocity and acceleration error.
            real(wp), intent(out) :: errors(3)
            !> The row of C that attains each error, 0 for none.
            integer, intent(out) :: rows(3)
            integer, intent(out) :: stat
        end subroutine errors_interface

        !> Number of steps like the last one until C loses rank, extrapolated from its smallest singular value; huge if that does
        !> not fall, 0 if redundant rows have become independent. `failed_rows` are then the rows that depend on each other.
        subroutine rank_interface(self, t_from, q_from, t, q, room, stat)
            import :: chart_type, wp
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
            !> The start of the step, the point of the last renewal or refresh, and its end.
            real(wp), intent(in) :: t_from, t
            real(wp), intent(in), contiguous :: q_from(:), q(:)
            real(wp), intent(out) :: room
            !> Within the step C has lost and regained its rank (`rank_deficient`), it no longer conditions the coordinates without
            !> mass (`singular_mass`), or it has turned too far to decide (`chart_left`); or the status of evaluating the model.
            integer, intent(out) :: stat
        end subroutine rank_interface

        !> Loss of C on the straight line from a state within the time h, as in `measure_rank`, or ok: for a failed or rejected
        !> step, and for steps that creep.
        integer function ahead_interface(self, t, q, qd, h)
            import :: chart_type, wp
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
            real(wp), intent(in) :: t
            real(wp), intent(in), contiguous :: q(:), qd(:)
            real(wp), intent(in) :: h
        end function ahead_interface

        !> Change of C from the start of the step to the point of `measure_rank`: rows of unit length, Frobenius norm. Used only if
        !> steps are controlled.
        real(wp) function change_interface(self)
            import :: chart_type, wp
            implicit none (type, external)
            class(chart_type), intent(in) :: self
        end function change_interface

        !> Quality of the chart at a point, for the policy.
        subroutine health_interface(self, t, q, qd, health, stat)
            import :: chart_type, health_type, wp
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
            real(wp), intent(in) :: t
            real(wp), intent(in), contiguous :: q(:), qd(:)
            type(health_type), intent(out) :: health
            integer, intent(out) :: stat
        end subroutine health_interface

        !> The kinetic energy qd' M qd / 2.
        subroutine energy_interface(self, t, q, qd, energy, stat)
            import :: chart_type, wp
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
            real(wp), intent(in) :: t
            real(wp), intent(in), contiguous :: q(:), qd(:)
            real(wp), intent(out) :: energy
            integer, intent(out) :: stat
        end subroutine energy_interface

        !> Everything that the further course depends on: bases and factors are stored and restored unchanged.
        subroutine pack_interface(self, pack)
            import :: chart_type, pack_type
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
            type(pack_type), intent(inout) :: pack
        end subroutine pack_interface
    end interface

contains

    !> Measure of how far the displacement of a step turns away from the tangent space at its start: the part of the correction back
    !> to the manifold that Newton's iteration with C of the start leaves at the point of `measure_rank`. 0 if C has not changed, 1
    !> if the iteration stagnates. 0 for charts without this measure, and for small corrections.
    real(wp) function contraction(self, way)
        class(chart_type), intent(inout) :: self
        !> From the start of the step, where the chart was made, to its end (n).
        real(wp), intent(in), contiguous :: way(:)

        contraction = 0.0_wp
    end function contraction

    !> Copy the independence measures of another chart of the same run, by which losses are judged.
    subroutine inherit(self, other)
        class(chart_type), intent(inout) :: self
        class(chart_type), intent(in) :: other

        self%best_independence = max(self%best_independence, other%best_independence)
    end subroutine inherit

    !> The set of redundant rows that can be left out changes along a motion: true if other rows are to be chosen.
    pure logical function wants_other_rows(self)
        class(chart_type), intent(in) :: self

        wants_other_rows = self%n_dropped > 0 .and. self%independence <= near_rank_loss*self%chosen_independence
    end function wants_other_rows

    !> True if the rows in use are nearly as independent as at their best.
    pure logical function is_firm(self)
        class(chart_type), intent(in) :: self

        is_firm = self%independence > near_rank_loss*self%best_independence
    end function is_firm

    !> Record the smallest singular value of the unit rows of C at the origin.
    pure subroutine note_independence(self, smallest)
        class(chart_type), intent(inout) :: self
        real(wp), intent(in) :: smallest

        self%independence = smallest
        self%best_independence = max(self%best_independence, smallest)
        self%chosen_independence = max(self%chosen_independence, smallest)
    end subroutine note_independence

    !> Leave out rows that depend on others at a state, and make it the origin; for charts that support this. Other charts are
    !> created anew with the remaining rows.
    subroutine leave_out_dependent(self, t, q, qd, stat)
        class(chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:)
        !> `rank_deficient` if no rows can be left out.
        integer, intent(out) :: stat

        stat = status_rank_deficient
    end subroutine leave_out_dependent

    !> The rows in use whose combinations are rows that were left out.
    subroutine find_partners(self, rows, start, partners)
        class(chart_type), intent(inout) :: self
        integer, intent(in) :: rows(:)
        !> The rows for rows(i) are partners(start(i):start(i + 1) - 1).
        integer, allocatable, intent(out) :: start(:), partners(:)

        allocate (start(size(rows) + 1), source=1)
        allocate (partners(0))
    end subroutine find_partners

    !> State of every chart, for its `pack_state`.
    subroutine pack_contract(self, pack)
        class(chart_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call self%counts%pack_state(pack)
        call pack%item(self%failed_row)
        call pack%item(self%failed_value)
        call pack%item(self%failed_rows)
        call pack%item(self%failed_coordinate)
        call pack%item(self%is_stage)
        call pack%item(self%independence, self%best_independence, self%chosen_independence, self%fallen, self%loosened)
        call pack%item(self%n_dropped)
        call pack%item(self%left_out)
        call pack%text(self%failed_term)
    end subroutine pack_contract
end module tandem_chart
