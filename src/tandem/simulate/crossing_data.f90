! SPDX-License-Identifier: MIT
!> Data of crossings: steps over configurations in which C loses rank at one instant, and the motion is smooth.
module tandem_simulate_crossing_data
    use tandem_chart, only: chart_memory_type
    use tandem_kinds, only: long, wp
    use tandem_pack, only: pack_type
    use tandem_simulate_collocation, only: collocation_type
    use tandem_simulate_recent_states, only: recent_states_type
    use tandem_simulate_state_polynomial, only: state_polynomial_type
    use tandem_stepper_state, only: state_type
    implicit none (type, external)
    private

    public :: crossing_record_type, crossing_type, obstacle_length

    !> Length of the reason why a configuration was not passed.
    integer, parameter :: obstacle_length = 160

    !> Record of a singular configuration that was passed.
    type :: crossing_record_type
        !> Its time, and the ends of the step over it.
        real(wp) :: t = 0.0_wp, t_from = 0.0_wp, t_to = 0.0_wp
        !> Estimated error of that step, relative to s + |y| of each coordinate and velocity.
        real(wp) :: error = 0.0_wp
    end type crossing_record_type

    !> Result of a try.
    type :: crossing_try_type
        type(crossing_record_type) :: record
        type(state_type) :: trial
        type(state_polynomial_type) :: curve
        real(wp) :: spread = 0.0_wp, apart(2) = 0.0_wp
    end type crossing_try_type

    !> Data of a run for crossings.
    type :: crossing_type
        !> True if singular configurations are located; true if they are passed, otherwise runs end there.
        logical :: is_on = .false., passes = .false.
        type(recent_states_type) :: recent
        !> The motion through the last configuration, or through the one ahead.
        type(state_polynomial_type) :: curve
        !> True if it describes the last step; true if it describes the next step, from a state at or near the configuration; true
        !> if the configuration is listed.
        logical :: is_last_step = .false., starts = .false., is_listed = .false.
        !> Time from which a crossing was tried last, and the reason why it was not made; blank if none was tried.
        real(wp) :: tried_at = -huge(1.0_wp)
        character(len=obstacle_length) :: obstacle = ''
        !> Smallest error of the tries before, and the configuration to which they belong.
        real(wp) :: tried_error = huge(1.0_wp), tried_for = -huge(1.0_wp)
        !> Smallest distance from the constraints, relative to s + |y|, by which tries found that the motion turns off; end of the
        !> last of them.
        real(wp) :: turned_off = huge(1.0_wp), turned_off_until = -huge(1.0_wp)
        !> The crossing in progress; the rate of the independence at its configuration; the time from it within which the polynomial
        !> determines the motion better than C.
        type(crossing_record_type) :: record
        real(wp) :: rate = 0.0_wp, near = 0.0_wp
        !> Its error in all directions, relative to s + |y|, and on the scales of coordinates and velocities.
        real(wp) :: spread = 0.0_wp, apart(2) = 0.0_wp
        !> The best try so far.
        type(crossing_try_type) :: best
        !> Determines the motion on both sides of it.
        type(collocation_type) :: collocation
        !> Work space: a state and its prediction; states of the polynomial (n, 3); the polynomial of the way back; the chart.
        type(state_type) :: trial, predicted
        real(wp), allocatable :: values(:, :)
        type(state_polynomial_type) :: back
        class(chart_memory_type), allocatable :: memory
    contains
        procedure :: initialize, note, forget, pack_state
        procedure :: is_due, keep_try, take_best
    end type crossing_type

contains

    !> Begin a run.
    subroutine initialize(self, is_on, passes, n)
        class(crossing_type), intent(out) :: self
        logical, intent(in) :: is_on, passes
        !> Number of coordinates.
        integer, intent(in) :: n

        self%is_on = is_on
        self%passes = is_on .and. passes
        if (is_on) call self%recent%initialize(n)
    end subroutine initialize

    !> True if a configuration that was located and not passed is ahead at a time t, and the time to it has halved since.
    logical function is_due(self, t, h, room)
        class(crossing_type), intent(in) :: self
        real(wp), intent(in) :: t, h
        !> Time to the configuration, unchanged if it is not due.
        real(wp), intent(inout) :: room
        real(wp) :: left

        left = self%tried_for - t
        is_due = self%is_on .and. left > 0.0_wp .and. h > 0.0_wp .and. left < 0.5_wp*(self%tried_for - self%tried_at)
        if (is_due) room = left
    end function is_due

    !> Keep the last try as the best one.
    subroutine keep_try(self)
        class(crossing_type), intent(inout) :: self

        self%best%record = self%record
        self%best%trial = self%trial
        self%best%curve = self%curve
        self%best%spread = self%spread
        self%best%apart = self%apart
    end subroutine keep_try

    !> Return to the best try.
    subroutine take_best(self)
        class(crossing_type), intent(inout) :: self

        self%record = self%best%record
        self%trial = self%best%trial
        self%curve = self%best%curve
        self%spread = self%best%spread
        self%apart = self%best%apart
    end subroutine take_best

    !> Store the state at the end of a step.
    pure subroutine note(self, state)
        class(crossing_type), intent(inout) :: self
        type(state_type), intent(in) :: state

        if (self%is_on) call self%recent%note(state)
    end subroutine note

    !> Discard all states, since the motion has a kink or a jump here.
    pure subroutine forget(self)
        class(crossing_type), intent(inout) :: self

        call self%recent%forget()
        self%tried_at = -huge(1.0_wp)
        self%starts = .false.
    end subroutine forget

    !> All components that later steps use.
    subroutine pack_state(self, pack)
        class(crossing_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        if (.not. self%is_on) return
        call self%recent%pack_state(pack)
        call pack%item(self%tried_at, self%tried_error, self%tried_for)
        call pack%item(self%turned_off, self%turned_off_until)
        call pack%item(self%obstacle)
        call pack%item(self%is_last_step, self%starts, self%is_listed)
        call pack%item(self%record%error, self%near)
        call pack%item(self%record%t, self%record%t_from, self%record%t_to)
        if (self%is_last_step .or. self%starts) call self%curve%pack_state(pack)
    end subroutine pack_state
end module tandem_simulate_crossing_data
