! SPDX-License-Identifier: MIT
!> Tests of the grouped evaluation of joints and bodies in mechanisms with more than one group: the rows of hinges and pins, the
!> masses and the inertia forces of rotating bodies.
module test_mechanism_groups
    use asserts, only: check_close, check_count, check_no_failure
    use large_mechanisms, only: make_large
    use scattered_numbers, only: scattered
    use tandem, only: failure_type => error_type, mechanism_type, wp
    use tandem_model_terms, only: need_force, need_gamma, need_jacobian, need_mass, need_phi, terms_type
    use tandem_rigid_euler_parameters, only: g_matrix, rotation
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_mechanism_groups

contains

    !> The suite.
    subroutine collect_mechanism_groups(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('hinges', test_hinges), &
            new_unittest('pins', test_pins), &
            new_unittest('turning-bodies', test_turning)]
    end subroutine collect_mechanism_groups

    !> A symmetric matrix that is definite.
    pure function definite(s, seed) result(a)
        integer, intent(in) :: s, seed
        real(wp) :: a(s, s)
        integer :: i

        a = reshape(scattered(s*s, seed), [s, s])
        a = matmul(a, transpose(a))
        do i = 1, s
            a(i, i) = a(i, i) + 0.5_wp
        end do
    end function definite

    !> Rows of a chain of hinges, more than one group, at any coordinates, also off the constraints: Phi by rotations, C and gamma
    !> by differences.
    subroutine test_hinges(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type) :: mechanism
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), phi(:)
        real(wp) :: a(3, 3), last(3, 3), r(3), at(3), axis(3), x(3)
        integer :: i
        integer, parameter :: n_hinges = 11

        call make_large('spatial_chain', n_hinges, mechanism, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call check_rows(mechanism, q, phi, error)
        last = reshape([1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 1.0_wp], [3, 3])
        at = 0.0_wp
        do i = 1, n_hinges
            r = q(7*i - 6:7*i - 4)
            a = rotation(q(7*i - 3:7*i))
            ! Rods of 1 m along x: coinciding ends, a common axis of the reference configuration.
            call check_close(error, phi(5*i - 4:5*i - 2), r - matmul(a, [0.5_wp, 0.0_wp, 0.0_wp]) - at, 1.0e-14_wp, &
                'Phi of points that meet')
            axis = merge([0.0_wp, 1.0_wp, 0.0_wp], [0.0_wp, 0.8_wp, 0.6_wp], mod(i, 2) == 1)
            ! Components of the axis across the other body's, with directions across it of unit length.
            x = matmul(transpose(last), matmul(a, axis))
            x = x - dot_product(x, axis)*axis
            call check_close(error, [norm2(phi(5*i - 1:5*i))], [norm2(x)], 1.0e-14_wp, 'Phi of axes')
            at = r + matmul(a, [0.5_wp, 0.0_wp, 0.0_wp])
            last = a
        end do
    end subroutine test_hinges

    !> The same of a chain of pins in the plane.
    subroutine test_pins(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type) :: mechanism
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), phi(:)
        real(wp) :: at(2), half(2)
        integer :: i
        integer, parameter :: n_pins = 11

        call make_large('planar_chain', n_pins, mechanism, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call check_rows(mechanism, q, phi, error)
        at = 0.0_wp
        do i = 1, n_pins
            half = 0.5_wp*[cos(q(3*i)), sin(q(3*i))]
            call check_close(error, phi(2*i - 1:2*i), q(3*i - 2:3*i - 1) - half - at, 1.0e-14_wp, 'Phi of pins')
            at = q(3*i - 2:3*i - 1) + half
        end do
    end subroutine test_pins

    !> C and gamma of all rows against differences of Phi and C, at a point off the constraints, which is returned with Phi.
    subroutine check_rows(mechanism, q, phi, error)
        type(mechanism_type), intent(inout) :: mechanism
        real(wp), allocatable, intent(out) :: q(:), phi(:)
        type(error_type), allocatable, intent(inout) :: error
        real(wp), parameter :: step = 1.0e-5_wp
        real(wp), allocatable :: qd(:)
        type(terms_type) :: here, before, behind
        integer :: stat

        associate (n => mechanism%n, m => mechanism%n_holonomic)
            allocate (q(n), qd(n))
            call mechanism%start(q, qd)
            q = q + 0.3_wp*scattered(n, 1)
            qd = scattered(n, 2)
            call here%allocate(n, m, 0)
            call before%allocate(n, m, 0)
            call behind%allocate(n, m, 0)
            call mechanism%evaluate(need_phi + need_jacobian + need_gamma, 0.0_wp, q, qd, here, stat)
            call mechanism%evaluate(need_phi + need_jacobian, 0.0_wp, q - step*qd, qd, before, stat)
            call mechanism%evaluate(need_phi + need_jacobian, 0.0_wp, q + step*qd, qd, behind, stat)
        end associate
        call check_close(error, matmul(here%jacobian, qd), (behind%phi - before%phi)/(2*step), 1.0e-8_wp, 'C qd')
        call check_close(error, here%gamma, matmul(behind%jacobian - before%jacobian, qd)/(2*step), 1.0e-8_wp, 'gamma')
        phi = here%phi
    end subroutine check_rows

    !> M and the inertia forces of rotating bodies, including some with products of inertia and point masses, by the matrices of
    !> Euler parameters: M = 4 G'J G, S = 8 G(pd)'J G(pd) p.
    subroutine test_turning(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type) :: mechanism
        type(failure_type), allocatable :: failure
        type(terms_type) :: terms
        real(wp), allocatable :: q(:), qd(:), force(:), mass(:, :)
        real(wp) :: inertia(3, 3, 11)
        integer :: i, k, place, stat

        do i = 1, size(inertia, 3)
            ! As of any distribution of mass, of which this is the second moment.
            inertia(:, :, i) = -definite(3, i)
            associate (j => inertia(:, :, i))
                call add_trace(-(j(1, 1) + j(2, 2) + j(3, 3)), j)
                if (mod(i, 4) == 0) then
                    call mechanism%add_body(name(i), real(i, wp), [0.0_wp, 0.0_wp, 0.0_wp], failure)
                else
                    call mechanism%add_body(name(i), real(i, wp), [0.0_wp, 0.0_wp, 0.0_wp], failure, &
                        inertia=[j(1, 1), j(2, 2), j(3, 3), j(1, 2), j(1, 3), j(2, 3)])
                end if
            end associate
            call check_no_failure(error, failure)
            if (allocated(error)) return
        end do
        call mechanism%define(failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        associate (n => mechanism%n)
            q = scattered(n, 1)
            qd = scattered(n, 2)
            call terms%allocate(n, mechanism%n_holonomic, 0)
            call mechanism%evaluate(need_mass + need_force, 0.0_wp, q, qd, terms, stat)
            allocate (mass(n, n), force(n), source=0.0_wp)
        end associate
        place = 0
        do i = 1, size(inertia, 3)
            do k = 1, 3
                mass(place + k, place + k) = real(i, wp)
            end do
            place = place + 3
            if (mod(i, 4) == 0) cycle
            associate (p => q(place + 1:place + 4), g => g_matrix(q(place + 1:place + 4)), gd => g_matrix(qd(place + 1:place + 4)))
                mass(place + 1:place + 4, place + 1:place + 4) = 4*matmul(transpose(g), matmul(inertia(:, :, i), g))
                force(place + 1:place + 4) = 8*matmul(transpose(gd), matmul(inertia(:, :, i), matmul(gd, p)))
            end associate
            place = place + 4
        end do
        call check_count(error, place, mechanism%n, 'coordinates')
        call check_close(error, reshape(terms%mass, [size(mass)]), reshape(mass, [size(mass)]), 1.0e-13_wp, 'M')
        call check_close(error, terms%force, force, 1.0e-13_wp, 'inertia forces')

    contains

        !> Add a number to the diagonal.
        pure subroutine add_trace(trace, j)
            real(wp), intent(in) :: trace
            real(wp), intent(inout) :: j(3, 3)
            integer :: k

            do k = 1, 3
                j(k, k) = j(k, k) + trace
            end do
        end subroutine add_trace

        !> The name of a body.
        function name(i)
            integer, intent(in) :: i
            character(len=1) :: name

            name = achar(iachar('a') + i)
        end function name
    end subroutine test_turning
end module test_mechanism_groups
