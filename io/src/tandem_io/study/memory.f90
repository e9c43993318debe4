! SPDX-License-Identifier: MIT
!> Memory used by the program.
module tandem_io_study_memory
    use tandem, only: long
    implicit none (type, external)
    private

    public :: resident_pages

contains

    !> Number of resident pages of the program, from /proc/self/statm; -1 if unknown.
    integer(long) function resident_pages()
        integer(long) :: total
        integer :: unit, stat

        resident_pages = -1
        open (newunit=unit, file='/proc/self/statm', status='old', action='read', iostat=stat)
        if (stat /= 0) return
        read (unit, *, iostat=stat) total, resident_pages
        close (unit)
        if (stat /= 0) resident_pages = -1
    end function resident_pages
end module tandem_io_study_memory
