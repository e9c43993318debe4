! SPDX-License-Identifier: MIT
!> A particle on two surfaces that are nearly one.
module model_near
    use model_particle, only: particle_type
    use tandem, only: model_type, wp
    implicit none (type, external)
    private

    public :: near_type, start_near

    !> A particle on the unit sphere and on a second surface that is the first up to a part `part`: Phi2 = Phi1 + part (z - x y).
    type, extends(particle_type) :: near_type
        real(wp) :: part = 1.0e-9_wp
    contains
        procedure :: define_near
    end type near_type

contains

    !> Associate the near-redundant surfaces.
    subroutine define_near(self)
        class(near_type), intent(inout) :: self

        call self%define(.true.)
        self%name = 'near'
        self%n_holonomic = 2
        self%holonomic_name = [character(len=32) :: 'sphere', 'almost the sphere']
        self%holonomic => near_position
        self%holonomic_jacobian => near_jacobian
        self%constraint_acceleration => near_gamma
    end subroutine define_near

    subroutine near_position(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (near_type)
            value(1) = (q(1)**2 + q(2)**2 + q(3)**2 - 1)/2
            value(2) = value(1) + self%part*(q(3) - q(1)*q(2))
        end select
    end subroutine near_position

    subroutine near_jacobian(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        stat = 0
        value(1, :) = q
        value(2, :) = q
        select type (self)
        class is (near_type)
            value(2, :) = q + self%part*[-q(2), -q(1), 1.0_wp]
        end select
    end subroutine near_jacobian

    subroutine near_gamma(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value = dot_product(qd, qd)
        select type (self)
        class is (near_type)
            value(2) = value(2) - 2*self%part*qd(1)*qd(2)
        end select
    end subroutine near_gamma

    !> A start on the curve of both surfaces, z = x y, moving along it.
    pure subroutine start_near(q, qd)
        real(wp), intent(out) :: q(3), qd(3)
        real(wp), parameter :: x = 0.5_wp
        real(wp) :: y

        ! x**2 + y**2 + x**2 y**2 = 1.
        y = sqrt((1 - x**2)/(1 + x**2))
        q = [x, y, x*y]
        ! q'qd = 0 and zd = xd y + x yd.
        qd(1) = 1.0_wp
        qd(2) = -(x + x*y**2)/(y + x**2*y)
        qd(3) = qd(1)*y + x*qd(2)
    end subroutine start_near
end module model_near
