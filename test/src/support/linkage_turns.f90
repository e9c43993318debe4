! SPDX-License-Identifier: MIT
!> Motions of linkages with one degree of freedom that pass singular configurations, from their reduced equations.
module linkage_turns
    use model_centric_slider, only: centric_slider_type
    use tandem, only: wp
    implicit none (type, external)
    private

    public :: turn, gravity, ratio, parallel, antiparallel, slider, row

    real(wp), parameter :: gravity = 9.81_wp
    !> Antiparallel cranks of 1 with pivots 2 apart: tan(psi/2) = ratio tan(theta/2).
    real(wp), parameter :: ratio = -3.0_wp
    !> Accelerations of the single degree of freedom.
    integer, parameter :: parallel = 1, antiparallel = 2, slider = 3, row = 4

contains

    !> The angle and its rate at a time from those at the start, by 20000 steps of RK4 per unit of time; error below 1e-12.
    subroutine turn(kind, t, angle, rate, c)
        integer, intent(in) :: kind
        real(wp), intent(in) :: t
        real(wp), intent(inout) :: angle, rate
        !> Factor of the acceleration of `row`.
        real(wp), intent(in), optional :: c
        real(wp), parameter :: per_time = 2.0e4_wp
        real(wp) :: y(2), k(2, 4), h
        integer :: i, n

        n = max(1, ceiling(t*per_time))
        h = t/n
        y = [angle, rate]
        do i = 1, n
            k(:, 1) = slope(y)
            k(:, 2) = slope(y + h/2*k(:, 1))
            k(:, 3) = slope(y + h/2*k(:, 2))
            k(:, 4) = slope(y + h*k(:, 3))
            y = y + h/6*(k(:, 1) + 2*k(:, 2) + 2*k(:, 3) + k(:, 4))
        end do
        angle = y(1)
        rate = y(2)

    contains

        pure function slope(y) result(yd)
            real(wp), intent(in) :: y(2)
            real(wp) :: yd(2), s, d, dd, psi
            type(centric_slider_type) :: model

            yd(1) = y(2)
            select case (kind)
            case (parallel)
                yd(2) = -gravity*cos(y(1))
            case (slider)
                yd(2) = model%angular_acceleration(y(1), y(2))
            case (row)
                yd(2) = c*sin(y(1))
            case default
                ! (1 + psi'^2) a'' + psi' psi'' a'^2 = -g (cos a + psi' cos psi), primes of psi by a.
                s = cos(y(1)/2)**2 + ratio**2*sin(y(1)/2)**2
                d = ratio/s
                dd = -ratio*(ratio**2 - 1)*sin(y(1)/2)*cos(y(1)/2)/s**2
                psi = 2*atan2(ratio*sin(y(1)/2), cos(y(1)/2))
                yd(2) = -(d*dd*y(2)**2 + gravity*(cos(y(1)) + d*cos(psi)))/(1 + d**2)
            end select
        end function slope
    end subroutine turn
end module linkage_turns
