! SPDX-License-Identifier: MIT
!> Velocities and accelerations of explicit steps, with R = [Cd^-1; 0] and D = [-Y; I] from an elimination of C. Same results as the
!> general `tandem_chart_dense_dynamics`, which documents the equations, in a small part of the time.
module tandem_chart_dense_free_motion
    use tandem_kinds, only: lane, short, wp
    use tandem_linalg_aligned, only: allocate_aligned
    use tandem_linalg_cholesky, only: cholesky_type
    use tandem_linalg_elimination, only: elimination_type, largest_small
    use tandem_linalg_independence, only: find_independence, independence_work_type
    use tandem_linalg_kernels, only: add_product, is_finite
    use tandem_linalg_lu, only: lu_type
    use tandem_linalg_null_space_few, only: find_few, most_few
    use tandem_linalg_null_space_kernels, only: add_pivots, finish, multiply, multiply_by_transpose, multiply_mass, scale_columns, &
        transpose_basis
    use tandem_linalg_products, only: find_inverse_trace, multiply_large_by_transpose => multiply_by_transpose, multiply_by_block, &
        multiply_rows_by_themselves
    use tandem_linalg_small, only: factor_definite, solve_near_diagonal, substitute
    use tandem_pack, only: pack_type
    use tandem_status, only: status_chart_left, status_not_finite, status_ok, status_singular_mass
    implicit none (type, external)
    private

    public :: free_motion_type

    type :: free_motion_type
        private
        !> n coordinates, m constraints, k = n - m degrees of freedom; height and width are m and k padded.
        integer :: n = 0, m = 0, k = 0, height = 0, width = 0
        !> The choice of pivots to which D belongs.
        integer :: choice = -1
        !> The choice of pivots at the chart's origin.
        integer :: origin_choice = -1
        !> D' at the current point and D0' M0 at the origin (width, n), diag(s)^2 and diag(s)^-2 (n).
        real(wp), allocatable :: basis(:, :), origin(:, :), square(:), inverse_square(:)
        !> D' M (width, n), D' M D or D0' M0 D with factors in place (width, width), inverse pivots (k).
        real(wp), allocatable :: basis_mass(:, :), matrix(:, :), inverse(:)
        !> The factors of D0' M0 D if it requires a search for pivots.
        type(lu_type) :: overlap_lu
        !> Vectors over the degrees of freedom (width), over the rows of C (height), over the coordinates (n).
        real(wp), allocatable :: z(:), r(:), x(:), work(:)
        type(independence_work_type) :: independence
        !> True if the loops for few degrees of freedom apply to this size.
        logical :: has_few = .false.
        !> True if LAPACK and BLAS replace loops, with the factor of D' M D.
        logical :: is_large = .false.
        type(cholesky_type) :: mass_factor
    contains
        procedure :: allocate => allocate_reduced, load, set_origin
        procedure :: find_independence => find_independence_here, restore_velocity, solve, pack_state
        procedure, private :: project, polish
    end type free_motion_type

contains

    !> Allocate for m constraints of n coordinates.
    subroutine allocate_reduced(self, m, n, scale)
        class(free_motion_type), intent(inout) :: self
        integer, intent(in) :: m, n
        !> Coordinate scales (n).
        real(wp), intent(in) :: scale(:)

        self%n = n
        self%m = m
        self%k = n - m
        self%choice = -1
        self%origin_choice = -1
        self%height = lane*((m + lane - 1)/lane)
        self%width = short*((n - m + short - 1)/short)
        self%square = scale**2
        self%inverse_square = 1.0_wp/self%square
        self%is_large = max(m, n - m) > largest_small
        self%has_few = m > 0 .and. m <= lane .and. n > m .and. n - m <= most_few
        if (allocated(self%inverse)) deallocate (self%inverse, self%work, self%independence%gram)
        associate (k => self%k, height => self%height, width => self%width, work => self%independence)
            call allocate_aligned(self%basis, width, n)
            call allocate_aligned(self%origin, width, n)
            call allocate_aligned(self%basis_mass, width, n)
            call allocate_aligned(self%matrix, width, width)
            call allocate_aligned(self%z, width)
            call allocate_aligned(self%r, height)
            call allocate_aligned(self%x, height)
            allocate (self%inverse(k), self%work(n), source=0.0_wp)
            call self%overlap_lu%allocate(k)
            if (self%is_large) call self%mass_factor%allocate(k)
            ! For many rows the scaled rows of C and their Gram matrix.
            call allocate_aligned(work%part, merge(height, width, self%is_large), n)
            allocate (work%gram(merge(m, width, self%is_large), merge(m, k, self%is_large)), source=0.0_wp)
            work%inverse = self%inverse
            work%r = self%r
            work%column = self%z
        end associate
    end subroutine allocate_reduced

    !> Copy D from an elimination of C at the point of the following calls.
    subroutine load(self, elimination)
        class(free_motion_type), intent(inout) :: self
        type(elimination_type), intent(in) :: elimination

        call transpose_basis(self%m, self%n, self%height, self%width, elimination%order, elimination%choice /= self%choice, &
            elimination%eliminated, self%basis)
        self%choice = elimination%choice
    end subroutine load

    !> Make the point the chart's origin: restoring a velocity preserves D0' M0 qd.
    subroutine set_origin(self, blocks, mass)
        class(free_motion_type), intent(inout) :: self
        !> As for `solve`; M0 is diag(s)^-2 without a mass.
        integer, intent(in), contiguous :: blocks(:)
        real(wp), intent(in), optional :: mass(self%n, self%n)

        if (present(mass)) then
            call set_product(self%is_large, self%n, self%width, blocks, self%basis, mass, self%origin)
        else
            call scale_columns(self%n, self%width, self%basis, self%inverse_square, self%origin)
        end if
        self%origin_choice = self%choice
    end subroutine set_origin

    !> Independence of the rows of C: 1/|C+|, in the Frobenius norm, of C with rows of unit length in scaled unknowns. A lower bound
    !> of its smallest singular value, at most sqrt(m) below, that does not depend on the choice of pivots. With many rows |C+|^2 is
    !> the trace of the inverse of their Gram matrix; 0 if this matrix is singular up to rounding, for an independence of less than
    !> about 1e-8.
    subroutine find_independence_here(self, elimination, independence)
        class(free_motion_type), intent(inout) :: self
        type(elimination_type), intent(in) :: elimination
        real(wp), intent(out) :: independence
        real(wp) :: trace
        integer :: j, stat

        independence = 1.0_wp
        if (self%m == 0) return
        if (.not. self%is_large) then
            call find_independence(elimination, self%k, self%width, self%square, self%inverse_square, self%basis, &
                self%independence, independence)
            return
        end if
        associate (rows => self%independence%part, gram => self%independence%gram)
            do j = 1, self%n
                rows(:, j) = elimination%matrix(:, j)*sqrt(self%square(j))
            end do
            call multiply_rows_by_themselves(rows, gram)
            call find_inverse_trace(gram, trace, stat)
        end associate
        independence = 0.0_wp
        if (stat == 0 .and. trace > 0.0_wp .and. trace <= huge(1.0_wp)) independence = 1.0_wp/sqrt(trace)
    end subroutine find_independence_here

    !> qd = R nu + D z with D0' M0 (qd - qd_wanted) = 0.
    subroutine restore_velocity(self, elimination, has_nu, polishes, nu, qd, stat)
        class(free_motion_type), intent(inout) :: self
        type(elimination_type), intent(in) :: elimination
        !> True if nu is not zero; true to remove rounding errors of C qd - nu.
        logical, intent(in) :: has_nu, polishes
        !> nu (m).
        real(wp), intent(in) :: nu(self%m)
        !> The wanted velocity qd0 + eta (n), then the one with C qd = nu.
        real(wp), intent(inout) :: qd(self%n)
        !> A status code.
        integer, intent(out) :: stat
        logical :: is_near
        integer :: i

        ! With the pivots of the origin D0' M0 D is near D' M D. With other pivots it is not, and in a symmetric motion the rounding
        ! error of a zero on the diagonal may be the only value to which its pivot is compared.
        is_near = self%choice == self%origin_choice
        stat = 1
        associate (m => self%m, n => self%n, k => self%k, e => elimination)
            ! The general method has smaller rounding errors, for the ends of steps.
            if (self%has_few .and. is_near .and. .not. polishes) call find_few(e, self%origin, self%origin, self%basis, &
                merge(1.0_wp, 0.0_wp, has_nu), nu, qd, stat)
            if (stat /= 0) then
                self%r(:) = 0.0_wp
                self%work(:) = qd
                if (has_nu) then
                    call e%solve(nu, self%r)
                    do i = 1, m
                        self%work(e%order(i)) = self%work(e%order(i)) - self%r(i)
                    end do
                end if
                call self%project(self%origin, self%basis, self%origin, self%work)
                if (is_near .and. .not. self%is_large) then
                    call solve_near_diagonal(k, self%width, self%matrix, self%z, stat)
                    if (stat /= 0) call self%project(self%origin, self%basis, self%origin, self%work)
                end if
                if (stat /= 0) then
                    ! D0' M0 D requires a search for pivots.
                    call self%overlap_lu%factor(self%matrix(:k, :k), stat)
                    stat = merge(status_ok, status_chart_left, stat == 0)
                    if (stat /= status_ok) return
                    call self%overlap_lu%solve(self%z(:k))
                end if
                call finish(1.0_wp, m, n, self%height, e%order, e%eliminated, self%z, self%r, qd)
            end if
            if (polishes) call self%polish(e, nu, -1.0_wp, qd)
        end associate
    end subroutine restore_velocity

    !> The acceleration at the point of `load`.
    subroutine solve(self, elimination, polishes, blocks, mass, gamma, force, qdd, stat)
        class(free_motion_type), intent(inout) :: self
        type(elimination_type), intent(in) :: elimination
        !> True to remove rounding errors of C qdd + gamma.
        logical, intent(in) :: polishes
        !> First and last coordinates of the diagonal blocks of M with more than one entry, see `tandem_model_evaluator`.
        integer, intent(in), contiguous :: blocks(:)
        !> M (n, n), gamma (m), S + Q_A (n).
        real(wp), intent(in) :: mass(self%n, self%n), gamma(self%m), force(self%n)
        real(wp), intent(out) :: qdd(self%n)
        !> A status code.
        integer, intent(out) :: stat

        associate (m => self%m, n => self%n, k => self%k, e => elimination)
            call set_product(self%is_large, n, self%width, blocks, self%basis, mass, self%basis_mass)
            if (self%has_few) then
                qdd(:) = force
                call find_few(e, self%basis_mass, self%basis, self%basis, -1.0_wp, gamma, qdd, stat)
            else
                call self%project(self%basis_mass, self%basis, self%basis, force)
                if (self%is_large) then
                    call self%mass_factor%factor(self%matrix(:k, :k), stat)
                else
                    call factor_definite(k, self%width, self%matrix, self%inverse, stat)
                end if
                if (stat == 0) then
                    ! D' (S + Q_A + M R gamma), where R has nonzero rows for pivots only.
                    call e%solve(gamma, self%r)
                    call add_pivots(m, n, self%width, e%order, self%basis_mass, self%r, self%z)
                    if (self%is_large) then
                        call self%mass_factor%solve(self%z(:k))
                    else
                        call substitute(k, self%width, self%matrix, self%inverse, self%z)
                    end if
                    call finish(-1.0_wp, m, n, self%height, e%order, e%eliminated, self%z, self%r, qdd)
                    if (.not. is_finite(n, qdd)) stat = -1
                end if
            end if
            if (stat == 0) then
                if (polishes) call self%polish(e, gamma, 1.0_wp, qdd)
            else
                stat = merge(status_singular_mass, status_not_finite, stat > 0)
            end if
        end associate
    end subroutine solve

    !> D' M.
    subroutine set_product(is_large, n, width, blocks, basis, mass, basis_mass)
        logical, intent(in) :: is_large
        integer, intent(in) :: n, width
        integer, intent(in), contiguous :: blocks(:)
        real(wp), intent(in) :: basis(width, n), mass(n, n)
        real(wp), intent(inout) :: basis_mass(width, n)
        integer :: i

        if (.not. is_large) then
            call multiply_mass(n, width, size(blocks)/2, blocks, basis, mass, basis_mass)
        else if (width > 0) then
            do i = 1, n
                basis_mass(:, i) = basis(:, i)*mass(i, i)
            end do
            do i = 1, size(blocks), 2
                call multiply_by_block(width, n, blocks(i), blocks(i + 1), basis, mass, basis_mass)
            end do
        end if
    end subroutine set_product

    !> Set `matrix` to A B' and z to C x.
    subroutine project(self, a, b, c, x)
        class(free_motion_type), intent(inout) :: self
        real(wp), intent(in), contiguous :: a(:, :), b(:, :), c(:, :), x(:)

        if (.not. self%is_large) then
            call multiply_by_transpose(self%width, self%n, a, b, c, x, self%matrix, self%z)
        else if (self%k > 0) then
            call multiply_large_by_transpose(a, b, self%matrix)
            self%z(:) = 0.0_wp
            call add_product(c, x, 1.0_wp, self%z)
        end if
    end subroutine project

    !> Remove the rounding error of C y + sign g = 0 from y.
    subroutine polish(self, elimination, g, sign, y)
        class(free_motion_type), intent(inout) :: self
        type(elimination_type), intent(in) :: elimination
        real(wp), intent(in) :: g(self%m), sign
        real(wp), intent(inout) :: y(self%n)
        integer :: i

        associate (e => elimination)
            call multiply(self%height, self%n, e%matrix, y, self%x)
            do i = 1, self%m
                self%x(i) = self%x(i) + sign*g(i)
            end do
            call e%solve(self%x, self%r)
            do i = 1, self%m
                y(e%order(i)) = y(e%order(i)) - self%r(i)
            end do
        end associate
    end subroutine polish

    !> D at the current point and at the origin.
    subroutine pack_state(self, pack)
        class(free_motion_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%basis, self%origin)
        call pack%item(self%choice, self%origin_choice)
    end subroutine pack_state
end module tandem_chart_dense_free_motion
