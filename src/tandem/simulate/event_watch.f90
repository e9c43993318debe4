! SPDX-License-Identifier: MIT
!> The watched events of a run: their functions are followed from step to step, their zeros located within a step, and their actions
!> checked. The caller provides the motion within the step as a curve: this module is independent of the integration.
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

    !> Positions of the samples within the step. Those near the ends separate an extremum at an end from one before or behind it.
    integer, parameter :: n_samples = 7
    real(wp), parameter :: aside = 1.0_wp/256
    !> Quarters of the step, and its ends.
    integer, parameter :: n_rough = 5
    real(wp), parameter :: place(n_samples) = [0.0_wp, aside, 0.25_wp, 0.5_wp, 0.75_wp, 1.0_wp - aside, 1.0_wp]
    !> Zeros are located to this part of the step; events closer than twice that are simultaneous.
    real(wp), parameter :: resolution = 1.0e-13_wp
    !> Below this part of the largest |g| in the step a sample is zero.
    real(wp), parameter :: zero = 1.0e-13_wp
    !> A g that stays below this part of its largest modulus so far may be zero up to rounding, such as the rate of a locked joint.
    real(wp), parameter :: faint = 1.0e-9_wp
    !> Most zeros of one event in a step: a crossing between all samples, and two at every other extremum.
    integer, parameter :: most_zeros = 2*n_samples
    !> Largest number of successive events without an advance of time.
    integer, parameter :: most_at_once = 100
    !> Rates of g at an event are measured over this part of a step.
    real(wp), parameter :: part = 1.0e-3_wp

    !> The motion within a step, and its current position.
    type, abstract :: curve_type
        !> Start and end of the step (s).
        real(wp) :: t_from = 0.0_wp, t_to = 0.0_wp
        !> The state at the current position.
        type(state_type), pointer :: state => null()
    contains
        procedure(go_to_interface), deferred :: go_to
        procedure(pass_through_interface), deferred :: pass_through
        procedure(multipliers_interface), deferred :: multipliers
    end type curve_type

    !> An event and the state of its search.
    type :: watched_type
        class(event_type), pointer :: event => null()
        !> g at the current state, its last sign before that (0: none yet), and the largest |g| of the last step and of all steps.
        real(wp) :: value = 0.0_wp, largest = 0.0_wp, peak = 0.0_wp
        integer :: sign_before = 0
        !> True if a zero at the current state is undecided: at the start of the run, or at the end of the last step.
        logical :: is_open = .true.
        !> True if it has happened at the current state, so that its zero there does not count again; its direction.
        logical :: rests = .false.
        integer :: direction = 0
        !> While it rests or is faint: a smaller |g| is rounding.
        real(wp) :: noise = 0.0_wp
        !> True if its action is due; true if the last action has reversed g, which must show until the given time; the change of g
        !> without the action, and g before it.
        logical :: is_due = .false., is_sent_back = .false.
        real(wp) :: judged_until = 0.0_wp, reach = 0.0_wp, value_before = 0.0_wp
    contains
        procedure :: is_faint
    end type watched_type

    !> Events, and the state of the search for their zeros between steps.
    type :: event_watch_type
        !> Number of events.
        integer :: n = 0
        !> True if an action is due at the current state.
        logical :: has_to_act = .false.
        !> Evaluations of their functions so far.
        integer(long) :: evaluations = 0
        !> The zeros found by the last search.
        type(zeros_type) :: found
        type(watched_type), allocatable, private :: watched(:)
        !> State before the last search.
        type(watched_type), allocatable, private :: watched_before(:)
        logical, private :: were_stale = .true.
        !> The model, for the scales of its coordinates.
        class(model_type), pointer, private :: model => null()
        real(wp), allocatable, private :: lambda(:)
        !> g of each event at the samples of a step, and soon after an event; at quarters of it without restored constraints.
        real(wp), allocatable, private :: samples(:, :), rough(:, :)
        !> Coordinates and velocities (n) for `rough`.
        real(wp), allocatable, private :: near_q(:), near_qd(:)
        !> The quantities of the model that events watch without multipliers, and their values; true if there are any.
        logical, allocatable, private :: asked(:)
        real(wp), allocatable, private :: shown(:)
        logical, private :: measures = .false.
        logical, private :: lambda_is_current = .false., values_are_stale = .true.
        !> Number of successive events without an advance of time.
        integer, private :: n_at_once = 0
    contains
        procedure :: add, name, forget_values, rule_out, search, forget_search, find_cut, pass, settle, renew, prepare_actions, act
        procedure :: judge_actions, pack_state
        procedure, private :: evaluate, evaluate_point, measure_all, end_measuring, measure_noise
    end type event_watch_type

    abstract interface
        !> Set `state` for a position within the step.
        subroutine go_to_interface(self, x, error)
            import :: curve_type, error_type, wp
            implicit none (type, external)
            class(curve_type), intent(inout) :: self
            !> 0 at the start of the step, 1 at its end.
            real(wp), intent(in) :: x
            type(error_type), allocatable, intent(out) :: error
        end subroutine go_to_interface

        !> Coordinates and velocities near those of a position within the step, beside the constraints; `state` is unchanged.
        subroutine pass_through_interface(self, x, t, q, qd)
            import :: curve_type, wp
            implicit none (type, external)
            class(curve_type), intent(in) :: self
            !> 0 at the start of the step, 1 at its end: there they equal the states.
            real(wp), intent(in) :: x
            !> (n) each.
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
        !> Decide if one of the events may happen in the step that was just accepted. If none can, advance all of them to the next
        !> step.
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
            !> True if no step may follow: a zero at the end counts now.
            logical, intent(in) :: is_last
            type(error_type), allocatable, intent(out) :: error
        end subroutine search
    end interface

contains

    !> Watch an event from the current state on; it must outlive this.
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

    !> Measure the quantities of all events at a point by one call of the model.
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

    !> True if values up to this modulus may be rounding.
    pure logical function is_faint(self, largest)
        class(watched_type), intent(in) :: self
        real(wp), intent(in) :: largest

        is_faint = largest <= max(faint*self%peak, self%noise)
    end function is_faint

    !> Discard the step of the last search.
    pure subroutine forget_search(self)
        class(event_watch_type), intent(inout) :: self

        self%watched(:) = self%watched_before
        self%values_are_stale = self%were_stale
    end subroutine forget_search

    !> The name of an event.
    pure function name(self, number)
        class(event_watch_type), intent(in) :: self
        integer, intent(in) :: number
        character(len=label_length) :: name

        name = self%watched(number)%event%name
    end function name

    !> The motion continues from another state than that of the last step's end.
    pure subroutine forget_values(self)
        class(event_watch_type), intent(inout) :: self

        self%values_are_stale = .true.
    end subroutine forget_values

    !> Position at which the first event that stops the run or changes the motion cuts the step, and the interval of simultaneous
    !> events: all of them have passed their zeros at the cut.
    pure subroutine find_cut(self, curve, cut_at, at_once)
        class(event_watch_type), intent(in) :: self
        class(curve_type), intent(in) :: curve
        !> Position of the cut, beyond the step if there is none; zeros within this distance are simultaneous.
        real(wp), intent(out) :: cut_at, at_once
        integer :: k

        at_once = max(2*resolution, 4*spacing(abs(curve%t_to))/(curve%t_to - curve%t_from))
        cut_at = 2.0_wp
        associate (zeros => self%found)
            do k = 1, zeros%n
                associate (event => self%watched(zeros%number(k))%event)
                    if (.not. (event%stops .or. event%changes)) cycle
                end associate
                cut_at = maxval(zeros%place(k:zeros%n), zeros%place(k:zeros%n) <= zeros%place(k) + at_once)
                return
            end do
        end associate
    end subroutine find_cut

    !> Advance all events to the next step from the end of one that was searched and not cut.
    subroutine pass(self, is_last)
        class(event_watch_type), intent(inout) :: self
        !> True if a zero at the end has counted, as a crossing.
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

    !> End the step at events: determine their effects, and the initial values of all functions.
    subroutine settle(self, x, at_once, has_advanced, stopper, is_endless)
        class(event_watch_type), intent(inout) :: self
        !> Position of the cut; zeros within this distance are simultaneous.
        real(wp), intent(in) :: x, at_once
        !> True if the time has advanced until there.
        logical, intent(in) :: has_advanced
        !> The event that stops the run, 0 for none.
        integer, intent(out) :: stopper
        !> True if too many events have followed each other without an advance of time.
        logical, intent(out) :: is_endless
        integer :: i, k

        stopper = 0
        self%n_at_once = merge(0, self%n_at_once + 1, has_advanced)
        is_endless = self%n_at_once > most_at_once
        if (is_endless) return
        do i = 1, self%n
            associate (watched => self%watched(i))
                ! A function that has stayed at its zero until there continues to rest, such as that of a locked joint.
                do k = 1, n_samples
                    if (place(k) > x) exit
                    if (sign_of(self%samples(i, k), max(zero*watched%largest, watched%noise)) /= 0) watched%rests = .false.
                end do
            end associate
        end do
        do k = 1, self%found%n
            if (self%found%place(k) > x) exit
            if (self%found%place(k) < x - at_once) cycle
            associate (watched => self%watched(self%found%number(k)))
                watched%rests = .true.
                watched%direction = self%found%direction(k)
                watched%is_due = watched%event%changes
                watched%is_sent_back = .false.
                if (watched%is_due) self%has_to_act = .true.
                if (watched%event%stops .and. stopper == 0) stopper = self%found%number(k)
            end associate
        end do
        do i = 1, self%n
            if (x < 1.0_wp) self%watched(i)%is_open = .false.
            ! The sign before the cut, for events that do not happen there.
            do k = 1, n_samples
                if (place(k) > x) exit
                associate (s => sign_of(self%samples(i, k), max(zero*self%watched(i)%largest, self%watched(i)%noise)))
                    if (s /= 0) self%watched(i)%sign_before = s
                end associate
            end do
        end do
    end subroutine settle

    !> The values of all functions at the current state, from which the motion goes on.
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

    !> g of one event at the current state.
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

    !> g of one event at a point, with the last computed multipliers.
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

    !> Before all events are evaluated at a point: measure their quantities in one call of the model. If that fails, each event
    !> requests its own quantity.
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

    !> Drop the measured values, which belong to one point.
    subroutine end_measuring(self)
        class(event_watch_type), intent(inout) :: self

        if (.not. self%measures) return
        if (allocated(self%model%state%shown)) call move_alloc(self%model%state%shown, self%shown)
    end subroutine end_measuring

    !> Change of g due to rounding of time, state and multipliers. Integration and corrections leave errors of some last digits,
    !> relative to coordinates or to their scales if these are larger. One pattern of signs may cancel in g, as a common factor of
    !> Euler parameters does in angles; two patterns hardly do.
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

    !> Before actions: compute the change of the functions of due events without them.
    subroutine prepare_actions(self, curve)
        class(event_watch_type), intent(inout) :: self
        class(curve_type), intent(in) :: curve
        real(wp) :: reach
        integer :: i

        do i = 1, self%n
            if (.not. self%watched(i)%is_due) cycle
            call measure_rate(self, curve, i, reach)
            self%watched(i)%reach = reach
            self%watched(i)%value_before = self%watched(i)%value
        end do
    end subroutine prepare_actions

    !> Take the actions that are due, in the order of the events' numbers.
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
                watched%is_sent_back = watched%reach*watched%direction > 0.0_wp
                call watched%event%act(model, state%t, state%q, state%qd, error)
            end associate
            if (allocated(error)) return
        end do
    end subroutine act

    !> After actions: check whether they have reversed g at this zero. A g that they hold there, as locks do, may continue either
    !> way when it is released.
    subroutine judge_actions(self, curve)
        class(event_watch_type), intent(inout) :: self
        class(curve_type), intent(inout) :: curve
        real(wp) :: reach_after
        integer :: i

        do i = 1, self%n
            if (.not. self%watched(i)%is_sent_back) cycle
            call measure_rate(self, curve, i, reach_after)
            associate (watched => self%watched(i))
                watched%is_sent_back = reach_after*watched%direction <= 0.0_wp .and. &
                    abs(watched%value) <= max(1.0e-9_wp*abs(watched%reach), 4*abs(watched%value_before))
                if (watched%is_sent_back) watched%is_sent_back = .not. is_held(self, curve, i)
                watched%reach = abs(watched%reach)
                watched%judged_until = curve%state%t + (curve%t_to - curve%t_from)
            end associate
        end do
    end subroutine judge_actions

    !> True if neither the velocity nor the acceleration of the current state moves g.
    logical function is_held(self, curve, number)
        class(event_watch_type), intent(inout) :: self
        class(curve_type), intent(inout) :: curve
        integer, intent(in) :: number
        real(wp) :: h, value, value_ahead, noise
        integer :: stat

        is_held = .false.
        ! Multipliers ahead are not known.
        if (self%watched(number)%event%needs_multipliers) return
        call self%measure_noise(curve, number, noise)
        associate (event => self%watched(number)%event, state => curve%state)
            ! A shorter time would not show accelerations.
            h = part*max(curve%t_to - curve%t_from, part*self%model%time_scale)
            call event%evaluate(state%t, state%q, state%qd, self%lambda, value, stat)
            if (stat /= 0) return
            call event%evaluate(state%t + h, state%q + h*(state%qd + 0.5_wp*h*state%qdd), state%qd + h*state%qdd, self%lambda, &
                value_ahead, stat)
            self%evaluations = self%evaluations + 2
            if (stat == 0) is_held = abs(value_ahead - value) <= noise
        end associate
    end function is_held

    !> Change of g in a step as long as the last: a difference along the motion, with constant multipliers.
    subroutine measure_rate(self, curve, number, reach)
        class(event_watch_type), intent(inout) :: self
        class(curve_type), intent(in) :: curve
        integer, intent(in) :: number
        real(wp), intent(out) :: reach
        real(wp) :: h, value, value_ahead
        integer :: stat

        associate (event => self%watched(number)%event, state => curve%state)
            reach = 0.0_wp
            h = part*(curve%t_to - curve%t_from)
            call event%evaluate(state%t, state%q, state%qd, self%lambda, value, stat)
            if (stat /= 0) return
            call event%evaluate(state%t + h, state%q + h*state%qd, state%qd + h*state%qdd, self%lambda, value_ahead, stat)
            self%evaluations = self%evaluations + 2
            if (stat == 0 .and. ieee_is_finite(value_ahead - value)) reach = (value_ahead - value)/part
        end associate
    end subroutine measure_rate

    !> State between steps.
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
                call pack%item(watched%is_sent_back)
                call pack%item(watched%judged_until, watched%reach)
            end associate
        end do
    end subroutine pack_state
end module tandem_simulate_event_watch
