! SPDX-License-Identifier: MIT
!> Output of the profile of a run: a table of its parts, the cost of writing the file, and the uncertainty.
module tandem_cli_profile_table
    use tandem, only: long, n_part_groups, n_parts, part_group, part_group_name, part_name, profile_type, wp
    use tandem_cli_messages, only: padded, say
    use tandem_cli_report, only: count_text, print_line, short
    implicit none (type, external)
    private

    public :: print_profile

    !> Width of the names, and of a line.
    integer, parameter :: name_width = 44, line_width = 96
    !> Share of the processor below which a warning about other processes is printed.
    real(wp), parameter :: disturbed = 0.9_wp
    character(len=*), parameter :: row = '(2x, a44, a12, f13.6, f9.1, a15)'

contains

    !> Print the profile of a run.
    subroutine print_profile(profile)
        type(profile_type), intent(in) :: profile
        integer :: parts(n_parts), i, group, n
        character(len=line_width) :: line

        write (line, '(2x, a44, a12, a13, a9, a15)') padded('part of the run', name_width), 'calls', 'seconds', 'share', &
            'ns a call'
        call say(trim(line))
        do group = 1, n_part_groups
            n = 0
            do i = 1, n_parts
                ! Part 1 contains all time outside the other parts.
                if (part_group(i) /= group .or. (profile%calls(i) == 0 .and. i > 1)) cycle
                n = n + 1
                parts(n) = i
            end do
            if (n == 0) cycle
            call print_row(profile, part_group_name(group), parts(:n))
            ! If a group consists of one part with the same name, only the line of the group is printed.
            if (n == 1 .and. part_name(parts(1)) == part_group_name(group)) cycle
            do i = 1, n
                call print_row(profile, '  '//part_name(parts(i)), parts(i:i))
            end do
        end do
        write (line, row) padded('total without the clock', name_width), '', profile%total(), 100.0_wp, ''
        call say(trim(line))
        associate (bare => profile%bare_seconds(), output => profile%output_seconds())
            call print_line('output', short(100*output/bare, 2)//' % of the '//short(bare, 3)//' s without it, '// &
                'including work of model and chart for it')
        end associate
        call print_line('the clock', 'read '//count_text(2*profile%pairs)//' times, '// &
            nanoseconds(profile%cost_within + profile%cost_around)//' ns were subtracted for two readings, '// &
            short(profile%clock_seconds(), 2)//' s in total, included in the run time above')
        if (profile%plain > 0.0_wp) then
            call print_line('uncertain', 'by up to '//nanoseconds(profile%cost_within + profile%cost_around - &
                profile%cost_in_loop)//' ns per call (two readings take '//nanoseconds(profile%cost_in_loop)// &
                ' ns in a loop, but the run took '//short(profile%clocked, 2)//' s with clocks against '// &
                short(profile%plain, 2)//' s)')
        else
            call print_line('uncertain', 'by about the same amount per call, since the run was not compared without clocks')
        end if
        if (profile%processor < disturbed*profile%measured) call print_line('disturbed', 'the processor was available for '// &
            count_text(nint(100*profile%processor/profile%measured, long))//' % of the time: shares are more accurate than seconds')
    end subroutine print_profile

    !> Print a line of the table for one or several parts.
    subroutine print_row(profile, name, parts)
        type(profile_type), intent(in) :: profile
        character(len=*), intent(in) :: name
        integer, intent(in) :: parts(:)
        character(len=12) :: calls_text
        character(len=15) :: each
        character(len=line_width) :: line
        real(wp) :: seconds
        integer(long) :: calls
        integer :: i

        calls = sum(profile%calls(parts))
        seconds = 0.0_wp
        do i = 1, size(parts)
            seconds = seconds + profile%seconds(parts(i))
        end do
        calls_text = ''
        each = ''
        if (calls > 0) then
            write (calls_text, '(i12)') calls
            write (each, '(f15.0)') 1.0e9_wp*seconds/real(calls, wp)
            each(15:) = ''
            each = adjustr(each)
        end if
        write (line, row) padded(name, name_width), calls_text, seconds, 100*seconds/profile%total(), each
        call say(trim(line))
    end subroutine print_row

    !> Seconds as whole nanoseconds.
    function nanoseconds(seconds) result(text)
        real(wp), intent(in) :: seconds
        character(len=:), allocatable :: text

        text = count_text(nint(1.0e9_wp*seconds, long))
    end function nanoseconds
end module tandem_cli_profile_table
