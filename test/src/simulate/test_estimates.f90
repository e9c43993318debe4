! SPDX-License-Identifier: MIT
!> Self-assessment of a run: stiffness, and the local errors of its steps.
module test_estimates
    use asserts, only: check_below, check_between, check_close, check_count, check_no_failure, check_true
    use event_kinds, only: shove_type
    use model_pendulum, only: pendulum_type
    use model_stiff_pendulum, only: stiff_pendulum_type
    use runs, only: get_start, new_scene, run
    use tandem, only: failure_type => error_type, model_type, motorcycle_type, options_type, projections, simulation_type, &
        statistics_type, wp
    use tandem_simulate_local_error, only: local_error_type
    use tandem_simulate_stiffness, only: stiffness_type
    use tandem_stepper_state, only: state_type
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_estimates

    character(len=16), parameter :: pairs(2) = [character(len=16) :: 'dopri5', 'dop853']

contains

    !> The tests of this suite.
    subroutine collect_estimates(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('fifteen-steps-at-the-limit-are-stiff', test_rule), &
            new_unittest('a-stiff-pendulum-is-noticed', test_stiff_pendulum), &
            new_unittest('a-stiff-suspension-is-noticed', test_stiff_suspension), &
            new_unittest('fixed-steps-near-the-limit-are-noticed', test_stiff_rk4), &
            new_unittest('what-is-not-stiff-gives-no-alarm', test_not_stiff), &
            new_unittest('boole-finds-a-known-local-error', test_window), &
            new_unittest('windows-begin-anew-where-steps-differ', test_windows), &
            new_unittest('local-errors-of-fixed-steps-are-the-true-ones', test_local_errors), &
            new_unittest('local-errors-of-controlled-steps-are-the-estimates', test_controlled_errors), &
            new_unittest('a-jump-of-coordinates-is-no-motion', test_jump), &
            new_unittest('a-breakpoint-spoils-no-window', test_breakpoint), &
            new_unittest('an-action-spoils-no-window', test_action), &
            new_unittest('few-steps-give-no-estimate', test_few_steps)]
    end subroutine collect_estimates

    subroutine test_rule(error)
        type(error_type), allocatable, intent(out) :: error
        type(stiffness_type) :: stiffness
        integer :: i

        ! Five other steps in a row are tolerated, six are not.
        do i = 1, 14
            call stiffness%observe(real(i, wp), .true.)
        end do
        do i = 15, 20
            call stiffness%observe(real(i, wp), .false.)
        end do
        do i = 21, 27
            call stiffness%observe(real(i, wp), .true.)
        end do
        do i = 28, 32
            call stiffness%observe(real(i, wp), .false.)
        end do
        do i = 33, 39
            call stiffness%observe(real(i, wp), .true.)
        end do
        call check_true(error, .not. stiffness%is_stiff, 'fourteen are not enough')
        if (allocated(error)) return
        call stiffness%observe(40.0_wp, .true.)
        call check_true(error, stiffness%is_stiff .and. stiffness%steps == 29, 'fifteen are')
        if (allocated(error)) return
        call check_between(error, stiffness%since, 21.0_wp, 21.0_wp, 'the first of the fifteen')
    end subroutine test_rule

    !> Frequency ratio 1e6, damping ratio 0.5: the transient takes microseconds, then 3.4/lambda is the largest step.
    subroutine test_stiff_pendulum(error)
        type(error_type), allocatable, intent(out) :: error
        type(stiff_pendulum_type), target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), parameter :: length = 1.0001_wp
        integer :: i, k

        model%k = 9.81e12_wp
        model%c = sqrt(model%k)
        call model%define()
        do i = 1, size(pairs)
            do k = 4, 6, 2
                options%stepper = pairs(i)
                options%rtol = 10.0_wp**(-k)
                call run(simulation, model, options, 0.0_wp, [length, 0.0_wp, length], [0.0_wp, 0.0_wp, 0.0_wp], 5.0e-4_wp, failure)
                call check_no_failure(error, failure)
                if (allocated(error)) return
                statistics = simulation%statistics()
                call check_true(error, statistics%is_stiff, trim(pairs(i))//': not noticed')
                if (allocated(error)) return
                ! Damping exp(-sqrt(k) t/2) reduces the transient to 1e-4 ... 1e-10 by then; measured: 3e-5 to 8e-5.
                call check_between(error, statistics%stiff_from, 5.0e-6_wp, 2.0e-4_wp, trim(pairs(i))//': since when')
                if (allocated(error)) return
            end do
        end do
    end subroutine test_stiff_pendulum

    !> The motorcycle with k and c times 1000.
    subroutine get_stiff_motorcycle(model, q, qd)
        class(model_type), allocatable, intent(out) :: model
        real(wp), allocatable, intent(out) :: q(:), qd(:)

        call new_scene('motorcycle', model)
        call get_start('motorcycle', q, qd)
        select type (model)
        class is (motorcycle_type)
            model%free_length = model%spring_length()
            model%stiffness = 1000*model%stiffness
            model%damping = 1000*model%damping
        end select
    end subroutine get_stiff_motorcycle

    subroutine test_stiff_suspension(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)
        integer :: i, j

        call get_stiff_motorcycle(model, q, qd)
        do i = 1, size(pairs)
            do j = 1, size(projections)
                options%stepper = pairs(i)
                options%rtol = 1.0e-6_wp
                options%projection = projections(j)
                call run(simulation, model, options, 0.0_wp, q, qd, 0.1_wp, failure)
                call check_no_failure(error, failure)
                if (allocated(error)) return
                statistics = simulation%statistics()
                call check_true(error, statistics%is_stiff, trim(pairs(i))//', '//trim(projections(j))//': not noticed')
                if (allocated(error)) return
                call check_true(error, 2*statistics%stiff_steps > statistics%steps, trim(pairs(i))//', '// &
                    trim(projections(j))//': most steps are at the limit')
                if (allocated(error)) return
            end do
        end do
    end subroutine test_stiff_suspension

    !> The limit is h = 2.79/2.7e4; a tenth of the step is far from it.
    subroutine test_stiff_rk4(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)
        real(wp), parameter :: steps(2) = [1.0e-4_wp, 1.0e-5_wp]
        integer :: i

        call get_stiff_motorcycle(model, q, qd)
        do i = 1, size(steps)
            options%step = steps(i)
            call run(simulation, model, options, 0.0_wp, q, qd, 0.01_wp, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            statistics = simulation%statistics()
            call check_true(error, statistics%is_stiff .eqv. i == 1, 'noticed at the limit and only there')
            if (allocated(error)) return
        end do
    end subroutine test_stiff_rk4

    !> Every tolerance from 1e-4 to 1e-12.
    subroutine test_not_stiff(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=10), parameter :: scenes(3) = [character(len=10) :: 'disk', 'vehicle', 'heavy_top']
        class(model_type), allocatable, target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)
        integer :: i, j, k, scene

        do scene = 1, size(scenes)
            call new_scene(trim(scenes(scene)), model)
            call get_start(trim(scenes(scene)), q, qd)
            do i = 1, size(pairs)
                do k = 4, 12, 2
                    do j = 1, size(projections)
                        options%stepper = pairs(i)
                        options%rtol = 10.0_wp**(-k)
                        options%projection = projections(j)
                        call run(simulation, model, options, 0.0_wp, q, qd, 2.0_wp, failure)
                        call check_no_failure(error, failure)
                        if (allocated(error)) return
                        statistics = simulation%statistics()
                        ! Measured: no step at all.
                        call check_true(error, .not. statistics%is_stiff .and. statistics%stiff_steps < 5, &
                            trim(scenes(scene))//', '//trim(pairs(i))//', '//trim(projections(j))//': false alarm')
                        if (allocated(error)) return
                    end do
                end do
            end do
        end do
    end subroutine test_not_stiff

    !> The state of y = q = t**5 with something added to q, from which the local error follows.
    pure function polynomial(t, added) result(state)
        real(wp), intent(in) :: t, added
        type(state_type) :: state

        call state%allocate(1)
        state%t = t
        state%q(1) = t**5 + added
        state%qd(1) = 5*t**4
        state%qdd(1) = 20*t**3
    end function polynomial

    !> Boole's rule is exact for rates of degree 5: the remainder is the sum of the steps' additions, 1 + 2 + 3 + 4 thousandths.
    subroutine test_window(error)
        type(error_type), allocatable, intent(out) :: error
        type(local_error_type) :: local
        logical :: is_complete
        integer :: i

        call local%initialize([1.0_wp], 1.0_wp, has_estimates=.false.)
        do i = 0, 3
            call local%extend(polynomial(1.0_wp + 0.25_wp*i, 5.0e-4_wp*i*(i + 1)), &
                polynomial(1.25_wp + 0.25_wp*i, 5.0e-4_wp*(i + 1)*(i + 2)), is_complete)
            call check_true(error, is_complete .eqv. i == 3, 'a window has four steps')
            if (allocated(error)) return
        end do
        ! Rounding of values up to 32.
        call check_close(error, [local%error_q, local%error_qd], [1.0e-2_wp, 0.0_wp], 1.0e-13_wp, 'sum of the errors')
        if (allocated(error)) return
        call local%add(1.0e-2_wp, 4)
        call check_close(error, [local%largest, local%total], [2.5e-3_wp, 1.0e-2_wp], 1.0e-16_wp, 'largest and sum')
    end subroutine test_window

    !> Two steps, then one of another size, one that does not continue, and two more: the complete window then begins with the one
    !> that does not continue.
    subroutine test_windows(error)
        type(error_type), allocatable, intent(out) :: error
        type(local_error_type) :: local
        real(wp), parameter :: from(8) = [0.0_wp, 0.5_wp, 1.0_wp, 2.0_wp, 2.5_wp, 3.0_wp, 3.5_wp, 4.0_wp]
        real(wp), parameter :: to(8) = [0.5_wp, 1.0_wp, 1.25_wp, 2.5_wp, 3.0_wp, 3.5_wp, 4.0_wp, 4.5_wp]
        logical :: is_complete
        integer :: i

        call local%initialize([1.0_wp], 1.0_wp, has_estimates=.false.)
        do i = 1, 8
            call local%extend(polynomial(from(i), 0.0_wp), polynomial(to(i), 0.0_wp), is_complete)
            call check_true(error, is_complete .eqv. i == 7, 'which step completes a window')
            if (allocated(error)) return
            ! Rounding of values up to 1e3.
            if (i == 7) call check_below(error, maxval(abs([local%error_q, local%error_qd])), 1.0e-12_wp, 'an error of nothing')
            if (allocated(error)) return
        end do
        call local%restart()
        do i = 5, 8
            call local%extend(polynomial(from(i), 0.0_wp), polynomial(to(i), 0.0_wp), is_complete)
            call check_true(error, is_complete .eqv. i == 8, 'four steps after a restart')
            if (allocated(error)) return
        end do
    end subroutine test_windows

    !> Sum over windows of the true local errors: each step against dop853 at 1e-14 from the same state.
    subroutine check_local_errors(error, scene, stepper, step, low, high)
        type(error_type), allocatable, intent(out) :: error
        character(len=*), intent(in) :: scene, stepper
        real(wp), intent(in) :: step, low, high
        class(model_type), allocatable, target :: model, exact_model
        type(simulation_type) :: simulation, exact
        type(statistics_type) :: statistics
        type(options_type) :: options, tight
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:), error_q(:), error_qd(:)
        real(wp) :: t, total
        integer :: i, k

        call new_scene(scene, model)
        call new_scene(scene, exact_model)
        call get_start(scene, q, qd)
        options%stepper = stepper
        options%step = step
        tight%stepper = 'dop853'
        tight%rtol = 1.0e-14_wp
        call simulation%initialize(model, options, 0.0_wp, q, qd, failure)
        total = 0.0_wp
        do k = 1, 10
            error_q = spread(0.0_wp, 1, size(q))
            error_qd = error_q
            do i = 1, 4
                t = simulation%state%t
                q = simulation%state%q
                qd = simulation%state%qd
                if (.not. allocated(failure)) call simulation%step(huge(1.0_wp), failure)
                if (.not. allocated(failure)) call run(exact, exact_model, tight, t, q, qd, simulation%state%t, failure)
                call check_no_failure(error, failure)
                if (allocated(error)) return
                error_q = error_q + (simulation%state%q - exact%state%q)
                error_qd = error_qd + (simulation%state%qd - exact%state%qd)
            end do
            total = total + sqrt((sum((error_q/(1 + abs(simulation%state%q)))**2) + &
                sum((error_qd/(1 + abs(simulation%state%qd)))**2))/(2*size(q)))
        end do
        statistics = simulation%statistics()
        call check_count(error, statistics%local_error_steps, 40, 'steps behind the estimate')
        if (allocated(error)) return
        call check_between(error, statistics%local_error_sum/total, low, high, scene//', '//stepper//': estimated over true')
    end subroutine check_local_errors

    !> Steps whose errors are well above rounding. The remainder is of order h; measured over four times as many windows: 0.99 to
    !> 1.02.
    subroutine test_local_errors(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=10), parameter :: scenes(3) = [character(len=10) :: 'knife_edge', 'disk', 'vehicle']
        character(len=9), parameter :: methods(3) = [character(len=9) :: 'rk4', 'trapezoid', 'sdirk54']
        integer :: i, k

        do i = 1, size(scenes)
            do k = 1, size(methods)
                call check_local_errors(error, trim(scenes(i)), trim(methods(k)), 1.0e-2_wp, 0.95_wp, 1.05_wp)
                if (allocated(error)) return
            end do
        end do
        ! The rest of Boole's rule is not small against the error of a method of order 5.
        call check_local_errors(error, 'heavy_top', 'dopri5', 1.0e-2_wp, 0.5_wp, 2.0_wp)
        if (allocated(error)) return
        ! Its own estimate, which errs to the safe side.
        call check_local_errors(error, 'heavy_top', 'dop853', 1.0e-2_wp, 1.0_wp, 10.0_wp)
    end subroutine test_local_errors

    !> At most the tolerance per step, with one tolerance for everything or several.
    subroutine test_controlled_errors(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: one, several
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)

        call new_scene('knife_edge', model)
        call get_start('knife_edge', q, qd)
        options%stepper = 'sdirk54'
        options%rtol = 1.0e-6_wp
        call run(simulation, model, options, 0.0_wp, q, qd, 5.0_wp, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        one = simulation%statistics()
        call check_count(error, one%local_error_steps, int(one%steps), 'every step has an estimate')
        if (allocated(error)) return
        call check_between(error, one%local_error, 0.3e-6_wp, 1.0e-6_wp, 'largest')
        if (allocated(error)) return
        ! The same tolerances in another form: the errors are measured again, on s + |y| at the end of a step.
        options%rtol_q = spread(1.0e-6_wp, 1, 3)
        call run(simulation, model, options, 0.0_wp, q, qd, 5.0_wp, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        several = simulation%statistics()
        call check_between(error, several%local_error_sum/one%local_error_sum, 0.9_wp, 1.1_wp, 'sum measured anew')
    end subroutine test_controlled_errors

    !> Free fall from rest over 100 m in one step is a motion, a turn by 80 rad in a step of 0.2 ms is none.
    subroutine test_jump(error)
        type(error_type), allocatable, intent(out) :: error
        type(local_error_type) :: local
        type(state_type) :: start, arrived

        call start%allocate(2)
        call arrived%allocate(2)
        call local%initialize([1.0_wp, 2.0_wp], 1.0_wp, .true.)
        start%q(:) = [0.0_wp, 500.0_wp]
        start%qd(:) = [3.0_wp, 0.0_wp]
        arrived%t = 4.5_wp
        arrived%qd(:) = start%qd - [0.0_wp, 9.81_wp*arrived%t]
        arrived%q(:) = start%q + arrived%t*(start%qd + arrived%qd)/2
        call check_true(error, .not. local%has_jumped(start, arrived), 'free fall')
        if (allocated(error)) return
        arrived%t = 2.0e-4_wp
        arrived%qd(:) = start%qd
        arrived%q(:) = [80.0_wp, 500.0_wp]
        call check_true(error, local%has_jumped(start, arrived), 'a jump')
    end subroutine test_jump

    !> Within 4 s before and after the vehicle's kink at 2 pi the errors are of the same size; a window across it would show the
    !> jump of the steering's acceleration, h**2 times 0.017.
    subroutine test_breakpoint(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: before, after
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)

        call new_scene('vehicle', model)
        call get_start('vehicle', q, qd)
        options%step = 1.0e-2_wp
        call run(simulation, model, options, 0.0_wp, q, qd, 6.0_wp, failure)
        before = simulation%statistics()
        if (.not. allocated(failure)) call simulation%integrate(8.0_wp, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        after = simulation%statistics()
        call check_true(error, after%local_error_steps > before%local_error_steps + 190, 'windows go on behind it')
        if (allocated(error)) return
        call check_below(error, after%local_error, before%local_error, 'largest error behind the kink')
    end subroutine test_breakpoint

    !> A push at the end of the second step of a window. A window across it would show the jump of 0.1, from which the true errors
    !> of some 1e-8 are far.
    subroutine test_action(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(shove_type), target :: push
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)

        call model%define()
        call model%start(0.0_wp, 1.0_wp, q, qd)
        options%step = 2.0_wp**(-6)
        push%at = 6*options%step
        push%changes = .true.
        push%dqd = [0.1_wp, 0.0_wp]
        call simulation%initialize(model, options, 0.0_wp, q, qd, failure)
        call simulation%add_event(push)
        ! A zero at the end of a run counts there, else the next step would begin again.
        if (.not. allocated(failure)) call simulation%integrate(push%at, failure)
        if (.not. allocated(failure)) call simulation%integrate(32*options%step, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        statistics = simulation%statistics()
        call check_true(error, simulation%n_events == 1 .and. statistics%steps == 32, 'the push ends a step of the grid')
        if (allocated(error)) return
        ! The interrupted window lacks two steps, and so does the last one.
        call check_count(error, statistics%local_error_steps, 28, 'steps in windows')
        call check_below(error, statistics%local_error, 1.0e-6_wp, 'largest local error')
    end subroutine test_action

    subroutine test_few_steps(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)

        call new_scene('knife_edge', model)
        call get_start('knife_edge', q, qd)
        options%step = 1.0e-2_wp
        call run(simulation, model, options, 0.0_wp, q, qd, 0.035_wp, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        statistics = simulation%statistics()
        ! Three steps, and an interrupted one.
        call check_true(error, statistics%steps == 4 .and. statistics%local_error_steps == 0, 'no window is complete')
        if (allocated(error)) return
        ! The start, four stages per step; the first stage is the end of the previous step.
        call check_true(error, statistics%right_hand_sides >= 16, 'its work is counted nevertheless')
    end subroutine test_few_steps
end module test_estimates
