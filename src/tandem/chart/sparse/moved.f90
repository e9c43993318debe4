! SPDX-License-Identifier: MIT
!> Products with the inverses W of bodies' masses, compressed like the masses.
module tandem_chart_sparse_moved
    use tandem_chart_sparse_blocks, only: of_rigid_body, of_single_blocks
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: add_moved, apply_inverse

contains

    !> y := W c' (nb, s) for c (s, nb) and a body's W, compressed like its M.
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
end module tandem_chart_sparse_moved
