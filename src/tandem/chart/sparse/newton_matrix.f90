! SPDX-License-Identifier: MIT
!> The Newton matrix of implicit stages of a sparse chart, [H, C'; C, 0] with H = M + ha D + ha^2 K, factored by blocks L U: it is
!> not symmetric where forces turn with bodies, rub or are controlled. No basis is formed, and the cost is that of the pattern.
!>
!> A matrix outlives its chart and serves while C has not turned far. M, C, D and K are kept, so that another ha costs a
!> factorisation and no derivatives. What C and M have changed by since is made up for by refinement (`turn`): corrections contract
!> as with the C of the point, but for the third power of the angle.
module tandem_chart_sparse_newton_matrix
    use tandem_chart_sparse_analysis, only: analysis_type, most_coordinates, most_rows
    use tandem_chart_sparse_blocks, only: read_behind
    use tandem_chart_sparse_factor, only: factor_type
    use tandem_chart_sparse_newton_analysis, only: newton_analysis_type
    use tandem_chart_sparse_newton_kernels, only: invert_pivoted, multiply, multiply_block, subtract, subtract_product
    use tandem_kinds, only: wp
    use tandem_model_stiffness, only: stiffness_type
    use tandem_pack, only: pack_type
    use tandem_status, only: status_newton_failed, status_ok
    implicit none (type, external)
    private

    public :: newton_matrix_type

    !> The most unknowns of a node.
    integer, parameter :: most = max(most_rows, most_coordinates + 1)

    type :: newton_matrix_type
        type(newton_analysis_type) :: analysis
        !> D and K of the last `form`.
        type(stiffness_type) :: stiffness
        !> M, compressed, the parts of C by links and by owned rows there.
        real(wp), allocatable :: mass(:, :), c(:), own(:)
        !> Rows that are left out (m).
        logical, allocatable, private :: is_out(:)
        !> What C has changed by from there to the last point that was looked at.
        type(factor_type) :: turn
        !> Blocks below the diagonal, times the inverses of diagonal ones, and these inverses; the blocks above the diagonal.
        real(wp), allocatable, private :: lower(:), upper(:)
        !> ha of the last `factor`, 0 where there is none.
        real(wp) :: ha = 0.0_wp
        !> Work space: unknowns of nodes.
        real(wp), allocatable, private :: z(:)
    contains
        procedure :: initialize
        procedure :: form
        procedure :: factor
        procedure :: solve
        procedure :: look_at
        procedure :: is_near
        procedure :: pack_state
        procedure, private :: fill
        procedure, private :: eliminate
    end type newton_matrix_type

contains

    !> Allocate.
    subroutine initialize(self, base, stiffness, mass_width)
        class(newton_matrix_type), intent(inout) :: self
        !> The chart's own analysis.
        type(analysis_type), intent(in) :: base
        !> Built.
        type(stiffness_type), intent(in) :: stiffness
        integer, intent(in) :: mass_width

        self%stiffness = stiffness
        call self%analysis%analyse_newton(base, stiffness)
        if (allocated(self%lower)) deallocate (self%lower, self%upper, self%mass, self%c, self%own, self%z, self%is_out, &
            self%turn%c, self%turn%own)
        allocate (self%lower(self%analysis%n_factor), self%upper(self%analysis%n_factor), self%mass(base%n, mass_width), &
            self%c(base%n_entries + read_behind), self%own(base%n), self%z(self%analysis%n_unknowns), &
            self%turn%c(base%n_entries + read_behind), self%turn%own(base%n), source=0.0_wp)
        allocate (self%is_out(base%m), source=.false.)
        self%ha = 0.0_wp
    end subroutine initialize

    !> Take M and C of a point; D and K are there.
    subroutine form(self, here, mass)
        class(newton_matrix_type), intent(inout) :: self
        !> With its rows loaded.
        type(factor_type), intent(in) :: here
        !> Compressed.
        real(wp), intent(in), contiguous :: mass(:, :)

        self%mass(:, :) = mass
        self%c(:) = here%c
        self%own(:) = here%own
        self%is_out(:) = here%is_out
        self%ha = 0.0_wp
    end subroutine form

    !> Factor for ha = h a_ii.
    subroutine factor(self, ha, stat)
        class(newton_matrix_type), intent(inout) :: self
        real(wp), intent(in) :: ha
        !> ok or `newton_failed`.
        integer, intent(out) :: stat

        call self%fill(ha)
        call self%eliminate(stat)
        self%ha = merge(ha, 0.0_wp, stat == status_ok)
    end subroutine factor

    !> The matrix before the first node goes.
    subroutine fill(self, ha)
        class(newton_matrix_type), intent(inout) :: self
        real(wp), intent(in) :: ha
        integer :: b, i, j, k, l, s, other, offset, entry

        self%lower = 0.0_wp
        self%upper = 0.0_wp
        associate (a => self%analysis, first => self%analysis%first, k_ => self%stiffness)
            do b = 1, a%n_bodies
                s = a%height(a%node_of_body(b))
                offset = a%diagonal_offset(a%node_of_body(b))
                do j = first(b), first(b + 1) - 1
                    do i = a%block_first(j), first(b + 1) - 1
                        if (a%block_first(i) /= a%block_first(j)) exit
                        self%lower(offset + (j - first(b))*s + i - first(b) + 1) = self%mass(i, j - a%block_first(j) + 1)
                    end do
                    if (a%norm_row(b) == 0) cycle
                    self%lower(offset + (j - first(b))*s + s) = self%own(j)
                    self%lower(offset + (s - 1)*s + j - first(b) + 1) = self%own(j)
                end do
                do k = k_%start(b), k_%start(b + 1) - 1
                    other = k_%partner(k)
                    offset = a%force_target(k)
                    entry = k_%offset(k)
                    do j = 1, first(other + 1) - first(other)
                        do i = 1, first(b + 1) - first(b)
                            entry = entry + 1
                            associate (value => ha*k_%by_qd(entry) + ha**2*k_%by_q(entry))
                                if (other == b) then
                                    self%lower(offset + (j - 1)*s + i) = self%lower(offset + (j - 1)*s + i) + value
                                else if (a%node_of_body(b) > a%node_of_body(other)) then
                                    self%lower(offset + (j - 1)*s + i) = value
                                else
                                    self%upper(offset + (j - 1)*s + i) = value
                                end if
                            end associate
                        end do
                    end do
                end do
                do l = a%link_start(b), a%link_start(b + 1) - 1
                    if (a%link_node(l) > 0) call put_link(b, l, s)
                end do
            end do
            do k = 1, a%n_nodes
                if (a%is_body(k)) cycle
                do i = 1, a%height(k)
                    if (self%is_out(a%origin(k) + i - 1)) self%lower(a%diagonal_offset(k) + (i - 1)*(a%height(k) + 1) + 1) = 1.0_wp
                end do
            end do
        end associate

    contains

        !> The part of C of a link, above and below the diagonal.
        subroutine put_link(body, link, height)
            integer, intent(in) :: body, link, height
            integer :: across, along, column, from, row, rows

            associate (a => self%analysis, node => self%analysis%link_node(link))
                rows = a%height(node)
                from = a%link_offset(link)
                do column = 1, a%first(body + 1) - a%first(body)
                    do row = 1, rows
                        if (self%is_out(a%origin(node) + row - 1)) cycle
                        ! C and its transpose.
                        along = a%link_target(link) + (column - 1)*rows + row
                        across = a%link_target(link) + (row - 1)*height + column
                        associate (value => self%c(from + (column - 1)*rows + row))
                            self%lower(merge(along, across, a%is_row_later(link))) = value
                            self%upper(merge(across, along, a%is_row_later(link))) = value
                        end associate
                    end do
                end do
            end associate
        end subroutine put_link
    end subroutine fill

    !> Eliminate the nodes.
    subroutine eliminate(self, stat)
        class(newton_matrix_type), intent(inout) :: self
        integer, intent(out) :: stat
        real(wp) :: scaled(most*most)
        integer :: d, i, j, k, n, p, q, s, target
        logical :: is_regular

        stat = status_ok
        associate (a => self%analysis, lower => self%lower, upper => self%upper, at => self%analysis%later_offset)
            do n = 1, a%n_nodes
                s = a%height(n)
                call invert_pivoted(s, lower(a%diagonal_offset(n) + 1), is_regular)
                if (.not. is_regular) then
                    stat = status_newton_failed
                    return
                end if
                d = a%update_start(n)
                do j = a%later_start(n), a%later_start(n + 1) - 1
                    p = a%height(a%later(j))
                    call multiply_block(p, s, lower(at(j) + 1), lower(a%diagonal_offset(n) + 1), scaled)
                    do i = 1, p*s
                        lower(at(j) + i) = scaled(i)
                    end do
                    do k = a%later_start(n), j
                        d = d + 1
                        q = a%height(a%later(k))
                        target = a%update_target(d)
                        call subtract_product(p, q, s, scaled, upper(at(k) + 1), lower(target + 1))
                        if (k < j) call subtract_product(q, p, s, lower(at(k) + 1), upper(at(j) + 1), upper(target + 1))
                    end do
                end do
            end do
        end associate
    end subroutine eliminate

    !> Solve H x + C' mu = f, C x = g.
    subroutine solve(self, f, g, x, mu)
        class(newton_matrix_type), intent(inout) :: self
        !> f and x (n), g and mu (m).
        real(wp), intent(in), contiguous :: f(:), g(:)
        real(wp), intent(out), contiguous :: x(:), mu(:)
        integer :: b, i, n

        associate (a => self%analysis, z => self%z)
            do n = 1, a%n_nodes
                if (a%is_body(n)) cycle
                do i = 1, a%height(n)
                    z(a%place(n) + i) = g(a%origin(n) + i - 1)
                    if (self%is_out(a%origin(n) + i - 1)) z(a%place(n) + i) = 0.0_wp
                end do
            end do
            do b = 1, a%n_bodies
                associate (place => a%place(a%node_of_body(b)), nb => a%first(b + 1) - a%first(b))
                    do i = 1, nb
                        z(place + i) = f(a%first(b) + i - 1)
                    end do
                    if (a%norm_row(b) > 0) z(place + nb + 1) = g(a%norm_row(b))
                end associate
            end do
            call solve_nodes(a%n_nodes, size(a%behind, 2), a%node, a%later_start, a%behind, self%lower, self%upper, z)
            do n = 1, a%n_nodes
                if (a%is_body(n)) cycle
                do i = 1, a%height(n)
                    mu(a%origin(n) + i - 1) = z(a%place(n) + i)
                end do
            end do
            do b = 1, a%n_bodies
                associate (place => a%place(a%node_of_body(b)), nb => a%first(b + 1) - a%first(b))
                    do i = 1, nb
                        x(a%first(b) + i - 1) = z(place + i)
                    end do
                    if (a%norm_row(b) > 0) mu(a%norm_row(b)) = z(place + nb + 1)
                end associate
            end do
        end associate
    end subroutine solve

    !> Nodes forward and back, in place.
    pure subroutine solve_nodes(n_nodes, n_behind, node, later_start, behind, lower, upper, z)
        integer, intent(in) :: n_nodes, n_behind, node(4, n_nodes), later_start(n_nodes + 1), behind(3, n_behind)
        real(wp), intent(in) :: lower(*), upper(*)
        real(wp), intent(inout) :: z(*)
        real(wp) :: y(most)
        integer :: i, k, n, place, s

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
            do i = 1, s
                y(i) = z(place + i)
            end do
            do k = later_start(n), later_start(n + 1) - 1
                call subtract(s, behind(2, k), upper(behind(3, k) + 1), z(behind(1, k) + 1), y)
            end do
            call multiply(s, lower(node(3, n) + 1), y, z(place + 1))
        end do
    end subroutine solve_nodes

    !> Find what C has changed by.
    subroutine look_at(self, here)
        class(newton_matrix_type), intent(inout) :: self
        !> With its rows loaded.
        type(factor_type), intent(in) :: here

        self%turn%c(:) = self%c - here%c
        self%turn%own(:) = self%own - here%own
    end subroutine look_at

    !> Whether C has turned so little since that the matrix may serve, for every joint of every body.
    pure logical function is_near(self, base, here)
        class(newton_matrix_type), intent(in) :: self
        !> The chart's own analysis.
        type(analysis_type), intent(in) :: base
        type(factor_type), intent(in) :: here
        !> Squared change against the squared length: an angle of some 13 degrees.
        real(wp), parameter :: farthest = 0.05_wp
        real(wp) :: length, turned
        integer :: b, k, l, to

        is_near = .false.
        do b = 1, base%n_bodies
            do l = base%link_start(b), base%link_start(b + 1) - 1
                to = base%link_offset(l) + base%height(base%link_node(l))*(base%first(b + 1) - base%first(b))
                length = 0.0_wp
                turned = 0.0_wp
                do k = base%link_offset(l) + 1, to
                    length = length + self%c(k)**2
                    turned = turned + (self%c(k) - here%c(k))**2
                end do
                if (turned > farthest*length) return
            end do
        end do
        is_near = .true.
    end function is_near

    !> The factor, and what it was made of.
    subroutine pack_state(self, pack)
        class(newton_matrix_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack
        integer, allocatable :: out(:)

        call pack%item(self%ha)
        call pack%item(self%lower)
        call pack%item(self%upper)
        call pack%item(self%mass)
        call pack%item(self%c)
        call pack%item(self%own)
        out = merge(1, 0, self%is_out)
        call pack%item(out)
        self%is_out = out > 0
        call self%stiffness%pack_state(pack)
    end subroutine pack_state
end module tandem_chart_sparse_newton_matrix
