! SPDX-License-Identifier: MIT
!> Steps without progress, and a loss of rank as their possible cause.
submodule(tandem_simulation) tandem_simulate_standstill
    implicit none (type, external)

contains

    module procedure check_progress
        !> Number of tries, and part of the remaining time: a run that advances less with them takes years. For a model that
        !> contradicts itself the limit is this part of the remaining time.
        integer, parameter :: many = 100000
        real(wp), parameter :: hopeless = 1.0e-7_wp, pointless = 0.1_wp
        real(wp) :: hopeful

        call check_creeping(self, t_limit, stop_at, error)
        if (allocated(error)) return
        self%attempts%count = self%attempts%count + 1
        if (self%attempts%count < many) return
        hopeful = merge(hopeless, pointless, self%tally%contradiction == '')
        associate (t => self%state%t, from => self%attempts%counted_from)
            if (.not. t - from > hopeful*(t_limit - t)) then
                call name_near_loss(self, error)
                if (.not. allocated(error)) call set_error(error, status_step_underflow, 'the last '// &
                    to_text(many)//' attempted steps advanced from t = '//to_text(from)//' to t = '//to_text(t)//', '// &
                    to_text(t - from)//' further', &
                    trim(causes(self))//trim(for_stiffness(self)))
            end if
            from = t
        end associate
        self%attempts%count = 0
    end procedure check_progress

    !> Causes of steps that fail or have large errors, by what the user can change.
    pure function causes(self) result(advice)
        class(simulation_type), intent(in) :: self
        character(len=200) :: advice

        advice = 'find out what makes errors large there: a singularity, such as a driven distance that becomes zero, a kink '// &
            'that depends on the state, or tolerances near rounding'
        if (.not. self%model%is_ready_made) advice = trim(advice)//', or a wrong procedure (tandem check, verify_model)'
    end function causes

    !> Advice for a model that was found to be stiff.
    pure function for_stiffness(self) result(advice)
        class(simulation_type), intent(in) :: self
        character(len=64) :: advice

        advice = ''
        if (self%auto%stiffness%is_stiff .and. .not. self%auto%switching%is_on) then
            advice = '; the model is stiff: choose an implicit stepper ('//implicit_advice//')'
        end if
    end function for_stiffness

    !> Every thousand tries: if they advance much less than average, look for a loss of rank ahead; and check if steps have
    !> collapsed. Steps that the next stop would cut do not count, and counting restarts when events or breakpoints cut them.
    subroutine check_creeping(self, t_limit, stop_at, error)
        class(simulation_type), intent(inout) :: self
        real(wp), intent(in) :: t_limit, stop_at
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: few = 1000
        real(wp), parameter :: slow = 0.01_wp
        !> Steps have collapsed if this number of checks found a thousand tries to advance by at most this part of the run, 1e-10 of
        !> it each. An advance longer by the next factor, or near the end of the run, restarts the count.
        integer, parameter :: enough = 5
        real(wp), parameter :: collapsed = 1.0e-7_wp, recovered = 10.0_wp, near = 100.0_wp
        !> A run is assumed to be no longer than this times its length so far: limits of single steps need not be its end. At its
        !> start this part of the time scale of the model is used.
        real(wp), parameter :: foreseen = 10.0_wp, beginning = 0.01_wp
        !> Of a model that contradicts itself at most this number of checks is made, if this part of its tries has failed: then the
        !> contradiction is the reason.
        real(wp), parameter :: most_looks = 10.0_wp, in_vain = 0.3_wp
        real(wp) :: tries, way
        logical :: is_wrong

        if (.not. self%control%h < 0.5_wp*(stop_at - self%state%t)) return
        call check_slowing(self, stop_at, error)
        if (allocated(error)) return
        self%attempts%count_of_look = self%attempts%count_of_look + 1
        if (self%attempts%count_of_look < few) return
        way = self%state%t - self%attempts%creeps_from
        self%attempts%creeps_from = self%state%t
        self%attempts%count_of_look = 0
        tries = real(self%tally%steps + self%tally%rejected + self%tally%failed, wp)
        if (way*tries < slow*few*(self%state%t - self%t_start)) then
            call name_loss_ahead(self, way, stop_at, 'which steps do not reach', error)
            if (allocated(error)) return
        end if
        associate (rest => t_limit - self%state%t, &
            limit => collapsed*min(t_limit - self%t_start, max(foreseen*(self%state%t - self%t_start), &
            beginning*self%model%time_scale)))
            is_wrong = self%tally%contradiction /= '' .and. most_looks*way < rest .and. &
                real(self%tally%rejected + self%tally%failed, wp) > in_vain*tries
            if (is_wrong .or. (way <= limit .and. near*way <= rest)) then
                self%attempts%n_collapsed = self%attempts%n_collapsed + 1
            else if (way > recovered*limit .or. near*way > rest) then
                self%attempts%n_collapsed = 0
            end if
        end associate
        if (self%attempts%n_collapsed < enough) return
        self%attempts%n_collapsed = 0
        call name_near_loss(self, error)
        if (.not. allocated(error)) call set_error(error, status_step_underflow, 'step sizes have collapsed: '// &
            to_text(few)//' attempts advanced by only '//to_text(way)//', to t = '//to_text(self%state%t), &
            trim(causes(self))//trim(for_stiffness(self)))
    end subroutine check_creeping

    !> Check if steps shrink towards a time before the next stop. Changes at that stop do not affect them.
    subroutine check_slowing(self, stop_at, error)
        class(simulation_type), intent(inout) :: self
        real(wp), intent(in) :: stop_at
        type(error_type), allocatable, intent(out) :: error
        !> Minimum distance of the stop behind the estimated time, relative to the time until then.
        real(wp), parameter :: margin = 1.0_wp
        real(wp) :: t_end
        logical :: converges

        call self%attempts%slowing%observe(self%state%t)
        call self%attempts%slowing%find_end(self%state%t, t_end, converges)
        if (.not. (converges .and. t_end + margin*(t_end - self%state%t) < stop_at)) return
        call self%attempts%slowing%restart()
        call name_near_loss(self, error)
        if (.not. allocated(error)) call set_error(error, status_step_underflow, 'steps shrink from t = '// &
            to_text(self%state%t)//' towards t = '//to_text(t_end)//' without reaching it', &
            trim(causes(self))//trim(for_stiffness(self)))
    end subroutine check_slowing

    !> Steps have become hopelessly short: a loss of rank may be why.
    subroutine name_near_loss(self, error)
        class(simulation_type), intent(inout) :: self
        type(error_type), allocatable, intent(out) :: error
        integer :: loss

        call self%lost_rank%find_near(self%chart, self%state, self%state%t - self%t_start, loss)
        if (loss /= status_ok) call self%fail(loss, 'just after t = '//to_text(self%state%t), error)
    end subroutine name_near_loss

    module procedure name_loss_ahead
        !> The search ahead covers this number of steps of the usual size in the run.
        real(wp), parameter :: far = 10.0_wp
        real(wp) :: tries
        integer :: loss

        tries = real(self%tally%steps + self%tally%rejected + self%tally%failed, wp)
        call self%lost_rank%find_close(self%chart, self%state, self%model%largest_on_scales(self%state%qd), reach, &
            min(stop_at - self%state%t, far*(self%state%t - self%t_start)/max(tries, 1.0_wp)), loss)
        if (loss == status_ok) return
        call self%fail(loss, 'shortly after t = '//to_text(self%state%t)//', '//trouble, error)
    end procedure name_loss_ahead

    module procedure underflow
        call name_near_loss(self, error)
        if (.not. allocated(error)) call name_failure()
        ! A caller who continues after this error has removed its cause.
        call self%control%begin()
        self%attempts%cause = status_ok

    contains

        !> The failure of the last try, or that it was too inaccurate.
        subroutine name_failure()
            integer :: why

            why = self%lost_rank%was_met(self%state%t)
            if (why == status_ok) why = reason
            ! Errors of accelerations grow without bound towards a loss of rank.
            if (why == status_ok .and. self%lost_rank%is_close(self%chart)) why = status_rank_deficient
            if (why /= status_ok) then
                call self%fail(why, 'at t = '//to_text(self%state%t)//' with the smallest step, h = '//to_text(h), error, &
                    at_smallest_step)
            else
                call set_error(error, status_step_underflow, 'h = '//to_text(h)//' at t = '//to_text(self%state%t)// &
                    ' still exceeds the tolerance', 'increase rtol and atol, or look for a singularity there'// &
                    trim(for_stiffness(self)))
            end if
        end subroutine name_failure
    end procedure underflow
end submodule tandem_simulate_standstill
