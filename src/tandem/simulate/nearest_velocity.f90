! SPDX-License-Identifier: MIT
!> The consistent velocity nearest to a given one: minimise (qd - qd0)' K (qd - qd0) over the free entries subject to C qd = nu,
!> with K the mass matrix or given weights. M may be singular: the weights determine directions without mass.
!>
!> Velocities here are y = (qd - qd0) / width with width = w^(-1/2). The shortest solution y_p of the constraints in that norm is
!> followed by the step in their null space, y = y_p - Z (Z' K Z)^+ Z' K y_p, with the pseudo-inverse from eigenvalues. It is linear
!> in the violation of each row, so that the parts of the rows add up to the move.
module tandem_simulate_nearest_velocity
    use tandem_kinds, only: wp
    use tandem_linalg_orthogonal, only: orthogonal_type
    use tandem_linalg_singular, only: decompose_symmetric
    use tandem_model_evaluator, only: evaluator_type
    use tandem_model_terms, only: need_jacobian, need_mass, need_nu
    use tandem_status, only: status_inconsistent_start, status_not_finite, status_ok
    use tandem_model_counts, only: counts_type
    use tandem_model_natural_scale, only: velocity_errors
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)
    private

    public :: nearest_velocity_type

    type :: nearest_velocity_type
        !> Part of each row in the move of each entry (m, n).
        real(wp), allocatable :: pull(:, :)
        !> After inconsistent_start: the row that is violated most, its residual, also on its natural scale.
        integer :: failed_row = 0
        real(wp) :: failed_amount = 0.0_wp, failed_value = 0.0_wp
        integer, private :: m = 0
        !> True if K is the mass matrix.
        logical, private :: by_mass = .true.
        integer, allocatable, private :: free(:)
        real(wp), allocatable, private :: width(:), scale(:)
        real(wp), private :: tolerance = 0.0_wp
        !> C diag(width) of the free entries with rows of unit length (m, free), and their lengths (m).
        real(wp), allocatable, private :: a(:, :), length(:)
        type(orthogonal_type), private :: rows
        !> Z (free, free - rank), (Z'KZ)^+ and Z'K (free - rank, free).
        real(wp), allocatable, private :: z(:, :), inverse(:, :), coupling(:, :)
    contains
        procedure :: initialize, find
        procedure, private :: factor, factor_mass, respond
    end type nearest_velocity_type

contains

    !> Allocate for a problem.
    subroutine initialize(self, m, is_fixed, weight, scale, by_mass, tolerance)
        class(nearest_velocity_type), intent(inout) :: self
        !> Number of constraints.
        integer, intent(in) :: m
        !> True for entries that are fixed (n); weights > 0 and typical magnitudes of the coordinates (n).
        logical, intent(in) :: is_fixed(:)
        real(wp), intent(in) :: weight(:), scale(:)
        !> True for the metric of the masses.
        logical, intent(in) :: by_mass
        !> Largest violation of a satisfied constraint, on the natural scale.
        real(wp), intent(in) :: tolerance
        integer :: j

        self%m = m
        self%by_mass = by_mass
        self%free = pack([(j, j=1, size(scale))], .not. is_fixed)
        self%width = 1.0_wp/sqrt(weight(self%free))
        self%scale = scale
        self%tolerance = tolerance
        self%length = spread(0.0_wp, 1, m)
        if (allocated(self%a)) deallocate (self%a)
        allocate (self%a(m, size(self%free)), source=0.0_wp)
        if (allocated(self%pull)) deallocate (self%pull)
        allocate (self%pull(m, size(scale)), source=0.0_wp)
    end subroutine initialize

    !> qd := the nearest consistent velocity at (t, q); a consistent one is unchanged bitwise. Statuses: inconsistent_start,
    !> callback_failed, not_evaluable, not_finite; with each of them qd is unchanged.
    subroutine find(self, model, t, q, qd, counts, stat)
        class(nearest_velocity_type), intent(inout) :: self
        type(evaluator_type), intent(inout) :: model
        !> Time, coordinates (n), velocities (n).
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(inout) :: qd(:)
        type(counts_type), intent(inout) :: counts
        !> A status code.
        integer, intent(out) :: stat
        real(wp) :: violation(self%m), y(size(self%free)), share(self%m), moved(size(qd))
        integer :: i

        stat = status_ok
        if (self%m == 0) return
        ! None of them depends on the velocity; q is passed in its place.
        call model%evaluate(need_jacobian + need_nu, t, q, q, counts, stat)
        if (stat /= status_ok) return
        associate (c => model%terms%jacobian, nu => model%terms%nu)
            if (.not. all(ieee_is_finite(c)) .or. .not. all(ieee_is_finite(nu))) then
                stat = status_not_finite
                model%failed_term = merge('jacobian    ', 'nu          ', .not. all(ieee_is_finite(c)))
                return
            end if
            moved = qd
            call velocity_errors(nu, c, moved, self%scale, self%failed_value, self%failed_row)
            if (self%failed_value <= self%tolerance) return
            call self%factor(c)
            if (self%by_mass) call self%factor_mass(model, t, q, counts, stat)
            if (stat /= status_ok) return
            violation = nu - matmul(c, moved)
            do i = 1, self%m
                share = 0.0_wp
                share(i) = violation(i)/self%length(i)
                call self%respond(share, y)
                self%pull(i, self%free) = self%width*y
            end do
            ! The second pass removes the rounding error of the first.
            do i = 1, 2
                call self%respond(violation/self%length, y)
                moved(self%free) = moved(self%free) + self%width*y
                violation = nu - matmul(c, moved)
            end do
            call velocity_errors(nu, c, moved, self%scale, self%failed_value, self%failed_row)
            if (self%failed_value <= self%tolerance) then
                qd = moved
            else
                self%failed_amount = abs(violation(self%failed_row))
                stat = status_inconsistent_start
            end if
        end associate
    end subroutine find

    !> Rows of unit length in the weighted norm, and the null space.
    subroutine factor(self, jacobian)
        class(nearest_velocity_type), intent(inout) :: self
        real(wp), intent(in) :: jacobian(:, :)
        integer :: i, j

        do j = 1, size(self%free)
            self%a(:, j) = jacobian(:, self%free(j))*self%width(j)
        end do
        do i = 1, self%m
            self%length(i) = norm2(self%a(i, :))
            if (.not. self%length(i) > 0.0_wp) self%length(i) = 1.0_wp
            self%a(i, :) = self%a(i, :)/self%length(i)
        end do
        call self%rows%factor(self%a)
    end subroutine factor

    !> (Z'KZ)^+ and Z'K for K = diag(width) M diag(width).
    subroutine factor_mass(self, model, t, q, counts, stat)
        class(nearest_velocity_type), intent(inout) :: self
        type(evaluator_type), intent(inout) :: model
        real(wp), intent(in) :: t, q(:)
        type(counts_type), intent(inout) :: counts
        integer, intent(out) :: stat
        !> Eigenvalues of a singular M are rounding, some eps of the largest one.
        real(wp), parameter :: smallest = 1.0e-13_wp
        real(wp), allocatable :: vectors(:, :), values(:), mass(:, :), kept(:)
        integer :: j

        call model%evaluate(need_mass, t, q, q, counts, stat)
        if (stat /= status_ok) return
        if (.not. all(ieee_is_finite(model%terms%mass))) then
            stat = status_not_finite
            model%failed_term = 'mass'
            return
        end if
        call self%rows%get_null_basis(self%z)
        mass = model%terms%mass(self%free, self%free)
        do j = 1, size(self%free)
            mass(:, j) = mass(:, j)*self%width*self%width(j)
        end do
        self%coupling = matmul(transpose(self%z), mass)
        vectors = matmul(self%coupling, self%z)
        values = spread(0.0_wp, 1, size(vectors, 1))
        call decompose_symmetric(vectors, values)
        kept = spread(0.0_wp, 1, size(values))
        where (values > smallest*maxval(abs(mass))) kept = 1.0_wp/values
        self%inverse = vectors
        do j = 1, size(kept)
            self%inverse(:, j) = self%inverse(:, j)*kept(j)
        end do
        self%inverse = matmul(self%inverse, transpose(vectors))
    end subroutine factor_mass

    !> The move y (free) that removes a violation of the rows, on the scale of their lengths (m).
    subroutine respond(self, violation, y)
        class(nearest_velocity_type), intent(in) :: self
        real(wp), intent(in) :: violation(:)
        real(wp), intent(out) :: y(:)

        call self%rows%solve(violation, y)
        if (self%by_mass) y = y - matmul(self%z, matmul(self%inverse, matmul(self%coupling, y)))
    end subroutine respond
end module tandem_simulate_nearest_velocity
