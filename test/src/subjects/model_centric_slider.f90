! SPDX-License-Identifier: MIT
!> A slider-crank whose crank and rod have the same length, 1: q = (x, y, s), the end of the crank and the slider on the x axis,
!> both of mass 1, under gravity along -y; n = 3, nh = 2, nd = 0. While the crank rotates, s = 2 x. Where the crank is upright, the
!> slider is at the pivot and Phi_q loses rank: the rod could also rotate with the crank while the slider rests.
module model_centric_slider
    use tandem, only: model_type, procedure_model_type, wp
    implicit none (type, external)
    private

    public :: centric_slider_type

    type, extends(procedure_model_type) :: centric_slider_type
    contains
        procedure :: define
        procedure, nopass :: start, angular_acceleration
    end type centric_slider_type

    real(wp), parameter :: gravity = 9.81_wp

contains

    !> Associate the procedures.
    subroutine define(self)
        class(centric_slider_type), intent(inout) :: self

        self%name = 'centric slider'
        self%n = 3
        self%n_holonomic = 2
        self%holonomic_name = [character(len=32) :: 'crank', 'rod']
        self%holonomic => position
        self%holonomic_jacobian => jacobian
        self%constraint_acceleration => acceleration
        self%mass_matrix => mass
        self%applied_force => force
    end subroutine define

    !> The state at an angle of the crank from the x axis, with an angular velocity.
    pure subroutine start(angle, rate, q, qd)
        real(wp), intent(in) :: angle, rate
        real(wp), intent(out) :: q(3), qd(3)

        q = [cos(angle), sin(angle), 2*cos(angle)]
        qd = rate*[-sin(angle), cos(angle), -2*sin(angle)]
    end subroutine start

    !> The angular acceleration of the crank: (1 + 4 sin^2 a) a'' + 4 sin a cos a a'^2 = -g cos a.
    pure real(wp) function angular_acceleration(angle, rate)
        real(wp), intent(in) :: angle, rate

        angular_acceleration = -(gravity*cos(angle) + 4*sin(angle)*cos(angle)*rate**2)/(1 + 4*sin(angle)**2)
    end function angular_acceleration

    subroutine position(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value = 0.5_wp*[q(1)**2 + q(2)**2 - 1, (q(3) - q(1))**2 + q(2)**2 - 1]
    end subroutine position

    subroutine jacobian(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        stat = 0
        value(1, :) = [q(1), q(2), 0.0_wp]
        value(2, :) = [q(1) - q(3), q(2), q(3) - q(1)]
    end subroutine jacobian

    subroutine acceleration(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value = [qd(1)**2 + qd(2)**2, (qd(3) - qd(1))**2 + qd(2)**2]
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

    subroutine force(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value = [0.0_wp, -gravity, 0.0_wp]
    end subroutine force
end module model_centric_slider
