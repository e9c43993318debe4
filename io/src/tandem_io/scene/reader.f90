! SPDX-License-Identifier: MIT
!> Reads the keys of a scene, one call per key, and records them: the same calls give the values, the list of valid keys
!> (for messages), and the complete scene as text, in which each key occurs once.
!>
!> The first error is stored and later calls do nothing, so that a caller may check once after all calls.
module tandem_io_scene_reader
    use tandem, only: atom_type, entries_type, error_type, value_type, wp
    use tandem_io_scene_flattening, only: flatten, path_to_toml, place_type, value_to_toml
    use tandem_io_scene_ledger, only: heading, key_length, ledger_type
    use tandem_io_scene_removal, only: drop_keys, remove_key, unset_option
    use tandem_io_scene_source, only: set_input_error, source_type
    use tandem_io_scene_tables, only: count_elements, first_source, table_of
    use tandem_io_scene_text, only: listed, nearest_name
    use tandem_io_scene_values, only: convert, place_of
    use tomlf, only: toml_key, toml_table, toml_value
    implicit none (type, external)
    private

    public :: reader_type, anything, positive, not_negative

    !> Ranges allowed for a number.
    integer, parameter :: anything = 0, positive = 1, not_negative = 2

    type :: reader_type
        !> The first error.
        type(error_type), allocatable :: error
        !> True if only values are read: no list of keys, no complete scene, no check for unknown keys. For sources that were read
        !> in full before, and in which only values have changed.
        logical :: is_brief = .false.
        !> The scene file first, then what was set on the command line, in that order: later ones win.
        type(source_type), allocatable, private :: sources(:)
        !> The keys read so far.
        type(ledger_type), private :: ledger
        !> Origins of the entries of a mechanism.
        type(place_type), allocatable, private :: places(:)
        !> The current table.
        character(len=key_length), private :: table = ''
        !> Its number in an array of tables, 0 for a table of its own.
        integer, private :: element = 0
    contains
        procedure :: open_sources, check_tables, open_table, count_tables, open_element, close_table
        procedure :: failed, source_of, replace, hide, remark, propose, gives, flatten => flatten_tables, says_true, says_number
        procedure :: refuse, refuse_place, refuse_tables, show, text
        generic :: get => get_real, get_integer, get_logical, get_string, get_choice, get_vector, get_strings
        procedure :: get_reals, get_for_each
        procedure, private :: get_real, get_integer, get_logical, get_string, get_choice, get_vector, get_strings
        procedure :: get_list, change, unit_of, value_of
        procedure, private :: find, record, refuse_value
    end type reader_type

    ! Procedures for sweeps: lists of any length, and values that change from case to case.
    interface
        !> A list of numbers, texts or truth values, of any length; not allocated if the key is absent.
        module subroutine get_list(self, key, values)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            type(value_type), allocatable, intent(inout) :: values
        end subroutine get_list

        !> Give the value of a setting anew.
        module subroutine change(self, setting, element, atom)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            !> Its number among the settings, and the number of an element if the value is a list; 0 for the value itself.
            integer, intent(in) :: setting, element
            !> A whole number becomes an integer if the setting was one.
            type(atom_type), intent(in) :: atom
        end subroutine change

        !> The unit of a key that was read, blank if unknown.
        pure module function unit_of(self, table, key) result(unit)
            implicit none (type, external)
            class(reader_type), intent(in) :: self
            character(len=*), intent(in) :: table, key
            character(len=key_length) :: unit
        end function unit_of

        !> The value of a key that was read, as TOML on one line; empty if there is none.
        pure module function value_of(self, table, key) result(text)
            implicit none (type, external)
            class(reader_type), intent(in) :: self
            character(len=*), intent(in) :: table, key
            character(len=:), allocatable :: text
        end function value_of
    end interface

    ! The values, by their kind.
    interface
        !> A number.
        module subroutine get_real(self, key, value, check, unit, help, required)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            !> The default before, the value after.
            real(wp), intent(inout) :: value
            !> `anything` (default), `positive` or `not_negative`.
            integer, intent(in), optional :: check
            !> Unit and meaning, for the complete scene.
            character(len=*), intent(in), optional :: unit, help
            !> True if there is no default.
            logical, intent(in), optional :: required
        end subroutine get_real

        !> An integer.
        module subroutine get_integer(self, key, value, check, help)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            !> The default before, the value after.
            integer, intent(inout) :: value
            integer, intent(in), optional :: check
            character(len=*), intent(in), optional :: help
        end subroutine get_integer

        !> True or false.
        module subroutine get_logical(self, key, value, help)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            !> The default before, the value after.
            logical, intent(inout) :: value
            character(len=*), intent(in), optional :: help
        end subroutine get_logical

        !> A text of any length.
        module subroutine get_string(self, key, value, help, required)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            !> The default before, the value after.
            character(len=:), allocatable, intent(inout) :: value
            character(len=*), intent(in), optional :: help
            logical, intent(in), optional :: required
        end subroutine get_string

        !> One of some texts.
        module subroutine get_choice(self, key, value, choices, help, required)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            !> The default before, the value after.
            character(len=*), intent(inout) :: value
            !> Allowed texts.
            character(len=*), intent(in) :: choices(:)
            character(len=*), intent(in), optional :: help
            logical, intent(in), optional :: required
        end subroutine get_choice

        !> As many numbers as `values` has.
        module subroutine get_vector(self, key, values, check, unit, help)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            !> The defaults before, the values after.
            real(wp), intent(inout) :: values(:)
            integer, intent(in), optional :: check
            character(len=*), intent(in), optional :: unit, help
        end subroutine get_vector

        !> Some numbers.
        module subroutine get_reals(self, key, values, length, check, unit, help, required)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            !> The default before, the value after.
            real(wp), allocatable, intent(inout) :: values(:)
            !> How many there must be.
            integer, intent(in) :: length
            integer, intent(in), optional :: check
            character(len=*), intent(in), optional :: unit, help
            logical, intent(in), optional :: required
        end subroutine get_reals

        !> One number for all of something, or one for each in a list.
        module subroutine get_for_each(self, key, length, values, value, help)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            !> How many there are.
            integer, intent(in) :: length
            !> The list; not allocated if there is none.
            real(wp), allocatable, intent(inout) :: values(:)
            !> The number for all, on entry the default. If absent, the key has no default, and a number fills the list.
            real(wp), intent(inout), optional :: value
            character(len=*), intent(in), optional :: help
        end subroutine get_for_each

        !> Some of some texts, each once at most.
        module subroutine get_strings(self, key, values, choices, help, may_have_values)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            !> The default before, the value after.
            character(len=*), allocatable, intent(inout) :: values(:)
            !> Allowed texts of the elements.
            character(len=*), intent(in) :: choices(:)
            character(len=*), intent(in), optional :: help
            !> True if elements may have the form NAME=NUMBER as well.
            logical, intent(in), optional :: may_have_values
        end subroutine get_strings
    end interface

contains

    !> Take the scene file and the settings of the command line.
    subroutine open_sources(self, path, settings, text, kind)
        class(reader_type), intent(inout) :: self
        !> Path of the scene file, or how messages call the text.
        character(len=*), intent(in) :: path
        !> `table.key=value`, or `--unset table.key`; blanks at the end dropped.
        character(len=*), intent(in) :: settings(:)
        !> Text of the scene, instead of a file.
        character(len=*), intent(in), optional :: text
        !> Kind of the file, in messages; `scene` if absent.
        character(len=*), intent(in), optional :: kind
        integer :: i

        allocate (self%sources(0:size(settings)))
        if (present(kind)) self%sources(0)%kind = kind
        if (present(text)) then
            call self%sources(0)%load_text(path, text, self%error)
        else
            call self%sources(0)%load_file(path, self%error)
        end if
        do i = 1, size(settings)
            if (allocated(self%error)) return
            if (index(settings(i), unset_option) == 1) then
                call self%sources(i)%load_text(trim(unset_option), '', self%error)
                call remove_key(self%sources(:i), trim(adjustl(settings(i) (len(unset_option) + 1:))), self%error)
            else
                call self%sources(i)%load_argument(trim(settings(i)), self%error)
            end if
        end do
    end subroutine open_sources

    !> Refuse entries of the top level that are not known tables. `count_tables` looks into those that may come several times.
    subroutine check_tables(self, tables, arrays, others, of)
        class(reader_type), intent(inout), target :: self
        !> The tables of a scene, those that may come several times, and those that some models bring.
        character(len=*), intent(in) :: tables(:), arrays(:), others(:)
        !> Owner of the tables, in messages; a scene if absent.
        character(len=*), intent(in), optional :: of
        type(toml_key), allocatable :: names(:)
        class(toml_value), pointer :: found
        integer :: i, j

        do i = 0, ubound(self%sources, 1)
            if (allocated(self%error)) return
            call self%sources(i)%root%get_keys(names)
            do j = 1, size(names)
                call self%sources(i)%root%get(names(j)%key, found)
                if (any(names(j)%key == arrays) .or. any(names(j)%key == others)) cycle
                if (any(names(j)%key == tables)) then
                    select type (found)
                    type is (toml_table)
                        cycle
                    end select
                    call set_input_error(self%error, self%sources(i)%describe('"'//names(j)%key//'" is a table', &
                        found%origin, 'write ['//names(j)%key//'] on a line of its own'))
                else
                    call set_input_error(self%error, self%sources(i)%describe('unknown table or key "'//names(j)%key//'"', &
                        found%origin, meant(names(j)%key, [tables, arrays, others]))//new_line('a')//tables_there())
                end if
                return
            end do
        end do
    contains
        !> The tables that there are.
        function tables_there() result(text)
            character(len=:), allocatable :: text

            if (present(of)) then
                text = 'the tables of '//of//': '//listed([tables, arrays])
            else
                text = 'the tables of a scene: '//listed([tables, arrays])//'; of a mechanism: '//listed(others)
            end if
        end function tables_there
    end subroutine check_tables

    !> The calls of `get` that follow are about this table.
    subroutine open_table(self, table)
        class(reader_type), intent(inout) :: self
        character(len=*), intent(in) :: table

        self%table = table
        self%element = 0
    end subroutine open_table

    !> How many tables of a name the scene has.
    integer function count_tables(self, table)
        class(reader_type), intent(inout), target :: self
        character(len=*), intent(in) :: table

        count_tables = 0
        if (self%failed()) return
        call count_elements(self%sources, table, count_tables, self%error)
        if (self%failed()) count_tables = 0
    end function count_tables

    !> The calls of `get` that follow are about this one of several tables of a name.
    subroutine open_element(self, table, element)
        class(reader_type), intent(inout) :: self
        character(len=*), intent(in) :: table
        !> Its number, from 1.
        integer, intent(in) :: element

        self%table = table
        self%element = element
    end subroutine open_element

    !> All keys of the table have been read: refuse the others.
    subroutine close_table(self)
        class(reader_type), intent(inout), target :: self
        type(toml_table), pointer :: table
        type(toml_key), allocatable :: names(:)
        class(toml_value), pointer :: found
        character(len=key_length), allocatable :: known(:)
        integer :: i, j

        if (self%failed() .or. self%is_brief) return
        known = self%ledger%keys(self%table, self%element)
        do i = first_source(self%sources, self%table), ubound(self%sources, 1)
            table => table_of(self%sources(i), self%table, self%element)
            if (.not. associated(table)) cycle
            call table%get_keys(names)
            do j = 1, size(names)
                if (any(names(j)%key == known)) cycle
                call table%get(names(j)%key, found)
                call set_input_error(self%error, self%sources(i)%describe('unknown key "'//names(j)%key//'" in '// &
                    heading(self%table, self%element), found%origin, meant(names(j)%key, known))//new_line('a')// &
                    'the keys of '//heading(self%table, self%element)//': '//listed(known)//trim(merge('none', '    ', &
                        size(known) == 0)))
                return
            end do
        end do
    end subroutine close_table

    !> True after an error.
    pure logical function failed(self)
        class(reader_type), intent(in) :: self

        failed = allocated(self%error)
    end function failed

    !> Which source gives a key of the current table: 0 the file, i the i-th setting, -1 none.
    integer function source_of(self, key)
        class(reader_type), intent(inout) :: self
        character(len=*), intent(in) :: key
        class(toml_value), pointer :: found

        call self%find(key, found, source_of)
    end function source_of

    !> Remove keys of the current table from the file if one of others, which replace them, is set on the command line and is not 0.
    subroutine replace(self, keys, by)
        class(reader_type), intent(inout), target :: self
        character(len=*), intent(in) :: keys(:), by(:)
        class(toml_value), pointer :: found
        character(len=:), allocatable :: problem
        real(wp) :: number
        integer :: i, source

        do i = 1, size(by)
            number = 1.0_wp
            call self%find(trim(by(i)), found, source)
            if (source <= 0) cycle
            call convert(self%sources(source), found, number, problem)
            if (abs(number) > 0.0_wp) call drop_keys(self%sources(0), self%table, keys)
        end do
    end subroutine replace

    !> Exclude the keys read so far in the current table from the complete scene, since others replace them. Giving such a key at
    !> the same time is an error.
    subroutine hide(self, source, reason)
        class(reader_type), intent(inout) :: self
        !> The source of the others.
        integer, intent(in) :: source
        !> Reason why both are not allowed.
        character(len=*), intent(in) :: reason
        character(len=key_length) :: given

        if (self%is_brief) return
        call self%ledger%hide(self%table, source, given)
        if (given /= '') call self%refuse(trim(given), reason)
    end subroutine hide

    !> A line of comment in the complete scene.
    subroutine remark(self, words)
        class(reader_type), intent(inout) :: self
        character(len=*), intent(in) :: words

        if (.not. self%is_brief) call self%ledger%add(self%table, '', '', words, -1, element=self%element)
    end subroutine remark

    !> Make a key known to messages although it has no value here.
    subroutine propose(self, key)
        class(reader_type), intent(inout) :: self
        character(len=*), intent(in) :: key

        if (.not. self%is_brief) call self%ledger%add(self%table, key, '', '', -1, shown=.false., element=self%element)
    end subroutine propose

    !> True if a key of the current table is given.
    logical function gives(self, key)
        class(reader_type), intent(inout) :: self
        character(len=*), intent(in) :: key
        class(toml_value), pointer :: found
        integer :: source

        call self%find(key, found, source)
        gives = associated(found)
    end function gives

    !> An error about the value of a key, shown with its source line.
    subroutine refuse(self, key, problem)
        class(reader_type), intent(inout) :: self
        !> A key of the current table.
        character(len=*), intent(in) :: key
        !> Description of the fault.
        character(len=*), intent(in) :: problem
        class(toml_value), pointer :: found
        integer :: source

        if (self%failed()) return
        call self%find(key, found, source)
        if (associated(found)) then
            call self%refuse_value(key, found, source, problem)
        else
            call set_input_error(self%error, key//' '//problem//new_line('a')//' --> '// &
                heading(self%table, self%element)//' of '//self%sources(0)%context%filename)
        end if
    end subroutine refuse

    !> All keys of some tables that have tables within them, of all sources.
    subroutine flatten_tables(self, tables, entries)
        class(reader_type), intent(inout) :: self
        character(len=*), intent(in) :: tables(:)
        type(entries_type), intent(inout) :: entries
        integer :: i, n_places

        if (allocated(self%places)) deallocate (self%places)
        allocate (self%places(64))
        n_places = 0
        do i = 0, ubound(self%sources, 1)
            if (self%failed()) return
            call flatten(self%sources(i), i, tables, entries, self%places, n_places, self%error)
        end do
    end subroutine flatten_tables

    !> True if a key is given and true; other values are reported when the key is read.
    logical function says_true(self, table, key) result(truth)
        class(reader_type), intent(inout) :: self
        character(len=*), intent(in) :: table, key
        class(toml_value), pointer :: found
        character(len=:), allocatable :: problem
        integer :: source

        truth = .false.
        call self%open_table(table)
        call self%find(key, found, source)
        if (associated(found)) call convert(self%sources(source), found, truth, problem)
    end function says_true

    !> The number that a key gives, or 0.
    real(wp) function says_number(self, table, key) result(number)
        class(reader_type), intent(inout) :: self
        character(len=*), intent(in) :: table, key
        class(toml_value), pointer :: found
        character(len=:), allocatable :: problem
        integer :: source

        number = 0.0_wp
        call self%open_table(table)
        call self%find(key, found, source)
        if (associated(found)) call convert(self%sources(source), found, number, problem)
    end function says_number

    !> An error about an entry, shown with its source line; 0 for the whole scene.
    subroutine refuse_place(self, place, problem)
        class(reader_type), intent(inout) :: self
        integer, intent(in) :: place
        character(len=*), intent(in) :: problem

        if (self%failed()) return
        if (place > 0) then
            associate (where => self%places(place))
                call set_input_error(self%error, self%sources(where%source)%describe(problem, where%origin, 'here'))
            end associate
        else
            call set_input_error(self%error, problem//new_line('a')//' --> '//heading('scene', 0)//' of '// &
                self%sources(0)%context%filename)
        end if
    end subroutine refuse_place

    !> Refuse tables that another model would have.
    subroutine refuse_tables(self, tables, known)
        class(reader_type), intent(inout), target :: self
        !> Those, and the ones of the scene.
        character(len=*), intent(in) :: tables(:), known(:)
        class(toml_value), pointer :: found
        integer :: i, j

        do i = 0, ubound(self%sources, 1)
            do j = 1, size(tables)
                if (self%failed()) return
                call self%sources(i)%root%get(trim(tables(j)), found)
                if (.not. associated(found)) cycle
                call set_input_error(self%error, self%sources(i)%describe('unknown table or key "'//trim(tables(j))//'"', &
                    found%origin, 'mechanisms have it: [scene] model = "mechanism"')//new_line('a')//'the tables of a scene: '// &
                    listed(known))
            end do
        end do
    end subroutine refuse_tables

    !> A line of the complete scene.
    subroutine show(self, table, key, value, comment)
        class(reader_type), intent(inout) :: self
        character(len=*), intent(in) :: table, key
        type(value_type), intent(in) :: value
        character(len=*), intent(in) :: comment

        if (.not. self%is_brief) call self%ledger%add(path_to_toml(table), path_to_toml(key), value_to_toml(value), comment, 0)
    end subroutine show

    !> The complete scene as TOML, with every key read.
    pure function text(self)
        class(reader_type), intent(in) :: self
        character(len=:), allocatable :: text

        text = self%ledger%text()
    end function text

    !> The value of a key of the current table, from the last source that gives it; -1 is the source of a default.
    subroutine find(self, key, found, source, required)
        class(reader_type), intent(inout), target :: self
        character(len=*), intent(in) :: key
        class(toml_value), pointer, intent(out) :: found
        integer, intent(out) :: source
        logical, intent(in), optional :: required
        type(toml_table), pointer :: table
        integer :: first, place

        nullify (found)
        source = -1
        if (self%failed()) return
        first = first_source(self%sources, self%table)
        place = first
        do source = ubound(self%sources, 1), first, -1
            table => table_of(self%sources(source), self%table, self%element)
            if (.not. associated(table)) cycle
            call table%get(key, found)
            if (associated(found)) return
            ! One of several tables is located in the source that gives it first.
            if (self%element > 0) place = source
        end do
        source = -1
        if (.not. present(required)) return
        if (required) call set_input_error(self%error, 'the key '//key//' is missing in '// &
            heading(self%table, self%element)//' of '//self%sources(place)%context%filename)
    end subroutine find

    !> Remember a key and its value.
    subroutine record(self, key, value, source, unit, help)
        class(reader_type), intent(inout) :: self
        character(len=*), intent(in) :: key, value
        integer, intent(in) :: source
        character(len=*), intent(in), optional :: unit, help
        character(len=:), allocatable :: comment

        comment = ''
        if (present(unit)) comment = unit
        if (present(help)) then
            if (comment /= '') comment = comment//', '
            comment = comment//help
        end if
        call self%ledger%add(self%table, key, value, comment, source, element=self%element, unit=unit)
    end subroutine record

    !> An error about a value, with its line.
    subroutine refuse_value(self, key, found, source, problem)
        class(reader_type), intent(inout) :: self
        character(len=*), intent(in) :: key
        class(toml_value), intent(in) :: found
        integer, intent(in) :: source
        character(len=*), intent(in) :: problem

        call set_input_error(self%error, self%sources(source)%describe(key//' '//problem, place_of(self%sources(source), found), &
            'in '//heading(self%table, self%element)))
    end subroutine refuse_value

    !> The question whether another word was meant.
    pure function meant(word, names) result(question)
        character(len=*), intent(in) :: word, names(:)
        character(len=:), allocatable :: question

        question = nearest_name(word, names)
        if (question /= '') question = 'did you mean "'//question//'"?'
    end function meant
end module tandem_io_scene_reader
