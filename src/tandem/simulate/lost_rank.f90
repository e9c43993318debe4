! SPDX-License-Identifier: MIT
!> What the steps of a run tell of a loss of rank, behind which the motion is not determined: of C, or of what ties a coordinate
!> without mass.
module tandem_simulate_lost_rank
    use tandem_chart, only: chart_type
    use tandem_kinds, only: wp
    use tandem_pack, only: pack_type
    use tandem_simulate_local_error, only: local_error_type
    use tandem_status, only: status_chart_left, status_newton_failed, status_ok, status_position_diverged, status_rank_deficient, &
        status_singular_mass
    use tandem_stepper_state, only: state_type
    implicit none (type, external)
    private

    public :: lost_rank_type

    !> The statuses of a motion that is no longer determined, and those that may hide one.
    integer, parameter :: losses(2) = [status_rank_deficient, status_singular_mass]
    integer, parameter :: disguises(3) = [status_position_diverged, status_chart_left, status_newton_failed]
    !> Steps approach a loss until its singular value has fallen to this part: closer, rounding decides where they go.
    real(wp), parameter :: least_independence = 1.0e-5_wp

    type :: lost_rank_type
        !> Time until the loss, if the smallest singular value goes on falling as it does.
        real(wp), private :: room = huge(1.0_wp)
        !> A controlled step was given up for this reason, a loss or what may hide one, and until this time that may still lie ahead
        !> or close behind.
        integer, private :: reason = status_ok
        real(wp), private :: until = -huge(1.0_wp)
    contains
        procedure :: forget_ahead, go_back, is_ahead, was_met, is_near, longest_step, look_ahead, look_within
        procedure, nopass :: find_near, find_close
        procedure :: check
        procedure, nopass :: find_behind
        procedure :: remember, check_branch, pack_state
    end type lost_rank_type

contains

    !> Where a loss was ahead before, it need not be so now.
    pure subroutine forget_ahead(self)
        class(lost_rank_type), intent(inout) :: self

        self%room = huge(1.0_wp)
    end subroutine forget_ahead

    !> A step of size h is not kept: the loss is farther ahead again.
    pure subroutine go_back(self, h)
        class(lost_rank_type), intent(inout) :: self
        real(wp), intent(in) :: h

        if (self%is_ahead()) self%room = self%room + h
    end subroutine go_back

    !> Whether steps approach a loss.
    pure logical function is_ahead(self)
        class(lost_rank_type), intent(in) :: self

        is_ahead = self%room < huge(1.0_wp)
    end function is_ahead

    !> The loss that was met, and that may still be close at a time; ok where there is none.
    pure integer function was_met(self, t)
        class(lost_rank_type), intent(in) :: self
        real(wp), intent(in) :: t

        was_met = status_ok
        if (t <= self%until .and. any(self%reason == losses)) was_met = self%reason
    end function was_met

    !> Whether a loss is ahead or was just met.
    pure logical function is_near(self, t)
        class(lost_rank_type), intent(in) :: self
        real(wp), intent(in) :: t

        is_near = self%is_ahead() .or. self%was_met(t) /= status_ok
    end function is_near

    !> Towards a loss steps must shrink, so that it cannot hide in one: the longest step, given what it would be otherwise.
    pure real(wp) function longest_step(self, h)
        class(lost_rank_type), intent(in) :: self
        real(wp), intent(in) :: h

        longest_step = min(h, 0.5_wp*self%room)
    end function longest_step

    !> Before a step of about h: is the loss ahead too near, so that the run ends, or is there none?
    subroutine look_ahead(self, chart, state, h, t, loss)
        class(lost_rank_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        type(state_type), intent(in) :: state
        real(wp), intent(in) :: h
        !> When it comes, and what is lost; ok where steps go on.
        real(wp), intent(out) :: t
        integer, intent(out) :: loss

        loss = status_ok
        t = state%t + self%room
        if (self%is_ahead() .and. min(chart%fallen, chart%loosened) < least_independence) then
            ! To name the rows.
            loss = chart%loss_ahead(state%t, state%q, state%qd, 2*self%room)
            loss = merge(status_rank_deficient, status_singular_mass, chart%fallen < least_independence)
        else if (0.5_wp*self%room < h .and. chart%n_dropped == 0) then
            ! Redundant rows belong to linkages with symmetries, whose branches may cross where C loses two ranks at once and keeps
            ! its orientation.
            if (chart%loss_ahead(state%t, state%q, state%qd, 2*self%room) == status_ok) call self%forget_ahead()
        end if
    end subroutine look_ahead

    !> The loss within a fixed step of size h, ok where there is none.
    subroutine look_within(self, chart, state, h, loss)
        class(lost_rank_type), intent(in) :: self
        class(chart_type), intent(inout) :: chart
        type(state_type), intent(in) :: state
        real(wp), intent(in) :: h
        integer, intent(out) :: loss
        !> A loss at the very end of a step belongs to it.
        real(wp), parameter :: hair = 1.0e-7_wp

        loss = status_ok
        if (self%room < 1.5_wp*h) loss = chart%loss_ahead(state%t, state%q, state%qd, (1.0_wp + hair)*h)
    end subroutine look_within

    !> Steps have become hopelessly short. Where something is lost within a millionth of the run ahead, or where little of a tie is
    !> left, that is why: the errors of steps grow without bound towards it.
    subroutine find_near(chart, state, span, loss)
        class(chart_type), intent(inout) :: chart
        type(state_type), intent(in) :: state
        !> Time since the start of the run.
        real(wp), intent(in) :: span
        integer, intent(out) :: loss
        real(wp), parameter :: near = 1.0e-6_wp

        loss = chart%loss_ahead(state%t, state%q, state%qd, near*span)
        if (loss == status_ok .and. chart%loosened < least_independence) loss = status_singular_mass
    end subroutine find_near

    !> What is lost close ahead, ok where it is nothing: accelerations, and so their rounding, grow without bound towards it, the
    !> more the more loops share it, until constraints cannot be held or steps creep. Looked at is no more than a ten-thousandth of
    !> the coordinates' scale.
    subroutine find_close(chart, state, rate, reach, room, loss)
        class(chart_type), intent(inout) :: chart
        type(state_type), intent(in) :: state
        !> The largest velocity on the coordinates' scales, how far steps get, and for how long it may be looked ahead.
        real(wp), intent(in) :: rate, reach, room
        integer, intent(out) :: loss
        real(wp), parameter :: close = 1.0e-4_wp
        real(wp) :: ahead

        loss = status_ok
        if (.not. rate*reach <= close) return
        ahead = room
        if (rate*ahead > close) ahead = close/rate
        if (ahead > 0.0_wp) loss = chart%loss_ahead(state%t, state%q, state%qd, ahead)
    end subroutine find_close

    !> Whether C has lost rank between a state and the next: behind such a step the motion is not determined.
    subroutine check(self, chart, state, next, stat)
        class(lost_rank_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        type(state_type), intent(in) :: state
        type(state_type), intent(inout) :: next
        !> ok, or what `measure_rank` has found.
        integer, intent(out) :: stat
        real(wp) :: room

        call chart%measure_rank(state%t, state%q, next%t, next%q, room, stat)
        if (stat == status_ok .and. .not. room > 0.0_wp) stat = status_rank_deficient
        ! What turns that far may hide it.
        if (stat == status_chart_left) call self%find_behind(chart, state, next, stat)
        ! What a step has found that is not kept says nothing of the next.
        if (stat /= status_ok) return
        self%room = room
        if (room < huge(1.0_wp)) self%room = room*(next%t - state%t)
    end subroutine check

    !> The step to `next` could not be completed. Where its straight way would have lost rank, that is the reason.
    subroutine find_behind(chart, state, next, stat)
        class(chart_type), intent(inout) :: chart
        type(state_type), intent(in) :: state
        !> Its coordinates serve as work space.
        type(state_type), intent(inout) :: next
        !> The reason, replaced where this is it.
        integer, intent(inout) :: stat
        integer :: loss

        if (all(stat /= disguises)) return
        associate (h => next%t - state%t)
            ! From a little behind, since the state may lie just beyond, and further, since the way bends and stages are the first
            ! to notice; those that are solved together notice two steps before.
            next%q = state%q - h*state%qd
            loss = chart%loss_ahead(state%t - h, next%q, state%qd, 4.0_wp*h)
            if (loss /= status_ok) stat = loss
        end associate
    end subroutine find_behind

    !> Take note of a try that was given up, where it has met a loss or a reason that may hide one.
    pure subroutine remember(self, t, t_next, stat)
        class(lost_rank_type), intent(inout) :: self
        !> Its start and end.
        real(wp), intent(in) :: t, t_next
        !> The reason.
        integer, intent(in) :: stat

        if (all(stat /= [losses, disguises])) return
        if (t > self%until .or. all(self%reason /= losses)) self%reason = stat
        self%until = max(self%until, t_next + (t_next - t))
    end subroutine remember

    !> Whether the step to `next`, shorter than one that was given up, has turned off there onto another branch: its velocity has
    !> changed of itself, without an acceleration, and C with it. Where a row of C vanishes, branches cross. Its direction, which is
    !> what the other measures see, need not come near dependence then, and the orientation may be kept. A step that is merely too
    !> long changes its velocity less when it is shorter, and a jump of nu leaves C as it is.
    subroutine check_branch(self, chart, local_error, state, next, stat)
        class(lost_rank_type), intent(in) :: self
        class(chart_type), intent(inout) :: chart
        type(local_error_type), intent(in) :: local_error
        type(state_type), intent(in) :: state
        !> Its coordinates are lost where it has turned off.
        type(state_type), intent(inout) :: next
        !> ok, or why the other step was given up.
        integer, intent(out) :: stat
        !> Relative to the velocity; steps that meet usual tolerances leave far less. Loose ones may leave as much and are tried
        !> again, since a step onto another branch leaves no more.
        real(wp), parameter :: least_gap = 1.0e-3_wp
        real(wp) :: gap

        stat = status_ok
        if (state%t > self%until) return
        gap = local_error%gap(state, next)
        if (.not. gap > least_gap) return
        if (chart%relative_change() > gap) stat = self%reason
    end subroutine check_branch

    !> All of it.
    subroutine pack_state(self, pack)
        class(lost_rank_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%room)
        call pack%item(self%reason)
        call pack%item(self%until)
    end subroutine pack_state
end module tandem_simulate_lost_rank
