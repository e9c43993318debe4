! SPDX-License-Identifier: MIT
!> Removes keys and tables of a description: `--unset solver.rtol`, `--unset event.2`, `--unset force.damper`.
submodule(tandem_io_scene_description) tandem_io_scene_removal
    use tandem, only: entry_type
    use tandem_io_scene_source, only: parsed_type
    implicit none (type, external)

contains

    module procedure remove
        type(toml_key), allocatable :: parts(:)
        character(len=:), allocatable :: path, near
        logical, allocatable :: is_kept(:)
        integer :: i, array

        allocate (parts(0))
        call split(key, parts, error)
        if (allocated(error)) return
        path = parts(1)%key
        do i = 2, size(parts)
            path = path//'.'//parts(i)%key
        end do
        allocate (is_kept(self%entries%n))
        do i = 1, self%entries%n
            is_kept(i) = index(self%entries%list(i)%key//'.', path//'.') /= 1
        end do
        if (all(is_kept) .and. .not. (size(parts) == 1 .and. any(names_of(self%roots) == path))) then
            near = nearest_part(self, parts)
            if (near /= '') near = '; did you mean "'//near//'"?'
            call set_input_error(error, '--unset '//key//': no such key in '//self%sources(0)%name// &
                ', so it has its default already'//near)
            return
        end if
        call self%entries%keep(is_kept)
        array = findloc(self%arrays == parts(1)%key, .true., dim=1)
        if (array > 0 .and. size(parts) == 1) self%counts(array) = 0
        if (array > 0 .and. size(parts) == 2) call renumber_after(self, array, parts(2)%key)
        ! Remove the table itself if no keys are left in it.
        if (any([(index(self%entries%list(i)%key, parts(1)%key//'.') == 1, i=1, self%entries%n)])) return
        self%roots = pack(self%roots, names_of(self%roots) /= parts(1)%key)
    end procedure remove

    !> Names of the entries of the top level.
    pure function names_of(roots) result(names)
        type(root_type), intent(in) :: roots(:)
        character(len=256) :: names(size(roots))
        integer :: i

        do i = 1, size(roots)
            names(i) = roots(i)%name
        end do
    end function names_of

    !> Split a key at its dots.
    subroutine split(key, parts, error)
        character(len=*), intent(in) :: key
        !> Empty on entry.
        type(toml_key), allocatable, intent(inout) :: parts(:)
        type(error_type), allocatable, intent(out) :: error
        type(source_type) :: source
        type(parsed_type), target :: parsed
        type(toml_key), allocatable :: names(:)
        type(toml_table), pointer :: table
        class(toml_value), pointer :: found

        if (key == '' .or. scan(key, '='//achar(10)//achar(13)) > 0) then
            call set_input_error(error, '--unset '//key//' must be table.key without a value, as in --unset solver.rtol')
            return
        end if
        call source%load_text('--unset', key//' = 0', parsed, error)
        if (allocated(error)) return
        table => parsed%root
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

    !> Name that is similar to the first unknown part of a key; empty if there is none.
    function nearest_part(self, parts) result(near)
        class(description_type), intent(in) :: self
        type(toml_key), intent(in) :: parts(:)
        character(len=:), allocatable :: near
        character(len=64), allocatable :: names(:)
        character(len=:), allocatable :: path
        integer :: i, k

        near = ''
        path = ''
        names = [character(len=64) :: names_of(self%roots)]
        do i = 1, size(parts)
            if (.not. any(names == parts(i)%key)) then
                near = nearest_name(parts(i)%key, names)
                return
            end if
            path = path//parts(i)%key//'.'
            names = [character(len=64) ::]
            do k = 1, self%entries%n
                associate (its => self%entries%list(k)%key)
                    if (index(its, path) /= 1) cycle
                    names = [character(len=64) :: names, its(len(path) + 1:len(path) + index(its(len(path) + 1:)//'.', '.') - 1)]
                end associate
            end do
        end do
    end function nearest_part

    !> Renumber the tables that follow a removed one.
    subroutine renumber_after(self, array, removed)
        class(description_type), intent(inout) :: self
        integer, intent(in) :: array
        !> Number of the removed table.
        character(len=*), intent(in) :: removed
        type(entries_type) :: entries
        type(entry_type) :: entry
        character(len=:), allocatable :: head
        integer :: i, number, first

        read (removed, *) first
        do i = 1, self%entries%n
            entry = self%entries%list(i)
            do number = first + 1, self%counts(array)
                head = trim(self%arrays(array))//'.'//to_toml(number)
                if (index(entry%key//'.', head//'.') /= 1) cycle
                entry%key = trim(self%arrays(array))//'.'//to_toml(number - 1)//entry%key(len(head) + 1:)
                exit
            end do
            call entries%append(entry)
        end do
        self%entries = entries
        self%counts(array) = self%counts(array) - 1
    end subroutine renumber_after
end submodule tandem_io_scene_removal
