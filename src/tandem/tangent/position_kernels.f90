! SPDX-License-Identifier: MIT
!> The loops of `tandem_tangent_position`. Over the rows of Phi matrices and vectors are padded with zeros to `width`.
module tandem_tangent_position_kernels
    use tandem_kinds, only: wp
    use tandem_linalg_elimination, only: short
    implicit none (type, external)
    private

    public :: correct, invert_gram, measure, place, set_row_weight

contains

    !> q := origin - U u.
    pure subroutine place(n, width, u_basis, u, origin, q)
        integer, intent(in) :: n, width
        real(wp), intent(in) :: u_basis(n, width), u(width), origin(n)
        real(wp), intent(out) :: q(n)
        integer :: i, l

        if (width == 0) then
            q = origin
            return
        end if
        !GCC$ UNROLL 1
        do i = 1, n
            q(i) = origin(i) - ((u_basis(i, 1)*u(1) + u_basis(i, 2)*u(2)) + (u_basis(i, 3)*u(3) + u_basis(i, 4)*u(4)))
        end do
        do l = short, width - short, short
            !GCC$ UNROLL 1
            do i = 1, n
                q(i) = q(i) - ((u_basis(i, l + 1)*u(l + 1) + u_basis(i, l + 2)*u(l + 2)) + &
                    (u_basis(i, l + 3)*u(l + 3) + u_basis(i, l + 4)*u(l + 4)))
            end do
        end do
    end subroutine place

    !> The largest error of the rows and their sum, which is not finite where one of them is not.
    pure subroutine measure(nh, phi, weight, error, total)
        integer, intent(in) :: nh
        real(wp), intent(in) :: phi(nh), weight(nh)
        real(wp), intent(out) :: error, total
        real(wp) :: e
        integer :: i

        error = 0.0_wp
        total = 0.0_wp
        !GCC$ UNROLL 1
        do i = 1, nh
            e = abs(phi(i))*weight(i)
            if (e > error) error = e
            total = total + e
        end do
    end subroutine measure

    !> u := u + B Phi. With `learns`, B first satisfies the secant condition of the last correction, which has changed Phi by -y:
    !> B := B + w z'/(z'y) with w = B Phi and z = y weighted, by which the units of rows do not matter (C. G. Broyden,
    !> Math. Comp. 19 (1965) 577-593, his second method). One vector, and w only grows longer by it.
    pure subroutine correct(width, nh, phi, weight, learns, last_phi, b, u, w, z)
        integer, intent(in) :: width, nh
        real(wp), intent(in) :: phi(nh), weight(width)
        logical, intent(in) :: learns
        !> Phi before the last correction, then this one; B; u; work space.
        real(wp), intent(inout) :: last_phi(width), b(width, width), u(width), w(width), z(width)

        if (width == short) then
            call correct_of(short, nh, phi, weight, learns, last_phi, b, u, w, z)
        else
            call correct_of(width, nh, phi, weight, learns, last_phi, b, u, w, z)
        end if
    end subroutine correct

    !> The same, for a given length.
    pure subroutine correct_of(width, nh, phi, weight, learns, last_phi, b, u, w, z)
        integer, intent(in), value :: width
        integer, intent(in) :: nh
        real(wp), intent(in) :: phi(nh), weight(width)
        logical, intent(in) :: learns
        real(wp), intent(inout) :: last_phi(width), b(width, width), u(width), w(width), z(width)
        real(wp) :: along, f, square, y
        integer :: i, j, s

        do s = 0, width - short, short
            do i = 1, short
                w(s + i) = 0.0_wp
            end do
        end do
        along = 0.0_wp
        square = 0.0_wp
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do j = 1, nh
            f = phi(j)
            y = last_phi(j) - f
            last_phi(j) = f
            z(j) = y*weight(j)**2
            along = along + z(j)*f
            square = square + z(j)*y
            do s = 0, width - short, short
                !GCC$ UNROLL 1
                do i = 1, short
                    w(s + i) = w(s + i) + b(s + i, j)*f
                end do
            end do
        end do
        f = 1.0_wp
        if (learns) then
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do j = 1, nh
                y = z(j)/square
                do s = 0, width - short, short
                    !GCC$ UNROLL 1
                    do i = 1, short
                        b(s + i, j) = b(s + i, j) + w(s + i)*y
                    end do
                end do
            end do
            f = 1.0_wp + along/square
        end if
        do s = 0, width - short, short
            !GCC$ UNROLL 1
            do i = 1, short
                u(s + i) = u(s + i) + w(s + i)*f
            end do
        end do
    end subroutine correct_of

    !> U = S Phi_q', S = diag(s)^2, and (Phi_q U)^-1 by elimination without a search, since that is positive definite. The weights
    !> of the rows of Phi by the way.
    pure subroutine invert_gram(n, nh, height, width, c, q, scale, u, gram, weight, diagonal, can)
        integer, intent(in) :: n, nh, height, width
        !> C (height, n), q, coordinate scales.
        real(wp), intent(in) :: c(height, n), q(n), scale(n)
        !> U, its Gram matrix' inverse, weights of the rows, work space.
        real(wp), intent(inout) :: u(n, width), gram(width, width), weight(width), diagonal(width)
        !> False where the rows of Phi_q are nearly dependent.
        logical, intent(out) :: can

        if (width == short) then
            call invert_gram_of(n, nh, height, short, c, q, scale, u, gram, weight, diagonal, can)
        else
            call invert_gram_of(n, nh, height, width, c, q, scale, u, gram, weight, diagonal, can)
        end if
    end subroutine invert_gram

    !> The same, for a given length.
    pure subroutine invert_gram_of(n, nh, height, width, c, q, scale, u, gram, weight, diagonal, can)
        integer, intent(in) :: n, nh, height
        integer, intent(in), value :: width
        real(wp), intent(in) :: c(height, n), q(n), scale(n)
        real(wp), intent(inout) :: u(n, width), gram(width, width), weight(width), diagonal(width)
        logical, intent(out) :: can
        !> The Gram matrix squares the condition of Phi_q: beyond 1e5 U is made an orthonormal basis.
        real(wp), parameter :: smallest_pivot = 1.0e-10_wp
        real(wp) :: f, inverse, magnitude
        integer :: b, i, j, k

        weight = tiny(1.0_wp)
        gram = 0.0_wp
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do j = 1, n
            magnitude = max(abs(q(j)), scale(j))
            do b = 0, width - short, short
                !GCC$ UNROLL 1
                do i = 1, short
                    weight(b + i) = weight(b + i) + abs(c(b + i, j))*magnitude
                end do
            end do
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do k = 1, nh
                f = c(k, j)*scale(j)**2
                u(j, k) = f
                do b = 0, width - short, short
                    !GCC$ UNROLL 1
                    do i = 1, short
                        gram(b + i, k) = gram(b + i, k) + c(b + i, j)*f
                    end do
                end do
            end do
        end do
        weight = 1.0_wp/weight
        can = .true.
        do k = 1, nh
            diagonal(k) = gram(k, k)
        end do
        !GCC$ NOVECTOR
        !GCC$ UNROLL 1
        do k = 1, nh
            can = can .and. gram(k, k) > smallest_pivot*diagonal(k)
            if (.not. can) return
            inverse = 1.0_wp/gram(k, k)
            do b = 0, width - short, short
                !GCC$ UNROLL 1
                do i = 1, short
                    diagonal(b + i) = merge(0.0_wp, gram(b + i, k), b + i == k)
                    gram(b + i, k) = merge(1.0_wp, 0.0_wp, b + i == k)
                end do
            end do
            !GCC$ NOVECTOR
            !GCC$ UNROLL 1
            do j = 1, nh
                f = gram(k, j)*inverse
                do b = 0, width - short, short
                    !GCC$ UNROLL 1
                    do i = 1, short
                        gram(b + i, j) = gram(b + i, j) - diagonal(b + i)*f
                    end do
                end do
                gram(k, j) = f
            end do
        end do
    end subroutine invert_gram_of

    !> The reciprocals of the natural scales of the rows of Phi.
    pure subroutine set_row_weight(m, n, nh, jacobian, q, scale, weight)
        integer, intent(in) :: m, n, nh
        real(wp), intent(in) :: jacobian(m, n), q(n), scale(n)
        real(wp), intent(inout) :: weight(nh)
        real(wp) :: magnitude
        integer :: i, j

        weight = tiny(1.0_wp)
        do j = 1, n
            magnitude = max(abs(q(j)), scale(j))
            do i = 1, nh
                weight(i) = weight(i) + abs(jacobian(i, j))*magnitude
            end do
        end do
        weight = 1.0_wp/weight
    end subroutine set_row_weight
end module tandem_tangent_position_kernels
