! SPDX-License-Identifier: MIT
!> tandem statuses: all status codes of a run, from the table of the library, as in doc/statuses.md.
module tandem_cli_statuses
    use tandem, only: to_text
    use tandem_cli_arguments, only: arguments_type
    use tandem_cli_messages, only: done, say
    use tandem_io, only: json_type
    use tandem_status, only: last_status, status_of, status_ok, status_type
    implicit none (type, external)
    private

    public :: statuses

contains

    !> Print the table.
    subroutine statuses(arguments, code)
        type(arguments_type), intent(in) :: arguments
        !> Exit code.
        integer, intent(out) :: code
        type(status_type) :: row
        integer :: stat

        code = done
        if (arguments%json) then
            call print_json()
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

    !> Print the table as one JSON object.
    subroutine print_json()
        type(json_type) :: json
        type(status_type) :: row
        integer :: stat

        call json%begin_object()
        call json%begin_array('statuses')
        do stat = status_ok, last_status, -1
            row = status_of(stat)
            call json%begin_object()
            call json%add('name', row%name)
            call json%add('code', stat)
            call json%add('meaning', row%meaning)
            call json%add('advice', row%advice)
            call json%end_object()
        end do
        call json%end_array()
        call json%end_object()
        call say(json%text)
    end subroutine print_json
end module tandem_cli_statuses
