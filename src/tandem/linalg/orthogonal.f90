! SPDX-License-Identifier: MIT
!> Complete orthogonal decomposition by pivoted QR: rank, least-squares solutions of smallest norm, and the null space of a matrix
!> whose rows may depend on each other. It costs a fraction of the singular values, which decide only where the rank is not clear.
!> For set-up: the procedures allocate.
!>
!> Source: G. H. Golub, C. F. Van Loan, Matrix Computations, 4th ed., section 5.4.7.
module tandem_linalg_orthogonal
    use tandem_kinds, only: wp
    use tandem_linalg_basis, only: rank_tolerance
    use tandem_linalg_lapack, only: dgeqp3, dgesvd, dorgqr
    implicit none (type, external)
    private

    public :: orthogonal_type

    !> Diagonal entries of R between these parts of the first one require the singular values.
    real(wp), parameter :: clearly_zero = 1.0e-13_wp, clearly_nonzero = 1.0e-7_wp

    type :: orthogonal_type
        !> Number of independent rows of the last matrix, and the last diagonal entry of R over the first one.
        integer :: rank = 0
        real(wp) :: least = 1.0_wp
        integer, private :: m = 0, n = 0
        !> A' P = Q [S; 0] with Q (n, n), and S' = Q2 R2 (m, rank), (rank, rank) if the rows are dependent; else S is triangular.
        real(wp), allocatable, private :: q(:, :), s(:, :), q2(:, :), r2(:, :)
        !> Rows in the order of P (m).
        integer, allocatable, private :: order(:)
    contains
        procedure :: factor, solve, solve_transposed, project, get_null_basis
    end type orthogonal_type

contains

    !> Factor a matrix of finite numbers (m, n), whose rows should be of about the same length.
    subroutine factor(self, a, size_of_a)
        class(orthogonal_type), intent(inout) :: self
        real(wp), intent(in) :: a(:, :)
        !> Size that rounding errors of A are relative to, if it may be larger than that of A.
        real(wp), intent(in), optional :: size_of_a
        real(wp) :: tau(min(size(a, 1), size(a, 2))), work(32*(size(a, 1) + size(a, 2) + 1)), copy(size(a, 2), size(a, 1))
        real(wp) :: largest
        integer :: info, i, k, m, n

        m = size(a, 1)
        n = size(a, 2)
        self%m = m
        self%n = n
        self%rank = 0
        self%least = 1.0_wp
        self%order = [(0, i=1, m)]
        if (allocated(self%q)) deallocate (self%q)
        if (allocated(self%s)) deallocate (self%s)
        allocate (self%q(n, n), source=0.0_wp)
        k = min(m, n)
        if (k == 0) then
            do i = 1, n
                self%q(i, i) = 1.0_wp
            end do
            return
        end if
        copy = transpose(a)
        call dgeqp3(n, m, copy, n, self%order, tau, work, size(work), info)
        largest = abs(copy(1, 1))
        if (present(size_of_a)) largest = max(largest, size_of_a)
        self%rank = find_rank(a, [(abs(copy(i, i)), i=1, k)], largest)
        if (self%rank > 0) self%least = abs(copy(self%rank, self%rank)/copy(1, 1))
        allocate (self%s(self%rank, m), source=0.0_wp)
        do i = 1, m
            self%s(:min(i, self%rank), i) = copy(:min(i, self%rank), i)
        end do
        self%q(:, :k) = copy(:, :k)
        call dorgqr(n, n, k, self%q, n, tau, work, size(work), info)
        if (self%rank < m) call triangularise(transpose(self%s), self%q2, self%r2)
    end subroutine factor

    !> The rank by the diagonal of R (min(m, n)), or by singular values if it is not clear.
    integer function find_rank(a, diagonal, largest) result(rank)
        real(wp), intent(in) :: a(:, :), diagonal(:), largest
        real(wp), allocatable :: copy(:, :)
        real(wp) :: no_left(1, 1), no_right(1, 1), values(size(diagonal)), work(8*(size(a, 1) + size(a, 2)))
        integer :: info

        rank = count(diagonal > clearly_nonzero*largest)
        if (rank == size(diagonal)) return
        if (diagonal(rank + 1) <= clearly_zero*largest) return
        allocate (copy, source=a)
        call dgesvd('N', 'N', size(a, 1), size(a, 2), copy, size(a, 1), values, no_left, 1, no_right, 1, work, size(work), info)
        rank = 0
        if (info == 0) rank = count(values > rank_tolerance*max(values(1), largest))
    end function find_rank

    !> Q2 and R2 of independent columns (m, k), m >= k.
    subroutine triangularise(a, q, r)
        real(wp), intent(in) :: a(:, :)
        real(wp), allocatable, intent(inout) :: q(:, :), r(:, :)
        real(wp) :: tau(size(a, 2)), work(32*(size(a, 1) + size(a, 2) + 1))
        integer :: order(size(a, 2)), info, j, k

        k = size(a, 2)
        q = a
        if (allocated(r)) deallocate (r)
        allocate (r(k, k), source=0.0_wp)
        if (k == 0) return
        ! Without exchanges of columns.
        order = 1
        call dgeqp3(size(a, 1), k, q, size(a, 1), order, tau, work, size(work), info)
        do j = 1, k
            r(:j, j) = q(:j, j)
        end do
        call dorgqr(size(a, 1), k, k, q, size(a, 1), tau, work, size(work), info)
    end subroutine triangularise

    !> The x (n) of smallest norm that minimises |A x - b|.
    pure subroutine solve(self, b, x)
        class(orthogonal_type), intent(in) :: self
        real(wp), intent(in) :: b(:)
        real(wp), intent(out) :: x(:)
        real(wp) :: z(self%rank)
        integer :: i

        x = 0.0_wp
        if (self%rank == 0) return
        if (self%rank == self%m) then
            do i = 1, self%rank
                z(i) = (b(self%order(i)) - dot_product(self%s(:i - 1, i), z(:i - 1)))/self%s(i, i)
            end do
        else
            z = matmul(b(self%order), self%q2)
            call solve_upper(self%r2, z)
        end if
        x = matmul(self%q(:, :self%rank), z)
    end subroutine solve

    !> The y (m) of smallest norm that minimises |A'y - g|.
    pure subroutine solve_transposed(self, g, y)
        class(orthogonal_type), intent(in) :: self
        real(wp), intent(in) :: g(:)
        real(wp), intent(out) :: y(:)
        real(wp) :: z(self%rank)
        integer :: i

        y = 0.0_wp
        if (self%rank == 0) return
        z = matmul(g, self%q(:, :self%rank))
        if (self%rank == self%m) then
            call solve_upper(self%s, z)
            y(self%order) = z
        else
            do i = 1, self%rank
                z(i) = (z(i) - dot_product(self%r2(:i - 1, i), z(:i - 1)))/self%r2(i, i)
            end do
            y(self%order) = matmul(self%q2, z)
        end if
    end subroutine solve_transposed

    !> Subtract from x (n) its part in the row space.
    pure subroutine project(self, x)
        class(orthogonal_type), intent(in) :: self
        real(wp), intent(inout) :: x(:)

        associate (kernel => self%q(:, self%rank + 1:))
            x = matmul(kernel, matmul(x, kernel))
        end associate
    end subroutine project

    !> z := R^-1 z, R upper triangular.
    pure subroutine solve_upper(r, z)
        real(wp), intent(in) :: r(:, :)
        real(wp), intent(inout) :: z(:)
        integer :: i

        do i = size(z), 1, -1
            z(i) = z(i)/r(i, i)
            z(:i - 1) = z(:i - 1) - z(i)*r(:i - 1, i)
        end do
    end subroutine solve_upper

    !> An orthonormal basis (n, n - rank) of the null space.
    pure subroutine get_null_basis(self, z)
        class(orthogonal_type), intent(in) :: self
        real(wp), allocatable, intent(out) :: z(:, :)

        z = self%q(:, self%rank + 1:)
    end subroutine get_null_basis
end module tandem_linalg_orthogonal
