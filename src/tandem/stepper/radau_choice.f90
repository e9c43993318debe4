! SPDX-License-Identifier: MIT
!> How many stages a step of Radau IIA should have: as many as make the work a unit of time the least.
!>
!> The work is that of Newton's iteration, stages times corrections. How long steps are with another number of stages s, the error
!> tells that the last step would have had with it, which goes with the power s + 1 of the step; how many corrections they take, how
!> well the iteration contracts, which goes with the step. More stages pay where steps are small for the sake of a tight tolerance,
!> and the matrix serves longer ones well.
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
        !> By how much corrections contract, of the last steps the worst, half of it forgotten each time; that of the last step.
        real(wp), private :: contraction = 1.0_wp, last = 0.0_wp
    contains
        procedure :: restart
        procedure :: note_contraction
        procedure :: is_due
        procedure :: choose
        procedure :: pack_state
    end type choice_type

    !> Steps with a number of stages before there may be more, or fewer, of them; and steps from choice to choice.
    integer, parameter :: patience = 10, haste = 3, pause = 3
    !> The part of the work at which another number of stages is worth the change: more, and fewer.
    real(wp), parameter :: worth_more = 0.8_wp, worth_fewer = 0.9_wp
    !> More than so many times as long as the last step nobody can foretell a step.
    real(wp), parameter :: farthest = 4.0_wp
    !> A step that follows the errors has an error of at least this, on the scale of the tolerance.
    real(wp), parameter :: steady = 1.0e-2_wp
    !> A contraction with which more stages are not tried, and one with which there should be fewer.
    real(wp), parameter :: slow = 0.3_wp, slowest = 0.8_wp

contains

    !> Another number of stages goes on.
    pure subroutine restart(self)
        class(choice_type), intent(inout) :: self

        self%steps = 0
        self%asked = 0
        self%longest = huge(1.0_wp)
    end subroutine restart

    !> Take note of how a correction compares with the one before it.
    pure subroutine note_contraction(self, theta)
        class(choice_type), intent(inout) :: self
        real(wp), intent(in) :: theta

        self%last = theta
    end subroutine note_contraction

    !> Whether it is time to choose, after a step that is kept.
    logical function is_due(self, stages, norm)
        class(choice_type), intent(inout) :: self
        integer, intent(in) :: stages
        !> Its error.
        real(wp), intent(in) :: norm

        self%steps = self%steps + 1
        self%contraction = min(1.0_wp, max(self%last, 0.5_wp*self%contraction))
        self%last = 0.0_wp
        self%longest = huge(1.0_wp)
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
        real(wp) :: now, then

        wanted = stages
        now = work(norm, stages)
        if (more < huge(1.0_wp) .and. self%steps >= patience .and. self%contraction <= slow) then
            then = work(more, stages + 2)
            if (then < worth_more*now) wanted = stages + 2
        end if
        if (fewer < huge(1.0_wp)) then
            then = work(fewer, stages - 2)
            if (then < worth_fewer*now .or. self%contraction >= slowest) then
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
        call pack%item(self%steps)
        call pack%item(self%asked)
        call pack%item(self%contraction)
        call pack%item(self%last)
    end subroutine pack_state
end module tandem_stepper_radau_choice
