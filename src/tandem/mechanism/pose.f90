! SPDX-License-Identifier: MIT
!> Pose of a body: position and rotation with their first and second derivatives along a motion. It is set once per point and used
!> by all elements on the body.
!>
!> Planar and spatial bodies have the same interface. Vectors have three components, the third of which is zero in the plane. A
!> rotation has one coordinate in the plane and four in space; only this module depends on the number. It provides A a, its gradient
!> with respect to the coordinates of the rotation, and its second gradient. The ground has no coordinates, and a point mass has no
!> rotation.
module tandem_mechanism_pose
    use tandem_kinds, only: wp
    use tandem_rigid_euler_parameters, only: b_matrix, b_row, k_matrix, rotation, rotation_rate, set_rotation, &
        set_rotation_rate
    implicit none (type, external)
    private

    public :: pose_type, turn, turned, gradient_of, gradient_matrix, second_gradient
    public :: set_angle, set_displacements, set_position, set_rates, set_accelerations

    !> Pose of a body; the default is the pose of the ground.
    type :: pose_type
        !> Numbers of coordinates of the position (0, 2 or 3) and of the rotation (0, 1 or 4).
        integer :: n_place = 0, n_turn = 0
        !> First columns of the position and of the rotation, 0 if none.
        integer :: place = 0, turn = 0
        !> First columns in the stored C, which may be compressed. First columns in the stored M, and distance between the columns
        !> of the position there.
        integer :: place_column = 0, turn_column = 0, place_mass = 0, turn_mass = 0, mass_step = 1
        !> True if A belongs to the current Euler parameters.
        logical :: has_turn = .false.
        !> Position; angle or Euler parameters; each with its first and second derivative.
        real(wp) :: r(3, 0:2) = 0.0_wp, p(4, 0:2) = 0.0_wp
        !> Rotation matrix A from the body frame to the world frame, with its first and second derivative.
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

    !> Set the pose at q, except for angles in the plane. The rotation matrix is not recomputed if the Euler parameters are
    !> unchanged, because several sets of terms are evaluated at one point.
    pure subroutine set_position(self, q)
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
                if (is_equal(p(1, 0), q(turn)) .and. is_equal(p(2, 0), q(turn + 1)) .and. &
                    is_equal(p(3, 0), q(turn + 2)) .and. is_equal(p(4, 0), q(turn + 3)) .and. self%has_turn) return
                p(1, 0) = q(turn)
                p(2, 0) = q(turn + 1)
                p(3, 0) = q(turn + 2)
                p(4, 0) = q(turn + 3)
            end associate
            self%has_turn = .true.
            call set_rotation(self%p(:, 0), self%a(:, :, 0))
        end if

    contains

        !> True if two numbers are equal; false for NaN.
        pure logical function is_equal(x, y)
            real(wp), intent(in) :: x, y

            is_equal = x <= y .and. x >= y
        end function is_equal
    end subroutine set_position

    !> Set parts with one coordinate, their displacement, or a derivative of it.
    pure subroutine set_displacements(poses, k, values)
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
    end subroutine set_displacements

    !> Set first derivatives for qd, and second derivatives for qdd = 0.
    pure subroutine set_rates(self, qd)
        type(pose_type), intent(inout) :: self
        real(wp), intent(in) :: qd(:)
        integer :: i
        real(wp) :: w

        ! Write the two lengths out: loops of variable length would be compiled to calls.
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
            ! A is quadratic in p: its second derivative for pdd = 0 is 2 A(pd), which is M(pd, pd).
            call set_rotation_rate(self%p(:, 1), self%p(:, 1), self%a(:, :, 2))
        else if (self%n_turn == 1) then
            w = qd(self%turn)
            self%p(1, 1) = w
            self%p(1, 2) = 0.0_wp
            call set_plane(self%a(:, :, 1), -w*self%a(2, 1, 0), w*self%a(1, 1, 0))
            call set_plane(self%a(:, :, 2), -w*w*self%a(1, 1, 0), -w*w*self%a(2, 1, 0))
        end if
    end subroutine set_rates

    !> Add qdd to the second derivatives. The first derivatives are set.
    pure subroutine set_accelerations(self, qdd)
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
    end subroutine set_accelerations

    !> Rotation matrix in the plane, [c, -s; s, c].
    pure subroutine set_plane(a, c, s)
        real(wp), intent(inout) :: a(3, 3)
        real(wp), intent(in) :: c, s

        a(1, 1) = c
        a(2, 1) = s
        a(1, 2) = -s
        a(2, 2) = c
    end subroutine set_plane

    !> A a for a constant vector a in the body frame, or its k-th derivative along the motion.
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

    !> v = m a without temporaries: the most frequent operation on joints.
    pure subroutine turn(m, a, v)
        !> Rotation matrix or its derivative; vector in the body frame.
        real(wp), intent(in) :: m(3, 3), a(3)
        real(wp), intent(out) :: v(3)

        v(1) = m(1, 1)*a(1) + m(1, 2)*a(2) + m(1, 3)*a(3)
        v(2) = m(2, 1)*a(1) + m(2, 2)*a(2) + m(2, 3)*a(3)
        v(3) = m(3, 1)*a(1) + m(3, 2)*a(2) + m(3, 3)*a(3)
    end subroutine turn

    !> n'(A a)_p for a constant n; in the plane only the first entry is used. For k > 0, n' times the k-th derivative of (A a)_p
    !> along the motion.
    pure function gradient_of(self, k, a, n) result(row)
        type(pose_type), intent(in) :: self
        integer, intent(in) :: k
        !> Vectors in the body frame and in the world frame.
        real(wp), intent(in) :: a(3), n(3)
        real(wp) :: row(4)

        select case (self%n_turn)
        case (4)
            ! (A a)_p is linear in p.
            row = b_row(self%p(:, k), a, n)
        case (1)
            row(1) = (self%a(1, 1, k)*a(1) + self%a(1, 2, k)*a(2))*n(2) - (self%a(2, 1, k)*a(1) + self%a(2, 2, k)*a(2))*n(1)
            row(2:4) = 0.0_wp
        case default
            row = 0.0_wp
        end select
    end function gradient_of

    !> (A a)_p (3, 4), or its k-th derivative along the motion. Unused columns are zero.
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

    !> Second gradient (n'A a)_pp (4, 4), symmetric.
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
