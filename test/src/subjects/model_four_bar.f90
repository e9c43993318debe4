! SPDX-License-Identifier: MIT
!> A planar four-bar of uniform rods: n = 9, nh = 8, nd = 0, one degree of freedom.
!>
!> The crank joins A = (0, 0) to B, the coupler B to C, the rocker D = (ground, 0) to C; q = (x, y, phi) of the centre of each. With
!> the default lengths it is a parallelogram: at phi1 = 0 and pi all rods lie on one line, the rank of Phi_q drops to 7, and the
!> motion could go on as a parallelogram or as an antiparallelogram. A crank-rocker (Grashof: the crank is the shortest, and
!> shortest + longest < the other two) never gets there.
module model_four_bar
    use tandem, only: derivatives_type, label_length, model_type, procedure_model_type, need_acceleration_q, need_acceleration_qd, &
        need_all_derivatives, need_dynamics_q, need_dynamics_qd, need_velocity_q, wp
    implicit none (type, external)
    private

    public :: four_bar_type, crank_rocker

    !> Lengths of crank, coupler and rocker, and the distance AD, of a crank-rocker (m).
    real(wp), parameter :: crank_rocker(4) = [0.5_wp, 1.0_wp, 0.9_wp, 1.1_wp]

    type, extends(procedure_model_type) :: four_bar_type
        !> Mass of each rod (kg); lengths of crank, coupler and rocker and the distance AD (m); gravity along -y (m/s^2).
        real(wp) :: m = 1.0_wp, length(4) = 1.0_wp, g = 9.81_wp
    contains
        procedure :: define
        procedure :: start
    end type four_bar_type

    !> Joint i is sum_k weight(k, i) r_k + arm(k, i) (length_k/2) u(phi_k) = ground point, u = (cos, sin): A, B, C, D.
    real(wp), parameter :: weight(3, 4) = reshape( &
        [1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, -1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, -1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp], [3, 4])
    real(wp), parameter :: arm(3, 4) = reshape( &
        [-1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, 1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, -1.0_wp, 0.0_wp, 0.0_wp, -1.0_wp], [3, 4])

contains

    !> Associate the procedures.
    subroutine define(self)
        class(four_bar_type), intent(inout) :: self

        self%name = 'four-bar'
        self%n = 9
        self%n_holonomic = 8
        self%constant_mass = .true.
        self%coordinate_name = [character(len=label_length) :: 'x1', 'y1', 'phi1', 'x2', 'y2', 'phi2', 'x3', 'y3', 'phi3']
        self%coordinate_unit = [character(len=label_length) :: 'm', 'm', 'rad', 'm', 'm', 'rad', 'm', 'm', 'rad']
        self%holonomic_name = [character(len=label_length) :: 'joint A x', 'joint A y', 'joint B x', 'joint B y', &
            'joint C x', 'joint C y', 'joint D x', 'joint D y']
        self%holonomic => position
        self%holonomic_jacobian => jacobian
        self%constraint_acceleration => acceleration
        self%mass_matrix => mass
        self%applied_force => null()
        self%potential_energy => null()
        if (abs(self%g) > 0.0_wp) then
            self%applied_force => force
            self%potential_energy => potential
        end if
        self%evaluate_derivatives => evaluate_derivatives
        self%provides_derivatives = need_all_derivatives
    end subroutine define

    !> A start at an angle of the crank from AD, with an angular velocity of the crank: a parallelogram (also the flat one) if
    !> opposite sides are equal, else with C on the left of the line from B to D. The linkage must close there.
    pure subroutine start(self, angle, rate, q, qd)
        class(four_bar_type), intent(in) :: self
        !> Angle (rad) and angular velocity (rad/s) of the crank.
        real(wp), intent(in) :: angle, rate
        real(wp), intent(out) :: q(9), qd(9)
        real(wp) :: phi(3), phid(3), b(2), bd(2), c(2), d(2), to_d(2), distance, along, across, u2(2), u3(2)

        d = [self%length(4), 0.0_wp]
        b = self%length(1)*direction(angle)
        bd = self%length(1)*rate*normal(angle)
        if (is_parallelogram(self%length)) then
            phi = [angle, 0.0_wp, angle]
            phid = [rate, 0.0_wp, rate]
        else
            to_d = d - b
            distance = norm2(to_d)
            along = (distance**2 + self%length(2)**2 - self%length(3)**2)/(2*distance)
            across = sqrt(self%length(2)**2 - along**2)
            c = b + (along*to_d + across*[-to_d(2), to_d(1)])/distance
            phi = [angle, atan2(c(2) - b(2), c(1) - b(1)), atan2(c(2) - d(2), c(1) - d(1))]
            ! bd + l2 phid2 n2 = l3 phid3 n3, multiplied by u3 and by u2.
            u2 = direction(phi(2))
            u3 = direction(phi(3))
            phid = [rate, -dot_product(bd, u3)/(self%length(2)*dot_product(normal(phi(2)), u3)), &
                dot_product(bd, u2)/(self%length(3)*dot_product(normal(phi(3)), u2))]
        end if
        q(1:3) = [b/2, phi(1)]
        qd(1:3) = [bd/2, phid(1)]
        q(4:6) = [b + self%length(2)/2*direction(phi(2)), phi(2)]
        qd(4:6) = [bd + self%length(2)/2*phid(2)*normal(phi(2)), phid(2)]
        q(7:9) = [d + self%length(3)/2*direction(phi(3)), phi(3)]
        qd(7:9) = [self%length(3)/2*phid(3)*normal(phi(3)), phid(3)]
    end subroutine start

    !> True if opposite sides are equal.
    pure logical function is_parallelogram(length)
        real(wp), intent(in) :: length(4)

        is_parallelogram = .not. (abs(length(1) - length(3)) > 0.0_wp .or. abs(length(2) - length(4)) > 0.0_wp)
    end function is_parallelogram

    !> (cos, sin).
    pure function direction(phi) result(u)
        real(wp), intent(in) :: phi
        real(wp) :: u(2)

        u = [cos(phi), sin(phi)]
    end function direction

    !> (-sin, cos).
    pure function normal(phi) result(u)
        real(wp), intent(in) :: phi
        real(wp) :: u(2)

        u = [-sin(phi), cos(phi)]
    end function normal

    subroutine position(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat
        integer :: i, k

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (four_bar_type)
            do i = 1, 4
                do k = 1, 3
                    value(2*i - 1:2*i) = value(2*i - 1:2*i) + weight(k, i)*q(3*k - 2:3*k - 1) &
                        + arm(k, i)*self%length(k)/2*direction(q(3*k))
                end do
            end do
            value(7) = value(7) - self%length(4)
        end select
    end subroutine position

    subroutine jacobian(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat
        integer :: i, k

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (four_bar_type)
            do i = 1, 4
                do k = 1, 3
                    value(2*i - 1, 3*k - 2) = weight(k, i)
                    value(2*i, 3*k - 1) = weight(k, i)
                    value(2*i - 1:2*i, 3*k) = arm(k, i)*self%length(k)/2*normal(q(3*k))
                end do
            end do
        end select
    end subroutine jacobian

    subroutine acceleration(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat
        integer :: i, k

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (four_bar_type)
            do i = 1, 4
                do k = 1, 3
                    value(2*i - 1:2*i) = value(2*i - 1:2*i) - arm(k, i)*self%length(k)/2*qd(3*k)**2*direction(q(3*k))
                end do
            end do
        end select
    end subroutine acceleration

    subroutine mass(self, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat
        integer :: k

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (four_bar_type)
            do k = 1, 3
                value(3*k - 2, 3*k - 2) = self%m
                value(3*k - 1, 3*k - 1) = self%m
                value(3*k, 3*k) = self%m*self%length(k)**2/12
            end do
        end select
    end subroutine mass

    subroutine force(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (four_bar_type)
            value(2::3) = -self%m*self%g
        end select
    end subroutine force

    subroutine potential(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (four_bar_type)
            value = self%m*self%g*sum(q(2::3))
        end select
    end subroutine potential

    !> Only the angles enter: M and the forces are constant.
    subroutine evaluate_derivatives(self, need, t, q, qd, qdd, lambda, derivatives, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:), qdd(:), lambda(:)
        type(derivatives_type), intent(inout) :: derivatives
        integer, intent(out) :: stat
        real(wp) :: x(2), y(2)
        integer :: i, k

        stat = 0
        if (iand(need, need_velocity_q) /= 0) derivatives%velocity_q = 0.0_wp
        if (iand(need, need_acceleration_q) /= 0) derivatives%acceleration_q = 0.0_wp
        if (iand(need, need_acceleration_qd) /= 0) derivatives%acceleration_qd = 0.0_wp
        if (iand(need, need_dynamics_q) /= 0) derivatives%dynamics_q = 0.0_wp
        if (iand(need, need_dynamics_qd) /= 0) derivatives%dynamics_qd = 0.0_wp
        select type (self)
        class is (four_bar_type)
            do i = 1, 4
                do k = 1, 3
                    x = arm(k, i)*self%length(k)/2*direction(q(3*k))
                    y = arm(k, i)*self%length(k)/2*normal(q(3*k))
                    associate (d => derivatives, rows => 2*i - 2, phi => 3*k)
                        if (iand(need, need_velocity_q) /= 0) d%velocity_q(rows + 1:rows + 2, phi) = -x*qd(phi)
                        if (iand(need, need_acceleration_q) /= 0) then
                            d%acceleration_q(rows + 1:rows + 2, phi) = -x*qdd(phi) - y*qd(phi)**2
                        end if
                        if (iand(need, need_acceleration_qd) /= 0) d%acceleration_qd(rows + 1:rows + 2, phi) = -2*x*qd(phi)
                        if (iand(need, need_dynamics_q) /= 0) then
                            d%dynamics_q(phi, phi) = d%dynamics_q(phi, phi) - dot_product(x, lambda(rows + 1:rows + 2))
                        end if
                    end associate
                end do
            end do
        end select
    end subroutine evaluate_derivatives
end module model_four_bar
