! SPDX-License-Identifier: MIT
!> Solutions with a factor by blocks, and products with C: the most frequent operations of a step. Loops use contiguous lists.
submodule(tandem_chart_sparse_factor) tandem_chart_sparse_solve
    use tandem_chart_sparse_blocks, only: multiply_inverse, set_owned, subtract_rows, subtract_seven_rows, &
        subtract_transposed, subtract_transposed_sized
    use tandem_chart_sparse_meetings, only: fetch_in_plane, fetch_in_space, leave_in_plane, leave_in_space, &
        multiply_in_plane, multiply_in_space, n_of_place, of_hinges, of_others, of_pins, react_in_space, send_in_plane, &
        send_in_space, send_own_in_space
    use tandem_chart_sparse_moved, only: add_moved
    implicit none (type, external)

contains

    !> Bodies forward, nodes forward and back, bodies back.
    module procedure solve
        call scatter(a%n_nodes, a%node, a%is_body, g, z)
        call send_bodies(self, a, size(a%link, 2), a%body, a%link, has_force, f, g, x, z)
        call solve_nodes(a%n_nodes, size(a%behind, 2), a%node, a%later_start, a%behind, self%blocks, z)
        call fetch_bodies(self, a, size(a%link, 2), a%body, a%link, self%y, x, z)
    end procedure solve

    !> g by nodes, zeros for hubs.
    pure subroutine scatter(n_nodes, node, is_body, g, z)
        integer, intent(in) :: n_nodes, node(4, n_nodes)
        logical, intent(in) :: is_body(n_nodes)
        real(wp), intent(in) :: g(*)
        real(wp), intent(inout) :: z(*)
        integer :: i, n

        do n = 1, n_nodes
            associate (place => node(1, n), origin => node(4, n))
                if (is_body(n)) then
                    do i = 1, node(2, n)
                        z(place + i) = 0.0_wp
                    end do
                    cycle
                end if
                ! A copy of variable length would be a call.
                select case (node(2, n))
                case (5)
                    do i = 1, 5
                        z(place + i) = g(origin + i - 1)
                    end do
                case (2)
                    z(place + 1) = g(origin)
                    z(place + 2) = g(origin + 1)
                case (3)
                    do i = 1, 3
                        z(place + i) = g(origin + i - 1)
                    end do
                case (1)
                    z(place + 1) = g(origin)
                case default
                    do i = 1, node(2, n)
                        z(place + i) = g(origin + i - 1)
                    end do
                end select
            end associate
        end do
    end subroutine scatter

    !> x = W f + R g of each body that is eliminated first, subtracted from its nodes.
    pure subroutine send_bodies(self, a, n_links, body, link, has_force, f, g, x, z)
        class(factor_type), intent(in) :: self
        type(analysis_type), intent(in) :: a
        integer, intent(in) :: n_links, body(5, a%n_bodies), link(6, n_links)
        logical, intent(in) :: has_force
        real(wp), intent(in) :: f(a%n), g(a%m)
        real(wp), intent(inout) :: x(a%n), z(a%n_unknowns)
        integer :: b

        do b = 1, a%n_bodies
            if (body(5, b) == of_others) call send_body(self, a, b, has_force, f, g, x, z)
        end do
        if (has_force) then
            call send_moved(a%n_bodies, n_links, size(self%w, 1), body, link, self%w, self%r, self%c, f, g, x, z)
        else
            call send_all_own(a%n_bodies, n_links, body, link, self%r, self%sent, g, x, z)
        end if
    end subroutine send_bodies

    !> x = W f + R g of the bodies that are held by hinges or pins alone.
    pure subroutine send_moved(n_bodies, n_links, ldw, body, link, w, r, c, f, g, x, z)
        integer, intent(in) :: n_bodies, n_links, ldw, body(5, n_bodies), link(6, n_links)
        real(wp), intent(in) :: w(ldw, *), r(*), c(*), f(*), g(*)
        real(wp), intent(inout) :: x(*), z(*)
        integer :: b

        do b = 1, n_bodies
            associate (first => body(1, b), from => body(2, b), count => body(3, b))
                if (body(5, b) == of_hinges) then
                    call send_in_space(count, link(1, from), ldw, w(1, first), f(first), r(first), g(body(4, b)), c, x(first), z)
                else if (body(5, b) == of_pins) then
                    call send_in_plane(count, link(1, from), ldw, w(1, first), f(first), c, x(first), z)
                end if
            end associate
        end do
    end subroutine send_moved

    !> Contributions of the owned rows of these bodies alone.
    pure subroutine send_all_own(n_bodies, n_links, body, link, r, sent, g, x, z)
        integer, intent(in) :: n_bodies, n_links, body(5, n_bodies), link(6, n_links)
        real(wp), intent(in) :: r(*), sent(most_rows, *), g(*)
        real(wp), intent(inout) :: x(*), z(*)
        integer :: b, i

        do b = 1, n_bodies
            associate (first => body(1, b), from => body(2, b))
                if (body(5, b) == of_hinges) then
                    call send_own_in_space(body(3, b), link(1, from), r(first), g(body(4, b)), sent(1, from), x(first), z)
                else if (body(5, b) == of_pins) then
                    do i = first, first + 2
                        x(i) = 0.0_wp
                    end do
                end if
            end associate
        end do
    end subroutine send_all_own

    !> x = W f + R g of one body with other rows, or none.
    pure subroutine send_body(self, a, b, has_force, f, g, x, z)
        class(factor_type), intent(in) :: self
        type(analysis_type), intent(in) :: a
        integer, intent(in) :: b
        logical, intent(in) :: has_force
        real(wp), intent(in) :: f(a%n), g(a%m)
        real(wp), intent(inout) :: x(a%n), z(a%n_unknowns)
        integer :: i
        real(wp) :: g_own

        g_own = 0.0_wp
        if (a%norm_row(b) > 0) g_own = g(a%norm_row(b))
        associate (first => a%first(b), nb => a%first(b + 1) - a%first(b), from => a%link_start(b), &
            n_links => a%link_start(b + 1) - a%link_start(b))
            if (a%is_kept(b)) then
                associate (place => a%place(a%node_of_body(b)))
                    do i = 1, nb
                        if (has_force) z(place + i) = f(first + i - 1)
                        if (a%norm_row(b) > 0) z(place + i) = z(place + i) + self%added(b)*self%own(first + i - 1)*g_own
                    end do
                end associate
                return
            end if
            call set_owned(nb, self%r(first), g_own, x(first))
            if (has_force) call add_moved(a%kind(b), nb, a%block_first(first), size(self%w, 1), self%w(1, first), f(first), &
                x(first))
            if (n_links == 0) return
            if (has_force) then
                call send_links(nb, n_links, a%link(1, from), self%c, x(first), z)
            else if (a%norm_row(b) > 0) then
                call send_own(n_links, a%link(1, from), self%sent(1, from), g_own, z)
            end if
        end associate
    end subroutine send_body

    !> z := z - C x for the links of a body.
    pure subroutine send_links(nb, n_links, link, c, x, z)
        integer, intent(in) :: nb, n_links, link(6, n_links)
        real(wp), intent(in) :: c(*), x(nb)
        real(wp), intent(inout) :: z(*)
        integer :: l

        do l = 1, n_links
            associate (place => link(1, l), s => link(2, l), offset => link(3, l))
                call subtract_rows(s, nb, c(offset + 1), x, z(place + 1))
            end associate
        end do
    end subroutine send_links

    !> Contributions of the body's own row.
    pure subroutine send_own(n_links, link, sent, g_own, z)
        integer, intent(in) :: n_links, link(6, n_links)
        real(wp), intent(in) :: sent(most_rows, n_links), g_own
        real(wp), intent(inout) :: z(*)
        integer :: i, l

        do l = 1, n_links
            associate (place => link(1, l))
                ! A loop of variable length would be a call.
                if (link(2, l) == 5) then
                    do i = 1, 5
                        z(place + i) = z(place + i) + sent(i, l)*g_own
                    end do
                else
                    do i = 1, link(2, l)
                        z(place + i) = z(place + i) + sent(i, l)*g_own
                    end do
                end if
            end associate
        end do
    end subroutine send_own

    !> x := x - W C' z of each body that is eliminated first; hubs copy theirs from z.
    pure subroutine fetch_bodies(self, a, n_links, body, link, y, x, z)
        class(factor_type), intent(in) :: self
        type(analysis_type), intent(in) :: a
        integer, intent(in) :: n_links, body(5, a%n_bodies), link(6, n_links)
        real(wp), intent(in) :: y(*), z(*)
        real(wp), intent(inout) :: x(a%n)
        integer :: b

        do b = 1, a%n_bodies
            associate (first => body(1, b), from => body(2, b), count => body(3, b))
                if (body(5, b) == of_hinges) then
                    call fetch_in_space(count, link(1, from), y, z, x(first))
                else if (body(5, b) == of_pins) then
                    call fetch_in_plane(count, link(1, from), y, z, x(first))
                else
                    call fetch_body(self, a, b, x, z)
                end if
            end associate
        end do
    end subroutine fetch_bodies

    !> x := x - W C' z of one body with other rows, or none.
    pure subroutine fetch_body(self, a, b, x, z)
        class(factor_type), intent(in) :: self
        type(analysis_type), intent(in) :: a
        integer, intent(in) :: b
        real(wp), intent(inout) :: x(a%n)
        real(wp), intent(in) :: z(a%n_unknowns)
        integer :: i

        associate (first => a%first(b), nb => a%first(b + 1) - a%first(b), from => a%link_start(b))
            if (a%is_kept(b)) then
                do i = 1, nb
                    x(first + i - 1) = z(a%place(a%node_of_body(b)) + i)
                end do
            else if (a%link_start(b + 1) > from) then
                call fetch_links(nb, a%link_start(b + 1) - from, a%link(1, from), self%y, z, x(first))
            end if
        end associate
    end subroutine fetch_body

    !> x := x - y z for the links of a body.
    pure subroutine fetch_links(nb, n_links, link, y, z, x)
        integer, intent(in) :: nb, n_links, link(6, n_links)
        real(wp), intent(in) :: y(*), z(*)
        real(wp), intent(inout) :: x(nb)
        integer :: l

        do l = 1, n_links
            associate (place => link(1, l), s => link(2, l), offset => link(5, l))
                call subtract_rows(nb, s, y(offset + 1), z(place + 1), x)
            end associate
        end do
    end subroutine fetch_links

    !> K z = z in place. Between dependent nodes there is one product: the product with D^-1 is delayed off this path.
    pure subroutine solve_nodes(n_nodes, n_behind, node, later_start, behind, blocks, z)
        integer, intent(in) :: n_nodes, n_behind, node(4, n_nodes), later_start(n_nodes + 1), behind(3, n_behind)
        real(wp), intent(in) :: blocks(*)
        real(wp), intent(inout) :: z(*)
        integer :: n

        do n = 1, n_nodes
            associate (from => later_start(n), later => later_start(n + 1) - later_start(n))
                call eliminate_node(node(2, n), node(1, n), later, behind(1, from), blocks, z)
            end associate
        end do
        do n = n_nodes, 1, -1
            associate (from => later_start(n), later => later_start(n + 1) - later_start(n))
                call find_node(node(2, n), node(1, n), node(3, n), later, behind(1, from), blocks, z)
            end associate
        end do
    end subroutine solve_nodes

    !> Subtract the contributions of a node from later nodes.
    pure subroutine eliminate_node(s, place, n_later, behind, blocks, z)
        integer, intent(in), value :: s, place, n_later
        integer, intent(in) :: behind(3, n_later)
        real(wp), intent(in) :: blocks(*)
        real(wp), intent(inout) :: z(*)
        integer :: k

        do k = 1, n_later
            if (s == 5 .and. behind(2, k) == 5) then
                call subtract_five(blocks(behind(3, k) + 1), z(place + 1), z(behind(1, k) + 1))
            else if (s == 5 .and. behind(2, k) == 7) then
                call subtract_seven_rows(5, blocks(behind(3, k) + 1), z(place + 1), z(behind(1, k) + 1))
            else
                call subtract_rows(behind(2, k), s, blocks(behind(3, k) + 1), z(place + 1), z(behind(1, k) + 1))
            end if
        end do
    end subroutine eliminate_node

    !> z := z - l x for the usual size in spatial chains, here so that it is compiled into the loop. Nodes depend on each other: so
    !> the sums are split.
    pure subroutine subtract_five(l, x, z)
        real(wp), intent(in) :: l(5, 5), x(5)
        real(wp), intent(inout) :: z(5)
        real(wp) :: s(4), t(4), u, v
        integer :: i

        do i = 1, 4
            s(i) = (z(i) - l(i, 1)*x(1)) - l(i, 2)*x(2)
            t(i) = (l(i, 3)*x(3) + l(i, 4)*x(4)) + l(i, 5)*x(5)
        end do
        u = (z(5) - l(5, 1)*x(1)) - l(5, 2)*x(2)
        v = (l(5, 3)*x(3) + l(5, 4)*x(4)) + l(5, 5)*x(5)
        do i = 1, 4
            z(i) = s(i) - t(i)
        end do
        z(5) = u - v
    end subroutine subtract_five

    !> Multiply a node by its inverse block, and subtract the contributions of the unknowns behind it.
    pure subroutine find_node(s, place, diagonal, n_later, behind, blocks, z)
        integer, intent(in), value :: s, place, diagonal, n_later
        integer, intent(in) :: behind(3, n_later)
        real(wp), intent(in) :: blocks(*)
        real(wp), intent(inout) :: z(*)
        integer :: k

        call multiply_inverse(s, blocks(diagonal + 1), z(place + 1))
        do k = 1, n_later
            if (s == 5 .and. behind(2, k) == 5) then
                call subtract_transposed_sized(5, 5, blocks(behind(3, k) + 1), z(behind(1, k) + 1), z(place + 1))
            else if (s == 5 .and. behind(2, k) == 7) then
                call subtract_transposed_sized(7, 5, blocks(behind(3, k) + 1), z(behind(1, k) + 1), z(place + 1))
            else
                call subtract_transposed(behind(2, k), s, blocks(behind(3, k) + 1), z(behind(1, k) + 1), z(place + 1))
            end if
        end do
    end subroutine find_node

    !> By nodes, whose part of g stays in registers; then owned rows.
    module procedure multiply
        integer :: b, j
        real(wp) :: total

        call multiply_nodes(a%n_nodes, size(a%node_link, 2), a%node, a%is_body, &
            merge(0.0_wp, 1.0_wp, self%is_difference), a%joint_of_node, a%node_start, a%node_link, self%c, x, g)
        call multiply_owned(a%n_bodies, a%body, self%own, x, g)
        do b = 1, a%n_bodies
            if (a%joints_of_body(b) == of_hinges .or. a%own_row(b) == 0) cycle
            total = g(a%own_row(b))
            do j = a%first(b), a%first(b + 1) - 1
                total = total - self%own(j)*x(j)
            end do
            g(a%own_row(b)) = total
        end do
    end procedure multiply

    !> The norms of Euler parameters of the bodies that are held by hinges alone.
    pure subroutine multiply_owned(n_bodies, body, own, x, g)
        integer, intent(in) :: n_bodies, body(5, n_bodies)
        real(wp), intent(in) :: own(*), x(*)
        real(wp), intent(inout) :: g(*)
        integer :: b

        do b = 1, n_bodies
            if (body(5, b) /= of_hinges) cycle
            associate (k => body(1, b) + 2, row => body(4, b))
                g(row) = g(row) - ((own(k + 1)*x(k + 1) + own(k + 2)*x(k + 2)) + (own(k + 3)*x(k + 3) + own(k + 4)*x(k + 4)))
            end associate
        end do
    end subroutine multiply_owned

    !> The rows of nodes.
    pure subroutine multiply_nodes(n_nodes, n_links, node, is_body, of_place, joint, node_start, node_link, c, x, g)
        integer, intent(in) :: n_nodes, n_links, node(4, n_nodes), joint(n_nodes), node_start(n_nodes + 1), &
            node_link(4, n_links)
        logical, intent(in) :: is_body(n_nodes)
        !> See `multiply_in_space`.
        real(wp), intent(in), value :: of_place
        real(wp), intent(in) :: c(*), x(*)
        real(wp), intent(inout) :: g(*)
        integer :: l, n

        do n = 1, n_nodes
            if (is_body(n)) cycle
            if (joint(n) == of_hinges) then
                call multiply_in_space(node_start(n + 1) - node_start(n), node_link(1, node_start(n)), of_place, c, x, &
                    g(node(4, n)))
                cycle
            else if (joint(n) == of_pins) then
                call multiply_in_plane(node_start(n + 1) - node_start(n), node_link(1, node_start(n)), of_place, c, x, &
                    g(node(4, n)))
                cycle
            end if
            do l = node_start(n), node_start(n + 1) - 1
                associate (s => node(2, n), origin => node(4, n), first => node_link(1, l), nb => node_link(2, l), &
                    offset => node_link(3, l))
                    call subtract_rows(s, nb, c(offset + 1), x(first), g(origin))
                end associate
            end do
        end do
    end subroutine multiply_nodes

    !> Body by body.
    module procedure add_reactions
        integer :: b, i, j, l, n_place
        real(wp) :: sign

        do b = 1, a%n_bodies
            if (a%joints_of_body(b) == of_hinges) then
                call react_in_space(a%body(3, b), a%link(1, a%body(2, b)), merge(0.0_wp, 1.0_wp, self%is_difference), self%c, &
                    lambda, f(a%first(b):a%first(b) + 6))
                do j = a%first(b) + 3, a%first(b) + 6
                    f(j) = f(j) - self%own(j)*lambda(a%own_row(b))
                end do
                cycle
            end if
            n_place = n_of_place(a%joints_of_body(b))
            associate (from => a%first(b), to => a%first(b + 1) - 1)
                do l = a%link_start(b), a%link_start(b + 1) - 1
                    associate (s => a%link(2, l), origin => a%link(4, l))
                        sign = merge(0.0_wp, real(a%link(6, l), wp), self%is_difference)
                        do i = 1, n_place
                            f(from + i - 1) = f(from + i - 1) - sign*lambda(origin + i - 1)
                        end do
                        call subtract_transposed(s, to - from + 1 - n_place, self%c(a%link(3, l) + s*n_place + 1), &
                            lambda(origin:origin + s - 1), f(from + n_place:to))
                    end associate
                end do
                if (a%own_row(b) == 0) cycle
                do j = from, to
                    f(j) = f(j) - self%own(j)*lambda(a%own_row(b))
                end do
            end associate
        end do
    end procedure add_reactions

    !> Body by body.
    module procedure find_unbalanced
        call leave_bodies(self, a, mass, f, x, lambda, left)
    end procedure find_unbalanced

    pure subroutine leave_bodies(self, a, mass, f, x, z, left)
        class(factor_type), intent(in) :: self
        type(analysis_type), intent(in) :: a
        real(wp), intent(in) :: mass(a%n, *), f(a%n), x(a%n), z(a%n_unknowns)
        real(wp), intent(out) :: left(a%n)
        real(wp) :: along, squared
        integer :: b, i, l

        do b = 1, a%n_bodies
            associate (first => a%first(b), last => a%first(b + 1) - 1, from => a%link_start(b), &
                n_links => a%link_start(b + 1) - a%link_start(b))
                if (a%joints_of_body(b) == of_hinges) then
                    call leave_in_space(n_links, a%link(1, from), a%n, mass(first, 1), f(first), x(first), self%c, &
                        self%own(first), z, left(first))
                    cycle
                else if (a%joints_of_body(b) == of_pins) then
                    call leave_in_plane(n_links, a%link(1, from), mass(first, 1), f(first), x(first), self%c, z, left(first))
                else
                    call leave_body(first, last, a%block_first, a%n, mass, f, x, left)
                    do l = from, from + n_links - 1
                        call subtract_transposed(a%link(2, l), last - first + 1, self%c(a%link(3, l) + 1), z(a%link(1, l) + 1), &
                            left(first))
                    end do
                end if
                if (a%own_row(b) == 0) cycle
                along = 0.0_wp
                squared = tiny(1.0_wp)
                do i = first, last
                    along = along + self%own(i)*left(i)
                    squared = squared + self%own(i)*self%own(i)
                end do
                along = along/squared
                do i = first, last
                    left(i) = left(i) - along*self%own(i)
                end do
            end associate
        end do
    end subroutine leave_bodies

    !> f - M x of a body.
    pure subroutine leave_body(first, last, block_first, n, mass, f, x, left)
        integer, intent(in) :: first, last, n, block_first(n)
        real(wp), intent(in) :: mass(n, *), f(n), x(n)
        real(wp), intent(inout) :: left(n)
        integer :: i, j

        do i = first, last
            left(i) = f(i)
        end do
        do j = first, last
            i = block_first(j)
            do while (i <= last)
                if (block_first(i) /= block_first(j)) exit
                left(i) = left(i) - mass(i, j - block_first(j) + 1)*x(j)
                i = i + 1
            end do
        end do
    end subroutine leave_body

    module procedure move
        integer :: b

        x(:) = 0.0_wp
        do b = 1, a%n_bodies
            if (a%is_kept(b)) cycle
            associate (from => a%first(b), to => a%first(b + 1) - 1)
                call add_moved(a%kind(b), to - from + 1, a%block_first(from), size(self%w, 1), self%w(1, from), f(from:to), &
                    x(from:to))
            end associate
        end do
    end procedure move
end submodule tandem_chart_sparse_solve
