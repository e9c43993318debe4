! SPDX-License-Identifier: MIT
!> Tests of stiff problems: a suspension a thousand times as stiff and as damped as the motorcycle's, out of balance at the start
!> (eigenvalues -2.7e4 and -10), and a pendulum on a spring that swings with 3132 rad/s and is hardly damped. SDIRK54 damps
!> unresolved modes, the trapezoidal rule rings, RK4 fails with a status.
module test_stiff
    use asserts, only: check_below, check_between, check_close, check_failure, check_no_failure, check_stopped, check_text, &
        check_true
    use faulty_runs, only: check_state_left
    use model_stiff_pendulum, only: stiff_pendulum_type
    use reference, only: read_reference, reference_type
    use runs, only: run
    use tandem, only: articulated_vehicle_type, failure_type => error_type, model_type, motorcycle_type, options_type, &
        simulation_type, statistics_type, wp
    use testdrive, only: error_type, new_unittest, unittest_type
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
            new_unittest('rk4-fails-on-a-stiff-spring', test_spring_rk4), &
            new_unittest('sdirk54-reaches-its-tolerance-on-a-lightly-damped-spring', test_light_spring), &
            new_unittest('sdirk54-reaches-its-tolerance-on-a-spring-1e4-times-as-stiff', test_stiffer_spring), &
            new_unittest('sdirk54-reaches-its-tolerance-on-a-spring-1e6-times-as-stiff', test_stiffest_spring), &
            new_unittest('an-implicit-stepper-is-advised-on-suspensions-where-it-is-faster', test_advice), &
            new_unittest('sdirk54-reaches-its-tolerance-on-every-suspension', test_suspension_tolerance), &
            new_unittest('the-vehicle-keeps-its-matrix-under-error-control', test_kept_under_control)]
    end subroutine collect_stiff

    !> The motorcycle in the equilibrium of its standard suspension, then with k and c times a factor (default 1000) and the same
    !> spring length.
    subroutine set_up(fork_angle, model, q, qd, factor)
        real(wp), intent(in) :: fork_angle
        type(motorcycle_type), intent(out) :: model
        real(wp), intent(out) :: q(10), qd(10)
        real(wp), intent(in), optional :: factor
        real(wp) :: times
        integer :: stat

        times = 1.0e3_wp
        if (present(factor)) times = factor
        model%fork_angle = fork_angle
        call model%define()
        call model%start(15.0_wp, q, qd, stat)
        if (stat /= 0) error stop 'set_up: no equilibrium'
        model%free_length = model%spring_length()
        model%stiffness = times*model%stiffness
        model%damping = times*model%damping
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

    !> The fast mode is down to 3 % after a step; then the slow one decays by exp(-k h/c) = 0.905 per step.
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
            ! Measured: 2e-9 and 3e-9.
            call check_close(error, coarse%state%q, fine%state%q, 2.0e-8_wp, 'q')
            call check_close(error, coarse%state%qd, fine%state%qd, 3.0e-8_wp, 'qd')
            statistics = coarse%statistics()
            ! Measured: 2.4 and 2.3.
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
            call check_state_left(error, simulation)
        end do
        options%step = 8.0e-5_wp
        call run(simulation, model, options, 0.0_wp, q, qd, 0.02_wp, failure)
        call check_no_failure(error, failure)
        ! The slow mode: a speed of 0.54 at most.
        call check_below(error, abs(simulation%state%qd(10)), 0.6_wp, 'speed of the suspension')
    end subroutine test_suspension_rk4

    !> A pendulum at rest whose spring has its free length, so that it starts to swing under its weight.
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

    !> Size of the alternation in a history: the largest second difference.
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
            ! Measured: 6e-3 at t = 2.
            call check_close(error, simulation%state%q(:2), table%q(:2, i), 1.0e-2_wp, 'positions')
            ! Once the spring is at rest, in the reference by its own damping, exp(-6.3 t), its length is that of the tension.
            if (table%t(i) > 0.9_wp) call check_close(error, simulation%state%q(3:), table%q(3:, i), 5.0e-6_wp, 'lengths')
        end do
        call check_no_failure(error, failure)
    end subroutine test_spring_reference

    !> |R(z)| = 1 - 1e-4 for z = +-31 i: after 200 steps the spring swings undiminished.
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
            call check_failure(error, failure, 'position_diverged', 'constraint "length"')
            call check_stopped(error, failure, piece='smaller step')
        end do
    end subroutine test_spring_rk4

    !> Options of SDIRK54 under error control.
    function controlled(rtol) result(options)
        real(wp), intent(in) :: rtol
        type(options_type) :: options

        options%stepper = 'sdirk54'
        options%rtol = rtol
    end function controlled

    !> Every swing of the spring is followed, 3132 rad/s for 2 s: positions at all times of the reference within 30 tolerances.
    subroutine test_light_spring(error)
        type(error_type), allocatable, intent(out) :: error
        type(stiff_pendulum_type), target :: model
        type(simulation_type) :: simulation
        type(reference_type) :: table
        type(failure_type), allocatable :: failure
        real(wp), parameter :: rtol = 1.0e-6_wp
        real(wp) :: largest
        integer :: i

        call model%define()
        call read_reference('stiff_pendulum', table)
        call simulation%initialize(model, controlled(rtol), 0.0_wp, table%q(:, 1), table%qd(:, 1), failure)
        largest = 0.0_wp
        do i = 2, size(table%t)
            if (.not. allocated(failure)) call simulation%integrate(table%t(i), failure)
            largest = max(largest, maxval(abs(simulation%state%q - table%q(:, i))))
        end do
        call check_no_failure(error, failure)
        ! Measured: 0.05 tolerances.
        call check_below(error, largest, 30*rtol, 'position')
    end subroutine test_light_spring

    !> A spring with frequency sqrt(k/m) = ratio sqrt(g/l) and damping ratio 0.5, stretched by 1e-3 at the start; its length has a
    !> separate scale.
    subroutine pull(ratio, length_scale, rtol, simulation, statistics, error)
        real(wp), intent(in) :: ratio, length_scale, rtol
        type(simulation_type), intent(inout) :: simulation
        type(statistics_type), intent(out) :: statistics
        type(error_type), allocatable, intent(out) :: error
        type(stiff_pendulum_type), target :: model
        type(reference_type) :: table
        type(failure_type), allocatable :: failure

        model%k = 9.81_wp*ratio**2
        model%c = sqrt(model%k)
        call model%define()
        model%coordinate_scale = [1.0_wp, 1.0_wp, length_scale]
        call read_reference('stiff_pendulum', table)
        call run(simulation, model, controlled(rtol), 0.0_wp, table%q(:, 1), table%qd(:, 1), 2.0_wp, failure)
        statistics = simulation%statistics()
        simulation%model => null()
        call check_no_failure(error, failure)
    end subroutine pull

    !> Ratio 1e4, at t = 2 against SDIRK54 with 1e-11 (8e5 steps) and DOP853 with 1e-12 (2e5 steps), which agree to 2.3e-12. With
    !> the length on the scale of the others 38 000 steps, with that of its stretch 2300: the method's stage order of 1 shows in
    !> the length's velocity, and the chart's curvature in the length takes part in that.
    subroutine test_stiffer_spring(error)
        type(error_type), allocatable, intent(out) :: error
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        real(wp), parameter :: rtol = 1.0e-6_wp
        real(wp), parameter :: exact(3) = [0.796082297658_wp, -0.605188392202_wp, 1.000000007350_wp]
        integer :: i

        do i = 1, 2
            call pull(1.0e4_wp, merge(1.0_wp, 1.0e-3_wp, i == 1), rtol, simulation, statistics, error)
            if (allocated(error)) return
            ! Measured: 0.3 tolerances, 0.004.
            call check_below(error, maxval(abs(simulation%state%q - exact)), 30*rtol, 'position')
            ! Measured: 1e4 and 1e7; 2500 steps in between.
            call check_below(error, 1.0e3_wp*statistics%smallest_step, statistics%largest_step, 'steps after the transient')
            if (i == 2) call check_below(error, real(statistics%steps, wp), 5.0e3_wp, 'steps')
        end do
    end subroutine test_stiffer_spring

    !> Ratio 1e6: after 1e-6 s this is a rigid pendulum of length 1, up to 1e-8. SDIRK54 with another length scale agrees with that
    !> to 1.1e-8.
    subroutine test_stiffest_spring(error)
        type(error_type), allocatable, intent(out) :: error
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        real(wp), parameter :: rtol = 1.0e-6_wp
        integer, parameter :: n_steps = 20000
        real(wp), parameter :: h = 2.0_wp/n_steps
        real(wp) :: y(2), k(2, 4)
        integer :: i

        ! RK4 in the angle.
        y = [atan2(0.8423124557927044_wp, 0.5408426081740079_wp), 0.0_wp]
        do i = 1, n_steps
            k(:, 1) = rigid(y)
            k(:, 2) = rigid(y + 0.5_wp*h*k(:, 1))
            k(:, 3) = rigid(y + 0.5_wp*h*k(:, 2))
            k(:, 4) = rigid(y + h*k(:, 3))
            y = y + h/6*(k(:, 1) + 2*k(:, 2) + 2*k(:, 3) + k(:, 4))
        end do
        call pull(1.0e6_wp, 1.0e-3_wp, rtol, simulation, statistics, error)
        if (allocated(error)) return
        ! Measured: 0.5 tolerances.
        call check_below(error, maxval(abs(simulation%state%q - [sin(y(1)), -cos(y(1)), 1.0_wp])), 30*rtol, 'position')
        call check_below(error, 1.0e3_wp*statistics%smallest_step, statistics%largest_step, 'steps after the transient')
        ! Measured: 4600; a step as large as the first ones would need 1e13.
        call check_below(error, real(statistics%steps, wp), 2.0e4_wp, 'steps')
    contains
        pure function rigid(state) result(rate)
            real(wp), intent(in) :: state(2)
            real(wp) :: rate(2)

            rate = [state(2), -9.81_wp*sin(state(1))]
        end function rigid
    end subroutine test_stiffest_spring

    !> Explicit steppers on suspensions of all degrees of stiffness: the recommended stepper takes less work, counted, and there is
    !> no recommendation without stiffness.
    subroutine test_advice(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=6), parameter :: explicit(2) = ['dopri5', 'dop853']
        real(wp), parameter :: rtols(2) = [1.0e-4_wp, 1.0e-7_wp], factors(4) = [1.0_wp, 30.0_wp, 3.0e2_wp, 1.0e3_wp]
        type(motorcycle_type), target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics, advised
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: q(10), qd(10)
        !> Cost of an evaluation of an implicit run, with corrections, matrices and factors, in evaluations of an explicit one:
        !> measured 4 to 11. Times of single runs of some milliseconds depend too much on other load.
        real(wp), parameter :: of_implicit = 12.0_wp
        integer :: i, j, k, n_advised

        n_advised = 0
        do i = 1, size(factors)
            ! With its own springs, the motorcycle changes lanes.
            call set_up(0.2_wp, model, q, qd, factors(i))
            do j = 1, size(explicit)
                do k = 1, size(rtols)
                    options%rtol = rtols(k)
                    options%stepper = explicit(j)
                    call run(simulation, model, options, 0.0_wp, q, qd, merge(10.0_wp, 2.0_wp, i == 1), failure)
                    call check_no_failure(error, failure)
                    statistics = simulation%statistics()
                    if (i == 1) call check_true(error, statistics%advised == '', 'nothing is advised where nothing is stiff')
                    if (allocated(error)) return
                    if (statistics%advised == '') cycle
                    n_advised = n_advised + 1
                    options%stepper = statistics%advised
                    call run(simulation, model, options, 0.0_wp, q, qd, merge(10.0_wp, 2.0_wp, i == 1), failure)
                    call check_no_failure(error, failure)
                    advised = simulation%statistics()
                    call check_below(error, of_implicit*real(advised%right_hand_sides, wp), real(statistics%right_hand_sides, wp), &
                        'counted work on the motorcycle')
                    if (allocated(error)) return
                end do
            end do
        end do
        call check_true(error, n_advised >= 4, 'there is advice')
    end subroutine test_advice

    !> k and c times 1, 1e3, 1e6, across the breakpoint, against SDIRK54 with 1e-9, which DOP853 confirms to 2e-9 and 5e-9 for the
    !> first two, and SDIRK54 with 1e-11 to 2e-9 for the third.
    subroutine test_suspension_tolerance(error)
        type(error_type), allocatable, intent(out) :: error
        type(motorcycle_type), target :: model
        type(simulation_type) :: simulation, fine
        type(statistics_type) :: statistics
        type(failure_type), allocatable :: failure
        real(wp), parameter :: rtol = 1.0e-6_wp, factors(3) = [1.0_wp, 1.0e3_wp, 1.0e6_wp]
        real(wp) :: q(10), qd(10)
        integer :: i

        do i = 1, size(factors)
            call set_up(0.2_wp, model, q, qd, factors(i))
            call run(fine, model, controlled(1.0e-9_wp), 0.0_wp, q, qd, 10.0_wp, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call run(simulation, model, controlled(rtol), 0.0_wp, q, qd, 10.0_wp, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            statistics = simulation%statistics()
            ! Measured: 2.6, 3.4 and 4.0 tolerances, 31, 85 and 89 steps.
            call check_close(error, simulation%state%q, fine%state%q, 30*rtol, 'q')
            call check_close(error, simulation%state%qd, fine%state%qd, 30*rtol, 'qd')
            call check_below(error, real(statistics%steps, wp), 200.0_wp, 'steps')
            if (i > 1) call check_below(error, 1.0e3_wp*statistics%smallest_step, statistics%largest_step, 'steps at the end')
        end do
    end subroutine test_suspension_tolerance

    !> Steps of all sizes take factorisations, hardly any derivatives; the error is the tolerance, 1e-4 to 1e-12.
    subroutine test_kept_under_control(error)
        type(error_type), allocatable, intent(out) :: error
        type(articulated_vehicle_type), target :: vehicle
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(reference_type) :: table
        type(failure_type), allocatable :: failure
        real(wp) :: rtol
        integer :: i

        call vehicle%define()
        call read_reference('vehicle', table)
        do i = 4, 12
            rtol = 10.0_wp**(-i)
            call run(simulation, vehicle, controlled(rtol), 0.0_wp, table%q(:, 1), table%qd(:, 1), 10.0_wp, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            ! Measured: between 1.0 and 1.6 tolerances.
            call check_between(error, maxval(abs(simulation%state%q - table%q(:, size(table%t))))/rtol, 0.01_wp, 30.0_wp, &
                'error over tolerance')
            statistics = simulation%statistics()
            ! Measured: 0.03 to 0.19 per step, one at the start and one after the breakpoint at least.
            call check_below(error, real(statistics%newton_matrices, wp), 2.0_wp + 0.25_wp*real(statistics%steps, wp), 'matrices')
            call check_true(error, statistics%newton_factorizations > statistics%newton_matrices, 'factorisations of a kept matrix')
        end do
    end subroutine test_kept_under_control
end module test_stiff
