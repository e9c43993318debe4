! SPDX-License-Identifier: MIT
!> Explicit Runge-Kutta methods, given by their tableau.
!>
!> Stages are increments in ambient coordinates, xi' = qd and eta' = qdd, and the chart restores the constraints at each.
!> Runge-Kutta methods are linear in their stages, so this is the trajectory of (51) in the chart's v and w.
!> The acceleration at the end of a step is the first stage of the next one; an error estimate may use it too.
module tandem_stepper_explicit
    use tandem_kinds, only: wp
    use tandem_pack, only: pack_type
    use tandem_stepper, only: stepper_type, weighted_norm
    use tandem_stepper_state, only: state_type
    use tandem_tangent_chart, only: chart_type
    implicit none (type, external)
    private

    public :: explicit_type, add_rates

    !> A method given by its tableau; s stages.
    type, abstract, extends(stepper_type) :: explicit_type
        !> a(j, i), j < i, for stage i = 2 ... s; c(i) = sum_j a(j, i); weights b (s).
        real(wp), allocatable :: a(:, :), b(:), c(:)
        !> Weights of error estimates (s + 1, number of estimates), the last row for the rate at the end of the step.
        real(wp), allocatable :: e(:, :)
        !> Rates of the stages and at the end of the step (n, s + 1), and of the stages that dense output adds.
        real(wp), allocatable :: rate_q(:, :), rate_qd(:, :)
        !> How many stages dense output adds.
        integer :: n_extra = 0
        !> Whether they are those of the last step.
        logical :: has_extra = .false.
        !> Coordinates and increments of a stage, and an error (n).
        real(wp), allocatable, private :: q(:), dq(:), dqd(:)
    contains
        procedure :: initialize
        procedure :: advance
        procedure :: estimate
        procedure :: set_stage
        procedure :: stiffness
        procedure, private :: estimate_norm
        procedure :: pack_state
        procedure(set_tableau_interface), deferred :: set_tableau
    end type explicit_type

    abstract interface
        !> Set a, b, c, and e where there are estimates.
        subroutine set_tableau_interface(self)
            import :: explicit_type
            implicit none (type, external)
            class(explicit_type), intent(inout) :: self
        end subroutine set_tableau_interface
    end interface

contains

    !> Set the tableau and allocate the stages.
    subroutine initialize(self, scale, newton_tolerance)
        class(explicit_type), intent(inout) :: self
        real(wp), intent(in) :: scale(:)
        real(wp), intent(in) :: newton_tolerance
        integer :: n

        n = size(scale)
        call self%set_tableau()
        if (allocated(self%rate_q)) deallocate (self%rate_q, self%rate_qd, self%q, self%dq, self%dqd)
        allocate (self%rate_q(n, size(self%b) + 1 + self%n_extra), self%rate_qd(n, size(self%b) + 1 + self%n_extra), source=0.0_wp)
        allocate (self%q(n), self%dq(n), self%dqd(n), source=0.0_wp)
    end subroutine initialize

    !> One step.
    subroutine advance(self, chart, state, h, next, stat)
        class(explicit_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        type(state_type), intent(in) :: state
        real(wp), intent(in) :: h
        type(state_type), intent(inout) :: next
        integer, intent(out) :: stat
        real(wp) :: t
        integer :: i, s

        s = size(self%b)
        self%has_extra = .false.
        self%rate_q(:, 1) = state%qd
        self%rate_qd(:, 1) = state%qdd
        do i = 2, s
            t = state%t + self%c(i)*h
            if (self%c(i) >= 1.0_wp) t = next%t
            call self%set_stage(chart, state, h, t, self%a(:i - 1, i), i, stat)
            if (stat /= 0) return
        end do
        next%dq = state%dq
        next%dqd = state%dqd
        call add_rates(h, self%b, self%rate_q, next%dq)
        call add_rates(h, self%b, self%rate_qd, next%dqd)
        call chart%restore_position(next%t, next%dq, next%q, stat)
        if (stat /= 0) return
        call chart%restore_velocity(next%t, next%q, next%dqd, next%qd, stat)
        if (stat /= 0) return
        call chart%solve_dynamics(next%t, next%q, next%qd, next%qdd, stat)
        self%rate_q(:, s + 1) = next%qd
        self%rate_qd(:, s + 1) = next%qdd
    end subroutine advance

    !> Evaluate a stage: its rates from those before it.
    subroutine set_stage(self, chart, state, h, t, a, stage, stat)
        class(explicit_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        !> The state at the start of the step.
        type(state_type), intent(in) :: state
        real(wp), intent(in) :: h, t
        !> Coefficients of the rates before (stage - 1).
        real(wp), intent(in), contiguous :: a(:)
        integer, intent(in) :: stage
        integer, intent(out) :: stat

        self%dq = state%dq
        self%dqd = state%dqd
        call add_rates(h, a, self%rate_q, self%dq)
        call add_rates(h, a, self%rate_qd, self%dqd)
        chart%is_stage = .true.
        call chart%restore_position(t, self%dq, self%q, stat)
        chart%is_stage = .false.
        if (stat /= 0) return
        call chart%restore_velocity(t, self%q, self%dqd, self%rate_q(:, stage), stat)
        if (stat /= 0) return
        call chart%solve_dynamics(t, self%q, self%rate_q(:, stage), self%rate_qd(:, stage), stat)
    end subroutine set_stage

    !> The error of the last step in a weighted norm. Of two estimates (orders 5 and 3 of dop853) the combination of Hairer,
    !> Norsett, Wanner I, (10.17): the first squared over the root of the sum of squares, the second at a tenth.
    subroutine estimate(self, chart, h, weight_q, weight_qd, norm)
        class(explicit_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        real(wp), intent(in) :: h
        real(wp), intent(in), contiguous :: weight_q(:), weight_qd(:)
        real(wp), intent(out) :: norm
        real(wp) :: second

        norm = self%estimate_norm(1, h, weight_q, weight_qd)
        if (size(self%e, 2) < 2 .or. .not. norm > 0.0_wp) return
        second = 0.1_wp*self%estimate_norm(2, h, weight_q, weight_qd)
        norm = norm**2/sqrt(norm**2 + second**2)
    end subroutine estimate

    !> h |lambda| from the last stage and the end of the step, both at the same time. The difference of their values leans towards
    !> the direction of the largest eigenvalue, and that of their rates is lambda times as large (Hairer, Wanner II, (IV.2.2)).
    !> Velocities count h times in both, so that units do not matter and a slow motion stays below 1: not to be asked after dense
    !> output, which overwrites the stage.
    real(wp) function stiffness(self, h, arrived)
        class(explicit_type), intent(in) :: self
        real(wp), intent(in) :: h
        type(state_type), intent(in) :: arrived
        real(wp) :: of_q, of_qd, of_qdd
        integer :: i, s

        s = size(self%b)
        of_q = 0.0_wp
        of_qd = 0.0_wp
        of_qdd = 0.0_wp
        do i = 1, size(self%q)
            of_q = of_q + (arrived%q(i) - self%q(i))**2
            of_qd = of_qd + (arrived%qd(i) - self%rate_q(i, s))**2
            of_qdd = of_qdd + (arrived%qdd(i) - self%rate_qd(i, s))**2
        end do
        of_qd = h**2*of_qd
        of_qdd = h**4*of_qdd
        stiffness = sqrt((of_qd + of_qdd)/max(of_q + of_qd, tiny(1.0_wp)))
    end function stiffness

    !> The weighted norm of one estimate.
    real(wp) function estimate_norm(self, number, h, weight_q, weight_qd)
        class(explicit_type), intent(inout) :: self
        integer, intent(in) :: number
        real(wp), intent(in) :: h
        real(wp), intent(in), contiguous :: weight_q(:), weight_qd(:)

        self%dq = 0.0_wp
        self%dqd = 0.0_wp
        call add_rates(h, self%e(:, number), self%rate_q, self%dq)
        call add_rates(h, self%e(:, number), self%rate_qd, self%dqd)
        estimate_norm = weighted_norm(self%dq, self%dqd, weight_q, weight_qd)
    end function estimate_norm

    !> y := y + h sum_j weight(j) rate(:, j).
    pure subroutine add_rates(h, weight, rate, y)
        real(wp), intent(in) :: h
        real(wp), intent(in), contiguous :: weight(:), rate(:, :)
        real(wp), intent(inout), contiguous :: y(:)
        real(wp) :: w
        integer :: i, j

        do j = 1, size(weight)
            w = h*weight(j)
            ! Half of a large tableau is zero.
            if (.not. abs(w) > 0.0_wp) cycle
            do i = 1, size(y)
                y(i) = y(i) + w*rate(i, j)
            end do
        end do
    end subroutine add_rates

    !> The stages of the last step, for its dense output.
    subroutine pack_state(self, pack)
        class(explicit_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%rate_q)
        call pack%item(self%rate_qd)
        call pack%item(self%has_extra)
        call pack%item(self%q)
    end subroutine pack_state
end module tandem_stepper_explicit
