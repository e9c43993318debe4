! SPDX-License-Identifier: MIT
!> Tests of RK4's accuracy: exactness on polynomials, and distances from closed forms. Suite `accuracy` compares it with the
!> reference solutions.
!>
!> Bounds are the measured errors of order and step, with a margin of two; truncation errors hardly depend on the machine. If
!> rounding and the constraint tolerance dominate, the margin is ten.
module test_rk4
    use asserts, only: check_below, check_close, check_count, check_no_failure, check_true
    use extrapolation, only: extrapolate
    use model_belt_wheel, only: belt_wheel_type
    use model_knife_edge, only: knife_edge_type
    use model_moving_pivot, only: angle_equation_type, moving_pivot_type
    use model_particle, only: particle_type
    use runs, only: choose, run
    use tandem, only: failure_type => error_type, options_type, properties_type, simulation_type, stepper_names, wp
    use tandem_stepper_rk4, only: rk4_type
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_rk4

contains

    !> The suite.
    subroutine collect_rk4(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('properties-say-what-it-is', test_properties), &
            new_unittest('uniform-motion-of-a-free-particle-is-exact', test_uniform), &
            new_unittest('a-force-that-grows-with-time-squared-is-integrated-exactly', test_exact), &
            new_unittest('a-force-that-grows-with-time-cubed-has-the-error-of-order-four', test_order_four), &
            new_unittest('harmonic-oscillator-has-the-stability-function-of-rk4', test_oscillator), &
            new_unittest('knife-edge-agrees-with-its-closed-form', test_knife_edge_closed), &
            new_unittest('pendulum-that-falls-with-its-pivot-turns-uniformly', test_falling_pivot), &
            new_unittest('pendulum-on-a-shaken-pivot-agrees-with-its-angle-equation', test_shaken_pivot), &
            new_unittest('differences-stand-in-for-a-missing-gamma', test_no_gamma), &
            new_unittest('constraints-alone-give-the-motion-where-nothing-is-free', test_belt_wheel)]
    end subroutine collect_rk4

    subroutine test_properties(error)
        type(error_type), allocatable, intent(out) :: error
        type(rk4_type) :: stepper
        type(properties_type) :: properties

        properties = stepper%properties()
        call check_count(error, properties%order, 4, 'order')
        call check_count(error, properties%stages, 4, 'stages')
        call check_true(error, .not. properties%implicit, 'rk4 is explicit')
        call check_true(error, properties%name == 'rk4' .and. any(stepper_names == 'rk4'), 'rk4 goes by the name rk4')
    end subroutine test_properties

    !> No constraints, no force: q = q0 + t qd0.
    subroutine test_uniform(error)
        type(error_type), allocatable, intent(out) :: error
        type(particle_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp), parameter :: q(3) = [1.0_wp, -2.0_wp, 3.0_wp], qd(3) = [0.5_wp, 0.25_wp, -4.0_wp]

        call model%define(with_force=.false.)
        call run(simulation, model, choose(step=0.125_wp), 0.0_wp, q, qd, 2.0_wp, failure)
        call check_no_failure(error, failure)
        call check_close(error, simulation%state%q, q + 2*qd, 1.0e-15_wp, 'q')
        call check_close(error, simulation%state%qd, qd, 0.0_wp, 'qd')
        call check_close(error, simulation%state%qdd, [0.0_wp, 0.0_wp, 0.0_wp], 0.0_wp, 'qdd')
    end subroutine test_uniform

    !> qdd = t**2 in one step: qd = t**3/3 and q = t**4/12 have degree 3 and 4, which order 4 integrates exactly.
    subroutine test_exact(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: q(3), qd(3)

        call push_particle(2, 1.5_wp, q, qd, error)
        call check_close(error, q, spread(1.5_wp**4/12, 1, 3), 1.0e-15_wp, 'q')
        call check_close(error, qd, spread(1.5_wp**3/3, 1, 3), 1.0e-15_wp, 'qd')
    end subroutine test_exact

    !> qdd = t**3 in one step: qd is exact (Simpson's rule), q gives h**5 (0 + 4/8 + ...)/12 = h**5/24 for h**5/20.
    subroutine test_order_four(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: q(3), qd(3)

        call push_particle(3, 1.5_wp, q, qd, error)
        call check_close(error, q, spread(1.5_wp**5/24, 1, 3), 1.0e-15_wp, 'q')
        call check_close(error, qd, spread(1.5_wp**4/4, 1, 3), 1.0e-15_wp, 'qd')
    end subroutine test_order_four

    !> One step of size h from rest at t = 0 under a force m t**power.
    subroutine push_particle(power, h, q, qd, error)
        integer, intent(in) :: power
        real(wp), intent(in) :: h
        real(wp), intent(out) :: q(3), qd(3)
        type(error_type), allocatable, intent(inout) :: error
        type(particle_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure

        model%power = power
        call model%define(with_force=.true.)
        call run(simulation, model, choose(step=h), 0.0_wp, spread(0.0_wp, 1, 3), spread(0.0_wp, 1, 3), h, failure)
        call check_no_failure(error, failure)
        q = simulation%state%q
        qd = simulation%state%qd
    end subroutine push_particle

    !> For q'' = -q, (q, q') is multiplied by R(h i) = 1 + z + z**2/2 + z**3/6 + z**4/24 in a step.
    subroutine test_oscillator(error)
        type(error_type), allocatable, intent(out) :: error
        type(particle_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp), parameter :: h = 0.3_wp
        complex(wp) :: z, expected
        integer :: i

        model%power = 1
        model%stiffness = model%m
        call model%define(with_force=.true.)
        ! With the force t the equilibrium moves as q = t: the oscillation is q - t.
        call run(simulation, model, choose(step=h), 0.0_wp, spread(1.0_wp, 1, 3), spread(1.0_wp, 1, 3), 20*h, failure)
        call check_no_failure(error, failure)
        z = cmplx(0.0_wp, h, wp)
        expected = (1 + z + z**2/2 + z**3/6 + z**4/24)**20
        do i = 1, 3
            call check_below(error, abs(simulation%state%q(i) - 20*h - real(expected, wp)), 1.0e-14_wp, 'error of q')
            call check_below(error, abs(simulation%state%qd(i) - 1 + aimag(expected)), 1.0e-14_wp, 'error of qd')
        end do
    end subroutine test_oscillator

    subroutine test_knife_edge_closed(error)
        type(error_type), allocatable, intent(out) :: error
        type(knife_edge_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: q(3), qd(3), qdd(3), lambda(1), found(1)

        model%g_sin_alpha = 4.0_wp
        model%w = -2.0_wp
        model%phi0 = 1.0_wp
        model%m = 3.0_wp
        call model%define()
        call model%solution(0.0_wp, q, qd, qdd, lambda)
        call run(simulation, model, choose(step=5.0e-3_wp), 0.0_wp, q, qd, 3.0_wp, failure)
        call check_no_failure(error, failure)
        call model%solution(3.0_wp, q, qd, qdd, lambda)
        call simulation%multipliers(found)
        ! (w h)**4 = 1e-8, times the constants of the method, about 1e-2.
        call check_close(error, simulation%state%q, q, 1.0e-9_wp, 'q')
        call check_close(error, simulation%state%qd, qd, 1.0e-9_wp, 'qd')
        call check_close(error, simulation%state%qdd, qdd, 2.0e-9_wp, 'qdd')
        call check_close(error, found, lambda, 6.0e-9_wp, 'lambda')
    end subroutine test_knife_edge_closed

    subroutine test_falling_pivot(error)
        type(error_type), allocatable, intent(out) :: error
        type(moving_pivot_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp), parameter :: angle = 0.4_wp, rate = 3.0_wp
        real(wp) :: q(2), qd(2), lambda(1)

        call model%define()
        call model%motion(0.0_wp, angle, rate, q, qd)
        call run(simulation, model, choose(step=1.0e-2_wp), 0.0_wp, q, qd, 2.0_wp, failure)
        call check_no_failure(error, failure)
        call model%motion(2.0_wp, angle + 2*rate, rate, q, qd)
        call simulation%multipliers(lambda)
        ! (rate h)**4 = 8e-7 times the constants of the method, about 1/20 per radian, times 6 radians and 0.7 m.
        call check_close(error, simulation%state%q, q, 4.0e-7_wp, 'q')
        call check_close(error, simulation%state%qd, qd, 1.2e-6_wp, 'qd')
        call check_close(error, lambda, [model%m*rate**2], 1.0e-6_wp, 'lambda')
    end subroutine test_falling_pivot

    !> The angle equation has no constraints; extrapolation of order 16 solves it to rounding.
    subroutine test_shaken_pivot(error)
        type(error_type), allocatable, intent(out) :: error
        type(moving_pivot_type), target :: model
        type(angle_equation_type) :: equation
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2), lambda(1), y(2), errors(2)
        integer :: i

        model%swing = 0.2_wp
        model%fall = 2.0_wp
        call model%define()
        equation%model = model
        y = [0.4_wp, 1.0_wp]
        call extrapolate(equation, 0.0_wp, 3.0_wp, 60, y)
        do i = 1, 2
            call model%motion(0.0_wp, 0.4_wp, 1.0_wp, q, qd)
            call run(simulation, model, choose(step=5.0e-3_wp/i), 0.0_wp, q, qd, 3.0_wp, failure)
            call check_no_failure(error, failure)
            call model%motion(3.0_wp, y(1), y(2), q, qd)
            errors(i) = maxval(abs(simulation%state%q - q))
        end do
        call simulation%multipliers(lambda)
        call check_below(error, errors(2), 2.0e-9_wp, 'error of q')
        call check_close(error, simulation%state%qd, qd, 1.0e-8_wp, 'qd')
        call check_close(error, lambda, [model%tension(3.0_wp, y(1), y(2))], 1.0e-7_wp, 'lambda')
        ! The error falls with at least the fourth power of the step, less 10 %.
        call check_below(error, errors(2)/errors(1), 1.1_wp/16, 'ratio of the errors')
    end subroutine test_shaken_pivot

    !> The replacement of gamma is noisy, but as accurate as the reference at h = 1e-3 requires.
    subroutine test_no_gamma(error)
        type(error_type), allocatable, intent(out) :: error
        type(knife_edge_type), target :: knife_edge
        type(moving_pivot_type), target :: moving_pivot
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: q(3), qd(3), qdd(3), lambda(1), with_gamma(2)

        call knife_edge%define()
        knife_edge%constraint_acceleration => null()
        call knife_edge%solution(0.0_wp, q, qd, qdd, lambda)
        call run(simulation, knife_edge, choose(step=1.0e-2_wp), 0.0_wp, q, qd, 2.0_wp, failure)
        call check_no_failure(error, failure)
        call knife_edge%solution(2.0_wp, q, qd, qdd, lambda)
        call check_close(error, simulation%state%q, q, 1.0e-8_wp, 'q of the knife edge')
        moving_pivot%swing = 0.2_wp
        call moving_pivot%define()
        call moving_pivot%motion(0.0_wp, 0.4_wp, 1.0_wp, q(:2), qd(:2))
        call run(simulation, moving_pivot, choose(step=1.0e-2_wp), 0.0_wp, q(:2), qd(:2), 2.0_wp, failure)
        call check_no_failure(error, failure)
        with_gamma = simulation%state%q
        moving_pivot%constraint_acceleration => null()
        call run(simulation, moving_pivot, choose(step=1.0e-2_wp), 0.0_wp, q(:2), qd(:2), 2.0_wp, failure)
        call check_no_failure(error, failure)
        call check_close(error, simulation%state%q, with_gamma, 1.0e-8_wp, 'q of the moving pivot')
    end subroutine test_no_gamma

    !> n = nh + nd: for any step, the constraints determine the motion, and the multipliers balance the forces.
    subroutine test_belt_wheel(error)
        type(error_type), allocatable, intent(out) :: error
        type(belt_wheel_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        character(len=10), parameter :: charts(3) = [character(len=10) :: 'every_step', 'adaptive', 'paper']
        character(len=6), parameter :: modes(2) = ['factor', 'refine']
        real(wp) :: q(2), qd(2), qdd(2), lambda(2), found(2)
        integer :: i, j

        call model%define()
        do i = 1, size(charts)
            do j = 1, size(modes)
                call model%solution(0.0_wp, q, qd, qdd, lambda)
                call run(simulation, model, choose(step=0.05_wp, chart=charts(i), refresh=modes(j)), 0.0_wp, q, qd, 3.0_wp, failure)
                call check_no_failure(error, failure)
                if (allocated(error)) return
                call model%solution(3.0_wp, q, qd, qdd, lambda)
                call simulation%multipliers(found)
                ! phi is fixed by Phi; x is the integral of its rate, by Simpson's rule to h**4/2880 times 3.
                call check_close(error, simulation%state%q(2:2), q(2:2), 1.0e-11_wp, 'phi')
                call check_close(error, simulation%state%q(1:1), q(1:1), 7.0e-9_wp, 'x')
                call check_close(error, simulation%state%qd, qd, 1.0e-12_wp, 'qd')
                call check_close(error, simulation%state%qdd, qdd, 1.0e-12_wp, 'qdd')
                call check_close(error, found, lambda, 1.0e-11_wp, 'lambda')
            end do
        end do
    end subroutine test_belt_wheel
end module test_rk4
