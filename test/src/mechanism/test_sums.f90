! SPDX-License-Identifier: MIT
!> Tests of sums of joint coordinates that are coordinates with an inertia (rotors of joints, tendons) against differences and
!> closed forms, and of the doubt about impossible inertias.
module test_sums
    use asserts, only: check_close, check_failure, check_no_failure, check_true
    use mechanism_checks, only: draw, verify
    use tandem, only: failure_type => error_type, mechanism_type, options_type, simulation_type, wp
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_sums

    real(wp), parameter :: g = 9.81_wp, origin(3) = 0.0_wp, x(3) = [1.0_wp, 0.0_wp, 0.0_wp], y(3) = [0.0_wp, 1.0_wp, 0.0_wp]

contains

    !> The suite.
    subroutine collect_sums(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('procedures-agree-with-differences', test_procedures), &
            new_unittest('a-rotor-slows-a-pendulum', test_rotor), &
            new_unittest('a-spring-on-a-sum-acts-on-all-its-joints', test_tendon), &
            new_unittest('successive-angles-of-a-gimbal', test_gimbal), &
            new_unittest('an-impossible-inertia-is-a-warning', test_doubt), &
            new_unittest('a-motion-without-mass-is-named', test_massless), &
            new_unittest('words-name-what-is-wrong', test_words)]
    end subroutine collect_sums

    !> A sum of two joints, and a sum of that sum and another joint, with forces along both.
    subroutine test_procedures(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type) :: mechanism
        type(failure_type), allocatable :: failure

        call draw(mechanism, .false.)
        call mechanism%add_joint('pin', 'revolute', 'ground', 'first', failure, at=origin, axis=[1.0_wp, 2.0_wp, -0.5_wp])
        call check_no_failure(error, failure)
        call mechanism%add_joint('rail', 'cylindrical', 'first', 'second', failure, at=x, axis=[0.3_wp, -1.0_wp, 0.5_wp])
        call check_no_failure(error, failure)
        call mechanism%add_coupling('sum', [character(len=17) :: 'pin', 'rail.angle'], [1.5_wp, -0.7_wp], failure, inertia=0.3_wp)
        call check_no_failure(error, failure)
        call mechanism%add_coupling('both', [character(len=17) :: 'sum', 'rail.displacement'], [2.0_wp, 1.0_wp], failure, &
            inertia=0.0_wp)
        call check_no_failure(error, failure)
        call mechanism%add_torsion('coil', 'sum', failure, stiffness=5.0_wp, damping=0.2_wp, angle=0.3_wp)
        call check_no_failure(error, failure)
        call mechanism%add_torsion('cord', 'both', failure, stiffness=3.0_wp)
        call check_no_failure(error, failure)
        call verify(mechanism, 'sums', error)
        if (allocated(error)) return
        call check_true(error, mechanism%coordinate_label(15)//mechanism%unit_of_coordinate(15) == 'sum.displacementrad', &
            'name and unit of the sum')
    end subroutine test_procedures

    !> A rod of length 1 on a hinge with the rotor J: alpha = m g l/2/(m l^2/3 + J), and the energy includes the rotor's.
    subroutine test_rotor(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), parameter :: rotor = 0.5_wp, omega = 0.3_wp, inertia = 1/3.0_wp + rotor
        real(wp), allocatable :: q(:), qd(:), qdd(:)
        real(wp) :: kinetic
        integer :: stat

        call mechanism%add_body('rod', 1.0_wp, 0.5_wp*x, failure, inertia=[0.0_wp, 1/12.0_wp, 1/12.0_wp], &
            velocity=[0.0_wp, 0.0_wp, -0.5_wp*omega], omega=omega*y)
        mechanism%gravity = [0.0_wp, 0.0_wp, -g]
        call mechanism%add_joint('pin', 'revolute', 'ground', 'rod', failure, at=origin, axis=y)
        call check_no_failure(error, failure)
        call mechanism%add_coupling('rotor', ['pin'], [1.0_wp], failure, inertia=rotor)
        call check_no_failure(error, failure)
        call mechanism%define(failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        allocate (q(mechanism%n), qd(mechanism%n), qdd(mechanism%n))
        call mechanism%start(q, qd)
        call check_close(error, [qd(8)], [omega], epsilon(1.0_wp), 'rate of the rotor')
        options%rtol = 1.0e-9_wp
        call simulation%initialize(mechanism, options, 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        qdd = simulation%state%qdd
        call check_close(error, [qdd(8)], [g/2/inertia], 1.0e-13_wp, 'acceleration of the rotor')
        call simulation%kinetic_energy(kinetic, stat)
        call check_close(error, [kinetic], [inertia*omega**2/2], 1.0e-14_wp, 'kinetic energy')
    end subroutine test_rotor

    !> Two masses on rails, drawn by a spring on x1 + 2 x2: m1 a1 = -k c, m2 a2 = -2 k c at the stretch c. The sum has no inertia.
    subroutine test_tendon(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), parameter :: k = 30.0_wp, c = 0.1_wp
        real(wp), allocatable :: q(:), qd(:), qdd(:)

        call mechanism%add_body('a', 2.0_wp, origin, failure, inertia=[1.0_wp, 1.0_wp, 1.0_wp])
        call mechanism%add_body('b', 3.0_wp, y, failure, inertia=[1.0_wp, 1.0_wp, 1.0_wp])
        call mechanism%add_joint('ja', 'prismatic', 'ground', 'a', failure, at=origin, axis=x)
        call check_no_failure(error, failure)
        call mechanism%add_joint('jb', 'prismatic', 'ground', 'b', failure, at=y, axis=x)
        call check_no_failure(error, failure)
        call mechanism%add_coupling('tendon', ['ja', 'jb'], [1.0_wp, 2.0_wp], failure, inertia=0.0_wp)
        call check_no_failure(error, failure)
        call mechanism%add_torsion('spring', 'tendon', failure, stiffness=k, angle=-c)
        call check_no_failure(error, failure)
        call mechanism%define(failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        allocate (q(mechanism%n), qd(mechanism%n), qdd(mechanism%n))
        call mechanism%start(q, qd)
        call simulation%initialize(mechanism, options, 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        qdd = simulation%state%qdd
        call check_close(error, [qdd(1)], [-k*c/2], 1.0e-13_wp, 'acceleration of the first mass')
        call check_close(error, [qdd(8)], [-2*k*c/3], 1.0e-13_wp, 'acceleration of the second mass')
    end subroutine test_tendon

    !> Springs along the angles of a universal joint and of a gimbal against differences; the angles of a gimbal that is drawn at
    !> rest and then turned by a about x, b about y and c about a third axis on the body.
    subroutine test_gimbal(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type) :: mechanism
        type(failure_type), allocatable :: failure
        real(wp), parameter :: angles(3) = [2.5_wp, -0.7_wp, -1.9_wp], stiffness(3) = [3.0_wp, 5.0_wp, 7.0_wp], &
            last(3) = [0.6_wp, 0.0_wp, 0.8_wp]
        real(wp) :: q(8), energy
        integer :: k, stat

        call draw(mechanism, .false.)
        call mechanism%add_joint('cross', 'universal', 'first', 'second', failure, at=y, axis=x, across=y)
        call check_no_failure(error, failure)
        call mechanism%add_joint('shoulder', 'gimbal', 'ground', 'first', failure, at=origin, axis=[1.0_wp, 0.2_wp, -0.5_wp], &
            across=[0.3_wp, -1.0_wp, 0.5_wp])
        call check_no_failure(error, failure)
        call add_springs(['cross   ', 'shoulder'], [2, 3])
        call mechanism%add_coupling('rotor', ['shoulder.angle1'], [1.0_wp], failure, inertia=0.3_wp)
        call check_no_failure(error, failure)
        call verify(mechanism, 'angles', error)

        mechanism = mechanism_type()
        call mechanism%add_body('arm', 1.0_wp, origin, failure, inertia=[1.0_wp, 1.0_wp, 1.0_wp])
        call mechanism%add_joint('shoulder', 'gimbal', 'ground', 'arm', failure, at=origin, axis=x, across=last)
        call check_no_failure(error, failure)
        call add_springs(['shoulder'], [3])
        call mechanism%add_coupling('rotor', ['shoulder.angle2'], [1.0_wp], failure, inertia=0.3_wp)
        call check_no_failure(error, failure)
        call verify(mechanism, 'middle angle', error)
        if (allocated(error)) return
        q = 0.0_wp
        q(4:7) = product_of(product_of(turn(angles(1), x), turn(angles(2), y)), turn(angles(3), last))
        call mechanism%potential_energy(0.0_wp, q, energy, stat)
        call check_close(error, [energy], [sum(stiffness*angles**2)/2], 1.0e-13_wp, 'energy of the springs')
        ! The arc sine is singular at a middle angle of 90 degrees; this one has 86.
        mechanism = mechanism_type()
        call mechanism%add_body('arm', 1.0_wp, origin, failure, inertia=[1.0_wp, 1.0_wp, 1.0_wp])
        call mechanism%add_joint('shoulder', 'gimbal', 'ground', 'arm', failure, at=origin, axis=x, &
            across=[1.0_wp, 0.07_wp, 0.0_wp])
        call check_no_failure(error, failure)
        call add_springs(['shoulder'], [3])
        call mechanism%add_coupling('rotor', ['shoulder.angle2'], [1.0_wp], failure, inertia=0.3_wp)
        call check_no_failure(error, failure)
        call verify(mechanism, 'steep middle angle', error)

    contains

        subroutine add_springs(joints, n)
            character(len=*), intent(in) :: joints(:)
            integer, intent(in) :: n(:)
            character(len=1) :: digit
            integer :: i

            do i = 1, size(joints)
                do k = 1, n(i)
                    digit = achar(iachar('0') + k)
                    call mechanism%add_torsion(trim(joints(i))//'_'//digit, trim(joints(i))//'.angle'//digit, failure, &
                        stiffness=stiffness(k))
                    call check_no_failure(error, failure)
                end do
            end do
        end subroutine add_springs

        !> Euler parameters of a rotation.
        pure function turn(angle, axis) result(p)
            real(wp), intent(in) :: angle, axis(3)
            real(wp) :: p(4)

            p = [cos(angle/2), sin(angle/2)*axis]
        end function turn

        pure function product_of(p, r) result(s)
            real(wp), intent(in) :: p(4), r(4)
            real(wp) :: s(4)

            s(1) = p(1)*r(1) - dot_product(p(2:4), r(2:4))
            s(2:4) = p(1)*r(2:4) + r(1)*p(2:4) + [p(3)*r(4) - p(4)*r(3), p(4)*r(2) - p(2)*r(4), p(2)*r(3) - p(3)*r(2)]
        end function product_of
    end subroutine test_gimbal

    !> Moments of 1, 1 and 3: the run has a warning that names the body; a negative moment within rounding is zero.
    subroutine test_doubt(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: q(7), qd(7)

        call mechanism%add_body('plate', 1.0_wp, origin, failure, inertia=[1.0_wp, 1.0_wp, 3.0_wp])
        call check_no_failure(error, failure)
        call mechanism%define(failure)
        call check_no_failure(error, failure)
        call mechanism%start(q, qd)
        call simulation%initialize(mechanism, options, 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call check_true(error, allocated(simulation%warnings), 'a warning')
        if (allocated(error)) return
        call check_true(error, index(simulation%warnings(1)%text, 'body plate has a moment of inertia that is larger') == 1, &
            simulation%warnings(1)%text)
        mechanism = mechanism_type()
        call mechanism%add_body('rod', 1.0_wp, origin, failure, inertia=[-1.0e-13_wp, 1.0_wp, 1.0_wp])
        call check_no_failure(error, failure)
    end subroutine test_doubt

    !> A rod that rotates about itself has no inertia; a free body without mass has no joint.
    subroutine test_massless(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: mechanism
        type(failure_type), allocatable :: failure

        call add_arm()
        call mechanism%add_body('rod', 1.0_wp, 2*x, failure, inertia=[0.0_wp, 1.0_wp, 1.0_wp])
        call mechanism%add_joint('wrist', 'revolute', 'arm', 'rod', failure, at=x, axis=x)
        call check_message('the body "rod" moves without mass in the joint "wrist"')
        call add_arm()
        call mechanism%add_body('ghost', 0.0_wp, 2*x, failure, inertia=[0.0_wp, 0.0_wp, 0.0_wp])
        call check_message('the body "ghost" moves without mass;')

    contains

        subroutine add_arm()
            mechanism = mechanism_type()
            call mechanism%add_body('arm', 1.0_wp, x, failure, inertia=[1.0_wp, 1.0_wp, 1.0_wp])
            call mechanism%add_joint('shoulder', 'revolute', 'ground', 'arm', failure, at=origin, axis=y)
        end subroutine add_arm

        subroutine check_message(text)
            character(len=*), intent(in) :: text
            type(simulation_type) :: simulation
            type(options_type) :: options
            real(wp) :: q(14), qd(14)

            call check_no_failure(error, failure)
            if (allocated(error)) return
            call mechanism%define(failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call mechanism%start(q, qd)
            call simulation%initialize(mechanism, options, 0.0_wp, q, qd, failure)
            call check_failure(error, failure, 'singular_mass', text)
        end subroutine check_message
    end subroutine test_massless

    !> Refused sums.
    subroutine test_words(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type) :: mechanism
        type(failure_type), allocatable :: failure

        call draw(mechanism, .false.)
        call mechanism%add_joint('pin', 'revolute', 'ground', 'first', failure, at=origin, axis=x)
        call check_no_failure(error, failure)
        call mechanism%add_coupling('sum', ['pin'], [1.0_wp], failure, inertia=-1.0_wp)
        call check_failure(error, failure, 'invalid_model', 'coupling sum has an inertia that is negative')
        call mechanism%add_coupling('sum', ['pin'], [1.0_wp], failure, locked=.true., inertia=1.0_wp)
        call check_failure(error, failure, 'invalid_model', 'with motion or locked')
        call mechanism%add_coupling('sum', ['pin'], [1.0_wp], failure)
        call check_no_failure(error, failure)
        call mechanism%add_torsion('coil', 'sum', failure, stiffness=1.0_wp)
        call check_failure(error, failure, 'invalid_model', 'the coupling sum has no coordinate')
    end subroutine test_words
end module test_sums
