! SPDX-License-Identifier: MIT
!> Separate copies of one mechanism side by side: a system of any size with the motion of one copy. Constraints may be mixed: each
!> with a part of that of the next copy, which changes only the matrices.
module model_copies
    use tandem, only: model_type, procedure_model_type, wp
    implicit none (type, external)
    private

    public :: copies_type

    type, extends(procedure_model_type) :: copies_type
        !> The mechanism, with single procedures and holonomic constraints, and number of copies.
        class(procedure_model_type), pointer :: one => null()
        integer :: copies = 1
        !> Part of the next copy's constraint that is added to each.
        real(wp) :: mixing = 0.0_wp
    contains
        procedure :: define
    end type copies_type

contains

    !> Associate the procedures; `one` and `copies` must be set.
    subroutine define(self)
        class(copies_type), intent(inout) :: self

        self%name = 'copies'
        self%n = self%copies*self%one%n
        self%n_holonomic = self%copies*self%one%n_holonomic
        self%constant_mass = self%one%constant_mass
        self%holonomic => position
        self%holonomic_jacobian => jacobian
        self%holonomic_rate => rate_of_position
        self%constraint_acceleration => acceleration
        self%mass_matrix => mass
        self%applied_force => force
    end subroutine define

    !> Add to the m rows of each copy a part of those of the next one.
    pure subroutine mix(m, part, value)
        integer, intent(in) :: m
        real(wp), intent(in) :: part
        real(wp), intent(inout) :: value(:)
        integer :: i

        do i = 1, size(value) - m
            value(i) = value(i) + part*value(i + m)
        end do
    end subroutine mix

    subroutine position(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat
        integer :: i

        stat = 0
        select type (self)
        class is (copies_type)
            associate (n => self%one%n, m => self%one%n_holonomic)
                do i = 1, self%copies
                    call self%one%holonomic(self%one, t, q(n*(i - 1) + 1:n*i), value(m*(i - 1) + 1:m*i), stat)
                end do
                call mix(m, self%mixing, value)
            end associate
        end select
    end subroutine position

    subroutine jacobian(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat
        integer :: i

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (copies_type)
            associate (n => self%one%n, m => self%one%n_holonomic)
                do i = 1, self%copies
                    call self%one%holonomic_jacobian(self%one, t, q(n*(i - 1) + 1:n*i), value(m*(i - 1) + 1:m*i, &
                        n*(i - 1) + 1:n*i), stat)
                end do
                do i = 1, size(value, 2)
                    call mix(m, self%mixing, value(:, i))
                end do
            end associate
        end select
    end subroutine jacobian

    subroutine rate_of_position(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat
        integer :: i

        stat = 0
        select type (self)
        class is (copies_type)
            associate (n => self%one%n, m => self%one%n_holonomic)
                do i = 1, self%copies
                    call self%one%holonomic_rate(self%one, t, q(n*(i - 1) + 1:n*i), value(m*(i - 1) + 1:m*i), stat)
                end do
                call mix(m, self%mixing, value)
            end associate
        end select
    end subroutine rate_of_position

    subroutine acceleration(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat
        integer :: i

        stat = 0
        select type (self)
        class is (copies_type)
            associate (n => self%one%n, m => self%one%n_holonomic)
                do i = 1, self%copies
                    call self%one%constraint_acceleration(self%one, t, q(n*(i - 1) + 1:n*i), qd(n*(i - 1) + 1:n*i), &
                        value(m*(i - 1) + 1:m*i), stat)
                end do
                call mix(m, self%mixing, value)
            end associate
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
        select type (self)
        class is (copies_type)
            associate (n => self%one%n)
                do i = 1, self%copies
                    call self%one%mass_matrix(self%one, q(n*(i - 1) + 1:n*i), value(n*(i - 1) + 1:n*i, n*(i - 1) + 1:n*i), stat)
                end do
            end associate
        end select
    end subroutine mass

    subroutine force(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat
        integer :: i

        stat = 0
        select type (self)
        class is (copies_type)
            associate (n => self%one%n)
                do i = 1, self%copies
                    call self%one%applied_force(self%one, t, q(n*(i - 1) + 1:n*i), qd(n*(i - 1) + 1:n*i), &
                        value(n*(i - 1) + 1:n*i), stat)
                end do
            end associate
        end select
    end subroutine force
end module model_copies
