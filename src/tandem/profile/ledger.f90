! SPDX-License-Identifier: MIT
!> Where the time of a run goes: every moment belongs to one part, the innermost that was entered and not left.
!>
!> The clock is read once where a part is entered and once where it is left, so that the times of all parts sum to that of the
!> whole. A reading costs some 20 to 60 ns, as much as a small part of a step, and is booked on both sides of it: what an
!> empty part shows on either side is measured in a loop, and taken off for each call. In a run it costs more, because it keeps the
!> processor from looking ahead: `compare` finds how much from a run with clocks and the same without them.
!>
!> A run that is to be timed has this as the timer of its model (`model%timer`), its chart is a `profiled_chart_type`, and its
!> observers are wrapped (`profiled_observer_type`). Others pay nothing.
module tandem_profile_ledger
    use tandem_kinds, only: long, wp
    use tandem_model_timer, only: timer_type
    use tandem_profile_parts, only: n_parts, part_control, part_open, part_rows, part_single, part_watch
    implicit none (type, external)
    private

    public :: profile_type, mark_type

    !> What `leave` must know of `enter`.
    type :: mark_type
        private
        !> The part that was left, when, and how many parts had been left by then.
        integer :: before = part_control, part = part_control
        integer(long) :: since = 0, pairs = 0
    end type mark_type

    !> The times and calls of a run, from `begin` to `finish`.
    type, extends(timer_type) :: profile_type
        !> How often each part was entered.
        integer(long) :: calls(n_parts) = 0
        !> Seconds that an empty part shows itself, and that it adds to the part around it: what is taken off for each.
        real(wp) :: cost_within = 0.0_wp, cost_around = 0.0_wp
        !> Both together, measured in a loop.
        real(wp) :: cost_in_loop = 0.0_wp
        !> Seconds of the two runs of `compare`, with clocks and without; 0 where there were none.
        real(wp) :: clocked = 0.0_wp, plain = 0.0_wp
        !> How often a part was left: each time the clock was read twice.
        integer(long) :: pairs = 0
        !> Seconds from `begin` to `finish`, clocks included, and how many of them the processor has worked for this process.
        real(wp) :: measured = 0.0_wp, processor = 0.0_wp
        !> Ticks of the clock in each part without the parts within, and with them; parts entered from it, and pairs within.
        integer(long), private :: ticks(n_parts) = 0, whole(n_parts) = 0, entered(n_parts) = 0, within(n_parts) = 0
        integer, private :: current = part_control
        integer(long), private :: since = 0, rate = 1
        real(wp), private :: processor_from = 0.0_wp
        !> Whether a procedure of the model is being called, and what to leave then.
        logical, private :: is_in_call = .false.
        type(mark_type), private :: call_mark
    contains
        procedure :: begin, enter, leave, begin_call, end_call, finish, compare
        procedure :: seconds, whole_seconds, total, output_seconds, bare_seconds, clock_seconds
        procedure, private :: start_clock
    end type profile_type

contains

    !> Start anew, with the part `part_control`; measures first what the clock costs, which takes some milliseconds.
    subroutine begin(self)
        class(profile_type), intent(inout) :: self
        !> Parts in a batch; the cheapest batch counts, because others work on the machine.
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

    !> Forget all and look at the clock.
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
        call cpu_time(self%processor_from)
        call system_clock(self%since, self%rate)
    end subroutine start_clock

    !> Enter a part.
    subroutine enter(self, part, mark)
        class(profile_type), intent(inout) :: self
        !> Its number.
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

    !> Leave the part that was entered with this mark.
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

    !> Enter the part that a procedure of the model is, from another one perhaps.
    subroutine begin_call(self, number)
        class(profile_type), intent(inout) :: self
        integer, intent(in) :: number

        call self%end_call()
        call self%enter(part_single + number, self%call_mark)
        self%is_in_call = .true.
    end subroutine begin_call

    !> Leave the model.
    subroutine end_call(self)
        class(profile_type), intent(inout) :: self

        if (self%is_in_call) call self%leave(self%call_mark)
        self%is_in_call = .false.
    end subroutine end_call

    !> The end of what is measured.
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

    !> Take off for the clock what it has cost in another run, but not less than it costs in a loop, nor more than `most` times as
    !> much: beyond that, one of the two was disturbed.
    subroutine compare(self, clocked, plain, pairs)
        class(profile_type), intent(inout) :: self
        !> Seconds of that run with clocks and without.
        real(wp), intent(in) :: clocked, plain
        !> How often parts were left in it.
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

    !> Seconds of a part, those of the parts within left out, and the clock's too. Below zero where that is more than was measured:
    !> the part then takes less than can be told.
    pure real(wp) function seconds(self, part)
        class(profile_type), intent(in) :: self
        !> Its number.
        integer, intent(in) :: part

        seconds = real(self%ticks(part), wp)/real(self%rate, wp) - self%cost_within*real(self%calls(part), wp) - &
            self%cost_around*real(self%entered(part), wp)
    end function seconds

    !> Seconds of a part with all parts within, without the clock's.
    pure real(wp) function whole_seconds(self, part)
        class(profile_type), intent(in) :: self
        !> Its number.
        integer, intent(in) :: part

        whole_seconds = real(self%whole(part), wp)/real(self%rate, wp) - self%cost_within*real(self%calls(part), wp) - &
            (self%cost_within + self%cost_around)*real(self%within(part), wp)
    end function whole_seconds

    !> Seconds of all parts, the run without the clock's.
    pure real(wp) function total(self)
        class(profile_type), intent(in) :: self

        total = self%measured - self%clock_seconds()
    end function total

    !> Seconds that the run would not have taken without output, what the model and the chart did for it included.
    pure real(wp) function output_seconds(self)
        class(profile_type), intent(in) :: self

        ! Whatever else belongs to output lies within these two.
        output_seconds = self%whole_seconds(part_rows) + self%whole_seconds(part_open)
    end function output_seconds

    !> Seconds of all parts but output and watching.
    pure real(wp) function bare_seconds(self)
        class(profile_type), intent(in) :: self

        bare_seconds = self%total() - self%output_seconds() - self%whole_seconds(part_watch)
    end function bare_seconds

    !> Seconds that were taken off for the clock.
    pure real(wp) function clock_seconds(self)
        class(profile_type), intent(in) :: self

        clock_seconds = (self%cost_within + self%cost_around)*real(self%pairs, wp)
    end function clock_seconds
end module tandem_profile_ledger
