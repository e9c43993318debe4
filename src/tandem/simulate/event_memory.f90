! SPDX-License-Identifier: MIT
!> An event that a simulation watches: its function at the current state, and what the search for zeros and the judgement of its
!> actions remember from step to step.
module tandem_simulate_event_memory
    use tandem_kinds, only: wp
    use tandem_pack, only: pack_type
    use tandem_simulate_event, only: event_type
    implicit none (type, external)
    private

    public :: watched_type

    !> An event and what the search remembers of it.
    type :: watched_type
        class(event_type), pointer :: event => null()
        !> g at the current state, its last sign before that (0: there was none yet), and the largest |g| of the last step.
        real(wp) :: value = 0.0_wp, largest = 0.0_wp
        integer :: sign_before = 0
        !> Whether a zero at the current state is still to be judged: at the start of the run, or at the end of the last step.
        logical :: is_open = .true.
        !> Whether it has happened at the current state, so that its zero there does not count again, and in which direction.
        logical :: rests = .false.
        integer :: direction = 0
        !> While it rests: what rounding of the state makes of g.
        real(wp) :: noise = 0.0_wp
        !> Whether its action is due; whether the last one has sent g back, which must show until the given time, how far g would
        !> have gone on otherwise, and g before it.
        logical :: is_due = .false., is_sent_back = .false.
        real(wp) :: judged_until = 0.0_wp, reach = 0.0_wp, value_before = 0.0_wp
    contains
        procedure :: pack_state
    end type watched_type

contains

    !> What is remembered, for checkpoints: the rest serves within a step.
    subroutine pack_state(self, pack)
        class(watched_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call self%event%pack_state(pack)
        call pack%item(self%value)
        call pack%item(self%sign_before)
        call pack%item(self%is_open, self%rests)
        call pack%item(self%direction)
        call pack%item(self%noise)
        call pack%item(self%is_sent_back)
        call pack%item(self%judged_until, self%reach)
    end subroutine pack_state
end module tandem_simulate_event_memory
