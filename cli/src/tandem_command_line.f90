! SPDX-License-Identifier: MIT
!> The command line as a library. A program that calls `command_line` with its own models can run, check, study and resume scenes
!> with these models as `tandem` does with the shipped ones, which are included. See example/dependent.
module tandem_command_line
    use tandem, only: error_type
    use tandem_cli_arguments, only: arguments_type, read_arguments
    use tandem_cli_check, only: check
    use tandem_cli_commands, only: find_command
    use tandem_cli_completion, only: completion
    use tandem_cli_equilibrium, only: equilibrium
    use tandem_cli_help, only: help, print_command_help, refuse_command
    use tandem_cli_linearise, only: linearise
    use tandem_cli_list, only: list
    use tandem_cli_messages, only: print_to_stderr, done, finish_output, input_wrong, say
    use tandem_cli_pictures, only: call_package
    use tandem_cli_resume, only: resume
    use tandem_cli_run, only: run
    use tandem_cli_show, only: show
    use tandem_cli_statuses, only: statuses
    use tandem_cli_study_modes, only: study_modes
    use tandem_cli_study_precision, only: study_precision
    use tandem_cli_study_stability, only: study_stability
    use tandem_cli_study_tables, only: study_tables
    use tandem_cli_sweep, only: sweep
    use tandem_cli_verify, only: verify_file
    use tandem_io, only: anything, build_text, not_negative, positive, reader_type, scene_model_type, shipped_models, tandem_version
    implicit none (type, external)
    private

    public :: command_line, scene_model_type
    ! Also needed by a procedure that reads a model from a scene.
    public :: reader_type, anything, positive, not_negative

    interface
        !> See blas_threads.c.
        subroutine use_one_blas_thread() bind(c, name='tandem_use_one_blas_thread')
            implicit none (type, external)
        end subroutine use_one_blas_thread
    end interface

contains

    !> Execute the command line: find the subcommand and pass the remaining arguments to it.
    subroutine command_line(code, models)
        !> Exit code: 0 success, 1 failed run, 2 invalid input, 128 + n end by signal n.
        integer, intent(out) :: code
        !> Additional models, each with the procedure that reads it from a scene. They take precedence over shipped models with the
        !> same name.
        type(scene_model_type), intent(in), optional :: models(:)
        type(arguments_type) :: arguments
        type(error_type), allocatable :: error

        call use_one_blas_thread()
        if (present(models)) then
            arguments = read_arguments([models, shipped_models()])
        else
            arguments = read_arguments(shipped_models())
        end if
        if (find_command(arguments%command) == 0) then
            call refuse_command(arguments%command, code)
            return
        end if
        call arguments%parse(error)
        if (allocated(error)) then
            call print_to_stderr(error%message)
            code = input_wrong
        else if (arguments%help) then
            call print_command_help(arguments%command)
            code = done
        else
            call carry_out(arguments, code)
        end if
        call finish_output(code)
    end subroutine command_line

    !> Execute the subcommand.
    subroutine carry_out(arguments, code)
        type(arguments_type), intent(in) :: arguments
        integer, intent(out) :: code

        select case (arguments%command)
        case ('list')
            call list(arguments, code)
        case ('show')
            call show(arguments, code)
        case ('check')
            call check(arguments, code)
        case ('statuses')
            call statuses(arguments, code)
        case ('run')
            call run(arguments, code)
        case ('equilibrium')
            call equilibrium(arguments, code)
        case ('linearise')
            call linearise(arguments, code)
        case ('resume')
            call resume(arguments, code)
        case ('verify')
            call verify_file(arguments, code)
        case ('plot', 'view', 'import')
            call call_package(code)
        case ('study precision')
            call study_precision(arguments, code)
        case ('study stability')
            call study_stability(arguments, code)
        case ('study modes')
            call study_modes(arguments, code)
        case ('study tables')
            call study_tables(arguments, code)
        case ('sweep')
            call sweep(arguments, code)
        case ('completion')
            call completion(arguments, code)
        case ('version')
            call say('tandem '//tandem_version)
            call say(trim(build_text()))
            code = done
        case default
            call help(arguments, code)
        end select
    end subroutine carry_out
end module tandem_command_line
