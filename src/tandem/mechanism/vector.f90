! SPDX-License-Identifier: MIT
!> Vectors and frames for the definition of mechanisms.
module tandem_mechanism_vector
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: cross, frame_along, in_space, perpendicular

contains

    !> a x b.
    pure function cross(a, b) result(c)
        real(wp), intent(in) :: a(3), b(3)
        real(wp) :: c(3)

        c(1) = a(2)*b(3) - a(3)*b(2)
        c(2) = a(3)*b(1) - a(1)*b(3)
        c(3) = a(1)*b(2) - a(2)*b(1)
    end function cross

    !> Extend a vector in the plane to three components.
    pure function in_space(v) result(w)
        real(wp), intent(in) :: v(:)
        real(wp) :: w(3)
        integer :: n

        n = min(3, size(v))
        w = 0.0_wp
        w(:n) = v(:n)
    end function in_space

    !> Unit vector perpendicular to a unit vector, from the axis of the world that is farthest from it.
    pure function perpendicular(z) result(x)
        real(wp), intent(in) :: z(3)
        real(wp) :: x(3)

        x = 0.0_wp
        x(minloc(abs(z), dim=1)) = 1.0_wp
        x = x - dot_product(x, z)*z
        x = x/norm2(x)
    end function perpendicular

    !> Right-handed frame [x, y, z] with a given unit vector z, and x as close as possible to `near`.
    pure function frame_along(z, near) result(f)
        real(wp), intent(in) :: z(3)
        real(wp), intent(in), optional :: near(3)
        real(wp) :: f(3, 3)

        f(:, 3) = z
        f(:, 1) = perpendicular(z)
        if (present(near)) then
            f(:, 1) = near - dot_product(near, z)*z
            f(:, 1) = f(:, 1)/norm2(f(:, 1))
        end if
        f(:, 2) = cross(z, f(:, 1))
    end function frame_along
end module tandem_mechanism_vector
