! SPDX-License-Identifier: MIT
!> Tests of the LU and Cholesky factorisations and of the small products.
module test_linalg_solvers
    use asserts, only: check_below, check_between, check_close, check_count, check_true
    use differences, only: random_vector
    use tandem, only: wp
    use tandem_linalg_cholesky, only: cholesky_type
    use tandem_linalg_kernels, only: add_product, add_transposed_product, set_gram, set_product
    use tandem_linalg_lu, only: lu_type
    use testdrive, only: error_type, new_unittest, unittest_type
    use, intrinsic :: ieee_arithmetic, only: ieee_positive_inf, ieee_quiet_nan, ieee_value
    implicit none (type, external)
    private

    public :: collect_linalg_solvers

contains

    !> The suite.
    subroutine collect_linalg_solvers(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('lu-solves-with-the-matrix-and-its-transpose', test_lu_solve), &
            new_unittest('lu-inverts', test_lu_invert), &
            new_unittest('lu-needs-its-pivots', test_lu_pivot), &
            new_unittest('lu-estimates-the-condition-of-hilbert-matrices', test_lu_condition), &
            new_unittest('lu-reports-a-singular-matrix', test_lu_singular), &
            new_unittest('lu-reports-a-matrix-that-is-not-finite', test_lu_not_finite), &
            new_unittest('lu-of-order-zero-does-nothing', test_lu_empty), &
            new_unittest('lu-can-be-used-again', test_lu_again), &
            new_unittest('cholesky-solves', test_cholesky_solve), &
            new_unittest('cholesky-reads-the-lower-triangle-only', test_cholesky_triangle), &
            new_unittest('cholesky-refuses-an-indefinite-matrix', test_cholesky_indefinite), &
            new_unittest('cholesky-refuses-a-negative-matrix', test_cholesky_negative), &
            new_unittest('cholesky-refuses-a-semidefinite-matrix', test_cholesky_semidefinite), &
            new_unittest('cholesky-refuses-a-matrix-that-is-not-finite', test_cholesky_not_finite), &
            new_unittest('cholesky-accepts-any-units', test_cholesky_units), &
            new_unittest('cholesky-of-order-zero-does-nothing', test_cholesky_empty), &
            new_unittest('small-products-are-those-of-matmul', test_kernels)]
    end subroutine collect_linalg_solvers

    !> Entries 1/(i + j - 1).
    pure function hilbert(n) result(matrix)
        integer, intent(in) :: n
        real(wp) :: matrix(n, n)
        integer :: i, j

        do j = 1, n
            do i = 1, n
                matrix(i, j) = 1/real(i + j - 1, wp)
            end do
        end do
    end function hilbert

    !> A matrix whose solutions have no more rounding than their sizes: 1 on the diagonal, small entries elsewhere.
    function dominant(n) result(matrix)
        integer, intent(in) :: n
        real(wp) :: matrix(n, n)
        integer :: j, seed

        seed = n
        do j = 1, n
            call random_vector(seed, matrix(:, j))
            matrix(:, j) = matrix(:, j)/n
            matrix(j, j) = matrix(j, j) + 2
        end do
    end function dominant

    subroutine test_lu_solve(error)
        type(error_type), allocatable, intent(out) :: error
        type(lu_type) :: lu
        real(wp) :: a(7, 7), x(7), b(7)
        integer :: stat, seed

        seed = 5
        a = dominant(7)
        call random_vector(seed, x)
        call lu%allocate(7)
        call lu%factor(a, stat)
        call check_count(error, stat, 0, 'stat')
        b = matmul(a, x)
        call lu%solve(b)
        call check_close(error, b, x, 1.0e-15_wp, 'solutions')
        b = matmul(transpose(a), x)
        call lu%solve_transposed(b)
        call check_close(error, b, x, 1.0e-15_wp, 'solutions with the transpose')
    end subroutine test_lu_solve

    subroutine test_lu_invert(error)
        type(error_type), allocatable, intent(out) :: error
        type(lu_type) :: lu
        real(wp) :: inverse(3, 3)
        integer :: stat

        call lu%allocate(3)
        call lu%factor(hilbert(3), stat)
        call lu%invert(inverse)
        ! The inverse has whole numbers; its rounding is the condition number 748 times eps times its size 192.
        call check_close(error, reshape(inverse, [9]), [9.0_wp, -36.0_wp, 30.0_wp, -36.0_wp, 192.0_wp, -180.0_wp, 30.0_wp, &
            -180.0_wp, 180.0_wp], 3.0e-11_wp, 'inverses')
    end subroutine test_lu_invert

    subroutine test_lu_pivot(error)
        type(error_type), allocatable, intent(out) :: error
        type(lu_type) :: lu
        real(wp) :: b(2)
        integer :: stat

        call lu%allocate(2)
        call lu%factor(reshape([0.0_wp, 1.0_wp, 1.0_wp, 1.0_wp], [2, 2]), stat)
        call check_count(error, stat, 0, 'stat')
        b = [2.0_wp, 5.0_wp]
        call lu%solve(b)
        call check_close(error, b, [3.0_wp, 2.0_wp], 0.0_wp, 'solutions')
    end subroutine test_lu_pivot

    !> Condition numbers in the 1-norm: 748, 28375, 943656, 29070279, 33872791095 for n = 3, 4, 5, 6, 8.
    subroutine test_lu_condition(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: order(5) = [3, 4, 5, 6, 8]
        real(wp), parameter :: condition(5) = [748.0_wp, 28375.0_wp, 943656.0_wp, 29070279.0_wp, 33872791095.0_wp]
        type(lu_type) :: lu
        integer :: i, stat

        do i = 1, size(order)
            call lu%allocate(order(i))
            call lu%factor(hilbert(order(i)), stat)
            ! The estimate is a lower bound of the condition number, rarely off by more than 3.
            call check_between(error, condition(i)*lu%reciprocal_condition(), 0.999_wp, 3.0_wp, 'condition over its estimate')
            if (allocated(error)) return
        end do
    end subroutine test_lu_condition

    subroutine test_lu_singular(error)
        type(error_type), allocatable, intent(out) :: error
        type(lu_type) :: lu
        integer :: stat

        call lu%allocate(2)
        call lu%factor(reshape([1.0_wp, 2.0_wp, 2.0_wp, 4.0_wp], [2, 2]), stat)
        call check_true(error, stat > 0, 'the matrix is singular')
    end subroutine test_lu_singular

    subroutine test_lu_not_finite(error)
        type(error_type), allocatable, intent(out) :: error
        type(lu_type) :: lu
        real(wp) :: a(3, 3)
        integer :: stat

        call lu%allocate(3)
        a = dominant(3)
        a(3, 1) = ieee_value(1.0_wp, ieee_quiet_nan)
        call lu%factor(a, stat)
        call check_true(error, stat > 0, 'a NaN')
        if (allocated(error)) return
        a(3, 1) = ieee_value(1.0_wp, ieee_positive_inf)
        call lu%factor(a, stat)
        call check_true(error, stat > 0, 'an infinity')
        if (allocated(error)) return
        a = dominant(3)
        a(2, 3) = ieee_value(1.0_wp, ieee_quiet_nan)
        call lu%factor(a, stat)
        call check_true(error, stat > 0, 'a NaN in the last column')
    end subroutine test_lu_not_finite

    subroutine test_lu_empty(error)
        type(error_type), allocatable, intent(out) :: error
        type(lu_type) :: lu
        real(wp) :: a(0, 0), b(0)
        integer :: stat

        call lu%allocate(0)
        call lu%factor(a, stat)
        call check_count(error, stat, 0, 'stat')
        call lu%solve(b)
        call lu%invert(a)
        call check_between(error, lu%reciprocal_condition(), 1.0_wp, 1.0_wp, 'reciprocal condition')
    end subroutine test_lu_empty

    subroutine test_lu_again(error)
        type(error_type), allocatable, intent(out) :: error
        type(lu_type) :: lu
        real(wp) :: b(2)
        integer :: stat

        call lu%allocate(3)
        call lu%factor(hilbert(3), stat)
        call lu%allocate(2)
        call lu%factor(reshape([2.0_wp, 0.0_wp, 0.0_wp, 4.0_wp], [2, 2]), stat)
        b = [2.0_wp, 2.0_wp]
        call lu%solve(b)
        call check_close(error, b, [1.0_wp, 0.5_wp], 0.0_wp, 'solutions')
    end subroutine test_lu_again

    subroutine test_cholesky_solve(error)
        type(error_type), allocatable, intent(out) :: error
        type(cholesky_type) :: cholesky
        real(wp) :: a(6, 6), x(6), b(6)
        integer :: stat, seed

        seed = 11
        a = dominant(6)
        a = matmul(transpose(a), a)
        call random_vector(seed, x)
        call cholesky%allocate(6)
        call cholesky%factor(a, stat)
        call check_count(error, stat, 0, 'stat')
        b = matmul(a, x)
        call cholesky%solve(b)
        ! The condition number is below 10.
        call check_close(error, b, x, 5.0e-15_wp, 'solutions')
    end subroutine test_cholesky_solve

    subroutine test_cholesky_triangle(error)
        type(error_type), allocatable, intent(out) :: error
        type(cholesky_type) :: cholesky
        real(wp) :: b(2)
        integer :: stat

        call cholesky%allocate(2)
        call cholesky%factor(reshape([4.0_wp, 2.0_wp, 1.0e30_wp, 5.0_wp], [2, 2]), stat)
        call check_count(error, stat, 0, 'stat')
        b = [8.0_wp, 12.0_wp]
        call cholesky%solve(b)
        call check_close(error, b, [1.0_wp, 2.0_wp], 1.0e-15_wp, 'solutions')
    end subroutine test_cholesky_triangle

    subroutine test_cholesky_indefinite(error)
        type(error_type), allocatable, intent(out) :: error
        type(cholesky_type) :: cholesky
        integer :: stat

        call cholesky%allocate(3)
        ! Leading minors 1, 3, and -4.
        call cholesky%factor(reshape([1.0_wp, 1.0_wp, 0.0_wp, 1.0_wp, 4.0_wp, 2.0_wp, 0.0_wp, 2.0_wp, 0.0_wp], [3, 3]), stat)
        call check_count(error, stat, 3, 'stat')
    end subroutine test_cholesky_indefinite

    subroutine test_cholesky_negative(error)
        type(error_type), allocatable, intent(out) :: error
        type(cholesky_type) :: cholesky
        integer :: stat

        call cholesky%allocate(2)
        call cholesky%factor(-dominant(2), stat)
        call check_count(error, stat, 1, 'stat')
    end subroutine test_cholesky_negative

    !> A rank-one matrix whose last pivot is rounding, of either sign.
    subroutine test_cholesky_semidefinite(error)
        type(error_type), allocatable, intent(out) :: error
        type(cholesky_type) :: cholesky
        real(wp) :: v(3)
        integer :: stat, seed, i

        seed = 3
        call cholesky%allocate(3)
        do i = 1, 50
            call random_vector(seed, v)
            call cholesky%factor(spread(v, 1, 3)*spread(v, 2, 3), stat)
            call check_true(error, stat > 0, 'v v'' is singular')
            if (allocated(error)) return
        end do
    end subroutine test_cholesky_semidefinite

    subroutine test_cholesky_not_finite(error)
        type(error_type), allocatable, intent(out) :: error
        type(cholesky_type) :: cholesky
        real(wp) :: a(3, 3)
        integer :: stat, i

        call cholesky%allocate(3)
        do i = 1, 3
            a = dominant(3)
            a(3, i) = ieee_value(1.0_wp, ieee_quiet_nan)
            call cholesky%factor(a, stat)
            call check_true(error, stat > 0, 'a NaN')
            if (allocated(error)) return
        end do
    end subroutine test_cholesky_not_finite

    !> Masses of a microgram and masses of a ship: the matrix is diagonal, and as definite as the identity.
    subroutine test_cholesky_units(error)
        type(error_type), allocatable, intent(out) :: error
        type(cholesky_type) :: cholesky
        real(wp) :: b(2)
        integer :: stat

        call cholesky%allocate(2)
        call cholesky%factor(reshape([1.0e-9_wp, 0.0_wp, 0.0_wp, 1.0e8_wp], [2, 2]), stat)
        call check_count(error, stat, 0, 'stat')
        b = [1.0e-9_wp, 1.0e8_wp]
        call cholesky%solve(b)
        call check_close(error, b, [1.0_wp, 1.0_wp], 1.0e-15_wp, 'solutions')
    end subroutine test_cholesky_units

    subroutine test_cholesky_empty(error)
        type(error_type), allocatable, intent(out) :: error
        type(cholesky_type) :: cholesky
        real(wp) :: a(0, 0), b(0)
        integer :: stat

        call cholesky%allocate(0)
        call cholesky%factor(a, stat)
        call check_count(error, stat, 0, 'stat')
        call cholesky%solve(b)
    end subroutine test_cholesky_empty

    subroutine test_kernels(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: a(4, 3), b(3, 5), c(4, 5), g(3, 5), x(3), y(4), z(3)
        integer :: seed, j

        seed = 17
        do j = 1, 3
            call random_vector(seed, a(:, j))
        end do
        do j = 1, 5
            call random_vector(seed, b(:, j))
        end do
        call random_vector(seed, x)
        call set_product(a, b, c)
        ! Sums of at most five products of numbers below one.
        call check_close(error, reshape(c, [20]), reshape(matmul(a, b), [20]), 1.0e-15_wp, 'A B')
        call set_gram(a, c, g)
        call check_close(error, reshape(g, [15]), reshape(matmul(transpose(a), c), [15]), 1.0e-15_wp, 'A''C')
        y = 1.0_wp
        call add_product(a, x, -2.0_wp, y)
        call check_close(error, y, 1 - 2*matmul(a, x), 2.0e-15_wp, 'y - 2 A x')
        z = 1.0_wp
        call add_transposed_product(a, y, 3.0_wp, z)
        call check_close(error, z, 1 + 3*matmul(transpose(a), y), 1.0e-14_wp, 'z + 3 A''y')
    end subroutine test_kernels
end module test_linalg_solvers
