! SPDX-License-Identifier: MIT
!> Tests of least squares by singular values, with dependent rows, and of symmetric eigenvalues.
module test_linalg_singular
    use asserts, only: check_below, check_between, check_close, check_count
    use tandem, only: wp
    use tandem_linalg_singular, only: decompose_symmetric, singular_type
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_linalg_singular

    !> The third row is the first minus twice the second; null space (1, 1, 1, 1) and (1, -1, 1, -1).
    real(wp), parameter :: matrix(3, 4) = reshape([1.0_wp, 0.0_wp, 1.0_wp, 0.0_wp, 1.0_wp, -2.0_wp, -1.0_wp, 0.0_wp, -1.0_wp, &
        0.0_wp, -1.0_wp, 2.0_wp], [3, 4])

contains

    !> The suite.
    subroutine collect_linalg_singular(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('smallest-least-squares-solution-of-dependent-rows', test_solve), &
            new_unittest('steps-within-a-radius', test_within), &
            new_unittest('components-of-rounding-ask-for-nothing', test_noise), &
            new_unittest('transposed-system-and-null-space', test_transposed), &
            new_unittest('empty-systems', test_empty), &
            new_unittest('symmetric-eigenvalues', test_symmetric)]
    end subroutine collect_linalg_singular

    !> A'(A x - b) = 0 and x in the range of A'.
    subroutine test_solve(error)
        type(error_type), allocatable, intent(out) :: error
        type(singular_type) :: singular
        real(wp), parameter :: b(3) = [1.0_wp, 2.0_wp, 5.0_wp]
        real(wp) :: x(4)

        call singular%allocate(3, 4)
        call singular%factor(matrix)
        call check_count(error, singular%rank, 2, 'rank')
        call singular%solve(b, x)
        call check_close(error, matmul(matmul(matrix, x) - b, matrix), spread(0.0_wp, 1, 4), 1.0e-14_wp, 'normal equations')
        ! Singular vectors are orthogonal to some units of rounding, which differ from one LAPACK to another.
        call check_close(error, [sum(x), x(1) - x(2) + x(3) - x(4)], [0.0_wp, 0.0_wp], 1.0e-14_wp, 'parts in the null space')
    end subroutine test_solve

    !> (A'A + mu I) x = A'b for some mu >= 0; the whole solution where it is short enough.
    subroutine test_within(error)
        type(error_type), allocatable, intent(out) :: error
        type(singular_type) :: singular
        real(wp), parameter :: b(3) = [1.0_wp, 2.0_wp, 5.0_wp], radii(4) = [1.0e-6_wp, 0.1_wp, 0.5_wp, 1.0e3_wp]
        real(wp) :: x(4), whole(4), slope(4), mu
        integer :: i

        call singular%allocate(3, 4)
        call singular%factor(matrix)
        call singular%solve(b, whole)
        do i = 1, 4
            call singular%solve_within(b, radii(i), 0.0_wp, x)
            slope = matmul(b - matmul(matrix, x), matrix)
            if (i == 4) then
                call check_close(error, x, whole, 0.0_wp, 'the whole solution')
            else
                call check_between(error, norm2(x), radii(i), 1.1_wp*radii(i), 'its length')
                mu = dot_product(slope, x)/dot_product(x, x)
                call check_between(error, mu, 0.0_wp, huge(1.0_wp), 'mu')
                call check_close(error, slope, mu*x, 1.0e-14_wp, 'slope')
            end if
        end do
    end subroutine test_within

    subroutine test_noise(error)
        type(error_type), allocatable, intent(out) :: error
        type(singular_type) :: singular
        real(wp) :: x(2)

        call singular%allocate(2, 2)
        call singular%factor(reshape([1.0_wp, 0.0_wp, 0.0_wp, 1.0e-7_wp], [2, 2]))
        call singular%solve_within([1.0_wp, 1.0e-15_wp], 10.0_wp, 1.0e-14_wp, x)
        call check_close(error, x, [1.0_wp, 0.0_wp], 1.0e-15_wp, 'without noise')
        call singular%solve_within([1.0_wp, 1.0e-15_wp], 10.0_wp, 0.0_wp, x)
        call check_close(error, x, [1.0_wp, 1.0e-8_wp], 1.0e-15_wp, 'with noise')
    end subroutine test_noise

    subroutine test_transposed(error)
        type(error_type), allocatable, intent(out) :: error
        type(singular_type) :: singular
        real(wp), parameter :: g(4) = [1.0_wp, 3.0_wp, -4.0_wp, 0.5_wp]
        real(wp) :: y(3)
        real(wp), allocatable :: z(:, :)

        call singular%allocate(3, 4)
        call singular%factor(matrix)
        call singular%solve_transposed(g, y)
        call check_close(error, matmul(matrix, matmul(y, matrix) - g), spread(0.0_wp, 1, 3), 2.0e-14_wp, 'normal equations')
        ! y is orthogonal to the left null space: row 1 - 2 row 2 - row 3 = 0. Rounding of singular vectors, here and below.
        call check_below(error, abs(y(1) - 2*y(2) - y(3)), 1.0e-14_wp, 'the part that gives nothing')
        call singular%get_null_basis(z)
        call check_close(error, [shape(z)*1.0_wp], [4.0_wp, 2.0_wp], 0.0_wp, 'shape')
        call check_close(error, [matmul(matrix, z)], spread(0.0_wp, 1, 6), 1.0e-14_wp, 'A Z')
        call check_close(error, [matmul(transpose(z), z)], [1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp], 1.0e-14_wp, 'Z''Z')
    end subroutine test_transposed

    !> No rows, no columns, and rows of zeros.
    subroutine test_empty(error)
        type(error_type), allocatable, intent(out) :: error
        type(singular_type) :: singular
        real(wp) :: none(0, 2), zero(1, 2), x(2), y(0)
        real(wp), allocatable :: z(:, :)

        call singular%allocate(0, 2)
        call singular%factor(none)
        call singular%solve([real(wp) ::], x)
        call check_close(error, x, [0.0_wp, 0.0_wp], 0.0_wp, 'x without rows')
        call singular%get_null_basis(z)
        call check_close(error, [z], [1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp], 0.0_wp, 'Z without rows')
        call singular%allocate(2, 0)
        call singular%factor(transpose(none))
        call singular%solve([1.0_wp, 2.0_wp], y)
        call singular%get_null_basis(z)
        call check_count(error, size(z), 0, 'Z without columns')
        call singular%allocate(1, 2)
        zero = 0.0_wp
        call singular%factor(zero)
        call check_count(error, singular%rank, 0, 'rank of zeros')
        call singular%solve([1.0_wp], x)
        call check_close(error, x, [0.0_wp, 0.0_wp], 0.0_wp, 'x with a row of zeros')
    end subroutine test_empty

    !> (2 1; 1 2) and a negative direction; only the lower triangle is read.
    subroutine test_symmetric(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: a(3, 3), values(3), b(3, 3)

        b = 0.0_wp
        b(1:2, 1:2) = reshape([2.0_wp, 1.0_wp, 1.0_wp, 2.0_wp], [2, 2])
        b(3, 3) = -4.0_wp
        a = b
        a(1, 2) = 77.0_wp
        call decompose_symmetric(a, values)
        call check_close(error, values, [-4.0_wp, 1.0_wp, 3.0_wp], 2.0e-15_wp, 'eigenvalues')
        call check_close(error, [matmul(b, a)], [a(:, 1)*values(1), a(:, 2)*values(2), a(:, 3)*values(3)], 4.0e-15_wp, &
            'eigenvectors')
    end subroutine test_symmetric
end module test_linalg_singular
