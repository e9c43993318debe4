! SPDX-License-Identifier: MIT
!> Size of the first step under error control, and recording of local errors.
submodule(tandem_simulation:tandem_simulate_steps) tandem_simulate_step_notes
    implicit none (type, external)

contains

    module procedure choose_first_step
        real(wp) :: h, size_y, size_f, change
        integer :: stat

        associate (state => self%state, next => self%next, control => self%control, unit => self%model%time_scale)
            call control%set_weights(state%q, state%q, state%qd, state%qd)
            size_y = weighted_norm(state%q, state%qd, control%weight_q, control%weight_qd)
            size_f = weighted_norm(state%qd, state%qdd, control%weight_q, control%weight_qd)
            ! In units of the time scale.
            size_f = size_f*unit
            h = 1.0e-6_wp*unit
            if (size_y > 1.0e-5_wp .and. size_f > 1.0e-5_wp) h = 0.01_wp*unit*size_y/size_f
            h = min(h, 0.1_wp*span)
            ! Change of the rates in an explicit Euler step.
            next%dq = state%dq + h*state%qd
            next%dqd = state%dqd + h*state%qdd
            call self%chart%restore(state%t + h, next%dq, next%dqd, step_end, next%q, next%qd, stat)
            if (stat == status_ok) call self%chart%accelerate(state%t + h, next%q, next%qd, step_end, next%qdd, stat)
            if (stat == status_ok) then
                change = weighted_norm(next%qd - state%qd, next%qdd - state%qdd, control%weight_q, control%weight_qd)*(unit/h)*unit
                change = 0.01_wp/max(size_f, change, 1.0e-15_wp)
                if (self%auto%switching%is_on) self%auto%switching%first_step = min(100*h, span, &
                    unit*change**(1.0_wp/(self%auto%switching%estimate_order + 1)))
                h = min(100*h, unit*change**(1.0_wp/(self%method%estimate_order + 1)))
            end if
            control%h = control%limit(min(h, span))
        end associate
    end procedure choose_first_step

    module procedure note_local_error
        logical :: is_complete
        real(wp) :: relative, filtered, gap

        associate (local => self%local_error)
            gap = 0.0_wp
            if (.not. self%lost_rank%is_close(self%chart)) gap = local%jump(self%state, self%next, self%method%order, &
                self%tally%velocity_gap)
            if (gap > self%tally%velocity_gap) then
                self%tally%velocity_gap = gap
                self%tally%t_gap = self%next%t
            end if
            if (present(norm) .and. self%options%has_one_tolerance()) then
                call local%add(norm*self%options%rtol, 1)
            else if (present(norm) .or. self%method%order > 5) then
                call local%set_weights(self%next)
                call self%stepper%estimate(self%chart, h, local%weight_q, local%weight_qd, relative)
                call local%add(relative, 1)
            else
                call local%extend(self%state, self%next, is_complete)
                if (.not. is_complete) return
                relative = local%size_of_window(self%next)
                if (self%method%implicit) then
                    ! Stiff modes have rates that are large compared with their changes. The filter removes their errors, but also
                    ! the errors of dependent velocities, so that it is used only if it removes almost all of the error.
                    call filter_error(self%chart, local%error_q, local%error_qd)
                    filtered = local%size_of_window(self%next)
                    if (filtered < 0.1_wp*relative) relative = filtered
                end if
                call local%add(relative, steps_of_window)
                if (self%options%intol > 0.0_wp) return
                call self%stepper%learn_error(local%largest_part(self%next, local%error_q, local%error_qd)/steps_of_window)
            end if
        end associate
    end procedure note_local_error
end submodule tandem_simulate_step_notes
