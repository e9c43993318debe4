! SPDX-License-Identifier: MIT
!> A planar pendulum, a point mass on a rod: n = 2, nh = 1, nd = 0. The unit of length can be chosen.
module model_pendulum
    use tandem, only: model_type, procedure_model_type, wp
    implicit none (type, external)
    private

    public :: pendulum_type

    type, extends(procedure_model_type) :: pendulum_type
        !> Mass, length of the rod in metres, gravity in metres per second squared.
        real(wp) :: m = 2.0_wp, length = 0.8_wp, g = 9.81_wp
        !> Units of length per metre.
        real(wp) :: units = 1.0_wp
        !> Number of copies of the constraint: 2 makes the rows dependent.
        integer :: copies = 1
        !> Factor of the second copy.
        real(wp) :: copy_factor = 1.0_wp
    contains
        procedure :: define
        procedure :: start
    end type pendulum_type

contains

    !> Associate the procedures.
    subroutine define(self)
        class(pendulum_type), intent(inout) :: self

        self%name = 'pendulum'
        self%n = 2
        self%n_holonomic = self%copies
        self%constant_mass = .true.
        self%holonomic_name = [character(len=32) :: 'rod', 'rod again']
        self%holonomic_name = self%holonomic_name(:self%copies)
        self%holonomic => position
        self%holonomic_jacobian => jacobian
        self%constraint_acceleration => acceleration
        self%mass_matrix => mass
        self%applied_force => force
        self%potential_energy => potential
    end subroutine define

    !> A start at an angle from the downward vertical, with an angular velocity.
    subroutine start(self, angle, rate, q, qd)
        class(pendulum_type), intent(in) :: self
        real(wp), intent(in) :: angle, rate
        real(wp), intent(out) :: q(2), qd(2)

        q = self%length*self%units*[sin(angle), -cos(angle)]
        qd = self%length*self%units*rate*[cos(angle), sin(angle)]
    end subroutine start

    !> (x**2 + y**2 - length**2)/2 = 0.
    subroutine position(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (pendulum_type)
            value(1) = (q(1)**2 + q(2)**2 - (self%length*self%units)**2)/2
            value(2:) = self%copy_factor*value(1)
        end select
    end subroutine position

    subroutine jacobian(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat
        integer :: i

        stat = 0
        value(1, :) = q
        select type (self)
        class is (pendulum_type)
            do i = 2, size(value, 1)
                value(i, :) = self%copy_factor*q
            end do
        end select
    end subroutine jacobian

    subroutine acceleration(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value(1) = dot_product(qd, qd)
        select type (self)
        class is (pendulum_type)
            value(2:) = self%copy_factor*value(1)
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
        class is (pendulum_type)
            value(1, 1) = self%m
            value(2, 2) = self%m
        end select
    end subroutine mass

    subroutine force(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (pendulum_type)
            value(2) = -self%m*self%g*self%units
        end select
    end subroutine force

    subroutine potential(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (pendulum_type)
            value = self%m*self%g*self%units*q(2)
        end select
    end subroutine potential
end module model_pendulum
