! SPDX-License-Identifier: MIT
!> Writes the profile of a run: the group /report/profile, a row for each part that was entered.
module tandem_io_output_profile
    use tandem, only: n_parts, part_group, part_group_name, part_name, profile_type, wp
    use tandem_io_output_hdf5, only: hdf5_type
    implicit none (type, external)
    private

    public :: write_profile

    character(len=*), parameter :: place = '/report/profile'

contains

    !> Make the group.
    subroutine write_profile(file, profile)
        type(hdf5_type), intent(inout) :: file
        type(profile_type), intent(in) :: profile
        character(len=len(part_name(1))) :: names(n_parts)
        character(len=len(part_group_name)) :: groups(n_parts)
        real(wp) :: seconds(n_parts)
        integer :: rows(n_parts), i, n

        n = 0
        do i = 1, n_parts
            ! The first is what is in no other.
            if (i > 1 .and. profile%calls(i) == 0) cycle
            n = n + 1
            rows(n) = i
            names(n) = part_name(i)
            groups(n) = part_group_name(part_group(i))
            seconds(n) = profile%seconds(i)
        end do
        call file%add_group(place)
        call file%put(place//'/part', names(:n))
        call file%put(place//'/group', groups(:n))
        call file%put(place//'/calls', profile%calls(rows(:n)))
        call file%put(place//'/seconds', seconds(:n))
        call file%attach(place//'/seconds', 'unit', 's')
        call file%attach(place//'/seconds', 'meaning', 'time in the part without its subparts, corrected for the clock')
        call file%attach(place, 'seconds', profile%total())
        call file%attach(place, 'measured_seconds', profile%measured)
        call file%attach(place, 'processor_seconds', profile%processor)
        call file%attach(place, 'output_seconds', profile%output_seconds())
        call file%attach(place, 'bare_seconds', profile%bare_seconds())
        call file%attach(place, 'clock_seconds', profile%clock_seconds())
        call file%attach(place, 'clock_pairs', profile%pairs)
        call file%attach(place, 'clock_pair_seconds', profile%cost_within + profile%cost_around)
        call file%attach(place, 'clock_pair_seconds_in_loop', profile%cost_in_loop)
        call file%attach(place, 'compared_with_clocks', profile%clocked)
        call file%attach(place, 'compared_without', profile%plain)
    end subroutine write_profile
end module tandem_io_output_profile
