! SPDX-License-Identifier: MIT
!> tandem study tables: comparison of the tables and figures of the paper with the results of tandem.
module tandem_cli_study_tables
    use tandem, only: error_type, is_input_error, wp
    use tandem_cli_arguments, only: arguments_type
    use tandem_cli_messages, only: print_to_stderr, done, input_wrong, padded, run_failed, say
    use tandem_cli_study_json, only: print_table_json
    use tandem_cli_study_progress, only: study_progress_type
    use tandem_io, only: brief, paper_columns, paper_type
    implicit none (type, external)
    private

    public :: study_tables

contains

    !> Carry out the runs of the paper, print the table, and write its files.
    subroutine study_tables(arguments, code)
        type(arguments_type), intent(in) :: arguments
        !> Exit code.
        integer, intent(out) :: code
        type(error_type), allocatable :: error

        code = input_wrong
        call make_tables(arguments, code, error)
        if (allocated(error)) then
            call print_to_stderr(error%message)
        else
            code = done
        end if
    end subroutine study_tables

    !> Carry out the runs.
    subroutine make_tables(arguments, code, error)
        type(arguments_type), intent(in) :: arguments
        !> Exit code; set after an error.
        integer, intent(out) :: code
        type(error_type), allocatable, intent(out) :: error
        character(len=*), parameter :: about = 'the results of E. J. Haug, Mechanics Based Design of Structures and Machines, '// &
            '2016, sections 7 to 9, and those of tandem; constraint errors are max-norms over all steps, in the units of their rows'
        type(paper_type) :: study
        type(study_progress_type) :: progress
        character(len=:), allocatable :: what
        logical :: finished

        code = input_wrong
        progress%quiet = arguments%quiet
        call study%journal%open(arguments%value_of('--output', 'study'), 'tables', paper_columns, '', arguments%force, error)
        if (allocated(error)) return
        if (study%journal%beginning() /= '') call progress%remark(study%journal%beginning())
        code = run_failed
        do
            call study%next_run(finished, what, error)
            if (allocated(error)) then
                if (is_input_error(error%stat)) code = input_wrong
                exit
            end if
            if (finished) exit
            call progress%remark(what)
        end do
        call study%journal%close()
        if (allocated(error)) return
        call study%journal%write_hdf5('tables', about, [character(len=1) ::], [real(wp) ::], error)
        if (allocated(error)) return
        if (arguments%json) then
            call print_table_json(study%journal%table)
        else if (.not. arguments%quiet) then
            call print_tables(study)
        end if
    end subroutine make_tables

    !> Print the rows, with a heading for each run.
    subroutine print_tables(study)
        type(paper_type), intent(in) :: study
        character(len=:), allocatable :: heading, last, ours
        integer :: row

        last = ''
        associate (table => study%journal%table)
            do row = 1, table%rows()
                heading = table%text_at(row, 'place')//', '//table%text_at(row, 'scene')//', '//table%text_at(row, 'stepper')// &
                    ', h = '//table%text_at(row, 'step')//' s, Tol = '//table%text_at(row, 'tolerance')
                if (heading /= last) call say(heading)
                last = heading
                ours = table%text_at(row, 'ours')
                if (len(ours) > 4) ours = brief(table%real_at(row, 'ours'))
                call say(padded('  '//table%text_at(row, 'quantity'), 21)//padded('paper '//table%text_at(row, 'paper'), 16)// &
                    padded('ours '//ours, 14)//table%text_at(row, 'difference'))
            end do
        end associate
        call say('files: '//study%journal%path//'.csv, .h5')
    end subroutine print_tables
end module tandem_cli_study_tables
