! SPDX-License-Identifier: MIT
!> Distributes the cases of a sweep among the workers of a team and writes their records into the journal. A worker that has
!> finished its cases gets more, in ranges that last about a tenth of a second, longer if the team reports with a delay, and
!> become smaller towards the end; each worker has a second range waiting, so that none is idle while this process sleeps.
module tandem_io_sweep_schedule
    use tandem, only: error_type, long, set_error, to_text, wp
    use tandem_io_sweep_journal, only: sweep_journal_type
    use tandem_io_sweep_processes, only: nap
    use tandem_io_sweep_record, only: record_type, status_crashed, status_hung
    use tandem_io_sweep_team, only: a_loss, a_record, event_type, nothing, team_type
    use tandem_status, only: status_interrupted
    use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
    implicit none (type, external)
    private

    public :: watcher_type, distribute

    !> Seconds that a range should last at least, and milliseconds that this process waits for the next record.
    real(wp), parameter :: shortest = 0.1_wp
    integer, parameter :: patience = 200
    !> Most milliseconds that it sleeps while cases are short, and number of cases that a worker may do meanwhile.
    integer, parameter :: longest_sleep = 20, unseen = 100
    integer(long), parameter :: most = 20000

    !> Receives the progress of the sweep, and may end it.
    type, abstract :: watcher_type
    contains
        procedure(tell_interface), deferred :: tell
        procedure(stops_interface), deferred :: stops
    end type watcher_type

    abstract interface
        !> So many cases are done.
        subroutine tell_interface(self, journal, workers, busy)
            import :: sweep_journal_type, watcher_type, wp
            implicit none (type, external)
            class(watcher_type), intent(inout) :: self
            type(sweep_journal_type), intent(in) :: journal
            !> Number of workers; the seconds that they have worked in total.
            integer, intent(in) :: workers
            real(wp), intent(in) :: busy
        end subroutine tell_interface

        !> True to end the sweep now.
        logical function stops_interface(self)
            import :: watcher_type
            implicit none (type, external)
            class(watcher_type), intent(inout) :: self
        end function stops_interface
    end interface

    !> Work assigned to a worker.
    type :: duty_type
        logical :: is_there = .false.
        !> Its ranges, the first `n` of two; the first range begins with the next case.
        integer(long) :: ranges(2, 2) = 0
        integer :: n = 0
        !> Time of its last event.
        integer(long) :: since = 0
    end type duty_type

    !> The state of the distribution.
    type :: schedule_type
        type(duty_type), allocatable :: duties(:)
        !> The next unassigned case, and ranges left by lost workers.
        integer(long) :: next = 1
        integer(long), allocatable :: left(:, :)
        !> Cases whose process has ended once.
        integer(long), allocatable :: suspects(:)
        !> Seconds and number of the cases that were run.
        real(wp) :: busy = 0.0_wp
        integer(long) :: cases = 0
        !> Seconds without an event after which a worker is ended, 0 for never.
        real(wp) :: limit = 0.0_wp
        !> Seconds that a range should last.
        real(wp) :: lasting = shortest
    end type schedule_type

contains

    !> Run all cases of a journal that are not done.
    subroutine distribute(journal, outputs, max_seconds, team, watcher, error)
        type(sweep_journal_type), intent(inout) :: journal
        !> Numbers of a record.
        integer, intent(in) :: outputs
        !> Of a case; 0 for no limit.
        real(wp), intent(in) :: max_seconds
        class(team_type), intent(inout) :: team
        class(watcher_type), intent(inout) :: watcher
        type(error_type), allocatable, intent(out) :: error
        type(schedule_type) :: schedule
        type(event_type) :: event
        type(record_type) :: record
        real(wp) :: sleep

        allocate (schedule%duties(team%size()), schedule%left(2, 0), schedule%suspects(0))
        allocate (record%values(outputs))
        schedule%next = journal%first
        ! A case that respects its limit ends in time; others get twice the time.
        if (max_seconds > 0.0_wp) schedule%limit = 2*max_seconds + 5.0_wp + 2*team%delay()
        schedule%lasting = max(shortest, 4*team%delay())
        do
            call give_cases(schedule, journal, team, error)
            if (allocated(error) .or. all(schedule%duties%n == 0)) exit
            call team%next(patience, event)
            do while (event%kind /= nothing)
                call take_event(schedule, journal, event, record, error)
                if (allocated(error)) exit
                call team%next(0, event)
            end do
            if (.not. allocated(error)) call end_hung(schedule, journal, team, record, error)
            if (.not. allocated(error)) call journal%flush(error)
            if (allocated(error)) exit
            call watcher%tell(journal, team%size(), schedule%busy)
            if (watcher%stops()) then
                call set_error(error, status_interrupted, 'the sweep was terminated with '//to_text(int(journal%done))// &
                    ' of '//to_text(int(journal%last - journal%first + 1))//' cases done', &
                    'the same command continues with the remaining cases')
                exit
            end if
            ! Short cases would wake this process at each of them.
            if (schedule%cases == 0) cycle
            sleep = 1.0e3_wp*schedule%busy/real(schedule%cases, wp)
            if (sleep < longest_sleep) call nap(max(1, min(longest_sleep, int(unseen*sleep))))
        end do
        call team%dismiss()
    end subroutine distribute

    !> Start workers and give them cases, as long as there are any.
    subroutine give_cases(schedule, journal, team, error)
        type(schedule_type), intent(inout) :: schedule
        type(sweep_journal_type), intent(inout) :: journal
        class(team_type), intent(inout) :: team
        type(error_type), allocatable, intent(out) :: error
        integer(long) :: range(2)
        integer :: round, i

        ! First one range for each, then the second.
        do round = 1, 2
            do i = 1, size(schedule%duties)
                associate (duty => schedule%duties(i))
                    if (duty%n >= round) cycle
                    call next_range(schedule, journal, range)
                    if (range(1) > range(2)) return
                    if (.not. duty%is_there) then
                        ! Records in the journal's buffer must not be written twice.
                        call journal%flush(error)
                        if (.not. allocated(error)) call team%start(i, error)
                        if (allocated(error)) return
                        duty%is_there = .true.
                    end if
                    call team%give(i, range(1), range(2))
                    if (duty%n == 0) call system_clock(duty%since)
                    duty%n = duty%n + 1
                    duty%ranges(:, duty%n) = range
                end associate
            end do
        end do
    end subroutine give_cases

    !> Unassigned cases: an empty range if there are none.
    subroutine next_range(schedule, journal, range)
        type(schedule_type), intent(inout) :: schedule
        type(sweep_journal_type), intent(in) :: journal
        integer(long), intent(out) :: range(2)
        integer(long) :: length
        integer :: n

        n = size(schedule%left, 2)
        if (n > 0) then
            range = schedule%left(:, n)
            schedule%left = schedule%left(:, :n - 1)
            return
        end if
        do while (schedule%next <= journal%last)
            if (.not. journal%has(schedule%next)) exit
            schedule%next = schedule%next + 1
        end do
        length = 1
        if (schedule%cases > 0) then
            length = int(min(real(most, wp), schedule%lasting*real(schedule%cases, wp)/max(schedule%busy, 1.0e-9_wp)), long)
        end if
        length = max(1_long, min(length, (journal%last - schedule%next + 1)/(4*size(schedule%duties))))
        range = [schedule%next, schedule%next - 1]
        do while (range(2) < min(journal%last, range(1) + length - 1))
            if (journal%has(range(2) + 1)) exit
            range(2) = range(2) + 1
        end do
        schedule%next = range(2) + 1
    end subroutine next_range

    !> Process an event of a worker.
    subroutine take_event(schedule, journal, event, record, error)
        type(schedule_type), intent(inout) :: schedule
        type(sweep_journal_type), intent(inout) :: journal
        type(event_type), intent(in) :: event
        type(record_type), intent(inout) :: record
        type(error_type), allocatable, intent(out) :: error
        integer(long) :: case

        associate (duty => schedule%duties(event%worker))
            call system_clock(duty%since)
            if (event%kind == a_record) then
                call record%from_words(event%words(:event%n))
                schedule%busy = schedule%busy + record%seconds
                schedule%cases = schedule%cases + 1
                call journal%append(record, error)
                ! The last records of a worker that was ended may arrive after its restart.
                if (duty%n > 0 .and. duty%ranges(1, 1) == record%case) call pass_case(duty)
                return
            end if
            duty%is_there = .false.
            if (duty%n == 0) return
            ! The process may have been killed from outside: the case is tried a second time in another one.
            case = duty%ranges(1, 1)
            if (any(schedule%suspects == case)) then
                call refuse_case(record, case, status_crashed, 'the process of this case ended'//trim(signal_words(event%words(1))))
                call journal%append(record, error)
                call pass_case(duty)
            else
                schedule%suspects = [schedule%suspects, case]
            end if
            call leave_rest(schedule, duty)
        end associate
    end subroutine take_event

    !> Name of a signal.
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

    !> The next case of a worker is done.
    subroutine pass_case(duty)
        type(duty_type), intent(inout) :: duty

        if (duty%n == 0) return
        duty%ranges(1, 1) = duty%ranges(1, 1) + 1
        if (duty%ranges(1, 1) <= duty%ranges(2, 1)) return
        duty%ranges(:, 1) = duty%ranges(:, 2)
        duty%n = duty%n - 1
    end subroutine pass_case

    !> The cases of a worker that is lost go to others.
    subroutine leave_rest(schedule, duty)
        type(schedule_type), intent(inout) :: schedule
        type(duty_type), intent(inout) :: duty
        integer(long), allocatable :: left(:, :)
        integer :: n

        n = size(schedule%left, 2)
        allocate (left(2, n + duty%n))
        left(:, :n) = schedule%left
        left(:, n + 1:) = duty%ranges(:, :duty%n)
        call move_alloc(left, schedule%left)
        duty%n = 0
    end subroutine leave_rest

    !> End workers whose case does not return.
    subroutine end_hung(schedule, journal, team, record, error)
        type(schedule_type), intent(inout) :: schedule
        type(sweep_journal_type), intent(inout) :: journal
        class(team_type), intent(inout) :: team
        type(record_type), intent(inout) :: record
        type(error_type), allocatable, intent(out) :: error
        integer(long) :: now, rate
        integer :: i

        if (.not. schedule%limit > 0.0_wp) return
        call system_clock(now, rate)
        do i = 1, size(schedule%duties)
            associate (duty => schedule%duties(i))
                if (duty%n == 0 .or. real(now - duty%since, wp) < schedule%limit*real(rate, wp)) cycle
                call team%end_worker(i)
                duty%is_there = .false.
                call refuse_case(record, duty%ranges(1, 1), status_hung, 'the case did not return long after max_seconds, '// &
                    'as if a procedure of the model never returned; its process was terminated')
                call journal%append(record, error)
                if (allocated(error)) return
                call pass_case(duty)
                call leave_rest(schedule, duty)
            end associate
        end do
    end subroutine end_hung

    !> The record of a case that has none of its own.
    subroutine refuse_case(record, case, status, message)
        type(record_type), intent(inout) :: record
        integer(long), intent(in) :: case
        integer, intent(in) :: status
        character(len=*), intent(in) :: message

        record%case = case
        record%status = status
        record%seconds = 0.0_wp
        record%values = ieee_value(1.0_wp, ieee_quiet_nan)
        record%message = message
    end subroutine refuse_case
end module tandem_io_sweep_schedule
