! SPDX-License-Identifier: MIT
!> Repeated elements. `repeat.bay.count` = "n" and `repeat.bay.index` = "i" define a repetition; the elements below `repeat.bay` may
!> contain `{i}` or `{i - 1}` in names and texts, and i in expressions. Each copy becomes an element of its own. Repetitions may be
!> nested, as in `repeat.bay.repeat.floor`, which is expanded for each copy of the outer one and may use its index.
module tandem_mechanism_repetition
    use tandem_error, only: error_type, set_error, to_text
    use tandem_kinds, only: wp
    use tandem_mechanism_element_keys, only: key_length
    use tandem_mechanism_entries, only: entries_type, entry_type, is_number, is_text, number_value, text_value, value_type
    use tandem_mechanism_expression, only: expression_type, parse_expression
    use tandem_mechanism_expression_parser, only: name_length
    use tandem_mechanism_parameters, only: check_parameter_name
    use tandem_status, only: status_invalid_model
    implicit none (type, external)
    private

    public :: repeat_elements

    !> Largest number of copies of a repetition, including nested ones, so that an incorrect count leads to an error; largest depth
    !> of nested repetitions.
    integer, parameter :: max_copies = 100000, max_depth = 4

    !> State of the expansion.
    type :: copying_type
        !> True for each entry of which a copy exists; number of copies so far; true if copies are only being counted.
        logical, allocatable :: is_copied(:)
        integer :: n_copies = 0
        logical :: is_counting = .false.
        !> Expanded entries; keys of the repetitions themselves.
        type(entries_type) :: expanded, repeats
        !> Position of the entry that causes an error.
        integer :: place = 0
    end type copying_type

    !> Names and values of the parameters, followed by those of the indices of the enclosing repetitions; the indices also as
    !> integers.
    type :: scope_type
        character(len=key_length), allocatable :: names(:)
        real(wp), allocatable :: values(:)
        integer, allocatable :: indices(:)
    end type scope_type

contains

    !> Length of the first `n_parts` parts of a key, or of the whole key if it has fewer parts. Dots within braces do not separate
    !> parts.
    pure integer function length_of(key, n_parts) result(length)
        character(len=*), intent(in) :: key
        integer, intent(in) :: n_parts
        integer :: n, depth

        n = 0
        depth = 0
        do length = 0, len(key) - 1
            if (key(length + 1:length + 1) == '{') depth = depth + 1
            if (key(length + 1:length + 1) == '}') depth = depth - 1
            if (key(length + 1:length + 1) == '.' .and. depth <= 0) n = n + 1
            if (n == n_parts) return
        end do
        length = len(key)
    end function length_of

    !> First `n_parts` parts of a key, or the whole key if it has fewer parts.
    pure function heading(key, n_parts) result(head)
        character(len=*), intent(in) :: key
        integer, intent(in) :: n_parts
        character(len=length_of(key, n_parts)) :: head

        head = key
    end function heading

    !> Expand all repetitions. `repeats` returns the keys of the repetitions themselves, with their defaults.
    subroutine repeat_elements(entries, names, values, expanded, repeats, error, place)
        type(entries_type), intent(in) :: entries
        !> Parameters.
        character(len=*), intent(in) :: names(:)
        real(wp), intent(in) :: values(:)
        type(entries_type), intent(out) :: expanded, repeats
        type(error_type), allocatable, intent(out) :: error
        !> Position of the entry that caused the error; 0 if there is none.
        integer, intent(out) :: place
        type(copying_type) :: state
        type(scope_type) :: scope
        character(len=:), allocatable :: head
        integer :: i, j, k

        scope%names = names
        scope%values = values
        scope%indices = [integer ::]
        allocate (state%is_copied(entries%n), source=.false.)
        copying: do i = 1, entries%n
            associate (entry => entries%list(i))
                if (index(entry%key, 'repeat.') /= 1) then
                    call state%expanded%append(entry)
                    cycle copying
                end if
                head = heading(entry%key, 2)
                if (state%repeats%find(head//'.count') > 0) cycle copying
                ! Count in a first pass, so that too many copies are refused before they are made.
                do k = merge(1, 2, any([(index(entries%list(j)%key, head//'.repeat.') == 1, j=i, entries%n)])), 2
                    state%n_copies = 0
                    state%is_counting = k == 1
                    call expand(state, entries, head//'.', scope, error)
                    if (allocated(error)) exit copying
                end do
            end associate
        end do copying
        ! Include elements of which there are no copies.
        do i = 1, merge(0, entries%n, allocated(error))
            if (index(entries%list(i)%key, 'repeat.') /= 1 .or. state%is_copied(i)) cycle
            if (state%repeats%find(entries%list(i)%key) == 0) call state%repeats%append(entries%list(i))
        end do
        expanded = state%expanded
        repeats = state%repeats
        place = state%place
    end subroutine repeat_elements

    !> Expand one repetition.
    recursive subroutine expand(state, entries, head, scope, error)
        type(copying_type), intent(inout) :: state
        type(entries_type), intent(in) :: entries
        !> Heading of the repetition, such as `repeat.bay.` or `repeat.bay.repeat.floor.`.
        character(len=*), intent(in) :: head
        type(scope_type), intent(in) :: scope
        type(error_type), allocatable, intent(inout) :: error
        character(len=:), allocatable :: index_name
        integer :: k, count, first

        if (size(scope%indices) == max_depth) then
            state%place = place_below(entries, head)
            call set_error(error, status_invalid_model, head(:len(head) - 1)//' is nested too deeply', &
                'nest at most '//to_text(max_depth)//' repetitions')
            return
        end if
        k = entries%find(head(:len(head) - 1))
        if (k > 0) then
            call set_error(error, status_invalid_model, entries%list(k)%key//' is a table, not a value', &
                'write '//entries%list(k)%key//'.count = ... and the elements below it')
            state%place = entries%list(k)%place
            return
        end if
        allocate (index_name, source='i')
        k = entries%find(head//'index')
        if (k > 0) then
            associate (given => entries%list(k))
                state%place = given%place
                if (given%value%is_list .or. given%value%atoms(1)%kind /= is_text) then
                    call set_error(error, status_invalid_model, given%key//' is not a string', 'give a name, such as "i"')
                    return
                end if
                index_name = given%value%atoms(1)%text
                call check_parameter_name(index_name, error)
                if (allocated(error)) return
            end associate
        end if
        if (any(scope%names == index_name)) then
            if (k == 0) state%place = place_below(entries, head)
            call set_error(error, status_invalid_model, head//'index: "'//index_name//'" is the name of a parameter'// &
                trim(merge(' or of an outer index', '                     ', size(scope%indices) > 0)), 'take another one')
            return
        end if
        call get_count(state, entries, head//'count', -1, scope, count, error)
        if (allocated(error)) return
        call get_count(state, entries, head//'first', 1, scope, first, error)
        if (allocated(error)) return
        state%n_copies = state%n_copies + max(0, min(count, max_copies + 1))
        if (count < 0 .or. state%n_copies > max_copies) then
            if (count < 0 .or. count > max_copies) then
                call set_error(error, status_invalid_model, head//'count is '//to_text(count), &
                    'give a number from 0 to '//to_text(max_copies))
            else
                call set_error(error, status_invalid_model, head(:len(head) - 1)//' results in more than '//to_text(max_copies)// &
                    ' copies', 'give smaller numbers')
            end if
            k = entries%find(head//'count')
            if (k > 0) state%place = entries%list(k)%place
            return
        end if
        call state%repeats%set(head//'index', text_value(index_name))
        call copy_elements(state, entries, head, index_name, first, first + count - 1, scope, error)
    end subroutine expand

    !> Copy the elements below a heading once for each value of the index.
    recursive subroutine copy_elements(state, entries, head, index_name, first, last, scope, error)
        type(copying_type), intent(inout) :: state
        type(entries_type), intent(in) :: entries
        character(len=*), intent(in) :: head, index_name
        integer, intent(in) :: first, last
        type(scope_type), intent(in) :: scope
        type(error_type), allocatable, intent(inout) :: error
        type(scope_type) :: inside
        type(entry_type) :: copy
        character(len=:), allocatable :: below, inner, done
        integer :: i, k, depth, n

        n = size(scope%names)
        depth = size(scope%indices) + 1
        allocate (inside%names(n + 1))
        inside%names(:n) = scope%names
        inside%names(n + 1) = index_name
        do i = first, last
            inside%values = [scope%values, real(i, wp)]
            inside%indices = [scope%indices, i]
            allocate (done, source='')
            do k = 1, merge(0, entries%n, state%is_counting)
                associate (entry => entries%list(k))
                    if (index(entry%key, head) /= 1) cycle
                    below = entry%key(len(head) + 1:)
                    if (any(below == [character(len=5) :: 'count', 'index', 'first']) .or. index(below, 'repeat.') == 1) cycle
                    state%place = entry%place
                    if (index(below, '.') == 0) then
                        call set_error(error, status_invalid_model, 'unknown key "'//below//'" of '//head(:len(head) - 1), &
                            'its keys are count, index, first, and elements: body.NAME.KEY, joint.NAME.KEY, ...')
                        return
                    end if
                    copy = entry
                    copy%template = entry%key
                    copy%n_heading = len(heading(entry%key, 2*depth + 2))
                    if (copy%n_heading == len(entry%key)) copy%n_heading = len(heading(entry%key, 2*depth + 1))
                    allocate (copy%index_names(depth))
                    copy%index_names(:) = [character(len=name_length) :: inside%names(n - depth + 2:)]
                    copy%index_values = inside%indices
                    copy%is_first = .not. state%is_copied(k)
                    state%is_copied(k) = .true.
                    call fill(below, entry%key, inside, copy%key, error)
                    if (allocated(error)) return
                    call fill_texts(copy%value, entry%key, inside, error)
                    if (allocated(error)) return
                    call state%expanded%append(copy)
                    deallocate (copy%index_names)
                end associate
            end do
            ! Nested repetitions follow the other elements of a copy, wherever they are given.
            do k = 1, entries%n
                if (index(entries%list(k)%key, head//'repeat.') /= 1) cycle
                inner = head//heading(entries%list(k)%key(len(head) + 1:), 2)//'.'
                if (index(done, '|'//inner//'|') > 0) cycle
                done = done//'|'//inner//'|'
                call expand(state, entries, inner, inside, error)
                if (allocated(error)) return
            end do
            deallocate (done)
        end do
    end subroutine copy_elements

    !> Read an integer, or evaluate an expression of parameters.
    subroutine get_count(state, entries, key, default, scope, number, error)
        type(copying_type), intent(inout) :: state
        type(entries_type), intent(in) :: entries
        character(len=*), intent(in) :: key
        integer, intent(in) :: default
        type(scope_type), intent(in) :: scope
        integer, intent(out) :: number
        type(error_type), allocatable, intent(inout) :: error
        integer :: at

        number = default
        at = entries%find(key)
        if (at > 0) then
            associate (given => entries%list(at))
                state%place = given%place
                if (given%value%is_list .or. all(given%value%atoms(1)%kind /= [is_number, is_text])) then
                    call set_error(error, status_invalid_model, given%key//' is not a number', 'give an integer, or an '// &
                        'expression in quotes')
                else if (given%value%atoms(1)%kind == is_number) then
                    call to_integer(given%value%atoms(1)%number, given%key, number, error)
                else
                    call evaluate(given%value%atoms(1)%text, given%key, scope, number, error)
                end if
                if (.not. allocated(error)) call state%repeats%set(given%key, given%value, given%place)
            end associate
        else if (default < 0) then
            associate (head => key(:index(key, '.', back=.true.)))
                state%place = place_below(entries, head)
                call set_error(error, status_invalid_model, head(:len(head) - 1)//': the key count is missing', 'add it')
            end associate
        else
            call state%repeats%set(key, number_value(real(default, wp)))
        end if
    end subroutine get_count

    !> Position of the first entry of a repetition.
    integer function place_below(entries, head)
        type(entries_type), intent(in) :: entries
        character(len=*), intent(in) :: head
        integer :: j

        place_below = 0
        do j = entries%n, 1, -1
            if (index(entries%list(j)%key, head) == 1) place_below = entries%list(j)%place
        end do
    end function place_below

    !> Convert a number to an integer, with an error if it is not one.
    subroutine to_integer(number, key, whole, error)
        type(error_type), allocatable, intent(inout) :: error
        real(wp), intent(in) :: number
        character(len=*), intent(in) :: key
        integer, intent(out) :: whole

        whole = 0
        if (.not. abs(number) < huge(1)) then
            call set_error(error, status_invalid_model, key//' gives '//to_text(number), 'give an integer')
            return
        end if
        whole = nint(number)
        if (abs(number - whole) > 1.0e-9_wp) then
            call set_error(error, status_invalid_model, key//' gives '//to_text(number), 'give an integer')
        end if
    end subroutine to_integer

    !> Evaluate an expression with an integer value.
    subroutine evaluate(text, key, scope, whole, error)
        type(error_type), allocatable, intent(inout) :: error
        character(len=*), intent(in) :: text, key
        type(scope_type), intent(in) :: scope
        integer, intent(out) :: whole
        type(expression_type) :: expression

        whole = 0
        call parse_expression(expression, text, [character(len=1) ::], error, scope%names, scope%values, key)
        if (.not. allocated(error)) call to_integer(expression%value([real(wp) ::]), key//': "'//text//'"', whole, error)
    end subroutine evaluate

    !> Replace expressions in braces in a text by their values.
    subroutine fill(text, key, scope, filled, error)
        character(len=*), intent(in) :: text, key
        type(scope_type), intent(in) :: scope
        character(len=:), allocatable, intent(inout) :: filled
        type(error_type), allocatable, intent(inout) :: error
        integer :: at, from, to, whole

        filled = ''
        at = 1
        do
            from = index(text(at:), '{')
            if (from == 0) exit
            from = from + at - 1
            to = index(text(from:), '}') + from - 1
            if (to < from) then
                call set_error(error, status_invalid_model, key//': "'//text//'" has an unclosed brace', 'write {'// &
                    trim(scope%names(size(scope%names)))//'}')
                return
            end if
            call evaluate(text(from + 1:to - 1), key, scope, whole, error)
            if (allocated(error)) return
            filled = filled//text(at:from - 1)//to_text(whole)
            at = to + 1
        end do
        filled = filled//text(at:)
    end subroutine fill

    !> Replace expressions in braces in all texts of a value.
    subroutine fill_texts(value, key, scope, error)
        type(value_type), intent(inout) :: value
        character(len=*), intent(in) :: key
        type(scope_type), intent(in) :: scope
        type(error_type), allocatable, intent(inout) :: error
        character(len=:), allocatable :: filled
        integer :: j

        do j = 1, size(value%atoms)
            if (value%atoms(j)%kind /= is_text) cycle
            if (index(value%atoms(j)%text, '{') == 0) cycle
            call fill(value%atoms(j)%text, key, scope, filled, error)
            if (allocated(error)) return
            value%atoms(j)%text = filled
        end do
    end subroutine fill_texts
end module tandem_mechanism_repetition
