! SPDX-License-Identifier: MIT
!> Orthonormal bases of the ranges and null spaces of Phi_q and of C = [Phi_q; E], and the one rank decision.
!>
!> The result is one orthogonal matrix Q = [U, Xe, W]: its first nh columns U span range(Phi_q'), the first m = nh + nd columns X
!> span range(C'), the last n - nh columns V span null(Phi_q), and the last n - m columns W span null(C). So V contains W, and the
!> leading block of C X is Phi_q U.
!>
!> Pivoted QR (the default) takes its pivots first within the rows of Phi, then within those of E; the SVD is the paper's, W = V Z
!> with Z from E V. Rows are scaled to unit length first, so that the rank does not depend on their units.
module tandem_linalg_basis
    use tandem_kinds, only: wp
    use tandem_linalg_householder, only: factor_pivoted, form_columns
    use tandem_linalg_lapack, only: dgeqp3, dgesvd, dorgqr, dormqr
    implicit none (type, external)
    private

    public :: basis_type, rank_tolerance

    !> Rows of unit length are dependent if their smallest singular value is at most this. Constraints are usable up to a condition
    !> number of about 5e8; beyond 1e10 multipliers and velocities have no correct digits.
    real(wp), parameter :: rank_tolerance = 1.0e-10_wp
    !> A diagonal entry of R below this requires the singular values.
    real(wp), parameter :: suspicion = 1.0e-7_wp
    !> One below this is rounding: the rows are dependent.
    real(wp), parameter :: rounding = 1.0e-13_wp
    !> Largest number of coordinates for QR in loops.
    integer, parameter :: few = 32

    type :: basis_type
        !> [U, Xe, W] (n, n); only the requested columns are computed.
        real(wp), allocatable :: q(:, :)
        !> True if the rows are dependent; a dependent row.
        logical :: deficient = .false.
        integer :: dependent_row = 0
        !> The smallest singular value of the rows of unit length, or its estimate from R.
        real(wp) :: smallest = 1.0_wp
        integer, private :: n = 0, nh = 0, m = 0
        real(wp), allocatable, private :: rows(:, :), tau(:), work(:), singular(:)
        integer, allocatable, private :: order(:)
    contains
        procedure :: allocate => allocate_basis, factor_qr, factor_svd, largest_secant
        procedure, private :: load, decide_rank
    end type basis_type

contains

    !> Allocate for n coordinates, nh holonomic and m constraints in total.
    subroutine allocate_basis(self, n, nh, m, columns)
        class(basis_type), intent(inout) :: self
        integer, intent(in) :: n, nh, m
        !> Largest number of requested columns of Q, at least m; by default n, which the singular value decomposition needs.
        integer, intent(in), optional :: columns
        integer :: width

        self%n = n
        self%nh = nh
        self%m = m
        if (allocated(self%q)) deallocate (self%q, self%rows, self%tau, self%work, self%singular, self%order)
        width = n
        if (present(columns)) width = columns
        allocate (self%q(n, width), self%rows(n, max(m, 1)), self%tau(max(m, 1)), self%singular(max(m, 1)), source=0.0_wp)
        allocate (self%order(max(m, 1)), source=0)
        ! Sufficient for the blocked forms of all four routines: (n + 1) 32 for QR, 5 n for the SVD.
        allocate (self%work(32*(n + 1)), source=0.0_wp)
    end subroutine allocate_basis

    !> Copy C' with rows of unit length in scaled coordinates.
    subroutine load(self, matrix, scale)
        class(basis_type), intent(inout) :: self
        real(wp), intent(in) :: matrix(:, :), scale(:)
        real(wp) :: length
        integer :: i, j

        do i = 1, self%m
            length = 0.0_wp
            do j = 1, self%n
                self%rows(j, i) = matrix(i, j)*scale(j)
                length = max(length, abs(self%rows(j, i)))
            end do
            if (.not. length > 0.0_wp) cycle
            length = length*norm2(self%rows(:, i)/length)
            self%rows(:, i) = self%rows(:, i)/length
        end do
    end subroutine load

    !> Bases by pivoted QR.
    subroutine factor_qr(self, matrix, scale, columns)
        class(basis_type), intent(inout) :: self
        !> C (m, n), holonomic rows first.
        real(wp), intent(in) :: matrix(:, :)
        !> Coordinate scales (n); the bases are those of C diag(scale).
        real(wp), intent(in) :: scale(:)
        !> Number of columns of Q to compute: nh for U, m for X, n for V and W too.
        integer, intent(in) :: columns
        integer :: i, info, ne

        self%deficient = .false.
        self%dependent_row = 0
        self%smallest = 1.0_wp
        if (self%m == 0) then
            call set_identity(self%q)
            return
        end if
        call self%load(matrix, scale)
        associate (n => self%n, nh => self%nh, lwork => size(self%work))
            ne = self%m - nh
            if (n <= few) then
                call factor_pivoted(n, self%m, nh, self%rows, self%tau, self%order)
            else if (nh > 0) then
                self%order = 0
                call dgeqp3(n, nh, self%rows, n, self%order, self%tau, self%work, lwork, info)
            end if
            if (n > few .and. ne > 0) then
                if (nh > 0) call dormqr('L', 'T', n, ne, nh, self%rows(:, :nh), n, self%tau, self%rows(1, nh + 1), n, &
                    self%work, lwork, info)
                ! The reflectors of this block act only on rows nh + 1 ... n, so that both blocks are one set of m reflectors.
                self%order(nh + 1:self%m) = 0
                call dgeqp3(n - nh, ne, self%rows(nh + 1, nh + 1), n, self%order(nh + 1), self%tau(nh + 1), self%work, lwork, info)
                self%order(nh + 1:self%m) = self%order(nh + 1:self%m) + nh
            end if
            do i = 1, self%m
                if (abs(self%rows(i, i)) >= self%smallest) cycle
                self%smallest = abs(self%rows(i, i))
                self%dependent_row = self%order(i)
            end do
            if (n <= few) then
                call form_columns(n, self%m, columns, self%rows, self%tau, self%q)
            else if (columns > 0) then
                self%q(:, :self%m) = self%rows
                call dorgqr(n, columns, min(self%m, columns), self%q, n, self%tau, self%work, lwork, info)
            end if
        end associate
        if (self%smallest <= rounding) then
            ! No singular value is needed: the smallest one is at most this, and the largest one at least 1.
            self%deficient = .true.
        else if (.not. self%smallest > suspicion) then
            call self%decide_rank(matrix, scale)
        end if
        if (.not. self%deficient) self%dependent_row = 0
    end subroutine factor_qr

    !> Rank decision: singular values of the rows of unit length.
    subroutine decide_rank(self, matrix, scale)
        class(basis_type), intent(inout) :: self
        real(wp), intent(in) :: matrix(:, :), scale(:)
        real(wp) :: no_left(1, 1), no_right(1, 1)
        integer :: info

        call self%load(matrix, scale)
        call dgesvd('N', 'N', self%n, self%m, self%rows, self%n, self%singular, no_left, 1, no_right, 1, &
            self%work, size(self%work), info)
        self%smallest = self%singular(self%m)
        self%deficient = info /= 0 .or. .not. self%smallest > rank_tolerance*self%singular(1)
    end subroutine decide_rank

    !> Bases by singular value decomposition, as in the paper: V from Phi_q, Z from E V, W = V Z. For set-up and comparison: it
    !> allocates.
    subroutine factor_svd(self, matrix, scale)
        class(basis_type), intent(inout) :: self
        !> C (m, n), holonomic rows first.
        real(wp), intent(in) :: matrix(:, :)
        !> Coordinate scales (n).
        real(wp), intent(in) :: scale(:)
        real(wp), allocatable :: reduced(:, :), z(:, :), rotated(:, :)
        real(wp) :: no_right(1, 1)
        integer :: info, ne, nv

        self%deficient = .false.
        self%dependent_row = 0
        self%smallest = 1.0_wp
        call set_identity(self%q)
        if (self%m == 0) return
        ne = self%m - self%nh
        nv = self%n - self%nh
        call self%load(matrix, scale)
        if (ne > 0) reduced = self%rows(:, self%nh + 1:self%m)
        if (self%nh > 0) call dgesvd('A', 'N', self%n, self%nh, self%rows, self%n, self%singular, self%q, self%n, &
            no_right, 1, self%work, size(self%work), info)
        if (ne > 0) then
            associate (v => self%q(:, self%nh + 1:self%n))
                reduced = matmul(transpose(v), reduced)
                allocate (z(nv, nv))
                call dgesvd('A', 'N', nv, ne, reduced, nv, self%singular, z, nv, no_right, 1, self%work, size(self%work), info)
                rotated = matmul(v, z)
            end associate
            self%q(:, self%nh + 1:self%n) = rotated
        end if
        call self%decide_rank(matrix, scale)
        if (self%deficient) then
            rotated = self%q
            call self%factor_qr(matrix, scale, self%m)
            self%q = rotated
        end if
    end subroutine factor_svd

    !> 1 / the smallest singular value of a matrix of cosines (at most m, m): the secant of the largest angle between two subspaces;
    !> 1 for an empty matrix.
    real(wp) function largest_secant(self, cosines)
        class(basis_type), intent(inout) :: self
        real(wp), intent(in) :: cosines(:, :)
        real(wp) :: no_left(1, 1), no_right(1, 1)
        integer :: info, m

        largest_secant = 1.0_wp
        m = size(cosines, 1)
        if (m == 0) return
        self%rows(:m, :m) = cosines
        call dgesvd('N', 'N', m, m, self%rows, self%n, self%singular, no_left, 1, no_right, 1, &
            self%work, size(self%work), info)
        largest_secant = huge(1.0_wp)
        if (info == 0 .and. self%singular(m) > 0.0_wp) largest_secant = 1.0_wp/self%singular(m)
    end function largest_secant

    !> The identity matrix.
    pure subroutine set_identity(a)
        real(wp), intent(out) :: a(:, :)
        integer :: i

        a = 0.0_wp
        do i = 1, min(size(a, 1), size(a, 2))
            a(i, i) = 1.0_wp
        end do
    end subroutine set_identity
end module tandem_linalg_basis
