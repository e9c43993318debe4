! SPDX-License-Identifier: MIT
!> The order in which a symmetric matrix of blocks is eliminated: always the block with the fewest neighbours that may go (minimum
!> degree). Neighbours of what is gone become each other's, and these lists are the structure of the factor. Of blocks with as many,
!> the one that has waited longest goes: a chain is eliminated from both of its ends in turn, so that a processor has two blocks to
!> work on of which neither waits for the other.
module tandem_linalg_order
    implicit none (type, external)
    private

    public :: list_type, order_nodes, append

    !> A list of numbers that grows.
    type :: list_type
        integer :: n = 0
        integer, allocatable :: item(:)
    end type list_type

    !> Nodes by their number of neighbours: of each the first and the last node, and chains in both directions.
    type :: queue_type
        integer :: least = 0
        integer, allocatable :: head(:), tail(:), next(:), before(:), degree(:)
    contains
        procedure :: enter, leave, take
    end type queue_type

contains

    !> One number more.
    pure subroutine append(list, number)
        type(list_type), intent(inout) :: list
        integer, intent(in) :: number
        integer, allocatable :: longer(:)

        if (.not. allocated(list%item)) allocate (list%item(4))
        if (list%n == size(list%item)) then
            allocate (longer(2*list%n))
            longer(:list%n) = list%item
            call move_alloc(longer, list%item)
        end if
        list%n = list%n + 1
        list%item(list%n) = number
    end subroutine append

    !> A node that may go.
    pure subroutine enter(self, node)
        class(queue_type), intent(inout) :: self
        integer, intent(in) :: node

        associate (degree => self%degree(node))
            self%before(node) = self%tail(degree)
            self%next(node) = 0
            if (self%before(node) > 0) then
                self%next(self%before(node)) = node
            else
                self%head(degree) = node
            end if
            self%tail(degree) = node
            self%least = min(self%least, degree)
        end associate
    end subroutine enter

    !> A node whose number of neighbours changes, or that goes.
    pure subroutine leave(self, node)
        class(queue_type), intent(inout) :: self
        integer, intent(in) :: node

        if (self%before(node) > 0) then
            self%next(self%before(node)) = self%next(node)
        else
            self%head(self%degree(node)) = self%next(node)
        end if
        if (self%next(node) > 0) then
            self%before(self%next(node)) = self%before(node)
        else
            self%tail(self%degree(node)) = self%before(node)
        end if
    end subroutine leave

    !> The node with the fewest neighbours, of these the one that entered first; some node is there.
    pure subroutine take(self, node)
        class(queue_type), intent(inout) :: self
        integer, intent(out) :: node

        do while (self%head(self%least) == 0)
            self%least = self%least + 1
        end do
        node = self%head(self%least)
        call self%leave(node)
    end subroutine take

    !> Order the nodes of a graph.
    subroutine order_nodes(neighbours, waits_for, order)
        !> The neighbours of each node, each once; afterwards those that were left when it went.
        type(list_type), intent(inout) :: neighbours(:)
        !> The nodes that must go before each one; none of them waits.
        type(list_type), intent(in) :: waits_for(:)
        !> The nodes in the order in which they go.
        integer, intent(out) :: order(:)
        integer, allocatable :: waits(:), mark(:)
        logical, allocatable :: is_gone(:)
        type(list_type), allocatable :: awaited(:)
        type(queue_type) :: queue
        integer :: i, k, n, v

        n = size(neighbours)
        allocate (queue%head(0:n), queue%tail(0:n), queue%next(n), queue%before(n), queue%degree(n), waits(n), mark(n), source=0)
        allocate (is_gone(n), source=.false.)
        allocate (awaited(n))
        do v = 1, n
            queue%degree(v) = neighbours(v)%n
            waits(v) = waits_for(v)%n
            do k = 1, waits_for(v)%n
                call append(awaited(waits_for(v)%item(k)), v)
            end do
        end do
        do v = 1, n
            if (waits(v) == 0) call queue%enter(v)
        end do
        do i = 1, n
            call queue%take(v)
            is_gone(v) = .true.
            order(i) = v
            call drop_gone(is_gone, neighbours(v))
            do k = 1, neighbours(v)%n
                associate (u => neighbours(v)%item(k))
                    if (waits(u) == 0) call queue%leave(u)
                    call join(v, u, is_gone, mark, neighbours, queue%degree(u))
                    if (waits(u) == 0) call queue%enter(u)
                end associate
            end do
            do k = 1, awaited(v)%n
                associate (u => awaited(v)%item(k))
                    waits(u) = waits(u) - 1
                    if (waits(u) == 0) call queue%enter(u)
                end associate
            end do
        end do
    end subroutine order_nodes

    !> Keep only those neighbours that are there.
    pure subroutine drop_gone(is_gone, list)
        logical, intent(in) :: is_gone(:)
        type(list_type), intent(inout) :: list
        integer :: j, kept

        kept = 0
        do j = 1, list%n
            if (is_gone(list%item(j))) cycle
            kept = kept + 1
            list%item(kept) = list%item(j)
        end do
        list%n = kept
    end subroutine drop_gone

    !> The other neighbours of a node that goes become those of one neighbour.
    pure subroutine join(gone, node, is_gone, mark, neighbours, degree)
        integer, intent(in) :: gone, node
        logical, intent(in) :: is_gone(:)
        !> Work space; no entry is the number of a node that was not joined before.
        integer, intent(inout) :: mark(:)
        type(list_type), intent(inout) :: neighbours(:)
        !> How many the neighbour has then.
        integer, intent(inout) :: degree
        integer :: l

        if (neighbours(gone)%n == 1) then
            ! The gone one stays in its list until that is looked at.
            degree = degree - 1
            return
        end if
        call drop_gone(is_gone, neighbours(node))
        mark(node) = node
        do l = 1, neighbours(node)%n
            mark(neighbours(node)%item(l)) = node
        end do
        do l = 1, neighbours(gone)%n
            if (mark(neighbours(gone)%item(l)) /= node) call append(neighbours(node), neighbours(gone)%item(l))
        end do
        degree = neighbours(node)%n
        ! It may be joined again.
        do l = 1, neighbours(node)%n
            mark(neighbours(node)%item(l)) = 0
        end do
        mark(node) = 0
    end subroutine join
end module tandem_linalg_order
