! SPDX-License-Identifier: MIT
!> The lexer of toml-f without what no scene takes and toml-f 0.5 reads wrongly:
!>
!> - dates: it reads behind the end of a time that is shorter than a date;
!> - headings of tables within tables, `[a.b]`: where a is a value already, it goes on with a place that does not exist.
module tandem_io_scene_lexer
    use tomlf, only: toml_datetime
    use tomlf_de_lexer, only: token_kind, toml_lexer, toml_token
    implicit none (type, external)
    private

    public :: scene_lexer_type

    type, extends(toml_lexer) :: scene_lexer_type
        !> The dot in the first heading of a table within a table, where the parser has stopped; 0 where there is none.
        integer :: nested = 0
        !> Brackets and braces that are open.
        integer, private :: depth = 0
        !> Whether nothing but blanks has come since the end of a line, and whether the line is a heading.
        logical, private :: is_at_start = .true., is_heading = .false.
    contains
        procedure :: next
        procedure :: extract_datetime
    end type scene_lexer_type

contains

    !> The next token. The dot of a heading becomes one at which the parser stops.
    subroutine next(lexer, token)
        class(scene_lexer_type), intent(inout) :: lexer
        type(toml_token), intent(inout) :: token

        call lexer%toml_lexer%next(token)
        select case (token%kind)
        case (token_kind%whitespace)
            return
        case (token_kind%newline)
            if (lexer%depth == 0) lexer%is_heading = .false.
            lexer%is_at_start = lexer%depth == 0
            return
        case (token_kind%lbracket, token_kind%lbrace)
            if (lexer%is_at_start) lexer%is_heading = .true.
            lexer%depth = lexer%depth + 1
        case (token_kind%rbracket, token_kind%rbrace)
            lexer%depth = lexer%depth - 1
        case (token_kind%dot)
            if (lexer%is_heading) then
                token%kind = token_kind%invalid
                if (lexer%nested == 0) lexer%nested = token%first
            end if
        case default
            continue
        end select
        lexer%is_at_start = .false.
    end subroutine next

    !> A date or a time keeps its type, by which it is refused, and has no value.
    subroutine extract_datetime(lexer, token, val)
        class(scene_lexer_type), intent(in) :: lexer
        type(toml_token), intent(in) :: token
        type(toml_datetime), intent(out) :: val
    end subroutine extract_datetime
end module tandem_io_scene_lexer
