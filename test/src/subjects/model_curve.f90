! SPDX-License-Identifier: MIT
!> A point of the plane on an ellipse, (x/a)^2 + (y/b)^2 = 1: n = 2, nh = 1, nd = 0. Its two masses may differ or be zero, and
!> Phi may be undefined where x is small.
module model_curve
    use tandem, only: model_type, procedure_model_type, wp
    use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
    implicit none (type, external)
    private

    public :: curve_type, undefined_stat, undefined_nan

    !> Behaviour of Phi below `least_x`: a positive status, a NaN; 0 for neither.
    integer, parameter :: undefined_stat = 1, undefined_nan = 2

    type, extends(procedure_model_type) :: curve_type
        !> Semi-axes a, b, and the masses of x and y.
        real(wp) :: axes(2) = [2.0_wp, 1.0_wp], masses(2) = 1.0_wp
        !> Below this x, Phi behaves according to `undefined`.
        real(wp) :: least_x = -huge(1.0_wp)
        integer :: undefined = 0
    contains
        procedure :: define
    end type curve_type

contains

    !> Associate the procedures.
    subroutine define(self)
        class(curve_type), intent(inout) :: self

        self%name = 'curve'
        self%n = 2
        self%n_holonomic = 1
        self%coordinate_name = [character(len=32) :: 'x', 'y']
        self%holonomic_name = [character(len=32) :: 'ellipse']
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
        class is (curve_type)
            value = (sum((q/self%axes)**2) - 1)/2
            if (q(1) < self%least_x .and. self%undefined == undefined_stat) stat = 1
            if (q(1) < self%least_x .and. self%undefined == undefined_nan) value = ieee_value(1.0_wp, ieee_quiet_nan)
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
        class is (curve_type)
            value(1, :) = q/self%axes**2
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
        class is (curve_type)
            value = sum((qd/self%axes)**2)
        end select
    end subroutine acceleration

    subroutine mass(self, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (curve_type)
            value(1, 1) = self%masses(1)
            value(2, 2) = self%masses(2)
        end select
    end subroutine mass
end module model_curve
