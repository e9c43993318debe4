! SPDX-License-Identifier: MIT
!> Measures for chart policies: the distance of a point from the chart's origin, the angles between the tangent spaces of both, and
!> the condition of the equations. Only the measures of the policy are allocated and computed.
module tandem_chart_dense_health
    use tandem_kinds, only: wp
    use tandem_linalg_basis, only: basis_type
    use tandem_linalg_lu, only: lu_type
    use tandem_options, only: options_type
    implicit none (type, external)
    private

    public :: watch_type, length_outside

    type :: watch_type
        !> True if |v|, |w|, the secants |D| and |Fbar|, and the condition are measured.
        logical :: v = .false., w = .false., secants = .false., condition = .false.
        integer, private :: nh = 0, m = 0
        !> Orthonormal basis at the point, cosines (m, m), [M D, C'] (n, n).
        type(basis_type), private :: basis
        real(wp), allocatable, private :: cosines(:, :), equations(:, :)
        type(lu_type), private :: lu
    contains
        procedure :: allocate => allocate_watch, measure_secants, condition_of
    end type watch_type

contains

    !> Allocate for n coordinates, nh holonomic and m constraints in all.
    subroutine allocate_watch(self, options, implicit, n, nh, m)
        class(watch_type), intent(inout) :: self
        type(options_type), intent(in) :: options
        !> True for implicit steps, whose errors grow with the secants on a chart that is kept too long. Explicit steps are watched
        !> if the paper's limits are off, and a chart would be kept until it fails.
        logical, intent(in) :: implicit
        integer, intent(in) :: n, nh, m

        self%nh = nh
        self%m = m
        self%v = options%chart == 'paper' .and. options%v_limit > 0.0_wp
        self%w = options%chart == 'paper' .and. options%w_limit > 0.0_wp
        self%condition = options%chart == 'paper' .and. options%condition_limit > 0.0_wp
        self%secants = (options%chart == 'adaptive' .or. (options%chart == 'paper' .and. &
            (implicit .or. .not. options%has_paper_limits()))) .and. m > 0
        if (allocated(self%cosines)) deallocate (self%cosines)
        if (allocated(self%equations)) deallocate (self%equations)
        if (self%secants) then
            call self%basis%allocate(n, nh, m, m)
            allocate (self%cosines(m, m), source=0.0_wp)
        end if
        if (self%condition) then
            allocate (self%equations(n, n), source=0.0_wp)
            call self%lu%allocate(n)
        end if
    end subroutine allocate_watch

    !> |D|_2 and |Fbar|_2: the singular values of Y' X are the cosines of the angles between range(C') here (Y) and at the origin
    !> (X); the singular values of the leading blocks correspond to Phi.
    subroutine measure_secants(self, jacobian, scale, origin, d, fbar)
        class(watch_type), intent(inout) :: self
        !> C (m, n) at the point, coordinate scales (n), X (n, m) at the origin, orthonormal.
        real(wp), intent(in) :: jacobian(:, :), scale(:), origin(:, :)
        real(wp), intent(out) :: d, fbar

        call self%basis%factor_qr(jacobian, scale, self%m)
        self%cosines = matmul(transpose(self%basis%q(:, :self%m)), origin)
        d = self%basis%largest_secant(self%cosines)
        fbar = self%basis%largest_secant(self%cosines(:self%nh, :self%nh))
    end subroutine measure_secants

    !> The condition number of [M D, C'], the matrix of (38) without its unit block; infinite if it is singular.
    subroutine condition_of(self, mass, null_space, jacobian, condition)
        class(watch_type), intent(inout) :: self
        !> M (n, n), D (n, n - m), C (m, n).
        real(wp), intent(in) :: mass(:, :), null_space(:, :), jacobian(:, :)
        real(wp), intent(out) :: condition
        real(wp) :: reciprocal
        integer :: k, stat

        k = size(null_space, 2)
        self%equations(:, :k) = matmul(mass, null_space)
        self%equations(:, k + 1:) = transpose(jacobian)
        call self%lu%factor(self%equations, stat)
        reciprocal = 0.0_wp
        if (stat == 0) reciprocal = self%lu%reciprocal_condition()
        condition = 1.0_wp/max(reciprocal, tiny(1.0_wp))
    end subroutine condition_of

    !> The length of a vector's part outside the span of orthonormal columns.
    pure real(wp) function length_outside(columns, vector)
        !> (n, any number), (n).
        real(wp), intent(in) :: columns(:, :), vector(:)
        real(wp) :: rest(size(vector))
        integer :: j

        rest = vector
        do j = 1, size(columns, 2)
            rest = rest - columns(:, j)*dot_product(columns(:, j), vector)
        end do
        length_outside = norm2(rest)
    end function length_outside
end module tandem_chart_dense_health
