! SPDX-License-Identifier: MIT
!> The heavy symmetric top with a fixed point, in Euler parameters: n = 7, nh = 4, nd = 0; q = (r, p) of the centre of mass.
module model_heavy_top
    use tandem, only: model_type, procedure_model_type, wp
    use tandem_rigid_euler_parameters, only: b_matrix, g_matrix, rotation
    implicit none (type, external)
    private

    public :: heavy_top_type

    type, extends(procedure_model_type) :: heavy_top_type
        !> Mass, distance of the centre of mass from the fixed point, gravity.
        real(wp) :: m = 1.0_wp, l = 0.25_wp, g = 9.81_wp
        !> Principal moments of inertia about the centre of mass.
        real(wp) :: inertia(3) = [0.01_wp, 0.01_wp, 0.005_wp]
    contains
        procedure :: define
    end type heavy_top_type

contains

    !> Associate the procedures.
    subroutine define(self)
        class(heavy_top_type), intent(inout) :: self

        self%name = 'heavy top'
        self%n = 7
        self%n_holonomic = 4
        self%holonomic_name = [character(len=32) :: 'fixed point x', 'fixed point y', 'fixed point z', 'p normed']
        self%holonomic => position
        self%holonomic_jacobian => jacobian
        self%constraint_acceleration => acceleration
        self%mass_matrix => mass
        self%inertia_force => inertia_force
        self%applied_force => weight
        self%potential_energy => potential
    end subroutine define

    !> r - A(p) (0, 0, l) = 0, (p'p - 1)/2 = 0.
    subroutine position(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value(:3) = q(:3) - matmul(rotation(q(4:)), arm(self))
        value(4) = (dot_product(q(4:), q(4:)) - 1)/2
    end subroutine position

    subroutine jacobian(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat
        integer :: i

        stat = 0
        value = 0.0_wp
        do i = 1, 3
            value(i, i) = 1.0_wp
        end do
        value(:3, 4:) = -b_matrix(q(4:), arm(self))
        value(4, 4:) = q(4:)
    end subroutine jacobian

    subroutine acceleration(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value(:3) = -matmul(b_matrix(qd(4:), arm(self)), qd(4:))
        value(4) = dot_product(qd(4:), qd(4:))
    end subroutine acceleration

    subroutine mass(self, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat
        real(wp) :: g(3, 4)
        integer :: i

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (heavy_top_type)
            g = g_matrix(q(4:))
            do i = 1, 3
                value(i, i) = self%m
            end do
            value(4:, 4:) = 4*matmul(transpose(g), spread(self%inertia, 2, 4)*g)
        end select
    end subroutine mass

    !> 8 G(pd)' J G(pd) p.
    subroutine inertia_force(self, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat
        real(wp) :: g(3, 4)

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (heavy_top_type)
            g = g_matrix(qd(4:))
            value(4:) = 8*matmul(self%inertia*matmul(g, q(4:)), g)
        end select
    end subroutine inertia_force

    subroutine weight(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (heavy_top_type)
            value(3) = -self%m*self%g
        end select
    end subroutine weight

    subroutine potential(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (heavy_top_type)
            value = self%m*self%g*q(3)
        end select
    end subroutine potential

    !> The centre of mass in the body's frame.
    pure function arm(self)
        class(model_type), intent(in) :: self
        real(wp) :: arm(3)

        arm = 0.0_wp
        select type (self)
        class is (heavy_top_type)
            arm(3) = self%l
        end select
    end function arm
end module model_heavy_top
