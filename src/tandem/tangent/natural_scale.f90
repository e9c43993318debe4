! SPDX-License-Identifier: MIT
!> Constraint errors on the natural scale of each row: an error is small or large against the terms that cancel in its row.
!>
!> The scale of row i is sum_j |C_ij| |y_j| plus the modulus of its right side, with y = q, qd or qdd. Its floor replaces
!> |y_j| by the coordinate's typical magnitude s_j (for qd and qdd: s_j a unit of time, s_j a unit of time squared), so that a
!> mechanism at rest or at the origin has a scale too.
module tandem_tangent_natural_scale
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: position_errors, velocity_errors, acceleration_errors

contains

    !> max_i |Phi_i| / scale_i and its row.
    pure subroutine position_errors(phi, jacobian, q, scale, error, row)
        !> Phi (nh), C (m, n), q (n), coordinate scales (n).
        real(wp), intent(in), contiguous :: phi(:), jacobian(:, :), q(:), scale(:)
        real(wp), intent(out) :: error
        integer, intent(out) :: row
        real(wp) :: row_scale(size(phi)), magnitude
        integer :: i, j

        row_scale = 0.0_wp
        do j = 1, size(q)
            magnitude = max(abs(q(j)), scale(j))
            do i = 1, size(phi)
                row_scale(i) = row_scale(i) + abs(jacobian(i, j))*magnitude
            end do
        end do
        call find_worst(phi, row_scale, error, row)
    end subroutine position_errors

    !> max_i |C qd - nu|_i / scale_i and its row.
    pure subroutine velocity_errors(nu, jacobian, qd, scale, error, row)
        !> nu (m), C (m, n), qd (n), coordinate scales (n).
        real(wp), intent(in), contiguous :: nu(:), jacobian(:, :), qd(:), scale(:)
        real(wp), intent(out) :: error
        integer, intent(out) :: row
        real(wp) :: residual(size(nu)), row_scale(size(nu))

        residual = -nu
        call add_rows(jacobian, qd, scale, residual, row_scale)
        row_scale = row_scale + abs(nu)
        call find_worst(residual, row_scale, error, row)
    end subroutine velocity_errors

    !> max_i |C qdd + gamma|_i / scale_i and its row.
    pure subroutine acceleration_errors(gamma, jacobian, qdd, scale, error, row)
        !> gamma (m), C (m, n), qdd (n), coordinate scales (n).
        real(wp), intent(in), contiguous :: gamma(:), jacobian(:, :), qdd(:), scale(:)
        real(wp), intent(out) :: error
        integer, intent(out) :: row
        real(wp) :: residual(size(gamma)), row_scale(size(gamma))

        residual = gamma
        call add_rows(jacobian, qdd, scale, residual, row_scale)
        row_scale = row_scale + abs(gamma)
        call find_worst(residual, row_scale, error, row)
    end subroutine acceleration_errors

    !> residual := residual + C y and row_scale := |C| max(|y|, s).
    pure subroutine add_rows(jacobian, y, scale, residual, row_scale)
        real(wp), intent(in), contiguous :: jacobian(:, :), y(:), scale(:)
        real(wp), intent(inout) :: residual(:)
        real(wp), intent(out) :: row_scale(:)
        real(wp) :: magnitude
        integer :: i, j

        row_scale = 0.0_wp
        do j = 1, size(y)
            magnitude = max(abs(y(j)), scale(j))
            do i = 1, size(residual)
                residual(i) = residual(i) + jacobian(i, j)*y(j)
                row_scale(i) = row_scale(i) + abs(jacobian(i, j))*magnitude
            end do
        end do
    end subroutine add_rows

    !> The largest ratio and its row; a NaN counts as infinite, a zero row as its own scale.
    pure subroutine find_worst(residual, row_scale, error, row)
        real(wp), intent(in) :: residual(:), row_scale(:)
        real(wp), intent(out) :: error
        integer, intent(out) :: row
        real(wp) :: ratio
        integer :: i

        error = -1.0_wp
        row = 0
        do i = 1, size(residual)
            ratio = abs(residual(i))/max(row_scale(i), tiny(1.0_wp))
            if (.not. ratio <= huge(1.0_wp)) ratio = huge(1.0_wp)
            if (ratio <= error) cycle
            error = ratio
            row = i
        end do
    end subroutine find_worst
end module tandem_tangent_natural_scale
