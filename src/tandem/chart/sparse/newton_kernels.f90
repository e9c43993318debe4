! SPDX-License-Identifier: MIT
!> Inverses and products of the small blocks of a Newton matrix. The sizes of bodies with the row that they own and of the rows of
!> joints, 8 and 5 in space, 3 and 2 in the plane, are compile-time constants: loops of known length are several times as fast.
module tandem_chart_sparse_newton_kernels
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: copy, invert_pivoted, multiply, multiply_block, subtract, subtract_product

    !> Largest number of unknowns of a node, a body with the row that it owns. Work space of fixed size stays in registers.
    integer, parameter :: most = 13

contains

    !> The inverse in place, by Gauss and Jordan with exchanges of rows.
    pure subroutine invert_pivoted(s, x, is_regular)
        integer, intent(in) :: s
        real(wp), intent(inout) :: x(s, s)
        logical, intent(out) :: is_regular
        integer :: from(s), i, j, k, p
        real(wp) :: factor, kept

        is_regular = .true.
        do k = 1, s
            p = k
            do i = k + 1, s
                if (abs(x(i, k)) > abs(x(p, k))) p = i
            end do
            from(k) = p
            if (.not. (abs(x(p, k)) > 0.0_wp .and. abs(x(p, k)) <= huge(1.0_wp))) then
                is_regular = .false.
                return
            end if
            factor = 1.0_wp/x(p, k)
            x(p, k) = x(k, k)
            x(k, k) = 1.0_wp
            do j = 1, s
                if (j /= k) then
                    kept = x(p, j)
                    x(p, j) = x(k, j)
                    x(k, j) = kept
                end if
                x(k, j) = x(k, j)*factor
            end do
            do i = 1, s
                if (i == k) cycle
                factor = x(i, k)
                x(i, k) = 0.0_wp
                do j = 1, s
                    x(i, j) = x(i, j) - factor*x(k, j)
                end do
            end do
        end do
        do k = s, 1, -1
            p = from(k)
            if (p == k) cycle
            do i = 1, s
                kept = x(i, k)
                x(i, k) = x(i, p)
                x(i, p) = kept
            end do
        end do
    end subroutine invert_pivoted

    !> y := x: without a call for the lengths of bodies in space and of hinges.
    pure subroutine copy(n, x, y)
        integer, intent(in), value :: n
        real(wp), intent(in) :: x(n)
        real(wp), intent(inout) :: y(n)

        select case (n)
        case (8)
            y(1:8) = x(1:8)
        case (7)
            y(1:7) = x(1:7)
        case (5)
            y(1:5) = x(1:5)
        case default
            y(:) = x
        end select
    end subroutine copy

    !> y := a x for a (s, s).
    pure subroutine multiply(s, a, x, y)
        integer, intent(in), value :: s
        real(wp), intent(in) :: a(s*s), x(s)
        real(wp), intent(out) :: y(s)

        select case (s)
        case (8)
            call multiply_eight(a, x, y)
        case (5)
            call multiply_five(a, x, y)
        case default
            call multiply_block(s, 1, s, a, x, y)
        end select
    end subroutine multiply

    !> y := y - a x for a (p, s).
    pure subroutine subtract(p, s, a, x, y)
        integer, intent(in), value :: p, s
        real(wp), intent(in) :: a(p*s), x(s)
        real(wp), intent(inout) :: y(p)

        select case (16*p + s)
        case (16*8 + 8)
            call subtract_eight_by_eight(a, x, y)
        case (16*8 + 5)
            call subtract_eight_by_five(a, x, y)
        case (16*5 + 8)
            call subtract_five(8, a, x, y)
        case (16*5 + 5)
            call subtract_five(5, a, x, y)
        case (16*3 + 3)
            call subtract_product_sized(3, 1, 3, a, x, y)
        case (16*2 + 3)
            call subtract_product_sized(2, 1, 3, a, x, y)
        case (16*3 + 2)
            call subtract_product_sized(3, 1, 2, a, x, y)
        case (16*2 + 2)
            call subtract_product_sized(2, 1, 2, a, x, y)
        case default
            ! In a separate procedure: here loops of any length would make every call save their registers.
            call subtract_product(p, 1, s, a, x, y)
        end select
    end subroutine subtract

    !> y := y - a x for eight rows. Loops over rows are kept as loops, whose iterations fill registers, and sums are split, so that
    !> the last terms do not wait for all others.
    pure subroutine subtract_eight_by_eight(a, x, y)
        real(wp), intent(in) :: a(8, 8), x(8)
        real(wp), intent(inout) :: y(8)
        integer :: i

        !GCC$ UNROLL 1
        do i = 1, 8
            y(i) = y(i) - (((a(i, 1)*x(1) + a(i, 2)*x(2)) + (a(i, 3)*x(3) + a(i, 4)*x(4))) + &
                ((a(i, 5)*x(5) + a(i, 6)*x(6)) + (a(i, 7)*x(7) + a(i, 8)*x(8))))
        end do
    end subroutine subtract_eight_by_eight

    pure subroutine subtract_eight_by_five(a, x, y)
        real(wp), intent(in) :: a(8, 5), x(5)
        real(wp), intent(inout) :: y(8)
        integer :: i

        !GCC$ UNROLL 1
        do i = 1, 8
            y(i) = y(i) - (((a(i, 1)*x(1) + a(i, 2)*x(2)) + (a(i, 3)*x(3) + a(i, 4)*x(4))) + a(i, 5)*x(5))
        end do
    end subroutine subtract_eight_by_five

    !> y := a x for eight rows.
    pure subroutine multiply_eight(a, x, y)
        real(wp), intent(in) :: a(8, 8), x(8)
        real(wp), intent(out) :: y(8)
        integer :: i

        !GCC$ UNROLL 1
        do i = 1, 8
            y(i) = ((a(i, 1)*x(1) + a(i, 2)*x(2)) + (a(i, 3)*x(3) + a(i, 4)*x(4))) + &
                ((a(i, 5)*x(5) + a(i, 6)*x(6)) + (a(i, 7)*x(7) + a(i, 8)*x(8)))
        end do
    end subroutine multiply_eight

    pure subroutine multiply_five(a, x, y)
        real(wp), intent(in) :: a(5, 5), x(5)
        real(wp), intent(out) :: y(5)
        integer :: i

        !GCC$ UNROLL 1
        do i = 1, 4
            y(i) = ((a(i, 1)*x(1) + a(i, 2)*x(2)) + (a(i, 3)*x(3) + a(i, 4)*x(4))) + a(i, 5)*x(5)
        end do
        y(5) = ((a(5, 1)*x(1) + a(5, 2)*x(2)) + (a(5, 3)*x(3) + a(5, 4)*x(4))) + a(5, 5)*x(5)
    end subroutine multiply_five

    !> Five rows, four of them as one register.
    pure subroutine subtract_five(s, a, x, y)
        integer, intent(in), value :: s
        real(wp), intent(in) :: a(5, s), x(s)
        real(wp), intent(inout) :: y(5)
        real(wp) :: four(4), last
        integer :: i, k

        do i = 1, 4
            four(i) = y(i)
        end do
        last = y(5)
        !GCC$ UNROLL 8
        do k = 1, s
            do i = 1, 4
                four(i) = four(i) - a(i, k)*x(k)
            end do
            last = last - a(5, k)*x(k)
        end do
        do i = 1, 4
            y(i) = four(i)
        end do
        y(5) = last
    end subroutine subtract_five

    !> z := x y for x (p, s), y (s, q).
    pure subroutine multiply_block(p, q, s, x, y, z)
        integer, intent(in), value :: p, q, s
        real(wp), intent(in) :: x(p*s), y(s*q)
        real(wp), intent(out) :: z(p*q)

        select case (16*p + s)
        case (16*8 + 8)
            call multiply_block_sized(8, q, 8, x, y, z)
        case (16*5 + 8)
            call multiply_block_sized(5, q, 8, x, y, z)
        case (16*8 + 5)
            call multiply_block_sized(8, q, 5, x, y, z)
        case (16*5 + 5)
            call multiply_block_sized(5, q, 5, x, y, z)
        case (16*3 + 3)
            call multiply_block_sized(3, q, 3, x, y, z)
        case (16*2 + 3)
            call multiply_block_sized(2, q, 3, x, y, z)
        case (16*3 + 2)
            call multiply_block_sized(3, q, 2, x, y, z)
        case (16*2 + 2)
            call multiply_block_sized(2, q, 2, x, y, z)
        case default
            call multiply_block_sized(p, q, s, x, y, z)
        end select
    end subroutine multiply_block

    pure subroutine multiply_block_sized(p, q, s, x, y, z)
        integer, intent(in), value :: p, q, s
        real(wp), intent(in) :: x(p, s), y(s, q)
        real(wp), intent(out) :: z(p, q)
        real(wp) :: column(most)
        integer :: i, j, k

        do j = 1, q
            do i = 1, p
                column(i) = x(i, 1)*y(1, j)
            end do
            do k = 2, s
                do i = 1, p
                    column(i) = column(i) + x(i, k)*y(k, j)
                end do
            end do
            do i = 1, p
                z(i, j) = column(i)
            end do
        end do
    end subroutine multiply_block_sized

    !> x := x - a b for a (p, s), b (s, q), x (p, q).
    pure subroutine subtract_product(p, q, s, a, b, x)
        integer, intent(in), value :: p, q, s
        real(wp), intent(in) :: a(p*s), b(s*q)
        real(wp), intent(inout) :: x(p*q)

        select case (16*p + s)
        case (16*8 + 8)
            call subtract_product_sized(8, q, 8, a, b, x)
        case (16*5 + 8)
            call subtract_product_sized(5, q, 8, a, b, x)
        case (16*8 + 5)
            call subtract_product_sized(8, q, 5, a, b, x)
        case (16*5 + 5)
            call subtract_product_sized(5, q, 5, a, b, x)
        case (16*3 + 3)
            call subtract_product_sized(3, q, 3, a, b, x)
        case (16*2 + 3)
            call subtract_product_sized(2, q, 3, a, b, x)
        case (16*3 + 2)
            call subtract_product_sized(3, q, 2, a, b, x)
        case (16*2 + 2)
            call subtract_product_sized(2, q, 2, a, b, x)
        case default
            call subtract_product_sized(p, q, s, a, b, x)
        end select
    end subroutine subtract_product

    pure subroutine subtract_product_sized(p, q, s, a, b, x)
        integer, intent(in), value :: p, q, s
        real(wp), intent(in) :: a(p, s), b(s, q)
        real(wp), intent(inout) :: x(p, q)
        real(wp) :: column(most)
        integer :: i, j, k

        do j = 1, q
            do i = 1, p
                column(i) = x(i, j)
            end do
            do k = 1, s
                do i = 1, p
                    column(i) = column(i) - a(i, k)*b(k, j)
                end do
            end do
            do i = 1, p
                x(i, j) = column(i)
            end do
        end do
    end subroutine subtract_product_sized
end module tandem_chart_sparse_newton_kernels
