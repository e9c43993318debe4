! SPDX-License-Identifier: MIT
!> Inverses and products of the small blocks of a Newton matrix. The sizes of bodies with the row that they own and of the rows of
!> joints, 8 and 5 in space, 3 and 2 in the plane, are constants to the compiler: loops of known length are several times as fast.
module tandem_chart_sparse_newton_kernels
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: invert_pivoted, multiply, multiply_block, subtract, subtract_product

    !> The most unknowns of a node: a body's coordinates and the row that it owns. Work space of a fixed size stays in registers.
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

    !> y := a x for a (s, s).
    pure subroutine multiply(s, a, x, y)
        integer, intent(in), value :: s
        real(wp), intent(in) :: a(s*s), x(s)
        real(wp), intent(out) :: y(s)

        call multiply_block(s, 1, s, a, x, y)
    end subroutine multiply

    !> y := y - a x for a (p, s).
    pure subroutine subtract(p, s, a, x, y)
        integer, intent(in), value :: p, s
        real(wp), intent(in) :: a(p*s), x(s)
        real(wp), intent(inout) :: y(p)

        select case (16*p + s)
        case (16*8 + 8)
            call subtract_eight(8, a, x, y)
        case (16*8 + 5)
            call subtract_eight(5, a, x, y)
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
            call subtract_product_sized(p, 1, s, a, x, y)
        end select
    end subroutine subtract

    !> Eight rows, odd and even columns by themselves: neither sum waits for the other.
    pure subroutine subtract_eight(s, a, x, y)
        integer, intent(in), value :: s
        real(wp), intent(in) :: a(8, s), x(s)
        real(wp), intent(inout) :: y(8)
        real(wp) :: even(8), odd(8)
        integer :: i, k

        do i = 1, 8
            odd(i) = y(i) - a(i, 1)*x(1)
            even(i) = a(i, 2)*x(2)
        end do
        do k = 3, s - 1, 2
            do i = 1, 8
                odd(i) = odd(i) - a(i, k)*x(k)
                even(i) = even(i) + a(i, k + 1)*x(k + 1)
            end do
        end do
        if (modulo(s, 2) == 1) then
            do i = 1, 8
                odd(i) = odd(i) - a(i, s)*x(s)
            end do
        end if
        do i = 1, 8
            y(i) = odd(i) - even(i)
        end do
    end subroutine subtract_eight

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
