! SPDX-License-Identifier: MIT
!> Structure of a model: the rows and forces that each coordinate may change, and groups of coordinates whose derivatives can be
!> computed together by differences, because their bodies have no neighbour in common.
!>
!> Matrices of derivatives have one column per coordinate, or are compressed so that the coordinates of a group share a column.
!>
!> Source: A. R. Curtis, M. J. D. Powell, J. K. Reid, J. Inst. Maths Applics 13 (1974) 117-119.
module tandem_model_structure
    use tandem_linalg_order, only: list_type
    use tandem_model_lists, only: sort_to_lists
    use tandem_model_neighbours, only: find_groups, find_neighbours
    use tandem_model_pattern, only: pattern_type
    implicit none (type, external)
    private

    public :: structure_type

    type :: structure_type
        !> True if the structure is that of the model's pattern; true if matrices are compressed.
        logical :: is_of_pattern = .false., is_compressed = .false.
        !> Number of columns of the matrices; column of each coordinate (n).
        integer :: width = 0
        integer, allocatable :: column(:)
        !> Groups of coordinates: direction(start(k):start(k + 1) - 1).
        integer :: n_directions = 0
        integer, allocatable :: start(:), direction(:)
        !> Coordinate j belongs to the set s = set(j), which may change the rows rows(row_start(s):row_start(s + 1) - 1) and the
        !> forces on the coordinates forces(force_start(s):force_start(s + 1) - 1).
        integer, allocatable :: set(:), row_start(:), rows(:), force_start(:), forces(:)
    contains
        procedure :: set_full, use_pattern, coordinate_of_row, coordinate_of_force
    end type structure_type

contains

    !> Set the full structure: every coordinate may change everything.
    pure subroutine set_full(self, n, m)
        class(structure_type), intent(inout) :: self
        !> Numbers of coordinates and of constraint rows.
        integer, intent(in) :: n, m
        integer :: i

        self%is_of_pattern = .false.
        self%is_compressed = .false.
        self%width = n
        self%n_directions = n
        self%column = [(i, i=1, n)]
        self%start = [(i, i=1, n + 1)]
        self%direction = [(i, i=1, n)]
        self%set = spread(1, 1, n)
        self%row_start = [1, m + 1]
        self%rows = [(i, i=1, m)]
        self%force_start = [1, n + 1]
        self%forces = [(i, i=1, n)]
    end subroutine set_full

    !> Set the structure of a pattern: a coordinate may change the rows of its body, and the forces on its body and on neighbours of
    !> it.
    subroutine use_pattern(self, pattern, is_compressed)
        class(structure_type), intent(inout) :: self
        type(pattern_type), intent(in) :: pattern
        !> True to compress matrices.
        logical, intent(in) :: is_compressed
        type(list_type), allocatable :: neighbours(:)
        integer, allocatable :: group(:), row_of(:)
        integer :: b, g, i, j, l, n, n_groups, most

        self%is_of_pattern = .true.
        self%is_compressed = is_compressed
        call find_neighbours(pattern, neighbours)
        call find_groups(neighbours, pattern%n_bodies, group, n_groups)
        associate (first => pattern%first)
            n = first(pattern%n_bodies + 1) - 1
            allocate (row_of(size(pattern%row_body)))
            do i = 1, pattern%n_rows
                row_of(pattern%row_start(i):pattern%row_start(i + 1) - 1) = i
            end do
            call sort_to_lists(pattern%n_bodies, pattern%row_body, row_of, self%row_start, self%rows)
            call list_forces(first, neighbours, self%force_start, self%forces)
            self%set = spread(0, 1, n)
            self%column = self%set
            self%direction = self%set
            self%start = spread(1, 1, n + 1)
            do b = 1, pattern%n_bodies
                self%set(first(b):first(b + 1) - 1) = b
            end do
            ! Coordinate l of every body of a group.
            self%n_directions = 0
            j = 0
            do g = 1, n_groups
                most = maxval(first(2:) - first(:pattern%n_bodies), mask=group == g)
                do l = 1, most
                    self%n_directions = self%n_directions + 1
                    do b = 1, pattern%n_bodies
                        if (group(b) /= g .or. first(b) + l > first(b + 1)) cycle
                        j = j + 1
                        self%direction(j) = first(b) + l - 1
                        self%column(first(b) + l - 1) = self%n_directions
                    end do
                    self%start(self%n_directions + 1) = j + 1
                end do
            end do
        end associate
        self%width = self%n_directions
        if (is_compressed) return
        self%width = n
        self%column = [(j, j=1, n)]
    end subroutine use_pattern

    !> List the coordinates of each body and of its neighbours.
    subroutine list_forces(first, neighbours, start, forces)
        integer, intent(in) :: first(:)
        type(list_type), intent(in) :: neighbours(:)
        integer, allocatable, intent(out) :: start(:), forces(:)
        integer :: b, k, n, pass

        allocate (start(size(first)), source=1)
        do pass = 1, 2
            n = 0
            do b = 1, size(neighbours)
                call add(b)
                do k = 1, neighbours(b)%n
                    call add(neighbours(b)%item(k))
                end do
                start(b + 1) = n + 1
            end do
            if (pass == 1) allocate (forces(n), source=0)
        end do

    contains

        !> Append the coordinates of a body.
        subroutine add(body)
            integer, intent(in) :: body
            integer :: i

            do i = first(body), first(body + 1) - 1
                n = n + 1
                if (pass == 2) forces(n) = i
            end do
        end subroutine add
    end subroutine list_forces

    !> A coordinate of the given column that may change the given row; any coordinate of the column if there is none.
    pure integer function coordinate_of_row(self, row, column) result(coordinate)
        class(structure_type), intent(in) :: self
        integer, intent(in) :: row, column

        coordinate = coordinate_of(self, row, column, self%row_start, self%rows)
    end function coordinate_of_row

    !> A coordinate of the given column that may change the given force; any coordinate of the column if there is none.
    pure integer function coordinate_of_force(self, row, column) result(coordinate)
        class(structure_type), intent(in) :: self
        integer, intent(in) :: row, column

        coordinate = coordinate_of(self, row, column, self%force_start, self%forces)
    end function coordinate_of_force

    !> A coordinate of the given column that may change the given row or force, by its lists.
    pure integer function coordinate_of(self, row, column, start, changed) result(coordinate)
        class(structure_type), intent(in) :: self
        integer, intent(in) :: row, column, start(:), changed(:)
        integer :: j

        do j = 1, size(self%column)
            if (self%column(j) /= column) cycle
            coordinate = j
            if (any(changed(start(self%set(j)):start(self%set(j) + 1) - 1) == row)) return
        end do
        coordinate = findloc(self%column, column, dim=1)
    end function coordinate_of
end module tandem_model_structure
