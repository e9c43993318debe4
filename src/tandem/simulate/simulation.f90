! SPDX-License-Identifier: MIT
!> A simulation: a model, a chart, a stepper, the current state, and the loop that joins them.
!>
!> The object can be stepped from outside (`step`) or run (`integrate`). It contains the whole state of the integration; the model
!> is the caller's and must outlive it. Two simulations never share anything.
module tandem_simulation
    use tandem_error, only: error_type, set_error, to_text
    use tandem_kinds, only: long, wp
    use tandem_model, only: label_length, model_type
    use tandem_model_check, only: check_model
    use tandem_option_rules, only: complete_options, projects_stages
    use tandem_options, only: chart_kinds, options_type, projections, singular_modes
    use tandem_simulate_event, only: event_record_type, event_type
    use tandem_simulate_statistics, only: by_breakpoint, by_condition, by_d, by_event, by_failure, by_fbar, by_iterations, &
        by_start, by_step, by_v, by_w, statistics_type
    use tandem_simulate_local_error, only: local_error_type, steps_of_window
    use tandem_simulate_advice, only: advice_on_limit, at_smallest_step, before_steps, in_first_step, in_step
    use tandem_simulate_assembly, only: assemble, assembly_type
    use tandem_simulate_step_control, only: step_control_type
    use tandem_simulate_warning, only: warning_limit, warning_type
    use tandem_simulate_crossing_data, only: crossing_record_type, crossing_type
    use tandem_simulate_dense_control, only: dense_control_type
    use tandem_simulate_dense_output, only: dense_output_type
    use tandem_simulate_event_watch, only: event_watch_type
    use tandem_simulate_lost_rank, only: lost_rank_type
    use tandem_simulate_reach, only: reach_type
    use tandem_simulate_slowing, only: slowing_type
    use tandem_simulate_stiffness, only: implicit_advice, stiffness_type
    use tandem_simulate_switching, only: cost_of_implicit, looks, switching_type
    use tandem_simulate_work_limit, only: work_limit_type
    use tandem_status, only: status_callback_failed, status_chart_left, status_constraints_not_held, &
        status_inconsistent_start, status_invalid_option, status_newton_failed, status_not_finite, status_ok, &
        status_position_diverged, status_rank_deficient, status_singular_mass, status_step_limit, status_step_underflow, &
        status_work_limit
    use tandem_stepper, only: properties_type, stepper_type, weighted_norm
    use tandem_stepper_factory, only: new_stepper, stepper_choices
    use tandem_stepper_state, only: state_type
    use tandem_chart, only: chart_type, measure_type, need_policy, need_rank, step_end
    use tandem_chart_implicit, only: filter_error
    use tandem_model_kinetic_energy, only: kinetic_energy_type
    use tandem_model_counts, only: counts_type
    use tandem_chart_factory, only: choose_chart, cost_type, is_sparse_chart, new_chart
    use tandem_model_derivatives, only: need_all_derivatives
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)
    private

    public :: simulation_type, observer_type
    public :: at_start, at_step, at_end, at_event

    !> Occasions of an observer's call: with the start, after an accepted step, with the last state of a run (also a failed one),
    !> and with the state before the action of an event that changes the motion; `at_step` follows with the state after it.
    integer, parameter :: at_start = 0, at_step = 1, at_end = 2, at_event = 3

    !> Most rows that a message names: more are of no use.
    integer, parameter :: most_names = 8

    !> Observes the motion of a run, for example to write or to draw it.
    type, abstract :: observer_type
    contains
        procedure(observe_interface), deferred :: observe
    end type observer_type

    !> Prototypes of user-defined parts; not allocated: none.
    type :: prototypes_type
        class(chart_type), allocatable :: chart
        class(stepper_type), allocatable :: stepper
    end type prototypes_type

    !> Requests between the ends of steps.
    type :: between_type
        type(dense_output_type) :: output
        !> Earliest announced time of a request between steps, and the resulting limit of steps.
        real(wp) :: next_look = huge(1.0_wp)
        type(dense_control_type) :: control
    end type between_type

    !> Renewal of the chart.
    type :: renewal_type
        !> Reason for a new chart before the next step, independent of the policy; 0 for none.
        integer :: reason = 0
        !> True if the current state is the chart's origin.
        logical :: is_done = .false.
    end type renewal_type

    !> Attempts of steps.
    type :: attempts_type
        !> Reason for a smaller last step, ok if no attempt has failed.
        integer :: cause = status_ok
        !> True if a limit on the work has ended the attempts of a controlled step; true if one of those had failed.
        logical :: is_interrupted = .false., has_failed = .false.
        !> True if a fixed step was found to pass over values of functions of time.
        logical :: has_overlooked = .false.
        !> Attempts of controlled steps since a time; attempts since the last check for creeping steps, and its time; number of
        !> checks that have found them.
        integer :: count = 0, count_of_look = 0, n_collapsed = 0
        real(wp) :: counted_from = 0.0_wp, creeps_from = 0.0_wp
        type(slowing_type) :: slowing
        !> Limit of attempts by the reach of a chart.
        type(reach_type) :: reach
    end type attempts_type

    !> Choice between the methods of the stepper `auto`.
    type :: auto_type
        !> The first method.
        type(properties_type) :: explicit_method
        type(stiffness_type) :: stiffness
        type(switching_type) :: switching
    end type auto_type

    !> A run of a model: `initialize` it, then `integrate` or `step`, and `look_at` times within the last step.
    type :: simulation_type
        !> The current state; all three constraint levels hold.
        type(state_type) :: state
        !> The model, the caller's.
        class(model_type), pointer :: model => null()
        !> Options of the run.
        type(options_type) :: options
        !> Number of the current step on the grid of fixed steps: a step that was cut at a breakpoint does not count.
        integer(long) :: grid_steps = 0
        !> True if the current state lies on that grid.
        logical :: on_grid = .true.
        !> Size of the last step.
        real(wp) :: last_step = 0.0_wp
        !> Position, velocity and acceleration error of the current state, on the natural scale of each row.
        real(wp) :: errors(3) = 0.0_wp
        !> Warnings and notes; none if unallocated.
        type(warning_type), allocatable :: warnings(:)
        !> Number of redundant constraint rows left out.
        integer :: n_redundant = 0
        !> True if charts are sparse.
        logical :: is_sparse = .false.
        !> The estimates for the choice of charts; zero if none were needed.
        type(cost_type) :: cost
        !> Recorded events, `n_events` entries in the order of time; more may be allocated.
        type(event_record_type), allocatable :: events(:)
        integer :: n_events = 0
        !> Singular configurations that were passed, `n_crossings` entries in the order of time; more may be allocated.
        type(crossing_record_type), allocatable :: crossings(:)
        integer :: n_crossings = 0
        !> True if an event has stopped the run; its name.
        logical :: is_stopped = .false.
        character(len=label_length) :: stopped_by = ''
        !> True if a start was accepted, so that there is a run.
        logical, private :: is_ready = .false.
        class(chart_type), allocatable, private :: chart
        !> Prototypes of the caller's chart and stepper.
        type(prototypes_type), private :: own
        type(kinetic_energy_type), private :: energy
        class(stepper_type), allocatable, private :: stepper
        !> The ends of the last step. During a step `next` is stored in place of the last start; afterwards it is a separate end if
        !> the state may be another, see `part_end`.
        type(state_type), private :: start, next
        logical, private :: end_is_apart = .false.
        type(between_type), private :: between
        type(renewal_type), private :: renewal
        type(event_watch_type), private :: watch
        type(lost_rank_type), private :: lost_rank
        type(crossing_type), private :: crossing
        type(attempts_type), private :: attempts
        type(statistics_type), private :: tally
        class(step_control_type), allocatable, private :: control
        type(work_limit_type), private :: work
        type(local_error_type), private :: local_error
        !> The current method; only the run itself changes it.
        type(properties_type) :: method
        type(auto_type), private :: auto
        real(wp), private :: t_start = 0.0_wp
    contains
        procedure :: initialize, step, integrate, limit_steps
        procedure :: expect_look, look_at, look_back
        procedure :: statistics, multipliers, kinetic_energy, potential_energy
        procedure :: warn, add_event, save_state, restore_state
        procedure, private :: check_ready, advance, make_room, part_end, judge_between, look_for_events, act_on_events, accept_start
        procedure, private :: choose_rows_anew, has_surplus_rows, allocate_chart, allocate_stepper, renew_chart, move_origin
        procedure, private :: consider_exchange, consider_crossing, leave_start, continue_on_branch, note_end, &
            look_into_crossing
        procedure, private :: consider_beginning, take_stepper, set_method, measure_errors, fail, explain, compare_procedures
        procedure, private :: with_rows
        procedure :: start_clock, stop_clock
    end type simulation_type

    abstract interface
        !> Observe `simulation`, whose state is accepted. An error ends the run with that error.
        subroutine observe_interface(self, simulation, occasion, error)
            import :: observer_type, simulation_type, error_type
            implicit none (type, external)
            class(observer_type), intent(inout) :: self
            class(simulation_type), intent(inout) :: simulation
            !> `at_start`, `at_step`, `at_end` or `at_event`.
            integer, intent(in) :: occasion
            type(error_type), allocatable, intent(out) :: error
        end subroutine observe_interface
    end interface

    interface
        !> Set up a run that starts from (t, q, qd), or with `assembly` from the consistent state nearest to it. Errors:
        !> invalid_model, invalid_option, inconsistent_start, rank_deficient, singular_mass, callback_failed, not_evaluable,
        !> not_finite. After an error there is no run, even if there was one before.
        module subroutine initialize(self, model, options, t, q, qd, error, assembly, chart, stepper, control)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
            !> The model; it must outlive the simulation and belongs to this one only.
            class(model_type), intent(inout), target :: model
            type(options_type), intent(in) :: options
            !> Start time, coordinates (n) and velocities (n).
            real(wp), intent(in) :: t, q(:), qd(:)
            type(error_type), allocatable, intent(out) :: error
            !> Request and result of an assembly; without it a start that violates the constraints is refused.
            type(assembly_type), intent(inout), optional :: assembly
            !> Charts are copies of this one, which is not initialized; dense charts if absent.
            class(chart_type), intent(in), optional :: chart
            !> User-defined method, not initialized, which the run copies; that of `options%stepper` if absent.
            class(stepper_type), intent(in), optional :: stepper
            !> User-defined step size controller, likewise.
            class(step_control_type), intent(in), optional :: control
        end subroutine initialize

        !> Allocate the stepper that a run begins with, or its partner.
        module subroutine allocate_stepper(self, is_partner)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
            logical, intent(in) :: is_partner
        end subroutine allocate_stepper

        !> Allocate a chart without initializing it.
        module subroutine allocate_chart(self)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
        end subroutine allocate_chart

        !> Make the current state the origin of a new chart and count the reason.
        module subroutine renew_chart(self, reason, error)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
            !> One of the reasons of `tandem_simulate_statistics`.
            integer, intent(in) :: reason
            type(error_type), allocatable, intent(out) :: error
        end subroutine renew_chart

        !> Make the current state the chart's origin, with other rows in use if redundant ones require it. The state's increments
        !> are unchanged.
        module subroutine move_origin(self, stat)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
            !> A status code.
            integer, intent(out) :: stat
        end subroutine move_origin

        !> Cost and errors of the run so far.
        module function statistics(self) result(statistics_)
            implicit none (type, external)
            class(simulation_type), intent(in) :: self
            type(statistics_type) :: statistics_
        end function statistics

        !> Exchange the stepper if the run shows that the other one is cheaper from here on.
        module subroutine consider_exchange(self, error)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
            type(error_type), allocatable, intent(out) :: error
        end subroutine consider_exchange

        !> Begin with implicit steps, the first of which is known, if stable explicit ones would be far shorter.
        module subroutine consider_beginning(self, error)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
            type(error_type), allocatable, intent(out) :: error
        end subroutine consider_beginning

        !> Activate a stepper with its chart, with the current state as the chart's origin.
        module subroutine take_stepper(self, is_implicit, stat)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
            !> True for the implicit one.
            logical, intent(in) :: is_implicit
            !> A status code.
            integer, intent(out) :: stat
        end subroutine take_stepper

        !> Select the treatment of constraint contributions to increments in the error of a step.
        module subroutine watch_constraints(self)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
        end subroutine watch_constraints

        !> Set the data that depend on the method.
        module subroutine set_method(self)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
        end subroutine set_method

        !> Make a new chart before the step if the policy requires it.
        module subroutine renew_by_policy(self, error)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
            type(error_type), allocatable, intent(out) :: error
        end subroutine renew_by_policy

        !> Enter the next segment: if nu jumps, qd jumps with it; the acceleration is recomputed, and the chart before the next
        !> step. On an error the state is that of the segment that ends.
        module subroutine cross_breakpoint(self, error)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
            type(error_type), allocatable, intent(out) :: error
        end subroutine cross_breakpoint

        !> Dense output: set `state` and `errors` for a time within the last step, between the steps' own, on the manifold with all
        !> three constraint levels, until `look_back`. Multipliers and energies then belong to that time. The integration is not
        !> affected: the steps are bitwise the same with and without.
        module subroutine look_at(self, t, error)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
            !> Not before the start of the last step, not after its end.
            real(wp), intent(in) :: t
            !> invalid_option if t is elsewhere; statuses of evaluating the model there.
            type(error_type), allocatable, intent(out) :: error
        end subroutine look_at

        !> Let error control include the motion within the last step if states there are requested: refuse the step if its error
        !> exceeds the tolerance, else bound the next one.
        module subroutine judge_between(self, is_refused)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
            logical, intent(out) :: is_refused
        end subroutine judge_between

        !> Return to the state at the end of the last step.
        module subroutine look_back(self)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
        end subroutine look_back

        !> The multipliers lambda (nh + nd) at the current state, holonomic rows first: M qdd + C' lambda = S + Q_A (35). Zero if
        !> the model is no longer evaluable there, and before `initialize`.
        module subroutine multipliers(self, lambda)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
            real(wp), intent(out), contiguous :: lambda(:)
        end subroutine multipliers

        !> The kinetic energy at the current state.
        module subroutine kinetic_energy(self, energy, stat)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
            real(wp), intent(out) :: energy
            !> A status code, or the status of the model's own procedure.
            integer, intent(out) :: stat
        end subroutine kinetic_energy

        !> The potential energy at the current state; only if the model has one.
        module subroutine potential_energy(self, energy, stat)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
            real(wp), intent(out) :: energy
            !> The status of the model's procedure.
            integer, intent(out) :: stat
        end subroutine potential_energy

        !> If rows are redundant: choose again which to leave out, and make a chart at the current state.
        module subroutine choose_rows_anew(self, stat)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
            !> A status code.
            integer, intent(out) :: stat
        end subroutine choose_rows_anew

        !> True if a chart of all rows is impossible: a dense one has at most as many rows as coordinates, so that it is postponed
        !> until rows are left out.
        module function has_surplus_rows(self)
            implicit none (type, external)
            class(simulation_type), intent(in) :: self
            logical :: has_surplus_rows
        end function has_surplus_rows

        !> Watch an event from the current state on; call it after `initialize`, which removes all events. The event is the caller's
        !> and must outlive the run.
        module subroutine add_event(self, event)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
            class(event_type), intent(inout), target :: event
        end subroutine add_event

        !> Search for events in the last step, record them, and cut the step if one stops or changes the motion.
        module subroutine look_for_events(self, is_last, is_cut, is_refused, error)
            implicit none (type, external)
            class(simulation_type), intent(inout), target :: self
            !> True if no step may follow: a zero at the end counts now.
            logical, intent(in) :: is_last
            logical, intent(out) :: is_cut
            !> True if the motion within the step is too uncertain for the events found; they are then discarded.
            logical, intent(out) :: is_refused
            type(error_type), allocatable, intent(out) :: error
        end subroutine look_for_events

        !> Take the actions that are due at the current state and prepare the motion to continue.
        module subroutine act_on_events(self, error)
            implicit none (type, external)
            class(simulation_type), intent(inout), target :: self
            type(error_type), allocatable, intent(out) :: error
        end subroutine act_on_events

        !> The state of the run, as a row of numbers: an identically set up simulation that receives it by `restore_state` continues
        !> bitwise as this one does, which is not affected. Between steps; ends a request at another time.
        module subroutine save_state(self, words, error)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
            integer(long), allocatable, intent(inout) :: words(:)
            !> invalid_checkpoint between an event and its action, and before `initialize`.
            type(error_type), allocatable, intent(out) :: error
        end subroutine save_state

        !> Restore a run from the result of `save_state`. First call `initialize` with the same model, options and start, and
        !> `add_event` for the same events. The state of a user-defined model or event is included if it overrides `pack_state`.
        module subroutine restore_state(self, words, error)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
            integer(long), intent(in) :: words(:)
            !> The error of a foreign, newer or damaged pack, or one of another model or options. Initialize again after an error.
            type(error_type), allocatable, intent(out) :: error
        end subroutine restore_state

        !> Check the start against the constraints, remove small errors, leave out redundant rows, and complete it.
        module subroutine accept_start(self, error)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
            type(error_type), allocatable, intent(out) :: error
        end subroutine accept_start

        !> One accepted step that does not pass t_limit, without the actions of events. On an error the state is that of the last
        !> accepted step.
        module subroutine advance(self, t_limit, error)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
            !> The step ends here at the latest; must lie after the current time.
            real(wp), intent(in) :: t_limit
            type(error_type), allocatable, intent(out) :: error
        end subroutine advance

        !> Discard the last step: `next` is stored in place of its start.
        module subroutine make_room(self)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
        end subroutine make_room

        !> Before the state changes: make `next` a copy of the end of the last step.
        module subroutine part_end(self)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
        end subroutine part_end

        !> The error of steps that succeed, but would never reach the end.
        module subroutine check_progress(self, t_limit, stop_at, error)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
            !> The end of the run, and the time of the next stop before it.
            real(wp), intent(in) :: t_limit, stop_at
            type(error_type), allocatable, intent(out) :: error
        end subroutine check_progress

        !> A loss of rank close ahead may be the reason for creeping steps, or for violated constraints.
        module subroutine name_loss_ahead(self, reach, stop_at, trouble, error)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
            !> Reach of steps, and the time of their next stop.
            real(wp), intent(in) :: reach, stop_at
            !> Consequence of the loss.
            character(len=*), intent(in) :: trouble
            !> Replaced if a loss is the reason.
            type(error_type), allocatable, intent(inout) :: error
        end subroutine name_loss_ahead

        !> The error of a step that would no longer change the time.
        module subroutine underflow(self, reason, h, error)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
            !> Reason for the failure of the last try, in this step or in the one before; ok if it missed the tolerance.
            integer, intent(in) :: reason
            real(wp), intent(in) :: h
            type(error_type), allocatable, intent(out) :: error
        end subroutine underflow

        !> Make a step over a singular configuration ahead, into `next`, if the motion is smooth there.
        module subroutine consider_crossing(self, reach, stop_at, is_loss, is_crossed)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
            !> Time within which the configuration is searched for, and latest end of the step.
            real(wp), intent(in) :: reach, stop_at
            !> True if C loses rank at one instant ahead.
            logical, intent(out) :: is_loss
            logical, intent(out) :: is_crossed
        end subroutine consider_crossing

        !> Make the first step, into `next`, from a start in a singular configuration.
        module subroutine leave_start(self, stop_at, error)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
            !> Latest end of the step.
            real(wp), intent(in) :: stop_at
            type(error_type), allocatable, intent(out) :: error
        end subroutine leave_start

        !> Continue from a state within a crossing at which an event has changed the model, if its velocity belongs to one branch.
        module subroutine continue_on_branch(self, is_done)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
            !> False if the state is not near the configuration, or no motion begins there.
            logical, intent(out) :: is_done
        end subroutine continue_on_branch

        !> Keep the end of a step for later crossings, and record the configuration that the step has passed.
        module subroutine note_end(self)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
        end subroutine note_end

        !> The motion within the last step, which is a crossing, for `look_at`.
        module subroutine look_into_crossing(self, t, stat)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
            real(wp), intent(in) :: t
            integer, intent(out) :: stat
        end subroutine look_into_crossing

        !> Turn a status of the chart or the stepper into an error with its time and the row at fault.
        module subroutine fail(self, stat, where_, error, circumstance)
            implicit none (type, external)
            class(simulation_type), intent(in) :: self
            integer, intent(in) :: stat
            !> Description of the time.
            character(len=*), intent(in) :: where_
            type(error_type), allocatable, intent(out) :: error
            !> One of the circumstances of `tandem_simulate_advice`; default `anywhere`.
            integer, intent(in), optional :: circumstance
        end subroutine fail

        !> A procedure of the model that contradicts others is the cause of an error of a step: the message begins with it.
        module subroutine explain(self, error)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
            !> Error of `advance`.
            type(error_type), allocatable, intent(inout) :: error
        end subroutine explain

        !> Look for procedures of the model that contradict each other, within the last step.
        module subroutine compare_procedures(self)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
        end subroutine compare_procedures

        !> Names of other rows, for messages about rows that depend on each other, padded with blanks.
        recursive module function with_rows(self, rows, row, before) result(text)
            implicit none (type, external)
            class(simulation_type), intent(in) :: self
            !> Rows of C, and the row already named (0: none).
            integer, intent(in) :: rows(:), row
            !> Text before the first name.
            character(len=*), intent(in) :: before
            character(len=len(before) + most_names*(label_length + 4) + 11) :: text
        end function with_rows

        !> Store a warning, once.
        module subroutine warn(self, text, is_note)
            implicit none (type, external)
            class(simulation_type), intent(inout) :: self
            !> Observation and advice.
            character(len=*), intent(in) :: text
            !> True for a property of the model, not a warning about the result; default false.
            logical, intent(in), optional :: is_note
        end subroutine warn
    end interface

contains

    !> Refuse operations that need a run if there is none.
    subroutine check_ready(self, error)
        class(simulation_type), intent(in) :: self
        type(error_type), allocatable, intent(out) :: error

        if (.not. self%is_ready) call set_error(error, status_invalid_option, 'there is no run: initialize was not called, or '// &
            'failed', 'call initialize, and continue only if it returns no error')
    end subroutine check_ready

    !> One accepted step that does not pass t_limit, with the actions of events at its end. On an error the state is that of the
    !> last accepted step, or of the event whose action failed.
    subroutine step(self, t_limit, error)
        class(simulation_type), intent(inout) :: self
        !> The step ends here at the latest; must lie after the current time.
        real(wp), intent(in) :: t_limit
        type(error_type), allocatable, intent(out) :: error

        call self%check_ready(error)
        if (allocated(error)) return
        if (.not. t_limit > self%state%t) then
            call set_error(error, status_invalid_option, 'the limit of a step, '//to_text(t_limit)// &
                ', must be after the current time '//to_text(self%state%t), 'choose a later one')
            return
        end if
        ! A caller who makes single steps sees their progress, and need not intend to reach the limit.
        self%attempts%count = 0
        self%attempts%counted_from = self%state%t
        call self%advance(t_limit, error)
        if (allocated(error)) call self%explain(error)
        if (.not. allocated(error) .and. self%watch%has_to_act) call self%act_on_events(error)
    end subroutine step

    !> Step until t_end and call the observer after every accepted step. On an error the state is that of the last accepted step.
    subroutine integrate(self, t_end, error, observer)
        class(simulation_type), intent(inout) :: self
        !> End of the run; must lie after the current time. An event that stops ends it before (`is_stopped`).
        real(wp), intent(in) :: t_end
        type(error_type), allocatable, intent(out) :: error
        !> Called at the start, after every step and at the end.
        class(observer_type), intent(inout), optional :: observer
        type(error_type), allocatable :: observer_error

        call self%check_ready(error)
        if (allocated(error)) return
        if (.not. (t_end > self%state%t .and. ieee_is_finite(t_end))) then
            call set_error(error, status_invalid_option, 'the end time '//to_text(t_end)// &
                ' must be finite and after the current time '//to_text(self%state%t), 'choose a later end')
            return
        end if
        call self%tally%start_clock()
        if (present(observer)) call observer%observe(self, at_start, error)
        do while (self%state%t < t_end .and. .not. allocated(error))
            call self%advance(t_end, error)
            if (allocated(error)) then
                call self%explain(error)
                exit
            end if
            if (self%watch%has_to_act) then
                if (present(observer)) call observer%observe(self, at_event, error)
                if (.not. allocated(error)) call self%act_on_events(error)
                if (allocated(error)) exit
            end if
            if (present(observer)) call observer%observe(self, at_step, error)
            if (self%is_stopped) exit
        end do
        call self%tally%stop_clock()
        if (present(observer)) then
            call observer%observe(self, at_end, observer_error)
            if (allocated(observer_error) .and. .not. allocated(error)) call move_alloc(observer_error, error)
        end if
    end subroutine integrate

    !> From now on, bound steps under error control by this (s, above zero), and by the options.
    subroutine limit_steps(self, max_step)
        class(simulation_type), intent(inout) :: self
        real(wp), intent(in) :: max_step

        if (self%options%max_step > 0.0_wp) then
            call self%control%set_max_step(min(max_step, self%options%max_step))
        else
            call self%control%set_max_step(max_step)
        end if
    end subroutine limit_steps

    !> Announce a request between steps at a time, and perhaps later: error control includes the motion within the step that passes
    !> it. Of several times the first counts; it is dropped when a step has passed it. Requests without announcement have the
    !> accuracy that the steps provide.
    subroutine expect_look(self, t)
        class(simulation_type), intent(inout) :: self
        !> The end of the last step, for a request somewhere in the next, or later.
        real(wp), intent(in) :: t

        self%between%next_look = min(self%between%next_look, t)
    end subroutine expect_look

    !> Count time from here on, until `stop_clock`. `integrate` does both; callers of single steps may.
    subroutine start_clock(self)
        class(simulation_type), intent(inout) :: self

        call self%tally%start_clock()
    end subroutine start_clock

    !> Add the time since then to the statistics.
    subroutine stop_clock(self)
        class(simulation_type), intent(inout) :: self

        call self%tally%stop_clock()
    end subroutine stop_clock

    !> The constraint errors of the current state, which must be within the tolerance.
    subroutine measure_errors(self, error)
        class(simulation_type), intent(inout) :: self
        type(error_type), allocatable, intent(out) :: error
        character(len=12), parameter :: level(3) = [character(len=12) :: 'position', 'velocity', 'acceleration']
        !> Constraint errors of the polynomial of a crossing, in units of its estimated error: derivatives have larger errors.
        real(wp), parameter :: of_crossing(3) = [100.0_wp, 100.0_wp, 1.0e4_wp]
        real(wp) :: allowed(3)
        integer :: rows(3), stat, i

        associate (state => self%state, tally => self%tally)
            call self%chart%find_errors(state%t, state%q, state%qd, state%qdd, self%errors, rows, stat)
            if (stat /= status_ok) then
                call self%fail(stat, 'at t = '//to_text(state%t), error)
                return
            end if
            tally%position_error = max(tally%position_error, self%errors(1))
            tally%velocity_error = max(tally%velocity_error, self%errors(2))
            tally%acceleration_error = max(tally%acceleration_error, self%errors(3))
            ! The paper's own iterations satisfy their own tolerances only, and the report shows the errors.
            if (self%options%refresh == 'refine') return
            allowed = self%options%constraint_tolerance
            ! An event or a stop within a crossing has a state of the polynomial.
            if (self%crossing%is_last_step .and. (state%t < self%next%t .or. self%crossing%starts)) then
                allowed = max(allowed, of_crossing*self%crossing%record%error)
            end if
            do i = 1, 3
                if (self%errors(i) <= max(allowed(i), merge(self%options%position_tolerance(), 0.0_wp, i == 1))) cycle
                call set_error(error, status_constraints_not_held, 'the '//trim(level(i))//' constraint "'// &
                    self%model%row_name(rows(i))//'" is off by '//to_text(self%errors(i))// &
                    ' of its natural scale at t = '//to_text(state%t)//' (allowed: '// &
                    to_text(self%options%constraint_tolerance)//')')
                return
            end do
        end associate
    end subroutine measure_errors
end module tandem_simulation
