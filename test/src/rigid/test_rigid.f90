! SPDX-License-Identifier: MIT
!> Tests of the calculus of Euler parameters for derivatives of models: C, K, T, the rate of A, and the products without matrices,
!> all at random p that are not unit ones, also for several bodies at once. Suite euler_parameters has A, E, G and B.
module test_rigid
    use, intrinsic :: ieee_arithmetic, only: ieee_is_nan, ieee_quiet_nan, ieee_value
    use asserts, only: check_below, check_count
    use differences, only: random_vector
    use tandem, only: wp
    use tandem_kinds, only: lane
    use tandem_rigid_angle_lanes, only: set_cosines_and_sines
    use tandem_rigid_euler_lanes, only: set_dots, set_gradient_rows, set_gradients, set_rotation_rates, set_rotations, take_four, &
        turn_each
    use tandem_rigid_euler_parameters, only: b_matrix, b_product, b_row, c_matrix, e_matrix, g_matrix, g_product, &
        g_sandwich, g_transposed_product, k_matrix, rotation, rotation_rate, set_rotational_mass, skew, t_matrix
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_rigid

    !> Number of random points.
    integer, parameter :: n_points = 20
    !> Sums of some twenty products of numbers below two: a hundred roundings of size four.
    real(wp), parameter :: rounding = 1.0e-13_wp

    !> Arguments of one comparison.
    type :: point_type
        real(wp) :: p(4) = 0.0_wp, x(4) = 0.0_wp, a(3) = 0.0_wp, b(3) = 0.0_wp
    end type point_type

contains

    !> The suite.
    subroutine collect_rigid(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('c-is-the-derivative-of-a-vector-turned-back', test_c_derivative), &
            new_unittest('c-has-its-closed-form', test_c_form), &
            new_unittest('b-has-its-closed-form', test_b_form), &
            new_unittest('k-is-the-derivative-of-b-transposed', test_k_derivative), &
            new_unittest('k-has-its-closed-form-and-is-symmetric', test_k_form), &
            new_unittest('t-is-the-derivative-of-g-transposed', test_t_derivative), &
            new_unittest('t-has-its-closed-form', test_t_form), &
            new_unittest('rotation-rate-is-the-derivative-of-the-rotation', test_rate_derivative), &
            new_unittest('rotation-rate-is-made-of-e-and-g', test_rate_form), &
            new_unittest('rotation-rate-turns-vectors-as-b-does', test_rate_products), &
            new_unittest('derivatives-of-b-c-and-g-along-p', test_linear_in_p), &
            new_unittest('derivative-of-b-transposed-by-its-vector-is-c', test_b_by_vector), &
            new_unittest('e-and-g-exchange-their-arguments', test_exchange), &
            new_unittest('products-without-matrices-are-those-with-matrices', test_products), &
            new_unittest('sandwich-is-the-product-of-three-matrices', test_sandwich), &
            new_unittest('several-bodies-at-once-are-as-one-by-one', test_lanes), &
            new_unittest('cosines-and-sines-of-several-angles', test_angles)]
    end subroutine collect_rigid

    !> The next random arguments; |p| varies between 0 and 3.
    type(point_type) function next_point(seed) result(z)
        integer, intent(inout) :: seed

        call random_vector(seed, z%p)
        call random_vector(seed, z%x)
        call random_vector(seed, z%a)
        call random_vector(seed, z%b)
        z%p = 1.5_wp*z%p
    end function next_point

    !> A unit vector of R4.
    pure function unit(j) result(e)
        integer, intent(in) :: j
        real(wp) :: e(4)

        e = 0.0_wp
        e(j) = 1.0_wp
    end function unit

    !> 2 [(e0 I + s ~e) a, e a' - s (e0 I + s ~e) ~a]: B for s = 1, C for s = -1.
    pure function closed_form(p, a, s) result(form)
        real(wp), intent(in) :: p(4), a(3), s
        real(wp) :: form(3, 4), turn(3, 3)
        integer :: i

        turn = s*skew(p(2:4))
        do i = 1, 3
            turn(i, i) = turn(i, i) + p(1)
        end do
        form(:, 1) = matmul(turn, a)
        form(:, 2:4) = spread(p(2:4), 2, 3)*spread(a, 1, 3) - s*matmul(turn, skew(a))
        form = 2*form
    end function closed_form

    !> A is quadratic in p, so that central differences have no error but rounding.
    subroutine test_c_derivative(error)
        type(error_type), allocatable, intent(out) :: error
        type(point_type) :: z
        real(wp) :: difference(3, 4)
        integer :: i, j, seed

        seed = 101
        do i = 1, n_points
            z = next_point(seed)
            do j = 1, 4
                difference(:, j) = matmul(z%a, rotation(z%p + 0.5_wp*unit(j)) - rotation(z%p - 0.5_wp*unit(j)))
            end do
            call check_below(error, maxval(abs(c_matrix(z%p, z%a) - difference)), rounding, 'C - (A'' a)_p')
        end do
    end subroutine test_c_derivative

    subroutine test_c_form(error)
        type(error_type), allocatable, intent(out) :: error
        type(point_type) :: z
        integer :: i, seed

        seed = 102
        do i = 1, n_points
            z = next_point(seed)
            call check_below(error, maxval(abs(c_matrix(z%p, z%a) - closed_form(z%p, z%a, -1.0_wp))), rounding, 'C')
        end do
    end subroutine test_c_form

    subroutine test_b_form(error)
        type(error_type), allocatable, intent(out) :: error
        type(point_type) :: z
        integer :: i, seed

        seed = 103
        do i = 1, n_points
            z = next_point(seed)
            call check_below(error, maxval(abs(b_matrix(z%p, z%a) - closed_form(z%p, z%a, 1.0_wp))), rounding, 'B')
        end do
    end subroutine test_b_form

    subroutine test_k_derivative(error)
        type(error_type), allocatable, intent(out) :: error
        type(point_type) :: z
        real(wp) :: difference(4, 4)
        integer :: i, j, seed

        seed = 104
        do i = 1, n_points
            z = next_point(seed)
            do j = 1, 4
                difference(:, j) = matmul(z%b, b_matrix(z%p + 0.5_wp*unit(j), z%a) - b_matrix(z%p - 0.5_wp*unit(j), z%a))
            end do
            call check_below(error, maxval(abs(k_matrix(z%a, z%b) - difference)), rounding, 'K - (B'' b)_p')
        end do
    end subroutine test_k_derivative

    !> K = 2 [a'b, a' ~b; ~a b, a b' + b a' - (a'b) I].
    subroutine test_k_form(error)
        type(error_type), allocatable, intent(out) :: error
        type(point_type) :: z
        real(wp) :: k(4, 4), form(4, 4)
        integer :: i, j, seed

        seed = 105
        do i = 1, n_points
            z = next_point(seed)
            form(1, 1) = dot_product(z%a, z%b)
            form(1, 2:4) = matmul(z%a, skew(z%b))
            form(2:4, 1) = matmul(skew(z%a), z%b)
            form(2:4, 2:4) = spread(z%a, 2, 3)*spread(z%b, 1, 3) + spread(z%b, 2, 3)*spread(z%a, 1, 3)
            do j = 2, 4
                form(j, j) = form(j, j) - dot_product(z%a, z%b)
            end do
            k = k_matrix(z%a, z%b)
            call check_below(error, maxval(abs(k - 2*form)), rounding, 'K')
            call check_below(error, maxval(abs(k - transpose(k))), rounding, 'asymmetry of K')
        end do
    end subroutine test_k_form

    subroutine test_t_derivative(error)
        type(error_type), allocatable, intent(out) :: error
        type(point_type) :: z
        real(wp) :: difference(4, 4)
        integer :: i, j, seed

        seed = 106
        do i = 1, n_points
            z = next_point(seed)
            do j = 1, 4
                difference(:, j) = matmul(z%a, g_matrix(z%p + 0.5_wp*unit(j)) - g_matrix(z%p - 0.5_wp*unit(j)))
            end do
            call check_below(error, maxval(abs(t_matrix(z%a) - difference)), rounding, 'T - (G'' a)_p')
        end do
    end subroutine test_t_derivative

    !> T = [0, -a'; a, -~a].
    subroutine test_t_form(error)
        type(error_type), allocatable, intent(out) :: error
        type(point_type) :: z
        real(wp) :: form(4, 4)
        integer :: i, seed

        seed = 107
        do i = 1, n_points
            z = next_point(seed)
            form(1, 1) = 0.0_wp
            form(1, 2:4) = -z%a
            form(2:4, 1) = z%a
            form(2:4, 2:4) = -skew(z%a)
            call check_below(error, maxval(abs(t_matrix(z%a) - form)), 0.0_wp, 'T')
        end do
    end subroutine test_t_form

    !> M(p, x) is dA/dt for pd = x.
    subroutine test_rate_derivative(error)
        type(error_type), allocatable, intent(out) :: error
        type(point_type) :: z
        integer :: i, seed

        seed = 108
        do i = 1, n_points
            z = next_point(seed)
            call check_below(error, maxval(abs(rotation_rate(z%p, z%x) - rotation(z%p + 0.5_wp*z%x) + &
                rotation(z%p - 0.5_wp*z%x))), rounding, 'M - A_p x')
        end do
    end subroutine test_rate_derivative

    !> M(p, x) = E(x) G(p)' + E(p) G(x)'.
    subroutine test_rate_form(error)
        type(error_type), allocatable, intent(out) :: error
        type(point_type) :: z
        integer :: i, seed

        seed = 109
        do i = 1, n_points
            z = next_point(seed)
            call check_below(error, maxval(abs(rotation_rate(z%p, z%x) - matmul(e_matrix(z%x), transpose(g_matrix(z%p))) - &
                matmul(e_matrix(z%p), transpose(g_matrix(z%x))))), rounding, 'M')
        end do
    end subroutine test_rate_form

    !> M(p, x) a = B(p, a) x and N(p, x) a = M(p, x)' a = C(p, a) x.
    subroutine test_rate_products(error)
        type(error_type), allocatable, intent(out) :: error
        type(point_type) :: z
        integer :: i, seed

        seed = 110
        do i = 1, n_points
            z = next_point(seed)
            associate (m => rotation_rate(z%p, z%x))
                call check_below(error, maxval(abs(matmul(m, z%a) - matmul(b_matrix(z%p, z%a), z%x))), rounding, 'M a - B x')
                call check_below(error, maxval(abs(matmul(z%a, m) - matmul(c_matrix(z%p, z%a), z%x))), rounding, 'N a - C x')
            end associate
        end do
    end subroutine test_rate_products

    !> (B(p, a) x)_p = B(x, a), (C(p, a) x)_p = C(x, a), (G(p) x)_p = -G(x).
    subroutine test_linear_in_p(error)
        type(error_type), allocatable, intent(out) :: error
        type(point_type) :: z
        real(wp) :: b_x(3, 4), c_x(3, 4), g_x(3, 4)
        integer :: i, j, seed

        seed = 111
        do i = 1, n_points
            z = next_point(seed)
            do j = 1, 4
                associate (plus => z%p + 0.5_wp*unit(j), minus => z%p - 0.5_wp*unit(j))
                    b_x(:, j) = matmul(b_matrix(plus, z%a) - b_matrix(minus, z%a), z%x)
                    c_x(:, j) = matmul(c_matrix(plus, z%a) - c_matrix(minus, z%a), z%x)
                    g_x(:, j) = matmul(g_matrix(plus) - g_matrix(minus), z%x)
                end associate
            end do
            call check_below(error, maxval(abs(b_x - b_matrix(z%x, z%a))), rounding, '(B(p, a) x)_p - B(x, a)')
            call check_below(error, maxval(abs(c_x - c_matrix(z%x, z%a))), rounding, '(C(p, a) x)_p - C(x, a)')
            call check_below(error, maxval(abs(g_x + g_matrix(z%x))), rounding, '(G(p) x)_p + G(x)')
        end do
    end subroutine test_linear_in_p

    !> (B(p, a)' b)_a = C(p, b)'.
    subroutine test_b_by_vector(error)
        type(error_type), allocatable, intent(out) :: error
        type(point_type) :: z
        real(wp) :: difference(4, 3), e(4)
        integer :: i, j, seed

        seed = 112
        do i = 1, n_points
            z = next_point(seed)
            do j = 1, 3
                e = unit(j)
                difference(:, j) = matmul(z%b, b_matrix(z%p, z%a + 0.5_wp*e(:3)) - b_matrix(z%p, z%a - 0.5_wp*e(:3)))
            end do
            call check_below(error, maxval(abs(difference - transpose(c_matrix(z%p, z%b)))), rounding, '(B'' b)_a - C''')
        end do
    end subroutine test_b_by_vector

    !> E(p) G(x)' = E(x) G(p)'.
    subroutine test_exchange(error)
        type(error_type), allocatable, intent(out) :: error
        type(point_type) :: z
        integer :: i, seed

        seed = 113
        do i = 1, n_points
            z = next_point(seed)
            call check_below(error, maxval(abs(matmul(e_matrix(z%p), transpose(g_matrix(z%x))) - &
                matmul(e_matrix(z%x), transpose(g_matrix(z%p))))), rounding, 'E(p) G(x)'' - E(x) G(p)''')
        end do
    end subroutine test_exchange

    subroutine test_products(error)
        type(error_type), allocatable, intent(out) :: error
        type(point_type) :: z
        integer :: i, seed

        seed = 114
        do i = 1, n_points
            z = next_point(seed)
            call check_below(error, maxval(abs(g_product(z%p, z%x) - matmul(g_matrix(z%p), z%x))), rounding, 'G x')
            call check_below(error, maxval(abs(g_transposed_product(z%p, z%a) - matmul(z%a, g_matrix(z%p)))), rounding, 'G'' a')
            call check_below(error, maxval(abs(b_product(z%p, z%a, z%x) - matmul(b_matrix(z%p, z%a), z%x))), rounding, 'B x')
            call check_below(error, maxval(abs(b_row(z%p, z%a, z%b) - matmul(z%b, b_matrix(z%p, z%a)))), rounding, 'b'' B')
        end do
    end subroutine test_products

    !> G(p)' diag(j) G(x).
    subroutine test_sandwich(error)
        type(error_type), allocatable, intent(out) :: error
        type(point_type) :: z
        real(wp) :: mass(6, 7), block(4, 4)
        integer :: i, seed

        seed = 115
        do i = 1, n_points
            z = next_point(seed)
            call check_below(error, maxval(abs(g_sandwich(z%p, z%a, z%x) - &
                matmul(transpose(g_matrix(z%p)), spread(z%a, 2, 4)*g_matrix(z%x)))), rounding, 'G'' J G')
            mass = 1.0_wp
            call set_rotational_mass(z%p, z%a, size(mass, 1), mass(2, 3))
            block = 4*matmul(transpose(g_matrix(z%p)), spread(z%a, 2, 4)*g_matrix(z%p))
            call check_below(error, maxval(abs(mass(2:5, 3:6) - block)), 4*rounding, 'the mass matrix of a turning body')
            mass(2:5, 3:6) = 1.0_wp
            call check_below(error, maxval(abs(mass - 1.0_wp)), 0.0_wp, 'what is around it')
        end do
    end subroutine test_sandwich

    !> Each of several bodies has the results of a single one.
    subroutine test_lanes(error)
        type(error_type), allocatable, intent(out) :: error
        type(point_type) :: z(lane)
        real(wp), dimension(lane, 3, 3) :: turns, rates
        real(wp) :: a(lane, 3), b(lane, 3), gradients(lane, 3, 4), p(lane, 4), rows(lane, 4), v(lane, 3), x(lane, 4), q(9*lane)
        real(wp) :: dots(lane)
        integer :: i, l, seed

        seed = 116
        do i = 1, n_points
            q = huge(1.0_wp)
            do l = 1, lane
                z(l) = next_point(seed)
                ! Bodies in an order of their own.
                q(9*modulo(3*l, lane) + 3:9*modulo(3*l, lane) + 6) = z(l)%p
                x(l, :) = z(l)%x
                a(l, :) = z(l)%a
                b(l, :) = z(l)%b
            end do
            call take_four([(9*modulo(3*l, lane), l=1, lane)], 2, size(q), q, p)
            call set_rotations(p, turns)
            call set_rotation_rates(p, x, rates)
            call turn_each(rates, a, v)
            call set_gradients(p, a, gradients)
            call set_gradient_rows(p, a, b, rows)
            call set_dots(a, b, dots)
            do l = 1, lane
                call check_below(error, maxval(abs(turns(l, :, :) - rotation(z(l)%p))), rounding, 'A')
                call check_below(error, maxval(abs(rates(l, :, :) - rotation_rate(z(l)%p, z(l)%x))), rounding, 'M')
                call check_below(error, maxval(abs(v(l, :) - matmul(rotation_rate(z(l)%p, z(l)%x), z(l)%a))), rounding, 'M a')
                call check_below(error, maxval(abs(gradients(l, :, :) - b_matrix(z(l)%p, z(l)%a))), rounding, 'B')
                call check_below(error, maxval(abs(rows(l, :) - matmul(z(l)%b, b_matrix(z(l)%p, z(l)%a)))), rounding, 'b'' B')
                call check_below(error, abs(dots(l) - dot_product(z(l)%a, z(l)%b)), rounding, 'a''b')
            end do
        end do
    end subroutine test_lanes

    !> Against the intrinsic functions: small and large angles, both sides of multiples of an eighth of a turn, and values that are
    !> not finite.
    subroutine test_angles(error)
        type(error_type), allocatable, intent(out) :: error
        !> Two roundings of the last digit.
        real(wp), parameter :: last_digits = 4.5e-16_wp
        real(wp) :: x(lane), c(lane), s(lane)
        integer :: i, l, seed

        seed = 117
        do i = -3000, 3000
            call random_vector(seed, x)
            do l = 1, lane
                select case (l)
                case (1)
                    x(l) = i*acos(-1.0_wp)/4
                case (2)
                    x(l) = i*acos(-1.0_wp)/4*(1 + epsilon(1.0_wp))
                case (3)
                    x(l) = 1.0e-9_wp*x(l)
                case (4)
                    x(l) = 1.0e5_wp*x(l)
                case default
                    x(l) = 10*x(l)
                end select
            end do
            if (i == 3000) x(1) = 1.0e15_wp
            call set_cosines_and_sines(x, c, s)
            call check_below(error, maxval(abs(c - cos(x))), last_digits, 'cosines')
            call check_below(error, maxval(abs(s - sin(x))/max(min(abs(x), 1.0_wp), tiny(1.0_wp))), 100*last_digits, 'sines')
            call check_below(error, maxval(abs(s - sin(x))), last_digits, 'sines')
        end do
        x = 0.0_wp
        x(2) = ieee_value(1.0_wp, ieee_quiet_nan)
        call set_cosines_and_sines(x, c, s)
        call check_count(error, count(ieee_is_nan(c) .and. ieee_is_nan(s)), 1, 'angles that are none')
        call check_below(error, maxval(abs(pack(c, .not. ieee_is_nan(c)) - 1)), 0.0_wp, 'cosines of zero')
    end subroutine test_angles
end module test_rigid
