! SPDX-License-Identifier: MIT
!> Dense output: times between the steps, on the manifold, of the stepper's order, without influence on the steps.
module test_dense
    use asserts, only: check_below, check_between, check_failure, check_no_failure, check_true
    use runs, only: choose, run
    use tandem, only: failure_type => error_type, motorcycle_type, options_type, rolling_disk_type, simulation_type, &
        stepper_names, wp
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_dense

contains

    !> The tests of this suite.
    subroutine collect_dense(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('dense-output-has-the-order-of-its-stepper', test_order), &
            new_unittest('dense-output-holds-all-constraint-levels', test_constraints), &
            new_unittest('a-look-between-steps-leaves-no-trace', test_no_trace), &
            new_unittest('a-look-back-before-a-breakpoint-sees-the-old-segment', test_breakpoint), &
            new_unittest('a-look-outside-the-last-step-is-refused', test_outside)]
    end subroutine collect_dense

    !> The disk at its start.
    subroutine start_disk(disk, simulation, options, failure)
        type(rolling_disk_type), intent(inout), target :: disk
        type(simulation_type), intent(inout) :: simulation
        type(options_type), intent(in) :: options
        type(failure_type), allocatable, intent(out) :: failure
        real(wp) :: q(9), qd(9)

        call disk%define()
        call disk%start([-1.0_wp, 0.01_wp, 0.0_wp], 0.1_wp, q, qd)
        call simulation%initialize(disk, options, 0.0_wp, q, qd, failure)
    end subroutine start_disk

    !> The largest errors of q and qd at ten places of one step of size h, against dop853 in eight steps to each place.
    subroutine measure(stepper, h, errors, error)
        character(len=*), intent(in) :: stepper
        real(wp), intent(in) :: h
        real(wp), intent(out) :: errors(2)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type), target :: disk, exact_disk
        type(simulation_type) :: simulation, exact
        type(options_type) :: options, fine
        type(failure_type), allocatable :: failure
        integer :: i

        errors = 0.0_wp
        options%stepper = stepper
        options%step = h
        fine%stepper = 'dop853'
        call start_disk(disk, simulation, options, failure)
        if (.not. allocated(failure)) call simulation%step(1.0_wp, failure)
        do i = 1, 9
            if (allocated(failure)) exit
            call simulation%look_at(0.1_wp*i*h, failure)
            if (allocated(failure)) exit
            fine%step = 0.1_wp*i*h/8
            call start_disk(exact_disk, exact, fine, failure)
            if (.not. allocated(failure)) call exact%integrate(0.1_wp*i*h, failure)
            errors(1) = max(errors(1), maxval(abs(simulation%state%q - exact%state%q)))
            errors(2) = max(errors(2), maxval(abs(simulation%state%qd - exact%state%qd)))
        end do
        call check_no_failure(error, failure)
    end subroutine measure

    !> Halving a step divides the local error of the position by at least 2**p, where p is the order of the stepper.
    subroutine test_order(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: coarse(2), fine(2), h
        integer :: k
        integer, parameter :: order(6) = [4, 5, 7, 2, 4, 4]

        do k = 1, size(stepper_names)
            h = merge(0.4_wp, 0.1_wp, stepper_names(k) == 'dop853')
            call measure(stepper_names(k), h, coarse, error)
            if (allocated(error)) return
            call measure(stepper_names(k), h/2, fine, error)
            if (allocated(error)) return
            call check_true(error, fine(1) > 1.0e-14_wp, trim(stepper_names(k))//' is at rounding, the test shows nothing')
            if (allocated(error)) return
            call check_between(error, log(coarse(1)/fine(1))/log(2.0_wp), order(k) - 0.2_wp, 12.0_wp, &
                trim(stepper_names(k))//': order of the position')
            if (allocated(error)) return
            call check_between(error, log(coarse(2)/fine(2))/log(2.0_wp), order(k) - 0.3_wp, 12.0_wp, &
                trim(stepper_names(k))//': order of the velocity')
            if (allocated(error)) return
        end do
    end subroutine test_order

    !> As small as at the steps, whose tolerance is 1e-12.
    subroutine test_constraints(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type), target :: disk
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        integer :: i, k

        do k = 1, size(stepper_names)
            options%stepper = stepper_names(k)
            options%step = 0.02_wp
            call start_disk(disk, simulation, options, failure)
            do while (.not. allocated(failure) .and. simulation%state%t < 1.0_wp)
                call simulation%step(1.0_wp, failure)
                do i = 1, 3
                    if (allocated(failure)) exit
                    call simulation%look_at(simulation%state%t - 0.005_wp*i, failure)
                    call check_below(error, maxval(simulation%errors), 1.0e-12_wp, trim(stepper_names(k))//': constraint error')
                    if (allocated(error)) return
                    call simulation%look_back()
                end do
            end do
            call check_no_failure(error, failure)
            if (allocated(error)) return
        end do
    end subroutine test_constraints

    !> Every stepper, policy and refresh mode: the run with dense output ends bitwise like the run without it.
    subroutine test_no_trace(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type), target :: disk
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        ! The last makes a new chart after corrections, some of which are due to dense output.
        character(len=10), parameter :: policies(4) = [character(len=10) :: 'every_step', 'adaptive', 'paper', 'paper']
        real(wp) :: expected(9)
        integer :: i, j, k

        do k = 1, size(stepper_names)
            do j = 1, size(policies)
                do i = 1, 2
                    options = choose(stepper=stepper_names(k), step=0.01_wp, chart=policies(j), v_limit=0.3_wp)
                    if (i == 2) options%refresh = 'refine'
                    if (j == 4) options%iteration_limit = 2
                    call start_disk(disk, simulation, options, failure)
                    if (.not. allocated(failure)) call simulation%integrate(0.5_wp, failure)
                    call check_no_failure(error, failure)
                    if (allocated(error)) return
                    expected = simulation%state%q
                    call start_disk(disk, simulation, options, failure)
                    do while (.not. allocated(failure) .and. simulation%state%t < 0.5_wp)
                        call simulation%step(0.5_wp, failure)
                        if (.not. allocated(failure)) call simulation%look_at(simulation%state%t - 0.004_wp, failure)
                        call simulation%look_back()
                    end do
                    call check_no_failure(error, failure)
                    if (allocated(error)) return
                    call check_true(error, all(abs(simulation%state%q - expected) <= 0.0_wp), &
                        trim(stepper_names(k))//', '//trim(policies(j))//', '//options%refresh//': the look left a trace')
                    if (allocated(error)) return
                end do
            end do
        end do
    end subroutine test_no_trace

    !> The motorcycle's steering stops at 2 pi. Dense output before it must have the steering rate: C qd = nu with the old nu.
    subroutine test_breakpoint(error)
        type(error_type), allocatable, intent(out) :: error
        type(motorcycle_type), target :: motorcycle
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), parameter :: two_pi = 8.0_wp*atan(1.0_wp)
        real(wp) :: q(10), qd(10)
        integer :: stat

        call motorcycle%define()
        call motorcycle%start(15.0_wp, q, qd, stat)
        options%step = 0.01_wp
        call run(simulation, motorcycle, options, 0.0_wp, q, qd, two_pi, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call check_true(error, motorcycle%segment == 2, 'the breakpoint is passed')
        if (allocated(error)) return
        call simulation%look_at(two_pi - 1.0e-3_wp, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call check_true(error, motorcycle%segment == 1, 'the look is in the old segment')
        if (allocated(error)) return
        call check_below(error, maxval(simulation%errors), 1.0e-12_wp, 'constraint errors')
        if (allocated(error)) return
        call simulation%look_back()
        call check_true(error, motorcycle%segment == 2, 'back in the new segment')
        if (allocated(error)) return
        call simulation%integrate(7.0_wp, failure)
        call check_no_failure(error, failure)
    end subroutine test_breakpoint

    subroutine test_outside(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type), target :: disk
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure

        options%step = 0.01_wp
        call start_disk(disk, simulation, options, failure)
        call simulation%look_at(-0.1_wp, failure)
        call check_failure(error, failure, 'invalid_option', 'is not within the last step')
        if (allocated(error)) return
        call simulation%step(1.0_wp, failure)
        if (.not. allocated(failure)) call simulation%step(1.0_wp, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call simulation%look_at(0.005_wp, failure)
        call check_failure(error, failure, 'invalid_option', 'is not within the last step')
    end subroutine test_outside
end module test_dense
