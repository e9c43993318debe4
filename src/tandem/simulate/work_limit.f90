! SPDX-License-Identifier: MIT
!> Limits on the cost of a run: evaluations of the right-hand side, and wall time. Without limits, nothing is counted and no clock
!> is read.
module tandem_simulate_work_limit
    use tandem_error, only: to_text
    use tandem_kinds, only: long, wp
    use tandem_pack, only: pack_type
    implicit none (type, external)
    private

    public :: work_limit_type

    type :: work_limit_type
        !> True if any limit is set. Call `is_spent` only in this case.
        logical :: is_set = .false.
        integer(long), private :: max_evaluations = 0, clock_start = 0
        real(wp), private :: max_seconds = 0.0_wp
        logical, private :: has_started = .false.
    contains
        procedure :: set, is_spent, describe, pack_state
    end type work_limit_type

contains

    !> Set limits; 0 means unlimited.
    pure subroutine set(self, max_evaluations, max_seconds)
        class(work_limit_type), intent(inout) :: self
        !> Largest number of evaluations of the right-hand side.
        integer, intent(in) :: max_evaluations
        !> Largest wall time (s) since the first call of `is_spent`.
        real(wp), intent(in) :: max_seconds

        self%max_evaluations = int(max_evaluations, long)
        self%max_seconds = max_seconds
        self%is_set = max_evaluations > 0 .or. max_seconds > 0.0_wp
        self%has_started = .false.
    end subroutine set

    !> True if a limit is reached. The first call starts the clock.
    logical function is_spent(self, evaluations)
        class(work_limit_type), intent(inout) :: self
        !> Number of evaluations so far.
        integer(long), intent(in) :: evaluations
        integer(long) :: now, rate

        is_spent = self%max_evaluations > 0 .and. evaluations >= self%max_evaluations
        if (.not. self%max_seconds > 0.0_wp) return
        call system_clock(now, rate)
        if (.not. self%has_started) self%clock_start = now
        self%has_started = .true.
        is_spent = is_spent .or. real(now - self%clock_start, wp) >= self%max_seconds*real(rate, wp)
    end function is_spent

    !> Text about the cost of the run, padded with blanks.
    function describe(self, evaluations) result(text)
        class(work_limit_type), intent(in) :: self
        integer(long), intent(in) :: evaluations
        character(len=64) :: text

        if (self%max_evaluations > 0 .and. evaluations >= self%max_evaluations) then
            text = 'max_evaluations = '//to_text(int(self%max_evaluations))//' is reached'
        else
            text = 'max_seconds = '//to_text(self%max_seconds)//' have passed'
        end if
    end function describe

    !> Pack the elapsed time, because clocks of different processes are unrelated.
    subroutine pack_state(self, pack)
        class(work_limit_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack
        integer(long) :: now, rate
        real(wp) :: seconds

        call system_clock(now, rate)
        seconds = 0.0_wp
        if (self%has_started) seconds = real(now - self%clock_start, wp)/real(rate, wp)
        call pack%item(self%has_started)
        call pack%item(seconds)
        if (pack%is_reading) self%clock_start = now - nint(seconds*real(rate, wp), long)
    end subroutine pack_state
end module tandem_simulate_work_limit
