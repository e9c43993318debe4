! SPDX-License-Identifier: MIT
!> Finds the consistent velocity nearest to a given one: minimises (qd - qd0)' K (qd - qd0) over the free entries subject to C qd =
!> nu, where K is the mass matrix or a diagonal matrix of given weights. M may be singular: the weights then determine the
!> velocities of directions without mass.
!>
!> The unknowns are y = (qd - qd0) / width with width = w^(-1/2). The solution y_p of least norm of the constraints is corrected in
!> their null space: y = y_p - Z (Z'KZ)^+ Z'K y_p, where the pseudo-inverse is computed from eigenvalues. y is linear in the
!> residuals of the rows, so that the contributions of the rows add up to the change of the velocities.
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
        !> Contribution of each row to the change of each entry of qd (m, n).
        real(wp), allocatable :: contribution(:, :)
        !> After inconsistent_start: the row with the largest violation, and its residual, also on its natural scale.
        integer :: failed_row = 0
        real(wp) :: failed_amount = 0.0_wp, failed_value = 0.0_wp
        integer, private :: m = 0
        !> True if K is the mass matrix.
        logical, private :: by_mass = .true.
        integer, allocatable, private :: free(:)
        real(wp), allocatable, private :: width(:), scale(:)
        real(wp), private :: tolerance = 0.0_wp
        !> C diag(width) for the free entries, with rows of unit length (m, free entries), and the lengths (m).
        real(wp), allocatable, private :: a(:, :), length(:)
        type(orthogonal_type), private :: rows
        !> Z (free entries, free entries - rank), (Z'KZ)^+ and Z'K (free entries - rank, free entries).
        real(wp), allocatable, private :: z(:, :), inverse(:, :), coupling(:, :)
    contains
        procedure :: initialize, find
        procedure, private :: factor, factor_mass, solve
    end type nearest_velocity_type

contains

    !> Allocate the work space.
    subroutine initialize(self, m, is_fixed, weight, scale, by_mass, tolerance)
        class(nearest_velocity_type), intent(inout) :: self
        !> Number of constraints.
        integer, intent(in) :: m
        !> True for fixed entries (n); positive weights and typical magnitudes of the coordinates (n).
        logical, intent(in) :: is_fixed(:)
        real(wp), intent(in) :: weight(:), scale(:)
        !> True for the mass matrix, false for the weights.
        logical, intent(in) :: by_mass
        !> Largest residual of a satisfied constraint, on its natural scale.
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
        if (allocated(self%contribution)) deallocate (self%contribution)
        allocate (self%contribution(m, size(scale)), source=0.0_wp)
    end subroutine initialize

    !> Replace qd by the nearest consistent velocity at (t, q). A consistent qd is not changed, not even by rounding. Statuses:
    !> inconsistent_start, callback_failed, not_evaluable, not_finite; qd is then unchanged.
    subroutine find(self, model, t, q, qd, counts, stat)
        class(nearest_velocity_type), intent(inout) :: self
        type(evaluator_type), intent(inout) :: model
        !> Time, coordinates (n), velocities (n).
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(inout) :: qd(:)
        type(counts_type), intent(inout) :: counts
        !> A status code.
        integer, intent(out) :: stat
        real(wp) :: violation(self%m), y(size(self%free)), residual(self%m), corrected(size(qd))
        integer :: i

        stat = status_ok
        if (self%m == 0) return
        ! Neither term depends on the velocity; q is passed in its place.
        call model%evaluate(need_jacobian + need_nu, t, q, q, counts, stat)
        if (stat /= status_ok) return
        associate (c => model%terms%jacobian, nu => model%terms%nu)
            if (.not. all(ieee_is_finite(c)) .or. .not. all(ieee_is_finite(nu))) then
                stat = status_not_finite
                model%failed_term = merge('jacobian    ', 'nu          ', .not. all(ieee_is_finite(c)))
                return
            end if
            corrected = qd
            call velocity_errors(nu, c, corrected, self%scale, self%failed_value, self%failed_row)
            if (self%failed_value <= self%tolerance) return
            call self%factor(c)
            if (self%by_mass) call self%factor_mass(model, t, q, counts, stat)
            if (stat /= status_ok) return
            violation = nu - matmul(c, corrected)
            do i = 1, self%m
                residual = 0.0_wp
                residual(i) = violation(i)/self%length(i)
                call self%solve(residual, y)
                self%contribution(i, self%free) = self%width*y
            end do
            ! Correct twice: the second correction removes the rounding errors of the first.
            do i = 1, 2
                call self%solve(violation/self%length, y)
                corrected(self%free) = corrected(self%free) + self%width*y
                violation = nu - matmul(c, corrected)
            end do
            call velocity_errors(nu, c, corrected, self%scale, self%failed_value, self%failed_row)
            if (self%failed_value <= self%tolerance) then
                qd = corrected
            else
                self%failed_amount = abs(violation(self%failed_row))
                stat = status_inconsistent_start
            end if
        end associate
    end subroutine find

    !> Factor the rows in the weighted norm, each scaled to unit length.
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

    !> Set (Z'KZ)^+ and Z'K for K = diag(width) M diag(width).
    subroutine factor_mass(self, model, t, q, counts, stat)
        class(nearest_velocity_type), intent(inout) :: self
        type(evaluator_type), intent(inout) :: model
        real(wp), intent(in) :: t, q(:)
        type(counts_type), intent(inout) :: counts
        integer, intent(out) :: stat
        !> Limit, relative to the largest eigenvalue, below which eigenvalues of a singular M are rounding errors.
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

    !> Change y of the free entries that removes given residuals, each divided by the length of its row (m).
    subroutine solve(self, violation, y)
        class(nearest_velocity_type), intent(in) :: self
        real(wp), intent(in) :: violation(:)
        real(wp), intent(out) :: y(:)

        call self%rows%solve(violation, y)
        if (self%by_mass) y = y - matmul(self%z, matmul(self%inverse, matmul(self%coupling, y)))
    end subroutine solve
end module tandem_simulate_nearest_velocity
