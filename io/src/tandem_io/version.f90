! SPDX-License-Identifier: MIT
!> Version of this package, as in fpm.toml, and of the format of result files.
module tandem_io_version
    use, intrinsic :: iso_fortran_env, only: compiler_options, compiler_version
    implicit none (type, external)
    private

    public :: tandem_version, format_version, build_text

    !> Version of tandem.
    character(len=*), parameter :: tandem_version = '0.1.0'
    !> Version of the format of result files; increased when programs for older versions would misread a file.
    integer, parameter :: format_version = 1

contains

    !> Description of this build for `tandem version`: optimised (-O3 or link-time optimisation), fast or debug, with the flags that
    !> affect speed, and the compiler.
    pure function build_text() result(text)
        character(len=120) :: text
        character(len=:), allocatable :: flags, rest, word, kind
        integer :: blank

        flags = ''
        kind = 'debug'
        rest = compiler_options()//' '
        do while (len(rest) > 0)
            blank = index(rest, ' ')
            word = rest(:blank - 1)
            rest = rest(blank + 1:)
            if (index(word, '-O') == 1 .and. word /= '-O0' .and. kind == 'debug') kind = 'fast'
            if (word == '-O0') kind = 'debug'
            if (index(word, '-flto') == 1 .or. word == '-O3') kind = 'optimised'
            if (any([index(word, '-O'), index(word, '-march='), index(word, '-flto')] == 1)) flags = flags//' '//word
        end do
        text = kind//' build,'//flags//', '//compiler_version()
    end function build_text
end module tandem_io_version
