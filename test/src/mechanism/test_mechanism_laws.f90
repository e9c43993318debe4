! SPDX-License-Identifier: MIT
!> Tests of functions, laws and expressions of mechanisms: against differences at random states, and runs with kinks and jumps
!> against closed forms.
module test_mechanism_laws
    use asserts, only: check_below, check_close, check_count, check_no_failure, check_true
    use mechanism_checks, only: draw, go, verify
    use tandem, only: constant_type, expression_function, expression_law, expression_type, failure_type => error_type, &
        mechanism_type, parse_expression, simulation_type, table_function, table_law, table_type, wp
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_mechanism_laws

    real(wp), parameter :: pi = acos(-1.0_wp)
    real(wp), parameter :: at(3) = [0.7_wp, 0.5_wp, 0.2_wp], axis(3) = [1.0_wp, 2.0_wp, -0.5_wp]

contains

    !> The suite.
    subroutine collect_mechanism_laws(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('motions-by-expression-and-table', test_motions), &
            new_unittest('laws-of-springs', test_laws), &
            new_unittest('loads-by-expression', test_loads), &
            new_unittest('bushings', test_bushings), &
            new_unittest('kinks-are-breakpoints', test_kinks), &
            new_unittest('a-motion-with-a-kink', test_kinked_motion), &
            new_unittest('a-force-that-jumps', test_jumping_force), &
            new_unittest('a-motion-that-jumps', test_jumping_motion)]
    end subroutine collect_mechanism_laws

    !> A parsed expression.
    function parsed(text, variables, error) result(expression)
        character(len=*), intent(in) :: text, variables(:)
        type(error_type), allocatable, intent(inout) :: error
        type(expression_type) :: expression
        type(failure_type), allocatable :: failure

        call parse_expression(expression, text, variables, failure)
        call check_no_failure(error, failure)
    end function parsed

    !> Imposed angles and displacements, a distance.
    subroutine test_motions(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type) :: mechanism
        type(failure_type), allocatable :: failure
        type(table_type) :: table
        integer :: k, n

        call table%initialize([0.0_wp, 0.3_wp, 0.6_wp, 1.0_wp], [0.0_wp, 0.2_wp, -0.1_wp, 0.3_wp], 'cubic', failure)
        call check_no_failure(error, failure)
        do k = 1, 2
            n = k + 1
            call draw(mechanism, k == 1)
            call mechanism%add_joint('it', 'revolute', 'first', 'second', failure, at=at(:n), axis=axis(:n), &
                motion=expression_function(parsed('0.4*sin(3*t) + t^2*exp(-t)', ['t'], error)))
            call check_no_failure(error, failure)
            call verify(mechanism, 'angle by expression', error)
            call draw(mechanism, k == 1)
            call mechanism%add_joint('it', 'prismatic', 'first', 'ground', failure, at=at(:n), axis=axis(:n), &
                motion=table_function(table))
            call check_no_failure(error, failure)
            call mechanism%add_distance('rod', 'first.tip', 'second.tip', failure, &
                motion=expression_function(parsed('0.5 + 0.1*cos(t)', ['t'], error)))
            call check_no_failure(error, failure)
            call verify(mechanism, 'way by table, distance by expression', error)
        end do
    end subroutine test_motions

    subroutine test_laws(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=*), parameter :: of_length(3) = [character(len=6) :: 't', 'length', 'rate'], &
            of_angle(3) = [character(len=6) :: 't', 'angle', 'rate']
        type(mechanism_type) :: mechanism
        type(failure_type), allocatable :: failure
        type(table_type) :: table
        integer :: k, n

        call table%initialize([0.0_wp, 0.5_wp, 1.5_wp, 3.0_wp], [0.0_wp, 2.0_wp, 1.0_wp, 7.0_wp], 'cubic', failure)
        call check_no_failure(error, failure)
        do k = 1, 2
            n = k + 1
            call draw(mechanism, k == 1)
            call mechanism%add_spring('one', 'first.tip', 'second.tip', failure, stiffness=3.0_wp, &
                law=expression_law(parsed('20*(length - 0.4)^3 + (1 + t)*rate*abs(rate)', of_length, error)))
            call check_no_failure(error, failure)
            call mechanism%add_spring('two', 'first', 'ground', failure, law=table_law(table))
            call check_no_failure(error, failure)
            call verify(mechanism, 'laws of springs', error)
            call draw(mechanism, k == 1)
            call mechanism%add_joint('pin', 'revolute', 'first', 'second', failure, at=at(:n), axis=axis(:n))
            call check_no_failure(error, failure)
            call mechanism%add_joint('rail', 'prismatic', 'ground', 'second', failure, at=at(:n), axis=axis(:n))
            call check_no_failure(error, failure)
            call mechanism%add_torsion('motor', 'pin', failure, damping=0.2_wp, &
                law=expression_law(parsed('2*sin(angle) + t*tanh(rate)', of_angle, error)))
            call check_no_failure(error, failure)
            call mechanism%add_torsion('ram', 'rail', failure, stiffness=4.0_wp, law=table_law(table))
            call check_no_failure(error, failure)
            call verify(mechanism, 'laws along joints', error)
        end do
    end subroutine test_laws

    !> Forces and torques by all variables of expressions.
    subroutine test_loads(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type) :: mechanism
        type(failure_type), allocatable :: failure
        type(expression_type), allocatable :: force(:), torque(:)
        integer :: k

        do k = 1, 2
            call draw(mechanism, .true.)
            call mechanism%add_joint('pin', 'revolute', 'first', 'second', failure, at=at(:2))
            call check_no_failure(error, failure)
            force = [parsed('-3*first.vx*sqrt(first.vx^2 + first.vy^2 + 1) + t', mechanism%variable_names(), error), &
                parsed('sin(second.angle)*second.omega + first.y', mechanism%variable_names(), error)]
            torque = [parsed('-2*pin.angle*pin.rate + t*second.x', mechanism%variable_names(), error)]
            if (allocated(error)) return
            call mechanism%add_load('wind', 'first.tip', failure, force=[1.0_wp, 2.0_wp], force_by=force, torque_by=torque, &
                in_body=k == 1)
            call check_no_failure(error, failure)
            call verify(mechanism, 'loads in the plane', error)

            call draw(mechanism, .false.)
            call mechanism%add_joint('pin', 'cylindrical', 'first', 'second', failure, at=at, axis=axis)
            call check_no_failure(error, failure)
            force = [parsed('first.vx*first.wy + second.z', mechanism%variable_names(), error), &
                parsed('pin.angle*pin.displacement', mechanism%variable_names(), error), &
                parsed('pin.speed*pin.rate*first.e2', mechanism%variable_names(), error)]
            torque = [parsed('-2*second.wx', mechanism%variable_names(), error), &
                parsed('t*second.wy*second.wz', mechanism%variable_names(), error), &
                parsed('1.5', mechanism%variable_names(), error)]
            if (allocated(error)) return
            call mechanism%add_load('wind', 'second.tip', failure, force_by=force, torque_by=torque, in_body=k == 1)
            call check_no_failure(error, failure)
            call verify(mechanism, 'loads in space', error)
        end do
    end subroutine test_loads

    subroutine test_bushings(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type) :: mechanism
        type(failure_type), allocatable :: failure
        real(wp) :: full(6, 6)
        integer :: i, j

        do j = 1, 6
            do i = 1, 6
                full(i, j) = 1.0_wp/(i + j)
            end do
        end do
        call draw(mechanism, .true.)
        call mechanism%add_bushing('rubber', 'first', 'second', failure, stiffness=[20.0_wp, 30.0_wp, 4.0_wp], &
            damping=[1.0_wp, 0.0_wp, 0.3_wp], at=at(:2), axis=axis(:2))
        call check_no_failure(error, failure)
        call mechanism%add_bushing('mount', 'second.tip', 'ground', failure, stiffness=reshape(full(:3, :3), [9]))
        call check_no_failure(error, failure)
        call verify(mechanism, 'bushings in the plane', error)
        call draw(mechanism, .false.)
        call mechanism%add_bushing('rubber', 'first', 'second', failure, stiffness=reshape(full, [36]), &
            damping=[1.0_wp, 0.0_wp, 0.3_wp, 0.2_wp, 0.1_wp, 0.4_wp], at=at, axis=axis)
        call check_no_failure(error, failure)
        call mechanism%add_bushing('mount', 'ground', 'second.tip', failure, damping=reshape(full, [36]))
        call check_no_failure(error, failure)
        call verify(mechanism, 'bushings in space', error)
        call mechanism%clear()
        call draw(mechanism, .false.)
        call mechanism%add_bushing('rubber', 'first', 'second', failure, stiffness=[1.0_wp], at=at)
        call check_true(error, allocated(failure), 'one entry is too few')
        if (allocated(failure)) call check_true(error, index(failure%message, 'bushing rubber: stiffness has 1 entries') > 0, &
            failure%message)
        ! A point mass has no orientation, so no angles that a bushing could hold.
        do i = 1, 2
            call mechanism%clear()
            call draw(mechanism, i == 1)
            call mechanism%add_body('point', 1.0_wp, at(:merge(2, 3, i == 1)), failure)
            call check_no_failure(error, failure)
            call mechanism%add_bushing('rubber', 'ground', 'point', failure, stiffness=[(1.0_wp, j=1, merge(3, 6, i == 1))], &
                at=at(:merge(2, 3, i == 1)))
            call check_true(error, allocated(failure), 'a bushing holds a point mass')
            if (allocated(failure)) call check_true(error, index(failure%message, 'bushing rubber') > 0 .and. &
                index(failure%message, 'point') > 0, failure%message)
        end do
    end subroutine test_bushings

    !> Their times: exact for linear arguments, up to rounding for curved ones; a pair within one part is found.
    subroutine test_kinks(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type) :: mechanism
        type(failure_type), allocatable :: failure

        call draw(mechanism, .true.)
        mechanism%times = [0.0_wp, 10.0_wp]
        call mechanism%add_spring('a', 'first.tip', 'second.tip', failure, &
            motion=expression_function(parsed('step(t - 1) + ramp(sin(t))', ['t'], error)))
        call check_no_failure(error, failure)
        call mechanism%add_spring('b', 'first', 'second', failure, law=expression_law(parsed('length*step(t - 1)*abs(rate)' // &
            ' + step(1e-7 - (t - 5.0001)^2)', [character(len=6) :: 't', 'length', 'rate'], error)))
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call mechanism%define(failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call check_count(error, size(mechanism%breakpoints), 6, 'breakpoints')
        if (allocated(error)) return
        call check_close(error, mechanism%breakpoints, [1.0_wp, pi, 5.0001_wp - sqrt(1.0e-7_wp), 5.0001_wp + sqrt(1.0e-7_wp), &
            2*pi, 3*pi], 1.0e-12_wp, 'breakpoints')
        call check_true(error, .not. any(mechanism%nu_jumps), 'forces let no velocity jump')
        call verify_again(mechanism, error)
    end subroutine test_kinks

    !> With fixed sides, all derivatives are those of the piece.
    subroutine verify_again(mechanism, error)
        use tandem, only: finding_type, verify_model
        type(mechanism_type), intent(inout), target :: mechanism
        type(error_type), allocatable, intent(inout) :: error
        type(finding_type), allocatable :: findings(:)
        type(failure_type), allocatable :: failure
        real(wp) :: q(6), qd(6)
        integer :: i, segment

        call mechanism%start(q, qd)
        do segment = 1, 3
            mechanism%segment = segment
            call verify_model(mechanism, 1.0_wp, q, qd, 3, findings, failure)
            call check_no_failure(error, failure)
            do i = 1, size(findings)
                call check_below(error, findings(i)%error, 1.0e-9_wp, findings(i)%name)
            end do
        end do
    end subroutine verify_again

    !> A slider that is driven to stand, go, and stand: its velocity jumps exactly there, and a pendulum on it swings like one with
    !> a pushed pivot: between the jumps it is free, and each jump adds a known angular velocity.
    subroutine test_kinked_motion(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure

        mechanism%planar = .true.
        mechanism%times = [0.0_wp, 2.0_wp]
        call mechanism%add_body('cart', 1.0_wp, [0.0_wp, 0.0_wp], failure, inertia=[1.0_wp])
        call check_no_failure(error, failure)
        call mechanism%add_body('bob', 1.0_wp, [0.0_wp, -1.0_wp], failure)
        call check_no_failure(error, failure)
        call mechanism%add_joint('rail', 'prismatic', 'ground', 'cart', failure, at=[0.0_wp, 0.0_wp], axis=[1.0_wp, 0.0_wp], &
            motion=expression_function(parsed('ramp(t - 0.5) - ramp(t - 1.25)', ['t'], error)))
        call check_no_failure(error, failure)
        call mechanism%add_distance('string', 'cart', 'bob', failure)
        call check_no_failure(error, failure)
        call go(mechanism, 1.0e-11_wp, 2.0_wp, simulation, error)
        if (allocated(error)) return
        call check_close(error, mechanism%breakpoints, [0.5_wp, 1.25_wp], 1.0e-15_wp, 'breakpoints')
        call check_true(error, all(mechanism%nu_jumps), 'velocities jump')
        ! No gravity: the cart starts under a bob at rest, which it drags by the string of 1 m that rotates at -1 rad/s from then
        ! on; after 0.75 s the cart stops, which removes the part of the bob's velocity along the string.
        associate (q => simulation%state%q, qd => simulation%state%qd)
            call check_close(error, q(1:2), [0.75_wp, 0.0_wp], 1.0e-12_wp, 'cart')
            ! Relative to the cart the bob rotates at 1 rad/s: angle 0.75 from below, to the left; then the pivot stands, and the
            ! angular velocity is 1 - cos(0.75), due to the impulse across the string.
            associate (angle => -0.75_wp - 0.75_wp*(1 - cos(0.75_wp)))
                call check_close(error, q(4:5) - q(1:2), [sin(angle), -cos(angle)], 1.0e-10_wp, 'bob')
            end associate
            call check_below(error, abs(norm2(qd(4:5)) - (1 - cos(0.75_wp))), 1.0e-10_wp, 'velocity of the bob')
        end associate
    end subroutine test_kinked_motion

    !> A force that jumps twice on a free mass: the displacement is a polynomial on each side, which a Runge-Kutta step integrates
    !> exactly.
    subroutine test_jumping_force(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(expression_type) :: force(2)

        mechanism%planar = .true.
        mechanism%times = [0.0_wp, 3.0_wp]
        call mechanism%add_body('mass', 2.0_wp, [0.0_wp, 0.0_wp], failure)
        call check_no_failure(error, failure)
        force = [parsed('4*(step(t - 0.3) - step(t - 1.7))', mechanism%variable_names(), error), &
            parsed('0', mechanism%variable_names(), error)]
        if (allocated(error)) return
        call mechanism%add_load('push', 'mass', failure, force_by=force)
        call check_no_failure(error, failure)
        call go(mechanism, 1.0e-6_wp, 3.0_wp, simulation, error)
        if (allocated(error)) return
        call check_close(error, simulation%state%q, [1.4_wp**2 + 2.8_wp*1.3_wp, 0.0_wp], 1.0e-13_wp, 'place')
        call check_close(error, simulation%state%qd, [2.8_wp, 0.0_wp], 1.0e-13_wp, 'velocity')
    end subroutine test_jumping_force

    subroutine test_jumping_motion(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: mechanism
        type(failure_type), allocatable :: failure

        call draw(mechanism, .true.)
        mechanism%times = [0.0_wp, 3.0_wp]
        call mechanism%add_joint('motor', 'revolute', 'first', 'second', failure, at=at(:2), &
            motion=expression_function(parsed('step(t - 0.3)', ['t'], error)))
        call check_no_failure(error, failure)
        call mechanism%define(failure)
        call check_true(error, allocated(failure), 'a motion that jumps is refused')
        if (allocated(failure)) call check_true(error, index(failure%message, 'the motion of motor is discontinuous at t = 0.3') &
            > 0, failure%message)
    end subroutine test_jumping_motion
end module test_mechanism_laws
