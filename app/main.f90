! SPDX-License-Identifier: MIT
!> tandem on the command line, with the shipped models.
program tandem_program
    use tandem_command_line, only: command_line
    implicit none (type, external)
    integer :: code

    call command_line(code)
    stop code, quiet=.true.
end program tandem_program
