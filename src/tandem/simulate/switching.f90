! SPDX-License-Identifier: MIT
!> Decides if another stepper would be cheaper from here on: for the stepper `auto`, by the run's own evidence.
!>
!> Before the first step: the largest eigenvalue, by power iteration on differences of rates, makes explicit steps far shorter than
!> the first implicit one would be.
!> While steps are explicit: the implicit method would need so few steps, judged by the smoothness of the motion, that it costs
!> less. This holds if stability limits the steps; but even before that, their errors are due to stiff components.
!> While they are implicit: the largest eigenvalue gives the length of explicit steps, and the last steps give the cost of implicit
!> ones. After a method that returns soon the next exchange is delayed, so that useless tries cost a small part of a run.
module tandem_simulate_switching
    use tandem_chart, only: chart_memory_type, chart_type, step_end
    use tandem_kinds, only: long, wp
    use tandem_pack, only: pack_type
    use tandem_status, only: status_ok
    use tandem_stepper_state, only: state_type
    implicit none (type, external)
    private

    public :: switching_type, cost_of_implicit, looks

    !> Number of estimates of the largest eigenvalue for an exchange, unless one of them, from the second on, opposes it.
    integer, parameter :: looks = 6

    type :: switching_type
        !> True if steppers are exchanged; true if the implicit one is active.
        logical :: is_on = .false., is_implicit = .false.
        !> Exchanges so far.
        integer(long) :: switches = 0
        !> Implicit steps until the last query.
        integer(long), private :: implicit_steps = 0
        !> Accepted steps at the last query; tries, steps of the motion itself and the time at the start of the observed interval,
        !> and accepted steps at the last exchange.
        integer(long), private :: asked = -1, tries_from = 0, steps_from = 0
        real(wp), private :: needed_from = 0.0_wp
        real(wp) :: t_from = 0.0_wp
        !> Tries per unit of time of the explicit method before the exchange, and their ratio to the number required by stability; 0
        !> if unknown.
        real(wp), private :: rate = 0.0_wp, excess = 0.0_wp
        !> First step with the implicit method, 0 if unknown.
        real(wp) :: first_step = 0.0_wp
        !> Order of the implicit method's error estimate.
        integer :: estimate_order = 0
        !> Factor of the evidence required, relative to the usual.
        integer, private :: patience = 1
        !> The last estimate of the largest eigenvalue, and the last stretch of the direction; that direction (n): of q and of qd.
        real(wp) :: lambda = 0.0_wp
        real(wp), private :: stretch = 0.0_wp
        real(wp), allocatable, private :: direction_q(:), direction_qd(:)
        !> The coordinates' scales (n), and a state displaced along that direction.
        real(wp), allocatable, private :: scale(:)
        !> 1 over the time scale, the least relevant eigenvalue.
        real(wp), private :: least = 1.0_wp
        type(state_type), private :: moved
        !> The chart's start of the next step, while other points are evaluated.
        class(chart_memory_type), allocatable, private :: memory
    contains
        procedure :: begin, is_asked
        procedure :: count_implicit, may_begin_implicit, begins_implicit, wants_implicit
        procedure :: is_due, wants_explicit, note_decision
        procedure :: begin_looks, is_certain, look_at_eigenvalue, first_step_at, note_switch, pack_state
    end type switching_type

    !> Largest ratio of costs for which an exchange is made.
    real(wp), parameter :: worth = 0.8_wp
    !> Tries for an estimate of costs, number of steps below which a return is soon, and the largest patience.
    integer, parameter :: window = 20, soon = 400, longest = 64
    !> Tries, and the ratio of costs, that are sufficient evidence before that.
    integer, parameter :: few = 6
    real(wp), parameter :: strong = 0.5_wp

contains

    !> Cost of a step of the implicit method, in explicit stages: 27 to 37 on the scenes, with the model's derivatives. A new matrix
    !> is made in less than every third step.
    pure real(wp) function cost_of_implicit(n_differences)
        !> Number of coordinates with derivatives by differences; 0 if the model provides them.
        integer, intent(in) :: n_differences
        real(wp), parameter :: cost = 40.0_wp, matrices = 0.3_wp

        cost_of_implicit = cost + matrices*2*real(n_differences, wp)
    end function cost_of_implicit

    !> Begin a run with coordinate scales (n) and the time scale of the model at a time.
    subroutine begin(self, is_on, scale, time_scale, t, estimate_order)
        class(switching_type), intent(inout) :: self
        logical, intent(in) :: is_on
        real(wp), intent(in) :: scale(:), time_scale, t
        !> Order of the implicit method, if there is one.
        integer, intent(in) :: estimate_order
        integer :: i

        self%is_on = is_on
        self%estimate_order = estimate_order
        self%is_implicit = .false.
        self%switches = 0
        self%implicit_steps = 0
        self%asked = -1
        self%tries_from = 0
        self%steps_from = 0
        self%needed_from = 0.0_wp
        self%t_from = t
        self%patience = 1
        self%rate = 0.0_wp
        self%excess = 0.0_wp
        self%lambda = 0.0_wp
        self%stretch = 0.0_wp
        self%first_step = 0.0_wp
        if (.not. is_on) return
        ! A direction that no symmetry of a model makes blind.
        self%direction_q = [(cos(3.0_wp*real(i, wp)), i=1, size(scale))]
        self%direction_qd = [(sin(5.0_wp*real(i, wp)), i=1, size(scale))]
        self%scale = scale
        self%least = 1.0_wp/time_scale
        call self%moved%allocate(size(scale))
    end subroutine begin

    !> True if a step was accepted since the last query.
    logical function is_asked(self, steps)
        class(switching_type), intent(inout) :: self
        !> Accepted steps so far.
        integer(long), intent(in) :: steps

        is_asked = self%is_on .and. steps > self%asked
        if (.not. is_asked) return
        self%implicit_steps = self%count_implicit(steps)
        self%asked = steps
    end function is_asked

    !> Implicit steps so far.
    pure integer(long) function count_implicit(self, steps)
        class(switching_type), intent(in) :: self
        !> Accepted steps so far.
        integer(long), intent(in) :: steps

        count_implicit = self%implicit_steps
        if (self%is_implicit) count_implicit = count_implicit + (steps - self%asked)
    end function count_implicit

    !> True if the implicit method would be cheaper than the active explicit one. If stability limits the steps, strong evidence
    !> counts early: they will not become longer.
    logical function wants_implicit(self, t, is_free, is_at_limit, needed, open, tries, stages, cost)
        class(switching_type), intent(inout) :: self
        !> Time; true if only errors and stability have limited the last step; true if stability has.
        real(wp), intent(in) :: t
        logical, intent(in) :: is_free, is_at_limit
        !> Steps that the motion itself would have taken so far, and tries of steps that were made.
        real(wp), intent(in) :: needed
        integer(long), intent(in) :: tries
        !> Steps of the motion in the current window, since `t_from`.
        real(wp), intent(in) :: open
        !> Stages of a step, and the cost of an implicit step.
        integer, intent(in) :: stages
        real(wp), intent(in) :: cost
        real(wp) :: part

        wants_implicit = .false.
        ! Another method would have needed this one, too.
        if (.not. is_free) self%tries_from = min(self%tries_from + 1, tries)
        part = cost/(real(max(tries - self%tries_from, 1_long), wp)*real(stages, wp))
        if (tries - self%tries_from < int(window*self%patience, long)) then
            if (.not. (is_at_limit .and. open > 0.0_wp) .or. self%patience > 1 .or. tries - self%tries_from < int(few, long)) return
            wants_implicit = part*(needed - self%needed_from + open) < strong
            if (.not. wants_implicit) return
        else
            ! The current window of the motion counts as at least one step.
            wants_implicit = part*(needed - self%needed_from + max(1.0_wp, open)) < worth
        end if
        if (wants_implicit) then
            self%rate = real(tries - self%tries_from, wp)/max(t - self%t_from, tiny(1.0_wp))
            self%excess = 0.0_wp
        end if
        self%tries_from = tries
        self%needed_from = needed
        self%t_from = t
    end function wants_implicit

    !> True if the largest eigenvalue is to be estimated before a first step: false if an exchange was in vain.
    pure logical function may_begin_implicit(self)
        class(switching_type), intent(in) :: self

        may_begin_implicit = self%is_on .and. .not. self%is_implicit .and. self%patience == 1 .and. self%first_step > 0.0_wp
    end function may_begin_implicit

    !> True if the implicit method would be cheaper than the explicit one with steps limited by stability. The error of a first step
    !> is a hundredth of the tolerance: later ones are longer by the corresponding root.
    pure logical function begins_implicit(self, first_step, stages, limit, cost)
        class(switching_type), intent(in) :: self
        !> Of the implicit method.
        real(wp), intent(in) :: first_step
        !> Stages of an explicit step, h |lambda| at its limit of stability, and the cost of an implicit step.
        integer, intent(in) :: stages
        real(wp), intent(in) :: limit, cost
        real(wp), parameter :: caution = 0.01_wp
        real(wp) :: step

        step = first_step*caution**(-1.0_wp/real(self%estimate_order + 1, wp))
        begins_implicit = cost < real(stages, wp)*step*self%lambda/limit
    end function begins_implicit

    !> Restart the estimate of the largest eigenvalue.
    pure subroutine begin_looks(self)
        class(switching_type), intent(inout) :: self

        self%stretch = 0.0_wp
    end subroutine begin_looks

    !> A step of the power iteration, from the rates at a state that is displaced a little along the direction. The product of two
    !> successive stretches is also right for a pair of eigenvalues.
    subroutine look_at_eigenvalue(self, chart, state)
        class(switching_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        type(state_type), intent(in) :: state
        real(wp), parameter :: small = 1.0e-7_wp
        real(wp) :: before, after, unit, stretch, largest
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
            ! Velocities count in units of the eigenvalue.
            unit = 1.0_wp/max(self%lambda, self%least)
            before = sqrt(sum(((moved%q - state%q)/scale)**2) + unit**2*sum(((moved%qd - state%qd)/scale)**2))
            after = sqrt(sum(((moved%qd - state%qd)/scale)**2) + unit**2*sum(((moved%qdd - state%qdd)/scale)**2))
            if (.not. (before > 0.0_wp .and. after > 0.0_wp .and. after <= huge(after))) return
            stretch = after/before
            if (self%stretch > 0.0_wp) self%lambda = sqrt(stretch*self%stretch)
            self%stretch = stretch
            self%direction_q = (moved%qd - state%qd)/scale
            self%direction_qd = unit*(moved%qdd - state%qdd)/scale
            largest = max(maxval(abs(self%direction_q)), maxval(abs(self%direction_qd)), tiny(1.0_wp))
            self%direction_q = self%direction_q/largest
            self%direction_qd = self%direction_qd/largest
        end associate
    end subroutine look_at_eigenvalue

    !> True if there were enough implicit steps to consider the explicit method again.
    pure logical function is_due(self, tries)
        class(switching_type), intent(in) :: self
        !> Tries of steps so far.
        integer(long), intent(in) :: tries

        is_due = tries - self%tries_from >= int(window/2*self%patience, long)
    end function is_due

    !> True if one estimate may oppose an exchange: not while it must also determine the excess of explicit steps.
    pure logical function is_certain(self)
        class(switching_type), intent(in) :: self

        is_certain = self%excess > 0.0_wp .or. .not. self%rate > 0.0_wp
    end function is_certain

    !> True if the explicit method would be cheaper than the active implicit one, by the known estimate of the largest eigenvalue.
    pure logical function wants_explicit(self, t, tries, stages, limit, cost)
        class(switching_type), intent(in) :: self
        !> Time, and tries of steps so far.
        real(wp), intent(in) :: t
        integer(long), intent(in) :: tries
        !> Stages of an explicit step, h |lambda| at its limit of stability, and the cost of an implicit step.
        integer, intent(in) :: stages
        real(wp), intent(in) :: limit, cost
        real(wp) :: explicit, implicit

        wants_explicit = .false.
        if (.not. self%lambda > 0.0_wp) return
        ! Costs per unit of time. Limits by errors apply to both methods.
        implicit = cost*real(tries - self%tries_from, wp)/max(t - self%t_from, tiny(1.0_wp))
        explicit = real(stages, wp)*max(excess_of(self, limit)*self%lambda/limit, implicit/cost)
        wants_explicit = explicit < worth*implicit
    end function wants_explicit

    !> Record a query for the explicit method; a new interval is observed from here on.
    pure subroutine note_decision(self, t, tries, limit)
        class(switching_type), intent(inout) :: self
        real(wp), intent(in) :: t
        integer(long), intent(in) :: tries
        real(wp), intent(in) :: limit

        if (self%lambda > 0.0_wp) self%excess = excess_of(self, limit)
        self%tries_from = tries
        self%t_from = t
    end subroutine note_decision

    !> Errors of stiff components make explicit steps shorter than stability does, by a ratio found before the exchange. If there
    !> were no such steps, the ratio of damped springs is assumed.
    pure real(wp) function excess_of(self, limit)
        class(switching_type), intent(in) :: self
        real(wp), intent(in) :: limit
        real(wp), parameter :: usual = 3.0_wp, most_excess = 30.0_wp

        excess_of = self%excess
        if (excess_of > 0.0_wp) return
        excess_of = usual
        if (self%rate > 0.0_wp) excess_of = min(most_excess, max(1.0_wp, self%rate*limit/self%lambda))
    end function excess_of

    !> Size of a step in place of the first one of the run, at a time after its start; 0 if that is too late, or it is not the first
    !> exchange.
    pure real(wp) function first_step_at(self, after)
        class(switching_type), intent(in) :: self
        real(wp), intent(in) :: after

        first_step_at = 0.0_wp
        if (self%switches == 0 .and. after < self%first_step) first_step_at = self%first_step
    end function first_step_at

    !> Record an exchange of steppers.
    subroutine note_switch(self, t, steps, tries, needed)
        class(switching_type), intent(inout) :: self
        !> Time, and steps, tries and steps of the motion itself so far.
        real(wp), intent(in) :: t
        integer(long), intent(in) :: steps, tries
        real(wp), intent(in) :: needed

        if (self%switches > 0 .and. steps - self%steps_from < int(soon, long)) then
            self%patience = min(2*self%patience, longest)
        else
            self%patience = 1
        end if
        self%is_implicit = .not. self%is_implicit
        self%switches = self%switches + 1
        self%steps_from = steps
        self%tries_from = tries
        self%t_from = t
        self%needed_from = needed
        self%stretch = 0.0_wp
    end subroutine note_switch

    !> State for the next exchange; the caller stores `is_implicit` before, because it must allocate the stepper first.
    subroutine pack_state(self, pack)
        class(switching_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%is_on)
        call pack%item(self%switches, self%implicit_steps, self%asked, self%tries_from, self%steps_from)
        call pack%item(self%needed_from, self%t_from, self%rate, self%excess, self%first_step)
        call pack%item(self%patience)
        call pack%item(self%lambda, self%stretch)
        if (.not. allocated(self%direction_q)) return
        call pack%item(self%direction_q, self%direction_qd)
    end subroutine pack_state
end module tandem_simulate_switching
