! SPDX-License-Identifier: MIT
!> Tests of the three constraint levels over all steps: by the simulation's own statistics, and measured by the test with the
!> model's procedures; and of the tolerances.
module test_constraints
    use asserts, only: check_below, check_between, check_count, check_no_failure, check_true
    use model_moving_pivot, only: moving_pivot_type
    use model_rod, only: rod_type
    use model_sleigh, only: sleigh_type
    use runs, only: choose, get_start, new_scene, run
    use tandem, only: basis_methods, chart_policies, failure_type => error_type, model_type, options_type, refresh_modes, &
        simulation_type, statistics_type, wp
    use testdrive, only: error_type, new_unittest, unittest_type
    use watch, only: error_watch_type
    implicit none (type, external)
    private

    public :: collect_constraints

    !> Guaranteed at every step with default options.
    real(wp), parameter :: promised = 1.0e-11_wp
    character(len=9), parameter :: implicit_steppers(2) = ['trapezoid', 'sdirk54  ']

contains

    !> The suite.
    subroutine collect_constraints(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('default-options-hold-all-levels', test_default), &
            new_unittest('implicit-steps-hold-all-levels', test_implicit), &
            new_unittest('implicit-steps-hold-all-levels-of-the-test-models', test_implicit_models), &
            new_unittest('implicit-steps-hold-all-levels-with-all-options', test_implicit_options), &
            new_unittest('rheonomic-constraints-hold-at-all-levels', test_rheonomic), &
            new_unittest('all-policies-and-modes-hold-all-levels', test_policies), &
            new_unittest('constraints-hold-across-a-jump-of-nu', test_jump), &
            new_unittest('scales-weigh-the-rows', test_scaled), &
            new_unittest('statistics-are-the-largest-errors-of-all-steps', test_statistics), &
            new_unittest('loose-tolerances-are-used', test_loose), &
            new_unittest('refinement-errors-fall-with-the-tolerance', test_refine_falls), &
            new_unittest('refinement-errors-fall-with-the-tolerance-with-sdirk54', test_refine_falls_sdirk54)]
    end subroutine collect_constraints

    !> Run a scene and bound the errors, by both measures.
    subroutine check_scene(scene, options, t_end, bound, error)
        character(len=*), intent(in) :: scene
        type(options_type), intent(in) :: options
        real(wp), intent(in) :: t_end, bound
        type(error_type), allocatable, intent(inout) :: error
        class(model_type), allocatable, target :: model
        real(wp), allocatable :: q(:), qd(:)

        call new_scene(scene, model)
        call get_start(scene, q, qd)
        call check_model(model, options, q, qd, t_end, bound, error)
    end subroutine check_scene

    !> Run a model from t = 0 and bound the errors, by both measures.
    subroutine check_model(model, options, q, qd, t_end, bound, error)
        class(model_type), intent(inout), target :: model
        type(options_type), intent(in) :: options
        real(wp), intent(in) :: q(:), qd(:), t_end, bound
        type(error_type), allocatable, intent(inout) :: error
        type(simulation_type) :: simulation
        type(error_watch_type) :: watch
        type(statistics_type) :: statistics
        type(failure_type), allocatable :: failure

        call run(simulation, model, options, 0.0_wp, q, qd, t_end, failure, watch)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        statistics = simulation%statistics()
        call check_count(error, watch%looked_at, int(statistics%steps) + 2, 'states that were looked at')
        call check_below(error, statistics%position_error, bound, model%name//': position error')
        call check_below(error, statistics%velocity_error, bound, model%name//': velocity error')
        call check_below(error, statistics%acceleration_error, bound, model%name//': acceleration error')
        call check_below(error, watch%errors(1), bound, model%name//': measured position error')
        call check_below(error, watch%errors(2), bound, model%name//': measured velocity error')
        call check_below(error, watch%errors(3), bound, model%name//': measured acceleration error')
    end subroutine check_model

    !> Default options: the disk up to t = 10, the suite `charts` follows it to 40 s; nu of the motorcycles jumps at 2 pi.
    subroutine test_default(error)
        type(error_type), allocatable, intent(out) :: error

        call check_scene('vehicle', choose(), 10.0_wp, promised, error)
        call check_scene('disk', choose(), 10.0_wp, promised, error)
        call check_scene('heavy_top', choose(), 2.0_wp, promised, error)
        call check_scene('knife_edge', choose(), 10.0_wp, promised, error)
        call check_scene('stiff_pendulum', choose(step=1.0e-4_wp), 0.5_wp, promised, error)
        call check_scene('motorcycle', choose(), 10.0_wp, promised, error)
        call check_scene('chopper', choose(), 10.0_wp, promised, error)
    end subroutine test_default

    !> All scenes with both implicit steppers; twice the default step, to save time.
    subroutine test_implicit(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=10), parameter :: scenes(4) = [character(len=10) :: 'vehicle', 'disk', 'motorcycle', 'chopper']
        integer :: i, k

        do i = 1, size(implicit_steppers)
            do k = 1, size(scenes)
                call check_scene(trim(scenes(k)), choose(step=2.0e-3_wp, stepper=trim(implicit_steppers(i))), 10.0_wp, promised, &
                    error)
                call name_options(error, choose(stepper=trim(implicit_steppers(i))))
            end do
        end do
    end subroutine test_implicit

    subroutine test_implicit_models(error)
        type(error_type), allocatable, intent(out) :: error
        type(moving_pivot_type), target :: pivot
        type(sleigh_type), target :: sleigh
        type(options_type) :: options
        real(wp) :: q(3), qd(3)
        integer :: i

        do i = 1, size(implicit_steppers)
            options = choose(step=1.0e-3_wp, stepper=trim(implicit_steppers(i)))
            call check_scene('heavy_top', options, 0.5_wp, promised, error)
            call check_scene('knife_edge', options, 2.0_wp, promised, error)
            options%step = 1.0e-4_wp
            call check_scene('stiff_pendulum', options, 0.5_wp, promised, error)
            options%step = 1.0e-2_wp
            pivot%swing = 0.3_wp
            call pivot%define()
            call pivot%motion(0.0_wp, 0.5_wp, 2.0_wp, q(:2), qd(:2))
            call check_model(pivot, options, q(:2), qd(:2), 2.0_wp, promised, error)
            call sleigh%define(0.7_wp)
            sleigh%segment = 1
            call sleigh%motion(0.0_wp, [0.0_wp, 0.0_wp, 0.3_wp, 1.0_wp, 0.5_wp], q, qd)
            call check_model(sleigh, options, q, qd, 2.0_wp, promised, error)
            call name_options(error, options)
        end do
    end subroutine test_implicit_models

    !> Policies, refresh modes and bases, on the disk through its first dip and on the motorcycle through its jump.
    subroutine test_implicit_options(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options
        integer :: i, j, k, l

        do i = 1, size(implicit_steppers)
            do j = 1, size(chart_policies)
                do k = 1, size(refresh_modes)
                    do l = 1, size(basis_methods)
                        options = choose(step=1.0e-2_wp, stepper=trim(implicit_steppers(i)), chart=chart_policies(j), &
                            refresh=refresh_modes(k), v_limit=0.5_wp)
                        options%basis = basis_methods(l)
                        call check_scene('disk', options, 4.0_wp, promised, error)
                        if (chart_policies(j) == 'paper') options%v_limit = 20.0_wp
                        call check_scene('motorcycle', options, 7.0_wp, promised, error)
                        call name_options(error, options)
                        if (allocated(error)) return
                    end do
                end do
            end do
        end do
    end subroutine test_implicit_options

    !> Add the options to a failure.
    subroutine name_options(error, options)
        type(error_type), allocatable, intent(inout) :: error
        type(options_type), intent(in) :: options

        if (.not. allocated(error)) return
        if (index(error%message, ' [') > 0) return
        error%message = error%message//' ['//trim(options%stepper)//', '//trim(options%chart)//', '//options%refresh//', '// &
            options%basis//']'
    end subroutine name_options

    subroutine test_rheonomic(error)
        type(error_type), allocatable, intent(out) :: error
        type(moving_pivot_type), target :: model
        real(wp) :: q(2), qd(2)

        model%swing = 0.3_wp
        call model%define()
        call model%motion(0.0_wp, 0.5_wp, 2.0_wp, q, qd)
        call check_model(model, choose(step=2.0e-3_wp), q, qd, 4.0_wp, promised, error)
    end subroutine test_rheonomic

    !> Six combinations, on the disk through its first dip and on a shaken pendulum that turns over. (If the pivot moves as fast as
    !> the mass, |v| is unrelated to the angle, and the paper's policy loses its chart.)
    subroutine test_policies(error)
        type(error_type), allocatable, intent(out) :: error
        type(moving_pivot_type), target :: model
        type(options_type) :: options
        real(wp) :: q(2), qd(2)
        integer :: i, j

        model%speed = 0.0_wp
        model%fall = 0.0_wp
        model%swing = 0.05_wp
        call model%define()
        do i = 1, size(chart_policies)
            do j = 1, size(refresh_modes)
                options = choose(step=2.0e-3_wp, chart=chart_policies(i), refresh=refresh_modes(j), v_limit=0.2_wp)
                call check_scene('disk', options, 4.0_wp, promised, error)
                call model%motion(0.0_wp, 0.5_wp, 9.0_wp, q, qd)
                call check_model(model, options, q, qd, 2.0_wp, promised, error)
                if (allocated(error)) then
                    error%message = error%message//' ['//trim(chart_policies(i))//', '//refresh_modes(j)//']'
                    return
                end if
            end do
        end do
    end subroutine test_policies

    subroutine test_jump(error)
        type(error_type), allocatable, intent(out) :: error
        type(sleigh_type), target :: model
        real(wp) :: q(3), qd(3)

        call model%define(0.7_wp)
        call model%motion(0.0_wp, [0.0_wp, 0.0_wp, 0.3_wp, 1.0_wp, 0.5_wp], q, qd)
        call check_model(model, choose(step=1.0e-2_wp), q, qd, 2.0_wp, promised, error)
    end subroutine test_jump

    !> Millimetres with a matching scale.
    subroutine test_scaled(error)
        type(error_type), allocatable, intent(out) :: error
        type(rod_type), target :: model
        real(wp) :: q(3), qd(3)

        model%units = 1000.0_wp
        call model%define()
        model%coordinate_scale = [1000.0_wp, 1000.0_wp, 1.0_wp]
        call model%start(1.0_wp, 3.0_wp, q, qd)
        call check_model(model, choose(step=2.0e-3_wp), q, qd, 2.0_wp, promised, error)
    end subroutine test_scaled

    !> The two measures share no code and must find the same largest error; a tolerance of 1e-2 makes errors measurable.
    subroutine test_statistics(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: model
        type(simulation_type) :: simulation
        type(error_watch_type) :: watch
        type(statistics_type) :: statistics
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)

        call new_scene('disk', model)
        call get_start('disk', q, qd)
        call run(simulation, model, choose(step=4.0e-3_wp, chart='paper', refresh='refine', v_limit=0.7_wp, &
            tolerance=1.0e-2_wp), 0.0_wp, q, qd, 4.0_wp, failure, watch)
        call check_no_failure(error, failure)
        statistics = simulation%statistics()
        call check_true(error, minval(watch%errors) > 1.0e-11_wp, 'a tolerance of 1e-2 leaves errors above rounding')
        ! Rounding of the residuals, 1e-15, beside errors of 1e-11 and more.
        call check_between(error, statistics%position_error/watch%errors(1), 0.999_wp, 1.001_wp, 'ratio of the position errors')
        call check_between(error, statistics%velocity_error/watch%errors(2), 0.999_wp, 1.001_wp, 'ratio of the velocity errors')
        call check_between(error, statistics%acceleration_error/watch%errors(3), 0.999_wp, 1.001_wp, &
            'ratio of the acceleration errors')
    end subroutine test_statistics

    !> A loose constraint tolerance saves corrections, and is satisfied.
    subroutine test_loose(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: loose, tight
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)

        call new_scene('disk', model)
        call get_start('disk', q, qd)
        call run(simulation, model, choose(step=4.0e-3_wp, tolerance=1.0e-6_wp), 0.0_wp, q, qd, 4.0_wp, failure)
        call check_no_failure(error, failure)
        loose = simulation%statistics()
        call run(simulation, model, choose(step=4.0e-3_wp, tolerance=1.0e-13_wp), 0.0_wp, q, qd, 4.0_wp, failure)
        call check_no_failure(error, failure)
        tight = simulation%statistics()
        call check_true(error, loose%position_corrections < tight%position_corrections, 'a loose tolerance saves corrections')
        call check_below(error, loose%position_error, 1.0e-6_wp, 'loose position error')
        call check_below(error, tight%position_error, 1.0e-13_wp, 'tight position error')
    end subroutine test_loose

    !> The paper's Tables 2 and 3 for RK4: with Tol = utol = Btol = Htol the errors fall towards rounding.
    subroutine test_refine_falls(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=7), parameter :: scenes(2) = ['vehicle', 'disk   ']
        real(wp), parameter :: v_limit(2) = [10.0_wp, 0.7_wp], t_end(2) = [10.0_wp, 4.0_wp]
        real(wp), parameter :: tolerances(3) = [1.0e-6_wp, 1.0e-9_wp, 1.0e-12_wp]
        class(model_type), allocatable, target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)
        real(wp) :: errors(3, 3)
        integer :: i, k

        do k = 1, size(scenes)
            call new_scene(trim(scenes(k)), model)
            call get_start(trim(scenes(k)), q, qd)
            do i = 1, size(tolerances)
                call run(simulation, model, choose(chart='paper', refresh='refine', v_limit=v_limit(k), tolerance=tolerances(i)), &
                    0.0_wp, q, qd, t_end(k), failure)
                call check_no_failure(error, failure)
                if (allocated(error)) return
                statistics = simulation%statistics()
                errors(:, i) = [statistics%position_error, statistics%velocity_error, statistics%acceleration_error]
                call check_below(error, maxval(errors(:, i)), tolerances(i), trim(scenes(k))//': largest error')
            end do
            ! From the first to the last tolerance every level decreases, unless it was at rounding level.
            call check_true(error, all(errors(:, 3) < max(errors(:, 1), 1.0e-14_wp)), trim(scenes(k))//': every error falls')
        end do
        ! At 1e-6 the errors of the disk are above rounding: the decrease is visible.
        call check_true(error, errors(1, 3) < 1.0e-3_wp*errors(1, 1) .and. errors(3, 3) < 0.1_wp*errors(3, 1), &
            'the errors of the disk fall by decades')
    end subroutine test_refine_falls

    !> The paper's Tables 2 to 4: SDIRK54 with all tolerances equal, on all three scenes.
    subroutine test_refine_falls_sdirk54(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=10), parameter :: scenes(3) = [character(len=10) :: 'vehicle', 'disk', 'motorcycle']
        real(wp), parameter :: v_limit(3) = [10.0_wp, 0.7_wp, 20.0_wp], t_end(3) = [10.0_wp, 4.0_wp, 10.0_wp]
        real(wp), parameter :: tolerances(3) = [1.0e-6_wp, 1.0e-9_wp, 1.0e-12_wp]
        class(model_type), allocatable, target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)
        real(wp) :: errors(3), acceleration_error(3)
        integer :: i, k

        do k = 1, size(scenes)
            call new_scene(trim(scenes(k)), model)
            call get_start(trim(scenes(k)), q, qd)
            do i = 1, size(tolerances)
                options = choose(step=4.0e-3_wp, stepper='sdirk54', chart='paper', refresh='refine', v_limit=v_limit(k), &
                    tolerance=tolerances(i))
                options%intol = tolerances(i)
                call run(simulation, model, options, 0.0_wp, q, qd, t_end(k), failure)
                call check_no_failure(error, failure)
                if (allocated(error)) return
                statistics = simulation%statistics()
                errors = [statistics%position_error, statistics%velocity_error, statistics%acceleration_error]
                acceleration_error(i) = errors(3)
                ! H has an error of Htol where C H = 1; on the natural scale of C qdd + gamma that is hardly more.
                call check_below(error, maxval(errors), 3*tolerances(i), trim(scenes(k))//': largest error')
            end do
            ! (The error of the motorcycle is small already with 1e-6: corrections are of second order and better than required.)
            call check_below(error, acceleration_error(3), 1.0e-3_wp*max(acceleration_error(1), 1.0e-9_wp), &
                trim(scenes(k))//': acceleration error with 1e-12')
        end do
    end subroutine test_refine_falls_sdirk54
end module test_constraints
