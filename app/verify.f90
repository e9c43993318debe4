! SPDX-License-Identifier: MIT
!> tandem verify: reads all of a result file, and says whether it holds what was written.
module tandem_app_verify
    use tandem, only: error_type, to_text
    use tandem_app_arguments, only: arguments_type
    use tandem_app_help, only: help
    use tandem_app_messages, only: complain, done, input_wrong, run_failed, say
    use tandem_app_report, only: count_text, counted
    use tandem_io, only: finding_type, verify_result
    implicit none (type, external)
    private

    public :: verify_file

contains

    !> Verify a file. The exit code is 1 where it is damaged, 2 where it is no result or cannot be verified.
    subroutine verify_file(arguments, code)
        type(arguments_type), intent(inout) :: arguments
        !> Exit code.
        integer, intent(out) :: code
        type(finding_type) :: finding
        type(error_type), allocatable :: error
        character(len=:), allocatable :: status, events

        call arguments%parse([character(len=6) :: '--help'], .true., error)
        if (.not. allocated(error) .and. arguments%help) then
            call help(code)
            return
        end if
        if (.not. allocated(error)) call verify_result(arguments%scene, finding, status, error)
        if (allocated(error)) then
            call complain(error%message)
            code = input_wrong
        else if (finding%problem /= '') then
            call complain(arguments%scene//' is damaged: '//finding%problem)
            code = run_failed
        else if (.not. finding%has_checksums) then
            call complain('cannot verify '//arguments%scene//': all of it can be read, but it has no checksums, since an '// &
                'earlier program wrote it')
            code = input_wrong
        else
            events = ''
            if (finding%events > 0) events = ' and '//counted(finding%events, 'event')
            call say(arguments%scene//': '//counted(finding%rows, 'row')//events//' as they were written, in '// &
                to_text(finding%datasets)//' datasets; status "'//status//'"')
            if (finding%rows_behind > 0) call say('rows behind the last state that was saved, without checksums: '// &
                count_text(finding%rows_behind))
            code = done
        end if
    end subroutine verify_file
end module tandem_app_verify
