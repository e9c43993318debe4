! SPDX-License-Identifier: MIT
!> The actions of events, and the restart after them: the position must be on the constraints, the velocity is brought there in the
!> mass metric. Whether an action sends the motion back is measured, so that one that does so for shorter than can be seen is
!> not taken for one that lets it through.
submodule(tandem_simulation) tandem_simulate_event_actions
    implicit none (type, external)

contains

    !> Take the actions that are due, in the order of the events' numbers, and make the motion ready to go on.
    module procedure act_on_events
        real(wp) :: reach
        integer :: i

        self%has_to_act = .false.
        call self%kept%copy(self%state)
        self%kept_errors = self%errors
        do i = 1, size(self%watched)
            if (.not. self%watched(i)%is_due) cycle
            call measure_rate(self, i, reach)
            self%watched(i)%reach = reach
            self%watched(i)%value_before = self%watched(i)%value
        end do
        do i = 1, size(self%watched)
            if (.not. self%watched(i)%is_due) cycle
            self%watched(i)%is_due = .false.
            self%watched(i)%is_sent_back = self%watched(i)%reach*self%watched(i)%direction > 0.0_wp
            call self%watched(i)%event%act(self%model, self%state%t, self%state%q, self%state%qd, error)
            if (allocated(error)) exit
        end do
        if (.not. allocated(error)) call restart_here(self, error)
        if (.not. allocated(error)) call self%renew_values(error)
        if (allocated(error)) then
            call self%state%copy(self%kept)
            self%errors = self%kept_errors
            return
        end if
        do i = 1, size(self%watched)
            if (self%watched(i)%is_sent_back) call judge_action(self, i)
        end do
    end procedure act_on_events

    !> How far g would go in a step as long as the last: a difference along the motion, the multipliers as they are.
    subroutine measure_rate(self, number, reach)
        class(simulation_type), intent(inout) :: self
        integer, intent(in) :: number
        real(wp), intent(out) :: reach
        real(wp), parameter :: part = 1.0e-3_wp
        real(wp) :: h, value, value_ahead
        integer :: stat

        associate (event => self%watched(number)%event, state => self%state)
            reach = 0.0_wp
            h = part*(self%next%t - self%start%t)
            call event%evaluate(state%t, state%q, state%qd, self%lambda, value, stat)
            if (stat /= 0) return
            call event%evaluate(state%t + h, state%q + h*state%qd, state%qd + h*state%qdd, self%lambda, value_ahead, stat)
            self%tally%event_evaluations = self%tally%event_evaluations + 2
            if (stat == 0 .and. ieee_is_finite(value_ahead - value)) reach = (value_ahead - value)/part
        end associate
    end subroutine measure_rate

    !> Has the action sent g back to where it came from, at this zero?
    subroutine judge_action(self, number)
        class(simulation_type), intent(inout) :: self
        integer, intent(in) :: number
        real(wp) :: reach_after

        call measure_rate(self, number, reach_after)
        associate (watched => self%watched(number))
            watched%is_sent_back = reach_after*watched%direction <= 0.0_wp .and. &
                abs(watched%value) <= max(1.0e-9_wp*abs(watched%reach), 4*abs(watched%value_before))
            watched%reach = abs(watched%reach)
            watched%judged_until = self%state%t + (self%next%t - self%start%t)
        end associate
    end subroutine judge_action

    !> After an action: the position must be on the constraints, the velocity is brought there, the acceleration is made anew.
    subroutine restart_here(self, error)
        class(simulation_type), intent(inout) :: self
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: before(size(self%state%qd))
        integer :: rows(3), stat

        before = self%state%qd
        associate (state => self%state, chart => self%chart)
            if (.not. (all(ieee_is_finite(state%q)) .and. all(ieee_is_finite(state%qd)))) then
                call set_error(error, status_not_finite, 'an event at t = '//to_text(state%t)//' has made the state infinite', &
                    'see what its action computes')
                return
            end if
            call self%control%restart()
            call self%local_error%restart()
            call self%stiffness%smoothness%restart()
            ! Where a loss of rank was ahead before, it need not be so now.
            self%room = huge(1.0_wp)
            call chart%forget_model()
            call chart%solve_dynamics(state%t, state%q, state%qd, state%qdd, stat)
            if (stat == status_ok) call chart%constraint_errors(state%t, state%q, state%qd, state%qdd, self%errors, rows, stat)
            if (stat == status_ok .and. self%errors(1) > self%options%constraint_tolerance) then
                call set_error(error, status_inconsistent_start, 'an event at t = '//to_text(state%t)// &
                    ' has moved the position off the constraint "'//self%model%row_name(rows(1))//'" by '// &
                    to_text(self%errors(1))//' of its natural scale', 'let its action leave the position on the constraints')
                return
            end if
            if (stat == status_ok .and. self%errors(2) > 0.01_wp*self%options%constraint_tolerance) then
                call chart%project_velocity(state%t, state%q, state%qd, stat)
                if (stat == status_ok) call chart%solve_dynamics(state%t, state%q, state%qd, state%qdd, stat)
                if (stat == status_ok .and. allocated(self%model%impulses)) call find_impulses(self, before, stat)
            end if
            self%tally%velocity_jump = max(self%tally%velocity_jump, maxval(abs(state%qd - self%kept%qd)))
            if (stat /= status_ok) then
                call self%fail(stat, 'after the event at t = '//to_text(state%t), error)
                return
            end if
        end associate
        call self%measure_errors(error)
    end subroutine restart_here

    !> The impulses that have brought the velocity onto the constraints, M (qd - before) = -C' impulse. Multipliers are linear in
    !> the acceleration that they are asked for.
    subroutine find_impulses(self, before, stat)
        class(simulation_type), intent(inout) :: self
        !> Velocities before they were brought there (n).
        real(wp), intent(in) :: before(:)
        integer, intent(out) :: stat
        real(wp) :: jump(size(before)), at_rest(size(self%model%impulses))

        associate (state => self%state, chart => self%chart)
            jump = 0.0_wp
            call chart%multipliers(state%t, state%q, state%qd, jump, at_rest, stat)
            if (stat /= status_ok) return
            jump = state%qd - before
            call chart%multipliers(state%t, state%q, state%qd, jump, self%model%impulses, stat)
            self%model%impulses = self%model%impulses - at_rest
        end associate
    end subroutine find_impulses
end submodule tandem_simulate_event_actions
