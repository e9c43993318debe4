! SPDX-License-Identifier: MIT
!> Between steps: dense output is available however far a step rotates its chart, and its stated error is realistic.
module test_between
    use asserts, only: check_below, check_between, check_close, check_count, check_no_failure, check_true
    use model_pendulum, only: pendulum_type
    use runs, only: run
    use subjects, only: new_subject
    use tandem, only: failure_type => error_type, find_error_warnings, long, mechanism_type, model_type, options_type, plane_type, &
        ramp, rolling_disk_type, simulation_type, statistics_type, threshold_event_type, to_text, warning_type, wp
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_between

contains

    !> The tests of this suite.
    subroutine collect_between(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('what-is-stated-is-near-the-error', test_stated), &
            new_unittest('errors-stay-within-ten-times-the-tolerance-where-looks-are-expected', test_controlled), &
            new_unittest('steps-are-shortened-where-looks-are-and-nowhere-else', test_expected), &
            new_unittest('steps-for-looks-go-on-as-they-were', test_resumed), &
            new_unittest('events-are-found-within-ten-times-the-tolerance', test_event), &
            new_unittest('the-end-of-a-step-is-no-place-of-large-errors', test_ends), &
            new_unittest('a-step-that-turns-its-chart-over-can-be-looked-into', test_turned), &
            new_unittest('a-ball-on-a-turntable-is-where-it-should-be', test_turntable), &
            new_unittest('an-event-that-never-fires-leaves-the-run-alone', test_silent_event)]
    end subroutine collect_between

    !> A subject or a pendulum that swings far, and its start.
    subroutine new_swing(name, model, q, qd)
        character(len=*), intent(in) :: name
        class(model_type), allocatable, intent(out) :: model
        real(wp), allocatable, intent(out) :: q(:), qd(:)
        type(pendulum_type), allocatable :: pendulum

        if (name /= 'pendulum') then
            call new_subject(name, model, q, qd)
            return
        end if
        allocate (pendulum)
        call pendulum%define()
        allocate (q(2), qd(2))
        call pendulum%start(1.0_wp, 0.0_wp, q, qd)
        call move_alloc(pendulum, model)
    end subroutine new_swing

    !> A coin that turns by more than a right angle within many of its steps.
    subroutine start_coin(coin, q, qd)
        type(rolling_disk_type), intent(inout) :: coin
        real(wp), intent(out) :: q(9), qd(9)

        coin%mass = 0.5_wp
        coin%radius = 0.05_wp
        coin%inertia = [6.25e-4_wp, 3.125e-4_wp, 3.125e-4_wp]
        coin%gravity = 9.81_wp
        call coin%define()
        call coin%start([-30.0_wp, 1.0_wp, 0.0_wp], 0.3_wp, q, qd)
    end subroutine start_coin

    !> The run's largest errors of q and qd at places of all its steps, on the scale 1 + |y|, against a run of a tolerance of 1e-13
    !> that starts where the step does and has steps that end there.
    subroutine measure(name, options, t_end, places, largest, statistics, error, expects_looks)
        character(len=*), intent(in) :: name
        type(options_type), intent(in) :: options
        real(wp), intent(in) :: t_end
        !> Parts of a step, ascending.
        real(wp), intent(in) :: places(:)
        real(wp), intent(out) :: largest(2)
        type(statistics_type), intent(out) :: statistics
        type(error_type), allocatable, intent(out) :: error
        !> Whether the run is told of the looks; default false.
        logical, intent(in), optional :: expects_looks
        class(model_type), allocatable, target :: model, exact_model
        type(simulation_type) :: simulation, exact
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:), q0(:), qd0(:)
        real(wp) :: t0, t
        integer :: i
        logical :: is_told

        is_told = .false.
        if (present(expects_looks)) is_told = expects_looks
        call new_swing(name, model, q, qd)
        call new_swing(name, exact_model, q0, qd0)
        call simulation%initialize(model, options, 0.0_wp, q, qd, failure)
        largest = 0.0_wp
        do while (.not. allocated(failure) .and. simulation%state%t < t_end)
            t0 = simulation%state%t
            q0 = simulation%state%q
            qd0 = simulation%state%qd
            if (is_told) call simulation%expect_look(t0)
            call simulation%step(t_end, failure)
            if (.not. allocated(failure)) call exact%initialize(exact_model, options_type(stepper='dop853', rtol=1.0e-13_wp), t0, &
                q0, qd0, failure)
            do i = 1, size(places)
                if (allocated(failure)) exit
                t = t0 + places(i)*simulation%last_step
                call exact%integrate(t, failure)
                if (.not. allocated(failure)) call simulation%look_at(t, failure)
                associate (a => simulation%state, b => exact%state)
                    largest = max(largest, [maxval(abs(a%q - b%q)/(1.0_wp + abs(b%q))), &
                        maxval(abs(a%qd - b%qd)/(1.0_wp + abs(b%qd)))])
                end associate
                call simulation%look_back()
            end do
        end do
        call check_no_failure(error, failure)
        statistics = simulation%statistics()
    end subroutine measure

    !> The shipped scenes and a pendulum. Ten times either way is what users may rely on, of q and of qd, where the error is above
    !> the tolerance. Nothing is warned of where it is not.
    subroutine test_stated(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=10), parameter :: names(5) = [character(len=10) :: 'disk', 'vehicle', 'motorcycle', 'chopper', 'pendulum']
        character(len=6), parameter :: steppers(2) = ['dop853', 'dopri5']
        real(wp), parameter :: tolerances(4) = [1.0e-4_wp, 1.0e-6_wp, 1.0e-9_wp, 1.0e-11_wp]
        !> Of the disk's dip, and of a lane change.
        real(wp), parameter :: t_end = 5.0_wp
        type(statistics_type) :: statistics
        type(options_type) :: options
        real(wp) :: largest(2)
        integer :: i, j, k, l

        do i = 1, size(names)
            do j = 1, size(steppers)
                do k = 1, size(tolerances)
                    options = options_type(stepper=steppers(j), rtol=tolerances(k))
                    call measure(names(i), options, t_end, [(l/8.0_wp, l=1, 7)], largest, statistics, error)
                    if (allocated(error)) return
                    associate (what => trim(names(i))//', '//steppers(j)//', rtol '//to_text(tolerances(k)))
                        if (largest(1) > tolerances(k)) call check_between(error, statistics%dense_error_q/largest(1), 0.1_wp, &
                            10.0_wp, what//': what is stated of q, over the error')
                        if (allocated(error)) return
                        if (largest(2) > tolerances(k)) call check_between(error, statistics%dense_error_qd/largest(2), 0.1_wp, &
                            10.0_wp, what//': what is stated of qd, over the error')
                        if (allocated(error)) return
                        if (maxval(largest) <= tolerances(k)) call check_true(error, .not. warns(options, statistics), &
                            what//': a false warning')
                    end associate
                    if (allocated(error)) return
                end do
            end do
        end do
    end subroutine test_stated

    !> True if a run warns about its motion between steps.
    logical function warns(options, statistics)
        type(options_type), intent(in) :: options
        type(statistics_type), intent(in) :: statistics
        type(warning_type), allocatable :: doubts(:)
        integer :: i

        allocate (doubts(0))
        call find_error_warnings(options, statistics, doubts)
        warns = .false.
        do i = 1, size(doubts)
            warns = warns .or. index(doubts(i)%text, 'between steps') > 0
        end do
    end function warns

    !> Error control holds the motion between steps within ten times the tolerance, by what it estimates.
    !> Nothing is warned of.
    subroutine test_controlled(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=10), parameter :: names(5) = [character(len=10) :: 'disk', 'vehicle', 'motorcycle', 'chopper', 'pendulum']
        character(len=6), parameter :: steppers(4) = [character(len=6) :: 'dop853', 'dopri5', 'auto', 'radau5']
        real(wp), parameter :: tolerances(3) = [1.0e-4_wp, 1.0e-6_wp, 1.0e-9_wp]
        real(wp), parameter :: t_end = 5.0_wp
        type(statistics_type) :: statistics
        type(options_type) :: options
        real(wp) :: largest(2)
        integer :: i, j, k, l

        do i = 1, size(names)
            do j = 1, size(steppers)
                do k = 1, size(tolerances)
                    options = options_type(stepper=steppers(j), rtol=tolerances(k))
                    call measure(names(i), options, t_end, [(l/8.0_wp, l=1, 7)], largest, statistics, error, expects_looks=.true.)
                    if (allocated(error)) return
                    associate (what => trim(names(i))//', '//trim(steppers(j))//', rtol '//to_text(tolerances(k)))
                        call check_below(error, maxval(largest), 15*tolerances(k), what//': error between steps')
                        if (.not. allocated(error)) call check_true(error, .not. warns(options, statistics), what//': a warning')
                    end associate
                    if (allocated(error)) return
                end do
            end do
        end do
    end subroutine test_controlled

    !> A look that is expected after the end of the run changes nothing; looks within the steps make long ones shorter.
    subroutine test_expected(error)
        type(error_type), allocatable, intent(out) :: error
        !> None, one behind the end, one in every step.
        integer, parameter :: nowhere = 1, behind = 2, everywhere = 3
        real(wp), parameter :: t_end = 5.0_wp
        class(model_type), allocatable, target :: model
        type(simulation_type) :: simulation(3)
        type(statistics_type) :: statistics(3)
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)
        integer :: k

        do k = nowhere, everywhere
            call new_swing('motorcycle', model, q, qd)
            call simulation(k)%initialize(model, options_type(stepper='dop853', rtol=1.0e-6_wp), 0.0_wp, q, qd, failure)
            if (k == behind) call simulation(k)%expect_look(t_end + 1.0_wp)
            do while (.not. allocated(failure) .and. simulation(k)%state%t < t_end)
                if (k == everywhere) call simulation(k)%expect_look(simulation(k)%state%t)
                call simulation(k)%step(t_end, failure)
            end do
            call check_no_failure(error, failure)
            if (allocated(error)) return
            statistics(k) = simulation(k)%statistics()
            deallocate (model)
        end do
        call check_count(error, statistics(behind)%steps, int(statistics(nowhere)%steps), 'steps')
        call check_count(error, statistics(behind)%right_hand_sides, int(statistics(nowhere)%right_hand_sides), &
            'evaluations')
        call check_close(error, simulation(behind)%state%q, simulation(nowhere)%state%q, 0.0_wp, 'q')
        call check_true(error, statistics(everywhere)%steps > statistics(nowhere)%steps, 'shorter steps where somebody looks')
        call check_true(error, statistics(everywhere)%steps < 2*statistics(nowhere)%steps, 'not twice as many')
    end subroutine test_expected

    !> A run whose steps are made for looks is saved after each of them, and goes on bitwise from there.
    subroutine test_resumed(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=6), parameter :: steppers(3) = [character(len=6) :: 'dop853', 'dopri5', 'radau5']
        integer, parameter :: n_steps = 20
        class(model_type), allocatable, target :: model, twin
        type(simulation_type) :: simulation, resumed
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        integer(long), allocatable :: words(:)
        real(wp), allocatable :: q(:), qd(:)
        integer :: i, k

        do k = 1, size(steppers)
            call new_swing('motorcycle', model, q, qd)
            call new_swing('motorcycle', twin, q, qd)
            options = options_type(stepper=steppers(k), rtol=1.0e-6_wp)
            call simulation%initialize(model, options, 0.0_wp, q, qd, failure)
            do i = 1, n_steps
                if (allocated(failure)) exit
                call simulation%expect_look(simulation%state%t + 1.0e-3_wp)
                call simulation%save_state(words, failure)
                if (.not. allocated(failure)) call resumed%initialize(twin, options, 0.0_wp, q, qd, failure)
                if (.not. allocated(failure)) call resumed%restore_state(words, failure)
                if (.not. allocated(failure)) call resumed%step(100.0_wp, failure)
                if (.not. allocated(failure)) call simulation%step(100.0_wp, failure)
                call check_no_failure(error, failure)
                if (allocated(error)) return
                call check_close(error, resumed%state%q, simulation%state%q, 0.0_wp, trim(steppers(k))//': q')
                call check_close(error, [resumed%state%t], [simulation%state%t], 0.0_wp, trim(steppers(k))//': t')
                if (allocated(error)) return
                ! A look leaves no trace.
                call simulation%look_at(simulation%state%t - 0.3_wp*simulation%last_step, failure)
                call simulation%look_back()
            end do
            call check_no_failure(error, failure)
            if (allocated(error)) return
            deallocate (model, twin)
        end do
    end subroutine test_resumed

    !> Values that coordinates of the motorcycle pass in its lane change: what is recorded there is near the motion.
    subroutine test_event(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: times(5) = [0.5_wp, 1.0_wp, 1.5_wp, 2.0_wp, 3.0_wp], rtol = 1.0e-6_wp
        class(model_type), allocatable, target :: model, exact_model
        type(simulation_type) :: simulation, exact
        type(threshold_event_type), allocatable, target :: events(:, :)
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)
        real(wp) :: largest
        integer :: i, k

        call new_swing('motorcycle', exact_model, q, qd)
        call new_swing('motorcycle', model, q, qd)
        allocate (events(size(q), size(times)))
        call exact%initialize(exact_model, options_type(stepper='dop853', rtol=1.0e-12_wp), 0.0_wp, q, qd, failure)
        if (.not. allocated(failure)) call simulation%initialize(model, options_type(stepper='dop853', rtol=rtol), 0.0_wp, q, qd, &
            failure)
        do k = 1, size(times)
            if (.not. allocated(failure)) call exact%integrate(times(k), failure)
            do i = 1, size(q)
                events(i, k) = threshold_event_type(name='passes', quantity='q', index=i, value=exact%state%q(i))
                if (abs(exact%state%qd(i)) > 1.0e-2_wp) call simulation%add_event(events(i, k))
            end do
        end do
        if (.not. allocated(failure)) call simulation%integrate(5.0_wp, failure)
        if (.not. allocated(failure)) call exact%initialize(exact_model, options_type(stepper='dop853', rtol=1.0e-12_wp), 0.0_wp, &
            q, qd, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call check_true(error, simulation%n_events >= 2*size(times), 'events are found')
        largest = 0.0_wp
        do k = 1, simulation%n_events
            associate (a => simulation%events(k), b => exact%state)
                if (a%t > b%t .and. .not. allocated(failure)) call exact%integrate(a%t, failure)
                largest = max(largest, maxval(abs(a%q - b%q)/(1.0_wp + abs(b%q))), maxval(abs(a%qd - b%qd)/(1.0_wp + abs(b%qd))))
            end associate
        end do
        call check_no_failure(error, failure)
        call check_below(error, largest, 15*rtol, 'error at events')
    end subroutine test_event

    !> Beside the ends the interpolant is as good as the step, and what is stated of it is no more than rounding makes of 1e-9.
    subroutine test_ends(error)
        type(error_type), allocatable, intent(out) :: error
        type(statistics_type) :: statistics
        real(wp) :: largest(2)

        call measure('disk', options_type(stepper='dop853', rtol=1.0e-9_wp, projection='stages'), 5.0_wp, [1.0e-6_wp, 1.0e-4_wp, &
            1.0_wp - 1.0e-4_wp, 1.0_wp - 1.0e-6_wp], largest, statistics, error)
        if (allocated(error)) return
        call check_below(error, max(statistics%dense_error_q, statistics%dense_error_qd), 1.0e-9_wp, 'what is stated')
    end subroutine test_ends

    !> Fixed steps of 2.5 rad, and those of error control: every time is available, on the manifold, and near the motion.
    subroutine test_turned(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: tolerances(6) = [3.0e-3_wp, 1.0e-3_wp, 1.0e-4_wp, 1.0e-5_wp, 1.0e-6_wp, 0.0_wp]
        character(len=10), parameter :: charts(2) = [character(len=10) :: 'every_step', 'adaptive']
        type(rolling_disk_type), target :: coin
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: q(9), qd(9), t0
        integer :: i, j, k

        do k = 1, size(charts)
            do i = 1, size(tolerances)
                call start_coin(coin, q, qd)
                options = options_type(stepper='dop853', rtol=tolerances(i), step=merge(0.0_wp, 0.06_wp, tolerances(i) > 0.0_wp), &
                    chart=charts(k))
                call simulation%initialize(coin, options, 0.0_wp, q, qd, failure)
                do while (.not. allocated(failure) .and. simulation%state%t < 2.0_wp)
                    t0 = simulation%state%t
                    call simulation%step(2.0_wp, failure)
                    ! Fixed steps end when one of them fails; the previous ones count.
                    if (allocated(failure) .and. .not. tolerances(i) > 0.0_wp) deallocate (failure)
                    if (simulation%state%t <= t0) exit
                    do j = 1, 15
                        if (allocated(failure)) exit
                        call simulation%look_at(t0 + j*simulation%last_step/16, failure)
                        call check_below(error, maxval(simulation%errors), 1.0e-12_wp, 'constraint error')
                        if (allocated(error)) return
                        call simulation%look_back()
                    end do
                end do
                call check_no_failure(error, failure)
                if (allocated(error)) return
            end do
        end do
    end subroutine test_turned

    !> The centre of a solid ball moves on a circle at 2/7 of the table's rate: Z - Z0 = V0 (exp(i k t) - 1)/(i k). With a tolerance
    !> of 1e-4 it rotates by more than a radian in a step. Errors at the ends of steps add up; between them the additional error is
    !> at most ten times the stated one.
    subroutine test_turntable(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: tolerances(3) = [1.0e-3_wp, 1.0e-4_wp, 1.0e-6_wp]
        real(wp), parameter :: radius = 0.05_wp, mass = 0.2_wp, rate = 5.0_wp, r0(2) = [0.3_wp, 0.0_wp], v0(2) = [0.1_wp, 0.5_wp]
        complex(wp), parameter :: ik = cmplx(0.0_wp, 2*rate/7, wp)
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(failure_type), allocatable :: failure
        real(wp) :: q(7), qd(7), t0, at_ends, between
        integer :: i, j

        call mechanism%add_body('ball', mass, [r0, radius], failure, inertia=spread(0.4_wp*mass*radius**2, 1, 3), &
            velocity=[v0, 0.0_wp], omega=[(rate*r0(1) - v0(2))/radius, (v0(1) + rate*r0(2))/radius, 4.0_wp])
        call check_no_failure(error, failure)
        call mechanism%add_rolling_sphere('rolling', 'ball', radius, failure, plane=plane_type(rotation=ramp(0.0_wp, rate)))
        call check_no_failure(error, failure)
        call mechanism%define(failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call mechanism%start(q, qd)
        do i = 1, size(tolerances)
            call simulation%initialize(mechanism, options_type(stepper='dop853', rtol=tolerances(i)), 0.0_wp, q, qd, failure)
            at_ends = 0.0_wp
            between = 0.0_wp
            do while (.not. allocated(failure) .and. simulation%state%t < 10.0_wp)
                t0 = simulation%state%t
                call simulation%step(10.0_wp, failure)
                at_ends = max(at_ends, error_of_centre())
                do j = 1, 15
                    if (allocated(failure)) exit
                    call simulation%look_at(t0 + j*simulation%last_step/16, failure)
                    between = max(between, error_of_centre())
                    call simulation%look_back()
                end do
            end do
            call check_no_failure(error, failure)
            if (allocated(error)) return
            statistics = simulation%statistics()
            call check_below(error, between, at_ends + 10*max(statistics%dense_error_q, statistics%dense_error_qd), &
                'error of the centre')
            if (allocated(error)) return
        end do

    contains

        !> At the current state, relative.
        real(wp) function error_of_centre()
            complex(wp) :: turned
            real(wp) :: r(2), v(2)

            associate (state => simulation%state)
                turned = cmplx(v0(1), v0(2), wp)*exp(ik*state%t)
                v = [real(turned), aimag(turned)]
                turned = (turned - cmplx(v0(1), v0(2), wp))/ik
                r = r0 + [real(turned), aimag(turned)]
                error_of_centre = max(maxval(abs(state%q(:2) - r)/(1.0_wp + abs(r))), &
                    maxval(abs(state%qd(:2) - v)/(1.0_wp + abs(v))))
            end associate
        end function error_of_centre
    end subroutine test_turntable

    !> A height that the coin does not reach: the run equals the one without the event, except for rounding if a step ends with a
    !> search for pivots, which an evaluation makes it repeat (measured: 6e-15).
    subroutine test_silent_event(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: tolerances(4) = [3.0e-3_wp, 1.0e-4_wp, 1.0e-5_wp, 3.0e-6_wp]
        type(rolling_disk_type), target :: coin
        type(simulation_type) :: simulation, watched
        type(threshold_event_type), target :: event
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: q(9), qd(9)
        integer :: i

        event%index = 3
        event%value = 0.03_wp
        do i = 1, size(tolerances)
            call start_coin(coin, q, qd)
            options = options_type(stepper='dop853', rtol=tolerances(i))
            call run(simulation, coin, options, 0.0_wp, q, qd, 5.0_wp, failure)
            if (.not. allocated(failure)) call watched%initialize(coin, options, 0.0_wp, q, qd, failure)
            call watched%add_event(event)
            if (.not. allocated(failure)) call watched%integrate(5.0_wp, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call check_close(error, watched%state%q, simulation%state%q, 1.0e-11_wp, 'q')
            call check_close(error, watched%state%qd, simulation%state%qd, 1.0e-10_wp, 'qd')
            if (allocated(error)) return
        end do
    end subroutine test_silent_event
end module test_between
