! SPDX-License-Identifier: MIT
!> Steps that get nowhere, and the loss of rank that may stand in their way.
submodule(tandem_simulation) tandem_simulate_standstill
    implicit none (type, external)

contains

    module procedure check_progress
        !> So many tries, and such a part of the way that is left: a run that gets no further with them takes years. One whose
        !> model contradicts itself is not worth more than so many times as many.
        integer, parameter :: many = 100000
        real(wp), parameter :: hopeless = 1.0e-7_wp, pointless = 0.1_wp
        !> After so many tries it is looked whether steps creep: they get less far than this part of what as many have on average.
        integer, parameter :: few = 1000
        real(wp), parameter :: collapsed = 0.01_wp
        real(wp) :: hopeful, tries, way
        character(len=64) :: suspect

        self%tries = self%tries + 1
        if (modulo(self%tries, few) == 0) then
            way = self%state%t - self%creeps_from
            self%creeps_from = self%state%t
            tries = real(self%tally%steps + self%tally%rejected + self%tally%failed, wp)
            if (way*tries < collapsed*few*(self%state%t - self%t_start)) then
                call name_loss_ahead(self, way, stop_at, 'which steps do not reach', error)
            end if
            if (allocated(error)) return
        end if
        if (self%tries < many) return
        hopeful = merge(hopeless, pointless, self%tally%contradiction == '')
        associate (t => self%state%t, from => self%tries_from)
            if (.not. t - from > hopeful*(t_limit - t)) then
                call name_near_loss(self, error)
                suspect = ', or a procedure that is wrong (tandem check, verify_model)'
                if (self%model%is_ready_made) suspect = ''
                if (.not. allocated(error)) call set_error(error, status_step_underflow, 'the last '// &
                    to_text(many)//' tries of steps got from t = '//to_text(from)//' to t = '//to_text(t)//', '// &
                    to_text(t - from)//' further', &
                    'see what makes steps fail or errors large there: a singularity'//trim(suspect)//trim(for_stiffness(self)))
            end if
            from = t
        end associate
        self%tries = 0
    end procedure check_progress

    !> Advice for a model that was found to be stiff.
    pure function for_stiffness(self) result(advice)
        class(simulation_type), intent(in) :: self
        character(len=64) :: advice

        advice = ''
        if (self%stiffness%is_stiff .and. .not. self%switching%is_on) &
            advice = '; the model is stiff: choose an implicit stepper ('//implicit_advice//')'
    end function for_stiffness

    !> Steps have become hopelessly short: a loss of rank may be why.
    subroutine name_near_loss(self, error)
        class(simulation_type), intent(inout) :: self
        type(error_type), allocatable, intent(out) :: error
        integer :: loss

        call self%lost_rank%find_near(self%chart, self%state, self%state%t - self%t_start, loss)
        if (loss /= status_ok) call self%fail(loss, 'right behind t = '//to_text(self%state%t), error)
    end subroutine name_near_loss

    module procedure name_loss_ahead
        !> So many steps of the usual size in the run it is looked ahead.
        real(wp), parameter :: far = 10.0_wp
        real(wp) :: tries
        integer :: loss

        tries = real(self%tally%steps + self%tally%rejected + self%tally%failed, wp)
        call self%lost_rank%find_close(self%chart, self%state, self%model%largest_on_scales(self%state%qd), reach, &
            min(stop_at - self%state%t, far*(self%state%t - self%t_start)/max(tries, 1.0_wp)), loss)
        if (loss == status_ok) return
        call self%fail(loss, 'close behind t = '//to_text(self%state%t)//', '//trouble, error)
    end procedure name_loss_ahead

    module procedure underflow
        call name_near_loss(self, error)
        if (.not. allocated(error)) call name_failure()
        ! A caller who goes on after that has removed its cause.
        call self%control%begin()
        self%hindrance = status_ok

    contains

        !> The failure of the last try, or that it was too inaccurate.
        subroutine name_failure()
            integer :: why

            why = self%lost_rank%was_met(self%state%t)
            if (why == status_ok) why = reason
            if (why /= status_ok) then
                call self%fail(why, 'at t = '//to_text(self%state%t)//' with the smallest step, h = '//to_text(h), error, &
                    at_smallest_step)
            else
                call set_error(error, status_step_underflow, 'h = '//to_text(h)//' at t = '//to_text(self%state%t)// &
                    ' still misses the tolerance', 'loosen rtol and atol, or look for a singularity there'// &
                    trim(for_stiffness(self)))
            end if
        end subroutine name_failure
    end procedure underflow
end submodule tandem_simulate_standstill
