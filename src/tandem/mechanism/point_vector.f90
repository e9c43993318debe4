! SPDX-License-Identifier: MIT
!> The vector d = r2 + A2 s2' - r1 - A1 s1' from a point of one body to a point of another. It gives the rows d = 0 of coincident
!> points (two or three, along the world axes), the row (d.d - l(t)^2)/(2 w) = 0 of a distance, where w is a length so that the
!> multiplier is a force, and the length |d| of springs.
module tandem_mechanism_point_vector
    use tandem_kinds, only: wp
    use tandem_mechanism_pair, only: columns, columns_of_c, n_local, place_1, place_2, put_holonomic, put_row, turn_1, turn_2
    use tandem_mechanism_pose, only: gradient_matrix, gradient_of, pose_type, second_gradient, turn, turned
    use tandem_model_derivatives, only: derivatives_type
    use tandem_model_terms, only: need_gamma, need_jacobian, need_nu, need_phi, terms_type
    implicit none (type, external)
    private

    public :: point_vector_type, vector_between, vector_gradient, vector_second
    public :: evaluate_coincidences, differentiate_coincidences, evaluate_distances, differentiate_distances

    type :: point_vector_type
        !> Bodies, 0 for the ground; first row of C.
        integer :: first = 0, second = 0, row = 0
        !> Points s1' and s2', each in the frame of its own body.
        real(wp) :: s1(3) = 0.0_wp, s2(3) = 0.0_wp
        !> Distance l, and index of the function of time that gives it, 0 if it is constant; w.
        real(wp) :: length = 0.0_wp, weight = 1.0_wp
        integer :: motion = 0
    end type point_vector_type

    real(wp), parameter :: binomial(0:2, 0:2) = reshape([1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, 1.0_wp, 0.0_wp, &
        1.0_wp, 2.0_wp, 1.0_wp], [3, 3])

contains

    !> d, or its k-th derivative along the motion.
    pure function vector_between(vector, pose, k) result(d)
        type(point_vector_type), intent(in) :: vector
        type(pose_type), intent(in) :: pose(0:)
        integer, intent(in) :: k
        real(wp) :: d(3)

        d = pose(vector%second)%r(:, k) - pose(vector%first)%r(:, k) + turned(pose(vector%second), k, vector%s2) - &
            turned(pose(vector%first), k, vector%s1)
    end function vector_between

    !> Gradient of d.d/2, with derivatives along the motion up to order `last`.
    pure subroutine vector_gradient(vector, pose, last, d, gradient)
        type(point_vector_type), intent(in) :: vector
        type(pose_type), intent(in) :: pose(0:)
        integer, intent(in) :: last
        !> d, with derivatives along the motion.
        real(wp), intent(in) :: d(3, 0:last)
        real(wp), intent(out) :: gradient(n_local, 0:last)
        integer :: k, l

        gradient = 0.0_wp
        do k = 0, last
            gradient(place_1 + 1:place_1 + 3, k) = -d(:, k)
            gradient(place_2 + 1:place_2 + 3, k) = d(:, k)
            do l = 0, k
                gradient(turn_1 + 1:turn_1 + 4, k) = gradient(turn_1 + 1:turn_1 + 4, k) - &
                    binomial(l, k)*gradient_of(pose(vector%first), l, vector%s1, d(:, k - l))
                gradient(turn_2 + 1:turn_2 + 4, k) = gradient(turn_2 + 1:turn_2 + 4, k) + &
                    binomial(l, k)*gradient_of(pose(vector%second), l, vector%s2, d(:, k - l))
            end do
        end do
    end subroutine vector_gradient

    !> Second gradient of d.d/2: d_q'd_q + d.d_qq.
    pure subroutine vector_second(vector, pose, d, second)
        type(point_vector_type), intent(in) :: vector
        type(pose_type), intent(in) :: pose(0:)
        real(wp), intent(in) :: d(3)
        real(wp), intent(out) :: second(n_local, n_local)
        real(wp) :: d_q(3, n_local)
        integer :: i, j

        d_q = 0.0_wp
        do i = 1, 3
            d_q(i, place_1 + i) = -1.0_wp
            d_q(i, place_2 + i) = 1.0_wp
        end do
        d_q(:, turn_1 + 1:turn_1 + 4) = -gradient_matrix(pose(vector%first), 0, vector%s1)
        d_q(:, turn_2 + 1:turn_2 + 4) = gradient_matrix(pose(vector%second), 0, vector%s2)
        do j = 1, n_local
            do i = 1, n_local
                second(i, j) = d_q(1, i)*d_q(1, j) + d_q(2, i)*d_q(2, j) + d_q(3, i)*d_q(3, j)
            end do
        end do
        associate (p1 => second(turn_1 + 1:turn_1 + 4, turn_1 + 1:turn_1 + 4), &
            p2 => second(turn_2 + 1:turn_2 + 4, turn_2 + 1:turn_2 + 4))
            p1 = p1 - second_gradient(pose(vector%first), vector%s1, d)
            p2 = p2 + second_gradient(pose(vector%second), vector%s2, d)
        end associate
    end subroutine vector_second

    !> Add the terms of coincident points in space, three rows each.
    pure subroutine evaluate_coincidences(numbers, coincidences, need, pose, terms)
        !> Indices of the coincident points to evaluate.
        integer, intent(in) :: numbers(:)
        type(point_vector_type), intent(in) :: coincidences(:)
        integer, intent(in) :: need
        type(pose_type), intent(in) :: pose(0:)
        type(terms_type), intent(inout) :: terms
        real(wp) :: v1(3), v2(3)
        integer :: i, k

        do i = 1, size(numbers)
            associate (vector => coincidences(numbers(i)), one => pose(coincidences(numbers(i))%first), &
                two => pose(coincidences(numbers(i))%second))
                if (iand(need, need_phi) /= 0) then
                    call turn(one%a(:, :, 0), vector%s1, v1)
                    call turn(two%a(:, :, 0), vector%s2, v2)
                    do k = 1, 3
                        terms%phi(vector%row + k - 1) = two%r(k, 0) - one%r(k, 0) + v2(k) - v1(k)
                    end do
                end if
                if (iand(need, need_jacobian) /= 0) then
                    associate (m => size(terms%jacobian, 1), width => size(terms%jacobian, 2))
                        call put_end(one, vector%s1, -1.0_wp, vector%row, m, width, terms%jacobian)
                        call put_end(two, vector%s2, 1.0_wp, vector%row, m, width, terms%jacobian)
                    end associate
                end if
                if (iand(need, need_gamma) /= 0) then
                    call turn(one%a(:, :, 2), vector%s1, v1)
                    call turn(two%a(:, :, 2), vector%s2, v2)
                    do k = 1, 3
                        terms%gamma(vector%row + k - 1) = v2(k) - v1(k)
                    end do
                end if
            end associate
        end do
    end subroutine evaluate_coincidences

    !> Set the columns of the body at one end of d.
    pure subroutine put_end(pose, s, sign, row, m, width, jacobian)
        type(pose_type), intent(in) :: pose
        real(wp), intent(in) :: s(3), sign
        !> First row; shape of the stored C, which may be compressed.
        integer, intent(in) :: row, m, width
        real(wp), intent(inout) :: jacobian(m, width)
        real(wp) :: b(3, 4)
        integer :: j, k

        do k = 1, pose%n_place
            jacobian(row + k - 1, pose%place_column + k - 1) = sign
        end do
        if (pose%n_turn == 0) return
        b = gradient_matrix(pose, 0, s)
        do j = 1, 4
            do k = 1, 3
                jacobian(row + k - 1, pose%turn_column + j - 1) = sign*b(k, j)
            end do
        end do
    end subroutine put_end

    !> Add the requested gradient blocks of coincident points.
    pure subroutine differentiate_coincidences(coincidences, n_rows, need, pose, lambda, derivatives)
        type(point_vector_type), intent(in) :: coincidences(:)
        integer, intent(in) :: n_rows, need
        type(pose_type), intent(in) :: pose(0:)
        real(wp), intent(in) :: lambda(:)
        type(derivatives_type), intent(inout) :: derivatives
        real(wp) :: gradient(n_local, 0:2), second(n_local, n_local), along(3)
        integer :: i, k, l, c(n_local)

        do i = 1, size(coincidences)
            associate (vector => coincidences(i))
                c = columns(pose(vector%first), pose(vector%second))
                do k = 1, n_rows
                    along = 0.0_wp
                    along(k) = 1.0_wp
                    gradient = 0.0_wp
                    gradient(place_1 + k, 0) = -1.0_wp
                    gradient(place_2 + k, 0) = 1.0_wp
                    do l = 0, 2
                        gradient(turn_1 + 1:turn_1 + 4, l) = -gradient_of(pose(vector%first), l, vector%s1, along)
                        gradient(turn_2 + 1:turn_2 + 4, l) = gradient_of(pose(vector%second), l, vector%s2, along)
                    end do
                    second = 0.0_wp
                    second(turn_1 + 1:turn_1 + 4, turn_1 + 1:turn_1 + 4) = -second_gradient(pose(vector%first), vector%s1, along)
                    second(turn_2 + 1:turn_2 + 4, turn_2 + 1:turn_2 + 4) = second_gradient(pose(vector%second), vector%s2, along)
                    call put_holonomic(need, vector%row + k - 1, c, gradient, second, lambda(vector%row + k - 1), derivatives)
                end do
            end associate
        end do
    end subroutine differentiate_coincidences

    !> Add the terms of distances.
    pure subroutine evaluate_distances(distances, need, pose, f, terms)
        type(point_vector_type), intent(in) :: distances(:)
        integer, intent(in) :: need
        type(pose_type), intent(in) :: pose(0:)
        !> Values and derivatives of the functions of time.
        real(wp), intent(in), contiguous :: f(0:, :)
        type(terms_type), intent(inout) :: terms
        real(wp) :: d(3), d1(3), d2(3), l(0:2), gradient(n_local, 0:0)
        integer :: i

        do i = 1, size(distances)
            associate (vector => distances(i))
                l = [vector%length, 0.0_wp, 0.0_wp]
                if (vector%motion > 0) l = f(:, vector%motion)
                d = vector_between(vector, pose, 0)
                if (iand(need, need_phi) /= 0) terms%phi(vector%row) = (sum(d*d) - l(0)**2)/(2*vector%weight)
                if (iand(need, need_jacobian) /= 0) then
                    call vector_gradient(vector, pose, 0, d, gradient)
                    call put_row(columns_of_c(pose(vector%first), pose(vector%second)), gradient(:, 0)/vector%weight, vector%row, &
                        terms%jacobian)
                end if
                if (iand(need, need_nu) /= 0) terms%nu(vector%row) = l(0)*l(1)/vector%weight
                if (iand(need, need_gamma) /= 0) then
                    d1 = vector_between(vector, pose, 1)
                    d2 = turned(pose(vector%second), 2, vector%s2) - turned(pose(vector%first), 2, vector%s1)
                    terms%gamma(vector%row) = (sum(d1*d1) + sum(d*d2) - l(1)**2 - l(0)*l(2))/vector%weight
                end if
            end associate
        end do
    end subroutine evaluate_distances

    !> Add the requested gradient blocks of distances.
    pure subroutine differentiate_distances(distances, need, pose, lambda, derivatives)
        type(point_vector_type), intent(in) :: distances(:)
        integer, intent(in) :: need
        type(pose_type), intent(in) :: pose(0:)
        real(wp), intent(in) :: lambda(:)
        type(derivatives_type), intent(inout) :: derivatives
        real(wp) :: d(3, 0:2), gradient(n_local, 0:2), second(n_local, n_local)
        integer :: i, k

        do i = 1, size(distances)
            associate (vector => distances(i))
                do k = 0, 2
                    d(:, k) = vector_between(vector, pose, k)
                end do
                call vector_gradient(vector, pose, 2, d, gradient)
                call vector_second(vector, pose, d(:, 0), second)
                call put_holonomic(need, vector%row, columns(pose(vector%first), pose(vector%second)), gradient/vector%weight, &
                    second/vector%weight, lambda(vector%row), derivatives)
            end associate
        end do
    end subroutine differentiate_distances
end module tandem_mechanism_point_vector
