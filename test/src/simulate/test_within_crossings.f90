! SPDX-License-Identifier: MIT
!> Tests of the motion within crossings of singular configurations: dense output, events, ends of runs, saved states.
module test_within_crossings
    use asserts, only: check_below, check_close, check_no_failure, check_true
    use linkage_turns, only: parallel, turn
    use model_crank_pair, only: crank_pair_type
    use runs, only: choose, run
    use tandem, only: change_stepper, failure_type => error_type, long, options_type, simulation_type, threshold_event_type, wp
    use testdrive, only: error_type, new_unittest, test_failed, unittest_type
    implicit none (type, external)
    private

    public :: collect_within_crossings

    !> State of a run.
    type :: saved_type
        integer(long), allocatable :: words(:)
    end type saved_type

contains

    !> The suite.
    subroutine collect_within_crossings(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('the-motion-within-a-crossing', test_within), &
            new_unittest('an-event-within-a-crossing', test_event), &
            new_unittest('a-run-ends-anywhere-within-a-crossing', test_end), &
            new_unittest('a-resumed-run-crosses-alike', test_resumption)]
    end subroutine collect_within_crossings

    !> States within crossings are as accurate as others, and satisfy the constraints.
    subroutine test_within(error)
        type(error_type), allocatable, intent(out) :: error
        type(crank_pair_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        real(wp) :: q(4), qd(4), angle, rate, t
        integer :: i, n_before

        call model%define()
        call model%start(1.0_wp, -6.0_wp, q, qd)
        options = choose(stepper='dop853')
        call change_stepper(options, options%stepper, rtol=1.0e-10_wp)
        call simulation%initialize(model, options, 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        do while (simulation%n_crossings < 3)
            n_before = simulation%n_crossings
            call simulation%step(3.0_wp, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            if (simulation%n_crossings == n_before) cycle
            associate (record => simulation%crossings(simulation%n_crossings))
                call check_true(error, record%t_from < record%t .and. record%t < record%t_to, 'the order of the times')
                do i = 0, 20
                    t = record%t_from + (record%t_to - record%t_from)*i/20
                    if (i == 10) t = record%t
                    call simulation%look_at(t, failure)
                    call check_no_failure(error, failure)
                    angle = 1.0_wp
                    rate = -6.0_wp
                    call turn(parallel, t, angle, rate)
                    call model%start(angle, rate, q, qd)
                    call check_close(error, simulation%state%q, q, 1.0e-7_wp, 'q within the crossing')
                    call check_close(error, simulation%state%qd, qd, 1.0e-7_wp, 'qd within the crossing')
                    call check_below(error, maxval(simulation%errors(1:2)), 1.0e-9_wp, 'constraint errors within the crossing')
                    if (allocated(error)) return
                end do
                call simulation%look_back()
            end associate
        end do
    end subroutine test_within

    !> An event at 1e-4 rad from the flat position, on either side, is found.
    subroutine test_event(error)
        type(error_type), allocatable, intent(out) :: error
        type(crank_pair_type), target :: model
        type(simulation_type) :: simulation
        type(threshold_event_type), target :: event
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        real(wp) :: q(4), qd(4), angle, rate
        integer :: i

        call model%define()
        do i = 1, 2
            call model%start(1.0_wp, -6.0_wp, q, qd)
            options = choose(stepper='dop853')
            call change_stepper(options, options%stepper, rtol=1.0e-10_wp)
            call simulation%initialize(model, options, 0.0_wp, q, qd, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            event%quantity = 'q'
            event%index = 2
            event%value = merge(1.0e-4_wp, -1.0e-4_wp, i == 1)
            event%direction = -1
            event%stops = .true.
            call simulation%add_event(event)
            call simulation%integrate(3.0_wp, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call check_true(error, simulation%is_stopped, 'the event stops the run')
            angle = 1.0_wp
            rate = -6.0_wp
            call turn(parallel, simulation%state%t, angle, rate)
            call check_close(error, [sin(angle)], [event%value], 1.0e-8_wp, 'the value at the event')
        end do
    end subroutine test_event

    !> Runs that end at the configuration, close before it or close behind it, and continue from there.
    subroutine test_end(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=7), parameter :: steppers(4) = [character(len=7) :: 'dop853', 'radau5', 'sdirk54', 'rk4']
        real(wp), parameter :: apart(7) = [0.0_wp, 1.0e-9_wp, -1.0e-9_wp, 1.0e-5_wp, -1.0e-5_wp, 1.0e-3_wp, -1.0e-3_wp]
        real(wp), parameter :: t_end = 2.0_wp
        type(crank_pair_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        real(wp) :: q(4), qd(4), angle, rate, t_crossing, stop_at
        integer :: i, k, m, n_crossings

        call model%define()
        do k = 1, size(steppers)
            options = choose(stepper=trim(steppers(k)), step=1.0e-3_wp)
            if (k < 4) call change_stepper(options, options%stepper, rtol=1.0e-9_wp)
            call model%start(1.0_wp, -6.0_wp, q, qd)
            call run(simulation, model, options, 0.0_wp, q, qd, t_end, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            t_crossing = simulation%crossings(2)%t
            n_crossings = simulation%n_crossings
            do i = 1, size(apart)
                call simulation%initialize(model, options, 0.0_wp, q, qd, failure)
                call check_no_failure(error, failure)
                if (allocated(error)) return
                do m = 1, 2
                    stop_at = merge(t_crossing + apart(i), t_end, m == 1)
                    call simulation%integrate(stop_at, failure)
                    call check_no_failure(error, failure)
                    if (allocated(error)) return
                    call check_true(error, .not. abs(simulation%state%t - stop_at) > 0.0_wp, 'the end is where it was asked')
                    angle = 1.0_wp
                    rate = -6.0_wp
                    call turn(parallel, simulation%state%t, angle, rate)
                    call check_close(error, simulation%state%q, [cos(angle), sin(angle), 2 + cos(angle), sin(angle)], 1.0e-6_wp, &
                        trim(steppers(k))//', positions')
                    call check_close(error, simulation%state%qd([1, 2]), rate*[-sin(angle), cos(angle)], 1.0e-6_wp, &
                        trim(steppers(k))//', velocities')
                    if (allocated(error)) return
                end do
                call check_true(error, simulation%n_crossings == n_crossings, 'each crossing is listed once')
                if (allocated(error)) return
            end do
        end do
    end subroutine test_end

    !> States saved after any step before, at and behind a crossing continue bitwise.
    subroutine test_resumption(error)
        type(error_type), allocatable, intent(out) :: error
        type(crank_pair_type), target :: model, other
        type(simulation_type) :: simulation, again
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        type(saved_type), allocatable :: saved(:), longer(:)
        integer(long), allocatable :: expected(:), found(:)
        real(wp) :: q(4), qd(4), t_end
        integer :: i, k, n

        call model%define()
        call other%define()
        do k = 1, 2
            options = choose(stepper=merge('dop853', 'rk4   ', k == 1), step=2.0e-3_wp)
            if (k == 1) call change_stepper(options, options%stepper, rtol=1.0e-9_wp)
            n = merge(1, 100, k == 1)
            call model%start(1.0_wp, -6.0_wp, q, qd)
            call simulation%initialize(model, options, 0.0_wp, q, qd, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            ! Every state is one to resume from, also the end of a crossing; the next crossing follows.
            t_end = merge(0.8_wp, 2.0_wp, k == 1)
            saved = [saved_type ::]
            do while (simulation%state%t < t_end)
                allocate (longer(size(saved) + 1))
                longer(:size(saved)) = saved
                call simulation%save_state(longer(size(longer))%words, failure)
                call check_no_failure(error, failure)
                call move_alloc(longer, saved)
                call take_steps(simulation, n, t_end, error)
                if (allocated(error)) return
            end do
            call check_true(error, simulation%n_crossings >= 2, 'crossings')
            call simulation%save_state(expected, failure)
            call check_no_failure(error, failure)
            do i = 1, size(saved)
                call again%initialize(other, options, 0.0_wp, q, qd, failure)
                call check_no_failure(error, failure)
                call again%restore_state(saved(i)%words, failure)
                call check_no_failure(error, failure)
                call take_steps(again, huge(1), t_end, error)
                if (allocated(error)) return
                call again%save_state(found, failure)
                call check_no_failure(error, failure)
                if (size(expected) /= size(found)) then
                    call test_failed(error, 'the sizes differ')
                else if (any(expected /= found)) then
                    call test_failed(error, 'the states differ')
                end if
                if (allocated(error)) return
            end do
        end do
    end subroutine test_resumption

    !> A number of steps, or as many as there are until a time.
    subroutine take_steps(simulation, n, t_end, error)
        type(simulation_type), intent(inout) :: simulation
        integer, intent(in) :: n
        real(wp), intent(in) :: t_end
        type(error_type), allocatable, intent(out) :: error
        type(failure_type), allocatable :: failure
        integer :: i

        do i = 1, n
            if (.not. simulation%state%t < t_end) exit
            call simulation%step(t_end, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) exit
        end do
    end subroutine take_steps
end module test_within_crossings
