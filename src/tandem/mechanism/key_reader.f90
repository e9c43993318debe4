! SPDX-License-Identifier: MIT
!> Reads the keys of a mechanism, element by element: one call per key returns its value, checks it, and stores it with its unit and
!> meaning. The same calls thus make the mechanism, the list of valid keys, and the complete mechanism with all defaults.
!>
!> The first error is stored with the place of its entry; later calls then do nothing.
module tandem_mechanism_key_reader
    use tandem_error, only: error_type, to_text
    use tandem_kinds, only: wp
    use tandem_mechanism_element_keys, only: add_to, element_type, joined, key_length, key_of, listed, path_of, text_length, &
        up_to_dot
    use tandem_mechanism_entries, only: atom_type, entries_type, is_text, value_type
    use tandem_mechanism_expression, only: expression_type
    use tandem_mechanism_function, only: function_type
    use tandem_mechanism_joint, only: name_length
    use tandem_mechanism_law, only: law_type
    use tandem_mechanism_table_function, only: table_type
    use tandem_name_index, only: name_index_type
    use tandem_names, only: question
    implicit none (type, external)
    private

    public :: key_reader_type, shown_type, anything, positive, not_negative

    !> Ranges of numbers.
    integer, parameter :: anything = 0, positive = 1, not_negative = 2

    !> A line of the complete mechanism.
    type :: shown_type
        !> Such as `body.rod`, and `mass`; a repeated element is listed under its template.
        character(len=:), allocatable :: table, key
        type(value_type) :: value
        !> Unit and meaning.
        character(len=:), allocatable :: comment
    end type shown_type

    !> Reads and checks the keys of one element after the other, and stores the first error.
    type :: key_reader_type
        !> First error, and the place of its entry, 0 if none.
        type(error_type), allocatable :: error
        integer :: place = 0
        !> Parameters and their values.
        character(len=key_length), allocatable :: names(:)
        real(wp), allocatable :: values(:)
        !> Lines of the complete mechanism so far: the first `n_shown`.
        type(shown_type), allocatable :: shown(:)
        integer :: n_shown = 0
        !> Name of the current element.
        character(len=:), allocatable :: name
        type(entries_type), private :: entries
        type(element_type), allocatable, private :: elements(:)
        integer, private :: n_elements = 0, current = 0
        !> Elements by kind and name; index, within its kind, of the last opened element.
        type(name_index_type), private :: by_name
        integer, private :: opened = 0
        logical, allocatable, private :: used(:)
        !> Requested keys of this element: the first `n_known`.
        character(len=key_length), allocatable, private :: known(:)
        integer, private :: n_known = 0
        !> Tables that functions and laws may name.
        character(len=key_length), allocatable, private :: table_names(:)
        type(table_type), allocatable, private :: tables(:)
    contains
        procedure :: take, n_of, open, close, blame, blame_named
        procedure, private :: place_in
        procedure :: failed, fail, refuse, gives, is_text_at, has_text
        procedure :: keys_below
        procedure :: get_number, get_numbers, get_text, get_choice, get_texts, get_truth
        procedure :: pass, count_of, add_table
        procedure, private :: table_at
        procedure :: get_function, get_law, get_expressions, evaluate_text, show
        procedure, private :: evaluate, find, index_of, remember, constants, fail_at, check_length
    end type key_reader_type

    interface
        !> Read a number, or an expression of parameters; the value is unchanged if the key is absent.
        module subroutine get_number(self, key, value, check, unit, help, required)
            implicit none (type, external)
            class(key_reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            !> Default on entry, value on return; not allocated if there is neither.
            real(wp), allocatable, intent(inout) :: value
            integer, intent(in), optional :: check
            character(len=*), intent(in), optional :: unit, help
            logical, intent(in), optional :: required
        end subroutine get_number

        !> Read a list of numbers or expressions of one of several lengths.
        module subroutine get_numbers(self, key, lengths, values, check, unit, help, required, row_length)
            implicit none (type, external)
            class(key_reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            !> Valid lengths; a single number is accepted for a length of 1.
            integer, intent(in) :: lengths(:)
            !> Default on entry, values on return; not allocated if there are neither.
            real(wp), allocatable, intent(inout) :: values(:)
            integer, intent(in), optional :: check
            character(len=*), intent(in), optional :: unit, help
            logical, intent(in), optional :: required
            !> Length of the rows of a matrix, which may also be given by its rows.
            integer, intent(in), optional :: row_length
        end subroutine get_numbers

        !> Read a text; not allocated if the key is absent and has no default.
        module subroutine get_text(self, key, text, help, required)
            implicit none (type, external)
            class(key_reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            character(len=:), allocatable, intent(inout) :: text
            character(len=*), intent(in), optional :: help
            logical, intent(in), optional :: required
        end subroutine get_text

        !> Read a text from a list of choices.
        module subroutine get_choice(self, key, text, choices, help, required)
            implicit none (type, external)
            class(key_reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            character(len=:), allocatable, intent(inout) :: text
            character(len=*), intent(in) :: choices(:)
            character(len=*), intent(in), optional :: help
            logical, intent(in), optional :: required
        end subroutine get_choice

        !> Read a list of texts.
        module subroutine get_texts(self, key, length, texts, help, required)
            implicit none (type, external)
            class(key_reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            !> Required number of texts, 0 for any number.
            integer, intent(in) :: length
            character(len=text_length), allocatable, intent(inout) :: texts(:)
            character(len=*), intent(in), optional :: help
            logical, intent(in), optional :: required
        end subroutine get_texts

        !> Copy texts that other modules read to the complete mechanism.
        module subroutine pass(self, key, help)
            implicit none (type, external)
            class(key_reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key, help
        end subroutine pass

        !> Read a truth value.
        module subroutine get_truth(self, key, truth, help)
            implicit none (type, external)
            class(key_reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            logical, intent(inout) :: truth
            character(len=*), intent(in), optional :: help
        end subroutine get_truth

        !> Append a line to the complete mechanism: the value as given, or the default.
        module subroutine remember(self, key, entry, value, unit, help)
            implicit none (type, external)
            class(key_reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            !> Entry with the value, 0 if none.
            integer, intent(in) :: entry
            type(value_type), intent(in) :: value
            character(len=*), intent(in), optional :: unit, help
        end subroutine remember
    end interface

    interface
        !> Read a function of time: a number, or an expression of t and parameters.
        module subroutine get_function(self, key, f, unit, help)
            implicit none (type, external)
            class(key_reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            !> Not allocated if the key is absent.
            class(function_type), allocatable, intent(out) :: f
            character(len=*), intent(in), optional :: unit, help
        end subroutine get_function

        !> Add a table that functions and laws may name.
        module subroutine add_table(self, name, table)
            implicit none (type, external)
            class(key_reader_type), intent(inout) :: self
            character(len=*), intent(in) :: name
            type(table_type), intent(in) :: table
        end subroutine add_table

        !> Index of the table that the text of an entry names; 0 if none.
        pure integer module function table_at(self, entry) result(number)
            implicit none (type, external)
            class(key_reader_type), intent(in) :: self
            integer, intent(in) :: entry
        end function table_at

        !> Read a law of time, a coordinate and its rate.
        module subroutine get_law(self, key, coordinate, law, unit, help)
            implicit none (type, external)
            class(key_reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            !> Name of the coordinate.
            character(len=*), intent(in) :: coordinate
            !> Not allocated if the key is absent.
            class(law_type), allocatable, intent(out) :: law
            character(len=*), intent(in), optional :: unit, help
        end subroutine get_law

        !> Read a list of numbers or expressions of variables, of one of several lengths.
        module subroutine get_expressions(self, key, lengths, variables, expressions, unit, help, required)
            implicit none (type, external)
            class(key_reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            !> Valid lengths; a single expression is accepted for a length of 1.
            integer, intent(in) :: lengths(:)
            character(len=*), intent(in) :: variables(:)
            !> Not allocated if the key is absent.
            type(expression_type), allocatable, intent(out) :: expressions(:)
            character(len=*), intent(in), optional :: unit, help
            logical, intent(in), optional :: required
        end subroutine get_expressions

        !> Value of an atom that is a number or an expression.
        module subroutine evaluate(self, entry, atom, number)
            implicit none (type, external)
            class(key_reader_type), intent(inout) :: self
            !> Entry of the atom, for messages and for the index of a repeated element.
            integer, intent(in) :: entry
            type(atom_type), intent(in) :: atom
            real(wp), intent(out) :: number
        end subroutine evaluate

        !> Value of an expression within the text of a key.
        module subroutine evaluate_text(self, key, text, number)
            implicit none (type, external)
            class(key_reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key, text
            real(wp), intent(out) :: number
        end subroutine evaluate_text

        !> Parameters, and the indices of a repeated element.
        module subroutine constants(self, entry, names, values)
            implicit none (type, external)
            class(key_reader_type), intent(in) :: self
            integer, intent(in) :: entry
            character(len=key_length), allocatable, intent(out) :: names(:)
            real(wp), allocatable, intent(out) :: values(:)
        end subroutine constants
    end interface

    interface
        !> Set an error about a key of the element, or about the element if the key is absent.
        module subroutine fail(self, key, problem, advice)
            implicit none (type, external)
            class(key_reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key, problem, advice
        end subroutine fail

        !> Set an error that concerns no key of an element; `place` is unchanged.
        module subroutine refuse(self, problem, advice)
            implicit none (type, external)
            class(key_reader_type), intent(inout) :: self
            character(len=*), intent(in) :: problem, advice
        end subroutine refuse

        !> Store the error of a builder procedure, which names the element. Its place is that of the key or text in the message.
        module subroutine blame(self, error)
            implicit none (type, external)
            class(key_reader_type), intent(inout) :: self
            type(error_type), allocatable, intent(inout) :: error
        end subroutine blame

        !> Store an error about all elements. Its place is in the element that the message names.
        module subroutine blame_named(self, error)
            implicit none (type, external)
            class(key_reader_type), intent(inout) :: self
            type(error_type), allocatable, intent(inout) :: error
        end subroutine blame_named

        !> Place of an error in an element: the key in the message, else the text in the message, else the first key.
        pure integer module function place_in(self, element) result(place)
            implicit none (type, external)
            class(key_reader_type), intent(in) :: self
            type(element_type), intent(in) :: element
        end function place_in

        !> Set an error about an entry, 0 if none.
        module subroutine fail_at(self, entry, problem, advice)
            implicit none (type, external)
            class(key_reader_type), intent(inout) :: self
            integer, intent(in) :: entry
            character(len=*), intent(in) :: problem, advice
        end subroutine fail_at
    end interface

contains

    !> Take the entries, which contain no repetitions, and assign them to elements.
    subroutine take(self, entries, kinds, singles)
        class(key_reader_type), intent(inout) :: self
        type(entries_type), intent(in) :: entries
        !> Kinds of elements with names, and kinds of which there is one element.
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
                call self%check_length(i, name)
                if (self%failed()) return
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

    !> Refuse a name that is too long for an element or a point.
    subroutine check_length(self, entry, name)
        class(key_reader_type), intent(inout) :: self
        !> Entry with this name in its key.
        integer, intent(in) :: entry
        character(len=*), intent(in) :: name

        if (len(name) > name_length) call self%fail_at(entry, 'the name "'//name(:name_length)//'..." is longer than '// &
            to_text(name_length)//' characters', 'shorten it')
    end subroutine check_length

    !> Find the element of a name; append a new one if there is none.
    subroutine find_element(self, kind, name, k)
        class(key_reader_type), intent(inout) :: self
        character(len=*), intent(in) :: kind, name
        integer, intent(out) :: k
        type(element_type), allocatable :: longer(:)

        k = self%by_name%get(joined(trim(kind), trim(name)))
        if (k > 0) return
        k = self%n_elements + 1
        if (k > size(self%elements)) then
            allocate (longer(2*size(self%elements)))
            longer(:size(self%elements)) = self%elements
            call move_alloc(longer, self%elements)
        end if
        self%n_elements = k
        self%elements(k)%kind = kind
        self%elements(k)%name = name
        allocate (self%elements(k)%entries(8))
        call self%by_name%put(joined(trim(kind), trim(name)), k)
    end subroutine find_element

    !> Number of elements of a kind.
    pure integer function n_of(self, kind)
        class(key_reader_type), intent(in) :: self
        character(len=*), intent(in) :: kind

        n_of = count(self%elements(:self%n_elements)%kind == kind)
    end function n_of

    !> Select the element of the following calls of `get`. A kind with one element need not have entries.
    subroutine open(self, kind, number)
        class(key_reader_type), intent(inout) :: self
        character(len=*), intent(in) :: kind
        !> Index of the element in its kind.
        integer, intent(in) :: number
        integer :: k, n

        if (self%failed()) return
        ! Search from the last element of the same kind on, because all elements of a kind are opened in order.
        n = 0
        k = 1
        if (self%current > 0 .and. self%opened < number) then
            if (self%elements(self%current)%kind == kind) then
                n = self%opened
                k = self%current + 1
            end if
        end if
        do k = k, self%n_elements
            if (self%elements(k)%kind == kind) n = n + 1
            if (n == number) exit
        end do
        if (k > self%n_elements) call find_element(self, kind, '', k)
        self%current = k
        self%opened = number
        self%name = trim(self%elements(self%current)%name)
        if (.not. allocated(self%known)) allocate (self%known(32))
        self%n_known = 0
    end subroutine open

    !> Refuse all keys of the element that have not been requested.
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
                call self%fail_at(k, 'unknown key "'//key//'" of '//path_of(element)//question(key, self%known(:self%n_known)), &
                    'its keys are'//listed(self%known(:self%n_known)))
                return
            end do
        end associate
    end subroutine close

    !> True after an error.
    pure logical function failed(self)
        class(key_reader_type), intent(in) :: self

        failed = allocated(self%error)
    end function failed

    !> True if a key of the element is given.
    pure logical function gives(self, key)
        class(key_reader_type), intent(in) :: self
        character(len=*), intent(in) :: key

        gives = self%find(key) > 0
    end function gives

    !> True if a key of the element is given by one text.
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

    !> True if a key of the element is given by a text, or by a list that contains one.
    pure logical function has_text(self, key)
        class(key_reader_type), intent(in) :: self
        character(len=*), intent(in) :: key
        integer :: k

        k = 0
        if (.not. self%failed()) k = self%find(key)
        has_text = k > 0
        if (k > 0) has_text = any(self%entries%list(k)%value%atoms%kind == is_text)
    end function has_text

    !> Names below a key of the element, which become known.
    subroutine keys_below(self, key, names)
        class(key_reader_type), intent(inout) :: self
        character(len=*), intent(in) :: key
        character(len=key_length), allocatable, intent(out) :: names(:)
        character(len=:), allocatable :: its
        integer :: i

        names = [character(len=key_length) ::]
        if (self%failed()) return
        call note_known(self, key)
        associate (element => self%elements(self%current))
            do i = 1, element%n
                its = key_of(self%entries%list(element%entries(i)), element)
                if (index(its, key//'.') /= 1) cycle
                call self%check_length(element%entries(i), its(len(key) + 2:))
                names = [character(len=key_length) :: names, its(len(key) + 2:)]
            end do
        end associate
    end subroutine keys_below

    !> Number of entries of the list of a key; 0 if the key is absent.
    pure integer function count_of(self, key) result(n)
        class(key_reader_type), intent(in) :: self
        character(len=*), intent(in) :: key
        integer :: k

        n = 0
        if (self%failed()) return
        k = self%find(key)
        if (k > 0) n = size(self%entries%list(k)%value%atoms)
    end function count_of

    !> Entry of a requested key, which becomes known; 0 if absent. A missing required key is an error.
    integer function index_of(self, key, required, row_length) result(k)
        class(key_reader_type), intent(inout) :: self
        character(len=*), intent(in) :: key
        logical, intent(in), optional :: required
        !> Length of the rows of a matrix, which may be a list of lists; if absent, a list of lists is an error.
        integer, intent(in), optional :: row_length

        k = 0
        if (self%failed()) return
        call note_known(self, key)
        k = self%find(key)
        if (k > 0) then
            self%used(k) = .true.
            call check_rows(self, key, self%entries%list(k)%value%row_length, row_length)
            if (self%failed()) k = 0
            return
        end if
        if (.not. present(required)) return
        if (required) call self%fail('', 'the key '//key//' is missing', 'give it')
    end function index_of

    !> Refuse a list of lists that is not a matrix, or has rows of another length.
    subroutine check_rows(self, key, given, expected)
        class(key_reader_type), intent(inout) :: self
        character(len=*), intent(in) :: key
        !> Given length of the rows, 0 if none, and expected length.
        integer, intent(in) :: given
        integer, intent(in), optional :: expected

        if (given == 0) return
        if (.not. present(expected)) then
            call self%fail(key, 'is a list of lists', 'give one list')
        else if (given /= expected) then
            call self%fail(key, 'has rows of '//to_text(given), 'give '//to_text(expected)//' rows of '//to_text(expected))
        end if
    end subroutine check_rows

    !> Entry of a key of the element; 0 if none.
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

    !> Append a requested key.
    pure subroutine note_known(self, key)
        class(key_reader_type), intent(inout) :: self
        character(len=*), intent(in) :: key

        if (self%n_known == size(self%known)) self%known = [self%known, self%known]
        self%n_known = self%n_known + 1
        self%known(self%n_known) = key
    end subroutine note_known

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
end module tandem_mechanism_key_reader
