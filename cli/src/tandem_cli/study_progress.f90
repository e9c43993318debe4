! SPDX-License-Identifier: MIT
!> Progress of a study on stderr: a permanent line per row and, on a terminal, a temporary line for the current run.
module tandem_cli_study_progress
    use, intrinsic :: iso_fortran_env, only: error_unit
    use tandem_cli_terminal, only: stderr_is_terminal
    implicit none (type, external)
    private

    public :: study_progress_type

    !> Width of the line on a terminal.
    integer, parameter :: width = 100

    type :: study_progress_type
        !> True to suppress all output.
        logical :: quiet = .false.
    contains
        procedure :: remark, show, clear
    end type study_progress_type

contains

    !> Write a permanent line.
    subroutine remark(self, text)
        class(study_progress_type), intent(in) :: self
        character(len=*), intent(in) :: text

        if (self%quiet) return
        call self%clear()
        write (error_unit, '(a)') text
        flush (error_unit)
    end subroutine remark

    !> Write a temporary line, on a terminal only.
    subroutine show(self, text)
        class(study_progress_type), intent(in) :: self
        character(len=*), intent(in) :: text

        if (self%quiet .or. .not. stderr_is_terminal()) return
        write (error_unit, '(a)', advance='no') achar(13)//text(:min(len(text), width))// &
            repeat(' ', max(0, width - len(text)))
        flush (error_unit)
    end subroutine show

    !> Remove the temporary line.
    subroutine clear(self)
        class(study_progress_type), intent(in) :: self

        if (self%quiet .or. .not. stderr_is_terminal()) return
        write (error_unit, '(a)', advance='no') achar(13)//repeat(' ', width)//achar(13)
        flush (error_unit)
    end subroutine clear
end module tandem_cli_study_progress
