! SPDX-License-Identifier: MIT
!> What a reader has read: every key with its value. It is the list of the keys that exist, and the complete scene as text.
module tandem_io_scene_ledger
    implicit none (type, external)
    private

    public :: ledger_type, key_length, heading

    !> Length of the names of tables and keys.
    integer, parameter :: key_length = 32
    !> Column at which comments begin where the value leaves room.
    integer, parameter :: comment_column = 34

    !> A key, its value as TOML, and a comment.
    type :: entry_type
        character(len=key_length) :: table = '', key = ''
        !> Number of the table in an array of tables, 0 for a table of its own.
        integer :: element = 0
        character(len=:), allocatable :: value, comment
        !> The source that gave it, negative for a default.
        integer :: source = -1
        !> Whether it belongs to the complete scene.
        logical :: shown = .true.
    end type entry_type

    type :: ledger_type
        private
        type(entry_type), allocatable :: entries(:)
    contains
        procedure :: add
        procedure :: hide
        procedure :: keys
        procedure :: text
    end type ledger_type

contains

    !> Add a key, or a line of comment where `key` is empty.
    subroutine add(self, table, key, value, comment, source, shown, element)
        class(ledger_type), intent(inout) :: self
        character(len=*), intent(in) :: table, key
        !> The value as TOML.
        character(len=*), intent(in) :: value
        !> Unit and meaning.
        character(len=*), intent(in) :: comment
        !> The source that gave it, negative for a default.
        integer, intent(in) :: source
        !> Whether it belongs to the complete scene; default true.
        logical, intent(in), optional :: shown
        !> Number of the table in an array of tables.
        integer, intent(in), optional :: element
        type(entry_type) :: entry

        entry%table = table
        entry%key = key
        entry%value = value
        entry%comment = comment
        entry%source = source
        if (present(shown)) entry%shown = shown
        if (present(element)) entry%element = element
        if (.not. allocated(self%entries)) allocate (self%entries(0))
        self%entries = [self%entries, entry]
    end subroutine add

    !> Leave the keys that a table has by now out of the complete scene.
    subroutine hide(self, table, source, given)
        class(ledger_type), intent(inout) :: self
        character(len=*), intent(in) :: table
        !> Whatever replaces them comes from this source.
        integer, intent(in) :: source
        !> One of them that this source or a later one gives, empty where there is none.
        character(len=key_length), intent(out) :: given
        integer :: i

        given = ''
        if (.not. allocated(self%entries)) return
        do i = 1, size(self%entries)
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
        if (allocated(self%entries)) n = count([(belongs(self%entries(i)), i=1, size(self%entries))])
        allocate (keys(n))
        if (n == 0) return
        n = 0
        do i = 1, size(self%entries)
            if (.not. belongs(self%entries(i))) cycle
            n = n + 1
            keys(n) = self%entries(i)%key
        end do
    contains
        !> Whether an entry is a key of the table.
        pure logical function belongs(entry)
            type(entry_type), intent(in) :: entry

            belongs = entry%table == table .and. entry%element == element .and. entry%key /= ''
        end function belongs
    end function keys

    !> The complete scene as TOML.
    pure function text(self)
        class(ledger_type), intent(in) :: self
        character(len=:), allocatable :: text
        character(len=:), allocatable :: line
        character(len=key_length) :: table
        integer :: i, element

        text = ''
        table = ''
        element = 0
        if (.not. allocated(self%entries)) return
        do i = 1, size(self%entries)
            associate (entry => self%entries(i))
                if (.not. entry%shown) cycle
                if (entry%table /= table .or. entry%element /= element) then
                    if (table /= '') text = text//new_line('a')
                    text = text//heading(entry%table, entry%element)//new_line('a')
                    table = entry%table
                    element = entry%element
                end if
                line = ''
                if (entry%key /= '') line = trim(entry%key)//' = '//entry%value
                if (entry%comment /= '') then
                    if (line /= '') line = line//repeat(' ', max(0, comment_column - 3 - len(line)))//'  '
                    line = line//'# '//entry%comment
                end if
                text = text//line//new_line('a')
            end associate
        end do
    end function text

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
