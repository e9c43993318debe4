! SPDX-License-Identifier: MIT
!> Eigenvalues and eigenvectors of a square matrix, and its eigenvalue zero. For set-up: the procedures allocate.
!>
!> Any eigenvalue routine computes a zero in a Jordan block of size k as some eps^(1/k) of the norm. Zeros are therefore split off
!> first, by the staircase of null spaces: the null space of the matrix, then that of its restriction to the quotient space, and so
!> on, by orthogonal transformations. Their dimensions give the sizes of the blocks.
!>
!> Source: V. N. Kublanovskaya 1966; G. H. Golub, J. H. Wilkinson, Ill-conditioned eigensystems and the computation of the Jordan
!> canonical form, SIAM Review 18, 1976; LAPACK Users' Guide.
module tandem_linalg_eigenvalues
    use tandem_kinds, only: wp
    use tandem_linalg_lapack, only: dgeevx, dgesvd
    use tandem_linalg_random, only: random_vector
    implicit none (type, external)
    private

    public :: find_eigenvalues, split_zeros, bound_errors

    !> Factor of the backward error of the iteration: its ratio to eps and the norm of the balanced matrix is about this times the
    !> square root of the order.
    real(wp), parameter :: rounding_of_iteration = 2.0_wp

contains

    !> Eigenvalues (n) and right eigenvectors (n, n) of length 1 of a matrix of finite numbers, and their condition.
    subroutine find_eigenvalues(a, values, vectors, condition, stat, left_vectors, rounding)
        !> (n, n)
        real(wp), intent(in) :: a(:, :)
        complex(wp), intent(out) :: values(:), vectors(:, :)
        !> Cosine between left and right eigenvector: an error E of the matrix changes the eigenvalue by up to |E| over it.
        real(wp), intent(out) :: condition(:)
        !> > 0: no convergence.
        integer, intent(out) :: stat
        !> Left eigenvectors (n, n) of length 1, and first-order bounds of the rounding error of each value (n).
        complex(wp), intent(out), optional :: left_vectors(:, :)
        real(wp), intent(out), optional :: rounding(:)
        real(wp), dimension(size(a, 1), size(a, 1)) :: copy, left, right
        real(wp), dimension(size(a, 1)) :: wr, wi, scale, rcondv
        real(wp) :: norm
        real(wp), allocatable :: work(:)
        integer, allocatable :: iwork(:)
        integer :: n, low, high, j

        n = size(a, 1)
        stat = 0
        if (n == 0) return
        copy = a
        ! Sufficient for the blocked form, and for the condition numbers.
        allocate (work(n*(n + 40)), iwork(2*n))
        call dgeevx('B', 'V', 'V', 'E', n, copy, n, wr, wi, left, n, right, n, low, high, scale, norm, condition, rcondv, work, &
            size(work), iwork, stat)
        if (stat /= 0) return
        j = 1
        do while (j <= n)
            values(j) = cmplx(wr(j), wi(j), wp)
            if (abs(wi(j)) > 0.0_wp .and. j < n) values(j + 1) = conjg(values(j))
            j = j + merge(2, 1, abs(wi(j)) > 0.0_wp)
        end do
        call make_complex(right, wi, vectors)
        if (present(left_vectors)) call make_complex(left, wi, left_vectors)
        ! The condition numbers are those of the balanced matrix.
        if (present(rounding)) rounding = rounding_of_iteration*sqrt(real(n, wp))*epsilon(1.0_wp)*norm/ &
            max(condition, tiny(1.0_wp)**0.25_wp)
    end subroutine find_eigenvalues

    !> Convert vectors from the storage of LAPACK, in which pairs are real and imaginary parts.
    pure subroutine make_complex(parts, imaginary, vectors)
        !> (n, n), and imaginary parts of the eigenvalues (n).
        real(wp), intent(in) :: parts(:, :), imaginary(:)
        complex(wp), intent(out) :: vectors(:, :)
        integer :: j

        j = 1
        do while (j <= size(imaginary))
            if (abs(imaginary(j)) > 0.0_wp .and. j < size(imaginary)) then
                vectors(:, j) = cmplx(parts(:, j), parts(:, j + 1), wp)
                vectors(:, j + 1) = conjg(vectors(:, j))
                j = j + 2
            else
                vectors(:, j) = cmplx(parts(:, j), 0.0_wp, wp)
                j = j + 1
            end if
        end do
    end subroutine make_complex

    !> Bounds on errors of eigenvalues from first-order ones, which hold if they are small compared with the distances to other
    !> eigenvalues. Otherwise, as near a Jordan block, errors of the matrix are drawn at random within its bounds; the bounds are a
    !> multiple of the resulting changes of the eigenvalues.
    subroutine bound_errors(a, uncertainty, values, errors)
        !> Matrix, bounds on the errors of its entries (n, n), and its eigenvalues (n).
        real(wp), intent(in) :: a(:, :), uncertainty(:, :)
        complex(wp), intent(in) :: values(:)
        !> First-order errors on entry, bounds on return.
        real(wp), intent(inout) :: errors(:)
        integer, parameter :: samples = 4
        real(wp), parameter :: apart = 8.0_wp, safety = 10.0_wp
        complex(wp) :: others(size(values)), vectors(size(values), size(values))
        real(wp) :: b(size(values), size(values)), moved(size(values)), ignored(size(values)), distance(size(values))
        logical :: is_close(size(values))
        integer :: i, k, seed, stat, sample

        do i = 1, size(values)
            distance = abs(values - values(i))
            distance(i) = huge(1.0_wp)
            is_close(i) = errors(i) > minval(distance)/apart
        end do
        if (.not. any(is_close)) return
        moved = 0.0_wp
        seed = 31415
        do sample = 1, samples
            do k = 1, size(values)
                b(:, k) = a(:, k) + sign(uncertainty(:, k), random_vector(seed, size(values)))
            end do
            call find_eigenvalues(b, others, vectors, ignored, stat)
            if (stat /= 0) return
            do k = 1, size(values)
                moved(k) = max(moved(k), minval(abs(others - values(k))))
                i = minloc(abs(values - others(k)), dim=1)
                moved(i) = max(moved(i), abs(values(i) - others(k)))
            end do
        end do
        ! Coinciding eigenvalues change alike.
        do i = 1, size(values)
            if (is_close(i)) ignored(i) = maxval(moved, mask=abs(values - values(i)) <= safety*moved)
        end do
        where (is_close) errors = min(errors, safety*ignored)
    end subroutine bound_errors

    !> Split off the eigenvalue zero: Q' A Q = [N, X; 0, B] with N nilpotent (k, k) and B without an eigenvalue that is zero within
    !> the tolerance.
    subroutine split_zeros(a, tolerance, q, k, dimensions, dropped)
        !> (n, n); Q' A Q on return.
        real(wp), intent(inout) :: a(:, :)
        !> Singular values of at most this are treated as zero.
        real(wp), intent(in) :: tolerance
        !> Q (n, n), and k.
        real(wp), intent(out) :: q(:, :)
        integer, intent(out) :: k
        !> Number of chains with a vector at each stage: entry j is the number of Jordan blocks of size j or more.
        integer, allocatable, intent(out) :: dimensions(:)
        !> The size of the parts treated as zero is added to it.
        real(wp), intent(inout), optional :: dropped
        real(wp), allocatable :: z(:, :)
        integer :: n, i, r

        n = size(a, 1)
        q = 0.0_wp
        do i = 1, n
            q(i, i) = 1.0_wp
        end do
        allocate (dimensions(0))
        k = 0
        do while (k < n)
            call find_null_space(a(k + 1:, k + 1:), tolerance, z, r)
            if (r == 0) exit
            a(k + 1:, k + 1:) = matmul(transpose(z), matmul(a(k + 1:, k + 1:), z))
            a(:k, k + 1:) = matmul(a(:k, k + 1:), z)
            q(:, k + 1:) = matmul(q(:, k + 1:), z)
            if (present(dropped)) dropped = dropped + norm2(a(k + 1:, k + 1:k + r))
            a(k + 1:, k + 1:k + r) = 0.0_wp
            dimensions = [dimensions, r]
            k = k + r
        end do
    end subroutine split_zeros

    !> An orthogonal matrix whose first r columns span the null space.
    subroutine find_null_space(a, tolerance, z, r)
        real(wp), intent(in) :: a(:, :), tolerance
        real(wp), allocatable, intent(out) :: z(:, :)
        integer, intent(out) :: r
        real(wp), dimension(size(a, 1), size(a, 1)) :: copy, vt
        real(wp) :: values(size(a, 1)), u(1, 1)
        real(wp), allocatable :: work(:)
        integer :: n, info, i

        n = size(a, 1)
        r = 0
        copy = a
        allocate (work(64*(n + 2)))
        call dgesvd('N', 'A', n, n, copy, n, values, u, 1, vt, n, work, size(work), info)
        if (info == 0) r = count(values <= tolerance)
        allocate (z(n, n))
        do i = 1, n
            z(:, i) = vt(n + 1 - i, :)
        end do
    end subroutine find_null_space
end module tandem_linalg_eigenvalues
