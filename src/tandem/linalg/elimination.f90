! SPDX-License-Identifier: MIT
!> One pivoted elimination of C (m, n), m <= n: C = Cd [I, Y] up to the order of the columns. It gives a right inverse R = [Cd^-1;
!> 0] (C R = I) and a null-space basis D = [-Y; I] (C D = 0), which suffice for an explicit step.
!>
!> Gauss-Jordan in place; the pivot of each row is its largest free column, which bounds the growth as partial pivoting does. The
!> pivot columns are stored: a neighbouring C is eliminated without a search. The search is repeated when a pivot has become small
!> in its row or an entry of Y has grown too much.
!>
!> Columns are padded with zeros to a multiple of `lane`, so that inner loops have a constant length, which for the size of one
!> mechanism saves more than the additional arithmetic costs. With more than `largest_small` rows, for which the matrix exceeds the
!> first-level cache, stored pivot columns are eliminated by LAPACK, with row pivoting and without the inverse of Cd.
module tandem_linalg_elimination
    use tandem_kinds, only: lane, short, wp
    use tandem_linalg_aligned, only: allocate_aligned
    use tandem_linalg_kernels, only: is_finite
    use tandem_linalg_pivots, only: check_growth, check_pivots, divide_rows, load, take_ahead, take_pivot, take_singly
    use tandem_pack, only: pack_type
    implicit none (type, external)
    private

    public :: elimination_type, largest_small, pivots_type

    !> Largest number of rows for which loops are faster than LAPACK (OpenBLAS); with 128 rows a step by loops takes twice as long.
    integer, parameter :: largest_small = 64
    !> A row is dependent on the previous ones if at most this part of it remains, as in the rank decision of `tandem_linalg_basis`.
    real(wp), parameter :: rank_tolerance = 1.0e-10_wp

    !> A choice of pivots.
    type :: pivots_type
        private
        integer :: choice = 0, parity = 1
        logical :: has_pivots = .false.
        integer, allocatable :: order(:)
        real(wp), allocatable :: row_size(:)
    end type pivots_type

    !> An elimination, and its pivots for the next one.
    type :: elimination_type
        !> m rows, padded to `height`, and n columns.
        integer :: m = 0, n = 0, height = 0
        !> C (height, n); result of the elimination: [Cd^-1, Y] (height, n), by LAPACK factors of Cd in place of its inverse.
        real(wp), allocatable :: matrix(:, :), eliminated(:, :)
        !> Columns of C in the order of elimination (n): the pivot column of each row, then the free ones.
        integer, allocatable :: order(:)
        !> Number of this choice of pivots; it changes with every new choice, and `restore_saved` restores it.
        integer :: choice = 0
        integer, private :: parity = 1, last_choice = 0
        logical, private :: has_pivots = .false.
        !> Largest scaled entry of each row of C at the last measurement, pivots; a column; 1 for rows and 0 for
        !> padding (height); unit matrix (height, height).
        real(wp), allocatable, private :: row_size(:), pivots(:), column(:), mask(:), unit(:, :)
        !> Scales of the unknowns (n), and of the pivot columns (height).
        real(wp), allocatable, private :: scale(:), pivot_scale(:)
        !> By LAPACK: row exchanges, and scale factors of the rows, powers of 2 (m).
        integer, allocatable, private :: exchanges(:)
        real(wp), allocatable, private :: row_factor(:)
    contains
        procedure :: allocate => allocate_elimination, forget
        procedure :: save, restore_saved
        procedure :: eliminate, solve, orientation, measure_rows
        procedure :: get_right_inverse, get_null_space, pack_state
        procedure, private :: choose_pivots, factor, solve_all, swap
    end type elimination_type

    ! By LAPACK, for many rows.
    interface
        !> Eliminate with all stored pivots. stat > 0: they are not usable.
        module subroutine factor(self, matrix, is_choosy, stat)
            implicit none (type, external)
            class(elimination_type), intent(inout) :: self
            !> C (m, n).
            real(wp), intent(in) :: matrix(self%m, self%n)
            !> True to refuse also small pivots and large entries of Y, for which a search may find better ones.
            logical, intent(in) :: is_choosy
            integer, intent(out) :: stat
        end subroutine factor

        !> Rows Cd^-1 of R, each at its pivot column.
        module subroutine solve_all(self, right_inverse)
            implicit none (type, external)
            class(elimination_type), intent(in) :: self
            !> R (n, m).
            real(wp), intent(inout) :: right_inverse(:, :)
        end subroutine solve_all

        !> y := Cd^-1 x, after any elimination.
        module subroutine solve(self, x, y)
            implicit none (type, external)
            class(elimination_type), intent(in) :: self
            real(wp), intent(in) :: x(self%m)
            real(wp), intent(inout) :: y(self%height)
        end subroutine solve
    end interface

contains

    !> Allocate for matrices (m, n).
    subroutine allocate_elimination(self, m, n)
        class(elimination_type), intent(inout) :: self
        integer, intent(in) :: m, n
        integer :: i

        self%m = m
        self%n = n
        self%height = lane*((m + lane - 1)/lane)
        self%has_pivots = .false.
        self%parity = 1
        if (allocated(self%scale)) deallocate (self%scale, self%order)
        if (allocated(self%exchanges)) deallocate (self%exchanges, self%row_factor)
        if (m > largest_small) then
            allocate (self%exchanges(m), source=0)
            allocate (self%row_factor(m), source=1.0_wp)
        end if
        associate (height => self%height)
            call allocate_aligned(self%matrix, height, n)
            call allocate_aligned(self%eliminated, height, n)
            call allocate_aligned(self%unit, height, height)
            call allocate_aligned(self%row_size, height)
            call allocate_aligned(self%pivots, height)
            call allocate_aligned(self%column, height)
            call allocate_aligned(self%mask, height)
            call allocate_aligned(self%pivot_scale, height)
        end associate
        allocate (self%scale(n), source=1.0_wp)
        allocate (self%order(n), source=0)
        self%pivot_scale(:) = 1.0_wp
        self%mask(:m) = 1.0_wp
        self%pivots(m + 1:) = 1.0_wp
        do i = 1, self%height
            self%unit(i, i) = 1.0_wp
        end do
    end subroutine allocate_elimination

    !> Discard the pivots: search at the next elimination.
    pure subroutine forget(self)
        class(elimination_type), intent(inout) :: self

        self%has_pivots = .false.
    end subroutine forget

    !> Save the pivots, so that other points can be evaluated without effect.
    pure subroutine save(self, pivots)
        class(elimination_type), intent(in) :: self
        type(pivots_type), intent(inout) :: pivots

        pivots%has_pivots = self%has_pivots
        pivots%order = self%order
        pivots%row_size = self%row_size
        pivots%parity = self%parity
        pivots%choice = self%choice
    end subroutine save

    !> Restore the saved pivots.
    pure subroutine restore_saved(self, pivots)
        class(elimination_type), intent(inout) :: self
        type(pivots_type), intent(in) :: pivots

        self%has_pivots = pivots%has_pivots
        self%order(:) = pivots%order
        self%row_size(:) = pivots%row_size
        self%parity = pivots%parity
        self%choice = pivots%choice
        if (self%has_pivots) self%pivot_scale(:self%m) = self%scale(self%order(:self%m))
    end subroutine restore_saved

    !> Eliminate a matrix. stat > 0: the row of this number has no pivot; stat < 0: an entry is not finite.
    subroutine eliminate(self, matrix, scale, stat)
        class(elimination_type), intent(inout) :: self
        !> C (m, n).
        real(wp), intent(in) :: matrix(self%m, self%n)
        !> Typical magnitudes of the unknowns (n), for the choice of pivots; the same in every call.
        real(wp), intent(in) :: scale(self%n)
        integer, intent(out) :: stat
        integer :: j, orientation

        stat = 1
        if (.not. self%has_pivots) then
            do j = 1, self%n
                self%order(j) = j
            end do
            call load(self%m, self%n, self%height, matrix, self%mask, self%order, self%matrix, self%eliminated)
        else if (self%m <= largest_small) then
            if (self%height == lane) then
                call take_stored(self, lane, matrix, stat)
            else
                call take_stored(self, self%height, matrix, stat)
            end if
        else
            call self%factor(matrix, .true., stat)
        end if
        if (stat == 0) return
        if (.not. is_finite(size(self%matrix), self%matrix)) then
            stat = -1
            return
        end if
        ! The orientation of the old pivots is kept for the new ones.
        orientation = self%orientation()
        call self%choose_pivots(scale, stat)
        if (stat == 0 .and. self%m > largest_small) call self%factor(matrix, .false., stat)
        self%has_pivots = stat == 0
        if (stat == 0) self%parity = self%parity*orientation*self%orientation()
    end subroutine eliminate

    !> Eliminate with all stored pivots. stat > 0: they are not usable, because one of them is small in its row or an entry of Y is
    !> large. An entry that is not finite makes a pivot or an entry of Y not finite, and fails too.
    pure subroutine take_stored(self, height, matrix, stat)
        class(elimination_type), intent(inout) :: self
        !> `self%height`, as a constant for the most frequent length.
        integer, intent(in), value :: height
        real(wp), intent(in) :: matrix(self%m, self%n)
        integer, intent(out) :: stat

        associate (m => self%m, n => self%n)
            if (height == lane .and. m > 1) then
                call take_ahead(m, n, matrix, self%mask, self%order, self%matrix, self%eliminated, self%pivots, stat)
            else
                call load(m, n, height, matrix, self%mask, self%order, self%matrix, self%eliminated)
                call take_singly(m, n, height, self%unit, self%eliminated, self%column, self%pivots, stat)
                if (stat == 0) call divide_rows(n, height, self%pivots, self%eliminated, self%column)
            end if
            if (stat /= 0) return
            call check_pivots(height, self%row_size, self%pivot_scale, self%pivots, self%column)
            call check_growth(m, n, height, self%order, self%scale, self%pivot_scale, self%eliminated, self%column, stat)
        end associate
    end subroutine take_stored

    !> Eliminate with a search for pivots.
    subroutine choose_pivots(self, scale, stat)
        class(elimination_type), intent(inout) :: self
        real(wp), intent(in) :: scale(self%n)
        integer, intent(out) :: stat
        real(wp) :: largest, candidate
        integer :: i, j, k, p

        stat = 0
        call set_row_size(self%n, self%height, self%matrix, scale, self%row_size)
        self%last_choice = self%last_choice + 1
        self%choice = self%last_choice
        self%eliminated(:, :) = self%matrix
        self%scale(:) = scale
        do j = 1, self%n
            self%order(j) = j
        end do
        do k = 1, self%m
            p = 0
            largest = 0.0_wp
            do j = k, self%n
                candidate = abs(self%eliminated(k, j))*scale(self%order(j))
                if (.not. candidate > largest) cycle
                largest = candidate
                p = j
            end do
            ! The rounding remainder of a dependent row is not a pivot.
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
            call self%swap(k, p)
            self%pivots(k) = self%eliminated(k, k)
            self%pivot_scale(k) = scale(self%order(k))
            call take_pivot(k, self%n, self%height, 1.0_wp/self%pivots(k), self%unit, self%eliminated, self%column)
        end do
        call divide_rows(self%n, self%height, self%pivots, self%eliminated, self%column)
        ! Keep the free columns in the order of the coordinates, so that factoring D'M D has the rounding errors of this order.
        do i = self%m + 2, self%n
            do j = i, self%m + 2, -1
                if (self%order(j - 1) < self%order(j)) exit
                call self%swap(j - 1, j)
            end do
        end do
    end subroutine choose_pivots

    !> Exchange two columns.
    pure subroutine swap(self, j, k)
        class(elimination_type), intent(inout) :: self
        integer, intent(in) :: j, k
        real(wp) :: entry
        integer :: i

        do i = 1, self%height
            entry = self%eliminated(i, j)
            self%eliminated(i, j) = self%eliminated(i, k)
            self%eliminated(i, k) = entry
        end do
        i = self%order(j)
        self%order(j) = self%order(k)
        self%order(k) = i
    end subroutine swap

    !> Largest scaled entry of each row.
    pure subroutine set_row_size(n, height, c, scale, row_size)
        integer, intent(in) :: n
        integer, intent(in), value :: height
        real(wp), intent(in) :: c(height, n), scale(n)
        real(wp), intent(inout) :: row_size(height)
        integer :: b, i, j

        do b = 0, height - short, short
            !GCC$ UNROLL 1
            do i = 1, short
                row_size(b + i) = 0.0_wp
            end do
        end do
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do j = 1, n
            do b = 0, height - short, short
                !GCC$ UNROLL 1
                do i = 1, short
                    row_size(b + i) = max(row_size(b + i), abs(c(b + i, j))*scale(j))
                end do
            end do
        end do
    end subroutine set_row_size

    !> Sign of det(Cd), preserved over changes of pivots, so that it changes only when Cd passes a singularity.
    pure integer function orientation(self)
        class(elimination_type), intent(in) :: self
        integer :: k

        orientation = self%parity
        !GCC$ UNROLL 1
        do k = 1, self%m
            if (self%pivots(k) < 0.0_wp) orientation = -orientation
        end do
    end function orientation

    !> Update the sizes of the rows, with which pivots are compared until the next update: rows change little within a step.
    pure subroutine measure_rows(self)
        class(elimination_type), intent(inout) :: self

        if (self%height == lane) then
            call set_row_size(self%n, lane, self%matrix, self%scale, self%row_size)
        else
            call set_row_size(self%n, self%height, self%matrix, self%scale, self%row_size)
        end if
    end subroutine measure_rows

    !> R (n, m) with C R = I.
    subroutine get_right_inverse(self, right_inverse)
        class(elimination_type), intent(in) :: self
        real(wp), intent(out) :: right_inverse(:, :)
        integer :: j, k

        right_inverse = 0.0_wp
        if (self%m > largest_small) then
            call self%solve_all(right_inverse)
            return
        end if
        !GCC$ UNROLL 1
        do j = 1, self%m
            !GCC$ UNROLL 1
            do k = 1, self%m
                right_inverse(self%order(k), j) = self%eliminated(k, j)
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
                null_space(self%order(k), i) = -self%eliminated(k, self%m + i)
            end do
            null_space(self%order(self%m + i), i) = 1.0_wp
        end do
    end subroutine get_null_space

    !> Pack the result of the last elimination, and the start of the next one.
    subroutine pack_state(self, pack)
        class(elimination_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%matrix)
        call pack%item(self%eliminated)
        call pack%item(self%pivots, self%row_size, self%scale, self%pivot_scale)
        call pack%item(self%parity, self%choice, self%last_choice)
        call pack%item(self%has_pivots)
        call pack%item(self%order, self%exchanges)
        call pack%item(self%row_factor)
    end subroutine pack_state
end module tandem_linalg_elimination
