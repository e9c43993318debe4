! SPDX-License-Identifier: MIT
!> Products of vectors in space that are cheaper written out.
module tandem_rigid_vectors
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: rotate, sideways

contains

    !> A b.
    pure function rotate(a, b) result(c)
        real(wp), intent(in) :: a(3, 3), b(3)
        real(wp) :: c(3)

        c = a(:, 1)*b(1) + a(:, 2)*b(2) + a(:, 3)*b(3)
    end function rotate

    !> b x uz: from a rim's tangent to the direction in which its wheel must not slip.
    pure function sideways(b) result(c)
        real(wp), intent(in) :: b(3)
        real(wp) :: c(3)

        c = [b(2), -b(1), 0.0_wp]
    end function sideways
end module tandem_rigid_vectors
