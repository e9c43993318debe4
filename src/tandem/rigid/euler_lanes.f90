! SPDX-License-Identifier: MIT
!> Calculus of Euler parameters (`tandem_rigid_euler_parameters`) for several bodies at once: each entry of a vector or matrix is a
!> row of `lane` numbers, one per body. As in that module, all formulas hold for arbitrary p.
module tandem_rigid_euler_lanes
    use tandem_kinds, only: lane, wp
    implicit none (type, external)
    private

    public :: set_rotations, set_rotation_rates, turn_each, set_gradients, set_gradient_rows, set_dots, take_four

contains

    !> A(p).
    pure subroutine set_rotations(p, a)
        real(wp), intent(in) :: p(lane, 4)
        real(wp), intent(out) :: a(lane, 3, 3)
        real(wp) :: d
        integer :: l

        !GCC$ UNROLL 1
        do l = 1, lane
            d = p(l, 1)**2 - p(l, 2)**2 - p(l, 3)**2 - p(l, 4)**2
            a(l, 1, 1) = d + 2*p(l, 2)*p(l, 2)
            a(l, 2, 1) = 2*(p(l, 3)*p(l, 2) + p(l, 1)*p(l, 4))
            a(l, 3, 1) = 2*(p(l, 4)*p(l, 2) - p(l, 1)*p(l, 3))
            a(l, 1, 2) = 2*(p(l, 2)*p(l, 3) - p(l, 1)*p(l, 4))
            a(l, 2, 2) = d + 2*p(l, 3)*p(l, 3)
            a(l, 3, 2) = 2*(p(l, 4)*p(l, 3) + p(l, 1)*p(l, 2))
            a(l, 1, 3) = 2*(p(l, 2)*p(l, 4) + p(l, 1)*p(l, 3))
            a(l, 2, 3) = 2*(p(l, 3)*p(l, 4) - p(l, 1)*p(l, 2))
            a(l, 3, 3) = d + 2*p(l, 4)*p(l, 4)
        end do
    end subroutine set_rotations

    !> M(p, x), the derivative of A along x.
    pure subroutine set_rotation_rates(p, x, m)
        real(wp), intent(in) :: p(lane, 4), x(lane, 4)
        real(wp), intent(out) :: m(lane, 3, 3)
        real(wp) :: d
        integer :: l

        !GCC$ UNROLL 1
        do l = 1, lane
            d = 2*(p(l, 1)*x(l, 1) - p(l, 2)*x(l, 2) - p(l, 3)*x(l, 3) - p(l, 4)*x(l, 4))
            m(l, 1, 1) = d + 4*p(l, 2)*x(l, 2)
            m(l, 2, 1) = 2*(p(l, 3)*x(l, 2) + x(l, 3)*p(l, 2) + p(l, 1)*x(l, 4) + x(l, 1)*p(l, 4))
            m(l, 3, 1) = 2*(p(l, 4)*x(l, 2) + x(l, 4)*p(l, 2) - p(l, 1)*x(l, 3) - x(l, 1)*p(l, 3))
            m(l, 1, 2) = 2*(p(l, 2)*x(l, 3) + x(l, 2)*p(l, 3) - p(l, 1)*x(l, 4) - x(l, 1)*p(l, 4))
            m(l, 2, 2) = d + 4*p(l, 3)*x(l, 3)
            m(l, 3, 2) = 2*(p(l, 4)*x(l, 3) + x(l, 4)*p(l, 3) + p(l, 1)*x(l, 2) + x(l, 1)*p(l, 2))
            m(l, 1, 3) = 2*(p(l, 2)*x(l, 4) + x(l, 2)*p(l, 4) + p(l, 1)*x(l, 3) + x(l, 1)*p(l, 3))
            m(l, 2, 3) = 2*(p(l, 3)*x(l, 4) + x(l, 3)*p(l, 4) - p(l, 1)*x(l, 2) - x(l, 1)*p(l, 2))
            m(l, 3, 3) = d + 4*p(l, 4)*x(l, 4)
        end do
    end subroutine set_rotation_rates

    !> v = m a.
    pure subroutine turn_each(m, a, v)
        real(wp), intent(in) :: m(lane, 3, 3), a(lane, 3)
        real(wp), intent(out) :: v(lane, 3)
        integer :: k, l

        !GCC$ UNROLL 3
        do k = 1, 3
            !GCC$ UNROLL 1
            do l = 1, lane
                v(l, k) = m(l, k, 1)*a(l, 1) + m(l, k, 2)*a(l, 2) + m(l, k, 3)*a(l, 3)
            end do
        end do
    end subroutine turn_each

    !> B(p, a) = (A(p) a)_p.
    pure subroutine set_gradients(p, a, b)
        real(wp), intent(in) :: p(lane, 4), a(lane, 3)
        real(wp), intent(out) :: b(lane, 3, 4)
        real(wp) :: s, x, y, z
        integer :: l

        !GCC$ UNROLL 1
        do l = 1, lane
            x = 2*a(l, 1)
            y = 2*a(l, 2)
            z = 2*a(l, 3)
            s = p(l, 2)*x + p(l, 3)*y + p(l, 4)*z
            b(l, 1, 1) = p(l, 1)*x + p(l, 3)*z - p(l, 4)*y
            b(l, 2, 1) = p(l, 1)*y + p(l, 4)*x - p(l, 2)*z
            b(l, 3, 1) = p(l, 1)*z + p(l, 2)*y - p(l, 3)*x
            b(l, 1, 2) = s
            b(l, 2, 2) = p(l, 3)*x - p(l, 2)*y - p(l, 1)*z
            b(l, 3, 2) = p(l, 4)*x - p(l, 2)*z + p(l, 1)*y
            b(l, 1, 3) = p(l, 2)*y - p(l, 3)*x + p(l, 1)*z
            b(l, 2, 3) = s
            b(l, 3, 3) = p(l, 4)*y - p(l, 3)*z - p(l, 1)*x
            b(l, 1, 4) = p(l, 2)*z - p(l, 4)*x - p(l, 1)*y
            b(l, 2, 4) = p(l, 3)*z - p(l, 4)*y + p(l, 1)*x
            b(l, 3, 4) = s
        end do
    end subroutine set_gradients

    !> n'B(p, a), without forming the matrix.
    pure subroutine set_gradient_rows(p, a, n, row)
        real(wp), intent(in) :: p(lane, 4), a(lane, 3), n(lane, 3)
        real(wp), intent(out) :: row(lane, 4)
        real(wp) :: along, cross_1, cross_2, cross_3, ea, en, x, y, z
        integer :: l

        !GCC$ UNROLL 1
        do l = 1, lane
            x = 2*n(l, 1)
            y = 2*n(l, 2)
            z = 2*n(l, 3)
            along = x*a(l, 1) + y*a(l, 2) + z*a(l, 3)
            cross_1 = a(l, 2)*z - a(l, 3)*y
            cross_2 = a(l, 3)*x - a(l, 1)*z
            cross_3 = a(l, 1)*y - a(l, 2)*x
            ea = p(l, 2)*a(l, 1) + p(l, 3)*a(l, 2) + p(l, 4)*a(l, 3)
            en = p(l, 2)*x + p(l, 3)*y + p(l, 4)*z
            row(l, 1) = p(l, 1)*along + p(l, 2)*cross_1 + p(l, 3)*cross_2 + p(l, 4)*cross_3
            row(l, 2) = p(l, 1)*cross_1 - p(l, 2)*along + x*ea + a(l, 1)*en
            row(l, 3) = p(l, 1)*cross_2 - p(l, 3)*along + y*ea + a(l, 2)*en
            row(l, 4) = p(l, 1)*cross_3 - p(l, 4)*along + z*ea + a(l, 3)*en
        end do
    end subroutine set_gradient_rows

    !> x.y.
    pure subroutine set_dots(x, y, dots)
        real(wp), intent(in) :: x(lane, 3), y(lane, 3)
        real(wp), intent(out) :: dots(lane)
        integer :: l

        !GCC$ UNROLL 1
        do l = 1, lane
            dots(l) = x(l, 1)*y(l, 1) + x(l, 2)*y(l, 2) + x(l, 3)*y(l, 3)
        end do
    end subroutine set_dots

    !> Copy four consecutive numbers of each body.
    pure subroutine take_four(before, offset, n, q, x)
        !> For each body, number of entries of q before its own; number of its entries to skip.
        integer, intent(in) :: before(lane), offset, n
        real(wp), intent(in) :: q(n)
        real(wp), intent(out) :: x(lane, 4)
        integer :: k, l

        ! This form is compiled to loads of four numbers and a transposition in registers.
        !GCC$ UNROLL 1
        do k = 1, 4
            !GCC$ UNROLL 8
            do l = 1, lane
                x(l, k) = q(before(l) + offset + k)
            end do
        end do
    end subroutine take_four
end module tandem_rigid_euler_lanes
