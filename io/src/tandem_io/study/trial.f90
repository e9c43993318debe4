! SPDX-License-Identifier: MIT
!> A run of a case of the stability study with one stepper and the options of a user, and its verdict.
!>
!> The error is the largest value over the sample times of |y - y_ref| / (s + |y_ref|), where y are coordinates and velocities and s
!> the coordinate scales. Warnings of a run use the same scale.
module tandem_io_study_trial
    use tandem, only: allowed_error, change_stepper, error_type, find_error_warnings, global_error_type, model_type, options_type, &
        set_error, short_run, simulation_type, statistics_type, status_name, to_text, warning_type, wp
    use tandem_io_output_observers, only: observer_list_type
    use tandem_io_scene_text, only: to_toml
    use tandem_io_study_cases, only: case_type
    use tandem_io_study_endurance, only: endurance_type
    use tandem_io_study_measure, only: sampler_type
    use tandem_status, only: status_step_limit
    use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
    implicit none (type, external)
    private

    public :: trial_type, truth_type, run_trial, find_truth
    public :: held, degraded, refused, failed, wrong

    !> Verdicts: error within its limit; larger error with a warning; run not started; run not completed; larger error without a
    !> warning.
    character(len=8), parameter :: held = 'held', degraded = 'degraded', refused = 'refused', failed = 'failed', wrong = 'wrong'
    !> Number of times at which a run is compared.
    integer, parameter :: samples = 20
    !> Largest change of the energy in an endless run, relative to the energy at the start.
    real(wp), parameter :: most_energy = 1.0e-3_wp
    !> Constraint errors below this value do not count as growth. The position iteration may leave a hundredth of the tolerance,
    !> 1e-14, and the natural scales may have changed slightly since then.
    real(wp), parameter :: noise = 2.0e-14_wp

    !> The reference motion of a case.
    type :: truth_type
        !> Times (k), coordinates and velocities at these times (n, k).
        real(wp), allocatable :: t(:), q(:, :), qd(:, :)
        !> Difference of two solutions on the scale of the errors; 0 for an exact motion.
        real(wp) :: agreement = 0.0_wp
        !> Description of the origin of the motion.
        character(len=:), allocatable :: origin
    end type truth_type

    !> A run and its verdict.
    type :: trial_type
        character(len=8) :: verdict = ''
        !> `complete` or the name of a status; remark.
        character(len=24) :: status = 'complete'
        character(len=:), allocatable :: remark
        !> Error of the motion, limit of the error, and change of the energy; NaN if unknown.
        real(wp) :: error = 0.0_wp, allowed = 0.0_wp, energy_change = 0.0_wp
        !> Growth of the constraint errors, and of memory in pages; NaN except for endless runs.
        real(wp) :: growth = 0.0_wp, pages = 0.0_wp
        !> Error reported to the user; NaN if none was reported.
        real(wp) :: reported = 0.0_wp
        !> Number of warnings given to the user.
        integer :: warnings = 0
        type(statistics_type) :: statistics
        !> Motion at the sample times (n, k).
        real(wp), allocatable :: q(:, :), qd(:, :)
    end type trial_type

contains

    !> Compute the reference motion of a case.
    subroutine find_truth(subject, truth, error)
        type(case_type), intent(inout), target :: subject
        type(truth_type), intent(out) :: truth
        !> Set if the two solutions do not agree well enough.
        type(error_type), allocatable, intent(out) :: error
        !> Largest difference of the two solutions, relative to the error allowed for the most accurate runs.
        real(wp), parameter :: part = 0.1_wp
        type(options_type) :: options
        type(simulation_type) :: simulation
        type(sampler_type) :: sampler
        class(model_type), allocatable, target :: model
        integer :: i, j

        truth%t = [(subject%t_start + (subject%t_end - subject%t_start)*j/samples, j=1, samples)]
        truth%agreement = 0.0_wp
        if (subject%is_endless) then
            truth%origin = 'none'
            return
        end if
        if (subject%is_at_rest) then
            truth%q = spread(subject%q, 2, samples)
            truth%qd = spread(subject%qd, 2, samples)
            truth%origin = 'rest'
            return
        end if
        truth%origin = ''
        do i = 1, 2
            if (allocated(model)) deallocate (model)
            if (allocated(subject%true_model)) then
                allocate (model, source=subject%true_model)
            else
                allocate (model, source=subject%model)
            end if
            options = subject%options
            call change_stepper(options, subject%judges(i), rtol=subject%judges_rtol(i), chart='every_step')
            options%max_seconds = 120.0_wp
            sampler%t = truth%t
            call simulation%initialize(model, options, subject%t_start, subject%q, subject%qd, error)
            if (.not. allocated(error)) call simulation%integrate(subject%t_end, error, sampler)
            if (allocated(error)) return
            if (i > 1) truth%origin = truth%origin//', confirmed by '
            truth%origin = truth%origin//trim(subject%judges(i))//' with rtol '//to_toml(options%rtol)
            if (i == 1) then
                truth%q = sampler%q
                truth%qd = sampler%qd
            else
                truth%agreement = distance(subject, truth, sampler%q, sampler%qd)
            end if
        end do
        options = subject%options
        if (subject%with_rtol) call change_stepper(options, options%stepper, rtol=subject%rtol)
        if (truth%agreement > part*allowed_error(options)) call set_error(error, status_step_limit, subject%name// &
            ': the two reference solutions differ by '//to_text(truth%agreement))
    end subroutine find_truth

    !> Run a case with given options and determine the verdict.
    subroutine run_trial(subject, truth, options, trial)
        type(case_type), intent(inout), target :: subject
        type(truth_type), intent(in) :: truth
        type(options_type), intent(in) :: options
        type(trial_type), intent(out) :: trial
        type(simulation_type) :: simulation
        type(sampler_type), target :: sampler
        type(global_error_type), target :: global_error
        type(endurance_type), target :: endurance
        type(observer_list_type) :: observers
        type(warning_type), allocatable :: warnings(:)
        type(error_type), allocatable :: error, failure
        integer :: i

        trial%error = ieee_value(1.0_wp, ieee_quiet_nan)
        trial%energy_change = trial%error
        trial%growth = trial%error
        trial%pages = trial%error
        trial%reported = trial%error
        trial%allowed = allowed_error(options)
        trial%remark = ''
        sampler%t = truth%t
        call simulation%initialize(subject%model, options, subject%t_start, subject%q, subject%qd, error)
        if (allocated(error)) then
            trial%verdict = refused
        else
            call observers%add(sampler)
            call global_error%initialize(subject%model%n, subject%t_start, subject%t_end)
            call observers%add(global_error)
            endurance%t_start = subject%t_start
            endurance%t_end = subject%t_end
            if (subject%is_endless) call observers%add(endurance)
            call simulation%integrate(subject%t_end, error, observers)
            if (allocated(error)) trial%verdict = failed
            trial%statistics = simulation%statistics()
        end if
        if (allocated(error)) then
            trial%status = status_name(error%stat)
            trial%remark = error%message
            return
        end if
        if (trial%statistics%cpu_seconds <= short_run) then
            call global_error%estimate(subject%model, options, subject%q, subject%qd, failure)
        end if
        call find_error_warnings(options, trial%statistics, warnings, global_error, failure)
        trial%warnings = size(warnings)
        do i = 1, size(warnings)
            if (i > 1) trial%remark = trial%remark//'; '
            trial%remark = trial%remark//warnings(i)%text
        end do
        if (global_error%is_known) trial%reported = global_error%largest
        trial%energy_change = maxval(abs(sampler%energy - sampler%energy(0)))
        if (abs(sampler%energy(0)) > 0.0_wp) trial%energy_change = trial%energy_change/abs(sampler%energy(0))
        trial%q = sampler%q
        trial%qd = sampler%qd
        if (subject%is_endless) then
            trial%growth = endurance%growth(noise)
            trial%pages = real(endurance%pages_last - endurance%pages_first, wp)
            trial%error = trial%energy_change
            trial%allowed = most_energy
        else
            trial%error = distance(subject, truth, sampler%q, sampler%qd)
        end if
        if (trial%error <= trial%allowed) then
            trial%verdict = held
        else if (trial%warnings > 0) then
            trial%verdict = degraded
        else
            trial%verdict = wrong
        end if
        if (.not. subject%is_endless) return
        if (trial%growth <= 1.0_wp .and. trial%pages <= 0.0_wp) return
        ! These criteria are not covered by warnings.
        trial%verdict = wrong
        trial%remark = 'constraint errors grow '//to_text(trial%growth)//' times, memory by '//to_text(nint(trial%pages))//' pages'
    end subroutine run_trial

    !> Largest error over all times.
    pure real(wp) function distance(subject, truth, q, qd)
        type(case_type), intent(in) :: subject
        type(truth_type), intent(in) :: truth
        !> Motion at the times of the reference (n, k).
        real(wp), intent(in) :: q(:, :), qd(:, :)
        real(wp) :: scale(size(q, 1))
        integer :: k

        scale = 1.0_wp
        if (allocated(subject%model%coordinate_scale)) scale = subject%model%coordinate_scale
        distance = 0.0_wp
        do k = 1, size(q, 2)
            distance = max(distance, maxval(abs(q(:, k) - truth%q(:, k))/(scale + abs(truth%q(:, k)))), &
                maxval(abs(qd(:, k) - truth%qd(:, k))/(scale + abs(truth%qd(:, k)))))
        end do
    end function distance
end module tandem_io_study_trial
