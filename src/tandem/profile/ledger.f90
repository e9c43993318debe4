! SPDX-License-Identifier: MIT
!> Time measurement of a run: every moment belongs to one part, the innermost one that was entered and not left.
!>
!> The clock is read once when a part is entered and once when it is left, so that the times of all parts sum to the total. A
!> reading takes some 20 to 60 ns, as much as a small part of a step, and counts on both sides of it: the time of an empty part on
!> either side is measured in a loop, and subtracted for each call. In a run it is larger, because it restricts out-of-order
!> execution: `compare` finds the difference from runs with and without clocks.
!>
!> For a measured run this is the timer of the model (`model%state%timer`), which its chart uses too, and observers are wrapped
!> (`profiled_observer_type`).
module tandem_profile_ledger
    use tandem_kinds, only: long, wp
    use tandem_model_timer, only: timer_type
    use tandem_profile_parts, only: n_parts, part_chart, part_control, part_open, part_rows, part_single, part_watch
    implicit none (type, external)
    private

    public :: profile_type, mark_type

    !> Data of `enter` for `leave`.
    type :: mark_type
        private
        !> Part that was left, its time, and number of parts left until then.
        integer :: before = part_control, part = part_control
        integer(long) :: since = 0, pairs = 0
    end type mark_type

    !> Deepest nesting of operations of a chart.
    integer, parameter :: deepest = 8

    !> Times and calls of a run, from `begin` to `finish`.
    type, extends(timer_type) :: profile_type
        !> Number of entries of each part.
        integer(long) :: calls(n_parts) = 0
        !> Time of an empty part (s): counted in the part itself, and in the enclosing part; both are subtracted per call.
        real(wp) :: cost_within = 0.0_wp, cost_around = 0.0_wp
        !> Sum of both, measured in a loop.
        real(wp) :: cost_in_loop = 0.0_wp
        !> Times of the two runs of `compare` (s), with and without clocks; 0 if there were none.
        real(wp) :: clocked = 0.0_wp, plain = 0.0_wp
        !> Number of parts left: the clock is read twice for each.
        integer(long) :: pairs = 0
        !> Wall time from `begin` to `finish` including clocks (s), and processor time of this process in it.
        real(wp) :: measured = 0.0_wp, processor = 0.0_wp
        !> Clock ticks in each part excluding and including inner parts; parts entered from it, and pairs of readings within.
        integer(long), private :: ticks(n_parts) = 0, whole(n_parts) = 0, entered(n_parts) = 0, within(n_parts) = 0
        integer, private :: current = part_control
        integer(long), private :: since = 0, rate = 1
        real(wp), private :: processor_from = 0.0_wp
        !> True during a call of a procedure of the model; mark to leave it.
        logical, private :: is_in_call = .false.
        type(mark_type), private :: call_mark
        !> Marks of the operations that were begun, and their number.
        type(mark_type), private :: operation_mark(deepest)
        integer, private :: depth = 0
    contains
        procedure :: begin, enter, leave, begin_call, end_call, begin_operation, end_operation, finish, compare
        procedure :: seconds, whole_seconds, total, output_seconds, bare_seconds, clock_seconds
        procedure, private :: start_clock
    end type profile_type

contains

    !> Reset, beginning with the part `part_control`; first measures the cost of the clock, which takes some milliseconds.
    subroutine begin(self)
        class(profile_type), intent(inout) :: self
        !> Parts in a batch; the fastest batch is used, because of other load on the machine.
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
        !> For `leave`.
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

    !> Leave the part entered with this mark.
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

    !> Enter the part of a procedure of the model, possibly from that of another one.
    subroutine begin_call(self, number)
        class(profile_type), intent(inout) :: self
        integer, intent(in) :: number

        call self%end_call()
        call self%enter(part_single + number, self%call_mark)
        self%is_in_call = .true.
    end subroutine begin_call

    !> Leave the part of the model.
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
        if (self%depth <= deepest) call self%enter(part_chart + number, self%operation_mark(self%depth))
    end subroutine begin_operation

    !> Leave the part of the last operation.
    subroutine end_operation(self)
        class(profile_type), intent(inout) :: self

        if (self%depth <= deepest) call self%leave(self%operation_mark(self%depth))
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

    !> Set the cost of the clock from another run, at least its cost in a loop and at most `most` times as much: beyond that, one of
    !> the two runs was disturbed.
    subroutine compare(self, clocked, plain, pairs)
        class(profile_type), intent(inout) :: self
        !> Times of this run with and without clocks (s).
        real(wp), intent(in) :: clocked, plain
        !> Number of parts left in it.
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

    !> Time of a part excluding inner parts and the clock (s). Negative if the clock exceeds the measured time: the part is then too
    !> short to be measured.
    pure real(wp) function seconds(self, part)
        class(profile_type), intent(in) :: self
        !> Index of the part.
        integer, intent(in) :: part

        seconds = real(self%ticks(part), wp)/real(self%rate, wp) - self%cost_within*real(self%calls(part), wp) - &
            self%cost_around*real(self%entered(part), wp)
    end function seconds

    !> Time of a part including inner parts, without the clock (s).
    pure real(wp) function whole_seconds(self, part)
        class(profile_type), intent(in) :: self
        !> Index of the part.
        integer, intent(in) :: part

        whole_seconds = real(self%whole(part), wp)/real(self%rate, wp) - self%cost_within*real(self%calls(part), wp) - &
            (self%cost_within + self%cost_around)*real(self%within(part), wp)
    end function whole_seconds

    !> Time of all parts, the run without the clock (s).
    pure real(wp) function total(self)
        class(profile_type), intent(in) :: self

        total = self%measured - self%clock_seconds()
    end function total

    !> Additional time of a run due to output (s), including calls of the model and the chart for it.
    pure real(wp) function output_seconds(self)
        class(profile_type), intent(in) :: self

        ! All other parts of output are within these two.
        output_seconds = self%whole_seconds(part_rows) + self%whole_seconds(part_open)
    end function output_seconds

    !> Time of all parts except output and watching (s).
    pure real(wp) function bare_seconds(self)
        class(profile_type), intent(in) :: self

        bare_seconds = self%total() - self%output_seconds() - self%whole_seconds(part_watch)
    end function bare_seconds

    !> Time subtracted for the clock (s).
    pure real(wp) function clock_seconds(self)
        class(profile_type), intent(in) :: self

        clock_seconds = (self%cost_within + self%cost_around)*real(self%pairs, wp)
    end function clock_seconds
end module tandem_profile_ledger
