! SPDX-License-Identifier: MIT
!> Tests of sweeps: random numbers depend on their place only, designs agree with the literature, cases with their file, and a
!> failed case does not affect others.
module test_sweep
    use asserts, only: check_below, check_close, check_count, check_failure, check_no_failure, check_text, check_true
    use model_faulty, only: faulty_models
    use sweeps, only: compare, folder, keep, late_type, make_plan, newline, quiet_type, read_text, run_text, varied, vary
    use tandem, only: failure_type => error_type, long, wp
    use tandem_io, only: case_runner_type, distribute, index_type, name_of_status, plan_type, record_type, sensitivities, &
        settings_of, sweep_journal_type
    use tandem_io_study_files, only: read_whole, write_whole
    use tandem_io_sweep_plan, only: latin_points, random_points, sobol_points
    use tandem_io_sweep_quantile, only: normal_quantile
    use tandem_io_sweep_random, only: permuted, philox
    use tandem_io_sweep_sobol, only: most_columns, sobol_type
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_sweep

contains

    !> The suite.
    subroutine collect_sweep(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('random-words-are-philox', test_philox), &
            new_unittest('normal-quantiles-are-known', test_quantile), &
            new_unittest('sobol-points-are-known', test_sobol), &
            new_unittest('more-columns-than-sobol-points-have', test_many_columns), &
            new_unittest('permutations-take-every-place-once', test_permuted), &
            new_unittest('latin-draws-hit-every-stratum-once', test_latin), &
            new_unittest('normal-draws-have-their-moments', test_moments), &
            new_unittest('cases-follow-from-their-number', test_numbers), &
            new_unittest('grids-run-as-they-are-written', test_grid), &
            new_unittest('indices-of-a-known-function', test_indices), &
            new_unittest('indices-leave-out-blocks-that-failed', test_failed_blocks), &
            new_unittest('a-case-is-the-run-of-its-scene', test_case), &
            new_unittest('cases-do-not-know-of-each-other', test_order), &
            new_unittest('cases-do-not-know-of-kinds-of-values', test_kinds), &
            new_unittest('a-case-that-fails-is-a-row', test_failed), &
            new_unittest('a-case-that-ends-its-process-takes-no-other', test_crash), &
            new_unittest('a-case-that-never-returns-is-ended', test_hung), &
            new_unittest('late-words-of-a-lost-worker-pass-no-case', test_late), &
            new_unittest('a-sweep-goes-on-where-it-was', test_goes_on), &
            new_unittest('a-journal-that-was-cut-goes-on', test_cut), &
            new_unittest('a-journal-of-another-sweep-is-refused', test_foreign)]
    end subroutine collect_sweep

    !> The known answers that the authors publish with their library (Random123, kat_vectors).
    subroutine test_philox(error)
        type(error_type), allocatable, intent(out) :: error
        integer(long), parameter :: ones = int(z'FFFFFFFF', long)

        call check_true(error, all(philox([0_long, 0_long, 0_long, 0_long], [0_long, 0_long]) == &
            [int(z'6627E8D5', long), int(z'E169C58D', long), int(z'BC57AC4C', long), int(z'9B00DBD8', long)]), 'zeros')
        call check_true(error, all(philox([ones, ones, ones, ones], [ones, ones]) == &
            [int(z'408F276D', long), int(z'41C83B0E', long), int(z'A20BC7C6', long), int(z'6D5451FD', long)]), 'ones')
        call check_true(error, all(philox([int(z'243F6A88', long), int(z'85A308D3', long), int(z'13198A2E', long), &
            int(z'03707344', long)], [int(z'A4093822', long), int(z'299F31D0', long)]) == &
            [int(z'D16CFE09', long), int(z'94FDCCEB', long), int(z'5001E420', long), int(z'24126EA1', long)]), 'digits of pi')
    end subroutine test_philox

    !> Values of scipy.stats.norm.ppf (SciPy 1.16), another algorithm (Cephes).
    subroutine test_quantile(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: p(7) = [1.0e-12_wp, 1.0e-5_wp, 0.01_wp, 0.3_wp, 0.5_wp, 0.975_wp, 0.999999_wp]
        real(wp), parameter :: x(7) = [-7.034483825301131_wp, -4.264890793922825_wp, -2.3263478740408408_wp, &
            -0.5244005127080409_wp, 0.0_wp, 1.959963984540054_wp, 4.753424308817087_wp]
        integer :: i

        do i = 1, size(p)
            ! Both are good to some units of the last place; towards 1 the place of p itself moves x by 2e-16/1e-6/pdf.
            call check_below(error, abs(normal_quantile(p(i)) - x(i)), 5.0e-10_wp*merge(1.0_wp, 1.0e-5_wp, i == 7), 'quantile')
        end do
    end subroutine test_quantile

    !> Points 0 to 7 and 999999 of columns 1, 2, 3, 10, 21 and 40, in units of 2^-32: scipy.stats.qmc.Sobol, SciPy 1.16, not
    !> scrambled, bits=32.
    subroutine test_sobol(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: columns(6) = [1, 2, 3, 10, 21, 40]
        integer(long), parameter :: places(9) = [0_long, 1_long, 2_long, 3_long, 4_long, 5_long, 6_long, 7_long, 1000000_long]
        integer(long), parameter :: known(6, 9) = reshape([0_long, 0_long, 0_long, 0_long, 0_long, 0_long, &
            2147483648_long, 2147483648_long, 2147483648_long, 2147483648_long, 2147483648_long, 2147483648_long, &
            3221225472_long, 1073741824_long, 1073741824_long, 3221225472_long, 1073741824_long, 1073741824_long, &
            1073741824_long, 3221225472_long, 3221225472_long, 1073741824_long, 3221225472_long, 3221225472_long, &
            1610612736_long, 1610612736_long, 2684354560_long, 2684354560_long, 536870912_long, 3758096384_long, &
            3758096384_long, 3758096384_long, 536870912_long, 536870912_long, 2684354560_long, 1610612736_long, &
            2684354560_long, 536870912_long, 3758096384_long, 1610612736_long, 1610612736_long, 2684354560_long, &
            536870912_long, 2684354560_long, 1610612736_long, 3758096384_long, 3758096384_long, 536870912_long, &
            113709056_long, 1339682816_long, 3556216832_long, 1092644864_long, 172355584_long, 2196484096_long], [6, 9])
        type(sobol_type) :: sobol
        integer :: i, j

        call sobol%prepare(40)
        do i = 1, size(places)
            do j = 1, size(columns)
                call check_true(error, sobol%point(places(i), columns(j)) == known(j, i), 'a point is the known one')
            end do
        end do
    end subroutine test_sobol

    !> A plan of too many columns can be made, so that its reader can report it.
    subroutine test_many_columns(error)
        type(error_type), allocatable, intent(out) :: error
        type(plan_type) :: plan

        call make_plan(plan, most_columns + 1, 8, sobol_points)
        call check_count(error, plan%n_drawn, most_columns + 1, 'columns')
    end subroutine test_many_columns

    subroutine test_permuted(error)
        type(error_type), allocatable, intent(out) :: error
        integer(long), parameter :: sizes(6) = [1_long, 2_long, 5_long, 16_long, 17_long, 1000_long]
        logical :: is_taken(0:999)
        integer(long) :: i, place
        integer :: j, moved

        do j = 1, size(sizes)
            is_taken = .false.
            moved = 0
            do i = 0, sizes(j) - 1
                place = permuted(3, i, sizes(j), 2)
                call check_true(error, place >= 0 .and. place < sizes(j), 'places are in range')
                if (allocated(error)) return
                call check_true(error, .not. is_taken(place), 'no place is taken twice')
                is_taken(place) = .true.
                if (place /= i) moved = moved + 1
            end do
        end do
        ! One fixed point is expected; 20 would come once in 10^18 permutations.
        call check_true(error, moved > 980, 'most places move')
    end subroutine test_permuted

    subroutine test_latin(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: n = 50
        type(plan_type) :: plan
        logical :: is_taken(0:n - 1, 3)
        real(wp) :: u(3)
        integer :: i, j

        call make_plan(plan, 3, n, latin_points)
        is_taken = .false.
        do i = 1, n
            call plan%numbers_of(int(i, long), u)
            do j = 1, 3
                is_taken(int(u(j)*n), j) = .true.
            end do
        end do
        call check_true(error, all(is_taken), 'every stratum of every column is hit')
    end subroutine test_latin

    !> Mean and variance of draws, within four of their standard deviations.
    subroutine test_moments(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: n = 20000
        type(plan_type) :: plan
        real(wp), allocatable :: z(:, :)
        real(wp) :: u(2)
        integer :: i

        call make_plan(plan, 2, n, random_points)
        allocate (z(n, 2))
        do i = 1, n
            call plan%numbers_of(int(i, long), u)
            z(i, :) = [normal_quantile(u(1)), normal_quantile(u(2))]
        end do
        call check_below(error, maxval(abs(sum(z, dim=1)/n)), 4/sqrt(real(n, wp)), 'the mean')
        call check_below(error, maxval(abs(sum(z**2, dim=1)/n - 1)), 4*sqrt(2.0_wp/n), 'the variance less 1')
        call check_below(error, abs(sum(z(:, 1)*z(:, 2))/n), 4/sqrt(real(n, wp)), 'the correlation of two columns')
        call check_below(error, abs(sum(z(2:, 1)*z(:n - 1, 1))/n), 4/sqrt(real(n, wp)), 'the correlation of neighbours')
    end subroutine test_moments

    !> Each method of drawing gives case k the same values forwards, backwards and alone; another seed gives others.
    subroutine test_numbers(error)
        type(error_type), allocatable, intent(out) :: error
        type(plan_type) :: plan, other
        real(wp) :: u(3, 40), v(3)
        integer :: i, points

        do points = random_points, sobol_points
            call make_plan(plan, 3, 40, points)
            call make_plan(other, 3, 40, points)
            other%seed = 2
            do i = 1, 40
                call plan%numbers_of(int(i, long), u(:, i))
            end do
            do i = 40, 1, -1
                call plan%numbers_of(int(i, long), v)
                call check_close(error, v, u(:, i), 0.0_wp, 'values of a case')
                call other%numbers_of(int(i, long), v)
                call check_true(error, any(abs(v - u(:, i)) > 0.0_wp), 'another seed gives others')
            end do
        end do
    end subroutine test_numbers

    !> Two lists, side by side or as a grid, with two draws at each place.
    subroutine test_grid(error)
        type(error_type), allocatable, intent(out) :: error
        type(plan_type) :: plan
        type(failure_type), allocatable :: failure
        real(wp) :: v(3), w(3)
        integer :: i

        call read_text('draws = 2', vary('model.mass', 'values = [1.0, 2.0, 3.0]')// &
            vary('model.pull', 'from = 1.0'//newline//'to = 2.0'//newline//'count = 2')//vary('time.end', 'uniform = [1.0, 2.0]'), &
            plan, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call check_count(error, plan%n_cases(), 12, 'cases')
        call plan%numbers_of(1_long, v)
        do i = 0, 11
            call plan%numbers_of(int(i + 1, long), w)
            call check_close(error, w(:2), [1.0_wp + i/4, 1.0_wp + mod(i/2, 2)], 0.0_wp, 'the place of a case')
            if (mod(i, 2) == 0) call check_close(error, w(3:), v(3:), 0.0_wp, 'the first draw at each place')
        end do
        call read_text('lists = "rows"', vary('model.mass', 'values = [1.0, 2.0, 3.0]')// &
            vary('model.pull', 'values = [4.0, 5.0, 6.0]'), plan, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call check_count(error, plan%n_cases(), 3, 'cases')
        call plan%numbers_of(2_long, v(:2))
        call check_close(error, v(:2), [2.0_wp, 5.0_wp], 0.0_wp, 'the second row')
    end subroutine test_grid

    !> The function of T. Ishigami and T. Homma (1990), sin x1 + 7 sin^2 x2 + 0.1 x3^4 sin x1 on (-pi, pi), has known indices.
    subroutine test_indices(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: n = 4096
        real(wp), parameter :: first(3) = [0.31390520_wp, 0.44241114_wp, 0.0_wp], &
            total(3) = [0.55758886_wp, 0.44241114_wp, 0.24368366_wp], pi = acos(-1.0_wp)
        type(plan_type) :: plan
        type(index_type) :: indices(3)
        real(wp), allocatable :: f(:)
        real(wp) :: x(3)
        integer :: i, blocks, points

        allocate (f(5*n))
        do points = random_points, sobol_points, 2
            call make_plan(plan, 3, n, points)
            plan%is_for_indices = .true.
            call plan%complete()
            call check_count(error, plan%n_cases(), 5*n, 'cases')
            do i = 1, 5*n
                call plan%numbers_of(int(i, long), x)
                x = pi*(2*x - 1)
                f(i) = sin(x(1)) + 7*sin(x(2))**2 + 0.1_wp*x(3)**4*sin(x(1))
            end do
            call sensitivities(f, 3, 1, blocks, indices)
            call check_count(error, blocks, n, 'whole blocks')
            ! The intervals hold 95 % of independent draws; twice their width holds nearly all.
            do i = 1, 3
                call check_below(error, abs(indices(i)%first - first(i)), 2*indices(i)%first_error, 'error of the first order')
                call check_below(error, abs(indices(i)%total - total(i)), 2*indices(i)%total_error, 'error of the total')
                call check_below(error, max(indices(i)%first_error, indices(i)%total_error), 0.06_wp, 'half the interval')
            end do
        end do
        ! Sobol' points are more accurate than their intervals, which do not depend on them.
        call check_below(error, maxval(abs(indices%first - first)), 0.005_wp, "error of the first order by Sobol' points")
        call check_below(error, maxval(abs(indices%total - total)), 0.005_wp, "error of the total by Sobol' points")
    end subroutine test_indices

    subroutine test_failed_blocks(error)
        type(error_type), allocatable, intent(out) :: error
        type(index_type) :: indices(1), same(1)
        real(wp) :: f(12)
        integer :: blocks

        f = [1.0_wp, 2.0_wp, 1.5_wp, 3.0_wp, 1.0_wp, 2.5_wp, 0.5_wp, 2.0_wp, 1.0_wp, 4.0_wp, 2.0_wp, 3.0_wp]
        call sensitivities(f(:9), 1, 1, blocks, same)
        f(11) = sqrt(-f(11))
        call sensitivities(f, 1, 1, blocks, indices)
        call check_count(error, blocks, 3, 'whole blocks')
        call check_close(error, indices%total, same%total, 0.0_wp, 'the index of the others')
    end subroutine test_failed_blocks

    !> Values against the closed form: x = pull t^2/2m.
    subroutine test_case(error)
        type(error_type), allocatable, intent(out) :: error
        type(plan_type), target :: plan
        type(case_runner_type) :: runner
        type(record_type) :: record
        type(failure_type), allocatable :: failure
        real(wp) :: v(2)
        integer(long) :: i

        call read_text('draws = 5', vary('model.mass', 'uniform = [1.0, 2.0]')//vary('initial.qd[1]', 'uniform = [1.0, 2.0]')// &
            keep('q1')//keep('qd:q1')//keep('qdd:1'), plan, failure)
        call check_true(error, allocated(failure), 'an element of what is no list is refused')
        if (allocated(failure)) call check_text(error, failure%message, 'is not a list of numbers')
        call read_text('draws = 5'//newline//'set = ["initial.q=[0.0]", "initial.qd=[0.0]"]', &
            vary('model.mass', 'uniform = [1.0, 2.0]')//vary('initial.qd[1]', 'uniform = [1.0, 2.0]')// &
            keep('q1')//keep('qd:q1')//keep('q1', 'at = [0.25, 0.5]')// &
            keep('q1', 'take = "mean"')//keep('event:half'), plan, failure)
        call check_no_failure(error, failure)
        if (.not. allocated(failure)) call runner%prepare(plan, faulty_models())
        call check_no_failure(error, failure)
        if (allocated(error)) return
        do i = 1, 5
            call runner%run(i, record)
            call plan%numbers_of(i, v)
            call check_count(error, record%status, 0, 'the status')
            associate (m => v(1), s => v(2))
                ! rk4 is exact for this motion but for rounding; the mean is a sum of trapezoids of 10 steps, off by h^2/12 qdd.
                call check_close(error, record%values(:5), [s + 0.5_wp/m, s + 1/m, s/4 + 1/(32*m), s/2 + 1/(8*m), &
                    s/2 + 1/(6*m) + 0.01_wp/(12*m)], 1.0e-13_wp, 'values of a case')
                ! Events are found to about the rounding of the time, which their slope of 1 or more keeps.
                call check_close(error, record%values(6:), [m*(sqrt(s**2 + 1/m) - s)], 1.0e-11_wp, 'time of an event')
            end associate
        end do
    end subroutine test_case

    !> The same records in any order.
    subroutine test_order(error)
        type(error_type), allocatable, intent(out) :: error
        type(plan_type), target :: plan
        type(case_runner_type) :: runner
        type(record_type) :: records(6), record
        type(failure_type), allocatable :: failure
        integer(long) :: i

        call read_text('points = "sobol"', vary('model.fault', 'values = [0, 4, 0]')//vary('model.mass', 'values = [1.0, 2.0]')// &
            vary('model.pull', 'normal = [1.0, 0.1]')//keep('q1'), plan, failure)
        call check_no_failure(error, failure)
        if (.not. allocated(failure)) call runner%prepare(plan, faulty_models())
        if (allocated(error)) return
        do i = 1, 6
            call runner%run(i, records(i))
        end do
        do i = 6, 1, -1
            call runner%run(i, record)
            call check_count(error, record%status, records(i)%status, 'the status')
            if (record%status == 0) call check_close(error, record%values, records(i)%values, 0.0_wp, 'values of a case')
            call check_true(error, record%message == records(i)%message, 'the message is the same')
        end do
        call check_count(error, count(records%status /= 0), 2, 'failures')
    end subroutine test_order

    !> An integer is still one after a case with a noninteger value.
    subroutine test_kinds(error)
        type(error_type), allocatable, intent(out) :: error
        type(plan_type), target :: plan
        type(case_runner_type) :: runner, other
        type(record_type) :: record, alone
        type(failure_type), allocatable :: failure
        integer(long) :: i

        call read_text('', vary('solver.max_steps', 'values = [100, 100.5, 200]')//keep('q1'), plan, failure)
        call check_no_failure(error, failure)
        if (.not. allocated(failure)) call runner%prepare(plan, faulty_models())
        if (allocated(error)) return
        do i = 1, 3
            call runner%run(i, record)
            call check_text(error, name_of_status(record%status), trim(merge('invalid_option', 'ok            ', i == 2)))
        end do
        call other%prepare(plan, faulty_models())
        call other%run(3_long, alone)
        call check_close(error, record%values, alone%values, 0.0_wp, 'values of a case')
        call check_true(error, record%message == alone%message, 'the message is the same')
    end subroutine test_kinds

    !> A worker is lost with a case, restarts with others, and reports that case only then.
    subroutine test_late(error)
        type(error_type), allocatable, intent(out) :: error
        type(plan_type), target :: plan
        type(sweep_journal_type) :: journal
        type(late_type) :: team
        type(quiet_type) :: watcher
        type(failure_type), allocatable :: failure

        call read_text('draws = 20', varied()//keep('q1'), plan, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call journal%open(folder//'/late.journal', settings_of(plan), plan%n_outputs(), 1_long, plan%n_cases(), .true., failure)
        call check_no_failure(error, failure)
        call distribute(journal, plan%n_outputs(), 0.0_wp, team, watcher, failure)
        call check_no_failure(error, failure)
        call check_count(error, journal%done, 20, 'cases done')
        call journal%close(.true.)
    end subroutine test_late

    !> Values that the scene refuses, and runs that fail.
    subroutine test_failed(error)
        type(error_type), allocatable, intent(out) :: error
        type(plan_type), target :: plan
        type(sweep_journal_type) :: journal
        type(record_type) :: record
        type(failure_type), allocatable :: failure

        call run_text('', vary('solver.step', 'values = [0.1, -0.1, 0.2]')//vary('model.fault', 'values = [0, 4]')//keep('q1'), &
            plan, journal, 1, failure)
        call check_no_failure(error, failure)
        call check_count(error, journal%done, 6, 'cases done')
        call check_count(error, journal%failed, 4, 'failures')
        call journal%read(2_long, record, failure)
        call check_text(error, name_of_status(record%status), 'not_finite')
        call journal%read(3_long, record, failure)
        call check_text(error, name_of_status(record%status), 'invalid_option')
        ! The message shows the value and its place.
        call check_text(error, record%message, '-0.1')
        call check_text(error, record%message, 'solver')
        call check_true(error, .not. record%values(1) <= 0.0_wp .and. .not. record%values(1) > 0.0_wp, 'it has no value')
        call journal%close(.true.)
    end subroutine test_failed

    subroutine test_crash(error)
        type(error_type), allocatable, intent(out) :: error
        type(plan_type), target :: plan
        type(sweep_journal_type) :: journal
        type(record_type) :: record
        type(failure_type), allocatable :: failure
        integer(long) :: i

        call run_text('draws = 4', vary('model.fault', 'values = [0, 1, 0, 2, 0]')//vary('model.mass', 'uniform = [1.0, 2.0]')// &
            keep('q1'), plan, journal, 2, failure)
        call check_no_failure(error, failure)
        call check_count(error, journal%done, 20, 'cases done')
        call check_count(error, journal%failed, 8, 'failures')
        do i = 1, 20
            call journal%read(i, record, failure)
            call check_text(error, name_of_status(record%status), trim(merge('crashed', 'ok     ', mod((i - 1)/4, 2_long) == 1)))
            if ((i - 1)/4 == 1) call check_text(error, record%message, 'signal 9, SIGKILL')
            if ((i - 1)/4 == 3) call check_text(error, record%message, 'without a signal')
        end do
        call journal%close(.true.)
    end subroutine test_crash

    !> A case that respects max_seconds, and one whose model never returns.
    subroutine test_hung(error)
        type(error_type), allocatable, intent(out) :: error
        type(plan_type), target :: plan
        type(sweep_journal_type) :: journal
        type(record_type) :: record
        type(failure_type), allocatable :: failure

        call run_text('max_seconds = 0.2'//newline//'lists = "rows"', vary('model.fault', 'values = [0, 3, 0]')// &
            vary('time.end', 'values = [1.0, 1.0, 1e8]')//keep('q1'), plan, journal, 2, failure)
        call check_no_failure(error, failure)
        call check_count(error, journal%done, 3, 'cases done')
        call journal%read(1_long, record, failure)
        call check_count(error, record%status, 0, 'the status')
        call journal%read(2_long, record, failure)
        call check_text(error, name_of_status(record%status), 'hung')
        call journal%read(3_long, record, failure)
        call check_text(error, name_of_status(record%status), 'work_limit')
        call check_text(error, record%message, 'max_seconds')
        call journal%close(.true.)
    end subroutine test_hung

    !> After an end the sweep continues with the other cases, and the records are those of an uninterrupted sweep.
    subroutine test_goes_on(error)
        type(error_type), allocatable, intent(out) :: error
        type(plan_type), target :: plan
        type(sweep_journal_type) :: first, second, whole
        type(failure_type), allocatable :: failure

        call run_text('draws = 60', varied()//keep('q1'), plan, first, 2, failure, most=20_long)
        call check_failure(error, failure, 'interrupted', 'cases done')
        call check_true(error, first%done >= 20 .and. first%done < 60, 'some cases are done')
        call first%close(.false.)
        call run_text('draws = 60', varied()//keep('q1'), plan, second, 1, failure, goes_on=.true.)
        call check_no_failure(error, failure)
        call check_true(error, second%resumed == first%done, 'these are not done again')
        call run_text('draws = 60', varied()//keep('q1'), plan, whole, 1, failure, name='whole')
        call check_no_failure(error, failure)
        call compare(error, second, whole)
    end subroutine test_goes_on

    !> A truncated journal gives the cases before the cut; with a byte changed, those before it.
    subroutine test_cut(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=*), parameter :: path = folder//'/sweep.journal'
        ! A record of one number: its length, case, status, seconds, length of the message, number, checksum.
        type(plan_type), target :: plan
        type(sweep_journal_type) :: whole
        type(failure_type), allocatable :: failure
        character(len=:), allocatable :: bytes
        integer, parameter :: record = 8*7, cuts(4) = [0, 1, 20, record - 1]
        integer :: i, length

        call run_text('draws = 10', varied()//keep('q1'), plan, whole, 1, failure, name='whole')
        call check_no_failure(error, failure)
        do i = 1, 6
            call all_of_it()
            call read_whole(path, bytes)
            if (allocated(error) .or. .not. allocated(bytes)) return
            length = len(bytes)
            if (i <= 4) then
                call write_whole(path, bytes(:length - 3*record - cuts(min(i, size(cuts)))), failure)
            else
                bytes(length - 4*record + i:length - 4*record + i) = 'x'
                call write_whole(path, bytes, failure)
            end if
            call again()
        end do
        call whole%close(.true.)
    contains
        subroutine all_of_it()
            type(sweep_journal_type) :: journal

            call run_text('draws = 10', varied()//keep('q1'), plan, journal, 1, failure)
            call journal%close(.false.)
        end subroutine all_of_it

        subroutine again()
            type(sweep_journal_type) :: rest

            call run_text('draws = 10', varied()//keep('q1'), plan, rest, 1, failure, goes_on=.true.)
            call check_no_failure(error, failure)
            call check_count(error, rest%resumed, merge(7, 6, i == 1), 'cases that were there')
            call compare(error, rest, whole, keeps=.true.)
            call rest%close(.true.)
        end subroutine again
    end subroutine test_cut

    subroutine test_foreign(error)
        type(error_type), allocatable, intent(out) :: error
        type(plan_type), target :: plan
        type(sweep_journal_type) :: one, other, third
        type(failure_type), allocatable :: failure

        call run_text('draws = 3', varied()//keep('q1'), plan, one, 1, failure)
        call check_no_failure(error, failure)
        call one%close(.false.)
        call run_text('draws = 3'//newline//'seed = 2', varied()//keep('q1'), plan, other, 1, failure, goes_on=.true.)
        call check_failure(error, failure, 'invalid_option', 'another sweep')
        call other%close(.false.)
        call run_text('draws = 3'//newline//'seed = 2', varied()//keep('q1'), plan, third, 1, failure)
        call check_no_failure(error, failure)
        call check_count(error, third%resumed, 0, 'cases that were there')
        call third%close(.true.)
    end subroutine test_foreign
end module test_sweep
