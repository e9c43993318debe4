! SPDX-License-Identifier: MIT
!> The events of a step: searched on its dense output, recorded in the order of their times, acted upon.
!>
!> Every g is sampled at a few places of the step. A sign change is narrowed to 1e-13 of the step. Where the samples come near zero
!> and turn back, the extremum is searched: it may hide two sign changes, or a touch. A g that leaves and returns within a quarter
!> of a step, not seen by the parabola through the samples, is missed; `max_step` bounds that.
submodule(tandem_simulation) tandem_simulate_eventing
    use tandem_simulate_root, only: bracket_type, extremum_type, vertex
    use tandem_status, only: status_event_limit
    implicit none (type, external)

    !> Places of the samples within the step. The second shows in which direction a zero at the start is left.
    integer, parameter :: n_samples = 6
    real(wp), parameter :: place(n_samples) = [0.0_wp, 1.0_wp/256, 0.25_wp, 0.5_wp, 0.75_wp, 1.0_wp]
    !> Zeros are located to this part of the step; events closer than twice that are at once.
    real(wp), parameter :: resolution = 1.0e-13_wp
    !> A value below this part of the largest one in the step is zero at a step's end.
    real(wp), parameter :: zero = 1.0e-13_wp
    !> Most zeros of one event in a step: a crossing between all samples, or two at an extremum.
    integer, parameter :: most_zeros = 2*n_samples
    !> Events without an advance of time, one after the other, before they count as endless.
    integer, parameter :: most_at_once = 100

    !> Zeros found in a step, ascending.
    type :: zeros_type
        integer :: n = 0
        real(wp), allocatable :: place(:)
        integer, allocatable :: number(:), direction(:)
    end type zeros_type

contains

    !> Watch an event from the current state on.
    module subroutine add_event(self, event)
        class(simulation_type), intent(inout) :: self
        class(event_type), intent(inout), target :: event
        type(watched_type), allocatable :: longer(:)
        integer :: n

        n = 0
        if (allocated(self%watched)) n = size(self%watched)
        allocate (longer(n + 1))
        if (n > 0) longer(:n) = self%watched
        longer(n + 1)%event => event
        call move_alloc(longer, self%watched)
        if (.not. allocated(self%events)) allocate (self%events(0))
        if (.not. allocated(self%lambda)) allocate (self%lambda(self%model%n_constraints()), source=0.0_wp)
    end subroutine add_event

    !> Look for events in the step that was just accepted, from self%start to self%state, record them, act, and cut the step at the
    !> first that stops the run or changes the motion.
    module subroutine look_for_events(self, is_cut, error)
        class(simulation_type), intent(inout) :: self
        logical, intent(out) :: is_cut
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: value(n_samples, size(self%watched)), cut_at
        type(zeros_type) :: zeros
        integer :: i, k

        is_cut = .false.
        do k = 1, n_samples
            if (k == 1 .and. .not. self%values_are_stale) then
                value(1, :) = [(self%watched(i)%value, i=1, size(self%watched))]
                cycle
            end if
            call sample(self, place(k), value(k, :), error)
            if (allocated(error)) return
        end do
        self%values_are_stale = .false.
        allocate (zeros%place(most_zeros*size(self%watched)), source=0.0_wp)
        allocate (zeros%number(size(zeros%place)), zeros%direction(size(zeros%place)), source=0)
        do i = 1, size(self%watched)
            call find_zeros(self, i, value(:, i), zeros, error)
            if (allocated(error)) return
        end do
        ! The first that cuts the step.
        cut_at = 2.0_wp
        do k = 1, zeros%n
            associate (event => self%watched(zeros%number(k))%event)
                if (.not. (event%stops .or. event%changes)) cycle
                cut_at = zeros%place(k)
                exit
            end associate
        end do
        do k = 1, zeros%n
            if (zeros%place(k) > cut_at + 2*resolution) exit
            call record(self, zeros%number(k), zeros%direction(k), zeros%place(k), error)
            if (allocated(error)) return
        end do
        is_cut = cut_at <= 1.0_wp
        if (.not. is_cut) then
            do i = 1, size(self%watched)
                call self%watched(i)%pass(value(:, i))
            end do
            call self%look_back()
            return
        end if
        call cut_step(self, zeros, cut_at, error)
    end subroutine look_for_events

    !> The values of all events at a place of the step.
    subroutine sample(self, x, value, error)
        class(simulation_type), intent(inout) :: self
        !> 0 at the start of the step, 1 at its end.
        real(wp), intent(in) :: x
        real(wp), intent(out) :: value(:)
        type(error_type), allocatable, intent(out) :: error
        integer :: i

        value = 0.0_wp
        call go_to(self, x, error)
        do i = 1, size(self%watched)
            if (allocated(error)) return
            call evaluate(self, i, value(i), error)
        end do
    end subroutine sample

    !> Make the state that of a place of the step.
    subroutine go_to(self, x, error)
        class(simulation_type), intent(inout) :: self
        real(wp), intent(in) :: x
        type(error_type), allocatable, intent(out) :: error

        if (x >= 1.0_wp) then
            call self%look_back()
        else
            call self%look_at(self%start%t + x*(self%next%t - self%start%t), error)
        end if
        self%lambda_is_current = .false.
    end subroutine go_to

    !> g of one event at the current state.
    subroutine evaluate(self, number, value, error)
        class(simulation_type), intent(inout) :: self
        integer, intent(in) :: number
        real(wp), intent(out) :: value
        type(error_type), allocatable, intent(out) :: error
        integer :: stat

        associate (event => self%watched(number)%event, state => self%state)
            if (event%needs_multipliers .and. .not. self%lambda_is_current) then
                call self%multipliers(self%lambda)
                self%lambda_is_current = .true.
            end if
            call event%evaluate(state%t, state%q, state%qd, self%lambda, value, stat)
            self%tally%event_evaluations = self%tally%event_evaluations + 1
            if (stat == 0 .and. ieee_is_finite(value)) return
            call set_error(error, merge(status_not_finite, status_callback_failed, stat == 0), 'the function of the event "'// &
                trim(event%name)//'" at t = '//to_text(state%t), 'see why it cannot be evaluated there')
        end associate
    end subroutine evaluate

    !> g of one event at a place of the step.
    subroutine evaluate_at(self, number, x, value, error)
        class(simulation_type), intent(inout) :: self
        integer, intent(in) :: number
        real(wp), intent(in) :: x
        real(wp), intent(out) :: value
        type(error_type), allocatable, intent(out) :: error

        value = 0.0_wp
        call go_to(self, x, error)
        if (.not. allocated(error)) call evaluate(self, number, value, error)
    end subroutine evaluate_at

    !> The zeros of one event in the step, added to those found.
    subroutine find_zeros(self, number, value, zeros, error)
        class(simulation_type), intent(inout) :: self
        integer, intent(in) :: number
        !> g at the samples.
        real(wp), intent(in) :: value(:)
        type(zeros_type), intent(inout) :: zeros
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: largest, x, extreme
        integer :: s(n_samples), first, k

        largest = maxval(abs(value))
        if (.not. largest > 0.0_wp) return
        do k = 1, n_samples
            s(k) = merge(0, merge(1, -1, value(k) > 0.0_wp), abs(value(k)) <= zero*largest)
        end do
        associate (watched => self%watched(number))
            first = 1
            if (watched%rests .or. s(1) == 0) first = 2
            ! A zero at the start of the step, that was not acted upon yet: the start of the run, or the end of the last step.
            if (s(1) == 0 .and. .not. watched%rests) then
                if (watched%sign_before == 0) then
                    if (watched%event%direction == 0 .or. watched%event%direction == s(2)) call add(zeros, number, 0.0_wp, 0)
                else
                    call add_if_wanted(0.0_wp, merge(s(2), 0, s(2) /= watched%sign_before))
                end if
            end if
        end associate
        do k = first, n_samples - 1
            if (s(k)*s(k + 1) < 0) call locate(place(k), value(k), place(k + 1), value(k + 1))
            if (allocated(error)) return
        end do
        ! Exactly at a sample: a crossing or a touch, as its neighbours say; a zero at the end is left to the next step.
        do k = first + 1, n_samples - 1
            if (s(k) == 0) call add_if_wanted(place(k), merge(s(k + 1), 0, s(k + 1) /= s(k - 1)))
        end do
        ! Extrema that come near zero: around a sample that is smaller than its neighbours, and between the outermost ones.
        do k = first, n_samples
            associate (i => min(max(k - 1, first), n_samples - 2))
                if (any(s(i:i + 2) /= s(i)) .or. s(i) == 0) cycle
                if (abs(value(k)) > minval(abs(value(i:i + 2)))) cycle
                call vertex(place(i:i + 2), value(i:i + 2), x, extreme)
                if (extreme*s(i) > 0.25_wp*maxval(abs(value(i:i + 2)))) cycle
                if (k == first .and. x >= place(first + 1)) cycle
                if (k == n_samples .and. x <= place(n_samples - 1)) cycle
                call search_extremum(place(max(k - 1, first)), place(min(k + 1, n_samples)), value(max(k - 1, first)), &
                    value(min(k + 1, n_samples)), x)
                if (allocated(error)) return
            end associate
        end do

    contains

        !> Narrow a sign change.
        subroutine locate(a, value_a, b, value_b)
            real(wp), intent(in) :: a, value_a, b, value_b
            !> More than bisection alone takes, and its safeguards.
            integer, parameter :: most_points = 150
            type(bracket_type) :: bracket
            real(wp) :: point, value_there
            integer :: j

            bracket = bracket_type(a, b, value_a, value_b)
            do j = 1, most_points
                if (bracket%b - bracket%a <= resolution) exit
                point = bracket%next_point()
                if (point <= bracket%a .or. point >= bracket%b) exit
                call evaluate_at(self, number, point, value_there, error)
                if (allocated(error)) return
                call bracket%narrow(point, value_there)
            end do
            ! Behind the zero, so that the motion goes on from where the sign has changed.
            call add_if_wanted(bracket%b, merge(1, -1, value_b > 0.0_wp))
        end subroutine locate

        !> Find out what an extremum near zero is.
        subroutine search_extremum(a, b, value_a, value_b, start)
            real(wp), intent(in) :: a, b, value_a, value_b, start
            !> Golden sections to the square root of rounding.
            integer, parameter :: most_points = 45
            type(extremum_type) :: extremum
            real(wp) :: point, value_there
            integer :: j

            extremum = extremum_type(a, b, start, 0.0_wp)
            if (.not. (start > a .and. start < b)) return
            call evaluate_at(self, number, start, extremum%value_c, error)
            if (allocated(error)) return
            value_there = extremum%value_c
            do j = 1, most_points
                if (value_there*value_a < 0.0_wp .and. abs(value_there) > self%watched(number)%touch*largest) then
                    call locate(a, value_a, extremum%c, value_there)
                    if (.not. allocated(error)) call locate(extremum%c, value_there, b, value_b)
                    return
                end if
                if (extremum%b - extremum%a <= 1.0e-9_wp) exit
                point = extremum%next_point()
                call evaluate_at(self, number, point, value_there, error)
                if (allocated(error)) return
                ! A sign change ends the search by the deepest point that it has.
                if (value_there*value_a < 0.0_wp) then
                    if (value_there*extremum%value_c > 0.0_wp .and. abs(value_there) < abs(extremum%value_c)) then
                        value_there = extremum%value_c
                        exit
                    end if
                    extremum%c = point
                    extremum%value_c = value_there
                    cycle
                end if
                call extremum%narrow(point, value_there)
                value_there = extremum%value_c
            end do
            if (abs(extremum%value_c) <= self%watched(number)%touch*largest) call add_if_wanted(extremum%c, 0)
        end subroutine search_extremum

        !> Add a zero where the event asks for its direction.
        subroutine add_if_wanted(x, direction)
            real(wp), intent(in) :: x
            integer, intent(in) :: direction

            associate (wanted => self%watched(number)%event%direction)
                if (wanted == 0 .or. wanted == direction) call add(zeros, number, x, direction)
            end associate
        end subroutine add_if_wanted
    end subroutine find_zeros

    !> Add a zero at its place in the order of times.
    pure subroutine add(zeros, number, x, direction)
        type(zeros_type), intent(inout) :: zeros
        integer, intent(in) :: number, direction
        real(wp), intent(in) :: x
        integer :: k

        if (zeros%n == size(zeros%place)) return
        k = zeros%n
        do while (k > 0)
            if (zeros%place(k) <= x) exit
            zeros%place(k + 1) = zeros%place(k)
            zeros%number(k + 1) = zeros%number(k)
            zeros%direction(k + 1) = zeros%direction(k)
            k = k - 1
        end do
        zeros%place(k + 1) = x
        zeros%number(k + 1) = number
        zeros%direction(k + 1) = direction
        zeros%n = zeros%n + 1
    end subroutine add

    !> Keep what has happened.
    subroutine record(self, number, direction, x, error)
        class(simulation_type), intent(inout) :: self
        integer, intent(in) :: number, direction
        real(wp), intent(in) :: x
        type(error_type), allocatable, intent(out) :: error
        type(event_record_type), allocatable :: longer(:)

        if (self%n_events >= self%options%max_events) then
            call set_error(error, status_event_limit, to_text(self%n_events)//' events until t = '//to_text(self%start%t))
            return
        end if
        call go_to(self, x, error)
        if (allocated(error)) return
        if (self%n_events == size(self%events)) then
            allocate (longer(max(16, 2*self%n_events)))
            longer(:self%n_events) = self%events
            call move_alloc(longer, self%events)
        end if
        self%n_events = self%n_events + 1
        associate (event => self%watched(number)%event, state => self%state)
            self%events(self%n_events) = event_record_type(number, event%name, direction, state%t, state%q, state%qd)
        end associate
    end subroutine record

    !> End the step at an event, act, and make the motion ready to go on from there.
    subroutine cut_step(self, zeros, x, error)
        class(simulation_type), intent(inout) :: self
        type(zeros_type), intent(in) :: zeros
        real(wp), intent(in) :: x
        type(error_type), allocatable, intent(out) :: error
        logical :: changes
        integer :: i, k

        if (x > 0.0_wp) then
            call go_to(self, x, error)
            if (allocated(error)) return
        else
            call self%look_back()
            self%state = self%start
        end if
        if (self%is_looking) then
            ! The state between the ends stays; what the chart keeps is that of the whole step until the next begins.
            self%is_looking = .false.
            call self%chart%release()
        end if
        self%last_step = self%state%t - self%start%t
        self%n_at_once = merge(self%n_at_once + 1, 0, self%last_step <= 4*spacing(abs(self%state%t)))
        if (self%n_at_once > most_at_once) then
            call set_error(error, status_event_limit, 'at t = '//to_text(self%state%t))
            return
        end if
        changes = .false.
        do k = 1, zeros%n
            if (zeros%place(k) > x + 2*resolution) exit
            if (zeros%place(k) < x - 2*resolution) cycle
            associate (watched => self%watched(zeros%number(k)))
                watched%rests = .true.
                if (watched%event%stops) then
                    self%is_stopped = .true.
                    self%stopped_by = watched%event%name
                end if
                if (.not. watched%event%changes) cycle
                changes = .true.
                call watched%event%act(self%model, self%state%t, self%state%q, self%state%qd, error)
                if (allocated(error)) return
            end associate
        end do
        self%renewal = by_event
        if (changes) call restart_here(self, error)
        if (allocated(error)) return
        self%lambda_is_current = .false.
        do i = 1, size(self%watched)
            call evaluate(self, i, self%watched(i)%value, error)
            if (allocated(error)) return
            associate (watched => self%watched(i))
                if (watched%value > 0.0_wp) watched%sign_before = 1
                if (watched%value < 0.0_wp) watched%sign_before = -1
            end associate
        end do
    end subroutine cut_step

    !> After an action: the position must be on the constraints, the velocity is brought there, the acceleration is made anew.
    subroutine restart_here(self, error)
        class(simulation_type), intent(inout) :: self
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: wanted(self%model%n), errors(3)
        integer :: rows(3), stat

        associate (state => self%state, chart => self%chart)
            wanted = state%qd
            call self%control%restart()
            call chart%forget()
            call chart%solve_dynamics(state%t, state%q, state%qd, state%qdd, stat)
            if (stat == status_ok) call chart%constraint_errors(state%t, state%q, state%qd, state%qdd, errors, rows, stat)
            if (stat == status_ok .and. errors(1) > self%options%constraint_tolerance) then
                call set_error(error, status_inconsistent_start, 'an event at t = '//to_text(state%t)// &
                    ' has moved the position off the constraint "'//self%model%row_name(rows(1))//'" by '//to_text(errors(1))// &
                    ' of its natural scale', 'let its action leave the position on the constraints')
                return
            end if
            if (stat == status_ok .and. errors(2) > 0.01_wp*self%options%constraint_tolerance) then
                call chart%project_velocity(state%t, state%q, state%qd, stat)
                if (stat == status_ok) call chart%solve_dynamics(state%t, state%q, state%qd, state%qdd, stat)
                self%tally%velocity_jump = max(self%tally%velocity_jump, maxval(abs(state%qd - wanted)))
            end if
            if (stat /= status_ok) then
                call self%fail(stat, 'after the event at t = '//to_text(state%t), error)
                return
            end if
        end associate
        call self%measure_errors(error)
    end subroutine restart_here

    !> Go on to the next step: the value at its start, and the sign before.
    module subroutine pass(self, value)
        class(watched_type), intent(inout) :: self
        real(wp), intent(in) :: value(:)
        integer :: k

        self%value = value(size(value))
        self%rests = .false.
        do k = size(value), 1, -1
            if (abs(value(k)) <= zero*maxval(abs(value))) cycle
            self%sign_before = merge(1, -1, value(k) > 0.0_wp)
            exit
        end do
    end subroutine pass
end submodule tandem_simulate_eventing
