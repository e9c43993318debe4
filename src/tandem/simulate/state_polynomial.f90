! SPDX-License-Identifier: MIT
!> The polynomial through coordinates, velocities and accelerations of some states (Hermite), in Newton's form. It continues a
!> smooth motion beyond these states.
module tandem_simulate_state_polynomial
    use tandem_kinds, only: wp
    use tandem_pack, only: pack_type
    implicit none (type, external)
    private

    public :: state_polynomial_type, most_nodes

    !> Largest number of states, and number of conditions at each.
    integer, parameter :: most_nodes = 4, conditions = 3

    type :: state_polynomial_type
        !> Number of terms. Term k is c(:, k) times the product of x - zeros(i), i < k, with the time x since t0.
        integer, private :: n_terms = 0
        real(wp), private :: t0 = 0.0_wp
        real(wp), allocatable, private :: zeros(:), c(:, :)
        !> Work space (n, 3).
        real(wp), allocatable, private :: values(:, :)
    contains
        procedure :: begin, add_state, add_acceleration, add_power, evaluate, pack_state
    end type state_polynomial_type

contains

    !> Begin without states.
    pure subroutine begin(self, n, t0)
        class(state_polynomial_type), intent(inout) :: self
        !> Number of coordinates.
        integer, intent(in) :: n
        !> A time near the states and the arguments.
        real(wp), intent(in) :: t0

        if (.not. allocated(self%c)) then
            allocate (self%c(n, conditions*most_nodes + 1), self%values(n, conditions), source=0.0_wp)
            allocate (self%zeros(conditions*most_nodes + 1), source=0.0_wp)
        end if
        self%t0 = t0
        self%n_terms = 0
    end subroutine begin

    !> Let the polynomial also pass through a state. Each condition determines one more term, which does not affect earlier ones.
    pure subroutine add_state(self, t, values)
        class(state_polynomial_type), intent(inout) :: self
        real(wp), intent(in) :: t
        !> Coordinates, velocities and accelerations (n, 3).
        real(wp), intent(in) :: values(:, :)
        !> Factorials.
        real(wp), parameter :: factor(conditions) = [1.0_wp, 1.0_wp, 2.0_wp]
        real(wp) :: product(conditions)
        integer :: i, k

        call find_product(self, t - self%t0, product)
        do k = 1, conditions
            call self%evaluate(t, self%values(:, 1), self%values(:, 2), self%values(:, 3))
            self%n_terms = self%n_terms + 1
            self%zeros(self%n_terms) = t - self%t0
            do i = 1, size(self%c, 1)
                self%c(i, self%n_terms) = (values(i, k) - self%values(i, k))/(factor(k)*product(1))
            end do
        end do
    end subroutine add_state

    !> Let the polynomial also have given accelerations at a time, by a last term.
    pure subroutine add_acceleration(self, t, qdd)
        class(state_polynomial_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: qdd(:)
        real(wp) :: product(conditions)
        integer :: i

        call self%evaluate(t, self%values(:, 1), self%values(:, 2), self%values(:, 3))
        call find_product(self, t - self%t0, product)
        self%n_terms = self%n_terms + 1
        self%zeros(self%n_terms) = t - self%t0
        do i = 1, size(qdd)
            self%c(i, self%n_terms) = (qdd(i) - self%values(i, 3))/product(3)
        end do
    end subroutine add_acceleration

    !> Add the next power of the time since t0, if the terms so far are powers.
    pure subroutine add_power(self, coefficients)
        class(state_polynomial_type), intent(inout) :: self
        !> (n).
        real(wp), intent(in) :: coefficients(:)

        self%n_terms = self%n_terms + 1
        self%zeros(self%n_terms) = 0.0_wp
        self%c(:, self%n_terms) = coefficients
    end subroutine add_power

    !> The product of all factors x - zeros, with its first and second derivative.
    pure subroutine find_product(self, x, product)
        type(state_polynomial_type), intent(in) :: self
        real(wp), intent(in) :: x
        real(wp), intent(out) :: product(conditions)
        integer :: k

        product = [1.0_wp, 0.0_wp, 0.0_wp]
        do k = 1, self%n_terms
            product(3) = product(3)*(x - self%zeros(k)) + 2*product(2)
            product(2) = product(2)*(x - self%zeros(k)) + product(1)
            product(1) = product(1)*(x - self%zeros(k))
        end do
    end subroutine find_product

    !> The polynomial and its derivatives at a time.
    pure subroutine evaluate(self, t, q, qd, qdd)
        class(state_polynomial_type), intent(in) :: self
        real(wp), intent(in) :: t
        !> (n) each.
        real(wp), intent(out), contiguous :: q(:), qd(:), qdd(:)
        real(wp) :: x
        integer :: i, k

        q(:) = 0.0_wp
        qd(:) = 0.0_wp
        qdd(:) = 0.0_wp
        do k = self%n_terms, 1, -1
            x = (t - self%t0) - self%zeros(k)
            do i = 1, size(q)
                qdd(i) = qdd(i)*x + 2*qd(i)
                qd(i) = qd(i)*x + q(i)
                q(i) = q(i)*x + self%c(i, k)
            end do
        end do
    end subroutine evaluate

    !> All components.
    subroutine pack_state(self, pack)
        class(state_polynomial_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%n_terms)
        call pack%item(self%t0)
        call pack%item(self%zeros)
        call pack%item(self%c)
    end subroutine pack_state
end module tandem_simulate_state_polynomial
