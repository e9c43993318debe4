! SPDX-License-Identifier: MIT
!> The description of a scene or of a sweep: keys with values from a TOML file and from settings of the command line. They are
!> parsed once and can be read any number of times.
!>
!> A table that may occur several times, such as [[event]], is an array in the file. A setting can replace all of these tables,
!> `event=[{...}, {...}]`, or a key of one of them, selected by its number: `event.2.value=0.5`.
module tandem_io_scene_description
    use tandem, only: atom_type, entries_type, error_type, is_number, reader_type, value_type
    use tandem_io_scene_complete, only: value_to_toml
    use tandem_io_scene_conversion, only: converter_type, position_type
    use tandem_io_scene_source, only: set_input_error, source_type
    use tandem_io_scene_text, only: listed, nearest_name, to_toml
    use tomlf, only: len, toml_array, toml_key, toml_table, toml_value
    implicit none (type, external)
    private

    public :: description_type, key_length

    !> Largest length of the names of tables and keys.
    integer, parameter :: key_length = 32
    !> Prefix of a setting that removes the following key.
    character(len=*), parameter :: unset_option = '--unset '

    !> An entry of the top level.
    type :: root_type
        character(len=:), allocatable :: name
        type(position_type) :: position
        logical :: is_table = .false.
    end type root_type

    type :: description_type
        !> Path of the file; for a text, its name in messages.
        character(len=:), allocatable :: path
        !> All keys with their values.
        type(entries_type) :: entries
        !> First error in tables with subtables; reported by the models that read such tables.
        type(error_type), allocatable :: fault
        !> The file (0) and the settings, in the order in which they were applied.
        type(source_type), allocatable, private :: sources(:)
        !> Positions of the entries.
        type(position_type), allocatable, private :: positions(:)
        !> Entries of the top level.
        type(root_type), allocatable, private :: roots(:)
        !> Known tables; tables that may occur several times, with their numbers; tables with subtables.
        character(len=key_length), allocatable, private :: tables(:), arrays(:), deep(:)
        integer, allocatable, private :: counts(:)
        !> Owner of the tables for messages; empty for a scene.
        character(len=:), allocatable, private :: owner
    contains
        procedure :: open, apply, change, explain, refuse_tables, n_settings
        procedure, private :: merge_source, merge_array, merge_numbered, remove, check_tables, known_tables
    end type description_type

    interface
        !> Remove a key or a table.
        module subroutine remove(self, key, error)
            implicit none (type, external)
            class(description_type), intent(inout) :: self
            !> Names separated by dots, as in TOML; the elements of an array of tables are numbered.
            character(len=*), intent(in) :: key
            !> Set if the key is not given.
            type(error_type), allocatable, intent(out) :: error
        end subroutine remove
    end interface

contains

    !> Read a file and the settings of the command line.
    subroutine open(self, path, settings, tables, arrays, deep, error, text, owner)
        class(description_type), intent(inout) :: self
        !> Path of the file; for a text, its name in messages.
        character(len=*), intent(in) :: path
        !> Settings `table.key=value` or `--unset table.key`, possibly with trailing blanks.
        character(len=*), intent(in) :: settings(:)
        !> Known tables; tables that may occur several times; tables with subtables.
        character(len=*), intent(in) :: tables(:), arrays(:), deep(:)
        type(error_type), allocatable, intent(out) :: error
        !> Text of the description, which replaces the file.
        character(len=*), intent(in), optional :: text
        !> Owner of the tables for messages, such as `sweep`; absent for a scene.
        character(len=*), intent(in), optional :: owner
        type(converter_type) :: converter
        integer :: i

        self%path = path
        self%tables = tables
        self%arrays = arrays
        self%deep = deep
        allocate (self%counts(size(arrays)), source=0)
        allocate (self%sources(0:0), self%roots(0))
        self%owner = ''
        if (present(owner)) self%owner = owner
        if (present(owner)) converter%source%kind = owner
        if (present(text)) then
            call converter%source%load_text(path, text, converter%parsed, error)
        else
            call converter%source%load_file(path, converter%parsed, error)
        end if
        if (allocated(error)) return
        self%sources(0) = converter%source
        call self%merge_source(converter, error)
        do i = 1, size(settings)
            if (allocated(error)) return
            call add_setting(self, trim(settings(i)), error)
        end do
        if (.not. allocated(error)) call self%check_tables(error)
    end subroutine open

    !> Apply one more setting.
    subroutine apply(self, setting, error)
        class(description_type), intent(inout) :: self
        character(len=*), intent(in) :: setting
        type(error_type), allocatable, intent(out) :: error

        call add_setting(self, setting, error)
        if (.not. allocated(error)) call self%check_tables(error)
    end subroutine apply

    !> Add a setting as a source.
    subroutine add_setting(self, setting, error)
        class(description_type), intent(inout) :: self
        character(len=*), intent(in) :: setting
        type(error_type), allocatable, intent(out) :: error
        type(converter_type) :: converter
        type(source_type), allocatable :: sources(:)
        integer :: n

        if (index(setting, unset_option) == 1) then
            call self%remove(trim(adjustl(setting(len(unset_option) + 1:))), error)
            return
        end if
        n = ubound(self%sources, 1) + 1
        call converter%source%load_argument(setting, converter%parsed, error)
        if (allocated(error)) return
        allocate (sources(0:n))
        sources(:n - 1) = self%sources
        sources(n) = converter%source
        call move_alloc(sources, self%sources)
        converter%number = n
        call self%merge_source(converter, error)
    end subroutine add_setting

    !> Add the entries of a source, which replace earlier entries with the same keys.
    subroutine merge_source(self, converter, error)
        class(description_type), intent(inout) :: self
        type(converter_type), intent(inout) :: converter
        type(error_type), allocatable, intent(out) :: error
        type(toml_key), allocatable :: names(:)
        class(toml_value), pointer :: found
        type(root_type) :: root
        integer :: i, array

        if (allocated(self%positions)) call move_alloc(self%positions, converter%positions)
        if (allocated(converter%positions)) converter%n_positions = size(converter%positions)
        allocate (names(0))
        call converter%parsed%root%get_keys(names)
        do i = 1, size(names)
            call converter%parsed%root%get(names(i)%key, found)
            root%name = names(i)%key
            root%position = converter%position_of(found)
            array = findloc(self%arrays == names(i)%key, .true., dim=1)
            root%is_table = array > 0
            if (array > 0) then
                call self%merge_array(converter, array, found, error)
            else
                select type (found)
                type is (toml_table)
                    root%is_table = .true.
                    if (any(self%deep == names(i)%key)) then
                        if (.not. allocated(self%fault)) call converter%add_below(names(i)%key, found, self%entries, self%fault)
                    else
                        call converter%add_keys(names(i)%key, found, self%entries)
                    end if
                end select
            end if
            if (allocated(error)) return
            self%roots = [self%roots, root]
        end do
        if (.not. allocated(converter%positions)) allocate (converter%positions(0))
        self%positions = converter%positions(:converter%n_positions)
    end subroutine merge_source

    !> Add an array of tables.
    subroutine merge_array(self, converter, array, found, error)
        class(description_type), intent(inout) :: self
        type(converter_type), intent(inout) :: converter
        !> Index of the array.
        integer, intent(in) :: array
        class(toml_value), intent(inout) :: found
        type(error_type), allocatable, intent(out) :: error
        class(toml_value), pointer :: member
        character(len=:), allocatable :: name
        logical :: is_good
        integer :: i

        name = trim(self%arrays(array))
        is_good = .false.
        select type (found)
        type is (toml_array)
            call remove_below(self, name)
            self%counts(array) = len(found)
            is_good = .true.
            do i = 1, len(found)
                call found%get(i, member)
                select type (member)
                type is (toml_table)
                    call add_element(self, converter, name//'.'//to_toml(i), member)
                class default
                    is_good = .false.
                end select
            end do
        type is (toml_table)
            is_good = converter%number > 0
            if (is_good) call self%merge_numbered(converter, array, found, error)
        end select
        if (is_good) return
        associate (source => converter%source, position => converter%position_of(found))
            if (source%is_setting) then
                call set_input_error(error, source%describe('"'//name//'" is an array of tables', position%key, &
                    'write '//name//'=[{KEY = VALUE, ...}, ...]'))
            else
                call set_input_error(error, source%describe('"'//name//'" is an array of tables', position%key, &
                    'write [['//name//']] on a line of its own'))
            end if
        end associate
    end subroutine merge_array

    !> Add the keys of an element of an array of tables. The element also has an entry of its own, in case it has no keys.
    subroutine add_element(self, converter, path, table)
        class(description_type), intent(inout) :: self
        type(converter_type), intent(inout) :: converter
        character(len=*), intent(in) :: path
        type(toml_table), intent(inout) :: table
        type(atom_type) :: no_atoms(0)

        call self%entries%set(path, value_type(atoms=no_atoms), source=converter%number)
        call converter%add_keys(path, table, self%entries)
    end subroutine add_element

    !> Set keys of elements selected by their numbers; the number after the last one adds an element.
    subroutine merge_numbered(self, converter, array, table, error)
        class(description_type), intent(inout) :: self
        type(converter_type), intent(inout) :: converter
        integer, intent(in) :: array
        type(toml_table), intent(inout) :: table
        type(error_type), allocatable, intent(out) :: error
        type(toml_key), allocatable :: names(:)
        class(toml_value), pointer :: found
        character(len=:), allocatable :: name, path
        type(position_type) :: position
        type(atom_type) :: no_atoms(0)
        integer :: i, j

        name = trim(self%arrays(array))
        position = converter%position_of(table)
        allocate (names(0))
        call table%get_keys(names)
        associate (n => self%counts(array))
            do i = 1, size(names)
                do j = n + 1, 1, -1
                    if (names(i)%key == to_toml(j)) exit
                end do
                if (j > 0) then
                    call table%get(names(i)%key, found)
                    select type (found)
                    type is (toml_table)
                        path = name//'.'//to_toml(j)
                        if (j > n) call self%entries%set(path, value_type(atoms=no_atoms), source=converter%number)
                        call converter%add_keys(path, found, self%entries)
                        n = max(n, j)
                        cycle
                    end select
                end if
                n = max(n, j)
                call set_input_error(error, converter%source%describe('"'//name//'" is an array of tables; '// &
                    'there are '//to_toml(n), position%key, 'write '//name//'.NUMBER.key=value, with a number from 1 to '// &
                    to_toml(n + 1)//', or '//name//'=[{...}, ...] for all of them'))
                return
            end do
        end associate
    end subroutine merge_numbered

    !> Remove an entry and all entries below it.
    subroutine remove_below(self, name)
        class(description_type), intent(inout) :: self
        character(len=*), intent(in) :: name
        integer :: i

        call self%entries%keep([(index(self%entries%list(i)%key//'.', name//'.') /= 1, i=1, self%entries%n)])
    end subroutine remove_below

    !> Refuse entries of the top level that are not known tables.
    subroutine check_tables(self, error)
        class(description_type), intent(in) :: self
        type(error_type), allocatable, intent(out) :: error
        character(len=:), allocatable :: near, remark
        integer :: i, span(2)

        do i = 1, size(self%roots)
            associate (root => self%roots(i), source => self%sources(self%roots(i)%position%source))
                if (any(self%arrays == root%name)) cycle
                if (any(self%deep == root%name) .or. any(self%tables == root%name)) then
                    if (root%is_table) cycle
                    remark = 'write ['//root%name//'] on a line of its own'
                    span = root%position%key
                    if (any(self%deep == root%name)) then
                        remark = 'write ['//root%name//'] or ['//root%name//'.NAME] on a line of its own'
                        span = root%position%value
                    end if
                    call set_input_error(error, source%describe('"'//root%name//'" is a table', span, remark))
                else
                    near = nearest_name(root%name, [self%tables, self%arrays, self%deep])
                    if (near /= '') near = 'did you mean "'//near//'"?'
                    call set_input_error(error, source%describe('unknown table or key "'//root%name//'"', root%position%key, &
                        near)//new_line('a')//self%known_tables())
                end if
                return
            end associate
        end do
    end subroutine check_tables

    !> Sentence that lists the known tables.
    function known_tables(self) result(text)
        class(description_type), intent(in) :: self
        character(len=:), allocatable :: text

        text = 'tables of a scene: '//listed([self%tables, self%arrays])//'; of a mechanism: '//listed(self%deep)
        if (self%owner /= '') text = 'the tables of a '//self%owner//': '//listed([self%tables, self%arrays])
    end function known_tables

    !> Refuse tables that only other models have.
    subroutine refuse_tables(self, error)
        class(description_type), intent(in) :: self
        type(error_type), allocatable, intent(inout) :: error
        integer :: i

        do i = 1, size(self%roots)
            associate (root => self%roots(i))
                if (.not. any(self%deep == root%name)) cycle
                call set_input_error(error, self%sources(root%position%source)%describe('unknown table or key "'//root%name//'"', &
                    root%position%key, 'it belongs to mechanisms: [scene] model = "mechanism"')//new_line('a')// &
                    'tables of a scene: '//listed([self%tables, self%arrays]))
                return
            end associate
        end do
    end subroutine refuse_tables

    !> Number of settings that set values.
    pure integer function n_settings(self)
        class(description_type), intent(in) :: self

        n_settings = ubound(self%sources, 1)
    end function n_settings

    !> Change the value of a setting and its text.
    subroutine change(self, setting, element, atom)
        class(description_type), intent(inout) :: self
        !> Index of the setting; index of an element if the value is a list, 0 for the whole value.
        integer, intent(in) :: setting, element
        !> New value; a whole number becomes an integer.
        type(atom_type), intent(in) :: atom
        type(atom_type) :: new
        character(len=:), allocatable :: text
        logical :: has_whole
        integer :: k

        do k = self%entries%n, 1, -1
            if (self%entries%list(k)%source == setting .and. self%entries%list(k)%place > 0) exit
        end do
        if (k == 0) return
        text = self%sources(setting)%text
        associate (entry => self%entries%list(k))
            if (max(1, element) > size(entry%value%atoms)) return
            new = atom
            if (new%kind == is_number) new%is_whole = is_whole(new%number)
            entry%value%atoms(max(1, element)) = new
            entry%given = entry%value
            ! A whole number is written without a decimal point if the setting had none.
            has_whole = verify(text(index(text, '=') + 1:), '+-0123456789 '//new_line('a')) == 0
            text = text(:index(text, '='))//value_to_toml(entry%value, has_whole .and. new%is_whole)
            self%positions(entry%place)%value = [index(text, '=') + 1, len(text)]
        end associate
        self%sources(setting)%text = text//new_line('a')
    end subroutine change

    !> True if a number is whole and exactly representable as an integer.
    pure logical function is_whole(number)
        use tandem, only: wp
        real(wp), intent(in) :: number

        is_whole = abs(number) <= 2.0_wp**53 .and. .not. abs(number - anint(number)) > 0.0_wp
    end function is_whole

    !> Convert the error of a reader to a message that shows the line.
    subroutine explain(self, reader, error)
        class(description_type), intent(in) :: self
        type(reader_type), intent(inout) :: reader
        type(error_type), allocatable, intent(out) :: error
        character(len=:), allocatable :: text

        if (.not. allocated(reader%fault)) then
            call move_alloc(reader%error, error)
            return
        end if
        associate (fault => reader%fault)
            if (reader%place > 0) then
                associate (position => self%positions(reader%place))
                    if (fault%is_at_key) then
                        text = self%sources(position%source)%describe(fault%message, position%key, fault%remark)
                    else
                        text = self%sources(position%source)%describe(fault%message, position%value, fault%remark)
                    end if
                end associate
                if (fault%tail /= '') text = text//new_line('a')//fault%tail
            else if (fault%heading /= '') then
                text = fault%message//new_line('a')//' --> '//fault%heading//' of '//self%sources(0)%name
            else
                text = fault%message//' of '//self%sources(fault%source)%name
            end if
        end associate
        call set_input_error(error, text)
    end subroutine explain
end module tandem_io_scene_description
