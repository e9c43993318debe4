! SPDX-License-Identifier: MIT
!> Velocities and accelerations of explicit steps, with R = [Cd^-1; 0] and D = [-Y; I] from an elimination of C. Same results as the
!> general `tandem_chart_dense_dynamics`, which documents the equations, in a small part of the time.
module tandem_chart_dense_free_motion
    use tandem_kinds, only: lane, short, wp
    use tandem_linalg_aligned, only: allocate_aligned
    use tandem_linalg_cholesky, only: cholesky_type
    use tandem_linalg_elimination, only: elimination_type, largest_small
    use tandem_linalg_kernels, only: is_finite
    use tandem_linalg_lu, only: lu_type
    use tandem_pack, only: pack_type
    use tandem_status, only: status_chart_left, status_not_finite, status_ok, status_singular_mass
    use tandem_linalg_null_space_few, only: can_be_few, find_few_acceleration, find_few_velocity
    use tandem_linalg_independence, only: find_independence
    use tandem_linalg_null_space_large, only: find_large_acceleration, find_large_independence, find_large_velocity
    use tandem_linalg_null_space_kernels, only: find_acceleration, find_velocity, finish, multiply_mass, polish, &
        scale_columns, set_overlap, transpose_basis
    use tandem_linalg_null_space_single, only: find_single_acceleration, find_single_velocity
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
        !> The identity, for the rows of D that belong to the free unknowns.
        real(wp) :: unit(short, short) = reshape([1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, &
            1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 1.0_wp], [short, short])
        !> True if the loops for two or three degrees of freedom apply to this size.
        logical :: has_few = .false.
        !> True if LAPACK and BLAS are used, with the following arrays: coordinate scales (n), scaled rows of C (height, n), their
        !> Gram matrix (m, m), the factor of D' M D.
        logical :: is_large = .false.
        real(wp), allocatable :: scale(:), rows(:, :), gram(:, :)
        type(cholesky_type) :: mass_factor
    contains
        procedure :: allocate => allocate_reduced, load, set_origin
        procedure :: find_independence => find_independence_here, restore_velocity, solve, pack_state
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
        if (allocated(self%inverse)) deallocate (self%inverse, self%work)
        associate (k => self%k, height => self%height, width => self%width)
            call allocate_aligned(self%basis, width, n)
            call allocate_aligned(self%origin, width, n)
            call allocate_aligned(self%basis_mass, width, n)
            call allocate_aligned(self%matrix, width, width)
            call allocate_aligned(self%z, width)
            call allocate_aligned(self%r, height)
            call allocate_aligned(self%x, height)
            allocate (self%inverse(k), self%work(n), source=0.0_wp)
            call self%overlap_lu%allocate(k)
            self%is_large = max(m, k) > largest_small
            self%has_few = can_be_few(m, k)
            if (allocated(self%rows)) deallocate (self%scale, self%rows, self%gram)
            if (.not. self%is_large) return
            allocate (self%scale, source=scale)
            allocate (self%rows(height, n), self%gram(m, m), source=0.0_wp)
            call self%mass_factor%allocate(k)
        end associate
    end subroutine allocate_reduced

    !> Copy D from an elimination of C at the point of the following calls.
    subroutine load(self, elimination)
        class(free_motion_type), intent(inout) :: self
        type(elimination_type), intent(in) :: elimination

        call transpose_basis(self%m, self%n, self%k, self%height, self%width, elimination%order, &
            elimination%choice /= self%choice, self%unit, elimination%eliminated, self%basis)
        self%choice = elimination%choice
    end subroutine load

    !> Make the point the chart's origin: restoring a velocity preserves D0' M0 qd.
    subroutine set_origin(self, n_blocks, blocks, mass)
        class(free_motion_type), intent(inout) :: self
        !> As for `solve`; M0 is diag(s)^-2 without a mass.
        integer, intent(in) :: n_blocks, blocks(2, n_blocks)
        real(wp), intent(in), optional :: mass(self%n, self%n)

        if (present(mass)) then
            call multiply_mass(self%n, self%width, n_blocks, blocks, self%basis, mass, self%origin)
        else
            call scale_columns(self%n, self%width, self%basis, self%inverse_square, self%origin)
        end if
        self%origin_choice = self%choice
    end subroutine set_origin

    !> Independence of the rows of C: 1/|C+|, in the Frobenius norm, of C with rows of unit length in scaled unknowns. A lower bound
    !> of its smallest singular value, at most sqrt(m) below, that does not depend on the choice of pivots.
    subroutine find_independence_here(self, elimination, independence)
        class(free_motion_type), intent(inout) :: self
        type(elimination_type), intent(in) :: elimination
        real(wp), intent(out) :: independence

        independence = 1.0_wp
        if (self%m == 0) return
        if (self%is_large) then
            call find_large_independence(elimination, self%scale, self%rows, self%gram, independence)
            return
        end if
        associate (e => elimination)
            call find_independence(self%m, self%n, self%k, self%height, self%width, e%order, self%square, self%inverse_square, &
                e%matrix, e%eliminated, self%basis, self%matrix, self%inverse, self%basis_mass, self%r, self%z, independence)
        end associate
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
        integer :: i

        if (self%is_large) then
            call find_large_velocity(elimination, self%basis, self%origin, has_nu, polishes, nu, self%matrix(:, :self%k), &
                self%overlap_lu, self%z, self%r, self%x, self%work, qd, stat)
            stat = merge(status_ok, status_chart_left, stat == 0)
            return
        end if
        associate (m => self%m, n => self%n, k => self%k, e => elimination)
            ! The end of a step uses the general method, which also removes rounding errors.
            if (k == 1 .and. .not. polishes) then
                call find_single_velocity(m, n, self%height, self%width, e%order, e%eliminated, self%basis, self%origin, has_nu, &
                    nu, self%r, qd, stat)
                stat = merge(status_ok, status_chart_left, stat == 0)
                return
            end if
            stat = 1
            ! With the pivots of the origin D0' M0 D is near D' M D. With other pivots it is not, and in a symmetric motion the
            ! rounding error of a zero on the diagonal may be the only value to which its pivot is compared.
            if (self%choice == self%origin_choice) then
                if (self%has_few .and. .not. polishes) call find_few_velocity(m, n, e%order, e%eliminated, self%basis, &
                    self%origin, has_nu, nu, qd, stat)
                if (stat == 0) return
                call find_velocity(m, n, k, self%height, self%width, e%order, e%matrix, e%eliminated, self%basis, self%origin, &
                    has_nu, polishes, nu, self%matrix, self%z, self%r, self%x, self%work, qd, stat)
                if (stat == 0) return
            else
                self%r(:) = 0.0_wp
                self%work(:) = qd
                if (has_nu) then
                    do i = 1, m
                        self%r(:) = self%r + e%eliminated(:, i)*nu(i)
                    end do
                    do i = 1, m
                        self%work(e%order(i)) = self%work(e%order(i)) - self%r(i)
                    end do
                end if
            end if
            ! D0' M0 D requires a search for pivots.
            call set_overlap(n, self%width, self%basis, self%origin, self%work, self%matrix, self%z)
            call self%overlap_lu%factor(self%matrix(:k, :k), stat)
            stat = merge(status_ok, status_chart_left, stat == 0)
            if (stat /= status_ok) return
            call self%overlap_lu%solve(self%z(:k))
            call finish(m, n, k, self%height, e%order, e%matrix, e%eliminated, polishes, nu, -1.0_wp, self%z, self%r, &
                self%x, qd)
        end associate
    end subroutine restore_velocity

    !> The acceleration at the point of `load`.
    subroutine solve(self, elimination, polishes, n_blocks, blocks, mass, gamma, force, qdd, stat)
        class(free_motion_type), intent(inout) :: self
        type(elimination_type), intent(in) :: elimination
        !> True to remove rounding errors of C qdd + gamma.
        logical, intent(in) :: polishes
        !> The diagonal blocks of M with more than one entry, see `tandem_model_evaluator`.
        integer, intent(in) :: n_blocks, blocks(2, n_blocks)
        !> M (n, n), gamma (m), S + Q_A (n).
        real(wp), intent(in) :: mass(self%n, self%n), gamma(self%m), force(self%n)
        real(wp), intent(out) :: qdd(self%n)
        !> A status code.
        integer, intent(out) :: stat

        associate (e => elimination)
            if (self%is_large) then
                call find_large_acceleration(e, self%basis, polishes, n_blocks, blocks, mass, gamma, force, self%basis_mass, &
                    self%matrix(:, :self%k), self%mass_factor, self%z, self%r, self%x, qdd, stat)
            else if (self%k == 1 .and. .not. polishes) then
                call find_single_acceleration(self%m, self%n, self%height, self%width, e%order, e%eliminated, self%basis, &
                    n_blocks, blocks, mass, gamma, force, self%basis_mass, self%r, qdd, stat)
            else if (self%has_few) then
                call find_few_acceleration(self%m, self%n, e%order, e%eliminated, self%basis, n_blocks, blocks, mass, gamma, &
                    force, self%basis_mass, qdd, stat)
                if (stat == 0 .and. polishes) call polish(self%m, self%n, self%height, e%order, e%matrix, e%eliminated, gamma, &
                    1.0_wp, self%r, self%x, qdd)
            else
                call multiply_mass(self%n, self%width, n_blocks, blocks, self%basis, mass, self%basis_mass)
                call find_acceleration(self%m, self%n, self%k, self%height, self%width, e%order, e%matrix, e%eliminated, &
                    self%basis, self%basis_mass, polishes, gamma, force, self%matrix, self%inverse, self%z, self%r, self%x, qdd, &
                    stat)
            end if
        end associate
        if (stat == 0 .and. (self%k == 0 .or. self%is_large)) then
            if (.not. is_finite(self%n, qdd)) stat = -1
        end if
        if (stat > 0) then
            stat = status_singular_mass
        else if (stat < 0) then
            stat = status_not_finite
        end if
    end subroutine solve

    !> D at the current point and at the origin.
    subroutine pack_state(self, pack)
        class(free_motion_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%basis, self%origin)
        call pack%item(self%choice, self%origin_choice)
    end subroutine pack_state
end module tandem_chart_dense_free_motion
