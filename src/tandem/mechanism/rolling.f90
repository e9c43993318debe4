! SPDX-License-Identifier: MIT
!> Knife edges and rolling contact. A knife edge is a wheel that does not slip sideways. Disks with a sharp or a round rim, spheres
!> and ellipsoids roll without slip on a plane. Functions of time may raise the plane, rotate it about its normal, and slide it
!> within itself.
!>
!> A velocity-level row is V = E qd - e = 0. All its gradient blocks follow from V_q and from the derivatives of E and V_q along the
!> motion: (C qd - nu)_q = V_q, (C qdd + gamma)_q = d/dt V_q, gamma_qd = V_q + d/dt E (section 15 of doc/theory.md).
!>
!> Disk of radius R with the centre A s and the axis a relative to the centre of mass r: let sigma = a.n and g = sqrt(1 - sigma^2).
!> The vector from r to the contact point is y = A s - R (n/g - a sigma/g), and the height above the plane is n.r + n.A s - R g. A
!> round rim of section radius c adds -c n to y. A sphere has no axis: sigma = 0, g = 1. The contact point of an ellipsoid with the
!> semi-axes A is A^2 m/|A m| relative to its centre, where m is the downward normal in the body frame. The material point in
!> contact moves with the plane: t.(rd + w x y) = e for both tangents t of the plane, w = 2 E(p) pd.
module tandem_mechanism_rolling
    use tandem_kinds, only: wp
    use tandem_mechanism_velocity_joint, only: put_nonholonomic, angular_velocity, world_moment_row, body_moment_row
    use tandem_mechanism_pair, only: columns, n_local, put_holonomic, place_1, turn_1
    use tandem_mechanism_pose, only: gradient_matrix, gradient_of, pose_type, second_gradient, turned
    use tandem_mechanism_vector, only: cross
    use tandem_model_derivatives, only: derivatives_type, need_dynamics_q
    use tandem_model_terms, only: need_gamma, need_jacobian, need_nu, need_phi, terms_type
    use tandem_rigid_euler_parameters, only: c_matrix, e_product, e_transposed_gradient, e_transposed_product, t_matrix
    implicit none (type, external)
    private

    public :: knife_edge_type, evaluate_knife_edges, differentiate_knife_edges
    public :: roller_type, find_contact, evaluate_rollers, differentiate_rollers

    !> Knife edge: the velocity of a body-fixed point vanishes along a body-fixed direction (across the edge, along the axle of a
    !> wheel).
    type :: knife_edge_type
        integer :: body = 0
        !> Row of C.
        integer :: row = 0
        !> Point s' and direction a' in the body frame, and s' x a'.
        real(wp) :: point(3) = 0.0_wp, across(3) = 0.0_wp, moment(3) = 0.0_wp
        !> Index of the function of time of the steering angle, 0 if the direction is fixed in the body; the direction a' after a
        !> rotation by 90 degrees.
        integer :: steer = 0
        real(wp) :: towards(3) = 0.0_wp
        !> Last steering angle, its cosine and its sine.
        real(wp) :: angle = 0.0_wp, cosine = 1.0_wp, sine = 0.0_wp
    end type knife_edge_type

    !> Rolling body: a disk, a sphere (`axis` is zero), or an ellipsoid.
    type :: roller_type
        integer :: body = 0
        !> Rows of C: the height, and the first of the two no-slip rows.
        integer :: height_row = 0, row = 0
        !> Disk or sphere: radius of the centre line of the rim, and radius of the rim's cross section (0 for a sharp rim).
        !> Ellipsoid: squared semi-axes.
        real(wp) :: radius = 1.0_wp, crown = 0.0_wp, squares(3) = 1.0_wp
        logical :: is_ellipsoid = .false.
        !> Centre and unit axis in the body frame.
        real(wp) :: centre(3) = 0.0_wp, axis(3) = 0.0_wp
        !> Plane of contact: unit normal n, two tangents, and distance from the origin along n.
        real(wp) :: normal(3) = [0.0_wp, 0.0_wp, 1.0_wp], height = 0.0_wp
        real(wp) :: tangent(3, 2) = reshape([1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, 0.0_wp], [3, 2])
        !> Indices of the functions of time that raise, rotate and slide the plane, 0 if none; pivot of the rotation and direction
        !> of the sliding.
        integer :: rise = 0, rotation = 0, slide = 0
        real(wp) :: pivot(3) = 0.0_wp, along(3) = 0.0_wp
    end type roller_type

    !> A disk with a smaller g lies flat on the plane and has no contact point.
    real(wp), parameter :: flat = 1.0e-7_wp

contains

    !> Add the terms of knife edges: V = a.rd + 2 (s' x a').G(p) pd in space, V = a.rd + (s' x a')_z phid for the angle phi of a
    !> planar body.
    pure subroutine evaluate_knife_edges(knife_edges, need, pose, f, terms)
        type(knife_edge_type), intent(inout) :: knife_edges(:)
        integer, intent(in) :: need
        type(pose_type), intent(in) :: pose(0:)
        !> Values and derivatives of the functions of time.
        real(wp), intent(in), contiguous :: f(0:, :)
        type(terms_type), intent(inout) :: terms
        real(wp) :: a(3), e_p(4), across(3), moment(3), across_t(3), moment_t(3)
        integer :: i, k

        do i = 1, size(knife_edges)
            associate (edge => knife_edges(i), body => pose(knife_edges(i)%body))
                across = edge%across
                moment = edge%moment
                if (edge%steer > 0) call steer(edge, f, across, moment, across_t, moment_t)
                if (iand(need, need_jacobian) /= 0) then
                    a = turned(body, 0, across)
                    do k = 1, body%n_place
                        terms%jacobian(edge%row, body%place_column + k - 1) = a(k)
                    end do
                    e_p = body_moment_row(body, 0, moment)
                    do k = 1, body%n_turn
                        terms%jacobian(edge%row, body%turn_column + k - 1) = e_p(k)
                    end do
                end if
                if (iand(need, need_gamma) /= 0) then
                    ! G(pd) pd = 0.
                    a = turned(body, 1, across)
                    if (edge%steer > 0) a = a + turned(body, 0, across_t)
                    terms%gamma(edge%row) = a(1)*body%r(1, 1) + a(2)*body%r(2, 1) + a(3)*body%r(3, 1)
                    if (edge%steer == 0) cycle
                    e_p = body_moment_row(body, 0, moment_t)
                    do k = 1, body%n_turn
                        terms%gamma(edge%row) = terms%gamma(edge%row) + e_p(k)*body%p(k, 1)
                    end do
                end if
            end associate
        end do
    end subroutine evaluate_knife_edges

    !> Direction a' and moment s' x a' of a steered edge, with their derivatives with respect to time.
    pure subroutine steer(edge, f, across, moment, across_t, moment_t)
        type(knife_edge_type), intent(inout) :: edge
        real(wp), intent(in), contiguous :: f(0:, :)
        real(wp), intent(out) :: across(3), moment(3), across_t(3), moment_t(3)

        if (f(0, edge%steer) < edge%angle .or. f(0, edge%steer) > edge%angle) then
            edge%angle = f(0, edge%steer)
            edge%cosine = cos(edge%angle)
            edge%sine = sin(edge%angle)
        end if
        across = edge%cosine*edge%across + edge%sine*edge%towards
        across_t = f(1, edge%steer)*(edge%cosine*edge%towards - edge%sine*edge%across)
        moment = cross(edge%point, across)
        moment_t = cross(edge%point, across_t)
    end subroutine steer

    !> Add the requested gradient blocks of knife edges.
    pure subroutine differentiate_knife_edges(knife_edges, need, pose, f, lambda, derivatives)
        type(knife_edge_type), intent(inout) :: knife_edges(:)
        integer, intent(in) :: need
        type(pose_type), intent(in) :: pose(0:)
        real(wp), intent(in), contiguous :: f(0:, :)
        real(wp), intent(in) :: lambda(:)
        type(derivatives_type), intent(inout) :: derivatives
        real(wp) :: v_q(n_local), v_q_rate(n_local), e_rate(n_local), b(3, 4), h(4, 4)
        real(wp) :: across(3), moment(3), across_t(3), moment_t(3)
        integer :: c(n_local), i, j, k, l

        do i = 1, size(knife_edges)
            associate (edge => knife_edges(i), body => pose(knife_edges(i)%body), d => derivatives%dynamics_q)
                across = edge%across
                moment = edge%moment
                across_t = 0.0_wp
                moment_t = 0.0_wp
                if (edge%steer > 0) call steer(edge, f, across, moment, across_t, moment_t)
                c = columns(body, pose(0))
                v_q = 0.0_wp
                v_q_rate = 0.0_wp
                e_rate = 0.0_wp
                e_rate(place_1 + 1:place_1 + 3) = turned(body, 1, across) + turned(body, 0, across_t)
                e_rate(turn_1 + 1:turn_1 + 4) = body_moment_row(body, 1, moment) + body_moment_row(body, 0, moment_t)
                associate (v_p => v_q(turn_1 + 1:turn_1 + 4), v_p_rate => v_q_rate(turn_1 + 1:turn_1 + 4))
                    v_p = gradient_of(body, 0, across, body%r(:, 1))
                    v_p_rate = gradient_of(body, 1, across, body%r(:, 1)) + gradient_of(body, 0, across, body%r(:, 2)) + &
                        gradient_of(body, 0, across_t, body%r(:, 1))
                    if (body%n_turn == 4) then
                        v_p = v_p - body_moment_row(body, 1, moment)
                        v_p_rate = v_p_rate - body_moment_row(body, 2, moment) - body_moment_row(body, 1, moment_t)
                    end if
                end associate
                call put_nonholonomic(need, edge%row, c, v_q, v_q_rate, e_rate, derivatives)
                if (iand(need, need_dynamics_q) == 0) cycle
                b = lambda(edge%row)*gradient_matrix(body, 0, across)
                h = 0.0_wp
                if (body%n_turn == 4) h = 2*lambda(edge%row)*t_matrix(moment)
                do j = 1, body%n_turn
                    l = derivatives%column_of(body%turn + j - 1)
                    do k = 1, body%n_place
                        d(body%place + k - 1, l) = d(body%place + k - 1, l) + b(k, j)
                    end do
                    do k = 1, body%n_turn
                        d(body%turn + k - 1, l) = d(body%turn + k - 1, l) + h(k, j)
                    end do
                end do
            end associate
        end do
    end subroutine differentiate_knife_edges

    !> Vector from the centre of mass to the contact point. Of the pose, only position and rotation need be set.
    pure subroutine find_contact(roller, body, y)
        type(roller_type), intent(in) :: roller
        type(pose_type), intent(in) :: body
        real(wp), intent(out) :: y(3)
        real(wp) :: a(3), m(3), sigma, g

        if (roller%is_ellipsoid) then
            m = downward_normal(roller, body, 0)
            y = turned(body, 0, roller%centre + roller%squares*m/sqrt(sum(roller%squares*m**2)))
        else
            a = turned(body, 0, roller%axis)
            sigma = sum(a*roller%normal)
            g = sqrt(1 - sigma**2)
            y = turned(body, 0, roller%centre) - roller%radius/g*(roller%normal - sigma*a) - roller%crown*roller%normal
        end if
    end subroutine find_contact

    !> Downward normal of the plane in the body frame, or its k-th derivative along the motion.
    pure function downward_normal(roller, body, k) result(m)
        type(roller_type), intent(in) :: roller
        type(pose_type), intent(in) :: body
        integer, intent(in) :: k
        real(wp) :: m(3)
        integer :: i

        do i = 1, 3
            m(i) = -(body%a(1, i, k)*roller%normal(1) + body%a(2, i, k)*roller%normal(2) + body%a(3, i, k)*roller%normal(3))
        end do
    end function downward_normal

    !> Add the terms of rolling bodies: the height and the two no-slip rows.
    pure subroutine evaluate_rollers(rollers, need, pose, f, terms, stat)
        type(roller_type), intent(in) :: rollers(:)
        integer, intent(in) :: need
        type(pose_type), intent(in) :: pose(0:)
        !> Values and derivatives of the functions of time.
        real(wp), intent(in), contiguous :: f(0:, :)
        type(terms_type), intent(inout) :: terms
        !> Set to 1 if a disk lies flat on the plane.
        integer, intent(inout) :: stat
        real(wp) :: y(3), y1(3), lever(3), height_tt, w(3), row(4), z(3)
        integer :: i, k

        do i = 1, size(rollers)
            associate (roller => rollers(i), body => pose(rollers(i)%body), n => rollers(i)%normal)
                if (roller%is_ellipsoid) then
                    call contact_of_ellipsoid(roller, body, need, y, y1, lever, height_tt)
                else
                    call contact_of_disk(roller, body, need, y, y1, lever, height_tt, stat)
                    if (stat > 0) return
                end if
                if (iand(need, need_phi) /= 0) then
                    z = body%r(:, 0) + y
                    terms%phi(roller%height_row) = n(1)*z(1) + n(2)*z(2) + n(3)*z(3) - roller%height
                end if
                if (iand(need, need_jacobian) /= 0) then
                    do k = 1, 3
                        terms%jacobian(roller%height_row, body%place_column + k - 1) = n(k)
                        terms%jacobian(roller%row, body%place_column + k - 1) = roller%tangent(k, 1)
                        terms%jacobian(roller%row + 1, body%place_column + k - 1) = roller%tangent(k, 2)
                    end do
                    ! The contact point moves relative to the body only along the plane. Differentiate the height as if it were
                    ! fixed to the body.
                    row = gradient_of(body, 0, lever, n)
                    do k = 1, 4
                        terms%jacobian(roller%height_row, body%turn_column + k - 1) = row(k)
                    end do
                    row = 2*e_transposed_product(body%p(:, 0), cross(y, roller%tangent(:, 1)))
                    do k = 1, 4
                        terms%jacobian(roller%row, body%turn_column + k - 1) = row(k)
                    end do
                    row = 2*e_transposed_product(body%p(:, 0), cross(y, roller%tangent(:, 2)))
                    do k = 1, 4
                        terms%jacobian(roller%row + 1, body%turn_column + k - 1) = row(k)
                    end do
                end if
                if (iand(need, need_gamma) /= 0) then
                    ! 2 E(pd) pd = 0.
                    w = 2*e_product(body%p(:, 0), body%p(:, 1))
                    z = cross(w, y1)
                    terms%gamma(roller%row) = sum(z*roller%tangent(:, 1))
                    terms%gamma(roller%row + 1) = sum(z*roller%tangent(:, 2))
                    terms%gamma(roller%height_row) = height_tt
                end if
                if (roller%rise + roller%rotation + roller%slide > 0) call add_plane(roller, need, body, f, y, y1, terms)
            end associate
        end do
    end subroutine evaluate_rollers

    !> Contact point and height of a disk or a sphere.
    pure subroutine contact_of_disk(roller, body, need, y, y1, lever, height_tt, stat)
        type(roller_type), intent(in) :: roller
        type(pose_type), intent(in) :: body
        integer, intent(in) :: need
        !> Vector from the centre of mass to the contact point in the world frame, and its rate. Body-fixed vector to the point
        !> whose motion gives the gradient of the height. Second derivative of the height for qdd = 0. The rate and the second
        !> derivative are set only if gamma is requested.
        real(wp), intent(out) :: y(3)
        real(wp), intent(inout) :: y1(3), lever(3), height_tt
        integer, intent(inout) :: stat
        real(wp) :: a(3), a1(3), z(3), sigma, sigma1, inverse_g, square, u

        associate (n => roller%normal, radius => roller%radius)
            a = turned(body, 0, roller%axis)
            sigma = a(1)*n(1) + a(2)*n(2) + a(3)*n(3)
            square = 1 - sigma**2
            if (.not. square > flat**2) then
                stat = 1
                y = 0.0_wp
                return
            end if
            inverse_g = 1/sqrt(square)
            u = sigma*inverse_g
            y = turned(body, 0, roller%centre) - radius*(inverse_g*n - u*a) - roller%crown*n
            lever = roller%centre + radius*u*roller%axis
            if (iand(need, need_gamma) == 0) return
            a1 = turned(body, 1, roller%axis)
            sigma1 = a1(1)*n(1) + a1(2)*n(2) + a1(3)*n(3)
            ! (1/g)_t = sigma sigma_t/g^3, (sigma/g)_t = sigma_t/g^3.
            y1 = turned(body, 1, roller%centre) - radius*(sigma1*inverse_g**3*(sigma*n - a) - u*a1)
            z = turned(body, 2, lever)
            height_tt = z(1)*n(1) + z(2)*n(2) + z(3)*n(3) + radius*sigma1**2*inverse_g**3
        end associate
    end subroutine contact_of_disk

    !> Contact point and height of an ellipsoid: the point is at A^2 m/g from the centre, with the semi-axes A, the downward normal
    !> m in the body frame, and g = |A m|.
    pure subroutine contact_of_ellipsoid(roller, body, need, y, y1, lever, height_tt)
        type(roller_type), intent(in) :: roller
        type(pose_type), intent(in) :: body
        integer, intent(in) :: need
        real(wp), intent(out) :: y(3)
        real(wp), intent(inout) :: y1(3), lever(3), height_tt
        real(wp) :: m(3), m1(3), m2(3), s(3), g, g1, z(3)

        associate (n => roller%normal, squares => roller%squares)
            m = downward_normal(roller, body, 0)
            g = sqrt(squares(1)*m(1)**2 + squares(2)*m(2)**2 + squares(3)*m(3)**2)
            s = squares*m/g
            lever = roller%centre + s
            y = turned(body, 0, lever)
            if (iand(need, need_gamma) == 0) return
            m1 = downward_normal(roller, body, 1)
            m2 = downward_normal(roller, body, 2)
            g1 = s(1)*m1(1) + s(2)*m1(2) + s(3)*m1(3)
            y1 = turned(body, 1, lever) + turned(body, 0, (squares*m1 - g1*s)/g)
            ! The height above the plane is n.A s - g, plus terms that are linear in r.
            z = turned(body, 2, roller%centre)
            height_tt = n(1)*z(1) + n(2)*z(2) + n(3)*z(3) - (sum(squares*m1**2) - g1**2)/g - sum(s*m2)
        end associate
    end subroutine contact_of_ellipsoid

    !> Add the motion of the plane, whose point in contact has the velocity e along the tangents.
    pure subroutine add_plane(roller, need, body, f, y, y1, terms)
        type(roller_type), intent(in) :: roller
        integer, intent(in) :: need
        type(pose_type), intent(in) :: body
        real(wp), intent(in), contiguous :: f(0:, :)
        real(wp), intent(in) :: y(3), y1(3)
        type(terms_type), intent(inout) :: terms
        real(wp) :: rise(0:2), angle(0:2), slide(0:2), offset(3), offset_rate(3), across(3)
        integer :: j

        call plane_motion(roller, f, rise, angle, slide)
        if (iand(need, need_phi) /= 0) terms%phi(roller%height_row) = terms%phi(roller%height_row) - rise(0)
        if (iand(need, need_nu) /= 0) terms%nu(roller%height_row) = rise(1)
        if (iand(need, need_gamma) /= 0) terms%gamma(roller%height_row) = terms%gamma(roller%height_row) - rise(2)
        offset = body%r(:, 0) + y - roller%pivot - slide(0)*roller%along
        do j = 1, 2
            associate (t => roller%tangent(:, j), row => roller%row + j - 1)
                across = cross(t, roller%normal)
                if (iand(need, need_nu) /= 0) terms%nu(row) = angle(1)*sum(across*offset) + slide(1)*sum(t*roller%along)
                if (iand(need, need_gamma) /= 0) then
                    offset_rate = body%r(:, 1) + y1 - slide(1)*roller%along
                    terms%gamma(row) = terms%gamma(row) - angle(2)*sum(across*offset) - angle(1)*sum(across*offset_rate) - &
                        slide(2)*sum(t*roller%along)
                end if
            end associate
        end do
    end subroutine add_plane

    !> Displacement, rotation angle and sliding of the plane, each with two derivatives; zero without a function.
    pure subroutine plane_motion(roller, f, rise, angle, slide)
        type(roller_type), intent(in) :: roller
        real(wp), intent(in), contiguous :: f(0:, :)
        real(wp), intent(out) :: rise(0:2), angle(0:2), slide(0:2)

        rise = 0.0_wp
        angle = 0.0_wp
        slide = 0.0_wp
        if (roller%rise > 0) rise = f(:, roller%rise)
        if (roller%rotation > 0) angle = f(:, roller%rotation)
        if (roller%slide > 0) slide = f(:, roller%slide)
    end subroutine plane_motion

    !> Add the requested gradient blocks of rolling bodies. With z = y x t and q = t x w, the row V = t.rd + w.(y x t) - e has the
    !> gradient V_p = -2 E(pd)'z + y_p'q, plus the terms of a moving plane.
    pure subroutine differentiate_rollers(rollers, need, pose, f, lambda, derivatives)
        type(roller_type), intent(in) :: rollers(:)
        integer, intent(in) :: need
        type(pose_type), intent(in) :: pose(0:)
        real(wp), intent(in), contiguous :: f(0:, :)
        real(wp), intent(in) :: lambda(:)
        type(derivatives_type), intent(inout) :: derivatives
        real(wp) :: y(3, 0:1), y_p(3, 4, 0:1), w(3, 0:1), q(3, 0:1), z(3, 0:1), across(3), height_p(4, 0:2)
        real(wp) :: gradient(n_local, 0:2), second(n_local, n_local), h(4, 4)
        real(wp) :: v_q(n_local), v_q_rate(n_local), e_rate(n_local), rise(0:2), angle(0:2), slide(0:2)
        integer :: i, j, k, c(n_local)

        do i = 1, size(rollers)
            associate (roller => rollers(i), body => pose(rollers(i)%body))
                c = columns(body, pose(0))
                gradient = 0.0_wp
                gradient(place_1 + 1:place_1 + 3, 0) = roller%normal
                second = 0.0_wp
                if (roller%is_ellipsoid) then
                    call differentiate_ellipsoid(roller, body, y, y_p, height_p, h)
                else
                    call differentiate_disk(roller, body, y, y_p, height_p, h)
                end if
                gradient(turn_1 + 1:turn_1 + 4, :) = height_p
                second(turn_1 + 1:turn_1 + 4, turn_1 + 1:turn_1 + 4) = h
                call put_holonomic(need, roller%height_row, c, gradient, second, lambda(roller%height_row), derivatives)
                call plane_motion(roller, f, rise, angle, slide)
                do k = 0, 1
                    w(:, k) = angular_velocity(body, k)
                end do
                do j = 1, 2
                    associate (t => roller%tangent(:, j))
                        do k = 0, 1
                            z(:, k) = cross(y(:, k), t)
                            q(:, k) = cross(t, w(:, k))
                        end do
                        across = cross(t, roller%normal)
                        v_q = 0.0_wp
                        v_q_rate = 0.0_wp
                        e_rate = 0.0_wp
                        v_q(place_1 + 1:place_1 + 3) = -angle(1)*across
                        v_q_rate(place_1 + 1:place_1 + 3) = -angle(2)*across
                        q(:, 0) = q(:, 0) - angle(1)*across
                        q(:, 1) = q(:, 1) - angle(2)*across
                        v_q(turn_1 + 1:turn_1 + 4) = -world_moment_row(body, 1, z(:, 0)) + matmul(q(:, 0), y_p(:, :, 0))
                        v_q_rate(turn_1 + 1:turn_1 + 4) = -world_moment_row(body, 2, z(:, 0)) - &
                            world_moment_row(body, 1, z(:, 1)) + &
                            matmul(q(:, 1), y_p(:, :, 0)) + matmul(q(:, 0), y_p(:, :, 1))
                        e_rate(turn_1 + 1:turn_1 + 4) = world_moment_row(body, 1, z(:, 0)) + world_moment_row(body, 0, z(:, 1))
                    end associate
                    call put_nonholonomic(need, roller%row + j - 1, c, v_q, v_q_rate, e_rate, derivatives)
                end do
                if (iand(need, need_dynamics_q) == 0) cycle

                ! (2 E(p)'(y x t))_p for the sum t of both tangents, each times its multiplier.
                associate (t => lambda(roller%row)*roller%tangent(:, 1) + lambda(roller%row + 1)*roller%tangent(:, 2))
                    h = 2*e_transposed_gradient(cross(y(:, 0), t))
                    do k = 1, 4
                        h(:, k) = h(:, k) + world_moment_row(body, 0, cross(y_p(:, k, 0), t))
                    end do
                end associate
                do k = 1, 4
                    associate (column => derivatives%column_of(body%turn + k - 1))
                        do j = 1, 4
                            derivatives%dynamics_q(body%turn + j - 1, column) = &
                                derivatives%dynamics_q(body%turn + j - 1, column) + h(j, k)
                        end do
                    end associate
                end do
            end associate
        end do
    end subroutine differentiate_rollers

    !> Contact point and height of a disk or a sphere, with gradients.
    pure subroutine differentiate_disk(roller, body, y, y_p, gradient, second)
        type(roller_type), intent(in) :: roller
        type(pose_type), intent(in) :: body
        !> Vector from the centre of mass to the contact point and its gradient, each with its derivative along the motion.
        real(wp), intent(out) :: y(3, 0:1), y_p(3, 4, 0:1)
        !> Gradient of the height with respect to p with two derivatives along the motion, and its second gradient.
        real(wp), intent(out) :: gradient(4, 0:2), second(4, 4)
        real(wp) :: a(3, 0:2), b(4, 0:2), b_a(3, 4, 0:1), b_s(3, 4, 0:1), sigma(0:2), u(0:2), v(0:1), u_s(0:1), v_s(0:1), inverse_g
        integer :: k

        associate (n => roller%normal, radius => roller%radius)
            do k = 0, 2
                a(:, k) = turned(body, k, roller%axis)
                sigma(k) = sum(a(:, k)*n)
                b(:, k) = gradient_of(body, k, roller%axis, n)
            end do
            ! u = sigma/g and v = 1/g with their derivatives along the motion; u_s and v_s are their derivatives with respect to
            ! sigma.
            inverse_g = 1/sqrt(1 - sigma(0)**2)
            u_s = [inverse_g**3, 3*sigma(0)*sigma(1)*inverse_g**5]
            v_s = [sigma(0)*inverse_g**3, sigma(1)*inverse_g**3 + 3*sigma(0)**2*sigma(1)*inverse_g**5]
            u = [sigma(0)*inverse_g, u_s(0)*sigma(1), u_s(0)*sigma(2) + u_s(1)*sigma(1)]
            v = [inverse_g, v_s(0)*sigma(1)]
            y(:, 0) = turned(body, 0, roller%centre) - radius*(v(0)*n - u(0)*a(:, 0)) - roller%crown*n
            y(:, 1) = turned(body, 1, roller%centre) - radius*(v(1)*n - u(1)*a(:, 0) - u(0)*a(:, 1))
            do k = 0, 1
                b_a(:, :, k) = gradient_matrix(body, k, roller%axis)
                b_s(:, :, k) = gradient_matrix(body, k, roller%centre)
            end do
            do k = 1, 4
                y_p(:, k, 0) = b_s(:, k, 0) - radius*((v_s(0)*n - u_s(0)*a(:, 0))*b(k, 0) - u(0)*b_a(:, k, 0))
                y_p(:, k, 1) = b_s(:, k, 1) - radius*((v_s(1)*n - u_s(1)*a(:, 0) - u_s(0)*a(:, 1))*b(k, 0) + &
                    (v_s(0)*n - u_s(0)*a(:, 0))*b(k, 1) - u(1)*b_a(:, k, 0) - u(0)*b_a(:, k, 1))
            end do
            do k = 0, 2
                gradient(:, k) = gradient_of(body, k, roller%centre, n) + radius*u(0)*b(:, k)
            end do
            gradient(:, 1) = gradient(:, 1) + radius*u(1)*b(:, 0)
            gradient(:, 2) = gradient(:, 2) + radius*(2*u(1)*b(:, 1) + u(2)*b(:, 0))
            second = second_gradient(body, roller%centre + radius*u(0)*roller%axis, n)
            do k = 1, 4
                second(:, k) = second(:, k) + radius*u_s(0)*b(k, 0)*b(:, 0)
            end do
        end associate
    end subroutine differentiate_disk

    !> Contact point and height of an ellipsoid, with gradients. The gradient of the height is C'x with x = s + A^2 m/g and C =
    !> (A(p)'n)_p, as if x were constant.
    pure subroutine differentiate_ellipsoid(roller, body, y, y_p, gradient, second)
        type(roller_type), intent(in) :: roller
        type(pose_type), intent(in) :: body
        real(wp), intent(out) :: y(3, 0:1), y_p(3, 4, 0:1), gradient(4, 0:2), second(4, 4)
        real(wp) :: m(3, 0:2), c(3, 4, 0:2), s(3, 0:2), x(3), s_p(3, 4, 0:1), g(0:2), g_p(4, 0:1)
        integer :: k

        associate (squares => roller%squares, n => roller%normal)
            do k = 0, 2
                m(:, k) = downward_normal(roller, body, k)
                c(:, :, k) = c_matrix(body%p(:, k), n)
            end do
            g(0) = sqrt(sum(squares*m(:, 0)**2))
            g(1) = sum(squares*m(:, 0)*m(:, 1))/g(0)
            g(2) = (sum(squares*m(:, 1)**2) + sum(squares*m(:, 0)*m(:, 2)) - g(1)**2)/g(0)
            ! Derivatives of g s = A^2 m, with m_p = -C.
            s(:, 0) = squares*m(:, 0)/g(0)
            s(:, 1) = (squares*m(:, 1) - g(1)*s(:, 0))/g(0)
            s(:, 2) = (squares*m(:, 2) - 2*g(1)*s(:, 1) - g(2)*s(:, 0))/g(0)
            g_p(:, 0) = -matmul(s(:, 0), c(:, :, 0))
            g_p(:, 1) = -matmul(s(:, 1), c(:, :, 0)) - matmul(s(:, 0), c(:, :, 1))
            do k = 1, 4
                s_p(:, k, 0) = (-squares*c(:, k, 0) - g_p(k, 0)*s(:, 0))/g(0)
                s_p(:, k, 1) = (-squares*c(:, k, 1) - g_p(k, 1)*s(:, 0) - g_p(k, 0)*s(:, 1) - g(1)*s_p(:, k, 0))/g(0)
            end do
            x = roller%centre + s(:, 0)
            y(:, 0) = turned(body, 0, x)
            y(:, 1) = turned(body, 1, x) + turned(body, 0, s(:, 1))
            y_p(:, :, 0) = gradient_matrix(body, 0, x)
            y_p(:, :, 1) = gradient_matrix(body, 1, x) + gradient_matrix(body, 0, s(:, 1))
            do k = 1, 4
                y_p(:, k, 0) = y_p(:, k, 0) + turned(body, 0, s_p(:, k, 0))
                y_p(:, k, 1) = y_p(:, k, 1) + turned(body, 1, s_p(:, k, 0)) + turned(body, 0, s_p(:, k, 1))
            end do
            gradient(:, 0) = matmul(x, c(:, :, 0))
            gradient(:, 1) = matmul(x, c(:, :, 1)) + matmul(s(:, 1), c(:, :, 0))
            gradient(:, 2) = matmul(x, c(:, :, 2)) + 2*matmul(s(:, 1), c(:, :, 1)) + matmul(s(:, 2), c(:, :, 0))
            second = second_gradient(body, x, n) + matmul(transpose(c(:, :, 0)), s_p(:, :, 0))
        end associate
    end subroutine differentiate_ellipsoid
end module tandem_mechanism_rolling
