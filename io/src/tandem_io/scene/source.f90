! SPDX-License-Identifier: MIT
!> A source of keys: a file, or one `--set table.key=value` of the command line. A source is parsed once; its text is stored, so
!> that error messages can show the line.
module tandem_io_scene_source
    use tandem, only: error_type, mechanism_kinds, mechanism_singles
    use tandem_status, only: status_invalid_option
    use tandem_io_path, only: is_pipe
    use tandem_io_scene_lexer, only: scene_lexer_type
    use tandem_io_scene_text, only: to_toml
    use tomlf, only: toml_context, toml_error, toml_parser_config, toml_table
    use tomlf_de_lexer, only: new_lexer_from_string, toml_token
    use tomlf_de_parser, only: parse
    use tomlf_de_token, only: token_kind
    use tomlf_diagnostic, only: render, toml_diagnostic, toml_label, toml_level
    use tomlf_terminal, only: toml_terminal
    implicit none (type, external)
    private

    public :: parsed_type, source_type, check_limits, check_text, read_text, set_input_error

    !> Largest size of a file, in bytes; sufficient for some thousand bodies with all defaults.
    integer, parameter :: largest = 4194304
    !> Largest number of lines, and of bytes and dots per line. The limits exist because messages show complete lines, and because
    !> the parser is recursive in dots. The lexer limits other constructs for which the work of the parser grows faster than the
    !> text.
    integer, parameter :: most_lines = 100000, most_bytes = 32768, most_dots = 1000

    !> Byte order mark, which some editors write before UTF-8.
    character(len=*), parameter :: byte_order_mark = char(239)//char(187)//char(191)

    type :: source_type
        !> Name of the source in messages, and its text.
        character(len=:), allocatable :: name, text
        !> True for an argument of `--set`.
        logical :: is_setting = .false.
        !> Kind of the file in messages.
        character(len=8) :: kind = 'scene'
    contains
        procedure :: load_file, load_text, load_argument, describe
    end type source_type

    !> Parsed text of a source, and the positions of its parts.
    type :: parsed_type
        type(toml_table), allocatable :: root
        type(toml_context) :: context
    contains
        procedure :: value_of, end_of
    end type parsed_type

contains

    !> Read and parse a scene file.
    subroutine load_file(self, path, parsed, error)
        class(source_type), intent(inout) :: self
        !> Path of the file.
        character(len=*), intent(in) :: path
        type(parsed_type), intent(inout) :: parsed
        type(error_type), allocatable, intent(out) :: error
        character(len=:), allocatable :: text

        call read_text(path, trim(self%kind), text, error)
        if (allocated(error)) return
        call parse_text(text, path, self, parsed, error)
    end subroutine load_file

    !> Parse a text.
    subroutine load_text(self, name, text, parsed, error)
        class(source_type), intent(inout) :: self
        !> Name of the text in messages, and the text.
        character(len=*), intent(in) :: name, text
        type(parsed_type), intent(inout) :: parsed
        type(error_type), allocatable, intent(out) :: error

        call check_text(name, text, error, trim(self%kind))
        if (.not. allocated(error)) call parse_text(text, name, self, parsed, error)
    end subroutine load_text

    !> Parse a setting: `table.key=value`; for arrays of tables `table.number.key=value`, or all tables as `table=[...]`; for
    !> mechanisms `body.name.key=value`. The value is TOML; a bare word that is not TOML is a text.
    subroutine load_argument(self, argument, parsed, error)
        class(source_type), intent(inout) :: self
        !> Argument of `--set`.
        character(len=*), intent(in) :: argument
        type(parsed_type), intent(inout) :: parsed
        type(error_type), allocatable, intent(out) :: error
        character(len=*), parameter :: letters = 'abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-'
        character(len=*), parameter :: usage = ' must be table.key=value, as in --set solver.step=1e-3; an event has a number, '// &
            'as in --set event.1.value=0.5'
        type(error_type), allocatable :: second
        character(len=:), allocatable :: value
        integer :: dot, second_dot, equals

        equals = index(argument, '=')
        dot = index(argument(:max(equals - 1, 0)), '.')
        second_dot = dot
        if (dot > 0) second_dot = dot + index(argument(dot + 1:equals - 1), '.')
        value = trim(adjustl(argument(equals + 1:)))
        call check_text('--set', argument, error)
        if (allocated(error)) return
        if (scan(argument, achar(10)//achar(13)) > 0) then
            call set_input_error(error, '--set takes one line')
        else if (.not. is_path()) then
            call set_input_error(error, '--set '//argument//usage)
        else if (len(value) == 0) then
            call set_input_error(error, '--set '//argument//' has no value')
        end if
        if (allocated(error)) return
        self%is_setting = .true.
        call parse_text(argument, '--set', self, parsed, error)
        if (.not. allocated(error) .or. scan(value(1:1), '"''[{') > 0) return
        call parse_text(argument(:equals)//to_toml(value), '--set', self, parsed, second)
        if (.not. allocated(second)) deallocate (error)
    contains
        !> True if the left-hand side of the setting is the key of a table or the name of an array of tables.
        pure logical function is_path()
            is_path = equals > second_dot + 1
            if (.not. is_path) return
            if (dot > 0) then
                ! Invalid text in the rest is reported by the parser.
                if (any(argument(:dot - 1) == mechanism_kinds) .or. any(argument(:dot - 1) == mechanism_singles)) return
            end if
            if (dot == 0) then
                is_path = index(value, '[') == 1 .and. verify(argument(:equals - 1), letters) == 0
            else
                is_path = dot > 1 .and. verify(argument(:dot - 1)//argument(second_dot + 1:equals - 1), letters) == 0
                if (second_dot > dot) is_path = is_path .and. second_dot > dot + 1 .and. &
                    verify(argument(dot + 1:second_dot - 1), '0123456789') == 0
            end if
        end function is_path
    end subroutine load_argument

    !> Message about a position in the source. It shows the file, the line number, the line, a marker below the position, and a
    !> remark beside the marker.
    function describe(self, message, span, remark) result(text)
        class(source_type), intent(in) :: self
        !> Description of the error.
        character(len=*), intent(in) :: message
        !> First and last character of the position; 0 if there is none.
        integer, intent(in) :: span(2)
        !> Short remark for the marker.
        character(len=*), intent(in) :: remark
        character(len=:), allocatable :: text

        if (span(1) > 0) then
            text = without_level(render(toml_diagnostic(toml_level%error, message, self%name, &
                [toml_label(toml_level%error, span(1), span(2), remark, .true.)]), self%text, toml_terminal(.false.)))
        else
            text = message//new_line('a')//' --> '//self%name
        end if
    end function describe

    !> Position of the list or inline table that is the value of a key; position of the key if its value is neither.
    pure integer function value_of(self, origin)
        class(parsed_type), intent(in) :: self
        integer, intent(in) :: origin
        integer :: i
        logical :: has_equal

        value_of = origin
        if (origin < 1) return
        has_equal = .false.
        do i = origin + 1, self%context%top
            associate (kind => self%context%token(i)%kind)
                if (kind == token_kind%whitespace) cycle
                if (has_equal .and. (kind == token_kind%lbracket .or. kind == token_kind%lbrace)) value_of = i
                if (has_equal .or. kind /= token_kind%equal) return
                has_equal = .true.
            end associate
        end do
    end function value_of

    !> Last token of the value that begins at a position. For a list or an inline table, this is the closing bracket if it is on the
    !> same line.
    pure integer function end_of(self, origin)
        class(parsed_type), intent(in) :: self
        integer, intent(in) :: origin
        integer :: depth, i

        end_of = origin
        depth = 0
        do i = origin, self%context%top
            associate (kind => self%context%token(i)%kind)
                if (kind == token_kind%newline) return
                if (kind == token_kind%lbracket .or. kind == token_kind%lbrace) depth = depth + 1
                if (kind == token_kind%rbracket .or. kind == token_kind%rbrace) depth = depth - 1
            end associate
            if (depth <= 0) exit
        end do
        if (depth <= 0) end_of = min(i, self%context%top)
    end function end_of

    !> Set an input error.
    subroutine set_input_error(error, message)
        type(error_type), allocatable, intent(out) :: error
        !> Complete message. Control characters, which quoted keys may contain, are replaced because the message is written to a
        !> terminal.
        character(len=*), intent(in) :: message
        integer :: i

        allocate (error)
        error%stat = status_invalid_option
        error%message = message
        do i = 1, len(message)
            select case (iachar(message(i:i)))
            case (0:8, 11:31, 127)
                error%message(i:i) = '?'
            case default
                cycle
            end select
        end do
    end subroutine set_input_error

    !> Read a complete file as text. Pipes of the shell (/dev/stdin, /dev/fd/63) are allowed, so that the size is not known in
    !> advance.
    subroutine read_text(path, kind, text, error)
        !> Path and kind of the file.
        character(len=*), intent(in) :: path, kind
        character(len=:), allocatable, intent(out) :: text
        type(error_type), allocatable, intent(out) :: error
        character(len=256) :: message
        character :: letter
        integer :: unit, stat, length

        ! Opening any other pipe may block.
        if (is_pipe(path) .and. index(path, '/dev/') /= 1 .and. index(path, '/proc/') /= 1) then
            call set_input_error(error, 'cannot read the '//kind//' '//path//': it is a pipe; give a file, or have the shell '// &
                'connect the pipe to /dev/stdin')
            return
        end if
        message = ''
        open (newunit=unit, file=path, status='old', action='read', access='stream', form='unformatted', iostat=stat, &
            iomsg=message)
        if (stat /= 0) then
            call set_input_error(error, 'cannot read the '//kind//': '//trim(message))
            return
        end if
        allocate (character(len=largest + 1) :: text)
        length = 0
        do while (length <= largest)
            read (unit, iostat=stat, iomsg=message) letter
            if (stat /= 0) exit
            length = length + 1
            text(length:length) = letter
        end do
        close (unit)
        if (stat /= 0 .and. .not. is_iostat_end(stat)) then
            call set_input_error(error, 'cannot read the '//kind//' '//path//': '//trim(message))
        else
            text = text(:length)
            ! The byte order mark has no meaning in UTF-8.
            if (index(text, byte_order_mark) == 1) text = text(len(byte_order_mark) + 1:)
            call check_text(path, text, error, kind)
        end if
    end subroutine read_text

    !> Refuse invalid texts before they are parsed. Accepted texts are UTF-8 of bounded length, depth and number of parts.
    subroutine check_text(path, text, error, kind)
        !> Name of the text in messages.
        character(len=*), intent(in) :: path
        character(len=*), intent(in) :: text
        type(error_type), allocatable, intent(out) :: error
        !> Kind of the file in messages; a scene if absent.
        character(len=*), intent(in), optional :: kind
        character(len=:), allocatable :: problem, what
        integer :: i, code, line, bytes, dots, broken

        what = 'scene'
        if (present(kind)) what = kind
        if (len(text) > largest) then
            call set_input_error(error, path//' is not a valid '//what//': it has more than '//to_toml(largest)//' bytes')
            return
        end if
        line = 1
        bytes = 0
        dots = 0
        broken = first_broken(text)
        problem = ''
        do i = 1, len(text)
            if (i == broken) problem = 'contains bytes that are not UTF-8'
            bytes = bytes + 1
            if (bytes > most_bytes) problem = 'has more than '//to_toml(most_bytes)//' bytes'
            code = iachar(text(i:i))
            select case (code)
            case (0:8, 11:31, 127)
                if (text(i:min(i + 1, len(text))) == achar(13)//achar(10)) cycle
                problem = 'contains the control character '//to_toml(code)//'; is it a binary file?'
            case (10)
                line = line + 1
                bytes = 0
                dots = 0
                if (line > most_lines) problem = 'exceeds the limit of '//to_toml(most_lines)
            case (iachar('.'))
                dots = dots + 1
                if (dots > most_dots) problem = 'has more than '//to_toml(most_dots)//' dots'
            case (iachar('\'))
                ! In these two cases the parser would read beyond the end of the text.
                if (text(i:min(i + 1, len(text))) == '\x') then
                    problem = 'contains "\x", which is not part of TOML 1.0; write "\u00"'
                else if (ends_text(text(i + 1:))) then
                    problem = 'ends a string with a backslash'
                end if
            case default
                continue
            end select
            if (problem == '') cycle
            call set_input_error(error, path//' is not a valid '//what//': line '//to_toml(line)//' '//problem)
            return
        end do
    end subroutine check_text

    !> True if only white space, at least one character, precedes three quotation marks.
    pure logical function ends_text(text)
        character(len=*), intent(in) :: text
        integer :: first

        first = verify(text, ' '//achar(9)//achar(10)//achar(13))
        ends_text = first > 1
        if (ends_text) ends_text = text(first:min(first + 2, len(text))) == '"""'
    end function ends_text

    !> Position of the first byte that is not valid UTF-8; 0 if there is none.
    pure integer function first_broken(text)
        character(len=*), intent(in) :: text
        integer :: i, code, more, least, most

        more = 0
        least = 128
        most = 191
        first_broken = 0
        do i = 1, len(text)
            code = iachar(text(i:i))
            if (more > 0) then
                if (code < least .or. code > most) exit
                more = more - 1
                least = 128
                most = 191
                cycle
            end if
            ! The range of the second byte excludes overlong forms, surrogates, and code points above U+10FFFF.
            select case (code)
            case (0:127)
                cycle
            case (194:223)
                more = 1
            case (224:239)
                more = 2
                if (code == 224) least = 160
                if (code == 237) most = 159
            case (240:244)
                more = 3
                if (code == 240) least = 144
                if (code == 244) most = 143
            case default
                exit
            end select
        end do
        if (i <= len(text) .or. more > 0) first_broken = min(i, len(text))
    end function first_broken

    !> Parse a text. Error messages show the line.
    subroutine parse_text(text, name, source, parsed, error)
        character(len=*), intent(in) :: text
        !> Name of the text in messages.
        character(len=*), intent(in) :: name
        class(source_type), intent(inout) :: source
        type(parsed_type), intent(inout) :: parsed
        type(error_type), allocatable, intent(out) :: error
        type(scene_lexer_type) :: lexer
        type(toml_error), allocatable :: parse_error
        type(toml_context) :: excerpt

        ! toml-f searches for the end of the line in its error reports, so there must be one. Carriage returns would appear in the
        ! reports.
        call new_lexer_from_string(lexer%toml_lexer, with_short_ends(text)//new_line('a'))
        lexer%filename = name
        call parse(lexer, parsed%root, toml_parser_config(color=.false., context_detail=1), parsed%context, parse_error)
        source%name = name
        source%text = lexer%chunk
        if (.not. allocated(parse_error)) return
        if (lexer%refused > 0) then
            excerpt%filename = name
            excerpt%source = lexer%chunk
            call excerpt%push_back(toml_token(first=lexer%refused, last=lexer%refused))
            if (allocated(lexer%limit)) then
                parse_error%message = excerpt%report('the scene is too large', 1, lexer%limit)
            else if (lexer%is_duplicate) then
                parse_error%message = excerpt%report('duplicate table', 1, 'merge the keys of both')
            else if (lexer%is_below_value) then
                parse_error%message = excerpt%report('the name before the dot is a value, not a table', 1, &
                    'it cannot contain tables')
            else
                parse_error%message = excerpt%report('a scene has no nested tables', 1, 'a heading consists of one name')
            end if
        end if
        call set_input_error(error, without_level(parse_error%message))
    end subroutine parse_text

    !> Refuse a generated text that exceeds the limits for reading.
    subroutine check_limits(path, text, error)
        !> Name of the text in messages, and the text.
        character(len=*), intent(in) :: path, text
        type(error_type), allocatable, intent(out) :: error
        type(scene_lexer_type) :: lexer
        type(toml_token) :: token

        call check_text(path, text, error)
        if (allocated(error)) return
        call new_lexer_from_string(lexer%toml_lexer, text//new_line('a'))
        do while (token%kind /= token_kind%eof .and. .not. allocated(lexer%limit))
            call lexer%next(token)
        end do
        if (allocated(lexer%limit)) call set_input_error(error, path//' is not a valid scene: '//lexer%limit)
    end subroutine check_limits

    !> Text in which each Windows line end is replaced by a newline.
    pure function with_short_ends(text) result(short)
        character(len=*), intent(in) :: text
        character(len=:), allocatable :: short
        integer :: i, length

        short = text
        length = 0
        do i = 1, len(text)
            if (text(i:min(i + 1, len(text))) == achar(13)//achar(10)) cycle
            length = length + 1
            short(length:length) = text(i:i)
        end do
        short = short(:length)
    end function with_short_ends

    !> Report without the prefix "error: ".
    pure function without_level(report) result(text)
        character(len=*), intent(in) :: report
        character(len=:), allocatable :: text

        text = report
        if (index(text, 'error: ') == 1) text = text(8:)
    end function without_level
end module tandem_io_scene_source
