! SPDX-License-Identifier: MIT
!> The eigenvalues of a linearised system; those that follow from symmetries and families are split off and marked.
!>
!> Directions in which symmetries move the state span an invariant space, on which the matrix is determined by the group: zeros, and
!> in a rotating frame the rates of the rotation. Remaining zeros come in families: other steady motions or equilibria lie beside
!> this one, as always with nonholonomic rows. Both are split off by orthogonal transformations of the balanced matrix before the
!> eigenvalues are computed, so that Jordan blocks do not reduce their accuracy.
module tandem_analysis_spectrum
    use tandem_error, only: error_type, set_error
    use tandem_kinds, only: wp
    use tandem_linalg_complex_lu, only: complex_lu_type
    use tandem_linalg_eigenvalues, only: bound_errors, find_eigenvalues, split_zeros
    use tandem_linalg_singular, only: singular_type
    use tandem_status, only: status_not_finite
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)
    private

    public :: spectrum_type, of_motion, of_symmetry, of_family, cause_name
    public :: is_asymptotically_stable, is_marginal, is_unstable, stability_name

    !> Origin of an eigenvalue.
    integer, parameter :: of_motion = 1, of_symmetry = 2, of_family = 3
    character(len=8), parameter :: cause_name(3) = [character(len=8) :: 'motion', 'symmetry', 'family']

    !> Stability by the linear equations: everything else decays; it neither grows nor decays within rounding, and terms of higher
    !> order decide; it grows.
    integer, parameter :: is_asymptotically_stable = 1, is_marginal = 2, is_unstable = 3
    character(len=8), parameter :: stability_name(3) = [character(len=8) :: 'stable', 'marginal', 'unstable']

    type :: spectrum_type
        !> Eigenvalues, sorted by their real parts, then by their imaginary parts.
        complex(wp), allocatable :: values(:)
        !> `of_motion`, `of_symmetry` or `of_family`.
        integer, allocatable :: cause(:)
        !> Bounds on the errors; for zeros that were split off, the error of the matrix amplified by a Jordan block of their size.
        real(wp), allocatable :: error(:)
        !> Eigenvectors in (v, w) of the eigenvalues of the motion, others zero (nv + nw, nv + nw).
        complex(wp), allocatable :: vectors(:, :)
        !> Eigenvectors as motions of the coordinates and velocities (n, nv + nw): the largest entry of the coordinates is 1.
        complex(wp), allocatable :: shapes(:, :), rates(:, :)
        !> The number of zeros; entry j the number of their Jordan blocks of size j or more.
        integer :: n_zeros = 0
        integer, allocatable :: blocks(:)
    contains
        procedure :: find, make_shapes, frequency, natural_frequency, damping_ratio, stability
        procedure, private :: set_zeros, set_vectors, set_errors, sort
    end type spectrum_type

contains

    !> Eigenvalues of A (n, n).
    subroutine find(self, a, uncertainty, nv, directions, drift, rate, tolerance, error)
        class(spectrum_type), intent(out) :: self
        !> A and bounds on the errors of its entries (n, n).
        real(wp), intent(in) :: a(:, :), uncertainty(:, :)
        !> Number of its rows that belong to v.
        integer, intent(in) :: nv
        !> Directions of symmetries, and of drift in a turning frame (n, any); they may depend on each other. The frame's rate.
        real(wp), intent(in) :: directions(:, :), drift(:, :), rate
        !> Errors of A over its norm: singular values up to this part count as zero.
        real(wp), intent(in) :: tolerance
        type(error_type), allocatable, intent(out) :: error
        real(wp), allocatable :: b(:, :), e(:, :), d(:), q(:, :), z(:, :), condition(:), rounding(:)
        complex(wp), allocatable :: values(:), vectors(:, :), left(:, :)
        real(wp) :: norm, dropped
        integer, allocatable :: blocks(:)
        integer :: n, ns, nd, nz, stat, i

        n = size(a, 1)
        allocate (self%values(n), self%vectors(n, n), source=(0.0_wp, 0.0_wp))
        allocate (self%cause(n), source=of_motion)
        allocate (self%error(n), source=0.0_wp)
        allocate (self%blocks(0))
        if (.not. all(ieee_is_finite(a))) then
            call set_error(error, status_not_finite, 'the matrix of the linearised system is not finite')
            return
        end if
        b = a
        allocate (d(n))
        call choose_unit_of_time(b, nv, d)
        norm = norm2(b)
        e = uncertainty
        do i = 1, n
            e(:, i) = e(:, i)*d(i)/d
        end do
        call split_directions(b, d, directions, tolerance*norm, q, ns, dropped)
        call split_drift(nd)
        allocate (z(n - ns, n - ns))
        call split_rest(nz, blocks)
        i = n - ns - nz
        allocate (values(i), vectors(i, i), condition(i), rounding(i), left(i, i))
        ! Values of the symmetries and of drift; all others that were split off are zero.
        self%cause(:ns - nd) = of_symmetry
        self%cause(ns - nd + 1:ns + nz) = of_family
        associate (bound => 8*epsilon(1.0_wp)*norm + norm2(e) + dropped, first => ns - nd + 1)
            call find_known_values(b(:ns - nd, :ns - nd), tolerance*norm, rate, bound, self%values(:ns - nd), &
                self%error(:ns - nd), stat)
            if (stat == 0) call find_known_values(b(first:ns, first:ns), tolerance*norm, rate, bound, self%values(first:ns), &
                self%error(first:ns), stat)
        end associate
        if (stat == 0) then
            call find_eigenvalues(b(ns + nz + 1:, ns + nz + 1:), values, vectors, condition, stat, left, rounding)
        end if
        if (stat /= 0) then
            call set_error(error, status_not_finite, 'the eigenvalues did not converge', 'check the parameters of the model')
            return
        end if
        self%values(ns + nz + 1:) = values
        call self%set_zeros(b, ns + nz, tolerance*norm, norm, dropped + norm2(e))
        call self%set_vectors(b, d, q, ns + nz, vectors)
        ! Rounding of the transformations, unless nothing was split off.
        dropped = dropped + merge(4*epsilon(1.0_wp)*norm, 0.0_wp, ns + nz > 0)
        call self%set_errors(b, e, d, q, ns + nz, left, rounding, dropped)
        call self%sort()

    contains

        !> Split the zeros off the matrix that remains after the symmetries.
        subroutine split_rest(k, dimensions)
            integer, intent(out) :: k
            integer, allocatable, intent(out) :: dimensions(:)
            real(wp), allocatable :: rest(:, :)

            allocate (rest, source=b(ns + 1:, ns + 1:))
            call split_zeros(rest, tolerance*norm, z, k, dimensions, dropped)
            b(ns + 1:, ns + 1:) = rest
            b(:ns, ns + 1:) = matmul(b(:ns, ns + 1:), z)
            q(:, ns + 1:) = matmul(q(:, ns + 1:), z)
        end subroutine split_rest

        !> Split drift off the remaining matrix; it counts as directions of symmetries from then on.
        subroutine split_drift(k)
            integer, intent(out) :: k
            real(wp), allocatable :: rest(:, :), turn(:, :)
            real(wp) :: left_out, scaled(n, size(drift, 2))

            allocate (rest, source=b(ns + 1:, ns + 1:))
            scaled = drift/spread(d, 2, size(drift, 2))
            call split_directions(rest, spread(1.0_wp, 1, n - ns), matmul(transpose(q(:, ns + 1:)), scaled), tolerance*norm, &
                turn, k, left_out)
            dropped = dropped + left_out
            b(ns + 1:, ns + 1:) = rest
            b(:ns, ns + 1:) = matmul(b(:ns, ns + 1:), turn)
            q(:, ns + 1:) = matmul(q(:, ns + 1:), turn)
            ns = ns + k
        end subroutine split_drift
    end subroutine find

    !> Eigenvalues on directions that were split off: zeros, and rates of a rotating frame, which Jordan blocks leave with half
    !> their digits unless they are known.
    subroutine find_known_values(matrix, tolerance, rate, bound, values, errors, stat)
        !> (n, n); bound of zeros; the rate, and a bound on errors of the matrix.
        real(wp), intent(in) :: matrix(:, :), tolerance, rate, bound
        complex(wp), intent(out) :: values(:)
        real(wp), intent(out) :: errors(:)
        !> > 0: without convergence.
        integer, intent(out) :: stat
        !> A value is identified with a known one if their distance over the rate is below this and explained by its condition.
        real(wp), parameter :: near = 1.0e-3_wp
        real(wp) :: block(size(values), size(values)), q(size(values), size(values)), condition(size(values)), first_order
        complex(wp) :: vectors(size(values), size(values)), known(3), nearest
        integer, allocatable :: dimensions(:)
        integer :: k, j

        values = (0.0_wp, 0.0_wp)
        errors = 0.0_wp
        block = matrix
        call split_zeros(block, tolerance, q, k, dimensions)
        call find_eigenvalues(block(k + 1:, k + 1:), values(k + 1:), vectors(k + 1:, k + 1:), condition(k + 1:), stat)
        if (stat /= 0) return
        known = [(0.0_wp, 0.0_wp), cmplx(0.0_wp, rate, wp), cmplx(0.0_wp, -rate, wp)]
        do j = k + 1, size(values)
            first_order = bound/max(condition(j), tiny(1.0_wp)**0.25_wp)
            nearest = known(minloc(abs(known - values(j)), dim=1))
            if (abs(nearest - values(j)) <= min(near*rate, 100*first_order)) then
                values(j) = nearest
                errors(j) = bound
            else
                errors(j) = first_order
            end if
        end do
    end subroutine find_known_values

    !> Measure velocities in a unit in which they are about as large as the coordinates: B := D^-1 B D, so that both coupling blocks
    !> have similar sizes. Powers of two cause no rounding. A full balancing would scale by rounding errors.
    subroutine choose_unit_of_time(b, nv, d)
        real(wp), intent(inout) :: b(:, :)
        integer, intent(in) :: nv
        !> The diagonal of D (n).
        real(wp), intent(out) :: d(:)
        real(wp) :: there, back

        d = 1.0_wp
        there = norm2(b(:nv, nv + 1:))
        back = norm2(b(nv + 1:, :nv))
        if (.not. (there > tiny(there) .and. back > tiny(back))) return
        d(nv + 1:) = 2.0_wp**nint(log(back/there)/log(4.0_wp))
        b(:nv, nv + 1:) = b(:nv, nv + 1:)*d(size(d))
        b(nv + 1:, :nv) = b(nv + 1:, :nv)/d(size(d))
    end subroutine choose_unit_of_time

    !> Split the directions of symmetries off: Q'BQ = [S, X; 0, B'] in place of B, S (k, k).
    subroutine split_directions(b, d, directions, tolerance, q, k, dropped)
        real(wp), intent(inout) :: b(:, :)
        !> The units of B (n).
        real(wp), intent(in) :: d(:), directions(:, :), tolerance
        real(wp), allocatable, intent(out) :: q(:, :)
        integer, intent(out) :: k
        !> The size of neglected entries.
        real(wp), intent(out) :: dropped
        type(singular_type) :: svd
        real(wp), allocatable :: rows(:, :), rest(:, :), basis(:, :)
        real(wp) :: length
        integer :: n, i

        n = size(d)
        k = 0
        dropped = 0.0_wp
        allocate (q(n, n), source=0.0_wp)
        do i = 1, n
            q(i, i) = 1.0_wp
        end do
        if (n == 0 .or. size(directions, 2) == 0) return
        allocate (rows(size(directions, 2), n))
        do i = 1, size(rows, 1)
            rows(i, :) = directions(:, i)/d
            length = norm2(rows(i, :))
            ! A symmetry without effect here has a zero row.
            if (length > 1.0e-10_wp*norm2(1/d)) rows(i, :) = rows(i, :)/length
            if (.not. length > 1.0e-10_wp*norm2(1/d)) rows(i, :) = 0.0_wp
        end do
        call svd%allocate(size(rows, 1), n)
        call svd%factor(rows)
        call svd%get_null_basis(rest)
        call svd%get_row_basis(basis)
        k = size(basis, 2)
        ! Only an invariant space may be split off, which it is for symmetries of the equations.
        if (norm2(matmul(transpose(rest), matmul(b, basis))) > 1.0e3_wp*tolerance) then
            k = 0
            return
        end if
        q(:, :k) = basis
        q(:, k + 1:) = rest
        b = matmul(transpose(q), matmul(b, q))
        dropped = norm2(b(k + 1:, :k))
        b(k + 1:, :k) = 0.0_wp
    end subroutine split_directions

    !> Compute the Jordan blocks of all zeros together, and their size without splitting.
    subroutine set_zeros(self, b, k, tolerance, norm, uncertainty)
        class(spectrum_type), intent(inout) :: self
        !> B, with the zeros in its leading block (k, k); its norm, and the norm of its errors.
        real(wp), intent(in) :: b(:, :), tolerance, norm, uncertainty
        integer, intent(in) :: k
        real(wp) :: block(k, k), q(k, k)
        integer, allocatable :: dimensions(:)

        block = b(:k, :k)
        call split_zeros(block, tolerance, q, self%n_zeros, dimensions)
        self%blocks = dimensions
        if (self%n_zeros == 0) return
        where (.not. abs(self%values(:k)) > 0.0_wp) &
            self%error(:k) = norm*max(epsilon(1.0_wp), uncertainty/norm)**(1.0_wp/max(size(dimensions), 1))
    end subroutine set_zeros

    !> Eigenvectors of A from those of the last block of Q'BQ.
    subroutine set_vectors(self, b, d, q, k, vectors)
        class(spectrum_type), intent(inout) :: self
        real(wp), intent(in) :: b(:, :), d(:), q(:, :)
        !> The order of the leading block.
        integer, intent(in) :: k
        complex(wp), intent(in) :: vectors(:, :)
        type(complex_lu_type) :: lu
        complex(wp) :: matrix(k, k), x(k), y(size(d))
        integer :: i, j, stat

        call lu%allocate(k)
        do j = 1, size(vectors, 2)
            ! (T - lambda) x = -X y.
            matrix = cmplx(b(:k, :k), 0.0_wp, wp)
            do i = 1, k
                matrix(i, i) = matrix(i, i) - self%values(k + j)
            end do
            x = -matmul(b(:k, k + 1:), vectors(:, j))
            stat = 0
            if (k > 0) call lu%factor(matrix, stat)
            if (k > 0 .and. stat == 0) then
                x = solved(x)
            else if (stat /= 0) then
                x = (0.0_wp, 0.0_wp)
            end if
            y = d*matmul(q, [x, vectors(:, j)])
            self%vectors(:, k + j) = y/maxval(abs(y))
        end do

    contains

        !> Solve the complex system by the procedure for real and imaginary parts.
        function solved(right) result(left)
            complex(wp), intent(in) :: right(:)
            complex(wp) :: left(size(right))
            real(wp) :: re(size(right)), im(size(right))

            re = real(right, wp)
            im = aimag(right)
            call lu%solve(re, im)
            left = cmplx(re, im, wp)
        end function solved
    end subroutine set_vectors

    !> Bounds on the errors of the eigenvalues of the last block of Q'BQ: left vectors times errors of B times right vectors.
    subroutine set_errors(self, b, e, d, q, k, left, rounding, dropped)
        class(spectrum_type), intent(inout) :: self
        !> B, and bounds E on its errors, which are not transformed.
        real(wp), intent(in) :: b(:, :), e(:, :), d(:), q(:, :)
        !> The order of the leading block.
        integer, intent(in) :: k
        !> Left eigenvectors of the last block; errors of the iteration; the size of entries neglected by the transformations.
        complex(wp), intent(in) :: left(:, :)
        real(wp), intent(in) :: rounding(:), dropped
        real(wp), allocatable :: last(:, :)
        complex(wp) :: x(size(d)), y(size(d))
        integer :: j, n

        n = size(d)
        if (n == k) return
        do j = 1, size(rounding)
            x = self%vectors(:, k + j)/d
            y = matmul(q(:, k + 1:), left(:, j))
            associate (along => dot_product(left(:, j), matmul(x, q(:, k + 1:))))
                self%error(k + j) = rounding(j) + (dot_product(abs(y), matmul(e, abs(x))) + dropped*norm2(abs(x)))/ &
                    max(abs(along), tiny(1.0_wp)**0.25_wp)
            end associate
        end do
        allocate (last, source=matmul(transpose(abs(q(:, k + 1:))), matmul(e, abs(q(:, k + 1:)))))
        last = last + dropped/(n - k) + 2*epsilon(1.0_wp)*norm2(b(k + 1:, k + 1:))/sqrt(real(n - k, wp))
        call bound_errors(b(k + 1:, k + 1:), last, self%values(k + 1:), self%error(k + 1:))
    end subroutine set_errors

    !> Sort by real parts, then by imaginary parts; conjugates have bitwise the same real part.
    subroutine sort(self)
        class(spectrum_type), intent(inout) :: self
        integer :: order(size(self%values)), i, j, k

        order = [(i, i=1, size(order))]
        do i = 2, size(order)
            k = order(i)
            j = i - 1
            do while (j >= 1)
                if (.not. comes_before(self%values(k), self%values(order(j)))) exit
                order(j + 1) = order(j)
                j = j - 1
            end do
            order(j + 1) = k
        end do
        self%values = self%values(order)
        self%cause = self%cause(order)
        self%error = self%error(order)
        self%vectors = self%vectors(:, order)

    contains

        pure logical function comes_before(a, b)
            complex(wp), intent(in) :: a, b

            comes_before = real(a, wp) < real(b, wp) .or. (.not. real(a, wp) > real(b, wp) .and. aimag(a) < aimag(b))
        end function comes_before
    end subroutine sort

    !> |Im lambda|/(2 pi) [Hz].
    pure real(wp) function frequency(self, i)
        class(spectrum_type), intent(in) :: self
        integer, intent(in) :: i

        frequency = abs(aimag(self%values(i)))/(2*acos(-1.0_wp))
    end function frequency

    !> |lambda|/(2 pi) [Hz].
    pure real(wp) function natural_frequency(self, i)
        class(spectrum_type), intent(in) :: self
        integer, intent(in) :: i

        natural_frequency = abs(self%values(i))/(2*acos(-1.0_wp))
    end function natural_frequency

    !> -Re lambda/|lambda|: 1 for decay without oscillation, 0 for a zero.
    pure real(wp) function damping_ratio(self, i)
        class(spectrum_type), intent(in) :: self
        integer, intent(in) :: i

        damping_ratio = 0.0_wp
        if (abs(self%values(i)) > 0.0_wp) damping_ratio = -real(self%values(i), wp)/abs(self%values(i))
    end function damping_ratio

    !> Stability according to the eigenvalues of the motion.
    pure integer function stability(self)
        class(spectrum_type), intent(in) :: self
        real(wp) :: bound
        integer :: i

        stability = merge(is_asymptotically_stable, is_marginal, any(self%cause == of_motion))
        do i = 1, size(self%values)
            if (self%cause(i) /= of_motion) cycle
            bound = self%error(i)
            if (real(self%values(i), wp) > bound) stability = is_unstable
            if (stability /= is_unstable .and. real(self%values(i), wp) >= -bound) stability = is_marginal
        end do
    end function stability

    !> Motions of the coordinates from eigenvectors.
    subroutine make_shapes(self, v, g, w)
        class(spectrum_type), intent(inout) :: self
        !> dq = V dv, dqd = G dv + W dw: V, G (n, nv), W (n, nw).
        real(wp), intent(in) :: v(:, :), g(:, :), w(:, :)
        complex(wp) :: largest
        integer :: j, nv

        nv = size(v, 2)
        self%shapes = matmul(v, self%vectors(:nv, :))
        self%rates = matmul(g, self%vectors(:nv, :)) + matmul(w, self%vectors(nv + 1:, :))
        do j = 1, size(self%values)
            if (size(v, 1) == 0) exit
            largest = self%shapes(maxloc(abs(self%shapes(:, j)), dim=1), j)
            if (.not. abs(largest) > 0.0_wp) cycle
            self%shapes(:, j) = self%shapes(:, j)/largest
            self%rates(:, j) = self%rates(:, j)/largest
            self%vectors(:, j) = self%vectors(:, j)/largest
        end do
    end subroutine make_shapes
end module tandem_analysis_spectrum
