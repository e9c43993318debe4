! SPDX-License-Identifier: MIT
!> The skate on a tilted plane of Rabier and Rheinboldt (2000): n = 2, nh = 0, nd = 1, E depends on time, with a closed solution:
!> u1'' - sin a - w sin t = 0, u2'' + w cos t = 0, -u1' sin t + u2' cos t = 0.
module model_tilted_skate
    use tandem, only: model_type, need_force, need_gamma, need_jacobian, need_mass, terms_type, wp
    implicit none (type, external)
    private

    public :: tilted_skate_type

    type, extends(model_type) :: tilted_skate_type
        !> Inclination of the plane.
        real(wp) :: inclination = 0.8_wp
    contains
        procedure :: define
        procedure :: solution
    end type tilted_skate_type

contains

    !> Associate the procedures.
    subroutine define(self)
        class(tilted_skate_type), intent(inout) :: self

        self%name = 'tilted skate'
        self%n = 2
        self%n_nonholonomic = 1
        self%constant_mass = .true.
        self%evaluate => evaluate
        self%provides = need_jacobian + need_gamma + need_mass + need_force
    end subroutine define

    !> u(t) from rest at 0.
    pure function solution(self, t) result(q)
        class(tilted_skate_type), intent(in) :: self
        real(wp), intent(in) :: t
        real(wp) :: q(2)

        q = sin(self%inclination)*[sin(t)**2, t - sin(2*t)/2]/2
    end function solution

    !> The terms.
    subroutine evaluate(self, need, t, q, qd, terms, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type), intent(inout) :: terms
        integer, intent(out) :: stat

        stat = 0
        select type (self)
        class is (tilted_skate_type)
            if (iand(need, need_jacobian) /= 0) terms%jacobian(1, :) = [-sin(t), cos(t)]
            if (iand(need, need_gamma) /= 0) terms%gamma(1) = -cos(t)*qd(1) - sin(t)*qd(2)
            if (iand(need, need_mass) /= 0) terms%mass = reshape([1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp], [2, 2])
            if (iand(need, need_force) /= 0) terms%force = [sin(self%inclination), 0.0_wp]
        end select
    end subroutine evaluate
end module model_tilted_skate
