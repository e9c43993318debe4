! SPDX-License-Identifier: MIT
!> Tests of the statuses not covered by the suites failures, faults, model_check and options: those of derivatives, of constraints
!> that degenerate during a run, of constraints that cannot be satisfied; and of the remaining state after a failure.
module test_statuses
    use asserts, only: check_below, check_between, check_close, check_count, check_failure, check_no_failure, check_stopped, &
        check_true
    use faulty_runs, only: check_state_left, run_with_fault, start_swing
    use model_belt_wheel, only: belt_wheel_type
    use model_closing, only: closing_type
    use model_moving_pivot, only: moving_pivot_type
    use model_near, only: near_type, start_near
    use model_particle, only: particle_type
    use model_pendulum, only: pendulum_type
    use model_perturbed, only: perturbed_type
    use model_sleigh, only: sleigh_type
    use model_spy, only: fault_nan, fault_retry, fault_stop, no_fault, spy_type
    use runs, only: run
    use subjects, only: new_subject
    use tandem, only: derivative_name, failure_type => error_type, is_input_error, model_type, n_derivatives, n_terms, &
        options_type, rolling_disk_type, simulation_type, term_name, wp
    use testdrive, only: error_type, new_unittest, unittest_type
    use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
    implicit none (type, external)
    private

    public :: collect_statuses

    !> The steppers with fixed steps.
    character(len=16), parameter :: steppers(3) = [character(len=16) :: 'rk4', 'trapezoid', 'sdirk54']

    !> A pendulum whose rod is longer by this part of its length after the first breakpoint.
    type, extends(pendulum_type) :: jumping_type
        real(wp) :: stretch = 1.0e-6_wp
    end type jumping_type

contains

    !> The suite.
    subroutine collect_statuses(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('missing-evaluate-derivatives-is-named', test_missing_derivatives), &
            new_unittest('a-row-of-zeros-is-named-and-left-out', test_zero_row), &
            new_unittest('a-row-of-zeros-at-the-start-alone-ends-the-run', test_zero_start), &
            new_unittest('rows-that-become-dependent-are-named', test_dependent_later), &
            new_unittest('a-row-that-vanishes-later-is-named', test_zero_row_later), &
            new_unittest('indefinite-mass-is-refused', test_indefinite), &
            new_unittest('every-mixture-of-constraints-works-with-every-stepper', test_mixtures), &
            new_unittest('a-derivative-that-fails-is-reported', test_derivative_stat), &
            new_unittest('a-derivative-that-is-no-number-is-reported', test_derivative_nan), &
            new_unittest('a-failure-leaves-the-last-state-with-its-multipliers', test_left_behind), &
            new_unittest('a-failed-step-can-be-retried-with-a-smaller-one', test_smaller), &
            new_unittest('a-time-too-large-for-the-step-is-an-underflow', test_underflow), &
            new_unittest('constraints-that-cannot-be-held-are-reported', test_not_held), &
            new_unittest('near-redundant-constraints-are-held', test_near_redundant), &
            new_unittest('two-simulations-in-turns-are-two-simulations-alone', test_turns)]
    end subroutine collect_statuses

    subroutine test_missing_derivatives(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)

        call model%define()
        call model%start(0.3_wp, 0.0_wp, q, qd)
        model%provides_derivatives = 4
        call simulation%initialize(model, options, 0.0_wp, q, qd, failure)
        call check_failure(error, failure, 'invalid_model', 'the procedure evaluate_derivatives is missing')
    end subroutine test_missing_derivatives

    subroutine test_zero_row(error)
        type(error_type), allocatable, intent(out) :: error
        type(closing_type), target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        integer :: k

        model%slope = 0.0_wp
        model%first = 0.0_wp
        call model%close_in()
        do k = 1, size(steppers)
            options%stepper = steppers(k)
            call run(simulation, model, options, 0.0_wp, spread(0.0_wp, 1, 3), spread(0.0_wp, 1, 3), 0.01_wp, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call check_true(error, allocated(simulation%warnings), 'there is a warning')
            if (allocated(error)) return
            call check_true(error, index(simulation%warnings(1)%text, '"door" restricts nothing') > 0, &
                'it names the row: '//simulation%warnings(1)%text)
        end do
    end subroutine test_zero_row

    !> A zero row at t = 0, which restricts the motion from then on.
    subroutine test_zero_start(error)
        type(error_type), allocatable, intent(out) :: error
        type(closing_type), target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        integer :: k

        model%t_bad = 0.0_wp
        model%first = 0.0_wp
        call model%close_in()
        do k = 1, size(steppers)
            options%stepper = steppers(k)
            call run(simulation, model, options, 0.0_wp, spread(0.0_wp, 1, 3), spread(0.0_wp, 1, 3), 0.01_wp, failure)
            call check_failure(error, failure, 'rank_deficient', 'constraint "door"')
        end do
    end subroutine test_zero_start

    !> With every stepper: a status and row, at the time of the degeneration or at the chart before it.
    subroutine check_closing(model, error)
        type(closing_type), intent(inout), target :: model
        type(error_type), allocatable, intent(inout) :: error
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        integer :: k

        options%step = 1.0e-2_wp
        options%singular = 'stop'
        do k = 1, size(steppers)
            options%stepper = steppers(k)
            call model%close_in()
            call run(simulation, model, options, 0.0_wp, spread(0.0_wp, 1, 3), [0.0_wp, 0.0_wp, 1.0_wp], 1.0_wp, failure)
            call check_stopped(error, failure, [character(len=24) :: 'rank_deficient', 'chart_left'], place=steppers(k))
            if (allocated(error)) return
            call check_true(error, .not. is_input_error(failure%stat), 'the input is not at fault')
            call check_true(error, simulation%state%t > 0.08_wp .and. simulation%state%t < 0.11_wp, 'the time left behind')
            call check_state_left(error, simulation)
            if (allocated(error)) return
        end do
    end subroutine check_closing

    subroutine test_dependent_later(error)
        type(error_type), allocatable, intent(out) :: error
        type(closing_type), target :: model

        call check_closing(model, error)
    end subroutine test_dependent_later

    subroutine test_zero_row_later(error)
        type(error_type), allocatable, intent(out) :: error
        type(closing_type), target :: model

        model%first = 0.0_wp
        call check_closing(model, error)
    end subroutine test_zero_row_later

    !> M = diag(1, -2, 4) without constraints.
    subroutine test_indefinite(error)
        type(error_type), allocatable, intent(out) :: error
        type(particle_type), target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        integer :: k

        model%m(2) = -2.0_wp
        call model%define(.true.)
        do k = 1, size(steppers)
            options%stepper = steppers(k)
            call simulation%initialize(model, options, 0.0_wp, spread(0.0_wp, 1, 3), spread(0.0_wp, 1, 3), failure)
            call check_failure(error, failure, 'singular_mass', 'mass')
        end do
    end subroutine test_indefinite

    !> No constraints, only holonomic, only nonholonomic ones, and as many as coordinates; each has its expected end.
    subroutine test_mixtures(error)
        type(error_type), allocatable, intent(out) :: error
        type(particle_type), target :: particle
        type(pendulum_type), target :: pendulum
        type(sleigh_type), target :: sleigh
        type(belt_wheel_type), target :: belt_wheel
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: q(3), qd(3), qdd(2), lambda(2)
        integer :: k

        options%step = 1.0e-2_wp
        do k = 1, size(steppers)
            options%stepper = steppers(k)
            call particle%define(.true.)
            call run(simulation, particle, options, 0.0_wp, spread(0.0_wp, 1, 3), spread(1.0_wp, 1, 3), 1.0_wp, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            ! The force is the mass: q = t + t**2/2.
            call check_close(error, simulation%state%q, spread(1.5_wp, 1, 3), 1.0e-13_wp, 'q of the particle')
            call pendulum%define()
            call pendulum%start(0.0_wp, 0.0_wp, q(:2), qd(:2))
            call run(simulation, pendulum, options, 0.0_wp, q(:2), qd(:2), 1.0_wp, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call check_close(error, simulation%state%q, q(:2), 1.0e-13_wp, 'q of the hanging pendulum')
            call sleigh%define(0.5_wp)
            sleigh%segment = 1
            call sleigh%motion(0.0_wp, [0.0_wp, 0.0_wp, 0.2_wp, 0.7_wp, 0.3_wp], q, qd)
            call run(simulation, sleigh, options, 0.0_wp, q, qd, 1.0_wp, failure)
            call check_no_failure(error, failure)
            call belt_wheel%define()
            call belt_wheel%solution(0.0_wp, q(:2), qd(:2), qdd, lambda)
            call run(simulation, belt_wheel, options, 0.0_wp, q(:2), qd(:2), 1.0_wp, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call belt_wheel%solution(1.0_wp, q(:2), qd(:2), qdd, lambda)
            call check_close(error, [simulation%state%q(2), simulation%state%qd], [q(2), qd(:2)], 1.0e-12_wp, 'the driven wheel')
        end do
    end subroutine test_mixtures

    !> stat > 0 and stat < 0 of evaluate_derivatives, at the first step and later.
    subroutine test_derivative_stat(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type), target :: inner
        type(perturbed_type), target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: q(9), qd(9)
        integer :: i, k

        call inner%define()
        call inner%start([-1.0_wp, 0.01_wp, 0.0_wp], 0.0_wp, q, qd)
        call model%wrap(inner)
        options%step = 1.0e-2_wp
        do k = 1, 2
            options%stepper = merge('sdirk54  ', 'trapezoid', k == 1)
            do i = 1, 2
                model%fault_time = merge(0.0_wp, 0.045_wp, i == 1)
                model%fault_stat = 3
                call run(simulation, model, options, 0.0_wp, q, qd, 4.0_wp, failure)
                call check_failure(error, failure, 'not_evaluable', 'derivative')
                model%fault_stat = -3
                call run(simulation, model, options, 0.0_wp, q, qd, 4.0_wp, failure)
                call check_failure(error, failure, 'callback_failed', 'derivative')
                ! When the next matrix was needed.
                call check_between(error, simulation%state%t, merge(0.0_wp, 0.045_wp, i == 1), merge(0.0_wp, 3.9_wp, i == 1), &
                    'time left behind')
            end do
        end do
    end subroutine test_derivative_stat

    !> A NaN in any derivative ends the run with a status, and never enters the state.
    subroutine test_derivative_nan(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type), target :: inner
        type(perturbed_type), target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: q(9), qd(9)
        integer :: i

        call inner%define()
        call inner%start([-1.0_wp, 0.01_wp, 0.0_wp], 0.0_wp, q, qd)
        call model%wrap(inner)
        options%stepper = 'sdirk54'
        options%step = 1.0e-2_wp
        model%amount = ieee_value(1.0_wp, ieee_quiet_nan)
        model%row = 3
        model%column = 5
        model%fault_time = 0.045_wp
        do i = 1, n_derivatives
            model%derivative = i
            call run(simulation, model, options, 0.0_wp, q, qd, 4.0_wp, failure)
            call check_stopped(error, failure, [character(len=24) :: 'newton_failed', 'not_finite'], place=derivative_name(i))
            ! When the next matrix was needed.
            call check_between(error, simulation%state%t, 0.045_wp, 3.9_wp, 'time left behind')
            call check_state_left(error, simulation)
        end do
    end subroutine test_derivative_nan

    !> After a failure at a stage: state, multipliers and energy are those of a run stopped there.
    subroutine test_left_behind(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: faults(3) = [fault_nan, fault_stop, fault_retry]
        integer :: i, k, term

        do k = 1, size(steppers)
            do i = 1, size(faults)
                do term = 1, n_terms
                    ! Suite faults has the faults in M or nu alone; Phi, C, gamma and forces have the largest effects.
                    if (term == 3) cycle
                    call check_left_behind(steppers(k), faults(i), term, error)
                end do
            end do
        end do
    end subroutine test_left_behind

    subroutine check_left_behind(stepper, fault, term, error)
        character(len=*), intent(in) :: stepper
        integer, intent(in) :: fault, term
        type(error_type), allocatable, intent(inout) :: error
        type(moving_pivot_type), target :: inner, other
        type(spy_type), target :: spy
        type(simulation_type) :: simulation, expected
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2), lambda(1), lambda_expected(1), energy, energy_expected
        integer :: stat

        if (allocated(error)) return
        options%stepper = stepper
        options%step = 1.0e-2_wp
        call run_with_fault(simulation, spy, inner, options, fault, term, 0.0505_wp, failure)
        call check_stopped(error, failure, place=trim(stepper)//', '//trim(term_name(term)))
        if (allocated(error)) return
        ! Remove the fault, so that the state can be evaluated.
        spy%fault = no_fault
        call start_swing(other, q, qd)
        call run(expected, other, options, 0.0_wp, q, qd, 0.05_wp, failure)
        call check_no_failure(error, failure)
        ! The end of the stopped run is the fifth point of the grid: the same steps.
        call check_close(error, simulation%state%q, expected%state%q, 1.0e-15_wp, 'q')
        call check_close(error, simulation%state%qd, expected%state%qd, 1.0e-15_wp, 'qd')
        call simulation%multipliers(lambda)
        call expected%multipliers(lambda_expected)
        call check_close(error, lambda, lambda_expected, 1.0e-12_wp, 'multipliers')
        call simulation%kinetic_energy(energy, stat)
        call check_count(error, stat, 0, 'status of the energy')
        call expected%kinetic_energy(energy_expected, stat)
        call check_close(error, [energy], [energy_expected], 1.0e-14_wp, 'energies')
        if (allocated(error)) error%message = error%message//' ['//trim(stepper)//', '//trim(term_name(term))//']'
    end subroutine check_left_behind

    !> After a failed step of 0.5 the same state is a good start for steps of 1e-3.
    subroutine test_smaller(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type), target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: q(9), qd(9)
        integer :: k

        call model%define()
        do k = 1, size(steppers)
            call model%start([-1.0_wp, 0.01_wp, 0.0_wp], 0.0_wp, q, qd)
            options%stepper = steppers(k)
            options%step = 0.5_wp
            call run(simulation, model, options, 0.0_wp, q, qd, 40.0_wp, failure)
            call check_stopped(error, failure, place=steppers(k))
            if (allocated(error)) return
            options%step = 1.0e-3_wp
            q = simulation%state%q
            qd = simulation%state%qd
            call run(simulation, model, options, simulation%state%t, q, qd, simulation%state%t + 0.02_wp, failure)
            call check_no_failure(error, failure)
        end do
    end subroutine test_smaller

    !> At t = 1e16 the spacing of numbers is 2.
    subroutine test_underflow(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)

        call model%define()
        call model%start(0.3_wp, 0.0_wp, q, qd)
        options%step = 0.1_wp
        call run(simulation, model, options, 1.0e16_wp, q, qd, 1.0e16_wp + 100.0_wp, failure)
        call check_failure(error, failure, 'step_underflow')
        call check_close(error, [simulation%state%t], [1.0e16_wp], 0.0_wp, 't')
    end subroutine test_underflow

    !> A rod whose length jumps at a breakpoint: a valid state before it is invalid after it, and no step size can help.
    subroutine test_not_held(error)
        type(error_type), allocatable, intent(out) :: error
        type(jumping_type), target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)
        integer :: k

        call model%define()
        model%holonomic => jumping_rod
        model%breakpoints = [0.055_wp]
        options%step = 1.0e-2_wp
        do k = 1, size(steppers)
            options%stepper = steppers(k)
            call model%start(0.3_wp, 1.0_wp, q, qd)
            call run(simulation, model, options, 0.0_wp, q, qd, 1.0_wp, failure)
            call check_failure(error, failure, 'constraints_not_held', 'the position constraint "rod" is off by')
            call check_close(error, [simulation%state%t], [0.055_wp], 1.0e-15_wp, 'time left behind')
            if (allocated(error)) return
            ! The stretch times length**2 on the scale |x| + |y|, because coordinates are at least one.
            call check_between(error, simulation%errors(1), 1.0e-7_wp, 1.0e-5_wp, 'error')
        end do
    end subroutine test_not_held

    subroutine jumping_rod(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (jumping_type)
            value(1) = (q(1)**2 + q(2)**2 - (self%length*(1 + self%stretch*(self%segment - 1)))**2)/2
        end select
    end subroutine jumping_rod

    subroutine test_near_redundant(error)
        type(error_type), allocatable, intent(out) :: error
        type(near_type), target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: q(3), qd(3)
        integer :: k

        call model%define_near()
        options%step = 1.0e-2_wp
        do k = 1, size(steppers)
            call start_near(q, qd)
            options%stepper = steppers(k)
            ! For the same reason rates have no more digits.
            if (steppers(k) /= 'rk4') options%intol = 1.0e-6_wp
            call run(simulation, model, options, 0.0_wp, q, qd, 1.0_wp, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            ! The point stays on the curve: the tolerance, 1e-12, over the part by which the rows differ is 1e-3.
            call check_below(error, abs(simulation%state%q(3) - simulation%state%q(1)*simulation%state%q(2)), 1.0e-5_wp, 'z - x y')
        end do
    end subroutine test_near_redundant

    !> Alternating steps with different steppers and models: identical to the last bit to consecutive runs.
    subroutine test_turns(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: disk, motorcycle
        type(simulation_type) :: first, second, first_alone, second_alone
        type(options_type) :: options(2)
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q1(:), qd1(:), q2(:), qd2(:)
        integer :: i

        options(1) = options_type(stepper='sdirk54', step=1.0e-3_wp)
        options(2) = options_type(stepper='trapezoid', step=1.0e-3_wp)
        call new_subject('disk', disk, q1, qd1)
        call new_subject('motorcycle', motorcycle, q2, qd2)
        call run(first_alone, disk, options(1), 0.0_wp, q1, qd1, 0.05_wp, failure)
        call check_no_failure(error, failure)
        call run(second_alone, motorcycle, options(2), 0.0_wp, q2, qd2, 0.05_wp, failure)
        call check_no_failure(error, failure)
        call first%initialize(disk, options(1), 0.0_wp, q1, qd1, failure)
        call second%initialize(motorcycle, options(2), 0.0_wp, q2, qd2, failure)
        do i = 1, 50
            if (.not. allocated(failure)) call first%step(0.05_wp, failure)
            if (.not. allocated(failure)) call second%step(0.05_wp, failure)
        end do
        call check_no_failure(error, failure)
        call check_close(error, first%state%q, first_alone%state%q, 0.0_wp, 'q of the disk')
        call check_close(error, first%state%qdd, first_alone%state%qdd, 0.0_wp, 'qdd of the disk')
        call check_close(error, second%state%q, second_alone%state%q, 0.0_wp, 'q of the motorcycle')
        call check_close(error, second%state%qdd, second_alone%state%qdd, 0.0_wp, 'qdd of the motorcycle')
    end subroutine test_turns
end module test_statuses
