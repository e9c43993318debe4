! SPDX-License-Identifier: MIT
!> Checks of files before results are written to them or read from them.
module tandem_io_output_target
    use hdf5, only: h5aexists_f, h5f_acc_rdonly_f, h5fclose_f, h5fis_hdf5_f, h5fopen_f, hid_t
    use tandem, only: error_type, set_error
    use tandem_status, only: status_invalid_checkpoint, status_output_failed
    use tandem_io_output_guard, only: guard_type, is_locked
    use tandem_io_output_hdf5, only: start_library
    use tandem_io_path, only: is_dangling, is_regular
    use, intrinsic :: iso_c_binding, only: c_int64_t
    implicit none (type, external)
    private

    public :: check_source, check_target, in_use, is_result, is_hdf5, remove_file

    !> Message about a file that must not be changed.
    character(len=*), parameter :: in_use = 'it is in use: another run writes it, or another process reads it'

contains

    !> Check a path for a new result. A path that cannot be written, an existing file without `force`, and a file in use are
    !> refused. If the file does not exist, an empty one is created.
    subroutine check_target(path, force, is_new, error)
        !> Path of the result file.
        character(len=*), intent(in) :: path
        !> True if an existing file may be overwritten.
        logical, intent(in) :: force
        !> True if the file did not exist.
        logical, intent(out) :: is_new
        type(error_type), allocatable, intent(out) :: error
        character(len=:), allocatable :: folder
        character(len=256) :: message
        logical :: exists
        integer :: unit, stat, last

        is_new = .false.
        if (path == '-') then
            call set_error(error, status_output_failed, 'cannot write to standard output: HDF5 requires random access', &
                'choose a file; for this name write ./-')
            return
        end if
        last = index(path, '/', back=.true.)
        folder = path(:last)
        if (last == 0) folder = './'
        inquire (file=folder//'.', exist=exists)
        if (.not. exists) then
            call set_error(error, status_output_failed, 'cannot write '//path//': there is no folder '//folder, &
                'create the folder or choose another file')
            return
        end if
        inquire (file=path//'/.', exist=exists)
        if (exists .or. last == len(path)) then
            call set_error(error, status_output_failed, 'cannot write '//path//': it is a folder', 'choose a file')
            return
        end if
        inquire (file=path, exist=exists)
        if (exists .and. .not. is_regular(path)) then
            call set_error(error, status_output_failed, 'cannot write '//path//': it is a pipe or a device, not a regular file', &
                'choose a file')
            return
        end if
        if (is_dangling(path)) then
            call set_error(error, status_output_failed, 'cannot write '//path//': it is a symbolic link to nothing', &
                'remove the link or choose another file')
            return
        end if
        if (exists) call check_existing(path, force, error)
        if (allocated(error)) return
        ! The message of the system is reported.
        message = ''
        if (exists) then
            open (newunit=unit, file=path, status='old', action='readwrite', access='stream', iostat=stat, iomsg=message)
        else
            open (newunit=unit, file=path, status='new', action='readwrite', access='stream', iostat=stat, iomsg=message)
        end if
        if (stat /= 0) then
            call set_error(error, status_output_failed, trim(message), 'choose a file with write permission')
            return
        end if
        close (unit)
        is_new = .not. exists
    end subroutine check_target

    !> Refuse to overwrite a file that is in use, or that exists without `force`.
    subroutine check_existing(path, force, error)
        character(len=*), intent(in) :: path
        logical, intent(in) :: force
        type(error_type), allocatable, intent(out) :: error

        if (is_locked(path)) then
            call set_error(error, status_output_failed, path//' is in use: another run writes it, or another process reads it', &
                'choose another file')
        else if (.not. force) then
            call set_error(error, status_output_failed, path//' exists', 'choose another file, or overwrite it with --force')
        end if
    end subroutine check_existing

    !> Refuse a file that is not a result of tandem or is being written. If the file is to be changed, remove a mark left by the
    !> killed writer of another program; tandem does not write this mark.
    subroutine check_source(path, error, purpose)
        character(len=*), intent(in) :: path
        type(error_type), allocatable, intent(out) :: error
        !> Purpose named in messages; absent if the run is to be resumed in the file.
        character(len=*), intent(in), optional :: purpose
        type(guard_type) :: guard
        logical :: exists

        inquire (file=path, exist=exists)
        if (.not. exists) then
            call refuse('there is no such file')
            return
        end if
        if (.not. is_regular(path)) then
            call refuse('it is a folder, a pipe or a device, not a regular file')
            return
        end if
        if (is_locked(path)) then
            call refuse(in_use)
            return
        end if
        if (.not. present(purpose) .and. is_marked(path)) then
            call guard%lock(path)
            call guard%repair(0_c_int64_t)
            call guard%release()
        end if
        if (.not. is_hdf5(path)) then
            call refuse('it is not a result of tandem (HDF5)')
        else if (.not. can_be_opened(path)) then
            call refuse('it is damaged: HDF5 cannot open it')
        else if (.not. is_result(path)) then
            call refuse('it is not a result of tandem')
        end if

    contains

        subroutine refuse(reason)
            character(len=*), intent(in) :: reason

            if (present(purpose)) then
                call set_error(error, status_invalid_checkpoint, 'cannot '//purpose//' '//path//': '//reason, &
                    'use the result of a run')
            else
                call set_error(error, status_invalid_checkpoint, 'cannot resume from '//path//': '//reason, &
                    'use the result of a run; a run that was killed before its first row must be restarted')
            end if
        end subroutine refuse
    end subroutine check_source

    !> True if HDF5 has marked the file as open for writing. Without a writer, the mark was left by a killed one.
    logical function is_marked(path)
        character(len=*), intent(in) :: path
        !> Positions of the superblock's version and of the mark, from 1, and the version that has this mark (HDF5 File Format
        !> Specification, III.A).
        integer, parameter :: version_at = 9, marks_at = 12, version_with_marks = 3
        character :: version, marks
        integer :: unit, stat

        is_marked = .false.
        open (newunit=unit, file=path, status='old', action='read', access='stream', iostat=stat)
        if (stat /= 0) return
        read (unit, pos=version_at, iostat=stat) version
        if (stat == 0) read (unit, pos=marks_at, iostat=stat) marks
        if (stat == 0) is_marked = ichar(version) == version_with_marks .and. ichar(marks) /= 0
        close (unit)
    end function is_marked

    !> True if HDF5 can open a file.
    logical function can_be_opened(path)
        character(len=*), intent(in) :: path
        integer(hid_t) :: file
        integer :: stat

        call h5fopen_f(path, h5f_acc_rdonly_f, file, stat)
        can_be_opened = stat == 0
        if (can_be_opened) call h5fclose_f(file, stat)
    end function can_be_opened

    !> True if a file exists and is a result of tandem.
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

    !> True if a regular file exists and is in HDF5 format.
    logical function is_hdf5(path)
        character(len=*), intent(in) :: path
        integer :: stat

        is_hdf5 = .false.
        ! HDF5 would block until a writer opens the pipe.
        if (.not. is_regular(path)) return
        call start_library(stat)
        if (stat /= 0) return
        call h5fis_hdf5_f(path, is_hdf5, stat)
        is_hdf5 = is_hdf5 .and. stat == 0
    end function is_hdf5

    !> Remove a file, if possible.
    subroutine remove_file(path)
        character(len=*), intent(in) :: path
        integer :: unit, stat

        open (newunit=unit, file=path, status='old', action='readwrite', iostat=stat)
        if (stat == 0) close (unit, status='delete')
    end subroutine remove_file
end module tandem_io_output_target
