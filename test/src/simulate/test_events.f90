! SPDX-License-Identifier: MIT
!> Tests of events: their times, the counted ones, and the unchanged motion.
module test_events
    use asserts, only: check_below, check_close, check_count, check_failure, check_no_failure, check_text, check_true
    use event_kinds, only: new_time_event, time_event_type
    use model_knife_edge, only: knife_edge_type
    use model_particle, only: particle_type
    use runs, only: choose, get_start, new_scene
    use tandem, only: change_stepper, at_step, chart_policies, event_type, failure_type => error_type, long, &
        model_type, observer_type, options_type, refresh_modes, rolling_disk_type, simulation_type, statistics_type, &
        stepper_names, threshold_event_type, wp
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_events

    real(wp), parameter :: pi = acos(-1.0_wp)

    !> Evaluates between steps like output at an interval.
    type, extends(observer_type) :: between_type
        integer :: looks = 0
    contains
        procedure :: observe => look_between
    end type between_type

contains

    !> The tests of this suite.
    subroutine collect_events(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('thresholds-agree-with-the-closed-form', test_closed_form), &
            new_unittest('thresholds-agree-for-all-charts-and-modes', test_all_charts), &
            new_unittest('functions-of-time-are-found-to-their-resolution', test_time), &
            new_unittest('directions-choose', test_directions), &
            new_unittest('a-touch-counts-without-a-direction', test_touch), &
            new_unittest('a-touch-counts-once-wherever-the-steps-lie', test_touch_anywhere), &
            new_unittest('a-dip-crosses-twice-within-a-step', test_dip), &
            new_unittest('a-zero-at-the-end-of-a-step-counts-once', test_step_end), &
            new_unittest('a-zero-at-the-start-of-the-run-counts-once', test_run_start), &
            new_unittest('a-zero-at-the-end-of-the-run-counts-once', test_run_end), &
            new_unittest('zeros-beside-breakpoints-are-found', test_breakpoints), &
            new_unittest('a-plateau-is-one-event', test_plateau), &
            new_unittest('a-jump-is-found-where-it-is', test_jump), &
            new_unittest('an-event-that-is-added-late-counts-from-there', test_late), &
            new_unittest('records-leave-the-steps-alone', test_neutral), &
            new_unittest('without-events-nothing-is-evaluated', test_nothing), &
            new_unittest('max-events-ends-a-run', test_max_events), &
            new_unittest('functions-that-fail-are-named', test_failures)]
    end subroutine collect_events

    !> A knife edge with four thresholds, and their zeros in closed form: phi = 0.9, xd = 0, lambda = 4 twice.
    subroutine watch_knife_edge(model, events, times)
        type(knife_edge_type), intent(inout) :: model
        type(threshold_event_type), intent(out) :: events(3)
        real(wp), intent(out) :: times(4)
        real(wp) :: phi

        call model%define()
        events(1) = threshold_event_type(name='phi', quantity='q', index=3, value=0.9_wp)
        events(2) = threshold_event_type(name='xd', quantity='qd', index=1)
        events(3) = threshold_event_type(name='lambda', quantity='lambda', index=1, value=4.0_wp)
        associate (slope => model%g_sin_alpha/model%w)
            phi = asin((4.0_wp/model%m - model%w*(model%u0 - slope*sin(model%phi0)))/(2*model%g_sin_alpha))
        end associate
        times = ([phi, 0.9_wp, 0.5_wp*pi, pi - phi] - model%phi0)/model%w
    end subroutine watch_knife_edge

    !> Run the knife edge with its events and compare their times; positions agree with the dense output's own zeros.
    subroutine compare(options, bound, error)
        type(options_type), intent(in) :: options
        !> Of the times.
        real(wp), intent(in) :: bound
        type(error_type), allocatable, intent(out) :: error
        type(knife_edge_type), target :: model
        type(threshold_event_type), target :: events(3)
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: times(4), q(3), qd(3), qdd(3), lambda(1)
        character(len=:), allocatable :: what
        integer :: i

        what = trim(options%stepper)//', '//trim(options%chart)//', '//trim(options%refresh)
        call watch_knife_edge(model, events, times)
        call model%solution(0.0_wp, q, qd, qdd, lambda)
        call simulation%initialize(model, options, 0.0_wp, q, qd, failure)
        do i = 1, 3
            call simulation%add_event(events(i))
        end do
        if (.not. allocated(failure)) call simulation%integrate(1.5_wp, failure)
        call check_no_failure(error, failure)
        call check_count(error, simulation%n_events, 4, what//': events')
        if (allocated(error)) return
        call check_close(error, simulation%events(:4)%t, times, bound, what//': times')
        call check_true(error, all(simulation%events(:4)%number == [3, 1, 2, 3]), what//': numbers')
        call check_true(error, all(simulation%events(:4)%direction == [1, 1, -1, -1]), what//': directions')
        call check_text(error, simulation%events(3)%name, 'xd')
        associate (phi => simulation%events(2), xd => simulation%events(3))
            ! Rates of up to 5; 1e-12 of a step of up to 0.5, and rounding of the quantity.
            call check_below(error, abs(phi%q(3) - 0.9_wp), 1.0e-12_wp, what//': phi at its zero')
            call check_below(error, abs(xd%qd(1)), 2.5e-12_wp, what//': xd at its zero')
            call check_true(error, phi%q(3) >= 0.9_wp .and. xd%qd(1) <= 0.0_wp, what//': behind the zero')
        end associate
    end subroutine compare

    !> All steppers, fixed and controlled.
    subroutine test_closed_form(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options
        ! Global errors with h = 0.02, a multiple of the measured ones; for radau5 that of its dense output, h**4.
        real(wp), parameter :: bound(6) = [1.0e-6_wp, 1.0e-8_wp, 1.0e-11_wp, 1.0e-3_wp, 1.0e-6_wp, 1.0e-6_wp]
        integer :: k

        do k = 1, size(stepper_names)
            call compare(options_type(stepper=stepper_names(k), step=0.02_wp), bound(k), error)
            if (allocated(error)) return
            if (stepper_names(k) == 'rk4') cycle
            options = options_type(stepper=stepper_names(k), rtol=1.0e-8_wp)
            if (stepper_names(k) == 'trapezoid') options%rtol = 1.0e-6_wp
            ! The usual factor between a tolerance and a global error.
            call compare(options, 100*options%rtol, error)
            if (allocated(error)) return
        end do
    end subroutine test_closed_form

    subroutine test_all_charts(error)
        type(error_type), allocatable, intent(out) :: error
        integer :: i, j, k

        do k = 1, size(stepper_names), 2
            do j = 1, size(chart_policies)
                do i = 1, size(refresh_modes)
                    call compare(choose(stepper=stepper_names(k), step=0.01_wp, chart=chart_policies(j), v_limit=0.2_wp, &
                        refresh=refresh_modes(i)), 1.0e-5_wp, error)
                    if (allocated(error)) return
                end do
            end do
        end do
    end subroutine test_all_charts

    !> A free particle with the step h until t_end, watched by functions of time.
    subroutine watch_time(events, h, t_end, simulation, failure, breakpoints, stepper)
        type(time_event_type), intent(inout), target :: events(:)
        real(wp), intent(in) :: h, t_end
        type(simulation_type), intent(inout) :: simulation
        type(failure_type), allocatable, intent(out) :: failure
        real(wp), intent(in), optional :: breakpoints(:)
        character(len=*), intent(in), optional :: stepper
        type(particle_type), allocatable, save, target :: model
        type(options_type) :: options
        integer :: i

        if (allocated(model)) deallocate (model)
        allocate (model)
        call model%define(.true.)
        if (present(breakpoints)) model%breakpoints = breakpoints
        options%step = h
        if (present(stepper)) options%stepper = stepper
        call simulation%initialize(model, options, 0.0_wp, [0.0_wp, 0.0_wp, 0.0_wp], [0.0_wp, 1.0_wp, 0.0_wp], failure)
        do i = 1, size(events)
            call simulation%add_event(events(i))
        end do
        if (.not. allocated(failure)) call simulation%integrate(t_end, failure)
    end subroutine watch_time

    !> Check times and directions of all events.
    subroutine check_events(error, simulation, failure, times, directions, bound, what)
        type(error_type), allocatable, intent(inout) :: error
        type(simulation_type), intent(in) :: simulation
        type(failure_type), allocatable, intent(in) :: failure
        real(wp), intent(in) :: times(:), bound
        integer, intent(in) :: directions(:)
        character(len=*), intent(in) :: what

        call check_no_failure(error, failure)
        call check_count(error, simulation%n_events, size(times), what//': events')
        if (allocated(error)) return
        if (size(times) == 0) return
        call check_close(error, simulation%events(:size(times))%t, times, bound, what//': times')
        call check_true(error, all(simulation%events(:size(times))%direction == directions), what//': directions')
    end subroutine check_events

    !> To 1e-12 of the step, if g itself is that accurate.
    subroutine test_time(error)
        type(error_type), allocatable, intent(out) :: error
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(time_event_type), target :: events(2)
        integer :: k

        do k = 1, size(stepper_names)
            events = [new_time_event('line', 0.4321_wp), new_time_event('sine', 0.05_wp, direction=-1)]
            call watch_time(events, 0.1_wp, 0.9_wp, simulation, failure, stepper=stepper_names(k))
            call check_events(error, simulation, failure, &
                [0.05_wp*pi, 0.4321_wp, 0.15_wp*pi, 0.25_wp*pi], [-1, 1, -1, -1], 1.0e-13_wp, trim(stepper_names(k)))
            if (allocated(error)) return
        end do
    end subroutine test_time

    subroutine test_directions(error)
        type(error_type), allocatable, intent(out) :: error
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp), parameter :: zeros(3) = 0.05_wp*pi*[1, 2, 3]
        type(time_event_type), target :: events(1)

        ! It starts at zero, rising, which counts for both and for rising.
        events = new_time_event('sine', 0.05_wp)
        call watch_time(events, 0.02_wp, 0.5_wp, simulation, failure)
        call check_events(error, simulation, failure, [0.0_wp, zeros], [0, -1, 1, -1], 1.0e-13_wp, 'both')
        events = new_time_event('sine', 0.05_wp, direction=1)
        call watch_time(events, 0.02_wp, 0.5_wp, simulation, failure)
        call check_events(error, simulation, failure, [0.0_wp, zeros(2)], [0, 1], 1.0e-13_wp, 'rising')
        events = new_time_event('sine', 0.05_wp, direction=-1)
        call watch_time(events, 0.02_wp, 0.5_wp, simulation, failure)
        call check_events(error, simulation, failure, zeros([1, 3]), [-1, -1], 1.0e-13_wp, 'falling')
    end subroutine test_directions

    subroutine test_touch(error)
        type(error_type), allocatable, intent(out) :: error
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(time_event_type), target :: events(3)

        events = [new_time_event('square', 0.333_wp), new_time_event('square', 0.333_wp, direction=1), &
            new_time_event('square', 0.333_wp, direction=-1)]
        call watch_time(events, 0.1_wp, 1.0_wp, simulation, failure)
        ! An extremum is known to the square root of rounding, in parts of a step.
        call check_events(error, simulation, failure, [0.333_wp], [0], 1.0e-8_wp, 'touch')
        call check_count(error, simulation%events(1)%number, 1, 'number')
        ! 1e-8 above zero does not count as a touch: it is 1e-6 of the largest g in the step.
        events = new_time_event('square', 0.333_wp, depth=-1.0e-8_wp)
        call watch_time(events, 0.1_wp, 1.0_wp, simulation, failure)
        call check_events(error, simulation, failure, [real(wp) ::], [integer ::], 0.0_wp, 'near miss')
    end subroutine test_touch

    !> Every place of the touch in the step, including its ends and their neighbourhoods.
    subroutine test_touch_anywhere(error)
        type(error_type), allocatable, intent(out) :: error
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(time_event_type), target :: events(1)
        real(wp), parameter :: near(8) = [0.0_wp, 1.0e-9_wp, 1.0e-7_wp, 1.0e-5_wp, 1.0e-4_wp, 1.0e-3_wp, 1.0_wp/256, 0.01_wp]
        real(wp) :: at
        integer :: i, sign_

        do i = -39, 40
            at = 0.5_wp + 0.00125_wp*i
            events = new_time_event('square', at)
            call watch_time(events, 0.1_wp, 1.0_wp, simulation, failure)
            call check_events(error, simulation, failure, [at], [0], 1.0e-8_wp, 'touch')
            if (allocated(error)) return
        end do
        do i = 1, size(near)
            do sign_ = -1, 1, 2
                at = 0.5_wp + 0.1_wp*sign_*near(i)
                events = new_time_event('square', at)
                call watch_time(events, 0.1_wp, 1.0_wp, simulation, failure)
                ! Within 3e-7 of a step from its end it counts as at the end.
                call check_events(error, simulation, failure, [at], [0], 4.0e-8_wp, 'touch near the end of a step')
                if (allocated(error)) return
            end do
        end do
    end subroutine test_touch_anywhere

    subroutine test_dip(error)
        type(error_type), allocatable, intent(out) :: error
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(time_event_type), target :: events(1)
        real(wp) :: at, half
        integer :: i, k

        do k = 2, 7
            half = 10.0_wp**(-k)
            do i = -19, 20
                at = 0.5_wp + 0.0025_wp*i
                ! For (t - at)**2, half**2 is below the part of 0.01 that counts as a touch.
                if (half**2 < 1.0e-9_wp*0.01_wp) cycle
                events = new_time_event('square', at, depth=half**2)
                call watch_time(events, 0.1_wp, 1.0_wp, simulation, failure)
                ! g is good to 1e-17, its slope is 2 half.
                call check_events(error, simulation, failure, at + half*[-1, 1], [-1, 1], 1.0e-13_wp + 1.0e-16_wp/half, 'dip')
                if (allocated(error)) return
            end do
        end do
    end subroutine test_dip

    subroutine test_step_end(error)
        type(error_type), allocatable, intent(out) :: error
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(time_event_type), target :: events(1)
        real(wp) :: at
        integer :: i, direction

        ! 0.1 k, its neighbours, and their rounded values.
        do i = -60, 60
            at = 0.5_wp + i*merge(1.0e-15_wp, spacing(0.5_wp), mod(i, 2) == 0)
            do direction = 0, 1
                events = new_time_event('line', at, direction=direction)
                call watch_time(events, 0.1_wp, 1.0_wp, simulation, failure)
                call check_events(error, simulation, failure, [at], [1], 1.0e-13_wp, 'line')
                if (allocated(error)) return
            end do
        end do
        events = new_time_event('cubic', 0.5_wp)
        call watch_time(events, 0.1_wp, 1.0_wp, simulation, failure)
        ! Zero up to 1e-13 of its largest value, 0.1**3: within 5e-6.
        call check_events(error, simulation, failure, [0.5_wp], [1], 5.0e-6_wp, 'cubic')
        if (allocated(error)) return
        events = new_time_event('square', 0.5_wp)
        call watch_time(events, 0.1_wp, 1.0_wp, simulation, failure)
        call check_events(error, simulation, failure, [0.5_wp], [0], 1.0e-15_wp, 'square')
    end subroutine test_step_end

    subroutine test_run_start(error)
        type(error_type), allocatable, intent(out) :: error
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(time_event_type), target :: events(1)
        integer :: direction

        do direction = -1, 1
            events = new_time_event('line', 0.0_wp, direction=direction)
            call watch_time(events, 0.1_wp, 0.5_wp, simulation, failure)
            call check_events(error, simulation, failure, spread(0.0_wp, 1, merge(0, 1, direction < 0)), &
                spread(0, 1, merge(0, 1, direction < 0)), 0.0_wp, 'line')
            if (allocated(error)) return
            events = new_time_event('zero', 0.0_wp, direction=direction)
            call watch_time(events, 0.1_wp, 0.5_wp, simulation, failure)
            call check_events(error, simulation, failure, spread(0.0_wp, 1, merge(1, 0, direction == 0)), &
                spread(0, 1, merge(1, 0, direction == 0)), 0.0_wp, 'always zero')
            if (allocated(error)) return
        end do
        ! An event that stops there does so once.
        events = new_time_event('line', 0.0_wp, stops=.true.)
        call watch_time(events, 0.1_wp, 0.5_wp, simulation, failure)
        call check_events(error, simulation, failure, [0.0_wp], [0], 0.0_wp, 'stop at the start')
        call check_true(error, simulation%is_stopped .and. .not. simulation%state%t > 0.0_wp, 'it stops at the start')
        call simulation%integrate(0.5_wp, failure)
        call check_events(error, simulation, failure, [0.0_wp], [0], 0.0_wp, 'stop at the start')
        call check_true(error, .not. simulation%is_stopped .and. simulation%state%t >= 0.5_wp, 'it goes on')
    end subroutine test_run_start

    !> At the end, just before it and just after it; a continued run does not count it again.
    subroutine test_run_end(error)
        type(error_type), allocatable, intent(out) :: error
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(time_event_type), target :: events(1)
        real(wp) :: at
        integer :: i, k
        logical :: stops

        do k = 0, 1
            stops = k == 1
            do i = -5, 5
                at = 0.5_wp + i*spacing(0.5_wp)
                events = new_time_event('line', at, stops=stops)
                call watch_time(events, 0.1_wp, 0.5_wp, simulation, failure)
                if (i <= 0) call check_events(error, simulation, failure, [at], [1], 1.0e-13_wp, 'end of the run')
                call check_true(error, simulation%state%t >= 0.5_wp, 'the end is reached')
                if (simulation%n_events > 0) call check_true(error, simulation%is_stopped .eqv. stops, 'is stopped')
                if (.not. allocated(failure)) call simulation%integrate(0.8_wp, failure)
                if (simulation%is_stopped .and. .not. allocated(failure)) call simulation%integrate(0.8_wp, failure)
                call check_events(error, simulation, failure, [at], [1], 1.0e-13_wp, 'the run goes on')
                if (allocated(error)) return
            end do
        end do
    end subroutine test_run_end

    !> Before, at and after a breakpoint that shortens a step, and a g that jumps through zero at a breakpoint.
    subroutine test_breakpoints(error)
        type(error_type), allocatable, intent(out) :: error
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(time_event_type), target :: events(1)
        real(wp), parameter :: offset(5) = [-0.02_wp, -1.0e-14_wp, 0.0_wp, 1.0e-14_wp, 0.02_wp]
        integer :: i
        logical :: stops

        do i = 1, 10
            stops = i > 5
            associate (at => 0.55_wp + offset(1 + mod(i - 1, 5)))
                events = new_time_event('line', at, stops=stops)
                call watch_time(events, 0.1_wp, 1.0_wp, simulation, failure, breakpoints=[0.55_wp])
                call check_events(error, simulation, failure, [at], [1], 1.0e-13_wp, 'line')
                if (stops .and. .not. allocated(failure)) then
                    call check_true(error, simulation%is_stopped, 'stopped')
                    call simulation%integrate(1.0_wp, failure)
                    call check_events(error, simulation, failure, [at], [1], 1.0e-13_wp, 'line')
                end if
                call check_count(error, simulation%model%segment, 2, 'segment')
                if (allocated(error)) return
            end associate
        end do
        events = new_time_event('jump', 0.55_wp, direction=-1)
        call watch_time(events, 0.1_wp, 1.0_wp, simulation, failure, breakpoints=[0.55_wp])
        call check_events(error, simulation, failure, [0.55_wp], [-1], 1.0e-13_wp, 'jump')
    end subroutine test_breakpoints

    subroutine test_plateau(error)
        type(error_type), allocatable, intent(out) :: error
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(time_event_type), target :: events(1)

        events = new_time_event('plateau', 0.53_wp)
        call watch_time(events, 0.1_wp, 1.0_wp, simulation, failure)
        ! g never changes its sign: it is detected with the next step.
        call check_events(error, simulation, failure, [0.6_wp], [0], 1.0e-13_wp, 'plateau')
    end subroutine test_plateau

    subroutine test_jump(error)
        type(error_type), allocatable, intent(out) :: error
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(time_event_type), target :: events(1)

        events = new_time_event('jump', 0.53_wp)
        call watch_time(events, 0.1_wp, 1.0_wp, simulation, failure)
        call check_events(error, simulation, failure, [0.53_wp], [-1], 1.0e-13_wp, 'jump')
        call check_true(error, events(1)%calls < 250, 'bounded work')
    end subroutine test_jump

    subroutine test_late(error)
        type(error_type), allocatable, intent(out) :: error
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(time_event_type), target :: events(1), late(2)

        events = new_time_event('line', 0.1_wp)
        call watch_time(events, 0.1_wp, 0.5_wp, simulation, failure)
        late = [new_time_event('line', 0.3_wp), new_time_event('line', 0.65_wp)]
        call simulation%add_event(late(1))
        call simulation%add_event(late(2))
        if (.not. allocated(failure)) call simulation%integrate(1.0_wp, failure)
        call check_events(error, simulation, failure, [0.1_wp, 0.65_wp], [1, 1], 1.0e-13_wp, 'late')
    end subroutine test_late

    subroutine look_between(self, simulation, occasion, error)
        class(between_type), intent(inout) :: self
        class(simulation_type), intent(inout) :: simulation
        integer, intent(in) :: occasion
        type(failure_type), allocatable, intent(out) :: error

        if (occasion /= at_step) return
        self%looks = self%looks + 1
        call simulation%look_at(simulation%state%t - 0.3_wp*simulation%last_step, error)
        call simulation%look_back()
    end subroutine look_between

    !> Every stepper, policy and mode, fixed and controlled, with and without looks: bitwise the same end, unless the motion within
    !> a step with an event was off by too much, so that it was made again.
    subroutine test_neutral(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: rtol = 1.0e-5_wp
        type(rolling_disk_type), target :: disk
        type(threshold_event_type), target :: events(2)
        type(time_event_type), target :: touch
        type(between_type) :: between
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        type(statistics_type) :: statistics
        real(wp) :: q(9), qd(9), expected(9, 2), allowed
        integer(long) :: rejected
        integer :: i, j, k, l

        rejected = 0
        call disk%define()
        call disk%start([-1.0_wp, 0.01_wp, 0.0_wp], 0.1_wp, q, qd)
        events(1) = threshold_event_type(name='x', quantity='q', index=1, value=0.5_wp*(q(1) + q(1) + 0.3_wp*qd(1)))
        events(2) = threshold_event_type(name='lambda', quantity='lambda', index=2)
        touch = new_time_event('square', 0.1234_wp)
        do k = 1, size(stepper_names)
            do j = 1, size(chart_policies)
                do i = 1, 3
                    options = choose(stepper=stepper_names(k), step=0.02_wp, chart=chart_policies(j), v_limit=0.1_wp)
                    if (i == 2) options%refresh = 'refine'
                    if (i == 3 .and. stepper_names(k) /= 'rk4') call change_stepper(options, options%stepper, rtol=rtol)
                    do l = 1, 3
                        call simulation%initialize(disk, options, 0.0_wp, q, qd, failure)
                        if (l > 1 .and. .not. allocated(failure)) then
                            call simulation%add_event(events(1))
                            call simulation%add_event(events(2))
                            call simulation%add_event(touch)
                        end if
                        if (allocated(failure)) exit
                        if (l < 3) call simulation%integrate(0.3_wp, failure)
                        if (l == 3) call simulation%integrate(0.3_wp, failure, between)
                        call check_no_failure(error, failure)
                        if (allocated(error)) return
                        statistics = simulation%statistics()
                        if (l == 1) then
                            expected = reshape([simulation%state%q, simulation%state%qd], [9, 2])
                            rejected = statistics%rejected
                        end if
                        allowed = merge(0.0_wp, 10*rtol, statistics%rejected == rejected)
                        call check_true(error, i == 3 .or. statistics%rejected == rejected, 'fixed steps are kept')
                        call check_close(error, simulation%state%q, expected(:, 1), allowed, trim(stepper_names(k))//', q')
                        call check_close(error, simulation%state%qd, expected(:, 2), allowed, trim(stepper_names(k))//', qd')
                        if (l > 1) call check_true(error, simulation%n_events > 1, 'there are events')
                        if (allocated(error)) return
                    end do
                end do
            end do
        end do
    end subroutine test_neutral

    subroutine test_nothing(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)

        call new_scene('disk', model)
        call get_start('disk', q, qd)
        call simulation%initialize(model, options_type(step=1.0e-3_wp), 0.0_wp, q, qd, failure)
        if (.not. allocated(failure)) call simulation%integrate(0.05_wp, failure)
        call check_no_failure(error, failure)
        statistics = simulation%statistics()
        call check_count(error, statistics%event_evaluations, 0, 'evaluations')
        call check_true(error, .not. allocated(simulation%events) .and. simulation%n_events == 0, 'no events')
        ! Four stages and the end of each of the 50 steps, and the start.
        call check_count(error, statistics%right_hand_sides, 201, 'right-hand sides')
    end subroutine test_nothing

    !> The run ends at the first event beyond the limit, and keeps the previous ones.
    subroutine test_max_events(error)
        type(error_type), allocatable, intent(out) :: error
        type(particle_type), target :: model
        type(time_event_type), target :: event
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure

        call model%define(.true.)
        options = options_type(step=0.1_wp, max_events=3)
        call simulation%initialize(model, options, 0.0_wp, [0.0_wp, 0.0_wp, 0.0_wp], [0.0_wp, 0.0_wp, 0.0_wp], failure)
        event = new_time_event('sine', 0.05_wp, direction=-1)
        call simulation%add_event(event)
        call simulation%integrate(2.0_wp, failure)
        call check_failure(error, failure, 'event_limit', 'max_events = 3')
        call check_count(error, simulation%n_events, 3, 'events')
        call check_below(error, abs(simulation%state%t - 0.05_wp*7*pi), 1.0e-13_wp, 'distance from the fourth')
        ! q'' = 1: the state is that of the time.
        call check_below(error, abs(simulation%state%q(1) - simulation%state%t**2/2), 1.0e-14_wp, 'error of q')
    end subroutine test_max_events

    subroutine test_failures(error)
        type(error_type), allocatable, intent(out) :: error
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(time_event_type), target :: events(1)
        type(threshold_event_type), target :: threshold
        type(particle_type), target :: model

        events = new_time_event('nan', 0.35_wp)
        call watch_time(events, 0.1_wp, 1.0_wp, simulation, failure)
        call check_failure(error, failure, 'not_finite', 'event "nan"')
        call check_below(error, abs(simulation%state%t - 0.3_wp), 1.0e-15_wp, 'distance from the last step')
        call check_below(error, abs(simulation%state%q(1) - 0.045_wp), 1.0e-15_wp, 'error of the last state')
        if (allocated(error)) return
        events = new_time_event('stat', 0.35_wp)
        call watch_time(events, 0.1_wp, 1.0_wp, simulation, failure)
        call check_failure(error, failure, 'callback_failed', 'event "stat" returned the status 7')
        call model%define(.true.)
        call simulation%initialize(model, options_type(step=1.0e-3_wp), 0.0_wp, [0.0_wp, 0.0_wp, 0.0_wp], [0.0_wp, 0.0_wp, &
            0.0_wp], failure)
        threshold = threshold_event_type(name='far', quantity='q', index=4)
        call simulation%add_event(threshold)
        call simulation%integrate(1.0_wp, failure)
        call check_failure(error, failure, 'callback_failed', 'event "far"')
    end subroutine test_failures
end module test_events
