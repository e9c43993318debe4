! SPDX-License-Identifier: MIT
!> A particle on the unit circle of the plane z = 0 by three rows, the choice of which changes along any motion: with u = (x^2 + y^2
!> - 1)/2 they are u, y u + x z and -x u + y z. The rank of C is two everywhere; the first two rows are dependent at x = 0, the last
!> two nowhere, the first and the last at y = 0. n = 3, nh = 3, nd = 0.
module model_turning_rows
    use tandem, only: model_type, procedure_model_type, wp
    implicit none (type, external)
    private

    public :: turning_rows_type

    type, extends(procedure_model_type) :: turning_rows_type
    contains
        procedure :: define
    end type turning_rows_type

contains

    !> Associate the procedures.
    subroutine define(self, with_gamma)
        class(turning_rows_type), intent(inout) :: self
        !> True if the model provides gamma; otherwise differences replace it.
        logical, intent(in) :: with_gamma

        self%name = 'turning rows'
        self%n = 3
        self%n_holonomic = 3
        self%constant_mass = .true.
        self%holonomic_name = [character(len=32) :: 'circle', 'first mixture', 'second mixture']
        self%holonomic => position
        self%holonomic_jacobian => jacobian
        self%mass_matrix => mass
        if (with_gamma) self%constraint_acceleration => acceleration
    end subroutine define

    subroutine position(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat
        real(wp) :: u

        stat = 0
        u = (q(1)**2 + q(2)**2 - 1.0_wp)/2
        value = [u, q(2)*u + q(1)*q(3), -q(1)*u + q(2)*q(3)]
    end subroutine position

    subroutine jacobian(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat
        real(wp) :: u

        stat = 0
        u = (q(1)**2 + q(2)**2 - 1.0_wp)/2
        value(1, :) = [q(1), q(2), 0.0_wp]
        value(2, :) = [q(2)*q(1) + q(3), u + q(2)**2, q(1)]
        value(3, :) = [-u - q(1)**2, -q(1)*q(2) + q(3), q(2)]
    end subroutine jacobian

    subroutine acceleration(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat
        real(wp) :: ud, udd

        stat = 0
        ud = q(1)*qd(1) + q(2)*qd(2)
        udd = qd(1)**2 + qd(2)**2
        value = [udd, 2*qd(2)*ud + q(2)*udd + 2*qd(1)*qd(3), -2*qd(1)*ud - q(1)*udd + 2*qd(2)*qd(3)]
    end subroutine acceleration

    subroutine mass(self, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat
        integer :: i

        stat = 0
        value = 0.0_wp
        do i = 1, 3
            value(i, i) = 1.0_wp
        end do
    end subroutine mass
end module model_turning_rows
