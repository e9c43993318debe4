! SPDX-License-Identifier: MIT
!> Reference solution for errors: a motion at given times, from a file or from `tandem_io_study_measure`.
module tandem_io_study_reference
    use tandem, only: error_type, set_error, to_text, wp
    use tandem_io_output_hdf5, only: hdf5_type
    use tandem_io_output_target, only: is_hdf5
    use tandem_io_path, only: is_regular
    use tandem_io_scene_text, only: to_toml
    use tandem_io_study_files, only: read_whole, write_whole
    use tandem_number_text, only: read_numbers
    use tandem_status, only: status_invalid_option
    implicit none (type, external)
    private

    public :: reference_type, read_reference, write_reference

    !> A motion at given times.
    type :: reference_type
        !> Times in ascending order (k).
        real(wp), allocatable :: t(:)
        !> Coordinates and velocities (n, k).
        real(wp), allocatable :: q(:, :), qd(:, :)
        !> Differences in q and in qd of the solutions that were averaged: max-norms over all times. Smaller errors cannot be
        !> determined. Negative if unknown.
        real(wp) :: agreement_q = -1.0_wp, agreement_qd = -1.0_wp
        !> Description of the origin of the motion.
        character(len=:), allocatable :: origin
    end type reference_type

contains

    !> Read a reference: a result file of tandem with q and qd, or a text table as written by `write_reference`. Times after t_start
    !> and up to t_end are kept; from a result file, at most `most` of them at nearly equal distances.
    subroutine read_reference(path, t_start, t_end, q, qd, most, reference, error)
        character(len=*), intent(in) :: path
        !> Start and end of the run, and its initial state (n), which the reference must match if it contains this time.
        real(wp), intent(in) :: t_start, t_end, q(:), qd(:)
        integer, intent(in) :: most
        type(reference_type), intent(out) :: reference
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: rounding = 1.0e-12_wp, same_start = 1.0e-8_wp
        real(wp) :: span
        integer :: i
        logical :: from_hdf5

        reference%origin = path
        if (.not. is_regular(path)) then
            call set_error(error, status_invalid_option, 'the reference '//path// &
                ' cannot be read: there is no such file, or it is a folder, a pipe or a device', 'choose another file')
            return
        end if
        from_hdf5 = is_hdf5(path)
        if (from_hdf5) then
            call read_result(path, reference, error)
        else
            call read_table(path, reference, error)
        end if
        if (allocated(error)) return
        if (size(reference%q, 1) /= size(q)) then
            call set_error(error, status_invalid_option, 'the reference '//path//' has '//to_text(size(reference%q, 1))// &
                ' coordinates, the scene has '//to_text(size(q)), 'give a reference of this scene')
            return
        end if
        span = t_end - t_start
        do i = 1, size(reference%t)
            if (abs(reference%t(i) - t_start) > rounding*span) cycle
            if (max(maxval(abs(reference%q(:, i) - q)), maxval(abs(reference%qd(:, i) - qd))) <= same_start) cycle
            call set_error(error, status_invalid_option, 'the reference '//path//' does not start where the scene does', &
                'give a reference of this scene')
            return
        end do
        call select_times(reference, reference%t > t_start + rounding*span .and. reference%t <= t_end + rounding*span)
        if (from_hdf5) call select_times(reference, spread_evenly(size(reference%t), most))
        if (size(reference%t) == 0) call set_error(error, status_invalid_option, 'the reference '//path// &
            ' has no time after the start and up to the end of the scene', 'give a reference of these times')
    end subroutine read_reference

    !> Keep some of the times.
    subroutine select_times(reference, which)
        type(reference_type), intent(inout) :: reference
        !> True for each time to keep (k).
        logical, intent(in) :: which(:)
        integer, allocatable :: kept(:)
        integer :: i

        allocate (kept, source=pack([(i, i=1, size(which))], which))
        reference%t = reference%t(kept)
        reference%q = reference%q(:, kept)
        reference%qd = reference%qd(:, kept)
    end subroutine select_times

    !> Select at most `most` of `total` rows at nearly equal distances, including the last one.
    pure function spread_evenly(total, most) result(which)
        integer, intent(in) :: total, most
        logical :: which(total)
        integer :: i

        which = total <= most
        if (total <= most) return
        do i = 1, most
            which(nint(real(i, wp)*total/most)) = .true.
        end do
    end function spread_evenly

    !> Read a result file of tandem.
    subroutine read_result(path, reference, error)
        character(len=*), intent(in) :: path
        type(reference_type), intent(inout) :: reference
        type(error_type), allocatable, intent(out) :: error
        type(hdf5_type) :: file
        real(wp), allocatable :: t(:, :)

        call file%open_to_read(path)
        call file%get('/trajectory/time', t)
        call file%get('/trajectory/q', reference%q)
        call file%get('/trajectory/qd', reference%qd)
        call file%close()
        if (allocated(file%problem)) then
            call set_error(error, status_invalid_option, 'the reference '//path//': '//file%problem, &
                'give a result file of tandem with the fields q and qd')
            return
        end if
        reference%t = t(1, :)
    end subroutine read_result

    !> Read a text table: comments, a line with the numbers of rows, coordinates and multipliers, then one row per time with t, q,
    !> qd and further columns. A comment `agreement: Q QD` gives the accuracy of the values.
    subroutine read_table(path, reference, error)
        character(len=*), intent(in) :: path
        type(reference_type), intent(inout) :: reference
        type(error_type), allocatable, intent(out) :: error
        character(len=*), parameter :: agreement_mark = '# agreement:'
        character(len=:), allocatable :: text
        real(wp), allocatable :: row(:)
        real(wp) :: sizes(2), agreement(2)
        integer :: from, last, n, i
        logical :: is_read

        call read_whole(path, text)
        if (.not. allocated(text)) then
            call set_error(error, status_invalid_option, 'the reference '//path//' cannot be read', 'choose another file')
            return
        end if
        is_read = .true.
        sizes = 0.0_wp
        from = 1
        do while (from <= len(text) .and. is_read)
            call find_line()
            if (index(text(from:last), agreement_mark) == 1) then
                call read_numbers(text(from + len(agreement_mark):last), agreement, is_read, may_be_more=.true.)
                reference%agreement_q = agreement(1)
                reference%agreement_qd = agreement(2)
            else if (text(from:min(from, last)) /= '#') then
                call read_numbers(text(from:last), sizes, is_read, may_be_more=.true.)
                exit
            end if
            from = last + 2
        end do
        ! The file cannot contain more numbers than characters, which limits the allocated size.
        is_read = is_read .and. all(sizes >= 1.0_wp) .and. sizes(1)*sizes(2) <= len(text)
        if (is_read) then
            n = nint(sizes(2))
            allocate (row(2*n + 1), reference%t(nint(sizes(1))), reference%q(n, nint(sizes(1))), reference%qd(n, nint(sizes(1))))
            do i = 1, size(reference%t)
                from = last + 2
                call find_line()
                call read_numbers(text(from:last), row, is_read, may_be_more=.true.)
                if (.not. is_read) exit
                reference%t(i) = row(1)
                reference%q(:, i) = row(2:n + 1)
                reference%qd(:, i) = row(n + 2:)
            end do
        end if
        if (.not. is_read) call set_error(error, status_invalid_option, 'the reference '//path// &
            ' is neither a result file nor a table of times, q and qd', 'see doc/precision.md for the format')

    contains

        !> Find the end of the line that begins at `from`.
        subroutine find_line()
            last = index(text(min(from, len(text) + 1):), achar(10))
            last = merge(from + last - 2, len(text), last > 0)
        end subroutine find_line
    end subroutine read_table

    !> Write a reference as a text table, with all digits.
    subroutine write_reference(path, name, reference, error)
        !> Path of the file, and name of the scene.
        character(len=*), intent(in) :: path, name
        type(reference_type), intent(in) :: reference
        type(error_type), allocatable, intent(out) :: error
        character(len=*), parameter :: newline = new_line('a')
        character(len=:), allocatable :: text
        integer :: i

        text = '# name: '//name//newline//'# how: '//reference%origin//newline
        text = text//'# agreement: '//to_toml(reference%agreement_q)//' '//to_toml(reference%agreement_qd)//newline
        text = text//'# first line: number of rows, of coordinates n, of multipliers; then a row a time: t, q (n), qd (n)'//newline
        text = text//to_text(size(reference%t))//' '//to_text(size(reference%q, 1))//' 0'//newline
        do i = 1, size(reference%t)
            text = text//to_toml(reference%t(i))//row_of(reference%q(:, i))//row_of(reference%qd(:, i))//newline
        end do
        call write_whole(path, text, error)
    end subroutine write_reference

    !> Numbers, each preceded by a blank.
    pure function row_of(values) result(text)
        real(wp), intent(in) :: values(:)
        character(len=:), allocatable :: text
        integer :: i

        text = ''
        do i = 1, size(values)
            text = text//' '//to_toml(values(i))
        end do
    end function row_of
end module tandem_io_study_reference
