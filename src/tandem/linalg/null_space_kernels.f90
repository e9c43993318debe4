! SPDX-License-Identifier: MIT
!> Loops of `tandem_chart_dense_free_motion`. Matrices over the rows of C have `height` rows, those over the degrees of freedom
!> `width` rows: m and k padded with zeros. The latter are stored transposed, so that their few rows form the innermost loops.
!> Procedures take both lengths by value, and the frequent ones pass them as constants if they are `lane` and `short`: innermost
!> loops then become single instructions. The directives keep gfortran from unrolling these loops before it has vectorised them, and
!> from vectorising the outer loops instead. Sums over columns stay in registers if the loop over the columns contains two innermost
!> loops; around a single one gfortran takes two columns in one pass, in halves of registers.
module tandem_linalg_null_space_kernels
    use tandem_kinds, only: lane, short, wp
    implicit none (type, external)
    private

    public :: add_pivots, finish, multiply, multiply_by_transpose, multiply_mass, scale_columns, transpose_basis

contains

    !> D' from the elimination: -Y in the columns of pivots; the unit matrix in the free ones if they are new.
    pure subroutine transpose_basis(m, n, height, width, order, are_new, a, basis)
        !> Constraints, coordinates, padded lengths; order of the columns.
        integer, intent(in) :: m, n, height, width, order(n)
        logical, intent(in) :: are_new
        !> C eliminated, [Cd^-1, Y], and D'.
        real(wp), intent(in) :: a(height, n)
        real(wp), intent(inout) :: basis(width, n)
        !> Columns of D' are written whole from these, because a load of data stored in parts would wait for the store.
        real(wp), parameter :: unit(short, 3) = reshape([1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, &
            0.0_wp, 1.0_wp, 0.0_wp], [short, 3])
        real(wp) :: f1, f2, f3
        integer :: i, k, p, r

        k = n - m
        if (k >= 1 .and. k <= 3) then
            do r = 1, m
                p = order(r)
                f1 = a(r, m + 1)
                f2 = 0.0_wp
                f3 = 0.0_wp
                if (k > 1) f2 = a(r, m + 2)
                if (k > 2) f3 = a(r, n)
                !GCC$ UNROLL 1
                do i = 1, short
                    basis(i, p) = (-f1*unit(i, 1) - f2*unit(i, 2)) - f3*unit(i, 3)
                end do
            end do
        else
            do r = 1, m
                p = order(r)
                do i = 1, k
                    basis(i, p) = -a(r, m + i)
                end do
            end do
        end if
        if (.not. are_new) return
        do i = 1, k
            basis(:, order(m + i)) = 0.0_wp
            basis(i, order(m + i)) = 1.0_wp
        end do
    end subroutine transpose_basis

    !> y := sign r + D z, r given by its rows of pivots, Cd^-1 times a right side.
    pure subroutine finish(sign, m, n, height, order, a, z, r, y)
        real(wp), intent(in) :: sign
        integer, intent(in) :: m, n, height, order(n)
        !> C eliminated.
        real(wp), intent(in) :: a(height, n), z(n - m)
        !> On return the rows of pivots of y.
        real(wp), intent(inout) :: r(height), y(n)
        real(wp) :: x(lane), f
        integer :: b, i, j

        do b = 0, height - lane, lane
            !GCC$ UNROLL 1
            do i = 1, lane
                x(i) = sign*r(b + i)
            end do
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do j = 1, n - m
                f = z(j)
                !GCC$ UNROLL 1
                do i = 1, lane
                    x(i) = x(i) - a(b + i, m + j)*f
                end do
            end do
            !GCC$ UNROLL 1
            do i = 1, lane
                r(b + i) = x(i)
            end do
        end do
        do j = 1, n - m
            y(order(m + j)) = z(j)
        end do
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do i = 1, m
            y(order(i)) = r(i)
        end do
    end subroutine finish

    !> y := A x, A (height, l), x (l): columns in two chains, so that an addition need not wait for the previous one.
    pure subroutine multiply(height, l, a, x, y)
        integer, intent(in) :: height, l
        real(wp), intent(in) :: a(height, l), x(l)
        real(wp), intent(inout) :: y(height)

        real(wp) :: even(lane), odd(lane), f, g
        integer :: b, i, j, p

        do b = 0, height - lane, lane
            f = x(1)
            !GCC$ UNROLL 1
            do i = 1, lane
                odd(i) = a(b + i, 1)*f
                even(i) = 0.0_wp
            end do
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do p = 1, (l - 1)/2
                j = 2*p
                f = x(j)
                g = x(j + 1)
                !GCC$ UNROLL 1
                do i = 1, lane
                    even(i) = even(i) + a(b + i, j)*f
                end do
                !GCC$ UNROLL 1
                do i = 1, lane
                    odd(i) = odd(i) + a(b + i, j + 1)*g
                end do
            end do
            if (iand(l, 1) == 0) then
                f = x(l)
                !GCC$ UNROLL 1
                do i = 1, lane
                    even(i) = even(i) + a(b + i, l)*f
                end do
            end if
            !GCC$ UNROLL 1
            do i = 1, lane
                y(b + i) = odd(i) + even(i)
            end do
        end do
    end subroutine multiply

    !> z := z + B r, B (width, n), r given by its rows of pivots.
    pure subroutine add_pivots(m, n, width, order, b, r, z)
        integer, intent(in) :: m, n, order(n)
        integer, intent(in), value :: width
        real(wp), intent(in) :: b(width, n), r(m)
        real(wp), intent(inout) :: z(width)
        real(wp) :: f
        integer :: i, l, p, s

        do s = 0, width - short, short
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do l = 1, m
                p = order(l)
                f = r(l)
                !GCC$ UNROLL 1
                do i = 1, short
                    z(s + i) = z(s + i) + b(s + i, p)*f
                end do
            end do
        end do
    end subroutine add_pivots

    !> Y := A B' and z := C x; A, B, C (width, n), x (n). Tiles of four rows and columns of Y in separate arrays, which stay in
    !> registers for any width.
    pure subroutine multiply_by_transpose(width, n, a, b, c, x, y, z)
        integer, intent(in) :: width, n
        real(wp), intent(in) :: a(width, n), b(width, n), c(width, n), x(n)
        real(wp), intent(inout) :: y(width, width), z(width)
        real(wp) :: y1(short), y2(short), y3(short), y4(short), sums(short), b1, b2, b3, b4, f
        integer :: i, j, s, t

        do s = 0, width - short, short
            do t = 0, width - short, short
                b1 = b(t + 1, 1)
                b2 = b(t + 2, 1)
                b3 = b(t + 3, 1)
                b4 = b(t + 4, 1)
                f = x(1)
                !GCC$ UNROLL 1
                do i = 1, short
                    y1(i) = a(s + i, 1)*b1
                    y2(i) = a(s + i, 1)*b2
                    y3(i) = a(s + i, 1)*b3
                    y4(i) = a(s + i, 1)*b4
                    sums(i) = c(s + i, 1)*f
                end do
                !GCC$ NOVECTOR
                !GCC$ UNROLL 1
                do j = 2, n
                    b1 = b(t + 1, j)
                    b2 = b(t + 2, j)
                    b3 = b(t + 3, j)
                    b4 = b(t + 4, j)
                    f = x(j)
                    !GCC$ UNROLL 1
                    do i = 1, short
                        y1(i) = y1(i) + a(s + i, j)*b1
                        y2(i) = y2(i) + a(s + i, j)*b2
                        y3(i) = y3(i) + a(s + i, j)*b3
                        y4(i) = y4(i) + a(s + i, j)*b4
                    end do
                    !GCC$ UNROLL 1
                    do i = 1, short
                        sums(i) = sums(i) + c(s + i, j)*f
                    end do
                end do
                !GCC$ UNROLL 1
                do i = 1, short
                    y(s + i, t + 1) = y1(i)
                end do
                !GCC$ UNROLL 1
                do i = 1, short
                    y(s + i, t + 2) = y2(i)
                end do
                !GCC$ UNROLL 1
                do i = 1, short
                    y(s + i, t + 3) = y3(i)
                end do
                !GCC$ UNROLL 1
                do i = 1, short
                    y(s + i, t + 4) = y4(i)
                end do
                !GCC$ UNROLL 1
                do i = 1, short
                    z(s + i) = sums(i)
                end do
            end do
        end do
    end subroutine multiply_by_transpose

    !> B := A diag(f).
    pure subroutine scale_columns(n, width, a, f, b)
        integer, intent(in) :: n, width
        real(wp), intent(in) :: a(width, n), f(n)
        real(wp), intent(inout) :: b(width, n)
        integer :: i, j, s

        do s = 0, width - short, short
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do j = 1, n
                !GCC$ UNROLL 1
                do i = 1, short
                    b(s + i, j) = a(s + i, j)*f(j)
                end do
            end do
        end do
    end subroutine scale_columns

    !> D' M.
    pure subroutine multiply_mass(n, width, n_blocks, blocks, basis, mass, basis_mass)
        integer, intent(in) :: n, width
        !> The diagonal blocks of M with more than one entry, see `tandem_model_evaluator`.
        integer, intent(in) :: n_blocks, blocks(2, n_blocks)
        !> D', M, D' M.
        real(wp), intent(in) :: basis(width, n), mass(n, n)
        real(wp), intent(inout) :: basis_mass(width, n)

        if (width == short) then
            call multiply_mass_of(short, n, n_blocks, blocks, basis, mass, basis_mass)
        else
            call multiply_mass_of(width, n, n_blocks, blocks, basis, mass, basis_mass)
        end if
    end subroutine multiply_mass

    !> D' M for a given length.
    pure subroutine multiply_mass_of(width, n, n_blocks, blocks, basis, mass, basis_mass)
        integer, intent(in), value :: width
        integer, intent(in) :: n, n_blocks, blocks(2, n_blocks)
        real(wp), intent(in) :: basis(width, n), mass(n*n)
        real(wp), intent(inout) :: basis_mass(width, n)
        real(wp) :: f
        integer :: b, first, i, j, l, p, s

        ! Without degrees of freedom there is no first row.
        if (width == 0) return
        ! Treat M as diagonal in all columns first, unless it is one block.
        l = n
        if (n_blocks == 1) l = n - 1 - blocks(2, 1) + blocks(1, 1)
        do s = 0, merge(width, 0, l > 0) - short, short
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do j = 1, n
                f = mass((n + 1)*(j - 1) + 1)
                !GCC$ UNROLL 1
                do i = 1, short
                    basis_mass(s + i, j) = basis(s + i, j)*f
                end do
            end do
        end do
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do b = 1, n_blocks
            ! Two columns at a time; the last ones may overlap the previous ones.
            first = blocks(1, b)
            l = blocks(2, b) - first + 1
            j = first
            do
                p = n*(j - 1) + first
                call multiply_two(width, l, basis(1, first), mass(p), mass(p + n), basis_mass(1, j), basis_mass(1, j + 1))
                if (j + 1 == blocks(2, b)) exit
                j = min(j + 2, blocks(2, b) - 1)
            end do
        end do
    end subroutine multiply_mass_of

    !> Two columns of A M, A (width, l).
    pure subroutine multiply_two(width, l, a, m1, m2, y1, y2)
        integer, intent(in), value :: width
        integer, intent(in) :: l
        real(wp), intent(in) :: a(width, l), m1(l), m2(l)
        real(wp), intent(inout) :: y1(width), y2(width)
        real(wp) :: f1, f2
        integer :: i, j, s

        do s = 0, width - short, short
            f1 = m1(1)
            f2 = m2(1)
            !GCC$ UNROLL 1
            do i = 1, short
                y1(s + i) = a(s + i, 1)*f1
                y2(s + i) = a(s + i, 1)*f2
            end do
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do j = 2, l
                f1 = m1(j)
                f2 = m2(j)
                !GCC$ UNROLL 1
                do i = 1, short
                    y1(s + i) = y1(s + i) + a(s + i, j)*f1
                end do
                !GCC$ UNROLL 1
                do i = 1, short
                    y2(s + i) = y2(s + i) + a(s + i, j)*f2
                end do
            end do
        end do
    end subroutine multiply_two
end module tandem_linalg_null_space_kernels
