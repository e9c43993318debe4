! SPDX-License-Identifier: MIT
!> Tests of the studies: tables, comma-separated values, journals that resume, references, and the measured rows.
module test_study
    use asserts, only: check_below, check_between, check_close, check_count, check_true
    use reference, only: table_of_reference => reference_type, read_test_reference => read_reference
    use tandem, only: change_stepper, failure_type => error_type, long, wp
    use tandem_io, only: brief, column_type, journal_type, make_reference, precision_columns, precision_type, read_reference, &
        read_scene, reference_type, scene_type, table_type, write_reference
    use tandem_io_output_hdf5, only: hdf5_type
    use tandem_io_study_csv, only: csv_line, split_csv_line
    use tandem_io_study_files, only: read_whole, write_whole
    use tandem_io_study_measure, only: outcome_type, sample_run, time_run
    use tandem_io_study_table, only: cell_length, count_column, real_column, text_column
    use testdrive, only: error_type, new_unittest, unittest_type
    use, intrinsic :: ieee_arithmetic, only: ieee_is_nan
    implicit none (type, external)
    private

    public :: collect_study

    !> Folder of the files of these tests; removed by `make clean`.
    character(len=*), parameter :: folder = 'build/test_study'
    !> A table of three columns.
    type(column_type), parameter :: columns(3) = [ &
        column_type('name', 'name', text_column, '', 'a text'), &
        column_type('steps', 'steps', count_column, '1', 'a count'), &
        column_type('error', 'error', real_column, 'm', 'a number')]

    !> Longer than any run: results must not depend on a clock.
    real(wp), parameter :: no_limit = 1.0e6_wp

contains

    !> The suite.
    subroutine collect_study(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('csv-lines-come-back', test_csv), &
            new_unittest('csv-lines-that-are-cut-are-told', test_cut_csv), &
            new_unittest('cells-keep-all-digits', test_cells), &
            new_unittest('tables-are-aligned', test_layout), &
            new_unittest('numbers-are-brief', test_brief), &
            new_unittest('journals-resume', test_journal), &
            new_unittest('journals-start-anew', test_journal_anew), &
            new_unittest('journals-spare-strange-files', test_journal_refuses), &
            new_unittest('journals-become-hdf5', test_hdf5), &
            new_unittest('references-come-back', test_reference_file), &
            new_unittest('references-of-other-scenes-are-refused', test_reference_refused), &
            new_unittest('references-are-as-good-as-they-say', test_made_reference), &
            new_unittest('samples-do-not-change-the-steps', test_samples), &
            new_unittest('errors-are-those-against-the-file', test_errors), &
            new_unittest('a-study-continues-where-it-was', test_resume), &
            new_unittest('a-series-goes-on-behind-a-run-that-fails', test_failed_run)]
    end subroutine collect_study

    !> Quotes, commas, blanks within and empty cells.
    subroutine test_csv(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=16), parameter :: cells(5) = [character(len=16) :: 'a', '', 'b, c', 'say "so"', '1e-3']
        character(len=16) :: back(5)
        logical :: whole

        call check_same(error, csv_line(cells), 'a,,"b, c","say ""so""",1e-3', 'line')
        call split_csv_line(csv_line(cells), back, whole)
        call check_true(error, whole .and. all(back == cells), 'the cells come back')
    end subroutine test_csv

    subroutine test_cut_csv(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=8) :: cells(3)
        logical :: whole

        call split_csv_line('a,b', cells, whole)
        call check_true(error,.not. whole, 'two cells are not three')
        call split_csv_line('a,b,c,d', cells, whole)
        call check_true(error,.not. whole, 'four cells are not three')
        call split_csv_line('a,b,"c', cells, whole)
        call check_true(error,.not. whole, 'a quote is not closed')
    end subroutine test_cut_csv

    !> Values are read as written, bit for bit; missing ones are NaN or 0.
    subroutine test_cells(error)
        type(error_type), allocatable, intent(out) :: error
        type(table_type) :: table
        character(len=cell_length) :: cells(3)
        real(wp), parameter :: value = 1.0_wp/3

        call table%initialize(columns)
        cells = table%new_row()
        call table%put(cells, 'name', 'x')
        call table%put(cells, 'steps', 123456789012_long)
        call table%put(cells, 'error', value)
        call table%add(cells)
        call table%add(table%new_row())
        call check_count(error, table%rows(), 2, 'rows')
        call check_true(error, table%count_at(1, 'steps') == 123456789012_long, 'the count comes back')
        call check_below(error, abs(table%real_at(1, 'error') - value), 0.0_wp, 'difference of the number')
        call check_true(error, ieee_is_nan(table%real_at(2, 'error')), 'an empty cell is NaN')
        call check_count(error, table%count_at(2, 'steps'), 0, 'empty count')
    end subroutine test_cells

    subroutine test_layout(error)
        type(error_type), allocatable, intent(out) :: error
        type(table_type) :: table
        character(len=cell_length) :: cells(3)

        call table%initialize(columns)
        cells = table%new_row()
        call table%put(cells, 'name', 'dop853')
        call table%put(cells, 'steps', 7_long)
        call table%put(cells, 'error', 1.23456e-7_wp)
        call table%add(cells)
        call check_same(error, table%header(), 'name    steps   error', 'headings')
        call check_same(error, table%line(1), 'dop853      7  1.2e-7', 'row')
    end subroutine test_layout

    subroutine test_brief(error)
        type(error_type), allocatable, intent(out) :: error

        call check_same(error, brief(0.0_wp), '0', 'zero')
        call check_same(error, brief(1.26e-12_wp), '1.3e-12', 'small')
        call check_same(error, brief(0.0123_wp), '0.012', 'hundredths')
        call check_same(error, brief(2.345_wp), '2.3', 'ones')
        call check_same(error, brief(123.4_wp), '123', 'hundreds')
        call check_same(error, brief(-4.0e120_wp), '-4.0e120', 'large')
    end subroutine test_brief

    !> An empty journal with one row, x.
    subroutine begin_journal(name, settings, journal, failure)
        character(len=*), intent(in) :: name, settings
        type(journal_type), intent(inout) :: journal
        type(failure_type), allocatable, intent(out) :: failure
        character(len=cell_length) :: cells(3)

        call journal%open(folder, name, columns, settings, .true., failure)
        if (allocated(failure)) return
        cells = journal%table%new_row()
        cells(1) = 'x'
        call journal%table%put(cells, 'error', 0.1_wp)
        call journal%append(cells, failure)
        call journal%close()
    end subroutine begin_journal

    !> A row that was being written when the study ended is dropped; the previous ones are kept.
    subroutine test_journal(error)
        type(error_type), allocatable, intent(out) :: error
        type(journal_type) :: journal
        type(failure_type), allocatable :: failure
        character(len=:), allocatable :: before, after
        integer :: unit

        call begin_journal('resumes', 'a = 1', journal, failure)
        call check_true(error,.not. allocated(failure), 'the first row is written')
        call read_whole(folder//'/resumes.csv', before)
        open (newunit=unit, file=folder//'/resumes.csv', access='stream', position='append', status='old')
        write (unit) 'y,12'
        close (unit)
        call journal%open(folder, 'resumes', columns, 'a = 1', .false., failure)
        call check_true(error,.not. allocated(failure), 'it is opened again')
        call check_count(error, journal%resumed, 1, 'rows taken up')
        call check_same(error, journal%table%text_at(1, 'name'), 'x', 'cell')
        call check_below(error, abs(journal%table%real_at(1, 'error') - 0.1_wp), 0.0_wp, 'difference of the number')
        call journal%close()
        call read_whole(folder//'/resumes.csv', after)
        call check_same(error, after, before, 'file')
    end subroutine test_journal

    !> Rows of other settings are not mixed with new ones.
    subroutine test_journal_anew(error)
        type(error_type), allocatable, intent(out) :: error
        type(journal_type) :: journal
        type(failure_type), allocatable :: failure

        call begin_journal('anew', 'a = 1', journal, failure)
        call check_true(error,.not. allocated(failure), 'the first row is written')
        call journal%open(folder, 'anew', columns, 'a = 2', .false., failure)
        call check_true(error,.not. allocated(failure), 'it is opened')
        call check_true(error, journal%started_anew, 'it says that it starts anew')
        call check_count(error, journal%table%rows(), 0, 'rows')
        call journal%close()
    end subroutine test_journal_anew

    subroutine test_journal_refuses(error)
        type(error_type), allocatable, intent(out) :: error
        type(journal_type) :: journal
        type(failure_type), allocatable :: failure
        character(len=:), allocatable :: text

        call begin_journal('other', 'a = 1', journal, failure)
        call write_whole(folder//'/strange.csv', 'mine', failure)
        call journal%open(folder, 'strange', columns, 'a = 1', .false., failure)
        call check_true(error, allocated(failure), 'a file that no study made is refused')
        call read_whole(folder//'/strange.csv', text)
        call check_same(error, text, 'mine', 'file')
        call journal%open(folder//'/a/b', 'x', columns, '', .false., failure)
        call check_true(error, allocated(failure), 'a folder in none is refused')
    end subroutine test_journal_refuses

    subroutine test_hdf5(error)
        type(error_type), allocatable, intent(out) :: error
        type(journal_type) :: journal
        type(failure_type), allocatable :: failure
        type(hdf5_type) :: file
        real(wp), allocatable :: values(:, :)

        call begin_journal('table', 'a = 1', journal, failure)
        call journal%write_hdf5('test', 'about', [character(len=4) :: 'b'], [2.0_wp], failure)
        call check_true(error,.not. allocated(failure), 'it is written')
        call file%open_to_read(folder//'/table.h5')
        call file%get('/test/error', values)
        call file%close()
        call check_true(error, allocated(values), 'the numbers are read')
        if (allocated(values)) call check_close(error, values(1, :), [0.1_wp], 0.0_wp, 'numbers')
    end subroutine test_hdf5

    subroutine test_reference_file(error)
        type(error_type), allocatable, intent(out) :: error
        type(reference_type) :: written, found
        type(failure_type), allocatable :: failure
        real(wp), parameter :: start(2) = [1.0_wp, 2.0_wp]

        written%t = [1.0_wp/3, 2.0_wp, 3.0_wp]
        written%q = reshape([0.1_wp, 0.2_wp, 0.3_wp, 0.4_wp, 0.5_wp, 0.6_wp], [2, 3])
        written%qd = -written%q
        written%agreement_q = 1.0e-9_wp
        written%agreement_qd = 2.0e-9_wp
        written%origin = 'a test'
        call write_reference(folder//'_reference.txt', 'x', written, failure)
        call check_true(error,.not. allocated(failure), 'it is written')
        call read_reference(folder//'_reference.txt', 0.0_wp, 2.0_wp, start, start, 99, found, failure)
        call check_true(error,.not. allocated(failure), 'it is read')
        if (allocated(error)) return
        call check_close(error, found%t, written%t(:2), 0.0_wp, 'times up to the end of the run')
        call check_close(error, found%q(:, 2), written%q(:, 2), 0.0_wp, 'q')
        call check_close(error, found%qd(:, 1), written%qd(:, 1), 0.0_wp, 'qd')
        call check_close(error, [found%agreement_q, found%agreement_qd], [1.0e-9_wp, 2.0e-9_wp], 0.0_wp, 'agreement')
    end subroutine test_reference_file

    !> Another number of coordinates, another start, no table at all.
    subroutine test_reference_refused(error)
        type(error_type), allocatable, intent(out) :: error
        type(reference_type) :: found
        type(failure_type), allocatable :: failure
        type(table_of_reference) :: table
        character(len=*), parameter :: path = 'test/reference/knife_edge.txt'

        call read_test_reference('knife_edge', table)
        call read_reference(path, 0.0_wp, 1.0_wp, table%q(:, 1), table%qd(:, 1), 9, found, failure)
        call check_true(error,.not. allocated(failure), 'the right start is accepted')
        call read_reference(path, 0.0_wp, 1.0_wp, table%q(:2, 1), table%qd(:2, 1), 9, found, failure)
        call check_true(error, allocated(failure), 'two coordinates are refused')
        call read_reference(path, 0.0_wp, 1.0_wp, table%q(:, 1), table%qd(:, 1) + 1.0e-6_wp, 9, found, failure)
        call check_true(error, allocated(failure), 'another start is refused')
        call read_reference('fpm.toml', 0.0_wp, 1.0_wp, table%q(:, 1), table%qd(:, 1), 9, found, failure)
        call check_true(error, allocated(failure), 'another text is refused')
        call read_reference('nowhere', 0.0_wp, 1.0_wp, table%q(:, 1), table%qd(:, 1), 9, found, failure)
        call check_true(error, allocated(failure), 'no file is refused')
    end subroutine test_reference_refused

    !> The reference made by a study differs from that of the file, which is independent and known to 1e-14, by no more than its
    !> solutions differ from it: the accuracy of ten per cent for errors of ten times that depends on it. Rounding, which changes
    !> with the processor or a bound on the steps, determines the error of each of them; the mean of ten is closer to the truth than
    !> the farthest of them is to the mean in all but two of ten thousand cases.
    subroutine test_made_reference(error)
        type(error_type), allocatable, intent(out) :: error
        type(scene_type), target :: scene
        type(reference_type) :: made
        type(table_of_reference) :: table
        type(failure_type), allocatable :: failure
        real(wp), parameter :: max_steps(3) = [0.0_wp, 0.02_wp, 0.015_wp]
        real(wp) :: worst
        integer :: i, j

        call read_scene('scenes/rolling_disk.toml', [character(len=16) :: 'time.end=10'], scene, failure)
        call read_test_reference('disk', table)
        do j = 1, size(max_steps)
            scene%options%max_step = max_steps(j)
            call make_reference(scene, 20, no_limit, made, failure)
            call check_true(error,.not. allocated(failure), 'two steppers agree')
            if (allocated(error)) return
            worst = 0.0_wp
            do i = 1, size(made%t)
                worst = max(worst, maxval(abs(made%q(:, i) - table%q_at(made%t(i)))))
            end do
            call check_below(error, worst, made%agreement_q, 'difference from the file')
            ! Rounding of 1e-16 a step, ten thousand steps, multiplied by the disk's growth of about a hundred.
            call check_between(error, made%agreement_q, 1.0e-13_wp, 1.0e-7_wp, 'agreement')
        end do
    end subroutine test_made_reference

    !> The timed run, without an observer, and the sampled one take the same steps, and the samples between steps are right.
    subroutine test_samples(error)
        type(error_type), allocatable, intent(out) :: error
        type(scene_type), target :: scene
        type(reference_type) :: made
        type(outcome_type) :: outcome
        type(failure_type), allocatable :: failure
        integer(long) :: steps, rejected

        call read_scene('scenes/motorcycle.toml', [character(len=16) :: 'time.end=7'], scene, failure)
        call make_reference(scene, 37, no_limit, made, failure)
        call check_true(error,.not. allocated(failure), 'there is a reference')
        if (allocated(error)) return
        call change_stepper(scene%options, 'dopri5', rtol=1.0e-9_wp)
        call sample_run(scene, scene%options, scene%t_end, made, no_limit, outcome)
        call check_true(error, outcome%is_complete(), 'the run is complete')
        ! Steps of 0.1 s: without dense output of order six the samples would be off by far more than the steps.
        call check_below(error, outcome%error_q, 1.0e-8_wp, 'error')
        steps = outcome%statistics%steps
        rejected = outcome%statistics%rejected
        call time_run(scene, scene%options, scene%t_end, 2, outcome)
        call check_count(error, outcome%statistics%steps - steps, 0, 'more steps')
        call check_count(error, outcome%statistics%rejected - rejected, 0, 'more rejected steps')
        call check_true(error, outcome%wall_seconds > 0.0_wp .and. outcome%repeats >= 2, 'it was timed')
        call sample_run(scene, scene%options, scene%t_end, made, 0.0_wp, outcome)
        call check_same(error, trim(outcome%status), 'over_budget', 'status of a run without any time')
    end subroutine test_samples

    !> Errors against a study's own reference are those against the file, within ten per cent wherever they are quoted.
    subroutine test_errors(error)
        type(error_type), allocatable, intent(out) :: error
        type(precision_type) :: own, given
        real(wp) :: a, b
        integer :: row, compared

        call study_vehicle('own', 'time.end=10', '', 999, own, error)
        call study_vehicle('given', 'time.end=10', 'test/reference/vehicle.txt', 999, given, error)
        if (allocated(error)) return
        compared = 0
        do row = 1, min(own%journal%table%rows(), given%journal%table%rows())
            if (own%journal%table%text_at(row, 'value') /= given%journal%table%text_at(row, 'value')) exit
            if (own%journal%table%count_at(row, 'at_floor') > 0) exit
            a = own%journal%table%real_at(row, 'error_q')
            b = given%journal%table%real_at(row, 'error_q')
            call check_between(error, a/b, 0.9_wp, 1.1_wp, 'ratio of the errors of q')
            a = own%journal%table%real_at(row, 'error_qd')
            b = given%journal%table%real_at(row, 'error_qd')
            call check_between(error, a/b, 0.9_wp, 1.1_wp, 'ratio of the errors of qd')
            ! RK4's order is 4; the first rows may show more.
            if (row > 3) call check_between(error, own%journal%table%real_at(row, 'order'), 3.8_wp, 4.4_wp, 'order')
            compared = compared + 1
        end do
        call check_true(error, compared >= 5, 'there are rows to compare')
    end subroutine test_errors

    !> Rows of a study that was stopped and called again are those of one that was not.
    subroutine test_resume(error)
        type(error_type), allocatable, intent(out) :: error
        type(precision_type) :: at_once, first, second
        integer :: row

        call study_vehicle('at_once', 'time.end=2', '', 999, at_once, error)
        call study_vehicle('resumed', 'time.end=2', '', 3, first, error)
        call study_vehicle('resumed', 'time.end=2', '', 999, second, error, resume=.true.)
        if (allocated(error)) return
        call check_count(error, second%journal%resumed, 3, 'rows taken up')
        call check_count(error, second%journal%table%rows(), at_once%journal%table%rows(), 'rows')
        call check_true(error, at_once%journal%table%rows() > 5, 'there are rows to do')
        if (allocated(error)) return
        do row = 1, second%journal%table%rows()
            call check_same(error, second%journal%table%text_at(row, 'value'), at_once%journal%table%text_at(row, 'value'), 'h')
            call check_same(error, second%journal%table%text_at(row, 'error_q'), &
                at_once%journal%table%text_at(row, 'error_q'), 'error')
            call check_same(error, second%journal%table%text_at(row, 'order'), at_once%journal%table%text_at(row, 'order'), &
                'order')
        end do
    end subroutine test_resume

    !> Up to three consecutive failed runs do not end a series, four do.
    subroutine test_failed_run(error)
        type(error_type), allocatable, intent(out) :: error
        type(precision_type) :: study
        type(failure_type), allocatable :: failure
        character(len=cell_length), allocatable :: cells(:)
        logical :: finished
        integer :: n, i

        do n = 1, 4
            call study_vehicle('failed_run', 'time.end=2', '', 2, study, error)
            if (allocated(error)) return
            call study%journal%open(folder, 'failed_run', precision_columns, 'time.end=2', .false., failure)
            do i = 1, n
                associate (table => study%journal%table)
                    cells = table%new_row()
                    call table%put(cells, 'scene', 'articulated_vehicle')
                    call table%put(cells, 'stepper', 'rk4')
                    call table%put(cells, 'control', 'step')
                    call table%put(cells, 'value', 0.5_wp*table%real_at(table%rows(), 'value'))
                    call table%put(cells, 'status', 'position_diverged')
                end associate
                if (.not. allocated(failure)) call study%journal%append(cells, failure)
            end do
            finished = n < 4
            if (.not. allocated(failure)) call study%next_row(finished, failure)
            call check_true(error,.not. allocated(failure), 'the rows are written')
            call study%journal%close()
            if (allocated(error)) return
            call check_true(error, finished .eqv. n == 4, 'whether the series has ended')
            if (allocated(error)) return
            call check_count(error, study%journal%table%rows(), merge(6, 3 + n, n == 4), 'rows')
            if (allocated(error)) return
        end do
    end subroutine test_failed_run

    !> Fail unless two texts are the same.
    subroutine check_same(error, text, expected, what)
        type(error_type), allocatable, intent(inout) :: error
        character(len=*), intent(in) :: text, expected
        !> Subject of the comparison.
        character(len=*), intent(in) :: what

        call check_true(error, text == expected .and. len(text) == len(expected), what//' is "'//expected//'", found "'//text//'"')
    end subroutine check_same

    !> Some rows of RK4 on the vehicle; the scene is kept until the next call, because the study points to it.
    subroutine study_vehicle(name, setting, path, rows, study, error, resume)
        character(len=*), intent(in) :: name, setting
        !> Path of a reference, empty for its own.
        character(len=*), intent(in) :: path
        !> Largest number of rows.
        integer, intent(in) :: rows
        type(precision_type), intent(inout) :: study
        type(error_type), allocatable, intent(inout) :: error
        logical, intent(in), optional :: resume
        type(scene_type), allocatable, target, save :: scene
        type(failure_type), allocatable :: failure
        logical :: finished, force

        if (allocated(error)) return
        force = .true.
        if (present(resume)) force = .not. resume
        if (allocated(scene)) deallocate (scene)
        allocate (scene)
        call read_scene('scenes/articulated_vehicle.toml', [setting], scene, failure)
        if (path == '') then
            call make_reference(scene, 40, no_limit, study%reference, failure)
        else
            call read_reference(path, scene%t_start, scene%t_end, scene%q, scene%qd, 40, study%reference, failure)
            ! That of the file is more accurate; the rows are to be equal.
            study%reference%agreement_q = 1.0e-12_wp
        end if
        call check_true(error,.not. allocated(failure), 'there is a reference')
        if (allocated(error)) return
        call study%journal%open(folder, name, precision_columns, setting, force, failure)
        call check_true(error,.not. allocated(failure), 'there is a journal')
        if (allocated(error)) return
        study%budget = no_limit
        study%repeats = 1
        call study%start(scene, ['rk4'])
        do while (study%journal%table%rows() < rows)
            call study%next_row(finished, failure)
            if (finished .or. allocated(failure)) exit
        end do
        call check_true(error,.not. allocated(failure), 'the rows are written')
        call study%journal%close()
    end subroutine study_vehicle
end module test_study
