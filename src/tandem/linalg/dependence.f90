! SPDX-License-Identifier: MIT
!> Rows that depend on each other: which to keep, what the others are made of, and the solution of least norm where a matrix has
!> not full rank. For starts and for failures, not for steps: these procedures allocate.
module tandem_linalg_dependence
    use tandem_kinds, only: wp
    use tandem_linalg_lapack, only: dgelsy, dgesvd
    use tandem_linalg_lu, only: lu_type
    implicit none (type, external)
    private

    public :: split_rows, weakest_combination, solve_least_norm, keeps_orientation

contains

    !> Leave out rows until the others are independent: always the one with the largest part in the combination that vanishes, of
    !> equal ones the last, so that a copy goes and not its original. Rows behind `n_first` go before those up to it.
    subroutine split_rows(matrix, scale, n_first, tolerance, kept, dropped, combination)
        !> Rows (m, n) and the scales of their unknowns (n).
        real(wp), intent(in) :: matrix(:, :), scale(:)
        !> How many rows to spare where others can go.
        integer, intent(in) :: n_first
        !> Rows of unit length depend on each other where their smallest singular value is at most this.
        real(wp), intent(in) :: tolerance
        !> Numbers of the independent rows and of the others, ascending.
        integer, allocatable, intent(out) :: kept(:), dropped(:)
        !> matrix(dropped, :) = combination matrix(kept, :).
        real(wp), allocatable, intent(out) :: combination(:, :)
        !> Smaller parts in the combination do not count, and parts that differ by less are equal.
        real(wp), parameter :: counts = 1.0e-2_wp, equal = 1.0e-6_wp
        real(wp), allocatable :: rows(:, :), share(:)
        real(wp) :: smallest
        integer :: i, k
        logical :: is_kept(size(matrix, 1))

        is_kept = .true.
        do k = 1, size(matrix, 1)
            kept = pack([(i, i=1, size(is_kept))], is_kept)
            rows = matrix(kept, :)
            allocate (share(size(kept)))
            call weakest_combination(rows, scale, share, smallest)
            if (smallest > tolerance) exit
            share = abs(share)
            if (any(share > counts .and. kept > n_first)) where (kept <= n_first) share = 0.0_wp
            is_kept(kept(findloc(share >= (1.0_wp - equal)*maxval(share), .true., dim=1, back=.true.))) = .false.
            deallocate (share)
        end do
        kept = pack([(i, i=1, size(is_kept))], is_kept)
        dropped = pack([(i, i=1, size(is_kept))], .not. is_kept)
        allocate (combination(size(dropped), size(kept)), source=0.0_wp)
        rows = transpose(matrix(kept, :)*spread(scale, 1, size(kept)))
        do i = 1, size(dropped)
            share = matrix(dropped(i), :)*scale
            call solve_least_norm(rows, share, combination(i, :))
        end do
    end subroutine split_rows

    !> The combination of unit rows that is nearest to zero: what each row takes part in it, its largest entry 1 in modulus.
    subroutine weakest_combination(matrix, scale, share, smallest)
        !> Rows (m, n) and the scales of their unknowns (n).
        real(wp), intent(in) :: matrix(:, :), scale(:)
        !> Each row's part (m).
        real(wp), intent(out) :: share(:)
        !> The smallest singular value of the unit rows.
        real(wp), intent(out) :: smallest
        real(wp) :: rows(size(matrix, 2), size(matrix, 1)), singular(size(matrix, 1)), length
        real(wp) :: right(size(matrix, 1), size(matrix, 1)), work(8*(size(matrix, 1) + size(matrix, 2))), no_left(1, 1)
        integer :: i, info, m, n

        m = size(matrix, 1)
        n = size(matrix, 2)
        share = 0.0_wp
        smallest = 0.0_wp
        do i = 1, m
            length = norm2(matrix(i, :)*scale)
            if (.not. (length > 0.0_wp .and. length <= huge(1.0_wp))) then
                share(i) = 1.0_wp
                return
            end if
            rows(:, i) = matrix(i, :)*scale/length
        end do
        call dgesvd('N', 'A', n, m, rows, n, singular, no_left, 1, right, m, work, size(work), info)
        if (info /= 0) return
        smallest = singular(m)
        share = right(m, :)/maxval(abs(right(m, :)))
    end subroutine weakest_combination

    !> The solution of least length of the least-squares problem A x = b; A may have any rank.
    subroutine solve_least_norm(a, b, x)
        !> A (m, n), b (m).
        real(wp), intent(in) :: a(:, :), b(:)
        !> x (n).
        real(wp), intent(out) :: x(:)
        !> Smaller pivots count as zero; see `rank_tolerance` in `tandem_linalg_basis`.
        real(wp), parameter :: smallest_pivot = 1.0e-10_wp
        real(wp) :: matrix(size(a, 1), size(a, 2)), rhs(max(size(a, 1), size(a, 2)), 1)
        real(wp) :: work(40*(size(a, 1) + size(a, 2)) + 40)
        integer :: order(size(a, 2)), rank, info, m, n

        m = size(a, 1)
        n = size(a, 2)
        x = 0.0_wp
        if (m == 0 .or. n == 0) return
        matrix = a
        rhs = 0.0_wp
        rhs(:m, 1) = b
        order = 0
        call dgelsy(m, n, 1, matrix, m, rhs, size(rhs, 1), order, smallest_pivot, rank, work, size(work), info)
        if (info == 0) x = rhs(:n, 1)
    end subroutine solve_least_norm

    !> Whether a row space keeps its orientation from one matrix to a neighbouring one. Where a singular value has passed through
    !> zero in between, the determinant of the second in a basis of the first has changed its sign.
    logical function keeps_orientation(from, to, scale)
        !> Rows (m, n) and the scales of their unknowns (n).
        real(wp), intent(in) :: from(:, :), to(:, :), scale(:)
        real(wp) :: basis(size(from, 2), size(from, 1)), part
        type(lu_type) :: lu
        integer :: i, j, pass, m, stat

        m = size(from, 1)
        ! The rows of `from` have a positive determinant in the basis that Gram-Schmidt makes of them.
        do i = 1, m
            basis(:, i) = from(i, :)*scale
            do pass = 1, 2
                do j = 1, i - 1
                    part = dot_product(basis(:, j), basis(:, i))
                    basis(:, i) = basis(:, i) - part*basis(:, j)
                end do
            end do
            basis(:, i) = basis(:, i)/max(norm2(basis(:, i)), tiny(1.0_wp))
        end do
        call lu%allocate(m)
        call lu%factor(matmul(to*spread(scale, 1, m), basis), stat)
        keeps_orientation = stat == 0 .and. lu%determinant_sign() > 0
    end function keeps_orientation
end module tandem_linalg_dependence
