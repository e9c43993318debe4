! SPDX-License-Identifier: MIT
!> A free particle in space: n = 3, no constraints. The force is a power of time, or springs, or nothing.
module model_particle
    use tandem, only: model_type, procedure_model_type, wp
    implicit none (type, external)
    private

    public :: particle_type

    type, extends(procedure_model_type) :: particle_type
        !> Masses along the axes.
        real(wp) :: m(3) = [1.0_wp, 2.0_wp, 4.0_wp]
        !> The force along each axis is m t**power, minus stiffness q.
        integer :: power = 0
        real(wp) :: stiffness(3) = 0.0_wp
    contains
        procedure :: define
    end type particle_type

contains

    !> Associate the procedures.
    subroutine define(self, with_force)
        class(particle_type), intent(inout) :: self
        logical, intent(in) :: with_force

        self%name = 'particle'
        self%n = 3
        self%constant_mass = .true.
        self%mass_matrix => mass
        if (with_force) self%applied_force => force
    end subroutine define

    subroutine mass(self, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat
        integer :: i

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (particle_type)
            do i = 1, 3
                value(i, i) = self%m(i)
            end do
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
        class is (particle_type)
            value = self%m*t**self%power - self%stiffness*q
        end select
    end subroutine force
end module model_particle
