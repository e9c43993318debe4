! SPDX-License-Identifier: MIT
!> Separate skates side by side: any number of nonholonomic rows, 3 coordinates each, (x, y, angle), with sin(angle) xd - cos(angle)
!> yd = 0. One of them may have a holonomic row instead, (2 + sin y) xd = 0: x is constant.
module model_skates
    use tandem, only: model_type, procedure_model_type, wp
    implicit none (type, external)
    private

    public :: skates_type

    type, extends(procedure_model_type) :: skates_type
        !> Number of skates; index of the one with the holonomic row, 0 for none.
        integer :: skates = 1, disguised = 0
    contains
        procedure :: define
        procedure :: start
    end type skates_type

contains

    !> Associate the procedures; `skates` must be set.
    subroutine define(self)
        class(skates_type), intent(inout) :: self

        self%name = 'skates'
        self%n = 3*self%skates
        self%n_nonholonomic = self%skates
        self%constant_mass = .true.
        self%nonholonomic_jacobian => rows
        self%constraint_acceleration => acceleration
        self%mass_matrix => mass
        self%applied_force => force
    end subroutine define

    !> All at rest except for their spin, each at another angle.
    subroutine start(self, q, qd)
        class(skates_type), intent(in) :: self
        real(wp), intent(out) :: q(:), qd(:)
        integer :: i

        q = 0.0_wp
        qd = 0.0_wp
        do i = 1, self%skates
            q(3*i) = 0.1_wp*i
            qd(3*i) = 1.0_wp
        end do
    end subroutine start

    subroutine rows(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat
        integer :: i

        stat = 0
        value = 0.0_wp
        do i = 1, size(value, 1)
            value(i, 3*i - 2) = sin(q(3*i))
            value(i, 3*i - 1) = -cos(q(3*i))
        end do
        select type (self)
        class is (skates_type)
            i = self%disguised
            if (i > 0) value(i, 3*i - 2:3*i - 1) = [2 + sin(q(3*i - 1)), 0.0_wp]
        end select
    end subroutine rows

    subroutine acceleration(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat
        integer :: i

        stat = 0
        do i = 1, size(value)
            value(i) = qd(3*i)*(cos(q(3*i))*qd(3*i - 2) + sin(q(3*i))*qd(3*i - 1))
        end do
        select type (self)
        class is (skates_type)
            i = self%disguised
            if (i > 0) value(i) = cos(q(3*i - 1))*qd(3*i - 1)*qd(3*i - 2)
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
        do i = 1, size(value, 1)
            value(i, i) = merge(0.2_wp, 1.0_wp, modulo(i, 3) == 0)
        end do
    end subroutine mass

    subroutine force(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        value(1::3) = 2.9_wp
    end subroutine force
end module model_skates
