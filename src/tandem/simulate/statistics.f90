! SPDX-License-Identifier: MIT
!> Cost and errors of a run: the chart's counters, the steps, and the largest errors over all of them.
module tandem_simulate_statistics
    use tandem_kinds, only: long, wp
    use tandem_model_consistency, only: contradiction_length
    use tandem_pack, only: pack_type
    use tandem_model_counts, only: counts_type
    implicit none (type, external)
    private

    public :: statistics_type, n_reasons, reason_name
    public :: by_start, by_step, by_v, by_w, by_d, by_fbar, by_breakpoint, by_condition, by_iterations, by_failure, by_event

    !> The reasons for a new chart, indices of `charts_by`: the start, the policy of every step, the limits on |v|_2, |w|_2,
    !> |D|_2 and |Fbar|_2, a breakpoint, the limits on the condition and on the iterations, a failed step,
    !> an event.
    integer, parameter :: by_start = 1, by_step = 2, by_v = 3, by_w = 4, by_d = 5, by_fbar = 6, by_breakpoint = 7
    integer, parameter :: by_condition = 8, by_iterations = 9, by_failure = 10, by_event = 11
    !> Number of reasons.
    integer, parameter :: n_reasons = 11
    !> Their names in reports.
    character(len=12), parameter :: reason_name(n_reasons) = &
        [character(len=12) :: 'start', 'every step', '|v|', '|w|', '|D|', '|Fbar|', 'breakpoint', &
        'condition', 'iterations', 'failure', 'event']

    !> Counters and largest errors of a run so far, those of its chart included.
    type, extends(counts_type) :: statistics_type
        !> Accepted steps; steps rejected for their error, and steps that could not be completed.
        integer(long) :: steps = 0, rejected = 0, failed = 0
        !> Smallest and largest accepted step.
        real(wp) :: smallest_step = huge(1.0_wp), largest_step = 0.0_wp
        !> Charts, the initial one counted.
        integer(long) :: charts = 0
        !> Number of charts for each reason, see `reason_name`.
        integer(long) :: charts_by(n_reasons) = 0
        !> Largest constraint errors over all accepted steps, on the natural scale of each row.
        real(wp) :: position_error = 0.0_wp, velocity_error = 0.0_wp, acceleration_error = 0.0_wp
        !> Estimated error of a step, the largest, and the sum over all, on the scale s + |y| of each coordinate and velocity, root
        !> mean square, without amplification by the motion. Number of these steps; 0 means no estimate.
        real(wp) :: local_error = 0.0_wp, local_error_sum = 0.0_wp
        integer(long) :: local_error_steps = 0
        !> Difference between a step's change of velocity and its accelerations, the largest on the scale s + |qd|, and its time:
        !> more than the error of a step if velocity constraints jump without a breakpoint.
        real(wp) :: velocity_gap = 0.0_wp, t_gap = 0.0_wp
        !> Estimated errors of q and of qd between steps, the largest at the requested times, on the scale s + |y|.
        real(wp) :: dense_error_q = 0.0_wp, dense_error_qd = 0.0_wp
        !> Explicit steppers: steps at the limit of stability; true if there were so many in a row that stability, not accuracy,
        !> limits the steps; the time of the first.
        integer(long) :: stiff_steps = 0
        logical :: is_stiff = .false.
        real(wp) :: stiff_from = 0.0_wp
        !> Explicit steppers under error control: the work of a run with an implicit one, as a part of this run's work, estimated
        !> from the smoothness of its motion; the stepper, if that would be faster.
        real(wp) :: implicit_part = 0.0_wp
        character(len=16) :: advised = ''
        !> With the stepper `auto`: number of exchanges, and the steps of the implicit one.
        integer(long) :: switches = 0, implicit_steps = 0
        !> Displacement of the start onto the constraints, max-norms of the changes of q and qd.
        real(wp) :: start_moved_q = 0.0_wp, start_moved_qd = 0.0_wp
        !> Evaluations of the functions of events.
        integer(long) :: event_evaluations = 0
        !> Largest jump of qd at a breakpoint or an event, max-norm.
        real(wp) :: velocity_jump = 0.0_wp
        !> Singular configurations that were passed, and the largest estimated error of these steps, on the scale s + |y|.
        integer(long) :: crossings = 0
        real(wp) :: crossing_error = 0.0_wp
        !> Procedure of the model that contradicts others, as found during the run; blank if none was found. Evaluations of the
        !> search are included in the counts.
        character(len=contradiction_length) :: contradiction = ''
        !> The procedures of the model come with tandem.
        logical :: has_ready_made_model = .false.
        !> Seconds spent in `integrate`, observers included.
        real(wp) :: wall_seconds = 0.0_wp, cpu_seconds = 0.0_wp
        !> True if time is being counted now; the start of the time that is not included yet.
        logical, private :: is_timed = .false.
        integer(long), private :: clock_from = 0
        real(wp), private :: cpu_from = 0.0_wp
    contains
        procedure :: start_clock, book_time, stop_clock, pack_state
    end type statistics_type

contains

    !> Count the time from here on.
    subroutine start_clock(self)
        class(statistics_type), intent(inout) :: self

        self%is_timed = .true.
        call system_clock(self%clock_from)
        call cpu_time(self%cpu_from)
    end subroutine start_clock

    !> Add the time that has passed, if it is counted.
    subroutine book_time(self)
        class(statistics_type), intent(inout) :: self
        integer(long) :: now, rate
        real(wp) :: cpu

        if (.not. self%is_timed) return
        call system_clock(now, rate)
        call cpu_time(cpu)
        self%cpu_seconds = self%cpu_seconds + (cpu - self%cpu_from)
        self%wall_seconds = self%wall_seconds + real(now - self%clock_from, wp)/real(rate, wp)
        self%clock_from = now
        self%cpu_from = cpu
    end subroutine book_time

    !> Stop counting the time.
    subroutine stop_clock(self)
        class(statistics_type), intent(inout) :: self

        call self%book_time()
        self%is_timed = .false.
    end subroutine stop_clock

    !> Statistics stored here; a simulation copies the others from their sources.
    subroutine pack_state(self, pack)
        class(statistics_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%steps, self%rejected, self%failed)
        call pack%item(self%smallest_step, self%largest_step)
        call pack%item(self%charts)
        call pack%fixed(self%charts_by)
        call pack%item(self%position_error, self%velocity_error, self%acceleration_error, self%velocity_gap, self%t_gap)
        call pack%item(self%start_moved_q, self%start_moved_qd)
        call pack%item(self%velocity_jump, self%crossing_error)
        call pack%item(self%crossings)
        call pack%item(self%contradiction)
        call pack%item(self%wall_seconds, self%cpu_seconds)
    end subroutine pack_state
end module tandem_simulate_statistics
