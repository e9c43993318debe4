! SPDX-License-Identifier: MIT
!> Three-wheel motorcycle of section 9: a chassis with two rear wheels, and a steered front wheel on a sprung fork that is inclined
!> by `fork_angle`. No wheel slips sideways. The steering angle is theta(t) = -amplitude sin(frequency t) for one period and zero
!> thereafter, so that its rate, and with it nu, jumps at the end of the period.
!>
!> q = (r, p, a, s): centre r and Euler parameters p of the chassis; vector a = (a1, a2) from the centre of the front wheel to its
!> contact point, in the plane of the wheel; length s of the fork. In the frame of the chassis, es is the direction of the fork and
!> y1(theta) the direction perpendicular to it in the plane of the wheel. With y = b - s es + a1 y1 + a2 es and z = -a2 y1 + a1 es,
!> the front contact point is r + A y (116), and the tangent of the rim there is A z (115).
!>
!> M is singular, because a and s have no mass. The start printed in the paper omits the pitch; `start` computes the equilibrium.
module tandem_models_motorcycle
    use tandem_kinds, only: wp
    use tandem_model, only: label_length, model_type
    use tandem_model_derivatives, only: derivatives_type, need_acceleration_q, need_acceleration_qd, need_all_derivatives, &
        need_dynamics_q, need_dynamics_qd, need_velocity_q
    use tandem_model_terms, only: need_force, need_gamma, need_jacobian, need_mass, need_nu, need_phi, terms_type
    use tandem_rigid_euler_parameters, only: b_matrix, b_product, b_row, g_product, g_sandwich, g_transposed_product, k_matrix, &
        rotation, rotation_rate, set_rotational_mass, t_matrix
    implicit none (type, external)
    private

    public :: motorcycle_type

    real(wp), parameter :: ux(3) = [1.0_wp, 0.0_wp, 0.0_wp], uy(3) = [0.0_wp, 1.0_wp, 0.0_wp], uz(3) = [0.0_wp, 0.0_wp, 1.0_wp]

    !> Geometry of the fork at a time, in the frame of the chassis: es, y1, the derivative of y1 with respect to theta, and the
    !> first and second derivative of theta with respect to time.
    type :: fork_type
        real(wp) :: es(3) = 0.0_wp, y1(3) = 0.0_wp, y1_theta(3) = 0.0_wp, rate = 0.0_wp, second_rate = 0.0_wp
    end type fork_type

    !> The motorcycle and its parameters. Set the parameters, then call `define`, then `start` for a consistent start.
    type, extends(model_type) :: motorcycle_type
        !> Mass (kg) and principal moments of inertia of the chassis (kg m^2); acceleration due to gravity (m/s^2).
        real(wp) :: mass = 200.0_wp, inertia(3) = [30.0_wp, 15.0_wp, 30.0_wp], gravity = 9.6_wp
        !> Inclination of the fork (rad): 0.2 for the standard motorcycle, pi/4 for the chopper.
        real(wp) :: fork_angle = 0.2_wp
        !> Stiffness (N/m) and damping (N s/m) of the front suspension.
        real(wp) :: stiffness = 15000.0_wp, damping = 1500.0_wp
        !> Steering amplitude (rad) and angular frequency (rad/s). With a frequency of 0 the front wheel is straight.
        real(wp) :: amplitude = 0.004_wp, frequency = 1.0_wp
        !> Driving force along the y' axis of the chassis (N).
        real(wp) :: driving_force = 0.0_wp
        !> Wheel radius, distance of the rear axle behind the centre, and half the rear track (m).
        real(wp) :: wheel_radius = 0.3_wp, rear_length = 0.6_wp, half_track = 0.5_wp
        !> Distances of the top of the fork in front of the centre and above it (m).
        real(wp) :: fork_forward = 0.6_wp, fork_height = 0.6_wp
        !> Free length of the suspension spring (m). With 0 it is that of the paper, (0.6 + m g / (2 k)) / cos(fork_angle).
        real(wp) :: free_length = 0.0_wp
        !> Cosine and sine of the inclination of the fork, and the inclination for which they were computed.
        real(wp), private :: c_fork = 1.0_wp, s_fork = 0.0_wp, angle_of_fork = 0.0_wp
        !> Geometry of the fork at the last time, and this time.
        type(fork_type), private :: f
        real(wp), private :: t_of_fork = huge(1.0_wp)
        integer, private :: segment_of_fork = 0
    contains
        procedure :: define, start, spring_length
        procedure, private :: steering, update_fork
    end type motorcycle_type

    interface
        !> State of static equilibrium above the origin, heading along y, with the given speed of the rear axle's centre (m/s) and
        !> no pitch rate. stat > 0 if there is no equilibrium nearby, or if the velocity constraints do not determine the other
        !> velocities.
        module subroutine start(self, speed, q, qd, stat)
            implicit none (type, external)
            class(motorcycle_type), intent(inout) :: self
            real(wp), intent(in) :: speed
            real(wp), intent(out) :: q(10), qd(10)
            integer, intent(out) :: stat
        end subroutine start
    end interface

contains

    !> Associate the procedures and set the names. To be called after the parameters are set.
    subroutine define(self)
        class(motorcycle_type), intent(inout) :: self
        real(wp), parameter :: two_pi = 8.0_wp*atan(1.0_wp)

        self%name = 'motorcycle'
        ! Invalidate a geometry that was computed with other parameters.
        self%t_of_fork = huge(1.0_wp)
        self%n = 10
        self%n_holonomic = 6
        self%n_nonholonomic = 2
        self%coordinate_name = [character(len=label_length) :: 'rx', 'ry', 'rz', 'e0', 'e1', 'e2', 'e3', 'a1', 'a2', 's']
        self%coordinate_unit = [character(len=label_length) :: 'm', 'm', 'm', '1', '1', '1', '1', 'm', 'm', 'm']
        self%holonomic_name = [character(len=label_length) :: 'right rear wheel height', 'left rear wheel height', &
            'front contact height', 'front contact tangent', 'Euler parameters', 'front contact radius']
        self%nonholonomic_name = [character(len=label_length) :: 'no slip rear', 'no slip front']
        self%multiplier_unit = [character(len=label_length) :: 'N', 'N', 'N', 'N', 'J', 'N/m', 'N', 'N/m']
        self%breakpoints = [real(wp) ::]
        self%nu_jumps = [logical ::]
        if (abs(self%frequency) > 0.0_wp) then
            self%breakpoints = [two_pi/abs(self%frequency)]
            self%nu_jumps = [.true.]
        end if
        self%evaluate => evaluate
        self%provides = need_phi + need_jacobian + need_nu + need_gamma + need_mass + need_force
        self%evaluate_derivatives => evaluate_derivatives
        self%provides_derivatives = need_all_derivatives
        self%potential_energy => potential_energy
        ! Blocks: centre of the chassis, Euler parameters, contact point on the front wheel, fork.
        self%mass_blocks = [1, 1, 1, 4, 1, 1, 1]
    end subroutine define

    !> Free length of the suspension spring (m).
    pure real(wp) function spring_length(self)
        class(motorcycle_type), intent(in) :: self

        spring_length = self%free_length
        if (spring_length > 0.0_wp) return
        spring_length = (self%fork_height + self%mass*self%gravity/(2*self%stiffness))/cos(self%fork_angle)
    end function spring_length

    !> theta and its derivatives in the current segment.
    pure subroutine steering(self, t, theta, rate, second_rate)
        class(motorcycle_type), intent(in) :: self
        real(wp), intent(in) :: t
        real(wp), intent(out) :: theta, rate, second_rate

        theta = 0.0_wp
        rate = 0.0_wp
        second_rate = 0.0_wp
        if (self%segment > 1) return
        theta = -self%amplitude*sin(self%frequency*t)
        rate = -self%amplitude*self%frequency*cos(self%frequency*t)
        second_rate = self%amplitude*self%frequency**2*sin(self%frequency*t)
    end subroutine steering

    !> Update the stored geometry of the fork to a time. All terms of a point use it.
    pure subroutine update_fork(self, t)
        class(motorcycle_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp) :: theta

        if (.not. (t > self%t_of_fork .or. t < self%t_of_fork) .and. self%segment == self%segment_of_fork) return
        self%t_of_fork = t
        self%segment_of_fork = self%segment
        ! The negated comparison is also true for an angle that is NaN.
        if (.not. abs(self%fork_angle - self%angle_of_fork) <= 0.0_wp) then
            self%angle_of_fork = self%fork_angle
            self%c_fork = cos(self%fork_angle)
            self%s_fork = sin(self%fork_angle)
        end if
        associate (f => self%f, c => self%c_fork, s => self%s_fork)
            call self%steering(t, theta, f%rate, f%second_rate)
            ! A1 rotates by the fork angle about x', A2 by theta about the axis of the fork.
            f%es = [0.0_wp, -s, c]
            f%y1 = [-sin(theta), c*cos(theta), s*cos(theta)]
            f%y1_theta = [-cos(theta), -c*sin(theta), -s*sin(theta)]
        end associate
    end subroutine update_fork

    !> Evaluate the terms (117), (118).
    subroutine evaluate(self, need, t, q, qd, terms, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type), intent(inout) :: terms
        integer, intent(out) :: stat
        type(fork_type) :: f
        real(wp) :: p(4), a(3, 3), y(3), z(3), rear(3)

        stat = 0
        p = q(4:7)
        select type (self)
        class is (motorcycle_type)
            if (iand(need, need_phi + need_jacobian + need_nu + need_gamma) /= 0) then
                call self%update_fork(t)
                f = self%f
                a = rotation(p)
                y = [0.0_wp, self%fork_forward, self%fork_height] + q(8)*f%y1 + (q(9) - q(10))*f%es
                z = q(8)*f%es - q(9)*f%y1
                rear = [0.0_wp, -self%rear_length, 0.0_wp]
            end if
            if (iand(need, need_phi) /= 0) then
                terms%phi(1) = q(3) + dot_product(a(3, :), rear + self%half_track*ux) - self%wheel_radius
                terms%phi(2) = q(3) + dot_product(a(3, :), rear - self%half_track*ux) - self%wheel_radius
                terms%phi(3) = q(3) + dot_product(a(3, :), y)
                terms%phi(4) = dot_product(a(3, :), z)
                terms%phi(5) = 0.5_wp*(dot_product(p, p) - 1.0_wp)
                terms%phi(6) = 0.5_wp*(q(8)**2 + q(9)**2 - self%wheel_radius**2)
            end if
            if (iand(need, need_jacobian) /= 0) call set_jacobian(self, f, q, a, y, z, rear, terms%jacobian)
            if (iand(need, need_nu) /= 0) call set_nu(f, q, a, z, terms%nu)
            if (iand(need, need_gamma) /= 0) call set_gamma(self, f, q, qd, a, y, z, rear, terms%gamma)
            if (iand(need, need_mass) /= 0) call set_mass(self, p, terms%mass)
            if (iand(need, need_force) /= 0) then
                terms%force = 0.0_wp
                terms%force(3) = -self%mass*self%gravity
                terms%force(4:7) = g_transposed_product(qd(4:7), 8*self%inertia*g_product(qd(4:7), p))
                if (abs(self%driving_force) > 0.0_wp) then
                    a = rotation(p)
                    terms%force(1:3) = terms%force(1:3) + self%driving_force*a(:, 2)
                    terms%force(4:7) = terms%force(4:7) + &
                        2*self%wheel_radius*self%driving_force*g_transposed_product(p, ux)
                end if
                terms%force(10) = -self%stiffness*(q(10) - self%spring_length()) - self%damping*qd(10)
            end if
        end select
    end subroutine evaluate

    !> Rows of C: heights of the wheels and norm of the Euler parameters, then the sideways velocities (A ux)' rP0d and (A z x uz)'
    !> rCd.
    pure subroutine set_jacobian(self, f, q, a, y, z, rear, jacobian)
        class(motorcycle_type), intent(in) :: self
        type(fork_type), intent(in) :: f
        real(wp), intent(in) :: q(:), a(3, 3), y(3), z(3), rear(3)
        real(wp), intent(out) :: jacobian(8, 10)
        real(wp) :: p(4), a_y1(3), a_es(3), g(3)

        jacobian = 0.0_wp
        p = q(4:7)
        a_y1 = rotate(a, f%y1)
        a_es = rotate(a, f%es)
        jacobian(1:3, 3) = 1.0_wp
        jacobian(1, 4:7) = height_row(p, rear + self%half_track*ux)
        jacobian(2, 4:7) = height_row(p, rear - self%half_track*ux)
        jacobian(3, 4:7) = height_row(p, y)
        jacobian(3, 8:10) = [a_y1(3), a_es(3), -a_es(3)]
        jacobian(4, 4:7) = height_row(p, z)
        jacobian(4, 8:9) = [a_es(3), -a_y1(3)]
        jacobian(5, 4:7) = p
        jacobian(6, 8:9) = q(8:9)
        jacobian(7, 1:3) = a(:, 1)
        jacobian(7, 4:7) = b_row(p, rear, a(:, 1))
        g = sideways(rotate(a, z))
        jacobian(8, 1:3) = g
        jacobian(8, 4:7) = b_row(p, y, g)
        jacobian(8, 8:10) = [dot_product(g, a_y1), dot_product(g, a_es), -dot_product(g, a_es)]
    end subroutine set_jacobian

    !> Mass matrix: the mass, and 4 G'J G.
    pure subroutine set_mass(self, p, mass)
        class(motorcycle_type), intent(in) :: self
        real(wp), intent(in) :: p(4)
        real(wp), intent(out) :: mass(10, 10)
        integer :: i

        mass = 0.0_wp
        do i = 1, 3
            mass(i, i) = self%mass
        end do
        call set_rotational_mass(p, self%inertia, size(mass, 1), mass(4, 4))
    end subroutine set_mass

    !> nu = [-Phi_t; e]: y and z change with the steering angle at constant q.
    pure subroutine set_nu(f, q, a, z, nu)
        type(fork_type), intent(in) :: f
        real(wp), intent(in) :: q(:), a(3, 3), z(3)
        real(wp), intent(inout) :: nu(:)
        real(wp) :: turned(3), g(3)

        nu = 0.0_wp
        turned = f%rate*rotate(a, f%y1_theta)
        g = sideways(rotate(a, z))
        nu(3) = -q(8)*turned(3)
        nu(4) = q(9)*turned(3)
        nu(8) = -q(8)*dot_product(g, turned)
    end subroutine set_nu

    !> Rows of gamma: accelerations of the constrained points for qdd = 0.
    pure subroutine set_gamma(self, f, q, qd, a, y, z, rear, gamma)
        class(motorcycle_type), intent(in) :: self
        type(fork_type), intent(in) :: f
        real(wp), intent(in) :: q(:), qd(:), a(3, 3), y(3), z(3), rear(3)
        real(wp), intent(inout) :: gamma(:)
        real(wp) :: pd(4), ad(3, 3), add(3, 3), yd(3), ydd(3), zd(3), zdd(3)
        real(wp) :: v_rear(3), a_rear(3), v_front(3), a_front(3), a_track

        pd = qd(4:7)
        ! Ad and Add for qdd = 0; A is quadratic in p.
        ad = rotation_rate(q(4:7), pd)
        add = 2*rotation(pd)
        call set_fork_velocity(f, q, qd, yd, zd)
        call set_fork_acceleration(f, q, qd, ydd, zdd)
        a_rear = rotate(add, rear)
        a_track = self%half_track*add(3, 1)
        gamma(1) = a_rear(3) + a_track
        gamma(2) = a_rear(3) - a_track
        a_front = rotate(a, ydd) + rotate(add, y) + 2*rotate(ad, yd)
        gamma(3) = a_front(3)
        gamma(4) = dot_product(a(3, :), zdd) + dot_product(add(3, :), z) + 2*dot_product(ad(3, :), zd)
        gamma(5) = dot_product(pd, pd)
        gamma(6) = qd(8)**2 + qd(9)**2
        v_rear = qd(1:3) + rotate(ad, rear)
        gamma(7) = dot_product(a(:, 1), a_rear) + dot_product(ad(:, 1), v_rear)
        v_front = qd(1:3) + rotate(ad, y) + rotate(a, yd)
        gamma(8) = dot_product(sideways(rotate(a, z)), a_front) + &
            dot_product(sideways(rotate(ad, z) + rotate(a, zd)), v_front)
    end subroutine set_gamma

    !> Velocities yd and zd of y and z in the frame of the chassis, including the steering.
    pure subroutine set_fork_velocity(f, q, qd, yd, zd)
        type(fork_type), intent(in) :: f
        real(wp), intent(in) :: q(:), qd(:)
        real(wp), intent(out) :: yd(3), zd(3)

        yd = qd(8)*f%y1 + (q(8)*f%rate)*f%y1_theta + (qd(9) - qd(10))*f%es
        zd = qd(8)*f%es - qd(9)*f%y1 - (q(9)*f%rate)*f%y1_theta
    end subroutine set_fork_velocity

    !> Accelerations of y and z in the frame of the chassis for qdd = 0. The second derivative of y1 with respect to theta is -y1,
    !> because y1 is perpendicular to the fork.
    pure subroutine set_fork_acceleration(f, q, qd, ydd, zdd)
        type(fork_type), intent(in) :: f
        real(wp), intent(in) :: q(:), qd(:)
        real(wp), intent(out) :: ydd(3), zdd(3)
        real(wp) :: y1dd(3)

        y1dd = f%second_rate*f%y1_theta - f%rate**2*f%y1
        ydd = (2*qd(8)*f%rate)*f%y1_theta + q(8)*y1dd
        zdd = -(2*qd(9)*f%rate)*f%y1_theta - q(9)*y1dd
    end subroutine set_fork_acceleration

    !> Gradients of the velocity and acceleration constraints and of the equations of motion.
    subroutine evaluate_derivatives(self, need, t, q, qd, qdd, lambda, derivatives, stat)
        class(model_type), intent(inout) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: t, q(:), qd(:), qdd(:), lambda(:)
        type(derivatives_type), intent(inout) :: derivatives
        integer, intent(out) :: stat

        stat = 0
        select type (self)
        class is (motorcycle_type)
            call self%update_fork(t)
            if (iand(need, need_velocity_q + need_acceleration_q + need_acceleration_qd) /= 0) then
                call differentiate_rear(self, need, q, qd, qdd, derivatives)
                call differentiate_front(self, need, q, qd, qdd, derivatives)
            end if
            if (iand(need, need_dynamics_q) /= 0) call differentiate_dynamics(self, t, q, qd, qdd, lambda, derivatives%dynamics_q)
            if (iand(need, need_dynamics_qd) /= 0) then
                derivatives%dynamics_qd = 0.0_wp
                derivatives%dynamics_qd(4:7, 4:7) = 8*g_sandwich(qd(4:7), self%inertia, q(4:7)) &
                    - 8*t_matrix(self%inertia*g_product(qd(4:7), q(4:7)))
                derivatives%dynamics_qd(10, 10) = self%damping
            end if
        end select
    end subroutine evaluate_derivatives

    !> Gradients velocity_q, acceleration_q and acceleration_qd of the rows of the rear wheels, of the Euler parameters, and of the
    !> rear axle.
    subroutine differentiate_rear(self, need, q, qd, qdd, derivatives)
        class(motorcycle_type), intent(in) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: q(:), qd(:), qdd(:)
        type(derivatives_type), intent(inout) :: derivatives
        real(wp), dimension(3) :: rear, right, left, n, nd, v, a
        real(wp) :: p(4), pd(4), pdd(4), frame(3, 3), axle(3, 4), block(3, 4)

        p = q(4:7)
        pd = qd(4:7)
        pdd = qdd(4:7)
        rear = [0.0_wp, -self%rear_length, 0.0_wp]
        right = rear + self%half_track*ux
        left = rear - self%half_track*ux
        ! Direction of the axle and its gradient with respect to p; velocity and acceleration of the axle's centre.
        frame = rotation(p)
        n = frame(:, 1)
        nd = b_product(p, ux, pd)
        v = qd(1:3) + b_product(p, rear, pd)
        a = qdd(1:3) + b_product(p, rear, pdd) + b_product(pd, rear, pd)
        axle = b_matrix(p, ux)
        if (iand(need, need_velocity_q) /= 0) then
            associate (d => derivatives%velocity_q)
                d = 0.0_wp
                block = b_matrix(pd, right)
                d(1, 4:7) = block(3, :)
                block = b_matrix(pd, left)
                d(2, 4:7) = block(3, :)
                d(5, 4:7) = pd
                d(6, 8:9) = qd(8:9)
                d(7, 4:7) = row_of(v, axle) + row_of(n, b_matrix(pd, rear))
            end associate
        end if
        if (iand(need, need_acceleration_q) /= 0) then
            associate (d => derivatives%acceleration_q)
                d = 0.0_wp
                block = b_matrix(pdd, right)
                d(1, 4:7) = block(3, :)
                block = b_matrix(pdd, left)
                d(2, 4:7) = block(3, :)
                d(5, 4:7) = pdd
                d(6, 8:9) = qdd(8:9)
                d(7, 4:7) = row_of(a, axle) + row_of(n, b_matrix(pdd, rear)) + row_of(v, b_matrix(pd, ux)) + &
                    row_of(nd, b_matrix(pd, rear))
            end associate
        end if
        if (iand(need, need_acceleration_qd) /= 0) then
            associate (d => derivatives%acceleration_qd)
                d = 0.0_wp
                block = b_matrix(pd, right)
                d(1, 4:7) = 2*block(3, :)
                block = b_matrix(pd, left)
                d(2, 4:7) = 2*block(3, :)
                d(5, 4:7) = 2*pd
                d(6, 8:9) = 2*qd(8:9)
                d(7, 1:3) = nd
                d(7, 4:7) = 2*row_of(n, b_matrix(pd, rear)) + row_of(v, axle) + row_of(nd, b_matrix(p, rear))
            end associate
        end if
    end subroutine differentiate_rear

    !> The same gradients of the rows of the front wheel. The contact point is r + A b + a1 (A y1) + (a2 - s) (A es), and the
    !> tangent of the rim is a1 (A es) - a2 (A y1). The gradients of both with respect to a and s are therefore A y1 and A es, with
    !> their time derivatives.
    subroutine differentiate_front(self, need, q, qd, qdd, derivatives)
        class(motorcycle_type), intent(in) :: self
        integer, intent(in) :: need
        real(wp), intent(in) :: q(:), qd(:), qdd(:)
        type(derivatives_type), intent(inout) :: derivatives
        type(fork_type) :: f
        real(wp) :: p(4), pd(4), pdd(4), a(3, 3)
        real(wp), dimension(3) :: y, z, yd, zd, ydd, zdd, y1, es, y1d, esd, y1dd, esdd, v_front, a_front, g, gd, k, kd
        real(wp), dimension(3, 4) :: front_p, tangent_p, front_vp, tangent_vp, block

        p = q(4:7)
        pd = qd(4:7)
        pdd = qdd(4:7)
        f = self%f
        a = rotation(p)
        y = [0.0_wp, self%fork_forward, self%fork_height] + q(8)*f%y1 + (q(9) - q(10))*f%es
        z = q(8)*f%es - q(9)*f%y1
        call set_fork_velocity(f, q, qd, yd, zd)
        call set_fork_acceleration(f, q, qd, ydd, zdd)
        ydd = ydd + qdd(8)*f%y1 + (qdd(9) - qdd(10))*f%es
        zdd = zdd + qdd(8)*f%es - qdd(9)*f%y1
        ! A y1 and A es, with first and second time derivatives.
        y1 = rotate(a, f%y1)
        es = rotate(a, f%es)
        y1d = b_product(p, f%y1, pd) + f%rate*rotate(a, f%y1_theta)
        esd = b_product(p, f%es, pd)
        y1dd = b_product(p, f%y1, pdd) + b_product(pd, f%y1, pd) + 2*f%rate*b_product(p, f%y1_theta, pd) + &
            rotate(a, f%second_rate*f%y1_theta - f%rate**2*f%y1)
        esdd = b_product(p, f%es, pdd) + b_product(pd, f%es, pd)
        ! Sideways direction of the wheel; velocity and acceleration of the contact point.
        g = sideways(rotate(a, z))
        gd = sideways(b_product(p, z, pd) + rotate(a, zd))
        v_front = qd(1:3) + b_product(p, y, pd) + rotate(a, yd)
        a_front = qdd(1:3) + b_product(p, y, pdd) + rotate(a, ydd) + b_product(pd, y, pd) + 2*b_product(p, yd, pd)
        k = sideways_adjoint(v_front)
        kd = sideways_adjoint(a_front)
        ! Gradients with respect to p of the position and velocity of the contact point, and of the tangent.
        front_p = b_matrix(p, y)
        tangent_p = b_matrix(p, z)
        front_vp = b_matrix(pd, y) + b_matrix(p, yd)
        tangent_vp = b_matrix(pd, z) + b_matrix(p, zd)
        if (iand(need, need_velocity_q) /= 0) then
            associate (d => derivatives%velocity_q)
                d(3, 4:7) = front_vp(3, :)
                d(3, 8:10) = [y1d(3), esd(3), -esd(3)]
                d(4, 4:7) = tangent_vp(3, :)
                d(4, 8:9) = [esd(3), -y1d(3)]
                d(8, 4:7) = row_of(k, tangent_p) + row_of(g, front_vp)
                d(8, 8:10) = [dot_product(k, es) + dot_product(g, y1d), -dot_product(k, y1) + dot_product(g, esd), &
                    -dot_product(g, esd)]
            end associate
        end if
        if (iand(need, need_acceleration_q) /= 0) then
            associate (d => derivatives%acceleration_q)
                block = b_matrix(pdd, z) + b_matrix(p, zdd) + 2*b_matrix(pd, zd)
                d(4, 4:7) = block(3, :)
                d(4, 8:9) = [esdd(3), -y1dd(3)]
                block = b_matrix(pdd, y) + b_matrix(p, ydd) + 2*b_matrix(pd, yd)
                d(3, 4:7) = block(3, :)
                d(3, 8:10) = [y1dd(3), esdd(3), -esdd(3)]
                d(8, 4:7) = row_of(kd, tangent_p) + row_of(g, block) + row_of(k, tangent_vp) + row_of(gd, front_vp)
                d(8, 8) = dot_product(kd, es) + dot_product(g, y1dd) + dot_product(k, esd) + dot_product(gd, y1d)
                d(8, 9) = -dot_product(kd, y1) + dot_product(g, esdd) - dot_product(k, y1d) + dot_product(gd, esd)
                d(8, 10) = -dot_product(g, esdd) - dot_product(gd, esd)
            end associate
        end if
        if (iand(need, need_acceleration_qd) /= 0) then
            associate (d => derivatives%acceleration_qd)
                d(3, 4:7) = 2*front_vp(3, :)
                d(3, 8:10) = 2*[y1d(3), esd(3), -esd(3)]
                d(4, 4:7) = 2*tangent_vp(3, :)
                d(4, 8:9) = 2*[esd(3), -y1d(3)]
                d(8, 1:3) = gd
                d(8, 4:7) = 2*row_of(g, front_vp) + row_of(k, tangent_p) + row_of(gd, front_p)
                d(8, 8) = 2*dot_product(g, y1d) + dot_product(k, es) + dot_product(gd, y1)
                d(8, 9) = 2*dot_product(g, esd) - dot_product(k, y1) + dot_product(gd, es)
                d(8, 10) = -2*dot_product(g, esd) - dot_product(gd, es)
            end associate
        end if
    end subroutine differentiate_front

    !> Gradient dynamics_q = M2(q, qdd) - S_q - Q_Aq + (C' lambda)_q. The contact force at the front wheel is lambda3 uz + lambda8
    !> g, where g rotates with the tangent. The force at the rear axle is lambda7 A ux.
    pure subroutine differentiate_dynamics(self, t, q, qd, qdd, lambda, d)
        class(motorcycle_type), intent(in) :: self
        real(wp), intent(in) :: t, q(:), qd(:), qdd(:), lambda(:)
        real(wp), intent(out) :: d(:, :)
        type(fork_type) :: f
        real(wp) :: p(4), a(3, 3), y(3), z(3), rear(3), y1(3), es(3), push(3)
        real(wp) :: rear_p(3, 4), front_p(3, 4), turn_p(3, 4), turn_1(3), turn_2(3), axle(3, 4), y1_p(3, 4), es_p(3, 4), row(4)
        integer :: i, j

        p = q(4:7)
        f = self%f
        a = rotation(p)
        rear = [0.0_wp, -self%rear_length, 0.0_wp]
        y = [0.0_wp, self%fork_forward, self%fork_height] + q(8)*f%y1 + (q(9) - q(10))*f%es
        z = q(8)*f%es - q(9)*f%y1
        y1 = rotate(a, f%y1)
        es = rotate(a, f%es)
        y1_p = b_matrix(p, f%y1)
        es_p = b_matrix(p, f%es)
        rear_p = b_matrix(p, rear)
        front_p = b_matrix(p, y)
        axle = b_matrix(p, ux)
        push = lambda(3)*uz + lambda(8)*sideways(rotate(a, z))
        ! Gradients of lambda8 g with respect to p, a1 and a2.
        turn_p = b_matrix(p, z)
        do j = 1, 4
            turn_p(:, j) = lambda(8)*sideways(turn_p(:, j))
        end do
        turn_1 = lambda(8)*sideways(es)
        turn_2 = -lambda(8)*sideways(y1)

        d = 0.0_wp
        d(1:3, 4:7) = lambda(7)*axle + turn_p
        d(1:3, 8) = turn_1
        d(1:3, 9) = turn_2
        d(4:7, 4:7) = 4*t_matrix(self%inertia*g_product(p, qdd(4:7))) - 4*g_sandwich(p, self%inertia, qdd(4:7)) &
            - 8*g_sandwich(qd(4:7), self%inertia, qd(4:7)) &
            + lambda(1)*k_matrix(rear + self%half_track*ux, uz) + lambda(2)*k_matrix(rear - self%half_track*ux, uz) &
            + k_matrix(y, push) + lambda(4)*k_matrix(z, uz) + lambda(7)*k_matrix(rear, a(:, 1))
        do j = 1, 4
            d(3 + j, 3 + j) = d(3 + j, 3 + j) + lambda(5)
            do i = 1, 4
                d(3 + i, 3 + j) = d(3 + i, 3 + j) + dot_product(front_p(:, i), turn_p(:, j)) + &
                    lambda(7)*dot_product(rear_p(:, i), axle(:, j))
            end do
        end do
        d(4:7, 8) = row_of(push, y1_p) + lambda(4)*es_p(3, :) + row_of(turn_1, front_p)
        d(4:7, 9) = row_of(push, es_p) - lambda(4)*y1_p(3, :) + row_of(turn_2, front_p)
        d(4:7, 10) = -row_of(push, es_p)
        d(8, 4:7) = row_of(push, y1_p) + lambda(4)*es_p(3, :) + row_of(y1, turn_p)
        d(8, 8) = lambda(6) + dot_product(y1, turn_1)
        d(8, 9) = dot_product(y1, turn_2)
        row = row_of(push, es_p) + row_of(es, turn_p)
        d(9, 4:7) = row - lambda(4)*y1_p(3, :)
        d(9, 8) = dot_product(es, turn_1)
        d(9, 9) = lambda(6) + dot_product(es, turn_2)
        d(10, 4:7) = -row
        d(10, 8) = -dot_product(es, turn_1)
        d(10, 9) = -dot_product(es, turn_2)
        d(10, 10) = self%stiffness
        if (abs(self%driving_force) > 0.0_wp) then
            d(1:3, 4:7) = d(1:3, 4:7) - self%driving_force*b_matrix(p, uy)
            d(4:7, 4:7) = d(4:7, 4:7) - 2*self%wheel_radius*self%driving_force*t_matrix(ux)
        end if
    end subroutine differentiate_dynamics

    !> Potential energy V = m g rz + k (s - sf)^2 / 2.
    subroutine potential_energy(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value
        integer, intent(out) :: stat

        stat = 0
        value = 0.0_wp
        select type (self)
        class is (motorcycle_type)
            value = self%mass*self%gravity*q(3) + 0.5_wp*self%stiffness*(q(10) - self%spring_length())**2
        end select
    end subroutine potential_energy

    !> A b.
    pure function rotate(a, b) result(c)
        real(wp), intent(in) :: a(3, 3), b(3)
        real(wp) :: c(3)

        c = a(:, 1)*b(1) + a(:, 2)*b(2) + a(:, 3)*b(3)
    end function rotate

    !> Gradient with respect to p of the height of A a: uz' B(p, a).
    pure function height_row(p, a) result(row)
        real(wp), intent(in) :: p(4), a(3)
        real(wp) :: row(4)

        row(1) = 2*(p(1)*a(3) + p(2)*a(2) - p(3)*a(1))
        row(2) = 2*(p(1)*a(2) - p(2)*a(3) + p(4)*a(1))
        row(3) = 2*(p(4)*a(2) - p(1)*a(1) - p(3)*a(3))
        row(4) = 2*(p(2)*a(1) + p(3)*a(2) + p(4)*a(3))
    end function height_row

    !> b x uz, which converts the tangent of a rim to the sideways direction of the wheel.
    pure function sideways(b) result(c)
        real(wp), intent(in) :: b(3)
        real(wp) :: c(3)

        c = [b(2), -b(1), 0.0_wp]
    end function sideways

    !> a' B (4).
    pure function row_of(a, block) result(row)
        real(wp), intent(in) :: a(3), block(3, 4)
        real(wp) :: row(4)

        row = a(1)*block(1, :) + a(2)*block(2, :) + a(3)*block(3, :)
    end function row_of

    !> uz x b, so that dot_product(sideways(a), b) = dot_product(a, sideways_adjoint(b)).
    pure function sideways_adjoint(b) result(c)
        real(wp), intent(in) :: b(3)
        real(wp) :: c(3)

        c = [-b(2), b(1), 0.0_wp]
    end function sideways_adjoint
end module tandem_models_motorcycle
