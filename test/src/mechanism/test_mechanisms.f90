! SPDX-License-Identifier: MIT
!> Tests of two mechanisms with rank loss: the planar four-bar in its flat position, Bricard's everywhere. None of these tests needs
!> a solver with rank detection.
module test_mechanisms
    use asserts, only: check_below, check_between, check_close, check_count, check_no_failure, check_true
    use model_bricard, only: bricard_type
    use model_four_bar, only: crank_rocker, four_bar_type
    use ranks, only: bricard_angle, check_state, cut, judge, travel_time
    use runs, only: choose, run
    use svd, only: get_null_space
    use tandem, only: change_stepper, failure_type => error_type, options_type, simulation_type, terms_type, wp
    use terms_at, only: get_terms
    use testdrive, only: error_type, new_unittest, unittest_type
    use watch, only: energy_watch_type
    implicit none (type, external)
    private

    public :: collect_mechanisms

    real(wp), parameter :: pi = 4*atan(1.0_wp)

contains

    !> The suite.
    subroutine collect_mechanisms(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('four-bar-loses-a-rank-where-it-is-flat', test_flat), &
            new_unittest('parallelogram-turns-uniformly', test_parallelogram), &
            new_unittest('crank-rocker-never-loses-a-rank', test_crank_rocker_rank), &
            new_unittest('crank-rocker-moves-as-its-geometry-says', test_crank_rocker), &
            new_unittest('bricard-lacks-one-rank-all-along-its-path', test_bricard_rank), &
            new_unittest('bricard-moves-as-its-geometry-says', test_bricard_motion), &
            new_unittest('bricard-moves-the-same-without-any-row', test_bricard_rows), &
            new_unittest('bricard-cannot-spare-the-same-rows-everywhere', test_bricard_parts)]
    end subroutine collect_mechanisms

    subroutine test_flat(error)
        type(error_type), allocatable, intent(out) :: error
        type(four_bar_type) :: model
        real(wp) :: q(9), qd(9), smallest, noise
        integer :: i, rank

        call model%define()
        do i = 0, 8
            call model%start(i*pi/8, 1.3_wp, q, qd)
            call check_state(model, 0.0_wp, q, qd, 'parallelogram', error)
            call judge(model, 0.0_wp, q, rank, smallest, noise)
            call check_count(error, rank, merge(7, 8, mod(i, 8) == 0), 'rank of the parallelogram')
            call check_below(error, noise, 1.0e-15_wp, 'singular value where it is flat')
        end do
        ! The smallest singular value is proportional to the distance from the flat position: the rank is lost gradually.
        call model%start(pi - 1.0e-4_wp, 0.0_wp, q, qd)
        call judge(model, 0.0_wp, q, rank, smallest, noise)
        call check_between(error, smallest/1.0e-4_wp, 0.05_wp, 0.5_wp, 'smallest singular value over the angle')
        ! Unequal pairs of sides get flat as well.
        model%length = [0.7_wp, 1.2_wp, 0.7_wp, 1.2_wp]
        call model%start(pi, 1.0_wp, q, qd)
        call check_state(model, 0.0_wp, q, qd, 'flat parallelogram', error)
        call judge(model, 0.0_wp, q, rank, smallest, noise)
        call check_count(error, rank, 7, 'rank of another parallelogram')
    end subroutine test_flat

    !> Without gravity: phi1 = phi3 = angle + rate t, the coupler does not turn.
    subroutine test_parallelogram(error)
        type(error_type), allocatable, intent(out) :: error
        type(four_bar_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        real(wp) :: q(9), qd(9)

        model%g = 0.0_wp
        call model%define()
        call model%start(0.4_wp, 1.0_wp, q, qd)
        options = choose(stepper='dop853')
        call change_stepper(options, options%stepper, rtol=1.0e-10_wp)
        call run(simulation, model, options, 0.0_wp, q, qd, 2.0_wp, failure)
        call check_no_failure(error, failure)
        call model%start(2.4_wp, 1.0_wp, q, qd)
        ! Thirty times the tolerance.
        call check_close(error, simulation%state%q, q, 3.0e-9_wp, 'q')
        call check_close(error, simulation%state%qd, qd, 3.0e-9_wp, 'qd')
    end subroutine test_parallelogram

    subroutine test_crank_rocker_rank(error)
        type(error_type), allocatable, intent(out) :: error
        type(four_bar_type) :: model
        real(wp) :: q(9), qd(9), smallest, noise
        integer :: i, rank

        model%length = crank_rocker
        call model%define()
        do i = 0, 36
            call model%start(i*pi/18, 1.3_wp, q, qd)
            call check_state(model, 0.0_wp, q, qd, 'crank-rocker', error)
            call judge(model, 0.0_wp, q, rank, smallest, noise)
            call check_count(error, rank, 8, 'rank of the crank-rocker')
            call check_below(error, -smallest, -0.02_wp, 'minus the smallest singular value')
        end do
    end subroutine test_crank_rocker_rank

    !> One turn of the crank with every kind of stepper: the energy, and the time that the turn takes.
    subroutine test_crank_rocker(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=*), parameter :: stepper(3) = [character(len=8) :: 'rk4', 'dop853', 'sdirk54']
        ! Errors of fourth order of rk4 and sdirk54 at h = 1e-3 on a motion with rates of 8/s and more: (1e-2)**4; dop853's
        ! tolerance is below that.
        real(wp), parameter :: bound = 1.0e-8_wp
        type(four_bar_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        type(energy_watch_type) :: energy
        real(wp) :: q(9), qd(9), expected
        integer :: i

        model%length = crank_rocker
        call model%define()
        do i = 1, 3
            call model%start(0.3_wp, 8.0_wp, q, qd)
            options = choose(stepper=stepper(i), step=1.0e-3_wp)
            if (stepper(i) == 'dop853') call change_stepper(options, options%stepper, rtol=1.0e-10_wp)
            call run(simulation, model, options, 0.0_wp, q, qd, 1.0_wp, failure, energy)
            call check_no_failure(error, failure)
            call check_true(error, simulation%state%q(3) > 2*pi, 'the crank turns round')
            call check_below(error, energy%deviation, bound, trim(stepper(i))//': deviation of the energy')
            expected = travel_time(model, 0.3_wp, simulation%state%q(3), 8.0_wp)
            call check_below(error, abs(expected - 1), bound, trim(stepper(i))//': error of the time')
        end do
    end subroutine test_crank_rocker

    !> From 90 degrees to one side of the cube nearly to the flat triangle at 30 degrees, where `start` ends.
    subroutine test_bricard_rank(error)
        type(error_type), allocatable, intent(out) :: error
        type(bricard_type) :: model
        real(wp) :: q(35), qd(35), smallest, noise
        integer :: i, rank

        call model%define()
        call check_count(error, model%n_constraints(), 35, 'rows')
        do i = -30, 10
            call model%start(i*0.05_wp, 1.3_wp, q, qd)
            if (mod(i, 10) == 0) call check_state(model, 0.0_wp, q, qd, 'Bricard', error)
            call judge(model, 0.0_wp, q, rank, smallest, noise)
            call check_count(error, rank, 34, 'rank of Bricard''s mechanism')
            call check_below(error, noise, 1.0e-15_wp, 'the zero singular value')
            call check_below(error, -smallest, -0.04_wp, 'minus the next singular value')
        end do
    end subroutine test_bricard_rank

    !> Without one row the rank is full, and the motion can be computed: its energy, and its time.
    subroutine test_bricard_motion(error)
        type(error_type), allocatable, intent(out) :: error
        type(bricard_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        type(energy_watch_type) :: energy
        real(wp) :: q(35), qd(35), on_path(35), rate
        integer :: i

        model%left_out = 30
        call model%define()
        options%stepper = 'dop853'
        options%rtol = 1.0e-10_wp
        do i = 1, 2
            ! Down, and up and against gravity.
            rate = merge(-0.5_wp, 2.0_wp, i == 1)
            call model%start(0.0_wp, rate, q, qd)
            call run(simulation, model, options, 0.0_wp, q, qd, merge(0.5_wp, 0.2_wp, i == 1), failure, energy)
            call check_no_failure(error, failure)
            ! Thirty times the tolerance.
            call check_below(error, energy%deviation, 3.0e-9_wp, 'deviation of the energy')
            call check_below(error, abs(travel_time(model, 0.0_wp, bricard_angle(simulation%state%q), rate)/ &
                simulation%state%t - 1), 3.0e-9_wp, 'error of the time')
            call model%start(bricard_angle(simulation%state%q), 0.0_wp, on_path, qd)
            ! Euler parameters p and -p are the same.
            call check_close(error, abs(simulation%state%q), abs(on_path), 1.0e-11_wp, 'state and path')
        end do
    end subroutine test_bricard_motion

    !> Near the cube the redundancy involves every row, so that any of them may be dropped, including the normalisation of Euler
    !> parameters.
    subroutine test_bricard_rows(error)
        type(error_type), allocatable, intent(out) :: error
        type(bricard_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        type(terms_type) :: terms
        real(wp) :: q(35), qd(35), first(35)
        real(wp), allocatable :: loads(:, :)
        integer :: i, stat

        call model%define()
        call model%start(0.1_wp, 0.0_wp, q, qd)
        call get_terms(model, 0.0_wp, q, qd, terms, stat)
        call get_null_space(transpose(terms%jacobian), cut, loads)
        call check_count(error, size(loads, 2), 1, 'dependencies')
        call check_below(error, -minval(abs(loads(:, 1))), -0.05_wp, 'minus the smallest part of a row in the dependency')
        options%stepper = 'dop853'
        options%rtol = 1.0e-9_wp
        do i = 1, 35, 17
            model%left_out = i
            call model%define()
            call run(simulation, model, options, 0.0_wp, q, qd, 0.5_wp, failure)
            call check_no_failure(error, failure)
            if (i == 1) first = simulation%state%q
            ! Thirty times the tolerance: the steps may differ.
            call check_close(error, simulation%state%q, first, 3.0e-8_wp, 'motions without different rows')
        end do
    end subroutine test_bricard_rows
    !> At angle = -pi/2 the parts of `y`, `z` and `Euler parameters` in the dependency vanish; that of `axis 2` never does.
    subroutine test_bricard_parts(error)
        type(error_type), allocatable, intent(out) :: error
        type(bricard_type) :: model
        type(terms_type) :: terms
        real(wp) :: q(35), qd(35), smallest, noise
        real(wp), allocatable :: loads(:, :)
        integer :: i, row, rank, stat

        call model%define()
        do i = -25, 5
            call model%start(i*0.1_wp, 0.0_wp, q, qd)
            call get_terms(model, 0.0_wp, q, qd, terms, stat)
            call get_null_space(transpose(terms%jacobian), cut, loads)
            call check_count(error, size(loads, 2), 1, 'dependencies')
            if (allocated(error)) return
            call check_below(error, -minval(abs(loads(5:30:5, 1))), -0.14_wp, 'minus the part of a row "axis 2"')
        end do
        do row = 1, 35
            model%left_out = row
            call model%define()
            call model%start(-pi/2, 0.0_wp, q, qd)
            call judge(model, 0.0_wp, q, rank, smallest, noise)
            if (row > 30 .or. any(mod(row, 5) == [2, 3])) call check_count(error, rank, 33, 'rank without a row that is needed')
            if (mod(row, 5) == 0 .and. row <= 30) call check_count(error, rank, 34, 'rank without a row "axis 2"')
        end do
    end subroutine test_bricard_parts
end module test_mechanisms
