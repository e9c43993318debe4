! SPDX-License-Identifier: MIT
!> The lexer of toml-f without what no scene takes and toml-f 0.5 reads wrongly:
!>
!> - dates: it reads behind the end of a time that is shorter than a date;
!> - headings of tables within tables, `[a.b]`: where a is a value already, it goes on with a place that does not exist. Only
!>   mechanisms have such tables; there, a heading that would go on below a value is refused here.
module tandem_io_scene_lexer
    use tandem, only: mechanism_kinds, mechanism_singles
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
        !> The dot in the first heading that is refused, where the parser has stopped; 0 where there is none. Whether it is refused
        !> since
        !> what stands before the dot is a value.
        integer :: nested = 0
        logical :: is_below_value = .false.
        !> Brackets and braces that are open.
        integer, private :: depth = 0
        !> Whether nothing but blanks has come since the end of a line, whether the line is a heading, and whether the sign that
        !> begins a value has come.
        logical, private :: is_at_start = .true., is_heading = .false., is_in_value = .false.
        !> The current heading, the keys of the line so far, and the values of a mechanism: the first `n_values`.
        character(len=:), allocatable, private :: heading, keys
        type(path_type), allocatable, private :: values(:)
        integer, private :: n_values = 0
    contains
        procedure :: next
        procedure :: extract_datetime
        procedure, private :: take_key
        procedure, private :: keep_value
        procedure, private :: may_go_on
    end type scene_lexer_type

    !> What ends a key in a path; no scene holds it.
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
            allocate (lexer%values(64))
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
            if (lexer%is_at_start) lexer%is_heading = .true.
            lexer%depth = lexer%depth + 1
        case (token_kind%rbracket, token_kind%rbrace)
            lexer%depth = lexer%depth - 1
            if (lexer%is_heading .and. lexer%depth == 0) lexer%heading = lexer%keys
        case (token_kind%keypath, token_kind%string, token_kind%literal)
            if (lexer%is_heading .or. (lexer%depth == 0 .and. .not. lexer%is_in_value)) call lexer%take_key(token)
        case (token_kind%equal)
            if (lexer%depth == 0 .and. .not. lexer%is_in_value) call lexer%keep_value()
            lexer%is_in_value = .true.
        case (token_kind%dot)
            if (lexer%is_heading) then
                if (.not. lexer%may_go_on()) then
                    token%kind = token_kind%invalid
                    if (lexer%nested == 0) lexer%nested = token%first
                end if
            end if
        case default
            continue
        end select
        lexer%is_at_start = .false.
    end subroutine next

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
        type(path_type), allocatable :: more(:)

        associate (path => lexer%heading//lexer%keys)
            if (.not. is_of_mechanism(path)) return
            if (lexer%n_values == size(lexer%values)) then
                allocate (more(2*lexer%n_values))
                more(:lexer%n_values) = lexer%values
                call move_alloc(more, lexer%values)
            end if
            lexer%n_values = lexer%n_values + 1
            lexer%values(lexer%n_values)%text = path
        end associate
    end subroutine keep_value

    !> Whether a heading may go on behind what stands of it so far.
    logical function may_go_on(lexer)
        class(scene_lexer_type), intent(inout) :: lexer
        integer :: i

        may_go_on = lexer%depth == 1 .and. is_of_mechanism(lexer%keys)
        if (.not. may_go_on) return
        do i = 1, lexer%n_values
            if (len(lexer%values(i)%text) /= len(lexer%keys)) cycle
            if (lexer%values(i)%text /= lexer%keys) cycle
            may_go_on = .false.
            lexer%is_below_value = .true.
        end do
    end function may_go_on

    !> Whether a path begins with a table that has tables within it.
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
