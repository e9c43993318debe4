! SPDX-License-Identifier: MIT
!> tandem help: what the program can do.
module tandem_app_help
    use tandem_app_messages, only: complain, done, input_wrong, say
    use tandem_io, only: nearest_name
    implicit none (type, external)
    private

    public :: help, refuse_command

    !> The subcommands.
    character(len=16), parameter :: commands(11) = [character(len=16) :: 'check', 'help', 'list', 'resume', 'run', 'show', &
        'statuses', 'study precision', 'study stability', 'study tables', 'verify']

    character(len=116), parameter :: text(*) = [character(len=116) :: &
        'tandem simulates multibody systems with holonomic and nonholonomic constraints.', &
        '', &
        'Usage:', &
        '  tandem list                  scenes and steppers, a line each', &
        '  tandem show SCENE [OPTIONS]  the complete scene as TOML, every default filled in', &
        '  tandem run SCENE [OPTIONS]   runs it, writes HDF5, prints a report', &
        '  tandem resume FILE [OPTIONS] goes on with a run that was interrupted, in its result file', &
        '  tandem verify FILE           whether a result file holds what was written: reads and sums up all of it', &
        '  tandem check SCENE [OPTIONS] its start, and every procedure of its model against differences', &
        '  tandem study precision SCENE... [OPTIONS]  error against run time, of every stepper', &
        '  tandem study stability [CASE...]  a verdict on every stiff and extreme case, with every stepper', &
        '  tandem study tables          the tables and figures of the paper beside ours', &
        '  tandem statuses              how runs can end, what that means, and what to do', &
        '  tandem help, tandem --version  this text, the version', &
        '', &
        'SCENE is the path of a TOML file, or a name that tandem list shows. Named scenes are', &
        'looked for in the folder that TANDEM_SCENES names, in ./scenes, and in the checkout.', &
        '', &
        'Options of run, show, check and study precision:', &
        '  --set table.key=value   override a key of the scene, as often as you like; of events, event.NUMBER.key=value,', &
        '                          or all of them anew, event=[{name="low", watch="rz", value=0.5}]', &
        'Options of run, show and study:', &
        '  --output FILE           the result file, as --set output.file=FILE; a study: its folder (study)', &
        'Options of resume:', &
        '  --set table.key=value   only time.end and solver.max_steps, max_evaluations, max_seconds, max_events', &
        'Options of run and resume:', &
        '  --error                 estimate the error at the end by a second, more accurate run, however long it takes', &
        '  --no-error              never do that (default: where the run took at most 2 s)', &
        'Options of run:', &
        '  --profile               where the time goes, part by part; clocks make the run slower, which is taken off', &
        'Options of run, resume and study:', &
        '  --quiet                 no progress on stderr', &
        'Options of run and study:', &
        '  --force                 overwrite a file that exists; a study: start anew', &
        'Options of study precision:', &
        '  --steppers NAME,NAME    only these steppers', &
        '  --reference FILE        the true motion: a result file or a text table (default: it makes its own)', &
        '  --samples N             times at which a motion is compared with its own reference (default 40, at most 10000)', &
        '  --repeats N             least runs of which the time is the median (default 3, at most 1000)', &
        '  --budget SECONDS        for all runs of a row; finer rows are left out (default 5)', &
        '  --quick                 --repeats 1 --budget 0.5', &
        'CASE of study stability is a case or a group of them: stiff, disk, vehicle, masses, units, steps, parallel, kinks,', &
        'million; all where none is given (some minutes). Exit code 1 where a run is wrong and nobody was warned.', &
        'A study that was interrupted continues when it is called again.', &
        '', &
        'Exit codes: 0 done, 1 the run failed, 2 the input was wrong, 128 + n ended by signal n.', &
        '', &
        'Examples:', &
        '  tandem run rolling_disk --set time.end=10 --set solver.step=2e-3 --output disk.h5', &
        '  tandem show rolling_disk > my_disk.toml', &
        '  tandem study precision rolling_disk --set time.end=10 --output disk_study']

contains

    !> Print the help.
    subroutine help(code)
        !> Exit code.
        integer, intent(out) :: code
        integer :: i

        do i = 1, size(text)
            call say(trim(text(i)))
        end do
        code = done
    end subroutine help

    !> Say that there is no such subcommand.
    subroutine refuse_command(command, code)
        character(len=*), intent(in) :: command
        !> Exit code.
        integer, intent(out) :: code
        character(len=:), allocatable :: guess

        if (command == 'study') then
            call complain('study needs to know which one: study precision SCENE..., study stability, or study tables'// &
                new_line('a')//'See tandem help.')
            code = input_wrong
            return
        end if
        guess = nearest_name(command, [character(len=len(commands)) :: commands, '--help', '--version'])
        if (guess /= '') guess = ' Did you mean "'//guess//'"?'
        call complain('there is no subcommand "'//command//'".'//guess//new_line('a')//'See tandem help.')
        code = input_wrong
    end subroutine refuse_command
end module tandem_app_help
