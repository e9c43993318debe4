! SPDX-License-Identifier: MIT
!> Tests of charts that follow stiffness: a pendulum on a damped spring that moves as slowly as a rigid one, for any stiffness.
module test_stiff_charts
    use asserts, only: check_below, check_between, check_no_failure, check_true
    use model_stiff_pendulum, only: stiff_pendulum_type
    use runs, only: run
    use tandem, only: failure_type => error_type, options_type, simulation_type, statistics_type, wp
    use tandem_io, only: find_scene, read_scene, scene_type
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_stiff_charts

contains

    !> The suite.
    subroutine collect_stiff_charts(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('the-chart-follows-a-stiff-spring', test_followed_spring), &
            new_unittest('the-chart-follows-a-stiff-spring-at-every-tolerance', test_followed_tightly), &
            new_unittest('the-chart-follows-a-spring-that-is-hardly-stiff', test_followed_hardly), &
            new_unittest('the-chart-follows-a-stiff-spring-without-derivatives', test_followed_by_differences), &
            new_unittest('fixed-steps-on-a-stiff-spring-complete', test_followed_fixed), &
            new_unittest('radau5-takes-no-more-steps-where-a-spring-is-stiffer', test_radau5), &
            new_unittest('radau5-keeps-its-order-on-a-stiff-spring', test_radau5_order), &
            new_unittest('following-takes-no-more-steps-than-the-plain-complement', test_trials), &
            new_unittest('an-implicit-stepper-is-advised-where-it-is-faster', test_advice)]
    end subroutine collect_stiff_charts

    !> The pendulum on a spring of frequency ratio R, damped half critically, from rest at 1 rad with the spring in balance, so that
    !> it moves slowly: to t = 2.
    subroutine move_slowly(options, ratio, has_stretch, has_derivatives, simulation, statistics, error)
        type(options_type), intent(in) :: options
        real(wp), intent(in) :: ratio
        !> True if the stretch is the coordinate, not the length; true if the model provides its derivatives.
        logical, intent(in) :: has_stretch, has_derivatives
        type(simulation_type), intent(inout) :: simulation
        type(statistics_type), intent(out) :: statistics
        type(error_type), allocatable, intent(out) :: error
        type(stiff_pendulum_type), target :: model
        type(failure_type), allocatable :: failure
        real(wp) :: stretch

        model%k = 9.81_wp*ratio**2
        model%c = sqrt(model%k)
        model%has_stretch = has_stretch
        model%has_derivatives = has_derivatives
        call model%define()
        stretch = 9.81_wp*cos(1.0_wp)/model%k
        call run(simulation, model, options, 0.0_wp, [(1 + stretch)*sin(1.0_wp), -(1 + stretch)*cos(1.0_wp), &
            stretch + merge(0.0_wp, 1.0_wp, has_stretch)], spread(0.0_wp, 1, 3), 2.0_wp, failure)
        statistics = simulation%statistics()
        simulation%model => null()
        call check_no_failure(error, failure)
    end subroutine move_slowly

    !> x and y of that motion at t = 2: Radau IIA of order 5 in polar coordinates with 33 digits, 2000 steps; 1000 steps agree to
    !> 4e-15.
    pure function slow_motion(ratio) result(exact)
        real(wp), intent(in) :: ratio
        real(wp) :: exact(2)

        exact = [0.796082285799071861_wp, -0.605188395656199785_wp]
        if (ratio < 2.0e6_wp) exact = [0.796082285798077987_wp, -0.605188395658721469_wp]
        if (ratio < 2.0e4_wp) exact = [0.796082275856892991_wp, -0.605188420880177786_wp]
        if (ratio < 2.0e2_wp) exact = [0.795980343985025789_wp, -0.605445403931408259_wp]
    end function slow_motion

    !> With the plain complement 1500, 33 000 and 500 000 steps at ratios of 1e2, 1e4 and 1e6.
    subroutine test_followed_spring(error)
        type(error_type), allocatable, intent(out) :: error
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        real(wp), parameter :: rtol = 1.0e-6_wp, ratios(4) = [1.0e2_wp, 1.0e4_wp, 1.0e6_wp, 1.0e8_wp]
        integer :: i, j

        do i = 1, size(ratios)
            do j = 1, 2
                ! At 1e8 the stretch is below the rounding of the length.
                if (i == 4 .and. j == 2) exit
                call move_slowly(options_type(stepper='sdirk54', rtol=rtol), ratios(i), j == 1, .true., simulation, &
                    statistics, error)
                if (allocated(error)) return
                ! Measured: 0.3 to 0.5 tolerances; 141 steps at 1e2, else 74 and 75.
                call check_below(error, maxval(abs(simulation%state%q(:2) - slow_motion(ratios(i)))), 10*rtol, 'position')
                call check_below(error, real(statistics%steps, wp), 300.0_wp, 'steps')
                if (allocated(error)) return
            end do
        end do
    end subroutine test_followed_spring

    !> For any tolerance the steps follow the slow motion. With M + beta D + beta^2 K as the metric 450 000 steps were taken at 1e4
    !> and 1e-10, because small steps kept the chart that makes them small.
    subroutine test_followed_tightly(error)
        type(error_type), allocatable, intent(out) :: error
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        real(wp), parameter :: rtols(3) = [1.0e-4_wp, 1.0e-8_wp, 1.0e-10_wp], ratios(3) = [1.0e4_wp, 1.0e6_wp, 1.0e8_wp]
        integer :: i, j

        do i = 1, size(ratios)
            do j = 1, size(rtols)
                call move_slowly(options_type(stepper='sdirk54', rtol=rtols(j)), ratios(i), .true., .true., simulation, &
                    statistics, error)
                if (allocated(error)) return
                ! Measured: at most 0.47 tolerances; 24, 235 and 1230 steps, proportional to rtol**-(1/4) from 74 at 1e-6.
                call check_below(error, maxval(abs(simulation%state%q(:2) - slow_motion(ratios(i)))), 10*rtols(j), 'position')
                call check_below(error, real(statistics%steps, wp), 2*74*(1.0e-6_wp/rtols(j))**0.25_wp, 'steps')
                if (allocated(error)) return
            end do
        end do
    end subroutine test_followed_tightly

    !> At a ratio of 1e2 the spring is neither stiff in a step nor resolved. The method takes as many steps in polar coordinates,
    !> which fit the problem: 169, 776 and 2579, by the same formulas and control in Python. The additional steps compared with 1e4
    !> are due to its stage order of 1. With small steps in the plain complement it took 4793 and 15 189.
    subroutine test_followed_hardly(error)
        type(error_type), allocatable, intent(out) :: error
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        real(wp), parameter :: rtols(3) = [1.0e-6_wp, 1.0e-8_wp, 1.0e-10_wp], polar(3) = [169.0_wp, 776.0_wp, 2579.0_wp]
        integer :: i

        do i = 1, size(rtols)
            call move_slowly(options_type(stepper='sdirk54', rtol=rtols(i)), 1.0e2_wp, .true., .true., simulation, &
                statistics, error)
            if (allocated(error)) return
            ! Measured: at most 0.5 tolerances; 141, 737 and 2348 steps.
            call check_below(error, maxval(abs(simulation%state%q(:2) - slow_motion(1.0e2_wp))), 10*rtols(i), 'position')
            call check_below(error, real(statistics%steps, wp), 1.1_wp*polar(i), 'steps')
            if (allocated(error)) return
        end do
    end subroutine test_followed_hardly

    !> Tolerances, errors and steps of radau5; at 1e8 with the stretch only.
    subroutine test_radau5(error)
        type(error_type), allocatable, intent(out) :: error
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(options_type) :: options
        real(wp), parameter :: rtols(3) = [1.0e-4_wp, 1.0e-6_wp, 1.0e-8_wp]
        real(wp), parameter :: ratios(4) = [1.0e2_wp, 1.0e4_wp, 1.0e6_wp, 1.0e8_wp]
        integer :: i, j

        options%stepper = 'radau5'
        do i = 1, size(ratios)
            do j = 1, size(rtols)
                options%rtol = rtols(j)
                call move_slowly(options, ratios(i), .true., .true., simulation, statistics, error)
                if (allocated(error)) return
                ! Measured: at most 0.02 tolerances; 27, 80 and 250 steps at every ratio.
                call check_below(error, maxval(abs(simulation%state%q(:2) - slow_motion(ratios(i)))), 10*rtols(j), 'position')
                if (j == 2) call check_below(error, real(statistics%steps, wp), 150.0_wp, 'steps')
                if (allocated(error)) return
            end do
        end do
    end subroutine test_radau5

    !> Fixed steps: the order is that of the non-stiff motion, five.
    subroutine test_radau5_order(error)
        type(error_type), allocatable, intent(out) :: error
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(options_type) :: options
        real(wp) :: errors(2)
        integer :: i

        options%stepper = 'radau5'
        do i = 1, 2
            options%step = merge(5.0e-2_wp, 2.5e-2_wp, i == 1)
            call move_slowly(options, 1.0e6_wp, .true., .true., simulation, statistics, error)
            if (allocated(error)) return
            errors(i) = maxval(abs(simulation%state%q(:2) - slow_motion(1.0e6_wp)))
        end do
        call check_below(error, errors(1), 3.0e-8_wp, 'error with h = 0.05')
        call check_between(error, log(errors(1)/errors(2))/log(2.0_wp), 4.5_wp, 5.5_wp, 'order')
    end subroutine test_radau5_order

    !> The same with derivatives by differences: the chart follows the stiffness that they show.
    subroutine test_followed_by_differences(error)
        type(error_type), allocatable, intent(out) :: error
        type(simulation_type) :: simulation
        type(statistics_type) :: with, without
        real(wp), parameter :: rtol = 1.0e-6_wp, ratios(3) = [1.0e2_wp, 1.0e4_wp, 1.0e6_wp]
        integer :: i

        do i = 1, size(ratios)
            call move_slowly(options_type(stepper='sdirk54', rtol=rtol), ratios(i), .true., .true., simulation, with, error)
            if (allocated(error)) return
            call move_slowly(options_type(stepper='sdirk54', rtol=rtol), ratios(i), .true., .false., simulation, without, error)
            if (allocated(error)) return
            call check_below(error, maxval(abs(simulation%state%q(:2) - slow_motion(ratios(i)))), 10*rtol, 'position')
            ! The same steps up to the remainder of Newton's iteration.
            call check_between(error, real(without%steps, wp)/real(with%steps, wp), 0.8_wp, 1.2_wp, 'steps without over with')
            if (allocated(error)) return
        end do
    end subroutine test_followed_by_differences

    !> Fixed steps from 1e-3 to 5e-2 complete, regardless of the rounding of the spring's force: with the length as the coordinate
    !> Newton's iteration stagnates at 1e-14.
    subroutine test_followed_fixed(error)
        type(error_type), allocatable, intent(out) :: error
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(options_type) :: options
        real(wp), parameter :: steps(4) = [1.0e-3_wp, 5.0e-3_wp, 2.0e-2_wp, 5.0e-2_wp], ratios(2) = [1.0e4_wp, 1.0e6_wp]
        integer :: i, j, k

        options%stepper = 'sdirk54'
        do i = 1, size(ratios)
            do j = 1, size(steps)
                options%step = steps(j)
                do k = 1, 2
                    call move_slowly(options, ratios(i), k == 1, .true., simulation, statistics, error)
                    if (allocated(error)) return
                    ! Measured: 3e-6 for the largest step, order 4 from there, down to 2e-9 due to the method's stage order of 1.
                    call check_below(error, maxval(abs(simulation%state%q(:2) - slow_motion(ratios(i)))), 3.0e-8_wp + &
                        2.0e-5_wp*(steps(j)/5.0e-2_wp)**4, 'position')
                end do
            end do
        end do
    end subroutine test_followed_fixed

    !> A ball that rolls on a turning table has rows of velocities, across which the forces hardly grow: the metric is tried, and
    !> left if it shortens steps.
    subroutine test_trials(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=7), parameter :: methods(2) = [character(len=7) :: 'radau5', 'sdirk54']
        character(len=4), parameter :: rtols(2) = ['1e-4', '1e-6']
        character(len=10), parameter :: policies(2) = [character(len=10) :: 'every_step', 'paper']
        type(scene_type), target :: scene
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(failure_type), allocatable :: failure
        character(len=:), allocatable :: path
        integer :: i, j, k, steps(size(policies))

        call find_scene('turntable', path, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        do i = 1, size(methods)
            do j = 1, size(rtols)
                do k = 1, size(policies)
                    call read_scene(path, [character(len=32) :: 'solver.chart_kind=dense', 'solver.stepper='//methods(i), &
                        'solver.rtol='//rtols(j), 'solver.chart='//trim(policies(k))], scene, failure)
                    if (.not. allocated(failure)) call run(simulation, scene%model, scene%options, scene%t_start, scene%q, &
                        scene%qd, scene%t_end, failure)
                    call check_no_failure(error, failure)
                    if (allocated(error)) return
                    statistics = simulation%statistics()
                    steps(k) = int(statistics%steps)
                    simulation%model => null()
                end do
                ! Measured: 0.55, 0.98, 0.57 and 0.87.
                call check_below(error, real(steps(1), wp), 1.1_wp*real(steps(2), wp), 'steps')
                if (allocated(error)) return
            end do
        end do
    end subroutine test_trials

    !> Explicit steppers on pendulums of frequency ratios from 10 to 1000: the recommended stepper takes less work, counted.
    subroutine test_advice(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=6), parameter :: explicit(2) = ['dopri5', 'dop853']
        real(wp), parameter :: rtols(2) = [1.0e-4_wp, 1.0e-7_wp], ratios(4) = [10.0_wp, 30.0_wp, 3.0e2_wp, 1.0e3_wp]
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics, advised
        type(options_type) :: options
        !> Cost of an evaluation of an implicit run in evaluations of an explicit one: measured 2.4 to 3.0.
        real(wp), parameter :: of_implicit = 4.0_wp
        integer :: i, j, k, n_advised

        n_advised = 0
        do i = 1, size(ratios)
            do j = 1, size(explicit)
                do k = 1, size(rtols)
                    options%rtol = rtols(k)
                    options%stepper = explicit(j)
                    call move_slowly(options, ratios(i), .true., .true., simulation, statistics, error)
                    if (allocated(error)) return
                    if (statistics%advised == '') cycle
                    n_advised = n_advised + 1
                    options%stepper = statistics%advised
                    call move_slowly(options, ratios(i), .true., .true., simulation, advised, error)
                    if (allocated(error)) return
                    call check_below(error, of_implicit*real(advised%right_hand_sides, wp), real(statistics%right_hand_sides, wp), &
                        'counted work on the pendulum')
                    if (allocated(error)) return
                end do
            end do
        end do
        call check_true(error, n_advised >= 4, 'there is advice')
    end subroutine test_advice
end module test_stiff_charts
