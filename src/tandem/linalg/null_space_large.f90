! SPDX-License-Identifier: MIT
!> Explicit steps for a C with many rows or mechanisms with many degrees of freedom: LAPACK and BLAS in place of the loops of
!> `tandem_linalg_null_space_kernels`, `tandem_linalg_independence` and `tandem_linalg_gram`.
module tandem_linalg_null_space_large
    use tandem_kinds, only: wp
    use tandem_linalg_cholesky, only: cholesky_type
    use tandem_linalg_elimination, only: elimination_type
    use tandem_linalg_kernels, only: add_product
    use tandem_linalg_lu, only: lu_type
    use tandem_linalg_products, only: find_inverse_trace, invert_definite, multiply_by_block, multiply_by_transpose, &
        multiply_first, multiply_rows_by_themselves
    use tandem_linalg_gram, only: set_row_weight, smallest_gram_pivot
    implicit none (type, external)
    private

    public :: find_large_velocity, find_large_acceleration, find_large_independence, invert_large_gram

contains

    !> qd = R nu + D z with D0' M0 (qd - qd_wanted) = 0. stat > 0: D0' M0 D is singular.
    subroutine find_large_velocity(elimination, basis, origin, has_nu, polishes, nu, overlap, factors, z, r, x, wanted, qd, stat)
        type(elimination_type), intent(in) :: elimination
        !> D', D0' M0 (width, n).
        real(wp), intent(in), contiguous :: basis(:, :), origin(:, :)
        !> True if nu is not zero; true to remove the rounding error of C qd - nu.
        logical, intent(in) :: has_nu, polishes
        !> nu (m).
        real(wp), intent(in), contiguous :: nu(:)
        !> Work space: D0' M0 D (width, k) and its factors; over the degrees of freedom (width), the rows of C (height), the
        !> coordinates (n).
        real(wp), intent(inout), contiguous :: overlap(:, :), z(:), r(:), x(:), wanted(:)
        type(lu_type), intent(inout) :: factors
        !> On entry the wanted velocity, on return the velocity (n).
        real(wp), intent(inout), contiguous :: qd(:)
        integer, intent(out) :: stat
        integer :: i, p

        associate (e => elimination, k => size(overlap, 2))
            wanted(:) = qd
            r(:) = 0.0_wp
            if (has_nu) then
                call e%solve(nu, r)
                do i = 1, e%m
                    p = e%order(i)
                    wanted(p) = wanted(p) - r(i)
                end do
            end if
            z(:) = 0.0_wp
            call add_product(origin, wanted, 1.0_wp, z)
            if (k > 0) call multiply_by_transpose(origin, basis, overlap)
            call factors%factor(overlap(:k, :), stat)
            if (stat /= 0) return
            call factors%solve(z(:k))
            call finish(e, polishes, nu, -1.0_wp, z(:k), r, x, qd)
        end associate
    end subroutine find_large_velocity

    !> qdd = D w - R gamma with D' (M qdd - S - Q_A) = 0. stat > 0: D' M D is not positive definite.
    subroutine find_large_acceleration(elimination, basis, polishes, n_blocks, blocks, mass, gamma, force, basis_mass, &
        reduced_mass, factor, z, r, x, qdd, stat)
        type(elimination_type), intent(in) :: elimination
        !> D' (width, n).
        real(wp), intent(in), contiguous :: basis(:, :)
        !> True to remove the rounding error of C qdd + gamma.
        logical, intent(in) :: polishes
        !> The diagonal blocks of M with more than one entry, see `tandem_model_evaluator`.
        integer, intent(in) :: n_blocks, blocks(2, n_blocks)
        !> M (n, n), gamma (m), S + Q_A (n).
        real(wp), intent(in), contiguous :: mass(:, :), gamma(:), force(:)
        !> Work space: D' M (width, n), D' M D (width, k) and its factor; over the degrees of freedom (width), the rows of C
        !> (height).
        real(wp), intent(inout), contiguous :: basis_mass(:, :), reduced_mass(:, :), z(:), r(:), x(:)
        type(cholesky_type), intent(inout) :: factor
        !> The acceleration (n).
        real(wp), intent(out), contiguous :: qdd(:)
        integer, intent(out) :: stat
        integer :: i

        associate (e => elimination, k => size(reduced_mass, 2))
            ! Without degrees of freedom there are no products.
            if (k > 0) then
                do i = 1, e%n
                    basis_mass(:, i) = basis(:, i)*mass(i, i)
                end do
                do i = 1, n_blocks
                    call multiply_by_block(size(basis, 1), e%n, blocks(1, i), blocks(2, i), basis, mass, basis_mass)
                end do
                call multiply_by_transpose(basis_mass, basis, reduced_mass)
            end if
            call factor%factor(reduced_mass(:k, :), stat)
            if (stat /= 0) return
            call e%solve(gamma, r)
            r(:) = -r
            qdd(:) = 0.0_wp
            do i = 1, e%m
                qdd(e%order(i)) = r(i)
            end do
            z(:) = 0.0_wp
            call add_product(basis, force, 1.0_wp, z)
            call add_product(basis_mass, qdd, -1.0_wp, z)
            call factor%solve(z(:k))
            call finish(e, polishes, gamma, 1.0_wp, z(:k), r, x, qdd)
        end associate
    end subroutine find_large_acceleration

    !> y := r + D z, r given by its rows of pivots, and with `polishes` minus the rounding error of C y + sign g = 0.
    subroutine finish(elimination, polishes, g, sign, z, r, x, y)
        type(elimination_type), intent(in) :: elimination
        logical, intent(in) :: polishes
        real(wp), intent(in), contiguous :: g(:), z(:)
        real(wp), intent(in) :: sign
        real(wp), intent(inout), contiguous :: r(:), x(:), y(:)
        integer :: i, p

        associate (e => elimination)
            call add_product(e%eliminated(:, e%m + 1:), z, -1.0_wp, r)
            do i = 1, e%m
                y(e%order(i)) = r(i)
            end do
            do i = e%m + 1, e%n
                y(e%order(i)) = z(i - e%m)
            end do
            if (.not. polishes) return
            x(:) = 0.0_wp
            call add_product(e%matrix, y, 1.0_wp, x)
            do i = 1, e%m
                x(i) = x(i) + sign*g(i)
            end do
            call e%solve(x(:e%m), r)
            do i = 1, e%m
                p = e%order(i)
                y(p) = y(p) - r(i)
            end do
        end associate
    end subroutine finish

    !> 1/|C+|, rows of unit length, scaled unknowns: |C+|^2 is the trace of the inverse of the rows' Gram matrix. 0 if this matrix
    !> is singular up to rounding, for an independence of less than about 1e-8.
    subroutine find_large_independence(elimination, scale, rows, gram, independence)
        type(elimination_type), intent(in) :: elimination
        !> Coordinate scales (n).
        real(wp), intent(in), contiguous :: scale(:)
        !> Work space (height, n), (m, m).
        real(wp), intent(inout), contiguous :: rows(:, :), gram(:, :)
        real(wp), intent(out) :: independence
        real(wp) :: trace
        integer :: j, stat

        do j = 1, size(scale)
            rows(:, j) = elimination%matrix(:, j)*scale(j)
        end do
        call multiply_rows_by_themselves(rows, gram)
        call find_inverse_trace(gram, trace, stat)
        independence = 0.0_wp
        if (stat == 0 .and. trace > 0.0_wp .and. trace <= huge(1.0_wp)) independence = 1.0_wp/sqrt(trace)
    end subroutine find_large_independence

    !> U = S Phi_q', S = diag(s)^2, (Phi_q U)^-1, and weights of the rows of Phi.
    subroutine invert_large_gram(nh, c, q, scale, u, gram, weight, diagonal, can)
        integer, intent(in) :: nh
        !> C (height, n), q, coordinate scales (n).
        real(wp), intent(in), contiguous :: c(:, :), q(:), scale(:)
        !> U (n, width), inverse of Phi_q U (width, width), weights of the rows, work space (width).
        real(wp), intent(inout), contiguous :: u(:, :), gram(:, :), weight(:), diagonal(:)
        !> False if the rows of Phi_q are nearly dependent.
        logical, intent(out) :: can
        integer :: i, j

        call set_row_weight(size(c, 1), size(c, 2), nh, c, q, scale, weight)
        do i = 1, nh
            do j = 1, size(c, 2)
                u(j, i) = scale(j)**2*c(i, j)
            end do
        end do
        call multiply_first(nh, c, u, gram)
        call invert_definite(nh, smallest_gram_pivot, gram, diagonal, can)
    end subroutine invert_large_gram
end module tandem_linalg_null_space_large
