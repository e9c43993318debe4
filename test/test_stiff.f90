! SPDX-License-Identifier: MIT
!> Tests of stiff problems: a suspension a thousand times as stiff and as damped as the motorcycle's, out of balance at the start
!> (eigenvalues -2.7e4 and -10), and a pendulum on a spring that swings with 3132 rad/s and is hardly damped. SDIRK54 damps what it
!> does not resolve, the trapezoidal rule rings, RK4 fails with a named status.
module test_stiff
    use asserts, only: check_below, check_between, check_close, check_failure, check_no_failure, check_text, check_true
    use model_stiff_pendulum, only: stiff_pendulum_type
    use reference, only: read_reference, reference_type
    use runs, only: run
    use tandem, only: failure_type => error_type, model_type, motorcycle_type, options_type, simulation_type, statistics_type, wp
    use testdrive, only: error_type, new_unittest, test_failed, unittest_type
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)
    private

    public :: collect_stiff

contains

    !> The suite.
    subroutine collect_stiff(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('sdirk54-damps-a-stiff-suspension', test_suspension_sdirk54), &
            new_unittest('sdirk54-follows-a-stiff-suspension-at-large-steps', test_suspension_accuracy), &
            new_unittest('trapezoid-rings-on-a-stiff-suspension', test_suspension_trapezoid), &
            new_unittest('rk4-fails-on-a-stiff-suspension', test_suspension_rk4), &
            new_unittest('sdirk54-damps-a-stiff-spring', test_spring_sdirk54), &
            new_unittest('sdirk54-follows-the-slow-motion-of-a-stiff-pendulum', test_spring_reference), &
            new_unittest('trapezoid-rings-on-a-stiff-spring', test_spring_trapezoid), &
            new_unittest('rk4-fails-on-a-stiff-spring', test_spring_rk4)]
    end subroutine collect_stiff

    !> The motorcycle in the equilibrium of its standard suspension, then with k and c times 1000 and the same spring length.
    subroutine set_up(fork_angle, model, q, qd)
        real(wp), intent(in) :: fork_angle
        type(motorcycle_type), intent(inout) :: model
        real(wp), intent(out) :: q(10), qd(10)
        integer :: stat

        model%fork_angle = fork_angle
        call model%define()
        call model%start(15.0_wp, q, qd, stat)
        if (stat /= 0) error stop 'set_up: no equilibrium'
        model%free_length = model%spring_length()
        model%stiffness = 1000*model%stiffness
        model%damping = 1000*model%damping
    end subroutine set_up

    !> The history of one coordinate over the steps of a run, the start included.
    subroutine record(simulation, model, options, q, qd, coordinate, velocity, acceleration, failure)
        type(simulation_type), intent(inout) :: simulation
        class(model_type), intent(inout), target :: model
        type(options_type), intent(in) :: options
        real(wp), intent(in) :: q(:), qd(:)
        integer, intent(in) :: coordinate
        real(wp), intent(out) :: velocity(0:), acceleration(0:)
        type(failure_type), allocatable, intent(out) :: failure
        integer :: i

        velocity = 0.0_wp
        acceleration = 0.0_wp
        call simulation%initialize(model, options, 0.0_wp, q, qd, failure)
        do i = 0, ubound(velocity, 1)
            if (i > 0 .and. .not. allocated(failure)) call simulation%step(huge(1.0_wp), failure)
            if (allocated(failure)) return
            velocity(i) = simulation%state%qd(coordinate)
            acceleration(i) = simulation%state%qdd(coordinate)
        end do
    end subroutine record

    !> The fast mode is down to 3 % after a step; then the slow one decays by exp(-k h/c) = 0.905 a step.
    subroutine test_suspension_sdirk54(error)
        type(error_type), allocatable, intent(out) :: error
        type(motorcycle_type), target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: q(10), qd(10), velocity(0:100), acceleration(0:100)

        call set_up(0.2_wp, model, q, qd)
        options%stepper = 'sdirk54'
        options%step = 1.0e-2_wp
        call record(simulation, model, options, q, qd, 10, velocity, acceleration, failure)
        call check_no_failure(error, failure)
        call check_between(error, acceleration(1)/acceleration(0), 0.02_wp, 0.04_wp, 'what is left of the jolt after a step')
        call check_between(error, minval(velocity(3:100)/velocity(2:99)), 0.89_wp, 0.92_wp, 'slowest decay a step')
        call check_between(error, maxval(velocity(3:100)/velocity(2:99)), 0.89_wp, 0.92_wp, 'fastest decay a step')
    end subroutine test_suspension_sdirk54

    !> Both motorcycles, against ten times smaller steps.
    subroutine test_suspension_accuracy(error)
        type(error_type), allocatable, intent(out) :: error
        type(motorcycle_type), target :: model
        type(simulation_type) :: coarse, fine
        type(statistics_type) :: statistics
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: q(10), qd(10)
        integer :: i

        do i = 1, 2
            call set_up(merge(0.2_wp, atan(1.0_wp), i == 1), model, q, qd)
            options%stepper = 'sdirk54'
            options%step = 1.0e-2_wp
            call run(coarse, model, options, 0.0_wp, q, qd, 0.5_wp, failure)
            call check_no_failure(error, failure)
            options%step = 1.0e-3_wp
            call run(fine, model, options, 0.0_wp, q, qd, 0.5_wp, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            ! Seen: 2e-9 and 3e-9.
            call check_close(error, coarse%state%q, fine%state%q, 2.0e-8_wp, 'q')
            call check_close(error, coarse%state%qd, fine%state%qd, 3.0e-8_wp, 'qd')
            statistics = coarse%statistics()
            ! Seen: 2.4 and 2.3.
            call check_below(error, real(statistics%newton_corrections, wp)/real(statistics%implicit_stages, wp), 4.0_wp, &
                'corrections a stage')
            call check_below(error, max(statistics%position_error, statistics%velocity_error, statistics%acceleration_error), &
                1.0e-12_wp, 'constraint errors')
        end do
    end subroutine test_suspension_accuracy

    !> (1 + z/2)/(1 - z/2) = -0.985 for z = -2.7e4 h = -270: the jolt is still there after a hundred steps.
    subroutine test_suspension_trapezoid(error)
        type(error_type), allocatable, intent(out) :: error
        type(motorcycle_type), target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: q(10), qd(10), velocity(0:100), acceleration(0:100), jump(100)

        call set_up(0.2_wp, model, q, qd)
        options%stepper = 'trapezoid'
        options%step = 1.0e-2_wp
        call record(simulation, model, options, q, qd, 10, velocity, acceleration, failure)
        call check_no_failure(error, failure)
        jump = acceleration(1:) - acceleration(:99)
        call check_between(error, minval(jump(51:100)/jump(50:99)), -0.99_wp, -0.98_wp, 'largest factor a step')
        call check_between(error, maxval(jump(51:100)/jump(50:99)), -0.99_wp, -0.98_wp, 'smallest factor a step')
        call check_below(error, 0.2_wp*acceleration(0), abs(acceleration(100)), 'a fifth of the jolt')
    end subroutine test_suspension_trapezoid

    !> RK4 is stable up to h = 2.8/2.7e4 = 1e-4.
    subroutine test_suspension_rk4(error)
        type(error_type), allocatable, intent(out) :: error
        type(motorcycle_type), target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), parameter :: too_large(3) = [1.0e-2_wp, 1.0e-3_wp, 2.0e-4_wp]
        real(wp) :: q(10), qd(10)
        integer :: i

        call set_up(0.2_wp, model, q, qd)
        do i = 1, size(too_large)
            options%step = too_large(i)
            call run(simulation, model, options, 0.0_wp, q, qd, 1.0_wp, failure)
            call check_failure(error, failure, 'position_diverged', 'front contact')
            if (allocated(error)) return
            call check_text(error, failure%message, 'smaller step')
            call check_below(error, simulation%state%t, 10*options%step, 'time of the last state')
            call check_true(error, all(ieee_is_finite([simulation%state%q, simulation%state%qd, simulation%state%qdd])), &
                'the state left behind should be finite')
        end do
        options%step = 8.0e-5_wp
        call run(simulation, model, options, 0.0_wp, q, qd, 0.02_wp, failure)
        call check_no_failure(error, failure)
        ! The slow mode: a speed of 0.54 at most.
        call check_below(error, abs(simulation%state%qd(10)), 0.6_wp, 'speed of the suspension')
    end subroutine test_suspension_rk4

    !> A pendulum at rest whose spring has its free length, so that the weight makes it swing.
    subroutine swing(stepper, step, simulation, acceleration, failure)
        character(len=*), intent(in) :: stepper
        real(wp), intent(in) :: step
        type(simulation_type), intent(inout) :: simulation
        real(wp), intent(out) :: acceleration(0:)
        type(failure_type), allocatable, intent(out) :: failure
        type(stiff_pendulum_type), target :: model
        type(options_type) :: options
        real(wp) :: velocity(0:ubound(acceleration, 1))

        call model%define()
        options%stepper = stepper
        options%step = step
        call record(simulation, model, options, [sin(0.5_wp), -cos(0.5_wp), 1.0_wp], spread(0.0_wp, 1, 3), 3, velocity, &
            acceleration, failure)
        simulation%model => null()
    end subroutine swing

    !> How much a history alternates: the largest second difference.
    pure real(wp) function ripple(history)
        real(wp), intent(in) :: history(:)
        integer :: n

        n = size(history)
        ripple = maxval(abs(history(3:) - 2*history(2:n - 1) + history(:n - 2)))
    end function ripple

    !> The jolt of 8.6 is gone in five steps; the slow motion has second differences of (2 omega h)**2 5 = 0.02.
    subroutine test_spring_sdirk54(error)
        type(error_type), allocatable, intent(out) :: error
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: acceleration(0:200)

        call swing('sdirk54', 1.0e-2_wp, simulation, acceleration, failure)
        call check_no_failure(error, failure)
        call check_between(error, acceleration(0), 8.0_wp, 9.0_wp, 'jolt')
        call check_below(error, ripple(acceleration(5:)), 0.05_wp, 'ripple')
    end subroutine test_spring_sdirk54

    !> From a spring that is stretched by 1e-3: the phase of the spring's swing is lost, and with it 1e-3 of the slow motion.
    subroutine test_spring_reference(error)
        type(error_type), allocatable, intent(out) :: error
        type(stiff_pendulum_type), target :: model
        type(simulation_type) :: simulation
        type(reference_type) :: table
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        integer :: i

        call model%define()
        call read_reference('stiff_pendulum', table)
        options%stepper = 'sdirk54'
        options%step = 1.0e-2_wp
        call simulation%initialize(model, options, 0.0_wp, table%q(:, 1), table%qd(:, 1), failure)
        do i = 2, size(table%t)
            if (allocated(failure) .or. table%t(i) > 2.0_wp) exit
            call simulation%integrate(table%t(i), failure)
            ! Seen: 6e-3 at t = 2.
            call check_close(error, simulation%state%q(:2), table%q(:2, i), 1.0e-2_wp, 'positions')
            ! Once the spring is at rest, in the reference by its own damping, exp(-6.3 t), its length is that of the tension.
            if (table%t(i) > 0.9_wp) call check_close(error, simulation%state%q(3:), table%q(3:, i), 5.0e-6_wp, 'lengths')
        end do
        call check_no_failure(error, failure)
    end subroutine test_spring_reference

    !> |R(z)| = 1 - 1e-4 for z = +-31 i: after 200 steps the spring swings as on the first day.
    subroutine test_spring_trapezoid(error)
        type(error_type), allocatable, intent(out) :: error
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: acceleration(0:200)

        call swing('trapezoid', 1.0e-2_wp, simulation, acceleration, failure)
        call check_no_failure(error, failure)
        ! Four times the jolt, less some damping.
        call check_between(error, ripple(acceleration(150:)), 25.0_wp, 36.0_wp, 'ripple')
    end subroutine test_spring_trapezoid

    !> h omega = 31 and 3.1, where 2.8 is the limit.
    subroutine test_spring_rk4(error)
        type(error_type), allocatable, intent(out) :: error
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp), parameter :: too_large(2) = [1.0e-2_wp, 1.0e-3_wp]
        real(wp) :: acceleration(0:400)
        integer :: i

        do i = 1, size(too_large)
            call swing('rk4', too_large(i), simulation, acceleration, failure)
            if (.not. allocated(failure)) then
                call test_failed(error, 'RK4 should fail')
                return
            end if
            call check_text(error, failure%message, 'position_diverged: ')
            call check_text(error, failure%message, 'constraint "length"')
            call check_text(error, failure%message, 'smaller step')
        end do
    end subroutine test_spring_rk4
end module test_stiff
