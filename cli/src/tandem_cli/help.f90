! SPDX-License-Identifier: MIT
!> tandem help: the subcommands of the program, and the arguments of a subcommand.
module tandem_cli_help
    use tandem_cli_arguments, only: arguments_type
    use tandem_cli_commands, only: command_type, commands, find_command, nearest_command, options, takes_option
    use tandem_cli_messages, only: print_to_stderr, done, input_wrong, padded, say
    implicit none (type, external)
    private

    public :: help, print_command_help, refuse_command

    !> Widths of the columns for usage and options.
    integer, parameter :: usage_width = 36, option_width = 27

contains

    !> Print the help of the program, or of a subcommand.
    subroutine help(arguments, code)
        type(arguments_type), intent(in) :: arguments
        !> Exit code.
        integer, intent(out) :: code

        code = done
        if (arguments%about == '') then
            call print_overview()
        else if (find_command(arguments%about) > 0) then
            call print_command_help(arguments%about)
        else
            call refuse_command(arguments%about, code)
        end if
    end subroutine help

    !> Print one line per subcommand.
    subroutine print_overview()
        integer :: i

        call say('tandem simulates multibody systems with holonomic and nonholonomic constraints.')
        call say('')
        call say('Usage:')
        do i = 1, size(commands)
            call say(padded('  '//usage(commands(i)), usage_width)//trim(commands(i)%summary))
        end do
        call say('')
        call say('tandem help COMMAND, or tandem COMMAND --help, prints the options of a subcommand.')
        call say('')
        call print_scene_description()
        call say('')
        call say('Exit codes: 0 success, 1 the run failed, 2 invalid input, 128 + n ended by signal n.')
        call say('')
        call say('Examples:')
        call say('  tandem run rolling_disk --set time.end=10 --set solver.step=2e-3 --output disk.h5')
        call say('  tandem show rolling_disk > my_disk.toml')
        call say('  tandem study precision rolling_disk --set time.end=10 --output disk_study')
    end subroutine print_overview

    !> Print the arguments of a subcommand.
    subroutine print_command_help(name)
        !> One of `commands`.
        character(len=*), intent(in) :: name
        integer :: i

        associate (command => commands(find_command(name)))
            call say('Usage: '//usage(command)//trim(merge(' [OPTION...]', '            ', command%options /= '')))
            call say('')
            call say(trim(command%summary)//'.')
            if (command%operand == 'SCENE' .or. command%operand == 'SCENE...') then
                call say('')
                call print_scene_description()
            end if
            call print_notes(name)
            call say('')
            call say('Options:')
            do i = 1, size(options)
                if (takes_option(command, options(i)%name)) call say(padded('  '//trim(options(i)%name)//' '// &
                    trim(options(i)%value), option_width)//trim(options(i)%summary))
            end do
        end associate
    end subroutine print_command_help

    !> Print notes on a subcommand.
    subroutine print_notes(name)
        character(len=*), intent(in) :: name
        character(len=*), parameter :: continues = 'An interrupted study continues when it is called again.'

        select case (name)
        case ('resume')
            call say('--set may change time.end and solver.max_steps, max_evaluations, max_seconds and max_events.')
        case ('study precision', 'study tables')
            call say(continues)
        case ('study stability')
            call say('CASE is a case or a group of cases: stiff, disk, vehicle, masses, units, steps, parallel, kinks, million.')
            call say('Default: all cases (some minutes). Exit code 1 if a run is wrong without a warning.')
            call say(continues)
        case ('sweep')
            call say('SWEEP is a TOML file of a scene, varied inputs and kept results: doc/sweep.md. An interrupted sweep')
            call say('continues when it is called again. With --merge, add the journals of the tasks of an array.')
        case ('completion')
            call say('bash: tandem completion bash > ~/.local/share/bash-completion/completions/tandem')
            call say('zsh: tandem completion zsh > FOLDER/_tandem, with a FOLDER of $fpath')
        case default
            continue
        end select
    end subroutine print_notes

    !> Print the description of a scene.
    subroutine print_scene_description()
        call say('SCENE is the path of a TOML file, or a name listed by tandem list. Named scenes are searched in the')
        call say('folder TANDEM_SCENES, in ./scenes, and where the program was built or installed.')
    end subroutine print_scene_description

    !> Usage of a subcommand.
    pure function usage(command) result(text)
        type(command_type), intent(in) :: command
        character(len=:), allocatable :: text

        text = trim('tandem '//trim(command%name)//' '//command%operand)
    end function usage

    !> Report an unknown subcommand.
    subroutine refuse_command(command, code)
        character(len=*), intent(in) :: command
        !> Exit code.
        integer, intent(out) :: code
        character(len=:), allocatable :: guess

        code = input_wrong
        if (command == 'study') then
            call print_to_stderr( &
                'study requires a kind: study precision SCENE..., study stability, study tables, or study modes SCENE'// &
                new_line('a')//'See tandem help.')
            return
        end if
        guess = nearest_command(command)
        if (guess /= '') guess = ' Did you mean "'//guess//'"?'
        call print_to_stderr('there is no subcommand "'//command//'".'//guess//new_line('a')//'See tandem help.')
    end subroutine refuse_command
end module tandem_cli_help
