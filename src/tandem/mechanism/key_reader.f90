! SPDX-License-Identifier: MIT
!> Reads the keys of a mechanism, element by element: one call a key gives its value, checks it, and remembers it with its unit and
!> meaning. Thus the same calls make the mechanism, the list of the keys that exist, and the complete mechanism with all defaults.
!>
!> The first error is kept, with the place of the entry that it is about, and the calls after it do nothing.
module tandem_mechanism_key_reader
    use tandem_error, only: error_type, set_error, to_text
    use tandem_kinds, only: wp
    use tandem_mechanism_entries, only: atom_type, entries_type, entry_type, is_number, is_text, is_truth, number_value, &
        text_value, value_type
    use tandem_mechanism_expression, only: expression_type, parse_expression
    use tandem_mechanism_function, only: constant_type, expression_function, function_type, table_function
    use tandem_mechanism_law, only: expression_law, law_type, table_law
    use tandem_mechanism_table_function, only: table_type
    use tandem_names, only: question
    use tandem_status, only: status_invalid_model
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)
    private

    public :: key_reader_type, shown_type, anything, positive, not_negative, key_length, joined

    !> What a number may be.
    integer, parameter :: anything = 0, positive = 1, not_negative = 2
    !> Length of the names of kinds, of elements and of keys.
    integer, parameter :: key_length = 64

    !> A line of the complete mechanism.
    type :: shown_type
        !> Such as `body.rod`, and `mass`; a repeated element stands under its template.
        character(len=:), allocatable :: table, key
        type(value_type) :: value
        !> Unit and meaning.
        character(len=:), allocatable :: comment
    end type shown_type

    !> The entries of an element.
    type :: element_type
        character(len=key_length) :: kind = '', name = ''
        integer, allocatable :: entries(:)
        integer :: n = 0
    end type element_type

    !> Who reads the keys of one element after the other, checks them, and keeps the first error.
    type :: key_reader_type
        !> The first error, and the place of its entry, 0 for none.
        type(error_type), allocatable :: error
        integer :: place = 0
        !> Parameters and their values.
        character(len=key_length), allocatable :: names(:)
        real(wp), allocatable :: values(:)
        !> The complete mechanism, as far as it was read: the first `n_shown`.
        type(shown_type), allocatable :: shown(:)
        integer :: n_shown = 0
        !> The name of the element that is open.
        character(len=:), allocatable :: name
        type(entries_type), private :: entries
        type(element_type), allocatable, private :: elements(:)
        integer, private :: n_elements = 0, current = 0
        logical, allocatable, private :: used(:)
        character(len=key_length), allocatable, private :: known(:)
        !> Tables that functions and laws may name.
        character(len=key_length), allocatable, private :: table_names(:)
        type(table_type), allocatable, private :: tables(:)
    contains
        procedure :: take
        procedure :: n_of
        procedure :: open
        procedure :: close
        procedure :: blame
        procedure :: blame_named
        procedure, private :: place_in
        procedure :: failed
        procedure :: fail
        procedure :: refuse
        procedure :: gives
        procedure :: is_text_at
        procedure :: keys_below
        procedure :: get_number
        procedure :: get_numbers
        procedure :: get_text
        procedure :: get_choice
        procedure :: get_texts
        procedure :: get_truth
        procedure :: pass
        procedure :: count_of
        procedure :: add_table
        procedure, private :: table_at
        procedure :: get_function
        procedure :: get_law
        procedure :: get_expressions
        procedure :: evaluate_text
        procedure :: show
        procedure, private :: evaluate
        procedure, private :: find
        procedure, private :: index_of
        procedure, private :: remember
        procedure, private :: constants
        procedure, private :: fail_at
    end type key_reader_type

contains

    !> Take the entries, in which nothing is repeated any more, and sort them to elements.
    subroutine take(self, entries, kinds, singles)
        class(key_reader_type), intent(inout) :: self
        type(entries_type), intent(in) :: entries
        !> The kinds of elements: those with a name, and those that there are once.
        character(len=*), intent(in) :: kinds(:), singles(:)
        character(len=:), allocatable :: key, kind, name
        integer :: i, j, k

        self%entries = entries
        allocate (self%elements(16))
        allocate (self%used(entries%n), source=.false.)
        self%n_elements = 0
        k = 0
        do i = 1, entries%n
            if (self%failed()) return
            key = entries%list(i)%key
            kind = up_to_dot(key)
            name = ''
            if (any(kinds == kind)) then
                key = key(min(len(kind) + 2, len(key) + 1):)
                name = up_to_dot(key)
                if (len(name) == 0 .or. len(name) == len(key)) then
                    call self%fail_at(i, entries%list(i)%key//' is no value but has keys below it', &
                        'write '//kind//'.NAME.KEY = ...')
                    return
                end if
            else if (.not. any(singles == kind)) then
                call self%fail_at(i, 'there is nothing called "'//kind//'" in a mechanism'//question(kind, [kinds, singles]), &
                    'take one of'//listed([kinds, singles]))
                return
            else if (len(kind) == len(key)) then
                call self%fail_at(i, kind//' is no value but has keys below it', 'write '//kind//'.KEY = ...')
                return
            end if
            if (k > 0) then
                if (self%elements(k)%kind /= kind .or. self%elements(k)%name /= name) k = 0
            end if
            if (k == 0) call find_element(self, kind, name, k)
            do j = 1, self%elements(k)%n
                if (entries%list(self%elements(k)%entries(j))%key /= entries%list(i)%key) cycle
                call self%fail_at(i, entries%list(i)%key//' is there twice', 'take other names in what is repeated')
                return
            end do
            call add_to(self%elements(k), i)
        end do
    end subroutine take

    !> The element of a name, a new one where there is none.
    subroutine find_element(self, kind, name, k)
        class(key_reader_type), intent(inout) :: self
        character(len=*), intent(in) :: kind, name
        integer, intent(out) :: k
        type(element_type), allocatable :: longer(:)

        do k = 1, self%n_elements
            if (self%elements(k)%kind == kind .and. self%elements(k)%name == name) return
        end do
        if (k > size(self%elements)) then
            allocate (longer(2*size(self%elements)))
            longer(:size(self%elements)) = self%elements
            call move_alloc(longer, self%elements)
        end if
        self%n_elements = k
        self%elements(k)%kind = kind
        self%elements(k)%name = name
        allocate (self%elements(k)%entries(8))
    end subroutine find_element

    pure subroutine add_to(element, entry)
        type(element_type), intent(inout) :: element
        integer, intent(in) :: entry

        if (element%n == size(element%entries)) element%entries = [element%entries, element%entries]
        element%n = element%n + 1
        element%entries(element%n) = entry
    end subroutine add_to

    !> How many elements of a kind there are.
    pure integer function n_of(self, kind)
        class(key_reader_type), intent(in) :: self
        character(len=*), intent(in) :: kind

        n_of = count(self%elements(:self%n_elements)%kind == kind)
    end function n_of

    !> The calls of `get` that follow are about this element. One that there is once may have no entries at all.
    subroutine open(self, kind, number)
        class(key_reader_type), intent(inout) :: self
        character(len=*), intent(in) :: kind
        !> Which one of its kind.
        integer, intent(in) :: number
        integer :: k, n

        if (self%failed()) return
        n = 0
        do k = 1, self%n_elements
            if (self%elements(k)%kind == kind) n = n + 1
            if (n == number) exit
        end do
        if (k > self%n_elements) call find_element(self, kind, '', k)
        self%current = k
        self%name = trim(self%elements(self%current)%name)
        self%known = [character(len=key_length) ::]
    end subroutine open

    !> All keys of the element have been asked for: refuse the others.
    subroutine close(self)
        class(key_reader_type), intent(inout) :: self
        character(len=:), allocatable :: key
        integer :: i, k

        if (self%failed()) return
        associate (element => self%elements(self%current))
            do i = 1, element%n
                k = element%entries(i)
                if (self%used(k)) cycle
                key = key_of(self%entries%list(k), element)
                call self%fail_at(k, 'unknown key "'//key//'" of '//path_of(element)//question(key, self%known), &
                    'its keys are'//listed(self%known))
                return
            end do
        end associate
    end subroutine close

    !> Whether an error was met.
    pure logical function failed(self)
        class(key_reader_type), intent(in) :: self

        failed = allocated(self%error)
    end function failed

    !> An error about a key of the element; about the element where the key is not given.
    subroutine fail(self, key, problem, advice)
        class(key_reader_type), intent(inout) :: self
        character(len=*), intent(in) :: key, problem, advice
        integer :: k

        if (self%failed()) return
        k = self%find(key)
        associate (element => self%elements(self%current))
            if (k > 0) then
                call self%fail_at(k, self%entries%list(k)%key//': '//problem, advice)
            else
                if (element%n > 0) k = element%entries(1)
                call self%fail_at(k, path_of(element)//merge('.', ' ', key /= '')//key//': '//problem, advice)
            end if
        end associate
    end subroutine fail

    !> An error about no key of an element; `place` stays as it is.
    subroutine refuse(self, problem, advice)
        class(key_reader_type), intent(inout) :: self
        character(len=*), intent(in) :: problem, advice

        call self%fail_at(0, problem, advice)
    end subroutine refuse

    !> Keep the error of a word, which names the element: its place is that of the key, or of the text, that the message names.
    subroutine blame(self, error)
        class(key_reader_type), intent(inout) :: self
        type(error_type), allocatable, intent(inout) :: error

        if (.not. allocated(error) .or. self%failed()) return
        call move_alloc(error, self%error)
        self%place = self%place_in(self%elements(self%current))
    end subroutine blame

    !> Keep the error of what is made of all elements: its place is in the one that the message names.
    subroutine blame_named(self, error)
        class(key_reader_type), intent(inout) :: self
        type(error_type), allocatable, intent(inout) :: error
        integer :: k

        if (.not. allocated(error) .or. self%failed()) return
        call move_alloc(error, self%error)
        self%place = 0
        do k = 1, self%n_elements
            if (self%elements(k)%name == '') cycle
            if (says(self%error%message, trim(self%elements(k)%name))) self%place = self%place_in(self%elements(k))
            if (self%place > 0) return
        end do
    end subroutine blame_named

    !> Where in an element the error is: at a key that the message names, else at a text that it names, else at the first key.
    pure integer function place_in(self, element) result(place)
        class(key_reader_type), intent(in) :: self
        type(element_type), intent(in) :: element
        integer :: i, j, k

        place = 0
        if (element%n > 0) place = self%entries%list(element%entries(1))%place
        do i = element%n, 1, -1
            k = element%entries(i)
            associate (atoms => self%entries%list(k)%value%atoms)
                do j = 1, size(atoms)
                    if (atoms(j)%kind /= is_text) cycle
                    if (says(self%error%message, up_to_dot(atoms(j)%text))) place = self%entries%list(k)%place
                end do
            end associate
        end do
        do i = element%n, 1, -1
            k = element%entries(i)
            if (says(self%error%message, key_of(self%entries%list(k), element))) place = self%entries%list(k)%place
        end do
    end function place_in

    !> Whether a message has a word.
    pure logical function says(message, word)
        character(len=*), intent(in) :: message, word

        says = scan_word(' ') .or. scan_word(':') .or. scan_word(';') .or. scan_word(',')

    contains

        !> Whether it stands before a sign.
        pure logical function scan_word(sign)
            character(len=1), intent(in) :: sign

            scan_word = index(' '//message, ' '//word//sign) > 0
        end function scan_word
    end function says

    !> An error about an entry, 0 for none.
    subroutine fail_at(self, entry, problem, advice)
        class(key_reader_type), intent(inout) :: self
        integer, intent(in) :: entry
        character(len=*), intent(in) :: problem, advice

        if (self%failed()) return
        call set_error(self%error, status_invalid_model, problem, advice)
        if (entry > 0) self%place = self%entries%list(entry)%place
    end subroutine fail_at

    !> Whether a key of the element is given.
    pure logical function gives(self, key)
        class(key_reader_type), intent(in) :: self
        character(len=*), intent(in) :: key

        gives = self%find(key) > 0
    end function gives

    !> Whether a key of the element is given by one text.
    pure logical function is_text_at(self, key)
        class(key_reader_type), intent(in) :: self
        character(len=*), intent(in) :: key
        integer :: k

        k = self%find(key)
        is_text_at = k > 0
        if (k == 0) return
        associate (value => self%entries%list(k)%value)
            is_text_at = .not. value%is_list
            if (is_text_at) is_text_at = value%atoms(1)%kind == is_text
        end associate
    end function is_text_at

    !> The names below a key of the element, which now count as known.
    subroutine keys_below(self, key, names)
        class(key_reader_type), intent(inout) :: self
        character(len=*), intent(in) :: key
        character(len=key_length), allocatable, intent(out) :: names(:)
        character(len=:), allocatable :: its
        integer :: i

        names = [character(len=key_length) ::]
        if (self%failed()) return
        self%known = [character(len=key_length) :: self%known, key]
        associate (element => self%elements(self%current))
            do i = 1, element%n
                its = key_of(self%entries%list(element%entries(i)), element)
                if (index(its, key//'.') == 1) names = [character(len=key_length) :: names, its(len(key) + 2:)]
            end do
        end associate
    end subroutine keys_below

    !> A number, or an expression of parameters; the value stays as it is where the key is not given.
    subroutine get_number(self, key, value, check, unit, help, required)
        class(key_reader_type), intent(inout) :: self
        character(len=*), intent(in) :: key
        !> The default before, the value after; not allocated where there is none.
        real(wp), allocatable, intent(inout) :: value
        integer, intent(in), optional :: check
        character(len=*), intent(in), optional :: unit, help
        logical, intent(in), optional :: required
        integer :: k
        real(wp) :: number

        k = self%index_of(key, required)
        if (k > 0) then
            associate (given => self%entries%list(k)%value)
                if (given%is_list) call self%fail(key, 'is a list', 'give one number, or an expression as text')
                if (self%failed()) return
                call self%evaluate(k, given%atoms(1), number)
                if (self%failed()) return
                call check_number(self, key, number, check)
                value = number
            end associate
        end if
        if (allocated(value)) call self%remember(key, k, number_value(value), unit, help)
    end subroutine get_number

    !> A list of numbers or expressions of one of some lengths.
    subroutine get_numbers(self, key, lengths, values, check, unit, help, required)
        class(key_reader_type), intent(inout) :: self
        character(len=*), intent(in) :: key
        !> How many there may be; a single number will do where that is 1.
        integer, intent(in) :: lengths(:)
        !> The default before, the values after; not allocated where there are none.
        real(wp), allocatable, intent(inout) :: values(:)
        integer, intent(in), optional :: check
        character(len=*), intent(in), optional :: unit, help
        logical, intent(in), optional :: required
        character(len=:), allocatable :: allowed
        type(value_type) :: shown
        integer :: k, i, n

        k = self%index_of(key, required)
        if (k > 0) then
            n = size(self%entries%list(k)%value%atoms)
            if (.not. any(lengths == n)) then
                allowed = to_text(lengths(1))
                do i = 2, size(lengths)
                    allowed = allowed//' or '//to_text(lengths(i))
                end do
                call self%fail(key, 'has '//to_text(n)//trim(merge(' entry  ', ' entries', n == 1)), 'give '//allowed)
                return
            end if
            if (allocated(values)) deallocate (values)
            allocate (values(n))
            do i = 1, n
                call self%evaluate(k, self%entries%list(k)%value%atoms(i), values(i))
                if (self%failed()) return
                call check_number(self, key, values(i), check)
            end do
        end if
        if (.not. allocated(values)) return
        shown%is_list = .true.
        allocate (shown%atoms(size(values)))
        shown%atoms%number = values
        call self%remember(key, k, shown, unit, help)
    end subroutine get_numbers

    !> Refuse a number that is out of its range.
    subroutine check_number(self, key, number, check)
        class(key_reader_type), intent(inout) :: self
        character(len=*), intent(in) :: key
        real(wp), intent(in) :: number
        integer, intent(in), optional :: check

        if (.not. present(check)) return
        if (check == positive .and. .not. number > 0.0_wp) then
            call self%fail(key, 'is '//to_text(number), 'give a number > 0')
        else if (check == not_negative .and. .not. number >= 0.0_wp) then
            call self%fail(key, 'is '//to_text(number), 'give a number >= 0')
        end if
    end subroutine check_number

    !> A text; where it is not given and has no default, it is not allocated.
    subroutine get_text(self, key, text, help, required)
        class(key_reader_type), intent(inout) :: self
        character(len=*), intent(in) :: key
        character(len=:), allocatable, intent(inout) :: text
        character(len=*), intent(in), optional :: help
        logical, intent(in), optional :: required
        integer :: k

        k = self%index_of(key, required)
        if (k > 0) then
            associate (given => self%entries%list(k)%value)
                if (given%is_list .or. given%atoms(1)%kind /= is_text) then
                    call self%fail(key, 'is no text', 'write it in quotes')
                    return
                end if
                text = given%atoms(1)%text
            end associate
        end if
        if (allocated(text)) call self%remember(key, k, text_value(text), help=help)
    end subroutine get_text

    !> One of some texts.
    subroutine get_choice(self, key, text, choices, help, required)
        class(key_reader_type), intent(inout) :: self
        character(len=*), intent(in) :: key
        character(len=:), allocatable, intent(inout) :: text
        character(len=*), intent(in) :: choices(:)
        character(len=*), intent(in), optional :: help
        logical, intent(in), optional :: required
        character(len=:), allocatable :: comment

        comment = listed(choices)
        comment = comment(2:)
        if (present(help)) comment = help//': '//comment
        call self%get_text(key, text, comment, required)
        if (self%failed() .or. .not. allocated(text)) return
        if (.not. any(choices == text)) then
            call self%fail(key, 'is "'//text//'"'//question(text, choices), 'take one of'//listed(choices))
        end if
    end subroutine get_choice

    !> A list of some texts.
    subroutine get_texts(self, key, length, texts, help, required)
        class(key_reader_type), intent(inout) :: self
        character(len=*), intent(in) :: key
        !> How many there must be, 0 for any number.
        integer, intent(in) :: length
        character(len=key_length), allocatable, intent(inout) :: texts(:)
        character(len=*), intent(in), optional :: help
        logical, intent(in), optional :: required
        type(value_type) :: shown
        integer :: k, i

        k = self%index_of(key, required)
        if (k > 0) then
            associate (given => self%entries%list(k)%value)
                if (.not. given%is_list .or. .not. all(given%atoms%kind == is_text)) then
                    call self%fail(key, 'is no list of texts', 'write ["...", "..."]')
                else if (length > 0 .and. size(given%atoms) /= length) then
                    call self%fail(key, 'has '//to_text(size(given%atoms))//' texts', 'give '//to_text(length))
                end if
                if (self%failed()) return
                if (allocated(texts)) deallocate (texts)
                allocate (texts(size(given%atoms)))
                do i = 1, size(texts)
                    if (len(given%atoms(i)%text) > key_length) then
                        call self%fail(key, 'has a text of more than '//to_text(key_length)//' characters', 'shorten it')
                        return
                    end if
                    texts(i) = given%atoms(i)%text
                end do
            end associate
        end if
        if (.not. allocated(texts)) return
        shown%is_list = .true.
        allocate (shown%atoms(size(texts)))
        shown%atoms%kind = is_text
        do i = 1, size(texts)
            shown%atoms(i)%text = trim(texts(i))
        end do
        call self%remember(key, k, shown, help=help)
    end subroutine get_texts

    !> Texts that are for others: they stay in the complete mechanism as they are given.
    subroutine pass(self, key, help)
        class(key_reader_type), intent(inout) :: self
        character(len=*), intent(in) :: key, help
        integer :: k

        k = self%index_of(key)
        if (k == 0) return
        associate (given => self%entries%list(k)%value)
            if (.not. given%is_list .or. .not. all(given%atoms%kind == is_text)) then
                call self%fail(key, 'is no list of texts', 'write ["...", "..."]')
            else
                call self%remember(key, k, given, help=help)
            end if
        end associate
    end subroutine pass

    !> True or false.
    subroutine get_truth(self, key, truth, help)
        class(key_reader_type), intent(inout) :: self
        character(len=*), intent(in) :: key
        logical, intent(inout) :: truth
        character(len=*), intent(in), optional :: help
        type(value_type) :: shown
        integer :: k

        k = self%index_of(key)
        if (k > 0) then
            associate (given => self%entries%list(k)%value)
                if (given%is_list .or. given%atoms(1)%kind /= is_truth) then
                    call self%fail(key, 'is neither true nor false', 'write true or false, without quotes')
                    return
                end if
                truth = given%atoms(1)%truth
            end associate
        end if
        allocate (shown%atoms(1))
        shown%atoms(1)%kind = is_truth
        shown%atoms(1)%truth = truth
        call self%remember(key, k, shown, help=help)
    end subroutine get_truth

    !> A function of time: a number, or an expression of t and parameters.
    subroutine get_function(self, key, f, unit, help)
        class(key_reader_type), intent(inout) :: self
        character(len=*), intent(in) :: key
        !> Not allocated where the key is not given.
        class(function_type), allocatable, intent(out) :: f
        character(len=*), intent(in), optional :: unit, help
        type(expression_type) :: expression
        type(constant_type) :: constant
        character(len=key_length), allocatable :: names(:)
        real(wp), allocatable :: values(:)
        integer :: k

        k = self%index_of(key)
        if (k == 0) return
        associate (given => self%entries%list(k)%value)
            if (given%is_list .or. given%atoms(1)%kind == is_truth) then
                call self%fail(key, 'is no function of time', &
                    'give a number, an expression of t as text, or the name of a function')
                return
            end if
            if (given%atoms(1)%kind == is_number) then
                constant%value = given%atoms(1)%number
                allocate (f, source=constant)
            else if (self%table_at(k) > 0) then
                allocate (f, source=table_function(self%tables(self%table_at(k))))
            else
                call self%constants(k, names, values)
                call parse_expression(expression, given%atoms(1)%text, ['t'], self%error, names, values, self%entries%list(k)%key)
                if (self%failed()) then
                    self%place = self%entries%list(k)%place
                    return
                end if
                allocate (f, source=expression_function(expression))
            end if
            call self%remember(key, k, given, unit, help)
        end associate
    end subroutine get_function

    !> How many entries the list of a key has, 0 where it is not given.
    pure integer function count_of(self, key) result(n)
        class(key_reader_type), intent(in) :: self
        character(len=*), intent(in) :: key
        integer :: k

        n = 0
        if (self%failed()) return
        k = self%find(key)
        if (k > 0) n = size(self%entries%list(k)%value%atoms)
    end function count_of

    !> Let functions and laws name a table.
    subroutine add_table(self, name, table)
        class(key_reader_type), intent(inout) :: self
        character(len=*), intent(in) :: name
        type(table_type), intent(in) :: table
        type(table_type), allocatable :: longer(:)
        integer :: n

        if (.not. allocated(self%tables)) allocate (self%tables(0), self%table_names(0))
        n = size(self%tables)
        allocate (longer(n + 1))
        longer(:n) = self%tables
        longer(n + 1) = table
        call move_alloc(longer, self%tables)
        self%table_names = [character(len=key_length) :: self%table_names, name]
    end subroutine add_table

    !> The number of the table that an entry names by a text, 0 for none.
    pure integer function table_at(self, entry) result(number)
        class(key_reader_type), intent(in) :: self
        integer, intent(in) :: entry

        number = 0
        if (.not. allocated(self%tables)) return
        associate (value => self%entries%list(entry)%value)
            if (value%is_list) return
            if (value%atoms(1)%kind == is_text) number = findloc(self%table_names, trim(value%atoms(1)%text), dim=1)
        end associate
    end function table_at

    !> A law of time, a coordinate and its rate.
    subroutine get_law(self, key, coordinate, law, unit, help)
        class(key_reader_type), intent(inout) :: self
        character(len=*), intent(in) :: key
        !> What the coordinate is called.
        character(len=*), intent(in) :: coordinate
        !> Not allocated where the key is not given.
        class(law_type), allocatable, intent(out) :: law
        character(len=*), intent(in), optional :: unit, help
        type(expression_type), allocatable :: expressions(:)
        integer :: k

        k = self%find(key)
        if (k > 0) then
            if (self%table_at(k) > 0) then
                k = self%index_of(key)
                allocate (law, source=table_law(self%tables(self%table_at(k))))
                call self%remember(key, k, self%entries%list(k)%value, unit, help)
                return
            end if
        end if
        call self%get_expressions(key, [1], [character(len=key_length) :: 't', coordinate, 'rate'], expressions, unit, help)
        if (allocated(expressions)) allocate (law, source=expression_law(expressions(1)))
    end subroutine get_law

    !> A list of numbers or expressions of variables, of one of some lengths.
    subroutine get_expressions(self, key, lengths, variables, expressions, unit, help, required)
        class(key_reader_type), intent(inout) :: self
        character(len=*), intent(in) :: key
        !> How many there may be; a single one will do where that is 1.
        integer, intent(in) :: lengths(:)
        character(len=*), intent(in) :: variables(:)
        !> Not allocated where the key is not given.
        type(expression_type), allocatable, intent(out) :: expressions(:)
        character(len=*), intent(in), optional :: unit, help
        logical, intent(in), optional :: required
        character(len=key_length), allocatable :: names(:)
        character(len=32) :: number
        real(wp), allocatable :: values(:)
        integer :: k, i

        k = self%index_of(key, required)
        if (k == 0) return
        call self%constants(k, names, values)
        associate (given => self%entries%list(k)%value)
            if (.not. any(lengths == size(given%atoms))) then
                call self%fail(key, 'has '//to_text(size(given%atoms))//trim(merge(' entry  ', ' entries', &
                    size(given%atoms) == 1)), &
                    'give '//to_text(lengths(1)))
                return
            end if
            allocate (expressions(size(given%atoms)))
            do i = 1, size(expressions)
                select case (given%atoms(i)%kind)
                case (is_number)
                    write (number, '(es25.16e3)') given%atoms(i)%number
                    call parse_expression(expressions(i), number, variables, self%error)
                case (is_text)
                    call parse_expression(expressions(i), given%atoms(i)%text, variables, self%error, names, values, &
                        self%entries%list(k)%key)
                case default
                    call self%fail(key, 'is true or false', 'give a number, or an expression as text')
                end select
                if (.not. self%failed()) cycle
                self%place = self%entries%list(k)%place
                deallocate (expressions)
                return
            end do
            call self%remember(key, k, given, unit, help)
        end associate
    end subroutine get_expressions

    !> The number that an atom is, or that its expression gives.
    subroutine evaluate(self, entry, atom, number)
        class(key_reader_type), intent(inout) :: self
        !> Whose entry it is, for messages and the index of a repeated element.
        integer, intent(in) :: entry
        type(atom_type), intent(in) :: atom
        real(wp), intent(out) :: number
        type(expression_type) :: expression
        character(len=key_length), allocatable :: names(:)
        real(wp), allocatable :: values(:)

        number = 0.0_wp
        if (self%failed()) return
        associate (given => self%entries%list(entry))
            select case (atom%kind)
            case (is_number)
                number = atom%number
            case (is_text)
                call self%constants(entry, names, values)
                call parse_expression(expression, atom%text, [character(len=1) ::], self%error, names, values, given%key)
                if (self%failed()) then
                    self%place = given%place
                    return
                end if
                number = expression%value([real(wp) ::])
            case default
                call self%fail_at(entry, given%key//': true and false are no numbers', 'give a number, or an expression as text')
            end select
            if (.not. ieee_is_finite(number)) call self%fail_at(entry, given%key//' gives no finite number', 'correct it')
        end associate
    end subroutine evaluate

    !> The number that an expression within the text of a key gives.
    subroutine evaluate_text(self, key, text, number)
        class(key_reader_type), intent(inout) :: self
        character(len=*), intent(in) :: key, text
        real(wp), intent(out) :: number
        type(atom_type) :: atom

        atom%kind = is_text
        atom%text = text
        number = 0.0_wp
        if (.not. self%failed()) call self%evaluate(self%find(key), atom, number)
    end subroutine evaluate_text

    !> Parameters, and the indices of a repeated element.
    subroutine constants(self, entry, names, values)
        class(key_reader_type), intent(in) :: self
        integer, intent(in) :: entry
        character(len=key_length), allocatable, intent(out) :: names(:)
        real(wp), allocatable, intent(out) :: values(:)

        names = self%names
        values = self%values
        associate (given => self%entries%list(entry))
            if (.not. allocated(given%index_names)) return
            names = [character(len=key_length) :: names, given%index_names]
            values = [values, real(given%index_values, wp)]
        end associate
    end subroutine constants

    !> The entry of a key that is asked for, which is known from now on; 0 where it is not given. Missing is an error where it is
    !> required.
    integer function index_of(self, key, required) result(k)
        class(key_reader_type), intent(inout) :: self
        character(len=*), intent(in) :: key
        logical, intent(in), optional :: required

        k = 0
        if (self%failed()) return
        self%known = [character(len=key_length) :: self%known, key]
        k = self%find(key)
        if (k > 0) self%used(k) = .true.
        if (k > 0 .or. .not. present(required)) return
        if (required) call self%fail('', 'the key '//key//' is missing', 'give it')
    end function index_of

    !> The entry of a key of the element, or 0.
    pure integer function find(self, key) result(k)
        class(key_reader_type), intent(in) :: self
        character(len=*), intent(in) :: key
        integer :: i

        associate (element => self%elements(self%current))
            do i = element%n, 1, -1
                k = element%entries(i)
                if (key_of(self%entries%list(k), element) == key) return
            end do
        end associate
        k = 0
    end function find

    !> Keep a line of the complete mechanism: what was given as it was given, else the default.
    subroutine remember(self, key, entry, value, unit, help)
        class(key_reader_type), intent(inout) :: self
        character(len=*), intent(in) :: key
        !> The entry that gives it, 0 for none.
        integer, intent(in) :: entry
        type(value_type), intent(in) :: value
        character(len=*), intent(in), optional :: unit, help
        type(value_type) :: shown
        character(len=:), allocatable :: table, name, comment
        integer :: of

        if (self%failed()) return
        name = key
        shown = value
        associate (element => self%elements(self%current))
            table = path_of(element)
            of = entry
            if (of == 0 .and. element%n > 0) of = element%entries(1)
            if (of > 0) then
                associate (its => self%entries%list(of))
                    if (.not. its%is_first) return
                    if (allocated(its%template)) then
                        table = its%template(:its%n_heading)
                        if (entry > 0) name = its%template(its%n_heading + 2:)
                    end if
                    if (entry > 0) shown = its%given
                end associate
            end if
        end associate
        comment = ''
        if (present(unit)) comment = unit
        if (present(help)) then
            if (len(comment) > 0 .and. len(help) > 0) comment = comment//', '
            comment = comment//help
        end if
        call self%show(table, name, shown, comment)
    end subroutine remember

    !> Add a line to the complete mechanism.
    subroutine show(self, table, key, value, comment)
        class(key_reader_type), intent(inout) :: self
        character(len=*), intent(in) :: table, key
        type(value_type), intent(in) :: value
        !> Unit and meaning.
        character(len=*), intent(in) :: comment
        type(shown_type) :: line
        type(shown_type), allocatable :: longer(:)

        line%table = table
        line%key = key
        line%value = value
        line%comment = trim(comment)
        if (.not. allocated(self%shown)) allocate (self%shown(64))
        if (self%n_shown == size(self%shown)) then
            allocate (longer(2*self%n_shown))
            longer(:self%n_shown) = self%shown
            call move_alloc(longer, self%shown)
        end if
        self%n_shown = self%n_shown + 1
        self%shown(self%n_shown) = line
    end subroutine show

    !> The key of an entry within its element.
    pure function key_of(entry, element) result(key)
        type(entry_type), intent(in) :: entry
        type(element_type), intent(in) :: element
        character(len=len(entry%key) - len_trim(element%kind) - len_trim(element%name) - 1 - count([element%name /= ''])) :: key

        key = entry%key(len(entry%key) - len(key) + 1:)
    end function key_of

    !> The name of an element in messages and headings.
    pure function path_of(element) result(path)
        type(element_type), intent(in) :: element
        character(len=len_trim(element%kind) + len_trim(element%name) + count([element%name /= ''])) :: path

        path = joined(trim(element%kind), trim(element%name))
    end function path_of

    !> Two parts of a key, the second of which may be empty.
    pure function joined(first, second) result(path)
        character(len=*), intent(in) :: first, second
        character(len=len(first) + len(second) + count([len(second) > 0])) :: path

        path = first
        if (len(second) > 0) path = first//'.'//second
    end function joined

    !> The part of a key before its first dot.
    pure function up_to_dot(key) result(part)
        character(len=*), intent(in) :: key
        character(len=index(key//'.', '.') - 1) :: part

        part = key
    end function up_to_dot

    !> Names, each after a blank, commas between them.
    pure function listed(names) result(text)
        character(len=*), intent(in) :: names(:)
        character(len=max(0, sum(len_trim(names) + 2) - 1)) :: text
        integer :: i, n

        n = 0
        do i = 1, size(names)
            text(n + 1:) = ' '//trim(names(i))//','
            n = n + len_trim(names(i)) + 2
        end do
    end function listed
end module tandem_mechanism_key_reader
