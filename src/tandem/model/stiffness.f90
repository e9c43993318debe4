! SPDX-License-Identifier: MIT
!> Derivatives of the forces by blocks of bodies, for implicit steps of large mechanisms: K = (M qdd + C' lambda - S - Q_A)_q and D
!> = -(S + Q_A)_qd. Block (a, b) is the derivative of the forces on body a with respect to the coordinates of body b. Only a body
!> with itself and pairs of bodies whose forces depend on each other have blocks, so that memory is proportional to their number.
module tandem_model_stiffness
    use tandem_kinds, only: wp
    use tandem_model_lists, only: sort_to_lists
    use tandem_pack, only: pack_type
    implicit none (type, external)
    private

    public :: stiffness_type

    type :: stiffness_type
        !> First coordinate of each body, and the number of coordinates plus one (n_bodies + 1).
        integer, allocatable :: first(:)
        !> Bodies coupled with body a, including itself: partner(start(a):start(a + 1) - 1), in increasing order; offset of each
        !> block in the values, which are stored by columns.
        integer, allocatable :: start(:), partner(:), offset(:)
        !> K and D.
        real(wp), allocatable :: by_q(:), by_qd(:)
    contains
        procedure :: build, clear, block_of, add, multiply, pack_state
    end type stiffness_type

contains

    !> Allocate the blocks.
    pure subroutine build(self, first, pairs)
        class(stiffness_type), intent(inout) :: self
        !> First coordinate of each body and n + 1.
        integer, intent(in) :: first(:)
        !> Pairs of bodies (2, number of pairs) in any order. Repetitions are allowed; pairs with 0, the ground, are ignored.
        integer, intent(in) :: pairs(:, :)
        integer :: b, k, n, n_bodies

        n_bodies = size(first) - 1
        self%first = first
        ! Each body is coupled with itself.
        call sort_to_lists(n_bodies, [(b, b=1, n_bodies), pairs(1, :), pairs(2, :)], &
            [(b, b=1, n_bodies), pairs(2, :), pairs(1, :)], self%start, self%partner)
        self%offset = self%partner
        n = 0
        do b = 1, n_bodies
            do k = self%start(b), self%start(b + 1) - 1
                self%offset(k) = n
                n = n + (first(b + 1) - first(b))*(first(self%partner(k) + 1) - first(self%partner(k)))
            end do
        end do
        if (allocated(self%by_q)) deallocate (self%by_q, self%by_qd)
        allocate (self%by_q(n), self%by_qd(n), source=0.0_wp)
    end subroutine build

    !> Set all blocks to zero.
    pure subroutine clear(self)
        class(stiffness_type), intent(inout) :: self

        self%by_q = 0.0_wp
        self%by_qd = 0.0_wp
    end subroutine clear

    !> Offset of the block of two bodies, -1 if there is none.
    pure integer function block_of(self, one, two) result(offset)
        class(stiffness_type), intent(in) :: self
        !> Body on which the forces act, and body with respect to which they are differentiated.
        integer, intent(in) :: one, two
        integer :: from, middle, to

        from = self%start(one)
        to = self%start(one + 1) - 1
        do while (from < to)
            middle = (from + to)/2
            if (self%partner(middle) < two) then
                from = middle + 1
            else
                to = middle
            end if
        end do
        offset = merge(self%offset(from), -1, self%partner(from) == two)
    end function block_of

    !> Add to the blocks of several bodies. Entries of bodies that are not coupled are omitted, which may cost corrections.
    pure subroutine add(self, bodies, by_q, by_qd)
        class(stiffness_type), intent(inout) :: self
        !> Different bodies, whose coordinates are consecutive in the matrices.
        integer, intent(in) :: bodies(:)
        real(wp), intent(in) :: by_q(:, :), by_qd(:, :)
        integer :: column, i, j, k, offset, one, row, two

        column = 0
        do two = 1, size(bodies)
            associate (nc => self%first(bodies(two) + 1) - self%first(bodies(two)))
                row = 0
                do one = 1, size(bodies)
                    associate (nr => self%first(bodies(one) + 1) - self%first(bodies(one)))
                        offset = self%block_of(bodies(one), bodies(two))
                        if (offset >= 0) then
                            do j = 1, nc
                                do i = 1, nr
                                    k = offset + (j - 1)*nr + i
                                    self%by_q(k) = self%by_q(k) + by_q(row + i, column + j)
                                    self%by_qd(k) = self%by_qd(k) + by_qd(row + i, column + j)
                                end do
                            end do
                        end if
                        row = row + nr
                    end associate
                end do
                column = column + nc
            end associate
        end do
    end subroutine add

    !> y := y + factor K x.
    pure subroutine multiply(self, factor, x, y)
        class(stiffness_type), intent(in) :: self
        real(wp), intent(in) :: factor
        !> Vectors (n).
        real(wp), intent(in), contiguous :: x(:)
        real(wp), intent(inout), contiguous :: y(:)
        integer :: a, b, k

        do a = 1, size(self%first) - 1
            do k = self%start(a), self%start(a + 1) - 1
                b = self%partner(k)
                associate (rows => self%first(a + 1) - self%first(a), columns => self%first(b + 1) - self%first(b), &
                    by_q => self%by_q(self%offset(k) + 1:), mine => y(self%first(a):), its => x(self%first(b):))
                    if (rows == 7 .and. columns == 7) then
                        call add_seven_by_seven(factor, by_q, its, mine)
                    else if (rows == 3 .and. columns == 3) then
                        call add_product(3, 3, factor, by_q, its, mine)
                    else
                        call add_product(rows, columns, factor, by_q, its, mine)
                    end if
                end associate
            end do
        end do
    end subroutine multiply

    !> y := y + factor a x for a (p, s). For the sizes of bodies in space and in the plane the loops have constant length.
    pure subroutine add_product(p, s, factor, a, x, y)
        integer, intent(in), value :: p, s
        real(wp), intent(in) :: factor, a(p, s), x(s)
        real(wp), intent(inout) :: y(p)
        integer :: i, j

        do j = 1, s
            do i = 1, p
                y(i) = y(i) + a(i, j)*(factor*x(j))
            end do
        end do
    end subroutine add_product

    !> `add_product` for bodies in space: four rows at a time, in loops that the compiler must not merge.
    pure subroutine add_seven_by_seven(factor, a, x, y)
        real(wp), intent(in) :: factor, a(7, 7), x(7)
        real(wp), intent(inout) :: y(7)
        real(wp) :: t(4)
        integer :: i

        !GCC$ UNROLL 1
        do i = 1, 4
            y(i) = y(i) + factor*(((a(i, 1)*x(1) + a(i, 2)*x(2)) + (a(i, 3)*x(3) + a(i, 4)*x(4))) + &
                ((a(i, 5)*x(5) + a(i, 6)*x(6)) + a(i, 7)*x(7)))
        end do
        !GCC$ UNROLL 1
        do i = 1, 4
            t(i) = factor*(((a(3 + i, 1)*x(1) + a(3 + i, 2)*x(2)) + (a(3 + i, 3)*x(3) + a(3 + i, 4)*x(4))) + &
                ((a(3 + i, 5)*x(5) + a(3 + i, 6)*x(6)) + a(3 + i, 7)*x(7)))
        end do
        do i = 2, 4
            y(3 + i) = y(3 + i) + t(i)
        end do
    end subroutine add_seven_by_seven

    !> Pack the values.
    subroutine pack_state(self, pack)
        class(stiffness_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%by_q, self%by_qd)
    end subroutine pack_state
end module tandem_model_stiffness
