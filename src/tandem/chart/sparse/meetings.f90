! SPDX-License-Identifier: MIT
!> Bodies that are held by hinges in space, or by pins in the plane, alone. The first rows of such a joint make points of two bodies
!> coincident: there the columns of a body's position are the unit matrix with a sign, and in its other rows they are zero. So for a
!> link only the columns of the rotation are stored, at their offsets as if the columns of the position preceded them, and W c' as
!> the mobilities of the position with that sign (3 or 2), then W c' of the rotation, (4, 5) or (1, 2).
!> One body or node per call, with constant lengths.
module tandem_chart_sparse_meetings
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: of_hinges, of_pins, of_others, n_in_space, n_in_plane, n_of_place
    public :: send_in_space, send_own_in_space, send_in_plane, fetch_in_space, fetch_in_plane, multiply_in_space, multiply_in_plane
    public :: add_in_space, add_in_plane, leave_in_space, leave_in_plane, react_in_space

    !> Kinds of joints of a body, or of a node: hinges alone, pins alone, or others.
    integer, parameter :: of_others = 0, of_hinges = 1, of_pins = 2
    !> Number of stored values of W c' of a link; one of them stays zero, to fill registers.
    integer, parameter :: n_in_space = 24, n_in_plane = 4
    !> Entries of the list of links, see `analysis_type`.
    integer, parameter :: n_link = 6

contains

    !> Number of columns of a body's position that are the unit matrix with a sign: these are not stored.
    elemental integer function n_of_place(joints)
        !> Kind of the joints of the body.
        integer, intent(in) :: joints

        n_of_place = 0
        if (joints == of_hinges) n_of_place = 3
        if (joints == of_pins) n_of_place = 2
    end function n_of_place

    !> x = R g of a body, and its contribution to the nodes.
    pure subroutine send_own_in_space(n_links, link, r, g, sent, x, z)
        integer, intent(in), value :: n_links
        integer, intent(in) :: link(n_link, n_links)
        !> R of the body, the contribution of a unit of its own row to nodes, the right-hand side of that row.
        real(wp), intent(in) :: r(7), sent(6, n_links)
        real(wp), intent(in), value :: g
        real(wp), intent(out) :: x(7)
        real(wp), intent(inout) :: z(*)
        integer :: i, l

        do i = 1, 3
            x(i) = 0.0_wp
        end do
        do i = 4, 7
            x(i) = r(i)*g
        end do
        do l = 1, n_links
            associate (place => link(1, l))
                do i = 1, 5
                    z(place + i) = z(place + i) + sent(i, l)*g
                end do
            end associate
        end do
    end subroutine send_own_in_space

    !> x = W f + R g of a body, subtracted from its nodes.
    pure subroutine send_in_space(n_links, link, ldw, w, f, r, g, c, x, z)
        integer, intent(in), value :: n_links, ldw
        integer, intent(in) :: link(n_link, n_links)
        !> W and R of the body, the force, the right-hand side of its own row.
        real(wp), intent(in) :: w(ldw, 7), f(7), r(7), c(*)
        real(wp), intent(in), value :: g
        real(wp), intent(out) :: x(7)
        real(wp), intent(inout) :: z(*)
        real(wp) :: turn(4)
        integer :: i, l

        do i = 1, 4
            turn(i) = r(3 + i)*g + ((w(i, 4)*f(4) + w(i, 5)*f(5)) + (w(i, 6)*f(6) + w(i, 7)*f(7)))
        end do
        do i = 1, 3
            x(i) = w(1, i)*f(i)
        end do
        do i = 1, 4
            x(3 + i) = turn(i)
        end do
        do l = 1, n_links
            associate (place => link(1, l), sign => real(link(6, l), wp))
                do i = 1, 3
                    z(place + i) = z(place + i) - sign*x(i)
                end do
                call subtract_turn(c(link(3, l) + 16), turn, z(place + 1))
            end associate
        end do
    end subroutine send_in_space

    !> g := g - c x for the columns of the rotation.
    pure subroutine subtract_turn(c, x, g)
        real(wp), intent(in) :: c(5, 4), x(4)
        real(wp), intent(inout) :: g(5)
        real(wp) :: t(4), u
        integer :: i, j

        do i = 1, 4
            t(i) = g(i)
        end do
        u = g(5)
        !GCC$ UNROLL 4
        do j = 1, 4
            do i = 1, 4
                t(i) = t(i) - c(i, j)*x(j)
            end do
            u = u - c(5, j)*x(j)
        end do
        do i = 1, 4
            g(i) = t(i)
        end do
        g(5) = u
    end subroutine subtract_turn

    !> x = W f of a body in the plane, which owns no row, subtracted from its nodes.
    pure subroutine send_in_plane(n_links, link, ldw, w, f, c, x, z)
        integer, intent(in), value :: n_links, ldw
        integer, intent(in) :: link(n_link, n_links)
        real(wp), intent(in) :: w(ldw, 3), f(3), c(*)
        real(wp), intent(out) :: x(3)
        real(wp), intent(inout) :: z(*)
        integer :: i, l

        do i = 1, 3
            x(i) = w(1, i)*f(i)
        end do
        do l = 1, n_links
            associate (place => link(1, l), k => link(3, l) + 4, sign => real(link(6, l), wp))
                do i = 1, 2
                    z(place + i) = z(place + i) - (sign*x(i) + c(k + i)*x(3))
                end do
            end associate
        end do
    end subroutine send_in_plane

    !> x := x - W C' z of a body.
    pure subroutine fetch_in_space(n_links, link, y, z, x)
        integer, intent(in), value :: n_links
        integer, intent(in) :: link(n_link, n_links)
        real(wp), intent(in) :: y(*), z(*)
        real(wp), intent(inout) :: x(7)
        real(wp) :: turn(4)
        integer :: i, j, l

        do i = 1, 4
            turn(i) = x(3 + i)
        end do
        do l = 1, n_links
            associate (k => link(5, l), n => link(1, l))
                !GCC$ UNROLL 5
                do j = 1, 5
                    do i = 1, 4
                        turn(i) = turn(i) - y(k + 4*j + i)*z(n + j)
                    end do
                end do
            end associate
        end do
        do i = 1, 4
            x(3 + i) = turn(i)
        end do
        ! In a separate loop: the compiler would fill registers with positions and rotations alternately.
        !GCC$ UNROLL 1
        do l = 1, n_links
            do i = 1, 3
                x(i) = x(i) - y(link(5, l) + i)*z(link(1, l) + i)
            end do
        end do
    end subroutine fetch_in_space

    !> In the plane: x := x - W C' z of a body.
    pure subroutine fetch_in_plane(n_links, link, y, z, x)
        integer, intent(in), value :: n_links
        integer, intent(in) :: link(n_link, n_links)
        real(wp), intent(in) :: y(*), z(*)
        real(wp), intent(inout) :: x(3)
        integer :: l

        do l = 1, n_links
            associate (k => link(5, l), n => link(1, l))
                x(1) = x(1) - y(k + 1)*z(n + 1)
                x(2) = x(2) - y(k + 2)*z(n + 2)
                x(3) = x(3) - (y(k + 3)*z(n + 1) + y(k + 4)*z(n + 2))
            end associate
        end do
    end subroutine fetch_in_plane

    !> g := g - C x of a node.
    pure subroutine multiply_in_space(n_links, link, of_place, c, x, g)
        integer, intent(in), value :: n_links
        !> For each link the first coordinate, the number of coordinates, the offset in C, the sign.
        integer, intent(in) :: link(4, n_links)
        !> 1, or 0 if C is a difference, in which the columns of positions vanish.
        real(wp), intent(in), value :: of_place
        real(wp), intent(in) :: c(*), x(*)
        real(wp), intent(inout) :: g(5)
        real(wp) :: t(4), u, sign(4)
        integer :: i, j, l

        do i = 1, 4
            t(i) = g(i)
        end do
        u = g(5)
        sign(4) = 0.0_wp
        do l = 1, n_links
            associate (n => link(1, l), k => link(3, l) + 15)
                sign(1:3) = of_place*real(link(4, l), wp)
                do i = 1, 4
                    t(i) = t(i) - sign(i)*x(n - 1 + i)
                end do
                !GCC$ UNROLL 4
                do j = 1, 4
                    do i = 1, 4
                        t(i) = t(i) - c(k + 5*(j - 1) + i)*x(n + 2 + j)
                    end do
                    u = u - c(k + 5*j)*x(n + 2 + j)
                end do
            end associate
        end do
        do i = 1, 4
            g(i) = t(i)
        end do
        g(5) = u
    end subroutine multiply_in_space

    !> In the plane: g := g - C x of a node.
    pure subroutine multiply_in_plane(n_links, link, of_place, c, x, g)
        integer, intent(in), value :: n_links
        integer, intent(in) :: link(4, n_links)
        real(wp), intent(in), value :: of_place
        real(wp), intent(in) :: c(*), x(*)
        real(wp), intent(inout) :: g(2)
        integer :: i, l

        do l = 1, n_links
            associate (n => link(1, l), k => link(3, l) + 4, sign => of_place*real(link(4, l), wp))
                do i = 1, 2
                    g(i) = g(i) - (sign*x(n - 1 + i) + c(k + i)*x(n + 2))
                end do
            end associate
        end do
    end subroutine multiply_in_plane

    !> f := f - C' lambda of a body, but for its own row.
    pure subroutine react_in_space(n_links, link, of_place, c, lambda, f)
        integer, intent(in), value :: n_links
        integer, intent(in) :: link(n_link, n_links)
        !> See `multiply_in_space`; the multipliers by rows.
        real(wp), intent(in), value :: of_place
        real(wp), intent(in) :: c(*), lambda(*)
        real(wp), intent(inout) :: f(7)
        integer :: i, l

        do l = 1, n_links
            associate (k => link(3, l) + 10, n => link(4, l) - 1, sign => of_place*real(link(6, l), wp))
                do i = 1, 3
                    f(i) = f(i) - sign*lambda(n + i)
                end do
                do i = 1, 4
                    f(3 + i) = f(3 + i) - (((c(k + 5*i + 1)*lambda(n + 1) + c(k + 5*i + 2)*lambda(n + 2)) + &
                        (c(k + 5*i + 3)*lambda(n + 3) + c(k + 5*i + 4)*lambda(n + 4))) + c(k + 5*i + 5)*lambda(n + 5))
                end do
            end associate
        end do
    end subroutine react_in_space

    !> f - M x - C' lambda of a body; its own row balances the component along it.
    pure subroutine leave_in_space(n_links, link, ldm, mass, f, x, c, own, z, left)
        integer, intent(in), value :: n_links, ldm
        integer, intent(in) :: link(n_link, n_links)
        !> M of the body, compressed; the multipliers by nodes.
        real(wp), intent(in) :: mass(ldm, 4), f(7), x(7), c(*), own(7), z(*)
        real(wp), intent(out) :: left(7)
        real(wp) :: along, place(3), turn(4)
        integer :: i, l

        do i = 1, 3
            place(i) = f(i) - mass(i, 1)*x(i)
        end do
        do i = 1, 4
            turn(i) = f(3 + i) - ((mass(3 + i, 1)*x(4) + mass(3 + i, 2)*x(5)) + (mass(3 + i, 3)*x(6) + mass(3 + i, 4)*x(7)))
        end do
        do l = 1, n_links
            associate (k => link(3, l) + 10, n => link(1, l), sign => real(link(6, l), wp))
                do i = 1, 3
                    place(i) = place(i) - sign*z(n + i)
                end do
                do i = 1, 4
                    turn(i) = turn(i) - (((c(k + 5*i + 1)*z(n + 1) + c(k + 5*i + 2)*z(n + 2)) + &
                        (c(k + 5*i + 3)*z(n + 3) + c(k + 5*i + 4)*z(n + 4))) + c(k + 5*i + 5)*z(n + 5))
                end do
            end associate
        end do
        along = ((own(4)*turn(1) + own(5)*turn(2)) + (own(6)*turn(3) + own(7)*turn(4)))/ &
            max((own(4)**2 + own(5)**2) + (own(6)**2 + own(7)**2), tiny(1.0_wp))
        do i = 1, 3
            left(i) = place(i)
        end do
        do i = 1, 4
            left(3 + i) = turn(i) - along*own(3 + i)
        end do
    end subroutine leave_in_space

    !> In the plane: f - M x - C' lambda of a body.
    pure subroutine leave_in_plane(n_links, link, mass, f, x, c, z, left)
        integer, intent(in), value :: n_links
        integer, intent(in) :: link(n_link, n_links)
        real(wp), intent(in) :: mass(3), f(3), x(3), c(*), z(*)
        real(wp), intent(out) :: left(3)
        integer :: i, l

        do i = 1, 3
            left(i) = f(i) - mass(i)*x(i)
        end do
        do l = 1, n_links
            associate (k => link(3, l) + 4, n => link(1, l), sign => real(link(6, l), wp))
                left(1) = left(1) - sign*z(n + 1)
                left(2) = left(2) - sign*z(n + 2)
                left(3) = left(3) - (c(k + 1)*z(n + 1) + c(k + 2)*z(n + 2))
            end associate
        end do
    end subroutine leave_in_plane

    !> W c' of the links of a body, the contributions of its own row to nodes, and C W C' subtracted from the blocks of the nodes.
    pure subroutine add_in_space(n_links, link, ldw, w, r, pair_target, c, sent, y, blocks)
        integer, intent(in), value :: n_links, ldw
        integer, intent(in) :: link(n_link, n_links), pair_target(*)
        real(wp), intent(in) :: w(ldw, 7), r(7), c(*)
        real(wp), intent(out) :: sent(6, n_links)
        real(wp), intent(inout) :: y(*), blocks(*)
        integer :: d, i, j, k, l

        d = 0
        do l = 1, n_links
            associate (from => link(3, l) + 15, to => link(5, l), sign => real(link(6, l), wp))
                do i = 1, 3
                    y(to + i) = sign*w(1, i)
                end do
                y(to + 4) = 0.0_wp
                ! W is symmetric.
                do j = 1, 5
                    !GCC$ UNROLL 1
                    do i = 1, 4
                        y(to + 4*j + i) = (w(i, 4)*c(from + j) + w(i, 5)*c(from + 5 + j)) + &
                            (w(i, 6)*c(from + 10 + j) + w(i, 7)*c(from + 15 + j))
                    end do
                end do
                !GCC$ UNROLL 1
                do i = 1, 5
                    sent(i, l) = -((c(from + i)*r(4) + c(from + 5 + i)*r(5)) + (c(from + 10 + i)*r(6) + c(from + 15 + i)*r(7)))
                end do
                sent(6, l) = 0.0_wp
            end associate
            do k = 1, l
                d = d + 1
                ! The later node has the rows of the block.
                if (link(1, k) > link(1, l)) then
                    call subtract_in_space(c(link(3, k) + 16), link(6, k), y(link(5, l) + 1), blocks(pair_target(d) + 1))
                else
                    call subtract_in_space(c(link(3, l) + 16), link(6, l), y(link(5, k) + 1), blocks(pair_target(d) + 1))
                end if
            end do
        end do
    end subroutine add_in_space

    !> x := x - c y for the columns of the rotation of one link, its sign, and W c' of another.
    pure subroutine subtract_in_space(c, sign, y, x)
        real(wp), intent(in) :: c(5, 4), y(n_in_space)
        integer, intent(in), value :: sign
        real(wp), intent(inout) :: x(5, 5)
        integer :: i, j

        do j = 1, 5
            ! Kept as a loop, whose iterations fill one register.
            !GCC$ UNROLL 1
            do i = 1, 4
                x(i, j) = x(i, j) - ((c(i, 1)*y(4*j + 1) + c(i, 2)*y(4*j + 2)) + (c(i, 3)*y(4*j + 3) + c(i, 4)*y(4*j + 4)))
            end do
            x(5, j) = x(5, j) - ((c(5, 1)*y(4*j + 1) + c(5, 2)*y(4*j + 2)) + (c(5, 3)*y(4*j + 3) + c(5, 4)*y(4*j + 4)))
        end do
        do j = 1, 3
            x(j, j) = x(j, j) - sign*y(j)
        end do
    end subroutine subtract_in_space

    !> In the plane: W c' of the links of a body, and C W C' subtracted from the blocks of the nodes.
    pure subroutine add_in_plane(n_links, link, ldw, w, pair_target, c, y, blocks)
        integer, intent(in), value :: n_links, ldw
        integer, intent(in) :: link(n_link, n_links), pair_target(*)
        real(wp), intent(in) :: w(ldw, 3), c(*)
        real(wp), intent(inout) :: y(*), blocks(*)
        integer :: d, i, k, l

        d = 0
        do l = 1, n_links
            associate (from => link(3, l) + 4, to => link(5, l), sign => real(link(6, l), wp))
                do i = 1, 2
                    y(to + i) = sign*w(1, i)
                    y(to + 2 + i) = c(from + i)*w(1, 3)
                end do
            end associate
            do k = 1, l
                d = d + 1
                if (link(1, k) > link(1, l)) then
                    call subtract_in_plane(c(link(3, k) + 5), link(6, k), y(link(5, l) + 1), blocks(pair_target(d) + 1))
                else
                    call subtract_in_plane(c(link(3, l) + 5), link(6, l), y(link(5, k) + 1), blocks(pair_target(d) + 1))
                end if
            end do
        end do
    end subroutine add_in_plane

    pure subroutine subtract_in_plane(c, sign, y, x)
        real(wp), intent(in) :: c(2), y(n_in_plane)
        integer, intent(in), value :: sign
        real(wp), intent(inout) :: x(2, 2)
        integer :: i, j

        do j = 1, 2
            do i = 1, 2
                x(i, j) = x(i, j) - c(i)*y(2 + j)
            end do
            x(j, j) = x(j, j) - sign*y(j)
        end do
    end subroutine subtract_in_plane
end module tandem_chart_sparse_meetings
