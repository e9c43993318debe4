! SPDX-License-Identifier: MIT
!> The inverses of bodies' masses with the rows that they own.
!>
!> A body with a row of its own, c'x = g, has the inverse W = N - u u'/(c'u), R = u/(c'u) with N = (M + a c c')^-1, u = N c: M need
!> be definite across c only, and any a > 0 gives the same.
module tandem_chart_sparse_masses
    use tandem_chart_sparse_blocks, only: most_coordinates
    use tandem_chart_sparse_inverses, only: invert
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: invert_block, invert_rigid, least_mass

    !> A coordinate whose pivot falls to this part of what it would be alone carries no mass.
    real(wp), parameter :: least_mass = 1.0e-14_wp

contains

    !> W and R of a rigid body in space.
    pure subroutine invert_rigid(ld, mass, has_row, c, ldw, w, r, added, worst)
        integer, intent(in) :: ld, ldw
        !> In its places, rows and columns of the compressed M.
        real(wp), intent(in) :: mass(ld, 4)
        logical, intent(in) :: has_row
        !> The owned row.
        real(wp), intent(in) :: c(7)
        real(wp), intent(inout) :: w(ldw, 7), r(7), added
        !> The first coordinate without mass, 0 for none.
        integer, intent(out) :: worst
        real(wp) :: along, before(4), n(4, 4), square, trace, u(4)
        integer :: i, j

        do i = 1, 3
            if (.not. mass(i, 1) > 0.0_wp) then
                worst = i
                return
            end if
            w(1, i) = 1.0_wp/mass(i, 1)
            r(i) = 0.0_wp
        end do
        do j = 1, 4
            do i = 1, 4
                n(i, j) = mass(3 + i, j)
            end do
        end do
        square = 0.0_wp
        if (has_row) square = c(4)**2 + c(5)**2 + c(6)**2 + c(7)**2
        if (square > 0.0_wp) then
            trace = n(1, 1) + n(2, 2) + n(3, 3) + n(4, 4)
            added = merge(trace, 1.0_wp, trace > 0.0_wp)/square
            do j = 1, 4
                do i = 1, 4
                    n(i, j) = n(i, j) + added*c(3 + i)*c(3 + j)
                end do
            end do
        end if
        do i = 1, 4
            before(i) = n(i, i)
        end do
        call invert(4, n, before, 1.0_wp, least_mass, worst)
        if (worst > 0) then
            worst = worst + 3
            return
        end if
        if (square > 0.0_wp) then
            do i = 1, 4
                u(i) = (n(i, 1)*c(4) + n(i, 2)*c(5)) + (n(i, 3)*c(6) + n(i, 4)*c(7))
            end do
            along = 1.0_wp/((u(1)*c(4) + u(2)*c(5)) + (u(3)*c(6) + u(4)*c(7)))
            do j = 1, 4
                r(3 + j) = u(j)*along
                do i = 1, 4
                    n(i, j) = n(i, j) - u(i)*r(3 + j)
                end do
            end do
        end if
        do j = 1, 4
            do i = 1, 4
                w(i, 3 + j) = n(i, j)
            end do
        end do
    end subroutine invert_rigid

    !> W and R of one block of M. Of a kept body W is M + a c c' itself.
    pure subroutine invert_block(s, ld, mass, has_row, is_kept, c, ldw, w, r, added, n, worst)
        integer, intent(in) :: s, ld, ldw
        !> The block (s, s) in its places, rows and columns of the compressed M.
        real(wp), intent(in) :: mass(ld, s)
        logical, intent(in) :: has_row, is_kept
        !> The part of the owned row.
        real(wp), intent(in) :: c(s)
        real(wp), intent(inout) :: w(ldw, s), r(s), added
        !> Work space.
        real(wp), intent(inout) :: n(s, s)
        !> The first coordinate without mass, 0 for none.
        integer, intent(out) :: worst
        real(wp) :: square, trace, along, u(most_coordinates), before(most_coordinates)
        integer :: i, j

        trace = 0.0_wp
        square = 0.0_wp
        do i = 1, s
            trace = trace + mass(i, i)
            if (has_row) square = square + c(i)**2
        end do
        do j = 1, s
            do i = 1, s
                n(i, j) = mass(i, j)
            end do
        end do
        if (square > 0.0_wp) then
            added = merge(trace, 1.0_wp, trace > 0.0_wp)/square
            do j = 1, s
                do i = 1, s
                    n(i, j) = n(i, j) + added*c(i)*c(j)
                end do
            end do
        end if
        do i = 1, s
            before(i) = n(i, i)
        end do
        worst = 0
        if (is_kept) then
            do j = 1, s
                do i = 1, s
                    w(i, j) = n(i, j)
                end do
                if (.not. before(j) > 0.0_wp .and. worst == 0) worst = j
            end do
            return
        end if
        call invert(s, n, before(:s), 1.0_wp, least_mass, worst)
        if (worst > 0) return
        do j = 1, s
            do i = 1, s
                w(i, j) = n(i, j)
            end do
        end do
        if (.not. square > 0.0_wp) return
        along = 0.0_wp
        do i = 1, s
            u(i) = 0.0_wp
            do j = 1, s
                u(i) = u(i) + n(i, j)*c(j)
            end do
            along = along + u(i)*c(i)
        end do
        do j = 1, s
            r(j) = u(j)/along
            do i = 1, s
                w(i, j) = w(i, j) - u(i)*r(j)
            end do
        end do
    end subroutine invert_block
end module tandem_chart_sparse_masses
