! SPDX-License-Identifier: MIT
!> Tests of the orthonormal bases and of the rank decision.
module test_linalg_basis
    use asserts, only: check_below, check_count, check_true
    use differences, only: random_vector
    use tandem, only: wp
    use tandem_linalg_basis, only: basis_type, rank_tolerance
    use tandem_linalg_householder, only: factor_pivoted, form_columns
    use tandem_linalg_lapack, only: dgeqp3, dorgqr
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_linalg_basis

    !> Sizes n, nh, m of the matrices that every property is tested on.
    integer, parameter :: sizes(3, 9) = reshape([9, 4, 6, 6, 2, 5, 7, 4, 4, 5, 0, 2, 4, 4, 4, 4, 0, 4, 5, 2, 5, 3, 1, 1, &
        12, 5, 8], [3, 9])
    !> Rounding of products of orthogonal matrices of order 12 and less.
    real(wp), parameter :: rounding = 5.0e-15_wp

contains

    !> The suite.
    subroutine collect_linalg_basis(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('qr-gives-an-orthonormal-matrix', test_qr_orthonormal), &
            new_unittest('svd-gives-an-orthonormal-matrix', test_svd_orthonormal), &
            new_unittest('v-and-w-of-qr-are-null-spaces', test_qr_null_spaces), &
            new_unittest('v-and-w-of-svd-are-null-spaces', test_svd_null_spaces), &
            new_unittest('qr-and-svd-span-the-same-spaces', test_same_spans), &
            new_unittest('leading-columns-of-x-span-the-rows-of-phi', test_leading_columns), &
            new_unittest('fewer-columns-are-the-first-of-all', test_fewer_columns), &
            new_unittest('scales-act-on-the-columns-of-the-matrix', test_scale), &
            new_unittest('no-rows-give-the-identity', test_no_rows), &
            new_unittest('duplicate-row-is-named', test_duplicate_row), &
            new_unittest('zero-row-is-named', test_zero_row), &
            new_unittest('duplicate-among-the-nonholonomic-rows-is-blamed-there', test_duplicate_nonholonomic), &
            new_unittest('nonholonomic-copy-of-a-holonomic-row-is-the-one-to-blame', test_copy_across), &
            new_unittest('svd-names-the-duplicate-row-too', test_duplicate_svd), &
            new_unittest('near-dependence-is-decided-at-the-rank-tolerance', test_near_dependence), &
            new_unittest('constraints-of-condition-5e8-are-usable-and-of-1e12-are-not', test_conditions), &
            new_unittest('rank-does-not-depend-on-the-units-of-a-row', test_row_units), &
            new_unittest('secant-is-that-of-the-largest-angle', test_secant), &
            new_unittest('loops-and-lapack-agree', test_lapack)]
    end subroutine collect_linalg_basis

    !> Pivots, reflectors and Q of the loops for small matrices are those of LAPACK.
    subroutine test_lapack(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: n = 20, m = 12
        real(wp) :: a(n, m, 2), q(n, n, 2), tau(m, 2), work(32*(n + 1))
        integer :: info, order(m, 2), seed

        seed = 400
        a(:, :, 1) = random_matrix(seed, n, m)
        ! Columns of several lengths, so that pivots are needed.
        a(:, :, 1) = a(:, :, 1)*spread([(10.0_wp**modulo(5*info, 4), info=1, m)], 1, n)
        a(:, :, 2) = a(:, :, 1)
        call factor_pivoted(n, m, m, a(:, :, 1), tau(:, 1), order(:, 1))
        order(:, 2) = 0
        call dgeqp3(n, m, a(:, :, 2), n, order(:, 2), tau(:, 2), work, size(work), info)
        call check_count(error, count(order(:, 1) /= order(:, 2)), 0, 'other pivots')
        if (allocated(error)) return
        call check_below(error, maxval(abs(a(:, :, 1) - a(:, :, 2)))/maxval(abs(a)), 10*rounding, 'factors')
        if (allocated(error)) return
        call check_below(error, maxval(abs(tau(:, 1) - tau(:, 2))), 10*rounding, 'sizes of the reflectors')
        if (allocated(error)) return
        call form_columns(n, m, n, a(:, :, 1), tau(:, 1), q(:, :, 1))
        q(:, :m, 2) = a(:, :, 2)
        call dorgqr(n, n, m, q(:, :, 2), n, tau(:, 2), work, size(work), info)
        call check_below(error, maxval(abs(q(:, :, 1) - q(:, :, 2))), 10*rounding, 'Q')
    end subroutine test_lapack

    !> A random matrix C of the sizes with number i, and its factorisation.
    subroutine factor(i, method, c, basis)
        integer, intent(in) :: i
        character(len=*), intent(in) :: method
        real(wp), allocatable, intent(out) :: c(:, :)
        type(basis_type), intent(out) :: basis
        integer :: seed

        associate (n => sizes(1, i), nh => sizes(2, i), m => sizes(3, i))
            seed = 100 + i
            c = random_matrix(seed, m, n)
            call basis%allocate(n, nh, m)
            if (method == 'qr') then
                call basis%factor_qr(c, spread(1.0_wp, 1, n), n)
            else
                call basis%factor_svd(c, spread(1.0_wp, 1, n))
            end if
        end associate
    end subroutine factor

    !> A matrix of random numbers from -1 to 1.
    function random_matrix(seed, rows, columns) result(matrix)
        integer, intent(inout) :: seed
        integer, intent(in) :: rows, columns
        real(wp) :: matrix(rows, columns)
        integer :: j

        do j = 1, columns
            call random_vector(seed, matrix(:, j))
        end do
    end function random_matrix

    !> max |Q'Q - I|.
    real(wp) function orthonormality(q)
        real(wp), intent(in) :: q(:, :)
        real(wp) :: gram(size(q, 2), size(q, 2))
        integer :: i

        gram = matmul(transpose(q), q)
        do i = 1, size(q, 2)
            gram(i, i) = gram(i, i) - 1
        end do
        orthonormality = maxval(abs(gram))
    end function orthonormality

    subroutine test_qr_orthonormal(error)
        type(error_type), allocatable, intent(out) :: error

        call check_orthonormal('qr', error)
    end subroutine test_qr_orthonormal

    subroutine test_svd_orthonormal(error)
        type(error_type), allocatable, intent(out) :: error

        call check_orthonormal('svd', error)
    end subroutine test_svd_orthonormal

    subroutine check_orthonormal(method, error)
        character(len=*), intent(in) :: method
        type(error_type), allocatable, intent(out) :: error
        real(wp), allocatable :: c(:, :)
        type(basis_type) :: basis
        integer :: i

        do i = 1, size(sizes, 2)
            call factor(i, method, c, basis)
            call check_true(error, .not. basis%deficient, 'random rows are independent')
            call check_below(error, orthonormality(basis%q), rounding, 'Q''Q - I')
            if (allocated(error)) return
        end do
    end subroutine check_orthonormal

    subroutine test_qr_null_spaces(error)
        type(error_type), allocatable, intent(out) :: error

        call check_null_spaces('qr', error)
    end subroutine test_qr_null_spaces

    subroutine test_svd_null_spaces(error)
        type(error_type), allocatable, intent(out) :: error

        call check_null_spaces('svd', error)
    end subroutine test_svd_null_spaces

    subroutine check_null_spaces(method, error)
        character(len=*), intent(in) :: method
        type(error_type), allocatable, intent(out) :: error
        real(wp), allocatable :: c(:, :)
        type(basis_type) :: basis
        integer :: i

        do i = 1, size(sizes, 2)
            call factor(i, method, c, basis)
            associate (nh => sizes(2, i), m => sizes(3, i))
                call check_below(error, largest(matmul(c(:nh, :), basis%q(:, nh + 1:))), rounding, 'Phi_q V')
                call check_below(error, largest(matmul(c, basis%q(:, m + 1:))), rounding, 'C W')
            end associate
            if (allocated(error)) return
        end do
    end subroutine check_null_spaces

    !> Projectors onto the spans of U, X, V and W do not depend on the method.
    subroutine test_same_spans(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), allocatable :: c(:, :)
        type(basis_type) :: qr, svd
        integer :: i

        do i = 1, size(sizes, 2)
            call factor(i, 'qr', c, qr)
            call factor(i, 'svd', c, svd)
            associate (nh => sizes(2, i), m => sizes(3, i))
                ! The projectors are as well determined as the spaces: a random matrix's condition number of up to 1e3.
                call check_below(error, largest(projector(qr%q(:, :nh)) - projector(svd%q(:, :nh))), 1.0e-12_wp, 'U')
                call check_below(error, largest(projector(qr%q(:, nh + 1:)) - projector(svd%q(:, nh + 1:))), 1.0e-12_wp, 'V')
                call check_below(error, largest(projector(qr%q(:, :m)) - projector(svd%q(:, :m))), 1.0e-12_wp, 'X')
                call check_below(error, largest(projector(qr%q(:, m + 1:)) - projector(svd%q(:, m + 1:))), 1.0e-12_wp, 'W')
            end associate
            if (allocated(error)) return
        end do
    end subroutine test_same_spans

    !> C X has the block form [Phi_q U, 0; E U, E Xe].
    subroutine test_leading_columns(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), allocatable :: c(:, :)
        type(basis_type) :: basis
        integer :: i

        do i = 1, size(sizes, 2)
            call factor(i, 'qr', c, basis)
            associate (nh => sizes(2, i), m => sizes(3, i))
                call check_below(error, largest(matmul(c(:nh, :), basis%q(:, nh + 1:m))), rounding, 'Phi_q Xe')
                call check_below(error, largest(c(:nh, :) - matmul(matmul(c(:nh, :), basis%q(:, :nh)), &
                    transpose(basis%q(:, :nh)))), rounding, 'what U leaves of the rows of Phi_q')
            end associate
            if (allocated(error)) return
        end do
    end subroutine test_leading_columns

    subroutine test_fewer_columns(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), allocatable :: c(:, :)
        type(basis_type) :: all, some
        integer :: i

        do i = 1, size(sizes, 2)
            call factor(i, 'qr', c, all)
            associate (n => sizes(1, i), nh => sizes(2, i), m => sizes(3, i))
                call some%allocate(n, nh, m)
                call some%factor_qr(c, spread(1.0_wp, 1, n), nh)
                call check_below(error, largest(some%q(:, :nh) - all%q(:, :nh)), rounding, 'nh columns')
                call some%factor_qr(c, spread(1.0_wp, 1, n), m)
                call check_below(error, largest(some%q(:, :m) - all%q(:, :m)), rounding, 'm columns')
            end associate
            if (allocated(error)) return
        end do
    end subroutine test_fewer_columns

    !> The bases are those of C diag(s).
    subroutine test_scale(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), allocatable :: c(:, :)
        real(wp) :: scale(9)
        type(basis_type) :: basis, expected
        integer :: j

        call factor(1, 'qr', c, basis)
        do j = 1, 9
            scale(j) = 10.0_wp**(mod(j, 4) - 2)
        end do
        call basis%factor_qr(c, scale, 9)
        call expected%allocate(9, 4, 6)
        call expected%factor_qr(c*spread(scale, 1, 6), spread(1.0_wp, 1, 9), 9)
        call check_below(error, largest(basis%q - expected%q), rounding, 'Q')
        call check_below(error, largest(matmul(c*spread(scale, 1, 6), basis%q(:, 7:))), rounding*10, 'C diag(s) W')
    end subroutine test_scale

    subroutine test_no_rows(error)
        type(error_type), allocatable, intent(out) :: error
        type(basis_type) :: basis
        real(wp) :: none(0, 3)
        integer :: i

        call basis%allocate(3, 0, 0)
        call basis%factor_qr(none, spread(1.0_wp, 1, 3), 0)
        call check_true(error, .not. basis%deficient, 'no rows are independent')
        do i = 1, 3
            call check_below(error, abs(basis%q(i, i) - 1), 0.0_wp, 'diagonal of Q')
        end do
        call check_below(error, sum(abs(basis%q)), 3.0_wp, 'sum of Q')
    end subroutine test_no_rows

    subroutine test_duplicate_row(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), allocatable :: c(:, :)
        type(basis_type) :: basis

        call factor(1, 'qr', c, basis)
        c(3, :) = -2*c(1, :)
        call basis%factor_qr(c, spread(1.0_wp, 1, 9), 9)
        call check_true(error, basis%deficient, 'rows 1 and 3 depend on each other')
        if (allocated(error)) return
        call check_true(error, any(basis%dependent_row == [1, 3]), 'row 1 or 3 should be named')
    end subroutine test_duplicate_row

    subroutine test_zero_row(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), allocatable :: c(:, :)
        type(basis_type) :: basis

        call factor(1, 'qr', c, basis)
        c(2, :) = 0.0_wp
        call basis%factor_qr(c, spread(1.0_wp, 1, 9), 9)
        call check_true(error, basis%deficient, 'a zero row is dependent')
        call check_count(error, basis%dependent_row, 2, 'dependent row')
    end subroutine test_zero_row

    subroutine test_duplicate_nonholonomic(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), allocatable :: c(:, :)
        type(basis_type) :: basis

        call factor(9, 'qr', c, basis)
        c(8, :) = 3*c(6, :)
        call basis%factor_qr(c, spread(1.0_wp, 1, 12), 12)
        call check_true(error, basis%deficient, 'rows 6 and 8 depend on each other')
        if (allocated(error)) return
        call check_true(error, any(basis%dependent_row == [6, 8]), 'row 6 or 8 should be named')
    end subroutine test_duplicate_nonholonomic

    !> Pivots are taken from the holonomic rows first, whatever their lengths.
    subroutine test_copy_across(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), allocatable :: c(:, :)
        type(basis_type) :: basis
        integer :: i

        do i = 1, 4
            call factor(1, 'qr', c, basis)
            c(6, :) = 1.0e6_wp*c(i, :)
            call basis%factor_qr(c, spread(1.0_wp, 1, 9), 9)
            call check_true(error, basis%deficient, 'row 6 copies a holonomic row')
            call check_count(error, basis%dependent_row, 6, 'dependent row')
            if (allocated(error)) return
        end do
    end subroutine test_copy_across

    subroutine test_duplicate_svd(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), allocatable :: c(:, :)
        type(basis_type) :: basis

        call factor(1, 'svd', c, basis)
        c(5, :) = c(2, :)
        call basis%factor_svd(c, spread(1.0_wp, 1, 9))
        call check_true(error, basis%deficient, 'row 5 copies row 2')
        call check_count(error, basis%dependent_row, 5, 'dependent row')
    end subroutine test_duplicate_svd

    !> Two unit rows at a small angle have the smallest singular value angle/sqrt(2), to first order.
    subroutine test_near_dependence(error)
        type(error_type), allocatable, intent(out) :: error
        type(basis_type) :: basis
        real(wp) :: c(2, 4), angle, expected
        integer :: i

        call basis%allocate(4, 1, 2)
        do i = -2, 2, 4
            ! The tolerance is relative to the largest singular value, here sqrt(2).
            expected = rank_tolerance*sqrt(2.0_wp)*10.0_wp**(0.25_wp*i)
            angle = expected*sqrt(2.0_wp)
            c(1, :) = [1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp]
            c(2, :) = [cos(angle), 0.0_wp, sin(angle), 0.0_wp]
            call basis%factor_qr(c, spread(1.0_wp, 1, 4), 4)
            call check_true(error, basis%deficient .eqv. i < 0, 'rank decision near the tolerance')
            ! Rounding of the rows, 1e-16, against 1e-10.
            call check_below(error, abs(basis%smallest/expected - 1), 1.0e-5_wp, 'smallest singular value')
            if (allocated(error)) return
        end do
    end subroutine test_near_dependence

    !> Two unit rows at a small angle have the condition number 2/angle.
    subroutine test_conditions(error)
        type(error_type), allocatable, intent(out) :: error
        type(basis_type) :: basis
        real(wp) :: c(2, 3), angle

        call basis%allocate(3, 2, 2)
        angle = 2/5.0e8_wp
        c(1, :) = [1.0_wp, 0.0_wp, 0.0_wp]
        c(2, :) = [cos(angle), sin(angle), 0.0_wp]
        call basis%factor_qr(c, spread(1.0_wp, 1, 3), 3)
        call check_true(error, .not. basis%deficient, 'a condition of 5e8 is usable')
        call check_below(error, largest(matmul(c, basis%q(:, 3:))), rounding, 'C W')
        angle = 2/1.0e12_wp
        c(2, :) = [cos(angle), sin(angle), 0.0_wp]
        call basis%factor_qr(c, spread(1.0_wp, 1, 3), 3)
        call check_true(error, basis%deficient, 'a condition of 1e12 is not')
    end subroutine test_conditions

    subroutine test_row_units(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), allocatable :: c(:, :)
        type(basis_type) :: basis, scaled

        call factor(1, 'qr', c, basis)
        call factor(1, 'qr', c, scaled)
        c(2, :) = 1.0e-14_wp*c(2, :)
        c(5, :) = 1.0e+14_wp*c(5, :)
        call scaled%factor_qr(c, spread(1.0_wp, 1, 9), 9)
        call check_true(error, .not. scaled%deficient, 'rows of other units are as independent')
        ! Rows of unit length are the same to rounding, and so is everything after.
        call check_below(error, abs(scaled%smallest - basis%smallest), 1.0e-14_wp, 'smallest')
        call check_below(error, largest(scaled%q - basis%q), 1.0e-13_wp, 'Q')
    end subroutine test_row_units

    subroutine test_secant(error)
        type(error_type), allocatable, intent(out) :: error
        type(basis_type) :: basis
        real(wp) :: cosines(2, 2), angle

        call basis%allocate(4, 1, 2)
        angle = 1.2_wp
        ! Cosines 1 and cos(angle), between rotations on either side.
        cosines = matmul(rotation(0.3_wp), matmul(reshape([1.0_wp, 0.0_wp, 0.0_wp, cos(angle)], [2, 2]), rotation(0.9_wp)))
        call check_below(error, abs(basis%largest_secant(cosines)*cos(angle) - 1), rounding, 'secant')
        call check_below(error, abs(basis%largest_secant(cosines(:0, :0)) - 1), 0.0_wp, 'secant of nothing')
    end subroutine test_secant

    !> A plane rotation.
    pure function rotation(angle)
        real(wp), intent(in) :: angle
        real(wp) :: rotation(2, 2)

        rotation = reshape([cos(angle), sin(angle), -sin(angle), cos(angle)], [2, 2])
    end function rotation

    !> The orthogonal projector onto the span of orthonormal columns.
    pure function projector(columns)
        real(wp), intent(in) :: columns(:, :)
        real(wp) :: projector(size(columns, 1), size(columns, 1))

        projector = matmul(columns, transpose(columns))
    end function projector

    !> The largest modulus, 0 for no entries.
    pure real(wp) function largest(matrix)
        real(wp), intent(in) :: matrix(:, :)

        largest = 0.0_wp
        if (size(matrix) > 0) largest = maxval(abs(matrix))
    end function largest
end module test_linalg_basis
