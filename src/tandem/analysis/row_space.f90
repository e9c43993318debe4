! SPDX-License-Identifier: MIT
!> Rows of Phi_q or of C at a point: solutions of least norm, an orthonormal basis of their null space, their rank. By orthogonal
!> decomposition, or, for many coordinates with a pattern and independent rows, by the saddle-point system [I, A'; A, 0] and
!> projections of random vectors.
module tandem_analysis_row_space
    use tandem_kinds, only: wp
    use tandem_linalg_orthogonal, only: orthogonal_type
    use tandem_linalg_random, only: random_vector
    use tandem_linalg_singular, only: orthonormalise
    use tandem_model_pattern, only: pattern_type
    use tandem_saddle_sparse, only: sparse_saddle_type
    implicit none (type, external)
    private

    public :: row_space_type

    type :: row_space_type
        integer :: rank = 0
        integer, private :: m = 0, n = 0
        logical, private :: tries_sparse = .false., is_sparse = .false.
        type(orthogonal_type), private :: orthogonal
        type(sparse_saddle_type), private :: sparse
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
        !> It must outlive the rows.
        type(pattern_type), intent(in), target, optional :: pattern

        self%m = m
        self%n = n
        self%tries_sparse = .false.
        if (.not. present(pattern) .or. n < large) return
        self%tries_sparse = .true.
        call self%sparse%analyse(pattern, spread(1.0_wp, 1, n))
        self%sparse%drops_dependent = .true.
    end subroutine initialize

    !> Factor a matrix of finite numbers, whose rows should be of about the same length.
    subroutine factor(self, a)
        class(row_space_type), intent(inout) :: self
        real(wp), intent(in) :: a(:, :)
        integer :: stat

        self%is_sparse = .false.
        if (self%tries_sparse) then
            call self%sparse%load_rows(a, is_full=.true.)
            call self%sparse%factor(stat)
            self%is_sparse = stat == 0 .and. .not. any(self%sparse%is_out(:self%m)) .and. self%sparse%independence() > clearly
            self%rank = self%m
            if (self%is_sparse) return
        end if
        call self%orthogonal%factor(a)
        self%rank = self%orthogonal%rank
    end subroutine factor

    !> The x (n) of smallest norm that minimises |A x - b|.
    subroutine solve(self, b, x)
        class(row_space_type), intent(in) :: self
        real(wp), intent(in) :: b(:)
        real(wp), intent(out) :: x(:)
        real(wp), dimension(self%sparse%m) :: all_rows, unused

        if (self%is_sparse) then
            all_rows = 0.0_wp
            all_rows(:self%m) = b
            call self%sparse%solve(spread(0.0_wp, 1, self%n), all_rows, x, unused)
        else
            call self%orthogonal%solve(b, x)
        end if
    end subroutine solve

    !> The y (m) of smallest norm that minimises |A'y - g|.
    subroutine solve_transposed(self, g, y)
        class(row_space_type), intent(in) :: self
        real(wp), intent(in) :: g(:)
        real(wp), intent(out) :: y(:)
        real(wp) :: all_rows(self%sparse%m), unused(self%n)

        if (self%is_sparse) then
            call self%sparse%solve(g, spread(0.0_wp, 1, self%sparse%m), unused, all_rows)
            y = all_rows(:self%m)
        else
            call self%orthogonal%solve_transposed(g, y)
        end if
    end subroutine solve_transposed

    !> An orthonormal basis (n, n - rank) of the null space.
    subroutine get_null_basis(self, z)
        class(row_space_type), intent(in) :: self
        real(wp), allocatable, intent(out) :: z(:, :)
        real(wp), dimension(self%sparse%m) :: none, unused
        real(wp) :: column(self%n)
        integer :: i, j, seed

        if (.not. self%is_sparse) then
            call self%orthogonal%get_null_basis(z)
            return
        end if
        allocate (z(self%n, self%n - self%rank))
        none = 0.0_wp
        seed = 60013
        do j = 1, size(z, 2)
            z(:, j) = random_vector(seed, self%n)
        end do
        ! The second pass removes the errors of the first one and of small angles between the projections.
        do i = 1, 2
            do j = 1, size(z, 2)
                column = z(:, j)
                call self%sparse%solve(column, none, z(:, j), unused)
            end do
            call orthonormalise(z)
        end do
    end subroutine get_null_basis
end module tandem_analysis_row_space
