! SPDX-License-Identifier: MIT
!> Synchronises files with the disk, so that they survive a loss of power. The work is done in disk.c.
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

        !> Sync a file given by its descriptor; 0 on success.
        function sync_open(file) result(stat) bind(c, name='tandem_disk_sync_open')
            import :: c_int
            implicit none (type, external)
            integer(c_int), value :: file
            integer(c_int) :: stat
        end function sync_open
    end interface

contains

    !> Sync what is in a file.
    subroutine sync_file(path, error)
        character(len=*), intent(in) :: path
        type(error_type), allocatable, intent(out) :: error

        if (c_sync(path//c_null_char) /= 0) call say_problem(path, error)
    end subroutine sync_file

    !> Sync the names in the folder of a file.
    subroutine sync_folder_of(path, error)
        character(len=*), intent(in) :: path
        type(error_type), allocatable, intent(out) :: error

        if (c_sync_folder_of(path//c_null_char) /= 0) call say_problem(path, error)
    end subroutine sync_folder_of

    !> An error of the disk.
    subroutine say_problem(path, error)
        character(len=*), intent(in) :: path
        type(error_type), allocatable, intent(out) :: error

        call set_error(error, status_output_failed, 'cannot write '//path//' to disk', &
            'check whether the disk is full or defective, then start again: no case is lost')
    end subroutine say_problem
end module tandem_io_sweep_disk
