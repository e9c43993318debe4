! SPDX-License-Identifier: MIT
!> Tests of the loops of explicit steps: independence of the rows of C, and updates of B by corrections of the position.
module test_null_space_kernels
    use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
    use asserts, only: check_below, check_count, check_true
    use differences, only: random_vector
    use svd, only: singular_values
    use tandem, only: wp
    use tandem_kinds, only: lane, short
    use tandem_linalg_elimination, only: elimination_type
    use tandem_linalg_kernels, only: add, copy
    use tandem_chart_dense_position, only: correct, place, position_type
    use tandem_linalg_gram, only: invert_gram, multiply_columns, multiply_rows, refine_inverse, set_directions, smallest_gram_pivot
    use tandem_linalg_products, only: invert_definite, multiply_first
    use tandem_chart_dense_free_motion, only: free_motion_type
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_null_space_kernels

contains

    !> The suite.
    subroutine collect_null_space_kernels(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('independence-is-that-of-the-singular-values', test_independence), &
            new_unittest('independence-falls-with-the-angle-between-two-rows', test_parallel), &
            new_unittest('a-correction-teaches-the-secant-condition', test_secant), &
            new_unittest('corrections-do-not-depend-on-the-units-of-rows', test_units), &
            new_unittest('a-place-is-the-origin-less-its-correction', test_place), &
            new_unittest('what-rounding-takes-from-a-place', test_rounding), &
            new_unittest('the-gram-matrix-of-the-first-rows-is-inverted', test_gram), &
            new_unittest('a-gram-matrix-of-dependent-rows-is-refused', test_no_gram), &
            new_unittest('a-refinement-squares-what-an-inverse-lacks', test_refinement), &
            new_unittest('an-inverse-of-elsewhere-is-not-refined', test_no_refinement), &
            new_unittest('products-with-padding', test_products)]
    end subroutine collect_null_space_kernels

    !> 1/|C+| of unit rows in scaled unknowns, from the singular values and from the elimination.
    subroutine measure(c, scale, expected, independence, stat)
        real(wp), intent(in) :: c(:, :), scale(:)
        real(wp), intent(out) :: expected, independence
        integer, intent(out) :: stat
        type(elimination_type) :: elimination
        type(free_motion_type) :: free_motion
        real(wp) :: rows(size(c, 1), size(c, 2))
        integer :: i

        do i = 1, size(c, 1)
            rows(i, :) = c(i, :)*scale/norm2(c(i, :)*scale)
        end do
        expected = 1.0_wp/sqrt(sum(1.0_wp/singular_values(rows)**2))
        call elimination%allocate(size(c, 1), size(c, 2))
        call free_motion%allocate(size(c, 1), size(c, 2), scale)
        call elimination%eliminate(c, scale, stat)
        call free_motion%load(elimination)
        call free_motion%find_independence(elimination, independence)
    end subroutine measure

    subroutine test_independence(error)
        type(error_type), allocatable, intent(out) :: error
        !> Rows and columns of matrices for LAPACK.
        integer, parameter :: large(2, 3) = reshape([66, 68, 80, 100, 4, 70], [2, 3])
        integer :: i, m, n, seed

        seed = 3
        do n = 2, 20, 3
            do m = 1, n
                call check_independence(m, n, seed, error)
                if (allocated(error)) return
            end do
        end do
        do i = 1, size(large, 2)
            call check_independence(large(1, i), large(2, i), seed, error)
            if (allocated(error)) return
        end do
    end subroutine test_independence

    !> Independence of a random matrix, whose rows and columns have units over some decades.
    subroutine check_independence(m, n, seed, error)
        integer, intent(in) :: m, n
        integer, intent(inout) :: seed
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: c(m, n), scale(n), expected, independence
        integer :: i, j, stat

        do j = 1, n
            call random_vector(seed, c(:, j))
        end do
        call random_vector(seed, scale)
        scale = 10.0_wp**(2*scale)
        do i = 1, m
            c(i, :) = c(i, :)*10.0_wp**modulo(i, 4)/scale
        end do
        call measure(c, scale, expected, independence, stat)
        call check_count(error, stat, 0, 'stat')
        call check_below(error, abs(independence/expected - 1.0_wp), 1.0e-9_wp, 'relative error of the independence')
    end subroutine check_independence

    !> Two rows at a small angle: singular values 2^(1/2) and angle/2^(1/2), nearly.
    subroutine test_parallel(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: angle, expected, independence
        integer :: k, stat

        do k = 1, 8
            angle = 10.0_wp**(-k)
            call measure(reshape([1.0_wp, cos(angle), 0.0_wp, sin(angle), 0.0_wp, 0.0_wp], [2, 3]), spread(1.0_wp, 1, 3), &
                expected, independence, stat)
            call check_below(error, abs(independence/(angle/sqrt(2.0_wp)) - 1.0_wp), 0.01_wp, 'relative error of the independence')
        end do
    end subroutine test_parallel

    !> After a correction that has changed Phi by -y, B y is the change of u by it; the rest of B changes as little as possible.
    subroutine test_secant(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: n = 9, nh = 3
        real(wp) :: u_basis(n, short), origin(n), increment(n), q(n)
        real(wp) :: b(short, short), before(short, short), u(short), old(short), gain(nh), y(nh), weight(short)
        real(wp) :: first(nh), second(nh), last_phi(short, 2), w(short), across(nh)
        integer :: j, seed

        seed = 5
        b = 0.0_wp
        u = 0.0_wp
        last_phi = 0.0_wp
        weight = 1.0_wp
        do j = 1, nh
            call random_vector(seed, b(:nh, j))
        end do
        call random_vector(seed, first)
        call random_vector(seed, second)
        call random_vector(seed, weight(:nh))
        weight = 2.0_wp + weight
        second = 0.1_wp*second
        before = b
        call random_vector(seed, origin)
        call random_vector(seed, increment)
        do j = 1, short
            call random_vector(seed, u_basis(:, j))
        end do
        call correct(short, nh, first, weight, .false., last_phi, b, u, w)
        call check_below(error, maxval(abs(b - before)), 0.0_wp, 'change of B by a correction that does not teach')
        call check_below(error, maxval(abs(u(:nh) - matmul(b(:nh, :nh), first))), 1.0e-15_wp, 'u - B Phi')
        gain = u(:nh)
        old = u
        call correct(short, nh, second, weight, .true., last_phi, b, u, w)
        call place(n, short, u_basis, u, origin, increment, q)
        call check_below(error, maxval(abs(q - (origin + increment - matmul(u_basis, u)))), 1.0e-14_wp, 'q of the corrected u')
        y = first - second
        call check_below(error, maxval(abs(matmul(b(:nh, :nh), y) - gain)), 1.0e-14_wp, 'B y - the gain of u')
        call check_below(error, maxval(abs(u(:nh) - old(:nh) - matmul(b(:nh, :nh), second))), 1.0e-14_wp, 'the new B corrects')
        ! Across y in the weighted product.
        across = [y(2)*weight(2)**2, -y(1)*weight(1)**2, 0.0_wp]
        call check_below(error, maxval(abs(matmul(b(:nh, :nh) - before(:nh, :nh), across))), 1.0e-14_wp, 'change of B across y')
        call check_below(error, maxval(abs(b(nh + 1:, :))) + maxval(abs(b(:, nh + 1:))) + abs(u(short)), 0.0_wp, 'the padding')
    end subroutine test_secant

    !> Rows in other units, with matching weights and B, give the same displacements: u in these units.
    subroutine test_units(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: nh = 4
        real(wp), parameter :: unit(nh) = [1.0_wp, 1.0e3_wp, 1.0e-6_wp, 50.0_wp]
        real(wp) :: b(short, short, 2), u(short, 2), weight(short, 2), phi(nh, 3), last_phi(short, 2), w(short)
        integer :: i, j, k, seed

        seed = 6
        do j = 1, nh
            call random_vector(seed, b(:, j, 1))
        end do
        do j = 1, 3
            call random_vector(seed, phi(:, j))
            phi(:, j) = phi(:, j)*10.0_wp**(-2*j)
        end do
        do j = 1, nh
            ! u_i moves q by U u, whose columns are gradients: it is in reciprocal units.
            b(:, j, 2) = b(:, j, 1)/(unit*unit(j))
        end do
        weight(:, 1) = 1.0_wp
        weight(:, 2) = 1.0_wp/unit
        u = 0.0_wp
        do k = 1, 2
            last_phi = 0.0_wp
            do i = 1, 3
                if (k == 1) call correct(short, nh, phi(:, i), weight(:, k), i > 1, last_phi, b(:, :, k), u(:, k), w)
                if (k == 2) call correct(short, nh, phi(:, i)*unit, weight(:, k), i > 1, last_phi, b(:, :, k), u(:, k), w)
            end do
        end do
        call check_below(error, maxval(abs(u(:, 2)*unit - u(:, 1)))/maxval(abs(u(:, 1))), 1.0e-13_wp, 'relative difference of u')
    end subroutine test_units

    !> The gap of a shifted position, and the decision that it exceeds rounding.
    subroutine test_rounding(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: u_basis(13, 8), u(8), origin(13), increment(13), q(13), scale(13), left(13), off(13)
        integer :: j, n, seed, width
        logical :: is_rounding
        type(position_type) :: position

        seed = 10
        do j = 1, 8
            call random_vector(seed, u_basis(:, j))
        end do
        call random_vector(seed, u)
        call random_vector(seed, origin)
        call random_vector(seed, increment)
        scale = 1.0_wp
        do n = 1, 13
            do width = 0, 8, short
                q = origin + increment - matmul(u_basis(:, :width), u(:width))
                left = 2.0_wp
                call find(q)
                call check_below(error, maxval(abs(left(:n))), 4*epsilon(1.0_wp), 'rounding')
                call check_below(error, sum(abs(left(n + 1:) - 2.0_wp)), 0.0_wp, 'what is behind the remainder')
                call check_true(error, is_rounding, 'rounding is that')
                do j = 1, n
                    off = q
                    off(j) = off(j) + 1.0e-10_wp
                    call find(off)
                    call check_below(error, abs(left(j) + 1.0e-10_wp), 1.0e-14_wp, 'the gap')
                    call check_true(error, .not. is_rounding, 'a gap is no rounding')
                end do
                if (allocated(error)) return
            end do
        end do

    contains

        subroutine find(place)
            real(wp), intent(in) :: place(:)

            call position%allocate(n, width, .false., 1.0e-12_wp, 1.0e-12_wp, 1.0e-12_wp)
            position%u_basis(:, :) = u_basis(:n, :width)
            position%u(:) = u(:width)
            call position%find_remainder(origin(:n), increment(:n), place(:n), scale(:n), left(:n), is_rounding)
        end subroutine find
    end subroutine test_rounding

    !> U, the inverse of Phi_q U and the weights, by plain formulas; other rows of C follow those of Phi.
    subroutine test_gram(error)
        type(error_type), allocatable, intent(out) :: error

        call check_gram(.false., error)
        if (.not. allocated(error)) call check_gram(.true., error)
    end subroutine test_gram

    !> U, the inverse of Phi_q U, and the weights, by loops or by LAPACK.
    subroutine check_gram(by_lapack, error)
        logical, intent(in) :: by_lapack
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: n = 13
        real(wp), allocatable :: c(:, :), u(:, :), gram(:, :), weight(:), pivots(:), column(:), unit(:, :)
        real(wp) :: q(n), scale(n)
        integer :: height, i, j, m, nh, seed, width
        logical :: can

        seed = 11
        call random_vector(seed, q)
        call random_vector(seed, scale)
        scale = 1.5_wp + scale
        do nh = 1, 9
            width = short*((nh + short - 1)/short)
            height = lane*((nh + 2 + lane - 1)/lane)
            m = nh + 2
            allocate (c(height, n), u(n, width), gram(width, width), weight(width), pivots(width), column(width), source=0.0_wp)
            do j = 1, n
                call random_vector(seed, c(:m, j))
            end do
            call set_directions(nh, c, q, scale, u, weight)
            if (by_lapack) then
                call multiply_first(nh, c, u, gram)
                call invert_definite(nh, smallest_gram_pivot, gram, pivots, can)
            else
                call invert_gram(nh, c, u, gram, pivots, column, can)
            end if
            call check_true(error, can, 'can')
            do i = 1, nh
                call check_below(error, maxval(abs(u(:, i) - scale**2*c(i, :))), 1.0e-14_wp, 'U')
                call check_below(error, abs(weight(i)*dot_product(abs(c(i, :)), max(abs(q), scale)) - 1.0_wp), 1.0e-14_wp, 'weight')
            end do
            unit = matmul(gram(:nh, :nh), matmul(c(:nh, :), u(:, :nh)))
            do i = 1, nh
                unit(i, i) = unit(i, i) - 1.0_wp
            end do
            call check_below(error, maxval(abs(unit)), 1.0e-10_wp, 'inverse times matrix')
            call check_below(error, sum(abs(u(:, nh + 1:))) + sum(abs(gram(nh + 1:, :))) + sum(abs(gram(:, nh + 1:))), 0.0_wp, &
                'the padding')
            if (allocated(error)) return
            deallocate (c, u, gram, weight, pivots, column)
        end do
    end subroutine check_gram

    subroutine test_no_gram(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: n = 6, nh = 3
        real(wp) :: c(lane, n), u(n, short), gram(short, short), weight(short), pivots(short), column(short), far, one(n)
        integer :: j, k, seed
        logical :: can

        seed = 12
        one = 1.0_wp
        do k = 1, 2
            c = 0.0_wp
            do j = 1, n
                call random_vector(seed, c(:nh, j))
            end do
            far = merge(1.0e-7_wp, 1.0e-3_wp, k == 1)
            c(3, :) = c(1, :) - c(2, :) + far*c(3, :)
            call set_directions(nh, c, one, one, u, weight)
            call invert_gram(nh, c, u, gram, pivots, column, can)
            call check_true(error, can .eqv. k == 2, 'can')
            call multiply_first(nh, c, u, gram)
            call invert_definite(nh, smallest_gram_pivot, gram, pivots, can)
            call check_true(error, can .eqv. k == 2, 'can, by LAPACK')
        end do
        c(2, 3) = ieee_value(1.0_wp, ieee_quiet_nan)
        call set_directions(nh, c, one, one, u, weight)
        call invert_gram(nh, c, u, gram, pivots, column, can)
        call check_true(error, .not. can, 'refused where C is not finite')
        call multiply_first(nh, c, u, gram)
        call invert_definite(nh, smallest_gram_pivot, gram, pivots, can)
        call check_true(error, .not. can, 'refused by LAPACK where C is not finite')
    end subroutine test_no_gram

    !> I - A B is its own square after the refinement B := B + B (I - A B), A = Phi_q U of another point.
    subroutine test_refinement(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: n = 9
        real(wp) :: c(2*lane, n), moved(2*lane, n), one(n), column(n), before(7, 7), after(7, 7)
        real(wp), allocatable :: u(:, :), b(:, :), product(:, :), residual(:, :), weight(:), pivots(:), work(:)
        real(wp) :: rest
        integer :: i, j, m, nh, seed, width
        logical :: can

        seed = 21
        one = 1.0_wp
        m = 8
        do nh = 1, 7
            width = short*((nh + short - 1)/short)
            allocate (u(n, width), b(width, width), product(width, width), residual(width, width), weight(width), &
                pivots(width), work(width))
            c = 0.0_wp
            do j = 1, n
                call random_vector(seed, c(:m, j))
                if (j <= m) c(j, j) = c(j, j) + 3.0_wp
            end do
            call set_directions(nh, c, one, one, u, weight)
            call invert_gram(nh, c, u, b, pivots, work, can)
            call check_true(error, can, 'can')
            moved = c
            do i = 1, m
                call random_vector(seed, column)
                moved(i, :) = moved(i, :) + 0.02_wp*column
            end do
            call set_lack(nh, moved, u, b, before)
            call refine_inverse(nh, moved, u, weight, b, product, residual, rest, can)
            call check_true(error, can, 'refined')
            call set_lack(nh, moved, u, b, after)
            call check_true(error, maxval(abs(before(:nh, :nh))) > 1.0e-3_wp, 'it has moved')
            call check_below(error, maxval(abs(after(:nh, :nh) - matmul(before(:nh, :nh), before(:nh, :nh)))), 1.0e-13_wp, 'square')
            call check_below(error, sum(abs(b(nh + 1:, :))) + sum(abs(b(:, nh + 1:))), 0.0_wp, 'the padding')
            ! In rows of weight 1.
            do i = 1, nh
                before(i, :nh) = before(i, :nh)*weight(i)/weight(:nh)
                after(i, :nh) = after(i, :nh)*weight(i)/weight(:nh)
            end do
            call check_below(error, abs(sqrt(rest) - maxval(abs(before(:nh, :nh)))), 1.0e-13_wp, 'what is left, by what was')
            call check_below(error, maxval(abs(after(:nh, :nh))), nh*rest + 1.0e-13_wp, 'what is left')
            if (allocated(error)) return
            deallocate (u, b, product, residual, weight, pivots, work)
        end do
    end subroutine test_refinement

    !> I - C U B of the first nh rows.
    pure subroutine set_lack(nh, c, u, b, lack)
        integer, intent(in) :: nh
        real(wp), intent(in) :: c(:, :), u(:, :), b(:, :)
        real(wp), intent(out) :: lack(:, :)
        integer :: i

        lack = 0.0_wp
        lack(:nh, :nh) = -matmul(matmul(c(:nh, :), u(:, :nh)), b(:nh, :nh))
        do i = 1, nh
            lack(i, i) = lack(i, i) + 1.0_wp
        end do
    end subroutine set_lack

    !> Far from its point, and if C is not finite, B is unchanged.
    subroutine test_no_refinement(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: n = 5, nh = 3
        real(wp) :: c(lane, n), u(n, short), b(short, short), kept(short, short), product(short, short), residual(short, short)
        real(wp) :: weight(short), pivots(short), work(short), one(n), rest
        integer :: j, seed
        logical :: can

        seed = 22
        one = 1.0_wp
        c = 0.0_wp
        do j = 1, n
            call random_vector(seed, c(:nh, j))
            if (j <= nh) c(j, j) = c(j, j) + 3.0_wp
        end do
        call set_directions(nh, c, one, one, u, weight)
        call invert_gram(nh, c, u, b, pivots, work, can)
        kept = b
        c(2, :) = 2*c(2, :)
        call refine_inverse(nh, c, u, weight, b, product, residual, rest, can)
        call check_true(error, .not. can, 'too far')
        call check_below(error, maxval(abs(b - kept)), 0.0_wp, 'as it was')
        c(2, 3) = ieee_value(1.0_wp, ieee_quiet_nan)
        call refine_inverse(nh, c, u, weight, b, product, residual, rest, can)
        call check_true(error, .not. can, 'not finite')
        call check_below(error, maxval(abs(b - kept)), 0.0_wp, 'as it was')
    end subroutine test_no_refinement

    !> The first rows of C y, and the first columns of B times x; copies of all lengths.
    subroutine test_products(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: c(11, 9), y(9), x(12), b(12, 12), z(12), to(13)
        integer :: j, m, n, nh, seed, width

        seed = 13
        do j = 1, 9
            call random_vector(seed, c(:, j))
        end do
        do j = 1, 12
            call random_vector(seed, b(:, j))
        end do
        call random_vector(seed, y)
        do m = 1, 11
            do n = 1, 9
                do nh = 1, m
                    width = short*((nh + short - 1)/short)
                    x = huge(1.0_wp)
                    call multiply_rows(m, n, nh, width, c(:m, :n), y(:n), x(:width))
                    call check_below(error, maxval(abs(x(:nh) - matmul(c(:nh, :n), y(:n)))), 1.0e-14_wp, 'C y')
                    call multiply_columns(nh, width, b(:width, :width), x(:width), z(:width))
                    call check_below(error, maxval(abs(z(:width) - matmul(b(:width, :nh), x(:nh)))), 1.0e-13_wp, 'B x')
                    if (allocated(error)) return
                end do
            end do
        end do
        do n = 0, 12
            to = 2.0_wp
            call copy(n, b(:n, 1), to(:n))
            call check_below(error, sum(abs(to(:n) - b(:n, 1))) + sum(abs(to(n + 1:) - 2.0_wp)), 0.0_wp, 'a copy')
            call add(n, b(:n, 1), b(:n, 2), to(:n))
            call check_below(error, sum(abs(to(:n) - (b(:n, 1) + b(:n, 2)))) + sum(abs(to(n + 1:) - 2.0_wp)), 0.0_wp, 'a sum')
        end do
    end subroutine test_products

    subroutine test_place(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: u_basis(13, 8), u(8), origin(13), increment(13), q(13), expected(13)
        integer :: j, n, seed, width

        seed = 9
        do j = 1, 8
            call random_vector(seed, u_basis(:, j))
        end do
        call random_vector(seed, u)
        call random_vector(seed, origin)
        call random_vector(seed, increment)
        do n = 1, 13
            do width = 0, 8, short
                q = 2.0_wp
                call place(n, width, u_basis(:n, :width), u(:width), origin(:n), increment(:n), q(:n))
                expected = origin + increment - matmul(u_basis(:, :width), u(:width))
                call check_below(error, maxval(abs(q(:n) - expected(:n))), 1.0e-14_wp, 'q - (origin + increment - U u)')
                call check_below(error, sum(abs(q(n + 1:) - 2.0_wp)), 0.0_wp, 'what is behind q')
            end do
        end do
    end subroutine test_place
end module test_null_space_kernels
