! SPDX-License-Identifier: MIT
!> chain [FOLDER]: checks the chain of rods, measures the time of a step against their number, and writes a table to a folder.
program chain
    use, intrinsic :: iso_fortran_env, only: error_unit, output_unit
    use tandem, only: error_type
    use tandem_bench_chain_study, only: study_chain
    implicit none (type, external)
    type(error_type), allocatable :: error
    character(len=256) :: folder
    character(len=:), allocatable :: text

    folder = 'build/bench'
    if (command_argument_count() >= 1) call get_command_argument(1, folder)
    call study_chain(trim(folder), text, error)
    if (allocated(error)) then
        write (error_unit, '(2a)') 'chain: ', error%message
        error stop 1
    end if
    write (output_unit, '(a)') text
end program chain
