! SPDX-License-Identifier: MIT
!> The events of a step: searched on its dense output, recorded in the order of their times, and the step cut where they ask for it.
!>
!> Every g is sampled at a few places of the step. A sign change is narrowed to 1e-13 of the step. Where the samples come near zero
!> and turn back, the minimum of |g| is searched: it may hide two sign changes, or a touch. A g that leaves and returns within a
!> quarter of a step, not seen by the parabola through the samples, is missed; `max_step` bounds that. A zero at the very end of
!> a step is judged with the next step, which shows whether g goes on or turns back.
submodule(tandem_simulation) tandem_simulate_event_search
    use tandem_simulate_event, only: threshold_event_type
    use tandem_simulate_root, only: bracket_type, minimum_type, sign_of, vertex
    use tandem_status, only: status_event_limit
    implicit none (type, external)

    !> Places of the samples within the step. Those beside the ends tell an extremum at an end from one before or behind it.
    integer, parameter :: n_samples = 7
    real(wp), parameter :: aside = 1.0_wp/256
    real(wp), parameter :: place(n_samples) = [0.0_wp, aside, 0.25_wp, 0.5_wp, 0.75_wp, 1.0_wp - aside, 1.0_wp]
    !> Where g is looked at first after an event: closer to its zero the sign is rounding.
    real(wp), parameter :: early = 1.0e-6_wp
    !> Zeros are located to this part of the step; events closer than twice that are at once.
    real(wp), parameter :: resolution = 1.0e-13_wp
    !> Below these parts of the largest |g| in the step a value is zero: at a sample; soon after an event; at an extremum, where
    !> the error of the integration decides whether g gets there.
    real(wp), parameter :: zero = 1.0e-13_wp, early_zero = 1.0e-11_wp, touch = 1.0e-9_wp
    !> Most zeros of one event in a step: a crossing between all samples, and two at every other extremum.
    integer, parameter :: most_zeros = 2*n_samples
    !> Events without an advance of time, one after the other, before they count as endless.
    integer, parameter :: most_at_once = 100

    !> The function of one event as the samples of a step show it.
    type :: sampled_type
        !> The event, and the first sample from which on its zeros count; 0 until that is known.
        integer :: number = 0, first = 0
        !> Places and values, the largest modulus of these, and their signs.
        real(wp) :: x(n_samples) = place, value(n_samples) = 0.0_wp, largest = 0.0_wp
        integer :: sign(n_samples) = 0
    end type sampled_type

contains

    module procedure add_event
        type(watched_type), allocatable :: longer(:)
        integer :: n

        if (.not. self%is_ready) return
        n = 0
        if (allocated(self%watched)) n = size(self%watched)
        allocate (longer(n + 1))
        if (n > 0) longer(:n) = self%watched
        longer(n + 1)%event => event
        call move_alloc(longer, self%watched)
        select type (event)
        class is (threshold_event_type)
            if (event%quantity == 'lambda') event%needs_multipliers = .true.
            event%told_by => self%model
        end select
        if (.not. allocated(self%events)) allocate (self%events(0))
        if (.not. allocated(self%lambda)) allocate (self%lambda(self%model%n_constraints()), source=0.0_wp)
        if (allocated(self%samples)) deallocate (self%samples)
        allocate (self%samples(n + 1, n_samples + 1), source=0.0_wp)
        call self%zeros%allocate(most_zeros*(n + 1))
        self%values_are_stale = .true.
    end procedure add_event

    !> Look for events in the step that was just accepted, from self%start to self%state, record them, and cut the step at the
    !> first that stops the run or changes the motion. On an error without a cut the step has not been searched to its end.
    module procedure look_for_events
        real(wp) :: cut_at, at_once
        integer :: i, k

        is_cut = .false.
        call take_samples(self, error)
        self%zeros%n = 0
        do i = 1, size(self%watched)
            if (.not. allocated(error)) call find_zeros(self, i, is_last, error)
        end do
        if (allocated(error)) then
            call self%look_back()
            return
        end if
        ! The first that cuts the step, with what happens at once with it: all of them have passed their zeros at the cut.
        at_once = max(2*resolution, 4*spacing(abs(self%next%t))/(self%next%t - self%start%t))
        cut_at = 2.0_wp
        associate (zeros => self%zeros)
            do k = 1, zeros%n
                associate (event => self%watched(zeros%number(k))%event)
                    is_cut = event%stops .or. event%changes
                end associate
                if (is_cut) cut_at = maxval(zeros%place(k:zeros%n), zeros%place(k:zeros%n) <= zeros%place(k) + at_once)
                if (is_cut) exit
            end do
            do k = 1, zeros%n
                if (zeros%place(k) > cut_at) exit
                call record(self, zeros%number(k), zeros%direction(k), zeros%place(k), error)
                if (.not. allocated(error)) cycle
                ! The run ends at the event that is one too many.
                is_cut = .true.
                cut_at = zeros%place(k)
                call cut_step(self, cut_at)
                return
            end do
        end associate
        if (is_cut) then
            call begin_events(self, cut_at, at_once, error)
        else
            call self%look_back()
            do i = 1, size(self%watched)
                call pass(self%watched(i), self%samples(i, :n_samples), is_last)
            end do
        end if
    end procedure look_for_events

    !> All functions at all samples of the step.
    subroutine take_samples(self, error)
        class(simulation_type), intent(inout) :: self
        type(error_type), allocatable, intent(out) :: error
        integer :: k

        if (self%values_are_stale) then
            call sample(self, 0.0_wp, self%samples(:, 1), error)
        else
            self%samples(:, 1) = self%watched%value
        end if
        if (.not. allocated(error) .and. any(self%watched%rests)) then
            call sample(self, early, self%samples(:, n_samples + 1), error)
        end if
        do k = 2, n_samples
            if (allocated(error)) return
            call sample(self, place(k), self%samples(:, k), error)
        end do
        self%values_are_stale = .false.
    end subroutine take_samples

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
            if (stat == 0) then
                call set_error(error, status_not_finite, 'the function of the event "'//trim(event%name)// &
                    '" gives a NaN or an infinity at t = '//to_text(state%t), 'see why it cannot be evaluated there')
            else
                call set_error(error, status_callback_failed, 'the function of the event "'//trim(event%name)// &
                    '" returned the status '//to_text(stat)//' at t = '//to_text(state%t), 'see why it cannot be evaluated there')
            end if
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
    subroutine find_zeros(self, number, is_last, error)
        class(simulation_type), intent(inout) :: self
        integer, intent(in) :: number
        !> Whether a zero at the end of the step counts.
        logical, intent(in) :: is_last
        type(error_type), allocatable, intent(out) :: error
        type(sampled_type) :: g
        integer :: k

        associate (watched => self%watched(number))
            g%number = number
            g%value = self%samples(number, :n_samples)
            g%largest = maxval(abs(g%value))
            watched%largest = g%largest
            if (.not. g%largest > 0.0_wp .and. .not. watched%is_open) return
            do k = 1, n_samples
                g%sign(k) = sign_of(g%value(k), max(zero*g%largest, watched%noise))
            end do
            if (watched%rests) call begin_behind(watched, self%samples(number, n_samples + 1), g)
        end associate
        if (g%first == 0) call judge_start(self, g)
        if (self%watched(number)%is_sent_back) call judge_return(self, g, error)
        if (allocated(error)) return
        call find_crossings(self, g, is_last, error)
        do k = g%first, n_samples
            if (.not. allocated(error)) call look_for_minimum(self, g, k, error)
        end do
    end subroutine find_zeros

    !> The event has happened at the start of the step: begin a little behind it.
    pure subroutine begin_behind(watched, early_value, g)
        type(watched_type), intent(inout) :: watched
        real(wp), intent(in) :: early_value
        type(sampled_type), intent(inout) :: g

        g%first = 2
        watched%is_open = .false.
        g%sign(1) = sign_of(early_value, max(early_zero*g%largest, watched%noise))
        if (g%sign(1) == 0) return
        g%first = 1
        g%x(1) = early
        g%value(1) = early_value
    end subroutine begin_behind

    !> A zero at the start of the step: one of the start of the run, one that the last step has left open, or a jump.
    subroutine judge_start(self, g)
        class(simulation_type), intent(inout) :: self
        type(sampled_type), intent(inout) :: g
        integer :: after, k

        g%first = 1
        k = findloc(g%sign /= 0, .true., dim=1)
        after = 0
        if (k > 0) after = g%sign(k)
        associate (s => g%sign, is_open => self%watched(g%number)%is_open, before => self%watched(g%number)%sign_before, &
            wanted => self%watched(g%number)%event%direction)
            if (.not. is_open) then
                if (s(1)*before < 0) call add_if_wanted(self, g, 0.0_wp, s(1))
                ! What is zero here is not there yet, or was counted.
                if (s(1) == 0 .and. s(2) /= 0) s(1) = before
                return
            end if
            is_open = .false.
            if (after == 0) then
                ! g stays at zero: that is one zero, now, or a crossing where it leaves.
                if (wanted == 0) call add_if_wanted(self, g, 0.0_wp, 0)
                is_open = wanted /= 0
            else if (before == 0) then
                if (s(1) == 0 .and. (wanted == 0 .or. wanted == after)) call self%zeros%add(g%number, 0.0_wp, 0)
            else if (before /= after) then
                call add_if_wanted(self, g, 0.0_wp, after)
            else if (s(1) == 0 .or. s(2) == s(1)) then
                call add_if_wanted(self, g, 0.0_wp, 0)
            end if
        end associate
    end subroutine judge_start

    !> An action that has sent g back has done so for longer than what is seen here, or for nothing: g comes out on the side
    !> that it was sent away from.
    subroutine judge_return(self, g, error)
        class(simulation_type), intent(inout) :: self
        type(sampled_type), intent(in) :: g
        type(error_type), allocatable, intent(out) :: error
        integer :: i

        associate (watched => self%watched(g%number))
            do i = g%first, n_samples
                if (g%sign(i) == 0 .or. abs(g%value(i)) <= 1.0e-9_wp*watched%reach) cycle
                watched%is_sent_back = .false.
                if (g%sign(i) == watched%direction) call set_error(error, status_event_limit, 'the event "'// &
                    trim(watched%event%name)//'" at t = '//to_text(self%start%t)//' would follow itself at once', &
                    'stop the run where its motion comes to rest, or change the model there')
                return
            end do
            watched%is_sent_back = self%next%t < watched%judged_until
        end associate
    end subroutine judge_return

    !> Crossings between samples; at samples crossings or touches, as the signs around them say.
    subroutine find_crossings(self, g, is_last, error)
        class(simulation_type), intent(inout) :: self
        type(sampled_type), intent(in) :: g
        logical, intent(in) :: is_last
        type(error_type), allocatable, intent(out) :: error
        integer :: k, last
        logical :: is_found

        last = 0
        do k = g%first, n_samples
            if (allocated(error)) return
            if (g%sign(k) == 0) cycle
            if (last > 0) then
                if (last < k - 1 .and. g%sign(k) /= g%sign(last)) then
                    call add_if_wanted(self, g, g%x(last + 1), g%sign(k))
                else if (last < k - 1) then
                    ! It may also be one of two crossings.
                    call search_minimum(self, g, g%x(last), g%value(last), g%x(k), g%value(k), is_found, error)
                    if (.not. is_found) call add_if_wanted(self, g, g%x(last + 1), 0)
                else if (g%sign(k) /= g%sign(last)) then
                    call locate(self, g, g%x(last), g%value(last), g%x(k), g%value(k), error)
                end if
            end if
            last = k
        end do
        if (last == 0 .or. last == n_samples) return
        if (is_last) then
            call add_if_wanted(self, g, g%x(last + 1), -g%sign(last))
        else
            self%watched(g%number)%is_open = .true.
        end if
    end subroutine find_crossings

    !> Narrow a sign change between two places.
    subroutine locate(self, g, a, value_a, b, value_b, error)
        class(simulation_type), intent(inout) :: self
        type(sampled_type), intent(in) :: g
        real(wp), intent(in) :: a, value_a, b, value_b
        type(error_type), allocatable, intent(out) :: error
        !> More than two secants to a bisection take.
        integer, parameter :: most_points = 150
        type(bracket_type) :: bracket
        real(wp) :: point, value_there
        integer :: j

        bracket = bracket_type(a, b, value_a, value_b)
        do j = 1, most_points
            if (bracket%b - bracket%a <= resolution) exit
            point = bracket%next_point()
            if (point <= bracket%a .or. point >= bracket%b) exit
            call evaluate_at(self, g%number, point, value_there, error)
            if (allocated(error)) return
            call bracket%narrow(point, value_there)
        end do
        ! Behind the zero, so that the motion goes on from where the sign has changed; what is left of a step is a step.
        point = bracket%b
        if ((1.0_wp - point)*(self%next%t - self%start%t) <= 8*spacing(abs(self%next%t))) point = 1.0_wp
        call add_if_wanted(self, g, point, merge(1, -1, value_b > 0.0_wp))
    end subroutine locate

    !> Is |g| at a sample smaller than beside it, and may it reach zero there?
    subroutine look_for_minimum(self, g, k, error)
        class(simulation_type), intent(inout) :: self
        type(sampled_type), intent(in) :: g
        integer, intent(in) :: k
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: at, extreme
        integer :: i, low, high
        logical :: is_found

        i = min(max(k - 1, g%first), n_samples - 2)
        low = max(k - 1, g%first)
        high = min(k + 1, n_samples)
        associate (x => g%x, value => g%value)
            if (g%sign(i) == 0 .or. any(g%sign(i:i + 2) /= g%sign(i))) return
            if (k > low .and. abs(value(k)) > abs(value(low))) return
            if (k < high .and. abs(value(k)) >= abs(value(high))) return
            call vertex(x(i:i + 2), abs(value(i:i + 2)), at, extreme)
            if (extreme > 0.25_wp*maxval(abs(value(i:i + 2)))) return
            ! At an end: only an extremum of this step, or one too near to the end to tell.
            associate (reach => merge(0.0_wp, x(high) - x(low), self%watched(g%number)%rests))
                if (k == low .and. (at > x(high) .or. at < x(low) - reach)) return
                if (k == high .and. (at < x(low) .or. at > x(high) + x(high) - x(low))) return
            end associate
            call search_minimum(self, g, x(low), value(low), x(high), value(high), is_found, error)
        end associate
    end subroutine look_for_minimum

    !> Find out what a minimum of |g| near zero is.
    subroutine search_minimum(self, g, a, value_a, b, value_b, is_found, error)
        class(simulation_type), intent(inout) :: self
        type(sampled_type), intent(in) :: g
        real(wp), intent(in) :: a, value_a, b, value_b
        !> Whether g gets to zero there.
        logical, intent(out) :: is_found
        type(error_type), allocatable, intent(out) :: error
        !> Golden sections alone take 45.
        integer, parameter :: most_points = 60
        type(minimum_type) :: minimum
        real(wp) :: point, value_there, toward
        integer :: j

        is_found = .false.
        toward = sign(1.0_wp, value_a)
        call minimum%begin(a, b)
        do j = 1, most_points
            point = minimum%next_point()
            if (minimum%n_points > 3 .and. minimum%width() <= 2.0e-9_wp) exit
            ! Far above zero: no parabola will bring it there.
            if (minimum%expected > 0.5_wp*minimum%value .and. minimum%expected < huge(1.0_wp) .and. &
                minimum%value > 1.0e3_wp*touch*g%largest .and. minimum%n_points > 4) return
            if (point <= minimum%a .or. point >= minimum%b) exit
            call evaluate_at(self, g%number, point, value_there, error)
            if (allocated(error)) return
            call minimum%narrow(point, toward*value_there)
            is_found = minimum%value < -touch*g%largest
            if (is_found) then
                call locate(self, g, a, value_a, minimum%x, toward*minimum%value, error)
                if (.not. allocated(error)) call locate(self, g, minimum%x, toward*minimum%value, b, value_b, error)
                return
            end if
        end do
        is_found = minimum%value <= touch*g%largest .and. minimum%value < min(abs(value_a), abs(value_b))
        if (is_found) call add_if_wanted(self, g, minimum%x, 0)
    end subroutine search_minimum

    !> Add a zero where the event asks for its direction.
    subroutine add_if_wanted(self, g, at, direction)
        class(simulation_type), intent(inout) :: self
        type(sampled_type), intent(in) :: g
        real(wp), intent(in) :: at
        integer, intent(in) :: direction

        associate (wanted => self%watched(g%number)%event%direction)
            if (wanted == 0 .or. wanted == direction) call self%zeros%add(g%number, at, direction)
        end associate
    end subroutine add_if_wanted

    !> Keep what has happened.
    subroutine record(self, number, direction, x, error)
        class(simulation_type), intent(inout) :: self
        integer, intent(in) :: number, direction
        real(wp), intent(in) :: x
        type(error_type), allocatable, intent(out) :: error
        type(event_record_type), allocatable :: longer(:)

        call go_to(self, x, error)
        if (allocated(error)) return
        if (self%n_events >= self%options%max_events) then
            call set_error(error, status_event_limit, 'max_events = '//to_text(self%n_events)//' until t = '//to_text(self%state%t))
            return
        end if
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

    !> End the step at the state that is looked at. What the chart keeps stays that of the whole step, for its dense output.
    subroutine cut_step(self, x)
        class(simulation_type), intent(inout) :: self
        real(wp), intent(in) :: x

        if (.not. x > 0.0_wp) then
            call self%look_back()
            call self%state%copy(self%start)
        end if
        if (self%is_looking) then
            self%is_looking = .false.
            call self%chart%release()
        end if
        self%last_step = self%state%t - self%start%t
        self%renewal = by_event
    end subroutine cut_step

    !> End the step at events: what they ask for, and where all functions go on from.
    subroutine begin_events(self, x, at_once, error)
        class(simulation_type), intent(inout) :: self
        !> Place of the cut; zeros that are this near to it are at once with it.
        real(wp), intent(in) :: x, at_once
        type(error_type), allocatable, intent(out) :: error
        integer :: i, k

        call go_to(self, x, error)
        if (allocated(error)) return
        call cut_step(self, x)
        self%n_at_once = merge(self%n_at_once + 1, 0, self%last_step <= 4*spacing(abs(self%state%t)))
        if (self%n_at_once > most_at_once) then
            call set_error(error, status_event_limit, 'at t = '//to_text(self%state%t))
            return
        end if
        self%watched%rests = .false.
        self%watched%noise = 0.0_wp
        do k = 1, self%zeros%n
            if (self%zeros%place(k) > x) exit
            if (self%zeros%place(k) < x - at_once) cycle
            associate (watched => self%watched(self%zeros%number(k)))
                watched%rests = .true.
                watched%direction = self%zeros%direction(k)
                watched%is_due = watched%event%changes
                watched%is_sent_back = .false.
                if (watched%is_due) self%has_to_act = .true.
                if (.not. watched%event%stops .or. self%is_stopped) cycle
                self%is_stopped = .true.
                self%stopped_by = watched%event%name
            end associate
        end do
        do i = 1, size(self%watched)
            if (x < 1.0_wp) self%watched(i)%is_open = .false.
            ! The sign before the cut, for those that do not happen there.
            do k = 1, n_samples
                if (place(k) > x) exit
                associate (s => sign_of(self%samples(i, k), zero*self%watched(i)%largest))
                    if (s /= 0) self%watched(i)%sign_before = s
                end associate
            end do
        end do
        call self%measure_errors(error)
        if (.not. allocated(error)) call self%renew_values(error)
    end subroutine begin_events

    !> The values of all functions at the current state.
    module procedure renew_values
        integer :: i

        self%lambda_is_current = .false.
        do i = 1, size(self%watched)
            associate (watched => self%watched(i))
                call evaluate(self, i, watched%value, error)
                if (allocated(error)) return
                if (watched%rests) call measure_noise(self, i, watched%noise)
                associate (s => sign_of(watched%value, max(zero*watched%largest, watched%noise)))
                    if (s /= 0) watched%sign_before = s
                end associate
            end associate
        end do
    end procedure renew_values

    !> How far rounding of time, state and multipliers may move g.
    subroutine measure_noise(self, number, noise)
        class(simulation_type), intent(inout) :: self
        integer, intent(in) :: number
        real(wp), intent(out) :: noise
        real(wp), parameter :: eps = 4*epsilon(1.0_wp)
        real(wp) :: up(self%model%n), value, moved
        integer :: stat, i

        noise = 0.0_wp
        associate (event => self%watched(number)%event, state => self%state)
            up = [(1.0_wp + merge(-eps, eps, mod(i, 2) == 0), i=1, self%model%n)]
            call event%evaluate(state%t, state%q, state%qd, self%lambda, value, stat)
            if (stat == 0) call event%evaluate(state%t*(1.0_wp + eps), up*state%q, up*state%qd, (1.0_wp + eps)*self%lambda, &
                moved, stat)
            self%tally%event_evaluations = self%tally%event_evaluations + 2
            if (stat == 0 .and. ieee_is_finite(moved - value)) noise = abs(moved - value)
        end associate
    end subroutine measure_noise

    !> Let a watched event go on to the next step.
    subroutine pass(watched, value, is_last)
        type(watched_type), intent(inout) :: watched
        !> g at the samples of the step that ended.
        real(wp), intent(in) :: value(:)
        !> Whether a zero at the end has counted, as a crossing.
        logical, intent(in) :: is_last
        integer :: k

        watched%value = value(size(value))
        do k = 1, size(value)
            associate (s => sign_of(value(k), max(zero*watched%largest, watched%noise)))
                if (s /= 0) watched%rests = .false.
                if (s /= 0) watched%sign_before = s
                if (s == 0 .and. k == size(value) .and. is_last) watched%sign_before = -watched%sign_before
            end associate
        end do
        if (.not. watched%rests) watched%noise = 0.0_wp
    end subroutine pass
end submodule tandem_simulate_event_search
