! SPDX-License-Identifier: MIT
!> Tests of the elimination of C: a right inverse and a null-space basis, by loops for few rows and by LAPACK for many.
module test_linalg_elimination
    use asserts, only: check_below, check_count, check_true
    use differences, only: random_vector
    use tandem, only: wp
    use tandem_linalg_elimination, only: elimination_type, largest_small
    use testdrive, only: error_type, new_unittest, test_failed, unittest_type
    use, intrinsic :: iso_c_binding, only: c_intptr_t, c_loc
    use, intrinsic :: ieee_arithmetic, only: ieee_negative_inf, ieee_positive_inf, ieee_quiet_nan, ieee_value
    use, intrinsic :: ieee_exceptions, only: ieee_divide_by_zero, ieee_get_flag, ieee_set_flag
    implicit none (type, external)
    private

    public :: collect_linalg_elimination

    !> Numbers of rows and columns: slightly and far above the limit of loops, with few free columns, with none, with many.
    integer, parameter :: large(2, 5) = reshape([largest_small + 1, largest_small + 4, 80, 110, 70, 71, 67, 67, 70, 140], [2, 5])

contains

    !> The suite.
    subroutine collect_linalg_elimination(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('right-inverse-and-null-space-of-random-matrices', test_random), &
            new_unittest('null-space-has-full-rank', test_full_rank), &
            new_unittest('free-columns-keep-the-order-of-the-coordinates', test_order), &
            new_unittest('neighbours-are-eliminated-with-the-remembered-pivots', test_neighbours), &
            new_unittest('pivots-are-searched-anew-where-they-have-become-bad', test_turning_row), &
            new_unittest('pivots-are-searched-anew-where-columns-depend-on-each-other', test_bad_pivots), &
            new_unittest('the-orientation-is-the-sign-of-the-determinant', test_orientation), &
            new_unittest('a-search-for-pivots-keeps-the-orientation', test_search), &
            new_unittest('rows-in-any-units', test_units), &
            new_unittest('a-turning-square-block-loses-no-digits', test_turning_block), &
            new_unittest('forget-searches-anew', test_forget), &
            new_unittest('a-pivot-that-has-vanished-is-not-divided-by', test_vanished), &
            new_unittest('scales-choose-the-pivots', test_scale), &
            new_unittest('a-row-without-pivot-is-named', test_no_pivot), &
            new_unittest('dependent-rows-of-large-matrices-are-named', test_bad_rows), &
            new_unittest('columns-begin-with-lines-of-the-cache', test_lines), &
            new_unittest('what-is-not-finite-is-noticed-in-every-entry', test_not_finite), &
            new_unittest('dependent-rows-are-reported-or-blow-up', test_dependent)]
    end subroutine collect_linalg_elimination

    !> Columns of eight numbers begin with lines of 64 bytes, and newly allocated arrays are zero.
    subroutine test_lines(error)
        type(error_type), allocatable, intent(out) :: error
        type(elimination_type), target :: elimination
        real(wp), allocatable :: others(:)
        integer :: m, n_astray

        n_astray = 0
        do m = 1, 8
            ! Spacer between two of them.
            allocate (others(2*m - 1), source=1.0_wp)
            call elimination%allocate(m, m + 3)
            n_astray = n_astray + offset_of(elimination%matrix) + offset_of(elimination%eliminated)
            call check_below(error, maxval(abs(elimination%matrix)) + maxval(abs(elimination%eliminated)), tiny(1.0_wp), &
                'fresh arrays')
            if (allocated(error)) return
            elimination%matrix = 1.0_wp
            deallocate (others)
        end do
        call check_count(error, n_astray, 0, 'bytes beside lines')
    end subroutine test_lines

    !> Bytes from the start of a line to that of an array.
    integer function offset_of(a)
        real(wp), intent(in), target, contiguous :: a(:, :)

        offset_of = int(modulo(transfer(c_loc(a), 0_c_intptr_t), 64_c_intptr_t))
    end function offset_of

    !> A random matrix; that of many rows is far from rank loss.
    subroutine fill(seed, c)
        integer, intent(inout) :: seed
        real(wp), intent(out) :: c(:, :)
        integer :: i, j

        do j = 1, size(c, 2)
            call random_vector(seed, c(:, j))
        end do
        if (size(c, 1) <= largest_small) return
        do i = 1, size(c, 1)
            c(i, i) = c(i, i) + 4.0_wp
        end do
    end subroutine fill

    !> |C R - I| and |C D|, relative to the sizes of R and D.
    subroutine measure(c, elimination, defect, size_)
        real(wp), intent(in) :: c(:, :)
        type(elimination_type), intent(in) :: elimination
        real(wp), intent(out) :: defect
        !> The largest entry of R and D.
        real(wp), intent(out) :: size_
        real(wp) :: r(size(c, 2), size(c, 1)), d(size(c, 2), size(c, 2) - size(c, 1)), product(size(c, 1), size(c, 1))
        integer :: i

        call elimination%get_right_inverse(r)
        call elimination%get_null_space(d)
        product = matmul(c, r)
        do i = 1, size(c, 1)
            product(i, i) = product(i, i) - 1
        end do
        size_ = 1.0_wp
        if (size(r) > 0) size_ = max(size_, maxval(abs(r)))
        if (size(d) > 0) size_ = max(size_, maxval(abs(d)))
        defect = 0.0_wp
        if (size(product) > 0) defect = maxval(abs(product))/size_
        if (size(d) > 0 .and. size(c) > 0) defect = max(defect, maxval(abs(matmul(c, d)))/size_)
    end subroutine measure

    !> Entries below one, and a growth of at most some tens with up to nine rows.
    subroutine test_random(error)
        type(error_type), allocatable, intent(out) :: error
        integer :: seed, i, m, n

        seed = 7
        do n = 1, 9
            do m = 0, n
                call test_size(m, n, 1.0e-14_wp)
                if (allocated(error)) return
            end do
        end do
        seed = 41
        do i = 1, size(large, 2)
            call test_size(large(1, i), large(2, i), 1.0e-13_wp)
            if (allocated(error)) return
        end do

    contains

        subroutine test_size(m, n, bound)
            integer, intent(in) :: m, n
            real(wp), intent(in) :: bound
            type(elimination_type) :: elimination
            real(wp) :: c(m, n), defect, size_
            integer :: stat

            call fill(seed, c)
            call elimination%allocate(m, n)
            call elimination%eliminate(c, spread(1.0_wp, 1, n), stat)
            call check_count(error, stat, 0, 'stat')
            call measure(c, elimination, defect, size_)
            call check_below(error, defect, bound, '|C R - I|, |C D|')
        end subroutine test_size
    end subroutine test_random

    subroutine test_order(error)
        type(error_type), allocatable, intent(out) :: error
        type(elimination_type) :: elimination
        real(wp) :: c(3, 9)
        integer :: seed, stat, i, misplaced

        seed = 12
        misplaced = 0
        call elimination%allocate(3, 9)
        do i = 1, 20
            call fill(seed, c)
            call elimination%forget()
            call elimination%eliminate(c, spread(1.0_wp, 1, 9), stat)
            misplaced = misplaced + count(elimination%order(4:8) > elimination%order(5:9))
        end do
        call check_count(error, misplaced, 0, 'free columns out of their order')
    end subroutine test_order

    !> NaN and Inf, in every entry, or in one of each column of many rows, with stored pivots and with a search; afterwards the
    !> elimination works again.
    subroutine test_not_finite(error)
        type(error_type), allocatable, intent(out) :: error
        integer :: seed, m, n

        seed = 11
        do n = 1, 10, 3
            do m = 1, n
                call test_size(m, n, 1.0e-14_wp)
                if (allocated(error)) return
            end do
        end do
        seed = 46
        call test_size(largest_small + 1, largest_small + 4, 1.0e-13_wp)

    contains

        subroutine test_size(m, n, bound)
            integer, intent(in) :: m, n
            real(wp), intent(in) :: bound
            type(elimination_type) :: elimination
            real(wp) :: c(m, n), bad(m, n), scale(n), values(3), defect, size_
            integer :: i, j, k, pass, stat

            values = [ieee_value(1.0_wp, ieee_quiet_nan), ieee_value(1.0_wp, ieee_positive_inf), &
                ieee_value(1.0_wp, ieee_negative_inf)]
            call fill(seed, c)
            scale = 1.0_wp
            call elimination%allocate(m, n)
            do pass = 1, 2
                do j = 1, n
                    do i = 1, m
                        if (m > largest_small .and. i /= 1 + modulo(7*j, m)) cycle
                        do k = 1, 3
                            if (pass == 2) call elimination%eliminate(c, scale, stat)
                            bad = c
                            bad(i, j) = values(k)
                            call elimination%eliminate(bad, scale, stat)
                            call check_count(error, stat, -1, 'stat of a matrix that is not finite')
                            if (allocated(error)) return
                        end do
                    end do
                end do
            end do
            call elimination%eliminate(c, scale, stat)
            call check_count(error, stat, 0, 'stat')
            call measure(c, elimination, defect, size_)
            call check_below(error, defect, bound, '|C R - I|, |C D| afterwards')
        end subroutine test_size
    end subroutine test_not_finite

    !> D contains the identity in the rows of its free columns.
    subroutine test_full_rank(error)
        type(error_type), allocatable, intent(out) :: error
        type(elimination_type) :: elimination
        real(wp) :: c(4, 7), d(7, 3)
        integer :: seed, stat, i, j, found

        seed = 8
        call fill(seed, c)
        call elimination%allocate(4, 7)
        call elimination%eliminate(c, spread(1.0_wp, 1, 7), stat)
        call elimination%get_null_space(d)
        found = 0
        do i = 1, 7
            do j = 1, 3
                if (abs(d(i, j) - 1) <= 0.0_wp .and. sum(abs(d(i, :))) <= 1) found = found + 1
            end do
        end do
        call check_count(error, found, 3, 'unit rows of D')
    end subroutine test_full_rank

    subroutine test_neighbours(error)
        type(error_type), allocatable, intent(out) :: error

        call test_size(9, 4, 7, 10, 1.0e-14_wp)
        call test_size(42, largest_small + 3, largest_small + 10, 5, 1.0e-13_wp)

    contains

        subroutine test_size(first_seed, m, n, steps, bound)
            integer, intent(in) :: first_seed, m, n, steps
            real(wp), intent(in) :: bound
            type(elimination_type) :: elimination, fresh
            real(wp) :: c(m, n), change(m, n), d(n, n - m), d_fresh(n, n - m), defect, size_
            integer :: choice, i, seed, stat

            if (allocated(error)) return
            seed = first_seed
            call fill(seed, c)
            call fill(seed, change)
            call elimination%allocate(m, n)
            do i = 0, steps
                call elimination%eliminate(c + 0.001_wp*i*change, spread(1.0_wp, 1, n), stat)
                call check_count(error, stat, 0, 'stat')
                if (i == 0) choice = elimination%choice
                call check_count(error, elimination%choice, choice, 'choice of pivots')
                call measure(c + 0.001_wp*i*change, elimination, defect, size_)
                call check_below(error, defect, bound, '|C R - I|, |C D|')
                if (allocated(error)) return
            end do
            call fresh%allocate(m, n)
            call fresh%eliminate(c + 0.001_wp*steps*change, spread(1.0_wp, 1, n), stat)
            call elimination%get_null_space(d)
            call fresh%get_null_space(d_fresh)
            call check_below(error, maxval(abs(d - d_fresh)), 1.0e-13_wp, 'D with remembered pivots against a new search')
        end subroutine test_size
    end subroutine test_neighbours

    !> (cos a, sin a) turns once: no column can stay the pivot, and |Y| would grow without bound.
    subroutine test_turning_row(error)
        type(error_type), allocatable, intent(out) :: error
        type(elimination_type) :: elimination
        real(wp) :: c(1, 2), a, defect, size_
        integer :: stat, i

        call elimination%allocate(1, 2)
        do i = 0, 1000
            a = 8*atan(1.0_wp)*i/1000
            c(1, :) = [cos(a), sin(a)]
            call elimination%eliminate(c, [1.0_wp, 1.0_wp], stat)
            call check_count(error, stat, 0, 'stat')
            call measure(c, elimination, defect, size_)
            call check_below(error, defect, 1.0e-15_wp, '|C R - I|, |C D|')
            ! Stored pivots allow |Y| up to 10, and with it 1/pivot up to sqrt(101).
            call check_below(error, size_, 10.1_wp, 'the largest entry of R and D')
            if (allocated(error)) return
        end do
    end subroutine test_turning_row

    !> Two rows whose pivot columns turn into each other: Y stays small, while the leading pivot passes through zero.
    subroutine test_turning_block(error)
        type(error_type), allocatable, intent(out) :: error
        type(elimination_type) :: elimination
        real(wp) :: c(2, 3), a, defect, size_, worst
        integer :: stat, i

        worst = 0.0_wp
        call elimination%allocate(2, 3)
        do i = 0, 1000
            ! The grid passes 1e-12 from a quarter turn: an unpivoted elimination loses twelve digits there.
            a = 2*atan(1.0_wp)*i/500 + 1.0e-12_wp
            c(1, :) = [cos(a), -sin(a), 0.1_wp]
            c(2, :) = [sin(a), cos(a), 0.2_wp]
            call elimination%eliminate(c, [1.0_wp, 1.0_wp, 1.0_wp], stat)
            call check_count(error, stat, 0, 'stat')
            if (allocated(error)) return
            call measure(c, elimination, defect, size_)
            worst = max(worst, defect)
        end do
        ! Growth with the stored pivots may cost a digit or two.
        call check_below(error, worst, 1.0e-13_wp, '|C R - I|, |C D|')
    end subroutine test_turning_block

    subroutine test_forget(error)
        type(error_type), allocatable, intent(out) :: error
        type(elimination_type) :: elimination
        real(wp) :: d(2, 1)
        integer :: stat

        call elimination%allocate(1, 2)
        call elimination%eliminate(reshape([1.0_wp, 0.5_wp], [1, 2]), [1.0_wp, 1.0_wp], stat)
        ! The first column stays the pivot although the second one has become larger ...
        call elimination%eliminate(reshape([1.0_wp, 2.0_wp], [1, 2]), [1.0_wp, 1.0_wp], stat)
        call elimination%get_null_space(d)
        call check_below(error, abs(d(2, 1) - 1), 0.0_wp, 'D with the first pivot')
        ! ... until the pivots are discarded.
        call elimination%forget()
        call elimination%eliminate(reshape([1.0_wp, 2.0_wp], [1, 2]), [1.0_wp, 1.0_wp], stat)
        call elimination%get_null_space(d)
        call check_below(error, abs(d(1, 1) - 1), 0.0_wp, 'D with the second pivot')
    end subroutine test_forget

    !> Programs that link the solver may trap floating-point exceptions.
    subroutine test_vanished(error)
        type(error_type), allocatable, intent(out) :: error
        type(elimination_type) :: elimination
        real(wp) :: c(2, 3)
        logical :: was_raised
        integer :: k, stat

        do k = 1, 2
            call elimination%allocate(2, 3)
            c = reshape([2.0_wp, 0.0_wp, 0.0_wp, 2.0_wp, 1.0_wp, 1.0_wp], [2, 3])
            call elimination%eliminate(c, spread(1.0_wp, 1, 3), stat)
            c(k, k) = 0.0_wp
            call ieee_set_flag(ieee_divide_by_zero, .false.)
            call elimination%eliminate(c, spread(1.0_wp, 1, 3), stat)
            call ieee_get_flag(ieee_divide_by_zero, was_raised)
            call check_count(error, stat, 0, 'stat')
            if (allocated(error)) return
            call check_count(error, merge(1, 0, was_raised), 0, 'divisions by zero')
            if (allocated(error)) return
        end do
    end subroutine test_vanished

    subroutine test_scale(error)
        type(error_type), allocatable, intent(out) :: error
        type(elimination_type) :: elimination
        real(wp) :: d(2, 1)
        integer :: stat

        call elimination%allocate(1, 2)
        ! In units a thousand times smaller the second unknown is the one that matters.
        call elimination%eliminate(reshape([1.0_wp, 0.01_wp], [1, 2]), [1.0_wp, 1000.0_wp], stat)
        call elimination%get_null_space(d)
        call check_below(error, abs(d(1, 1) - 1), 0.0_wp, 'D with the second pivot')
    end subroutine test_scale

    subroutine test_no_pivot(error)
        type(error_type), allocatable, intent(out) :: error
        type(elimination_type) :: elimination
        real(wp) :: c(3, 5)
        integer :: seed, stat

        seed = 10
        call fill(seed, c)
        c(2, :) = 0.0_wp
        call elimination%allocate(3, 5)
        call elimination%eliminate(c, spread(1.0_wp, 1, 5), stat)
        call check_count(error, stat, 2, 'row without pivot')
        ! A failure has no effect on later calls.
        call fill(seed, c)
        call elimination%eliminate(c, spread(1.0_wp, 1, 5), stat)
        call check_count(error, stat, 0, 'status of the next matrix')
    end subroutine test_no_pivot

    !> A dependent row gives a zero or a rounding error as pivot by chance; it must not pass as independent.
    subroutine test_dependent(error)
        type(error_type), allocatable, intent(out) :: error
        type(elimination_type) :: elimination
        real(wp) :: c(3, 5), defect, size_
        integer :: seed, stat, i

        seed = 12
        call elimination%allocate(3, 5)
        do i = 1, 20
            call fill(seed, c)
            c(3, :) = 0.3_wp*c(1, :) - 0.7_wp*c(2, :)
            call elimination%eliminate(c, spread(1.0_wp, 1, 5), stat)
            if (stat /= 0) cycle
            call measure(c, elimination, defect, size_)
            if (size_ < 1.0e13_wp) call test_failed(error, 'dependent rows were eliminated as if they were good')
            if (allocated(error)) return
        end do
    end subroutine test_dependent

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
            call check_below(error, defect*size_, 1.0e-13_wp, '|C R - I|, |C D|')
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

    !> A row of zeros or a dependent one, with stored pivots and without; afterwards the elimination works again.
    subroutine test_bad_rows(error)
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
        call check_below(error, defect*size_, 1.0e-13_wp, '|C R - I|, |C D| afterwards')
    end subroutine test_bad_rows
end module test_linalg_elimination
