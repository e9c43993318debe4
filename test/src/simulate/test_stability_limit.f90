! SPDX-License-Identifier: MIT
!> Steps of explicit steppers limited by stability, not accuracy.
module test_stability_limit
    use asserts, only: check_below, check_between, check_no_failure, check_true
    use runs, only: get_start, new_scene, run
    use tandem, only: failure_type => error_type, model_type, motorcycle_type, options_type, simulation_type, statistics_type, wp
    use tandem_simulate_step_control, only: step_control_type
    use tandem_stepper, only: properties_type
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_stability_limit

contains

    !> The suite.
    subroutine collect_stability_limit(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('no-step-grows-beyond-the-limit', test_limit), &
            new_unittest('an-eigenvalue-fades', test_fading), &
            new_unittest('steps-at-the-limit-are-not-tried-in-vain', test_chopper), &
            new_unittest('steps-far-from-it-are-as-they-were', test_disk), &
            new_unittest('rounding-does-not-reach-the-steps', test_rounding), &
            new_unittest('a-straight-ride-is-not-stiff', test_straight)]
    end subroutine collect_stability_limit

    !> At rest in all but one coordinate, the other differences are rounding, which suggests eigenvalues of any size.
    subroutine test_straight(error)
        type(error_type), allocatable, intent(out) :: error
        type(motorcycle_type), target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: q(10), qd(10)
        integer :: i, stat

        model%frequency = 0.0_wp
        call model%define()
        call model%start(15.0_wp, q, qd, stat)
        do i = 1, 3
            options%step = 10.0_wp**(-4)*5**(i - 1)
            call run(simulation, model, options, 0.0_wp, q, qd, 3.0_wp, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            associate (statistics => simulation%statistics())
                call check_true(error, .not. statistics%is_stiff, 'not called stiff')
            end associate
        end do
    end subroutine test_straight

    !> A controller of a method that is stable up to h |lambda| = 6.
    subroutine set_up(control)
        type(step_control_type), intent(out) :: control
        type(options_type) :: options

        options%rtol = 1.0e-6_wp
        call control%initialize(options, [1.0_wp], 1.0_wp, properties_type(estimate_order=7, stability_limit=6.0_wp))
    end subroutine set_up

    !> Errors that allow six times the step: for a resolved motion, at half of the limit, near it, and beyond. Steps are rounded
    !> down by a 46th at most.
    subroutine test_limit(error)
        type(error_type), allocatable, intent(out) :: error
        type(step_control_type) :: control
        real(wp), parameter :: tiny_error = 1.0e-12_wp, h = 0.1_wp
        real(wp), parameter :: stiffness(4) = [2.0_wp, 3.0_wp, 5.0_wp, 12.0_wp], expected(4) = [0.6_wp, 0.2_wp, 0.12_wp, 0.1_wp]
        integer :: i

        do i = 1, 4
            call set_up(control)
            call control%accept(h, .false., tiny_error, stiffness(i), huge(1.0_wp))
            call check_between(error, control%h, 0.978_wp*expected(i), 1.0e-6_wp + expected(i), 'the next step')
            call check_true(error, control%is_at_limit .eqv. i > 2, 'at the limit')
            if (allocated(error)) return
        end do
        ! An error that requires a smaller step gets it.
        call set_up(control)
        call control%accept(h, .false., 0.9_wp, 5.0_wp, huge(1.0_wp))
        call check_true(error, control%h < h .and. .not. control%is_at_limit, 'the error decides')
        ! Beyond nine tenths error control adjusts by itself.
        call control%accept(h, .false., 0.9_wp, 5.5_wp, huge(1.0_wp))
        call check_true(error, control%is_at_limit, 'nearly there')
    end subroutine test_limit

    !> Steps without detection grow by a quarter, until six times are allowed; a new start resets it at once.
    subroutine test_fading(error)
        type(error_type), allocatable, intent(out) :: error
        type(step_control_type) :: control
        real(wp) :: h
        integer :: i

        call set_up(control)
        h = 1.0_wp
        call control%accept(h, .false., 1.0e-12_wp, 6.0_wp, huge(1.0_wp))
        do i = 1, 5
            call control%accept(h, .false., 1.0e-12_wp, 0.0_wp, huge(1.0_wp))
            h = control%h
            call check_between(error, h, 0.978_wp*1.25_wp**i, 1.0e-6_wp + 1.25_wp**i, 'the step')
            if (allocated(error)) return
        end do
        call control%restart()
        call control%accept(h, .false., 1.0e-12_wp, 0.0_wp, huge(1.0_wp))
        call check_between(error, control%h/h, 5.86_wp, 6.0_wp, 'growth after a new start')
    end subroutine test_fading

    !> Work of dop853 at 1e-8 for a scene up to a time.
    subroutine take_scene(scene, t_end, statistics, error)
        character(len=*), intent(in) :: scene
        real(wp), intent(in) :: t_end
        type(statistics_type), intent(out) :: statistics
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)

        call new_scene(scene, model)
        call get_start(scene, q, qd)
        options%stepper = 'dop853'
        options%rtol = 1.0e-8_wp
        call run(simulation, model, options, 0.0_wp, q, qd, t_end, failure)
        call check_no_failure(error, failure)
        statistics = simulation%statistics()
    end subroutine take_scene

    !> The strong damping of the chopper's fork makes stability limit dop853 at 1e-8. Without the estimate, 32 steps were
    !> rejected besides 105 accepted ones.
    subroutine test_chopper(error)
        type(error_type), allocatable, intent(out) :: error
        type(statistics_type) :: statistics

        call take_scene('chopper', 6.0_wp, statistics, error)
        if (allocated(error)) return
        call check_true(error, 10*statistics%rejected <= statistics%steps, 'rejected steps')
        if (allocated(error)) return
        call check_true(error, statistics%is_stiff, 'stiffness is noticed although steps stay below the limit')
    end subroutine test_chopper

    !> Steps and errors that differ by rounding are followed by the same step, accepted or not; rounding a step twice does not
    !> change it.
    subroutine test_rounding(error)
        type(error_type), allocatable, intent(out) :: error
        type(step_control_type) :: control
        real(wp) :: h(2), largest
        integer :: i, j

        largest = 0.0_wp
        do i = 1, 50
            do j = 1, 2
                call set_up(control)
                call control%accept(1.37_wp**i*(1 + j*1.0e-13_wp), .false., 0.011_wp*i*(1 + j*1.0e-8_wp), 0.0_wp, huge(1.0_wp))
                h(j) = control%h
                call control%reject(h(j), 1.7_wp*i*(1 + j*1.0e-8_wp))
                h(j) = h(j) + control%h
            end do
            largest = max(largest, abs(h(2) - h(1)))
            call check_below(error, abs(control%limit(control%h) - control%h), 0.0_wp, 'a step that is rounded again')
            if (allocated(error)) return
        end do
        call check_below(error, largest, 0.0_wp, 'difference of the steps')
        if (allocated(error)) return
        call check_below(error, abs(control%limit(0.0_wp)), 0.0_wp, 'what is no step')
    end subroutine test_rounding

    !> The disk is not stiff: its steps depend on the error only.
    subroutine test_disk(error)
        type(error_type), allocatable, intent(out) :: error
        type(statistics_type) :: statistics

        call take_scene('disk', 10.0_wp, statistics, error)
        if (allocated(error)) return
        call check_true(error, statistics%stiff_steps == 0, 'steps held back')
    end subroutine test_disk
end module test_stability_limit
