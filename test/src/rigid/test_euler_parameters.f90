! SPDX-License-Identifier: MIT
!> Tests of the Euler parameter identities, at parameters that are not of unit length.
module test_euler_parameters
    use asserts, only: check_below
    use differences, only: random_vector
    use tandem, only: wp
    use tandem_rigid_euler_parameters, only: b_matrix, e_matrix, g_matrix, rotation, skew
    use testdrive, only: check, error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_euler_parameters

    !> Number of random points per identity.
    integer, parameter :: n_points = 20
    !> Rounding of sums of some ten products of numbers below three.
    real(wp), parameter :: rounding = 2.0e-14_wp

    !> Random parameters and vectors.
    type :: point_type
        real(wp) :: p(4), x(4), a(3), b(3)
    end type point_type

contains

    !> The suite.
    subroutine collect_euler_parameters(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('rotation-is-e-times-g-transposed', test_rotation_product), &
            new_unittest('rotation-is-the-homogeneous-form', test_rotation_form), &
            new_unittest('rotation-of-unit-parameters-is-orthogonal', test_rotation_orthogonal), &
            new_unittest('rotation-turns-by-twice-the-half-angle', test_rotation_angle), &
            new_unittest('e-and-g-annihilate-p', test_annihilate), &
            new_unittest('e-and-g-have-orthogonal-rows', test_rows), &
            new_unittest('angular-velocity-is-twice-g-pd', test_angular_velocity), &
            new_unittest('g-of-p-times-x-is-minus-g-of-x-times-p', test_g_swap), &
            new_unittest('b-is-the-derivative-of-a-rotated-vector', test_b_derivative), &
            new_unittest('b-is-linear-in-p-and-in-the-vector', test_b_linear), &
            new_unittest('b-of-p-times-x-is-b-of-x-times-p', test_b_swap), &
            new_unittest('b-of-p-times-p-is-twice-the-rotated-vector', test_b_euler), &
            new_unittest('skew-is-the-cross-product', test_skew)]
    end subroutine collect_euler_parameters

    !> Another random point; |p| lies between 0 and 2.
    function next_point(seed) result(point)
        integer, intent(inout) :: seed
        type(point_type) :: point

        call random_vector(seed, point%p)
        call random_vector(seed, point%x)
        call random_vector(seed, point%a)
        call random_vector(seed, point%b)
    end function next_point

    subroutine test_rotation_product(error)
        type(error_type), allocatable, intent(out) :: error
        type(point_type) :: z
        integer :: i, seed

        seed = 1
        do i = 1, n_points
            z = next_point(seed)
            call check_below(error, maxval(abs(rotation(z%p) - matmul(e_matrix(z%p), transpose(g_matrix(z%p))))), rounding, &
                'A - E G''')
        end do
    end subroutine test_rotation_product

    !> A = (e0**2 - e'e) I + 2 e e' + 2 e0 ~e.
    subroutine test_rotation_form(error)
        type(error_type), allocatable, intent(out) :: error
        type(point_type) :: z
        real(wp) :: expected(3, 3)
        integer :: i, j, seed

        seed = 2
        do i = 1, n_points
            z = next_point(seed)
            associate (e0 => z%p(1), e => z%p(2:4))
                expected = 2*spread(e, 2, 3)*spread(e, 1, 3) + 2*e0*skew(e)
                do j = 1, 3
                    expected(j, j) = expected(j, j) + e0**2 - dot_product(e, e)
                end do
            end associate
            call check_below(error, maxval(abs(rotation(z%p) - expected)), rounding, 'A')
        end do
    end subroutine test_rotation_form

    subroutine test_rotation_orthogonal(error)
        type(error_type), allocatable, intent(out) :: error
        type(point_type) :: z
        real(wp) :: a(3, 3), gram(3, 3)
        integer :: i, j, seed

        seed = 3
        do i = 1, n_points
            z = next_point(seed)
            a = rotation(z%p/norm2(z%p))
            gram = matmul(transpose(a), a)
            do j = 1, 3
                gram(j, j) = gram(j, j) - 1
            end do
            call check_below(error, maxval(abs(gram)), rounding, 'A''A - I')
            call check_below(error, maxval(abs(matmul(skew(a(:, 1)), a(:, 2)) - a(:, 3))), rounding, 'handedness')
        end do
    end subroutine test_rotation_orthogonal

    !> About z by an angle: x goes to (cos, sin, 0).
    subroutine test_rotation_angle(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: a(3, 3), angle

        angle = 0.7_wp
        a = rotation([cos(angle/2), 0.0_wp, 0.0_wp, sin(angle/2)])
        call check_below(error, maxval(abs(a(:, 1) - [cos(angle), sin(angle), 0.0_wp])), rounding, 'the image of x')
        call check_below(error, maxval(abs(a(:, 3) - [0.0_wp, 0.0_wp, 1.0_wp])), rounding, 'the image of z')
    end subroutine test_rotation_angle

    subroutine test_annihilate(error)
        type(error_type), allocatable, intent(out) :: error
        type(point_type) :: z
        integer :: i, seed

        seed = 4
        do i = 1, n_points
            z = next_point(seed)
            call check_below(error, maxval(abs(matmul(e_matrix(z%p), z%p))), rounding, 'E p')
            call check_below(error, maxval(abs(matmul(g_matrix(z%p), z%p))), rounding, 'G p')
        end do
    end subroutine test_annihilate

    !> E E' = G G' = p'p I.
    subroutine test_rows(error)
        type(error_type), allocatable, intent(out) :: error
        type(point_type) :: z
        real(wp) :: ee(3, 3), gg(3, 3)
        integer :: i, j, seed

        seed = 5
        do i = 1, n_points
            z = next_point(seed)
            ee = matmul(e_matrix(z%p), transpose(e_matrix(z%p)))
            gg = matmul(g_matrix(z%p), transpose(g_matrix(z%p)))
            do j = 1, 3
                ee(j, j) = ee(j, j) - dot_product(z%p, z%p)
                gg(j, j) = gg(j, j) - dot_product(z%p, z%p)
            end do
            call check_below(error, maxval(abs(ee)), rounding, 'E E'' - p''p I')
            call check_below(error, maxval(abs(gg)), rounding, 'G G'' - p''p I')
        end do
    end subroutine test_rows

    !> ~omega' = A' dA/dt for unit p and pd orthogonal to p; dA/dt by columns of B.
    subroutine test_angular_velocity(error)
        type(error_type), allocatable, intent(out) :: error
        type(point_type) :: z
        real(wp) :: p(4), pd(4), ad(3, 3), unit(3)
        integer :: i, j, seed

        seed = 6
        do i = 1, n_points
            z = next_point(seed)
            p = z%p/norm2(z%p)
            pd = z%x - p*dot_product(p, z%x)
            do j = 1, 3
                unit = 0.0_wp
                unit(j) = 1.0_wp
                ad(:, j) = matmul(b_matrix(p, unit), pd)
            end do
            call check_below(error, maxval(abs(matmul(transpose(rotation(p)), ad) - skew(2*matmul(g_matrix(p), pd)))), &
                rounding, '~omega')
            call check_below(error, maxval(abs(matmul(ad, transpose(rotation(p))) - skew(2*matmul(e_matrix(p), pd)))), &
                rounding, '~omega in the global frame')
        end do
    end subroutine test_angular_velocity

    subroutine test_g_swap(error)
        type(error_type), allocatable, intent(out) :: error
        type(point_type) :: z
        integer :: i, seed

        seed = 7
        do i = 1, n_points
            z = next_point(seed)
            call check_below(error, maxval(abs(matmul(g_matrix(z%p), z%x) + matmul(g_matrix(z%x), z%p))), rounding, &
                'G(p) x + G(x) p')
        end do
    end subroutine test_g_swap

    !> A is quadratic in p, so that a central difference has no error but rounding.
    subroutine test_b_derivative(error)
        type(error_type), allocatable, intent(out) :: error
        type(point_type) :: z
        real(wp) :: difference(3, 4), e(4)
        integer :: i, j, seed

        seed = 8
        do i = 1, n_points
            z = next_point(seed)
            do j = 1, 4
                e = 0.0_wp
                e(j) = 0.5_wp
                difference(:, j) = matmul(rotation(z%p + e) - rotation(z%p - e), z%a)
            end do
            call check_below(error, maxval(abs(b_matrix(z%p, z%a) - difference)), rounding, 'B - (A a)_p')
        end do
    end subroutine test_b_derivative

    subroutine test_b_linear(error)
        type(error_type), allocatable, intent(out) :: error
        type(point_type) :: z
        integer :: i, seed

        seed = 9
        do i = 1, n_points
            z = next_point(seed)
            call check_below(error, maxval(abs(b_matrix(z%p - 3*z%x, z%a) - b_matrix(z%p, z%a) + 3*b_matrix(z%x, z%a))), &
                2*rounding, 'B in p')
            call check_below(error, maxval(abs(b_matrix(z%p, z%a - 3*z%b) - b_matrix(z%p, z%a) + 3*b_matrix(z%p, z%b))), &
                2*rounding, 'B in a')
        end do
    end subroutine test_b_linear

    subroutine test_b_swap(error)
        type(error_type), allocatable, intent(out) :: error
        type(point_type) :: z
        integer :: i, seed

        seed = 10
        do i = 1, n_points
            z = next_point(seed)
            call check_below(error, maxval(abs(matmul(b_matrix(z%p, z%a), z%x) - matmul(b_matrix(z%x, z%a), z%p))), rounding, &
                'B(p, a) x - B(x, a) p')
        end do
    end subroutine test_b_swap

    subroutine test_b_euler(error)
        type(error_type), allocatable, intent(out) :: error
        type(point_type) :: z
        integer :: i, seed

        seed = 11
        do i = 1, n_points
            z = next_point(seed)
            call check_below(error, maxval(abs(matmul(b_matrix(z%p, z%a), z%p) - 2*matmul(rotation(z%p), z%a))), rounding, &
                'B(p, a) p - 2 A a')
        end do
    end subroutine test_b_euler

    subroutine test_skew(error)
        type(error_type), allocatable, intent(out) :: error

        call check_below(error, maxval(abs(matmul(skew([1.0_wp, 2.0_wp, 3.0_wp]), [4.0_wp, -5.0_wp, 6.0_wp]) &
            - [27.0_wp, 6.0_wp, -13.0_wp])), 0.0_wp, 'a x b')
    end subroutine test_skew
end module test_euler_parameters
