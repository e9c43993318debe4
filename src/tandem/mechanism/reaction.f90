! SPDX-License-Identifier: MIT
!> Effect of the rows of an element on a body: the force and the torque of -C' lambda, from the columns of C, so that it holds for
!> every element: a generalised force Q on the position of a body is a force at its centre of mass, and 2 E' T on its Euler
!> parameters a torque T, so that T = E Q/2 (E E' = 1); in the plane the torque is Q itself.
module tandem_mechanism_reaction
    use tandem_kinds, only: wp
    use tandem_mechanism_pose, only: pose_type
    use tandem_mechanism_vector, only: cross
    use tandem_rigid_euler_parameters, only: e_product
    implicit none (type, external)
    private

    public :: reaction_on, wrench_of, turned_back

contains

    !> Force on a body and torque about a point in space, in world axes.
    pure subroutine reaction_on(body, rows, lambda, jacobian, point, force, torque)
        !> Pose of a body other than the ground.
        type(pose_type), intent(in) :: body
        !> Rows of C of the element.
        integer, intent(in) :: rows(:)
        !> Multipliers, and C with the columns of the poses.
        real(wp), intent(in) :: lambda(:), jacobian(:, :), point(3)
        real(wp), intent(out) :: force(3), torque(3)
        real(wp) :: along(3), turning(4)
        integer :: i, k

        along = 0.0_wp
        turning = 0.0_wp
        do i = 1, size(rows)
            do k = 1, body%n_place
                along(k) = along(k) - lambda(rows(i))*jacobian(rows(i), body%place_column + k - 1)
            end do
            do k = 1, body%n_turn
                turning(k) = turning(k) - lambda(rows(i))*jacobian(rows(i), body%turn_column + k - 1)
            end do
        end do
        call wrench_of(body, along, turning, point, force, torque)
    end subroutine reaction_on

    !> The same for a generalised force on position and rotation.
    pure subroutine wrench_of(body, along, turning, point, force, torque)
        type(pose_type), intent(in) :: body
        real(wp), intent(in) :: along(3), turning(4), point(3)
        real(wp), intent(out) :: force(3), torque(3)

        force = along
        torque = 0.0_wp
        if (body%n_turn == 4) then
            torque = e_product(body%p(:, 0), turning)/2
        else if (body%n_turn == 1) then
            torque(3) = turning(1)
        end if
        if (body%n_turn > 0) torque = torque - cross(point - body%r(:, 0), force)
    end subroutine wrench_of

    !> Rotate a vector from the world frame to that of a body.
    pure function turned_back(body, v) result(u)
        type(pose_type), intent(in) :: body
        real(wp), intent(in) :: v(3)
        real(wp) :: u(3)
        integer :: i

        do i = 1, 3
            u(i) = body%a(1, i, 0)*v(1) + body%a(2, i, 0)*v(2) + body%a(3, i, 0)*v(3)
        end do
    end function turned_back
end module tandem_mechanism_reaction
