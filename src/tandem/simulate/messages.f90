! SPDX-License-Identifier: MIT
!> Messages of a simulation: errors with their time and the constraint concerned, and warnings.
submodule(tandem_simulation) tandem_simulate_messages
    use tandem_model_consistency, only: find_contradiction
    use tandem_model_massless, only: find_massless_motion
    use tandem_simulate_advice, only: advice_on_failure, anywhere
    use tandem_simulate_warning, only: add_warning
    use tandem_status, only: status_invalid_model, status_name, status_not_evaluable, status_of, status_singular_mass, &
        status_type
    implicit none (type, external)

contains

    module procedure fail
        character(len=:), allocatable :: message, motion
        real(wp), allocatable :: direction(:)
        integer :: circumstance_

        circumstance_ = anywhere
        if (present(circumstance)) circumstance_ = circumstance
        message = trim(adjustl(meaning(stat)))//' '//where_
        if (self%chart%failure%row > 0) then
            message = message//', constraint "'//self%model%row_name(self%chart%failure%row)//'"'
            if (stat == status_rank_deficient .and. allocated(self%chart%failure%rows)) then
                message = message//trim(self%with_rows(self%chart%failure%rows, self%chart%failure%row, ' with '))
            end if
            if (stat /= status_rank_deficient .and. stat /= status_singular_mass) then
                message = message//', error '//to_text(self%chart%failure%value)//' of its natural scale'
            end if
        end if
        if (stat == status_singular_mass .and. self%chart%failure%coordinate > 0) then
            message = message//': no constraint determines "'// &
                trim(self%model%coordinate_label(self%chart%failure%coordinate))//'", which has no mass'
        else if (stat == status_singular_mass) then
            call find_massless_motion(self%model, self%state%t, self%state%q, self%state%qd, direction)
            if (size(direction) > 0) then
                call self%model%describe_motion(self%state%q, direction, motion)
                message = message//': '//motion
            end if
        end if
        if (stat == status_invalid_model .and. allocated(self%chart%failure%term)) then
            associate (term => self%chart%failure%term)
                if (index(term, 'outside') == 1) then
                    message = 'the mass matrix is not zero outside of mass_blocks '//where_//', entry mass'//term(8:)// &
                        ': give larger blocks'
                else
                    message = 'the mass matrix is not symmetric '//where_//', entry '//term
                end if
            end associate
        end if
        if (any(stat == [status_callback_failed, status_not_evaluable, status_not_finite]) .and. &
            allocated(self%chart%failure%term)) then
            message = message//', term '//self%chart%failure%term
        end if
        if (stat == status_rank_deficient .and. self%crossing%obstacle /= '') message = message//'; it was not passed, since '// &
            trim(self%crossing%obstacle)
        call set_error(error, stat, message, trim(advice_on_failure(stat, circumstance_, self%model, self%options, self%method, &
            self%chart%failure%row > 0)))
    end procedure fail

    module procedure explain
        !> Duration of the search beyond the last step.
        real(wp), parameter :: ahead = 1.0e-3_wp

        select case (error%stat)
        case (status_position_diverged, status_chart_left, status_newton_failed, status_constraints_not_held, &
            status_rank_deficient, status_step_underflow)
            call self%compare_procedures()
            ! The last step may have been too short for the comparison.
            if (.not. self%tally%contradicts()) call find_contradiction(self%model, self%state%t, self%state%q, self%state%qd, &
                ahead, self%chart%counts, self%tally%contradiction)
        case (status_step_limit, status_work_limit)
            ! Limits set by the user must not hide a contradiction found before.
        case default
            return
        end select
        if (self%tally%contradicts()) error%message = status_name(error%stat)//': '//trim(self%tally%contradiction)//'; '// &
            error%message(len(status_name(error%stat)) + 3:)
    end procedure explain

    !> Search for contradictory procedures of the model within the last step, until one is found.
    module procedure compare_procedures
        if (self%tally%contradicts() .or. .not. self%last_step > 0.0_wp) return
        ! After a step to a breakpoint or an event, the model may be in another segment.
        if (self%model%segment /= self%between%output%segment) return
        if (self%n_events > 0) then
            if (self%events(self%n_events)%t >= self%state%t) return
        end if
        call find_contradiction(self%model, self%state%t, self%state%q, self%state%qd, -self%last_step, self%chart%counts, &
            self%tally%contradiction)
    end procedure compare_procedures

    module procedure with_rows
        character(len=:), allocatable :: list
        integer :: i, n_named

        list = ''
        n_named = 0
        do i = 1, size(rows)
            if (rows(i) == row) cycle
            n_named = n_named + 1
            if (n_named > most_names) exit
            if (n_named == 1) list = before
            if (n_named > 1) list = list//', '
            list = list//'"'//self%model%row_name(rows(i))//'"'
        end do
        if (n_named > most_names) list = list//' and others'
        text = list
    end procedure with_rows

    module procedure warn
        integer :: i

        if (.not. allocated(self%warnings)) allocate (self%warnings(0))
        do i = 1, size(self%warnings)
            if (self%warnings(i)%text == text) return
        end do
        call add_warning(self%warnings, text, is_note)
    end procedure warn

    !> Meaning of a status code, padded with blanks.
    pure function meaning(stat) result(text)
        integer, intent(in) :: stat
        type(status_type) :: row
        character(len=len(row%meaning)) :: text

        row = status_of(stat)
        text = row%meaning
    end function meaning
end submodule tandem_simulate_messages
