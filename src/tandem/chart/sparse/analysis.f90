! SPDX-License-Identifier: MIT
!> Symbolic analysis of a sparse chart: grouping of rows, bodies that are eliminated first, the order of the remaining nodes, and
!> the position of every block.
!>
!> The system is M x + C' lambda = f, C x = g. Bodies with few rows are eliminated first, each with the row that it owns; the
!> remaining matrix K couples nodes: rows that touch the same bodies, with -C M^-1 C' of the eliminated bodies, and bodies that are
!> kept (hubs), whose rows would otherwise all become neighbours. Without hubs -K is positive definite if C has full rank, and any
!> order is valid. With hubs a row between a hub and eliminated bodies acts as if the hub were ground: among connected bodies one
!> such row may precede its hub, and only if they have no ground of their own, since otherwise those rows alone could be dependent.
!> The other rows are eliminated after their hubs.
module tandem_chart_sparse_analysis
    use tandem_kinds, only: long, wp
    use tandem_model_pattern, only: pattern_type
    use tandem_chart_sparse_blocks, only: most_coordinates, of_any_blocks, of_rigid_body, of_single_blocks
    use tandem_chart_sparse_inverses, only: side_by_side
    use tandem_linalg_order, only: append, list_type, order_nodes
    implicit none (type, external)
    private

    public :: analysis_type, most_rows, most_coordinates, most_links

    !> Largest number of rows of a node, and of nodes at a body that is eliminated first.
    integer, parameter :: most_rows = 6, most_links = 8

    !> Positions of products in the factor.
    type :: target_type
        !> Of the parts of two links of a body that is eliminated: of link 1 with itself, of 2 with 1 and with itself, and so on;
        !> for a hub the block of each link. From pair_start(b) + 1 on.
        integer, allocatable :: pair_start(:), pair(:)
        !> Of the neighbours behind node k when it is eliminated, from update_start(k) + 1 on, in the order of pairs; the last one
        !> is empty.
        integer, allocatable :: update_start(:), update(:)
    end type target_type

    !> Storage of the blocks of a factor: offset of the block of each neighbour behind a node, and of the diagonal blocks; number of
    !> entries. A block has as many rows as the later node has unknowns.
    type :: block_type
        integer, allocatable :: later(:), diagonal(:)
        integer :: n_entries = 0
    end type block_type

    !> The symbolic analysis.
    type :: analysis_type
        integer :: n = 0, m = 0, n_bodies = 0, n_nodes = 0
        !> The first coordinate of each body (n_bodies + 1), and of each coordinate's block of M (n); the row that a body owns, and
        !> the owned row that is eliminated with it, 0 for none; true for hubs; the node of each hub.
        integer, allocatable :: first(:), block_first(:), norm_row(:), own_row(:), node_of_body(:)
        logical, allocatable :: is_kept(:)
        !> Kind of the blocks of each body's M, see `tandem_chart_sparse_blocks`.
        integer, allocatable :: kind(:)
        !> A link connects a body and a node: the links of body b are link_start(b) to link_start(b + 1) - 1. For each link: its
        !> node, and the entry before its part of C, (rows, coordinates) in size, as if the columns of the position were stored,
        !> which hinges and pins omit.
        integer, allocatable :: link_start(:), link_node(:), link_offset(:)
        !> The same data for loops, contiguous in memory: for each link the first unknown less one and the height of its node, the
        !> offset in C, the first row, the offset of W c' and the sign of a joint of coincident points (6, links + 1); the links of
        !> node k are node_link(:, node_start(k)) to node_link(:, node_start(k + 1) - 1), each with the first coordinate and the
        !> number of coordinates of its body, the offset in C and that sign (4, links + 1). The last ones are empty, so that an
        !> empty list also has a first element.
        integer, allocatable :: link(:, :), node_start(:), node_link(:, :)
        !> For each body the first coordinate and the first link, the number of links, the row that is eliminated with it, and the
        !> kind of its joints (5, n_bodies).
        integer, allocatable :: body(:, :)
        !> Entries of C, and of W c' of all links.
        integer :: n_entries = 0, n_moved = 0
        !> For each body that is eliminated first the kind of its joints if these are hinges alone or pins alone; for each node its
        !> kind (`tandem_chart_sparse_meetings`).
        integer, allocatable :: joints_of_body(:), joint_of_node(:)
        !> Positions of the products of an elimination.
        type(target_type) :: target
        !> Nodes in their order of elimination: number of unknowns, offset in the vector of all unknowns, first row or coordinate,
        !> and true for a body.
        integer, allocatable :: height(:), place(:), origin(:)
        logical, allocatable :: is_body(:)
        integer :: n_unknowns = 0
        !> Neighbours behind node k: later(later_start(k)) to later(later_start(k + 1) - 1), ascending.
        integer, allocatable :: later_start(:), later(:)
        !> Storage of the factor.
        type(block_type) :: block
        !> The same data for loops: the first unknown less one, height, offset of the diagonal block, first row or coordinate of
        !> each node (4, nodes); the first three of each neighbour behind, with the offset of the block (3, neighbours + 1).
        integer, allocatable :: node(:, :), behind(:, :)
        !> Number of successive nodes of five rows, from each one on, that are not neighbours of each other, so that their blocks
        !> are inverted together; 0 if the node has other rows or belongs to an earlier group.
        integer, allocatable :: together(:)
        !> Approximate number of multiplications of a factorization.
        integer(long) :: work = 0
    contains
        procedure :: analyse
        procedure, private :: gather_rows
        procedure :: find_waiting
        procedure, private :: number_nodes
        procedure :: place_blocks, find_updates
        procedure, private :: find_pairs
        procedure :: block_of
    end type analysis_type

    public :: sorted

    interface
        !> Find nodes that are hinges or pins, with the signs of their links, and bodies with these joints alone; set the positions
        !> of C and W c', which are smaller for them.
        pure module subroutine find_joints(self, pattern, rows)
            implicit none (type, external)
            class(analysis_type), intent(inout) :: self
            type(pattern_type), intent(in) :: pattern
            !> Numbers of the rows in use.
            integer, intent(in) :: rows(:)
        end subroutine find_joints
    end interface

contains

    !> Analyse a pattern.
    subroutine analyse(self, pattern, rows)
        class(analysis_type), intent(inout) :: self
        type(pattern_type), intent(in) :: pattern
        !> Numbers of the rows in use, ascending.
        integer, intent(in) :: rows(:)
        type(list_type), allocatable :: neighbours(:), waits_for(:), nodes_of(:), bodies_of(:)
        integer, allocatable :: node_first(:), node_size(:), order(:)
        integer :: b, j

        self%n = pattern%first(pattern%n_bodies + 1) - 1
        self%m = size(rows)
        self%n_bodies = pattern%n_bodies
        self%first = pattern%first
        if (allocated(self%block_first)) deallocate (self%block_first)
        allocate (self%block_first(self%n))
        do j = 1, self%n
            self%block_first(j) = j - pattern%mass_column(j) + 1
        end do
        self%kind = spread(of_any_blocks, 1, self%n_bodies)
        do b = 1, self%n_bodies
            associate (columns => pattern%mass_column(self%first(b):self%first(b + 1) - 1))
                if (all(columns == 1)) then
                    self%kind(b) = of_single_blocks
                else if (size(columns) == 7) then
                    if (all(columns == [1, 1, 1, 1, 2, 3, 4])) self%kind(b) = of_rigid_body
                end if
            end associate
        end do
        call self%gather_rows(pattern, rows, node_first, node_size, nodes_of, bodies_of)
        ! Hubs are nodes behind the nodes of rows.
        self%n_nodes = size(node_first)
        if (allocated(self%node_of_body)) deallocate (self%node_of_body)
        allocate (self%node_of_body(self%n_bodies), source=0)
        do b = 1, self%n_bodies
            if (.not. self%is_kept(b)) cycle
            self%n_nodes = self%n_nodes + 1
            self%node_of_body(b) = self%n_nodes
        end do
        allocate (neighbours(self%n_nodes), waits_for(self%n_nodes), order(self%n_nodes))
        call set_neighbours(self, nodes_of, neighbours)
        call self%find_waiting(bodies_of, waits_for)
        call order_nodes(neighbours, waits_for, order)
        call self%number_nodes(node_first, node_size, order, neighbours, nodes_of)
        call self%place_blocks()
        call self%find_updates()
        call self%find_pairs()
        call list_for_loops(self)
        call find_joints(self, pattern, rows)
        call find_together(self)
    end subroutine analyse

    !> Find successive nodes of five rows that are not neighbours.
    pure subroutine find_together(self)
        class(analysis_type), intent(inout) :: self
        integer :: n, next

        self%together = spread(0, 1, self%n_nodes)
        n = 1
        do while (n <= self%n_nodes)
            next = n + 1
            if (self%height(n) == 5 .and. .not. self%is_body(n)) then
                do while (next <= min(self%n_nodes, n + side_by_side - 1))
                    if (self%height(next) /= 5 .or. self%is_body(next)) exit
                    if (any(self%later(self%later_start(n):self%later_start(next) - 1) == next)) exit
                    next = next + 1
                end do
                self%together(n) = next - n
            end if
            n = next
        end do
    end subroutine find_together

    !> Build the contiguous lists for loops.
    pure subroutine list_for_loops(self)
        class(analysis_type), intent(inout) :: self
        integer, allocatable :: next(:)
        integer :: b, k, l, n

        ! gfortran reads the shape of an unallocated left side before it allocates.
        if (allocated(self%node)) deallocate (self%node, self%behind, self%link)
        allocate (self%node(4, self%n_nodes), self%behind(3, size(self%later) + 1), self%link(6, size(self%link_node) + 1))
        self%node = reshape([(self%place(n), self%height(n), self%block%diagonal(n), self%origin(n), n=1, self%n_nodes)], &
            [4, self%n_nodes])
        self%behind = reshape([(self%place(self%later(k)), self%height(self%later(k)), self%block%later(k), &
            k=1, size(self%later))], [3, size(self%later) + 1], pad=[0])
        self%link = reshape([(self%place(self%link_node(l)), self%height(self%link_node(l)), 0, &
            self%origin(self%link_node(l)), 0, 0, l=1, size(self%link_node))], [6, size(self%link_node) + 1], &
            pad=[0])
        self%node_start = spread(0, 1, self%n_nodes + 1)
        do l = 1, size(self%link_node)
            self%node_start(self%link_node(l) + 1) = self%node_start(self%link_node(l) + 1) + 1
        end do
        self%node_start(1) = 1
        do n = 2, self%n_nodes + 1
            self%node_start(n) = self%node_start(n) + self%node_start(n - 1)
        end do
        allocate (next, source=self%node_start)
        if (allocated(self%node_link)) deallocate (self%node_link)
        allocate (self%node_link(4, size(self%link_node) + 1), source=0)
        do b = 1, self%n_bodies
            do l = self%link_start(b), self%link_start(b + 1) - 1
                associate (k => next(self%link_node(l)))
                    self%node_link(:2, k) = [self%first(b), self%first(b + 1) - self%first(b)]
                    k = k + 1
                end associate
            end do
        end do
    end subroutine list_for_loops

    !> Successive rows that touch the same bodies become nodes; bodies with many of them become hubs.
    subroutine gather_rows(self, pattern, rows, node_first, node_size, nodes_of, bodies_of)
        class(analysis_type), intent(inout) :: self
        type(pattern_type), intent(in) :: pattern
        integer, intent(in) :: rows(:)
        !> The first row in use of each node, and its number of rows.
        integer, allocatable, intent(out) :: node_first(:), node_size(:)
        !> The nodes of each body, the bodies of each node.
        type(list_type), allocatable, intent(out) :: nodes_of(:), bodies_of(:)
        integer, allocatable :: own_row(:)
        integer :: b, pass, i, k, n

        if (allocated(self%is_kept)) deallocate (self%is_kept)
        allocate (self%is_kept(self%n_bodies), source=.false.)
        allocate (own_row(self%n_bodies), source=0)
        do i = 1, size(rows)
            if (pattern%owner(rows(i)) > 0) own_row(pattern%owner(rows(i))) = i
        end do
        ! The choice of hubs follows from the nodes without owned rows; owned rows of hubs are nodes of their own.
        do pass = 1, 2
            n = 0
            if (allocated(node_first)) deallocate (node_first, node_size, bodies_of, nodes_of)
            allocate (node_first(size(rows)), node_size(size(rows)), source=0)
            allocate (bodies_of(size(rows)), nodes_of(self%n_bodies))
            do i = 1, size(rows)
                b = pattern%owner(rows(i))
                if (b > 0) then
                    if (.not. self%is_kept(b)) cycle
                else if (n > 0) then
                    if (belongs_to(n)) then
                        node_size(n) = node_size(n) + 1
                        cycle
                    end if
                end if
                n = n + 1
                node_first(n) = i
                node_size(n) = 1
                do k = pattern%row_start(rows(i)), pattern%row_start(rows(i) + 1) - 1
                    call append(bodies_of(n), pattern%row_body(k))
                    call append(nodes_of(pattern%row_body(k)), n)
                end do
            end do
            if (pass == 1) self%is_kept = nodes_of%n > most_links
        end do
        self%norm_row = own_row
        self%own_row = merge(0, own_row, self%is_kept)
        node_first = node_first(:n)
        node_size = node_size(:n)
        bodies_of = bodies_of(:n)

    contains

        !> True if row i follows a node's last one and touches the same bodies.
        pure logical function belongs_to(node)
            integer, intent(in) :: node
            integer :: one, two

            belongs_to = .false.
            if (i /= node_first(node) + node_size(node) .or. node_size(node) == most_rows) return
            one = rows(i)
            two = rows(node_first(node))
            if (pattern%owner(two) > 0) return
            associate (start => pattern%row_start)
                if (start(one + 1) - start(one) /= start(two + 1) - start(two)) return
                belongs_to = all(pattern%row_body(start(one):start(one + 1) - 1) == &
                    pattern%row_body(start(two):start(two + 1) - 1))
            end associate
        end function belongs_to
    end subroutine gather_rows

    !> Nodes at a body that is eliminated first are neighbours; a node at a hub is a neighbour of the hub.
    pure subroutine set_neighbours(self, nodes_of, neighbours)
        type(analysis_type), intent(in) :: self
        type(list_type), intent(in) :: nodes_of(:)
        type(list_type), intent(inout) :: neighbours(:)
        integer, allocatable :: mark(:)
        integer :: b, i, j, k, v
        type(list_type), allocatable :: bodies_of(:)

        allocate (bodies_of(size(neighbours)))
        do b = 1, self%n_bodies
            do k = 1, nodes_of(b)%n
                call append(bodies_of(nodes_of(b)%item(k)), b)
            end do
        end do
        allocate (mark(size(neighbours)), source=0)
        do v = 1, size(neighbours)
            mark(v) = v
            do i = 1, bodies_of(v)%n
                b = bodies_of(v)%item(i)
                if (self%is_kept(b)) then
                    call append(neighbours(v), self%node_of_body(b))
                    call append(neighbours(self%node_of_body(b)), v)
                    cycle
                end if
                do k = 1, nodes_of(b)%n
                    j = nodes_of(b)%item(k)
                    if (mark(j) == v) cycle
                    mark(j) = v
                    call append(neighbours(v), j)
                end do
            end do
        end do
    end subroutine set_neighbours

    !> Find the rows that must be eliminated after their hubs.
    subroutine find_waiting(self, bodies_of, waits_for)
        class(analysis_type), intent(in) :: self
        type(list_type), intent(in) :: bodies_of(:)
        type(list_type), intent(inout) :: waits_for(:)
        integer, allocatable :: parent(:)
        logical, allocatable :: is_grounded(:)
        integer :: b, i, k, root, v
        logical :: may_go

        ! Groups of bodies connected through rows that touch no hub, and whether each has a ground.
        allocate (parent(self%n_bodies))
        parent = [(b, b=1, self%n_bodies)]
        allocate (is_grounded(self%n_bodies), source=.false.)
        do v = 1, size(bodies_of)
            if (touches_kept(v)) cycle
            do i = 2, bodies_of(v)%n
                call join(bodies_of(v)%item(1), bodies_of(v)%item(i))
            end do
            if (bodies_of(v)%n == 1) is_grounded(root_of(bodies_of(v)%item(1))) = .true.
        end do
        do v = 1, size(bodies_of)
            if (.not. touches_kept(v)) cycle
            root = 0
            may_go = .true.
            do i = 1, bodies_of(v)%n
                b = bodies_of(v)%item(i)
                if (self%is_kept(b)) cycle
                k = root_of(b)
                if (root > 0 .and. k /= root) may_go = .false.
                root = k
                may_go = may_go .and. .not. is_grounded(k)
            end do
            if (may_go .and. root > 0) then
                is_grounded(root) = .true.
                cycle
            end if
            do i = 1, bodies_of(v)%n
                b = bodies_of(v)%item(i)
                if (self%is_kept(b)) call append(waits_for(v), self%node_of_body(b))
            end do
        end do

    contains

        logical function touches_kept(node)
            integer, intent(in) :: node
            integer :: l

            touches_kept = .false.
            do l = 1, bodies_of(node)%n
                touches_kept = touches_kept .or. self%is_kept(bodies_of(node)%item(l))
            end do
        end function touches_kept

        !> Representative body of the group of connected bodies.
        integer function root_of(body)
            integer, intent(in) :: body

            root_of = body
            do while (parent(root_of) /= root_of)
                parent(root_of) = parent(parent(root_of))
                root_of = parent(root_of)
            end do
        end function root_of

        subroutine join(one, two)
            integer, intent(in) :: one, two
            integer :: first, second

            first = root_of(one)
            second = root_of(two)
            if (first == second) return
            parent(second) = first
            is_grounded(first) = is_grounded(first) .or. is_grounded(second)
        end subroutine join
    end subroutine find_waiting

    !> Number nodes in their order, and list the links of each body.
    subroutine number_nodes(self, node_first, node_size, order, neighbours, nodes_of)
        class(analysis_type), intent(inout) :: self
        integer, intent(in) :: node_first(:), node_size(:), order(:)
        type(list_type), intent(in) :: neighbours(:), nodes_of(:)
        integer, allocatable :: position(:), body_of(:)
        integer :: b, i, k, n, v

        allocate (position(self%n_nodes), body_of(self%n_nodes), source=0)
        do i = 1, self%n_nodes
            position(order(i)) = i
        end do
        do b = 1, self%n_bodies
            if (self%is_kept(b)) body_of(self%node_of_body(b)) = b
        end do
        self%height = spread(0, 1, self%n_nodes)
        self%place = self%height
        self%origin = self%height
        self%is_body = self%height > 0
        self%later_start = spread(1, 1, self%n_nodes + 1)
        n = 0
        k = 0
        do i = 1, self%n_nodes
            v = order(i)
            self%is_body(i) = body_of(v) > 0
            if (self%is_body(i)) then
                self%origin(i) = self%first(body_of(v))
                self%height(i) = self%first(body_of(v) + 1) - self%first(body_of(v))
            else
                self%origin(i) = node_first(v)
                self%height(i) = node_size(v)
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
        where (self%node_of_body > 0) self%node_of_body = position(max(self%node_of_body, 1))
        n = sum(nodes_of%n)
        self%link_start = spread(1, 1, self%n_bodies + 1)
        self%link_node = spread(0, 1, n)
        self%link_offset = self%link_node
        n = 0
        do b = 1, self%n_bodies
            do i = 1, nodes_of(b)%n
                n = n + 1
                self%link_node(n) = position(nodes_of(b)%item(i))
            end do
            self%link_start(b + 1) = n + 1
        end do
    end subroutine number_nodes

    !> Numbers in ascending order, by insertion: lists are short.
    pure function sorted(list)
        integer, intent(in) :: list(:)
        integer :: sorted(size(list)), i, j, x

        sorted = list
        do i = 2, size(list)
            x = sorted(i)
            j = i - 1
            do while (j > 0)
                if (sorted(j) <= x) exit
                sorted(j + 1) = sorted(j)
                j = j - 1
            end do
            sorted(j + 1) = x
        end do
    end function sorted

    !> Set the offsets of the blocks of the factor: a node's diagonal block, then the blocks below it.
    pure subroutine place_blocks(self)
        class(analysis_type), intent(inout) :: self
        integer(long) :: below
        integer :: i, k

        self%block%diagonal = spread(0, 1, self%n_nodes)
        self%block%later = spread(0, 1, size(self%later))
        self%block%n_entries = 0
        self%work = 0
        do i = 1, self%n_nodes
            self%block%diagonal(i) = self%block%n_entries
            self%block%n_entries = self%block%n_entries + self%height(i)**2
            below = 0
            do k = self%later_start(i), self%later_start(i + 1) - 1
                self%block%later(k) = self%block%n_entries
                self%block%n_entries = self%block%n_entries + self%height(i)*self%height(self%later(k))
                below = below + self%height(self%later(k))
            end do
            self%work = self%work + self%height(i)*(self%height(i) + below)**2
        end do
    end subroutine place_blocks

    !> Offset of the block of two nodes; the diagonal block for a node with itself.
    pure integer function block_of(self, one, two) result(offset)
        class(analysis_type), intent(in) :: self
        integer, intent(in) :: one, two
        integer :: earlier, from, middle, to, wanted

        earlier = min(one, two)
        wanted = max(one, two)
        if (earlier == wanted) then
            offset = self%block%diagonal(one)
            return
        end if
        from = self%later_start(earlier)
        to = self%later_start(earlier + 1) - 1
        do while (from < to)
            middle = (from + to)/2
            if (self%later(middle) < wanted) then
                from = middle + 1
            else
                to = middle
            end if
        end do
        offset = self%block%later(from)
    end function block_of

    !> Set the targets of the products of the neighbours of each node.
    pure subroutine find_updates(self)
        class(analysis_type), intent(inout) :: self
        integer :: i, j, k, n

        self%target%update_start = spread(0, 1, self%n_nodes + 1)
        n = 0
        do i = 1, self%n_nodes
            associate (count => self%later_start(i + 1) - self%later_start(i))
                n = n + count*(count + 1)/2
            end associate
            self%target%update_start(i + 1) = n
        end do
        self%target%update = spread(0, 1, n + 1)
        n = 0
        do i = 1, self%n_nodes
            do j = self%later_start(i), self%later_start(i + 1) - 1
                do k = self%later_start(i), j
                    n = n + 1
                    self%target%update(n) = self%block_of(self%later(j), self%later(k))
                end do
            end do
        end do
    end subroutine find_updates

    !> Set the targets of the parts of the bodies.
    pure subroutine find_pairs(self)
        class(analysis_type), intent(inout) :: self
        integer :: b, count, j, k, n

        self%target%pair_start = spread(0, 1, self%n_bodies + 1)
        n = 0
        do b = 1, self%n_bodies
            count = self%link_start(b + 1) - self%link_start(b)
            n = n + merge(count, count*(count + 1)/2, self%is_kept(b))
            self%target%pair_start(b + 1) = n
        end do
        self%target%pair = spread(0, 1, n)
        n = 0
        do b = 1, self%n_bodies
            do j = self%link_start(b), self%link_start(b + 1) - 1
                if (self%is_kept(b)) then
                    n = n + 1
                    self%target%pair(n) = self%block_of(self%link_node(j), self%node_of_body(b))
                    cycle
                end if
                do k = self%link_start(b), j
                    n = n + 1
                    self%target%pair(n) = self%block_of(self%link_node(j), self%link_node(k))
                end do
            end do
        end do
    end subroutine find_pairs
end module tandem_chart_sparse_analysis
