! SPDX-License-Identifier: MIT
!> Tests that results do not depend on the unit of length if the model states its scales.
module test_coordinate_scale
    use asserts, only: check_below, check_no_failure, check_true
    use model_knife_edge, only: knife_edge_type
    use model_pendulum, only: pendulum_type
    use model_rod, only: rod_type
    use runs, only: choose, run
    use tandem, only: change_stepper, articulated_vehicle_type, chart_policies, failure_type => error_type, model_type, &
        motorcycle_type, find_error_warnings, options_type, refresh_modes, rolling_disk_type, simulation_type, statistics_type, &
        warning_type, wp
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_coordinate_scale

contains

    !> The suite.
    subroutine collect_coordinate_scale(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('pendulum-in-millimetres-moves-as-in-metres', test_pendulum), &
            new_unittest('rod-in-millimetres-moves-as-in-metres', test_rod), &
            new_unittest('rod-in-kilometres-moves-as-in-metres', test_kilometres), &
            new_unittest('policies-and-modes-see-scaled-coordinates', test_policies), &
            new_unittest('implicit-steps-see-scaled-coordinates', test_implicit), &
            new_unittest('scenes-take-the-same-steps-in-any-unit', test_scenes), &
            new_unittest('without-scales-the-unit-matters', test_without), &
            new_unittest('uneven-scales-cost-no-accuracy', test_uneven)]
    end subroutine collect_coordinate_scale

    !> Swing a rod from the same angle in some unit; the result in metres.
    subroutine swing_rod(units, with_scale, options, q, charts, error)
        !> Units of length in a metre.
        real(wp), intent(in) :: units
        logical, intent(in) :: with_scale
        type(options_type), intent(in) :: options
        real(wp), intent(out) :: q(3)
        integer, intent(out) :: charts
        type(error_type), allocatable, intent(inout) :: error
        type(rod_type), target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(failure_type), allocatable :: failure
        real(wp) :: q0(3), qd0(3)

        model%units = units
        call model%define()
        if (with_scale) model%coordinate_scale = [units, units, 1.0_wp]
        call model%start(1.0_wp, 2.0_wp, q0, qd0)
        call run(simulation, model, options, 0.0_wp, q0, qd0, 2.0_wp, failure)
        call check_no_failure(error, failure)
        statistics = simulation%statistics()
        charts = int(statistics%charts)
        q = simulation%state%q/[units, units, 1.0_wp]
    end subroutine swing_rod

    subroutine test_pendulum(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: metres, millimetres
        type(simulation_type) :: first, second
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)

        call metres%define()
        call metres%start(1.0_wp, 2.0_wp, q, qd)
        call run(first, metres, choose(step=1.0e-2_wp), 0.0_wp, q, qd, 2.0_wp, failure)
        call check_no_failure(error, failure)
        millimetres%units = 1000.0_wp
        call millimetres%define()
        millimetres%coordinate_scale = [1000.0_wp, 1000.0_wp]
        call millimetres%start(1.0_wp, 2.0_wp, q, qd)
        call run(second, millimetres, choose(step=1.0e-2_wp), 0.0_wp, q, qd, 2.0_wp, failure)
        call check_no_failure(error, failure)
        ! Truncation is 1e-6 in both: differences are due to rounding, and to the end of iterations.
        call check_below(error, maxval(abs(second%state%q/1000 - first%state%q)), 1.0e-12_wp, 'difference of q')
        call check_below(error, maxval(abs(second%state%qd/1000 - first%state%qd)), 1.0e-11_wp, 'difference of qd')
    end subroutine test_pendulum

    subroutine test_rod(error)
        type(error_type), allocatable, intent(out) :: error

        call check_unit(1000.0_wp, choose(step=1.0e-2_wp), error)
    end subroutine test_rod

    subroutine test_kilometres(error)
        type(error_type), allocatable, intent(out) :: error

        call check_unit(1.0e-3_wp, choose(step=1.0e-2_wp), error)
    end subroutine test_kilometres

    !> The rod in a unit against the rod in metres.
    subroutine check_unit(units, options, error)
        real(wp), intent(in) :: units
        type(options_type), intent(in) :: options
        type(error_type), allocatable, intent(inout) :: error
        real(wp) :: q(3), expected(3)
        integer :: charts, charts_expected

        call swing_rod(1.0_wp, .true., options, expected, charts_expected, error)
        call swing_rod(units, .true., options, q, charts, error)
        call check_below(error, maxval(abs(q - expected)), 1.0e-12_wp, 'difference of q with '//trim(options%chart)//', '// &
            options%refresh)
        call check_true(error, charts == charts_expected, 'the number of charts is the same')
    end subroutine check_unit

    subroutine test_policies(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options
        integer :: i, j

        do i = 1, size(chart_policies)
            do j = 1, size(refresh_modes)
                options = choose(step=1.0e-2_wp, chart=chart_policies(i), refresh=refresh_modes(j), v_limit=0.4_wp)
                if (chart_policies(i) == 'paper') options%w_limit = 2.0_wp
                call check_unit(1000.0_wp, options, error)
            end do
        end do
    end subroutine test_policies

    !> Newton's iteration stops by scaled coordinates too: the runs differ by its remainder, 1e-14 per stage.
    subroutine test_implicit(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options
        integer :: i

        do i = 1, size(chart_policies)
            options = choose(step=1.0e-2_wp, chart=chart_policies(i), stepper='sdirk54', v_limit=0.4_wp)
            call check_unit(1000.0_wp, options, error)
            options%stepper = 'trapezoid'
            call check_unit(1.0e-3_wp, options, error)
        end do
    end subroutine test_implicit

    !> Steps by an error estimate in a unit that is a power of two, so that differences from metres can only be due to a missing
    !> scale, or to the order of summation.
    subroutine test_scenes(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=9), parameter :: steppers(3) = [character(len=9) :: 'dopri5', 'dop853', 'sdirk54']
        character(len=10), parameter :: scenes(3) = [character(len=10) :: 'disk', 'vehicle', 'motorcycle']
        real(wp), parameter :: units(2) = [2.0_wp**10, 2.0_wp**(-20)]
        type(statistics_type) :: in_metres, in_units
        real(wp), allocatable :: y(:), expected(:)
        integer :: i, j, k

        do i = 1, size(scenes)
            do j = 1, size(steppers)
                call run_scene(trim(scenes(i)), 1.0_wp, trim(steppers(j)), expected, in_metres, error)
                do k = 1, size(units)
                    call run_scene(trim(scenes(i)), units(k), trim(steppers(j)), y, in_units, error)
                    if (allocated(error)) return
                    call check_true(error, in_units%steps == in_metres%steps .and. in_units%rejected == in_metres%rejected &
                        .and. in_units%failed == in_metres%failed, 'the steps of the '//trim(scenes(i))//' with '// &
                        trim(steppers(j))//' are the same')
                    ! Measured: 2e-11. Rounding, amplified a hundred times by the disk, and by the step sizes, which follow errors
                    ! of 1e-6.
                    call check_below(error, maxval(abs(y - expected)), 1.0e-9_wp, 'difference on the '//trim(scenes(i)))
                end do
            end do
        end do
    end subroutine test_scenes

    !> Run a scene for 5 s in a unit; its end in metres, and its cost.
    subroutine run_scene(scene, units, stepper, y, statistics, error)
        character(len=*), intent(in) :: scene, stepper
        !> Units of length in a metre.
        real(wp), intent(in) :: units
        real(wp), allocatable, intent(out) :: y(:)
        type(statistics_type), intent(out) :: statistics
        type(error_type), allocatable, intent(inout) :: error
        class(model_type), allocatable, target :: model
        type(rolling_disk_type) :: disk
        type(articulated_vehicle_type) :: vehicle
        type(motorcycle_type) :: motorcycle
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        real(wp), allocatable :: q(:), qd(:), scale(:)
        integer :: stat

        associate (l => units)
            select case (scene)
            case ('disk')
                disk%radius = l*disk%radius
                disk%gravity = l*disk%gravity
                disk%inertia = l**2*disk%inertia
                call disk%define()
                allocate (scale, source=[l, l, l, 1.0_wp, 1.0_wp, 1.0_wp, 1.0_wp, l, l])
                allocate (q(9), qd(9))
                call disk%start([-1.0_wp, 0.01_wp, 0.0_wp], 0.0_wp, q, qd)
                allocate (model, source=disk)
            case ('vehicle')
                vehicle%half_length = l*vehicle%half_length
                vehicle%inertia = l**2*vehicle%inertia
                call vehicle%define()
                allocate (scale, source=[l, l, 1.0_wp, l, l, 1.0_wp])
                allocate (q(6), qd(6))
                call vehicle%start(15*l, q, qd)
                allocate (model, source=vehicle)
            case default
                motorcycle%inertia = l**2*motorcycle%inertia
                motorcycle%gravity = l*motorcycle%gravity
                motorcycle%wheel_radius = l*motorcycle%wheel_radius
                motorcycle%rear_length = l*motorcycle%rear_length
                motorcycle%half_track = l*motorcycle%half_track
                motorcycle%fork_forward = l*motorcycle%fork_forward
                motorcycle%fork_height = l*motorcycle%fork_height
                call motorcycle%define()
                allocate (scale, source=[l, l, l, 1.0_wp, 1.0_wp, 1.0_wp, 1.0_wp, l, l, l])
                allocate (q(10), qd(10))
                call motorcycle%start(15*l, q, qd, stat)
                allocate (model, source=motorcycle)
            end select
        end associate
        allocate (model%coordinate_scale, source=scale)
        options = choose(stepper=stepper)
        call change_stepper(options, options%stepper, rtol=1.0e-6_wp)
        call run(simulation, model, options, 0.0_wp, q, qd, 5.0_wp, failure)
        call check_no_failure(error, failure)
        y = [simulation%state%q/scale, simulation%state%qd/scale]
        statistics = simulation%statistics()
    end subroutine run_scene

    !> The control of the tests above: a basis that is orthonormal in mixed units gives another truncation error.
    subroutine test_without(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: q(3), expected(3)
        integer :: charts

        call swing_rod(1.0_wp, .false., choose(step=1.0e-2_wp), expected, charts, error)
        call swing_rod(1000.0_wp, .false., choose(step=1.0e-2_wp), q, charts, error)
        call check_true(error, maxval(abs(q - expected)) > 1.0e-10_wp, 'without scales the results differ')
    end subroutine test_without

    !> A knife edge turns through the heading across the slope on a chart with uneven scales, 1 to 30: there a chart can become
    !> singular within a step, and then the error estimates fail. Newton matrices of implicit steps are moved from chart to chart: a
    !> matrix from the edge of a chart, or from a transverse one, makes corrections small, and a stagnating iteration looks like a
    !> converged one. If charts last longer than an implicit step, a result may miss the tolerance, but not without a warning.
    subroutine test_uneven(error)
        type(error_type), allocatable, intent(out) :: error
        type(knife_edge_type), target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        type(warning_type), allocatable :: doubts(:)
        character(len=9), parameter :: steppers(4) = [character(len=9) :: 'dopri5', 'dop853', 'sdirk54', 'trapezoid']
        !> In units of the tolerance: the trapezoidal rule takes hundreds of steps, each with an error of a part of it.
        real(wp), parameter :: allowed(4) = [300.0_wp, 300.0_wp, 300.0_wp, 500.0_wp]
        real(wp) :: q(3), qd(3), qdd(3), lambda(1), rtol, off
        integer :: stepper, policy, i

        call model%define()
        model%coordinate_scale = [0.1_wp, 3.0_wp, 1.0_wp]
        do stepper = 1, size(steppers)
            do policy = 1, size(chart_policies)
                do i = 0, merge(60, 30, stepper <= 2)
                    rtol = 10.0_wp**(-4.0_wp - 0.1_wp*i)
                    options = options_type(stepper=trim(steppers(stepper)), rtol=rtol, chart=chart_policies(policy))
                    call model%solution(0.0_wp, q, qd, qdd, lambda)
                    call simulation%initialize(model, options, 0.0_wp, q, qd, failure)
                    if (.not. allocated(failure)) call simulation%integrate(3.0_wp, failure)
                    call check_no_failure(error, failure)
                    if (allocated(error)) return
                    call model%solution(3.0_wp, q, qd, qdd, lambda)
                    off = maxval(abs(simulation%state%q - q))
                    call find_error_warnings(options, simulation%statistics(), doubts)
                    if (stepper > 2 .and. size(doubts) > 0 .and. chart_policies(policy) /= 'every_step') cycle
                    call check_below(error, off, allowed(stepper)*rtol, trim(steppers(stepper))//', '// &
                        trim(chart_policies(policy)))
                    if (allocated(error)) return
                end do
            end do
        end do
    end subroutine test_uneven
end module test_coordinate_scale
