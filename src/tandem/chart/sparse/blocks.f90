! SPDX-License-Identifier: MIT
!> Products and solutions of small blocks. The usual heights of joints, 5 in space and 2 in the plane, are compile-time constants:
!> loops of known length are several times as fast. Work space has a fixed size: with a length known only at run time, each call
!> would allocate it.
module tandem_chart_sparse_blocks
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: subtract_product, multiply_right, subtract_update, keep_rows
    public :: multiply_inverse, set_owned, subtract_rows, subtract_seven_rows, subtract_transposed, subtract_transposed_sized
    public :: of_single_blocks, of_rigid_body, of_any_blocks, most_coordinates, read_behind

    !> Largest number of coordinates of a body, and so of unknowns of a block.
    integer, parameter :: most_coordinates = 12
    !> At most this number of entries behind the last of a matrix are read, and ignored: columns of 5 rows are read as 8.
    integer, parameter :: read_behind = 3
    !> Kinds of blocks of a body's M: single entries, three single entries and one block of 4 by 4, or others.
    integer, parameter :: of_single_blocks = 1, of_rigid_body = 2, of_any_blocks = 3

contains

    !> x := x - c y for c (s, n), y (n, p), x (s, p). Up to `read_behind` entries behind c are read.
    pure subroutine subtract_product(s, p, n, c, y, x)
        integer, intent(in), value :: s, p, n
        real(wp), intent(in) :: c(*), y(n*p)
        real(wp), intent(inout) :: x(s*p)

        if (s == 5 .and. p == 5 .and. n == 7) then
            call subtract_five_product(5, 7, c, y, x)
        else if (s == 2 .and. p == 2 .and. n == 3) then
            call subtract_product_sized(2, 2, 2, 3, c, y, x)
        else if (s == 2 .and. p == 2 .and. n == 2) then
            call subtract_product_sized(2, 2, 2, 2, c, y, x)
        else if (s == 3 .and. p == 3 .and. n == 7) then
            call subtract_product_sized(3, 4, 3, 7, c, y, x)
        else if (s == 3 .and. p == 3 .and. n == 3) then
            call subtract_product_sized(3, 4, 3, 3, c, y, x)
        else if (s == 7 .and. p == 7 .and. n == 5) then
            call subtract_product_sized(7, 8, 7, 5, c, y, x)
        else if (s == 5) then
            call subtract_five_product(p, n, c, y, x)
        else
            call subtract_product_sized(s, s, p, n, c, y, x)
        end if
    end subroutine subtract_product

    !> Column by column like `subtract_five_rows`.
    pure subroutine subtract_five_product(p, n, c, y, x)
        integer, intent(in), value :: p, n
        real(wp), intent(in) :: c(5, n), y(n, p)
        real(wp), intent(inout) :: x(5, p)
        integer :: j

        do j = 1, p
            call subtract_five_rows(n, c, y(1, j), x(1, j))
        end do
    end subroutine subtract_five_product

    !> Columns are added as registers: lanes behind the last row are ignored.
    pure subroutine subtract_product_sized(s, lanes, p, n, c, y, x)
        integer, intent(in), value :: s, lanes, p, n
        real(wp), intent(in) :: c(*), y(n, p)
        real(wp), intent(inout) :: x(s, p)
        real(wp) :: total(most_coordinates)
        integer :: i, j, k

        do j = 1, p
            do i = 1, lanes
                total(i) = c(i)*y(1, j)
            end do
            do k = 2, n
                do i = 1, lanes
                    total(i) = total(i) + c((k - 1)*s + i)*y(k, j)
                end do
            end do
            do i = 1, s
                x(i, j) = x(i, j) - total(i)
            end do
        end do
    end subroutine subtract_product_sized

    !> l := b x for b (p, s), x (s, s); columns of l are `padded(p)` apart. Up to `read_behind` entries behind b are read.
    pure subroutine multiply_right(p, s, b, x, l)
        integer, intent(in), value :: p, s
        real(wp), intent(in) :: b(*), x(s*s)
        real(wp), intent(out) :: l(*)

        select case (p)
        case (5)
            if (s == 5) then
                call multiply_right_sized(5, 8, 5, b, x, l)
            else
                call multiply_right_sized(5, 8, s, b, x, l)
            end if
        case (3)
            if (s == 3) then
                call multiply_right_sized(3, 4, 3, b, x, l)
            else
                call multiply_right_sized(3, 4, s, b, x, l)
            end if
        case (2)
            if (s == 2) then
                call multiply_right_sized(2, 2, 2, b, x, l)
            else
                call multiply_right_sized(2, 2, s, b, x, l)
            end if
        case (1)
            call multiply_right_sized(1, 1, s, b, x, l)
        case (7)
            if (s == 5) then
                call multiply_right_sized(7, 8, 5, b, x, l)
            else
                call multiply_right_sized(7, 8, s, b, x, l)
            end if
        case default
            call multiply_right_sized(p, padded(p), s, b, x, l)
        end select
    end subroutine multiply_right

    pure subroutine multiply_right_sized(p, lanes, s, b, x, l)
        integer, intent(in), value :: p, lanes, s
        real(wp), intent(in) :: b(*), x(s, s)
        real(wp), intent(out) :: l(lanes, s)
        real(wp) :: total(most_coordinates)
        integer :: i, j, k

        do j = 1, s
            do i = 1, lanes
                total(i) = b(i)*x(1, j)
            end do
            do k = 2, s
                do i = 1, lanes
                    total(i) = total(i) + b((k - 1)*p + i)*x(k, j)
                end do
            end do
            do i = 1, lanes
                l(i, j) = total(i)
            end do
        end do
    end subroutine multiply_right_sized

    !> x := x - l b' for an l of `multiply_right` (p, s), b (q, s), x (p, q).
    pure subroutine subtract_update(p, q, s, l, b, x)
        integer, intent(in), value :: p, q, s
        real(wp), intent(in) :: l(*), b(q*s)
        real(wp), intent(inout) :: x(p*q)

        select case (p)
        case (5)
            if (q == 5 .and. s == 5) then
                call subtract_five_update(5, 5, l, b, x)
            else
                call subtract_update_sized(5, 8, q, s, l, b, x)
            end if
        case (3)
            if (q == 3 .and. s == 3) then
                call subtract_update_sized(3, 4, 3, 3, l, b, x)
            else
                call subtract_update_sized(3, 4, q, s, l, b, x)
            end if
        case (2)
            if (q == 2 .and. s == 2) then
                call subtract_update_sized(2, 2, 2, 2, l, b, x)
            else
                call subtract_update_sized(2, 2, q, s, l, b, x)
            end if
        case (1)
            call subtract_update_sized(1, 1, q, s, l, b, x)
        case (7)
            if (q == 7 .and. s == 5) then
                call subtract_seven_update(7, 5, l, b, x)
            else
                call subtract_update_sized(7, 8, q, s, l, b, x)
            end if
        case default
            call subtract_update_sized(p, padded(p), q, s, l, b, x)
        end select
    end subroutine subtract_update

    !> For five rows, like `subtract_five_rows`.
    pure subroutine subtract_five_update(q, s, l, b, x)
        integer, intent(in), value :: q, s
        real(wp), intent(in) :: l(8, s), b(q, s)
        real(wp), intent(inout) :: x(5, q)
        real(wp) :: t(4), r
        integer :: i, j, k

        do j = 1, q
            do i = 1, 4
                t(i) = x(i, j)
            end do
            r = x(5, j)
            !GCC$ UNROLL 5
            do k = 1, s
                do i = 1, 4
                    t(i) = t(i) - l(i, k)*b(j, k)
                end do
                r = r - l(5, k)*b(j, k)
            end do
            do i = 1, 4
                x(i, j) = t(i)
            end do
            x(5, j) = r
        end do
    end subroutine subtract_five_update

    !> Update of seven rows.
    pure subroutine subtract_seven_update(q, s, l, b, x)
        integer, intent(in), value :: q, s
        real(wp), intent(in) :: l(8, s), b(q, s)
        real(wp), intent(inout) :: x(7, q)
        real(wp) :: t(4), u(4)
        integer :: i, j, k

        do j = 1, q
            !GCC$ UNROLL 1
            do i = 1, 4
                t(i) = l(i, 1)*b(j, 1)
                u(i) = l(4 + i, 1)*b(j, 1)
            end do
            !GCC$ UNROLL 4
            do k = 2, s
                !GCC$ UNROLL 1
                do i = 1, 4
                    t(i) = t(i) + l(i, k)*b(j, k)
                    u(i) = u(i) + l(4 + i, k)*b(j, k)
                end do
            end do
            !GCC$ UNROLL 1
            do i = 1, 4
                x(i, j) = x(i, j) - t(i)
            end do
            x(5, j) = x(5, j) - u(1)
            x(6, j) = x(6, j) - u(2)
            x(7, j) = x(7, j) - u(3)
        end do
    end subroutine subtract_seven_update

    pure subroutine subtract_update_sized(p, lanes, q, s, l, b, x)
        integer, intent(in), value :: p, lanes, q, s
        real(wp), intent(in) :: l(lanes, s), b(q, s)
        real(wp), intent(inout) :: x(p, q)
        real(wp) :: total(most_coordinates)
        integer :: i, j, k

        do j = 1, q
            do i = 1, lanes
                total(i) = l(i, 1)*b(j, 1)
            end do
            do k = 2, s
                do i = 1, lanes
                    total(i) = total(i) + l(i, k)*b(j, k)
                end do
            end do
            do i = 1, p
                x(i, j) = x(i, j) - total(i)
            end do
        end do
    end subroutine subtract_update_sized

    !> Copy the l of `multiply_right` (p, s) without the padding of its columns.
    pure subroutine keep_rows(p, s, l, x)
        integer, intent(in), value :: p, s
        real(wp), intent(in) :: l(*)
        real(wp), intent(inout) :: x(p*s)

        select case (p)
        case (5)
            call keep_rows_sized(5, 8, s, l, x)
        case (3)
            call keep_rows_sized(3, 4, s, l, x)
        case (2)
            call keep_rows_sized(2, 2, s, l, x)
        case (1)
            call keep_rows_sized(1, 1, s, l, x)
        case (7)
            call keep_rows_sized(7, 8, s, l, x)
        case default
            call keep_rows_sized(p, padded(p), s, l, x)
        end select
    end subroutine keep_rows

    pure subroutine keep_rows_sized(p, lanes, s, l, x)
        integer, intent(in), value :: p, lanes, s
        real(wp), intent(in) :: l(lanes, s)
        real(wp), intent(inout) :: x(p, s)
        integer :: i, j

        do j = 1, s
            do i = 1, p
                x(i, j) = l(i, j)
            end do
        end do
    end subroutine keep_rows_sized

    !> Distance of columns of p rows in work space.
    pure integer function padded(p)
        integer, intent(in), value :: p

        padded = p
        if (p == 3) padded = 4
        if (p >= 5 .and. p <= 7) padded = 8
    end function padded

    !> z := x z for x (s, s). Up to `read_behind` entries behind x are read.
    pure subroutine multiply_inverse(s, x, z)
        integer, intent(in), value :: s
        real(wp), intent(in) :: x(*)
        real(wp), intent(inout) :: z(s)

        select case (s)
        case (5)
            call multiply_five(x, z)
        case (2)
            call multiply_inverse_sized(2, 2, x, z)
        case (3)
            call multiply_inverse_sized(3, 4, x, z)
        case default
            call multiply_inverse_sized(s, s, x, z)
        end select
    end subroutine multiply_inverse

    !> For five rows, like `subtract_five_rows`.
    pure subroutine multiply_five(x, z)
        real(wp), intent(in) :: x(5, 5)
        real(wp), intent(inout) :: z(5)
        real(wp) :: t(4), r
        integer :: i, j

        do i = 1, 4
            t(i) = x(i, 1)*z(1)
        end do
        r = x(5, 1)*z(1)
        !GCC$ UNROLL 4
        do j = 2, 5
            do i = 1, 4
                t(i) = t(i) + x(i, j)*z(j)
            end do
            r = r + x(5, j)*z(j)
        end do
        do i = 1, 4
            z(i) = t(i)
        end do
        z(5) = r
    end subroutine multiply_five

    pure subroutine multiply_inverse_sized(s, lanes, x, z)
        integer, intent(in), value :: s, lanes
        real(wp), intent(in) :: x(*)
        real(wp), intent(inout) :: z(s)
        real(wp) :: total(most_coordinates)
        integer :: i, j

        do i = 1, lanes
            total(i) = x(i)*z(1)
        end do
        do j = 2, s
            do i = 1, lanes
                total(i) = total(i) + x((j - 1)*s + i)*z(j)
            end do
        end do
        do i = 1, s
            z(i) = total(i)
        end do
    end subroutine multiply_inverse_sized

    !> x := r g.
    pure subroutine set_owned(nb, r, g, x)
        integer, intent(in), value :: nb
        real(wp), intent(in) :: r(nb), g
        real(wp), intent(out) :: x(nb)
        integer :: i

        if (nb == 7) then
            do i = 1, 7
                x(i) = r(i)*g
            end do
        else if (nb == 3) then
            do i = 1, 3
                x(i) = r(i)*g
            end do
        else
            do i = 1, nb
                x(i) = r(i)*g
            end do
        end if
    end subroutine set_owned

    !> g := g - c x for c (s, n). Up to `read_behind` entries behind c are read.
    pure subroutine subtract_rows(s, n, c, x, g)
        integer, intent(in), value :: s, n
        real(wp), intent(in) :: c(*), x(n)
        real(wp), intent(inout) :: g(s)

        select case (16*s + n)
        case (16*5 + 7)
            call subtract_five_rows(7, c, x, g)
        case (16*7 + 5)
            call subtract_seven_rows(5, c, x, g)
        case (16*5 + 5)
            call subtract_five_rows(5, c, x, g)
        case (16*2 + 3)
            call subtract_rows_sized(2, 2, 3, c, x, g)
        case (16*3 + 2)
            call subtract_rows_sized(3, 4, 2, c, x, g)
        case (16*2 + 2)
            call subtract_rows_sized(2, 2, 2, c, x, g)
        case (16*3 + 7)
            call subtract_rows_sized(3, 4, 7, c, x, g)
        case (16*7 + 3)
            call subtract_rows_sized(7, 8, 3, c, x, g)
        case (16*3 + 3)
            call subtract_rows_sized(3, 4, 3, c, x, g)
        case default
            if (s == 7) then
                call subtract_seven_rows(n, c, x, g)
            else if (s == 3) then
                call subtract_rows_sized(3, 4, n, c, x, g)
            else if (s == 1) then
                call subtract_rows_sized(1, 1, n, c, x, g)
            else
                call subtract_rows_sized(s, s, n, c, x, g)
            end if
        end select
    end subroutine subtract_rows

    !> Five rows do not fill whole registers and are processed as four and one: they are read as they were written, without a stall.
    pure subroutine subtract_five_rows(n, c, x, g)
        integer, intent(in), value :: n
        real(wp), intent(in) :: c(5, n), x(n)
        real(wp), intent(inout) :: g(5)
        real(wp) :: t(4), r
        integer :: i, j

        do i = 1, 4
            t(i) = g(i)
        end do
        r = g(5)
        !GCC$ UNROLL 7
        do j = 1, n
            do i = 1, 4
                t(i) = t(i) - c(i, j)*x(j)
            end do
            r = r - c(5, j)*x(j)
        end do
        do i = 1, 4
            g(i) = t(i)
        end do
        g(5) = r
    end subroutine subtract_five_rows

    !> Seven rows as four, two and one.
    pure subroutine subtract_seven_rows(n, c, x, g)
        integer, intent(in), value :: n
        real(wp), intent(in) :: c(7, n), x(n)
        real(wp), intent(inout) :: g(7)
        real(wp) :: t(4), u(2), r
        integer :: i, j

        do i = 1, 4
            t(i) = g(i)
        end do
        u(1) = g(5)
        u(2) = g(6)
        r = g(7)
        !GCC$ UNROLL 5
        do j = 1, n
            do i = 1, 4
                t(i) = t(i) - c(i, j)*x(j)
            end do
            u(1) = u(1) - c(5, j)*x(j)
            u(2) = u(2) - c(6, j)*x(j)
            r = r - c(7, j)*x(j)
        end do
        do i = 1, 4
            g(i) = t(i)
        end do
        g(5) = u(1)
        g(6) = u(2)
        g(7) = r
    end subroutine subtract_seven_rows

    !> Columns are added as registers: lanes behind the last row are ignored.
    pure subroutine subtract_rows_sized(s, lanes, n, c, x, g)
        integer, intent(in), value :: s, lanes, n
        real(wp), intent(in) :: c(*), x(n)
        real(wp), intent(inout) :: g(s)
        real(wp) :: total(most_coordinates)
        integer :: i, j

        do i = 1, lanes
            total(i) = c(i)*x(1)
        end do
        do j = 2, n
            do i = 1, lanes
                total(i) = total(i) + c((j - 1)*s + i)*x(j)
            end do
        end do
        do i = 1, s
            g(i) = g(i) - total(i)
        end do
    end subroutine subtract_rows_sized

    !> f := f - c' l for c (s, nb).
    pure subroutine subtract_transposed(s, nb, c, l, f)
        integer, intent(in), value :: s, nb
        real(wp), intent(in) :: c(s*nb), l(s)
        real(wp), intent(inout) :: f(nb)

        if (s == 5 .and. nb == 7) then
            call subtract_transposed_sized(5, 7, c, l, f)
        else if (s == 2 .and. nb == 3) then
            call subtract_transposed_sized(2, 3, c, l, f)
        else if (s == 5 .and. nb == 5) then
            call subtract_transposed_sized(5, 5, c, l, f)
        else if (s == 7 .and. nb == 5) then
            call subtract_transposed_sized(7, 5, c, l, f)
        else if (s == 2 .and. nb == 2) then
            call subtract_transposed_sized(2, 2, c, l, f)
        else if (s == 3 .and. nb == 7) then
            call subtract_transposed_sized(3, 7, c, l, f)
        else if (s == 3 .and. nb == 3) then
            call subtract_transposed_sized(3, 3, c, l, f)
        else
            call subtract_transposed_sized(s, nb, c, l, f)
        end if
    end subroutine subtract_transposed

    !> Variant for callers whose sizes are constants.
    pure subroutine subtract_transposed_sized(s, nb, c, l, f)
        integer, intent(in), value :: s, nb
        real(wp), intent(in) :: c(s, nb), l(s)
        real(wp), intent(inout) :: f(nb)
        real(wp) :: total
        integer :: i, j

        do j = 1, nb
            total = 0.0_wp
            do i = 1, s
                total = total + c(i, j)*l(i)
            end do
            f(j) = f(j) - total
        end do
    end subroutine subtract_transposed_sized
end module tandem_chart_sparse_blocks
