! SPDX-License-Identifier: MIT
!> Tests of the position of assembled starts: the nearest consistent one against closed forms and against equations solved here, and
!> the end of hopeless searches.
module test_nearest_position
    use asserts, only: check_below, check_between, check_close, check_count, check_failure, check_no_failure, check_text, &
        check_true
    use model_curve, only: curve_type, undefined_nan, undefined_stat
    use model_linkage, only: linkage_type
    use model_pendulum, only: pendulum_type
    use subjects, only: new_subject, subject_names
    use tandem, only: assemble, assembly_type, failure_type => error_type, model_type, to_text, wp
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_nearest_position

contains

    !> The suite.
    subroutine collect_nearest_position(testsuite)
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
            new_unittest('regions-where-phi-is-undefined-are-avoided', test_undefined)]
    end subroutine collect_nearest_position

    !> Along the radius, from far outside and far inside. The remainder is rounding: of q0 if that is large.
    subroutine test_circle(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(assembly_type) :: request
        type(failure_type), allocatable :: failure
        real(wp), parameter :: direction(2) = [0.6_wp, -0.8_wp], radii(6) = [1.0e-3_wp, 0.2_wp, 0.79_wp, 0.81_wp, 5.0_wp, 1.0e6_wp]
        real(wp) :: q(2), qd(2)
        integer :: i

        call model%define()
        request = assembly_type(largest_move_q=0.0_wp)
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
            request = assembly_type(largest_move_q=0.0_wp)
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
                ! A point of the scan may be the nearest one up to rounding.
                call check_below(error, sum(weights*(q - starts(:, i))**2), (1 + 1.0e-14_wp)*least, 'the weighted squared distance')
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
        request = assembly_type(largest_move_q=0.0_wp)
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

    !> The other coordinate moves to the nearer of the two remaining positions.
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

        request = assembly_type(largest_move_q=0.0_wp)
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
        call check_failure(error, failure, 'inconsistent_start', 'constraint "ellipse" remains violated by 0.28125')
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
        call check_text(error, failure%message, 'constraint "rod" remains violated by 0.7')
        ! All fixed, and right.
        q = [0.8_wp, 0.0_wp]
        call assemble(model, request, 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
    end subroutine test_fixed_impossible

    !> The links reach 3.3 and the point is 5 away: 1.7 remain for any angles. No search exceeds the limit.
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
        request = assembly_type(largest_move_q=0.0_wp)
        do i = 1, size(starts, 2)
            q = starts(:, i)
            qd = 1.0_wp
            model%calls = 0
            call assemble(model, request, 0.0_wp, q, qd, failure)
            call check_failure(error, failure, 'inconsistent_start', 'constraint "closure x" remains violated by 1.7')
            call check_true(error, request%iterations <= 80, 'at most 80 iterations, not '//to_text(request%iterations))
            ! One call each of Phi and Phi_q at each point, and at the start.
            call check_true(error, model%calls <= 2*request%iterations + 2, 'two calls a point')
            call check_close(error, [q, qd], [starts(:, i), 1.0_wp, 1.0_wp, 1.0_wp], 0.0_wp, 'the state')
        end do
        request%iteration_limit = 7
        model%calls = 0
        q = starts(:, 3)
        call assemble(model, request, 0.0_wp, q, qd, failure)
        call check_failure(error, failure, 'inconsistent_start', 'after 7 iterations')
        call check_true(error, model%calls <= 16, 'the limit is kept')
        ! Just long enough: rank is lost at the solution, where a violation of 1e-12 leaves angles undetermined by 1e-6.
        model%distance = 3.3_wp
        request = assembly_type(largest_move_q=0.0_wp)
        q = starts(:, 1)
        qd = 0.0_wp
        call assemble(model, request, 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
        call check_below(error, maxval(abs(q)), 1.0e-6_wp, 'the angles of the stretched linkage')
        call check_true(error, request%iterations <= 200, 'the limit is kept')
    end subroutine test_hopeless

    !> From (2.5, 1.9) the first steps towards the ellipse end left of x = 1.4, where Phi is undefined; shorter ones do not. If the
    !> whole ellipse is in that region, the status reports it.
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
        request = assembly_type(largest_move_q=0.0_wp)
        expected = [40.0_wp, 60.0_wp]
        qd = 0.0_wp
        call assemble(model, request, 0.0_wp, expected, qd, failure)
        call check_no_failure(error, failure)
        do i = 1, 2
            model%undefined = ways(i)
            ! The nearest point has the smallest x of the whole path except for overshooting steps.
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
end module test_nearest_position
