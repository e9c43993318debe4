! SPDX-License-Identifier: MIT
!> Products of small vectors for wheels that roll on the plane.
module tandem_models_wheel_vectors
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: along, crossways, height_row, rotate, sideways

contains

    !> A b.
    pure function rotate(a, b) result(c)
        real(wp), intent(in) :: a(3, 3), b(3)
        real(wp) :: c(3)

        c = a(:, 1)*b(1) + a(:, 2)*b(2) + a(:, 3)*b(3)
    end function rotate

    !> The gradient by p of the height of A a, uz' B(p, a).
    pure function height_row(p, a) result(row)
        real(wp), intent(in) :: p(4), a(3)
        real(wp) :: row(4)

        row(1) = 2*(p(1)*a(3) + p(2)*a(2) - p(3)*a(1))
        row(2) = 2*(p(1)*a(2) - p(2)*a(3) + p(4)*a(1))
        row(3) = 2*(p(4)*a(2) - p(1)*a(1) - p(3)*a(3))
        row(4) = 2*(p(2)*a(1) + p(3)*a(2) + p(4)*a(3))
    end function height_row

    !> b x uz: from the rim's tangent to the direction in which its wheel must not slip.
    pure function sideways(b) result(c)
        real(wp), intent(in) :: b(3)
        real(wp) :: c(3)

        c = [b(2), -b(1), 0.0_wp]
    end function sideways

    !> a' B (4).
    pure function along(a, block) result(row)
        real(wp), intent(in) :: a(3), block(3, 4)
        real(wp) :: row(4)

        row = a(1)*block(1, :) + a(2)*block(2, :) + a(3)*block(3, :)
    end function along

    !> uz x b: dot_product(sideways(a), b) = dot_product(a, crossways(b)).
    pure function crossways(b) result(c)
        real(wp), intent(in) :: b(3)
        real(wp) :: c(3)

        c = [-b(2), b(1), 0.0_wp]
    end function crossways
end module tandem_models_wheel_vectors
