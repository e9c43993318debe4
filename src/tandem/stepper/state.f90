! SPDX-License-Identifier: MIT
!> The state of the motion at one time.
module tandem_stepper_state
    use tandem_kinds, only: wp
    use tandem_linalg_kernels, only: copy_vector => copy
    use tandem_pack, only: pack_type
    implicit none (type, external)
    private

    public :: go_along, state_type

    type :: state_type
        !> Time.
        real(wp) :: t = 0.0_wp
        !> Coordinates, velocities and accelerations (n); all three constraint levels hold.
        real(wp), allocatable :: q(:), qd(:), qdd(:)
        !> Position and velocity increments since the chart's origin (n), in the chart's own coordinates.
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

        ! Without temporaries, which would leave holes in the memory.
        if (allocated(self%q)) deallocate (self%q, self%qd, self%qdd, self%dq, self%dqd)
        allocate (self%q(n), self%qd(n), self%qdd(n), self%dq(n), self%dqd(n), source=0.0_wp)
    end subroutine allocate_state

    !> Become a start: all else is zero. What has the size stays where it is, as q and qd may be its own.
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

    !> All of it.
    subroutine pack_state(self, pack)
        class(state_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%t)
        call pack%item(self%q, self%qd, self%qdd, self%dq, self%dqd)
    end subroutine pack_state

    !> Take the values of another state of the same size, or of any where nothing is allocated. Assignment would allocate again.
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

    !> Become another state, which is left without any, as this one is where there was none. Nothing is copied.
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

    !> Go on along rates, or add weighted ones to sums.
    pure subroutine go_along(n, h, rate_q, rate_qd, q, qd)
        integer, intent(in) :: n
        !> (n) each.
        real(wp), intent(in) :: h, rate_q(n), rate_qd(n)
        real(wp), intent(inout) :: q(n), qd(n)
        integer :: i

        !GCC$ UNROLL 1
        do i = 1, n
            q(i) = q(i) + h*rate_q(i)
            qd(i) = qd(i) + h*rate_qd(i)
        end do
    end subroutine go_along
end module tandem_stepper_state
