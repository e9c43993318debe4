! SPDX-License-Identifier: MIT
!> What the steps of a simulation tell of a loss of rank, behind which the motion is not determined.
submodule(tandem_simulation) tandem_simulate_lost_rank
    implicit none (type, external)

    !> The statuses of a motion that is no longer determined.
    integer, parameter :: losses(2) = [status_rank_deficient, status_singular_mass]

contains

    !> Whether C has lost rank between the current state and the next: behind such a step the motion is not determined.
    module procedure check_rank
        real(wp) :: room

        associate (state => self%state, next => self%next)
            call self%chart%measure_rank(state%t, state%q, next%t, next%q, room, stat)
            if (stat == status_ok .and. .not. room > 0.0_wp) stat = status_rank_deficient
            ! What turns that far may hide it.
            if (stat == status_chart_left) call look_for_lost_rank(self, next%t - state%t, stat)
            ! What a step has found that is not kept says nothing of the next.
            if (stat /= status_ok) return
            self%room = room
            if (room < huge(1.0_wp)) self%room = room*(next%t - state%t)
        end associate
    end procedure check_rank

    module procedure look_for_lost_rank
        integer :: loss

        if (all(stat /= [status_position_diverged, status_chart_left, status_newton_failed])) return
        associate (state => self%state, next => self%next)
            ! From a little behind, since the state may lie just beyond, and further, since the way bends and stages are the first
            ! to notice; those that are solved together notice two steps before.
            next%q = state%q - h*state%qd
            loss = self%chart%loss_ahead(state%t - h, next%q, state%qd, 4.0_wp*h)
            if (loss /= status_ok) stat = loss
        end associate
    end procedure look_for_lost_rank

    module procedure remember_loss
        if (all(stat /= [losses, status_position_diverged, status_chart_left, status_newton_failed])) return
        if (self%state%t > self%loss_until .or. all(self%loss /= losses)) self%loss = stat
        self%loss_until = max(self%loss_until, self%next%t + h)
    end procedure remember_loss

    !> Whether the step to the next state, shorter than one that was given up, has turned off there onto another branch: its
    !> velocity has changed of itself, without an acceleration, and C with it. Where a row of C vanishes, branches cross. Its
    !> direction, which is what the other measures see, need not come near dependence then, and the orientation may be kept. A
    !> step that is merely too long changes its velocity less when it is shorter, and a jump of nu leaves C as it is.
    module procedure turns_off
        !> Relative to the velocity; what steps that meet usual tolerances leave is far below.
        real(wp), parameter :: least_gap = 1.0e-3_wp
        real(wp) :: gap

        turns_off = .false.
        if (self%state%t > self%loss_until) return
        gap = self%local_error%gap(self%state, self%next)
        if (gap > least_gap) turns_off = self%chart%relative_change() > gap
    end procedure turns_off
end submodule tandem_simulate_lost_rank
