! SPDX-License-Identifier: MIT
!> Detects a loss of rank along the steps of a run, beyond which the motion is not unique: of C, or of the conditioning of a
!> coordinate without mass.
module tandem_simulate_lost_rank
    use tandem_chart, only: chart_type, measure_type, need_change, need_line, need_rank
    use tandem_kinds, only: wp
    use tandem_pack, only: pack_type
    use tandem_simulate_local_error, only: local_error_type
    use tandem_status, only: status_chart_left, status_newton_failed, status_ok, status_position_diverged, status_rank_deficient, &
        status_singular_mass
    use tandem_stepper_state, only: state_type
    implicit none (type, external)
    private

    public :: lost_rank_type

    !> Statuses of a motion that is no longer unique, and statuses that may hide one.
    integer, parameter :: losses(2) = [status_rank_deficient, status_singular_mass]
    integer, parameter :: may_hide_loss(3) = [status_position_diverged, status_chart_left, status_newton_failed]
    !> Steps approach a loss until its singular value has fallen to this part: closer to it, rounding determines the motion.
    real(wp), parameter :: least_independence = 1.0e-5_wp
    !> Steps that are short look for a loss when the independence has fallen to a part of this, and again at parts of that.
    real(wp), parameter :: first_look = 0.5_wp

    type :: lost_rank_type
        !> Time until the loss, if the smallest singular value continues to fall at its rate.
        real(wp), private :: room = huge(1.0_wp)
        !> Remaining part of the independence, and of the conditioning of massless coordinates, at the last step.
        real(wp), private :: fallen = 1.0_wp, loosened = 1.0_wp
        !> Part of the best independence at which `comes_close` was true last, or the one above which it is false.
        real(wp), private :: seen = first_look
        !> Part of the best independence at the last chart, its time, and the rate at which it fell then (1/s).
        real(wp), private :: last_part = 1.0_wp, last_t = 0.0_wp, last_rate = 0.0_wp
        !> Status for which a controlled step was given up, a loss or a status that may hide one, and the time until which it may
        !> still be ahead or close behind.
        integer, private :: reason = status_ok
        real(wp), private :: until = -huge(1.0_wp)
        !> End of a line ahead (n).
        real(wp), allocatable, private :: ahead(:)
    contains
        procedure :: forget_ahead, forget_measure, go_back, is_ahead, is_close, is_far, was_met, is_near, longest_step
        procedure :: look_ahead, look_within, limits, comes_close
        procedure :: find_near, find_close, check, find_behind
        procedure, private :: loss_ahead
        procedure :: remember, check_branch, pack_state
    end type lost_rank_type

contains

    !> A loss that was ahead need not be ahead now.
    pure subroutine forget_ahead(self)
        class(lost_rank_type), intent(inout) :: self

        self%room = huge(1.0_wp)
    end subroutine forget_ahead

    !> Another chart, whose independence has not been measured yet.
    pure subroutine forget_measure(self)
        class(lost_rank_type), intent(inout) :: self

        self%fallen = 1.0_wp
        self%loosened = 1.0_wp
    end subroutine forget_measure

    !> The loss on the straight line from a state within the time h, ok if there is none.
    subroutine loss_ahead(self, chart, t, q, qd, h, loss)
        class(lost_rank_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        real(wp), intent(in) :: t, h
        real(wp), intent(in), contiguous :: q(:), qd(:)
        integer, intent(out) :: loss
        type(measure_type) :: measure

        if (.not. allocated(self%ahead)) allocate (self%ahead(size(q)))
        self%ahead(:) = q + h*qd
        call chart%measure(need_line, t, q, t + h, self%ahead, qd, measure, loss)
    end subroutine loss_ahead

    !> Reject a step of size h: the loss is farther ahead again.
    pure subroutine go_back(self, h)
        class(lost_rank_type), intent(inout) :: self
        real(wp), intent(in) :: h

        if (self%is_ahead()) self%room = self%room + h
    end subroutine go_back

    !> True if steps approach a loss.
    pure logical function is_ahead(self)
        class(lost_rank_type), intent(in) :: self

        is_ahead = self%room < huge(1.0_wp)
    end function is_ahead

    !> True if the independence has fallen so far that rounding shows in velocities and accelerations.
    pure logical function is_close(self, chart)
        class(lost_rank_type), intent(in) :: self
        class(chart_type), intent(in) :: chart
        real(wp), parameter :: close = 0.05_wp

        is_close = self%fallen < close .or. chart%independence < close*chart%best_independence
    end function is_close

    !> True if the independence has hardly fallen.
    pure logical function is_far(self)
        class(lost_rank_type), intent(in) :: self
        real(wp), parameter :: far = 0.8_wp

        is_far = self%fallen > far
    end function is_far

    !> The loss that was met, and that may still be close at a time; ok if there is none.
    pure integer function was_met(self, t)
        class(lost_rank_type), intent(in) :: self
        real(wp), intent(in) :: t

        was_met = status_ok
        if (t <= self%until .and. any(self%reason == losses)) was_met = self%reason
    end function was_met

    !> True if a loss is ahead or was just met.
    pure logical function is_near(self, t)
        class(lost_rank_type), intent(in) :: self
        real(wp), intent(in) :: t

        is_near = self%is_ahead() .or. self%was_met(t) /= status_ok
    end function is_near

    !> True if a loss ahead limits a step of size h; the time until the loss.
    logical function limits(self, h, room)
        class(lost_rank_type), intent(in) :: self
        real(wp), intent(in) :: h
        real(wp), intent(out) :: room

        room = self%room
        limits = self%is_ahead() .and. 0.5_wp*self%room < h
    end function limits

    !> True if the independence has fallen much since the last time, and falls ever faster, even if the loss is many steps ahead.
    logical function comes_close(self, chart, t, room)
        class(lost_rank_type), intent(inout) :: self
        class(chart_type), intent(in) :: chart
        !> Time of the chart.
        real(wp), intent(in) :: t
        !> Time until the loss.
        real(wp), intent(out) :: room
        real(wp), parameter :: falls_to = 0.6_wp, not_slower = 0.98_wp
        real(wp) :: part, rate

        comes_close = .false.
        room = self%room
        part = chart%independence/max(chart%best_independence, tiny(1.0_wp))
        rate = 0.0_wp
        if (t > self%last_t) rate = (self%last_part - part)/(t - self%last_t)
        if (part > first_look) then
            self%seen = first_look
        else if (part < falls_to*self%seen .and. rate > 0.0_wp .and. rate > not_slower*self%last_rate) then
            comes_close = .true.
            self%seen = part
            room = part/rate
        end if
        self%last_part = part
        self%last_t = t
        self%last_rate = rate
    end function comes_close

    !> Steps must shrink towards a loss, so that none contains it undetected: the longest step, given its limit otherwise.
    pure real(wp) function longest_step(self, h)
        class(lost_rank_type), intent(in) :: self
        real(wp), intent(in) :: h

        longest_step = min(h, 0.5_wp*self%room)
    end function longest_step

    !> Before a step of about h: find if the loss ahead is too near, so that the run ends, or if there is none.
    subroutine look_ahead(self, chart, state, h, is_loss, t, loss)
        class(lost_rank_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        type(state_type), intent(in) :: state
        real(wp), intent(in) :: h
        !> True if a loss is known to be ahead.
        logical, intent(in) :: is_loss
        !> Time and kind of the loss; ok if steps continue.
        real(wp), intent(out) :: t
        integer, intent(out) :: loss
        real(wp) :: part

        loss = status_ok
        t = state%t
        if (self%is_ahead()) t = t + self%room
        ! Steps that creep do not show how the independence falls.
        part = min(self%fallen, chart%independence/max(chart%best_independence, tiny(1.0_wp)))
        if (min(part, self%loosened) < least_independence) then
            ! Determines the rows of the message.
            if (self%is_ahead()) call self%loss_ahead(chart, state%t, state%q, state%qd, 2*self%room, loss)
            loss = merge(status_rank_deficient, status_singular_mass, part < least_independence)
        else if (0.5_wp*self%room < h .and. chart%n_dropped == 0 .and. .not. is_loss) then
            ! Redundant rows belong to linkages with symmetries, whose branches may cross where C loses two ranks at once and keeps
            ! its orientation.
            call self%loss_ahead(chart, state%t, state%q, state%qd, 2*self%room, loss)
            if (loss == status_ok) call self%forget_ahead()
            loss = status_ok
        end if
    end subroutine look_ahead

    !> The loss within a fixed step of size h, ok if there is none.
    subroutine look_within(self, chart, state, h, loss)
        class(lost_rank_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        type(state_type), intent(in) :: state
        real(wp), intent(in) :: h
        integer, intent(out) :: loss
        !> A loss at the very end of a step belongs to it.
        real(wp), parameter :: slack = 1.0e-7_wp

        loss = status_ok
        if (self%room < 1.5_wp*h) call self%loss_ahead(chart, state%t, state%q, state%qd, (1.0_wp + slack)*h, loss)
    end subroutine look_within

    !> Steps have become hopelessly short. A loss within a millionth of the run ahead, or weak conditioning of a massless
    !> coordinate, is the cause: the errors of steps grow without bound towards it.
    subroutine find_near(self, chart, state, span, loss)
        class(lost_rank_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        type(state_type), intent(in) :: state
        !> Time since the start of the run.
        real(wp), intent(in) :: span
        integer, intent(out) :: loss
        real(wp), parameter :: near = 1.0e-6_wp

        call self%loss_ahead(chart, state%t, state%q, state%qd, near*span, loss)
        if (loss == status_ok .and. self%loosened < least_independence) loss = status_singular_mass
    end subroutine find_near

    !> Loss close ahead, ok if there is none: accelerations, and so their rounding, grow without bound towards it, faster with more
    !> loops involved, until constraints are violated or steps creep. The search covers at most a ten-thousandth of the coordinates'
    !> scale.
    subroutine find_close(self, chart, state, rate, reach, room, loss)
        class(lost_rank_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        type(state_type), intent(in) :: state
        !> The largest velocity on the coordinates' scales, the usual reach of steps, and the largest time of the search.
        real(wp), intent(in) :: rate, reach, room
        integer, intent(out) :: loss
        real(wp), parameter :: close = 1.0e-4_wp
        real(wp) :: ahead

        loss = status_ok
        if (.not. rate*reach <= close) return
        ahead = room
        if (rate*ahead > close) ahead = close/rate
        if (ahead > 0.0_wp) call self%loss_ahead(chart, state%t, state%q, state%qd, ahead, loss)
    end subroutine find_close

    !> Check if C has lost rank between a state and the next: behind such a step the motion is not unique.
    subroutine check(self, chart, state, next, stat)
        class(lost_rank_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        type(state_type), intent(in) :: state
        type(state_type), intent(inout) :: next
        !> ok, or the status of `measure` of the chart.
        integer, intent(out) :: stat
        type(measure_type) :: measure

        call chart%measure(need_rank, state%t, state%q, next%t, next%q, next%qd, measure, stat)
        self%fallen = measure%fallen
        self%loosened = measure%loosened
        if (stat == status_ok .and. .not. measure%room > 0.0_wp) stat = status_rank_deficient
        ! A rotation of this size may hide a loss.
        if (stat == status_chart_left) call self%find_behind(chart, state, next, stat)
        ! A rejected step gives no prediction for the next.
        if (stat /= status_ok) return
        self%room = measure%room
        if (measure%room < huge(1.0_wp)) self%room = measure%room*(next%t - state%t)
    end subroutine check

    !> The step to `next` could not be completed. If C loses rank on its straight line, that is the reason.
    subroutine find_behind(self, chart, state, next, stat)
        class(lost_rank_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        type(state_type), intent(in) :: state
        !> Its coordinates are used as work space.
        type(state_type), intent(inout) :: next
        !> The status, replaced if a loss is found.
        integer, intent(inout) :: stat
        integer :: loss

        if (all(stat /= may_hide_loss)) return
        associate (h => next%t - state%t)
            ! From a little behind, since the state may lie just beyond the loss, and further than the step, since the path bends
            ! and stages fail first; stages that are solved together fail two steps before.
            next%q = state%q - h*state%qd
            call self%loss_ahead(chart, state%t - h, next%q, state%qd, 4.0_wp*h, loss)
            if (loss /= status_ok) stat = loss
        end associate
    end subroutine find_behind

    !> Record a try that was given up because of a loss or a status that may hide one.
    pure subroutine remember(self, t, t_next, stat)
        class(lost_rank_type), intent(inout) :: self
        !> Its start and end.
        real(wp), intent(in) :: t, t_next
        !> The status.
        integer, intent(in) :: stat

        if (all(stat /= [losses, may_hide_loss])) return
        if (t > self%until .or. all(self%reason /= losses)) self%reason = stat
        self%until = max(self%until, t_next + (t_next - t))
    end subroutine remember

    !> Check if the step to `next`, shorter than one that was given up, has entered another branch: its velocity has changed without
    !> an acceleration, and C with it. Branches cross if a row of C vanishes. The direction of the row, which determines the other
    !> measures, need not come near dependence then, and the orientation may be kept. If a step is merely too long, a shorter one
    !> changes its velocity less, and a jump of nu does not change C.
    subroutine check_branch(self, chart, local_error, state, next, stat)
        class(lost_rank_type), intent(in) :: self
        class(chart_type), intent(inout) :: chart
        type(local_error_type), intent(in) :: local_error
        type(state_type), intent(in) :: state
        !> Its coordinates are lost if it has entered another branch.
        type(state_type), intent(inout) :: next
        !> ok, or the status of the other step.
        integer, intent(out) :: stat
        !> Relative to the velocity; steps that meet usual tolerances leave far less. Loose tolerances may leave as much, and the
        !> step is repeated, since the gap of a step onto another branch may be no larger.
        real(wp), parameter :: least_gap = 1.0e-3_wp
        type(measure_type) :: measure
        real(wp) :: gap
        integer :: stat_there

        stat = status_ok
        if (state%t > self%until) return
        gap = local_error%gap(state, next)
        if (.not. gap > least_gap) return
        call chart%measure(need_change, state%t, state%q, next%t, next%q, next%qd, measure, stat_there)
        if (measure%change > gap) stat = self%reason
    end subroutine check_branch

    !> All components.
    subroutine pack_state(self, pack)
        class(lost_rank_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%room, self%fallen, self%loosened, self%seen)
        call pack%item(self%last_part, self%last_t, self%last_rate)
        call pack%item(self%reason)
        call pack%item(self%until)
    end subroutine pack_state
end module tandem_simulate_lost_rank
