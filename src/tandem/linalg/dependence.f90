! SPDX-License-Identifier: MIT
!> Dependent rows: choice of the rows to keep, representation of the others by these, and the solution of least norm of a
!> rank-deficient system. For starts and after failures, not for steps: these procedures allocate.
module tandem_linalg_dependence
    use tandem_kinds, only: wp
    use tandem_linalg_lapack, only: dgelsy, dpotrf, dpotri, dsyrk
    use tandem_linalg_row_space, only: row_space_type
    implicit none (type, external)
    private

    public :: split_rows, solve_least_norm

contains

    !> Drop rows until the others are independent: each time the one with the largest coefficient in the vanishing combination, of
    !> equal ones the last, so that a copy is dropped and not its original. Rows after `n_first` are dropped first.
    subroutine split_rows(matrix, scale, n_first, tolerance, kept, dropped, combination)
        !> Rows (m, n) and scales of their unknowns (n).
        real(wp), intent(in) :: matrix(:, :), scale(:)
        !> Number of first rows to be kept if others can be dropped.
        integer, intent(in) :: n_first
        !> Rows of unit length are dependent if their smallest singular value is at most this.
        real(wp), intent(in) :: tolerance
        !> Numbers of the independent rows and of the others, ascending.
        integer, allocatable, intent(out) :: kept(:), dropped(:)
        !> matrix(dropped, :) = combination matrix(kept, :).
        real(wp), allocatable, intent(out) :: combination(:, :)
        !> Smaller coefficients of the combination are ignored; coefficients that differ by less are equal.
        real(wp), parameter :: counts = 1.0e-2_wp, equal = 1.0e-6_wp
        real(wp), allocatable :: rows(:, :), share(:)
        type(row_space_type) :: space
        real(wp) :: smallest
        integer :: i, k
        logical :: is_kept(size(matrix, 1))

        is_kept = .true.
        do k = 1, size(matrix, 1)
            kept = pack([(i, i=1, size(is_kept))], is_kept)
            rows = matrix(kept, :)
            ! Singular vectors cost many times more than this test, and callers expect dependent rows at first.
            if (k > 1) then
                if (are_clearly_independent(rows, scale, tolerance)) exit
            end if
            allocate (share(size(kept)))
            call space%forget()
            call space%find_weakest(size(rows, 1), size(rows, 2), rows, scale, share, smallest)
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

    !> True if rows of unit length are so independent that no further test is needed: for their Gram matrix G the smallest
    !> eigenvalue, the square of the smallest singular value, is at least 1/trace(G^-1), which rounding changes by 1e-14.
    logical function are_clearly_independent(matrix, scale, tolerance) result(are)
        !> Rows (m, n) and scales of their unknowns (n).
        real(wp), intent(in) :: matrix(:, :), scale(:)
        !> The smallest singular value must clearly exceed this.
        real(wp), intent(in) :: tolerance
        real(wp), parameter :: clearly = 1.0e-4_wp
        real(wp), allocatable :: rows(:, :), gram(:, :)
        real(wp) :: length, trace
        integer :: i, info, m, n

        m = size(matrix, 1)
        n = size(matrix, 2)
        are = .false.
        if (m == 0 .or. m > n) return
        allocate (rows(n, m), gram(m, m))
        do i = 1, m
            rows(:, i) = matrix(i, :)*scale
            length = norm2(rows(:, i))
            if (.not. (length > 0.0_wp .and. length <= huge(1.0_wp))) return
            rows(:, i) = rows(:, i)/length
        end do
        call dsyrk('L', 'T', m, n, 1.0_wp, rows, n, 0.0_wp, gram, m)
        call dpotrf('L', m, gram, m, info)
        if (info == 0) call dpotri('L', m, gram, m, info)
        if (info /= 0) return
        trace = 0.0_wp
        do i = 1, m
            trace = trace + gram(i, i)
        end do
        are = 1.0_wp > trace*max(clearly, 10*tolerance)**2
    end function are_clearly_independent

    !> Solution of least length of the least-squares problem A x = b; A may have any rank.
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
end module tandem_linalg_dependence
