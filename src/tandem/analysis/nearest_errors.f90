! SPDX-License-Identifier: MIT
!> Bounds on the errors of eigenvalues near a shift. With the matrix P(lambda) = [lambda^2 M + lambda D + K, C'; C, 0], x = (q, nu)
!> and z its right and left null vectors, errors E of P and the residual P x move an eigenvalue to first order by
!>
!>   (|z|' E |x| + |z' P x|)/|z' P_lambda x|.
!>
!> z comes from inverse iterations with the transposed matrix beside the eigenvalue. E contains rounding of M and C, and the
!> rounding of differences in K and D.
!>
!> Near a Jordan block eigenvectors are parallel and the first order is too large: an error changes the characteristic polynomial p
!> by e |p'| there, and p has as many zeros as before within the circle of radius r for which r prod |1 - r/g| exceeds e (Rouché),
!> with the distances g to eigenvalues whose vectors are parallel.
module tandem_analysis_nearest_errors
    use tandem_analysis_sparse_point, only: rounding_of_differences, sparse_point_type
    use tandem_kinds, only: wp
    use tandem_linalg_random, only: random_vector
    use tandem_saddle_sparse, only: sparse_saddle_type
    implicit none (type, external)
    private

    public :: bound_errors

    !> Errors of single entries over eps and their sizes.
    real(wp), parameter :: rounding = 8.0_wp*epsilon(1.0_wp)
    !> Eigenvalues whose distance is at most this times their errors coincide.
    real(wp), parameter :: apart = 8.0_wp

contains

    !> Bounds on the errors of all of them.
    subroutine bound_errors(point, shift, values, vectors, imbalance, errors, stat)
        type(sparse_point_type), intent(inout) :: point
        !> The shift, and the eigenvalues near it.
        complex(wp), intent(in) :: shift, values(:)
        !> Their motions of the coordinates (n, size(values)), and the imbalance of the point, an error of it.
        complex(wp), intent(in) :: vectors(:, :)
        real(wp), intent(in) :: imbalance
        real(wp), intent(out) :: errors(:)
        !> 0, or the status of a singular matrix.
        integer, intent(out) :: stat
        real(wp) :: first(size(values))
        integer :: i, k, seed

        stat = 0
        seed = 2718281
        do i = 1, size(values)
            ! The conjugate of an eigenvalue is one, and so is near the computed conjugate.
            k = 0
            if (i > 1) k = minloc(abs(values(:i - 1) - conjg(values(i))), dim=1)
            if (k > 0) then
                if (abs(values(k) - conjg(values(i))) <= 1.0e-10_wp*abs(aimag(values(i)))) then
                    first(i) = first(k) + abs(values(k) - conjg(values(i)))
                    cycle
                end if
            end if
            call bound_to_first_order(point, values(i), step_beside(shift, values, i), vectors(:, i), imbalance, seed, first(i), &
                stat)
            if (stat /= 0) return
        end do
        errors = first
        do i = 1, size(values)
            call bound_in_block(values, vectors, i, errors(i))
        end do
        ! Coinciding eigenvalues are as uncertain as the worst of them, and as far apart as errors have moved them.
        first = errors
        do i = 1, size(values)
            associate (distance => abs(values - values(i)))
                errors(i) = maxval(max(first, distance), mask=distance <= apart*max(first, first(i)))
            end associate
        end do
    end subroutine bound_errors

    !> Distance from an eigenvalue at which the matrix is factored: small, and smaller than to the next one, so that the left vector
    !> belongs to it within a Jordan block, too.
    pure real(wp) function step_beside(shift, values, i) result(step)
        complex(wp), intent(in) :: shift, values(:)
        integer, intent(in) :: i
        real(wp), parameter :: usual = 1.0e-3_wp, least = 1.0e-12_wp
        real(wp) :: unit
        integer :: j

        unit = max(abs(values(i)), abs(values(i) - shift))
        step = usual*unit
        do j = 1, size(values)
            if (j /= i) step = min(step, 0.1_wp*abs(values(j) - values(i)))
        end do
        step = max(step, least*unit)
    end function step_beside

    !> The bound of one eigenvalue to first order.
    subroutine bound_to_first_order(point, value, step, q, imbalance, seed, error, stat)
        type(sparse_point_type), intent(inout) :: point
        complex(wp), intent(in) :: value, q(:)
        real(wp), intent(in) :: step, imbalance
        integer, intent(inout) :: seed
        real(wp), intent(out) :: error
        integer, intent(out) :: stat
        !> A numerically singular matrix is factored further away, at most this many times.
        real(wp), parameter :: further = 100.0_wp
        integer, parameter :: most = 6
        integer, parameter :: iterations = 3
        !> A correction reduces the distance to an eigenvalue of a Jordan block only by one over its order.
        real(wp), parameter :: largest_block = 4.0_wp
        type(sparse_saddle_type) :: saddle
        complex(wp) :: near, f(point%n), z(point%n), none(point%m), lambda(point%m), residual, slope
        real(wp) :: sizes(point%n), of_error, start(point%n + count(.not. point%is_out))
        integer :: i, k, n

        n = point%n
        saddle%is_transposed = .true.
        do k = 1, most
            near = value + step*further**(k - 1)
            call point%load([near**2, near, (1.0_wp, 0.0_wp)], saddle)
            call saddle%factor(stat)
            if (stat <= 0) exit
        end do
        if (stat /= 0) return
        start = random_vector(seed, size(start))
        z = start(:n)
        none = (0.0_wp, 0.0_wp)
        do k = 1, iterations
            ! With C z = 0, so that nu is not needed.
            f = z*(saddle%unit/maxval(abs(z)))
            call saddle%solve_complex(f, none, z, lambda)
        end do
        call point%multiply([value**2, value, (1.0_wp, 0.0_wp)], q, f)
        residual = sum(z*f)
        call point%multiply([2*value, (1.0_wp, 0.0_wp), (0.0_wp, 0.0_wp)], q, f)
        slope = sum(z*f)
        call point%size_errors(abs(value), rounding + imbalance, abs(q), sizes)
        of_error = sum(abs(z)*sizes)
        do i = 1, point%m
            if (point%is_out(i)) cycle
            residual = residual + lambda(i)*point%row_times(i, q, near)
            slope = slope - lambda(i)*point%turning_times(i, q)/near**2
            of_error = of_error + abs(lambda(i))*(rounding + merge(rounding_of_differences, 0.0_wp, i > point%nh .and. &
                point%frame%moves))*point%row_size(i, q)
        end do
        error = (of_error + largest_block*abs(residual))/max(abs(slope), tiny(1.0_wp)**0.25_wp) + epsilon(1.0_wp)*abs(value)
    end subroutine bound_to_first_order

    !> The bound of one of several eigenvalues whose vectors are parallel.
    pure subroutine bound_in_block(values, vectors, i, error)
        complex(wp), intent(in) :: values(:), vectors(:, :)
        integer, intent(in) :: i
        !> The first-order bound, replaced by the new one.
        real(wp), intent(inout) :: error
        real(wp), parameter :: parallel = 0.99_wp, growth = 1.1_wp, safety = 4.0_wp
        real(wp) :: r, parts, distance(size(values)), least
        logical :: is_parallel
        integer :: j

        distance = huge(1.0_wp)
        do j = 1, size(values)
            if (j == i) cycle
            is_parallel = abs(dot_product(vectors(:, i), vectors(:, j))) > parallel*norm_of(vectors(:, i))*norm_of(vectors(:, j))
            if (is_parallel) distance(j) = abs(values(j) - values(i))
        end do
        least = minval(distance)
        if (.not. error > least/apart) return
        r = max(least, tiny(1.0_wp)**0.25_wp)
        do while (r < error)
            parts = r*product(abs(1 - r/max(distance, tiny(1.0_wp)**0.25_wp)), mask=distance < huge(1.0_wp))
            if (parts > error) exit
            r = growth*r
        end do
        error = min(error, safety*r)
    end subroutine bound_in_block

    !> The length of a vector.
    pure real(wp) function norm_of(x)
        complex(wp), intent(in) :: x(:)

        norm_of = sqrt(sum(real(x, wp)**2 + aimag(x)**2))
    end function norm_of
end module tandem_analysis_nearest_errors
