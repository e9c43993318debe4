! SPDX-License-Identifier: MIT
!> One pivoted elimination of C (m, n), m <= n: C = Cd [I, Y] up to the order of the columns. It gives a right inverse
!> R = [Cd^-1; 0] (C R = I) and a null-space basis D = [-Y; I] (C D = 0), all that an explicit step needs of C.
!>
!> Gauss-Jordan in place on C', so that a row of C is contiguous; each row takes its largest free column as pivot, which
!> bounds the growth as partial pivoting does. The pivot columns are remembered: a neighbouring C is eliminated
!> without a search, and the search is made anew when an entry of Y has grown too much.
module tandem_linalg_elimination
    use tandem_kinds, only: wp
    use tandem_pack, only: pack_type
    implicit none (type, external)
    private

    public :: elimination_type

    !> A row of which at most this part is left depends on the rows before it; as the rank decision of `tandem_linalg_basis`.
    real(wp), parameter :: rank_tolerance = 1.0e-10_wp

    type :: elimination_type
        private
        !> The sign of det(Cd), carried over every change of pivots, so that it changes only where Cd turns singular.
        integer, public :: orientation = 1
        !> The smallest pivot against the largest entry of its row.
        real(wp), public :: weakness = 1.0_wp
        integer :: parity = 1, held_parity = 1, held_orientation = 1
        integer :: m = 0, n = 0
        logical :: has_pivots = .false., held_has_pivots = .false.
        !> The working copy of C' (n, m).
        real(wp), allocatable :: rows(:, :)
        !> Largest scaled entry of each row of C (m).
        real(wp), allocatable :: row_size(:)
        !> Pivot column of each row (m); the remaining columns (n - m).
        integer, allocatable :: pivot(:), free(:), held_pivot(:), held_free(:)
        logical, allocatable :: taken(:)
    contains
        procedure :: allocate => allocate_elimination
        procedure :: forget
        procedure :: hold
        procedure :: release
        procedure :: eliminate
        procedure :: get_right_inverse
        procedure :: get_null_space
        procedure :: pack_state
        procedure, private :: reduce
        procedure, private :: growth
    end type elimination_type

contains

    !> Allocate for matrices (m, n).
    subroutine allocate_elimination(self, m, n)
        class(elimination_type), intent(inout) :: self
        integer, intent(in) :: m, n

        self%m = m
        self%n = n
        self%has_pivots = .false.
        if (allocated(self%rows)) deallocate (self%rows, self%row_size, self%pivot, self%free, self%held_pivot, self%held_free, &
            self%taken)
        allocate (self%rows(n, m), self%row_size(m), source=0.0_wp)
        allocate (self%pivot(m), self%free(n - m), self%held_pivot(m), self%held_free(n - m), source=0)
        allocate (self%taken(n), source=.false.)
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
        self%held_orientation = self%orientation
    end subroutine hold

    !> Go back to the pivots that were kept.
    pure subroutine release(self)
        class(elimination_type), intent(inout) :: self

        self%has_pivots = self%held_has_pivots
        self%pivot = self%held_pivot
        self%free = self%held_free
        self%parity = self%held_parity
        self%orientation = self%held_orientation
    end subroutine release

    !> Eliminate a matrix. stat > 0: the row of that number has no pivot.
    subroutine eliminate(self, matrix, scale, stat)
        class(elimination_type), intent(inout) :: self
        !> C (m, n).
        real(wp), intent(in) :: matrix(:, :)
        !> Typical magnitudes of the unknowns (n), for the choice of pivots.
        real(wp), intent(in) :: scale(:)
        integer, intent(out) :: stat
        !> Largest |Y| that remembered pivots may leave.
        real(wp), parameter :: largest_growth = 10.0_wp
        integer :: i, j, pivot_sign

        if (self%has_pivots) then
            call self%reduce(matrix, scale, .false., pivot_sign, stat)
            if (pivot_sign /= 0) self%orientation = self%parity*pivot_sign
            if (stat == 0) then
                if (self%growth(scale) <= largest_growth) return
            end if
        end if
        self%taken = .false.
        call self%reduce(matrix, scale, .true., pivot_sign, stat)
        self%has_pivots = stat == 0
        self%parity = self%orientation*pivot_sign
        i = 0
        do j = 1, self%n
            if (self%taken(j)) cycle
            if (i == size(self%free)) exit
            i = i + 1
            self%free(i) = j
        end do
    end subroutine eliminate

    !> The elimination itself, with or without a search for pivots.
    subroutine reduce(self, matrix, scale, search, pivot_sign, stat)
        class(elimination_type), intent(inout) :: self
        real(wp), intent(in) :: matrix(:, :), scale(:)
        logical, intent(in) :: search
        !> Sign of the product of the pivots, 0 where one is zero.
        integer, intent(out) :: pivot_sign
        !> 0, or the row whose pivot is missing, or too weak where remembered.
        integer, intent(out) :: stat
        !> A remembered pivot below this part of its row's largest entry is searched anew: it would amplify rounding.
        real(wp), parameter :: smallest_pivot = 0.05_wp
        real(wp) :: largest, candidate, inverse, f
        integer :: i, j, k, p

        stat = 0
        pivot_sign = 1
        self%weakness = 1.0_wp
        self%row_size = 0.0_wp
        do j = 1, self%n
            do k = 1, self%m
                self%rows(j, k) = matrix(k, j)
                self%row_size(k) = max(self%row_size(k), abs(matrix(k, j))*scale(j))
            end do
        end do
        do k = 1, self%m
            if (search) then
                p = 0
                largest = 0.0_wp
                do j = 1, self%n
                    candidate = abs(self%rows(j, k))*scale(j)
                    if (self%taken(j) .or. .not. candidate > largest) cycle
                    largest = candidate
                    p = j
                end do
                if (p > 0) then
                    self%pivot(k) = p
                    self%taken(p) = .true.
                end if
            else
                p = self%pivot(k)
                ! Its sign is wanted all the same.
                if (stat == 0 .and. .not. abs(self%rows(p, k))*scale(p) >= smallest_pivot*self%row_size(k)) stat = k
            end if
            if (p > 0) then
                if (.not. abs(self%rows(p, k)) > tiny(1.0_wp)) p = 0
            end if
            if (p > 0) then
                self%weakness = min(self%weakness, abs(self%rows(p, k))*scale(p)/self%row_size(k))
                ! What rounding leaves of a row that depends on others is no pivot.
                if (search .and. self%weakness <= rank_tolerance) p = 0
            end if
            if (p == 0) then
                stat = k
                pivot_sign = 0
                return
            end if
            if (self%rows(p, k) < 0.0_wp) pivot_sign = -pivot_sign
            inverse = 1.0_wp/self%rows(p, k)
            do j = 1, self%n
                self%rows(j, k) = self%rows(j, k)*inverse
            end do
            self%rows(p, k) = inverse
            do i = 1, self%m
                if (i == k) cycle
                f = self%rows(p, i)
                self%rows(p, i) = 0.0_wp
                do j = 1, self%n
                    self%rows(j, i) = self%rows(j, i) - f*self%rows(j, k)
                end do
            end do
        end do
    end subroutine reduce

    !> The largest entry of Y in scaled unknowns.
    pure real(wp) function growth(self, scale)
        class(elimination_type), intent(in) :: self
        real(wp), intent(in) :: scale(:)
        integer :: i, k

        growth = 0.0_wp
        do k = 1, self%m
            do i = 1, self%n - self%m
                growth = max(growth, abs(self%rows(self%free(i), k))*scale(self%free(i))/scale(self%pivot(k)))
            end do
        end do
    end function growth

    !> R (n, m) with C R = I.
    pure subroutine get_right_inverse(self, right_inverse)
        class(elimination_type), intent(in) :: self
        real(wp), intent(out) :: right_inverse(:, :)
        integer :: j, k

        right_inverse = 0.0_wp
        do j = 1, self%m
            do k = 1, self%m
                right_inverse(self%pivot(k), j) = self%rows(self%pivot(j), k)
            end do
        end do
    end subroutine get_right_inverse

    !> D (n, n - m) with C D = 0.
    pure subroutine get_null_space(self, null_space)
        class(elimination_type), intent(in) :: self
        real(wp), intent(out) :: null_space(:, :)
        integer :: i, k

        null_space = 0.0_wp
        do i = 1, self%n - self%m
            do k = 1, self%m
                null_space(self%pivot(k), i) = -self%rows(self%free(i), k)
            end do
            null_space(self%free(i), i) = 1.0_wp
        end do
    end subroutine get_null_space

    !> What the next elimination starts from.
    subroutine pack_state(self, pack)
        class(elimination_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%orientation)
        call pack%item(self%weakness)
        call pack%item(self%parity)
        call pack%item(self%has_pivots)
        call pack%item(self%pivot)
        call pack%item(self%free)
    end subroutine pack_state
end module tandem_linalg_elimination
