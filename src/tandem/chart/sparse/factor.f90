! SPDX-License-Identifier: MIT
!> M x + C' lambda = f, C x = g at one point, by blocks: C and the inverses of the bodies' masses, and the factor of what they
!> leave, see `tandem_chart_sparse_analysis`.
!>
!> A body with a row of its own, c'x = g, has the inverse W = N - u u'/(c'u), R = u/(c'u) with N = (M + a c c')^-1, u = N c: M need
!> be definite across c only, and any a > 0 gives the same.
module tandem_chart_sparse_factor
    use tandem_kinds, only: wp
    use tandem_chart_sparse_analysis, only: analysis_type, most_coordinates, most_links, most_rows
    use tandem_chart_sparse_blocks, only: add_moved, apply_inverse, invert, invert_some, multiply_block, set_product, &
        subtract_product, subtract_rows, subtract_transposed
    use tandem_model_pattern, only: pattern_type
    use tandem_pack, only: pack_type
    use tandem_status, only: status_not_finite, status_ok, status_rank_deficient, status_singular_mass
    implicit none (type, external)
    private

    public :: factor_type, least_pivot

    !> A row whose pivot falls to this part of what it would be alone depends on those before it: an angle of 1e-5. Rounding leaves
    !> some 1e-15 of it.
    real(wp), parameter :: least_pivot = 1.0e-10_wp
    !> The same of coordinates that carry no mass.
    real(wp), parameter :: least_mass = 1.0e-14_wp

    type :: factor_type
        !> The parts of C by links, and owned rows by coordinates (n).
        real(wp), allocatable :: c(:), own(:)
        !> W, its blocks as those of M (mass_width, n), and R (n).
        real(wp), allocatable :: w(:, :), r(:)
        !> Inverse diagonal blocks of the factor, and the others as they were when their turn came.
        real(wp), allocatable :: blocks(:)
        !> What the pivot of each row would be if it stood alone (m), and how much of a c c' was added to a kept body (n_bodies).
        real(wp), allocatable :: alone(:), added(:)
        !> The smallest pivot of a row against that, and the row.
        real(wp) :: least = 1.0_wp
        integer :: weakest = 0
        !> Rows that are left out, as they depend on others (m): they take no part, and their multipliers are zero.
        logical, allocatable :: is_out(:)
        logical :: leaves_out = .false.
        !> What of those rows the others do not give at most, as a pivot, and of which.
        real(wp) :: rest = 0.0_wp
        integer :: loosest = 0
        !> After `singular_mass`: the coordinate.
        integer :: failed_coordinate = 0
        !> Whether C, and whether the factor too, are those of the current point.
        logical :: has_rows = .false., is_factored = .false.
    contains
        procedure :: allocate => allocate_factor
        procedure :: load_rows
        procedure :: invert_masses
        procedure :: factorize
        procedure :: solve
        procedure :: multiply
        procedure :: add_reactions
        procedure :: move
        procedure :: pack_state
        procedure, private :: add_bodies
        procedure, private :: eliminate
    end type factor_type

contains

    !> Allocate for what was analysed.
    subroutine allocate_factor(self, a, pattern)
        class(factor_type), intent(inout) :: self
        type(analysis_type), intent(in) :: a
        type(pattern_type), intent(in) :: pattern

        if (allocated(self%c)) deallocate (self%c, self%own, self%w, self%r, self%blocks, self%alone, self%added, self%is_out)
        allocate (self%c(a%n_entries), self%own(a%n), self%w(pattern%mass_width, a%n), self%r(a%n), self%blocks(a%n_factor), &
            self%alone(a%m), self%added(a%n_bodies), source=0.0_wp)
        allocate (self%is_out(a%m), source=.false.)
        self%leaves_out = .false.
        self%has_rows = .false.
        self%is_factored = .false.
    end subroutine allocate_factor

    !> Take C.
    subroutine load_rows(self, a, pattern, jacobian)
        class(factor_type), intent(inout) :: self
        type(analysis_type), intent(in) :: a
        type(pattern_type), intent(in) :: pattern
        !> Compressed, of the rows in use.
        real(wp), intent(in), contiguous :: jacobian(:, :)
        integer :: b, i, j, k, l, row

        do b = 1, a%n_bodies
            do l = a%link_start(b), a%link_start(b + 1) - 1
                associate (s => a%height(a%link_node(l)), origin => a%origin(a%link_node(l)))
                    k = a%link_offset(l)
                    do j = a%first(b), a%first(b + 1) - 1
                        if (s == 5) then
                            ! A copy of variable length would be a call.
                            self%c(k + 1) = jacobian(origin, pattern%column(j))
                            self%c(k + 2) = jacobian(origin + 1, pattern%column(j))
                            self%c(k + 3) = jacobian(origin + 2, pattern%column(j))
                            self%c(k + 4) = jacobian(origin + 3, pattern%column(j))
                            self%c(k + 5) = jacobian(origin + 4, pattern%column(j))
                        else if (s == 2) then
                            self%c(k + 1) = jacobian(origin, pattern%column(j))
                            self%c(k + 2) = jacobian(origin + 1, pattern%column(j))
                        else
                            do i = 1, s
                                self%c(k + i) = jacobian(origin + i - 1, pattern%column(j))
                            end do
                        end if
                        k = k + s
                    end do
                end associate
            end do
            row = a%norm_row(b)
            if (row == 0) cycle
            do j = a%first(b), a%first(b + 1) - 1
                self%own(j) = jacobian(row, pattern%column(j))
            end do
        end do
        self%has_rows = .true.
        self%is_factored = .false.
    end subroutine load_rows

    !> W and R from a compressed M (n, ld). `load_rows` was called.
    subroutine invert_masses(self, a, ld, mass, stat)
        class(factor_type), intent(inout) :: self
        type(analysis_type), intent(in) :: a
        integer, intent(in) :: ld
        real(wp), intent(in) :: mass(a%n, ld)
        !> ok or `singular_mass`.
        integer, intent(out) :: stat
        integer :: b, i, j, s, worst
        real(wp) :: n(most_coordinates*most_coordinates)

        stat = status_ok
        do b = 1, a%n_bodies
            j = a%first(b)
            do while (j < a%first(b + 1))
                s = 1
                do while (j + s < a%first(b + 1))
                    if (a%block_first(j + s) /= j) exit
                    s = s + 1
                end do
                if (s == 1 .and. a%norm_row(b) == 0) then
                    if (.not. mass(j, 1) > 0.0_wp) then
                        worst = 1
                        exit
                    end if
                    self%w(1, j) = 1.0_wp/mass(j, 1)
                else if (s == 4) then
                    call invert_block(4, a%n, mass(j, 1), a%norm_row(b) > 0, a%is_kept(b), self%own(j:j + 3), &
                        size(self%w, 1), self%w(1, j), self%r(j:j + 3), self%added(b), n, worst)
                    if (worst > 0) exit
                else
                    call invert_block(s, a%n, mass(j, 1), a%norm_row(b) > 0, a%is_kept(b), self%own(j:j + s - 1), &
                        size(self%w, 1), self%w(1, j), self%r(j:j + s - 1), self%added(b), n, worst)
                    if (worst > 0) exit
                end if
                j = j + s
            end do
            if (j >= a%first(b + 1)) cycle
            stat = status_singular_mass
            self%failed_coordinate = j + worst - 1
            do i = 1, s
                if (.not. abs(mass(j + i - 1, 1)) <= huge(1.0_wp)) stat = status_not_finite
            end do
            return
        end do
    end subroutine invert_masses

    !> W and R of one block of M. Of a kept body W is M + a c c' itself.
    pure subroutine invert_block(s, ld, mass, has_row, is_kept, c, ldw, w, r, added, n, worst)
        integer, intent(in) :: s, ld, ldw
        !> The block (s, s) in its places, rows and columns of the compressed M.
        real(wp), intent(in) :: mass(ld, s)
        logical, intent(in) :: has_row, is_kept
        !> The part of the owned row.
        real(wp), intent(in) :: c(s)
        real(wp), intent(inout) :: w(ldw, s), r(s), added
        !> Work space.
        real(wp), intent(inout) :: n(s, s)
        !> The first coordinate without mass, 0 for none.
        integer, intent(out) :: worst
        real(wp) :: square, trace, along, u(s), before(s)
        integer :: i, j

        trace = 0.0_wp
        square = 0.0_wp
        do i = 1, s
            trace = trace + mass(i, i)
            if (has_row) square = square + c(i)**2
        end do
        do j = 1, s
            do i = 1, s
                n(i, j) = mass(i, j)
            end do
        end do
        if (square > 0.0_wp) then
            added = merge(trace, 1.0_wp, trace > 0.0_wp)/square
            do j = 1, s
                do i = 1, s
                    n(i, j) = n(i, j) + added*c(i)*c(j)
                end do
            end do
        end if
        do i = 1, s
            before(i) = n(i, i)
        end do
        worst = 0
        if (is_kept) then
            do j = 1, s
                do i = 1, s
                    w(i, j) = n(i, j)
                end do
                if (.not. before(j) > 0.0_wp .and. worst == 0) worst = j
            end do
            return
        end if
        call invert(s, n, before, 1.0_wp, least_mass, worst)
        if (worst > 0) return
        do j = 1, s
            do i = 1, s
                w(i, j) = n(i, j)
            end do
        end do
        if (.not. square > 0.0_wp) return
        along = 0.0_wp
        do i = 1, s
            u(i) = 0.0_wp
            do j = 1, s
                u(i) = u(i) + n(i, j)*c(j)
            end do
            along = along + u(i)*c(i)
        end do
        do j = 1, s
            r(j) = u(j)/along
            do i = 1, s
                w(i, j) = w(i, j) - u(i)*r(j)
            end do
        end do
    end subroutine invert_block

    !> Factor at the point of `load_rows` and `invert_masses`.
    subroutine factorize(self, a, chooses, stat)
        class(factor_type), intent(inout) :: self
        type(analysis_type), intent(in) :: a
        !> Whether to choose anew which rows are left out: those that depend on others.
        logical, intent(in) :: chooses
        !> ok, `rank_deficient` with `weakest`, `singular_mass` with `failed_coordinate`, or `not_finite`.
        integer, intent(out) :: stat

        self%is_factored = .false.
        self%blocks = 0.0_wp
        self%alone = 0.0_wp
        if (chooses) then
            self%is_out = .false.
            self%leaves_out = .true.
        end if
        call self%add_bodies(a)
        call self%eliminate(a, chooses, stat)
        self%is_factored = stat == status_ok
    end subroutine factorize

    !> K before the first node goes.
    subroutine add_bodies(self, a)
        class(factor_type), intent(inout) :: self
        type(analysis_type), intent(in) :: a
        real(wp) :: y(most_rows*most_coordinates, most_links)
        integer :: b, d, i, j, k, l, n, nb, p, s

        do b = 1, a%n_bodies
            nb = a%first(b + 1) - a%first(b)
            d = a%pair_start(b)
            associate (from => a%link_start(b), last => a%link_start(b + 1) - 1, f => a%first(b))
                if (a%is_kept(b)) then
                    call put_kept(b, nb)
                    do l = from, last
                        n = a%link_node(l)
                        s = a%height(n)
                        d = d + 1
                        k = a%link_offset(l)
                        associate (target => a%pair_target(d), origin => a%origin(n))
                            do j = 1, nb
                                do i = 1, s
                                    if (n > a%node_of_body(b)) then
                                        self%blocks(target + (j - 1)*s + i) = self%c(k + (j - 1)*s + i)
                                    else
                                        self%blocks(target + (i - 1)*nb + j) = self%c(k + (j - 1)*s + i)
                                    end if
                                    self%alone(origin + i - 1) = self%alone(origin + i - 1) + &
                                        self%c(k + (j - 1)*s + i)**2/self%w(f + j - a%block_first(f + j - 1), f + j - 1)
                                end do
                            end do
                        end associate
                    end do
                    cycle
                end if
                do l = from, last
                    n = a%link_node(l)
                    s = a%height(n)
                    call apply_inverse(a%kind(b), s, nb, a%block_first(f:f + nb - 1), f, size(self%w, 1), self%w(:, f:f + nb - 1), &
                        self%c(a%link_offset(l) + 1:a%link_offset(l) + s*nb), y(:s*nb, l - from + 1))
                    do k = from, l
                        d = d + 1
                        associate (other => a%link_node(k), target => a%pair_target(d))
                            p = a%height(other)
                            if (other > n) then
                                call subtract_product(p, s, nb, self%c(a%link_offset(k) + 1:a%link_offset(k) + p*nb), &
                                    y(:s*nb, l - from + 1), self%blocks(target + 1:target + p*s))
                            else
                                call subtract_product(s, p, nb, self%c(a%link_offset(l) + 1:a%link_offset(l) + s*nb), &
                                    y(:p*nb, k - from + 1), self%blocks(target + 1:target + p*s))
                            end if
                        end associate
                    end do
                end do
            end associate
        end do
        do n = 1, a%n_nodes
            if (a%is_body(n)) cycle
            do i = 1, a%height(n)
                self%alone(a%origin(n) + i - 1) = self%alone(a%origin(n) + i - 1) - &
                    self%blocks(a%diagonal_offset(n) + (i - 1)*(a%height(n) + 1) + 1)
            end do
        end do

    contains

        !> The mass of a kept body.
        subroutine put_kept(body, height)
            integer, intent(in) :: body, height
            integer :: column, row, first

            associate (offset => a%diagonal_offset(a%node_of_body(body)), begins => a%first(body))
                do column = 1, height
                    first = a%block_first(begins + column - 1) - begins + 1
                    row = first
                    do while (row <= height)
                        if (a%block_first(begins + row - 1) /= begins + first - 1) exit
                        self%blocks(offset + (column - 1)*height + row) = self%w(row - first + 1, begins + column - 1)
                        row = row + 1
                    end do
                end do
            end associate
        end subroutine put_kept
    end subroutine add_bodies

    !> Eliminate the nodes.
    subroutine eliminate(self, a, chooses, stat)
        class(factor_type), intent(inout) :: self
        type(analysis_type), intent(in) :: a
        logical, intent(in) :: chooses
        integer, intent(out) :: stat
        real(wp) :: ratio(max(most_rows, most_coordinates)), product(max(most_rows, most_coordinates)**2)
        integer :: d, i, j, k, n, p, s, worst

        stat = status_ok
        self%least = 1.0_wp
        self%weakest = 0
        self%rest = 0.0_wp
        self%loosest = 0
        do n = 1, a%n_nodes
            s = a%height(n)
            associate (diagonal => a%diagonal_offset(n), origin => a%origin(n))
                if (a%is_body(n)) then
                    do i = 1, s
                        ratio(i) = self%blocks(diagonal + (i - 1)*(s + 1) + 1)
                    end do
                    call invert(s, self%blocks(diagonal + 1:diagonal + s*s), ratio(:s), 1.0_wp, least_mass, worst)
                else
                    ratio(:s) = self%alone(origin:origin + s - 1)
                    if (self%leaves_out) then
                        call invert_some(s, self%blocks(diagonal + 1:diagonal + s*s), ratio(:s), -1.0_wp, least_pivot, chooses, &
                            self%is_out(origin:origin + s - 1), worst)
                    else
                        call invert(s, self%blocks(diagonal + 1:diagonal + s*s), ratio(:s), -1.0_wp, least_pivot, worst)
                    end if
                    do i = 1, merge(s, worst - 1, worst == 0)
                        if (self%is_out(origin + i - 1)) then
                            if (ratio(i) > self%rest) self%loosest = origin + i - 1
                            self%rest = max(self%rest, ratio(i))
                            cycle
                        end if
                        if (.not. ratio(i) < self%least) cycle
                        self%least = ratio(i)
                        self%weakest = origin + i - 1
                    end do
                end if
                if (worst > 0) then
                    call refuse(origin + worst - 1, a%is_body(n))
                    return
                end if
                d = a%update_start(n)
                do j = a%later_start(n), a%later_start(n + 1) - 1
                    p = a%height(a%later(j))
                    call multiply_block(p, s, self%blocks(a%later_offset(j) + 1:a%later_offset(j) + p*s), &
                        self%blocks(diagonal + 1:diagonal + s*s), product(:p*s))
                    do k = a%later_start(n), j
                        d = d + 1
                        associate (q => a%height(a%later(k)), target => a%update_target(d), other => a%later_offset(k))
                            call subtract_product(p, q, s, product(:p*s), self%blocks(other + 1:other + q*s), &
                                self%blocks(target + 1:target + p*q))
                        end associate
                    end do
                end do
            end associate
        end do

    contains

        !> Say what a pivot that is too small means.
        subroutine refuse(unknown, is_body)
            integer, intent(in) :: unknown
            logical, intent(in) :: is_body

            if (.not. sum(abs(self%c)) <= huge(1.0_wp)) then
                stat = status_not_finite
            else if (is_body) then
                stat = status_singular_mass
                self%failed_coordinate = unknown
            else
                stat = status_rank_deficient
                self%least = 0.0_wp
                self%weakest = unknown
            end if
        end subroutine refuse
    end subroutine eliminate

    !> Solve M x + C' lambda = f, C x = g.
    subroutine solve(self, a, has_force, f, g, x, z)
        class(factor_type), intent(in) :: self
        type(analysis_type), intent(in) :: a
        !> Whether f is not zero.
        logical, intent(in) :: has_force
        !> f (n), g (m).
        real(wp), intent(in), contiguous :: f(:), g(:)
        !> x (n); the multipliers of all rows but the owned ones in the order of the nodes, among x of kept bodies (n_unknowns).
        real(wp), intent(out), contiguous :: x(:)
        real(wp), intent(inout), contiguous :: z(:)
        real(wp) :: t(most_coordinates)
        integer :: b, i, l, n, nb, s

        do n = 1, a%n_nodes
            do i = 1, a%height(n)
                z(a%place(n) + i) = merge(0.0_wp, g(min(a%origin(n) + i - 1, a%m)), a%is_body(n))
            end do
        end do
        do b = 1, a%n_bodies
            nb = a%first(b + 1) - a%first(b)
            associate (first => a%first(b))
                if (a%is_kept(b)) then
                    associate (place => a%place(a%node_of_body(b)))
                        do i = 1, nb
                            if (has_force) z(place + i) = f(first + i - 1)
                            if (a%norm_row(b) > 0) z(place + i) = z(place + i) + &
                                self%added(b)*self%own(first + i - 1)*g(a%norm_row(b))
                        end do
                    end associate
                    cycle
                end if
                if (has_force) then
                    x(first:first + nb - 1) = 0.0_wp
                    call add_moved(a%kind(b), nb, a%block_first(first:first + nb - 1), first, size(self%w, 1), &
                        self%w(:, first:first + nb - 1), f(first:first + nb - 1), x(first:first + nb - 1))
                    if (a%norm_row(b) > 0) then
                        do i = first, first + nb - 1
                            x(i) = x(i) + self%r(i)*g(a%norm_row(b))
                        end do
                    end if
                else if (a%norm_row(b) > 0) then
                    do i = first, first + nb - 1
                        x(i) = self%r(i)*g(a%norm_row(b))
                    end do
                else
                    x(first:first + nb - 1) = 0.0_wp
                    cycle
                end if
                do l = a%link_start(b), a%link_start(b + 1) - 1
                    n = a%link_node(l)
                    s = a%height(n)
                    call subtract_rows(s, nb, self%c(a%link_offset(l) + 1:a%link_offset(l) + s*nb), x(first:first + nb - 1), &
                        z(a%place(n) + 1:a%place(n) + s))
                end do
            end associate
        end do
        call solve_nodes(self, a, z)
        do b = 1, a%n_bodies
            nb = a%first(b + 1) - a%first(b)
            associate (first => a%first(b))
                if (a%is_kept(b)) then
                    x(first:first + nb - 1) = z(a%place(a%node_of_body(b)) + 1:a%place(a%node_of_body(b)) + nb)
                    cycle
                end if
                t(:nb) = 0.0_wp
                do l = a%link_start(b), a%link_start(b + 1) - 1
                    n = a%link_node(l)
                    s = a%height(n)
                    call subtract_transposed(s, nb, self%c(a%link_offset(l) + 1:a%link_offset(l) + s*nb), &
                        z(a%place(n) + 1:a%place(n) + s), t(:nb))
                end do
                call add_moved(a%kind(b), nb, a%block_first(first:first + nb - 1), first, size(self%w, 1), &
                    self%w(:, first:first + nb - 1), t(:nb), x(first:first + nb - 1))
            end associate
        end do
    end subroutine solve

    !> K z = z in place.
    subroutine solve_nodes(self, a, z)
        class(factor_type), intent(in) :: self
        type(analysis_type), intent(in) :: a
        real(wp), intent(inout), contiguous :: z(:)
        real(wp) :: y(max(most_rows, most_coordinates)), x(max(most_rows, most_coordinates))
        integer :: j, n, p, s

        do n = 1, a%n_nodes
            s = a%height(n)
            associate (place => a%place(n), diagonal => a%diagonal_offset(n))
                call set_product(s, self%blocks(diagonal + 1:diagonal + s*s), z(place + 1:place + s), y(:s))
                do j = a%later_start(n), a%later_start(n + 1) - 1
                    p = a%height(a%later(j))
                    call subtract_rows(p, s, self%blocks(a%later_offset(j) + 1:a%later_offset(j) + p*s), y(:s), &
                        z(a%place(a%later(j)) + 1:a%place(a%later(j)) + p))
                end do
            end associate
        end do
        do n = a%n_nodes, 1, -1
            s = a%height(n)
            associate (place => a%place(n), diagonal => a%diagonal_offset(n))
                x(:s) = z(place + 1:place + s)
                do j = a%later_start(n), a%later_start(n + 1) - 1
                    p = a%height(a%later(j))
                    call subtract_transposed(p, s, self%blocks(a%later_offset(j) + 1:a%later_offset(j) + p*s), &
                        z(a%place(a%later(j)) + 1:a%place(a%later(j)) + p), x(:s))
                end do
                call set_product(s, self%blocks(diagonal + 1:diagonal + s*s), x(:s), z(place + 1:place + s))
            end associate
        end do
    end subroutine solve_nodes

    !> g := g - C x, all rows in use.
    subroutine multiply(self, a, x, g)
        class(factor_type), intent(in) :: self
        type(analysis_type), intent(in) :: a
        !> x (n), g (m).
        real(wp), intent(in), contiguous :: x(:)
        real(wp), intent(inout), contiguous :: g(:)
        integer :: b, j, l, nb, s

        do b = 1, a%n_bodies
            nb = a%first(b + 1) - a%first(b)
            associate (first => a%first(b))
                do l = a%link_start(b), a%link_start(b + 1) - 1
                    s = a%height(a%link_node(l))
                    associate (origin => a%origin(a%link_node(l)))
                        call subtract_rows(s, nb, self%c(a%link_offset(l) + 1:a%link_offset(l) + s*nb), &
                            x(first:first + nb - 1), g(origin:origin + s - 1))
                    end associate
                end do
                if (a%own_row(b) == 0) cycle
                do j = first, first + nb - 1
                    g(a%own_row(b)) = g(a%own_row(b)) - self%own(j)*x(j)
                end do
            end associate
        end do
    end subroutine multiply

    !> f := f - C' lambda, all rows in use.
    subroutine add_reactions(self, a, lambda, f)
        class(factor_type), intent(in) :: self
        type(analysis_type), intent(in) :: a
        !> lambda (m), f (n).
        real(wp), intent(in), contiguous :: lambda(:)
        real(wp), intent(inout), contiguous :: f(:)
        integer :: b, j, l, nb, s

        do b = 1, a%n_bodies
            nb = a%first(b + 1) - a%first(b)
            associate (first => a%first(b))
                do l = a%link_start(b), a%link_start(b + 1) - 1
                    s = a%height(a%link_node(l))
                    associate (origin => a%origin(a%link_node(l)))
                        call subtract_transposed(s, nb, self%c(a%link_offset(l) + 1:a%link_offset(l) + s*nb), &
                            lambda(origin:origin + s - 1), f(first:first + nb - 1))
                    end associate
                end do
                if (a%own_row(b) == 0) cycle
                do j = first, first + nb - 1
                    f(j) = f(j) - self%own(j)*lambda(a%own_row(b))
                end do
            end associate
        end do
    end subroutine add_reactions

    !> What a force moves of each body by itself: W f; kept bodies stay.
    subroutine move(self, a, f, x)
        class(factor_type), intent(in) :: self
        type(analysis_type), intent(in) :: a
        !> f and x (n).
        real(wp), intent(in), contiguous :: f(:)
        real(wp), intent(inout), contiguous :: x(:)
        integer :: b

        do b = 1, a%n_bodies
            associate (first => a%first(b), last => a%first(b + 1) - 1)
                x(first:last) = 0.0_wp
                if (a%is_kept(b)) cycle
                call add_moved(a%kind(b), last - first + 1, a%block_first(first:last), first, size(self%w, 1), &
                    self%w(:, first:last), f(first:last), x(first:last))
            end associate
        end do
    end subroutine move

    !> All of it.
    subroutine pack_state(self, pack)
        class(factor_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack
        integer, allocatable :: out(:)

        call pack%item(self%c)
        call pack%item(self%own)
        call pack%item(self%w)
        call pack%item(self%r)
        call pack%item(self%blocks)
        call pack%item(self%alone)
        call pack%item(self%added)
        call pack%item(self%least)
        call pack%item(self%weakest)
        out = merge(1, 0, self%is_out)
        call pack%item(out)
        self%is_out = out > 0
        call pack%item(self%leaves_out)
        call pack%item(self%has_rows)
        call pack%item(self%is_factored)
    end subroutine pack_state
end module tandem_chart_sparse_factor
