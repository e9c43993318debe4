! SPDX-License-Identifier: MIT
!> Velocities and accelerations at stages with one to three degrees of freedom, as of linkages, rolling bodies and vehicles. A
!> column of D' is one register, and sums over columns stay in registers, in two chains, so that an addition need not wait for the
!> previous one; systems of order three are solved in place. Missing degrees of freedom are at rest.
module tandem_linalg_null_space_few
    use tandem_kinds, only: lane, short, wp
    use tandem_linalg_elimination, only: elimination_type
    use tandem_linalg_small, only: smallest_definite_pivot
    implicit none (type, external)
    private

    public :: find_few, most_few

    !> Largest number of degrees of freedom.
    integer, parameter :: most_few = 3

contains

    !> y = r + D z with A D z = B x - A r and r = sign R g. Velocities: A = B = D0' M0, x the wanted velocity, g = nu.
    !> Accelerations: A = D' M, B = D', x = S + Q_A, g = gamma, and sign = -1.
    pure subroutine find_few(elimination, a, b, basis, sign, g, y, stat)
        !> Of C (m, n), 0 < m <= lane.
        type(elimination_type), intent(in) :: elimination
        !> A, B, D'.
        real(wp), intent(in) :: a(short, elimination%n), b(short, elimination%n), basis(short, elimination%n)
        !> 0 if g is zero. If it is negative A D is symmetric and positive definite.
        real(wp), intent(in), value :: sign
        real(wp), intent(in) :: g(elimination%m)
        !> x on entry.
        real(wp), intent(inout) :: y(elimination%n)
        !> > 0: A D is not positive definite, or requires a search for pivots; y is then unchanged. -1: y is not finite.
        integer, intent(out) :: stat
        real(wp) :: matrix(short, most_few), odd(short), even(short), r(lane), z(most_few)

        associate (e => elimination)
            if (e%n - e%m == 1) then
                call project_single(e%n, a, basis, b, y, matrix, odd, even)
            else
                call project(e%n, a, basis, b, y, matrix, odd, even)
            end if
            if (abs(sign) > 0.0_wp) then
                call multiply(e%m, e%eliminated, sign, g, r)
                call subtract_pivots(e%m, e%n, e%order, a, r, odd, even)
            else
                r(:) = 0.0_wp
            end if
            odd(:) = odd + even
            if (e%n - e%m == 2) matrix(3, 3) = 1.0_wp
            if (e%n - e%m == 1) then
                z(1) = odd(1)/matrix(1, 1)
                z(2:) = 0.0_wp
                stat = merge(0, 1, abs(matrix(1, 1)) <= huge(1.0_wp) .and. merge(matrix(1, 1), abs(matrix(1, 1)), sign < 0.0_wp) &
                    > 0.0_wp)
            else if (sign < 0.0_wp) then
                call solve_definite(matrix(:, 1), matrix(:, 2), matrix(:, 3), odd, z, stat)
            else
                call solve_by_cofactors(matrix(:, 1), matrix(:, 2), matrix(:, 3), odd, z, stat)
            end if
            if (stat /= 0) return
            call finish(e%m, e%n, e%order, e%eliminated, z, r, y)
        end associate
        ! Values of g or x that are not finite enter each sum.
        if (.not. abs(z(1)) + abs(z(2)) + abs(z(3)) <= huge(1.0_wp)) stat = -1
    end subroutine find_few

    !> The first columns of A B', and C x in two parts: the sums over odd and over even columns.
    pure subroutine project(n, a, b, c, x, y, odd, even)
        integer, intent(in) :: n
        real(wp), intent(in) :: a(short, n), b(short, n), c(short, n), x(n)
        real(wp), intent(out) :: y(short, most_few), odd(short), even(short)
        real(wp) :: s1(short), s2(short), s3(short), t1(short), t2(short), t3(short), s(short), t(short), f, f1, f2, f3, g, &
            g1, g2, g3
        integer :: i, l, p

        s1 = 0.0_wp
        s2 = 0.0_wp
        s3 = 0.0_wp
        s = 0.0_wp
        t1 = 0.0_wp
        t2 = 0.0_wp
        t3 = 0.0_wp
        t = 0.0_wp
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do p = 1, n/2
            l = 2*p - 1
            f1 = b(1, l)
            f2 = b(2, l)
            f3 = b(3, l)
            f = x(l)
            g1 = b(1, l + 1)
            g2 = b(2, l + 1)
            g3 = b(3, l + 1)
            g = x(l + 1)
            !GCC$ UNROLL 1
            do i = 1, short
                s1(i) = s1(i) + a(i, l)*f1
                s2(i) = s2(i) + a(i, l)*f2
                s3(i) = s3(i) + a(i, l)*f3
                s(i) = s(i) + c(i, l)*f
            end do
            !GCC$ UNROLL 1
            do i = 1, short
                t1(i) = t1(i) + a(i, l + 1)*g1
                t2(i) = t2(i) + a(i, l + 1)*g2
                t3(i) = t3(i) + a(i, l + 1)*g3
                t(i) = t(i) + c(i, l + 1)*g
            end do
        end do
        if (iand(n, 1) == 1) then
            f1 = b(1, n)
            f2 = b(2, n)
            f3 = b(3, n)
            f = x(n)
            !GCC$ UNROLL 1
            do i = 1, short
                s1(i) = s1(i) + a(i, n)*f1
                s2(i) = s2(i) + a(i, n)*f2
                s3(i) = s3(i) + a(i, n)*f3
                s(i) = s(i) + c(i, n)*f
            end do
        end if
        !GCC$ UNROLL 1
        do i = 1, short
            y(i, 1) = s1(i) + t1(i)
            y(i, 2) = s2(i) + t2(i)
            y(i, 3) = s3(i) + t3(i)
            odd(i) = s(i)
            even(i) = t(i)
        end do
    end subroutine project

    !> The same for one degree of freedom, for which other rows are zero.
    pure subroutine project_single(n, a, b, c, x, y, odd, even)
        integer, intent(in) :: n
        real(wp), intent(in) :: a(short, n), b(short, n), c(short, n), x(n)
        real(wp), intent(out) :: y(short, most_few), odd(short), even(short)
        integer :: j

        y(:, 1) = 0.0_wp
        odd(:) = 0.0_wp
        even(:) = 0.0_wp
        !GCC$ NOVECTOR
        !GCC$ UNROLL 2
        do j = 1, n
            y(1, 1) = y(1, 1) + a(1, j)*b(1, j)
            odd(1) = odd(1) + c(1, j)*x(j)
        end do
    end subroutine project_single

    !> Subtract A r, r given by its rows of pivots, in two parts.
    pure subroutine subtract_pivots(m, n, order, a, r, odd, even)
        integer, intent(in) :: m, n, order(n)
        real(wp), intent(in) :: a(short, n), r(m)
        real(wp), intent(inout) :: odd(short), even(short)
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
                odd(i) = odd(i) - a(i, order(l))*f
            end do
            !GCC$ UNROLL 1
            do i = 1, short
                even(i) = even(i) - a(i, order(l + 1))*g
            end do
        end do
        if (iand(m, 1) == 1) then
            f = r(m)
            !GCC$ UNROLL 1
            do i = 1, short
                odd(i) = odd(i) - a(i, order(m))*f
            end do
        end if
    end subroutine subtract_pivots

    !> y := r + D z, r given by its rows of pivots.
    pure subroutine finish(m, n, order, a, z, r, y)
        integer, intent(in) :: m, n, order(n)
        !> C eliminated.
        real(wp), intent(in) :: a(lane, n), z(n - m)
        !> On return the rows of pivots of y.
        real(wp), intent(inout) :: r(lane), y(n)
        real(wp) :: f
        integer :: b, i, j

        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do j = 1, n - m
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

    !> y := sign A x, A (lane, l), x (l).
    pure subroutine multiply(l, a, sign, x, y)
        integer, intent(in) :: l
        real(wp), intent(in) :: a(lane, l), x(l)
        real(wp), intent(in), value :: sign
        real(wp), intent(inout) :: y(lane)

        real(wp) :: even(lane), odd(lane), f, g
        integer :: i, j, p

        f = x(1)
        !GCC$ UNROLL 1
        do i = 1, lane
            odd(i) = a(i, 1)*f
            even(i) = 0.0_wp
        end do
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do p = 1, (l - 1)/2
            j = 2*p
            f = x(j)
            g = x(j + 1)
            !GCC$ UNROLL 1
            do i = 1, lane
                even(i) = even(i) + a(i, j)*f
            end do
            !GCC$ UNROLL 1
            do i = 1, lane
                odd(i) = odd(i) + a(i, j + 1)*g
            end do
        end do
        if (iand(l, 1) == 0) then
            f = x(l)
            !GCC$ UNROLL 1
            do i = 1, lane
                even(i) = even(i) + a(i, l)*f
            end do
        end if
        !GCC$ UNROLL 1
        do i = 1, lane
            y(i) = sign*(odd(i) + even(i))
        end do
    end subroutine multiply

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
end module tandem_linalg_null_space_few
