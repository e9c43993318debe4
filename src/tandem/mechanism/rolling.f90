! SPDX-License-Identifier: MIT
!> Nonholonomic elements: a knife edge (a wheel that does not slip sideways), and a disk with a sharp rim or a sphere that
!> rolls on a fixed plane.
!>
!> A row is V = E qd - e = 0. With V_q and the derivatives of E and V_q along the motion it gives all gradient blocks:
!> (C qd - nu)_q = V_q, (C qdd + gamma)_q = d/dt V_q, gamma_qd = V_q + d/dt E (section 15 of doc/theory.md).
!>
!> The disk of radius R, centre A s, axis a: with sigma = a.n and g = sqrt(1 - sigma^2) the way from r to the contact point is
!> y = A s - R (n/g - a sigma/g), the height n.r + n.A s - R g. The sphere has no axis: sigma = 0, g = 1. The point of the body in
!> contact is at rest: t.(rd + w x y) = 0 for the two tangents t of the plane, w = 2 E(p) pd.
module tandem_mechanism_rolling
    use tandem_kinds, only: wp
    use tandem_mechanism_pair, only: columns, n_local, put_holonomic, put_row, place_1, turn_1
    use tandem_mechanism_pose, only: gradient_matrix, gradient_of, pose_type, second_gradient, turned
    use tandem_mechanism_vector, only: cross
    use tandem_model_derivatives, only: derivatives_type, need_acceleration_q, need_acceleration_qd, need_dynamics_q, &
        need_velocity_q
    use tandem_model_terms, only: need_gamma, need_jacobian, need_phi, terms_type
    use tandem_rigid_euler_parameters, only: e_product, e_transposed_gradient, e_transposed_product, g_transposed_product, t_matrix
    implicit none (type, external)
    private

    public :: edge_type, evaluate_edges, differentiate_edges
    public :: roller_type, evaluate_rollers, differentiate_rollers

    !> The velocity of a point of a body along a direction of it (across the edge, along a wheel's axle) is zero.
    type :: edge_type
        integer :: body = 0
        !> The row of C.
        integer :: row = 0
        !> Point and direction in the body's frame, and their product s' x a'.
        real(wp) :: point(3) = 0.0_wp, across(3) = 0.0_wp, moment(3) = 0.0_wp
    end type edge_type

    !> A disk, or where `axis` is zero a sphere.
    type :: roller_type
        integer :: body = 0
        !> The row of the height, and the first of the two rows without slip.
        integer :: height_row = 0, row = 0
        real(wp) :: radius = 1.0_wp
        !> Centre and unit axis in the body's frame.
        real(wp) :: centre(3) = 0.0_wp, axis(3) = 0.0_wp
        !> Unit normal of the plane, two tangents, and the plane's distance from the origin along n.
        real(wp) :: normal(3) = [0.0_wp, 0.0_wp, 1.0_wp], height = 0.0_wp
        real(wp) :: tangent(3, 2) = reshape([1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, 0.0_wp], [3, 2])
    end type roller_type

    !> A disk whose g is smaller lies flat on the plane, and has no contact point.
    real(wp), parameter :: flat = 1.0e-7_wp

contains

    !> V = a.rd + 2 (s' x a').G(p) pd, in the plane a.rd + (s' x a')_z times the angle's rate.
    pure subroutine evaluate_edges(edges, need, pose, terms)
        type(edge_type), intent(in) :: edges(:)
        integer, intent(in) :: need
        type(pose_type), intent(in) :: pose(0:)
        type(terms_type), intent(inout) :: terms
        real(wp) :: a(3), e_p(4)
        integer :: i, k

        do i = 1, size(edges)
            associate (edge => edges(i), body => pose(edges(i)%body))
                if (iand(need, need_jacobian) /= 0) then
                    a = turned(body, 0, edge%across)
                    do k = 1, body%n_place
                        terms%jacobian(edge%row, body%place + k - 1) = a(k)
                    end do
                    e_p = turning_part(body, 0, edge%moment)
                    do k = 1, body%n_turn
                        terms%jacobian(edge%row, body%turn + k - 1) = e_p(k)
                    end do
                end if
                if (iand(need, need_gamma) /= 0) then
                    ! G(pd) pd = 0.
                    a = turned(body, 1, edge%across)
                    terms%gamma(edge%row) = a(1)*body%r(1, 1) + a(2)*body%r(2, 1) + a(3)*body%r(3, 1)
                end if
            end associate
        end do
    end subroutine evaluate_edges

    !> The k-th derivative along the motion of what a moment in the body's frame multiplies in the rates of the rotation.
    pure function turning_part(body, k, moment) result(part)
        type(pose_type), intent(in) :: body
        integer, intent(in) :: k
        real(wp), intent(in) :: moment(3)
        real(wp) :: part(4)

        part = 0.0_wp
        if (body%n_turn == 4) then
            part = 2*g_transposed_product(body%p(:, k), moment)
        else if (k == 0) then
            part(1) = moment(3)
        end if
    end function turning_part

    pure subroutine differentiate_edges(edges, need, pose, lambda, derivatives)
        type(edge_type), intent(in) :: edges(:)
        integer, intent(in) :: need
        type(pose_type), intent(in) :: pose(0:)
        real(wp), intent(in) :: lambda(:)
        type(derivatives_type), intent(inout) :: derivatives
        real(wp) :: v_q(n_local), v_q_rate(n_local), e_rate(n_local), b(3, 4), h(4, 4)
        integer :: c(n_local), i, j, k

        do i = 1, size(edges)
            associate (edge => edges(i), body => pose(edges(i)%body), d => derivatives%dynamics_q)
                c = columns(body, pose(0))
                v_q = 0.0_wp
                v_q_rate = 0.0_wp
                e_rate = 0.0_wp
                e_rate(place_1 + 1:place_1 + 3) = turned(body, 1, edge%across)
                e_rate(turn_1 + 1:turn_1 + 4) = turning_part(body, 1, edge%moment)
                associate (v_p => v_q(turn_1 + 1:turn_1 + 4), v_p_rate => v_q_rate(turn_1 + 1:turn_1 + 4))
                    v_p = gradient_of(body, 0, edge%across, body%r(:, 1))
                    v_p_rate = gradient_of(body, 1, edge%across, body%r(:, 1)) + gradient_of(body, 0, edge%across, body%r(:, 2))
                    if (body%n_turn == 4) then
                        v_p = v_p - turning_part(body, 1, edge%moment)
                        v_p_rate = v_p_rate - turning_part(body, 2, edge%moment)
                    end if
                end associate
                call put_nonholonomic(need, edge%row, c, v_q, v_q_rate, e_rate, derivatives)
                if (iand(need, need_dynamics_q) == 0) cycle
                b = lambda(edge%row)*gradient_matrix(body, 0, edge%across)
                h = 0.0_wp
                if (body%n_turn == 4) h = 2*lambda(edge%row)*t_matrix(edge%moment)
                do j = 1, body%n_turn
                    do k = 1, body%n_place
                        d(body%place + k - 1, body%turn + j - 1) = d(body%place + k - 1, body%turn + j - 1) + b(k, j)
                    end do
                    do k = 1, body%n_turn
                        d(body%turn + k - 1, body%turn + j - 1) = d(body%turn + k - 1, body%turn + j - 1) + h(k, j)
                    end do
                end do
            end associate
        end do
    end subroutine differentiate_edges

    !> The parts of a row in the three blocks of the constraints.
    pure subroutine put_nonholonomic(need, row, c, v_q, v_q_rate, e_rate, derivatives)
        integer, intent(in) :: need, row, c(n_local)
        real(wp), intent(in) :: v_q(n_local), v_q_rate(n_local), e_rate(n_local)
        type(derivatives_type), intent(inout) :: derivatives

        if (iand(need, need_velocity_q) /= 0) call put_row(c, v_q, row, derivatives%velocity_q)
        if (iand(need, need_acceleration_q) /= 0) call put_row(c, v_q_rate, row, derivatives%acceleration_q)
        if (iand(need, need_acceleration_qd) /= 0) call put_row(c, v_q + e_rate, row, derivatives%acceleration_qd)
    end subroutine put_nonholonomic

    !> The height and the two rows without slip.
    pure subroutine evaluate_rollers(rollers, need, pose, terms, stat)
        type(roller_type), intent(in) :: rollers(:)
        integer, intent(in) :: need
        type(pose_type), intent(in) :: pose(0:)
        type(terms_type), intent(inout) :: terms
        !> 1 for a disk that lies flat.
        integer, intent(inout) :: stat
        real(wp) :: a(3), s(3), n(3), y(3), a1(3), s1(3), y1(3), w(3), row(4), z(3)
        real(wp) :: sigma, sigma1, g, over, square, u
        integer :: i, k

        do i = 1, size(rollers)
            associate (roller => rollers(i), body => pose(rollers(i)%body), radius => rollers(i)%radius)
                n = roller%normal
                a = turned(body, 0, roller%axis)
                s = turned(body, 0, roller%centre)
                sigma = a(1)*n(1) + a(2)*n(2) + a(3)*n(3)
                square = 1 - sigma**2
                if (.not. square > flat**2) then
                    stat = 1
                    return
                end if
                g = sqrt(square)
                over = 1/g
                u = sigma*over
                if (iand(need, need_phi) /= 0) then
                    y = body%r(:, 0) + s
                    terms%phi(roller%height_row) = n(1)*y(1) + n(2)*y(2) + n(3)*y(3) - radius*g - roller%height
                end if
                if (iand(need, need_jacobian + need_gamma) == 0) cycle
                y = s - radius*(over*n - u*a)
                if (iand(need, need_jacobian) /= 0) then
                    do k = 1, 3
                        terms%jacobian(roller%height_row, body%place + k - 1) = n(k)
                        terms%jacobian(roller%row, body%place + k - 1) = roller%tangent(k, 1)
                        terms%jacobian(roller%row + 1, body%place + k - 1) = roller%tangent(k, 2)
                    end do
                    ! n'B(p, s) + R u n'B(p, a), B being linear in what it turns.
                    z = roller%centre + radius*u*roller%axis
                    row = gradient_of(body, 0, z, n)
                    do k = 1, 4
                        terms%jacobian(roller%height_row, body%turn + k - 1) = row(k)
                    end do
                    row = 2*e_transposed_product(body%p(:, 0), cross(y, roller%tangent(:, 1)))
                    do k = 1, 4
                        terms%jacobian(roller%row, body%turn + k - 1) = row(k)
                    end do
                    row = 2*e_transposed_product(body%p(:, 0), cross(y, roller%tangent(:, 2)))
                    do k = 1, 4
                        terms%jacobian(roller%row + 1, body%turn + k - 1) = row(k)
                    end do
                end if
                if (iand(need, need_gamma) /= 0) then
                    a1 = turned(body, 1, roller%axis)
                    s1 = turned(body, 1, roller%centre)
                    sigma1 = a1(1)*n(1) + a1(2)*n(2) + a1(3)*n(3)
                    ! (1/g)_t = sigma sigma_t/g^3, (sigma/g)_t = sigma_t/g^3; 2 E(pd) pd = 0.
                    y1 = s1 - radius*(sigma1*over**3*(sigma*n - a) - u*a1)
                    w = 2*e_product(body%p(:, 0), body%p(:, 1))
                    z = cross(w, y1)
                    terms%gamma(roller%row) = sum(z*roller%tangent(:, 1))
                    terms%gamma(roller%row + 1) = sum(z*roller%tangent(:, 2))
                    z = turned(body, 2, roller%centre + radius*u*roller%axis)
                    terms%gamma(roller%height_row) = z(1)*n(1) + z(2)*n(2) + z(3)*n(3) + radius*sigma1**2*over**3
                end if
            end associate
        end do
    end subroutine evaluate_rollers

    pure subroutine differentiate_rollers(rollers, need, pose, lambda, derivatives)
        type(roller_type), intent(in) :: rollers(:)
        integer, intent(in) :: need
        type(pose_type), intent(in) :: pose(0:)
        real(wp), intent(in) :: lambda(:)
        type(derivatives_type), intent(inout) :: derivatives
        real(wp) :: n(3), a(3, 0:2), s(3, 0:1), y(3, 0:1), w(3, 0:1), q(3, 0:1), z(3, 0:1), b(4, 0:2)
        real(wp) :: b_a(3, 4), b_s(3, 4), y_p(3, 4)
        real(wp) :: sigma(0:2), u(0:2), v(0:1), u_s(0:1), v_s(0:1), kappa(0:1), over
        real(wp) :: gradient(n_local, 0:2), second(n_local, n_local), h(4, 4)
        real(wp) :: v_q(n_local), v_q_rate(n_local), e_rate(n_local)
        integer :: i, j, k, c(n_local)

        do i = 1, size(rollers)
            associate (roller => rollers(i), body => pose(rollers(i)%body), radius => rollers(i)%radius)
                n = roller%normal
                c = columns(body, pose(0))
                do k = 0, 2
                    a(:, k) = turned(body, k, roller%axis)
                    sigma(k) = dot_product(a(:, k), n)
                    b(:, k) = gradient_of(body, k, roller%axis, n)
                end do
                do k = 0, 1
                    s(:, k) = turned(body, k, roller%centre)
                end do
                ! u = sigma/g and v = 1/g, their derivatives with respect to sigma, and along the motion.
                over = 1/sqrt(1 - sigma(0)**2)
                u_s = [over**3, 3*sigma(0)*sigma(1)*over**5]
                v_s = [sigma(0)*over**3, sigma(1)*over**3 + 3*sigma(0)**2*sigma(1)*over**5]
                u = [sigma(0)*over, u_s(0)*sigma(1), u_s(0)*sigma(2) + u_s(1)*sigma(1)]
                v = [over, v_s(0)*sigma(1)]
                y(:, 0) = s(:, 0) - radius*(v(0)*n - u(0)*a(:, 0))
                y(:, 1) = s(:, 1) - radius*(v(1)*n - u(1)*a(:, 0) - u(0)*a(:, 1))
                w(:, 0) = 2*e_product(body%p(:, 0), body%p(:, 1))
                w(:, 1) = 2*e_product(body%p(:, 0), body%p(:, 2))

                gradient = 0.0_wp
                gradient(place_1 + 1:place_1 + 3, 0) = n
                do k = 0, 2
                    gradient(turn_1 + 1:turn_1 + 4, k) = gradient_of(body, k, roller%centre, n) + radius*u(0)*b(:, k)
                end do
                gradient(turn_1 + 1:turn_1 + 4, 1) = gradient(turn_1 + 1:turn_1 + 4, 1) + radius*u(1)*b(:, 0)
                gradient(turn_1 + 1:turn_1 + 4, 2) = gradient(turn_1 + 1:turn_1 + 4, 2) + radius*(2*u(1)*b(:, 1) + u(2)*b(:, 0))
                second = 0.0_wp
                h = second_gradient(body, roller%centre + radius*u(0)*roller%axis, n)
                do j = 1, 4
                    h(:, j) = h(:, j) + radius*u_s(0)*b(j, 0)*b(:, 0)
                end do
                second(turn_1 + 1:turn_1 + 4, turn_1 + 1:turn_1 + 4) = h
                call put_holonomic(need, roller%height_row, c, gradient, second, lambda(roller%height_row), derivatives)

                do j = 1, 2
                    associate (t => roller%tangent(:, j))
                        do k = 0, 1
                            z(:, k) = cross(y(:, k), t)
                            q(:, k) = cross(t, w(:, k))
                        end do
                        ! V = t.rd + w.(y x t), q = t x w: V_p = -2 E(pd)'z + q'y_p.
                        kappa(0) = v_s(0)*dot_product(q(:, 0), n) - u_s(0)*dot_product(q(:, 0), a(:, 0))
                        kappa(1) = v_s(1)*dot_product(q(:, 0), n) + v_s(0)*dot_product(q(:, 1), n) - &
                            u_s(1)*dot_product(q(:, 0), a(:, 0)) - &
                            u_s(0)*(dot_product(q(:, 1), a(:, 0)) + dot_product(q(:, 0), a(:, 1)))
                        v_q = 0.0_wp
                        v_q_rate = 0.0_wp
                        e_rate = 0.0_wp
                        v_q(turn_1 + 1:turn_1 + 4) = -2*e_transposed_product(body%p(:, 1), z(:, 0)) - radius*kappa(0)*b(:, 0) + &
                            gradient_of(body, 0, roller%centre + radius*u(0)*roller%axis, q(:, 0))
                        v_q_rate(turn_1 + 1:turn_1 + 4) = -2*e_transposed_product(body%p(:, 2), z(:, 0)) - &
                            2*e_transposed_product(body%p(:, 1), z(:, 1)) - radius*(kappa(1)*b(:, 0) + kappa(0)*b(:, 1)) + &
                            gradient_of(body, 0, roller%centre + radius*u(0)*roller%axis, q(:, 1)) + &
                            gradient_of(body, 1, roller%centre + radius*u(0)*roller%axis, q(:, 0)) + &
                            gradient_of(body, 0, radius*u(1)*roller%axis, q(:, 0))
                        e_rate(turn_1 + 1:turn_1 + 4) = 2*e_transposed_product(body%p(:, 1), z(:, 0)) + &
                            2*e_transposed_product(body%p(:, 0), z(:, 1))
                    end associate
                    call put_nonholonomic(need, roller%row + j - 1, c, v_q, v_q_rate, e_rate, derivatives)
                end do
                if (iand(need, need_dynamics_q) == 0) cycle

                ! (2 E(p)' (y x t))_p with t of both rows.
                associate (t => lambda(roller%row)*roller%tangent(:, 1) + lambda(roller%row + 1)*roller%tangent(:, 2))
                    b_a = gradient_matrix(body, 0, roller%axis)
                    b_s = gradient_matrix(body, 0, roller%centre)
                    h = 2*e_transposed_gradient(cross(y(:, 0), t))
                    do k = 1, 4
                        y_p(:, k) = b_s(:, k) - radius*((v_s(0)*n - u_s(0)*a(:, 0))*b(k, 0) - u(0)*b_a(:, k))
                        h(:, k) = h(:, k) + 2*e_transposed_product(body%p(:, 0), cross(y_p(:, k), t))
                    end do
                end associate
                do k = 1, 4
                    do j = 1, 4
                        derivatives%dynamics_q(body%turn + j - 1, body%turn + k - 1) = &
                            derivatives%dynamics_q(body%turn + j - 1, body%turn + k - 1) + h(j, k)
                    end do
                end do
            end associate
        end do
    end subroutine differentiate_rollers
end module tandem_mechanism_rolling
