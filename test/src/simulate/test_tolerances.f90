! SPDX-License-Identifier: MIT
!> Tolerances per coordinate, and limits on work.
module test_tolerances
    use asserts, only: check_below, check_between, check_close, check_failure, check_no_failure, check_true
    use model_tilted_skate, only: tilted_skate_type
    use runs, only: run
    use tandem, only: failure_type => error_type, options_type, simulation_type, statistics_type, stepper_names, wp
    use tandem_simulate_step_control, only: step_control_type
    use tandem_stepper, only: properties_type
    use testdrive, only: error_type, new_unittest, unittest_type
    use, intrinsic :: ieee_arithmetic, only: ieee_positive_inf, ieee_quiet_nan, ieee_value
    implicit none (type, external)
    private

    public :: collect_tolerances

contains

    !> The tests of this suite.
    subroutine collect_tolerances(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('each-coordinate-is-weighted-by-its-own-tolerances', test_weights), &
            new_unittest('what-is-not-given-follows-what-is', test_stand_ins), &
            new_unittest('equal-tolerances-one-a-coordinate-are-the-one-for-all', test_same_run), &
            new_unittest('a-tight-velocity-makes-more-steps', test_tight_velocity), &
            new_unittest('lists-of-the-wrong-length-are-refused', test_lengths), &
            new_unittest('values-that-cannot-be-are-refused', test_values), &
            new_unittest('evaluations-end-at-their-limit', test_evaluations), &
            new_unittest('rejected-steps-count-too', test_rejected), &
            new_unittest('seconds-end-at-their-limit', test_seconds), &
            new_unittest('a-limit-that-is-not-reached-changes-nothing', test_not_reached), &
            new_unittest('limits-on-work-must-not-be-negative', test_work_options)]
    end subroutine collect_tolerances

    !> 1 / (atol s + rtol max |y|), every entry different.
    subroutine test_weights(error)
        type(error_type), allocatable, intent(out) :: error
        type(step_control_type) :: control
        type(options_type) :: options
        real(wp), parameter :: scale(2) = [2.0_wp, 0.5_wp]

        options%rtol_q = [1.0e-3_wp, 1.0e-4_wp]
        options%rtol_qd = [1.0e-5_wp, 1.0e-6_wp]
        options%atol_q = [1.0e-7_wp, 1.0e-8_wp]
        ! A zero selects the relative tolerance there.
        options%atol_qd = [0.0_wp, 1.0e-9_wp]
        call control%initialize(options, scale, 1.0_wp, properties_type(estimate_order=4))
        call control%set_weights([1.0_wp, -3.0_wp], [-2.0_wp, 1.0_wp], [0.0_wp, 4.0_wp], [5.0_wp, -6.0_wp])
        call check_close(error, control%weight_q, 1.0_wp/[2.0e-7_wp + 2.0e-3_wp, 0.5e-8_wp + 3.0e-4_wp], 1.0e-8_wp, 'of q')
        if (allocated(error)) return
        call check_close(error, 1.0e-5_wp*control%weight_qd, 1.0e-5_wp/[2.0e-5_wp + 5.0e-5_wp, 0.5e-9_wp + 6.0e-6_wp], 1.0e-12_wp, &
            'of qd')
    end subroutine test_weights

    subroutine test_stand_ins(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options
        real(wp) :: rtol_q(2), rtol_qd(2), atol_q(2), atol_qd(2)

        options%constraint_tolerance = 1.0e-13_wp
        options%step = 1.0e-3_wp
        call check_below(error, options%relative_tolerance(), 0.0_wp, 'relative tolerance of fixed steps')
        if (allocated(error)) return
        options%step = 0.0_wp
        call check_close(error, [options%relative_tolerance()], [1.0e-6_wp], 0.0_wp, 'the default')
        if (allocated(error)) return
        ! Of the coordinates only: the velocities use the same, and Newton's tolerance is based on the smallest.
        options%rtol_q = [1.0e-4_wp, 1.0e-6_wp]
        call check_true(error, options%is_adaptive(), 'a list asks for steps under error control')
        if (allocated(error)) return
        call options%fill_tolerances(rtol_q, rtol_qd, atol_q, atol_qd)
        call check_close(error, [rtol_q, rtol_qd, atol_q, atol_qd], [options%rtol_q, options%rtol_q, &
            options%rtol_q, options%rtol_q], 0.0_wp, 'the list of the coordinates')
        if (allocated(error)) return
        call check_close(error, [options%relative_tolerance(), options%absolute_tolerance()], spread(1.0e-6_wp, 1, 2), 1.0e-20_wp, &
            'the smallest')
        if (allocated(error)) return
        call check_close(error, [1.0e-2_wp*1.0e-6_wp**1.25_wp], [options%newton_tolerance()], 1.0e-22_wp, 'of the iteration')
        if (allocated(error)) return
        ! Of the velocities only, with a number for all coordinates.
        deallocate (options%rtol_q)
        options%rtol = 1.0e-5_wp
        options%atol = 1.0e-9_wp
        options%rtol_qd = [1.0e-3_wp, 1.0e-2_wp]
        call options%fill_tolerances(rtol_q, rtol_qd, atol_q, atol_qd)
        call check_close(error, [rtol_q, rtol_qd, atol_q, atol_qd], [1.0e-5_wp, 1.0e-5_wp, 1.0e-3_wp, 1.0e-2_wp, &
            spread(1.0e-9_wp, 1, 4)], 0.0_wp, 'the list of the velocities')
        if (allocated(error)) return
        call check_close(error, [options%relative_tolerance()], [1.0e-5_wp], 0.0_wp, 'the smallest beside a number for all')
        if (allocated(error)) return
        ! Of the velocities only: the coordinates have the smallest of them.
        options%rtol = 0.0_wp
        options%atol = 0.0_wp
        call options%fill_tolerances(rtol_q, rtol_qd, atol_q, atol_qd)
        call check_close(error, [rtol_q, atol_q, atol_qd], [spread(1.0e-3_wp, 1, 4), options%rtol_qd], 0.0_wp, 'the smallest')
    end subroutine test_stand_ins

    !> Run the tilted skate to t = 10: its state, its error and its steps.
    subroutine skate(options, state, found, steps, failure)
        type(options_type), intent(in) :: options
        real(wp), intent(out) :: state(4), found
        integer, intent(out) :: steps
        type(failure_type), allocatable, intent(out) :: failure
        type(tilted_skate_type), target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics

        call model%define()
        call simulation%initialize(model, options, 0.0_wp, [0.0_wp, 0.0_wp], [0.0_wp, 0.0_wp], failure)
        if (.not. allocated(failure)) call simulation%integrate(10.0_wp, failure)
        state = 0.0_wp
        if (.not. allocated(failure)) state = [simulation%state%q, simulation%state%qd]
        found = maxval(abs(state(:2) - model%solution(10.0_wp)))
        statistics = simulation%statistics()
        steps = int(statistics%steps)
    end subroutine skate

    !> Bitwise.
    subroutine test_same_run(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: for_all, each
        type(failure_type), allocatable :: failure
        real(wp) :: first(4), second(4), found
        integer :: steps

        for_all%stepper = 'dopri5'
        for_all%rtol = 1.0e-7_wp
        for_all%atol = 1.0e-9_wp
        each%stepper = 'dopri5'
        each%rtol_q = spread(1.0e-7_wp, 1, 2)
        each%atol_q = spread(1.0e-9_wp, 1, 2)
        call skate(for_all, first, found, steps, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call skate(each, second, found, steps, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call check_close(error, second, first, 0.0_wp, 'state at the end')
    end subroutine test_same_run

    !> Tolerances 1e-4 except for the velocities, 1e-10: the steps follow the tight ones, and are larger without them.
    subroutine test_tight_velocity(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: state(4), loose, tight
        integer :: few, many

        options%stepper = 'dopri5'
        options%rtol = 1.0e-4_wp
        call skate(options, state, loose, few, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        options%rtol_qd = spread(1.0e-10_wp, 1, 2)
        options%atol_qd = spread(1.0e-10_wp, 1, 2)
        call skate(options, state, tight, many, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        ! Order 5: a million times the tolerance is 16 times the step.
        call check_true(error, many > 8*few, 'more steps')
        if (allocated(error)) return
        call check_below(error, tight, 1.0e-3_wp*loose, 'error')
    end subroutine test_tight_velocity

    subroutine test_lengths(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: state(4), found
        integer :: steps

        options%stepper = 'dopri5'
        options%rtol = 1.0e-4_wp
        options%atol_qd = spread(1.0e-6_wp, 1, 3)
        call skate(options, state, found, steps, failure)
        call check_failure(error, failure, 'invalid_option', 'atol_qd has 3 entries, the model has n = 2')
        if (allocated(error)) return
        deallocate (options%atol_qd)
        options%rtol_q = [real(wp) ::]
        call skate(options, state, found, steps, failure)
        call check_failure(error, failure, 'invalid_option', 'rtol_q has 0 entries')
    end subroutine test_lengths

    subroutine test_values(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: bad(3)
        integer :: i

        bad = [-1.0e-6_wp, ieee_value(1.0_wp, ieee_quiet_nan), ieee_value(1.0_wp, ieee_positive_inf)]
        do i = 1, size(bad)
            options%rtol_q = [1.0e-6_wp, bad(i)]
            call options%check(failure)
            call check_failure(error, failure, 'invalid_option', 'rtol_q(2) = ')
            if (allocated(error)) return
            deallocate (options%rtol_q)
            options%atol_q = [bad(i), 1.0e-6_wp]
            call options%check(failure)
            call check_failure(error, failure, 'invalid_option', 'atol_q(1) = ')
            if (allocated(error)) return
            deallocate (options%atol_q)
        end do
        ! A relative tolerance of zero would leave a coordinate without a tolerance.
        options%rtol_qd = [0.0_wp, 1.0e-6_wp]
        call options%check(failure)
        call check_failure(error, failure, 'invalid_option', 'rtol_qd(1) = ')
    end subroutine test_values

    !> Every stepper, fixed steps and controlled ones: at most one step more, and the last state is that of a step.
    subroutine test_evaluations(error)
        type(error_type), allocatable, intent(out) :: error
        type(tilted_skate_type), target :: model
        type(simulation_type) :: simulation, same
        type(statistics_type) :: statistics
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        integer :: i, k
        integer, parameter :: limit = 200

        call model%define()
        do k = 1, 2
            do i = 1, size(stepper_names)
                options = options_type()
                options%stepper = stepper_names(i)
                if (k == 1) options%step = 0.01_wp
                if (k == 2 .and. stepper_names(i) == 'rk4') cycle
                if (k == 2) options%rtol = 1.0e-10_wp
                options%max_evaluations = limit
                call run(simulation, model, options, 0.0_wp, [0.0_wp, 0.0_wp], [0.0_wp, 0.0_wp], 10.0_wp, failure)
                call check_failure(error, failure, 'work_limit', 'max_evaluations = 200 is reached, t = ')
                if (allocated(error)) return
                statistics = simulation%statistics()
                ! A dop853 step takes 12; an implicit one may take more in Newton's iteration, measured: 24.
                call check_true(error, statistics%right_hand_sides >= limit .and. statistics%right_hand_sides <= limit + 30, &
                    stepper_names(i)//': evaluations')
                if (allocated(error)) return
                options%max_evaluations = 0
                options%max_steps = int(statistics%steps)
                call run(same, model, options, 0.0_wp, [0.0_wp, 0.0_wp], [0.0_wp, 0.0_wp], 10.0_wp, failure)
                call check_failure(error, failure, 'step_limit', 'steps were taken')
                if (allocated(error)) return
                call check_close(error, [simulation%state%t, simulation%state%q], [same%state%t, same%state%q], 0.0_wp, &
                    stepper_names(i)//': last state')
                if (allocated(error)) return
            end do
        end do
    end subroutine test_evaluations

    !> A first step of 10 is rejected many times: the limit is reached before any step is accepted.
    subroutine test_rejected(error)
        type(error_type), allocatable, intent(out) :: error
        type(tilted_skate_type), target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(options_type) :: options
        type(failure_type), allocatable :: failure

        call model%define()
        options%stepper = 'dopri5'
        options%rtol = 1.0e-12_wp
        options%first_step = 10.0_wp
        options%max_evaluations = 10
        call run(simulation, model, options, 0.0_wp, [0.0_wp, 0.0_wp], [0.0_wp, 0.0_wp], 10.0_wp, failure)
        call check_failure(error, failure, 'work_limit', 't = 0.0')
        if (allocated(error)) return
        statistics = simulation%statistics()
        call check_true(error, statistics%steps == 0 .and. statistics%rejected == 2, 'two tries')
    end subroutine test_rejected

    !> 10 million steps would take seconds.
    subroutine test_seconds(error)
        type(error_type), allocatable, intent(out) :: error
        type(tilted_skate_type), target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(options_type) :: options
        type(failure_type), allocatable :: failure

        call model%define()
        options%step = 1.0e-6_wp
        options%max_seconds = 0.02_wp
        call run(simulation, model, options, 0.0_wp, [0.0_wp, 0.0_wp], [0.0_wp, 0.0_wp], 10.0_wp, failure)
        call check_failure(error, failure, 'work_limit', 'max_seconds = ')
        if (allocated(error)) return
        statistics = simulation%statistics()
        call check_true(error, statistics%wall_seconds >= 0.02_wp, 'wall time')
        ! On a busy machine it may wait for any time, but does not work meanwhile.
        call check_below(error, statistics%cpu_seconds, 2.0_wp, 'time of the processor')
        if (allocated(error)) return
        call check_true(error, statistics%steps > 0, 'steps')
    end subroutine test_seconds

    subroutine test_not_reached(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: free(4), limited(4), found
        integer :: steps

        options%stepper = 'dop853'
        options%rtol = 1.0e-8_wp
        call skate(options, free, found, steps, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        options%max_evaluations = 100000
        options%max_seconds = 1.0e6_wp
        call skate(options, limited, found, steps, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call check_close(error, limited, free, 0.0_wp, 'state at the end')
    end subroutine test_not_reached

    subroutine test_work_options(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options
        type(failure_type), allocatable :: failure

        options%max_evaluations = -1
        call options%check(failure)
        call check_failure(error, failure, 'invalid_option', 'max_evaluations = -1')
        if (allocated(error)) return
        options%max_evaluations = 0
        options%max_seconds = ieee_value(1.0_wp, ieee_quiet_nan)
        call options%check(failure)
        call check_failure(error, failure, 'invalid_option', 'max_seconds = ')
    end subroutine test_work_options
end module test_tolerances
