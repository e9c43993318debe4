! SPDX-License-Identifier: MIT
!> Tests for a terminal.
module tandem_cli_terminal
    use, intrinsic :: iso_c_binding, only: c_int
    implicit none (type, external)
    private

    public :: stderr_is_terminal

    interface
        !> 1 if a file descriptor is a terminal, otherwise 0.
        function is_terminal(descriptor) result(answer) bind(c, name='isatty')
            import :: c_int
            implicit none (type, external)
            integer(c_int), value :: descriptor
            integer(c_int) :: answer
        end function is_terminal
    end interface

contains

    !> True if stderr is a terminal.
    logical function stderr_is_terminal()
        stderr_is_terminal = is_terminal(2_c_int) == 1_c_int
    end function stderr_is_terminal
end module tandem_cli_terminal
