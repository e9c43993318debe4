! SPDX-License-Identifier: MIT
!> Tests of mechanisms against references that are independent of this project's solver, or closed forms: the rattleback, a ball on
!> a turntable, four-bars in a row, the stiff governor of the IFToMM library, gears and screws over many turns, Whipple's bicycle,
!> and the paper's vehicle.
module test_mechanism_references
    use asserts, only: check_below, check_close, check_count, check_no_failure
    use kkt, only: kkt_type
    use mechanism_checks, only: go
    use tandem, only: articulated_vehicle_type, expression_function, expression_type, failure_type => error_type, mechanism_type, &
        parse_expression, plane_type, ramp, simulation_type, statistics_type, wp
    use tandem_linalg_random, only: random_vector
    use tandem_mechanism_vector, only: cross
    use tandem_rigid_euler_parameters, only: g_product, rotation
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_mechanism_references

    real(wp), parameter :: pi = acos(-1.0_wp), z(3) = [0.0_wp, 0.0_wp, 1.0_wp]

contains

    !> The suite.
    subroutine collect_mechanism_references(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('rattleback', test_rattleback), &
            new_unittest('ball-on-a-turntable', test_turntable), &
            new_unittest('ball-in-a-cylinder', test_cylinder), &
            new_unittest('four-bars-in-a-row', test_four_bars), &
            new_unittest('stiff-governor', test_governor), &
            new_unittest('gears-over-many-turns', test_gears), &
            new_unittest('a-rotor-beyond-a-million-radians', test_rotor), &
            new_unittest('screw-and-spring-over-many-turns', test_screw), &
            new_unittest('sleigh-on-a-turning-plate', test_sleigh), &
            new_unittest('whipples-bicycle', test_bicycle), &
            new_unittest('vehicle-as-derived-by-hand', test_vehicle)]
    end subroutine collect_mechanism_references

    !> An ellipsoid whose principal axes of inertia differ from those of its shape reverses its spin. The unit vector downwards and
    !> the angular velocity in the body's frame, from an integration of their equations alone. The bound is that of the digits
    !> given, times the growth of a tolerance of 1e-12 per step by an instability of e^7 per second.
    subroutine test_rattleback(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: half = pi/360, squares(3) = [0.04_wp, 0.0009_wp, 0.0004_wp], centre(3) = [0.0_wp, 0.0_wp, -0.01_wp]
        real(wp), parameter :: spin(3) = [0.0_wp, 0.0_wp, -5.0_wp]
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: down(3), p(4), a(3, 3), y(3), omega(3)

        down = [-cos(half)*sin(half), sin(half), cos(half)*cos(half)]
        down = down/norm2(down)
        ! A half turn about x after the smallest turn of `down` to z, (1 + down.z, down x z).
        p = [1 + down(3), down(2), -down(1), 0.0_wp]
        p = [-p(2), p(1), -p(4), p(3)]/norm2(p)
        a = rotation(p)
        y = matmul(a, centre + squares*down/sqrt(sum(squares*down**2)))
        omega = matmul(a, spin)
        mechanism%gravity = [0.0_wp, 0.0_wp, -9.81_wp]
        call mechanism%add_body('stone', 1.0_wp, [0.0_wp, 0.0_wp, -y(3)], failure, inertia=[2.0e-4_wp, 16.0e-4_wp, 17.0e-4_wp, &
            -2.0e-5_wp, 0.0_wp, 0.0_wp], orientation=p, velocity=-cross(omega, y), omega=omega)
        call check_no_failure(error, failure)
        call mechanism%add_point('stone', 'centre', centre, failure)
        call check_no_failure(error, failure)
        call mechanism%add_rolling_ellipsoid('rolling', 'stone.centre', sqrt(squares), failure)
        call check_no_failure(error, failure)
        call go(mechanism, 1.0e-12_wp, 1.0_wp, simulation, error)
        if (allocated(error)) return
        a = rotation(simulation%state%q(4:7))
        call check_close(error, -a(3, :), [-0.02316491661_wp, -0.00600434243_wp, 0.99971362625_wp], 1.0e-9_wp, 'down')
        omega = 2*g_product(simulation%state%q(4:7), simulation%state%qd(4:7))
        call check_close(error, omega, [5.0410423064_wp, 1.7614231695_wp, -3.1175435374_wp], 1.0e-8_wp, 'angular velocity')
    end subroutine test_rattleback

    !> A solid ball moves on a circle on the table: Z(t) = Z0 + V0 (exp(i al t) - 1)/(i al), al = 2/7 of the table's rate.
    subroutine test_turntable(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: rate = 3.0_wp, radius = 0.2_wp, al = rate*0.4_wp/1.4_wp, t = 10.0_wp
        real(wp), parameter :: place(3) = [0.5_wp, -0.3_wp, radius], velocity(3) = [0.4_wp, 0.7_wp, 0.0_wp], pivot(3) = &
            [0.1_wp, 0.2_wp, 0.0_wp]
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        complex(wp) :: turned
        real(wp) :: omega(3)

        ! (v - rate z x (r - pivot)) = radius omega x z, and some spin about the vertical.
        omega = cross(z, velocity - rate*cross(z, place - pivot))/radius + 0.7_wp*z
        mechanism%gravity = [0.0_wp, 0.0_wp, -9.81_wp]
        call mechanism%add_body('ball', 2.0_wp, place, failure, inertia=spread(0.4_wp*2.0_wp*radius**2, 1, 3), &
            velocity=velocity, omega=omega)
        call check_no_failure(error, failure)
        call mechanism%add_rolling_sphere('rolling', 'ball', radius, failure, &
            plane=plane_type(rotation=ramp(0.3_wp, rate), pivot=pivot))
        call check_no_failure(error, failure)
        call go(mechanism, 1.0e-11_wp, t, simulation, error)
        if (allocated(error)) return
        turned = cmplx(velocity(1), velocity(2), wp)*(exp(cmplx(0.0_wp, al*t, wp)) - 1)/cmplx(0.0_wp, al, wp)
        call check_close(error, simulation%state%q(1:3), place + [real(turned), aimag(turned), 0.0_wp], 1.0e-8_wp, 'centre')
    end subroutine test_turntable

    !> A ball that rolls inside an upright cylinder, its centre at the distance R from the axis on an arm that rotates about the
    !> axis and slides along it. With v + omega x (a e_r) = 0 the arm rotates at a constant rate W, the spin about the radius
    !> satisfies omega_r' = W z'/a, and (m + m_arm + I/a^2) z'' = -(m + m_arm) g - I W/a omega_r: the ball moves up and down
    !> harmonically.
    subroutine test_cylinder(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: a = 0.2_wp, r = 0.7_wp, w = 4.0_wp, mass = 2.0_wp, m_arm = 0.5_wp, g = 9.81_wp, spin = 3.0_wp, &
            climb = 0.9_wp, inertia = 0.4_wp*mass*a**2, t = 5.0_wp
        real(wp), parameter :: total = mass + m_arm + inertia/a**2
        character(len=6), parameter :: steppers(3) = [character(len=6) :: 'dop853', 'radau5', 'dop853'], &
            kinds(3) = [character(len=6) :: 'dense', 'dense', 'sparse']
        real(wp) :: nu, low, height
        integer :: i

        nu = sqrt(inertia*w**2/a**2/total)
        low = ((mass + m_arm)*g + inertia*w/a*spin)/total/nu**2
        height = -low*(1 - cos(nu*t)) + climb/nu*sin(nu*t)
        do i = 1, size(steppers)
            call roll(trim(steppers(i)), trim(kinds(i)))
            if (allocated(error)) return
        end do

    contains

        subroutine roll(stepper, kind)
            character(len=*), intent(in) :: stepper, kind
            type(mechanism_type), target :: mechanism
            type(simulation_type) :: simulation
            type(failure_type), allocatable :: failure
            type(expression_type) :: c(3)

            mechanism%gravity = [0.0_wp, 0.0_wp, -g]
            call mechanism%add_body('ball', mass, [r, 0.0_wp, 0.0_wp], failure, inertia=spread(inertia, 1, 3), &
                velocity=[0.0_wp, r*w, climb], omega=[spin, climb/a, -r*w/a])
            call check_no_failure(error, failure)
            call mechanism%add_body('arm', m_arm, [0.3_wp, 0.0_wp, 0.0_wp], failure, inertia=[0.1_wp, 0.1_wp, 0.15_wp], &
                velocity=[0.0_wp, 0.3_wp*w, climb], omega=[0.0_wp, 0.0_wp, w])
            call check_no_failure(error, failure)
            call mechanism%add_joint('axis', 'cylindrical', 'ground', 'arm', failure, at=[0.0_wp, 0.0_wp, 0.0_wp], axis=z)
            call check_no_failure(error, failure)
            call mechanism%add_joint('hand', 'spherical', 'arm', 'ball', failure, at=[r, 0.0_wp, 0.0_wp])
            call check_no_failure(error, failure)
            call set(mechanism, c(1), '-ball.y/0.7')
            call set(mechanism, c(2), 'ball.x/0.7')
            call set(mechanism, c(3), '0.2')
            call mechanism%add_rate_row('round', ['ball.vx', 'ball.vy', 'ball.wz'], c, failure)
            call check_no_failure(error, failure)
            call set(mechanism, c(1), '1')
            call set(mechanism, c(2), '0.2*ball.y/0.7')
            call set(mechanism, c(3), '-0.2*ball.x/0.7')
            call mechanism%add_rate_row('up', ['ball.vz', 'ball.wx', 'ball.wy'], c, failure)
            call check_no_failure(error, failure)
            call go(mechanism, 1.0e-11_wp, t, simulation, error, stepper, kind)
            if (allocated(error)) return
            call check_close(error, simulation%state%q(1:3), [r*cos(w*t), r*sin(w*t), height], 1.0e-8_wp, &
                'centre by '//stepper//' on the chart '//kind)
        end subroutine roll

        subroutine set(mechanism, coefficient, text)
            type(mechanism_type), intent(in) :: mechanism
            type(expression_type), intent(out) :: coefficient
            character(len=*), intent(in) :: text
            type(failure_type), allocatable :: failure

            call parse_expression(coefficient, text, mechanism%variable_names(), failure)
            call check_no_failure(error, failure)
        end subroutine set
    end subroutine test_cylinder

    !> Two and 40 four-bars in a row, 15 and 243 coordinates: theta'' = c sin(theta) as long as the uprights stay parallel, by steps
    !> of fourth order that are short enough for 1e-14. For two, the solution to 18 digits.
    subroutine test_four_bars(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: numbers(2) = [2, 40]
        real(wp) :: top(2)
        integer :: k

        do k = 1, size(numbers)
            call move_four_bars(numbers(k), top, error)
            if (allocated(error)) return
            call check_close(error, top, parallel_top(numbers(k)), 1.0e-9_wp, 'B0')
            if (k == 1) call check_close(error, top, [0.884327595936854902_wp, 0.466866900802083729_wp], 1.0e-9_wp, 'B0 of two')
        end do
    end subroutine test_four_bars

    !> Top of the first upright at 0.6 s.
    subroutine move_four_bars(n, top, error)
        integer, intent(in) :: n
        real(wp), intent(out) :: top(2)
        type(error_type), allocatable, intent(inout) :: error
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: angle
        character(len=10) :: name(0:2*n)
        integer :: i

        top = 0.0_wp
        mechanism%planar = .true.
        mechanism%gravity = [0.0_wp, -9.81_wp, 0.0_wp]
        do i = 0, n
            write (name(i), '(a, i0)') 'upright', i
            call mechanism%add_body(trim(name(i)), 1.0_wp, [real(i, wp), 0.5_wp], failure, inertia=[1/12.0_wp], &
                velocity=[0.5_wp, 0.0_wp], omega=[-1.0_wp])
            call check_no_failure(error, failure)
            call mechanism%add_joint('foot'//name(i)(8:), 'revolute', 'ground', name(i), failure, at=[real(i, wp), 0.0_wp])
            call check_no_failure(error, failure)
        end do
        do i = 1, n
            write (name(n + i), '(a, i0)') 'coupler', i
            call mechanism%add_body(trim(name(n + i)), 1.0_wp, [i - 0.5_wp, 1.0_wp], failure, inertia=[1/12.0_wp], &
                velocity=[1.0_wp, 0.0_wp])
            call check_no_failure(error, failure)
            call mechanism%add_joint('left'//name(i)(8:), 'revolute', name(i - 1), name(n + i), failure, &
                at=[i - 1.0_wp, 1.0_wp])
            call check_no_failure(error, failure)
            call mechanism%add_joint('right'//name(i)(8:), 'revolute', name(i), name(n + i), failure, at=[real(i, wp), 1.0_wp])
            call check_no_failure(error, failure)
        end do
        call go(mechanism, 1.0e-11_wp, 0.6_wp, simulation, error)
        if (allocated(error)) return
        angle = simulation%state%q(3)
        top = simulation%state%q(1:2) + 0.5_wp*[-sin(angle), cos(angle)]
    end subroutine move_four_bars

    !> The same for uprights that stay parallel.
    pure function parallel_top(n) result(top)
        integer, intent(in) :: n
        real(wp) :: top(2)
        integer, parameter :: steps = 10000
        real(wp) :: theta(2), c, h, k1(2), k2(2), k3(2), k4(2)
        integer :: i

        c = 9.81_wp*((n + 1)/2.0_wp + n)/((n + 1)/3.0_wp + n)
        h = 0.6_wp/steps
        theta = [0.0_wp, 1.0_wp]
        do i = 1, steps
            k1 = [theta(2), c*sin(theta(1))]
            k2 = [theta(2) + h/2*k1(2), c*sin(theta(1) + h/2*k1(1))]
            k3 = [theta(2) + h/2*k2(2), c*sin(theta(1) + h/2*k2(1))]
            k4 = [theta(2) + h*k3(2), c*sin(theta(1) + h*k3(1))]
            theta = theta + h/6*(k1 + 2*k2 + 2*k3 + k4)
        end do
        top = [sin(theta(1)), cos(theta(1))]
    end function parallel_top

    !> Rods on a turning shaft lift a slider against stiff springs and dampers: its fastest rate is -8.1e3 /s. Implicit steps.
    subroutine test_governor(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: thin = 0.3_wp*2.0e-4_wp/12, thick = 0.3_wp*1.0001_wp/12, down(2) = [pi/6, 5*pi/6]
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp), parameter :: rate = 2*pi
        type(statistics_type) :: statistics
        real(wp) :: along(3), pin(3)
        character(len=1), parameter :: number(2) = ['1', '2']
        integer :: i

        mechanism%gravity = [0.0_wp, 0.0_wp, -9.81_wp]
        call mechanism%add_body('shaft', 0.3_wp, [0.0_wp, 0.0_wp, 0.5_wp], failure, inertia=[thick, thick, thin], omega=rate*z)
        call check_no_failure(error, failure)
        call mechanism%add_body('slider', 3.0_wp, [0.0_wp, 0.0_wp, 0.5_wp], failure, inertia=spread(0.005_wp, 1, 3), omega=rate*z)
        call check_no_failure(error, failure)
        call mechanism%add_joint('bearing', 'revolute', 'ground', 'shaft', failure, at=[0.0_wp, 0.0_wp, 0.0_wp], axis=z)
        call check_no_failure(error, failure)
        call mechanism%add_joint('guide', 'prismatic', 'shaft', 'slider', failure, at=[0.0_wp, 0.0_wp, 0.5_wp], axis=z)
        call check_no_failure(error, failure)
        do i = 1, 2
            along = [cos(down(i)), 0.0_wp, -sin(down(i))]
            pin = [(3 - 2*i)*0.05_wp, 0.0_wp, 1.0_wp]
            call mechanism%add_body('rod'//number(i), 0.3_wp, pin + along/2, failure, inertia=[thin, thick, thick], &
                orientation=[cos(down(i)/2), 0.0_wp, sin(down(i)/2), 0.0_wp], velocity=rate*cross(z, pin + along/2), &
                omega=rate*z)
            call check_no_failure(error, failure)
            call mechanism%add_body('ball'//number(i), 5.0_wp, pin + along, failure, velocity=rate*cross(z, pin + along))
            call check_no_failure(error, failure)
            call mechanism%add_joint('pin'//number(i), 'revolute', 'shaft', 'rod'//number(i), failure, at=pin, &
                axis=[0.0_wp, 1.0_wp, 0.0_wp])
            call check_no_failure(error, failure)
            call mechanism%add_joint('end'//number(i), 'spherical', 'rod'//number(i), 'ball'//number(i), failure, at=pin + along)
            call check_no_failure(error, failure)
            call mechanism%add_point('slider', 'ear'//number(i), [pin(1), 0.0_wp, 0.0_wp], failure)
            call check_no_failure(error, failure)
            call mechanism%add_spring('spring'//number(i), 'rod'//number(i), 'slider.ear'//number(i), failure, &
                stiffness=8.0e5_wp, damping=4.0e4_wp, length=0.5_wp)
            call check_no_failure(error, failure)
        end do
        ! A tolerance per step of 1e-6 gives a smaller error in a damped motion.
        call go(mechanism, 1.0e-6_wp, 1.0_wp, simulation, error, 'sdirk54')
        if (allocated(error)) return
        call check_below(error, abs(simulation%state%q(10) - 0.5014209223796_wp), 1.0e-6_wp, 'slider at 1 s')
        call simulation%integrate(2.0_wp, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call check_below(error, abs(simulation%state%q(10) - 0.5059092942967_wp), 1.0e-6_wp, 'slider at 2 s')
        ! It took 1480; explicit steps of fourth order at the limit of stability would be 8.1e3*2/2.8.
        statistics = simulation%statistics()
        call check_below(error, real(statistics%steps, wp), 2000.0_wp, 'steps of a stiff stepper')
    end subroutine test_governor

    !> Two wheels on parallel axes, one driven for 30 turns, and a third whose angle is the sum of both: in space, where turns are
    !> counted.
    subroutine test_gears(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        character(len=1), parameter :: number(3) = ['1', '2', '3']
        real(wp), parameter :: turns(3) = [30.0_wp, -45.0_wp, -7.5_wp]
        integer :: i

        do i = 1, 3
            call mechanism%add_body('wheel'//number(i), 1.0_wp, [real(i, wp), 0.0_wp, 0.0_wp], failure, &
                inertia=[0.1_wp, 0.1_wp, 0.2_wp], omega=2*pi*turns(i)/3*z)
            call check_no_failure(error, failure)
            if (i == 1) then
                call mechanism%add_joint('axle1', 'revolute', 'ground', 'wheel1', failure, at=[1.0_wp, 0.0_wp, 0.0_wp], &
                    axis=z, motion=ramp(0.0_wp, 2*pi*10))
            else
                call mechanism%add_joint('axle'//number(i), 'revolute', 'ground', 'wheel'//number(i), failure, &
                    at=[real(i, wp), 0.0_wp, 0.0_wp], axis=z)
            end if
            call check_no_failure(error, failure)
        end do
        call mechanism%add_coupling('mesh', ['axle1', 'axle2'], [1.5_wp, 1.0_wp], failure)
        call check_no_failure(error, failure)
        call mechanism%add_coupling('differential', ['axle1', 'axle2', 'axle3'], [1.0_wp, 1.0_wp, -2.0_wp], failure)
        call check_no_failure(error, failure)
        ! 3 s would end at whole turns for all: 2.93 s do not.
        call go(mechanism, 1.0e-8_wp, 2.93_wp, simulation, error)
        if (allocated(error)) return
        do i = 1, 3
            associate (a => rotation(simulation%state%q(7*i - 3:7*i)), angle => 2*pi*turns(i)/3*2.93_wp)
                ! Rows hold to 1e-12.
                call check_close(error, a(1:2, 1), [cos(angle), sin(angle)], 1.0e-10_wp, 'wheel '//number(i))
            end associate
        end do
    end subroutine test_gears

    !> A rotor off its centre of mass in the plane continues at its rate from any angle, with implicit steps too.
    subroutine test_rotor(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=6), parameter :: stepper(2) = ['dop853', 'radau5']
        real(wp), parameter :: rate = 314.0_wp, arm = 0.1_wp, t_end = 0.2_wp, start(3) = [1.0e4_wp, 1.0e6_wp, 1.0e7_wp]
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: e(2)
        integer :: i, k

        do i = 1, size(start)
            do k = 1, 2
                e = [cos(start(i)), sin(start(i))]
                mechanism = mechanism_type()
                mechanism%planar = .true.
                call mechanism%add_body('rotor', 1.0_wp, arm*e, failure, inertia=[0.01_wp], orientation=[start(i)], &
                    velocity=arm*rate*[-e(2), e(1)], omega=[rate])
                call check_no_failure(error, failure)
                call mechanism%add_joint('pivot', 'revolute', 'ground', 'rotor', failure, at=[0.0_wp, 0.0_wp])
                call check_no_failure(error, failure)
                call go(mechanism, 1.0e-9_wp, t_end, simulation, error, trim(stepper(k)))
                if (allocated(error)) return
                ! The error of radau5 is up to 6e-7 in its 1000 steps, and the start has the angle up to rounding of that.
                call check_below(error, abs(simulation%state%q(3) - start(i) - rate*t_end), 1.0e-6_wp, trim(stepper(k)))
                e = [cos(simulation%state%q(3)), sin(simulation%state%q(3))]
                ! The iteration for the position stops at 1e-14 of the sizes of its terms, of which there are up to three.
                call check_close(error, simulation%state%q(1:2), arm*e, 3.0e-14_wp*arm*start(i), 'place')
            end do
        end do
    end subroutine test_rotor

    !> A nut on a screw with a torsional spring: J phi'' = -k phi with J of both motions, from 20 turns away at rest; no damping.
    subroutine test_screw(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: inertia = 0.2_wp, mass = 3.0_wp, pitch = 0.3_wp, stiffness = 1.7_wp
        real(wp), parameter :: frequency = sqrt(stiffness/(inertia + mass*(pitch/(2*pi))**2))
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: angle

        call mechanism%add_body('nut', mass, [0.0_wp, 0.0_wp, 0.0_wp], failure, inertia=[0.15_wp, 0.15_wp, inertia], &
            omega=20*2*pi*frequency*z, velocity=20*pitch*frequency*z)
        call check_no_failure(error, failure)
        call mechanism%add_joint('thread', 'screw', 'ground', 'nut', failure, at=[0.0_wp, 0.0_wp, 0.0_wp], axis=z, pitch=pitch)
        call check_no_failure(error, failure)
        call mechanism%add_torsion('spring', 'thread.angle', failure, stiffness=stiffness)
        call check_no_failure(error, failure)
        call go(mechanism, 1.0e-11_wp, 3.0_wp, simulation, error)
        if (allocated(error)) return
        angle = 20*2*pi*sin(frequency*3)
        ! Errors of the angle are those of a tolerance of 1e-11 times 126 rad.
        call check_below(error, abs(simulation%state%q(3) - pitch/(2*pi)*angle), 1.0e-8_wp, 'way')
        associate (a => rotation(simulation%state%q(4:7)))
            call check_close(error, a(1:2, 1), [cos(angle), sin(angle)], 1.0e-7_wp, 'angle')
        end associate
    end subroutine test_screw

    !> A blade on a plate that is rotated, in the plane: relative to the plate, without forces except those of the frame, it is
    !> equivalent to a blade on the ground whose lateral velocity is that of the plate below it.
    subroutine test_sleigh(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: rate = 0.6_wp, place(2) = [1.0_wp, 0.5_wp]
        type(mechanism_type), target :: mechanism, other
        type(simulation_type) :: simulation, its
        type(failure_type), allocatable :: failure
        type(expression_type) :: c(2), rhs
        integer :: i

        mechanism%planar = .true.
        other%planar = .true.
        call mechanism%add_body('plate', 5.0_wp, [0.0_wp, 0.0_wp], failure, inertia=[2.0_wp], omega=[rate])
        call check_no_failure(error, failure)
        call mechanism%add_joint('motor', 'revolute', 'ground', 'plate', failure, at=[0.0_wp, 0.0_wp], motion=ramp(0.0_wp, rate))
        call check_no_failure(error, failure)
        ! It may move along its heading, x at the start; across it moves with the plate: rate times x.
        call mechanism%add_body('blade', 1.0_wp, place, failure, inertia=[0.3_wp], velocity=[0.7_wp, rate*place(1)], &
            omega=[1.1_wp])
        call check_no_failure(error, failure)
        call mechanism%add_joint('edge', 'primitive', 'plate', 'blade', failure, at=place, hold=[0, 2, 0])
        call check_no_failure(error, failure)
        call go(mechanism, 1.0e-11_wp, 3.0_wp, simulation, error)
        call other%add_body('blade', 1.0_wp, place, failure, inertia=[0.3_wp], velocity=[0.7_wp, rate*place(1)], omega=[1.1_wp])
        call check_no_failure(error, failure)
        call parse_expression(c(1), '-sin(blade.angle)', other%variable_names(), failure)
        call check_no_failure(error, failure)
        call parse_expression(c(2), 'cos(blade.angle)', other%variable_names(), failure)
        call check_no_failure(error, failure)
        call parse_expression(rhs, '0.6*(sin(blade.angle)*blade.y + cos(blade.angle)*blade.x)', other%variable_names(), failure)
        call check_no_failure(error, failure)
        call other%add_rate_row('edge', ['blade.vx', 'blade.vy'], c, failure, rhs=rhs)
        call check_no_failure(error, failure)
        call go(other, 1.0e-11_wp, 3.0_wp, its, error)
        if (allocated(error)) return
        do i = 1, 3
            call check_below(error, abs(simulation%state%q(3 + i) - its%state%q(i)), 1.0e-9_wp, 'coordinate')
        end do
        ! It rotates freely.
        call check_below(error, abs(its%state%q(3) - 3.3_wp), 1.0e-10_wp, 'heading')
    end subroutine test_sleigh

    !> The benchmark of Meijaard and others (2007), with its z axis upwards: upright at a speed, with a small lean rate. At 5 m/s it
    !> is stable: lean and steer follow the linear equations, and the energy is constant.
    subroutine test_bicycle(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: speed = 5.0_wp, tilt = pi/10, small = 1.0e-6_wp, t_end = 2.0_wp, g = 9.81_wp
        real(wp), parameter :: rear(3) = [0.0_wp, 0.0_wp, 0.3_wp], frame(3) = [0.3_wp, 0.0_wp, 0.9_wp], &
            fork(3) = [0.9_wp, 0.0_wp, 0.7_wp], front(3) = [1.02_wp, 0.0_wp, 0.35_wp], y(3) = [0.0_wp, 1.0_wp, 0.0_wp]
        !> Along the steering axis, downwards; it intersects the ground 0.08 m before the front contact.
        real(wp), parameter :: steering(3) = [sin(tilt), 0.0_wp, -cos(tilt)], foot(3) = [1.1_wp, 0.0_wp, 0.0_wp]
        real(wp), parameter :: m(2, 2) = reshape([80.81722_wp, 2.31941332208709_wp, 2.31941332208709_wp, 0.29784188199686_wp], &
            [2, 2]), c1(2, 2) = reshape([0.0_wp, -0.85035641456978_wp, 33.86641391492494_wp, 1.68540397397560_wp], [2, 2]), &
            k0(2, 2) = reshape([-80.95_wp, -2.59951685249872_wp, -2.59951685249872_wp, -0.80329488458618_wp], [2, 2]), &
            k2(2, 2) = reshape([0.0_wp, 0.0_wp, 76.59734589573222_wp, 2.65431523794604_wp], [2, 2])
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: omega(3), a(3, 3), b(3, 3), before, after, x(4), k(4, 4), h, lean, steer, inverse(2, 2)
        integer :: i
        integer, parameter :: steps = 20000

        ! Everything leans about the line of the contacts.
        omega = [small, 0.0_wp, 0.0_wp]
        mechanism%gravity = [0.0_wp, 0.0_wp, -g]
        call add('rear', 2.0_wp, [0.0603_wp, 0.12_wp, 0.0603_wp], rear, omega + speed/0.3_wp*y)
        call add('frame', 85.0_wp, [9.2_wp, 11.0_wp, 2.8_wp, 0.0_wp, -2.4_wp, 0.0_wp], frame, omega)
        call add('fork', 4.0_wp, [0.05892_wp, 0.06_wp, 0.00708_wp, 0.0_wp, 0.00756_wp, 0.0_wp], fork, omega)
        call add('front', 3.0_wp, [0.1405_wp, 0.28_wp, 0.1405_wp], front, omega + speed/0.35_wp*y)
        call mechanism%add_joint('rear_axle', 'revolute', 'frame', 'rear', failure, at=rear, axis=y)
        call check_no_failure(error, failure)
        call mechanism%add_joint('steering', 'revolute', 'frame', 'fork', failure, at=foot, axis=steering)
        call check_no_failure(error, failure)
        call mechanism%add_joint('front_axle', 'revolute', 'fork', 'front', failure, at=front, axis=y)
        call check_no_failure(error, failure)
        call mechanism%add_rolling_disk('rear_tyre', 'rear', 0.3_wp, y, failure)
        call check_no_failure(error, failure)
        call mechanism%add_rolling_disk('front_tyre', 'front', 0.35_wp, y, failure)
        call check_no_failure(error, failure)
        call go(mechanism, 1.0e-12_wp, 1.0e-3_wp, simulation, error)
        if (allocated(error)) return
        before = energy()
        call simulation%integrate(t_end, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        after = energy()
        call check_count(error, simulation%n_redundant, 0, 'redundant rows')
        call check_below(error, abs(after - before)/before, 1.0e-11_wp, 'energy')
        ! M x'' + v C1 x' + (g K0 + v^2 K2) x = 0 in lean (of the frame, to the right) and steer (to the right, about the axis
        ! down).
        inverse = reshape([m(2, 2), -m(2, 1), -m(1, 2), m(1, 1)], [2, 2])/(m(1, 1)*m(2, 2) - m(1, 2)**2)
        k = 0.0_wp
        k(1, 3) = 1.0_wp
        k(2, 4) = 1.0_wp
        k(3:4, 1:2) = -matmul(inverse, g*k0 + speed**2*k2)
        k(3:4, 3:4) = -matmul(inverse, speed*c1)
        x = [0.0_wp, 0.0_wp, 1.0_wp, 0.0_wp]
        h = t_end/steps
        do i = 1, steps
            x = x + h*matmul(k, x + h/2*matmul(k, x + h/3*matmul(k, x + h/4*matmul(k, x))))
        end do
        a = rotation(simulation%state%q(11:14))
        b = rotation(simulation%state%q(18:21))
        ! The axle points to the left, z up: a lean to the right lifts it. Steering turns the fork's axle forwards.
        lean = asin(a(3, 2))
        steer = dot_product(steering, cross(a(:, 2), b(:, 2)))
        ! Terms of third order are 1e-12 of the lean; errors of 1e-12 stand against angles of 1e-6.
        call check_close(error, [lean, steer]/small, x(1:2), 1.0e-5_wp, 'lean and steer')

    contains

        subroutine add(name, mass, inertia, position, omega)
            character(len=*), intent(in) :: name
            real(wp), intent(in) :: mass, inertia(:), position(3), omega(3)

            call mechanism%add_body(name, mass, position, failure, inertia=inertia, velocity=[speed, 0.0_wp, 0.0_wp] + &
                cross([small, 0.0_wp, 0.0_wp], position), omega=omega)
            call check_no_failure(error, failure)
        end subroutine add

        real(wp) function energy() result(total)
            real(wp) :: potential
            integer :: stat

            call simulation%kinetic_energy(total, stat)
            call check_count(error, stat, 0, 'status')
            call simulation%potential_energy(potential, stat)
            call check_count(error, stat, 0, 'status')
            total = total + potential
        end function energy
    end subroutine test_bicycle

    !> Accelerations and multipliers at 1000 random states that satisfy the constraints, those of the wheels at both times.
    subroutine test_vehicle(error)
        type(error_type), allocatable, intent(out) :: error
        !> Of the scale of each: both systems are solved to rounding.
        real(wp), parameter :: bound = 1.0e-12_wp
        type(mechanism_type), target :: mechanism
        type(articulated_vehicle_type), target :: vehicle
        type(failure_type), allocatable :: failure
        type(kkt_type) :: of_mechanism, of_vehicle
        type(expression_type) :: law
        real(wp) :: q(6), qd(6), qdd(6), qdd_by_hand(6), lambda(5), by_hand(5), worst(2), t
        integer :: i, seed

        call vehicle%define()
        call draw_vehicle(mechanism, vehicle, law, error)
        if (allocated(error)) return
        call mechanism%define(failure)
        call check_no_failure(error, failure)
        call check_close(error, mechanism%breakpoints, [2*pi], 1.0e-12_wp, 'the steering ends')
        if (allocated(error)) return
        of_mechanism%model => mechanism
        of_vehicle%model => vehicle
        seed = 4711
        worst = 0.0_wp
        do i = 1, 1000
            q = random_vector(seed, 6)
            q(4) = q(1) - vehicle%half_length*(cos(q(3)) + cos(q(6)))
            q(5) = q(2) - vehicle%half_length*(sin(q(3)) + sin(q(6)))
            qd = 3*random_vector(seed, 6)
            t = merge(1.2_wp, 7.0_wp, i <= 500)
            vehicle%segment = merge(1, 2, i <= 500)
            mechanism%segment = vehicle%segment
            call of_mechanism%accelerate(t, q, qd, qdd, lambda)
            call of_vehicle%accelerate(t, q, qd, qdd_by_hand, by_hand)
            worst(1) = max(worst(1), maxval(abs(qdd - qdd_by_hand))/maxval(abs(qdd_by_hand)))
            worst(2) = max(worst(2), maxval(abs(abs(lambda) - abs(by_hand)))/maxval(abs(by_hand)))
        end do
        call check_below(error, worst(1), bound, 'accelerations')
        call check_below(error, worst(2), bound, 'multipliers')
    end subroutine test_vehicle

    !> Two chassis, a pin, three wheels, the front one of which is steered for one period.
    subroutine draw_vehicle(mechanism, vehicle, law, error)
        type(mechanism_type), intent(inout) :: mechanism
        type(articulated_vehicle_type), intent(in) :: vehicle
        type(expression_type), intent(inout) :: law
        type(error_type), allocatable, intent(inout) :: error
        type(failure_type), allocatable :: failure
        real(wp), parameter :: zero(2) = 0.0_wp, up(2) = [0.0_wp, 1.0_wp]

        mechanism%planar = .true.
        mechanism%times = [0.0_wp, 10.0_wp]
        associate (l => vehicle%half_length)
            call mechanism%add_body('front', vehicle%mass, [2*l, 0.0_wp], failure, inertia=[vehicle%inertia])
            call check_no_failure(error, failure)
            call mechanism%add_body('rear', vehicle%mass, zero, failure, inertia=[vehicle%inertia])
            call check_no_failure(error, failure)
            call mechanism%add_joint('pin', 'revolute', 'rear', 'front', failure, at=[l, 0.0_wp])
            call check_no_failure(error, failure)
            call mechanism%add_point('front', 'axle', [l, 0.0_wp], failure)
            call check_no_failure(error, failure)
            call mechanism%add_point('front', 'joint', [-l, 0.0_wp], failure)
            call check_no_failure(error, failure)
            call mechanism%add_point('rear', 'axle', [-l, 0.0_wp], failure)
            call check_no_failure(error, failure)
            call parse_expression(law, 'amplitude*sin(t)*(1 - step(t - 2*pi))', ['t'], failure, ['amplitude'], &
                [vehicle%amplitude])
            call check_no_failure(error, failure)
            call mechanism%add_knife_edge('front_wheel', 'front.axle', up, failure, steer=expression_function(law))
            call check_no_failure(error, failure)
            call mechanism%add_knife_edge('joint_wheel', 'front.joint', up, failure)
            call check_no_failure(error, failure)
            call mechanism%add_knife_edge('rear_wheel', 'rear.axle', up, failure)
            call check_no_failure(error, failure)
        end associate
    end subroutine draw_vehicle
end module test_mechanism_references
