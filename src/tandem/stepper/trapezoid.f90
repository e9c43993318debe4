! SPDX-License-Identifier: MIT
!> The trapezoidal rule (78): order 2, A-stable, not L-stable. Stiff modes are not damped: each step multiplies them by a factor
!> near -1.
!> Source: Hairer, Wanner, Solving Ordinary Differential Equations II, section IV.3; K. Atkinson 1989 in the paper.
module tandem_stepper_trapezoid
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

    public :: trapezoid_type

    !> The trapezoidal rule.
    type, extends(implicit_type) :: trapezoid_type
        private
        type(newton_type) :: newton
        type(history_type) :: history
        !> Errors (n).
        real(wp), allocatable :: error_q(:), error_qd(:)
    contains
        procedure, nopass :: properties
        procedure :: initialize, advance_stages, estimate_stages, pack_state
    end type trapezoid_type

contains

    !> Properties of the method.
    pure function properties() result(properties_)
        type(properties_type) :: properties_

        properties_ = properties_type('trapezoid', 2, 2, .true., 2, 'A-stable, R(infinity) = -1', &
            'Hairer, Wanner II, section IV.3')
    end function properties

    !> Allocate the work space.
    subroutine initialize(self, scale, newton_tolerance)
        class(trapezoid_type), intent(inout) :: self
        real(wp), intent(in) :: scale(:), newton_tolerance
        integer :: n

        n = size(scale)
        call self%newton%allocate(scale, self%time_scale, newton_tolerance, [1.0_wp], [0.0_wp])
        call self%history%allocate(n)
        self%error_q = spread(0.0_wp, 1, n)
        self%error_qd = self%error_q
    end subroutine initialize

    !> Perform one step: the rates at both ends have weight 1/2.
    subroutine advance_stages(self, chart, state, h, next, stat)
        class(trapezoid_type), intent(inout) :: self
        class(implicit_chart_type), intent(inout) :: chart
        type(state_type), intent(in) :: state
        real(wp), intent(in) :: h
        type(state_type), intent(inout) :: next
        integer, intent(out) :: stat
        real(wp) :: ha
        logical :: continues

        ha = 0.5_wp*h
        call self%history%continue_from(state, continues)
        call self%newton%prepare(chart, self%history, state, h, ha, continues, stat)
        if (stat /= status_ok) return
        self%newton%base(:, 1) = state%dq + ha*state%qd
        self%newton%base(:, 2) = state%dqd + ha*state%qdd
        call self%newton%solve(chart, self%history, state, 1, next%t, h, ha, stat)
        if (stat == status_ok) call self%newton%finish(chart, ha, next, stat)
        if (stat == status_ok) then
            call self%history%push(next%t, next%q, next%qd, next%qdd)
        else
            call self%history%clear()
        end if
    end subroutine advance_stages

    !> Error of the last step, -h^3 y'''/12, filtered by the Newton matrix. y''' follows from the rates at both ends and at the
    !> start of the previous step. In a first step it follows from the rates at both ends only, as if the order were 1.
    subroutine estimate_stages(self, chart, h, weight_q, weight_qd, norm)
        class(trapezoid_type), intent(inout) :: self
        class(implicit_chart_type), intent(inout) :: chart
        real(wp), intent(in) :: h
        real(wp), intent(in), contiguous :: weight_q(:), weight_qd(:)
        real(wp), intent(out) :: norm

        call self%history%curvature(self%error_q, self%error_qd)
        self%error_q = (h**3/6.0_wp)*self%error_q
        self%error_qd = (h**3/6.0_wp)*self%error_qd
        call chart%filter(self%error_q, self%error_qd)
        norm = weighted_norm(self%error_q, self%error_qd, weight_q, weight_qd)
    end subroutine estimate_stages

    !> Pack the state for the next steps.
    subroutine pack_state(self, pack)
        class(trapezoid_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call self%newton%pack_state(pack)
        call self%history%pack_state(pack)
    end subroutine pack_state
end module tandem_stepper_trapezoid
