! SPDX-License-Identifier: MIT
!> Dependent rows: choice of the rows to keep, and representation of the others by these. For starts and after failures, not for
!> steps: these procedures allocate.
module tandem_linalg_dependence
    use tandem_kinds, only: wp
    use tandem_linalg_lapack, only: dgeqp3, dpotrf, dpotri, dsyrk
    use tandem_linalg_orthogonal, only: orthogonal_type
    use tandem_linalg_row_space, only: row_space_type
    use tandem_linalg_singular, only: orthonormalise
    implicit none (type, external)
    private

    public :: count_independent, split_rows

    !> Smaller coefficients of a vanishing combination are ignored; coefficients that differ by less are equal.
    real(wp), parameter :: counts = 1.0e-2_wp, equal = 1.0e-6_wp

contains

    !> Drop rows until the others are independent: each time the one with the largest coefficient in the vanishing combinations, of
    !> equal ones the last, so that a copy is dropped and not its original. Rows after `n_first` are dropped first.
    !>
    !> One pivoted QR finds all vanishing combinations if the rank is clear, which it is for redundant rows; else singular values
    !> decide, with one decomposition for each dropped row.
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
        real(wp), allocatable :: vanishing(:, :), rows(:, :), length(:), parts(:)
        type(orthogonal_type) :: of_kept
        integer :: i, rank
        logical :: is_kept(size(matrix, 1)), is_clear

        is_kept = .true.
        call set_unit_rows(matrix, scale, rows, length)
        call find_vanishing(rows, tolerance, rank, is_clear, vanishing)
        if (is_clear) then
            call choose_rows(vanishing, n_first, is_kept)
            is_clear = are_clearly_independent(rows(:, pack([(i, i=1, size(is_kept))], is_kept)), tolerance)
        end if
        if (.not. is_clear) call drop_in_turn(matrix, scale, n_first, tolerance, is_kept)
        kept = pack([(i, i=1, size(is_kept))], is_kept)
        dropped = pack([(i, i=1, size(is_kept))], .not. is_kept)
        allocate (combination(size(dropped), size(kept)), source=0.0_wp)
        if (size(dropped) == 0) return
        call of_kept%factor(transpose(rows(:, kept)))
        allocate (parts(size(kept)))
        do i = 1, size(dropped)
            call of_kept%solve_transposed(rows(:, dropped(i)), parts)
            where (length(kept) > 0.0_wp) combination(i, :) = parts*length(dropped(i))/length(kept)
        end do
    end subroutine split_rows

    !> Number of independent rows, as `split_rows` keeps.
    integer function count_independent(matrix, scale, n_first, tolerance) result(rank)
        !> As of `split_rows`.
        real(wp), intent(in) :: matrix(:, :), scale(:)
        integer, intent(in) :: n_first
        real(wp), intent(in) :: tolerance
        real(wp), allocatable :: rows(:, :), length(:)
        logical :: is_clear, is_kept(size(matrix, 1))

        call set_unit_rows(matrix, scale, rows, length)
        call find_vanishing(rows, tolerance, rank, is_clear)
        if (is_clear) return
        is_kept = .true.
        call drop_in_turn(matrix, scale, n_first, tolerance, is_kept)
        rank = count(is_kept)
    end function count_independent

    !> Rows as columns of unit length (n, m), and their lengths (m); a row without entries, or with infinite ones, is zero.
    pure subroutine set_unit_rows(matrix, scale, rows, length)
        real(wp), intent(in) :: matrix(:, :), scale(:)
        real(wp), allocatable, intent(out) :: rows(:, :), length(:)
        integer :: i

        allocate (rows(size(matrix, 2), size(matrix, 1)), length(size(matrix, 1)))
        do i = 1, size(matrix, 1)
            rows(:, i) = matrix(i, :)*scale
            length(i) = norm2(rows(:, i))
            if (.not. (length(i) > 0.0_wp .and. length(i) <= huge(1.0_wp))) length(i) = 0.0_wp
            if (length(i) > 0.0_wp) then
                rows(:, i) = rows(:, i)/length(i)
            else
                rows(:, i) = 0.0_wp
            end if
        end do
    end subroutine set_unit_rows

    !> Rank of rows of unit length by pivoted QR, and an orthonormal basis of the combinations that vanish.
    subroutine find_vanishing(rows, tolerance, rank, is_clear, vanishing)
        !> (n, m)
        real(wp), intent(in) :: rows(:, :)
        real(wp), intent(in) :: tolerance
        integer, intent(out) :: rank
        !> True if as many singular values as this exceed the tolerance by far, and all others are below it.
        logical, intent(out) :: is_clear
        !> (m, m - rank)
        real(wp), allocatable, intent(out), optional :: vanishing(:, :)
        !> Independent rows have larger diagonal entries of R.
        real(wp), parameter :: clearly = 1.0e-4_wp
        real(wp) :: r(size(rows, 1), size(rows, 2)), tau(size(rows, 2)), work(32*(size(rows, 2) + 1))
        real(wp), allocatable :: basis(:, :)
        integer :: order(size(rows, 2)), i, info, j, m, n

        n = size(rows, 1)
        m = size(rows, 2)
        rank = 0
        is_clear = .false.
        if (min(n, m) == 0) return
        r = rows
        order = 0
        call dgeqp3(n, m, r, n, order, tau, work, size(work), info)
        do while (rank < min(n, m))
            if (.not. abs(r(rank + 1, rank + 1)) > max(clearly, 1.0e2_wp*tolerance)) exit
            rank = rank + 1
        end do
        ! Columns below the diagonal are at most as long as its next entry, which bounds the remaining singular values.
        is_clear = rank == min(n, m)
        if (.not. is_clear) is_clear = abs(r(rank + 1, rank + 1))*sqrt(real(m - rank, wp)) <= 0.1_wp*tolerance
        if (.not. (present(vanishing) .and. is_clear)) return
        ! R11 X + R12 = 0.
        allocate (basis(m, m - rank), vanishing(m, m - rank), source=0.0_wp)
        do j = 1, m - rank
            basis(rank + j, j) = 1.0_wp
            basis(:rank, j) = -r(:rank, rank + j)
            do i = rank, 1, -1
                basis(i, j) = basis(i, j)/r(i, i)
                basis(:i - 1, j) = basis(:i - 1, j) - basis(i, j)*r(:i - 1, i)
            end do
        end do
        call orthonormalise(basis)
        vanishing(order, :) = basis
    end subroutine find_vanishing

    !> Choose a row for each of the vanishing combinations. Only combinations without dropped rows are left.
    pure subroutine choose_rows(vanishing, n_first, is_kept)
        !> An orthonormal basis (m, any); changed.
        real(wp), intent(inout) :: vanishing(:, :)
        integer, intent(in) :: n_first
        !> (m)
        logical, intent(inout) :: is_kept(:)
        real(wp) :: share(size(is_kept)), part(size(is_kept)), normal(size(vanishing, 2)), length
        integer :: i, j, k, row

        do k = size(vanishing, 2), 1, -1
            do i = 1, size(share)
                share(i) = merge(norm2(vanishing(i, :k)), 0.0_wp, is_kept(i))
            end do
            share = share/maxval(share)
            if (any(share(n_first + 1:) > counts)) share(:n_first) = 0.0_wp
            row = findloc(share >= (1.0_wp - equal)*maxval(share), .true., dim=1, back=.true.)
            is_kept(row) = .false.
            ! A reflection of the basis after which only its last vector contains the row.
            length = norm2(vanishing(row, :k))
            normal(:k) = vanishing(row, :k)
            normal(k) = normal(k) + sign(length, normal(k))
            part = 2*matmul(vanishing(:, :k), normal(:k))/sum(normal(:k)**2)
            do j = 1, k
                vanishing(:, j) = vanishing(:, j) - normal(j)*part
            end do
        end do
    end subroutine choose_rows

    !> The choice by singular values, one row at a time.
    subroutine drop_in_turn(matrix, scale, n_first, tolerance, is_kept)
        real(wp), intent(in) :: matrix(:, :), scale(:)
        integer, intent(in) :: n_first
        real(wp), intent(in) :: tolerance
        !> (m)
        logical, intent(out) :: is_kept(:)
        integer, allocatable :: kept(:)
        real(wp), allocatable :: rows(:, :), share(:)
        type(row_space_type) :: space
        real(wp) :: smallest
        integer :: i, k

        is_kept = .true.
        do k = 1, size(matrix, 1)
            kept = pack([(i, i=1, size(is_kept))], is_kept)
            rows = matrix(kept, :)
            allocate (share(size(kept)))
            call space%forget()
            call space%find_weakest(size(rows, 1), size(rows, 2), rows, scale, share, smallest)
            if (smallest > tolerance) exit
            share = abs(share)
            if (any(share > counts .and. kept > n_first)) where (kept <= n_first) share = 0.0_wp
            is_kept(kept(findloc(share >= (1.0_wp - equal)*maxval(share), .true., dim=1, back=.true.))) = .false.
            deallocate (share)
        end do
    end subroutine drop_in_turn

    !> True if rows of unit length are so independent that no further test is needed: for their Gram matrix G the smallest
    !> eigenvalue, the square of the smallest singular value, is at least 1/trace(G^-1), which rounding changes by 1e-14.
    logical function are_clearly_independent(rows, tolerance) result(are)
        !> (n, m)
        real(wp), intent(in) :: rows(:, :)
        !> The smallest singular value must clearly exceed this.
        real(wp), intent(in) :: tolerance
        real(wp), parameter :: clearly = 1.0e-4_wp
        real(wp), allocatable :: gram(:, :)
        real(wp) :: trace
        integer :: i, info, m, n

        n = size(rows, 1)
        m = size(rows, 2)
        are = m == 0
        if (m == 0 .or. m > n) return
        allocate (gram(m, m))
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
end module tandem_linalg_dependence
