! SPDX-License-Identifier: MIT
!> How the program speaks on stderr, and its exit codes.
module tandem_app_messages
    use, intrinsic :: iso_fortran_env, only: error_unit
    implicit none (type, external)
    private

    public :: complain, done, run_failed, input_wrong, signalled

    !> Exit codes; where a signal has ended the run, its number is added to `signalled`, as shells do.
    integer, parameter :: done = 0, run_failed = 1, input_wrong = 2, signalled = 128

contains

    !> Say on stderr what is wrong.
    subroutine complain(message)
        character(len=*), intent(in) :: message

        write (error_unit, '(a)') 'tandem: '//message
    end subroutine complain
end module tandem_app_messages
