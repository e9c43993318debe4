! SPDX-License-Identifier: MIT
!> The space spanned by the rows of a matrix: its distance from rank loss, and changes of its orientation between matrices. Steps
!> use both occasionally, so that the work space is allocated once, at the first use.
module tandem_linalg_row_space
    use tandem_kinds, only: wp
    use tandem_linalg_lapack, only: dgesvd
    use tandem_linalg_lu, only: lu_type
    implicit none (type, external)
    private

    public :: row_space_type

    !> Work space for matrices (m, n) of one shape.
    type :: row_space_type
        private
        !> Rows as columns (n, m), a matrix (m, m), singular values (m), work space of dgesvd.
        real(wp), allocatable :: rows(:, :), square(:, :), singular(:), work(:)
        type(lu_type) :: lu
    contains
        procedure :: forget, find_weakest, keeps_orientation
        procedure, private :: prepare
    end type row_space_type

contains

    !> Deallocate the work space: the next matrices may have another shape.
    pure subroutine forget(self)
        class(row_space_type), intent(inout) :: self

        if (allocated(self%rows)) deallocate (self%rows, self%square, self%singular, self%work)
    end subroutine forget

    !> Allocate the work space unless it is allocated.
    subroutine prepare(self, m, n)
        class(row_space_type), intent(inout) :: self
        integer, intent(in) :: m, n

        if (allocated(self%rows)) return
        allocate (self%rows(n, m), self%square(m, m), self%singular(m), self%work(8*(m + n)), source=0.0_wp)
        call self%lu%allocate(m)
    end subroutine prepare

    !> Combination of unit rows that is closest to zero: coefficients of the rows, the largest 1 in modulus.
    subroutine find_weakest(self, m, n, matrix, scale, share, smallest)
        class(row_space_type), intent(inout) :: self
        !> Rows (m, n), m <= n, of constant shape, and scales of their unknowns (n).
        integer, intent(in) :: m, n
        real(wp), intent(in) :: matrix(m, n), scale(n)
        !> Coefficient of each row (m).
        real(wp), intent(out) :: share(m)
        !> Smallest singular value of the unit rows.
        real(wp), intent(out) :: smallest
        real(wp) :: length, no_left(1, 1)
        integer :: i, info

        call self%prepare(m, n)
        share = 0.0_wp
        smallest = 0.0_wp
        do i = 1, m
            self%rows(:, i) = matrix(i, :)*scale
            length = norm2(self%rows(:, i))
            if (.not. (length > 0.0_wp .and. length <= huge(1.0_wp))) then
                share(i) = 1.0_wp
                return
            end if
            self%rows(:, i) = self%rows(:, i)/length
        end do
        call dgesvd('N', 'A', n, m, self%rows, n, self%singular, no_left, 1, self%square, m, self%work, size(self%work), info)
        if (info /= 0) return
        smallest = self%singular(m)
        share = self%square(m, :)/maxval(abs(self%square(m, :)))
    end subroutine find_weakest

    !> True if the row spaces of two neighbouring matrices have the same orientation. If a singular value has passed through zero in
    !> between, the determinant of the second one in a basis of the first has changed its sign.
    logical function keeps_orientation(self, m, n, from, to, scale)
        class(row_space_type), intent(inout) :: self
        !> Rows (m, n), of constant shape, and scales of their unknowns (n).
        integer, intent(in) :: m, n
        real(wp), intent(in) :: from(m, n), to(m, n), scale(n)
        integer :: i, j, stat

        call self%prepare(m, n)
        call find_basis(m, n, from, scale, self%rows)
        do j = 1, m
            do i = 1, m
                self%square(i, j) = sum(to(i, :)*scale*self%rows(:, j))
            end do
        end do
        call self%lu%factor(self%square, stat)
        keeps_orientation = stat == 0 .and. self%lu%determinant_sign() > 0
    end function keeps_orientation

    !> Gram-Schmidt basis of rows, in which their determinant is positive.
    pure subroutine find_basis(m, n, rows, scale, basis)
        integer, intent(in) :: m, n
        real(wp), intent(in) :: rows(m, n), scale(n)
        real(wp), intent(out) :: basis(n, m)
        real(wp) :: part
        integer :: i, j, pass

        do i = 1, m
            basis(:, i) = rows(i, :)*scale
            do pass = 1, 2
                do j = 1, i - 1
                    part = dot_product(basis(:, j), basis(:, i))
                    basis(:, i) = basis(:, i) - part*basis(:, j)
                end do
            end do
            basis(:, i) = basis(:, i)/max(norm2(basis(:, i)), tiny(1.0_wp))
        end do
    end subroutine find_basis
end module tandem_linalg_row_space
