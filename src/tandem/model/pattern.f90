! SPDX-License-Identifier: MIT
!> Which entries of C and M may differ from zero, where a model says so: bodies, ranges of coordinates that no block of M leaves,
!> and the bodies that each row of C touches. The terms are then held compressed, C as (m, width) and M as (n, mass_width), so that
!> memory grows with the number of bodies.
!>
!> Two bodies that share a row have columns of their own there; others may share them, as colours of a map are shared (A. R. Curtis,
!> M. J. D. Powell, J. K. Reid, J. Inst. Maths Applics 13 (1974) 117-119). So entry (i, j) of C stands at (i, column(j)), for any
!> row i that touches the body of j, and entry (i, j) of M at (i, mass_column(j)).
module tandem_model_pattern
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: pattern_type

    type :: pattern_type
        !> Numbers of bodies and of rows, of columns of a compressed C and M, and of entries of C.
        integer :: n_bodies = 0, n_rows = 0, width = 0, mass_width = 0, n_entries = 0
        !> The first coordinate of each body, and the number of coordinates plus one (n_bodies + 1).
        integer, allocatable :: first(:)
        !> The bodies of row i are row_body(row_start(i):row_start(i + 1) - 1), ascending.
        integer, allocatable :: row_start(:), row_body(:)
        !> The body that owns a row, 0 for none: a row that touches one body and one block of its M alone, which is singular without
        !> it. It is the norm of Euler parameters. A body has at most one.
        integer, allocatable :: owner(:)
        !> Compressed columns of C and M (n).
        integer, allocatable :: column(:), mass_column(:)
        !> Pairs of bodies whose forces depend on each other's coordinates without a row that touches both (2, any); they may come
        !> more than once. Only the analysis of large systems asks.
        integer, allocatable :: coupled(:, :)
    contains
        procedure :: build
        procedure :: multiply
        procedure :: multiply_mass
        procedure :: add_row_scales
        procedure, private :: colour
    end type pattern_type

contains

    !> Take bodies and what their rows touch.
    pure subroutine build(self, first, mass_blocks, n_rows, rows, bodies, owner)
        class(pattern_type), intent(inout) :: self
        !> The first coordinate of each body and n + 1; the sizes of the diagonal blocks of M in their order.
        integer, intent(in) :: first(:), mass_blocks(:)
        integer, intent(in) :: n_rows
        !> Pairs of a row and a body, in any order and as often as it happens; a body 0 is the ground and counts for nothing.
        integer, intent(in) :: rows(:), bodies(:)
        !> The owners of the rows (n_rows), 0 for none.
        integer, intent(in) :: owner(:)
        integer, allocatable :: next(:), all_bodies(:)
        integer :: b, i, j, k, last, n

        self%n_bodies = size(first) - 1
        self%n_rows = n_rows
        self%first = first
        self%owner = owner
        ! The bodies of each row, then each once and in their order.
        allocate (next(n_rows + 1), source=0)
        do k = 1, size(rows)
            if (bodies(k) > 0) next(rows(k) + 1) = next(rows(k) + 1) + 1
        end do
        next(1) = 1
        do i = 2, n_rows + 1
            next(i) = next(i) + next(i - 1)
        end do
        self%row_start = next
        allocate (all_bodies(next(n_rows + 1) - 1))
        do k = 1, size(rows)
            if (bodies(k) == 0) cycle
            all_bodies(next(rows(k))) = bodies(k)
            next(rows(k)) = next(rows(k)) + 1
        end do
        n = 0
        do i = 1, n_rows
            associate (from => self%row_start(i), to => next(i) - 1)
                last = n
                do k = from, to
                    b = all_bodies(k)
                    j = n
                    do while (j > last)
                        if (all_bodies(j) <= b) exit
                        j = j - 1
                    end do
                    if (j > last) then
                        if (all_bodies(j) == b) cycle
                    end if
                    all_bodies(j + 2:n + 1) = all_bodies(j + 1:n)
                    all_bodies(j + 1) = b
                    n = n + 1
                end do
                next(i) = last + 1
            end associate
        end do
        next(n_rows + 1) = n + 1
        self%row_start = next
        self%row_body = all_bodies(:n)
        self%n_entries = 0
        do k = 1, n
            b = self%row_body(k)
            self%n_entries = self%n_entries + first(b + 1) - first(b)
        end do
        call self%colour()
        allocate (self%mass_column(first(self%n_bodies + 1) - 1))
        n = 0
        do k = 1, size(mass_blocks)
            self%mass_column(n + 1:n + mass_blocks(k)) = [(j, j=1, mass_blocks(k))]
            n = n + mass_blocks(k)
        end do
        self%mass_width = maxval(mass_blocks)
    end subroutine build

    !> Columns of the compressed C: each body takes the first colour that no body has which shares a row with it.
    pure subroutine colour(self)
        class(pattern_type), intent(inout) :: self
        integer, allocatable :: body_start(:), body_row(:), next(:), colour_of(:), taken_by(:), width(:)
        integer :: b, c, i, j, k, n_colours

        associate (n_bodies => self%n_bodies, row_start => self%row_start, row_body => self%row_body)
            allocate (body_start(n_bodies + 1), colour_of(n_bodies), taken_by(n_bodies), width(n_bodies), source=0)
            do k = 1, size(row_body)
                body_start(row_body(k) + 1) = body_start(row_body(k) + 1) + 1
            end do
            body_start(1) = 1
            do b = 2, n_bodies + 1
                body_start(b) = body_start(b) + body_start(b - 1)
            end do
            allocate (next, source=body_start)
            allocate (body_row(size(row_body)))
            do i = 1, self%n_rows
                do k = row_start(i), row_start(i + 1) - 1
                    body_row(next(row_body(k))) = i
                    next(row_body(k)) = next(row_body(k)) + 1
                end do
            end do
            n_colours = 0
            do b = 1, n_bodies
                do k = body_start(b), body_start(b + 1) - 1
                    i = body_row(k)
                    do j = row_start(i), row_start(i + 1) - 1
                        c = colour_of(row_body(j))
                        if (c > 0) taken_by(c) = b
                    end do
                end do
                c = 1
                do while (taken_by(c) == b)
                    c = c + 1
                end do
                colour_of(b) = c
                n_colours = max(n_colours, c)
                width(c) = max(width(c), self%first(b + 1) - self%first(b))
            end do
            self%width = sum(width(:n_colours))
            allocate (self%column(self%first(n_bodies + 1) - 1))
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

    !> M x.
    pure subroutine multiply_mass(self, mass, x, y)
        class(pattern_type), intent(in) :: self
        !> Compressed M (n, mass_width), x (n).
        real(wp), intent(in) :: mass(:, :), x(:)
        !> (n)
        real(wp), intent(out) :: y(:)
        integer :: first, i, j, last

        last = 0
        do while (last < size(x))
            first = last + 1
            last = first
            do while (last < size(x))
                if (self%mass_column(last + 1) == 1) exit
                last = last + 1
            end do
            y(first:last) = 0.0_wp
            do j = first, last
                do i = first, last
                    y(i) = y(i) + mass(i, j - first + 1)*x(j)
                end do
            end do
        end do
    end subroutine multiply_mass

    !> The natural scales of rows without their right sides: scales(i) = sum_j |C_ij| max(|x_j|, floor_j).
    pure subroutine add_row_scales(self, jacobian, x, floor, scales)
        class(pattern_type), intent(in) :: self
        !> Compressed C (m, width), x and floor (n).
        real(wp), intent(in) :: jacobian(:, :), x(:), floor(:)
        !> (m), to which they are added.
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
