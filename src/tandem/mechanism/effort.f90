! SPDX-License-Identifier: MIT
!> Forces, lengths and energies of springs at a state, and the power of their parts without a potential:
!> dampers, functions of time, laws. For files, not for steps.
module tandem_mechanism_effort
    use tandem_kinds, only: wp
    use tandem_mechanism_force, only: spring_type
    use tandem_mechanism_law, only: law_item_type
    use tandem_mechanism_pose, only: pose_type
    use tandem_mechanism_point_vector, only: vector_between
    implicit none (type, external)
    private

    public :: effort_type, spring_effort

    !> Force and energy of an element.
    type :: effort_type
        !> Force along the coordinate (N, N m), for a spring positive if it pulls its ends together, along the coordinate of a joint
        !> if it accelerates the coordinate; the coordinate and its rate.
        real(wp) :: along = 0.0_wp, x = 0.0_wp, rate = 0.0_wp
        !> Force on the second body, or on the body of a load, and torque about its point, in world axes.
        real(wp) :: force(3) = 0.0_wp, torque(3) = 0.0_wp
        !> Potential energy (J), and power of the remaining part of the force (W), negative for a damper.
        real(wp) :: energy = 0.0_wp, power = 0.0_wp
    end type effort_type

contains

    !> Force of a spring between two points.
    pure function spring_effort(spring, t, pose, f, laws) result(effort)
        type(spring_type), intent(in) :: spring
        real(wp), intent(in) :: t
        !> Rates are set.
        type(pose_type), intent(in) :: pose(0:)
        !> Values and derivatives of the functions of time.
        real(wp), intent(in) :: f(0:, :)
        type(law_item_type), intent(in) :: laws(:)
        type(effort_type) :: effort
        real(wp) :: d(3), rest

        d = vector_between(spring%vector, pose, 0)
        effort%x = norm2(d)
        if (effort%x > 0.0_wp) d = d/effort%x
        effort%rate = dot_product(d, vector_between(spring%vector, pose, 1))
        effort%energy = spring%stiffness*(effort%x - spring%length)**2/2
        rest = spring%damping*effort%rate + given_force(spring%motion, spring%law, 1.0_wp, t, effort, f, laws)
        effort%along = spring%stiffness*(effort%x - spring%length) + rest
        effort%power = -rest*effort%rate
        effort%force = -effort%along*d
    end function spring_effort

    !> u(t) + N g(t, x, v).
    pure real(wp) function given_force(motion, law, normal, t, effort, f, laws) result(given)
        !> Indices of the function and of the law, 0 if none.
        integer, intent(in) :: motion, law
        !> Normal force of friction on a reaction; 1 for all other laws.
        real(wp), intent(in) :: normal, t
        !> Coordinate and rate are set.
        type(effort_type), intent(in) :: effort
        real(wp), intent(in) :: f(0:, :)
        type(law_item_type), intent(in) :: laws(:)
        real(wp) :: g(0:2)

        given = 0.0_wp
        if (motion > 0) given = f(0, motion)
        if (law == 0) return
        call laws(law)%law%evaluate(t, effort%x, effort%rate, g)
        given = given + normal*g(0)
    end function given_force
end module tandem_mechanism_effort
