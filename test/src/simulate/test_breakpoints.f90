! SPDX-License-Identifier: MIT
!> Tests of breakpoints: steps end there, segments change there, and where nu jumps qd jumps with it in the mass metric.
module test_breakpoints
    use asserts, only: check_below, check_close, check_count, check_failure, check_no_failure, check_true
    use extrapolation, only: extrapolate
    use kkt, only: kkt_type, solve_independently
    use model_pendulum, only: pendulum_type
    use model_sleigh, only: reduced_equation_type, sleigh_type
    use runs, only: choose, get_start, new_scene, run
    use reference, only: read_reference, reference_type
    use tandem, only: articulated_vehicle_type, at_step, chart_policies, failure_type => error_type, model_type, observer_type, &
        refresh_modes, simulation_type, statistics_type, stepper_names, terms_type, wp
    use tandem_simulate_statistics, only: by_breakpoint
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_breakpoints

    !> Stores the times of the steps, and the segments after them.
    type, extends(observer_type) :: time_watch_type
        integer :: n = 0
        real(wp) :: t(1000) = 0.0_wp
        integer :: segment(1000) = 0
    contains
        procedure :: observe
    end type time_watch_type

    !> A vehicle that compares t with 2 pi itself, contrary to the rules for models, and states no breakpoint.
    type, extends(articulated_vehicle_type) :: unaware_vehicle_type
        type(articulated_vehicle_type) :: inner
    end type unaware_vehicle_type

    !> Time at which the sleigh's surface changes its speed; off the grid of all steps here.
    real(wp), parameter :: jump_at = 0.70710678_wp
    real(wp), parameter :: two_pi = 8*atan(1.0_wp)
    !> The sleigh's reduced state (x, y, phi, u, w) at t = 0.
    real(wp), parameter :: sleigh_start(5) = [0.0_wp, 0.1_wp, 0.3_wp, 1.0_wp, 0.5_wp]

contains

    !> The suite.
    subroutine collect_breakpoints(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('a-step-ends-exactly-at-a-breakpoint', test_exactly), &
            new_unittest('steps-return-to-their-grid-behind-a-breakpoint', test_grid), &
            new_unittest('a-breakpoint-on-the-grid-cuts-nothing', test_on_grid), &
            new_unittest('several-breakpoints-within-one-step', test_several), &
            new_unittest('a-breakpoint-a-rounding-error-beside-the-grid-makes-no-tiny-step', test_sliver), &
            new_unittest('a-start-behind-a-breakpoint-is-in-the-next-segment', test_start_behind), &
            new_unittest('a-start-at-a-breakpoint-is-in-the-next-segment', test_start_at), &
            new_unittest('an-end-before-a-breakpoint-leaves-it-alone', test_end_before), &
            new_unittest('an-end-at-a-breakpoint-crosses-it', test_end_at), &
            new_unittest('every-breakpoint-makes-a-chart', test_charts), &
            new_unittest('vehicle-does-not-jump-at-its-kink', test_no_jump), &
            new_unittest('vehicle-continues-with-the-right-limit', test_right_limit), &
            new_unittest('velocity-jumps-in-the-mass-metric', test_jump), &
            new_unittest('jump-is-the-same-for-all-policies-and-modes', test_jump_policies), &
            new_unittest('position-does-not-jump', test_position), &
            new_unittest('sleigh-agrees-with-its-reduced-equations-across-the-jump', test_sleigh), &
            new_unittest('order-four-holds-across-the-jump', test_order), &
            new_unittest('a-step-across-the-kink-loses-the-order', test_unaware), &
            new_unittest('motorcycle-jumps-in-the-mass-metric-with-all-steppers', test_motorcycle), &
            new_unittest('implicit-steps-cross-the-jump-of-the-sleigh', test_sleigh_implicit), &
            new_unittest('a-jump-that-nobody-declared-is-not-crossed', test_undeclared), &
            new_unittest('two-calls-of-integrate-are-as-good-as-one', test_two_calls)]
    end subroutine collect_breakpoints

    subroutine observe(self, simulation, occasion, error)
        class(time_watch_type), intent(inout) :: self
        class(simulation_type), intent(inout) :: simulation
        integer, intent(in) :: occasion
        type(failure_type), allocatable, intent(out) :: error

        if (occasion /= at_step .or. self%n == size(self%t)) return
        self%n = self%n + 1
        self%t(self%n) = simulation%state%t
        self%segment(self%n) = simulation%model%segment
    end subroutine observe

    !> A pendulum with breakpoints from t_start to t_end with h = 0.1.
    subroutine swing(breakpoints, t_start, t_end, watch, statistics, error)
        real(wp), intent(in) :: breakpoints(:), t_start, t_end
        type(time_watch_type), intent(out) :: watch
        type(statistics_type), intent(out) :: statistics
        type(error_type), allocatable, intent(inout) :: error
        type(pendulum_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)

        call model%define()
        model%breakpoints = breakpoints
        call model%start(0.3_wp, 0.0_wp, q, qd)
        call run(simulation, model, choose(step=0.1_wp), t_start, q, qd, t_end, failure, watch)
        call check_no_failure(error, failure)
        statistics = simulation%statistics()
    end subroutine swing

    subroutine test_exactly(error)
        type(error_type), allocatable, intent(out) :: error
        type(time_watch_type) :: watch
        type(statistics_type) :: statistics

        call swing([0.123456789_wp], 0.0_wp, 0.3_wp, watch, statistics, error)
        call check_close(error, watch%t(:watch%n), [0.1_wp, 0.123456789_wp, 0.2_wp, 0.3_wp], 1.0e-16_wp, 'times')
        call check_below(error, abs(watch%t(2) - 0.123456789_wp), 0.0_wp, 'distance from the breakpoint')
        call check_true(error, all(watch%segment(:4) == [1, 2, 2, 2]), 'segments are 1 before the breakpoint and 2 from it on')
    end subroutine test_exactly

    !> 0.1 k exactly as a product, without summed rounding.
    subroutine test_grid(error)
        type(error_type), allocatable, intent(out) :: error
        type(time_watch_type) :: watch
        type(statistics_type) :: statistics
        integer :: k

        call swing([0.55_wp], 0.0_wp, 50.0_wp, watch, statistics, error)
        call check_count(error, watch%n, 501, 'steps')
        call check_close(error, watch%t(7:watch%n - 1), [(0.1_wp*k, k=6, 499)], 0.0_wp, 'times')
    end subroutine test_grid

    subroutine test_on_grid(error)
        type(error_type), allocatable, intent(out) :: error
        type(time_watch_type) :: watch
        type(statistics_type) :: statistics

        call swing([0.2_wp], 0.0_wp, 0.5_wp, watch, statistics, error)
        call check_close(error, watch%t(:watch%n), [0.1_wp, 0.2_wp, 0.3_wp, 0.4_wp, 0.5_wp], 1.0e-16_wp, 'times')
        call check_true(error, all(watch%segment(:5) == [1, 2, 2, 2, 2]), 'the segment changes at the grid point')
    end subroutine test_on_grid

    subroutine test_several(error)
        type(error_type), allocatable, intent(out) :: error
        type(time_watch_type) :: watch
        type(statistics_type) :: statistics

        call swing([0.12_wp, 0.15_wp, 0.18_wp], 0.0_wp, 0.3_wp, watch, statistics, error)
        call check_close(error, watch%t(:watch%n), [0.1_wp, 0.12_wp, 0.15_wp, 0.18_wp, 0.2_wp, 0.3_wp], 1.0e-16_wp, 'times')
        call check_true(error, all(watch%segment(:6) == [1, 2, 3, 4, 4, 4]), 'each breakpoint begins a segment')
    end subroutine test_several

    !> 0.3 and 3*0.1 differ in the last bit.
    subroutine test_sliver(error)
        type(error_type), allocatable, intent(out) :: error
        type(time_watch_type) :: watch
        type(statistics_type) :: statistics

        call swing([nearest(0.2_wp, -1.0_wp), 0.3_wp, nearest(0.4_wp, 1.0_wp)], 0.0_wp, 0.6_wp, watch, statistics, error)
        call check_count(error, watch%n, 6, 'steps')
        call check_true(error, all(watch%segment(:6) == [1, 2, 3, 4, 4, 4]), 'each breakpoint begins a segment')
    end subroutine test_sliver

    subroutine test_start_behind(error)
        type(error_type), allocatable, intent(out) :: error
        type(time_watch_type) :: watch
        type(statistics_type) :: statistics

        call swing([0.5_wp, 0.8_wp, 1.45_wp], 1.0_wp, 1.5_wp, watch, statistics, error)
        call check_close(error, watch%t(:watch%n), [1.1_wp, 1.2_wp, 1.3_wp, 1.4_wp, 1.45_wp, 1.5_wp], 3.0e-16_wp, 'times')
        call check_true(error, all(watch%segment(:6) == [3, 3, 3, 3, 4, 4]), 'two breakpoints lie behind the start')
    end subroutine test_start_behind

    subroutine test_start_at(error)
        type(error_type), allocatable, intent(out) :: error
        type(time_watch_type) :: watch
        type(statistics_type) :: statistics

        call swing([1.0_wp], 1.0_wp, 1.2_wp, watch, statistics, error)
        call check_count(error, watch%n, 2, 'steps')
        call check_count(error, watch%segment(1), 2, 'segment')
        call check_count(error, statistics%charts_by(by_breakpoint), 0, 'charts at breakpoints')
    end subroutine test_start_at

    subroutine test_end_before(error)
        type(error_type), allocatable, intent(out) :: error
        type(time_watch_type) :: watch
        type(statistics_type) :: statistics

        call swing([0.27_wp], 0.0_wp, 0.25_wp, watch, statistics, error)
        call check_close(error, watch%t(:watch%n), [0.1_wp, 0.2_wp, 0.25_wp], 1.0e-16_wp, 'times')
        call check_count(error, watch%segment(3), 1, 'segment')
    end subroutine test_end_before

    subroutine test_end_at(error)
        type(error_type), allocatable, intent(out) :: error
        type(time_watch_type) :: watch
        type(statistics_type) :: statistics

        call swing([0.25_wp], 0.0_wp, 0.25_wp, watch, statistics, error)
        call check_close(error, watch%t(:watch%n), [0.1_wp, 0.2_wp, 0.25_wp], 1.0e-16_wp, 'times')
        call check_count(error, watch%segment(3), 2, 'segment')
    end subroutine test_end_at

    subroutine test_charts(error)
        type(error_type), allocatable, intent(out) :: error
        type(time_watch_type) :: watch
        type(statistics_type) :: statistics

        call swing([0.12_wp, 0.15_wp, 0.2_wp], 0.0_wp, 0.3_wp, watch, statistics, error)
        call check_count(error, statistics%charts_by(by_breakpoint), 3, 'charts at breakpoints')
    end subroutine test_charts

    !> theta is continuous at 2 pi, and so is nu = 0.
    subroutine test_no_jump(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(failure_type), allocatable :: failure
        type(time_watch_type) :: watch
        real(wp), allocatable :: q(:), qd(:)

        call new_scene('vehicle', model)
        call get_start('vehicle', q, qd)
        call run(simulation, model, choose(step=0.01_wp), 0.0_wp, q, qd, 7.0_wp, failure, watch)
        call check_no_failure(error, failure)
        statistics = simulation%statistics()
        call check_below(error, statistics%velocity_jump, 0.0_wp, 'velocity jump')
        call check_count(error, count(abs(watch%t(:watch%n) - 8*atan(1.0_wp)) <= 0.0_wp), 1, 'steps that end at 2 pi')
        call check_count(error, watch%n, 701, 'steps')
    end subroutine test_no_jump

    !> At 2 pi the acceleration is that of straight steering: the front wheel's slip has no theta-dot any more.
    subroutine test_right_limit(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)
        real(wp) :: turn

        call new_scene('vehicle', model)
        call get_start('vehicle', q, qd)
        call run(simulation, model, choose(step=0.01_wp), 0.0_wp, q, qd, 8*atan(1.0_wp), failure)
        call check_no_failure(error, failure)
        ! phi1' = u tan(theta)/6 with theta = 0 from here on, so that phi1'' = 0; its left limit is u theta'/6 = 0.0425.
        turn = abs(simulation%state%qdd(3))
        call check_below(error, turn, 1.0e-10_wp, 'phi1''''')
    end subroutine test_right_limit

    !> A sleigh up to its jump, from the left by the reduced equations.
    subroutine reach_jump(model, q, qd_before, qd_after)
        type(sleigh_type), intent(inout) :: model
        !> Position, velocity before, and the velocity after by the closed form.
        real(wp), intent(out) :: q(3), qd_before(3), qd_after(3)
        type(reduced_equation_type) :: equation
        real(wp) :: y(5), impulse

        equation%model = model
        y = sleigh_start
        call extrapolate(equation, 0.0_wp, jump_at, 20, y)
        call model%motion(jump_at, y, q, qd_before)
        ! M^-1 C' mu with mu (C M^-1 C') = jump of e.
        impulse = (model%speed(2) - model%speed(1))/(1/model%m + model%arm**2/model%inertia)
        qd_after = qd_before + impulse*[sin(q(3))/model%m, -cos(q(3))/model%m, -model%arm/model%inertia]
    end subroutine reach_jump

    subroutine test_jump(error)
        type(error_type), allocatable, intent(out) :: error
        type(sleigh_type), target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(failure_type), allocatable :: failure
        real(wp) :: q(3), qd(3), q_jump(3), before(3), after(3)

        call model%define(jump_at)
        call reach_jump(model, q_jump, before, after)
        call model%motion(0.0_wp, sleigh_start, q, qd)
        call run(simulation, model, choose(step=2.0e-3_wp), 0.0_wp, q, qd, jump_at, failure)
        call check_no_failure(error, failure)
        ! Truncation at h = 2e-3 up to here is below 1e-12; the jump itself is 0.5.
        call check_close(error, simulation%state%q, q_jump, 1.0e-12_wp, 'q')
        call check_close(error, simulation%state%qd, after, 1.0e-12_wp, 'qd')
        statistics = simulation%statistics()
        call check_below(error, abs(statistics%velocity_jump - maxval(abs(after - before))), 1.0e-12_wp, 'error of velocity_jump')
    end subroutine test_jump

    subroutine test_jump_policies(error)
        type(error_type), allocatable, intent(out) :: error
        type(sleigh_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: q(3), qd(3), q_jump(3), before(3), after(3)
        integer :: i, j

        do i = 1, size(chart_policies)
            do j = 1, size(refresh_modes)
                call model%define(jump_at)
                model%segment = 1
                call reach_jump(model, q_jump, before, after)
                call model%motion(0.0_wp, sleigh_start, q, qd)
                call run(simulation, model, choose(step=2.0e-3_wp, chart=chart_policies(i), refresh=refresh_modes(j)), &
                    0.0_wp, q, qd, jump_at, failure)
                call check_no_failure(error, failure)
                call check_close(error, simulation%state%qd, after, 3.0e-12_wp, 'qd with '//trim(chart_policies(i))//', '// &
                    refresh_modes(j))
            end do
        end do
    end subroutine test_jump_policies

    !> The same run with a step that ends before the jump, and with one at it.
    subroutine test_position(error)
        type(error_type), allocatable, intent(out) :: error
        type(sleigh_type), target :: jumps, stays
        type(simulation_type) :: after, before
        type(failure_type), allocatable :: failure
        real(wp) :: q(3), qd(3)

        call jumps%define(jump_at)
        call jumps%motion(0.0_wp, sleigh_start, q, qd)
        call run(after, jumps, choose(step=2.0e-3_wp), 0.0_wp, q, qd, jump_at, failure)
        call check_no_failure(error, failure)
        call stays%define(2.0_wp)
        call run(before, stays, choose(step=2.0e-3_wp), 0.0_wp, q, qd, jump_at, failure)
        call check_no_failure(error, failure)
        call check_close(error, after%state%q, before%state%q, 0.0_wp, 'q')
        call check_true(error, maxval(abs(after%state%qd - before%state%qd)) > 0.1_wp, 'qd does jump')
    end subroutine test_position

    !> Error of q and qd at t = 2 against the reduced equations, which are restarted after the jump.
    subroutine measure_sleigh(stepper, step, value, error)
        character(len=*), intent(in) :: stepper
        real(wp), intent(in) :: step
        real(wp), intent(out) :: value
        type(error_type), allocatable, intent(inout) :: error
        type(sleigh_type), target :: model
        type(reduced_equation_type) :: equation
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: q(3), qd(3), q_jump(3), before(3), after(3), y(5)

        call model%define(jump_at)
        call reach_jump(model, q_jump, before, after)
        call model%motion(0.0_wp, sleigh_start, q, qd)
        call run(simulation, model, choose(step=step, stepper=stepper), 0.0_wp, q, qd, 2.0_wp, failure)
        call check_no_failure(error, failure)
        model%segment = 2
        call model%reduce(q_jump, after, y)
        equation%model = model
        call extrapolate(equation, jump_at, 2.0_wp, 30, y)
        call model%motion(2.0_wp, y, q, qd)
        value = max(maxval(abs(simulation%state%q - q)), maxval(abs(simulation%state%qd - qd)))
    end subroutine measure_sleigh

    subroutine test_sleigh(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: value

        call measure_sleigh('rk4', 2.0e-3_wp, value, error)
        ! Error of order four at h = 0.04, 2e-6/20**4 = 1.3e-11, with a margin of two.
        call check_below(error, value, 2.5e-11_wp, 'error of q and qd')
    end subroutine test_sleigh

    subroutine test_order(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: large, small

        call measure_sleigh('rk4', 0.04_wp, large, error)
        call measure_sleigh('rk4', 0.02_wp, small, error)
        call check_below(error, large, 4.0e-6_wp, 'error at h = 0.04')
        call check_below(error, small/large, 2.0_wp**(-3.85_wp), 'ratio of the errors')
    end subroutine test_order

    !> The vehicle's terms, of the segment that t is in.
    subroutine evaluate_unaware(self, need, t, q, qd, terms, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type), intent(inout) :: terms
        integer, intent(out) :: stat

        stat = -1
        select type (self)
        class is (unaware_vehicle_type)
            self%inner%segment = merge(1, 2, t < two_pi)
            call self%inner%evaluate(need, t, q, qd, terms, stat)
        end select
    end subroutine evaluate_unaware

    !> The control of the order through 2 pi, which the suite `order` measures: if a step crosses the kink, its error is of order
    !> one or two.
    subroutine test_unaware(error)
        type(error_type), allocatable, intent(out) :: error
        type(unaware_vehicle_type), target :: unaware
        class(model_type), allocatable, target :: vehicle
        type(reference_type) :: table
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: with, without

        call read_reference('vehicle', table)
        call new_scene('vehicle', vehicle)
        call unaware%inner%define()
        call unaware%define()
        unaware%evaluate => evaluate_unaware
        unaware%breakpoints = [real(wp) ::]
        associate (q => table%q(:, 1), qd => table%qd(:, 1), truth => table%q_at(10.0_wp))
            call run(simulation, vehicle, choose(step=0.025_wp), 0.0_wp, q, qd, 10.0_wp, failure)
            call check_no_failure(error, failure)
            with = maxval(abs(simulation%state%q - truth))
            call run(simulation, unaware, choose(step=0.025_wp), 0.0_wp, q, qd, 10.0_wp, failure)
            call check_no_failure(error, failure)
            without = maxval(abs(simulation%state%q - truth))
        end associate
        ! Truncation, 5.5e-10, against h**2 = 6e-4 times a jump of 0.04 rad/s**2 and a lever of 60 m.
        call check_below(error, with, 1.1e-9_wp, 'error with a breakpoint')
        call check_true(error, without > 1.0e3_wp*with, 'without a breakpoint the error is larger by decades')
    end subroutine test_unaware

    !> Both motorcycles at 2 pi against an independent solution from the left and an independent projection.
    subroutine test_motorcycle(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=10), parameter :: scenes(2) = [character(len=10) :: 'motorcycle', 'chopper']
        class(model_type), allocatable, target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(failure_type), allocatable :: failure
        type(kkt_type) :: independent
        real(wp), allocatable :: q(:), qd(:)
        real(wp) :: q_jump(10), before(10), after(10), jump
        character(len=:), allocatable :: what
        integer :: i, k

        do k = 1, size(scenes)
            call new_scene(trim(scenes(k)), model)
            call get_start(trim(scenes(k)), q, qd)
            q_jump = q
            before = qd
            call solve_independently(model, 0.0_wp, nearest(two_pi, -1.0_wp), 0.05_wp, q_jump, before)
            model%segment = 2
            independent%model => model
            after = before
            call independent%project(two_pi, q_jump, after)
            jump = maxval(abs(after - before))
            call check_true(error, jump > 1.0e-4_wp, trim(scenes(k))//' does jump')
            do i = 1, size(stepper_names)
                if (stepper_names(i) == 'trapezoid') cycle
                what = trim(scenes(k))//' with '//trim(stepper_names(i))
                call run(simulation, model, choose(step=5.0e-3_wp, stepper=trim(stepper_names(i))), 0.0_wp, q, qd, two_pi, failure)
                call check_no_failure(error, failure)
                ! Truncation at h = 5e-3 is below 1e-11; 100 m carry 1e-12 of rounding and of Newton's remainders each.
                call check_close(error, simulation%state%q, q_jump, 5.0e-10_wp, what//': q')
                call check_close(error, simulation%state%qd, after, 5.0e-11_wp, what//': qd')
                statistics = simulation%statistics()
                call check_below(error, abs(statistics%velocity_jump - jump), 1.0e-12_wp, what//': error of velocity_jump')
            end do
            ! The trapezoid's qd has its own truncation error, but its jump is the same up to that of the jump.
            call run(simulation, model, choose(step=5.0e-3_wp, stepper='trapezoid'), 0.0_wp, q, qd, two_pi, failure)
            call check_no_failure(error, failure)
            statistics = simulation%statistics()
            call check_below(error, abs(statistics%velocity_jump/jump - 1), 1.0e-4_wp, trim(scenes(k))//' with trapezoid: jump')
        end do
    end subroutine test_motorcycle

    subroutine test_sleigh_implicit(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: large, small

        call measure_sleigh('sdirk54', 0.04_wp, large, error)
        call measure_sleigh('sdirk54', 0.02_wp, small, error)
        call check_below(error, large, 4.0e-6_wp, 'error of sdirk54 at h = 0.04')
        call check_below(error, small/large, 2.0_wp**(-3.85_wp), 'ratio of the errors of sdirk54')
        call measure_sleigh('trapezoid', 0.04_wp, large, error)
        call measure_sleigh('trapezoid', 0.02_wp, small, error)
        call check_below(error, large, 4.0e-3_wp, 'error of the trapezoid at h = 0.04')
        call check_below(error, small/large, 2.0_wp**(-1.85_wp), 'ratio of the errors of the trapezoid')
    end subroutine test_sleigh_implicit

    !> For any number of calls, the run stays before the jump, in a consistent state, until the jump is declared.
    subroutine test_undeclared(error)
        type(error_type), allocatable, intent(out) :: error
        type(sleigh_type), target :: model
        type(simulation_type) :: once, simulation
        type(failure_type), allocatable :: failure
        real(wp) :: q(3), qd(3)
        integer :: i, k

        do k = 1, size(stepper_names)
            call model%define(jump_at)
            model%segment = 1
            call model%motion(0.0_wp, sleigh_start, q, qd)
            call run(once, model, choose(step=0.01_wp, stepper=trim(stepper_names(k))), 0.0_wp, q, qd, 1.0_wp, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            model%nu_jumps = [.false.]
            call run(simulation, model, choose(step=0.01_wp, stepper=trim(stepper_names(k))), 0.0_wp, q, qd, 1.0_wp, failure)
            do i = 1, 2
                call check_failure(error, failure, 'constraints_not_held', 'velocity constraint')
                call check_count(error, model%segment, 1, 'segment')
                associate (state => simulation%state)
                    call check_below(error, abs(sin(state%q(3))*state%qd(1) - cos(state%q(3))*state%qd(2) &
                        - model%arm*state%qd(3) - model%slip(state%t, state%q(2))), 1.0e-11_wp, 'velocity constraint')
                end associate
                if (allocated(error)) return
                call simulation%integrate(1.0_wp, failure)
            end do
            model%nu_jumps = [.true.]
            call simulation%integrate(1.0_wp, failure)
            call check_no_failure(error, failure)
            call check_close(error, simulation%state%q, once%state%q, 1.0e-12_wp, trim(stepper_names(k))//': q')
            if (allocated(error)) return
        end do
    end subroutine test_undeclared

    !> If the first call ends on the grid the runs are identical to the last bit; if it ends off the grid, the next steps return to
    !> it.
    subroutine test_two_calls(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: model
        type(simulation_type) :: once, twice
        type(failure_type), allocatable :: failure
        type(time_watch_type) :: watch
        real(wp), allocatable :: q(:), qd(:)
        real(wp) :: expected(10)
        integer :: i

        call new_scene('motorcycle', model)
        call get_start('motorcycle', q, qd)
        do i = 1, size(stepper_names)
            call run(once, model, choose(step=0.0625_wp, stepper=trim(stepper_names(i))), 0.0_wp, q, qd, 8.0_wp, failure)
            call check_no_failure(error, failure)
            expected = once%state%q
            call run(twice, model, choose(step=0.0625_wp, stepper=trim(stepper_names(i))), 0.0_wp, q, qd, 5.0_wp, failure)
            call check_no_failure(error, failure)
            if (.not. allocated(error)) call twice%integrate(8.0_wp, failure)
            call check_no_failure(error, failure)
            call check_close(error, twice%state%q, expected, 0.0_wp, trim(stepper_names(i))//': q')
        end do
        call run(twice, model, choose(step=0.0625_wp), 0.0_wp, q, qd, 0.15_wp, failure)
        call check_no_failure(error, failure)
        call twice%integrate(0.3_wp, failure, watch)
        call check_no_failure(error, failure)
        call check_close(error, watch%t(:watch%n), [0.1875_wp, 0.25_wp, 0.3_wp], 0.0_wp, 'times of the second call')
    end subroutine test_two_calls
end module test_breakpoints
