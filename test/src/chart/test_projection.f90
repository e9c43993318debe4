! SPDX-License-Identifier: MIT
!> Tests of explicit steps that are projected at their ends only: their order, remaining constraint errors, and savings.
!>
!> (The suite `checkpoint` tests checkpoints of them, `estimates` the detection of stiffness.)
module test_projection
    use asserts, only: check_below, check_between, check_close, check_count, check_failure, check_no_failure, check_true
    use model_knife_edge, only: knife_edge_type
    use reference, only: read_reference, reference_type
    use runs, only: choose, get_start, new_scene, run, run_to
    use tandem, only: chart_policies, failure_type => error_type, model_type, options_type, projections, refresh_modes, &
        simulation_type, statistics_type, stepper_names, threshold_event_type, wp
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_projection

    character(len=16), parameter :: explicit(3) = [character(len=16) :: 'rk4', 'dopri5', 'dop853']
    !> The holonomic model, the one with both kinds of constraints, and the one whose rows depend on time.
    character(len=16), parameter :: scenes(3) = [character(len=16) :: 'vehicle', 'disk', 'motorcycle']

contains

    !> The suite.
    subroutine collect_projection(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('projection-at-ends-keeps-the-order', test_order), &
            new_unittest('projection-at-ends-has-errors-not-far-from-those-of-stages', test_errors), &
            new_unittest('projection-at-ends-is-another-method', test_other), &
            new_unittest('projection-at-ends-is-the-default-under-error-control', test_default), &
            new_unittest('ends-of-steps-hold-the-constraints', test_ends), &
            new_unittest('dense-output-holds-the-constraints-and-leaves-no-trace', test_dense), &
            new_unittest('events-are-where-they-are-in-closed-form', test_events), &
            new_unittest('phi-is-evaluated-less-often', test_counts), &
            new_unittest('implicit-steppers-refuse-it', test_implicit)]
    end subroutine collect_projection

    !> Options of steps that are projected at their ends.
    function at_ends(stepper) result(options)
        character(len=*), intent(in) :: stepper
        type(options_type) :: options

        options%stepper = stepper
        options%projection = 'step_ends'
    end function at_ends

    !> The order between steps and half of them must lie in a range, the first error below a bound, against the reference.
    subroutine check_order(scene, stepper, t, steps, low, high, bound, error)
        character(len=*), intent(in) :: scene, stepper
        real(wp), intent(in) :: t, steps(:), low, high, bound
        type(error_type), allocatable, intent(inout) :: error
        type(options_type) :: options
        type(reference_type) :: table
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: state(:, :)
        real(wp) :: errors(size(steps))
        integer :: i

        if (allocated(error)) return
        call read_reference(scene, table)
        options = at_ends(stepper)
        do i = 1, size(steps)
            options%step = steps(i)
            call run_to(scene, options, t, state, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            errors(i) = maxval(abs(state(:, 1) - table%q_at(t)))
        end do
        call check_below(error, errors(1), bound, scene//', '//stepper//': error with the largest step')
        do i = 2, size(steps)
            call check_between(error, log(errors(i - 1)/errors(i))/log(2.0_wp), low, high, scene//', '//stepper//': order')
        end do
    end subroutine check_order

    !> With large steps the vehicle shows more than the order of dopri5 and dop853, with projected stages too: its errors of that
    !> order are small. Bounds are twice the measured values.
    subroutine test_order(error)
        type(error_type), allocatable, intent(out) :: error

        call check_order('vehicle', 'rk4', 6.0_wp, [0.05_wp, 0.025_wp, 0.0125_wp], 3.85_wp, 4.15_wp, 6.6e-8_wp, error)
        call check_order('vehicle', 'dopri5', 6.0_wp, [0.2_wp, 0.1_wp, 0.05_wp], 4.85_wp, 6.5_wp, 1.2e-7_wp, error)
        call check_order('vehicle', 'dop853', 6.0_wp, [1.0_wp, 0.5_wp, 0.25_wp], 7.5_wp, 8.5_wp, 2.0e-7_wp, error)
        call check_order('disk', 'rk4', 2.0_wp, [1.6e-2_wp, 8.0e-3_wp, 4.0e-3_wp], 3.85_wp, 4.15_wp, 8.0e-8_wp, error)
        call check_order('disk', 'dopri5', 2.0_wp, [6.4e-2_wp, 3.2e-2_wp, 1.6e-2_wp], 4.65_wp, 5.15_wp, 9.0e-8_wp, error)
        call check_order('disk', 'dop853', 2.0_wp, [0.2_wp, 0.1_wp], 7.2_wp, 8.2_wp, 3.2e-10_wp, error)
    end subroutine test_order

    !> Position of the disk after 10 s and two dips, which amplify errors by 1e4: at most five times the error of steps with
    !> projected stages, in the geometric mean of five tolerances (measured: 1.5 and 3.8; 1.07 and 1.49 before these preserved the
    !> momentum, with errors of 2.1e-4 and 1.4e-5 for now 1.4e-4 and 4.5e-6). A single run is not significant: its error is an
    !> amplified sum of errors of either sign, and ratios of single runs are between 0.03 and 11. With looser tolerances both errors
    !> are as large as the motion.
    subroutine test_errors(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options
        type(reference_type) :: table
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: state(:, :), truth(:)
        real(wp) :: found(2), logarithms, of_stages
        integer :: i, k, j

        call read_reference('disk', table)
        truth = table%q_at(10.0_wp)
        do i = 2, size(explicit)
            logarithms = 0.0_wp
            of_stages = 0.0_wp
            do k = 6, 10
                do j = 1, 2
                    options = options_type(stepper=explicit(i), rtol=10.0_wp**(-k), projection=projections(j + 1))
                    call run_to('disk', options, 10.0_wp, state, failure)
                    call check_no_failure(error, failure)
                    if (allocated(error)) return
                    found(j) = maxval(abs(state(:3, 1) - truth(:3)))
                end do
                logarithms = logarithms + log(found(2)/found(1))
                of_stages = of_stages + log(found(1))
            end do
            call check_below(error, exp(logarithms/5), 5.0_wp, trim(explicit(i))//': error over that with stages projected')
            call check_below(error, exp(of_stages/5), merge(2.0e-4_wp, 1.0e-5_wp, i == 2), trim(explicit(i))// &
                ': error with stages projected')
            if (allocated(error)) return
        end do
    end subroutine test_errors

    !> Otherwise the option would have no effect.
    subroutine test_other(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: stages(:, :), ends(:, :)
        integer :: i

        do i = 1, size(explicit)
            options = at_ends(explicit(i))
            options%step = 0.01_wp
            call run_to('disk', options, 0.1_wp, ends, failure)
            call check_no_failure(error, failure)
            options%projection = 'stages'
            call run_to('disk', options, 0.1_wp, stages, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call check_true(error, any(abs(stages - ends) > 0.0_wp), trim(explicit(i))//': the same motion bit by bit')
        end do
    end subroutine test_other

    !> All three levels, also with large steps, for every policy and computation of the inverses: a hundredth of the tolerance of
    !> 1e-12, as with projected stages; with the paper's refinement as given by its tolerances.
    subroutine test_ends(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)
        real(wp) :: largest
        integer :: i, j, k, scene

        do scene = 1, size(scenes)
            call new_scene(trim(scenes(scene)), model)
            call get_start(trim(scenes(scene)), q, qd)
            do i = 1, size(explicit)
                do j = 1, size(chart_policies)
                    do k = 1, size(refresh_modes)
                        options = at_ends(explicit(i))
                        options%step = 0.02_wp
                        options%chart = chart_policies(j)
                        options%refresh = refresh_modes(k)
                        if (chart_policies(j) == 'paper') options%v_limit = 0.5_wp
                        call run(simulation, model, options, 0.0_wp, q, qd, 4.0_wp, failure)
                        call check_no_failure(error, failure)
                        if (allocated(error)) return
                        statistics = simulation%statistics()
                        largest = max(statistics%position_error, statistics%velocity_error, statistics%acceleration_error)
                        call check_below(error, largest, merge(2.0e-14_wp, 1.0e-12_wp, k == 1), trim(scenes(scene))//', '// &
                            trim(explicit(i))//', '//trim(options%chart)//', '//options%refresh//': constraint error')
                        if (allocated(error)) return
                    end do
                end do
            end do
        end do
    end subroutine test_ends

    !> Rows between steps, also from dop853's additional stages; the run with dense output ends bitwise like the run without it.
    subroutine test_dense(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:), state(:, :)
        integer :: i, k

        call new_scene('disk', model)
        call get_start('disk', q, qd)
        do i = 1, size(explicit)
            options = at_ends(explicit(i))
            options%step = 0.04_wp
            call run_to('disk', options, 2.0_wp, state, failure)
            call check_no_failure(error, failure)
            call simulation%initialize(model, options, 0.0_wp, q, qd, failure)
            do while (.not. allocated(failure) .and. simulation%state%t < 2.0_wp)
                call simulation%step(2.0_wp, failure)
                do k = 1, 3
                    if (allocated(failure)) exit
                    call simulation%look_at(simulation%state%t - 0.01_wp*k, failure)
                    call check_below(error, maxval(simulation%errors), 1.0e-12_wp, trim(explicit(i))//': constraint error')
                    call simulation%look_back()
                end do
                if (allocated(error)) return
            end do
            call check_no_failure(error, failure)
            call check_close(error, simulation%state%q, state(:, 1), 0.0_wp, trim(explicit(i))//': q with looks')
            if (allocated(error)) return
        end do
    end subroutine test_dense

    !> The knife edge, whose motion has a closed form: the state when its angle reaches 0.9, and its constraint error.
    subroutine test_events(error)
        type(error_type), allocatable, intent(out) :: error
        type(knife_edge_type), target :: model
        type(threshold_event_type), target :: event
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        ! The global errors with h = 0.02, as in the suite `events`.
        real(wp), parameter :: bound(3) = [1.0e-6_wp, 1.0e-8_wp, 1.0e-11_wp]
        real(wp) :: q(3), qd(3), qdd(3), lambda(1), exact(3)
        integer :: i

        call model%define()
        event = threshold_event_type(name='phi', quantity='q', index=3, value=0.9_wp)
        do i = 1, size(explicit)
            options = at_ends(explicit(i))
            options%step = 0.02_wp
            call model%solution(0.0_wp, q, qd, qdd, lambda)
            call simulation%initialize(model, options, 0.0_wp, q, qd, failure)
            call simulation%add_event(event)
            if (.not. allocated(failure)) call simulation%integrate(1.5_wp, failure)
            call check_no_failure(error, failure)
            call check_count(error, simulation%n_events, 1, trim(explicit(i))//': events')
            if (allocated(error)) return
            associate (found => simulation%events(1))
                call check_below(error, abs(found%q(3) - 0.9_wp), 1.0e-12_wp, trim(explicit(i))//': the angle there')
                call model%solution(found%t, exact, qd, qdd, lambda)
                call check_close(error, found%q, exact, bound(i), trim(explicit(i))//': place')
                ! The skate does not move sideways.
                call check_below(error, abs(sin(found%q(3))*found%qd(1) - cos(found%q(3))*found%qd(2)), 1.0e-12_wp, &
                    trim(explicit(i))//': velocity across the edge')
            end associate
            if (allocated(error)) return
        end do
    end subroutine test_events

    !> As many evaluations of the equations of motion, and at most half as many of Phi: only the end of a step evaluates it, at most
    !> three times if no chart is far from its origin.
    subroutine test_counts(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics(2)
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)
        integer :: i, j

        call new_scene('disk', model)
        call get_start('disk', q, qd)
        do i = 1, size(explicit)
            do j = 1, 2
                options = choose(step=0.01_wp, stepper=trim(explicit(i)))
                options%projection = projections(j + 1)
                call run(simulation, model, options, 0.0_wp, q, qd, 2.0_wp, failure)
                call check_no_failure(error, failure)
                if (allocated(error)) return
                statistics(j) = simulation%statistics()
            end do
            call check_true(error, statistics(1)%right_hand_sides == statistics(2)%right_hand_sides, trim(explicit(i))// &
                ': as many right-hand sides')
            call check_true(error, 2*statistics(2)%terms(1) <= statistics(1)%terms(1), trim(explicit(i))//': half of Phi')
            call check_true(error, statistics(2)%terms(1) <= 3*statistics(2)%steps + 2, trim(explicit(i))//': Phi at ends alone')
            if (allocated(error)) return
        end do
    end subroutine test_counts

    !> Only ends under error control, every stage with fixed steps and on charts that are kept or refined.
    subroutine test_default(error)
        type(error_type), allocatable, intent(out) :: error
        !> Expected choice of each: number in `projections`.
        integer, parameter :: expected(4) = [3, 2, 2, 2]
        type(options_type) :: options(4)
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: found(:, :), state(:, :), other(:, :)
        integer :: i

        options(1) = options_type(stepper='dop853', rtol=1.0e-6_wp)
        options(2) = options_type(stepper='dop853', step=0.01_wp)
        options(3) = options_type(stepper='dop853', rtol=1.0e-6_wp, chart='adaptive')
        options(4) = options_type(stepper='dop853', rtol=1.0e-6_wp, refresh='refine')
        do i = 1, size(options)
            call run_to('disk', options(i), 0.5_wp, found, failure)
            call check_no_failure(error, failure)
            options(i)%projection = projections(expected(i))
            if (.not. allocated(error)) call run_to('disk', options(i), 0.5_wp, state, failure)
            call check_no_failure(error, failure)
            options(i)%projection = projections(5 - expected(i))
            if (.not. allocated(error)) call run_to('disk', options(i), 0.5_wp, other, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call check_true(error, all(abs(found - state) <= 0.0_wp), 'the default is '//projections(expected(i)))
            call check_true(error, any(abs(found - other) > 0.0_wp), 'the default is not '//projections(5 - expected(i)))
            if (allocated(error)) return
        end do
    end subroutine test_default

    subroutine test_implicit(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)
        integer :: i

        call new_scene('disk', model)
        call get_start('disk', q, qd)
        do i = 1, size(stepper_names)
            call simulation%initialize(model, at_ends(stepper_names(i)), 0.0_wp, q, qd, failure)
            if (any(stepper_names(i) == explicit)) then
                call check_no_failure(error, failure)
            else
                call check_failure(error, failure, 'invalid_option', 'projection = "step_ends"')
            end if
            if (allocated(error)) return
        end do
    end subroutine test_implicit
end module test_projection
