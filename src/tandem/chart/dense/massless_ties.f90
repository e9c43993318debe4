! SPDX-License-Identifier: MIT
!> Conditioning of the coordinates without mass by the constraints: an unconstrained one has no acceleration.
module tandem_chart_dense_massless_ties
    use tandem_kinds, only: short, wp
    use tandem_pack, only: pack_type
    implicit none (type, external)
    private

    public :: massless_ties_type

    type :: massless_ties_type
        !> The coordinate with the weakest conditioning, 0 if all have mass.
        integer :: loosest = 0
        !> Number of coordinates without mass, and their indices.
        integer :: n = 0
        integer, allocatable, private :: columns(:)
        !> Weights of the rows of C (m), and work space (m, m), its columns padded.
        real(wp), allocatable, private :: weight(:), product(:, :), weighted(:, :)
        !> Conditioning of `loosest` at the last comparison, and its best value: similar to squares of singular values.
        real(wp), private :: weakest = 0.0_wp, best = 0.0_wp
    contains
        procedure :: allocate => allocate_ties, find_massless, weigh_rows, compare, measure, inherit, pack_state
    end type massless_ties_type

contains

    !> Allocate for n coordinates and m constraints.
    subroutine allocate_ties(self, n, m)
        class(massless_ties_type), intent(inout) :: self
        integer, intent(in) :: n, m

        allocate (self%product(m + short, m), self%weighted(m + short, m), self%weight(m), source=0.0_wp)
        self%columns = spread(0, 1, n)
        self%best = 0.0_wp
    end subroutine allocate_ties

    !> Find the coordinates without mass: a zero on the diagonal of M, which has no negative eigenvalue.
    pure subroutine find_massless(self, mass)
        class(massless_ties_type), intent(inout) :: self
        !> M (n, n).
        real(wp), intent(in) :: mass(:, :)
        integer :: i

        self%n = 0
        do i = 1, size(self%columns)
            if (abs(mass(i, i)) > 0.0_wp) cycle
            self%n = self%n + 1
            self%columns(self%n) = i
        end do
        ! If they outnumber the constraints, factoring D' M D reports it.
        if (self%n > size(self%weight)) self%n = 0
    end subroutine find_massless

    !> Weigh the rows, once per run and only if a coordinate has no mass: 1 over their squared lengths in scaled unknowns, so that
    !> their units do not matter.
    pure subroutine weigh_rows(self, jacobian, scale)
        class(massless_ties_type), intent(inout) :: self
        !> C (m, n), and the scales of the unknowns (n).
        real(wp), intent(in) :: jacobian(:, :), scale(:)
        integer :: j

        if (self%n == 0 .or. self%best > 0.0_wp) return
        self%weight = 0.0_wp
        do j = 1, size(scale)
            self%weight = self%weight + (scale(j)*jacobian(:, j))**2
        end do
        self%weight = 1.0_wp/max(self%weight, tiny(1.0_wp))
    end subroutine weigh_rows

    !> True if the columns of C that belong to coordinates without mass have kept their orientation from one point to another:
    !> det(A' W B) of these columns is positive, W the weights of rows. Also finds the smallest pivot of its elimination: if A is
    !> near B, the pivots are near those of A' A, which needs no exchange of rows.
    pure subroutine compare(self, from, to, scale, is_kept)
        class(massless_ties_type), intent(inout) :: self
        !> C at the two points (m, n), and the scales of the unknowns (n).
        real(wp), intent(in) :: from(:, :), to(:, :), scale(:)
        logical, intent(out) :: is_kept
        real(wp) :: sums(short), f
        integer :: i, j, l, s

        self%loosest = 0
        self%weakest = huge(1.0_wp)
        is_kept = .true.
        if (self%n == 0) return
        !GCC$ NOVECTOR
        do i = 1, self%n
            f = scale(self%columns(i))
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do l = 1, size(self%weight)
                self%weighted(i, l) = f*self%weight(l)*from(l, self%columns(i))
            end do
        end do
        do j = 1, self%n
            do s = 0, self%n - 1, short
                do i = 1, short
                    sums(i) = 0.0_wp
                end do
                !GCC$ NOVECTOR
                !GCC$ UNROLL 1
                do l = 1, size(self%weight)
                    f = to(l, self%columns(j))
                    !GCC$ UNROLL 1
                    do i = 1, short
                        sums(i) = sums(i) + self%weighted(s + i, l)*f
                    end do
                end do
                f = scale(self%columns(j))
                !GCC$ UNROLL 1
                do i = 1, short
                    self%product(s + i, j) = f*sums(i)
                end do
            end do
        end do
        do l = 1, self%n
            if (self%product(l, l) < self%weakest) then
                self%weakest = self%product(l, l)
                self%loosest = self%columns(l)
            end if
            if (self%product(l, l) < 0.0_wp) is_kept = .not. is_kept
            if (.not. abs(self%product(l, l)) > 0.0_wp) exit
            do j = l + 1, self%n
                f = self%product(l, j)/self%product(l, l)
                do i = l + 1, self%n
                    self%product(i, j) = self%product(i, j) - self%product(i, l)*f
                end do
            end do
        end do
    end subroutine compare

    !> Number of steps like the last one until the constraints no longer condition a coordinate, if conditioning is weak. At least
    !> one coordinate has no mass.
    pure subroutine measure(self, from, to, scale, horizon, room, loosened, coordinate)
        class(massless_ties_type), intent(inout) :: self
        !> C at the ends of the step, which were compared before, and the scales.
        real(wp), intent(in) :: from(:, :), to(:, :), scale(:)
        !> Limit of the number of steps.
        real(wp), intent(in) :: horizon
        !> The number of steps, replaced by a smaller one, and the remaining part of the conditioning, if small.
        real(wp), intent(inout) :: room, loosened
        !> The coordinate, replaced likewise.
        integer, intent(inout) :: coordinate
        !> Squares below this part of the largest so far are examined further.
        real(wp), parameter :: loose = 1.0e-4_wp
        real(wp) :: before, after
        logical :: is_kept

        if (.not. self%weakest < loose*self%best) then
            self%best = max(self%best, self%weakest)
            return
        end if
        ! Columns that have turned far also have small pivots; use the pivots of A' A.
        call self%compare(from, from, scale, is_kept)
        before = sqrt(max(self%weakest, 0.0_wp))
        call self%compare(to, to, scale, is_kept)
        after = sqrt(max(self%weakest, 0.0_wp))
        loosened = after/sqrt(self%best)
        coordinate = self%loosest
        if (after < horizon*(before - after)) room = min(room, max(after/(before - after), tiny(1.0_wp)))
    end subroutine measure

    !> Copy the state of another chart of the run.
    pure subroutine inherit(self, other)
        class(massless_ties_type), intent(inout) :: self
        type(massless_ties_type), intent(in) :: other

        if (size(other%weight) /= size(self%weight) .or. .not. other%best > 0.0_wp) return
        self%best = other%best
        self%weight = other%weight
    end subroutine inherit

    !> State accumulated during a run.
    subroutine pack_state(self, pack)
        class(massless_ties_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%best)
        call pack%item(self%weight)
    end subroutine pack_state
end module tandem_chart_dense_massless_ties
