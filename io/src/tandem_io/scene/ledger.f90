! SPDX-License-Identifier: MIT
!> Record of a reader: every key read, with its value. It provides the list of valid keys, and the complete scene as text.
module tandem_io_scene_ledger
    implicit none (type, external)
    private

    public :: ledger_type, key_length, heading

    !> Length of the names of tables and keys.
    integer, parameter :: key_length = 32
    !> Column at which comments begin if the value leaves room.
    integer, parameter :: comment_column = 34

    !> A key, its value as TOML, and a comment.
    type :: entry_type
        character(len=:), allocatable :: table, key
        !> Number of the table in an array of tables, 0 for a table of its own.
        integer :: element = 0
        character(len=:), allocatable :: value, comment
        !> The unit, if known.
        character(len=key_length) :: unit = ''
        !> The source that gave it, negative for a default.
        integer :: source = -1
        !> True if the entry belongs to the complete scene.
        logical :: shown = .true.
    end type entry_type

    type :: ledger_type
        private
        !> The first `n` are in use.
        type(entry_type), allocatable :: entries(:)
        integer :: n = 0
    contains
        procedure :: add, hide, keys, text, unit_of, value_of
    end type ledger_type

contains

    !> Add a key, or a line of comment where `key` is empty.
    subroutine add(self, table, key, value, comment, source, shown, element, unit)
        class(ledger_type), intent(inout) :: self
        character(len=*), intent(in) :: table, key
        !> The value as TOML.
        character(len=*), intent(in) :: value
        !> Unit and meaning.
        character(len=*), intent(in) :: comment
        !> The source that gave it, negative for a default.
        integer, intent(in) :: source
        !> True if the entry belongs to the complete scene; default true.
        logical, intent(in), optional :: shown
        !> Number of the table in an array of tables.
        integer, intent(in), optional :: element
        !> Its unit alone.
        character(len=*), intent(in), optional :: unit
        type(entry_type) :: entry
        type(entry_type), allocatable :: more(:)

        entry%table = trim(table)
        entry%key = trim(key)
        entry%value = value
        entry%comment = comment
        entry%source = source
        if (present(shown)) entry%shown = shown
        if (present(element)) entry%element = element
        if (present(unit)) entry%unit = unit
        if (.not. allocated(self%entries)) allocate (self%entries(64))
        if (self%n == size(self%entries)) then
            allocate (more(2*self%n))
            more(:self%n) = self%entries
            call move_alloc(more, self%entries)
        end if
        self%n = self%n + 1
        self%entries(self%n) = entry
    end subroutine add

    !> Exclude the present keys of a table from the complete scene.
    subroutine hide(self, table, source, given)
        class(ledger_type), intent(inout) :: self
        character(len=*), intent(in) :: table
        !> Whatever replaces them comes from this source.
        integer, intent(in) :: source
        !> One of them that this source or a later one gives, empty if there is none.
        character(len=key_length), intent(out) :: given
        integer :: i

        given = ''
        do i = 1, self%n
            if (self%entries(i)%table /= table) cycle
            self%entries(i)%shown = .false.
            if (self%entries(i)%source >= source) given = self%entries(i)%key
        end do
    end subroutine hide

    !> The keys of a table.
    pure function keys(self, table, element)
        class(ledger_type), intent(in) :: self
        character(len=*), intent(in) :: table
        !> Its number in an array of tables, 0 for a table of its own.
        integer, intent(in) :: element
        character(len=key_length), allocatable :: keys(:)
        integer :: i, n

        n = 0
        do i = 1, self%n
            if (belongs(self%entries(i))) n = n + 1
        end do
        allocate (keys(n))
        n = 0
        do i = 1, self%n
            if (.not. belongs(self%entries(i))) cycle
            n = n + 1
            keys(n) = self%entries(i)%key
        end do
    contains
        !> True if an entry is a key of the table.
        pure logical function belongs(entry)
            type(entry_type), intent(in) :: entry

            belongs = entry%table == table .and. entry%element == element .and. entry%key /= ''
        end function belongs
    end function keys

    !> The unit of a key, blank if unknown.
    pure function unit_of(self, table, key) result(unit)
        class(ledger_type), intent(in) :: self
        character(len=*), intent(in) :: table, key
        character(len=key_length) :: unit
        integer :: i

        unit = ''
        do i = 1, self%n
            if (self%entries(i)%table == table .and. self%entries(i)%key == key) unit = self%entries(i)%unit
        end do
    end function unit_of

    !> The value of a key as TOML, empty if there is none.
    pure function value_of(self, table, key) result(value)
        class(ledger_type), intent(in) :: self
        character(len=*), intent(in) :: table, key
        character(len=:), allocatable :: value
        integer :: i

        value = ''
        do i = 1, self%n
            if (self%entries(i)%table == table .and. self%entries(i)%key == key) value = self%entries(i)%value
        end do
    end function value_of

    !> The complete scene as TOML.
    pure function text(self)
        class(ledger_type), intent(in) :: self
        character(len=:), allocatable :: text
        character(len=:), allocatable :: part, table
        integer :: i, element, length, pass

        ! Once for the length, once for the text.
        do pass = 1, 2
            length = 0
            table = ''
            element = 0
            do i = 1, self%n
                associate (entry => self%entries(i))
                    if (.not. entry%shown) cycle
                    part = line_of(entry)
                    if (entry%table /= table .or. entry%element /= element) then
                        part = heading(entry%table, entry%element)//new_line('a')//part
                        if (table /= '') part = new_line('a')//part
                        table = entry%table
                        element = entry%element
                    end if
                end associate
                if (pass == 2) text(length + 1:length + len(part)) = part
                length = length + len(part)
            end do
            if (pass == 1) allocate (character(len=length) :: text)
        end do
    end function text

    !> The line of an entry, with its end.
    pure function line_of(entry) result(line)
        type(entry_type), intent(in) :: entry
        character(len=:), allocatable :: line

        line = ''
        if (entry%key /= '') line = trim(entry%key)//' = '//entry%value
        if (entry%comment /= '') then
            if (line /= '') line = line//repeat(' ', max(0, comment_column - 3 - len(line)))//'  '
            line = line//'# '//entry%comment
        end if
        line = line//new_line('a')
    end function line_of

    !> The heading of a table.
    pure function heading(table, element)
        character(len=*), intent(in) :: table
        !> Its number in an array of tables, 0 for a table of its own.
        integer, intent(in) :: element
        character(len=:), allocatable :: heading

        heading = '['//trim(table)//']'
        if (element > 0) heading = '['//heading//']'
    end function heading
end module tandem_io_scene_ledger
