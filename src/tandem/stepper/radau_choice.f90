! SPDX-License-Identifier: MIT
!> Choice of the number of stages of Radau IIA that minimises the work per unit of time.
!>
!> The work is the number of stages times the number of corrections in Newton's iteration. The step size with another number of
!> stages s follows from the error that the last step would have had with s stages, which is proportional to the power s + 1 of the
!> step size. The number of corrections follows from the contraction of the iteration, which is proportional to the step size. More
!> stages are cheaper if a tight tolerance requires small steps for which the matrix is more accurate than necessary. The actual
!> work is compared with the predicted work, which gives a correction factor for later predictions.
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
        integer, private :: steps = 0, steps_at_choice = 0
        !> Worst contraction in recent steps, whose weights decay; contraction in the last step.
        real(wp), private :: contraction = 0.3_wp, last = 0.0_wp
        !> Cost of the run so far in corrections, negative if unknown; cost and duration of recent steps, whose weights decay; cost
        !> per unit of time before the last increase of the number of stages.
        real(wp), private :: cost = -1.0_wp, recent_cost = 0.0_wp, recent_time = 0.0_wp, rate_before = 0.0_wp
        !> Predicted ratio of the cost after to the cost before the last increase, 0 if there is no prediction or it has already
        !> been compared; ratio of actual to predicted cost.
        real(wp), private :: predicted = 0.0_wp, cost_factor = 1.0_wp
        !> Number of consecutive increases of the number of stages that raised the cost.
        integer, private :: n_unsuccessful = 0
    contains
        procedure :: restart, clear, note_failure, note_step, note_contraction, is_due, choose, pack_state
    end type choice_type

    !> Number of steps before more stages are allowed, which is doubled after each unsuccessful increase; largest number of
    !> doublings; number of steps before fewer stages are allowed; number of steps between choices.
    integer, parameter :: steps_before_more = 10, most_doublings = 4, steps_before_fewer = 3, steps_between = 3
    !> Number of steps after an increase until the costs are compared; number of first steps that are excluded from the comparison,
    !> because they are too short.
    integer, parameter :: trial_steps = 7, excluded_steps = 3
    !> Decay factors per step of the contraction and of the costs; decay factor per choice of the correction factor; largest
    !> correction factor.
    real(wp), parameter :: contraction_decay = 0.7_wp, cost_decay = 0.8_wp, factor_decay = 0.99_wp, max_cost_factor = 4.0_wp
    !> Largest ratio of predicted to present work for changing to more stages and to fewer stages.
    real(wp), parameter :: worth_more = 0.7_wp, worth_fewer = 0.9_wp
    !> Largest predicted ratio of step sizes.
    real(wp), parameter :: largest_growth = 4.0_wp
    !> Error relative to the tolerance below which the step size does not follow from errors.
    real(wp), parameter :: smallest_error = 1.0e-2_wp
    !> Largest contraction with which more stages are tried; contraction from which fewer stages are required.
    real(wp), parameter :: slow = 0.3_wp, slowest = 0.8_wp

contains

    !> Begin with another number of stages.
    pure subroutine restart(self, is_predicted)
        class(choice_type), intent(inout) :: self
        !> True after an increase that was chosen for its predicted cost.
        logical, intent(in) :: is_predicted

        real(wp) :: predicted

        predicted = 0.0_wp
        if (is_predicted .and. self%recent_time > 0.0_wp) predicted = self%predicted
        if (predicted > 0.0_wp) self%rate_before = self%recent_cost/self%recent_time
        call self%clear()
        self%predicted = predicted
    end subroutine restart

    !> Discard all data, because they do not apply to the next step, which has the smallest number of stages.
    pure subroutine clear(self)
        class(choice_type), intent(inout) :: self

        self%predicted = 0.0_wp
        self%recent_cost = 0.0_wp
        self%recent_time = 0.0_wp
        self%steps = 0
        self%steps_at_choice = 0
        self%longest = huge(1.0_wp)
    end subroutine clear

    !> Record a failure of Newton's iteration with more than the smallest number of stages.
    pure subroutine note_failure(self)
        class(choice_type), intent(inout) :: self

        self%predicted = 0.0_wp
        self%cost_factor = min(max_cost_factor, 2*self%cost_factor)
        self%n_unsuccessful = min(most_doublings, self%n_unsuccessful + 1)
    end subroutine note_failure

    !> Record an accepted step.
    pure subroutine note_step(self, h, cost)
        class(choice_type), intent(inout) :: self
        !> Step size, and cost of the run so far.
        real(wp), intent(in) :: h, cost

        self%steps = self%steps + 1
        if (self%cost >= 0.0_wp .and. .not. (self%predicted > 0.0_wp .and. self%steps <= excluded_steps)) then
            self%recent_cost = cost_decay*self%recent_cost + (cost - self%cost)
            self%recent_time = cost_decay*self%recent_time + h
        end if
        self%cost = cost
        self%contraction = min(1.0_wp, max(self%last, contraction_decay*self%contraction))
        self%last = 0.0_wp
        self%longest = huge(1.0_wp)
        if (self%predicted > 0.0_wp .and. self%steps >= trial_steps) then
            self%cost_factor = min(max_cost_factor, &
                max(1.0_wp, self%recent_cost/(self%recent_time*self%rate_before*self%predicted)))
            if (self%cost_factor*self%predicted > 1.0_wp) then
                self%n_unsuccessful = min(most_doublings, self%n_unsuccessful + 1)
            else
                self%n_unsuccessful = 0
            end if
            self%predicted = 0.0_wp
        end if
    end subroutine note_step

    !> Record the contraction of the last step: the ratio of a correction to the previous one.
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

        is_due = norm >= smallest_error .and. self%steps >= steps_before_fewer .and. &
            self%steps >= self%steps_at_choice + steps_between
        if (is_due) self%steps_at_choice = self%steps
    end function is_due

    !> Choose the number of stages of the next step.
    subroutine choose(self, stages, h, norm, fewer, more, wanted)
        class(choice_type), intent(inout) :: self
        !> Number of stages of the last step.
        integer, intent(in) :: stages
        !> Size and error of the last step; errors that it would have had with two stages fewer and two stages more, huge if these
        !> are not allowed.
        real(wp), intent(in) :: h, norm, fewer, more
        integer, intent(inout) :: wanted
        real(wp) :: now, other

        wanted = stages
        now = work(norm, stages)
        self%cost_factor = 1.0_wp + factor_decay*(self%cost_factor - 1.0_wp)
        if (more < huge(1.0_wp) .and. self%contraction <= slow .and. &
            self%steps >= steps_before_more*2**self%n_unsuccessful) then
            other = work(more, stages + 2)
            if (self%cost_factor*other < worth_more*now) then
                wanted = stages + 2
                self%predicted = other/now
            end if
        end if
        if (fewer < huge(1.0_wp)) then
            other = work(fewer, stages - 2)
            if (other < worth_fewer*self%cost_factor*now .or. self%contraction >= slowest) then
                wanted = stages - 2
                self%longest = 0.8_wp*h*reach(fewer, stages - 2)
            end if
        end if

    contains

        !> Ratio of the step size that the error allows to the last step size.
        pure real(wp) function reach(error, s)
            real(wp), intent(in) :: error
            integer, intent(in) :: s

            reach = min(largest_growth, max(error, tiny(1.0_wp))**(-1.0_wp/real(s + 1, wp)))
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
        call pack%item(self%steps, self%steps_at_choice)
        call pack%item(self%contraction, self%last, self%cost, self%recent_cost, self%recent_time)
        call pack%item(self%rate_before, self%predicted, self%cost_factor)
        call pack%item(self%n_unsuccessful)
    end subroutine pack_state
end module tandem_stepper_radau_choice
