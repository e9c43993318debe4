! SPDX-License-Identifier: MIT
!> Singular values, pseudo-inverse and null space, without the library and without LAPACK: one-sided Jacobi rotations
!> (Hestenes 1958; Golub and Van Loan, Matrix Computations, 4th ed., section 8.6.3).
module svd
    use tandem, only: wp
    implicit none (type, external)
    private

    public :: singular_values, pseudo_solve, get_null_space

contains

    !> The singular values of a (rows, columns) in descending order; min(rows, columns) of them.
    function singular_values(a) result(s)
        real(wp), intent(in) :: a(:, :)
        real(wp) :: s(min(size(a, 1), size(a, 2)))
        real(wp), allocatable :: u(:, :), v(:, :), values(:)

        if (size(a, 1) >= size(a, 2)) then
            call decompose(a, u, values, v)
        else
            call decompose(transpose(a), u, values, v)
        end if
        s = values
    end function singular_values

    !> The minimum-norm least-squares solution of a x = b; singular values up to `cut` times the largest count as zero.
    function pseudo_solve(a, b, cut) result(x)
        real(wp), intent(in) :: a(:, :), b(:), cut
        real(wp) :: x(size(a, 2))
        real(wp), allocatable :: u(:, :), v(:, :), s(:)
        integer :: k

        call decompose(a, u, s, v)
        x = 0.0_wp
        do k = 1, size(s)
            if (s(k) <= cut*s(1)) exit
            x = x + dot_product(u(:, k), b)/s(k)*v(:, k)
        end do
    end function pseudo_solve

    !> An orthonormal basis of the x with a x = 0; singular values up to `cut` times the largest count as zero.
    subroutine get_null_space(a, cut, basis)
        real(wp), intent(in) :: a(:, :), cut
        real(wp), allocatable, intent(out) :: basis(:, :)
        real(wp), allocatable :: u(:, :), v(:, :), s(:)

        call decompose(a, u, s, v)
        allocate (basis, source=v(:, count(s > cut*s(1)) + 1:))
    end subroutine get_null_space

    !> a = u diag(s) v' with all columns of a: zeros in s if a has fewer independent ones. v is orthogonal; a column of u that
    !> belongs to a zero of s is zero.
    subroutine decompose(a, u, s, v)
        real(wp), intent(in) :: a(:, :)
        real(wp), allocatable, intent(out) :: u(:, :), s(:), v(:, :)
        integer, parameter :: most_sweeps = 60
        real(wp) :: alpha, beta, gamma, zeta, tangent, cosine, worst
        real(wp) :: column(size(a, 1)), direction(size(a, 2))
        integer :: n, i, j, sweep

        n = size(a, 2)
        allocate (u, source=a)
        allocate (v(n, n), s(n), source=0.0_wp)
        do i = 1, n
            v(i, i) = 1.0_wp
        end do
        do sweep = 1, most_sweeps
            worst = 0.0_wp
            do i = 1, n - 1
                do j = i + 1, n
                    alpha = dot_product(u(:, i), u(:, i))
                    beta = dot_product(u(:, j), u(:, j))
                    gamma = dot_product(u(:, i), u(:, j))
                    if (.not. abs(gamma) > 0.0_wp) cycle
                    worst = max(worst, abs(gamma)/max(sqrt(alpha*beta), 1.0e-30_wp*sum(a**2)))
                    zeta = (beta - alpha)/(2*gamma)
                    tangent = sign(1.0_wp, zeta)/(abs(zeta) + sqrt(1 + zeta**2))
                    cosine = 1/sqrt(1 + tangent**2)
                    column = u(:, i)
                    u(:, i) = cosine*(column - tangent*u(:, j))
                    u(:, j) = cosine*(tangent*column + u(:, j))
                    direction = v(:, i)
                    v(:, i) = cosine*(direction - tangent*v(:, j))
                    v(:, j) = cosine*(tangent*direction + v(:, j))
                end do
            end do
            if (worst <= 1.0e-15_wp) exit
        end do
        do i = 1, n
            s(i) = norm2(u(:, i))
        end do
        do i = 1, n - 1
            j = i - 1 + maxloc(s(i:), dim=1)
            if (j == i) cycle
            s([i, j]) = s([j, i])
            u(:, [i, j]) = u(:, [j, i])
            v(:, [i, j]) = v(:, [j, i])
        end do
        do i = 1, n
            if (s(i) > 0.0_wp) u(:, i) = u(:, i)/s(i)
        end do
    end subroutine decompose
end module svd
