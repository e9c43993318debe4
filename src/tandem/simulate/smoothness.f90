! SPDX-License-Identifier: MIT
!> Number of steps that the smoothness of the motion requires, whatever limits the steps of a run. It is the number of steps of a
!> method whose error is proportional to the fourth power of its step size, such as radau5 under error control.
!>
!> A window of the motion ends when the cubic polynomial through the states and rates at its ends deviates from the state at its
!> middle by more than the tolerance. Until then windows are doubled. The deviation determines the number of steps in half the
!> window.
module tandem_simulate_smoothness
    use tandem_kinds, only: wp
    use tandem_pack, only: pack_type
    use tandem_stepper, only: weighted_norm
    use tandem_stepper_state, only: state_type
    implicit none (type, external)
    private

    public :: smoothness_type

    type :: smoothness_type
        !> Number of steps so far.
        real(wp) :: needed = 0.0_wp
        !> Start and middle of the window; number of these states that are set.
        integer, private :: n_known = 0
        type(state_type), private :: first, middle
        !> Deviations (n); number of steps in the half window that ends at the last state, which becomes a middle.
        real(wp), allocatable, private :: error_q(:), error_qd(:)
        real(wp), private :: closed = 0.0_wp
    contains
        procedure :: initialize, pause, observe, look_at_window, restart, pack_state
    end type smoothness_type

    !> Ratio of the error of a step of radau5 to the deviation at the middle, measured with pendulums and motorcycles; power of the
    !> step size to which the error is proportional.
    real(wp), parameter :: factor = 2.0_wp, power = 4.0_wp

contains

    !> Begin a run with n coordinates.
    subroutine initialize(self, n)
        class(smoothness_type), intent(inout) :: self
        integer, intent(in) :: n

        self%needed = 0.0_wp
        self%n_known = 0
        self%closed = 0.0_wp
        call self%first%allocate(n)
        call self%middle%allocate(n)
        self%error_q = self%first%q
        self%error_qd = self%first%q
    end subroutine initialize

    !> Abandon the current window.
    pure subroutine pause(self)
        class(smoothness_type), intent(inout) :: self

        self%n_known = 0
    end subroutine pause

    !> Add the state at the end of a step.
    subroutine observe(self, state, weight_q, weight_qd)
        class(smoothness_type), intent(inout) :: self
        type(state_type), intent(in) :: state
        !> Reciprocals of the tolerated errors of q and qd (n).
        real(wp), intent(in), contiguous :: weight_q(:), weight_qd(:)
        real(wp) :: norm

        if (self%n_known == 2) then
            if (state%t - self%first%t < 2*(self%middle%t - self%first%t)) return
            call get_deviation(self%first, self%middle, state, self%error_q, self%error_qd)
            norm = factor*weighted_norm(self%error_q, self%error_qd, weight_q, weight_qd)
            self%closed = norm**(1.0_wp/power)
            if (.not. norm <= 1.0_wp) then
                self%needed = self%needed + 0.5_wp*self%closed
                ! The remaining half is the beginning of another window.
                self%closed = 0.5_wp*self%closed
                call self%first%copy(self%middle)
            end if
            call self%middle%copy(state)
        else if (self%n_known == 1) then
            call self%middle%copy(state)
            self%n_known = 2
        else
            call self%first%copy(state)
            self%n_known = 1
        end if
    end subroutine observe

    !> Number of steps of the current window after a time. The window may have begun long before, when the motion was smoother.
    subroutine look_at_window(self, state, since, weight_q, weight_qd, steps)
        class(smoothness_type), intent(inout) :: self
        type(state_type), intent(in) :: state
        real(wp), intent(in) :: since
        !> Reciprocals of the tolerated errors of q and qd (n).
        real(wp), intent(in), contiguous :: weight_q(:), weight_qd(:)
        !> Number of steps; 0 if unknown.
        real(wp), intent(out) :: steps
        !> Near an end of the window the polynomial meets the middle state for any motion.
        real(wp), parameter :: least = 0.1_wp
        real(wp) :: x, norm

        steps = 0.0_wp
        if (self%n_known < 2) return
        if (state%t > self%middle%t) then
            call get_deviation(self%first, self%middle, state, self%error_q, self%error_qd)
            x = (self%middle%t - self%first%t)/(state%t - self%first%t)
            norm = factor*weighted_norm(self%error_q, self%error_qd, weight_q, weight_qd)/max(16*(x*(1 - x))**2, least)
            steps = norm**(1.0_wp/power)
        else
            steps = self%closed
        end if
        steps = steps*min(1.0_wp, (state%t - since)/(state%t - self%first%t))
    end subroutine look_at_window

    !> Restart at a kink or jump of the motion, which no window may contain.
    pure subroutine restart(self)
        class(smoothness_type), intent(inout) :: self

        self%n_known = 0
    end subroutine restart

    !> Deviation of the cubic polynomials through the ends of a window from the state at its middle.
    pure subroutine get_deviation(first, middle, last, error_q, error_qd)
        type(state_type), intent(in) :: first, middle, last
        real(wp), intent(inout), contiguous :: error_q(:), error_qd(:)
        real(wp) :: h, x, weight(4)
        integer :: i

        h = last%t - first%t
        x = (middle%t - first%t)/h
        weight = [(1 + 2*x)*(1 - x)**2, x**2*(3 - 2*x), h*x*(1 - x)**2, -h*x**2*(1 - x)]
        do i = 1, size(error_q)
            error_q(i) = weight(1)*first%q(i) + weight(2)*last%q(i) + weight(3)*first%qd(i) + weight(4)*last%qd(i) - middle%q(i)
            error_qd(i) = weight(1)*first%qd(i) + weight(2)*last%qd(i) + weight(3)*first%qdd(i) + weight(4)*last%qdd(i) - &
                middle%qd(i)
        end do
    end subroutine get_deviation

    !> Pack the window and the number of steps.
    subroutine pack_state(self, pack)
        class(smoothness_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%needed)
        call pack%item(self%n_known)
        if (.not. allocated(self%error_q)) return
        call self%first%pack_state(pack)
        call self%middle%pack_state(pack)
        call pack%item(self%closed)
    end subroutine pack_state
end module tandem_simulate_smoothness
