! SPDX-License-Identifier: MIT
!> Root attributes and groups of a result file.
submodule(tandem_io_output_trajectory) tandem_io_output_trajectory_head
    use tandem_name_index, only: name_index_type
    use tandem_io_output_crossings, only: crossings_path
    use tandem_io_version, only: format_version, tandem_version
    implicit none (type, external)

contains

    module procedure add_groups
        character(len=:), allocatable :: path
        type(name_index_type) :: existing
        integer :: i, k

        if (.not. allocated(model%quantities)) return
        do i = 1, size(model%quantities)
            path = model%quantities(i)%place()
            do k = 2, len(path)
                if (path(k:k) /= '/') cycle
                if (existing%get(path(:k)) > 0) cycle
                call existing%put(path(:k), i)
                call file%add_group(path(:k - 1))
            end do
        end do
    end procedure add_groups

    module procedure attach_head
        call file%attach('/', 'format_version', int(format_version, long))
        call file%attach('/', 'tandem_version', tandem_version)
        call file%attach('/', 'created', time_stamp())
        call file%attach('/', 'status', 'running')
        call file%attach('/', 'status_message', '')
        call file%attach('/', 'layout', 'row i of every dataset belongs to /trajectory/time[i]: shape (nt) or (nt, n) in C '// &
            'and Python, (nt) or (n, nt) in Fortran')
        if (present(command)) call file%attach('/', 'command', command)
        if (present(scene)) call file%attach('/', 'scene', scene)
    end procedure attach_head

    module procedure reset_outcome
        character(len=:), allocatable :: old

        ! Writes that may need space come first, so that nothing else is lost on a full disk.
        call file%get_text('/', 'scene', old)
        if (old /= scene) call file%attach('/', 'scene', scene)
        call file%flush()
        call file%attach('/', 'status_message', '')
        call file%detach_all('/report')
        call file%remove('/report/profile')
        if (file%has('/events')) call file%remove(crossings_path)
        call file%flush()
    end procedure reset_outcome

    module procedure time_stamp
        character(len=10) :: time
        character(len=8) :: date
        character(len=5) :: zone

        call date_and_time(date, time, zone)
        text = date(1:4)//'-'//date(5:6)//'-'//date(7:8)//'T'//time(1:2)//':'//time(3:4)//':'//time(5:6)//zone(1:3)//':'// &
            zone(4:5)
    end procedure time_stamp
end submodule tandem_io_output_trajectory_head
