! SPDX-License-Identifier: MIT
!> The steered fork of `tandem_models_motorcycle`, and how it moves the front wheel's contact point in the chassis' frame.
module tandem_models_motorcycle_fork
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: fork_type, move_fork, bend_fork

    !> The fork at a time, in the chassis' frame: es, y1, dy1/dtheta, theta-dot, theta-dot-dot.
    type :: fork_type
        real(wp) :: es(3) = 0.0_wp, y1(3) = 0.0_wp, y1_theta(3) = 0.0_wp, rate = 0.0_wp, second_rate = 0.0_wp
    end type fork_type

contains

    !> yd and zd, the velocities of y and z in the chassis' frame, steering included.
    pure subroutine move_fork(f, q, qd, yd, zd)
        type(fork_type), intent(in) :: f
        real(wp), intent(in) :: q(:), qd(:)
        real(wp), intent(out) :: yd(3), zd(3)

        yd = qd(8)*f%y1 + (q(8)*f%rate)*f%y1_theta + (qd(9) - qd(10))*f%es
        zd = qd(8)*f%es - qd(9)*f%y1 - (q(9)*f%rate)*f%y1_theta
    end subroutine move_fork

    !> The accelerations of y and z in the chassis' frame with qdd = 0; y1 differentiated twice by theta is y1 turned back,
    !> as far as it lies across the fork, which it does.
    pure subroutine bend_fork(f, q, qd, ydd, zdd)
        type(fork_type), intent(in) :: f
        real(wp), intent(in) :: q(:), qd(:)
        real(wp), intent(out) :: ydd(3), zdd(3)
        real(wp) :: y1dd(3)

        y1dd = f%second_rate*f%y1_theta - f%rate**2*f%y1
        ydd = (2*qd(8)*f%rate)*f%y1_theta + q(8)*y1dd
        zdd = -(2*qd(9)*f%rate)*f%y1_theta - q(9)*y1dd
    end subroutine bend_fork
end module tandem_models_motorcycle_fork
