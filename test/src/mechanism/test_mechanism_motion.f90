! SPDX-License-Identifier: MIT
!> Tests of whole mechanisms: the IFToMM library's pendulum and Bricard mechanism, Andrews' squeezer, each against a
!> reference that is independent of this project's solver or a closed form; and the rolling disk as a mechanism against the disk
!> that was derived by hand.
module test_mechanism_motion
    use asserts, only: check_below, check_close, check_count, check_no_failure, check_text
    use kkt, only: kkt_type
    use mechanism_checks, only: go
    use tandem, only: failure_type => error_type, mechanism_type, rolling_disk_type, simulation_type, wp
    use tandem_linalg_random, only: random_vector
    use tandem_mechanism_vector, only: cross
    use tandem_rigid_euler_parameters, only: b_product, e_transposed_product, g_product, rotation
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_mechanism_motion

    real(wp), parameter :: pi = acos(-1.0_wp)

contains

    !> The suite.
    subroutine collect_mechanism_motion(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('pendulum-of-a-point-mass', test_point_pendulum), &
            new_unittest('pendulum-of-a-body', test_body_pendulum), &
            new_unittest('andrews-squeezer', test_andrews), &
            new_unittest('bricard', test_bricard), &
            new_unittest('ball-of-unequal-inertia', test_ball), &
            new_unittest('disk-on-its-steady-circle', test_circle), &
            new_unittest('disk-as-derived-by-hand', test_disk)]
    end subroutine collect_mechanism_motion

    !> From the horizontal at rest; theta = 2 asin(k cd(sqrt(g) t | k^2)), k = sin(pi/4), gives the position at t = 10. The
    !> tolerance of 1e-11 per step, and an error that grows with the square of the time due to the error of the period, give 1e-9.
    subroutine test_point_pendulum(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure

        mechanism%planar = .true.
        mechanism%gravity = [0.0_wp, -9.81_wp, 0.0_wp]
        call mechanism%add_body('mass', 1.0_wp, [-1.0_wp, 0.0_wp], failure)
        call check_no_failure(error, failure)
        call mechanism%add_distance('rod', 'ground', 'mass', failure)
        call check_no_failure(error, failure)
        call go(mechanism, 1.0e-11_wp, 10.0_wp, simulation, error)
        if (allocated(error)) return
        call check_close(error, simulation%state%q, [-0.27508746257611686_wp, -0.96141920509912506_wp], 1.0e-9_wp, 'mass')
    end subroutine test_point_pendulum

    !> The same as a rod without mass: M is singular, but not on the null space of the rows.
    subroutine test_body_pendulum(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure

        mechanism%planar = .true.
        mechanism%gravity = [0.0_wp, -9.81_wp, 0.0_wp]
        call mechanism%add_body('mass', 1.0_wp, [-1.0_wp, 0.0_wp], failure, inertia=[0.0_wp])
        call check_no_failure(error, failure)
        call mechanism%add_joint('pivot', 'revolute', 'ground', 'mass', failure, at=[0.0_wp, 0.0_wp])
        call check_no_failure(error, failure)
        call go(mechanism, 1.0e-11_wp, 10.0_wp, simulation, error)
        if (allocated(error)) return
        call check_close(error, simulation%state%q(1:2), [-0.27508746257611686_wp, -0.96141920509912506_wp], 1.0e-9_wp, 'mass')
    end subroutine test_body_pendulum

    !> Data and coordinates of the IVP test set; the reference is more accurate than the test set's.
    subroutine test_andrews(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: rr = 0.007_wp, d = 0.028_wp, da = 0.0115_wp, e = 0.02_wp, ea = 0.01421_wp, zf = 0.02_wp, &
            fa = 0.01421_wp, ra = 0.00092_wp, ss = 0.035_wp, sa = 0.01874_wp, sb = 0.01043_wp, sc = 0.018_wp, sd = 0.02_wp, &
            zt = 0.04_wp, ta = 0.02308_wp, tb = 0.00916_wp, u = 0.04_wp, ua = 0.01228_wp, ub = 0.00449_wp
        real(wp), parameter :: a(2) = [-0.06934_wp, -0.00227_wp], b(2) = [-0.03635_wp, 0.03273_wp], c(2) = [0.014_wp, 0.072_wp]
        !> beta, Theta, gamma, Phi, delta, Omega, epsilon, at rest.
        real(wp), parameter :: start(7) = [-0.0617138900142764496_wp, 0.0_wp, 0.455279819163070380_wp, 0.222668390165885885_wp, &
            0.487364979543842550_wp, -0.222668390165885885_wp, 1.23054744454982119_wp]
        real(wp), parameter :: finish(7) = [15.810771195153707_wp, -15.756371058411840_wp, 0.040822240119645805_wp, &
            -0.53473011634207960_wp, 0.52440996587995407_wp, 0.53473011634207960_wp, 1.0480807410419379_wp]
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: angle(7), p(2), far(2), g(2), h(2)

        mechanism%planar = .true.
        p = along(rr, start(1))
        g = a + along(zt, start(5))
        h = a + along(u, start(7) - pi/2)
        call add('k1', 0.04325_wp, 2.194e-6_wp, along(ra, start(1)), start(1))
        call point('k1', 'o', [-ra, 0.0_wp])
        call point('k1', 'p', [rr - ra, 0.0_wp])
        far = start(1) + start(2)
        call add('k2', 0.00365_wp, 4.41e-7_wp, p - along(da, far(1)), far(1))
        call point('k2', 'p', [da, 0.0_wp])
        call point('k2', 'e', [da - d, 0.0_wp])
        call add('k3', 0.02373_wp, 5.255e-6_wp, b + along(sb, start(3)) + along(sa, start(3) - pi/2), start(3))
        call point('k3', 'b', [-sb, sa])
        call point('k3', 'e', [-sb, sa - ss])
        call point('k3', 'd', [sd - sb, sa - sc])
        far = start(4) + start(5)
        call add('k4', 0.00706_wp, 5.667e-7_wp, g + along(e - ea, far(1) - pi/2), far(1))
        call point('k4', 'g', [0.0_wp, e - ea])
        call point('k4', 'e', [0.0_wp, -ea])
        call add('k5', 0.0705_wp, 1.169e-5_wp, a + along(ta, start(5)) + along(tb, start(5) + pi/2), start(5))
        call point('k5', 'a', [-ta, -tb])
        call point('k5', 'g', [zt - ta, -tb])
        far = start(6) + start(7)
        call add('k6', 0.00706_wp, 5.667e-7_wp, h + along(zf - fa, far(1)), far(1))
        call point('k6', 'h', [fa - zf, 0.0_wp])
        call point('k6', 'e', [fa, 0.0_wp])
        call add('k7', 0.05498_wp, 1.912e-5_wp, a + along(ua, start(7) - pi/2) - along(ub, start(7)), start(7))
        call point('k7', 'a', [ub, ua])
        call point('k7', 'h', [ub, ua - u])
        call point('ground', 'a', a)
        call point('ground', 'b', b)
        call point('ground', 'c', c)
        call point('ground', 'o', [0.0_wp, 0.0_wp])
        call pin('o', 'ground.o', 'k1.o')
        call pin('p', 'k1.p', 'k2.p')
        call pin('b', 'ground.b', 'k3.b')
        call pin('a5', 'ground.a', 'k5.a')
        call pin('a7', 'ground.a', 'k7.a')
        call pin('g', 'k5.g', 'k4.g')
        call pin('h', 'k7.h', 'k6.h')
        call pin('e3', 'k2.e', 'k3.e')
        call pin('e4', 'k2.e', 'k4.e')
        call pin('e6', 'k2.e', 'k6.e')
        if (allocated(error)) return
        call mechanism%add_spring('coil', 'ground.c', 'k3.d', failure, stiffness=4530.0_wp, length=0.07785_wp)
        call check_no_failure(error, failure)
        call mechanism%add_load('motor', 'k1', failure, torque=[0.033_wp])
        call check_no_failure(error, failure)
        call go(mechanism, 1.0e-12_wp, 0.03_wp, simulation, error)
        if (allocated(error)) return
        call check_count(error, mechanism%n_holonomic, 20, 'rows')
        angle = simulation%state%q(3:21:3)
        angle = [angle(1), angle(2) - angle(1), angle(3), angle(4) - angle(5), angle(5), angle(6) - angle(7), angle(7)]
        ! Angles of 16 rad, in a motion that amplifies an error of a step fifty times.
        call check_close(error, angle, finish, 1.0e-9_wp, 'angles')

    contains

        !> A vector of a length at an angle.
        pure function along(length, direction) result(v)
            real(wp), intent(in) :: length, direction
            real(wp) :: v(2)

            v = length*[cos(direction), sin(direction)]
        end function along

        subroutine add(name, mass, inertia, position, direction)
            character(len=*), intent(in) :: name
            real(wp), intent(in) :: mass, inertia, position(2), direction

            call mechanism%add_body(name, mass, position, failure, inertia=[inertia], orientation=[direction])
            call check_no_failure(error, failure)
        end subroutine add

        subroutine point(body, name, place)
            character(len=*), intent(in) :: body, name
            real(wp), intent(in) :: place(2)

            call mechanism%add_point(body, name, place, failure)
            call check_no_failure(error, failure)
        end subroutine point

        subroutine pin(name, one, other)
            character(len=*), intent(in) :: name, one, other

            call mechanism%add_joint(name, 'revolute', one, other, failure)
            call check_no_failure(error, failure)
        end subroutine pin
    end subroutine test_andrews

    !> Five bars of 1 m and a section of 0.1 m x 0.1 m, six hinges with axes along the edges of a cube: one row is redundant.
    subroutine test_bricard(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: corner(3, 6) = reshape([0.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp, -1.0_wp, 0.0_wp, &
            1.0_wp, -1.0_wp, 1.0_wp, 0.0_wp, -1.0_wp, 1.0_wp, 0.0_wp, 0.0_wp, 1.0_wp], [3, 6])
        integer, parameter :: axis(6) = [2, 3, 1, 2, 3, 1]
        real(wp), parameter :: thin = 0.02_wp/12, thick = 1.01_wp/12
        real(wp), parameter :: expected(3, 2) = reshape([0.27448131926462304_wp, -0.88670793873467202_wp, -0.46233000268737604_wp, &
            -0.77813537303329089_wp, -0.98035268344325656_wp, -0.19725267061717062_wp], [3, 2])
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: inertia(3), along(3), tip(3)
        character(len=6) :: name(0:6)
        integer :: i

        mechanism%gravity = [0.0_wp, -9.81_wp, 0.0_wp]
        name = 'ground'
        do i = 1, 5
            write (name(i), '(a, i0)') 'bar', i
            along = corner(:, i + 1) - corner(:, i)
            inertia = merge(thin, thick, abs(along) > 0.5_wp)
            call mechanism%add_body(trim(name(i)), 1.0_wp, (corner(:, i) + corner(:, i + 1))/2, failure, inertia=inertia)
            call check_no_failure(error, failure)
        end do
        do i = 1, 6
            along = 0.0_wp
            along(axis(i)) = 1.0_wp
            call mechanism%add_joint('hinge'//achar(iachar('0') + i), 'revolute', name(i - 1), name(i), failure, &
                at=corner(:, i), axis=along)
            call check_no_failure(error, failure)
        end do
        call go(mechanism, 1.0e-11_wp, 1.0_wp, simulation, error)
        if (allocated(error)) return
        call check_count(error, simulation%n_redundant, 1, 'redundant rows')
        call check_text(error, simulation%warnings(1)%text, 'the constraint "hinge')
        do i = 1, 2
            if (i == 2) call simulation%integrate(2.0_wp, failure)
            call check_no_failure(error, failure)
            ! The end of the second bar.
            tip = simulation%state%q(8:10) + matmul(rotation(simulation%state%q(11:14)), [0.0_wp, -0.5_wp, 0.0_wp])
            call check_close(error, tip, expected(:, i), 1.0e-9_wp, 'corner')
        end do
    end subroutine test_bricard

    !> Chaplygin's sphere; the reference solves Euler's equation of the momentum about the contact in the body's frame.
    subroutine test_ball(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: p(4) = [1.8_wp, 0.48_wp, -0.36_wp, 0.0_wp], spin(3) = [1.0_wp, -0.5_wp, 0.7_wp]
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: omega(3)

        ! p turns (0.36, 0.48, 0.8) in the body's frame up.
        omega = matmul(rotation(p/norm2(p)), spin)
        mechanism%gravity = [0.0_wp, 0.0_wp, -9.81_wp]
        call mechanism%add_body('ball', 0.7_wp, [0.0_wp, 0.0_wp, 1.0_wp], failure, inertia=[1.0_wp, 1.5_wp, 2.0_wp], &
            orientation=p, velocity=[omega(2), -omega(1), 0.0_wp], omega=omega)
        call check_no_failure(error, failure)
        call mechanism%add_rolling_sphere('rolling', 'ball', 1.0_wp, failure)
        call check_no_failure(error, failure)
        call go(mechanism, 1.0e-11_wp, 10.0_wp, simulation, error)
        if (allocated(error)) return
        omega = 2*g_product(simulation%state%q(4:7), simulation%state%qd(4:7))
        call check_close(error, omega, [0.642245648620_wp, 1.068456168290_wp, -0.326474171625_wp], 1.0e-9_wp, 'angular velocity')
    end subroutine test_ball

    !> The axis at 70 degrees to the vertical precesses at a constant rate; the centre moves on a circle of radius |w/rate|.
    subroutine test_circle(error)
        type(error_type), allocatable, intent(out) :: error
        !> Angle of the axis, rate of the precession, total spin about the axis.
        real(wp), parameter :: alpha = 70*pi/180, rate = 1.3_wp, w = -1.7569458910750517_wp, t = 10.0_wp
        real(wp), parameter :: half = (alpha - pi/2)/2, up(3) = [0.0_wp, 0.0_wp, 1.0_wp]
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: axis(3), omega(3), velocity(3), way(3), expected(3)

        axis = [sin(alpha), 0.0_wp, cos(alpha)]
        omega = w*axis + rate*(up - cos(alpha)*axis)
        velocity = cross(omega, up - cos(alpha)*axis)/sin(alpha)
        mechanism%gravity = [0.0_wp, 0.0_wp, -9.81_wp]
        call mechanism%add_body('disk', 1.0_wp, [0.0_wp, 0.0_wp, sin(alpha)], failure, inertia=[0.5_wp, 0.25_wp, 0.25_wp], &
            orientation=[cos(half), 0.0_wp, sin(half), 0.0_wp], velocity=velocity, omega=omega)
        call check_no_failure(error, failure)
        call mechanism%add_rolling_disk('rim', 'disk', 1.0_wp, axis, failure)
        call check_no_failure(error, failure)
        call go(mechanism, 1.0e-11_wp, t, simulation, error)
        if (allocated(error)) return
        ! From the circle's centre to the disk's: up x way = velocity/rate.
        way = -cross(up, velocity)/rate
        expected = [0.0_wp, 0.0_wp, sin(alpha)] - way + cos(rate*t)*way + sin(rate*t)*cross(up, way)
        call check_close(error, simulation%state%q(1:3), expected, 1.0e-8_wp, 'centre')
    end subroutine test_circle

    !> Accelerations, contact forces and the multiplier of the Euler parameters at 1000 random states on the manifold.
    subroutine test_disk(error)
        type(error_type), allocatable, intent(out) :: error
        !> Of the scale of each: both systems are solved up to rounding, and their conditions are below 1e3.
        real(wp), parameter :: bound = 1.0e-12_wp
        type(mechanism_type), target :: mechanism
        type(rolling_disk_type), target :: disk
        type(failure_type), allocatable :: failure
        type(kkt_type) :: of_mechanism, of_disk
        real(wp) :: q(7), qd(7), qdd(7), lambda(4), q9(9), qd9(9), qdd9(9), lambda6(6), p(4), a(3), y(3), omega(3), g
        real(wp) :: alpha(3), beta(3), rate(3), worst(3), norm
        integer :: i, seed

        call disk%define()
        mechanism%gravity = [0.0_wp, 0.0_wp, -disk%gravity]
        call mechanism%add_body('disk', disk%mass, [0.0_wp, 0.0_wp, disk%radius], failure, inertia=disk%inertia)
        call check_no_failure(error, failure)
        call mechanism%add_rolling_disk('rim', 'disk', disk%radius, [1.0_wp, 0.0_wp, 0.0_wp], failure)
        call check_no_failure(error, failure)
        call mechanism%define(failure)
        call check_no_failure(error, failure)
        of_mechanism%model => mechanism
        of_disk%model => disk
        seed = 4711
        worst = 0.0_wp
        i = 0
        do while (i < 1000)
            p = random_vector(seed, 4)
            p = p/norm2(p)
            omega = 3*random_vector(seed, 3)
            a = matmul(rotation(p), [1.0_wp, 0.0_wp, 0.0_wp])
            ! Not flatter than 18 degrees.
            if (abs(a(3)) > 0.95_wp) cycle
            i = i + 1
            g = sqrt(1 - a(3)**2)
            y = -disk%radius*([0.0_wp, 0.0_wp, 1.0_wp] - a(3)*a)/g
            q(1:2) = random_vector(seed, 2)
            q(3) = -y(3)
            q(4:7) = p
            qd(1:3) = -cross(omega, y)
            qd(4:7) = 0.5_wp*e_transposed_product(p, omega)
            alpha = matmul(y, rotation(p))
            beta = [0.0_wp, -alpha(3), alpha(2)]
            q9 = [q, alpha(2:3)]
            rate = b_product(p, beta, qd(4:7))
            qd9 = [qd, rate(3)/y(3)*beta(2:3)]
            call of_mechanism%accelerate(0.0_wp, q, qd, qdd, lambda)
            call of_disk%accelerate(0.0_wp, q9, qd9, qdd9, lambda6)
            ! Euler parameters off the unit sphere are another continuation of the same motion: its contribution to their
            ! multiplier.
            norm = lambda(2) + lambda(1)*2*(disk%radius*a(3)**2/g - y(3)) - 2*(lambda(3)*y(1) + lambda(4)*y(2))
            worst(1) = max(worst(1), maxval(abs(qdd - qdd9(1:7)))/maxval(abs(qdd9(1:7))))
            worst(2) = max(worst(2), maxval(abs(lambda([1, 3, 4]) - lambda6([1, 5, 6])))/maxval(abs(lambda6)))
            worst(3) = max(worst(3), abs(norm - lambda6(3))/maxval(abs(lambda6)))
        end do
        call check_below(error, worst(1), bound, 'accelerations')
        call check_below(error, worst(2), bound, 'contact forces')
        call check_below(error, worst(3), bound, 'multiplier of the Euler parameters')
    end subroutine test_disk
end module test_mechanism_motion
