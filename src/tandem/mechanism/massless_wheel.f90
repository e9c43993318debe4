! SPDX-License-Identifier: MIT
!> Massless wheels: constraints of a wheel of negligible inertia on the body that carries it. The wheel touches a plane, does not
!> slip sideways, and rotates freely about its axle, which requires two rows and no coordinates. A function of time may steer it
!> about a line through its centre. It may slide along a strut of the body; its displacement is then a massless coordinate on which
!> springs act.
!>
!> Let a = A a'(t) be the axle, w = r + A (c' + x s') the centre with the direction s' of the strut, sigma = a.n, and g = sqrt(1 -
!> sigma^2). A wheel of radius R touches the plane at w - R (n - sigma a)/g, and its height is n.w - R g. Along the lateral
!> direction e = (a - sigma n)/g the contact point has the velocity V = e.w_t + R sigma_t, since the plane of the wheel rotates
!> about its heading by sigma_t/g. A round rim of section radius c adds -c n to the contact point and c sigma_t/g to V.
module tandem_mechanism_massless_wheel
    use tandem_kinds, only: wp
    use tandem_mechanism_velocity_joint, only: put_nonholonomic
    use tandem_mechanism_pair, only: add_block, columns, n_local, place_1, place_2, put_holonomic, turn_1
    use tandem_mechanism_pose, only: gradient_matrix, gradient_of, pose_type, second_gradient, turned
    use tandem_model_derivatives, only: derivatives_type, need_dynamics_q
    use tandem_model_terms, only: need_gamma, need_jacobian, need_nu, need_phi, terms_type
    implicit none (type, external)
    private

    public :: massless_wheel_type, find_contact_point, evaluate_massless_wheels, differentiate_massless_wheels

    !> Massless wheel on a body. It touches a plane, does not slip sideways, rotates freely, and may be steered and slide along a
    !> strut.
    type :: massless_wheel_type
        integer :: body = 0
        !> Rows of C: the height, and the lateral velocity.
        integer :: height_row = 0, row = 0
        !> Index of the pose that contains the displacement of the wheel, and index of this coordinate; 0 for a wheel without a
        !> strut.
        integer :: slide = 0, displacement = 0
        !> Radius of the centre line of the rim, and radius of the rim's cross section (0 for a sharp rim).
        real(wp) :: radius = 1.0_wp, crown = 0.0_wp
        !> Centre, axle, and direction of the strut, in the body frame.
        real(wp) :: centre(3) = 0.0_wp, axle(3) = 0.0_wp, along(3) = 0.0_wp
        !> Index of the function of time of the steering angle, 0 if none; component of the axle along the steering axis; the other
        !> component after a rotation by 90 degrees.
        integer :: steer = 0
        real(wp) :: fixed(3) = 0.0_wp, towards(3) = 0.0_wp
        !> Last steering angle, its cosine and its sine.
        real(wp) :: angle = 0.0_wp, cosine = 1.0_wp, sine = 0.0_wp
        !> Plane of contact: unit normal n, distance from the origin along n, and index of the function of time that raises it.
        real(wp) :: normal(3) = [0.0_wp, 0.0_wp, 1.0_wp], height = 0.0_wp
        integer :: rise = 0
    end type massless_wheel_type

    !> Axle and centre in the body frame with derivatives with respect to time; axle a and centre w in the world frame, and sigma,
    !> with derivatives along the motion.
    type :: geometry_type
        real(wp) :: axle(3, 0:2) = 0.0_wp, centre(3, 0:2) = 0.0_wp
        real(wp) :: a(3, 0:2) = 0.0_wp, w(3, 0:2) = 0.0_wp, sigma(0:2) = 0.0_wp
    end type geometry_type

    !> A wheel with a smaller g lies flat on the plane and has no contact point.
    real(wp), parameter :: flat = 1.0e-7_wp
    !> binomial(i, k) is the binomial coefficient k over i.
    real(wp), parameter :: binomial(0:2, 0:2) = reshape([1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, 1.0_wp, 0.0_wp, &
        1.0_wp, 2.0_wp, 1.0_wp], [3, 3])

contains

    !> Axle in the body frame, with its derivatives with respect to time.
    pure subroutine steer_axle(wheel, f, axle)
        type(massless_wheel_type), intent(inout) :: wheel
        !> Values and derivatives of the functions of time.
        real(wp), intent(in), contiguous :: f(0:, :)
        real(wp), intent(inout) :: axle(3, 0:2)
        real(wp) :: angle(0:2), across(3), rotated(3)

        if (wheel%steer == 0) then
            axle(:, 0) = wheel%axle
            axle(:, 1:2) = 0.0_wp
            return
        end if
        angle = f(:, wheel%steer)
        if (angle(0) < wheel%angle .or. angle(0) > wheel%angle) then
            wheel%angle = angle(0)
            wheel%cosine = cos(wheel%angle)
            wheel%sine = sin(wheel%angle)
        end if
        across = wheel%axle - wheel%fixed
        rotated = wheel%cosine*wheel%towards - wheel%sine*across
        across = wheel%cosine*across + wheel%sine*wheel%towards
        axle(:, 0) = wheel%fixed + across
        axle(:, 1) = angle(1)*rotated
        axle(:, 2) = angle(2)*rotated - angle(1)**2*across
    end subroutine steer_axle

    !> Axle and centre, with derivatives along the motion up to order `last`.
    pure subroutine find_geometry(wheel, body, slide, f, last, geometry)
        type(massless_wheel_type), intent(inout) :: wheel
        type(pose_type), intent(in) :: body, slide
        real(wp), intent(in), contiguous :: f(0:, :)
        integer, intent(in) :: last
        type(geometry_type), intent(inout) :: geometry
        integer :: k

        call steer_axle(wheel, f, geometry%axle)
        geometry%centre(:, 0) = wheel%centre + slide%r(1, 0)*wheel%along
        geometry%a(:, 0) = turned(body, 0, geometry%axle(:, 0))
        geometry%w(:, 0) = body%r(:, 0) + turned(body, 0, geometry%centre(:, 0))
        if (last > 0) then
            geometry%centre(:, 1) = slide%r(1, 1)*wheel%along
            geometry%centre(:, 2) = slide%r(1, 2)*wheel%along
            geometry%a(:, 1) = turned(body, 1, geometry%axle(:, 0)) + turned(body, 0, geometry%axle(:, 1))
            geometry%w(:, 1) = body%r(:, 1) + turned(body, 1, geometry%centre(:, 0)) + turned(body, 0, geometry%centre(:, 1))
            geometry%a(:, 2) = turned(body, 2, geometry%axle(:, 0)) + 2*turned(body, 1, geometry%axle(:, 1)) + &
                turned(body, 0, geometry%axle(:, 2))
            geometry%w(:, 2) = body%r(:, 2) + turned(body, 2, geometry%centre(:, 0)) + 2*turned(body, 1, geometry%centre(:, 1)) + &
                turned(body, 0, geometry%centre(:, 2))
        end if
        do k = 0, last
            geometry%sigma(k) = dot3(wheel%normal, geometry%a(:, k))
        end do
    end subroutine find_geometry

    !> Contact point of a wheel. Of the poses, only position and rotation need be set.
    pure subroutine find_contact_point(wheel, body, slide, f, contact)
        type(massless_wheel_type), intent(inout) :: wheel
        type(pose_type), intent(in) :: body, slide
        real(wp), intent(in), contiguous :: f(0:, :)
        real(wp), intent(out) :: contact(3)
        type(geometry_type) :: geometry

        call find_geometry(wheel, body, slide, f, 0, geometry)
        associate (n => wheel%normal, sigma => geometry%sigma(0))
            contact = geometry%w(:, 0) - wheel%radius/sqrt(1 - sigma**2)*(n - sigma*geometry%a(:, 0)) - wheel%crown*n
        end associate
    end subroutine find_contact_point

    !> Add the terms of both rows.
    pure subroutine evaluate_massless_wheels(wheels, need, pose, f, terms, stat)
        type(massless_wheel_type), intent(inout) :: wheels(:)
        integer, intent(in) :: need
        type(pose_type), intent(in) :: pose(0:)
        real(wp), intent(in), contiguous :: f(0:, :)
        type(terms_type), intent(inout) :: terms
        !> Set to 1 if a wheel lies flat on the plane.
        integer, intent(inout) :: stat
        type(geometry_type) :: geometry
        real(wp) :: v, u, v_sigma, weight, e(3), e1(3), rise(0:2), sigma_t
        integer :: i

        do i = 1, size(wheels)
            associate (wheel => wheels(i), body => pose(wheels(i)%body), slide => pose(wheels(i)%slide), n => wheels(i)%normal, &
                radius => wheels(i)%radius, sigma => geometry%sigma)
                call find_geometry(wheel, body, slide, f, merge(2, 0, iand(need, need_gamma) /= 0), geometry)
                if (.not. 1 - sigma(0)**2 > flat**2) then
                    stat = 1
                    return
                end if
                ! v = 1/g, u = sigma/g, and the coefficient of sigma_t in V.
                v = 1/sqrt(1 - sigma(0)**2)
                u = sigma(0)*v
                weight = radius + wheel%crown*v
                rise = 0.0_wp
                if (wheel%rise > 0) rise = f(:, wheel%rise)
                if (iand(need, need_phi) /= 0) terms%phi(wheel%height_row) = dot3(n, geometry%w(:, 0)) - radius/v - wheel%crown - &
                    wheel%height - rise(0)
                e = v*geometry%a(:, 0) - u*n
                if (iand(need, need_jacobian) /= 0) then
                    call put_entries(body, slide, wheel%height_row, n, gradient_of(body, 0, geometry%centre(:, 0) + &
                        radius*u*geometry%axle(:, 0), n), dot3(n, turned(body, 0, wheel%along)), terms%jacobian)
                    call put_entries(body, slide, wheel%row, e, gradient_of(body, 0, geometry%centre(:, 0), e) + &
                        weight*gradient_of(body, 0, geometry%axle(:, 0), n), dot3(e, turned(body, 0, wheel%along)), terms%jacobian)
                end if
                if (iand(need, need_nu) /= 0 .and. max(wheel%steer, wheel%rise) > 0) then
                    ! sigma_t at constant q.
                    sigma_t = dot3(n, turned(body, 0, geometry%axle(:, 1)))
                    terms%nu(wheel%height_row) = rise(1) - radius*u*sigma_t
                    terms%nu(wheel%row) = -weight*sigma_t
                end if
                if (iand(need, need_gamma) /= 0) then
                    v_sigma = sigma(0)*v**3
                    terms%gamma(wheel%height_row) = dot3(n, geometry%w(:, 2)) + radius*(u*sigma(2) + v**3*sigma(1)**2) - rise(2)
                    e1 = v*(geometry%a(:, 1) - sigma(1)*n) + v_sigma*sigma(1)*(geometry%a(:, 0) - sigma(0)*n)
                    terms%gamma(wheel%row) = dot3(e1, geometry%w(:, 1)) + dot3(e, geometry%w(:, 2)) + &
                        wheel%crown*v_sigma*sigma(1)**2 + weight*sigma(2)
                end if
            end associate
        end do
    end subroutine evaluate_massless_wheels

    !> Set a row of C.
    pure subroutine put_entries(body, slide, row, by_place, by_turn, by_slide, jacobian)
        type(pose_type), intent(in) :: body, slide
        integer, intent(in) :: row
        real(wp), intent(in) :: by_place(3), by_turn(4), by_slide
        real(wp), intent(inout) :: jacobian(:, :)
        integer :: k

        do k = 1, 3
            jacobian(row, body%place_column + k - 1) = by_place(k)
        end do
        do k = 1, 4
            jacobian(row, body%turn_column + k - 1) = by_turn(k)
        end do
        if (slide%place > 0) jacobian(row, slide%place_column) = by_slide
    end subroutine put_entries

    !> Add the requested gradient blocks: for the height as for any holonomic row; for V = E qd - e by V_q and the derivatives of E
    !> and V_q along the motion (section 15 of doc/theory.md). Let m be the velocity of the centre parallel to the plane; then V =
    !> m.a/g + k sigma_t with k = R + c/g.
    pure subroutine differentiate_massless_wheels(wheels, need, pose, f, lambda, derivatives)
        type(massless_wheel_type), intent(inout) :: wheels(:)
        integer, intent(in) :: need
        type(pose_type), intent(in) :: pose(0:)
        real(wp), intent(in), contiguous :: f(0:, :)
        real(wp), intent(in) :: lambda(:)
        type(derivatives_type), intent(inout) :: derivatives
        type(geometry_type) :: geometry
        real(wp) :: a_p(3, 4, 0:2), w_p(3, 4, 0:2), w_x(3, 0:2), s(4, 0:2), e(3, 0:1), m(3, 0:1), e_p(3, 4)
        real(wp) :: v(0:1), v_s(0:1), u(0:2), k(0:1), ma(0:1), gradient(n_local, 0:2), block(n_local, n_local), h(4, 4)
        real(wp) :: v_q(n_local), v_q_rate(n_local), e_rate(n_local)
        integer :: i, j, l, c(n_local)

        do i = 1, size(wheels)
            associate (wheel => wheels(i), body => pose(wheels(i)%body), slide => pose(wheels(i)%slide), n => wheels(i)%normal, &
                radius => wheels(i)%radius, crown => wheels(i)%crown, sigma => geometry%sigma, a => geometry%a)
                call find_geometry(wheel, body, slide, f, 2, geometry)
                c = columns(body, slide)
                a_p = 0.0_wp
                w_p = 0.0_wp
                do j = 0, 2
                    do l = 0, j
                        a_p(:, :, j) = a_p(:, :, j) + binomial(l, j)*gradient_matrix(body, j - l, geometry%axle(:, l))
                        w_p(:, :, j) = w_p(:, :, j) + binomial(l, j)*gradient_matrix(body, j - l, geometry%centre(:, l))
                    end do
                    w_x(:, j) = turned(body, j, wheel%along)
                    s(:, j) = matmul(n, a_p(:, :, j))
                end do
                ! v = 1/g, v_s its derivative with respect to sigma, u = sigma/g, and k, with derivatives along the motion.
                v(0) = 1/sqrt(1 - sigma(0)**2)
                v_s(0) = sigma(0)*v(0)**3
                v(1) = v_s(0)*sigma(1)
                v_s(1) = (v(0)**3 + 3*sigma(0)**2*v(0)**5)*sigma(1)
                u = [sigma(0)*v(0), v(0)**3*sigma(1), v(0)**3*sigma(2) + 3*sigma(0)*v(0)**5*sigma(1)**2]
                k = [radius + crown*v(0), crown*v(1)]

                gradient = 0.0_wp
                gradient(place_1 + 1:place_1 + 3, 0) = n
                do j = 0, 2
                    gradient(turn_1 + 1:turn_1 + 4, j) = matmul(n, w_p(:, :, j))
                    do l = 0, j
                        gradient(turn_1 + 1:turn_1 + 4, j) = gradient(turn_1 + 1:turn_1 + 4, j) + &
                            binomial(l, j)*radius*u(l)*s(:, j - l)
                    end do
                    gradient(place_2 + 1, j) = dot3(n, w_x(:, j))
                end do
                block = 0.0_wp
                h = second_gradient(body, geometry%centre(:, 0) + radius*u(0)*geometry%axle(:, 0), n)
                do j = 1, 4
                    h(:, j) = h(:, j) + radius*v(0)**3*s(j, 0)*s(:, 0)
                end do
                block(turn_1 + 1:turn_1 + 4, turn_1 + 1:turn_1 + 4) = h
                block(turn_1 + 1:turn_1 + 4, place_2 + 1) = gradient_of(body, 0, wheel%along, n)
                block(place_2 + 1, turn_1 + 1:turn_1 + 4) = block(turn_1 + 1:turn_1 + 4, place_2 + 1)
                call put_holonomic(need, wheel%height_row, c, gradient, block, lambda(wheel%height_row), derivatives)

                do j = 0, 1
                    m(:, j) = geometry%w(:, j + 1) - dot3(n, geometry%w(:, j + 1))*n
                end do
                e(:, 0) = v(0)*(a(:, 0) - sigma(0)*n)
                e(:, 1) = v(0)*(a(:, 1) - sigma(1)*n) + v(1)*(a(:, 0) - sigma(0)*n)
                ma = [dot3(m(:, 0), a(:, 0)), dot3(m(:, 1), a(:, 0)) + dot3(m(:, 0), a(:, 1))]
                v_q = 0.0_wp
                v_q_rate = 0.0_wp
                e_rate = 0.0_wp
                e_rate(place_1 + 1:place_1 + 3) = e(:, 1)
                e_rate(turn_1 + 1:turn_1 + 4) = matmul(e(:, 1), w_p(:, :, 0)) + matmul(e(:, 0), w_p(:, :, 1)) + k(1)*s(:, 0) + &
                    k(0)*s(:, 1)
                e_rate(place_2 + 1) = dot3(e(:, 1), w_x(:, 0)) + dot3(e(:, 0), w_x(:, 1))
                v_q(turn_1 + 1:turn_1 + 4) = v(0)*matmul(m(:, 0), a_p(:, :, 0)) + matmul(e(:, 0), w_p(:, :, 1)) + &
                    (ma(0) + crown*sigma(1))*v_s(0)*s(:, 0) + k(0)*s(:, 1)
                v_q(place_2 + 1) = dot3(e(:, 0), w_x(:, 1))
                v_q_rate(turn_1 + 1:turn_1 + 4) = matmul(v(1)*m(:, 0) + v(0)*m(:, 1), a_p(:, :, 0)) + &
                    v(0)*matmul(m(:, 0), a_p(:, :, 1)) + matmul(e(:, 1), w_p(:, :, 1)) + matmul(e(:, 0), w_p(:, :, 2)) + &
                    ((ma(1) + crown*sigma(2))*v_s(0) + (ma(0) + crown*sigma(1))*v_s(1))*s(:, 0) + &
                    ((ma(0) + crown*sigma(1))*v_s(0) + k(1))*s(:, 1) + k(0)*s(:, 2)
                v_q_rate(place_2 + 1) = dot3(e(:, 1), w_x(:, 1)) + dot3(e(:, 0), w_x(:, 2))
                call put_nonholonomic(need, wheel%row, c, v_q, v_q_rate, e_rate, derivatives)
                if (iand(need, need_dynamics_q) == 0) cycle

                ! Gradient of E = (e, e'w_p + k n'a_p, e'w_x).
                do j = 1, 4
                    e_p(:, j) = v(0)*(a_p(:, j, 0) - s(j, 0)*n) + v_s(0)*s(j, 0)*(a(:, 0) - sigma(0)*n)
                end do
                h = second_gradient(body, geometry%centre(:, 0), e(:, 0)) + k(0)*second_gradient(body, geometry%axle(:, 0), n) + &
                    matmul(transpose(w_p(:, :, 0)), e_p)
                do j = 1, 4
                    h(:, j) = h(:, j) + crown*v_s(0)*s(j, 0)*s(:, 0)
                end do
                block = 0.0_wp
                block(place_1 + 1:place_1 + 3, turn_1 + 1:turn_1 + 4) = e_p
                block(turn_1 + 1:turn_1 + 4, turn_1 + 1:turn_1 + 4) = h
                block(turn_1 + 1:turn_1 + 4, place_2 + 1) = gradient_of(body, 0, wheel%along, e(:, 0))
                block(place_2 + 1, turn_1 + 1:turn_1 + 4) = block(turn_1 + 1:turn_1 + 4, place_2 + 1) + matmul(w_x(:, 0), e_p)
                call add_block(c, derivatives%column_of(c), lambda(wheel%row), block, derivatives%dynamics_q)
            end associate
        end do
    end subroutine differentiate_massless_wheels

    pure real(wp) function dot3(x, y)
        real(wp), intent(in) :: x(3), y(3)

        dot3 = x(1)*y(1) + x(2)*y(2) + x(3)*y(3)
    end function dot3
end module tandem_mechanism_massless_wheel
