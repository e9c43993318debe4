! SPDX-License-Identifier: MIT
!> Advice to the user after a failed run, which depends on the cause and on the changes that are possible; a mechanism, for
!> instance, has no procedures of the user.
module tandem_simulate_advice
    use tandem_model, only: model_type
    use tandem_options, only: options_type
    use tandem_simulate_stiffness, only: implicit_advice
    use tandem_status, only: status_chart_left, status_newton_failed, status_not_evaluable, status_not_finite, status_of, &
        status_position_diverged, status_rank_deficient, status_type
    use tandem_stepper, only: properties_type
    implicit none (type, external)
    private

    public :: advice_on_failure, advice_on_limit, advice_length
    public :: anywhere, before_steps, in_first_step, in_step, at_smallest_step

    !> Circumstances of a failure: anywhere between steps, before the first step, in the first step, in a later step, in a step of
    !> the smallest size.
    integer, parameter :: anywhere = 0, before_steps = 1, in_first_step = 2, in_step = 3, at_smallest_step = 4

    !> Texts have a fixed length, since a deferred one would be static memory (see `tandem_status`).
    integer, parameter :: advice_length = 280

    character(len=*), parameter :: jam = &
        'the constraints permit motion there (dead point, stop, or imposed motion out of range)'
    character(len=*), parameter :: procedures = ' (tandem check, verify_model)'

contains

    !> Advice for a failure with a given status.
    pure function advice_on_failure(stat, circumstance, model, options, method, names_row) result(advice)
        integer, intent(in) :: stat
        !> `anywhere`, `before_steps`, `in_first_step`, `in_step` or `at_smallest_step`.
        integer, intent(in) :: circumstance
        class(model_type), intent(in) :: model
        type(options_type), intent(in) :: options
        type(properties_type), intent(in) :: method
        !> True if the message names a constraint row.
        logical, intent(in) :: names_row
        character(len=advice_length) :: advice
        type(status_type) :: row

        select case (stat)
        case (status_rank_deficient)
            advice = on_rank_loss(circumstance, names_row)
        case (status_position_diverged, status_chart_left)
            advice = on_position_failure(circumstance, model, options, method)
        case (status_not_evaluable, status_not_finite)
            advice = on_undefined_value(circumstance, model, options, method)
        case (status_newton_failed)
            advice = 'take a smaller step'
            if (circumstance == at_smallest_step) advice = 'look for a singularity or a jump of a force there'
            if (.not. model%is_ready_made) advice = trim(advice)//'; check the derivatives of the model'//procedures
        case default
            row = status_of(stat)
            advice = row%advice
        end select
    end function advice_on_failure

    !> Advice for a run that has reached a limit on its steps or its work.
    pure function advice_on_limit(option, options, is_stiff) result(advice)
        !> Name of the option that sets the limit.
        character(len=*), intent(in) :: option
        type(options_type), intent(in) :: options
        !> True if stability limits the steps of an explicit method.
        logical, intent(in) :: is_stiff
        character(len=advice_length) :: advice

        advice = 'raise '//option//', or '//trim(merge('loosen the tolerances', 'take larger steps    ', options%is_adaptive()))
        if (is_stiff) advice = 'choose an implicit stepper ('//implicit_advice//'), since the model is stiff: stability limits '// &
            'the steps; or raise '//option
    end function advice_on_limit

    pure function on_rank_loss(circumstance, names_row) result(advice)
        integer, intent(in) :: circumstance
        logical, intent(in) :: names_row
        character(len=advice_length) :: advice

        if (circumstance == before_steps) then
            advice = 'start beside this configuration'
            if (names_row) advice = trim(advice)//', or remove one of these rows'
        else
            advice = 'end the run before this configuration, beyond which the motion is not determined'
            if (names_row) advice = trim(advice)//', or remove one of these rows if it is redundant'
            if (any(circumstance == [in_first_step, in_step])) advice = trim(advice)// &
                '; take a smaller step if the motion does not approach it'
        end if
    end function on_rank_loss

    pure function on_position_failure(circumstance, model, options, method) result(advice)
        integer, intent(in) :: circumstance
        class(model_type), intent(in) :: model
        type(options_type), intent(in) :: options
        type(properties_type), intent(in) :: method
        character(len=advice_length) :: advice

        select case (circumstance)
        case (before_steps)
            advice = 'correct the start'
        case (at_smallest_step)
            advice = 'check whether '//jam
            if (.not. model%is_ready_made) advice = trim(advice)//', or whether a procedure of the model is wrong'//procedures
        case default
            advice = 'take a smaller step'
            if (options%chart /= 'every_step') advice = trim(advice)//', or renew the chart more often (chart = "every_step")'
            if (.not. method%implicit) advice = trim(advice)//', or choose an implicit stepper ('//implicit_advice// &
                ') if the model is stiff'
            if (circumstance == in_first_step) advice = trim(advice)//'; if no step size helps, check whether '//jam
        end select
    end function on_position_failure

    pure function on_undefined_value(circumstance, model, options, method) result(advice)
        integer, intent(in) :: circumstance
        class(model_type), intent(in) :: model
        type(options_type), intent(in) :: options
        type(properties_type), intent(in) :: method
        character(len=advice_length) :: advice
        character(len=*), parameter :: mine = 'check the procedures of the model there', &
            ready_made = 'look for numbers, functions or laws that are undefined there'

        advice = mine
        if (model%is_ready_made) advice = ready_made
        if (all(circumstance /= [in_first_step, in_step])) return
        if (method%implicit .or. options%is_adaptive()) then
            advice = 'take a smaller step; if the failure persists, '//trim(advice)
        else
            advice = 'take a smaller step, or choose an implicit stepper ('//implicit_advice// &
                ') if the model is stiff; if the failure persists, '//trim(advice)
        end if
    end function on_undefined_value
end module tandem_simulate_advice
