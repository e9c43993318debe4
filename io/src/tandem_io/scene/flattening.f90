! SPDX-License-Identifier: MIT
!> From tables within tables to dotted keys with values, as mechanisms take them; and from the complete mechanism to TOML.
module tandem_io_scene_flattening
    use tandem, only: atom_type, entries_type, error_type, is_text, is_truth, value_type, wp
    use tandem_io_scene_source, only: set_input_error, source_type
    use tandem_io_scene_text, only: to_toml
    use tandem_io_scene_values, only: convert, place_of
    use tomlf, only: len, toml_array, toml_key, toml_keyval, toml_table, toml_value
    use tomlf_constants, only: toml_type
    implicit none (type, external)
    private

    public :: convert_value, flatten, place_type, value_to_toml, path_to_toml

    !> Origin of an entry: the source, and the position in it.
    type :: place_type
        integer :: source = 0, origin = 0
    end type place_type

contains

    !> Add the entries of some tables of a source. Places are numbers in a list of them.
    subroutine flatten(source, number, tables, entries, places, n_places, error)
        type(source_type), intent(inout) :: source
        !> The number of the source.
        integer, intent(in) :: number
        character(len=*), intent(in) :: tables(:)
        type(entries_type), intent(inout) :: entries
        !> The first `n_places` are in use.
        type(place_type), allocatable, intent(inout) :: places(:)
        integer, intent(inout) :: n_places
        type(error_type), allocatable, intent(out) :: error
        type(toml_key), allocatable :: names(:)
        class(toml_value), pointer :: found
        integer :: i

        allocate (names(0))
        call source%root%get_keys(names)
        do i = 1, size(names)
            if (.not. any(names(i)%key == tables)) cycle
            call source%root%get(names(i)%key, found)
            select type (found)
            type is (toml_table)
                call add_table(source, number, names(i)%key, found, entries, places, n_places, error)
            class default
                call set_input_error(error, source%describe('"'//names(i)%key//'" is a table', place_of(source, found), &
                    'write ['//names(i)%key//'] or ['//names(i)%key//'.NAME] on a line of its own'))
            end select
            if (allocated(error)) return
        end do
    end subroutine flatten

    !> The entries of a table, and of those in it.
    recursive subroutine add_table(source, number, path, table, entries, places, n_places, error)
        type(source_type), intent(inout) :: source
        integer, intent(in) :: number
        character(len=*), intent(in) :: path
        type(toml_table), intent(inout) :: table
        type(entries_type), intent(inout) :: entries
        !> The first `n_places` are in use.
        type(place_type), allocatable, intent(inout) :: places(:)
        integer, intent(inout) :: n_places
        type(error_type), allocatable, intent(inout) :: error
        type(toml_key), allocatable :: names(:), below(:)
        class(toml_value), pointer :: found
        type(value_type) :: value
        character(len=:), allocatable :: problem
        integer :: i

        allocate (names(0))
        call table%get_keys(names)
        do i = 1, size(names)
            call table%get(names(i)%key, found)
            if (has_dot(names(i)%key) .or. len(names(i)%key) == 0) then
                call set_input_error(error, source%describe('"'//names(i)%key//'" is no name', found%origin, &
                    'names have letters and no dots'))
                return
            end if
            select type (found)
            type is (toml_table)
                call found%get_keys(below)
                if (size(below) == 0) then
                    call set_input_error(error, source%describe(path//'.'//names(i)%key//' is empty', place_of(source, found), &
                        'give it keys, or leave it out'))
                    return
                end if
                call add_table(source, number, path//'.'//names(i)%key, found, entries, places, n_places, error)
            class default
                call convert_value(source, found, value, problem)
                if (problem /= '') then
                    call set_input_error(error, source%describe(path//'.'//names(i)%key//' '//problem, place_of(source, found), &
                        'of '//path))
                    return
                end if
                call add_place(place_type(number, place_of(source, found)), places, n_places)
                call entries%set(path//'.'//names(i)%key, value, n_places)
            end select
            if (allocated(error)) return
        end do
    end subroutine add_table

    subroutine add_place(place, places, n_places)
        type(place_type), intent(in) :: place
        type(place_type), allocatable, intent(inout) :: places(:)
        integer, intent(inout) :: n_places
        type(place_type), allocatable :: longer(:)

        if (n_places == size(places)) then
            allocate (longer(2*n_places))
            longer(:n_places) = places
            call move_alloc(longer, places)
        end if
        n_places = n_places + 1
        places(n_places) = place
    end subroutine add_place

    !> True if a key has a dot outside of braces.
    pure logical function has_dot(key)
        character(len=*), intent(in) :: key
        integer :: i, depth

        depth = 0
        has_dot = .true.
        do i = 1, len(key)
            if (key(i:i) == '{') depth = depth + 1
            if (key(i:i) == '}') depth = depth - 1
            if (key(i:i) == '.' .and. depth <= 0) return
        end do
        has_dot = .false.
    end function has_dot

    !> A value, a list of values, or a list of lists of one length.
    subroutine convert_value(source, found, value, problem)
        class(source_type), intent(in) :: source
        class(toml_value), intent(inout) :: found
        type(value_type), intent(out) :: value
        character(len=:), allocatable, intent(out) :: problem
        class(toml_value), pointer :: element
        integer :: i

        problem = ''
        allocate (value%atoms(0))
        select type (found)
        type is (toml_array)
            value%is_list = .true.
            call find_row_length(found, value%row_length, problem)
            if (problem /= '') return
            deallocate (value%atoms)
            allocate (value%atoms(len(found)*max(1, value%row_length)))
            do i = 1, len(found)
                call found%get(i, element)
                select type (element)
                type is (toml_array)
                    call convert_row(source, element, value%atoms((i - 1)*value%row_length + 1:i*value%row_length), problem)
                class default
                    call convert_atom(source, element, value%atoms(i), problem)
                end select
                if (problem == '') cycle
                problem = 'has an element '//to_toml(i)//' that '//problem
                return
            end do
            if (len(found) == 0) problem = 'is an empty list'
        class default
            deallocate (value%atoms)
            allocate (value%atoms(1))
            call convert_atom(source, found, value%atoms(1), problem)
        end select
    end subroutine convert_value

    !> The length of the lists in a list, 0 if there are none.
    subroutine find_row_length(list, length, problem)
        type(toml_array), intent(inout) :: list
        integer, intent(out) :: length
        character(len=:), allocatable, intent(out) :: problem
        class(toml_value), pointer :: element
        integer :: i, its

        problem = ''
        length = 0
        do i = 1, len(list)
            call list%get(i, element)
            its = 0
            select type (element)
            type is (toml_array)
                its = len(element)
                if (its == 0) problem = 'has an element '//to_toml(i)//' that is an empty list'
            end select
            if (i == 1) length = its
            if (problem == '' .and. its /= length) problem = 'has an element '//to_toml(i)//' that is not like the first one: '// &
                'give one list, or lists of one length'
            if (problem /= '') return
        end do
    end subroutine find_row_length

    !> One of the lists in a list.
    subroutine convert_row(source, row, atoms, problem)
        class(source_type), intent(in) :: source
        type(toml_array), intent(inout) :: row
        type(atom_type), intent(inout) :: atoms(:)
        character(len=:), allocatable, intent(out) :: problem
        class(toml_value), pointer :: element
        integer :: i

        problem = ''
        do i = 1, size(atoms)
            call row%get(i, element)
            call convert_atom(source, element, atoms(i), problem)
            if (problem /= '') return
        end do
    end subroutine convert_row

    !> A number, a text, true or false.
    subroutine convert_atom(source, found, atom, problem)
        class(source_type), intent(in) :: source
        class(toml_value), intent(in) :: found
        type(atom_type), intent(inout) :: atom
        character(len=:), allocatable, intent(out) :: problem

        select type (found)
        type is (toml_keyval)
            select case (found%get_type())
            case (toml_type%string)
                atom%kind = is_text
                call convert(source, found, atom%text, problem)
            case (toml_type%boolean)
                atom%kind = is_truth
                call convert(source, found, atom%truth, problem)
            case default
                call convert(source, found, atom%number, problem)
            end select
        class default
            problem = 'must be a number, a text, true or false'
        end select
    end subroutine convert_atom

    !> A value as TOML.
    function value_to_toml(value) result(text)
        type(value_type), intent(in) :: value
        character(len=:), allocatable :: text
        integer :: i

        text = ''
        do i = 1, size(value%atoms)
            if (i > 1) text = text//', '
            if (value%row_length > 0) then
                if (i > 1 .and. mod(i - 1, value%row_length) == 0) text = text(:len_trim(text) - 1)//'], '
                if (mod(i - 1, value%row_length) == 0) text = text//'['
            end if
            associate (atom => value%atoms(i))
                select case (atom%kind)
                case (is_text)
                    text = text//to_toml(atom%text)
                case (is_truth)
                    text = text//to_toml(atom%truth)
                case default
                    text = text//to_toml(atom%number)
                end select
            end associate
        end do
        if (value%row_length > 0) text = text//']'
        if (value%is_list) text = '['//text//']'
    end function value_to_toml

    !> A dotted key, with quotes around parts that need them.
    function path_to_toml(path) result(text)
        character(len=*), intent(in) :: path
        character(len=:), allocatable :: text
        character(len=*), parameter :: letters = 'abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-'
        integer :: from, to, depth

        text = ''
        from = 1
        do
            depth = 0
            do to = from, len(path)
                if (path(to:to) == '{') depth = depth + 1
                if (path(to:to) == '}') depth = depth - 1
                if (path(to:to) == '.' .and. depth <= 0) exit
            end do
            associate (part => path(from:to - 1))
                if (verify(part, letters) == 0) then
                    text = text//part
                else
                    text = text//to_toml(part)
                end if
            end associate
            if (to > len(path)) exit
            text = text//'.'
            from = to + 1
        end do
    end function path_to_toml
end module tandem_io_scene_flattening
