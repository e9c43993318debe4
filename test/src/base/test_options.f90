! SPDX-License-Identifier: MIT
!> Tests of the options, the statuses and the error messages.
module test_options
    use asserts, only: check_below, check_failure, check_no_failure, check_text, check_true
    use tandem, only: basis_methods, change_stepper, chart_policies, complete_options, failure_type => error_type, &
        is_input_error, new_stepper, options_type, properties_type, refresh_modes, set_error, status_name, stepper_choices, &
        stepper_type, steppers_without_estimate, to_text, wp
    use tandem_options, only: explicit_steppers
    use tandem_status, only: status_chart_left, status_inconsistent_start, status_invalid_model, status_invalid_option, &
        status_output_failed, status_step_limit
    use testdrive, only: error_type, new_unittest, test_failed, unittest_type
    use, intrinsic :: ieee_arithmetic, only: ieee_positive_inf, ieee_quiet_nan, ieee_value
    implicit none (type, external)
    private

    public :: collect_options

contains

    !> The suite.
    subroutine collect_options(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('defaults-are-accepted', test_defaults), &
            new_unittest('every-policy-and-mode-is-accepted', test_choices), &
            new_unittest('unknown-chart-is-refused', test_chart), &
            new_unittest('unknown-refresh-is-refused', test_refresh), &
            new_unittest('unknown-basis-is-refused', test_basis), &
            new_unittest('unknown-projection-is-refused', test_projection), &
            new_unittest('step-must-be-positive-and-finite', test_step), &
            new_unittest('error-control-has-a-tolerance-and-limits-that-can-be', test_control), &
            new_unittest('a-step-or-the-lack-of-an-estimate-fixes-the-steps', test_kind_of_steps), &
            new_unittest('steppers-are-known-to-have-what-their-properties-say', test_properties), &
            new_unittest('options-without-effect-are-refused', test_without_effect), &
            new_unittest('changing-the-stepper-resets-what-has-no-effect-then', test_change), &
            new_unittest('limits-must-not-be-negative', test_limits), &
            new_unittest('tolerances-must-be-resolvable', test_tolerances), &
            new_unittest('secant-limit-must-exceed-one', test_secant_limit), &
            new_unittest('max-steps-must-be-positive', test_max_steps), &
            new_unittest('unset-tolerances-follow-the-constraint-tolerance', test_unset), &
            new_unittest('lists-of-tolerances-are-compared', test_difference), &
            new_unittest('statuses-have-names', test_status_names), &
            new_unittest('input-errors-are-told-from-failures', test_input_errors), &
            new_unittest('messages-have-status-problem-and-advice', test_messages), &
            new_unittest('numbers-in-messages-have-no-blanks', test_numbers)]
    end subroutine collect_options

    subroutine test_defaults(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options
        type(failure_type), allocatable :: failure

        call options%check(failure)
        call check_no_failure(error, failure)
        ! As documented.
        call check_true(error, options%stepper == 'auto' .and. options%chart == 'every_step' .and. options%refresh == 'factor', &
            'auto, every_step and factor are the defaults')
        call complete_options(options, failure)
        call check_no_failure(error, failure)
        call check_below(error, abs(options%rtol - 1.0e-6_wp), 0.0_wp, 'rtol - 1e-6')
        call check_true(error, options%projection == 'automatic', 'the projection is chosen by default')
        call check_below(error, abs(options%constraint_tolerance - 1.0e-12_wp), 0.0_wp, 'constraint_tolerance - 1e-12')
    end subroutine test_defaults

    subroutine test_choices(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        integer :: i, j, k

        do k = 1, size(basis_methods)
            options%basis = basis_methods(k)
            call options%check(failure)
            call check_no_failure(error, failure)
        end do
        do i = 1, size(chart_policies)
            do j = 1, size(refresh_modes)
                options%chart = chart_policies(i)
                options%refresh = refresh_modes(j)
                call options%check(failure)
                call check_no_failure(error, failure)
            end do
        end do
    end subroutine test_choices

    subroutine test_chart(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options

        options%chart = 'sometimes'
        call check_refused(options, 'chart = "sometimes"', error)
    end subroutine test_chart

    subroutine test_refresh(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options

        options%refresh = 'guess'
        call check_refused(options, 'refresh = "guess"', error)
    end subroutine test_refresh

    subroutine test_basis(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options

        options%basis = 'lu'
        call check_refused(options, 'basis = "lu"', error)
    end subroutine test_basis

    subroutine test_projection(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options

        options%projection = 'never'
        call check_refused(options, 'projection = "never"', error)
    end subroutine test_projection

    subroutine test_step(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options
        real(wp) :: bad(4)
        integer :: i

        bad = [-1.0e-300_wp, -1.0e-3_wp, ieee_value(1.0_wp, ieee_quiet_nan), ieee_value(1.0_wp, ieee_positive_inf)]
        do i = 1, size(bad)
            options%step = bad(i)
            call check_refused(options, 'step = ', error)
        end do
    end subroutine test_step

    subroutine test_control(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: bad(3)
        integer :: i

        bad = [-1.0e-6_wp, ieee_value(1.0_wp, ieee_quiet_nan), ieee_value(1.0_wp, ieee_positive_inf)]
        do i = 1, size(bad)
            call check_refused(options_type(rtol=bad(i)), 'rtol = ', error)
            call check_refused(options_type(atol=bad(i)), 'atol = ', error)
            call check_refused(options_type(first_step=bad(i)), 'first_step = ', error)
            call check_refused(options_type(max_step=bad(i)), 'max_step = ', error)
        end do
    end subroutine test_control

    !> Steps are fixed if a step is given or the stepper has no estimate, and follow an estimate otherwise, with rtol = 1e-6.
    subroutine test_kind_of_steps(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        integer :: i

        do i = 1, size(stepper_choices)
            options = options_type(stepper=stepper_choices(i))
            call complete_options(options, failure)
            call check_no_failure(error, failure)
            if (stepper_choices(i) == 'rk4') then
                call check_true(error, .not. options%is_adaptive(), 'rk4 has fixed steps')
                call check_below(error, abs(options%step - 1.0e-3_wp), 0.0_wp, 'step - 1 ms')
            else
                call check_true(error, options%is_adaptive(), trim(stepper_choices(i))//' follows its estimate')
                call check_below(error, abs(options%relative_tolerance() - 1.0e-6_wp), 0.0_wp, 'rtol - 1e-6')
                call check_below(error, options%step, 0.0_wp, 'step')
            end if
            options = options_type(stepper=stepper_choices(i), step=0.01_wp)
            call complete_options(options, failure)
            call check_no_failure(error, failure)
            call check_true(error, .not. options%is_adaptive(), 'a step fixes the steps of '//trim(stepper_choices(i)))
            call check_true(error, options%stepper == merge('rk4             ', stepper_choices(i), &
                stepper_choices(i) == 'auto'), 'auto with a fixed step is rk4')
            if (allocated(error)) return
        end do
    end subroutine test_kind_of_steps

    !> The lists of steppers agree with the steppers.
    subroutine test_properties(error)
        type(error_type), allocatable, intent(out) :: error
        class(stepper_type), allocatable :: stepper
        type(properties_type) :: properties
        integer :: i

        do i = 1, size(stepper_choices)
            call new_stepper(stepper_choices(i), stepper)
            properties = stepper%properties()
            call check_true(error, any(steppers_without_estimate == stepper_choices(i)) .eqv. properties%estimate_order == 0, &
                trim(stepper_choices(i))//' has an estimate')
            call check_true(error, any(explicit_steppers == stepper_choices(i)) .eqv. &
                (.not. properties%implicit .and. properties%partner == ''), trim(stepper_choices(i))//' is explicit')
            if (allocated(error)) return
        end do
    end subroutine test_properties

    subroutine test_without_effect(error)
        type(error_type), allocatable, intent(out) :: error

        call refuse(options_type(step=0.1_wp, rtol=1.0e-6_wp), 'step is given beside a tolerance', 'remove step or rtol')
        call refuse(options_type(step=0.1_wp, rtol_qd=[1.0e-6_wp]), 'step is given', 'remove step or rtol')
        call refuse(options_type(step=0.1_wp, atol=1.0e-6_wp), 'atol has no effect on fixed steps', 'rtol instead of step')
        call refuse(options_type(step=0.1_wp, atol_q=[1.0e-6_wp]), 'atol_q has', 'rtol instead of step')
        call refuse(options_type(step=0.1_wp, atol_qd=[1.0e-6_wp]), 'atol_qd has', 'rtol instead of step')
        call refuse(options_type(step=0.1_wp, first_step=0.1_wp), 'first_step has', 'rtol instead of step')
        call refuse(options_type(step=0.1_wp, max_step=0.1_wp), 'max_step has', 'rtol instead of step')
        call refuse(options_type(stepper='rk4', max_step=0.1_wp), 'rk4 has no error estimate', 'choose another stepper')
        call refuse(options_type(v_limit=1.0_wp), 'v_limit has no effect with chart = "every_step"', 'set chart = "paper"')
        call refuse(options_type(chart='adaptive', w_limit=1.0_wp), 'with chart = "adaptive"', 'set chart = "paper"')
        call refuse(options_type(condition_limit=10.0_wp), 'condition_limit has', 'set chart = "paper"')
        call refuse(options_type(iteration_limit=3), 'iteration_limit has', 'set chart = "paper"')
        call refuse(options_type(chart='paper', secant_limit=2.0_wp), 'secant_limit has', 'set chart = "adaptive"')
        call refuse(options_type(btol=1.0e-9_wp), 'btol has no effect with refresh = "factor"', 'set refresh = "refine"')
        call refuse(options_type(htol=1.0e-9_wp), 'htol has', 'set refresh = "refine"')
        call refuse(options_type(stepper='dopri5', intol=1.0e-9_wp), 'the stages of dopri5 are explicit', 'an implicit stepper')
        call accept(options_type(max_step=0.1_wp, first_step=0.01_wp, atol=1.0e-9_wp))
        call accept(options_type(rtol=1.0e-8_wp, atol_q=[1.0e-9_wp]))
        call accept(options_type(chart='paper', v_limit=1.0_wp, w_limit=1.0_wp, condition_limit=9.0_wp, iteration_limit=3))
        call accept(options_type(chart='adaptive', secant_limit=2.0_wp))
        call accept(options_type(refresh='refine', btol=1.0e-9_wp, htol=1.0e-9_wp, intol=1.0e-9_wp))

    contains

        !> The message names the option, the reason and the remedy.
        subroutine refuse(options, problem, remedy)
            type(options_type), intent(in) :: options
            character(len=*), intent(in) :: problem, remedy
            type(options_type) :: completed
            type(failure_type), allocatable :: failure

            if (allocated(error)) return
            completed = options
            call complete_options(completed, failure)
            call check_failure(error, failure, 'invalid_option', problem)
            if (.not. allocated(error)) call check_failure(error, failure, 'invalid_option', remedy)
        end subroutine refuse

        subroutine accept(options)
            type(options_type), intent(in) :: options
            type(options_type) :: completed
            type(failure_type), allocatable :: failure

            completed = options
            call complete_options(completed, failure)
            call check_no_failure(error, failure)
        end subroutine accept
    end subroutine test_without_effect

    subroutine test_change(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options
        type(failure_type), allocatable :: failure

        options = options_type(stepper='radau5', rtol=1.0e-8_wp, atol_q=[1.0e-9_wp], max_step=0.1_wp, intol=1.0e-10_wp, &
            chart='paper', v_limit=1.0_wp)
        call change_stepper(options, 'dopri5', step=0.01_wp)
        call complete_options(options, failure)
        call check_no_failure(error, failure)
        call check_true(error, .not. options%is_adaptive() .and. options%stepper == 'dopri5' .and. options%v_limit > 0.0_wp, &
            'dopri5 with fixed steps and the limits of its chart')
        call change_stepper(options, 'radau5', rtol=1.0e-7_wp, chart='every_step')
        call complete_options(options, failure)
        call check_no_failure(error, failure)
        call check_true(error, options%is_adaptive() .and. options%relative_tolerance() < 2.0e-7_wp, 'radau5 with a tolerance')
    end subroutine test_change

    subroutine test_limits(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options

        options%v_limit = -0.1_wp
        call check_refused(options, 'v_limit = ', error)
        options%v_limit = ieee_value(1.0_wp, ieee_quiet_nan)
        call check_refused(options, 'v_limit = ', error)
        options%v_limit = 0.7_wp
        options%w_limit = -0.1_wp
        call check_refused(options, 'w_limit = ', error)
        options%w_limit = ieee_value(1.0_wp, ieee_positive_inf)
        call check_refused(options, 'w_limit = ', error)
        options%w_limit = 0.0_wp
        options%condition_limit = -1.0_wp
        call check_refused(options, 'condition_limit = ', error)
        options%condition_limit = 0.0_wp
        options%iteration_limit = -1
        call check_refused(options, 'iteration_limit = -1', error)
    end subroutine test_limits

    subroutine test_tolerances(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options
        real(wp) :: bad(4)
        integer :: i

        bad = [-1.0e-12_wp, 1.0e-17_wp, 0.1_wp, ieee_value(1.0_wp, ieee_quiet_nan)]
        do i = 1, size(bad)
            options = options_type(constraint_tolerance=bad(i))
            call check_refused(options, 'constraint_tolerance = ', error)
            options = options_type(utol=bad(i))
            call check_refused(options, 'utol = ', error)
            options = options_type(btol=bad(i))
            call check_refused(options, 'btol = ', error)
            options = options_type(htol=bad(i))
            call check_refused(options, 'htol = ', error)
            options = options_type(intol=bad(i))
            call check_refused(options, 'intol = ', error)
            options = options_type(start_tolerance=bad(i))
            call check_refused(options, 'start_tolerance = ', error)
        end do
        options = options_type(constraint_tolerance=0.0_wp)
        call check_refused(options, 'constraint_tolerance = ', error)
    end subroutine test_tolerances

    subroutine test_secant_limit(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options

        options%secant_limit = 1.0_wp
        call check_refused(options, 'secant_limit = ', error)
        options%secant_limit = ieee_value(1.0_wp, ieee_quiet_nan)
        call check_refused(options, 'secant_limit = ', error)
    end subroutine test_secant_limit

    subroutine test_max_steps(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options

        options%max_steps = 0
        call check_refused(options, 'max_steps = 0', error)
    end subroutine test_max_steps

    !> The check names the option and its value.
    subroutine check_refused(options, piece, error)
        type(options_type), intent(in) :: options
        character(len=*), intent(in) :: piece
        type(error_type), allocatable, intent(inout) :: error
        type(failure_type), allocatable :: failure

        if (allocated(error)) return
        call options%check(failure)
        call check_failure(error, failure, 'invalid_option', piece)
    end subroutine check_refused

    subroutine test_unset(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options
        type(failure_type), allocatable :: failure

        options%constraint_tolerance = 1.0e-9_wp
        options%btol = 1.0e-6_wp
        call options%check(failure)
        call check_no_failure(error, failure)
        call check_below(error, abs(options%position_tolerance() - 1.0e-11_wp), 1.0e-26_wp, 'utol, a hundredth')
        call check_below(error, abs(options%b_tolerance() - 1.0e-6_wp), 0.0_wp, 'btol')
        call check_below(error, abs(options%h_tolerance() - 1.0e-9_wp), 0.0_wp, 'htol')
    end subroutine test_unset

    !> Codes are part of the interface: names and numbers must not change.
    subroutine test_status_names(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=20), parameter :: names(0:14) = [character(len=20) :: 'ok', 'invalid_option', 'invalid_model', &
            'inconsistent_start', 'rank_deficient', 'singular_mass', 'callback_failed', 'not_evaluable', 'not_finite', &
            'position_diverged', 'chart_left', 'constraints_not_held', 'step_underflow', 'step_limit', 'output_failed']
        integer :: i

        do i = 0, 14
            if (status_name(-i) /= names(i)) call test_failed(error, 'status '//to_text(-i)//' is '//status_name(-i))
            if (allocated(error)) return
        end do
        call check_true(error, status_name(12345) == 'unknown', 'a foreign code is unknown')
    end subroutine test_status_names

    subroutine test_input_errors(error)
        type(error_type), allocatable, intent(out) :: error

        call check_true(error, is_input_error(status_invalid_option) .and. is_input_error(status_invalid_model) .and. &
            is_input_error(status_inconsistent_start), 'these are input errors')
        if (allocated(error)) return
        call check_true(error, .not. (is_input_error(0) .or. is_input_error(status_chart_left) .or. &
            is_input_error(status_step_limit) .or. is_input_error(status_output_failed) .or. is_input_error(12345)), &
            'these are no input errors')
    end subroutine test_input_errors

    subroutine test_messages(error)
        type(error_type), allocatable, intent(out) :: error
        type(failure_type), allocatable :: failure

        call set_error(failure, status_invalid_model, 'the horse is missing')
        call check_failure(error, failure, 'invalid_model', 'invalid_model: the horse is missing; ')
        call set_error(failure, status_invalid_model, 'the horse is missing', 'buy one')
        call check_failure(error, failure, 'invalid_model')
        call check_true(error, failure%message == 'invalid_model: the horse is missing; buy one', failure%message)
    end subroutine test_messages

    !> Differences for which continuing a run is refused.
    subroutine test_difference(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: one, other

        one%rtol_q = [1.0e-6_wp, 1.0e-7_wp]
        call check_true(error, one%first_difference(other) == 'rtol_q', 'a list and none differ')
        other%rtol_q = one%rtol_q
        call check_true(error, one%first_difference(other) == '', 'equal lists do not differ')
        other%rtol_q(2) = 1.0e-8_wp
        call check_true(error, one%first_difference(other) == 'rtol_q', 'lists with another number differ')
        other%rtol_q = one%rtol_q(:1)
        call check_true(error, one%first_difference(other) == 'rtol_q', 'lists of other lengths differ')
    end subroutine test_difference

    subroutine test_numbers(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=:), allocatable :: text
        real(wp) :: value

        call check_true(error, to_text(-42) == '-42', '-42 is written as -42')
        if (allocated(error)) return
        call check_true(error, index(trim(to_text(1.0e-9_wp)), ' ') == 0, to_text(1.0e-9_wp))
        if (allocated(error)) return
        text = to_text(-1.234567e-9_wp)
        read (text, *) value
        call check_below(error, abs(value/(-1.234567e-9_wp) - 1), 1.0e-6_wp, 'error of a number read back')
        call check_text(error, to_text(ieee_value(1.0_wp, ieee_quiet_nan)), 'NaN')
    end subroutine test_numbers
end module test_options
