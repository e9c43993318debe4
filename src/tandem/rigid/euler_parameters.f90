! SPDX-License-Identifier: MIT
!> Euler parameters p = (e0, e) and the matrices of their calculus. All formulas hold for arbitrary p, not only for unit ones.
!> Source: Haug, Computer-Aided Kinematics and Dynamics of Mechanical Systems, 1989; Serban and Haug, 1998,
!> doi 10.1080/08905459808945425; section 19 of doc/theory.md.
module tandem_rigid_euler_parameters
    use tandem_kinds, only: wp
    implicit none (type, external)
    private

    public :: rotation, e_matrix, g_matrix, b_matrix, skew
    public :: c_matrix, k_matrix, t_matrix, rotation_rate, g_sandwich, set_rotation, set_rotation_rate
    public :: b_row, g_product, g_transposed_product, b_product, set_rotational_mass
    public :: e_product, e_transposed_product, e_transposed_gradient

contains

    !> A(p) = E G' = (e0^2 - e'e) I + 2 e e' + 2 e0 ~e, from the body frame to the world frame (3, 3).
    pure function rotation(p) result(a)
        real(wp), intent(in) :: p(4)
        real(wp) :: a(3, 3)

        call set_rotation(p, a)
    end function rotation

    !> A(p) (3, 3), in place.
    pure subroutine set_rotation(p, a)
        real(wp), intent(in) :: p(4)
        real(wp), intent(out) :: a(3, 3)
        real(wp) :: d

        d = p(1)**2 - p(2)**2 - p(3)**2 - p(4)**2
        a(1, 1) = d + 2*p(2)*p(2)
        a(2, 1) = 2*(p(3)*p(2) + p(1)*p(4))
        a(3, 1) = 2*(p(4)*p(2) - p(1)*p(3))
        a(1, 2) = 2*(p(2)*p(3) - p(1)*p(4))
        a(2, 2) = d + 2*p(3)*p(3)
        a(3, 2) = 2*(p(4)*p(3) + p(1)*p(2))
        a(1, 3) = 2*(p(2)*p(4) + p(1)*p(3))
        a(2, 3) = 2*(p(3)*p(4) - p(1)*p(2))
        a(3, 3) = d + 2*p(4)*p(4)
    end subroutine set_rotation

    !> E(p) = [-e, e0 I + ~e] (3, 4).
    pure function e_matrix(p) result(e)
        real(wp), intent(in) :: p(4)
        real(wp) :: e(3, 4)

        e(:, 1) = -p(2:4)
        e(:, 2) = [p(1), p(4), -p(3)]
        e(:, 3) = [-p(4), p(1), p(2)]
        e(:, 4) = [p(3), -p(2), p(1)]
    end function e_matrix

    !> G(p) = [-e, e0 I - ~e] (3, 4); the angular velocity in the body frame is 2 G pd.
    pure function g_matrix(p) result(g)
        real(wp), intent(in) :: p(4)
        real(wp) :: g(3, 4)

        g(:, 1) = -p(2:4)
        g(:, 2) = [p(1), -p(4), p(3)]
        g(:, 3) = [p(4), p(1), -p(2)]
        g(:, 4) = [-p(3), p(2), p(1)]
    end function g_matrix

    !> B(p, a) = (A(p) a)_p = 2 [(e0 I + ~e) a, e a' - (e0 I + ~e) ~a] (3, 4). B is linear in p and in a, and
    !> B(p, a) x = B(x, a) p.
    pure function b_matrix(p, a) result(b)
        real(wp), intent(in) :: p(4), a(3)
        real(wp) :: b(3, 4), d(3), s

        ! d = (e0 I + ~e) a; s = e'a. The last three columns are 2 (e a' - e0 ~a - ~e ~a), ~e ~a = a e' - (e'a) I.
        d(1) = p(1)*a(1) + p(3)*a(3) - p(4)*a(2)
        d(2) = p(1)*a(2) + p(4)*a(1) - p(2)*a(3)
        d(3) = p(1)*a(3) + p(2)*a(2) - p(3)*a(1)
        s = p(2)*a(1) + p(3)*a(2) + p(4)*a(3)
        b(:, 1) = 2*d
        b(1, 2) = 2*s
        b(2, 2) = 2*(p(3)*a(1) - a(2)*p(2) - p(1)*a(3))
        b(3, 2) = 2*(p(4)*a(1) - a(3)*p(2) + p(1)*a(2))
        b(1, 3) = 2*(p(2)*a(2) - a(1)*p(3) + p(1)*a(3))
        b(2, 3) = 2*s
        b(3, 3) = 2*(p(4)*a(2) - a(3)*p(3) - p(1)*a(1))
        b(1, 4) = 2*(p(2)*a(3) - a(1)*p(4) - p(1)*a(2))
        b(2, 4) = 2*(p(3)*a(3) - a(2)*p(4) + p(1)*a(1))
        b(3, 4) = 2*s
    end function b_matrix

    !> C(p, a) = (A(p)'a)_p = 2 [(e0 I - ~e) a, e a' + (e0 I - ~e) ~a] (3, 4): B for the conjugate parameters.
    pure function c_matrix(p, a) result(c)
        real(wp), intent(in) :: p(4), a(3)
        real(wp) :: c(3, 4)

        ! A(e0, e)' = A(e0, -e).
        c = b_matrix([p(1), -p(2), -p(3), -p(4)], a)
        c(:, 2:4) = -c(:, 2:4)
    end function c_matrix

    !> K(a, b) = (B(p, a)' b)_p = 2 [a'b, a' ~b; ~a b, a b' + b a' - (a'b) I] (4, 4), symmetric and independent of p.
    pure function k_matrix(a, b) result(k)
        real(wp), intent(in) :: a(3), b(3)
        real(wp) :: k(4, 4), ab, cross(3)
        integer :: i, j

        ab = a(1)*b(1) + a(2)*b(2) + a(3)*b(3)
        cross = [a(2)*b(3) - a(3)*b(2), a(3)*b(1) - a(1)*b(3), a(1)*b(2) - a(2)*b(1)]
        k(1, 1) = 2*ab
        k(2:4, 1) = 2*cross
        k(1, 2:4) = 2*cross
        do j = 1, 3
            do i = 1, 3
                k(i + 1, j + 1) = 2*(a(i)*b(j) + b(i)*a(j))
            end do
            k(j + 1, j + 1) = k(j + 1, j + 1) - 2*ab
        end do
    end function k_matrix

    !> T(a) = (G(p)' a)_p = [0, -a'; a, -~a] (4, 4).
    pure function t_matrix(a) result(t)
        real(wp), intent(in) :: a(3)
        real(wp) :: t(4, 4)

        t(:, 1) = [0.0_wp, a(1), a(2), a(3)]
        t(:, 2) = [-a(1), 0.0_wp, -a(3), a(2)]
        t(:, 3) = [-a(2), a(3), 0.0_wp, -a(1)]
        t(:, 4) = [-a(3), -a(2), a(1), 0.0_wp]
    end function t_matrix

    !> M(p, x) = E(x) G(p)' + E(p) G(x)' (3, 3), the derivative of A along x: M(p, x) a = B(p, a) x.
    pure function rotation_rate(p, x) result(m)
        real(wp), intent(in) :: p(4), x(4)
        real(wp) :: m(3, 3)

        call set_rotation_rate(p, x, m)
    end function rotation_rate

    !> M(p, x) (3, 3), in place.
    pure subroutine set_rotation_rate(p, x, m)
        real(wp), intent(in) :: p(4), x(4)
        real(wp), intent(out) :: m(3, 3)
        real(wp) :: d

        ! Twice the bilinear form of A in p and x.
        d = p(1)*x(1) - p(2)*x(2) - p(3)*x(3) - p(4)*x(4)
        m(1, 1) = 2*(d + 2*p(2)*x(2))
        m(2, 1) = 2*(p(3)*x(2) + x(3)*p(2) + p(1)*x(4) + x(1)*p(4))
        m(3, 1) = 2*(p(4)*x(2) + x(4)*p(2) - p(1)*x(3) - x(1)*p(3))
        m(1, 2) = 2*(p(2)*x(3) + x(2)*p(3) - p(1)*x(4) - x(1)*p(4))
        m(2, 2) = 2*(d + 2*p(3)*x(3))
        m(3, 2) = 2*(p(4)*x(3) + x(4)*p(3) + p(1)*x(2) + x(1)*p(2))
        m(1, 3) = 2*(p(2)*x(4) + x(2)*p(4) + p(1)*x(3) + x(1)*p(3))
        m(2, 3) = 2*(p(3)*x(4) + x(3)*p(4) - p(1)*x(2) - x(1)*p(2))
        m(3, 3) = 2*(d + 2*p(4)*x(4))
    end subroutine set_rotation_rate

    !> n'B(p, a) = K(a, n) p (4), the gradient of n'A(p) a, without forming the matrix.
    pure function b_row(p, a, n) result(row)
        real(wp), intent(in) :: p(4), a(3), n(3)
        real(wp) :: row(4), along, cross(3), ea, en

        along = n(1)*a(1) + n(2)*a(2) + n(3)*a(3)
        cross = [a(2)*n(3) - a(3)*n(2), a(3)*n(1) - a(1)*n(3), a(1)*n(2) - a(2)*n(1)]
        ea = p(2)*a(1) + p(3)*a(2) + p(4)*a(3)
        en = p(2)*n(1) + p(3)*n(2) + p(4)*n(3)
        row(1) = 2*(p(1)*along + p(2)*cross(1) + p(3)*cross(2) + p(4)*cross(3))
        row(2) = 2*(p(1)*cross(1) - p(2)*along + n(1)*ea + a(1)*en)
        row(3) = 2*(p(1)*cross(2) - p(3)*along + n(2)*ea + a(2)*en)
        row(4) = 2*(p(1)*cross(3) - p(4)*along + n(3)*ea + a(3)*en)
    end function b_row

    !> G(p) x (3), without forming the matrix.
    pure function g_product(p, x) result(y)
        real(wp), intent(in) :: p(4), x(4)
        real(wp) :: y(3)

        y(1) = -p(2)*x(1) + p(1)*x(2) + p(4)*x(3) - p(3)*x(4)
        y(2) = -p(3)*x(1) - p(4)*x(2) + p(1)*x(3) + p(2)*x(4)
        y(3) = -p(4)*x(1) + p(3)*x(2) - p(2)*x(3) + p(1)*x(4)
    end function g_product

    !> G(p)'a (4), without forming the matrix.
    pure function g_transposed_product(p, a) result(y)
        real(wp), intent(in) :: p(4), a(3)
        real(wp) :: y(4)

        y(1) = -p(2)*a(1) - p(3)*a(2) - p(4)*a(3)
        y(2) = p(1)*a(1) - p(4)*a(2) + p(3)*a(3)
        y(3) = p(4)*a(1) + p(1)*a(2) - p(2)*a(3)
        y(4) = -p(3)*a(1) + p(2)*a(2) + p(1)*a(3)
    end function g_transposed_product

    !> E(p) x (3), without forming the matrix; the angular velocity in the world frame is 2 E pd.
    pure function e_product(p, x) result(y)
        real(wp), intent(in) :: p(4), x(4)
        real(wp) :: y(3)

        y(1) = -p(2)*x(1) + p(1)*x(2) - p(4)*x(3) + p(3)*x(4)
        y(2) = -p(3)*x(1) + p(4)*x(2) + p(1)*x(3) - p(2)*x(4)
        y(3) = -p(4)*x(1) - p(3)*x(2) + p(2)*x(3) + p(1)*x(4)
    end function e_product

    !> E(p)'a (4), without forming the matrix.
    pure function e_transposed_product(p, a) result(y)
        real(wp), intent(in) :: p(4), a(3)
        real(wp) :: y(4)

        y(1) = -p(2)*a(1) - p(3)*a(2) - p(4)*a(3)
        y(2) = p(1)*a(1) + p(4)*a(2) - p(3)*a(3)
        y(3) = -p(4)*a(1) + p(1)*a(2) + p(2)*a(3)
        y(4) = p(3)*a(1) - p(2)*a(2) + p(1)*a(3)
    end function e_transposed_product

    !> (E(p)' a)_p = [0, -a'; a, ~a] (4, 4).
    pure function e_transposed_gradient(a) result(t)
        real(wp), intent(in) :: a(3)
        real(wp) :: t(4, 4)

        t(:, 1) = [0.0_wp, a(1), a(2), a(3)]
        t(:, 2) = [-a(1), 0.0_wp, a(3), -a(2)]
        t(:, 3) = [-a(2), -a(3), 0.0_wp, a(1)]
        t(:, 4) = [-a(3), a(2), -a(1), 0.0_wp]
    end function e_transposed_gradient

    !> G(p)' diag(j) G(x) (4, 4).
    pure function g_sandwich(p, j, x) result(s)
        real(wp), intent(in) :: p(4), j(3), x(4)
        real(wp) :: s(4, 4), gp(3, 4), gx(3, 4)
        integer :: k, l

        gp = g_matrix(p)
        gx = g_matrix(x)
        do l = 1, 4
            do k = 1, 4
                s(k, l) = gp(1, k)*j(1)*gx(1, l) + gp(2, k)*j(2)*gx(2, l) + gp(3, k)*j(3)*gx(3, l)
            end do
        end do
    end function g_sandwich

    !> 4 G(p)' diag(j) G(p), the mass matrix of a rotating body (4, 4), stored with leading dimension n.
    pure subroutine set_rotational_mass(p, j, n, mass)
        real(wp), intent(in) :: p(4)
        !> Principal moments of inertia.
        real(wp), intent(in) :: j(3)
        !> Leading dimension of the matrix that contains the block. To set a block of M, pass its first entry as `mass`.
        integer, intent(in) :: n
        real(wp), intent(inout) :: mass(3*n + 4)
        real(wp) :: e0, e1, e2, e3, x, y, z

        e0 = p(1)
        e1 = p(2)
        e2 = p(3)
        e3 = p(4)
        ! The columns of G are (-e1, -e2, -e3), (e0, -e3, e2), (e3, e0, -e1), (-e2, e1, e0).
        x = 4*j(1)
        y = 4*j(2)
        z = 4*j(3)
        mass(1) = x*e1*e1 + y*e2*e2 + z*e3*e3
        mass(2) = y*e2*e3 - x*e0*e1 - z*e2*e3
        mass(3) = z*e1*e3 - x*e1*e3 - y*e0*e2
        mass(4) = x*e1*e2 - y*e1*e2 - z*e0*e3
        mass(n + 2) = x*e0*e0 + y*e3*e3 + z*e2*e2
        mass(n + 3) = x*e0*e3 - y*e0*e3 - z*e1*e2
        mass(n + 4) = z*e0*e2 - x*e0*e2 - y*e1*e3
        mass(2*n + 3) = x*e3*e3 + y*e0*e0 + z*e1*e1
        mass(2*n + 4) = y*e0*e1 - x*e2*e3 - z*e0*e1
        mass(3*n + 4) = x*e2*e2 + y*e1*e1 + z*e0*e0
        mass(n + 1) = mass(2)
        mass(2*n + 1) = mass(3)
        mass(2*n + 2) = mass(n + 3)
        mass(3*n + 1) = mass(4)
        mass(3*n + 2) = mass(n + 4)
        mass(3*n + 3) = mass(2*n + 4)
    end subroutine set_rotational_mass

    !> B(p, a) x (3), without forming the matrix: twice the bilinear form of A(p) a in p and x.
    pure function b_product(p, a, x) result(y)
        real(wp), intent(in) :: p(4), a(3), x(4)
        real(wp) :: y(3), d, pa, xa

        ! A(p) a = (e0^2 - e'e) a + 2 e (e'a) + 2 e0 e x a, as a bilinear form in p and x.
        d = p(1)*x(1) - p(2)*x(2) - p(3)*x(3) - p(4)*x(4)
        pa = p(2)*a(1) + p(3)*a(2) + p(4)*a(3)
        xa = x(2)*a(1) + x(3)*a(2) + x(4)*a(3)
        y(1) = d*a(1) + p(2)*xa + x(2)*pa + p(1)*(x(3)*a(3) - x(4)*a(2)) + x(1)*(p(3)*a(3) - p(4)*a(2))
        y(2) = d*a(2) + p(3)*xa + x(3)*pa + p(1)*(x(4)*a(1) - x(2)*a(3)) + x(1)*(p(4)*a(1) - p(2)*a(3))
        y(3) = d*a(3) + p(4)*xa + x(4)*pa + p(1)*(x(2)*a(2) - x(3)*a(1)) + x(1)*(p(2)*a(2) - p(3)*a(1))
        y = 2*y
    end function b_product

    !> ~a, the matrix of the cross product: ~a b = a x b (3, 3).
    pure function skew(a) result(s)
        real(wp), intent(in) :: a(3)
        real(wp) :: s(3, 3)

        s(:, 1) = [0.0_wp, a(3), -a(2)]
        s(:, 2) = [-a(3), 0.0_wp, a(1)]
        s(:, 3) = [a(2), -a(1), 0.0_wp]
    end function skew
end module tandem_rigid_euler_parameters
