! SPDX-License-Identifier: MIT
!> Tests of the systems over the degrees of freedom, of sums of rates, and of vector operations at every stage.
module test_small_systems
    use asserts, only: check_below, check_count, check_true
    use differences, only: random_vector
    use tandem, only: wp
    use tandem_linalg_kernels, only: add, add_product, add_transposed_product, are_same, is_finite, set_gram, set_product
    use tandem_linalg_complex_lu, only: complex_lu_type
    use tandem_linalg_lu, only: lu_type
    use tandem_linalg_small, only: factor_definite, solve_near_diagonal, substitute
    use tandem_kinds, only: lane
    use tandem_stepper_combination, only: combination_type
    use testdrive, only: error_type, new_unittest, unittest_type
    use, intrinsic :: ieee_arithmetic, only: ieee_positive_inf, ieee_quiet_nan, ieee_value
    implicit none (type, external)
    private

    public :: collect_small_systems

    !> Orders: those with copies of their own, and two without.
    integer, parameter :: orders(6) = [1, 2, 3, 4, 5, 11]

contains

    !> The suite.
    subroutine collect_small_systems(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('definite-systems-are-solved', test_definite), &
            new_unittest('singular-and-indefinite-ones-are-refused', test_not_definite), &
            new_unittest('systems-near-a-diagonal-are-solved', test_near_diagonal), &
            new_unittest('a-small-pivot-is-refused-where-it-is-met', test_small_pivot), &
            new_unittest('sums-of-rates-are-those-of-matmul', test_combination), &
            new_unittest('products-of-any-size-are-those-of-matmul', test_products), &
            new_unittest('rows-are-divided-by-a-factored-matrix', test_rows), &
            new_unittest('complex-systems-are-solved', test_complex), &
            new_unittest('vectors-of-any-length-are-added', test_add), &
            new_unittest('one-entry-makes-vectors-differ', test_same), &
            new_unittest('one-entry-makes-a-vector-infinite', test_finite)]
    end subroutine collect_small_systems

    !> Random entries in the first m rows, zeros below.
    subroutine get_random(seed, m, a)
        integer, intent(inout) :: seed
        integer, intent(in) :: m
        real(wp), intent(out) :: a(:, :)
        integer :: j

        a = 0.0_wp
        do j = 1, size(a, 2)
            call random_vector(seed, a(:m, j))
        end do
    end subroutine get_random

    subroutine test_definite(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), allocatable :: a(:, :), b(:), factors(:, :), inverse(:), root(:, :), x(:)
        integer :: i, j, k, seed, stat

        seed = 11
        do i = 1, size(orders)
            k = orders(i)
            allocate (a(k + 2, k), b(k), inverse(k), root(k + 2, k), x(k))
            call get_random(seed, k, root)
            call random_vector(seed, x)
            a = 0.0_wp
            a(:k, :) = matmul(root(:k, :), transpose(root(:k, :)))
            do j = 1, k
                a(j, j) = a(j, j) + 1.0_wp
            end do
            b = matmul(a(:k, :), x)
            factors = a
            ! Only the lower triangle is read.
            do j = 2, k
                factors(:j - 1, j) = huge(1.0_wp)
            end do
            call factor_definite(k, k + 2, factors, inverse, stat)
            call check_count(error, stat, 0, 'stat')
            if (allocated(error)) return
            call substitute(k, k + 2, factors, inverse, b)
            call check_below(error, maxval(abs(b - x)), 1.0e-12_wp, 'the solution')
            if (allocated(error)) return
            deallocate (a, b, inverse, root, x)
        end do
    end subroutine test_definite

    subroutine test_not_definite(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), allocatable :: a(:, :), inverse(:), v(:)
        integer :: i, j, k, seed, stat

        seed = 5
        do i = 1, size(orders)
            k = orders(i)
            allocate (a(k, k), inverse(k), v(k))
            call random_vector(seed, v)
            ! Of rank one: the second minor is rounding.
            do j = 1, k
                a(:, j) = v*v(j)
            end do
            call factor_definite(k, k, a, inverse, stat)
            call check_count(error, stat, merge(0, 2, k == 1), 'stat of a singular matrix')
            if (allocated(error)) return
            ! The last one negative.
            a = 0.0_wp
            do j = 1, k
                a(j, j) = merge(-1.0_wp, 1.0_wp, j == k)
            end do
            call factor_definite(k, k, a, inverse, stat)
            call check_count(error, stat, k, 'stat of an indefinite matrix')
            if (allocated(error)) return
            a = ieee_value(1.0_wp, ieee_quiet_nan)
            call factor_definite(k, k, a, inverse, stat)
            call check_count(error, stat, 1, 'stat of NaN')
            if (allocated(error)) return
            deallocate (a, inverse, v)
        end do
    end subroutine test_not_definite

    subroutine test_near_diagonal(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), allocatable :: a(:, :), b(:), x(:)
        integer :: i, j, k, seed, stat

        seed = 23
        do i = 1, size(orders)
            k = orders(i)
            allocate (a(k + 1, k), b(k), x(k))
            call get_random(seed, k, a)
            a = a/k
            do j = 1, k
                a(j, j) = a(j, j) + 2.0_wp
            end do
            call random_vector(seed, x)
            b = matmul(a(:k, :), x)
            call solve_near_diagonal(k, k + 1, a, b, stat)
            call check_count(error, stat, 0, 'stat')
            if (allocated(error)) return
            call check_below(error, maxval(abs(b - x)), 1.0e-13_wp, 'the solution')
            if (allocated(error)) return
            deallocate (a, b, x)
        end do
    end subroutine test_near_diagonal

    subroutine test_small_pivot(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), allocatable :: a(:, :), b(:)
        integer :: i, j, k, stat

        do i = 2, size(orders)
            k = orders(i)
            allocate (a(k, k), b(k), source=1.0_wp)
            ! Columns 1 and 2 are nearly equal: the second pivot is 1e-4 of its diagonal entry.
            do j = 3, k
                a(:, j) = 0.0_wp
                a(j, j) = 1.0_wp
            end do
            a(2, 2) = 1.0001_wp
            call solve_near_diagonal(k, k, a, b, stat)
            call check_count(error, stat, 2, 'stat')
            if (allocated(error)) return
            deallocate (a, b)
        end do
    end subroutine test_small_pivot

    subroutine test_combination(error)
        type(error_type), allocatable, intent(out) :: error
        type(combination_type) :: combination
        real(wp) :: rate(2*lane, 13), weight(13), x(2*lane), y(2*lane), expected(2*lane)
        real(wp), parameter :: h = 0.3_wp
        integer :: n, seed

        seed = 7
        call get_random(seed, 2*lane, rate)
        do n = 0, 13
            call random_vector(seed, weight)
            call random_vector(seed, x)
            ! Some are zero; the contents of their columns must have no effect.
            where (weight < -0.5_wp) weight = 0.0_wp
            expected = x + h*matmul(rate(:, :n), weight(:n))
            call combination%set(weight(:n))
            call combination%add(size(rate, 1), size(rate, 2), h, rate, x, y)
            call check_below(error, maxval(abs(y - expected)), 1.0e-14_wp, 'the sum')
            if (allocated(error)) return
        end do
        rate(:, 2) = ieee_value(1.0_wp, ieee_quiet_nan)
        rate(:, 4:) = ieee_value(1.0_wp, ieee_quiet_nan)
        x = 0.0_wp
        call combination%set([1.0_wp, 0.0_wp, 2.0_wp, 0.0_wp])
        call combination%add(size(rate, 1), size(rate, 2), h, rate, x, y)
        call check_below(error, maxval(abs(y - h*(rate(:, 1) + 2*rate(:, 3)))), 1.0e-15_wp, 'a sum beside NaN')
    end subroutine test_combination

    subroutine test_products(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: few = 1.0e-13_wp
        real(wp), allocatable :: a(:, :), b(:, :), c(:, :), x(:), y(:), z(:)
        integer :: l, m, n, seed

        seed = 17
        do l = 0, 11
            do m = 0, 9
                do n = 0, 6
                    allocate (a(l, m), b(m, n), c(l, n), x(m), y(l), z(m))
                    call get_random(seed, l, a)
                    call get_random(seed, m, b)
                    call random_vector(seed, x)
                    call random_vector(seed, y)
                    call random_vector(seed, z)
                    c = 7.0_wp
                    call set_product(a, b, c)
                    call check_below(error, sum(abs(c - matmul(a, b))), few, 'A B')
                    if (allocated(error)) return
                    y = 1.0_wp
                    call add_product(a, x, -2.0_wp, y)
                    call check_below(error, sum(abs(y - (1.0_wp - 2.0_wp*matmul(a, x)))), few, 'y - 2 A x')
                    if (allocated(error)) return
                    x = z
                    call add_transposed_product(a, y, 3.0_wp, x)
                    call check_below(error, sum(abs(x - (z + 3.0_wp*matmul(y, a)))), 10*few, "x + 3 A' y")
                    if (allocated(error)) return
                    deallocate (c)
                    allocate (c(m, m))
                    call set_gram(a, a, c)
                    call check_below(error, sum(abs(c - matmul(transpose(a), a))), few, "A' A")
                    if (allocated(error)) return
                    deallocate (a, b, c, x, y, z)
                end do
            end do
        end do
    end subroutine test_products

    !> Orders on both sides of the change from loops to LAPACK, and a singular and an infinite matrix.
    subroutine test_complex(error)
        type(error_type), allocatable, intent(out) :: error
        type(complex_lu_type) :: lu
        complex(wp), allocatable :: a(:, :), b(:), x(:)
        real(wp), allocatable :: re(:, :), im(:, :), y(:), z(:)
        integer :: i, n, seed, stat

        seed = 29
        do n = 1, 18
            allocate (re(n, n), im(n, n), y(n), z(n))
            call get_random(seed, n, re)
            call get_random(seed, n, im)
            call random_vector(seed, y)
            call random_vector(seed, z)
            x = cmplx(y, z, wp)
            a = cmplx(re, im, wp)
            do i = 1, n
                a(n + 1 - i, i) = a(n + 1 - i, i) + 3.0_wp
            end do
            b = matmul(a, x)
            y = real(b, wp)
            z = aimag(b)
            call lu%allocate(n)
            call lu%factor(a, stat)
            call check_count(error, stat, 0, 'the factorisation')
            if (allocated(error)) return
            call lu%solve(y, z)
            call check_below(error, maxval(abs(cmplx(y, z, wp) - x)), 1.0e-12_wp, 'the solution')
            if (allocated(error)) return
            a(:, n) = 0.0_wp
            call lu%factor(a, stat)
            call check_true(error, stat > 0, 'a singular matrix is refused')
            if (allocated(error)) return
            a(:, n) = ieee_value(1.0_wp, ieee_positive_inf)
            call lu%factor(a, stat)
            call check_true(error, stat > 0, 'an infinite matrix is refused')
            if (allocated(error)) return
            deallocate (re, im, y, z)
        end do
    end subroutine test_complex

    subroutine test_rows(error)
        type(error_type), allocatable, intent(out) :: error
        type(lu_type) :: lu
        real(wp), allocatable :: a(:, :), b(:, :), x(:, :)
        integer :: i, n, seed, stat

        seed = 23
        do n = 1, 12
            allocate (a(n, n), b(n + 2, n), x(n + 2, n))
            call get_random(seed, n, a)
            call get_random(seed, n + 2, x)
            ! Pivots are below the diagonal.
            do i = 1, n
                a(n + 1 - i, i) = a(n + 1 - i, i) + 3.0_wp
            end do
            b = matmul(x, a)
            call lu%allocate(n)
            call lu%factor(a, stat)
            call check_count(error, stat, 0, 'the factorisation')
            if (allocated(error)) return
            call lu%solve_rows(b)
            call check_below(error, maxval(abs(b - x)), 1.0e-12_wp, 'B A^-1')
            if (allocated(error)) return
            deallocate (a, b, x)
        end do
    end subroutine test_rows

    subroutine test_add(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: x(13), y(13), z(13)
        integer :: n, seed

        seed = 3
        call random_vector(seed, x)
        call random_vector(seed, y)
        do n = 0, 12
            z = 9.0_wp
            call add(n, x, y, z)
            call check_true(error, all(abs(z(:n) - (x(:n) + y(:n))) <= 0.0_wp), 'the sums')
            if (allocated(error)) return
            call check_true(error, all(abs(z(n + 1:) - 9.0_wp) <= 0.0_wp), 'what is behind them')
            if (allocated(error)) return
        end do
    end subroutine test_add

    subroutine test_same(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: x(9), y(9)
        integer :: i, n, seed

        seed = 3
        call random_vector(seed, x)
        do n = 1, 9
            call check_true(error, are_same(n, x, x), 'a vector is itself')
            if (allocated(error)) return
            do i = 1, n
                y = x
                y(i) = nearest(x(i), 1.0_wp)
                call check_true(error, .not. are_same(n, x, y), 'another entry')
                if (allocated(error)) return
                y(i) = ieee_value(1.0_wp, ieee_quiet_nan)
                call check_true(error, .not. are_same(n, y, y), 'NaN')
                if (allocated(error)) return
            end do
        end do
    end subroutine test_same

    subroutine test_finite(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: x(9), y(9)
        integer :: i, n, seed

        seed = 3
        call random_vector(seed, x)
        do n = 1, 9
            call check_true(error, is_finite(n, x), 'a finite vector')
            if (allocated(error)) return
            do i = 1, 9
                y = x
                y(i) = ieee_value(1.0_wp, ieee_quiet_nan)
                call check_true(error, is_finite(n, y) .eqv. i > n, 'NaN')
                if (allocated(error)) return
                y(i) = -ieee_value(1.0_wp, ieee_positive_inf)
                call check_true(error, is_finite(n, y) .eqv. i > n, 'an infinity')
                if (allocated(error)) return
            end do
        end do
    end subroutine test_finite
end module test_small_systems
