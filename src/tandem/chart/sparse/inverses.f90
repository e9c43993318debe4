! SPDX-License-Identifier: MIT
!> Inverses of small symmetric matrices. Those of order 2 to 5, which masses and joints have, are written out: from L D L' to
!> L^-T D^-1 L^-1 nothing leaves the registers, and a node waits for the one before it no longer than pivots take.
module tandem_chart_sparse_inverses
    use tandem_chart_sparse_blocks, only: most_coordinates
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: invert, invert_some

contains

    !> The inverse of a symmetric matrix in place, definite with the sign; pivots are compared with what they would be alone.
    pure subroutine invert(s, x, alone, sign, least, worst)
        integer, intent(in) :: s
        real(wp), intent(inout) :: x(s*s)
        !> On entry the comparison, then the pivots against it; where one is too small it means nothing.
        real(wp), intent(inout) :: alone(s)
        real(wp), intent(in) :: sign, least
        !> The first pivot that is not larger than the least part of that, 0 for none.
        integer, intent(out) :: worst

        select case (s)
        case (5)
            call invert_five(x, alone, sign, least, worst)
        case (4)
            call invert_four(x, alone, sign, least, worst)
        case (3)
            call invert_three(x, alone, sign, least, worst)
        case (2)
            call invert_two(x, alone, sign, least, worst)
        case (1)
            call invert_sized(1, x, alone, sign, least, worst)
        case default
            call invert_sized(s, x, alone, sign, least, worst)
        end select
    end subroutine invert

    !> The inverse of a matrix of order 5, whose lower triangle is read.
    pure subroutine invert_five(x, alone, sign, least, worst)
        real(wp), intent(inout) :: x(5, 5), alone(5)
        real(wp), intent(in) :: sign, least
        integer, intent(out) :: worst
        real(wp) :: d1, d2, d3, d4, d5, r1, r2, r3, r4, r5
        real(wp) :: l21, l31, l41, l51, l32, l42, l52, l43, l53, l54
        real(wp) :: u32, u42, u52, u43, u53, u54
        real(wp) :: m21, m31, m41, m51, m32, m42, m52, m43, m53, m54

        d1 = x(1, 1)
        worst = 1
        if (.not. sign*d1 > least*alone(1)) return
        r1 = 1.0_wp/d1
        l21 = x(2, 1)*r1
        l31 = x(3, 1)*r1
        l41 = x(4, 1)*r1
        l51 = x(5, 1)*r1
        d2 = x(2, 2) - l21*x(2, 1)
        worst = 2
        if (.not. sign*d2 > least*alone(2)) return
        r2 = 1.0_wp/d2
        u32 = x(3, 2) - x(3, 1)*l21
        l32 = u32*r2
        u42 = x(4, 2) - x(4, 1)*l21
        l42 = u42*r2
        u52 = x(5, 2) - x(5, 1)*l21
        l52 = u52*r2
        d3 = x(3, 3) - l31*x(3, 1) - l32*u32
        worst = 3
        if (.not. sign*d3 > least*alone(3)) return
        r3 = 1.0_wp/d3
        u43 = x(4, 3) - x(4, 1)*l31 - u42*l32
        l43 = u43*r3
        u53 = x(5, 3) - x(5, 1)*l31 - u52*l32
        l53 = u53*r3
        d4 = x(4, 4) - l41*x(4, 1) - l42*u42 - l43*u43
        worst = 4
        if (.not. sign*d4 > least*alone(4)) return
        r4 = 1.0_wp/d4
        u54 = x(5, 4) - x(5, 1)*l41 - u52*l42 - u53*l43
        l54 = u54*r4
        d5 = x(5, 5) - l51*x(5, 1) - l52*u52 - l53*u53 - l54*u54
        worst = 5
        if (.not. sign*d5 > least*alone(5)) return
        r5 = 1.0_wp/d5
        worst = 0
        alone = sign*[d1, d2, d3, d4, d5]/alone
        m21 = -l21
        m31 = -l31 - l32*m21
        m41 = -l41 - l42*m21 - l43*m31
        m51 = -l51 - l52*m21 - l53*m31 - l54*m41
        m32 = -l32
        m42 = -l42 - l43*m32
        m52 = -l52 - l53*m32 - l54*m42
        m43 = -l43
        m53 = -l53 - l54*m43
        m54 = -l54
        l21 = r2*m21
        l31 = r3*m31
        l32 = r3*m32
        l41 = r4*m41
        l42 = r4*m42
        l43 = r4*m43
        l51 = r5*m51
        l52 = r5*m52
        l53 = r5*m53
        l54 = r5*m54
        x(1, 1) = r1 + l21*m21 + l31*m31 + l41*m41 + l51*m51
        x(2, 1) = l21 + l32*m31 + l42*m41 + l52*m51
        x(3, 1) = l31 + l43*m41 + l53*m51
        x(4, 1) = l41 + l54*m51
        x(5, 1) = l51
        x(2, 2) = r2 + l32*m32 + l42*m42 + l52*m52
        x(3, 2) = l32 + l43*m42 + l53*m52
        x(4, 2) = l42 + l54*m52
        x(5, 2) = l52
        x(3, 3) = r3 + l43*m43 + l53*m53
        x(4, 3) = l43 + l54*m53
        x(5, 3) = l53
        x(4, 4) = r4 + l54*m54
        x(5, 4) = l54
        x(5, 5) = r5
        x(1, 2) = x(2, 1)
        x(1, 3) = x(3, 1)
        x(1, 4) = x(4, 1)
        x(1, 5) = x(5, 1)
        x(2, 3) = x(3, 2)
        x(2, 4) = x(4, 2)
        x(2, 5) = x(5, 2)
        x(3, 4) = x(4, 3)
        x(3, 5) = x(5, 3)
        x(4, 5) = x(5, 4)
    end subroutine invert_five

    !> The same of order 4; the lower triangle is read.
    pure subroutine invert_four(x, alone, sign, least, worst)
        real(wp), intent(inout) :: x(4, 4), alone(4)
        real(wp), intent(in) :: sign, least
        integer, intent(out) :: worst
        real(wp) :: d1, d2, d3, d4, r1, r2, r3, r4
        real(wp) :: l21, l31, l41, l32, l42, l43
        real(wp) :: u32, u42, u43
        real(wp) :: m21, m31, m41, m32, m42, m43

        d1 = x(1, 1)
        worst = 1
        if (.not. sign*d1 > least*alone(1)) return
        r1 = 1.0_wp/d1
        l21 = x(2, 1)*r1
        l31 = x(3, 1)*r1
        l41 = x(4, 1)*r1
        d2 = x(2, 2) - l21*x(2, 1)
        worst = 2
        if (.not. sign*d2 > least*alone(2)) return
        r2 = 1.0_wp/d2
        u32 = x(3, 2) - x(3, 1)*l21
        l32 = u32*r2
        u42 = x(4, 2) - x(4, 1)*l21
        l42 = u42*r2
        d3 = x(3, 3) - l31*x(3, 1) - l32*u32
        worst = 3
        if (.not. sign*d3 > least*alone(3)) return
        r3 = 1.0_wp/d3
        u43 = x(4, 3) - x(4, 1)*l31 - u42*l32
        l43 = u43*r3
        d4 = x(4, 4) - l41*x(4, 1) - l42*u42 - l43*u43
        worst = 4
        if (.not. sign*d4 > least*alone(4)) return
        r4 = 1.0_wp/d4
        worst = 0
        alone = sign*[d1, d2, d3, d4]/alone
        m21 = -l21
        m31 = -l31 - l32*m21
        m41 = -l41 - l42*m21 - l43*m31
        m32 = -l32
        m42 = -l42 - l43*m32
        m43 = -l43
        l21 = r2*m21
        l31 = r3*m31
        l32 = r3*m32
        l41 = r4*m41
        l42 = r4*m42
        l43 = r4*m43
        x(1, 1) = r1 + l21*m21 + l31*m31 + l41*m41
        x(2, 1) = l21 + l32*m31 + l42*m41
        x(3, 1) = l31 + l43*m41
        x(4, 1) = l41
        x(2, 2) = r2 + l32*m32 + l42*m42
        x(3, 2) = l32 + l43*m42
        x(4, 2) = l42
        x(3, 3) = r3 + l43*m43
        x(4, 3) = l43
        x(4, 4) = r4
        x(1, 2) = x(2, 1)
        x(1, 3) = x(3, 1)
        x(1, 4) = x(4, 1)
        x(2, 3) = x(3, 2)
        x(2, 4) = x(4, 2)
        x(3, 4) = x(4, 3)
    end subroutine invert_four

    !> The same of order 3; the lower triangle is read.
    pure subroutine invert_three(x, alone, sign, least, worst)
        real(wp), intent(inout) :: x(3, 3), alone(3)
        real(wp), intent(in) :: sign, least
        integer, intent(out) :: worst
        real(wp) :: d1, d2, d3, r1, r2, r3
        real(wp) :: l21, l31, l32
        real(wp) :: u32
        real(wp) :: m21, m31, m32

        d1 = x(1, 1)
        worst = 1
        if (.not. sign*d1 > least*alone(1)) return
        r1 = 1.0_wp/d1
        l21 = x(2, 1)*r1
        l31 = x(3, 1)*r1
        d2 = x(2, 2) - l21*x(2, 1)
        worst = 2
        if (.not. sign*d2 > least*alone(2)) return
        r2 = 1.0_wp/d2
        u32 = x(3, 2) - x(3, 1)*l21
        l32 = u32*r2
        d3 = x(3, 3) - l31*x(3, 1) - l32*u32
        worst = 3
        if (.not. sign*d3 > least*alone(3)) return
        r3 = 1.0_wp/d3
        worst = 0
        alone = sign*[d1, d2, d3]/alone
        m21 = -l21
        m31 = -l31 - l32*m21
        m32 = -l32
        l21 = r2*m21
        l31 = r3*m31
        l32 = r3*m32
        x(1, 1) = r1 + l21*m21 + l31*m31
        x(2, 1) = l21 + l32*m31
        x(3, 1) = l31
        x(2, 2) = r2 + l32*m32
        x(3, 2) = l32
        x(3, 3) = r3
        x(1, 2) = x(2, 1)
        x(1, 3) = x(3, 1)
        x(2, 3) = x(3, 2)
    end subroutine invert_three

    !> The same of order 2; the lower triangle is read.
    pure subroutine invert_two(x, alone, sign, least, worst)
        real(wp), intent(inout) :: x(2, 2), alone(2)
        real(wp), intent(in) :: sign, least
        integer, intent(out) :: worst
        real(wp) :: d1, d2, r1, r2
        real(wp) :: l21, m21

        d1 = x(1, 1)
        worst = 1
        if (.not. sign*d1 > least*alone(1)) return
        r1 = 1.0_wp/d1
        l21 = x(2, 1)*r1
        d2 = x(2, 2) - l21*x(2, 1)
        worst = 2
        if (.not. sign*d2 > least*alone(2)) return
        r2 = 1.0_wp/d2
        worst = 0
        alone = sign*[d1, d2]/alone
        m21 = -l21
        l21 = r2*m21
        x(1, 1) = r1 + l21*m21
        x(2, 1) = l21
        x(2, 2) = r2
        x(1, 2) = x(2, 1)
    end subroutine invert_two

    !> Pivot by pivot, x := x - u u'/p with u = x(:, k): symmetric throughout, and every column is a vector.
    pure subroutine invert_sized(s, x, alone, sign, least, worst)
        integer, intent(in), value :: s
        real(wp), intent(inout) :: x(s, s), alone(s)
        real(wp), intent(in) :: sign, least
        integer, intent(out) :: worst
        real(wp) :: pivot, u(most_coordinates), v(most_coordinates)
        integer :: i, j, k

        worst = 0
        !GCC$ UNROLL 5
        do k = 1, s
            pivot = sign*x(k, k)
            if (.not. pivot > least*alone(k)) then
                worst = k
                return
            end if
            alone(k) = pivot/alone(k)
            pivot = 1.0_wp/x(k, k)
            do i = 1, s
                u(i) = x(i, k)
                v(i) = u(i)*pivot
            end do
            do j = 1, s
                do i = 1, s
                    x(i, j) = x(i, j) - u(i)*v(j)
                end do
            end do
            do i = 1, s
                x(i, k) = v(i)
                x(k, i) = v(i)
            end do
            x(k, k) = -pivot
        end do
        do j = 1, s
            do i = 1, s
                x(i, j) = -x(i, j)
            end do
        end do
    end subroutine invert_sized

    !> The same without the rows that are left out, whose rows and columns of the inverse are zero. With `chooses` pivots are
    !> sought, the largest first, and rows are left out that have none.
    pure subroutine invert_some(s, x, alone, sign, least, chooses, is_out, worst)
        integer, intent(in) :: s
        real(wp), intent(inout) :: x(s, s), alone(s)
        real(wp), intent(in) :: sign, least
        logical, intent(in) :: chooses
        logical, intent(inout) :: is_out(s)
        integer, intent(out) :: worst
        logical :: is_done(most_coordinates)
        real(wp) :: factor
        integer :: i, j, k, pass

        worst = 0
        is_done(:s) = is_out
        do pass = 1, s
            k = 0
            do i = 1, s
                if (is_done(i)) cycle
                if (k == 0) k = i
                if (chooses .and. sign*x(i, i)*alone(k) > sign*x(k, k)*alone(i)) k = i
            end do
            if (k == 0) exit
            is_done(k) = .true.
            factor = sign*x(k, k)
            if (.not. factor > least*alone(k)) then
                if (.not. (chooses .and. abs(factor) <= huge(1.0_wp))) then
                    worst = k
                    return
                end if
                is_out(k) = .true.
                cycle
            end if
            alone(k) = factor/alone(k)
            factor = 1.0_wp/x(k, k)
            x(k, k) = 1.0_wp
            x(:, k) = x(:, k)*factor
            do j = 1, s
                if (j == k) cycle
                factor = x(k, j)
                x(k, j) = 0.0_wp
                x(:, j) = x(:, j) - factor*x(:, k)
            end do
        end do
        do i = 1, s
            if (.not. is_out(i)) cycle
            ! What of it the others do not give.
            alone(i) = max(sign*x(i, i), 0.0_wp)/max(alone(i), tiny(1.0_wp))
            x(i, :) = 0.0_wp
            x(:, i) = 0.0_wp
        end do
    end subroutine invert_some
end module tandem_chart_sparse_inverses
