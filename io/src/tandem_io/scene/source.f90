! SPDX-License-Identifier: MIT
!> A source of keys: a scene file, or one `--set table.key=value` of the command line. Each keeps its text, so that an error
!> can show the line.
module tandem_io_scene_source
    use tandem, only: error_type
    use tandem_status, only: status_invalid_option
    use tandem_io_scene_text, only: to_toml
    use tomlf, only: toml_context, toml_error, toml_parser_config, toml_table
    use tomlf_de_lexer, only: new_lexer_from_string, toml_lexer
    use tomlf_de_parser, only: parse
    implicit none (type, external)
    private

    public :: source_type, set_input_error

    !> Largest scene file, in bytes. A scene has a few kilobytes; what is much larger is something else.
    integer, parameter :: largest = 1048576
    !> Most lines, brackets and dots in a line: the parser may descend one level at each bracket or dot.
    integer, parameter :: most_lines = 10000, most_brackets = 5000, most_dots = 1000

    type :: source_type
        !> The parsed text.
        type(toml_table), allocatable :: root
        !> The text itself and the places of its parts.
        type(toml_context) :: context
        !> The argument of `--set`; not allocated for a file.
        character(len=:), allocatable :: argument
    contains
        procedure :: load_file
        procedure :: load_text
        procedure :: load_argument
        procedure :: describe
    end type source_type

contains

    !> Read and parse a scene file.
    subroutine load_file(self, path, error)
        class(source_type), intent(inout) :: self
        !> Path of the file.
        character(len=*), intent(in) :: path
        type(error_type), allocatable, intent(out) :: error
        character(len=:), allocatable :: text

        call read_text(path, text, error)
        if (allocated(error)) return
        call parse_text(text, path, self, error)
    end subroutine load_file

    !> Parse a scene that is at hand.
    subroutine load_text(self, name, text, error)
        class(source_type), intent(inout) :: self
        !> How messages call it, and the text.
        character(len=*), intent(in) :: name, text
        type(error_type), allocatable, intent(out) :: error

        call check_text(name, text, error)
        if (.not. allocated(error)) call parse_text(text, name, self, error)
    end subroutine load_text

    !> Take `table.key=value`. The value is TOML; a bare word that is no TOML stands for itself as text.
    subroutine load_argument(self, argument, error)
        class(source_type), intent(inout) :: self
        !> What followed `--set`.
        character(len=*), intent(in) :: argument
        type(error_type), allocatable, intent(out) :: error
        character(len=*), parameter :: letters = 'abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-'
        character(len=*), parameter :: usage = ' must be table.key=value, as in --set solver.step=1e-3'
        type(error_type), allocatable :: second
        character(len=:), allocatable :: value
        integer :: dot, equals

        equals = index(argument, '=')
        dot = index(argument, '.')
        if (scan(argument, achar(10)//achar(13)) > 0) then
            call set_input_error(error, '--set takes one line')
        else if (dot < 2 .or. equals < dot + 2) then
            call set_input_error(error, '--set '//argument//usage)
        else if (verify(argument(:dot - 1)//argument(dot + 1:equals - 1), letters) > 0) then
            call set_input_error(error, '--set '//argument//usage)
        end if
        if (.not. allocated(error)) call check_text('--set '//argument(:equals), argument, error)
        if (allocated(error)) return
        value = trim(adjustl(argument(equals + 1:)))
        if (len(value) == 0) then
            call set_input_error(error, '--set '//argument//' has no value')
            return
        end if
        self%argument = argument
        call parse_text(argument, '--set', self, error)
        if (.not. allocated(error) .or. scan(value(1:1), '"''[{') > 0) return
        call parse_text(argument(:equals)//to_toml(value), '--set', self, second)
        if (.not. allocated(second)) deallocate (error)
    end subroutine load_argument

    !> A message about a place of the source: the file, the line number, the line, a marker under the place, a remark beside it.
    function describe(self, message, origin, remark) result(text)
        class(source_type), intent(in) :: self
        !> What is wrong.
        character(len=*), intent(in) :: message
        !> The place: an origin that the parser has given; 0 for none.
        integer, intent(in) :: origin
        !> A few words for the marker.
        character(len=*), intent(in) :: remark
        character(len=:), allocatable :: text

        if (origin > 0 .and. origin <= self%context%top) then
            text = without_level(self%context%report(message, origin, remark))
        else
            text = message//new_line('a')//' --> '//self%context%filename
        end if
    end function describe

    !> An error of the input, with the text as it stands.
    subroutine set_input_error(error, message)
        type(error_type), allocatable, intent(out) :: error
        !> The whole message.
        character(len=*), intent(in) :: message

        allocate (error)
        error%stat = status_invalid_option
        error%message = message
    end subroutine set_input_error

    !> The whole file as text. A pipe will do, so the size is not asked for.
    subroutine read_text(path, text, error)
        character(len=*), intent(in) :: path
        character(len=:), allocatable, intent(out) :: text
        type(error_type), allocatable, intent(out) :: error
        character(len=256) :: message
        character :: letter
        integer :: unit, stat, length

        message = ''
        open (newunit=unit, file=path, status='old', action='read', access='stream', form='unformatted', iostat=stat, &
            iomsg=message)
        if (stat /= 0) then
            call set_input_error(error, 'cannot read the scene: '//trim(message))
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
            call set_input_error(error, 'cannot read the scene '//path//': '//trim(message))
        else if (length > largest) then
            call set_input_error(error, path//' is no scene: it has more than '//to_toml(largest)//' bytes')
        else
            text = text(:length)
            call check_text(path, text, error)
        end if
    end subroutine read_text

    !> Refuse what cannot be a scene, so that the parser meets text of bounded length and depth only.
    subroutine check_text(path, text, error)
        character(len=*), intent(in) :: path, text
        type(error_type), allocatable, intent(out) :: error
        integer :: i, code, line, brackets, dots

        line = 1
        brackets = 0
        dots = 0
        do i = 1, len(text)
            code = iachar(text(i:i))
            select case (code)
            case (0:8, 11, 14:31, 127)
                call set_input_error(error, path//' is no scene: line '//to_toml(line)//' holds the control character '// &
                    to_toml(code)//'; is it a binary file?')
                return
            case (10)
                line = line + 1
                dots = 0
            case (iachar('.'))
                dots = dots + 1
            case (iachar('['), iachar('{'))
                brackets = brackets + 1
            case default
                cycle
            end select
            if (line > most_lines .or. brackets > most_brackets .or. dots > most_dots) then
                call set_input_error(error, path//' is no scene: up to line '//to_toml(line)//' it has more than '// &
                    to_toml(most_lines)//' lines, '//to_toml(most_brackets)//' brackets or '//to_toml(most_dots)// &
                    ' dots in a line')
                return
            end if
        end do
    end subroutine check_text

    !> Parse a text; its errors show the line.
    subroutine parse_text(text, name, source, error)
        character(len=*), intent(in) :: text
        !> How messages name the text.
        character(len=*), intent(in) :: name
        class(source_type), intent(inout) :: source
        type(error_type), allocatable, intent(out) :: error
        type(toml_lexer) :: lexer
        type(toml_error), allocatable :: parse_error

        ! The report of an error looks for the end of the line, so there must be one.
        call new_lexer_from_string(lexer, text//new_line('a'))
        lexer%filename = name
        call parse(lexer, source%root, toml_parser_config(color=.false.), source%context, parse_error)
        if (allocated(parse_error)) call set_input_error(error, without_level(parse_error%message))
    end subroutine parse_text

    !> The report without the word "error: " at its head.
    pure function without_level(report) result(text)
        character(len=*), intent(in) :: report
        character(len=:), allocatable :: text

        text = report
        if (index(text, 'error: ') == 1) text = text(8:)
    end function without_level
end module tandem_io_scene_source
