! SPDX-License-Identifier: MIT
!> Tests of the chart policies: how many charts, for which reason, and that the solution does not depend on them; the long runs
!> of the vehicle and the disk.
module test_charts
    use asserts, only: check_below, check_between, check_close, check_count, check_no_failure
    use model_pendulum, only: pendulum_type
    use runs, only: choose, get_start, new_scene, run, run_to
    use tandem, only: at_start, at_step, chart_policies, failure_type => error_type, model_type, observer_type, options_type, &
        refresh_modes, simulation_type, statistics_type, wp
    use tandem_simulate_statistics, only: by_breakpoint, by_d, by_fbar, by_start, by_step, by_v, by_w
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_charts

    !> Follows the energy, and the dips of the disk: minima of rz below 0.6.
    type, extends(observer_type) :: long_watch_type
        !> Energy at the start, and its largest relative deviation.
        real(wp) :: energy = 0.0_wp, deviation = 0.0_wp
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
            new_unittest('vehicle-takes-22-charts-with-refinement-too', test_vehicle_22_refine), &
            new_unittest('disk-takes-127-charts-with-the-papers-limit', test_disk_127), &
            new_unittest('disk-takes-127-charts-with-refinement-too', test_disk_127_refine), &
            new_unittest('disk-keeps-its-energy-and-dips-seven-times-in-40-s', test_disk_40), &
            new_unittest('adaptive-charts-are-few', test_adaptive_few), &
            new_unittest('a-chart-every-step-is-one-a-step', test_every_step), &
            new_unittest('limit-on-v-acts-on-the-sine-of-the-angle', test_v_limit), &
            new_unittest('limit-on-v-is-measured-in-scaled-coordinates', test_v_scaled), &
            new_unittest('limit-on-w-acts-on-the-velocity', test_w_limit), &
            new_unittest('secant-limit-acts-on-the-angle', test_secant_limit), &
            new_unittest('paper-policy-without-limits-keeps-its-chart', test_no_limits), &
            new_unittest('all-policies-and-modes-give-the-same-solution', test_same_solution), &
            new_unittest('bases-by-svd-give-the-same-solution', test_svd)]
    end subroutine collect_charts

    subroutine observe(self, simulation, occasion, error)
        class(long_watch_type), intent(inout) :: self
        class(simulation_type), intent(inout) :: simulation
        integer, intent(in) :: occasion
        type(failure_type), allocatable, intent(out) :: error
        real(wp) :: kinetic, potential, curvature, offset
        integer :: stat

        if (occasion /= at_start .and. occasion /= at_step) return
        potential = 0.0_wp
        call simulation%kinetic_energy(kinetic, stat)
        if (associated(simulation%model%potential_energy)) call simulation%potential_energy(potential, stat)
        if (occasion == at_start) self%energy = kinetic + potential
        self%deviation = max(self%deviation, abs((kinetic + potential)/self%energy - 1))
        if (.not. self%follows_dips) return
        associate (rz => simulation%state%q(3), h => simulation%last_step)
            if (self%height(2) < min(0.6_wp, self%height(1)) .and. self%height(2) <= rz .and. self%dips < 20) then
                ! The vertex of the parabola through three heights.
                curvature = self%height(1) - 2*self%height(2) + rz
                offset = (self%height(1) - rz)/(2*curvature)
                self%dips = self%dips + 1
                self%dip_time(self%dips) = simulation%state%t - h + offset*h
                self%dip_depth(self%dips) = self%height(2) - offset**2*curvature/2
            end if
            self%height = [self%height(2), rz]
        end associate
    end subroutine observe

    !> The paper's run of the vehicle: 22 charts, the initial one counted, and 337 500 J.
    subroutine check_vehicle(refresh, error)
        character(len=*), intent(in) :: refresh
        type(error_type), allocatable, intent(out) :: error
        type(long_watch_type) :: watch
        type(statistics_type) :: statistics

        call run_scene('vehicle', choose(chart='paper', refresh=refresh, v_limit=10.0_wp), 10.0_wp, watch, statistics, error)
        call check_count(error, statistics%charts, 22, 'charts')
        call check_count(error, statistics%charts_by(by_start), 1, 'charts at the start')
        call check_count(error, statistics%charts_by(by_v), 20, 'charts by |v|')
        call check_count(error, statistics%charts_by(by_breakpoint), 1, 'charts at the breakpoint')
        call check_below(error, abs(watch%energy/337500.0_wp - 1), 1.0e-15_wp, 'deviation of the energy at the start')
        ! What is promised; the constraints do no work, and order four leaves less than rounding.
        call check_below(error, watch%deviation, 1.0e-8_wp, 'deviation of the energy')
    end subroutine check_vehicle

    subroutine test_vehicle_22(error)
        type(error_type), allocatable, intent(out) :: error

        call check_vehicle('factor', error)
    end subroutine test_vehicle_22

    subroutine test_vehicle_22_refine(error)
        type(error_type), allocatable, intent(out) :: error

        call check_vehicle('refine', error)
    end subroutine test_vehicle_22_refine

    !> The paper's run of the disk: 127 charts, the initial one counted.
    subroutine check_disk(refresh, error)
        character(len=*), intent(in) :: refresh
        type(error_type), allocatable, intent(out) :: error
        type(long_watch_type) :: watch
        type(statistics_type) :: statistics

        call run_scene('disk', choose(chart='paper', refresh=refresh, v_limit=0.7_wp), 40.0_wp, watch, statistics, error)
        call check_count(error, statistics%charts, 127, 'charts')
        call check_count(error, statistics%charts_by(by_v), 126, 'charts by |v|')
        ! Large charts: truncation of 1e-4 in the dips, of which the energy sees less than the paper's seven digits.
        call check_below(error, watch%deviation, 1.0e-6_wp, 'deviation of the energy')
    end subroutine check_disk

    subroutine test_disk_127(error)
        type(error_type), allocatable, intent(out) :: error

        call check_disk('factor', error)
    end subroutine test_disk_127

    subroutine test_disk_127_refine(error)
        type(error_type), allocatable, intent(out) :: error

        call check_disk('refine', error)
    end subroutine test_disk_127_refine

    !> Default options over 40 s: energy, seven dips to rz = 0.4953 at t = 2.875 + 5.75 k, all constraint levels.
    subroutine test_disk_40(error)
        type(error_type), allocatable, intent(out) :: error
        type(long_watch_type) :: watch
        type(statistics_type) :: statistics
        integer :: k

        watch%follows_dips = .true.
        call run_scene('disk', choose(), 40.0_wp, watch, statistics, error)
        call check_below(error, abs(watch%energy/103.500625005_wp - 1), 1.0e-15_wp, 'deviation of the energy at the start')
        call check_below(error, watch%deviation, 1.0e-6_wp, 'deviation of the energy')
        call check_count(error, watch%dips, 7, 'dips')
        if (allocated(error)) return
        do k = 0, 6
            ! The figures are known to these digits.
            call check_below(error, abs(watch%dip_time(k + 1) - 2.875_wp - 5.75_wp*k), 0.006_wp, 'time of a dip')
            call check_below(error, abs(watch%dip_depth(k + 1) - 0.4953_wp), 5.0e-5_wp, 'depth of a dip')
        end do
        call check_count(error, statistics%steps, 40000, 'steps')
        call check_below(error, statistics%position_error, 1.0e-11_wp, 'position error')
        call check_below(error, statistics%velocity_error, 1.0e-11_wp, 'velocity error')
        call check_below(error, statistics%acceleration_error, 1.0e-11_wp, 'acceleration error')
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

    !> The vehicle hardly turns: one chart, and one more for the breakpoint. The disk needs some eighty in 40 s, twenty in 10 s.
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
end module test_charts
