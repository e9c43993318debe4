! SPDX-License-Identifier: MIT
!> Tests of the parts of the sparse chart's steps against plain formulas: inverses and products of small blocks of every size, and
!> rows of hinges that are evaluated together.
module test_sparse_kernels
    use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
    use asserts, only: check_close, check_count, check_no_failure
    use large_mechanisms, only: make_large
    use scattered_numbers, only: scattered
    use tandem, only: failure_type => error_type, mechanism_type, wp
    use tandem_chart_sparse_blocks, only: keep_rows, most_coordinates, multiply_right, read_behind, subtract_transposed, &
        subtract_update
    use tandem_chart_sparse_errors, only: judge_rows, judge_velocity
    use tandem_chart_sparse_factor, only: factor_type
    use tandem_chart_sparse_inverses, only: invert, invert_fives, side_by_side
    use tandem_chart_sparse_masses, only: invert_rigid
    use tandem_chart_sparse_meetings, only: of_hinges, of_pins
    use tandem_chart_sparse_newton_kernels, only: multiply, subtract
    use tandem_chart_sparse_system, only: system_type
    use tandem_model_counts, only: counts_type
    use tandem_model_terms, only: need_gamma, need_jacobian, need_mass, need_phi, terms_type
    use tandem_rigid_euler_parameters, only: rotation
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_sparse_kernels

contains

    !> The suite.
    subroutine collect_sparse_kernels(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('inverses', test_inverses), &
            new_unittest('inverses-side-by-side', test_side_by_side), &
            new_unittest('masses-of-rigid-bodies', test_masses), &
            new_unittest('dependent-rows-of-a-block', test_dependent), &
            new_unittest('products', test_products), &
            new_unittest('products-of-newton-matrices', test_newton_products), &
            new_unittest('hinges', test_hinges), &
            new_unittest('joints-that-make-points-meet', test_meetings), &
            new_unittest('rows-of-joints-that-make-points-meet', test_rows)]
    end subroutine collect_sparse_kernels

    !> A symmetric matrix that is definite.
    pure function definite(s, seed) result(a)
        integer, intent(in) :: s, seed
        real(wp) :: a(s, s)
        integer :: i

        a = reshape(scattered(s*s, seed), [s, s])
        a = matmul(a, transpose(a))
        do i = 1, s
            a(i, i) = a(i, i) + 0.5_wp
        end do
    end function definite

    !> A A^-1 = 1, of either sign, and the pivots are those of Gauss.
    subroutine test_inverses(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: a(most_coordinates, most_coordinates), inverse(most_coordinates**2), product(most_coordinates**2)
        real(wp) :: alone(most_coordinates), pivots(most_coordinates), sign
        integer :: i, k, pass, s, worst

        do s = 1, most_coordinates
            do pass = 1, 2
                sign = 3.0_wp - 2*pass
                a(:s, :s) = sign*definite(s, s + pass)
                inverse(:s*s) = reshape(a(:s, :s), [s*s])
                alone(:s) = [(abs(a(i, i)), i=1, s)]
                call invert(s, inverse(:s*s), alone(:s), sign, 1.0e-12_wp, worst)
                call check_count(error, worst, 0, 'a pivot that is too small')
                product(:s*s) = reshape(matmul(a(:s, :s), reshape(inverse(:s*s), [s, s])), [s*s])
                do i = 1, s
                    product((i - 1)*s + i) = product((i - 1)*s + i) - 1
                end do
                call check_close(error, product(:s*s), spread(0.0_wp, 1, s*s), 1.0e-13_wp, 'A A^-1 and 1')
                pivots(:s) = [(1/abs(a(i, i)), i=1, s)]
                do k = 1, s
                    pivots(k) = sign*a(k, k)*pivots(k)
                    do i = k + 1, s
                        a(i, k + 1:s) = a(i, k + 1:s) - a(i, k)/a(k, k)*a(k, k + 1:s)
                    end do
                end do
                call check_close(error, alone(:s), pivots(:s), 1.0e-13_wp, 'pivots')
            end do
        end do
    end subroutine test_inverses

    !> Several inverses at once: A A^-1 = 1 and the pivots of one at a time, of either sign; a singular one, or one with NaN, is
    !> reported and does not affect the others.
    subroutine test_side_by_side(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: a(5, 5, side_by_side), x(side_by_side, 5, 5), alone(side_by_side, 5), inverse(25), single(5), sign
        integer :: i, j, k, l, pass, worst(side_by_side), one

        do pass = 1, 4
            sign = 3.0_wp - 2*(1 + modulo(pass, 2))
            do l = 1, side_by_side
                a(:, :, l) = sign*definite(5, 10*pass + l)
            end do
            if (pass == 3) then
                a(3, :, 2) = 2*a(1, :, 2)
                a(:, 3, 2) = 2*a(:, 1, 2)
                a(3, 3, 2) = 4*a(1, 1, 2)
            else if (pass == 4) then
                a(4, 4, 2) = ieee_value(1.0_wp, ieee_quiet_nan)
            end if
            do l = 1, side_by_side
                do j = 1, 5
                    alone(l, j) = a(j, j, l)
                    x(l, 1:j, j) = a(1:j, j, l)
                    ! Entries below are not read.
                    x(l, j + 1:, j) = huge(1.0_wp)
                end do
            end do
            call invert_fives(x, alone, 1.0e-10_wp, worst)
            do l = 1, side_by_side
                k = 0
                if (pass > 2 .and. l == 2) k = pass
                call check_count(error, worst(l), k, 'the row of a pivot that is too small')
                if (k > 0) cycle
                do j = 1, 5
                    do i = 1, 5
                        inverse(5*(j - 1) + i) = x(l, min(i, j), max(i, j))
                    end do
                    single(j) = abs(a(j, j, l))
                end do
                call check_close(error, reshape(matmul(a(:, :, l), reshape(inverse, [5, 5])), [25]), &
                    [((merge(1.0_wp, 0.0_wp, i == j), i=1, 5), j=1, 5)], 1.0e-13_wp, 'A A^-1 and 1')
                inverse = reshape(a(:, :, l), [25])
                call invert(5, inverse, single, sign, 1.0e-10_wp, one)
                call check_close(error, alone(l, :), single, 1.0e-14_wp, 'pivots')
            end do
        end do
    end subroutine test_side_by_side

    !> W M + R c' = 1 and W c = 0 for bodies with Euler parameters, whose M has no inertia along c, and without an owned row; the
    !> first massless coordinate is reported.
    subroutine test_masses(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: n = 7*side_by_side
        real(wp) :: mass(n, 4), own(n), w(4, n), r(n), b(3, 4), unit(4, 4)
        integer :: first(side_by_side), i, k, l, n_bodies, worst(side_by_side)
        logical :: has_row(side_by_side)

        unit = 0.0_wp
        do i = 1, 4
            unit(i, i) = 1.0_wp
        end do
        do n_bodies = 1, side_by_side
            own = 0.0_wp
            mass = 0.0_wp
            w = 0.0_wp
            do l = 1, side_by_side
                k = 7*(l - 1)
                first(l) = k + 1
                has_row(l) = l /= 2
                mass(k + 1:k + 3, 1) = l
                own(k + 4:k + 7) = scattered(4, l)
                if (has_row(l)) then
                    b = reshape(scattered(12, 20 + l), [3, 4])
                    b = b - spread(matmul(b, own(k + 4:k + 7)), 2, 4)*spread(own(k + 4:k + 7), 1, 3)/sum(own(k + 4:k + 7)**2)
                    mass(k + 4:k + 7, :) = matmul(transpose(b), b)
                else
                    mass(k + 4:k + 7, :) = definite(4, l)
                end if
            end do
            call invert_rigid(n_bodies, first, has_row, n, mass, own, 4, w, r, worst)
            call check_count(error, sum(worst(:n_bodies)), 0, 'a coordinate without mass')
            do l = 1, n_bodies
                k = 7*(l - 1)
                associate (c => own(k + 4:k + 7), v => w(:, k + 4:k + 7), m => mass(k + 4:k + 7, :), u => r(k + 4:k + 7))
                    call check_close(error, [(w(1, k + i), i=1, 3)], spread(1.0_wp/l, 1, 3), 1.0e-15_wp, '1/mass')
                    call check_close(error, r(k + 1:k + 3), spread(0.0_wp, 1, 3), 0.0_wp, 'R of the point of reference')
                    if (has_row(l)) then
                        call check_close(error, matmul(v, c), spread(0.0_wp, 1, 4), 1.0e-11_wp, 'W c')
                        call check_close(error, reshape(matmul(v, m) + spread(u, 2, 4)*spread(c, 1, 4), [16]), &
                            reshape(unit, [16]), 1.0e-11_wp, 'W M + R c''')
                    else
                        call check_close(error, reshape(matmul(v, m), [16]), reshape(unit, [16]), 1.0e-13_wp, 'W M')
                        call check_close(error, u, spread(0.0_wp, 1, 4), 0.0_wp, 'R of no row')
                    end if
                end associate
            end do
        end do
        ! A massless coordinate, and three of the Euler parameters, for which a c c' gives inertia to one.
        mass(9, 1) = 0.0_wp
        mass(18:21, :) = 0.0_wp
        call invert_rigid(side_by_side, first, has_row, n, mass, own, 4, w, r, worst)
        call check_count(error, worst(1), 0, 'no coordinate of the first body')
        call check_count(error, worst(2), 2, 'the second coordinate')
        call check_count(error, worst(3), 5, 'the second Euler parameter')
    end subroutine test_masses

    !> Of rows that depend on previous ones, the first one is reported, and so is a NaN.
    subroutine test_dependent(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: a(most_coordinates, most_coordinates), x(most_coordinates**2), alone(most_coordinates)
        integer :: i, k, s, worst

        do s = 2, 7
            do k = 2, s
                a(:s, :s) = definite(s, s)
                a(k, :s) = 2*a(1, :s)
                a(:s, k) = 2*a(:s, 1)
                a(k, k) = 4*a(1, 1)
                x(:s*s) = reshape(a(:s, :s), [s*s])
                alone(:s) = [(a(i, i), i=1, s)]
                call invert(s, x(:s*s), alone(:s), 1.0_wp, 1.0e-10_wp, worst)
                call check_count(error, worst, k, 'the row that depends on the first')
                a(:s, :s) = definite(s, s)
                x(:s*s) = reshape(a(:s, :s), [s*s])
                alone(:s) = [(a(i, i), i=1, s)]
                x((k - 1)*s + k) = ieee_value(1.0_wp, ieee_quiet_nan)
                call invert(s, x(:s*s), alone(:s), 1.0_wp, 1.0e-10_wp, worst)
                call check_count(error, worst, k, 'the row with a NaN')
            end do
        end do
    end subroutine test_dependent

    !> L = B D^-1, X - L B', and f - B' z for blocks of all sizes.
    subroutine test_products(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), allocatable :: b(:), c(:), found(:), x(:)
        real(wp) :: l(most_coordinates**2)
        integer :: p, q, s

        do s = 1, 7
            do p = 1, 7
                b = [scattered(p*s, 3), spread(huge(1.0_wp), 1, read_behind)]
                x = reshape(definite(s, 4), [s*s])
                call multiply_right(p, s, b, x, l)
                associate (expected => matmul(reshape(b(:p*s), [p, s]), reshape(x, [s, s])))
                    do q = 1, 7
                        c = scattered(q*s, 5)
                        found = scattered(p*q, 6)
                        call subtract_update(p, q, s, l, c, found)
                        call check_close(error, found, scattered(p*q, 6) - &
                            reshape(matmul(expected, transpose(reshape(c, [q, s]))), [p*q]), 1.0e-13_wp, 'X - L B''')
                    end do
                    found = spread(0.0_wp, 1, p*s)
                    call keep_rows(p, s, l, found)
                    call check_close(error, found, reshape(expected, [p*s]), 1.0e-14_wp, 'L')
                    found = scattered(s, 6)
                    call subtract_transposed(p, s, b(:p*s), scattered(p, 5), found)
                    call check_close(error, found, scattered(s, 6) - matmul(transpose(reshape(b(:p*s), [p, s])), &
                        scattered(p, 5)), 1.0e-14_wp, 'f - B'' z')
                end associate
            end do
        end do
    end subroutine test_products

    !> y - A x and A x of every size.
    subroutine test_newton_products(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: a(13*13), x(13), y(13)
        integer :: p, s

        do s = 1, 13
            x(:s) = scattered(s, 1)
            do p = 1, 13
                a(:p*s) = scattered(p*s, 2)
                y(:p) = scattered(p, 3)
                call subtract(p, s, a, x, y)
                call check_close(error, y(:p), scattered(p, 3) - matmul(reshape(a(:p*s), [p, s]), x(:s)), 1.0e-14_wp, 'y - A x')
            end do
            a(:s*s) = scattered(s*s, 4)
            call multiply(s, a, x, y)
            call check_close(error, y(:s), matmul(reshape(a(:s*s), [s, s]), x(:s)), 1.0e-14_wp, 'A x')
            if (allocated(error)) return
        end do
    end subroutine test_newton_products

    !> Rows of a chain of hinges at any coordinates, also off the constraints: Phi by rotations, C and gamma by differences.
    subroutine test_hinges(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type) :: mechanism
        type(failure_type), allocatable :: failure
        real(wp), parameter :: step = 1.0e-5_wp
        real(wp), allocatable :: q(:), qd(:), slope(:), curve(:)
        type(terms_type) :: here, before, behind
        real(wp) :: a(3, 3), last(3, 3), r(3), at(3), axis(3), x(3)
        integer :: i, stat

        call make_large('spatial_chain', 3, mechanism, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        associate (n => mechanism%n, m => mechanism%n_holonomic)
            allocate (q(n), qd(n))
            call mechanism%start(q, qd)
            q = q + 0.3_wp*scattered(n, 1)
            qd = scattered(n, 2)
            call here%allocate(n, m, 0)
            call before%allocate(n, m, 0)
            call behind%allocate(n, m, 0)
            call mechanism%evaluate(need_phi + need_jacobian + need_gamma, 0.0_wp, q, qd, here, stat)
            call mechanism%evaluate(need_phi + need_jacobian, 0.0_wp, q - step*qd, qd, before, stat)
            call mechanism%evaluate(need_phi + need_jacobian, 0.0_wp, q + step*qd, qd, behind, stat)
            last = reshape([1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 1.0_wp], [3, 3])
            at = 0.0_wp
            do i = 1, 3
                r = q(7*i - 6:7*i - 4)
                a = rotation(q(7*i - 3:7*i))
                ! Rods of 1 m along x: coinciding ends, a common axis of the reference configuration.
                call check_close(error, here%phi(5*i - 4:5*i - 2), r - matmul(a, [0.5_wp, 0.0_wp, 0.0_wp]) - at, 1.0e-14_wp, &
                    'Phi of points that meet')
                axis = merge([0.0_wp, 1.0_wp, 0.0_wp], [0.0_wp, 0.8_wp, 0.6_wp], mod(i, 2) == 1)
                ! Components of the axis across the other body's, with directions across it of unit length.
                x = matmul(transpose(last), matmul(a, axis))
                x = x - dot_product(x, axis)*axis
                call check_close(error, [norm2(here%phi(5*i - 1:5*i))], [norm2(x)], 1.0e-14_wp, 'Phi of axes')
                at = r + matmul(a, [0.5_wp, 0.0_wp, 0.0_wp])
                last = a
            end do
            slope = (behind%phi - before%phi)/(2*step)
            call check_close(error, matmul(here%jacobian, qd), slope, 1.0e-8_wp, 'C qd')
            curve = matmul(behind%jacobian - before%jacobian, qd)/(2*step)
            call check_close(error, here%gamma, curve, 1.0e-8_wp, 'gamma')
        end associate
    end subroutine test_hinges

    !> Products and solutions of bodies held by hinges, or by pins, only, and of some held by others too, off the constraints:
    !> against C and M as full matrices. The remainder of M x + C' lambda = f is along rows owned by bodies.
    subroutine test_meetings(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=*), parameter :: names(4) = [character(len=14) :: 'spatial_chain', 'star', 'planar_chain', 'four_bars']
        integer, parameter :: joints(4) = [of_hinges, of_hinges, of_pins, of_pins]
        integer :: k

        do k = 1, size(names)
            if (.not. allocated(error)) call check_meetings(trim(names(k)), joints(k), error)
        end do
    end subroutine test_meetings

    !> For one mechanism.
    subroutine check_meetings(name, joint, error)
        character(len=*), intent(in) :: name
        !> Kind of joint between its bodies.
        integer, intent(in) :: joint
        type(error_type), allocatable, intent(inout) :: error
        type(mechanism_type), target :: mechanism
        type(failure_type), allocatable :: failure
        type(system_type) :: system
        type(counts_type) :: counts
        type(terms_type) :: terms
        real(wp), allocatable :: f(:), g(:), lambda(:), left(:), p(:), q(:), qd(:), rest(:), x(:), z(:)
        integer :: b, n, pass, stat

        call make_large(name, 12, mechanism, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        allocate (q(mechanism%n), qd(mechanism%n))
        call mechanism%start(q, qd)
        q = q + 0.1_wp*scattered(mechanism%n, 1)
        call system%initialize(mechanism, .false.)
        call system%visit(0.0_wp, q, counts, stat)
        if (stat == 0) call system%factorize(counts, stat)
        call check_count(error, stat, 0, 'the status of a factorization')
        if (allocated(error)) return
        call check_count(error, count(system%analysis%joints_of_body == joint), &
            count(.not. system%analysis%is_kept), 'bodies that have to do with '//name//' alone')
        call terms%allocate(mechanism%n, mechanism%n_holonomic, 0)
        call mechanism%evaluate(need_jacobian + need_mass, 0.0_wp, q, q, terms, stat)
        x = spread(0.0_wp, 1, mechanism%n)
        z = spread(0.0_wp, 1, system%analysis%n_unknowns)
        lambda = spread(0.0_wp, 1, mechanism%n_holonomic)
        associate (a => system%analysis, factor => system%factor(system%here))
            do pass = 1, 2
                f = (pass - 1)*scattered(mechanism%n, 2)
                g = scattered(mechanism%n_holonomic, 3)
                call factor%solve(a, pass == 2, f, g, x, z)
                left = g
                call factor%multiply(a, x, left)
                call check_close(error, left, 0.0_wp*g, 1.0e-11_wp, 'C x and g, '//name)
                call check_close(error, matmul(terms%jacobian, x), g, 1.0e-11_wp, 'C x by full matrices, '//name)
                do n = 1, a%n_nodes
                    if (.not. a%is_body(n)) lambda(a%origin(n):a%origin(n) + a%height(n) - 1) = &
                        z(a%place(n) + 1:a%place(n) + a%height(n))
                end do
                rest = f - matmul(terms%mass, x) - matmul(lambda, terms%jacobian)
                do b = 1, a%n_bodies
                    if (a%norm_row(b) == 0) cycle
                    p = terms%jacobian(a%norm_row(b), :)
                    rest = rest - p*dot_product(p, rest)/dot_product(p, p)
                end do
                call check_close(error, rest, 0.0_wp*rest, 1.0e-10_wp, 'M x + C'' lambda and f, '//name)
                if (allocated(error)) return
            end do
        end associate
    end subroutine check_meetings

    !> Rows without stored columns of positions, against full matrices: forces, lengths, errors, and the difference of two C.
    subroutine test_rows(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=*), parameter :: names(6) = [character(len=14) :: 'spatial_chain', 'star', 'planar_chain', 'four_bars', &
            'net', 'trailers']
        integer :: k

        do k = 1, size(names)
            if (.not. allocated(error)) call check_rows(trim(names(k)), error)
        end do
    end subroutine test_rows

    !> For one mechanism.
    subroutine check_rows(name, error)
        character(len=*), intent(in) :: name
        type(error_type), allocatable, intent(inout) :: error
        type(mechanism_type), target :: mechanism
        type(failure_type), allocatable :: failure
        type(system_type) :: system(2)
        type(factor_type) :: turn
        type(counts_type) :: counts
        type(terms_type) :: terms(2)
        real(wp), allocatable, dimension(:) :: f, lambda, left, q, qd, qdd, scale, squares, weight
        real(wp), allocatable :: scales(:, :), x(:, :)
        real(wp) :: errors(3)
        real(wp), parameter :: rate = 3.0_wp
        integer :: i, m, rows(3), stat

        call make_large(name, 12, mechanism, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        allocate (q(mechanism%n), qd(mechanism%n))
        call mechanism%start(q, qd)
        m = mechanism%n_constraints()
        qd = scattered(mechanism%n, 2)
        qdd = scattered(mechanism%n, 3)
        scale = abs(scattered(mechanism%n, 4))
        lambda = scattered(m, 5)
        do i = 1, 2
            call system(i)%initialize(mechanism, .false.)
            call system(i)%visit(0.0_wp, q + 0.1_wp*scattered(mechanism%n, i), counts, stat)
            if (stat == 0) call system(i)%load()
            call check_count(error, stat, 0, 'the status of an evaluation, '//name)
            call terms(i)%allocate(mechanism%n, mechanism%n_holonomic, m - mechanism%n_holonomic)
            call mechanism%evaluate(need_phi + need_jacobian + need_gamma, 0.0_wp, q + 0.1_wp*scattered(mechanism%n, i), qd, &
                terms(i), stat)
        end do
        if (allocated(error)) return
        associate (a => system(1)%analysis, one => system(1)%factor(system(1)%here), two => system(2)%factor(system(2)%here), &
            c => terms(1)%jacobian, change => terms(1)%jacobian - terms(2)%jacobian)
            f = scattered(mechanism%n, 6)
            call one%add_reactions(a, lambda, f)
            call check_close(error, f, scattered(mechanism%n, 6) - matmul(lambda, c), 1.0e-13_wp, 'f - C'' lambda, '//name)
            squares = spread(0.0_wp, 1, m)
            call one%add_squares(a, scale, squares)
            call check_close(error, squares, matmul(c**2, scale**2), 1.0e-13_wp, 'squared rows, '//name)
            squares = 0.0_wp
            call one%add_squares(a, scale, squares, two)
            call check_close(error, squares, matmul(change**2, scale**2), 1.0e-13_wp, 'squared changes of rows, '//name)
            ! Sums in natural scales.
            x = spread(scale, 2, 3)
            x(:, 1) = max(abs(q), scale)
            x(:, 2) = max(abs(qd), rate*scale)
            x(:, 3) = max(abs(qdd), rate**2*scale)
            x = matmul(abs(c), x)
            x(:, 2) = x(:, 2) + abs(terms(1)%nu)
            x(:, 3) = x(:, 3) + abs(terms(1)%gamma)
            scales = x(:, :2)
            call judge_rows(a, one, terms(1), mechanism%n_holonomic, q, qd, qdd, scale, rate, errors, rows, scales)
            call check_close(error, scales(:mechanism%n_holonomic, 1), x(:mechanism%n_holonomic, 1), 1.0e-13_wp, &
                'scales of positions, '//name)
            call check_close(error, scales(:, 2), x(:, 2), 1.0e-13_wp, 'scales of velocities, '//name)
            call check_close(error, errors, [maxval(abs(terms(1)%phi)/x(:mechanism%n_holonomic, 1)), &
                maxval(abs(matmul(c, qd) - terms(1)%nu)/x(:, 2)), maxval(abs(matmul(c, qdd) + terms(1)%gamma)/x(:, 3))], &
                1.0e-13_wp, 'errors, '//name)
            call check_count(error, rows(2), maxloc(abs(matmul(c, qd) - terms(1)%nu)/x(:, 2), 1), 'the worst row, '//name)
            left = spread(0.0_wp, 1, m)
            weight = left
            call judge_velocity(a, one, terms(1)%nu, qd, scale, rate, left, weight)
            call check_close(error, left, terms(1)%nu - matmul(c, qd), 1.0e-13_wp, 'what a velocity leaves, '//name)
            call check_close(error, 1.0_wp/weight, x(:, 2), 1.0e-13_wp, 'its weights, '//name)
            ! C as the difference of two.
            turn%is_difference = .true.
            turn%c = one%c - two%c
            turn%own = one%own - two%own
            f = scattered(mechanism%n, 6)
            call turn%add_reactions(a, lambda, f)
            call check_close(error, f, scattered(mechanism%n, 6) - matmul(lambda, change), 1.0e-13_wp, 'forces of a change, '//name)
            left = scattered(m, 7)
            call turn%multiply(a, qd, left)
            call check_close(error, left, scattered(m, 7) - matmul(change, qd), 1.0e-13_wp, 'rates of a change, '//name)
        end associate
    end subroutine check_rows
end module test_sparse_kernels
