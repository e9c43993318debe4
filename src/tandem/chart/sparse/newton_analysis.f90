! SPDX-License-Identifier: MIT
!> The structure of the Newton matrix [H, C'; C, 0] of implicit stages, H = M + ha D + ha^2 K: here bodies that share a force are
!> neighbours too, so that every body is a node, with the row that it owns, ordered among the nodes of rows.
!>
!> A node of rows follows all bodies that it touches. Then every leading part of the matrix contains complete rows of C: it is
!> regular if C has full rank and H is definite, and any order is valid. For hubs the rule of `tandem_chart_sparse_analysis` holds
!> instead, since all their rows would follow and be each other's neighbours.
module tandem_chart_sparse_newton_analysis
    use tandem_chart_sparse_analysis, only: analysis_type, sorted
    use tandem_linalg_order, only: append, list_type, order_nodes
    use tandem_model_stiffness, only: stiffness_type
    implicit none (type, external)
    private

    public :: newton_analysis_type

    !> The analysis of the Newton matrix: the chart's analysis with every body a node of its own.
    type, extends(analysis_type) :: newton_analysis_type
        !> Target of the part of C of each link; true if the node of rows is the later one. The links are those of the chart's own
        !> analysis, with the numbers of the nodes here, 0 for a row that is eliminated with its body.
        integer, allocatable :: link_target(:)
        logical, allocatable :: is_row_later(:)
        !> The signs of joints of coincident points, by links.
        integer, allocatable :: link_sign(:)
        !> Targets of the blocks of bodies that share a force, in the order of their partners.
        integer, allocatable :: force_target(:)
    contains
        procedure :: analyse_newton
        procedure, private :: number_all, find_targets
    end type newton_analysis_type

contains

    !> Analyse the Newton matrix from the analysis of the chart's own factor and the pairs of bodies that share forces.
    subroutine analyse_newton(self, base, stiffness)
        class(newton_analysis_type), intent(inout) :: self
        type(analysis_type), intent(in) :: base
        type(stiffness_type), intent(in) :: stiffness
        type(list_type), allocatable :: neighbours(:), waits_for(:), bodies_of(:), hubs_of(:)
        integer, allocatable :: order(:), node_of(:), base_node(:)
        integer :: b, k, l, n, v
        logical, allocatable :: is_norm(:)

        self%n = base%n
        self%m = base%m
        self%n_bodies = base%n_bodies
        self%first = base%first
        self%block_first = base%block_first
        self%norm_row = base%norm_row
        self%is_kept = base%is_kept
        ! Bodies come first, then nodes of rows other than owned rows.
        if (allocated(self%is_body)) deallocate (self%is_body)
        allocate (is_norm(base%m), source=.false.)
        do b = 1, self%n_bodies
            if (base%norm_row(b) > 0) is_norm(base%norm_row(b)) = .true.
        end do
        allocate (node_of(base%n_nodes), source=0)
        allocate (base_node(base%n_nodes), source=0)
        n = self%n_bodies
        do v = 1, base%n_nodes
            if (base%is_body(v)) cycle
            if (is_norm(base%origin(v))) cycle
            n = n + 1
            node_of(v) = n
            base_node(n - self%n_bodies) = v
        end do
        self%n_nodes = n
        allocate (neighbours(n), waits_for(n), order(n), bodies_of(n - self%n_bodies), hubs_of(n - self%n_bodies))
        do b = 1, self%n_bodies
            do l = base%link_start(b), base%link_start(b + 1) - 1
                v = node_of(base%link_node(l))
                if (v == 0) cycle
                call append(neighbours(b), v)
                call append(neighbours(v), b)
                call append(bodies_of(v - self%n_bodies), b)
            end do
            do k = stiffness%start(b), stiffness%start(b + 1) - 1
                if (stiffness%partner(k) /= b) call append(neighbours(b), stiffness%partner(k))
            end do
        end do
        call base%find_waiting(bodies_of, hubs_of)
        do v = 1, n - self%n_bodies
            do k = 1, bodies_of(v)%n
                b = bodies_of(v)%item(k)
                if (base%is_kept(b) .and. hubs_of(v)%n == 0) cycle
                call append(waits_for(self%n_bodies + v), b)
            end do
        end do
        call order_nodes(neighbours, waits_for, order)
        call self%number_all(base, base_node, order, neighbours)
        call self%place_blocks()
        call self%find_updates()
        call self%find_targets(base, stiffness, node_of, order)
        if (allocated(self%node)) deallocate (self%node, self%behind)
        allocate (self%node(4, self%n_nodes), self%behind(3, size(self%later) + 1))
        self%node = reshape([(self%place(n), self%height(n), self%block%diagonal(n), self%origin(n), n=1, self%n_nodes)], &
            [4, self%n_nodes])
        self%behind = reshape([(self%place(self%later(k)), self%height(self%later(k)), self%block%later(k), &
            k=1, size(self%later))], [3, size(self%later) + 1], pad=[0])
    end subroutine analyse_newton

    !> Number nodes in their order.
    subroutine number_all(self, base, base_node, order, neighbours)
        class(newton_analysis_type), intent(inout) :: self
        type(analysis_type), intent(in) :: base
        integer, intent(in) :: base_node(:), order(:)
        type(list_type), intent(in) :: neighbours(:)
        integer, allocatable :: position(:)
        integer :: i, k, n, v

        allocate (position(self%n_nodes), source=0)
        do i = 1, self%n_nodes
            position(order(i)) = i
        end do
        self%height = 0*position
        self%place = self%height
        self%origin = self%height
        allocate (self%is_body(self%n_nodes), source=order <= self%n_bodies)
        self%later_start = spread(1, 1, self%n_nodes + 1)
        n = 0
        k = 0
        do i = 1, self%n_nodes
            v = order(i)
            if (self%is_body(i)) then
                self%origin(i) = self%first(v)
                self%height(i) = self%first(v + 1) - self%first(v) + merge(1, 0, self%norm_row(v) > 0)
            else
                self%origin(i) = base%origin(base_node(v - self%n_bodies))
                self%height(i) = base%height(base_node(v - self%n_bodies))
            end if
            self%place(i) = n
            n = n + self%height(i)
            k = k + neighbours(v)%n
            self%later_start(i + 1) = k + 1
        end do
        self%n_unknowns = n
        self%later = spread(0, 1, k)
        do i = 1, self%n_nodes
            associate (list => neighbours(order(i)))
                ! A node that never had a neighbour has no list.
                if (list%n == 0) cycle
                self%later(self%later_start(i):self%later_start(i + 1) - 1) = sorted(position(list%item(:list%n)))
            end associate
        end do
        self%node_of_body = position(:self%n_bodies)
    end subroutine number_all

    !> Set the targets of the parts of C, and of the blocks of the forces.
    subroutine find_targets(self, base, stiffness, node_of, order)
        class(newton_analysis_type), intent(inout) :: self
        type(analysis_type), intent(in) :: base
        type(stiffness_type), intent(in) :: stiffness
        !> The first number here of a node of the base, 0 for none; the order.
        integer, intent(in) :: node_of(:), order(:)
        integer, allocatable :: position(:)
        integer :: b, k, l, node

        allocate (position(self%n_nodes), source=0)
        do k = 1, self%n_nodes
            position(order(k)) = k
        end do
        self%link_start = base%link_start
        self%link_offset = base%link_offset
        self%link_sign = base%link(6, :size(base%link_node))
        self%joints_of_body = base%joints_of_body
        self%link_node = 0*base%link_node
        self%link_target = self%link_node
        if (allocated(self%is_row_later)) deallocate (self%is_row_later)
        allocate (self%is_row_later(size(self%link_node)), source=.false.)
        do b = 1, self%n_bodies
            do l = base%link_start(b), base%link_start(b + 1) - 1
                if (node_of(base%link_node(l)) == 0) cycle
                node = position(node_of(base%link_node(l)))
                self%link_node(l) = node
                self%link_target(l) = self%block_of(node, self%node_of_body(b))
                self%is_row_later(l) = node > self%node_of_body(b)
            end do
        end do
        self%force_target = 0*stiffness%partner
        do b = 1, self%n_bodies
            do k = stiffness%start(b), stiffness%start(b + 1) - 1
                self%force_target(k) = self%block_of(self%node_of_body(b), self%node_of_body(stiffness%partner(k)))
            end do
        end do
    end subroutine find_targets
end module tandem_chart_sparse_newton_analysis
