! SPDX-License-Identifier: MIT
!> M x + C' lambda = f, C x = g at one point, by blocks: C and the inverses of the bodies' masses, and the factor of the remaining
!> matrix, see `tandem_chart_sparse_analysis`.
module tandem_chart_sparse_factor
    use tandem_kinds, only: wp
    use tandem_chart_sparse_analysis, only: analysis_type, most_rows
    use tandem_chart_sparse_blocks, only: keep_rows, most_coordinates, multiply_right, of_rigid_body, read_behind, subtract_rows, &
        subtract_update
    use tandem_chart_sparse_inverses, only: invert, invert_nodes, invert_some, side_by_side
    use tandem_chart_sparse_masses, only: invert_block, invert_rigid, least_mass
    use tandem_chart_sparse_meetings, only: of_hinges, of_pins
    use tandem_model_pattern, only: pattern_type
    use tandem_pack, only: pack_type
    use tandem_status, only: status_not_finite, status_ok, status_rank_deficient, status_singular_mass
    implicit none (type, external)
    private

    public :: factor_type, least_pivot

    !> A row depends on the rows before it if its pivot falls to this part of its own diagonal entry: an angle of 1e-5. Rounding
    !> leaves some 1e-15 of it.
    real(wp), parameter :: least_pivot = 1.0e-10_wp
    type :: factor_type
        !> The parts of C by links, shortened for hinges and pins (`tandem_chart_sparse_meetings`), followed by owned rows if the
        !> model sets these there; owned rows by coordinates (n).
        real(wp), allocatable :: c(:), own(:)
        !> W in blocks like those of M (mass_width, n), and R (n).
        real(wp), allocatable :: w(:, :), r(:)
        !> By links: the motion of the body due to a unit multiplier, W c' (coordinates, rows; shortened for hinges and pins, see
        !> `tandem_chart_sparse_meetings`), and the contribution of a unit of its own row to the node, -c R (most_rows, links; empty
        !> if no body is eliminated with an own row).
        real(wp), allocatable :: y(:), sent(:, :)
        !> Inverse diagonal blocks D^-1 of the factor, and L = B D^-1 of the others, with B at the time of its elimination.
        real(wp), allocatable :: blocks(:)
        !> Pivot of each row alone, then the ratio of the pivot to it (m); amount of a c c' added to a hub (n_bodies; empty without
        !> hubs).
        real(wp), allocatable :: alone(:), added(:)
        !> The smallest of these ratios, and its row.
        real(wp) :: least = 1.0_wp
        integer :: weakest = 0
        !> Rows that are left out, as they depend on others (m): they take no part, and their multipliers are zero.
        logical, allocatable :: is_out(:)
        logical :: leaves_out = .false.
        !> Largest independent part of these rows, as a pivot, and its row.
        real(wp) :: rest = 0.0_wp
        integer :: loosest = 0
        !> After `singular_mass`: the coordinate.
        integer :: failed_coordinate = 0
        !> True if C belongs to the current point; true if the factor does, too.
        logical :: has_rows = .false., is_factored = .false.
        !> True if C is the difference of two: then the constant columns of coincident points vanish.
        logical :: is_difference = .false.
    contains
        procedure :: allocate => allocate_factor, load_rows, invert_masses, factorize, solve, multiply
        procedure :: add_reactions, find_unbalanced, exchange, move, add_squares, pack_state
        procedure, private :: add_bodies, eliminate
    end type factor_type

    interface
        !> The columns of positions of joints of coincident points, where stored: they are constant, and no model sets them.
        pure module subroutine put_places(a, c)
            implicit none (type, external)
            type(analysis_type), intent(in) :: a
            real(wp), intent(inout) :: c(:)
        end subroutine put_places

        !> Load C.
        module subroutine load_rows(self, a, pattern, jacobian, blocks)
            implicit none (type, external)
            class(factor_type), intent(inout) :: self
            type(analysis_type), intent(in) :: a
            type(pattern_type), intent(in) :: pattern
            !> Compressed, of the rows in use.
            real(wp), intent(in), contiguous :: jacobian(:, :)
            !> The rows that the model has set in blocks: used without copying.
            real(wp), allocatable, intent(inout) :: blocks(:)
        end subroutine load_rows

        !> Add the squared lengths of the rows of C, or of their differences from the rows elsewhere.
        pure module subroutine add_squares(self, a, scale, squares, other)
            implicit none (type, external)
            class(factor_type), intent(in) :: self
            type(analysis_type), intent(in) :: a
            !> Of the coordinates (n).
            real(wp), intent(in) :: scale(:)
            !> (m), to which they are added.
            real(wp), intent(inout) :: squares(:)
            type(factor_type), intent(in), optional :: other
        end subroutine add_squares

        !> Solve M x + C' lambda = f, C x = g.
        pure module subroutine solve(self, a, has_force, f, g, x, z)
            implicit none (type, external)
            class(factor_type), intent(in) :: self
            type(analysis_type), intent(in) :: a
            !> True if f is not zero.
            logical, intent(in) :: has_force
            !> f (n), g (m).
            real(wp), intent(in), contiguous :: f(:), g(:)
            !> x (n); the multipliers of all rows but the owned ones in the order of the nodes, among x of hubs (n_unknowns).
            real(wp), intent(out), contiguous :: x(:)
            real(wp), intent(inout), contiguous :: z(:)
        end subroutine solve

        !> g := g - C x, all rows in use.
        pure module subroutine multiply(self, a, x, g)
            implicit none (type, external)
            class(factor_type), intent(in) :: self
            type(analysis_type), intent(in) :: a
            !> x (n), g (m).
            real(wp), intent(in), contiguous :: x(:)
            real(wp), intent(inout), contiguous :: g(:)
        end subroutine multiply

        !> f := f - C' lambda, all rows in use.
        pure module subroutine add_reactions(self, a, lambda, f)
            implicit none (type, external)
            class(factor_type), intent(in) :: self
            type(analysis_type), intent(in) :: a
            !> lambda (m), f (n).
            real(wp), intent(in), contiguous :: lambda(:)
            real(wp), intent(inout), contiguous :: f(:)
        end subroutine add_reactions

        !> The unbalanced forces, f - M x - C' lambda; owned rows balance the components along them.
        pure module subroutine find_unbalanced(self, a, mass, f, x, lambda, left)
            implicit none (type, external)
            class(factor_type), intent(in) :: self
            type(analysis_type), intent(in) :: a
            !> Compressed M (n, mass_width), f and x (n), lambda in the order of the nodes (n_unknowns).
            real(wp), intent(in), contiguous :: mass(:, :), f(:), x(:), lambda(:)
            !> (n)
            real(wp), intent(out), contiguous :: left(:)
        end subroutine find_unbalanced

        !> Apply the inverse mass of each body to a force: W f; unchanged for hubs.
        pure module subroutine move(self, a, f, x)
            implicit none (type, external)
            class(factor_type), intent(in) :: self
            type(analysis_type), intent(in) :: a
            !> f and x (n).
            real(wp), intent(in), contiguous :: f(:)
            real(wp), intent(inout), contiguous :: x(:)
        end subroutine move

        !> K before the elimination of the first node.
        module subroutine add_bodies(self, a)
            implicit none (type, external)
            class(factor_type), intent(inout) :: self
            type(analysis_type), intent(in) :: a
        end subroutine add_bodies
    end interface

contains

    !> Allocate for an analysed pattern.
    subroutine allocate_factor(self, a, pattern, has_terms)
        class(factor_type), intent(inout) :: self
        type(analysis_type), intent(in) :: a
        type(pattern_type), intent(in) :: pattern
        !> True to allocate C, W and the pivots too: else they come from another factor.
        logical, intent(in) :: has_terms

        if (allocated(self%y)) deallocate (self%y, self%sent, self%r, self%blocks, self%added, self%is_out)
        ! Shared arrays may belong to either factor.
        if (allocated(self%c)) deallocate (self%c)
        if (allocated(self%w)) deallocate (self%w, self%alone)
        if (allocated(self%own)) deallocate (self%own)
        allocate (self%y(a%n_moved + read_behind), &
            self%sent(most_rows, merge(size(a%link_node), 0, any(a%norm_row > 0))), self%r(a%n), &
            self%blocks(a%block%n_entries + read_behind), self%added(merge(a%n_bodies, 0, any(a%is_kept))), source=0.0_wp)
        if (has_terms) allocate (self%c(a%n_entries + read_behind + a%n), self%w(pattern%mass_width, a%n), self%alone(a%m), &
            source=0.0_wp)
        if (has_terms) call put_places(a, self%c)
        ! Solutions use owned rows of hubs.
        if (has_terms .or. any(a%is_kept)) allocate (self%own(a%n), source=0.0_wp)
        allocate (self%is_out(a%m), source=.false.)
        self%leaves_out = .false.
        self%has_rows = .false.
        self%is_factored = .false.
    end subroutine allocate_factor

    !> W and R from a compressed M (n, ld). `load_rows` was called.
    subroutine invert_masses(self, a, ld, mass, stat)
        class(factor_type), intent(inout) :: self
        type(analysis_type), intent(in) :: a
        integer, intent(in) :: ld
        real(wp), intent(in) :: mass(a%n, ld)
        !> ok or `singular_mass`.
        integer, intent(out) :: stat
        real(wp) :: part, work(most_coordinates*most_coordinates)
        integer :: b, first(side_by_side), j, s, waiting, worst
        logical :: has_row(side_by_side)

        stat = status_ok
        waiting = 0
        do b = 1, a%n_bodies
            j = a%first(b)
            if (is_rigid(b)) then
                waiting = waiting + 1
                first(waiting) = j
                has_row(waiting) = a%norm_row(b) > 0
                if (waiting == side_by_side) call invert_waiting()
            else
                do while (j < a%first(b + 1))
                    s = 1
                    do while (j + s < a%first(b + 1))
                        if (a%block_first(j + s) /= j) exit
                        s = s + 1
                    end do
                    if (s == 1 .and. a%norm_row(b) == 0 .and. mass(j, 1) > 0.0_wp) then
                        self%w(1, j) = merge(mass(j, 1), 1.0_wp/mass(j, 1), a%is_kept(b))
                    else
                        part = 0.0_wp
                        if (a%is_kept(b)) part = self%added(b)
                        call invert_block(s, a%n, mass(j, 1), a%norm_row(b) > 0, a%is_kept(b), self%own(j), size(self%w, 1), &
                            self%w(1, j), self%r(j), part, work, worst)
                        if (a%is_kept(b)) self%added(b) = part
                        if (worst > 0) call refuse(j + worst - 1)
                        if (worst > 0) return
                    end if
                    j = j + s
                end do
            end if
            if (stat /= status_ok) return
        end do
        if (waiting > 0) call invert_waiting()

    contains

        !> Invert the collected rigid bodies together.
        subroutine invert_waiting()
            integer :: bad(side_by_side), l

            call invert_rigid(waiting, first, has_row, a%n, mass, self%own, size(self%w, 1), self%w, self%r, bad)
            do l = 1, waiting
                if (bad(l) > 0 .and. stat == status_ok) call refuse(first(l) + bad(l) - 1)
            end do
            waiting = 0
        end subroutine invert_waiting

        !> Set the status of a coordinate without mass.
        subroutine refuse(coordinate)
            integer, intent(in) :: coordinate
            integer :: body, i

            stat = status_singular_mass
            self%failed_coordinate = coordinate
            body = 1
            do while (a%first(body + 1) <= coordinate)
                body = body + 1
            end do
            do i = a%first(body), a%first(body + 1) - 1
                if (.not. abs(mass(i, 1)) <= huge(1.0_wp)) stat = status_not_finite
            end do
        end subroutine refuse

        !> True if a body is eliminated first and has three single entries and a block of four, with or without an owned row.
        pure logical function is_rigid(body)
            integer, intent(in) :: body

            is_rigid = a%kind(body) == of_rigid_body .and. .not. a%is_kept(body)
            if (.not. is_rigid .or. a%norm_row(body) == 0) return
            associate (at => a%first(body))
                is_rigid = .not. max(abs(self%own(at)), abs(self%own(at + 1)), abs(self%own(at + 2))) > 0.0_wp
            end associate
        end function is_rigid
    end subroutine invert_masses

    !> Factor at the point of `load_rows` and `invert_masses`.
    subroutine factorize(self, a, chooses, stat, left_out)
        class(factor_type), intent(inout) :: self
        type(analysis_type), intent(in) :: a
        !> True to choose again the rows that are left out because they depend on others.
        logical, intent(in) :: chooses
        !> ok, `rank_deficient` with `weakest`, `singular_mass` with `failed_coordinate`, or `not_finite`.
        integer, intent(out) :: stat
        !> Rows that are left out in any case if rows are chosen (m); none if absent.
        logical, intent(in), optional :: left_out(:)

        self%is_factored = .false.
        self%blocks = 0.0_wp
        self%alone = 0.0_wp
        if (chooses) then
            self%is_out = .false.
            if (present(left_out)) self%is_out(:) = left_out
            self%leaves_out = .true.
        end if
        call self%add_bodies(a)
        call self%eliminate(a, chooses, stat)
        self%is_factored = stat == status_ok
    end subroutine factorize

    !> Eliminate the nodes.
    subroutine eliminate(self, a, chooses, stat)
        class(factor_type), intent(inout) :: self
        type(analysis_type), intent(in) :: a
        logical, intent(in) :: chooses
        integer, intent(out) :: stat
        integer :: count, d, j, k, n, worst(side_by_side)

        stat = status_ok
        self%least = 1.0_wp
        self%weakest = 0
        self%rest = 0.0_wp
        self%loosest = 0
        n = 1
        do while (n <= a%n_nodes)
            count = max(a%together(n), 1)
            if (a%together(n) == 0 .or. self%leaves_out) then
                count = 1
                call invert_node(n, worst(1))
            else
                call invert_nodes(count, a%node(1, n), self%blocks, self%alone, least_pivot, worst)
            end if
            do k = n, n + count - 1
                if (.not. a%is_body(k)) call judge(a%origin(k), merge(a%height(k), worst(k - n + 1) - 1, worst(k - n + 1) == 0))
                if (worst(k - n + 1) > 0) then
                    call refuse(a%origin(k) + worst(k - n + 1) - 1, a%is_body(k))
                    return
                end if
                j = a%later_start(k)
                d = a%target%update_start(k)
                call pass_on(a%height(k), a%later_start(k + 1) - j, a%block%diagonal(k), a%behind(1, j), &
                    a%target%update(d + 1), self%blocks)
            end do
            n = n + count
        end do

    contains

        !> Invert a node.
        subroutine invert_node(node, bad)
            integer, intent(in) :: node
            integer, intent(out) :: bad
            real(wp) :: ratio(max(most_rows, most_coordinates))
            integer :: i

            associate (s => a%height(node), diagonal => a%block%diagonal(node), origin => a%origin(node))
                if (a%is_body(node)) then
                    do i = 1, s
                        ratio(i) = self%blocks(diagonal + (i - 1)*(s + 1) + 1)
                    end do
                    call invert(s, self%blocks(diagonal + 1:diagonal + s*s), ratio(:s), 1.0_wp, least_mass, bad)
                else if (self%leaves_out) then
                    call invert_some(s, self%blocks(diagonal + 1), self%alone(origin), -1.0_wp, least_pivot, chooses, &
                        self%is_out(origin), bad)
                else
                    call invert(s, self%blocks(diagonal + 1), self%alone(origin), -1.0_wp, least_pivot, bad)
                end if
            end associate
        end subroutine invert_node

        !> Update the smallest pivot of the rows in use, and the largest of the rows that are left out.
        subroutine judge(origin, height)
            integer, intent(in) :: origin, height
            integer :: i

            if (height == 5 .and. .not. self%leaves_out) then
                ! A loop of known length: usually no pivot is smaller.
                if (.not. smallest_of_five(self%alone(origin)) < self%least) return
            end if
            do i = origin, origin + height - 1
                if (self%is_out(i)) then
                    if (self%alone(i) > self%rest) self%loosest = i
                    self%rest = max(self%rest, self%alone(i))
                    cycle
                end if
                if (.not. self%alone(i) < self%least) cycle
                self%least = self%alone(i)
                self%weakest = i
            end do
        end subroutine judge

        !> Set the status of a pivot that is too small.
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

    pure real(wp) function smallest_of_five(x)
        real(wp), intent(in) :: x(5)

        smallest_of_five = min(min(x(1), x(2)), min(x(3), x(4)), x(5))
    end function smallest_of_five

    !> L = B D^-1 of the neighbours behind a node, and the reduction of their blocks by the node, L B'. Proceeds from the last
    !> neighbour, because the blocks before it are needed unchanged.
    pure subroutine pass_on(s, n_later, diagonal, behind, update_target, blocks)
        integer, intent(in) :: s, n_later, diagonal, behind(3, n_later), update_target(*)
        real(wp), intent(inout) :: blocks(*)
        real(wp) :: l(most_coordinates*most_coordinates)
        integer :: d, j, k

        do j = n_later, 1, -1
            d = j*(j - 1)/2
            associate (p => behind(2, j), block => behind(3, j))
                call multiply_right(p, s, blocks(block + 1), blocks(diagonal + 1), l)
                do k = 1, j
                    call subtract_update(p, behind(2, k), s, l, blocks(behind(3, k) + 1), blocks(update_target(d + k) + 1))
                end do
                call keep_rows(p, s, l, blocks(block + 1))
            end associate
        end do
    end subroutine pass_on

    !> Exchange the contents of two factors, except for shared arrays.
    subroutine exchange(self, other)
        class(factor_type), intent(inout) :: self
        type(factor_type), intent(inout) :: other

        call swap(self%y, other%y)
        call swap(self%r, other%r)
        call swap(self%blocks, other%blocks)
        call swap(self%added, other%added)
        call swap_matrices(self%sent, other%sent)
        call swap_values(self%least, other%least)
        call swap_values(self%rest, other%rest)
        call swap_rows(self%weakest, other%weakest)
        call swap_rows(self%loosest, other%loosest)

    contains

        subroutine swap(x, y)
            real(wp), allocatable, intent(inout) :: x(:), y(:)
            real(wp), allocatable :: z(:)

            call move_alloc(x, z)
            call move_alloc(y, x)
            call move_alloc(z, y)
        end subroutine swap

        subroutine swap_matrices(x, y)
            real(wp), allocatable, intent(inout) :: x(:, :), y(:, :)
            real(wp), allocatable :: z(:, :)

            call move_alloc(x, z)
            call move_alloc(y, x)
            call move_alloc(z, y)
        end subroutine swap_matrices

        subroutine swap_values(x, y)
            real(wp), intent(inout) :: x, y
            real(wp) :: z

            z = x
            x = y
            y = z
        end subroutine swap_values

        subroutine swap_rows(i, j)
            integer, intent(inout) :: i, j
            integer :: k

            k = i
            i = j
            j = k
        end subroutine swap_rows
    end subroutine exchange

    !> All components.
    subroutine pack_state(self, pack)
        class(factor_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack
        integer, allocatable :: out(:)

        call pack%item(self%c, self%y)
        call pack%item(self%sent)
        call pack%item(self%own)
        call pack%item(self%w)
        call pack%item(self%r, self%blocks, self%alone, self%added)
        call pack%item(self%least)
        call pack%item(self%weakest)
        call pack%item(self%rest)
        call pack%item(self%loosest)
        out = merge(1, 0, self%is_out)
        call pack%item(out)
        self%is_out = out > 0
        call pack%item(self%leaves_out, self%has_rows, self%is_factored)
    end subroutine pack_state
end module tandem_chart_sparse_factor
