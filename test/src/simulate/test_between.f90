! SPDX-License-Identifier: MIT
!> Between steps: dense output is available however far a step rotates its chart, and its stated error is realistic.
module test_between
    use asserts, only: check_below, check_between, check_close, check_no_failure, check_true
    use model_pendulum, only: pendulum_type
    use model_turntable, only: turntable_type
    use runs, only: run
    use subjects, only: new_subject
    use tandem, only: failure_type => error_type, find_error_warnings, model_type, options_type, rolling_disk_type, &
        simulation_type, statistics_type, threshold_event_type, to_text, warning_type, wp
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

    !> Largest error of a run at places of all its steps, on the scale 1 + |y|, against a run with a tolerance of 1e-13 that starts
    !> at the step's start and has steps that end there.
    subroutine measure(name, options, t_end, places, largest, statistics, error)
        character(len=*), intent(in) :: name
        type(options_type), intent(in) :: options
        real(wp), intent(in) :: t_end
        !> Parts of a step, ascending.
        real(wp), intent(in) :: places(:)
        real(wp), intent(out) :: largest
        type(statistics_type), intent(out) :: statistics
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: model, exact_model
        type(simulation_type) :: simulation, exact
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:), q0(:), qd0(:)
        real(wp) :: t0, t
        integer :: i

        call new_swing(name, model, q, qd)
        call new_swing(name, exact_model, q0, qd0)
        call simulation%initialize(model, options, 0.0_wp, q, qd, failure)
        largest = 0.0_wp
        do while (.not. allocated(failure) .and. simulation%state%t < t_end)
            t0 = simulation%state%t
            q0 = simulation%state%q
            qd0 = simulation%state%qd
            call simulation%step(t_end, failure)
            if (.not. allocated(failure)) call exact%initialize(exact_model, options_type(stepper='dop853', rtol=1.0e-13_wp), t0, &
                q0, qd0, failure)
            do i = 1, size(places)
                if (allocated(failure)) exit
                t = t0 + places(i)*simulation%last_step
                call exact%integrate(t, failure)
                if (.not. allocated(failure)) call simulation%look_at(t, failure)
                associate (a => simulation%state, b => exact%state)
                    largest = max(largest, maxval(abs(a%q - b%q)/(1.0_wp + abs(b%q))), &
                        maxval(abs(a%qd - b%qd)/(1.0_wp + abs(b%qd))))
                end associate
                call simulation%look_back()
            end do
        end do
        call check_no_failure(error, failure)
        statistics = simulation%statistics()
    end subroutine measure

    !> The shipped scenes and a pendulum. Ten times either way is guaranteed to users; measured: 0.18 to 4.0 times the error, if
    !> that is above the tolerance. There are no warnings otherwise.
    subroutine test_stated(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=10), parameter :: names(5) = [character(len=10) :: 'disk', 'vehicle', 'motorcycle', 'chopper', 'pendulum']
        character(len=6), parameter :: steppers(2) = ['dop853', 'dopri5']
        real(wp), parameter :: tolerances(4) = [1.0e-4_wp, 1.0e-6_wp, 1.0e-9_wp, 1.0e-11_wp]
        !> Of the disk's dip, and of a lane change.
        real(wp), parameter :: t_end = 5.0_wp
        type(statistics_type) :: statistics
        type(options_type) :: options
        real(wp) :: largest
        integer :: i, j, k, l

        do i = 1, size(names)
            do j = 1, size(steppers)
                do k = 1, size(tolerances)
                    options = options_type(stepper=steppers(j), rtol=tolerances(k))
                    call measure(names(i), options, t_end, [(l/8.0_wp, l=1, 7)], largest, statistics, error)
                    if (allocated(error)) return
                    associate (what => trim(names(i))//', '//steppers(j)//', rtol '//to_text(tolerances(k)))
                        if (largest > tolerances(k)) then
                            call check_between(error, statistics%dense_error/largest, 0.1_wp, 10.0_wp, what// &
                                ': what is stated, over the error')
                        else
                            call check_true(error, .not. warns(options, statistics), what//': a false warning')
                        end if
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

    !> Near the ends the interpolant is as good as the step, and its stated error is no more than rounding makes of 1e-9.
    subroutine test_ends(error)
        type(error_type), allocatable, intent(out) :: error
        type(statistics_type) :: statistics
        real(wp) :: largest

        call measure('disk', options_type(stepper='dop853', rtol=1.0e-9_wp, projection='stages'), 5.0_wp, [1.0e-6_wp, 1.0e-4_wp, &
            1.0_wp - 1.0e-4_wp, 1.0_wp - 1.0e-6_wp], largest, statistics, error)
        if (allocated(error)) return
        call check_below(error, statistics%dense_error, 1.0e-9_wp, 'what is stated')
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

    !> Its centre is known in closed form. With a tolerance of 1e-4 it rotates by more than a radian in a step. Errors at the ends
    !> of steps add up; between them the additional error is at most ten times the stated one.
    subroutine test_turntable(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: tolerances(3) = [1.0e-3_wp, 1.0e-4_wp, 1.0e-6_wp]
        type(turntable_type), target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(failure_type), allocatable :: failure
        real(wp) :: q(6), qd(6), t0, at_ends, between
        integer :: i, j

        do i = 1, size(tolerances)
            call model%define()
            call model%start(q, qd)
            call simulation%initialize(model, options_type(stepper='dop853', rtol=tolerances(i)), 0.0_wp, q, qd, failure)
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
            call check_below(error, between, at_ends + 10*statistics%dense_error, 'error of the centre')
            if (allocated(error)) return
        end do

    contains

        !> At the current state, relative.
        real(wp) function error_of_centre()
            real(wp) :: r(2), v(2)

            associate (state => simulation%state)
                call model%exact(state%t, r, v)
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
