! SPDX-License-Identifier: MIT
!> Random numbers without internal state, identical on every machine: for tests at random states and along random directions.
module tandem_linalg_random
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: random_vector

contains

    !> Numbers between -1 and 1 by a linear congruence (Lehmer; Park and Miller 1988).
    function random_vector(seed, n) result(values)
        !> Positive; updated on return.
        integer, intent(inout) :: seed
        !> Number of values.
        integer, intent(in) :: n
        real(wp) :: values(n)
        integer, parameter :: multiplier = 48271, quotient = 44488, remainder = 3399, modulus = 2147483647
        integer :: i

        do i = 1, n
            seed = multiplier*mod(seed, quotient) - remainder*(seed/quotient)
            if (seed <= 0) seed = seed + modulus
            values(i) = 2*real(seed, wp)/real(modulus, wp) - 1.0_wp
        end do
    end function random_vector
end module tandem_linalg_random
