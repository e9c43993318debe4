! SPDX-License-Identifier: MIT
!> Output of the program on stdout and stderr, and its exit codes.
module tandem_cli_messages
    use tandem, only: error_type
    use tandem_status, only: status_inconsistent_start
    use, intrinsic :: iso_c_binding, only: c_char, c_int, c_size_t
    use, intrinsic :: iso_fortran_env, only: error_unit
    implicit none (type, external)
    private

    public :: say, finish_output, print_to_stderr, message_for_scene, padded, done, run_failed, input_wrong, signalled

    !> Exit codes. After a signal, its number is added to `signalled`, as in shells.
    integer, parameter :: done = 0, run_failed = 1, input_wrong = 2, signalled = 128

    interface
        !> Write a text to stdout (stdout.c).
        subroutine c_say(text, length) bind(c, name='tandem_say')
            import :: c_char, c_size_t
            implicit none (type, external)
            character(kind=c_char), intent(in) :: text(*)
            integer(c_size_t), value :: length
        end subroutine c_say

        !> Flush the output. If a part of the output is lost, the result is the length of the reason, otherwise 0.
        function c_finish_output(text, size) result(length) bind(c, name='tandem_finish_output')
            import :: c_char, c_int
            implicit none (type, external)
            character(kind=c_char), intent(inout) :: text(*)
            integer(c_int), value :: size
            integer(c_int) :: length
        end function c_finish_output
    end interface

contains

    !> Write a line to stdout. All output must use this procedure, because writes of gfortran do not report failures.
    subroutine say(line)
        character(len=*), intent(in) :: line

        call c_say(line//new_line('a'), len(line, c_size_t) + 1)
    end subroutine say

    !> Flush stdout, and report lost output.
    subroutine finish_output(code)
        !> Exit code; `run_failed` replaces `done` if output is lost.
        integer, intent(inout) :: code
        character(kind=c_char) :: letters(80)
        character(len=size(letters)) :: reason
        integer :: i

        reason = ''
        do i = 1, int(c_finish_output(letters, size(letters, kind=c_int)))
            reason(i:i) = letters(i)
        end do
        if (reason == '') return
        call print_to_stderr('stdout could not be written completely: '//trim(reason)// &
            '; redirect it. Result files are not affected')
        if (code == done) code = run_failed
    end subroutine finish_output

    !> Write an error message to stderr.
    subroutine print_to_stderr(message)
        character(len=*), intent(in) :: message

        write (error_unit, '(a)') 'tandem: '//message
    end subroutine print_to_stderr

    !> Message of an error. For an error about the start, the keys of a scene are mentioned.
    pure function message_for_scene(error) result(text)
        type(error_type), intent(in) :: error
        character(len=:), allocatable :: text

        text = error%message
        if (error%stat /= status_inconsistent_start .or. index(text, 'assemble the start') == 0) return
        if (index(text, 'q0 and qd0') > 0) then
            text = text//new_line('a')//'In a scene, q0 and qd0 are the keys q and qd of [initial], and assemble = true there '// &
                'lets the start be assembled.'
        else
            text = text//new_line('a')//'In a scene, [initial] assemble = true lets the start be assembled.'
        end if
    end function message_for_scene

    !> A text padded with blanks to a width; a longer one is unchanged.
    pure function padded(text, width) result(wide)
        character(len=*), intent(in) :: text
        integer, intent(in) :: width
        character(len=max(len(text), width)) :: wide

        wide = text
    end function padded
end module tandem_cli_messages
