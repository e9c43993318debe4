! SPDX-License-Identifier: MIT
!> Number of stages for a step of Radau IIA that minimises the work per unit of time.
!>
!> The work is that of Newton's iteration, stages times corrections. The step size for another number of stages s follows from the
!> error that the last step would have had with it, which is proportional to the power s + 1 of the step size; the number of
!> corrections follows from the contraction of the iteration, which is proportional to the step size. More stages are cheaper if a
!> tight tolerance requires small steps and the matrix is still accurate for longer ones. Each prediction is compared with the
!> actual work, which gives a correction factor for the next prediction.
module tandem_stepper_radau_choice
    use tandem_kinds, only: wp
    use tandem_pack, only: pack_type
    implicit none (type, external)
    private

    public :: choice_type

    type :: choice_type
        !> Limit of the next step after a choice of fewer stages; huge if there is none.
        real(wp) :: longest = huge(1.0_wp)
        !> Number of steps with the present number of stages; its value at the last choice.
        integer, private :: steps = 0, asked = 0
        !> Worst contraction of corrections in the last steps, with fading memory; that of the last step.
        real(wp), private :: contraction = 0.3_wp, last = 0.0_wp
        !> Cost of the run so far, in corrections, negative if unknown; cost and duration of the last steps; cost per unit of time
        !> before the last increase of the number of stages.
        real(wp), private :: cost = -1.0_wp, spent = 0.0_wp, span = 0.0_wp, rate_before = 0.0_wp
        !> Predicted part of this cost, 0 if there is no prediction or it has been compared; ratio of actual to predicted cost.
        real(wp), private :: promised = 0.0_wp, excess = 1.0_wp
        !> Number of consecutive increases of the number of stages that increased the cost.
        integer, private :: disappointed = 0
    contains
        procedure :: restart, forget, note_failure, note_step, note_contraction, is_due, choose, pack_state
    end type choice_type

    !> Number of steps before more stages are allowed, doubled after each unsuccessful increase, and the largest number of
    !> doublings; number of steps before fewer stages are allowed; number of steps between choices.
    integer, parameter :: patience = 10, most_doublings = 4, haste = 3, pause = 3
    !> Number of steps with more stages before the comparison, and number of first steps excluded from it, which are too short.
    integer, parameter :: trial = 7, growing = 3
    !> Factors of fading memory per step, for the contraction and for the costs, and per choice, for the excess; largest excess.
    real(wp), parameter :: remembered = 0.7_wp, fading = 0.8_wp, forgiving = 0.99_wp, most_excess = 4.0_wp
    !> Largest ratio of work at which the number of stages changes: to more, and to fewer.
    real(wp), parameter :: worth_more = 0.7_wp, worth_fewer = 0.9_wp
    !> Largest ratio of step sizes in a prediction.
    real(wp), parameter :: farthest = 4.0_wp
    !> Smallest error, relative to the tolerance, of a step whose size follows from errors.
    real(wp), parameter :: steady = 1.0e-2_wp
    !> Largest contraction for trying more stages; contraction that requires fewer.
    real(wp), parameter :: slow = 0.3_wp, slowest = 0.8_wp

contains

    !> Start with another number of stages.
    pure subroutine restart(self, is_promised)
        class(choice_type), intent(inout) :: self
        !> True after an increase chosen for its predicted cost.
        logical, intent(in) :: is_promised

        real(wp) :: promised

        promised = 0.0_wp
        if (is_promised .and. self%span > 0.0_wp) promised = self%promised
        if (promised > 0.0_wp) self%rate_before = self%spent/self%span
        call self%forget()
        self%promised = promised
    end subroutine restart

    !> Discard the past, which does not apply to the next step; that step has the smallest number of stages.
    pure subroutine forget(self)
        class(choice_type), intent(inout) :: self

        self%promised = 0.0_wp
        self%spent = 0.0_wp
        self%span = 0.0_wp
        self%steps = 0
        self%asked = 0
        self%longest = huge(1.0_wp)
    end subroutine forget

    !> Record a failure of Newton's iteration with more than the smallest number of stages.
    pure subroutine note_failure(self)
        class(choice_type), intent(inout) :: self

        self%promised = 0.0_wp
        self%excess = min(most_excess, 2*self%excess)
        self%disappointed = min(most_doublings, self%disappointed + 1)
    end subroutine note_failure

    !> Record an accepted step.
    pure subroutine note_step(self, h, cost)
        class(choice_type), intent(inout) :: self
        !> Step size, and cost of the run so far.
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

    !> Record the ratio of a correction to the previous one.
    pure subroutine note_contraction(self, theta)
        class(choice_type), intent(inout) :: self
        real(wp), intent(in) :: theta

        self%last = theta
    end subroutine note_contraction

    !> True if a choice is due after an accepted step.
    logical function is_due(self, norm)
        class(choice_type), intent(inout) :: self
        !> Error of the step.
        real(wp), intent(in) :: norm

        is_due = self%steps >= haste .and. self%steps >= self%asked + pause .and. norm >= steady
        if (is_due) self%asked = self%steps
    end function is_due

    !> Choose the stages of the next step.
    subroutine choose(self, stages, h, norm, fewer, more, wanted)
        class(choice_type), intent(inout) :: self
        !> Number of stages of the last step.
        integer, intent(in) :: stages
        !> Its size and error, and the errors it would have had with two stages fewer and two more; huge if not allowed.
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

        !> Ratio of the step size allowed by the error to the last one.
        pure real(wp) function reach(error, s)
            real(wp), intent(in) :: error
            integer, intent(in) :: s

            reach = min(farthest, max(error, tiny(1.0_wp))**(-1.0_wp/real(s + 1, wp)))
        end function reach

        !> Work per unit of time with s stages.
        pure real(wp) function work(error, s)
            real(wp), intent(in) :: error
            integer, intent(in) :: s
            real(wp) :: theta, times

            times = reach(error, s)
            theta = min(0.9_wp, max(1.0e-4_wp, self%contraction)*times/reach(norm, stages))
            work = real(s, wp)/(times*abs(log(theta)))
        end function work
    end subroutine choose

    !> Pack the data of the next choice.
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
