! SPDX-License-Identifier: MIT
!> The lexer of toml-f without constructs that scenes do not use and toml-f 0.5 reads wrongly:
!>
!> - dates: it reads behind the end of a time that is shorter than a date;
!> - headings of tables within tables, `[a.b]`: if a is a value already, it continues at an invalid position. Only
!>   mechanisms have such tables; there, a heading below a value is refused here.
!>
!> It also bounds the constructs for which the parser's work grows faster than the length of the text.
module tandem_io_scene_lexer
    use tandem, only: mechanism_kinds, mechanism_singles, to_text
    use tomlf, only: toml_datetime
    use tomlf_de_lexer, only: token_kind, toml_lexer, toml_token
    implicit none (type, external)
    private

    public :: scene_lexer_type

    !> A path of keys, a control character behind each.
    type :: path_type
        character(len=:), allocatable :: text
    end type path_type

    type, extends(toml_lexer) :: scene_lexer_type
        !> The first token that is refused, at which the parser has stopped; 0 if there is none. The dot of a heading is
        !> refused if the key before it is a value.
        integer :: refused = 0
        logical :: is_below_value = .false., is_doubled = .false.
        !> The limit that is exceeded there, for the message.
        character(len=:), allocatable :: limit
        !> Keys and elements of lists since the last heading, and headings.
        integer, private :: n_values_here = 0, n_tables = 0
        !> Brackets and braces that are open.
        integer, private :: depth = 0
        !> True if only blanks followed the last end of a line; true if the line is a heading; true after the sign that begins a
        !> value.
        logical, private :: is_at_start = .true., is_heading = .false., is_in_value = .false.
        !> The current heading, the keys of the line so far, and of a mechanism the values and headings: the first `n_values` and
        !> `n_headings`.
        character(len=:), allocatable, private :: heading, keys
        type(path_type), allocatable, private :: values(:), headings(:)
        integer, private :: n_values = 0, n_headings = 0
    contains
        procedure :: next, extract_datetime
        procedure, private :: take_key, keep_value, count_value, may_go_on, is_known, refuse_beyond
    end type scene_lexer_type

    !> The parser is called again at each bracket, looks for a key among all of its table, and copies lists and texts as they grow.
    integer, parameter :: most_nested = 200, most_values = 10000, most_tables = 5000, most_characters = 32768
    !> End of a key in a path; does not occur in scenes.
    character(len=*), parameter :: behind = achar(1)

contains

    !> The next token. The dot of a heading that is refused becomes one at which the parser stops.
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
                call lexer%refuse_beyond(token, lexer%n_tables, most_tables, 'headings')
            end if
            lexer%depth = lexer%depth + 1
            call lexer%refuse_beyond(token, lexer%depth, most_nested, 'brackets within each other')
        case (token_kind%rbracket, token_kind%rbrace)
            lexer%depth = lexer%depth - 1
            if (lexer%is_heading .and. lexer%depth == 0) then
                lexer%heading = lexer%keys
                ! The parser takes one that follows tables within it any number of times.
                if (lexer%is_known(lexer%headings, lexer%n_headings) .and. index(lexer%keys, behind) > 0) then
                    lexer%is_doubled = .true.
                    lexer%refused = token%first
                    token%kind = token_kind%invalid
                else if (is_of_mechanism(lexer%keys)) then
                    call add_path(lexer%keys, lexer%headings, lexer%n_headings)
                end if
            end if
        case (token_kind%mstring, token_kind%mliteral)
            call lexer%refuse_beyond(token, token%last - token%first, most_characters, 'characters in a text')
        case (token_kind%keypath, token_kind%string, token_kind%literal)
            if (lexer%is_heading .or. (lexer%depth == 0 .and. .not. lexer%is_in_value)) call lexer%take_key(token)
        case (token_kind%equal)
            call lexer%count_value(token)
            if (lexer%depth == 0 .and. .not. lexer%is_in_value) call lexer%keep_value()
            lexer%is_in_value = .true.
        case (token_kind%comma)
            call lexer%count_value(token)
        case (token_kind%dot)
            if (lexer%is_heading) then
                if (.not. lexer%may_go_on()) then
                    token%kind = token_kind%invalid
                    if (lexer%refused == 0) lexer%refused = token%first
                end if
            end if
        case default
            continue
        end select
        lexer%is_at_start = .false.
    end subroutine next

    !> One key, or one element of a list, more below the heading.
    subroutine count_value(lexer, token)
        class(scene_lexer_type), intent(inout) :: lexer
        type(toml_token), intent(inout) :: token

        lexer%n_values_here = lexer%n_values_here + 1
        call lexer%refuse_beyond(token, lexer%n_values_here, most_values, 'values below one heading')
    end subroutine count_value

    !> Refuse a token that exceeds a limit.
    subroutine refuse_beyond(lexer, token, n, most, things)
        class(scene_lexer_type), intent(inout) :: lexer
        type(toml_token), intent(inout) :: token
        !> How many there are, how many there may be, and of what.
        integer, intent(in) :: n, most
        character(len=*), intent(in) :: things

        if (n <= most) return
        token%kind = token_kind%invalid
        if (lexer%refused > 0) return
        lexer%refused = token%first
        lexer%limit = 'there may be '//to_text(most)//' '//things
    end subroutine refuse_beyond

    !> One key more of the line.
    subroutine take_key(lexer, token)
        class(scene_lexer_type), intent(inout) :: lexer
        type(toml_token), intent(in) :: token
        character(len=:), allocatable :: key

        call lexer%extract_string(token, key)
        lexer%keys = lexer%keys//key//behind
    end subroutine take_key

    !> The keys of the line lead to a value.
    subroutine keep_value(lexer)
        class(scene_lexer_type), intent(inout) :: lexer

        if (is_of_mechanism(lexer%heading//lexer%keys)) call add_path(lexer%heading//lexer%keys, lexer%values, lexer%n_values)
    end subroutine keep_value

    !> One path more in a list.
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

    !> True if the keys of the line are in a list.
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

    !> True if a heading may continue after the part read so far.
    logical function may_go_on(lexer)
        class(scene_lexer_type), intent(inout) :: lexer

        may_go_on = lexer%depth == 1 .and. is_of_mechanism(lexer%keys)
        if (may_go_on) lexer%is_below_value = lexer%is_known(lexer%values, lexer%n_values)
        if (lexer%is_below_value) may_go_on = .false.
    end function may_go_on

    !> True if a path begins with a table that contains tables.
    pure logical function is_of_mechanism(path)
        character(len=*), intent(in) :: path

        associate (first => path(:max(0, index(path, behind) - 1)))
            is_of_mechanism = any(first == mechanism_kinds) .or. any(first == mechanism_singles)
        end associate
    end function is_of_mechanism

    !> A date or a time keeps its type, by which it is refused, and has no value.
    subroutine extract_datetime(lexer, token, val)
        class(scene_lexer_type), intent(in) :: lexer
        type(toml_token), intent(in) :: token
        type(toml_datetime), intent(out) :: val
    end subroutine extract_datetime
end module tandem_io_scene_lexer
