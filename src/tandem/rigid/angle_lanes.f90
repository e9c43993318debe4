! SPDX-License-Identifier: MIT
!> Cosines and sines of several angles at once, accurate to one or two units in the last place. The nearest multiple of pi/2 is
!> subtracted, and the Taylor series are summed for the remainder, which is at most pi/4.
module tandem_rigid_angle_lanes
    use tandem_kinds, only: lane, wp
    implicit none (type, external)
    private

    public :: set_cosines_and_sines

    !> pi/2 in three parts. The first two parts have 33 bits each, so that their products with integers up to a million are exact.
    real(wp), parameter :: quarter(3) = [6746518852.0_wp*2.0_wp**(-32), 4484108710.0_wp*2.0_wp**(-66), &
        2.0222662487959506e-21_wp]
    !> Larger angles are passed to the intrinsic functions.
    real(wp), parameter :: largest = 1.0e5_wp

contains

    !> cos x and sin x.
    pure subroutine set_cosines_and_sines(x, c, s)
        real(wp), intent(in) :: x(lane)
        real(wp), intent(out) :: c(lane), s(lane)
        real(wp) :: cosine, d, multiple, r, sine, most
        integer :: k, l
        !> Reciprocals of the factorials.
        integer, parameter :: n_terms = 17
        real(wp), parameter :: over(n_terms) = [(1.0_wp/gamma(k + 1.0_wp), k=1, n_terms)]

        most = 0.0_wp
        do l = 1, lane
            if (.not. abs(x(l)) <= largest) most = huge(most)
        end do
        if (most > 0.0_wp) then
            c = cos(x)
            s = sin(x)
            return
        end if
        !GCC$ UNROLL 1
        do l = 1, lane
            k = int(x(l)*(1.0_wp/(quarter(1) + quarter(2))) + sign(0.5_wp, x(l)))
            multiple = real(k, wp)
            r = ((x(l) - multiple*quarter(1)) - multiple*quarter(2)) - multiple*quarter(3)
            d = r*r
            sine = r - r*d*(over(3) - d*(over(5) - d*(over(7) - d*(over(9) - d*(over(11) - d*(over(13) - d*(over(15) - &
                d*over(17))))))))
            cosine = 1.0_wp - d*(over(2) - d*(over(4) - d*(over(6) - d*(over(8) - d*(over(10) - d*(over(12) - d*(over(14) - &
                d*over(16))))))))
            ! A rotation by pi/2 exchanges cosine and sine, with a change of sign.
            c(l) = merge(sine, cosine, iand(k, 1) == 1)
            s(l) = merge(cosine, sine, iand(k, 1) == 1)
            c(l) = merge(-c(l), c(l), iand(k + 1, 2) == 2)
            s(l) = merge(-s(l), s(l), iand(k, 2) == 2)
        end do
    end subroutine set_cosines_and_sines
end module tandem_rigid_angle_lanes
