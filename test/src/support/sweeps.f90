! SPDX-License-Identifier: MIT
!> Sweeps for tests: construction of their files, runs, and comparisons.
module sweeps
    use asserts, only: check_close, check_no_failure, check_true
    use model_faulty, only: faulty_models
    use tandem, only: failure_type => error_type, long, wp
    use tandem_io, only: case_runner_type, distribute, plan_type, processes_type, read_sweep, record_type, settings_of, &
        sweep_journal_type, watcher_type
    use tandem_io_study_files, only: make_folder, write_whole
    use tandem_io_sweep_plan, only: is_uniform
    use tandem_io_sweep_record, only: words_of_record
    use tandem_io_sweep_team, only: event_loss, event_record, event_type, event_none, team_type
    use testdrive, only: error_type
    implicit none (type, external)
    private

    public :: compare, folder, keep, late_type, make_plan, newline, quiet_type, read_text, run_text, varied, vary

    !> Folder of the files of these tests; removed by `make clean`.
    character(len=*), parameter :: folder = 'build/test_sweep', newline = new_line('a')

    !> Shows nothing, but can end the sweep after a number of cases.
    type, extends(watcher_type) :: quiet_type
        integer(long) :: most = huge(1_long)
        logical :: is_reached = .false.
    contains
        procedure :: tell
        procedure :: stops
    end type quiet_type

    !> A worker that only reports its cases as done, all in order, except that it is lost before the first one and reports that one
    !> after a restart.
    type, extends(team_type) :: late_type
        !> Its cases.
        integer(long) :: cases(1000) = 0
        integer :: n = 0, told = 0
    contains
        procedure :: size => count_one
        procedure :: start => start_late
        procedure :: assign => give_late
        procedure :: next => next_late
        procedure :: end_worker => end_late
        procedure :: dismiss => dismiss_late
    end type late_type

contains

    integer function count_one(self)
        class(late_type), intent(in) :: self

        count_one = 1
    end function count_one

    subroutine start_late(self, worker, error)
        class(late_type), intent(inout) :: self
        integer, intent(in) :: worker
        type(failure_type), allocatable, intent(out) :: error

        self%n = 0
    end subroutine start_late

    subroutine give_late(self, worker, first, last)
        class(late_type), intent(inout) :: self
        integer, intent(in) :: worker
        integer(long), intent(in) :: first, last
        integer(long) :: case

        do case = first, last
            self%n = self%n + 1
            self%cases(self%n) = case
        end do
    end subroutine give_late

    subroutine next_late(self, milliseconds, event)
        class(late_type), intent(inout) :: self
        integer, intent(in) :: milliseconds
        type(event_type), intent(inout) :: event
        type(record_type) :: record
        integer(long) :: case

        event%kind = event_none
        event%worker = 1
        if (.not. allocated(event%words)) allocate (event%words(words_of_record(1)))
        if (self%n == 0 .or. milliseconds == 0) return
        self%told = self%told + 1
        if (self%told == 1) then
            event%kind = event_loss
            event%words(1) = 9
            event%n = 1
            return
        end if
        case = 1
        if (self%told > 2) then
            case = self%cases(1)
            self%cases(:self%n - 1) = self%cases(2:self%n)
            self%n = self%n - 1
        end if
        allocate (record%values(1), source=1.0_wp)
        record%case = case
        event%kind = event_record
        call record%to_words(event%words, event%n)
    end subroutine next_late

    subroutine end_late(self, worker)
        class(late_type), intent(inout) :: self
        integer, intent(in) :: worker

        self%n = 0
    end subroutine end_late

    subroutine dismiss_late(self)
        class(late_type), intent(inout) :: self

        self%n = 0
    end subroutine dismiss_late

    subroutine tell(self, journal, workers, busy)
        class(quiet_type), intent(inout) :: self
        type(sweep_journal_type), intent(in) :: journal
        integer, intent(in) :: workers
        real(wp), intent(in) :: busy

        self%is_reached = journal%done >= self%most
    end subroutine tell

    logical function stops(self)
        class(quiet_type), intent(inout) :: self

        stops = self%is_reached
    end function stops

    !> The records of two journals are equal except for their times.
    subroutine compare(error, one, other, keeps)
        type(error_type), allocatable, intent(inout) :: error
        type(sweep_journal_type), intent(inout) :: one, other
        !> True to keep the files.
        logical, intent(in), optional :: keeps
        type(record_type) :: first, second
        type(failure_type), allocatable :: failure
        integer(long) :: i

        call check_true(error, one%done == other%done, 'as many are done')
        do i = 1, one%last
            if (allocated(error)) return
            call one%read(i, first, failure)
            call check_no_failure(error, failure)
            call other%read(i, second, failure)
            call check_no_failure(error, failure)
            call check_close(error, first%values, second%values, 0.0_wp, 'values of a case')
        end do
        if (present(keeps)) return
        call one%close(.true.)
        call other%close(.true.)
    end subroutine compare

    !> A plan of numbers between 0 and 1.
    subroutine make_plan(plan, n, draws, points)
        type(plan_type), intent(out) :: plan
        integer, intent(in) :: n, draws, points
        integer :: i

        allocate (plan%inputs(n), plan%kept(0))
        do i = 1, n
            plan%inputs(i)%kind = is_uniform
        end do
        plan%draws = draws
        plan%points = points
        call plan%complete()
    end subroutine make_plan

    !> Two inputs that are drawn.
    pure function varied() result(text)
        character(len=:), allocatable :: text

        text = vary('model.mass', 'uniform = [1.0, 2.0]')//vary('model.pull', 'normal = [1.0, 0.5]')
    end function varied

    !> A table [[vary]].
    pure function vary(key, values) result(text)
        character(len=*), intent(in) :: key, values
        character(len=:), allocatable :: text

        text = '[[vary]]'//newline//'key = "'//key//'"'//newline//values//newline
    end function vary

    !> A table [[keep]].
    pure function keep(quantity, rest) result(text)
        character(len=*), intent(in) :: quantity
        character(len=*), intent(in), optional :: rest
        character(len=:), allocatable :: text

        text = '[[keep]]'//newline//'quantity = "'//quantity//'"'//newline
        if (present(rest)) text = text//rest//newline
    end function keep

    !> Read a sweep of the faulty model.
    subroutine read_text(table, rest, plan, failure)
        !> Further keys of [sweep] besides the scene, and following text.
        character(len=*), intent(in) :: table, rest
        type(plan_type), intent(out) :: plan
        type(failure_type), allocatable, intent(out) :: failure

        call make_folder(folder, failure)
        if (allocated(failure)) return
        call write_whole(folder//'/scene.toml', '[scene]'//newline//'model = "faulty"'//newline//'[time]'//newline//'end = 1.0'// &
            newline//'[solver]'//newline//'stepper = "rk4"'//newline//'step = 0.1'//newline//'[[event]]'//newline// &
            'name = "half"'//newline//'watch = "q1"'//newline//'value = 0.5'//newline, failure)
        if (allocated(failure)) return
        call write_whole(folder//'/sweep.toml', '[sweep]'//newline//'scene = "scene.toml"'//newline//table//newline//rest, failure)
        if (.not. allocated(failure)) call read_sweep(folder//'/sweep.toml', faulty_models(), plan, failure)
    end subroutine read_text

    !> Read and run a sweep of the faulty model; the journal stays open.
    subroutine run_text(table, rest, plan, journal, jobs, failure, most, name, goes_on)
        character(len=*), intent(in) :: table, rest
        type(plan_type), intent(out), target :: plan
        type(sweep_journal_type), intent(inout) :: journal
        integer, intent(in) :: jobs
        type(failure_type), allocatable, intent(out) :: failure
        !> Number of cases after which it ends.
        integer(long), intent(in), optional :: most
        !> Name of the journal.
        character(len=*), intent(in), optional :: name
        !> True to continue an existing journal.
        logical, intent(in), optional :: goes_on
        type(case_runner_type), target :: runner
        type(processes_type) :: team
        type(quiet_type) :: watcher
        character(len=:), allocatable :: path

        call read_text(table, rest, plan, failure)
        if (.not. allocated(failure)) call runner%prepare(plan, faulty_models())
        if (allocated(failure)) return
        path = folder//'/sweep.journal'
        if (present(name)) path = folder//'/'//name//'.journal'
        call journal%open(path, settings_of(plan), plan%n_outputs(), 1_long, plan%n_cases(), .not. present(goes_on), failure)
        if (allocated(failure)) return
        if (present(most)) watcher%most = most
        call team%prepare(runner, jobs)
        call distribute(journal, plan%n_outputs(), plan%max_seconds, team, watcher, failure)
    end subroutine run_text
end module sweeps
