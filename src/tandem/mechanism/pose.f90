! SPDX-License-Identifier: MIT
!> Pose of a body and its change: position and rotation with their first and second derivatives along a motion, set once per point
!> and used by every element on the body.
!>
!> Planar and spatial bodies have the same interface: vectors have three components (the third is zero in the plane), and a rotation
!> has one or four coordinates. Everything that depends on this number is here: A a, its gradient with respect to these coordinates,
!> and its second gradient. The ground has no coordinates, and a point mass has none for a rotation.
module tandem_mechanism_pose
    use tandem_kinds, only: wp
    use tandem_rigid_euler_parameters, only: b_matrix, b_row, k_matrix, rotation, rotation_rate, set_rotation, &
        set_rotation_rate
    implicit none (type, external)
    private

    public :: pose_type, turn, turned, set_angle, set_place, set_slides, set_rates, set_curve, gradient_of, gradient_matrix, &
        second_gradient

    !> Pose of a body; by default that of the ground.
    type :: pose_type
        !> Numbers of coordinates of the position (0, 2 or 3) and of the rotation (0, 1 or 4).
        integer :: n_place = 0, n_turn = 0
        !> First column of each, 0 if none.
        integer :: place = 0, turn = 0
        !> First columns in the stored C, which may be compressed; first columns in M, and distance of the columns of the position.
        integer :: place_column = 0, turn_column = 0, place_mass = 0, turn_mass = 0, mass_step = 1
        !> True if the rotation matrix is that of the Euler parameters.
        logical :: has_turn = .false.
        !> Position; angle or Euler parameters; with first and second derivatives.
        real(wp) :: r(3, 0:2) = 0.0_wp, p(4, 0:2) = 0.0_wp
        !> Rotation from the body to the world, with first and second derivatives.
        real(wp) :: a(3, 3, 0:2) = reshape([1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, &
            0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, &
            0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp], [3, 3, 3])
    end type pose_type

contains

    !> Set the angle of a body in the plane, with its cosine and sine.
    pure subroutine set_angle(self, angle, c, s)
        type(pose_type), intent(inout) :: self
        real(wp), intent(in) :: angle, c, s

        self%p(1, 0) = angle
        call set_plane(self%a(:, :, 0), c, s)
    end subroutine set_angle

    !> Set the pose at q, except angles in the plane. The rotation is kept if its parameters are unchanged, because several sets of
    !> terms are evaluated at one point.
    pure subroutine set_place(self, q)
        type(pose_type), intent(inout) :: self
        real(wp), intent(in) :: q(:)

        if (self%n_place == 3) then
            self%r(1, 0) = q(self%place)
            self%r(2, 0) = q(self%place + 1)
            self%r(3, 0) = q(self%place + 2)
        else if (self%n_place == 2) then
            self%r(1, 0) = q(self%place)
            self%r(2, 0) = q(self%place + 1)
        end if
        if (self%n_turn == 4) then
            associate (p => self%p, turn => self%turn)
                if (same(p(1, 0), q(turn)) .and. same(p(2, 0), q(turn + 1)) .and. same(p(3, 0), q(turn + 2)) .and. &
                    same(p(4, 0), q(turn + 3)) .and. self%has_turn) return
                p(1, 0) = q(turn)
                p(2, 0) = q(turn + 1)
                p(3, 0) = q(turn + 2)
                p(4, 0) = q(turn + 3)
            end associate
            self%has_turn = .true.
            call set_rotation(self%p(:, 0), self%a(:, :, 0))
        end if

    contains

        !> True if two numbers are equal; false for a NaN.
        pure logical function same(x, y)
            real(wp), intent(in) :: x, y

            same = x <= y .and. x >= y
        end function same
    end subroutine set_place

    !> Set parts with one coordinate, their displacement, or a derivative of it.
    pure subroutine set_slides(poses, k, values)
        type(pose_type), intent(inout) :: poses(:)
        !> Order of the derivative, 0 for the value. Order 1 also sets the second derivative for qdd = 0.
        integer, intent(in) :: k
        !> Values of all coordinates.
        real(wp), intent(in) :: values(:)
        integer :: i

        do i = 1, size(poses)
            poses(i)%r(1, k) = values(poses(i)%place)
            if (k == 1) poses(i)%r(1, 2) = 0.0_wp
        end do
    end subroutine set_slides

    !> Set first derivatives along qd, and second ones for qdd = 0.
    pure subroutine set_rates(self, qd)
        type(pose_type), intent(inout) :: self
        real(wp), intent(in) :: qd(:)
        integer :: i
        real(wp) :: w

        ! A loop of variable length would become two calls.
        if (self%n_place == 3) then
            do i = 1, 3
                self%r(i, 1) = qd(self%place + i - 1)
                self%r(i, 2) = 0.0_wp
            end do
        else if (self%n_place == 2) then
            do i = 1, 2
                self%r(i, 1) = qd(self%place + i - 1)
                self%r(i, 2) = 0.0_wp
            end do
        end if
        if (self%n_turn == 4) then
            do i = 1, 4
                self%p(i, 1) = qd(self%turn + i - 1)
                self%p(i, 2) = 0.0_wp
            end do
            call set_rotation_rate(self%p(:, 0), self%p(:, 1), self%a(:, :, 1))
            ! A is quadratic in p: the remainder of its second derivative is 2 A(pd), M(pd, pd).
            call set_rotation_rate(self%p(:, 1), self%p(:, 1), self%a(:, :, 2))
        else if (self%n_turn == 1) then
            w = qd(self%turn)
            self%p(1, 1) = w
            self%p(1, 2) = 0.0_wp
            call set_plane(self%a(:, :, 1), -w*self%a(2, 1, 0), w*self%a(1, 1, 0))
            call set_plane(self%a(:, :, 2), -w*w*self%a(1, 1, 0), -w*w*self%a(2, 1, 0))
        end if
    end subroutine set_rates

    !> Set second derivatives with qdd; the first ones are set.
    pure subroutine set_curve(self, qdd)
        type(pose_type), intent(inout) :: self
        real(wp), intent(in) :: qdd(:)
        integer :: i
        real(wp) :: w

        do i = 1, self%n_place
            self%r(i, 2) = qdd(self%place + i - 1)
        end do
        if (self%n_turn == 4) then
            do i = 1, 4
                self%p(i, 2) = qdd(self%turn + i - 1)
            end do
            self%a(:, :, 2) = 2*rotation(self%p(:, 1)) + rotation_rate(self%p(:, 0), self%p(:, 2))
        else if (self%n_turn == 1) then
            w = qdd(self%turn)
            self%p(1, 2) = w
            associate (c => self%a(1, 1, 0), s => self%a(2, 1, 0), square => self%p(1, 1)**2)
                call set_plane(self%a(:, :, 2), -square*c - w*s, w*c - square*s)
            end associate
        end if
    end subroutine set_curve

    !> [c, -s; s, c] in the plane.
    pure subroutine set_plane(a, c, s)
        real(wp), intent(inout) :: a(3, 3)
        real(wp), intent(in) :: c, s

        a(1, 1) = c
        a(2, 1) = s
        a(1, 2) = -s
        a(2, 2) = c
    end subroutine set_plane

    !> A a, or a derivative of it, for a constant a in the frame of the body.
    pure function turned(self, k, a) result(v)
        type(pose_type), intent(in) :: self
        !> Order of the derivative, 0 for the value.
        integer, intent(in) :: k
        real(wp), intent(in) :: a(3)
        real(wp) :: v(3)

        v(1) = self%a(1, 1, k)*a(1) + self%a(1, 2, k)*a(2) + self%a(1, 3, k)*a(3)
        v(2) = self%a(2, 1, k)*a(1) + self%a(2, 2, k)*a(2) + self%a(2, 3, k)*a(3)
        v(3) = self%a(3, 1, k)*a(1) + self%a(3, 2, k)*a(2) + self%a(3, 3, k)*a(3)
    end function turned

    !> m a, in place: the most frequent operation of loops over joints.
    pure subroutine turn(m, a, v)
        !> A rotation or a derivative of it, and a vector in the frame of the body.
        real(wp), intent(in) :: m(3, 3), a(3)
        real(wp), intent(out) :: v(3)

        v(1) = m(1, 1)*a(1) + m(1, 2)*a(2) + m(1, 3)*a(3)
        v(2) = m(2, 1)*a(1) + m(2, 2)*a(2) + m(2, 3)*a(3)
        v(3) = m(3, 1)*a(1) + m(3, 2)*a(2) + m(3, 3)*a(3)
    end subroutine turn

    !> n' (A a)_p for a constant n; in the plane only the first entry matters. For k > 0 the k-th derivative of (A a)_p along the
    !> motion is used.
    pure function gradient_of(self, k, a, n) result(row)
        type(pose_type), intent(in) :: self
        integer, intent(in) :: k
        !> In the frame of the body, and in that of the world.
        real(wp), intent(in) :: a(3), n(3)
        real(wp) :: row(4)

        select case (self%n_turn)
        case (4)
            ! Linear in p.
            row = b_row(self%p(:, k), a, n)
        case (1)
            row(1) = (self%a(1, 1, k)*a(1) + self%a(1, 2, k)*a(2))*n(2) - (self%a(2, 1, k)*a(1) + self%a(2, 2, k)*a(2))*n(1)
            row(2:4) = 0.0_wp
        case default
            row = 0.0_wp
        end select
    end function gradient_of

    !> (A a)_p (3, 4), or its k-th derivative along the motion; unused columns are zero.
    pure function gradient_matrix(self, k, a) result(b)
        type(pose_type), intent(in) :: self
        integer, intent(in) :: k
        real(wp), intent(in) :: a(3)
        real(wp) :: b(3, 4), v(3)

        if (self%n_turn == 4) then
            b = b_matrix(self%p(:, k), a)
            return
        end if
        b = 0.0_wp
        if (self%n_turn == 1) then
            v = turned(self, k, a)
            b(1, 1) = -v(2)
            b(2, 1) = v(1)
        end if
    end function gradient_matrix

    !> (n' A a)_pp (4, 4), symmetric.
    pure function second_gradient(self, a, n) result(h)
        type(pose_type), intent(in) :: self
        real(wp), intent(in) :: a(3), n(3)
        real(wp) :: h(4, 4), v(3)

        h = 0.0_wp
        if (self%n_turn == 4) then
            h = k_matrix(a, n)
        else if (self%n_turn == 1) then
            v = turned(self, 0, a)
            h(1, 1) = -(v(1)*n(1) + v(2)*n(2))
        end if
    end function second_gradient
end module tandem_mechanism_pose
