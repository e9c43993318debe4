! SPDX-License-Identifier: MIT
!> Exchange of steppers between steps, for the stepper `auto`. Each stepper has its own chart, because explicit steps omit data of
!> implicit ones.
submodule(tandem_simulation) tandem_simulate_exchange
    implicit none (type, external)

contains

    module procedure consider_exchange
        integer(long) :: attempts
        real(wp) :: cost, open
        logical :: wants

        if (.not. self%auto%switching%is_asked(self%tally%steps)) return
        ! Near a loss of rank, steps become short for another reason.
        if (self%lost_rank%is_near(self%state%t)) return
        attempts = self%tally%steps + self%tally%rejected + self%tally%failed
        cost = implicit_cost(self)
        associate (switching => self%auto%switching, smoothness => self%auto%stiffness%smoothness, control => self%control)
            if (switching%is_implicit) then
                wants = switching%is_due(attempts)
                if (wants) call decide_for_explicit(self, attempts, cost, wants)
            else
                call smoothness%look_at_window(self%state, switching%t_from, control%weight_q, control%weight_qd, open)
                wants = switching%wants_implicit(self%state%t, control%is_free, control%is_at_limit, &
                    smoothness%needed, open, attempts, self%method%stages, cost)
            end if
        end associate
        if (wants) call exchange(self, self%auto%switching%first_step_at(self%state%t - self%t_start), error)
    end procedure consider_exchange

    module procedure consider_beginning
        real(wp) :: first_step
        integer :: k

        if (.not. self%auto%switching%may_begin_implicit() .or. self%lost_rank%is_near(self%state%t)) return
        first_step = self%control%limit(self%auto%switching%first_step)
        call self%auto%switching%begin_estimation()
        do k = 1, looks
            call self%auto%switching%estimate_eigenvalue(self%chart, self%state)
            if (k > 1 .and. .not. self%auto%switching%begins_implicit(first_step, self%method%stages, self%method%stability_limit, &
                implicit_cost(self))) return
        end do
        self%control%h = self%auto%switching%first_step
        call exchange(self, self%control%h, error)
    end procedure consider_beginning

    !> Decide whether explicit steps would cost less than recent implicit steps.
    subroutine decide_for_explicit(self, attempts, cost, wants)
        class(simulation_type), intent(inout) :: self
        !> Number of step attempts so far; cost of an implicit step.
        integer(long), intent(in) :: attempts
        real(wp), intent(in) :: cost
        logical, intent(out) :: wants
        integer :: k

        associate (t => self%state%t, method => self%auto%explicit_method)
            call self%auto%switching%begin_estimation()
            wants = .true.
            do k = 1, looks
                call self%auto%switching%estimate_eigenvalue(self%chart, self%state)
                if (k == 1) cycle
                wants = wants .and. self%auto%switching%wants_explicit(t, attempts, method%stages, method%stability_limit, cost)
                if (.not. wants .and. self%auto%switching%may_oppose()) exit
            end do
            call self%auto%switching%note_decision(t, attempts, method%stability_limit)
        end associate
    end subroutine decide_for_explicit

    !> Cost of an implicit step, in explicit stages.
    pure real(wp) function implicit_cost(self)
        class(simulation_type), intent(in) :: self

        implicit_cost = cost_of_implicit(merge(0, self%model%n, self%model%provides_derivatives == need_all_derivatives))
    end function implicit_cost

    !> Exchange the steppers.
    subroutine exchange(self, h, error)
        class(simulation_type), intent(inout) :: self
        !> Lower limit of the size of the first implicit step.
        real(wp), intent(in) :: h
        type(error_type), allocatable, intent(out) :: error
        integer :: stat

        call self%make_room()
        call self%take_stepper(.not. self%auto%switching%is_implicit, stat)
        if (stat /= status_ok) then
            ! Implicit steps are impossible here: continue with explicit steps.
            self%auto%switching%is_on = .false.
            call self%take_stepper(self%auto%switching%is_implicit, stat)
            if (stat /= status_ok) call self%fail(stat, 'at a new chart at t = '//to_text(self%state%t), error)
            self%state%dq(:) = 0.0_wp
            self%state%dqd(:) = 0.0_wp
            return
        end if
        self%state%dq(:) = 0.0_wp
        self%state%dqd(:) = 0.0_wp
        call self%auto%switching%note_switch(self%state%t, self%tally%steps, self%tally%steps + self%tally%rejected + &
            self%tally%failed, self%auto%stiffness%smoothness%needed)
        ! Explicit steps begin within their stability limit. Implicit steps grow from the current size or, at the start of a run,
        ! have the size of a first step.
        if (self%auto%switching%is_implicit) then
            self%control%h = self%control%limit(max(self%control%h, h))
        else if (self%auto%switching%lambda > 0.0_wp) then
            self%control%h = self%control%limit(min(self%control%h, 0.5_wp*self%method%stability_limit/self%auto%switching%lambda))
        end if
        self%tally%charts_by(by_step) = self%tally%charts_by(by_step) + 1
        self%tally%charts = self%tally%charts + 1
    end subroutine exchange

    module procedure take_stepper
        class(chart_type), allocatable :: former
        type(error_type), allocatable :: error
        integer :: n_dropped

        stat = status_ok
        call self%allocate_stepper(is_partner=is_implicit)
        self%method = self%stepper%properties()
        call self%set_method()
        call self%between%output%forget_step()
        self%renewal%reason = 0
        n_dropped = self%chart%n_dropped
        if (n_dropped > 0 .and. .not. self%is_sparse) then
            call self%choose_rows_anew(stat)
        else
            call move_alloc(self%chart, former)
            call self%allocate_chart()
            call self%chart%attach(self%model, self%options, self%method%implicit, self%method%damps, error)
            call self%chart%inherit(former)
            if (allocated(error)) then
                stat = error%stat
            else if (n_dropped > 0) then
                call self%chart%leave_out_dependent(self%state%t, self%state%q, self%state%qd, stat)
                if (stat == status_ok .and. self%chart%n_dropped /= n_dropped) stat = status_rank_deficient
            else
                self%next%dq(:) = 0.0_wp
                call self%chart%set_origin(self%state%t, self%state%q, self%state%qd, .false., self%next%dq, stat)
            end if
        end if
        self%renewal%is_done = stat == status_ok
    end procedure take_stepper

    module procedure set_method
        self%stepper%projects_stages = projects_stages(self%options)
        call watch_constraints(self)
        call self%control%set_method(self%method)
        call self%control%restart()
        call self%between%control%begin()
        call self%auto%stiffness%pause()
        self%stepper%time_scale = self%model%time_scale
        call self%stepper%initialize(self%model%scales(), self%options%newton_tolerance())
    end procedure set_method
end submodule tandem_simulate_exchange
