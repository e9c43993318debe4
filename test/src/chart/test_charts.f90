! SPDX-License-Identifier: MIT
!> Tests of the chart policies: number of charts, reasons, and independence of the solution; the long runs of the vehicle, the disk
!> and the motorcycles.
module test_charts
    use asserts, only: check_below, check_between, check_close, check_count, check_no_failure, check_true
    use model_knife_edge, only: knife_edge_type
    use model_pendulum, only: pendulum_type
    use runs, only: choose, get_start, new_scene, run, run_to
    use tandem, only: change_stepper, at_start, at_step, basis_methods, chart_policies, failure_type => error_type, model_type, &
        options_type, refresh_modes, simulation_type, statistics_type, stepper_names, wp
    use tandem_simulate_statistics, only: by_breakpoint, by_condition, by_d, by_fbar, by_iterations, by_start, by_step, by_v, by_w
    use testdrive, only: error_type, new_unittest, unittest_type
    use watch, only: energy_watch_type, error_watch_type
    implicit none (type, external)
    private

    public :: collect_charts

    !> Follows the energy, the constraint errors, and the dips of the disk: minima of rz below 0.6.
    type, extends(energy_watch_type) :: long_watch_type
        !> Measures the errors of all steps, if requested.
        logical :: measures_errors = .false.
        type(error_watch_type) :: error_watch
        !> Time and depth of each dip.
        integer :: dips = 0
        real(wp) :: dip_time(20) = 0.0_wp, dip_depth(20) = 0.0_wp
        logical :: follows_dips = .false.
        real(wp), private :: height(2) = huge(1.0_wp)
    contains
        procedure :: observe
    end type long_watch_type

contains

    !> The suite.
    subroutine collect_charts(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('vehicle-takes-22-charts-with-the-papers-limit', test_vehicle_22), &
            new_unittest('disk-takes-127-charts-with-the-papers-limit', test_disk_127), &
            new_unittest('disk-takes-127-charts-with-refinement-too', test_disk_127_refine), &
            new_unittest('disk-takes-127-charts-with-sdirk54-too', test_disk_127_sdirk54), &
            new_unittest('motorcycles-take-8-charts-with-the-papers-limit', test_motorcycle_8), &
            new_unittest('disk-keeps-its-energy-and-dips-seven-times-in-40-s', test_disk_40), &
            new_unittest('adaptive-charts-are-few', test_adaptive_few), &
            new_unittest('disk-takes-80-adaptive-charts-in-40-s', test_adaptive_80), &
            new_unittest('a-chart-every-step-is-one-a-step', test_every_step), &
            new_unittest('limit-on-v-acts-on-the-sine-of-the-angle', test_v_limit), &
            new_unittest('limit-on-v-is-measured-in-scaled-coordinates', test_v_scaled), &
            new_unittest('limit-on-w-acts-on-the-velocity', test_w_limit), &
            new_unittest('secant-limit-acts-on-the-angle', test_secant_limit), &
            new_unittest('limit-on-the-condition-acts-on-the-condition', test_condition_limit), &
            new_unittest('limit-on-iterations-acts-on-the-iterations', test_iteration_limit), &
            new_unittest('limits-act-with-implicit-steps-too', test_implicit_limits), &
            new_unittest('paper-policy-without-limits-keeps-its-chart', test_no_limits), &
            new_unittest('all-policies-and-modes-give-the-same-solution', test_same_solution), &
            new_unittest('bases-by-svd-give-the-same-solution', test_svd), &
            new_unittest('implicit-steps-give-the-same-solution-with-all-options', test_implicit_same_solution), &
            new_unittest('rounding-does-not-add-up-over-charts', test_rounding), &
            new_unittest('paper-charts-without-limits-end-at-seventy-degrees', test_seventy_degrees), &
            new_unittest('paper-charts-without-limits-carry-every-scene', test_carried)]
    end subroutine collect_charts

    subroutine observe(self, simulation, occasion, error)
        class(long_watch_type), intent(inout) :: self
        class(simulation_type), intent(inout) :: simulation
        integer, intent(in) :: occasion
        type(failure_type), allocatable, intent(out) :: error
        real(wp) :: curvature, offset

        if (occasion /= at_start .and. occasion /= at_step) return
        call self%energy_watch_type%observe(simulation, occasion, error)
        if (self%measures_errors .and. .not. allocated(error)) call self%error_watch%observe(simulation, occasion, error)
        if (.not. self%follows_dips) return
        associate (rz => simulation%state%q(3), h => simulation%last_step)
            if (self%height(2) < min(0.6_wp, self%height(1)) .and. self%height(2) <= rz .and. self%dips < 20) then
                ! Vertex of the parabola through three heights.
                curvature = self%height(1) - 2*self%height(2) + rz
                offset = (self%height(1) - rz)/(2*curvature)
                self%dips = self%dips + 1
                self%dip_time(self%dips) = simulation%state%t - h + offset*h
                self%dip_depth(self%dips) = self%height(2) - offset**2*curvature/2
            end if
            self%height = [self%height(2), rz]
        end associate
    end subroutine observe

    !> The paper's run of the vehicle: 22 charts including the initial one, and 337 500 J.
    subroutine check_vehicle(stepper, refresh, error)
        character(len=*), intent(in) :: stepper, refresh
        type(error_type), allocatable, intent(out) :: error
        type(long_watch_type) :: watch
        type(statistics_type) :: statistics

        call run_scene('vehicle', choose(stepper=stepper, chart='paper', refresh=refresh, v_limit=10.0_wp), 10.0_wp, watch, &
            statistics, error)
        call check_count(error, statistics%charts, 22, 'charts')
        call check_count(error, statistics%charts_by(by_start), 1, 'charts at the start')
        call check_count(error, statistics%charts_by(by_v), 20, 'charts by |v|')
        call check_count(error, statistics%charts_by(by_breakpoint), 1, 'charts at the breakpoint')
        call check_below(error, abs(watch%energy/337500.0_wp - 1), 1.0e-15_wp, 'deviation of the energy at the start')
        ! The required accuracy; the constraints do no work, and the error of order four is below rounding.
        call check_below(error, watch%deviation, 1.0e-8_wp, 'deviation of the energy')
    end subroutine check_vehicle

    subroutine test_vehicle_22(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=7), parameter :: steppers(2) = ['rk4    ', 'sdirk54']
        integer :: i, j

        do i = 1, size(steppers)
            do j = 1, size(refresh_modes)
                call check_vehicle(trim(steppers(i)), refresh_modes(j), error)
                if (allocated(error)) return
            end do
        end do
    end subroutine test_vehicle_22

    !> The paper's run of the disk: 127 charts in 40 s including the initial one.
    subroutine check_disk(stepper, refresh, t_end, charts, error)
        character(len=*), intent(in) :: stepper, refresh
        real(wp), intent(in) :: t_end
        integer, intent(in) :: charts
        type(error_type), allocatable, intent(out) :: error
        type(long_watch_type) :: watch
        type(statistics_type) :: statistics

        call run_scene('disk', choose(stepper=stepper, chart='paper', refresh=refresh, v_limit=0.7_wp), t_end, watch, &
            statistics, error)
        call check_count(error, statistics%charts, charts, 'charts')
        call check_count(error, statistics%charts_by(by_v), charts - 1, 'charts by |v|')
        ! Large charts: truncation of 1e-4 in the dips, with an energy error below the paper's seven digits.
        call check_below(error, watch%deviation, 1.0e-6_wp, 'deviation of the energy')
    end subroutine check_disk

    subroutine test_disk_127(error)
        type(error_type), allocatable, intent(out) :: error

        call check_disk('rk4', 'factor', 40.0_wp, 127, error)
    end subroutine test_disk_127

    subroutine test_disk_127_refine(error)
        type(error_type), allocatable, intent(out) :: error

        call check_disk('rk4', 'refine', 40.0_wp, 127, error)
    end subroutine test_disk_127_refine

    !> The paper's own run: SDIRK54; with refinement up to t = 10, where all steppers of order four take 34 charts.
    subroutine test_disk_127_sdirk54(error)
        type(error_type), allocatable, intent(out) :: error

        call check_disk('sdirk54', 'factor', 40.0_wp, 127, error)
        if (.not. allocated(error)) call check_disk('sdirk54', 'refine', 10.0_wp, 34, error)
    end subroutine test_disk_127_sdirk54

    !> The paper's runs of both motorcycles: 8 charts including the initial one and that at the breakpoint.
    subroutine test_motorcycle_8(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=10), parameter :: scenes(2) = [character(len=10) :: 'motorcycle', 'chopper']
        character(len=7), parameter :: steppers(2) = ['rk4    ', 'sdirk54']
        type(long_watch_type) :: watch
        type(statistics_type) :: statistics
        integer :: i, j, k

        do i = 1, size(steppers)
            do j = 1, size(refresh_modes)
                do k = 1, size(scenes)
                    ! The paper's step for the standard one; charts follow each other by 1.3 s.
                    call run_scene(trim(scenes(k)), choose(step=merge(1.0e-3_wp, 4.0e-3_wp, j == 1 .and. k == 1), &
                        stepper=steppers(i), chart='paper', refresh=refresh_modes(j), v_limit=20.0_wp), 10.0_wp, watch, &
                        statistics, error)
                    call check_count(error, statistics%charts, 8, trim(scenes(k))//': charts with '//trim(steppers(i))//', '// &
                        refresh_modes(j))
                    call check_count(error, statistics%charts_by(by_start), 1, 'charts at the start')
                    call check_count(error, statistics%charts_by(by_v), 6, 'charts by |v|')
                    call check_count(error, statistics%charts_by(by_breakpoint), 1, 'charts at the breakpoint')
                end do
            end do
        end do
    end subroutine test_motorcycle_8

    !> Default options over 40 s: energy, seven dips to rz = 0.4953 at t = 2.875 + 5.75 k, all constraint levels.
    subroutine test_disk_40(error)
        type(error_type), allocatable, intent(out) :: error
        type(long_watch_type) :: watch
        type(statistics_type) :: statistics
        integer :: k

        watch%follows_dips = .true.
        watch%measures_errors = .true.
        watch%error_watch%every = 10
        call run_scene('disk', choose(), 40.0_wp, watch, statistics, error)
        call check_below(error, abs(watch%energy/103.500625005_wp - 1), 1.0e-15_wp, 'deviation of the energy at the start')
        call check_below(error, watch%deviation, 1.0e-6_wp, 'deviation of the energy')
        call check_count(error, watch%dips, 7, 'dips')
        if (allocated(error)) return
        do k = 0, 6
            ! The figures have these digits.
            call check_below(error, abs(watch%dip_time(k + 1) - 2.875_wp - 5.75_wp*k), 0.006_wp, 'time of a dip')
            call check_below(error, abs(watch%dip_depth(k + 1) - 0.4953_wp), 5.0e-5_wp, 'depth of a dip')
        end do
        call check_count(error, statistics%steps, 40000, 'steps')
        call check_below(error, statistics%position_error, 1.0e-11_wp, 'position error')
        call check_below(error, statistics%velocity_error, 1.0e-11_wp, 'velocity error')
        call check_below(error, statistics%acceleration_error, 1.0e-11_wp, 'acceleration error')
        call check_true(error, watch%error_watch%looked_at >= 4000, 'every tenth state is measured')
        call check_below(error, maxval(watch%error_watch%errors), 1.0e-11_wp, 'largest measured error')
    end subroutine test_disk_40

    !> Run a scene from its reference's start under a watch.
    subroutine run_scene(scene, options, t_end, watch, statistics, error)
        character(len=*), intent(in) :: scene
        type(options_type), intent(in) :: options
        real(wp), intent(in) :: t_end
        type(long_watch_type), intent(inout) :: watch
        type(statistics_type), intent(out) :: statistics
        type(error_type), allocatable, intent(inout) :: error
        class(model_type), allocatable, target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)

        call new_scene(scene, model)
        call get_start(scene, q, qd)
        call run(simulation, model, options, 0.0_wp, q, qd, t_end, failure, watch)
        call check_no_failure(error, failure)
        statistics = simulation%statistics()
        call check_count(error, statistics%charts, int(sum(statistics%charts_by)), 'charts against their reasons')
    end subroutine run_scene

    !> The vehicle hardly turns: one chart, and one more after the breakpoint. The disk needs some eighty in 40 s, twenty in 10 s.
    subroutine test_adaptive_few(error)
        type(error_type), allocatable, intent(out) :: error
        type(long_watch_type) :: watch
        type(statistics_type) :: statistics

        call run_scene('vehicle', choose(chart='adaptive'), 10.0_wp, watch, statistics, error)
        call check_count(error, statistics%charts, 2, 'charts of the vehicle')
        call run_scene('disk', choose(step=2.0e-3_wp, chart='adaptive'), 10.0_wp, watch, statistics, error)
        call check_between(error, real(statistics%charts, wp), 15.0_wp, 25.0_wp, 'charts of the disk')
        call check_count(error, statistics%charts_by(by_d) + statistics%charts_by(by_fbar) + 1, int(statistics%charts), &
            'charts by |D| and |Fbar|')
    end subroutine test_adaptive_few

    !> Counts of RK4 and SDIRK54 with the limit of 1.5.
    subroutine test_adaptive_80(error)
        type(error_type), allocatable, intent(out) :: error
        type(long_watch_type) :: watch
        type(statistics_type) :: statistics

        call run_scene('disk', choose(chart='adaptive'), 40.0_wp, watch, statistics, error)
        call check_count(error, statistics%charts, 80, 'charts of the disk')
        call check_count(error, statistics%charts_by(by_d) + statistics%charts_by(by_fbar), 79, 'charts by |D| and |Fbar|')
        call run_scene('vehicle', choose(chart='adaptive', stepper='sdirk54'), 10.0_wp, watch, statistics, error)
        call check_count(error, statistics%charts, 2, 'charts of the vehicle')
        call run_scene('motorcycle', choose(step=2.0e-3_wp, chart='adaptive', stepper='sdirk54'), 10.0_wp, watch, statistics, &
            error)
        call check_count(error, statistics%charts, 2, 'charts of the motorcycle')
    end subroutine test_adaptive_80

    subroutine test_every_step(error)
        type(error_type), allocatable, intent(out) :: error
        type(long_watch_type) :: watch
        type(statistics_type) :: statistics

        call run_scene('knife_edge', choose(step=0.01_wp), 1.0_wp, watch, statistics, error)
        call check_count(error, statistics%steps, 100, 'steps')
        ! The first step has the chart of the start.
        call check_count(error, statistics%charts, 100, 'charts')
        call check_count(error, statistics%charts_by(by_step), 99, 'charts by the policy')
    end subroutine test_every_step

    !> A pendulum of length 1 without gravity that turns at 1 rad/s, 1000 steps of 0.01 s: the angle since the last chart is
    !> known at every step, and with it the number of charts.
    subroutine spin(options, scale, charts, reason, error)
        type(options_type), intent(in) :: options
        real(wp), intent(in) :: scale
        integer, intent(in) :: charts, reason
        type(error_type), allocatable, intent(inout) :: error
        type(pendulum_type), target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)

        model%g = 0.0_wp
        model%length = 1.0_wp
        call model%define()
        model%coordinate_scale = [scale, scale]
        call model%start(0.2_wp, 1.0_wp, q, qd)
        call run(simulation, model, options, 0.0_wp, q, qd, 10.0_wp, failure)
        call check_no_failure(error, failure)
        statistics = simulation%statistics()
        call check_count(error, statistics%steps, 1000, 'steps')
        call check_count(error, statistics%charts, charts, 'charts')
        call check_count(error, statistics%charts_by(reason), charts - 1, 'charts by that reason')
    end subroutine spin

    !> The secant passes 3 at 1.231: after 124 steps, 8 times.
    subroutine test_seventy_degrees(error)
        type(error_type), allocatable, intent(out) :: error

        call spin(choose(step=0.01_wp, chart='paper'), 1.0_wp, 9, by_d, error)
        call spin(choose(step=0.01_wp, chart='paper', refresh='refine'), 1.0_wp, 9, by_d, error)
        call spin(choose(step=0.01_wp, chart='paper', stepper='sdirk54'), 1.0_wp, 9, by_d, error)
    end subroutine test_seventy_degrees

    !> With every stepper, fixed steps and error control. A chart of the disk that is kept ends the run at 1.7 s.
    subroutine test_carried(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=10), parameter :: scenes(4) = [character(len=10) :: 'disk', 'vehicle', 'motorcycle', 'chopper']
        class(model_type), allocatable, target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)
        real(wp) :: t_end
        integer :: i, j, k

        do i = 1, size(scenes)
            t_end = merge(4.0_wp, 10.0_wp, i == 1)
            do j = 1, size(stepper_names)
                do k = 1, 2
                    if (k == 2 .and. stepper_names(j) == 'rk4') cycle
                    call new_scene(trim(scenes(i)), model)
                    call get_start(trim(scenes(i)), q, qd)
                    options = choose(step=4.0e-3_wp, chart='paper', stepper=stepper_names(j))
                    if (k == 2) call change_stepper(options, options%stepper, rtol=1.0e-6_wp)
                    call run(simulation, model, options, 0.0_wp, q, qd, t_end, failure)
                    call check_no_failure(error, failure)
                    if (allocated(error)) return
                end do
            end do
        end do
    end subroutine test_carried

    !> |v| = sin(angle) passes 0.5 at 0.5236: after 53 steps, 18 times before the last of 1000 steps.
    subroutine test_v_limit(error)
        type(error_type), allocatable, intent(out) :: error

        call spin(choose(step=0.01_wp, chart='paper', v_limit=0.5_wp), 1.0_wp, 19, by_v, error)
        call spin(choose(step=0.01_wp, chart='paper', refresh='refine', v_limit=0.5_wp), 1.0_wp, 19, by_v, error)
    end subroutine test_v_limit

    !> In coordinates of twice the scale |v| is half as large.
    subroutine test_v_scaled(error)
        type(error_type), allocatable, intent(out) :: error

        call spin(choose(step=0.01_wp, chart='paper', v_limit=0.25_wp), 2.0_wp, 19, by_v, error)
    end subroutine test_v_scaled

    !> |w| = 1 - cos(angle) passes 0.2 at 0.6435: after 65 steps, 15 times.
    subroutine test_w_limit(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options

        options = choose(step=0.01_wp, chart='paper')
        options%w_limit = 0.2_wp
        call spin(options, 1.0_wp, 16, by_w, error)
        options%refresh = 'refine'
        call spin(options, 1.0_wp, 16, by_w, error)
    end subroutine test_w_limit

    !> |D| = 1/cos(angle) passes 1.5 at 0.8411: after 85 steps, 11 times.
    subroutine test_secant_limit(error)
        type(error_type), allocatable, intent(out) :: error

        call spin(choose(step=0.01_wp, chart='adaptive'), 1.0_wp, 12, by_d, error)
        call spin(choose(step=0.01_wp, chart='adaptive', refresh='refine'), 1.0_wp, 12, by_d, error)
        call spin(choose(step=0.01_wp, chart='adaptive'), 7.0_wp, 12, by_d, error)
    end subroutine test_secant_limit

    !> For the spinning pendulum [M D, C'] = [2 d, n] with a tangent d and the normal n: its condition is 2 or a little more at any
    !> angle, so that a limit below it makes a chart a step, and one above it none.
    subroutine test_condition_limit(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options
        integer :: j

        do j = 1, size(refresh_modes)
            options = choose(step=0.01_wp, chart='paper', refresh=refresh_modes(j))
            options%condition_limit = 1.01_wp
            call spin(options, 1.0_wp, 1000, by_condition, error)
            options%condition_limit = 100.0_wp
            options%v_limit = 0.5_wp
            call spin(options, 1.0_wp, 19, by_v, error)
        end do
    end subroutine test_condition_limit

    !> Charts of the disk by a reason, in 500 steps of 2 ms.
    subroutine count_charts(options, reason, charts, error)
        type(options_type), intent(in) :: options
        integer, intent(in) :: reason
        integer, intent(out) :: charts
        type(error_type), allocatable, intent(inout) :: error
        type(long_watch_type) :: watch
        type(statistics_type) :: statistics

        call run_scene('disk', options, 1.0_wp, watch, statistics, error)
        call check_count(error, statistics%steps, 500, 'steps')
        charts = int(statistics%charts_by(reason))
        call check_count(error, statistics%charts, charts + 1, 'charts by that reason and the start')
    end subroutine count_charts

    !> Every step takes more than one correction at some stage, a higher limit acts less often, and a high one never. This excludes
    !> trapezoid and radau5, which restore few points, each near the previous one.
    subroutine test_iteration_limit(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options
        integer :: charts(3), i, j, k
        integer, parameter :: limits(3) = [1, 3, 100]

        do i = 1, size(stepper_names)
            if (any(stepper_names(i) == [character(len=16) :: 'trapezoid', 'radau5'])) cycle
            do j = 1, size(refresh_modes)
                do k = 1, size(limits)
                    options = choose(step=2.0e-3_wp, chart='paper', refresh=refresh_modes(j), stepper=trim(stepper_names(i)))
                    options%iteration_limit = limits(k)
                    call count_charts(options, by_iterations, charts(k), error)
                end do
                call check_count(error, charts(1), 499, 'charts where one correction is allowed')
                call check_true(error, charts(2) < charts(1), 'three allowed corrections make fewer charts')
                call check_count(error, charts(3), 0, 'charts where 100 corrections are allowed')
            end do
        end do
    end subroutine test_iteration_limit

    subroutine test_no_limits(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)

        call model%define()
        ! It swings by 0.5 rad to either side.
        call model%start(0.5_wp, 0.0_wp, q, qd)
        call run(simulation, model, choose(step=5.0e-3_wp, chart='paper'), 0.0_wp, q, qd, 5.0_wp, failure)
        call check_no_failure(error, failure)
        statistics = simulation%statistics()
        call check_count(error, statistics%charts, 1, 'charts')
    end subroutine test_no_limits

    !> Before the first dip all errors are of the size of the step's truncation, 1e-11 at h = 2e-3.
    subroutine test_same_solution(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=10), parameter :: scenes(4) = [character(len=10) :: 'vehicle', 'disk', 'heavy_top', 'knife_edge']
        real(wp), parameter :: t_end(4) = [8.0_wp, 2.0_wp, 0.2_wp, 1.0_wp], v_limit(4) = [10.0_wp, 0.7_wp, 0.3_wp, 0.5_wp]
        real(wp), parameter :: step(4) = [2.0e-3_wp, 2.0e-3_wp, 1.0e-4_wp, 2.0e-3_wp]
        !> Sums of the truncation errors; the heavy top's are the largest.
        real(wp), parameter :: bound(4) = [2.0e-11_wp, 5.0e-11_wp, 5.0e-9_wp, 2.0e-10_wp]
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: state(:, :), first(:, :)
        integer :: i, j, k

        do k = 1, size(scenes)
            call run_to(trim(scenes(k)), choose(step=step(k)), t_end(k), first, failure)
            call check_no_failure(error, failure)
            do i = 1, size(chart_policies)
                do j = 1, size(refresh_modes)
                    call run_to(trim(scenes(k)), choose(step=step(k), chart=chart_policies(i), refresh=refresh_modes(j), &
                        v_limit=v_limit(k)), t_end(k), state, failure)
                    call check_no_failure(error, failure)
                    call check_close(error, state(:, 1), first(:, 1), bound(k), trim(scenes(k))//': q with '// &
                        trim(chart_policies(i))//', '//refresh_modes(j))
                    if (allocated(error)) return
                end do
            end do
        end do
    end subroutine test_same_solution

    !> Other bases of the same spaces: the same v and w up to a rotation, and the same trajectory up to rounding.
    subroutine test_svd(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=10), parameter :: scenes(4) = [character(len=10) :: 'vehicle', 'disk', 'heavy_top', 'knife_edge']
        real(wp), parameter :: v_limit(4) = [10.0_wp, 0.7_wp, 0.3_wp, 0.5_wp]
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: qr(:, :), svd(:, :)
        integer :: j, k

        do k = 1, size(scenes)
            do j = 1, size(refresh_modes)
                options = choose(step=1.0e-2_wp, chart='paper', refresh=refresh_modes(j), v_limit=v_limit(k))
                if (scenes(k) == 'heavy_top') options%step = 1.0e-3_wp
                call run_to(trim(scenes(k)), options, 1.0_wp, qr, failure)
                call check_no_failure(error, failure)
                options%basis = 'svd'
                call run_to(trim(scenes(k)), options, 1.0_wp, svd, failure)
                call check_no_failure(error, failure)
                ! Truncation, up to 1e-5, is the same; rounding and the constraint tolerance grow a little.
                call check_close(error, svd(:, 1), qr(:, 1), 1.0e-10_wp, trim(scenes(k))//': q with '//refresh_modes(j))
            end do
        end do
    end subroutine test_svd

    !> The limits of the spinning pendulum with implicit steps, and the reasons counted.
    subroutine test_implicit_limits(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=9), parameter :: steppers(2) = ['trapezoid', 'sdirk54  ']
        type(options_type) :: options
        integer :: charts, i

        do i = 1, size(steppers)
            call spin(choose(step=0.01_wp, chart='paper', v_limit=0.5_wp, stepper=steppers(i)), 1.0_wp, 19, by_v, error)
            options = choose(step=0.01_wp, chart='paper', stepper=steppers(i))
            options%w_limit = 0.2_wp
            call spin(options, 1.0_wp, 16, by_w, error)
            call spin(choose(step=0.01_wp, chart='adaptive', stepper=steppers(i)), 1.0_wp, 12, by_d, error)
            ! The condition is that of the Newton matrix; for the pendulum it is a number, so the disk's is used.
            options = choose(step=2.0e-3_wp, chart='paper', stepper=steppers(i))
            options%condition_limit = 1.01_wp
            call count_charts(options, by_condition, charts, error)
            call check_count(error, charts, 499, 'charts where the condition passes its limit')
            options%condition_limit = 1.0e6_wp
            call count_charts(options, by_condition, charts, error)
            call check_count(error, charts, 0, 'charts where the condition is below its limit')
        end do
    end subroutine test_implicit_limits

    !> Both implicit steppers, three policies, both refresh modes and both bases, one run each against the default. Runs with a
    !> chart per step differ by rounding; the others by their truncation, as measured, with a margin of two, and of ten if the
    !> remainder of Newton's iteration is visible (sdirk54).
    subroutine test_implicit_same_solution(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=10), parameter :: scenes(3) = [character(len=10) :: 'vehicle', 'disk', 'motorcycle']
        real(wp), parameter :: t_end(3) = [7.0_wp, 2.0_wp, 7.0_wp], v_limit(3) = [10.0_wp, 0.7_wp, 20.0_wp]
        real(wp), parameter :: step(3) = [0.02_wp, 8.0e-3_wp, 0.02_wp]
        character(len=9), parameter :: steppers(2) = ['trapezoid', 'sdirk54  ']
        real(wp), allocatable :: state(:, :), first(:, :)
        real(wp), parameter :: bound(3, 2) = reshape([2.2e-6_wp, 2.5e-6_wp, 1.0e-6_wp, 1.4e-9_wp, 3.0e-10_wp, 1.5e-9_wp], [3, 2])
        !> Smallest tolerance of Newton's iteration. It stops one correction earlier or later by chance, and its remainder grows:
        !> with 1e-13 runs of the disk by the trapezoidal rule differ by 2e-11, with this by 2e-12.
        real(wp), parameter :: of_newton = 1.0e-15_wp
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        integer :: i, j, k, l, m

        do k = 1, size(scenes)
            do i = 1, size(steppers)
                options = choose(step=step(k), stepper=steppers(i))
                options%intol = of_newton
                call run_to(trim(scenes(k)), options, t_end(k), first, failure)
                call check_no_failure(error, failure)
                do j = 1, size(chart_policies)
                    do l = 1, size(refresh_modes)
                        do m = 1, size(basis_methods)
                            options = choose(step=step(k), stepper=steppers(i), chart=chart_policies(j), refresh=refresh_modes(l), &
                                v_limit=v_limit(k))
                            options%intol = of_newton
                            options%basis = basis_methods(m)
                            call run_to(trim(scenes(k)), options, t_end(k), state, failure)
                            call check_no_failure(error, failure)
                            call check_close(error, state(:, 1), first(:, 1), merge(1.0e-11_wp, bound(k, i), &
                                chart_policies(j) == 'every_step'), trim(scenes(k))//': q with '//trim(steppers(i))// &
                                ', '//trim(chart_policies(j))//', '//refresh_modes(l)//', '//basis_methods(m))
                            if (allocated(error)) return
                        end do
                    end do
                end do
            end do
        end do
    end subroutine test_implicit_same_solution

    !> The knife edge turns by 1.5 rad/s: ten thousand equal steps, each with a new chart, would round the angle by the same part of
    !> its last digit, 5e-16, every time (measured without countermeasures: 6e-13 with RK4, 2e-12 with SDIRK54).
    subroutine test_rounding(error)
        type(error_type), allocatable, intent(out) :: error
        type(knife_edge_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: q0(3), qd0(3), q(3), qd(3), qdd(3), lambda(1)
        integer :: i

        call model%define()
        call model%solution(0.0_wp, q0, qd0, qdd, lambda)
        call model%solution(10.0_wp, q, qd, qdd, lambda)
        do i = 1, 2
            call run(simulation, model, choose(step=1.0e-3_wp, stepper=merge('rk4    ', 'sdirk54', i == 1)), 0.0_wp, q0, qd0, &
                10.0_wp, failure)
            call check_no_failure(error, failure)
            ! A few units in the last digit of 15, including the remainder of Newton's iteration.
            call check_below(error, abs(simulation%state%q(3) - q(3)), 5.0e-14_wp, 'angle')
        end do
    end subroutine test_rounding
end module test_charts
