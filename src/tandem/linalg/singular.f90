! SPDX-License-Identifier: MIT
!> Least-squares solutions of smallest norm by singular values, for possibly dependent rows; eigenvalues of a symmetric matrix. For
!> set-up: the procedures may allocate.
!>
!> Source: G. H. Golub, C. F. Van Loan, Matrix Computations; the bounded step: J. J. Moré, The Levenberg-Marquardt algorithm, 1978.
module tandem_linalg_singular
    use tandem_kinds, only: wp
    use tandem_linalg_basis, only: rank_tolerance
    use tandem_linalg_lapack, only: dgeqp3, dgesdd, dgesvd, dorgqr, dsyev
    implicit none (type, external)
    private

    public :: singular_type, decompose_in, decompose_symmetric, orthonormalise, triangularise

    !> Size from which divide and conquer is faster (2 to 3 times at 160 to 370).
    integer, parameter :: large = 64

    type :: singular_type
        !> Number of nonzero singular values of the last matrix, and all values, descending.
        integer :: rank = 0
        real(wp), allocatable :: values(:)
        integer, private :: m = 0, n = 0
        !> A = U diag(values) V'; U (m, min(m, n)), of more columns than rows (m, m), V' (n, n), a copy of A.
        real(wp), allocatable, private :: u(:, :), vt(:, :), matrix(:, :), work(:)
        integer, allocatable, private :: integers(:)
    contains
        procedure :: allocate => allocate_singular, factor, solve, solve_within
        procedure :: solve_transposed, get_null_basis, get_row_basis
        procedure, private :: components
    end type singular_type

contains

    !> Allocate for matrices (m, n), either of which may be 0.
    subroutine allocate_singular(self, m, n)
        class(singular_type), intent(inout) :: self
        integer, intent(in) :: m, n

        self%m = m
        self%n = n
        if (allocated(self%u)) deallocate (self%u, self%vt, self%matrix, self%work, self%values, self%integers)
        allocate (self%u(m, min(m, n)), self%vt(n, n), self%matrix(m, n), self%values(min(m, n)), source=0.0_wp)
        ! Enough for the blocked forms.
        allocate (self%work(64*(m + n + 1) + merge(4*min(m, n)**2, 0, min(m, n) >= large)), source=0.0_wp)
        allocate (self%integers(merge(8*min(m, n), 0, min(m, n) >= large)), source=0)
    end subroutine allocate_singular

    !> Factor a matrix of finite numbers (m, n), whose rows should be of about the same length.
    subroutine factor(self, a)
        class(singular_type), intent(inout) :: self
        real(wp), intent(in) :: a(:, :)
        integer :: info, i

        self%rank = 0
        self%matrix = a
        self%values = 0.0_wp
        if (min(self%m, self%n) == 0) then
            self%vt = 0.0_wp
            do i = 1, self%n
                self%vt(i, i) = 1.0_wp
            end do
            return
        end if
        if (min(self%m, self%n) < large) then
            call dgesvd('S', 'A', self%m, self%n, self%matrix, self%m, self%values, self%u, self%m, self%vt, self%n, &
                self%work, size(self%work), info)
        else
            call dgesdd(merge('S', 'A', self%m >= self%n), self%m, self%n, self%matrix, self%m, self%values, self%u, self%m, &
                self%vt, self%n, self%work, size(self%work), self%integers, info)
        end if
        ! Without convergence, which finite numbers do not cause, the rank is 0.
        if (info == 0) self%rank = count(self%values > rank_tolerance*self%values(1))
    end subroutine factor

    !> The x (n) of smallest norm that minimises |A x - b|.
    subroutine solve(self, b, x)
        class(singular_type), intent(in) :: self
        real(wp), intent(in) :: b(:)
        real(wp), intent(out) :: x(:)

        call self%solve_within(b, huge(1.0_wp), 0.0_wp, x)
    end subroutine solve

    !> x (n) that minimises |A x - b| within |x| <= radius up to a tenth: (A'A + mu I) x = A'b.
    subroutine solve_within(self, b, radius, noise, x)
        class(singular_type), intent(in) :: self
        real(wp), intent(in) :: b(:), radius
        !> Components of b along a singular vector of at most this size are rounding and are ignored.
        real(wp), intent(in) :: noise
        real(wp), intent(out) :: x(:)
        integer, parameter :: limit = 60
        real(wp) :: c(self%rank), y(self%rank), mu, length
        integer :: i

        associate (s => self%values, r => self%rank)
            c = self%components(b)
            where (abs(c) <= noise) c = 0.0_wp
            mu = 0.0_wp
            do i = 1, limit
                y = s(:r)*c/(s(:r)**2 + mu)
                length = norm2(y)
                if (length <= 1.1_wp*radius) exit
                ! Newton's iteration for 1/|x(mu)| = 1/radius, which is nearly linear in mu; converges from below.
                mu = mu + (length/radius - 1.0_wp)/sum((y/length)**2/(s(:r)**2 + mu))
            end do
            x = matmul(y, self%vt(:r, :))
        end associate
    end subroutine solve_within

    !> The y (m) of smallest norm that minimises |A'y - g|.
    subroutine solve_transposed(self, g, y)
        class(singular_type), intent(in) :: self
        real(wp), intent(in) :: g(:)
        real(wp), intent(out) :: y(:)
        real(wp) :: c(self%rank)

        associate (r => self%rank)
            c = matmul(self%vt(:r, :), g)/self%values(:r)
            y = matmul(self%u(:, :r), c)
        end associate
    end subroutine solve_transposed

    !> An orthonormal basis (n, n - rank) of the null space.
    subroutine get_null_basis(self, z)
        class(singular_type), intent(in) :: self
        real(wp), allocatable, intent(out) :: z(:, :)

        z = transpose(self%vt(self%rank + 1:, :))
    end subroutine get_null_basis

    !> An orthonormal basis (n, rank) of the row space.
    subroutine get_row_basis(self, x)
        class(singular_type), intent(in) :: self
        real(wp), allocatable, intent(out) :: x(:, :)

        x = transpose(self%vt(:self%rank, :))
    end subroutine get_row_basis

    !> U'b along the singular vectors of nonzero values.
    pure function components(self, b) result(c)
        class(singular_type), intent(in) :: self
        real(wp), intent(in) :: b(:)
        real(wp) :: c(self%rank)

        c = matmul(b, self%u(:, :self%rank))
    end function components

    !> Replace a matrix (m, n), m >= n, by the R of its factors Q R in the first n rows: singular values and right vectors stay.
    subroutine triangularise(x)
        real(wp), intent(inout), contiguous :: x(:, :)
        real(wp) :: tau(size(x, 2)), work(32*(size(x, 2) + 1))
        integer :: order(size(x, 2)), info, j

        if (size(x) == 0) return
        ! Without exchanges of columns.
        order = 1
        call dgeqp3(size(x, 1), size(x, 2), x, size(x, 1), order, tau, work, size(work), info)
        do j = 1, size(x, 2)
            x(j + 1:, j) = 0.0_wp
        end do
    end subroutine triangularise

    !> Replace linearly independent columns (n, k), k <= n, by an orthonormal basis of what they span.
    subroutine orthonormalise(x)
        real(wp), intent(inout), contiguous :: x(:, :)
        real(wp) :: tau(size(x, 2)), work(32*(size(x, 1) + size(x, 2) + 1))
        integer :: order(size(x, 2)), info

        if (size(x) == 0) return
        order = 0
        call dgeqp3(size(x, 1), size(x, 2), x, size(x, 1), order, tau, work, size(work), info)
        call dorgqr(size(x, 1), size(x, 2), size(x, 2), x, size(x, 1), tau, work, size(work), info)
    end subroutine orthonormalise

    !> Eigenvalues, ascending, of a symmetric matrix (n, n) of finite numbers, and its orthonormal eigenvectors in its place.
    subroutine decompose_symmetric(a, values)
        real(wp), intent(inout), contiguous :: a(:, :)
        real(wp), intent(out), contiguous :: values(:)
        real(wp) :: work(64*(size(values) + 1))

        call decompose_in(work, a, values)
    end subroutine decompose_symmetric

    !> The same with given work space: at least 3 n, 34 n for the blocked form. Allocates nothing.
    subroutine decompose_in(work, a, values)
        real(wp), intent(inout), contiguous :: work(:), a(:, :)
        real(wp), intent(out), contiguous :: values(:)
        integer :: info

        if (size(values) == 0) return
        call dsyev('V', 'L', size(values), a, size(values), values, work, size(work), info)
    end subroutine decompose_in
end module tandem_linalg_singular
