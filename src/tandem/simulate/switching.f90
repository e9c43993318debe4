! SPDX-License-Identifier: MIT
!> Whether another stepper would be cheaper from here on: for the stepper `auto`, by the run's own evidence.
!>
!> Before the first step: the largest eigenvalue, by power iteration on differences of rates, makes explicit steps far shorter than
!> the first implicit one would be.
!> While steps are explicit: the implicit method would do with so few steps, by how smooth the motion was, that it costs less. Where
!> stability limits the steps, that is so; but already before, their errors are those of what is stiff.
!> While they are implicit: the largest eigenvalue says how long explicit steps could be, and the last steps say what implicit ones
!> cost. A method that comes back soon waits longer for the next exchange, so that useless tries cost a small part of a run.
module tandem_simulate_switching
    use tandem_chart, only: chart_type
    use tandem_kinds, only: long, wp
    use tandem_pack, only: pack_type
    use tandem_status, only: status_ok
    use tandem_stepper_state, only: state_type
    implicit none (type, external)
    private

    public :: switching_type, cost_of_implicit, looks

    !> So many looks at the largest eigenvalue decide on an exchange, unless one of them, from the second on, speaks against it.
    integer, parameter :: looks = 6

    type :: switching_type
        !> Whether steppers are exchanged, and whether the implicit one is at work.
        logical :: is_on = .false., is_implicit = .false.
        !> Exchanges so far.
        integer(long) :: switches = 0
        !> Implicit steps until it was asked last.
        integer(long), private :: implicit_steps = 0
        !> Accepted steps when it was asked last; tries, steps of the motion itself and the time at the start of what is looked
        !> at, and accepted steps at the last exchange.
        integer(long), private :: asked = -1, tries_from = 0, steps_from = 0
        real(wp), private :: needed_from = 0.0_wp
        real(wp) :: t_from = 0.0_wp
        !> Tries in a unit of time of the explicit method before the exchange, and how many times that is what stability asks for; 0
        !> where it is not known yet.
        real(wp), private :: rate = 0.0_wp, excess = 0.0_wp
        !> What the first step would have been with the implicit method, 0 where it is not known.
        real(wp) :: first_step = 0.0_wp
        !> Order of the implicit method's error estimate.
        integer :: estimate_order = 0
        !> By how many times the usual evidence is not enough.
        integer, private :: patience = 1
        !> The largest eigenvalue as it was seen last, by how much the direction was stretched then; that direction (n): of q and
        !> of qd.
        real(wp) :: lambda = 0.0_wp
        real(wp), private :: stretch = 0.0_wp
        real(wp), allocatable, private :: direction_q(:), direction_qd(:)
        !> The coordinates' scales (n), and a state displaced along that direction.
        real(wp), allocatable, private :: scale(:)
        !> 1 over the time scale, the least eigenvalue of account.
        real(wp), private :: least = 1.0_wp
        type(state_type), private :: moved
    contains
        procedure :: begin, is_asked
        procedure :: count_implicit, may_begin_implicit, begins_implicit, wants_implicit
        procedure :: is_due, wants_explicit, note_decision
        procedure :: begin_looks, is_certain, look_at_eigenvalue, first_step_at, note_switch, pack_state
    end type switching_type

    !> The part of the cost that makes an exchange worth it.
    real(wp), parameter :: worth = 0.8_wp
    !> Tries that a look at costs takes, before which a return is soon, and the most patience.
    integer, parameter :: window = 20, soon = 400, longest = 64
    !> Tries, and the part of the cost, that are evidence enough before that.
    integer, parameter :: few = 6
    real(wp), parameter :: strong = 0.5_wp

contains

    !> What a step of the implicit method costs, in explicit stages: 27 to 37 on the scenes, with the model's derivatives. A new
    !> matrix is made in less than every third step.
    pure real(wp) function cost_of_implicit(n_differences)
        !> Coordinates by which derivatives are made by differences; 0 where the model gives them.
        integer, intent(in) :: n_differences
        real(wp), parameter :: cost = 40.0_wp, matrices = 0.3_wp

        cost_of_implicit = cost + matrices*2*real(n_differences, wp)
    end function cost_of_implicit

    !> Begin a run with coordinate scales (n) and the time scale of the model at a time.
    subroutine begin(self, is_on, scale, time_scale, t, estimate_order)
        class(switching_type), intent(inout) :: self
        logical, intent(in) :: is_on
        real(wp), intent(in) :: scale(:), time_scale, t
        !> Of the implicit method, where there is one.
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
        ! Any direction that no symmetry of a model makes blind.
        self%direction_q = [(cos(3.0_wp*real(i, wp)), i=1, size(scale))]
        self%direction_qd = [(sin(5.0_wp*real(i, wp)), i=1, size(scale))]
        self%scale = scale
        self%least = 1.0_wp/time_scale
        call self%moved%allocate(size(scale))
    end subroutine begin

    !> Whether an accepted step has come to the others since it was asked last.
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

    !> Whether the implicit method would be cheaper than the explicit one at work. Where stability limits the steps, strong
    !> evidence counts early: they will not become longer.
    logical function wants_implicit(self, t, is_free, is_at_limit, needed, open, tries, stages, cost)
        class(switching_type), intent(inout) :: self
        !> Where the run is, whether nothing but errors and stability has limited the last step, and whether stability has.
        real(wp), intent(in) :: t
        logical, intent(in) :: is_free, is_at_limit
        !> Steps that the motion itself would have taken so far, and tries of steps that were made.
        real(wp), intent(in) :: needed
        integer(long), intent(in) :: tries
        !> Those that the window of the motion takes, which is open, since `t_from`.
        real(wp), intent(in) :: open
        !> Stages of a step, and what an implicit step costs.
        integer, intent(in) :: stages
        real(wp), intent(in) :: cost
        real(wp) :: part

        wants_implicit = .false.
        ! Another method could not have left this one out.
        if (.not. is_free) self%tries_from = min(self%tries_from + 1, tries)
        part = cost/(real(max(tries - self%tries_from, 1_long), wp)*real(stages, wp))
        if (tries - self%tries_from < int(window*self%patience, long)) then
            if (.not. (is_at_limit .and. open > 0.0_wp) .or. self%patience > 1 .or. tries - self%tries_from < int(few, long)) return
            wants_implicit = part*(needed - self%needed_from + open) < strong
            if (.not. wants_implicit) return
        else
            ! The window of the motion that is open counts as a step at least.
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

    !> Whether to look at the largest eigenvalue before a first step: not where an exchange was in vain.
    pure logical function may_begin_implicit(self)
        class(switching_type), intent(in) :: self

        may_begin_implicit = self%is_on .and. .not. self%is_implicit .and. self%patience == 1 .and. self%first_step > 0.0_wp
    end function may_begin_implicit

    !> Whether the implicit method would be cheaper than the explicit one with steps as stability limits them. A first step is made
    !> so cautiously that its error is a hundredth of what is allowed: the ones that follow are longer by the root of that.
    pure logical function begins_implicit(self, first_step, stages, limit, cost)
        class(switching_type), intent(in) :: self
        !> Of the implicit method.
        real(wp), intent(in) :: first_step
        !> Stages of an explicit step, h |lambda| at its limit of stability, and what an implicit step costs.
        integer, intent(in) :: stages
        real(wp), intent(in) :: limit, cost
        real(wp), parameter :: caution = 0.01_wp
        real(wp) :: step

        step = first_step*caution**(-1.0_wp/real(self%estimate_order + 1, wp))
        begins_implicit = cost < real(stages, wp)*step*self%lambda/limit
    end function begins_implicit

    !> Look at the largest eigenvalue anew.
    pure subroutine begin_looks(self)
        class(switching_type), intent(inout) :: self

        self%stretch = 0.0_wp
    end subroutine begin_looks

    !> A step of the power iteration, from the rates at a state that is displaced a little along the direction. The product of two
    !> stretches in a row is right for a pair of eigenvalues too.
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
            call chart%hold()
            call chart%restore_position(moved%t, moved%dq, moved%q, stat)
            if (stat == status_ok) call chart%restore_velocity(moved%t, moved%q, moved%dqd, moved%qd, stat)
            if (stat == status_ok) call chart%solve_dynamics(moved%t, moved%q, moved%qd, moved%qdd, stat)
            call chart%release()
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

    !> Whether there were enough implicit steps to ask for the explicit method again.
    pure logical function is_due(self, tries)
        class(switching_type), intent(in) :: self
        !> Tries of steps so far.
        integer(long), intent(in) :: tries

        is_due = tries - self%tries_from >= int(window/2*self%patience, long)
    end function is_due

    !> Whether one look may speak against an exchange: not while it is also to tell how far explicit steps were from their limit.
    pure logical function is_certain(self)
        class(switching_type), intent(in) :: self

        is_certain = self%excess > 0.0_wp .or. .not. self%rate > 0.0_wp
    end function is_certain

    !> Whether the explicit method would be cheaper than the implicit one at work, by the largest eigenvalue as it is known.
    pure logical function wants_explicit(self, t, tries, stages, limit, cost)
        class(switching_type), intent(in) :: self
        !> Where the run is, and tries of steps so far.
        real(wp), intent(in) :: t
        integer(long), intent(in) :: tries
        !> Stages of an explicit step, h |lambda| at its limit of stability, and what an implicit step costs.
        integer, intent(in) :: stages
        real(wp), intent(in) :: limit, cost
        real(wp) :: explicit, implicit

        wants_explicit = .false.
        if (.not. self%lambda > 0.0_wp) return
        ! Costs of a unit of time. What errors limit, they limit for both.
        implicit = cost*real(tries - self%tries_from, wp)/max(t - self%t_from, tiny(1.0_wp))
        explicit = real(stages, wp)*max(excess_of(self, limit)*self%lambda/limit, implicit/cost)
        wants_explicit = explicit < worth*implicit
    end function wants_explicit

    !> It was asked for the explicit method; what comes is looked at next.
    pure subroutine note_decision(self, t, tries, limit)
        class(switching_type), intent(inout) :: self
        real(wp), intent(in) :: t
        integer(long), intent(in) :: tries
        real(wp), intent(in) :: limit

        if (self%lambda > 0.0_wp) self%excess = excess_of(self, limit)
        self%tries_from = tries
        self%t_from = t
    end subroutine note_decision

    !> Errors of what is stiff make explicit steps shorter than stability does: by how much, those before the exchange say. Where
    !> there were none, it is taken to be as on damped springs.
    pure real(wp) function excess_of(self, limit)
        class(switching_type), intent(in) :: self
        real(wp), intent(in) :: limit
        real(wp), parameter :: usual = 3.0_wp, most_excess = 30.0_wp

        excess_of = self%excess
        if (excess_of > 0.0_wp) return
        excess_of = usual
        if (self%rate > 0.0_wp) excess_of = min(most_excess, max(1.0_wp, self%rate*limit/self%lambda))
    end function excess_of

    !> What a step may be in place of the first one of the run, at a time after its start; 0 where that is too late, or it is not
    !> the first exchange.
    pure real(wp) function first_step_at(self, after)
        class(switching_type), intent(in) :: self
        real(wp), intent(in) :: after

        first_step_at = 0.0_wp
        if (self%switches == 0 .and. after < self%first_step) first_step_at = self%first_step
    end function first_step_at

    !> Steppers were exchanged.
    subroutine note_switch(self, t, steps, tries, needed)
        class(switching_type), intent(inout) :: self
        !> Where, and steps, tries and steps of the motion itself so far.
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

    !> What the next exchange depends on; `is_implicit` is kept before, by who must make the stepper first.
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
