! SPDX-License-Identifier: MIT
!> The stability study: runs of every case with every stepper, with fixed steps and with error control. Each run is a row with a
!> verdict.
!>
!> Missing rows are computed in order, so that an interrupted study can be continued.
module tandem_io_study_stability
    use tandem, only: change_stepper, error_type, long, new_stepper, options_type, properties_type, stepper_choices, to_text, wp
    use tandem_io_study_cases, only: build_case, case_groups, case_name_length, case_names, case_type
    use tandem_io_study_journal, only: journal_type
    use tandem_io_study_table, only: brief, cell_length, column_type, count_column, real_column, text_column
    use tandem_io_study_trial, only: degraded, failed, find_truth, held, refused, run_trial, trial_type, truth_type, wrong
    use tandem_stepper, only: stepper_type
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)
    private

    public :: stability_type, stability_columns, select_cases

    !> Columns of the table.
    type(column_type), parameter :: stability_columns(30) = [ &
        column_type('case', 'case', text_column, '', 'name of the case'), &
        column_type('group', '', text_column, '', 'kind of case'), &
        column_type('stepper', 'stepper', text_column, '', 'name of the stepper'), &
        column_type('control', 'by', text_column, '', 'step: fixed steps; rtol: steps by an error estimate, atol = rtol'), &
        column_type('value', 'h|rtol', real_column, '', 'the step in s, or rtol'), &
        column_type('verdict', 'verdict', text_column, '', &
            'held; degraded: off by more than allowed, with a warning; refused; failed; wrong: off, without a warning'), &
        column_type('status', 'status', text_column, '', 'complete, or the status of the failure'), &
        column_type('error', 'error', real_column, '1', &
            'largest error of q and qd over the sample times, on the scale s + |y|; of a million steps, the energy change'), &
        column_type('allowed', 'allowed', real_column, '1', 'largest error without a warning'), &
        column_type('reported', 'rep.', real_column, '1', 'error reported by the run, from a second run'), &
        column_type('warnings', '', count_column, '1', 'warnings shown to the user'), &
        column_type('local_error_sum', '', real_column, '1', 'sum of the local errors reported by the run'), &
        column_type('wall_seconds', 'wall s', real_column, 's', 'run time by the clock'), &
        column_type('cpu_seconds', '', real_column, 's', 'run time of the processor'), &
        column_type('steps', 'steps', count_column, '1', 'accepted steps'), &
        column_type('rejected', 'rej.', count_column, '1', 'steps rejected for their error'), &
        column_type('failed', 'fail.', count_column, '1', 'steps that could not be completed'), &
        column_type('right_hand_sides', 'r.h.s.', count_column, '1', 'evaluations of the equations of motion'), &
        column_type('newton_matrices', '', count_column, '1', 'Newton matrices of implicit stages'), &
        column_type('newton_corrections', '', count_column, '1', 'corrections of implicit stages'), &
        column_type('charts', '', count_column, '1', 'charts'), &
        column_type('position_error', '', real_column, '1', 'largest position error over all steps, on natural scales'), &
        column_type('velocity_error', '', real_column, '1', 'largest velocity error over all steps, on natural scales'), &
        column_type('acceleration_error', '', real_column, '1', &
            'largest acceleration error over all steps, on natural scales'), &
        column_type('energy_change', '', real_column, '1', &
            'largest change of kinetic and potential energy over the sample times, of their sum at the start'), &
        column_type('constraint_growth', '', real_column, '1', &
            'a million steps: constraint errors in the last tenth over those in the first, errors below 2e-14 taken as that'), &
        column_type('memory_growth', '', real_column, '1', 'a million steps: pages of memory gained after the first tenth'), &
        column_type('agreement', '', real_column, '1', 'difference of the two solutions used as reference'), &
        column_type('reference', '', text_column, '', 'reference of the error'), &
        column_type('remark', '', text_column, '', 'warnings, or how it failed')]

    type :: stability_type
        !> Rows computed so far.
        type(journal_type) :: journal
        !> Names of the requested cases.
        character(len=case_name_length), allocatable :: cases(:)
        type(case_type), private :: subject
        type(truth_type), private :: truth
        integer, private :: current = 0
        logical, private :: has_truth = .false.
    contains
        procedure :: next_row, total, row_of, count_of
        procedure, private :: measure, compare_units
    end type stability_type

contains

    !> Select cases by names of cases or groups; all cases if there are no names. `cases` is not allocated if a name is unknown,
    !> which is returned in `unknown`.
    subroutine select_cases(names, cases, unknown)
        character(len=*), intent(in) :: names(:)
        character(len=case_name_length), allocatable, intent(out) :: cases(:)
        character(len=:), allocatable, intent(out) :: unknown
        logical :: wanted(size(case_names))
        integer :: i

        wanted = size(names) == 0
        do i = 1, size(names)
            if (.not. (any(case_names == names(i)) .or. any(case_groups == names(i)))) then
                unknown = trim(names(i))
                return
            end if
            wanted = wanted .or. case_names == names(i) .or. case_groups == names(i)
        end do
        cases = pack(case_names, wanted)
    end subroutine select_cases

    !> True if a case has a run with a stepper and a kind of step control.
    logical function has_run(subject, name, control)
        type(case_type), intent(in) :: subject
        character(len=*), intent(in) :: name, control
        class(stepper_type), allocatable :: stepper
        type(properties_type) :: properties

        call new_stepper(name, stepper)
        properties = stepper%properties()
        has_run = subject%with_step .and. properties%has_fixed_steps()
        if (control == 'step') return
        has_run = subject%with_rtol .and. properties%estimate_order > 0
    end function has_run

    !> Compute the next missing row and append it; `finished` if there is none.
    subroutine next_row(self, finished, error)
        class(stability_type), intent(inout) :: self
        logical, intent(out) :: finished
        type(error_type), allocatable, intent(out) :: error
        character(len=4), parameter :: controls(2) = ['step', 'rtol']
        integer :: i, k

        finished = .false.
        do
            if (self%current > 0) then
                do i = 1, size(stepper_choices)
                    do k = 1, size(controls)
                        if (.not. has_run(self%subject, trim(stepper_choices(i)), controls(k))) cycle
                        if (self%row_of(self%subject%name, trim(stepper_choices(i)), controls(k)) > 0) cycle
                        call self%measure(trim(stepper_choices(i)), controls(k), error)
                        return
                    end do
                end do
            end if
            self%current = self%current + 1
            self%has_truth = .false.
            finished = self%current > size(self%cases)
            if (finished) return
            call build_case(trim(self%cases(self%current)), self%subject, error)
            if (allocated(error)) return
        end do
    end subroutine next_row

    !> Total number of rows.
    integer function total(self)
        class(stability_type), intent(in) :: self
        type(case_type) :: subject
        type(error_type), allocatable :: error
        integer :: i, j

        total = 0
        do i = 1, size(self%cases)
            call build_case(trim(self%cases(i)), subject, error)
            if (allocated(error)) return
            do j = 1, size(stepper_choices)
                total = total + count([has_run(subject, trim(stepper_choices(j)), 'step'), &
                    has_run(subject, trim(stepper_choices(j)), 'rtol')])
            end do
        end do
    end function total

    !> Index of the row of a run; 0 if it is missing.
    pure integer function row_of(self, subject, stepper, control)
        class(stability_type), intent(in) :: self
        character(len=*), intent(in) :: subject, stepper, control

        associate (table => self%journal%table)
            do row_of = table%rows(), 1, -1
                if (table%text_at(row_of, 'case') == subject .and. table%text_at(row_of, 'stepper') == stepper .and. &
                    table%text_at(row_of, 'control') == control) return
            end do
        end associate
    end function row_of

    !> Number of rows of the requested cases with a given verdict.
    pure integer function count_of(self, verdict)
        class(stability_type), intent(in) :: self
        character(len=*), intent(in) :: verdict
        integer :: row

        count_of = 0
        do row = 1, self%journal%table%rows()
            if (.not. any(self%cases == self%journal%table%text_at(row, 'case'))) cycle
            if (self%journal%table%text_at(row, 'verdict') == verdict) count_of = count_of + 1
        end do
    end function count_of

    !> Carry out a run and append its row.
    subroutine measure(self, stepper, control, error)
        class(stability_type), intent(inout) :: self
        character(len=*), intent(in) :: stepper, control
        type(error_type), allocatable, intent(out) :: error
        character(len=cell_length) :: cells(size(stability_columns))
        type(options_type) :: options
        type(trial_type) :: trial

        if (.not. self%has_truth) then
            call find_truth(self%subject, self%truth, error)
            if (allocated(error)) return
            self%has_truth = .true.
        end if
        options = self%subject%options
        if (control == 'rtol') then
            call change_stepper(options, stepper, rtol=self%subject%rtol)
        else
            call change_stepper(options, stepper, step=options%step)
        end if
        options%max_seconds = self%subject%most_seconds
        call run_trial(self%subject, self%truth, options, trial)
        if (allocated(self%subject%units) .and. allocated(trial%q)) call self%compare_units(options, trial, error)
        if (allocated(error)) return
        associate (table => self%journal%table, s => trial%statistics)
            cells = table%new_row()
            call table%put(cells, 'case', self%subject%name)
            call table%put(cells, 'group', trim(self%subject%group))
            call table%put(cells, 'stepper', stepper)
            call table%put(cells, 'control', control)
            call table%put(cells, 'value', merge(options%rtol, options%step, control == 'rtol'))
            call table%put(cells, 'verdict', trim(trial%verdict))
            call table%put(cells, 'status', trim(trial%status))
            call table%put(cells, 'error', trial%error)
            call table%put(cells, 'allowed', trial%allowed)
            call table%put(cells, 'reported', trial%reported)
            call table%put(cells, 'warnings', int(trial%warnings, long))
            call table%put(cells, 'local_error_sum', s%local_error_sum)
            call table%put(cells, 'wall_seconds', s%wall_seconds)
            call table%put(cells, 'cpu_seconds', s%cpu_seconds)
            call table%put(cells, 'steps', s%steps)
            call table%put(cells, 'rejected', s%rejected)
            call table%put(cells, 'failed', s%failed)
            call table%put(cells, 'right_hand_sides', s%right_hand_sides)
            call table%put(cells, 'newton_matrices', s%newton_matrices)
            call table%put(cells, 'newton_corrections', s%newton_corrections)
            call table%put(cells, 'charts', s%charts)
            call table%put(cells, 'position_error', s%position_error)
            call table%put(cells, 'velocity_error', s%velocity_error)
            call table%put(cells, 'acceleration_error', s%acceleration_error)
            call table%put(cells, 'energy_change', trial%energy_change)
            call table%put(cells, 'constraint_growth', trial%growth)
            call table%put(cells, 'memory_growth', trial%pages)
            call table%put(cells, 'agreement', self%truth%agreement)
            call table%put(cells, 'reference', self%truth%origin)
            call table%put(cells, 'remark', trial%remark)
        end associate
        call self%journal%append(cells, error)
    end subroutine measure

    !> Compare a case with the same case in metres. Except for rounding and its amplification, both runs must have equal steps and
    !> equal motions.
    subroutine compare_units(self, options, trial, error)
        class(stability_type), intent(inout) :: self
        type(options_type), intent(in) :: options
        type(trial_type), intent(inout) :: trial
        type(error_type), allocatable, intent(out) :: error
        !> Largest difference of the motions: 1e-10, or ten times the effect of rounding on the two references if the motion
        !> amplifies rounding. With error control, rounding also changes the steps: the error estimate of a first, careful step is
        !> 1e-13, rounding is a hundredth of it, and the end of a step changes the error by this fraction.
        real(wp), parameter :: most = 1.0e-10_wp, times = 10.0_wp, part = 0.02_wp
        type(case_type), target :: twin
        type(trial_type) :: in_metres
        type(truth_type) :: truth
        real(wp) :: difference, allowed
        integer :: k

        call build_case(self%subject%name, twin, error, in_metres=.true.)
        if (allocated(error)) return
        truth%t = self%truth%t
        truth%q = self%truth%q
        truth%qd = self%truth%qd
        do k = 1, size(truth%t)
            truth%q(:, k) = truth%q(:, k)/self%subject%units
            truth%qd(:, k) = truth%qd(:, k)/self%subject%units
        end do
        call run_trial(twin, truth, options, in_metres)
        if (.not. allocated(in_metres%q)) then
            trial%verdict = wrong
            trial%remark = 'in metres the run has failed: '//in_metres%remark
            return
        end if
        difference = 0.0_wp
        do k = 1, size(truth%t)
            difference = max(difference, maxval(abs(trial%q(:, k)/self%subject%units - in_metres%q(:, k))), &
                maxval(abs(trial%qd(:, k)/self%subject%units - in_metres%qd(:, k))))
        end do
        allowed = max(most, times*self%truth%agreement)
        if (options%is_adaptive()) allowed = max(allowed, part*in_metres%error)
        associate (s => trial%statistics, m => in_metres%statistics)
            if (s%steps == m%steps .and. s%rejected == m%rejected .and. s%failed == m%failed .and. difference <= allowed) return
            trial%verdict = wrong
            trial%remark = 'in metres '//to_text(int(m%steps))//' steps, '//to_text(int(m%rejected))//' rejected, '// &
                to_text(int(m%failed))//' failed; the motions differ by '//brief(difference)
        end associate
    end subroutine compare_units
end module tandem_io_study_stability
