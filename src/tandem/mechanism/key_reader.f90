! SPDX-License-Identifier: MIT
!> Reads keys with values: the tables of a scene and the elements of a mechanism, one after the other. One call per key returns its
!> value, checks it, and stores it with its unit and meaning. The same calls thus give the values, the list of valid keys, and the
!> complete description with all defaults.
!>
!> The first error is stored with the place of its entry; later calls then do nothing, so that a caller may check once after all
!> calls.
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

    !> Parts of an error in the tables of a scene, to which the name of the file and the line are added.
    type :: fault_type
        !> Message; remark beside the marked place; line below it, empty if there is none.
        character(len=:), allocatable :: message, remark, tail
        !> Heading of the table, shown if there is no place; empty if the message names it.
        character(len=:), allocatable :: heading
        !> Source of the table; true if the key is marked instead of its value.
        integer :: source = 0
        logical :: is_at_key = .false.
    end type fault_type

    !> Reads and checks the keys of one table or element after the other, and stores the first error.
    type :: reader_type
        !> First error, and the place of its entry, 0 if none; its parts, allocated for the tables of a scene.
        type(error_type), allocatable :: error
        integer :: place = 0
        type(fault_type), allocatable :: fault
        !> True if only values are read: the complete description is omitted.
        logical :: is_brief = .false.
        !> Parameters and their values.
        character(len=key_length), allocatable :: names(:)
        real(wp), allocatable :: values(:)
        !> Lines of the complete description so far: the first `n_shown`.
        type(shown_type), allocatable :: shown(:)
        integer :: n_shown = 0
        !> Name of the current element.
        character(len=:), allocatable :: name
        !> All entries, the caller's.
        type(entries_type), pointer :: entries => null()
        !> True for tables of a scene: keys are named without their table, and texts are not expressions.
        logical, private :: is_scene = .false.
        type(element_type), allocatable, private :: elements(:)
        integer, private :: n_elements = 0, current = 0
        !> Elements by kind and name; index, within its kind, of the last opened element.
        type(name_index_type), private :: by_name
        integer, private :: opened = 0
        logical, allocatable, private :: used(:)
        !> Tables that functions and laws may name.
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
        procedure, private :: complain, fail_at, evaluate, find, index_of, remember, heading_of
    end type reader_type

    ! Tables and elements.
    interface
        !> Take the entries of a mechanism, which contain no repetitions, and assign them to elements.
        module subroutine take(self, entries, kinds, singles)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            !> Must outlive the use of the reader.
            type(entries_type), intent(in), target :: entries
            !> Kinds of elements with names, and kinds of which there is one element.
            character(len=*), intent(in) :: kinds(:), singles(:)
        end subroutine take

        !> Take the entries of a scene, and assign them to tables.
        module subroutine take_tables(self, entries, arrays)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            !> Must outlive the use of the reader.
            type(entries_type), intent(in), target :: entries
            !> Tables that may come several times; their keys contain a number, as in `event.1.value`.
            character(len=*), intent(in) :: arrays(:)
        end subroutine take_tables

        !> Number of elements of a kind, or of tables that may come several times.
        pure integer module function n_of(self, kind)
            implicit none (type, external)
            class(reader_type), intent(in) :: self
            character(len=*), intent(in) :: kind
        end function n_of

        !> Select the table or the element of the following calls of `get`. A single table need not have entries.
        module subroutine open_table(self, table, number)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: table
            !> Index of the element in its kind, or of one of several tables of a name; 1 if absent.
            integer, intent(in), optional :: number
        end subroutine open_table

        !> Refuse all keys of the table that have not been requested.
        module subroutine close_table(self)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
        end subroutine close_table

        !> Names below a key of the element, which become known.
        module subroutine keys_below(self, key, names)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            character(len=key_length), allocatable, intent(out) :: names(:)
        end subroutine keys_below

        !> Make a key known to messages although it has no value here.
        pure module subroutine propose(self, key)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
        end subroutine propose

        !> Remove keys of the table that the description gives if one of others, which replace them, is given by a setting and is
        !> not 0.
        module subroutine replace(self, keys, by)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: keys(:), by(:)
        end subroutine replace

        !> Entry of a requested key, which becomes known; 0 if absent. A missing required key is an error.
        integer module function index_of(self, key, required, row_length) result(k)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            logical, intent(in), optional :: required
            !> Length of the rows of a matrix, which may be a list of lists; if absent, a list of lists is an error.
            integer, intent(in), optional :: row_length
        end function index_of
    end interface

    ! Values of any table.
    interface
        !> Read a number, in a mechanism also an expression of parameters; the value is unchanged if the key is absent.
        module subroutine get_number(self, key, value, check, unit, help, required)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            !> Default on entry, value on return; not allocated if there is neither.
            real(wp), allocatable, intent(inout) :: value
            !> `anything` (default), `positive` or `not_negative`.
            integer, intent(in), optional :: check
            !> Unit and meaning, for the complete description.
            character(len=*), intent(in), optional :: unit, help
            !> True if there is no default.
            logical, intent(in), optional :: required
        end subroutine get_number

        !> Read a list of numbers or expressions of one of several lengths.
        module subroutine get_numbers(self, key, lengths, values, check, unit, help, required, row_length)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            !> Valid lengths; in a mechanism a single number is accepted for a length of 1.
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
            !> Required number of texts, 0 for any number.
            integer, intent(in) :: length
            character(len=text_length), allocatable, intent(inout) :: texts(:)
            character(len=*), intent(in), optional :: help
            logical, intent(in), optional :: required
        end subroutine get_texts

        !> Copy texts that other modules read to the complete mechanism.
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

    ! Values that have a default, or a length, of their own.
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

        !> Read as many numbers as `values` has.
        module subroutine get_vector(self, key, values, check, unit, help)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            !> Defaults on entry, values on return.
            real(wp), intent(inout) :: values(:)
            integer, intent(in), optional :: check
            character(len=*), intent(in), optional :: unit, help
        end subroutine get_vector

        !> Read some of the texts in a list of choices, each once at most.
        module subroutine get_strings(self, key, values, choices, help, may_have_values)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            !> Default on entry, values on return.
            character(len=*), allocatable, intent(inout) :: values(:)
            character(len=*), intent(in) :: choices(:)
            character(len=*), intent(in), optional :: help
            !> True if elements may have the form NAME=NUMBER as well.
            logical, intent(in), optional :: may_have_values
        end subroutine get_strings

        !> Read one number for all of something, or one for each in a list.
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

        !> Add a table that functions and laws may name.
        module subroutine add_table(self, name, table)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: name
            type(table_type), intent(in) :: table
        end subroutine add_table

        !> Read a law of time, a coordinate and its rate.
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

        !> Read a list of numbers or expressions of variables, of one of several lengths.
        module subroutine get_expressions(self, key, lengths, variables, expressions, unit, help, required)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            !> Valid lengths; a single expression is accepted for a length of 1.
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
            !> Entry of the text, for messages and for the index of a repeated element.
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
        !> Set an error about a key of the element, or about the element if the key is absent.
        module subroutine fail(self, key, problem, advice)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key, problem, advice
        end subroutine fail

        !> Set an error about the value of a key of the table.
        module subroutine refuse(self, key, problem)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            !> Key, and description of the fault, such as `must be positive`.
            character(len=*), intent(in) :: key, problem
        end subroutine refuse

        !> Set an error about the entry with a place; 0 for the whole scene.
        module subroutine refuse_at(self, place, problem)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            integer, intent(in) :: place
            character(len=*), intent(in) :: problem
        end subroutine refuse_at

        !> Set an error that concerns no key of an element; `place` is unchanged.
        module subroutine refuse_all(self, problem, advice)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: problem, advice
        end subroutine refuse_all

        !> Store the error of a builder procedure, which names the element. Its place is that of the key or text in the message.
        module subroutine blame(self, error)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            type(error_type), allocatable, intent(inout) :: error
        end subroutine blame

        !> Store an error about all elements. Its place is in the element that the message names.
        module subroutine blame_named(self, error)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            type(error_type), allocatable, intent(inout) :: error
        end subroutine blame_named

        !> Set an error about the value of an entry of the table.
        module subroutine complain(self, entry, key, problem)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            !> Entry, 0 if none, and its key.
            integer, intent(in) :: entry
            character(len=*), intent(in) :: key, problem
        end subroutine complain

        !> Set an error about an entry of a mechanism, 0 if none.
        module subroutine fail_at(self, entry, problem, advice)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            integer, intent(in) :: entry
            character(len=*), intent(in) :: problem, advice
        end subroutine fail_at
    end interface

    ! The complete description.
    interface
        !> Append a line for a key: the value as given, or the default.
        module subroutine remember(self, key, entry, value, unit, help, is_whole)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: key
            !> Entry with the value, 0 if none.
            integer, intent(in) :: entry
            type(value_type), intent(in) :: value
            character(len=*), intent(in), optional :: unit, help
            !> True for an integer.
            logical, intent(in), optional :: is_whole
        end subroutine remember

        !> Append a line.
        module subroutine show(self, line)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            type(shown_type), intent(in) :: line
        end subroutine show

        !> Append a comment.
        module subroutine remark(self, words)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            character(len=*), intent(in) :: words
        end subroutine remark

        !> Exclude the keys read so far in the table from the complete scene, since others replace them. Giving such a key at the
        !> same time is an error.
        module subroutine hide(self, source, reason)
            implicit none (type, external)
            class(reader_type), intent(inout) :: self
            !> Source of the others.
            integer, intent(in) :: source
            !> Reason why both are not allowed.
            character(len=*), intent(in) :: reason
        end subroutine hide
    end interface

contains

    !> True after an error.
    pure logical function failed(self)
        class(reader_type), intent(in) :: self

        failed = allocated(self%error)
    end function failed

    !> Length of the heading of the current table: named elements have two brackets on each side.
    pure integer function heading_length(self)
        class(reader_type), intent(in) :: self

        associate (element => self%elements(self%current))
            heading_length = len_trim(element%kind) + merge(2, 4, element%name == '')
        end associate
    end function heading_length

    !> Heading of the current table.
    pure function heading_of(self) result(heading)
        class(reader_type), intent(in) :: self
        character(len=heading_length(self)) :: heading

        associate (element => self%elements(self%current))
            heading = '['//trim(element%kind)//']'
            if (element%name /= '') heading = '['//trim(heading)//']'
        end associate
    end function heading_of

    !> True if a key of the table is given.
    pure logical function gives(self, key)
        class(reader_type), intent(in) :: self
        character(len=*), intent(in) :: key

        gives = self%find(key) > 0
    end function gives

    !> Source that gives a key of the table: 0 the description, i the i-th setting, -1 none.
    pure integer function source_of(self, key)
        class(reader_type), intent(in) :: self
        character(len=*), intent(in) :: key
        integer :: k

        source_of = -1
        k = self%find(key)
        if (k > 0) source_of = self%entries%list(k)%source
    end function source_of

    !> True if a key of the table is given by one text.
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

    !> True if a key of the table is given by a text, or by a list that contains one.
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

    !> Entry of a key of the table; 0 if none, or after an error.
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
