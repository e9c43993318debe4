! SPDX-License-Identifier: MIT
!> Decides, for the stepper `auto`, whether another stepper would cost less from now on, based on observations of the run.
!>
!> Before the first step, a power iteration with differences of rates gives the largest eigenvalue. The implicit method begins if
!> this eigenvalue limits explicit steps to far less than the size of the first implicit step.
!>
!> During explicit steps, the smoothness of the motion gives the number of steps of the implicit method, and thus its cost. This
!> applies not only if stability limits the steps, but also before, if stiff components cause the errors.
!>
!> During implicit steps, the largest eigenvalue gives the size of explicit steps, and recent steps give the cost of implicit steps.
!> After an exchange that was reversed soon, more evidence is required for the next exchange, so that attempts cost only a small
!> part of a run.
module tandem_simulate_switching
    use tandem_chart, only: chart_memory_type, chart_type, step_end
    use tandem_kinds, only: long, wp
    use tandem_pack, only: pack_type
    use tandem_status, only: status_ok
    use tandem_stepper_state, only: state_type
    implicit none (type, external)
    private

    public :: switching_type, cost_of_implicit, looks

    !> Number of estimates of the largest eigenvalue required for an exchange. From the second estimate on, one that contradicts the
    !> exchange ends the attempt.
    integer, parameter :: looks = 6

    type :: switching_type
        !> True if steppers are exchanged; true if the implicit stepper is active.
        logical :: is_on = .false., is_implicit = .false.
        !> Number of exchanges so far.
        integer(long) :: switches = 0
        !> Number of implicit steps until the last query.
        integer(long), private :: implicit_steps = 0
        !> Number of accepted steps at the last query; at the start of the observed interval: number of step attempts, number of
        !> steps required by the smoothness of the motion, and time; number of accepted steps at the last exchange.
        integer(long), private :: asked = -1, attempts_from = 0, steps_from = 0
        real(wp), private :: needed_from = 0.0_wp
        real(wp) :: t_from = 0.0_wp
        !> Explicit step attempts per unit of time before the exchange, and their ratio to the number that stability requires; 0 if
        !> unknown.
        real(wp), private :: rate = 0.0_wp, excess = 0.0_wp
        !> Size of a first step with the implicit method, 0 if unknown.
        real(wp) :: first_step = 0.0_wp
        !> Order of the implicit method's error estimate.
        integer :: estimate_order = 0
        !> Factor by which more than the usual evidence is required.
        integer, private :: evidence_factor = 1
        !> Last estimate of the largest eigenvalue, and last growth of the direction; direction (n), of q and of qd.
        real(wp) :: lambda = 0.0_wp
        real(wp), private :: growth = 0.0_wp
        real(wp), allocatable, private :: direction_q(:), direction_qd(:)
        !> Coordinate scales (n), and a state displaced along the direction.
        real(wp), allocatable, private :: scale(:)
        !> Reciprocal of the time scale, the smallest relevant eigenvalue.
        real(wp), private :: least = 1.0_wp
        type(state_type), private :: moved
        !> Saved chart for the next step, while other points are evaluated.
        class(chart_memory_type), allocatable, private :: memory
    contains
        procedure :: begin, is_asked
        procedure :: count_implicit, may_begin_implicit, begins_implicit, wants_implicit
        procedure :: is_due, wants_explicit, note_decision
        procedure :: begin_estimation, may_oppose, estimate_eigenvalue, first_step_at, note_switch, pack_state
    end type switching_type

    !> Largest ratio of costs for which an exchange is made.
    real(wp), parameter :: worthwhile_ratio = 0.8_wp
    !> Number of attempts for an estimate of costs; number of steps below which a return is soon; largest value of
    !> `evidence_factor`.
    integer, parameter :: window = 20, soon = 400, longest = 64
    !> Smaller number of attempts, and ratio of costs, that suffice as evidence.
    integer, parameter :: few = 6
    real(wp), parameter :: strong_ratio = 0.5_wp

contains

    !> Cost of a step of the implicit method in explicit stages: 27 to 37 in the shipped scenes, with derivatives of the model. A
    !> new matrix is made in less than every third step.
    pure real(wp) function cost_of_implicit(n_differences)
        !> Number of coordinates with derivatives by differences; 0 if the model provides derivatives.
        integer, intent(in) :: n_differences
        real(wp), parameter :: cost = 40.0_wp, matrices = 0.3_wp

        cost_of_implicit = cost + matrices*2*real(n_differences, wp)
    end function cost_of_implicit

    !> Begin a run at time t with the given coordinate scales (n) and time scale.
    subroutine begin(self, is_on, scale, time_scale, t, estimate_order)
        class(switching_type), intent(inout) :: self
        logical, intent(in) :: is_on
        real(wp), intent(in) :: scale(:), time_scale, t
        !> Order of the error estimate of the implicit method, if there is one.
        integer, intent(in) :: estimate_order
        integer :: i

        self%is_on = is_on
        self%estimate_order = estimate_order
        self%is_implicit = .false.
        self%switches = 0
        self%implicit_steps = 0
        self%asked = -1
        self%attempts_from = 0
        self%steps_from = 0
        self%needed_from = 0.0_wp
        self%t_from = t
        self%evidence_factor = 1
        self%rate = 0.0_wp
        self%excess = 0.0_wp
        self%lambda = 0.0_wp
        self%growth = 0.0_wp
        self%first_step = 0.0_wp
        if (.not. is_on) return
        ! A direction without symmetry, so that no component is missing.
        self%direction_q = [(cos(3.0_wp*real(i, wp)), i=1, size(scale))]
        self%direction_qd = [(sin(5.0_wp*real(i, wp)), i=1, size(scale))]
        self%scale = scale
        self%least = 1.0_wp/time_scale
        call self%moved%allocate(size(scale))
    end subroutine begin

    !> True if a step was accepted since the last query.
    logical function is_asked(self, steps)
        class(switching_type), intent(inout) :: self
        !> Number of accepted steps so far.
        integer(long), intent(in) :: steps

        is_asked = self%is_on .and. steps > self%asked
        if (.not. is_asked) return
        self%implicit_steps = self%count_implicit(steps)
        self%asked = steps
    end function is_asked

    !> Number of implicit steps so far.
    pure integer(long) function count_implicit(self, steps)
        class(switching_type), intent(in) :: self
        !> Number of accepted steps so far.
        integer(long), intent(in) :: steps

        count_implicit = self%implicit_steps
        if (self%is_implicit) count_implicit = count_implicit + (steps - self%asked)
    end function count_implicit

    !> True if the implicit method would cost less than the active explicit method. Strong evidence counts early if stability limits
    !> the steps, because they will not become longer.
    logical function wants_implicit(self, t, is_free, is_at_limit, needed, open, attempts, stages, cost)
        class(switching_type), intent(inout) :: self
        !> Time; true if only errors and stability limited the last step; true if stability limited it.
        real(wp), intent(in) :: t
        logical, intent(in) :: is_free, is_at_limit
        !> Number of steps required by the smoothness of the motion so far, and number of step attempts.
        real(wp), intent(in) :: needed
        integer(long), intent(in) :: attempts
        !> Number of steps required in the current window, since `t_from`.
        real(wp), intent(in) :: open
        !> Number of stages per step; cost of an implicit step.
        integer, intent(in) :: stages
        real(wp), intent(in) :: cost
        real(wp) :: part

        wants_implicit = .false.
        ! Another method would have required this step too.
        if (.not. is_free) self%attempts_from = min(self%attempts_from + 1, attempts)
        part = cost/(real(max(attempts - self%attempts_from, 1_long), wp)*real(stages, wp))
        if (attempts - self%attempts_from < int(window*self%evidence_factor, long)) then
            if (.not. (is_at_limit .and. open > 0.0_wp)) return
            if (self%evidence_factor > 1 .or. attempts - self%attempts_from < int(few, long)) return
            wants_implicit = part*(needed - self%needed_from + open) < strong_ratio
            if (.not. wants_implicit) return
        else
            ! Count the current window of the motion as at least one step.
            wants_implicit = part*(needed - self%needed_from + max(1.0_wp, open)) < worthwhile_ratio
        end if
        if (wants_implicit) then
            self%rate = real(attempts - self%attempts_from, wp)/max(t - self%t_from, tiny(1.0_wp))
            self%excess = 0.0_wp
        end if
        self%attempts_from = attempts
        self%needed_from = needed
        self%t_from = t
    end function wants_implicit

    !> True if the largest eigenvalue is to be estimated before a first step; false after an exchange that was reversed soon.
    pure logical function may_begin_implicit(self)
        class(switching_type), intent(in) :: self

        may_begin_implicit = self%is_on .and. .not. self%is_implicit .and. self%evidence_factor == 1 .and. self%first_step > 0.0_wp
    end function may_begin_implicit

    !> True if the implicit method would cost less than the explicit method with steps limited by stability. The first implicit step
    !> is chosen for a hundredth of the tolerance; later ones are longer by the corresponding root.
    pure logical function begins_implicit(self, first_step, stages, limit, cost)
        class(switching_type), intent(in) :: self
        !> Size of the first step of the implicit method.
        real(wp), intent(in) :: first_step
        !> Number of stages of an explicit step; h |lambda| at its limit of stability; cost of an implicit step.
        integer, intent(in) :: stages
        real(wp), intent(in) :: limit, cost
        real(wp), parameter :: first_tolerance = 0.01_wp
        real(wp) :: step

        step = first_step*first_tolerance**(-1.0_wp/real(self%estimate_order + 1, wp))
        begins_implicit = cost < real(stages, wp)*step*self%lambda/limit
    end function begins_implicit

    !> Restart the estimation of the largest eigenvalue.
    pure subroutine begin_estimation(self)
        class(switching_type), intent(inout) :: self

        self%growth = 0.0_wp
    end subroutine begin_estimation

    !> Perform a step of the power iteration, given the rates at a state that is slightly displaced along the direction. The product
    !> of two successive growth factors is also correct for a pair of eigenvalues.
    subroutine estimate_eigenvalue(self, chart, state)
        class(switching_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        type(state_type), intent(in) :: state
        real(wp), parameter :: small = 1.0e-7_wp
        real(wp) :: before, after, unit, growth, largest
        integer :: stat

        associate (moved => self%moved, scale => self%scale)
            moved%t = state%t
            moved%dq(:) = state%dq + small*scale*self%direction_q
            moved%dqd(:) = state%dqd + small*scale*self%direction_qd*max(self%lambda, self%least)
            call chart%get_memory(self%memory)
            call chart%restore(moved%t, moved%dq, moved%dqd, step_end, moved%q, moved%qd, stat)
            if (stat == status_ok) call chart%accelerate(moved%t, moved%q, moved%qd, step_end, moved%qdd, stat)
            call chart%set_memory(self%memory)
            if (stat /= status_ok) return
            ! Velocities are divided by the eigenvalue.
            unit = 1.0_wp/max(self%lambda, self%least)
            before = sqrt(sum(((moved%q - state%q)/scale)**2) + unit**2*sum(((moved%qd - state%qd)/scale)**2))
            after = sqrt(sum(((moved%qd - state%qd)/scale)**2) + unit**2*sum(((moved%qdd - state%qdd)/scale)**2))
            if (.not. (before > 0.0_wp .and. after > 0.0_wp .and. after <= huge(after))) return
            growth = after/before
            if (self%growth > 0.0_wp) self%lambda = sqrt(growth*self%growth)
            self%growth = growth
            self%direction_q = (moved%qd - state%qd)/scale
            self%direction_qd = unit*(moved%qdd - state%qdd)/scale
            largest = max(maxval(abs(self%direction_q)), maxval(abs(self%direction_qd)), tiny(1.0_wp))
            self%direction_q = self%direction_q/largest
            self%direction_qd = self%direction_qd/largest
        end associate
    end subroutine estimate_eigenvalue

    !> True if there were enough implicit steps to consider the explicit method again.
    pure logical function is_due(self, attempts)
        class(switching_type), intent(in) :: self
        !> Number of step attempts so far.
        integer(long), intent(in) :: attempts

        is_due = attempts - self%attempts_from >= int(window/2*self%evidence_factor, long)
    end function is_due

    !> True if a single estimate may prevent an exchange; false while estimates must also determine the excess of explicit steps.
    pure logical function may_oppose(self)
        class(switching_type), intent(in) :: self

        may_oppose = self%excess > 0.0_wp .or. .not. self%rate > 0.0_wp
    end function may_oppose

    !> True if the explicit method would cost less than the active implicit method, given the estimated largest eigenvalue.
    pure logical function wants_explicit(self, t, attempts, stages, limit, cost)
        class(switching_type), intent(in) :: self
        !> Time, and number of step attempts so far.
        real(wp), intent(in) :: t
        integer(long), intent(in) :: attempts
        !> Number of stages of an explicit step; h |lambda| at its limit of stability; cost of an implicit step.
        integer, intent(in) :: stages
        real(wp), intent(in) :: limit, cost
        real(wp) :: explicit, implicit

        wants_explicit = .false.
        if (.not. self%lambda > 0.0_wp) return
        ! Costs per unit of time. Limits due to errors apply to both methods.
        implicit = cost*real(attempts - self%attempts_from, wp)/max(t - self%t_from, tiny(1.0_wp))
        explicit = real(stages, wp)*max(excess_of(self, limit)*self%lambda/limit, implicit/cost)
        wants_explicit = explicit < worthwhile_ratio*implicit
    end function wants_explicit

    !> Record a query about the explicit method, and begin a new interval of observation.
    pure subroutine note_decision(self, t, attempts, limit)
        class(switching_type), intent(inout) :: self
        real(wp), intent(in) :: t
        integer(long), intent(in) :: attempts
        real(wp), intent(in) :: limit

        if (self%lambda > 0.0_wp) self%excess = excess_of(self, limit)
        self%attempts_from = attempts
        self%t_from = t
    end subroutine note_decision

    !> Ratio of the number of explicit steps to the number that stability requires, since errors of stiff components shorten them
    !> further. It was measured before the exchange; without a measurement, the ratio of damped springs is assumed.
    pure real(wp) function excess_of(self, limit)
        class(switching_type), intent(in) :: self
        real(wp), intent(in) :: limit
        real(wp), parameter :: default_excess = 3.0_wp, most_excess = 30.0_wp

        excess_of = self%excess
        if (excess_of > 0.0_wp) return
        excess_of = default_excess
        if (self%rate > 0.0_wp) excess_of = min(most_excess, max(1.0_wp, self%rate*limit/self%lambda))
    end function excess_of

    !> Size of a step that replaces the first one of the run, at a time after its start; 0 if this is too late or not the first
    !> exchange.
    pure real(wp) function first_step_at(self, after)
        class(switching_type), intent(in) :: self
        real(wp), intent(in) :: after

        first_step_at = 0.0_wp
        if (self%switches == 0 .and. after < self%first_step) first_step_at = self%first_step
    end function first_step_at

    !> Record an exchange of steppers.
    subroutine note_switch(self, t, steps, attempts, needed)
        class(switching_type), intent(inout) :: self
        !> Time; numbers of accepted steps, of step attempts, and of steps required by the motion so far.
        real(wp), intent(in) :: t
        integer(long), intent(in) :: steps, attempts
        real(wp), intent(in) :: needed

        if (self%switches > 0 .and. steps - self%steps_from < int(soon, long)) then
            self%evidence_factor = min(2*self%evidence_factor, longest)
        else
            self%evidence_factor = 1
        end if
        self%is_implicit = .not. self%is_implicit
        self%switches = self%switches + 1
        self%steps_from = steps
        self%attempts_from = attempts
        self%t_from = t
        self%needed_from = needed
        self%growth = 0.0_wp
    end subroutine note_switch

    !> Pack the data of the next exchange. The caller packs `is_implicit` before, because it must allocate the stepper first.
    subroutine pack_state(self, pack)
        class(switching_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%is_on)
        call pack%item(self%switches, self%implicit_steps, self%asked, self%attempts_from, self%steps_from)
        call pack%item(self%needed_from, self%t_from, self%rate, self%excess, self%first_step)
        call pack%item(self%evidence_factor)
        call pack%item(self%lambda, self%growth)
        if (.not. allocated(self%direction_q)) return
        call pack%item(self%direction_q, self%direction_qd)
    end subroutine pack_state
end module tandem_simulate_switching
