! SPDX-License-Identifier: MIT
!> Tests of each element of a mechanism in isolation: every procedure against differences at random states, which need not satisfy
!> the constraints; and of the error messages of the builder.
module test_mechanism_elements
    use asserts, only: check_count, check_no_failure, check_true
    use mechanism_checks, only: check_drawing, draw, verify
    use tandem, only: failure_type => error_type, mechanism_type, plane_type, polynomial_type, ramp, sine_type, wp
    use tandem_mechanism_element_kind, only: constraint_type, most_measured
    use tandem_mechanism_sensor, only: sensor_type
    use tandem_model, only: quantity_type
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_mechanism_elements

contains

    !> The suite.
    subroutine collect_mechanism_elements(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('bodies-and-their-inertia', test_bodies), &
            new_unittest('every-joint-in-space', test_joints_in_space), &
            new_unittest('every-joint-in-the-plane', test_joints_in_plane), &
            new_unittest('driven-joints-and-distances', test_driven), &
            new_unittest('forces', test_forces), &
            new_unittest('kinds-of-forces-have-words-and-quantities', test_kinds), &
            new_unittest('kinds-keep-numbers-and-rows-that-events-change', test_changed_kinds), &
            new_unittest('knife-edges-disks-and-spheres', test_rolling), &
            new_unittest('words-name-what-is-wrong', test_words)]
    end subroutine collect_mechanism_elements

    !> With a point mass between them; the kinetic energy is that of the angular velocity.
    subroutine test_bodies(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type) :: mechanism
        type(failure_type), allocatable :: failure

        call draw(mechanism, .false.)
        call mechanism%add_body('dot', 0.2_wp, [0.0_wp, 0.0_wp, 0.0_wp], failure)
        call check_no_failure(error, failure)
        call verify(mechanism, 'in space', error)
        call check_count(error, mechanism%n, 17, 'coordinates in space')
        call check_count(error, mechanism%n_holonomic, 2, 'rows in space')
        call draw(mechanism, .true.)
        call mechanism%add_body('dot', 0.2_wp, [0.0_wp, 0.0_wp], failure)
        call check_no_failure(error, failure)
        call verify(mechanism, 'in the plane', error)
        call check_count(error, mechanism%n, 8, 'coordinates in the plane')
        call check_count(error, mechanism%n_holonomic, 0, 'rows in the plane')
    end subroutine test_bodies

    !> Words are distinct; the values of a sensor fit, and the last one is the power. Lists in messages follow the list of kinds.
    subroutine test_kinds(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type) :: mechanism
        type(sensor_type) :: sensor
        type(quantity_type), allocatable :: list(:)
        character(len=:), allocatable :: words
        integer :: k

        call mechanism%clear()
        do k = 1, size(mechanism%kinds)
            associate (kind => mechanism%kinds(k)%of)
                call check_count(error, mechanism%kind_number(kind%label()), k, 'index of '//kind%label())
                allocate (list(0))
                call kind%list_quantities(sensor, list)
                call check_true(error, sum(max(1, list%width)) <= most_measured, 'values of '//kind%label())
                if (size(list) > 0) call check_true(error, index(list(size(list))%path, '/power') > 0, 'power of '//kind%label())
                deallocate (list)
            end associate
        end do
        call mechanism%list_words(.false., ' or ', words)
        call check_true(error, words == 'a spring, a torsion, a bushing or a load', 'words of kinds with sensors: '//words)
        call mechanism%list_words(.true., ' nor ', words)
        call check_true(error, words == 'a spring nor a torsion', 'words of kinds with numbers that events set: '//words)
        call check_count(error, mechanism%kind_number('gravity'), 0, 'index of an unknown word')
    end subroutine test_kinds

    !> Numbers of a torsion; the row of a coupling, and its slack, which follows the two bodies.
    subroutine test_changed_kinds(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type) :: mechanism
        type(failure_type), allocatable :: failure
        type(constraint_type) :: row
        real(wp) :: q(15), qd(15)
        character(len=80) :: problem
        integer :: k

        call draw(mechanism, .false.)
        call mechanism%add_joint('pin', 'revolute', 'ground', 'first', failure, at=[0.7_wp, 0.5_wp, 0.2_wp], axis=[1.0_wp, 2.0_wp, &
            -0.5_wp])
        call check_no_failure(error, failure)
        call mechanism%add_torsion('coil', 'pin', failure, stiffness=3.0_wp, angle=0.5_wp)
        call check_no_failure(error, failure)
        call mechanism%add_coupling('clutch', ['pin'], [-2.0_wp], failure, locked=.false.)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        k = mechanism%kind_number('coupling')
        row = mechanism%kinds(k)%of%constraint(1, 0.5_wp)
        call check_true(error, mechanism%kinds(k)%of%table() == 'constraint', 'table of couplings')
        call check_count(error, row%row, 6, 'row, behind those of the joint')
        call check_count(error, row%slide, -1, 'slack before it is numbered')
        call check_true(error, row%is_angle .and. row%can_be_freed .and. .not. row%is_locked, 'a free row of an angle')
        call check_true(error, abs(row%scale - 2) < epsilon(1.0_wp), 'scale of the row of an angle')
        call mechanism%define(failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        row = mechanism%kinds(k)%of%constraint(1, 0.5_wp)
        call check_count(error, row%slide, 3, 'numbered slack')
        call mechanism%start(q, qd)
        call mechanism%change('lock clutch', .true., 0.0_wp, q, problem)
        row = mechanism%kinds(k)%of%constraint(1, 0.5_wp)
        call check_true(error, problem == '' .and. .not. row%is_locked, 'a trial changes nothing')
        call mechanism%change('lock clutch', .false., 0.0_wp, q, problem)
        row = mechanism%kinds(k)%of%constraint(1, 0.5_wp)
        call check_true(error, problem == '' .and. row%is_locked, 'a locked row')
        call mechanism%change('force.coil.damping = 0.25', .false., 0.0_wp, q, problem)
        associate (numbers => mechanism%kinds(mechanism%kind_number('torsion'))%of%numbers)
            call check_true(error, all(abs(numbers(:, 1) - [3.0_wp, 0.25_wp, 0.5_wp]) < epsilon(1.0_wp)), 'numbers of the torsion')
        end associate
    end subroutine test_changed_kinds

    !> Between two bodies and between a body and the ground, either way; rows, which the reference configuration satisfies.
    subroutine test_joints_in_space(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=*), parameter :: kind(9) = [character(len=14) :: 'fixed', 'revolute', 'prismatic', 'cylindrical', &
            'spherical', 'universal', 'planar', 'point_on_line', 'point_on_plane']
        integer, parameter :: rows(9) = [6, 5, 5, 4, 3, 4, 3, 2, 1]
        character(len=*), parameter :: between(2, 3) = reshape([character(len=6) :: 'first', 'second', 'ground', 'first', &
            'second', 'ground'], [2, 3])
        type(mechanism_type) :: mechanism
        type(failure_type), allocatable :: failure
        integer :: i, k

        do i = 1, size(kind)
            do k = 1, 3
                call draw(mechanism, .false.)
                call mechanism%add_joint('it', trim(kind(i)), trim(between(1, k)), trim(between(2, k)), failure, &
                    at=[0.7_wp, 0.5_wp, 0.2_wp], axis=[1.0_wp, 2.0_wp, -0.5_wp], across=[-2.0_wp, 1.0_wp, 0.0_wp])
                call check_no_failure(error, failure)
                call verify(mechanism, trim(kind(i))//' '//trim(between(1, k)), error)
                call check_count(error, mechanism%n_holonomic, rows(i) + 2, trim(kind(i))//': rows')
                call check_drawing(mechanism, trim(kind(i)), error)
                if (allocated(error)) return
            end do
        end do
    end subroutine test_joints_in_space

    subroutine test_joints_in_plane(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=*), parameter :: kind(4) = [character(len=13) :: 'fixed', 'revolute', 'prismatic', 'point_on_line']
        integer, parameter :: rows(4) = [3, 2, 2, 1]
        character(len=*), parameter :: between(2, 3) = reshape([character(len=6) :: 'first', 'second', 'ground', 'first', &
            'second', 'ground'], [2, 3])
        type(mechanism_type) :: mechanism
        type(failure_type), allocatable :: failure
        integer :: i, k

        do i = 1, size(kind)
            do k = 1, 3
                call draw(mechanism, .true.)
                call mechanism%add_joint('it', trim(kind(i)), trim(between(1, k)), trim(between(2, k)), failure, &
                    at=[0.7_wp, 0.5_wp], axis=[1.0_wp, 2.0_wp])
                call check_no_failure(error, failure)
                call verify(mechanism, trim(kind(i))//' '//trim(between(1, k)), error)
                call check_count(error, mechanism%n_holonomic, rows(i), trim(kind(i))//': rows')
                call check_drawing(mechanism, trim(kind(i)), error)
                if (allocated(error)) return
            end do
        end do
    end subroutine test_joints_in_plane

    subroutine test_driven(error)
        type(error_type), allocatable, intent(out) :: error
        type(sine_type), parameter :: swing = sine_type(offset=0.9_wp, amplitude=0.3_wp, rate=2.0_wp, phase=0.5_wp)
        character(len=*), parameter :: kind(3) = [character(len=13) :: 'revolute', 'prismatic', 'point_on_line']
        type(mechanism_type) :: mechanism
        type(failure_type), allocatable :: failure
        type(polynomial_type) :: law
        logical :: planar
        integer :: i, k, n

        allocate (law%coefficient, source=[0.1_wp, 2.0_wp, -0.3_wp, 0.2_wp])
        do k = 1, 2
            planar = k == 1
            n = merge(2, 3, planar)
            associate (at => [0.7_wp, 0.5_wp, 0.2_wp], axis => [1.0_wp, 2.0_wp, -0.5_wp])
                do i = 1, 3
                    call draw(mechanism, planar)
                    call mechanism%add_joint('it', trim(kind(i)), 'first', 'second', failure, at=at(:n), axis=axis(:n), &
                        motion=law)
                    call check_no_failure(error, failure)
                    call verify(mechanism, 'driven '//trim(kind(i)), error)
                end do
            end associate
            call draw(mechanism, planar)
            call mechanism%add_distance('rod', 'first.tip', 'second.tip', failure)
            call check_no_failure(error, failure)
            call mechanism%add_distance('ram', 'second.tip', 'ground', failure, motion=swing)
            call check_no_failure(error, failure)
            call mechanism%add_distance('leash', 'first', 'ground', failure, length=0.3_wp)
            call check_no_failure(error, failure)
            call verify(mechanism, 'distances', error)
        end do
    end subroutine test_driven

    subroutine test_forces(error)
        type(error_type), allocatable, intent(out) :: error
        type(sine_type), parameter :: swing = sine_type(offset=0.9_wp, amplitude=0.3_wp, rate=2.0_wp, phase=0.5_wp)
        type(mechanism_type) :: mechanism
        type(failure_type), allocatable :: failure
        real(wp), parameter :: force(3) = [3.0_wp, -2.0_wp, 1.0_wp], torque(3) = [0.5_wp, 1.5_wp, -2.0_wp]
        integer :: k, n

        do k = 1, 2
            n = merge(2, 3, k == 1)
            call draw(mechanism, k == 1)
            call mechanism%add_spring('between', 'first.tip', 'second.tip', failure, stiffness=20.0_wp, damping=3.0_wp, &
                length=0.4_wp, motion=swing)
            call check_no_failure(error, failure)
            call mechanism%add_spring('to_ground', 'ground', 'second.tip', failure, stiffness=7.0_wp, damping=0.5_wp)
            call check_no_failure(error, failure)
            call verify(mechanism, 'springs', error)

            call draw(mechanism, k == 1)
            if (k == 1) then
                call mechanism%add_joint('pin', 'revolute', 'first', 'second', failure, at=[0.7_wp, 0.5_wp])
            else
                call mechanism%add_joint('pin', 'revolute', 'first', 'second', failure, at=[0.7_wp, 0.5_wp, 0.2_wp], &
                    axis=[1.0_wp, 2.0_wp, -0.5_wp])
            end if
            call check_no_failure(error, failure)
            call mechanism%add_torsion('coil', 'pin', failure, stiffness=5.0_wp, damping=0.7_wp, angle=0.2_wp, motion=swing)
            call check_no_failure(error, failure)
            call verify(mechanism, 'torsional spring', error)

            call draw(mechanism, k == 1)
            call mechanism%add_load('push', 'first.tip', failure, force=force(:n))
            call check_no_failure(error, failure)
            call mechanism%add_load('thrust', 'second.tip', failure, force=force(:n), in_body=.true., motion=swing)
            call check_no_failure(error, failure)
            call mechanism%add_load('twist', 'first', failure, torque=torque(4 - merge(1, 3, k == 1):), motion=swing)
            call check_no_failure(error, failure)
            call mechanism%add_load('motor', 'second', failure, torque=torque(4 - merge(1, 3, k == 1):), in_body=.true.)
            call check_no_failure(error, failure)
            call verify(mechanism, 'loads', error)
        end do
    end subroutine test_forces

    subroutine test_rolling(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type) :: mechanism
        type(failure_type), allocatable :: failure

        call draw(mechanism, .true.)
        call mechanism%add_knife_edge('blade', 'first.tip', [0.3_wp, 1.0_wp], failure)
        call check_no_failure(error, failure)
        call verify(mechanism, 'knife edge in the plane', error)
        call draw(mechanism, .false.)
        call mechanism%add_knife_edge('blade', 'second.tip', [0.3_wp, 1.0_wp, 0.5_wp], failure)
        call check_no_failure(error, failure)
        call verify(mechanism, 'knife edge in space', error)
        call draw(mechanism, .false.)
        call mechanism%add_rolling_disk('coin', 'first', 0.8_wp, [1.0_wp, 0.2_wp, 0.3_wp], failure, plane=plane_type(open=.true.))
        call check_no_failure(error, failure)
        call mechanism%add_rolling_disk('wheel', 'second.tip', 0.4_wp, [1.0_wp, 0.2_wp, 0.3_wp], failure, &
            plane=plane_type(normal=[0.1_wp, 0.9_wp, -0.4_wp], height=-0.2_wp, open=.true.))
        call check_no_failure(error, failure)
        call verify(mechanism, 'disks', error)
        call draw(mechanism, .false.)
        call mechanism%add_rolling_sphere('ball', 'first', 0.8_wp, failure, plane=plane_type(open=.true.))
        call check_no_failure(error, failure)
        call mechanism%add_rolling_sphere('globe', 'second.tip', 0.4_wp, failure, &
            plane=plane_type(normal=[0.1_wp, 0.9_wp, -0.4_wp], open=.true.))
        call check_no_failure(error, failure)
        call verify(mechanism, 'spheres', error)
    end subroutine test_rolling

    !> Every error states the element and the remedy, and leaves the mechanism unchanged.
    subroutine test_words(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type) :: mechanism
        type(failure_type), allocatable :: failure
        real(wp), parameter :: at(3) = [0.7_wp, 0.5_wp, 0.2_wp], x(3) = [1.0_wp, 0.0_wp, 0.0_wp], nowhere(3) = 0.0_wp

        call mechanism%define(failure)
        call expect('has no body')
        ! A point is no body, and after this refusal a body can still be added.
        call mechanism%add_point('ground', 'hook', [0.0_wp, 0.0_wp, 0.0_wp], failure)
        if (.not. allocated(failure)) call mechanism%define(failure)
        call expect('has no body')
        call mechanism%add_body('late', 1.0_wp, [0.0_wp, 0.0_wp, 0.0_wp], failure, inertia=[1.0_wp, 1.0_wp, 1.0_wp])
        if (.not. allocated(failure)) call mechanism%define(failure)
        call check_no_failure(error, failure)
        mechanism = mechanism_type()
        call draw(mechanism, .false.)
        call mechanism%add_body('first', 1.0_wp, at, failure)
        call expect('there is another "first" already, a body')
        call mechanism%add_body('a.b', 1.0_wp, at, failure)
        call expect('is not a valid name')
        call mechanism%add_body('heavy', -1.0_wp, at, failure)
        call expect('body heavy has the mass -1')
        call mechanism%add_body('heavy', 1.0_wp, at(:2), failure)
        call expect('body heavy: position has 2 entries')
        call mechanism%add_body('heavy', 1.0_wp, at, failure, inertia=[1.0_wp, -1.0_wp, 1.0_wp])
        call expect('negative moment')
        call mechanism%add_body('heavy', 1.0_wp, at, failure, inertia=[1.0_wp])
        call expect('1 moments of inertia')
        call mechanism%add_point('third', 'tip', at, failure)
        call expect('there is no body third')
        call mechanism%add_point('first', 'tip', at, failure)
        call expect('first.tip exists already')
        call mechanism%add_joint('pin', 'hinge', 'first', 'second', failure, at=at)
        call expect('joint pin has the unknown type hinge; use one of fixed, revolute')
        call mechanism%add_joint('pin', 'revolute', 'first', 'second', failure, at=at)
        call expect('joint pin has no axis')
        call mechanism%add_joint('pin', 'revolute', 'first', 'second', failure, axis=x)
        call expect('joint pin has no position')
        call mechanism%add_joint('pin', 'revolute', 'first', 'second', failure, at=at, axis=nowhere)
        call expect('axis is zero')
        call mechanism%add_joint('pin', 'revolute', 'first', 'first', failure, at=at, axis=x)
        call expect('joint pin connects a body to itself')
        call mechanism%add_joint('pin', 'revolute', 'first', 'third', failure, at=at, axis=x)
        call expect('joint pin: there is no body third')
        call mechanism%add_joint('pin', 'revolute', 'first.end', 'second', failure, at=at, axis=x)
        call expect('the body first has no point end')
        call mechanism%add_joint('pin', 'revolute', 'first.tip', 'second.tip', failure, axis=x)
        call expect('m apart in the reference configuration')
        call mechanism%add_joint('pin', 'universal', 'first', 'second', failure, at=at, axis=x, across=x)
        call expect('parallel to the axis')
        call mechanism%add_joint('pin', 'universal', 'first', 'second', failure, at=at, axis=x, across=at)
        call expect('not perpendicular: their cosine is 0.79')
        call mechanism%add_joint('pin', 'spherical', 'first', 'second', failure, at=at, motion=ramp(0.0_wp, 1.0_wp))
        call expect('joint pin cannot be driven')
        call mechanism%add_distance('rod', 'first.tip', 'second.tip', failure, length=0.0_wp)
        call expect('distance rod has the length 0')
        call mechanism%add_torsion('coil', 'pin', failure)
        call expect('torsion coil: there is no joint pin')
        call mechanism%add_load('push', 'ground', failure, force=x)
        call expect('load push acts on the ground')
        call mechanism%add_knife_edge('blade', 'ground', x, failure)
        call expect('knife edge blade is on the ground')
        call mechanism%add_rolling_disk('coin', 'first', 0.0_wp, x, failure)
        call expect('radius that is not positive')
        call mechanism%add_rolling_disk('coin', 'first', 1.0_wp, x, failure, plane=plane_type(normal=x))
        call expect('lies flat')
        call mechanism%add_rolling_disk('coin', 'first', 1.0_wp, x, failure)
        call expect('rolling disk coin is -1.1')
        call mechanism%add_joint('pin', 'spherical', 'first', 'second', failure, at=at)
        call check_no_failure(error, failure)
        call mechanism%add_torsion('coil', 'pin', failure)
        call expect('the joint pin has no coordinate')
        call mechanism%define(failure)
        call check_no_failure(error, failure)
        call check_count(error, mechanism%n_holonomic, 5, 'rows')
        call mechanism%define(failure)
        call expect('is already defined')

    contains

        subroutine expect(text)
            character(len=*), intent(in) :: text

            call check_true(error, allocated(failure), 'no error: '//text)
            if (.not. allocated(failure)) return
            call check_true(error, index(failure%message, text) > 0, failure%message//' instead of '//text)
        end subroutine expect
    end subroutine test_words
end module test_mechanism_elements
