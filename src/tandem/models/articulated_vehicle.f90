! SPDX-License-Identifier: MIT
!> Planar articulated vehicle of section 7: two chassis connected by a revolute joint, and three wheels that roll without sideways
!> slip. The front wheel is steered by theta(t) = amplitude sin(frequency t) for one period and straight thereafter.
!>
!> q = (x1, y1, phi1, x2, y2, phi2): centre and heading of the front and of the rear chassis. M = diag(m, m, I, m, m, I). There are
!> no applied forces, and the constraints do no work, so that the kinetic energy is constant.
module tandem_models_articulated_vehicle
    use tandem_kinds, only: wp
    use tandem_model, only: label_length, model_type
    use tandem_model_derivatives, only: derivatives_type, need_acceleration_q, need_acceleration_qd, need_all_derivatives, &
        need_dynamics_q, need_dynamics_qd, need_velocity_q
    use tandem_model_terms, only: need_gamma, need_jacobian, need_mass, need_phi, terms_type
    implicit none (type, external)
    private

    public :: articulated_vehicle_type

    !> The vehicle and its parameters. Set the parameters, then call `define`, then `start` for a consistent start.
    type, extends(model_type) :: articulated_vehicle_type
        !> Mass of each chassis (kg) and its polar moment of inertia (kg m^2).
        real(wp) :: mass = 1500.0_wp, inertia = 1500.0_wp
        !> Distance from the centre of a chassis to its axle and to the joint (m).
        real(wp) :: half_length = 3.0_wp
        !> Steering amplitude (rad) and angular frequency (rad/s). With a frequency of 0 the front wheel is straight.
        real(wp) :: amplitude = 0.017_wp, frequency = 1.0_wp
        !> Directions of the chassis and of the front wheel at the last point, which several terms use.
        real(wp), private :: phi1 = huge(1.0_wp), phi2 = huge(1.0_wp), t = huge(1.0_wp)
        integer, private :: segment_of_t = 0
        real(wp), private :: c1 = 1.0_wp, s1 = 0.0_wp, c2 = 1.0_wp, s2 = 0.0_wp
        real(wp), private :: theta_rate = 0.0_wp, c_theta = 1.0_wp, s_theta = 0.0_wp
    contains
        procedure :: define, start
        procedure, private :: update_directions
    end type articulated_vehicle_type

contains

    !> Associate the procedures and set the names. To be called after the parameters are set.
    subroutine define(self)
        class(articulated_vehicle_type), intent(inout) :: self
        real(wp), parameter :: two_pi = 8.0_wp*atan(1.0_wp)

        self%name = 'articulated_vehicle'
        ! Invalidate directions that were computed with other parameters.
        self%phi1 = huge(1.0_wp)
        self%phi2 = huge(1.0_wp)
        self%t = huge(1.0_wp)
        self%n = 6
        self%n_holonomic = 2
        self%n_nonholonomic = 3
        self%constant_mass = .true.
        self%coordinate_name = [character(len=label_length) :: 'x1', 'y1', 'phi1', 'x2', 'y2', 'phi2']
        self%coordinate_unit = [character(len=label_length) :: 'm', 'm', 'rad', 'm', 'm', 'rad']
        self%holonomic_name = [character(len=label_length) :: 'joint x', 'joint y']
        self%nonholonomic_name = [character(len=label_length) :: 'front wheel', 'joint wheel', 'rear wheel']
        self%multiplier_unit = [character(len=label_length) :: 'N', 'N', 'N', 'N', 'N']
        self%breakpoints = [real(wp) ::]
        if (abs(self%frequency) > 0.0_wp) self%breakpoints = [two_pi/abs(self%frequency)]
        self%evaluate => evaluate
        self%provides = need_phi + need_jacobian + need_gamma + need_mass
        self%evaluate_derivatives => evaluate_derivatives
        self%provides_derivatives = need_all_derivatives
    end subroutine define

    !> State with both chassis aligned along x and moving at the same speed (m/s).
    pure subroutine start(self, speed, q, qd)
        class(articulated_vehicle_type), intent(in) :: self
        real(wp), intent(in) :: speed
        real(wp), intent(out) :: q(6), qd(6)

        q = [2*self%half_length, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp]
        qd = [speed, 0.0_wp, 0.0_wp, speed, 0.0_wp, 0.0_wp]
    end subroutine start

    !> Update the stored directions to (t, q).
    pure subroutine update_directions(self, t, q)
        class(articulated_vehicle_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp) :: theta

        if (q(3) > self%phi1 .or. q(3) < self%phi1) then
            self%phi1 = q(3)
            self%c1 = cos(q(3))
            self%s1 = sin(q(3))
        end if
        if (q(6) > self%phi2 .or. q(6) < self%phi2) then
            self%phi2 = q(6)
            self%c2 = cos(q(6))
            self%s2 = sin(q(6))
        end if
        if (.not. (t > self%t .or. t < self%t) .and. self%segment == self%segment_of_t) return
        self%t = t
        self%segment_of_t = self%segment
        theta = 0.0_wp
        self%theta_rate = 0.0_wp
        if (self%segment == 1) then
            theta = self%amplitude*sin(self%frequency*t)
            self%theta_rate = self%amplitude*self%frequency*cos(self%frequency*t)
        end if
        self%c_theta = cos(theta)
        self%s_theta = sin(theta)
    end subroutine update_directions

    !> Evaluate the terms (98)-(102).
    subroutine evaluate(self, need, t, q, qd, terms, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type), intent(inout) :: terms
        integer, intent(out) :: stat
        real(wp) :: cf, sf
        integer :: i

        stat = 0
        select type (self)
        class is (articulated_vehicle_type)
            if (iand(need, need_phi + need_jacobian + need_gamma) /= 0) call self%update_directions(t, q)
            associate (l => self%half_length, c1 => self%c1, s1 => self%s1, c2 => self%c2, s2 => self%s2)
                ! Direction (cf, sf) of the front wheel.
                cf = c1*self%c_theta - s1*self%s_theta
                sf = s1*self%c_theta + c1*self%s_theta
                if (iand(need, need_phi) /= 0) then
                    terms%phi(1) = q(1) - l*c1 - q(4) - l*c2
                    terms%phi(2) = q(2) - l*s1 - q(5) - l*s2
                end if
                if (iand(need, need_jacobian) /= 0) then
                    terms%jacobian(1, :) = [1.0_wp, 0.0_wp, l*s1, -1.0_wp, 0.0_wp, l*s2]
                    terms%jacobian(2, :) = [0.0_wp, 1.0_wp, -l*c1, 0.0_wp, -1.0_wp, -l*c2]
                    terms%jacobian(3, :) = [-sf, cf, l*self%c_theta, 0.0_wp, 0.0_wp, 0.0_wp]
                    terms%jacobian(4, :) = [-s1, c1, -l, 0.0_wp, 0.0_wp, 0.0_wp]
                    terms%jacobian(5, :) = [0.0_wp, 0.0_wp, 0.0_wp, -s2, c2, -l]
                end if
                if (iand(need, need_gamma) /= 0) then
                    terms%gamma(1) = l*(c1*qd(3)**2 + c2*qd(6)**2)
                    terms%gamma(2) = l*(s1*qd(3)**2 + s2*qd(6)**2)
                    terms%gamma(3) = -(qd(3) + self%theta_rate)*(cf*qd(1) + sf*qd(2)) - l*self%s_theta*self%theta_rate*qd(3)
                    terms%gamma(4) = -qd(3)*(c1*qd(1) + s1*qd(2))
                    terms%gamma(5) = -qd(6)*(c2*qd(4) + s2*qd(5))
                end if
                if (iand(need, need_mass) /= 0) then
                    terms%mass = 0.0_wp
                    do i = 1, 6
                        terms%mass(i, i) = merge(self%inertia, self%mass, mod(i, 3) == 0)
                    end do
                end if
            end associate
        end select
    end subroutine evaluate

    !> Gradients of the velocity and acceleration constraints and of the equations of motion. All terms depend on q only through the
    !> directions of the chassis, so that the columns of x and y are zero.
    subroutine evaluate_derivatives(self, need, t, q, qd, qdd, lambda, derivatives, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:), qdd(:), lambda(:)
        type(derivatives_type), intent(inout) :: derivatives
        integer, intent(out) :: stat
        real(wp) :: cf, sf, turn

        stat = 0
        select type (self)
        class is (articulated_vehicle_type)
            call self%update_directions(t, q)
            associate (l => self%half_length, c1 => self%c1, s1 => self%s1, c2 => self%c2, s2 => self%s2)
                cf = c1*self%c_theta - s1*self%s_theta
                sf = s1*self%c_theta + c1*self%s_theta
                turn = qd(3) + self%theta_rate
                if (iand(need, need_velocity_q) /= 0) then
                    derivatives%velocity_q = 0.0_wp
                    derivatives%velocity_q(:, 3) = [l*c1*qd(3), l*s1*qd(3), -(cf*qd(1) + sf*qd(2)), &
                        -(c1*qd(1) + s1*qd(2)), 0.0_wp]
                    derivatives%velocity_q(:, 6) = [l*c2*qd(6), l*s2*qd(6), 0.0_wp, 0.0_wp, -(c2*qd(4) + s2*qd(5))]
                end if
                if (iand(need, need_acceleration_q) /= 0) then
                    derivatives%acceleration_q = 0.0_wp
                    derivatives%acceleration_q(:, 3) = [l*(c1*qdd(3) - s1*qd(3)**2), l*(s1*qdd(3) + c1*qd(3)**2), &
                        -(cf*qdd(1) + sf*qdd(2)) + turn*(sf*qd(1) - cf*qd(2)), &
                        -(c1*qdd(1) + s1*qdd(2)) + qd(3)*(s1*qd(1) - c1*qd(2)), 0.0_wp]
                    derivatives%acceleration_q(:, 6) = [l*(c2*qdd(6) - s2*qd(6)**2), l*(s2*qdd(6) + c2*qd(6)**2), &
                        0.0_wp, 0.0_wp, -(c2*qdd(4) + s2*qdd(5)) + qd(6)*(s2*qd(4) - c2*qd(5))]
                end if
                if (iand(need, need_acceleration_qd) /= 0) then
                    associate (d => derivatives%acceleration_qd)
                        d = 0.0_wp
                        d(1, 3) = 2*l*c1*qd(3)
                        d(1, 6) = 2*l*c2*qd(6)
                        d(2, 3) = 2*l*s1*qd(3)
                        d(2, 6) = 2*l*s2*qd(6)
                        d(3, 1:3) = [-turn*cf, -turn*sf, -(cf*qd(1) + sf*qd(2)) - l*self%s_theta*self%theta_rate]
                        d(4, 1:3) = [-qd(3)*c1, -qd(3)*s1, -(c1*qd(1) + s1*qd(2))]
                        d(5, 4:6) = [-qd(6)*c2, -qd(6)*s2, -(c2*qd(4) + s2*qd(5))]
                    end associate
                end if
                if (iand(need, need_dynamics_q) /= 0) then
                    ! (C' lambda)_q.
                    associate (d => derivatives%dynamics_q)
                        d = 0.0_wp
                        d(1, 3) = -cf*lambda(3) - c1*lambda(4)
                        d(2, 3) = -sf*lambda(3) - s1*lambda(4)
                        d(3, 3) = l*(c1*lambda(1) + s1*lambda(2))
                        d(4, 6) = -c2*lambda(5)
                        d(5, 6) = -s2*lambda(5)
                        d(6, 6) = l*(c2*lambda(1) + s2*lambda(2))
                    end associate
                end if
                if (iand(need, need_dynamics_qd) /= 0) derivatives%dynamics_qd = 0.0_wp
            end associate
        end select
    end subroutine evaluate_derivatives
end module tandem_models_articulated_vehicle
