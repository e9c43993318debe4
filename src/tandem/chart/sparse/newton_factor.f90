! SPDX-License-Identifier: MIT
!> The factor L U by blocks of [F, C'; C, 0], F = a M + b D + c K by bodies, and solutions with it. The imaginary part of a complex
!> matrix of that kind has the same pattern, without M and C.
module tandem_chart_sparse_newton_factor
    use tandem_chart_sparse_analysis, only: most_coordinates, most_rows
    use tandem_chart_sparse_meetings, only: n_of_place
    use tandem_chart_sparse_newton_analysis, only: newton_analysis_type
    use tandem_chart_sparse_newton_kernels, only: copy, invert_pivoted, multiply, multiply_block, subtract, &
        subtract_product
    use tandem_kinds, only: wp
    use tandem_model_stiffness, only: stiffness_type
    use tandem_pack, only: pack_type
    use tandem_status, only: status_newton_failed, status_ok
    implicit none (type, external)
    private

    public :: most, newton_factor_type, newton_terms_type

    !> Largest number of unknowns of a node.
    integer, parameter :: most = max(most_rows, most_coordinates + 1)

    !> Terms of a Newton matrix.
    type :: newton_terms_type
        !> D and K.
        type(stiffness_type) :: stiffness
        !> Compressed M, the parts of C by links and by owned rows.
        real(wp), allocatable :: mass(:, :), c(:), own(:)
        !> Columns for frictions, see `tandem_chart_sparse_low_rank` (n, columns).
        real(wp), allocatable :: columns(:, :)
        !> Rows that are left out (m).
        logical, allocatable :: is_out(:)
    end type newton_terms_type

    !> Blocks of a matrix, then of its factor.
    type :: newton_factor_type
        !> Blocks below the diagonal, times the inverses of diagonal blocks, and these inverses; the blocks above the diagonal.
        real(wp), allocatable :: lower(:), upper(:)
    contains
        procedure :: allocate => allocate_factor, fill, eliminate, solve, pack_state
    end type newton_factor_type

contains

    !> Allocate for a pattern.
    subroutine allocate_factor(self, analysis)
        class(newton_factor_type), intent(inout) :: self
        type(newton_analysis_type), intent(in) :: analysis

        if (allocated(self%lower)) deallocate (self%lower, self%upper)
        allocate (self%lower(analysis%block%n_entries), self%upper(analysis%block%n_entries), source=0.0_wp)
    end subroutine allocate_factor

    !> The matrix before the elimination of the first node.
    subroutine fill(self, a, terms, by_qd, by_q, has_rows)
        class(newton_factor_type), intent(inout) :: self
        type(newton_analysis_type), intent(in) :: a
        type(newton_terms_type), intent(in) :: terms
        !> The factors of D and of K.
        real(wp), intent(in) :: by_qd, by_q
        !> True if M and C are included; an imaginary part has none.
        logical, intent(in) :: has_rows
        integer :: b, i, j, k, s, other, offset, entry
        real(wp) :: value

        self%lower = 0.0_wp
        self%upper = 0.0_wp
        associate (first => a%first, k_ => terms%stiffness)
            do b = 1, a%n_bodies
                s = a%height(a%node_of_body(b))
                if (has_rows) call put_body(b, s)
                do k = k_%start(b), k_%start(b + 1) - 1
                    other = k_%partner(k)
                    offset = a%force_target(k)
                    entry = k_%offset(k)
                    do j = 1, first(other + 1) - first(other)
                        do i = 1, first(b + 1) - first(b)
                            entry = entry + 1
                            value = by_qd*k_%by_qd(entry) + by_q*k_%by_q(entry)
                            if (other == b) then
                                self%lower(offset + (j - 1)*s + i) = self%lower(offset + (j - 1)*s + i) + value
                            else if (a%node_of_body(b) > a%node_of_body(other)) then
                                self%lower(offset + (j - 1)*s + i) = value
                            else
                                self%upper(offset + (j - 1)*s + i) = value
                            end if
                        end do
                    end do
                end do
            end do
            if (.not. has_rows) return
            do k = 1, a%n_nodes
                if (a%is_body(k)) cycle
                do i = 1, a%height(k)
                    if (terms%is_out(a%origin(k) + i - 1)) self%lower(a%block%diagonal(k) + (i - 1)*(a%height(k) + 1) + 1) = 1.0_wp
                end do
            end do
        end associate

    contains

        !> M and the rows of a body. A norm row that was left out has a unit pivot, like other rows in the nodes of joints.
        subroutine put_body(body, height)
            integer, intent(in) :: body, height
            integer :: column, from, link, row, to, where
            logical :: has_norm

            where = a%block%diagonal(a%node_of_body(body))
            has_norm = a%norm_row(body) > 0
            if (has_norm) has_norm = .not. terms%is_out(a%norm_row(body))
            if (a%norm_row(body) > 0 .and. .not. has_norm) self%lower(where + height**2) = 1.0_wp
            from = a%first(body)
            to = a%first(body + 1) - 1
            do column = from, to
                do row = a%block_first(column), to
                    if (a%block_first(row) /= a%block_first(column)) exit
                    self%lower(where + (column - from)*height + row - from + 1) = &
                        terms%mass(row, column - a%block_first(column) + 1)
                end do
                if (.not. has_norm) cycle
                self%lower(where + (column - from)*height + height) = terms%own(column)
                self%lower(where + (height - 1)*height + column - from + 1) = terms%own(column)
            end do
            do link = a%link_start(body), a%link_start(body + 1) - 1
                if (a%link_node(link) > 0) call put_link(body, link, height)
            end do
        end subroutine put_body

        !> The part of C of a link, above and below the diagonal.
        subroutine put_link(body, link, height)
            integer, intent(in) :: body, link, height
            integer :: across, along, column, from, row, rows
            real(wp) :: value

            associate (node => a%link_node(link))
                rows = a%height(node)
                from = a%link_offset(link)
                do column = 1, a%first(body + 1) - a%first(body)
                    do row = 1, rows
                        if (terms%is_out(a%origin(node) + row - 1)) cycle
                        ! C and its transpose.
                        along = a%link_target(link) + (column - 1)*rows + row
                        across = a%link_target(link) + (row - 1)*height + column
                        value = merge(real(a%link_sign(link), wp), 0.0_wp, row == column)
                        if (column > n_of_place(a%joints_of_body(body))) value = terms%c(from + (column - 1)*rows + row)
                        self%lower(merge(along, across, a%is_row_later(link))) = value
                        self%upper(merge(across, along, a%is_row_later(link))) = value
                    end do
                end do
            end associate
        end subroutine put_link
    end subroutine fill

    !> Eliminate the nodes.
    subroutine eliminate(self, a, stat)
        class(newton_factor_type), intent(inout) :: self
        type(newton_analysis_type), intent(in) :: a
        !> ok or `newton_failed`.
        integer, intent(out) :: stat
        real(wp) :: scaled(most*most)
        integer :: d, i, j, k, n, p, q, s, target
        logical :: is_regular

        stat = status_ok
        associate (lower => self%lower, upper => self%upper, at => a%block%later)
            do n = 1, a%n_nodes
                s = a%height(n)
                call invert_pivoted(s, lower(a%block%diagonal(n) + 1), is_regular)
                if (.not. is_regular) then
                    stat = status_newton_failed
                    return
                end if
                d = a%target%update_start(n)
                do j = a%later_start(n), a%later_start(n + 1) - 1
                    p = a%height(a%later(j))
                    call multiply_block(p, s, s, lower(at(j) + 1), lower(a%block%diagonal(n) + 1), scaled)
                    do i = 1, p*s
                        lower(at(j) + i) = scaled(i)
                    end do
                    do k = a%later_start(n), j
                        d = d + 1
                        q = a%height(a%later(k))
                        target = a%target%update(d)
                        call subtract_product(p, q, s, scaled, upper(at(k) + 1), lower(target + 1))
                        if (k < j) call subtract_product(q, p, s, lower(at(k) + 1), upper(at(j) + 1), upper(target + 1))
                    end do
                end do
            end do
        end associate
    end subroutine eliminate

    !> Solve in place for the unknowns of all nodes.
    pure subroutine solve(self, a, z)
        class(newton_factor_type), intent(in) :: self
        type(newton_analysis_type), intent(in) :: a
        real(wp), intent(inout), contiguous :: z(:)

        call solve_nodes(a%n_nodes, size(a%behind, 2), a%node, a%later_start, a%behind, self%lower, self%upper, z)
    end subroutine solve

    !> Nodes forward and back, in place.
    pure subroutine solve_nodes(n_nodes, n_behind, node, later_start, behind, lower, upper, z)
        integer, intent(in) :: n_nodes, n_behind, node(4, n_nodes), later_start(n_nodes + 1), behind(3, n_behind)
        real(wp), intent(in) :: lower(*), upper(*)
        real(wp), intent(inout) :: z(*)
        real(wp) :: y(most)
        integer :: k, n, place, s

        do n = 1, n_nodes
            place = node(1, n)
            s = node(2, n)
            do k = later_start(n), later_start(n + 1) - 1
                call subtract(behind(2, k), s, lower(behind(3, k) + 1), z(place + 1), z(behind(1, k) + 1))
            end do
        end do
        do n = n_nodes, 1, -1
            place = node(1, n)
            s = node(2, n)
            call copy(s, z(place + 1), y)
            do k = later_start(n), later_start(n + 1) - 1
                call subtract(s, behind(2, k), upper(behind(3, k) + 1), z(behind(1, k) + 1), y)
            end do
            call multiply(s, lower(node(3, n) + 1), y, z(place + 1))
        end do
    end subroutine solve_nodes

    !> The factor.
    subroutine pack_state(self, pack)
        class(newton_factor_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%lower, self%upper)
    end subroutine pack_state
end module tandem_chart_sparse_newton_factor
