! SPDX-License-Identifier: MIT
!> Tests of runs with so many constraints that LAPACK is used. Suite `linalg_elimination` tests the elimination of C.
module test_large
    use asserts, only: check_below, check_count, check_no_failure, check_text, check_true
    use model_copies, only: copies_type
    use model_moving_pivot, only: moving_pivot_type
    use model_redundant, only: redundant_type
    use model_skates, only: skates_type
    use runs, only: run
    use tandem, only: failure_type => error_type, long, options_type, simulation_type, statistics_type, wp
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_large

contains

    !> The suite.
    subroutine collect_large(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('seventy-pendulums-move-as-one-and-one', test_copies), &
            new_unittest('a-run-of-seventy-goes-on-where-it-was-saved', test_checkpoint), &
            new_unittest('the-start-of-two-hundred-skates-is-bounded-work', test_skates), &
            new_unittest('of-two-hundred-skates-a-row-that-repeats-two-others-is-left-out', test_redundant_skates)]
    end subroutine collect_large

    !> A model of copies with moving pivots, and their starts.
    subroutine set_up(model, one, q, qd)
        type(copies_type), intent(out) :: model
        type(moving_pivot_type), intent(inout), target :: one
        real(wp), allocatable, intent(out) :: q(:), qd(:)
        integer :: i

        one%swing = 0.1_wp
        one%fall = 0.0_wp
        call one%define()
        model%one => one
        model%copies = 70
        model%mixing = 0.9_wp
        call model%define()
        allocate (q(model%n), qd(model%n))
        do i = 1, model%copies
            call one%motion(0.0_wp, 0.1_wp*i, 3.0_wp - 0.07_wp*i, q(2*i - 1:2*i), qd(2*i - 1:2*i))
        end do
    end subroutine set_up

    !> Every copy against a separate run of it, with loops.
    subroutine test_copies(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=7), parameter :: steppers(3) = ['rk4    ', 'dop853 ', 'sdirk54']
        real(wp), parameter :: t_end(3) = [0.2_wp, 0.2_wp, 0.02_wp]
        type(copies_type), target :: model
        type(moving_pivot_type), target :: one
        type(simulation_type) :: all_, alone
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)
        real(wp) :: off
        integer :: i, k

        call set_up(model, one, q, qd)
        do k = 1, size(steppers)
            options%stepper = steppers(k)
            options%step = 0.01_wp
            call run(all_, model, options, 0.0_wp, q, qd, t_end(k), failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            off = 0.0_wp
            do i = 1, model%copies
                call run(alone, one, options, 0.0_wp, q(2*i - 1:2*i), qd(2*i - 1:2*i), t_end(k), failure)
                call check_no_failure(error, failure)
                if (allocated(error)) return
                off = max(off, maxval(abs(all_%state%q(2*i - 1:2*i) - alone%state%q)), &
                    maxval(abs(all_%state%qd(2*i - 1:2*i) - alone%state%qd)), &
                    maxval(abs(all_%state%qdd(2*i - 1:2*i) - alone%state%qdd)))
            end do
            call check_below(error, off, 1.0e-10_wp, 'difference of state and acceleration')
            call check_below(error, maxval(all_%errors), 1.0e-14_wp, 'constraint errors')
        end do
    end subroutine test_copies

    !> Bitwise, from a state that was saved in another run.
    subroutine test_checkpoint(error)
        type(error_type), allocatable, intent(out) :: error
        type(copies_type), target :: model
        type(moving_pivot_type), target :: one
        type(simulation_type) :: whole, part
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:), lambda(:), expected(:)
        integer(long), allocatable :: words(:)

        call set_up(model, one, q, qd)
        options%stepper = 'dop853'
        options%rtol = 1.0e-6_wp
        options%atol = 1.0e-6_wp
        call whole%initialize(model, options, 0.0_wp, q, qd, failure)
        call whole%integrate(0.6_wp, failure)
        call whole%save_state(words, failure)
        call check_no_failure(error, failure)
        allocate (lambda(model%copies), expected(model%copies))
        call whole%multipliers(expected)
        call whole%integrate(0.7_wp, failure)
        call check_no_failure(error, failure)
        call part%initialize(model, options, 0.0_wp, q, qd, failure)
        call part%restore_state(words, failure)
        call check_no_failure(error, failure)
        call part%multipliers(lambda)
        call check_below(error, maxval(abs(lambda - expected)), 0.0_wp, 'difference of the multipliers')
        call part%integrate(0.7_wp, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call check_below(error, maxval(abs(part%state%q - whole%state%q)) + maxval(abs(part%state%qd - whole%state%qd)), 0.0_wp, &
            'difference')
        call check_true(error, whole%state%t > 0.69_wp, 'at the end')
    end subroutine test_checkpoint

    !> Integrability of rows is tested along a few directions, for any number of rows and coordinates: 200 rows of 600 coordinates
    !> cost as many evaluations as one row of four. An integrable one among them is still found.
    subroutine test_skates(error)
        type(error_type), allocatable, intent(out) :: error
        !> C at a point; the ends of four directions for tests of each row, and of three for all rows.
        integer, parameter :: point = 1, each = 2*4, together = 2*3
        type(skates_type), target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)
        integer :: k

        model%skates = 200
        call model%define()
        allocate (q(model%n), qd(model%n))
        call model%start(q, qd)
        do k = 0, 1
            model%disguised = 77*k
            call simulation%initialize(model, options_type(step=1.0e-3_wp), 0.0_wp, q, qd, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            statistics = simulation%statistics()
            if (k == 0) then
                call check_true(error, .not. allocated(simulation%warnings), 'no row is integrable')
                call check_count(error, statistics%start_evaluations, point + each + together, 'evaluations of C in the search')
            else
                call check_true(error, allocated(simulation%warnings), 'one is')
                if (allocated(error)) return
                call check_count(error, size(simulation%warnings), 1, 'integrable rows')
                call check_text(error, simulation%warnings(1)%text, '"nonholonomic 77" is integrable')
                call check_count(error, statistics%start_evaluations, 3*(point + each) + together, 'evaluations at three points')
            end if
        end do
    end subroutine test_skates

    !> It alone is found and dropped among many, and the others move as without it.
    subroutine test_redundant_skates(error)
        type(error_type), allocatable, intent(out) :: error
        type(skates_type), target :: model
        type(redundant_type), target :: whole
        type(simulation_type) :: simulation, plain
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)

        model%skates = 200
        call model%define()
        allocate (q(model%n), qd(model%n))
        call model%start(q, qd)
        options%step = 0.01_wp
        call run(plain, model, options, 0.0_wp, q, qd, 0.02_wp, failure)
        call check_no_failure(error, failure)
        call whole%wrap(model, [17, 90], [0.5_wp, -2.0_wp], 'sum')
        call run(simulation, whole, options, 0.0_wp, q, qd, 0.02_wp, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call check_count(error, simulation%n_redundant, 1, 'rows that are left out')
        call check_true(error, allocated(simulation%warnings), 'a warning')
        if (allocated(error)) return
        ! Of rows of unit length it has the largest part in 0.5 a - 2 b - sum = 0.
        call check_text(error, simulation%warnings(1)%text, '"sum" repeats "nonholonomic 17", "nonholonomic 90"')
        call check_below(error, maxval(abs(simulation%state%q - plain%state%q)), 1.0e-12_wp, 'difference to the run without it')
    end subroutine test_redundant_skates
end module test_large
