! SPDX-License-Identifier: MIT
!> A team of worker processes on this machine, which are copies of this process (processes.c). A case that crashes its process does
!> not affect the other workers.
module tandem_io_sweep_processes
    use tandem, only: error_type, long, set_error, status_output_failed
    use tandem_io_sweep_case, only: case_runner_type
    use tandem_io_sweep_record, only: record_type, words_of_record
    use tandem_io_sweep_team, only: event_loss, event_record, event_type, event_none, team_type
    use, intrinsic :: iso_c_binding, only: c_int, c_int64_t, c_loc, c_ptr
    implicit none (type, external)
    private

    public :: processes_type, cores, sleep_for

    !> Number of records in the buffer of a worker.
    integer, parameter :: records_kept = 512

    !> A worker process.
    type :: process_type
        integer(c_int) :: number = -1
        !> Received data: the words, the number of bytes received, and the number of words already processed. The last record may be
        !> incomplete.
        integer(long), allocatable :: words(:)
        integer(c_int64_t) :: bytes = 0
        integer :: taken = 0
    end type process_type

    type, extends(team_type) :: processes_type
        !> Object of the caller that runs the cases.
        type(case_runner_type), pointer :: runner => null()
        type(process_type), allocatable, private :: workers(:)
        !> This process's socket for each worker; -1 if the worker is not running.
        integer(c_int), allocatable, private :: ends(:)
        !> Worker from which the search for events starts.
        integer, private :: current = 0
    contains
        procedure :: prepare, size => count_workers, start, assign, next, end_worker, dismiss
        procedure, private :: receive_record
    end type processes_type

    interface
        function c_start(others, n, end) result(process) bind(c, name='tandem_process_start')
            import :: c_int
            implicit none (type, external)
            integer(c_int), intent(in) :: others(*)
            integer(c_int), value :: n
            integer(c_int), intent(out) :: end
            integer(c_int) :: process
        end function c_start

        subroutine c_leave() bind(c, name='tandem_process_leave')
        end subroutine c_leave

        function c_send(end, words, n) result(stat) bind(c, name='tandem_process_send')
            import :: c_int, c_int64_t
            implicit none (type, external)
            integer(c_int), value :: end
            integer(c_int64_t), intent(in) :: words(*)
            integer(c_int64_t), value :: n
            integer(c_int) :: stat
        end function c_send

        function c_receive(end, words, n) result(stat) bind(c, name='tandem_process_receive')
            import :: c_int, c_int64_t
            implicit none (type, external)
            integer(c_int), value :: end
            integer(c_int64_t), intent(inout) :: words(*)
            integer(c_int64_t), value :: n
            integer(c_int) :: stat
        end function c_receive

        function c_take(end, room, have, size) result(bytes) bind(c, name='tandem_process_take')
            import :: c_int, c_int64_t
            implicit none (type, external)
            integer(c_int), value :: end
            integer(c_int64_t), intent(inout) :: room(*)
            integer(c_int64_t), value :: have, size
            integer(c_int64_t) :: bytes
        end function c_take

        subroutine c_wait(ends, n, milliseconds) bind(c, name='tandem_process_wait')
            import :: c_int
            implicit none (type, external)
            integer(c_int), intent(in) :: ends(*)
            integer(c_int), value :: n, milliseconds
        end subroutine c_wait

        function c_end(process, end, kills) result(signal) bind(c, name='tandem_process_end')
            import :: c_int
            implicit none (type, external)
            integer(c_int), value :: process, end, kills
            integer(c_int) :: signal
        end function c_end

        function c_cores() result(n) bind(c, name='tandem_process_cores')
            import :: c_int
            implicit none (type, external)
            integer(c_int) :: n
        end function c_cores
    end interface

contains

    !> Number of processors available to this process.
    integer function cores()
        cores = int(c_cores())
    end function cores

    !> Sleep for a number of milliseconds.
    subroutine sleep_for(milliseconds)
        integer, intent(in) :: milliseconds

        call c_wait([0_c_int], 0_c_int, int(milliseconds, c_int))
    end subroutine sleep_for

    !> Define a team; no worker is started.
    subroutine prepare(self, runner, workers)
        class(processes_type), intent(inout) :: self
        !> Must be prepared, and must outlive the team.
        type(case_runner_type), intent(in), target :: runner
        integer, intent(in) :: workers
        integer :: i

        self%runner => runner
        allocate (self%workers(workers))
        allocate (self%ends(workers), source=-1_c_int)
        do i = 1, workers
            allocate (self%workers(i)%words(records_kept*(1 + words_of_record(runner%plan%n_outputs()))), source=0_long)
        end do
    end subroutine prepare

    !> Number of workers.
    integer function count_workers(self)
        class(processes_type), intent(in) :: self

        count_workers = size(self%workers)
    end function count_workers

    !> Start a worker. In the worker process this call does not return.
    subroutine start(self, worker, error)
        class(processes_type), intent(inout) :: self
        integer, intent(in) :: worker
        type(error_type), allocatable, intent(out) :: error
        integer(c_int) :: end

        ! A worker reported as lost may still be running.
        call self%end_worker(worker)
        associate (process => self%workers(worker))
            process%bytes = 0
            process%taken = 0
            process%number = c_start(self%ends, size(self%ends, kind=c_int), end)
            if (process%number == 0) then
                call work(self%runner, end)
                call c_leave()
            end if
            if (process%number < 0) then
                call set_error(error, status_output_failed, 'the system cannot start another process', 'request fewer jobs')
                return
            end if
            self%ends(worker) = end
        end associate
    end subroutine start

    !> Main loop of a worker: run cases until the socket is closed.
    subroutine work(runner, end)
        type(case_runner_type), intent(inout) :: runner
        integer(c_int), intent(in) :: end
        type(record_type) :: record
        integer(c_int64_t) :: range(2), frame(1 + words_of_record(runner%plan%n_outputs()))
        integer(long) :: case
        integer :: n

        do
            if (c_receive(end, range, 2_c_int64_t) /= 0) return
            do case = range(1), range(2)
                call runner%run(case, record)
                call record%to_words(frame(2:), n)
                frame(1) = n
                if (c_send(end, frame, int(n + 1, c_int64_t)) /= 0) return
            end do
        end do
    end subroutine work

    !> Append a range of cases to the work of a worker.
    subroutine assign(self, worker, first, last)
        class(processes_type), intent(inout) :: self
        integer, intent(in) :: worker
        integer(long), intent(in) :: first, last
        integer(c_int) :: stat

        ! A failure means that the worker has ended; `next` reports this.
        stat = c_send(self%ends(worker), [int(first, c_int64_t), int(last, c_int64_t)], 2_c_int64_t)
        if (stat /= 0) return
    end subroutine assign

    !> Wait for the next event of any worker.
    subroutine next(self, milliseconds, event)
        class(processes_type), intent(inout) :: self
        integer, intent(in) :: milliseconds
        type(event_type), intent(inout) :: event
        integer :: i, pass

        event%kind = event_none
        do pass = 1, 2
            do i = 1, size(self%workers)
                ! Continue with the same worker as long as it has events.
                associate (worker => 1 + modulo(self%current + i - 2, size(self%workers)))
                    if (self%ends(worker) < 0) cycle
                    call self%receive_record(worker, event)
                    if (event%kind == event_none) cycle
                    self%current = worker
                    return
                end associate
            end do
            if (pass == 1 .and. milliseconds > 0) call c_wait(self%ends, size(self%ends, kind=c_int), &
                int(milliseconds, c_int))
            if (milliseconds <= 0) return
        end do
    end subroutine next

    !> Receive a record of a worker, or detect its end.
    subroutine receive_record(self, worker, event)
        class(processes_type), intent(inout) :: self
        integer, intent(in) :: worker
        type(event_type), intent(inout) :: event
        integer(c_int64_t) :: got
        integer :: n, attempt

        event%worker = worker
        associate (process => self%workers(worker))
            do attempt = 1, 2
                n = int(process%bytes/8) - process%taken
                if (n > 0) then
                    if (n > process%words(process%taken + 1)) then
                        event%n = int(process%words(process%taken + 1))
                        event%kind = event_record
                        if (.not. allocated(event%words)) allocate (event%words(words_of_record(self%runner%plan%n_outputs())))
                        event%words(:event%n) = process%words(process%taken + 2:process%taken + 1 + event%n)
                        process%taken = process%taken + 1 + event%n
                        return
                    end if
                end if
                if (attempt == 2) return
                ! Move unprocessed words to the beginning of the buffer.
                if (process%taken > 0) then
                    n = int((process%bytes + 7)/8)
                    process%words(:n - process%taken) = process%words(process%taken + 1:n)
                    process%bytes = process%bytes - 8*process%taken
                    process%taken = 0
                end if
                got = c_take(self%ends(worker), process%words, process%bytes, 8_c_int64_t*size(process%words))
                if (got < 0) then
                    event%kind = event_loss
                    event%n = 1
                    if (.not. allocated(event%words)) allocate (event%words(words_of_record(self%runner%plan%n_outputs())))
                    event%words(1) = c_end(process%number, self%ends(worker), 0_c_int)
                    self%ends(worker) = -1
                    return
                end if
                process%bytes = process%bytes + got
                if (got == 0) return
            end do
        end associate
    end subroutine receive_record

    !> Terminate a worker.
    subroutine end_worker(self, worker)
        class(processes_type), intent(inout) :: self
        integer, intent(in) :: worker
        integer(c_int) :: signal

        associate (process => self%workers(worker))
            if (self%ends(worker) < 0) return
            signal = c_end(process%number, self%ends(worker), 1_c_int)
            self%ends(worker) = -1
            if (signal < 0) return
        end associate
    end subroutine end_worker

    !> Terminate all workers.
    subroutine dismiss(self)
        class(processes_type), intent(inout) :: self
        integer :: i

        do i = 1, size(self%workers)
            call self%end_worker(i)
        end do
    end subroutine dismiss
end module tandem_io_sweep_processes
