! SPDX-License-Identifier: MIT
!> Tests that only necessary quantities are evaluated: the simulation's counters, and spies in the model's procedures.
module test_counters
    use asserts, only: check_close, check_count, check_no_failure, check_true
    use model_belt_wheel, only: belt_wheel_type
    use model_heavy_top, only: heavy_top_type
    use model_knife_edge, only: knife_edge_type
    use model_particle, only: particle_type
    use model_pendulum, only: pendulum_type
    use model_spy, only: spy_type
    use runs, only: choose, get_start, run
    use tandem, only: at_step, derivatives_type, failure_type => error_type, long, model_type, n_derivatives, n_terms, &
        need_force, need_gamma, need_jacobian, need_mass, need_nu, need_phi, observer_type, options_type, refresh_modes, &
        rolling_disk_type, simulation_type, statistics_type, stepper_names, wp
    use testdrive, only: error_type, new_unittest, test_failed, unittest_type
    implicit none (type, external)
    private

    public :: collect_counters

    !> Places of the terms in the counters.
    integer, parameter :: phi = 1, jacobian = 2, nu = 3, gamma = 4, mass = 5, force = 6
    !> Steps of every run here.
    integer, parameter :: n_steps = 50

    !> Requests multipliers and energies every tenth step.
    type, extends(observer_type) :: curious_type
        integer :: steps = 0
    contains
        procedure :: observe
    end type curious_type

    !> A disk that counts the calls of its derivative procedure, if it has one.
    type, extends(rolling_disk_type) :: counting_disk_type
        type(rolling_disk_type) :: inner
        integer :: calls = 0
    end type counting_disk_type

    character(len=9), parameter :: implicit_steppers(3) = ['trapezoid', 'sdirk54  ', 'radau5   ']

contains

    !> The suite.
    subroutine collect_counters(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('rk4-takes-four-right-hand-sides-a-step', test_right_hand_sides), &
            new_unittest('stages-of-rk4-take-one-correction-each', test_remembered_stages), &
            new_unittest('nonholonomic-model-evaluates-nothing-holonomic', test_nonholonomic), &
            new_unittest('holonomic-model-evaluates-nothing-nonholonomic', test_holonomic), &
            new_unittest('free-model-evaluates-no-constraints', test_free), &
            new_unittest('scleronomic-model-evaluates-no-rates', test_scleronomic), &
            new_unittest('rheonomic-model-evaluates-its-rates', test_rheonomic), &
            new_unittest('constant-mass-matrix-is-evaluated-once', test_constant_mass), &
            new_unittest('mass-matrix-that-varies-is-evaluated-at-every-point', test_varying_mass), &
            new_unittest('model-without-force-evaluates-none', test_no_force), &
            new_unittest('nobody-asks-for-multipliers-and-energies', test_not_asked), &
            new_unittest('multipliers-and-energies-are-computed-as-often-as-asked', test_asked), &
            new_unittest('energies-of-a-restored-state-have-its-mass', test_restored_mass), &
            new_unittest('a-chart-every-step-evaluates-no-point-twice', test_no_point_twice), &
            new_unittest('counters-agree-with-the-calls', test_calls), &
            new_unittest('fused-procedure-is-preferred', test_fused), &
            new_unittest('any-division-into-fused-and-single-procedures-is-the-same', test_divisions), &
            new_unittest('factor-does-not-refine-and-refine-does-not-eliminate', test_modes), &
            new_unittest('counters-start-anew-with-initialize', test_anew), &
            new_unittest('rk4-calls-no-derivative', test_rk4_derivatives), &
            new_unittest('implicit-steps-keep-their-newton-matrix', test_kept_matrix), &
            new_unittest('sdirk54-solves-five-stages-a-step-and-the-trapezoid-one', test_stages), &
            new_unittest('differences-stand-in-for-absent-derivatives-only', test_stand_ins), &
            new_unittest('implicit-steps-evaluate-nothing-that-the-model-lacks', test_implicit_lacks), &
            new_unittest('implicit-steps-compute-multipliers-and-energies-only-when-asked', test_implicit_asked)]
    end subroutine collect_counters

    subroutine observe(self, simulation, occasion, error)
        class(curious_type), intent(inout) :: self
        class(simulation_type), intent(inout) :: simulation
        integer, intent(in) :: occasion
        type(failure_type), allocatable, intent(out) :: error
        real(wp) :: lambda(simulation%model%n_constraints()), energy
        integer :: stat

        if (occasion /= at_step) return
        self%steps = self%steps + 1
        if (mod(self%steps, 10) /= 0) return
        call simulation%multipliers(lambda)
        call simulation%kinetic_energy(energy, stat)
        call simulation%potential_energy(energy, stat)
    end subroutine observe

    !> Fifty steps of a model, spied upon.
    subroutine spy_on(model, q, qd, spy, statistics, error, options)
        class(model_type), intent(in), target :: model
        real(wp), intent(in) :: q(:), qd(:)
        type(spy_type), intent(out), target :: spy
        type(statistics_type), intent(out) :: statistics
        type(error_type), allocatable, intent(inout) :: error
        type(options_type), intent(in), optional :: options
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(options_type) :: chosen

        chosen = choose(step=1.0e-2_wp)
        if (present(options)) chosen = options
        call spy%wrap(model)
        call spy%set_traps()
        call run(simulation, spy, chosen, 0.0_wp, q, qd, n_steps*chosen%step, failure)
        call check_no_failure(error, failure)
        statistics = simulation%statistics()
        call check_count(error, statistics%steps, n_steps, 'steps')
        call check_count(error, spy%calls%trapped, 0, 'calls of procedures that do not exist')
    end subroutine spy_on

    !> A pendulum at 0.3 rad.
    subroutine spy_on_pendulum(spy, statistics, error, options)
        type(spy_type), intent(out), target :: spy
        type(statistics_type), intent(out) :: statistics
        type(error_type), allocatable, intent(inout) :: error
        type(options_type), intent(in), optional :: options
        type(pendulum_type), target :: model
        real(wp) :: q(2), qd(2)

        call model%define()
        call model%start(0.3_wp, 0.0_wp, q, qd)
        call spy_on(model, q, qd, spy, statistics, error, options)
    end subroutine spy_on_pendulum

    !> A knife edge from its reference's start.
    subroutine spy_on_knife_edge(spy, statistics, error, options)
        type(spy_type), intent(out), target :: spy
        type(statistics_type), intent(out) :: statistics
        type(error_type), allocatable, intent(inout) :: error
        type(options_type), intent(in), optional :: options
        type(knife_edge_type), target :: model
        real(wp), allocatable :: q(:), qd(:)

        call model%define()
        call get_start('knife_edge', q, qd)
        call spy_on(model, q, qd, spy, statistics, error, options)
    end subroutine spy_on_knife_edge

    !> The acceleration at the end of a step is the first stage of the next one; the start adds one.
    subroutine test_right_hand_sides(error)
        type(error_type), allocatable, intent(out) :: error
        type(spy_type), target :: spy
        type(statistics_type) :: statistics

        call spy_on_pendulum(spy, statistics, error)
        call check_count(error, statistics%right_hand_sides, 4*n_steps + 1, 'right-hand sides')
        call check_count(error, statistics%terms(gamma), 4*n_steps + 1, 'gamma')
        call check_count(error, statistics%terms(force), 4*n_steps + 1, 'force')
        call check_count(error, statistics%rejected, 0, 'rejected steps')
    end subroutine test_right_hand_sides

    !> The miss of the last step's stage of the same number is stored: a stage then takes one evaluation of Phi and one correction,
    !> instead of two of each, and the end of a step one evaluation. The first steps initialise it.
    subroutine test_remembered_stages(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: steps = 200
        type(rolling_disk_type), target :: disk
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: q(9), qd(9)

        call disk%define()
        call disk%start([-1.0_wp, 0.01_wp, 0.0_wp], 0.0_wp, q, qd)
        options%stepper = 'rk4'
        options%step = 2.0e-3_wp
        call run(simulation, disk, options, 0.0_wp, q, qd, steps*options%step, failure)
        call check_no_failure(error, failure)
        statistics = simulation%statistics()
        call check_true(error, statistics%terms(phi) <= 41*steps/10, 'evaluations of Phi')
        call check_true(error, statistics%position_corrections <= 31*steps/10, 'corrections')
    end subroutine test_remembered_stages

    subroutine test_nonholonomic(error)
        type(error_type), allocatable, intent(out) :: error
        type(spy_type), target :: spy
        type(statistics_type) :: statistics

        call spy_on_knife_edge(spy, statistics, error)
        call check_count(error, statistics%terms(phi), 0, 'phi')
        call check_count(error, statistics%position_corrections, 0, 'corrections of u')
        call check_count(error, statistics%position_factorizations, 0, 'factorizations of Phi_q U')
        call check_true(error, spy%calls%nonholonomic_jacobian > 0, 'E is evaluated')
    end subroutine test_nonholonomic

    subroutine test_holonomic(error)
        type(error_type), allocatable, intent(out) :: error
        type(spy_type), target :: spy
        type(statistics_type) :: statistics
        integer :: j

        do j = 1, size(refresh_modes)
            call spy_on_pendulum(spy, statistics, error, choose(step=1.0e-2_wp, refresh=refresh_modes(j)))
            ! The traps of `spy_on` are E and, through the checks, e.
            call check_count(error, spy%calls%nonholonomic_jacobian, 0, 'E')
            call check_count(error, spy%calls%nonholonomic_rhs, 0, 'e')
            call check_true(error, spy%calls%holonomic > 0 .and. spy%calls%holonomic_jacobian > 0, 'Phi and Phi_q are evaluated')
        end do
    end subroutine test_holonomic

    subroutine test_free(error)
        type(error_type), allocatable, intent(out) :: error
        type(particle_type), target :: model
        type(spy_type), target :: spy
        type(statistics_type) :: statistics
        integer :: i

        call model%define(with_force=.true.)
        call spy_on(model, [0.0_wp, 0.0_wp, 0.0_wp], [1.0_wp, 0.0_wp, 0.0_wp], spy, statistics, error)
        do i = 1, 4
            call check_count(error, statistics%terms(i), 0, 'terms of constraints')
        end do
        call check_count(error, statistics%basis_factorizations, 0, 'bases')
        call check_count(error, statistics%constraint_factorizations, 0, 'factorizations of C')
        call check_count(error, statistics%position_factorizations, 0, 'factorizations of Phi_q U')
    end subroutine test_free

    subroutine test_scleronomic(error)
        type(error_type), allocatable, intent(out) :: error
        type(spy_type), target :: spy
        type(statistics_type) :: statistics

        call spy_on_pendulum(spy, statistics, error)
        call check_count(error, statistics%terms(nu), 0, 'nu of the pendulum')
        call spy_on_knife_edge(spy, statistics, error)
        call check_count(error, statistics%terms(nu), 0, 'nu of the knife edge')
        call check_count(error, spy%calls%holonomic_rate + spy%calls%nonholonomic_rhs, 0, 'Phi_t and e')
    end subroutine test_scleronomic

    subroutine test_rheonomic(error)
        type(error_type), allocatable, intent(out) :: error
        type(belt_wheel_type), target :: model
        type(spy_type), target :: spy
        type(statistics_type) :: statistics
        real(wp) :: q(2), qd(2), qdd(2), lambda(2)

        call model%define()
        call model%solution(0.0_wp, q, qd, qdd, lambda)
        call spy_on(model, q, qd, spy, statistics, error)
        call check_true(error, statistics%terms(nu) > 0, 'nu is evaluated')
        call check_count(error, statistics%terms(nu), spy%calls%holonomic_rate, 'nu against Phi_t')
        call check_count(error, statistics%terms(nu), spy%calls%nonholonomic_rhs, 'nu against e')
        ! Nothing is free: no equations of motion are factored.
        call check_count(error, statistics%mass_factorizations, 0, 'factorizations of D'' M D')
    end subroutine test_rheonomic

    subroutine test_constant_mass(error)
        type(error_type), allocatable, intent(out) :: error
        type(spy_type), target :: spy
        type(statistics_type) :: statistics

        call spy_on_pendulum(spy, statistics, error)
        call check_count(error, statistics%terms(mass), 1, 'mass')
        call check_count(error, spy%calls%mass_matrix, 1, 'calls of mass_matrix')
    end subroutine test_constant_mass

    subroutine test_varying_mass(error)
        type(error_type), allocatable, intent(out) :: error
        type(heavy_top_type), target :: model
        type(spy_type), target :: spy
        type(statistics_type) :: statistics
        real(wp), allocatable :: q(:), qd(:)

        call model%define()
        call get_start('heavy_top', q, qd)
        call spy_on(model, q, qd, spy, statistics, error, choose(step=1.0e-3_wp))
        call check_count(error, statistics%terms(mass), 4*n_steps + 1, 'mass')
        call check_count(error, spy%calls%mass_matrix, 4*n_steps + 1, 'calls of mass_matrix')
        call check_count(error, spy%calls%inertia_force, 4*n_steps + 1, 'calls of inertia_force')
        call check_count(error, spy%calls%applied_force, 4*n_steps + 1, 'calls of applied_force')
    end subroutine test_varying_mass

    subroutine test_no_force(error)
        type(error_type), allocatable, intent(out) :: error
        type(particle_type), target :: model
        type(spy_type), target :: spy
        type(statistics_type) :: statistics

        call model%define(with_force=.false.)
        call spy_on(model, [0.0_wp, 0.0_wp, 0.0_wp], [1.0_wp, 0.0_wp, 0.0_wp], spy, statistics, error)
        call check_count(error, statistics%terms(force), 0, 'force')
    end subroutine test_no_force

    subroutine test_not_asked(error)
        type(error_type), allocatable, intent(out) :: error
        type(spy_type), target :: spy
        type(statistics_type) :: statistics

        call spy_on_pendulum(spy, statistics, error)
        call check_count(error, statistics%multipliers, 0, 'multipliers')
        call check_count(error, statistics%kinetic_energies, 0, 'kinetic energies')
        call check_count(error, statistics%potential_energies, 0, 'potential energies')
        call check_count(error, spy%calls%potential_energy, 0, 'calls of potential_energy')
    end subroutine test_not_asked

    !> Requests change nothing else, and not the solution.
    subroutine test_asked(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(simulation_type) :: silent, asked
        type(curious_type) :: curious
        type(statistics_type) :: before, after
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)
        integer(long) :: expected(n_terms)

        call model%define()
        call model%start(0.3_wp, 0.0_wp, q, qd)
        call run(silent, model, choose(step=1.0e-2_wp), 0.0_wp, q, qd, 0.5_wp, failure)
        call check_no_failure(error, failure)
        call run(asked, model, choose(step=1.0e-2_wp), 0.0_wp, q, qd, 0.5_wp, failure, curious)
        call check_no_failure(error, failure)
        before = silent%statistics()
        after = asked%statistics()
        call check_count(error, after%multipliers, 5, 'multipliers')
        call check_count(error, after%kinetic_energies, 5, 'kinetic energies')
        call check_count(error, after%potential_energies, 5, 'potential energies')
        ! The energy needs the mass matrix, which is constant here, once.
        expected = before%terms
        expected(mass) = expected(mass) + 1
        if (any(after%terms /= expected)) call test_failed(error, 'asking cost evaluations of other terms')
        call check_close(error, asked%state%q, silent%state%q, 0.0_wp, 'q')
    end subroutine test_asked

    !> A restored state may have other parameters than the run that it replaces: a constant mass matrix is evaluated again.
    subroutine test_restored_mass(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        integer(long), allocatable :: words(:)
        real(wp) :: q(2), qd(2), before, after
        integer :: stat

        call model%define()
        call model%start(0.3_wp, 1.0_wp, q, qd)
        call simulation%initialize(model, choose(step=1.0e-2_wp), 0.0_wp, q, qd, failure)
        if (.not. allocated(failure)) call simulation%save_state(words, failure)
        call simulation%kinetic_energy(before, stat)
        model%m = 2*model%m
        if (.not. allocated(failure)) call simulation%restore_state(words, failure)
        call simulation%kinetic_energy(after, stat)
        call check_no_failure(error, failure)
        call check_close(error, [after], [2*before], 1.0e-14_wp, 'kinetic energy')
    end subroutine test_restored_mass

    !> Three stages and the end of each step, and the start: C is evaluated once at each, although a chart is made there.
    subroutine test_no_point_twice(error)
        type(error_type), allocatable, intent(out) :: error
        type(spy_type), target :: spy
        type(statistics_type) :: statistics

        call spy_on_pendulum(spy, statistics, error)
        call check_count(error, statistics%terms(jacobian), 4*n_steps + 1, 'Jacobians of the pendulum')
        call spy_on_knife_edge(spy, statistics, error)
        ! Nine more, two per coordinate and two for the time, show that the blade's row is not integrable.
        call check_count(error, statistics%start_evaluations, 9, 'Jacobians of the start')
        call check_count(error, statistics%terms(jacobian), 4*n_steps + 1 + 9, 'Jacobians of the knife edge')
    end subroutine test_no_point_twice

    subroutine test_calls(error)
        type(error_type), allocatable, intent(out) :: error
        type(spy_type), target :: spy
        type(statistics_type) :: statistics

        call spy_on_pendulum(spy, statistics, error)
        call check_count(error, statistics%terms(phi), spy%calls%holonomic, 'phi')
        call check_count(error, statistics%terms(jacobian), spy%calls%holonomic_jacobian, 'jacobian')
        call check_count(error, statistics%terms(gamma), spy%calls%constraint_acceleration, 'gamma')
        call check_count(error, statistics%terms(mass), spy%calls%mass_matrix, 'mass')
        call check_count(error, statistics%terms(force), spy%calls%applied_force, 'force')
        call check_count(error, statistics%fused_calls, 0, 'fused calls')
    end subroutine test_calls

    !> The disk gives all but nu by `evaluate`: the points need one call for C and M and one for gamma and the force.
    subroutine test_fused(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type), target :: model
        type(spy_type), target :: spy
        type(statistics_type) :: statistics
        real(wp) :: q(9), qd(9)

        call model%define()
        call model%start([-1.0_wp, 0.01_wp, 0.0_wp], 0.0_wp, q, qd)
        call spy_on(model, q, qd, spy, statistics, error)
        call check_count(error, statistics%fused_calls, spy%calls%evaluate, 'calls of evaluate')
        call check_count(error, statistics%terms(nu), 0, 'nu')
        call check_count(error, statistics%fused_calls, int(statistics%terms(phi) + statistics%terms(jacobian) + &
            statistics%terms(gamma)), 'calls of evaluate against the terms')
    end subroutine test_fused

    !> 64 ways to divide the terms between `evaluate` and the single procedures.
    subroutine test_divisions(error)
        type(error_type), allocatable, intent(out) :: error
        type(belt_wheel_type), target :: model
        type(spy_type), target :: spy
        type(simulation_type) :: single, divided
        type(statistics_type) :: expected, found
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2), qdd(2), lambda(2)
        integer :: provides

        call model%define()
        call model%solution(0.0_wp, q, qd, qdd, lambda)
        call run(single, model, choose(step=1.0e-2_wp), 0.0_wp, q, qd, 0.2_wp, failure)
        call check_no_failure(error, failure)
        expected = single%statistics()
        do provides = 0, need_phi + need_jacobian + need_nu + need_gamma + need_mass + need_force
            spy = spy_type()
            call spy%wrap(model)
            call spy%fuse(provides)
            call run(divided, spy, choose(step=1.0e-2_wp), 0.0_wp, q, qd, 0.2_wp, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call check_close(error, divided%state%q, single%state%q, 0.0_wp, 'q')
            call check_close(error, divided%state%qdd, single%state%qdd, 0.0_wp, 'qdd')
            found = divided%statistics()
            if (any(found%terms /= expected%terms)) call test_failed(error, 'the division changed the counters')
            if (allocated(error)) return
        end do
    end subroutine test_divisions

    subroutine test_modes(error)
        type(error_type), allocatable, intent(out) :: error
        type(spy_type), target :: spy
        type(statistics_type) :: factor, refine

        call spy_on_pendulum(spy, factor, error, choose(step=1.0e-2_wp, refresh='factor'))
        call check_count(error, factor%b_corrections + factor%h_corrections, 0, 'corrections of B and H')
        call spy_on_pendulum(spy, refine, error, choose(step=1.0e-2_wp, chart='paper', refresh='refine'))
        call check_true(error, refine%b_corrections > 0 .and. refine%h_corrections > 0, 'B and H are corrected')
    end subroutine test_modes

    subroutine test_anew(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: first, second
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)
        integer :: i

        call model%define()
        call model%start(0.3_wp, 0.0_wp, q, qd)
        call run(simulation, model, choose(step=1.0e-2_wp), 0.0_wp, q, qd, 0.5_wp, failure)
        call check_no_failure(error, failure)
        first = simulation%statistics()
        call run(simulation, model, choose(step=1.0e-2_wp), 0.0_wp, q, qd, 0.5_wp, failure)
        call check_no_failure(error, failure)
        second = simulation%statistics()
        do i = 1, n_terms
            call check_count(error, second%terms(i), int(first%terms(i)), 'terms')
        end do
        call check_count(error, second%steps, int(first%steps), 'steps')
        call check_count(error, second%charts, int(first%charts), 'charts')
    end subroutine test_anew

    !> Count, and call the disk.
    subroutine count_derivatives(self, need, t, q, qd, qdd, lambda, derivatives, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:), qdd(:), lambda(:)
        type(derivatives_type), intent(inout) :: derivatives
        integer, intent(out) :: stat

        stat = -1
        select type (self)
        class is (counting_disk_type)
            self%calls = self%calls + 1
            call self%inner%evaluate_derivatives(need, t, q, qd, qdd, lambda, derivatives, stat)
        end select
    end subroutine count_derivatives

    !> Fifty steps of the disk with a stepper; the calls of its derivatives.
    subroutine roll_disk(stepper, has_derivatives, calls, statistics, error, curious)
        character(len=*), intent(in) :: stepper
        logical, intent(in) :: has_derivatives
        integer, intent(out) :: calls
        type(statistics_type), intent(out) :: statistics
        type(error_type), allocatable, intent(inout) :: error
        type(curious_type), intent(inout), optional :: curious
        type(counting_disk_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: q(9), qd(9)

        call model%inner%define()
        call model%define()
        model%evaluate_derivatives => null()
        if (has_derivatives) model%evaluate_derivatives => count_derivatives
        if (.not. has_derivatives) model%provides_derivatives = 0
        call model%start([-1.0_wp, 0.01_wp, 0.0_wp], 0.0_wp, q, qd)
        call run(simulation, model, choose(step=1.0e-3_wp, stepper=stepper), 0.0_wp, q, qd, n_steps*1.0e-3_wp, failure, curious)
        call check_no_failure(error, failure)
        statistics = simulation%statistics()
        call check_count(error, statistics%steps, n_steps, 'steps')
        calls = model%calls
    end subroutine roll_disk

    subroutine test_rk4_derivatives(error)
        type(error_type), allocatable, intent(out) :: error
        type(statistics_type) :: statistics
        integer :: calls

        call roll_disk('rk4', .true., calls, statistics, error)
        call check_count(error, calls, 0, 'calls of evaluate_derivatives')
        call check_count(error, sum(statistics%derivatives), 0, 'derivatives')
        call check_count(error, statistics%difference_evaluations, 0, 'evaluations for differences')
        call check_count(error, statistics%gamma_evaluations, 0, 'evaluations for a stand-in of gamma')
        call check_count(error, statistics%newton_matrices, 0, 'Newton matrices')
        call check_count(error, statistics%newton_corrections, 0, 'Newton corrections')
        call check_count(error, statistics%implicit_stages, 0, 'implicit stages')
    end subroutine test_rk4_derivatives

    !> Less than one matrix in five steps, with a new chart each, and with each matrix one call for all derivatives; fixed steps
    !> factor nothing else.
    subroutine test_kept_matrix(error)
        type(error_type), allocatable, intent(out) :: error
        type(statistics_type) :: statistics
        integer :: calls, i, k

        do i = 1, size(implicit_steppers)
            call roll_disk(trim(implicit_steppers(i)), .true., calls, statistics, error)
            call check_true(error, statistics%newton_matrices >= 1 .and. 5*statistics%newton_matrices < n_steps, &
                trim(implicit_steppers(i))//': Newton matrices')
            call check_count(error, statistics%newton_factorizations, int(statistics%newton_matrices), &
                trim(implicit_steppers(i))//': factorizations')
            call check_count(error, calls, int(statistics%newton_matrices), &
                trim(implicit_steppers(i))//': calls of evaluate_derivatives')
            do k = 1, n_derivatives
                call check_count(error, statistics%derivatives(k), int(statistics%newton_matrices), &
                    trim(implicit_steppers(i))//': a derivative')
            end do
            call check_count(error, statistics%difference_evaluations, 0, 'evaluations for differences')
        end do
    end subroutine test_kept_matrix

    subroutine test_stages(error)
        type(error_type), allocatable, intent(out) :: error
        type(statistics_type) :: statistics
        integer :: calls

        call roll_disk('sdirk54', .true., calls, statistics, error)
        call check_count(error, statistics%implicit_stages, 5*n_steps, 'stages of sdirk54')
        call check_true(error, statistics%newton_corrections >= statistics%implicit_stages, 'every stage is corrected once or more')
        call roll_disk('trapezoid', .true., calls, statistics, error)
        call check_count(error, statistics%implicit_stages, n_steps, 'stages of the trapezoid')
        call roll_disk('radau5', .true., calls, statistics, error)
        call check_count(error, statistics%implicit_stages, 3*n_steps, 'stages of radau5')
    end subroutine test_stages

    subroutine test_stand_ins(error)
        type(error_type), allocatable, intent(out) :: error
        type(statistics_type) :: statistics
        integer :: calls, i

        do i = 1, size(stepper_names)
            call roll_disk(trim(stepper_names(i)), .false., calls, statistics, error)
            call check_count(error, calls, 0, trim(stepper_names(i))//': calls of evaluate_derivatives')
            call check_count(error, sum(statistics%derivatives), 0, trim(stepper_names(i))//': derivatives')
            call check_true(error, (statistics%difference_evaluations > 0) .eqv. any(stepper_names(i) == implicit_steppers), &
                trim(stepper_names(i))//': differences are for implicit steps only')
        end do
    end subroutine test_stand_ins

    !> The traps of `spy_on` guard the procedures of constraints that do not exist.
    subroutine test_implicit_lacks(error)
        type(error_type), allocatable, intent(out) :: error
        type(particle_type), target :: particle
        type(spy_type), target :: spy
        type(statistics_type) :: statistics
        type(options_type) :: options
        integer :: i, k

        do i = 1, size(implicit_steppers)
            options = choose(step=1.0e-3_wp, stepper=trim(implicit_steppers(i)))
            ! Holonomic, scleronomic, with a constant mass.
            call spy_on_pendulum(spy, statistics, error, options)
            call check_count(error, spy%calls%nonholonomic_jacobian + spy%calls%nonholonomic_rhs, 0, 'E and e of the pendulum')
            call check_count(error, statistics%terms(nu), 0, 'nu of the pendulum')
            call check_count(error, statistics%terms(mass), 1, 'mass of the pendulum')
            call check_count(error, spy%calls%mass_matrix, 1, 'calls of mass_matrix')
            ! Nonholonomic only.
            call spy_on_knife_edge(spy, statistics, error, options)
            call check_count(error, statistics%terms(phi), 0, 'phi of the knife edge')
            call check_count(error, statistics%terms(nu), 0, 'nu of the knife edge')
            call check_count(error, statistics%position_corrections, 0, 'corrections of u')
            call check_count(error, statistics%position_factorizations, 0, 'factorizations of Phi_q U')
            ! Free: nothing of C.
            call particle%define(with_force=.true.)
            call spy_on(particle, [0.0_wp, 0.0_wp, 0.0_wp], [1.0_wp, 0.0_wp, 0.0_wp], spy, statistics, error, options)
            do k = 1, 4
                call check_count(error, statistics%terms(k), 0, 'terms of constraints')
            end do
            call check_count(error, statistics%basis_factorizations, 0, 'bases')
            call check_count(error, statistics%constraint_factorizations, 0, 'factorizations of C')
            call check_count(error, statistics%position_factorizations, 0, 'factorizations of Phi_q U')
        end do
    end subroutine test_implicit_lacks

    !> The multipliers of the Newton matrix do not count as requested multipliers.
    subroutine test_implicit_asked(error)
        type(error_type), allocatable, intent(out) :: error
        type(statistics_type) :: statistics
        type(curious_type) :: curious
        integer :: calls, i

        do i = 1, size(implicit_steppers)
            call roll_disk(trim(implicit_steppers(i)), .true., calls, statistics, error)
            call check_count(error, statistics%multipliers, 0, 'multipliers')
            call check_count(error, statistics%kinetic_energies + statistics%potential_energies, 0, 'energies')
            curious%steps = 0
            call roll_disk(trim(implicit_steppers(i)), .true., calls, statistics, error, curious)
            call check_count(error, statistics%multipliers, 5, 'multipliers')
            call check_count(error, statistics%kinetic_energies, 5, 'kinetic energies')
            call check_count(error, statistics%potential_energies, 5, 'potential energies')
        end do
    end subroutine test_implicit_asked
end module test_counters
