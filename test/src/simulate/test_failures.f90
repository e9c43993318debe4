! SPDX-License-Identifier: MIT
!> Tests of every failure of a start or a run: status, message, and remaining state.
module test_failures
    use asserts, only: check_below, check_close, check_count, check_failure, check_no_failure, check_stopped, check_text, &
        check_true
    use faulty_runs, only: check_state_left
    use model_belt_wheel, only: belt_wheel_type
    use model_heavy_top, only: heavy_top_type
    use model_knife_edge, only: knife_edge_type
    use model_moving_pivot, only: moving_pivot_type
    use model_particle, only: particle_type
    use model_pendulum, only: pendulum_type
    use model_spy, only: fault_nan, fault_retry, spy_type
    use model_stiff_pendulum, only: stiff_pendulum_type
    use runs, only: choose, get_start, run
    use tandem, only: at_end, at_step, failure_type => error_type, n_terms, need_mass, observer_type, options_type, &
        rolling_disk_type, set_error, simulation_type, statistics_type, status_output_failed, term_name, wp
    use testdrive, only: error_type, new_unittest, test_failed, unittest_type
    use, intrinsic :: ieee_arithmetic, only: ieee_positive_inf, ieee_quiet_nan, ieee_value
    implicit none (type, external)
    private

    public :: collect_failures

    !> Writes that fail from a time on.
    type, extends(observer_type) :: full_disk_type
        real(wp) :: full_at = 0.0_wp
        integer :: ends = 0
    contains
        procedure :: observe
    end type full_disk_type

    !> Chart policies and refresh modes for every fault.
    character(len=10), parameter :: charts(3) = [character(len=10) :: 'every_step', 'adaptive', 'paper']
    character(len=6), parameter :: modes(2) = ['factor', 'refine']

contains

    !> The suite.
    subroutine collect_failures(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('options-are-checked-by-initialize', test_options), &
            new_unittest('unknown-stepper-is-refused-with-the-known-ones', test_stepper), &
            new_unittest('starts-of-a-wrong-size-are-refused', test_sizes), &
            new_unittest('starts-that-are-not-finite-are-refused', test_finite_start), &
            new_unittest('a-start-off-the-position-constraints-names-the-row', test_position_start), &
            new_unittest('a-start-off-the-velocity-constraints-names-the-row', test_velocity_start), &
            new_unittest('a-start-off-a-nonholonomic-constraint-names-the-row', test_nonholonomic_start), &
            new_unittest('a-start-that-is-a-little-off-is-moved', test_moved_start), &
            new_unittest('a-duplicate-constraint-is-named-and-left-out', test_duplicate), &
            new_unittest('nearly-duplicate-constraint-is-refused', test_near_duplicate), &
            new_unittest('a-constraint-without-gradient-is-refused', test_no_gradient), &
            new_unittest('mass-singular-on-the-null-space-is-refused', test_singular_mass), &
            new_unittest('negative-mass-is-refused', test_negative_mass), &
            new_unittest('a-failed-step-can-be-taken-again', test_again), &
            new_unittest('a-failed-start-can-be-made-good', test_start_again), &
            new_unittest('an-end-before-the-start-is-refused', test_end), &
            new_unittest('a-step-too-small-for-the-time-is-an-underflow', test_underflow), &
            new_unittest('the-limit-of-steps-ends-the-run', test_step_limit), &
            new_unittest('steps-too-large-for-the-disk-end-in-a-named-status', test_large_step), &
            new_unittest('steps-too-large-for-a-stiff-spring-end-in-a-named-status', test_stiff_step), &
            new_unittest('a-chart-that-is-never-renewed-ends-in-a-named-status', test_never_renewed), &
            new_unittest('an-observer-can-end-the-run', test_observer)]
    end subroutine collect_failures

    subroutine observe(self, simulation, occasion, error)
        class(full_disk_type), intent(inout) :: self
        class(simulation_type), intent(inout) :: simulation
        integer, intent(in) :: occasion
        type(failure_type), allocatable, intent(out) :: error

        if (occasion == at_end) self%ends = self%ends + 1
        if (occasion == at_step .and. simulation%state%t >= self%full_at) then
            call set_error(error, status_output_failed, 'no space left')
        end if
    end subroutine observe

    subroutine test_options(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)

        call model%define()
        call model%start(0.3_wp, 0.0_wp, q, qd)
        call simulation%initialize(model, choose(step=-1.0_wp), 0.0_wp, q, qd, failure)
        call check_failure(error, failure, 'invalid_option', 'step = -1')
        call simulation%initialize(model, choose(chart='never'), 0.0_wp, q, qd, failure)
        call check_failure(error, failure, 'invalid_option', 'chart = "never"')
    end subroutine test_options

    subroutine test_stepper(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)

        call model%define()
        call model%start(0.3_wp, 0.0_wp, q, qd)
        options%stepper = 'euler'
        call simulation%initialize(model, options, 0.0_wp, q, qd, failure)
        call check_failure(error, failure, 'invalid_option', 'stepper = "euler"')
        call check_text(error, failure%message, 'rk4')
    end subroutine test_stepper

    subroutine test_sizes(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure

        call model%define()
        call simulation%initialize(model, options, 0.0_wp, [0.8_wp, 0.0_wp, 0.0_wp], [0.0_wp, 0.0_wp], failure)
        call check_failure(error, failure, 'invalid_option', '3 and 2 entries, the model has n = 2')
        call simulation%initialize(model, options, 0.0_wp, [0.8_wp, 0.0_wp], [0.0_wp], failure)
        call check_failure(error, failure, 'invalid_option', '2 and 1 entries, the model has n = 2')
    end subroutine test_sizes

    subroutine test_finite_start(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: nan

        nan = ieee_value(1.0_wp, ieee_quiet_nan)
        call model%define()
        call simulation%initialize(model, options, nan, [0.8_wp, 0.0_wp], [0.0_wp, 0.0_wp], failure)
        call check_failure(error, failure, 'invalid_option', 'not finite')
        call simulation%initialize(model, options, 0.0_wp, [0.8_wp, nan], [0.0_wp, 0.0_wp], failure)
        call check_failure(error, failure, 'invalid_option', 'not finite')
        call simulation%initialize(model, options, 0.0_wp, [0.8_wp, 0.0_wp], [nan, 0.0_wp], failure)
        call check_failure(error, failure, 'invalid_option', 'not finite')
    end subroutine test_finite_start

    subroutine test_position_start(error)
        type(error_type), allocatable, intent(out) :: error
        type(heavy_top_type), target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)

        call model%define()
        call get_start('heavy_top', q, qd)
        q(2) = q(2) + 1.0e-4_wp
        call simulation%initialize(model, options, 0.0_wp, q, qd, failure)
        call check_failure(error, failure, 'inconsistent_start', 'position constraint "fixed point y"')
    end subroutine test_position_start

    subroutine test_velocity_start(error)
        type(error_type), allocatable, intent(out) :: error
        type(heavy_top_type), target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)

        call model%define()
        call get_start('heavy_top', q, qd)
        qd(4:) = qd(4:) + 1.0e-4_wp*q(4:)
        call simulation%initialize(model, options, 0.0_wp, q, qd, failure)
        call check_failure(error, failure, 'inconsistent_start', 'velocity constraint "')
        call get_start('heavy_top', q, qd)
        qd(3) = qd(3) + 1.0e-4_wp
        call simulation%initialize(model, options, 0.0_wp, q, qd, failure)
        call check_failure(error, failure, 'inconsistent_start', 'velocity constraint "fixed point z"')
    end subroutine test_velocity_start

    subroutine test_nonholonomic_start(error)
        type(error_type), allocatable, intent(out) :: error
        type(knife_edge_type), target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)

        call model%define()
        call get_start('knife_edge', q, qd)
        qd(2) = -qd(2)
        call simulation%initialize(model, options, 0.0_wp, q, qd, failure)
        call check_failure(error, failure, 'inconsistent_start', 'velocity constraint "no slip"')
    end subroutine test_nonholonomic_start

    !> Less than the start's tolerance, more than the constraints': the nearest point, and the report contains the distance.
    subroutine test_moved_start(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        type(statistics_type) :: statistics
        real(wp) :: q(2), qd(2)

        call model%define()
        call model%start(0.3_wp, 1.0_wp, q, qd)
        call simulation%initialize(model, options, 0.0_wp, q*(1 + 2.0e-9_wp), qd + 1.0e-9_wp*q, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        statistics = simulation%statistics()
        call check_close(error, simulation%state%q, q, 1.0e-15_wp, 'q')
        call check_close(error, simulation%state%qd, qd, 1.0e-15_wp, 'qd')
        call check_below(error, abs(statistics%start_moved_q/2.0e-9_wp/maxval(abs(q)) - 1), 1.0e-6_wp, 'start_moved_q')
        call check_below(error, abs(statistics%start_moved_qd/1.0e-9_wp/maxval(abs(q)) - 1), 1.0e-6_wp, 'start_moved_qd')
        call simulation%initialize(model, options, 0.0_wp, q, qd, failure)
        statistics = simulation%statistics()
        call check_below(error, statistics%start_moved_q, 0.0_wp, 'start_moved_q of a good start')
    end subroutine test_moved_start

    subroutine test_duplicate(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)
        integer :: i

        model%copies = 2
        model%copy_factor = 3.0_wp
        call model%define()
        call model%start(0.3_wp, 0.0_wp, q, qd)
        do i = 1, size(modes)
            options%refresh = modes(i)
            call simulation%initialize(model, options, 0.0_wp, q, qd, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call check_true(error, allocated(simulation%warnings), 'a warning')
            if (allocated(error)) return
            call check_true(error, index(simulation%warnings(1)%text, '"rod again" repeats "rod"') > 0, &
                'the warning names both: '//simulation%warnings(1)%text)
        end do
    end subroutine test_duplicate

    !> phi = drive(t) twice, once as a holonomic row, once as a nonholonomic one that differs by 1e-13.
    subroutine test_near_duplicate(error)
        type(error_type), allocatable, intent(out) :: error
        type(belt_wheel_type), target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2), qdd(2), lambda(2)

        ! The wheel's row is (1, -radius): for a huge radius it is parallel to the drive's row (0, 1).
        model%radius = 1.0e13_wp
        call model%define()
        call model%solution(0.0_wp, q, qd, qdd, lambda)
        call simulation%initialize(model, options, 0.0_wp, q, qd, failure)
        call check_failure(error, failure, 'inconsistent_rows', 'constraint "nonholonomic 1" depends on "holonomic 1"')
    end subroutine test_near_duplicate

    !> The gradient of (x**2 + y**2 - 0)/2 vanishes on the constraint.
    subroutine test_no_gradient(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure

        model%length = 0.0_wp
        call model%define()
        call simulation%initialize(model, options, 0.0_wp, [0.0_wp, 0.0_wp], [0.0_wp, 0.0_wp], failure)
        call check_failure(error, failure, 'rank_deficient', 'constraint "rod"')
    end subroutine test_no_gradient

    subroutine test_singular_mass(error)
        type(error_type), allocatable, intent(out) :: error
        type(particle_type), target :: particle
        type(pendulum_type), target :: pendulum
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)

        particle%m(2) = 0.0_wp
        call particle%define(.true.)
        call simulation%initialize(particle, options, 0.0_wp, spread(0.0_wp, 1, 3), spread(0.0_wp, 1, 3), failure)
        call check_failure(error, failure, 'singular_mass', 'the coordinate "q2" moves without mass')
        pendulum%m = 0.0_wp
        call pendulum%define()
        call pendulum%start(0.3_wp, 0.0_wp, q, qd)
        call simulation%initialize(pendulum, options, 0.0_wp, q, qd, failure)
        call check_failure(error, failure, 'singular_mass', 'the coordinate "q1" moves without mass')
    end subroutine test_singular_mass

    subroutine test_negative_mass(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)

        model%m = -2.0_wp
        call model%define()
        call model%start(0.3_wp, 0.0_wp, q, qd)
        call simulation%initialize(model, options, 0.0_wp, q, qd, failure)
        call check_failure(error, failure, 'singular_mass')
    end subroutine test_negative_mass

    !> A temporary fault has no effect: the run continues as if it had not occurred.
    subroutine test_again(error)
        type(error_type), allocatable, intent(out) :: error
        type(moving_pivot_type), target :: inner, undisturbed
        type(spy_type), target :: spy
        type(simulation_type) :: simulation, expected
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)
        integer :: i, j, term, fault

        call inner%define()
        call inner%motion(0.0_wp, 0.3_wp, 1.0_wp, q, qd)
        call undisturbed%define()
        do i = 1, size(charts)
            do j = 1, size(modes)
                options = choose(step=1.0e-2_wp, chart=charts(i), refresh=modes(j))
                call run(expected, undisturbed, options, 0.0_wp, q, qd, 0.2_wp, failure)
                call check_no_failure(error, failure)
                do term = 1, n_terms
                    if (2**(term - 1) == need_mass) cycle
                    do fault = fault_nan, fault_retry
                        if (allocated(error)) return
                        call spy%wrap(inner)
                        spy%once = .true.
                        spy%fault = fault
                        spy%fault_term = 2**(term - 1)
                        spy%fault_time = 0.0505_wp
                        call run(simulation, spy, options, 0.0_wp, q, qd, 0.2_wp, failure)
                        if (.not. allocated(failure)) call test_failed(error, 'no notice of a fault in '//trim(term_name(term)))
                        if (allocated(error)) return
                        call simulation%integrate(0.2_wp, failure)
                        call check_no_failure(error, failure)
                        if (allocated(error)) then
                            error%message = error%message//' [after a fault in '//trim(term_name(term))//', '//trim(charts(i))// &
                                ', '//modes(j)//']'
                            return
                        end if
                        ! A start value of an iteration may differ: the solution then differs by its tolerance.
                        call check_close(error, simulation%state%q, expected%state%q, 1.0e-12_wp, &
                            'q after a fault in '//trim(term_name(term))//' with '//trim(charts(i))//', '//modes(j))
                    end do
                end do
            end do
        end do
    end subroutine test_again

    !> The same simulation object after a failed initialize.
    subroutine test_start_again(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: bad, good
        type(heavy_top_type), target :: larger
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q_top(:), qd_top(:)
        real(wp) :: q(2), qd(2)

        bad%length = 0.0_wp
        call bad%define()
        call good%define()
        call good%start(0.3_wp, 0.0_wp, q, qd)
        call simulation%initialize(bad, options, 0.0_wp, [0.0_wp, 0.0_wp], [0.0_wp, 0.0_wp], failure)
        call check_failure(error, failure, 'rank_deficient')
        call run(simulation, good, options, 0.0_wp, q, qd, 0.01_wp, failure)
        call check_no_failure(error, failure)
        call larger%define()
        call get_start('heavy_top', q_top, qd_top)
        call run(simulation, larger, options, 0.0_wp, q_top, qd_top, 0.01_wp, failure)
        call check_no_failure(error, failure)
    end subroutine test_start_again

    subroutine test_end(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2), bad(4)
        integer :: i

        call model%define()
        call model%start(0.3_wp, 0.0_wp, q, qd)
        call simulation%initialize(model, options, 1.0_wp, q, qd, failure)
        bad = [0.5_wp, 1.0_wp, ieee_value(1.0_wp, ieee_quiet_nan), ieee_value(1.0_wp, ieee_positive_inf)]
        do i = 1, size(bad)
            call simulation%integrate(bad(i), failure)
            call check_failure(error, failure, 'invalid_option', 'end time')
            call check_close(error, [simulation%state%t], [1.0_wp], 0.0_wp, 't')
        end do
    end subroutine test_end

    subroutine test_underflow(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)

        call model%define()
        call model%start(0.3_wp, 0.0_wp, q, qd)
        call run(simulation, model, choose(step=1.0e-20_wp), 1.0_wp, q, qd, 2.0_wp, failure)
        call check_failure(error, failure, 'step_underflow', 't = 1.0')
    end subroutine test_underflow

    subroutine test_step_limit(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(statistics_type) :: statistics
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)

        call model%define()
        call model%start(0.3_wp, 0.0_wp, q, qd)
        options%step = 1.0e-3_wp
        options%max_steps = 7
        call run(simulation, model, options, 0.0_wp, q, qd, 1.0_wp, failure)
        call check_failure(error, failure, 'step_limit', '7 steps')
        statistics = simulation%statistics()
        call check_count(error, statistics%steps, 7, 'steps')
        call check_close(error, [simulation%state%t], [7.0e-3_wp], 1.0e-17_wp, 't')
    end subroutine test_step_limit

    !> No stepper succeeds with h = 0.1 and more on the disk. The status depends on the failure, but it must soon be one of those
    !> that advise a smaller step.
    subroutine test_large_step(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type), target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: q(9), qd(9)
        integer :: i, j

        call model%define()
        call model%start([-1.0_wp, 0.01_wp, 0.0_wp], 0.0_wp, q, qd)
        do i = 1, size(charts)
            do j = 1, size(modes)
                options = choose(step=0.5_wp, chart=charts(i), refresh=modes(j), v_limit=0.7_wp)
                call run(simulation, model, options, 0.0_wp, q, qd, 40.0_wp, failure)
                call check_stopped(error, failure, piece='smaller step', place=charts(i)//modes(j))
                call check_state_left(error, simulation)
                statistics = simulation%statistics()
                ! Bounded work: the iteration for u ends after some tens of corrections.
                call check_true(error, statistics%position_corrections < 2000, 'corrections')
                if (allocated(error)) return
            end do
        end do
        do i = 1, 2
            options = choose(step=0.5_wp, stepper=merge('sdirk54  ', 'trapezoid', i == 1))
            call run(simulation, model, options, 0.0_wp, q, qd, 40.0_wp, failure)
            call check_stopped(error, failure, piece='smaller step', place=options%stepper)
            call check_state_left(error, simulation)
            statistics = simulation%statistics()
            ! Three attempts of a dozen corrections a stage.
            call check_true(error, statistics%newton_corrections < 2000, 'corrections')
        end do
    end subroutine test_large_step

    !> RK4 is stable up to |h lambda| = 2.8; at h = 1e-3 the spring has 3.1.
    subroutine test_stiff_step(error)
        type(error_type), allocatable, intent(out) :: error
        type(stiff_pendulum_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)

        call model%define()
        call get_start('stiff_pendulum', q, qd)
        call run(simulation, model, choose(step=1.0e-3_wp), 0.0_wp, q, qd, 2.0_wp, failure)
        call check_stopped(error, failure, piece='smaller step')
        call check_state_left(error, simulation)
    end subroutine test_stiff_step

    !> A pendulum that turns over leaves the half circle that its first chart can reach.
    subroutine test_never_renewed(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)
        integer :: j

        call model%define()
        do j = 1, size(modes)
            call model%start(0.0_wp, 12.0_wp, q, qd)
            call run(simulation, model, choose(step=1.0e-3_wp, chart='paper', refresh=modes(j), v_limit=1.0e9_wp), 0.0_wp, q, &
                qd, 2.0_wp, failure)
            call check_stopped(error, failure, piece='renew the chart more often', place=modes(j))
            ! The quarter turn is reached at t = 0.15; all before it is accurate.
            call check_true(error, simulation%state%t > 0.1_wp .and. simulation%state%t < 0.2_wp, 'the time left behind')
            if (allocated(error)) return
        end do
    end subroutine test_never_renewed

    subroutine test_observer(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(simulation_type) :: simulation
        type(full_disk_type) :: full_disk
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)

        call model%define()
        call model%start(0.3_wp, 0.0_wp, q, qd)
        full_disk%full_at = 0.0495_wp
        call run(simulation, model, choose(step=1.0e-2_wp), 0.0_wp, q, qd, 1.0_wp, failure, full_disk)
        call check_failure(error, failure, 'output_failed', 'no space left')
        call check_close(error, [simulation%state%t], [0.05_wp], 1.0e-15_wp, 't')
        ! The observer is still notified of the end, once.
        call check_count(error, full_disk%ends, 1, 'calls at the end')
    end subroutine test_observer
end module test_failures
