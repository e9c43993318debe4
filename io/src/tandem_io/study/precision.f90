! SPDX-License-Identifier: MIT
!> The precision study: error against run time for every stepper, over step sizes and tolerances. Each series of runs begins with
!> the coarsest useful one and ends when the budget is exhausted. Each run is a row.
!>
!> A series consists of runs of one stepper, either with fixed steps h = H 2**k, where H is the step of the scene, or with
!> tolerances rtol = 10**k. The next run of a series follows from the existing rows, so that an interrupted study can be continued.
module tandem_io_study_precision
    use tandem, only: change_stepper, default_step, error_type, long, n_derivatives, new_stepper, options_type, properties_type, &
        statistics_type, stepper_choices, wp
    use tandem_io_scene, only: scene_type
    use tandem_io_study_journal, only: journal_type
    use tandem_io_study_measure, only: motion_of, outcome_type, over_budget, sample_run, time_run
    use tandem_io_study_reference, only: reference_type
    use tandem_io_study_table, only: cell_length, column_type, count_column, real_column, text_column
    use tandem_stepper, only: stepper_type
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite, ieee_quiet_nan, ieee_value
    implicit none (type, external)
    private

    public :: precision_type, precision_columns, by_step, by_rtol

    !> Parameter varied by a series.
    character(len=4), parameter :: by_step = 'step', by_rtol = 'rtol'
    !> Exponents of ten of the largest and the smallest tolerance; exponent of two of the smallest step relative to the step of the
    !> scene.
    integer, parameter :: loosest = -2, tightest = -14, finest = -24
    !> Number of consecutive failures that end a series. A single failure does not, because a finer run may succeed.
    integer, parameter :: most_failures = 4
    !> Errors are reported down to this multiple of the agreement of a reference; they are then accurate to ten per cent.
    real(wp), parameter :: floor_factor = 10.0_wp

    !> Columns of the table.
    type(column_type), parameter :: precision_columns(26) = [ &
        column_type('scene', '', text_column, '', 'name of the scene'), &
        column_type('stepper', 'stepper', text_column, '', 'name of the stepper'), &
        column_type('control', 'by', text_column, '', 'step: fixed steps; rtol: steps by an error estimate, atol = rtol'), &
        column_type('value', 'h|rtol', real_column, '', 'the step in s, or rtol'), &
        column_type('error_q', 'error q', real_column, '1', &
            'largest difference of a coordinate from the reference over the sample times, in coordinate scales'), &
        column_type('error_qd', 'error qd', real_column, '1', &
            'largest difference of a velocity from the reference over the sample times, in coordinate scales a second'), &
        column_type('at_floor', '', count_column, '1', '1 if error_q is below the accuracy of the reference'), &
        column_type('order', 'order', real_column, '1', &
            'log of the ratio of error_q to that of the row before, over log of the ratio of steps'), &
        column_type('wall_seconds', 'wall s', real_column, 's', 'run time by the clock, median'), &
        column_type('cpu_seconds', 'CPU s', real_column, 's', 'run time of the processor, median'), &
        column_type('repeats', '', count_column, '1', 'runs that were timed'), &
        column_type('steps', 'steps', count_column, '1', 'accepted steps'), &
        column_type('rejected', 'rej.', count_column, '1', 'steps rejected for their error'), &
        column_type('failed', '', count_column, '1', 'steps that could not be completed'), &
        column_type('right_hand_sides', 'r.h.s.', count_column, '1', &
            'points at which the equations of motion were evaluated, those of Newton corrections included'), &
        column_type('newton_matrices', '', count_column, '1', 'Newton matrices of implicit stages, formed and factored'), &
        column_type('derivatives', '', count_column, '1', 'evaluations of derivatives of the model, all kinds'), &
        column_type('newton_corrections', 'corr.', count_column, '1', 'corrections of implicit stages'), &
        column_type('charts', 'charts', count_column, '1', 'charts'), &
        column_type('position_error', '', real_column, '1', 'largest position error over all steps, on natural scales'), &
        column_type('velocity_error', '', real_column, '1', 'largest velocity error over all steps, on natural scales'), &
        column_type('acceleration_error', '', real_column, '1', &
            'largest acceleration error over all steps, on natural scales'), &
        column_type('energy_change', 'energy', real_column, '1', &
            'largest change of kinetic and potential energy over the sample times, of their sum at the start'), &
        column_type('smallest_step', '', real_column, 's', 'smallest accepted step'), &
        column_type('largest_step', '', real_column, 's', 'largest accepted step'), &
        column_type('status', 'status', text_column, '', 'complete, the status of the failure, or over_budget')]

    !> A stepper and its varied parameter.
    type :: series_type
        character(len=16) :: stepper = ''
        character(len=4) :: control = by_step
    end type series_type

    type :: precision_type
        !> Reference for the errors of the runs.
        type(reference_type) :: reference
        !> Rows computed so far.
        type(journal_type) :: journal
        !> Time limit of all runs of a row, seconds; smallest number of timed runs.
        real(wp) :: budget = 5.0_wp
        integer :: repeats = 3
        type(series_type), allocatable, private :: series(:)
        integer, private :: current = 1
        type(scene_type), pointer, private :: scene => null()
        real(wp), private :: t_end = 0.0_wp, useful = 0.0_wp
    contains
        procedure :: start, next_row, floor_q, cheapest
        procedure, private :: plan, rows_of, choose_first, measure, options_of, coarsest
    end type precision_type

contains

    !> Prepare the study of a scene. The reference and the journal must be set.
    subroutine start(self, scene, steppers)
        class(precision_type), intent(inout) :: self
        !> Must outlive the study.
        type(scene_type), intent(inout), target :: scene
        !> Names of the steppers.
        character(len=*), intent(in) :: steppers(:)
        class(stepper_type), allocatable :: stepper
        type(properties_type) :: properties
        integer :: i

        self%scene => scene
        self%current = 1
        self%t_end = scene%t_end
        if (self%reference%t(size(self%reference%t)) < scene%t_end) self%t_end = self%reference%t(size(self%reference%t))
        self%useful = 0.1_wp*motion_of(scene, self%reference)
        if (allocated(self%series)) deallocate (self%series)
        allocate (self%series(0))
        do i = 1, size(stepper_choices)
            if (.not. any(steppers == stepper_choices(i))) cycle
            call new_stepper(stepper_choices(i), stepper)
            properties = stepper%properties()
            if (properties%has_fixed_steps()) self%series = [self%series, series_type(stepper_choices(i), by_step)]
            if (properties%estimate_order > 0) self%series = [self%series, series_type(stepper_choices(i), by_rtol)]
        end do
    end subroutine start

    !> Measure the next run and append its row; `finished` if there is none.
    subroutine next_row(self, finished, error)
        class(precision_type), intent(inout) :: self
        logical, intent(out) :: finished
        !> Set if the row could not be written.
        type(error_type), allocatable, intent(out) :: error
        integer :: level
        logical :: ended

        do
            finished = self%current > size(self%series)
            if (finished) return
            call self%plan(self%series(self%current), level, ended)
            if (.not. ended) exit
            self%current = self%current + 1
        end do
        call self%measure(self%series(self%current), level, error)
    end subroutine next_row

    !> Smallest error in q that can be distinguished from the error of the reference; 0 if the latter is unknown.
    pure real(wp) function floor_q(self)
        class(precision_type), intent(in) :: self

        floor_q = floor_factor*max(0.0_wp, self%reference%agreement_q)
    end function floor_q

    !> Index of the fastest complete run whose error in q is at most `error_q`; 0 if there is none. Processor times are compared,
    !> because other programs affect them least.
    pure integer function cheapest(self, error_q)
        class(precision_type), intent(in) :: self
        real(wp), intent(in) :: error_q
        real(wp) :: least
        integer :: row

        cheapest = 0
        least = huge(1.0_wp)
        associate (table => self%journal%table)
            do row = 1, table%rows()
                if (table%text_at(row, 'status') /= 'complete') cycle
                if (.not. table%real_at(row, 'error_q') <= error_q) cycle
                if (.not. table%real_at(row, 'cpu_seconds') < least) cycle
                least = table%real_at(row, 'cpu_seconds')
                cheapest = row
            end do
        end associate
    end function cheapest

    !> Select the next level of a series, unless the series has ended.
    subroutine plan(self, series, level, ended)
        class(precision_type), intent(inout) :: self
        type(series_type), intent(in) :: series
        !> Exponent of two or ten.
        integer, intent(out) :: level
        logical, intent(out) :: ended
        integer, allocatable :: rows(:)
        integer :: k, n_failed
        real(wp) :: growth, before, last

        associate (table => self%journal%table)
            allocate (rows, source=self%rows_of(series))
            k = size(rows)
            ended = .false.
            if (k == 0) then
                call self%choose_first(series, level)
                return
            end if
            level = level_of(self, series, table%real_at(rows(k), 'value')) - 1
            ended = level < merge(finest, tightest, series%control == by_step)
            do n_failed = 0, k - 1
                if (table%text_at(rows(k - n_failed), 'status') == 'complete') exit
            end do
            if (n_failed > 0) then
                ended = ended .or. n_failed >= most_failures .or. table%text_at(rows(k), 'status') == over_budget
                return
            end if
            last = table%real_at(rows(k), 'error_q')
            ended = ended .or. last <= self%floor_q()
            growth = 2.0_wp
            if (k > 1) then
                before = table%real_at(rows(k - 1), 'wall_seconds')
                if (ieee_is_finite(before)) growth = min(4.0_wp, max(growth, table%real_at(rows(k), 'wall_seconds')/before))
            end if
            ended = ended .or. growth*(self%repeats + 1)*table%real_at(rows(k), 'wall_seconds') > self%budget
            ! Rounding dominates: two consecutive rows have not reduced the error, which is far below the motion.
            if (k > 2 .and. last < 1.0e-5_wp*self%useful) ended = ended .or. &
                min(last, table%real_at(rows(k - 1), 'error_q')) > 0.8_wp*table%real_at(rows(k - 2), 'error_q')
        end associate
    end subroutine plan

    !> Indices of the rows of a series, in order.
    function rows_of(self, series) result(rows)
        class(precision_type), intent(in) :: self
        type(series_type), intent(in) :: series
        integer, allocatable :: rows(:)
        integer :: row

        allocate (rows(0))
        associate (table => self%journal%table)
            do row = 1, table%rows()
                if (table%text_at(row, 'stepper') /= series%stepper .or. table%text_at(row, 'control') /= series%control) cycle
                rows = [rows, row]
            end do
        end associate
    end function rows_of

    !> Select the first level of a series: the level before the first one, from the coarsest on, whose result is useful.
    subroutine choose_first(self, series, level)
        class(precision_type), intent(inout) :: self
        type(series_type), intent(in) :: series
        integer, intent(out) :: level
        type(outcome_type) :: outcome
        integer :: last

        level = self%coarsest(series)
        last = merge(finest, tightest, series%control == by_step)
        do
            call sample_run(self%scene, self%options_of(series, level), self%t_end, self%reference, self%budget, outcome)
            if (outcome%is_complete() .and. outcome%error_q <= self%useful) exit
            if (outcome%status == over_budget .or. level <= last) return
            level = level - 1
        end do
        level = min(level + 1, self%coarsest(series))
    end subroutine choose_first

    !> Measure a run and append its row.
    subroutine measure(self, series, level, error)
        class(precision_type), intent(inout) :: self
        type(series_type), intent(in) :: series
        integer, intent(in) :: level
        type(error_type), allocatable, intent(out) :: error
        character(len=cell_length) :: cells(size(precision_columns))
        type(outcome_type) :: outcome
        type(options_type) :: options
        integer, allocatable :: rows(:)

        options = self%options_of(series, level)
        allocate (rows, source=self%rows_of(series))
        call sample_run(self%scene, options, self%t_end, self%reference, self%budget, outcome)
        if (outcome%is_complete()) call time_run(self%scene, options, self%t_end, self%repeats, outcome)
        associate (table => self%journal%table, s => outcome%statistics)
            cells = table%new_row()
            call table%put(cells, 'scene', self%scene%name)
            call table%put(cells, 'stepper', trim(series%stepper))
            call table%put(cells, 'control', series%control)
            call table%put(cells, 'value', value_of(self, series, level))
            call table%put(cells, 'status', trim(outcome%status))
            call table%put(cells, 'error_q', outcome%error_q)
            call table%put(cells, 'error_qd', outcome%error_qd)
            call table%put(cells, 'at_floor', merge(1_long, 0_long, outcome%error_q <= self%floor_q()))
            if (size(rows) > 0) call table%put(cells, 'order', observed_order(self, rows(size(rows)), series, level, outcome))
            call table%put(cells, 'wall_seconds', outcome%wall_seconds)
            call table%put(cells, 'cpu_seconds', outcome%cpu_seconds)
            call table%put(cells, 'repeats', int(outcome%repeats, long))
            call put_statistics(self, cells, s)
            call table%put(cells, 'energy_change', outcome%energy_change)
        end associate
        call self%journal%append(cells, error)
    end subroutine measure

    !> Set the counters of a row.
    subroutine put_statistics(self, cells, s)
        class(precision_type), intent(in) :: self
        character(len=*), intent(inout) :: cells(:)
        type(statistics_type), intent(in) :: s

        associate (table => self%journal%table)
            call table%put(cells, 'steps', s%steps)
            call table%put(cells, 'rejected', s%rejected)
            call table%put(cells, 'failed', s%failed)
            call table%put(cells, 'right_hand_sides', s%right_hand_sides)
            call table%put(cells, 'newton_matrices', s%newton_matrices)
            call table%put(cells, 'derivatives', sum(s%derivatives(:n_derivatives)))
            call table%put(cells, 'newton_corrections', s%newton_corrections)
            call table%put(cells, 'charts', s%charts)
            call table%put(cells, 'position_error', s%position_error)
            call table%put(cells, 'velocity_error', s%velocity_error)
            call table%put(cells, 'acceleration_error', s%acceleration_error)
            call table%put(cells, 'smallest_step', min(s%smallest_step, s%largest_step))
            call table%put(cells, 'largest_step', s%largest_step)
        end associate
    end subroutine put_statistics

    !> Observed order of a run relative to the previous row; NaN if one of the runs failed or errors are unknown.
    real(wp) function observed_order(self, row, series, level, outcome)
        class(precision_type), intent(in) :: self
        integer, intent(in) :: row, level
        type(series_type), intent(in) :: series
        type(outcome_type), intent(in) :: outcome
        real(wp) :: refinement, before

        observed_order = ieee_value(1.0_wp, ieee_quiet_nan)
        associate (table => self%journal%table)
            before = table%real_at(row, 'error_q')
            if (table%text_at(row, 'status') /= 'complete' .or. .not. outcome%is_complete()) return
            if (outcome%error_q <= self%floor_q() .or. .not. before > 0.0_wp) return
            if (series%control == by_step) then
                refinement = table%real_at(row, 'value')/value_of(self, series, level)
            else
                refinement = real(outcome%statistics%steps, wp)/real(table%count_at(row, 'steps'), wp)
            end if
            ! The steps are too similar to determine an order.
            if (refinement >= 1.1_wp .and. outcome%error_q > 0.0_wp) observed_order = log(before/outcome%error_q)/log(refinement)
        end associate
    end function observed_order

    !> Options of a run.
    function options_of(self, series, level) result(options)
        class(precision_type), intent(in) :: self
        type(series_type), intent(in) :: series
        integer, intent(in) :: level
        type(options_type) :: options

        options = self%scene%options
        if (series%control == by_step) then
            call change_stepper(options, series%stepper, step=value_of(self, series, level))
        else
            call change_stepper(options, series%stepper, rtol=value_of(self, series, level))
        end if
    end function options_of

    !> Coarsest level of a series.
    integer function coarsest(self, series)
        class(precision_type), intent(in) :: self
        type(series_type), intent(in) :: series
        real(wp), parameter :: fewest_steps = 10.0_wp

        coarsest = loosest
        if (series%control /= by_step) return
        coarsest = floor(log((self%t_end - self%scene%t_start)/fewest_steps/step_of(self%scene%options))/log(2.0_wp))
    end function coarsest

    !> Step or tolerance of a level.
    real(wp) function value_of(self, series, level)
        class(precision_type), intent(in) :: self
        type(series_type), intent(in) :: series
        integer, intent(in) :: level

        if (series%control == by_step) then
            value_of = step_of(self%scene%options)*2.0_wp**level
        else
            value_of = 1.0_wp/10.0_wp**(-level)
        end if
    end function value_of

    !> Level of a step or a tolerance.
    integer function level_of(self, series, value)
        class(precision_type), intent(in) :: self
        type(series_type), intent(in) :: series
        real(wp), intent(in) :: value

        if (series%control == by_step) then
            level_of = nint(log(value/step_of(self%scene%options))/log(2.0_wp))
        else
            level_of = nint(log10(value))
        end if
    end function level_of

    !> Fixed step of level 0.
    pure real(wp) function step_of(options)
        type(options_type), intent(in) :: options

        step_of = merge(options%step, default_step, options%step > 0.0_wp)
    end function step_of
end module tandem_io_study_precision
