! SPDX-License-Identifier: MIT
!> Velocities and accelerations at stages with two or three degrees of freedom, as rolling bodies and vehicles have them, and at
!> most `lane` constraints: what `tandem_linalg_null_space_kernels` gives, in less time. A column of D' is one register, and sums
!> over columns stay in registers, in two chains, so that an addition need not wait for the one before; systems of order three are
!> solved where they stand, two degrees of freedom being three of which the last is at rest.
module tandem_linalg_null_space_few
    use tandem_kinds, only: lane, short, wp
    use tandem_linalg_null_space_kernels, only: multiply_mass
    use tandem_linalg_small, only: smallest_definite_pivot
    implicit none (type, external)
    private

    public :: can_be_few, find_few_velocity, find_few_acceleration

contains

    !> Whether these procedures are for m constraints and k degrees of freedom.
    pure logical function can_be_few(m, k)
        integer, intent(in) :: m, k

        can_be_few = m >= 1 .and. m <= lane .and. (k == 2 .or. k == 3)
    end function can_be_few

    !> qd = R nu + D z with D0' diag(s)^-2 (qd - qd_wanted) = 0.
    pure subroutine find_few_velocity(m, n, order, a, basis, origin, has_nu, nu, qd, stat)
        !> Constraints, coordinates; the order of the columns.
        integer, intent(in) :: m, n, order(n)
        !> Whether nu is not zero.
        logical, intent(in) :: has_nu
        !> C eliminated, D' and D0' diag(s)^-2, nu.
        real(wp), intent(in) :: a(lane, n), basis(short, n), origin(short, n), nu(m)
        !> The velocity, first the wanted one.
        real(wp), intent(inout) :: qd(n)
        !> 1 where D0' D wants a search for pivots: then the velocity is as it was.
        integer, intent(out) :: stat
        !> Of a determinant, as a part of the sum of its terms without their signs: so much of its digits may be lost. Units and
        !> scales do not matter to that.
        real(wp), parameter :: smallest_determinant = 1.0e-2_wp
        real(wp) :: s1(short), s2(short), s3(short), sums(short), more(short), r(lane), z(3), c1, c2, c3, determinant, f
        integer :: i, l

        call multiply_by_transpose(n, origin, basis, origin, qd, s1, s2, s3, sums, more)
        sums = sums + more
        if (n - m == 2) s3(3) = 1.0_wp
        r = 0.0_wp
        if (has_nu) then
            call multiply(m, iand(m, 1) == 1, a, nu, r)
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
        ! By cofactors, with one division: near the chart's origin the matrix is near a definite one.
        c1 = s2(2)*s3(3) - s2(3)*s3(2)
        c2 = s2(3)*s3(1) - s2(1)*s3(3)
        c3 = s2(1)*s3(2) - s2(2)*s3(1)
        determinant = s1(1)*c1 + (s1(2)*c2 + s1(3)*c3)
        f = abs(s1(1))*(abs(s2(2)*s3(3)) + abs(s2(3)*s3(2))) + (abs(s1(2))*(abs(s2(3)*s3(1)) + abs(s2(1)*s3(3))) + &
            abs(s1(3))*(abs(s2(1)*s3(2)) + abs(s2(2)*s3(1))))
        stat = merge(0, 1, abs(determinant) > smallest_determinant*f .and. f <= huge(1.0_wp))
        if (stat /= 0) return
        f = 1.0_wp/determinant
        z(1) = f*(c1*sums(1) + (c2*sums(2) + c3*sums(3)))
        z(2) = f*((s1(3)*s3(2) - s1(2)*s3(3))*sums(1) + ((s1(1)*s3(3) - s1(3)*s3(1))*sums(2) + &
            (s1(2)*s3(1) - s1(1)*s3(2))*sums(3)))
        z(3) = f*((s1(2)*s2(3) - s1(3)*s2(2))*sums(1) + ((s1(3)*s2(1) - s1(1)*s2(3))*sums(2) + &
            (s1(1)*s2(2) - s1(2)*s2(1))*sums(3)))
        call finish(m, n, order, a, z, r, qd)
    end subroutine find_few_velocity

    !> qdd = D z - R gamma with D' (M qdd - S - Q_A) = 0.
    pure subroutine find_few_acceleration(m, n, order, a, basis, n_blocks, blocks, mass, gamma, force, basis_mass, qdd, stat)
        !> Constraints, coordinates; the order of the columns.
        integer, intent(in) :: m, n, order(n)
        !> The diagonal blocks of M with more than one entry, see `tandem_model_evaluator`.
        integer, intent(in) :: n_blocks, blocks(2, n_blocks)
        !> C eliminated, D', M, gamma, S + Q_A.
        real(wp), intent(in) :: a(lane, n), basis(short, n), mass(n*n), gamma(m), force(n)
        !> Work space, and the acceleration.
        real(wp), intent(inout) :: basis_mass(short, n), qdd(n)
        !> > 0 where D' M D is not positive definite; -1 where the acceleration is not finite.
        integer, intent(out) :: stat
        real(wp) :: s1(short), s2(short), s3(short), sums(short), more(short), r(lane), z(3)
        integer :: l

        call multiply_mass(n, short, n_blocks, blocks, basis, mass, basis_mass)
        call multiply_by_transpose(n, basis_mass, basis, basis, force, s1, s2, s3, sums, more)
        if (n - m == 2) s3(3) = 1.0_wp
        call multiply(m, .true., a, gamma, r)
        ! D' (S + Q_A + M R gamma), where R has rows of zeros but for the pivots'.
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do l = 2, m, 2
            call add_multiple(basis_mass(1, order(l - 1)), r(l - 1), sums)
            call add_multiple(basis_mass(1, order(l)), r(l), more)
        end do
        if (iand(m, 1) == 1) call add_multiple(basis_mass(1, order(m)), r(m), sums)
        sums = sums + more
        call solve_definite(s1, s2, s3, sums, z, stat)
        if (stat /= 0) return
        r = -r
        call finish(m, n, order, a, z, r, qdd)
        ! What is not finite in gamma or the forces is in each sum.
        if (.not. abs(z(1)) + abs(z(2)) + abs(z(3)) <= huge(1.0_wp)) stat = -1
    end subroutine find_few_acceleration

    !> Solve a symmetric, definite system of order 3 by L diag(d) L', as `factor_definite` does.
    pure subroutine solve_definite(s1, s2, s3, b, z, stat)
        !> The columns of the matrix, the right side.
        real(wp), intent(in) :: s1(short), s2(short), s3(short), b(short)
        real(wp), intent(out) :: z(3)
        !> > 0: the leading minor of that order is not positive, or so small that the solution would be noise.
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

    !> S := A B' and z + more := C x: the first three columns of S. Even columns of A and C make sums of their own.
    pure subroutine multiply_by_transpose(n, a, b, c, x, s1, s2, s3, z, more)
        integer, intent(in) :: n
        real(wp), intent(in) :: a(short, n), b(short, n), c(short, n), x(n)
        real(wp), intent(out), dimension(short) :: s1, s2, s3, z, more
        real(wp), dimension(short) :: t1, t2, t3
        integer :: l

        s1 = 0.0_wp
        s2 = 0.0_wp
        s3 = 0.0_wp
        z = 0.0_wp
        t1 = 0.0_wp
        t2 = 0.0_wp
        t3 = 0.0_wp
        more = 0.0_wp
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do l = 2, n, 2
            call add_column(a(1, l - 1), b(1, l - 1), c(1, l - 1), x(l - 1), s1, s2, s3, z)
            call add_column(a(1, l), b(1, l), c(1, l), x(l), t1, t2, t3, more)
        end do
        if (iand(n, 1) == 1) call add_column(a(1, n), b(1, n), c(1, n), x(n), s1, s2, s3, z)
        s1 = s1 + t1
        s2 = s2 + t2
        s3 = s3 + t3
    end subroutine multiply_by_transpose

    !> What one column gives.
    pure subroutine add_column(a, b, c, x, s1, s2, s3, z)
        real(wp), intent(in) :: a(short), b(short), c(short), x
        real(wp), intent(inout), dimension(short) :: s1, s2, s3, z
        real(wp) :: b1, b2, b3, f
        integer :: i

        b1 = b(1)
        b2 = b(2)
        b3 = b(3)
        f = x
        !GCC$ UNROLL 1
        do i = 1, short
            s1(i) = s1(i) + a(i)*b1
            s2(i) = s2(i) + a(i)*b2
            s3(i) = s3(i) + a(i)*b3
            z(i) = z(i) + c(i)*f
        end do
    end subroutine add_column

    !> y := y + f x.
    pure subroutine add_multiple(x, f, y)
        real(wp), intent(in) :: x(short), f
        real(wp), intent(inout) :: y(short)
        integer :: i

        !GCC$ UNROLL 1
        do i = 1, short
            y(i) = y(i) + x(i)*f
        end do
    end subroutine add_multiple

    !> y := r + D z, r given by its rows of pivots.
    pure subroutine finish(m, n, order, a, z, r, y)
        integer, intent(in) :: m, n, order(n)
        real(wp), intent(in) :: a(lane, n), z(3)
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

    !> y := A x, m columns in two chains, or the first alone and the others in two.
    pure subroutine multiply(m, is_alone, a, x, y)
        integer, intent(in) :: m
        logical, intent(in) :: is_alone
        real(wp), intent(in) :: a(lane, m), x(m)
        real(wp), intent(out) :: y(lane)
        real(wp) :: more(lane)
        integer :: b, first, j, p

        do b = 1, lane, short
            y(b:b + short - 1) = merge(a(b:b + short - 1, 1)*x(1), 0.0_wp, is_alone)
            more(b:b + short - 1) = 0.0_wp
        end do
        first = merge(3, 2, is_alone)
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do p = 1, (m - first + 2)/2
            j = first + 2*(p - 1)
            do b = 1, lane, short
                call add_multiple(a(b, j - 1), x(j - 1), y(b))
                call add_multiple(a(b, j), x(j), more(b))
            end do
        end do
        if (is_alone .and. iand(m, 1) == 0) then
            do b = 1, lane, short
                call add_multiple(a(b, m), x(m), more(b))
            end do
        end if
        y = y + more
    end subroutine multiply
end module tandem_linalg_null_space_few
