! SPDX-License-Identifier: MIT
!> Forces: spring-dampers between two points, torsional ones about an axis, and given forces and torques on a body.
!>
!> The first two act along a scalar coordinate x (length, angle) with f = k (x - x0) + c xd + u(t), as the generalised force -f x_q.
module tandem_mechanism_force
    use tandem_kinds, only: wp
    use tandem_mechanism_dot, only: dot_curve, dot_gradient, dot_second, dot_type
    use tandem_mechanism_pair, only: add_outer, columns, n_local, put_force
    use tandem_mechanism_pose, only: gradient_matrix, gradient_of, pose_type, second_gradient, turned
    use tandem_mechanism_span, only: span_gradient, span_second, span_type, span_way
    use tandem_model_derivatives, only: derivatives_type, need_dynamics_q
    use tandem_rigid_euler_parameters, only: e_transposed_gradient, e_transposed_product, g_transposed_product, t_matrix
    use tandem_mechanism_vector, only: cross
    implicit none (type, external)
    private

    public :: spring_type, add_springs, differentiate_springs, spring_energy
    public :: torsion_type, add_torsions, differentiate_torsions, torsion_energy, torsion_angle
    public :: load_type, add_loads, differentiate_loads

    !> k (N/m), c (N s/m), the length without force (m), and the number of the function u, 0 for none.
    type :: spring_type
        type(span_type) :: span
        real(wp) :: stiffness = 0.0_wp, damping = 0.0_wp, length = 0.0_wp
        integer :: motion = 0
    end type spring_type

    !> k (N m), c (N m s), the angle without torque (rad). In space the angle is that from x1 to x2 about the common axis z,
    !> of x1.x2 and y1.x2; it is counted over any number of turns from what it was last.
    type :: torsion_type
        type(dot_type) :: cosine, sine
        real(wp) :: stiffness = 0.0_wp, damping = 0.0_wp, angle = 0.0_wp
        integer :: motion = 0
        !> The angle at the last point that was looked at.
        real(wp) :: last = 0.0_wp
    end type torsion_type

    !> A force (N) at a point of a body and a torque (N m), in the world's axes or the body's, times a function of time.
    type :: load_type
        integer :: body = 0
        real(wp) :: point(3) = 0.0_wp, force(3) = 0.0_wp, torque(3) = 0.0_wp
        logical :: in_body = .false.
        integer :: motion = 0
    end type load_type

    real(wp), parameter :: pi = acos(-1.0_wp)

contains

    !> force := force - f l_q for every spring. A length of zero has no direction: stat > 0.
    pure subroutine add_springs(springs, pose, f, force, stat)
        type(spring_type), intent(in) :: springs(:)
        type(pose_type), intent(in) :: pose(0:)
        real(wp), intent(in), contiguous :: f(0:, :)
        real(wp), intent(inout) :: force(:)
        integer, intent(inout) :: stat
        real(wp) :: d(3), d1(3), u(3), length, pull
        integer :: i

        do i = 1, size(springs)
            associate (spring => springs(i))
                d = span_way(spring%span, pose, 0)
                d1 = span_way(spring%span, pose, 1)
                length = sqrt(d(1)**2 + d(2)**2 + d(3)**2)
                if (.not. length > 0.0_wp) then
                    stat = 1
                    return
                end if
                u = d/length
                pull = spring%stiffness*(length - spring%length) + spring%damping*(u(1)*d1(1) + u(2)*d1(2) + u(3)*d1(3))
                if (spring%motion > 0) pull = pull + f(0, spring%motion)
                u = pull*u
                call add_force(pose(spring%span%first), spring%span%s1, u, force)
                u = -u
                call add_force(pose(spring%span%second), spring%span%s2, u, force)
            end associate
        end do
    end subroutine add_springs

    !> A force in the world's axes at a point of a body.
    pure subroutine add_force(pose, s, along, force)
        type(pose_type), intent(in) :: pose
        real(wp), intent(in) :: s(3), along(3)
        real(wp), intent(inout) :: force(:)
        real(wp) :: row(4)
        integer :: k

        do k = 1, pose%n_place
            force(pose%place + k - 1) = force(pose%place + k - 1) + along(k)
        end do
        if (pose%n_turn == 0) return
        row = gradient_of(pose, 0, s, along)
        do k = 1, pose%n_turn
            force(pose%turn + k - 1) = force(pose%turn + k - 1) + row(k)
        end do
    end subroutine add_force

    pure subroutine differentiate_springs(springs, need, pose, f, derivatives)
        type(spring_type), intent(in) :: springs(:)
        integer, intent(in) :: need
        type(pose_type), intent(in) :: pose(0:)
        real(wp), intent(in), contiguous :: f(0:, :)
        type(derivatives_type), intent(inout) :: derivatives
        real(wp) :: d(3, 0:1), gradient(n_local, 0:1), second(n_local, n_local), length, rate, pull
        integer :: i

        do i = 1, size(springs)
            associate (spring => springs(i))
                d(:, 0) = span_way(spring%span, pose, 0)
                d(:, 1) = span_way(spring%span, pose, 1)
                length = norm2(d(:, 0))
                rate = dot_product(d(:, 0), d(:, 1))/length
                call span_gradient(spring%span, pose, 1, d, gradient)
                call span_second(spring%span, pose, d(:, 0), second)
                ! With w = d.d/2: l_q = w_q/l, l_qq = (w_qq - l_q l_q')/l.
                gradient(:, 0) = gradient(:, 0)/length
                gradient(:, 1) = (gradient(:, 1) - rate*gradient(:, 0))/length
                call add_outer(-1.0_wp, gradient(:, 0), gradient(:, 0), second)
                second = second/length
                pull = spring%stiffness*(length - spring%length) + spring%damping*rate
                if (spring%motion > 0) pull = pull + f(0, spring%motion)
                call put_force(need, columns(pose(spring%span%first), pose(spring%span%second)), gradient, second, &
                    [pull, spring%stiffness, spring%damping], derivatives)
            end associate
        end do
    end subroutine differentiate_springs

    !> k (l - l0)^2/2.
    pure real(wp) function spring_energy(spring, pose)
        type(spring_type), intent(in) :: spring
        type(pose_type), intent(in) :: pose(0:)

        spring_energy = spring%stiffness*(norm2(span_way(spring%span, pose, 0)) - spring%length)**2/2
    end function spring_energy

    !> The angle, nearest to the last one.
    pure real(wp) function torsion_angle(torsion, pose)
        type(torsion_type), intent(in) :: torsion
        type(pose_type), intent(in) :: pose(0:)
        real(wp) :: a(3), x(3)

        if (pose(torsion%cosine%first)%n_turn == 1 .or. pose(torsion%cosine%second)%n_turn == 1) then
            torsion_angle = pose(torsion%cosine%second)%p(1, 0) - pose(torsion%cosine%first)%p(1, 0)
            return
        end if
        x = turned(pose(torsion%cosine%second), 0, torsion%cosine%b)
        a = turned(pose(torsion%cosine%first), 0, torsion%cosine%a)
        torsion_angle = dot_product(a, x)
        a = turned(pose(torsion%cosine%first), 0, torsion%sine%a)
        torsion_angle = atan2(dot_product(a, x), torsion_angle)
        torsion_angle = torsion_angle + 2*pi*anint((torsion%last - torsion_angle)/(2*pi))
    end function torsion_angle

    !> The angle's gradient with its first derivative along the motion, the rate, and if wanted the second gradient. With
    !> z = cosine + i sine the angle is Im ln z, and so (ln z)_qq = z_qq/z - (ln z)_q (ln z)_q'.
    pure subroutine differentiate_angle(torsion, pose, f, rate, gradient, second)
        type(torsion_type), intent(in) :: torsion
        type(pose_type), intent(in) :: pose(0:)
        real(wp), intent(in), contiguous :: f(0:, :)
        real(wp), intent(out) :: rate, gradient(n_local, 0:1)
        real(wp), intent(out), optional :: second(n_local, n_local)
        real(wp) :: local(3, 0:2), a(3, 0:2), d(3, 0:2), c_q(n_local, 0:2), s_q(n_local, 0:2), logarithm(n_local)
        real(wp) :: c(0:1), s(0:1), square, square_rate, c_qq(n_local, n_local)

        call dot_curve(torsion%cosine, pose, f, local, a, d)
        c = [sum(a(:, 0)*d(:, 0)), sum(a(:, 1)*d(:, 0)) + sum(a(:, 0)*d(:, 1))]
        call dot_gradient(torsion%cosine, pose, local, a, d, c_q)
        if (present(second)) call dot_second(torsion%cosine, pose, local, a, d, c_qq)
        call dot_curve(torsion%sine, pose, f, local, a, d)
        s = [sum(a(:, 0)*d(:, 0)), sum(a(:, 1)*d(:, 0)) + sum(a(:, 0)*d(:, 1))]
        call dot_gradient(torsion%sine, pose, local, a, d, s_q)
        square = c(0)**2 + s(0)**2
        square_rate = 2*(c(0)*c(1) + s(0)*s(1))
        rate = (c(0)*s(1) - s(0)*c(1))/square
        gradient(:, 0) = (c(0)*s_q(:, 0) - s(0)*c_q(:, 0))/square
        gradient(:, 1) = (c(1)*s_q(:, 0) + c(0)*s_q(:, 1) - s(1)*c_q(:, 0) - s(0)*c_q(:, 1) - square_rate*gradient(:, 0))/square
        if (.not. present(second)) return
        logarithm = (c(0)*c_q(:, 0) + s(0)*s_q(:, 0))/square
        call dot_second(torsion%sine, pose, local, a, d, second)
        second = (c(0)*second - s(0)*c_qq)/square
        call add_outer(-1.0_wp, gradient(:, 0), logarithm, second)
        call add_outer(-1.0_wp, logarithm, gradient(:, 0), second)
    end subroutine differentiate_angle

    !> force := force - f x_q for every torsional spring.
    pure subroutine add_torsions(torsions, pose, f, force)
        type(torsion_type), intent(inout) :: torsions(:)
        type(pose_type), intent(in) :: pose(0:)
        real(wp), intent(in), contiguous :: f(0:, :)
        real(wp), intent(inout) :: force(:)
        real(wp) :: gradient(n_local, 0:1), rate, torque
        integer :: i, k, c(n_local)

        do i = 1, size(torsions)
            associate (torsion => torsions(i))
                torsion%last = torsion_angle(torsion, pose)
                call differentiate_angle(torsion, pose, f, rate, gradient)
                torque = torsion%stiffness*(torsion%last - torsion%angle) + torsion%damping*rate
                if (torsion%motion > 0) torque = torque + f(0, torsion%motion)
                c = columns(pose(torsion%cosine%first), pose(torsion%cosine%second))
                do k = 1, n_local
                    if (c(k) > 0) force(c(k)) = force(c(k)) - torque*gradient(k, 0)
                end do
            end associate
        end do
    end subroutine add_torsions

    pure subroutine differentiate_torsions(torsions, need, pose, f, derivatives)
        type(torsion_type), intent(in) :: torsions(:)
        integer, intent(in) :: need
        type(pose_type), intent(in) :: pose(0:)
        real(wp), intent(in), contiguous :: f(0:, :)
        type(derivatives_type), intent(inout) :: derivatives
        real(wp) :: gradient(n_local, 0:1), second(n_local, n_local), rate, torque
        integer :: i

        do i = 1, size(torsions)
            associate (torsion => torsions(i))
                call differentiate_angle(torsion, pose, f, rate, gradient, second)
                torque = torsion%stiffness*(torsion_angle(torsion, pose) - torsion%angle) + torsion%damping*rate
                if (torsion%motion > 0) torque = torque + f(0, torsion%motion)
                call put_force(need, columns(pose(torsion%cosine%first), pose(torsion%cosine%second)), gradient, second, &
                    [torque, torsion%stiffness, torsion%damping], derivatives)
            end associate
        end do
    end subroutine differentiate_torsions

    !> k (x - x0)^2/2.
    pure real(wp) function torsion_energy(torsion, pose)
        type(torsion_type), intent(in) :: torsion
        type(pose_type), intent(in) :: pose(0:)

        torsion_energy = torsion%stiffness*(torsion_angle(torsion, pose) - torsion%angle)**2/2
    end function torsion_energy

    !> Given forces and torques. In the body's axes a force F at s has the part 2 G' (s x F) of p, and a torque T 2 G' T.
    pure subroutine add_loads(loads, pose, f, force)
        type(load_type), intent(in) :: loads(:)
        type(pose_type), intent(in) :: pose(0:)
        real(wp), intent(in), contiguous :: f(0:, :)
        real(wp), intent(inout) :: force(:)
        real(wp) :: factor, along(3), moment(3), row(4)
        integer :: i, k

        do i = 1, size(loads)
            associate (load => loads(i), body => pose(loads(i)%body))
                factor = 1.0_wp
                if (load%motion > 0) factor = f(0, load%motion)
                along = factor*load%force
                if (load%in_body) along = turned(body, 0, along)
                do k = 1, body%n_place
                    force(body%place + k - 1) = force(body%place + k - 1) + along(k)
                end do
                row = 0.0_wp
                if (body%n_turn == 1) then
                    moment = factor*load%torque
                    row = gradient_of(body, 0, load%point, along)
                    row(1) = row(1) + moment(3)
                else if (body%n_turn == 4) then
                    if (load%in_body) then
                        moment = factor*(load%torque + cross(load%point, load%force))
                        row = 2*g_transposed_product(body%p(:, 0), moment)
                    else
                        row = gradient_of(body, 0, load%point, along)
                        row = row + 2*e_transposed_product(body%p(:, 0), factor*load%torque)
                    end if
                end if
                do k = 1, body%n_turn
                    force(body%turn + k - 1) = force(body%turn + k - 1) + row(k)
                end do
            end associate
        end do
    end subroutine add_loads

    pure subroutine differentiate_loads(loads, need, pose, f, derivatives)
        type(load_type), intent(in) :: loads(:)
        integer, intent(in) :: need
        type(pose_type), intent(in) :: pose(0:)
        real(wp), intent(in), contiguous :: f(0:, :)
        type(derivatives_type), intent(inout) :: derivatives
        real(wp) :: factor, h(4, 4), b(3, 4), moment(3)
        integer :: i, j, k

        if (iand(need, need_dynamics_q) == 0) return
        do i = 1, size(loads)
            associate (load => loads(i), body => pose(loads(i)%body), d => derivatives%dynamics_q)
                factor = 1.0_wp
                if (load%motion > 0) factor = f(0, load%motion)
                if (load%in_body) then
                    b = gradient_matrix(body, 0, factor*load%force)
                    do j = 1, body%n_turn
                        do k = 1, body%n_place
                            d(body%place + k - 1, body%turn + j - 1) = d(body%place + k - 1, body%turn + j - 1) - b(k, j)
                        end do
                    end do
                    ! In the plane the moment of a force that turns with the body is constant.
                    h = 0.0_wp
                    moment = factor*(load%torque + cross(load%point, load%force))
                    if (body%n_turn == 4) h = 2*t_matrix(moment)
                else
                    h = second_gradient(body, load%point, factor*load%force)
                    if (body%n_turn == 4) h = h + 2*e_transposed_gradient(factor*load%torque)
                end if
                do j = 1, body%n_turn
                    do k = 1, body%n_turn
                        d(body%turn + k - 1, body%turn + j - 1) = d(body%turn + k - 1, body%turn + j - 1) - h(k, j)
                    end do
                end do
            end associate
        end do
    end subroutine differentiate_loads
end module tandem_mechanism_force
