! SPDX-License-Identifier: MIT
!> tandem statuses: every outcome of a run, from the library's table, as the table of doc/statuses.md.
module tandem_app_statuses
    use tandem, only: error_type, to_text
    use tandem_app_arguments, only: arguments_type
    use tandem_app_help, only: help
    use tandem_app_messages, only: complain, done, input_wrong, say
    use tandem_status, only: last_status, status_of, status_ok, status_type
    implicit none (type, external)
    private

    public :: statuses

contains

    !> Print the table.
    subroutine statuses(arguments, code)
        type(arguments_type), intent(inout) :: arguments
        !> Exit code.
        integer, intent(out) :: code
        type(error_type), allocatable :: error
        type(status_type) :: row
        integer :: stat

        call arguments%parse([character(len=6) :: '--help'], .false., error)
        if (allocated(error)) then
            call complain(error%message)
            code = input_wrong
            return
        end if
        code = done
        if (arguments%help) then
            call help(code)
            return
        end if
        call say('| name | code | meaning | what to do |')
        call say('|---|---|---|---|')
        do stat = status_ok, last_status, -1
            row = status_of(stat)
            call say('| `'//trim(row%name)//'` | '//to_text(stat)//' | '//trim(row%meaning)//' | '// &
                trim(row%advice)//' |')
        end do
    end subroutine statuses
end module tandem_app_statuses
