! SPDX-License-Identifier: MIT
!> Tests of the motorcycle's procedures and starts against formulas that are written again here, with rotation matrices and finite
!> differences; and of the need masks of all scenes with fused procedures. Suite models has the other scenes.
module test_motorcycle
    use asserts, only: check_below, check_between, check_close, check_count, check_no_failure, check_true
    use differences, only: check_model_procedures, random_vector
    use runs, only: run
    use subjects, only: new_subject, subject_names
    use tandem, only: failure_type => error_type, model_type, motorcycle_type, n_terms, options_type, simulation_type, &
        term_name, terms_type, wp
    use tandem_linalg_basis, only: basis_type
    use tandem_rigid_euler_parameters, only: rotation
    use terms_at, only: get_terms
    use testdrive, only: error_type, new_unittest, unittest_type
    use watch, only: natural_errors
    implicit none (type, external)
    private

    public :: collect_motorcycle

    real(wp), parameter :: uy(3) = [0.0_wp, 1.0_wp, 0.0_wp], uz(3) = [0.0_wp, 0.0_wp, 1.0_wp]
    !> Number of random points per parameter set.
    integer, parameter :: n_points = 4
    !> Sixth-order central differences: f' = sum_i weight_i (f(i h) - f(-i h))/h. With h = 1e-2 truncation and rounding are about
    !> 1e-14 for functions of order one.
    real(wp), parameter :: weight(3) = [45.0_wp, -9.0_wp, 1.0_wp]/60.0_wp
    real(wp), parameter :: h = 1.0e-2_wp

contains

    !> The suite.
    subroutine collect_motorcycle(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('procedures-agree-with-differences', test_procedures), &
            new_unittest('holonomic-constraints-are-those-of-the-wheels', test_holonomic), &
            new_unittest('wheels-do-not-slip-sideways', test_slip), &
            new_unittest('kinetic-energy-is-that-of-a-rigid-body', test_energy), &
            new_unittest('forces-do-the-work-of-gravity-spring-damper-and-drive', test_work), &
            new_unittest('terms-that-are-not-asked-for-are-left-alone', test_need), &
            new_unittest('start-is-the-equilibrium-of-the-paper', test_equilibrium), &
            new_unittest('start-has-the-speed-and-no-pitch-rate', test_speed), &
            new_unittest('start-satisfies-the-constraints', test_consistent), &
            new_unittest('nothing-moves-in-equilibrium-at-rest', test_rest), &
            new_unittest('a-start-without-equilibrium-is-refused', test_no_equilibrium), &
            new_unittest('steering-ends-after-a-period-and-nu-jumps', test_breakpoint), &
            new_unittest('the-steering-makes-the-velocity-jump-at-its-end', test_jump)]
    end subroutine collect_motorcycle

    !> One of four parameter sets: standard, chopper, and two that have no number in common with the paper's.
    subroutine set_parameters(number, model)
        integer, intent(in) :: number
        type(motorcycle_type), intent(out) :: model

        if (number == 2) then
            model%fork_angle = atan(1.0_wp)
            model%amplitude = 0.0078_wp
        else if (number > 2) then
            model%mass = 170.0_wp
            model%inertia = [21.0_wp, 13.0_wp, 34.0_wp]
            model%gravity = 3.7_wp
            model%fork_angle = 0.1_wp*number
            model%stiffness = 9000.0_wp
            model%damping = 700.0_wp
            model%amplitude = 0.4_wp
            model%frequency = 1.3_wp
            model%driving_force = 90.0_wp
            model%wheel_radius = 0.35_wp
            model%rear_length = 0.7_wp
            model%half_track = 0.4_wp
            model%fork_forward = 0.5_wp
            model%fork_height = 0.65_wp
        end if
        if (number == 4) model%free_length = 0.72_wp
        call model%define()
    end subroutine set_parameters

    !> A random point near the upright motorcycle, off the constraints.
    subroutine random_point(model, seed, t, q, qd)
        type(motorcycle_type), intent(in) :: model
        integer, intent(inout) :: seed
        real(wp), intent(out) :: t, q(10), qd(10)
        real(wp) :: time(1)

        call random_vector(seed, time)
        call random_vector(seed, q)
        call random_vector(seed, qd)
        t = 2 + time(1)
        q = 0.5_wp*q
        q(4) = q(4) + 1.0_wp
        q(10) = q(10) + model%fork_height
    end subroutine random_point

    !> The steering angle.
    pure real(wp) function steering(model, t)
        type(motorcycle_type), intent(in) :: model
        real(wp), intent(in) :: t

        steering = 0.0_wp
        if (model%segment == 1) steering = -model%amplitude*sin(model%frequency*t)
    end function steering

    !> A vector of the wheel's frame in the chassis' frame: A1(fork angle about x) A2(steering about z).
    pure function from_wheel(model, t, vector) result(turned)
        type(motorcycle_type), intent(in) :: model
        real(wp), intent(in) :: t, vector(3)
        real(wp) :: turned(3), theta, x, y

        theta = steering(model, t)
        x = cos(theta)*vector(1) - sin(theta)*vector(2)
        y = sin(theta)*vector(1) + cos(theta)*vector(2)
        associate (c => cos(model%fork_angle), s => sin(model%fork_angle))
            turned = [x, c*y - s*vector(3), s*y + c*vector(3)]
        end associate
    end function from_wheel

    !> The front wheel's contact point (116), and the rim's tangent there (115).
    pure subroutine front_wheel(model, t, q, point, tangent)
        type(motorcycle_type), intent(in) :: model
        real(wp), intent(in) :: t, q(10)
        real(wp), intent(out) :: point(3), tangent(3)
        real(wp) :: a(3, 3), top(3)

        a = rotation(q(4:7))
        top = [0.0_wp, model%fork_forward, model%fork_height]
        point = q(1:3) + matmul(a, top + from_wheel(model, t, [0.0_wp, q(8), q(9) - q(10)]))
        tangent = matmul(a, from_wheel(model, t, [0.0_wp, -q(9), q(8)]))
    end subroutine front_wheel

    !> The cross product.
    pure function cross(a, b) result(c)
        real(wp), intent(in) :: a(3), b(3)
        real(wp) :: c(3)

        c = [a(2)*b(3) - a(3)*b(2), a(3)*b(1) - a(1)*b(3), a(1)*b(2) - a(2)*b(1)]
    end function cross

    !> Phi_q, nu, gamma, M and S. The potential energy includes neither damper nor drive, so they are off here.
    subroutine test_procedures(error)
        type(error_type), allocatable, intent(out) :: error
        type(motorcycle_type) :: model
        real(wp) :: t, q(10), qd(10)
        integer :: i, k, seed

        seed = 301
        do k = 1, 4
            call set_parameters(k, model)
            model%damping = 0.0_wp
            model%driving_force = 0.0_wp
            do i = 1, n_points
                call random_point(model, seed, t, q, qd)
                ! The last point is behind the steering.
                model%segment = 1 + i/n_points
                call check_model_procedures(model, t, q, qd, error)
            end do
        end do
    end subroutine test_procedures

    !> Heights of the rear wheels' and of the front contact point, the tangent's slope, two norms (117).
    subroutine test_holonomic(error)
        type(error_type), allocatable, intent(out) :: error
        type(motorcycle_type) :: model
        type(terms_type) :: terms
        real(wp) :: t, q(10), qd(10), a(3, 3), point(3), tangent(3), axle(3), expected(6)
        integer :: i, k, seed, stat

        seed = 302
        do k = 1, 4
            call set_parameters(k, model)
            do i = 1, n_points
                call random_point(model, seed, t, q, qd)
                call get_terms(model, t, q, qd, terms, stat)
                call front_wheel(model, t, q, point, tangent)
                a = rotation(q(4:7))
                axle = q(1:3) - model%rear_length*a(:, 2)
                expected(1) = axle(3) + model%half_track*a(3, 1) - model%wheel_radius
                expected(2) = axle(3) - model%half_track*a(3, 1) - model%wheel_radius
                expected(3) = point(3)
                expected(4) = tangent(3)
                expected(5) = (norm2(q(4:7))**2 - 1)/2
                expected(6) = (norm2(q(8:9))**2 - model%wheel_radius**2)/2
                ! Sums of some ten products of numbers below two.
                call check_close(error, terms%phi, expected, 1.0e-14_wp, 'Phi')
            end do
        end do
    end subroutine test_holonomic

    !> E qd - e: the rear axle's centre along the axle, the front contact point across its heading z x uz (118).
    subroutine test_slip(error)
        type(error_type), allocatable, intent(out) :: error
        type(motorcycle_type) :: model
        type(terms_type) :: terms
        real(wp) :: t, q(10), qd(10), a(3, 3), tangent(3), unused(3), expected(2)
        real(wp) :: plus(3), minus(3), front_speed(3), rear_speed(3)
        integer :: i, j, k, seed, stat

        seed = 303
        do k = 1, 4
            call set_parameters(k, model)
            do i = 1, n_points
                call random_point(model, seed, t, q, qd)
                call get_terms(model, t, q, qd, terms, stat)
                front_speed = 0.0_wp
                rear_speed = 0.0_wp
                do j = 1, 3
                    call front_wheel(model, t + j*h, q + j*h*qd, plus, unused)
                    call front_wheel(model, t - j*h, q - j*h*qd, minus, unused)
                    front_speed = front_speed + weight(j)*(plus - minus)/h
                    plus = q(1:3) + j*h*qd(1:3) - model%rear_length*matmul(rotation(q(4:7) + j*h*qd(4:7)), uy)
                    minus = q(1:3) - j*h*qd(1:3) - model%rear_length*matmul(rotation(q(4:7) - j*h*qd(4:7)), uy)
                    rear_speed = rear_speed + weight(j)*(plus - minus)/h
                end do
                call front_wheel(model, t, q, unused, tangent)
                a = rotation(q(4:7))
                expected = [dot_product(a(:, 1), rear_speed), dot_product(cross(tangent, uz), front_speed)]
                call check_close(error, matmul(terms%jacobian(7:8, :), qd) - terms%nu(7:8), expected, 1.0e-11_wp, 'slips')
            end do
        end do
    end subroutine test_slip

    !> qd' M qd/2 = m v**2/2 + omega' J omega/2 with ~omega = A' dA/dt for unit p.
    subroutine test_energy(error)
        type(error_type), allocatable, intent(out) :: error
        type(motorcycle_type) :: model
        type(terms_type) :: terms
        real(wp) :: t, q(10), qd(10), a(3, 3), rate(3, 3), spin(3, 3), omega(3), energy
        integer :: i, k, seed, stat

        seed = 304
        do k = 1, 4
            call set_parameters(k, model)
            do i = 1, n_points
                call random_point(model, seed, t, q, qd)
                call make_unit(q, qd)
                call get_terms(model, t, q, qd, terms, stat)
                a = rotation(q(4:7))
                ! Exact, since A is quadratic in p.
                rate = rotation(q(4:7) + qd(4:7)/2) - rotation(q(4:7) - qd(4:7)/2)
                spin = matmul(transpose(a), rate)
                omega = [spin(3, 2), spin(1, 3), spin(2, 1)]
                energy = (model%mass*norm2(qd(1:3))**2 + sum(model%inertia*omega**2))/2
                call check_below(error, abs(dot_product(qd, matmul(terms%mass, qd))/2/energy - 1), 1.0e-14_wp, 'energy')
            end do
        end do
    end subroutine test_energy

    !> p of length one, pd orthogonal to it.
    pure subroutine make_unit(q, qd)
        real(wp), intent(inout) :: q(10), qd(10)

        q(4:7) = q(4:7)/norm2(q(4:7))
        qd(4:7) = qd(4:7) - q(4:7)*dot_product(q(4:7), qd(4:7))
    end subroutine make_unit

    !> Power of the forces: weight, spring and damper along the fork, and the drive, which pushes the rear wheels forward at their
    !> ground contact, at (0, -rear_length, -wheel_radius) of the chassis. S does no work on unit p beyond -qd' Md qd/2.
    subroutine test_work(error)
        type(error_type), allocatable, intent(out) :: error
        type(motorcycle_type) :: model
        type(terms_type) :: terms, rest
        real(wp) :: t, q(10), qd(10), a(3, 3), rate(3, 3), wheel(3), power
        integer :: i, k, seed, stat

        seed = 305
        do k = 1, 4
            call set_parameters(k, model)
            do i = 1, n_points
                call random_point(model, seed, t, q, qd)
                call make_unit(q, qd)
                call get_terms(model, t, q, qd, terms, stat)
                call get_terms(model, t, q, 0*qd, rest, stat)
                a = rotation(q(4:7))
                rate = rotation(q(4:7) + qd(4:7)/2) - rotation(q(4:7) - qd(4:7)/2)
                wheel = qd(1:3) + matmul(rate, [0.0_wp, -model%rear_length, -model%wheel_radius])
                power = -model%mass*model%gravity*qd(3) - model%stiffness*(q(10) - model%spring_length())*qd(10) + &
                    model%driving_force*dot_product(a(:, 2), wheel)
                ! Forces of some thousand newtons.
                call check_close(error, [dot_product(rest%force, qd)], [power], 1.0e-10_wp, 'power at rest')
                call check_close(error, [terms%force(10) - rest%force(10)], [-model%damping*qd(10)], 1.0e-10_wp, 'damping')
            end do
        end do
    end subroutine test_work

    !> Each term separately, with a mark in all the others.
    subroutine test_need(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable :: model
        type(terms_type) :: all, one
        real(wp), parameter :: mark = 12345.0_wp
        real(wp), allocatable :: q(:), qd(:)
        integer :: i, k, stat

        do k = 1, size(subject_names) - 1
            call new_subject(trim(subject_names(k)), model, q, qd)
            call all%allocate(model%n, model%n_holonomic, model%n_nonholonomic)
            call model%evaluate(model%provides, 0.7_wp, q, qd, all, stat)
            do i = 1, n_terms
                if (.not. btest(model%provides, i - 1)) cycle
                call one%allocate(model%n, model%n_holonomic, model%n_nonholonomic)
                one%phi = mark
                one%jacobian = mark
                one%nu = mark
                one%gamma = mark
                one%mass = mark
                one%force = mark
                call model%evaluate(2**(i - 1), 0.7_wp, q, qd, one, stat)
                call check_one(i == 1, one%phi, all%phi)
                call check_one(i == 2, [one%jacobian], [all%jacobian])
                call check_one(i == 3, one%nu, all%nu)
                call check_one(i == 4, one%gamma, all%gamma)
                call check_one(i == 5, [one%mass], [all%mass])
                call check_one(i == 6, one%force, all%force)
            end do
        end do

    contains

        !> Equal to the complete set if requested, else the mark.
        subroutine check_one(wanted, found, expected)
            logical, intent(in) :: wanted
            real(wp), intent(in) :: found(:), expected(:)

            if (wanted) then
                call check_close(error, found, expected, 0.0_wp, trim(subject_names(k))//': '//term_name(i))
            else
                call check_below(error, maxval(abs(found - mark)), 0.0_wp, trim(subject_names(k))//': what was not asked for')
            end if
        end subroutine check_one
    end subroutine test_need

    !> s = 0.6207 and e1 = 0.00315 for a fork at 0.2, 0.9103 and 0.01184 for pi/4, to the digits given.
    subroutine test_equilibrium(error)
        type(error_type), allocatable, intent(out) :: error
        type(motorcycle_type) :: model
        real(wp) :: q(10), qd(10)
        integer :: stat

        call set_parameters(1, model)
        call model%start(15.0_wp, q, qd, stat)
        call check_count(error, stat, 0, 'status')
        call check_close(error, [q(10), q(5)], [0.6207_wp, 0.00315_wp], 5.0e-5_wp, 's and e1')
        call check_close(error, [q(5)], [0.00315_wp], 5.0e-6_wp, 'e1')
        call set_parameters(2, model)
        call model%start(15.0_wp, q, qd, stat)
        call check_close(error, [q(10)], [0.9103_wp], 5.0e-5_wp, 's of the chopper')
        call check_close(error, [q(5)], [0.01184_wp], 5.0e-6_wp, 'e1 of the chopper')
    end subroutine test_equilibrium

    !> P0, the rear axle's centre, moves along y; omega'_x = 2 (G pd)_x = 0.
    subroutine test_speed(error)
        type(error_type), allocatable, intent(out) :: error
        type(motorcycle_type) :: model
        real(wp) :: q(10), qd(10), rate(3, 3), a(3, 3), axle(3)
        integer :: k, stat

        do k = 1, 4
            call set_parameters(k, model)
            call model%start(15.0_wp, q, qd, stat)
            call check_count(error, stat, 0, 'status')
            a = rotation(q(4:7))
            rate = rotation(q(4:7) + qd(4:7)/2) - rotation(q(4:7) - qd(4:7)/2)
            axle = qd(1:3) - model%rear_length*rate(:, 2)
            call check_close(error, axle, [0.0_wp, 15.0_wp, 0.0_wp], 1.0e-13_wp, 'velocities of P0')
            call check_below(error, abs(dot_product(a(:, 3), rate(:, 2))), 1.0e-14_wp, 'pitch rate')
            call check_close(error, q([1, 2, 6, 7]), spread(0.0_wp, 1, 4), 0.0_wp, 'rx, ry, e2, e3')
        end do
    end subroutine test_speed

    subroutine test_consistent(error)
        type(error_type), allocatable, intent(out) :: error
        type(motorcycle_type) :: model
        type(terms_type) :: terms
        real(wp) :: q(10), qd(10), errors(3)
        integer :: k, stat

        do k = 1, 4
            call set_parameters(k, model)
            call model%start(15.0_wp, q, qd, stat)
            call get_terms(model, 0.0_wp, q, qd, terms, stat)
            call natural_errors(terms, 6, spread(1.0_wp, 1, 10), q, qd, qd, errors)
            call check_below(error, errors(1), 1.0e-15_wp, 'position error of the start')
            call check_below(error, errors(2), 1.0e-15_wp, 'velocity error of the start')
        end do
    end subroutine test_consistent

    !> Without speed, steering and drive every acceleration is zero.
    subroutine test_rest(error)
        type(error_type), allocatable, intent(out) :: error
        type(motorcycle_type), target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: q(10), qd(10)
        integer :: k, stat

        do k = 1, 4
            call set_parameters(k, model)
            model%amplitude = 0.0_wp
            model%driving_force = 0.0_wp
            call model%define()
            call model%start(0.0_wp, q, qd, stat)
            call simulation%initialize(model, options, 0.0_wp, q, qd, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call check_below(error, maxval(abs(qd)), 0.0_wp, 'velocity')
            ! A spring force of 1e3 has a rounding of 1e-12, on a mass of some tens.
            call check_below(error, maxval(abs(simulation%state%qdd)), 1.0e-12_wp, 'acceleration')
        end do
    end subroutine test_rest

    !> A spring that is far too long.
    subroutine test_no_equilibrium(error)
        type(error_type), allocatable, intent(out) :: error
        type(motorcycle_type) :: model
        real(wp) :: q(10), qd(10)
        integer :: stat

        model%free_length = 50.0_wp
        call model%define()
        call model%start(15.0_wp, q, qd, stat)
        call check_true(error, stat > 0, 'stat > 0')
    end subroutine test_no_equilibrium

    !> At 2 pi/frequency; nu before and after by its segment, and none for a frequency of zero.
    subroutine test_breakpoint(error)
        type(error_type), allocatable, intent(out) :: error
        type(motorcycle_type) :: model
        type(terms_type) :: before, after
        real(wp) :: q(10), qd(10), t
        integer :: stat

        call set_parameters(3, model)
        t = 8*atan(1.0_wp)/1.3_wp
        call check_close(error, model%breakpoints, [t], 1.0e-15_wp, 'breakpoints')
        call check_true(error, all(model%nu_jumps), 'nu jumps')
        call model%start(15.0_wp, q, qd, stat)
        call get_terms(model, t, q, qd, before, stat)
        model%segment = 2
        call get_terms(model, t, q, qd, after, stat)
        ! theta is zero on both sides, its rate is not.
        call check_close(error, before%phi, after%phi, 1.0e-15_wp, 'Phi')
        call check_below(error, 0.01_wp, maxval(abs(before%nu)), 'a hundredth')
        call check_below(error, maxval(abs(after%nu)), 0.0_wp, 'nu after the steering')
        model%frequency = 0.0_wp
        call model%define()
        call check_count(error, size(model%breakpoints), 0, 'breakpoints of straight steering')
    end subroutine test_breakpoint

    !> qd- and qd+ at 2 pi: C qd+ = nu+, and the jump is M-orthogonal to every velocity that C allows, so that it is the smallest.
    subroutine test_jump(error)
        type(error_type), allocatable, intent(out) :: error
        type(motorcycle_type), target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(terms_type) :: terms
        type(failure_type), allocatable :: failure
        type(basis_type) :: basis
        real(wp) :: q(10), qd(10), before(10), push(10), t
        integer :: stat

        call set_parameters(1, model)
        model%amplitude = 0.05_wp
        call model%start(15.0_wp, q, qd, stat)
        options%step = 2.0e-3_wp
        t = model%breakpoints(1)
        call run(simulation, model, options, 0.0_wp, q, qd, t - 1.0e-9_wp, failure)
        call check_no_failure(error, failure)
        before = simulation%state%qd
        call simulation%integrate(t, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call check_count(error, model%segment, 2, 'segment')
        associate (state => simulation%state)
            call get_terms(model, state%t, state%q, state%qd, terms, stat)
            call check_below(error, maxval(abs(matmul(terms%jacobian, state%qd))), 1.0e-12_wp, 'C qd - nu')
            ! The acceleration of some m/s**2 moves qd by 1e-8 in the last 1e-9 s.
            call check_between(error, maxval(abs(state%qd - before)), 1.0e-3_wp, 1.0_wp, 'jump')
            call basis%allocate(10, 6, 8)
            call basis%factor_qr(terms%jacobian, spread(1.0_wp, 1, 10), 10)
            push = matmul(terms%mass, state%qd - before)
            call check_below(error, maxval(abs(matmul(push, basis%q(:, 9:))))/maxval(abs(push)), 1.0e-6_wp, &
                'part of M (qd+ - qd-) along null(C)')
        end associate
    end subroutine test_jump
end module test_motorcycle
