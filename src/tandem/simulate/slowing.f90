! SPDX-License-Identifier: MIT
!> Detects step sizes that shrink towards a time that is never reached, for example because a rate grows without bound: the time
!> covered by successive spans of step attempts decreases repeatedly.
module tandem_simulate_slowing
    use tandem_kinds, only: wp
    use tandem_pack, only: pack_type
    implicit none (type, external)
    private

    public :: slowing_type

    !> Number of attempts in the first span; each later span contains as many attempts as all spans before it. Ratios of the
    !> durations of successive spans: one below `shorter` is counted, one above `longer` restarts the count.
    integer, parameter :: first_attempts = 250
    real(wp), parameter :: shorter = 0.75_wp, longer = 1.5_wp
    !> Number of successive shorter spans that shows convergence. Spans have equal durations if a rate grows exponentially.
    integer, parameter :: enough = 4

    !> Durations of the spans of step attempts.
    type :: slowing_type
        integer, private :: attempts = 0, mark = first_attempts, n_shorter = 0
        real(wp), private :: from = 0.0_wp, span = 0.0_wp, ratio = 1.0_wp
    contains
        procedure :: observe, restart, find_end, pack_state
    end type slowing_type

contains

    !> Count an attempt that begins at a time.
    pure subroutine observe(self, t)
        class(slowing_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp) :: span

        self%attempts = self%attempts + 1
        if (self%attempts < self%mark) return
        if (self%mark > first_attempts) then
            span = t - self%from
            if (self%span > 0.0_wp) then
                self%ratio = span/self%span
                if (self%ratio > longer) then
                    call self%restart()
                else if (self%ratio < shorter) then
                    self%n_shorter = self%n_shorter + 1
                else
                    self%n_shorter = 0
                end if
            end if
            if (self%attempts > 0) self%span = span
        end if
        self%from = t
        self%mark = 2*max(self%attempts, first_attempts/2)
    end subroutine observe

    !> Restart the count.
    pure subroutine restart(self)
        class(slowing_type), intent(inout) :: self

        self%attempts = 0
        self%mark = first_attempts
        self%n_shorter = 0
        self%span = 0.0_wp
    end subroutine restart

    !> Time to which the steps converge, if they do.
    pure subroutine find_end(self, t, t_end, converges)
        class(slowing_type), intent(in) :: self
        !> The current time.
        real(wp), intent(in) :: t
        !> Sum of all further spans as a geometric series, added to the current time; huge if it diverges.
        real(wp), intent(out) :: t_end
        logical, intent(out) :: converges

        converges = self%n_shorter >= enough
        t_end = huge(t_end)
        if (converges) t_end = t + self%span*self%ratio/(1 - self%ratio)
    end subroutine find_end

    !> Pack all components.
    subroutine pack_state(self, pack)
        class(slowing_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%attempts)
        call pack%item(self%mark)
        call pack%item(self%n_shorter)
        call pack%item(self%from, self%span)
        call pack%item(self%ratio)
    end subroutine pack_state
end module tandem_simulate_slowing
