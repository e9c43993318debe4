! SPDX-License-Identifier: MIT
!> The version of this package, as in fpm.toml, and of the result file.
module tandem_io_version
    use, intrinsic :: iso_fortran_env, only: compiler_options, compiler_version
    implicit none (type, external)
    private

    public :: tandem_version, format_version, build_text

    !> Version of tandem.
    character(len=*), parameter :: tandem_version = '0.1.0'
    !> Version of the result file's layout: raised when a reader of older files would go wrong.
    integer, parameter :: format_version = 1

contains

    !> Description of this build for `tandem version`: optimised (-O3 or link-time optimisation), fast or debug, with the flags that
    !> decide about speed, and the compiler.
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
