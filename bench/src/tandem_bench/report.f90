! SPDX-License-Identifier: MIT
!> Tables of the measurements: one row per run, and one row per solver. Files are those of a study (`journal_type`): CSV, HDF5.
module tandem_bench_report
    use tandem, only: error_type, to_text, wp
    use tandem_bench_measure, only: point_type, series_type, time_to_error
    use tandem_bench_solver, only: problem_type, solver_holder_type
    use tandem_bench_solvers, only: by_hand, yardstick
    use tandem_io, only: column_type, journal_type
    use tandem_io_study_measure, only: median
    use tandem_io_study_table, only: cell_length, count_column, real_column, text_column
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite, ieee_quiet_nan, ieee_value
    use, intrinsic :: iso_fortran_env, only: compiler_options, compiler_version
    implicit none (type, external)
    private

    public :: report_type

    character(len=*), parameter :: newline = new_line('a')
    !> Errors with tabulated times; range of tolerances for the time of an evaluation.
    real(wp), parameter :: errors(4) = [1.0e-4_wp, 1.0e-6_wp, 1.0e-8_wp, 1.0e-10_wp]
    real(wp), parameter :: loosest = 1.1e-4_wp, tightest = 0.9e-10_wp

    type(column_type), parameter :: run_columns(12) = [ &
        column_type('scene', 'scene', text_column, '', 'name of the problem'), &
        column_type('solver', 'solver', text_column, '', 'name of the solver'), &
        column_type('control', 'by', text_column, '', 'rtol: relative and absolute tolerance; step: fixed steps'), &
        column_type('value', 'value', real_column, '', 'tolerance, or step in s'), &
        column_type('error_q', 'error', real_column, '', 'largest error of the compared coordinates at the end'), &
        column_type('cpu_seconds', 'seconds', real_column, 's', 'time of the processor, without preparation, median'), &
        column_type('ratio', 'ratio', real_column, '1', &
            'to the time of the yardstick with the same tolerance, median of the rounds'), &
        column_type('steps', 'steps', count_column, '1', 'accepted steps'), &
        column_type('rejected', 'rejected', count_column, '1', 'rejected steps'), &
        column_type('evaluations', 'r.h.s.', count_column, '1', 'evaluations of the equations of motion, or of the residual'), &
        column_type('preparation_seconds', '', real_column, 's', 'time of the preparation'), &
        column_type('agreement', '', real_column, '1', 'how far two references are apart; 0 where there is one from elsewhere')]

    type(column_type), parameter :: summary_columns(14) = [ &
        column_type('scene', 'scene', text_column, '', 'name of the problem'), &
        column_type('solver', 'solver', text_column, '', 'name of the solver'), &
        column_type('seconds_4', '1e-4 s', real_column, 's', 'time to an error of 1e-4, median'), &
        column_type('seconds_6', '1e-6 s', real_column, 's', 'time to an error of 1e-6'), &
        column_type('seconds_8', '1e-8 s', real_column, 's', 'time to an error of 1e-8'), &
        column_type('seconds_10', '1e-10 s', real_column, 's', 'time to an error of 1e-10'), &
        column_type('ratio_4', 'ratio', real_column, '1', 'to the time of the yardstick to 1e-4, median of the rounds'), &
        column_type('ratio_6', 'ratio', real_column, '1', 'the same to 1e-6'), &
        column_type('ratio_8', 'ratio', real_column, '1', 'the same to 1e-8'), &
        column_type('ratio_10', 'ratio', real_column, '1', 'the same to 1e-10'), &
        column_type('step_seconds', 's/step', real_column, 's', 'time of an accepted step, rejected ones included, median'), &
        column_type('evaluation_seconds', 's/rhs', real_column, 's', 'time of an evaluation, all else included, median'), &
        column_type('evaluation_ratio', 'ratio', real_column, '1', 'to that of the yardstick, median of the rounds'), &
        column_type('best_ratio', 'to best', real_column, '1', &
            'the same to that of the faster one of the index-1 solvers written by hand')]

    type :: report_type
        private
        type(journal_type) :: runs, summary
    contains
        procedure :: start
        procedure :: add
        procedure :: finish
    end type report_type

contains

    !> Begin the tables in a folder.
    subroutine start(self, folder, rounds, error)
        class(report_type), intent(inout) :: self
        character(len=*), intent(in) :: folder
        integer, intent(in) :: rounds
        type(error_type), allocatable, intent(out) :: error
        character(len=:), allocatable :: settings

        settings = '[bench]'//newline//'rounds = '//to_text(rounds)//newline// &
            'compiler = "'//compiler_version()//'"'//newline//'options = "'//optimisation()//'"'//newline
        call self%runs%open(folder, 'runs', run_columns, settings, .true., error)
        if (.not. allocated(error)) call self%summary%open(folder, 'summary', summary_columns, settings, .true., error)
    end subroutine start

    !> Options of the compiler without paths.
    pure function optimisation() result(text)
        character(len=:), allocatable :: text, rest, word
        integer :: blank

        text = ''
        rest = compiler_options()//' '
        do while (len(rest) > 0)
            blank = index(rest, ' ')
            word = rest(:blank - 1)
            rest = rest(blank + 1:)
            if (index(word, '-O') == 1 .or. index(word, '-march') == 1 .or. index(word, '-mtune') == 1 .or. &
                index(word, '-funroll') == 1) text = text//' '//word
        end do
        text = trim(adjustl(text))
    end function optimisation

    !> Add the rows of a problem.
    subroutine add(self, problem, solvers, series, error)
        class(report_type), intent(inout) :: self
        type(problem_type), intent(in) :: problem
        type(solver_holder_type), intent(in) :: solvers(:)
        !> One per solver.
        type(series_type), intent(in) :: series(:)
        type(error_type), allocatable, intent(out) :: error
        integer :: base, i

        base = 0
        do i = 1, size(solvers)
            if (any(solvers(i)%solver%name == yardstick)) base = i
            if (solvers(i)%solver%name == yardstick(1)) exit
        end do
        do i = 1, size(solvers)
            call add_runs(self, problem, solvers(i), series(i), series(base), error)
            if (allocated(error)) return
            call add_summary(self, problem, solvers, series, i, base, error)
            if (allocated(error)) return
        end do
    end subroutine add

    !> Add one row per run.
    subroutine add_runs(self, problem, holder, series, base, error)
        class(report_type), intent(inout) :: self
        type(problem_type), intent(in) :: problem
        type(solver_holder_type), intent(in) :: holder
        type(series_type), intent(in) :: series, base
        type(error_type), allocatable, intent(out) :: error
        character(len=cell_length) :: cells(size(run_columns))
        integer :: i, j

        associate (table => self%runs%table)
            do i = 1, size(series%points)
                associate (point => series%points(i))
                    cells = table%new_row()
                    call table%put(cells, 'scene', trim(problem%name))
                    call table%put(cells, 'solver', trim(holder%solver%name))
                    call table%put(cells, 'control', trim(merge('step', 'rtol', holder%solver%is_fixed)))
                    call table%put(cells, 'value', point%control)
                    call table%put(cells, 'error_q', point%error)
                    call table%put(cells, 'cpu_seconds', median(point%seconds))
                    do j = 1, size(base%points)
                        if (holder%solver%is_fixed .or. abs(base%points(j)%control - point%control) > 0.0_wp) cycle
                        call table%put(cells, 'ratio', median(point%seconds/base%points(j)%seconds))
                    end do
                    call table%put(cells, 'steps', point%steps)
                    call table%put(cells, 'rejected', point%rejected)
                    call table%put(cells, 'evaluations', point%evaluations)
                    call table%put(cells, 'preparation_seconds', point%preparation)
                    call table%put(cells, 'agreement', problem%agreement)
                end associate
                call self%runs%append(cells, error)
                if (allocated(error)) return
            end do
        end associate
    end subroutine add_runs

    !> Add one row per solver.
    subroutine add_summary(self, problem, solvers, series, i, base, error)
        class(report_type), intent(inout) :: self
        type(problem_type), intent(in) :: problem
        type(solver_holder_type), intent(in) :: solvers(:)
        type(series_type), intent(in) :: series(:)
        !> Indices of the solver, and of the one to compare it with.
        integer, intent(in) :: i, base
        type(error_type), allocatable, intent(out) :: error
        character(len=cell_length) :: cells(size(summary_columns))
        real(wp), allocatable :: seconds(:), of_base(:), best(:)
        integer :: j, round, rounds

        if (size(series(i)%points) == 0) return
        rounds = size(series(i)%points(1)%seconds)
        allocate (seconds(rounds), of_base(rounds), best(rounds))
        associate (table => self%summary%table)
            cells = table%new_row()
            call table%put(cells, 'scene', trim(problem%name))
            call table%put(cells, 'solver', trim(solvers(i)%solver%name))
            do j = 1, size(errors)
                seconds = [(time_to_error(series(i), errors(j), round), round=1, rounds)]
                of_base = [(time_to_error(series(base), errors(j), round), round=1, rounds)]
                call table%put(cells, trim(summary_columns(2 + j)%name), median_or_none(seconds))
                call table%put(cells, trim(summary_columns(6 + j)%name), median_or_none(seconds/of_base))
            end do
            seconds = [(step_seconds(series(i), round), round=1, rounds)]
            call table%put(cells, 'step_seconds', median(seconds))
            seconds = [(evaluation_seconds(series(i), round), round=1, rounds)]
            of_base = [(evaluation_seconds(series(base), round), round=1, rounds)]
            call table%put(cells, 'evaluation_seconds', median(seconds))
            call table%put(cells, 'evaluation_ratio', median(seconds/of_base))
            best = of_base
            do j = 1, size(solvers)
                if (.not. any(solvers(j)%solver%name == by_hand)) cycle
                best = min(best, [(evaluation_seconds(series(j), round), round=1, rounds)])
            end do
            if (any([(any(solvers(j)%solver%name == by_hand), j=1, size(solvers))])) then
                call table%put(cells, 'best_ratio', median(seconds/best))
            end if
        end associate
        call self%summary%append(cells, error)
    end subroutine add_summary

    !> Median, NaN if one of the values is.
    pure real(wp) function median_or_none(values)
        real(wp), intent(in) :: values(:)

        median_or_none = ieee_value(1.0_wp, ieee_quiet_nan)
        if (all(ieee_is_finite(values))) median_or_none = median(values)
    end function median_or_none

    !> Time of an evaluation in a round: the median over the runs.
    pure real(wp) function evaluation_seconds(series, round)
        type(series_type), intent(in) :: series
        integer, intent(in) :: round
        real(wp) :: seconds(size(series%points))
        integer :: i

        do i = 1, size(seconds)
            seconds(i) = series%points(i)%seconds(round)/real(series%points(i)%evaluations, wp)
        end do
        evaluation_seconds = median(pack(seconds, counts(series)))
    end function evaluation_seconds

    !> The time of a step.
    pure real(wp) function step_seconds(series, round)
        type(series_type), intent(in) :: series
        integer, intent(in) :: round
        real(wp) :: seconds(size(series%points))
        integer :: i

        do i = 1, size(seconds)
            seconds(i) = series%points(i)%seconds(round)/real(series%points(i)%steps, wp)
        end do
        step_seconds = median(pack(seconds, counts(series)))
    end function step_seconds

    !> True for the runs used for the time of an evaluation: neither very loose nor very tight, or all if there are no such runs.
    pure function counts(series) result(which)
        type(series_type), intent(in) :: series
        logical :: which(size(series%points))
        integer :: i

        do i = 1, size(which)
            which(i) = series%points(i)%control <= loosest .and. series%points(i)%control >= tightest
        end do
        if (.not. any(which)) which = .true.
    end function counts

    !> Show the summary, and write the HDF5 files; the text is for the terminal.
    subroutine finish(self, text, error)
        class(report_type), intent(inout) :: self
        character(len=:), allocatable, intent(out) :: text
        type(error_type), allocatable, intent(out) :: error
        character(len=*), parameter :: about = 'tandem beside other solvers, in turn on one core; times of the processor'
        integer :: row

        call self%runs%close()
        call self%summary%close()
        call self%runs%write_hdf5('bench', about, [character(len=1) ::], [real(wp) ::], error)
        if (.not. allocated(error)) call self%summary%write_hdf5('bench_summary', about, [character(len=1) ::], &
            [real(wp) ::], error)
        text = self%summary%table%header()//newline
        do row = 1, self%summary%table%rows()
            text = text//self%summary%table%line(row)//newline
        end do
        text = text//'files: '//self%runs%path//'.csv, .h5, '//self%summary%path//'.csv, .h5'
    end subroutine finish
end module tandem_bench_report
