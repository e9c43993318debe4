! SPDX-License-Identifier: MIT
!> Tests of closed loops in space whose joints have more rows than there are coordinates, as most linkages of hinges: four-bars in a
!> row, Bennett's linkage, a driven Cardan shaft, each against closed forms.
module test_closed_loops
    use asserts, only: check_below, check_close, check_count, check_no_failure, check_true
    use mechanism_checks, only: go
    use runs, only: run
    use tandem, only: failure_type => error_type, mechanism_type, options_type, ramp, simulation_type, wp
    use tandem_mechanism_vector, only: cross
    use tandem_rigid_euler_parameters, only: rotation
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_closed_loops

contains

    !> The suite.
    subroutine collect_closed_loops(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('four-bars-of-hinges-in-space', test_four_bars), &
            new_unittest('bennett', test_bennett), &
            new_unittest('cardan-shaft', test_cardan)]
    end subroutine collect_closed_loops

    !> A02 of the IFToMM library with hinges in space, three redundant rows per bay: dense and sparse charts, implicit steps too.
    subroutine test_four_bars(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: bays(4) = [1, 2, 2, 40]
        character(len=*), parameter :: kinds(4) = [character(len=9) :: 'automatic', 'dense', 'sparse', 'automatic']
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)
        real(wp) :: top(3)
        integer :: k

        do k = 1, size(bays)
            call draw_four_bars(mechanism, bays(k), error)
            call mechanism%define(failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            if (allocated(q)) deallocate (q, qd)
            allocate (q(mechanism%n), qd(mechanism%n))
            call mechanism%start(q, qd)
            call check_true(error, mechanism%n_constraints() > mechanism%n, 'more rows than coordinates')
            options%stepper = 'dop853'
            options%rtol = 1.0e-11_wp
            options%chart_kind = kinds(k)
            call run(simulation, mechanism, options, 0.0_wp, q, qd, 0.6_wp, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call check_count(error, simulation%n_redundant, 3*bays(k), 'redundant rows')
            top = simulation%state%q(1:3) + matmul(rotation(simulation%state%q(4:7)), [0.0_wp, 0.0_wp, 0.5_wp])
            call check_close(error, top([1, 3]), place_of_b0(bays(k)), 1.0e-9_wp, 'B0')
            if (allocated(error)) return
        end do
        call draw_four_bars(mechanism, 1, error)
        call go(mechanism, 1.0e-9_wp, 0.6_wp, simulation, error, stepper='radau5')
        if (allocated(error)) return
        top = simulation%state%q(1:3) + matmul(rotation(simulation%state%q(4:7)), [0.0_wp, 0.0_wp, 0.5_wp])
        call check_close(error, top([1, 3]), place_of_b0(1), 1.0e-7_wp, 'B0 by implicit steps')
    end subroutine test_four_bars

    !> B0 at 0.6 s. As long as the uprights stay parallel the system is a pendulum that falls over: theta'' = k sin(theta), here by
    !> many steps of Kutta's method.
    pure function place_of_b0(n) result(place)
        integer, intent(in) :: n
        real(wp) :: place(2), y(2), s(2, 4), k
        integer, parameter :: steps = 6000
        real(wp), parameter :: h = 0.6_wp/steps
        integer :: i

        k = 9.81_wp*(0.5_wp*(n + 1) + n)/((n + 1)/3.0_wp + n)
        y = [0.0_wp, 1.0_wp]
        do i = 1, steps
            s(:, 1) = [y(2), k*sin(y(1))]
            s(:, 2) = [y(2) + 0.5_wp*h*s(2, 1), k*sin(y(1) + 0.5_wp*h*s(1, 1))]
            s(:, 3) = [y(2) + 0.5_wp*h*s(2, 2), k*sin(y(1) + 0.5_wp*h*s(1, 2))]
            s(:, 4) = [y(2) + h*s(2, 3), k*sin(y(1) + h*s(1, 3))]
            y = y + h/6.0_wp*(s(:, 1) + 2.0_wp*s(:, 2) + 2.0_wp*s(:, 3) + s(:, 4))
        end do
        place = [sin(y(1)), cos(y(1))]
    end function place_of_b0

    !> Uprights and couplers of 1 m and 1 kg in a row, every hinge about y.
    subroutine draw_four_bars(mechanism, n, error)
        type(mechanism_type), intent(inout), target :: mechanism
        integer, intent(in) :: n
        type(error_type), allocatable, intent(inout) :: error
        type(mechanism_type) :: blank
        type(failure_type), allocatable :: failure
        real(wp), parameter :: inertia(3) = [1/12.0_wp, 1/12.0_wp, 1/12.0_wp], y(3) = [0.0_wp, 1.0_wp, 0.0_wp]
        character(len=12) :: name(0:2*n)
        integer :: i

        if (allocated(error)) return
        mechanism = blank
        mechanism%gravity = [0.0_wp, 0.0_wp, -9.81_wp]
        do i = 0, n
            write (name(i), '(a, i0)') 'upright', i
            call mechanism%add_body(trim(name(i)), 1.0_wp, [real(i, wp), 0.0_wp, 0.5_wp], failure, inertia=inertia, &
                velocity=[0.5_wp, 0.0_wp, 0.0_wp], omega=[0.0_wp, 1.0_wp, 0.0_wp])
            call check_no_failure(error, failure)
            call mechanism%add_joint('foot'//name(i)(8:), 'revolute', 'ground', trim(name(i)), failure, &
                at=[real(i, wp), 0.0_wp, 0.0_wp], axis=y)
            call check_no_failure(error, failure)
        end do
        do i = 1, n
            write (name(n + i), '(a, i0)') 'coupler', i
            call mechanism%add_body(trim(name(n + i)), 1.0_wp, [i - 0.5_wp, 0.0_wp, 1.0_wp], failure, inertia=inertia, &
                velocity=[1.0_wp, 0.0_wp, 0.0_wp])
            call check_no_failure(error, failure)
            call mechanism%add_joint('left'//name(i)(8:), 'revolute', trim(name(i - 1)), trim(name(n + i)), failure, &
                at=[i - 1.0_wp, 0.0_wp, 1.0_wp], axis=y)
            call check_no_failure(error, failure)
            call mechanism%add_joint('right'//name(i)(8:), 'revolute', trim(name(i)), trim(name(n + i)), failure, &
                at=[real(i, wp), 0.0_wp, 1.0_wp], axis=y)
            call check_no_failure(error, failure)
        end do
    end subroutine draw_four_bars

    !> Bennett's linkage (1903): four hinges whose axes neither intersect nor are parallel, but which is movable if opposite links
    !> have equal lengths and twists, with sines of the twists in the ratio of the lengths. Then tan(theta/2) tan(phi/2) of
    !> neighbouring hinges is constant. It has two redundant rows and one degree of freedom.
    subroutine test_bennett(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: inertia(3) = [0.1_wp, 0.08_wp, 0.05_wp]
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: joint(3, 4), axis(3, 4), before, after, kinetic, potential, energy
        integer :: stat

        call place_bennett(joint, axis)
        mechanism%gravity = [0.0_wp, -2.0_wp, -9.81_wp]
        call mechanism%add_body('first', 1.0_wp, 0.5_wp*(joint(:, 1) + joint(:, 2)), failure, inertia=inertia)
        call check_no_failure(error, failure)
        call mechanism%add_body('second', 1.0_wp, 0.5_wp*(joint(:, 2) + joint(:, 3)), failure, inertia=inertia)
        call check_no_failure(error, failure)
        call mechanism%add_body('third', 1.0_wp, 0.5_wp*(joint(:, 3) + joint(:, 4)), failure, inertia=inertia)
        call check_no_failure(error, failure)
        call mechanism%add_joint('j1', 'revolute', 'ground', 'first', failure, at=joint(:, 1), axis=axis(:, 1))
        call check_no_failure(error, failure)
        call mechanism%add_joint('j2', 'revolute', 'first', 'second', failure, at=joint(:, 2), axis=axis(:, 2))
        call check_no_failure(error, failure)
        call mechanism%add_joint('j3', 'revolute', 'second', 'third', failure, at=joint(:, 3), axis=axis(:, 3))
        call check_no_failure(error, failure)
        call mechanism%add_joint('j4', 'revolute', 'third', 'ground', failure, at=joint(:, 4), axis=axis(:, 4))
        call check_no_failure(error, failure)
        before = product_of_tangents(joint(:, 2), joint(:, 3))
        call go(mechanism, 1.0e-11_wp, 0.7_wp, simulation, error)
        if (allocated(error)) return
        call check_count(error, mechanism%n_constraints(), 23, 'rows')
        call check_count(error, simulation%n_redundant, 3, 'redundant rows')
        associate (q => simulation%state%q)
            after = product_of_tangents(q(1:3) + matmul(rotation(q(4:7)), 0.5_wp*(joint(:, 2) - joint(:, 1))), &
                q(15:17) + matmul(rotation(q(18:21)), 0.5_wp*(joint(:, 3) - joint(:, 4))))
            call check_below(error, abs(after/before - 1.0_wp), 1.0e-10_wp, 'tan(theta/2) tan(phi/2)')
            call check_true(error, 2*acos(abs(q(4))) > 0.5_wp, 'it has hardly moved')
        end associate
        call simulation%kinetic_energy(kinetic, stat)
        call simulation%potential_energy(potential, stat)
        energy = kinetic + potential - sum([0.5_wp, 0.5_wp, 0.5_wp]*[ &
            dot_product([0.0_wp, 2.0_wp, 9.81_wp], joint(:, 1) + joint(:, 2)), &
            dot_product([0.0_wp, 2.0_wp, 9.81_wp], joint(:, 2) + joint(:, 3)), &
            dot_product([0.0_wp, 2.0_wp, 9.81_wp], joint(:, 3) + joint(:, 4))])
        call check_below(error, abs(energy), 1.0e-9_wp, 'energy')

    contains

        !> For the hinges on the ground, with the angles between their links; the moving parts are the other two.
        real(wp) function product_of_tangents(second, third)
            real(wp), intent(in) :: second(3), third(3)

            product_of_tangents = tan(0.5_wp*angle(joint(:, 1) - joint(:, 4), second - joint(:, 1), axis(:, 1)))* &
                tan(0.5_wp*angle(joint(:, 4) - third, joint(:, 1) - joint(:, 4), axis(:, 4)))
        end function product_of_tangents

        !> From a to b about an axis.
        real(wp) function angle(a, b, about)
            real(wp), intent(in) :: a(3), b(3), about(3)

            angle = atan2(dot_product(about, cross(a, b)), dot_product(a, b))
        end function angle
    end subroutine test_bennett

    !> Positions and axes of the four hinges: lengths 1 and sin(beta)/sin(alpha), alternating twists alpha and beta, closed by
    !> rotations about each axis (Denavit and Hartenberg's convention), with the angles of the linkage's own relation.
    subroutine place_bennett(joint, axis)
        real(wp), intent(out) :: joint(3, 4), axis(3, 4)
        real(wp), parameter :: alpha = 0.7_wp, beta = 1.2_wp, theta = 0.9_wp
        real(wp) :: frame(3, 3), place(3), turn(4), length(4), twist(4), s, c
        integer :: i

        length = [1.0_wp, sin(beta)/sin(alpha), 1.0_wp, sin(beta)/sin(alpha)]
        twist = [alpha, beta, alpha, beta]
        ! tan(theta_1/2) tan(theta_2/2) = sin((beta + alpha)/2)/sin((beta - alpha)/2), and theta_3 = -theta_1, theta_4 = -theta_2.
        turn(1) = theta
        turn(2) = 2*atan(sin(0.5_wp*(beta + alpha))/sin(0.5_wp*(beta - alpha))/tan(0.5_wp*theta))
        turn(3:4) = -turn(1:2)
        frame = reshape([1, 0, 0, 0, 1, 0, 0, 0, 1], [3, 3])
        place = 0.0_wp
        do i = 1, 4
            joint(:, i) = place
            axis(:, i) = frame(:, 3)
            c = cos(turn(i))
            s = sin(turn(i))
            frame = matmul(frame, reshape([c, s, 0.0_wp, -s, c, 0.0_wp, 0.0_wp, 0.0_wp, 1.0_wp], [3, 3]))
            place = place + length(i)*frame(:, 1)
            c = cos(twist(i))
            s = sin(twist(i))
            frame = matmul(frame, reshape([1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, c, s, 0.0_wp, -s, c], [3, 3]))
        end do
        if (norm2(place) > 1.0e-12_wp) error stop 'the linkage is not closed'
    end subroutine place_bennett

    !> A motor-driven shaft drives another one at an angle of 0.5 by a universal joint: tan(out) = tan(in) cos(0.5), where the
    !> cross's axis on the driving shaft is initially across the plane of both. Two redundant rows, and no degree of freedom.
    subroutine test_cardan(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: bend = 0.5_wp, rate = 3.0_wp, t = 0.8_wp
        real(wp), parameter :: x(3) = [1.0_wp, 0.0_wp, 0.0_wp], out(3) = [cos(bend), sin(bend), 0.0_wp]
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: expected, turned, spin(3)

        call mechanism%add_body('in', 1.0_wp, -0.2_wp*x, failure, inertia=[0.1_wp, 0.2_wp, 0.2_wp], omega=rate*x)
        call check_no_failure(error, failure)
        ! The cross lies with one axis across the plane of both shafts: there the second one turns cos(bend) times as fast.
        call mechanism%add_body('out', 1.0_wp, 0.2_wp*out, failure, inertia=[0.1_wp, 0.2_wp, 0.2_wp], omega=rate*cos(bend)*out)
        call check_no_failure(error, failure)
        call mechanism%add_joint('motor', 'revolute', 'ground', 'in', failure, at=-0.2_wp*x, axis=x, motion=ramp(0.0_wp, rate))
        call check_no_failure(error, failure)
        call mechanism%add_joint('cross', 'universal', 'in', 'out', failure, at=[0.0_wp, 0.0_wp, 0.0_wp], &
            axis=[0.0_wp, 0.0_wp, 1.0_wp], across=[-sin(bend), cos(bend), 0.0_wp])
        call check_no_failure(error, failure)
        call mechanism%add_joint('bearing', 'cylindrical', 'out', 'ground', failure, at=0.3_wp*out, axis=out)
        call check_no_failure(error, failure)
        call go(mechanism, 1.0e-11_wp, t, simulation, error)
        if (allocated(error)) return
        call check_count(error, mechanism%n_constraints() - mechanism%n, 2, 'rows beyond coordinates')
        ! The cross's axis on the driving shaft begins across the plane of both.
        expected = atan2(sin(rate*t)*cos(bend), cos(rate*t))
        associate (q => simulation%state%q, qd => simulation%state%qd)
            turned = 2*atan2(dot_product(q(12:14), out), q(11))
            call check_below(error, abs(sin(turned - expected)), 1.0e-9_wp, 'angle of the driven shaft')
            ! omega = 2 (e0 e' - e0' e + e x e').
            spin = 2*(q(11)*qd(12:14) - qd(11)*q(12:14) + cross(q(12:14), qd(12:14)))
        end associate
        call check_close(error, spin, out*rate*cos(bend)/(cos(rate*t)**2 + (sin(rate*t)*cos(bend))**2), 1.0e-9_wp, &
            'rate of the driven shaft')
    end subroutine test_cardan
end module test_closed_loops
