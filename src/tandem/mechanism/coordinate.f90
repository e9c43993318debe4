! SPDX-License-Identifier: MIT
!> Scalar coordinates x(q) between two bodies: the displacement along an axis of the first body, the distance of two points, the
!> angle about a common axis, or a small angle. Couplings constrain sums of coordinates, forces act along them,
!> expressions and sensors read them. Each provides its value and gradient, their derivatives along the motion, and its second
!> gradient.
!>
!> An angle may exceed a full revolution. Its value is the one nearest to the value at the last accepted point of a run or, outside
!> a run, at the last evaluated point.
module tandem_mechanism_coordinate
    use tandem_kinds, only: wp
    use tandem_mechanism_perpendicular, only: set_vectors, dot_gradient, dot_second, perpendicular_type
    use tandem_mechanism_pair, only: add_outer, n_local, place_1, place_2, turn_1, turn_2
    use tandem_mechanism_pose, only: pose_type, turned
    use tandem_mechanism_point_vector, only: vector_gradient, vector_second, point_vector_type, vector_between
    use tandem_mechanism_vector, only: cross
    use tandem_rigid_euler_parameters, only: e_transposed_product
    implicit none (type, external)
    private

    public :: coordinate_type, begin_turns, count_turns, end_search, measure, measure_apart, differentiate_coordinate, find_slope
    public :: slide_coordinate, pi, is_displacement, is_distance, is_angle, is_tilt, is_elevation, is_rotation
    public :: number_slide, subtract_force

    !> Kinds of coordinates: displacement, the scalar product `one` (m); distance (m); angle (rad) whose cosine and sine are the
    !> scalar products `one` and `other`, in the plane the difference of two angles; small angle (one - other)/2, which is the sine
    !> of the angle about the third axis if this axis is common to both bodies; elevation between -pi/2 and pi/2 (rad), whose sine
    !> is `one` and whose cosine is the length of the vector of two scalar products: `other`, and that of the third axis.
    integer, parameter :: is_displacement = 1, is_distance = 2, is_angle = 3, is_tilt = 4, is_elevation = 5

    type :: coordinate_type
        integer :: kind = is_displacement
        !> Bodies, 0 for the ground.
        integer :: first = 0, second = 0
        type(perpendicular_type) :: one, other
        type(point_vector_type) :: vector
        !> Offset (m or rad), which is subtracted from the value.
        real(wp) :: offset = 0.0_wp
        !> Index of the function of time that drives the angle, 0 if none.
        integer :: motion = 0
        !> Angle at the last accepted point, before the offset is subtracted. `waits` is true if `last` is set only at accepted
        !> points of a run, and not at trial points of steps or of the search for a start.
        real(wp) :: last = 0.0_wp
        logical :: waits = .false.
        !> True once a run has started; angle at the first start. The search for a consistent position or an equilibrium may have
        !> moved the angle away from its value in the reference configuration.
        logical :: has_begun = .false.
        real(wp) :: begun = 0.0_wp
    end type coordinate_type

    !> Half a revolution (rad).
    real(wp), parameter :: pi = acos(-1.0_wp)

contains

    !> Displacement of a part with one coordinate, which is no body.
    pure function slide_coordinate(pose) result(coordinate)
        integer, intent(in) :: pose
        type(coordinate_type) :: coordinate

        coordinate%second = pose
        coordinate%one%second = pose
        coordinate%one%is_point = .true.
        coordinate%one%a(1) = 1.0_wp
    end function slide_coordinate

    !> Value of the coordinate only.
    pure subroutine measure(self, pose, x)
        type(coordinate_type), intent(inout) :: self
        type(pose_type), intent(in) :: pose(0:)
        !> x (m or rad).
        real(wp), intent(out) :: x
        real(wp) :: turns

        call measure_apart(self, pose, x, turns)
        x = x + 2*pi*turns
    end subroutine measure

    !> Value without the full revolutions of an angle in space, and their number. Planar angles are coordinates of bodies and
    !> include their revolutions.
    pure subroutine measure_apart(self, pose, x, turns)
        type(coordinate_type), intent(inout) :: self
        type(pose_type), intent(in) :: pose(0:)
        !> x (m or rad) without the revolutions; number of revolutions to be added.
        real(wp), intent(out) :: x, turns
        real(wp) :: a(3, 0:2), d(3, 0:2), vector(3)

        turns = 0.0_wp
        select case (self%kind)
        case (is_distance)
            vector = vector_between(self%vector, pose, 0)
            x = sqrt(vector(1)**2 + vector(2)**2 + vector(3)**2)
        case (is_angle)
            if (is_planar(self, pose)) then
                x = pose(self%second)%p(1, 0) - pose(self%first)%p(1, 0)
            else
                call set_vectors(self%one, pose, 0, a, d)
                x = product_rate(a, d, 0)
                call set_vectors(self%other, pose, 0, a, d)
                x = atan2(product_rate(a, d, 0), x)
                turns = anint((self%last - x)/(2*pi))
                if (.not. self%waits) self%last = x + 2*pi*turns
            end if
        case (is_elevation)
            call set_vectors(self%one, pose, 0, a, d)
            vector = cross(a(:, 0), d(:, 0))
            x = atan2(product_rate(a, d, 0), sqrt(dot3(vector, vector)))
        case default
            call set_vectors(self%one, pose, 0, a, d)
            x = product_rate(a, d, 0)
            if (self%kind == is_tilt) then
                call set_vectors(self%other, pose, 0, a, d)
                x = (x - product_rate(a, d, 0))/2
            end if
        end select
        x = x - self%offset
    end subroutine measure_apart

    !> Reset the revolutions to those at the first start. Called for every point of the search for a start.
    pure subroutine begin_turns(self, pose, f)
        type(coordinate_type), intent(inout) :: self
        !> Not used.
        type(pose_type), intent(in) :: pose(0:)
        real(wp), intent(in), contiguous :: f(0:, :)

        if (self%has_begun) self%last = self%begun
        self%waits = .false.
    end subroutine begin_turns

    !> Count revolutions at a point of the search for a start, or at an accepted point of a run.
    pure subroutine count_turns(self, pose, f)
        type(coordinate_type), intent(inout) :: self
        type(pose_type), intent(in) :: pose(0:)
        !> Values and derivatives of the functions of time.
        real(wp), intent(in), contiguous :: f(0:, :)
        real(wp) :: x
        logical :: waits

        if (self%kind /= is_angle) return
        if (self%motion > 0) self%last = f(0, self%motion) + self%offset
        waits = self%waits
        self%waits = .false.
        call measure(self, pose, x)
        self%waits = waits
    end subroutine count_turns

    !> End the search for a start: count revolutions only at accepted points of the run from now on.
    pure subroutine end_search(self, pose, f)
        type(coordinate_type), intent(inout) :: self
        !> Not used.
        type(pose_type), intent(in) :: pose(0:)
        real(wp), intent(in), contiguous :: f(0:, :)

        self%waits = .true.
        if (.not. self%has_begun) self%begun = self%last
        self%has_begun = .true.
    end subroutine end_search

    !> Value, rate and gradient, as required for a force. For an angle in space this omits the derivatives of the gradient. With z =
    !> c + i s the gradient is (c s_q - s c_q)/|z|^2. An elevation is the angle by a rotation about the axis d x a.
    pure subroutine find_slope(self, pose, x, gradient)
        type(coordinate_type), intent(inout) :: self
        type(pose_type), intent(in) :: pose(0:)
        !> x and its rate.
        real(wp), intent(out) :: x(0:1)
        real(wp), intent(out) :: gradient(n_local)
        real(wp) :: a_c(3), a_s(3), d_c(3), d_s(3), torque(3), its(0:2), gradients(n_local, 0:2), c, s, inv_z
        logical :: is_plain

        is_plain = self%kind == is_angle .or. self%kind == is_elevation
        if (is_plain) is_plain = .not. (is_planar(self, pose) .or. self%one%is_point .or. self%other%is_point)
        if (.not. is_plain) then
            call differentiate_coordinate(self, pose, 1, 0, its, gradients)
            x = its(0:1)
            gradient = gradients(:, 0)
            return
        end if
        associate (first => pose(self%first), second => pose(self%second), one => self%one, other => self%other)
            a_c = turned(first, 0, one%a)
            a_s = turned(first, 0, other%a)
            d_c = turned(second, 0, one%b)
            d_s = turned(second, 0, other%b)
            c = dot3(a_c, d_c)
            s = dot3(a_s, d_s)
            ! Rotating the second body has the opposite effect of rotating the first: x_q pd is `torque` times 2 E pd/(p'p).
            if (self%kind == is_elevation) then
                torque = cross(d_c, a_c)
                s = sqrt(dot3(torque, torque))
                x(0) = atan2(c, s)
                torque = torque/s
            else
                x(0) = atan2(s, c)
                x(0) = x(0) + 2*pi*anint((self%last - x(0))/(2*pi))
                if (.not. self%waits) self%last = x(0)
                inv_z = 1/(c**2 + s**2)
                torque = c*inv_z*cross(d_s, a_s) - s*inv_z*cross(d_c, a_c)
            end if
            x(0) = x(0) - self%offset
            x(1) = 0.0_wp
            gradient = 0.0_wp
            if (first%n_turn > 0) then
                gradient(turn_1 + 1:turn_1 + 4) = turn_gradient(first%p(:, 0), -torque)
                x(1) = sum(gradient(turn_1 + 1:turn_1 + 4)*first%p(:, 1))
            end if
            if (second%n_turn > 0) then
                gradient(turn_2 + 1:turn_2 + 4) = turn_gradient(second%p(:, 0), torque)
                x(1) = x(1) + sum(gradient(turn_2 + 1:turn_2 + 4)*second%p(:, 1))
            end if
        end associate
    end subroutine find_slope

    !> force := force - f x_q.
    pure subroutine subtract_force(coordinate, pose, f, gradient, force)
        type(coordinate_type), intent(in) :: coordinate
        type(pose_type), intent(in) :: pose(0:)
        real(wp), intent(in) :: f, gradient(n_local)
        real(wp), intent(inout) :: force(:)

        call subtract_on_body(pose(coordinate%first), f, gradient(place_1 + 1:place_2), force)
        call subtract_on_body(pose(coordinate%second), f, gradient(place_2 + 1:), force)
    end subroutine subtract_force

    !> force := force - f x_q for the coordinates of one body.
    pure subroutine subtract_on_body(pose, f, gradient, force)
        type(pose_type), intent(in) :: pose
        !> Gradient x_q of one body: three entries for its position, then four for its rotation.
        real(wp), intent(in) :: f, gradient(7)
        real(wp), intent(inout) :: force(:)
        integer :: k

        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do k = 1, pose%n_place
            force(pose%place + k - 1) = force(pose%place + k - 1) - f*gradient(k)
        end do
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do k = 1, pose%n_turn
            force(pose%turn + k - 1) = force(pose%turn + k - 1) - f*gradient(3 + k)
        end do
    end subroutine subtract_on_body

    !> Move the pose of a sliding part, -i until its number is known, behind those of the bodies.
    pure subroutine number_slide(self, n_bodies)
        type(coordinate_type), intent(inout) :: self
        integer, intent(in) :: n_bodies

        if (self%second < 0) self%second = n_bodies - self%second
        if (self%one%second < 0) self%one%second = n_bodies - self%one%second
    end subroutine number_slide

    !> True for a coordinate measured in radians.
    pure logical function is_rotation(self)
        type(coordinate_type), intent(in) :: self

        is_rotation = any(self%kind == [is_angle, is_elevation, is_tilt])
    end function is_rotation

    !> Gradient 2 E(p)'n/(p'p) of the angle of rotation about n: the scalar product of n and the angular velocity is this row times
    !> pd.
    pure function turn_gradient(p, n) result(row)
        real(wp), intent(in) :: p(4), n(3)
        real(wp) :: row(4)

        row = 2/(p(1)**2 + p(2)**2 + p(3)**2 + p(4)**2)*e_transposed_product(p, n)
    end function turn_gradient

    !> True for an angle that is the difference of the angles of two planar bodies.
    pure logical function is_planar(self, pose)
        type(coordinate_type), intent(in) :: self
        type(pose_type), intent(in) :: pose(0:)

        is_planar = pose(self%first)%n_turn == 1 .or. pose(self%second)%n_turn == 1
    end function is_planar

    !> The k-th derivative of a.d.
    pure real(wp) function product_rate(a, d, k)
        real(wp), intent(in) :: a(3, 0:2), d(3, 0:2)
        integer, intent(in) :: k

        select case (k)
        case (0)
            product_rate = dot3(a(:, 0), d(:, 0))
        case (1)
            product_rate = dot3(a(:, 1), d(:, 0)) + dot3(a(:, 0), d(:, 1))
        case default
            product_rate = dot3(a(:, 2), d(:, 0)) + 2*dot3(a(:, 1), d(:, 1)) + dot3(a(:, 0), d(:, 2))
        end select
    end function product_rate

    pure real(wp) function dot3(x, y)
        real(wp), intent(in) :: x(3), y(3)

        dot3 = x(1)*y(1) + x(2)*y(2) + x(3)*y(3)
    end function dot3

    !> Value and gradient with derivatives along the motion, as far as the poses provide them; optionally the second gradient. If a
    !> distance is zero, its derivatives do not exist, and the results are not finite.
    pure subroutine differentiate_coordinate(self, pose, last, gradients, x, gradient, second, turns)
        type(coordinate_type), intent(inout) :: self
        type(pose_type), intent(in) :: pose(0:)
        !> Highest derivatives along the motion, of x and of its gradient, 0 to 2; -1 if the gradient is not needed.
        integer, intent(in) :: last, gradients
        !> x and its first and second derivatives.
        real(wp), intent(inout) :: x(0:2)
        !> x_q and its derivatives.
        real(wp), intent(inout) :: gradient(n_local, 0:2)
        real(wp), intent(out), optional :: second(n_local, n_local)
        !> Full revolutions of an angle in space. If present, x excludes them.
        real(wp), intent(out), optional :: turns
        real(wp) :: a(3, 0:2), d(3, 0:2)
        integer :: k

        if (present(turns)) turns = 0.0_wp
        select case (self%kind)
        case (is_distance)
            call differentiate_distance(self, pose, max(last, gradients), x, gradient, second)
        case (is_angle)
            if (present(turns)) then
                call measure_apart(self, pose, x(0), turns)
            else
                call measure(self, pose, x(0))
            end if
            if (is_planar(self, pose)) then
                x(1:2) = pose(self%second)%p(1, 1:2) - pose(self%first)%p(1, 1:2)
                gradient = 0.0_wp
                gradient(turn_1 + 1, 0) = -1.0_wp
                gradient(turn_2 + 1, 0) = 1.0_wp
                if (present(second)) second = 0.0_wp
            else
                call differentiate_angle(self, pose, last, gradients, x, gradient, second)
            end if
        case (is_tilt)
            call differentiate_tilt(self, pose, max(last, gradients), x, gradient, second)
        case (is_elevation)
            call differentiate_angle(self, pose, last, gradients, x, gradient, second)
        case default
            call set_vectors(self%one, pose, max(last, gradients), a, d)
            do k = 0, last
                x(k) = product_rate(a, d, k)
            end do
            x(0) = x(0) - self%offset
            call dot_gradient(self%one, pose, gradients, a, d, gradient)
            if (present(second)) call dot_second(self%one, pose, a, d, second)
        end select
    end subroutine differentiate_coordinate

    !> With w = d.d/2: l_q = w_q/l, and derivatives of l l_q = w_q along the motion; l_qq = (w_qq - l_q l_q')/l.
    pure subroutine differentiate_distance(self, pose, last, x, gradient, second)
        type(coordinate_type), intent(in) :: self
        type(pose_type), intent(in) :: pose(0:)
        integer, intent(in) :: last
        real(wp), intent(inout) :: x(0:2), gradient(n_local, 0:2)
        real(wp), intent(out), optional :: second(n_local, n_local)
        real(wp) :: d(3, 0:2), l(0:2)
        integer :: k

        l = 0.0_wp
        do k = 0, last
            d(:, k) = vector_between(self%vector, pose, k)
        end do
        l(0) = sqrt(dot3(d(:, 0), d(:, 0)))
        if (last > 0) l(1) = dot3(d(:, 0), d(:, 1))/l(0)
        if (last > 1) l(2) = (dot3(d(:, 1), d(:, 1)) + dot3(d(:, 0), d(:, 2)) - l(1)**2)/l(0)
        x = l
        x(0) = l(0) - self%offset
        call vector_gradient(self%vector, pose, last, d(:, 0:last), gradient(:, 0:last))
        gradient(:, 0) = gradient(:, 0)/l(0)
        if (last > 0) gradient(:, 1) = (gradient(:, 1) - l(1)*gradient(:, 0))/l(0)
        if (last > 1) gradient(:, 2) = (gradient(:, 2) - 2*l(1)*gradient(:, 1) - l(2)*gradient(:, 0))/l(0)
        if (.not. present(second)) return
        call vector_second(self%vector, pose, d(:, 0), second)
        call add_outer(-1.0_wp, gradient(:, 0), gradient(:, 0), second)
        second = second/l(0)
    end subroutine differentiate_distance

    !> With z = cosine + i sine the angle is Im ln z, its gradient Im(z_q/z), and (ln z)_qq = z_qq/z - z_q z_q'/z^2.
    pure subroutine differentiate_angle(self, pose, last, gradients, x, gradient, second)
        type(coordinate_type), intent(in) :: self
        type(pose_type), intent(in) :: pose(0:)
        integer, intent(in) :: last, gradients
        real(wp), intent(inout) :: x(0:2), gradient(n_local, 0:2)
        real(wp), intent(out), optional :: second(n_local, n_local)
        real(wp) :: c_q(n_local, 0:2), s_q(n_local, 0:2), c(0:2), s(0:2), c_qq(n_local, n_local), s_qq(n_local, n_local)
        real(wp) :: re(n_local), im(n_local)
        complex(wp) :: inv_z, rate, curve, factor
        integer :: n, j

        n = max(last, gradients)
        if (self%kind == is_elevation) then
            call differentiate_product(self%one, pose, n, gradients, present(second), s, s_q, s_qq)
            call differentiate_cosine(self, pose, n, gradients, present(second), c, c_q, c_qq)
            x(0) = atan2(s(0), c(0)) - self%offset
        else
            call differentiate_product(self%one, pose, n, gradients, present(second), c, c_q, c_qq)
            call differentiate_product(self%other, pose, n, gradients, present(second), s, s_q, s_qq)
        end if
        ! 1/z, z_t/z, z_tt/z.
        inv_z = 1/cmplx(c(0), s(0), wp)
        rate = cmplx(c(1), s(1), wp)*inv_z
        curve = cmplx(c(2), s(2), wp)*inv_z
        x(1) = aimag(rate)
        x(2) = aimag(curve - rate**2)
        if (gradients < 0) return
        ! z_q/z. Products are written out, because complex multiplication calls a library procedure that checks for infinities.
        re = real(inv_z)*c_q(:, 0) - aimag(inv_z)*s_q(:, 0)
        im = aimag(inv_z)*c_q(:, 0) + real(inv_z)*s_q(:, 0)
        gradient(:, 0) = im
        if (gradients > 0) gradient(:, 1) = (aimag(inv_z)*c_q(:, 1) + real(inv_z)*s_q(:, 1)) - (aimag(rate)*re + real(rate)*im)
        if (gradients > 1) then
            factor = 2*inv_z*rate
            gradient(:, 2) = (aimag(inv_z)*c_q(:, 2) + real(inv_z)*s_q(:, 2)) - (aimag(factor)*c_q(:, 1) + real(factor)*s_q(:, 1))
            factor = 2*rate**2 - curve
            gradient(:, 2) = gradient(:, 2) + (aimag(factor)*re + real(factor)*im)
        end if
        if (.not. present(second)) return
        do j = 1, n_local
            second(:, j) = (aimag(inv_z)*c_qq(:, j) + real(inv_z)*s_qq(:, j)) - (re*im(j) + im*re(j))
        end do
    end subroutine differentiate_angle

    !> Scalar product with its derivatives along the motion, its gradient, and the second gradient if it is needed.
    pure subroutine differentiate_product(product, pose, last, gradients, has_second, x, gradient, second)
        type(perpendicular_type), intent(in) :: product
        type(pose_type), intent(in) :: pose(0:)
        integer, intent(in) :: last, gradients
        logical, intent(in) :: has_second
        real(wp), intent(out) :: x(0:2)
        real(wp), intent(inout) :: gradient(n_local, 0:2), second(n_local, n_local)
        real(wp) :: a(3, 0:2), d(3, 0:2)
        integer :: k

        x = 0.0_wp
        call set_vectors(product, pose, last, a, d)
        do k = 0, last
            x(k) = product_rate(a, d, k)
        end do
        call dot_gradient(product, pose, gradients, a, d, gradient)
        if (has_second) call dot_second(product, pose, a, d, second)
    end subroutine differentiate_product

    !> Cosine of an elevation, the length of a vector of two scalar products: with w = (g^2 + h^2)/2, c_q = w_q/c, as for distances.
    !> Not finite at +-pi/2.
    pure subroutine differentiate_cosine(self, pose, last, gradients, has_second, c, c_q, c_qq)
        type(coordinate_type), intent(in) :: self
        type(pose_type), intent(in) :: pose(0:)
        integer, intent(in) :: last, gradients
        logical, intent(in) :: has_second
        real(wp), intent(out) :: c(0:2)
        real(wp), intent(inout) :: c_q(n_local, 0:2), c_qq(n_local, n_local)
        type(perpendicular_type) :: third
        real(wp) :: g(0:2), h(0:2), g_q(n_local, 0:2), h_q(n_local, 0:2), h_qq(n_local, n_local)

        third = self%other
        third%a = cross(self%other%a, self%one%a)
        call differentiate_product(self%other, pose, last, gradients, has_second, g, g_q, c_qq)
        call differentiate_product(third, pose, last, gradients, has_second, h, h_q, h_qq)
        c(0) = sqrt(g(0)**2 + h(0)**2)
        c(1) = (g(0)*g(1) + h(0)*h(1))/c(0)
        c(2) = (g(1)**2 + h(1)**2 + g(0)*g(2) + h(0)*h(2) - c(1)**2)/c(0)
        if (gradients < 0) return
        c_q(:, 0) = (g(0)*g_q(:, 0) + h(0)*h_q(:, 0))/c(0)
        if (gradients > 0) c_q(:, 1) = (g(1)*g_q(:, 0) + g(0)*g_q(:, 1) + h(1)*h_q(:, 0) + h(0)*h_q(:, 1) - c(1)*c_q(:, 0))/c(0)
        if (gradients > 1) c_q(:, 2) = (g(2)*g_q(:, 0) + 2*g(1)*g_q(:, 1) + g(0)*g_q(:, 2) + h(2)*h_q(:, 0) + 2*h(1)*h_q(:, 1) + &
            h(0)*h_q(:, 2) - 2*c(1)*c_q(:, 1) - c(2)*c_q(:, 0))/c(0)
        if (.not. has_second) return
        c_qq = g(0)*c_qq + h(0)*h_qq
        call add_outer(1.0_wp, g_q(:, 0), g_q(:, 0), c_qq)
        call add_outer(1.0_wp, h_q(:, 0), h_q(:, 0), c_qq)
        call add_outer(-1.0_wp, c_q(:, 0), c_q(:, 0), c_qq)
        c_qq = c_qq/c(0)
    end subroutine differentiate_cosine

    pure subroutine differentiate_tilt(self, pose, last, x, gradient, second)
        type(coordinate_type), intent(in) :: self
        type(pose_type), intent(in) :: pose(0:)
        integer, intent(in) :: last
        real(wp), intent(inout) :: x(0:2), gradient(n_local, 0:2)
        real(wp), intent(out), optional :: second(n_local, n_local)
        real(wp) :: a(3, 0:2), d(3, 0:2), its(n_local, 0:2), its_second(n_local, n_local)
        integer :: k

        call set_vectors(self%one, pose, last, a, d)
        do k = 0, last
            x(k) = product_rate(a, d, k)/2
        end do
        call dot_gradient(self%one, pose, last, a, d, gradient)
        if (present(second)) call dot_second(self%one, pose, a, d, second)
        call set_vectors(self%other, pose, last, a, d)
        do k = 0, last
            x(k) = x(k) - product_rate(a, d, k)/2
        end do
        x(0) = x(0) - self%offset
        call dot_gradient(self%other, pose, last, a, d, its)
        do k = 0, last
            gradient(:, k) = (gradient(:, k) - its(:, k))/2
        end do
        if (.not. present(second)) return
        call dot_second(self%other, pose, a, d, its_second)
        second = (second - its_second)/2
    end subroutine differentiate_tilt
end module tandem_mechanism_coordinate
