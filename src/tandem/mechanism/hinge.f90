! SPDX-License-Identifier: MIT
!> Hinges in space, the most frequent joint of large mechanisms: two coincident points, and a direction z of the second body that is
!> perpendicular to two directions x, y of the first,
!>     Phi = [r2 + A2 s2' - r1 - A1 s1'; (A1 x').(A2 z'); (A1 y').(A2 z')].
!> The lists of coincident points and of perpendicularity rows also contain these five rows, for the gradient blocks. Evaluating the
!> five rows together shares common terms and skips those that a hinge lacks.
module tandem_mechanism_hinge
    use tandem_kinds, only: wp
    use tandem_mechanism_perpendicular, only: perpendicular_type
    use tandem_mechanism_pose, only: pose_type, turn
    use tandem_mechanism_point_vector, only: point_vector_type
    use tandem_model_terms, only: need_gamma, need_jacobian, need_phi, terms_type
    use tandem_rigid_euler_parameters, only: b_matrix, b_row
    implicit none (type, external)
    private

    public :: hinge_type, gather_hinges, evaluate_hinges

    type :: hinge_type
        !> Bodies, 0 for the ground; first row of C.
        integer :: first = 0, second = 0, row = 0
        !> Points and directions, each in the frame of its own body.
        real(wp) :: s1(3) = 0.0_wp, s2(3) = 0.0_wp, x(3) = 0.0_wp, y(3) = 0.0_wp, z(3) = 0.0_wp
    end type hinge_type

contains

    !> Collect the hinges: two coincident points followed by two perpendicularity rows. Also return the indices of all other
    !> coincident points and perpendicularity rows.
    pure subroutine gather_hinges(coincidences, perpendiculars, pose, n_rows, hinges, single_coincidences, single_perpendiculars)
        type(point_vector_type), intent(in) :: coincidences(:)
        type(perpendicular_type), intent(in) :: perpendiculars(:)
        !> Poses of the bodies, with column numbers; index 0 is the ground.
        type(pose_type), intent(in) :: pose(0:)
        !> Number of rows.
        integer, intent(in) :: n_rows
        type(hinge_type), allocatable, intent(out) :: hinges(:)
        integer, allocatable, intent(out) :: single_coincidences(:), single_perpendiculars(:)
        integer :: dot_of_row(n_rows + 2), i, n
        logical :: is_hinge(size(coincidences)), is_taken(size(perpendiculars))

        dot_of_row = 0
        do i = 1, size(perpendiculars)
            dot_of_row(perpendiculars(i)%row) = i
        end do
        is_taken = .false.
        do i = 1, size(coincidences)
            associate (vector => coincidences(i))
                is_hinge(i) = can_rotate(vector%first) .and. can_rotate(vector%second) .and. vector%row + 4 <= n_rows
                if (.not. is_hinge(i)) cycle
                associate (x => dot_of_row(vector%row + 3), y => dot_of_row(vector%row + 4))
                    is_hinge(i) = x > 0 .and. y > 0
                    if (is_hinge(i)) is_hinge(i) = fits(vector, perpendiculars(x)) .and. fits(vector, perpendiculars(y)) .and. &
                        .not. any(abs(perpendiculars(x)%b - perpendiculars(y)%b) > 0.0_wp)
                    if (.not. is_hinge(i)) cycle
                    is_taken([x, y]) = .true.
                end associate
            end associate
        end do
        single_coincidences = pack([(i, i=1, size(coincidences))], .not. is_hinge)
        single_perpendiculars = pack([(i, i=1, size(perpendiculars))], .not. is_taken)
        allocate (hinges(count(is_hinge)))
        n = 0
        do i = 1, size(coincidences)
            if (.not. is_hinge(i)) cycle
            n = n + 1
            associate (vector => coincidences(i), x => perpendiculars(dot_of_row(coincidences(i)%row + 3)), &
                y => perpendiculars(dot_of_row(coincidences(i)%row + 4)))
                hinges(n) = hinge_type(vector%first, vector%second, vector%row, vector%s1, vector%s2, x%a, y%a, y%b)
            end associate
        end do

    contains

        !> True for the ground and for bodies that have a rotation in space.
        pure logical function can_rotate(body)
            integer, intent(in) :: body

            can_rotate = body == 0 .or. pose(body)%n_turn == 4
        end function can_rotate

        !> True if a perpendicularity row is that of two directions, on the same two bodies as a pair of coincident points, without
        !> a function of time.
        pure logical function fits(vector, perpendicular)
            type(point_vector_type), intent(in) :: vector
            type(perpendicular_type), intent(in) :: perpendicular

            fits = perpendicular%first == vector%first .and. perpendicular%second == vector%second .and. &
                perpendicular%motion == 0 .and. .not. perpendicular%is_point .and. .not. abs(perpendicular%c) > 0.0_wp
        end function fits
    end subroutine gather_hinges

    !> Add the terms of every hinge. Other entries of C remain zero, as allocated.
    pure subroutine evaluate_hinges(hinges, need, pose, terms)
        type(hinge_type), intent(in) :: hinges(:)
        integer, intent(in) :: need
        type(pose_type), intent(in) :: pose(0:)
        type(terms_type), intent(inout) :: terms
        integer :: i

        if (iand(need, need_phi) /= 0) then
            do i = 1, size(hinges)
                associate (hinge => hinges(i))
                    call set_phi(hinge, pose(hinge%first), pose(hinge%second), terms%phi(hinge%row:hinge%row + 4))
                end associate
            end do
        end if
        if (iand(need, need_jacobian) /= 0) then
            do i = 1, size(hinges)
                associate (hinge => hinges(i))
                    call put_rows(hinge, pose(hinge%first), pose(hinge%second), size(terms%jacobian, 1), &
                        size(terms%jacobian, 2), terms%jacobian)
                end associate
            end do
        end if
        if (iand(need, need_gamma) /= 0) then
            do i = 1, size(hinges)
                associate (hinge => hinges(i))
                    call set_gamma(hinge, pose(hinge%first), pose(hinge%second), terms%gamma(hinge%row:hinge%row + 4))
                end associate
            end do
        end if
    end subroutine evaluate_hinges

    !> Set the residuals of the five rows.
    pure subroutine set_phi(hinge, one, two, phi)
        type(hinge_type), intent(in) :: hinge
        type(pose_type), intent(in) :: one, two
        real(wp), intent(out) :: phi(5)
        real(wp) :: v1(3), v2(3), x(3), y(3), z(3)
        integer :: k

        call turn(one%a(:, :, 0), hinge%s1, v1)
        call turn(two%a(:, :, 0), hinge%s2, v2)
        call turn(one%a(:, :, 0), hinge%x, x)
        call turn(one%a(:, :, 0), hinge%y, y)
        call turn(two%a(:, :, 0), hinge%z, z)
        do k = 1, 3
            phi(k) = two%r(k, 0) - one%r(k, 0) + v2(k) - v1(k)
        end do
        phi(4) = dot3(x, z)
        phi(5) = dot3(y, z)
    end subroutine set_phi

    !> Set the five rows of C.
    pure subroutine put_rows(hinge, one, two, m, width, jacobian)
        type(hinge_type), intent(in) :: hinge
        type(pose_type), intent(in) :: one, two
        !> Shape of the stored matrix C, which may be compressed.
        integer, intent(in) :: m, width
        real(wp), intent(inout) :: jacobian(m, width)
        real(wp) :: b(3, 4), of_x(4), of_y(4), x(3), y(3), z(3)
        integer :: j, k

        associate (row => hinge%row)
            if (one%n_turn > 0) then
                call turn(two%a(:, :, 0), hinge%z, z)
                b = b_matrix(one%p(:, 0), hinge%s1)
                of_x = b_row(one%p(:, 0), hinge%x, z)
                of_y = b_row(one%p(:, 0), hinge%y, z)
                do k = 0, 2
                    jacobian(row + k, one%place_column + k) = -1.0_wp
                end do
                do j = 0, 3
                    do k = 0, 2
                        jacobian(row + k, one%turn_column + j) = -b(k + 1, j + 1)
                    end do
                    jacobian(row + 3, one%turn_column + j) = of_x(j + 1)
                    jacobian(row + 4, one%turn_column + j) = of_y(j + 1)
                end do
            end if
            if (two%n_turn > 0) then
                call turn(one%a(:, :, 0), hinge%x, x)
                call turn(one%a(:, :, 0), hinge%y, y)
                b = b_matrix(two%p(:, 0), hinge%s2)
                of_x = b_row(two%p(:, 0), hinge%z, x)
                of_y = b_row(two%p(:, 0), hinge%z, y)
                do k = 0, 2
                    jacobian(row + k, two%place_column + k) = 1.0_wp
                end do
                do j = 0, 3
                    do k = 0, 2
                        jacobian(row + k, two%turn_column + j) = b(k + 1, j + 1)
                    end do
                    jacobian(row + 3, two%turn_column + j) = of_x(j + 1)
                    jacobian(row + 4, two%turn_column + j) = of_y(j + 1)
                end do
            end if
        end associate
    end subroutine put_rows

    !> Second derivatives of Phi along the motion for qdd = 0.
    pure subroutine set_gamma(hinge, one, two, gamma)
        type(hinge_type), intent(in) :: hinge
        type(pose_type), intent(in) :: one, two
        real(wp), intent(out) :: gamma(5)
        real(wp), dimension(3) :: v1, v2, x, x1, x2, y, y1, y2, z, z1, z2
        integer :: k

        call turn(one%a(:, :, 2), hinge%s1, v1)
        call turn(two%a(:, :, 2), hinge%s2, v2)
        call turn(one%a(:, :, 0), hinge%x, x)
        call turn(one%a(:, :, 1), hinge%x, x1)
        call turn(one%a(:, :, 2), hinge%x, x2)
        call turn(one%a(:, :, 0), hinge%y, y)
        call turn(one%a(:, :, 1), hinge%y, y1)
        call turn(one%a(:, :, 2), hinge%y, y2)
        call turn(two%a(:, :, 0), hinge%z, z)
        call turn(two%a(:, :, 1), hinge%z, z1)
        call turn(two%a(:, :, 2), hinge%z, z2)
        do k = 1, 3
            gamma(k) = v2(k) - v1(k)
        end do
        gamma(4) = dot3(x2, z) + 2*dot3(x1, z1) + dot3(x, z2)
        gamma(5) = dot3(y2, z) + 2*dot3(y1, z1) + dot3(y, z2)
    end subroutine set_gamma

    pure real(wp) function dot3(x, y)
        real(wp), intent(in) :: x(3), y(3)

        dot3 = x(1)*y(1) + x(2)*y(2) + x(3)*y(3)
    end function dot3
end module tandem_mechanism_hinge
