! SPDX-License-Identifier: MIT
!> Neighbouring bodies of a large mechanism, and groups of bodies whose columns of a matrix can be computed together by differences.
!>
!> Source: A. R. Curtis, M. J. D. Powell, J. K. Reid, J. Inst. Maths Applics 13 (1974) 117-119.
module tandem_model_neighbours
    use tandem_linalg_order, only: append, list_type, order_nodes
    use tandem_model_pattern, only: pattern_type
    implicit none (type, external)
    private

    public :: find_neighbours, find_groups, order_unknowns

contains

    !> List the neighbours of each body: the bodies with which it shares a constraint row or a force.
    pure subroutine find_neighbours(pattern, neighbours)
        type(pattern_type), intent(in) :: pattern
        type(list_type), allocatable, intent(out) :: neighbours(:)
        type(list_type), allocatable :: all_of(:)
        integer, allocatable :: mark(:)
        integer :: b, i, j, k

        allocate (all_of(pattern%n_bodies), neighbours(pattern%n_bodies))
        allocate (mark(pattern%n_bodies), source=0)
        do i = 1, pattern%n_rows
            ! Successive rows of a joint involve the same bodies.
            if (i > 1) then
                if (is_as_before(i)) cycle
            end if
            do k = pattern%row_start(i), pattern%row_start(i + 1) - 1
                do j = pattern%row_start(i), pattern%row_start(i + 1) - 1
                    if (j /= k) call append(all_of(pattern%row_body(k)), pattern%row_body(j))
                end do
            end do
        end do
        if (allocated(pattern%coupled)) then
            do k = 1, size(pattern%coupled, 2)
                if (any(pattern%coupled(:, k) == 0)) cycle
                call append(all_of(pattern%coupled(1, k)), pattern%coupled(2, k))
                call append(all_of(pattern%coupled(2, k)), pattern%coupled(1, k))
            end do
        end if
        do b = 1, pattern%n_bodies
            mark(b) = b
            do k = 1, all_of(b)%n
                if (mark(all_of(b)%item(k)) == b) cycle
                mark(all_of(b)%item(k)) = b
                call append(neighbours(b), all_of(b)%item(k))
            end do
        end do

    contains

        !> True if a row has the same bodies as the previous one.
        pure logical function is_as_before(row)
            integer, intent(in) :: row

            associate (s => pattern%row_start)
                is_as_before = s(row + 1) - s(row) == s(row) - s(row - 1)
                if (is_as_before) is_as_before = all(pattern%row_body(s(row):s(row + 1) - 1) == &
                    pattern%row_body(s(row - 1):s(row) - 1))
            end associate
        end function is_as_before
    end subroutine find_neighbours

    !> Partition bodies into groups. Two bodies of a group neither are neighbours nor have a neighbour in common. Stops, with bodies
    !> left over, once there are more than `most` groups.
    pure subroutine find_groups(neighbours, most, group, n_groups)
        type(list_type), intent(in) :: neighbours(:)
        integer, intent(in) :: most
        integer, allocatable, intent(out) :: group(:)
        integer, intent(out) :: n_groups
        integer, allocatable :: used_by(:)
        integer :: b, g, i, j, near

        allocate (group(size(neighbours)), used_by(size(neighbours) + 1), source=0)
        n_groups = 0
        do b = 1, size(neighbours)
            do i = 1, neighbours(b)%n
                near = neighbours(b)%item(i)
                if (group(near) > 0) used_by(group(near)) = b
                do j = 1, neighbours(near)%n
                    g = group(neighbours(near)%item(j))
                    if (g > 0) used_by(g) = b
                end do
            end do
            g = 1
            do while (used_by(g) == b)
                g = g + 1
            end do
            group(b) = g
            n_groups = max(n_groups, g)
            if (n_groups > most) return
        end do
    end subroutine find_groups

    !> Elimination order of coordinates and constraint rows with little fill-in: coordinates by bodies, each row with the first of
    !> its bodies.
    subroutine order_unknowns(pattern, neighbours, order)
        type(pattern_type), intent(in) :: pattern
        type(list_type), intent(in) :: neighbours(:)
        !> Coordinates by their indices, rows by their indices plus the number of coordinates (n + m).
        integer, allocatable, intent(out) :: order(:)
        type(list_type), allocatable :: left(:), none(:), rows_of(:)
        integer, allocatable :: of_bodies(:), place_of(:)
        integer :: b, i, j, k, l, n, n_coordinates, first

        associate (n_bodies => pattern%n_bodies)
            allocate (left, source=neighbours)
            allocate (none(n_bodies), rows_of(n_bodies), of_bodies(n_bodies), place_of(n_bodies))
            call order_nodes(left, none, of_bodies)
            do b = 1, n_bodies
                place_of(of_bodies(b)) = b
            end do
            do i = 1, pattern%n_rows
                first = 0
                do k = pattern%row_start(i), pattern%row_start(i + 1) - 1
                    b = pattern%row_body(k)
                    if (first == 0) first = b
                    if (place_of(b) < place_of(first)) first = b
                end do
                if (first > 0) call append(rows_of(first), i)
            end do
            n_coordinates = pattern%first(n_bodies + 1) - 1
            allocate (order(n_coordinates + pattern%n_rows))
            n = 0
            do l = 1, n_bodies
                b = of_bodies(l)
                do j = pattern%first(b), pattern%first(b + 1) - 1
                    n = n + 1
                    order(n) = j
                end do
                do k = 1, rows_of(b)%n
                    n = n + 1
                    order(n) = n_coordinates + rows_of(b)%item(k)
                end do
            end do
            ! Rows without bodies.
            do i = 1, pattern%n_rows
                if (pattern%row_start(i + 1) > pattern%row_start(i)) cycle
                n = n + 1
                order(n) = n_coordinates + i
            end do
        end associate
    end subroutine order_unknowns
end module tandem_model_neighbours
