! SPDX-License-Identifier: MIT
!> The classical Runge-Kutta method: order 4, 4 stages, explicit.
!>
!> Stages are increments in ambient coordinates, xi' = qd and eta' = qdd, and the chart restores the constraints at each.
!> Runge-Kutta methods are linear in their stages, so this is the trajectory of (51) in the chart's v and w.
!> The acceleration at the end of a step is the first stage of the next one.
!> Source: W. Kutta, 1901; Hairer, Norsett, Wanner, Solving Ordinary Differential Equations I, table II.1.2.
module tandem_stepper_rk4
    use tandem_tangent_chart, only: chart_type
    use tandem_kinds, only: wp
    use tandem_stepper, only: properties_type, stepper_type
    use tandem_stepper_state, only: state_type
    implicit none (type, external)
    private

    public :: rk4_type

    type, extends(stepper_type) :: rk4_type
        private
        !> Coordinates, velocities and accelerations of a stage (n); weighted sums of the stages (n).
        real(wp), allocatable :: q(:), qd(:), qdd(:), sum_qd(:), sum_qdd(:)
        !> Increments of a stage (n).
        real(wp), allocatable :: dq(:), dqd(:)
    contains
        procedure, nopass :: properties
        procedure :: initialize
        procedure :: advance
    end type rk4_type

contains

    !> What the method is.
    pure function properties() result(properties_)
        type(properties_type) :: properties_

        properties_ = properties_type('rk4', 4, 4, .false., 'conditional (|h lambda| < 2.8)', &
            'W. Kutta 1901; Hairer, Norsett, Wanner I, table II.1.2')
    end function properties

    !> Allocate the stages.
    subroutine initialize(self, n, newton_tolerance)
        class(rk4_type), intent(inout) :: self
        integer, intent(in) :: n
        real(wp), intent(in) :: newton_tolerance

        self%q = spread(0.0_wp, 1, n)
        self%qd = self%q
        self%qdd = self%q
        self%dq = self%q
        self%dqd = self%q
        self%sum_qd = self%q
        self%sum_qdd = self%q
    end subroutine initialize

    !> One step.
    subroutine advance(self, chart, state, h, next, stat)
        class(rk4_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        type(state_type), intent(in) :: state
        real(wp), intent(in) :: h
        type(state_type), intent(inout) :: next
        integer, intent(out) :: stat
        !> Nodes c_i and weights b_i.
        real(wp), parameter :: c(2:4) = [0.5_wp, 0.5_wp, 1.0_wp]
        real(wp), parameter :: b(4) = [1.0_wp, 2.0_wp, 2.0_wp, 1.0_wp]/6.0_wp
        real(wp) :: t
        integer :: i

        self%sum_qd = b(1)*state%qd
        self%sum_qdd = b(1)*state%qdd
        self%qd = state%qd
        self%qdd = state%qdd
        do i = 2, 4
            ! The tableau has one entry a row: a(i, i - 1) = c(i).
            t = state%t + c(i)*h
            if (i == 4) t = next%t
            self%dq = state%dq + c(i)*h*self%qd
            self%dqd = state%dqd + c(i)*h*self%qdd
            call chart%restore_position(t, self%dq, self%q, stat)
            if (stat /= 0) return
            call chart%restore_velocity(t, self%q, self%dqd, self%qd, stat)
            if (stat /= 0) return
            call chart%solve_dynamics(t, self%q, self%qd, self%qdd, stat)
            if (stat /= 0) return
            self%sum_qd = self%sum_qd + b(i)*self%qd
            self%sum_qdd = self%sum_qdd + b(i)*self%qdd
        end do
        next%dq = state%dq + h*self%sum_qd
        next%dqd = state%dqd + h*self%sum_qdd
        call chart%restore_position(next%t, next%dq, next%q, stat)
        if (stat /= 0) return
        call chart%restore_velocity(next%t, next%q, next%dqd, next%qd, stat)
        if (stat /= 0) return
        call chart%solve_dynamics(next%t, next%q, next%qd, next%qdd, stat)
    end subroutine advance
end module tandem_stepper_rk4
