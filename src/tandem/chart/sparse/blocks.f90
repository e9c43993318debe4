! SPDX-License-Identifier: MIT
!> Products, inverses and solutions of small blocks. Heights that joints have, 5 in space and 2 in the plane, are constants to the
!> compiler: loops of known length are several times as fast. Work space has a fixed size: of a length that is known at run time it
!> would be allocated by each call.
module tandem_chart_sparse_blocks
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: invert, invert_some, subtract_product, multiply_transposed, apply_inverse
    public :: multiply_inverse, set_owned, subtract_rows, subtract_transposed, add_moved
    public :: of_single_blocks, of_rigid_body, of_any_blocks, most_coordinates, read_behind

    !> The most coordinates of a body, and so the most unknowns of a block.
    integer, parameter :: most_coordinates = 12
    !> At most so many entries behind the last of a matrix are read, and go nowhere: columns of 5 rows are read as 8.
    integer, parameter :: read_behind = 3
    !> The blocks of a body's M: single entries, three of them and one of 4 by 4, or others.
    integer, parameter :: of_single_blocks = 1, of_rigid_body = 2, of_any_blocks = 3

contains

    !> The inverse of a symmetric matrix in place, definite with the sign; pivots are compared with what they would be alone.
    pure subroutine invert(s, x, alone, sign, least, worst)
        integer, intent(in) :: s
        real(wp), intent(inout) :: x(s*s)
        !> On entry the comparison, then the pivots against it.
        real(wp), intent(inout) :: alone(s)
        real(wp), intent(in) :: sign, least
        !> The first pivot that is not larger than the least part of that, 0 for none.
        integer, intent(out) :: worst

        select case (s)
        case (5)
            call invert_sized(5, x, alone, sign, least, worst)
        case (2)
            call invert_sized(2, x, alone, sign, least, worst)
        case (4)
            call invert_sized(4, x, alone, sign, least, worst)
        case (3)
            call invert_sized(3, x, alone, sign, least, worst)
        case (1)
            call invert_sized(1, x, alone, sign, least, worst)
        case default
            call invert_sized(s, x, alone, sign, least, worst)
        end select
    end subroutine invert

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

    !> x := x - c y for c (s, n), y (n, p), x (s, p). Up to `read_behind` entries behind c are read.
    pure subroutine subtract_product(s, p, n, c, y, x)
        integer, intent(in), value :: s, p, n
        real(wp), intent(in) :: c(*), y(n*p)
        real(wp), intent(inout) :: x(s*p)

        if (s == 5 .and. p == 5 .and. n == 7) then
            call subtract_product_sized(5, 8, 5, 7, c, y, x)
        else if (s == 5 .and. p == 5 .and. n == 5) then
            call subtract_product_sized(5, 8, 5, 5, c, y, x)
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
            call subtract_product_sized(5, 8, p, n, c, y, x)
        else
            call subtract_product_sized(s, s, p, n, c, y, x)
        end if
    end subroutine subtract_product

    !> Columns are added as registers: lanes behind the last row hold what nobody uses.
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

    !> z := x y' for a symmetric x (s, s) and y (p, s), z (s, p). Up to `read_behind` entries behind x are read.
    pure subroutine multiply_transposed(s, p, x, y, z)
        integer, intent(in), value :: s, p
        real(wp), intent(in) :: x(*), y(p*s)
        real(wp), intent(out) :: z(s*p)

        if (s == 5 .and. p == 5) then
            call multiply_transposed_sized(5, 8, 5, x, y, z)
        else if (s == 5) then
            call multiply_transposed_sized(5, 8, p, x, y, z)
        else if (s == 2 .and. p == 2) then
            call multiply_transposed_sized(2, 2, 2, x, y, z)
        else
            call multiply_transposed_sized(s, s, p, x, y, z)
        end if
    end subroutine multiply_transposed

    pure subroutine multiply_transposed_sized(s, lanes, p, x, y, z)
        integer, intent(in), value :: s, lanes, p
        real(wp), intent(in) :: x(*), y(p, s)
        real(wp), intent(out) :: z(s, p)
        real(wp) :: total(most_coordinates)
        integer :: i, j, k

        do j = 1, p
            do i = 1, lanes
                total(i) = x(i)*y(j, 1)
            end do
            do k = 2, s
                do i = 1, lanes
                    total(i) = total(i) + x((k - 1)*s + i)*y(j, k)
                end do
            end do
            do i = 1, s
                z(i, j) = total(i)
            end do
        end do
    end subroutine multiply_transposed_sized

    !> y := W c' (nb, s) for c (s, nb) and a body's W, compressed as its M.
    pure subroutine apply_inverse(kind, s, nb, block_first, first, ldw, w, c, y)
        integer, intent(in) :: kind, s, nb, block_first(nb), first, ldw
        real(wp), intent(in) :: w(ldw, nb), c(s*nb)
        real(wp), intent(out) :: y(nb*s)

        if (kind == of_rigid_body .and. s == 5) then
            call apply_rigid(5, ldw, w, c, y)
        else if (kind == of_rigid_body) then
            call apply_rigid(s, ldw, w, c, y)
        else if (kind == of_single_blocks .and. s == 2 .and. nb == 3) then
            call apply_single(2, 3, ldw, w, c, y)
        else if (kind == of_single_blocks) then
            call apply_single(s, nb, ldw, w, c, y)
        else
            call apply_any(s, nb, block_first, first, ldw, w, c, y)
        end if
    end subroutine apply_inverse

    pure subroutine apply_single(s, nb, ldw, w, c, y)
        integer, intent(in), value :: s, nb, ldw
        real(wp), intent(in) :: w(ldw, nb), c(s, nb)
        real(wp), intent(out) :: y(nb, s)
        integer :: i, j

        do i = 1, s
            do j = 1, nb
                y(j, i) = c(i, j)*w(1, j)
            end do
        end do
    end subroutine apply_single

    pure subroutine apply_rigid(s, ldw, w, c, y)
        integer, intent(in), value :: s, ldw
        real(wp), intent(in) :: w(ldw, 7), c(s, 7)
        real(wp), intent(out) :: y(7, s)
        integer :: i, j

        do i = 1, s
            do j = 1, 3
                y(j, i) = c(i, j)*w(1, j)
            end do
            ! W is symmetric.
            do j = 1, 4
                y(3 + j, i) = (w(j, 4)*c(i, 4) + w(j, 5)*c(i, 5)) + (w(j, 6)*c(i, 6) + w(j, 7)*c(i, 7))
            end do
        end do
    end subroutine apply_rigid

    pure subroutine apply_any(s, nb, block_first, first, ldw, w, c, y)
        integer, intent(in) :: s, nb, block_first(nb), first, ldw
        real(wp), intent(in) :: w(ldw, nb), c(s, nb)
        real(wp), intent(out) :: y(nb, s)
        integer :: i, j, k, from

        do j = 1, nb
            from = block_first(j) - first + 1
            do i = 1, s
                y(j, i) = c(i, from)*w(1, j)
            end do
            do k = from + 1, nb
                if (block_first(k) /= block_first(j)) exit
                do i = 1, s
                    y(j, i) = y(j, i) + c(i, k)*w(k - from + 1, j)
                end do
            end do
        end do
    end subroutine apply_any

    !> z := x z for x (s, s), and a copy of it. Up to `read_behind` entries behind x are read.
    pure subroutine multiply_inverse(s, x, z, y)
        integer, intent(in), value :: s
        real(wp), intent(in) :: x(*)
        real(wp), intent(inout) :: z(s)
        real(wp), intent(out) :: y(s)

        select case (s)
        case (5)
            call multiply_inverse_sized(5, 8, x, z, y)
        case (2)
            call multiply_inverse_sized(2, 2, x, z, y)
        case (3)
            call multiply_inverse_sized(3, 4, x, z, y)
        case default
            call multiply_inverse_sized(s, s, x, z, y)
        end select
    end subroutine multiply_inverse

    pure subroutine multiply_inverse_sized(s, lanes, x, z, y)
        integer, intent(in), value :: s, lanes
        real(wp), intent(in) :: x(*)
        real(wp), intent(inout) :: z(s)
        real(wp), intent(out) :: y(s)
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
            y(i) = total(i)
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
            call subtract_rows_sized(5, 8, 7, c, x, g)
        case (16*7 + 5)
            call subtract_rows_sized(7, 8, 5, c, x, g)
        case (16*5 + 5)
            call subtract_rows_sized(5, 8, 5, c, x, g)
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
                call subtract_rows_sized(7, 8, n, c, x, g)
            else if (s == 3) then
                call subtract_rows_sized(3, 4, n, c, x, g)
            else if (s == 1) then
                call subtract_rows_sized(1, 1, n, c, x, g)
            else
                call subtract_rows_sized(s, s, n, c, x, g)
            end if
        end select
    end subroutine subtract_rows

    !> Columns are added as registers: lanes behind the last row hold what nobody uses.
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

    !> x := x + W f for a body.
    pure subroutine add_moved(kind, nb, block_first, ldw, w, f, x)
        integer, intent(in), value :: kind, nb, ldw
        !> The first coordinates of the blocks of its M.
        integer, intent(in) :: block_first(nb)
        real(wp), intent(in) :: w(ldw, nb), f(nb)
        real(wp), intent(inout) :: x(nb)
        real(wp) :: moved(4)
        integer :: from, j, k

        if (kind == of_rigid_body) then
            do k = 1, 4
                moved(k) = (w(k, 4)*f(4) + w(k, 5)*f(5)) + (w(k, 6)*f(6) + w(k, 7)*f(7))
            end do
            do j = 1, 3
                x(j) = x(j) + w(1, j)*f(j)
            end do
            do k = 1, 4
                x(3 + k) = x(3 + k) + moved(k)
            end do
        else if (kind == of_single_blocks .and. nb == 3) then
            do j = 1, 3
                x(j) = x(j) + w(1, j)*f(j)
            end do
        else if (kind == of_single_blocks) then
            do j = 1, nb
                x(j) = x(j) + w(1, j)*f(j)
            end do
        else
            do j = 1, nb
                from = block_first(j) - block_first(1) + 1
                do k = from, nb
                    if (block_first(k) /= block_first(j)) exit
                    x(k) = x(k) + w(k - from + 1, j)*f(j)
                end do
            end do
        end if
    end subroutine add_moved
end module tandem_chart_sparse_blocks
