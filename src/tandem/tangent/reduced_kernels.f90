! SPDX-License-Identifier: MIT
!> The loops of `tandem_tangent_reduced`. Matrices over the rows of C have `height` rows, those over the degrees of freedom `width`
!> rows: m and k padded with zeros. The latter stand transposed, so that their few rows make the innermost loops. Procedures take
!> both lengths by value, and those that others call pass them on as constants where they are `lane` and `short`: then innermost
!> loops are single instructions. The directives keep gfortran from unrolling those before it has vectorised them, and from
!> vectorising the loops around them instead.
module tandem_tangent_reduced_kernels
    use tandem_kinds, only: wp
    use tandem_linalg_elimination, only: lane, short
    use tandem_linalg_small, only: factor_definite, solve_near_diagonal, substitute
    implicit none (type, external)
    private

    public :: find_velocity, find_acceleration, finish, scale_columns, set_overlap, transpose_basis

contains

    !> D' from the elimination: -Y in the columns of pivots; the unit matrix in the free ones where they are new.
    pure subroutine transpose_basis(m, n, k, height, width, order, are_new, a, basis)
        !> Constraints, coordinates, degrees of freedom, padded lengths; the order of the columns.
        integer, intent(in) :: m, n, k, height, width, order(n)
        logical, intent(in) :: are_new
        !> C eliminated, [Cd^-1, Y], and D'.
        real(wp), intent(in) :: a(height, n)
        real(wp), intent(inout) :: basis(width, n)
        integer :: i, p, r

        if (k == 1) then
            do r = 1, m
                basis(1, order(r)) = -a(r, m + 1)
            end do
        else if (k == 2) then
            do r = 1, m
                p = order(r)
                basis(1, p) = -a(r, m + 1)
                basis(2, p) = -a(r, m + 2)
            end do
        else if (k == 3) then
            do r = 1, m
                p = order(r)
                basis(1, p) = -a(r, m + 1)
                basis(2, p) = -a(r, m + 2)
                basis(3, p) = -a(r, m + 3)
            end do
        else
            do r = 1, m
                p = order(r)
                do i = 1, k
                    basis(i, p) = -a(r, m + i)
                end do
            end do
        end if
        if (.not. are_new) return
        do i = 1, k
            basis(:, order(m + i)) = 0.0_wp
            basis(i, order(m + i)) = 1.0_wp
        end do
    end subroutine transpose_basis

    !> B := A diag(f), A and B (width, n).
    pure subroutine scale_columns(n, width, a, f, b)
        integer, intent(in) :: n, width
        real(wp), intent(in) :: a(width, n), f(n)
        real(wp), intent(inout) :: b(width, n)
        integer :: i, j, s

        do s = 0, width - short, short
            !GCC$ NOVECTOR
            do j = 1, n
                !GCC$ UNROLL 1
                do i = 1, short
                    b(s + i, j) = a(s + i, j)*f(j)
                end do
            end do
        end do
    end subroutine scale_columns

    !> The velocity, where D0' D can be factored without a search for pivots. stat > 0: it cannot; then `r` is R nu and `work` the
    !> wanted velocity less that.
    pure subroutine find_velocity(m, n, k, height, width, order, c, a, basis, origin, has_nu, polishes, nu, overlap, z, r, x, &
        work, qd, stat)
        integer, intent(in) :: m, n, k, height, width, order(n)
        !> Whether nu is not zero, and whether to remove what rounding leaves of C qd - nu.
        logical, intent(in) :: has_nu, polishes
        !> C, C eliminated, D', D0' diag(s)^-2, nu.
        real(wp), intent(in) :: c(height, n), a(height, n), basis(width, n), origin(width, n), nu(m)
        !> Work space, and the velocity, first the wanted one.
        real(wp), intent(inout) :: overlap(width, k), z(width), r(height), x(height), work(n), qd(n)
        integer, intent(out) :: stat

        if (height == lane .and. width == short) then
            call find_velocity_of(m, n, k, lane, short, order, c, a, basis, origin, has_nu, polishes, nu, overlap, z, r, x, work, &
                qd, stat)
        else
            call find_velocity_of(m, n, k, height, width, order, c, a, basis, origin, has_nu, polishes, nu, overlap, z, r, x, &
                work, qd, stat)
        end if
    end subroutine find_velocity

    !> The same, for given lengths.
    pure subroutine find_velocity_of(m, n, k, height, width, order, c, a, basis, origin, has_nu, polishes, nu, overlap, z, r, x, &
        work, qd, stat)
        integer, intent(in) :: m, n, k, order(n)
        integer, intent(in), value :: height, width
        logical, intent(in) :: has_nu, polishes
        real(wp), intent(in) :: c(height, n), a(height, n), basis(width, n), origin(width, n), nu(m)
        real(wp), intent(inout) :: overlap(width, k), z(width), r(height), x(height), work(n), qd(n)
        integer, intent(out) :: stat
        integer :: i

        if (has_nu) then
            call multiply(height, m, a, nu, r)
            work(:) = qd
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do i = 1, m
                work(order(i)) = work(order(i)) - r(i)
            end do
            call set_overlap(n, k, width, basis, origin, work, overlap, z)
        else
            call clear(height, r)
            call set_overlap(n, k, width, basis, origin, qd, overlap, z)
        end if
        call solve_near_diagonal(k, width, overlap, z, stat)
        if (stat == 0) then
            call finish(m, n, k, height, order, c, a, polishes, nu, -1.0_wp, z, r, x, qd)
        else if (.not. has_nu) then
            work(:) = qd
        end if
    end subroutine find_velocity_of

    !> D0' D and D0' y.
    pure subroutine set_overlap(n, k, width, basis, origin, y, overlap, z)
        integer, intent(in) :: n, k
        integer, intent(in), value :: width
        real(wp), intent(in) :: basis(width, n), origin(width, n), y(n)
        real(wp), intent(inout) :: overlap(width, k), z(width)

        call multiply(width, n, origin, y, z)
        call multiply_all(width, n, k, width, 1, origin, basis, overlap)
    end subroutine set_overlap

    !> The acceleration. stat > 0: D' M D is not positive definite.
    pure subroutine find_acceleration(m, n, k, height, width, order, c, a, basis, polishes, n_blocks, block_start, mass, gamma, &
        force, basis_mass, reduced_mass, inverse, z, r, x, qdd, stat)
        integer, intent(in) :: m, n, k, height, width, order(n)
        !> The diagonal blocks of M, see `tandem_model_evaluator`.
        integer, intent(in) :: n_blocks, block_start(n_blocks + 1)
        !> Whether to remove what rounding leaves of C qdd + gamma.
        logical, intent(in) :: polishes
        !> C, C eliminated, D', M, gamma, S + Q_A.
        real(wp), intent(in) :: c(height, n), a(height, n), basis(width, n), mass(n, n), gamma(m), force(n)
        !> Work space, and the acceleration.
        real(wp), intent(inout) :: basis_mass(width, n), reduced_mass(width, k), inverse(k), z(width), r(height), x(height)
        real(wp), intent(inout) :: qdd(n)
        integer, intent(out) :: stat

        if (height == lane .and. width == short) then
            call multiply_blocks(short, n, n_blocks, block_start, basis, mass, basis_mass)
            call multiply_all(short, n, k, short, 1, basis_mass, basis, reduced_mass)
            call find_acceleration_of(m, n, k, lane, short, order, c, a, basis, polishes, gamma, force, basis_mass, reduced_mass, &
                inverse, z, r, x, qdd, stat)
        else
            call multiply_blocks(width, n, n_blocks, block_start, basis, mass, basis_mass)
            call multiply_all(width, n, k, width, 1, basis_mass, basis, reduced_mass)
            call find_acceleration_of(m, n, k, height, width, order, c, a, basis, polishes, gamma, force, basis_mass, &
                reduced_mass, inverse, z, r, x, qdd, stat)
        end if
    end subroutine find_acceleration

    !> The same with D' M and D' M D, for given lengths.
    pure subroutine find_acceleration_of(m, n, k, height, width, order, c, a, basis, polishes, gamma, force, basis_mass, &
        reduced_mass, inverse, z, r, x, qdd, stat)
        integer, intent(in) :: m, n, k, order(n)
        integer, intent(in), value :: height, width
        logical, intent(in) :: polishes
        real(wp), intent(in) :: c(height, n), a(height, n), basis(width, n), gamma(m), force(n), basis_mass(width, n)
        real(wp), intent(inout) :: reduced_mass(width, k), inverse(k), z(width), r(height), x(height), qdd(n)
        integer, intent(out) :: stat
        integer :: b, i

        call factor_definite(k, width, reduced_mass, inverse, stat)
        if (stat /= 0) return
        ! -R gamma, then D' (S + Q_A + M R gamma).
        call multiply(height, m, a, gamma, r)
        do b = 0, height - short, short
            !GCC$ UNROLL 1
            do i = 1, short
                r(b + i) = -r(b + i)
            end do
        end do
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do i = 1, m
            qdd(order(i)) = r(i)
        end do
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do i = m + 1, n
            qdd(order(i)) = 0.0_wp
        end do
        call set_difference(width, n, basis, force, basis_mass, qdd, z)
        call substitute(k, width, reduced_mass, inverse, z)
        call finish(m, n, k, height, order, c, a, polishes, gamma, 1.0_wp, z, r, x, qdd)
    end subroutine find_acceleration_of

    !> y := r + D z, r given by its rows of pivots, and with `polishes` less what rounding leaves of C y + sign g = 0.
    pure subroutine finish(m, n, k, height, order, c, a, polishes, g, sign, z, r, x, y)
        integer, intent(in) :: m, n, k, order(n)
        integer, intent(in), value :: height
        logical, intent(in) :: polishes
        real(wp), intent(in) :: c(height, n), a(height, n), g(m), z(k)
        real(wp), intent(in), value :: sign
        real(wp), intent(inout) :: r(height), x(height), y(n)
        real(wp) :: f
        integer :: b, i, j

        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do j = 1, k
            f = z(j)
            y(order(m + j)) = f
            do b = 0, height - short, short
                !GCC$ UNROLL 1
                do i = 1, short
                    r(b + i) = r(b + i) - a(b + i, m + j)*f
                end do
            end do
        end do
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do i = 1, m
            y(order(i)) = r(i)
        end do
        if (.not. polishes) return
        call multiply(height, n, c, y, x)
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do i = 1, m
            x(i) = x(i) + sign*g(i)
        end do
        call multiply(height, m, a, x, r)
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do i = 1, m
            y(order(i)) = y(order(i)) - r(i)
        end do
    end subroutine finish

    !> y := A x, A (height, l), x (l).
    pure subroutine multiply(height, l, a, x, y)
        integer, intent(in), value :: height
        integer, intent(in) :: l
        real(wp), intent(in) :: a(height, l), x(l)
        real(wp), intent(inout) :: y(height)

        call multiply_all(height, l, 1, 1, l, a, x, y)
    end subroutine multiply

    !> Y := A X, A (height, l), Y (height, n), x(1 + (i - 1) down + (j - 1) across) the element of X in row i and column j. Four
    !> columns of A at a time, in one expression: sums kept in an array of their own go through the memory in parts, and a load
    !> of what was stored in parts waits for it.
    pure subroutine multiply_all(height, l, n, down, across, a, x, y)
        integer, intent(in), value :: height, l, n, down, across
        real(wp), intent(in) :: a(height, l), x(1 + (l - 1)*down + (n - 1)*across)
        real(wp), intent(inout) :: y(height, n)
        real(wp) :: x1, x2, x3, x4
        integer :: i, j, p, q, rest, s

        rest = iand(l, 3)
        do s = 0, height - short, short
            select case (rest)
            case (0)
                do j = 1, n
                    !GCC$ UNROLL 1
                    do i = 1, short
                        y(s + i, j) = 0.0_wp
                    end do
                end do
            case (1)
                !GCC$ NOVECTOR
                !GCC$ UNROLL 1
                do j = 1, n
                    x1 = x(1 + (j - 1)*across)
                    !GCC$ UNROLL 1
                    do i = 1, short
                        y(s + i, j) = a(s + i, 1)*x1
                    end do
                end do
            case (2)
                !GCC$ NOVECTOR
                !GCC$ UNROLL 1
                do j = 1, n
                    p = 1 + (j - 1)*across
                    x1 = x(p)
                    x2 = x(p + down)
                    !GCC$ UNROLL 1
                    do i = 1, short
                        y(s + i, j) = a(s + i, 1)*x1 + a(s + i, 2)*x2
                    end do
                end do
            case default
                !GCC$ NOVECTOR
                !GCC$ UNROLL 1
                do j = 1, n
                    p = 1 + (j - 1)*across
                    x1 = x(p)
                    x2 = x(p + down)
                    x3 = x(p + 2*down)
                    !GCC$ UNROLL 1
                    do i = 1, short
                        y(s + i, j) = (a(s + i, 1)*x1 + a(s + i, 2)*x2) + a(s + i, 3)*x3
                    end do
                end do
            end select
            do q = rest + 1, l, 4
                !GCC$ NOVECTOR
                !GCC$ UNROLL 1
                do j = 1, n
                    p = 1 + (q - 1)*down + (j - 1)*across
                    x1 = x(p)
                    x2 = x(p + down)
                    x3 = x(p + 2*down)
                    x4 = x(p + 3*down)
                    !GCC$ UNROLL 1
                    do i = 1, short
                        y(s + i, j) = y(s + i, j) + &
                            ((a(s + i, q)*x1 + a(s + i, q + 1)*x2) + (a(s + i, q + 2)*x3 + a(s + i, q + 3)*x4))
                    end do
                end do
            end do
        end do
    end subroutine multiply_all

    !> D' M, block by block.
    pure subroutine multiply_blocks(width, n, n_blocks, block_start, basis, mass, basis_mass)
        integer, intent(in), value :: width
        integer, intent(in) :: n, n_blocks, block_start(n_blocks + 1)
        real(wp), intent(in) :: basis(width, n), mass(n, n)
        real(wp), intent(inout) :: basis_mass(width, n)
        real(wp) :: f
        integer :: b, first, i, l, s

        ! Without a degree of freedom there is no first row.
        if (width == 0) return
        do b = 1, n_blocks
            first = block_start(b)
            l = block_start(b + 1) - first
            if (l == 1) then
                f = mass(first, first)
                do s = 0, width - short, short
                    !GCC$ UNROLL 1
                    do i = 1, short
                        basis_mass(s + i, first) = basis(s + i, first)*f
                    end do
                end do
            else
                call multiply_all(width, l, l, 1, n, basis(1, first), mass(first, first), basis_mass(1, first))
            end if
        end do
    end subroutine multiply_blocks

    !> z := A x - B y, A and B (width, n).
    pure subroutine set_difference(width, n, a, x, b, y, z)
        integer, intent(in), value :: width
        integer, intent(in) :: n
        real(wp), intent(in) :: a(width, n), x(n), b(width, n), y(n)
        real(wp), intent(inout) :: z(width)
        real(wp) :: x1, x2, y1, y2
        integer :: i, j, l, s

        do s = 0, width - short, short
            x1 = x(1)
            y1 = y(1)
            if (iand(n, 1) == 0) then
                x1 = 0.0_wp
                y1 = 0.0_wp
            end if
            !GCC$ UNROLL 1
            do i = 1, short
                z(s + i) = a(s + i, 1)*x1 - b(s + i, 1)*y1
            end do
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do l = 1, n/2
                j = 2*l - 1 + iand(n, 1)
                x1 = x(j)
                x2 = x(j + 1)
                y1 = y(j)
                y2 = y(j + 1)
                !GCC$ UNROLL 1
                do i = 1, short
                    z(s + i) = z(s + i) + ((a(s + i, j)*x1 + a(s + i, j + 1)*x2) - (b(s + i, j)*y1 + b(s + i, j + 1)*y2))
                end do
            end do
        end do
    end subroutine set_difference

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
end module tandem_tangent_reduced_kernels
