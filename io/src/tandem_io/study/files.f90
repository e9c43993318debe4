! SPDX-License-Identifier: MIT
!> File operations that Fortran lacks: creating a folder, replacing a file by another one, reading a complete file.
module tandem_io_study_files
    use tandem, only: error_type, set_error, status_output_failed
    use tandem_io_path, only: is_regular
    use, intrinsic :: iso_c_binding, only: c_char, c_int, c_null_char
    implicit none (type, external)
    private

    public :: make_folder, read_whole, write_whole, replace_file, remove_file

    interface
        !> Create a folder; 0 on success.
        function c_mkdir(path, mode) result(stat) bind(c, name='mkdir')
            import :: c_char, c_int
            implicit none (type, external)
            character(kind=c_char), intent(in) :: path(*)
            integer(c_int), value :: mode
            integer(c_int) :: stat
        end function c_mkdir

        !> Rename a file, replacing an existing one; 0 on success.
        function c_rename(from, to) result(stat) bind(c, name='rename')
            import :: c_char, c_int
            implicit none (type, external)
            character(kind=c_char), intent(in) :: from(*), to(*)
            integer(c_int) :: stat
        end function c_rename

        !> Remove a file; 0 on success.
        function c_unlink(path) result(stat) bind(c, name='unlink')
            import :: c_char, c_int
            implicit none (type, external)
            character(kind=c_char), intent(in) :: path(*)
            integer(c_int) :: stat
        end function c_unlink
    end interface

contains

    !> Create a folder if it does not exist; its parent must exist.
    subroutine make_folder(path, error)
        character(len=*), intent(in) :: path
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: for_all = int(o'777')
        logical :: exists
        integer(c_int) :: stat

        if (path == '-') then
            call set_error(error, status_output_failed, 'a study writes several files, which do not go to standard output', &
                'choose a folder; one of this name is ./-')
            return
        end if
        inquire (file=path//'/.', exist=exists)
        if (exists) return
        stat = c_mkdir(c_text(path), int(for_all, c_int))
        if (stat /= 0) call set_error(error, status_output_failed, 'the folder '//path//' cannot be made', &
            'choose a folder whose parent exists and whose name is not that of a file')
    end subroutine make_folder

    !> Read a regular file completely; `text` is not allocated if this fails.
    subroutine read_whole(path, text)
        character(len=*), intent(in) :: path
        character(len=:), allocatable, intent(out) :: text
        integer :: unit, stat, length

        if (.not. is_regular(path)) return
        open (newunit=unit, file=path, status='old', action='read', access='stream', iostat=stat)
        if (stat /= 0) return
        inquire (unit=unit, size=length)
        allocate (character(len=max(0, length)) :: text)
        if (length > 0) read (unit, iostat=stat) text
        close (unit)
        if (stat /= 0) deallocate (text)
    end subroutine read_whole

    !> Replace the contents of a file. Readers find either the old or the new contents, never a part.
    subroutine write_whole(path, text, error)
        character(len=*), intent(in) :: path, text
        type(error_type), allocatable, intent(out) :: error
        character(len=256) :: message
        integer :: unit, stat, size

        message = ''
        open (newunit=unit, file=path//'.new', status='replace', action='write', access='stream', iostat=stat, iomsg=message)
        if (stat == 0) then
            write (unit, iostat=stat, iomsg=message) text
            close (unit)
            ! A full disk may be noticed only by the size of the file.
            inquire (file=path//'.new', size=size)
            if (stat == 0 .and. size /= len(text)) stat = 1
            if (stat /= 0) then
                if (message == '') message = 'is the disk full?'
                open (newunit=unit, file=path//'.new', status='old')
                close (unit, status='delete')
            end if
        end if
        if (stat /= 0) then
            call set_error(error, status_output_failed, 'cannot write '//path//': '//trim(message))
        else
            call replace_file(path, path//'.new', error)
        end if
    end subroutine write_whole

    !> Replace a file, or create it, by renaming another file.
    subroutine replace_file(path, by, error)
        !> Path of the replaced file, and path of the file that replaces it.
        character(len=*), intent(in) :: path, by
        type(error_type), allocatable, intent(out) :: error

        if (c_rename(c_text(by), c_text(path)) /= 0) then
            call set_error(error, status_output_failed, 'cannot rename '//by//' to '//path)
        end if
    end subroutine replace_file

    !> Remove a file; failures are ignored.
    subroutine remove_file(path)
        character(len=*), intent(in) :: path

        if (c_unlink(c_text(path)) /= 0) return
    end subroutine remove_file

    !> Convert a text to a C string.
    pure function c_text(text) result(letters)
        character(len=*), intent(in) :: text
        character(kind=c_char) :: letters(len(text) + 1)
        integer :: i

        do i = 1, len(text)
            letters(i) = text(i:i)
        end do
        letters(size(letters)) = c_null_char
    end function c_text
end module tandem_io_study_files
