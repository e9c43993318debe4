! SPDX-License-Identifier: MIT
!> The polynomial through velocities and accelerations of some states (Hermite), in Newton's form, and its integral from the
!> coordinates of one state. It continues a smooth motion beyond these states. Only one state gives coordinates: after many turns of
!> a body, rounding of its angle would otherwise be extrapolated too.
module tandem_simulate_state_polynomial
    use tandem_kinds, only: wp
    use tandem_pack, only: pack_type
    implicit none (type, external)
    private

    public :: state_polynomial_type, most_nodes, quadrature_nodes, quadrature_weights

    !> Largest number of states, and number of conditions at each.
    integer, parameter :: most_nodes = 6, conditions = 2
    !> Gauss's quadrature for the interval [0, 1], exact for polynomials of degree 13.
    real(wp), parameter :: quadrature_nodes(7) = [0.02544604382862073774_wp, 0.12923440720030278007_wp, &
        0.29707742431130141655_wp, 0.5_wp, 0.70292257568869858345_wp, 0.87076559279969721993_wp, 0.97455395617137926226_wp]
    real(wp), parameter :: quadrature_weights(7) = [0.06474248308443484664_wp, 0.13985269574463833395_wp, &
        0.19091502525255947248_wp, 0.20897959183673469388_wp, 0.19091502525255947248_wp, 0.13985269574463833395_wp, &
        0.06474248308443484664_wp]

    type :: state_polynomial_type
        !> Number of terms. Term k of the velocities is c(:, k) times the product of x - zeros(i), i < k, with the time x since t0.
        integer, private :: n_terms = 0
        real(wp), private :: t0 = 0.0_wp
        !> Coordinates at t0 (n).
        real(wp), allocatable, private :: q0(:)
        real(wp), allocatable, private :: zeros(:), c(:, :)
        !> Work space (n) each.
        real(wp), allocatable, private :: qd(:), qdd(:)
    contains
        procedure :: begin, add_state, add_velocity, add_acceleration, evaluate, pack_state
    end type state_polynomial_type

contains

    !> Begin with coordinates at a time, without velocities.
    pure subroutine begin(self, t0, q0)
        class(state_polynomial_type), intent(inout) :: self
        !> A time near the states and the arguments.
        real(wp), intent(in) :: t0
        !> (n).
        real(wp), intent(in) :: q0(:)

        if (.not. allocated(self%c)) then
            allocate (self%c(size(q0), conditions*most_nodes + 1), self%zeros(conditions*most_nodes + 1), source=0.0_wp)
            allocate (self%q0(size(q0)), source=0.0_wp)
        end if
        ! Restored states have no work space.
        if (.not. allocated(self%qd)) allocate (self%qd(size(q0)), self%qdd(size(q0)), source=0.0_wp)
        self%t0 = t0
        self%q0(:) = q0
        self%n_terms = 0
    end subroutine begin

    !> Let the polynomial also have the velocities and accelerations of a state (n). Each condition determines one more term, which
    !> does not affect earlier ones.
    pure subroutine add_state(self, t, qd, qdd)
        class(state_polynomial_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: qd(:), qdd(:)

        call self%add_velocity(t, qd)
        call self%add_acceleration(t, qdd)
    end subroutine add_state

    !> Let the polynomial also have given velocities at a time.
    pure subroutine add_velocity(self, t, qd)
        class(state_polynomial_type), intent(inout) :: self
        real(wp), intent(in) :: t
        !> (n).
        real(wp), intent(in), contiguous :: qd(:)
        real(wp) :: x, product(conditions)
        integer :: i

        x = t - self%t0
        call find_product(self, x, product)
        call find_rates(self, x, self%qd, self%qdd)
        self%n_terms = self%n_terms + 1
        self%zeros(self%n_terms) = x
        do i = 1, size(qd)
            self%c(i, self%n_terms) = (qd(i) - self%qd(i))/product(1)
        end do
    end subroutine add_velocity

    !> Let the polynomial also have given accelerations at a time, by a last term.
    pure subroutine add_acceleration(self, t, qdd)
        class(state_polynomial_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: qdd(:)
        real(wp) :: x, product(conditions)
        integer :: i

        x = t - self%t0
        call find_rates(self, x, self%qd, self%qdd)
        call find_product(self, x, product)
        self%n_terms = self%n_terms + 1
        self%zeros(self%n_terms) = x
        do i = 1, size(qdd)
            self%c(i, self%n_terms) = (qdd(i) - self%qdd(i))/product(2)
        end do
    end subroutine add_acceleration

    !> The product of all factors x - zeros, and its derivative.
    pure subroutine find_product(self, x, product)
        type(state_polynomial_type), intent(in) :: self
        real(wp), intent(in) :: x
        real(wp), intent(out) :: product(conditions)
        integer :: k

        product = [1.0_wp, 0.0_wp]
        do k = 1, self%n_terms
            product(2) = product(2)*(x - self%zeros(k)) + product(1)
            product(1) = product(1)*(x - self%zeros(k))
        end do
    end subroutine find_product

    !> Velocities and accelerations at a time since t0.
    pure subroutine find_rates(self, x, qd, qdd)
        type(state_polynomial_type), intent(in) :: self
        real(wp), intent(in) :: x
        !> (n) each.
        real(wp), intent(out), contiguous :: qd(:), qdd(:)
        integer :: i, k

        qd(:) = 0.0_wp
        qdd(:) = 0.0_wp
        do k = self%n_terms, 1, -1
            do i = 1, size(qd)
                qdd(i) = qdd(i)*(x - self%zeros(k)) + qd(i)
                qd(i) = qd(i)*(x - self%zeros(k)) + self%c(i, k)
            end do
        end do
    end subroutine find_rates

    !> Coordinates, velocities and accelerations at a time.
    pure subroutine evaluate(self, t, q, qd, qdd)
        class(state_polynomial_type), intent(inout) :: self
        real(wp), intent(in) :: t
        !> (n) each.
        real(wp), intent(out), contiguous :: q(:), qd(:), qdd(:)
        integer :: i, k

        q(:) = 0.0_wp
        do k = 1, size(quadrature_nodes)
            call find_rates(self, quadrature_nodes(k)*(t - self%t0), qd, qdd)
            do i = 1, size(q)
                q(i) = q(i) + quadrature_weights(k)*qd(i)
            end do
        end do
        do i = 1, size(q)
            q(i) = self%q0(i) + (t - self%t0)*q(i)
        end do
        call find_rates(self, t - self%t0, qd, qdd)
    end subroutine evaluate

    !> All components.
    subroutine pack_state(self, pack)
        class(state_polynomial_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%n_terms)
        call pack%item(self%t0)
        call pack%item(self%q0)
        call pack%item(self%zeros)
        call pack%item(self%c)
    end subroutine pack_state
end module tandem_simulate_state_polynomial
