! SPDX-License-Identifier: MIT
!> Tests of the sparse chart with large rotations within a step: a rotor with its closed form, a bicycle against the dense chart.
module test_sparse_turns
    use asserts, only: check_close, check_no_failure
    use tandem, only: failure_type => error_type, long, mechanism_type, options_type, simulation_type, statistics_type, wp
    use tandem_io, only: find_scene, read_scene, scene_type
    use testdrive, only: check, error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_sparse_turns

    real(wp), parameter :: origin(3) = 0.0_wp, y_axis(3) = [0.0_wp, 1.0_wp, 0.0_wp]

contains

    !> The suite.
    subroutine collect_sparse_turns(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('a-fast-rotor', test_rotor), &
            new_unittest('steps-of-more-than-half-a-turn', test_half_turns), &
            new_unittest('wheels-under-error-control', test_wheels)]
    end subroutine collect_sparse_turns

    !> A rotor that rotates at 100 rad/s by up to 1.8 rad per step. The natural scale of the rate of its norm row is 50 if its Euler
    !> parameters point between two axes, and 1 if they point along one: the ends of steps are judged by the latter, too.
    subroutine test_rotor(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: speed = 100.0_wp
        integer, parameter :: steps = 40
        ! Errors of dop853 after 40 turns with these angles, some 7e-8 at 0.8 rad times the ninth power of the angle; in the first
        ! case the tolerance of the rows at stages, 1e-11 of scales of up to 50, is larger.
        real(wp), parameter :: turn(4) = [0.3_wp, 0.8_wp, 1.3_wp, 1.8_wp], left(4) = [1.0e-10_wp, 2.0e-7_wp, 5.0e-5_wp, 5.0e-3_wp]
        character(len=9), parameter :: name(4) = ['0.3 rad  ', '0.8 rad  ', '1.3 rad  ', '1.8 rad  ']
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(options_type) :: options
        real(wp) :: angle
        integer :: i

        options%stepper = 'dop853'
        options%chart_kind = 'sparse'
        do i = 1, size(turn)
            options%step = turn(i)/speed
            call run_rotor(mechanism, simulation, options, speed, steps*options%step, error)
            if (allocated(error)) return
            angle = steps*turn(i)
            call check_close(error, simulation%state%q, [origin, cos(0.5_wp*angle), 0.0_wp, sin(0.5_wp*angle), 0.0_wp], left(i), &
                name(i))
        end do
    end subroutine test_rotor

    !> At loose tolerances a step exceeds half a turn, beyond which C of its start does not correct its end. The error stays below
    !> the sum of the local ones, each of which is below the tolerance.
    subroutine test_half_turns(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: speed = 100.0_wp, t_end = 1.0_wp, pi = acos(-1.0_wp)
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(options_type) :: options

        options%stepper = 'dop853'
        options%chart_kind = 'sparse'
        options%rtol = 1.0e-3_wp
        call run_rotor(mechanism, simulation, options, speed, t_end, error)
        if (allocated(error)) return
        statistics = simulation%statistics()
        call check(error, statistics%steps*pi < speed*t_end, 'no step exceeds half a turn')
        if (.not. allocated(error)) call check(error, statistics%failed, 0_long, 'attempts that fail')
        if (.not. allocated(error)) call check_close(error, simulation%state%q, [origin, cos(0.5_wp*speed*t_end), 0.0_wp, &
            sin(0.5_wp*speed*t_end), 0.0_wp], statistics%steps*options%rtol, 'at the end')
    end subroutine test_half_turns

    !> Run a rotor about the y axis.
    subroutine run_rotor(mechanism, simulation, options, speed, t_end, error)
        type(mechanism_type), intent(out), target :: mechanism
        type(simulation_type), intent(inout) :: simulation
        type(options_type), intent(in) :: options
        !> Angular velocity (rad/s) and end of the run (s).
        real(wp), intent(in) :: speed, t_end
        type(error_type), allocatable, intent(out) :: error
        type(failure_type), allocatable :: failure
        real(wp) :: q(7), qd(7)

        call mechanism%add_body('rotor', 2.0_wp, origin, failure, inertia=[0.06_wp, 0.12_wp, 0.06_wp], omega=speed*y_axis)
        if (.not. allocated(failure)) call mechanism%add_joint('axle', 'revolute', 'ground', 'rotor', failure, at=origin, &
            axis=y_axis)
        if (.not. allocated(failure)) call mechanism%define(failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call mechanism%start(q, qd)
        call simulation%initialize(mechanism, options, 0.0_wp, q, qd, failure)
        if (.not. allocated(failure)) call simulation%integrate(t_end, failure)
        call check_no_failure(error, failure)
    end subroutine run_rotor

    !> The wheels of the bicycle turn by more than a radian in a step that the error allows. Every tolerance ends on the motion of
    !> the dense chart, explicit and implicit.
    subroutine test_wheels(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=7), parameter :: stepper(6) = [character(len=7) :: 'dop853', 'dop853', 'dop853', 'dop853', 'radau5', 'radau5']
        character(len=4), parameter :: rtol(6) = ['1e-4', '1e-5', '1e-6', '1e-7', '1e-4', '1e-5']
        ! Errors after 5 s, in which the bicycle goes 25 m, from local errors of rtol.
        real(wp), parameter :: left(6) = [1.0e-2_wp, 1.0e-3_wp, 1.0e-4_wp, 1.0e-5_wp, 1.0e-2_wp, 1.0e-3_wp]
        real(wp), allocatable :: exact(:), q(:)
        integer :: i

        call run_bicycle('dense', 'dop853', '1e-10', exact, error)
        do i = 1, size(stepper)
            call run_bicycle('sparse', trim(stepper(i)), rtol(i), q, error)
            if (allocated(error)) return
            call check_close(error, q, exact, left(i), trim(stepper(i))//' '//rtol(i))
        end do
    end subroutine test_wheels

    !> Run the bicycle to its end: its last coordinates.
    subroutine run_bicycle(kind, stepper, rtol, q, error)
        character(len=*), intent(in) :: kind, stepper, rtol
        real(wp), allocatable, intent(out) :: q(:)
        type(error_type), allocatable, intent(inout) :: error
        type(scene_type), allocatable, target :: scene
        type(simulation_type), allocatable, target :: simulation
        type(failure_type), allocatable :: failure
        character(len=:), allocatable :: path
        character(len=40) :: settings(4)

        allocate (q(0))
        if (allocated(error)) return
        allocate (scene, simulation)
        settings(1) = 'solver.chart_kind='//kind
        settings(2) = 'solver.stepper='//stepper
        settings(3) = 'solver.rtol='//rtol
        settings(4) = 'solver.atol='//rtol
        call find_scene('bicycle', path, failure)
        if (.not. allocated(failure)) call read_scene(path, settings, scene, failure)
        if (.not. allocated(failure)) call simulation%initialize(scene%model, scene%options, scene%t_start, scene%q, scene%qd, &
            failure, scene%assembly)
        if (.not. allocated(failure)) call simulation%integrate(scene%t_end, failure)
        call check_no_failure(error, failure)
        if (.not. allocated(error)) q = simulation%state%q
    end subroutine run_bicycle
end module test_sparse_turns
