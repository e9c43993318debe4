! SPDX-License-Identifier: MIT
!> Sparsity of C and M as declared by a model: its bodies, which are ranges of coordinates that contain the blocks of M, and the
!> bodies of each row of C. The terms can then be stored in compressed form, C as (m, width) and M as (n, mass_width), so that
!> memory is proportional to the number of bodies.
!>
!> Bodies with a common row have separate columns; others may share columns, by the graph colouring of A. R. Curtis, M. J. D.
!> Powell, J. K. Reid, J. Inst. Maths Applics 13 (1974) 117-119. Entry (i, j) of C is stored in (i, column(j)) for every row i that
!> contains the body of j, and entry (i, j) of M in (i, mass_column(j)).
module tandem_model_pattern
    use tandem_error, only: to_text
    use tandem_kinds, only: long, wp
    use tandem_model_lists, only: sort_to_lists
    implicit none (type, external)
    private

    public :: pattern_type

    type :: pattern_type
        !> Numbers of bodies, of rows, of columns of compressed C and M, and of entries of C.
        integer :: n_bodies = 0, n_rows = 0, width = 0, mass_width = 0, n_entries = 0
        !> First coordinate of each body, and the number of coordinates plus one (n_bodies + 1).
        integer, allocatable :: first(:)
        !> Bodies of row i: row_body(row_start(i):row_start(i + 1) - 1), ascending.
        integer, allocatable :: row_start(:), row_body(:)
        !> Owner of a row, 0 if none. The owner is the only body in the row, and its block of M is singular without the row, which
        !> is the norm of its Euler parameters. A body owns at most one row.
        integer, allocatable :: owner(:)
        !> Compressed columns of C and M (n).
        integer, allocatable :: column(:), mass_column(:)
        !> Blocks that a chart requests: the entries of several consecutive rows in the columns of one body, stored as (rows,
        !> coordinates) in `terms%blocks`, where entries that are not set are zero. For each row, number of rows in the block that
        !> begins with it, 0 if none (n_rows); for each entry of `row_body`, offset of its block. Not allocated if no blocks are
        !> requested. For joints with coincident points (see below), the columns of positions are constant: models do not set them,
        !> and blocks may omit them.
        integer, allocatable :: block_height(:), block_start(:)
        !> True for rows at which a block begins that the model sets in place of `terms%jacobian` (n_rows). Not allocated if the
        !> model sets no blocks, or before `note_blocks`.
        logical, allocatable :: in_blocks(:)
        !> True if the model sets all requested blocks.
        logical :: all_in_blocks = .false.
        !> Joints that begin with the rows of coincident points: hinges in space and pins in the plane. For each row, number of rows
        !> of the joint that begins with it: 5, 2, or 0 if none (n_rows). For each entry of `row_body`, sign of the body's position:
        !> C has the unit matrix with this sign in the first 3 or 2 rows of the joint, and zeros in the other rows. Not allocated if
        !> the model declares no such joints.
        integer, allocatable :: meeting_height(:), meeting_sign(:)
        !> Fault of the arguments of `build`, blank if none. `check_model` reports it.
        character(len=120) :: fault = ''
        !> Pairs of bodies whose forces depend on each other's coordinates (2, number of pairs), for `evaluate_stiffness` and for
        !> the analysis of large systems. Repetitions are allowed, and 0 denotes the ground. Not allocated if there are none.
        integer, allocatable :: coupled(:, :)
    contains
        procedure :: build, tell_meeting, find_fault, multiply, add_transposed, multiply_mass, add_row_scales, block_of
        procedure, private :: colour
    end type pattern_type

contains

    !> Set bodies and rows.
    pure subroutine build(self, first, mass_blocks, n_rows, rows, bodies, owner)
        class(pattern_type), intent(inout) :: self
        !> First coordinate of each body, and n + 1; sizes of the diagonal blocks of M in order.
        integer, intent(in) :: first(:), mass_blocks(:)
        integer, intent(in) :: n_rows
        !> Pairs of a row and a body in any order. Repetitions are allowed; body 0 denotes the ground and is ignored.
        integer, intent(in) :: rows(:), bodies(:)
        !> Owners of the rows (n_rows), 0 if none.
        integer, intent(in) :: owner(:)
        integer :: b, j, k, n

        self%fault = argument_fault(first, mass_blocks, n_rows, rows, bodies, owner)
        if (self%fault /= '') return
        self%n_bodies = size(first) - 1
        self%n_rows = n_rows
        self%first = first
        self%owner = owner
        call sort_to_lists(n_rows, rows, bodies, self%row_start, self%row_body)
        self%n_entries = 0
        do k = 1, size(self%row_body)
            b = self%row_body(k)
            self%n_entries = self%n_entries + first(b + 1) - first(b)
        end do
        call self%colour()
        self%mass_column = spread(0, 1, first(self%n_bodies + 1) - 1)
        n = 0
        do k = 1, size(mass_blocks)
            self%mass_column(n + 1:n + mass_blocks(k)) = [(j, j=1, mass_blocks(k))]
            n = n + mass_blocks(k)
        end do
        self%mass_width = maxval(mass_blocks)
        if (allocated(self%block_height)) deallocate (self%block_height, self%block_start)
        if (allocated(self%in_blocks)) deallocate (self%in_blocks)
        if (allocated(self%meeting_height)) deallocate (self%meeting_height, self%meeting_sign)
    end subroutine build

    !> Declare a joint that begins with the rows of coincident points.
    pure subroutine tell_meeting(self, row, height, first_body)
        class(pattern_type), intent(inout) :: self
        !> First row, number of rows, and the body whose position has a negative sign, 0 for the ground.
        integer, intent(in) :: row, height, first_body
        integer :: k

        if (.not. allocated(self%meeting_height)) then
            allocate (self%meeting_height(self%n_rows), self%meeting_sign(size(self%row_body)), source=0)
        end if
        self%meeting_height(row) = height
        do k = self%row_start(row), self%row_start(row + 1) - 1
            self%meeting_sign(k) = merge(-1, 1, self%row_body(k) == first_body)
        end do
    end subroutine tell_meeting

    !> Offset in `terms%blocks` of the block of several rows and a body; -1 if the chart has not requested a block of exactly these
    !> rows.
    pure integer function block_of(self, row, height, body)
        class(pattern_type), intent(in) :: self
        !> First row, number of rows, and body.
        integer, intent(in) :: row, height, body
        integer :: k

        block_of = -1
        if (self%block_height(row) /= height) return
        do k = self%row_start(row), self%row_start(row + 1) - 1
            if (self%row_body(k) == body) block_of = self%block_start(k)
        end do
    end function block_of

    !> Fault of the lists given to `build`, blank if none.
    pure function argument_fault(first, mass_blocks, n_rows, rows, bodies, owner) result(fault)
        integer, intent(in) :: first(:), mass_blocks(:), n_rows, rows(:), bodies(:), owner(:)
        character(len=120) :: fault
        integer :: k, n

        fault = ''
        n = size(first) - 1
        if (n < 1) then
            fault = 'first has '//to_text(size(first))//' entries: it needs the first coordinate of each body, and n + 1'
        else if (first(1) /= 1 .or. any(first(2:) <= first(:n))) then
            fault = 'first does not ascend from 1'
        else if (any(mass_blocks < 1) .or. sum(int(mass_blocks, long)) /= first(n + 1) - 1) then
            fault = 'mass_blocks are not positive sizes that add up to the coordinates of the bodies'
        else if (size(owner) /= n_rows) then
            fault = 'owner has '//to_text(size(owner))//' entries for '//to_text(n_rows)//' rows'
        else if (size(rows) /= size(bodies)) then
            fault = 'there are '//to_text(size(rows))//' rows in pairs with '//to_text(size(bodies))//' bodies'
        else
            do k = 1, size(rows)
                if (rows(k) < 1 .or. rows(k) > n_rows .or. bodies(k) < 0 .or. bodies(k) > n) exit
            end do
            if (k <= size(rows)) fault = 'pair '//to_text(k)//' is of row '//to_text(rows(k))//' and body '// &
                to_text(bodies(k))//', where there are '//to_text(n_rows)//' rows and '//to_text(n)//' bodies'
        end if
    end function argument_fault

    !> Mismatch between a pattern and a model with n coordinates and m constraints, or contradiction within the pattern; blank if
    !> none. With such a fault a chart would read undefined entries or misinterpret rows.
    pure function find_fault(self, n, m) result(fault)
        class(pattern_type), intent(in) :: self
        integer, intent(in) :: n, m
        character(len=120) :: fault

        fault = self%fault
        if (fault /= '') return
        if (.not. (allocated(self%first) .and. allocated(self%row_start) .and. allocated(self%row_body) .and. &
            allocated(self%owner) .and. allocated(self%column) .and. allocated(self%mass_column))) then
            fault = 'it was not built'
        else if (self%n_rows /= m .or. size(self%row_start) /= self%n_rows + 1 .or. size(self%owner) /= self%n_rows) then
            fault = 'it has '//to_text(self%n_rows)//' rows, and the model '//to_text(m)//' constraints'
        else if (size(self%first) /= self%n_bodies + 1 .or. self%n_bodies < 1) then
            fault = 'first does not have an entry for each body and one more'
        else if (self%first(1) /= 1 .or. any(self%first(2:) <= self%first(:self%n_bodies)) .or. &
            self%first(self%n_bodies + 1) /= n + 1) then
            fault = 'its bodies do not cover the coordinates 1 to '//to_text(n)//', each once and in their order'
        else if (size(self%column) /= n .or. size(self%mass_column) /= n) then
            fault = 'it does not have a column of C and of M for each coordinate'
        else
            call find_fault_of_mass(self, fault)
            if (fault == '') call find_fault_of_rows(self, fault)
        end if
    end function find_fault

    !> Check that the blocks of M lie within bodies.
    pure subroutine find_fault_of_mass(self, fault)
        type(pattern_type), intent(in) :: self
        character(len=*), intent(inout) :: fault
        integer :: b, j

        do b = 1, self%n_bodies
            if (self%mass_column(self%first(b)) == 1) cycle
            fault = 'a block of M reaches into body '//to_text(b)//' from the one before it'
            return
        end do
        do j = 2, size(self%mass_column)
            if (self%mass_column(j) == 1 .or. self%mass_column(j) == self%mass_column(j - 1) + 1) cycle
            fault = 'mass_column does not count from 1 within a block of M at coordinate '//to_text(j)
            return
        end do
        if (maxval(self%mass_column) > self%mass_width) fault = 'a block of M is wider than mass_width'
    end subroutine find_fault_of_mass

    !> Check that rows refer to existing bodies with separate columns, and that rows with an owner contain no other body.
    pure subroutine find_fault_of_rows(self, fault)
        type(pattern_type), intent(in) :: self
        character(len=*), intent(inout) :: fault
        integer :: used_by(max(self%width, 1)), owned_by(self%n_bodies), b, i, j, k

        if (any(self%row_start(2:) < self%row_start(:self%n_rows)) .or. self%row_start(1) /= 1 .or. &
            self%row_start(self%n_rows + 1) /= size(self%row_body) + 1) then
            fault = 'row_start does not give the position of the bodies of each row in row_body'
            return
        else if (any(self%row_body < 1 .or. self%row_body > self%n_bodies)) then
            fault = 'row_body names a body that does not exist'
            return
        else if (any(self%column < 1 .or. self%column > self%width)) then
            fault = 'a column of C is not within its width'
            return
        end if
        used_by = 0
        owned_by = 0
        do i = 1, self%n_rows
            associate (from => self%row_start(i), to => self%row_start(i + 1) - 1)
                do k = from, to
                    do j = self%first(self%row_body(k)), self%first(self%row_body(k) + 1) - 1
                        if (used_by(self%column(j)) == i) then
                            fault = 'row '//to_text(i)//' touches two coordinates with the same column of C'
                            return
                        end if
                        used_by(self%column(j)) = i
                    end do
                end do
                b = self%owner(i)
                if (b == 0) cycle
                if (b < 0 .or. b > self%n_bodies) then
                    fault = 'row '//to_text(i)//' has the owner '//to_text(b)//', where there are '// &
                        to_text(self%n_bodies)//' bodies'
                    return
                end if
                if (to /= from) then
                    fault = 'row '//to_text(i)//' is owned by body '//to_text(b)//', and touches others'
                else if (self%row_body(from) /= b) then
                    fault = 'row '//to_text(i)//' is owned by body '//to_text(b)//', and touches others'
                else if (owned_by(b) > 0) then
                    fault = 'body '//to_text(b)//' owns the rows '//to_text(owned_by(b))//' and '//to_text(i)
                end if
                if (fault /= '') return
                owned_by(b) = i
            end associate
        end do
    end subroutine find_fault_of_rows

    !> Columns of compressed C: each body gets the first colour that is not used by a body with a common row.
    pure subroutine colour(self)
        class(pattern_type), intent(inout) :: self
        integer, allocatable :: body_start(:), body_row(:), colour_of(:), used_by(:), width(:), rows(:)
        integer :: b, c, i, j, k, n_colours

        associate (n_bodies => self%n_bodies, row_start => self%row_start, row_body => self%row_body)
            allocate (colour_of(n_bodies), used_by(n_bodies), width(n_bodies), source=0)
            ! An array constructor with nested loops would be reallocated for every entry.
            allocate (rows(size(row_body)))
            do i = 1, self%n_rows
                rows(row_start(i):row_start(i + 1) - 1) = i
            end do
            call sort_to_lists(n_bodies, row_body, rows, body_start, body_row)
            n_colours = 0
            do b = 1, n_bodies
                do k = body_start(b), body_start(b + 1) - 1
                    i = body_row(k)
                    do j = row_start(i), row_start(i + 1) - 1
                        c = colour_of(row_body(j))
                        if (c > 0) used_by(c) = b
                    end do
                end do
                c = 1
                do while (used_by(c) == b)
                    c = c + 1
                end do
                colour_of(b) = c
                n_colours = max(n_colours, c)
                width(c) = max(width(c), self%first(b + 1) - self%first(b))
            end do
            self%width = sum(width(:n_colours))
            self%column = spread(0, 1, self%first(n_bodies + 1) - 1)
            do b = 1, n_bodies
                k = sum(width(:colour_of(b) - 1))
                do j = self%first(b), self%first(b + 1) - 1
                    self%column(j) = k + 1 + j - self%first(b)
                end do
            end do
        end associate
    end subroutine colour

    !> C x, or with `of_moduli` |C| |x|.
    pure subroutine multiply(self, jacobian, x, of_moduli, y)
        class(pattern_type), intent(in) :: self
        !> Compressed C (m, width), x (n).
        real(wp), intent(in) :: jacobian(:, :), x(:)
        logical, intent(in) :: of_moduli
        !> (m)
        real(wp), intent(out) :: y(:)
        integer :: i, j, k

        do i = 1, self%n_rows
            y(i) = 0.0_wp
            do k = self%row_start(i), self%row_start(i + 1) - 1
                do j = self%first(self%row_body(k)), self%first(self%row_body(k) + 1) - 1
                    if (of_moduli) then
                        y(i) = y(i) + abs(jacobian(i, self%column(j))*x(j))
                    else
                        y(i) = y(i) + jacobian(i, self%column(j))*x(j)
                    end if
                end do
            end do
        end do
    end subroutine multiply

    !> y := y + C'x, or with `of_moduli` y + |C'| |x|.
    pure subroutine add_transposed(self, jacobian, x, of_moduli, y)
        class(pattern_type), intent(in) :: self
        !> Compressed C (m, width), x (m).
        real(wp), intent(in) :: jacobian(:, :), x(:)
        logical, intent(in) :: of_moduli
        !> (n)
        real(wp), intent(inout) :: y(:)
        real(wp) :: part
        integer :: i, j, k

        do i = 1, self%n_rows
            do k = self%row_start(i), self%row_start(i + 1) - 1
                do j = self%first(self%row_body(k)), self%first(self%row_body(k) + 1) - 1
                    part = jacobian(i, self%column(j))*x(i)
                    if (of_moduli) part = abs(part)
                    y(j) = y(j) + part
                end do
            end do
        end do
    end subroutine add_transposed

    !> M x.
    pure subroutine multiply_mass(self, mass, x, y)
        class(pattern_type), intent(in) :: self
        !> Compressed M (n, mass_width), x (n).
        real(wp), intent(in), contiguous :: mass(:, :), x(:)
        !> (n)
        real(wp), intent(out), contiguous :: y(:)
        integer :: first, i, j, last, n

        n = size(x)
        last = 0
        do while (last < n)
            first = last + 1
            last = first
            do while (last < n)
                if (self%mass_column(last + 1) == 1) exit
                last = last + 1
            end do
            if (last == first) then
                y(first) = mass(first, 1)*x(first)
            else if (last == first + 3) then
                ! Euler parameters: the loop has constant length.
                !GCC$ UNROLL 1
                do i = first, first + 3
                    y(i) = (mass(i, 1)*x(first) + mass(i, 2)*x(first + 1)) + &
                        (mass(i, 3)*x(first + 2) + mass(i, 4)*x(first + 3))
                end do
            else
                y(first:last) = 0.0_wp
                do j = first, last
                    do i = first, last
                        y(i) = y(i) + mass(i, j - first + 1)*x(j)
                    end do
                end do
            end if
        end do
    end subroutine multiply_mass

    !> Add the natural scales of rows without their right-hand sides: sum_j |C_ij| max(|x_j|, floor_j).
    pure subroutine add_row_scales(self, jacobian, x, floor, scales)
        class(pattern_type), intent(in) :: self
        !> Compressed C (m, width), x and floor (n).
        real(wp), intent(in) :: jacobian(:, :), x(:), floor(:)
        !> Scales (m), to which the sums are added.
        real(wp), intent(inout) :: scales(:)
        integer :: i, j, k

        do i = 1, size(scales)
            do k = self%row_start(i), self%row_start(i + 1) - 1
                do j = self%first(self%row_body(k)), self%first(self%row_body(k) + 1) - 1
                    scales(i) = scales(i) + abs(jacobian(i, self%column(j)))*max(abs(x(j)), floor(j))
                end do
            end do
        end do
    end subroutine add_row_scales
end module tandem_model_pattern
