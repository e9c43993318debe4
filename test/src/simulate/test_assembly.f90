! SPDX-License-Identifier: MIT
!> Tests of assembled starts: options, reported displacements and their rows, failing procedures, and simulations that begin so.
module test_assembly
    use asserts, only: check_below, check_between, check_close, check_count, check_failure, check_no_failure, check_text, &
        check_true
    use model_curve, only: curve_type
    use model_knife_edge, only: knife_edge_type
    use model_moving_pivot, only: moving_pivot_type
    use model_particle, only: particle_type
    use model_pendulum, only: pendulum_type
    use model_sleigh, only: sleigh_type
    use model_spy, only: fault_nan, fault_retry, fault_stop, spy_type
    use tandem, only: assemble, assembly_type, failure_type => error_type, motorcycle_type, need_jacobian, need_mass, &
        need_phi, options_type, rolling_disk_type, simulation_type, statistics_type, wp
    use tandem_model_evaluator, only: evaluator_type
    use tandem_simulate_nearest_position, only: nearest_position_type
    use tandem_simulate_nearest_velocity, only: nearest_velocity_type
    use tandem_model_counts, only: counts_type
    use testdrive, only: error_type, new_unittest, unittest_type
    use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
    implicit none (type, external)
    private

    public :: collect_assembly

    !> The paper's printed start of the motorcycle and of the chopper (section 9): the pitch is left out.
    real(wp), parameter :: printed(10, 2) = reshape([ &
        0.0_wp, 0.0_wp, 0.304_wp, 1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, -0.062_wp, -0.294_wp, 0.621_wp, &
        0.0_wp, 0.0_wp, 0.314_wp, 1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, -0.217_wp, -0.207_wp, 0.91_wp], [10, 2])

contains

    !> The suite.
    subroutine collect_assembly(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('moved-too-far-names-coordinate-and-row', test_too_far), &
            new_unittest('rheonomic-rows-and-segments', test_rheonomic), &
            new_unittest('nothing-to-satisfy', test_unconstrained), &
            new_unittest('shares-of-the-rows-add-up', test_shares), &
            new_unittest('a-coordinate-that-moves-for-no-row', test_scaled), &
            new_unittest('failing-procedures', test_failing), &
            new_unittest('requests-that-cannot-be', test_requests), &
            new_unittest('a-simulation-that-assembles-its-start', test_simulation), &
            new_unittest('the-printed-motorcycle-assembles-near-its-equilibrium', test_printed)]
    end subroutine collect_assembly

    subroutine test_too_far(error)
        type(error_type), allocatable, intent(out) :: error
        type(motorcycle_type), target :: model
        type(knife_edge_type), target :: edge
        type(assembly_type) :: request
        type(failure_type), allocatable :: failure
        real(wp) :: q(10), qd(10), x(3), v(3)

        call model%define()
        q = printed(:, 1)
        qd = 0.0_wp
        qd(2) = 15.0_wp
        request%largest_move_q = 2.0e-3_wp
        call assemble(model, request, 0.0_wp, q, qd, failure)
        call check_failure(error, failure, 'inconsistent_start', 'coordinate "e1" would move by 0.29')
        if (allocated(error)) return
        call check_text(error, failure%message, '(allowed: 0.2000000E-2)')
        call check_text(error, failure%message, 'most of it for "front contact height"')
        call check_text(error, failure%message, 'allow a larger change')
        call check_close(error, q, printed(:, 1), 0.0_wp, 'q')
        ! A velocity of 3 along the edge's normal, which must vanish completely; in units of half its scale, 6.
        call edge%define()
        edge%coordinate_scale = [0.5_wp, 0.5_wp, 1.0_wp]
        x = [0.0_wp, 0.0_wp, acos(0.0_wp)]
        v = [3.0_wp, 1.0_wp, 0.2_wp]
        request%largest_move_qd = 5.9_wp
        call assemble(edge, request, 0.0_wp, x, v, failure)
        call check_failure(error, failure, 'inconsistent_start', &
            'the velocity of coordinate "x" would move by -6.000000 of its scale (allowed: 5.9')
        if (allocated(error)) return
        call check_text(error, failure%message, 'most of it for "no slip"')
        request%largest_move_qd = 6.1_wp
        call assemble(edge, request, 0.0_wp, x, v, failure)
        call check_no_failure(error, failure)
        call check_close(error, v, [0.0_wp, 1.0_wp, 0.2_wp], 1.0e-15_wp, 'v')
    end subroutine test_too_far

    !> The pivot at t = 0.7 is on the circle; its velocity is that of the rod's end except for the rotation. After a breakpoint the
    !> model is in the following segment.
    subroutine test_rheonomic(error)
        type(error_type), allocatable, intent(out) :: error
        type(moving_pivot_type), target :: model
        type(sleigh_type), target :: sleigh
        type(assembly_type) :: request
        type(failure_type), allocatable :: failure
        real(wp), parameter :: t = 0.7_wp, angle = 0.6_wp
        real(wp) :: q(2), qd(2), expected(2), expected_rate(2), x(3), v(3)

        call model%define()
        model%swing = 0.2_wp
        call model%motion(t, angle, 1.3_wp, expected, expected_rate)
        ! Further out along the rod, with a velocity along it.
        q = expected + 0.3_wp*[sin(angle), -cos(angle)]
        qd = expected_rate + 0.9_wp*[sin(angle), -cos(angle)]
        request = assembly_type(largest_move_q=0.0_wp)
        call assemble(model, request, t, q, qd, failure)
        call check_no_failure(error, failure)
        call check_close(error, q, expected, 1.0e-14_wp, 'q')
        call check_close(error, qd, expected_rate, 1.0e-14_wp, 'qd')
        ! Speed required by the second segment at phi = 0: yd = -e - arm phid.
        call sleigh%define(1.0_wp)
        x = 0.0_wp
        v = [1.0_wp, 0.0_wp, 0.0_wp]
        request%fixed_qd = [.true., .false., .true.]
        call assemble(sleigh, request, 2.0_wp, x, v, failure)
        call check_no_failure(error, failure)
        call check_close(error, v, [1.0_wp, 0.5_wp - 2*sleigh%growth, 0.0_wp], 1.0e-15_wp, 'v after the breakpoint')
    end subroutine test_rheonomic

    subroutine test_unconstrained(error)
        type(error_type), allocatable, intent(out) :: error
        type(particle_type), target :: model
        type(assembly_type) :: request
        type(failure_type), allocatable :: failure
        real(wp) :: q(3), qd(3)

        call model%define(.false.)
        q = [1.0_wp, 2.0_wp, 3.0_wp]
        qd = -q
        request%fixed_q = [.true., .false., .true.]
        call assemble(model, request, 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
        call check_close(error, [q, qd], [1.0_wp, 2.0_wp, 3.0_wp, -1.0_wp, -2.0_wp, -3.0_wp], 0.0_wp, 'the state')
        call check_true(error, all(request%counts%terms == 0), 'nothing is evaluated')
        call check_true(error, request%is_nearest .and. request%row_q == 0, 'it is nearest')
    end subroutine test_unconstrained

    !> The displacements due to the rows sum to the total: at the nearest position by its conditions, for velocities because they
    !> are linear in the violations.
    subroutine test_shares(error)
        type(error_type), allocatable, intent(out) :: error
        type(motorcycle_type), target :: model
        type(evaluator_type) :: evaluator
        type(nearest_position_type) :: position
        type(nearest_velocity_type) :: velocity
        type(counts_type) :: counts
        logical :: fixed(10)
        real(wp) :: q(10), qd(10), ones(10)
        integer :: stat

        call model%define()
        call evaluator%initialize(model)
        ones = 1.0_wp
        fixed = .false.
        fixed(3) = .true.
        q = printed(:, 1)
        call position%initialize(6, fixed, ones, ones, 1.0e-12_wp, 200)
        call position%find(evaluator, 0.0_wp, q, counts, stat)
        call check_count(error, stat, 0, 'status')
        ! The shares are large and nearly cancel; the nearest point is found to some eps.
        call check_close(error, sum(position%contribution, dim=1), q - printed(:, 1), 1.0e-14_wp, 'contributions to the position')
        call check_close(error, position%contribution(:, 3), spread(0.0_wp, 1, 6), 0.0_wp, 'contributions to the fixed coordinate')
        qd = ones
        call velocity%initialize(8, fixed, ones, ones, .true., 1.0e-12_wp)
        call velocity%find(evaluator, 0.0_wp, q, qd, counts, stat)
        call check_count(error, stat, 0, 'status')
        call check_close(error, sum(velocity%contribution, dim=1), qd - ones, 1.0e-12_wp, 'contributions to the velocity')
    end subroutine test_shares

    !> The default weights are those of scaled coordinates: in millimetres the same happens as in metres.
    subroutine test_scaled(error)
        type(error_type), allocatable, intent(out) :: error
        type(curve_type), target :: metres, mixed
        type(assembly_type) :: request
        type(failure_type), allocatable :: failure
        real(wp), parameter :: units(2) = [1000.0_wp, 0.01_wp]
        real(wp) :: q(2), qd(2), expected(2), expected_rate(2)

        call metres%define()
        expected = [3.0_wp, 1.5_wp]
        expected_rate = [1.0_wp, -2.0_wp]
        q = expected*units
        qd = expected_rate*units
        request = assembly_type(largest_move_q=0.0_wp)
        request%velocity_metric = 'weights'
        call assemble(metres, request, 0.0_wp, expected, expected_rate, failure)
        call check_no_failure(error, failure)
        call mixed%define()
        mixed%axes = metres%axes*units
        mixed%coordinate_scale = units
        call assemble(mixed, request, 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
        call check_close(error, q/units, expected, 1.0e-14_wp, 'q')
        call check_close(error, qd/units, expected_rate, 1.0e-14_wp, 'qd')
        ! By 1.7 of a scale, as in metres.
        q = [3.0_wp, 1.5_wp]*units
        request%largest_move_q = 1.0_wp
        call assemble(mixed, request, 0.0_wp, q, qd, failure)
        call check_failure(error, failure, 'inconsistent_start', 'coordinate "x" would move by -1.')
        request%largest_move_q = 2.0_wp
        call assemble(mixed, request, 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
    end subroutine test_scaled

    !> A NaN, a positive and a negative status of each term, from the start on; nothing changes in these cases.
    subroutine test_failing(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: inner
        type(spy_type), target :: spy
        type(assembly_type) :: request
        type(failure_type), allocatable :: failure
        integer, parameter :: needs(3) = [need_phi, need_jacobian, need_mass], faults(3) = [fault_nan, fault_retry, fault_stop]
        character(len=15), parameter :: names(3) = [character(len=15) :: 'not_finite', 'not_evaluable', 'callback_failed']
        character(len=13), parameter :: terms(3) = [character(len=13) :: 'term phi', 'term jacobian', 'term mass']
        real(wp) :: q(2), qd(2)
        integer :: i, k

        call inner%define()
        request = assembly_type(largest_move_q=0.0_wp)
        do i = 1, 3
            do k = 1, 3
                spy = spy_type()
                call spy%wrap(inner)
                spy%fault_term = needs(i)
                spy%fault = faults(k)
                spy%fault_time = -huge(1.0_wp)
                q = [1.0_wp, 0.5_wp]
                qd = [0.3_wp, 0.1_wp]
                call assemble(spy, request, 0.0_wp, q, qd, failure)
                call check_failure(error, failure, trim(names(k)), trim(terms(i)))
                call check_close(error, [q, qd], [1.0_wp, 0.5_wp, 0.3_wp, 0.1_wp], 0.0_wp, 'the state')
            end do
        end do
    end subroutine test_failing

    subroutine test_requests(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(assembly_type) :: request
        real(wp) :: q(2), qd(2)

        call model%define()
        q = [0.8_wp, 0.0_wp]
        qd = 0.0_wp
        request%weight_q = [1.0_wp]
        call check_refused('weight_q has 1 entries instead of 2')
        request%weight_qd = [1.0_wp, 0.0_wp]
        call check_refused('an entry of weight_qd is not positive and finite')
        request%weight_qd = [1.0_wp, ieee_value(1.0_wp, ieee_quiet_nan)]
        call check_refused('an entry of weight_qd is not positive and finite')
        request%fixed_q = [.true.]
        call check_refused('fixed_q has 1 entries instead of 2')
        request%fixed_qd = [.true., .true., .true.]
        call check_refused('fixed_qd has 3 entries instead of 2')
        request%velocity_metric = 'metric'
        call check_refused('velocity_metric = "metric" is unknown')
        request%largest_move_q = -1.0_wp
        call check_refused('largest_move_q or largest_move_qd is negative')
        request%largest_move_qd = ieee_value(1.0_wp, ieee_quiet_nan)
        call check_refused('largest_move_q or largest_move_qd is negative')
        request%tolerance = 0.0_wp
        call check_refused('tolerance = 0.000000 must be positive')
        request%iteration_limit = 0
        call check_refused('iteration_limit = 0 must be positive')
        q(1) = ieee_value(1.0_wp, ieee_quiet_nan)
        call check_refused('q0 or qd0 is not finite')

    contains

        subroutine check_refused(piece)
            character(len=*), intent(in) :: piece
            type(failure_type), allocatable :: failure

            call assemble(model, request, 0.0_wp, q, qd, failure)
            call check_failure(error, failure, 'invalid_option', piece)
            request = assembly_type()
        end subroutine check_refused
    end subroutine test_requests

    !> An otherwise refused start is accepted, the statistics contain the displacement, and a good start gives a bitwise identical
    !> run.
    subroutine test_simulation(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(rolling_disk_type), target :: disk
        type(simulation_type) :: simulation, plain
        type(statistics_type) :: statistics
        type(assembly_type) :: request
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2), x(9), v(9)

        call model%define()
        q = [0.9_wp, 0.0_wp]
        qd = [0.2_wp, 1.0_wp]
        call simulation%initialize(model, options_type(step=1.0e-3_wp), 0.0_wp, q, qd, failure)
        call check_failure(error, failure, 'inconsistent_start', 'the start violates')
        call simulation%initialize(model, options_type(step=1.0e-3_wp), 0.0_wp, q, qd, failure, request)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call check_close(error, [simulation%state%q, simulation%state%qd], [0.8_wp, 0.0_wp, 0.0_wp, 1.0_wp], 1.0e-15_wp, 'state')
        call check_below(error, maxval(simulation%errors(:2)), 1.0e-15_wp, 'errors at the start')
        statistics = simulation%statistics()
        call check_close(error, [statistics%start_moved_q, statistics%start_moved_qd], [0.1_wp, 0.2_wp], 1.0e-15_wp, 'start_moved')
        call simulation%integrate(0.1_wp, failure)
        call check_no_failure(error, failure)
        request%largest_move_q = 0.05_wp
        call simulation%initialize(model, options_type(step=1.0e-3_wp), 0.0_wp, q, qd, failure, request)
        call check_failure(error, failure, 'inconsistent_start', 'coordinate "q1" would move by -0.1')

        call disk%define()
        call disk%start([-1.0_wp, 0.01_wp, 0.0_wp], 0.0_wp, x, v)
        call plain%initialize(disk, options_type(step=1.0e-3_wp), 0.0_wp, x, v, failure)
        if (.not. allocated(failure)) call plain%integrate(0.1_wp, failure)
        call check_no_failure(error, failure)
        request = assembly_type()
        call simulation%initialize(disk, options_type(step=1.0e-3_wp), 0.0_wp, x, v, failure, request)
        if (.not. allocated(failure)) call simulation%integrate(0.1_wp, failure)
        call check_no_failure(error, failure)
        call check_close(error, [simulation%state%q, simulation%state%qd], [plain%state%q, plain%state%qd], 0.0_wp, 'the end')
    end subroutine test_simulation

    !> The printed q0 has an error of four millimetres of height; the nearest consistent position has most of the pitch of the
    !> intended equilibrium. qd0 = (0, 15, 0, ...) has no steering rate: the nearest velocity turns with the front wheel.
    subroutine test_printed(error)
        type(error_type), allocatable, intent(out) :: error
        type(motorcycle_type), target :: model
        type(simulation_type) :: simulation
        type(assembly_type) :: request
        type(failure_type), allocatable :: failure
        real(wp) :: q(10), qd(10), equilibrium(10), motion(10)
        integer :: k, stat

        do k = 1, 2
            if (k == 2) then
                model%fork_angle = atan(1.0_wp)
                model%amplitude = 0.0078_wp
            end if
            call model%define()
            call model%start(15.0_wp, equilibrium, motion, stat)
            q = printed(:, k)
            qd = 0.0_wp
            qd(2) = 15.0_wp
            call simulation%initialize(model, options_type(step=1.0e-3_wp), 0.0_wp, q, qd, failure)
            call check_failure(error, failure, 'inconsistent_start')
            call simulation%initialize(model, options_type(step=1.0e-3_wp), 0.0_wp, q, qd, failure, request)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            associate (state => simulation%state)
                call check_below(error, maxval(simulation%errors(:2)), 1.0e-14_wp, 'errors')
                ! Half a unit of the last printed digit, which s shows most: three digits, and two of the chopper's.
                call check_close(error, state%q, equilibrium, merge(5.0e-4_wp, 5.0e-3_wp, k == 1), 'q')
                call check_between(error, state%q(5)/equilibrium(5), 0.9_wp, 1.0_wp, 'the pitch against the equilibrium''s')
                call check_count(error, maxloc(abs(request%moved_q), dim=1), 5, 'the coordinate that moved most')
                call check_close(error, request%moved_q(5:5), state%q(5:5), 0.0_wp, 'what it moved')
                call check_close(error, state%qd, motion, 1.0e-6_wp, 'qd')
                call check_between(error, maxval(abs(request%moved_qd)), 1.0e-4_wp, 1.0e-3_wp, 'the largest move of qd')
                call check_text(error, model%row_name(request%row_q), 'front contact height')
                call check_text(error, model%row_name(request%row_qd), 'no slip front')
            end associate
            call check_true(error, request%is_nearest .and. request%iterations <= 10, 'it takes a few iterations')
        end do
    end subroutine test_printed
end module test_assembly
