! SPDX-License-Identifier: MIT
!> Events for several tests: functions of time, and actions on the state and on the model.
module event_kinds
    use model_pendulum, only: pendulum_type
    use tandem, only: event_type, failure_type => error_type, model_type, set_error, &
        threshold_event_type, wp
    use tandem_status, only: status_callback_failed
    use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
    implicit none (type, external)
    private

    public :: time_event_type, bounce_type, shove_type, retune_type, new_time_event

    !> A function of time alone.
    type, extends(event_type) :: time_event_type
        !> 'line': t - at; 'square': (t - at)**2 - depth; 'sine': sin(t/at); 'cubic': (t - at)**3; 'plateau': max(at - t, 0);
        !> 'jump': 1 before `at`, -1 from there on; 'zero'; 'nan' and 'stat' from `at` on.
        character(len=8) :: kind = 'line'
        real(wp) :: at = 0.0_wp, depth = 0.0_wp
        !> Number of evaluations.
        integer :: calls = 0
    contains
        procedure :: evaluate => evaluate_time
    end type time_event_type

    !> One velocity changes its sign, by a coefficient of restitution.
    type, extends(threshold_event_type) :: bounce_type
        real(wp) :: restitution = 0.5_wp
    contains
        procedure :: act => bounce
    end type bounce_type

    !> The state is changed by given amounts, which may miss the constraints; or the action fails.
    type, extends(time_event_type) :: shove_type
        real(wp), allocatable :: dq(:), dqd(:)
        logical :: fails = .false.
    contains
        procedure :: act => shove
    end type shove_type

    !> A pendulum gets another mass and another gravity.
    type, extends(threshold_event_type) :: retune_type
        real(wp) :: m = 0.0_wp, g = 0.0_wp
    contains
        procedure :: act => retune
    end type retune_type

contains

    !> A time event that is to be recorded.
    function new_time_event(kind, at, depth, direction, stops) result(event)
        character(len=*), intent(in) :: kind
        real(wp), intent(in) :: at
        real(wp), intent(in), optional :: depth
        integer, intent(in), optional :: direction
        logical, intent(in), optional :: stops
        type(time_event_type) :: event

        event%name = kind
        event%kind = kind
        event%at = at
        if (present(depth)) event%depth = depth
        if (present(direction)) event%direction = direction
        if (present(stops)) event%stops = stops
    end function new_time_event

    subroutine evaluate_time(self, t, q, qd, lambda, value, stat)
        class(time_event_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:), lambda(:)
        real(wp), intent(out) :: value
        integer, intent(out) :: stat

        stat = 0
        self%calls = self%calls + 1
        select case (self%kind)
        case ('line')
            value = t - self%at
        case ('square')
            value = (t - self%at)**2 - self%depth
        case ('sine')
            value = sin(t/self%at)
        case ('cubic')
            value = (t - self%at)**3
        case ('plateau')
            value = max(self%at - t, 0.0_wp)
        case ('jump')
            value = merge(1.0_wp, -1.0_wp, t < self%at)
        case ('nan')
            value = 1.0_wp
            if (t >= self%at) value = ieee_value(value, ieee_quiet_nan)
        case ('stat')
            value = 1.0_wp
            if (t >= self%at) stat = 7
        case default
            value = 0.0_wp
        end select
    end subroutine evaluate_time

    subroutine bounce(self, model, t, q, qd, error)
        class(bounce_type), intent(inout) :: self
        class(model_type), intent(inout) :: model
        real(wp), intent(in) :: t
        real(wp), intent(inout) :: q(:), qd(:)
        type(failure_type), allocatable, intent(out) :: error

        qd(self%index) = -self%restitution*qd(self%index)
    end subroutine bounce

    subroutine shove(self, model, t, q, qd, error)
        class(shove_type), intent(inout) :: self
        class(model_type), intent(inout) :: model
        real(wp), intent(in) :: t
        real(wp), intent(inout) :: q(:), qd(:)
        type(failure_type), allocatable, intent(out) :: error

        if (allocated(self%dq)) q = q + self%dq
        if (allocated(self%dqd)) qd = qd + self%dqd
        if (self%fails) call set_error(error, status_callback_failed, 'the shove', 'push harder')
    end subroutine shove

    subroutine retune(self, model, t, q, qd, error)
        class(retune_type), intent(inout) :: self
        class(model_type), intent(inout) :: model
        real(wp), intent(in) :: t
        real(wp), intent(inout) :: q(:), qd(:)
        type(failure_type), allocatable, intent(out) :: error

        select type (model)
        class is (pendulum_type)
            model%m = self%m
            model%g = self%g
        end select
    end subroutine retune
end module event_kinds
