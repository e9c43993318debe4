! SPDX-License-Identifier: MIT
!> The lexer of toml-f, restricted to constructs that scenes need. toml-f 0.5 reads the following ones incorrectly:
!> - Dates: the parser reads beyond the end of a time that is shorter than a date.
!> - Headings of subtables, `[a.b]`: if a is a value, the parser continues at an invalid position. Such headings occur only in
!>   mechanisms, where this lexer refuses a heading below a value.
!>
!> The lexer also limits constructs for which the work of the parser grows faster than the length of the text.
module tandem_io_scene_lexer
    use tandem, only: mechanism_kinds, mechanism_singles, to_text
    use tomlf, only: toml_datetime
    use tomlf_de_lexer, only: token_kind, toml_lexer, toml_token
    implicit none (type, external)
    private

    public :: scene_lexer_type

    !> A path of keys, each followed by a separator.
    type :: path_type
        character(len=:), allocatable :: text
    end type path_type

    type, extends(toml_lexer) :: scene_lexer_type
        !> Position of the first refused token, at which the parser stops; 0 if no token was refused. The reason is that the heading
        !> lies below a value or occurs twice, or that `limit` is exceeded.
        integer :: refused = 0
        logical :: is_below_value = .false., is_duplicate = .false.
        !> Description of the exceeded limit.
        character(len=:), allocatable :: limit
        !> Number of keys and list elements since the last heading; number of headings.
        integer, private :: n_values_here = 0, n_tables = 0
        !> Nesting depth of brackets and braces.
        integer, private :: depth = 0
        !> True at the beginning of a line; true within a heading; true after the equals sign of a value.
        logical, private :: is_at_start = .true., is_heading = .false., is_in_value = .false.
        !> Current heading; keys read so far in the line; paths of the values and headings of a mechanism, of which the first
        !> `n_values` and `n_headings` are in use.
        character(len=:), allocatable, private :: heading, keys
        type(path_type), allocatable, private :: values(:), headings(:)
        integer, private :: n_values = 0, n_headings = 0
    contains
        procedure :: next, extract_datetime
        procedure, private :: append_key, store_value, count_value, may_continue, is_known, check_limit
    end type scene_lexer_type

    !> Limits. The parser is recursive in brackets, searches a table linearly for each key, and copies lists and texts as they grow.
    integer, parameter :: largest_depth = 200, most_values = 10000, most_tables = 5000, most_characters = 32768
    !> Separator after each key in a path; does not occur in scenes.
    character(len=*), parameter :: separator = achar(1)

contains

    !> Read the next token. The dot of a refused heading becomes an invalid token, at which the parser stops.
    subroutine next(lexer, token)
        class(scene_lexer_type), intent(inout) :: lexer
        type(toml_token), intent(inout) :: token

        call lexer%toml_lexer%next(token)
        if (.not. allocated(lexer%keys)) then
            lexer%heading = ''
            lexer%keys = ''
            allocate (lexer%values(64), lexer%headings(64))
        end if
        select case (token%kind)
        case (token_kind%whitespace)
            return
        case (token_kind%newline)
            if (lexer%depth == 0) then
                lexer%is_heading = .false.
                lexer%is_in_value = .false.
                lexer%keys = ''
            end if
            lexer%is_at_start = lexer%depth == 0
            return
        case (token_kind%lbracket, token_kind%lbrace)
            if (lexer%is_at_start) then
                lexer%is_heading = .true.
                lexer%n_values_here = 0
                lexer%n_tables = lexer%n_tables + 1
                call lexer%check_limit(token, lexer%n_tables, most_tables, 'headings')
            end if
            lexer%depth = lexer%depth + 1
            call lexer%check_limit(token, lexer%depth, largest_depth, 'brackets within each other')
        case (token_kind%rbracket, token_kind%rbrace)
            lexer%depth = lexer%depth - 1
            if (lexer%is_heading .and. lexer%depth == 0) then
                lexer%heading = lexer%keys
                ! The parser accepts duplicates of a heading if headings of subtables precede them.
                if (lexer%is_known(lexer%headings, lexer%n_headings) .and. index(lexer%keys, separator) > 0) then
                    lexer%is_duplicate = .true.
                    lexer%refused = token%first
                    token%kind = token_kind%invalid
                else if (is_of_mechanism(lexer%keys)) then
                    call add_path(lexer%keys, lexer%headings, lexer%n_headings)
                end if
            end if
        case (token_kind%mstring, token_kind%mliteral)
            call lexer%check_limit(token, token%last - token%first, most_characters, 'characters in a text')
        case (token_kind%keypath, token_kind%string, token_kind%literal)
            if (lexer%is_heading .or. (lexer%depth == 0 .and. .not. lexer%is_in_value)) call lexer%append_key(token)
        case (token_kind%equal)
            call lexer%count_value(token)
            if (lexer%depth == 0 .and. .not. lexer%is_in_value) call lexer%store_value()
            lexer%is_in_value = .true.
        case (token_kind%comma)
            call lexer%count_value(token)
        case (token_kind%dot)
            if (lexer%is_heading) then
                if (.not. lexer%may_continue()) then
                    token%kind = token_kind%invalid
                    if (lexer%refused == 0) lexer%refused = token%first
                end if
            end if
        case default
            continue
        end select
        lexer%is_at_start = .false.
    end subroutine next

    !> Count a key or a list element below the current heading.
    subroutine count_value(lexer, token)
        class(scene_lexer_type), intent(inout) :: lexer
        type(toml_token), intent(inout) :: token

        lexer%n_values_here = lexer%n_values_here + 1
        call lexer%check_limit(token, lexer%n_values_here, most_values, 'values below one heading')
    end subroutine count_value

    !> Refuse a token that exceeds a limit.
    subroutine check_limit(lexer, token, n, most, things)
        class(scene_lexer_type), intent(inout) :: lexer
        type(toml_token), intent(inout) :: token
        !> Number of items, largest number, and name of the items.
        integer, intent(in) :: n, most
        character(len=*), intent(in) :: things

        if (n <= most) return
        token%kind = token_kind%invalid
        if (lexer%refused > 0) return
        lexer%refused = token%first
        lexer%limit = 'there may be '//to_text(most)//' '//things
    end subroutine check_limit

    !> Append a key to the keys of the line.
    subroutine append_key(lexer, token)
        class(scene_lexer_type), intent(inout) :: lexer
        type(toml_token), intent(in) :: token
        character(len=:), allocatable :: key

        call lexer%extract_string(token, key)
        lexer%keys = lexer%keys//key//separator
    end subroutine append_key

    !> Store the path of a value.
    subroutine store_value(lexer)
        class(scene_lexer_type), intent(inout) :: lexer

        if (is_of_mechanism(lexer%heading//lexer%keys)) call add_path(lexer%heading//lexer%keys, lexer%values, lexer%n_values)
    end subroutine store_value

    !> Append a path to a list.
    pure subroutine add_path(path, list, n)
        character(len=*), intent(in) :: path
        type(path_type), allocatable, intent(inout) :: list(:)
        integer, intent(inout) :: n
        type(path_type), allocatable :: more(:)

        if (n == size(list)) then
            allocate (more(2*n))
            more(:n) = list
            call move_alloc(more, list)
        end if
        n = n + 1
        list(n)%text = path
    end subroutine add_path

    !> True if the path of the line is in a list.
    pure logical function is_known(lexer, list, n)
        class(scene_lexer_type), intent(in) :: lexer
        type(path_type), intent(in) :: list(:)
        integer, intent(in) :: n
        integer :: i

        is_known = .true.
        do i = 1, n
            if (len(list(i)%text) /= len(lexer%keys)) cycle
            if (list(i)%text == lexer%keys) return
        end do
        is_known = .false.
    end function is_known

    !> True if the part of a heading read so far may be followed by a dot.
    logical function may_continue(lexer)
        class(scene_lexer_type), intent(inout) :: lexer

        may_continue = lexer%depth == 1 .and. is_of_mechanism(lexer%keys)
        if (may_continue) lexer%is_below_value = lexer%is_known(lexer%values, lexer%n_values)
        if (lexer%is_below_value) may_continue = .false.
    end function may_continue

    !> True if a path begins with a table that may have subtables.
    pure logical function is_of_mechanism(path)
        character(len=*), intent(in) :: path

        associate (first => path(:max(0, index(path, separator) - 1)))
            is_of_mechanism = any(first == mechanism_kinds) .or. any(first == mechanism_singles)
        end associate
    end function is_of_mechanism

    !> Leave dates and times without a value; they are refused later because of their type.
    subroutine extract_datetime(lexer, token, val)
        class(scene_lexer_type), intent(in) :: lexer
        type(toml_token), intent(in) :: token
        type(toml_datetime), intent(out) :: val
    end subroutine extract_datetime
end module tandem_io_scene_lexer
