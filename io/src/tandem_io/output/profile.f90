! SPDX-License-Identifier: MIT
!> Writes the profile of a run: the group /report/profile, with one row per part of the program that was entered.
module tandem_io_output_profile
    use tandem, only: n_parts, part_group, part_group_name, part_name, profile_type, wp
    use tandem_io_output_hdf5, only: hdf5_type
    implicit none (type, external)
    private

    public :: write_profile

    character(len=*), parameter :: group_path = '/report/profile'

contains

    !> Create the group.
    subroutine write_profile(file, profile)
        type(hdf5_type), intent(inout) :: file
        type(profile_type), intent(in) :: profile
        character(len=len(part_name(1))) :: names(n_parts)
        character(len=len(part_group_name)) :: groups(n_parts)
        real(wp) :: seconds(n_parts)
        integer :: rows(n_parts), i, n

        n = 0
        do i = 1, n_parts
            ! Part 1 contains all time outside the other parts; it is not counted as entered.
            if (i > 1 .and. profile%calls(i) == 0) cycle
            n = n + 1
            rows(n) = i
            names(n) = part_name(i)
            groups(n) = part_group_name(part_group(i))
            seconds(n) = profile%seconds(i)
        end do
        call file%add_group(group_path)
        call file%put(group_path//'/part', names(:n))
        call file%put(group_path//'/group', groups(:n))
        call file%put(group_path//'/calls', profile%calls(rows(:n)))
        call file%put(group_path//'/seconds', seconds(:n))
        call file%attach(group_path//'/seconds', 'unit', 's')
        call file%attach(group_path//'/seconds', 'meaning', 'time in the part without its subparts, corrected for the clock')
        call file%attach(group_path, 'seconds', profile%total())
        call file%attach(group_path, 'measured_seconds', profile%measured)
        call file%attach(group_path, 'processor_seconds', profile%processor)
        call file%attach(group_path, 'output_seconds', profile%output_seconds())
        call file%attach(group_path, 'bare_seconds', profile%bare_seconds())
        call file%attach(group_path, 'clock_seconds', profile%clock_seconds())
        call file%attach(group_path, 'clock_pairs', profile%pairs)
        call file%attach(group_path, 'clock_pair_seconds', profile%cost_within + profile%cost_around)
        call file%attach(group_path, 'clock_pair_seconds_in_loop', profile%cost_in_loop)
        call file%attach(group_path, 'compared_with_clocks', profile%clocked)
        call file%attach(group_path, 'compared_without', profile%plain)
    end subroutine write_profile
end module tandem_io_output_profile
