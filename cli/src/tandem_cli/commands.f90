! SPDX-License-Identifier: MIT
!> Tables of the subcommands and of their options, used by the help, by the shell completion, and by the reader of the command line.
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
        command_type('list', '', ' --json ', 'list scenes and steppers'), &
        command_type('show', 'SCENE', ' --set --unset --output --drawing --force ', &
        'print the complete scene as TOML, with all defaults'), &
        command_type('check', 'SCENE', ' --set --unset --json ', &
        'check the start, and compare the procedures of the model with differences'), &
        command_type('run', 'SCENE', ' --set --unset --output --force --error --no-error --profile --quiet --json ', &
        'run the scene, write an HDF5 file, print a report'), &
        command_type('equilibrium', 'SCENE', ' --set --unset --json ', 'find the equilibrium and its stability'), &
        command_type('linearise', 'SCENE', ' --set --unset --at --equilibrium --steady --period --near --modes --shapes '// &
        '--output --force --json ', &
        'eigenvalues and modes about the start, an equilibrium or a steady motion'), &
        command_type('resume', 'FILE', ' --set --unset --error --no-error --quiet --json ', &
        'continue an interrupted run in its result file'), &
        command_type('verify', 'FILE', ' --json ', 'check all contents of a result file by checksums'), &
        command_type('study precision', 'SCENE...', ' --set --unset --output --force --quiet --steppers --reference --samples '// &
        '--repeats --budget --quick --json ', 'error against run time of all steppers'), &
        command_type('study stability', '[CASE...]', ' --output --force --quiet --json ', &
        'verdicts on stiff and extreme cases with all steppers'), &
        command_type('study tables', '', ' --output --force --quiet --json ', &
        'tables and figures of the paper compared with those of tandem'), &
        command_type('study modes', 'SCENE', ' --set --unset --over --output --json ', &
        'eigenvalues over a parameter of a scene, and changes of stability'), &
        command_type('sweep', 'SWEEP...', ' --output --jobs --cases --merge --force --quiet --json ', &
        'run many cases of a scene on all cores; write one table'), &
        command_type('plot', 'FILE...', ' --output --kind --names --plane --title ', &
        'plot result files as PNG, SVG or PDF; requires the Python package'), &
        command_type('view', 'FILE', ' --output --names --frames ', &
        'animation for browsers, .glb or .vtkhdf; requires the Python package'), &
        command_type('import', 'FILE...', ' --output --at --key --floating --limits --balance --strict --verify --force ', &
        'convert a robot (URDF, MJCF) to a scene; requires the Python package'), &
        command_type('statuses', '', ' --json ', 'list all statuses of runs with meanings and remedies'), &
        command_type('completion', 'SHELL', ' ', 'print a completion script for bash or zsh'), &
        command_type('help', '[COMMAND]', ' ', 'print this text, or help on a subcommand'), &
        command_type('version', '', ' ', 'print the version; also --version')]

    !> Options of all subcommands, in the order of the help.
    type(option_type), parameter :: options(*) = [ &
        option_type('--set', 'KEY=VALUE', 'override a key of the scene: table.key=value, event.NUMBER.key=value; repeatable'), &
        option_type('--unset', 'KEY', 'remove a key or an element of the scene: solver.rtol, event.2, force.damper; repeatable'), &
        option_type('--output', 'PATH', 'result file, as --set output.file=PATH; folder of a study; file of plot or view'), &
        option_type('--force', '', 'overwrite an existing file; restart a study'), &
        option_type('--error', '', 'estimate the error at the end by a second, more accurate run'), &
        option_type('--no-error', '', 'do not estimate the error; default: estimate it if the run took at most 2 s'), &
        option_type('--profile', '', 'measure the time of each part; the overhead of the clock is subtracted'), &
        option_type('--at', 'TIME', 'linearise at this time of a run; import: JOINT=X,..., positions of joints (rad, m)'), &
        option_type('--equilibrium', '', 'linearise at the equilibrium, as --set initial.equilibrium=true'), &
        option_type('--steady', 'NAME,NAME...', 'steady motion along these motions or "any", as --set initial.steady=...'), &
        option_type('--quiet', '', 'no progress and no report; warnings and errors still go to stderr'), &
        option_type('--json', '', 'print the report as one JSON object, numbers in full precision'), &
        option_type('--period', 'TIME', 'also print Floquet multipliers of a motion with this period'), &
        option_type('--near', 'RE,IM', 'eigenvalues of a large mechanism nearest to this number; IM is optional'), &
        option_type('--modes', 'N', 'number of eigenvalues with --near (10, at most 50)'), &
        option_type('--shapes', '', 'also print modes as motions of bodies'), &
        option_type('--over', 'KEY=a:b:n', 'vary this key from a to b in n values; --output is then a CSV file'), &
        option_type('--steppers', 'NAME,NAME...', 'only these steppers'), &
        option_type('--reference', 'FILE', 'reference motion: a result file or a text table; default: computed by the study'), &
        option_type('--samples', 'N', 'number of times at which motions are compared with the reference (40, at most 10000)'), &
        option_type('--repeats', 'N', 'minimum number of runs for the median time (3, at most 1000)'), &
        option_type('--budget', 'SECONDS', 'time limit for all runs of a row; finer rows are omitted (5)'), &
        option_type('--quick', '', '--repeats 1 --budget 0.5'), &
        option_type('--jobs', 'N', 'number of processes (number of cores)'), &
        option_type('--cases', 'FIRST:LAST', 'run only these cases of a sweep, as a task of a job array'), &
        option_type('--merge', '', 'run no cases; make the table from the journals given after the sweep'), &
        option_type('--kind', 'KIND', 'overview, tracks, coordinates, sensors, reactions, errors, energies or phase'), &
        option_type('--names', 'A,B...', 'plotted quantities: coordinates, d(coordinate), sensors, points'), &
        option_type('--plane', 'XY', 'plane of tracks: two of x, y and z'), &
        option_type('--title', 'TEXT', 'title of the plot'), &
        option_type('--frames', 'N', 'frames per second (60)'), &
        option_type('--drawing', 'PATH', 'write the shapes and joints of a mechanism, for viewers, to this HDF5 file'), &
        option_type('--floating', '', 'the root of the robot is a free body, not the ground'), &
        option_type('--key', 'NAME', 'MJCF: keyframe of the reference configuration and of the start'), &
        option_type('--limits', 'KIND', 'ranges of joints as stops (default), events or none'), &
        option_type('--balance', '', 'correct moments of inertia above the sum of the two others'), &
        option_type('--strict', '', 'refuse a robot that is not imported completely'), &
        option_type('--verify', '', 'compare accelerations of a robot with MuJoCo or Pinocchio'), &
        option_type('--help', '', 'print this text')]

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

    !> Subcommand with a similar name; empty if there is none.
    pure function nearest_command(word) result(name)
        character(len=*), intent(in) :: word
        character(len=:), allocatable :: name

        name = nearest_name(word, [character(len=15) :: commands%name, '--version', '--help'])
    end function nearest_command
end module tandem_cli_commands
