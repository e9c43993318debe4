! SPDX-License-Identifier: MIT
!> Tests of the parts of the chart: natural scales, the paper's refinement of inverses, the index-0 equations.
module test_dense_parts
    use asserts, only: check_below, check_close, check_count, check_true
    use differences, only: random_vector
    use tandem, only: long, wp
    use tandem_linalg_basis, only: basis_type
    use tandem_linalg_elimination, only: elimination_type
    use tandem_linalg_lu, only: lu_type
    use tandem_status, only: status_chart_left, status_ok, status_singular_mass
    use tandem_chart_dense_dynamics, only: dynamics_type
    use tandem_model_natural_scale, only: constraint_errors, position_errors, velocity_errors
    use tandem_model_terms, only: terms_type
    use tandem_linalg_refinement, only: refinement_type
    use testdrive, only: error_type, new_unittest, unittest_type
    use, intrinsic :: ieee_arithmetic, only: ieee_positive_inf, ieee_quiet_nan, ieee_value
    implicit none (type, external)
    private

    public :: collect_dense_parts

contains

    !> The suite.
    subroutine collect_dense_parts(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('position-error-is-relative-to-the-terms-of-its-row', test_position_scale), &
            new_unittest('velocity-error-counts-the-right-side', test_velocity_scale), &
            new_unittest('acceleration-error-counts-gamma', test_acceleration_scale), &
            new_unittest('errors-at-rest-have-a-floor', test_floor), &
            new_unittest('errors-name-their-row', test_row), &
            new_unittest('errors-of-a-nan-are-infinite', test_nan), &
            new_unittest('errors-without-rows-name-none', test_no_rows), &
            new_unittest('errors-of-all-levels-are-those-of-plain-formulas', test_errors), &
            new_unittest('refinement-converges-quadratically', test_refinement), &
            new_unittest('refinement-leaves-a-good-inverse-alone', test_refinement_good), &
            new_unittest('refinement-stops-at-a-tolerance-below-rounding', test_refinement_rounding), &
            new_unittest('refinement-reports-a-start-that-is-too-far', test_refinement_far), &
            new_unittest('refinement-reports-a-singular-matrix', test_refinement_singular), &
            new_unittest('acceleration-solves-the-equations-of-motion', test_dynamics), &
            new_unittest('acceleration-does-not-depend-on-the-basis', test_dynamics_basis), &
            new_unittest('acceleration-of-a-singular-mass-matrix', test_dynamics_singular), &
            new_unittest('mass-that-is-singular-on-the-null-space-is-refused', test_dynamics_refused), &
            new_unittest('projection-minimizes-the-distance-in-the-mass-metric', test_projection)]
    end subroutine collect_dense_parts

    subroutine test_position_scale(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: c(1, 2), worst
        integer :: row

        c(1, :) = [3.0_wp, -4.0_wp]
        ! |3 * 10| + |-4 * 5| = 50.
        call position_errors([1.0_wp], c, [10.0_wp, 5.0_wp], [1.0_wp, 1.0_wp], worst, row)
        call check_below(error, abs(worst - 0.02_wp), 1.0e-17_wp, 'deviation from 1/50')
        call check_count(error, row, 1, 'row')
    end subroutine test_position_scale

    subroutine test_velocity_scale(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: c(1, 2), worst
        integer :: row

        c(1, :) = [3.0_wp, -4.0_wp]
        ! Residual 30 - 20 - 50 = -40, scale 30 + 20 + 50.
        call velocity_errors([50.0_wp], c, [10.0_wp, 5.0_wp], [1.0_wp, 1.0_wp], worst, row)
        call check_below(error, abs(worst - 0.4_wp), 1.0e-16_wp, 'deviation from 0.4')
    end subroutine test_velocity_scale

    !> Terms with given constraints.
    pure function terms_of(phi, nu, gamma, c) result(terms)
        real(wp), intent(in) :: phi(:), nu(:), gamma(:), c(:, :)
        type(terms_type) :: terms

        allocate (terms%phi, source=phi)
        allocate (terms%nu, source=nu)
        allocate (terms%gamma, source=gamma)
        allocate (terms%jacobian, source=c)
    end function terms_of

    subroutine test_acceleration_scale(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: c(1, 2), errors(3)
        integer :: rows(3)

        c(1, :) = [3.0_wp, -4.0_wp]
        ! Residual 30 - 20 + 50 = 60, scale 30 + 20 + 50; the levels before as above.
        call constraint_errors(terms_of([1.0_wp], [50.0_wp], [50.0_wp], c), [10.0_wp, 5.0_wp], [10.0_wp, 5.0_wp], &
            [10.0_wp, 5.0_wp], [1.0_wp, 1.0_wp], 1.0_wp, errors, rows)
        call check_below(error, maxval(abs(errors - [0.02_wp, 0.4_wp, 0.6_wp])), 1.0e-16_wp, 'deviation from 1/50, 0.4, 0.6')
        call check_true(error, all(rows == 1), 'rows')
    end subroutine test_acceleration_scale

    subroutine test_floor(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: c(1, 2), worst
        integer :: row

        c(1, :) = [3.0_wp, -4.0_wp]
        ! At rest the coordinates' magnitudes 2 and 0.5 replace them: 6 + 2.
        call position_errors([1.0_wp], c, [0.0_wp, 0.0_wp], [2.0_wp, 0.5_wp], worst, row)
        call check_below(error, abs(worst - 0.125_wp), 1.0e-17_wp, 'deviation from 1/8')
        call velocity_errors([0.0_wp], c, [0.0_wp, 0.0_wp], [2.0_wp, 0.5_wp], worst, row)
        call check_below(error, worst, 0.0_wp, 'velocity error at rest')
    end subroutine test_floor

    subroutine test_row(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: c(3, 2), worst
        integer :: row

        c = 1.0_wp
        call position_errors([1.0e-3_wp, -2.0e-3_wp, 1.5e-3_wp], c, [1.0_wp, 1.0_wp], [1.0_wp, 1.0_wp], worst, row)
        call check_count(error, row, 2, 'row')
        call velocity_errors([2.0_wp, 2.0_wp, 2.1_wp], c, [1.0_wp, 1.0_wp], [1.0_wp, 1.0_wp], worst, row)
        call check_count(error, row, 3, 'row')
    end subroutine test_row

    subroutine test_nan(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: c(2, 2), phi(2), worst, errors(3)
        integer :: row, rows(3)

        c = 1.0_wp
        phi = [0.0_wp, ieee_value(1.0_wp, ieee_quiet_nan)]
        call position_errors(phi, c, [1.0_wp, 1.0_wp], [1.0_wp, 1.0_wp], worst, row)
        call check_true(error, worst >= huge(1.0_wp), 'the error of a NaN')
        call check_count(error, row, 2, 'row')
        ! Of several equal ones the first.
        call constraint_errors(terms_of(phi, [phi(2), phi(2)], phi, c), c(:, 1), c(:, 1), c(:, 1), c(:, 1), 1.0_wp, errors, &
            rows)
        call check_true(error, all(errors >= huge(1.0_wp)), 'the errors of NaNs')
        call check_true(error, all(rows == [2, 1, 2]), 'rows')
        c(2, 1) = phi(2)
        call constraint_errors(terms_of([0.0_wp, 0.0_wp], c(:, 2), c(:, 2), c), c(:, 2), c(:, 2), c(:, 2), [1.0_wp, 1.0_wp], &
            1.0_wp, errors, rows)
        call check_true(error, all(errors(2:) >= huge(1.0_wp)), 'the errors of a NaN in C')
        call check_true(error, all(rows(2:) == 2), 'rows')
        ! After a row with an error, and infinite like its own scale.
        c(2, 1) = ieee_value(1.0_wp, ieee_positive_inf)
        call velocity_errors([0.0_wp, 0.0_wp], c, [1.0_wp, 1.0_wp], [1.0_wp, 1.0_wp], worst, row)
        call check_true(error, worst >= huge(1.0_wp), 'the error of an infinite entry of C')
        call check_count(error, row, 2, 'row')
    end subroutine test_nan

    !> Every level against a plain formula, with numbers of rows and columns that fill, and do not fill, the blocks of the loops.
    subroutine test_errors(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), allocatable :: c(:, :), phi(:), nu(:), gamma(:), q(:), qd(:), qdd(:), scale(:)
        real(wp) :: errors(3), expected(3), single
        integer :: seed, m, n, nh, rows(3), row

        seed = 8
        do n = 1, 12
            do m = 1, 20
                nh = m/2
                c = random_matrix(seed, m, n)
                phi = random_column(seed, nh)
                nu = random_column(seed, m)
                gamma = random_column(seed, m)
                q = random_column(seed, n)
                qd = random_column(seed, n)
                qdd = random_column(seed, n)
                scale = 0.5_wp + abs(random_column(seed, n))
                ! A row of zeros is its own scale, and without a right-hand side it has no error.
                c(1 + m/3, :) = 0.0_wp
                call constraint_errors(terms_of(phi, nu, gamma, c), q, qd, qdd, scale, 1.0_wp, errors, rows)
                expected = [level(c(:nh, :), phi, 0*c(:nh, 1), q, scale), level(c, matmul(c, qd) - nu, nu, qd, scale), &
                    level(c, matmul(c, qdd) + gamma, gamma, qdd, scale)]
                call check_below(error, maxval(abs(errors - expected)/max(expected, tiny(1.0_wp))), 1.0e-12_wp, 'the three errors')
                call check_true(error, all(rows <= m) .and. all(rows(2:) >= 1) .and. (rows(1) >= 1 .eqv. nh > 0), 'rows')
                if (nh > 0) then
                    call position_errors(phi, c, q, scale, single, row)
                    call check_below(error, abs(single - errors(1)), 1.0e-14_wp*errors(1), 'the position error alone')
                    call check_count(error, row, rows(1), 'its row')
                end if
                call velocity_errors(nu, c, qd, scale, single, row)
                call check_below(error, abs(single - errors(2)), 1.0e-14_wp*errors(2), 'the velocity error alone')
                call check_count(error, row, rows(2), 'its row')
                if (allocated(error)) return
            end do
        end do

    contains

        !> The largest residual on the scale of its row.
        real(wp) function level(c, residual, g, y, scale)
            real(wp), intent(in) :: c(:, :), residual(:), g(:), y(:), scale(:)

            level = maxval([0.0_wp, abs(residual)/max(tiny(1.0_wp), matmul(abs(c), max(abs(y), scale)) + abs(g))])
        end function level

        function random_column(seed, n) result(x)
            integer, intent(inout) :: seed
            integer, intent(in) :: n
            real(wp) :: x(n)

            call random_vector(seed, x)
        end function random_column

        function random_matrix(seed, m, n) result(a)
            integer, intent(inout) :: seed
            integer, intent(in) :: m, n
            real(wp) :: a(m, n)
            integer :: j

            do j = 1, n
                call random_vector(seed, a(:, j))
            end do
        end function random_matrix
    end subroutine test_errors

    subroutine test_no_rows(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: c(0, 2), none(0), worst
        integer :: row

        call velocity_errors(none, c, [1.0_wp, 1.0_wp], [1.0_wp, 1.0_wp], worst, row)
        call check_count(error, row, 0, 'row')
        call check_below(error, worst, 0.0_wp, 'error')
    end subroutine test_no_rows

    !> With |I - A B| = 0.1 the defects are 1e-1, 1e-2, 1e-4, 1e-8, 1e-16: four corrections.
    subroutine test_refinement(error)
        type(error_type), allocatable, intent(out) :: error
        type(refinement_type) :: refinement
        real(wp) :: a(2, 2)
        integer(long) :: corrections
        integer :: stat

        a = reshape([2.0_wp, 0.0_wp, 0.0_wp, 4.0_wp], [2, 2])
        call refinement%allocate(2)
        refinement%inverse = reshape([0.45_wp, 0.0_wp, 0.0_wp, 0.225_wp], [2, 2])
        corrections = 0
        call refinement%refine(a, 1.0e-12_wp, corrections, stat)
        call check_count(error, stat, status_ok, 'stat')
        call check_count(error, corrections, 4, 'corrections')
        call check_close(error, reshape(refinement%inverse, [4]), [0.5_wp, 0.0_wp, 0.0_wp, 0.25_wp], 1.0e-15_wp, 'inverses')
        if (allocated(error)) return
        refinement%inverse = reshape([0.45_wp, 0.0_wp, 0.0_wp, 0.225_wp], [2, 2])
        corrections = 0
        call refinement%refine(a, 1.0e-3_wp, corrections, stat)
        call check_count(error, corrections, 2, 'corrections to 1e-3')
    end subroutine test_refinement

    subroutine test_refinement_good(error)
        type(error_type), allocatable, intent(out) :: error
        type(refinement_type) :: refinement
        integer(long) :: corrections
        integer :: stat

        call refinement%allocate(2)
        refinement%inverse = reshape([0.5_wp, 0.0_wp, 0.0_wp, 0.25_wp], [2, 2])
        corrections = 0
        call refinement%refine(reshape([2.0_wp, 0.0_wp, 0.0_wp, 4.0_wp], [2, 2]), 1.0e-12_wp, corrections, stat)
        call check_count(error, stat, status_ok, 'stat')
        call check_count(error, corrections, 0, 'corrections')
    end subroutine test_refinement_good

    subroutine test_refinement_rounding(error)
        type(error_type), allocatable, intent(out) :: error
        type(refinement_type) :: refinement
        type(lu_type) :: lu
        real(wp) :: a(5, 5)
        integer(long) :: corrections
        integer :: i, j, stat

        do j = 1, 5
            do i = 1, 5
                a(i, j) = 1/real(i + j, wp) + merge(1.0_wp, 0.0_wp, i == j)
            end do
        end do
        call lu%allocate(5)
        call lu%factor(a, stat)
        call refinement%allocate(5)
        call lu%invert(refinement%inverse)
        refinement%inverse = 1.01_wp*refinement%inverse
        corrections = 0
        call refinement%refine(a, 0.0_wp, corrections, stat)
        call check_count(error, stat, status_ok, 'stat')
        call check_true(error, corrections < 10, 'the iteration should see that it stands still')
    end subroutine test_refinement_rounding

    subroutine test_refinement_far(error)
        type(error_type), allocatable, intent(out) :: error
        type(refinement_type) :: refinement
        integer(long) :: corrections
        integer :: stat

        call refinement%allocate(1)
        refinement%inverse(1, 1) = 2.1_wp
        corrections = 0
        ! |1 - 2.1| > 1: it diverges.
        call refinement%refine(reshape([1.0_wp], [1, 1]), 1.0e-12_wp, corrections, stat)
        call check_count(error, stat, status_chart_left, 'stat')
    end subroutine test_refinement_far

    subroutine test_refinement_singular(error)
        type(error_type), allocatable, intent(out) :: error
        type(refinement_type) :: refinement
        integer(long) :: corrections
        integer :: stat

        call refinement%allocate(2)
        refinement%inverse = reshape([1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp], [2, 2])
        corrections = 0
        call refinement%refine(reshape([1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp], [2, 2]), 1.0e-12_wp, corrections, stat)
        call check_count(error, stat, status_chart_left, 'stat')
    end subroutine test_refinement_singular

    !> A random problem: M (n, n) of a given rank, C (m, n), gamma, force.
    subroutine set_problem(seed, rank, mass, c, gamma, force)
        integer, intent(inout) :: seed
        integer, intent(in) :: rank
        real(wp), intent(out) :: mass(:, :), c(:, :), gamma(:), force(:)
        real(wp) :: column(size(mass, 1))
        integer :: j

        mass = 0.0_wp
        do j = 1, rank
            call random_vector(seed, column)
            column(j) = column(j) + 2
            mass = mass + spread(column, 1, size(column))*spread(column, 2, size(column))
        end do
        do j = 1, size(c, 2)
            call random_vector(seed, c(:, j))
        end do
        call random_vector(seed, gamma)
        call random_vector(seed, force)
    end subroutine set_problem

    !> M qdd + C' lambda = force and C qdd = -gamma as one linear system.
    subroutine solve_directly(mass, c, gamma, force, qdd, lambda)
        real(wp), intent(in) :: mass(:, :), c(:, :), gamma(:), force(:)
        real(wp), intent(out) :: qdd(:), lambda(:)
        real(wp) :: a(size(force) + size(gamma), size(force) + size(gamma)), b(size(force) + size(gamma))
        type(lu_type) :: lu
        integer :: n, stat

        n = size(force)
        a = 0.0_wp
        a(:n, :n) = mass
        a(n + 1:, :n) = c
        a(:n, n + 1:) = transpose(c)
        b = [force, -gamma]
        call lu%allocate(size(b))
        call lu%factor(a, stat)
        call lu%solve(b)
        qdd = b(:n)
        lambda = b(n + 1:)
    end subroutine solve_directly

    !> R and D of C by elimination.
    subroutine split(c, right_inverse, null_space)
        real(wp), intent(in) :: c(:, :)
        real(wp), intent(out) :: right_inverse(:, :), null_space(:, :)
        type(elimination_type) :: elimination
        integer :: stat

        call elimination%allocate(size(c, 1), size(c, 2))
        call elimination%eliminate(c, spread(1.0_wp, 1, size(c, 2)), stat)
        call elimination%get_right_inverse(right_inverse)
        call elimination%get_null_space(null_space)
    end subroutine split

    subroutine test_dynamics(error)
        type(error_type), allocatable, intent(out) :: error

        call check_dynamics(6, error)
    end subroutine test_dynamics

    !> M has rank 4; D' M D is definite all the same.
    subroutine test_dynamics_singular(error)
        type(error_type), allocatable, intent(out) :: error

        call check_dynamics(4, error)
    end subroutine test_dynamics_singular

    subroutine check_dynamics(rank, error)
        integer, intent(in) :: rank
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: n = 6, m = 3
        type(dynamics_type) :: dynamics
        real(wp) :: mass(n, n), c(m, n), gamma(m), force(n), r(n, m), d(n, n - m)
        real(wp) :: qdd(n), lambda(m), qdd_expected(n), lambda_expected(m)
        integer :: i, seed, stat

        seed = 31
        call dynamics%allocate(n, n - m)
        do i = 1, 5
            call set_problem(seed, rank, mass, c, gamma, force)
            call split(c, r, d)
            call dynamics%factor(mass, d, stat)
            call check_count(error, stat, status_ok, 'stat')
            if (allocated(error)) return
            call dynamics%solve(mass, d, r, gamma, force, qdd, stat)
            call dynamics%polish(c, r, gamma, qdd)
            call check_count(error, stat, status_ok, 'stat')
            call dynamics%multipliers(mass, r, force, qdd, lambda)
            call solve_directly(mass, c, gamma, force, qdd_expected, lambda_expected)
            ! Condition numbers of random problems are up to 1e4.
            call check_close(error, qdd, qdd_expected, 1.0e-11_wp*(1 + maxval(abs(qdd_expected))), 'qdd')
            call check_close(error, lambda, lambda_expected, 1.0e-11_wp*(1 + maxval(abs(lambda_expected))), 'lambda')
            call check_below(error, maxval(abs(matmul(c, qdd) + gamma)), 1.0e-15_wp*(1 + maxval(abs(qdd)))*n, 'C qdd + gamma')
        end do
    end subroutine check_dynamics

    !> Any R with C R = I and any D with C D = 0 give the same.
    subroutine test_dynamics_basis(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: n = 6, m = 3
        type(dynamics_type) :: dynamics
        type(basis_type) :: basis
        type(lu_type) :: lu
        real(wp) :: mass(n, n), c(m, n), gamma(m), force(n), r(n, m), d(n, n - m), h(m, m)
        real(wp) :: qdd(n), lambda(m), qdd_basis(n), lambda_basis(m)
        integer :: seed, stat

        seed = 32
        call set_problem(seed, n, mass, c, gamma, force)
        call dynamics%allocate(n, n - m)
        call split(c, r, d)
        call dynamics%factor(mass, d, stat)
        call dynamics%solve(mass, d, r, gamma, force, qdd, stat)
        call dynamics%polish(c, r, gamma, qdd)
        call dynamics%multipliers(mass, r, force, qdd, lambda)
        call basis%allocate(n, 1, m)
        call basis%factor_qr(c, spread(1.0_wp, 1, n), n)
        call lu%allocate(m)
        call lu%factor(matmul(c, basis%q(:, :m)), stat)
        call lu%invert(h)
        r = matmul(basis%q(:, :m), h)
        d = basis%q(:, m + 1:)
        call dynamics%factor(mass, d, stat)
        call dynamics%solve(mass, d, r, gamma, force, qdd_basis, stat)
        call dynamics%polish(c, r, gamma, qdd_basis)
        call dynamics%multipliers(mass, r, force, qdd_basis, lambda_basis)
        call check_close(error, qdd_basis, qdd, 1.0e-12_wp*(1 + maxval(abs(qdd))), 'qdd')
        call check_close(error, lambda_basis, lambda, 1.0e-12_wp*(1 + maxval(abs(lambda))), 'lambda')
    end subroutine test_dynamics_basis

    subroutine test_dynamics_refused(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: n = 6, m = 3
        type(dynamics_type) :: dynamics
        real(wp) :: mass(n, n), c(m, n), gamma(m), force(n), r(n, m), d(n, n - m)
        integer :: seed, stat

        seed = 33
        call set_problem(seed, 2, mass, c, gamma, force)
        call split(c, r, d)
        call dynamics%allocate(n, n - m)
        call dynamics%factor(mass, d, stat)
        call check_count(error, stat, status_singular_mass, 'stat')
        if (allocated(error)) return
        call dynamics%factor(-mass, d, stat)
        call check_count(error, stat, status_singular_mass, 'stat')
    end subroutine test_dynamics_refused

    !> The jump is M^-1 C' mu with mu = (C M^-1 C')^-1 (nu - C qd).
    subroutine test_projection(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: n = 6, m = 3
        type(dynamics_type) :: dynamics
        type(lu_type) :: lu
        real(wp) :: mass(n, n), c(m, n), nu(m), qd(n), r(n, m), d(n, n - m), solved(n, m), mu(m), expected(n)
        integer :: j, seed, stat

        seed = 34
        call set_problem(seed, n, mass, c, nu, qd)
        call lu%allocate(n)
        call lu%factor(mass, stat)
        do j = 1, m
            solved(:, j) = c(j, :)
            call lu%solve(solved(:, j))
        end do
        mu = nu - matmul(c, qd)
        call lu%allocate(m)
        call lu%factor(matmul(c, solved), stat)
        call lu%solve(mu)
        expected = qd + matmul(solved, mu)
        call split(c, r, d)
        call dynamics%allocate(n, n - m)
        call dynamics%factor(mass, d, stat)
        call dynamics%project(d, r, nu, qd)
        call check_close(error, qd, expected, 1.0e-12_wp*(1 + maxval(abs(expected))), 'qd')
        call check_close(error, matmul(c, qd), nu, 1.0e-14_wp*(1 + maxval(abs(qd))), 'C qd and nu')
    end subroutine test_projection
end module test_dense_parts
