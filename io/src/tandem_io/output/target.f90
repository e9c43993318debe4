! SPDX-License-Identifier: MIT
!> Whether a result may be written to a path.
module tandem_io_output_target
    use tandem, only: error_type, set_error
    use tandem_status, only: status_output_failed
    use tandem_io_output_hdf5, only: holds_attribute
    implicit none (type, external)
    private

    public :: check_target, is_hdf5, remove_file

contains

    !> Refuse a path that cannot be written, and a file that is no result of tandem. A file that is not there yet is made, empty.
    subroutine check_target(path, force, is_new, error)
        !> The result file.
        character(len=*), intent(in) :: path
        !> Whether a file may be lost that is no result of tandem.
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
        if (exists .and. .not. force) call check_result(path, error)
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

    !> Refuse to lose a file that tandem did not write.
    subroutine check_result(path, error)
        character(len=*), intent(in) :: path
        type(error_type), allocatable, intent(out) :: error
        logical :: is_file, can_be_opened, is_result

        call holds_attribute(path, 'tandem_version', is_file, can_be_opened, is_result)
        if (is_result) return
        if (is_file .and. .not. can_be_opened) then
            call set_error(error, status_output_failed, path//' is damaged, or another run is writing it', &
                'choose another file, or overwrite it with --force')
        else
            call set_error(error, status_output_failed, path//' exists and is no result of tandem', &
                'choose another file, or overwrite it with --force')
        end if
    end subroutine check_result

    !> Whether a file is there and is HDF5.
    logical function is_hdf5(path)
        character(len=*), intent(in) :: path
        logical :: can_be_opened, holds

        call holds_attribute(path, 'tandem_version', is_hdf5, can_be_opened, holds)
    end function is_hdf5

    !> Remove a file, if it can be removed.
    subroutine remove_file(path)
        character(len=*), intent(in) :: path
        integer :: unit, stat

        open (newunit=unit, file=path, status='old', action='readwrite', iostat=stat)
        if (stat == 0) close (unit, status='delete')
    end subroutine remove_file
end module tandem_io_output_target
