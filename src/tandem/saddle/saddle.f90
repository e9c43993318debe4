! SPDX-License-Identifier: MIT
!> Saddle-point systems of mechanics,
!>
!>   H x + C' lambda = f,   C x = g,
!>
!> with H = M for accelerations and consistent starts, H = K for equilibria, H = I for projections. Rows of C may depend on each
!> other. There is a sparse and a dense implementation; `suits_sparse` predicts which costs less.
module tandem_saddle
    use tandem_kinds, only: wp
    use tandem_linalg_order, only: list_type
    use tandem_model_neighbours, only: find_neighbours
    use tandem_model_pattern, only: pattern_type
    use tandem_saddle_columns, only: columns_type
    implicit none (type, external)
    private

    public :: saddle_type, saddle_singular, saddle_too_large

    !> Statuses of `factor`: the matrix is singular for the rows that take part; its factors would exceed the memory limit.
    integer, parameter :: saddle_singular = 1, saddle_too_large = -1

    type, abstract :: saddle_type
        !> Numbers of coordinates and rows.
        integer :: n = 0, m = 0
        type(pattern_type), pointer :: pattern => null()
        !> Structure of H.
        type(columns_type) :: columns
        !> Coordinate scales (n): solutions of least norm are those of x/scale.
        real(wp), allocatable :: scale(:)
        !> Rows that take no part (m): set before `load`, and by `factor` for rows that depend on others. Their multipliers
        !> are zero. The dense implementation keeps all rows and computes multipliers of least norm, of rows of unit length.
        logical, allocatable :: is_out(:)
        !> True if rows may depend on others. The dense implementation always expects this.
        logical :: drops_dependent = .false.
        !> Size of H below which reduced matrices are rounding.
        real(wp) :: size_of_h = 0.0_wp
        !> Dimension of the set of solutions x after `factor`; not zero in the dense implementation alone.
        integer :: n_free = 0
    contains
        procedure(analyse_interface), deferred :: analyse
        procedure(load_interface), deferred :: load
        procedure(factor_interface), deferred :: factor
        procedure(solve_interface), deferred :: solve
        procedure(independence_interface), deferred :: independence
        procedure :: multiply, attach
    end type saddle_type

    abstract interface
        !> Prepare for the structure of a model.
        subroutine analyse_interface(self, pattern, scale)
            import :: pattern_type, saddle_type, wp
            implicit none (type, external)
            class(saddle_type), intent(inout) :: self
            !> It must outlive the system.
            type(pattern_type), intent(in), target :: pattern
            !> Coordinate scales (n).
            real(wp), intent(in) :: scale(:)
        end subroutine analyse_interface

        !> Set the matrix.
        subroutine load_interface(self, h, c)
            import :: saddle_type, wp
            implicit none (type, external)
            class(saddle_type), intent(inout) :: self
            !> Entries of H in the order of `columns`; C, compressed by the pattern (m, width).
            real(wp), intent(in) :: h(:), c(:, :)
        end subroutine load_interface

        !> Factor the loaded matrix.
        subroutine factor_interface(self, stat)
            import :: saddle_type
            implicit none (type, external)
            class(saddle_type), intent(inout) :: self
            !> 0, `saddle_singular` or `saddle_too_large`.
            integer, intent(out) :: stat
        end subroutine factor_interface

        !> Solve with the last factors. Systems of dependent rows, and singular ones of the dense implementation, have least-squares
        !> solutions of least norm.
        subroutine solve_interface(self, f, g, x, lambda)
            import :: saddle_type, wp
            implicit none (type, external)
            class(saddle_type), intent(in) :: self
            !> (n), (m).
            real(wp), intent(in) :: f(:), g(:)
            real(wp), intent(out) :: x(:), lambda(:)
        end subroutine solve_interface

        !> Smallest pivot of an independent row over its length: near zero if rows almost depend on each other.
        pure real(wp) function independence_interface(self)
            import :: saddle_type, wp
            implicit none (type, external)
            class(saddle_type), intent(in) :: self
        end function independence_interface
    end interface

contains

    !> The part of `analyse` that all implementations share.
    subroutine attach(self, pattern, scale, neighbours)
        class(saddle_type), intent(inout) :: self
        type(pattern_type), intent(in), target :: pattern
        real(wp), intent(in) :: scale(:)
        !> Of each body.
        type(list_type), allocatable, intent(inout) :: neighbours(:)

        self%pattern => pattern
        self%n = size(scale)
        self%m = pattern%n_rows
        self%scale = scale
        self%is_out = spread(.false., 1, self%m)
        self%n_free = 0
        call find_neighbours(pattern, neighbours)
        call self%columns%build(pattern, neighbours)
    end subroutine attach

    !> g = C x for a compressed C (m, width).
    pure subroutine multiply(self, c, x, g)
        class(saddle_type), intent(in) :: self
        real(wp), intent(in) :: c(:, :), x(:)
        real(wp), intent(out) :: g(:)

        call self%pattern%multiply(c, x, .false., g)
    end subroutine multiply
end module tandem_saddle
