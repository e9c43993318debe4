! SPDX-License-Identifier: MIT
!> The command line: a subcommand, then words and options in any order.
module tandem_cli_arguments
    use tandem, only: error_type, to_text, wp
    use tandem_cli_commands, only: command_type, commands, find_command, find_option, options, takes_option
    use tandem_io, only: nearest_name, scene_model_type
    use tandem_number_text, only: read_number
    use tandem_status, only: status_invalid_option
    implicit none (type, external)
    private

    public :: arguments_type, read_arguments

    type :: arguments_type
        !> Subcommand; two words for `study`, empty if none is given.
        character(len=:), allocatable :: command
        !> Scene, or file for `resume` and `verify`; not allocated if none is given. If a subcommand accepts several scenes, all are
        !> in `scenes`.
        character(len=:), allocatable :: scene
        character(len=:), allocatable :: scenes(:)
        !> Operand of `help` or `completion`; empty if none is given.
        character(len=:), allocatable :: about
        !> Models that scenes may name.
        type(scene_model_type), allocatable :: models(:)
        !> Settings `table.key=value` and `--unset table.key`, without trailing blanks.
        character(len=:), allocatable :: settings(:)
        !> Options without a value.
        logical :: quiet = .false., force = .false., help = .false., quick = .false., error = .false., no_error = .false., &
            profile = .false., json = .false., merges = .false., shapes = .false.
        !> Options of a study with a value, in the form `--name=value`.
        character(len=:), allocatable, private :: given(:)
        integer, private :: first = 2
    contains
        procedure :: parse, value_of, number_of, count_of
        procedure, private :: take
    end type arguments_type

contains

    !> Read the subcommand; `parse` reads the other arguments.
    function read_arguments(models) result(arguments)
        !> Models that scenes may name.
        type(scene_model_type), intent(in) :: models(:)
        type(arguments_type) :: arguments

        arguments%command = 'help'
        if (command_argument_count() > 0) arguments%command = argument(1)
        select case (arguments%command)
        case ('--help', '-h')
            arguments%command = 'help'
        case ('--version')
            arguments%command = 'version'
        case ('study')
            if (command_argument_count() > 1) then
                if (argument(2) == '--help' .or. argument(2) == '-h') then
                    arguments%command = 'help'
                else
                    arguments%command = 'study '//argument(2)
                end if
                arguments%first = 3
            end if
        case default
            continue
        end select
        arguments%about = ''
        allocate (arguments%models, source=models)
        allocate (character(len=0) :: arguments%settings(0), arguments%given(0), arguments%scenes(0))
    end function read_arguments

    !> Read the arguments after the subcommand.
    subroutine parse(self, error)
        class(arguments_type), intent(inout) :: self
        type(error_type), allocatable, intent(out) :: error
        character(len=:), allocatable :: word
        logical :: takes_many
        integer :: i

        associate (command => commands(find_command(self%command)))
            takes_many = index(command%operand, '...') > 0
            i = self%first
            do while (i <= command_argument_count() .and. .not. allocated(error))
                word = argument(i)
                i = i + 1
                if (len(word) > 1 .and. index(word, '-') == 1) then
                    call self%take(word, i, command, error)
                else if (index(command%operand, 'COMMAND') + index(command%operand, 'SHELL') > 0) then
                    self%about = trim(self%about//' '//word)
                    self%about = trim(adjustl(self%about))
                else if ((allocated(self%scene) .and. .not. takes_many) .or. command%operand == '') then
                    call set_usage_error(error, self%command, 'has an unexpected argument "'//word//'"')
                else
                    self%scene = word
                    call add_text(self%scenes, word)
                end if
            end do
            if (self%command == 'equilibrium') call add_text(self%settings, 'initial.equilibrium=true')
            if (allocated(error) .or. self%help) return
            if (command%operand == 'SWEEP...' .and. size(self%scenes) > 1 .and. .not. self%merges) then
                call set_usage_error(error, self%command, 'takes one SWEEP, followed by journals with --merge')
                return
            end if
            if (allocated(self%scene)) return
            select case (command%operand)
            case ('FILE', 'FILE...')
                call set_usage_error(error, self%command, 'needs a FILE: the result of a run')
            case ('SWEEP...')
                call set_usage_error(error, self%command, 'needs a SWEEP: the path of a TOML file; see doc/sweep.md')
            case ('SCENE', 'SCENE...')
                call set_usage_error(error, self%command, 'needs a SCENE: the path of a TOML file or a name; see tandem list')
            case default
                continue
            end select
        end associate
    end subroutine parse

    !> Read an option and its value, which is part of the same word or the next word.
    subroutine take(self, word, next, command, error)
        class(arguments_type), intent(inout) :: self
        character(len=*), intent(in) :: word
        !> Index of the next argument.
        integer, intent(inout) :: next
        type(command_type), intent(in) :: command
        type(error_type), allocatable, intent(out) :: error
        character(len=:), allocatable :: name, value
        logical :: has_value
        integer :: equals, i

        name = word
        equals = index(word, '=')
        if (equals > 0) name = word(:equals - 1)
        if (name == '-h') name = '--help'
        i = find_option(name)
        if (i == 0 .or. .not. takes_option(command, name)) then
            value = nearest_name(name, pack(options%name, [(takes_option(command, options(i)%name), i=1, size(options))]))
            if (value /= '') value = '; did you mean '//value//'?'
            call set_usage_error(error, self%command, 'has no option '//name//value)
            return
        end if
        has_value = options(i)%value /= ''
        value = ''
        if (has_value) then
            if (equals > 0) then
                value = word(equals + 1:)
            else if (next <= command_argument_count()) then
                value = argument(next)
                next = next + 1
            end if
            if (len_trim(value) == 0) call set_usage_error(error, self%command, 'needs a value after '//name)
        else if (equals > 0) then
            call set_usage_error(error, self%command, 'takes no value after '//name)
        end if
        if (allocated(error)) return
        select case (name)
        case ('--set')
            call add_text(self%settings, value)
        case ('--unset')
            call add_text(self%settings, '--unset '//value)
        case ('--output')
            ! These subcommands write other files than a run.
            if (self%first == 2 .and. all(self%command /= [character(len=9) :: 'sweep', 'linearise'])) then
                call add_text(self%settings, 'output.file='//quoted(value))
            else
                call add_text(self%given, name//'='//value)
            end if
        case ('--equilibrium')
            call add_text(self%settings, 'initial.equilibrium=true')
        case ('--steady')
            call add_text(self%settings, 'initial.steady='//quoted_list(value))
        case ('--quiet')
            self%quiet = .true.
        case ('--error')
            self%error = .true.
        case ('--no-error')
            self%no_error = .true.
        case ('--profile')
            self%profile = .true.
        case ('--force')
            self%force = .true.
        case ('--json')
            self%json = .true.
        case ('--shapes')
            self%shapes = .true.
        case ('--quick')
            self%quick = .true.
        case ('--merge')
            self%merges = .true.
        case ('--help')
            self%help = .true.
        case default
            call add_text(self%given, name//'='//value)
        end select
    end subroutine take

    !> Value of an option of a study; the last one if it is given several times, the default if it is absent.
    function value_of(self, name, default) result(value)
        class(arguments_type), intent(in) :: self
        character(len=*), intent(in) :: name, default
        character(len=:), allocatable :: value
        integer :: i

        value = default
        do i = 1, size(self%given)
            if (index(self%given(i), name//'=') == 1) value = trim(self%given(i) (len(name) + 2:))
        end do
    end function value_of

    !> Read the value of a numeric option.
    subroutine number_of(self, name, least, value, error)
        class(arguments_type), intent(in) :: self
        character(len=*), intent(in) :: name
        !> Smallest valid value.
        real(wp), intent(in) :: least
        !> Default on entry, value on return.
        real(wp), intent(inout) :: value
        type(error_type), allocatable, intent(out) :: error
        character(len=:), allocatable :: text
        logical :: is_read

        text = self%value_of(name, '')
        if (text == '') return
        call read_number(text, value, is_read)
        if (is_read .and. value >= least .and. value <= huge(1)) return
        call set_usage_error(error, self%command, 'needs a number from '//to_text(least)//' to '//to_text(huge(1))//' after '// &
            name//', not "'//text//'"')
    end subroutine number_of

    !> Read the value of an option that is a positive count.
    subroutine count_of(self, name, most, value, error)
        class(arguments_type), intent(in) :: self
        character(len=*), intent(in) :: name
        !> Largest valid value, which prevents very long runs due to a typing error.
        integer, intent(in) :: most
        !> Default on entry, value on return.
        integer, intent(inout) :: value
        type(error_type), allocatable, intent(out) :: error
        character(len=:), allocatable :: text
        logical :: is_read

        text = self%value_of(name, '')
        if (text == '') return
        call read_number(text, value, is_read)
        if (is_read .and. value >= 1 .and. value <= most) return
        call set_usage_error(error, self%command, 'needs an integer from 1 to '//to_text(most)//' after '//name// &
            ', not "'//text//'"')
    end subroutine count_of

    !> Append a text.
    subroutine add_text(texts, text)
        character(len=:), allocatable, intent(inout) :: texts(:)
        character(len=*), intent(in) :: text
        character(len=max(len(texts), len(text))) :: longer(size(texts) + 1)

        longer(:size(texts)) = texts
        longer(size(longer)) = text
        deallocate (texts)
        allocate (texts, source=longer)
    end subroutine add_text

    !> Text in TOML quotation marks.
    pure function quoted(word) result(text)
        character(len=*), intent(in) :: word
        character(len=:), allocatable :: text
        integer :: i

        text = '"'
        do i = 1, len(word)
            if (word(i:i) == '"' .or. word(i:i) == '\') text = text//'\'
            text = text//word(i:i)
        end do
        text = text//'"'
    end function quoted

    !> Words separated by commas as a TOML array.
    pure function quoted_list(words) result(text)
        character(len=*), intent(in) :: words
        character(len=:), allocatable :: text
        integer :: first, comma

        text = ''
        first = 1
        do
            comma = index(words(first:), ',')
            if (comma == 0) exit
            text = text//quoted(trim(adjustl(words(first:first + comma - 2))))//', '
            first = first + comma
        end do
        text = '['//text//quoted(trim(adjustl(words(first:))))//']'
    end function quoted_list

    !> Argument of the command line.
    function argument(i) result(word)
        !> Index of the argument.
        integer, intent(in) :: i
        character(len=:), allocatable :: word
        integer :: length

        call get_command_argument(i, length=length)
        allocate (character(len=length) :: word)
        if (length > 0) call get_command_argument(i, word)
    end function argument

    !> Set an error of the command line.
    subroutine set_usage_error(error, command, message)
        type(error_type), allocatable, intent(out) :: error
        character(len=*), intent(in) :: command, message

        allocate (error)
        error%stat = status_invalid_option
        error%message = 'tandem '//command//' '//message//new_line('a')//'See tandem help.'
    end subroutine set_usage_error
end module tandem_cli_arguments
