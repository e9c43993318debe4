! SPDX-License-Identifier: MIT
!> The three-wheel motorcycle of section 9: a chassis on two rear wheels and a steered front wheel on a sprung fork that is
!> inclined by `fork_angle`; no wheel slips sideways. The steering angle is theta(t) = -amplitude sin(frequency t) for one
!> period, then zero, so that its rate, and with it nu, jumps at the end of the period.
!>
!> q = (r, p, a, s): the chassis' centre r and Euler parameters p, the vector a = (a1, a2) from the front wheel's centre to its
!> contact point in the wheel's plane, and the fork's length s. With y = b - s es + a1 y1 + a2 es and z = -a2 y1 + a1 es in the
!> chassis' frame, es along the fork and y1(theta) across it in the wheel's plane, the front contact point is
!> r + A y (116) and the rim's tangent there is A z (115).
!>
!> M is singular: a and s carry no mass. The printed start of the paper leaves the pitch out; `start` computes the equilibrium.
module tandem_models_motorcycle
    use tandem_kinds, only: wp
    use tandem_model, only: label_length, model_type
    use tandem_model_derivatives, only: derivatives_type, need_all_derivatives
    use tandem_model_terms, only: need_force, need_gamma, need_jacobian, need_mass, need_nu, need_phi, terms_type
    use tandem_models_motorcycle_fork, only: bend_fork, fork_type, move_fork
    use tandem_rigid_euler_parameters, only: b_matrix, b_product, b_row, g_product, g_transposed_product, rotation, &
        rotation_rate, set_rotational_mass
    use tandem_rigid_vectors, only: rotate, sideways
    implicit none (type, external)
    private

    public :: motorcycle_type

    real(wp), parameter :: ux(3) = [1.0_wp, 0.0_wp, 0.0_wp]

    !> The motorcycle with its parameters; set those, call `define`, then `start` gives a consistent start.
    type, extends(model_type) :: motorcycle_type
        !> Mass (kg) and principal moments of inertia of the chassis (kg m^2); acceleration due to gravity (m/s^2).
        real(wp) :: mass = 200.0_wp, inertia(3) = [30.0_wp, 15.0_wp, 30.0_wp], gravity = 9.6_wp
        !> Inclination of the fork (rad): 0.2 for the standard motorcycle, pi/4 for the chopper.
        real(wp) :: fork_angle = 0.2_wp
        !> Stiffness (N/m) and damping (N s/m) of the front suspension.
        real(wp) :: stiffness = 15000.0_wp, damping = 1500.0_wp
        !> Steering amplitude (rad) and angular frequency (rad/s); a frequency of 0 steers straight.
        real(wp) :: amplitude = 0.004_wp, frequency = 1.0_wp
        !> Driving force along the chassis' y' axis (N).
        real(wp) :: driving_force = 0.0_wp
        !> Wheel radius, distance from the centre back to the rear axle, half the rear track (m).
        real(wp) :: wheel_radius = 0.3_wp, rear_length = 0.6_wp, half_track = 0.5_wp
        !> Top of the fork in front of and above the centre (m).
        real(wp) :: fork_forward = 0.6_wp, fork_height = 0.6_wp
        !> Free length of the suspension spring (m); 0 stands for the paper's (0.6 + m g / (2 k)) / cos(fork_angle).
        real(wp) :: free_length = 0.0_wp
        !> Cosine and sine of the fork's inclination, and the inclination that they are of.
        real(wp), private :: c_fork = 1.0_wp, s_fork = 0.0_wp, angle_of_fork = 0.0_wp
        !> The fork at the last time, and when that was.
        type(fork_type), private :: f
        real(wp), private :: t_of_fork = huge(1.0_wp)
        integer, private :: segment_of_fork = 0
    contains
        procedure :: define
        procedure :: start
        procedure :: spring_length
        procedure, private :: steering
        procedure, private :: turn_fork
    end type motorcycle_type

    interface
        !> The static equilibrium over the origin, heading along y, with the rear axle's centre at a speed (m/s) and no pitch rate.
        !> stat > 0: there is no equilibrium near, or the velocity constraints do not fix the rest.
        module subroutine start(self, speed, q, qd, stat)
            implicit none (type, external)
            class(motorcycle_type), intent(inout) :: self
            real(wp), intent(in) :: speed
            real(wp), intent(out) :: q(10), qd(10)
            integer, intent(out) :: stat
        end subroutine start

        !> The derivatives that Newton's iterations ask for.
        module subroutine evaluate_derivatives(self, need, t, q, qd, qdd, lambda, derivatives, stat)
            implicit none (type, external)
            class(model_type), intent(inout) :: self
            integer, intent(in) :: need
            real(wp), intent(in) :: t, q(:), qd(:), qdd(:), lambda(:)
            type(derivatives_type), intent(inout) :: derivatives
            integer, intent(out) :: stat
        end subroutine evaluate_derivatives
    end interface

contains

    !> Associate the procedures and name everything; to be called after the parameters are set.
    subroutine define(self)
        class(motorcycle_type), intent(inout) :: self
        real(wp), parameter :: two_pi = 8.0_wp*atan(1.0_wp)

        self%name = 'motorcycle'
        ! The fork of other parameters is worth nothing.
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
        ! The origin of the frame, the Euler parameters, the contact's place on the front wheel, the fork.
        self%mass_blocks = [1, 1, 1, 4, 1, 1, 1]
    end subroutine define

    !> The free length of the suspension spring (m).
    pure real(wp) function spring_length(self)
        class(motorcycle_type), intent(in) :: self

        spring_length = self%free_length
        if (spring_length > 0.0_wp) return
        spring_length = (self%fork_height + self%mass*self%gravity/(2*self%stiffness))/cos(self%fork_angle)
    end function spring_length

    !> theta and its rates in the current segment.
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

    !> Bring the fork to a time; the terms of a point share it.
    pure subroutine turn_fork(self, t)
        class(motorcycle_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp) :: theta

        if (.not. (t > self%t_of_fork .or. t < self%t_of_fork) .and. self%segment == self%segment_of_fork) return
        self%t_of_fork = t
        self%segment_of_fork = self%segment
        ! An angle that is no number is another one too, and shows.
        if (.not. abs(self%fork_angle - self%angle_of_fork) <= 0.0_wp) then
            self%angle_of_fork = self%fork_angle
            self%c_fork = cos(self%fork_angle)
            self%s_fork = sin(self%fork_angle)
        end if
        associate (f => self%f, c => self%c_fork, s => self%s_fork)
            call self%steering(t, theta, f%rate, f%second_rate)
            ! A1 turns by the fork angle about x', A2 by theta about the fork.
            f%es = [0.0_wp, -s, c]
            f%y1 = [-sin(theta), c*cos(theta), s*cos(theta)]
            f%y1_theta = [-cos(theta), -c*sin(theta), -s*sin(theta)]
        end associate
    end subroutine turn_fork

    !> The terms (117), (118).
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
                call self%turn_fork(t)
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

    !> The rows of C: the wheels' heights and the norms, then the sideways velocities (A ux)' rP0d and (A z x uz)' rCd.
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

    !> M, of the mass and 4 G' J G.
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

    !> nu = [-Phi_t; e]: y and z move with the steering while q stands still.
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

    !> The rows of gamma: the accelerations of the constraints' points with qdd = 0.
    pure subroutine set_gamma(self, f, q, qd, a, y, z, rear, gamma)
        class(motorcycle_type), intent(in) :: self
        type(fork_type), intent(in) :: f
        real(wp), intent(in) :: q(:), qd(:), a(3, 3), y(3), z(3), rear(3)
        real(wp), intent(inout) :: gamma(:)
        real(wp) :: pd(4), ad(3, 3), add(3, 3), yd(3), ydd(3), zd(3), zdd(3)
        real(wp) :: v_rear(3), a_rear(3), v_front(3), a_front(3), a_track

        pd = qd(4:7)
        ! Ad, and Add with qdd = 0: A is quadratic in p.
        ad = rotation_rate(q(4:7), pd)
        add = 2*rotation(pd)
        call move_fork(f, q, qd, yd, zd)
        call bend_fork(f, q, qd, ydd, zdd)
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

    !> The gradient by p of the height of A a, uz' B(p, a).
    pure function height_row(p, a) result(row)
        real(wp), intent(in) :: p(4), a(3)
        real(wp) :: row(4)

        row(1) = 2*(p(1)*a(3) + p(2)*a(2) - p(3)*a(1))
        row(2) = 2*(p(1)*a(2) - p(2)*a(3) + p(4)*a(1))
        row(3) = 2*(p(4)*a(2) - p(1)*a(1) - p(3)*a(3))
        row(4) = 2*(p(2)*a(1) + p(3)*a(2) + p(4)*a(3))
    end function height_row

    !> V = m g rz + k (s - sf)^2 / 2.
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
end module tandem_models_motorcycle
