! SPDX-License-Identifier: MIT
!> tandem plot and tandem view: pass the command line to the Python package, which plots and shows result files.
module tandem_cli_pictures
    use tandem_cli_messages, only: print_to_stderr, input_wrong
    use, intrinsic :: iso_c_binding, only: c_char, c_int, c_null_char
    implicit none (type, external)
    private

    public :: call_package

    character(len=*), parameter :: line_end = new_line('a')
    !> Command that installs the package.
    character(len=*), parameter :: advice = 'install it by "pip install" with the wheel, or by "make python" in a checkout; '// &
        'set TANDEM_PYTHON to a python3 that has it'
    !> Python code that runs the package. It removes the current folder from the search path, so that files in it cannot replace
    !> packages.
    character(len=*), parameter :: code = 'import sys'//line_end// &
        'sys.path[:] = [path for path in sys.path if path]'//line_end// &
        'try:'//line_end// &
        '    import tandem_command'//line_end// &
        '    tandem_command.draw()'//line_end// &
        'except ModuleNotFoundError as error:'//line_end// &
        '    print("tandem: " + sys.argv[1] + " needs the package tandem for Python, which " + sys.executable '// &
        '+ " has not (" + str(error) + ");", '''// &
        advice//''', sep="\n", file=sys.stderr)'//line_end// &
        '    sys.exit(2)'//line_end

    interface
        !> Replace the process by Python (python.c). Returns only after a failure; the result is the length of the reason.
        function call_python(code, words, count, text, size) result(length) bind(c, name='tandem_call_python')
            import :: c_char, c_int
            implicit none (type, external)
            character(kind=c_char), intent(in) :: code(*), words(*)
            integer(c_int), value :: count
            character(kind=c_char), intent(inout) :: text(*)
            integer(c_int), value :: size
            integer(c_int) :: length
        end function call_python
    end interface

contains

    !> Pass the arguments of the command line to the package. Returns only after a failure.
    subroutine call_package(code_out)
        !> Exit code.
        integer, intent(out) :: code_out
        character(len=:), allocatable :: words, word
        character(kind=c_char) :: letters(300)
        character(len=size(letters)) :: reason
        integer :: i, length

        words = ''
        do i = 1, command_argument_count()
            call get_command_argument(i, length=length)
            allocate (character(len=length) :: word)
            if (length > 0) call get_command_argument(i, word)
            words = words//word//c_null_char
            deallocate (word)
        end do
        reason = ''
        length = int(call_python(code//c_null_char, words, int(command_argument_count(), c_int), letters, &
            size(letters, kind=c_int)))
        do i = 1, length
            reason(i:i) = letters(i)
        end do
        call print_to_stderr('Python cannot be started ('//trim(reason)//')'//line_end//advice)
        code_out = input_wrong
    end subroutine call_package
end module tandem_cli_pictures
