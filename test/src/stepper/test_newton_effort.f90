! SPDX-License-Identifier: MIT
!> Tests of the cost of Newton's iteration for bodies with large rotations within a step: a matrix is right for one position, and a
!> step with stages that are hard to solve must not be followed by another.
module test_newton_effort
    use asserts, only: check_below, check_no_failure
    use large_runs, only: begin
    use runs, only: run
    use tandem, only: failure_type => error_type, mechanism_type, options_type, rolling_disk_type, simulation_type, &
        statistics_type, wp
    use tandem_kinds, only: long
    use tandem_io, only: find_scene, read_scene, scene_type
    use testdrive, only: error_type, new_unittest, test_failed, unittest_type
    implicit none (type, external)
    private

    public :: collect_newton_effort

contains

    !> The suite.
    subroutine collect_newton_effort(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('a-matrix-amid-the-stages-serves-wheels-that-turn', test_bicycle), &
            new_unittest('steps-of-hard-stages-are-not-repeated', test_governor), &
            new_unittest('stages-of-steps-alike-take-hardly-more-than-one', test_alike), &
            new_unittest('fixed-steps-leave-of-stages-a-small-part-of-their-own-error', test_share), &
            new_unittest('iterates-are-corrected-once-a-level', test_iterates), &
            new_unittest('tight-tolerances-keep-the-order-of-sdirk54', test_tight)]
    end subroutine collect_newton_effort

    !> Iterates of the disk's stages near the manifold. Restored to the tolerance, a point took 5.2 corrections, and C was factored
    !> at each point.
    subroutine test_iterates(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type), target :: disk
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(failure_type), allocatable :: failure
        real(wp) :: q(9), qd(9), points

        call disk%define()
        call disk%start([-1.0_wp, 0.01_wp, 0.0_wp], 0.0_wp, q, qd)
        call run(simulation, disk, options_type(stepper='radau5', rtol=1.0e-6_wp), 0.0_wp, q, qd, 2.0_wp, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        statistics = simulation%statistics()
        points = real(statistics%newton_corrections, wp)
        call check_below(error, real(statistics%position_corrections, wp)/points, 2.0_wp, 'corrections of u, per point')
        if (allocated(error)) return
        call check_below(error, real(statistics%constraint_factorizations, wp)/points, 0.8_wp, 'factorisations of C, per point')
    end subroutine test_iterates

    !> Steps of sdirk54 on the disk: a tolerance smaller by 10 takes 10**(1/4) times as many. An estimate of kinks of lower order
    !> exceeded the embedded error at 1e-11: 1152 steps, then 3628.
    subroutine test_tight(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type), target :: disk
        type(simulation_type), allocatable :: simulation
        type(statistics_type) :: statistics
        type(failure_type), allocatable :: failure
        real(wp) :: q(9), qd(9), steps(2)
        integer :: k

        call disk%define()
        do k = 1, 2
            allocate (simulation)
            call disk%start([-1.0_wp, 0.01_wp, 0.0_wp], 0.0_wp, q, qd)
            call run(simulation, disk, options_type(stepper='sdirk54', rtol=0.1_wp**(9 + k)), 0.0_wp, q, qd, 4.0_wp, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            statistics = simulation%statistics()
            steps(k) = real(statistics%steps, wp)
            deallocate (simulation)
        end do
        call check_below(error, steps(2)/steps(1), 1.9_wp, 'steps at 1e-11, relative to those at 1e-10')
    end subroutine test_tight

    !> Run a shipped scene to its end: its last coordinates (n), and corrections per step.
    subroutine run_scene(name, stepper, rtol, q, effort, error)
        character(len=*), intent(in) :: name, stepper, rtol
        real(wp), allocatable, intent(out) :: q(:)
        real(wp), intent(out) :: effort
        type(error_type), allocatable, intent(inout) :: error
        type(scene_type), allocatable, target :: scene
        type(simulation_type), allocatable, target :: simulation
        type(failure_type), allocatable :: failure
        character(len=:), allocatable :: path
        character(len=60) :: settings(4)
        type(statistics_type) :: statistics

        allocate (q(0))
        effort = huge(1.0_wp)
        if (allocated(error)) return
        allocate (scene, simulation)
        settings = ['solver.stepper='//stepper//repeat(' ', 45 - len(stepper)), 'solver.rtol='//rtol//repeat(' ', 48 - len(rtol)), &
            'solver.atol='//rtol//repeat(' ', 48 - len(rtol)), 'solver.chart_kind=dense'//repeat(' ', 37)]
        call find_scene(name, path, failure)
        if (.not. allocated(failure)) call read_scene(path, settings, scene, failure)
        if (.not. allocated(failure)) call simulation%initialize(scene%model, scene%options, scene%t_start, scene%q, scene%qd, &
            failure, scene%assembly)
        if (.not. allocated(failure)) call simulation%integrate(scene%t_end, failure)
        if (allocated(failure)) then
            call test_failed(error, failure%message)
            return
        end if
        q = simulation%state%q
        statistics = simulation%statistics()
        effort = real(statistics%newton_corrections, wp)/real(max(1_long, statistics%steps), wp)
    end subroutine run_scene

    !> The wheels of the bicycle rotate by half a radian within a step. With matrices made at the start of a step, one took 31
    !> corrections with sdirk54 and 58 with radau5.
    subroutine test_bicycle(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), allocatable :: q(:)
        real(wp) :: effort

        call run_scene('bicycle', 'sdirk54', '1e-5', q, effort, error)
        call check_below(error, effort, 16.0_wp, 'corrections a step of sdirk54')
        call run_scene('bicycle', 'radau5', '1e-5', q, effort, error)
        call check_below(error, effort, 20.0_wp, 'corrections a step of radau5')
    end subroutine test_bicycle

    !> The governor's shaft rotates by a radian in a step allowed by the error; its stages require many fallbacks. A step took 82
    !> corrections.
    subroutine test_governor(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), allocatable :: q(:), exact(:)
        real(wp) :: effort

        call run_scene('a05_governor', 'radau5', '1e-9', exact, effort, error)
        call run_scene('a05_governor', 'radau5', '1e-3', q, effort, error)
        call check_below(error, effort, 50.0_wp, 'corrections a step')
        if (.not. allocated(error)) call check_below(error, maxval(abs(q - exact)), 2.0e-3_wp, 'error at the end')
    end subroutine test_governor

    !> Fixed steps of a chain on stiff springs: stages start from the misses of the same stage in previous steps. A step of five
    !> stages took 10.5 corrections, and a factor was made at almost every step.
    subroutine test_alike(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(statistics_type) :: before, after
        type(failure_type), allocatable :: failure
        real(wp), parameter :: h = 1.0e-3_wp
        integer, parameter :: n = 200

        call begin('sprung_chain', 10, options_type(stepper='sdirk54', step=h, chart_kind='sparse'), mechanism, simulation, error)
        if (allocated(error)) return
        ! After the first swing, which is stiff.
        call simulation%integrate(n*h, failure)
        before = simulation%statistics()
        if (.not. allocated(failure)) call simulation%integrate(2*n*h, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        after = simulation%statistics()
        call check_below(error, real(after%newton_corrections - before%newton_corrections, wp)/n, 8.0_wp, 'corrections a step')
        if (allocated(error)) return
        call check_below(error, real(after%newton_matrices - before%newton_matrices, wp)/n, 0.5_wp, 'matrices a step')
    end subroutine test_alike

    !> The stage tolerance of fixed steps follows from their own errors: this costs less than full accuracy, and its effect is
    !> negligible compared with the difference to shorter steps. A given tolerance is respected.
    subroutine test_share(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: h = 1.0e-3_wp, given = 1.0e-14_wp
        real(wp), dimension(:), allocatable :: q, qd, solved_q, solved_qd, exact_q, exact_qd
        integer(long) :: corrections, most

        call run_chain(h, 0.0_wp, q, qd, corrections, error)
        if (.not. allocated(error)) call run_chain(h, given, solved_q, solved_qd, most, error)
        if (.not. allocated(error)) call run_chain(0.2_wp*h, given, exact_q, exact_qd, error=error)
        if (allocated(error)) return
        call check_below(error, real(corrections, wp)/real(most, wp), 0.95_wp, 'corrections, over those with the tolerance given')
        if (allocated(error)) return
        call check_below(error, maxval(abs(q - solved_q)), 0.01_wp*maxval(abs(solved_q - exact_q)), 'what stages leave of q')
        if (allocated(error)) return
        call check_below(error, maxval(abs(qd - solved_qd)), 0.01_wp*maxval(abs(solved_qd - exact_qd)), 'what stages leave of qd')
    end subroutine test_share

    !> A chain on stiff springs for 0.3 s with fixed steps.
    subroutine run_chain(h, intol, q, qd, corrections, error)
        real(wp), intent(in) :: h, intol
        real(wp), allocatable, intent(out) :: q(:), qd(:)
        integer(long), intent(out), optional :: corrections
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(failure_type), allocatable :: failure

        call begin('sprung_chain', 20, options_type(stepper='sdirk54', step=h, intol=intol, chart_kind='sparse'), mechanism, &
            simulation, error)
        if (allocated(error)) return
        call simulation%integrate(0.3_wp, failure)
        call check_no_failure(error, failure)
        q = simulation%state%q
        qd = simulation%state%qd
        statistics = simulation%statistics()
        if (present(corrections)) corrections = statistics%newton_corrections
    end subroutine run_chain
end module test_newton_effort
