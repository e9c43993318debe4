! SPDX-License-Identifier: MIT
!> The trapezoidal rule (78): order 2, A-stable, not L-stable: a stiff mode keeps ringing with a factor near -1 a step.
!> Source: Hairer, Wanner, Solving Ordinary Differential Equations II, section IV.3; K. Atkinson 1989 in the paper.
module tandem_stepper_trapezoid
    use tandem_kinds, only: wp
    use tandem_stepper, only: properties_type, stepper_type
    use tandem_stepper_history, only: history_type
    use tandem_stepper_newton, only: newton_type
    use tandem_stepper_state, only: state_type
    use tandem_status, only: status_ok
    use tandem_tangent_chart, only: chart_type
    implicit none (type, external)
    private

    public :: trapezoid_type

    type, extends(stepper_type) :: trapezoid_type
        private
        type(newton_type) :: newton
        type(history_type) :: history
    contains
        procedure, nopass :: properties
        procedure :: initialize
        procedure :: advance
    end type trapezoid_type

contains

    !> What the method is.
    pure function properties() result(properties_)
        type(properties_type) :: properties_

        properties_ = properties_type('trapezoid', 2, 2, .true., 'A-stable, R(infinity) = -1', &
            'Hairer, Wanner II, section IV.3')
    end function properties

    !> Allocate the work space.
    subroutine initialize(self, n, newton_tolerance)
        class(trapezoid_type), intent(inout) :: self
        integer, intent(in) :: n
        real(wp), intent(in) :: newton_tolerance

        call self%newton%allocate(n, 1, newton_tolerance)
        call self%history%allocate(n)
    end subroutine initialize

    !> One step: the rates at both ends count half.
    subroutine advance(self, chart, state, h, next, stat)
        class(trapezoid_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        type(state_type), intent(in) :: state
        real(wp), intent(in) :: h
        type(state_type), intent(inout) :: next
        integer, intent(out) :: stat
        real(wp) :: ha

        ha = 0.5_wp*h
        call self%history%continue_from(state)
        call chart%factor_stage(state%t, state%q, state%qd, state%qdd, ha, stat)
        if (stat /= status_ok) return
        self%newton%base_dq = state%dq + ha*state%qd
        self%newton%base_dqd = state%dqd + ha*state%qdd
        call self%newton%solve(chart, self%history, state, 1, next%t, ha, stat)
        if (stat == status_ok) call self%newton%finish(chart, ha, next, stat)
        if (stat == status_ok) then
            call self%history%push(next%t, next%qd, next%qdd)
        else
            call self%history%clear()
        end if
    end subroutine advance
end module tandem_stepper_trapezoid
