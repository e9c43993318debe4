! SPDX-License-Identifier: MIT
!> Location of the zeros of events in a step.
!>
!> Every g is sampled at several positions of the step. A sign change is narrowed to 1e-13 of the step. If samples approach zero and
!> turn back, the minimum of |g| is searched, since it may hide two sign changes or a contact. A g that crosses zero and returns
!> within a quarter of a step is missed if the parabola through the samples does not reveal it; `max_step` bounds such intervals. A
!> zero at the very end of a step is decided in the next step, which shows whether g continues or turns back.
submodule(tandem_simulate_event_watch) tandem_simulate_event_zeros
    use tandem_simulate_root, only: bracket_type, minimum_type, vertex
    implicit none (type, external)

    !> Position of the first evaluation of g after an event. At earlier positions, rounding errors determine the sign.
    real(wp), parameter :: early = 1.0e-6_wp
    !> Fractions of the largest |g| in the step below which a value counts as zero: soon after an event; at an extremum, where the
    !> error of the integration determines whether g attains zero.
    real(wp), parameter :: early_zero = 1.0e-11_wp, touch = 1.0e-9_wp

    !> Samples of the function of one event in a step.
    type :: sampled_type
        !> Index of the event; first sample whose zeros count, 0 if unknown.
        integer :: number = 0, first = 0
        !> Positions, values, the largest absolute value, and signs.
        real(wp) :: x(n_samples) = sample_position, value(n_samples) = 0.0_wp, largest = 0.0_wp
        integer :: sign(n_samples) = 0
    end type sampled_type

contains

    module procedure search
        integer :: i

        self%watched_before(:) = self%watched
        self%were_stale = self%values_are_stale
        call sample_all(self, curve, error)
        self%found%n = 0
        do i = 1, self%n
            if (.not. allocated(error)) call find_zeros(self, curve, i, is_last, error)
        end do
    end procedure search

    !> Evaluate all functions at all samples of the step.
    subroutine sample_all(self, curve, error)
        class(event_watch_type), intent(inout) :: self
        class(curve_type), intent(inout) :: curve
        type(error_type), allocatable, intent(out) :: error
        integer :: k

        if (self%values_are_stale) then
            call sample(self, curve, 0.0_wp, self%samples(:, 1), error)
        else
            self%samples(:, 1) = self%watched%value
        end if
        if (.not. allocated(error) .and. any(self%watched%rests)) then
            call sample(self, curve, early, self%samples(:, n_samples + 1), error)
        end if
        do k = 2, n_samples
            if (allocated(error)) return
            call sample(self, curve, sample_position(k), self%samples(:, k), error)
        end do
        self%values_are_stale = .false.
    end subroutine sample_all

    !> Evaluate all functions at a position of the step.
    subroutine sample(self, curve, x, value, error)
        class(event_watch_type), intent(inout) :: self
        class(curve_type), intent(inout) :: curve
        !> 0 at the start of the step, 1 at its end.
        real(wp), intent(in) :: x
        real(wp), intent(out) :: value(:)
        type(error_type), allocatable, intent(out) :: error
        integer :: i

        value = 0.0_wp
        call curve%go_to(x, error)
        self%lambda_is_current = .false.
        if (allocated(error)) return
        call self%measure_all(curve%state%t, curve%state%q, curve%state%qd)
        do i = 1, size(self%watched)
            call self%evaluate(curve, i, value(i), error)
            if (allocated(error)) exit
        end do
        call self%end_measuring()
    end subroutine sample

    !> Evaluate g of one event at a position of the step.
    subroutine evaluate_at(self, curve, number, x, value, error)
        class(event_watch_type), intent(inout) :: self
        class(curve_type), intent(inout) :: curve
        integer, intent(in) :: number
        real(wp), intent(in) :: x
        real(wp), intent(out) :: value
        type(error_type), allocatable, intent(out) :: error

        value = 0.0_wp
        call curve%go_to(x, error)
        self%lambda_is_current = .false.
        if (.not. allocated(error)) call self%evaluate(curve, number, value, error)
    end subroutine evaluate_at

    !> Find the zeros of one event in the step and add them to the list.
    subroutine find_zeros(self, curve, number, is_last, error)
        class(event_watch_type), intent(inout) :: self
        class(curve_type), intent(inout) :: curve
        integer, intent(in) :: number
        !> True if a zero at the end of the step counts.
        logical, intent(in) :: is_last
        type(error_type), allocatable, intent(out) :: error
        type(sampled_type) :: g
        integer :: k

        associate (watched => self%watched(number))
            g%number = number
            g%value = self%samples(number, :n_samples)
            g%largest = maxval(abs(g%value))
            if (.not. watched%rests) then
                if (watched%is_faint(g%largest)) then
                    call self%measure_noise(curve, number, watched%noise)
                else
                    watched%noise = 0.0_wp
                end if
            end if
            watched%largest = g%largest
            watched%peak = max(watched%peak, g%largest)
            if (.not. g%largest > 0.0_wp .and. .not. watched%is_open) return
            do k = 1, n_samples
                g%sign(k) = sign_of(g%value(k), max(zero*g%largest, watched%noise))
            end do
            if (watched%rests) call begin_after_event(watched, self%samples(number, n_samples + 1), g)
        end associate
        if (g%first == 0) call decide_start(self, g)
        if (self%watched(number)%is_reversed) call check_reversal(self, curve, g, error)
        if (allocated(error)) return
        call find_crossings(self, curve, g, is_last, error)
        do k = g%first, n_samples
            if (.not. allocated(error)) call look_for_minimum(self, curve, g, k, error)
        end do
    end subroutine find_zeros

    !> Begin soon after the start of the step, at which the event has occurred.
    pure subroutine begin_after_event(watched, early_value, g)
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
    end subroutine begin_after_event

    !> Decide whether a zero at the start of the step counts: at the start of the run, if the last step left it undecided, or after
    !> a jump.
    subroutine decide_start(self, g)
        class(event_watch_type), intent(inout) :: self
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
                ! A zero here is not yet attained, or it has already counted.
                if (s(1) == 0 .and. s(2) /= 0) s(1) = before
                return
            end if
            is_open = .false.
            if (after == 0) then
                ! g remains zero: either this is one zero at the start, or g will cross zero when it leaves.
                if (wanted == 0) call add_if_wanted(self, g, 0.0_wp, 0)
                is_open = wanted /= 0
            else if (before == 0) then
                if (s(1) == 0 .and. (wanted == 0 .or. wanted == after)) call self%found%add(g%number, 0.0_wp, 0)
            else if (before /= after) then
                call add_if_wanted(self, g, 0.0_wp, after)
            else if (s(1) == 0 .or. s(2) == s(1)) then
                call add_if_wanted(self, g, 0.0_wp, 0)
            end if
        end associate
    end subroutine decide_start

    !> Decide whether an action that has reversed the motion of g is effective. It is if g keeps its sign in this step; g with the
    !> opposite sign is an error.
    subroutine check_reversal(self, curve, g, error)
        class(event_watch_type), intent(inout) :: self
        class(curve_type), intent(inout) :: curve
        type(sampled_type), intent(in) :: g
        type(error_type), allocatable, intent(out) :: error
        integer :: i

        associate (watched => self%watched(g%number))
            do i = g%first, n_samples
                if (g%sign(i) == 0 .or. abs(g%value(i)) <= 1.0e-9_wp*watched%expected_change) cycle
                watched%is_reversed = .false.
                if (g%sign(i) == watched%direction) call set_error(error, status_event_limit, 'the event "'// &
                    trim(watched%event%name)//'" at t = '//to_text(curve%t_from)//' would recur immediately', &
                    'stop the run where the motion comes to rest, or change the model there')
                return
            end do
            watched%is_reversed = curve%t_to < watched%check_until
        end associate
    end subroutine check_reversal

    !> Find crossings between samples, and crossings or contacts at samples, which the signs around them distinguish.
    subroutine find_crossings(self, curve, g, is_last, error)
        class(event_watch_type), intent(inout) :: self
        class(curve_type), intent(inout) :: curve
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
                    ! It may also be the first or second of two crossings.
                    call search_minimum(self, curve, g, g%x(last), g%value(last), g%x(k), g%value(k), is_found, error)
                    if (.not. is_found) call add_if_wanted(self, g, g%x(last + 1), 0)
                else if (g%sign(k) /= g%sign(last)) then
                    call locate(self, curve, g, g%x(last), g%value(last), g%x(k), g%value(k), error)
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

    !> Locate a sign change between two positions.
    subroutine locate(self, curve, g, a, value_a, b, value_b, error)
        class(event_watch_type), intent(inout) :: self
        class(curve_type), intent(inout) :: curve
        type(sampled_type), intent(in) :: g
        real(wp), intent(in) :: a, value_a, b, value_b
        type(error_type), allocatable, intent(out) :: error
        !> Exceeds the number of points with two secant steps per bisection.
        integer, parameter :: most_points = 150
        type(bracket_type) :: bracket
        real(wp) :: point, value_there
        integer :: j

        bracket = bracket_type(a, b, value_a, value_b)
        do j = 1, most_points
            if (bracket%b - bracket%a <= resolution) exit
            point = bracket%next_point()
            if (point <= bracket%a .or. point >= bracket%b) exit
            call evaluate_at(self, curve, g%number, point, value_there, error)
            if (allocated(error)) return
            call bracket%narrow(point, value_there)
        end do
        ! Return the position after the zero, so that the motion continues after the sign change.
        point = bracket%b
        if ((1.0_wp - point)*(curve%t_to - curve%t_from) <= 8*spacing(abs(curve%t_to))) point = 1.0_wp
        call add_if_wanted(self, g, point, merge(1, -1, value_b > 0.0_wp))
    end subroutine locate

    !> Search for a minimum if |g| at a sample is smaller than at its neighbours and may attain zero there.
    subroutine look_for_minimum(self, curve, g, k, error)
        class(event_watch_type), intent(inout) :: self
        class(curve_type), intent(inout) :: curve
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
            ! At an end of the step: only an extremum within the step, or one too near to the end to be excluded.
            associate (expected_change => merge(0.0_wp, x(high) - x(low), self%watched(g%number)%rests))
                if (k == low .and. (at > x(high) .or. at < x(low) - expected_change)) return
                if (k == high .and. (at < x(low) .or. at > x(high) + x(high) - x(low))) return
            end associate
            call search_minimum(self, curve, g, x(low), value(low), x(high), value(high), is_found, error)
        end associate
    end subroutine look_for_minimum

    !> Locate a minimum of |g| near zero, and decide whether it is a contact or hides crossings.
    subroutine search_minimum(self, curve, g, a, value_a, b, value_b, is_found, error)
        class(event_watch_type), intent(inout) :: self
        class(curve_type), intent(inout) :: curve
        type(sampled_type), intent(in) :: g
        real(wp), intent(in) :: a, value_a, b, value_b
        !> True if g attains zero there.
        logical, intent(out) :: is_found
        type(error_type), allocatable, intent(out) :: error
        !> Golden section search alone takes 45.
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
            ! Stop far above zero, if no parabola can attain zero.
            if (minimum%expected > 0.5_wp*minimum%value .and. minimum%expected < huge(1.0_wp) .and. &
                minimum%value > 1.0e3_wp*touch*g%largest .and. minimum%n_points > 4) return
            if (point <= minimum%a .or. point >= minimum%b) exit
            call evaluate_at(self, curve, g%number, point, value_there, error)
            if (allocated(error)) return
            call minimum%narrow(point, toward*value_there)
            is_found = minimum%value < -touch*g%largest
            if (is_found) then
                call locate(self, curve, g, a, value_a, minimum%x, toward*minimum%value, error)
                if (.not. allocated(error)) call locate(self, curve, g, minimum%x, toward*minimum%value, b, value_b, error)
                return
            end if
        end do
        is_found = minimum%value <= touch*g%largest .and. minimum%value < min(abs(value_a), abs(value_b))
        if (is_found) call add_if_wanted(self, g, minimum%x, 0)
    end subroutine search_minimum

    !> Add a zero if its direction is one in which the event occurs.
    subroutine add_if_wanted(self, g, at, direction)
        class(event_watch_type), intent(inout) :: self
        type(sampled_type), intent(in) :: g
        real(wp), intent(in) :: at
        integer, intent(in) :: direction

        associate (wanted => self%watched(g%number)%event%direction)
            if (wanted == 0 .or. wanted == direction) call self%found%add(g%number, at, direction)
        end associate
    end subroutine add_if_wanted
end submodule tandem_simulate_event_zeros
