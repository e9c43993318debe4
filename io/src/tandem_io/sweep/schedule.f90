! SPDX-License-Identifier: MIT
!> Distributes the cases of a sweep among the workers of a team and writes their records into the journal. A worker receives cases
!> in ranges that take about a tenth of a second, or longer if the team reports with a delay; towards the end of the sweep the
!> ranges become shorter. Each worker has a second range in its queue, so that it is never idle while this process sleeps.
module tandem_io_sweep_schedule
    use tandem, only: error_type, long, set_error, to_text, wp
    use tandem_io_sweep_journal, only: sweep_journal_type
    use tandem_io_sweep_processes, only: sleep_for
    use tandem_io_sweep_record, only: record_type, status_crashed, status_hung
    use tandem_io_sweep_team, only: event_loss, event_record, event_type, event_none, team_type
    use tandem_status, only: status_interrupted
    use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
    implicit none (type, external)
    private

    public :: watcher_type, distribute

    !> Smallest duration of a range, seconds; largest time of waiting for a record, milliseconds.
    real(wp), parameter :: shortest_range = 0.1_wp
    integer, parameter :: longest_wait = 200
    !> If cases are short, this process sleeps for the duration of some cases: largest time in milliseconds, and number of cases.
    integer, parameter :: longest_sleep = 20, cases_per_sleep = 100
    integer(long), parameter :: longest_range = 20000

    !> Receives the progress of the sweep, and can end it.
    type, abstract :: watcher_type
    contains
        procedure(tell_interface), deferred :: tell
        procedure(stops_interface), deferred :: stops
    end type watcher_type

    abstract interface
        !> Receive the progress.
        subroutine tell_interface(self, journal, workers, busy)
            import :: sweep_journal_type, watcher_type, wp
            implicit none (type, external)
            class(watcher_type), intent(inout) :: self
            type(sweep_journal_type), intent(in) :: journal
            !> Number of workers; total time of all cases, seconds.
            integer, intent(in) :: workers
            real(wp), intent(in) :: busy
        end subroutine tell_interface

        !> True to end the sweep.
        logical function stops_interface(self)
            import :: watcher_type
            implicit none (type, external)
            class(watcher_type), intent(inout) :: self
        end function stops_interface
    end interface

    !> State of a worker.
    type :: duty_type
        logical :: is_running = .false.
        !> Queue of ranges, of which the first `n` are in use. The first range begins with the case that the worker is running.
        integer(long) :: ranges(2, 2) = 0
        integer :: n = 0
        !> Time of the last event.
        integer(long) :: last_event = 0
    end type duty_type

    !> State of the distribution.
    type :: schedule_type
        type(duty_type), allocatable :: duties(:)
        !> First case that was never assigned; ranges returned by lost workers.
        integer(long) :: next = 1
        integer(long), allocatable :: returned(:, :)
        !> Cases during which a worker process has ended once.
        integer(long), allocatable :: suspects(:)
        !> Total time and number of finished cases.
        real(wp) :: busy = 0.0_wp
        integer(long) :: cases = 0
        !> Time without an event after which a worker is terminated, seconds; 0 for no limit.
        real(wp) :: event_timeout = 0.0_wp
        !> Duration of a range, seconds.
        real(wp) :: range_seconds = shortest_range
    end type schedule_type

contains

    !> Run all unfinished cases of a journal.
    subroutine distribute(journal, outputs, max_seconds, team, watcher, error)
        type(sweep_journal_type), intent(inout) :: journal
        !> Numbers per record.
        integer, intent(in) :: outputs
        !> Time limit of a case, seconds; 0 for no limit.
        real(wp), intent(in) :: max_seconds
        class(team_type), intent(inout) :: team
        class(watcher_type), intent(inout) :: watcher
        type(error_type), allocatable, intent(out) :: error
        type(schedule_type) :: schedule
        type(event_type) :: event
        type(record_type) :: record
        real(wp) :: sleep

        allocate (schedule%duties(team%size()), schedule%returned(2, 0), schedule%suspects(0))
        allocate (record%values(outputs))
        schedule%next = journal%first
        ! A case that observes its time limit ends in time. The margin avoids the termination of a case about to end.
        if (max_seconds > 0.0_wp) schedule%event_timeout = 2*max_seconds + 5.0_wp + 2*team%delay()
        schedule%range_seconds = max(shortest_range, 4*team%delay())
        do
            call give_cases(schedule, journal, team, error)
            if (allocated(error) .or. all(schedule%duties%n == 0)) exit
            call team%next(longest_wait, event)
            do while (event%kind /= event_none)
                call process_event(schedule, journal, event, record, error)
                if (allocated(error)) exit
                call team%next(0, event)
            end do
            if (.not. allocated(error)) call terminate_hung(schedule, journal, team, record, error)
            if (.not. allocated(error)) call journal%flush(error)
            if (allocated(error)) exit
            call watcher%tell(journal, team%size(), schedule%busy)
            if (watcher%stops()) then
                call set_error(error, status_interrupted, 'the sweep was terminated with '//to_text(int(journal%done))// &
                    ' of '//to_text(int(journal%last - journal%first + 1))//' cases done', &
                    'the same command continues with the remaining cases')
                exit
            end if
            ! Without this sleep, short cases would wake this process for every record.
            if (schedule%cases == 0) cycle
            sleep = 1.0e3_wp*schedule%busy/real(schedule%cases, wp)
            if (sleep < longest_sleep) call sleep_for(max(1, min(longest_sleep, int(cases_per_sleep*sleep))))
        end do
        call team%dismiss()
    end subroutine distribute

    !> Assign ranges of cases to workers, which are started if necessary.
    subroutine give_cases(schedule, journal, team, error)
        type(schedule_type), intent(inout) :: schedule
        type(sweep_journal_type), intent(inout) :: journal
        class(team_type), intent(inout) :: team
        type(error_type), allocatable, intent(out) :: error
        integer(long) :: range(2)
        integer :: round, i

        ! All workers get a first range before any gets a second one.
        do round = 1, 2
            do i = 1, size(schedule%duties)
                associate (duty => schedule%duties(i))
                    if (duty%n >= round) cycle
                    call next_range(schedule, journal, range)
                    if (range(1) > range(2)) return
                    if (.not. duty%is_running) then
                        ! The new process inherits the journal's buffer, and must not write the buffered records again.
                        call journal%flush(error)
                        if (.not. allocated(error)) call team%start(i, error)
                        if (allocated(error)) return
                        duty%is_running = .true.
                    end if
                    call team%assign(i, range(1), range(2))
                    if (duty%n == 0) call system_clock(duty%last_event)
                    duty%n = duty%n + 1
                    duty%ranges(:, duty%n) = range
                end associate
            end do
        end do
    end subroutine give_cases

    !> Select a range of unassigned cases; it is empty if there are none.
    subroutine next_range(schedule, journal, range)
        type(schedule_type), intent(inout) :: schedule
        type(sweep_journal_type), intent(in) :: journal
        integer(long), intent(out) :: range(2)
        integer(long) :: length
        integer :: n

        n = size(schedule%returned, 2)
        if (n > 0) then
            range = schedule%returned(:, n)
            schedule%returned = schedule%returned(:, :n - 1)
            return
        end if
        do while (schedule%next <= journal%last)
            if (.not. journal%has(schedule%next)) exit
            schedule%next = schedule%next + 1
        end do
        length = 1
        if (schedule%cases > 0) then
            length = int(min(real(longest_range, wp), &
                schedule%range_seconds*real(schedule%cases, wp)/max(schedule%busy, 1.0e-9_wp)), long)
        end if
        length = max(1_long, min(length, (journal%last - schedule%next + 1)/(4*size(schedule%duties))))
        range = [schedule%next, schedule%next - 1]
        do while (range(2) < min(journal%last, range(1) + length - 1))
            if (journal%has(range(2) + 1)) exit
            range(2) = range(2) + 1
        end do
        schedule%next = range(2) + 1
    end subroutine next_range

    !> Process an event reported by a worker.
    subroutine process_event(schedule, journal, event, record, error)
        type(schedule_type), intent(inout) :: schedule
        type(sweep_journal_type), intent(inout) :: journal
        type(event_type), intent(in) :: event
        type(record_type), intent(inout) :: record
        type(error_type), allocatable, intent(out) :: error
        integer(long) :: case

        associate (duty => schedule%duties(event%worker))
            call system_clock(duty%last_event)
            if (event%kind == event_record) then
                call record%from_words(event%words(:event%n))
                schedule%busy = schedule%busy + record%seconds
                schedule%cases = schedule%cases + 1
                call journal%append(record, error)
                ! Records sent by a worker before it was terminated may arrive after its restart.
                if (duty%n > 0 .and. duty%ranges(1, 1) == record%case) call advance_case(duty)
                return
            end if
            duty%is_running = .false.
            if (duty%n == 0) return
            ! A process may have been killed from outside. Therefore a case is run again before it is reported as crashed.
            case = duty%ranges(1, 1)
            if (any(schedule%suspects == case)) then
                call set_failure_record(record, case, status_crashed, 'the process of this case ended'// &
                    trim(signal_words(event%words(1))))
                call journal%append(record, error)
                call advance_case(duty)
            else
                schedule%suspects = [schedule%suspects, case]
            end if
            call return_cases(schedule, duty)
        end associate
    end subroutine process_event

    !> Description of the signal that ended a process.
    pure function signal_words(signal) result(words)
        integer(long), intent(in) :: signal
        character(len=48) :: words
        integer, parameter :: numbers(7) = [4, 6, 7, 8, 9, 11, 15]
        character(len=7), parameter :: names(7) = [character(len=7) :: 'SIGILL', 'SIGABRT', 'SIGBUS', 'SIGFPE', 'SIGKILL', &
            'SIGSEGV', 'SIGTERM']
        integer :: i

        words = ' without a signal, as by a STOP in the model'
        if (signal == 0) return
        words = ' by signal '//to_text(int(signal))
        i = findloc(numbers, int(signal), dim=1)
        if (i > 0) words = ' by signal '//to_text(int(signal))//', '//names(i)
    end function signal_words

    !> Advance a worker to its next case.
    subroutine advance_case(duty)
        type(duty_type), intent(inout) :: duty

        if (duty%n == 0) return
        duty%ranges(1, 1) = duty%ranges(1, 1) + 1
        if (duty%ranges(1, 1) <= duty%ranges(2, 1)) return
        duty%ranges(:, 1) = duty%ranges(:, 2)
        duty%n = duty%n - 1
    end subroutine advance_case

    !> Return the unfinished cases of a worker for reassignment.
    subroutine return_cases(schedule, duty)
        type(schedule_type), intent(inout) :: schedule
        type(duty_type), intent(inout) :: duty
        integer(long), allocatable :: returned(:, :)
        integer :: n

        n = size(schedule%returned, 2)
        allocate (returned(2, n + duty%n))
        returned(:, :n) = schedule%returned
        returned(:, n + 1:) = duty%ranges(:, :duty%n)
        call move_alloc(returned, schedule%returned)
        duty%n = 0
    end subroutine return_cases

    !> Terminate workers whose case does not return.
    subroutine terminate_hung(schedule, journal, team, record, error)
        type(schedule_type), intent(inout) :: schedule
        type(sweep_journal_type), intent(inout) :: journal
        class(team_type), intent(inout) :: team
        type(record_type), intent(inout) :: record
        type(error_type), allocatable, intent(out) :: error
        integer(long) :: now, rate
        integer :: i

        if (.not. schedule%event_timeout > 0.0_wp) return
        call system_clock(now, rate)
        do i = 1, size(schedule%duties)
            associate (duty => schedule%duties(i))
                if (duty%n == 0 .or. real(now - duty%last_event, wp) < schedule%event_timeout*real(rate, wp)) cycle
                call team%end_worker(i)
                duty%is_running = .false.
                call set_failure_record(record, duty%ranges(1, 1), status_hung, &
                    'the case did not return long after max_seconds, as if a procedure of the model never '// &
                    'returned; its process was terminated')
                call journal%append(record, error)
                if (allocated(error)) return
                call advance_case(duty)
                call return_cases(schedule, duty)
            end associate
        end do
    end subroutine terminate_hung

    !> Define the record of a case whose process has not returned one.
    subroutine set_failure_record(record, case, status, message)
        type(record_type), intent(inout) :: record
        integer(long), intent(in) :: case
        integer, intent(in) :: status
        character(len=*), intent(in) :: message

        record%case = case
        record%status = status
        record%seconds = 0.0_wp
        record%values = ieee_value(1.0_wp, ieee_quiet_nan)
        record%message = message
    end subroutine set_failure_record
end module tandem_io_sweep_schedule
