! SPDX-License-Identifier: MIT
!> Tests of the elimination of C: a right inverse and a null-space basis.
module test_linalg_elimination
    use asserts, only: check_below, check_count
    use differences, only: random_vector
    use tandem, only: wp
    use tandem_linalg_elimination, only: elimination_type
    use testdrive, only: error_type, new_unittest, test_failed, unittest_type
    use, intrinsic :: iso_c_binding, only: c_intptr_t, c_loc
    use, intrinsic :: ieee_arithmetic, only: ieee_negative_inf, ieee_positive_inf, ieee_quiet_nan, ieee_value
    use, intrinsic :: ieee_exceptions, only: ieee_divide_by_zero, ieee_get_flag, ieee_set_flag
    implicit none (type, external)
    private

    public :: collect_linalg_elimination

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
            new_unittest('a-turning-square-block-loses-no-digits', test_turning_block), &
            new_unittest('forget-searches-anew', test_forget), &
            new_unittest('a-pivot-that-has-vanished-is-not-divided-by', test_vanished), &
            new_unittest('scales-choose-the-pivots', test_scale), &
            new_unittest('a-row-without-pivot-is-named', test_no_pivot), &
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

    !> A random matrix.
    subroutine fill(seed, c)
        integer, intent(inout) :: seed
        real(wp), intent(out) :: c(:, :)
        integer :: j

        do j = 1, size(c, 2)
            call random_vector(seed, c(:, j))
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

    subroutine test_random(error)
        type(error_type), allocatable, intent(out) :: error
        type(elimination_type) :: elimination
        real(wp), allocatable :: c(:, :)
        real(wp) :: defect, size_
        integer :: seed, m, n, stat

        seed = 7
        do n = 1, 9
            do m = 0, n
                allocate (c(m, n))
                call fill(seed, c)
                call elimination%allocate(m, n)
                call elimination%eliminate(c, spread(1.0_wp, 1, n), stat)
                call check_count(error, stat, 0, 'stat')
                call measure(c, elimination, defect, size_)
                ! Nine rows of entries below one, and a growth of at most some tens.
                call check_below(error, defect, 1.0e-14_wp, '|C R - I|, |C D|')
                if (allocated(error)) return
                deallocate (c)
            end do
        end do
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

    !> NaN and Inf, in every entry, with stored pivots and with a search; afterwards the elimination works again.
    subroutine test_not_finite(error)
        type(error_type), allocatable, intent(out) :: error
        type(elimination_type) :: elimination
        real(wp), allocatable :: c(:, :), bad(:, :), scale(:)
        real(wp) :: values(3), defect, size_
        integer :: seed, m, n, i, j, k, pass, stat

        seed = 11
        values = [ieee_value(1.0_wp, ieee_quiet_nan), ieee_value(1.0_wp, ieee_positive_inf), &
            ieee_value(1.0_wp, ieee_negative_inf)]
        do n = 1, 10, 3
            do m = 1, n
                allocate (c(m, n))
                call fill(seed, c)
                scale = spread(1.0_wp, 1, n)
                call elimination%allocate(m, n)
                do pass = 1, 2
                    do k = 1, 3
                        do j = 1, n
                            do i = 1, m
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
                call check_below(error, defect, 1.0e-14_wp, '|C R - I|, |C D| afterwards')
                if (allocated(error)) return
                deallocate (c)
            end do
        end do
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
        type(elimination_type) :: elimination, fresh
        real(wp) :: c(4, 7), change(4, 7), d(7, 3), d_fresh(7, 3), defect, size_
        integer :: seed, stat, i

        seed = 9
        call fill(seed, c)
        call fill(seed, change)
        call elimination%allocate(4, 7)
        do i = 0, 10
            call elimination%eliminate(c + 0.001_wp*i*change, spread(1.0_wp, 1, 7), stat)
            call check_count(error, stat, 0, 'stat')
            call measure(c + 0.001_wp*i*change, elimination, defect, size_)
            call check_below(error, defect, 1.0e-14_wp, '|C R - I|, |C D|')
            if (allocated(error)) return
        end do
        call fresh%allocate(4, 7)
        call fresh%eliminate(c + 0.010_wp*change, spread(1.0_wp, 1, 7), stat)
        call elimination%get_null_space(d)
        call fresh%get_null_space(d_fresh)
        call check_below(error, maxval(abs(d - d_fresh)), 1.0e-13_wp, 'D with remembered pivots against a new search')
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
end module test_linalg_elimination
