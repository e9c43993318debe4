! SPDX-License-Identifier: MIT
!> Tests of the complete orthogonal decomposition against singular values, and of the choice of dependent rows.
module test_linalg_orthogonal
    use asserts, only: check_below, check_close, check_count, check_true
    use tandem, only: wp
    use tandem_linalg_dependence, only: count_independent, split_rows
    use tandem_linalg_orthogonal, only: orthogonal_type
    use tandem_linalg_random, only: random_vector
    use tandem_linalg_singular, only: singular_type
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_linalg_orthogonal

contains

    !> The suite.
    subroutine collect_linalg_orthogonal(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('decompositions-agree-with-singular-values', test_decompositions), &
            new_unittest('nearly-dependent-rows-are-decided-by-singular-values', test_nearly_dependent), &
            new_unittest('copies-are-dropped-and-not-originals', test_copies), &
            new_unittest('dropped-rows-are-combinations-of-kept-ones', test_combinations), &
            new_unittest('later-rows-are-dropped-first', test_later_rows), &
            new_unittest('a-rank-that-is-not-clear-is-decided-by-singular-values', test_unclear)]
    end subroutine collect_linalg_orthogonal

    !> Random rows (m, n) of a rank.
    function random_rows(m, n, rank, seed) result(a)
        integer, intent(in) :: m, n, rank
        integer, intent(inout) :: seed
        real(wp) :: a(m, n)

        a = matmul(reshape(random_vector(seed, m*rank), [m, rank]), reshape(random_vector(seed, rank*n), [rank, n]))
    end function random_rows

    !> Solutions of least norm, of both systems, for more and fewer rows than columns and every rank; the null space.
    subroutine test_decompositions(error)
        type(error_type), allocatable, intent(out) :: error
        type(singular_type) :: singular
        type(orthogonal_type) :: orthogonal
        integer, parameter :: m(4) = [5, 4, 7, 1], n(4) = [7, 4, 5, 3]
        real(wp), allocatable :: a(:, :), b(:), g(:), x(:), y(:), other_x(:), other_y(:), z(:, :)
        integer :: i, rank, seed

        seed = 4711
        do i = 1, size(m)
            do rank = 0, min(m(i), n(i))
                a = random_rows(m(i), n(i), rank, seed)
                b = random_vector(seed, m(i))
                g = random_vector(seed, n(i))
                x = g
                other_x = g
                y = b
                other_y = b
                call singular%allocate(m(i), n(i))
                call singular%factor(a)
                call orthogonal%factor(a)
                call check_count(error, orthogonal%rank, rank, 'rank')
                call singular%solve(b, x)
                call orthogonal%solve(b, other_x)
                ! Condition numbers are up to 1e3.
                call check_close(error, other_x, x, 1.0e-11_wp*(1 + maxval(abs(x))), 'x')
                call singular%solve_transposed(g, y)
                call orthogonal%solve_transposed(g, other_y)
                call check_close(error, other_y, y, 1.0e-11_wp*(1 + maxval(abs(y))), 'y')
                call orthogonal%get_null_basis(z)
                call check_count(error, size(z, 2), n(i) - rank, 'dimension of the null space')
                call check_below(error, maxval([0.0_wp, abs(matmul(a, z))]), 1.0e-13_wp, 'A Z')
                if (allocated(error)) return
            end do
        end do
    end subroutine test_decompositions

    !> Rows at an angle of 1e-9 have the full rank, at one of 1e-11 they have not; neither is visible in R without doubt.
    subroutine test_nearly_dependent(error)
        type(error_type), allocatable, intent(out) :: error
        type(orthogonal_type) :: orthogonal

        call orthogonal%factor(reshape([1.0_wp, 1.0_wp, 0.0_wp, 1.0e-9_wp], [2, 2]))
        call check_count(error, orthogonal%rank, 2, 'rank at an angle of 1e-9')
        call orthogonal%factor(reshape([1.0_wp, 1.0_wp, 0.0_wp, 1.0e-11_wp], [2, 2]))
        call check_count(error, orthogonal%rank, 1, 'rank at an angle of 1e-11')
        ! The size of the errors may be larger than the matrix.
        call orthogonal%factor(reshape([1.0e-12_wp], [1, 1]), 1.0_wp)
        call check_count(error, orthogonal%rank, 0, 'rank of rounding')
    end subroutine test_nearly_dependent

    !> Rows 4 and 6 are copies of 1 and 3 with other lengths, row 7 is one more copy of 1.
    subroutine test_copies(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: of(4:7) = [1, 0, 3, 1]
        real(wp) :: a(7, 9)
        real(wp), allocatable :: combination(:, :)
        integer, allocatable :: kept(:), dropped(:)
        integer :: i, seed

        seed = 99
        a = random_rows(7, 9, 7, seed)
        do i = 4, 7
            if (of(i) > 0) a(i, :) = i*a(of(i), :)
        end do
        call split_rows(a, spread(1.0_wp, 1, 9), 7, 1.0e-10_wp, kept, dropped, combination)
        call check_count(error, size(dropped), 3, 'number of dropped rows')
        call check_true(error, all(dropped == [4, 6, 7]) .and. all(kept == [1, 2, 3, 5]), 'the copies are dropped')
        if (allocated(error)) return
        call check_close(error, [combination], [4.0_wp, 0.0_wp, 7.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 6.0_wp, 0.0_wp, &
            0.0_wp, 0.0_wp, 0.0_wp], 1.0e-12_wp, 'the combinations')
        call check_count(error, count_independent(a, spread(1.0_wp, 1, 9), 7, 1.0e-10_wp), 4, 'rank')
    end subroutine test_copies

    !> More rows than columns, rows of zeros, and scales of the unknowns.
    subroutine test_combinations(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: a(12, 8), scale(8)
        real(wp), allocatable :: combination(:, :)
        integer, allocatable :: kept(:), dropped(:)
        integer :: seed

        seed = 5
        scale = [1.0e3_wp, 1.0_wp, 1.0e-3_wp, 1.0_wp, 2.0_wp, 1.0_wp, 1.0_wp, 1.0e2_wp]
        a = random_rows(12, 8, 5, seed)
        a(2, :) = 0.0_wp
        call split_rows(a, scale, 12, 1.0e-10_wp, kept, dropped, combination)
        call check_count(error, size(kept), 5, 'rank')
        call check_true(error, any(dropped == 2), 'the row of zeros is dropped')
        call check_close(error, [matmul(combination, a(kept, :))], [a(dropped, :)], 1.0e-11_wp, 'combinations')
    end subroutine test_combinations

    !> Row 1 is the sum of rows 3 and 4: row 4 is dropped if rows 1 and 2 come first.
    subroutine test_later_rows(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: a(4, 6)
        real(wp), allocatable :: combination(:, :)
        integer, allocatable :: kept(:), dropped(:)
        integer :: seed

        seed = 17
        a = random_rows(4, 6, 4, seed)
        a(1, :) = a(3, :)/norm2(a(3, :)) + a(4, :)/norm2(a(4, :))
        call split_rows(a, spread(1.0_wp, 1, 6), 2, 1.0e-10_wp, kept, dropped, combination)
        call check_count(error, size(dropped), 1, 'number of dropped rows')
        if (.not. allocated(error)) call check_count(error, dropped(1), 4, 'the row that is dropped')
    end subroutine test_later_rows

    !> An angle between the tolerance and its tenth is too large for QR to tell.
    subroutine test_unclear(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: angles(2) = [0.7e-7_wp, 3.0e-7_wp]
        integer, parameter :: ranks(2) = [2, 3]
        real(wp) :: a(3, 4)
        integer :: i

        do i = 1, 2
            a = 0.0_wp
            a(1, 1) = 1.0_wp
            a(2, 2) = 1.0_wp
            a(3, 1:2) = sqrt(0.5_wp)
            ! The smallest singular value is the angle over the square root of two.
            a(3, 3) = angles(i)*sqrt(2.0_wp)
            call check_count(error, count_independent(a, spread(1.0_wp, 1, 4), 3, 1.0e-7_wp), ranks(i), 'rank')
        end do
    end subroutine test_unclear
end module test_linalg_orthogonal
