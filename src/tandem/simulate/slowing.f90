! SPDX-License-Identifier: MIT
!> Detects steps that shrink towards a time that they never reach, for example if a rate grows without bound: the time covered by
!> doubled numbers of tries falls repeatedly.
module tandem_simulate_slowing
    use tandem_kinds, only: wp
    use tandem_pack, only: pack_type
    implicit none (type, external)
    private

    public :: slowing_type

    !> Tries of the first span. Each span has as many tries as all before it. A span that is shorter than the previous one by the
    !> factor `shorter` counts, one that is longer by `longer` restarts the count.
    integer, parameter :: first_tries = 250
    real(wp), parameter :: shorter = 0.75_wp, longer = 1.5_wp
    !> Number of successive shorter spans which shows that times converge. For a motion whose rate grows exponentially, spans have
    !> equal lengths.
    integer, parameter :: enough = 4

    !> Spans of the tries of steps.
    type :: slowing_type
        integer, private :: tries = 0, mark = first_tries, n_shorter = 0
        real(wp), private :: from = 0.0_wp, span = 0.0_wp, ratio = 1.0_wp
    contains
        procedure :: observe, restart, find_end, pack_state
    end type slowing_type

contains

    !> Count a try at a time.
    pure subroutine observe(self, t)
        class(slowing_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp) :: span

        self%tries = self%tries + 1
        if (self%tries < self%mark) return
        if (self%mark > first_tries) then
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
            if (self%tries > 0) self%span = span
        end if
        self%from = t
        self%mark = 2*max(self%tries, first_tries/2)
    end subroutine observe

    !> Restart the count.
    pure subroutine restart(self)
        class(slowing_type), intent(inout) :: self

        self%tries = 0
        self%mark = first_tries
        self%n_shorter = 0
        self%span = 0.0_wp
    end subroutine restart

    !> The time that steps converge to, if they do.
    pure subroutine find_end(self, t, t_end, converges)
        class(slowing_type), intent(in) :: self
        !> The current time.
        real(wp), intent(in) :: t
        !> The sum of all spans to come, as a geometric series; huge if it diverges.
        real(wp), intent(out) :: t_end
        logical, intent(out) :: converges

        converges = self%n_shorter >= enough
        t_end = huge(t_end)
        if (converges) t_end = t + self%span*self%ratio/(1 - self%ratio)
    end subroutine find_end

    !> All components.
    subroutine pack_state(self, pack)
        class(slowing_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%tries)
        call pack%item(self%mark)
        call pack%item(self%n_shorter)
        call pack%item(self%from, self%span)
        call pack%item(self%ratio)
    end subroutine pack_state
end module tandem_simulate_slowing
