! SPDX-License-Identifier: MIT
!> Tests of every model's procedures against differences of each other, and of the models against the reference solutions.
module test_models
    use asserts, only: check_below, check_close, check_count
    use differences, only: check_model_procedures, random_vector
    use model_belt_wheel, only: belt_wheel_type
    use model_moving_pivot, only: moving_pivot_type
    use model_pendulum, only: pendulum_type
    use model_rod, only: rod_type
    use model_sleigh, only: sleigh_type
    use reference, only: read_reference, reference_type
    use runs, only: new_scene, scene_names
    use tandem, only: articulated_vehicle_type, model_type, motorcycle_type, need_force, need_gamma, need_jacobian, need_mass, &
        need_nu, need_phi, rolling_disk_type, terms_type, wp
    use tandem_rigid_euler_parameters, only: g_matrix, rotation
    use terms_at, only: get_terms
    use testdrive, only: check, error_type, new_unittest, unittest_type
    use watch, only: natural_errors
    implicit none (type, external)
    private

    public :: collect_models

    real(wp), parameter :: two_pi = 8*atan(1.0_wp)
    !> Number of random points per model.
    integer, parameter :: n_points = 5

contains

    !> The suite.
    subroutine collect_models(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('vehicle-agrees-with-differences-while-it-steers', test_vehicle_steering), &
            new_unittest('vehicle-agrees-with-differences-after-it-steered', test_vehicle_straight), &
            new_unittest('disk-agrees-with-differences', test_disk), &
            new_unittest('motorcycle-agrees-with-differences', test_motorcycle), &
            new_unittest('evaluate-gives-exactly-what-is-asked-for', test_masks), &
            new_unittest('other-scenes-with-references-agree-with-differences', test_other_scenes), &
            new_unittest('test-models-agree-with-differences', test_test_models), &
            new_unittest('vehicle-wheels-do-not-slip-sideways', test_vehicle_wheels), &
            new_unittest('disk-contact-point-does-not-slip', test_disk_contact), &
            new_unittest('disk-kinetic-energy-is-that-of-a-rigid-body', test_disk_energy), &
            new_unittest('vehicle-mass-matrix-has-masses-and-inertias', test_vehicle_mass), &
            new_unittest('vehicle-parameters-reach-the-procedures', test_vehicle_parameters), &
            new_unittest('vehicle-parameters-can-change-between-runs', test_vehicle_change), &
            new_unittest('disk-parameters-reach-the-procedures', test_disk_parameters), &
            new_unittest('starts-satisfy-the-constraints', test_starts), &
            new_unittest('starts-are-those-of-the-references', test_reference_starts), &
            new_unittest('reference-solutions-satisfy-the-constraints', test_reference_constraints), &
            new_unittest('reference-solutions-satisfy-the-equations-of-motion', test_reference_motion)]
    end subroutine collect_models

    !> A model's procedures at random points, off the constraints.
    subroutine check_at_random(model, error)
        class(model_type), intent(inout) :: model
        type(error_type), allocatable, intent(inout) :: error
        real(wp) :: q(model%n), qd(model%n), t(1)
        integer :: i, seed

        seed = 1000 + model%n
        do i = 1, n_points
            call random_vector(seed, t)
            call random_vector(seed, q)
            call random_vector(seed, qd)
            call check_model_procedures(model, 3 + t(1), q, qd, error)
        end do
    end subroutine check_at_random

    subroutine test_vehicle_steering(error)
        type(error_type), allocatable, intent(out) :: error
        type(articulated_vehicle_type) :: model

        model%amplitude = 0.8_wp
        model%frequency = 1.3_wp
        call model%define()
        call check_at_random(model, error)
    end subroutine test_vehicle_steering

    subroutine test_vehicle_straight(error)
        type(error_type), allocatable, intent(out) :: error
        type(articulated_vehicle_type) :: model

        model%amplitude = 0.8_wp
        call model%define()
        model%segment = 2
        call check_at_random(model, error)
    end subroutine test_vehicle_straight

    subroutine test_disk(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type) :: model

        call model%define()
        call check_at_random(model, error)
        model%mass = 3.0_wp
        model%inertia = [0.4_wp, 0.7_wp, 1.9_wp]
        model%radius = 0.6_wp
        model%gravity = 1.6_wp
        call model%define()
        call check_at_random(model, error)
    end subroutine test_disk

    !> Without the damper, whose force is not in Lagrange's equations.
    subroutine test_motorcycle(error)
        type(error_type), allocatable, intent(out) :: error
        type(motorcycle_type) :: model

        model%damping = 0.0_wp
        model%stiffness = 20.0_wp
        model%amplitude = 0.4_wp
        call model%define()
        call check_at_random(model, error)
        model%segment = 2
        call check_at_random(model, error)
    end subroutine test_motorcycle

    subroutine test_masks(error)
        type(error_type), allocatable, intent(out) :: error
        type(articulated_vehicle_type) :: vehicle
        type(rolling_disk_type) :: disk
        type(motorcycle_type) :: motorcycle

        call vehicle%define()
        call check_masks(vehicle, error)
        call disk%define()
        call check_masks(disk, error)
        call motorcycle%define()
        call check_masks(motorcycle, error)
    end subroutine test_masks

    !> Every set of the terms that a fused procedure provides, each at a separate point: the terms in the set are the same as those
    !> of the whole set, the others are unchanged.
    subroutine check_masks(model, error)
        class(model_type), intent(inout) :: model
        type(error_type), allocatable, intent(inout) :: error
        type(terms_type) :: some, all
        real(wp), parameter :: untouched = 12345.0_wp
        real(wp) :: q(model%n), qd(model%n), t(1)
        integer :: mask, seed, stat

        seed = 25
        do mask = 1, model%provides
            if (iand(mask, not(model%provides)) /= 0) cycle
            call random_vector(seed, t)
            call random_vector(seed, q)
            call random_vector(seed, qd)
            call some%allocate(model%n, model%n_holonomic, model%n_nonholonomic)
            some%phi = untouched
            some%jacobian = untouched
            some%nu = untouched
            some%gamma = untouched
            some%mass = untouched
            some%force = untouched
            call model%evaluate(mask, t(1), q, qd, some, stat)
            call check_count(error, stat, 0, model%name//': status')
            all = some
            call model%evaluate(model%provides, t(1), q, qd, all, stat)
            if (iand(mask, need_phi) == 0) all%phi = untouched
            if (iand(mask, need_jacobian) == 0) all%jacobian = untouched
            if (iand(mask, need_nu) == 0) all%nu = untouched
            if (iand(mask, need_gamma) == 0) all%gamma = untouched
            if (iand(mask, need_mass) == 0) all%mass = untouched
            if (iand(mask, need_force) == 0) all%force = untouched
            call check_close(error, some%phi, all%phi, 0.0_wp, model%name//': phi')
            call check_close(error, pack(some%jacobian, .true.), pack(all%jacobian, .true.), 0.0_wp, model%name//': jacobian')
            call check_close(error, some%nu, all%nu, 0.0_wp, model%name//': nu')
            call check_close(error, some%gamma, all%gamma, 0.0_wp, model%name//': gamma')
            call check_close(error, pack(some%mass, .true.), pack(all%mass, .true.), 0.0_wp, model%name//': mass')
            call check_close(error, some%force, all%force, 0.0_wp, model%name//': force')
        end do
    end subroutine check_masks

    subroutine test_other_scenes(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable :: model
        integer :: i

        do i = 3, 5
            call new_scene(trim(scene_names(i)), model)
            call check_at_random(model, error)
        end do
    end subroutine test_other_scenes

    subroutine test_test_models(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type) :: pendulum
        type(rod_type) :: rod
        type(moving_pivot_type) :: moving_pivot
        type(belt_wheel_type) :: belt_wheel
        type(sleigh_type) :: sleigh

        call pendulum%define()
        call check_at_random(pendulum, error)
        call rod%define()
        call check_at_random(rod, error)
        moving_pivot%swing = 0.3_wp
        moving_pivot%rate = 2.0_wp
        moving_pivot%fall = 4.0_wp
        call moving_pivot%define()
        call check_at_random(moving_pivot, error)
        call belt_wheel%define()
        call check_at_random(belt_wheel, error)
        call sleigh%define(1.0_wp)
        call check_at_random(sleigh, error)
        sleigh%segment = 2
        call check_at_random(sleigh, error)
    end subroutine test_test_models

    !> E qd is the velocity of each axle's centre across its wheel.
    subroutine test_vehicle_wheels(error)
        type(error_type), allocatable, intent(out) :: error
        type(articulated_vehicle_type) :: model
        type(terms_type) :: terms
        real(wp) :: q(6), qd(6), slip(3), theta, t
        integer :: i, seed, stat

        model%amplitude = 0.5_wp
        call model%define()
        seed = 21
        do i = 1, n_points
            call random_vector(seed, q)
            call random_vector(seed, qd)
            t = 0.9_wp*i
            theta = 0.5_wp*sin(t)
            call get_terms(model, t, q, qd, terms, stat)
            slip(1) = across(q(3) + theta, qd(1:2) + qd(3)*3*[-sin(q(3)), cos(q(3))])
            slip(2) = across(q(3), qd(1:2) - qd(3)*3*[-sin(q(3)), cos(q(3))])
            slip(3) = across(q(6), qd(4:5) - qd(6)*3*[-sin(q(6)), cos(q(6))])
            ! Sums of some ten products of numbers below three.
            call check_close(error, matmul(terms%jacobian(3:5, :), qd), slip, 1.0e-14_wp, 'slips')
        end do
    end subroutine test_vehicle_wheels

    !> The component of a velocity across a heading.
    pure real(wp) function across(heading, velocity)
        real(wp), intent(in) :: heading, velocity(2)

        across = -sin(heading)*velocity(1) + cos(heading)*velocity(2)
    end function across

    !> E qd is the horizontal velocity of the particle of the disk at the contact point, by a central difference of A(p) alpha
    !> along pd, which is exact since A is quadratic in p.
    subroutine test_disk_contact(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type) :: model
        type(terms_type) :: terms
        real(wp) :: q(9), qd(9), velocity(3)
        integer :: i, seed, stat

        call model%define()
        seed = 22
        do i = 1, n_points
            call random_vector(seed, q)
            call random_vector(seed, qd)
            call get_terms(model, 0.0_wp, q, qd, terms, stat)
            velocity = qd(1:3) + matmul(rotation(q(4:7) + qd(4:7)/2) - rotation(q(4:7) - qd(4:7)/2), [0.0_wp, q(8), q(9)])
            ! Sums of some ten products of numbers below three.
            call check_close(error, matmul(terms%jacobian(5:6, :), qd), velocity(1:2), 1.0e-14_wp, 'slips')
        end do
    end subroutine test_disk_contact

    !> qd' M qd/2 = m v**2/2 + omega' J omega/2.
    subroutine test_disk_energy(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type) :: model
        type(terms_type) :: terms
        real(wp) :: q(9), qd(9), omega(3), energy
        integer :: i, seed, stat

        call model%define()
        seed = 23
        do i = 1, n_points
            call random_vector(seed, q)
            call random_vector(seed, qd)
            call get_terms(model, 0.0_wp, q, qd, terms, stat)
            omega = 2*matmul(g_matrix(q(4:7)), qd(4:7))
            energy = 5*dot_product(qd(1:3), qd(1:3)) + sum([5.0_wp, 2.5001_wp, 2.5001_wp]*omega**2)/2
            call check_below(error, abs(dot_product(qd, matmul(terms%mass, qd))/2/energy - 1), 1.0e-14_wp, 'energy')
        end do
    end subroutine test_disk_energy

    subroutine test_vehicle_mass(error)
        type(error_type), allocatable, intent(out) :: error
        type(articulated_vehicle_type) :: model
        type(terms_type) :: terms
        real(wp) :: zero(6), diagonal(6)
        integer :: i, stat

        model%mass = 1200.0_wp
        model%inertia = 700.0_wp
        call model%define()
        zero = 0.0_wp
        call get_terms(model, 0.0_wp, zero, zero, terms, stat)
        diagonal = [(terms%mass(i, i), i=1, 6)]
        call check_close(error, diagonal, [1200.0_wp, 1200.0_wp, 700.0_wp, 1200.0_wp, 1200.0_wp, 700.0_wp], 0.0_wp, 'M')
        call check_below(error, sum(abs(terms%mass)), sum(diagonal), 'what is off the diagonal of M, with the diagonal')
    end subroutine test_vehicle_mass

    !> Half length, amplitude and frequency: the wheel's heading and the breakpoint.
    subroutine test_vehicle_parameters(error)
        type(error_type), allocatable, intent(out) :: error
        type(articulated_vehicle_type) :: model
        type(terms_type) :: terms
        real(wp) :: q(6), qd(6)
        integer :: stat

        model%half_length = 2.0_wp
        model%amplitude = 0.3_wp
        model%frequency = 2.0_wp
        call model%define()
        call check_close(error, model%breakpoints, [two_pi/2], 0.0_wp, 'breakpoints')
        call model%start(7.0_wp, q, qd)
        call check_close(error, q, [4.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, 0.0_wp], 0.0_wp, 'q')
        call check_close(error, qd, [7.0_wp, 0.0_wp, 0.0_wp, 7.0_wp, 0.0_wp, 0.0_wp], 0.0_wp, 'qd')
        call get_terms(model, 0.6_wp, q, qd, terms, stat)
        ! tan(theta) = -E11/E12 at phi1 = 0.
        call check_below(error, abs(-terms%jacobian(3, 1)/terms%jacobian(3, 2) - tan(0.3_wp*sin(1.2_wp))), 1.0e-15_wp, 'tan(theta)')
        call check_below(error, abs(terms%jacobian(4, 3) + 2), 0.0_wp, 'half length')
        model%frequency = 0.0_wp
        call model%define()
        call check_count(error, size(model%breakpoints), 0, 'breakpoints of straight steering')
    end subroutine test_vehicle_parameters

    !> Data of one set of parameters must not be reused for the next.
    subroutine test_vehicle_change(error)
        type(error_type), allocatable, intent(out) :: error
        type(articulated_vehicle_type) :: model
        type(terms_type) :: terms
        real(wp) :: q(6), qd(6)
        integer :: stat

        call model%define()
        call model%start(15.0_wp, q, qd)
        call get_terms(model, 1.0_wp, q, qd, terms, stat)
        model%amplitude = 0.3_wp
        call model%define()
        call get_terms(model, 1.0_wp, q, qd, terms, stat)
        call check_below(error, abs(-terms%jacobian(3, 1)/terms%jacobian(3, 2) - tan(0.3_wp*sin(1.0_wp))), 1.0e-15_wp, 'tan(theta)')
    end subroutine test_vehicle_change

    subroutine test_disk_parameters(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type) :: model
        type(terms_type) :: terms
        real(wp) :: q(9), qd(9), energy
        integer :: stat

        model%mass = 3.0_wp
        model%inertia = [0.4_wp, 0.7_wp, 1.9_wp]
        model%radius = 0.6_wp
        model%gravity = 1.6_wp
        call model%define()
        call model%start([-2.0_wp, 0.0_wp, 0.0_wp], 0.0_wp, q, qd)
        call check_below(error, abs(q(3) - 0.6_wp), 1.0e-16_wp, 'height')
        ! Rolling: the speed is omega times the radius, along +y.
        call check_close(error, qd(1:3), [0.0_wp, 1.2_wp, 0.0_wp], 1.0e-15_wp, 'velocities')
        call get_terms(model, 0.0_wp, q, qd, terms, stat)
        call check_below(error, abs(terms%force(3) + 3*1.6_wp), 1.0e-15_wp, 'weight')
        call check_below(error, abs(dot_product(qd, matmul(terms%mass, qd))/2 - (3*1.2_wp**2 + 0.4_wp*4)/2), 1.0e-15_wp, 'T')
        call model%potential_energy(0.0_wp, q, energy, stat)
        call check_below(error, abs(energy - 3*1.6_wp*0.6_wp), 1.0e-15_wp, 'V')
    end subroutine test_disk_parameters

    !> Also for a tilted disk and any angular velocity.
    subroutine test_starts(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type) :: disk
        type(articulated_vehicle_type) :: vehicle
        real(wp) :: q(9), qd(9), omega(3)
        integer :: i, seed

        call vehicle%define()
        call vehicle%start(15.0_wp, q(:6), qd(:6))
        call check_consistent(vehicle, 0.0_wp, q(:6), qd(:6), error)
        disk%radius = 0.7_wp
        call disk%define()
        seed = 24
        do i = -3, 3
            call random_vector(seed, omega)
            call disk%start(10*omega, 0.4_wp*i, q, qd)
            call check_consistent(disk, 0.0_wp, q, qd, error)
        end do
    end subroutine test_starts

    !> Position and velocity constraints at rounding level.
    subroutine check_consistent(model, t, q, qd, error)
        class(model_type), intent(inout) :: model
        real(wp), intent(in) :: t, q(:), qd(:)
        type(error_type), allocatable, intent(inout) :: error
        type(terms_type) :: terms
        real(wp) :: errors(3)
        integer :: stat

        call get_terms(model, t, q, qd, terms, stat)
        call natural_errors(terms, model%n_holonomic, spread(1.0_wp, 1, model%n), q, qd, qd, errors)
        call check_below(error, errors(1), 1.0e-15_wp, model%name//': position error of the start')
        call check_below(error, errors(2), 1.0e-15_wp, model%name//': velocity error of the start')
    end subroutine check_consistent

    subroutine test_reference_starts(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type) :: disk
        type(articulated_vehicle_type) :: vehicle
        type(reference_type) :: table
        real(wp) :: q(9), qd(9)

        call vehicle%define()
        call vehicle%start(15.0_wp, q(:6), qd(:6))
        call read_reference('vehicle', table)
        call check_close(error, q(:6), table%q(:, 1), 0.0_wp, 'q of the vehicle')
        call check_close(error, qd(:6), table%qd(:, 1), 0.0_wp, 'qd of the vehicle')
        call disk%define()
        call disk%start([-1.0_wp, 0.01_wp, 0.0_wp], 0.0_wp, q, qd)
        call read_reference('disk', table)
        call check_close(error, q, table%q(:, 1), 0.0_wp, 'q of the disk')
        call check_close(error, qd, table%qd(:, 1), 0.0_wp, 'qd of the disk')
    end subroutine test_reference_starts

    !> The references are independent of our procedures: agreement at all three levels checks both.
    subroutine test_reference_constraints(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable :: model
        type(reference_type) :: table
        type(terms_type) :: terms
        real(wp) :: errors(3)
        integer :: i, k, stat

        do k = 1, size(scene_names)
            call new_scene(trim(scene_names(k)), model)
            call read_reference(trim(scene_names(k)), table)
            do i = 1, size(table%t)
                call enter_segment(model, table%t(i))
                call get_terms(model, table%t(i), table%q(:, i), table%qd(:, i), terms, stat)
                call natural_errors(terms, model%n_holonomic, spread(1.0_wp, 1, model%n), table%q(:, i), table%qd(:, i), &
                    table%qdd(:, i), errors)
                ! The tables have double rounding, 1e-16 of each entry; the sums have up to ten terms.
                call check_below(error, maxval(errors), 1.0e-14_wp, trim(scene_names(k))//': constraint error')
            end do
        end do
    end subroutine test_reference_constraints

    subroutine test_reference_motion(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable :: model
        type(reference_type) :: table
        type(terms_type) :: terms
        real(wp), allocatable :: residual(:), size_(:)
        integer :: i, k, stat

        do k = 1, size(scene_names)
            call new_scene(trim(scene_names(k)), model)
            call read_reference(trim(scene_names(k)), table)
            do i = 1, size(table%t)
                call enter_segment(model, table%t(i))
                call get_terms(model, table%t(i), table%q(:, i), table%qd(:, i), terms, stat)
                residual = matmul(terms%mass, table%qdd(:, i)) + matmul(table%lambda(:, i), terms%jacobian) - terms%force
                size_ = matmul(abs(terms%mass), abs(table%qdd(:, i))) + matmul(abs(table%lambda(:, i)), abs(terms%jacobian)) &
                    + abs(terms%force)
                ! The stiff spring turns the last digit of its length, 1e-16, into 1e-9 newtons, compared with some tens.
                call check_below(error, maxval(abs(residual))/max(1.0_wp, maxval(size_)), merge(1.0e-10_wp, 1.0e-14_wp, k == 5), &
                    trim(scene_names(k))//': residual of the equations of motion')
            end do
        end do
    end subroutine test_reference_motion

    !> The piece of time that t is in; a breakpoint belongs to the piece before it, as in the tables.
    subroutine enter_segment(model, t)
        class(model_type), intent(inout) :: model
        real(wp), intent(in) :: t

        model%segment = 1
        if (allocated(model%breakpoints)) model%segment = 1 + count(model%breakpoints < t)
    end subroutine enter_segment
end module test_models
