! SPDX-License-Identifier: MIT
!> Forces along coordinates: spring-dampers between two points.
!>
!> A spring between two points has the tension f = k (l - l0) + c ld + u(t) + g(t, l, ld), positive if it pulls its ends together;
!> its generalised force is -f l_q. A force along the coordinate x of a joint is f = -k (x - x0) - c xd + u(t) + g(t, x, xd),
!> positive if it accelerates the coordinate; its generalised force is f x_q and its power f xd.
module tandem_mechanism_force
    use tandem_kinds, only: wp
    use tandem_mechanism_law, only: law_item_type
    use tandem_mechanism_pair, only: add_outer, columns, n_local, put_force
    use tandem_mechanism_pose, only: gradient_of, pose_type
    use tandem_mechanism_point_vector, only: vector_gradient, vector_second, point_vector_type, vector_between
    use tandem_model_derivatives, only: derivatives_type
    implicit none (type, external)
    private

    public :: spring_type, add_springs, differentiate_springs, spring_energy

    !> Spring-damper between two points: stiffness k (N/m), damping c (N s/m), free length l0 (m); indices of the function u(t) and
    !> of the force law g, 0 if none.
    type :: spring_type
        type(point_vector_type) :: vector
        real(wp) :: stiffness = 0.0_wp, damping = 0.0_wp, length = 0.0_wp
        integer :: motion = 0, law = 0
    end type spring_type

contains

    !> force := force - f l_q for every spring. Sets stat > 0 if the length of a spring is zero, because the direction of its force
    !> is then undefined.
    pure subroutine add_springs(springs, t, pose, f, laws, force, stat)
        type(spring_type), intent(in) :: springs(:)
        real(wp), intent(in) :: t
        type(pose_type), intent(in) :: pose(0:)
        !> Values and derivatives of the functions of time.
        real(wp), intent(in), contiguous :: f(0:, :)
        type(law_item_type), intent(in) :: laws(:)
        real(wp), intent(inout) :: force(:)
        integer, intent(inout) :: stat
        real(wp) :: d(3), d1(3), u(3), g(0:2), length, rate, tension
        integer :: i

        do i = 1, size(springs)
            associate (spring => springs(i))
                d = vector_between(spring%vector, pose, 0)
                d1 = vector_between(spring%vector, pose, 1)
                length = sqrt(d(1)**2 + d(2)**2 + d(3)**2)
                if (.not. length > 0.0_wp) then
                    stat = 1
                    return
                end if
                u = d/length
                rate = u(1)*d1(1) + u(2)*d1(2) + u(3)*d1(3)
                tension = spring%stiffness*(length - spring%length) + spring%damping*rate
                if (spring%motion > 0) tension = tension + f(0, spring%motion)
                if (spring%law > 0) then
                    call laws(spring%law)%law%evaluate(t, length, rate, g)
                    tension = tension + g(0)
                end if
                u = tension*u
                call add_force(pose(spring%vector%first), spring%vector%s1, u, force)
                u = -u
                call add_force(pose(spring%vector%second), spring%vector%s2, u, force)
            end associate
        end do
    end subroutine add_springs

    !> Add a force, given in the world frame, that acts at a body-fixed point s.
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

    !> Add the requested gradient blocks of springs.
    pure subroutine differentiate_springs(springs, need, t, pose, f, laws, derivatives)
        type(spring_type), intent(in) :: springs(:)
        integer, intent(in) :: need
        real(wp), intent(in) :: t
        type(pose_type), intent(in) :: pose(0:)
        real(wp), intent(in), contiguous :: f(0:, :)
        type(law_item_type), intent(in) :: laws(:)
        type(derivatives_type), intent(inout) :: derivatives
        real(wp) :: d(3, 0:1), gradient(n_local, 0:1), second(n_local, n_local), length, rate, tension(0:2), g(0:2)
        integer :: i

        do i = 1, size(springs)
            associate (spring => springs(i))
                d(:, 0) = vector_between(spring%vector, pose, 0)
                d(:, 1) = vector_between(spring%vector, pose, 1)
                length = norm2(d(:, 0))
                rate = dot_product(d(:, 0), d(:, 1))/length
                call vector_gradient(spring%vector, pose, 1, d, gradient)
                call vector_second(spring%vector, pose, d(:, 0), second)
                ! With w = d.d/2: l_q = w_q/l, l_qq = (w_qq - l_q l_q')/l.
                gradient(:, 0) = gradient(:, 0)/length
                gradient(:, 1) = (gradient(:, 1) - rate*gradient(:, 0))/length
                call add_outer(-1.0_wp, gradient(:, 0), gradient(:, 0), second)
                second = second/length
                tension = [spring%stiffness*(length - spring%length) + spring%damping*rate, spring%stiffness, spring%damping]
                if (spring%motion > 0) tension(0) = tension(0) + f(0, spring%motion)
                if (spring%law > 0) then
                    call laws(spring%law)%law%evaluate(t, length, rate, g)
                    tension = tension + g
                end if
                call put_force(need, columns(pose(spring%vector%first), pose(spring%vector%second)), gradient, second, tension, &
                    derivatives)
            end associate
        end do
    end subroutine differentiate_springs

    !> Energy k (l - l0)^2/2.
    pure real(wp) function spring_energy(spring, pose)
        type(spring_type), intent(in) :: spring
        type(pose_type), intent(in) :: pose(0:)

        spring_energy = spring%stiffness*(norm2(vector_between(spring%vector, pose, 0)) - spring%length)**2/2
    end function spring_energy
end module tandem_mechanism_force
