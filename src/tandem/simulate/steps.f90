! SPDX-License-Identifier: MIT
!> The steps of a simulation: fixed ones on a grid, controlled ones that follow an error estimate, the chart policy before a step
!> and the breakpoint after it.
submodule(tandem_simulation) tandem_simulate_steps
    implicit none (type, external)

    !> Steps approach a loss of rank, or of what ties a coordinate without mass, until its singular value has fallen to this part:
    !> closer, rounding decides where they go.
    real(wp), parameter :: least_independence = 1.0e-5_wp
    !> The statuses of a motion that is no longer determined.
    integer, parameter :: losses(2) = [status_rank_deficient, status_singular_mass]
    !> A loss of rank at the very end of a step belongs to it.
    real(wp), parameter :: hair = 1.0e-7_wp

contains

    !> One accepted step that does not pass t_limit, without the actions of events. On an error the state is that of the last
    !> accepted step.
    module procedure advance
        real(wp) :: last_errors(3), largest_errors(3), gap_before
        integer(long) :: last_grid_steps
        logical :: ends_at_breakpoint, was_on_grid, is_at_limit, is_cut

        call self%look_back()
        self%is_stopped = .false.
        self%stopped_by = ''
        if (self%tally%steps >= self%options%max_steps) then
            call set_error(error, status_step_limit, to_text(self%options%max_steps)//' steps were taken, t = '// &
                to_text(self%state%t))
            return
        end if
        if (self%work%is_set) call check_work(self, error)
        if (allocated(error)) return
        ! What has failed there may work now.
        if (stands_at_breakpoint(self)) call cross_breakpoint(self, error)
        if (allocated(error)) return
        gap_before = self%tally%velocity_gap
        last_errors = self%errors
        last_grid_steps = self%grid_steps
        was_on_grid = self%on_grid
        ! What a failed step leaves behind is no dense output.
        self%has_step = .false.
        largest_errors = [self%tally%position_error, self%tally%velocity_error, self%tally%acceleration_error]
        do
            if (self%options%is_adaptive()) then
                call try_controlled_steps(self, t_limit, ends_at_breakpoint, error)
            else
                call try_fixed_step(self, t_limit, ends_at_breakpoint, error)
            end if
            if (allocated(error)) return
            call self%start%copy(self%state)
            call self%state%copy(self%next)
            call self%measure_errors(error)
            if (.not. allocated(error)) exit
            ! A state that misses the tolerance is not kept.
            call self%state%copy(self%start)
            self%errors = last_errors
            self%grid_steps = last_grid_steps
            self%on_grid = was_on_grid
            ! Of redundant rows, those in use may have come near dependence since the chart was made: one made here does better, and
            ! else a shorter step.
            if (self%chart%n_dropped == 0 .or. error%stat /= status_constraints_not_held) return
            if (self%chart_is_current) then
                if (.not. self%options%is_adaptive()) return
                call self%control%fail(self%next%t - self%state%t)
                self%tally%failed = self%tally%failed + 1
                self%hindrance = error%stat
                if (.not. self%control%h > 4.0_wp*spacing(abs(self%state%t))) return
            end if
            deallocate (error)
            self%tally%position_error = largest_errors(1)
            self%tally%velocity_error = largest_errors(2)
            self%tally%acceleration_error = largest_errors(3)
            if (.not. self%chart_is_current) self%renewal = by_failure
        end do
        self%last_step = self%state%t - self%start%t
        if (self%method%stability_limit > 0.0_wp) then
            if (self%options%is_adaptive()) then
                is_at_limit = self%control%is_at_limit
            else
                is_at_limit = self%stepper%stiffness(self%last_step, self%next) > self%method%stability_limit
            end if
            call self%stiffness%observe(self%start%t, is_at_limit)
        end if
        self%has_step = .true.
        self%segment_of_step = self%model%segment
        ! Steps show it if a procedure of the model is wrong. Looked at are those with a power of two for their number, and one that
        ! shows more than those before it.
        if (popcnt(self%tally%steps + 1) == 1 .or. self%tally%velocity_gap > 2*gap_before) then
            if (self%local_error%is_missed(self%start, self%state)) call self%compare_procedures()
        end if
        self%chart_is_current = .false.
        if (allocated(self%watched)) then
            call self%look_for_events(self%next%t >= t_limit, is_cut, error)
            if (is_cut) then
                ends_at_breakpoint = ends_at_breakpoint .and. self%state%t >= self%next%t
                ! The next step ends on the grid of fixed steps where this one would have, unless too little is left of it.
                if (.not. self%options%is_adaptive() .and. &
                    self%next%t - self%state%t > 1.0e-6_wp*(self%next%t - self%start%t)) then
                    self%grid_steps = last_grid_steps
                    self%on_grid = .false.
                end if
                if (.not. self%last_step > 0.0_wp) return
            end if
            if (allocated(error) .and. .not. is_cut) then
                ! A step that cannot be searched is not kept.
                call self%state%copy(self%start)
                self%errors = last_errors
                self%grid_steps = last_grid_steps
                self%on_grid = was_on_grid
                self%has_step = .false.
            end if
            if (allocated(error)) return
        end if
        self%tally%steps = self%tally%steps + 1
        self%tally%smallest_step = min(self%tally%smallest_step, self%last_step)
        self%tally%largest_step = max(self%tally%largest_step, self%last_step)
        if (ends_at_breakpoint) call cross_breakpoint(self, error)
    end procedure advance

    !> Whether a failed step has left B or H behind that were refined in vain, and are no start for others.
    pure logical function has_spoilt(self, stat)
        class(simulation_type), intent(in) :: self
        integer, intent(in) :: stat

        has_spoilt = self%options%refresh == 'refine' .and. any(stat == [status_chart_left, status_position_diverged])
    end function has_spoilt

    !> Whether C has lost rank between the current state and the next: behind such a step the motion is not determined.
    subroutine check_rank(self, stat)
        class(simulation_type), intent(inout) :: self
        !> ok, or what `measure_rank` has found.
        integer, intent(out) :: stat
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
    end subroutine check_rank

    !> Take note of a try that was given up, where it has met a loss of rank or a reason that may hide one.
    pure subroutine remember_loss(self, h, stat)
        class(simulation_type), intent(inout) :: self
        real(wp), intent(in) :: h
        !> The reason.
        integer, intent(in) :: stat

        if (all(stat /= [losses, status_position_diverged, status_chart_left, status_newton_failed])) return
        if (self%state%t > self%loss_until .or. all(self%loss /= losses)) self%loss = stat
        self%loss_until = max(self%loss_until, self%next%t + h)
    end subroutine remember_loss

    !> Whether the step to the next state, shorter than one that was given up, has turned off there onto another branch: its
    !> velocity has changed of itself, without an acceleration, and C with it. Where a row of C vanishes, branches cross. Its
    !> direction, which is what the other measures see, need not come near dependence then, and the orientation may be kept. A
    !> step that is merely too long changes its velocity less when it is shorter, and a jump of nu leaves C as it is.
    logical function turns_off(self)
        class(simulation_type), intent(in) :: self
        !> Relative to the velocity; what steps that meet usual tolerances leave is far below.
        real(wp), parameter :: least_gap = 1.0e-3_wp
        real(wp) :: gap

        turns_off = .false.
        if (self%state%t > self%loss_until) return
        gap = self%local_error%gap(self%state, self%next)
        if (gap > least_gap) turns_off = self%chart%relative_change() > gap
    end function turns_off

    !> Whether a shorter step to the next state may leave a smaller gap of the velocity. Where a chart turns singular within a step,
    !> the stages behind that point go another way, which no estimate of the error shows: rates of all stages are smooth. A gap that
    !> does not become smaller with the step is a jump of nu, and is crossed.
    logical function has_gap(self, h)
        class(simulation_type), intent(inout) :: self
        real(wp), intent(in) :: h
        !> A gap below this part of the largest velocity may be rounding, which the constraints carry to the smaller ones. Steps of
        !> less than so many spacings of the time are too short to be made shorter for it.
        real(wp), parameter :: rounding = 1.0e3_wp*epsilon(1.0_wp), shortest = 1.0e4_wp
        real(wp) :: gap

        gap = self%local_error%gap(self%state, self%next)
        has_gap = gap > self%allowed_gap .and. gap < 0.5_wp*self%last_gap .and. h > shortest*spacing(abs(self%state%t))
        if (has_gap) has_gap = gap > rounding*self%local_error%largest_velocity(self%next%qd)
        if (has_gap) self%last_gap = gap
    end function has_gap

    !> A step could not be completed. Where its straight way would have lost rank, that is the reason.
    subroutine look_for_lost_rank(self, h, stat)
        class(simulation_type), intent(inout) :: self
        real(wp), intent(in) :: h
        !> The reason, replaced where this is it.
        integer, intent(inout) :: stat
        integer :: loss

        if (all(stat /= [status_position_diverged, status_chart_left, status_newton_failed])) return
        associate (state => self%state, next => self%next)
            ! From a little behind, since the state may lie just beyond, and further, since the way bends and stages are the first
            ! to notice; those that are solved together notice two steps before.
            next%q = state%q - h*state%qd
            loss = self%chart%loss_ahead(state%t - h, next%q, state%qd, 4.0_wp*h)
            if (loss /= status_ok) stat = loss
        end associate
    end subroutine look_for_lost_rank

    !> The next step of the grid, into self%next.
    subroutine try_fixed_step(self, t_limit, ends_at_breakpoint, error)
        class(simulation_type), intent(inout) :: self
        real(wp), intent(in) :: t_limit
        logical, intent(out) :: ends_at_breakpoint
        type(error_type), allocatable, intent(out) :: error
        logical :: ends_on_grid
        real(wp) :: h
        integer :: stat

        call next_time(self, t_limit, self%next%t, ends_on_grid, ends_at_breakpoint)
        h = self%next%t - self%state%t
        if (.not. h > 0.0_wp) then
            call set_error(error, status_step_underflow, 'from t = '//to_text(self%state%t)//' with step '// &
                to_text(self%options%step)//' towards '//to_text(t_limit))
            return
        end if
        call renew_by_policy(self, error)
        if (allocated(error)) return
        stat = status_ok
        if (self%room < 1.5_wp*h) then
            associate (state => self%state)
                stat = self%chart%loss_ahead(state%t, state%q, state%qd, (1.0_wp + hair)*h)
            end associate
        end if
        if (stat == status_ok) then
            call self%stepper%advance(self%chart, self%state, h, self%next, stat)
            if (stat == status_ok) then
                call check_rank(self, stat)
            else
                call look_for_lost_rank(self, h, stat)
            end if
        end if
        if (stat /= status_ok) then
            call self%fail(stat, 'in the step from t = '//to_text(self%state%t)//' with h = '//to_text(h), error)
            ! A shorter step that follows must find no trace of this one.
            call self%chart%retry_step()
            if (has_spoilt(self, stat)) then
                self%chart_is_current = .false.
                self%renewal = by_failure
            end if
            return
        end if
        call note_local_error(self, h)
        self%on_grid = ends_on_grid
        if (ends_on_grid) self%grid_steps = self%grid_steps + 1
    end subroutine try_fixed_step

    !> Steps of falling size until one meets the tolerances, into self%next.
    subroutine try_controlled_steps(self, t_limit, ends_at_breakpoint, error)
        class(simulation_type), intent(inout) :: self
        real(wp), intent(in) :: t_limit
        logical, intent(out) :: ends_at_breakpoint
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: h, stop_at, norm
        logical :: is_cut, is_short, is_first, is_sliver, has_failed
        integer :: stat, reason

        call find_stop(self, t_limit, stop_at, ends_at_breakpoint)
        is_first = .false.
        has_failed = self%try_has_failed
        ! Tries that a limit on the work has ended go on where they were, so that the run is the one without that limit.
        if (.not. self%is_interrupted .or. self%renewal /= 0) then
            call prepare_tries(self, stop_at, is_first, error)
            if (allocated(error)) return
            has_failed = .false.
        end if
        self%is_interrupted = .false.
        reason = self%hindrance
        do
            call check_progress(self, t_limit, error)
            if (allocated(error)) return
            h = min(self%control%h, 0.5_wp*self%room)
            ! A step that nearly reaches the stop goes there; one that leaves a small rest takes half the way.
            is_cut = self%state%t + 1.01_wp*h >= stop_at
            self%next%t = stop_at
            if (.not. is_cut) then
                if (self%state%t + 1.8_wp*h > stop_at) h = 0.5_wp*(stop_at - self%state%t)
                self%next%t = self%state%t + h
            end if
            ! Asked before the times round h: a step that is short by that alone was tried in full.
            is_short = is_cut .or. h < self%control%h
            h = self%next%t - self%state%t
            ! What is left before the stop may be as short as it likes: it is one step.
            is_sliver = .not. h > 4.0_wp*spacing(abs(self%state%t))
            if (is_sliver .and. .not. (is_cut .and. h > 0.0_wp .and. (is_first .or. self%control%h > 2*h))) then
                call underflow(self, reason, h, error)
                return
            end if
            call self%stepper%advance(self%chart, self%state, h, self%next, stat)
            if (stat == status_ok) then
                call self%control%set_weights(self%state%q, self%next%q, self%state%qd, self%next%qd)
                call self%stepper%estimate(self%chart, h, self%control%weight_q, self%control%weight_qd, norm)
                if (.not. norm <= 1.0_wp) then
                    self%tally%rejected = self%tally%rejected + 1
                    reason = status_ok
                    is_first = .false.
                    call self%control%reject(h, norm)
                    call self%chart%retry_step()
                    if (self%work%is_set) call check_work(self, error)
                    if (allocated(error)) exit
                    cycle
                end if
                call check_rank(self, stat)
                if (stat == status_ok .and. turns_off(self)) stat = self%loss
                if (stat == status_ok .and. .not. has_gap(self, h)) exit
                if (stat == status_ok) then
                    self%tally%rejected = self%tally%rejected + 1
                    reason = status_ok
                    is_first = .false.
                    call self%control%fail(h)
                    call self%chart%retry_step()
                    if (.not. self%chart_is_current) call self%renew_chart(by_failure, error)
                    if (allocated(error)) return
                    if (self%work%is_set) call check_work(self, error)
                    if (allocated(error)) exit
                    cycle
                end if
            else if (stat /= status_callback_failed) then
                call look_for_lost_rank(self, h, stat)
            end if
            if (stat == status_callback_failed) then
                call self%fail(stat, 'in the step from t = '//to_text(self%state%t)//' with h = '//to_text(h), error)
                return
            end if
            self%tally%failed = self%tally%failed + 1
            has_failed = .true.
            is_first = .false.
            reason = stat
            call remember_loss(self, h, stat)
            call self%control%fail(h)
            call self%chart%retry_step()
            if (.not. self%chart_is_current .or. has_spoilt(self, stat)) call self%renew_chart(by_failure, error)
            if (allocated(error)) return
            ! Last, so that who goes on with a higher limit finds what this run would have gone on with.
            if (self%work%is_set) call check_work(self, error)
            if (allocated(error)) exit
        end do
        if (allocated(error)) then
            self%is_interrupted = .true.
            self%try_has_failed = has_failed
            self%hindrance = reason
            return
        end if
        self%hindrance = merge(reason, status_ok, has_failed)
        call note_local_error(self, h, norm)
        ! In a sliver all differences are rounding.
        if (.not. is_sliver) then
            call self%control%accept(h, is_short, norm, self%stepper%stiffness(h, self%next))
        else if (is_first) then
            call self%control%begin()
        end if
        ends_at_breakpoint = ends_at_breakpoint .and. is_cut
        self%on_grid = .true.
        self%grid_steps = self%grid_steps + 1
    end subroutine try_controlled_steps

    !> What comes before the first try of a step: a new chart where one is wanted, a look ahead, the size of the first step.
    subroutine prepare_tries(self, stop_at, is_first, error)
        class(simulation_type), intent(inout) :: self
        !> Where the step must end at the latest.
        real(wp), intent(in) :: stop_at
        !> Whether its size is the first one.
        logical, intent(out) :: is_first
        type(error_type), allocatable, intent(out) :: error
        integer :: loss

        is_first = .false.
        self%last_gap = huge(1.0_wp)
        call renew_by_policy(self, error)
        if (allocated(error)) return
        if (self%room < huge(1.0_wp) .and. min(self%chart%fallen, self%chart%loosened) < least_independence) then
            ! To name the rows.
            associate (state => self%state)
                loss = self%chart%loss_ahead(state%t, state%q, state%qd, 2*self%room)
            end associate
            loss = merge(status_rank_deficient, status_singular_mass, self%chart%fallen < least_independence)
            call self%fail(loss, 'at t = '//to_text(self%state%t + self%room), error)
            return
        end if
        ! Towards a loss of rank steps must shrink, so that it cannot hide in one.
        if (0.5_wp*self%room < self%control%h) then
            associate (state => self%state)
                if (self%chart%loss_ahead(state%t, state%q, state%qd, 2*self%room) == status_ok) self%room = huge(1.0_wp)
            end associate
        end if
        is_first = .not. self%control%h > 0.0_wp
        if (is_first) call choose_first_step(self, stop_at - self%state%t)
    end subroutine prepare_tries

    !> Take note of the error of the step to self%next: of the stepper's own estimate where there is one that is free or was
    !> made, else of the window of equal steps that it completes.
    subroutine note_local_error(self, h, norm)
        class(simulation_type), intent(inout) :: self
        real(wp), intent(in) :: h
        !> The estimate of a controlled step on the scale of the tolerances.
        real(wp), intent(in), optional :: norm
        logical :: is_complete
        real(wp) :: relative, filtered, gap

        associate (local => self%local_error)
            gap = local%gap(self%state, self%next)
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
                call local%set_weights(self%next)
                relative = weighted_norm(local%error_q, local%error_qd, local%weight_q, local%weight_qd)
                if (self%method%implicit) then
                    ! Stiff modes have rates that are large against their changes. The filter takes that out, and also what an
                    ! error leaves in dependent velocities, so it counts only where it takes nearly all.
                    call self%chart%filter_error(local%error_q, local%error_qd)
                    filtered = weighted_norm(local%error_q, local%error_qd, local%weight_q, local%weight_qd)
                    if (filtered < 0.1_wp*relative) relative = filtered
                end if
                call local%add(relative, steps_of_window)
            end if
        end associate
    end subroutine note_local_error

    !> The error of a run that has cost what it may; the state is the last accepted one.
    subroutine check_work(self, error)
        class(simulation_type), intent(inout) :: self
        type(error_type), allocatable, intent(out) :: error

        associate (evaluations => self%chart%counts%right_hand_sides)
            if (self%work%is_spent(evaluations)) call set_error(error, status_work_limit, &
                trim(self%work%describe(evaluations))//', t = '//to_text(self%state%t))
        end associate
    end subroutine check_work

    !> The error of steps that do go on, but would never reach the end.
    subroutine check_progress(self, t_limit, error)
        class(simulation_type), intent(inout) :: self
        real(wp), intent(in) :: t_limit
        type(error_type), allocatable, intent(out) :: error
        !> So many tries, and such a part of the way that is left: a run that gets no further with them takes years. One whose
        !> model contradicts itself is not worth more than so many times as many.
        integer, parameter :: many = 100000
        real(wp), parameter :: hopeless = 1.0e-7_wp, pointless = 0.1_wp
        real(wp) :: hopeful

        self%tries = self%tries + 1
        if (self%tries < many) return
        hopeful = merge(hopeless, pointless, self%tally%contradiction == '')
        associate (t => self%state%t, from => self%tries_from)
            if (.not. t - from > hopeful*(t_limit - t)) then
                call name_near_loss(self, error)
                if (.not. allocated(error)) call set_error(error, status_step_underflow, 'the last '// &
                    to_text(many)//' tries of steps got from t = '//to_text(from)//' to t = '//to_text(t)//', '// &
                    to_text(t - from)//' further', &
                    'see what makes steps fail or errors large there: a singularity, or a procedure that is wrong '// &
                    '(tandem check, verify_model)')
            end if
            from = t
        end associate
        self%tries = 0
    end subroutine check_progress

    !> Steps have become hopelessly short. Where C loses its rank, or what ties a coordinate without mass, within a millionth of the
    !> run ahead, or where little of that tie is left, that is why: the errors of steps grow without bound towards it.
    subroutine name_near_loss(self, error)
        class(simulation_type), intent(inout) :: self
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: near = 1.0e-6_wp
        integer :: loss

        associate (state => self%state)
            loss = self%chart%loss_ahead(state%t, state%q, state%qd, near*(state%t - self%t_start))
            if (loss == status_ok .and. self%chart%loosened < least_independence) loss = status_singular_mass
            if (loss /= status_ok) call self%fail(loss, 'right behind t = '//to_text(state%t), error)
        end associate
    end subroutine name_near_loss

    !> The error of a step that would no longer change the time.
    subroutine underflow(self, reason, h, error)
        class(simulation_type), intent(inout) :: self
        !> Why the last try, in this step or in the one before, could not be completed; ok where it missed the tolerance.
        integer, intent(in) :: reason
        real(wp), intent(in) :: h
        type(error_type), allocatable, intent(out) :: error

        call name_near_loss(self, error)
        if (.not. allocated(error)) call name_failure()
        ! Something was mended before a run goes on after that.
        call self%control%begin()
        self%hindrance = status_ok
    contains
        !> The failure of the last try, or that it was too inaccurate.
        subroutine name_failure()
            if (self%state%t <= self%loss_until .and. any(self%loss == losses)) then
                call self%fail(self%loss, 'at t = '//to_text(self%state%t)//' with the smallest step, h = '//to_text(h), &
                    error)
            else if (reason /= status_ok) then
                call self%fail(reason, 'at t = '//to_text(self%state%t)//' with the smallest step, h = '//to_text(h), error)
            else
                call set_error(error, status_step_underflow, 'h = '//to_text(h)//' at t = '//to_text(self%state%t)// &
                    ' still misses the tolerance', 'loosen rtol and atol, or look for a singularity there')
            end if
        end subroutine name_failure
    end subroutine underflow

    !> A first step from the size of the rates and of their change (Hairer, Norsett, Wanner I, section II.4).
    subroutine choose_first_step(self, span)
        class(simulation_type), intent(inout) :: self
        !> Time to the next stop.
        real(wp), intent(in) :: span
        real(wp) :: h, size_y, size_f, change
        integer :: stat

        associate (state => self%state, next => self%next, control => self%control)
            call control%set_weights(state%q, state%q, state%qd, state%qd)
            size_y = weighted_norm(state%q, state%qd, control%weight_q, control%weight_qd)
            size_f = weighted_norm(state%qd, state%qdd, control%weight_q, control%weight_qd)
            h = 1.0e-6_wp
            if (size_y > 1.0e-5_wp .and. size_f > 1.0e-5_wp) h = 0.01_wp*size_y/size_f
            h = min(h, 0.1_wp*span)
            ! One Euler step shows how fast the rates change.
            next%dq = state%dq + h*state%qd
            next%dqd = state%dqd + h*state%qdd
            call self%chart%restore_position(state%t + h, next%dq, next%q, stat)
            if (stat == status_ok) call self%chart%restore_velocity(state%t + h, next%q, next%dqd, next%qd, stat)
            if (stat == status_ok) call self%chart%solve_dynamics(state%t + h, next%q, next%qd, next%qdd, stat)
            if (stat == status_ok) then
                change = weighted_norm(next%qd - state%qd, next%qdd - state%qdd, control%weight_q, control%weight_qd)/h
                h = min(100*h, (0.01_wp/max(size_f, change, 1.0e-15_wp))**(1.0_wp/(self%method%estimate_order + 1)))
            end if
            control%h = control%limit(min(h, span))
        end associate
    end subroutine choose_first_step

    !> Where the next step ends: the next point of the grid t_start + k h, cut at a breakpoint and at t_limit.
    subroutine next_time(self, t_limit, t, ends_on_grid, ends_at_breakpoint)
        class(simulation_type), intent(in) :: self
        real(wp), intent(in) :: t_limit
        real(wp), intent(out) :: t
        logical, intent(out) :: ends_on_grid, ends_at_breakpoint
        real(wp) :: stop_at, sliver

        t = self%t_start + real(self%grid_steps + 1, wp)*self%options%step
        ends_on_grid = .true.
        call find_stop(self, t_limit, stop_at, ends_at_breakpoint)
        ! A rest too short to matter is merged with the step before it.
        sliver = max(1.0e-6_wp*self%options%step, 4.0_wp*spacing(abs(stop_at)))
        if (t >= stop_at - sliver) then
            ends_on_grid = t <= stop_at + sliver
            t = stop_at
        else
            ends_at_breakpoint = .false.
        end if
    end subroutine next_time

    !> Where steps must stop: t_limit, or a breakpoint before it.
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

    !> Make a new chart before the step where the policy wants one.
    subroutine renew_by_policy(self, error)
        class(simulation_type), intent(inout) :: self
        type(error_type), allocatable, intent(out) :: error
        type(health_type) :: health
        !> The secant of 70 degrees, which ends a chart of implicit steps whatever the paper's limits are, and one of explicit steps
        !> where they are none.
        real(wp), parameter :: farthest = 3.0_wp
        integer :: stat

        if (self%chart_is_current) return
        if (self%renewal == 0 .and. self%chart%n_dropped > 0 .and. self%room < huge(1.0_wp)) self%renewal = by_failure
        if (self%renewal /= 0) then
            call self%renew_chart(self%renewal, error)
            self%renewal = 0
            return
        end if
        associate (options => self%options)
            if (options%chart == 'every_step') then
                call self%renew_chart(by_step, error)
                return
            end if
            call self%chart%measure_health(self%state%t, self%state%q, self%state%qd, health, stat)
            if (stat /= status_ok) then
                call self%fail(stat, 'before the step from t = '//to_text(self%state%t), error)
                return
            end if
            if (options%chart == 'adaptive') then
                if (.not. health%d <= options%secant_limit) then
                    call self%renew_chart(by_d, error)
                else if (.not. health%fbar <= options%secant_limit) then
                    call self%renew_chart(by_fbar, error)
                end if
            else
                if (options%v_limit > 0.0_wp .and. health%v > options%v_limit) then
                    call self%renew_chart(by_v, error)
                else if (options%w_limit > 0.0_wp .and. health%w > options%w_limit) then
                    call self%renew_chart(by_w, error)
                else if (options%condition_limit > 0.0_wp .and. .not. health%condition <= options%condition_limit) then
                    call self%renew_chart(by_condition, error)
                else if (options%iteration_limit > 0 .and. health%corrections > options%iteration_limit) then
                    call self%renew_chart(by_iterations, error)
                else if (.not. health%d <= farthest) then
                    call self%renew_chart(by_d, error)
                else if (.not. health%fbar <= farthest) then
                    call self%renew_chart(by_fbar, error)
                end if
            end if
        end associate
        if (allocated(error) .or. self%chart_is_current) return
        call self%chart%refresh(self%state%t, self%state%q, stat)
        if (stat /= status_ok) call self%fail(stat, 'before the step from t = '//to_text(self%state%t), error)
    end subroutine renew_by_policy

    !> Whether the step to a breakpoint was taken, and the next segment could not be entered.
    pure logical function stands_at_breakpoint(self)
        class(simulation_type), intent(in) :: self

        stands_at_breakpoint = .false.
        if (.not. allocated(self%model%breakpoints)) return
        if (self%model%segment > size(self%model%breakpoints)) return
        stands_at_breakpoint = self%model%breakpoints(self%model%segment) <= self%state%t
    end function stands_at_breakpoint

    !> Enter the next segment: where nu jumps, qd jumps with it; the acceleration is made anew, and the chart with the next step.
    !> On an error the state is that of the segment that ends.
    subroutine cross_breakpoint(self, error)
        class(simulation_type), intent(inout) :: self
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: qd(size(self%state%qd)), qdd(size(self%state%qd))
        logical :: jumps
        integer :: stat

        associate (model => self%model, state => self%state)
            qd = state%qd
            qdd = state%qdd
            jumps = .false.
            if (allocated(model%nu_jumps)) jumps = model%nu_jumps(model%segment)
            model%segment = model%segment + 1
            call self%control%restart()
            call self%local_error%restart()
            call self%chart%forget()
            stat = status_ok
            if (jumps) then
                call self%chart%project_velocity(state%t, state%q, state%qd, stat)
                self%tally%velocity_jump = max(self%tally%velocity_jump, maxval(abs(state%qd - qd)))
            end if
            if (stat == status_ok) call self%chart%solve_dynamics(state%t, state%q, state%qd, state%qdd, stat)
            ! The chart of the step that ends here is kept for its dense output until the next step.
            self%renewal = by_breakpoint
            self%values_are_stale = .true.
            if (stat == status_ok) then
                call self%measure_errors(error)
            else
                call self%fail(stat, 'at the breakpoint t = '//to_text(state%t), error)
            end if
            if (.not. allocated(error)) return
            model%segment = model%segment - 1
            call self%chart%forget()
            state%qd(:) = qd
            state%qdd(:) = qdd
        end associate
    end subroutine cross_breakpoint
end submodule tandem_simulate_steps
