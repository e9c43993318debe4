! SPDX-License-Identifier: MIT
!> Renewals between the steps of a simulation: the chart, if the policy or a failure requires it, and at a breakpoint the motion
!> from there.
submodule(tandem_simulation) tandem_simulate_renewal
    implicit none (type, external)

contains

    module procedure allocate_chart
        if (allocated(self%chart)) deallocate (self%chart)
        if (allocated(self%own%chart)) then
            allocate (self%chart, source=self%own%chart)
        else
            call new_chart(self%is_sparse, self%chart)
        end if
        call self%lost_rank%forget_measure()
    end procedure allocate_chart

    module procedure renew_chart
        integer :: stat

        call self%move_origin(stat)
        if (stat /= status_ok) then
            call self%fail(stat, 'at a new chart at t = '//to_text(self%state%t), error)
            return
        end if
        if (self%tally%charts == 0) self%state%dq(:) = 0.0_wp
        self%state%dqd(:) = 0.0_wp
        self%renewal%is_done = .true.
        self%tally%charts_by(reason) = self%tally%charts_by(reason) + 1
        self%tally%charts = self%tally%charts + 1
    end procedure renew_chart

    module procedure move_origin
        call self%chart%set_origin(self%state%t, self%state%q, self%state%qd, .false., self%state%dq, stat)
        if (.not. self%chart%wants_other_rows()) return
        call self%choose_rows_anew(stat)
        ! If no choice of rows is independent, all rows lose rank ahead.
        if (self%chart%is_firm()) call self%lost_rank%forget_ahead()
    end procedure move_origin

    module procedure renew_by_policy
        type(measure_type) :: measure
        !> The secant of 70 degrees, which ends a chart of implicit steps for all limits of the paper, and a chart of explicit steps
        !> if these are off.
        real(wp), parameter :: farthest = 3.0_wp
        integer :: stat

        if (self%renewal%is_done) return
        if (self%renewal%reason == 0 .and. self%chart%n_dropped > 0) then
            if (self%lost_rank%is_ahead()) self%renewal%reason = by_failure
        end if
        if (self%renewal%reason /= 0) then
            call self%renew_chart(self%renewal%reason, error)
            self%renewal%reason = 0
            return
        end if
        associate (options => self%options)
            if (options%chart == 'every_step') then
                call self%renew_chart(by_step, error)
                return
            end if
            call self%chart%measure(need_policy, self%state%t, self%state%q, self%state%t, self%state%q, self%state%qd, &
                measure, stat)
            if (stat /= status_ok) then
                call self%fail(stat, 'before the step from t = '//to_text(self%state%t), error)
                return
            end if
            if (options%chart == 'adaptive') then
                if (.not. measure%d <= options%secant_limit) then
                    call self%renew_chart(by_d, error)
                else if (.not. measure%fbar <= options%secant_limit) then
                    call self%renew_chart(by_fbar, error)
                end if
            else
                if (options%v_limit > 0.0_wp .and. measure%v > options%v_limit) then
                    call self%renew_chart(by_v, error)
                else if (options%w_limit > 0.0_wp .and. measure%w > options%w_limit) then
                    call self%renew_chart(by_w, error)
                else if (options%condition_limit > 0.0_wp .and. .not. measure%condition <= options%condition_limit) then
                    call self%renew_chart(by_condition, error)
                else if (options%iteration_limit > 0 .and. measure%corrections > options%iteration_limit) then
                    call self%renew_chart(by_iterations, error)
                else if (.not. measure%d <= farthest) then
                    call self%renew_chart(by_d, error)
                else if (.not. measure%fbar <= farthest) then
                    call self%renew_chart(by_fbar, error)
                end if
            end if
        end associate
        if (allocated(error) .or. self%renewal%is_done) return
        call self%chart%set_origin(self%state%t, self%state%q, self%state%qd, .true., self%state%dq, stat)
        if (stat /= status_ok) call self%fail(stat, 'before the step from t = '//to_text(self%state%t), error)
    end procedure renew_by_policy

    module procedure cross_breakpoint
        real(wp) :: qd(size(self%state%qd)), qdd(size(self%state%qd))
        logical :: jumps, is_done
        integer :: stat

        ! The end of the next segment determines the smooth pieces within it.
        call self%model%know_breakpoints(self%model%segment + 1, error)
        if (allocated(error)) return
        call self%part_end()
        associate (model => self%model, state => self%state)
            qd = state%qd
            qdd = state%qdd
            jumps = .false.
            if (allocated(model%nu_jumps)) jumps = model%nu_jumps(model%segment)
            model%segment = model%segment + 1
            call self%control%restart()
            call self%between%control%begin()
            call self%local_error%restart()
            call self%crossing%forget()
            call self%auto%stiffness%smoothness%restart()
            call self%chart%forget(.false.)
            stat = status_ok
            if (jumps) then
                call self%chart%project(state%t, state%q, state%qd, .false., stat)
                self%tally%velocity_jump = max(self%tally%velocity_jump, maxval(abs(state%qd - qd)))
            end if
            is_done = .false.
            if (stat == status_ok .and. .not. jumps) call self%continue_on_branch(is_done)
            if (stat == status_ok .and. .not. is_done) call self%chart%accelerate(state%t, state%q, state%qd, step_end, state%qdd, &
                stat)
            ! The chart of the step that ends here is kept for its dense output until the next step.
            self%renewal%reason = by_breakpoint
            self%attempts%n_collapsed = 0
            call self%attempts%slowing%restart()
            call self%watch%forget_values()
            if (stat == status_ok) then
                call self%measure_errors(error)
            else
                call self%fail(stat, 'at the breakpoint t = '//to_text(state%t), error)
            end if
            if (.not. allocated(error)) then
                if (.not. is_done) call self%crossing%note(state)
                return
            end if
            model%segment = model%segment - 1
            call self%chart%forget(.false.)
            state%qd(:) = qd
            state%qdd(:) = qdd
        end associate
    end procedure cross_breakpoint
end submodule tandem_simulate_renewal
