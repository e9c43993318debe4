! SPDX-License-Identifier: MIT
!> SDIRK54 (Table 1): singly diagonally implicit, order 4, 5 stages, L-stable, stiffly accurate. All stages have h a_ii = h/4 and
!> hence the same Newton matrix, which is reused for as many steps as possible.
!> Source: Hairer, Wanner, Solving Ordinary Differential Equations II, 2nd ed., p. 100, table 6.5.
module tandem_stepper_sdirk54
    use tandem_kinds, only: wp
    use tandem_pack, only: pack_type
    use tandem_stepper, only: properties_type, weighted_norm
    use tandem_stepper_implicit, only: implicit_type
    use tandem_stepper_history, only: history_type
    use tandem_stepper_newton, only: newton_type
    use tandem_stepper_state, only: state_type
    use tandem_status, only: status_ok
    use tandem_chart_implicit, only: implicit_chart_type
    implicit none (type, external)
    private

    public :: sdirk54_type

    !> Nodes and coefficients below the diagonal; the last row is b, and b_5 = a_55 = 1/4.
    real(wp), parameter :: c(5) = [1.0_wp/4, 3.0_wp/4, 11.0_wp/20, 1.0_wp/2, 1.0_wp]
    real(wp), parameter :: diagonal = 0.25_wp
    real(wp), parameter :: a(4, 5) = reshape([ &
        0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, &
        1.0_wp/2, 0.0_wp, 0.0_wp, 0.0_wp, &
        17.0_wp/50, -1.0_wp/25, 0.0_wp, 0.0_wp, &
        371.0_wp/1360, -137.0_wp/2720, 15.0_wp/544, 0.0_wp, &
        25.0_wp/24, -49.0_wp/48, 125.0_wp/16, -85.0_wp/12], [4, 5])
    !> c^2/2 - sum a c of each stage, over a_ii^2.
    real(wp), parameter :: defect(5) = (c*(0.5_wp*c - diagonal) - matmul(c(:4), a))/diagonal**2

    !> b minus the embedded weights of order 3, (59/48, -17/96, 225/32, -85/12, 0).
    real(wp), parameter :: e(5) = [-3.0_wp/16, -27.0_wp/32, 25.0_wp/32, 0.0_wp, 1.0_wp/4]

    !> Weights that give the rates at the start of the step from those of the stages 1, 3 and 5. They are exact for quadratic rates,
    !> and sum w defect = 0, so that the second-order errors of the stages cancel. Interpolating three stages would retain these
    !> errors, which exceed the embedded error in short steps.
    real(wp), parameter :: start_weights(5) = [22.0_wp/9, 0.0_wp, -50.0_wp/27, 0.0_wp, 11.0_wp/27]
    !> A kink before the first stage causes an error of up to a quarter of the step times the size of the kink, and half of this on
    !> average. This error is used if it exceeds the embedded error by the second factor.
    real(wp), parameter :: kink_factor = 0.125_wp, kink_dominance = 10.0_wp

    !> The L-stable method of order 4.
    type, extends(implicit_type) :: sdirk54_type
        private
        type(newton_type) :: newton
        type(history_type) :: history
        !> Rates of the stages (n, 5), rates at the start of the step, and errors (n).
        real(wp), allocatable :: rate_q(:, :), rate_qd(:, :), start_q(:), start_qd(:), error_q(:), error_qd(:)
    contains
        procedure, nopass :: properties
        procedure :: initialize, advance_stages, estimate_stages, learn_error, pack_state
    end type sdirk54_type

contains

    !> Properties of the method.
    pure function properties() result(properties_)
        type(properties_type) :: properties_

        properties_ = properties_type('sdirk54', 4, 5, .true., 3, 'L-stable, stiffly accurate', &
            'Hairer, Wanner II, p. 100, table 6.5', damps=.true.)
    end function properties

    !> Allocate the work space.
    subroutine initialize(self, scale, newton_tolerance)
        class(sdirk54_type), intent(inout) :: self
        real(wp), intent(in) :: scale(:), newton_tolerance
        integer :: n

        n = size(scale)
        call self%newton%allocate(scale, self%time_scale, newton_tolerance, abs([a(:, 5), diagonal])/diagonal, defect)
        call self%history%allocate(n)
        if (allocated(self%rate_q)) deallocate (self%rate_q, self%rate_qd, self%start_q, self%start_qd, self%error_q, self%error_qd)
        allocate (self%rate_q(n, 5), self%rate_qd(n, 5), self%start_q(n), self%start_qd(n), self%error_q(n), self%error_qd(n), &
            source=0.0_wp)
    end subroutine initialize

    !> Perform one step.
    subroutine advance_stages(self, chart, state, h, next, stat)
        class(sdirk54_type), intent(inout) :: self
        class(implicit_chart_type), intent(inout) :: chart
        type(state_type), intent(in) :: state
        real(wp), intent(in) :: h
        type(state_type), intent(inout) :: next
        integer, intent(out) :: stat
        real(wp) :: ha, t
        integer :: i, j
        logical :: continues

        ha = diagonal*h
        self%start_q = state%qd
        self%start_qd = state%qdd
        call self%history%continue_from(state, continues)
        call self%newton%prepare(chart, self%history, state, h, ha, continues, stat)
        if (stat /= status_ok) return
        associate (newton => self%newton)
            do i = 1, 5
                t = state%t + c(i)*h
                if (i == 5) t = next%t
                newton%base(:, 1) = state%dq
                newton%base(:, 2) = state%dqd
                do j = 1, i - 1
                    newton%base(:, 1) = newton%base(:, 1) + (h*a(j, i))*self%rate_q(:, j)
                    newton%base(:, 2) = newton%base(:, 2) + (h*a(j, i))*self%rate_qd(:, j)
                end do
                call newton%solve(chart, self%history, state, i, t, h, ha, stat)
                if (stat /= status_ok) exit
                self%rate_q(:, i) = newton%rate(:, 1)
                self%rate_qd(:, i) = newton%rate(:, 2)
                if (i < 5) call self%history%push(t, newton%q, newton%rate(:, 1), newton%rate(:, 2))
            end do
            if (stat == status_ok) call newton%finish(chart, ha, next, stat)
        end associate
        if (stat == status_ok) then
            call self%history%push(next%t, next%q, next%qd, next%qdd)
        else
            call self%history%clear()
        end if
    end subroutine advance_stages

    !> Error of the last step. The embedded method itself is not stable for stiff modes, R(infinity) = 10/3, so its difference is
    !> filtered by the Newton matrix (Hairer, Wanner II, (IV.8.19)). No stage lies in the first quarter of the step. A kink there
    !> shows only in the rates at the start, which then differ from those that the stages imply.
    subroutine estimate_stages(self, chart, h, weight_q, weight_qd, norm)
        class(sdirk54_type), intent(inout) :: self
        class(implicit_chart_type), intent(inout) :: chart
        real(wp), intent(in) :: h
        real(wp), intent(in), contiguous :: weight_q(:), weight_qd(:)
        real(wp), intent(out) :: norm
        real(wp) :: kink
        integer :: i

        self%error_q = kink_factor*h*self%start_q
        self%error_qd = kink_factor*h*self%start_qd
        do i = 1, 5
            self%error_q = self%error_q - (kink_factor*h*start_weights(i))*self%rate_q(:, i)
            self%error_qd = self%error_qd - (kink_factor*h*start_weights(i))*self%rate_qd(:, i)
        end do
        call chart%filter(self%error_q, self%error_qd)
        kink = weighted_norm(self%error_q, self%error_qd, weight_q, weight_qd)
        self%error_q = 0.0_wp
        self%error_qd = 0.0_wp
        do i = 1, 5
            self%error_q = self%error_q + (h*e(i))*self%rate_q(:, i)
            self%error_qd = self%error_qd + (h*e(i))*self%rate_qd(:, i)
        end do
        call chart%filter(self%error_q, self%error_qd)
        norm = weighted_norm(self%error_q, self%error_qd, weight_q, weight_qd)
        if (kink > kink_dominance*norm) norm = kink
    end subroutine estimate_stages

    !> Set the relative error of recent steps.
    subroutine learn_error(self, relative)
        class(sdirk54_type), intent(inout) :: self
        real(wp), intent(in) :: relative

        self%newton%error_of_steps = relative
    end subroutine learn_error

    !> Pack the state for the next steps.
    subroutine pack_state(self, pack)
        class(sdirk54_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call self%newton%pack_state(pack)
        call self%history%pack_state(pack)
    end subroutine pack_state
end module tandem_stepper_sdirk54
