! SPDX-License-Identifier: MIT
!> The order in which a symmetric matrix of blocks is eliminated: always the block with the fewest neighbours that may go (minimum
!> degree). Neighbours of what is gone become each other's, and these lists are the structure of the factor.
module tandem_chart_sparse_order
    implicit none (type, external)
    private

    public :: list_type, order_nodes, append

    !> A list of numbers that grows.
    type :: list_type
        integer :: n = 0
        integer, allocatable :: item(:)
    end type list_type

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

    !> Order the nodes of a graph.
    subroutine order_nodes(neighbours, waits_for, order)
        !> The neighbours of each node, each once; afterwards those that were left when it went.
        type(list_type), intent(inout) :: neighbours(:)
        !> The nodes that must go before each one; none of them waits.
        type(list_type), intent(in) :: waits_for(:)
        !> The nodes in the order in which they go.
        integer, intent(out) :: order(:)
        integer, allocatable :: head(:), next(:), before(:), degree(:), waits(:), mark(:)
        logical, allocatable :: is_gone(:)
        type(list_type), allocatable :: awaited(:)
        integer :: i, k, n, least, v

        n = size(neighbours)
        allocate (head(0:n), next(n), before(n), degree(n), waits(n), mark(n), source=0)
        allocate (is_gone(n), source=.false.)
        allocate (awaited(n))
        do v = 1, n
            degree(v) = neighbours(v)%n
            waits(v) = waits_for(v)%n
            do k = 1, waits_for(v)%n
                call append(awaited(waits_for(v)%item(k)), v)
            end do
        end do
        ! The first comes out first, and then its neighbours: what follows each other stands side by side in memory.
        do v = n, 1, -1
            if (waits(v) == 0) call enter(v)
        end do
        least = 0
        do i = 1, n
            do while (head(least) == 0)
                least = least + 1
            end do
            v = head(least)
            call leave(v)
            is_gone(v) = .true.
            order(i) = v
            call drop_gone(v)
            call join_neighbours(v)
            do k = 1, awaited(v)%n
                associate (u => awaited(v)%item(k))
                    waits(u) = waits(u) - 1
                    if (waits(u) == 0) call enter(u)
                end associate
            end do
        end do

    contains

        !> A node that may go.
        subroutine enter(u)
            integer, intent(in) :: u

            before(u) = 0
            next(u) = head(degree(u))
            if (next(u) > 0) before(next(u)) = u
            head(degree(u)) = u
            least = min(least, degree(u))
        end subroutine enter

        subroutine leave(u)
            integer, intent(in) :: u

            if (before(u) > 0) then
                next(before(u)) = next(u)
            else
                head(degree(u)) = next(u)
            end if
            if (next(u) > 0) before(next(u)) = before(u)
        end subroutine leave

        !> Keep only those neighbours that are there.
        subroutine drop_gone(u)
            integer, intent(in) :: u
            integer :: j, kept

            kept = 0
            do j = 1, neighbours(u)%n
                if (is_gone(neighbours(u)%item(j))) cycle
                kept = kept + 1
                neighbours(u)%item(kept) = neighbours(u)%item(j)
            end do
            neighbours(u)%n = kept
        end subroutine drop_gone

        !> The neighbours of a node that goes become each other's.
        subroutine join_neighbours(v)
            integer, intent(in) :: v
            integer :: j, l, u

            do j = 1, neighbours(v)%n
                u = neighbours(v)%item(j)
                if (waits(u) == 0) call leave(u)
                if (neighbours(v)%n == 1) then
                    ! Gone ones stay in its list until it is looked at.
                    degree(u) = degree(u) - 1
                else
                    call drop_gone(u)
                    do l = 1, neighbours(u)%n
                        mark(neighbours(u)%item(l)) = u
                    end do
                    mark(u) = u
                    do l = 1, neighbours(v)%n
                        if (mark(neighbours(v)%item(l)) /= u) call append(neighbours(u), neighbours(v)%item(l))
                    end do
                    degree(u) = neighbours(u)%n
                end if
                if (waits(u) == 0) call enter(u)
            end do
        end subroutine join_neighbours
    end subroutine order_nodes
end module tandem_chart_sparse_order
