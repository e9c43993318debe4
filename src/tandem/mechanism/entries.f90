! SPDX-License-Identifier: MIT
!> A mechanism as a list of dotted keys with values, such as `body.rod.mass` = 1, as given in files or by programs in other
!> languages. Texts in place of numbers are expressions of the parameters. Setting a key again replaces its value.
module tandem_mechanism_entries
    use tandem_kinds, only: wp
    use tandem_mechanism_expression_parser, only: name_length
    use tandem_name_index, only: longest_name, name_index_type
    implicit none (type, external)
    private

    public :: atom_type, value_type, entry_type, entries_type, is_number, is_text, is_truth, is_other, number_value, text_value, &
        truth_value

    !> Types of items.
    integer, parameter :: is_number = 1, is_text = 2, is_truth = 3, is_other = 4

    !> Item of a value: a number, a text or a logical value.
    type :: atom_type
        integer :: kind = is_number
        real(wp) :: number = 0.0_wp
        !> True for a number written without decimal point and exponent.
        logical :: is_whole = .false.
        logical :: truth = .false.
        !> Text; for `is_other`, the type of the value in words, such as `a table`.
        character(len=:), allocatable :: text
        !> Reason for which the value is invalid; not allocated for a valid value.
        character(len=:), allocatable :: problem
    end type atom_type

    !> A value: one item, or a list of items.
    type :: value_type
        logical :: is_list = .false.
        !> Row length of a list of lists, whose items are stored row by row in one list; 0 for other values.
        integer :: row_length = 0
        type(atom_type), allocatable :: atoms(:)
    end type value_type

    !> A key with its value.
    type :: entry_type
        !> The key, parts joined by dots.
        character(len=:), allocatable :: key
        type(value_type) :: value
        !> Position of the entry, as numbered by the caller; source that gives the value: 0 is the description, i the i-th setting.
        integer :: place = 0, source = 0
        !> Value as given, in which the indices of a repeated element occur by name.
        type(value_type) :: given
        !> For an element of a repetition: names and values of the indices; key as given, and length of the element's name in this
        !> key; true for the first copy.
        character(len=name_length), allocatable :: index_names(:)
        integer, allocatable :: index_values(:)
        character(len=:), allocatable :: template
        integer :: n_heading = 0
        logical :: is_first = .true.
    end type entry_type

    !> Keys with values, in the order in which they were given.
    type :: entries_type
        !> The entries; the first `n` of the array are used.
        type(entry_type), allocatable :: list(:)
        integer :: n = 0
        !> Indices of the keys in the list.
        type(name_index_type), private :: places
    contains
        generic :: set => set_value, set_number, set_text, set_truth, set_numbers, set_texts
        procedure :: append, find, keep, of_tables, number_at, truth_at
        procedure, private :: set_value, set_number, set_text, set_truth, set_numbers, set_texts
    end type entries_type

contains

    !> A number as a value.
    pure function number_value(number) result(value)
        real(wp), intent(in) :: number
        type(value_type) :: value

        allocate (value%atoms(1))
        value%atoms(1)%number = number
    end function number_value

    !> A text as a value.
    pure function text_value(text) result(value)
        character(len=*), intent(in) :: text
        type(value_type) :: value

        allocate (value%atoms(1))
        value%atoms(1)%kind = is_text
        value%atoms(1)%text = text
    end function text_value

    !> A truth value as a value.
    pure function truth_value(truth) result(value)
        logical, intent(in) :: truth
        type(value_type) :: value

        allocate (value%atoms(1))
        value%atoms(1)%kind = is_truth
        value%atoms(1)%truth = truth
    end function truth_value

    !> Remove entries that are not marked.
    pure subroutine keep(self, mask)
        class(entries_type), intent(inout) :: self
        !> (n)
        logical, intent(in) :: mask(:)
        type(entries_type) :: kept
        integer :: i

        do i = 1, self%n
            if (mask(i)) call kept%append(self%list(i))
        end do
        call move_alloc(kept%list, self%list)
        self%n = kept%n
        self%places = kept%places
    end subroutine keep

    !> Index of the entry of a key; 0 if absent.
    pure integer function find(self, key)
        class(entries_type), intent(in) :: self
        character(len=*), intent(in) :: key

        if (len(key) <= longest_name) then
            find = self%places%get(key)
            return
        end if
        do find = self%n, 1, -1
            if (len(self%list(find)%key) /= len(key)) cycle
            if (self%list(find)%key == key) return
        end do
    end function find

    !> Copy the entries of some tables.
    pure subroutine of_tables(self, tables, entries)
        class(entries_type), intent(in) :: self
        character(len=*), intent(in) :: tables(:)
        type(entries_type), intent(out) :: entries
        integer :: i

        do i = 1, self%n
            associate (key => self%list(i)%key)
                if (any(tables == key(:index(key//'.', '.') - 1))) call entries%append(self%list(i))
            end associate
        end do
    end subroutine of_tables

    !> Number given by a key; 0 if absent.
    pure real(wp) function number_at(self, key) result(number)
        class(entries_type), intent(in) :: self
        !> Key including its table, such as `time.end`.
        character(len=*), intent(in) :: key
        integer :: k

        number = 0.0_wp
        k = self%find(key)
        if (k == 0) return
        associate (value => self%list(k)%value)
            if (value%is_list) return
            if (.not. allocated(value%atoms(1)%problem)) number = value%atoms(1)%number
        end associate
    end function number_at

    !> True if a key is given and has the value true.
    pure logical function truth_at(self, key) result(truth)
        class(entries_type), intent(in) :: self
        character(len=*), intent(in) :: key
        integer :: k

        truth = .false.
        k = self%find(key)
        if (k == 0) return
        if (.not. self%list(k)%value%is_list) truth = self%list(k)%value%atoms(1)%truth
    end function truth_at

    !> Set the value of a key.
    pure subroutine set_value(self, key, value, place, source)
        class(entries_type), intent(inout) :: self
        character(len=*), intent(in) :: key
        type(value_type), intent(in) :: value
        !> Position and source of the entry.
        integer, intent(in), optional :: place, source
        type(entry_type) :: entry
        integer :: i

        entry%key = trim(key)
        entry%value = value
        entry%given = value
        if (present(place)) entry%place = place
        if (present(source)) entry%source = source
        i = self%find(entry%key)
        if (i > 0) then
            self%list(i) = entry
        else
            call self%append(entry)
        end if
    end subroutine set_value

    !> Append an entry with a new key.
    pure subroutine append(self, entry)
        class(entries_type), intent(inout) :: self
        type(entry_type), intent(in) :: entry
        type(entry_type), allocatable :: longer(:)

        if (.not. allocated(self%list)) allocate (self%list(32))
        if (self%n == size(self%list)) then
            allocate (longer(2*self%n))
            longer(:self%n) = self%list
            call move_alloc(longer, self%list)
        end if
        self%n = self%n + 1
        self%list(self%n) = entry
        call self%places%put(entry%key, self%n)
    end subroutine append

    pure subroutine set_number(self, key, value, place)
        class(entries_type), intent(inout) :: self
        character(len=*), intent(in) :: key
        real(wp), intent(in) :: value
        integer, intent(in), optional :: place

        call self%set_value(key, number_value(value), place)
    end subroutine set_number

    pure subroutine set_text(self, key, value, place)
        class(entries_type), intent(inout) :: self
        character(len=*), intent(in) :: key, value
        integer, intent(in), optional :: place

        call self%set_value(key, text_value(value), place)
    end subroutine set_text

    pure subroutine set_truth(self, key, value, place)
        class(entries_type), intent(inout) :: self
        character(len=*), intent(in) :: key
        logical, intent(in) :: value
        integer, intent(in), optional :: place
        call self%set_value(key, truth_value(value), place)
    end subroutine set_truth

    pure subroutine set_numbers(self, key, value, place)
        class(entries_type), intent(inout) :: self
        character(len=*), intent(in) :: key
        real(wp), intent(in) :: value(:)
        integer, intent(in), optional :: place
        type(value_type) :: several

        several%is_list = .true.
        allocate (several%atoms(size(value)))
        several%atoms%number = value
        call self%set_value(key, several, place)
    end subroutine set_numbers

    !> Set texts without their trailing blanks.
    pure subroutine set_texts(self, key, value, place)
        class(entries_type), intent(inout) :: self
        character(len=*), intent(in) :: key, value(:)
        integer, intent(in), optional :: place
        type(value_type) :: several
        integer :: i

        several%is_list = .true.
        allocate (several%atoms(size(value)))
        several%atoms%kind = is_text
        do i = 1, size(value)
            several%atoms(i)%text = trim(value(i))
        end do
        call self%set_value(key, several, place)
    end subroutine set_texts
end module tandem_mechanism_entries
