! SPDX-License-Identifier: MIT
!> The table of the subcommands of the program, and the table of their options. Help, shell completion and the reader of the command
!> line use these two tables.
module tandem_cli_commands
    use tandem_io, only: nearest_name
    implicit none (type, external)
    private

    public :: command_type, commands, find_command, nearest_command
    public :: option_type, options, find_option, takes_option

    !> A subcommand.
    type :: command_type
        !> Name; for a study, two words.
        character(len=15) :: name
        !> Operand: none, one word, or several (`...`); in brackets if optional.
        character(len=9) :: operand
        !> Valid options besides --help, with a blank on either side of each.
        character(len=112) :: options
        !> Description in one line.
        character(len=78) :: summary
    end type command_type

    !> An option of a subcommand.
    type :: option_type
        character(len=13) :: name
        !> Placeholder of its value; empty for an option without a value.
        character(len=13) :: value
        !> Description in one line.
        character(len=104) :: summary
    end type option_type

    !> All subcommands.
    type(command_type), parameter :: commands(*) = [ &
        command_type('list', '', ' --json ', 'scenes and steppers, a line each'), &
        command_type('show', 'SCENE', ' --set --unset --output ', 'the complete scene as TOML, every default filled in'), &
        command_type('check', 'SCENE', ' --set --unset --json ', &
        'its start, and every procedure of its model against differences'), &
        command_type('run', 'SCENE', ' --set --unset --output --force --error --no-error --profile --quiet --json ', &
        'runs it, writes HDF5, prints a report'), &
        command_type('equilibrium', 'SCENE', ' --set --unset --json ', 'where it rests, and whether that is stable'), &
        command_type('linearise', 'SCENE', ' --set --unset --at --equilibrium --steady --period --near --modes --shapes '// &
        '--output --force --json ', &
        'small motions about its start, rest or steady motion: eigenvalues, modes'), &
        command_type('resume', 'FILE', ' --set --unset --error --no-error --quiet --json ', &
        'goes on with a run that was interrupted, in its result file'), &
        command_type('verify', 'FILE', ' --json ', 'whether a result file holds what was written: reads and sums up all of it'), &
        command_type('study precision', 'SCENE...', ' --set --unset --output --force --quiet --steppers --reference --samples '// &
        '--repeats --budget --quick --json ', 'error against run time, of every stepper'), &
        command_type('study stability', '[CASE...]', ' --output --force --quiet --json ', &
        'a verdict on every stiff and extreme case, with every stepper'), &
        command_type('study tables', '', ' --output --force --quiet --json ', 'the tables and figures of the paper beside ours'), &
        command_type('study modes', 'SCENE', ' --set --unset --over --output --json ', &
        'eigenvalues over a value of a scene, and where stability changes'), &
        command_type('sweep', 'SWEEP...', ' --output --jobs --cases --merge --force --quiet --json ', &
        'many cases of a scene, on all cores, and one table of them'), &
        command_type('plot', 'FILE...', ' --output --kind --names --plane --title ', &
        'draws result files: PNG, SVG or PDF; needs the package for Python'), &
        command_type('view', 'FILE', ' --output --names --frames ', &
        'a page that plays the motion, .glb or .vtkhdf; needs the package for Python'), &
        command_type('import', 'FILE...', ' --output --floating --at --force ', &
        'import urdf|mjcf FILE: a scene from a robot; needs the package for Python'), &
        command_type('statuses', '', ' --json ', 'how runs can end, what that means, and what to do'), &
        command_type('completion', 'SHELL', ' ', 'what completes these words in a shell, bash or zsh'), &
        command_type('help', '[COMMAND]', ' ', 'this text, or that of a subcommand'), &
        command_type('version', '', ' ', 'the version, also --version')]

    !> Options of all subcommands, in the order of the help.
    type(option_type), parameter :: options(*) = [ &
        option_type('--set', 'KEY=VALUE', 'override a key of the scene: table.key=value, event.NUMBER.key=value; repeatable'), &
        option_type('--unset', 'KEY', 'remove a key or an element of the scene: solver.rtol, event.2, force.damper; repeatable'), &
        option_type('--output', 'PATH', 'the result file, as --set output.file=PATH; of a study, its folder; of plot and '// &
        'view, what they write'), &
        option_type('--force', '', 'overwrite a file that exists; a study: start anew'), &
        option_type('--error', '', 'estimate the error at the end by a second, more accurate run, however long it takes'), &
        option_type('--no-error', '', 'never do that; without either, it is done where the run took at most 2 s'), &
        option_type('--profile', '', 'where the time goes, part by part; clocks make the run slower, which is taken off'), &
        option_type('--at', 'TIME', 'linearise at this time of a run; of import, JOINT=X,...: joints drawn there (rad, m)'), &
        option_type('--equilibrium', '', 'linearise where it rests, as --set initial.equilibrium=true'), &
        option_type('--steady', 'NAME,NAME...', 'in the steady motion along these, or "any", as --set initial.steady=...'), &
        option_type('--quiet', '', 'no progress and no report; warnings and errors still go to stderr'), &
        option_type('--json', '', 'print what is reported as one JSON object, numbers in full precision'), &
        option_type('--period', 'TIME', 'Floquet multipliers too, of a motion that has come round then'), &
        option_type('--near', 'RE,IM', 'of a large mechanism at rest the eigenvalues nearest to this; RE alone will do'), &
        option_type('--modes', 'N', 'how many of these (10, at most 50)'), &
        option_type('--shapes', '', 'modes as motions of bodies too'), &
        option_type('--over', 'KEY=a:b:n', 'the key that is varied, from a to b by n values; --output is a file of commas then'), &
        option_type('--steppers', 'NAME,NAME...', 'only these steppers'), &
        option_type('--reference', 'FILE', 'the true motion: a result file or a text table; without it, the study makes its own'), &
        option_type('--samples', 'N', 'times at which a motion is compared with its own reference (40, at most 10000)'), &
        option_type('--repeats', 'N', 'least runs of which the time is the median (3, at most 1000)'), &
        option_type('--budget', 'SECONDS', 'for all runs of a row; finer rows are left out (5)'), &
        option_type('--quick', '', '--repeats 1 --budget 0.5'), &
        option_type('--jobs', 'N', 'processes that run cases at the same time (as many as there are cores)'), &
        option_type('--cases', 'FIRST:LAST', 'only these cases of a sweep, as a task of a job array'), &
        option_type('--merge', '', 'run nothing: make the table from the journals that follow the sweep'), &
        option_type('--kind', 'KIND', 'overview, tracks, coordinates, sensors, reactions, errors, energies or phase'), &
        option_type('--names', 'A,B...', 'what is drawn: coordinates, d(coordinate), sensors, points'), &
        option_type('--plane', 'XY', 'of tracks: two of x, y and z'), &
        option_type('--title', 'TEXT', 'above the picture'), &
        option_type('--frames', 'N', 'frames a second (60)'), &
        option_type('--floating', '', 'the root of the robot is a free body, not the ground'), &
        option_type('--help', '', 'this text')]

contains

    !> Index of a subcommand; 0 if unknown.
    pure integer function find_command(name)
        character(len=*), intent(in) :: name

        find_command = findloc(commands%name == name, .true., dim=1)
    end function find_command

    !> Index of an option; 0 if unknown.
    pure integer function find_option(name)
        character(len=*), intent(in) :: name

        find_option = findloc(options%name == name, .true., dim=1)
    end function find_option

    !> True if an option is valid for a subcommand.
    pure logical function takes_option(command, name)
        type(command_type), intent(in) :: command
        character(len=*), intent(in) :: name

        takes_option = name == '--help' .or. index(command%options, ' '//trim(name)//' ') > 0
    end function takes_option

    !> Subcommand that was probably meant; empty if none is near.
    pure function nearest_command(word) result(name)
        character(len=*), intent(in) :: word
        character(len=:), allocatable :: name

        name = nearest_name(word, [character(len=15) :: commands%name, '--version', '--help'])
    end function nearest_command
end module tandem_cli_commands
