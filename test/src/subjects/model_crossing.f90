! SPDX-License-Identifier: MIT
!> A bead on two curves at once, (x^2 + y^2 - 1)(y + k) = 0, the unit circle and the line y = -k: n = 2, nh = 1, nd = 0. At the
!> crossings Phi_q vanishes, and a bead on the circle could continue along either. The direction of Phi_q gives no indication
!> before.
module model_crossing
    use tandem, only: model_type, procedure_model_type, wp
    implicit none (type, external)
    private

    public :: crossing_type

    type, extends(procedure_model_type) :: crossing_type
        !> The line is y = -k.
        real(wp) :: k = 0.05_wp
    contains
        procedure :: define
    end type crossing_type

contains

    !> Associate the procedures.
    subroutine define(self)
        class(crossing_type), intent(inout) :: self

        self%name = 'crossing'
        self%n = 2
        self%n_holonomic = 1
        self%holonomic => position
        self%holonomic_jacobian => jacobian
        self%constraint_acceleration => acceleration
        self%mass_matrix => mass
    end subroutine define

    subroutine position(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (crossing_type)
            value = (q(1)**2 + q(2)**2 - 1)*(q(2) + self%k)
        end select
    end subroutine position

    subroutine jacobian(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (crossing_type)
            value(1, 1) = 2*q(1)*(q(2) + self%k)
            value(1, 2) = 2*q(2)*(q(2) + self%k) + q(1)**2 + q(2)**2 - 1
        end select
    end subroutine jacobian

    subroutine acceleration(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (crossing_type)
            value = 2*(qd(1)**2 + qd(2)**2)*(q(2) + self%k) + 4*(q(1)*qd(1) + q(2)*qd(2))*qd(2)
        end select
    end subroutine acceleration

    subroutine mass(self, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        value(1, 1) = 1.0_wp
        value(2, 2) = 1.0_wp
    end subroutine mass
end module model_crossing
