! SPDX-License-Identifier: MIT
!> tandem-mpi on the command line, with the shipped models.
program tandem_mpi_program
    use tandem_mpi_command_line, only: mpi_command_line
    implicit none (type, external)
    integer :: code

    call mpi_command_line(code)
    stop code, quiet=.true.
end program tandem_mpi_program
