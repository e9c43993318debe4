! SPDX-License-Identifier: MIT
!> Table of all status codes: name, code, meaning, and remedy. Zero is success; every failure is negative.
!> Codes are part of the interface and are never reused.
module tandem_status
    implicit none (type, external)
    private

    public :: status_type, status_of, status_name, is_input_error
    public :: status_ok, status_invalid_option, status_invalid_model, status_inconsistent_start
    public :: status_rank_deficient, status_singular_mass, status_callback_failed, status_not_evaluable
    public :: status_not_finite, status_position_diverged, status_chart_left, status_constraints_not_held
    public :: status_step_underflow, status_step_limit, status_output_failed, status_newton_failed
    public :: status_inconsistent_rows, status_event_limit
    public :: status_work_limit, status_invalid_checkpoint, status_interrupted, status_no_equilibrium, last_status

    !> Codes; the table below lists their meanings and remedies.
    integer, parameter :: status_ok = 0
    integer, parameter :: status_invalid_option = -1
    integer, parameter :: status_invalid_model = -2
    integer, parameter :: status_inconsistent_start = -3
    integer, parameter :: status_rank_deficient = -4
    integer, parameter :: status_singular_mass = -5
    integer, parameter :: status_callback_failed = -6
    integer, parameter :: status_not_evaluable = -7
    integer, parameter :: status_not_finite = -8
    integer, parameter :: status_position_diverged = -9
    integer, parameter :: status_chart_left = -10
    integer, parameter :: status_constraints_not_held = -11
    integer, parameter :: status_step_underflow = -12
    integer, parameter :: status_step_limit = -13
    integer, parameter :: status_output_failed = -14
    integer, parameter :: status_newton_failed = -15
    integer, parameter :: status_inconsistent_rows = -16
    integer, parameter :: status_event_limit = -17
    integer, parameter :: status_work_limit = -18
    integer, parameter :: status_invalid_checkpoint = -19
    integer, parameter :: status_interrupted = -20
    integer, parameter :: status_no_equilibrium = -21

    !> The last code; codes range from `status_ok` down to it.
    integer, parameter :: last_status = status_no_equilibrium

    !> One row of the table.
    type :: status_type
        !> The code that procedures return.
        integer :: code
        !> Name in reports and files.
        character(len=24) :: name
        !> True if the input is wrong, before any step was taken (exit code 2 on the command line).
        logical :: input
        !> Meaning.
        character(len=96) :: meaning
        !> Remedy.
        character(len=128) :: advice
    end type status_type

    type(status_type), parameter :: table(1 - last_status) = [ &
        status_type(status_ok, 'ok', .false., 'success', 'none required'), &
        status_type(status_invalid_option, 'invalid_option', .true., &
            'invalid option value', 'correct the option named in the message'), &
        status_type(status_invalid_model, 'invalid_model', .true., &
            'the model lacks a procedure, or has invalid sizes or an invalid mass matrix', &
            'correct the model as the message states'), status_type(status_inconsistent_start, 'inconsistent_start', .true., &
            'the start violates the constraints', &
            'correct the position or velocity named in the message, or assemble the start'), &
        status_type(status_rank_deficient, 'rank_deficient', .false., &
            'constraint rows are linearly dependent', &
            'remove the redundant row, or end the run before the configuration where rows become dependent'), &
        status_type(status_singular_mass, 'singular_mass', .false., &
            'the mass matrix is not positive definite on the null space of the constraints', &
            'give every free direction a mass, and check the sign and symmetry of M'), &
        status_type(status_callback_failed, 'callback_failed', .false., &
            'a model procedure requested a stop', 'check why the procedure named in the message returned a negative status'), &
        status_type(status_not_evaluable, 'not_evaluable', .false., &
            'the model could not be evaluated at a point of the step', 'take a smaller step'), &
        status_type(status_not_finite, 'not_finite', .false., &
            'the model or the step produced a NaN or an infinity', &
            'take a smaller step; if the failure persists, look for an undefined term there'), &
        status_type(status_position_diverged, 'position_diverged', .false., &
            'the iteration for the position constraints did not converge', &
            'take a smaller step; if that does not help, check whether the constraints permit motion there'), &
        status_type(status_chart_left, 'chart_left', .false., &
            'the step left the domain of its chart', &
            'take a smaller step; if that does not help, check whether the constraints permit motion there'), &
        status_type(status_constraints_not_held, 'constraints_not_held', .false., &
            'a constraint error exceeds its tolerance at an accepted step', &
            'increase constraint_tolerance, or remove nearly redundant constraints'), &
        status_type(status_step_underflow, 'step_underflow', .false., &
            'the step is too small to change the time', 'take a larger step or a shorter time interval'), &
        status_type(status_step_limit, 'step_limit', .false., &
            'max_steps reached before the end time', 'raise max_steps, or loosen the tolerances'), &
        status_type(status_output_failed, 'output_failed', .false., &
            'the results could not be written', 'check the disk and the path of the output file'), &
        status_type(status_newton_failed, 'newton_failed', .false., &
            'the iteration for an implicit stage did not converge', &
            'take a smaller step; check the derivatives of a user-supplied model'), &
        status_type(status_inconsistent_rows, 'inconsistent_rows', .true., &
            'constraint rows are linearly dependent and contradict each other', &
            'remove or correct one of the rows named in the message'), &
        status_type(status_event_limit, 'event_limit', .false., &
            'endless sequence of events', &
            'make the action of the event move the state away from its zero, or raise max_events'), &
        status_type(status_work_limit, 'work_limit', .false., &
            'max_evaluations or max_seconds reached before the end time', &
            'raise the limit named in the message, loosen the tolerances, or choose another stepper'), &
        status_type(status_invalid_checkpoint, 'invalid_checkpoint', .true., &
            'the run cannot be resumed from this checkpoint', 'restart the run'), &
        status_type(status_interrupted, 'interrupted', .false., &
            'the run was interrupted', 'continue with tandem resume, or run again'), &
        status_type(status_no_equilibrium, 'no_equilibrium', .false., &
            'no equilibrium or steady motion was found near the start', &
            'start nearer to one, or check whether one exists')]

contains

    !> Row of a code in the table; the row of `status_ok` with name `unknown` for an undefined code.
    pure function status_of(code) result(row)
        !> A status code.
        integer, intent(in) :: code
        type(status_type) :: row
        integer :: i

        do i = 1, size(table)
            if (table(i)%code == code) then
                row = table(i)
                return
            end if
        end do
        row = status_type(code, 'unknown', .false., 'unknown code', 'report it')
    end function status_of

    !> Length of the name of a code. Function results of type text have a known length, because gfortran stores a deferred length in
    !> static memory, which threads would share.
    pure integer function name_length(code)
        integer, intent(in) :: code
        type(status_type) :: row

        row = status_of(code)
        name_length = len_trim(row%name)
    end function name_length

    !> Name of a code.
    pure function status_name(code) result(name)
        !> A status code.
        integer, intent(in) :: code
        character(len=name_length(code)) :: name
        type(status_type) :: row

        row = status_of(code)
        name = trim(row%name)
    end function status_name

    !> True if a code means that the input was wrong.
    pure logical function is_input_error(code)
        !> A status code.
        integer, intent(in) :: code
        type(status_type) :: row

        row = status_of(code)
        is_input_error = row%input
    end function is_input_error
end module tandem_status
