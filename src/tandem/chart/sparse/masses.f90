! SPDX-License-Identifier: MIT
!> The inverses of bodies' masses with their owned rows.
!>
!> A body with a row of its own, c'x = g, has the inverse W = N - u u'/(c'u), R = u/(c'u) with N = (M + a c c')^-1, u = N c: M need
!> be definite across c only, and any a > 0 gives the same result.
module tandem_chart_sparse_masses
    use tandem_chart_sparse_blocks, only: most_coordinates
    use tandem_chart_sparse_inverses, only: invert, invert_fives, side_by_side
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: invert_block, invert_rigid, least_mass

    !> A coordinate has no mass if its pivot falls to this part of its own diagonal entry.
    real(wp), parameter :: least_mass = 1.0e-14_wp

contains

    !> W and R of some rigid bodies in space, side by side. They are blocks of [M + a c c', c; c', 0]^-1.
    pure subroutine invert_rigid(n_bodies, first, has_row, n, mass, own, ldw, w, r, worst)
        !> At most `side_by_side` bodies, the first coordinate of each; true if it owns a row.
        integer, intent(in) :: n_bodies, first(side_by_side), n, ldw
        logical, intent(in) :: has_row(side_by_side)
        !> The compressed M, and the owned rows.
        real(wp), intent(in) :: mass(n, 4), own(n)
        real(wp), intent(inout) :: w(ldw, n), r(n)
        !> The first coordinate without mass of each, 0 for none.
        integer, intent(out) :: worst(side_by_side)
        real(wp) :: added, alone(side_by_side, 5), square, trace, x(side_by_side, 5, 5)
        integer :: b, i, j, l

        do l = 1, side_by_side
            ! Unused lanes repeat the first body.
            b = merge(l, 1, l <= n_bodies)
            associate (at => first(b) + 2)
                square = 0.0_wp
                if (has_row(b)) square = own(at + 1)**2 + own(at + 2)**2 + own(at + 3)**2 + own(at + 4)**2
                added = 0.0_wp
                if (square > 0.0_wp) then
                    trace = (mass(at + 1, 1) + mass(at + 2, 2)) + (mass(at + 3, 3) + mass(at + 4, 4))
                    added = merge(trace, 1.0_wp, trace > 0.0_wp)/square
                end if
                !GCC$ UNROLL 4
                do j = 1, 4
                    !GCC$ UNROLL 4
                    do i = 1, j
                        x(l, i, j) = mass(at + i, j) + added*own(at + i)*own(at + j)
                    end do
                    alone(l, j) = x(l, j, j)
                    x(l, j, 5) = merge(own(at + j), 0.0_wp, square > 0.0_wp)
                end do
                x(l, 5, 5) = merge(0.0_wp, 1.0_wp, square > 0.0_wp)
                ! The last pivot is -c'(M + a c c')^-1 c, which is -1/a if M c = 0.
                alone(l, 5) = 1.0_wp
                if (square > 0.0_wp) alone(l, 5) = -1.0_wp/added
            end associate
        end do
        call invert_fives(x, alone, least_mass, worst)
        do l = 1, n_bodies
            if (worst(l) > 0) worst(l) = worst(l) + 3
            do j = 3, 1, -1
                if (.not. mass(first(l) + j - 1, 1) > 0.0_wp) worst(l) = j
            end do
            if (worst(l) > 0) cycle
            associate (at => first(l) + 2)
                do j = at - 2, at
                    w(1, j) = 1.0_wp/mass(j, 1)
                    r(j) = 0.0_wp
                end do
                !GCC$ UNROLL 4
                do j = 1, 4
                    !GCC$ UNROLL 4
                    do i = 1, j
                        w(i, at + j) = x(l, i, j)
                        w(j, at + i) = x(l, i, j)
                    end do
                    r(at + j) = x(l, j, 5)
                end do
            end associate
        end do
    end subroutine invert_rigid

    !> W and R of one block of M. For a hub W is M + a c c' itself.
    pure subroutine invert_block(s, ld, mass, has_row, is_kept, c, ldw, w, r, added, n, worst)
        integer, intent(in) :: s, ld, ldw
        !> The block (s, s) in its position, rows and columns of the compressed M.
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
