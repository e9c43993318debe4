! SPDX-License-Identifier: MIT
!> Tests of explicit steps with so many constraints that LAPACK is used: the elimination of C, and whole runs.
module test_large
    use asserts, only: check_below, check_count, check_no_failure, check_text, check_true
    use differences, only: random_vector
    use model_copies, only: copies_type
    use model_moving_pivot, only: moving_pivot_type
    use model_redundant, only: redundant_type
    use model_skates, only: skates_type
    use runs, only: run
    use tandem, only: failure_type => error_type, long, options_type, simulation_type, statistics_type, wp
    use tandem_linalg_elimination, only: elimination_type, largest_small
    use testdrive, only: error_type, new_unittest, unittest_type
    use, intrinsic :: ieee_arithmetic, only: ieee_positive_inf, ieee_quiet_nan, ieee_value
    implicit none (type, external)
    private

    public :: collect_large

    !> Numbers of rows and columns: slightly and far above the limit of loops, with few free columns, with none, with many.
    integer, parameter :: sizes(2, 5) = reshape([largest_small + 1, largest_small + 4, 80, 110, 70, 71, 67, 67, 70, 140], [2, 5])

contains

    !> The suite.
    subroutine collect_large(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('right-inverse-and-null-space', test_split), &
            new_unittest('neighbours-are-eliminated-with-the-remembered-pivots', test_neighbours), &
            new_unittest('pivots-are-searched-anew-where-columns-depend-on-each-other', test_bad_pivots), &
            new_unittest('the-orientation-is-the-sign-of-the-determinant', test_orientation), &
            new_unittest('a-search-for-pivots-keeps-the-orientation', test_search), &
            new_unittest('rows-in-any-units', test_units), &
            new_unittest('bad-matrices-are-refused-and-leave-nothing-behind', test_bad), &
            new_unittest('seventy-pendulums-move-as-one-and-one', test_copies), &
            new_unittest('a-run-of-seventy-goes-on-where-it-was-saved', test_checkpoint), &
            new_unittest('the-start-of-two-hundred-skates-is-bounded-work', test_skates), &
            new_unittest('of-two-hundred-skates-a-row-that-repeats-two-others-is-left-out', test_redundant_skates)]
    end subroutine collect_large

    !> A random matrix of the given size, far from rank loss.
    subroutine fill(seed, c)
        integer, intent(inout) :: seed
        real(wp), intent(out) :: c(:, :)
        integer :: i, j

        do j = 1, size(c, 2)
            call random_vector(seed, c(:, j))
        end do
        do i = 1, size(c, 1)
            c(i, i) = c(i, i) + 4.0_wp
        end do
    end subroutine fill

    !> The largest entries of C R - I and C D, and of R and D.
    subroutine measure(c, elimination, defect, size_)
        real(wp), intent(in) :: c(:, :)
        type(elimination_type), intent(inout) :: elimination
        real(wp), intent(out) :: defect, size_
        real(wp), allocatable :: r(:, :), d(:, :), product(:, :)
        integer :: i

        allocate (r(size(c, 2), size(c, 1)), d(size(c, 2), size(c, 2) - size(c, 1)))
        call elimination%get_right_inverse(r)
        call elimination%get_null_space(d)
        product = matmul(c, r)
        do i = 1, size(c, 1)
            product(i, i) = product(i, i) - 1.0_wp
        end do
        defect = maxval(abs(product))
        size_ = maxval(abs(r))
        if (size(d) == 0) return
        defect = max(defect, maxval(abs(matmul(c, d))))
        size_ = max(size_, maxval(abs(d)))
    end subroutine measure

    subroutine test_split(error)
        type(error_type), allocatable, intent(out) :: error
        type(elimination_type) :: elimination
        real(wp), allocatable :: c(:, :)
        real(wp) :: defect, size_
        integer :: i, seed, stat

        seed = 41
        do i = 1, size(sizes, 2)
            if (allocated(c)) deallocate (c)
            allocate (c(sizes(1, i), sizes(2, i)))
            call fill(seed, c)
            call elimination%allocate(size(c, 1), size(c, 2))
            call elimination%eliminate(c, spread(1.0_wp, 1, size(c, 2)), stat)
            call check_count(error, stat, 0, 'stat')
            call measure(c, elimination, defect, size_)
            call check_below(error, defect/max(1.0_wp, size_), 1.0e-13_wp, '|C R - I|, |C D|')
            if (allocated(error)) return
        end do
    end subroutine test_split

    subroutine test_neighbours(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: m = largest_small + 3, n = m + 7
        type(elimination_type) :: elimination
        real(wp) :: c(m, n), change(m, n), defect, size_
        integer :: choice, i, seed, stat

        seed = 42
        call fill(seed, c)
        call fill(seed, change)
        call elimination%allocate(m, n)
        do i = 0, 5
            call elimination%eliminate(c + 0.001_wp*i*change, spread(1.0_wp, 1, n), stat)
            call check_count(error, stat, 0, 'stat')
            if (i == 0) choice = elimination%choice
            call check_count(error, elimination%choice, choice, 'choice of pivots')
            call measure(c + 0.001_wp*i*change, elimination, defect, size_)
            call check_below(error, defect/max(1.0_wp, size_), 1.0e-13_wp, '|C R - I|, |C D|')
            if (allocated(error)) return
        end do
    end subroutine test_neighbours

    !> The pivot columns of one matrix are dependent, or nearly so, in the next.
    subroutine test_bad_pivots(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: m = largest_small + 1, n = m + 2
        type(elimination_type) :: elimination
        real(wp) :: c(m, n), bad(m, n), defect, size_, far
        integer :: choice, k, seed, stat

        seed = 43
        call fill(seed, c)
        do k = 0, 3
            far = merge(0.0_wp, 10.0_wp**(-5*k), k == 0)
            call elimination%allocate(m, n)
            call elimination%eliminate(c, spread(1.0_wp, 1, n), stat)
            choice = elimination%choice
            associate (first => elimination%order(1), second => elimination%order(2), free => elimination%order(n))
                bad = c
                bad(:, second) = c(:, first) + far*c(:, second)
                bad(:, free) = c(:, second)
            end associate
            call elimination%eliminate(bad, spread(1.0_wp, 1, n), stat)
            call check_count(error, stat, 0, 'stat')
            call check_true(error, elimination%choice /= choice, 'other pivots')
            call measure(bad, elimination, defect, size_)
            call check_below(error, size_, 20.0_wp, 'the largest entry of R and D')
            call check_below(error, defect, 1.0e-13_wp, '|C R - I|, |C D|')
            if (allocated(error)) return
        end do
    end subroutine test_bad_pivots

    !> It changes with the sign of a row and with an exchange of two, and with nothing else.
    subroutine test_orientation(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: m = largest_small + 1, n = m + 3
        type(elimination_type) :: elimination
        real(wp) :: c(m, n), other(m, n), scale(n)
        integer :: i, orientation, seed, stat

        seed = 44
        scale = 1.0_wp
        call fill(seed, c)
        call elimination%allocate(m, n)
        call elimination%eliminate(c, scale, stat)
        orientation = elimination%orientation()
        do i = 1, m - 1
            other = c
            other(i, :) = -c(i, :)
            call elimination%eliminate(other, scale, stat)
            call check_count(error, elimination%orientation(), -orientation, 'with a row negated')
            other = c
            other(i:i + 1, :) = c([i + 1, i], :)
            call elimination%eliminate(other, scale, stat)
            call check_count(error, elimination%orientation(), -orientation, 'with two rows exchanged')
            ! A search for pivots preserves it.
            call elimination%eliminate(c, scale, stat)
            call elimination%forget()
            call elimination%eliminate(c + 0.01_wp*other, scale, stat)
            call check_count(error, elimination%orientation(), orientation, 'after a search')
            if (allocated(error)) return
        end do
    end subroutine test_orientation

    !> Pivot columns become nearly dependent, with a determinant 1e-10 times as large, so that others are chosen.
    subroutine test_search(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: m = largest_small + 1, n = m + 2
        type(elimination_type) :: elimination
        real(wp) :: c(m, n), bad(m, n), scale(n)
        integer :: choice, i, j, orientation, seed, stat

        seed = 47
        scale = 1.0_wp
        do i = 1, 20
            do j = 1, n
                call random_vector(seed, c(:, j))
            end do
            call elimination%allocate(m, n)
            call elimination%eliminate(c, scale, stat)
            call check_count(error, stat, 0, 'stat')
            choice = elimination%choice
            orientation = elimination%orientation()
            associate (first => elimination%order(1), second => elimination%order(2), free => elimination%order(n))
                bad = c
                bad(:, second) = c(:, first) + 1.0e-10_wp*c(:, second)
                bad(:, free) = c(:, second)
            end associate
            call elimination%eliminate(bad, scale, stat)
            call check_count(error, stat, 0, 'stat')
            call check_true(error, elimination%choice /= choice, 'other pivots')
            call check_count(error, elimination%orientation(), orientation, 'orientation')
            if (allocated(error)) return
        end do
    end subroutine test_search

    !> Units of rows and of unknowns over forty decades.
    subroutine test_units(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: m = largest_small + 2, n = m + 5
        type(elimination_type) :: elimination, plain
        real(wp) :: c(m, n), other(m, n), d(n, n - m), expected(n, n - m), unit(m), scale(n)
        integer :: choice, i, pass, seed, stat

        seed = 45
        call fill(seed, c)
        call random_vector(seed, unit)
        call random_vector(seed, scale)
        unit = 2.0_wp**nint(60*unit)
        scale = 2.0_wp**nint(60*scale)
        do i = 1, m
            other(i, :) = unit(i)*c(i, :)/scale
        end do
        call plain%allocate(m, n)
        call elimination%allocate(m, n)
        do pass = 1, 2
            call plain%eliminate(c, spread(1.0_wp, 1, n), stat)
            call plain%get_null_space(expected)
            call elimination%eliminate(other, scale, stat)
            call check_count(error, stat, 0, 'stat')
            call elimination%get_null_space(d)
            do i = 1, n - m
                d(:, i) = d(:, i)/scale*scale(elimination%order(m + i))
            end do
            call check_true(error, all(elimination%order == plain%order), 'the same pivots')
            if (pass == 1) choice = elimination%choice
            call check_count(error, elimination%choice, choice, 'choice of pivots')
            call check_below(error, maxval(abs(d - expected)), 1.0e-13_wp, 'D in other units')
            if (allocated(error)) return
        end do
    end subroutine test_units

    !> A row of zeros or a dependent one, and entries that are not finite, with stored pivots and without.
    subroutine test_bad(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: m = largest_small + 1, n = m + 3
        type(elimination_type) :: elimination
        real(wp) :: c(m, n), bad(m, n), scale(n), defect, size_
        integer :: i, pass, seed, stat

        seed = 46
        scale = 1.0_wp
        call fill(seed, c)
        call elimination%allocate(m, n)
        do pass = 1, 2
            do i = 1, n
                if (pass == 2) call elimination%eliminate(c, scale, stat)
                bad = c
                bad(1 + modulo(7*i, m), i) = ieee_value(1.0_wp, ieee_quiet_nan)
                if (modulo(i, 2) == 0) bad(1 + modulo(7*i, m), i) = ieee_value(1.0_wp, ieee_positive_inf)
                call elimination%eliminate(bad, scale, stat)
                call check_count(error, stat, -1, 'stat of a matrix that is not finite')
                if (pass == 2) call elimination%eliminate(c, scale, stat)
                bad = c
                bad(1 + modulo(5*i, m), :) = 0.0_wp
                call elimination%eliminate(bad, scale, stat)
                call check_count(error, stat, 1 + modulo(5*i, m), 'the row without a pivot')
                if (pass == 2) call elimination%eliminate(c, scale, stat)
                bad = c
                bad(m, :) = 0.3_wp*c(1 + modulo(5*i, m - 1), :) - 0.7_wp*c(1 + modulo(5*i + 1, m - 1), :)
                call elimination%eliminate(bad, scale, stat)
                call check_count(error, stat, m, 'the row that depends on others')
                if (allocated(error)) return
            end do
        end do
        call elimination%eliminate(c, scale, stat)
        call check_count(error, stat, 0, 'stat')
        call measure(c, elimination, defect, size_)
        call check_below(error, defect, 1.0e-13_wp, '|C R - I|, |C D| afterwards')
    end subroutine test_bad

    !> A model of copies with moving pivots, and their starts.
    subroutine set_up(model, one, q, qd)
        type(copies_type), intent(out) :: model
        type(moving_pivot_type), intent(inout), target :: one
        real(wp), allocatable, intent(out) :: q(:), qd(:)
        integer :: i

        one%swing = 0.1_wp
        one%fall = 0.0_wp
        call one%define()
        model%one => one
        model%copies = 70
        model%mixing = 0.9_wp
        call model%define()
        allocate (q(model%n), qd(model%n))
        do i = 1, model%copies
            call one%motion(0.0_wp, 0.1_wp*i, 3.0_wp - 0.07_wp*i, q(2*i - 1:2*i), qd(2*i - 1:2*i))
        end do
    end subroutine set_up

    !> Every copy against a separate run of it, with loops.
    subroutine test_copies(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=7), parameter :: steppers(3) = ['rk4    ', 'dop853 ', 'sdirk54']
        real(wp), parameter :: t_end(3) = [0.2_wp, 0.2_wp, 0.02_wp]
        type(copies_type), target :: model
        type(moving_pivot_type), target :: one
        type(simulation_type) :: all_, alone
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)
        real(wp) :: off
        integer :: i, k

        call set_up(model, one, q, qd)
        do k = 1, size(steppers)
            options%stepper = steppers(k)
            options%step = 0.01_wp
            call run(all_, model, options, 0.0_wp, q, qd, t_end(k), failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            off = 0.0_wp
            do i = 1, model%copies
                call run(alone, one, options, 0.0_wp, q(2*i - 1:2*i), qd(2*i - 1:2*i), t_end(k), failure)
                call check_no_failure(error, failure)
                if (allocated(error)) return
                off = max(off, maxval(abs(all_%state%q(2*i - 1:2*i) - alone%state%q)), &
                    maxval(abs(all_%state%qd(2*i - 1:2*i) - alone%state%qd)), &
                    maxval(abs(all_%state%qdd(2*i - 1:2*i) - alone%state%qdd)))
            end do
            call check_below(error, off, 1.0e-10_wp, 'difference of state and acceleration')
            call check_below(error, maxval(all_%errors), 1.0e-14_wp, 'constraint errors')
        end do
    end subroutine test_copies

    !> Bitwise, from a state that was saved in another run.
    subroutine test_checkpoint(error)
        type(error_type), allocatable, intent(out) :: error
        type(copies_type), target :: model
        type(moving_pivot_type), target :: one
        type(simulation_type) :: whole, part
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:), lambda(:), expected(:)
        integer(long), allocatable :: words(:)

        call set_up(model, one, q, qd)
        options%stepper = 'dop853'
        options%rtol = 1.0e-6_wp
        options%atol = 1.0e-6_wp
        call whole%initialize(model, options, 0.0_wp, q, qd, failure)
        call whole%integrate(0.6_wp, failure)
        call whole%save_state(words, failure)
        call check_no_failure(error, failure)
        allocate (lambda(model%copies), expected(model%copies))
        call whole%multipliers(expected)
        call whole%integrate(0.7_wp, failure)
        call check_no_failure(error, failure)
        call part%initialize(model, options, 0.0_wp, q, qd, failure)
        call part%restore_state(words, failure)
        call check_no_failure(error, failure)
        call part%multipliers(lambda)
        call check_below(error, maxval(abs(lambda - expected)), 0.0_wp, 'difference of the multipliers')
        call part%integrate(0.7_wp, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call check_below(error, maxval(abs(part%state%q - whole%state%q)) + maxval(abs(part%state%qd - whole%state%qd)), 0.0_wp, &
            'difference')
        call check_true(error, whole%state%t > 0.69_wp, 'at the end')
    end subroutine test_checkpoint

    !> Integrability of rows is tested along a few directions, for any number of rows and coordinates: 200 rows of 600 coordinates
    !> cost as many evaluations as one row of four. An integrable one among them is still found.
    subroutine test_skates(error)
        type(error_type), allocatable, intent(out) :: error
        !> C at a point; the ends of four directions for tests of each row, and of three for all rows.
        integer, parameter :: point = 1, each = 2*4, together = 2*3
        type(skates_type), target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)
        integer :: k

        model%skates = 200
        call model%define()
        allocate (q(model%n), qd(model%n))
        call model%start(q, qd)
        do k = 0, 1
            model%disguised = 77*k
            call simulation%initialize(model, options_type(step=1.0e-3_wp), 0.0_wp, q, qd, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            statistics = simulation%statistics()
            if (k == 0) then
                call check_true(error, .not. allocated(simulation%warnings), 'no row is integrable')
                call check_count(error, statistics%start_evaluations, point + each + together, 'evaluations of C in the search')
            else
                call check_true(error, allocated(simulation%warnings), 'one is')
                if (allocated(error)) return
                call check_count(error, size(simulation%warnings), 1, 'integrable rows')
                call check_text(error, simulation%warnings(1)%text, '"nonholonomic 77" is integrable')
                call check_count(error, statistics%start_evaluations, 3*(point + each) + together, 'evaluations at three points')
            end if
        end do
    end subroutine test_skates

    !> It alone is found and dropped among many, and the others move as without it.
    subroutine test_redundant_skates(error)
        type(error_type), allocatable, intent(out) :: error
        type(skates_type), target :: model
        type(redundant_type), target :: whole
        type(simulation_type) :: simulation, plain
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)

        model%skates = 200
        call model%define()
        allocate (q(model%n), qd(model%n))
        call model%start(q, qd)
        options%step = 0.01_wp
        call run(plain, model, options, 0.0_wp, q, qd, 0.02_wp, failure)
        call check_no_failure(error, failure)
        call whole%wrap(model, [17, 90], [0.5_wp, -2.0_wp], 'sum')
        call run(simulation, whole, options, 0.0_wp, q, qd, 0.02_wp, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call check_count(error, simulation%n_redundant, 1, 'rows that are left out')
        call check_true(error, allocated(simulation%warnings), 'a warning')
        if (allocated(error)) return
        ! Of rows of unit length it has the largest part in 0.5 a - 2 b - sum = 0.
        call check_text(error, simulation%warnings(1)%text, '"sum" repeats "nonholonomic 17", "nonholonomic 90"')
        call check_below(error, maxval(abs(simulation%state%q - plain%state%q)), 1.0e-12_wp, 'difference to the run without it')
    end subroutine test_redundant_skates
end module test_large
