! SPDX-License-Identifier: MIT
!> The loops of `tandem_tangent_reduced`. Matrices over the rows of C have `height` rows, those over the degrees of freedom `width`
!> rows: m and k padded with zeros. The latter stand transposed, so that their few rows make the innermost loops. Procedures take
!> both lengths by value, and those that others call pass them on as constants where they are `lane` and `short`: then innermost
!> loops are single instructions. The directives keep gfortran from unrolling those before it has vectorised them, and from
!> vectorising the loops around them instead.
module tandem_tangent_reduced_kernels
    use tandem_kinds, only: wp
    use tandem_linalg_elimination, only: lane, short
    implicit none (type, external)
    private

    public :: find_velocity, find_acceleration, finish, set_overlap, transpose_basis

contains

    !> D' from the elimination: -Y in the columns of pivots; the unit matrix in the free ones where they are new.
    pure subroutine transpose_basis(m, n, k, height, width, pivot, free, are_new, a, basis)
        !> Constraints, coordinates, degrees of freedom, padded lengths; pivot and free columns.
        integer, intent(in) :: m, n, k, height, width, pivot(m), free(k)
        logical, intent(in) :: are_new
        !> C eliminated, and D'.
        real(wp), intent(in) :: a(height, n)
        real(wp), intent(inout) :: basis(width, n)
        integer :: i, p, r

        do i = 1, k
            p = free(i)
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do r = 1, m
                basis(i, pivot(r)) = -a(r, p)
            end do
        end do
        if (.not. are_new) return
        do i = 1, k
            basis(:, free(i)) = 0.0_wp
            basis(i, free(i)) = 1.0_wp
        end do
    end subroutine transpose_basis

    !> The velocity, where D0' D can be factored without a search for pivots. stat > 0: it cannot; then `r` is R nu and `work` the
    !> wanted velocity less that.
    pure subroutine find_velocity(m, n, k, height, width, pivot, free, c, a, basis, origin, has_nu, polishes, nu, overlap, z, &
        r, x, work, diagonal, qd, stat)
        integer, intent(in) :: m, n, k, height, width, pivot(m), free(k)
        !> Whether nu is not zero, and whether to remove what rounding leaves of C qd - nu.
        logical, intent(in) :: has_nu, polishes
        !> C, C eliminated, D', D0' diag(s)^-2, nu.
        real(wp), intent(in) :: c(height, n), a(height, n), basis(width, n), origin(width, n), nu(m)
        !> Work space, and the velocity, first the wanted one.
        real(wp), intent(inout) :: overlap(width, k), z(width), r(height), x(height), work(n), diagonal(k), qd(n)
        integer, intent(out) :: stat

        if (height == lane .and. width == short) then
            call find_velocity_of(m, n, k, lane, short, pivot, free, c, a, basis, origin, has_nu, polishes, nu, overlap, z, r, &
                x, work, diagonal, qd, stat)
        else
            call find_velocity_of(m, n, k, height, width, pivot, free, c, a, basis, origin, has_nu, polishes, nu, overlap, z, &
                r, x, work, diagonal, qd, stat)
        end if
    end subroutine find_velocity

    !> The same, for given lengths.
    pure subroutine find_velocity_of(m, n, k, height, width, pivot, free, c, a, basis, origin, has_nu, polishes, nu, overlap, z, &
        r, x, work, diagonal, qd, stat)
        integer, intent(in) :: m, n, k, pivot(m), free(k)
        integer, intent(in), value :: height, width
        logical, intent(in) :: has_nu, polishes
        real(wp), intent(in) :: c(height, n), a(height, n), basis(width, n), origin(width, n), nu(m)
        real(wp), intent(inout) :: overlap(width, k), z(width), r(height), x(height), work(n), diagonal(k), qd(n)
        integer, intent(out) :: stat
        integer :: i, j

        call clear(height, r)
        !GCC$ UNROLL 1
        do j = 1, n
            work(j) = qd(j)
        end do
        if (has_nu) then
            call add_columns(height, m, n, a, pivot, 1.0_wp, nu, r)
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do i = 1, m
                work(pivot(i)) = work(pivot(i)) - r(i)
            end do
        end if
        call set_overlap(n, k, width, basis, origin, work, overlap, z)
        call solve_small(k, width, overlap, z, diagonal, stat)
        if (stat == 0) call finish(m, n, k, height, pivot, free, c, a, polishes, nu, -1.0_wp, z, r, x, qd)
    end subroutine find_velocity_of

    !> D0' D and D0' y.
    pure subroutine set_overlap(n, k, width, basis, origin, y, overlap, z)
        integer, intent(in) :: n, k
        integer, intent(in), value :: width
        real(wp), intent(in) :: basis(width, n), origin(width, n), y(n)
        real(wp), intent(inout) :: overlap(width, k), z(width)
        integer :: j

        call clear(width, z)
        call add_product(width, n, 1, origin, 1.0_wp, y, z)
        !GCC$ UNROLL 1
        do j = 1, k
            call clear(width, overlap(:, j))
            call add_product(width, n, width, origin, 1.0_wp, basis(j, 1), overlap(:, j))
        end do
    end subroutine set_overlap

    !> The acceleration. stat > 0: D' M D is not positive definite.
    pure subroutine find_acceleration(m, n, k, height, width, pivot, free, c, a, basis, polishes, mass, gamma, force, basis_mass, &
        reduced_mass, inverse, z, r, x, work, qdd, stat)
        integer, intent(in) :: m, n, k, height, width, pivot(m), free(k)
        !> Whether to remove what rounding leaves of C qdd + gamma.
        logical, intent(in) :: polishes
        !> C, C eliminated, D', M, gamma, S + Q_A.
        real(wp), intent(in) :: c(height, n), a(height, n), basis(width, n), mass(n, n), gamma(m), force(n)
        !> Work space, and the acceleration.
        real(wp), intent(inout) :: basis_mass(width, n), reduced_mass(width, k), inverse(k), z(width), r(height), x(height), work(n)
        real(wp), intent(inout) :: qdd(n)
        integer, intent(out) :: stat

        if (height == lane .and. width == short) then
            call find_acceleration_of(m, n, k, lane, short, pivot, free, c, a, basis, polishes, mass, gamma, force, basis_mass, &
                reduced_mass, inverse, z, r, x, work, qdd, stat)
        else
            call find_acceleration_of(m, n, k, height, width, pivot, free, c, a, basis, polishes, mass, gamma, force, basis_mass, &
                reduced_mass, inverse, z, r, x, work, qdd, stat)
        end if
    end subroutine find_acceleration

    !> The same, for given lengths.
    pure subroutine find_acceleration_of(m, n, k, height, width, pivot, free, c, a, basis, polishes, mass, gamma, force, &
        basis_mass, reduced_mass, inverse, z, r, x, work, qdd, stat)
        integer, intent(in) :: m, n, k, pivot(m), free(k)
        integer, intent(in), value :: height, width
        logical, intent(in) :: polishes
        real(wp), intent(in) :: c(height, n), a(height, n), basis(width, n), mass(n, n), gamma(m), force(n)
        real(wp), intent(inout) :: basis_mass(width, n), reduced_mass(width, k), inverse(k), z(width), r(height), x(height), work(n)
        real(wp), intent(inout) :: qdd(n)
        integer, intent(out) :: stat
        integer :: i, j

        !GCC$ UNROLL 1
        do j = 1, n
            call clear(width, basis_mass(:, j))
            call add_product(width, n, 1, basis, 1.0_wp, mass(:, j), basis_mass(:, j))
        end do
        !GCC$ UNROLL 1
        do j = 1, k
            call clear(width, reduced_mass(:, j))
            call add_product(width, n, width, basis_mass, 1.0_wp, basis(j, 1), reduced_mass(:, j))
        end do
        call factor_small(k, width, reduced_mass, inverse, stat)
        if (stat /= 0) return
        ! D' (S + Q_A + M R gamma).
        call clear(height, r)
        call add_columns(height, m, n, a, pivot, -1.0_wp, gamma, r)
        call clear(width, z)
        call add_product(width, n, 1, basis, 1.0_wp, force, z)
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do i = 1, m
            x(i) = -r(i)
        end do
        call add_columns(width, m, n, basis_mass, pivot, 1.0_wp, x, z)
        call substitute(k, width, reduced_mass, inverse, z)
        call finish(m, n, k, height, pivot, free, c, a, polishes, gamma, 1.0_wp, z, r, x, qdd)
    end subroutine find_acceleration_of

    !> y := r + D z, r given by its rows of pivots, and with `polishes` less what rounding leaves of C y + sign g = 0.
    pure subroutine finish(m, n, k, height, pivot, free, c, a, polishes, g, sign, z, r, x, y)
        integer, intent(in) :: m, n, k, pivot(m), free(k)
        integer, intent(in), value :: height
        logical, intent(in) :: polishes
        real(wp), intent(in) :: c(height, n), a(height, n), g(m), z(k)
        real(wp), intent(in), value :: sign
        real(wp), intent(inout) :: r(height), x(height), y(n)
        integer :: i, j

        call add_columns(height, k, n, a, free, -1.0_wp, z, r)
        !GCC$ UNROLL 1
        do j = 1, k
            y(free(j)) = z(j)
        end do
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do i = 1, m
            y(pivot(i)) = r(i)
        end do
        if (.not. polishes) return
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do i = 1, m
            x(i) = sign*g(i)
        end do
        call add_product(height, n, 1, c, 1.0_wp, y, x)
        call clear(height, r)
        call add_columns(height, m, n, a, pivot, 1.0_wp, x, r)
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do i = 1, m
            y(pivot(i)) = y(pivot(i)) - r(i)
        end do
    end subroutine finish

    !> y := y + sign A x, A (height, l), with the elements x(1), x(1 + stride), ... Two columns at a time: two sums that do not wait
    !> for each other, and two inner loops, which the compiler does not fuse with the outer one.
    pure subroutine add_product(height, l, stride, a, sign, x, y)
        integer, intent(in), value :: height, stride
        integer, intent(in) :: l
        real(wp), intent(in) :: a(height, l), x(1 + (l - 1)*stride)
        real(wp), intent(in), value :: sign
        real(wp), intent(inout) :: y(height)
        real(wp) :: even(short), f, g
        integer :: i, j, s

        do s = 0, height - short, short
            !GCC$ UNROLL 1
            do i = 1, short
                even(i) = 0.0_wp
            end do
            do j = 1, l - 1, 2
                f = sign*x(1 + (j - 1)*stride)
                g = sign*x(1 + j*stride)
                !GCC$ UNROLL 1
                do i = 1, short
                    y(s + i) = y(s + i) + a(s + i, j)*f
                end do
                !GCC$ UNROLL 1
                do i = 1, short
                    even(i) = even(i) + a(s + i, j + 1)*g
                end do
            end do
            if (mod(l, 2) == 1) then
                f = sign*x(1 + (l - 1)*stride)
                !GCC$ UNROLL 1
                do i = 1, short
                    y(s + i) = y(s + i) + a(s + i, l)*f
                end do
            end if
            !GCC$ UNROLL 1
            do i = 1, short
                y(s + i) = y(s + i) + even(i)
            end do
        end do
    end subroutine add_product

    !> y := y + sign A(:, columns) x, A (height, n).
    pure subroutine add_columns(height, l, n, a, columns, sign, x, y)
        integer, intent(in), value :: height
        integer, intent(in) :: l, n, columns(l)
        real(wp), intent(in) :: a(height, n), x(l)
        real(wp), intent(in), value :: sign
        real(wp), intent(inout) :: y(height)
        real(wp) :: even(short), f, g
        integer :: i, j, p, r, s

        do s = 0, height - short, short
            !GCC$ UNROLL 1
            do i = 1, short
                even(i) = 0.0_wp
            end do
            do j = 1, l - 1, 2
                f = sign*x(j)
                g = sign*x(j + 1)
                p = columns(j)
                r = columns(j + 1)
                !GCC$ UNROLL 1
                do i = 1, short
                    y(s + i) = y(s + i) + a(s + i, p)*f
                end do
                !GCC$ UNROLL 1
                do i = 1, short
                    even(i) = even(i) + a(s + i, r)*g
                end do
            end do
            if (mod(l, 2) == 1) then
                f = sign*x(l)
                p = columns(l)
                !GCC$ UNROLL 1
                do i = 1, short
                    y(s + i) = y(s + i) + a(s + i, p)*f
                end do
            end if
            !GCC$ UNROLL 1
            do i = 1, short
                y(s + i) = y(s + i) + even(i)
            end do
        end do
    end subroutine add_columns

    !> x := 0.
    pure subroutine clear(height, x)
        integer, intent(in), value :: height
        real(wp), intent(out) :: x(height)
        integer :: i, s

        do s = 0, height - short, short
            !GCC$ UNROLL 1
            do i = 1, short
                x(s + i) = 0.0_wp
            end do
        end do
    end subroutine clear

    !> L diag(d) L' of a symmetric positive definite matrix (width, k), in place of its lower triangle; 1/d beside it. stat > 0: the
    !> leading minor of that order is not positive, or so small against its own diagonal that the solution would be noise.
    pure subroutine factor_small(k, width, a, inverse, stat)
        integer, intent(in) :: k
        integer, intent(in), value :: width
        real(wp), intent(inout) :: a(width, k), inverse(k)
        integer, intent(out) :: stat
        !> A pivot of a singular matrix is rounding, a few n eps of its diagonal entry, over the smallest relative pivot before.
        real(wp), parameter :: smallest_pivot = 8.0e-15_wp
        real(wp) :: diagonal, f, least
        integer :: i, j, l

        stat = 0
        least = 1.0_wp
        !GCC$ UNROLL 1
        do j = 1, k
            diagonal = a(j, j)
            !GCC$ UNROLL 1
            do l = 1, j - 1
                f = a(j, l)*a(l, l)
                !GCC$ NOVECTOR
                !GCC$ UNROLL 1
                do i = j, k
                    a(i, j) = a(i, j) - a(i, l)*f
                end do
            end do
            if (.not. a(j, j)*least > smallest_pivot*diagonal) then
                stat = j
                return
            end if
            least = min(least, a(j, j)/diagonal)
            inverse(j) = 1.0_wp/a(j, j)
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do i = j + 1, k
                a(i, j) = a(i, j)*inverse(j)
            end do
        end do
    end subroutine factor_small

    !> Solve with the factors of `factor_small`.
    pure subroutine substitute(k, width, a, inverse, b)
        integer, intent(in) :: k
        integer, intent(in), value :: width
        real(wp), intent(in) :: a(width, k), inverse(k)
        real(wp), intent(inout) :: b(k)
        integer :: i, j

        !GCC$ UNROLL 1
        do j = 1, k
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do i = j + 1, k
                b(i) = b(i) - a(i, j)*b(j)
            end do
        end do
        !GCC$ UNROLL 1
        do j = k, 1, -1
            b(j) = b(j)*inverse(j)
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do i = j + 1, k
                b(j) = b(j) - a(i, j)*b(i)
            end do
        end do
    end subroutine substitute

    !> Solve a system (k, k) by elimination without a search. stat > 0: a pivot has become small against its diagonal entry.
    pure subroutine solve_small(k, width, a, b, diagonal, stat)
        integer, intent(in) :: k
        integer, intent(in), value :: width
        real(wp), intent(inout) :: a(width, k), b(k), diagonal(k)
        integer, intent(out) :: stat
        !> Near the origin the matrix is nearly D0' D0, whose pivots are far from this.
        real(wp), parameter :: smallest_pivot = 1.0e-3_wp
        real(wp) :: f, inverse
        integer :: i, j, l

        stat = 0
        !GCC$ UNROLL 1
        do j = 1, k
            diagonal(j) = abs(a(j, j))
        end do
        !GCC$ UNROLL 1
        do j = 1, k
            if (.not. abs(a(j, j)) > smallest_pivot*diagonal(j)) then
                stat = j
                return
            end if
            inverse = 1.0_wp/a(j, j)
            b(j) = b(j)*inverse
            !GCC$ UNROLL 1
            do l = j + 1, k
                f = a(j, l)*inverse
                a(j, l) = f
                !GCC$ NOVECTOR
                !GCC$ UNROLL 1
                do i = j + 1, k
                    a(i, l) = a(i, l) - a(i, j)*f
                end do
            end do
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do i = j + 1, k
                b(i) = b(i) - a(i, j)*b(j)
            end do
        end do
        !GCC$ UNROLL 1
        do j = k, 2, -1
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do i = 1, j - 1
                b(i) = b(i) - a(i, j)*b(j)
            end do
        end do
    end subroutine solve_small
end module tandem_tangent_reduced_kernels
