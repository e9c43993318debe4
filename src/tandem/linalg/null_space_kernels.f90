! SPDX-License-Identifier: MIT
!> Loops of `tandem_chart_dense_free_motion`. Matrices over the rows of C have `height` rows, those over the degrees of freedom
!> `width` rows: m and k padded with zeros. The latter are stored transposed, so that their few rows form the innermost loops.
!> Procedures take both lengths by value, and public ones pass them as constants if they are `lane` and `short`: innermost loops
!> then become single instructions. The directives keep gfortran from unrolling these loops before it has vectorised them, and from
!> vectorising the outer loops instead. Sums over columns stay in registers if the loop over the columns contains two innermost
!> loops; around a single one gfortran takes two columns in one pass, in halves of registers.
module tandem_linalg_null_space_kernels
    use tandem_kinds, only: lane, short, wp
    use tandem_linalg_small, only: factor_definite, solve_near_diagonal, substitute
    implicit none (type, external)
    private

    public :: find_velocity, find_acceleration, finish, multiply_mass, polish, scale_columns, set_overlap, transpose_basis

contains

    !> D' from the elimination: -Y in the columns of pivots; the unit matrix in the free ones if they are new.
    pure subroutine transpose_basis(m, n, k, height, width, order, are_new, unit, a, basis)
        !> Constraints, coordinates, degrees of freedom, padded lengths; order of the columns.
        integer, intent(in) :: m, n, k, height, width, order(n)
        logical, intent(in) :: are_new
        !> First columns of the unit matrix, from which whole columns of D' are written, because a load of data stored in parts
        !> would wait for the store. C eliminated, [Cd^-1, Y], and D'.
        real(wp), intent(in) :: unit(short, short), a(height, n)
        real(wp), intent(inout) :: basis(width, n)
        real(wp) :: f1, f2, f3
        integer :: i, p, r

        if (k == 1) then
            do r = 1, m
                basis(1, order(r)) = -a(r, m + 1)
            end do
        else if (k == 2) then
            do r = 1, m
                p = order(r)
                f1 = a(r, m + 1)
                f2 = a(r, m + 2)
                !GCC$ UNROLL 1
                do i = 1, short
                    basis(i, p) = -f1*unit(i, 1) - f2*unit(i, 2)
                end do
            end do
        else if (k == 3) then
            do r = 1, m
                p = order(r)
                f1 = a(r, m + 1)
                f2 = a(r, m + 2)
                f3 = a(r, m + 3)
                !GCC$ UNROLL 1
                do i = 1, short
                    basis(i, p) = (-f1*unit(i, 1) - f2*unit(i, 2)) - f3*unit(i, 3)
                end do
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

    !> Velocity, if D0' M0 D can be factored without a search for pivots. stat > 0: it cannot; then `r` is R nu and `work` the
    !> wanted velocity minus R nu.
    pure subroutine find_velocity(m, n, k, height, width, order, c, a, basis, origin, has_nu, polishes, nu, overlap, z, r, x, &
        work, qd, stat)
        integer, intent(in) :: m, n, k, height, width, order(n)
        !> True if nu is not zero; true to remove the rounding error of C qd - nu.
        logical, intent(in) :: has_nu, polishes
        !> C, C eliminated, D', D0' M0, nu.
        real(wp), intent(in) :: c(height, n), a(height, n), basis(width, n), origin(width, n), nu(m)
        !> Work space; on entry the wanted velocity, on return the velocity.
        real(wp), intent(inout) :: overlap(width, width), z(width), r(height), x(height), work(n), qd(n)
        integer, intent(out) :: stat

        if (height == lane .and. width == short) then
            call find_velocity_of(m, n, k, lane, short, order, c, a, basis, origin, has_nu, polishes, nu, overlap, z, r, x, work, &
                qd, stat)
        else
            call find_velocity_of(m, n, k, height, width, order, c, a, basis, origin, has_nu, polishes, nu, overlap, z, r, x, &
                work, qd, stat)
        end if
    end subroutine find_velocity

    !> The same for given lengths.
    pure subroutine find_velocity_of(m, n, k, height, width, order, c, a, basis, origin, has_nu, polishes, nu, overlap, z, r, x, &
        work, qd, stat)
        integer, intent(in) :: m, n, k, order(n)
        integer, intent(in), value :: height, width
        logical, intent(in) :: has_nu, polishes
        real(wp), intent(in) :: c(height, n), a(height, n), basis(width, n), origin(width, n), nu(m)
        real(wp), intent(inout) :: overlap(width, width), z(width), r(height), x(height), work(n), qd(n)
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
            call multiply_by_transpose(width, n, origin, basis, origin, work, overlap, z)
        else
            call clear(height, r)
            call multiply_by_transpose(width, n, origin, basis, origin, qd, overlap, z)
        end if
        call solve_near_diagonal(k, width, overlap, z, stat)
        if (stat == 0) then
            call finish(m, n, k, height, order, c, a, polishes, nu, -1.0_wp, z, r, x, qd)
        else if (.not. has_nu) then
            work(:) = qd
        end if
    end subroutine find_velocity_of

    !> D0' M0 D and D0' y.
    pure subroutine set_overlap(n, width, basis, origin, y, overlap, z)
        integer, intent(in) :: n, width
        real(wp), intent(in) :: basis(width, n), origin(width, n), y(n)
        real(wp), intent(inout) :: overlap(width, width), z(width)

        call multiply_by_transpose(width, n, origin, basis, origin, y, overlap, z)
    end subroutine set_overlap

    !> D' M.
    pure subroutine multiply_mass(n, width, n_blocks, blocks, basis, mass, basis_mass)
        integer, intent(in) :: n, width
        !> The diagonal blocks of M with more than one entry, see `tandem_model_evaluator`.
        integer, intent(in) :: n_blocks, blocks(2, n_blocks)
        !> D', M, D' M.
        real(wp), intent(in) :: basis(width, n), mass(n, n)
        real(wp), intent(inout) :: basis_mass(width, n)

        if (width == short) then
            call multiply_mass_of(short, n, n_blocks, blocks, basis, mass, basis_mass)
        else
            call multiply_mass_of(width, n, n_blocks, blocks, basis, mass, basis_mass)
        end if
    end subroutine multiply_mass

    !> Acceleration. stat > 0: D' M D is not positive definite; stat < 0: it is not finite, for k > 0.
    pure subroutine find_acceleration(m, n, k, height, width, order, c, a, basis, basis_mass, polishes, gamma, force, &
        reduced_mass, inverse, z, r, x, qdd, stat)
        integer, intent(in) :: m, n, k, height, width, order(n)
        !> C, C eliminated, D', D' M, gamma, S + Q_A.
        real(wp), intent(in) :: c(height, n), a(height, n), basis(width, n), basis_mass(width, n), gamma(m), force(n)
        !> True to remove the rounding error of C qdd + gamma.
        logical, intent(in) :: polishes
        !> Work space, and the acceleration.
        real(wp), intent(inout) :: reduced_mass(width, width), inverse(k), z(width), r(height), x(height), qdd(n)
        integer, intent(out) :: stat

        if (height == lane .and. width == short) then
            call find_acceleration_of(m, n, k, lane, short, order, c, a, basis, basis_mass, polishes, gamma, force, reduced_mass, &
                inverse, z, r, x, qdd, stat)
        else
            call find_acceleration_of(m, n, k, height, width, order, c, a, basis, basis_mass, polishes, gamma, force, &
                reduced_mass, inverse, z, r, x, qdd, stat)
        end if
    end subroutine find_acceleration

    !> The same for given lengths.
    pure subroutine find_acceleration_of(m, n, k, height, width, order, c, a, basis, basis_mass, polishes, gamma, force, &
        reduced_mass, inverse, z, r, x, qdd, stat)
        integer, intent(in) :: m, n, k, order(n)
        integer, intent(in), value :: height, width
        logical, intent(in) :: polishes
        real(wp), intent(in) :: c(height, n), a(height, n), basis(width, n), basis_mass(width, n), gamma(m), force(n)
        real(wp), intent(inout) :: reduced_mass(width, width), inverse(k), z(width), r(height), x(height), qdd(n)
        integer, intent(out) :: stat
        real(wp) :: f
        integer :: b, i, l, p

        call multiply_by_transpose(width, n, basis_mass, basis, basis, force, reduced_mass, z)
        call factor_definite(k, width, reduced_mass, inverse, stat)
        if (stat /= 0) return
        ! D' (S + Q_A + M R gamma), where R has nonzero rows for pivots only.
        call multiply(height, m, a, gamma, r)
        do b = 0, width - short, short
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do l = 1, m
                p = order(l)
                f = r(l)
                ! -R gamma in place, which `finish` sets again: without a store here gfortran takes two columns at once.
                qdd(p) = -f
                !GCC$ UNROLL 1
                do i = 1, short
                    z(b + i) = z(b + i) + basis_mass(b + i, p)*f
                end do
            end do
        end do
        do b = 0, height - short, short
            !GCC$ UNROLL 1
            do i = 1, short
                r(b + i) = -r(b + i)
            end do
        end do
        call substitute(k, width, reduced_mass, inverse, z)
        call finish(m, n, k, height, order, c, a, polishes, gamma, 1.0_wp, z, r, x, qdd)
        ! Values of gamma or the forces that are not finite enter each sum, if there is any.
        f = 0.0_wp
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do i = 1, k
            f = f + abs(z(i))
        end do
        if (.not. f <= huge(1.0_wp)) stat = -1
    end subroutine find_acceleration_of

    !> y := r + D z, r given by its rows of pivots, and with `polishes` minus the rounding error of C y + sign g = 0.
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
        if (polishes) call remove_rest(m, n, height, order, c, a, g, sign, r, x, y)
    end subroutine finish

    !> Remove the rounding error of C y + sign g = 0 from y.
    pure subroutine polish(m, n, height, order, c, a, g, sign, r, x, y)
        integer, intent(in) :: m, n, height, order(n)
        !> C, C eliminated, g; 1 or -1.
        real(wp), intent(in) :: c(height, n), a(height, n), g(m), sign
        !> Work space, and y.
        real(wp), intent(inout) :: r(height), x(height), y(n)

        if (height == lane) then
            call remove_rest(m, n, lane, order, c, a, g, sign, r, x, y)
        else
            call remove_rest(m, n, height, order, c, a, g, sign, r, x, y)
        end if
    end subroutine polish

    !> The same for a given length.
    pure subroutine remove_rest(m, n, height, order, c, a, g, sign, r, x, y)
        integer, intent(in) :: m, n, order(n)
        integer, intent(in), value :: height
        real(wp), intent(in) :: c(height, n), a(height, n), g(m)
        real(wp), intent(in), value :: sign
        real(wp), intent(inout) :: r(height), x(height), y(n)
        integer :: i

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
    end subroutine remove_rest

    !> y := A x, A (height, l), x (l).
    pure subroutine multiply(height, l, a, x, y)
        integer, intent(in), value :: height
        integer, intent(in) :: l
        real(wp), intent(in) :: a(height, l), x(l)
        real(wp), intent(inout) :: y(height)
        real(wp) :: f
        integer :: b, i, j

        do b = 0, height - lane, lane
            f = x(1)
            !GCC$ UNROLL 1
            do i = 1, short
                y(b + i) = a(b + i, 1)*f
                y(b + short + i) = a(b + short + i, 1)*f
            end do
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do j = 2, l
                f = x(j)
                !GCC$ UNROLL 1
                do i = 1, short
                    y(b + i) = y(b + i) + a(b + i, j)*f
                end do
                !GCC$ UNROLL 1
                do i = 1, short
                    y(b + short + i) = y(b + short + i) + a(b + short + i, j)*f
                end do
            end do
        end do
    end subroutine multiply

    !> Y := A B' and z := C x; A, B, C (width, n), x (n). Tiles of four rows and columns of Y in separate arrays, which stay in
    !> registers for any width.
    pure subroutine multiply_by_transpose(width, n, a, b, c, x, y, z)
        integer, intent(in), value :: width
        integer, intent(in) :: n
        real(wp), intent(in) :: a(width, n), b(width, n), c(width, n), x(n)
        real(wp), intent(inout) :: y(width, width), z(width)
        real(wp) :: y1(short), y2(short), y3(short), y4(short), sums(short), b1, b2, b3, b4, f
        integer :: i, j, s, t

        do s = 0, width - short, short
            do t = 0, width - short, short
                b1 = b(t + 1, 1)
                b2 = b(t + 2, 1)
                b3 = b(t + 3, 1)
                b4 = b(t + 4, 1)
                f = x(1)
                !GCC$ UNROLL 1
                do i = 1, short
                    y1(i) = a(s + i, 1)*b1
                    y2(i) = a(s + i, 1)*b2
                    y3(i) = a(s + i, 1)*b3
                    y4(i) = a(s + i, 1)*b4
                    sums(i) = c(s + i, 1)*f
                end do
                !GCC$ NOVECTOR
                !GCC$ UNROLL 1
                do j = 2, n
                    b1 = b(t + 1, j)
                    b2 = b(t + 2, j)
                    b3 = b(t + 3, j)
                    b4 = b(t + 4, j)
                    f = x(j)
                    !GCC$ UNROLL 1
                    do i = 1, short
                        y1(i) = y1(i) + a(s + i, j)*b1
                        y2(i) = y2(i) + a(s + i, j)*b2
                        y3(i) = y3(i) + a(s + i, j)*b3
                        y4(i) = y4(i) + a(s + i, j)*b4
                    end do
                    !GCC$ UNROLL 1
                    do i = 1, short
                        sums(i) = sums(i) + c(s + i, j)*f
                    end do
                end do
                !GCC$ UNROLL 1
                do i = 1, short
                    y(s + i, t + 1) = y1(i)
                end do
                !GCC$ UNROLL 1
                do i = 1, short
                    y(s + i, t + 2) = y2(i)
                end do
                !GCC$ UNROLL 1
                do i = 1, short
                    y(s + i, t + 3) = y3(i)
                end do
                !GCC$ UNROLL 1
                do i = 1, short
                    y(s + i, t + 4) = y4(i)
                end do
                !GCC$ UNROLL 1
                do i = 1, short
                    z(s + i) = sums(i)
                end do
            end do
        end do
    end subroutine multiply_by_transpose

    !> D' M for a given length.
    pure subroutine multiply_mass_of(width, n, n_blocks, blocks, basis, mass, basis_mass)
        integer, intent(in), value :: width
        integer, intent(in) :: n, n_blocks, blocks(2, n_blocks)
        real(wp), intent(in) :: basis(width, n), mass(n*n)
        real(wp), intent(inout) :: basis_mass(width, n)
        real(wp) :: f
        integer :: b, first, i, j, l, p, s

        ! Without degrees of freedom there is no first row.
        if (width == 0) return
        ! Treat M as diagonal in all columns first, unless it is one block.
        l = n
        if (n_blocks == 1) l = n - 1 - blocks(2, 1) + blocks(1, 1)
        do s = 0, merge(width, 0, l > 0) - short, short
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do j = 1, n
                f = mass((n + 1)*(j - 1) + 1)
                !GCC$ UNROLL 1
                do i = 1, short
                    basis_mass(s + i, j) = basis(s + i, j)*f
                end do
            end do
        end do
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do b = 1, n_blocks
            ! Four columns at a time, or two; the last ones may overlap the previous ones.
            first = blocks(1, b)
            l = blocks(2, b) - first + 1
            j = first
            do while (l >= 4)
                p = n*(j - 1) + first
                call multiply_four(width, l, basis(1, first), mass(p), mass(p + n), mass(p + 2*n), mass(p + 3*n), &
                    basis_mass(1, j), basis_mass(1, j + 1), basis_mass(1, j + 2), basis_mass(1, j + 3))
                if (j + 3 == blocks(2, b)) exit
                j = min(j + 4, blocks(2, b) - 3)
            end do
            do while (l < 4)
                p = n*(j - 1) + first
                call multiply_two(width, l, basis(1, first), mass(p), mass(p + n), basis_mass(1, j), basis_mass(1, j + 1))
                if (j + 1 == blocks(2, b)) exit
                j = j + 1
            end do
        end do
    end subroutine multiply_mass_of

    !> Four columns of A M, A (width, l).
    pure subroutine multiply_four(width, l, a, m1, m2, m3, m4, y1, y2, y3, y4)
        integer, intent(in), value :: width
        integer, intent(in) :: l
        real(wp), intent(in) :: a(width, l), m1(l), m2(l), m3(l), m4(l)
        real(wp), intent(inout) :: y1(width), y2(width), y3(width), y4(width)
        real(wp) :: f1, f2, f3, f4
        integer :: i, j, s

        do s = 0, width - short, short
            f1 = m1(1)
            f2 = m2(1)
            f3 = m3(1)
            f4 = m4(1)
            !GCC$ UNROLL 1
            do i = 1, short
                y1(s + i) = a(s + i, 1)*f1
                y2(s + i) = a(s + i, 1)*f2
                y3(s + i) = a(s + i, 1)*f3
                y4(s + i) = a(s + i, 1)*f4
            end do
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do j = 2, l
                f1 = m1(j)
                f2 = m2(j)
                f3 = m3(j)
                f4 = m4(j)
                !GCC$ UNROLL 1
                do i = 1, short
                    y1(s + i) = y1(s + i) + a(s + i, j)*f1
                    y2(s + i) = y2(s + i) + a(s + i, j)*f2
                end do
                !GCC$ UNROLL 1
                do i = 1, short
                    y3(s + i) = y3(s + i) + a(s + i, j)*f3
                    y4(s + i) = y4(s + i) + a(s + i, j)*f4
                end do
            end do
        end do
    end subroutine multiply_four

    !> Two columns.
    pure subroutine multiply_two(width, l, a, m1, m2, y1, y2)
        integer, intent(in), value :: width
        integer, intent(in) :: l
        real(wp), intent(in) :: a(width, l), m1(l), m2(l)
        real(wp), intent(inout) :: y1(width), y2(width)
        real(wp) :: f1, f2
        integer :: i, j, s

        do s = 0, width - short, short
            f1 = m1(1)
            f2 = m2(1)
            !GCC$ UNROLL 1
            do i = 1, short
                y1(s + i) = a(s + i, 1)*f1
                y2(s + i) = a(s + i, 1)*f2
            end do
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do j = 2, l
                f1 = m1(j)
                f2 = m2(j)
                !GCC$ UNROLL 1
                do i = 1, short
                    y1(s + i) = y1(s + i) + a(s + i, j)*f1
                end do
                !GCC$ UNROLL 1
                do i = 1, short
                    y2(s + i) = y2(s + i) + a(s + i, j)*f2
                end do
            end do
        end do
    end subroutine multiply_two

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
end module tandem_linalg_null_space_kernels
