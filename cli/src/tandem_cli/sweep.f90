! SPDX-License-Identifier: MIT
!> tandem sweep: many cases of a scene, with the results in one table.
module tandem_cli_sweep
    use tandem, only: error_type, is_input_error, long, to_text
    use tandem_cli_arguments, only: arguments_type
    use tandem_cli_interruption, only: caught_signal, watch_signals
    use tandem_cli_messages, only: print_to_stderr, done, input_wrong, run_failed, say, signalled
    use tandem_cli_sweep_progress, only: sweep_progress_type
    use tandem_cli_sweep_summary, only: print_summary, print_summary_json
    use tandem_io, only: case_runner_type, cores, csv_path, distribute, is_same_file, plan_type, processes_type, read_sweep, &
        settings_of, sweep_journal_type, write_table
    use tandem_number_text, only: read_number
    use tandem_status, only: status_interrupted
    implicit none (type, external)
    private

    public :: sweep, sweep_setup_type, prepare_sweep, finish_sweep, code_of

    !> State of a sweep. Cases are run between `prepare_sweep` and `finish_sweep`.
    type :: sweep_setup_type
        type(plan_type) :: plan
        !> Path of the table; first and last requested case.
        character(len=:), allocatable :: output
        integer(long) :: first = 1, last = 0
        !> True if all cases are requested, so that the table is written.
        logical :: has_all_cases = .true.
        type(sweep_journal_type) :: journal
        type(case_runner_type) :: runner
        type(sweep_progress_type) :: progress
    end type sweep_setup_type

contains

    !> Run a sweep.
    subroutine sweep(arguments, code)
        type(arguments_type), intent(in) :: arguments
        !> Exit code.
        integer, intent(out) :: code
        type(sweep_setup_type), target :: setup
        type(processes_type) :: team
        type(error_type), allocatable :: error
        integer :: jobs

        call prepare_sweep(arguments, setup, error)
        jobs = cores()
        if (.not. allocated(error)) call arguments%count_of('--jobs', 4096, jobs, error)
        if (.not. allocated(error) .and. .not. arguments%merges .and. setup%journal%done <= setup%last - setup%first) then
            call setup%progress%begin()
            call team%prepare(setup%runner, int(min(int(jobs, long), setup%last - setup%first + 1 - setup%journal%done)))
            call distribute(setup%journal, setup%plan%n_outputs(), setup%plan%max_seconds, team, setup%progress, error)
        end if
        if (.not. allocated(error)) call finish_sweep(arguments, setup, error)
        call setup%progress%clear()
        call setup%journal%close(.false.)
        code = done
        if (.not. allocated(error)) return
        call print_to_stderr(error%message)
        code = code_of(error)
    end subroutine sweep

    !> Exit code for an error.
    integer function code_of(error) result(code)
        type(error_type), intent(in) :: error

        code = run_failed
        if (is_input_error(error%stat)) code = input_wrong
        if (error%stat == status_interrupted) code = signalled + caught_signal()
    end function code_of

    !> Read the sweep and its scene, and open its journal.
    subroutine prepare_sweep(arguments, setup, error)
        type(arguments_type), intent(in) :: arguments
        type(sweep_setup_type), intent(inout), target :: setup
        type(error_type), allocatable, intent(out) :: error
        character(len=:), allocatable :: name
        logical :: exists, csv_exists, is_continued

        call read_sweep(trim(arguments%scenes(1)), arguments%models, setup%plan, error)
        if (allocated(error)) return
        ! Signals are caught only from here on, so that they end the program while it waits for a pipe.
        call watch_signals()
        call find_output(arguments, setup, error)
        if (allocated(error)) return
        setup%first = 1
        setup%last = setup%plan%n_cases()
        call read_range(arguments, setup, error)
        if (allocated(error)) return
        inquire (file=setup%output, exist=exists)
        ! If a journal exists, this command continues a sweep that was allowed to overwrite the table.
        inquire (file=setup%output//'.journal', exist=is_continued)
        inquire (file=csv_path(setup%output), exist=csv_exists)
        if ((exists .or. csv_exists) .and. setup%has_all_cases .and. .not. (arguments%force .or. is_continued)) then
            name = setup%output
            if (.not. exists) name = csv_path(setup%output)
            call refuse(name//' exists; choose another table with --output, or overwrite with --force', error)
            return
        end if
        call setup%runner%prepare(setup%plan, arguments%models)
        name = setup%output//'.journal'
        if (.not. setup%has_all_cases) name = setup%output//'.'//to_text(int(setup%first))//'-'// &
            to_text(int(setup%last))//'.journal'
        call setup%journal%open(name, settings_of(setup%plan), setup%plan%n_outputs(), setup%first, setup%last, arguments%force, &
            error)
        if (allocated(error)) return
        setup%progress%quiet = arguments%quiet
        if (setup%journal%resumed > 0) call setup%progress%remark('continued: '//to_text(int(setup%journal%resumed))// &
            ' cases are done already')
        if (arguments%merges) call merge_parts(arguments, setup, error)
    end subroutine prepare_sweep

    !> Find the path of the table.
    subroutine find_output(arguments, setup, error)
        type(arguments_type), intent(in) :: arguments
        type(sweep_setup_type), intent(inout) :: setup
        type(error_type), allocatable, intent(out) :: error
        character(len=:), allocatable :: name
        character(len=*), parameter :: would_overwrite = ' would overwrite the sweep, the scene or the file of cases; choose '// &
            'another table with --output'
        integer :: last

        name = setup%plan%path(index(setup%plan%path, '/', back=.true.) + 1:)
        last = index(name, '.toml', back=.true.) - 1
        if (last < 1) last = len(name)
        setup%output = arguments%value_of('--output', name(:last)//'.h5')
        if (is_read(setup%plan, setup%output)) then
            call refuse('the table '//setup%output//would_overwrite, error)
        else if (is_read(setup%plan, csv_path(setup%output))) then
            call refuse('the comma-separated values of the table, '//csv_path(setup%output)//would_overwrite, error)
        end if
    end subroutine find_output

    !> True if a path is an input file of the sweep.
    logical function is_read(plan, path)
        type(plan_type), intent(in) :: plan
        character(len=*), intent(in) :: path

        is_read = is_same_file(path, plan%path) .or. is_same_file(path, plan%scene_path)
        if (plan%cases_path /= '') is_read = is_read .or. is_same_file(path, plan%cases_path)
    end function is_read

    !> Read the option `--cases a:b`.
    subroutine read_range(arguments, setup, error)
        type(arguments_type), intent(in) :: arguments
        type(sweep_setup_type), intent(inout) :: setup
        type(error_type), allocatable, intent(out) :: error
        character(len=:), allocatable :: text
        integer(long) :: range(2)
        integer :: colon
        logical :: is_good

        text = arguments%value_of('--cases', '')
        if (text == '') return
        setup%has_all_cases = .false.
        colon = index(text, ':')
        is_good = .false.
        if (colon > 0) then
            call read_number(text(:colon - 1), range(1), is_good)
            if (is_good) call read_number(text(colon + 1:), range(2), is_good)
            is_good = is_good .and. range(1) >= 1 .and. range(1) <= range(2)
        end if
        if (.not. is_good) then
            call refuse('tandem sweep needs first:last after --cases, as in --cases 1:250, not "'//text//'"', error)
        else if (arguments%merges) then
            call refuse('tandem sweep takes --cases or --merge, not both', error)
        else if (range(1) > setup%last) then
            call refuse('tandem sweep --cases '//text//': no such cases; there are '// &
                to_text(int(setup%last)), error)
        else
            setup%first = range(1)
            ! The last task of an array may have fewer cases.
            setup%last = min(range(2), setup%last)
        end if
    end subroutine read_range

    !> Merge the journals of the tasks of an array.
    subroutine merge_parts(arguments, setup, error)
        type(arguments_type), intent(in) :: arguments
        type(sweep_setup_type), intent(inout) :: setup
        type(error_type), allocatable, intent(out) :: error
        logical :: is_same_sweep
        integer :: i

        do i = 2, size(arguments%scenes)
            call setup%journal%merge_from(trim(arguments%scenes(i)), settings_of(setup%plan), is_same_sweep, error)
            if (allocated(error)) return
            if (.not. is_same_sweep) then
                call refuse(trim(arguments%scenes(i))//' has no cases of this sweep, or those of another build of tandem', error)
                return
            end if
        end do
    end subroutine merge_parts

    !> Write the table if all cases are complete, and print its summary.
    subroutine finish_sweep(arguments, setup, error)
        type(arguments_type), intent(in) :: arguments
        type(sweep_setup_type), intent(inout) :: setup
        type(error_type), allocatable, intent(out) :: error
        integer(long) :: missing

        missing = setup%last - setup%first + 1 - setup%journal%done
        if (.not. setup%has_all_cases) then
            call setup%progress%remark(to_text(int(setup%journal%done))//' cases are in '//setup%journal%path//', '// &
                to_text(int(setup%journal%failed))//' of them failed; when all tasks are done, tandem sweep '// &
                setup%plan%path//' --output '//setup%output//' --merge '//setup%output//'.*-*.journal makes the table')
            return
        end if
        if (missing > 0) then
            call refuse(to_text(int(missing))//' of '//to_text(int(setup%last))//' cases are missing in the journals, the '// &
                'first '//first_missing(setup)//'; run them, or omit --merge', error)
            return
        end if
        call write_table(setup%output, setup%plan, setup%journal, error)
        if (allocated(error)) return
        call setup%journal%close(.true.)
        call setup%progress%clear()
        if (arguments%json) then
            call print_summary_json(setup%output, setup%plan, setup%journal, error)
        else if (.not. arguments%quiet) then
            call print_summary(setup%output, setup%plan, setup%journal, error)
            call say('files: '//setup%output//', '//csv_path(setup%output))
        end if
    end subroutine finish_sweep

    !> Number of the first missing case.
    function first_missing(setup) result(text)
        type(sweep_setup_type), intent(in) :: setup
        character(len=:), allocatable :: text
        integer(long) :: case

        do case = setup%first, setup%last - 1
            if (.not. setup%journal%has(case)) exit
        end do
        text = to_text(int(case))
    end function first_missing

    !> Set an input error.
    subroutine refuse(message, error)
        character(len=*), intent(in) :: message
        type(error_type), allocatable, intent(out) :: error

        allocate (error)
        error%stat = -1
        error%message = message
    end subroutine refuse
end module tandem_cli_sweep
