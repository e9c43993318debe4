! SPDX-License-Identifier: MIT
!> Reader of keys with values, for the tables of a scene and the elements of a mechanism. A caller opens one table or element after
!> the other and makes one call per key, which returns the value, checks it, and records its unit and meaning. The same calls
!> therefore also yield the list of valid keys and the complete description with all defaults.
!>
!> The first error is stored with the position of its entry. Later calls then do nothing, so that one check after all calls
!> suffices.
module tandem_mechanism_key_reader
    use tandem_error, only: error_type, to_text
    use tandem_kinds, only: wp
    use tandem_mechanism_element_keys, only: element_type, joined, key_length, key_of, listed, path_of, text_length, up_to_dot
    use tandem_mechanism_entries, only: atom_type, entries_type, is_text, value_type
    use tandem_mechanism_expression, only: expression_type
    use tandem_mechanism_function, only: function_type
    use tandem_mechanism_law, only: law_type
    use tandem_mechanism_shown, only: shown_type
    use tandem_mechanism_table_function, only: table_type
    use tandem_mechanism_value_rules, only: anything, not_negative, positive
    use tandem_name_index, only: name_index_type
    implicit none (type, external)
    private

    public :: reader_type, fault_type, anything, positive, not_negative

    !> Parts of an error message about the tables of a scene, to which the file name and the line are added.
    type :: fault_type
        !> Message; remark beside the marked position; line below it, empty if there is none.
        character(len=:), allocatable :: message, remark, tail
        !> Heading of the table, which is shown if there is no position; empty if the message contains it.
        character(len=:), allocatable :: heading
        !> Source of the table; true if the key is to be marked, false for its value.
        integer :: source = 0
        logical :: is_at_key = .false.
    end type fault_type

    !> Reader of keys.
    type :: reader_type
        !> First error, and the position of its entry, 0 if none; its parts, allocated for the tables of a scene only.
        type(error_type), allocatable :: error
        integer :: place = 0
        type(fault_type), allocatable :: fault
        !> True if only values are read, and no complete description is recorded.
        logical :: is_brief = .false.
        !> Names of parameters, and their values.
        character(len=key_length), allocatable :: names(:)
        real(wp), allocatable :: values(:)
        !> Lines of the complete description recorded so far, the first `n_shown` of the array.
        type(shown_type), allocatable :: shown(:)
        integer :: n_shown = 0
        !> Name of the current element.
        character(len=:), allocatable :: name
        !> All entries; owned by the caller.
        type(entries_type), pointer :: entries => null()
        !> True for tables of a scene: messages name keys without their table, and texts are not expressions.
        logical, private :: is_scene = .false.
        type(element_type), allocatable, private :: elements(:)
        integer, private :: n_elements = 0, current = 0
        !> Indices of elements by kind and name; index, within its kind, of the element opened last.
        type(name_index_type), private :: by_name
        integer, private :: opened = 0
        logical, allocatable, private :: used(:)
        !> Names of tables of values that functions and laws may use.
        character(len=key_length), allocatable, private :: table_names(:)
        type(table_type), allocatable, private :: tables(:)
    contains
        procedure :: take, take_tables, n_of, open_table, close_table, propose, replace
        procedure :: failed, fail, refuse, refuse_at, refuse_all, blame, blame_named
        procedure :: gives, source_of, is_text_at, has_text, keys_below, count_of
        generic :: get => get_real, get_integer, get_truth, get_text, get_choice, get_vector, get_strings
        procedure :: get_number, get_numbers, get_word, get_texts, get_for_each, get_list, pass
        procedure :: add_table, get_function, get_law, get_expressions, evaluate_text
        procedure :: show, remark, hide
        procedure, private :: get_real, get_integer, get_truth, get_text, get_choice, get_vector, get_strings
        procedure, private :: refuse_value, fail_at, evaluate, find, index_of, record_key, heading_of
    end type reader_type

    ! Tables and elements.
    interface
        !> Attach the entries of a mechanism, without repetitions, and assign them to elements.
        module subroutine take(self, entries, kinds, singles)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            !> Must exist as long as the reader is used.
            type(entries_type), intent(in), target :: entries
            !> Kinds of elements that have names; kinds of which there is only one element.
            character(len=*), intent(in) :: kinds(:), singles(:)
        end subroutine take

        !> Attach the entries of a scene, and assign them to tables.
        module subroutine take_tables(self, entries, arrays)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            !> Must exist as long as the reader is used.
            type(entries_type), intent(in), target :: entries
            !> Names of tables that may occur several times. Their keys contain a number, as in `event.1.value`.
            character(len=*), intent(in) :: arrays(:)
        end subroutine take_tables

        !> Number of elements of a kind, or of tables with the same name.
        pure integer module function n_of(self, kind)
            implicit none (type, external)
            class(reader_type), intent(in) :: self
            character(len=*), intent(in) :: kind
        end function n_of

        !> Open the table or the element to which the following calls refer. A table need not have entries.
        module subroutine open_table(self, table, number)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: table
            !> Index of the element within its kind, or of one of several tables with the same name; default 1.
            integer, intent(in), optional :: number
        end subroutine open_table

        !> Refuse all keys of the open table that have not been requested.
        module subroutine close_table(self)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
        end subroutine close_table

        !> List the names below a key of the element, which counts as requested.
        module subroutine keys_below(self, key, names)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            character(len=key_length), allocatable, intent(out) :: names(:)
        end subroutine keys_below

        !> Add a key to the known keys, so that messages can suggest it, although its value is not read here.
        pure module subroutine propose(self, key)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
        end subroutine propose

        !> Remove keys of the open table that the description gives, if a setting gives one of the keys `by`, which replace them,
        !> with a value other than 0.
        module subroutine replace(self, keys, by)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: keys(:), by(:)
        end subroutine replace

        !> Entry of a requested key, 0 if absent. An absent key is an error if it is required.
        integer module function index_of(self, key, required, row_length) result(k)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            logical, intent(in), optional :: required
            !> Length of the rows of a matrix, which may be given as a list of lists. If absent, a list of lists is an error.
            integer, intent(in), optional :: row_length
        end function index_of
    end interface

    ! Values in any table.
    interface
        !> Read a number; in a mechanism also an expression of parameters. The value is unchanged if the key is absent.
        module subroutine get_number(self, key, value, check, unit, help, required)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            !> Default on entry, value on return; not allocated if there is none.
            real(wp), allocatable, intent(inout) :: value
            !> `anything` (default), `positive` or `not_negative`.
            integer, intent(in), optional :: check
            !> Unit and meaning for the complete description.
            character(len=*), intent(in), optional :: unit, help
            !> True if the key has no default and must be given.
            logical, intent(in), optional :: required
        end subroutine get_number

        !> Read a list of numbers or expressions, whose length must be one of several.
        module subroutine get_numbers(self, key, lengths, values, check, unit, help, required, row_length)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            !> Allowed lengths. In a mechanism, a single number is accepted for a length of 1.
            integer, intent(in) :: lengths(:)
            !> Defaults on entry, values on return; not allocated if there are none.
            real(wp), allocatable, intent(inout) :: values(:)
            integer, intent(in), optional :: check
            character(len=*), intent(in), optional :: unit, help
            logical, intent(in), optional :: required
            !> Length of the rows of a matrix, which may also be given row by row.
            integer, intent(in), optional :: row_length
        end subroutine get_numbers

        !> Read a text; not allocated if the key is absent and has no default.
        module subroutine get_text(self, key, text, help, required)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            character(len=:), allocatable, intent(inout) :: text
            character(len=*), intent(in), optional :: help
            logical, intent(in), optional :: required
        end subroutine get_text

        !> Read a text from a list of choices.
        module subroutine get_word(self, key, text, choices, help, required)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            character(len=:), allocatable, intent(inout) :: text
            character(len=*), intent(in) :: choices(:)
            character(len=*), intent(in), optional :: help
            logical, intent(in), optional :: required
        end subroutine get_word

        !> Read a list of texts.
        module subroutine get_texts(self, key, length, texts, help, required)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            !> Required number of texts; 0 for any number.
            integer, intent(in) :: length
            character(len=text_length), allocatable, intent(inout) :: texts(:)
            character(len=*), intent(in), optional :: help
            logical, intent(in), optional :: required
        end subroutine get_texts

        !> Record texts, which other modules read, in the complete description.
        module subroutine pass(self, key, help)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key, help
        end subroutine pass

        !> Read a truth value.
        module subroutine get_truth(self, key, truth, help)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            !> Default on entry, value on return.
            logical, intent(inout) :: truth
            character(len=*), intent(in), optional :: help
        end subroutine get_truth
    end interface

    ! Values with defaults that are not allocatable, or with a given length.
    interface
        !> Read a number.
        module subroutine get_real(self, key, value, check, unit, help, required)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            !> Default on entry, value on return.
            real(wp), intent(inout) :: value
            integer, intent(in), optional :: check
            character(len=*), intent(in), optional :: unit, help
            logical, intent(in), optional :: required
        end subroutine get_real

        !> Read an integer.
        module subroutine get_integer(self, key, value, check, help)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            !> Default on entry, value on return.
            integer, intent(inout) :: value
            integer, intent(in), optional :: check
            character(len=*), intent(in), optional :: help
        end subroutine get_integer

        !> Read a text from a list of choices.
        module subroutine get_choice(self, key, value, choices, help, required)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            !> Default on entry, value on return.
            character(len=*), intent(inout) :: value
            character(len=*), intent(in) :: choices(:)
            character(len=*), intent(in), optional :: help
            logical, intent(in), optional :: required
        end subroutine get_choice

        !> Read as many numbers as `values` has entries.
        module subroutine get_vector(self, key, values, check, unit, help)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            !> Defaults on entry, values on return.
            real(wp), intent(inout) :: values(:)
            integer, intent(in), optional :: check
            character(len=*), intent(in), optional :: unit, help
        end subroutine get_vector

        !> Read texts from a list of choices, each at most once.
        module subroutine get_strings(self, key, values, choices, help, may_have_values)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            !> Default on entry, values on return.
            character(len=*), allocatable, intent(inout) :: values(:)
            character(len=*), intent(in) :: choices(:)
            character(len=*), intent(in), optional :: help
            !> True if texts may also have the form NAME=NUMBER.
            logical, intent(in), optional :: may_have_values
        end subroutine get_strings

        !> Read one number that applies to all items, or a list with one number per item.
        module subroutine get_for_each(self, key, length, values, value, help)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            !> Number of items.
            integer, intent(in) :: length
            !> List; not allocated if none is given.
            real(wp), allocatable, intent(inout) :: values(:)
            !> Number for all items; default on entry. If absent, the key has no default, and a single number is copied to the list.
            real(wp), intent(inout), optional :: value
            character(len=*), intent(in), optional :: help
        end subroutine get_for_each

        !> Read a list of numbers, texts or truth values of any length; not allocated if the key is absent.
        module subroutine get_list(self, key, values)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            type(value_type), allocatable, intent(inout) :: values
        end subroutine get_list
    end interface

    ! Functions, laws and expressions.
    interface
        !> Read a function of time: a number, or an expression of t and parameters.
        module subroutine get_function(self, key, f, unit, help)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            !> Not allocated if the key is absent.
            class(function_type), allocatable, intent(out) :: f
            character(len=*), intent(in), optional :: unit, help
        end subroutine get_function

        !> Add a table of values that functions and laws may use by name.
        module subroutine add_table(self, name, table)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: name
            type(table_type), intent(in) :: table
        end subroutine add_table

        !> Read a force law of the time, a coordinate and its rate.
        module subroutine get_law(self, key, coordinate, law, unit, help)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            !> Name of the coordinate.
            character(len=*), intent(in) :: coordinate
            !> Not allocated if the key is absent.
            class(law_type), allocatable, intent(out) :: law
            character(len=*), intent(in), optional :: unit, help
        end subroutine get_law

        !> Read a list of numbers or of expressions of variables, whose length must be one of several.
        module subroutine get_expressions(self, key, lengths, variables, expressions, unit, help, required)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            !> Allowed lengths. A single expression is accepted for a length of 1.
            integer, intent(in) :: lengths(:)
            character(len=*), intent(in) :: variables(:)
            !> Not allocated if the key is absent.
            type(expression_type), allocatable, intent(out) :: expressions(:)
            character(len=*), intent(in), optional :: unit, help
            logical, intent(in), optional :: required
        end subroutine get_expressions

        !> Value of a text that is an expression.
        module subroutine evaluate(self, entry, text, number)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            !> Entry of the text, for messages and for the indices of a repeated element.
            integer, intent(in) :: entry
            character(len=*), intent(in) :: text
            real(wp), intent(out) :: number
        end subroutine evaluate

        !> Value of an expression within the text of a key.
        module subroutine evaluate_text(self, key, text, number)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key, text
            real(wp), intent(out) :: number
        end subroutine evaluate_text
    end interface

    ! Errors.
    interface
        !> Set an error about a key of the open element, or about the element itself if no key is given.
        module subroutine fail(self, key, problem, advice)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key, problem, advice
        end subroutine fail

        !> Set an error about the value of a key of the open table.
        module subroutine refuse(self, key, problem)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            !> Key; problem, such as `must be positive`.
            character(len=*), intent(in) :: key, problem
        end subroutine refuse

        !> Set an error about the entry at a position; 0 for the whole scene.
        module subroutine refuse_at(self, place, problem)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            integer, intent(in) :: place
            character(len=*), intent(in) :: problem
        end subroutine refuse_at

        !> Set an error that does not concern a key of an element; `place` is unchanged.
        module subroutine refuse_all(self, problem, advice)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: problem, advice
        end subroutine refuse_all

        !> Store the error of a builder procedure about the open element. Its position is that of the key or text in the message.
        module subroutine blame(self, error)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            type(error_type), allocatable, intent(inout) :: error
        end subroutine blame

        !> Store an error about all elements. Its position is found in the element that the message names.
        module subroutine blame_named(self, error)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            type(error_type), allocatable, intent(inout) :: error
        end subroutine blame_named

        !> Set an error about the value of an entry of the open table.
        module subroutine refuse_value(self, entry, key, problem)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            !> Entry, 0 if there is none, and its key.
            integer, intent(in) :: entry
            character(len=*), intent(in) :: key, problem
        end subroutine refuse_value

        !> Set an error about an entry of a mechanism; 0 if there is none.
        module subroutine fail_at(self, entry, problem, advice)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            integer, intent(in) :: entry
            character(len=*), intent(in) :: problem, advice
        end subroutine fail_at
    end interface

    ! The complete description.
    interface
        !> Record a key in the complete description: its value as given, or its default.
        module subroutine record_key(self, key, entry, value, unit, help, is_whole)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            !> Entry that contains the value, 0 for a default.
            integer, intent(in) :: entry
            type(value_type), intent(in) :: value
            character(len=*), intent(in), optional :: unit, help
            !> True for an integer.
            logical, intent(in), optional :: is_whole
        end subroutine record_key

        !> Append a line to the complete description.
        module subroutine show(self, line)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            type(shown_type), intent(in) :: line
        end subroutine show

        !> Append a comment to the complete description.
        module subroutine remark(self, words)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: words
        end subroutine remark

        !> Omit the keys of the open table that were read so far from the complete description, because others replace them. It is
        !> an error to give both.
        module subroutine hide(self, source, reason)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            !> Source of the keys that replace them.
            integer, intent(in) :: source
            !> Reason for which both must not be given.
            character(len=*), intent(in) :: reason
        end subroutine hide
    end interface

contains

    !> True after an error.
    pure logical function failed(self)
        class(reader_type), intent(in) :: self

        failed = allocated(self%error)
    end function failed

    !> Length of the heading of the open table. Tables with several elements have two brackets on each side.
    pure integer function heading_length(self)
        class(reader_type), intent(in) :: self

        associate (element => self%elements(self%current))
            heading_length = len_trim(element%kind) + merge(2, 4, element%name == '')
        end associate
    end function heading_length

    !> Heading of the open table.
    pure function heading_of(self) result(heading)
        class(reader_type), intent(in) :: self
        character(len=heading_length(self)) :: heading

        associate (element => self%elements(self%current))
            heading = '['//trim(element%kind)//']'
            if (element%name /= '') heading = '['//trim(heading)//']'
        end associate
    end function heading_of

    !> True if a key of the open table is given.
    pure logical function gives(self, key)
        class(reader_type), intent(in) :: self
        character(len=*), intent(in) :: key

        gives = self%find(key) > 0
    end function gives

    !> Source that gives a key of the open table: 0 is the description, i the i-th setting, -1 none.
    pure integer function source_of(self, key)
        class(reader_type), intent(in) :: self
        character(len=*), intent(in) :: key
        integer :: k

        source_of = -1
        k = self%find(key)
        if (k > 0) source_of = self%entries%list(k)%source
    end function source_of

    !> True if a key of the open table is given by a single text.
    pure logical function is_text_at(self, key)
        class(reader_type), intent(in) :: self
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

    !> True if a key of the open table is given by a text, or by a list that contains a text.
    pure logical function has_text(self, key)
        class(reader_type), intent(in) :: self
        character(len=*), intent(in) :: key
        integer :: k

        k = self%find(key)
        has_text = k > 0
        if (k > 0) has_text = any(self%entries%list(k)%value%atoms%kind == is_text)
    end function has_text

    !> Number of entries of the list of a key; 0 if the key is absent.
    pure integer function count_of(self, key) result(n)
        class(reader_type), intent(in) :: self
        character(len=*), intent(in) :: key
        integer :: k

        n = 0
        k = self%find(key)
        if (k > 0) n = size(self%entries%list(k)%value%atoms)
    end function count_of

    !> Entry of a key of the open table; 0 if absent, or after an error.
    pure integer function find(self, key) result(k)
        class(reader_type), intent(in) :: self
        character(len=*), intent(in) :: key
        integer :: i

        k = 0
        if (self%failed() .or. self%current == 0) return
        associate (element => self%elements(self%current))
            do i = element%n, 1, -1
                k = element%entries(i)
                if (key_of(self%entries%list(k), element) == key) return
            end do
        end associate
        k = 0
    end function find
end module tandem_mechanism_key_reader
