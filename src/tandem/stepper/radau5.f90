! SPDX-License-Identifier: MIT
!> Radau IIA, 3 stages: order 5, stage order 3, L-stable, stiffly accurate. The stages are solved together: the eigenvalues of A
!> part their Newton system into one real and one complex pair of the size of one stage.
!> Source: Hairer, Wanner, Solving Ordinary Differential Equations II, 2nd ed., sections IV.5 and IV.8.
module tandem_stepper_radau5
    use tandem_kinds, only: wp
    use tandem_pack, only: pack_type
    use tandem_stepper, only: properties_type, stepper_type, weighted_norm
    use tandem_stepper_history, only: history_type
    use tandem_stepper_newton, only: newton_type
    use tandem_stepper_state, only: state_type
    use tandem_status, only: status_newton_failed, status_ok
    use tandem_chart, only: chart_type
    implicit none (type, external)
    private

    public :: radau5_type

    real(wp), parameter :: s6 = sqrt(6.0_wp)
    !> Nodes and coefficients; a(:, i) are those of stage i.
    real(wp), parameter :: c(3) = [(4 - s6)/10, (4 + s6)/10, 1.0_wp]
    real(wp), parameter :: a(3, 3) = reshape([ &
        (88 - 7*s6)/360, (296 - 169*s6)/1800, (-2 + 3*s6)/225, &
        (296 + 169*s6)/1800, (88 + 7*s6)/360, (-2 - 3*s6)/225, &
        (16 - s6)/36, (16 + s6)/36, 1.0_wp/9], [3, 3])
    !> Cubic roots of 81 and 9; the real eigenvalue of A and one of the complex pair.
    real(wp), parameter :: root81 = 81.0_wp**(1.0_wp/3), root9 = 9.0_wp**(1.0_wp/3)
    real(wp), parameter :: diagonal = (6 + root81 - root9)/30
    complex(wp), parameter :: pair = cmplx((12 - root81 + root9)/60, -(root81 + root9)*sqrt(3.0_wp)/60, wp)
    !> T^-1 A T is block diagonal: T by columns, T^-1 by columns (Hairer, Wanner: program RADAU5).
    real(wp), parameter :: t_matrix(3, 3) = reshape([ &
        9.1232394870892942792e-02_wp, 0.24171793270710701896_wp, 0.96604818261509293619_wp, &
        -0.14125529502095420843_wp, 0.20412935229379993199_wp, 1.0_wp, &
        -3.0029194105147424492e-02_wp, 0.38294211275726193779_wp, 0.0_wp], [3, 3])
    real(wp), parameter :: t_inverse(3, 3) = reshape([ &
        4.3255798900631553510_wp, -4.1787185915519047273_wp, -0.50287263494578687595_wp, &
        0.33919925181580986954_wp, -0.32768282076106238708_wp, 2.5719269498556054292_wp, &
        0.54177053993587487119_wp, 0.47662355450055045196_wp, -0.59603920482822492497_wp], [3, 3])
    !> The embedded formula of order 3 over the diagonal, with the increments of the stages (IV.8.18).
    real(wp), parameter :: e(3) = [-(13 + 7*s6)/3, (-13 + 7*s6)/3, -1.0_wp/3]

    !> A = L U, U with a unit diagonal; l(:, i) is the row of stage i.
    real(wp), parameter :: u12 = a(2, 1)/a(1, 1), u13 = a(3, 1)/a(1, 1), l22 = a(2, 2) - a(1, 2)*u12, &
        l32 = a(2, 3) - a(1, 3)*u12, u23 = (a(3, 2) - a(1, 2)*u13)/l22
    real(wp), parameter :: l(3, 3) = reshape([a(1, 1), 0.0_wp, 0.0_wp, a(1, 2), l22, 0.0_wp, &
        a(1, 3), l32, a(3, 3) - a(1, 3)*u13 - l32*u23], [3, 3])

    !> Corrections of an iteration that starts from less than the past.
    integer, parameter :: many = 60

    !> The method of order 5.
    type, extends(stepper_type) :: radau5_type
        private
        type(newton_type) :: newton
        type(history_type) :: history
        !> Rates of the stages and where they lie (n, 3), residuals and corrections (3 n, 3), those transformed.
        real(wp), allocatable :: rate_q(:, :), rate_qd(:, :), q(:, :), qd(:, :), residual(:, :), transformed(:, :)
        !> Increments and rates at the start of the step, errors (n).
        real(wp), allocatable :: start_dq(:), start_dqd(:), start_q(:), start_qd(:), error_q(:), error_qd(:), dq(:), dqd(:)
        real(wp) :: t_start = 0.0_wp, tolerance = 0.0_wp, standstill = 0.0_wp
        !> theta/(1 - theta) of the last step's Newton iteration.
        real(wp) :: remainder = 1.0_wp
        !> Whether the step before was not rejected, so that its error says what the next one's will be.
        logical :: is_settled = .false.
        !> Steps beyond this have stages that are hard to solve for; whether those of the last one were.
        real(wp) :: easy = huge(1.0_wp)
        logical :: was_hard = .false.
    contains
        procedure, nopass :: properties
        procedure :: initialize
        procedure :: advance
        procedure :: estimate
        procedure :: interpolate
        procedure :: longest_next
        procedure :: pack_state
    end type radau5_type

contains

    !> What the method is.
    pure function properties() result(properties_)
        type(properties_type) :: properties_

        properties_ = properties_type('radau5', 5, 3, .true., 3, 'L-stable, stiffly accurate', &
            'Hairer, Wanner II, sections IV.5, IV.8', dense_order=3, damps=.true., is_predictive=.true.)
    end function properties

    !> Allocate the work space.
    subroutine initialize(self, scale, newton_tolerance)
        class(radau5_type), intent(inout) :: self
        real(wp), intent(in) :: scale(:)
        real(wp), intent(in) :: newton_tolerance
        integer :: n

        n = size(scale)
        self%tolerance = newton_tolerance
        self%standstill = 1.0e3_wp*newton_tolerance
        self%remainder = 1.0_wp
        self%is_settled = .false.
        self%easy = huge(1.0_wp)
        self%was_hard = .false.
        call self%newton%allocate(scale, newton_tolerance, [1.0_wp])
        call self%history%allocate(n)
        if (allocated(self%rate_q)) deallocate (self%rate_q, self%rate_qd, self%q, self%qd, self%residual, self%transformed, &
            self%start_dq, self%start_dqd, self%start_q, self%start_qd, self%error_q, self%error_qd, self%dq, self%dqd)
        allocate (self%rate_q(n, 3), self%rate_qd(n, 3), self%q(n, 3), self%qd(n, 3), self%residual(3*n, 3), &
            self%transformed(3*n, 3), self%start_dq(n), self%start_dqd(n), self%start_q(n), self%start_qd(n), self%error_q(n), &
            self%error_qd(n), self%dq(n), self%dqd(n), source=0.0_wp)
    end subroutine initialize

    !> One step: from the extrapolated past; if that fails with an old matrix, with a new one; if that fails, from the end of a
    !> shorter step; if that fails too, with matrices made where the iteration stood, and at last stage by stage.
    subroutine advance(self, chart, state, h, next, stat)
        class(radau5_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        type(state_type), intent(in) :: state
        real(wp), intent(in) :: h
        type(state_type), intent(inout) :: next
        integer, intent(out) :: stat
        !> Corrections before another start value or matrix is tried, and of the last try, where they cost less than a failure.
        integer, parameter :: few = 12
        !> Matrices made in the middle of the step before it is given up.
        integer, parameter :: most_matrices = 2
        logical :: continues, is_new
        integer :: failure, i, k

        self%t_start = state%t
        self%start_dq = state%dq
        self%start_dqd = state%dqd
        self%start_q = state%qd
        self%start_qd = state%qdd
        call chart%expect_pairs([pair/diagonal])
        call self%history%continue_from(state, continues)
        if (.not. continues) self%is_settled = .false.
        call self%newton%prepare(chart, self%history, state, h, diagonal*h, continues, stat)
        if (stat /= status_ok) return
        call predict(self, h)
        call iterate(self, chart, h, next%t, few, stat)
        do while (stat /= status_ok)
            call self%newton%renew_in_step(chart, self%history, state, h, diagonal*h, is_new, failure)
            if (.not. is_new) exit
            stat = failure
            if (stat /= status_ok) exit
            call predict(self, h)
            call iterate(self, chart, h, next%t, few, stat)
        end do
        if (chart%follows_stiffness) call judge_stages(self, h, stat /= status_ok)
        if (stat /= status_ok) call continue_from_short(self, chart, state, h, next%t, stat)
        do k = 1, most_matrices
            if (stat /= status_newton_failed) exit
            ! Where the iteration stood, in the middle of the step, the motion may be nearer to what the stages need.
            call self%newton%renew(chart, state%t + c(2)*h, self%q(:, 2), self%qd(:, 2), self%rate_qd(:, 2), diagonal*h, stat)
            self%newton%is_worn = .true.
            if (stat /= status_ok) exit
            call hold(self, state%qd, state%qdd)
            call iterate(self, chart, h, next%t, many, stat)
        end do
        if (stat == status_newton_failed) then
            call hold(self, state%qd, state%qdd)
            call solve_in_turn(self, chart, h, next%t, stat)
        end if
        if (stat == status_ok) then
            self%newton%base_dq = state%dq + h*(a(1, 3)*self%rate_q(:, 1) + a(2, 3)*self%rate_q(:, 2))
            self%newton%base_dqd = state%dqd + h*(a(1, 3)*self%rate_qd(:, 1) + a(2, 3)*self%rate_qd(:, 2))
            self%newton%rate_q = self%rate_q(:, 3)
            self%newton%rate_qd = self%rate_qd(:, 3)
            call self%newton%finish(chart, h*a(3, 3), next, stat)
        end if
        if (stat /= status_ok) then
            call self%history%clear()
            self%is_settled = .false.
            return
        end if
        do i = 1, 2
            call self%history%push(state%t + c(i)*h, self%rate_q(:, i), self%rate_qd(:, i))
        end do
        call self%history%push(next%t, next%qd, next%qdd)
    end subroutine advance

    !> How long a step may be after one whose stages were hard to solve for: half as long, and a tenth longer each time after that.
    !> Where the half was no easier, as near a loss of rank, the length is not to blame. Where complements do not follow what
    !> is stiff, stages become hard with the stiffness, and such steps would grow in number with it.
    pure subroutine judge_stages(self, h, is_hard)
        class(radau5_type), intent(inout) :: self
        real(wp), intent(in) :: h
        logical, intent(in) :: is_hard

        if (.not. is_hard) then
            self%easy = 1.1_wp*min(self%easy, huge(1.0_wp)/2)
        else if (self%was_hard) then
            self%easy = huge(1.0_wp)
        else
            self%easy = 0.5_wp*h
        end if
        self%was_hard = is_hard
    end subroutine judge_stages

    !> Start values of the stages from the end of shorter steps, each four times as long as the one before: a transient that rates
    !> at the start of the step would carry far away is over there. The last of them is the step itself.
    subroutine continue_from_short(self, chart, state, h, t_end, stat)
        class(radau5_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        type(state_type), intent(in) :: state
        real(wp), intent(in) :: h, t_end
        integer, intent(out) :: stat
        integer, parameter :: most_quarters = 3
        real(wp) :: part, t
        logical :: can
        integer :: k

        stat = status_newton_failed
        do k = most_quarters, 0, -1
            if (stat == status_ok) then
                call hold(self, self%rate_q(:, 3), self%rate_qd(:, 3))
            else
                call hold(self, state%qd, state%qdd)
            end if
            part = h*0.25_wp**k
            t = state%t + part
            if (k == 0) t = t_end
            call chart%reuse_stage(diagonal*part, can)
            stat = status_ok
            if (.not. can) call self%newton%renew(chart, state%t, state%q, state%qd, state%qdd, diagonal*part, stat)
            if (stat == status_ok) call iterate(self, chart, part, t, many, stat)
        end do
    end subroutine continue_from_short

    !> The same start value for all stages.
    subroutine hold(self, rate_q, rate_qd)
        class(radau5_type), intent(inout) :: self
        real(wp), intent(in) :: rate_q(size(self%dq)), rate_qd(size(self%dq))
        integer :: i

        do i = 3, 1, -1
            self%rate_q(:, i) = rate_q
            self%rate_qd(:, i) = rate_qd
        end do
    end subroutine hold

    !> Start values of the stages from the past.
    subroutine predict(self, h)
        class(radau5_type), intent(inout) :: self
        real(wp), intent(in) :: h
        integer :: i

        do i = 1, 3
            call self%history%extrapolate(self%t_start + c(i)*h, self%rate_q(:, i), self%rate_qd(:, i))
        end do
    end subroutine predict

    !> Newton's iteration for all stages.
    subroutine iterate(self, chart, h, t_end, most_corrections, stat)
        class(radau5_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        !> The step and where it ends.
        real(wp), intent(in) :: h, t_end
        integer, intent(in) :: most_corrections
        integer, intent(out) :: stat
        !> A contraction of corrections that are rounding.
        real(wp), parameter :: creeping = 0.7_wp
        !> By how much the second correction may exceed the first.
        real(wp), parameter :: coupling = 10.0_wp
        real(wp) :: change, last_change, stage_change, t, theta
        integer :: i, j, k, m

        m = chart%n_residual
        last_change = 1.0_wp
        chart%counts%implicit_stages = chart%counts%implicit_stages + 3
        do k = 1, most_corrections
            do i = 1, 3
                self%dq = self%start_dq + h*(a(1, i)*self%rate_q(:, 1) + a(2, i)*self%rate_q(:, 2) + a(3, i)*self%rate_q(:, 3))
                self%dqd = self%start_dqd + h*(a(1, i)*self%rate_qd(:, 1) + a(2, i)*self%rate_qd(:, 2) + a(3, i)*self%rate_qd(:, 3))
                t = self%t_start + c(i)*h
                if (i == 3) t = t_end
                call chart%restore_position(t, self%dq, self%q(:, i), stat)
                if (stat == status_ok) call chart%restore_velocity(t, self%q(:, i), self%dqd, self%qd(:, i), stat)
                if (stat /= status_ok) return
                ! What a stage's rates have that the chart ignores is changed below all stages only.
                self%residual(:m, i) = 0.0_wp
                call chart%find_residual(i, t, self%q(:, i), self%qd(:, i), self%rate_q(:, i), self%rate_qd(:, i), &
                    self%residual(:m, i), stat)
                if (stat /= status_ok) return
            end do
            do j = 1, 3
                self%transformed(:m, j) = t_inverse(j, 1)*self%residual(:m, 1) + t_inverse(j, 2)*self%residual(:m, 2) + &
                    t_inverse(j, 3)*self%residual(:m, 3)
            end do
            call chart%solve_real(self%transformed(:m, 1))
            call chart%solve_pair(1, self%transformed(:m, 2), self%transformed(:m, 3))
            change = 0.0_wp
            do i = 1, 3
                self%residual(:m, i) = t_matrix(i, 1)*self%transformed(:m, 1) + t_matrix(i, 2)*self%transformed(:m, 2) + &
                    t_matrix(i, 3)*self%transformed(:m, 3)
                call chart%move_rates(i, self%q(:, i), self%qd(:, i), diagonal*h, self%residual(:m, i), self%rate_q(:, i), &
                    self%rate_qd(:, i), stage_change, stat)
                if (stat /= status_ok) return
                change = max(change, stage_change)
            end do
            if (k == 1) then
                self%remainder = max(self%remainder, epsilon(1.0_wp))**0.8_wp
            else
                theta = change/last_change
                if (change <= self%standstill .and. .not. theta < merge(0.95_wp, creeping, k == 2)) return
                ! What the first correction leaves of a coupling between stages shows in the second, and is gone with the third.
                if (k > 2 .or. .not. theta < coupling) then
                    if (.not. theta < 0.95_wp) exit
                    ! What the corrections that are left cannot reach is not tried.
                    if (theta**(most_corrections - k)*change > (1.0_wp - theta)*self%standstill) exit
                end if
                self%remainder = 1.0_wp
                if (theta < 0.95_wp) self%remainder = theta/(1.0_wp - theta)
            end if
            if (self%remainder*change <= self%tolerance) return
            last_change = max(change, tiny(1.0_wp))
        end do
        self%remainder = 1.0_wp
        stat = status_newton_failed
    end subroutine iterate

    !> The stages one after the other, each with a matrix of its own, over and over: what is stiff at the end of the step and soft
    !> at its start has no matrix that serves all stages. With L in the place of A for the new rates and A - L for the old ones,
    !> each sweep leaves 0.67 of an error or less, whatever each stage's Jacobian on the test equation in the left half-plane, 0.51
    !> where stiffness grows along the step, and 0.35 where it stays. Source: P. J. van der Houwen, J. J. B. de Swart, Triangularly
    !> implicit iteration methods for ODE-IVP solvers, SIAM J. Sci. Comput. 18, 1997; the factors computed here.
    subroutine solve_in_turn(self, chart, h, t_end, stat)
        class(radau5_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        !> The step and where it ends.
        real(wp), intent(in) :: h, t_end
        integer, intent(out) :: stat
        !> Sweeps before the step is given up.
        integer, parameter :: most_sweeps = 80
        real(wp) :: change, last_change, stage_change, theta
        integer :: i, k, n

        n = size(self%dq)
        last_change = huge(1.0_wp)
        chart%counts%implicit_stages = chart%counts%implicit_stages + 3
        do k = 1, most_sweeps
            self%residual(:n, :) = self%rate_q
            self%residual(n + 1:2*n, :) = self%rate_qd
            change = 0.0_wp
            do i = 1, 3
                call solve_alone(self, chart, i, h, t_end, stage_change, stat)
                if (stat /= status_ok) return
                change = max(change, stage_change)
            end do
            theta = change/last_change
            last_change = max(change, tiny(1.0_wp))
            if (k == 1) cycle
            if (change <= self%standstill .and. .not. theta < 0.95_wp) exit
            if (theta < 0.95_wp .and. theta*change <= (1.0_wp - theta)*self%tolerance) exit
        end do
        if (k > most_sweeps) then
            stat = status_newton_failed
            return
        end if
        ! The matrix of the method, for the error and what a next step may take over.
        call self%newton%renew(chart, t_end, self%q(:, 3), self%qd(:, 3), self%rate_qd(:, 3), diagonal*h, stat)
        self%newton%is_worn = .true.
        self%remainder = 1.0_wp
    end subroutine solve_in_turn

    !> One of the stages, with the new rates of those before it.
    subroutine solve_alone(self, chart, i, h, t_end, first_change, stat)
        class(radau5_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        !> The stage.
        integer, intent(in) :: i
        real(wp), intent(in) :: h, t_end
        !> The first correction, which shows what the rates of others have changed.
        real(wp), intent(out) :: first_change
        integer, intent(out) :: stat
        !> Corrections, and the part of the first one below which they change no more than a sweep leaves.
        integer, parameter :: most_corrections = 6
        real(wp), parameter :: enough = 0.05_wp
        real(wp) :: change, t
        integer :: j, k, n

        n = size(self%dq)
        first_change = 0.0_wp
        t = self%t_start + c(i)*h
        if (i == 3) t = t_end
        associate (base_q => self%newton%base_dq, base_qd => self%newton%base_dqd, rate_q => self%rate_q(:, i), &
            rate_qd => self%rate_qd(:, i), q => self%q(:, i), qd => self%qd(:, i))
            base_q = self%start_dq
            base_qd = self%start_dqd
            do j = 1, 3
                base_q = base_q + h*(a(j, i) - l(j, i))*self%residual(:n, j)
                base_qd = base_qd + h*(a(j, i) - l(j, i))*self%residual(n + 1:2*n, j)
            end do
            do j = 1, i - 1
                base_q = base_q + h*l(j, i)*self%rate_q(:, j)
                base_qd = base_qd + h*l(j, i)*self%rate_qd(:, j)
            end do
            do k = 1, most_corrections
                self%dq = base_q + (h*l(i, i))*rate_q
                self%dqd = base_qd + (h*l(i, i))*rate_qd
                call chart%restore_position(t, self%dq, q, stat)
                if (stat == status_ok) call chart%restore_velocity(t, q, self%dqd, qd, stat)
                if (stat == status_ok .and. k == 1) call self%newton%renew(chart, t, q, qd, rate_qd, h*l(i, i), stat)
                if (stat /= status_ok) return
                call chart%correct_stage(t, q, qd, h*l(i, i), rate_q, rate_qd, change, stat)
                if (stat /= status_ok) return
                if (k == 1) first_change = change
                if (change <= max(enough*first_change, self%tolerance)) return
            end do
        end associate
    end subroutine solve_alone

    !> The error of the last step (IV.8.19); where it is large and the step the first, or one after a rejection, with the rates at
    !> the state that it leads to (IV.8.20), which do not take a fast transient for an error.
    subroutine estimate(self, chart, h, weight_q, weight_qd, norm)
        class(radau5_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        real(wp), intent(in) :: h
        real(wp), intent(in), contiguous :: weight_q(:), weight_qd(:)
        real(wp), intent(out) :: norm
        integer :: stat

        call embed(self, h)
        call chart%filter_error(self%error_q, self%error_qd)
        norm = weighted_norm(self%error_q, self%error_qd, weight_q, weight_qd)
        if (norm >= 1.0_wp .and. .not. self%is_settled) then
            self%dq = self%start_dq + self%error_q
            self%dqd = self%start_dqd + self%error_qd
            associate (q => self%q(:, 1), qd => self%qd(:, 1))
                call chart%restore_position(self%t_start, self%dq, q, stat)
                if (stat == status_ok) call chart%restore_velocity(self%t_start, q, self%dqd, qd, stat)
                if (stat == status_ok) call chart%solve_dynamics(self%t_start, q, qd, self%dqd, stat)
                if (stat == status_ok) then
                    self%start_q = qd
                    self%start_qd = self%dqd
                    call embed(self, h)
                    call chart%filter_error(self%error_q, self%error_qd)
                    norm = weighted_norm(self%error_q, self%error_qd, weight_q, weight_qd)
                end if
            end associate
        end if
        self%is_settled = norm < 1.0_wp
    end subroutine estimate

    !> The difference to the embedded formula.
    subroutine embed(self, h)
        class(radau5_type), intent(inout) :: self
        real(wp), intent(in) :: h
        real(wp) :: weight
        integer :: j

        self%error_q = (diagonal*h)*self%start_q
        self%error_qd = (diagonal*h)*self%start_qd
        do j = 1, 3
            weight = diagonal*h*(e(1)*a(j, 1) + e(2)*a(j, 2) + e(3)*a(j, 3))
            self%error_q = self%error_q + weight*self%rate_q(:, j)
            self%error_qd = self%error_qd + weight*self%rate_qd(:, j)
        end do
    end subroutine embed

    !> The collocation polynomial: increments of order 3 between the ends, whatever is stiff.
    subroutine interpolate(self, chart, start, arrived, t, dq, dqd, slope_q, slope_qd, stat)
        class(radau5_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        type(state_type), intent(in) :: start, arrived
        real(wp), intent(in) :: t
        real(wp), intent(out), contiguous :: dq(:), dqd(:), slope_q(:), slope_qd(:)
        integer, intent(out) :: stat
        real(wp) :: h, integral, slope, x
        integer :: j

        stat = 0
        h = arrived%t - start%t
        x = (t - start%t)/h
        dq = start%dq
        dqd = start%dqd
        slope_q = 0.0_wp
        slope_qd = 0.0_wp
        do j = 1, 3
            associate (u => c(modulo(j, 3) + 1), v => c(modulo(j + 1, 3) + 1))
                slope = (x - u)*(x - v)/((c(j) - u)*(c(j) - v))
                integral = h*x*(u*v + x*(x/3 - (u + v)/2))/((c(j) - u)*(c(j) - v))
            end associate
            dq = dq + integral*self%rate_q(:, j)
            dqd = dqd + integral*self%rate_qd(:, j)
            slope_q = slope_q + slope*self%rate_q(:, j)
            slope_qd = slope_qd + slope*self%rate_qd(:, j)
        end do
    end subroutine interpolate

    !> Stages of long steps that take many corrections cost more than those of several shorter steps.
    pure real(wp) function longest_next(self)
        class(radau5_type), intent(in) :: self

        longest_next = self%easy
    end function longest_next

    !> What the next steps start from, and the dense output of the last.
    subroutine pack_state(self, pack)
        class(radau5_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call self%newton%pack_state(pack)
        call self%history%pack_state(pack)
        call pack%item(self%rate_q)
        call pack%item(self%rate_qd)
        call pack%item(self%remainder)
        call pack%item(self%is_settled)
        call pack%item(self%easy)
        call pack%item(self%was_hard)
    end subroutine pack_state
end module tandem_stepper_radau5
