! SPDX-License-Identifier: MIT
!> tandem verify: reads a result file completely and checks its contents.
module tandem_cli_verify
    use tandem, only: error_type, to_text
    use tandem_cli_arguments, only: arguments_type
    use tandem_cli_messages, only: print_to_stderr, done, input_wrong, run_failed, say, signalled
    use tandem_cli_report, only: count_text, counted
    use tandem_io, only: finding_type, json_type, verify_result
    use, intrinsic :: iso_c_binding, only: c_int
    implicit none (type, external)
    private

    public :: verify_file

    interface
        !> Fork (child.c). Returns -1 in the child, which does the work; in the parent the exit code of the child, or 1000 plus the
        !> number of the signal that ended it.
        function c_fork_and_wait() result(outcome) bind(c, name='tandem_fork_and_wait')
            import :: c_int
            implicit none (type, external)
            integer(c_int) :: outcome
        end function c_fork_and_wait
    end interface

contains

    !> Verify a file in a child process, because HDF5 may crash on a damaged file. The exit code is 1 if the file is damaged, and 2
    !> if it is not a result or cannot be verified.
    subroutine verify_file(arguments, code)
        type(arguments_type), intent(in) :: arguments
        !> Exit code.
        integer, intent(out) :: code
        !> Signals by which a user ends the program: SIGHUP, SIGINT, SIGQUIT, SIGKILL, SIGTERM.
        integer, parameter :: killed = 1000, from_users(5) = [1, 2, 3, 9, 15]

        code = int(c_fork_and_wait())
        if (code < 0) then
            call read_file(arguments, code)
        else if (code > killed) then
            code = code - killed
            if (any(code == from_users)) then
                code = signalled + code
                return
            end if
            call print_to_stderr(arguments%scene//' is damaged: HDF5 crashes when it reads the file (signal '//to_text(code)//')')
            code = run_failed
        end if
    end subroutine verify_file

    !> Read a file and print the finding.
    subroutine read_file(arguments, code)
        type(arguments_type), intent(in) :: arguments
        !> Exit code.
        integer, intent(out) :: code
        type(finding_type) :: finding
        type(error_type), allocatable :: error
        character(len=:), allocatable :: status, events

        call verify_result(arguments%scene, finding, status, error)
        if (allocated(error)) then
            call print_to_stderr(error%message)
            code = input_wrong
        else if (finding%problem /= '') then
            call print_to_stderr(arguments%scene//' is damaged: '//finding%problem)
            code = run_failed
        else if (.not. finding%has_checksums) then
            call print_to_stderr('cannot verify '//arguments%scene//': it is readable, but has no checksums, since an '// &
                'earlier program wrote it')
            code = input_wrong
        else
            if (arguments%json) then
                call print_json(arguments%scene, finding, status)
                code = done
                return
            end if
            events = ''
            if (finding%events > 0) events = ' and '//counted(finding%events, 'event')
            call say(arguments%scene//': '//counted(finding%rows, 'row')//events//' as they were written, in '// &
                to_text(finding%datasets)//' datasets; status "'//status//'"')
            if (finding%rows_without_checksums > 0) call say('rows after the last saved state, without checksums: '// &
                count_text(finding%rows_without_checksums))
            code = done
        end if
    end subroutine read_file

    !> Print the finding as one JSON object.
    subroutine print_json(path, finding, status)
        character(len=*), intent(in) :: path, status
        type(finding_type), intent(in) :: finding
        type(json_type) :: json

        call json%begin_object()
        call json%add('file', path)
        call json%add('status', status)
        call json%add('rows', finding%rows)
        call json%add('events', finding%events)
        call json%add('datasets', finding%datasets)
        call json%add('rows_behind', finding%rows_without_checksums)
        call json%end_object()
        call say(json%text)
    end subroutine print_json
end module tandem_cli_verify
