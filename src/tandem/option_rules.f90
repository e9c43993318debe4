! SPDX-License-Identifier: MIT
!> Relations between options: options without effect in combination with others, and defaults that depend on others.
module tandem_option_rules
    use tandem_error, only: error_type, set_error
    use tandem_kinds, only: wp
    use tandem_options, only: chart_policies, default_rtol, default_step, explicit_steppers, options_type, projections, &
        refresh_modes
    use tandem_status, only: status_invalid_option
    implicit none (type, external)
    private

    public :: conflict_type, find_conflict, complete_options, change_stepper, projects_stages

    !> An option without effect.
    type :: conflict_type
        !> Name; blank if every option has an effect.
        character(len=20) :: name = ''
        !> Reason and remedy.
        character(len=128) :: problem = '', remedy = ''
    end type conflict_type

contains

    !> Find the first option without effect in combination with the others.
    subroutine find_conflict(options, conflict, has_estimate)
        type(options_type), intent(in) :: options
        type(conflict_type), intent(out) :: conflict
        !> True if the stepper, which is not one of `stepper_choices`, has an error estimate.
        logical, intent(in), optional :: has_estimate
        type(options_type) :: default

        if (options%step > 0.0_wp .and. options%has_tolerance()) call note('step', .true., &
            'is given beside a tolerance, but steps have a fixed size or follow an error estimate', 'remove step or rtol')
        if (has_fixed_steps(options, has_estimate)) then
            call note_without_control('atol', options%atol > 0.0_wp)
            call note_without_control('atol_q', allocated(options%atol_q))
            call note_without_control('atol_qd', allocated(options%atol_qd))
            call note_without_control('first_step', options%first_step > 0.0_wp)
            call note_without_control('max_step', options%max_step > 0.0_wp)
        end if
        call note_without('chart', options%chart, 'paper', 'v_limit', options%v_limit > 0.0_wp)
        call note_without('chart', options%chart, 'paper', 'w_limit', options%w_limit > 0.0_wp)
        call note_without('chart', options%chart, 'paper', 'condition_limit', options%condition_limit > 0.0_wp)
        call note_without('chart', options%chart, 'paper', 'iteration_limit', options%iteration_limit > 0)
        call note_without('chart', options%chart, 'adaptive', 'secant_limit', &
            abs(options%secant_limit - default%secant_limit) > 0.0_wp)
        call note_without('refresh', options%refresh, 'refine', 'btol', options%btol > 0.0_wp)
        call note_without('refresh', options%refresh, 'refine', 'htol', options%htol > 0.0_wp)
        call note('intol', options%intol > 0.0_wp .and. any(explicit_steppers == options%stepper), &
            'has no effect, since the stages of '//trim(options%stepper)//' are explicit', &
            'remove it, or choose an implicit stepper')

    contains

        subroutine note(name, is_useless, problem, remedy)
            character(len=*), intent(in) :: name, problem, remedy
            logical, intent(in) :: is_useless

            if (is_useless .and. conflict%name == '') conflict = conflict_type(name, problem, remedy)
        end subroutine note

        !> Note an option of error control.
        subroutine note_without_control(name, is_given)
            character(len=*), intent(in) :: name
            logical, intent(in) :: is_given

            if (options%step > 0.0_wp) then
                call note(name, is_given, 'has no effect on fixed steps', 'remove it, or give rtol instead of step')
            else
                call note(name, is_given, 'has no effect, since '//trim(options%stepper)//' has no error estimate', &
                    'remove it, or choose another stepper')
            end if
        end subroutine note_without_control

        !> Note an option that requires a word which is not given.
        subroutine note_without(option, word, needed, name, is_given)
            character(len=*), intent(in) :: option, word, needed, name
            logical, intent(in) :: is_given

            call note(name, is_given .and. word /= needed, 'has no effect with '//option//' = "'//trim(word)//'"', &
                'remove it, or set '//option//' = "'//needed//'"')
        end subroutine note_without
    end subroutine find_conflict

    !> Refuse options without effect, and set the defaults that depend on others: `rtol` or `step`, and rk4 for `auto` with a fixed
    !> step.
    subroutine complete_options(options, error, has_estimate)
        type(options_type), intent(inout) :: options
        type(error_type), allocatable, intent(out) :: error
        !> True if the stepper, which is not one of `stepper_choices`, has an error estimate.
        logical, intent(in), optional :: has_estimate
        type(conflict_type) :: conflict

        call find_conflict(options, conflict, has_estimate)
        if (conflict%name /= '') then
            call set_error(error, status_invalid_option, trim(conflict%name)//' '//trim(conflict%problem), trim(conflict%remedy))
        else if (has_fixed_steps(options, has_estimate)) then
            if (.not. options%step > 0.0_wp) options%step = default_step
            if (options%stepper == 'auto') options%stepper = 'rk4'
        else if (.not. options%has_tolerance()) then
            options%rtol = default_rtol
        end if
    end subroutine complete_options

    !> Set the stepper, with a fixed step or one tolerance, and reset options that then have no effect.
    pure subroutine change_stepper(options, stepper, step, rtol, chart)
        type(options_type), intent(inout) :: options
        character(len=*), intent(in) :: stepper
        !> One of these must be present.
        real(wp), intent(in), optional :: step, rtol
        !> One of `chart_policies`, instead of that in the options.
        character(len=*), intent(in), optional :: chart
        type(options_type) :: default

        options%stepper = stepper
        options%step = default%step
        if (present(step)) options%step = step
        options%rtol = default%rtol
        if (present(rtol)) options%rtol = rtol
        options%atol = default%atol
        if (allocated(options%rtol_q)) deallocate (options%rtol_q)
        if (allocated(options%rtol_qd)) deallocate (options%rtol_qd)
        if (allocated(options%atol_q)) deallocate (options%atol_q)
        if (allocated(options%atol_qd)) deallocate (options%atol_qd)
        if (present(chart)) options%chart = chart
        if (has_fixed_steps(options)) then
            options%first_step = default%first_step
            options%max_step = default%max_step
        end if
        if (options%chart /= 'paper') then
            options%v_limit = default%v_limit
            options%w_limit = default%w_limit
            options%condition_limit = default%condition_limit
            options%iteration_limit = default%iteration_limit
        end if
        if (options%chart /= 'adaptive') options%secant_limit = default%secant_limit
        if (any(explicit_steppers == options%stepper)) options%intol = default%intol
    end subroutine change_stepper

    !> True if explicit steps satisfy the constraints at every stage. By default they do so with a fixed size, as in the paper, and
    !> with charts that are kept or refined; under error control the end of a step suffices (Hairer, Wanner II, section VII.2: the
    !> order is preserved).
    pure logical function projects_stages(options)
        !> Completed by `complete_options`.
        type(options_type), intent(in) :: options

        if (options%projection == projections(1)) then
            projects_stages = .not. options%is_adaptive() .or. options%chart /= chart_policies(1) .or. &
                options%refresh /= refresh_modes(1)
        else
            projects_stages = options%projection == projections(2)
        end if
    end function projects_stages

    !> True if steps have a fixed size, which may be the default `default_step`.
    pure logical function has_fixed_steps(options, has_estimate)
        type(options_type), intent(in) :: options
        logical, intent(in), optional :: has_estimate

        has_fixed_steps = .not. options%is_adaptive()
        if (present(has_estimate)) has_fixed_steps = &
            .not. (options%has_tolerance() .or. (has_estimate .and. .not. options%step > 0.0_wp))
    end function has_fixed_steps
end module tandem_option_rules
