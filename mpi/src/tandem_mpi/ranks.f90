! SPDX-License-Identifier: MIT
!> A team of ranks of MPI: rank 0 distributes and writes; each rank, including the first, runs cases in its own processes, so that a
!> case that ends its process does not end a rank. There are few messages: a rank sends the reports of its processes together.
module tandem_mpi_ranks
    use mpi_f08, only: mpi_any_source, mpi_any_tag, mpi_comm_size, mpi_comm_world, mpi_get_count, mpi_integer8, &
        mpi_iprobe, mpi_recv, mpi_send, mpi_status
    use tandem, only: error_type, long, wp
    use tandem_io, only: case_runner_type, processes_type
    use tandem_io_sweep_processes, only: sleep_for
    use tandem_io_sweep_team, only: event_loss, event_type, event_none, team_type
    implicit none (type, external)
    private

    public :: ranks_type, relay

    !> Kinds of messages.
    integer, parameter :: to_start = 1, to_give = 2, to_end = 3, to_leave = 4, told = 5
    !> Largest number of words of a message of events, and milliseconds that a rank sleeps between checks for messages.
    integer, parameter :: most_words = 65536, sleep = 2
    !> Seconds, per rank, during which a rank collects reports: rank 0 receives 2000 messages a second, for any number of ranks.
    real(wp), parameter :: gathering = 5.0e-4_wp
    !> Seconds that rank 0 waits for the others to leave.
    integer(long), parameter :: longest = 5
    !> Words before those of an event: its kind, the worker, the number of words.
    integer, parameter :: head = 3

    type, extends(team_type) :: ranks_type
        !> The processes of this rank, and the number of processes of each rank.
        type(processes_type), private :: own
        integer, private :: jobs = 1, ranks = 1
        !> The last message: words, of which the first `taken` are processed, and its sender.
        integer(long), allocatable, private :: words(:)
        integer, private :: n = 0, taken = 0, sender = 0
        integer, private :: words_of_event = 0
    contains
        procedure :: prepare
        procedure :: size => count_workers
        procedure :: start
        procedure :: assign
        procedure :: next
        procedure :: end_worker
        procedure :: dismiss
        procedure :: delay => delay_of_ranks
        procedure, private :: unpack_event
    end type ranks_type

contains

    !> Create the team of rank 0.
    subroutine prepare(self, runner, jobs, words_of_event)
        class(ranks_type), intent(inout) :: self
        !> Prepared; must outlive the team.
        type(case_runner_type), intent(in), target :: runner
        !> Processes of each rank, and most words of an event.
        integer, intent(in) :: jobs, words_of_event

        self%jobs = jobs
        self%words_of_event = words_of_event
        call mpi_comm_size(mpi_comm_world, self%ranks)
        call self%own%prepare(runner, jobs)
        allocate (self%words(most_words + words_of_event))
    end subroutine prepare

    !> Number of workers on all ranks.
    integer function count_workers(self)
        class(ranks_type), intent(in) :: self

        count_workers = self%ranks*self%jobs
    end function count_workers

    !> Start a worker.
    subroutine start(self, worker, error)
        class(ranks_type), intent(inout) :: self
        integer, intent(in) :: worker
        type(error_type), allocatable, intent(out) :: error

        if (worker <= self%jobs) then
            call self%own%start(worker, error)
        else
            call tell_rank(self%jobs, worker, to_start, [0_long, 0_long])
        end if
    end subroutine start

    !> Give a worker cases in addition to its earlier ones.
    subroutine assign(self, worker, first, last)
        class(ranks_type), intent(inout) :: self
        integer, intent(in) :: worker
        integer(long), intent(in) :: first, last

        if (worker <= self%jobs) then
            call self%own%assign(worker, first, last)
        else
            call tell_rank(self%jobs, worker, to_give, [first, last])
        end if
    end subroutine assign

    !> End a worker that does not return.
    subroutine end_worker(self, worker)
        class(ranks_type), intent(inout) :: self
        integer, intent(in) :: worker

        if (worker <= self%jobs) then
            call self%own%end_worker(worker)
        else
            call tell_rank(self%jobs, worker, to_end, [0_long, 0_long])
        end if
    end subroutine end_worker

    !> Largest delay of reports to rank 0, in seconds.
    pure real(wp) function delay_of_ranks(self) result(delay)
        class(ranks_type), intent(in) :: self

        delay = merge(gathering*self%ranks, 0.0_wp, self%ranks > 1)
    end function delay_of_ranks

    !> Send an instruction to the rank of a worker.
    subroutine tell_rank(jobs, worker, what, range)
        integer, intent(in) :: jobs, worker, what
        integer(long), intent(in) :: range(2)
        integer(long) :: words(3)

        words = [int(1 + mod(worker - 1, jobs), long), range]
        call mpi_send(words, 3, mpi_integer8, (worker - 1)/jobs, what, mpi_comm_world)
    end subroutine tell_rank

    !> The next event of a worker.
    subroutine next(self, milliseconds, event)
        class(ranks_type), intent(inout) :: self
        integer, intent(in) :: milliseconds
        type(event_type), intent(inout) :: event
        type(mpi_status) :: status
        logical :: is_there
        integer :: waited

        waited = 0
        do
            call self%unpack_event(event)
            if (event%kind /= event_none) return
            call mpi_iprobe(mpi_any_source, told, mpi_comm_world, is_there, status)
            if (is_there) then
                call mpi_get_count(status, mpi_integer8, self%n)
                self%sender = status%mpi_source
                self%taken = 0
                call mpi_recv(self%words, self%n, mpi_integer8, self%sender, told, mpi_comm_world, status)
                cycle
            end if
            ! MPI would wait with a busy processor, which is needed for the cases.
            call self%own%next(merge(sleep, 0, waited < milliseconds), event)
            if (event%kind /= event_none .or. waited >= milliseconds) return
            waited = waited + sleep
        end do
    end subroutine next

    !> The next event of the last message.
    subroutine unpack_event(self, event)
        class(ranks_type), intent(inout) :: self
        type(event_type), intent(inout) :: event

        event%kind = event_none
        if (self%taken >= self%n) return
        event%kind = int(self%words(self%taken + 1))
        event%worker = self%sender*self%jobs + int(self%words(self%taken + 2))
        event%n = int(self%words(self%taken + 3))
        if (.not. allocated(event%words)) allocate (event%words(self%words_of_event))
        event%words(:event%n) = self%words(self%taken + head + 1:self%taken + head + event%n)
        self%taken = self%taken + head + event%n
    end subroutine unpack_event

    !> Send all workers home.
    subroutine dismiss(self)
        class(ranks_type), intent(inout) :: self
        type(mpi_status) :: status
        integer(long) :: from, now, rate
        logical :: is_there
        integer :: rank, left, n

        call self%own%dismiss()
        do rank = 1, self%ranks - 1
            call tell_rank(1, rank + 1, to_leave, [0_long, 0_long])
        end do
        ! A rank may be about to send a report: it leaves with an empty message, unless it is dead.
        left = 1
        call system_clock(from, rate)
        now = from
        do while (left < self%ranks .and. now - from < longest*rate)
            call mpi_iprobe(mpi_any_source, told, mpi_comm_world, is_there, status)
            if (is_there) then
                call mpi_get_count(status, mpi_integer8, n)
                call mpi_recv(self%words, n, mpi_integer8, status%mpi_source, told, mpi_comm_world, status)
                if (n == 0) left = left + 1
            else
                call sleep_for(sleep)
            end if
            call system_clock(now)
        end do
    end subroutine dismiss

    !> Loop of the other ranks: pass messages of rank 0 to their processes, and reports of these to rank 0, until they may leave.
    subroutine relay(runner, jobs, words_of_event, error)
        type(case_runner_type), intent(in), target :: runner
        integer, intent(in) :: jobs, words_of_event
        !> No process could be started.
        type(error_type), allocatable, intent(out) :: error
        type(processes_type) :: own
        type(event_type) :: event
        type(mpi_status) :: status
        integer(long), allocatable :: words(:)
        integer(long) :: order(3), left, now, rate, since
        logical :: is_there, is_urgent
        integer :: n, ranks

        allocate (words(most_words + words_of_event))
        call own%prepare(runner, jobs)
        call mpi_comm_size(mpi_comm_world, ranks)
        left = 0
        n = 0
        is_urgent = .false.
        call system_clock(since, rate)
        do
            do
                call mpi_iprobe(0, mpi_any_tag, mpi_comm_world, is_there, status)
                if (.not. is_there) exit
                call mpi_recv(order, 3, mpi_integer8, 0, mpi_any_tag, mpi_comm_world, status)
                select case (status%mpi_tag)
                case (to_start)
                    call own%start(int(order(1)), error)
                    if (allocated(error)) return
                case (to_give)
                    call own%assign(int(order(1)), order(2), order(3))
                    left = left + order(3) - order(2) + 1
                case (to_end)
                    call own%end_worker(int(order(1)))
                case default
                    call own%dismiss()
                    call mpi_send(words, 0, mpi_integer8, 0, told, mpi_comm_world)
                    return
                end select
            end do
            call own%next(sleep, event)
            do while (event%kind /= event_none)
                if (n == 0) call system_clock(since)
                is_urgent = is_urgent .or. event%kind == event_loss
                left = left - 1
                words(n + 1:n + head) = [int(event%kind, long), int(event%worker, long), int(event%n, long)]
                words(n + head + 1:n + head + event%n) = event%words(:event%n)
                n = n + head + event%n
                if (n > most_words - head) exit
                call own%next(0, event)
            end do
            if (n == 0) cycle
            call system_clock(now)
            ! Immediately if a process waits for cases, or is lost.
            if (.not. (is_urgent .or. left <= 0 .or. n > most_words/2) .and. &
                real(now - since, wp) < gathering*real(ranks, wp)*real(rate, wp)) cycle
            call mpi_send(words, n, mpi_integer8, 0, told, mpi_comm_world)
            n = 0
            is_urgent = .false.
        end do
    end subroutine relay
end module tandem_mpi_ranks
