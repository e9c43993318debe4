! SPDX-License-Identifier: MIT
!> The chart's contract: operations of local coordinates on the constraint manifold for steppers and the simulation.
!>
!> A stepper integrates increments from the chart's origin and requests the points that belong to them. It uses neither
!> constraints nor bases. A chart implements the deferred procedures; steppers and the simulation call those without `do_`, which
!> measure their time if the model has a timer. Only charts set components, except for counts and the failures of evaluations by the
!> caller.
module tandem_chart
    use tandem_chart_failure, only: chart_failure_type
    use tandem_chart_goal, only: goal_type, step_end
    use tandem_chart_measure, only: least_bend, measure_type, need_change, need_contraction, need_independence, need_line, &
        need_policy, need_rank
    use tandem_error, only: error_type
    use tandem_kinds, only: wp
    use tandem_model, only: model_type
    use tandem_model_counts, only: counts_type
    use tandem_model_timer, only: of_acceleration, of_errors, of_multipliers, of_origin, of_policy, of_position, of_projection, &
        of_rank, of_refresh, timer_type
    use tandem_options, only: options_type
    use tandem_pack, only: pack_type
    use tandem_status, only: status_rank_deficient
    implicit none (type, external)
    private

    public :: chart_type, chart_memory_type, chart_failure_type, goal_type, step_end
    public :: measure_type, least_bend, need_change, need_contraction, need_independence, need_line, need_policy, need_rank

    !> Start of the next step, to which a chart returns after evaluations of other points.
    type, abstract :: chart_memory_type
    end type chart_memory_type

    !> The contract that steppers and the simulation rely on.
    type, abstract :: chart_type
        !> Number of coordinates. Stage arrays have explicit shape (n), which avoids array descriptors.
        integer :: n = 0
        !> Operation counts of the chart.
        type(counts_type) :: counts
        !> Details of the last failure.
        type(chart_failure_type) :: failure
        !> The smallest singular value of the unit rows of C at the origin, the largest one so far, and the largest one since the
        !> rows in use were chosen.
        real(wp) :: independence = 1.0_wp, best_independence = 0.0_wp, chosen_independence = 0.0_wp
        !> Number of redundant rows left out, and their numbers after `leave_out_dependent`, ascending.
        integer :: n_dropped = 0
        integer, allocatable :: left_out(:)
        !> True if C of the origin corrects the ends of steps whose stages were not projected, which limits the length of steps.
        logical :: has_reach = .false.
        !> The model's timer.
        class(timer_type), pointer :: timer => null()
    contains
        procedure(attach_interface), deferred :: do_attach
        procedure(origin_interface), deferred :: do_set_origin
        procedure(start_interface), deferred :: start_step
        procedure(get_interface), deferred :: get_memory
        procedure(set_interface), deferred :: set_memory
        procedure(forget_interface), deferred :: forget
        procedure(restore_interface), deferred :: restore
        procedure(accelerate_interface), deferred :: do_accelerate
        procedure(project_interface), deferred :: do_project
        procedure(tangent_interface), deferred :: remove_normal
        procedure(multipliers_interface), deferred :: do_find_multipliers
        procedure(errors_interface), deferred :: do_find_errors
        procedure(measure_interface), deferred :: do_measure
        procedure(pack_interface), deferred :: pack_state
        procedure :: leave_out_dependent, find_partners, inherit, forget_rank
        procedure, non_overridable :: attach, set_origin, accelerate, project, find_multipliers, find_errors, measure
        procedure, non_overridable :: is_firm, wants_other_rows, note_independence, continue_counts, pack_contract
    end type chart_type

    !> Other rows are chosen when the smallest singular value has fallen to this part of its largest value. Errors of an
    !> acceleration with the rows in use grow with the third power of the inverse in the rows that were left out.
    real(wp), parameter :: near_rank_loss = 0.5_wp

    abstract interface
        !> Attach the model and allocate the work space, once.
        subroutine attach_interface(self, model, options, implicit, damps, error, kept)
            import :: chart_type, model_type, options_type, error_type
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
            !> The model; it must outlive the chart.
            class(model_type), intent(inout), target :: model
            type(options_type), intent(in) :: options
            !> True if the stepper is implicit: the operations of stages are then used. True if it damps stiff modes: its steps may
            !> then be long, if the chart follows those.
            logical, intent(in) :: implicit, damps
            type(error_type), allocatable, intent(out) :: error
            !> Numbers of the constraint rows to use if some are redundant, ascending; all rows if absent.
            integer, intent(in), optional :: kept(:)
        end subroutine attach_interface

        !> Begin steps at (t, q, qd): make it the origin, where increments are zero, or keep the origin and bring the stored
        !> quantities to the point.
        subroutine origin_interface(self, t, q, qd, keeps, dq, stat)
            import :: chart_type, wp
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
            !> Time, coordinates (n) and velocities (n) that satisfy the constraints.
            real(wp), intent(in) :: t
            real(wp), intent(in), contiguous :: q(:), qd(:)
            !> True if the origin is kept.
            logical, intent(in) :: keeps
            !> The increment (n) to q from the origin before; from the new one on return. That is the rounding error of q, which is
            !> carried so that errors of many small steps do not add up.
            real(wp), intent(inout), contiguous :: dq(:)
            !> A status code.
            integer, intent(out) :: stat
        end subroutine origin_interface

        !> Store the start of a step with stages of known `defect`.
        subroutine start_interface(self, qdd)
            import :: chart_type, wp
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
            !> The acceleration (n) at the start, the point of the last `set_origin`.
            real(wp), intent(in), contiguous :: qdd(:)
        end subroutine start_interface

        !> Save the start of the next step.
        subroutine get_interface(self, memory)
            import :: chart_type, chart_memory_type
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
            !> From an earlier call for this chart, or not allocated.
            class(chart_memory_type), allocatable, intent(inout) :: memory
        end subroutine get_interface

        !> Restore the saved start of the next step; without it, return to the start of the current step after a rejected attempt.
        subroutine set_interface(self, memory)
            import :: chart_type, chart_memory_type
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
            class(chart_memory_type), intent(in), optional :: memory
        end subroutine set_interface

        !> Invalidate the last point, because the model has entered another segment.
        subroutine forget_interface(self, parameters)
            import :: chart_type
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
            !> True if parameters of the model may have changed: invalidate also a constant mass matrix and the Newton matrix.
            logical, intent(in) :: parameters
        end subroutine forget_interface

        !> The point q(t) of the manifold that belongs to a position increment, Phi(t, q) = 0 (14), and the velocity there that
        !> belongs to a velocity increment, C qd = nu (6).
        subroutine restore_interface(self, t, dq, dqd, goal, q, qd, stat)
            import :: chart_type, goal_type, wp
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
            real(wp), intent(in) :: t
            !> Increments of position and velocity (n).
            real(wp), intent(in) :: dq(self%n), dqd(self%n)
            type(goal_type), intent(in) :: goal
            real(wp), intent(out) :: q(self%n), qd(self%n)
            integer, intent(out) :: stat
        end subroutine restore_interface

        !> The acceleration at (t, q, qd): C qdd = -gamma and the equations of motion (35).
        subroutine accelerate_interface(self, t, q, qd, goal, qdd, stat)
            import :: chart_type, goal_type, wp
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
            real(wp), intent(in) :: t
            !> Coordinates and velocities (n), of the last restored point if there is one: its evaluations are then used.
            real(wp), intent(in) :: q(self%n), qd(self%n)
            type(goal_type), intent(in) :: goal
            real(wp), intent(out) :: qdd(self%n)
            integer, intent(out) :: stat
        end subroutine accelerate_interface

        !> Bring a point beside the manifold onto it, in directions of the point itself, so that a singular chart does not matter.
        subroutine project_interface(self, t, q, qd, moves_q, exactly, stat)
            import :: chart_type, wp
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
            real(wp), intent(in) :: t
            !> Coordinates and velocities (n).
            real(wp), intent(inout) :: q(self%n), qd(self%n)
            !> False if q satisfies the constraints: qd becomes the nearest velocity in the mass metric that satisfies C qd = nu, as
            !> after an impact-free jump of nu.
            logical, intent(in) :: moves_q
            !> True to correct q until rounding prevents it: errors of Phi are magnified where C is nearly of lower rank.
            logical, intent(in) :: exactly
            integer, intent(out) :: stat
        end subroutine project_interface

        !> Remove from the errors of rates at the point of the last `project` the components normal to the manifold.
        subroutine tangent_interface(self, error_q, error_qd)
            import :: chart_type, wp
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
            !> Errors of the derivatives of q and of qd (n).
            real(wp), intent(inout), contiguous :: error_q(:), error_qd(:)
        end subroutine tangent_interface

        !> The multipliers lambda of all rows of the model (nh + nd) at a point where `accelerate` gave qdd; the least-norm solution
        !> if rows are redundant.
        subroutine multipliers_interface(self, t, q, qd, qdd, lambda, stat)
            import :: chart_type, wp
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
            real(wp), intent(in) :: t
            real(wp), intent(in), contiguous :: q(:), qd(:), qdd(:)
            real(wp), intent(out), contiguous :: lambda(:)
            integer, intent(out) :: stat
        end subroutine multipliers_interface

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

        !> Measure C and the quality of the chart from the start of a step to its end, or on a line from it.
        subroutine measure_interface(self, need, t_from, q_from, t, q, qd, measure, stat)
            import :: chart_type, measure_type, wp
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
            !> Groups of measures, a sum of need bits.
            integer, intent(in) :: need
            !> The point of the last `set_origin`, except for `need_line`, and another point; its velocity, for `need_policy`.
            real(wp), intent(in) :: t_from, t
            real(wp), intent(in), contiguous :: q_from(:), q(:), qd(:)
            !> The measures of these groups; others have their defaults.
            type(measure_type), intent(out) :: measure
            !> `rank_deficient` if C loses its rank between the points, `singular_mass` if it no longer conditions the coordinates
            !> without mass, both with `failure`. With `need_rank` also `chart_left` if C has turned too far to decide, or the
            !> status of evaluating the model.
            integer, intent(out) :: stat
        end subroutine measure_interface

        !> Everything that the further course depends on: bases and factors are stored and restored unchanged.
        subroutine pack_interface(self, pack)
            import :: chart_type, pack_type
            implicit none (type, external)
            class(chart_type), intent(inout) :: self
            type(pack_type), intent(inout) :: pack
        end subroutine pack_interface
    end interface

contains

    !> Attach the model.
    subroutine attach(self, model, options, implicit, damps, error, kept)
        class(chart_type), intent(inout) :: self
        class(model_type), intent(inout), target :: model
        type(options_type), intent(in) :: options
        logical, intent(in) :: implicit, damps
        type(error_type), allocatable, intent(out) :: error
        integer, intent(in), optional :: kept(:)

        self%timer => model%state%timer
        ! gfortran would use undefined bounds if an absent argument were passed on.
        if (present(kept)) then
            call self%do_attach(model, options, implicit, damps, error, kept)
        else
            call self%do_attach(model, options, implicit, damps, error)
        end if
    end subroutine attach

    !> Begin steps at a point.
    subroutine set_origin(self, t, q, qd, keeps, dq, stat)
        class(chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:)
        logical, intent(in) :: keeps
        real(wp), intent(inout), contiguous :: dq(:)
        integer, intent(out) :: stat

        if (associated(self%timer)) call self%timer%begin_operation(merge(of_refresh, of_origin, keeps))
        call self%do_set_origin(t, q, qd, keeps, dq, stat)
        if (associated(self%timer)) call self%timer%end_operation()
    end subroutine set_origin

    !> The acceleration.
    subroutine accelerate(self, t, q, qd, goal, qdd, stat)
        class(chart_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(self%n), qd(self%n)
        type(goal_type), intent(in) :: goal
        real(wp), intent(out) :: qdd(self%n)
        integer, intent(out) :: stat

        if (associated(self%timer)) call self%timer%begin_operation(of_acceleration)
        call self%do_accelerate(t, q, qd, goal, qdd, stat)
        if (associated(self%timer)) call self%timer%end_operation()
    end subroutine accelerate

    !> Bring a point onto the manifold.
    subroutine project(self, t, q, qd, moves_q, stat, exactly)
        class(chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(inout) :: q(self%n), qd(self%n)
        logical, intent(in) :: moves_q
        integer, intent(out) :: stat
        !> False by default.
        logical, intent(in), optional :: exactly
        logical :: to_rounding

        to_rounding = .false.
        if (present(exactly)) to_rounding = exactly
        if (associated(self%timer)) call self%timer%begin_operation(merge(of_position, of_projection, moves_q))
        call self%do_project(t, q, qd, moves_q, to_rounding, stat)
        if (associated(self%timer)) call self%timer%end_operation()
    end subroutine project

    !> The multipliers.
    subroutine find_multipliers(self, t, q, qd, qdd, lambda, stat)
        class(chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:), qdd(:)
        real(wp), intent(out), contiguous :: lambda(:)
        integer, intent(out) :: stat

        if (associated(self%timer)) call self%timer%begin_operation(of_multipliers)
        call self%do_find_multipliers(t, q, qd, qdd, lambda, stat)
        if (associated(self%timer)) call self%timer%end_operation()
    end subroutine find_multipliers

    !> The constraint errors.
    subroutine find_errors(self, t, q, qd, qdd, errors, rows, stat)
        class(chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:), qdd(:)
        real(wp), intent(out) :: errors(3)
        integer, intent(out) :: rows(3), stat

        if (associated(self%timer)) call self%timer%begin_operation(of_errors)
        call self%do_find_errors(t, q, qd, qdd, errors, rows, stat)
        if (associated(self%timer)) call self%timer%end_operation()
    end subroutine find_errors

    !> Measure C between two points.
    subroutine measure(self, need, t_from, q_from, t, q, qd, measured, stat)
        class(chart_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t_from, t
        real(wp), intent(in), contiguous :: q_from(:), q(:), qd(:)
        type(measure_type), intent(out) :: measured
        integer, intent(out) :: stat

        if (associated(self%timer)) call self%timer%begin_operation(merge(of_policy, of_rank, need == need_policy))
        call self%do_measure(need, t_from, q_from, t, q, qd, measured, stat)
        if (associated(self%timer)) call self%timer%end_operation()
    end subroutine measure

    !> Continue another chart of the same run. To be called before the first origin.
    subroutine inherit(self, other)
        class(chart_type), intent(inout) :: self
        class(chart_type), intent(in) :: other

        call self%continue_counts(other%counts, other%best_independence)
    end subroutine inherit

    !> The next origin lies behind a loss of rank: comparisons of C with earlier points begin anew. For charts that make any between
    !> origins.
    subroutine forget_rank(self)
        class(chart_type), intent(inout) :: self
    end subroutine forget_rank

    !> Continue the counts of another chart of the same run, and its independence, by which losses are judged.
    subroutine continue_counts(self, counts, best_independence)
        class(chart_type), intent(inout) :: self
        type(counts_type), intent(in) :: counts
        real(wp), intent(in) :: best_independence

        self%counts = counts
        self%best_independence = max(self%best_independence, best_independence)
    end subroutine continue_counts

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
        call self%failure%pack_state(pack)
        call pack%item(self%independence, self%best_independence, self%chosen_independence)
        call pack%item(self%n_dropped)
        call pack%item(self%left_out)
    end subroutine pack_contract
end module tandem_chart
