! SPDX-License-Identifier: MIT
!> Entries of a symmetric structure by columns: each coordinate with those of its body and of the bodies that share rows or forces
!> with it. M, K and D of a mechanism have this structure.
module tandem_saddle_columns
    use tandem_kinds, only: wp
    use tandem_linalg_order, only: list_type
    use tandem_model_pattern, only: pattern_type
    implicit none (type, external)
    private

    public :: columns_type

    type :: columns_type
        !> Column j has the entries start(j) to start(j + 1) - 1, in these rows.
        integer, allocatable :: start(:), row(:)
    contains
        procedure :: build, multiply, add_diagonal
    end type columns_type

contains

    !> Set the structure.
    subroutine build(self, pattern, neighbours)
        class(columns_type), intent(inout) :: self
        type(pattern_type), intent(in) :: pattern
        !> Of each body.
        type(list_type), intent(in) :: neighbours(:)
        integer :: b, j, k, l, n

        self%start = spread(1, 1, size(pattern%column) + 1)
        do l = 1, 2
            n = 0
            do b = 1, pattern%n_bodies
                do j = pattern%first(b), pattern%first(b + 1) - 1
                    self%start(j) = n + 1
                    call list_rows(b)
                    do k = 1, neighbours(b)%n
                        call list_rows(neighbours(b)%item(k))
                    end do
                end do
            end do
            self%start(size(self%start)) = n + 1
            if (l == 1) self%row = spread(0, 1, n)
        end do

    contains

        subroutine list_rows(body)
            integer, intent(in) :: body
            integer :: coordinate

            do coordinate = pattern%first(body), pattern%first(body + 1) - 1
                n = n + 1
                if (l == 2) self%row(n) = coordinate
            end do
        end subroutine list_rows
    end subroutine build

    !> y = A x, and |A| |x|.
    pure subroutine multiply(self, values, x, y, sizes)
        class(columns_type), intent(in) :: self
        !> Entries of A; x, y and sizes (n).
        real(wp), intent(in) :: values(:), x(:)
        real(wp), intent(out) :: y(:), sizes(:)
        integer :: j, k

        y = 0.0_wp
        sizes = 0.0_wp
        do j = 1, size(x)
            do k = self%start(j), self%start(j + 1) - 1
                y(self%row(k)) = y(self%row(k)) + values(k)*x(j)
                sizes(self%row(k)) = sizes(self%row(k)) + abs(values(k)*x(j))
            end do
        end do
    end subroutine multiply

    !> A := A + diag(d).
    pure subroutine add_diagonal(self, d, values)
        class(columns_type), intent(in) :: self
        real(wp), intent(in) :: d(:)
        real(wp), intent(inout) :: values(:)
        integer :: j, k

        do j = 1, size(d)
            do k = self%start(j), self%start(j + 1) - 1
                if (self%row(k) == j) values(k) = values(k) + d(j)
            end do
        end do
    end subroutine add_diagonal
end module tandem_saddle_columns
