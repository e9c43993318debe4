! SPDX-License-Identifier: MIT
!> Converts parsed TOML to dotted keys with values, and records their positions in the text.
module tandem_io_scene_conversion
    use tandem, only: atom_type, entries_type, error_type, is_other, is_text, is_truth, value_type, wp
    use tandem_io_scene_source, only: parsed_type, set_input_error, source_type
    use tandem_io_scene_text, only: to_toml
    use tomlf, only: len, toml_array, toml_key, toml_keyval, toml_table, toml_value
    use tomlf_constants, only: tfi, tfr, toml_type
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)
    private

    public :: converter_type, position_type

    !> Largest length of a text in bytes, sufficient for paths.
    integer, parameter :: longest = 4096

    !> Position of an entry: its source, and the first and last character of its key and of its value.
    type :: position_type
        integer :: source = 0
        integer :: key(2) = 0, value(2) = 0
    end type position_type

    !> Adds the values of one source to a list of entries.
    type :: converter_type
        !> Index of the source.
        integer :: number = 0
        type(source_type) :: source
        type(parsed_type) :: parsed
        !> Positions of all entries; the first `n_positions` are in use.
        type(position_type), allocatable :: positions(:)
        integer :: n_positions = 0
    contains
        procedure :: add_below, add_keys, add_position, position_of
        procedure, private :: add_value, convert_value, convert_row, convert_atom
    end type converter_type

contains

    !> Add the entries of a table and of its subtables.
    recursive subroutine add_below(self, path, table, entries, error)
        class(converter_type), intent(inout) :: self
        character(len=*), intent(in) :: path
        type(toml_table), intent(inout) :: table
        type(entries_type), intent(inout) :: entries
        type(error_type), allocatable, intent(inout) :: error
        type(toml_key), allocatable :: names(:), below(:)
        class(toml_value), pointer :: found
        type(position_type) :: position
        character(len=:), allocatable :: problem
        integer :: i

        allocate (names(0))
        call table%get_keys(names)
        do i = 1, size(names)
            call table%get(names(i)%key, found)
            position = self%position_of(found)
            if (has_dot(names(i)%key) .or. len(names(i)%key) == 0) then
                call set_input_error(error, self%source%describe('"'//names(i)%key//'" is not a valid name', position%key, &
                    'names contain letters and no dots'))
                return
            end if
            select type (found)
            type is (toml_table)
                call found%get_keys(below)
                if (size(below) == 0) then
                    call set_input_error(error, self%source%describe(path//'.'//names(i)%key//' is empty', position%value, &
                        'add keys, or remove it'))
                    return
                end if
                call self%add_below(path//'.'//names(i)%key, found, entries, error)
            class default
                call self%add_value(path//'.'//names(i)%key, found, entries, problem)
                if (problem /= '') call set_input_error(error, self%source%describe(path//'.'//names(i)%key//' '//problem, &
                    position%value, 'of '//path))
            end select
            if (allocated(error)) return
        end do
    end subroutine add_below

    !> Add the keys of a table. Their values are checked when they are read.
    subroutine add_keys(self, path, table, entries)
        class(converter_type), intent(inout) :: self
        character(len=*), intent(in) :: path
        type(toml_table), intent(inout) :: table
        type(entries_type), intent(inout) :: entries
        type(toml_key), allocatable :: names(:)
        class(toml_value), pointer :: found
        character(len=:), allocatable :: problem
        integer :: i

        allocate (names(0))
        call table%get_keys(names)
        do i = 1, size(names)
            call table%get(names(i)%key, found)
            call self%add_value(path//'.'//names(i)%key, found, entries, problem)
        end do
    end subroutine add_keys

    !> Add a value.
    subroutine add_value(self, key, found, entries, problem)
        class(converter_type), intent(inout) :: self
        character(len=*), intent(in) :: key
        class(toml_value), intent(inout) :: found
        type(entries_type), intent(inout) :: entries
        !> Reason why the value is invalid in a mechanism; empty if it is valid.
        character(len=:), allocatable, intent(out) :: problem
        type(value_type) :: value

        call self%convert_value(found, value, problem)
        call self%add_position(self%position_of(found))
        call entries%set(key, value, self%n_positions, self%number)
    end subroutine add_value

    !> Append a position.
    subroutine add_position(self, position)
        class(converter_type), intent(inout) :: self
        type(position_type), intent(in) :: position
        type(position_type), allocatable :: longer(:)

        if (.not. allocated(self%positions)) allocate (self%positions(64))
        if (self%n_positions == size(self%positions)) then
            allocate (longer(2*self%n_positions))
            longer(:self%n_positions) = self%positions
            call move_alloc(longer, self%positions)
        end if
        self%n_positions = self%n_positions + 1
        self%positions(self%n_positions) = position
    end subroutine add_position

    !> Positions of a key and of its value.
    type(position_type) function position_of(self, found) result(position)
        class(converter_type), intent(in) :: self
        class(toml_value), intent(in) :: found
        integer :: origin

        position%source = self%number
        position%key = span_of(found%origin)
        origin = found%origin
        select type (found)
        type is (toml_keyval)
            if (found%origin_value > 0) origin = found%origin_value
        class default
            ! For lists and inline tables the parser reports only the position of the key.
            origin = self%parsed%value_of(found%origin)
        end select
        position%value = span_of(origin)
    contains
        !> First and last character of the value that begins at a token.
        function span_of(origin) result(span)
            integer, intent(in) :: origin
            integer :: span(2)

            span = 0
            if (origin < 1 .or. origin > self%parsed%context%top) return
            span = [self%parsed%context%token(origin)%first, self%parsed%context%token(self%parsed%end_of(origin))%last]
        end function span_of
    end function position_of

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

    !> Convert a value, a list of values, or a list of lists of equal length.
    subroutine convert_value(self, found, value, problem)
        class(converter_type), intent(in) :: self
        class(toml_value), intent(inout) :: found
        type(value_type), intent(out) :: value
        !> Reason why the value is invalid in a mechanism; empty if it is valid.
        character(len=:), allocatable, intent(out) :: problem
        class(toml_value), pointer :: element
        integer :: i, j

        problem = ''
        select type (found)
        type is (toml_array)
            value%is_list = .true.
            call find_row_length(found, value%row_length, problem)
            allocate (value%atoms(len(found)*max(1, value%row_length)))
            do i = 1, len(found)
                call found%get(i, element)
                if (value%row_length > 0) then
                    select type (element)
                    type is (toml_array)
                        call self%convert_row(element, value%atoms((i - 1)*value%row_length + 1:i*value%row_length))
                    end select
                else
                    call self%convert_atom(element, value%atoms(i))
                end if
            end do
            if (len(found) == 0) problem = 'is an empty list'
        class default
            allocate (value%atoms(1))
            call self%convert_atom(found, value%atoms(1))
        end select
        do i = 1, size(value%atoms)
            if (problem /= '') return
            problem = atom_problem(value%atoms(i), value%is_list)
            j = (i - 1)/max(1, value%row_length) + 1
            if (problem /= '' .and. value%is_list) problem = 'has an element '//to_toml(j)//' that '//problem
        end do
    end subroutine convert_value

    !> Reason why an atom is invalid in a mechanism; empty if it is valid.
    pure function atom_problem(atom, is_in_list) result(problem)
        type(atom_type), intent(in) :: atom
        logical, intent(in) :: is_in_list
        character(len=:), allocatable :: problem

        problem = ''
        if (allocated(atom%problem)) then
            problem = atom%problem
        else if (atom%kind == is_other) then
            problem = 'must be a number, not '//atom%text
            if (is_in_list .and. atom%text /= 'a date') problem = 'must be a number, a string, true or false'
        end if
    end function atom_problem

    !> Length of the lists in a list of lists; 0 if the elements are no lists, or lists of different lengths.
    subroutine find_row_length(list, length, problem)
        type(toml_array), intent(inout) :: list
        integer, intent(out) :: length
        character(len=:), allocatable, intent(out) :: problem
        class(toml_value), pointer :: element
        integer :: i, its_length

        problem = ''
        length = 0
        do i = 1, len(list)
            call list%get(i, element)
            its_length = 0
            select type (element)
            type is (toml_array)
                its_length = len(element)
                if (its_length == 0) problem = 'has an element '//to_toml(i)//' that is an empty list'
            end select
            if (i == 1) length = its_length
            if (problem == '' .and. its_length /= length) problem = 'has an element '//to_toml(i)// &
                ' that is not like the first one: give one list, or lists of one length'
            if (problem /= '') then
                length = 0
                return
            end if
        end do
    end subroutine find_row_length

    !> Convert a list in a list of lists.
    subroutine convert_row(self, row, atoms)
        class(converter_type), intent(in) :: self
        type(toml_array), intent(inout) :: row
        type(atom_type), intent(inout) :: atoms(:)
        class(toml_value), pointer :: element
        integer :: i

        do i = 1, size(atoms)
            call row%get(i, element)
            call self%convert_atom(element, atoms(i))
        end do
    end subroutine convert_row

    !> Convert a number, a text or a truth value. For other values, `text` describes their kind.
    subroutine convert_atom(self, found, atom)
        class(converter_type), intent(in) :: self
        class(toml_value), intent(in) :: found
        type(atom_type), intent(inout) :: atom
        character(len=:), pointer :: text
        logical, pointer :: truth
        real(tfr), pointer :: number
        integer(tfi), pointer :: whole

        atom%kind = is_other
        select type (found)
        type is (toml_table)
            atom%text = 'a table'
        type is (toml_array)
            atom%text = 'an array'
        type is (toml_keyval)
            select case (found%get_type())
            case (toml_type%string)
                call found%get(text)
                atom = atom_type(kind=is_text, text=text)
                call check_text_value(atom)
            case (toml_type%boolean)
                call found%get(truth)
                atom = atom_type(kind=is_truth, truth=truth)
            case (toml_type%float)
                call found%get(number)
                atom = atom_type(number=real(number, wp))
                if (.not. ieee_is_finite(number)) atom%problem = 'must be a finite number'
            case (toml_type%int)
                call found%get(whole)
                atom = atom_type(number=real(whole, wp), is_whole=.true.)
                if (has_overflown(self, found)) atom%problem = 'has too many digits for an integer; write a decimal point'
            case (toml_type%datetime)
                atom%text = 'a date'
            case default
                atom%text = 'no value'
            end select
        class default
            atom%text = 'something else'
        end select
    end subroutine convert_atom

    !> Set `problem` for a text that is empty, too long, or contains control characters.
    pure subroutine check_text_value(atom)
        type(atom_type), intent(inout) :: atom
        integer :: i

        if (len_trim(atom%text) == 0) then
            atom%problem = 'must not be empty'
        else if (len(atom%text) > longest) then
            atom%problem = 'must not be longer than '//to_toml(longest)//' bytes'
        else
            do i = 1, len(atom%text)
                if (iachar(atom%text(i:i)) >= 32 .and. iachar(atom%text(i:i)) /= 127) cycle
                atom%problem = 'must not contain control characters'
            end do
        end if
    end subroutine check_text_value

    !> True if an integer may have more digits than 64 bits can represent, also in hexadecimal form; the parser would wrap it
    !> around.
    logical function has_overflown(self, found)
        class(converter_type), intent(in) :: self
        type(toml_keyval), intent(in) :: found
        integer, parameter :: most_digits = 17

        has_overflown = .false.
        if (found%origin_value < 1 .or. found%origin_value > self%parsed%context%top) return
        associate (token => self%parsed%context%token(found%origin_value))
            has_overflown = token%last - token%first + 1 > most_digits
        end associate
    end function has_overflown
end module tandem_io_scene_conversion
