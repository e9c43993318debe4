! SPDX-License-Identifier: MIT
!> One pivoted elimination of C (m, n), m <= n: C = Cd [I, Y] up to the order of the columns. It gives a right inverse
!> R = [Cd^-1; 0] (C R = I) and a null-space basis D = [-Y; I] (C D = 0), all that an explicit step needs of C.
!>
!> Gauss-Jordan in place; each row takes its largest free column as pivot, which bounds the growth as partial pivoting does.
!> The pivot columns are remembered: a neighbouring C is eliminated without a search, and the search is made anew when a pivot
!> has become small in its row or an entry of Y has grown too much.
!>
!> Columns are padded with zeros to a multiple of `lane`, so that inner loops have a constant length: at the sizes of one
!> mechanism that is worth more than the arithmetic it wastes.
module tandem_linalg_elimination
    use tandem_kinds, only: wp
    use tandem_pack, only: pack_type
    implicit none (type, external)
    private

    public :: elimination_type, lane, short

    !> Columns are padded to multiples of `lane`; innermost loops have the length `short`, one vector register.
    integer, parameter :: lane = 8, short = 4
    !> A row of which at most this part is left depends on the rows before it; as the rank decision of `tandem_linalg_basis`.
    real(wp), parameter :: rank_tolerance = 1.0e-10_wp

    type :: elimination_type
        !> m rows, padded to `height`, and n columns.
        integer :: m = 0, n = 0, height = 0
        !> C (height, n); what the elimination makes of it: Y in the columns `free`, Cd^-1 in the columns `pivot` (height, n).
        real(wp), allocatable :: matrix(:, :), eliminated(:, :)
        !> Pivot column of each row (m); the remaining columns (n - m).
        integer, allocatable :: pivot(:), free(:)
        !> The number of this choice of pivots; it changes with every new choice, and comes back with `release`.
        integer :: choice = 0
        integer, private :: parity = 1, last_choice = 0, held_choice = 0, held_parity = 1
        logical, private :: has_pivots = .false., held_has_pivots = .false.
        !> Largest scaled entry of each row of C when it was measured last, the pivots; a column; 1 for rows and 0 for padding
        !> (height).
        real(wp), allocatable, private :: row_size(:), pivots(:), column(:), mask(:)
        !> Scales of the unknowns (n), and those of the pivot columns (height).
        real(wp), allocatable, private :: scale(:), pivot_scale(:)
        integer, allocatable, private :: held_pivot(:), held_free(:)
        logical, allocatable, private :: taken(:)
    contains
        procedure :: allocate => allocate_elimination
        procedure :: forget
        procedure :: hold
        procedure :: release
        procedure :: eliminate
        procedure :: orientation
        procedure :: measure_weakness
        procedure :: smallest_singular_value
        procedure :: get_right_inverse
        procedure :: get_null_space
        procedure :: pack_state
        procedure, private :: choose_pivots
    end type elimination_type

contains

    !> Allocate for matrices (m, n).
    subroutine allocate_elimination(self, m, n)
        class(elimination_type), intent(inout) :: self
        integer, intent(in) :: m, n

        self%m = m
        self%n = n
        self%height = lane*((m + lane - 1)/lane)
        self%has_pivots = .false.
        self%parity = 1
        if (allocated(self%matrix)) deallocate (self%matrix, self%eliminated, self%row_size, self%pivots, self%column, self%mask, &
            self%scale, self%pivot_scale, self%pivot, self%free, self%held_pivot, self%held_free, self%taken)
        allocate (self%matrix(self%height, n), self%eliminated(self%height, n), source=0.0_wp)
        allocate (self%row_size(self%height), self%pivots(self%height), self%column(self%height), self%mask(self%height), &
            source=0.0_wp)
        allocate (self%scale(n), self%pivot_scale(self%height), source=1.0_wp)
        allocate (self%pivot(m), self%free(n - m), self%held_pivot(m), self%held_free(n - m), source=0)
        allocate (self%taken(n), source=.false.)
        self%mask(:m) = 1.0_wp
    end subroutine allocate_elimination

    !> Search for pivots at the next elimination.
    pure subroutine forget(self)
        class(elimination_type), intent(inout) :: self

        self%has_pivots = .false.
    end subroutine forget

    !> Keep the remembered pivots.
    pure subroutine hold(self)
        class(elimination_type), intent(inout) :: self

        self%held_has_pivots = self%has_pivots
        self%held_pivot = self%pivot
        self%held_free = self%free
        self%held_parity = self%parity
        self%held_choice = self%choice
    end subroutine hold

    !> Go back to the pivots that were kept.
    pure subroutine release(self)
        class(elimination_type), intent(inout) :: self

        self%has_pivots = self%held_has_pivots
        self%pivot = self%held_pivot
        self%free = self%held_free
        self%parity = self%held_parity
        self%choice = self%held_choice
        if (self%has_pivots) self%pivot_scale(:self%m) = self%scale(self%pivot)
    end subroutine release

    !> Eliminate a matrix. stat > 0: the row of that number has no pivot.
    subroutine eliminate(self, matrix, scale, stat)
        class(elimination_type), intent(inout) :: self
        !> C (m, n).
        real(wp), intent(in), contiguous :: matrix(:, :)
        !> Typical magnitudes of the unknowns (n), for the choice of pivots; the same ones every time.
        real(wp), intent(in), contiguous :: scale(:)
        integer, intent(out) :: stat
        integer :: orientation

        if (self%height == lane) then
            call load(self%m, self%n, lane, matrix, self%mask, self%matrix, self%eliminated)
        else
            call load(self%m, self%n, self%height, matrix, self%mask, self%matrix, self%eliminated)
        end if
        stat = 0
        if (self%has_pivots) then
            ! The same loops, in the common case of a length that the compiler knows.
            if (self%height == lane) then
                call reduce(self%m, self%n, lane, self%pivot, self%free, self%scale, self%pivot_scale, self%row_size, &
                    self%eliminated, self%column, self%pivots, stat)
            else
                call reduce(self%m, self%n, self%height, self%pivot, self%free, self%scale, self%pivot_scale, self%row_size, &
                    self%eliminated, self%column, self%pivots, stat)
            end if
            if (stat == 0) return
        end if
        ! What the old pivots say of the orientation holds for the new ones.
        orientation = self%orientation()
        call self%choose_pivots(scale, stat)
        self%has_pivots = stat == 0
        if (stat == 0) self%parity = self%parity*orientation*self%orientation()
    end subroutine eliminate

    !> Copy C twice.
    pure subroutine load(m, n, height, matrix, mask, copy, work)
        integer, intent(in) :: m, n
        integer, intent(in), value :: height
        real(wp), intent(in) :: matrix(m*n), mask(height)
        real(wp), intent(inout) :: copy(height, n), work(height, n)
        integer :: b, i, j, first

        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do j = 1, n
            first = (j - 1)*m
            if (first + height <= m*n) then
                do b = 0, height - short, short
                    !GCC$ UNROLL 1
                    do i = 1, short
                        copy(b + i, j) = matrix(first + b + i)*mask(b + i)
                    end do
                end do
            else
                do i = 1, m
                    copy(i, j) = matrix(first + i)
                end do
            end if
            do b = 0, height - short, short
                !GCC$ UNROLL 1
                do i = 1, short
                    work(b + i, j) = copy(b + i, j)
                end do
            end do
        end do
    end subroutine load

    !> Take all remembered pivots. stat > 0: they do not serve, because one of them is small in its row or an entry of Y is large.
    pure subroutine reduce(m, n, height, pivot, free, scale, pivot_scale, row_size, a, column, pivots, stat)
        integer, intent(in) :: m, n, pivot(m), free(n - m)
        integer, intent(in), value :: height
        real(wp), intent(in) :: scale(n), pivot_scale(height), row_size(height)
        real(wp), intent(inout) :: a(height, n), column(height), pivots(height)
        integer, intent(out) :: stat
        !> A remembered pivot below this part of its row's largest entry is searched anew: it would amplify rounding.
        real(wp), parameter :: smallest_pivot = 0.05_wp
        !> Largest |Y| that remembered pivots may leave.
        real(wp), parameter :: largest_growth = 10.0_wp
        real(wp) :: f
        integer :: b, i, j, k, p

        stat = 0
        do k = 1, m
            pivots(k) = a(k, pivot(k))
            if (.not. abs(pivots(k)) > tiny(1.0_wp)) then
                stat = k
                return
            end if
            call take_pivot(k, pivot(k), n, height, a, column)
        end do
        ! What is above its limit, row by row: not above 1 where all is well.
        do b = 0, height - short, short
            !GCC$ UNROLL 1
            do i = 1, short
                column(b + i) = merge(0.0_wp, 2.0_wp, abs(pivots(b + i))*pivot_scale(b + i) >= smallest_pivot*row_size(b + i))
            end do
        end do
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do j = 1, n - m
            p = free(j)
            f = scale(p)/largest_growth
            do b = 0, height - short, short
                !GCC$ UNROLL 1
                do i = 1, short
                    column(b + i) = merge(column(b + i), 2.0_wp, abs(a(b + i, p))*f <= pivot_scale(b + i))
                end do
            end do
        end do
        !GCC$ UNROLL 1
        do i = 1, m
            if (column(i) > 1.0_wp) stat = i
        end do
    end subroutine reduce

    !> Make column p the unit vector k, in whose place its inverse is stored: row k := row k/a(k, p), the others less a(i, p) times
    !> it.
    pure subroutine take_pivot(k, p, n, height, a, column)
        integer, intent(in) :: k, p, n
        integer, intent(in), value :: height
        real(wp), intent(inout) :: a(height, n), column(height)
        real(wp) :: f, inverse
        integer :: b, i, j

        inverse = 1.0_wp/a(k, p)
        do b = 0, height - short, short
            !GCC$ UNROLL 1
            do i = 1, short
                column(b + i) = a(b + i, p)
                a(b + i, p) = 0.0_wp
            end do
        end do
        a(k, p) = 1.0_wp
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do j = 1, n
            f = a(k, j)*inverse
            do b = 0, height - short, short
                !GCC$ UNROLL 1
                do i = 1, short
                    a(b + i, j) = a(b + i, j) - column(b + i)*f
                end do
            end do
            a(k, j) = f
        end do
    end subroutine take_pivot

    !> Eliminate with a search for pivots.
    subroutine choose_pivots(self, scale, stat)
        class(elimination_type), intent(inout) :: self
        real(wp), intent(in), contiguous :: scale(:)
        integer, intent(out) :: stat
        real(wp) :: largest, candidate
        integer :: i, j, k, p

        stat = 0
        call measure_rows(self%n, self%height, self%matrix, scale, self%row_size)
        self%last_choice = self%last_choice + 1
        self%choice = self%last_choice
        self%eliminated = self%matrix
        self%scale = scale
        self%taken = .false.
        !GCC$ UNROLL 1
        do k = 1, self%m
            p = 0
            largest = 0.0_wp
            !GCC$ UNROLL 1
            do j = 1, self%n
                candidate = abs(self%eliminated(k, j))*scale(j)
                if (self%taken(j) .or. .not. candidate > largest) cycle
                largest = candidate
                p = j
            end do
            ! What rounding leaves of a row that depends on others is no pivot.
            if (.not. largest > rank_tolerance*self%row_size(k)) p = 0
            if (p > 0) then
                if (.not. abs(self%eliminated(k, p)) > tiny(1.0_wp)) p = 0
            end if
            if (p == 0) then
                stat = k
                self%pivots(k) = 0.0_wp
                self%pivot_scale(k) = 1.0_wp
                return
            end if
            self%pivot(k) = p
            self%pivots(k) = self%eliminated(k, p)
            self%pivot_scale(k) = scale(p)
            self%taken(p) = .true.
            call take_pivot(k, p, self%n, self%height, self%eliminated, self%column)
        end do
        i = 0
        !GCC$ UNROLL 1
        do j = 1, self%n
            if (self%taken(j)) cycle
            i = i + 1
            self%free(i) = j
        end do
    end subroutine choose_pivots

    !> The largest scaled entry of each row.
    pure subroutine measure_rows(n, height, c, scale, row_size)
        integer, intent(in) :: n, height
        real(wp), intent(in) :: c(height, n), scale(n)
        real(wp), intent(inout) :: row_size(height)
        integer :: b, i, j

        row_size = 0.0_wp
        do j = 1, n
            do b = 0, height - short, short
                !GCC$ UNROLL 1
                do i = 1, short
                    row_size(b + i) = max(row_size(b + i), abs(c(b + i, j))*scale(j))
                end do
            end do
        end do
    end subroutine measure_rows

    !> The sign of det(Cd), carried over every change of pivots, so that it changes only where Cd turns singular.
    pure integer function orientation(self)
        class(elimination_type), intent(in) :: self
        integer :: k

        orientation = self%parity
        !GCC$ UNROLL 1
        do k = 1, self%m
            if (self%pivots(k) < 0.0_wp) orientation = -orientation
        end do
    end function orientation

    !> The smallest pivot against the largest entry of its row, 1 where there is none. Rows are measured anew, by which pivots are
    !> judged until the next look: rows do not change much within a step.
    subroutine measure_weakness(self, weakness)
        class(elimination_type), intent(inout) :: self
        real(wp), intent(out) :: weakness
        integer :: k

        call measure_rows(self%n, self%height, self%matrix, self%scale, self%row_size)
        weakness = 1.0_wp
        do k = 1, self%m
            weakness = min(weakness, abs(self%pivots(k))*self%pivot_scale(k)/max(self%row_size(k), tiny(1.0_wp)))
        end do
    end subroutine measure_weakness

    !> A lower bound of the smallest singular value of the rows of C brought to unit length, in scaled unknowns: 1/|R| in the
    !> Frobenius norm, as R is a right inverse.
    pure real(wp) function smallest_singular_value(self) result(bound)
        class(elimination_type), intent(in) :: self

        bound = 1.0_wp
        if (self%m > 0) bound = 1.0_wp/norm_of_inverse(self%m, self%n, self%height, self%pivot, self%scale, self%pivot_scale, &
            self%matrix, self%eliminated)
    end function smallest_singular_value

    !> |R|_F, row i of C of length 1.
    pure real(wp) function norm_of_inverse(m, n, height, pivot, scale, pivot_scale, c, a) result(norm)
        integer, intent(in) :: m, n, height, pivot(m)
        real(wp), intent(in) :: scale(n), pivot_scale(height), c(height, n), a(height, n)
        real(wp) :: length(lane), total(lane)
        integer :: b, d, i, j, p

        norm = 0.0_wp
        do b = 0, height - lane, lane
            do i = 1, lane
                length(i) = 0.0_wp
            end do
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do j = 1, n
                !GCC$ UNROLL 1
                do i = 1, lane
                    length(i) = length(i) + (c(b + i, j)*scale(j))**2
                end do
            end do
            ! Column b + j of R, d runs over its rows.
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do j = 1, min(lane, m - b)
                p = pivot(b + j)
                do d = 0, height - lane, lane
                    !GCC$ UNROLL 1
                    do i = 1, lane
                        total(i) = (a(d + i, p)/pivot_scale(d + i))**2
                    end do
                    norm = norm + length(j)*(((total(1) + total(2)) + (total(3) + total(4))) + &
                        ((total(5) + total(6)) + (total(7) + total(8))))
                end do
            end do
        end do
        norm = sqrt(norm)
    end function norm_of_inverse

    !> R (n, m) with C R = I.
    pure subroutine get_right_inverse(self, right_inverse)
        class(elimination_type), intent(in) :: self
        real(wp), intent(out) :: right_inverse(:, :)
        integer :: j, k

        right_inverse = 0.0_wp
        !GCC$ UNROLL 1
        do j = 1, self%m
            !GCC$ UNROLL 1
            do k = 1, self%m
                right_inverse(self%pivot(k), j) = self%eliminated(k, self%pivot(j))
            end do
        end do
    end subroutine get_right_inverse

    !> D (n, n - m) with C D = 0.
    pure subroutine get_null_space(self, null_space)
        class(elimination_type), intent(in) :: self
        real(wp), intent(out) :: null_space(:, :)
        integer :: i, k

        null_space = 0.0_wp
        !GCC$ UNROLL 1
        do i = 1, self%n - self%m
            !GCC$ UNROLL 1
            do k = 1, self%m
                null_space(self%pivot(k), i) = -self%eliminated(k, self%free(i))
            end do
            null_space(self%free(i), i) = 1.0_wp
        end do
    end subroutine get_null_space

    !> What the last elimination left, and what the next one starts from.
    subroutine pack_state(self, pack)
        class(elimination_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%matrix)
        call pack%item(self%eliminated)
        call pack%item(self%pivots)
        call pack%item(self%row_size)
        call pack%item(self%scale)
        call pack%item(self%pivot_scale)
        call pack%item(self%parity)
        call pack%item(self%choice)
        call pack%item(self%last_choice)
        call pack%item(self%has_pivots)
        call pack%item(self%pivot)
        call pack%item(self%free)
    end subroutine pack_state
end module tandem_linalg_elimination
