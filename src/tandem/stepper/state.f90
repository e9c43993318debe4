! SPDX-License-Identifier: MIT
!> The state of the motion at one time.
module tandem_stepper_state
    use tandem_kinds, only: wp
    use tandem_linalg_kernels, only: copy_vector => copy
    use tandem_pack, only: pack_type
    implicit none (type, external)
    private

    public :: go_along, go_between, quintic, state_type

    type :: state_type
        !> Time.
        real(wp) :: t = 0.0_wp
        !> Coordinates, velocities and accelerations (n); all three constraint levels hold.
        real(wp), allocatable :: q(:), qd(:), qdd(:)
        !> Position and velocity increments relative to the chart's origin (n), in the coordinates of the chart.
        real(wp), allocatable :: dq(:), dqd(:)
    contains
        procedure :: allocate => allocate_state, begin, pack_state, copy, take
    end type state_type

contains

    !> Allocate for n coordinates, all zero.
    pure subroutine allocate_state(self, n)
        class(state_type), intent(inout) :: self
        !> Number of coordinates.
        integer, intent(in) :: n

        ! Avoid temporaries, which would fragment the memory.
        if (allocated(self%q)) deallocate (self%q, self%qd, self%qdd, self%dq, self%dqd)
        allocate (self%q(n), self%qd(n), self%qdd(n), self%dq(n), self%dqd(n), source=0.0_wp)
    end subroutine allocate_state

    !> Set coordinates and velocities at a start; all other components become zero. Arrays of equal size are not reallocated,
    !> because q and qd may belong to this state.
    pure subroutine begin(self, t, q, qd)
        class(state_type), intent(inout) :: self
        !> Time, coordinates and velocities (n).
        real(wp), intent(in) :: t, q(:), qd(:)
        logical :: fits

        fits = allocated(self%q)
        if (fits) fits = size(self%q) == size(q)
        if (.not. fits) call self%allocate(size(q))
        self%t = t
        self%q(:) = q
        self%qd(:) = qd
        self%qdd(:) = 0.0_wp
        self%dq(:) = 0.0_wp
        self%dqd(:) = 0.0_wp
    end subroutine begin

    !> Pack all components.
    subroutine pack_state(self, pack)
        class(state_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%t)
        call pack%item(self%q, self%qd, self%qdd, self%dq, self%dqd)
    end subroutine pack_state

    !> Copy another state without allocation, unless sizes differ or nothing is allocated. Assignment would reallocate.
    pure subroutine copy(self, other)
        class(state_type), intent(inout) :: self
        type(state_type), intent(in) :: other
        integer :: n

        n = size(other%q)
        if (.not. allocated(self%q)) call self%allocate(n)
        self%t = other%t
        call copy_vector(n, other%q, self%q)
        call copy_vector(n, other%qd, self%qd)
        call copy_vector(n, other%qdd, self%qdd)
        call copy_vector(n, other%dq, self%dq)
        call copy_vector(n, other%dqd, self%dqd)
    end subroutine copy

    !> Move the arrays of another state to this one, which leaves the other one empty.
    pure subroutine take(self, other)
        class(state_type), intent(inout) :: self
        type(state_type), intent(inout) :: other

        self%t = other%t
        call move_alloc(other%q, self%q)
        call move_alloc(other%qd, self%qd)
        call move_alloc(other%qdd, self%qdd)
        call move_alloc(other%dq, self%dq)
        call move_alloc(other%dqd, self%dqd)
    end subroutine take

    !> Advance coordinates and velocities along rates, or add weighted rates to sums.
    pure subroutine go_along(n, h, rate_q, rate_qd, q, qd)
        integer, intent(in) :: n
        !> All arrays have size n.
        real(wp), intent(in) :: h, rate_q(n), rate_qd(n)
        real(wp), intent(inout) :: q(n), qd(n)
        integer :: i

        !GCC$ UNROLL 1
        do i = 1, n
            q(i) = q(i) + h*rate_q(i)
            qd(i) = qd(i) + h*rate_qd(i)
        end do
    end subroutine go_along

    !> Coordinates and velocities at a time between two states, by the polynomial of degree 5 through coordinates, velocities and
    !> accelerations at both (Hermite). It violates the constraints by no more than its interpolation error.
    pure subroutine go_between(a, b, t, q, qd)
        type(state_type), intent(in) :: a, b
        real(wp), intent(in) :: t
        !> Coordinates and velocities (n).
        real(wp), intent(out), contiguous :: q(:), qd(:)
        real(wp) :: shape(6), slope(6)
        integer :: i

        call quintic(b%t - a%t, (t - a%t)/(b%t - a%t), shape, slope)
        do i = 1, size(q)
            q(i) = shape(1)*a%q(i) + shape(2)*a%qd(i) + shape(3)*a%qdd(i) + &
                shape(4)*b%q(i) + shape(5)*b%qd(i) + shape(6)*b%qdd(i)
            qd(i) = slope(1)*(a%q(i) - b%q(i)) + slope(2)*a%qd(i) + slope(3)*a%qdd(i) + slope(5)*b%qd(i) + slope(6)*b%qdd(i)
        end do
    end subroutine go_between

    !> Weights of the quintic Hermite polynomial: of value, first and second derivative at the start and at the end of an interval,
    !> for the value of the polynomial and for its derivatives.
    pure subroutine quintic(h, x, shape, slope, bend)
        !> Length of the interval; position within it, 0 to 1.
        real(wp), intent(in) :: h, x
        !> Weights for the value, for the first derivative and, if requested, for the second derivative.
        real(wp), intent(out) :: shape(6), slope(6)
        real(wp), intent(out), optional :: bend(6)
        real(wp) :: y

        y = 1.0_wp - x
        shape(1) = y**3*(1 + x*(3 + 6*x))
        shape(2) = h*x*y**3*(1 + 3*x)
        shape(3) = h**2*0.5_wp*x**2*y**3
        shape(4) = x**3*(1 + y*(3 + 6*y))
        shape(5) = -h*y*x**3*(1 + 3*y)
        shape(6) = h**2*0.5_wp*y**2*x**3
        slope(1) = -30*x**2*y**2/h
        slope(2) = y**2*(1 - 3*x)*(1 + 5*x)
        slope(3) = h*0.5_wp*x*y**2*(2 - 5*x)
        slope(4) = -slope(1)
        slope(5) = x**2*(1 - 3*y)*(1 + 5*y)
        slope(6) = -h*0.5_wp*y*x**2*(2 - 5*y)
        if (.not. present(bend)) return
        bend(1) = 60*x*y*(x - y)/h**2
        bend(2) = -12*x*y*(3 - 5*x)/h
        bend(3) = y*(1 - 8*x + 10*x**2)
        bend(4) = -bend(1)
        bend(5) = 12*x*y*(3 - 5*y)/h
        bend(6) = x*(1 - 8*y + 10*y**2)
    end subroutine quintic
end module tandem_stepper_state
