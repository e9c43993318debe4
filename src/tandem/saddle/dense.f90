! SPDX-License-Identifier: MIT
!> Saddle-point systems by full matrices, with complete orthogonal decompositions of C and of the reduced matrix W'H W, W an
!> orthonormal basis of null(C): rows may depend on each other, and H may be singular on null(C). Solutions are then those of least
!> squares and least norm, in scaled coordinates.
module tandem_saddle_dense
    use tandem_kinds, only: wp
    use tandem_linalg_lu, only: lu_type
    use tandem_linalg_order, only: list_type
    use tandem_linalg_orthogonal, only: orthogonal_type
    use tandem_model_pattern, only: pattern_type
    use tandem_saddle, only: saddle_singular, saddle_type
    implicit none (type, external)
    private

    public :: dense_saddle_type

    !> A saddle-point system with full matrices.
    type, extends(saddle_type) :: dense_saddle_type
        private
        !> H in scaled coordinates (n, n), and rows of C, of unit length there (m, n); 1 over their lengths (m).
        real(wp), allocatable :: h(:, :), rows(:, :), weight(:)
        !> Rows at the bottom that differ from C, and their factors.
        real(wp), allocatable :: below(:, :), weight_below(:)
        !> Decompositions of C, of the rows below, and of W'H V; W = null(C), V = null of the rows below.
        type(orthogonal_type) :: of_c, of_below, reduced
        real(wp), allocatable :: v(:, :), w(:, :)
    contains
        procedure :: analyse, load, load_below, factor, solve, independence, carry
    end type dense_saddle_type

contains

    !> Allocate the matrices.
    subroutine analyse(self, pattern, scale)
        class(dense_saddle_type), intent(inout) :: self
        type(pattern_type), intent(in), target :: pattern
        real(wp), intent(in) :: scale(:)
        type(list_type), allocatable :: neighbours(:)

        call self%attach(pattern, scale, neighbours)
        if (allocated(self%h)) deallocate (self%h, self%rows)
        allocate (self%h(self%n, self%n), self%rows(self%m, self%n), source=0.0_wp)
        self%weight = spread(1.0_wp, 1, self%m)
    end subroutine analyse

    !> Set the matrix.
    subroutine load(self, h, c)
        class(dense_saddle_type), intent(inout) :: self
        real(wp), intent(in) :: h(:), c(:, :)
        real(wp) :: length
        integer :: i, j, k

        if (allocated(self%below)) deallocate (self%below, self%weight_below)
        associate (pattern => self%pattern, s => self%scale)
            do j = 1, self%n
                do k = self%columns%start(j), self%columns%start(j + 1) - 1
                    i = self%columns%row(k)
                    self%h(i, j) = s(i)*h(k)*s(j)
                end do
            end do
            do i = 1, self%m
                do k = pattern%row_start(i), pattern%row_start(i + 1) - 1
                    do j = pattern%first(pattern%row_body(k)), pattern%first(pattern%row_body(k) + 1) - 1
                        self%rows(i, j) = c(i, pattern%column(j))*s(j)
                        if (self%is_out(i)) self%rows(i, j) = 0.0_wp
                    end do
                end do
                length = norm2(self%rows(i, :))
                self%weight(i) = merge(1/length, 1.0_wp, length > 0.0_wp)
                self%rows(i, :) = self%weight(i)*self%rows(i, :)
            end do
        end associate
    end subroutine load

    !> After `load`: other rows in place of C at the bottom, C X = g.
    subroutine load_below(self, below, is_unlike_c, unit)
        class(dense_saddle_type), intent(inout) :: self
        !> Compressed by the pattern (m, width).
        real(wp), intent(in) :: below(:, :)
        !> True for rows that differ from those of C (m). They may vanish and are divided by the length of the row of C and a unit.
        logical, intent(in) :: is_unlike_c(:)
        real(wp), intent(in) :: unit
        integer :: i, j, k

        self%below = self%rows
        self%weight_below = self%weight
        associate (pattern => self%pattern)
            do i = 1, self%m
                if (.not. is_unlike_c(i)) cycle
                self%weight_below(i) = self%weight(i)/unit
                do k = pattern%row_start(i), pattern%row_start(i + 1) - 1
                    do j = pattern%first(pattern%row_body(k)), pattern%first(pattern%row_body(k) + 1) - 1
                        self%below(i, j) = self%weight_below(i)*below(i, pattern%column(j))*self%scale(j)
                    end do
                end do
            end do
        end associate
    end subroutine load_below

    !> Factor the matrix. It may be singular.
    subroutine factor(self, stat)
        class(dense_saddle_type), intent(inout) :: self
        integer, intent(out) :: stat
        real(wp), allocatable :: reduced(:, :)

        stat = 0
        call self%of_c%factor(self%rows)
        call self%of_c%get_null_basis(self%w)
        if (allocated(self%below)) then
            call self%of_below%factor(self%below, 1.0_wp)
            call self%of_below%get_null_basis(self%v)
            reduced = matmul(transpose(self%w), matmul(self%h, self%v))
        else
            reduced = matmul(transpose(self%w), matmul(self%h, self%w))
        end if
        if (.not. sum(abs(reduced)) <= huge(1.0_wp)) stat = saddle_singular
        if (stat /= 0) return
        call self%reduced%factor(reduced, self%size_of_h)
        self%n_free = size(reduced, 2) - self%reduced%rank
    end subroutine factor

    !> Solve for x and the multipliers.
    subroutine solve(self, f, g, x, lambda)
        class(dense_saddle_type), intent(in) :: self
        real(wp), intent(in) :: f(:), g(:)
        real(wp), intent(out) :: x(:), lambda(:)
        real(wp), dimension(self%n) :: force, y
        real(wp) :: rows(self%m)
        real(wp), allocatable :: z(:)

        force = self%scale*f
        if (allocated(self%below)) then
            allocate (z(size(self%v, 2)))
            call self%of_below%solve(self%weight_below*g, y)
        else
            allocate (z(size(self%w, 2)))
            call self%of_c%solve(self%weight*g, y)
        end if
        call self%reduced%solve(matmul(force - matmul(self%h, y), self%w), z)
        if (allocated(self%below)) then
            y = y + matmul(self%v, z)
        else
            y = y + matmul(self%w, z)
        end if
        call self%of_c%solve_transposed(force - matmul(self%h, y), rows)
        x = self%scale*y
        lambda = self%weight*rows
    end subroutine solve

    !> Replace forces (n), which only matter on null(C), by those with the same effect there that are on null(C) of another system:
    !> both lead to the same multiples of a basis of null(C) that is dual to the basis of the other system.
    subroutine carry(self, to, f)
        class(dense_saddle_type), intent(in) :: self
        !> With factors of neighbouring rows.
        class(dense_saddle_type), intent(in) :: to
        real(wp), intent(inout) :: f(:)
        type(lu_type) :: lu
        real(wp) :: z(size(self%w, 2))
        integer :: stat

        z = matmul(self%scale*f, self%w)
        if (size(z) /= size(to%w, 2)) then
            ! Another rank: not comparable.
            f = huge(1.0_wp)**0.25_wp
            return
        end if
        call lu%allocate(size(z))
        call lu%factor(matmul(transpose(self%w), to%w), stat)
        if (stat == 0) call lu%solve(z)
        f = matmul(to%w, z)/self%scale
    end subroutine carry

    !> The smallest pivot of the rows.
    pure real(wp) function independence(self)
        class(dense_saddle_type), intent(in) :: self

        independence = self%of_c%least
    end function independence
end module tandem_saddle_dense
