! SPDX-License-Identifier: MIT
!> Output of the table of a study as one JSON object `{"rows": [...]}`. Each row is an object without empty cells.
module tandem_cli_study_json
    use tandem_cli_messages, only: say
    use tandem_io, only: count_column, json_type, real_column, table_type
    implicit none (type, external)
    private

    public :: print_table_json

contains

    !> Print the object.
    subroutine print_table_json(table, scene)
        type(table_type), intent(in) :: table
        !> Scene of the study; absent if there are several.
        character(len=*), intent(in), optional :: scene
        type(json_type) :: json
        integer :: i, row

        call json%begin_object()
        if (present(scene)) call json%add('scene', scene)
        call json%begin_array('rows')
        do row = 1, table%rows()
            call json%begin_object()
            do i = 1, size(table%columns)
                associate (column => table%columns(i))
                    if (table%text_at(row, trim(column%name)) == '') cycle
                    select case (column%kind)
                    case (count_column)
                        call json%add(trim(column%name), table%count_at(row, trim(column%name)))
                    case (real_column)
                        call json%add(trim(column%name), table%real_at(row, trim(column%name)))
                    case default
                        call json%add(trim(column%name), table%text_at(row, trim(column%name)))
                    end select
                end associate
            end do
            call json%end_object()
        end do
        call json%end_array()
        call json%end_object()
        call say(json%text)
    end subroutine print_table_json
end module tandem_cli_study_json
