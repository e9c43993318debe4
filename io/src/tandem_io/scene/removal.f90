! SPDX-License-Identifier: MIT
!> Removes keys and tables from the sources of a scene: `--unset solver.rtol`, `--unset event.2`, `--unset force.damper`.
module tandem_io_scene_removal
    use tandem, only: error_type, mechanism_kinds
    use tandem_io_scene_source, only: set_input_error, source_type
    use tandem_io_scene_text, only: nearest_name, to_toml
    use tomlf, only: len, toml_array, toml_key, toml_table, toml_value
    implicit none (type, external)
    private

    public :: drop_keys, remove_key, unset_option

    !> Prefix of a setting that removes a key; the key follows.
    character(len=*), parameter :: unset_option = '--unset '

contains

    !> Remove a key or a table from all sources.
    subroutine remove_key(sources, key, error)
        !> The file, and the settings before this one.
        type(source_type), intent(inout), target :: sources(0:)
        !> Names with dots between them, as in TOML; elements of an array of tables have numbers.
        character(len=*), intent(in) :: key
        !> It is not given.
        type(error_type), allocatable, intent(out) :: error
        type(toml_key), allocatable :: parts(:)
        character(len=:), allocatable :: near
        logical :: is_removed, is_there
        integer :: i

        allocate (parts(0))
        call split(key, parts, error)
        if (allocated(error)) return
        near = ''
        is_removed = .false.
        do i = 0, ubound(sources, 1)
            call remove_below(sources(i)%root, parts, is_there, near)
            is_removed = is_removed .or. is_there
        end do
        ! Elements of mechanisms have names, which may be numbers; those of arrays of tables have numbers.
        if (is_removed .and. size(parts) == 2 .and. .not. any(mechanism_kinds == parts(1)%key)) then
            do i = 1, ubound(sources, 1)
                call close_gap(sources(i)%root, parts)
            end do
        end if
        if (is_removed) return
        if (near /= '') near = '; did you mean "'//near//'"?'
        call set_input_error(error, '--unset '//key//': there is no such key in '//sources(0)%context%filename// &
            ', which has its default already'//near)
    end subroutine remove_key

    !> Remove keys of a table from a source, if they are given.
    subroutine drop_keys(source, table, keys)
        type(source_type), intent(inout), target :: source
        character(len=*), intent(in) :: table, keys(:)
        class(toml_value), pointer :: found
        integer :: i

        call source%root%get(trim(table), found)
        if (.not. associated(found)) return
        select type (found)
        type is (toml_table)
            do i = 1, size(keys)
                call found%delete(trim(keys(i)))
            end do
        end select
    end subroutine drop_keys

    !> Split a key at its dots.
    subroutine split(key, parts, error)
        character(len=*), intent(in) :: key
        !> Empty before.
        type(toml_key), allocatable, intent(inout) :: parts(:)
        type(error_type), allocatable, intent(out) :: error
        type(source_type), target :: source
        type(toml_key), allocatable :: names(:)
        type(toml_table), pointer :: table
        class(toml_value), pointer :: found

        if (key == '' .or. scan(key, '='//achar(10)//achar(13)) > 0) then
            call set_input_error(error, '--unset '//key//' must be table.key, without a value, as in --unset solver.rtol')
            return
        end if
        call source%load_text('--unset', key//' = 0', error)
        if (allocated(error)) return
        table => source%root
        do
            call table%get_keys(names)
            call table%get(names(1)%key, found)
            parts = [parts, names(1)]
            select type (found)
            type is (toml_table)
                table => found
            class default
                exit
            end select
        end do
    end subroutine split

    !> Remove the entry at a path from a table, and tables that become empty.
    recursive subroutine remove_below(table, parts, is_removed, near)
        type(toml_table), intent(inout), target :: table
        type(toml_key), intent(in) :: parts(:)
        logical, intent(out) :: is_removed
        !> A key that may have been meant.
        character(len=:), allocatable, intent(inout) :: near
        type(toml_key), allocatable :: names(:)
        class(toml_value), pointer :: found, member
        integer :: i, number

        is_removed = .false.
        allocate (names(0))
        call table%get(parts(1)%key, found)
        if (.not. associated(found)) then
            call table%get_keys(names)
            if (size(names) > 0 .and. near == '') near = nearest_name(parts(1)%key, &
                [(padded(names(i)%key), i=1, size(names))])
            return
        end if
        is_removed = size(parts) == 1
        if (is_removed) then
            call table%delete(parts(1)%key)
            return
        end if
        select type (found)
        type is (toml_table)
            call remove_below(found, parts(2:), is_removed, near)
            call found%get_keys(names)
            if (is_removed .and. size(names) == 0) call table%delete(parts(1)%key)
        type is (toml_array)
            do number = 1, len(found)
                if (to_toml(number) == parts(2)%key) exit
            end do
            if (number > len(found)) return
            if (size(parts) == 2) then
                call remove_element(found, number)
                is_removed = .true.
                if (len(found) == 0) call table%delete(parts(1)%key)
                return
            end if
            call found%get(number, member)
            select type (member)
            type is (toml_table)
                call remove_below(member, parts(3:), is_removed, near)
            end select
        end select
    end subroutine remove_below

    !> Keys of a setting that number elements: those behind an element that is gone count one less.
    subroutine close_gap(root, parts)
        type(toml_table), intent(inout), target :: root
        !> The name of the array, and the number.
        type(toml_key), intent(in) :: parts(:)
        class(toml_value), pointer :: found
        class(toml_value), allocatable :: member
        integer, parameter :: most = 10000
        integer :: number, stat
        logical :: is_behind

        call root%get(parts(1)%key, found)
        if (.not. associated(found)) return
        select type (found)
        type is (toml_table)
            is_behind = .false.
            do number = 1, most
                if (is_behind .and. found%has_key(to_toml(number))) then
                    call found%pop(to_toml(number), member)
                    member%key = to_toml(number - 1)
                    call found%push_back(member, stat)
                end if
                is_behind = is_behind .or. to_toml(number) == parts(2)%key
            end do
        end select
    end subroutine close_gap

    !> Remove an element from an array.
    subroutine remove_element(array, number)
        type(toml_array), intent(inout) :: array
        integer, intent(in) :: number
        class(toml_value), allocatable :: element
        integer :: i, n, stat

        n = len(array)
        do i = 1, n
            call array%shift(element)
            if (i /= number) call array%push_back(element, stat)
        end do
    end subroutine remove_element

    !> A key with blanks behind.
    pure function padded(key) result(text)
        character(len=*), intent(in) :: key
        character(len=64) :: text

        text = key
    end function padded
end module tandem_io_scene_removal
