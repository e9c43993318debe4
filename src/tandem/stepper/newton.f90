! SPDX-License-Identifier: MIT
!> Newton's iteration for the rates of an implicit stage: its position and velocity increments are base + ha rate.
!>
!> The iteration estimates its contraction theta and stops when the remaining error, theta / (1 - theta) times the last correction,
!> is below the tolerance. Source: Hairer and Wanner, Solving Ordinary Differential Equations II, section IV.8.
!>
!> A matrix is reused from step to step until a new one is cheaper: when a step takes more corrections than the average step with
!> this matrix, where the average includes the cost of making the matrix.
module tandem_stepper_newton
    use tandem_kinds, only: long, wp
    use tandem_pack, only: pack_type
    use tandem_stepper_history, only: history_type
    use tandem_stepper_prediction, only: prediction_type
    use tandem_stepper_state, only: state_type
    use tandem_status, only: status_newton_failed, status_ok
    use tandem_chart, only: goal_type, step_end
    use tandem_chart_implicit, only: implicit_chart_type
    implicit none (type, external)
    private

    public :: newton_type

    type :: newton_type
        !> Rates of position and velocity of the stage (n, 2): start value on entry, solution on return.
        real(wp), allocatable :: rate(:, :)
        !> Increments without the contribution of the stage's own rates (n, 2).
        real(wp), allocatable :: base(:, :)
        !> Relative error, with respect to scale + |y|, of recent steps of equal size; 0 if unknown.
        real(wp) :: error_of_steps = 0.0_wp
        !> For stages that are solved together: ratio of the ha of each complex system to the real ha; otherwise empty.
        complex(wp), allocatable :: ratios(:)
        !> Tolerance of the iteration without regard to the error of steps; tolerance in this step; amplification of the error of
        !> each stage at the end of the step; tolerance of each stage in this step.
        real(wp), private :: least_tolerance = 0.0_wp, step_tolerance = 0.0_wp
        real(wp), allocatable, private :: amplification(:), tolerance(:)
        !> c^2/2 - sum a c of each stage over a_ii^2: the error of its increments is this factor times ha^2 times the second
        !> derivative.
        real(wp), allocatable, private :: defect(:)
        !> Corrections below this limit that do not decrease are rounding errors, amplified by stiff forces.
        real(wp), private :: rounding_limit = 0.0_wp
        !> Contraction of each stage as last observed; its value if the observation was significant, otherwise 0; first correction
        !> at the last observation; number of steps since then; age of the matrix at that time in steps.
        real(wp), allocatable, private :: theta(:), significant_theta(:), observed_change(:)
        integer, allocatable, private :: age(:), observed_age(:)
        !> Age of the matrix in steps; number of corrections counted before this step; cost of the matrix and of the corrections
        !> with it, in units of one correction. True if the matrix was made in this step; true if it was made at an extrapolated
        !> point; true if the next step should make a new one.
        integer, private :: n_steps_used = 0
        integer(long), private :: counted = 0
        real(wp), private :: spent = 0.0_wp
        logical, private :: is_fresh = .false., is_ahead = .false.
        !> Number of steps that a matrix is expected to serve, from the last one that failed; true while this step reuses a matrix.
        real(wp), private :: lifetime = huge(1.0_wp)
        logical, private :: is_reused = .false.
        logical :: is_outdated = .true.
        type(prediction_type), private :: prediction
        !> Coordinates and velocities of the stage (n): predicted coordinates on entry, last iterate on return.
        real(wp), allocatable :: q(:), qd(:)
        real(wp), allocatable, private :: increment(:, :), residual(:)
    contains
        procedure :: allocate => allocate_newton, prepare, solve, renew, renew_in_step
        procedure :: correct, restore, goal
        procedure, private :: iterate
        procedure :: finish, pack_state
    end type newton_type

contains

    !> Allocate work space.
    subroutine allocate_newton(self, scale, time_scale, tolerance, amplification, defect)
        class(newton_type), intent(inout) :: self
        !> Coordinate scales (n), and time scale.
        real(wp), intent(in) :: scale(:), time_scale
        !> Tolerance of the iteration for q and qd, relative to the coordinate scales plus |q| and |qd|.
        real(wp), intent(in) :: tolerance
        !> Amplification of the error of each stage at the end of the step, |b_i| / a_ii.
        real(wp), intent(in) :: amplification(:)
        !> c^2/2 - sum a c of each stage over a_ii^2; empty if increments have no such error.
        real(wp), intent(in) :: defect(:)

        if (allocated(self%residual)) deallocate (self%residual)
        self%defect = defect
        self%error_of_steps = 0.0_wp
        self%least_tolerance = tolerance
        self%step_tolerance = tolerance
        self%ratios = [complex(wp) ::]
        self%amplification = max(amplification, 1.0_wp)
        self%tolerance = self%amplification
        self%rounding_limit = 1.0e3_wp*tolerance
        self%theta = spread(1.0_wp, 1, size(amplification))
        self%significant_theta = spread(0.0_wp, 1, size(amplification))
        self%observed_change = spread(0.0_wp, 1, size(amplification))
        self%age = spread(0, 1, size(amplification))
        self%observed_age = self%age
        self%is_outdated = .true.
        call self%prediction%allocate(scale, time_scale, size(amplification))
        self%q = 0.0_wp*scale
        self%qd = self%q
        self%rate = spread(self%q, 2, 2)
        self%base = self%rate
        self%increment = self%rate
        allocate (self%residual(0))
    end subroutine allocate_newton

    !> Begin a step: reuse the matrix, or make a new one at an extrapolated point within the step or at its start.
    subroutine prepare(self, chart, history, state, h, ha, continues, stat)
        class(newton_type), intent(inout) :: self
        class(implicit_chart_type), intent(inout) :: chart
        type(history_type), intent(in) :: history
        !> The state at the start of the step.
        type(state_type), intent(in) :: state
        !> Step size, and h a_ii.
        real(wp), intent(in) :: h, ha
        !> False if the history does not apply to this step.
        logical, intent(in) :: continues
        !> A status code.
        integer, intent(out) :: stat
        !> Tolerance of the iteration relative to the error of steps; largest factor by which this rule may raise the smallest
        !> tolerance.
        real(wp), parameter :: share = 0.01_wp, loosest = 100.0_wp
        logical :: is_new, keeps

        stat = status_ok
        self%counted = chart%counts%newton_corrections
        self%is_fresh = .false.
        self%is_ahead = .false.
        if (.not. continues) then
            call self%prediction%clear()
            self%theta = 1.0_wp
            self%significant_theta = 0.0_wp
            self%error_of_steps = 0.0_wp
            self%lifetime = huge(1.0_wp)
        end if
        self%step_tolerance = max(self%least_tolerance, min(share*self%error_of_steps, loosest*self%least_tolerance))
        self%tolerance(:) = max(self%step_tolerance/self%amplification, 2*epsilon(1.0_wp))
        keeps = continues .and. .not. self%is_outdated
        if (keeps) call chart%reuse(ha, self%ratios, keeps)
        self%is_reused = keeps
        if (keeps) return
        if (continues) then
            call self%renew_in_step(chart, history, state, h, ha, is_new, stat)
        else
            call self%renew(chart, state%t, state%q, state%qd, state%qdd, ha, stat)
        end if
    end subroutine prepare

    !> Make another matrix after the stages failed: first at a point in the middle of the stages if the matrix is from an earlier
    !> step, then at the start of the step.
    subroutine renew_in_step(self, chart, history, state, h, ha, is_new, stat)
        class(newton_type), intent(inout) :: self
        class(implicit_chart_type), intent(inout) :: chart
        type(history_type), intent(in) :: history
        !> The state at the start of the step.
        type(state_type), intent(in) :: state
        !> The step, and h a_ii.
        real(wp), intent(in) :: h, ha
        !> False if both have been tried.
        logical, intent(out) :: is_new
        integer, intent(out) :: stat

        stat = status_ok
        is_new = self%is_ahead .or. .not. self%is_fresh
        if (.not. is_new) return
        self%is_ahead = .false.
        if (self%is_reused) self%lifetime = real(self%n_steps_used, wp)
        self%is_reused = .false.
        if (.not. self%is_fresh) call renew_ahead(self, chart, history, state, h, ha)
        if (.not. self%is_ahead) call self%renew(chart, state%t, state%q, state%qd, state%qdd, ha, stat)
    end subroutine renew_in_step

    !> Make a matrix at an extrapolated point in the middle of the stages. The orientation of a rotating body changes considerably
    !> along a step, which slows the contraction with a matrix of the start.
    subroutine renew_ahead(self, chart, history, state, h, ha)
        class(newton_type), intent(inout) :: self
        class(implicit_chart_type), intent(inout) :: chart
        type(history_type), intent(in) :: history
        !> The state at the start of the step.
        type(state_type), intent(in) :: state
        !> The step, and h a_ii.
        real(wp), intent(in) :: h, ha
        !> Time of the matrix within the step, as a fraction of the step.
        real(wp), parameter :: matrix_position = 0.6_wp
        real(wp) :: t
        integer :: stat

        t = state%t + matrix_position*h
        call history%extrapolate(t, self%rate(:, 1), self%rate(:, 2))
        self%increment(:, 1) = state%dq + (0.5_wp*matrix_position*h)*(state%qd + self%rate(:, 1))
        self%increment(:, 2) = state%dqd + (0.5_wp*matrix_position*h)*(state%qdd + self%rate(:, 2))
        call chart%restore(t, self%increment(:, 1), self%increment(:, 2), step_end, self%q, self%qd, stat)
        if (stat == status_ok) call self%renew(chart, t, self%q, self%qd, self%rate(:, 2), ha, stat)
        self%is_ahead = stat == status_ok
    end subroutine renew_ahead

    !> Make a matrix at a point.
    subroutine renew(self, chart, t, q, qd, qdd, ha, stat)
        class(newton_type), intent(inout) :: self
        class(implicit_chart_type), intent(inout) :: chart
        real(wp), intent(in) :: t, ha
        !> Coordinates, velocities, accelerations (n).
        real(wp), intent(in), contiguous :: q(:), qd(:), qdd(:)
        integer, intent(out) :: stat

        call chart%factor(t, q, qd, qdd, ha, self%ratios, stat)
        self%is_fresh = .true.
        self%is_ahead = .false.
        self%is_outdated = stat /= status_ok
        self%n_steps_used = 0
        self%spent = chart%matrix_cost
        self%observed_age = 0
    end subroutine renew

    !> Solve the stage at time t. The following are tried in turn: the extrapolated history as start value; if the matrix is from an
    !> earlier step, a matrix made in the middle of the stages, then one made at the start of the step; the state at the start of
    !> the step as start value; matrices made at the last iterate.
    subroutine solve(self, chart, history, state, stage, t, h, ha, stat)
        class(newton_type), intent(inout) :: self
        class(implicit_chart_type), intent(inout) :: chart
        type(history_type), intent(inout) :: history
        !> The state at the start of the step.
        type(state_type), intent(in) :: state
        !> Number and time of the stage, step size, and h a_ii.
        integer, intent(in) :: stage
        real(wp), intent(in) :: t, h, ha
        !> A status code.
        integer, intent(out) :: stat
        !> Largest number of matrices for one stage.
        integer, parameter :: most_matrices = 2
        logical :: is_new
        integer :: failure, k

        call self%prediction%predict(history, stage, t, ha, self%rate(:, 1), self%rate(:, 2), self%q)
        call self%iterate(chart, stage, t, ha, stat)
        do while (stat /= status_ok)
            call self%renew_in_step(chart, history, state, h, ha, is_new, failure)
            if (.not. is_new) exit
            stat = failure
            if (stat /= status_ok) return
            call self%prediction%predict(history, stage, t, ha, self%rate(:, 1), self%rate(:, 2), self%q)
            call self%iterate(chart, stage, t, ha, stat)
        end do
        if (stat == status_ok) then
            call self%prediction%store_deviation(stage, state%t, ha, self%rate(:, 1), self%rate(:, 2))
            return
        end if
        call self%prediction%clear()
        self%theta(stage) = 1.0_wp
        self%rate(:, 1) = state%qd
        self%rate(:, 2) = state%qdd
        self%q = state%q
        call self%iterate(chart, stage, t, ha, stat)
        do k = 1, most_matrices
            if (stat /= status_newton_failed) return
            call self%restore(chart, t, ha, stat)
            if (stat == status_ok) call self%renew(chart, t, self%q, self%qd, self%rate(:, 2), ha, stat)
            if (stat == status_ok) call self%iterate(chart, stage, t, ha, stat)
            ! D at a point far from the chart's origin is different. With such a matrix, corrections elsewhere may all be small
            ! although the iteration has not converged.
            self%is_outdated = .true.
        end do
    end subroutine solve

    !> Correct the stage until it has converged. A single correction suffices if the contraction observed last for this stage is
    !> good enough. The contraction is observed again after some steps, or if the first correction has grown.
    subroutine iterate(self, chart, stage, t, ha, stat)
        class(newton_type), intent(inout) :: self
        class(implicit_chart_type), intent(inout) :: chart
        integer, intent(in) :: stage
        real(wp), intent(in) :: t, ha
        integer, intent(out) :: stat
        !> Limit beyond which a new matrix is cheaper.
        integer, parameter :: most_corrections = 12
        !> Largest age of an observed contraction; largest growth of the first correction since the observation; safety factor of
        !> the contraction; fraction of a previous, worse contraction that is retained.
        integer, parameter :: max_age = 20
        real(wp), parameter :: largest_growth = 2.0_wp, safety = 8.0_wp, kept = 0.5_wp
        !> Size of rounding errors; size below any tolerance; smallest correction that is distinct from zero.
        real(wp), parameter :: rounding = 20*epsilon(1.0_wp), vanishing = 2*epsilon(1.0_wp), least = 0.1_wp*epsilon(1.0_wp)
        !> Fraction of the tolerance below which corrections are negligible.
        real(wp), parameter :: negligible = 0.1_wp
        !> Largest contraction for which a matrix of an earlier step is kept, and number of further corrections allowed beyond it.
        real(wp), parameter :: slowest = 0.2_wp
        !> Contraction that indicates corrections of the size of rounding errors.
        real(wp), parameter :: stagnating = 0.7_wp
        integer, parameter :: most_more = 4
        real(wp) :: change, first_change, last_change, observed, theta
        logical :: is_significant, suffices
        integer :: k

        self%age(stage) = self%age(stage) + 1
        first_change = 0.0_wp
        last_change = 1.0_wp
        do k = 1, most_corrections
            call self%correct(chart, stage, k == 1, t, ha, change, stat)
            if (stat /= status_ok) return
            if (k == 1) then
                first_change = change
                ! The contraction factor of a matrix grows with its age.
                theta = safety*(1 + self%n_steps_used)*max(self%theta(stage)/(1 + self%observed_age(stage)), &
                    maxval(self%significant_theta/(1 + self%observed_age)))
                ! If a correction is far below the tolerance, its growth is not significant: it is due to errors of other stages.
                suffices = theta*change <= self%tolerance(stage)
                if (suffices .and. self%age(stage) < max_age .and. &
                    change <= max(largest_growth*self%observed_change(stage), negligible*self%tolerance(stage))) return
                ! The second correction is made only to observe the contraction, so do not count it against the matrix.
                if (suffices) self%counted = self%counted + 1
            else
                theta = change/last_change
                if (k == 2) then
                    ! The ratio of two corrections is not significant if they are of the size of rounding errors or of the errors of
                    ! other stages. A second correction of the size of rounding errors still bounds the contraction, which is never
                    ! zero. Errors of several coordinates contract at different rates; the worst is retained.
                    observed = max(change, least)/last_change
                    if (self%theta(stage) < 1.0_wp) observed = max(observed, kept*self%theta(stage))
                    is_significant = change > vanishing .and. first_change > max(rounding, negligible*self%tolerance(stage))
                    if (is_significant .or. &
                        observed < self%theta(stage)*(1 + self%n_steps_used)/(1 + self%observed_age(stage))) then
                        self%theta(stage) = observed
                        self%significant_theta(stage) = merge(observed, 0.0_wp, is_significant)
                        self%observed_age(stage) = self%n_steps_used
                    end if
                    self%observed_change(stage) = max(first_change, rounding)
                    self%age(stage) = 0
                end if
                if (change <= 0.01_wp*self%tolerance(stage)) return
                ! With large stiff forces, rounding errors stop the decrease of the corrections long after convergence.
                if (change <= self%rounding_limit .and. .not. theta < merge(0.95_wp, stagnating, k == 2)) return
                if (.not. theta < 0.95_wp) exit
                ! Abandon a matrix of an earlier step that would need many more corrections.
                if (.not. self%is_fresh .and. theta > slowest .and. theta**most_more*change > self%tolerance(stage)) exit
                if (theta/(1.0_wp - theta)*change <= self%tolerance(stage)) return
            end if
            last_change = max(change, tiny(1.0_wp))
        end do
        self%theta(stage) = 1.0_wp
        stat = status_newton_failed
    end subroutine iterate

    !> Perform one correction of a stage.
    subroutine correct(self, chart, stage, is_first, t, ha, change, stat)
        class(newton_type), intent(inout) :: self
        class(implicit_chart_type), intent(inout) :: chart
        integer, intent(in) :: stage
        !> True if `q` contains predicted coordinates, false if it contains the last iterate.
        logical, intent(in) :: is_first
        real(wp), intent(in) :: t, ha
        !> Size of the correction, see `update` of the chart.
        real(wp), intent(out) :: change
        integer, intent(out) :: stat

        change = 0.0_wp
        if (size(self%residual) < chart%n_residual) self%residual = spread(0.0_wp, 1, chart%n_residual)
        associate (residual => self%residual(:chart%n_residual))
            self%increment = self%base + ha*self%rate
            call chart%find_residual(self%goal(stage, is_first, ha), t, self%increment, self%q, self%qd, self%rate, residual, stat)
            if (stat /= status_ok) return
            call chart%solve(residual)
            call chart%update(stage, self%q, self%qd, ha, residual, self%rate, change, stat)
        end associate
    end subroutine correct

    !> Goal that describes an iterate to the chart.
    pure type(goal_type) function goal(self, stage, is_first, ha)
        class(newton_type), intent(in) :: self
        integer, intent(in) :: stage
        logical, intent(in) :: is_first
        !> h a_ii; used if the error factor of the stage is known.
        real(wp), intent(in) :: ha

        goal%is_iterate = .true.
        goal%is_first = is_first
        goal%stage = stage
        goal%tolerance = self%step_tolerance
        if (stage <= size(self%defect)) goal%defect = ha**2*self%defect(stage)
    end function goal

    !> Position and velocity of the stage from its rates.
    subroutine restore(self, chart, t, ha, stat)
        class(newton_type), intent(inout) :: self
        class(implicit_chart_type), intent(inout) :: chart
        real(wp), intent(in) :: t, ha
        integer, intent(out) :: stat

        self%increment = self%base + ha*self%rate
        call chart%restore(t, self%increment(:, 1), self%increment(:, 2), step_end, self%q, self%qd, stat)
    end subroutine restore

    !> Complete the state at the end of a stiffly accurate step, whose last stage has been solved last.
    subroutine finish(self, chart, ha, next, stat)
        class(newton_type), intent(inout) :: self
        class(implicit_chart_type), intent(inout) :: chart
        real(wp), intent(in) :: ha
        !> The state at next%t.
        type(state_type), intent(inout) :: next
        integer, intent(out) :: stat
        !> Growth of the expected lifetime with each matrix that does not fail.
        real(wp), parameter :: longer = 1.1_wp
        real(wp) :: taken

        call self%restore(chart, next%t, ha, stat)
        if (stat /= status_ok) return
        next%dq = self%increment(:, 1)
        next%dqd = self%increment(:, 2)
        next%q = self%q
        next%qd = self%qd
        call chart%accelerate(next%t, next%q, next%qd, step_end, next%qdd, stat)
        taken = real(chart%counts%newton_corrections - self%counted, wp)
        self%n_steps_used = self%n_steps_used + 1
        self%spent = self%spent + taken
        self%is_outdated = self%is_outdated .or. taken*self%n_steps_used > self%spent
        if (self%n_steps_used >= self%lifetime) then
            self%is_outdated = .true.
            self%lifetime = longer*self%lifetime
        end if
    end subroutine finish

    !> Pack the contractions of the stages, and the age and cost of the matrix.
    subroutine pack_state(self, pack)
        class(newton_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%theta)
        call pack%item(self%significant_theta)
        call pack%item(self%observed_change)
        call pack%item(self%age, self%observed_age)
        call pack%item(self%n_steps_used)
        call pack%item(self%counted)
        call pack%item(self%spent, self%error_of_steps)
        call pack%item(self%is_fresh, self%is_ahead, self%is_outdated)
        call pack%item(self%lifetime)
        call self%prediction%pack_state(pack)
    end subroutine pack_state
end module tandem_stepper_newton
