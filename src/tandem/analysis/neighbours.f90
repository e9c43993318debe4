! SPDX-License-Identifier: MIT
!> Which bodies of a large mechanism are neighbours, and groups of bodies whose columns of a matrix can be found together.
!>
!> Source: A. R. Curtis, M. J. D. Powell, J. K. Reid, J. Inst. Maths Applics 13 (1974) 117-119.
module tandem_analysis_neighbours
    use tandem_chart_sparse_order, only: append, list_type
    use tandem_model_pattern, only: pattern_type
    implicit none (type, external)
    private

    public :: find_neighbours, find_groups, most_groups

    !> The most groups of bodies: more would be as good as dense.
    integer, parameter :: most_groups = 100

contains

    !> The bodies with which each one shares a row or a force.
    pure subroutine find_neighbours(pattern, neighbours)
        type(pattern_type), intent(in) :: pattern
        type(list_type), allocatable, intent(out) :: neighbours(:)
        type(list_type), allocatable :: all_of(:)
        integer, allocatable :: mark(:)
        integer :: b, i, j, k

        allocate (all_of(pattern%n_bodies), neighbours(pattern%n_bodies))
        allocate (mark(pattern%n_bodies), source=0)
        do i = 1, pattern%n_rows
            ! Rows of a joint touch the same bodies.
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

        pure logical function is_as_before(row)
            integer, intent(in) :: row

            associate (s => pattern%row_start)
                is_as_before = s(row + 1) - s(row) == s(row) - s(row - 1)
                if (is_as_before) is_as_before = all(pattern%row_body(s(row):s(row + 1) - 1) == &
                    pattern%row_body(s(row - 1):s(row) - 1))
            end associate
        end function is_as_before
    end subroutine find_neighbours

    !> Groups of bodies that have no neighbour in common, and are none of each other.
    pure subroutine find_groups(neighbours, group, n_groups)
        type(list_type), intent(in) :: neighbours(:)
        integer, allocatable, intent(out) :: group(:)
        integer, intent(out) :: n_groups
        integer, allocatable :: taken_by(:)
        integer :: b, g, i, j, near

        allocate (group(size(neighbours)), taken_by(size(neighbours) + 1), source=0)
        n_groups = 0
        do b = 1, size(neighbours)
            do i = 1, neighbours(b)%n
                near = neighbours(b)%item(i)
                if (group(near) > 0) taken_by(group(near)) = b
                do j = 1, neighbours(near)%n
                    g = group(neighbours(near)%item(j))
                    if (g > 0) taken_by(g) = b
                end do
            end do
            g = 1
            do while (taken_by(g) == b)
                g = g + 1
            end do
            group(b) = g
            n_groups = max(n_groups, g)
            if (n_groups > most_groups) return
        end do
    end subroutine find_groups
end module tandem_analysis_neighbours
