! SPDX-License-Identifier: MIT
!> Synchronisation of files with the disk, so that they survive a power failure. Implemented in disk.c.
module tandem_io_sweep_disk
    use tandem, only: error_type, set_error, status_output_failed
    use, intrinsic :: iso_c_binding, only: c_char, c_int, c_null_char
    implicit none (type, external)
    private

    public :: sync_file, sync_folder_of, sync_open

    interface
        function c_sync(path) result(stat) bind(c, name='tandem_disk_sync')
            import :: c_char, c_int
            implicit none (type, external)
            character(kind=c_char), intent(in) :: path(*)
            integer(c_int) :: stat
        end function c_sync

        function c_sync_folder_of(path) result(stat) bind(c, name='tandem_disk_sync_folder_of')
            import :: c_char, c_int
            implicit none (type, external)
            character(kind=c_char), intent(in) :: path(*)
            integer(c_int) :: stat
        end function c_sync_folder_of

        !> Synchronise a file given by its descriptor; 0 on success.
        function sync_open(file) result(stat) bind(c, name='tandem_disk_sync_open')
            import :: c_int
            implicit none (type, external)
            integer(c_int), value :: file
            integer(c_int) :: stat
        end function sync_open
    end interface

contains

    !> Synchronise the contents of a file.
    subroutine sync_file(path, error)
        character(len=*), intent(in) :: path
        type(error_type), allocatable, intent(out) :: error

        if (c_sync(path//c_null_char) /= 0) call set_disk_error(path, error)
    end subroutine sync_file

    !> Synchronise the folder of a file, that is, the names in it.
    subroutine sync_folder_of(path, error)
        character(len=*), intent(in) :: path
        type(error_type), allocatable, intent(out) :: error

        if (c_sync_folder_of(path//c_null_char) /= 0) call set_disk_error(path, error)
    end subroutine sync_folder_of

    !> Set an error about the disk.
    subroutine set_disk_error(path, error)
        character(len=*), intent(in) :: path
        type(error_type), allocatable, intent(out) :: error

        call set_error(error, status_output_failed, 'cannot write '//path//' to disk', &
            'check whether the disk is full or defective, then start again: no case is lost')
    end subroutine set_disk_error
end module tandem_io_sweep_disk
