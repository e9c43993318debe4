! SPDX-License-Identifier: MIT
!> Radau IIA with 3, 5 or 7 stages: orders 5, 9 and 13, stage order equal to the number of stages, L-stable, stiffly accurate. The
!> stages are solved together: the eigenvalues of A split their Newton system into one real system and complex pairs of the size of
!> one stage.
!>
!> The number of stages may change from step to step. It minimises the work per unit of time, which is predicted from the errors and
!> the convergence of the last steps.
!> Source: Hairer, Wanner, Solving Ordinary Differential Equations II, 2nd ed., sections IV.5 and IV.8; E. Hairer, G. Wanner, Stiff
!> differential equations solved by Radau methods, J. Comput. Appl. Math. 111 (1999) 93-111.
module tandem_stepper_radau
    use tandem_kinds, only: wp
    use tandem_linalg_secants, only: secants_type
    use tandem_pack, only: pack_type
    use tandem_stepper, only: properties_type, weighted_norm
    use tandem_stepper_implicit, only: implicit_type
    use tandem_stepper_history, only: history_type
    use tandem_stepper_newton, only: newton_type
    use tandem_stepper_radau_choice, only: choice_type
    use tandem_stepper_radau_tableau, only: most_stages, tableau_of, tableau_type
    use tandem_stepper_state, only: state_type
    use tandem_status, only: status_newton_failed, status_ok
    use tandem_chart, only: chart_type, step_end
    use tandem_chart_implicit, only: implicit_chart_type
    implicit none (type, external)
    private

    public :: radau_type

    !> The method with automatic choice of the order.
    type, extends(implicit_type) :: radau_type
        !> Smallest and largest number of stages. Set them before `initialize`.
        integer :: least = 3, most = most_stages
        type(newton_type), private :: newton
        type(history_type), private :: history
        !> Accelerates slow corrections of all stages.
        type(secants_type), private :: secants
        !> Method of the last step; number of stages of the next step; data of the choice.
        type(tableau_type), private :: tableau
        integer, private :: wanted = 3
        type(choice_type), private :: choice
        !> Rates of position and velocity of the stages (n, 2, stages), positions and velocities of the stages (n, stages).
        real(wp), allocatable, private :: rate(:, :, :), q(:, :), qd(:, :)
        !> Residuals and corrections of the stages (height, stages), and their transforms. The height is the chart's n_residual, but
        !> at least 2 n, because `rescue` stores the rates of the stages here.
        real(wp), allocatable, private :: residual(:, :), transformed(:, :)
        !> Increments and rates at the start of the step; errors (n); increments of a stage (n, 2).
        real(wp), allocatable, private :: start_dq(:), start_dqd(:), start_q(:), start_qd(:), error_q(:), error_qd(:), &
            increment(:, :)
        real(wp), private :: t_start = 0.0_wp, tolerance = 0.0_wp, rounding_limit = 0.0_wp
        !> theta/(1 - theta) of the last step's Newton iteration.
        real(wp), private :: remainder = 1.0_wp
        !> True if the previous step was accepted, so that its error helps to predict the next error.
        logical, private :: is_settled = .false.
        !> Step size above which stages are hard to solve; true if the stages of the last step were hard to solve.
        real(wp), private :: easy_size = huge(1.0_wp)
        logical, private :: was_hard = .false.
    contains
        procedure, nopass :: properties
        procedure :: initialize, advance_stages, estimate_stages, interpolate, longest_next, order_of_estimate, pack_state
        procedure, private :: iterate
    end type radau_type

    interface
        !> Solve the three stages if this failed with all predicted start values and matrices. The following are tried in turn:
        !> start values from the end of a shorter step; matrices made at the last iterate; solving the stages one by one.
        module subroutine rescue(self, chart, state, h, t_end, stat)
            implicit none (type, external)
            class(radau_type), intent(inout) :: self
            class(implicit_chart_type), intent(inout) :: chart
            !> The state at the start of the step.
            type(state_type), intent(in) :: state
            !> Step size and end of the step.
            real(wp), intent(in) :: h, t_end
            integer, intent(out) :: stat
        end subroutine rescue
    end interface

contains

    !> Properties of the method with the smallest number of stages, which the first steps use.
    pure function properties() result(properties_)
        type(properties_type) :: properties_

        properties_ = properties_type('radau', 5, 3, .true., 3, 'L-stable, stiffly accurate; orders 5, 9, 13', &
            'Hairer, Wanner II, sections IV.5, IV.8', dense_order=3, damps=.true., is_predictive=.true., varies=.true.)
    end function properties

    !> Allocate the work space.
    subroutine initialize(self, scale, newton_tolerance)
        class(radau_type), intent(inout) :: self
        real(wp), intent(in) :: scale(:), newton_tolerance
        integer :: n

        n = size(scale)
        self%tolerance = newton_tolerance
        self%rounding_limit = 1.0e3_wp*newton_tolerance
        self%remainder = 1.0_wp
        self%is_settled = .false.
        self%easy_size = huge(1.0_wp)
        self%was_hard = .false.
        self%wanted = self%least
        self%tableau = tableau_of(self%least)
        self%choice = choice_type()
        call self%newton%allocate(scale, self%time_scale, newton_tolerance, [1.0_wp], [real(wp) ::])
        call self%history%allocate(n)
        if (allocated(self%rate)) deallocate (self%rate, self%q, self%qd, self%residual, self%transformed, &
            self%start_dq, self%start_dqd, self%start_q, self%start_qd, self%error_q, self%error_qd, self%increment)
        associate (most => self%most)
            allocate (self%rate(n, 2, most), self%q(n, most), self%qd(n, most), &
                self%residual(2*n, most), self%transformed(2*n, most), self%start_dq(n), self%start_dqd(n), self%start_q(n), &
                self%start_qd(n), self%error_q(n), self%error_qd(n), self%increment(n, 2), source=0.0_wp)
            call self%secants%allocate(2*n*most)
        end associate
    end subroutine initialize

    !> Enlarge the residuals to the size that a chart requires: before the first step, and after the number of rows in use has
    !> grown.
    subroutine fit_residuals(self, height)
        class(radau_type), intent(inout) :: self
        !> The chart's n_residual.
        integer, intent(in) :: height

        if (size(self%residual, 1) >= height) return
        deallocate (self%residual, self%transformed)
        allocate (self%residual(height, self%most), self%transformed(height, self%most), source=0.0_wp)
        call self%secants%allocate(height*self%most)
    end subroutine fit_residuals

    !> Perform one step. The following are tried in turn: extrapolation of the history; if the matrix is from an earlier step, a new
    !> matrix; if allowed, fewer stages with a shorter step, since a step size for more stages is too large for fewer.
    subroutine advance_stages(self, chart, state, h, next, stat)
        class(radau_type), intent(inout) :: self
        class(implicit_chart_type), intent(inout) :: chart
        type(state_type), intent(in) :: state
        real(wp), intent(in) :: h
        type(state_type), intent(inout) :: next
        integer, intent(out) :: stat
        logical :: continues
        integer :: i

        call fit_residuals(self, chart%n_residual)
        self%t_start = state%t
        self%start_dq = state%dq
        self%start_dqd = state%dqd
        self%start_q = state%qd
        self%start_qd = state%qdd
        call self%history%continue_from(state, continues)
        if (.not. continues) then
            self%is_settled = .false.
            self%wanted = self%least
            call self%choice%clear()
        end if
        if (self%wanted /= self%tableau%stages) call change_stages(self)
        associate (m => self%tableau, s => self%tableau%stages)
            self%newton%ratios = m%ratio(:(s - 1)/2)
            call self%newton%prepare(chart, self%history, state, h, m%diagonal*h, continues, stat)
            if (stat /= status_ok) return
            call solve_stages(self, chart, state, h, next%t, stat)
            if (stat == status_ok) then
                call combine(size(self%increment), size(self%increment), s - 1, m%a(:, s), self%rate, self%newton%base)
                self%newton%base(:, 1) = state%dq + h*self%newton%base(:, 1)
                self%newton%base(:, 2) = state%dqd + h*self%newton%base(:, 2)
                self%newton%rate = self%rate(:, :, s)
                call self%newton%finish(chart, h*m%a(s, s), next, stat)
            end if
            if (stat /= status_ok) then
                call self%history%clear()
                self%is_settled = .false.
                if (s > self%least) call self%choice%note_failure()
                self%wanted = max(self%least, s - 2)
                return
            end if
            do i = 1, s - 1
                call self%history%push(state%t + m%c(i)*h, self%q(:, i), self%rate(:, 1, i), self%rate(:, 2, i))
            end do
            call self%history%push(next%t, next%q, next%qd, next%qdd)
        end associate
    end subroutine advance_stages

    !> Change the number of stages.
    subroutine change_stages(self)
        class(radau_type), intent(inout) :: self

        call self%choice%restart(self%wanted > self%tableau%stages)
        self%tableau = tableau_of(self%wanted)
        self%remainder = 1.0_wp
        ! The cost of corrections with another number of stages is not comparable.
        self%newton%is_outdated = .true.
    end subroutine change_stages

    !> Solve the stages.
    subroutine solve_stages(self, chart, state, h, t_end, stat)
        class(radau_type), intent(inout) :: self
        class(implicit_chart_type), intent(inout) :: chart
        type(state_type), intent(in) :: state
        !> Step size and end of the step.
        real(wp), intent(in) :: h, t_end
        integer, intent(out) :: stat
        !> Number of corrections after which another start value or matrix is tried.
        integer, parameter :: few = 12
        !> Limit of the next steps after one that failed, which is much shorter, relative to that step.
        real(wp), parameter :: after_failure = 0.7_wp
        logical :: is_new, limits
        integer :: failure

        call predict(self, h)
        call self%iterate(chart, h, t_end, few, stat)
        do while (stat /= status_ok)
            call self%newton%renew_in_step(chart, self%history, state, h, self%tableau%diagonal*h, is_new, failure)
            if (.not. is_new) exit
            stat = failure
            if (stat /= status_ok) exit
            call predict(self, h)
            call self%iterate(chart, h, t_end, few, stat)
        end do
        limits = chart%follows_stiffness .and. self%tableau%stages == 3
        if (limits) call limit_step_size(self, chart, h, stat /= status_ok)
        if (stat /= status_ok .and. self%tableau%stages == 3) call rescue(self, chart, state, h, t_end, stat)
        if (limits .and. stat /= status_ok) self%easy_size = min(self%easy_size, after_failure*h)
    end subroutine solve_stages

    !> Limit the step size after a step whose stages were hard to solve, if the chart requests this: smaller first, then growing
    !> slowly. If the smaller step is hard too, as near a loss of rank, the step size is not the cause, and the limit is removed. On
    !> charts that do not follow the stiffness, the stages of stiff systems are always hard to solve, and the limit would cost many
    !> steps.
    pure subroutine limit_step_size(self, chart, h, is_hard)
        class(radau_type), intent(inout) :: self
        class(implicit_chart_type), intent(in) :: chart
        real(wp), intent(in) :: h
        logical, intent(in) :: is_hard

        if (.not. is_hard) then
            self%easy_size = chart%easing*min(self%easy_size, huge(1.0_wp)/2)
        else if (self%was_hard) then
            self%easy_size = huge(1.0_wp)
        else
            self%easy_size = chart%after_hard_step*h
        end if
        self%was_hard = is_hard
    end subroutine limit_step_size

    !> Start values of the stages by extrapolation of the history.
    subroutine predict(self, h)
        class(radau_type), intent(inout) :: self
        real(wp), intent(in) :: h
        integer :: i

        do i = 1, self%tableau%stages
            call self%history%extrapolate(self%t_start + self%tableau%c(i)*h, self%rate(:, 1, i), self%rate(:, 2, i), &
                self%tableau%stages + 2, self%q(:, i))
        end do
    end subroutine predict

    !> Newton's iteration for all stages. Once it has become slow, corrections are accelerated by earlier ones: the Jacobian of
    !> stiff forces changes along the step, for which few directions matter. The first correction also removes errors of the start
    !> values that the matrix does not describe, and is not used. Ratios of accelerated corrections alternate; the contraction is
    !> the geometric mean of two (as in Hairer and Wanner's program RADAU5).
    subroutine iterate(self, chart, h, t_end, most_corrections, stat)
        class(radau_type), intent(inout) :: self
        class(implicit_chart_type), intent(inout) :: chart
        !> Step size and end of the step.
        real(wp), intent(in) :: h, t_end
        integer, intent(in) :: most_corrections
        integer, intent(out) :: stat
        !> Contraction that indicates corrections of the size of rounding errors.
        real(wp), parameter :: stagnating = 0.7_wp
        !> Largest accepted ratio of the second correction to the first.
        real(wp), parameter :: coupling = 10.0_wp
        !> Contraction that is slow enough for an acceleration.
        real(wp), parameter :: slow = 0.1_wp
        real(wp) :: change, last_change, last_ratio, move, ratio, theta
        logical :: is_slow, was_slow
        integer :: k

        last_change = 1.0_wp
        last_ratio = 1.0_wp
        is_slow = .false.
        was_slow = .false.
        call set_weights(self, chart, h)
        do k = 1, most_corrections
            call correct(self, chart, k == 1, is_slow, h, t_end, move, change, stat)
            if (stat /= status_ok) return
            if (k == 1) then
                self%remainder = max(self%remainder, epsilon(1.0_wp))**0.8_wp
            else
                ratio = change/last_change
                theta = ratio
                if (was_slow) theta = sqrt(ratio*last_ratio)
                last_ratio = ratio
                was_slow = is_slow
                is_slow = theta > slow
                call self%choice%note_contraction(theta)
                if (move <= self%rounding_limit .and. .not. theta < merge(0.95_wp, stagnating, k == 2)) return
                ! Coupling of the stages can leave an error of the first correction, which appears in the second and vanishes with
                ! the third.
                if (k > 2 .or. .not. theta < coupling) then
                    if (.not. theta < 0.95_wp) exit
                    ! Stop if the remaining corrections cannot attain the tolerance.
                    if (theta**(most_corrections - k)*move > (1.0_wp - theta)*self%rounding_limit) exit
                end if
                self%remainder = 1.0_wp
                if (theta < 0.95_wp) self%remainder = theta/(1.0_wp - theta)
            end if
            if (self%remainder*move <= self%tolerance) then
                ! The contraction of an accelerated correction is not that of the next step's first one.
                if (was_slow) self%remainder = 1.0_wp
                return
            end if
            last_change = max(change, tiny(1.0_wp))
        end do
        self%remainder = 1.0_wp
        stat = status_newton_failed
    end subroutine iterate

    !> Set the weights of the inner product of corrections: accelerations over the step have the size of velocities, and multipliers
    !> follow from the rates.
    subroutine set_weights(self, chart, h)
        class(radau_type), intent(inout) :: self
        class(implicit_chart_type), intent(in) :: chart
        real(wp), intent(in) :: h
        integer :: i, start

        self%secants%weight(:) = 0.0_wp
        do i = 1, self%tableau%stages
            start = (i - 1)*size(self%residual, 1)
            associate (q => chart%n_rates(1), qd => chart%n_rates(2))
                self%secants%weight(start + 1:start + q) = 1.0_wp
                self%secants%weight(start + q + 1:start + q + qd) = h**2
            end associate
        end do
    end subroutine set_weights

    !> Perform one correction of all stages.
    subroutine correct(self, chart, is_first, is_slow, h, t_end, move, change, stat)
        class(radau_type), intent(inout) :: self
        class(implicit_chart_type), intent(inout) :: chart
        !> True for the first iterates, which are predicted rates and coordinates.
        logical, intent(in) :: is_first
        !> True to accelerate the correction.
        logical, intent(in) :: is_slow
        !> Step size and end of the step.
        real(wp), intent(in) :: h, t_end
        !> Largest correction of a stage, with and without its acceleration.
        real(wp), intent(out) :: move, change
        integer, intent(out) :: stat
        real(wp) :: shortening, stage_change, t
        integer :: height, i, j, m, n

        n = size(self%increment, 1)
        m = chart%n_residual
        height = size(self%residual, 1)
        move = 0.0_wp
        change = 0.0_wp
        associate (s => self%tableau%stages, tableau => self%tableau)
            do i = 1, s
                call combine(2*n, 2*n, s, tableau%a(:, i), self%rate, self%increment)
                self%increment(:, 1) = self%start_dq + h*self%increment(:, 1)
                self%increment(:, 2) = self%start_dqd + h*self%increment(:, 2)
                t = self%t_start + tableau%c(i)*h
                if (i == s) t = t_end
                ! The chart ignores components of the rates. They are changed below, for all stages together.
                self%residual(:m, i) = 0.0_wp
                call chart%find_residual(self%newton%goal(i, is_first, h), t, self%increment, self%q(:, i), self%qd(:, i), &
                    self%rate(:, :, i), self%residual(:m, i), stat)
                if (stat /= status_ok) return
            end do
            do j = 1, s
                call combine(m, height, s, tableau%t_inverse(:, j), self%residual, self%transformed(:, j))
            end do
            call chart%solve(self%transformed(:m, 1))
            do j = 1, (s - 1)/2
                call chart%solve_pair(j, self%transformed(:m, 2*j), self%transformed(:m, 2*j + 1))
            end do
            do i = 1, s
                call combine(m, height, s, tableau%t(:, i), self%transformed, self%residual(:, i))
            end do
            shortening = 1.0_wp
            if (is_slow) then
                call self%secants%improve(height*s, .true., self%residual)
                shortening = self%secants%shortening(height*s)
            else
                call self%secants%begin(height*s, self%residual)
            end if
            do i = 1, s
                call chart%update(i, self%q(:, i), self%qd(:, i), tableau%diagonal*h, self%residual(:m, i), &
                    self%rate(:, :, i), stage_change, stat)
                if (stat /= status_ok) return
                move = max(move, stage_change)
            end do
            change = shortening*move
        end associate
    end subroutine correct

    !> y(:m) := sum_j weight(j) x(:m, j). Three columns, the most frequent case, are summed at once.
    pure subroutine combine(m, height, columns, weight, x, y)
        !> Number of rows to compute; rows and columns of x.
        integer, intent(in) :: m, height, columns
        real(wp), intent(in) :: weight(columns), x(height, columns)
        real(wp), intent(inout) :: y(height)
        integer :: i, j

        if (columns == 3) then
            do i = 1, m
                y(i) = weight(1)*x(i, 1) + weight(2)*x(i, 2) + weight(3)*x(i, 3)
            end do
            return
        end if
        y(:m) = weight(1)*x(:m, 1)
        do j = 2, columns
            y(:m) = y(:m) + weight(j)*x(:m, j)
        end do
    end subroutine combine

    !> Error of the last step (IV.8.19). If it is large in a first step or after a rejection, it is evaluated again with the rates
    !> at the resulting state (IV.8.20), so that a fast transient does not count as an error.
    subroutine estimate_stages(self, chart, h, weight_q, weight_qd, norm)
        class(radau_type), intent(inout) :: self
        class(implicit_chart_type), intent(inout) :: chart
        real(wp), intent(in) :: h
        real(wp), intent(in), contiguous :: weight_q(:), weight_qd(:)
        real(wp), intent(out) :: norm
        integer :: stat

        call set_embedded_difference(self, h)
        call chart%filter(self%error_q, self%error_qd)
        norm = weighted_norm(self%error_q, self%error_qd, weight_q, weight_qd)
        if (norm >= 1.0_wp .and. .not. self%is_settled) then
            self%increment(:, 1) = self%start_dq + self%error_q
            self%increment(:, 2) = self%start_dqd + self%error_qd
            associate (q => self%q(:, 1), qd => self%qd(:, 1))
                call chart%restore(self%t_start, self%increment(:, 1), self%increment(:, 2), step_end, q, qd, stat)
                if (stat == status_ok) call chart%accelerate(self%t_start, q, qd, step_end, self%increment(:, 2), stat)
                if (stat == status_ok) then
                    self%start_q = qd
                    self%start_qd = self%increment(:, 2)
                    call set_embedded_difference(self, h)
                    call chart%filter(self%error_q, self%error_qd)
                    norm = weighted_norm(self%error_q, self%error_qd, weight_q, weight_qd)
                end if
            end associate
        end if
        self%is_settled = norm < 1.0_wp
        if (self%is_settled .and. self%most > self%least) call choose_stages(self, chart, h, weight_q, weight_qd, norm)
    end subroutine estimate_stages

    !> Set the difference from the embedded formula.
    subroutine set_embedded_difference(self, h)
        class(radau_type), intent(inout) :: self
        real(wp), intent(in) :: h
        real(wp) :: weight
        integer :: j

        associate (m => self%tableau)
            self%error_q = (m%diagonal*h)*self%start_q
            self%error_qd = (m%diagonal*h)*self%start_qd
            do j = 1, m%stages
                weight = m%diagonal*h*m%weight(j)
                self%error_q = self%error_q + weight*self%rate(:, 1, j)
                self%error_qd = self%error_qd + weight*self%rate(:, 2, j)
            end do
        end associate
    end subroutine set_embedded_difference

    !> Choose the number of stages of the next step, if a choice is due.
    subroutine choose_stages(self, chart, h, weight_q, weight_qd, norm)
        class(radau_type), intent(inout) :: self
        class(implicit_chart_type), intent(inout) :: chart
        real(wp), intent(in) :: h
        real(wp), intent(in), contiguous :: weight_q(:), weight_qd(:)
        !> Error of the last step.
        real(wp), intent(in) :: norm
        real(wp) :: fewer, more

        associate (s => self%tableau%stages)
            call self%choice%note_step(h, real(chart%counts%newton_corrections, wp) + &
                chart%matrix_cost*real(chart%counts%newton_matrices, wp))
            if (.not. self%choice%is_due(norm)) return
            fewer = huge(1.0_wp)
            more = huge(1.0_wp)
            if (s > self%least) fewer = error_with(s - 2)
            if (s < self%most .and. self%history%has_order(s + 2)) more = error_with(s + 2)
            call self%choice%choose(s, h, norm, fewer, more, self%wanted)
        end associate

    contains

        !> Error of the last step with another number of stages, from the divided difference of the last rates.
        real(wp) function error_with(stages)
            integer, intent(in) :: stages
            type(tableau_type) :: other
            real(wp) :: factor

            other = tableau_of(stages)
            call self%history%difference(stages, self%error_q, self%error_qd)
            factor = other%principal*h**(stages + 1)
            self%error_q = factor*self%error_q
            self%error_qd = factor*self%error_qd
            call chart%filter(self%error_q, self%error_qd)
            error_with = weighted_norm(self%error_q, self%error_qd, weight_q, weight_qd)
        end function error_with
    end subroutine choose_stages

    !> Increments at a time within the last step, by the collocation polynomial. Between the ends of the step they have the order of
    !> the stages, independent of stiffness. The polynomial is integrated with the nodes of the method itself, which are exact for
    !> polynomials of twice its degree.
    subroutine interpolate(self, chart, start, arrived, state, slope_q, slope_qd, stat)
        class(radau_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        type(state_type), intent(in) :: start, arrived
        type(state_type), intent(inout) :: state
        real(wp), intent(out), contiguous :: slope_q(:), slope_qd(:)
        integer, intent(out) :: stat
        real(wp) :: h, integral, slope, x
        integer :: j, k

        stat = 0
        h = arrived%t - start%t
        x = (state%t - start%t)/h
        state%dq(:) = start%dq
        state%dqd(:) = start%dqd
        slope_q = 0.0_wp
        slope_qd = 0.0_wp
        associate (m => self%tableau, s => self%tableau%stages)
            do j = 1, s
                slope = part(m%c(:s), j, x)
                integral = 0.0_wp
                do k = 1, s
                    integral = integral + h*x*m%a(k, s)*part(m%c(:s), j, x*m%c(k))
                end do
                state%dq(:) = state%dq + integral*self%rate(:, 1, j)
                state%dqd(:) = state%dqd + integral*self%rate(:, 2, j)
                slope_q = slope_q + slope*self%rate(:, 1, j)
                slope_qd = slope_qd + slope*self%rate(:, 2, j)
            end do
        end associate
    end subroutine interpolate

    !> Lagrange polynomial of node j.
    pure real(wp) function part(c, j, x)
        real(wp), intent(in) :: c(:)
        integer, intent(in) :: j
        real(wp), intent(in) :: x
        integer :: i

        part = 1.0_wp
        do i = 1, size(c)
            if (i /= j) part = part*(x - c(i))/(c(j) - c(i))
        end do
    end function part

    !> Largest size of the next step. Stages of long steps that need many corrections cost more than those of several shorter steps,
    !> and a step with fewer stages must be shorter.
    pure real(wp) function longest_next(self)
        class(radau_type), intent(in) :: self

        longest_next = min(self%easy_size, self%choice%longest)
    end function longest_next

    !> Order of the error estimate of the last step, which is proportional to the step size to the power of this order plus one.
    pure integer function order_of_estimate(self)
        class(radau_type), intent(in) :: self

        order_of_estimate = self%tableau%stages
    end function order_of_estimate

    !> Pack the state on which the next steps and the dense output of the last step depend.
    subroutine pack_state(self, pack)
        class(radau_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack
        integer :: stages

        stages = self%tableau%stages
        call pack%item(stages)
        self%tableau = tableau_of(stages)
        call pack%item(self%wanted)
        call self%choice%pack_state(pack)
        call self%newton%pack_state(pack)
        call self%history%pack_state(pack)
        call pack%item(self%rate)
        call pack%item(self%remainder)
        call pack%item(self%is_settled)
        call pack%item(self%easy_size)
        call pack%item(self%was_hard)
    end subroutine pack_state
end module tandem_stepper_radau
