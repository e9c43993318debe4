! SPDX-License-Identifier: MIT
!> Events of a run. Events in a step are recorded in the order of their times, and the step is cut if an event requires this. After
!> an action the motion restarts: the position must satisfy the constraints, and the velocity is projected in the mass metric.
submodule(tandem_simulation) tandem_simulate_events
    use tandem_simulate_event_watch, only: curve_type
    use tandem_status, only: status_event_limit
    use tandem_stepper_state, only: go_between
    implicit none (type, external)

    !> The last step of a run as a curve, by its dense output.
    type, extends(curve_type) :: step_curve_type
        class(simulation_type), pointer :: run => null()
    contains
        procedure :: go_to, pass_through, multipliers => multipliers_there
    end type step_curve_type

contains

    module procedure add_event
        if (.not. self%is_ready) return
        call self%watch%add(event, self%model)
        if (.not. allocated(self%events)) allocate (self%events(0))
    end procedure add_event

    !> After an error without a cut, the step has not been searched to its end.
    module procedure look_for_events
        type(step_curve_type) :: curve
        real(wp) :: cut_at, at_once
        integer :: k
        logical :: may_happen

        is_cut = .false.
        is_refused = .false.
        call set_last_step(self, curve)
        call self%watch%rule_out(curve, may_happen)
        if (.not. may_happen) return
        call self%watch%search(curve, is_last, error)
        if (allocated(error)) then
            call self%look_back()
            return
        end if
        if (self%watch%found%n > 0 .and. self%options%is_adaptive() .and. .not. (self%between%next_look < self%state%t .or. &
            self%crossing%is_last_step)) then
            call self%look_back()
            call self%judge_between(is_refused)
            if (is_refused) then
                call self%watch%forget_search()
                return
            end if
        end if
        call self%watch%find_cut(curve, cut_at, at_once)
        is_cut = cut_at <= 1.0_wp
        associate (found => self%watch%found)
            do k = 1, found%n
                if (found%position(k) > cut_at) exit
                call record(self, curve, found%number(k), found%direction(k), found%position(k), error)
                if (.not. allocated(error)) cycle
                ! The run ends at the first event beyond the limit.
                is_cut = .true.
                call cut_step(self, found%position(k))
                return
            end do
        end associate
        if (is_cut) then
            call begin_events(self, curve, cut_at, at_once, error)
        else
            call self%look_back()
            call self%watch%pass(is_last)
        end if
    end procedure look_for_events

    !> Set the curve to the last step of the run.
    subroutine set_last_step(self, curve)
        class(simulation_type), intent(inout), target :: self
        type(step_curve_type), intent(out) :: curve

        curve%run => self
        curve%state => self%state
        curve%t_from = self%start%t
        curve%t_to = self%next%t
    end subroutine set_last_step

    subroutine go_to(self, x, error)
        class(step_curve_type), intent(inout) :: self
        real(wp), intent(in) :: x
        type(error_type), allocatable, intent(out) :: error

        if (x >= 1.0_wp) then
            call self%run%look_back()
        else
            call self%run%look_at(self%t_from + x*(self%t_to - self%t_from), error)
        end if
    end subroutine go_to

    subroutine pass_through(self, x, t, q, qd)
        class(step_curve_type), intent(in) :: self
        real(wp), intent(in) :: x
        real(wp), intent(out) :: t
        real(wp), intent(out), contiguous :: q(:), qd(:)

        associate (run => self%run)
            if (x >= 1.0_wp) then
                t = self%t_to
                q = run%state%q
                qd = run%state%qd
            else if (.not. x > 0.0_wp) then
                t = self%t_from
                q = run%start%q
                qd = run%start%qd
            else
                t = self%t_from + x*(self%t_to - self%t_from)
                call go_between(run%start, run%state, t, q, qd)
            end if
        end associate
    end subroutine pass_through

    subroutine multipliers_there(self, lambda)
        class(step_curve_type), intent(inout) :: self
        real(wp), intent(out), contiguous :: lambda(:)

        call self%run%multipliers(lambda)
    end subroutine multipliers_there

    !> Record an event. The curve moves the state of the same simulation.
    subroutine record(self, curve, number, direction, x, error)
        class(simulation_type), intent(inout), target :: self
        type(step_curve_type), intent(inout) :: curve
        integer, intent(in) :: number, direction
        real(wp), intent(in) :: x
        type(error_type), allocatable, intent(out) :: error
        type(event_record_type), allocatable :: longer(:)

        call curve%go_to(x, error)
        if (allocated(error)) return
        if (self%n_events >= self%options%max_events) then
            call set_error(error, status_event_limit, 'max_events = '//to_text(self%n_events)//' until t = '//to_text(self%state%t))
            return
        end if
        if (self%n_events == size(self%events)) then
            allocate (longer(max(16, 2*self%n_events)))
            longer(:self%n_events) = self%events
            call move_alloc(longer, self%events)
        end if
        self%n_events = self%n_events + 1
        associate (state => self%state)
            self%events(self%n_events) = event_record_type(number, self%watch%name(number), direction, state%t, state%q, state%qd)
        end associate
    end subroutine record

    !> End the step at the current state of the curve. The chart still stores the whole step, for dense output.
    subroutine cut_step(self, x)
        class(simulation_type), intent(inout) :: self
        real(wp), intent(in) :: x

        call self%part_end()
        if (.not. x > 0.0_wp) then
            call self%look_back()
            call self%state%copy(self%start)
        end if
        call self%between%output%discard_saved_state(self%chart)
        self%last_step = self%state%t - self%start%t
        self%renewal%reason = by_event
    end subroutine cut_step

    !> End the step at events: determine which events occur and their effects, and evaluate all functions.
    subroutine begin_events(self, curve, x, at_once, error)
        class(simulation_type), intent(inout), target :: self
        type(step_curve_type), intent(inout) :: curve
        !> Position of the cut; distance within which events are simultaneous.
        real(wp), intent(in) :: x, at_once
        type(error_type), allocatable, intent(out) :: error
        integer :: stopper
        logical :: is_endless

        call curve%go_to(x, error)
        if (allocated(error)) return
        call cut_step(self, x)
        call self%watch%settle(x, at_once, self%last_step > 4*spacing(abs(self%state%t)), stopper, is_endless)
        if (is_endless) then
            call set_error(error, status_event_limit, 'at t = '//to_text(self%state%t))
            return
        end if
        self%is_stopped = stopper > 0
        if (self%is_stopped) self%stopped_by = self%watch%name(stopper)
        call self%measure_errors(error)
        if (.not. allocated(error)) call self%watch%renew(curve, error)
    end subroutine begin_events

    !> Perform the actions that are due, in the order of the events' indices, and prepare the continuation of the motion.
    module procedure act_on_events
        type(step_curve_type) :: curve

        call self%part_end()
        call self%between%output%save_state(self%state, self%errors)
        call set_last_step(self, curve)
        call self%watch%prepare_actions(curve)
        call self%watch%act(self%model, self%state, error)
        if (.not. allocated(error)) call restart_here(self, error)
        if (.not. allocated(error)) call self%watch%renew(curve, error)
        if (allocated(error)) then
            call self%between%output%restore_state(self%state, self%errors)
            return
        end if
        call self%watch%check_actions(curve)
    end procedure act_on_events

    !> After an action: check that the position satisfies the constraints, project the velocity, and recompute the acceleration.
    subroutine restart_here(self, error)
        class(simulation_type), intent(inout) :: self
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: before(size(self%state%qd))
        integer :: rows(3), stat
        logical :: is_done

        before = self%state%qd
        if (.not. (all(ieee_is_finite(self%state%q)) .and. all(ieee_is_finite(self%state%qd)))) then
            call set_error(error, status_not_finite, 'an event at t = '//to_text(self%state%t)//' has made the state infinite', &
                'check its action')
            return
        end if
        call self%control%restart()
        call self%between%control%begin()
        call self%local_error%restart()
        call self%auto%stiffness%smoothness%restart()
        ! A predicted loss of rank may not apply after the action.
        call self%lost_rank%forget_ahead()
        call self%crossing%forget()
        call self%chart%forget(.true.)
        call self%energy%clear()
        call self%continue_on_branch(is_done)
        if (is_done) then
            call self%measure_errors(error)
            return
        end if
        stat = status_ok
        if (self%method%implicit) then
            ! Bases of implicit steps are complements of the rows before the action. C X may be singular for rows that the action
            ! locks or frees. The dense output of implicit steps does not depend on the origin of the chart.
            call self%move_origin(stat)
            self%state%dq(:) = 0.0_wp
            self%state%dqd(:) = 0.0_wp
        end if
        associate (state => self%state, chart => self%chart)
            if (stat == status_ok) call chart%accelerate(state%t, state%q, state%qd, step_end, state%qdd, stat)
            if (stat == status_ok) call chart%find_errors(state%t, state%q, state%qd, state%qdd, self%errors, rows, stat)
            if (stat == status_ok .and. self%errors(1) > self%options%constraint_tolerance) then
                call set_error(error, status_inconsistent_start, 'an event at t = '//to_text(state%t)// &
                    ' has moved the position away from the constraint "'//self%model%row_name(rows(1))//'" by '// &
                    to_text(self%errors(1))//' of its natural scale', 'make its action satisfy the constraints')
                return
            end if
            if (stat == status_ok .and. self%errors(2) > 0.01_wp*self%options%constraint_tolerance) then
                call chart%project(state%t, state%q, state%qd, .false., stat)
                if (stat == status_ok) call chart%accelerate(state%t, state%q, state%qd, step_end, state%qdd, stat)
                if (stat == status_ok .and. allocated(self%model%state%impulses)) call find_impulses(self, before, stat)
            end if
            self%tally%velocity_jump = max(self%tally%velocity_jump, self%between%output%jump(state%qd))
            if (stat /= status_ok) then
                call self%fail(stat, 'after the event at t = '//to_text(state%t), error)
                return
            end if
        end associate
        call self%measure_errors(error)
        call self%crossing%note(self%state)
    end subroutine restart_here

    !> Impulses of the projection of the velocity: M (qd - before) = -C' impulse. Multipliers are linear in the given acceleration.
    subroutine find_impulses(self, before, stat)
        class(simulation_type), intent(inout) :: self
        !> Velocities before the projection (n).
        real(wp), intent(in) :: before(:)
        integer, intent(out) :: stat
        real(wp) :: jump(size(before)), at_rest(size(self%model%state%impulses))

        associate (state => self%state, chart => self%chart)
            jump = 0.0_wp
            call chart%find_multipliers(state%t, state%q, state%qd, jump, at_rest, stat)
            if (stat /= status_ok) return
            jump = state%qd - before
            call chart%find_multipliers(state%t, state%q, state%qd, jump, self%model%state%impulses, stat)
            self%model%state%impulses = self%model%state%impulses - at_rest
        end associate
    end subroutine find_impulses
end submodule tandem_simulate_events
