! SPDX-License-Identifier: MIT
!> Cost and errors of a run: counters of the chart, of steps, and the largest errors over all steps.
module tandem_simulate_statistics
    use tandem_kinds, only: long, wp
    use tandem_model_consistency, only: contradiction_length
    use tandem_pack, only: pack_type
    use tandem_model_counts, only: counts_type
    implicit none (type, external)
    private

    public :: statistics_type, n_reasons, reason_name
    public :: by_start, by_step, by_v, by_w, by_d, by_fbar, by_breakpoint, by_condition, by_iterations, by_failure, by_event

    !> Reasons for a new chart, indices of `charts_by`: the start; the policy of a new chart in every step; the limits on |v|_2,
    !> |w|_2, |D|_2 and |Fbar|_2; a breakpoint; the limits on the condition number and on iterations; a failed step; an event.
    integer, parameter :: by_start = 1, by_step = 2, by_v = 3, by_w = 4, by_d = 5, by_fbar = 6, by_breakpoint = 7
    integer, parameter :: by_condition = 8, by_iterations = 9, by_failure = 10, by_event = 11
    !> Number of reasons.
    integer, parameter :: n_reasons = 11
    !> Names of the reasons in reports.
    character(len=12), parameter :: reason_name(n_reasons) = &
        [character(len=12) :: 'start', 'every step', '|v|', '|w|', '|D|', '|Fbar|', 'breakpoint', &
        'condition', 'iterations', 'failure', 'event']

    !> Counters and largest errors of a run so far, including those of its chart.
    type, extends(counts_type) :: statistics_type
        !> Accepted steps; steps rejected because of their error; steps that failed.
        integer(long) :: steps = 0, rejected = 0, failed = 0
        !> Smallest and largest accepted step size.
        real(wp) :: smallest_step = huge(1.0_wp), largest_step = 0.0_wp
        !> Number of charts, including the first one.
        integer(long) :: charts = 0
        !> Number of charts for each reason, see `reason_name`.
        integer(long) :: charts_by(n_reasons) = 0
        !> Largest constraint errors over all accepted steps, on the natural scale of each row.
        real(wp) :: position_error = 0.0_wp, velocity_error = 0.0_wp, acceleration_error = 0.0_wp
        !> Largest estimated error of a step, and sum over all steps: root mean square over coordinates and velocities relative to
        !> scale + |y|, without amplification by the motion. Number of steps with an estimate, 0 if there is none.
        real(wp) :: local_error = 0.0_wp, local_error_sum = 0.0_wp
        integer(long) :: local_error_steps = 0
        !> Largest velocity gap and its time: the difference between a step's change of velocity and the integral of its
        !> accelerations, relative to scale + |qd|. It exceeds the error of the step if velocity constraints jump without a
        !> breakpoint.
        real(wp) :: velocity_gap = 0.0_wp, t_gap = 0.0_wp
        !> Largest estimated errors of q and of qd at requested times between steps, relative to scale + |y|.
        real(wp) :: dense_error_q = 0.0_wp, dense_error_qd = 0.0_wp
        !> Explicit steppers: number of steps at the limit of stability; true if stability, not accuracy, has limited many steps in
        !> a row; time of the first of these.
        integer(long) :: stiff_steps = 0
        logical :: is_stiff = .false.
        real(wp) :: stiff_from = 0.0_wp
        !> Explicit steppers under error control: ratio of the work with an implicit stepper, estimated from the smoothness of the
        !> motion, to the work of this run; name of this stepper if it would be faster.
        real(wp) :: implicit_part = 0.0_wp
        character(len=16) :: advised = ''
        !> Stepper `auto`: number of exchanges, and number of implicit steps.
        integer(long) :: switches = 0, implicit_steps = 0
        !> Displacement of the start onto the constraints: largest changes of q and of qd.
        real(wp) :: start_moved_q = 0.0_wp, start_moved_qd = 0.0_wp
        !> Evaluations of event functions.
        integer(long) :: event_evaluations = 0
        !> Largest jump of a velocity at a breakpoint or event.
        real(wp) :: velocity_jump = 0.0_wp
        !> Singular configurations that were passed, and the largest estimated error of these steps, on the scale s + |y|.
        integer(long) :: crossings = 0
        real(wp) :: crossing_error = 0.0_wp
        !> Procedure of the model that was found to contradict others; blank if none. The evaluations of the search are included in
        !> the counters.
        character(len=contradiction_length) :: contradiction = ''
        !> True if tandem provides the procedures of the model.
        logical :: has_ready_made_model = .false.
        !> Time spent in `integrate`, including observers (s).
        real(wp) :: wall_seconds = 0.0_wp, cpu_seconds = 0.0_wp
        !> True while time is being measured; start of the time that is not included yet.
        logical, private :: is_timed = .false.
        integer(long), private :: clock_from = 0
        real(wp), private :: cpu_from = 0.0_wp
    contains
        procedure :: contradicts, start_clock, book_time, stop_clock, pack_state
    end type statistics_type

contains

    !> True if procedures of the model contradict each other. Steps ask, and do not search the whole text for it.
    pure logical function contradicts(self)
        class(statistics_type), intent(in) :: self

        contradicts = self%contradiction(1:1) /= ' '
    end function contradicts

    !> Start measuring time.
    subroutine start_clock(self)
        class(statistics_type), intent(inout) :: self

        self%is_timed = .true.
        call system_clock(self%clock_from)
        call cpu_time(self%cpu_from)
    end subroutine start_clock

    !> Add the time since the last call, if time is being measured.
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

    !> Stop measuring time.
    subroutine stop_clock(self)
        class(statistics_type), intent(inout) :: self

        call self%book_time()
        self%is_timed = .false.
    end subroutine stop_clock

    !> Pack the statistics that are stored here. A simulation copies the others from their sources.
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
