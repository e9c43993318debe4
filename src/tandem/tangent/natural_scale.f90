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

    !> Rows are taken so many at a time: no work space, and inner loops of constant length.
    integer, parameter :: lane = 8

contains

    !> max_i |Phi_i| / scale_i and its row.
    pure subroutine position_errors(phi, jacobian, q, scale, error, row)
        !> Phi (nh), C (m, n), q (n), coordinate scales (n).
        real(wp), intent(in), contiguous :: phi(:), jacobian(:, :), q(:), scale(:)
        real(wp), intent(out) :: error
        integer, intent(out) :: row

        call find_worst(size(phi), size(jacobian, 1), size(q), .false., 0.0_wp, phi, jacobian, q, scale, error, row)
    end subroutine position_errors

    !> max_i |C qd - nu|_i / scale_i and its row.
    pure subroutine velocity_errors(nu, jacobian, qd, scale, error, row)
        !> nu (m), C (m, n), qd (n), coordinate scales (n).
        real(wp), intent(in), contiguous :: nu(:), jacobian(:, :), qd(:), scale(:)
        real(wp), intent(out) :: error
        integer, intent(out) :: row

        call find_worst(size(nu), size(nu), size(qd), .true., -1.0_wp, nu, jacobian, qd, scale, error, row)
    end subroutine velocity_errors

    !> max_i |C qdd + gamma|_i / scale_i and its row.
    pure subroutine acceleration_errors(gamma, jacobian, qdd, scale, error, row)
        !> gamma (m), C (m, n), qdd (n), coordinate scales (n).
        real(wp), intent(in), contiguous :: gamma(:), jacobian(:, :), qdd(:), scale(:)
        real(wp), intent(out) :: error
        integer, intent(out) :: row

        call find_worst(size(gamma), size(gamma), size(qdd), .true., 1.0_wp, gamma, jacobian, qdd, scale, error, row)
    end subroutine acceleration_errors

    !> The largest |residual|/scale and its row; a NaN counts as infinite, a zero row as its own scale. The residual of row i is
    !> g_i, or (C y + sign g)_i, whose scale |g_i| belongs to.
    pure subroutine find_worst(l, m, n, is_linear, sign, g, c, y, scale, error, row)
        !> Rows to look at, the first of the m rows of C.
        integer, intent(in) :: l, m, n
        logical, intent(in) :: is_linear
        real(wp), intent(in) :: sign, g(l), c(m*n), y(n), scale(n)
        real(wp), intent(out) :: error
        integer, intent(out) :: row
        real(wp) :: residual(lane), row_scale(lane), magnitude, ratio
        integer :: b, first, i, j, last

        error = -1.0_wp
        row = 0
        do b = 0, l - 1, lane
            residual = 0.0_wp
            row_scale = 0.0_wp
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do j = 1, n
                magnitude = max(abs(y(j)), scale(j))
                first = (j - 1)*m + b
                ! Rows behind the last one are computed in vain where memory has them, and not looked at.
                if (first + lane <= m*n) then
                    !GCC$ UNROLL 1
                    do i = 1, lane
                        residual(i) = residual(i) + c(first + i)*y(j)
                        row_scale(i) = row_scale(i) + abs(c(first + i))*magnitude
                    end do
                else
                    do i = 1, min(lane, l - b)
                        residual(i) = residual(i) + c(first + i)*y(j)
                        row_scale(i) = row_scale(i) + abs(c(first + i))*magnitude
                    end do
                end if
            end do
            last = min(lane, l - b)
            do i = 1, last
                if (is_linear) then
                    residual(i) = residual(i) + sign*g(b + i)
                    row_scale(i) = row_scale(i) + abs(g(b + i))
                else
                    residual(i) = g(b + i)
                end if
                ratio = abs(residual(i))/max(row_scale(i), tiny(1.0_wp))
                if (.not. ratio <= huge(1.0_wp)) ratio = huge(1.0_wp)
                if (ratio <= error) cycle
                error = ratio
                row = b + i
            end do
        end do
    end subroutine find_worst
end module tandem_tangent_natural_scale
