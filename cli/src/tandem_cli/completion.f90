! SPDX-License-Identifier: MIT
!> tandem completion: a shell script that completes subcommands, options, scenes and files, according to the tables of subcommands
!> and options.
module tandem_cli_completion
    use tandem_cli_arguments, only: arguments_type
    use tandem_cli_commands, only: command_type, commands, options, takes_option
    use tandem_cli_messages, only: print_to_stderr, done, input_wrong, say
    implicit none (type, external)
    private

    public :: completion

contains

    !> Print the script of a shell.
    subroutine completion(arguments, code)
        type(arguments_type), intent(in) :: arguments
        !> Exit code.
        integer, intent(out) :: code

        code = done
        select case (arguments%about)
        case ('bash')
            call print_bash_script()
        case ('zsh')
            ! zsh emulates the completion functions of bash.
            call say('#compdef tandem')
            call say('autoload -U +X bashcompinit && bashcompinit')
            call print_bash_script()
        case default
            code = input_wrong
            call print_to_stderr('completion supports bash and zsh, not "'//arguments%about//'"'//new_line('a')// &
                'See tandem help completion.')
        end select
    end subroutine completion

    !> Print the script for bash. A subcommand of two words is identified by both words.
    subroutine print_bash_script()
        integer :: i

        call say('_tandem() {')
        call say('    local word=${COMP_WORDS[COMP_CWORD]} command=${COMP_WORDS[1]} words=')
        call say('    [ "$command" = study ] && [ "$COMP_CWORD" -gt 2 ] && command="study ${COMP_WORDS[2]}"')
        call say('    if [ "$COMP_CWORD" = 1 ]; then')
        call say('        words="'//first_words()//'"')
        call say('    elif [ "$command" = study ]; then')
        call say('        words="'//second_words()//'"')
        call say('    else')
        call say('        case "$command" in')
        do i = 1, size(commands)
            call say('        "'//trim(commands(i)%name)//'") words="'//words_of(commands(i))//'" ;;')
        end do
        call say('        esac')
        call say('        [[ $word == -* ]] || COMPREPLY=($(compgen -f -- "$word"))')
        call say('    fi')
        call say('    COMPREPLY+=($(compgen -W "$words" -- "$word"))')
        call say('}')
        call say('complete -o filenames -F _tandem tandem')
    end subroutine print_bash_script

    !> First words of all subcommands, each once.
    function first_words() result(words)
        character(len=:), allocatable :: words
        integer :: i

        words = 'study'
        do i = 1, size(commands)
            if (index(commands(i)%name, 'study ') /= 1) words = words//' '//trim(commands(i)%name)
        end do
    end function first_words

    !> Words that may follow `study`.
    function second_words() result(words)
        character(len=:), allocatable :: words
        integer :: i

        words = ''
        do i = 1, size(commands)
            if (index(commands(i)%name, 'study ') == 1) words = trim(words//' '//trim(commands(i)%name(7:)))
        end do
    end function second_words

    !> Words that may follow a subcommand: its options, and the names of scenes or subcommands.
    function words_of(command) result(words)
        type(command_type), intent(in) :: command
        character(len=:), allocatable :: words
        integer :: i

        words = ''
        do i = 1, size(options)
            if (takes_option(command, options(i)%name)) words = words//trim(options(i)%name)//' '
        end do
        select case (command%operand)
        case ('SCENE', 'SCENE...')
            words = words//'$(tandem list 2>/dev/null | sed -n ''2,/^$/s/ .*//p'')'
        case ('SHELL')
            words = words//'bash zsh'
        case ('[COMMAND]')
            words = words//first_words()
        case default
            continue
        end select
    end function words_of
end module tandem_cli_completion
