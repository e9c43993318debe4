! SPDX-License-Identifier: MIT
!> Two cranks of length 1 on pivots that are 2 apart, their ends joined by a massless rod of length 2, under gravity: q = (x1, y1,
!> x2, y2), the ends, n = 4, nh = 3, nd = 0. As a parallelogram both cranks rotate alike; in their flat position Phi_q loses rank,
!> because the antiparallelogram motion branches off there.
module model_crank_pair
    use tandem, only: model_type, procedure_model_type, wp
    implicit none (type, external)
    private

    public :: crank_pair_type

    type, extends(procedure_model_type) :: crank_pair_type
    contains
        procedure :: define
        procedure, nopass :: start
    end type crank_pair_type

    real(wp), parameter :: pivot(2) = [2.0_wp, 0.0_wp]

contains

    !> Associate the procedures.
    subroutine define(self)
        class(crank_pair_type), intent(inout) :: self

        self%name = 'crank pair'
        self%n = 4
        self%n_holonomic = 3
        self%holonomic_name = [character(len=32) :: 'left crank', 'right crank', 'rod']
        self%holonomic => position
        self%holonomic_jacobian => jacobian
        self%constraint_acceleration => acceleration
        self%mass_matrix => mass
        self%applied_force => force
    end subroutine define

    !> Parallel cranks at an angle from the line of the pivots, with an angular velocity.
    pure subroutine start(angle, rate, q, qd)
        real(wp), intent(in) :: angle, rate
        real(wp), intent(out) :: q(4), qd(4)

        q = [cos(angle), sin(angle), pivot + [cos(angle), sin(angle)]]
        qd = rate*[-sin(angle), cos(angle), -sin(angle), cos(angle)]
    end subroutine start

    subroutine position(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value = 0.5_wp*[sum(q(1:2)**2) - 1, sum((q(3:4) - pivot)**2) - 1, sum((q(3:4) - q(1:2))**2) - 4]
    end subroutine position

    subroutine jacobian(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        value(1, 1:2) = q(1:2)
        value(2, 3:4) = q(3:4) - pivot
        value(3, 1:2) = q(1:2) - q(3:4)
        value(3, 3:4) = q(3:4) - q(1:2)
    end subroutine jacobian

    subroutine acceleration(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value = [sum(qd(1:2)**2), sum(qd(3:4)**2), sum((qd(3:4) - qd(1:2))**2)]
    end subroutine acceleration

    subroutine mass(self, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat
        integer :: i

        stat = 0
        value = 0.0_wp
        do i = 1, 4
            value(i, i) = 1.0_wp
        end do
    end subroutine mass

    subroutine force(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value = [0.0_wp, -9.81_wp, 0.0_wp, -9.81_wp]
    end subroutine force
end module model_crank_pair
