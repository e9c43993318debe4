! SPDX-License-Identifier: MIT
!> Whether a result may be written to a path.
module tandem_io_output_target
    use hdf5, only: h5aexists_f, h5f_acc_rdonly_f, h5fclose_f, h5fis_hdf5_f, h5fopen_f, hid_t
    use tandem, only: error_type, set_error
    use tandem_status, only: status_output_failed
    use tandem_io_output_guard, only: is_taken
    use tandem_io_output_hdf5, only: start_library
    implicit none (type, external)
    private

    public :: check_target, is_result, is_hdf5, remove_file

contains

    !> Refuse a path that cannot be written, a file that exists, and one that somebody is writing. A file that is not there yet is
    !> made, empty.
    subroutine check_target(path, force, is_new, error)
        !> The result file.
        character(len=*), intent(in) :: path
        !> Whether a file that exists may be lost.
        logical, intent(in) :: force
        !> Whether there was no such file.
        logical, intent(out) :: is_new
        type(error_type), allocatable, intent(out) :: error
        character(len=:), allocatable :: folder
        character(len=256) :: message
        logical :: exists
        integer :: unit, stat, last

        is_new = .false.
        last = index(path, '/', back=.true.)
        folder = path(:last)
        if (last == 0) folder = './'
        inquire (file=folder//'.', exist=exists)
        if (.not. exists) then
            call set_error(error, status_output_failed, 'cannot write '//path//': there is no folder '//folder, &
                'make the folder or choose another file')
            return
        end if
        inquire (file=path//'/.', exist=exists)
        if (exists .or. last == len(path)) then
            call set_error(error, status_output_failed, 'cannot write '//path//': it is a folder', 'choose a file')
            return
        end if
        inquire (file=path, exist=exists)
        if (exists) call check_existing(path, force, error)
        if (allocated(error)) return
        ! The system says in its own words what stands in the way.
        message = ''
        if (exists) then
            open (newunit=unit, file=path, status='old', action='readwrite', access='stream', iostat=stat, iomsg=message)
        else
            open (newunit=unit, file=path, status='new', action='readwrite', access='stream', iostat=stat, iomsg=message)
        end if
        if (stat /= 0) then
            call set_error(error, status_output_failed, trim(message), 'choose a file that you may write')
            return
        end if
        close (unit)
        is_new = .not. exists
    end subroutine check_target

    !> Refuse to lose a file, unless that was asked for, and always one that is in use.
    subroutine check_existing(path, force, error)
        character(len=*), intent(in) :: path
        logical, intent(in) :: force
        type(error_type), allocatable, intent(out) :: error

        if (is_taken(path)) then
            call set_error(error, status_output_failed, path//' is in use: another run is writing it, or somebody reads it', &
                'choose another file')
        else if (.not. force) then
            call set_error(error, status_output_failed, path//' exists', 'choose another file, or overwrite it with --force')
        end if
    end subroutine check_existing

    !> Whether a file is there and tandem has written it.
    logical function is_result(path)
        character(len=*), intent(in) :: path
        integer(hid_t) :: file
        integer :: stat

        is_result = .false.
        if (.not. is_hdf5(path)) return
        call h5fopen_f(path, h5f_acc_rdonly_f, file, stat)
        if (stat /= 0) return
        call h5aexists_f(file, 'tandem_version', is_result, stat)
        is_result = is_result .and. stat == 0
        call h5fclose_f(file, stat)
    end function is_result

    !> Whether a file is there and is HDF5.
    logical function is_hdf5(path)
        character(len=*), intent(in) :: path
        integer :: stat

        is_hdf5 = .false.
        call start_library(stat)
        if (stat /= 0) return
        call h5fis_hdf5_f(path, is_hdf5, stat)
        is_hdf5 = is_hdf5 .and. stat == 0
    end function is_hdf5

    !> Remove a file, if it can be removed.
    subroutine remove_file(path)
        character(len=*), intent(in) :: path
        integer :: unit, stat

        open (newunit=unit, file=path, status='old', action='readwrite', iostat=stat)
        if (stat == 0) close (unit, status='delete')
    end subroutine remove_file
end module tandem_io_output_target
