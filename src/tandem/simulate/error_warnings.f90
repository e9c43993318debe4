! SPDX-License-Identifier: MIT
!> Warnings about the result of a complete run. No other module decides when errors are reported to the user.
!>
!> The result of a run with an error estimate and without warnings is accurate to `allowed_error`. This is twice the warning limit,
!> since estimates are accurate to a factor of two (theory, section 20).
module tandem_simulate_error_warnings
    use tandem_error, only: error_type, to_text
    use tandem_kinds, only: wp
    use tandem_options, only: options_type
    use tandem_simulate_global_error, only: global_error_type
    use tandem_simulate_statistics, only: statistics_type
    use tandem_simulate_warning, only: add_warning, dense_limit, large, times, warning_limit, warning_type
    use tandem_status, only: status_interrupted, status_invalid_option
    implicit none (type, external)
    private

    public :: find_error_warnings, allowed_error, short_run

    !> Runs with less processor time (s) are short enough to be repeated for an error estimate. Wall time would make warnings depend
    !> on the load of the machine.
    real(wp), parameter :: short_run = 2.0_wp
    !> Steps over singular configurations cause an error if one of them has at least this part of it.
    real(wp), parameter :: of_crossings = 0.1_wp

contains

    !> List the warnings; none for a good result.
    subroutine find_error_warnings(options, statistics, warnings, global_error, failure)
        !> Options and statistics of the run.
        type(options_type), intent(in) :: options
        type(statistics_type), intent(in) :: statistics
        type(warning_type), allocatable, intent(out) :: warnings(:)
        !> Error of the whole run, if requested, and the reason if it could not be estimated.
        class(global_error_type), intent(in), optional :: global_error
        type(error_type), allocatable, intent(in), optional :: failure
        character(len=*), parameter :: contradicted = ', since the model contradicts itself'
        !> For ready-made models, an error that is caused by the sum of the errors of many steps or by amplification is not a reason
        !> for a warning below this fraction of the state; the report states it.
        real(wp), parameter :: negligible = 1.0e-7_wp
        character(len=:), allocatable :: advice, cause, suspect, jump
        real(wp) :: limit, tolerance, allowed_gap
        logical :: is_contradicted

        allocate (warnings(0))
        tolerance = options%relative_tolerance()
        advice = ': take smaller steps'
        if (options%is_adaptive()) advice = ': tighten rtol'
        suspect = ''
        jump = 'check whether an imposed velocity jumps there; otherwise '
        if (.not. statistics%has_ready_made_model) then
            suspect = ', or check whether a procedure of the model is wrong (tandem check, verify_model)'
            jump = 'where the velocity constraints jump, give the model a breakpoint with nu_jumps; otherwise '
        end if
        ! List first what may cause the others.
        is_contradicted = statistics%contradiction /= ''
        if (is_contradicted) call add_warning(warnings, trim(statistics%contradiction))
        if (statistics%local_error_sum > large) call add_warning(warnings, 'the local errors of the steps add up to '// &
            two_digits(statistics%local_error_sum)//' of the state'//advice)
        if (present(failure)) then
            if (is_reason(failure, global_error)) call add_warning(warnings, &
                'a second, more accurate run has failed, so this one may be unreliable'//advice)
        end if
        limit = warning_limit(options)
        ! Errors of driven velocities within the tolerance are not jumps, however loose the tolerance is.
        allowed_gap = limit
        if (options%is_adaptive()) allowed_gap = times*tolerance
        if (statistics%velocity_gap > allowed_gap) then
            cause = ': '//jump//advice(3:)//suspect
            if (is_contradicted) cause = contradicted
            call add_warning(warnings, 'the velocity changes by '//two_digits(statistics%velocity_gap)// &
                ' of itself without an acceleration in the step to t = '//to_text(statistics%t_gap)//cause)
        end if
        if (max(statistics%dense_error_q, statistics%dense_error_qd) > allowed_between(options, statistics, global_error)) then
            cause = advice
            if (options%is_adaptive()) cause = cause//' or set max_step'
            call add_warning(warnings, 'between steps, at output times, positions are wrong by up to '// &
                two_digits(statistics%dense_error_q)//' and velocities by up to '//two_digits(statistics%dense_error_qd)// &
                ' of the state'//cause)
        end if
        if (.not. present(global_error)) return
        if (.not. global_error%is_known) return
        associate (largest => global_error%largest)
            if (statistics%has_ready_made_model .and. largest <= negligible) return
            cause = advice
            ! Local errors are root mean squares: the largest of 2 n errors is below sqrt(2 n) times the root mean square.
            if (statistics%local_error_steps > 0 .and. &
                largest > sqrt(2.0_wp*global_error%n)*statistics%local_error_sum) then
                cause = ', since the motion amplifies the errors of steps'//advice//suspect
            else if (statistics%local_error_steps > 0) then
                cause = ', the accumulated errors of its steps'//advice
            end if
            if (statistics%crossing_error > of_crossings*largest) cause = &
                ', due to the singular configurations that the run passes: another rtol passes them at other distances'
            if (is_contradicted) cause = contradicted
            if (options%is_adaptive() .and. largest > times*tolerance) then
                call add_warning(warnings, 'the error reaches '//two_digits(largest/tolerance)//' times the tolerance'//cause)
            else if (largest > large) then
                call add_warning(warnings, 'the error reaches '//two_digits(largest)//' of the state'//cause)
            end if
        end associate
    end subroutine find_error_warnings

    !> Largest error of the motion between steps without a warning: ten times the tolerance, or with fixed steps the warning limit,
    !> but at least the error of the steps.
    pure real(wp) function allowed_between(options, statistics, global_error)
        type(options_type), intent(in) :: options
        type(statistics_type), intent(in) :: statistics
        class(global_error_type), intent(in), optional :: global_error

        allowed_between = large
        if (options%is_adaptive()) allowed_between = dense_limit*options%relative_tolerance()
        allowed_between = max(allowed_between, statistics%local_error_sum)
        if (.not. present(global_error)) return
        if (global_error%is_known) allowed_between = max(allowed_between, global_error%largest)
    end function allowed_between

    !> True if the failure of a second run is a reason for a warning about the first run. Events that prevent the comparison, a stop
    !> by the user and a time limit are no reasons.
    pure logical function is_reason(failure, global_error)
        type(error_type), allocatable, intent(in) :: failure
        class(global_error_type), intent(in), optional :: global_error

        is_reason = .false.
        if (.not. allocated(failure)) return
        is_reason = all(failure%stat /= [status_invalid_option, status_interrupted])
        if (present(global_error)) is_reason = is_reason .and. .not. global_error%is_out_of_time
    end function is_reason

    !> Largest error of a run, relative to scale + |y|, without a warning if an estimate was made.
    pure real(wp) function allowed_error(options)
        type(options_type), intent(in) :: options

        allowed_error = 2*warning_limit(options)
    end function allowed_error

    !> A positive number with two digits, such as 1.3e-7, padded with blanks.
    pure function two_digits_padded(value) result(text)
        real(wp), intent(in) :: value
        character(len=16) :: text, buffer
        integer :: exponent, point

        if (value >= 1.0_wp .and. value < 1.0e4_wp) then
            write (text, '(i0)') nint(value)
            return
        end if
        write (buffer, '(es9.1e3)') value
        point = index(buffer, 'E')
        if (point == 0) then
            text = adjustl(buffer)
            return
        end if
        read (buffer(point + 1:), *) exponent
        write (text, '(2a, i0)') trim(adjustl(buffer(:point - 1))), 'e', exponent
    end function two_digits_padded

    !> Length of a number with two digits (a deferred length would be static memory, see `tandem_status`).
    pure integer function two_digits_length(value)
        real(wp), intent(in) :: value

        two_digits_length = len_trim(two_digits_padded(value))
    end function two_digits_length

    !> A positive number with two digits.
    pure function two_digits(value) result(text)
        real(wp), intent(in) :: value
        character(len=two_digits_length(value)) :: text

        text = two_digits_padded(value)
    end function two_digits
end module tandem_simulate_error_warnings
