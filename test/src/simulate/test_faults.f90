! SPDX-License-Identifier: MIT
!> Tests of faults: each kind in each term, effort before a point is given up, iterations without convergence, overflow.
module test_faults
    use asserts, only: check_below, check_close, check_failure, check_no_failure, check_stopped, check_true
    use faulty_runs, only: check_state_left, faults, run_with_fault, status_of_fault
    use model_moving_pivot, only: moving_pivot_type
    use model_particle, only: particle_type
    use model_pendulum, only: pendulum_type
    use model_perturbed, only: perturbed_type
    use model_spy, only: fault_infinity, fault_nan, fault_retry, fault_stop, spy_type
    use runs, only: choose, run
    use tandem, only: change_stepper, assembly_type, derivative_name, failure_type => error_type, is_input_error, model_type, &
        n_derivatives, n_terms, need_nu, options_type, rolling_disk_type, simulation_type, statistics_type, term_name, wp
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_faults

    character(len=9), parameter :: steppers(5) = [character(len=9) :: 'rk4', 'dopri5', 'dop853', 'trapezoid', 'sdirk54']
    character(len=10), parameter :: charts(3) = [character(len=10) :: 'every_step', 'adaptive', 'paper']
    character(len=6), parameter :: modes(2) = ['factor', 'refine']
    !> Largest number of evaluations before a point is given up.
    integer, parameter :: patience = 20

    !> A particle whose mass matrix is not symmetric.
    type, extends(particle_type) :: lopsided_type
        real(wp) :: off = 0.0_wp
    end type lopsided_type

    !> A pendulum whose length has noise, so that its position has no solution to a smaller tolerance.
    type, extends(pendulum_type) :: noisy_type
        real(wp) :: noise = 0.0_wp, noisy_from = 0.0_wp
        integer :: calls = 0
    end type noisy_type

contains

    !> The suite.
    subroutine collect_faults(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('a-point-is-given-up-within-20-evaluations-at-the-start', test_patience_start), &
            new_unittest('a-point-is-given-up-within-20-evaluations-in-a-step', test_patience_step), &
            new_unittest('a-point-is-given-up-within-20-evaluations-under-error-control', test_patience_control), &
            new_unittest('a-nan-at-the-start-is-reported', test_nan_start), &
            new_unittest('an-infinity-at-the-start-is-reported', test_infinity_start), &
            new_unittest('a-procedure-that-stops-at-the-start-is-named', test_stop_start), &
            new_unittest('a-procedure-that-cannot-be-evaluated-at-the-start-is-named', test_retry_start), &
            new_unittest('a-nan-in-a-step-is-reported', test_nan_step), &
            new_unittest('an-infinity-in-a-step-is-reported', test_infinity_step), &
            new_unittest('a-procedure-that-stops-in-a-step-is-named', test_stop_step), &
            new_unittest('a-procedure-that-cannot-be-evaluated-in-a-step-is-named', test_retry_step), &
            new_unittest('a-fault-in-an-implicit-step-is-named', test_implicit_faults), &
            new_unittest('a-mass-matrix-that-is-not-symmetric-is-refused', test_asymmetric), &
            new_unittest('a-step-larger-than-the-span-ends-at-its-end', test_long_step), &
            new_unittest('an-iteration-for-u-that-stagnates-is-ended', test_u), &
            new_unittest('iterations-for-b-and-h-that-stagnate-are-ended', test_b_and_h), &
            new_unittest('a-refinement-that-was-spoilt-is-made-anew', test_spoilt_refinement), &
            new_unittest('a-newton-iteration-with-wrong-derivatives-is-ended', test_newton), &
            new_unittest('a-speed-that-overflows-is-reported', test_overflow), &
            new_unittest('a-speed-that-grows-without-bound-is-reported', test_blow_up), &
            new_unittest('euler-parameters-of-zero-are-refused', test_zero_parameters)]
    end subroutine collect_faults

    subroutine test_patience_start(error)
        type(error_type), allocatable, intent(out) :: error

        call check_patience(0.0_wp, 0.0_wp, error)
    end subroutine test_patience_start

    subroutine test_patience_step(error)
        type(error_type), allocatable, intent(out) :: error

        call check_patience(0.0505_wp, 0.0_wp, error)
    end subroutine test_patience_step

    subroutine test_patience_control(error)
        type(error_type), allocatable, intent(out) :: error

        call check_patience(0.0505_wp, 1.0e-6_wp, error)
    end subroutine test_patience_control

    !> Every fault in every term with every stepper: a status, few evaluations, a finite remaining state.
    subroutine check_patience(time, rtol, error)
        !> Time of the fault, and tolerance, 0 for fixed steps.
        real(wp), intent(in) :: time, rtol
        type(error_type), allocatable, intent(inout) :: error
        type(moving_pivot_type), target :: inner
        type(spy_type), target :: spy
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        integer :: i, k, term

        do i = 1, size(steppers)
            if (rtol > 0.0_wp .and. steppers(i) == 'rk4') cycle
            do k = 1, size(faults)
                do term = 1, n_terms
                    if (allocated(error)) return
                    options = options_type(stepper=steppers(i), rtol=rtol)
                    if (.not. rtol > 0.0_wp) options%step = 1.0e-2_wp
                    call run_with_fault(simulation, spy, inner, options, faults(k), term, time, failure)
                    call check_failure(error, failure, trim(status_of_fault(k)), trim(term_name(term)))
                    call check_true(error, spy%most_at_a_point <= patience, 'a point is given up, not tried again and again')
                    ! Under error control a step is repeated with smaller sizes until these are too small.
                    call check_true(error, spy%n_faults <= merge(64, 1, rtol > 0.0_wp)*patience, 'the run ends soon')
                    if (time > 0.0_wp) then
                        call check_true(error, simulation%state%t <= 0.06_wp, 'the time left behind')
                        call check_state_left(error, simulation)
                    end if
                    if (allocated(error)) error%message = error%message//' ['//trim(steppers(i))//', '// &
                        trim(status_of_fault(k))//', '//trim(term_name(term))//']'
                end do
            end do
        end do
    end subroutine check_patience

    subroutine test_nan_start(error)
        type(error_type), allocatable, intent(out) :: error

        call check_faults(fault_nan, 0.0_wp, 'not_finite', error)
    end subroutine test_nan_start

    subroutine test_infinity_start(error)
        type(error_type), allocatable, intent(out) :: error

        call check_faults(fault_infinity, 0.0_wp, 'not_finite', error)
    end subroutine test_infinity_start

    subroutine test_stop_start(error)
        type(error_type), allocatable, intent(out) :: error

        call check_faults(fault_stop, 0.0_wp, 'callback_failed', error)
    end subroutine test_stop_start

    subroutine test_retry_start(error)
        type(error_type), allocatable, intent(out) :: error

        call check_faults(fault_retry, 0.0_wp, 'not_evaluable', error)
    end subroutine test_retry_start

    subroutine test_nan_step(error)
        type(error_type), allocatable, intent(out) :: error

        call check_faults(fault_nan, 0.0505_wp, 'not_finite', error)
    end subroutine test_nan_step

    subroutine test_infinity_step(error)
        type(error_type), allocatable, intent(out) :: error

        call check_faults(fault_infinity, 0.0505_wp, 'not_finite', error)
    end subroutine test_infinity_step

    subroutine test_stop_step(error)
        type(error_type), allocatable, intent(out) :: error

        call check_faults(fault_stop, 0.0505_wp, 'callback_failed', error)
    end subroutine test_stop_step

    subroutine test_retry_step(error)
        type(error_type), allocatable, intent(out) :: error

        call check_faults(fault_retry, 0.0505_wp, 'not_evaluable', error)
    end subroutine test_retry_step

    !> One fault in each term in turn, with each policy and refresh mode: the status, the term's name in the message, and the last
    !> valid state.
    subroutine check_faults(fault, time, name, error)
        integer, intent(in) :: fault
        !> Time of the fault; 0 is the start.
        real(wp), intent(in) :: time
        character(len=*), intent(in) :: name
        type(error_type), allocatable, intent(inout) :: error
        integer :: term, i, j

        do term = 1, n_terms
            do i = 1, size(charts)
                do j = 1, size(modes)
                    if (allocated(error)) return
                    call check_fault(fault, time, term, choose(step=1.0e-2_wp, chart=charts(i), refresh=modes(j)), name, error)
                end do
            end do
        end do
    end subroutine check_faults

    subroutine check_fault(fault, time, term, options, name, error)
        integer, intent(in) :: fault, term
        real(wp), intent(in) :: time
        type(options_type), intent(in) :: options
        character(len=*), intent(in) :: name
        type(error_type), allocatable, intent(inout) :: error
        type(moving_pivot_type), target :: inner
        type(spy_type), target :: spy
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        character(len=:), allocatable :: place

        call run_with_fault(simulation, spy, inner, options, fault, term, time, failure)
        place = trim(term_name(term))//', '//trim(options%chart)//', '//options%refresh
        call check_stopped(error, failure, [name], trim(term_name(term)), place)
        if (.not. time > 0.0_wp) return
        ! The fault hits the step from 0.05 to 0.06, at a stage inside or at its end.
        call check_close(error, [simulation%state%t], [0.05_wp], 1.0e-15_wp, 'time left behind')
        call check_state_left(error, simulation)
    end subroutine check_fault

    !> A fault in each term in turn in the step from 0.05; check_faults has the case of a NaN in nu.
    subroutine test_implicit_faults(error)
        type(error_type), allocatable, intent(out) :: error
        integer :: i, k, term

        do k = 4, 5
            do i = 1, size(faults)
                do term = 1, n_terms
                    if (2**(term - 1) == need_nu .and. i <= 2) cycle
                    call check_implicit_fault(steppers(k), faults(i), term, trim(status_of_fault(i)), error)
                end do
            end do
        end do
    end subroutine test_implicit_faults

    subroutine check_implicit_fault(stepper, fault, term, name, error)
        character(len=*), intent(in) :: stepper, name
        integer, intent(in) :: fault, term
        type(error_type), allocatable, intent(inout) :: error
        type(moving_pivot_type), target :: inner
        type(spy_type), target :: spy
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure

        if (allocated(error)) return
        options%stepper = stepper
        options%step = 1.0e-2_wp
        call run_with_fault(simulation, spy, inner, options, fault, term, 0.0505_wp, failure)
        call check_stopped(error, failure, [name], trim(term_name(term)), trim(stepper)//', '//trim(term_name(term)))
        call check_close(error, [simulation%state%t], [0.05_wp], 1.0e-15_wp, 'time left behind')
    end subroutine check_implicit_fault

    subroutine lopsided_mass(self, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        value(1, 1) = 1.0_wp
        value(2, 2) = 2.0_wp
        value(3, 3) = 3.0_wp
        value(2, 1) = 0.5_wp
        value(1, 2) = 0.5_wp
        select type (self)
        class is (lopsided_type)
            value(1, 2) = 0.5_wp + self%off
        end select
    end subroutine lopsided_mass

    !> Reported with its place, at the start; rounding does not count.
    subroutine test_asymmetric(error)
        type(error_type), allocatable, intent(out) :: error
        type(lopsided_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp), parameter :: zero(3) = 0.0_wp
        integer :: k

        do k = 1, size(steppers)
            call model%define(.true.)
            model%mass_matrix => lopsided_mass
            model%off = 1.0e-15_wp
            call run(simulation, model, choose(stepper=steppers(k)), 0.0_wp, zero, zero, 0.01_wp, failure)
            call check_no_failure(error, failure)
            model%off = 1.0e-3_wp
            call run(simulation, model, choose(stepper=steppers(k)), 0.0_wp, zero, zero, 0.01_wp, failure)
            call check_failure(error, failure, 'invalid_model', 'the mass matrix is not symmetric at the start, entry mass(1,2)')
        end do
    end subroutine test_asymmetric

    subroutine test_long_step(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(statistics_type) :: statistics
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)
        integer :: k

        call model%define()
        call model%start(0.3_wp, 0.0_wp, q, qd)
        do k = 1, size(steppers)
            options = choose(step=1.0e3_wp, stepper=steppers(k))
            call run(simulation, model, options, 0.0_wp, q, qd, 1.0e-2_wp, failure)
            call check_no_failure(error, failure)
            call check_close(error, [simulation%state%t], [1.0e-2_wp], 0.0_wp, 't')
            statistics = simulation%statistics()
            call check_true(error, statistics%steps == 1, 'one step')
            if (steppers(k) == 'rk4') cycle
            options = options_type(stepper=steppers(k), rtol=1.0e-6_wp, first_step=1.0e3_wp)
            call run(simulation, model, options, 0.0_wp, q, qd, 1.0e-2_wp, failure)
            call check_no_failure(error, failure)
            call check_close(error, [simulation%state%t], [1.0e-2_wp], 0.0_wp, 't')
        end do
    end subroutine test_long_step

    !> The circle, with a noise that changes from call to call.
    subroutine noisy_circle(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (noisy_type)
            value = 0.5_wp*(q(1)**2 + q(2)**2 - self%length**2)
            self%calls = self%calls + 1
            if (t >= self%noisy_from) value = value + self%noise*(-1)**self%calls
        end select
    end subroutine noisy_circle

    subroutine test_u(error)
        type(error_type), allocatable, intent(out) :: error
        type(noisy_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)
        integer :: k

        do k = 1, size(steppers)
            if (allocated(error)) return
            model = noisy_type()
            call model%define()
            model%holonomic => noisy_circle
            model%noise = 1.0e-6_wp
            model%noisy_from = 0.0505_wp
            call model%start(0.3_wp, 0.0_wp, q, qd)
            call run(simulation, model, choose(step=1.0e-2_wp, stepper=steppers(k)), 0.0_wp, q, qd, 1.0_wp, failure)
            call check_stopped(error, failure, [character(len=24) :: 'position_diverged', 'newton_failed', &
                'constraints_not_held'], place=steppers(k))
            call check_close(error, [simulation%state%t], [0.05_wp], 1.0e-15_wp, 'time left behind')
            ! Two steps before the end at most, and a bounded number of corrections in the last one.
            call check_true(error, model%calls < 600, 'the work is bounded')
        end do
    end subroutine test_u

    !> A chart that is kept too long: the refinements of B and H no longer converge, and end with bounded work.
    subroutine test_b_and_h(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(statistics_type) :: statistics
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)
        integer :: k

        call model%define()
        call model%start(1.5_wp, 0.0_wp, q, qd)
        do k = 1, size(steppers)
            options = choose(step=0.4_wp, stepper=steppers(k), chart='paper', refresh='refine')
            options%max_evaluations = 100000
            call run(simulation, model, options, 0.0_wp, q, qd, 100.0_wp, failure)
            call check_stopped(error, failure, [character(len=24) :: 'position_diverged', 'chart_left', 'newton_failed'], &
                place=steppers(k))
            statistics = simulation%statistics()
            call check_true(error, statistics%b_corrections + statistics%h_corrections < 100*(statistics%right_hand_sides + 100), &
                'the corrections are bounded')
            call check_state_left(error, simulation)
        end do
    end subroutine test_b_and_h

    !> A first step so large that B and H diverge: a smaller one on the same chart must not start from these values.
    subroutine test_spoilt_refinement(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(statistics_type) :: statistics
        type(failure_type), allocatable :: failure
        character(len=10), parameter :: policies(2) = [character(len=10) :: 'every_step', 'adaptive']
        real(wp) :: q(2), qd(2)
        integer :: j, k

        call model%define()
        call model%start(1.5_wp, 9.0_wp, q, qd)
        do k = 2, size(steppers)
            do j = 1, size(policies)
                options = choose(stepper=steppers(k), chart=policies(j), refresh='refine')
                call change_stepper(options, options%stepper, rtol=1.0e-6_wp)
                options%first_step = 0.3_wp
                call run(simulation, model, options, 0.0_wp, q, qd, 1.0_wp, failure)
                call check_no_failure(error, failure)
                if (allocated(error)) return
                statistics = simulation%statistics()
                call check_true(error, statistics%failed > 0, steppers(k)//': a step has failed')
                if (allocated(error)) return
            end do
        end do
    end subroutine test_spoilt_refinement

    !> Derivatives with one wrong entry: the iteration ends with a status, or still converges to the same motion.
    subroutine test_newton(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type), target :: inner
        type(perturbed_type), target :: model
        type(simulation_type) :: simulation, expected
        type(options_type) :: options
        type(statistics_type) :: statistics
        type(failure_type), allocatable :: failure
        real(wp) :: q(9), qd(9)
        integer :: i, k, n_failed

        n_failed = 0
        call inner%define()
        call inner%start([-1.0_wp, 0.01_wp, 0.0_wp], 0.0_wp, q, qd)
        call model%wrap(inner)
        model%amount = 1.0e6_wp
        model%row = 3
        model%column = 5
        do k = 4, 5
            options = choose(step=1.0e-2_wp, stepper=steppers(k))
            do i = 1, n_derivatives
                model%derivative = i
                call run(simulation, model, options, 0.0_wp, q, qd, 0.1_wp, failure)
                statistics = simulation%statistics()
                if (allocated(failure)) then
                    n_failed = n_failed + 1
                    call check_failure(error, failure, 'newton_failed', 't = ')
                    call check_true(error, statistics%newton_corrections <= patience*(1 + statistics%implicit_stages), &
                        'the iteration is bounded')
                else
                    ! Both iterations are within their tolerance of the solution at each of 50 stages.
                    call run(expected, inner, options, 0.0_wp, q, qd, 0.1_wp, failure)
                    call check_close(error, simulation%state%q, expected%state%q, 1.0e-10_wp, 'q')
                end if
                if (allocated(error)) then
                    error%message = error%message//' ['//trim(derivative_name(i))//', '//trim(steppers(k))//']'
                    return
                end if
            end do
        end do
        call check_true(error, n_failed >= 1, 'some of these derivatives are too wrong')
    end subroutine test_newton

    !> Velocities whose squares are more than the largest number.
    subroutine test_overflow(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)
        integer :: k

        call model%define()
        call model%start(0.3_wp, 1.0e200_wp, q, qd)
        do k = 1, size(steppers)
            call run(simulation, model, choose(stepper=steppers(k)), 0.0_wp, q, qd, 1.0_wp, failure)
            call check_failure(error, failure, 'not_finite', 'at the start')
        end do
    end subroutine test_overflow

    !> The force m qd**2, which makes the velocity 1/(1 - t).
    subroutine square_force(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value = qd**2
        select type (self)
        class is (particle_type)
            value = self%m*qd**2
        end select
    end subroutine square_force

    subroutine test_blow_up(error)
        type(error_type), allocatable, intent(out) :: error
        type(particle_type), target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        integer :: i, k

        call model%define(.true.)
        model%applied_force => square_force
        do k = 1, size(steppers)
            do i = 1, 2
                if (steppers(k) == 'rk4' .and. i == 2) cycle
                options = options_type(stepper=steppers(k), rtol=1.0e-6_wp)
                if (i == 1) options = options_type(stepper=steppers(k), step=1.0e-2_wp)
                call run(simulation, model, options, 0.0_wp, spread(0.0_wp, 1, 3), spread(1.0_wp, 1, 3), 2.0_wp, failure)
                call check_stopped(error, failure, [character(len=24) :: 'not_finite', 'step_underflow', 'newton_failed'], &
                    't = ', steppers(k))
                call check_state_left(error, simulation)
                if (i == 2) call check_true(error, abs(simulation%state%t - 1.0_wp) < 1.0e-3_wp, 'the end is where infinity is')
                if (allocated(error)) return
            end do
        end do
    end subroutine test_blow_up

    subroutine test_zero_parameters(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type), target :: model
        type(simulation_type) :: simulation
        type(assembly_type) :: assembly
        type(failure_type), allocatable :: failure
        real(wp) :: q(9), qd(9)
        integer :: k

        call model%define()
        call model%start([-1.0_wp, 0.01_wp, 0.0_wp], 0.0_wp, q, qd)
        q(4:7) = 0.0_wp
        do k = 1, size(steppers)
            call simulation%initialize(model, choose(stepper=steppers(k)), 0.0_wp, q, qd, failure)
            call check_failure(error, failure, 'inconsistent_rows', '"Euler parameters" has no gradient at the start')
        end do
        ! Assembled or refused, but not kept.
        call simulation%initialize(model, choose(), 0.0_wp, q, qd, failure, assembly)
        if (allocated(failure)) then
            call check_true(error, is_input_error(failure%stat), 'the input is at fault: '//failure%message)
        else
            call check_below(error, abs(norm2(simulation%state%q(4:7)) - 1.0_wp), 1.0e-12_wp, 'norm')
        end if
    end subroutine test_zero_parameters
end module test_faults
