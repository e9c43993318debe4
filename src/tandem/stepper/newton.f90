! SPDX-License-Identifier: MIT
!> Newton's iteration for the rates of an implicit stage: its position and velocity increments are base + ha rate.
!>
!> The matrix is that of the step; the iteration watches its own contraction theta and stops when what is left,
!> theta / (1 - theta) times the last correction, is below the tolerance. Source: Hairer and Wanner, Solving Ordinary
!> Differential Equations II, section IV.8.
module tandem_stepper_newton
    use tandem_kinds, only: wp
    use tandem_stepper_history, only: history_type
    use tandem_stepper_state, only: state_type
    use tandem_status, only: status_newton_failed, status_ok
    use tandem_tangent_chart, only: chart_type
    implicit none (type, external)
    private

    public :: newton_type

    type :: newton_type
        !> Rates of the stage (n): the start value on entry, the solution on return.
        real(wp), allocatable :: rate_q(:), rate_qd(:)
        !> Increments that do not depend on the stage's own rates (n).
        real(wp), allocatable :: base_dq(:), base_dqd(:)
        !> What each stage's iteration may leave.
        real(wp), allocatable, private :: tolerance(:)
        !> A correction below this that no longer falls is rounding, which stiff forces amplify.
        real(wp), private :: standstill = 0.0_wp
        !> Contraction of each stage when it was last seen, and the first correction then; age of that in steps.
        real(wp), allocatable, private :: theta(:), seen_change(:)
        integer, allocatable, private :: age(:)
        real(wp), allocatable, private :: dq(:), dqd(:), q(:), qd(:)
    contains
        procedure :: allocate => allocate_newton
        procedure :: solve
        procedure, private :: iterate
        procedure, private :: restore
        procedure :: finish
    end type newton_type

contains

    !> Allocate for n coordinates.
    subroutine allocate_newton(self, n, tolerance, amplification)
        class(newton_type), intent(inout) :: self
        !> Number of coordinates.
        integer, intent(in) :: n
        !> What the iteration may leave of q and qd, against |q|, |qd| and the coordinate scales.
        real(wp), intent(in) :: tolerance
        !> By how much each stage's remainder is amplified at the end of the step, |b_i| / a_ii.
        real(wp), intent(in) :: amplification(:)

        self%tolerance = max(tolerance/max(amplification, 1.0_wp), 2*epsilon(1.0_wp))
        self%standstill = 1.0e3_wp*tolerance
        self%theta = spread(1.0_wp, 1, size(amplification))
        self%seen_change = spread(0.0_wp, 1, size(amplification))
        self%age = spread(0, 1, size(amplification))
        self%rate_q = spread(0.0_wp, 1, n)
        self%rate_qd = self%rate_q
        self%base_dq = self%rate_q
        self%base_dqd = self%rate_q
        self%dq = self%rate_q
        self%dqd = self%rate_q
        self%q = self%rate_q
        self%qd = self%rate_q
    end subroutine allocate_newton

    !> Solve the stage at time t: from the extrapolated history; if that fails, from the state at the start of the step with
    !> the step's matrix; if that fails too, with matrices made where the iteration stood.
    subroutine solve(self, chart, history, state, stage, t, ha, stat)
        class(newton_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        type(history_type), intent(inout) :: history
        !> The state at the start of the step.
        type(state_type), intent(in) :: state
        !> Number of the stage, its time, and h a_ii.
        integer, intent(in) :: stage
        real(wp), intent(in) :: t, ha
        !> A status code.
        integer, intent(out) :: stat
        !> Matrices made for one stage before it is given up.
        integer, parameter :: most_matrices = 2
        integer :: k

        call history%extrapolate(t, self%rate_q, self%rate_qd)
        call self%iterate(chart, stage, t, ha, stat)
        if (stat == status_ok) return
        self%theta(stage) = 1.0_wp
        self%rate_q = state%qd
        self%rate_qd = state%qdd
        call self%iterate(chart, stage, t, ha, stat)
        do k = 1, most_matrices
            if (stat /= status_newton_failed) return
            call self%restore(chart, t, ha, stat)
            if (stat == status_ok) call chart%factor_stage(t, self%q, self%qd, self%rate_qd, ha, stat)
            if (stat == status_ok) call self%iterate(chart, stage, t, ha, stat)
        end do
    end subroutine solve

    !> The iteration. One correction suffices where the stage's last known contraction promises so; that knowledge is renewed
    !> when it is old, or when the first correction has grown since.
    subroutine iterate(self, chart, stage, t, ha, stat)
        class(newton_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        integer, intent(in) :: stage
        real(wp), intent(in) :: t, ha
        integer, intent(out) :: stat
        !> More would cost more than a new matrix.
        integer, parameter :: most_corrections = 12
        !> Steps after which a contraction is old, growth of the first correction that makes it worthless, and how much worse
        !> than known it may have become.
        integer, parameter :: oldest = 20
        real(wp), parameter :: largest_growth = 2.0_wp, safety = 4.0_wp
        real(wp) :: change, first_change, last_change, theta
        integer :: k

        chart%counts%implicit_stages = chart%counts%implicit_stages + 1
        self%age(stage) = self%age(stage) + 1
        first_change = 0.0_wp
        last_change = 1.0_wp
        do k = 1, most_corrections
            call self%restore(chart, t, ha, stat)
            if (stat /= status_ok) return
            call chart%correct_stage(t, self%q, self%qd, ha, self%rate_q, self%rate_qd, change, stat)
            if (stat /= status_ok) return
            if (k == 1) then
                first_change = change
                if (self%age(stage) < oldest .and. change <= largest_growth*self%seen_change(stage) .and. &
                    safety*self%theta(stage)*change <= self%tolerance(stage)) return
            else
                theta = change/last_change
                if (k == 2) then
                    self%theta(stage) = theta
                    self%seen_change(stage) = first_change
                    self%age(stage) = 0
                end if
                if (change <= 0.01_wp*self%tolerance(stage)) return
                if (.not. theta < 0.95_wp) then
                    if (change <= self%standstill) return
                    exit
                end if
                if (theta/(1.0_wp - theta)*change <= self%tolerance(stage)) return
            end if
            last_change = max(change, tiny(1.0_wp))
        end do
        self%theta(stage) = 1.0_wp
        stat = status_newton_failed
    end subroutine iterate

    !> Position and velocity of the stage from its rates.
    subroutine restore(self, chart, t, ha, stat)
        class(newton_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        real(wp), intent(in) :: t, ha
        integer, intent(out) :: stat

        self%dq = self%base_dq + ha*self%rate_q
        self%dqd = self%base_dqd + ha*self%rate_qd
        call chart%restore_position(t, self%dq, self%q, stat)
        if (stat == status_ok) call chart%restore_velocity(t, self%q, self%dqd, self%qd, stat)
    end subroutine restore

    !> Complete the state at the end of a stiffly accurate step, whose last stage was solved last.
    subroutine finish(self, chart, ha, next, stat)
        class(newton_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        real(wp), intent(in) :: ha
        !> The state at next%t.
        type(state_type), intent(inout) :: next
        integer, intent(out) :: stat

        call self%restore(chart, next%t, ha, stat)
        if (stat /= status_ok) return
        next%dq = self%dq
        next%dqd = self%dqd
        next%q = self%q
        next%qd = self%qd
        call chart%solve_dynamics(next%t, next%q, next%qd, next%qdd, stat)
    end subroutine finish
end module tandem_stepper_newton
