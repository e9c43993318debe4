! SPDX-License-Identifier: MIT
!> Tests of actions of events: stop a run, change the state or the model, restart; and of endless sequences of events.
module test_event_actions
    use asserts, only: check_below, check_close, check_count, check_failure, check_no_failure, check_true
    use event_kinds, only: bounce_type, new_time_event, retune_type, shove_type, time_event_type
    use kkt, only: kkt_type
    use model_particle, only: particle_type
    use model_pendulum, only: pendulum_type
    use event_witness, only: witness_type
    use runs, only: choose, get_start, new_scene
    use tandem, only: change_stepper, chart_policies, failure_type => error_type, model_type, options_type, refresh_modes, &
        simulation_type, statistics_type, stepper_names, threshold_event_type, wp
    use tandem_simulate_statistics, only: by_event
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_event_actions

contains

    !> The tests of this suite.
    subroutine collect_event_actions(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('a-stop-leaves-a-state-on-all-constraints', test_stop), &
            new_unittest('a-stopped-run-goes-on-to-the-same-end', test_goes_on), &
            new_unittest('a-bounce-agrees-with-the-closed-form', test_bounce), &
            new_unittest('a-bounce-agrees-for-controlled-steps', test_controlled_bounce), &
            new_unittest('a-ball-that-comes-to-rest-ends-in-bounded-work', test_zeno), &
            new_unittest('an-action-without-an-effect-is-no-endless-event', test_idle), &
            new_unittest('an-impact-is-projected-in-the-mass-metric', test_impact), &
            new_unittest('a-parameter-change-restarts', test_parameter), &
            new_unittest('a-mass-change-reaches-a-constant-mass', test_mass), &
            new_unittest('an-action-that-leaves-the-constraints-is-refused', test_off), &
            new_unittest('an-action-that-fails-leaves-the-state-before-it', test_failure), &
            new_unittest('two-actions-at-once-are-both-taken', test_two), &
            new_unittest('a-stop-and-a-record-at-once', test_stop_and_record), &
            new_unittest('an-action-at-the-start-is-taken-once', test_start), &
            new_unittest('observers-see-both-sides-of-an-action', test_observer), &
            new_unittest('steps-return-to-their-grid-behind-an-event', test_grid), &
            new_unittest('a-jump-of-the-velocity-is-no-bend-of-the-motion', test_bend)]
    end subroutine collect_event_actions

    !> A pendulum at 0.3 rad with rate 1.
    subroutine start_pendulum(model, simulation, options, failure)
        type(pendulum_type), intent(inout), target :: model
        type(simulation_type), intent(inout) :: simulation
        type(options_type), intent(in) :: options
        type(failure_type), allocatable, intent(out) :: failure
        real(wp) :: q(2), qd(2)

        call model%define()
        call model%start(0.3_wp, 1.0_wp, q, qd)
        call simulation%initialize(model, options, 0.0_wp, q, qd, failure)
    end subroutine start_pendulum

    !> All steppers, policies and modes.
    subroutine test_stop(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(threshold_event_type), target :: event
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: t
        integer :: i, j, k

        event = threshold_event_type(name='bottom', direction=-1, stops=.true., quantity='q', index=1)
        do k = 1, size(stepper_names)
            do j = 1, size(chart_policies)
                do i = 1, size(refresh_modes)
                    options = choose(stepper=stepper_names(k), step=0.01_wp, chart=chart_policies(j), &
                        refresh=refresh_modes(i), v_limit=0.2_wp)
                    call start_pendulum(model, simulation, options, failure)
                    call simulation%add_event(event)
                    if (.not. allocated(failure)) call simulation%integrate(5.0_wp, failure)
                    call check_no_failure(error, failure)
                    call check_true(error, simulation%is_stopped .and. simulation%stopped_by == 'bottom', 'stopped')
                    call check_count(error, simulation%n_events, 1, 'events')
                    if (allocated(error)) return
                    ! 1e-12 of a step at a speed of 1.
                    call check_below(error, abs(simulation%state%q(1)), 1.0e-14_wp, 'distance from the bottom')
                    call check_below(error, maxval(simulation%errors), 1.0e-12_wp, 'constraint errors')
                    associate (q => simulation%state%q, qd => simulation%state%qd, qdd => simulation%state%qdd)
                        call check_below(error, abs(dot_product(q, q) - model%length**2), 1.0e-12_wp, 'rod')
                        call check_below(error, abs(dot_product(q, qd)), 1.0e-12_wp, 'velocity along the rod')
                        call check_below(error, abs(dot_product(q, qdd) + dot_product(qd, qd)), 1.0e-11_wp, 'acceleration')
                    end associate
                    ! The state has been projected onto the constraints once more: roundings of a rod of 1 m.
                    call check_close(error, simulation%events(1)%q, simulation%state%q, 4*epsilon(1.0_wp), 'record')
                    t = simulation%state%t
                    call simulation%integrate(t + 0.1_wp, failure)
                    call check_no_failure(error, failure)
                    call check_true(error, .not. simulation%is_stopped .and. simulation%n_events == 1, 'it goes on')
                    statistics = simulation%statistics()
                    call check_count(error, statistics%charts_by(by_event), 1, 'charts by events')
                    if (allocated(error)) return
                end do
            end do
        end do
    end subroutine test_stop

    !> The end differs by no more than the truncation of shortened steps: for dop853 with h = 0.01 this is rounding.
    subroutine test_goes_on(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(threshold_event_type), target :: event
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: expected(2)
        integer :: n_stops

        call start_pendulum(model, simulation, options_type(stepper='dop853', step=0.01_wp), failure)
        if (.not. allocated(failure)) call simulation%integrate(5.0_wp, failure)
        expected = simulation%state%q
        event = threshold_event_type(name='bottom', stops=.true., quantity='q', index=1)
        call start_pendulum(model, simulation, options_type(stepper='dop853', step=0.01_wp), failure)
        call simulation%add_event(event)
        n_stops = 0
        do while (simulation%state%t < 5.0_wp .and. .not. allocated(failure) .and. n_stops < 100)
            call simulation%integrate(5.0_wp, failure)
            if (simulation%is_stopped) n_stops = n_stops + 1
        end do
        call check_no_failure(error, failure)
        call check_close(error, simulation%state%q, expected, 1.0e-12_wp, 'end')
        ! The period is 1.83 for small swings, a little more for this one.
        call check_count(error, n_stops, 5, 'stops')
        call check_count(error, simulation%n_events, 5, 'events')
    end subroutine test_goes_on

    !> q'' = 1 from rest at 0 towards a wall at q = 1, n times in closed form.
    subroutine bounce(options, n, bound, error)
        type(options_type), intent(in) :: options
        integer, intent(in) :: n
        real(wp), intent(in) :: bound
        type(error_type), allocatable, intent(out) :: error
        type(particle_type), target :: model
        type(bounce_type), target :: wall
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp), parameter :: r = 0.8_wp
        real(wp) :: t(n), t_end, v
        integer :: k

        call model%define(.true.)
        wall = bounce_type(name='wall', direction=1, changes=.true., quantity='q', index=1, value=1.0_wp, restitution=r)
        call simulation%initialize(model, options, 0.0_wp, [0.0_wp, 0.0_wp, 0.0_wp], [0.0_wp, 0.0_wp, 0.0_wp], failure)
        call simulation%add_event(wall)
        t(1) = sqrt(2.0_wp)
        do k = 2, n
            t(k) = t(k - 1) + 2*sqrt(2.0_wp)*r**(k - 1)
        end do
        v = sqrt(2.0_wp)*r**n
        t_end = t(n) + v
        if (.not. allocated(failure)) call simulation%integrate(t_end, failure)
        call check_no_failure(error, failure)
        call check_count(error, simulation%n_events, n, trim(options%stepper)//': bounces')
        if (allocated(error)) return
        call check_close(error, simulation%events(:n)%t, t, bound, trim(options%stepper)//': times')
        ! At the apex.
        call check_close(error, [simulation%state%q(1), simulation%state%qd(1)], [1 - v**2/2, 0.0_wp], bound, &
            trim(options%stepper)//': apex')
    end subroutine bounce

    !> All methods are exact for a parabola: the remainder is 1e-13 of a step for each bounce, and rounding.
    subroutine test_bounce(error)
        type(error_type), allocatable, intent(out) :: error
        integer :: k

        do k = 1, size(stepper_names)
            call bounce(options_type(stepper=stepper_names(k), step=0.1_wp), 6, 1.0e-11_wp, error)
            if (allocated(error)) return
        end do
    end subroutine test_bounce

    subroutine test_controlled_bounce(error)
        type(error_type), allocatable, intent(out) :: error
        integer :: k

        do k = 1, size(stepper_names)
            if (stepper_names(k) == 'rk4') cycle
            call bounce(options_type(stepper=stepper_names(k), rtol=1.0e-6_wp), 6, 1.0e-10_wp, error)
            if (allocated(error)) return
        end do
    end subroutine test_controlled_bounce

    !> Restitution 0.5 comes to rest at 3 sqrt(2), 0.9 at 19 sqrt(2), 0 at sqrt(2): nothing passes the wall.
    subroutine test_zeno(error)
        type(error_type), allocatable, intent(out) :: error
        type(particle_type), target :: model
        type(bounce_type), target :: wall
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), parameter :: r(4) = [0.5_wp, 0.9_wp, 0.1_wp, 0.0_wp], rest(4) = sqrt(2.0_wp)*(1 + 2*r/(1 - r))
        integer :: i, k

        call model%define(.true.)
        do k = 1, size(stepper_names)
            do i = 1, 2*size(r)
                associate (j => 1 + mod(i - 1, size(r)))
                    options = options_type(stepper=stepper_names(k), step=0.01_wp)
                    if (i > size(r) .and. stepper_names(k) /= 'rk4') then
                        call change_stepper(options, options%stepper, rtol=1.0e-6_wp)
                        options%max_step = 0.01_wp
                    end if
                    wall = bounce_type(name='wall', direction=1, changes=.true., quantity='q', index=1, value=1.0_wp, &
                        restitution=r(j))
                    call simulation%initialize(model, options, 0.0_wp, [0.0_wp, 0.0_wp, 0.0_wp], [0.0_wp, 0.0_wp, 0.0_wp], failure)
                    call simulation%add_event(wall)
                    if (.not. allocated(failure)) call simulation%integrate(50.0_wp, failure)
                    call check_failure(error, failure, 'event_limit', 'event "wall"')
                    ! The remainder are flights shorter than 1e-5 of a step: 10 times that for 0.9.
                    call check_below(error, abs(simulation%state%t - rest(j)), 1.0e-4_wp, 'time of rest')
                    call check_below(error, abs(simulation%state%q(1) - 1.0_wp), 1.0e-7_wp, 'distance from the wall')
                    statistics = simulation%statistics()
                    call check_true(error, simulation%n_events < 200, 'few events')
                    call check_true(error, statistics%steps < 3000, 'few steps')
                    if (allocated(error)) return
                end associate
            end do
        end do
    end subroutine test_zeno

    !> An action that does nothing, and one that takes a velocity to zero where there is no force: the motion goes on.
    subroutine test_idle(error)
        type(error_type), allocatable, intent(out) :: error
        type(particle_type), target :: model(2)
        type(bounce_type), target :: event
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        integer :: k

        do k = 1, 2
            call model(k)%define(k == 1)
            event = bounce_type(name='idle', changes=.true., quantity='q', index=1, value=0.5_wp, &
                restitution=merge(-1.0_wp, 0.0_wp, k == 1))
            call simulation%initialize(model(k), options_type(step=0.1_wp), 0.0_wp, [0.0_wp, 0.0_wp, 0.0_wp], &
                [1.0_wp, 0.0_wp, 0.0_wp], failure)
            call simulation%add_event(event)
            if (.not. allocated(failure)) call simulation%integrate(2.0_wp, failure)
            call check_no_failure(error, failure)
            call check_count(error, simulation%n_events, 1, 'events')
            call check_below(error, abs(simulation%state%q(1) - merge(4.0_wp, 0.5_wp, k == 1)), 1.0e-12_wp, 'error of the end')
            if (allocated(error)) return
        end do
    end subroutine test_idle

    !> A velocity that violates the constraints after the action: projected as by a KKT solve.
    subroutine test_impact(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: model
        type(shove_type), target :: event
        type(kkt_type) :: equation
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:), expected(:), qdd(:), lambda(:)
        character(len=8), parameter :: scenes(3) = [character(len=8) :: 'disk', 'vehicle', 'chopper']
        integer :: i, k

        do k = 1, size(scenes)
            call new_scene(trim(scenes(k)), model)
            call get_start(trim(scenes(k)), q, qd)
            event = shove_type()
            event%time_event_type = new_time_event('line', 0.123_wp)
            event%changes = .true.
            event%dqd = [(0.1_wp*sin(real(i, wp)), i=1, model%n)]
            call simulation%initialize(model, options_type(step=0.01_wp), 0.0_wp, q, qd, failure)
            call simulation%add_event(event)
            do while (simulation%n_events == 0 .and. .not. allocated(failure))
                call simulation%step(1.0_wp, failure)
            end do
            call check_no_failure(error, failure)
            if (allocated(error)) return
            equation%model => model
            expected = simulation%events(1)%qd + event%dqd
            allocate (qdd(model%n), lambda(model%n_constraints()))
            call equation%project(simulation%state%t, simulation%state%q, expected)
            call equation%accelerate(simulation%state%t, simulation%state%q, expected, qdd, lambda)
            call check_close(error, simulation%state%q, simulation%events(1)%q, 0.0_wp, 'position')
            ! Rounding of two solution methods; velocities of up to 50, accelerations of up to 1e3.
            call check_close(error, simulation%state%qd, expected, 1.0e-12_wp*maxval(abs(expected)), 'velocity')
            call check_close(error, simulation%state%qdd, qdd, 1.0e-10_wp*maxval(abs(qdd)), 'acceleration')
            call check_true(error, maxval(abs(expected - simulation%events(1)%qd - event%dqd)) > 1.0e-3_wp, 'it is inconsistent')
            statistics = simulation%statistics()
            call check_close(error, [statistics%velocity_jump], [maxval(abs(expected - simulation%events(1)%qd))], 1.0e-11_wp, &
                'velocity jump')
            call check_below(error, maxval(simulation%errors), 1.0e-12_wp, 'constraint errors')
            if (.not. allocated(failure)) call simulation%integrate(0.3_wp, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            deallocate (qdd, lambda)
        end do
    end subroutine test_impact

    !> Gravity changes at the bottom: the energy changes, and is conserved from there on.
    subroutine test_parameter(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(retune_type), target :: event
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: expected
        integer :: k

        do k = 1, size(stepper_names)
            model = pendulum_type()
            event = retune_type(name='side', direction=-1, changes=.true., quantity='q', index=1, value=0.1_wp, m=model%m, g=2.5_wp)
            call start_pendulum(model, simulation, options_type(stepper=stepper_names(k), step=0.002_wp), failure)
            call simulation%add_event(event)
            if (.not. allocated(failure)) call simulation%integrate(2.0_wp, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            associate (first => simulation%events(1), state => simulation%state)
                expected = dot_product(first%qd, first%qd)/2 + 2.5_wp*first%q(2)
                ! The trapezoidal rule with h = 0.002 is good to 1e-6, the others to 1e-9 at least.
                call check_below(error, abs(dot_product(state%qd, state%qd)/2 + 2.5_wp*state%q(2) - expected), &
                    merge(1.0e-5_wp, 1.0e-9_wp, stepper_names(k) == 'trapezoid'), trim(stepper_names(k))//': energy')
            end associate
            if (allocated(error)) return
        end do
    end subroutine test_parameter

    !> Without damping the mass does not affect the motion of a pendulum; the tension of its rod is proportional to it.
    subroutine test_mass(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(retune_type), target :: event
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: lambda(1), speed2

        event = retune_type(name='side', direction=-1, changes=.true., quantity='q', index=1, value=0.1_wp, m=6.0_wp, g=9.81_wp)
        call start_pendulum(model, simulation, options_type(stepper='dop853', step=0.01_wp), failure)
        call simulation%add_event(event)
        do while (simulation%n_events == 0 .and. .not. allocated(failure))
            call simulation%step(5.0_wp, failure)
        end do
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call simulation%multipliers(lambda)
        associate (q => simulation%state%q, qd => simulation%state%qd)
            speed2 = dot_product(qd, qd)
            ! m qdd + q lambda = -m g e_y with q qdd = -qd**2.
            call check_close(error, lambda, [6.0_wp*(speed2 - 9.81_wp*q(2))/model%length**2], 1.0e-11_wp, 'multiplier')
            call check_close(error, simulation%state%qdd, [0.0_wp, -9.81_wp] - q*lambda(1)/6.0_wp, 1.0e-11_wp, 'acceleration')
        end associate
    end subroutine test_mass

    subroutine test_off(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(shove_type), target :: event
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure

        event%time_event_type = new_time_event('line', 0.123_wp)
        event%changes = .true.
        event%dq = [0.1_wp, 0.0_wp]
        call start_pendulum(model, simulation, options_type(step=0.01_wp), failure)
        call simulation%add_event(event)
        if (.not. allocated(failure)) call simulation%integrate(1.0_wp, failure)
        call check_failure(error, failure, 'inconsistent_start', 'away from the constraint "rod"')
        call check_close(error, simulation%state%q, simulation%events(1)%q, 0.0_wp, 'the state before')
        if (allocated(error)) return
        event%dq = [log(-abs(event%at)), 0.0_wp]
        call start_pendulum(model, simulation, options_type(step=0.01_wp), failure)
        call simulation%add_event(event)
        if (.not. allocated(failure)) call simulation%integrate(1.0_wp, failure)
        call check_failure(error, failure, 'not_finite', 'an event at t')
    end subroutine test_off

    subroutine test_failure(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(shove_type), target :: event
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure

        event%time_event_type = new_time_event('line', 0.123_wp)
        event%changes = .true.
        event%fails = .true.
        event%dqd = [1.0_wp, 0.0_wp]
        call start_pendulum(model, simulation, options_type(step=0.01_wp), failure)
        call simulation%add_event(event)
        if (.not. allocated(failure)) call simulation%integrate(1.0_wp, failure)
        call check_failure(error, failure, 'callback_failed', 'the shove')
        ! 1e-13 of a step, and the rounding of two times.
        call check_below(error, abs(simulation%state%t - 0.123_wp), 1.0e-15_wp + 2*spacing(0.123_wp), 'distance from the event')
        call check_close(error, simulation%state%qd, simulation%events(1)%qd, 0.0_wp, 'the velocity before')
    end subroutine test_failure

    !> Two walls that are hit at the same time, found in either order.
    subroutine test_two(error)
        type(error_type), allocatable, intent(out) :: error
        type(particle_type), target :: model
        type(bounce_type), target :: walls(2)
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        integer :: i, k

        call model%define(.true.)
        walls(1) = bounce_type(name='one', direction=1, changes=.true., quantity='q', index=1, value=1.0_wp, restitution=1.0_wp)
        ! The same position, or half of it at half the acceleration: roots of different functions.
        walls(2) = bounce_type(name='two', direction=1, changes=.true., quantity='q', index=3, value=1.0_wp, restitution=0.5_wp)
        do k = 1, size(stepper_names)
            do i = 1, 2
                call simulation%initialize(model, options_type(stepper=stepper_names(k), step=0.1_wp), 0.0_wp, &
                    [0.0_wp, 0.0_wp, 0.0_wp], [0.0_wp, 0.0_wp, 0.0_wp], failure)
                call simulation%add_event(walls(i))
                call simulation%add_event(walls(3 - i))
                if (.not. allocated(failure)) call simulation%integrate(2.0_wp, failure)
                call check_no_failure(error, failure)
                call check_count(error, simulation%n_events, 2, 'events')
                if (allocated(error)) return
                call check_close(error, simulation%events(:2)%t, [sqrt(2.0_wp), sqrt(2.0_wp)], 1.0e-13_wp, 'times')
                associate (dt => 2.0_wp - sqrt(2.0_wp))
                    call check_close(error, simulation%state%q([1, 3]), &
                        1 - [sqrt(2.0_wp), sqrt(0.5_wp)]*dt + dt**2/2, 1.0e-12_wp, 'positions')
                end associate
                if (allocated(error)) return
            end do
        end do
    end subroutine test_two

    !> The record is kept although the other event stops, and is not repeated when the run continues.
    subroutine test_stop_and_record(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(time_event_type), target :: events(2)
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        integer :: i, k
        real(wp), parameter :: at(3) = [0.1234_wp, 0.12_wp, 0.0_wp]

        do k = 1, size(at)
            do i = 1, 2
                events = [new_time_event('line', at(k), stops=i == 1), new_time_event('line', at(k), stops=i == 2)]
                call start_pendulum(model, simulation, options_type(step=0.01_wp), failure)
                call simulation%add_event(events(1))
                call simulation%add_event(events(2))
                if (.not. allocated(failure)) call simulation%integrate(1.0_wp, failure)
                call check_no_failure(error, failure)
                call check_true(error, simulation%is_stopped, 'stopped')
                call check_count(error, simulation%n_events, 2, 'events')
                if (.not. allocated(failure)) call simulation%integrate(1.0_wp, failure)
                call check_no_failure(error, failure)
                call check_count(error, simulation%n_events, 2, 'events')
                if (allocated(error)) return
            end do
        end do
    end subroutine test_stop_and_record

    !> All steppers: the step is repeated from the same time with another state (dop853 must not reuse its stages).
    subroutine test_start(error)
        type(error_type), allocatable, intent(out) :: error
        type(particle_type), target :: model
        type(shove_type), target :: event
        type(threshold_event_type), target :: mark
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        integer :: k

        call model%define(.true.)
        event%time_event_type = new_time_event('line', 0.0_wp)
        event%changes = .true.
        event%dqd = [3.0_wp, 0.0_wp, 0.0_wp]
        mark = threshold_event_type(name='mark', quantity='q', index=1, value=0.5_wp)
        do k = 1, size(stepper_names)
            call simulation%initialize(model, options_type(stepper=stepper_names(k), step=1.0_wp), 0.0_wp, &
                [0.0_wp, 0.0_wp, 0.0_wp], [0.0_wp, 0.0_wp, 0.0_wp], failure)
            call simulation%add_event(event)
            call simulation%add_event(mark)
            if (.not. allocated(failure)) call simulation%integrate(1.0_wp, failure)
            call check_no_failure(error, failure)
            call check_count(error, simulation%n_events, 2, 'events')
            if (allocated(error)) return
            call check_close(error, simulation%events(:2)%t, [0.0_wp, sqrt(10.0_wp) - 3], 1.0e-12_wp, 'times')
            call check_close(error, simulation%state%q(:1), [3.5_wp], 1.0e-13_wp, 'end')
        end do
    end subroutine test_start

    !> Rows that an observer writes within the shortened step are those of the motion before the action.
    subroutine test_observer(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(retune_type), target :: event
        type(shove_type), target :: push
        type(witness_type) :: witness
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        integer :: k

        event = retune_type(name='side', direction=-1, changes=.true., quantity='q', index=1, value=0.1_wp, m=2.0_wp, g=2.0_wp)
        do k = 1, size(stepper_names)
            model = pendulum_type()
            witness = witness_type()
            call start_pendulum(model, simulation, options_type(stepper=stepper_names(k), step=0.01_wp), failure)
            call simulation%add_event(event)
            if (.not. allocated(failure)) call simulation%integrate(1.0_wp, failure, witness)
            call check_no_failure(error, failure)
            call check_count(error, witness%n_events, 1, 'actions')
            ! The force along the path is that of the old gravity, 9.81.
            call check_below(error, witness%between, 1.0e-10_wp, trim(stepper_names(k))//': equation of motion before the event')
            call check_below(error, witness%largest_error, 1.0e-12_wp, 'constraint errors before the event')
            if (allocated(error)) return
        end do
        model = pendulum_type()
        witness = witness_type()
        push%time_event_type = new_time_event('line', 0.123_wp)
        push%changes = .true.
        push%dqd = [1.0_wp, 0.0_wp]
        call start_pendulum(model, simulation, options_type(step=0.01_wp), failure)
        call simulation%add_event(push)
        if (.not. allocated(failure)) call simulation%integrate(0.5_wp, failure, witness)
        call check_no_failure(error, failure)
        call check_close(error, witness%before, simulation%events(1)%qd, 0.0_wp, 'before')
        call check_true(error, maxval(abs(witness%after - witness%before)) > 0.5_wp, 'the shove is seen')
    end subroutine test_observer

    !> The steps after a shortened one end at their original times.
    subroutine test_grid(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(time_event_type), target :: event
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(failure_type), allocatable :: failure
        real(wp), parameter :: at(4) = [0.123_wp, 0.12_wp, 0.12_wp - 1.0e-10_wp, 0.12_wp + 1.0e-10_wp]
        ! A cut at a point of the grid, or just before it, adds no step.
        integer, parameter :: steps(4) = [51, 50, 50, 51]
        integer :: k

        do k = 1, size(at)
            event = new_time_event('line', at(k), stops=.true.)
            call start_pendulum(model, simulation, options_type(step=0.01_wp), failure)
            call simulation%add_event(event)
            if (.not. allocated(failure)) call simulation%integrate(0.5_wp, failure)
            call check_true(error, simulation%is_stopped, 'stopped')
            if (.not. allocated(failure)) call simulation%step(0.5_wp, failure)
            if (k /= 4) call check_below(error, abs(simulation%state%t - 0.13_wp), 1.0e-15_wp, 'distance from the grid')
            if (.not. allocated(failure)) call simulation%integrate(0.5_wp, failure)
            call check_no_failure(error, failure)
            statistics = simulation%statistics()
            call check_count(error, statistics%steps, steps(k), 'steps')
            if (allocated(error)) return
        end do
    end subroutine test_grid

    !> Between kicks a free particle moves straight, for which an implicit stepper needs no small step: its estimate applies to the
    !> motion between events, not to the jumps.
    subroutine test_bend(error)
        type(error_type), allocatable, intent(out) :: error
        type(particle_type), target :: model
        type(shove_type), target :: kick
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(failure_type), allocatable :: failure

        call model%define(.false.)
        kick = shove_type(name='kick', kind='sine', changes=.true., at=0.1_wp, dqd=[1.0_wp, -2.0_wp, 0.0_wp])
        call simulation%initialize(model, options_type(stepper='dopri5', rtol=1.0e-8_wp, max_step=0.05_wp), 0.0_wp, &
            [0.0_wp, 0.0_wp, 0.0_wp], [1.0_wp, 0.0_wp, 0.0_wp], failure)
        call simulation%add_event(kick)
        if (.not. allocated(failure)) call simulation%integrate(3.0_wp, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call check_count(error, simulation%n_events, 10, 'kicks')
        statistics = simulation%statistics()
        call check_below(error, statistics%implicit_part, 1.0e-6_wp, 'what an implicit stepper would cost')
    end subroutine test_bend
end module test_event_actions
