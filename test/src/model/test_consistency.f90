! SPDX-License-Identifier: MIT
!> Contradictory procedures of a model are reported in a run, by every stepper and with bounded work; correct models are not.
module test_consistency
    use asserts, only: check_count, check_no_failure, check_text, check_true
    use consistency_checks, only: check_clean, check_named, looker_type
    use model_altered, only: altered_type
    use model_beads, only: beads_type
    use model_belt_wheel, only: belt_wheel_type
    use model_bricard, only: bricard_type
    use model_four_bar, only: crank_rocker, four_bar_type
    use model_moving_pivot, only: moving_pivot_type
    use model_pendulum, only: pendulum_type
    use model_sleigh, only: sleigh_type
    use runs, only: get_start, new_scene, run, scene_names
    use subjects, only: new_subject, subject_names
    use tandem, only: change_stepper, chart_policies, failure_type => error_type, find_error_warnings, global_error_type, &
        model_type, new_stepper, options_type, properties_type, simulation_type, statistics_type, stepper_names, warning_type, &
        wp
    use tandem_io, only: read_scene, scene_type
    use tandem_io_study_cases, only: build_case, case_groups, case_names, case_type
    use tandem_model_consistency, only: contradiction_length, find_contradiction
    use tandem_stepper, only: stepper_type
    use tandem_model_counts, only: counts_type
    use testdrive, only: error_type, new_unittest, test_failed, unittest_type
    implicit none (type, external)
    private

    public :: collect_consistency

contains

    !> The suite.
    subroutine collect_consistency(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('a-wrong-gamma-is-named-with-every-stepper', test_gamma), &
            new_unittest('a-wrong-gamma-of-andrews-squeezer-is-named', test_squeezer), &
            new_unittest('a-wrong-gamma-ends-in-bounded-work', test_endless), &
            new_unittest('a-wrong-gamma-of-a-nonholonomic-row-is-named', test_nonholonomic), &
            new_unittest('a-wrong-jacobian-is-named', test_jacobian), &
            new_unittest('a-jacobian-with-which-no-step-is-possible-is-named', test_no_step), &
            new_unittest('a-wrong-nu-is-named', test_nu), &
            new_unittest('warnings-tell-first-what-they-come-from', test_first), &
            new_unittest('scenes-and-models-do-not-contradict-themselves', test_models), &
            new_unittest('stiff-and-extreme-cases-do-not-contradict-themselves', test_cases), &
            new_unittest('units-late-times-and-speeds-make-no-contradiction', test_extremes), &
            new_unittest('noise-of-the-constraints-is-no-contradiction', test_noise), &
            new_unittest('kinks-and-jumps-are-no-contradiction', test_kinks), &
            new_unittest('no-place-without-a-value-is-asked-for', test_domain), &
            new_unittest('models-with-a-pattern-and-single-procedures-are-not-named', test_pattern)]
    end subroutine collect_consistency

    !> Half of it, twice, with its sign changed, or zero: fixed steps and error control, each stepper.
    subroutine test_gamma(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: pendulum
        type(altered_type), target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(properties_type) :: properties
        class(stepper_type), allocatable :: stepper
        type(failure_type), allocatable :: failure
        real(wp), parameter :: factors(4) = [0.5_wp, 2.0_wp, -1.0_wp, 0.0_wp]
        real(wp) :: q(2), qd(2)
        integer :: i, j, k

        call pendulum%define()
        call pendulum%start(1.0_wp, 2.0_wp, q, qd)
        do i = 1, size(stepper_names)
            call new_stepper(stepper_names(i), stepper)
            properties = stepper%properties()
            do j = 1, size(factors)
                do k = 1, 2
                    if (k == 2 .and. properties%estimate_order == 0) cycle
                    options = options_type(stepper=stepper_names(i), step=1.0e-3_wp)
                    if (k == 2) call change_stepper(options, options%stepper, rtol=1.0e-6_wp)
                    call model%wrap(pendulum)
                    model%of_gamma = factors(j)
                    call run(simulation, model, options, 0.0_wp, q, qd, 1.0e-2_wp, failure)
                    call check_named(error, simulation, failure, 'gamma of the constraint "rod" is ')
                    if (allocated(error)) return
                end do
            end do
        end do
    end subroutine test_gamma

    !> A pendulum with dopri5 would take years, a crank-rocker ten thousand times as many steps as necessary.
    subroutine test_endless(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: pendulum
        type(four_bar_type), target :: four_bar
        type(altered_type), target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2), q9(9), qd9(9)

        call pendulum%define()
        call pendulum%start(1.0_wp, 2.0_wp, q, qd)
        call model%wrap(pendulum)
        model%of_gamma = 0.5_wp
        options = options_type(stepper='dopri5', rtol=1.0e-9_wp)
        call run(simulation, model, options, 0.0_wp, q, qd, 100.0_wp, failure)
        call check_named(error, simulation, failure, 'gamma of the constraint "rod" is ')
        call check_true(error, allocated(failure), 'the run ends')
        statistics = simulation%statistics()
        call check_true(error, statistics%steps <= 100000, 'in bounded work')
        if (allocated(error)) return
        four_bar%length = crank_rocker
        call four_bar%define()
        call four_bar%start(1.0_wp, 3.0_wp, q9, qd9)
        call model%wrap(four_bar)
        model%row = 5
        model%of_gamma = -1.0_wp
        options = options_type(stepper='dop853', rtol=1.0e-6_wp)
        call run(simulation, model, options, 0.0_wp, q9, qd9, 0.01_wp, failure)
        call check_named(error, simulation, failure, 'gamma of the constraint "joint C x" is ')
    end subroutine test_endless

    !> Each row of Andrews' squeezer, halved and with its sign changed. The run needs 48 steps, and would continue for half a
    !> million.
    subroutine test_squeezer(error)
        type(error_type), allocatable, intent(out) :: error
        type(scene_type), target :: scene
        type(altered_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp), parameter :: factors(2) = [0.5_wp, -1.0_wp]
        integer :: i, row

        call read_scene('scenes/a03_andrews.toml', [character(len=1) ::], scene, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        do row = 1, scene%model%n_holonomic
            do i = 1, size(factors)
                call model%wrap(scene%model)
                model%row = row
                model%of_gamma = factors(i)
                call run(simulation, model, options_type(stepper='dop853', rtol=1.0e-6_wp, max_steps=300), 0.0_wp, scene%q, &
                    scene%qd, 0.05_wp, failure)
                call check_named(error, simulation, failure, 'gamma of the constraint "'//model%row_name(row)//'" is ')
                if (allocated(error)) return
            end do
        end do
    end subroutine test_squeezer

    !> Of the knife edge, and of the skater's blade.
    subroutine test_nonholonomic(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: inner
        type(altered_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)
        integer :: i

        do i = 1, 2
            if (i == 1) then
                call new_scene('knife_edge', inner)
                call get_start('knife_edge', q, qd)
            else
                call new_subject('skater', inner, q, qd)
            end if
            call model%wrap(inner)
            model%row = inner%n_constraints()
            model%of_gamma = 0.9_wp
            call run(simulation, model, options_type(step=1.0e-3_wp), 0.0_wp, q, qd, 0.05_wp, failure)
            call check_named(error, simulation, failure, 'gamma of the constraint "'//model%row_name(model%row)//'" is ')
            if (allocated(error)) return
            deallocate (inner)
        end do
    end subroutine test_nonholonomic

    !> One entry of the Jacobian.
    subroutine test_jacobian(error)
        type(error_type), allocatable, intent(out) :: error
        type(four_bar_type), target :: four_bar
        type(altered_type), target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: q(9), qd(9)
        integer :: i

        four_bar%length = crank_rocker
        call four_bar%define()
        call four_bar%start(1.0_wp, 3.0_wp, q, qd)
        do i = 1, 2
            call model%wrap(four_bar)
            model%row = 3
            model%column = 3
            model%of_jacobian = 1.2_wp
            options = options_type(stepper='dop853', step=1.0e-3_wp, start_tolerance=1.0e-2_wp)
            if (i == 2) call change_stepper(options, options%stepper, rtol=1.0e-6_wp)
            ! The start satisfies the existing rows.
            qd = 0.0_wp
            call run(simulation, model, options, 0.0_wp, q, qd, 0.1_wp, failure)
            call check_named(error, simulation, failure, 'the Jacobian of the constraint "joint B x" gives ')
            if (allocated(error)) return
        end do
    end subroutine test_jacobian

    !> A row of the Jacobian with a changed sign: the iteration for the position cannot converge.
    subroutine test_no_step(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: pendulum
        type(altered_type), target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)
        integer :: i

        call pendulum%define()
        call pendulum%start(1.0_wp, 0.0_wp, q, qd)
        ! Along the rod according to the wrong row.
        qd = 2.0_wp*[q(2), q(1)]
        do i = 1, 2
            call model%wrap(pendulum)
            model%of_jacobian = -1.0_wp
            options = options_type(stepper='dopri5', step=0.2_wp)
            if (i == 2) call change_stepper(options, options%stepper, rtol=1.0e-6_wp)
            call run(simulation, model, options, 0.0_wp, q, qd, 1.0_wp, failure)
            call check_named(error, simulation, failure, 'the Jacobian of the constraint "rod" gives ')
            if (allocated(error)) return
        end do
    end subroutine test_no_step

    subroutine test_nu(error)
        type(error_type), allocatable, intent(out) :: error
        type(moving_pivot_type), target :: pivot
        type(altered_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)

        call pivot%define()
        call pivot%motion(0.0_wp, 1.0_wp, 2.0_wp, q, qd)
        call model%wrap(pivot)
        model%of_nu = 0.5_wp
        ! The velocity required by the wrong row.
        qd(1) = qd(1) - 0.5_wp*pivot%speed
        call run(simulation, model, options_type(step=1.0e-3_wp), 0.0_wp, q, qd, 0.1_wp, failure)
        call check_named(error, simulation, failure, 'nu of the constraint "holonomic 1" gives ')
    end subroutine test_nu

    !> And no warning about amplified errors or a useful breakpoint.
    subroutine test_first(error)
        type(error_type), allocatable, intent(out) :: error
        type(statistics_type) :: statistics
        type(global_error_type) :: global_error
        type(warning_type), allocatable :: doubts(:)
        integer :: i

        statistics%velocity_gap = 1.0_wp
        statistics%local_error_sum = 1.0e-6_wp
        statistics%local_error_steps = 100
        global_error%is_known = .true.
        global_error%n = 2
        global_error%largest = 1.0_wp
        allocate (doubts(0))
        call find_error_warnings(options_type(rtol=1.0e-6_wp), statistics, doubts, global_error)
        call check_count(error, size(doubts), 2, 'doubts')
        if (allocated(error)) return
        do i = 1, 2
            call check_text(error, doubts(i)%text, 'whether a procedure of the model is wrong (tandem check, verify_model)')
            if (allocated(error)) return
        end do
        call check_text(error, doubts(1)%text, 'a breakpoint')
        if (.not. allocated(error)) call check_text(error, doubts(2)%text, 'amplifies')
        if (allocated(error)) return
        statistics%contradiction = 'the model contradicts itself: everywhere'
        call find_error_warnings(options_type(rtol=1.0e-6_wp), statistics, doubts, global_error)
        call check_count(error, size(doubts), 3, 'doubts about a wrong model')
        if (.not. allocated(error)) call check_text(error, doubts(1)%text, 'everywhere')
        do i = 2, 3
            if (allocated(error)) return
            call check_text(error, doubts(i)%text, 'since the model contradicts itself')
            call check_true(error, index(doubts(i)%text, 'breakpoint') + index(doubts(i)%text, 'amplifies') == 0, &
                'no other cause is told')
        end do
    end subroutine test_first

    !> Run with every stepper and chart, with a check after every step, ahead and behind.
    subroutine check_model(error, model, q, qd, t, span)
        type(error_type), allocatable, intent(inout) :: error
        class(model_type), intent(inout), target :: model
        real(wp), intent(in) :: q(:), qd(:), t, span
        type(simulation_type) :: simulation
        type(looker_type) :: looker
        type(options_type) :: options
        type(properties_type) :: properties
        class(stepper_type), allocatable :: stepper
        type(failure_type), allocatable :: failure
        integer :: i, j

        do i = 1, size(stepper_names)
            call new_stepper(stepper_names(i), stepper)
            properties = stepper%properties()
            do j = 1, 3
                if (j > 1 .and. properties%estimate_order == 0) cycle
                options = options_type(stepper=stepper_names(i), step=span/100.0_wp, max_steps=400, &
                    chart=chart_policies(1 + mod(i, 2)))
                if (j == 2) call change_stepper(options, options%stepper, rtol=1.0e-3_wp)
                if (j == 3) call change_stepper(options, options%stepper, rtol=1.0e-8_wp)
                looker = looker_type()
                call run(simulation, model, options, t, q, qd, t + span, failure, looker)
                call check_clean(error, simulation, looker, trim(model%name)//', '//trim(stepper_names(i)))
                if (allocated(error)) return
            end do
        end do
    end subroutine check_model

    subroutine test_models(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: model
        type(four_bar_type), target :: four_bar
        type(belt_wheel_type), target :: belt
        type(moving_pivot_type), target :: pivot
        type(bricard_type), target :: bricard
        real(wp), allocatable :: q(:), qd(:), qdd(:), lambda(:)
        integer :: i

        do i = 1, size(scene_names)
            call new_scene(trim(scene_names(i)), model)
            call get_start(trim(scene_names(i)), q, qd)
            call check_model(error, model, q, qd, 0.0_wp, 1.0_wp)
            if (allocated(error)) return
        end do
        do i = 1, size(subject_names)
            call new_subject(trim(subject_names(i)), model, q, qd)
            call check_model(error, model, q, qd, 0.0_wp, 2.0_wp)
            if (allocated(error)) return
        end do
        q = spread(0.0_wp, 1, 9)
        qd = q
        four_bar%length = crank_rocker
        call four_bar%define()
        call four_bar%start(1.0_wp, 3.0_wp, q, qd)
        call check_model(error, four_bar, q, qd, 0.0_wp, 2.0_wp)
        if (allocated(error)) return
        ! The parallelogram before its loss of rank.
        four_bar%length = 1.0_wp
        call four_bar%start(1.0_wp, 3.0_wp, q, qd)
        call check_model(error, four_bar, q, qd, 0.0_wp, 2.0_wp)
        if (allocated(error)) return
        q = spread(0.0_wp, 1, 2)
        qd = q
        allocate (qdd, lambda, source=q)
        call belt%define()
        call belt%solution(0.0_wp, q, qd, qdd, lambda)
        call check_model(error, belt, q, qd, 0.0_wp, 2.0_wp)
        if (allocated(error)) return
        pivot%swing = 0.3_wp
        call pivot%define()
        call pivot%motion(0.0_wp, 1.0_wp, 2.0_wp, q, qd)
        call check_model(error, pivot, q, qd, 0.0_wp, 2.0_wp)
        if (allocated(error)) return
        q = spread(0.0_wp, 1, 35)
        qd = q
        call bricard%define()
        call bricard%start(0.2_wp, 1.0_wp, q, qd)
        call check_model(error, bricard, q, qd, 0.0_wp, 0.2_wp)
    end subroutine test_models

    !> All cases of the study of stability, an explicit and an implicit stepper.
    subroutine test_cases(error)
        type(error_type), allocatable, intent(out) :: error
        type(case_type), target :: subject
        type(simulation_type) :: simulation
        type(looker_type) :: looker
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        integer :: i, j

        do i = 1, size(case_names)
            do j = 1, 3
                call build_case(case_names(i), subject, failure)
                call check_no_failure(error, failure)
                if (allocated(error)) return
                options = subject%options
                options%stepper = trim(merge('sdirk54', 'dopri5 ', j == 2))
                call change_stepper(options, options%stepper, rtol=merge(1.0e-4_wp, subject%rtol, j == 3))
                options%max_steps = 1000
                looker = looker_type(pause=7)
                call run(simulation, subject%model, options, subject%t_start, subject%q, subject%qd, subject%t_end, failure, looker)
                call check_clean(error, simulation, looker, trim(case_names(i)))
                if (allocated(error)) return
            end do
        end do
    end subroutine test_cases

    !> Lengths in micrometres and in units of 1e6 m, late starts, a fast pivot, and one that swings 1000 times a second.
    subroutine test_extremes(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: pendulum
        type(moving_pivot_type), target :: pivot
        real(wp) :: q(2), qd(2)
        real(wp), parameter :: units(4) = [1.0e-9_wp, 1.0e-6_wp, 1.0e6_wp, 1.0e9_wp]
        integer :: i, j

        do i = 1, size(units)
            do j = 1, 2
                pendulum%units = units(i)
                call pendulum%define()
                ! With the default scale, and with the right one.
                if (allocated(pendulum%coordinate_scale)) deallocate (pendulum%coordinate_scale)
                if (j == 2) pendulum%coordinate_scale = pendulum%units*[1.0_wp, 1.0_wp]
                call pendulum%start(1.0_wp, merge(2.0_wp, 2.0e3_wp, i < 4), q, qd)
                call check_model(error, pendulum, q, qd, merge(0.0_wp, 1.0e6_wp, i < 3), merge(1.0_wp, 1.0e-3_wp, i < 4))
                if (allocated(error)) return
            end do
        end do
        do i = 1, 4
            pivot = moving_pivot_type(swing=0.1_wp)
            if (i == 1) pivot%speed = 1.0e4_wp
            if (i == 2) pivot%rate = 6283.0_wp
            call pivot%define()
            associate (t => merge(0.0_wp, 1.0e3_wp, i < 4))
                call pivot%motion(t, 1.0_wp, merge(2.0_wp, 1.0e4_wp, i /= 3), q, qd)
                call check_model(error, pivot, q, qd, t, merge(1.0_wp, 1.0e-2_wp, i == 1))
            end associate
            if (allocated(error)) return
        end do
    end subroutine test_extremes

    !> As of coordinates that lie far from the origin, or of tables.
    subroutine test_noise(error)
        type(error_type), allocatable, intent(out) :: error
        type(four_bar_type), target :: four_bar
        class(model_type), allocatable, target :: inner
        type(altered_type), target :: model
        real(wp), allocatable :: q(:), qd(:)
        real(wp), parameter :: noises(4) = [1.0e-15_wp, 1.0e-12_wp, 1.0e-9_wp, 1.0e-6_wp]
        integer :: i

        allocate (q(9), qd(9))
        four_bar%length = crank_rocker
        call four_bar%define()
        do i = 1, size(noises)
            call four_bar%start(1.0_wp, 3.0_wp, q, qd)
            call model%wrap(four_bar)
            model%noise = noises(i)
            call check_noisy(error, model, q, qd)
            if (allocated(error)) return
        end do
        call new_subject('skater', inner, q, qd)
        do i = 1, size(noises)
            call model%wrap(inner)
            model%noise = noises(i)
            call check_noisy(error, model, q, qd)
            if (allocated(error)) return
        end do
    end subroutine test_noise

    !> Many checks along a path from a point, because a run with such constraints soon ends.
    subroutine check_noisy(error, model, q, qd)
        type(error_type), allocatable, intent(inout) :: error
        class(model_type), intent(inout), target :: model
        real(wp), intent(in) :: q(:), qd(:)
        character(len=contradiction_length) :: found
        type(counts_type) :: counts
        real(wp) :: span
        integer :: i, k

        do k = 0, 9
            span = 0.1_wp**k
            do i = 1, 40
                call find_contradiction(model, i*1.0e-3_wp, q + i*1.0e-3_wp*qd, qd, span, counts, found)
                if (found /= '') call test_failed(error, trim(found))
                if (allocated(error)) return
            end do
        end do
    end subroutine check_noisy

    !> A sleigh on a floor that jumps, with a breakpoint, and steering without one.
    subroutine test_kinks(error)
        type(error_type), allocatable, intent(out) :: error
        type(sleigh_type), target :: sleigh
        type(case_type), target :: subject
        type(simulation_type) :: simulation
        type(looker_type) :: looker
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: q(3), qd(3)
        integer :: i, j

        call sleigh%define(0.5_wp)
        call sleigh%motion(0.0_wp, [0.1_wp, 0.2_wp, 0.3_wp, 2.0_wp, 1.0_wp], q, qd)
        call check_model(error, sleigh, q, qd, 0.0_wp, 1.0_wp)
        if (allocated(error)) return
        do i = 1, size(case_names)
            if (case_groups(i) /= 'kinks') cycle
            do j = 1, size(stepper_names)
                call build_case(case_names(i), subject, failure)
                call check_no_failure(error, failure)
                if (allocated(error)) return
                options = subject%options
                options%stepper = stepper_names(j)
                if (stepper_names(j) /= 'rk4') call change_stepper(options, options%stepper, rtol=1.0e-6_wp)
                looker = looker_type(pause=1)
                options%max_steps = 2000
                call run(simulation, subject%model, options, subject%t_start, subject%q, subject%qd, subject%t_end, failure, looker)
                call check_clean(error, simulation, looker, trim(case_names(i)))
                if (allocated(error)) return
            end do
        end do
    end subroutine test_kinks

    !> A model that exists only during the run. Evaluations for a comparison are within the steps.
    subroutine test_domain(error)
        type(error_type), allocatable, intent(out) :: error
        type(four_bar_type), target :: four_bar
        type(altered_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        character(len=contradiction_length) :: found
        type(counts_type) :: counts
        real(wp) :: q(9), qd(9)
        integer :: i

        four_bar%length = crank_rocker
        call four_bar%define()
        call four_bar%start(1.0_wp, 3.0_wp, q, qd)
        do i = 1, 2
            call model%wrap(four_bar)
            model%wall = [0.0_wp, 0.064_wp]
            model%of_gamma = merge(1.0_wp, 0.5_wp, i == 1)
            ! The steps of powers of two end where the model does too.
            call run(simulation, model, options_type(step=1.0e-3_wp), 0.0_wp, q, qd, 0.064_wp, failure)
            call check_no_failure(error, failure)
            call check_count(error, model%n_behind, 0, 'places without a value')
            if (allocated(error)) return
        end do
        ! No verdict from a place without values.
        model%wall = [0.0_wp, 0.01_wp]
        call find_contradiction(model, 0.01_wp, q, qd, 1.0e-2_wp, counts, found)
        call check_true(error, found == '' .and. model%n_behind > 0, 'no verdict')
    end subroutine test_domain

    !> Single procedures set terms that are not compressed, for any pattern of the model.
    subroutine test_pattern(error)
        type(error_type), allocatable, intent(out) :: error
        type(beads_type), target :: model
        type(counts_type) :: counts
        character(len=contradiction_length) :: contradiction
        real(wp) :: q(8), qd(8)
        integer :: i

        do i = 1, 2
            model = beads_type(is_single=i == 1)
            call model%define(4)
            call model%start(q, qd)
            call find_contradiction(model, 0.0_wp, q, qd, 0.1_wp, counts, contradiction)
            call check_true(error, contradiction == '', 'a correct model is named')
        end do
    end subroutine test_pattern
end module test_consistency
