! SPDX-License-Identifier: MIT
!> What there is to see of the motion: the dense output at times within the last step, and at any state looked at its multipliers
!> and energies. Looking takes no part in the integration.
submodule(tandem_simulation) tandem_simulate_dense_output
    use tandem_model_timer, only: of_kinetic_energy, of_potential_energy
    implicit none (type, external)

contains

    module procedure look_at
        integer :: rows(3), stat

        call self%check_ready(error)
        if (allocated(error)) return
        if (.not. self%is_looking) then
            call self%kept%copy(self%state)
            self%kept_errors = self%errors
            self%kept_segment = self%model%segment
            if (self%has_step) call self%chart%hold()
            if (.not. allocated(self%slope)) allocate (self%slope(self%model%n, 2))
        end if
        self%is_looking = .true.
        if (abs(t - self%kept%t) <= 0.0_wp) then
            call self%look_back()
            return
        end if
        if (.not. self%has_step .or. .not. (t >= self%start%t .and. t <= self%kept%t)) then
            call self%look_back()
            call set_error(error, status_invalid_option, 't = '//to_text(t)//' is not within the last step', &
                'ask for times that the last step has passed')
            return
        end if
        if (self%model%segment /= self%segment_of_step) then
            self%model%segment = self%segment_of_step
            call self%chart%forget()
        end if
        associate (state => self%state, chart => self%chart, slope => self%slope)
            state%t = t
            call self%stepper%interpolate(chart, self%start, self%next, t, state%dq, state%dqd, slope(:, 1), slope(:, 2), stat)
            if (stat == status_ok) then
                call follow_states(self, t, state%q, state%qd)
                call chart%restore_near(t, state%q, state%qd, stat)
            end if
            if (stat == status_ok) call chart%solve_dynamics(t, state%q, state%qd, state%qdd, stat)
            if (stat == status_ok) then
                call chart%constraint_errors(t, state%q, state%qd, state%qdd, self%errors, rows, stat)
            end if
        end associate
        if (stat == status_ok) then
            call note_dense_error(self)
            return
        end if
        call self%fail(stat, 'between steps at t = '//to_text(t), error)
        call self%look_back()
    end procedure look_at

    !> The point and the velocity of interpolated increments. Increments are the motion itself but for what the constraints have
    !> taken of it since the chart's origin, at both ends of the step; between them that is taken in proportion to time. So the
    !> curve meets the states at both ends, and is beside the manifold by no more than the error of the interpolant.
    subroutine follow_states(self, t, q, qd)
        class(simulation_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(out), contiguous :: q(:), qd(:)
        real(wp) :: h, x, off
        integer :: i

        h = self%next%t - self%start%t
        x = (t - self%start%t)/h
        associate (a => self%start, b => self%next, state => self%state, slope => self%slope)
            do i = 1, size(q)
                off = (b%q(i) - a%q(i)) - (b%dq(i) - a%dq(i))
                q(i) = a%q(i) + (state%dq(i) - a%dq(i)) + x*off
                slope(i, 1) = slope(i, 1) + off/h
                off = (b%qd(i) - a%qd(i)) - (b%dqd(i) - a%dqd(i))
                qd(i) = a%qd(i) + (state%dqd(i) - a%dqd(i)) + x*off
                slope(i, 2) = slope(i, 2) + off/h
            end do
        end associate
    end subroutine follow_states

    !> Take note of how well the dense output at the current state solves the equations of motion, from the slope of the
    !> interpolated increments against the rates there. Interpolants agree with the motion at both ends, so that what a quarter of
    !> the step leaves at this rate is their error. Takes no evaluation of the model.
    subroutine note_dense_error(self)
        class(simulation_type), intent(inout) :: self
        real(wp) :: error, filtered, quarter

        quarter = 0.25_wp*(self%next%t - self%start%t)
        associate (slope => self%slope, local => self%local_error, state => self%state)
            slope(:, 1) = quarter*(slope(:, 1) - state%qd)
            slope(:, 2) = quarter*(slope(:, 2) - state%qdd)
            call self%chart%keep_tangent(slope(:, 1), slope(:, 2))
            error = local%largest_part(state, slope(:, 1), slope(:, 2))
            if (self%method%implicit) then
                ! As for local errors: a stiff mode has a rate that is large against what it is off by.
                call self%chart%filter_error(slope(:, 1), slope(:, 2))
                filtered = local%largest_part(state, slope(:, 1), slope(:, 2))
                if (filtered < 0.1_wp*error) error = filtered
            end if
            self%tally%dense_error = max(self%tally%dense_error, error)
        end associate
    end subroutine note_dense_error

    module procedure look_back
        if (.not. self%is_looking) return
        self%is_looking = .false.
        call self%state%copy(self%kept)
        self%errors = self%kept_errors
        if (.not. self%has_step) return
        call self%chart%release()
        if (self%model%segment == self%kept_segment) return
        self%model%segment = self%kept_segment
        call self%chart%forget()
    end procedure look_back

    module procedure multipliers
        integer :: stat

        lambda = 0.0_wp
        if (self%is_ready) call self%chart%multipliers(self%state%t, self%state%q, self%state%qd, self%state%qdd, lambda, stat)
    end procedure multipliers

    module procedure kinetic_energy
        energy = 0.0_wp
        stat = status_invalid_option
        if (.not. self%is_ready) return
        if (associated(self%model%kinetic_energy)) then
            self%chart%counts%kinetic_energies = self%chart%counts%kinetic_energies + 1
            if (associated(self%model%timer)) call self%model%timer%begin_call(of_kinetic_energy)
            call self%model%kinetic_energy(self%state%q, self%state%qd, energy, stat)
            if (associated(self%model%timer)) call self%model%timer%end_call()
        else
            call self%chart%kinetic_energy(self%state%t, self%state%q, self%state%qd, energy, stat)
        end if
    end procedure kinetic_energy

    module procedure potential_energy
        energy = 0.0_wp
        stat = status_invalid_option
        if (.not. self%is_ready) return
        self%chart%counts%potential_energies = self%chart%counts%potential_energies + 1
        if (associated(self%model%timer)) call self%model%timer%begin_call(of_potential_energy)
        call self%model%potential_energy(self%state%t, self%state%q, energy, stat)
        if (associated(self%model%timer)) call self%model%timer%end_call()
    end procedure potential_energy
end submodule tandem_simulate_dense_output
