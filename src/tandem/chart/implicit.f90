! SPDX-License-Identifier: MIT
!> The contract of implicit stages: Newton's iteration for the rates of a stage at points near the manifold.
!>
!> Correcting a stage is residual, solve, update. A chart implements the deferred procedures; implicit steppers and the simulation
!> call those without `do_`, which measure their time if the model has a timer.
module tandem_chart_implicit
    use tandem_chart, only: chart_type, goal_type
    use tandem_kinds, only: wp
    use tandem_model_timer, only: of_correction, of_filter, of_matrix, of_reuse, of_stage
    implicit none (type, external)
    private

    public :: implicit_chart_type, filter_error

    !> A chart that solves implicit stages.
    type, abstract, extends(chart_type) :: implicit_chart_type
        !> Entries of the residual of a stage; numbers of the first ones that belong to rates of the position and of the velocity.
        !> Corrections of multipliers may follow. They change with the rows in use.
        integer :: n_residual = 0, n_rates(2) = 0
        !> Cost of a new Newton matrix in corrections of a stage; steppers use it to decide how long to keep a matrix.
        real(wp) :: matrix_cost = 0.0_wp
        !> True if the corrections of stages contract at any stiffness while bodies turn little: stages that are hard to solve have
        !> then turned too far. Size of the next step over that of a step with such stages, and growth of the limit in later steps.
        logical :: follows_stiffness = .false.
        real(wp) :: after_hard_step = 0.5_wp, easing = 1.1_wp
    contains
        procedure(factor_interface), deferred :: do_factor
        procedure(reuse_interface), deferred :: do_reuse
        procedure(residual_interface), deferred :: do_find_residual
        procedure(solve_interface), deferred :: do_solve
        procedure(solve_pair_interface), deferred :: do_solve_pair
        procedure(update_interface), deferred :: do_update
        procedure(filter_interface), deferred :: do_filter
        procedure, non_overridable :: factor, reuse, find_residual, solve, solve_pair, update, filter
    end type implicit_chart_type

    abstract interface
        !> Form and factor the Newton matrix at a point with its acceleration, I - ha J in the chart's coordinates.
        subroutine factor_interface(self, t, q, qd, qdd, ha, ratios, stat)
            import :: implicit_chart_type, wp
            implicit none (type, external)
            class(implicit_chart_type), intent(inout) :: self
            real(wp), intent(in) :: t
            !> Coordinates, velocities, accelerations (n).
            real(wp), intent(in), contiguous :: q(:), qd(:), qdd(:)
            !> h a_ii.
            real(wp), intent(in) :: ha
            !> For a method whose stages are solved together, 2 size(ratios) + 1 of them: ratio of the ha of each complex pair of
            !> systems to the real ha. Empty for other methods.
            complex(wp), intent(in), contiguous :: ratios(:)
            !> A status code.
            integer, intent(out) :: stat
        end subroutine factor_interface

        !> Reuse the matrix of the last `factor` for stages with another ha, on another chart too: no derivatives, at most a
        !> factorisation.
        subroutine reuse_interface(self, ha, ratios, can)
            import :: implicit_chart_type, wp
            implicit none (type, external)
            class(implicit_chart_type), intent(inout) :: self
            !> As for `factor`; other ratios than before are allowed.
            real(wp), intent(in) :: ha
            complex(wp), intent(in), contiguous :: ratios(:)
            !> False if there is no such matrix, or if the model has entered another segment since.
            logical, intent(out) :: can
        end subroutine reuse_interface

        !> The point and the residual of an iterate of a stage, in coordinates of the chart. A point need only be so near the
        !> manifold that Newton's iteration contracts as on it. The parts of the stage's rates that the chart ignores are set to
        !> those of the point.
        subroutine residual_interface(self, goal, t, increment, q, qd, rate, residual, stat)
            import :: implicit_chart_type, goal_type, wp
            implicit none (type, external)
            class(implicit_chart_type), intent(inout) :: self
            !> The stage and its iterate.
            type(goal_type), intent(in) :: goal
            real(wp), intent(in) :: t
            !> Increments of position and velocity (n, 2).
            real(wp), intent(in), contiguous :: increment(:, :)
            !> Coordinates (n): predicted ones at the first iterate, later those of the iterate before; those of the iterate on
            !> return.
            real(wp), intent(inout), contiguous :: q(:)
            !> Velocities of the iterate (n), and rates of the increments (n, 2).
            real(wp), intent(inout), contiguous :: qd(:), rate(:, :)
            !> (n_residual)
            real(wp), intent(inout), contiguous :: residual(:)
            integer, intent(out) :: stat
        end subroutine residual_interface

        !> The correction for a residual of the real system, in place.
        subroutine solve_interface(self, x)
            import :: implicit_chart_type, wp
            implicit none (type, external)
            class(implicit_chart_type), intent(inout) :: self
            !> (n_residual)
            real(wp), intent(inout), contiguous :: x(:)
        end subroutine solve_interface

        !> The correction x + i y for a residual of one of the pairs of systems, in place.
        subroutine solve_pair_interface(self, k, x, y)
            import :: implicit_chart_type, wp
            implicit none (type, external)
            class(implicit_chart_type), intent(inout) :: self
            !> The number of the pair in `ratios`.
            integer, intent(in) :: k
            !> (n_residual) each.
            real(wp), intent(inout), contiguous :: x(:), y(:)
        end subroutine solve_pair_interface

        !> Add a correction to a stage's rates.
        subroutine update_interface(self, stage, q, qd, ha, correction, rate, change, stat)
            import :: implicit_chart_type, wp
            implicit none (type, external)
            class(implicit_chart_type), intent(inout) :: self
            !> Number of the stage.
            integer, intent(in) :: stage
            !> Coordinates and velocities of the stage (n), the scale that turns rates into increments, the correction (n_residual).
            real(wp), intent(in), contiguous :: q(:), qd(:)
            real(wp), intent(in) :: ha
            real(wp), intent(in), contiguous :: correction(:)
            real(wp), intent(inout), contiguous :: rate(:, :)
            !> Changes of q and qd by the correction, and the errors that the iterate may have left, largest entry against |q| or
            !> |qd| and the coordinate scales.
            real(wp), intent(out) :: change
            integer, intent(out) :: stat
        end subroutine update_interface

        !> Filter the error of an implicit step by a solve with its Newton matrix, which removes components that stiff modes damp.
        subroutine filter_interface(self, error_q, error_qd)
            import :: implicit_chart_type, wp
            implicit none (type, external)
            class(implicit_chart_type), intent(inout) :: self
            !> Errors of the position and velocity increments (n).
            real(wp), intent(inout), contiguous :: error_q(:), error_qd(:)
        end subroutine filter_interface
    end interface

contains

    !> Form and factor the Newton matrix.
    subroutine factor(self, t, q, qd, qdd, ha, ratios, stat)
        class(implicit_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:), qdd(:)
        real(wp), intent(in) :: ha
        complex(wp), intent(in), contiguous :: ratios(:)
        integer, intent(out) :: stat

        if (associated(self%timer)) call self%timer%begin_operation(of_matrix)
        call self%do_factor(t, q, qd, qdd, ha, ratios, stat)
        if (associated(self%timer)) call self%timer%end_operation()
    end subroutine factor

    !> Reuse the Newton matrix.
    subroutine reuse(self, ha, ratios, can)
        class(implicit_chart_type), intent(inout) :: self
        real(wp), intent(in) :: ha
        complex(wp), intent(in), contiguous :: ratios(:)
        logical, intent(out) :: can

        if (associated(self%timer)) call self%timer%begin_operation(of_reuse)
        call self%do_reuse(ha, ratios, can)
        if (associated(self%timer)) call self%timer%end_operation()
    end subroutine reuse

    !> The residual of a stage.
    subroutine find_residual(self, goal, t, increment, q, qd, rate, residual, stat)
        class(implicit_chart_type), intent(inout) :: self
        type(goal_type), intent(in) :: goal
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: increment(:, :)
        real(wp), intent(inout), contiguous :: q(:), qd(:), rate(:, :), residual(:)
        integer, intent(out) :: stat

        if (associated(self%timer)) call self%timer%begin_operation(of_stage)
        if (goal%is_first) self%counts%implicit_stages = self%counts%implicit_stages + 1
        call self%do_find_residual(goal, t, increment, q, qd, rate, residual, stat)
        if (associated(self%timer)) call self%timer%end_operation()
    end subroutine find_residual

    !> The correction of the real system.
    subroutine solve(self, x)
        class(implicit_chart_type), intent(inout) :: self
        real(wp), intent(inout), contiguous :: x(:)

        if (associated(self%timer)) call self%timer%begin_operation(of_stage)
        call self%do_solve(x)
        if (associated(self%timer)) call self%timer%end_operation()
    end subroutine solve

    !> The correction of a pair of systems.
    subroutine solve_pair(self, k, x, y)
        class(implicit_chart_type), intent(inout) :: self
        integer, intent(in) :: k
        real(wp), intent(inout), contiguous :: x(:), y(:)

        if (associated(self%timer)) call self%timer%begin_operation(of_stage)
        call self%do_solve_pair(k, x, y)
        if (associated(self%timer)) call self%timer%end_operation()
    end subroutine solve_pair

    !> Correct a stage.
    subroutine update(self, stage, q, qd, ha, correction, rate, change, stat)
        class(implicit_chart_type), intent(inout) :: self
        integer, intent(in) :: stage
        real(wp), intent(in), contiguous :: q(:), qd(:)
        real(wp), intent(in) :: ha
        real(wp), intent(in), contiguous :: correction(:)
        real(wp), intent(inout), contiguous :: rate(:, :)
        real(wp), intent(out) :: change
        integer, intent(out) :: stat

        if (associated(self%timer)) call self%timer%begin_operation(of_correction)
        call self%do_update(stage, q, qd, ha, correction, rate, change, stat)
        if (associated(self%timer)) call self%timer%end_operation()
    end subroutine update

    !> Filter an error.
    subroutine filter(self, error_q, error_qd)
        class(implicit_chart_type), intent(inout) :: self
        real(wp), intent(inout), contiguous :: error_q(:), error_qd(:)

        if (associated(self%timer)) call self%timer%begin_operation(of_filter)
        call self%do_filter(error_q, error_qd)
        if (associated(self%timer)) call self%timer%end_operation()
    end subroutine filter

    !> Filter an error of a run with any chart; without implicit stages it is unchanged.
    subroutine filter_error(chart, error_q, error_qd)
        class(chart_type), intent(inout) :: chart
        real(wp), intent(inout), contiguous :: error_q(:), error_qd(:)

        select type (chart)
        class is (implicit_chart_type)
            call chart%filter(error_q, error_qd)
        end select
    end subroutine filter_error
end module tandem_chart_implicit
