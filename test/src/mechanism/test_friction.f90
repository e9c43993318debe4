! SPDX-License-Identifier: MIT
!> Tests of friction on the reactions of joints: the equations of motion at random states, derivatives, and the Newton matrix.
module test_friction
    use asserts, only: check_below, check_count, check_no_failure, check_true
    use differences, only: random_vector
    use mechanism_checks, only: verify
    use stage_corrections, only: correct_stage
    use tandem, only: failure_type => error_type, friction_law_type, mechanism_type, options_type, terms_type, wp
    use tandem_chart, only: chart_type, step_end
    use tandem_chart_dense, only: dense_chart_type
    use tandem_chart_factory, only: new_chart
    use tandem_status, only: status_not_evaluable
    use terms_at, only: get_terms
    use testdrive, only: error_type, new_unittest, test_failed, unittest_type
    implicit none (type, external)
    private

    public :: collect_friction

contains

    !> The suite.
    subroutine collect_friction(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('equations-of-motion', test_equations), &
            new_unittest('derivatives', test_derivatives), &
            new_unittest('newton-contracts-quadratically', test_contraction), &
            new_unittest('a-jam-is-refused', test_jam), &
            new_unittest('words-name-what-is-wrong', test_words)]
    end subroutine collect_friction

    !> Two bodies and a slider in a row, each joint with friction on its reaction.
    subroutine draw(mechanism, planar, error, dynamic)
        type(mechanism_type), intent(out) :: mechanism
        logical, intent(in) :: planar
        type(error_type), allocatable, intent(inout) :: error
        !> Coefficient of sliding friction, 0.3 by default.
        real(wp), intent(in), optional :: dynamic
        type(failure_type), allocatable :: failure
        real(wp), parameter :: slide(3) = [1.0_wp, 0.2_wp, 0.1_wp], axis(3) = [0.1_wp, 0.3_wp, 1.0_wp], &
            place(3) = [1.2_wp, 0.7_wp, 0.2_wp]
        real(wp) :: mu
        integer :: n

        mu = 0.3_wp
        if (present(dynamic)) mu = dynamic
        mechanism%planar = planar
        mechanism%gravity = [0.5_wp, -9.81_wp, merge(0.0_wp, 1.0_wp, planar)]
        n = merge(2, 3, planar)
        if (planar) then
            call mechanism%add_body('one', 1.5_wp, [0.4_wp, 0.1_wp], failure, inertia=[0.2_wp])
            call mechanism%add_body('two', 0.8_wp, [1.1_wp, 0.5_wp], failure, inertia=[0.1_wp])
            call mechanism%add_body('three', 0.6_wp, [1.4_wp, 0.9_wp], failure, inertia=[0.05_wp])
            call mechanism%add_joint('a', 'revolute', 'ground', 'one', failure, at=[0.0_wp, 0.0_wp])
            call mechanism%add_joint('b', 'revolute', 'one', 'two', failure, at=[0.8_wp, 0.3_wp])
        else
            call mechanism%add_body('one', 1.5_wp, [0.4_wp, 0.1_wp, 0.2_wp], failure, inertia=[0.2_wp, 0.3_wp, 0.25_wp])
            call mechanism%add_body('two', 0.8_wp, [1.1_wp, 0.5_wp, 0.1_wp], failure, inertia=[0.1_wp, 0.12_wp, 0.09_wp])
            call mechanism%add_body('three', 0.6_wp, [1.4_wp, 0.9_wp, 0.3_wp], failure, inertia=[0.05_wp, 0.04_wp, 0.06_wp])
            call mechanism%add_joint('a', 'revolute', 'ground', 'one', failure, at=[0.0_wp, 0.0_wp, 0.0_wp], axis=axis)
            call mechanism%add_joint('b', 'revolute', 'one', 'two', failure, at=[0.8_wp, 0.3_wp, 0.1_wp], &
                axis=[0.0_wp, 1.0_wp, 0.4_wp])
        end if
        call check_no_failure(error, failure)
        call mechanism%add_joint('c', 'prismatic', 'two', 'three', failure, at=place(:n), axis=slide(:n))
        call check_no_failure(error, failure)
        call mechanism%add_friction('rub_a', 'a', failure, friction_law_type(dynamic=mu, speed=1.3_wp, static=2*mu), &
            radius=0.1_wp)
        call check_no_failure(error, failure)
        call mechanism%add_friction('rub_b', 'b', failure, friction_law_type(dynamic=mu, speed=0.7_wp, viscous=0.2_wp), &
            radius=0.15_wp, arm=0.5_wp)
        call check_no_failure(error, failure)
        call mechanism%add_friction('rub_c', 'c', failure, friction_law_type(dynamic=mu, speed=0.9_wp, static=1.5_wp*mu), &
            arm=0.8_wp)
        call check_no_failure(error, failure)
    end subroutine draw

    !> M qdd + C' lambda = S + B p(lambda) and C qdd = -gamma at states on the manifold, by explicit and by implicit charts, dense
    !> and sparse.
    subroutine test_equations(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: mechanism
        class(chart_type), allocatable :: chart
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        type(terms_type) :: terms
        real(wp), allocatable, dimension(:) :: q0, qd0, q, qd, qdd, dq, dqd, lambda, normals, left
        real(wp), allocatable :: directions(:, :), gradient(:, :)
        real(wp) :: worst, scale
        integer :: k, i, seed, stat(6)

        seed = 301
        do k = 1, 8
            call draw(mechanism, mod(k, 2) == 1, error)
            call mechanism%define(failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call check_count(error, mechanism%n_frictions, 3, 'frictions')
            associate (n => mechanism%n, m => mechanism%n_constraints())
                allocate (q0(n), qd0(n), q(n), qd(n), qdd(n), dq(n), dqd(n), lambda(m), normals(3), directions(n, 3), &
                    gradient(3, m), left(n))
            end associate
            call mechanism%start(q0, qd0)
            call new_chart(k > 4, chart)
            call chart%attach(mechanism, options, mod(k - 1, 4) > 1, .false., failure)
            call check_no_failure(error, failure)
            worst = 0.0_wp
            do i = 1, 200
                call chart%set_origin(0.0_wp, q0, qd0, .false., dq, stat(1))
                call random_vector(seed, dq)
                call random_vector(seed, dqd)
                dq = 0.05_wp*dq
                dqd = 2*dqd
                call chart%restore(0.0_wp, dq, dqd, step_end, q, qd, stat(2))
                call chart%accelerate(0.0_wp, q, qd, step_end, qdd, stat(3))
                call chart%find_multipliers(0.0_wp, q, qd, qdd, lambda, stat(4))
                call get_terms(mechanism, 0.0_wp, q, qd, terms, stat(5))
                call mechanism%friction_directions(0.0_wp, q, qd, directions, stat(6))
                call mechanism%normal_forces(lambda, normals, gradient)
                if (any(stat /= 0)) then
                    call test_failed(error, 'a state cannot be evaluated')
                    return
                end if
                scale = maxval(abs(terms%force)) + maxval(abs(lambda))
                left = matmul(terms%mass, qdd) + matmul(lambda, terms%jacobian) - terms%force - matmul(directions, normals)
                worst = max(worst, maxval(abs(left))/scale, maxval(abs(matmul(terms%jacobian, qdd) + terms%gamma))/scale)
                ! It is not a small part of the total.
                if (i == 1) call check_below(error, 1.0e-3_wp*scale, maxval(abs(matmul(directions, normals))), 'a thousandth')
            end do
            ! Rounding of C with rows of about 1 and a condition of about 100.
            call check_below(error, worst, 1.0e-11_wp, 'what is left of the equations of motion')
            deallocate (q0, qd0, q, qd, qdd, dq, dqd, lambda, normals, directions, gradient, left, chart)
            if (allocated(error)) return
        end do
    end subroutine test_equations

    !> The gradient blocks against differences, and the gradients of the normal forces against theirs.
    subroutine test_derivatives(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: mechanism
        real(wp), parameter :: h = 1.0e-5_wp
        real(wp), allocatable :: lambda(:), gradient(:, :), ignored(:, :)
        real(wp) :: normals(3, 2), now(3)
        integer :: j, k, seed

        seed = 302
        do k = 1, 2
            call draw(mechanism, k == 1, error)
            call verify(mechanism, 'friction on reactions', error)
            if (allocated(error)) return
            associate (m => mechanism%n_constraints())
                allocate (lambda(m), gradient(3, m), ignored(3, m))
            end associate
            call random_vector(seed, lambda)
            call mechanism%normal_forces(lambda, now, gradient)
            do j = 1, size(lambda)
                lambda(j) = lambda(j) + h
                call mechanism%normal_forces(lambda, normals(:, 1), ignored)
                lambda(j) = lambda(j) - 2*h
                call mechanism%normal_forces(lambda, normals(:, 2), ignored)
                lambda(j) = lambda(j) + h
                ! Truncation h^2 and rounding eps/h.
                call check_below(error, maxval(abs(gradient(:, j) - (normals(:, 1) - normals(:, 2))/(2*h))), 1.0e-8_wp, &
                    'the gradient of a normal force')
            end do
            lambda = 0.0_wp
            call mechanism%normal_forces(lambda, now, gradient)
            call check_true(error, all(abs(now) <= 0.0_wp) .and. all(abs(gradient) <= 0.0_wp), 'where nothing presses')
            deallocate (lambda, gradient, ignored)
        end do
    end subroutine test_derivatives

    !> Corrections of a stage with the Newton matrix of the stage itself: without the derivatives of normal forces they would
    !> contract by a factor of a tenth here.
    subroutine test_contraction(error)
        type(error_type), allocatable, intent(out) :: error
        !> Step size times coefficient.
        real(wp), parameter :: ha = 0.01_wp
        type(mechanism_type), target :: mechanism
        type(dense_chart_type), allocatable :: chart
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), allocatable, dimension(:) :: q0, qd0, q, qd, qdd, rate_q, rate_qd, noise, dq
        real(wp) :: change(5)
        integer :: k, seed, stat

        call draw(mechanism, .true., error, 0.5_wp)
        call mechanism%define(failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        allocate (q0(mechanism%n), qd0(mechanism%n), q(mechanism%n), qd(mechanism%n), qdd(mechanism%n), noise(mechanism%n))
        call mechanism%start(q0, qd0)
        allocate (chart)
        call chart%attach(mechanism, options, .true., .true., failure)
        dq = 0*q0
        call chart%set_origin(0.0_wp, q0, qd0, .false., dq, stat)
        seed = 303
        call random_vector(seed, noise)
        call chart%restore(0.0_wp, 0*q0, 0.5_wp*noise, step_end, q, qd, stat)
        call chart%set_origin(0.0_wp, q0, qd, .false., dq, stat)
        call chart%restore(0.0_wp, 0*q0, 0*q0, step_end, q, qd, stat)
        call chart%accelerate(0.0_wp, q, qd, step_end, qdd, stat)
        rate_q = qd
        rate_qd = qdd
        call chart%factor(0.0_wp, q, qd, qdd, ha, [complex(wp) ::], stat)
        do k = 1, 2
            ! To a matrix at the solution itself.
            call solve(4)
            call chart%accelerate(ha, q, qd, step_end, qdd, stat)
            call chart%factor(ha, q, qd, qdd, ha, [complex(wp) ::], stat)
        end do
        call random_vector(seed, noise)
        rate_qd = rate_qd + 1.0e-4_wp*noise
        call solve(3)
        if (stat /= 0) call test_failed(error, 'the stage cannot be solved')
        ! Measured: 1e-6, 1e-12, 1e-17.
        call check_below(error, change(2), 1.0e-4_wp*change(1), 'the second correction')

    contains

        subroutine solve(corrections)
            integer, intent(in) :: corrections
            integer :: i

            do i = 1, corrections
                call correct_stage(chart, i == 1, ha, ha, q, qd, rate_q, rate_qd, change(i), stat)
            end do
            call chart%restore(ha, ha*rate_q, ha*rate_qd, step_end, q, qd, stat)
        end subroutine solve
    end subroutine test_contraction

    !> A block on a rail, its centre of mass h above: K = mu h/arm.
    subroutine test_jam(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: mechanism
        class(chart_type), allocatable :: chart
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: q(3), qd(3), qdd(3), zero(3)
        integer :: k, stat

        do k = 1, 4
            mechanism = mechanism_type()
            mechanism%planar = .true.
            mechanism%gravity = [0.0_wp, -9.81_wp, 0.0_wp]
            call mechanism%add_body('block', 1.0_wp, [0.0_wp, 0.2_wp], failure, inertia=[0.1_wp], velocity=[3.0_wp, 0.0_wp])
            call mechanism%add_joint('rail', 'prismatic', 'ground', 'block', failure, at=[0.0_wp, 0.0_wp], axis=[1.0_wp, 0.0_wp])
            call mechanism%add_friction('rub', 'rail', failure, &
                friction_law_type(dynamic=merge(0.49_wp, 0.51_wp, mod(k, 2) == 1), speed=1.0e-3_wp), arm=0.1_wp)
            call check_no_failure(error, failure)
            call mechanism%define(failure)
            call mechanism%start(q, qd)
            call new_chart(k > 2, chart)
            call chart%attach(mechanism, options, .false., .false., failure)
            zero = 0.0_wp
            call chart%set_origin(0.0_wp, q, qd, .false., zero, stat)
            call chart%restore(0.0_wp, zero, zero, step_end, q, qd, stat)
            call chart%accelerate(0.0_wp, q, qd, step_end, qdd, stat)
            call check_count(error, stat, merge(0, status_not_evaluable, mod(k, 2) == 1), 'status')
            deallocate (chart)
        end do
    end subroutine test_jam

    subroutine test_words(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type) :: mechanism
        type(failure_type), allocatable :: failure
        real(wp), parameter :: mu = 0.3_wp

        call draw(mechanism, .false., error)
        call mechanism%add_friction('rub', 'd', failure, friction_law_type(dynamic=mu, speed=1.0_wp))
        call expect('friction rub: there is no joint d')
        call mechanism%add_friction('rub', 'a', failure, friction_law_type(dynamic=mu, speed=1.0_wp))
        call expect('rotates and has no radius')
        call mechanism%add_friction('rub', 'c', failure, friction_law_type(dynamic=mu, speed=1.0_wp), radius=1.0_wp)
        call expect('slides and has a radius')
        call mechanism%add_friction('rub', 'a', failure, friction_law_type(dynamic=mu, speed=1.0_wp), normal=1.0_wp, &
            radius=1.0_wp)
        call expect('has both a normal force')
        call mechanism%add_friction('rub', 'a', failure, friction_law_type(dynamic=mu, speed=0.0_wp), radius=1.0_wp)
        call expect('invalid coefficients or an invalid speed')
        call mechanism%add_friction('rub', 'a', failure, friction_law_type(dynamic=mu, speed=1.0_wp, static=0.2_wp), &
            radius=1.0_wp)
        call expect('invalid coefficients or an invalid speed')
        call mechanism%add_friction('rub', 'a', failure, friction_law_type(dynamic=mu, speed=1.0_wp), radius=-1.0_wp)
        call expect('invalid normal force or radius')
        call mechanism%add_friction('rub', 'c', failure, friction_law_type(dynamic=mu, speed=1.0_wp), arm=0.0_wp)
        call expect('an arm that is not positive')

    contains

        subroutine expect(text)
            character(len=*), intent(in) :: text

            call check_true(error, allocated(failure), 'no error: '//text)
            if (.not. allocated(failure)) return
            call check_true(error, index(failure%message, text) > 0, failure%message//' instead of '//text)
        end subroutine expect
    end subroutine test_words
end module test_friction
