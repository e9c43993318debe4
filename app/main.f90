! SPDX-License-Identifier: MIT
!> tandem on the command line: finds the subcommand and leaves the rest to it.
!> Exit codes: 0 done, 1 the run failed, 2 the input was wrong, 128 + n signal n has ended the run.
program tandem_program
    use tandem_app_arguments, only: arguments_type, read_arguments
    use tandem_app_check, only: check
    use tandem_app_help, only: help, refuse_command
    use tandem_app_list, only: list
    use tandem_app_messages, only: done, finish_output, say
    use tandem_app_resume, only: resume
    use tandem_app_run, only: run
    use tandem_app_show, only: show
    use tandem_app_statuses, only: statuses
    use tandem_app_study_precision, only: study_precision
    use tandem_app_study_stability, only: study_stability
    use tandem_app_study_tables, only: study_tables
    use tandem_app_verify, only: verify_file
    use tandem_io, only: tandem_version
    implicit none (type, external)
    type(arguments_type) :: arguments
    integer :: code

    arguments = read_arguments()
    select case (arguments%command)
    case ('', 'help', '--help', '-h', 'study --help', 'study -h')
        call help(code)
    case ('--version', 'version')
        call say('tandem '//tandem_version)
        code = done
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
    case ('resume')
        call resume(arguments, code)
    case ('verify')
        call verify_file(arguments, code)
    case ('study precision')
        call study_precision(arguments, code)
    case ('study stability')
        call study_stability(arguments, code)
    case ('study tables')
        call study_tables(arguments, code)
    case default
        call refuse_command(arguments%command, code)
    end select
    call finish_output(code)
    stop code, quiet=.true.
end program tandem_program
