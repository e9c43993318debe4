! SPDX-License-Identifier: MIT
!> Tests of paths that do not open the file, because opening a pipe may block. Implemented in path.c.
module tandem_io_path
    use, intrinsic :: iso_c_binding, only: c_char, c_int, c_null_char
    implicit none (type, external)
    private

    public :: is_same_file, is_regular, is_pipe, is_dangling

    interface
        function c_is_same(one, other) result(answer) bind(c, name='tandem_path_is_same')
            import :: c_char, c_int
            implicit none (type, external)
            character(kind=c_char), intent(in) :: one(*), other(*)
            integer(c_int) :: answer
        end function c_is_same

        function c_is_regular(path) result(answer) bind(c, name='tandem_path_is_regular')
            import :: c_char, c_int
            implicit none (type, external)
            character(kind=c_char), intent(in) :: path(*)
            integer(c_int) :: answer
        end function c_is_regular

        function c_is_pipe(path) result(answer) bind(c, name='tandem_path_is_pipe')
            import :: c_char, c_int
            implicit none (type, external)
            character(kind=c_char), intent(in) :: path(*)
            integer(c_int) :: answer
        end function c_is_pipe

        function c_is_dangling(path) result(answer) bind(c, name='tandem_path_is_dangling')
            import :: c_char, c_int
            implicit none (type, external)
            character(kind=c_char), intent(in) :: path(*)
            integer(c_int) :: answer
        end function c_is_dangling
    end interface

contains

    !> True if two paths refer to the same existing file, possibly through links.
    logical function is_same_file(one, other)
        character(len=*), intent(in) :: one, other

        is_same_file = c_is_same(one//c_null_char, other//c_null_char) /= 0
    end function is_same_file

    !> True if a path refers to a regular file, not to a folder, pipe, socket or device.
    logical function is_regular(path)
        character(len=*), intent(in) :: path

        is_regular = c_is_regular(path//c_null_char) /= 0
    end function is_regular

    !> True if a path refers to a pipe, named or unnamed.
    logical function is_pipe(path)
        character(len=*), intent(in) :: path

        is_pipe = c_is_pipe(path//c_null_char) /= 0
    end function is_pipe

    !> True if a path is a dangling symbolic link.
    logical function is_dangling(path)
        character(len=*), intent(in) :: path

        is_dangling = c_is_dangling(path//c_null_char) /= 0
    end function is_dangling
end module tandem_io_path
