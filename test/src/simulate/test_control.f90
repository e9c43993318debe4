! SPDX-License-Identifier: MIT
!> Steps that follow an error estimate.
module test_control
    use asserts, only: check_below, check_between, check_failure, check_no_failure, check_true
    use model_knife_edge, only: knife_edge_type
    use model_pendulum, only: pendulum_type
    use model_stiff_pendulum, only: stiff_pendulum_type
    use model_tilted_skate, only: tilted_skate_type
    use reference, only: read_reference, reference_type
    use runs, only: run
    use tandem, only: articulated_vehicle_type, failure_type => error_type, model_type, options_type, rolling_disk_type, &
        simulation_type, statistics_type, wp
    use testdrive, only: error_type, new_unittest, test_failed, unittest_type
    implicit none (type, external)
    private

    public :: collect_control

    !> A pendulum whose Jacobian has a wrong sign, or whose force cannot be evaluated after half a second.
    type, extends(pendulum_type) :: faulty_type
        logical :: is_wrong = .false., is_broken = .false.
    end type faulty_type

    character(len=16), parameter :: steppers(3) = [character(len=16) :: 'dopri5', 'dop853', 'sdirk54']

contains

    !> The tests of this suite.
    subroutine collect_control(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('the-error-follows-the-tolerance-on-the-tilted-skate', test_tilted_skate), &
            new_unittest('the-error-follows-the-tolerance-on-the-knife-edge', test_knife_edge), &
            new_unittest('newton-leaves-nothing-of-account-at-tight-tolerances', test_left), &
            new_unittest('the-skate-takes-no-more-steps-than-nohol', test_nohol), &
            new_unittest('dop853-meets-its-budget-on-the-disk', test_disk_budget), &
            new_unittest('large-steps-are-not-lost-to-what-corrections-taught', test_large_steps), &
            new_unittest('the-motion-within-large-steps-can-be-looked-at', test_looks), &
            new_unittest('a-look-far-from-the-last-stage-finds-its-point', test_flat_looks), &
            new_unittest('steppers-agree-on-a-nearly-flat-disk', test_flat), &
            new_unittest('every-tolerance-ends-on-the-disk-with-constraints-held', test_disk_tolerances), &
            new_unittest('the-vehicle-passes-its-breakpoint-at-every-tolerance', test_breakpoint), &
            new_unittest('sdirk54-grows-its-steps-after-a-stiff-transient', test_stiff_growth), &
            new_unittest('the-trapezoid-error-falls-with-the-tolerance', test_trapezoid), &
            new_unittest('rk4-has-no-estimate', test_no_estimate), &
            new_unittest('a-jump-too-hard-to-cross-ends-in-a-named-status', test_blow_up), &
            new_unittest('the-largest-step-is-respected', test_max_step), &
            new_unittest('a-run-may-end-right-behind-a-breakpoint', test_sliver), &
            new_unittest('a-run-may-begin-with-a-rounding', test_first_sliver), &
            new_unittest('single-steps-need-no-end-that-is-ever-reached', test_no_end), &
            new_unittest('steps-that-get-nowhere-end-the-run', test_no_progress), &
            new_unittest('a-run-goes-on-when-its-model-is-mended', test_mended)]
    end subroutine collect_control

    !> Ends that are one to eight roundings after the breakpoint: this remainder is one step without failed attempts.
    subroutine test_sliver(error)
        type(error_type), allocatable, intent(out) :: error
        type(articulated_vehicle_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(reference_type) :: table
        real(wp) :: t_end
        integer :: i, k

        call read_reference('vehicle', table)
        call model%define()
        do k = 1, size(steppers)
            do i = 1, 8
                t_end = model%breakpoints(1) + i*spacing(model%breakpoints(1))
                call run(simulation, model, tolerance(trim(steppers(k)), 1.0e-6_wp), 0.0_wp, table%q(:, 1), table%qd(:, 1), &
                    t_end, failure)
                call check_no_failure(error, failure)
                call check_below(error, abs(simulation%state%t - t_end), 0.0_wp, 'distance from the end')
                if (.not. allocated(error)) call simulation%integrate(t_end + 0.1_wp, failure)
                call check_no_failure(error, failure)
                if (allocated(error)) return
            end do
        end do
    end subroutine test_sliver

    !> A first end that is one to eight roundings after the start; the run continues as if there had been none.
    subroutine test_first_sliver(error)
        type(error_type), allocatable, intent(out) :: error
        type(faulty_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)
        integer :: i, k

        call model%define()
        call model%start(0.6_wp, 0.0_wp, q, qd)
        do k = 1, size(steppers)
            do i = 1, 8
                call run(simulation, model, tolerance(trim(steppers(k)), 1.0e-6_wp), 1.0_wp, q, qd, &
                    1.0_wp + i*spacing(1.0_wp), failure)
                call check_no_failure(error, failure)
                if (.not. allocated(error)) call simulation%integrate(1.1_wp, failure)
                call check_no_failure(error, failure)
                if (allocated(error)) return
            end do
        end do
    end subroutine test_first_sliver

    !> Single steps may have an end far beyond all times reached.
    subroutine test_no_end(error)
        type(error_type), allocatable, intent(out) :: error
        type(faulty_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)
        integer :: i

        call model%define()
        call model%start(0.6_wp, 0.0_wp, q, qd)
        call simulation%initialize(model, tolerance('dopri5', 1.0e-3_wp), 0.0_wp, q, qd, failure)
        do i = 1, 100001
            if (.not. allocated(failure)) call simulation%step(1.0e30_wp, failure)
        end do
        call check_no_failure(error, failure)
    end subroutine test_no_end

    !> With a wrong Jacobian only tiny steps succeed, so that a run would take years.
    subroutine test_no_progress(error)
        type(error_type), allocatable, intent(out) :: error
        type(faulty_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)

        call model%define()
        model%is_wrong = .true.
        model%holonomic_jacobian => faulty_jacobian
        call model%start(0.6_wp, 0.0_wp, q, qd)
        call run(simulation, model, tolerance('dopri5', 1.0e-6_wp), 0.0_wp, q, qd, 3.0_wp, failure)
        call check_failure(error, failure, 'step_underflow', 'step sizes have collapsed')
        if (allocated(error)) return
        call check_true(error, index(failure%message, 'Jacobian') > 0, 'it says where to look')
    end subroutine test_no_progress

    !> The size of the last steps before a failure must not be used afterwards.
    subroutine test_mended(error)
        type(error_type), allocatable, intent(out) :: error
        type(faulty_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)
        integer :: k, again

        call model%define()
        model%applied_force => faulty_force
        call model%start(1.0_wp, 0.0_wp, q, qd)
        do k = 1, size(steppers)
            model%is_broken = .true.
            call run(simulation, model, tolerance(trim(steppers(k)), 1.0e-8_wp), 0.0_wp, q, qd, 1.0_wp, failure)
            do again = 1, 2
                call check_failure(error, failure, 'not_evaluable', 'force')
                if (allocated(error)) return
                call simulation%integrate(1.0_wp, failure)
            end do
            model%is_broken = .false.
            call simulation%integrate(1.0_wp, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
        end do
    end subroutine test_mended

    subroutine faulty_jacobian(self, t, q, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        stat = 0
        value(1, :) = q
        select type (self)
        class is (faulty_type)
            if (self%is_wrong) value(1, 1) = -q(1)
        end select
    end subroutine faulty_jacobian

    subroutine faulty_force(self, t, q, qd, value, stat)
        class(model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(out) :: value(:)
        integer, intent(out) :: stat

        stat = 0
        value = [0.0_wp, -9.81_wp]
        select type (self)
        class is (faulty_type)
            if (self%is_broken .and. t > 0.5_wp) stat = 1
        end select
    end subroutine faulty_force

    !> Options of error-controlled steps.
    function tolerance(stepper, rtol) result(options)
        character(len=*), intent(in) :: stepper
        real(wp), intent(in) :: rtol
        type(options_type) :: options

        options%stepper = stepper
        options%rtol = rtol
    end function tolerance

    !> Between a thousandth and 30 times the tolerance, for every tolerance from 1e-4 to 1e-12, and decreasing with it unless the
    !> signs of remainders of Newton's iteration and rounding decide: errors of sdirk54 at 1e-11 are 1e-12 or 1e-13.
    subroutine check_proportional(error, model, q, qd, exact, t_end)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), intent(inout), target :: model
        real(wp), intent(in) :: q(:), qd(:), exact(:), t_end
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp), parameter :: left = 1.0e-12_wp
        real(wp) :: rtol, found, last
        integer :: i, k

        do k = 1, size(steppers)
            last = huge(1.0_wp)
            do i = 4, 12
                rtol = 10.0_wp**(-i)
                call run(simulation, model, tolerance(steppers(k), rtol), 0.0_wp, q, qd, t_end, failure)
                call check_no_failure(error, failure)
                if (allocated(error)) return
                found = maxval(abs(simulation%state%q - exact))
                call check_between(error, found/rtol, 1.0e-3_wp, 30.0_wp, trim(steppers(k))//': error over tolerance')
                if (allocated(error)) return
                call check_below(error, found, max(last, left), trim(steppers(k))//': error at a tighter tolerance')
                if (allocated(error)) return
                last = found
            end do
        end do
    end subroutine check_proportional

    subroutine test_tilted_skate(error)
        type(error_type), allocatable, intent(out) :: error
        type(tilted_skate_type), target :: model

        call model%define()
        call check_proportional(error, model, [0.0_wp, 0.0_wp], [0.0_wp, 0.0_wp], model%solution(10.0_wp), 10.0_wp)
    end subroutine test_tilted_skate

    subroutine test_knife_edge(error)
        type(error_type), allocatable, intent(out) :: error
        type(knife_edge_type), target :: model
        real(wp) :: q0(3), qd0(3), q(3), qd(3), qdd(3), lambda(1)

        call model%define()
        call model%solution(0.0_wp, q0, qd0, qdd, lambda)
        call model%solution(10.0_wp, q, qd, qdd, lambda)
        call check_proportional(error, model, q0, qd0, q, 10.0_wp)
    end subroutine test_knife_edge

    !> Errors of sdirk54 at tight tolerances are those of its steps, a fifth of the tolerance or less: when one correction of a
    !> stage was accepted because the second had once been rounding, they were 1.0, 2.0 and 1.8 times the tolerance.
    subroutine test_left(error)
        type(error_type), allocatable, intent(out) :: error
        type(tilted_skate_type), target :: skate
        type(knife_edge_type), target :: edge
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp), parameter :: rtol(3) = [1.0e-10_wp, 3.0e-11_wp, 1.0e-11_wp], part = 0.4_wp
        real(wp) :: q0(3), qd0(3), q(3), qd(3), qdd(3), lambda(1)
        integer :: k

        call skate%define()
        call edge%define()
        call edge%solution(0.0_wp, q0, qd0, qdd, lambda)
        call edge%solution(10.0_wp, q, qd, qdd, lambda)
        do k = 1, size(rtol)
            call run(simulation, skate, tolerance('sdirk54', rtol(k)), 0.0_wp, [0.0_wp, 0.0_wp], [0.0_wp, 0.0_wp], 10.0_wp, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call check_below(error, maxval(abs(simulation%state%q - skate%solution(10.0_wp))), part*rtol(k), 'error on the skate')
            if (allocated(error)) return
            call run(simulation, edge, tolerance('sdirk54', rtol(k)), 0.0_wp, q0, qd0, 10.0_wp, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call check_below(error, maxval(abs(simulation%state%q - q)), part*rtol(k), 'error on the knife edge')
            if (allocated(error)) return
        end do
    end subroutine test_left

    !> NOHOL (Rheinboldt; DOPRI5 in tangent coordinates) takes 127 steps for 1.6e-7 and 754 for 1.7e-11; dop853 has a quarter.
    subroutine test_nohol(error)
        type(error_type), allocatable, intent(out) :: error

        call check_steps(error, 'dopri5', 2.0e-7_wp, 1.6e-7_wp, 127)
        if (.not. allocated(error)) call check_steps(error, 'dopri5', 1.5e-11_wp, 1.7e-11_wp, 754)
        if (.not. allocated(error)) call check_steps(error, 'dop853', 7.0e-8_wp, 1.6e-7_wp, 31)
        if (.not. allocated(error)) call check_steps(error, 'dop853', 1.0e-11_wp, 1.7e-11_wp, 188)
    end subroutine test_nohol

    !> The tilted skate at t = 10: an error and a number of steps, including rejected ones.
    subroutine check_steps(error, stepper, rtol, largest_error, most_steps)
        type(error_type), allocatable, intent(out) :: error
        character(len=*), intent(in) :: stepper
        real(wp), intent(in) :: rtol, largest_error
        integer, intent(in) :: most_steps
        type(tilted_skate_type), target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(failure_type), allocatable :: failure

        call model%define()
        call run(simulation, model, tolerance(stepper, rtol), 0.0_wp, [0.0_wp, 0.0_wp], [0.0_wp, 0.0_wp], 10.0_wp, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        statistics = simulation%statistics()
        call check_below(error, maxval(abs(simulation%state%q - model%solution(10.0_wp))), largest_error, stepper//': error')
        if (allocated(error)) return
        call check_true(error, statistics%steps + statistics%rejected <= most_steps, stepper//': too many steps')
    end subroutine check_steps

    !> Run the disk to t = 10 and return its error.
    subroutine roll(options, largest, statistics, error)
        type(options_type), intent(in) :: options
        real(wp), intent(out) :: largest
        type(statistics_type), intent(out) :: statistics
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type), target :: disk
        type(simulation_type) :: simulation
        type(reference_type) :: table
        type(failure_type), allocatable :: failure

        largest = huge(1.0_wp)
        call disk%define()
        call read_reference('disk', table)
        call run(simulation, disk, options, 0.0_wp, table%q(:, 1), table%qd(:, 1), 10.0_wp, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        largest = maxval(abs(simulation%state%q - table%q(:, size(table%t))))
        statistics = simulation%statistics()
    end subroutine roll

    !> A disk that rolls fast: even if the iteration for the position contracts slowly, its corrections improve B.
    subroutine test_looks(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type), target :: disk
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(statistics_type) :: statistics
        real(wp) :: q(9), qd(9), t_before, t_after
        integer :: j

        call disk%define()
        call disk%start([-20.0_wp, 0.01_wp, 0.0_wp], 0.0_wp, q, qd)
        call simulation%initialize(disk, tolerance('dop853', 1.0e-5_wp), 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
        t_after = 0.0_wp
        do while (t_after < 5.0_wp .and. .not. allocated(error))
            t_before = t_after
            call simulation%step(5.0_wp, failure)
            call check_no_failure(error, failure)
            t_after = simulation%state%t
            do j = 1, 7
                call simulation%look_at(t_before + (t_after - t_before)*j/8, failure)
                call check_no_failure(error, failure)
            end do
            call simulation%look_back()
        end do
        if (allocated(error)) return
        statistics = simulation%statistics()
        call check_true(error, statistics%failed <= 20, 'steps that could not be completed')
    end subroutine test_looks

    !> Near the start of a step the B of its origin is used, not that of its end.
    subroutine test_flat_looks(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: alpha = 1.0e-2_wp, pi = acos(-1.0_wp)
        type(rolling_disk_type), target :: disk
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: q(9), qd(9), precession, t_after, t_before, t_end
        integer :: j

        call disk%define()
        precession = sqrt(disk%mass*disk%gravity*disk%radius/(disk%inertia(2)*sin(alpha)))
        call disk%start([0.0_wp, 0.0_wp, 0.95_wp*precession*sin(alpha)], 0.5_wp*pi - alpha, q, qd)
        t_end = 4*pi/precession
        call simulation%initialize(disk, tolerance('dop853', 1.0e-6_wp), 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
        t_after = 0.0_wp
        do while (t_after < t_end .and. .not. allocated(error))
            t_before = t_after
            call simulation%step(t_end, failure)
            call check_no_failure(error, failure)
            t_after = simulation%state%t
            do j = 1, 31
                call simulation%look_at(t_before + (t_after - t_before)*j/32, failure)
                call check_no_failure(error, failure)
                if (allocated(error)) return
            end do
            call simulation%look_back()
        end do
    end subroutine test_flat_looks

    !> Accelerations from 1e-3 to 1e4 give a matrix D' M D whose factors are inaccurate in an unfavourable order of the coordinates.
    subroutine test_flat(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=6), parameter :: steppers(2) = ['dop853', 'dopri5']
        real(wp), parameter :: alpha = 1.0e-3_wp, pi = acos(-1.0_wp)
        type(rolling_disk_type), target :: disk
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: q0(9), qd0(9), q(9, 2), precession
        integer :: i

        call disk%define()
        precession = sqrt(disk%mass*disk%gravity*disk%radius/(disk%inertia(2)*sin(alpha)))
        call disk%start([0.0_wp, 0.0_wp, 0.95_wp*precession*sin(alpha)], 0.5_wp*pi - alpha, q0, qd0)
        do i = 1, 2
            call run(simulation, disk, tolerance(steppers(i), 1.0e-12_wp), 0.0_wp, q0, qd0, 4*pi/precession, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            q(:, i) = simulation%state%q
        end do
        ! They differ by 1e-15 with a good order, by 1e-4 with a bad one.
        call check_below(error, maxval(abs(q(1:2, 1) - q(1:2, 2))), 1.0e-12_wp, 'difference of the centre')
    end subroutine test_flat

    !> Steps that cannot be completed: an update of B at one stage that is unsuitable at another must be discarded. (With the B of
    !> the origin 19 of 55 steps are lost, with one that is never discarded 23 of 54.)
    subroutine test_large_steps(error)
        type(error_type), allocatable, intent(out) :: error
        type(statistics_type) :: statistics
        real(wp) :: largest

        call roll(tolerance('dop853', 1.0e-4_wp), largest, statistics, error)
        if (allocated(error)) return
        call check_true(error, statistics%failed <= 8, 'steps that could not be completed')
    end subroutine test_large_steps

    !> 1e-6 in at most 1900 right-hand sides, 1e-8 in at most 2900. The disk amplifies the error of a step by 1e3 to 1e4, so the
    !> tolerances are that much smaller.
    subroutine test_disk_budget(error)
        type(error_type), allocatable, intent(out) :: error
        type(statistics_type) :: statistics
        real(wp) :: largest

        call roll(tolerance('dop853', 1.0e-10_wp), largest, statistics, error)
        if (allocated(error)) return
        call check_below(error, largest, 1.0e-6_wp, 'error at 1e-10')
        if (allocated(error)) return
        call check_true(error, statistics%right_hand_sides <= 1900, 'right-hand sides for 1e-6')
        if (allocated(error)) return
        call roll(tolerance('dop853', 3.0e-12_wp), largest, statistics, error)
        if (allocated(error)) return
        call check_below(error, largest, 1.0e-8_wp, 'error at 3e-12')
        if (allocated(error)) return
        call check_true(error, statistics%right_hand_sides <= 2900, 'right-hand sides for 1e-8')
    end subroutine test_disk_budget

    !> No tolerance hangs, and the constraints are satisfied for any steps.
    subroutine test_disk_tolerances(error)
        type(error_type), allocatable, intent(out) :: error
        type(statistics_type) :: statistics
        real(wp) :: largest
        integer :: i, k

        do k = 1, size(steppers)
            do i = 4, 12, 2
                call roll(tolerance(steppers(k), 10.0_wp**(-i)), largest, statistics, error)
                if (allocated(error)) return
                call check_below(error, max(statistics%position_error, statistics%velocity_error, &
                    statistics%acceleration_error), 1.0e-11_wp, trim(steppers(k))//': constraint errors')
                if (allocated(error)) return
            end do
        end do
    end subroutine test_disk_tolerances

    !> A step ends at the steering's kink at 2 pi exactly, so the error continues to decrease: at most 100 times the tolerance at
    !> |q| = 156.
    subroutine test_breakpoint(error)
        type(error_type), allocatable, intent(out) :: error
        type(articulated_vehicle_type), target :: vehicle
        type(simulation_type) :: simulation
        type(reference_type) :: table
        type(failure_type), allocatable :: failure
        real(wp) :: rtol
        integer :: i, k

        call vehicle%define()
        call read_reference('vehicle', table)
        do k = 1, size(steppers)
            do i = 4, 10, 2
                rtol = 10.0_wp**(-i)
                call run(simulation, vehicle, tolerance(steppers(k), rtol), 0.0_wp, table%q(:, 1), table%qd(:, 1), 10.0_wp, failure)
                call check_no_failure(error, failure)
                if (allocated(error)) return
                call check_below(error, maxval(abs(simulation%state%q - table%q(:, size(table%t)))), 100*rtol, steppers(k))
                if (allocated(error)) return
            end do
        end do
    end subroutine test_breakpoint

    !> A spring a thousand times stiffer than gravity, strongly damped and stretched at the start: after the transient the steps
    !> are a thousand times the first ones.
    subroutine test_stiff_growth(error)
        type(error_type), allocatable, intent(out) :: error
        type(stiff_pendulum_type), target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(failure_type), allocatable :: failure
        real(wp) :: length

        model%k = 9.81e8_wp
        model%c = sqrt(model%k)
        call model%define()
        length = 1.001_wp
        call run(simulation, model, tolerance('sdirk54', 1.0e-6_wp), 0.0_wp, [length, 0.0_wp, length], &
            [0.0_wp, 0.0_wp, 0.0_wp], 2.0_wp, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        statistics = simulation%statistics()
        call check_true(error, statistics%largest_step > 1.0e3_wp*statistics%smallest_step, 'the steps did not grow')
    end subroutine test_stiff_growth

    !> Order 2 leaves a global error that falls as the tolerance to the power 2/3.
    subroutine test_trapezoid(error)
        type(error_type), allocatable, intent(out) :: error
        type(tilted_skate_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: found, last
        integer :: i

        call model%define()
        last = 0.0_wp
        do i = 5, 8
            call run(simulation, model, tolerance('trapezoid', 10.0_wp**(-i)), 0.0_wp, [0.0_wp, 0.0_wp], [0.0_wp, 0.0_wp], &
                10.0_wp, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            found = maxval(abs(simulation%state%q - model%solution(10.0_wp)))
            if (i > 5) call check_between(error, log10(last/found), 0.5_wp, 0.85_wp, 'decades of error a decade of tolerance')
            if (allocated(error)) return
            last = found
        end do
    end subroutine test_trapezoid

    subroutine test_no_estimate(error)
        type(error_type), allocatable, intent(out) :: error
        type(tilted_skate_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure

        call model%define()
        call simulation%initialize(model, tolerance('rk4', 1.0e-6_wp), 0.0_wp, [0.0_wp, 0.0_wp], [0.0_wp, 0.0_wp], failure)
        call check_failure(error, failure, 'invalid_option', 'rk4 has no error estimate')
    end subroutine test_no_estimate

    !> A disk spun up by 1e160 rad/s overflows in its first step, however small: bounded work, then a status.
    subroutine test_blow_up(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type), target :: disk
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: q(9), qd(9)

        call disk%define()
        call disk%start([-1.0e160_wp, 0.0_wp, 0.0_wp], 0.0_wp, q, qd)
        call run(simulation, disk, tolerance('dop853', 1.0e-6_wp), 0.0_wp, q, qd, 1.0_wp, failure)
        if (.not. allocated(failure)) call test_failed(error, 'the run should have failed')
    end subroutine test_blow_up

    subroutine test_max_step(error)
        type(error_type), allocatable, intent(out) :: error
        type(tilted_skate_type), target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(options_type) :: options
        type(failure_type), allocatable :: failure

        call model%define()
        options = tolerance('dop853', 1.0e-6_wp)
        options%max_step = 0.05_wp
        options%first_step = 0.01_wp
        call run(simulation, model, options, 0.0_wp, [0.0_wp, 0.0_wp], [0.0_wp, 0.0_wp], 10.0_wp, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        statistics = simulation%statistics()
        call check_below(error, statistics%largest_step, 0.05_wp*(1.0_wp + 1.0e-12_wp), 'largest step')
        if (allocated(error)) return
        call check_between(error, statistics%smallest_step, 1.0e-12_wp, 0.01_wp*(1.0_wp + 1.0e-12_wp), 'first step')
    end subroutine test_max_step
end module test_control
