! SPDX-License-Identifier: MIT
!> Recent states of a run, spread over the time before the last one: as consecutive as its steps, and further back less and less
!> dense. A polynomial through some of them continues the motion where C loses rank.
module tandem_simulate_recent_states
    use tandem_kinds, only: wp
    use tandem_pack, only: pack_type
    use tandem_stepper_state, only: state_type
    implicit none (type, external)
    private

    public :: recent_states_type

    !> Number of states.
    integer, parameter :: most = 16

    type :: recent_states_type
        !> Number of stored states.
        integer :: n = 0
        !> Their times, the last state first (most).
        real(wp), allocatable :: t(:)
        !> Their places in `values`.
        integer, allocatable, private :: place(:)
        !> Coordinates, velocities and accelerations (n, 3, most).
        real(wp), allocatable, private :: values(:, :, :)
        !> True for each place whose state was corrected.
        logical, private :: exact(most) = .false.
    contains
        procedure :: initialize, forget, is_full, note, get, is_exact, correct, pack_state
    end type recent_states_type

contains

    !> Allocate for n coordinates, without states.
    pure subroutine initialize(self, n)
        class(recent_states_type), intent(inout) :: self
        integer, intent(in) :: n
        integer :: i

        if (allocated(self%t)) deallocate (self%t, self%place, self%values)
        allocate (self%t(most), self%values(n, 3, most), source=0.0_wp)
        allocate (self%place(most), source=[(i, i=1, most)])
        self%n = 0
    end subroutine initialize

    !> Discard all states: the motion has a kink or a jump here, or continues elsewhere.
    pure subroutine forget(self)
        class(recent_states_type), intent(inout) :: self

        self%n = 0
    end subroutine forget

    !> True if another state replaces one.
    pure logical function is_full(self)
        class(recent_states_type), intent(in) :: self

        is_full = self%n == most
    end function is_full

    !> Add the last state. If no place is left, it replaces the state whose neighbours are closest together compared with the time
    !> that has passed since then, or the oldest state.
    pure subroutine note(self, state)
        class(recent_states_type), intent(inout) :: self
        type(state_type), intent(in) :: state
        !> States further apart than this need no others between them.
        real(wp), parameter :: widest = 0.6_wp
        real(wp) :: gap, least_gap, past, least_past
        integer :: i, free, k

        if (self%n < most) then
            self%n = self%n + 1
            free = self%n
        else
            free = most
            least_gap = widest
            least_past = 1.0_wp
            do i = 2, most - 1
                gap = self%t(i - 1) - self%t(i + 1)
                past = state%t - self%t(i + 1)
                ! Ratios are compared without divisions.
                if (gap*least_past < least_gap*past) then
                    least_gap = gap
                    least_past = past
                    free = i
                end if
            end do
        end if
        k = self%place(free)
        do i = free, 2, -1
            self%t(i) = self%t(i - 1)
            self%place(i) = self%place(i - 1)
        end do
        self%t(1) = state%t
        self%place(1) = k
        self%exact(k) = .false.
        do i = 1, size(state%q)
            self%values(i, 1, k) = state%q(i)
            self%values(i, 2, k) = state%qd(i)
            self%values(i, 3, k) = state%qdd(i)
        end do
    end subroutine note

    !> The i-th state, counted from the last one.
    pure subroutine get(self, i, values)
        class(recent_states_type), intent(in) :: self
        integer, intent(in) :: i
        !> Coordinates, velocities and accelerations (n, 3).
        real(wp), intent(out) :: values(:, :)

        values(:, :) = self%values(:, :, self%place(i))
    end subroutine get

    !> True if the i-th last state was corrected.
    pure logical function is_exact(self, i)
        class(recent_states_type), intent(in) :: self
        integer, intent(in) :: i

        is_exact = self%exact(self%place(i))
    end function is_exact

    !> Replace the i-th last state by one with smaller errors.
    pure subroutine correct(self, i, values)
        class(recent_states_type), intent(inout) :: self
        integer, intent(in) :: i
        !> Coordinates, velocities and accelerations (n, 3).
        real(wp), intent(in) :: values(:, :)

        self%values(:, :, self%place(i)) = values
        self%exact(self%place(i)) = .true.
    end subroutine correct

    !> All components.
    subroutine pack_state(self, pack)
        class(recent_states_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack
        integer :: k

        call pack%item(self%n)
        call pack%item(self%t)
        call pack%item(self%place)
        call pack%item(self%values)
        do k = 1, most
            call pack%item(self%exact(k))
        end do
    end subroutine pack_state
end module tandem_simulate_recent_states
