! SPDX-License-Identifier: MIT
!> Time measurement of a run. At any moment, time is attributed to one part: the innermost part that has been entered and not left.
!>
!> The clock is read once when a part is entered and once when it is left, so that the times of all parts add up to the total.
!> Reading it takes about 20 to 60 ns, as much as a small part of a step, and affects both the part and the enclosing part. The time
!> attributed to each of them for an empty part is measured in a loop, and is subtracted per call. It is larger during a run,
!> because reading the clock restricts out-of-order execution; `compare` determines the difference from runs with and without
!> clocks.
!>
!> For a measured run, an object of this type is the timer of the model (`model%state%timer`), which its chart uses too, and
!> observers are wrapped (`profiled_observer_type`).
module tandem_profile_ledger
    use tandem_kinds, only: long, wp
    use tandem_model_timer, only: timer_type
    use tandem_profile_parts, only: n_parts, part_chart, part_control, part_open, part_rows, part_single, part_watch
    implicit none (type, external)
    private

    public :: profile_type, mark_type

    !> Data that `enter` stores for `leave`.
    type :: mark_type
        private
        !> Enclosing part; the part itself; number of parts left before it was entered.
        integer :: before = part_control, part = part_control
        integer(long) :: since = 0, pairs = 0
    end type mark_type

    !> Largest depth of nested operations of a chart.
    integer, parameter :: max_depth = 8

    !> Times and calls of the parts of a run, from `begin` to `finish`.
    type, extends(timer_type) :: profile_type
        !> Number of times each part was entered.
        integer(long) :: calls(n_parts) = 0
        !> Time of an empty part (s) that is attributed to the part itself and to the enclosing part. Both are subtracted per call.
        real(wp) :: cost_within = 0.0_wp, cost_around = 0.0_wp
        !> Sum of both times, as measured in a loop.
        real(wp) :: cost_in_loop = 0.0_wp
        !> Durations of the two runs of `compare` (s), with and without clocks; 0 without such runs.
        real(wp) :: clocked = 0.0_wp, plain = 0.0_wp
        !> Number of parts left; the clock is read twice for each.
        integer(long) :: pairs = 0
        !> Wall time from `begin` to `finish` (s), including the reading of the clock; processor time of the process in this
        !> interval (s).
        real(wp) :: measured = 0.0_wp, processor = 0.0_wp
        !> Clock ticks in each part, excluding and including inner parts; number of parts entered directly from it; number of parts
        !> left within it.
        integer(long), private :: ticks(n_parts) = 0, whole(n_parts) = 0, entered(n_parts) = 0, within(n_parts) = 0
        integer, private :: current = part_control
        integer(long), private :: since = 0, rate = 1
        real(wp), private :: processor_from = 0.0_wp
        !> True during a call of a procedure of the model; mark for leaving it.
        logical, private :: is_in_call = .false.
        type(mark_type), private :: call_mark
        !> Marks of operations that have begun and not ended; their number.
        type(mark_type), private :: operation_mark(max_depth)
        integer, private :: depth = 0
    contains
        procedure :: begin, enter, leave, begin_call, end_call, begin_operation, end_operation, finish, compare
        procedure :: seconds, whole_seconds, total, output_seconds, bare_seconds, clock_seconds
        procedure, private :: start_clock
    end type profile_type

contains

    !> Begin a measurement in the part `part_control`. The cost of reading the clock is measured first, which takes some
    !> milliseconds.
    subroutine begin(self)
        class(profile_type), intent(inout) :: self
        !> Number of parts per batch; number of batches. The fastest batch is used, because other processes may slow down the
        !> machine.
        integer, parameter :: batch = 2000, n_batches = 11
        type(profile_type) :: trial
        type(mark_type) :: mark
        integer :: i, k

        self%cost_within = huge(1.0_wp)
        self%cost_around = huge(1.0_wp)
        do k = 1, n_batches
            call trial%start_clock()
            do i = 1, batch
                call trial%enter(part_rows, mark)
                call trial%leave(mark)
            end do
            self%cost_within = min(self%cost_within, real(trial%ticks(part_rows), wp)/(real(trial%rate, wp)*batch))
            self%cost_around = min(self%cost_around, real(trial%ticks(part_control), wp)/(real(trial%rate, wp)*batch))
        end do
        self%cost_in_loop = self%cost_within + self%cost_around
        self%clocked = 0.0_wp
        self%plain = 0.0_wp
        call self%start_clock()
    end subroutine begin

    !> Reset all counters and read the clock.
    subroutine start_clock(self)
        class(profile_type), intent(inout) :: self

        self%calls = 0
        self%ticks = 0
        self%whole = 0
        self%entered = 0
        self%within = 0
        self%pairs = 0
        self%measured = 0.0_wp
        self%processor = 0.0_wp
        self%current = part_control
        self%is_in_call = .false.
        self%depth = 0
        call cpu_time(self%processor_from)
        call system_clock(self%since, self%rate)
    end subroutine start_clock

    !> Enter a part.
    subroutine enter(self, part, mark)
        class(profile_type), intent(inout) :: self
        !> Index of the part.
        integer, intent(in) :: part
        !> Mark for `leave`.
        type(mark_type), intent(out) :: mark
        integer(long) :: now

        call system_clock(now)
        self%ticks(self%current) = self%ticks(self%current) + (now - self%since)
        self%entered(self%current) = self%entered(self%current) + 1
        self%calls(part) = self%calls(part) + 1
        mark%before = self%current
        mark%part = part
        mark%since = now
        mark%pairs = self%pairs
        self%current = part
        self%since = now
    end subroutine enter

    !> Leave the part that was entered with the given mark.
    subroutine leave(self, mark)
        class(profile_type), intent(inout) :: self
        type(mark_type), intent(in) :: mark
        integer(long) :: now

        call system_clock(now)
        self%ticks(self%current) = self%ticks(self%current) + (now - self%since)
        self%whole(mark%part) = self%whole(mark%part) + (now - mark%since)
        self%within(mark%part) = self%within(mark%part) + (self%pairs - mark%pairs)
        self%pairs = self%pairs + 1
        self%current = mark%before
        self%since = now
    end subroutine leave

    !> Enter the part of a procedure of the model, possibly directly from another one.
    subroutine begin_call(self, number)
        class(profile_type), intent(inout) :: self
        integer, intent(in) :: number

        call self%end_call()
        call self%enter(part_single + number, self%call_mark)
        self%is_in_call = .true.
    end subroutine begin_call

    !> Leave the part of the procedure of the model.
    subroutine end_call(self)
        class(profile_type), intent(inout) :: self

        if (self%is_in_call) call self%leave(self%call_mark)
        self%is_in_call = .false.
    end subroutine end_call

    !> Enter the part of an operation of a chart.
    subroutine begin_operation(self, number)
        class(profile_type), intent(inout) :: self
        integer, intent(in) :: number

        self%depth = self%depth + 1
        if (self%depth <= max_depth) call self%enter(part_chart + number, self%operation_mark(self%depth))
    end subroutine begin_operation

    !> Leave the part of the operation that began last.
    subroutine end_operation(self)
        class(profile_type), intent(inout) :: self

        if (self%depth <= max_depth) call self%leave(self%operation_mark(self%depth))
        self%depth = self%depth - 1
    end subroutine end_operation

    !> End the measurement.
    subroutine finish(self)
        class(profile_type), intent(inout) :: self
        integer(long) :: now
        real(wp) :: processor

        call system_clock(now)
        call cpu_time(processor)
        self%processor = processor - self%processor_from
        self%ticks(self%current) = self%ticks(self%current) + (now - self%since)
        self%since = now
        self%measured = real(sum(self%ticks), wp)/real(self%rate, wp)
    end subroutine finish

    !> Set the cost of reading the clock from a comparison with another run. It is limited to between its value in a loop and `most`
    !> times this value; outside of these limits one of the runs was disturbed.
    subroutine compare(self, clocked, plain, pairs)
        class(profile_type), intent(inout) :: self
        !> Durations of this run with and without clocks (s).
        real(wp), intent(in) :: clocked, plain
        !> Number of parts left in the run.
        integer(long), intent(in) :: pairs
        real(wp), parameter :: most = 3.0_wp
        real(wp) :: factor

        self%clocked = clocked
        self%plain = plain
        if (pairs == 0) return
        factor = (clocked - plain)/(real(pairs, wp)*self%cost_in_loop)
        factor = min(max(factor, 1.0_wp), most)*self%cost_in_loop/(self%cost_within + self%cost_around)
        self%cost_within = factor*self%cost_within
        self%cost_around = factor*self%cost_around
    end subroutine compare

    !> Time of a part (s), excluding inner parts and the reading of the clock. Negative values mean that the part is too short to be
    !> measured.
    pure real(wp) function seconds(self, part)
        class(profile_type), intent(in) :: self
        !> Index of the part.
        integer, intent(in) :: part

        seconds = real(self%ticks(part), wp)/real(self%rate, wp) - self%cost_within*real(self%calls(part), wp) - &
            self%cost_around*real(self%entered(part), wp)
    end function seconds

    !> Time of a part (s), including inner parts and excluding the reading of the clock.
    pure real(wp) function whole_seconds(self, part)
        class(profile_type), intent(in) :: self
        !> Index of the part.
        integer, intent(in) :: part

        whole_seconds = real(self%whole(part), wp)/real(self%rate, wp) - self%cost_within*real(self%calls(part), wp) - &
            (self%cost_within + self%cost_around)*real(self%within(part), wp)
    end function whole_seconds

    !> Total time of all parts (s): the duration of the run without clocks.
    pure real(wp) function total(self)
        class(profile_type), intent(in) :: self

        total = self%measured - self%clock_seconds()
    end function total

    !> Additional time of a run due to output (s), including the evaluations of the model and the chart for it.
    pure real(wp) function output_seconds(self)
        class(profile_type), intent(in) :: self

        ! All other parts of output are entered from these two.
        output_seconds = self%whole_seconds(part_rows) + self%whole_seconds(part_open)
    end function output_seconds

    !> Time of all parts (s) except output and observers.
    pure real(wp) function bare_seconds(self)
        class(profile_type), intent(in) :: self

        bare_seconds = self%total() - self%output_seconds() - self%whole_seconds(part_watch)
    end function bare_seconds

    !> Time that is subtracted for reading the clock (s).
    pure real(wp) function clock_seconds(self)
        class(profile_type), intent(in) :: self

        clock_seconds = (self%cost_within + self%cost_around)*real(self%pairs, wp)
    end function clock_seconds
end module tandem_profile_ledger
