! SPDX-License-Identifier: MIT
!> The motion behind a singular configuration, and its error: by collocation on both sides of it, or by extrapolation of the states
!> before it (theory, section 25).
submodule(tandem_simulation:tandem_simulate_crossing) tandem_simulate_crossing_motion
    implicit none (type, external)

contains

    module procedure continue_from
        real(wp) :: distance
        integer :: n_nodes

        error = huge(1.0_wp)
        associate (crossing => self%crossing)
            distance = crossing%record%t - crossing%recent%t(base)
            call choose_end(self, distance, stop_at)
            if (.not. crossing%record%t_to > crossing%record%t) return
            if (gap > 0.0_wp) then
                distance = 0.5_wp*(crossing%record%t_to - crossing%recent%t(base))
                call pass_through(self, base, gap*distance, n_nodes)
                if (n_nodes < 2) then
                    crossing%obstacle = 'the run has too few steps before it'
                    return
                end if
                call extrapolate(self, base, gap*distance, error)
            else
                call collocate(self, base, error)
            end if
            crossing%record%error = error
            crossing%record%t_from = self%state%t
        end associate
    end procedure continue_from

    !> The state behind the configuration by collocation: the polynomial satisfies the equations of motion on both sides of it. The
    !> error is that of the polynomial without the nearest times, along the manifold.
    subroutine collocate(self, base, error)
        class(simulation_type), intent(inout) :: self
        integer, intent(in) :: base
        real(wp), intent(inout) :: error
        !> Times, relative to the distances of the base and of the end from the configuration; the nearest ones.
        real(wp), parameter :: before(4) = [0.8_wp, 0.6_wp, 0.4_wp, 0.2_wp], behind(5) = [0.2_wp, 0.4_wp, 0.6_wp, 0.8_wp, 1.0_wp]
        integer, parameter :: nearest(2) = [5, 6]
        !> Largest relative change of an iteration that has converged; part of a sufficient error that it may leave; smallest factor
        !> from one difference to the next.
        real(wp), parameter :: converged = 1.0e-3_wp, left_part = 0.1_wp, least_fall = 0.1_wp
        real(wp) :: change, off, coarse, fine
        integer :: stat

        associate (crossing => self%crossing, state => self%crossing%trial, predicted => self%crossing%predicted, &
            t => self%crossing%record%t, t_from => self%crossing%recent%t(base), t_to => self%crossing%record%t_to)
            if (crossing%rate*behind(1)*min(t - t_from, t_to - t) < least_part*self%chart%best_independence) return
            call crossing%recent%get(base, crossing%values)
            call crossing%collocation%begin(t_from, crossing%values(:, 1), crossing%values(:, 2), [t - before*(t - t_from), &
                t + behind*(t_to - t)], crossing%values(:, 3))
            call crossing%collocation%iterate(self%chart, self%local_error, 1 + size(before), left_part*sufficient_error(self), &
                crossing%curve, state, predicted, change, off, stat)
            if (stat /= status_ok .or. .not. change <= converged) return
            crossing%apart = 0.0_wp
            crossing%spread = off
            call crossing%curve%evaluate(t_to, predicted%q, predicted%qd, predicted%qdd)
            predicted%dq(:) = predicted%q - state%q
            predicted%dqd(:) = predicted%qd - state%qd
            call note_spread(self)
            call crossing%collocation%find_difference(nearest(1) - 1, nearest(2) + 1, predicted%dq, predicted%dqd)
            coarse = self%local_error%largest_part(state, predicted%dq, predicted%dqd)
            call crossing%collocation%find_difference(nearest(1), nearest(2), predicted%dq, predicted%dqd)
            fine = self%local_error%largest_part(state, predicted%dq, predicted%dqd)
            ! Differences fall about as fast with the next two times.
            predicted%dq(:) = max(fine/coarse, least_fall)*predicted%dq
            predicted%dqd(:) = max(fine/coarse, least_fall)*predicted%dqd
            call note_spread(self)
            state%dq(:) = 0.0_wp
            state%dqd(:) = 0.0_wp
            call project_difference(self, base, change, error)
        end associate
    end subroutine collocate

    !> Choose the end of the step: at least as far behind the configuration as the base before it, on the grid of fixed steps, or at
    !> the next stop. A stop that is too near the configuration divides the step.
    subroutine choose_end(self, distance, stop_at)
        class(simulation_type), intent(inout) :: self
        real(wp), intent(in) :: distance, stop_at
        !> Part of the distance that may be left to the next stop; parts of the best independence, and number of fixed steps, from
        !> which steps can continue, since closer to the configuration charts have a shorter reach, and need not be further away.
        real(wp), parameter :: remainder = 0.2_wp, sound_part = 0.01_wp, far_part = 0.25_wp, fixed_steps = 2.0_wp
        real(wp) :: behind, sound

        associate (crossing => self%crossing, record => self%crossing%record)
            sound = sound_part*self%chart%best_independence/crossing%rate
            behind = max(min(distance, far_part*self%chart%best_independence/crossing%rate), sound)
            if (.not. self%options%is_adaptive()) behind = max(behind, fixed_steps*self%options%step)
            record%t_to = record%t + behind
            if (.not. self%options%is_adaptive()) record%t_to = self%t_start + self%options%step* &
                real(ceiling((record%t_to - self%t_start)/self%options%step, long), wp)
            if (record%t_to + remainder*behind > stop_at .and. stop_at - record%t >= sound) record%t_to = stop_at
        end associate
    end subroutine choose_end

    !> The state behind the configuration: the polynomial, projected onto the constraints, and corrected by the accelerations there.
    !> The correction, and the way back to the base from the state found, give the error. Near the configuration states are
    !> uncertain in the direction in which its branches separate. The projection removes this part of the error, up to the angle by
    !> which the direction turns, about the part of the independence at the base.
    subroutine extrapolate(self, base, gap, error)
        class(simulation_type), intent(inout) :: self
        integer, intent(in) :: base
        !> Least time between states.
        real(wp), intent(in) :: gap
        real(wp), intent(inout) :: error
        real(wp) :: forwards
        integer :: i, pass, stat
        logical :: is_back

        associate (crossing => self%crossing, state => self%crossing%trial, predicted => self%crossing%predicted)
            state%t = crossing%record%t_to
            predicted%t = state%t
            call crossing%curve%evaluate(state%t, predicted%q, predicted%qd, predicted%qdd)
            call state%copy(predicted)
            do pass = 1, 2
                if (pass == 2) then
                    state%dq(:) = state%q
                    state%dqd(:) = state%qd
                    call crossing%curve%add_acceleration(state%t, state%qdd)
                    call crossing%curve%evaluate(state%t, state%q, state%qd, state%qdd)
                end if
                call self%chart%project(state%t, state%q, state%qd, .true., stat, exactly=.true.)
                if (stat == status_ok) call self%chart%accelerate(state%t, state%q, state%qd, step_end, state%qdd, stat)
                if (stat /= status_ok) then
                    crossing%obstacle = 'no state behind it was found that satisfies the constraints'
                    return
                end if
            end do
            do i = 1, size(state%q)
                state%dq(i) = state%q(i) - state%dq(i)
                state%dqd(i) = state%qd(i) - state%dqd(i)
                predicted%dq(i) = state%q(i) - predicted%q(i)
                predicted%dqd(i) = state%qd(i) - predicted%qd(i)
            end do
            crossing%spread = 0.0_wp
            crossing%apart = 0.0_wp
            call note_spread(self)
            forwards = self%local_error%largest_part(state, state%dq, state%dqd)
            call go_back(self, base, gap, is_back)
            if (.not. is_back) return
            call note_spread(self)
            call project_difference(self, base, forwards, error)
        end associate
    end subroutine extrapolate

    !> The error from a difference of the state in `predicted`, along the manifold, and other estimates of it.
    subroutine project_difference(self, base, least, error)
        class(simulation_type), intent(inout) :: self
        integer, intent(in) :: base
        !> An error known otherwise.
        real(wp), intent(in) :: least
        !> Unchanged if the difference has no projection.
        real(wp), intent(inout) :: error
        integer :: i, stat

        associate (crossing => self%crossing, state => self%crossing%trial, predicted => self%crossing%predicted)
            predicted%q(:) = state%q + predicted%dq
            predicted%qd(:) = state%qd + predicted%dqd
            call self%chart%project(state%t, predicted%q, predicted%qd, .true., stat, exactly=.true.)
            if (stat /= status_ok) return
            predicted%dq(:) = predicted%q - state%q
            predicted%dqd(:) = predicted%qd - state%qd
            error = max(least, self%local_error%largest_part(state, predicted%dq, predicted%dqd), crossing%spread* &
                crossing%rate*(crossing%record%t - crossing%recent%t(base))/self%chart%best_independence)
            do i = 1, size(state%q)
                if (abs(predicted%dq(i)) > abs(state%dq(i))) state%dq(i) = predicted%dq(i)
                if (abs(predicted%dqd(i)) > abs(state%dqd(i))) state%dqd(i) = predicted%dqd(i)
            end do
        end associate
    end subroutine project_difference

    !> Note a difference between two states in all directions, in `predicted`.
    subroutine note_spread(self)
        class(simulation_type), intent(inout) :: self

        associate (crossing => self%crossing, there => self%crossing%predicted)
            crossing%spread = max(crossing%spread, self%local_error%largest_part(crossing%trial, there%dq, there%dqd))
            crossing%apart(1) = max(crossing%apart(1), self%model%largest_on_scales(there%dq))
            crossing%apart(2) = max(crossing%apart(2), self%model%largest_on_scales(there%dqd))
        end associate
    end subroutine note_spread

    !> The way back: the polynomial through the state behind the configuration and through the states before the base, at the base.
    subroutine go_back(self, base, gap, is_back)
        class(simulation_type), intent(inout) :: self
        integer, intent(in) :: base
        real(wp), intent(in) :: gap
        logical, intent(out) :: is_back
        real(wp) :: last
        integer :: i, n_nodes

        associate (crossing => self%crossing, recent => self%crossing%recent, state => self%crossing%trial)
            call crossing%back%begin(state%t, state%q)
            call crossing%back%add_state(state%t, state%qd, state%qdd)
            n_nodes = 1
            last = recent%t(base)
            do i = base + 1, recent%n
                if (last - recent%t(i) < gap) cycle
                call recent%get(i, crossing%values)
                call crossing%back%add_state(recent%t(i), crossing%values(:, 2), crossing%values(:, 3))
                last = recent%t(i)
                n_nodes = n_nodes + 1
                if (n_nodes == most_nodes) exit
            end do
            is_back = n_nodes > 2
            if (.not. is_back) return
            call recent%get(base, crossing%values)
            associate (there => crossing%predicted)
                call crossing%back%evaluate(recent%t(base), there%dq, there%dqd, there%qdd)
                there%dq(:) = there%dq - crossing%values(:, 1)
                there%dqd(:) = there%dqd - crossing%values(:, 2)
            end associate
        end associate
    end subroutine go_back
end submodule tandem_simulate_crossing_motion
