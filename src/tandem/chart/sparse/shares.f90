! SPDX-License-Identifier: MIT
!> Schur complement assembly: the matrix K = C W C' of the joints, and hubs, before the elimination of its first node.
submodule(tandem_chart_sparse_factor) tandem_chart_sparse_shares
    use tandem_chart_sparse_blocks, only: subtract_product
    use tandem_chart_sparse_meetings, only: add_in_plane, add_in_space
    use tandem_chart_sparse_moved, only: apply_inverse
    implicit none (type, external)

contains

    module procedure add_bodies
        real(wp) :: inverse(most_coordinates)
        integer :: b, d, i, j, k, l, n, nb, s

        do b = 1, a%n_bodies
            nb = a%first(b + 1) - a%first(b)
            d = a%target%pair_start(b)
            associate (from => a%link_start(b), last => a%link_start(b + 1) - 1, f => a%first(b))
                if (a%is_kept(b)) then
                    call put_kept(b, nb)
                    do j = 1, nb
                        inverse(j) = 1.0_wp/self%w(f + j - a%block_first(f + j - 1), f + j - 1)
                    end do
                    do l = from, last
                        n = a%link_node(l)
                        s = a%height(n)
                        d = d + 1
                        k = a%link_offset(l)
                        call add_kept(s, nb, n > a%node_of_body(b), inverse, self%c(k + 1), self%blocks(a%target%pair(d) + 1), &
                            self%alone(a%origin(n)))
                    end do
                    cycle
                end if
                if (last < from) cycle
                if (a%joints_of_body(b) == of_hinges) then
                    call add_in_space(last - from + 1, a%link(1, from), size(self%w, 1), self%w(1, f), self%r(f), &
                        a%target%pair(d + 1), self%c, self%sent(1, from), self%y, self%blocks)
                    cycle
                else if (a%joints_of_body(b) == of_pins) then
                    call add_in_plane(last - from + 1, a%link(1, from), size(self%w, 1), self%w(1, f), a%target%pair(d + 1), &
                        self%c, self%y, self%blocks)
                    cycle
                end if
                call add_links(a%kind(b), nb, a%block_first(f), self%w(:, f:), a%link(:, from:last), a%target%pair(d + 1), self%c, &
                    self%y, self%blocks)
                if (a%norm_row(b) == 0) cycle
                do l = from, last
                    do i = 1, most_rows
                        self%sent(i, l) = 0.0_wp
                    end do
                    call subtract_rows(a%link(2, l), nb, self%c(a%link(3, l) + 1), self%r(f), self%sent(1, l))
                end do
            end associate
        end do
        call take_diagonals(a%n_nodes, a%node, a%is_body, self%blocks, self%alone)

    contains

        !> The mass of a hub.
        subroutine put_kept(body, height)
            integer, intent(in) :: body, height
            integer :: column, row, first

            associate (offset => a%block%diagonal(a%node_of_body(body)), begins => a%first(body))
                do column = 1, height
                    first = a%block_first(begins + column - 1) - begins + 1
                    row = first
                    do while (row <= height)
                        if (a%block_first(begins + row - 1) /= begins + first - 1) exit
                        self%blocks(offset + (column - 1)*height + row) = self%w(row - first + 1, begins + column - 1)
                        row = row + 1
                    end do
                end do
            end associate
        end subroutine put_kept
    end procedure add_bodies

    !> Subtract from the pivots of rows the parts of bodies that are eliminated first.
    pure subroutine take_diagonals(n_nodes, node, is_body, blocks, alone)
        integer, intent(in) :: n_nodes, node(4, n_nodes)
        logical, intent(in) :: is_body(n_nodes)
        real(wp), intent(in) :: blocks(*)
        real(wp), intent(inout) :: alone(*)
        integer :: i, n

        do n = 1, n_nodes
            if (is_body(n)) cycle
            associate (s => node(2, n), diagonal => node(3, n), origin => node(4, n))
                ! A loop of known length.
                if (s == 5) then
                    do i = 0, 4
                        alone(origin + i) = alone(origin + i) - blocks(diagonal + 6*i + 1)
                    end do
                else
                    do i = 0, s - 1
                        alone(origin + i) = alone(origin + i) - blocks(diagonal + (s + 1)*i + 1)
                    end do
                end if
            end associate
        end do
    end subroutine take_diagonals

    !> The block of a link of a hub, and its diagonal without the other links.
    pure subroutine add_kept(s, nb, is_behind, inverse, c, block, alone)
        integer, intent(in), value :: s, nb
        !> True if the rows come behind the body.
        logical, intent(in), value :: is_behind
        !> Inverse diagonal of the body's M; its part of C.
        real(wp), intent(in) :: inverse(nb), c(s, nb)
        real(wp), intent(inout) :: block(s*nb), alone(s)
        integer :: i, j

        ! Loops of known length.
        if (s == 5 .and. nb == 7) then
            call add_squared(7, inverse, c, alone)
            call put_kept_rows(5, 7, is_behind, c, block)
        else
            do i = 1, s
                do j = 1, nb
                    alone(i) = alone(i) + c(i, j)**2*inverse(j)
                end do
            end do
            call put_kept_rows(s, nb, is_behind, c, block)
        end if
    end subroutine add_kept

    !> Diagonal entries of five rows: rows as four and one, see `subtract_five_rows`.
    pure subroutine add_squared(nb, inverse, c, alone)
        integer, intent(in), value :: nb
        real(wp), intent(in) :: inverse(nb), c(5, nb)
        real(wp), intent(inout) :: alone(5)
        real(wp) :: t(4), u
        integer :: i, j

        do i = 1, 4
            t(i) = alone(i)
        end do
        u = alone(5)
        !GCC$ UNROLL 7
        do j = 1, nb
            do i = 1, 4
                t(i) = t(i) + c(i, j)**2*inverse(j)
            end do
            u = u + c(5, j)**2*inverse(j)
        end do
        do i = 1, 4
            alone(i) = t(i)
        end do
        alone(5) = u
    end subroutine add_squared

    !> The block itself, (s, nb) behind the body and else (nb, s).
    pure subroutine put_kept_rows(s, nb, is_behind, c, block)
        integer, intent(in), value :: s, nb
        logical, intent(in), value :: is_behind
        real(wp), intent(in) :: c(s, nb)
        real(wp), intent(inout) :: block(s*nb)
        integer :: i, j

        if (is_behind) then
            do j = 1, nb
                do i = 1, s
                    block((j - 1)*s + i) = c(i, j)
                end do
            end do
        else
            do i = 1, s
                do j = 1, nb
                    block((i - 1)*nb + j) = c(i, j)
                end do
            end do
        end if
    end subroutine put_kept_rows

    !> Subtract C W C' of the links of a body from the blocks of their nodes.
    pure subroutine add_links(kind, nb, block_first, w, link, pair_target, c, y, blocks)
        integer, intent(in), value :: kind, nb
        !> The first coordinates of the blocks of the body's M, its links (6, any), the targets of the products.
        integer, intent(in), contiguous :: link(:, :)
        integer, intent(in) :: block_first(nb), pair_target(*)
        !> W, at least the body's columns.
        real(wp), intent(in), contiguous :: w(:, :)
        real(wp), intent(in) :: c(*)
        real(wp), intent(inout) :: y(*), blocks(*)
        integer :: d, k, l

        d = 0
        do l = 1, size(link, 2)
            associate (place => link(1, l), s => link(2, l), offset => link(3, l), moved => link(5, l))
                call apply_inverse(kind, s, nb, block_first, block_first(1), size(w, 1), w, c(offset + 1), y(moved + 1))
                do k = 1, l
                    d = d + 1
                    ! The later node has the rows of the block.
                    if (link(1, k) > place) then
                        call subtract_product(link(2, k), s, nb, c(link(3, k) + 1), y(moved + 1), blocks(pair_target(d) + 1))
                    else
                        call subtract_product(s, link(2, k), nb, c(offset + 1), y(link(5, k) + 1), blocks(pair_target(d) + 1))
                    end if
                end do
            end associate
        end do
    end subroutine add_links
end submodule tandem_chart_sparse_shares
