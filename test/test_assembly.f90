! SPDX-License-Identifier: MIT
!> Tests of sure starts: the nearest consistent state against closed forms and against equations that are solved here, what moved
!> and which row is to blame, and that hopeless starts end soon.
module test_assembly
    use asserts, only: check_below, check_between, check_close, check_count, check_failure, check_no_failure, check_text, check_true
    use kkt, only: kkt_type
    use model_curve, only: curve_type, undefined_nan, undefined_stat
    use model_knife_edge, only: knife_edge_type
    use model_linkage, only: linkage_type
    use model_moving_pivot, only: moving_pivot_type
    use model_particle, only: particle_type
    use model_pendulum, only: pendulum_type
    use model_sleigh, only: sleigh_type
    use model_spy, only: fault_nan, fault_retry, fault_stop, spy_type
    use subjects, only: new_subject, subject_names
    use tandem, only: assemble, assembly_type, failure_type => error_type, model_type, motorcycle_type, need_jacobian, need_mass, &
        need_nu, need_phi, options_type, rolling_disk_type, simulation_type, statistics_type, terms_type, to_text, wp
    use tandem_model_evaluator, only: evaluator_type
    use tandem_simulate_nearest_position, only: nearest_position_type
    use tandem_simulate_nearest_velocity, only: nearest_velocity_type
    use tandem_tangent_counts, only: counts_type
    use terms_at, only: get_terms
    use testdrive, only: error_type, new_unittest, unittest_type
    use watch, only: natural_errors
    use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
    implicit none (type, external)
    private

    public :: collect_assembly

    !> The paper's printed start of the motorcycle and of the chopper (section 9): the pitch is left out.
    real(wp), parameter :: printed(10, 2) = reshape([ &
        0.0_wp, 0.0_wp, 0.304_wp, 1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, -0.062_wp, -0.294_wp, 0.621_wp, &
        0.0_wp, 0.0_wp, 0.314_wp, 1.0_wp, 0.0_wp, 0.0_wp, 0.0_wp, -0.217_wp, -0.207_wp, 0.91_wp], [10, 2])

contains

    !> The suite.
    subroutine collect_assembly(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('nearest-point-of-a-circle', test_circle), &
            new_unittest('nearest-point-of-an-ellipse-by-weights', test_ellipse), &
            new_unittest('starts-that-favour-no-direction', test_symmetric), &
            new_unittest('nearest-closure-of-a-linkage', test_linkage), &
            new_unittest('fixed-coordinates-stay', test_fixed), &
            new_unittest('what-is-consistent-stays-bitwise', test_consistent), &
            new_unittest('copies-of-a-row-change-nothing', test_copies), &
            new_unittest('fixed-coordinates-that-leave-no-solution', test_fixed_impossible), &
            new_unittest('a-linkage-too-short-ends-soon-and-is-named', test_hopeless), &
            new_unittest('moved-too-far-names-coordinate-and-row', test_too_far), &
            new_unittest('nearest-velocity-in-the-mass-metric', test_mass_metric), &
            new_unittest('nearest-velocity-by-weights-and-with-some-fixed', test_weights), &
            new_unittest('singular-masses', test_singular_mass), &
            new_unittest('nonholonomic-rows', test_nonholonomic), &
            new_unittest('rheonomic-rows-and-segments', test_rheonomic), &
            new_unittest('velocities-that-cannot-be', test_impossible_velocity), &
            new_unittest('nothing-to-satisfy', test_unconstrained), &
            new_unittest('shares-of-the-rows-add-up', test_shares), &
            new_unittest('a-coordinate-that-moves-for-no-row', test_scaled), &
            new_unittest('failing-procedures', test_failing), &
            new_unittest('regions-where-phi-is-undefined-are-avoided', test_undefined), &
            new_unittest('requests-that-cannot-be', test_requests), &
            new_unittest('a-simulation-that-assembles-its-start', test_simulation), &
            new_unittest('the-printed-motorcycle-assembles-near-its-equilibrium', test_printed)]
    end subroutine collect_assembly

    !> A request without limits on the moves.
    function anywhere() result(request)
        type(assembly_type) :: request

        request%largest_move_q = 0.0_wp
    end function anywhere

    !> Along the radius, from far outside and far inside. The rest is rounding: of q0 where that is large.
    subroutine test_circle(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(assembly_type) :: request
        type(failure_type), allocatable :: failure
        real(wp), parameter :: direction(2) = [0.6_wp, -0.8_wp], radii(6) = [1.0e-3_wp, 0.2_wp, 0.79_wp, 0.81_wp, 5.0_wp, 1.0e6_wp]
        real(wp) :: q(2), qd(2)
        integer :: i

        call model%define()
        request = anywhere()
        do i = 1, size(radii)
            q = radii(i)*direction
            qd = 0.0_wp
            call assemble(model, request, 0.0_wp, q, qd, failure)
            call check_no_failure(error, failure)
            ! Near the centre the direction is that of a short vector.
            call check_close(error, q, model%length*direction, 1.0e-13_wp, 'q from radius '//to_text(radii(i)))
            call check_close(error, request%moved_q, q - radii(i)*direction, 2.0e-16_wp*max(1.0_wp, radii(i)), 'moved_q')
            call check_true(error, request%is_nearest, 'it is known to be nearest')
            ! From far away each iteration halves the radius.
            call check_between(error, real(request%iterations, wp), 1.0_wp, 40.0_wp, 'iterations')
            call check_true(error, request%row_q == 1 .and. request%row_qd == 0, 'the rod moved q, nothing moved qd')
        end do
    end subroutine test_circle

    !> At the nearest point W (q - q0) is parallel to Phi_q', and no point of a fine scan of the ellipse is nearer.
    subroutine test_ellipse(error)
        type(error_type), allocatable, intent(out) :: error
        type(curve_type), target :: model
        type(assembly_type) :: request
        type(failure_type), allocatable :: failure
        real(wp), parameter :: starts(2, 5) = reshape([3.0_wp, 4.0_wp, 1.0_wp, 0.2_wp, -1.5_wp, 1.5_wp, 2.5_wp, -0.1_wp, &
            0.3_wp, 0.7_wp], [2, 5]), pi = acos(-1.0_wp)
        integer, parameter :: fine = 20000
        real(wp) :: q(2), qd(2), weights(2), normal(2), pull(2), least
        integer :: i, j, k

        call model%define()
        do k = 1, 3
            request = anywhere()
            weights = 1.0_wp
            if (k == 2) weights = [1.0_wp, 100.0_wp]
            if (k == 3) weights = [3.0_wp, 0.2_wp]
            if (k > 1) request%weight_q = weights
            do i = 1, size(starts, 2)
                q = starts(:, i)
                qd = 0.0_wp
                call assemble(model, request, 0.0_wp, q, qd, failure)
                call check_no_failure(error, failure)
                call check_below(error, abs(sum((q/model%axes)**2) - 1), 1.0e-14_wp, 'error of the ellipse')
                normal = q/model%axes**2
                pull = weights*(q - starts(:, i))
                call check_below(error, abs(pull(1)*normal(2) - pull(2)*normal(1))/(norm2(pull)*norm2(normal)), 1.0e-13_wp, &
                    'the angle between the weighted move and the normal')
                least = huge(1.0_wp)
                do j = 1, fine
                    pull = model%axes*[cos(2*pi*j/fine), sin(2*pi*j/fine)] - starts(:, i)
                    least = min(least, sum(weights*pull**2))
                end do
                call check_below(error, sum(weights*(q - starts(:, i))**2), least, 'the weighted squared distance')
                call check_true(error, request%is_nearest, 'it is known to be nearest')
            end do
        end do
    end subroutine test_ellipse

    !> The centre of a circle, where Phi_q = 0, and points on the long axis, whose stationary points at its end are not nearest: the
    !> nearest ones are at x = a^2 x0 / (a^2 - b^2).
    subroutine test_symmetric(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: pendulum
        type(curve_type), target :: curve
        type(assembly_type) :: request
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)

        call pendulum%define()
        request = anywhere()
        q = 0.0_wp
        qd = 0.0_wp
        call assemble(pendulum, request, 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
        call check_below(error, abs(norm2(q) - pendulum%length), 1.0e-15_wp, 'distance to the circle')
        call curve%define()
        q = [0.1_wp, 0.0_wp]
        call assemble(curve, request, 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
        call check_close(error, [q(1), abs(q(2))], [2.0_wp/15, sqrt(1 - (1.0_wp/15)**2)], 1.0e-14_wp, 'q')
        q = 0.0_wp
        call assemble(curve, request, 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
        call check_close(error, [q(1), abs(q(2))], [0.0_wp, 1.0_wp], 1.0e-14_wp, 'q from the centre')
    end subroutine test_symmetric

    !> W (q - q0) + Phi_q' lambda = 0 for some lambda: one equation, the part along the null vector of Phi_q.
    subroutine test_linkage(error)
        type(error_type), allocatable, intent(out) :: error
        type(linkage_type), target :: model
        type(assembly_type) :: request
        type(failure_type), allocatable :: failure
        real(wp) :: q(3), qd(3), q0(3), tangent(3)

        call model%define()
        q0 = [0.8_wp, -0.4_wp, 0.2_wp]
        q = q0
        qd = 0.0_wp
        request%weight_q = [2.0_wp, 1.0_wp, 5.0_wp]
        call assemble(model, request, 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
        call check_below(error, abs(sum(model%links*cos(q)) - model%distance), 2.0e-15_wp, 'closure x')
        call check_below(error, abs(sum(model%links*sin(q))), 2.0e-15_wp, 'closure y')
        ! The cross product of the rows (-l sin), (l cos).
        tangent = [sin(q(3) - q(2)), sin(q(1) - q(3)), sin(q(2) - q(1))]/model%links
        call check_below(error, abs(dot_product(tangent, request%weight_q*(q - q0))), 1.0e-14_wp, 'the part along the linkage')
        call check_below(error, maxval(abs(q - q0)), 1.0_wp, 'the move')
    end subroutine test_linkage

    !> The other coordinate goes to the nearer of the two places that are left.
    subroutine test_fixed(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(linkage_type), target :: linkage
        type(assembly_type) :: request
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2), angles(3), rates(3)

        call model%define()
        request%fixed_q = [.true., .false.]
        q = [0.5_wp, -0.1_wp]
        qd = 0.0_wp
        call assemble(model, request, 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
        call check_close(error, q(:1), [0.5_wp], 0.0_wp, 'the fixed coordinate')
        call check_close(error, q(2:), [-sqrt(0.64_wp - 0.25_wp)], 1.0e-15_wp, 'the free coordinate')
        ! As many free coordinates as rows.
        call linkage%define()
        request%fixed_q = [.false., .true., .false.]
        angles = [0.8_wp, -0.4_wp, 0.2_wp]
        rates = 0.0_wp
        call assemble(linkage, request, 0.0_wp, angles, rates, failure)
        call check_no_failure(error, failure)
        call check_close(error, angles(2:2), [-0.4_wp], 0.0_wp, 'the fixed angle')
        call check_below(error, abs(sum(linkage%links*cos(angles)) - linkage%distance), 2.0e-15_wp, 'closure x')
        call check_below(error, abs(sum(linkage%links*sin(angles))), 2.0e-15_wp, 'closure y')
    end subroutine test_fixed

    subroutine test_consistent(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: model
        type(assembly_type) :: request
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:), q0(:), qd0(:)
        integer :: i

        do i = 1, size(subject_names)
            call new_subject(subject_names(i), model, q0, qd0)
            q = q0
            qd = qd0
            call assemble(model, request, 0.0_wp, q, qd, failure)
            call check_no_failure(error, failure)
            call check_close(error, [q, qd], [q0, qd0], 0.0_wp, 'the state of '//subject_names(i))
            call check_count(error, request%iterations, 0, 'iterations')
            call check_below(error, maxval(abs([request%moved_q, request%moved_qd])), 0.0_wp, 'moves')
            call check_true(error, request%row_q == 0 .and. request%row_qd == 0, 'no row is to blame')
            call check_true(error, request%counts%terms(5) == 0, 'the mass matrix is not evaluated')
        end do
    end subroutine test_consistent

    !> Copies with another factor, so that the rank decision sees rows of different length.
    subroutine test_copies(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: single, double
        type(assembly_type) :: request
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2), expected(2), expected_rate(2)

        request = anywhere()
        call single%define()
        double%copies = 2
        double%copy_factor = -30.0_wp
        call double%define()
        expected = [3.0_wp, 1.0_wp]
        expected_rate = [1.0_wp, 2.0_wp]
        q = expected
        qd = expected_rate
        call assemble(single, request, 0.0_wp, expected, expected_rate, failure)
        call check_no_failure(error, failure)
        call assemble(double, request, 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
        call check_close(error, q, expected, 1.0e-15_wp, 'q')
        call check_close(error, qd, expected_rate, 1.0e-15_wp, 'qd')
    end subroutine test_copies

    subroutine test_fixed_impossible(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(curve_type), target :: curve
        type(assembly_type) :: request
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)

        call curve%define()
        request%fixed_q = [.true., .false.]
        q = [2.5_wp, 0.3_wp]
        qd = [1.0_wp, 2.0_wp]
        call assemble(curve, request, 0.0_wp, q, qd, failure)
        call check_failure(error, failure, 'inconsistent_start', 'constraint "ellipse" stays off by 0.28125')
        if (allocated(error)) return
        call check_text(error, failure%message, 'with fixed x;')
        call check_text(error, failure%message, 'free some of them')
        call check_close(error, [q, qd], [2.5_wp, 0.3_wp, 1.0_wp, 2.0_wp], 0.0_wp, 'the state')
        ! Nothing is free.
        call model%define()
        request%fixed_q = [.true., .true.]
        q = [0.5_wp, 0.5_wp]
        call assemble(model, request, 0.0_wp, q, qd, failure)
        call check_failure(error, failure, 'inconsistent_start', 'with fixed q1, q2;')
        if (allocated(error)) return
        call check_text(error, failure%message, 'constraint "rod" stays off by 0.7')
        ! All fixed, and right.
        q = [0.8_wp, 0.0_wp]
        call assemble(model, request, 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
    end subroutine test_fixed_impossible

    !> The links reach 3.3 and the point is 5 away: 1.7 remain whatever the angles are. No start takes more than the limit.
    subroutine test_hopeless(error)
        type(error_type), allocatable, intent(out) :: error
        type(linkage_type), target :: model
        type(assembly_type) :: request
        type(failure_type), allocatable :: failure
        real(wp), parameter :: starts(3, 5) = reshape([0.3_wp, -0.4_wp, 0.2_wp, 0.0_wp, 0.0_wp, 0.0_wp, 3.0_wp, 4.0_wp, -5.0_wp, &
            3.1_wp, 3.1_wp, 3.2_wp, 100.0_wp, 50.0_wp, -10.0_wp], [3, 5])
        real(wp) :: q(3), qd(3)
        integer :: i

        call model%define()
        model%distance = 5.0_wp
        request = anywhere()
        do i = 1, size(starts, 2)
            q = starts(:, i)
            qd = 1.0_wp
            model%calls = 0
            call assemble(model, request, 0.0_wp, q, qd, failure)
            call check_failure(error, failure, 'inconsistent_start', 'constraint "closure x" stays off by 1.7')
            call check_true(error, request%iterations <= 80, 'at most 80 iterations, not '//to_text(request%iterations))
            ! Phi and Phi_q once each at each point, and at the start.
            call check_true(error, model%calls <= 2*request%iterations + 2, 'two calls a point')
            call check_close(error, [q, qd], [starts(:, i), 1.0_wp, 1.0_wp, 1.0_wp], 0.0_wp, 'the state')
        end do
        request%iteration_limit = 7
        model%calls = 0
        q = starts(:, 3)
        call assemble(model, request, 0.0_wp, q, qd, failure)
        call check_failure(error, failure, 'inconsistent_start', 'after 7 iterations')
        call check_true(error, model%calls <= 16, 'the limit is kept')
        ! Just long enough: rank is lost at the solution, where a violation of 1e-12 leaves 1e-6 of the angles open.
        model%distance = 3.3_wp
        request = anywhere()
        q = starts(:, 1)
        qd = 0.0_wp
        call assemble(model, request, 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
        call check_below(error, maxval(abs(q)), 1.0e-6_wp, 'the angles of the stretched linkage')
        call check_true(error, request%iterations <= 200, 'the limit is kept')
    end subroutine test_hopeless

    subroutine test_too_far(error)
        type(error_type), allocatable, intent(out) :: error
        type(motorcycle_type), target :: model
        type(knife_edge_type), target :: edge
        type(assembly_type) :: request
        type(failure_type), allocatable :: failure
        real(wp) :: q(10), qd(10), x(3), v(3)

        call model%define()
        q = printed(:, 1)
        qd = 0.0_wp
        qd(2) = 15.0_wp
        request%largest_move_q = 2.0e-3_wp
        call assemble(model, request, 0.0_wp, q, qd, failure)
        call check_failure(error, failure, 'inconsistent_start', 'coordinate "e1" would move by 0.29')
        if (allocated(error)) return
        call check_text(error, failure%message, '(allowed: 0.2000000E-2)')
        call check_text(error, failure%message, 'most of it for "front contact height"')
        call check_text(error, failure%message, 'allow a larger move')
        call check_close(error, q, printed(:, 1), 0.0_wp, 'q')
        ! A velocity of 3 along the edge's normal, of which it must lose all; of half its scale, that is 6.
        call edge%define()
        edge%coordinate_scale = [0.5_wp, 0.5_wp, 1.0_wp]
        x = [0.0_wp, 0.0_wp, acos(0.0_wp)]
        v = [3.0_wp, 1.0_wp, 0.2_wp]
        request%largest_move_qd = 5.9_wp
        call assemble(edge, request, 0.0_wp, x, v, failure)
        call check_failure(error, failure, 'inconsistent_start', &
            'the velocity of coordinate "x" would move by -6.000000 of its scale (allowed: 5.9')
        if (allocated(error)) return
        call check_text(error, failure%message, 'most of it for "no slip"')
        request%largest_move_qd = 6.1_wp
        call assemble(edge, request, 0.0_wp, x, v, failure)
        call check_no_failure(error, failure)
        call check_close(error, v, [0.0_wp, 1.0_wp, 0.2_wp], 1.0e-15_wp, 'v')
    end subroutine test_too_far

    !> Against the equations with multipliers, solved by elimination; M is singular in the disk and in the motorcycles.
    subroutine test_mass_metric(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: model
        type(assembly_type) :: request
        type(failure_type), allocatable :: failure
        type(kkt_type) :: equations
        type(terms_type) :: terms
        real(wp), allocatable :: q(:), qd(:), expected(:)
        real(wp) :: errors(3)
        integer :: i, j, stat

        do i = 1, size(subject_names)
            call new_subject(subject_names(i), model, q, qd)
            equations%model => model
            qd = qd + [(cos(3.0_wp*j), j=1, size(qd))]
            expected = qd
            call equations%project(0.0_wp, q, expected)
            call assemble(model, request, 0.0_wp, q, qd, failure)
            call check_no_failure(error, failure)
            ! Numbers of up to 15, condition numbers of up to 1e3.
            call check_close(error, qd, expected, 1.0e-11_wp, 'qd of '//subject_names(i))
            call get_terms(model, 0.0_wp, q, qd, terms, stat)
            call natural_errors(terms, model%n_holonomic, spread(1.0_wp, 1, model%n), q, qd, 0*qd, errors)
            call check_below(error, errors(2), 1.0e-15_wp, 'velocity error')
        end do
    end subroutine test_mass_metric

    !> One row c: W (qd - qd0) = c' mu over the free entries, so qd = qd0 + W^-1 c' (nu - c qd0)/(c W^-1 c').
    subroutine test_weights(error)
        type(error_type), allocatable, intent(out) :: error
        type(sleigh_type), target :: model
        type(terms_type) :: terms
        type(assembly_type) :: request
        type(failure_type), allocatable :: failure
        real(wp), parameter :: q0(3) = [0.3_wp, -0.7_wp, 0.9_wp], qd0(3) = [1.0_wp, 0.5_wp, -2.0_wp]
        real(wp) :: q(3), qd(3), weights(3), step(3)
        integer :: k, stat

        call model%define(1.0_wp)
        do k = 1, 4
            request = assembly_type()
            weights = 1.0_wp
            if (k == 2) weights = [1.0_wp, 10.0_wp, 0.3_wp]
            ! The weights do not matter where the masses decide.
            if (k < 3) request%velocity_metric = 'weights'
            if (k > 1) request%weight_qd = [1.0_wp, 10.0_wp, 0.3_wp]
            if (k > 2) weights = [model%m, model%m, model%inertia]
            if (k == 4) request%fixed_qd = [.true., .false., .false.]
            q = q0
            qd = qd0
            call assemble(model, request, 0.4_wp, q, qd, failure)
            call check_no_failure(error, failure)
            call get_terms(model, 0.4_wp, q0, qd0, terms, stat)
            step = terms%jacobian(1, :)/weights
            if (k == 4) step(1) = 0.0_wp
            step = step*(terms%nu(1) - dot_product(terms%jacobian(1, :), qd0))/dot_product(terms%jacobian(1, :), step)
            call check_close(error, qd, qd0 + step, 1.0e-14_wp, 'qd')
            call check_close(error, request%moved_qd, step, 1.0e-14_wp, 'moved_qd')
            if (k == 4) call check_close(error, qd(:1), qd0(:1), 0.0_wp, 'the fixed velocity')
        end do
    end subroutine test_weights

    !> With mass in x alone all of the move is y's; where the row asks for nothing of y, y keeps its velocity by the weights;
    !> without any mass the weights decide.
    subroutine test_singular_mass(error)
        type(error_type), allocatable, intent(out) :: error
        type(curve_type), target :: model
        type(assembly_type) :: request
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2), normal(2)

        call model%define()
        model%masses = [3.0_wp, 0.0_wp]
        q = [2*cos(0.4_wp), sin(0.4_wp)]
        qd = [1.0_wp, 1.0_wp]
        normal = q/model%axes**2
        call assemble(model, request, 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
        call check_close(error, qd, [1.0_wp, -normal(1)/normal(2)], 1.0e-15_wp, 'qd')
        q = [2.0_wp, 0.0_wp]
        qd = [1.0_wp, 1.0_wp]
        call assemble(model, request, 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
        call check_close(error, qd, [0.0_wp, 1.0_wp], 1.0e-15_wp, 'qd where nothing ties y')
        model%masses = 0.0_wp
        q = [2*cos(0.4_wp), sin(0.4_wp)]
        qd = [1.0_wp, 1.0_wp]
        request%weight_qd = [2.0_wp, 7.0_wp]
        call assemble(model, request, 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
        call check_close(error, qd, 1.0_wp - normal/request%weight_qd*sum(normal)/sum(normal**2/request%weight_qd), 1.0e-15_wp, &
            'qd without masses')
    end subroutine test_singular_mass

    !> nh = 0: the position stays as it is, the slip is taken away.
    subroutine test_nonholonomic(error)
        type(error_type), allocatable, intent(out) :: error
        type(knife_edge_type), target :: model
        type(assembly_type) :: request
        type(failure_type), allocatable :: failure
        real(wp), parameter :: q0(3) = [7.0_wp, -3.0_wp, 0.5_wp], qd0(3) = [2.0_wp, -1.0_wp, 0.3_wp]
        real(wp) :: q(3), qd(3), forward

        call model%define()
        q = q0
        qd = qd0
        call assemble(model, request, 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
        call check_close(error, q, q0, 0.0_wp, 'q')
        forward = 2*cos(0.5_wp) - sin(0.5_wp)
        call check_close(error, qd, [forward*cos(0.5_wp), forward*sin(0.5_wp), 0.3_wp], 1.0e-15_wp, 'qd')
        call check_true(error, request%row_q == 0 .and. request%row_qd == 1, 'the blade moved qd')
        call check_true(error, request%is_nearest .and. request%iterations == 0, 'there was no position to look for')
    end subroutine test_nonholonomic

    !> The pivot at t = 0.7 is where the circle is; its velocity is that of the rod's end but for the turning. After a breakpoint
    !> the model is in the segment that follows.
    subroutine test_rheonomic(error)
        type(error_type), allocatable, intent(out) :: error
        type(moving_pivot_type), target :: model
        type(sleigh_type), target :: sleigh
        type(assembly_type) :: request
        type(failure_type), allocatable :: failure
        real(wp), parameter :: t = 0.7_wp, angle = 0.6_wp
        real(wp) :: q(2), qd(2), expected(2), expected_rate(2), x(3), v(3)

        call model%define()
        model%swing = 0.2_wp
        call model%motion(t, angle, 1.3_wp, expected, expected_rate)
        ! Further out along the rod, with a velocity along it.
        q = expected + 0.3_wp*[sin(angle), -cos(angle)]
        qd = expected_rate + 0.9_wp*[sin(angle), -cos(angle)]
        request = anywhere()
        call assemble(model, request, t, q, qd, failure)
        call check_no_failure(error, failure)
        call check_close(error, q, expected, 1.0e-14_wp, 'q')
        call check_close(error, qd, expected_rate, 1.0e-14_wp, 'qd')
        ! A speed that the second segment asks for at phi = 0: yd = -e - arm phid.
        call sleigh%define(1.0_wp)
        x = 0.0_wp
        v = [1.0_wp, 0.0_wp, 0.0_wp]
        request%fixed_qd = [.true., .false., .true.]
        call assemble(sleigh, request, 2.0_wp, x, v, failure)
        call check_no_failure(error, failure)
        call check_close(error, v, [1.0_wp, 0.5_wp - 2*sleigh%growth, 0.0_wp], 1.0e-15_wp, 'v after the breakpoint')
    end subroutine test_rheonomic

    !> Fixed velocities that leave no solution, in part or in all.
    subroutine test_impossible_velocity(error)
        type(error_type), allocatable, intent(out) :: error
        type(knife_edge_type), target :: model
        type(assembly_type) :: request
        type(failure_type), allocatable :: failure
        real(wp) :: q(3), qd(3)

        call model%define()
        q = [0.0_wp, 0.0_wp, 0.5_wp]
        qd = [1.0_wp, 2.0_wp, 0.0_wp]
        request%fixed_qd = [.true., .true., .false.]
        call assemble(model, request, 0.0_wp, q, qd, failure)
        call check_failure(error, failure, 'inconsistent_start', &
            'no velocity satisfies all constraints: "no slip" stays off by 1.27')
        if (allocated(error)) return
        call check_text(error, failure%message, 'with fixed x, y;')
        call check_close(error, qd, [1.0_wp, 2.0_wp, 0.0_wp], 0.0_wp, 'qd')
        request%fixed_qd = .true.
        call assemble(model, request, 0.0_wp, q, qd, failure)
        call check_failure(error, failure, 'inconsistent_start', 'with fixed x, y, phi;')
    end subroutine test_impossible_velocity

    subroutine test_unconstrained(error)
        type(error_type), allocatable, intent(out) :: error
        type(particle_type), target :: model
        type(assembly_type) :: request
        type(failure_type), allocatable :: failure
        real(wp) :: q(3), qd(3)

        call model%define(.false.)
        q = [1.0_wp, 2.0_wp, 3.0_wp]
        qd = -q
        request%fixed_q = [.true., .false., .true.]
        call assemble(model, request, 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
        call check_close(error, [q, qd], [1.0_wp, 2.0_wp, 3.0_wp, -1.0_wp, -2.0_wp, -3.0_wp], 0.0_wp, 'the state')
        call check_true(error, all(request%counts%terms == 0), 'nothing is evaluated')
        call check_true(error, request%is_nearest .and. request%row_q == 0, 'it is nearest')
    end subroutine test_unconstrained

    !> What each row moves is the whole of what moved: at the nearest position by its conditions, of the velocities since they are
    !> linear in the violations.
    subroutine test_shares(error)
        type(error_type), allocatable, intent(out) :: error
        type(motorcycle_type), target :: model
        type(evaluator_type) :: evaluator
        type(nearest_position_type) :: position
        type(nearest_velocity_type) :: velocity
        type(counts_type) :: counts
        logical :: fixed(10)
        real(wp) :: q(10), qd(10), ones(10)
        integer :: stat

        call model%define()
        call evaluator%initialize(model)
        ones = 1.0_wp
        fixed = .false.
        fixed(3) = .true.
        q = printed(:, 1)
        call position%initialize(6, fixed, ones, ones, 1.0e-12_wp, 200)
        call position%find(evaluator, 0.0_wp, q, counts, stat)
        call check_count(error, stat, 0, 'status')
        ! The shares are large and nearly cancel; the nearest point is found to some eps.
        call check_close(error, sum(position%pull, dim=1), q - printed(:, 1), 1.0e-14_wp, 'the position''s shares')
        call check_close(error, position%pull(:, 3), spread(0.0_wp, 1, 6), 0.0_wp, 'shares of the fixed coordinate')
        qd = ones
        call velocity%initialize(8, fixed, ones, ones, .true., 1.0e-12_wp)
        call velocity%find(evaluator, 0.0_wp, q, qd, counts, stat)
        call check_count(error, stat, 0, 'status')
        call check_close(error, sum(velocity%pull, dim=1), qd - ones, 1.0e-12_wp, 'the velocity''s shares')
    end subroutine test_shares

    !> The default weights are those of scaled coordinates: in millimetres the same happens as in metres.
    subroutine test_scaled(error)
        type(error_type), allocatable, intent(out) :: error
        type(curve_type), target :: metres, mixed
        type(assembly_type) :: request
        type(failure_type), allocatable :: failure
        real(wp), parameter :: units(2) = [1000.0_wp, 0.01_wp]
        real(wp) :: q(2), qd(2), expected(2), expected_rate(2)

        call metres%define()
        expected = [3.0_wp, 1.5_wp]
        expected_rate = [1.0_wp, -2.0_wp]
        q = expected*units
        qd = expected_rate*units
        request = anywhere()
        request%velocity_metric = 'weights'
        call assemble(metres, request, 0.0_wp, expected, expected_rate, failure)
        call check_no_failure(error, failure)
        call mixed%define()
        mixed%axes = metres%axes*units
        mixed%coordinate_scale = units
        call assemble(mixed, request, 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
        call check_close(error, q/units, expected, 1.0e-14_wp, 'q')
        call check_close(error, qd/units, expected_rate, 1.0e-14_wp, 'qd')
        ! By 1.7 of a scale, as in metres.
        q = [3.0_wp, 1.5_wp]*units
        request%largest_move_q = 1.0_wp
        call assemble(mixed, request, 0.0_wp, q, qd, failure)
        call check_failure(error, failure, 'inconsistent_start', 'coordinate "x" would move by -1.')
        request%largest_move_q = 2.0_wp
        call assemble(mixed, request, 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
    end subroutine test_scaled

    !> A NaN, a positive and a negative status of each term, from the start on; nothing changes then.
    subroutine test_failing(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: inner
        type(spy_type), target :: spy
        type(assembly_type) :: request
        type(failure_type), allocatable :: failure
        integer, parameter :: needs(3) = [need_phi, need_jacobian, need_mass], faults(3) = [fault_nan, fault_retry, fault_stop]
        character(len=15), parameter :: names(3) = [character(len=15) :: 'not_finite', 'not_evaluable', 'callback_failed']
        character(len=13), parameter :: terms(3) = [character(len=13) :: 'term phi', 'term jacobian', 'term mass']
        real(wp) :: q(2), qd(2)
        integer :: i, k

        call inner%define()
        request = anywhere()
        do i = 1, 3
            do k = 1, 3
                spy = spy_type()
                call spy%wrap(inner)
                spy%fault_term = needs(i)
                spy%fault = faults(k)
                spy%fault_time = -huge(1.0_wp)
                q = [1.0_wp, 0.5_wp]
                qd = [0.3_wp, 0.1_wp]
                call assemble(spy, request, 0.0_wp, q, qd, failure)
                call check_failure(error, failure, trim(names(k)), trim(terms(i)))
                call check_close(error, [q, qd], [1.0_wp, 0.5_wp, 0.3_wp, 0.1_wp], 0.0_wp, 'the state')
            end do
        end do
    end subroutine test_failing

    !> From (2.5, 1.9) the first steps of the way to the ellipse end left of x = 1.4, where Phi is undefined; shorter ones do not.
    !> Where all of the ellipse lies there, the status says so.
    subroutine test_undefined(error)
        type(error_type), allocatable, intent(out) :: error
        type(curve_type), target :: model
        type(assembly_type) :: request
        type(failure_type), allocatable :: failure
        integer, parameter :: ways(2) = [undefined_stat, undefined_nan]
        character(len=15), parameter :: names(2) = [character(len=15) :: 'not_evaluable', 'not_finite']
        real(wp) :: q(2), qd(2), expected(2)
        integer :: i

        call model%define()
        request = anywhere()
        expected = [40.0_wp, 60.0_wp]
        qd = 0.0_wp
        call assemble(model, request, 0.0_wp, expected, qd, failure)
        call check_no_failure(error, failure)
        do i = 1, 2
            model%undefined = ways(i)
            ! The nearest point has the smallest x of the whole way but for what the steps overshoot.
            model%least_x = expected(1) - 1.0e-3_wp
            q = [40.0_wp, 60.0_wp]
            call assemble(model, request, 0.0_wp, q, qd, failure)
            call check_no_failure(error, failure)
            call check_close(error, q, expected, 1.0e-12_wp, 'q')
            model%least_x = 3.0_wp
            q = [40.0_wp, 60.0_wp]
            call assemble(model, request, 0.0_wp, q, qd, failure)
            call check_failure(error, failure, trim(names(i)), 'while the position was assembled')
            call check_true(error, request%iterations <= 100, 'soon')
        end do
    end subroutine test_undefined

    subroutine test_requests(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(assembly_type) :: request
        real(wp) :: q(2), qd(2)

        call model%define()
        q = [0.8_wp, 0.0_wp]
        qd = 0.0_wp
        request%weight_q = [1.0_wp]
        call check_refused('weight_q has 1 entries instead of 2')
        request%weight_qd = [1.0_wp, 0.0_wp]
        call check_refused('an entry of weight_qd is not positive and finite')
        request%weight_qd = [1.0_wp, ieee_value(1.0_wp, ieee_quiet_nan)]
        call check_refused('an entry of weight_qd is not positive and finite')
        request%fixed_q = [.true.]
        call check_refused('fixed_q has 1 entries instead of 2')
        request%fixed_qd = [.true., .true., .true.]
        call check_refused('fixed_qd has 3 entries instead of 2')
        request%velocity_metric = 'metric'
        call check_refused('velocity_metric = "metric" is unknown')
        request%largest_move_q = -1.0_wp
        call check_refused('largest_move_q or largest_move_qd is negative')
        request%largest_move_qd = ieee_value(1.0_wp, ieee_quiet_nan)
        call check_refused('largest_move_q or largest_move_qd is negative')
        request%tolerance = 0.0_wp
        call check_refused('tolerance = 0.000000 must be positive')
        request%iteration_limit = 0
        call check_refused('iteration_limit = 0 must be positive')
        q(1) = ieee_value(1.0_wp, ieee_quiet_nan)
        call check_refused('q0 or qd0 is not finite')

    contains

        subroutine check_refused(piece)
            character(len=*), intent(in) :: piece
            type(failure_type), allocatable :: failure

            call assemble(model, request, 0.0_wp, q, qd, failure)
            call check_failure(error, failure, 'invalid_option', piece)
            request = assembly_type()
        end subroutine check_refused
    end subroutine test_requests

    !> What is refused otherwise starts, the statistics say how far it was moved, and a good start runs bitwise as without.
    subroutine test_simulation(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(rolling_disk_type), target :: disk
        type(simulation_type) :: simulation, plain
        type(statistics_type) :: statistics
        type(assembly_type) :: request
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2), x(9), v(9)

        call model%define()
        q = [0.9_wp, 0.0_wp]
        qd = [0.2_wp, 1.0_wp]
        call simulation%initialize(model, options_type(), 0.0_wp, q, qd, failure)
        call check_failure(error, failure, 'inconsistent_start', 'the start violates')
        call simulation%initialize(model, options_type(), 0.0_wp, q, qd, failure, request)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call check_close(error, [simulation%state%q, simulation%state%qd], [0.8_wp, 0.0_wp, 0.0_wp, 1.0_wp], 1.0e-15_wp, 'state')
        call check_below(error, maxval(simulation%errors(:2)), 1.0e-15_wp, 'errors at the start')
        statistics = simulation%statistics()
        call check_close(error, [statistics%start_moved_q, statistics%start_moved_qd], [0.1_wp, 0.2_wp], 1.0e-15_wp, 'start_moved')
        call simulation%integrate(0.1_wp, failure)
        call check_no_failure(error, failure)
        request%largest_move_q = 0.05_wp
        call simulation%initialize(model, options_type(), 0.0_wp, q, qd, failure, request)
        call check_failure(error, failure, 'inconsistent_start', 'coordinate "q1" would move by -0.1')

        call disk%define()
        call disk%start([-1.0_wp, 0.01_wp, 0.0_wp], 0.0_wp, x, v)
        call plain%initialize(disk, options_type(), 0.0_wp, x, v, failure)
        if (.not. allocated(failure)) call plain%integrate(0.1_wp, failure)
        call check_no_failure(error, failure)
        request = assembly_type()
        call simulation%initialize(disk, options_type(), 0.0_wp, x, v, failure, request)
        if (.not. allocated(failure)) call simulation%integrate(0.1_wp, failure)
        call check_no_failure(error, failure)
        call check_close(error, [simulation%state%q, simulation%state%qd], [plain%state%q, plain%state%qd], 0.0_wp, 'the end')
    end subroutine test_simulation

    !> The printed q0 is off by four millimetres of height; the nearest consistent position has most of the pitch of the equilibrium
    !> that was meant. qd0 = (0, 15, 0, ...) does not steer: what is near it turns with the front wheel.
    subroutine test_printed(error)
        type(error_type), allocatable, intent(out) :: error
        type(motorcycle_type), target :: model
        type(simulation_type) :: simulation
        type(assembly_type) :: request
        type(failure_type), allocatable :: failure
        real(wp) :: q(10), qd(10), equilibrium(10), motion(10)
        integer :: k, stat

        do k = 1, 2
            if (k == 2) then
                model%fork_angle = atan(1.0_wp)
                model%amplitude = 0.0078_wp
            end if
            call model%define()
            call model%start(15.0_wp, equilibrium, motion, stat)
            q = printed(:, k)
            qd = 0.0_wp
            qd(2) = 15.0_wp
            call simulation%initialize(model, options_type(), 0.0_wp, q, qd, failure)
            call check_failure(error, failure, 'inconsistent_start')
            call simulation%initialize(model, options_type(), 0.0_wp, q, qd, failure, request)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            associate (state => simulation%state)
                call check_below(error, maxval(simulation%errors(:2)), 1.0e-14_wp, 'errors')
                ! Half a unit of the last printed digit, which s shows most: three digits, and two of the chopper's.
                call check_close(error, state%q, equilibrium, merge(5.0e-4_wp, 5.0e-3_wp, k == 1), 'q')
                call check_between(error, state%q(5)/equilibrium(5), 0.9_wp, 1.0_wp, 'the pitch against the equilibrium''s')
                call check_count(error, maxloc(abs(request%moved_q), dim=1), 5, 'the coordinate that moved most')
                call check_close(error, request%moved_q(5:5), state%q(5:5), 0.0_wp, 'what it moved')
                call check_close(error, state%qd, motion, 1.0e-6_wp, 'qd')
                call check_between(error, maxval(abs(request%moved_qd)), 1.0e-4_wp, 1.0e-3_wp, 'the largest move of qd')
                call check_text(error, model%row_name(request%row_q), 'front contact height')
                call check_text(error, model%row_name(request%row_qd), 'no slip front')
            end associate
            call check_true(error, request%is_nearest .and. request%iterations <= 10, 'it takes a few iterations')
        end do
    end subroutine test_printed
end module test_assembly
