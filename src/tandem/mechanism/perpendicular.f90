! SPDX-License-Identifier: MIT
!> The basic row of joints: the scalar product of a vector a fixed to one body and a vector d,
!>     Phi = a.d - c - f(t),  a = A1 a',  d = A2 b'  or  d = r2 + A2 s' - r1.
!> If d is a direction of the second body, the row keeps it at a constant angle to a, usually 90 degrees. If d leads to a point of
!> the second body, the row constrains the coordinate of this point along a.
!>
!> The constant a.(A1 s1') = a'.s1' is included in c.
module tandem_mechanism_perpendicular
    use tandem_kinds, only: wp
    use tandem_mechanism_pair, only: columns, n_local, place_1, place_2, put_holonomic, turn_1, turn_2
    use tandem_mechanism_pose, only: gradient_matrix, gradient_of, pose_type, second_gradient, turn
    use tandem_model_derivatives, only: derivatives_type
    use tandem_model_terms, only: need_gamma, need_jacobian, need_nu, need_phi, terms_type
    implicit none (type, external)
    private

    public :: perpendicular_type, evaluate_perpendiculars, differentiate_perpendiculars, set_vectors, dot_gradient, dot_second

    type :: perpendicular_type
        !> Bodies, 0 for the ground; row of C.
        integer :: first = 0, second = 0, row = 0
        !> True if d leads to a point of the second body.
        logical :: is_point = .false.
        !> a' in the frame of the first body; b' or s' in the frame of the second.
        real(wp) :: a(3) = 0.0_wp, b(3) = 0.0_wp
        real(wp) :: c = 0.0_wp
        !> Index of the function f, 0 if none.
        integer :: motion = 0
    end type perpendicular_type

    !> binomial(i, k) is the binomial coefficient k over i.
    real(wp), parameter :: binomial(0:2, 0:2) = reshape([1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, 1.0_wp, 0.0_wp, &
        1.0_wp, 2.0_wp, 1.0_wp], [3, 3])

contains

    !> Add the terms of rows. Other entries of the Jacobian are zero on entry.
    pure subroutine evaluate_perpendiculars(numbers, perpendiculars, need, pose, f, terms)
        !> Indices of the rows to evaluate.
        integer, intent(in) :: numbers(:)
        type(perpendicular_type), intent(in) :: perpendiculars(:)
        integer, intent(in) :: need
        type(pose_type), intent(in) :: pose(0:)
        !> Values and derivatives of the functions of time.
        real(wp), intent(in), contiguous :: f(0:, :)
        type(terms_type), intent(inout) :: terms
        real(wp) :: a(3), d(3)
        integer :: i

        do i = 1, size(numbers)
            associate (perpendicular => perpendiculars(numbers(i)), one => pose(perpendiculars(numbers(i))%first), &
                two => pose(perpendiculars(numbers(i))%second))
                call turn(one%a(:, :, 0), perpendicular%a, a)
                call turn(two%a(:, :, 0), perpendicular%b, d)
                if (perpendicular%is_point) d = d + two%r(:, 0) - one%r(:, 0)
                if (iand(need, need_phi) /= 0) then
                    terms%phi(perpendicular%row) = dot3(a, d) - perpendicular%c
                    if (perpendicular%motion > 0) terms%phi(perpendicular%row) = terms%phi(perpendicular%row) - f(0, &
                        perpendicular%motion)
                end if
                if (iand(need, need_jacobian) /= 0) call put_gradient(perpendicular, one, two, a, d, size(terms%jacobian, 1), &
                    size(terms%jacobian, 2), terms%jacobian)
                if (iand(need, need_nu) /= 0 .and. perpendicular%motion > 0) terms%nu(perpendicular%row) = f(1, &
                    perpendicular%motion)
                if (iand(need, need_gamma) /= 0) call set_gamma(perpendicular, one, two, f, a, d, terms%gamma(perpendicular%row))
            end associate
        end do
    end subroutine evaluate_perpendiculars

    !> Set the row of C.
    pure subroutine put_gradient(perpendicular, one, two, a, d, m, width, jacobian)
        type(perpendicular_type), intent(in) :: perpendicular
        type(pose_type), intent(in) :: one, two
        real(wp), intent(in) :: a(3), d(3)
        !> Shape of the stored C, which may be compressed.
        integer, intent(in) :: m, width
        real(wp), intent(inout) :: jacobian(m, width)
        real(wp) :: row(4)
        integer :: k

        if (perpendicular%is_point) then
            do k = 1, one%n_place
                jacobian(perpendicular%row, one%place_column + k - 1) = -a(k)
            end do
            do k = 1, two%n_place
                jacobian(perpendicular%row, two%place_column + k - 1) = a(k)
            end do
        end if
        if (one%n_turn > 0) then
            row = gradient_of(one, 0, perpendicular%a, d)
            do k = 1, one%n_turn
                jacobian(perpendicular%row, one%turn_column + k - 1) = row(k)
            end do
        end if
        if (two%n_turn > 0) then
            row = gradient_of(two, 0, perpendicular%b, a)
            do k = 1, two%n_turn
                jacobian(perpendicular%row, two%turn_column + k - 1) = row(k)
            end do
        end if
    end subroutine put_gradient

    !> Second derivative of Phi along the motion for qdd = 0.
    pure subroutine set_gamma(perpendicular, one, two, f, a, d, gamma)
        type(perpendicular_type), intent(in) :: perpendicular
        type(pose_type), intent(in) :: one, two
        real(wp), intent(in), contiguous :: f(0:, :)
        real(wp), intent(in) :: a(3), d(3)
        real(wp), intent(out) :: gamma
        real(wp) :: a1(3), a2(3), d1(3), d2(3)

        call turn(one%a(:, :, 1), perpendicular%a, a1)
        call turn(one%a(:, :, 2), perpendicular%a, a2)
        call turn(two%a(:, :, 1), perpendicular%b, d1)
        call turn(two%a(:, :, 2), perpendicular%b, d2)
        if (perpendicular%is_point) d1 = d1 + two%r(:, 1) - one%r(:, 1)
        gamma = dot3(a2, d) + 2*dot3(a1, d1) + dot3(a, d2)
        if (perpendicular%motion > 0) gamma = gamma - f(2, perpendicular%motion)
    end subroutine set_gamma

    !> Set a and d with their derivatives along the motion.
    pure subroutine set_vectors(perpendicular, pose, last, a, d)
        type(perpendicular_type), intent(in) :: perpendicular
        type(pose_type), intent(in) :: pose(0:)
        !> Highest derivative, 0 to 2.
        integer, intent(in) :: last
        real(wp), intent(inout) :: a(3, 0:2), d(3, 0:2)
        integer :: k

        do k = 0, last
            call turn(pose(perpendicular%first)%a(:, :, k), perpendicular%a, a(:, k))
            call turn(pose(perpendicular%second)%a(:, :, k), perpendicular%b, d(:, k))
            if (perpendicular%is_point) d(:, k) = d(:, k) + pose(perpendicular%second)%r(:, k) - pose(perpendicular%first)%r(:, k)
        end do
    end subroutine set_vectors

    !> Gradient of a.d with its derivatives along the motion.
    pure subroutine dot_gradient(perpendicular, pose, last, a, d, gradient)
        type(perpendicular_type), intent(in) :: perpendicular
        type(pose_type), intent(in) :: pose(0:)
        !> Highest derivative, 0 to 2.
        integer, intent(in) :: last
        real(wp), intent(in) :: a(3, 0:2), d(3, 0:2)
        real(wp), intent(inout) :: gradient(n_local, 0:2)
        integer :: k, l

        do k = 0, last
            gradient(:, k) = 0.0_wp
            if (perpendicular%is_point) then
                gradient(place_1 + 1:place_1 + 3, k) = -a(:, k)
                gradient(place_2 + 1:place_2 + 3, k) = a(:, k)
            end if
            do l = 0, k
                gradient(turn_2 + 1:turn_2 + 4, k) = gradient(turn_2 + 1:turn_2 + 4, k) + &
                    binomial(l, k)*gradient_of(pose(perpendicular%second), l, perpendicular%b, a(:, k - l))
                gradient(turn_1 + 1:turn_1 + 4, k) = gradient(turn_1 + 1:turn_1 + 4, k) + &
                    binomial(l, k)*gradient_of(pose(perpendicular%first), l, perpendicular%a, d(:, k - l))
            end do
        end do
    end subroutine dot_gradient

    !> Second gradient of a.d.
    pure subroutine dot_second(perpendicular, pose, a, d, second)
        type(perpendicular_type), intent(in) :: perpendicular
        type(pose_type), intent(in) :: pose(0:)
        real(wp), intent(in) :: a(3, 0:2), d(3, 0:2)
        real(wp), intent(out) :: second(n_local, n_local)
        real(wp) :: b_1(3, 4), b_2(3, 4)
        integer :: i, j

        b_1 = gradient_matrix(pose(perpendicular%first), 0, perpendicular%a)
        b_2 = gradient_matrix(pose(perpendicular%second), 0, perpendicular%b)
        second = 0.0_wp
        associate (p1 => second(turn_1 + 1:turn_1 + 4, turn_1 + 1:turn_1 + 4), &
            p2 => second(turn_2 + 1:turn_2 + 4, turn_2 + 1:turn_2 + 4), &
            mixed => second(turn_1 + 1:turn_1 + 4, turn_2 + 1:turn_2 + 4))
            do j = 1, 4
                do i = 1, 4
                    mixed(i, j) = dot3(b_1(:, i), b_2(:, j))
                end do
            end do
            p1 = second_gradient(pose(perpendicular%first), perpendicular%a, d(:, 0))
            p2 = second_gradient(pose(perpendicular%second), perpendicular%b, a(:, 0))
            second(turn_2 + 1:turn_2 + 4, turn_1 + 1:turn_1 + 4) = transpose(mixed)
        end associate
        if (.not. perpendicular%is_point) return
        second(place_1 + 1:place_1 + 3, turn_1 + 1:turn_1 + 4) = -b_1
        second(turn_1 + 1:turn_1 + 4, place_1 + 1:place_1 + 3) = -transpose(b_1)
        second(place_2 + 1:place_2 + 3, turn_1 + 1:turn_1 + 4) = b_1
        second(turn_1 + 1:turn_1 + 4, place_2 + 1:place_2 + 3) = transpose(b_1)
    end subroutine dot_second

    !> Add the requested gradient blocks of rows.
    pure subroutine differentiate_perpendiculars(perpendiculars, need, pose, lambda, derivatives)
        type(perpendicular_type), intent(in) :: perpendiculars(:)
        integer, intent(in) :: need
        type(pose_type), intent(in) :: pose(0:)
        real(wp), intent(in) :: lambda(:)
        type(derivatives_type), intent(inout) :: derivatives
        real(wp) :: a(3, 0:2), d(3, 0:2), gradient(n_local, 0:2), second(n_local, n_local)
        integer :: i

        do i = 1, size(perpendiculars)
            call set_vectors(perpendiculars(i), pose, 2, a, d)
            call dot_gradient(perpendiculars(i), pose, 2, a, d, gradient)
            call dot_second(perpendiculars(i), pose, a, d, second)
            call put_holonomic(need, perpendiculars(i)%row, columns(pose(perpendiculars(i)%first), &
                pose(perpendiculars(i)%second)), gradient, second, lambda(perpendiculars(i)%row), derivatives)
        end do
    end subroutine differentiate_perpendiculars

    pure real(wp) function dot3(x, y)
        real(wp), intent(in) :: x(3), y(3)

        dot3 = x(1)*y(1) + x(2)*y(2) + x(3)*y(3)
    end function dot3
end module tandem_mechanism_perpendicular
