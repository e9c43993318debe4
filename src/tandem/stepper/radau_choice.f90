! SPDX-License-Identifier: MIT
!> How many stages a step of Radau IIA should have: as many as make the work a unit of time the least.
!>
!> The work is that of Newton's iteration, stages times corrections. How long steps are with another number of stages s, the error
!> tells that the last step would have had with it, which goes with the power s + 1 of the step; how many corrections they take, how
!> well the iteration contracts, which goes with the step. More stages pay where steps are small for the sake of a tight tolerance,
!> and the matrix serves longer ones well. What was foretold so is compared with what came of it, and the next time it is known how
!> far such promises can be trusted.
module tandem_stepper_radau_choice
    use tandem_kinds, only: wp
    use tandem_pack, only: pack_type
    implicit none (type, external)
    private

    public :: choice_type

    type :: choice_type
        !> How long the next step may be, as fewer stages that were chosen want it; huge where there is nothing to say.
        real(wp) :: longest = huge(1.0_wp)
        !> Steps with the present number of stages, and those of which the last choice was made.
        integer, private :: steps = 0, asked = 0
        !> By how much corrections contract, of the last steps the worst, a part of it forgotten each time; that of the last
        !> step.
        real(wp), private :: contraction = 0.3_wp, last = 0.0_wp
        !> What the run has cost so far, in corrections, less than 0 where that is not known; what the last steps have cost, and the
        !> time that they took; the cost of a unit of time before there were more stages.
        real(wp), private :: cost = -1.0_wp, spent = 0.0_wp, span = 0.0_wp, rate_before = 0.0_wp
        !> The part of that which was foretold, 0 where nothing was or it has been judged; how much more it was than foretold.
        real(wp), private :: promised = 0.0_wp, excess = 1.0_wp
        !> How often in a row more stages have cost more.
        integer, private :: disappointed = 0
    contains
        procedure :: restart, forget, note_failure, note_step, note_contraction, is_due, choose, pack_state
    end type choice_type

    !> Steps with a number of stages before there may be more, twice as many after each disappointment, up to so many of them; or
    !> fewer; and steps from choice to choice.
    integer, parameter :: patience = 10, most_doublings = 4, haste = 3, pause = 3
    !> Steps with more stages after which they are judged, and how many of the first ones do not count, which are too short.
    integer, parameter :: trial = 7, growing = 3
    !> What a step leaves of the memory of the contraction and of the costs,
    !> what a choice leaves of the excess over promises, and the most of that.
    real(wp), parameter :: remembered = 0.7_wp, fading = 0.8_wp, forgiving = 0.99_wp, most_excess = 4.0_wp
    !> The part of the work at which another number of stages is worth the change: more, and fewer.
    real(wp), parameter :: worth_more = 0.7_wp, worth_fewer = 0.9_wp
    !> More than so many times as long as the last step nobody can foretell a step.
    real(wp), parameter :: farthest = 4.0_wp
    !> A step that follows the errors has an error of at least this, on the scale of the tolerance.
    real(wp), parameter :: steady = 1.0e-2_wp
    !> A contraction with which more stages are not tried, and one with which there should be fewer.
    real(wp), parameter :: slow = 0.3_wp, slowest = 0.8_wp

contains

    !> Another number of stages goes on.
    pure subroutine restart(self, is_promised)
        class(choice_type), intent(inout) :: self
        !> Whether there are more, which were chosen for what they would cost.
        logical, intent(in) :: is_promised

        real(wp) :: promised

        promised = 0.0_wp
        if (is_promised .and. self%span > 0.0_wp) promised = self%promised
        if (promised > 0.0_wp) self%rate_before = self%spent/self%span
        call self%forget()
        self%promised = promised
    end subroutine restart

    !> The past says nothing about the next step, whose stages are the fewest.
    pure subroutine forget(self)
        class(choice_type), intent(inout) :: self

        self%promised = 0.0_wp
        self%spent = 0.0_wp
        self%span = 0.0_wp
        self%steps = 0
        self%asked = 0
        self%longest = huge(1.0_wp)
    end subroutine forget

    !> Newton's iteration has failed with more stages than the fewest.
    pure subroutine note_failure(self)
        class(choice_type), intent(inout) :: self

        self%promised = 0.0_wp
        self%excess = min(most_excess, 2*self%excess)
        self%disappointed = min(most_doublings, self%disappointed + 1)
    end subroutine note_failure

    !> Take note of a step that is kept.
    pure subroutine note_step(self, h, cost)
        class(choice_type), intent(inout) :: self
        !> Its length, and what the run has cost so far.
        real(wp), intent(in) :: h, cost

        self%steps = self%steps + 1
        if (self%cost >= 0.0_wp .and. .not. (self%promised > 0.0_wp .and. self%steps <= growing)) then
            self%spent = fading*self%spent + (cost - self%cost)
            self%span = fading*self%span + h
        end if
        self%cost = cost
        self%contraction = min(1.0_wp, max(self%last, remembered*self%contraction))
        self%last = 0.0_wp
        self%longest = huge(1.0_wp)
        if (self%promised > 0.0_wp .and. self%steps >= trial) then
            self%excess = min(most_excess, max(1.0_wp, self%spent/(self%span*self%rate_before*self%promised)))
            if (self%excess*self%promised > 1.0_wp) then
                self%disappointed = min(most_doublings, self%disappointed + 1)
            else
                self%disappointed = 0
            end if
            self%promised = 0.0_wp
        end if
    end subroutine note_step

    !> Take note of how a correction compares with the one before it.
    pure subroutine note_contraction(self, theta)
        class(choice_type), intent(inout) :: self
        real(wp), intent(in) :: theta

        self%last = theta
    end subroutine note_contraction

    !> Whether it is time to choose, after a step that is kept.
    logical function is_due(self, norm)
        class(choice_type), intent(inout) :: self
        !> Its error.
        real(wp), intent(in) :: norm

        is_due = self%steps >= haste .and. self%steps >= self%asked + pause .and. norm >= steady
        if (is_due) self%asked = self%steps
    end function is_due

    !> Choose the stages of the next step.
    subroutine choose(self, stages, h, norm, fewer, more, wanted)
        class(choice_type), intent(inout) :: self
        !> Those of the last step.
        integer, intent(in) :: stages
        !> Its length and its error, and the error that it would have had with two stages fewer and with two more; huge for those
        !> that may not be.
        real(wp), intent(in) :: h, norm, fewer, more
        integer, intent(inout) :: wanted
        real(wp) :: now, other

        wanted = stages
        now = work(norm, stages)
        self%excess = 1.0_wp + forgiving*(self%excess - 1.0_wp)
        if (more < huge(1.0_wp) .and. self%steps >= patience*2**self%disappointed .and. self%contraction <= slow) then
            other = work(more, stages + 2)
            if (self%excess*other < worth_more*now) then
                wanted = stages + 2
                self%promised = other/now
            end if
        end if
        if (fewer < huge(1.0_wp)) then
            other = work(fewer, stages - 2)
            if (other < worth_fewer*self%excess*now .or. self%contraction >= slowest) then
                wanted = stages - 2
                self%longest = 0.8_wp*h*reach(fewer, stages - 2)
            end if
        end if

    contains

        !> Steps that errors allow, over the last one.
        pure real(wp) function reach(error, s)
            real(wp), intent(in) :: error
            integer, intent(in) :: s

            reach = min(farthest, max(error, tiny(1.0_wp))**(-1.0_wp/real(s + 1, wp)))
        end function reach

        !> Work a unit of time with s stages.
        pure real(wp) function work(error, s)
            real(wp), intent(in) :: error
            integer, intent(in) :: s
            real(wp) :: theta, times

            times = reach(error, s)
            theta = min(0.9_wp, max(1.0e-4_wp, self%contraction)*times/reach(norm, stages))
            work = real(s, wp)/(times*abs(log(theta)))
        end function work
    end subroutine choose

    !> What the next choice depends on.
    subroutine pack_state(self, pack)
        class(choice_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%longest)
        call pack%item(self%steps, self%asked)
        call pack%item(self%contraction, self%last, self%cost, self%spent, self%span)
        call pack%item(self%rate_before, self%promised, self%excess)
        call pack%item(self%disappointed)
    end subroutine pack_state
end module tandem_stepper_radau_choice
