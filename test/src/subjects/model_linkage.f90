! SPDX-License-Identifier: MIT
!> A chain of three links from the origin to a point on the x axis, q = their angles from that axis: n = 3, nh = 2, nd = 0. It
!> cannot be closed if the point is too far away; at exactly the reach of the links, Phi_q loses rank.
module model_linkage
    use tandem, only: model_type, procedure_model_type, wp
    implicit none (type, external)
    private

    public :: linkage_type

    type, extends(procedure_model_type) :: linkage_type
        !> Lengths of the links, distance of the point.
        real(wp) :: links(3) = [1.0_wp, 1.5_wp, 0.8_wp], distance = 2.0_wp
        !> Number of calls of Phi and Phi_q.
        integer :: calls = 0
    contains
        procedure :: define
    end type linkage_type

contains

    !> Associate the procedures.
    subroutine define(self)
        class(linkage_type), intent(inout) :: self

        self%name = 'linkage'
        self%n = 3
        self%n_holonomic = 2
        self%constant_mass = .true.
        self%coordinate_name = [character(len=32) :: 'crank', 'coupler', 'rocker']
        self%holonomic_name = [character(len=32) :: 'closure x', 'closure y']
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
        class is (linkage_type)
            self%calls = self%calls + 1
            value = [sum(self%links*cos(q)) - self%distance, sum(self%links*sin(q))]
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
        class is (linkage_type)
            self%calls = self%calls + 1
            value(1, :) = -self%links*sin(q)
            value(2, :) = self%links*cos(q)
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
        class is (linkage_type)
            value = [-sum(self%links*cos(q)*qd**2), -sum(self%links*sin(q)*qd**2)]
        end select
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
end module model_linkage
