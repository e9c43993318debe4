! SPDX-License-Identifier: MIT
!> tandem study stability: a verdict for every stiff and extreme case with every stepper.
module tandem_cli_study_stability
    use tandem, only: error_type, is_input_error, stepper_choices, to_text, wp
    use tandem_cli_arguments, only: arguments_type
    use tandem_cli_messages, only: print_to_stderr, done, input_wrong, run_failed, say
    use tandem_cli_study_json, only: print_table_json
    use tandem_cli_study_progress, only: study_progress_type
    use tandem_io, only: brief, case_groups, case_names, listed, nearest_name, select_cases, stability_columns, stability_type
    implicit none (type, external)
    private

    public :: study_stability

    !> Widths of the columns for cases and for runs.
    integer, parameter :: first = 17, wide = 11

contains

    !> Carry out the study, print the matrix, and write the files.
    subroutine study_stability(arguments, code)
        type(arguments_type), intent(in) :: arguments
        !> Exit code; also 1 if the result of a run is wrong.
        integer, intent(out) :: code
        type(error_type), allocatable :: error

        code = input_wrong
        call study(arguments, code, error)
        if (allocated(error)) call print_to_stderr(error%message)
    end subroutine study_stability

    !> Carry out all runs.
    subroutine study(arguments, code, error)
        type(arguments_type), intent(in) :: arguments
        integer, intent(out) :: code
        type(error_type), allocatable, intent(out) :: error
        character(len=*), parameter :: about = 'verdicts on runs of stiff and extreme cases: held, degraded (off by more than '// &
            'allowed, with a warning), refused, failed, wrong (off by more than allowed, without a warning)'
        type(stability_type), target :: stability
        type(study_progress_type) :: progress
        character(len=:), allocatable :: unknown
        logical :: finished
        integer :: total

        code = input_wrong
        call select_cases(arguments%scenes, stability%cases, unknown)
        if (allocated(unknown)) then
            allocate (error)
            error%message = 'there is no case "'//unknown//'"'
            unknown = nearest_name(unknown, [case_names, case_groups])
            if (unknown /= '') error%message = error%message//'; did you mean "'//unknown//'"?'
            error%message = error%message//new_line('a')//'The cases, after the names of their groups:'//all_cases()
            return
        end if
        progress%quiet = arguments%quiet
        call stability%journal%open(arguments%value_of('--output', 'study'), 'stability', stability_columns, '', &
            arguments%force, error)
        if (allocated(error)) return
        if (stability%journal%beginning() /= '') call progress%remark(stability%journal%beginning())
        code = run_failed
        total = stability%total()
        do
            call stability%next_row(finished, error)
            if (allocated(error)) then
                if (is_input_error(error%stat)) code = input_wrong
                exit
            end if
            if (finished) exit
            call progress%remark(row_text(stability, total))
        end do
        call stability%journal%close()
        if (allocated(error)) return
        call stability%journal%write_hdf5('stability', about, [character(len=1) ::], [real(wp) ::], error)
        if (allocated(error)) return
        if (arguments%json) then
            call print_table_json(stability%journal%table)
        else if (.not. arguments%quiet) then
            call print_matrix(stability)
        end if
        code = merge(run_failed, done, stability%count_of('wrong') > 0)
    end subroutine study

    !> List of the cases, one line per group.
    function all_cases() result(text)
        character(len=:), allocatable :: text
        integer :: i

        text = ''
        do i = 1, size(case_groups)
            if (any(case_groups(:i - 1) == case_groups(i))) cycle
            text = text//new_line('a')//'  '//trim(case_groups(i))//': '//listed(pack(case_names, case_groups == case_groups(i)))
        end do
    end function all_cases

    !> Last row as text for the progress line.
    function row_text(stability, total) result(text)
        type(stability_type), intent(in) :: stability
        !> Total number of rows.
        integer, intent(in) :: total
        character(len=:), allocatable :: text
        character(len=8), parameter :: verdicts(5) = [character(len=8) :: 'held', 'degraded', 'refused', 'failed', 'wrong']
        integer :: row, i, number

        row = stability%journal%table%rows()
        number = 0
        do i = 1, size(verdicts)
            number = number + stability%count_of(trim(verdicts(i)))
        end do
        associate (table => stability%journal%table)
            text = to_text(number)//' of '//to_text(total)//': '//table%text_at(row, 'case')//', '// &
                table%text_at(row, 'stepper')//', '//table%text_at(row, 'control')//' '//table%text_at(row, 'value')//': '// &
                table%text_at(row, 'verdict')
            if (table%text_at(row, 'status') /= 'complete') then
                text = text//', '//table%text_at(row, 'status')
            else
                text = text//', error '//brief(table%real_at(row, 'error'))
            end if
            text = text//', '//brief(table%real_at(row, 'wall_seconds'))//' s'
        end associate
    end function row_text

    !> Print the matrix: one line per case, one column per stepper and kind of step control. A cell contains a letter, and the error
    !> or the status.
    subroutine print_matrix(stability)
        type(stability_type), intent(in) :: stability
        character(len=4), parameter :: controls(2) = ['step', 'rtol']
        character(len=:), allocatable :: line
        integer :: i, j, k

        do k = 1, 2
            line = 'fixed steps'
            if (k == 2) line = 'error control'
            line = line//repeat(' ', first - len(line))
            do j = 1, size(stepper_choices)
                line = line//fitted(trim(stepper_choices(j)), wide)
            end do
            call say(trim(line))
            do i = 1, size(stability%cases)
                line = fitted(trim(stability%cases(i)), first)
                do j = 1, size(stepper_choices)
                    line = line//fitted(cell(stability, trim(stability%cases(i)), trim(stepper_choices(j)), controls(k)), wide)
                end do
                if (len_trim(line) > first) call say(trim(line))
            end do
            call say('')
        end do
        call say('h held, with its error; d degraded: off by more than is allowed, and warned of; '// &
            'r refused; f failed; W wrong')
        call say(to_text(stability%count_of('held'))//' held, '//to_text(stability%count_of('degraded'))// &
            ' degraded, '//to_text(stability%count_of('refused'))//' refused, '//to_text(stability%count_of('failed'))// &
            ' failed, '//to_text(stability%count_of('wrong'))//' wrong')
        do i = 1, stability%journal%table%rows()
            associate (table => stability%journal%table)
                if (.not. any(stability%cases == table%text_at(i, 'case')) .or. table%text_at(i, 'verdict') /= 'wrong') cycle
                call say('wrong: '//table%text_at(i, 'case')//', '//table%text_at(i, 'stepper')//', '// &
                    table%text_at(i, 'control')//': error '//brief(table%real_at(i, 'error'))//', allowed '// &
                    brief(table%real_at(i, 'allowed'))//'; '//table%text_at(i, 'remark'))
            end associate
        end do
        call say('files: '//stability%journal%path//'.csv, .h5; picture: .venv/bin/python tools/plot.py '// &
            stability%journal%path//'.h5 '//stability%journal%path//'.png')
    end subroutine print_matrix

    !> Cell of a run in the matrix; empty if there is no such run.
    function cell(stability, case, stepper, control) result(text)
        type(stability_type), intent(in) :: stability
        character(len=*), intent(in) :: case, stepper, control
        character(len=:), allocatable :: text
        integer :: row

        text = ''
        row = stability%row_of(case, stepper, control)
        if (row == 0) return
        associate (table => stability%journal%table)
            select case (table%text_at(row, 'verdict'))
            case ('held')
                text = 'h '//brief(table%real_at(row, 'error'))
            case ('degraded')
                text = 'd '//brief(table%real_at(row, 'error'))
            case ('wrong')
                text = 'W '//brief(table%real_at(row, 'error'))
            case ('refused')
                text = 'r '//table%text_at(row, 'status')
            case default
                text = 'f '//table%text_at(row, 'status')
            end select
        end associate
    end function cell

    !> Text padded or truncated to a width.
    pure function fitted(text, width) result(cell)
        character(len=*), intent(in) :: text
        integer, intent(in) :: width
        character(len=width) :: cell

        cell = text
        if (len(text) >= width) cell(width:) = ' '
    end function fitted
end module tandem_cli_study_stability
