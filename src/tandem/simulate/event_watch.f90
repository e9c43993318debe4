! SPDX-License-Identifier: MIT
!> Events of a run: follows their functions from step to step, locates their zeros within steps, and checks their actions. The
!> caller provides the motion within a step as a curve, so that this module does not depend on the integration.
module tandem_simulate_event_watch
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    use tandem_error, only: error_type, set_error, to_text
    use tandem_kinds, only: long, wp
    use tandem_model, only: label_length, model_type
    use tandem_pack, only: pack_type
    use tandem_simulate_event, only: event_type, threshold_event_type
    use tandem_simulate_root, only: sign_of, zeros_type
    use tandem_status, only: status_callback_failed, status_event_limit, status_not_finite
    use tandem_stepper_state, only: state_type
    implicit none (type, external)
    private

    public :: curve_type, event_watch_type

    !> Positions of samples within a step. The samples near the ends tell an extremum at an end from one just before or after it.
    integer, parameter :: n_samples = 7
    real(wp), parameter :: aside = 1.0_wp/256
    !> Positions of the quarters and ends of a step.
    integer, parameter :: n_rough = 5
    real(wp), parameter :: sample_position(n_samples) = [0.0_wp, aside, 0.25_wp, 0.5_wp, 0.75_wp, 1.0_wp - aside, 1.0_wp]
    !> Relative position error of a zero within a step. Events closer than twice this distance are simultaneous.
    real(wp), parameter :: resolution = 1.0e-13_wp
    !> A sample is zero below this fraction of the largest |g| in the step.
    real(wp), parameter :: zero = 1.0e-13_wp
    !> A g that remains below this fraction of its largest absolute value so far may be a rounding error, such as the rate of a
    !> locked joint.
    real(wp), parameter :: faint = 1.0e-9_wp
    !> Largest number of zeros of one event in a step: a crossing between all samples, and two at every second extremum.
    integer, parameter :: most_zeros = 2*n_samples
    !> Largest number of successive events at the same time.
    integer, parameter :: most_at_once = 100
    !> Fraction of a step over which rates of g are measured at an event.
    real(wp), parameter :: part = 1.0e-3_wp

    !> Motion within a step, and the current position in it.
    type, abstract :: curve_type
        !> Start and end of the step (s).
        real(wp) :: t_from = 0.0_wp, t_to = 0.0_wp
        !> State at the current position.
        type(state_type), pointer :: state => null()
    contains
        procedure(go_to_interface), deferred :: go_to
        procedure(pass_through_interface), deferred :: pass_through
        procedure(multipliers_interface), deferred :: multipliers
    end type curve_type

    !> An event and the state of its search.
    type :: watched_type
        class(event_type), pointer :: event => null()
        !> g at the current state; the largest |g| of the last step and of all steps; the last nonzero sign of g before the current
        !> state, 0 if there is none.
        real(wp) :: value = 0.0_wp, largest = 0.0_wp, peak = 0.0_wp
        integer :: sign_before = 0
        !> True if it is undecided whether a zero at the current state counts: at the start of the run and at the end of the last
        !> step.
        logical :: is_open = .true.
        !> True if the event has occurred at the current state, so that the zero there does not count again; its direction.
        logical :: rests = .false.
        integer :: direction = 0
        !> Rounding error of g, set while `rests` is true or g is small.
        real(wp) :: noise = 0.0_wp
        !> True if the action of the event is due. True if the last action has reversed the motion of g, which must be visible
        !> before the time `check_until`; change of g without the action, and g before the action.
        logical :: is_due = .false., is_reversed = .false.
        real(wp) :: check_until = 0.0_wp, expected_change = 0.0_wp, value_before = 0.0_wp
    contains
        procedure :: is_faint
    end type watched_type

    !> Events, and the state of the search for their zeros.
    type :: event_watch_type
        !> Number of events.
        integer :: n = 0
        !> True if any action is due at the current state.
        logical :: has_to_act = .false.
        !> Number of evaluations of the functions of events.
        integer(long) :: evaluations = 0
        !> Zeros that the last search has found.
        type(zeros_type) :: found
        type(watched_type), allocatable, private :: watched(:)
        !> State of the events before the last search.
        type(watched_type), allocatable, private :: watched_before(:)
        logical, private :: were_stale = .true.
        !> The model, for the scales of its coordinates.
        class(model_type), pointer, private :: model => null()
        real(wp), allocatable, private :: lambda(:)
        !> g of each event at the samples of a step and soon after an event; at the quarters of a step without restored constraints.
        real(wp), allocatable, private :: samples(:, :), rough(:, :)
        !> Coordinates and velocities (n) at which `rough` is evaluated.
        real(wp), allocatable, private :: near_q(:), near_qd(:)
        !> Quantities of the model that events watch and that do not depend on multipliers; their values; true if there are any.
        logical, allocatable, private :: asked(:)
        real(wp), allocatable, private :: shown(:)
        logical, private :: measures = .false.
        logical, private :: lambda_is_current = .false., values_are_stale = .true.
        !> Number of successive events at the same time.
        integer, private :: n_at_once = 0
    contains
        procedure :: add, name, forget_values, rule_out, search, forget_search, find_cut, pass, settle, renew, prepare_actions, act
        procedure :: check_actions, pack_state
        procedure, private :: evaluate, evaluate_point, measure_all, end_measuring, measure_noise
    end type event_watch_type

    abstract interface
        !> Set `state` at a position in the step.
        subroutine go_to_interface(self, x, error)
            import :: curve_type, error_type, wp
            implicit none (type, external)
            class(curve_type), intent(inout) :: self
            !> Position, 0 at the start and 1 at the end of the step.
            real(wp), intent(in) :: x
            type(error_type), allocatable, intent(out) :: error
        end subroutine go_to_interface

        !> Return coordinates and velocities near a position in the step without restoring the constraints. `state` is unchanged.
        subroutine pass_through_interface(self, x, t, q, qd)
            import :: curve_type, wp
            implicit none (type, external)
            class(curve_type), intent(in) :: self
            !> Position, 0 at the start and 1 at the end of the step, where the result equals the states.
            real(wp), intent(in) :: x
            !> Time, coordinates (n) and velocities (n).
            real(wp), intent(out) :: t
            real(wp), intent(out), contiguous :: q(:), qd(:)
        end subroutine pass_through_interface

        !> The multipliers (nh + nd) at `state`.
        subroutine multipliers_interface(self, lambda)
            import :: curve_type, wp
            implicit none (type, external)
            class(curve_type), intent(inout) :: self
            real(wp), intent(out), contiguous :: lambda(:)
        end subroutine multipliers_interface
    end interface

    interface
        !> Decide whether any event may occur in the step that was just accepted. If not, advance all events to the next step.
        module subroutine rule_out(self, curve, may_happen)
            implicit none (type, external)
            class(event_watch_type), intent(inout) :: self
            class(curve_type), intent(in) :: curve
            logical, intent(out) :: may_happen
        end subroutine rule_out

        !> Find the zeros of all events in the step that was just accepted.
        module subroutine search(self, curve, is_last, error)
            implicit none (type, external)
            class(event_watch_type), intent(inout) :: self
            class(curve_type), intent(inout) :: curve
            !> True if no step may follow, so that a zero at the end counts now.
            logical, intent(in) :: is_last
            type(error_type), allocatable, intent(out) :: error
        end subroutine search
    end interface

contains

    !> Watch an event from the current state on. The event must outlive this object.
    subroutine add(self, event, model)
        class(event_watch_type), intent(inout) :: self
        class(event_type), intent(inout), target :: event
        class(model_type), intent(inout), target :: model
        type(watched_type), allocatable :: longer(:)

        allocate (longer(self%n + 1))
        if (self%n > 0) longer(:self%n) = self%watched
        self%n = self%n + 1
        self%model => model
        longer(self%n)%event => event
        call move_alloc(longer, self%watched)
        self%watched_before = self%watched
        if (.not. allocated(self%near_q)) allocate (self%near_q(model%n), self%near_qd(model%n), source=0.0_wp)
        select type (event)
        class is (threshold_event_type)
            if (event%quantity == 'lambda') event%needs_multipliers = .true.
            event%told_by => model
            if (event%measured_quantity() > 0 .and. .not. event%needs_multipliers) call ask_for(self, event%measured_quantity())
        end select
        if (.not. allocated(self%lambda)) allocate (self%lambda(model%n_constraints()), source=0.0_wp)
        if (allocated(self%samples)) deallocate (self%samples, self%rough)
        allocate (self%samples(self%n, n_samples + 1), self%rough(n_rough, self%n), source=0.0_wp)
        call self%found%allocate(most_zeros*self%n)
        self%values_are_stale = .true.
    end subroutine add

    !> Request a quantity, so that one call of the model per point measures the quantities of all events.
    subroutine ask_for(self, number)
        class(event_watch_type), intent(inout) :: self
        !> Index of a quantity.
        integer, intent(in) :: number

        associate (quantities => self%model%quantities)
            if (.not. self%measures) then
                allocate (self%asked(size(quantities)), source=.false.)
                allocate (self%shown(sum(max(1, quantities%width))), source=0.0_wp)
            end if
        end associate
        self%asked(number) = .true.
        self%measures = .true.
    end subroutine ask_for

    !> True if values up to the given absolute value may be rounding errors.
    pure logical function is_faint(self, largest)
        class(watched_type), intent(in) :: self
        real(wp), intent(in) :: largest

        is_faint = largest <= max(faint*self%peak, self%noise)
    end function is_faint

    !> Undo the last search, because its step is discarded.
    pure subroutine forget_search(self)
        class(event_watch_type), intent(inout) :: self

        self%watched(:) = self%watched_before
        self%values_are_stale = self%were_stale
    end subroutine forget_search

    !> Name of an event.
    pure function name(self, number)
        class(event_watch_type), intent(in) :: self
        integer, intent(in) :: number
        character(len=label_length) :: name

        name = self%watched(number)%event%name
    end function name

    !> Mark the values of all functions as out of date, because the motion continues from another state than the end of the last
    !> step.
    pure subroutine forget_values(self)
        class(event_watch_type), intent(inout) :: self

        self%values_are_stale = .true.
    end subroutine forget_values

    !> Find the first event that stops the run or changes the motion; the step is cut at its zero. All events within the interval of
    !> simultaneous events have passed their zeros at the cut.
    pure subroutine find_cut(self, curve, cut_at, at_once)
        class(event_watch_type), intent(in) :: self
        class(curve_type), intent(in) :: curve
        !> Position of the cut, beyond 1 if there is none; distance within which events are simultaneous.
        real(wp), intent(out) :: cut_at, at_once
        integer :: k

        at_once = max(2*resolution, 4*spacing(abs(curve%t_to))/(curve%t_to - curve%t_from))
        cut_at = 2.0_wp
        associate (zeros => self%found)
            do k = 1, zeros%n
                associate (event => self%watched(zeros%number(k))%event)
                    if (.not. (event%stops .or. event%changes)) cycle
                end associate
                cut_at = maxval(zeros%position(k:zeros%n), zeros%position(k:zeros%n) <= zeros%position(k) + at_once)
                return
            end do
        end associate
    end subroutine find_cut

    !> Advance all events from the end of a step that was searched and not cut.
    subroutine pass(self, is_last)
        class(event_watch_type), intent(inout) :: self
        !> True if a zero at the end of the step has counted as a crossing.
        logical, intent(in) :: is_last
        integer :: i, k

        do i = 1, self%n
            associate (watched => self%watched(i), value => self%samples(i, :n_samples))
                watched%value = value(n_samples)
                do k = 1, n_samples
                    associate (s => sign_of(value(k), max(zero*watched%largest, watched%noise)))
                        if (s /= 0) watched%rests = .false.
                        if (s /= 0) watched%sign_before = s
                        if (s == 0 .and. k == n_samples .and. is_last) watched%sign_before = -watched%sign_before
                    end associate
                end do
            end associate
        end do
    end subroutine pass

    !> End the step at events: determine which events occur there and their effects.
    subroutine settle(self, x, at_once, has_advanced, stopper, is_endless)
        class(event_watch_type), intent(inout) :: self
        !> Position of the cut; distance within which events are simultaneous.
        real(wp), intent(in) :: x, at_once
        !> True if the time has advanced since the last event.
        logical, intent(in) :: has_advanced
        !> Index of the event that stops the run, 0 if none.
        integer, intent(out) :: stopper
        !> True if too many events have followed each other at the same time.
        logical, intent(out) :: is_endless
        integer :: i, k

        stopper = 0
        self%n_at_once = merge(0, self%n_at_once + 1, has_advanced)
        is_endless = self%n_at_once > most_at_once
        if (is_endless) return
        do i = 1, self%n
            associate (watched => self%watched(i))
                ! A function that has remained zero up to the cut, such as that of a locked joint, still counts as having occurred.
                do k = 1, n_samples
                    if (sample_position(k) > x) exit
                    if (sign_of(self%samples(i, k), max(zero*watched%largest, watched%noise)) /= 0) watched%rests = .false.
                end do
            end associate
        end do
        do k = 1, self%found%n
            if (self%found%position(k) > x) exit
            if (self%found%position(k) < x - at_once) cycle
            associate (watched => self%watched(self%found%number(k)))
                watched%rests = .true.
                watched%direction = self%found%direction(k)
                watched%is_due = watched%event%changes
                watched%is_reversed = .false.
                if (watched%is_due) self%has_to_act = .true.
                if (watched%event%stops .and. stopper == 0) stopper = self%found%number(k)
            end associate
        end do
        do i = 1, self%n
            if (x < 1.0_wp) self%watched(i)%is_open = .false.
            ! Store the last sign before the cut, for events that do not occur there.
            do k = 1, n_samples
                if (sample_position(k) > x) exit
                associate (s => sign_of(self%samples(i, k), max(zero*self%watched(i)%largest, self%watched(i)%noise)))
                    if (s /= 0) self%watched(i)%sign_before = s
                end associate
            end do
        end do
    end subroutine settle

    !> Evaluate all functions at the current state, from which the motion continues.
    subroutine renew(self, curve, error)
        class(event_watch_type), intent(inout) :: self
        class(curve_type), intent(inout) :: curve
        type(error_type), allocatable, intent(out) :: error
        integer :: i

        self%lambda_is_current = .false.
        do i = 1, self%n
            associate (watched => self%watched(i))
                call self%evaluate(curve, i, watched%value, error)
                if (allocated(error)) return
                if (watched%rests) call self%measure_noise(curve, i, watched%noise)
                associate (s => sign_of(watched%value, max(zero*watched%largest, watched%noise)))
                    if (s /= 0) watched%sign_before = s
                end associate
            end associate
        end do
    end subroutine renew

    !> Evaluate g of one event at the current state.
    subroutine evaluate(self, curve, number, value, error)
        class(event_watch_type), intent(inout) :: self
        class(curve_type), intent(inout) :: curve
        integer, intent(in) :: number
        real(wp), intent(out) :: value
        type(error_type), allocatable, intent(out) :: error
        integer :: stat

        associate (event => self%watched(number)%event, state => curve%state)
            if (event%needs_multipliers .and. .not. self%lambda_is_current) then
                call curve%multipliers(self%lambda)
                self%lambda_is_current = .true.
            end if
            call self%evaluate_point(number, state%t, state%q, state%qd, value, stat)
            if (stat == 0 .and. ieee_is_finite(value)) return
            if (stat == 0) then
                call set_error(error, status_not_finite, 'the function of the event "'//trim(event%name)// &
                    '" gives a NaN or an infinity at t = '//to_text(state%t), 'check why it cannot be evaluated there')
            else
                call set_error(error, status_callback_failed, 'the function of the event "'//trim(event%name)// &
                    '" returned the status '//to_text(stat)//' at t = '//to_text(state%t), 'check why it cannot be evaluated there')
            end if
        end associate
    end subroutine evaluate

    !> Evaluate g of one event at a point, with the multipliers computed last.
    subroutine evaluate_point(self, number, t, q, qd, value, stat)
        class(event_watch_type), intent(inout) :: self
        integer, intent(in) :: number
        !> Time, coordinates and velocities (n).
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:)
        real(wp), intent(out) :: value
        !> Status of the event's function.
        integer, intent(out) :: stat

        call self%watched(number)%event%evaluate(t, q, qd, self%lambda, value, stat)
        self%evaluations = self%evaluations + 1
    end subroutine evaluate_point

    !> Measure the quantities of all events at a point by one call of the model, before the events are evaluated. If this fails,
    !> each event requests its own quantity.
    subroutine measure_all(self, t, q, qd)
        class(event_watch_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:)
        integer :: stat

        if (.not. self%measures) return
        call move_alloc(self%asked, self%model%state%asked)
        ! Accelerations are not used.
        call self%model%measure(t, q, qd, qd, self%shown, stat)
        call move_alloc(self%model%state%asked, self%asked)
        if (stat == 0) call move_alloc(self%shown, self%model%state%shown)
    end subroutine measure_all

    !> Discard the measured values, which are valid at one point only.
    subroutine end_measuring(self)
        class(event_watch_type), intent(inout) :: self

        if (.not. self%measures) return
        if (allocated(self%model%state%shown)) call move_alloc(self%model%state%shown, self%shown)
    end subroutine end_measuring

    !> Change of g due to rounding errors of time, state and multipliers. Integration and constraint corrections cause errors of
    !> several units in the last place of coordinates or of their scales. Errors with one pattern of signs may cancel in g, such as
    !> a common factor of Euler parameters in angles; two different patterns rarely do.
    subroutine measure_noise(self, curve, number, noise)
        class(event_watch_type), intent(inout) :: self
        class(curve_type), intent(inout) :: curve
        integer, intent(in) :: number
        real(wp), intent(out) :: noise
        real(wp), parameter :: eps = 40*epsilon(1.0_wp)
        integer, parameter :: runs_of_signs(2) = [1, 2]
        real(wp), dimension(size(curve%state%q)) :: change, scale
        real(wp) :: value, moved
        integer :: stat, i, k

        noise = 0.0_wp
        associate (event => self%watched(number)%event, state => curve%state)
            scale = self%model%scales()
            call event%evaluate(state%t, state%q, state%qd, self%lambda, value, stat)
            self%evaluations = self%evaluations + 1
            if (stat /= 0) return
            do k = 1, size(runs_of_signs)
                change = [(merge(-eps, eps, mod(i/runs_of_signs(k), 2) == 0), i=1, size(change))]
                call event%evaluate(state%t*(1.0_wp + eps), state%q + change*max(abs(state%q), scale), &
                    state%qd + change*max(abs(state%qd), scale/self%model%time_scale), (1.0_wp + eps)*self%lambda, moved, stat)
                self%evaluations = self%evaluations + 1
                if (stat == 0 .and. ieee_is_finite(moved - value)) noise = max(noise, abs(moved - value))
            end do
        end associate
    end subroutine measure_noise

    !> Before actions: measure how the functions of due events would change without them.
    subroutine prepare_actions(self, curve)
        class(event_watch_type), intent(inout) :: self
        class(curve_type), intent(in) :: curve
        real(wp) :: expected_change
        integer :: i

        do i = 1, self%n
            if (.not. self%watched(i)%is_due) cycle
            call measure_rate(self, curve, i, expected_change)
            self%watched(i)%expected_change = expected_change
            self%watched(i)%value_before = self%watched(i)%value
        end do
    end subroutine prepare_actions

    !> Perform the actions that are due, in the order of the events' indices.
    subroutine act(self, model, state, error)
        class(event_watch_type), intent(inout) :: self
        class(model_type), intent(inout) :: model
        type(state_type), intent(inout) :: state
        type(error_type), allocatable, intent(out) :: error
        integer :: i

        self%has_to_act = .false.
        do i = 1, self%n
            associate (watched => self%watched(i))
                if (.not. watched%is_due) cycle
                watched%is_due = .false.
                watched%is_reversed = watched%expected_change*watched%direction > 0.0_wp
                call watched%event%act(model, state%t, state%q, state%qd, error)
            end associate
            if (allocated(error)) return
        end do
    end subroutine act

    !> After actions: check whether they have reversed the motion of g at this zero. A g that an action keeps constant, as a lock
    !> does, may continue in either direction once it is released.
    subroutine check_actions(self, curve)
        class(event_watch_type), intent(inout) :: self
        class(curve_type), intent(inout) :: curve
        real(wp) :: change_after
        integer :: i

        do i = 1, self%n
            if (.not. self%watched(i)%is_reversed) cycle
            call measure_rate(self, curve, i, change_after)
            associate (watched => self%watched(i))
                watched%is_reversed = change_after*watched%direction <= 0.0_wp .and. &
                    abs(watched%value) <= max(1.0e-9_wp*abs(watched%expected_change), 4*abs(watched%value_before))
                if (watched%is_reversed) watched%is_reversed = .not. is_held(self, curve, i)
                watched%expected_change = abs(watched%expected_change)
                watched%check_until = curve%state%t + (curve%t_to - curve%t_from)
            end associate
        end do
    end subroutine check_actions

    !> True if neither the velocity nor the acceleration at the current state changes g.
    logical function is_held(self, curve, number)
        class(event_watch_type), intent(inout) :: self
        class(curve_type), intent(inout) :: curve
        integer, intent(in) :: number
        real(wp) :: h, value, value_ahead, noise
        integer :: stat

        is_held = .false.
        ! Multipliers at later times are unknown.
        if (self%watched(number)%event%needs_multipliers) return
        call self%measure_noise(curve, number, noise)
        associate (event => self%watched(number)%event, state => curve%state)
            ! A shorter time would not show the effect of accelerations.
            h = part*max(curve%t_to - curve%t_from, part*self%model%time_scale)
            call event%evaluate(state%t, state%q, state%qd, self%lambda, value, stat)
            if (stat /= 0) return
            call event%evaluate(state%t + h, state%q + h*(state%qd + 0.5_wp*h*state%qdd), state%qd + h*state%qdd, self%lambda, &
                value_ahead, stat)
            self%evaluations = self%evaluations + 2
            if (stat == 0) is_held = abs(value_ahead - value) <= noise
        end associate
    end function is_held

    !> Change of g over a step as long as the last one, extrapolated from a difference along the motion with constant multipliers.
    subroutine measure_rate(self, curve, number, expected_change)
        class(event_watch_type), intent(inout) :: self
        class(curve_type), intent(in) :: curve
        integer, intent(in) :: number
        real(wp), intent(out) :: expected_change
        real(wp) :: h, value, value_ahead
        integer :: stat

        associate (event => self%watched(number)%event, state => curve%state)
            expected_change = 0.0_wp
            h = part*(curve%t_to - curve%t_from)
            call event%evaluate(state%t, state%q, state%qd, self%lambda, value, stat)
            if (stat /= 0) return
            call event%evaluate(state%t + h, state%q + h*state%qd, state%qd + h*state%qdd, self%lambda, value_ahead, stat)
            self%evaluations = self%evaluations + 2
            if (stat == 0 .and. ieee_is_finite(value_ahead - value)) expected_change = (value_ahead - value)/part
        end associate
    end subroutine measure_rate

    !> Pack the state between steps.
    subroutine pack_state(self, pack)
        class(event_watch_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack
        integer :: i

        call pack%item(self%values_are_stale)
        call pack%item(self%n_at_once)
        call pack%item(self%lambda)
        call pack%item(self%lambda_is_current)
        call pack%item(self%evaluations)
        do i = 1, self%n
            associate (watched => self%watched(i))
                call watched%event%pack_state(pack)
                call pack%item(watched%value, watched%peak)
                call pack%item(watched%sign_before)
                call pack%item(watched%is_open, watched%rests)
                call pack%item(watched%direction)
                call pack%item(watched%noise)
                call pack%item(watched%is_reversed)
                call pack%item(watched%check_until, watched%expected_change)
            end associate
        end do
    end subroutine pack_state
end module tandem_simulate_event_watch
