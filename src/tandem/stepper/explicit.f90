! SPDX-License-Identifier: MIT
!> Explicit Runge-Kutta methods, given by their tableau.
!>
!> Stages are increments in ambient coordinates, xi' = qd and eta' = qdd. The chart restores the constraints at each stage.
!> Runge-Kutta methods are linear in their stages, so that the trajectory is that of (51) in the chart coordinates v and w.
!>
!> Without projected stages, the chart restores the constraints only at the ends of steps. This is not the paper's method: it
!> integrates the index-1 equations and projects the result. As C qdd = -gamma holds off the manifold too, stages of a method of
!> order p keep their order, and the ends of steps are off the manifold by O(h^(p+1)) before the projection.
!>
!> The acceleration at the end of a step is the first stage of the next step. Error estimates may also use it.
module tandem_stepper_explicit
    use tandem_kinds, only: lane, short, wp
    use tandem_linalg_aligned, only: allocate_aligned
    use tandem_linalg_kernels, only: copy
    use tandem_pack, only: pack_type
    use tandem_stepper, only: properties_type, stepper_type, weighted_norm
    use tandem_stepper_combination, only: combination_type
    use tandem_stepper_state, only: go_along, state_type
    use tandem_chart, only: chart_type, goal_type, step_end
    implicit none (type, external)
    private

    public :: explicit_type

    !> Explicit method with s stages, given by its tableau.
    type, abstract, extends(stepper_type) :: explicit_type
        !> Coefficients a(j, i), j < i, of stage i = 2 ... s; nodes c(i) = sum_j a(j, i); weights b (s).
        real(wp), allocatable :: a(:, :), b(:), c(:)
        !> Weights of the error estimates (s + 1, number of estimates). The last row applies to the rate at the end of the step.
        real(wp), allocatable :: e(:, :)
        !> Rates of the stages, of the end of the step (column s + 1) if there are error estimates, and of the additional stages of
        !> dense output. Each column contains the rates of the n coordinates, zeros up to row `offset`, and the rates of the
        !> velocities, padded with zeros to a multiple of `lane`.
        real(wp), allocatable :: rate(:, :)
        !> True if each stage uses only the rates of the previous stage, as in Kutta's method, and nothing else uses rates. `rate`
        !> is then not allocated. `y` contains the weighted sum of the rates so far and, after the step, the rates of the last
        !> stage.
        logical, private :: sums_rates = .false.
        !> In the layout of a column of `rate`: increments of the current stage; increments at the start of the step, or the state
        !> at the start if stages are not projected.
        real(wp), allocatable :: y(:)
        real(wp), allocatable, private :: y_start(:)
        !> In the same layout, if there are error estimates: zeros, and work space.
        real(wp), allocatable :: zero(:), part(:), slope(:)
        !> Absolute displacement, per coordinate, that projects the end of a step onto the manifold (n), if stages are not
        !> projected. This is the error across the manifold, which the rates of the stages do not show if an imposed motion has a
        !> kink. The error of the velocities across the manifold is always checked.
        real(wp), allocatable, private :: shift(:)
        !> Number of coordinates; offset of the velocities in a column. The zeros between both parts keep them in separate
        !> registers, so that sums for the next position need not wait for the last acceleration.
        integer :: n = 0, offset = 0
        !> True if the chart stores stages by number, as start values for the same stage of the next step. For methods of higher
        !> order this costs more than it saves (measured with dop853).
        logical, private :: chart_stores_stages = .false.
        !> Number of additional stages of dense output.
        integer :: n_extra = 0
        !> True if the additional stages are evaluated for the last step.
        logical :: has_extra = .false.
        !> Coordinates of a stage (n); c^2/2 - sum a c of the stages and of the end of the step (s + 1).
        real(wp), allocatable, private :: q(:), defect(:)
        !> Reciprocals of the coordinate scales (n), if any of them is not 1.
        real(wp), allocatable, private :: inverse_scale(:)
        !> Rows of the tableau: of the stages (s, the first is empty), of the end of the step, of the error estimates.
        type(combination_type), allocatable, private :: stage_sum(:), end_sum, estimate_sum(:)
    contains
        procedure :: initialize, advance, estimate, start_near, set_near, stiffness
        procedure, private :: estimate_norm
        procedure :: pack_state
        procedure(set_tableau_interface), deferred :: set_tableau
    end type explicit_type

    abstract interface
        !> Set a, b, c, and e if there are estimates.
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
        real(wp), intent(in) :: scale(:), newton_tolerance
        type(properties_type) :: properties
        integer :: height, i, n, n_estimates, s

        n = size(scale)
        call self%set_tableau()
        properties = self%properties()
        self%chart_stores_stages = properties%order <= 5
        s = size(self%b)
        self%n = n
        self%offset = short*((n + short - 1)/short)
        if (allocated(self%inverse_scale)) deallocate (self%inverse_scale)
        if (any(abs(scale - 1.0_wp) > 0.0_wp)) self%inverse_scale = 1.0_wp/scale
        n_estimates = 0
        if (allocated(self%e)) n_estimates = size(self%e, 2)
        if (allocated(self%q)) deallocate (self%q, self%defect)
        if (allocated(self%zero)) deallocate (self%zero, self%part, self%slope)
        if (allocated(self%shift)) deallocate (self%shift)
        allocate (self%shift(merge(n, 0, n_estimates > 0)), source=0.0_wp)
        self%sums_rates = n_estimates + self%n_extra == 0 .and. s > 1
        do i = 3, s
            self%sums_rates = self%sums_rates .and. .not. any(abs(self%a(:i - 2, i)) > 0.0_wp)
        end do
        height = lane*((self%offset + n + lane - 1)/lane)
        call allocate_aligned(self%rate, height, merge(0, s + min(n_estimates, 1) + self%n_extra, self%sums_rates))
        call allocate_aligned(self%y, height)
        call allocate_aligned(self%y_start, merge(0, height, self%sums_rates))
        if (n_estimates > 0) then
            call allocate_aligned(self%zero, height)
            call allocate_aligned(self%part, height)
            call allocate_aligned(self%slope, height)
        end if
        allocate (self%q(n), self%defect(s + 1), source=0.0_wp)
        !GCC$ UNROLL 1
        do i = 1, s
            self%defect(i) = 0.5_wp*self%c(i)**2 - dot_product(self%a(:i - 1, i), self%c(:i - 1))
        end do
        self%defect(s + 1) = 0.5_wp - dot_product(self%b, self%c)
        if (allocated(self%stage_sum)) deallocate (self%stage_sum, self%end_sum, self%estimate_sum)
        allocate (self%stage_sum(s), self%end_sum, self%estimate_sum(n_estimates))
        do i = 2, s
            call self%stage_sum(i)%set(self%a(:i - 1, i))
        end do
        call self%end_sum%set(self%b)
        do i = 1, n_estimates
            call self%estimate_sum(i)%set(self%e(:, i))
        end do
    end subroutine initialize

    !> Perform one step.
    subroutine advance(self, chart, state, h, next, stat)
        class(explicit_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        type(state_type), intent(in) :: state
        real(wp), intent(in) :: h
        type(state_type), intent(inout) :: next
        integer, intent(out) :: stat
        real(wp), parameter :: rounding = 8*epsilon(1.0_wp)
        real(wp) :: t
        integer :: i, n, s

        n = self%n
        s = size(self%b)
        self%has_extra = .false.
        if (self%sums_rates) then
            call advance_with_sums(self, chart, state, h, next, stat)
            return
        end if
        !GCC$ UNROLL 1
        do i = 1, n
            self%rate(i, 1) = state%qd(i)
            self%rate(self%offset + i, 1) = state%qdd(i)
        end do
        if (self%projects_stages) call chart%start_step(state%qdd)
        call store_start(self, state)
        stat = 0
        !GCC$ UNROLL 1
        do i = 2, s
            t = state%t + self%c(i)*h
            if (self%c(i) >= 1.0_wp) t = next%t
            call set_stage(self, chart, h, t, self%stage_sum(i), i, stat)
            if (stat /= 0) exit
        end do
        if (stat == 0) then
            ! The point was restored to the manifold, so begin with its increments.
            if (.not. self%projects_stages) call load(n, self%offset, state%dq, state%dqd, self%y_start)
            call self%end_sum%add(size(self%rate, 1), size(self%rate, 2), h, self%rate, self%y_start, self%y)
            !GCC$ UNROLL 1
            do i = 1, n
                next%dq(i) = self%y(i)
                next%dqd(i) = self%y(self%offset + i)
            end do
            call arrive(self, chart, h, next, stat)
        end if
        if (stat /= 0 .or. size(self%estimate_sum) == 0) return
        !GCC$ UNROLL 1
        do i = 1, n
            self%rate(i, s + 1) = next%qd(i)
            self%rate(self%offset + i, s + 1) = next%qdd(i)
        end do
        if (self%projects_stages) return
        ! Sum increments, which excludes the rounding errors of the coordinates.
        !GCC$ UNROLL 1
        do i = 1, n
            associate (way => (next%q(i) - state%q(i)) - (self%y(i) - state%dq(i)))
                self%shift(i) = max(abs(way) - rounding*abs(next%q(i)), 0.0_wp)
            end associate
        end do
    end subroutine advance

    !> `advance` for methods that sum rates as they are computed. Stages are stored in the state for the end of the step.
    subroutine advance_with_sums(self, chart, state, h, next, stat)
        class(explicit_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        type(state_type), intent(in) :: state
        real(wp), intent(in) :: h
        type(state_type), intent(inout) :: next
        integer, intent(out) :: stat
        integer :: i, s

        s = size(self%b)
        associate (n => self%n, sum_q => self%y(:self%n), sum_qd => self%y(self%offset + 1:self%offset + self%n))
            if (self%projects_stages) call chart%start_step(state%qdd)
            stat = 0
            do i = 2, s
                if (i == 2) then
                    call set_sums(n, self%b(1), state%qd, state%qdd, sum_q, sum_qd)
                    call step_from_start(h*self%a(1, 2), state%qd, state%qdd)
                else
                    call go_along(n, self%b(i - 1), next%qd, next%qdd, sum_q, sum_qd)
                    call step_from_start(h*self%a(i - 1, i), next%qd, next%qdd)
                end if
                associate (t => merge(next%t, state%t + self%c(i)*h, self%c(i) >= 1.0_wp), goal => stage_goal(self, i, h))
                    stat = 0
                    if (self%projects_stages) then
                        call chart%restore(t, next%dq, next%dqd, goal, next%q, next%qd, stat)
                    else
                        next%q(:) = next%dq
                        next%qd(:) = next%dqd
                    end if
                    if (stat == 0) call chart%accelerate(t, next%q, next%qd, goal, next%qdd, stat)
                end associate
                if (stat /= 0) exit
            end do
            if (stat == 0) then
                ! Store the last stage, with its rates in place of the sums, for `stiffness`.
                call copy(n, next%q, self%q)
                call finish_sums(n, h, self%b(s), state%dq, next%qd, sum_q, next%dq)
                call finish_sums(n, h, self%b(s), state%dqd, next%qdd, sum_qd, next%dqd)
                call arrive(self, chart, h, next, stat)
            end if
        end associate

    contains

        !> Point of the next stage, from the increments or the state at the start of the step.
        subroutine step_from_start(step, rate_q, rate_qd)
            real(wp), intent(in) :: step
            real(wp), intent(in), contiguous :: rate_q(:), rate_qd(:)

            if (self%projects_stages) then
                call add_rates(self%n, step, state%dq, state%dqd, rate_q, rate_qd, next%dq, next%dqd)
            else
                call add_rates(self%n, step, state%q, state%qd, rate_q, rate_qd, next%dq, next%dqd)
            end if
        end subroutine step_from_start
    end subroutine advance_with_sums

    !> Begin the weighted sums of rates.
    pure subroutine set_sums(n, weight, rate_q, rate_qd, sum_q, sum_qd)
        integer, intent(in) :: n
        real(wp), intent(in) :: weight, rate_q(n), rate_qd(n)
        real(wp), intent(out) :: sum_q(n), sum_qd(n)
        integer :: i

        !GCC$ UNROLL 1
        do i = 1, n
            sum_q(i) = weight*rate_q(i)
            sum_qd(i) = weight*rate_qd(i)
        end do
    end subroutine set_sums

    !> Increments after a step along given rates.
    pure subroutine add_rates(n, step, from_q, from_qd, rate_q, rate_qd, dq, dqd)
        integer, intent(in) :: n
        real(wp), intent(in) :: step, from_q(n), from_qd(n), rate_q(n), rate_qd(n)
        real(wp), intent(out) :: dq(n), dqd(n)
        integer :: i

        !GCC$ UNROLL 1
        do i = 1, n
            dq(i) = from_q(i) + step*rate_q(i)
            dqd(i) = from_qd(i) + step*rate_qd(i)
        end do
    end subroutine add_rates

    !> Increments at the end of the step. The rates of the last stage replace the sums.
    pure subroutine finish_sums(n, h, weight, from, rate, sum, increment)
        integer, intent(in) :: n
        real(wp), intent(in) :: h, weight, from(n), rate(n)
        real(wp), intent(inout) :: sum(n), increment(n)
        integer :: i

        !GCC$ UNROLL 1
        do i = 1, n
            increment(i) = from(i) + h*(sum(i) + weight*rate(i))
            sum(i) = rate(i)
        end do
    end subroutine finish_sums

    !> Store the start of the step, before the first call of `set_stage`.
    subroutine store_start(self, state)
        class(explicit_type), intent(inout) :: self
        !> The state at the start of the step.
        type(state_type), intent(in) :: state

        if (self%projects_stages) then
            call load(self%n, self%offset, state%dq, state%dqd, self%y_start)
        else
            call load(self%n, self%offset, state%q, state%qd, self%y_start)
        end if
    end subroutine store_start

    !> Store the start of the step, before the first call of `set_near`.
    subroutine start_near(self, state)
        class(explicit_type), intent(inout) :: self
        !> The state at the start of the step.
        type(state_type), intent(in) :: state

        call load(self%n, self%offset, state%q, state%qd, self%y_start)
    end subroutine start_near

    !> Evaluate a stage of dense output, given the previous rates, at its projection onto the constraints. The chart of the step is
    !> not used, because the step may pass a singular point of the chart.
    subroutine set_near(self, chart, h, t, sum_before, stage, stat)
        class(explicit_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        real(wp), intent(in) :: h, t
        !> Weights of the previous rates.
        type(combination_type), intent(in) :: sum_before
        integer, intent(in) :: stage
        integer, intent(out) :: stat

        associate (n => self%n, offset => self%offset, rate => self%rate, y => self%y)
            call sum_before%add(size(rate, 1), size(rate, 2), h, rate, self%y_start, y)
            call chart%project(t, y(:n), y(offset + 1:offset + n), .true., stat)
            if (stat /= 0) return
            rate(:n, stage) = y(offset + 1:offset + n)
            call chart%accelerate(t, y(:n), y(offset + 1:offset + n), step_end, rate(offset + 1:offset + n, stage), stat)
        end associate
    end subroutine set_near

    !> Evaluate a stage, given the previous rates.
    subroutine set_stage(self, chart, h, t, sum_before, stage, stat)
        class(explicit_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        real(wp), intent(in) :: h, t
        !> Weights of the previous rates.
        type(combination_type), intent(in) :: sum_before
        integer, intent(in) :: stage
        integer, intent(out) :: stat
        type(goal_type) :: goal

        associate (n => self%n, offset => self%offset, rate => self%rate, y => self%y)
            goal = stage_goal(self, stage, h)
            call sum_before%add(size(rate, 1), size(rate, 2), h, rate, self%y_start, y)
            if (self%projects_stages) then
                call chart%restore(t, y(:n), y(offset + 1:offset + n), goal, self%q, rate(:n, stage), stat)
                if (stat /= 0) return
            else
                ! Begin with the state itself. The origin of the chart and its u are not used.
                self%q(:) = y(:n)
                rate(:n, stage) = y(offset + 1:offset + n)
            end if
            call chart%accelerate(t, self%q, rate(:n, stage), goal, rate(offset + 1:offset + n, stage), stat)
        end associate
    end subroutine set_stage

    !> Goal that describes a stage to the chart.
    pure type(goal_type) function stage_goal(self, stage, h) result(goal)
        class(explicit_type), intent(in) :: self
        integer, intent(in) :: stage
        real(wp), intent(in) :: h

        goal%is_stage = .true.
        if (self%chart_stores_stages) goal%stage = stage
        goal%h = h
        goal%defect = h**2*self%defect(stage)
    end function stage_goal

    !> Restore the end of a step and evaluate the acceleration there.
    subroutine arrive(self, chart, h, next, stat)
        class(explicit_type), intent(in) :: self
        class(chart_type), intent(inout) :: chart
        real(wp), intent(in) :: h
        type(state_type), intent(inout) :: next
        integer, intent(out) :: stat
        type(goal_type) :: goal

        goal%defect = h**2*self%defect(size(self%defect))
        goal%follows_stages = .not. self%projects_stages
        call chart%restore(next%t, next%dq, next%dqd, goal, next%q, next%qd, stat)
        if (stat == 0) call chart%accelerate(next%t, next%q, next%qd, step_end, next%qdd, stat)
    end subroutine arrive

    !> y := the increments of a state, or its coordinates and velocities.
    pure subroutine load(n, offset, dq, dqd, y)
        integer, intent(in) :: n, offset
        real(wp), intent(in) :: dq(n), dqd(n)
        real(wp), intent(inout) :: y(offset + n)
        integer :: i

        !GCC$ UNROLL 1
        do i = 1, n
            y(i) = dq(i)
            y(offset + i) = dqd(i)
        end do
    end subroutine load

    !> Error of the last step in a weighted norm. Two estimates (orders 5 and 3 of dop853) are combined as in Hairer, Norsett,
    !> Wanner I, (10.17): the square of the first over the root of the sum of its square and a hundredth of the square of the
    !> second. Without projected stages the error is at least a tenth of the displacement by the final projection.
    subroutine estimate(self, chart, h, weight_q, weight_qd, norm)
        class(explicit_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        real(wp), intent(in) :: h
        real(wp), intent(in), contiguous :: weight_q(:), weight_qd(:)
        real(wp), intent(out) :: norm
        real(wp), parameter :: of_shift = 0.1_wp
        real(wp) :: second

        norm = self%estimate_norm(1, h, weight_q, weight_qd)
        if (size(self%estimate_sum) > 1 .and. norm > 0.0_wp) then
            second = 0.1_wp*self%estimate_norm(2, h, weight_q, weight_qd)
            norm = norm**2/sqrt(norm**2 + second**2)
        end if
        if (.not. self%projects_stages) norm = max(norm, of_shift*norm2(self%shift*weight_q)/sqrt(2*real(self%n, wp)))
    end subroutine estimate

    !> h |lambda| from the last stage and the end of the step, which have the same time. Their difference is nearly an eigenvector
    !> of the largest eigenvalue lambda, and the difference of their rates is lambda times as large (Hairer, Wanner II, (IV.2.2)).
    !> Velocities are multiplied by h and coordinates divided by their scales, so that the result does not depend on units and is
    !> below 1 for slow motions. The result is 0 if the differences are rounding errors, as at rest. Dense output overwrites the
    !> stage, so this must be called first.
    real(wp) function stiffness(self, h, arrived)
        class(explicit_type), intent(in) :: self
        real(wp), intent(in) :: h
        type(state_type), intent(in) :: arrived

        if (self%sums_rates) then
            stiffness = largest_change(self, h, arrived, self%y(:self%n), self%y(self%offset + 1:))
        else
            associate (s => size(self%b))
                stiffness = largest_change(self, h, arrived, self%rate(:self%n, s), self%rate(self%offset + 1:, s))
            end associate
        end if
    end function stiffness

    !> h |lambda| for given rates of the last stage.
    pure real(wp) function largest_change(self, h, arrived, qd, qdd) result(stiffness)
        class(explicit_type), intent(in) :: self
        real(wp), intent(in) :: h
        type(state_type), intent(in) :: arrived
        real(wp), intent(in), contiguous :: qd(:), qdd(:)
        real(wp) :: f, of_q, of_qd, of_qdd, largest
        !> Relative differences below this limit are rounding errors.
        real(wp), parameter :: rounding = 16*epsilon(1.0_wp)
        integer :: i

        f = 1.0_wp
        largest = tiny(1.0_wp)
        of_q = 0.0_wp
        of_qd = 0.0_wp
        of_qdd = 0.0_wp
        !GCC$ UNROLL 1
        do i = 1, size(self%q)
            if (allocated(self%inverse_scale)) f = self%inverse_scale(i)
            of_q = of_q + (f*(arrived%q(i) - self%q(i)))**2
            of_qd = of_qd + (f*(arrived%qd(i) - qd(i)))**2
            of_qdd = of_qdd + (f*(arrived%qdd(i) - qdd(i)))**2
            largest = max(largest, abs(f*arrived%q(i)), abs(f*h*arrived%qd(i)))
        end do
        of_qd = h**2*of_qd
        of_qdd = h**4*of_qdd
        stiffness = 0.0_wp
        if (of_q + of_qd > (rounding*largest)**2) stiffness = sqrt((of_qd + of_qdd)/(of_q + of_qd))
    end function largest_change

    !> Weighted norm of one error estimate.
    real(wp) function estimate_norm(self, number, h, weight_q, weight_qd)
        class(explicit_type), intent(inout) :: self
        integer, intent(in) :: number
        real(wp), intent(in) :: h
        real(wp), intent(in), contiguous :: weight_q(:), weight_qd(:)

        call self%estimate_sum(number)%add(size(self%rate, 1), size(self%rate, 2), h, self%rate, self%zero, self%y)
        estimate_norm = weighted_norm(self%y(:self%n), self%y(self%offset + 1:self%offset + self%n), weight_q, &
            weight_qd)
    end function estimate_norm

    !> Pack the data of the last step that dense output requires.
    subroutine pack_state(self, pack)
        class(explicit_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%rate)
        call pack%item(self%has_extra)
        call pack%item(self%q)
    end subroutine pack_state
end module tandem_stepper_explicit
