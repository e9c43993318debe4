! SPDX-License-Identifier: MIT
!> Steps over singular configurations: C loses rank at one instant, and the motion is smooth (theory, section 25). A polynomial from
!> a state before it, the base, satisfies the equations of motion on both sides of it, to a time where C has its rank again
!> (collocation). If that fails, since the motion is stiff, a polynomial through states before it continues the motion. The nearer
!> the base, the smaller the error of either polynomial, and the larger the rounding errors of states and accelerations, which grow
!> with the square and the cube of the condition of C.
submodule(tandem_simulation) tandem_simulate_crossing
    use tandem_chart, only: need_independence
    use tandem_simulate_state_polynomial, only: most_nodes
    implicit none (type, external)

    !> Smallest part of the best independence at states that determine the motion behind the configuration.
    real(wp), parameter :: least_part = 1.0e-3_wp
    !> Largest error of a crossing, relative to the tolerance: as long as later steps can reduce it, and otherwise. Relative error
    !> that is then accepted at any tolerance; one that is not accepted, since isolated configurations leave less, and motions that
    !> turn off more; the largest one in all directions.
    real(wp), parameter :: small_part = 0.05_wp, last_part = 3.0_wp, sure_error = 1.0e-8_wp, doubtful_error = 3.0e-6_wp, &
        largest_error = 1.0e-4_wp
    !> Error of a position whose branches can be told apart, relative to its distance from the configuration.
    real(wp), parameter :: clear_part = 1.0e-2_wp

    interface
        !> Find the state at a time behind the configuration, at least as far from it as the base, and its error.
        module subroutine continue_from(self, base, gap, stop_at, error)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
            !> Index of a recent state.
            integer, intent(in) :: base
            !> Least time between states that are extrapolated, relative to half the time from the base to the end; 0 to collocate.
            real(wp), intent(in) :: gap, stop_at
            !> Relative error, huge if there is no result.
            real(wp), intent(out) :: error
        end subroutine continue_from
    end interface

contains

    module procedure consider_crossing
        !> Parts of the best independence below which velocities of the polynomial are more accurate than those that C determines,
        !> and a single state locates a configuration.
        real(wp), parameter :: near_part = 3.0e-3_wp, near_one = 0.3_wp
        integer :: base
        logical :: is_collocated, is_nearest

        is_loss = .false.
        is_crossed = .false.
        associate (crossing => self%crossing)
            if (.not. crossing%is_on .or. abs(crossing%tried_at - self%state%t) <= 0.0_wp) return
            crossing%tried_at = self%state%t
            crossing%obstacle = ''
            ! One state locates only a configuration that is near.
            if (crossing%recent%n < merge(1, 2, self%chart%independence < near_one*self%chart%best_independence)) return
            call prepare(self)
            call self%chart%get_memory(crossing%memory)
            ! The last state may be too near to have reliable accelerations.
            call locate(self, 1, reach, is_loss)
            if (.not. is_loss .and. self%lost_rank%is_close(self%chart)) call locate(self, 2, reach, is_loss)
            if (is_loss .and. crossing%passes) then
                call refine(self)
                call choose_base(self, stop_at, base, is_collocated, is_nearest)
                if (base > 0) then
                    call compare(self, is_collocated, is_nearest)
                    call judge(self, .not. is_nearest, is_crossed)
                    if (is_crossed) call refine_time(self, is_crossed)
                end if
            end if
            call self%chart%set_memory(crossing%memory)
            if (is_crossed) then
                crossing%is_listed = .false.
                crossing%near = near_part*self%chart%best_independence/crossing%rate
                call go_over(self, stop_at)
            end if
        end associate
    end procedure consider_crossing

    !> Allocate the work space.
    subroutine prepare(self)
        class(simulation_type), intent(inout) :: self

        associate (crossing => self%crossing, n => self%model%n)
            if (allocated(crossing%values)) return
            allocate (crossing%values(n, 3))
            call crossing%trial%allocate(n)
            call crossing%predicted%allocate(n)
        end associate
    end subroutine prepare

    !> Correct recent states near the configuration once more: the constraint errors that are left in the direction in which the
    !> branches separate grow with the inverse of the independence in q, with its square in qd and with its cube in qdd.
    subroutine refine(self)
        class(simulation_type), intent(inout) :: self
        !> Part of the best independence up to which states are corrected.
        real(wp), parameter :: near = 0.3_wp
        integer :: i, stat

        associate (crossing => self%crossing, recent => self%crossing%recent)
            do i = 1, recent%n
                if (crossing%rate*(crossing%record%t - recent%t(i)) > near*self%chart%best_independence) exit
                if (recent%is_exact(i)) cycle
                call recent%get(i, crossing%values)
                associate (q => crossing%values(:, 1), qd => crossing%values(:, 2), qdd => crossing%values(:, 3))
                    call self%chart%project(recent%t(i), q, qd, .true., stat, exactly=.true.)
                    if (stat == status_ok) call self%chart%accelerate(recent%t(i), q, qd, step_end, qdd, stat)
                end associate
                if (stat == status_ok) call recent%correct(i, crossing%values)
            end do
        end associate
    end subroutine refine

    !> Let a polynomial pass through recent states from one on, at least some time apart, as many as possible.
    subroutine pass_through(self, first, gap, n_nodes)
        class(simulation_type), intent(inout) :: self
        integer, intent(in) :: first
        real(wp), intent(in) :: gap
        integer, intent(out) :: n_nodes
        real(wp) :: last
        integer :: i

        associate (crossing => self%crossing, recent => self%crossing%recent)
            last = huge(1.0_wp)
            n_nodes = 0
            do i = first, recent%n
                if (last - recent%t(i) < gap) cycle
                call recent%get(i, crossing%values)
                if (n_nodes == 0) call crossing%curve%begin(recent%t(i), crossing%values(:, 1))
                call crossing%curve%add_state(recent%t(i), crossing%values(:, 2), crossing%values(:, 3))
                last = recent%t(i)
                n_nodes = n_nodes + 1
                if (n_nodes == most_nodes) exit
            end do
        end associate
    end subroutine pass_through

    !> Find the time at which C loses rank on the continued motion: its independence falls to zero and rises again, about linearly.
    subroutine locate(self, first, reach, is_found)
        class(simulation_type), intent(inout) :: self
        !> The first state that determines it.
        integer, intent(in) :: first
        !> Time within which it is searched for.
        real(wp), intent(in) :: reach
        logical, intent(out) :: is_found
        !> Part to which an interval shrinks in a pass; part of the independence now that may be left, at the end and at the first
        !> estimate of the time, where most approaches without a loss show.
        real(wp), parameter :: shrinks = 0.1_wp, left_over = 0.02_wp, left_first = 0.6_wp
        integer, parameter :: most_passes = 3
        real(wp) :: from, to, at, width, here, at_from, at_to, at_least
        integer :: n_nodes, pass, stat

        is_found = .false.
        call pass_through(self, first, 0.25_wp*reach, n_nodes)
        associate (state => self%state, crossing => self%crossing)
            call independence_at(self, state%t, here, stat)
            if (stat /= status_ok) return
            from = 0.0_wp
            to = reach
            at_from = here
            call independence_at(self, state%t + to, at_to, stat)
            if (stat == status_ok) call independence_at(self, state%t + to*here/max(here + at_to, tiny(here)), at_least, stat)
            if (stat /= status_ok .or. at_least > left_first*here) return
            do pass = 1, most_passes
                if (.not. at_from + at_to > 0.0_wp) exit
                at = (from*at_to + to*at_from)/(at_from + at_to)
                width = shrinks*(to - from)
                from = max(at - width, 0.0_wp)
                to = at + width
                call independence_at(self, state%t + from, at_from, stat)
                if (stat == status_ok) call independence_at(self, state%t + to, at_to, stat)
                if (stat /= status_ok) return
            end do
            at = 0.5_wp*(from + to)
            if (at_from + at_to > 0.0_wp) at = (from*at_to + to*at_from)/(at_from + at_to)
            call independence_at(self, state%t + at, at_least, stat)
            if (stat /= status_ok) return
            crossing%record%t = state%t + at
            crossing%rate = here/max(at, spacing(abs(state%t)))
            is_found = at > 0.0_wp .and. at_least <= left_over*here
        end associate
    end subroutine locate

    !> The time of the configuration on the polynomial of the step over it, which is more accurate there than the one that located
    !> it.
    subroutine refine_time(self, is_there)
        class(simulation_type), intent(inout) :: self
        !> False if the configuration is not within the step.
        logical, intent(out) :: is_there
        !> Times between which it lies, as parts of the best independence; the part that is left there.
        real(wp), parameter :: parts(2) = [2.0e-2_wp, 1.0e-3_wp], left_over = 1.0e-2_wp
        real(wp) :: width, before, behind, least
        integer :: k, stat

        associate (crossing => self%crossing, t => self%crossing%record%t)
            do k = 1, size(parts)
                width = parts(k)*self%chart%best_independence/crossing%rate
                call independence_at(self, t - width, before, stat)
                if (stat == status_ok) call independence_at(self, t + width, behind, stat)
                if (stat /= status_ok .or. .not. before + behind > 0.0_wp) exit
                t = t + width*(before - behind)/(before + behind)
            end do
            call independence_at(self, t, least, stat)
            is_there = stat /= status_ok .or. least <= left_over*self%chart%best_independence
        end associate
    end subroutine refine_time

    !> The independence of C at a time, on the continued motion.
    subroutine independence_at(self, t, independence, stat)
        class(simulation_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(out) :: independence
        integer, intent(out) :: stat
        type(measure_type) :: measure

        associate (crossing => self%crossing, there => self%crossing%predicted)
            call crossing%curve%evaluate(t, there%q, there%qd, there%qdd)
            call self%chart%measure(need_independence, self%state%t, self%state%q, t, there%q, there%qd, measure, stat)
            independence = measure%independence
        end associate
    end subroutine independence_at

    !> Find the motion behind the configuration from recent states at some distances, the most distant first, until the error is
    !> small or grows, and keep the result with the smallest error.
    subroutine choose_base(self, stop_at, base, is_collocated, is_nearest)
        class(simulation_type), intent(inout) :: self
        real(wp), intent(in) :: stop_at
        !> The state; 0 if none gives a result.
        integer, intent(out) :: base
        !> True if the result is that of a collocation; true if no more distant state gives a smaller error, so that a nearer one
        !> may give a smaller one.
        logical, intent(out) :: is_collocated, is_nearest
        integer, parameter :: most_tries = 8
        !> A state that is not that much further away is left out, and so are all beyond this part of the best independence but the
        !> nearest state.
        real(wp), parameter :: further = 1.9_wp, far = 0.5_wp
        !> Times between states, relative to half the time from the base to the end, for extrapolations; collocation is 0. States
        !> further apart magnify their errors less, states close together leave a smaller error of the polynomial.
        real(wp), parameter :: gaps(0:4) = [0.0_wp, 8.0_wp, 3.0_wp, 1.5_wp, 0.7_wp]
        !> Error of a collocation from which on extrapolations are not tried.
        real(wp), parameter :: sufficient = 1.0e-8_wp
        real(wp) :: error, least_error, gap, last_distance, part, enough
        integer :: i, k, n_tries, bases(most_tries)
        logical :: is_last

        n_tries = 0
        last_distance = 0.0_wp
        associate (crossing => self%crossing, recent => self%crossing%recent)
            crossing%obstacle = 'the last states before it are too near to determine the motion behind it'
            do i = 1, recent%n
                associate (distance => crossing%record%t - recent%t(i))
                    part = crossing%rate*distance/self%chart%best_independence
                    if (part < least_part) cycle
                    if (distance < further*last_distance) cycle
                    if (n_tries == most_tries .or. (n_tries > 0 .and. part > far)) exit
                    last_distance = distance
                end associate
                n_tries = n_tries + 1
                bases(n_tries) = i
            end do
        end associate
        base = 0
        gap = 0.0_wp
        is_nearest = .true.
        is_last = .false.
        least_error = huge(1.0_wp)
        enough = sufficient_error(self)
        do i = n_tries, 1, -1
            do k = 0, size(gaps) - 1
                call continue_from(self, bases(i), gaps(k), stop_at, error)
                is_last = error < least_error
                if (is_last) then
                    least_error = error
                    base = bases(i)
                    gap = gaps(k)
                    is_nearest = i == 1
                    call self%crossing%keep_try()
                end if
                if (k == 0 .and. error <= max(enough, sufficient)) exit
            end do
            if (k == 0 .and. (least_error <= enough .or. .not. is_last)) exit
        end do
        is_collocated = .not. gap > 0.0_wp
        if (base > 0 .and. .not. is_last) call self%crossing%take_best()
    end subroutine choose_base

    !> Relative error of a crossing that need not be reduced: a part of the tolerance, or an error close to rounding. Large
    !> tolerances do not count, since a motion that turns off shows only if the error is less than the distance of the branches.
    pure real(wp) function sufficient_error(self)
        class(simulation_type), intent(in) :: self
        real(wp), parameter :: rounding = 5.0e-13_wp, largest = 1.0e-9_wp

        sufficient_error = max(min(small_part*self%options%relative_tolerance(), largest), rounding)
    end function sufficient_error

    !> Compare the error with those of earlier tries. Close to the configuration, nearer states that have not reduced it will not
    !> reduce it any more.
    subroutine compare(self, is_collocated, is_falling)
        class(simulation_type), intent(inout) :: self
        !> True if the error is that of a collocation.
        logical, intent(in) :: is_collocated
        !> True if the error falls with the distance.
        logical, intent(inout) :: is_falling
        !> Part of the error that is a reduction; part of the distance by which a time may be off; part of the best independence
        !> below which errors of states matter.
        real(wp), parameter :: falls = 0.9_wp, off = 0.1_wp, close = 0.05_wp

        associate (crossing => self%crossing, record => self%crossing%record)
            if (abs(crossing%tried_for - record%t) > off*(record%t - self%state%t)) then
                crossing%tried_error = huge(1.0_wp)
                crossing%tried_for = record%t
            end if
            if (self%state%t > crossing%turned_off_until) crossing%turned_off = huge(1.0_wp)
            if (.not. is_collocated .and. crossing%rate*(record%t - crossing%recent%t(1)) > close*self%chart%best_independence) then
                is_falling = .true.
            else
                is_falling = is_falling .and. record%error < falls*crossing%tried_error
            end if
            crossing%tried_error = min(crossing%tried_error, record%error)
        end associate
    end subroutine compare

    !> Decide if the step is accepted: by its error, by the branches, by the rank of C at its end, and by the constraints within it.
    subroutine judge(self, is_limited, is_accepted)
        class(simulation_type), intent(inout) :: self
        !> True if errors of states limit the error: nearer states do not reduce it.
        logical, intent(in) :: is_limited
        logical, intent(out) :: is_accepted
        !> Error of the states due to the steps between them, in tolerances.
        real(wp), parameter :: of_steps = 0.3_wp
        !> Where an earlier try found that the motion turns off, errors must be smaller than this part of what it found.
        real(wp), parameter :: surely_less = 0.1_wp
        !> Part of the best independence below which errors of states make steps short; such a step, relative to the time left.
        real(wp), parameter :: close = 0.05_wp, short = 0.01_wp
        real(wp) :: moved, errors(3), norm, left
        type(measure_type) :: measure
        integer :: i, rows(3), stat
        logical :: is_last_chance

        is_accepted = .false.
        is_last_chance = .true.
        associate (crossing => self%crossing, state => self%crossing%trial, record => self%crossing%record)
            norm = 0.0_wp
            if (self%options%is_adaptive()) then
                ! The next state would be too near, or errors of states make steps short.
                left = crossing%rate*(record%t - self%state%t)/self%chart%best_independence
                is_last_chance = is_limited .or. left < 4*least_part .or. (left < close .and. self%control%h < &
                    short*(record%t - self%state%t))
                call self%control%set_weights(self%state%q, state%q, self%state%qd, state%qd)
                do i = 1, size(state%q)
                    norm = max(norm, abs(state%dq(i))*self%control%weight_q(i), abs(state%dqd(i))*self%control%weight_qd(i))
                end do
                ! Tolerances grow with the angle of bodies that turn, errors of crossings need not.
                norm = max(norm, record%error/self%options%relative_tolerance())
                norm = norm/merge(last_part, sufficient_error(self)/self%options%relative_tolerance(), is_last_chance)
            end if
            crossing%obstacle = 'a function of time changes within the step over it'
            if (self%model%hides(self%state%t, state%t, .true.)) return
            crossing%obstacle = 'the motion behind it is uncertain by '//to_text(record%error)
            if (is_last_chance .and. record%error <= sure_error) norm = 0.0_wp
            if (self%options%is_adaptive() .and. record%error > doubtful_error) return
            if (.not. (norm <= 1.0_wp .and. crossing%spread <= largest_error)) return
            call crossing%curve%evaluate(record%t, crossing%predicted%q, crossing%predicted%qd, crossing%predicted%qdd)
            crossing%predicted%q(:) = state%q - crossing%predicted%q
            moved = self%model%largest_on_scales(crossing%predicted%q)
            crossing%obstacle = 'the velocity through it is too small to tell branches apart'
            if (.not. (crossing%apart(1) <= clear_part*moved .and. &
                crossing%apart(2) <= clear_part*self%model%largest_on_scales(state%qd))) return
            crossing%obstacle = 'the constraints do not regain their rank behind it'
            call self%chart%measure(need_independence, self%state%t, self%state%q, state%t, state%q, state%qd, measure, stat)
            if (stat /= status_ok .or. .not. measure%independence > 0.2_wp*crossing%rate*(state%t - record%t)) return
            crossing%obstacle = 'the continued motion does not satisfy the constraints'
            if (.not. stays_near(self) .or. crossing%spread > surely_less*crossing%turned_off) return
            call self%chart%find_errors(state%t, state%q, state%qd, state%qdd, errors, rows, stat)
            is_accepted = stat == status_ok .and. maxval(errors) <= self%options%constraint_tolerance
            ! The states lie on neighbouring motions, which differ by the errors of the steps between them.
            if (self%options%is_adaptive()) record%error = max(record%error, of_steps*self%options%relative_tolerance())
            if (is_accepted) crossing%obstacle = ''
        end associate
    end subroutine judge

    !> True if the polynomial satisfies the constraints close to the configuration. Where the motion only passes near a
    !> configuration of lower rank and turns off, the polynomial passes between two branches, and its distance from them grows with
    !> the inverse of the independence; errors of the polynomial do not.
    logical function stays_near(self)
        class(simulation_type), intent(inout) :: self
        !> Part of the best independence there; rounding error of the position; growth of the distance between both.
        real(wp), parameter :: parts(2) = [1.0e-3_wp, 1.0e-4_wp], rounding = 1.0e-9_wp, grows = 3.0_wp
        real(wp) :: t, distance, last_distance
        integer :: k, stat

        stays_near = .false.
        last_distance = huge(1.0_wp)
        associate (crossing => self%crossing, there => self%crossing%predicted)
            do k = 1, size(parts)
                t = crossing%record%t + min(parts(k)*self%chart%best_independence/crossing%rate, &
                    0.1_wp*(crossing%trial%t - crossing%record%t))
                call crossing%curve%evaluate(t, there%q, there%qd, there%qdd)
                there%dq(:) = there%q
                call self%chart%project(t, there%q, there%qd, .true., stat, exactly=.true.)
                stays_near = stat == status_ok
                if (.not. stays_near) return
                there%dq(:) = there%q - there%dq
                there%dqd(:) = 0.0_wp
                distance = self%local_error%largest_part(crossing%trial, there%dq, there%dqd)
                stays_near = distance <= crossing%spread + rounding .and. distance <= grows*min(last_distance, 1.0_wp) + &
                    rounding*(1.0_wp + self%model%largest_on_scales(there%q))
                if (.not. stays_near) then
                    crossing%turned_off = min(crossing%turned_off, distance)
                    crossing%turned_off_until = crossing%record%t_to
                    return
                end if
                last_distance = distance
            end do
        end associate
    end function stays_near

    module procedure note_end
        !> Far from a loss of rank, one of so many steps is stored.
        integer(long), parameter :: far = 4
        type(crossing_record_type), allocatable :: longer(:)

        associate (crossing => self%crossing)
            if (.not. crossing%is_on) return
            if (crossing%is_last_step) then
                if (crossing%record%t <= self%state%t .and. .not. crossing%is_listed) then
                    if (.not. allocated(self%crossings)) allocate (self%crossings(16))
                    if (self%n_crossings == size(self%crossings)) then
                        allocate (longer(2*self%n_crossings))
                        longer(:self%n_crossings) = self%crossings
                        call move_alloc(longer, self%crossings)
                    end if
                    self%n_crossings = self%n_crossings + 1
                    self%crossings(self%n_crossings) = crossing%record
                    self%tally%crossings = self%tally%crossings + 1
                    self%tally%crossing_error = max(self%tally%crossing_error, crossing%record%error)
                    crossing%is_listed = .true.
                end if
                ! States before the configuration may be as inaccurate as they were near.
                call crossing%recent%forget()
                ! Charts reach no further than to a configuration in which C loses rank, nor do matrices and corrections of earlier
                ! steps.
                self%renewal%reason = by_failure
            else if (crossing%recent%is_full() .and. self%lost_rank%is_far() .and. modulo(self%tally%steps, far) /= 0) then
                return
            end if
            ! Within a crossing, accelerations may be those of the polynomial.
            if (.not. crossing%starts) call crossing%note(self%state)
        end associate
    end procedure note_end

    module procedure look_into_crossing
        call take_from_curve(self, t, self%state, stat)
    end procedure look_into_crossing

    !> The state at a time within the crossing, or at its end, which satisfies the constraints.
    subroutine take_from_curve(self, t, state, stat)
        class(simulation_type), intent(inout) :: self
        real(wp), intent(in) :: t
        type(state_type), intent(inout) :: state
        integer, intent(out) :: stat

        associate (crossing => self%crossing, record => self%crossing%record)
            state%t = t
            call crossing%curve%evaluate(t, state%q, state%qd, state%qdd)
            stat = status_ok
            if (abs(t - record%t) < crossing%near .and. t < record%t_to) return
            call self%chart%project(t, state%q, state%qd, .true., stat, exactly=.true.)
            if (stat == status_ok) call self%chart%accelerate(t, state%q, state%qd, step_end, state%qdd, stat)
        end associate
    end subroutine take_from_curve

    module procedure leave_start
        integer :: stat

        call prepare(self)
        call take_from_curve(self, self%crossing%record%t_to, self%crossing%trial, stat)
        if (stat /= status_ok) then
            call self%fail(stat, 'in the first step, from a singular configuration', error)
            return
        end if
        self%crossing%starts = .false.
        call go_over(self, stop_at)
    end procedure leave_start

    !> Make the step: its end is the next state. A stop before it divides the step: the next one starts on the same polynomial.
    subroutine go_over(self, stop_at)
        class(simulation_type), intent(inout) :: self
        real(wp), intent(in) :: stop_at
        integer :: i, stat

        associate (crossing => self%crossing, next => self%next, state => self%state, trial => self%crossing%trial)
            crossing%starts = stop_at < trial%t
            if (crossing%starts) then
                call take_from_curve(self, stop_at, trial, stat)
                if (stat /= status_ok) call crossing%curve%evaluate(stop_at, trial%q, trial%qd, trial%qdd)
            end if
            next%t = trial%t
            do i = 1, size(next%q)
                next%q(i) = trial%q(i)
                next%qd(i) = trial%qd(i)
                next%qdd(i) = trial%qdd(i)
                next%dq(i) = state%dq(i) + (trial%q(i) - state%q(i))
                next%dqd(i) = state%dqd(i) + (trial%qd(i) - state%qd(i))
            end do
        end associate
        self%crossing%is_last_step = .true.
        self%lost_rank = lost_rank_type()
        call self%chart%forget_rank()
        call self%chart%set_memory()
        call self%local_error%restart()
        call self%local_error%add(self%crossing%record%error, 1)
        self%attempts%cause = status_ok
        self%attempts%n_collapsed = 0
        call self%attempts%slowing%restart()
    end subroutine go_over
end submodule tandem_simulate_crossing
