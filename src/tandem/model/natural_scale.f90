! SPDX-License-Identifier: MIT
!> Constraint errors on the natural scale of each row: an error is divided by the size of the terms that cancel in its row.
!>
!> The scale of row i is sum_j |C_ij| |y_j| plus the absolute value of its right-hand side, with y = q, qd or qdd. Here |y_j| is at
!> least the typical magnitude s_j of the coordinate (for qd and qdd: s_j over the time scale and over its square), so that scales
!> are positive at rest and at the origin too.
module tandem_model_natural_scale
    use tandem_kinds, only: lane, short, wp
    use tandem_model_terms, only: terms_type
    implicit none (type, external)
    private

    public :: constraint_errors, position_errors, velocity_errors

    !> Sums over a row: C qd, C qdd, and the scales at the three levels.
    integer, parameter :: of_velocity = 1, of_acceleration = 2, q_scale = 3, qd_scale = 4, qdd_scale = 5, n_sums = 5

contains

    !> max_i |Phi_i| / scale_i and its row.
    pure subroutine position_errors(phi, jacobian, q, scale, error, row)
        !> Phi (nh), C (m, n), q (n), coordinate scales (n).
        real(wp), intent(in), contiguous :: phi(:), jacobian(:, :), q(:), scale(:)
        real(wp), intent(out) :: error
        integer, intent(out) :: row

        call find_worst(size(jacobian, 1), .false., phi, jacobian, q, scale, error, row)
    end subroutine position_errors

    !> max_i |C qd - nu|_i / scale_i and its row.
    pure subroutine velocity_errors(nu, jacobian, qd, scale, error, row)
        !> nu (m), C (m, n), qd (n), coordinate scales over the time scale (n).
        real(wp), intent(in), contiguous :: nu(:), jacobian(:, :), qd(:), scale(:)
        real(wp), intent(out) :: error
        integer, intent(out) :: row

        call find_worst(size(nu), .true., nu, jacobian, qd, scale, error, row)
    end subroutine velocity_errors

    !> Errors at all three levels, including max_i |C qdd + gamma|_i / scale_i, and their rows; 0 at position level if there are no
    !> holonomic rows. C is read once, `lane` rows at a time, without work space and with inner loops of constant length.
    pure subroutine constraint_errors(terms, q, qd, qdd, scale, rate, errors, rows)
        !> Phi, C, nu and gamma.
        type(terms_type), intent(in) :: terms
        !> q, qd, qdd and coordinate scales (n).
        real(wp), intent(in), contiguous :: q(:), qd(:), qdd(:), scale(:)
        !> 1 over the time scale.
        real(wp), intent(in) :: rate
        real(wp), intent(out) :: errors(3)
        integer, intent(out) :: rows(3)
        real(wp) :: sums(lane, n_sums), tail(lane, lane)
        integer :: b, i, j, k, m, n, s, whole

        n = size(q)
        m = size(terms%nu)
        errors = -1.0_wp
        rows = 0
        do b = 0, m - 1, lane
            ! Columns that end too close to the end of the array are copied.
            whole = max(n - (b + lane - 1)/m, 0)
            do j = whole + 1, n
                call get_column(m, n, b, j, terms%jacobian, tail(:, j - whole))
            end do
            do k = 1, n_sums
                do s = 0, lane - short, short
                    do i = 1, short
                        sums(s + i, k) = 0.0_wp
                    end do
                end do
            end do
            call add_columns(whole, m, terms%jacobian(b + 1, 1), q, qd, qdd, scale, rate, sums)
            call add_columns(n - whole, lane, tail, q(whole + 1:), qd(whole + 1:), qdd(whole + 1:), scale(whole + 1:), rate, sums)
            call update(b, size(terms%phi), .false., 0.0_wp, terms%phi, sums(:, of_velocity), sums(:, q_scale), errors(1), rows(1))
            call update(b, m, .true., -1.0_wp, terms%nu, sums(:, of_velocity), sums(:, qd_scale), errors(2), rows(2))
            call update(b, m, .true., 1.0_wp, terms%gamma, sums(:, of_acceleration), sums(:, qdd_scale), errors(3), rows(3))
        end do
        if (size(terms%phi) == 0) errors(1) = 0.0_wp
    end subroutine constraint_errors

    !> Add n columns, m entries apart, to C qd, C qdd and the scales of `lane` rows, of which c contains the first.
    pure subroutine add_columns(n, m, c, q, qd, qdd, scale, rate, sums)
        integer, intent(in) :: n, m
        real(wp), intent(in) :: c((n - 1)*m + lane), q(n), qd(n), qdd(n), scale(n), rate
        real(wp), intent(inout) :: sums(lane, n_sums)
        real(wp) :: a, magnitude_q, magnitude_qd, magnitude_qdd
        integer :: first, i, j, s

        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do j = 1, n
            first = (j - 1)*m
            magnitude_q = max(abs(q(j)), scale(j))
            magnitude_qd = max(abs(qd(j)), rate*scale(j))
            magnitude_qdd = max(abs(qdd(j)), rate*(rate*scale(j)))
            do s = 0, lane - short, short
                !GCC$ UNROLL 1
                do i = 1, short
                    a = abs(c(first + s + i))
                    sums(s + i, q_scale) = sums(s + i, q_scale) + a*magnitude_q
                    sums(s + i, of_velocity) = sums(s + i, of_velocity) + c(first + s + i)*qd(j)
                    sums(s + i, qd_scale) = sums(s + i, qd_scale) + a*magnitude_qd
                    sums(s + i, of_acceleration) = sums(s + i, of_acceleration) + c(first + s + i)*qdd(j)
                    sums(s + i, qdd_scale) = sums(s + i, qdd_scale) + a*magnitude_qdd
                end do
            end do
        end do
    end subroutine add_columns

    !> Largest error of the rows of g, the first of m rows, and the row in which it occurs. The residual is g or, with `is_linear`,
    !> C y - g.
    pure subroutine find_worst(m, is_linear, g, c, y, scale, error, row)
        integer, intent(in) :: m
        logical, intent(in) :: is_linear
        real(wp), intent(in), contiguous :: g(:), y(:), scale(:)
        real(wp), intent(in) :: c(m*size(y))
        real(wp), intent(out) :: error
        integer, intent(out) :: row
        real(wp), dimension(lane) :: column, product, row_scale
        real(wp) :: magnitude
        integer :: b, i, j

        error = -1.0_wp
        row = 0
        do b = 0, size(g) - 1, lane
            product = 0.0_wp
            row_scale = 0.0_wp
            do j = 1, size(y)
                call get_column(m, size(y), b, j, c, column)
                magnitude = max(abs(y(j)), scale(j))
                do i = 1, lane
                    product(i) = product(i) + column(i)*y(j)
                    row_scale(i) = row_scale(i) + abs(column(i))*magnitude
                end do
            end do
            call update(b, size(g), is_linear, -1.0_wp, g, product, row_scale, error, row)
        end do
    end subroutine find_worst

    !> Rows b + 1 to b + lane of column j of C (m, n). Entries beyond the last row are arbitrary.
    pure subroutine get_column(m, n, b, j, c, column)
        integer, intent(in) :: m, n, b, j
        real(wp), intent(in) :: c(m*n)
        real(wp), intent(out) :: column(lane)
        integer :: first, i, s

        first = (j - 1)*m + b
        if (first + lane <= m*n) then
            do s = 0, lane - short, short
                !GCC$ UNROLL 1
                do i = 1, short
                    column(s + i) = c(first + s + i)
                end do
            end do
        else
            column = 0.0_wp
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do i = 1, m - b
                column(i) = c(first + i)
            end do
        end if
    end subroutine get_column

    !> Largest |residual|/scale of the rows b + 1 to b + lane, of l rows in total, if it exceeds the previous maximum. NaN counts as
    !> infinite; a row of zeros has the scale of its residual. The residual is g or, with `is_linear`, product + sign g, where the
    !> scale includes |g|.
    pure subroutine update(b, l, is_linear, sign, g, product, row_scale, error, row)
        integer, intent(in) :: b, l
        logical, intent(in) :: is_linear
        real(wp), intent(in) :: sign, g(l), product(lane), row_scale(lane)
        real(wp), intent(inout) :: error
        integer, intent(inout) :: row
        real(wp) :: residual, size_of_terms
        integer :: i

        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do i = 1, min(lane, l - b)
            residual = g(b + i)
            size_of_terms = row_scale(i)
            if (is_linear) then
                size_of_terms = size_of_terms + abs(residual)
                residual = product(i) + sign*residual
            end if
            size_of_terms = max(size_of_terms, tiny(1.0_wp))
            ! Few rows exceed the previous maximum. The others need no division.
            if (abs(residual) <= error*size_of_terms .and. size_of_terms <= huge(1.0_wp)) cycle
            residual = abs(residual)/size_of_terms
            if (.not. residual <= huge(1.0_wp)) residual = huge(1.0_wp)
            if (residual <= error) cycle
            error = residual
            row = b + i
        end do
    end subroutine update
end module tandem_model_natural_scale
