! SPDX-License-Identifier: MIT
!> Summary of a sweep: extremes, means and histograms of all outputs, failures by status, and Sobol' indices.
module tandem_cli_sweep_summary
    use tandem, only: error_type, long, to_text, wp
    use tandem_cli_messages, only: padded, say
    use tandem_io, only: bins, column_summary_type, indices_path, json_type, name_of_status, output_path, plan_type, &
        read_column, summarise, sweep_journal_type
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)
    private

    public :: print_summary, print_summary_json

    !> Largest number of printed outputs, and of distinct statuses.
    integer, parameter :: most_lines = 40, most_statuses = 30

    !> Number of failures with one status.
    type :: failures_type
        integer :: status = 0
        integer(long) :: cases = 0, first = 0
    end type failures_type

contains

    !> Print the summary as text.
    subroutine print_summary(table, plan, journal, error)
        character(len=*), intent(in) :: table
        type(plan_type), intent(in) :: plan
        type(sweep_journal_type), intent(in) :: journal
        type(error_type), allocatable, intent(out) :: error
        type(failures_type) :: failures(most_statuses)
        type(column_summary_type) :: summary
        real(wp), allocatable :: values(:, :)
        integer :: i, j, n, lines

        call say(to_text(int(plan%n_cases()))//' cases, '//to_text(int(journal%failed))//' failed')
        call group_failures(table, failures, n, error)
        do i = 1, n
            call say('  '//padded(trim(name_of_status(failures(i)%status)), 22)//to_text(int(failures(i)%cases))// &
                ' cases, the first '//to_text(int(failures(i)%first)))
        end do
        lines = 0
        do i = 1, size(plan%kept)
            if (allocated(error)) return
            call read_column(table, output_path(plan%kept(i)), values, error)
            if (allocated(error)) return
            do j = 1, size(values, 1)
                lines = lines + 1
                if (lines > most_lines) cycle
                call summarise(values(j, :), summary)
                call say(label(plan, i, j)//': mean '//figures(summary%mean)//', deviation '//figures(summary%deviation)// &
                    ', from '//figures(summary%least)//' (case '//to_text(int(summary%case_of_least))//') to '// &
                    figures(summary%most)//' (case '//to_text(int(summary%case_of_most))//')')
                if (summary%n > 1) call say('  '//bars(summary%histogram))
            end do
        end do
        if (lines > most_lines) call say('and '//to_text(lines - most_lines)//' more numbers in the table')
        if (plan%is_for_indices .and. .not. allocated(error)) call print_indices(table, plan, error)
    end subroutine print_summary

    !> Name and unit of a value of an output.
    function label(plan, i, j)
        type(plan_type), intent(in) :: plan
        integer, intent(in) :: i, j
        character(len=:), allocatable :: label

        associate (kept => plan%kept(i))
            label = trim(kept%name)
            if (allocated(kept%times)) label = label//' at '//figures(kept%times(j))//' s'
            if (kept%unit /= '' .and. kept%unit /= '1') label = label//' ['//trim(kept%unit)//']'
        end associate
    end function label

    !> Number with six digits.
    pure function figures(value) result(text)
        real(wp), intent(in) :: value
        character(len=:), allocatable :: text
        character(len=20) :: buffer

        write (buffer, '(g0.6)') value
        text = trim(adjustl(buffer))
        if (text(1:1) == '.') text = '0'//text
        if (index(text, '-.') == 1) text = '-0'//text(2:)
    end function figures

    !> Histogram in one line of characters with heights in eighths.
    pure function bars(histogram) result(line)
        integer(long), intent(in) :: histogram(bins)
        character(len=:), allocatable :: line
        integer :: i, eighths

        line = ''
        do i = 1, bins
            eighths = ceiling(8*real(histogram(i), wp)/real(maxval(histogram), wp))
            if (eighths == 0) then
                line = line//' '
            else
                ! U+2581 to U+2588.
                line = line//char(226)//char(150)//char(128 + eighths)
            end if
        end do
    end function bars

    !> Count the failures with each status.
    subroutine group_failures(table, failures, n, error)
        character(len=*), intent(in) :: table
        type(failures_type), intent(out) :: failures(:)
        integer, intent(out) :: n
        type(error_type), allocatable, intent(out) :: error
        real(wp), allocatable :: status(:, :)
        integer :: i, j

        n = 0
        call read_column(table, '/status', status, error)
        if (allocated(error)) return
        do i = 1, size(status, 2)
            if (nint(status(1, i)) == 0) cycle
            j = findloc(failures(:n)%status, nint(status(1, i)), dim=1)
            if (j == 0) then
                if (n == size(failures)) cycle
                n = n + 1
                j = n
                failures(j) = failures_type(nint(status(1, i)), 0, i)
            end if
            failures(j)%cases = failures(j)%cases + 1
        end do
    end subroutine group_failures

    !> Print Sobol' indices, one line per input.
    subroutine print_indices(table, plan, error)
        character(len=*), intent(in) :: table
        type(plan_type), intent(in) :: plan
        type(error_type), allocatable, intent(out) :: error
        real(wp), allocatable :: indices(:, :)
        integer :: i, j

        do i = 1, min(size(plan%kept), most_lines)
            if (allocated(plan%kept(i)%times)) cycle
            call read_column(table, indices_path(plan%kept(i)), indices, error)
            if (allocated(error)) return
            call say("Sobol' indices of "//trim(plan%kept(i)%name)//': first order, total (with 95 %)')
            do j = 1, size(plan%inputs)
                if (.not. plan%inputs(j)%is_drawn()) cycle
                associate (row => indices(:, plan%inputs(j)%column))
                    call say('  '//padded(trim(plan%inputs(j)%name), 24)//padded(rounded(row(1))//' +- '//rounded(row(2)), 20)// &
                        rounded(row(3))//' +- '//rounded(row(4)))
                end associate
            end do
        end do
    end subroutine print_indices

    !> Number with four decimals.
    pure function rounded(value) result(text)
        real(wp), intent(in) :: value
        character(len=7) :: text

        text = '    -'
        if (ieee_is_finite(value)) write (text, '(f7.4)') value
    end function rounded

    !> Print the summary as JSON.
    subroutine print_summary_json(table, plan, journal, error)
        character(len=*), intent(in) :: table
        type(plan_type), intent(in) :: plan
        type(sweep_journal_type), intent(in) :: journal
        type(error_type), allocatable, intent(out) :: error
        type(json_type) :: json
        type(failures_type) :: failures(most_statuses)
        type(column_summary_type) :: summary
        real(wp), allocatable :: values(:, :), indices(:, :)
        integer :: i, j, n

        json%text = ''
        call json%begin_object()
        call json%add('table', table)
        call json%add('cases', plan%n_cases())
        call json%add('failed', journal%failed)
        call group_failures(table, failures, n, error)
        call json%begin_object('failures')
        do i = 1, n
            call json%add(trim(name_of_status(failures(i)%status)), failures(i)%cases)
        end do
        call json%end_object()
        call json%begin_array('outputs')
        do i = 1, size(plan%kept)
            if (allocated(error)) return
            call read_column(table, output_path(plan%kept(i)), values, error)
            if (allocated(error)) return
            do j = 1, size(values, 1)
                call summarise(values(j, :), summary)
                call json%begin_object()
                call json%add('name', trim(plan%kept(i)%name))
                if (allocated(plan%kept(i)%times)) call json%add('time', plan%kept(i)%times(j))
                call json%add('unit', trim(plan%kept(i)%unit))
                call json%add('values', summary%n)
                call json%add('mean', summary%mean)
                call json%add('deviation', summary%deviation)
                call json%add('least', summary%least)
                call json%add('case_of_least', summary%case_of_least)
                call json%add('most', summary%most)
                call json%add('case_of_most', summary%case_of_most)
                if (plan%is_for_indices .and. .not. allocated(plan%kept(i)%times)) then
                    call read_column(table, indices_path(plan%kept(i)), indices, error)
                    if (allocated(error)) return
                    call json%add('first_order', indices(1, :))
                    call json%add('first_order_error', indices(2, :))
                    call json%add('total', indices(3, :))
                    call json%add('total_error', indices(4, :))
                end if
                call json%end_object()
            end do
        end do
        call json%end_array()
        call json%end_object()
        call say(json%text)
    end subroutine print_summary_json
end module tandem_cli_sweep_summary
