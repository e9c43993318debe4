! SPDX-License-Identifier: MIT
!> Tests of massless wheels: every procedure against differences, the motorcycles derived by hand, the same wheels as bodies without
!> mass, sensors and springs of the strut, and error messages.
module test_massless_wheel
    use asserts, only: check_below, check_close, check_count, check_no_failure, check_true
    use kkt, only: kkt_type
    use mechanism_checks, only: check_drawing, draw, go, verify
    use tandem, only: expression_law, expression_type, failure_type => error_type, friction_law_type, mechanism_type, &
        motorcycle_type, parse_expression, plane_type, ramp, simulation_type, sine_type, terms_type, wp
    use tandem_linalg_random, only: random_vector
    use tandem_rigid_euler_parameters, only: rotation
    use terms_at, only: get_terms
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_massless_wheel

    real(wp), parameter :: pi = acos(-1.0_wp)
    real(wp), parameter :: normal(3) = [0.1_wp, -0.2_wp, 0.9_wp], axle(3) = [1.0_wp, 0.2_wp, 0.3_wp], &
        strut(3) = [0.1_wp, 0.4_wp, -1.0_wp]

contains

    !> The suite.
    subroutine collect_massless_wheel(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('procedures-agree-with-differences', test_procedures), &
            new_unittest('motorcycles-as-derived-by-hand', test_motorcycles), &
            new_unittest('the-same-as-bodies', test_bodies), &
            new_unittest('words-name-what-is-wrong', test_words)]
    end subroutine collect_massless_wheel

    !> On a body only, steered, on a strut, with a round rim, on a rising plane; forces, couplings and loads along the strut.
    subroutine test_procedures(error)
        type(error_type), allocatable, intent(out) :: error
        type(sine_type), parameter :: swing = sine_type(offset=0.1_wp, amplitude=0.3_wp, rate=2.0_wp, phase=0.5_wp)
        type(mechanism_type) :: mechanism
        type(failure_type), allocatable :: failure
        type(expression_type) :: law, push(3)
        integer :: i

        call draw(mechanism, .false.)
        call mechanism%add_massless_wheel('wheel', 'first', 0.8_wp, axle, failure, plane=plane_type(open=.true.))
        call check_no_failure(error, failure)
        call mechanism%add_massless_wheel('tyre', 'second.tip', 0.5_wp, axle, failure, steer=swing, about=strut, crown=0.1_wp, &
            plane=plane_type(normal=normal, height=-0.2_wp, open=.true., rise=swing))
        call check_no_failure(error, failure)
        call verify(mechanism, 'on bodies', error)
        call check_count(error, mechanism%n, 14, 'coordinates on bodies')
        call check_count(error, mechanism%n_holonomic, 4, 'rows at position level on bodies')
        call check_count(error, mechanism%n_nonholonomic, 2, 'rows at velocity level on bodies')

        call draw(mechanism, .false.)
        call mechanism%add_massless_wheel('front', 'first.tip', 0.8_wp, axle, failure, along=strut, plane=plane_type(open=.true.))
        call check_no_failure(error, failure)
        call mechanism%add_massless_wheel('rear', 'second', 0.5_wp, axle, failure, along=strut, steer=swing, crown=0.1_wp, &
            plane=plane_type(normal=normal, height=-0.2_wp, open=.true., rise=swing))
        call check_no_failure(error, failure)
        call mechanism%add_massless_wheel('third', 'second.tip', 0.5_wp, axle, failure, along=strut, steer=swing, &
            about=[0.3_wp, 1.0_wp, 0.2_wp], plane=plane_type(open=.true.))
        call check_no_failure(error, failure)
        call parse_expression(law, '300*x^3 + 20*v*abs(v)', [character(len=1) :: 't', 'x', 'v'], failure)
        call check_no_failure(error, failure)
        call mechanism%add_torsion('bump', 'front', failure, stiffness=50.0_wp, damping=3.0_wp, angle=-0.2_wp, &
            law=expression_law(law))
        call check_no_failure(error, failure)
        call mechanism%add_coupling('bar', ['front.displacement', 'rear.displacement '], [1.0_wp, -0.5_wp], failure, motion=swing)
        call check_no_failure(error, failure)
        do i = 1, 3
            call parse_expression(push(i), merge('third.displacement*first.x', 'rear.speed*t              ', i == 2), &
                mechanism%variable_names(), failure)
            call check_no_failure(error, failure)
        end do
        call mechanism%add_load('push', 'first.tip', failure, force_by=push)
        call check_no_failure(error, failure)
        call verify(mechanism, 'on struts', error)
        call check_count(error, mechanism%n, 17, 'coordinates on struts')
    end subroutine test_procedures

    !> Accelerations, forces at the wheels, and the generalised force of all rows on the chassis at 1000 random consistent states,
    !> for each fork. The multiplier of the Euler parameters is among these forces.
    subroutine test_motorcycles(error)
        type(error_type), allocatable, intent(out) :: error
        !> Of the scale of each: both systems are solved to rounding.
        real(wp), parameter :: bound = 1.0e-12_wp
        type(motorcycle_type), target :: hand
        type(mechanism_type), target :: mechanism
        type(kkt_type) :: of_hand, of_mechanism
        type(terms_type) :: terms, by_hand
        real(wp) :: q(8), qd(8), qdd(8), lambda(6), q10(10), qd10(10), qdd10(10), lambda8(8), worst(3), t
        real(wp) :: force(7), force_by_hand(7)
        integer :: i, k, seed, stat

        do k = 1, 2
            hand%fork_angle = merge(0.2_wp, pi/4, k == 1)
            ! Much larger than on the road.
            hand%amplitude = 0.4_wp
            call hand%define()
            call draw_motorcycle(mechanism, hand, error)
            if (allocated(error)) return
            of_hand%model => hand
            of_mechanism%model => mechanism
            seed = 4711 + k
            worst = 0.0_wp
            do i = 1, 1000
                t = 0.006_wp*i
                call choose_state(t, q, qd, q10, qd10)
                call of_mechanism%accelerate(t, q, qd, qdd, lambda)
                call of_hand%accelerate(t, q10, qd10, qdd10, lambda8)
                worst(1) = max(worst(1), maxval(abs(qdd - qdd10([1, 2, 3, 4, 5, 6, 7, 10])))/maxval(abs(qdd10)))
                ! left, right, front, norm; rear, front. By hand: right, left, front ..., rear, front per metre of the radius.
                worst(2) = max(worst(2), maxval(abs([lambda(1:3), abs(lambda(5:6))] - [lambda8([2, 1, 3]), abs(lambda8(7)), &
                    hand%wheel_radius*abs(lambda8(8))]))/maxval(abs(lambda8(1:3))))
                call get_terms(mechanism, t, q, qd, terms, stat)
                force = matmul(lambda, terms%jacobian(:, 1:7))
                call get_terms(hand, t, q10, qd10, by_hand, stat)
                force_by_hand = matmul(lambda8, by_hand%jacobian(:, 1:7))
                worst(3) = max(worst(3), maxval(abs(force - force_by_hand))/maxval(abs(force_by_hand)))
            end do
            call check_below(error, worst(1), bound, 'accelerations')
            call check_below(error, worst(2), bound, 'forces at the wheels')
            call check_below(error, worst(3), bound, 'generalised forces')
        end do

    contains

        !> A state of both on their constraints, the chassis pitched and yawed at random.
        subroutine choose_state(t, q, qd, q10, qd10)
            real(wp), intent(in) :: t
            real(wp), intent(out) :: q(8), qd(8), q10(10), qd10(10)
            type(terms_type) :: terms
            real(wp) :: x(8), a(3, 3), yaw, pitch, angle, axle(3), es(3), y1(3), top(3), sigma, g, contact(3), b(2), c(2, 2)
            integer :: stat

            x = random_vector(seed, 8)
            yaw = 3*x(1)
            pitch = 0.3_wp*x(2)
            q(4:7) = [cos(yaw/2)*cos(pitch/2), cos(yaw/2)*sin(pitch/2), sin(yaw/2)*sin(pitch/2), sin(yaw/2)*cos(pitch/2)]
            q(1:2) = x(3:4)
            q(3) = hand%wheel_radius + hand%rear_length*sin(pitch)
            a = rotation(q(4:7))
            ! The length of the fork with which its wheel touches the ground; the contact of the wheel.
            angle = -hand%amplitude*sin(t)
            es = [0.0_wp, -sin(hand%fork_angle), cos(hand%fork_angle)]
            y1 = [-sin(angle), cos(hand%fork_angle)*cos(angle), sin(hand%fork_angle)*cos(angle)]
            axle = [cos(angle), cos(hand%fork_angle)*sin(angle), sin(hand%fork_angle)*sin(angle)]
            sigma = dot_product(a(3, :), axle)
            g = sqrt(1 - sigma**2)
            top = [0.0_wp, hand%fork_forward, hand%fork_height]
            q10(10) = (q(3) + dot_product(a(3, :), top) - hand%wheel_radius*g)/dot_product(a(3, :), es)
            contact = -hand%wheel_radius/g*(a(3, :) - sigma*axle)
            q10(1:9) = [q(1:7), dot_product(contact, y1), dot_product(contact, es)]
            q(8) = q10(10) - 1.0_wp
            qd = 2*random_vector(seed, 8)
            call of_mechanism%project(t, q, qd)
            ! The contact moves so that its rows 4 and 6, which are linear in this motion, are satisfied.
            qd10 = [qd(1:7), 0.0_wp, 0.0_wp, qd(8)]
            call get_terms(hand, t, q10, qd10, terms, stat)
            b = terms%nu([4, 6]) - matmul(terms%jacobian([4, 6], :), qd10)
            c = terms%jacobian([4, 6], 8:9)
            qd10(8:9) = [c(2, 2)*b(1) - c(1, 2)*b(2), c(1, 1)*b(2) - c(2, 1)*b(1)]/(c(1, 1)*c(2, 2) - c(1, 2)*c(2, 1))
        end subroutine choose_state
    end subroutine test_motorcycles

    !> The motorcycle with its wheel a metre down the fork.
    subroutine draw_motorcycle(mechanism, hand, error)
        type(mechanism_type), intent(out) :: mechanism
        type(motorcycle_type), intent(in) :: hand
        type(error_type), allocatable, intent(inout) :: error
        real(wp), parameter :: x(3) = [1.0_wp, 0.0_wp, 0.0_wp], z(3) = [0.0_wp, 0.0_wp, 1.0_wp]
        type(failure_type), allocatable :: failure
        real(wp) :: down(3), rear(3)

        mechanism%gravity = -hand%gravity*z
        down = [0.0_wp, sin(hand%fork_angle), -cos(hand%fork_angle)]
        rear = [0.0_wp, -hand%rear_length, 0.0_wp]
        call mechanism%add_body('chassis', hand%mass, hand%wheel_radius*z, failure, inertia=hand%inertia)
        call check_no_failure(error, failure)
        call mechanism%add_point('chassis', 'rear', rear, failure)
        call check_no_failure(error, failure)
        call mechanism%add_point('chassis', 'front', [0.0_wp, hand%fork_forward, hand%fork_height] + down, failure)
        call check_no_failure(error, failure)
        call mechanism%add_joint('left', 'point_on_plane', 'ground', 'chassis', failure, at=hand%wheel_radius*z + rear - &
            hand%half_track*x, axis=z)
        call check_no_failure(error, failure)
        call mechanism%add_joint('right', 'point_on_plane', 'ground', 'chassis', failure, at=hand%wheel_radius*z + rear + &
            hand%half_track*x, axis=z)
        call check_no_failure(error, failure)
        call mechanism%add_knife_edge('back', 'chassis.rear', x, failure)
        call check_no_failure(error, failure)
        call mechanism%add_massless_wheel('front', 'chassis.front', hand%wheel_radius, x, failure, along=down, &
            steer=sine_type(amplitude=hand%amplitude, rate=1.0_wp), plane=plane_type(open=.true.))
        call check_no_failure(error, failure)
        call mechanism%add_torsion('suspension', 'front', failure, stiffness=hand%stiffness, damping=hand%damping, &
            angle=hand%spring_length() - 1.0_wp)
        call check_no_failure(error, failure)
        call mechanism%define(failure)
        call check_no_failure(error, failure)
    end subroutine draw_motorcycle

    !> A body on three wheels runs down a rising slope, with a strut, a round rim and steering, compared with a fork and a rim that
    !> are bodies without mass. Includes the force of the wheel and the displacement of the strut.
    subroutine test_bodies(error)
        type(error_type), allocatable, intent(out) :: error
        !> Difference of runs with a tolerance of 1e-10 per step.
        real(wp), parameter :: bound = 1.0e-8_wp
        type(mechanism_type), target :: light, heavy
        type(simulation_type) :: of_light, of_heavy

        call draw_cart(light, .true., error)
        call draw_cart(heavy, .false., error)
        if (allocated(error)) return
        call go(light, 1.0e-10_wp, 1.5_wp, of_light, error)
        call go(heavy, 1.0e-10_wp, 1.5_wp, of_heavy, error)
        if (allocated(error)) return
        call check_count(error, heavy%n - light%n, 13, 'coordinates saved')
        call check_close(error, of_light%state%q(1:7), of_heavy%state%q(1:7), bound, 'place')
        call check_close(error, of_light%state%qd(1:7), of_heavy%state%qd(1:7), bound, 'velocity')
        ! It has moved, turned, and compressed its strut.
        call check_true(error, norm2(of_light%state%q(1:2)) > 0.5_wp .and. abs(of_light%state%q(7)) > 0.01_wp .and. &
            abs(of_light%state%q(8)) > 0.01_wp, 'the cart hardly moves')
    end subroutine test_bodies

    !> The cart, with its front wheel without mass or as two bodies.
    subroutine draw_cart(mechanism, is_light, error)
        type(mechanism_type), intent(inout) :: mechanism
        logical, intent(in) :: is_light
        type(error_type), allocatable, intent(inout) :: error
        real(wp), parameter :: x(3) = [1.0_wp, 0.0_wp, 0.0_wp], z(3) = [0.0_wp, 0.0_wp, 1.0_wp], nothing(3) = 0.0_wp
        real(wp), parameter :: radius = 0.3_wp, crown = 0.08_wp, hub(3) = [0.0_wp, 0.8_wp, radius]
        !> Both begin at 0 with the rate 0.
        type(sine_type), parameter :: steer = sine_type(offset=0.3_wp, amplitude=-0.3_wp, rate=3.0_wp, phase=pi/2), &
            rise = sine_type(offset=0.05_wp, amplitude=-0.05_wp, rate=5.0_wp, phase=pi/2)
        type(failure_type), allocatable :: failure
        real(wp) :: down(3)

        down = [0.0_wp, 0.3_wp, -1.0_wp]/sqrt(1.09_wp)
        mechanism%gravity = [1.0_wp, 3.0_wp, -9.0_wp]
        call mechanism%add_body('cart', 3.0_wp, [0.0_wp, 0.0_wp, 0.5_wp], failure, inertia=[0.4_wp, 0.3_wp, 0.5_wp])
        call check_no_failure(error, failure)
        call mechanism%add_point('cart', 'left', [-0.4_wp, -0.4_wp, -0.5_wp], failure)
        call check_no_failure(error, failure)
        call mechanism%add_point('cart', 'right', [0.4_wp, -0.4_wp, -0.5_wp], failure)
        call check_no_failure(error, failure)
        call mechanism%add_point('cart', 'hub', hub - [0.0_wp, 0.0_wp, 0.5_wp], failure)
        call check_no_failure(error, failure)
        call mechanism%add_point('cart', 'head', hub - [0.0_wp, 0.0_wp, 0.5_wp] - down, failure)
        call check_no_failure(error, failure)
        call mechanism%add_joint('one', 'point_on_plane', 'ground', 'cart.left', failure, axis=z)
        call check_no_failure(error, failure)
        call mechanism%add_joint('two', 'point_on_plane', 'ground', 'cart.right', failure, axis=z)
        call check_no_failure(error, failure)
        call mechanism%add_knife_edge('back', 'cart.left', x, failure)
        call check_no_failure(error, failure)
        if (is_light) then
            call mechanism%add_massless_wheel('front', 'cart.hub', radius, x, failure, along=down, steer=steer, crown=crown, &
                plane=plane_type(rise=rise))
            call check_no_failure(error, failure)
            call mechanism%add_torsion('spring', 'front', failure, stiffness=150.0_wp, damping=20.0_wp, angle=0.02_wp)
        else
            call mechanism%add_body('fork', 0.0_wp, hub, failure, inertia=nothing)
            call check_no_failure(error, failure)
            call mechanism%add_body('rim', 0.0_wp, hub, failure, inertia=nothing)
            call check_no_failure(error, failure)
            call mechanism%add_joint('slide', 'primitive', 'cart.hub', 'fork', failure, axis=down, hold=[1, 1, 0, 1, 1, 1], &
                drive=6, motion=steer)
            call check_no_failure(error, failure)
            call mechanism%add_joint('axle', 'revolute', 'fork', 'rim', failure, at=hub, axis=x)
            call check_no_failure(error, failure)
            call mechanism%add_rolling_disk('front', 'rim', radius, x, failure, crown=crown, plane=plane_type(rise=rise))
            call check_no_failure(error, failure)
            call mechanism%add_spring('spring', 'cart.head', 'fork', failure, stiffness=150.0_wp, damping=20.0_wp, length=1.02_wp)
        end if
        call check_no_failure(error, failure)
    end subroutine draw_cart

    !> Every error states the element and the remedy.
    subroutine test_words(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type) :: mechanism
        type(failure_type), allocatable :: failure

        call draw(mechanism, .true.)
        call mechanism%add_massless_wheel('it', 'first', 0.3_wp, axle(:2), failure)
        call expect('massless wheel it is in the plane')
        call draw(mechanism, .false.)
        call mechanism%add_massless_wheel('it', 'first', -0.3_wp, axle, failure)
        call expect('a radius that is not positive')
        call mechanism%add_massless_wheel('it', 'first', 0.3_wp, axle, failure, crown=0.3_wp)
        call expect('a crown that is not between')
        call mechanism%add_massless_wheel('it', 'third', 0.3_wp, axle, failure)
        call expect('there is no body third')
        call mechanism%add_massless_wheel('it', 'ground', 0.3_wp, axle, failure)
        call expect('on the ground')
        call mechanism%add_massless_wheel('it', 'first', 0.3_wp, [0.0_wp, 0.0_wp, 0.0_wp], failure)
        call expect('axis is zero')
        call mechanism%add_massless_wheel('it', 'first', 0.3_wp, [0.0_wp, 0.0_wp, 1.0_wp], failure)
        call expect('lies flat on its plane')
        call mechanism%add_massless_wheel('it', 'first', 0.3_wp, axle, failure, along=[1.0_wp, 0.0_wp, 0.0_wp])
        call expect('slides along its plane')
        call mechanism%add_massless_wheel('it', 'first', 0.3_wp, axle, failure, steer=ramp(0.0_wp, 1.0_wp))
        call expect('has only one of steer and its axis')
        call mechanism%add_massless_wheel('it', 'first', 0.3_wp, axle, failure, about=strut)
        call expect('has only one of steer and its axis')
        call mechanism%add_massless_wheel('it', 'first', 0.3_wp, axle, failure)
        call expect('above its plane in the reference configuration')
        call mechanism%add_massless_wheel('it', 'first', 0.3_wp, axle, failure, plane=plane_type(open=.true.))
        call check_no_failure(error, failure)
        call mechanism%add_torsion('spring', 'it', failure, stiffness=1.0_wp)
        call expect('the wheel it has no coordinate')
        call mechanism%add_joint_sensor('way', 'it', failure)
        call expect('the wheel it does not slide')
        call mechanism%add_massless_wheel('other', 'second', 0.3_wp, axle, failure, along=strut, plane=plane_type(open=.true.))
        call check_no_failure(error, failure)
        call mechanism%add_torsion('spring', 'other.angle', failure, stiffness=1.0_wp)
        call expect('the wheel other has no coordinate')
        call mechanism%add_friction('rub', 'other', failure, friction_law_type(dynamic=0.3_wp, speed=0.01_wp))
        call expect('has no normal component')

    contains

        subroutine expect(text)
            character(len=*), intent(in) :: text

            call check_true(error, allocated(failure), 'no error: '//text)
            if (.not. allocated(failure)) return
            call check_true(error, index(failure%message, text) > 0, failure%message//' instead of '//text)
        end subroutine expect
    end subroutine test_words
end module test_massless_wheel
