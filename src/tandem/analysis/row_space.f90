! SPDX-License-Identifier: MIT
!> The rows of Phi_q or of C at a point: solutions of least norm, an orthonormal basis of their null space, their rank. By singular
!> values, or, for many coordinates with a pattern and independent rows, by sparse factors and projections of random vectors.
module tandem_analysis_row_space
    use tandem_kinds, only: wp
    use tandem_linalg_random, only: random_vector
    use tandem_linalg_singular, only: orthonormalise, singular_type
    use tandem_model_pattern, only: pattern_type
    use tandem_model_sparse_rows, only: sparse_rows_type
    implicit none (type, external)
    private

    public :: row_space_type

    type :: row_space_type
        integer :: rank = 0
        integer, private :: m = 0, n = 0
        logical, private :: tries_sparse = .false., is_sparse = .false.
        type(singular_type), allocatable, private :: singular
        type(sparse_rows_type), private :: sparse
    contains
        procedure :: initialize, factor, solve, solve_transposed, get_null_basis
    end type row_space_type

    !> Sparse factors cost less from this number of coordinates on.
    integer, parameter :: large = 250
    !> Rows whose squared distances from each other are above this part of their squared lengths are independent.
    real(wp), parameter :: clearly = 1.0e-8_wp

contains

    !> Rows (m, n), the first rows of a pattern if one is given.
    subroutine initialize(self, m, n, pattern)
        class(row_space_type), intent(inout) :: self
        integer, intent(in) :: m, n
        type(pattern_type), intent(in), optional :: pattern

        self%m = m
        self%n = n
        self%tries_sparse = .false.
        if (allocated(self%singular)) deallocate (self%singular)
        if (.not. present(pattern) .or. n < large) return
        self%tries_sparse = .true.
        call self%sparse%initialize(pattern)
    end subroutine initialize

    !> Factor a matrix of finite numbers, whose rows should be of about the same length.
    subroutine factor(self, a, pattern)
        class(row_space_type), intent(inout) :: self
        real(wp), intent(in) :: a(:, :)
        !> The pattern given to `initialize`.
        type(pattern_type), intent(in), optional :: pattern
        real(wp) :: ones(self%n)
        integer :: j, stat

        self%is_sparse = .false.
        if (self%tries_sparse .and. present(pattern)) then
            ones = 1.0_wp
            call self%sparse%factor(pattern, a, [(j, j=1, self%n)], ones, self%m, stat)
            self%is_sparse = stat == 0 .and. self%sparse%rank == self%m .and. self%sparse%least > clearly
            self%rank = self%m
            if (self%is_sparse) return
        end if
        if (.not. allocated(self%singular)) then
            allocate (self%singular)
            call self%singular%allocate(self%m, self%n)
        end if
        call self%singular%factor(a)
        self%rank = self%singular%rank
    end subroutine factor

    !> The x (n) of smallest norm that minimises |A x - b|.
    subroutine solve(self, b, x)
        class(row_space_type), intent(in) :: self
        real(wp), intent(in) :: b(:)
        real(wp), intent(out) :: x(:)

        if (self%is_sparse) then
            call self%sparse%solve(b, x)
        else
            call self%singular%solve(b, x)
        end if
    end subroutine solve

    !> The y (m) of smallest norm that minimises |A'y - g|.
    subroutine solve_transposed(self, g, y)
        class(row_space_type), intent(in) :: self
        real(wp), intent(in) :: g(:)
        real(wp), intent(out) :: y(:)

        if (self%is_sparse) then
            call self%sparse%solve_transposed(g, y)
        else
            call self%singular%solve_transposed(g, y)
        end if
    end subroutine solve_transposed

    !> An orthonormal basis (n, n - rank) of the null space.
    subroutine get_null_basis(self, z)
        class(row_space_type), intent(in) :: self
        real(wp), allocatable, intent(out) :: z(:, :)
        integer :: i, j, seed

        if (.not. self%is_sparse) then
            call self%singular%get_null_basis(z)
            return
        end if
        allocate (z(self%n, self%n - self%rank))
        seed = 60013
        do j = 1, size(z, 2)
            z(:, j) = random_vector(seed, self%n)
        end do
        ! The second pass removes the errors of the first one and of small angles between the projections.
        do i = 1, 2
            do j = 1, size(z, 2)
                call self%sparse%project(z(:, j))
            end do
            call orthonormalise(z)
        end do
    end subroutine get_null_basis
end module tandem_analysis_row_space
