! SPDX-License-Identifier: MIT
!> Positions of the tables of a scene in its sources: the file, and the settings of the command line.
!>
!> A table that may come several times, such as [[event]], is an array in the file. A setting gives all of them anew,
!> `event=[{...}, {...}]`, or keys of one, by its number: `event.2.value=0.5`.
module tandem_io_scene_tables
    use tandem, only: error_type
    use tandem_io_scene_source, only: set_input_error, source_type
    use tandem_io_scene_text, only: to_toml
    use tomlf, only: len, toml_array, toml_key, toml_table, toml_value
    implicit none (type, external)
    private

    public :: table_of, first_source, count_elements

contains

    !> A table of a source, or null.
    function table_of(source, name, element) result(table)
        type(source_type), intent(inout), target :: source
        character(len=*), intent(in) :: name
        !> Its number among the tables of that name, 0 for a single table.
        integer, intent(in) :: element
        type(toml_table), pointer :: table
        class(toml_value), pointer :: found, member

        nullify (table, member)
        call source%root%get(trim(name), found)
        if (.not. associated(found)) return
        select type (found)
        type is (toml_table)
            if (element == 0) then
                table => found
            else
                call found%get(to_toml(element), member)
            end if
        type is (toml_array)
            if (element >= 1 .and. element <= len(found)) call found%get(element, member)
        end select
        if (.not. associated(member)) return
        select type (member)
        type is (toml_table)
            table => member
        end select
    end function table_of

    !> The first source that contributes to tables of a name: the last one that gives all of them, otherwise the file.
    integer function first_source(sources, name)
        type(source_type), intent(inout), target :: sources(0:)
        character(len=*), intent(in) :: name
        class(toml_value), pointer :: found

        do first_source = ubound(sources, 1), 1, -1
            call sources(first_source)%root%get(trim(name), found)
            if (.not. associated(found)) cycle
            select type (found)
            type is (toml_array)
                return
            end select
        end do
    end function first_source

    !> Number of tables of a name that may occur several times.
    subroutine count_elements(sources, name, n, error)
        type(source_type), intent(inout), target :: sources(0:)
        character(len=*), intent(in) :: name
        integer, intent(out) :: n
        !> Set if the value is not such a table.
        type(error_type), allocatable, intent(out) :: error
        class(toml_value), pointer :: found
        integer :: i

        n = 0
        do i = 0, ubound(sources, 1)
            call sources(i)%root%get(name, found)
            if (.not. associated(found)) cycle
            select type (found)
            type is (toml_array)
                call count_all(sources(i), name, found, n, error)
            type is (toml_table)
                if (i > 0) then
                    call count_numbered(sources(i), name, found, n, error)
                else
                    call refuse(sources(i), name, found, error)
                end if
            class default
                call refuse(sources(i), name, found, error)
            end select
            if (allocated(error)) return
        end do
    end subroutine count_elements

    !> The tables of an array.
    subroutine count_all(source, name, array, n, error)
        type(source_type), intent(inout) :: source
        character(len=*), intent(in) :: name
        type(toml_array), intent(inout) :: array
        integer, intent(out) :: n
        type(error_type), allocatable, intent(out) :: error
        class(toml_value), pointer :: member
        integer :: i

        n = len(array)
        do i = 1, n
            call array%get(i, member)
            select type (member)
            type is (toml_table)
                cycle
            end select
            call refuse(source, name, array, error)
            return
        end do
    end subroutine count_all

    !> A table whose keys are the numbers of tables: existing ones, or the next one.
    subroutine count_numbered(source, name, table, n, error)
        type(source_type), intent(inout) :: source
        character(len=*), intent(in) :: name
        type(toml_table), intent(inout) :: table
        !> How many there are, before and after.
        integer, intent(inout) :: n
        type(error_type), allocatable, intent(out) :: error
        type(toml_key), allocatable :: names(:)
        class(toml_value), pointer :: found
        integer :: i, j

        allocate (names(0))
        call table%get_keys(names)
        do i = 1, size(names)
            do j = n + 1, 1, -1
                if (names(i)%key == to_toml(j)) exit
            end do
            if (j > 0) call table%get(names(i)%key, found)
            n = max(n, j)
            if (j > 0) then
                select type (found)
                type is (toml_table)
                    cycle
                end select
            end if
            call set_input_error(error, source%describe('"'//name//'" is a table that may come several times; there are '// &
                to_toml(n), table%origin, 'write '//name//'.NUMBER.key=value, with a number from 1 to '//to_toml(n + 1)//', or '// &
                name//'=[{...}, ...] for all of them'))
            return
        end do
    end subroutine count_numbered

    !> An error about a value that is not an array of tables.
    subroutine refuse(source, name, found, error)
        type(source_type), intent(in) :: source
        character(len=*), intent(in) :: name
        class(toml_value), intent(in) :: found
        type(error_type), allocatable, intent(out) :: error

        character(len=:), allocatable :: advice

        advice = 'write [['//name//']] on a line of its own'
        if (allocated(source%argument)) advice = 'write '//name//'=[{...}, ...], a key and its value in each place of the dots'
        call set_input_error(error, source%describe('"'//name//'" is a table that may come several times', found%origin, advice))
    end subroutine refuse
end module tandem_io_scene_tables
