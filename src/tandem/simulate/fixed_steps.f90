! SPDX-License-Identifier: MIT
!> Fixed steps on a grid.
submodule(tandem_simulation:tandem_simulate_steps) tandem_simulate_fixed_steps
    implicit none (type, external)

contains

    module procedure try_fixed_step
        !> Part of a step by which its end may miss the grid.
        real(wp), parameter :: slack = 1.0e-6_wp
        logical :: ends_on_grid, is_crossed
        real(wp) :: h, stop_at
        integer :: stat

        self%crossing%is_last_step = .false.
        call next_time(self, t_limit, self%next%t, ends_on_grid, ends_at_breakpoint)
        h = self%next%t - self%state%t
        if (.not. h > 0.0_wp) then
            call set_error(error, status_step_underflow, 'from t = '//to_text(self%state%t)//' with step '// &
                to_text(self%options%step)//' towards '//to_text(t_limit))
            return
        end if
        is_crossed = self%crossing%starts
        if (is_crossed) then
            call find_stop(self, t_limit, stop_at, ends_at_breakpoint)
            call self%leave_start(stop_at, error)
        else
            call renew_by_policy(self, error)
            if (.not. allocated(error)) call take_fixed_step(self, h, t_limit, is_crossed, stat)
        end if
        if (allocated(error)) return
        if (is_crossed) then
            call find_stop(self, t_limit, stop_at, ends_at_breakpoint)
            ends_at_breakpoint = ends_at_breakpoint .and. self%next%t >= stop_at
            self%grid_steps = int((self%next%t - self%t_start)/self%options%step + slack, long)
            self%on_grid = abs(self%next%t - self%t_start - self%grid_steps*self%options%step) <= slack*self%options%step
            return
        end if
        if (stat /= status_ok) then
            call self%fail(stat, 'in the step from t = '//to_text(self%state%t)//' with h = '//to_text(h), error, &
                merge(in_first_step, in_step, self%tally%steps == 0))
            ! A shorter step that follows must not depend on this one.
            call self%chart%set_memory()
            if (has_spoilt(self, stat)) then
                self%renewal%is_done = .false.
                self%renewal%reason = by_failure
            end if
            return
        end if
        call note_local_error(self, h)
        if (.not. self%attempts%has_overlooked) call look_between(self)
        self%on_grid = ends_on_grid
        if (ends_on_grid) self%grid_steps = self%grid_steps + 1
    end procedure try_fixed_step

    !> A step of size h, or one over a singular configuration.
    subroutine take_fixed_step(self, h, t_limit, is_crossed, stat)
        class(simulation_type), intent(inout) :: self
        real(wp), intent(in) :: h, t_limit
        logical, intent(out) :: is_crossed
        integer, intent(out) :: stat
        real(wp) :: room, stop_at
        logical :: is_loss, is_breakpoint

        stat = status_ok
        is_loss = .false.
        is_crossed = .false.
        call find_stop(self, t_limit, stop_at, is_breakpoint)
        if (self%lost_rank%limits(0.75_wp*h, room)) call self%consider_crossing(2*max(room, h), stop_at, is_loss, is_crossed)
        if (is_crossed) return
        call self%lost_rank%look_within(self%chart, self%state, h, stat)
        ! The line shows no loss of two ranks at once.
        if (stat == status_ok .and. is_loss .and. .not. self%crossing%passes) then
            if (self%crossing%record%t <= self%state%t + h) stat = status_rank_deficient
        end if
        if (stat == status_ok) then
            call self%stepper%advance(self%chart, self%state, h, self%next, stat)
            if (stat == status_ok) then
                if (self%local_error%has_jumped(self%state, self%next)) stat = status_position_diverged
            end if
            if (stat == status_ok) then
                call self%lost_rank%check(self%chart, self%state, self%next, stat)
            else
                call self%lost_rank%find_behind(self%chart, self%state, self%next, stat)
            end if
        end if
        if (stat == status_rank_deficient) call self%consider_crossing(2*h, stop_at, is_loss, is_crossed)
    end subroutine take_fixed_step

    !> Warn if the fixed step to self%next passes over values of functions of time.
    subroutine look_between(self)
        class(simulation_type), intent(inout) :: self

        self%attempts%has_overlooked = self%model%hides(self%state%t, self%next%t, self%method%stages > 2)
        if (.not. self%attempts%has_overlooked) return
        call self%warn('between t = '//to_text(self%state%t)//' and t = '//to_text(self%next%t)// &
            ' a function of time has values that the fixed step skips; set rtol, or take a smaller step')
    end subroutine look_between

    !> The end of the next step: the next point of the grid t_start + k h, cut at a breakpoint and at t_limit.
    subroutine next_time(self, t_limit, t, ends_on_grid, ends_at_breakpoint)
        class(simulation_type), intent(in) :: self
        real(wp), intent(in) :: t_limit
        real(wp), intent(out) :: t
        logical, intent(out) :: ends_on_grid, ends_at_breakpoint
        real(wp) :: stop_at, slack

        t = self%t_start + real(self%grid_steps + 1, wp)*self%options%step
        ends_on_grid = .true.
        call find_stop(self, t_limit, stop_at, ends_at_breakpoint)
        ! A negligible remainder is merged with the step before it.
        slack = max(1.0e-6_wp*self%options%step, 4.0_wp*spacing(abs(stop_at)))
        if (t >= stop_at - slack) then
            ends_on_grid = t <= stop_at + slack
            t = stop_at
        else
            ends_at_breakpoint = .false.
        end if
    end subroutine next_time
end submodule tandem_simulate_fixed_steps
