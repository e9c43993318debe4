! SPDX-License-Identifier: MIT
!> Numbers without a pattern, identical on every machine.
module scattered_numbers
    use tandem, only: wp
    implicit none (type, external)
    private

    public :: scattered

contains

    !> n numbers between -1 and 1.
    pure function scattered(n, seed) result(x)
        integer, intent(in) :: n, seed
        real(wp) :: x(n)
        integer :: i

        do i = 1, n
            x(i) = 12345.678_wp*sin(1.0_wp + seed + 78.233_wp*i)
            x(i) = 2*(x(i) - floor(x(i))) - 1
        end do
    end function scattered
end module scattered_numbers
