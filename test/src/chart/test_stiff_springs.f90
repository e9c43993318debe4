! SPDX-License-Identifier: MIT
!> Tests of springs that become stiff in the middle of a run, of stiff models without derivatives, and of warnings about the
!> velocities of a swinging stiff spring.
module test_stiff_springs
    use asserts, only: check_below, check_between, check_no_failure, check_true
    use model_stiff_pendulum, only: stiff_pendulum_type
    use reference, only: read_reference, reference_type
    use runs, only: run
    use tandem, only: failure_type => error_type, find_error_warnings, global_error_type, motorcycle_type, options_type, &
        simulation_type, statistics_type, warning_type, wp
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_stiff_springs

    !> Implicit steppers that damp what is stiff.
    character(len=7), parameter :: steppers(2) = [character(len=7) :: 'sdirk54', 'radau5']
    character(len=7), parameter :: controlled(3) = [character(len=7) :: 'sdirk54', 'radau5', 'auto']

contains

    !> The suite.
    subroutine collect_stiff_springs(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('a-spring-that-stiffens-is-no-failure', test_stiffening), &
            new_unittest('fixed-steps-over-a-spring-that-stiffens-complete', test_fixed_stiffening), &
            new_unittest('fixed-steps-on-stiff-springs-complete', test_fixed), &
            new_unittest('a-stiff-motorcycle-needs-no-derivatives', test_no_derivatives), &
            new_unittest('radau5-on-a-stiff-pendulum-needs-no-derivatives', test_no_derivatives_radau5), &
            new_unittest('errors-of-fast-velocities-are-told', test_fast_velocities)]
    end subroutine collect_stiff_springs

    !> A pendulum on a spring of frequency ratio R, damped half critically, that starts slowly from 1 rad, to t = 2.
    subroutine swing(options, ratio, has_derivatives, stiffens_at, simulation, statistics, failure)
        type(options_type), intent(in) :: options
        real(wp), intent(in) :: ratio, stiffens_at
        logical, intent(in) :: has_derivatives
        type(simulation_type), intent(inout) :: simulation
        type(statistics_type), intent(out) :: statistics
        type(failure_type), allocatable, intent(out) :: failure
        type(stiff_pendulum_type), target :: model
        real(wp) :: stretch

        model%k = 9.81_wp*ratio**2
        model%c = sqrt(model%k)
        model%has_stretch = .true.
        model%has_derivatives = has_derivatives
        model%stiffens_at = stiffens_at
        call model%define()
        stretch = 9.81_wp*cos(1.0_wp)/model%k
        call run(simulation, model, options, 0.0_wp, [(1 + stretch)*sin(1.0_wp), -(1 + stretch)*cos(1.0_wp), stretch], &
            spread(0.0_wp, 1, 3), 2.0_wp, failure)
        statistics = simulation%statistics()
        simulation%model => null()
    end subroutine swing

    !> The spring stiffens a thousandfold within 10 ms at t = 1: against DOP853 with 1e-12 if that can follow, else radau5 with
    !> 1e-10.
    subroutine test_stiffening(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: ratios(3) = [10.0_wp, 1.0e2_wp, 1.0e4_wp], rtols(2) = [1.0e-4_wp, 1.0e-6_wp]
        type(simulation_type) :: simulation, fine
        type(statistics_type) :: statistics
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        integer :: i, j, k

        do i = 1, size(ratios)
            options = options_type()
            options%stepper = merge('dop853', 'radau5', i == 1)
            options%rtol = merge(1.0e-12_wp, 1.0e-10_wp, i == 1)
            call swing(options, ratios(i), .true., 1.0_wp, fine, statistics, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            do j = 1, size(controlled)
                do k = 1, size(rtols)
                    options%stepper = controlled(j)
                    options%rtol = rtols(k)
                    call swing(options, ratios(i), .true., 1.0_wp, simulation, statistics, failure)
                    call check_no_failure(error, failure)
                    if (allocated(error)) return
                    call check_below(error, maxval(abs(simulation%state%q(:2) - fine%state%q(:2))), 10*rtols(k), 'position')
                    ! Steps adapt, and are those of the slow motion again.
                    call check_below(error, real(statistics%steps, wp), 1.0e3_wp, 'steps')
                    call check_below(error, 1.0e-3_wp, statistics%largest_step, 'largest step')
                    if (allocated(error)) return
                end do
            end do
        end do
    end subroutine test_stiffening

    !> Fixed steps too, shorter and longer than the 10 ms in which the spring stiffens: within 1e-3 of the run with 1e-10, because a
    !> step does not resolve that. The stages of radau5 have one matrix, which cannot fit a hundredfold change between them: the
    !> stages are then solved one by one.
    subroutine test_fixed_stiffening(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: sizes(4) = [5.0e-4_wp, 2.0e-3_wp, 1.0e-2_wp, 2.0e-2_wp], ratios(2) = [1.0e3_wp, 1.0e5_wp]
        type(simulation_type) :: simulation, fine
        type(statistics_type) :: statistics
        type(failure_type), allocatable :: failure
        integer :: i, j, k

        do i = 1, size(ratios)
            call swing(options_type(stepper='radau5', rtol=1.0e-10_wp), ratios(i), .true., 1.0_wp, fine, statistics, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            do j = 1, size(steppers)
                do k = 1, size(sizes)
                    call swing(options_type(stepper=steppers(j), step=sizes(k)), ratios(i), .true., 1.0_wp, simulation, &
                        statistics, failure)
                    call check_no_failure(error, failure)
                    if (allocated(error)) return
                    call check_below(error, maxval(abs(simulation%state%q(:2) - fine%state%q(:2))), 1.0e-3_wp, 'position')
                end do
            end do
        end do
    end subroutine test_fixed_stiffening

    !> Fixed steps of every size complete, for any stiffness.
    subroutine test_fixed(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: sizes(5) = [1.0e-4_wp, 5.0e-4_wp, 2.0e-3_wp, 1.0e-2_wp, 5.0e-2_wp]
        real(wp), parameter :: ratios(3) = [1.0e2_wp, 1.0e4_wp, 1.0e6_wp]
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        integer :: i, j, k

        do i = 1, size(ratios)
            do j = 1, size(steppers)
                do k = 1, size(sizes)
                    options%stepper = steppers(j)
                    options%step = sizes(k)
                    call swing(options, ratios(i), .true., huge(1.0_wp), simulation, statistics, failure)
                    call check_no_failure(error, failure)
                    if (allocated(error)) return
                end do
            end do
        end do
    end subroutine test_fixed

    !> The motorcycle, and one whose suspension is a thousand times as stiff, with derivatives of the model and without: the same
    !> motion and steps.
    subroutine test_no_derivatives(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: factors(2) = [1.0_wp, 1.0e3_wp], rtol = 1.0e-6_wp
        type(motorcycle_type), target :: model
        type(simulation_type) :: simulation(2)
        type(statistics_type) :: statistics(2)
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: q(10), qd(10)
        integer :: i, j, k, stat

        options%rtol = rtol
        do i = 1, size(factors)
            do j = 1, size(steppers)
                options%stepper = steppers(j)
                do k = 1, 2
                    model = motorcycle_type()
                    model%fork_angle = 0.2_wp
                    call model%define()
                    call model%start(15.0_wp, q, qd, stat)
                    call check_true(error, stat == 0, 'start')
                    if (allocated(error)) return
                    model%free_length = model%spring_length()
                    model%stiffness = factors(i)*model%stiffness
                    model%damping = factors(i)*model%damping
                    if (k == 2) then
                        model%provides_derivatives = 0
                        model%evaluate_derivatives => null()
                    end if
                    call run(simulation(k), model, options, 0.0_wp, q, qd, 10.0_wp, failure)
                    call check_no_failure(error, failure)
                    if (allocated(error)) return
                    statistics(k) = simulation(k)%statistics()
                end do
                call check_below(error, maxval(abs(simulation(1)%state%q - simulation(2)%state%q)), 10*rtol, 'q')
                call check_between(error, real(statistics(2)%steps, wp)/real(statistics(1)%steps, wp), 0.8_wp, 1.2_wp, &
                    'steps without over with')
                if (allocated(error)) return
            end do
        end do
    end subroutine test_no_derivatives

    !> The same with radau5 on pendulums.
    subroutine test_no_derivatives_radau5(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: ratios(3) = [1.0e2_wp, 1.0e4_wp, 1.0e6_wp], rtols(2) = [1.0e-4_wp, 1.0e-7_wp]
        type(simulation_type) :: simulation(2)
        type(statistics_type) :: statistics(2)
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        integer :: i, j, k

        options%stepper = 'radau5'
        do i = 1, size(ratios)
            do j = 1, size(rtols)
                options%rtol = rtols(j)
                do k = 1, 2
                    call swing(options, ratios(i), k == 1, huge(1.0_wp), simulation(k), statistics(k), failure)
                    call check_no_failure(error, failure)
                    if (allocated(error)) return
                end do
                call check_below(error, maxval(abs(simulation(1)%state%q(:2) - simulation(2)%state%q(:2))), 10*rtols(j), 'position')
                call check_between(error, real(statistics(2)%steps, wp)/real(statistics(1)%steps, wp), 0.8_wp, 1.2_wp, &
                    'steps without over with')
                if (allocated(error)) return
            end do
        end do
    end subroutine test_no_derivatives_radau5

    !> A spring that swings with 3132 rad/s: if velocities miss the reference, on the scale 1 + |qd|, at its times, by more than the
    !> threshold of the warning, the error estimate reports it, and is right to a factor of two or more.
    subroutine test_fast_velocities(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: rtol = 1.0e-6_wp, t_end = 0.3_wp
        type(stiff_pendulum_type), target :: model, another
        type(simulation_type) :: simulation
        type(global_error_type) :: global_error
        type(warning_type), allocatable :: doubts(:)
        type(reference_type) :: table
        type(options_type) :: options
        type(failure_type), allocatable :: failure, none
        real(wp) :: true
        integer :: i, j

        call read_reference('stiff_pendulum', table)
        options%rtol = rtol
        do j = 1, size(steppers)
            options%stepper = steppers(j)
            call model%define()
            call another%define()
            call global_error%initialize(3, 0.0_wp, t_end)
            call simulation%initialize(model, options, 0.0_wp, table%q(:, 1), table%qd(:, 1), failure)
            true = 0.0_wp
            do i = 2, size(table%t)
                if (allocated(failure) .or. table%t(i) > t_end*(1 + 1.0e-9_wp)) exit
                call simulation%integrate(table%t(i), failure)
                true = max(true, maxval(abs(simulation%state%qd - table%qd(:, i))/(1 + abs(table%qd(:, i)))))
            end do
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call run(simulation, model, options, 0.0_wp, table%q(:, 1), table%qd(:, 1), t_end, failure, global_error)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call global_error%estimate(another, options, table%q(:, 1), table%qd(:, 1), failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            ! Measured: 77 tolerances of 79 with SDIRK54, 2.1 of 2.9 with radau5.
            call check_below(error, true, 2*global_error%largest, 'what the estimate makes of the velocities')
            call find_error_warnings(options, simulation%statistics(), doubts, global_error, none)
            if (true > 30*rtol) call check_true(error, size(doubts) > 0, 'a warning')
            if (allocated(error)) return
        end do
    end subroutine test_fast_velocities
end module test_stiff_springs
