! SPDX-License-Identifier: MIT
!> Splitting of the space of velocities by C at a point: a right inverse R (C R = I) and a basis D of null(C).
!>
!> Three methods. By elimination of C alone, R = [Cd^-1; 0] and D = [-Y; I]: the cheapest, for explicit steps, which use the
!> elimination itself (`tandem_chart_dense_free_motion`). With the chart's bases X and W, R = X H and D = (I - X H C) W (31), where
!> H = (C X)^-1 comes from a factorisation or from the paper's refinement (29): for implicit steps, whose Newton matrix must belong
!> to one system of coordinates. With a factorisation, a correction of a stage needs only products with a vector, and two or three
!> solutions with C X. R and D are formed only if they are needed as matrices (`complete`).
module tandem_chart_dense_velocity_basis
    use tandem_kinds, only: wp
    use tandem_linalg_elimination, only: elimination_type, pivots_type
    use tandem_linalg_kernels, only: add_product, add_transposed_product, set_product
    use tandem_linalg_lu, only: lu_type
    use tandem_pack, only: pack_type
    use tandem_status, only: status_chart_left, status_not_finite, status_ok, status_rank_deficient
    use tandem_model_counts, only: counts_type
    use tandem_linalg_refinement, only: refinement_type
    implicit none (type, external)
    private

    public :: velocity_basis_type, velocity_basis_memory_type, by_elimination, by_factor, by_refinement

    !> Methods for R and D.
    integer, parameter :: by_elimination = 1, by_factor = 2, by_refinement = 3

    !> Pivots, or H, of an earlier point.
    type :: velocity_basis_memory_type
        private
        type(pivots_type) :: pivots
        real(wp), allocatable :: h(:, :)
        integer :: most_corrections = 0
    end type velocity_basis_memory_type

    !> R and D at a point.
    type :: velocity_basis_type
        !> R (n, m) and D (n, k), k = n - m.
        real(wp), allocatable :: right_inverse(:, :), null_space(:, :)
        !> The sign of the determinant of Cd or C X found by `measure_orientation`: if it changes along a motion, C may have lost
        !> rank.
        integer :: orientation = 1
        !> Measure that falls to zero when C loses rank: the smallest pivot; by elimination, a value set by the chart.
        real(wp) :: independence = 1.0_wp
        !> True if both belong to the last `update`.
        logical :: is_measured = .false.
        !> After a failure: the row without a pivot, 0 if no single row is at fault.
        integer :: failed_row = 0
        !> Largest number of corrections of a refinement of H since the caller set this to zero.
        integer :: most_corrections = 0
        !> True if R and D belong to the last `update`.
        logical :: is_complete = .false.
        integer, private :: way = by_elimination
        integer, private :: m = 0
        real(wp), private :: htol = 0.0_wp
        type(elimination_type) :: elimination
        type(refinement_type), private :: h
        type(lu_type), private :: c_x_lu
        !> C X (m, m), C W (m, k).
        real(wp), allocatable, private :: c_x(:, :), c_w(:, :), y(:)
    contains
        procedure :: allocate => allocate_split, start, eliminate, update
        procedure :: measure_orientation, complete, subtract_right_inverse, subtract_reaction
        procedure :: save, restore_saved, pack_state
        procedure, private :: invert
    end type velocity_basis_type

contains

    !> Allocate for n coordinates and m constraints.
    subroutine allocate_split(self, n, m, way, htol)
        class(velocity_basis_type), intent(inout) :: self
        integer, intent(in) :: n, m
        !> One of the methods above; the tolerance of (29) for `by_refinement`.
        integer, intent(in) :: way
        real(wp), intent(in) :: htol

        self%m = m
        self%way = way
        self%htol = htol
        if (allocated(self%right_inverse)) deallocate (self%right_inverse, self%null_space, self%c_x, self%c_w, self%y)
        allocate (self%y(m), source=0.0_wp)
        ! Explicit steps of many coordinates do not use them and need not allocate the memory.
        allocate (self%right_inverse(n, m), self%null_space(n, n - m))
        if (way == by_elimination) then
            allocate (self%c_x(0, 0), self%c_w(0, 0))
            call self%elimination%allocate(m, n)
        else
            allocate (self%c_x(m, m), self%c_w(m, n - m), source=0.0_wp)
            call self%c_x_lu%allocate(m)
            call self%h%allocate(m)
        end if
    end subroutine allocate_split

    !> Begin at the origin of a new chart, where H is not near the last one.
    subroutine start(self, jacobian, x_basis, stat)
        class(velocity_basis_type), intent(inout) :: self
        !> C (m, n) at the origin and X (n, m).
        real(wp), intent(in), contiguous :: jacobian(:, :), x_basis(:, :)
        !> A status code.
        integer, intent(out) :: stat

        stat = status_ok
        if (self%way == by_refinement) call self%invert(jacobian, x_basis, stat)
    end subroutine start

    !> Eliminate C at a point, which gives R and D for explicit steps.
    subroutine eliminate(self, n, jacobian, scale, counts, stat)
        class(velocity_basis_type), intent(inout) :: self
        integer, intent(in) :: n
        !> C (m, n), coordinate scales (n).
        real(wp), intent(in) :: jacobian(self%m, n), scale(n)
        type(counts_type), intent(inout) :: counts
        !> A status code.
        integer, intent(out) :: stat

        self%is_measured = .false.
        self%is_complete = .false.
        if (self%m > 0) counts%constraint_factorizations = counts%constraint_factorizations + 1
        call self%elimination%eliminate(jacobian, scale, self%failed_row)
        stat = status_ok
        if (self%failed_row > 0) stat = status_rank_deficient
        if (self%failed_row < 0) stat = status_not_finite
        self%failed_row = max(self%failed_row, 0)
    end subroutine eliminate

    !> Bring R and D to C at a point by the bases X and W; `by_factor` up to the factorisation.
    subroutine update(self, jacobian, x_basis, w_basis, counts, stat)
        class(velocity_basis_type), intent(inout) :: self
        !> C (m, n), X (n, m) and W (n, k).
        real(wp), intent(in), contiguous :: jacobian(:, :), x_basis(:, :), w_basis(:, :)
        type(counts_type), intent(inout) :: counts
        !> A status code.
        integer, intent(out) :: stat

        self%failed_row = 0
        self%is_measured = .false.
        self%is_complete = .false.
        if (self%m > 0) counts%constraint_factorizations = counts%constraint_factorizations + 1
        call set_product(jacobian, x_basis, self%c_x)
        if (self%way == by_factor) then
            call self%c_x_lu%factor(self%c_x, stat)
            stat = merge(status_ok, status_chart_left, stat == 0)
        else
            call self%h%refine(self%c_x, self%htol, counts%h_corrections, stat)
            self%most_corrections = max(self%most_corrections, self%h%last_corrections)
            if (stat == status_ok) call self%complete(jacobian, x_basis, w_basis)
        end if
    end subroutine update

    !> Form R and D for the C of the last update, unless that is done.
    subroutine complete(self, jacobian, x_basis, w_basis)
        class(velocity_basis_type), intent(inout) :: self
        !> C (m, n), X (n, m), W (n, k).
        real(wp), intent(in), contiguous :: jacobian(:, :), x_basis(:, :), w_basis(:, :)

        if (self%is_complete) return
        self%is_complete = .true.
        if (self%way == by_elimination) then
            call self%elimination%get_right_inverse(self%right_inverse)
            call self%elimination%get_null_space(self%null_space)
            return
        end if
        if (self%way == by_factor) call self%c_x_lu%invert(self%h%inverse)
        call set_product(x_basis, self%h%inverse, self%right_inverse)
        call set_product(jacobian, w_basis, self%c_w)
        call set_product(self%right_inverse, self%c_w, self%null_space)
        self%null_space = w_basis - self%null_space
    end subroutine complete

    !> y := y - R x.
    subroutine subtract_right_inverse(self, x_basis, x, y)
        class(velocity_basis_type), intent(inout) :: self
        !> X (n, m); not used if R is formed.
        real(wp), intent(in), contiguous :: x_basis(:, :)
        !> x (m); its value is lost.
        real(wp), intent(inout), contiguous :: x(:)
        real(wp), intent(inout), contiguous :: y(:)

        if (self%is_complete) then
            call add_product(self%right_inverse, x, -1.0_wp, y)
        else
            call self%c_x_lu%solve(x)
            call add_product(x_basis, x, -1.0_wp, y)
        end if
    end subroutine subtract_right_inverse

    !> f := (I - C' R') f, after which W' f equals the former D' f.
    subroutine subtract_reaction(self, jacobian, x_basis, force)
        class(velocity_basis_type), intent(inout) :: self
        !> C (m, n), X (n, m).
        real(wp), intent(in), contiguous :: jacobian(:, :), x_basis(:, :)
        real(wp), intent(inout), contiguous :: force(:)

        self%y = 0.0_wp
        if (self%is_complete) then
            call add_transposed_product(self%right_inverse, force, 1.0_wp, self%y)
        else
            call add_transposed_product(x_basis, force, 1.0_wp, self%y)
            call self%c_x_lu%solve_transposed(self%y)
        end if
        call add_transposed_product(jacobian, self%y, -1.0_wp, force)
    end subroutine subtract_reaction

    !> Orientation and independence at the point of the last update.
    subroutine measure_orientation(self)
        class(velocity_basis_type), intent(inout) :: self
        integer :: stat

        self%is_measured = .true.
        if (self%way == by_elimination) then
            self%orientation = self%elimination%orientation()
            call self%elimination%measure_rows()
            return
        end if
        stat = 0
        if (self%way == by_refinement) call self%c_x_lu%factor(self%c_x, stat)
        if (stat /= 0) return
        self%orientation = self%c_x_lu%determinant_sign()
        self%independence = self%c_x_lu%smallest_pivot()
    end subroutine measure_orientation

    !> Save the start of the next step.
    subroutine save(self, memory)
        class(velocity_basis_type), intent(in) :: self
        type(velocity_basis_memory_type), intent(inout) :: memory

        if (self%way == by_elimination) call self%elimination%save(memory%pivots)
        if (self%way == by_refinement) memory%h = self%h%inverse
        memory%most_corrections = self%most_corrections
    end subroutine save

    !> Restore the saved start.
    subroutine restore_saved(self, memory)
        class(velocity_basis_type), intent(inout) :: self
        type(velocity_basis_memory_type), intent(in) :: memory

        if (self%way == by_elimination) call self%elimination%restore_saved(memory%pivots)
        if (self%way == by_refinement) self%h%inverse = memory%h
        self%most_corrections = memory%most_corrections
    end subroutine restore_saved

    !> H = (C X)^-1 by LU.
    subroutine invert(self, jacobian, x_basis, stat)
        class(velocity_basis_type), intent(inout) :: self
        real(wp), intent(in), contiguous :: jacobian(:, :), x_basis(:, :)
        integer, intent(out) :: stat

        call set_product(jacobian, x_basis, self%c_x)
        call self%c_x_lu%factor(self%c_x, stat)
        if (stat == 0) call self%c_x_lu%invert(self%h%inverse)
        if (stat == 0) self%orientation = self%c_x_lu%determinant_sign()
        if (stat == 0) self%independence = self%c_x_lu%smallest_pivot()
        stat = merge(status_ok, status_chart_left, stat == 0)
    end subroutine invert

    !> R, D, their factors, and dependent data.
    subroutine pack_state(self, pack)
        class(velocity_basis_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%is_complete)
        if (self%is_complete) call pack%item(self%right_inverse)
        if (self%is_complete) call pack%item(self%null_space)
        call pack%item(self%orientation)
        call pack%item(self%independence)
        call pack%item(self%is_measured)
        call pack%item(self%failed_row, self%most_corrections)
        call pack%item(self%c_x)
        if (self%way == by_elimination) then
            call self%elimination%pack_state(pack)
        else
            call self%c_x_lu%pack_state(pack)
            call pack%item(self%h%inverse)
        end if
    end subroutine pack_state
end module tandem_chart_dense_velocity_basis
