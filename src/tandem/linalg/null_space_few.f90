! SPDX-License-Identifier: MIT
!> Velocities and accelerations at stages with two or three degrees of freedom, as of rolling bodies and vehicles, and at most
!> `lane` constraints: the results of `tandem_linalg_null_space_kernels` in less time. A column of D' is one register, and sums over
!> columns stay in registers, in two chains, so that an addition need not wait for the previous one; systems of order three are
!> solved in place. Two degrees of freedom are treated as three, the last of which is at rest.
module tandem_linalg_null_space_few
    use tandem_kinds, only: lane, short, wp
    use tandem_linalg_small, only: smallest_definite_pivot
    implicit none (type, external)
    private

    public :: can_be_few, find_few_velocity, find_few_acceleration

contains

    !> True if these procedures apply to m constraints and k degrees of freedom.
    pure logical function can_be_few(m, k)
        integer, intent(in) :: m, k

        can_be_few = m >= 1 .and. m <= lane .and. (k == 2 .or. k == 3)
    end function can_be_few

    !> qd = R nu + D z with D0' M0 (qd - qd_wanted) = 0.
    pure subroutine find_few_velocity(m, n, order, a, basis, origin, has_nu, nu, qd, stat)
        !> Constraints, coordinates; order of the columns.
        integer, intent(in) :: m, n, order(n)
        !> True if nu is not zero.
        logical, intent(in) :: has_nu
        !> C eliminated, D' and D0' M0, nu.
        real(wp), intent(in) :: a(lane, n), basis(short, n), origin(short, n), nu(m)
        !> On entry the wanted velocity, on return the velocity.
        real(wp), intent(inout) :: qd(n)
        !> 1 if D0' M0 D requires a search for pivots: the velocity is then unchanged.
        integer, intent(out) :: stat
        real(wp) :: s1(short), s2(short), s3(short), sums(short), t1(short), t2(short), t3(short), more(short), r(lane), z(3), &
            f, f1, f2, f3, g, g1, g2, g3
        integer :: b, i, l, p

        s1 = 0.0_wp
        s2 = 0.0_wp
        s3 = 0.0_wp
        sums = 0.0_wp
        t1 = 0.0_wp
        t2 = 0.0_wp
        t3 = 0.0_wp
        more = 0.0_wp
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do p = 1, n/2
            l = 2*p - 1
            f1 = basis(1, l)
            f2 = basis(2, l)
            f3 = basis(3, l)
            f = qd(l)
            g1 = basis(1, l + 1)
            g2 = basis(2, l + 1)
            g3 = basis(3, l + 1)
            g = qd(l + 1)
            !GCC$ UNROLL 1
            do i = 1, short
                s1(i) = s1(i) + origin(i, l)*f1
                s2(i) = s2(i) + origin(i, l)*f2
                s3(i) = s3(i) + origin(i, l)*f3
                sums(i) = sums(i) + origin(i, l)*f
            end do
            !GCC$ UNROLL 1
            do i = 1, short
                t1(i) = t1(i) + origin(i, l + 1)*g1
                t2(i) = t2(i) + origin(i, l + 1)*g2
                t3(i) = t3(i) + origin(i, l + 1)*g3
                more(i) = more(i) + origin(i, l + 1)*g
            end do
        end do
        if (iand(n, 1) == 1) then
            f1 = basis(1, n)
            f2 = basis(2, n)
            f3 = basis(3, n)
            f = qd(n)
            !GCC$ UNROLL 1
            do i = 1, short
                s1(i) = s1(i) + origin(i, n)*f1
                s2(i) = s2(i) + origin(i, n)*f2
                s3(i) = s3(i) + origin(i, n)*f3
                sums(i) = sums(i) + origin(i, n)*f
            end do
        end if
        !GCC$ UNROLL 1
        do i = 1, short
            s1(i) = s1(i) + t1(i)
            s2(i) = s2(i) + t2(i)
            s3(i) = s3(i) + t3(i)
            sums(i) = sums(i) + more(i)
        end do
        if (n - m == 2) s3(3) = 1.0_wp
        if (has_nu) then
            call multiply(m, a, nu, r)
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do l = 1, m
                f = r(l)
                !GCC$ UNROLL 1
                do i = 1, short
                    sums(i) = sums(i) - origin(i, order(l))*f
                end do
            end do
        end if
        call solve_by_cofactors(s1, s2, s3, sums, z, stat)
        if (stat /= 0) return
        if (.not. has_nu) then
            f = z(1)
            do b = 0, lane - short, short
                !GCC$ UNROLL 1
                do i = 1, short
                    r(b + i) = -a(b + i, m + 1)*f
                end do
            end do
            call finish(2, m, n, order, a, z, r, qd)
        else
            call finish(1, m, n, order, a, z, r, qd)
        end if
    end subroutine find_few_velocity

    !> qdd = D z - R gamma with D' (M qdd - S - Q_A) = 0.
    pure subroutine find_few_acceleration(m, n, order, a, basis, n_blocks, blocks, mass, gamma, force, basis_mass, qdd, stat)
        !> Constraints, coordinates; order of the columns.
        integer, intent(in) :: m, n, order(n)
        !> The diagonal blocks of M with more than one entry, see `tandem_model_evaluator`.
        integer, intent(in) :: n_blocks, blocks(2, n_blocks)
        !> C eliminated, D', M, gamma, S + Q_A.
        real(wp), intent(in) :: a(lane, n), basis(short, n), mass(n*n), gamma(m), force(n)
        !> Work space, and the acceleration.
        real(wp), intent(inout) :: basis_mass(short, n), qdd(n)
        !> > 0 if D' M D is not positive definite; -1 if the acceleration is not finite.
        integer, intent(out) :: stat
        real(wp) :: s1(short), s2(short), s3(short), sums(short), t1(short), t2(short), t3(short), more(short), r(lane), &
            z(3), f, f1, f2, f3, g, g1, g2, g3
        integer :: b, i, l, p

        call multiply_mass(n, n_blocks, blocks, basis, mass, basis_mass)
        s1 = 0.0_wp
        s2 = 0.0_wp
        s3 = 0.0_wp
        sums = 0.0_wp
        t1 = 0.0_wp
        t2 = 0.0_wp
        t3 = 0.0_wp
        more = 0.0_wp
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do p = 1, n/2
            l = 2*p - 1
            f1 = basis(1, l)
            f2 = basis(2, l)
            f3 = basis(3, l)
            f = force(l)
            g1 = basis(1, l + 1)
            g2 = basis(2, l + 1)
            g3 = basis(3, l + 1)
            g = force(l + 1)
            !GCC$ UNROLL 1
            do i = 1, short
                s1(i) = s1(i) + basis_mass(i, l)*f1
                s2(i) = s2(i) + basis_mass(i, l)*f2
                s3(i) = s3(i) + basis_mass(i, l)*f3
                sums(i) = sums(i) + basis(i, l)*f
            end do
            !GCC$ UNROLL 1
            do i = 1, short
                t1(i) = t1(i) + basis_mass(i, l + 1)*g1
                t2(i) = t2(i) + basis_mass(i, l + 1)*g2
                t3(i) = t3(i) + basis_mass(i, l + 1)*g3
                more(i) = more(i) + basis(i, l + 1)*g
            end do
        end do
        if (iand(n, 1) == 1) then
            f1 = basis(1, n)
            f2 = basis(2, n)
            f3 = basis(3, n)
            f = force(n)
            !GCC$ UNROLL 1
            do i = 1, short
                s1(i) = s1(i) + basis_mass(i, n)*f1
                s2(i) = s2(i) + basis_mass(i, n)*f2
                s3(i) = s3(i) + basis_mass(i, n)*f3
                sums(i) = sums(i) + basis(i, n)*f
            end do
        end if
        call multiply_from_first(m, a, gamma, r)
        call add_pivots(m, n, order, basis_mass, r, sums, more)
        !GCC$ UNROLL 1
        do i = 1, short
            s1(i) = s1(i) + t1(i)
            s2(i) = s2(i) + t2(i)
            s3(i) = s3(i) + t3(i)
            sums(i) = sums(i) + more(i)
        end do
        if (n - m == 2) s3(3) = 1.0_wp
        call solve_definite(s1, s2, s3, sums, z, stat)
        if (stat /= 0) return
        f = z(1)
        do b = 0, lane - short, short
            !GCC$ UNROLL 1
            do i = 1, short
                r(b + i) = -r(b + i) - a(b + i, m + 1)*f
            end do
        end do
        call finish(2, m, n, order, a, z, r, qdd)
        ! Values of gamma or the forces that are not finite enter each sum.
        if (.not. abs(z(1)) + abs(z(2)) + abs(z(3)) <= huge(1.0_wp)) stat = -1
    end subroutine find_few_acceleration

    !> Add D' M R gamma to D' (S + Q_A + M R gamma), where R has nonzero rows for pivots only, in two chains.
    pure subroutine add_pivots(m, n, order, basis_mass, r, sums, more)
        integer, intent(in) :: m, n, order(n)
        real(wp), intent(in) :: basis_mass(short, n), r(lane)
        real(wp), intent(inout) :: sums(short), more(short)
        real(wp) :: f, g
        integer :: i, l, p

        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do p = 1, m/2
            l = 2*p - 1
            f = r(l)
            g = r(l + 1)
            !GCC$ UNROLL 1
            do i = 1, short
                sums(i) = sums(i) + basis_mass(i, order(l))*f
            end do
            !GCC$ UNROLL 1
            do i = 1, short
                more(i) = more(i) + basis_mass(i, order(l + 1))*g
            end do
        end do
        if (iand(m, 1) == 1) then
            f = r(m)
            !GCC$ UNROLL 1
            do i = 1, short
                sums(i) = sums(i) + basis_mass(i, order(m))*f
            end do
        end if
    end subroutine add_pivots

    !> Solve a system of order 3 by cofactors, with one division: close to the chart's origin the matrix is close to a definite one.
    pure subroutine solve_by_cofactors(s1, s2, s3, b, z, stat)
        !> Columns of the matrix, right-hand side.
        real(wp), intent(in) :: s1(short), s2(short), s3(short), b(short)
        real(wp), intent(out) :: z(3)
        !> 1 if too many digits of the determinant are lost.
        integer, intent(out) :: stat
        !> Smallest determinant relative to the sum of the moduli of its terms, which limits the loss of digits and does not depend
        !> on units and scales.
        real(wp), parameter :: smallest_determinant = 1.0e-2_wp
        real(wp) :: c1, c2, c3, determinant, f

        c1 = s2(2)*s3(3) - s2(3)*s3(2)
        c2 = s2(3)*s3(1) - s2(1)*s3(3)
        c3 = s2(1)*s3(2) - s2(2)*s3(1)
        determinant = s1(1)*c1 + (s1(2)*c2 + s1(3)*c3)
        f = abs(s1(1))*(abs(s2(2)*s3(3)) + abs(s2(3)*s3(2))) + (abs(s1(2))*(abs(s2(3)*s3(1)) + abs(s2(1)*s3(3))) + &
            abs(s1(3))*(abs(s2(1)*s3(2)) + abs(s2(2)*s3(1))))
        stat = merge(0, 1, abs(determinant) > smallest_determinant*f .and. f <= huge(1.0_wp))
        if (stat /= 0) return
        f = 1.0_wp/determinant
        z(1) = f*(c1*b(1) + (c2*b(2) + c3*b(3)))
        z(2) = f*((s1(3)*s3(2) - s1(2)*s3(3))*b(1) + ((s1(1)*s3(3) - s1(3)*s3(1))*b(2) + &
            (s1(2)*s3(1) - s1(1)*s3(2))*b(3)))
        z(3) = f*((s1(2)*s2(3) - s1(3)*s2(2))*b(1) + ((s1(3)*s2(1) - s1(1)*s2(3))*b(2) + &
            (s1(1)*s2(2) - s1(2)*s2(1))*b(3)))
    end subroutine solve_by_cofactors

    !> Solve a symmetric positive definite system of order 3 by L diag(d) L', as in `factor_definite`.
    pure subroutine solve_definite(s1, s2, s3, b, z, stat)
        !> Columns of the matrix, right-hand side.
        real(wp), intent(in) :: s1(short), s2(short), s3(short), b(short)
        real(wp), intent(out) :: z(3)
        !> > 0: the leading minor of this order is not positive, or so small that the solution would be inaccurate.
        integer, intent(out) :: stat
        real(wp) :: d1, d2, d3, i1, i2, i3, l21, l31, l32, b2, b3, least

        d1 = s1(1)
        i1 = 1.0_wp/d1
        l21 = s1(2)*i1
        l31 = s1(3)*i1
        d2 = s2(2) - l21*s1(2)
        i2 = 1.0_wp/d2
        l32 = (s2(3) - l31*s1(2))*i2
        d3 = (s3(3) - l31*s1(3)) - l32*(s2(3) - l31*s1(2))
        i3 = 1.0_wp/d3
        b2 = b(2) - l21*b(1)
        b3 = (b(3) - l31*b(1)) - l32*b2
        z(3) = b3*i3
        z(2) = b2*i2 - l32*z(3)
        z(1) = b(1)*i1 - (l21*z(2) + l31*z(3))
        least = min(1.0_wp, d2/s2(2))
        stat = 0
        if (.not. d3*least > smallest_definite_pivot*s3(3)) stat = 3
        if (.not. d2 > smallest_definite_pivot*s2(2)) stat = 2
        if (.not. d1 > 0.0_wp) stat = 1
    end subroutine solve_definite

    !> y := r + D z, r given by its rows of pivots; the first terms are already in r.
    pure subroutine finish(first, m, n, order, a, z, r, y)
        integer, intent(in), value :: first
        integer, intent(in) :: m, n, order(n)
        real(wp), intent(in) :: a(lane, n), z(3)
        real(wp), intent(inout) :: r(lane), y(n)
        real(wp) :: f
        integer :: b, i, j

        y(order(m + 1)) = z(1)
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do j = first, n - m
            f = z(j)
            y(order(m + j)) = f
            do b = 0, lane - short, short
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
    end subroutine finish

    !> y := A x, m columns.
    pure subroutine multiply(m, a, x, y)
        integer, intent(in) :: m
        real(wp), intent(in) :: a(lane, m), x(m)
        real(wp), intent(out) :: y(lane)
        real(wp) :: more(lane), f, g
        integer :: b, i, j, p

        f = x(1)
        if (iand(m, 1) == 0) f = 0.0_wp
        do b = 0, lane - short, short
            !GCC$ UNROLL 1
            do i = 1, short
                y(b + i) = a(b + i, 1)*f
                more(b + i) = 0.0_wp
            end do
        end do
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do p = 1, m/2
            j = 2*p - 1 + iand(m, 1)
            f = x(j)
            g = x(j + 1)
            do b = 0, lane - short, short
                !GCC$ UNROLL 1
                do i = 1, short
                    y(b + i) = y(b + i) + a(b + i, j)*f
                end do
            end do
            do b = 0, lane - short, short
                !GCC$ UNROLL 1
                do i = 1, short
                    more(b + i) = more(b + i) + a(b + i, j + 1)*g
                end do
            end do
        end do
        do b = 0, lane - short, short
            !GCC$ UNROLL 1
            do i = 1, short
                y(b + i) = y(b + i) + more(b + i)
            end do
        end do
    end subroutine multiply

    !> y := A x, m columns in two chains, the first of which starts with column 1.
    pure subroutine multiply_from_first(m, a, x, y)
        integer, intent(in) :: m
        real(wp), intent(in) :: a(lane, m), x(m)
        real(wp), intent(out) :: y(lane)
        real(wp) :: rest(lane), f, g
        integer :: b, i, l, p

        f = x(1)
        do b = 0, lane - short, short
            !GCC$ UNROLL 1
            do i = 1, short
                y(b + i) = a(b + i, 1)*f
                rest(b + i) = 0.0_wp
            end do
        end do
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do p = 1, (m - 1)/2
            l = 2*p
            f = x(l)
            g = x(l + 1)
            do b = 0, lane - short, short
                !GCC$ UNROLL 1
                do i = 1, short
                    y(b + i) = y(b + i) + a(b + i, l)*f
                end do
            end do
            do b = 0, lane - short, short
                !GCC$ UNROLL 1
                do i = 1, short
                    rest(b + i) = rest(b + i) + a(b + i, l + 1)*g
                end do
            end do
        end do
        if (iand(m, 1) == 0) then
            f = x(m)
            do b = 0, lane - short, short
                !GCC$ UNROLL 1
                do i = 1, short
                    rest(b + i) = rest(b + i) + a(b + i, m)*f
                end do
            end do
        end if
        do b = 0, lane - short, short
            !GCC$ UNROLL 1
            do i = 1, short
                y(b + i) = y(b + i) + rest(b + i)
            end do
        end do
    end subroutine multiply_from_first

    !> D' M, block by block, two columns at a time.
    pure subroutine multiply_mass(n, n_blocks, blocks, basis, mass, basis_mass)
        integer, intent(in) :: n, n_blocks, blocks(2, n_blocks)
        real(wp), intent(in) :: basis(short, n), mass(n, n)
        real(wp), intent(inout) :: basis_mass(short, n)
        real(wp) :: y1(short), y2(short), f, g
        integer :: b, first, i, j, l, last

        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do j = 1, n
            f = mass(j, j)
            !GCC$ UNROLL 1
            do i = 1, short
                basis_mass(i, j) = basis(i, j)*f
            end do
        end do
        do b = 1, n_blocks
            first = blocks(1, b)
            last = blocks(2, b)
            j = first
            do
                f = mass(first, j)
                g = mass(first, j + 1)
                !GCC$ UNROLL 1
                do i = 1, short
                    y1(i) = basis(i, first)*f
                    y2(i) = basis(i, first)*g
                end do
                !GCC$ NOVECTOR
                !GCC$ UNROLL 1
                do l = first + 1, last
                    f = mass(l, j)
                    g = mass(l, j + 1)
                    !GCC$ UNROLL 1
                    do i = 1, short
                        y1(i) = y1(i) + basis(i, l)*f
                    end do
                    !GCC$ UNROLL 1
                    do i = 1, short
                        y2(i) = y2(i) + basis(i, l)*g
                    end do
                end do
                !GCC$ UNROLL 1
                do i = 1, short
                    basis_mass(i, j) = y1(i)
                end do
                !GCC$ UNROLL 1
                do i = 1, short
                    basis_mass(i, j + 1) = y2(i)
                end do
                if (j + 1 == last) exit
                ! The last column of an odd number is computed with the previous one again.
                j = min(j + 2, last - 1)
            end do
        end do
    end subroutine multiply_mass
end module tandem_linalg_null_space_few
