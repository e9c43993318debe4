! SPDX-License-Identifier: MIT
!> The steps of a simulation: fixed ones on a grid, and controlled ones that follow an error estimate.
submodule(tandem_simulation) tandem_simulate_steps
    implicit none (type, external)

    !> Outcomes of a try of a controlled step: kept, beyond the tolerance, with a gap of the velocity, or failed.
    integer, parameter :: is_kept = 0, misses_tolerance = 1, leaves_gap = 2, fails = 3

    !> State before a step: errors of the state and the largest ones so far, the largest gap of the velocity, the grid.
    type :: before_type
        real(wp) :: errors(3), largest_errors(3), gap, t_gap
        integer(long) :: grid_steps
        logical :: on_grid
        !> The sum of the local errors and its number of steps.
        real(wp) :: local_errors
        integer(long) :: local_steps
    end type before_type

    interface
        !> A first step from the size of the rates and of their change (Hairer, Norsett, Wanner I, section II.4).
        module subroutine choose_first_step(self, span)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
            !> Time to the next stop.
            real(wp), intent(in) :: span
        end subroutine choose_first_step

        !> Take the next step of the grid, into self%next.
        module subroutine try_fixed_step(self, t_limit, ends_at_breakpoint, error)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
            real(wp), intent(in) :: t_limit
            logical, intent(out) :: ends_at_breakpoint
            type(error_type), allocatable, intent(out) :: error
        end subroutine try_fixed_step

        !> Record the error of the step to self%next: the stepper's own estimate if it is free or available, else that of the window
        !> of equal steps that it completes.
        module subroutine note_local_error(self, h, norm)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
            real(wp), intent(in) :: h
            !> The estimate of a controlled step on the scale of the tolerances.
            real(wp), intent(in), optional :: norm
        end subroutine note_local_error
    end interface

contains

    module procedure advance
        type(before_type) :: before
        real(wp) :: t
        logical :: stands_at_breakpoint, ends_at_breakpoint, is_refused

        call self%look_back()
        self%is_stopped = .false.
        self%stopped_by = ''
        call check_limits(self, error)
        if (allocated(error)) return
        ! The next segment may be entered now, even if that has failed before.
        call find_stop(self, self%state%t, t, stands_at_breakpoint)
        if (stands_at_breakpoint) call cross_breakpoint(self, error)
        if (.not. allocated(error) .and. self%auto%switching%is_on) call self%consider_exchange(error)
        if (allocated(error)) return
        before%errors = self%errors
        before%largest_errors = [self%tally%position_error, self%tally%velocity_error, self%tally%acceleration_error]
        before%gap = self%tally%velocity_gap
        before%t_gap = self%tally%t_gap
        before%grid_steps = self%grid_steps
        before%on_grid = self%on_grid
        before%local_errors = self%local_error%total
        before%local_steps = self%local_error%steps
        if (.not. self%attempts%is_interrupted) then
            if (self%between%next_look < huge(1.0_wp) .or. self%watch%n > 0) call self%between%control%begin_step()
        end if
        ! For a model that contradicts itself every stage is projected onto the manifold.
        if (self%tally%contradicts()) self%stepper%projects_stages = .true.
        call self%make_room()
        do
            call step_within_tolerance(self, t_limit, before, ends_at_breakpoint, error)
            if (allocated(error)) return
            self%last_step = self%state%t - self%start%t
            if (self%method%stability_limit > 0.0_wp .and. .not. self%crossing%is_last_step) call watch_stiffness(self)
            call self%between%output%note_step(self%model%segment)
            ! A wrong procedure shows in steps. Those whose number is a power of two, and those with a larger gap, are checked.
            if (popcnt(self%tally%steps + 1) == 1 .or. self%tally%velocity_gap > 2*before%gap) then
                if (self%local_error%is_missed(self%start, self%state)) call self%compare_procedures()
            end if
            if (.not. self%watch%n > 0) exit
            call search_step(self, t_limit, before, ends_at_breakpoint, is_refused, error)
            if (.not. is_refused) exit
        end do
        self%renewal%is_done = .false.
        if (allocated(error) .or. .not. self%last_step > 0.0_wp) return
        call self%note_end()
        if (self%between%next_look < huge(1.0_wp)) then
            if (self%between%next_look <= self%state%t + 4*spacing(self%state%t)) self%between%next_look = huge(1.0_wp)
        end if
        call self%model%arrive(self%state%t, self%state%q, .false.)
        self%tally%steps = self%tally%steps + 1
        self%tally%smallest_step = min(self%tally%smallest_step, self%last_step)
        self%tally%largest_step = max(self%tally%largest_step, self%last_step)
        if (ends_at_breakpoint) call cross_breakpoint(self, error)
    end procedure advance

    module procedure make_room
        call self%between%output%forget_step()
        if (.not. allocated(self%next%q)) call self%next%take(self%start)
    end procedure make_room

    module procedure part_end
        if (.not. self%end_is_apart) call self%next%copy(self%state)
        self%end_is_apart = .true.
    end procedure part_end

    !> Refuse a step if a limit on steps or on the cost of the run is reached.
    subroutine check_limits(self, error)
        class(simulation_type), intent(inout) :: self
        type(error_type), allocatable, intent(out) :: error

        if (self%tally%steps >= self%options%max_steps) then
            call set_error(error, status_step_limit, to_text(self%options%max_steps)//' steps were taken, t = '// &
                to_text(self%state%t), trim(advice_on_limit('max_steps', self%options, self%auto%stiffness%is_stiff .and. &
                .not. self%auto%switching%is_on)))
        else if (self%work%is_set) then
            call check_work(self, error)
        end if
    end subroutine check_limits

    !> Steps until the state at the end of one meets the constraints: from self%start to self%state.
    subroutine step_within_tolerance(self, t_limit, before, ends_at_breakpoint, error)
        class(simulation_type), intent(inout) :: self
        real(wp), intent(in) :: t_limit
        type(before_type), intent(in) :: before
        logical, intent(out) :: ends_at_breakpoint
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: stop_at
        logical :: is_hopeless, is_refused

        do
            if (self%options%is_adaptive()) then
                call try_controlled_steps(self, t_limit, ends_at_breakpoint, error)
            else
                call try_fixed_step(self, t_limit, ends_at_breakpoint, error)
            end if
            if (allocated(error)) return
            call keep_step(self)
            call self%measure_errors(error)
            if (allocated(error)) call refine_end(self, before, error)
            if (.not. allocated(error)) then
                if (.not. self%between%next_look < huge(1.0_wp)) return
                call consider_looks(self, is_refused)
                if (.not. is_refused) return
                call take_back(self, before)
                call forget_errors(self, before)
                cycle
            end if
            call take_back(self, before)
            ! If rows are redundant, those in use may have become nearly dependent since the chart was made: a new chart is better,
            ! and otherwise a shorter step.
            if (error%stat /= status_constraints_not_held) return
            is_hopeless = self%chart%n_dropped == 0
            if (self%renewal%is_done .and. .not. is_hopeless) then
                is_hopeless = .not. self%options%is_adaptive()
                if (.not. is_hopeless) then
                    call self%control%fail(self%next%t - self%state%t)
                    self%tally%failed = self%tally%failed + 1
                    self%attempts%cause = error%stat
                    is_hopeless = .not. self%control%h > 4.0_wp*spacing(abs(self%state%t))
                end if
            end if
            if (is_hopeless) then
                call find_stop(self, t_limit, stop_at, ends_at_breakpoint)
                call name_loss_ahead(self, self%next%t - self%state%t, stop_at, 'too close for the constraints to be satisfied', &
                    error)
                return
            end if
            deallocate (error)
            call forget_errors(self, before)
            if (.not. self%renewal%is_done) self%renewal%reason = by_failure
        end do
    end subroutine step_within_tolerance

    !> Accept a step. With only three states, the last start is overwritten by the next.
    subroutine keep_step(self)
        class(simulation_type), intent(inout) :: self
        type(state_type) :: former

        call former%take(self%start)
        call self%start%take(self%state)
        call self%state%take(self%next)
        call self%next%take(former)
        self%next%t = self%state%t
        self%end_is_apart = .false.
    end subroutine keep_step

    !> Project the end of a step that misses the constraints once more, as far as rounding permits. Rows that were left out are off
    !> by the errors of those in use, magnified, and errors of positions are magnified in velocities and accelerations.
    subroutine refine_end(self, before, error)
        class(simulation_type), intent(inout) :: self
        type(before_type), intent(in) :: before
        !> The miss; unallocated if nothing is missed any more.
        type(error_type), allocatable, intent(inout) :: error
        !> Largest error of this kind, in tolerances: a larger one is not due to rounding.
        real(wp), parameter :: largest = 100.0_wp
        integer :: stat

        if (error%stat /= status_constraints_not_held .or. self%crossing%is_last_step) return
        if (.not. maxval(self%errors) <= largest*self%options%constraint_tolerance) return
        associate (state => self%state)
            call self%chart%project(state%t, state%q, state%qd, .true., stat, exactly=.true.)
            if (stat == status_ok) call self%chart%accelerate(state%t, state%q, state%qd, step_end, state%qdd, stat)
        end associate
        if (stat /= status_ok) return
        call forget_largest(self, before)
        call self%measure_errors(error)
    end subroutine refine_end

    !> Reject the state at the end of a step: return to the start.
    subroutine take_back(self, before)
        class(simulation_type), intent(inout) :: self
        type(before_type), intent(in) :: before
        type(state_type) :: spare

        if (self%end_is_apart) then
            call spare%take(self%state)
        else
            call spare%take(self%next)
            call self%next%take(self%state)
        end if
        call self%state%take(self%start)
        call self%start%take(spare)
        self%errors = before%errors
        self%grid_steps = before%grid_steps
        self%on_grid = before%on_grid
    end subroutine take_back

    !> Remove the errors of a rejected step from the statistics.
    subroutine forget_errors(self, before)
        class(simulation_type), intent(inout) :: self
        type(before_type), intent(in) :: before

        call forget_largest(self, before)
        self%tally%velocity_gap = before%gap
        self%tally%t_gap = before%t_gap
        call self%local_error%take_back(before%local_errors, before%local_steps)
    end subroutine forget_errors

    !> Remove the constraint errors of a rejected state from the statistics.
    subroutine forget_largest(self, before)
        class(simulation_type), intent(inout) :: self
        type(before_type), intent(in) :: before

        self%tally%position_error = before%largest_errors(1)
        self%tally%velocity_error = before%largest_errors(2)
        self%tally%acceleration_error = before%largest_errors(3)
    end subroutine forget_largest

    !> If states between steps are requested, judge the motion there.
    subroutine consider_looks(self, is_refused)
        class(simulation_type), intent(inout) :: self
        logical, intent(out) :: is_refused

        is_refused = .false.
        if (.not. self%options%is_adaptive()) return
        if (self%between%next_look < self%state%t .and. .not. self%crossing%is_last_step) then
            call self%judge_between(is_refused)
        else
            call self%between%control%skip()
        end if
        if (.not. is_refused) call self%control%stay_below(self%between%control%longest)
    end subroutine consider_looks

    !> Check if stability limits the steps of an explicit method.
    subroutine watch_stiffness(self)
        class(simulation_type), intent(inout) :: self
        logical :: is_at_limit

        if (self%options%is_adaptive()) then
            is_at_limit = self%control%is_at_limit
            call self%auto%stiffness%smoothness%observe(self%state, self%control%weight_q, self%control%weight_qd)
        else
            is_at_limit = self%stepper%stiffness(self%last_step, self%state) > self%method%stability_limit
        end if
        call self%auto%stiffness%observe(self%start%t, is_at_limit)
    end subroutine watch_stiffness

    !> Search for events in the step, which they may cut. A step that is not searchable is rejected.
    subroutine search_step(self, t_limit, before, ends_at_breakpoint, is_refused, error)
        class(simulation_type), intent(inout) :: self
        real(wp), intent(in) :: t_limit
        type(before_type), intent(in) :: before
        logical, intent(inout) :: ends_at_breakpoint
        !> True if a shorter step is required.
        logical, intent(out) :: is_refused
        type(error_type), allocatable, intent(out) :: error
        logical :: is_cut

        call self%look_for_events(self%next%t >= t_limit, is_cut, is_refused, error)
        if (is_cut) then
            self%attempts%n_collapsed = 0
            call self%attempts%slowing%restart()
            ends_at_breakpoint = ends_at_breakpoint .and. self%state%t >= self%next%t
            ! The next step ends on the grid of fixed steps where this one would have, unless the remainder is too short.
            if (.not. self%options%is_adaptive() .and. &
                self%next%t - self%state%t > 1.0e-6_wp*(self%next%t - self%start%t)) then
                self%grid_steps = before%grid_steps
                ! A step over a singular configuration covers several.
                if (self%crossing%is_last_step) self%grid_steps = int((self%state%t - self%t_start)/self%options%step, long)
                self%on_grid = .false.
            end if
        else if (allocated(error) .or. is_refused) then
            call take_back(self, before)
            call self%between%output%forget_step()
            if (is_refused) call forget_errors(self, before)
        end if
    end subroutine search_step

    !> True if a failed step has refined B or H in vain, which are then no start for others.
    pure logical function has_spoilt(self, stat)
        class(simulation_type), intent(in) :: self
        integer, intent(in) :: stat

        has_spoilt = self%options%refresh == 'refine' .and. any(stat == [status_chart_left, status_position_diverged])
    end function has_spoilt

    !> Steps of falling size until one meets the tolerances, into self%next.
    subroutine try_controlled_steps(self, t_limit, ends_at_breakpoint, error)
        class(simulation_type), intent(inout) :: self
        real(wp), intent(in) :: t_limit
        logical, intent(out) :: ends_at_breakpoint
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: h, stop_at, norm, estimate
        logical :: is_cut, is_short, is_first, is_remainder, has_failed, is_loss, is_crossed
        integer :: outcome, reason, stat

        call find_stop(self, t_limit, stop_at, ends_at_breakpoint)
        is_first = .false.
        is_crossed = .false.
        is_remainder = .false.
        is_cut = .false.
        is_short = .false.
        self%crossing%is_last_step = .false.
        has_failed = self%attempts%has_failed
        ! Tries ended by a limit on the work continue unchanged, so that the run equals the one without that limit.
        if (.not. self%attempts%is_interrupted .or. self%renewal%reason /= 0) then
            call prepare_tries(self, stop_at, is_first, is_crossed, error)
            if (allocated(error)) return
            has_failed = .false.
        end if
        self%attempts%is_interrupted = .false.
        reason = self%attempts%cause
        do while (.not. is_crossed)
            call check_progress(self, t_limit, stop_at, error)
            if (allocated(error)) return
            call propose_step(self, stop_at, h, is_cut, is_short)
            ! The remainder before a stop time may be arbitrarily short; take it in one step.
            is_remainder = .not. h > 4.0_wp*spacing(abs(self%state%t))
            if (is_remainder .and. .not. (is_cut .and. h > 0.0_wp .and. (is_first .or. self%control%h > 2*h))) then
                call underflow(self, reason, h, error)
                return
            end if
            call try_step(self, h, norm, estimate, outcome, stat)
            if (outcome == is_kept) exit
            if (stat == status_callback_failed) then
                call self%fail(stat, 'in the step from t = '//to_text(self%state%t)//' with h = '//to_text(h), error)
                return
            end if
            is_first = .false.
            has_failed = has_failed .or. outcome == fails
            reason = stat
            call give_up_try(self, h, norm, outcome, stat, error)
            if (allocated(error)) return
            if (stat == status_rank_deficient) call self%consider_crossing(1.5_wp*h, stop_at, is_loss, is_crossed)
            ! Last, so that a run continued with a higher limit is the same.
            if (self%work%is_set) call check_work(self, error)
            if (allocated(error)) exit
        end do
        if (allocated(error)) then
            self%attempts%is_interrupted = .true.
            self%attempts%has_failed = has_failed
            self%attempts%cause = reason
            return
        end if
        self%on_grid = .true.
        self%grid_steps = self%grid_steps + 1
        if (is_crossed) then
            ends_at_breakpoint = ends_at_breakpoint .and. self%next%t >= stop_at
            return
        end if
        self%attempts%cause = merge(reason, status_ok, has_failed)
        call note_local_error(self, h, estimate)
        ! In a tiny remainder all differences are rounding.
        if (.not. is_remainder) then
            call self%control%accept(h, is_short, norm, self%stepper%stiffness(h, self%next), longest_next(self))
        else if (is_first) then
            call self%control%begin()
        end if
        ends_at_breakpoint = ends_at_breakpoint .and. is_cut
    end subroutine try_controlled_steps

    !> The longest step after the one to self%next, from the work on its stages and the reach of its chart.
    real(wp) function longest_next(self)
        class(simulation_type), intent(inout) :: self
        real(wp) :: within_reach

        longest_next = self%stepper%longest_next()
        ! Steps with stages on the manifold must fail if branches cross: this reveals a change of branch.
        if (self%method%implicit .or. self%options%chart /= 'every_step' .or. self%stepper%projects_stages) return
        if (.not. self%chart%has_reach) return
        call self%attempts%reach%find_longest(self%chart, self%state, self%next, within_reach)
        longest_next = min(longest_next, within_reach)
    end function longest_next

    !> Propose the next try: its size, and its end in self%next.
    subroutine propose_step(self, stop_at, h, is_cut, is_short)
        class(simulation_type), intent(inout) :: self
        real(wp), intent(in) :: stop_at
        real(wp), intent(out) :: h
        !> True if it ends at the stop; true if it is shorter than the size of the controller.
        logical, intent(out) :: is_cut, is_short

        h = self%lost_rank%longest_step(self%control%h)
        self%next%t = stop_at
        ! A step that nearly reaches the stop goes there; one that leaves a small remainder takes half the time.
        is_cut = self%state%t + 1.01_wp*h >= stop_at
        if (.not. is_cut) then
            if (self%state%t + 1.8_wp*h > stop_at) h = 0.5_wp*(stop_at - self%state%t)
            self%next%t = self%state%t + h
        end if
        ! Nor may it pass over values of functions of time, such as a pulse that is narrower than the step.
        do while (self%model%hides(self%state%t, self%next%t, self%method%stages > 2))
            h = 0.5_wp*(self%next%t - self%state%t)
            if (.not. h > 4.0_wp*spacing(abs(self%state%t))) exit
            is_cut = .false.
            self%next%t = self%state%t + h
        end do
        ! Decided before rounding of the times: a step that is short by rounding alone was tried in full.
        is_short = is_cut .or. h < self%control%h
        h = self%next%t - self%state%t
    end subroutine propose_step

    !> Try the step to self%next.
    subroutine try_step(self, h, norm, estimate, outcome, stat)
        class(simulation_type), intent(inout) :: self
        real(wp), intent(in) :: h
        !> The error that determines the step size, on the scale of the tolerances, and the part of it that the state retains: the
        !> constraints restore an imposed motion.
        real(wp), intent(out) :: norm, estimate
        !> `is_kept`, `misses_tolerance`, `leaves_gap` or `fails`; the status of a failure.
        integer, intent(out) :: outcome, stat
        logical :: has_gap

        norm = 0.0_wp
        estimate = 0.0_wp
        outcome = fails
        call self%stepper%advance(self%chart, self%state, h, self%next, stat)
        if (stat /= status_ok) then
            call self%lost_rank%find_behind(self%chart, self%state, self%next, stat)
            return
        end if
        call self%control%set_weights(self%state%q, self%next%q, self%state%qd, self%next%qd)
        call self%stepper%estimate(self%chart, h, self%control%weight_q, self%control%weight_qd, estimate)
        norm = estimate
        if (self%method%varies) call self%control%set_order(self%stepper%order_of_estimate())
        if (.not. self%tally%contradicts()) call self%local_error%add_imposed(self%state, self%next, self%control%weight_q, &
            self%control%weight_qd, relative_order(self), norm)
        if (.not. norm <= 1.0_wp) then
            outcome = misses_tolerance
            return
        end if
        if (self%local_error%has_jumped(self%state, self%next)) then
            stat = status_position_diverged
            call self%lost_rank%find_behind(self%chart, self%state, self%next, stat)
            return
        end if
        call self%lost_rank%check(self%chart, self%state, self%next, stat)
        if (stat == status_ok .and. self%lost_rank%comes_too_close(self%chart)) stat = status_rank_deficient
        if (stat == status_ok) call self%lost_rank%check_branch(self%chart, self%local_error, self%state, self%next, stat)
        if (stat /= status_ok) return
        call self%local_error%find_gap(self%state, self%next, has_gap)
        outcome = merge(leaves_gap, is_kept, has_gap)
    end subroutine try_step

    !> The order of the error estimate of a step over that of the step, both plus one. Methods whose order varies are those of
    !> Radau, which have order 2 s - 1 with s stages and an estimate of order s.
    pure real(wp) function relative_order(self)
        class(simulation_type), intent(in) :: self
        integer :: of_estimate, of_step

        of_estimate = self%method%estimate_order
        of_step = self%method%order
        if (self%method%varies) then
            of_estimate = self%stepper%order_of_estimate()
            of_step = 2*of_estimate - 1
        end if
        relative_order = real(of_estimate + 1, wp)/real(of_step + 1, wp)
    end function relative_order

    !> Prepare a shorter try.
    subroutine give_up_try(self, h, norm, outcome, stat, error)
        class(simulation_type), intent(inout) :: self
        !> Size and error of the try, and its outcome.
        real(wp), intent(in) :: h, norm
        integer, intent(in) :: outcome, stat
        type(error_type), allocatable, intent(out) :: error

        if (outcome == fails) then
            self%tally%failed = self%tally%failed + 1
            call self%lost_rank%remember(self%state%t, self%next%t, stat)
            call self%attempts%reach%note_failure(h)
        else
            self%tally%rejected = self%tally%rejected + 1
        end if
        if (outcome == misses_tolerance) then
            call self%control%reject(h, norm)
        else
            call self%control%fail(h)
        end if
        call self%chart%set_memory()
        if (outcome == misses_tolerance) return
        if (.not. self%renewal%is_done .or. has_spoilt(self, stat)) call self%renew_chart(by_failure, error)
    end subroutine give_up_try

    !> Before the first try of a step: a new chart if required, the search ahead, the size of the first step.
    subroutine prepare_tries(self, stop_at, is_first, is_crossed, error)
        class(simulation_type), intent(inout) :: self
        !> Latest end of the step.
        real(wp), intent(in) :: stop_at
        !> True if its size is the first one.
        logical, intent(out) :: is_first
        !> True if a step over a singular configuration was made instead.
        logical, intent(out) :: is_crossed
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: t_loss, room
        integer :: loss, other
        logical :: is_loss, is_close

        is_first = .false.
        is_loss = .false.
        is_crossed = .false.
        if (self%crossing%starts) then
            call self%leave_start(stop_at, error)
            is_crossed = .true.
            return
        end if
        call self%local_error%begin_step(self%state%t)
        call renew_by_policy(self, error)
        if (allocated(error)) return
        is_close = self%lost_rank%comes_close(self%chart, self%state%t, room)
        if (.not. is_close) is_close = self%lost_rank%limits(self%control%h, room)
        if (.not. is_close) is_close = self%crossing%is_due(self%state%t, self%control%h, room)
        if (is_close) then
            call self%consider_crossing(2*room, stop_at, is_loss, is_crossed)
            if (is_crossed) return
        end if
        call self%lost_rank%look_ahead(self%chart, self%state, self%control%h, is_loss, t_loss, loss)
        if (loss /= status_ok) then
            ! Determines the rows of the message.
            if (.not. self%lost_rank%is_ahead()) call self%lost_rank%find_close(self%chart, self%state, &
                self%model%largest_on_scales(self%state%qd), self%control%h, stop_at - self%state%t, other)
            call self%fail(loss, 'at t = '//to_text(t_loss), error)
            return
        end if
        is_first = .not. self%control%h > 0.0_wp
        if (.not. is_first) return
        call choose_first_step(self, stop_at - self%state%t)
        call self%consider_beginning(error)
    end subroutine prepare_tries

    !> The error of a run that has reached its limit of cost; the state is the last accepted one.
    subroutine check_work(self, error)
        class(simulation_type), intent(inout) :: self
        type(error_type), allocatable, intent(out) :: error

        associate (evaluations => self%chart%counts%right_hand_sides)
            if (self%work%is_spent(evaluations)) call set_error(error, status_work_limit, &
                trim(self%work%describe(evaluations))//', t = '//to_text(self%state%t), &
                trim(advice_on_limit('this limit', self%options, self%auto%stiffness%is_stiff .and. &
                .not. self%auto%switching%is_on)))
        end associate
    end subroutine check_work

    !> The next stop of steps: t_limit, or a breakpoint before it.
    subroutine find_stop(self, t_limit, stop_at, is_breakpoint)
        class(simulation_type), intent(in) :: self
        real(wp), intent(in) :: t_limit
        real(wp), intent(out) :: stop_at
        logical, intent(out) :: is_breakpoint

        stop_at = t_limit
        is_breakpoint = .false.
        if (.not. allocated(self%model%breakpoints)) return
        if (self%model%segment > size(self%model%breakpoints)) return
        is_breakpoint = self%model%breakpoints(self%model%segment) <= t_limit
        if (is_breakpoint) stop_at = self%model%breakpoints(self%model%segment)
    end subroutine find_stop
end submodule tandem_simulate_steps
