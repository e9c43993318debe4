! SPDX-License-Identifier: MIT
!> The command line: a subcommand, then words and options in any order.
module tandem_app_arguments
    use tandem, only: error_type, to_text, wp
    use tandem_io, only: nearest_name
    use tandem_status, only: status_invalid_option
    implicit none (type, external)
    private

    public :: arguments_type, read_arguments

    !> What an option takes.
    type :: option_type
        character(len=12) :: name
        logical :: has_value
    end type option_type

    !> Every option of any subcommand.
    type(option_type), parameter :: options(14) = [option_type('--set', .true.), option_type('--output', .true.), &
        option_type('--quiet', .false.), option_type('--force', .false.), option_type('--help', .false.), &
        option_type('--steppers', .true.), option_type('--reference', .true.), option_type('--samples', .true.), &
        option_type('--repeats', .true.), option_type('--budget', .true.), option_type('--quick', .false.), &
        option_type('--error', .false.), option_type('--no-error', .false.), option_type('--profile', .false.)]

    type :: arguments_type
        !> The subcommand, empty where there is none; of `study`, two words.
        character(len=:), allocatable :: command
        !> The scene, or the file of `resume` and `verify`, not allocated where there is none; where several are allowed, all are in
        !> `scenes`.
        character(len=:), allocatable :: scene
        character(len=:), allocatable :: scenes(:)
        !> The settings `table.key=value`, blanks at their ends dropped.
        character(len=:), allocatable :: settings(:)
        !> The options without a value that were given.
        logical :: quiet = .false., force = .false., help = .false., quick = .false., error = .false., no_error = .false., &
            profile = .false.
        !> The options of a study that have a value, as `--name=value`.
        character(len=:), allocatable, private :: given(:)
        integer, private :: first = 2
    contains
        procedure :: parse
        procedure :: value_of
        procedure :: number_of
        procedure :: count_of
        procedure, private :: take
    end type arguments_type

contains

    !> The subcommand; the rest is for `parse`.
    function read_arguments() result(arguments)
        type(arguments_type) :: arguments

        arguments%command = ''
        if (command_argument_count() > 0) arguments%command = argument(1)
        if (arguments%command == 'study' .and. command_argument_count() > 1) then
            arguments%command = 'study '//argument(2)
            arguments%first = 3
        end if
        allocate (character(len=0) :: arguments%settings(0), arguments%given(0), arguments%scenes(0))
    end function read_arguments

    !> Read what follows the subcommand.
    subroutine parse(self, allowed, takes_scene, error, many, least)
        class(arguments_type), intent(inout) :: self
        !> The options that the subcommand has.
        character(len=*), intent(in) :: allowed(:)
        !> Whether it wants a scene.
        logical, intent(in) :: takes_scene
        type(error_type), allocatable, intent(out) :: error
        !> Whether it takes several scenes.
        logical, intent(in), optional :: many
        !> The fewest that it takes; 1 where it is not given.
        integer, intent(in), optional :: least
        character(len=:), allocatable :: word
        logical :: takes_many
        integer :: i

        takes_many = .false.
        if (present(many)) takes_many = many
        i = self%first
        do while (i <= command_argument_count() .and. .not. allocated(error))
            word = argument(i)
            i = i + 1
            if (len(word) > 1 .and. index(word, '-') == 1) then
                call self%take(word, i, allowed, error)
            else if ((allocated(self%scene) .and. .not. takes_many) .or. .not. takes_scene) then
                call set_usage_error(error, self%command, 'does not know what to do with "'//word//'"')
            else
                self%scene = word
                call add_text(self%scenes, word)
            end if
        end do
        if (allocated(error) .or. self%help) return
        if (present(least)) then
            if (size(self%scenes) >= least) return
        end if
        if (self%command == 'resume' .and. .not. allocated(self%scene)) then
            call set_usage_error(error, self%command, 'needs a FILE: the result of a run that was interrupted')
        else if (self%command == 'verify' .and. .not. allocated(self%scene)) then
            call set_usage_error(error, self%command, 'needs a FILE: the result of a run')
        else if (takes_scene .and. .not. allocated(self%scene)) then
            call set_usage_error(error, self%command, 'needs a SCENE: the path of a TOML file or a name; see tandem list')
        end if
    end subroutine parse

    !> Take an option, and its value from the same word or from the next.
    subroutine take(self, word, next, allowed, error)
        class(arguments_type), intent(inout) :: self
        character(len=*), intent(in) :: word
        !> Index of the next argument.
        integer, intent(inout) :: next
        character(len=*), intent(in) :: allowed(:)
        type(error_type), allocatable, intent(out) :: error
        character(len=:), allocatable :: name, value
        integer :: equals, i

        name = word
        equals = index(word, '=')
        if (equals > 0) name = word(:equals - 1)
        if (name == '-h') name = '--help'
        i = findloc(options%name == name .and. [(any(options(i)%name == allowed), i=1, size(options))], .true., dim=1)
        if (i == 0) then
            value = nearest_name(name, allowed)
            if (value /= '') value = '; did you mean '//value//'?'
            call set_usage_error(error, self%command, 'has no option '//name//value)
            return
        end if
        value = ''
        if (options(i)%has_value) then
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
        case ('--output')
            ! A study has a folder of files.
            if (self%first == 2) then
                call add_text(self%settings, 'output.file='//quoted(value))
            else
                call add_text(self%given, name//'='//value)
            end if
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
        case ('--quick')
            self%quick = .true.
        case ('--help')
            self%help = .true.
        case default
            call add_text(self%given, name//'='//value)
        end select
    end subroutine take

    !> The value of an option of a study, the last where it was given several times; a default where it was not.
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

    !> The value of an option that is a number.
    subroutine number_of(self, name, least, value, error)
        class(arguments_type), intent(in) :: self
        character(len=*), intent(in) :: name
        !> The least that it may be.
        real(wp), intent(in) :: least
        !> The default before, the value after.
        real(wp), intent(inout) :: value
        type(error_type), allocatable, intent(out) :: error
        character(len=:), allocatable :: text
        integer :: stat

        text = self%value_of(name, '')
        if (text == '') return
        stat = 1
        if (verify(text, '0123456789.eE+-') == 0) read (text, *, iostat=stat) value
        if (stat == 0 .and. value >= least .and. value <= huge(1)) return
        call set_usage_error(error, self%command, 'needs a number of at least '//to_text(least)//' after '//name// &
            ', not "'//text//'"')
    end subroutine number_of

    !> The value of an option that counts something.
    subroutine count_of(self, name, most, value, error)
        class(arguments_type), intent(in) :: self
        character(len=*), intent(in) :: name
        !> The most that it may be, so that a slip costs no hours.
        integer, intent(in) :: most
        !> The default before, the value after, from 1 on.
        integer, intent(inout) :: value
        type(error_type), allocatable, intent(out) :: error
        character(len=:), allocatable :: text
        integer :: stat

        text = self%value_of(name, '')
        if (text == '') return
        stat = 1
        if (verify(text, '0123456789') == 0) read (text, *, iostat=stat) value
        if (stat == 0 .and. value >= 1 .and. value <= most) return
        call set_usage_error(error, self%command, 'needs a whole number from 1 to '//to_text(most)//' after '//name// &
            ', not "'//text//'"')
    end subroutine count_of

    !> Add a text after the others.
    subroutine add_text(texts, text)
        character(len=:), allocatable, intent(inout) :: texts(:)
        character(len=*), intent(in) :: text
        character(len=max(len(texts), len(text))) :: longer(size(texts) + 1)

        longer(:size(texts)) = texts
        longer(size(longer)) = text
        deallocate (texts)
        allocate (texts, source=longer)
    end subroutine add_text

    !> A text in TOML's quotes.
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

    !> An argument of any length.
    function argument(i) result(word)
        !> Its index.
        integer, intent(in) :: i
        character(len=:), allocatable :: word
        integer :: length

        call get_command_argument(i, length=length)
        allocate (character(len=length) :: word)
        if (length > 0) call get_command_argument(i, word)
    end function argument

    !> An error of the command line.
    subroutine set_usage_error(error, command, message)
        type(error_type), allocatable, intent(out) :: error
        character(len=*), intent(in) :: command, message

        allocate (error)
        error%stat = status_invalid_option
        error%message = 'tandem '//command//' '//message//new_line('a')//'See tandem help.'
    end subroutine set_usage_error
end module tandem_app_arguments
