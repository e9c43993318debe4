! SPDX-License-Identifier: MIT
!> Tests of the study of stability: its models, its cases, its verdicts, and the criteria of warnings.
module test_stability
    use asserts, only: check_below, check_count, check_failure, check_no_failure, check_text, check_true
    use tandem, only: change_stepper, allowed_error, failure_type => error_type, find_error_warnings, finding_type, &
        global_error_type, options_type, set_error, simulation_type, statistics_type, status_name, stepper_choices, &
        stepper_names, verify_model, warning_type, wp
    use tandem_io, only: case_names, select_cases, stability_columns, stability_type
    use tandem_io_study_cases, only: build_case, case_name_length, case_type
    use tandem_io_study_endurance, only: endurance_type
    use tandem_io_study_measure, only: sampler_type
    use tandem_io_study_memory, only: resident_pages
    use tandem_io_study_trial, only: find_truth, run_trial, trial_type, truth_type
    use tandem_status, only: status_invalid_option, status_newton_failed, status_singular_mass
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_stability

contains

    !> The suite.
    subroutine collect_stability(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('doubts-begin-at-half-of-what-is-allowed', test_doubts), &
            new_unittest('errors-between-steps-count-beyond-those-of-the-steps', test_doubts_between), &
            new_unittest('a-second-run-that-fails-is-a-doubt', test_failed_estimate), &
            new_unittest('jumps-that-nobody-tells-of-are-noticed', test_gap), &
            new_unittest('sdirk54-sees-kinks-before-its-first-stage', test_unseen_kink), &
            new_unittest('poor-dense-output-is-noticed-where-it-is-used', test_dense_error), &
            new_unittest('models-of-the-study-are-right', test_models), &
            new_unittest('every-case-can-be-run', test_cases), &
            new_unittest('hidden-breakpoints-change-nothing-else', test_hidden), &
            new_unittest('verdicts-are-what-they-say', test_verdicts), &
            new_unittest('a-disk-that-falls-flat-ends-there', test_falling), &
            new_unittest('masses-that-differ-much-cost-no-steps', test_masses), &
            new_unittest('cases-go-by-names-and-groups', test_selection), &
            new_unittest('a-case-in-other-units-is-compared', test_units), &
            new_unittest('growth-of-errors-and-memory-is-seen', test_endurance), &
            new_unittest('the-study-continues-where-it-was', test_resume)]
    end subroutine collect_stability

    !> A run with too large an error gives a warning, also if its estimate is only half of the error.
    subroutine test_doubts(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options
        type(statistics_type) :: statistics
        type(global_error_type) :: global_error
        type(warning_type), allocatable :: doubts(:)
        integer :: i

        allocate (doubts(0))
        do i = 1, 2
            if (i == 1) options%step = 1.0e-3_wp
            if (i == 2) options = options_type(rtol=1.0e-6_wp)
            global_error%is_known = .true.
            global_error%largest = 0.45_wp*allowed_error(options)
            call find_error_warnings(options, statistics, doubts, global_error)
            call check_count(error, size(doubts), 0, 'doubts about a small error')
            global_error%largest = 0.55_wp*allowed_error(options)
            call find_error_warnings(options, statistics, doubts, global_error)
            call check_count(error, size(doubts), 1, 'doubts about a large error')
            if (allocated(error)) return
            call check_text(error, doubts(1)%text, trim(merge('5.5e-4 of the state   ', '17 times the tolerance', i == 1)))
            global_error%is_known = .false.
            call find_error_warnings(options, statistics, doubts, global_error)
            call check_count(error, size(doubts), 0, 'doubts about an error that is not known')
        end do
        statistics%local_error_sum = 6.0e-4_wp
        call find_error_warnings(options, statistics, doubts)
        call check_count(error, size(doubts), 1, 'doubts about large local errors')
        if (.not. allocated(error)) call check_text(error, doubts(1)%text, '6.0e-4 of the state: tighten rtol')
    end subroutine test_doubts

    !> The motion between steps is warned of where it is off by more than ten times the tolerance and by more than the steps, with
    !> both errors; with fixed steps where it is off by more than a step may be.
    subroutine test_doubts_between(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options
        type(statistics_type) :: statistics
        type(global_error_type) :: global_error
        type(warning_type), allocatable :: doubts(:)
        integer :: i

        allocate (doubts(0))
        do i = 1, 2
            if (i == 1) options%step = 1.0e-3_wp
            if (i == 2) options = options_type(rtol=1.0e-6_wp)
            statistics%dense_error_q = 1.0e-9_wp
            statistics%dense_error_qd = merge(4.0e-4_wp, 9.0e-6_wp, i == 1)
            statistics%local_error_sum = 0.0_wp
            call find_error_warnings(options, statistics, doubts)
            call check_count(error, size(doubts), 0, 'doubts about a small error')
            statistics%dense_error_qd = merge(6.0e-4_wp, 1.1e-5_wp, i == 1)
            call find_error_warnings(options, statistics, doubts)
            call check_count(error, size(doubts), 1, 'doubts about a large error')
            if (allocated(error)) return
            call check_text(error, doubts(1)%text, 'positions are wrong by up to 1.0e-9 and velocities by up to '// &
                merge('6.0e-4', '1.1e-5', i == 1)//' of the state')
        end do
        statistics%local_error_sum = 2.0e-5_wp
        call find_error_warnings(options, statistics, doubts)
        call check_count(error, size(doubts), 0, 'doubts where the steps are off by more')
        statistics%local_error_sum = 0.0_wp
        global_error%is_known = .true.
        global_error%largest = 1.2e-5_wp
        call find_error_warnings(options, statistics, doubts, global_error)
        call check_count(error, size(doubts), 0, 'doubts where the run is off by more')
    end subroutine test_doubts_between

    !> An event is no reason to doubt a run, Newton's iteration that fails with half the step is.
    subroutine test_failed_estimate(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options
        type(statistics_type) :: statistics
        type(global_error_type) :: global_error
        type(warning_type), allocatable :: doubts(:)
        type(failure_type), allocatable :: failure

        allocate (doubts(0))
        call find_error_warnings(options, statistics, doubts, global_error, failure)
        call check_count(error, size(doubts), 0, 'doubts about nothing')
        call set_error(failure, status_invalid_option, 'an event has stopped the run')
        call find_error_warnings(options, statistics, doubts, global_error, failure)
        call check_count(error, size(doubts), 0, 'doubts about an event')
        call set_error(failure, status_newton_failed, 'at t = 1')
        call find_error_warnings(options, statistics, doubts, global_error, failure)
        call check_count(error, size(doubts), 1, 'doubts about a failure')
        if (.not. allocated(error)) call check_text(error, doubts(1)%text, 'has failed')
    end subroutine test_failed_estimate

    !> A hidden jump of the steering causes a gap of the velocity with every stepper and a warning; a declared one does not.
    subroutine test_gap(error)
        type(error_type), allocatable, intent(out) :: error
        type(statistics_type) :: statistics
        type(options_type) :: options
        integer :: i

        do i = 1, size(stepper_names)
            options%stepper = stepper_names(i)
            options%step = 1.0e-2_wp
            options%rtol = 0.0_wp
            if (i > 1) call change_stepper(options, options%stepper, rtol=1.0e-6_wp)
            call run_case('jump', options, statistics, error)
            ! The trapezoidal rule is of order 2.
            call check_below(error, statistics%velocity_gap, 1.0e-5_wp, 'gap of a smooth motion with '//trim(stepper_names(i)))
            call run_case('hiddenjump', options, statistics, error)
            if (allocated(error)) return
            call check_below(error, 0.1_wp, statistics%velocity_gap, 'a tenth')
            call check_below(error, abs(statistics%t_gap - 2*atan(1.0_wp)), 0.3_wp, 'distance of the time told from the jump')
            call check_doubt(error, options, statistics, 'nu_jumps')
        end do
    end subroutine test_gap

    !> The steering rate of the motorcycle jumps in the first quarter of a step, where SDIRK54 has no stage.
    subroutine test_unseen_kink(error)
        type(error_type), allocatable, intent(out) :: error
        type(case_type), target :: subject
        type(truth_type) :: truth
        type(trial_type) :: trial
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        integer :: k

        call build_case('hiddenmotorjump', subject, failure)
        call find_truth(subject, truth, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        options = subject%options
        options%stepper = 'sdirk54'
        ! Tries that end just before the jump differ with the last digits of the tolerance.
        do k = 0, 40
            call change_stepper(options, options%stepper, rtol=subject%rtol*(1.0_wp + 1.0e-9_wp*k))
            call run_trial(subject, truth, options, trial)
            ! Measured: 6e-6; 1e-3 without the check of the rates at the start of a step.
            call check_below(error, trial%error, allowed_error(options), 'error '//trim(trial%remark))
            if (allocated(error)) return
        end do
    end subroutine test_unseen_kink

    !> Without output between steps there is no warning. With output, the estimate is at least the error, here against a run with
    !> small steps, and not ten times as large.
    subroutine test_dense_error(error)
        type(error_type), allocatable, intent(out) :: error
        type(statistics_type) :: statistics
        type(options_type) :: options
        real(wp), allocatable :: true_q(:, :), true_qd(:, :), q(:, :), qd(:, :)
        real(wp) :: largest

        options%stepper = 'dop853'
        options%rtol = 1.0e-13_wp
        call run_case('motorcycle_1', options, statistics, error, true_q, true_qd)
        if (allocated(error)) return
        options%rtol = 3.0e-6_wp
        call run_case('motorcycle_1', options, statistics, error)
        call check_below(error, max(statistics%dense_error_q, statistics%dense_error_qd), 0.0_wp, 'error that nobody sees')
        if (allocated(error)) return
        call run_case('motorcycle_1', options, statistics, error, q, qd)
        if (allocated(error)) return
        ! Steps of 0.4 s: right to 7e-9 at the end of the last, to 9e-5 between them.
        largest = max(maxval(abs(q - true_q)/(1.0_wp + abs(true_q))), maxval(abs(qd - true_qd)/(1.0_wp + abs(true_qd))))
        call check_below(error, 10.0_wp*options%rtol, largest, 'ten times the tolerance')
        call check_below(error, largest, statistics%dense_error_qd, 'the error')
        call check_below(error, statistics%dense_error_qd, 10.0_wp*largest, 'ten times the error')
        call check_doubt(error, options, statistics, 'max_step')
        options%max_step = 0.05_wp
        if (allocated(error)) return
        call run_case('motorcycle_1', options, statistics, error, q, qd)
        call check_below(error, max(statistics%dense_error_q, statistics%dense_error_qd), 1.5e-5_wp, &
            'error with the advice followed')
    end subroutine test_dense_error

    !> Run a case, and evaluate it twenty times on request, mostly between its steps.
    subroutine run_case(name, options, statistics, error, q, qd)
        character(len=*), intent(in) :: name
        type(options_type), intent(in) :: options
        type(statistics_type), intent(out) :: statistics
        type(error_type), allocatable, intent(inout) :: error
        !> States found there (n, 20).
        real(wp), allocatable, intent(out), optional :: q(:, :), qd(:, :)
        type(case_type), target :: subject
        type(simulation_type) :: simulation
        type(sampler_type) :: sampler
        type(failure_type), allocatable :: failure
        integer :: i

        call build_case(name, subject, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call simulation%initialize(subject%model, options, 0.0_wp, subject%q, subject%qd, failure)
        allocate (sampler%t, source=[(subject%t_end*i/20, i=1, 20)])
        if (.not. allocated(failure) .and. present(q)) call simulation%integrate(subject%t_end, failure, sampler)
        if (.not. allocated(failure) .and. .not. present(q)) call simulation%integrate(subject%t_end, failure)
        call check_no_failure(error, failure)
        statistics = simulation%statistics()
        if (present(q)) q = sampler%q
        if (present(qd)) qd = sampler%qd
    end subroutine run_case

    !> Fail unless a warning of a run contains some words.
    subroutine check_doubt(error, options, statistics, words)
        type(error_type), allocatable, intent(inout) :: error
        type(options_type), intent(in) :: options
        type(statistics_type), intent(in) :: statistics
        character(len=*), intent(in) :: words
        type(warning_type), allocatable :: doubts(:)
        logical :: found
        integer :: i

        allocate (doubts(0))
        call find_error_warnings(options, statistics, doubts)
        found = .false.
        do i = 1, size(doubts)
            found = found .or. index(doubts(i)%text, words) > 0
        end do
        call check_true(error, found, 'a warning speaks of '//words)
    end subroutine check_doubt

    !> Jacobians, gamma, forces and derivatives against differences.
    subroutine test_models(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=*), parameter :: names(7) = [character(len=16) :: 'spring_1e2', 'damped_1e2', 'bushing_1e6', 'masses_1e-4', &
            'light_1e-12', 'parallel_1e-2', 'hiddenkink']
        type(case_type), target :: subject
        type(finding_type), allocatable :: findings(:)
        type(failure_type), allocatable :: failure
        integer :: i, k

        do i = 1, size(names)
            call build_case(trim(names(i)), subject, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call verify_model(subject%model, 0.5_wp, subject%q, subject%qd, 5, findings, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            do k = 1, size(findings)
                call check_true(error, findings(k)%passed, trim(findings(k)%name)//' of '//trim(names(i))//' is right')
            end do
        end do
    end subroutine test_models

    !> Each has a name of its own and a start that is accepted, but for the one whose mass matrix is singular.
    subroutine test_cases(error)
        type(error_type), allocatable, intent(out) :: error
        type(case_type), target :: subject
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        integer :: i

        do i = 1, size(case_names)
            call check_count(error, count(case_names == case_names(i)), 1, 'cases of the name '//trim(case_names(i)))
            call build_case(trim(case_names(i)), subject, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call check_true(error, allocated(subject%model) .and. allocated(subject%description) .and. subject%t_end > 0.0_wp, &
                trim(case_names(i))//' is complete')
            if (allocated(error)) return
            call simulation%initialize(subject%model, subject%options, subject%t_start, subject%q, subject%qd, failure)
            if (case_names(i) == 'light_0') then
                call check_failure(error, failure, status_name(status_singular_mass), 'mass')
            else
                call check_no_failure(error, failure)
            end if
        end do
        call build_case('nothing', subject, failure)
        call check_failure(error, failure, 'invalid_model', 'nothing')
    end subroutine test_cases

    !> A model that hides its kink takes the same steps before it.
    subroutine test_hidden(error)
        type(error_type), allocatable, intent(out) :: error
        type(case_type), target :: open, hidden
        type(simulation_type) :: first, second
        type(failure_type), allocatable :: failure

        call build_case('kink', open, failure)
        call build_case('hiddenkink', hidden, failure)
        call check_true(error, allocated(open%model%breakpoints) .and. .not. allocated(hidden%model%breakpoints), &
            'one tells of the kink, the other does not')
        call first%initialize(open%model, open%options, 0.0_wp, open%q, open%qd, failure)
        if (.not. allocated(failure)) call first%integrate(5.0_wp, failure)
        call check_no_failure(error, failure)
        call second%initialize(hidden%model, hidden%options, 0.0_wp, hidden%q, hidden%qd, failure)
        if (.not. allocated(failure)) call second%integrate(5.0_wp, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call check_below(error, maxval(abs(first%state%q - second%state%q)), 0.0_wp, 'difference')
    end subroutine test_hidden

    !> Held, degraded, failed, refused; and wrong, against a false motion.
    subroutine test_verdicts(error)
        type(error_type), allocatable, intent(out) :: error
        type(case_type), target :: subject
        type(truth_type) :: truth
        type(trial_type) :: trial
        type(failure_type), allocatable :: failure
        type(options_type) :: options

        call build_case('damped_1e2', subject, failure)
        call find_truth(subject, truth, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call check_below(error, truth%agreement, 1.0e-9_wp, 'difference of the two references')
        options = subject%options
        call run_trial(subject, truth, options, trial)
        call check_verdict(error, trial, 'held')
        ! The error of RK4 is 6.5e-5 here, and it reports this.
        call check_below(error, abs(trial%reported/trial%error - 1.0_wp), 0.1_wp, 'part by which it is wrong about its error')
        truth%q = truth%q + 2.0e-3_wp*(1.0_wp + abs(truth%q))
        call run_trial(subject, truth, options, trial)
        call check_verdict(error, trial, 'wrong')
        truth%q = truth%q - 2.0e-3_wp*(1.0_wp + abs(truth%q))
        options%stepper = 'trapezoid'
        call run_trial(subject, truth, options, trial)
        call check_verdict(error, trial, 'degraded')
        call check_true(error, trial%warnings > 0 .and. index(trial%remark, 'take smaller steps') > 0, 'a warning says what to do')
        options%stepper = 'rk4'
        options%step = 0.25_wp
        call run_trial(subject, truth, options, trial)
        call check_verdict(error, trial, 'failed')
        call build_case('light_0', subject, failure)
        call find_truth(subject, truth, failure)
        call run_trial(subject, truth, subject%options, trial)
        call check_verdict(error, trial, 'refused')
        call check_true(error, trial%status == 'singular_mass', 'its status is singular_mass')
    end subroutine test_verdicts

    !> A disk that falls flat ends there with every stepper, with fixed steps and under error control, and reports the reason.
    subroutine test_falling(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=12), parameter :: names(2) = [character(len=12) :: 'falling', 'falling_1e-6']
        type(case_type), target :: subject
        type(truth_type) :: truth
        type(trial_type) :: trial
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        integer :: i, k, l

        do i = 1, size(names)
            call build_case(trim(names(i)), subject, failure)
            call find_truth(subject, truth, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            do l = 1, size(stepper_choices)
                ! Choices that are not methods have no fixed steps.
                do k = merge(0, 1, any(stepper_names == stepper_choices(l))), merge(0, 1, stepper_choices(l) == 'rk4')
                    options = subject%options
                    options%stepper = stepper_choices(l)
                    call change_stepper(options, options%stepper, rtol=k*subject%rtol)
                    call run_trial(subject, truth, options, trial)
                    call check_verdict(error, trial, 'failed')
                    call check_true(error, trial%status == 'singular_mass', trim(stepper_choices(l))//' ends with singular_mass')
                    if (allocated(error)) return
                end do
            end do
        end do
    end subroutine test_falling

    !> A double pendulum whose lower mass is a hundred-millionth and a million-millionth of the upper one, and hardly affects it:
    !> implicit steps are right, and as many as with the larger of these masses.
    subroutine test_masses(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=12), parameter :: names(2) = [character(len=12) :: 'masses_1e-8', 'masses_1e-12']
        character(len=7), parameter :: steppers(2) = [character(len=7) :: 'sdirk54', 'radau5']
        type(case_type), target :: subject
        type(truth_type) :: truth
        type(trial_type) :: trial
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        integer :: i, k, l

        do i = 1, size(names)
            call build_case(trim(names(i)), subject, failure)
            call find_truth(subject, truth, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            do l = 1, size(steppers)
                ! With 1e-12 the rounding of the larger mass exceeds the tolerance of fixed steps.
                do k = merge(1, 0, i == 2), 1
                    options = subject%options
                    options%stepper = steppers(l)
                    call change_stepper(options, options%stepper, rtol=k*subject%rtol)
                    call run_trial(subject, truth, options, trial)
                    call check_verdict(error, trial, 'held')
                    call check_count(error, trial%statistics%failed, 0, trim(steppers(l))//': steps that failed')
                    ! About forty; there were 838 and 1257, and six hundred that failed.
                    if (k == 1) call check_true(error, trial%statistics%steps < 60, trim(steppers(l))//': steps')
                    if (allocated(error)) return
                end do
            end do
        end do
    end subroutine test_masses

    !> Fail unless a trial has a verdict.
    subroutine check_verdict(error, trial, verdict)
        type(error_type), allocatable, intent(inout) :: error
        type(trial_type), intent(in) :: trial
        character(len=*), intent(in) :: verdict

        call check_true(error, trial%verdict == verdict, 'the verdict '//trim(trial%verdict)//' is '//verdict)
    end subroutine check_verdict

    subroutine test_selection(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=case_name_length), allocatable :: cases(:)
        character(len=:), allocatable :: unknown

        call select_cases([character(len=8) ::], cases, unknown)
        call check_count(error, size(cases), size(case_names), 'all cases')
        call select_cases([character(len=8) :: 'edge', 'million'], cases, unknown)
        call check_count(error, size(cases), 3, 'a case and a group of two')
        call select_cases([character(len=8) :: 'edge', 'egde'], cases, unknown)
        call check_true(error, .not. allocated(cases), 'nothing is selected')
        if (.not. allocated(error)) call check_true(error, unknown == 'egde', 'the unknown name is told')
    end subroutine test_selection

    !> The disk in kilometres gives the same run as in metres.
    subroutine test_units(error)
        type(error_type), allocatable, intent(out) :: error
        type(stability_type), target :: study

        call run_study([character(len=case_name_length) :: 'diskunits_km'], 'units', 4, .true., study, error)
        if (allocated(error)) return
        call check_count(error, study%count_of('wrong'), 0, 'runs that differ')
        call check_count(error, study%journal%table%rows(), 4, 'rows')
    end subroutine test_units

    !> The first and the last tenth are compared; noise does not count.
    subroutine test_endurance(error)
        type(error_type), allocatable, intent(out) :: error
        type(endurance_type) :: endurance
        type(case_type), target :: subject
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure

        endurance%first = [1.0e-16_wp, 2.0e-14_wp, 3.0e-14_wp]
        endurance%last = [9.0e-15_wp, 4.0e-14_wp, 3.0e-14_wp]
        call check_below(error, abs(endurance%growth(1.0e-14_wp) - 2.0_wp), 1.0e-12_wp, 'difference of the growth')
        call build_case('edge', subject, failure)
        endurance%t_end = subject%t_end
        call simulation%initialize(subject%model, subject%options, 0.0_wp, subject%q, subject%qd, failure)
        if (.not. allocated(failure)) call simulation%integrate(subject%t_end, failure, endurance)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call check_true(error, maxval(endurance%first) > 0.0_wp .and. maxval(endurance%last) > 0.0_wp .and. &
            maxval(endurance%last) < 1.0e-12_wp, 'errors were seen in both')
        if (resident_pages() < 0) return
        call check_true(error, endurance%pages_first > 100 .and. endurance%pages_last >= endurance%pages_first, &
            'the memory of the program was seen')
    end subroutine test_endurance

    !> Rows of a study that was stopped and called again are those of one that was not.
    subroutine test_resume(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=case_name_length), parameter :: cases(2) = [character(len=case_name_length) :: 'edge', 'speed_0']
        type(stability_type), target :: at_once, first, second
        !> Two cases, each method with fixed steps, and all choices but rk4 with tolerances.
        integer, parameter :: n_rows = 2*(size(stepper_names) + size(stepper_choices) - 1)
        integer :: row

        call run_study(cases, 'at_once', 99, .true., at_once, error)
        call run_study(cases, 'resumed', 11, .true., first, error)
        call run_study(cases, 'resumed', 99, .false., second, error)
        if (allocated(error)) return
        call check_count(error, second%journal%resumed, 11, 'rows taken up')
        call check_count(error, at_once%journal%table%rows(), n_rows, 'rows')
        call check_count(error, at_once%total(), n_rows, 'rows foretold')
        call check_count(error, second%journal%table%rows(), n_rows, 'rows of both')
        if (allocated(error)) return
        do row = 1, n_rows
            call check_true(error, at_once%journal%table%text_at(row, 'error') == second%journal%table%text_at(row, 'error') &
                .and. at_once%journal%table%text_at(row, 'stepper') == second%journal%table%text_at(row, 'stepper'), &
                'the rows are the same')
        end do
        call check_count(error, second%count_of('held') + second%count_of('degraded'), n_rows, 'runs that end')
    end subroutine test_resume

    !> Some rows of some cases.
    subroutine run_study(cases, name, rows, force, study, error)
        character(len=*), intent(in) :: cases(:), name
        !> Most rows.
        integer, intent(in) :: rows
        logical, intent(in) :: force
        type(stability_type), intent(inout) :: study
        type(error_type), allocatable, intent(inout) :: error
        type(failure_type), allocatable :: failure
        logical :: finished

        if (allocated(error)) return
        study%cases = cases
        call study%journal%open('build/test_study', 'stability_'//name, stability_columns, 'none', force, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        do while (study%journal%table%rows() < rows)
            call study%next_row(finished, failure)
            if (finished .or. allocated(failure)) exit
        end do
        call check_no_failure(error, failure)
        call study%journal%close()
    end subroutine run_study
end module test_stability
