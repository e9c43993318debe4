! SPDX-License-Identifier: MIT
!> Measured runs of a scene: the motion at given times, its error relative to a reference, and the cost of the run.
module tandem_io_study_measure
    use tandem, only: at_end, at_start, change_stepper, error_type, long, observer_type, options_type, set_error, simulation_type, &
        statistics_type, status_name, to_text, wp
    use tandem_io_scene, only: scene_type
    use tandem_io_scene_text, only: to_toml
    use tandem_io_study_reference, only: reference_type
    use tandem_status, only: status_invalid_option, status_step_limit
    use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
    implicit none (type, external)
    private

    public :: sampler_type, outcome_type, prepare_scene, sample_run, time_run, make_reference, motion_of, median, over_budget

    !> Status of a run that was stopped because it exceeded its time limit.
    character(len=*), parameter :: over_budget = 'over_budget'
    !> Number of steps between readings of the clock.
    integer, parameter :: steps_between_clocks = 16
    !> Smallest tolerance for a reference.
    real(wp), parameter :: tightest = 1.0e-15_wp

    !> Records the motion at given times by dense output, and stops a run that exceeds a time limit.
    type, extends(observer_type) :: sampler_type
        !> Times in ascending order (k), states at these times (n, k), and total energy (0:k), where element 0 is at the start.
        real(wp), allocatable :: t(:), q(:, :), qd(:, :), energy(:)
        !> Number of recorded times.
        integer :: n_recorded = 0
        !> Time limit of the run, seconds; true if the run has exceeded it.
        real(wp) :: most_seconds = huge(1.0_wp)
        logical :: exceeds_limit = .false.
        integer(long), private :: started = 0
        integer, private :: steps_since_clock = 0
    contains
        procedure :: observe
        procedure, private :: record, check_time
    end type sampler_type

    !> Outcome of a run.
    type :: outcome_type
        !> `complete`, the name of an error status, or `over_budget`.
        character(len=24) :: status = 'complete'
        !> Description of the failure.
        character(len=:), allocatable :: message
        !> Largest differences of q and qd from the reference over all its times, in units of the coordinate scales; NaN if the run
        !> failed.
        real(wp) :: error_q = 0.0_wp, error_qd = 0.0_wp
        !> Largest change of the total energy over these times, relative to the energy at the start unless this is zero.
        real(wp) :: energy_change = 0.0_wp
        !> Medians of wall and processor time over the timed runs, and number of these runs.
        real(wp) :: wall_seconds = 0.0_wp, cpu_seconds = 0.0_wp
        integer :: repeats = 0
        type(statistics_type) :: statistics
    contains
        procedure :: is_complete
    end type outcome_type

contains

    !> True if the run was completed.
    pure logical function is_complete(self)
        class(outcome_type), intent(in) :: self

        is_complete = self%status == 'complete'
    end function is_complete

    !> Prepare a scene for many runs. The start is assembled once. Events that stop the run are refused, because only complete runs
    !> are comparable; other events do not change the motion and are ignored.
    subroutine prepare_scene(scene, error)
        type(scene_type), intent(inout), target :: scene
        type(error_type), allocatable, intent(out) :: error
        type(simulation_type) :: simulation
        integer :: i

        do i = 1, size(scene%events)
            if (.not. scene%events(i)%stops) cycle
            call set_error(error, status_invalid_option, 'the event "'//trim(scene%events(i)%name)//'" of the scene "'// &
                scene%name//'" stops the run, and only whole runs compare', &
                'let its action be "record", and end the run by time.end')
            return
        end do
        if (.not. allocated(scene%assembly)) return
        call simulation%initialize(scene%model, scene%options, scene%t_start, scene%q, scene%qd, error, scene%assembly)
        if (allocated(error)) return
        scene%q = simulation%state%q
        scene%qd = simulation%state%qd
        deallocate (scene%assembly)
    end subroutine prepare_scene

    !> Run a scene once and compare it with a reference. The measured times include the sampling.
    subroutine sample_run(scene, options, t_end, reference, most_seconds, outcome)
        type(scene_type), intent(inout), target :: scene
        !> Options that replace those of the scene.
        type(options_type), intent(in) :: options
        !> End of the run, at or after the last time of the reference.
        real(wp), intent(in) :: t_end
        type(reference_type), intent(in) :: reference
        real(wp), intent(in) :: most_seconds
        type(outcome_type), intent(out) :: outcome
        type(simulation_type) :: simulation
        type(sampler_type) :: sampler
        type(error_type), allocatable :: error
        integer :: i

        sampler%t = reference%t
        sampler%most_seconds = most_seconds
        call simulation%initialize(scene%model, options, scene%t_start, scene%q, scene%qd, error)
        if (.not. allocated(error)) call simulation%integrate(t_end, error, sampler)
        outcome%statistics = simulation%statistics()
        outcome%wall_seconds = outcome%statistics%wall_seconds
        outcome%cpu_seconds = outcome%statistics%cpu_seconds
        if (allocated(error)) then
            outcome%status = status_name(error%stat)
            if (sampler%exceeds_limit) outcome%status = over_budget
            outcome%message = error%message
            outcome%error_q = ieee_value(1.0_wp, ieee_quiet_nan)
            outcome%error_qd = outcome%error_q
            outcome%energy_change = outcome%error_q
            return
        end if
        do i = 1, size(reference%t)
            outcome%error_q = max(outcome%error_q, largest(scene, sampler%q(:, i) - reference%q(:, i)))
            outcome%error_qd = max(outcome%error_qd, largest(scene, sampler%qd(:, i) - reference%qd(:, i)))
        end do
        outcome%energy_change = maxval(abs(sampler%energy - sampler%energy(0)))
        if (abs(sampler%energy(0)) > 0.0_wp) outcome%energy_change = outcome%energy_change/abs(sampler%energy(0))
    end subroutine sample_run

    !> Measure the time of a run that is known to be complete, without observers. The times are medians over at least `repeats`
    !> runs; short runs are repeated more often.
    subroutine time_run(scene, options, t_end, repeats, outcome)
        type(scene_type), intent(inout), target :: scene
        type(options_type), intent(in) :: options
        real(wp), intent(in) :: t_end
        integer, intent(in) :: repeats
        !> The counters and times are replaced.
        type(outcome_type), intent(inout) :: outcome
        integer, parameter :: most = 25
        real(wp), parameter :: long_enough = 0.1_wp
        type(simulation_type) :: simulation
        type(error_type), allocatable :: error
        real(wp) :: wall(max(most, repeats)), cpu(max(most, repeats))
        integer :: i

        do i = 1, size(wall)
            call simulation%initialize(scene%model, options, scene%t_start, scene%q, scene%qd, error)
            if (.not. allocated(error)) call simulation%integrate(t_end, error)
            outcome%statistics = simulation%statistics()
            wall(i) = outcome%statistics%wall_seconds
            cpu(i) = outcome%statistics%cpu_seconds
            outcome%repeats = i
            if (i >= repeats .and. (repeats == 1 .or. sum(wall(:i)) >= long_enough)) exit
        end do
        outcome%wall_seconds = median(wall(:outcome%repeats))
        outcome%cpu_seconds = median(cpu(:outcome%repeats))
    end subroutine time_run

    !> Compute a reference at `samples` times at equal distances. The reference is the mean of several solutions of dop853 with
    !> nearly the smallest tolerance. It is accepted only if a second stepper agrees with it. If one of the steppers is too slow, as
    !> for stiff scenes, sdirk54 is used instead.
    !>
    !> At such tolerances the error of a solution is determined by rounding, which a sensitive motion amplifies. Hence two solutions
    !> may agree by chance although both are inaccurate. Ten solutions with different steps show the effect of rounding: their mean
    !> is closer to the exact motion than to the most distant of them, except in about one of some thousand cases.
    subroutine make_reference(scene, samples, most_seconds, reference, error)
        type(scene_type), intent(inout), target :: scene
        integer, intent(in) :: samples
        !> Time limit of the run of each stepper, and of all further runs for the mean together, seconds.
        real(wp), intent(in) :: most_seconds
        type(reference_type), intent(out) :: reference
        type(error_type), allocatable, intent(out) :: error
        character(len=8), parameter :: steppers(3) = [character(len=8) :: 'dop853', 'dopri5', 'sdirk54']
        !> Tolerances in the order in which they are tried; the first one with a complete run is used.
        real(wp), parameter :: tolerances(4) = [tightest, 1.0e-14_wp, 1.0e-13_wp, 1.0e-12_wp]
        !> Largest accepted difference of solutions, relative to the motion.
        real(wp), parameter :: worst = 1.0e-3_wp
        type(sampler_type) :: sampler
        type(reference_type) :: mean
        type(error_type), allocatable :: problem
        character(len=:), allocatable :: reasons, name
        integer :: i, k

        reasons = ''
        do i = 1, size(steppers)
            ! For a smaller tolerance, an implicit stepper of order 4 would need a million steps.
            do k = merge(4, 1, steppers(i) == 'sdirk54'), size(tolerances)
                call solve(scene, steppers(i), tolerances(k), samples, most_seconds, sampler, problem)
                if (.not. allocated(problem) .or. sampler%exceeds_limit) exit
            end do
            name = trim(steppers(i))//' with rtol '//to_toml(tolerances(min(k, size(tolerances))))
            if (allocated(problem)) then
                reasons = reasons//new_line('a')//'  '//name//': '//problem%message
                cycle
            end if
            if (.not. allocated(mean%t)) then
                call compute_mean(scene, steppers(i), tolerances(k), most_seconds, sampler, mean)
                mean%origin = mean%origin//name
                cycle
            end if
            reference = mean
            call include_solution(scene, sampler, reference)
            if (reference%agreement_q <= worst*motion_of(scene, reference)) then
                reference%origin = reference%origin//', confirmed by '//name
                return
            end if
            reasons = reasons//new_line('a')//'  '//name//' differs by '//to_text(reference%agreement_q)
        end do
        call set_error(error, status_step_limit, 'no two steppers agree on a reference:'//reasons, &
            'give a reference by --reference, or a shorter time.end')
    end subroutine make_reference

    !> Compute one solution. Near the smallest tolerance, the position iteration also converges as far as possible.
    subroutine solve(scene, stepper, rtol, samples, most_seconds, sampler, problem)
        type(scene_type), intent(inout), target :: scene
        character(len=*), intent(in) :: stepper
        real(wp), intent(in) :: rtol
        integer, intent(in) :: samples
        real(wp), intent(in) :: most_seconds
        type(sampler_type), intent(out) :: sampler
        type(error_type), allocatable, intent(out) :: problem
        type(simulation_type) :: simulation
        type(options_type) :: options
        integer :: j

        options = scene%options
        call change_stepper(options, stepper, rtol=rtol, chart='every_step')
        if (rtol <= 2*tightest) options%utol = rtol
        sampler%t = [(scene%t_start + (scene%t_end - scene%t_start)*j/samples, j=1, samples)]
        sampler%most_seconds = most_seconds
        call simulation%initialize(scene%model, options, scene%t_start, scene%q, scene%qd, problem)
        if (.not. allocated(problem)) call simulation%integrate(scene%t_end, problem, sampler)
    end subroutine solve

    !> Compute the mean of a solution and of further solutions with tolerances up to twice as large, whose steps and rounding errors
    !> differ.
    subroutine compute_mean(scene, stepper, rtol, most_seconds, first, reference)
        type(scene_type), intent(inout), target :: scene
        character(len=*), intent(in) :: stepper
        real(wp), intent(in) :: rtol, most_seconds
        !> Solution with the tolerance `rtol`.
        type(sampler_type), intent(in) :: first
        type(reference_type), intent(inout) :: reference
        integer, parameter :: most = 10
        type(sampler_type) :: solutions(most)
        type(error_type), allocatable :: problem
        integer :: i, n

        solutions(1) = first
        n = 1
        do i = 2, most
            call solve(scene, stepper, rtol*(1 + (i - 1)/real(most, wp)), size(first%t), most_seconds/(most - 1), &
                solutions(n + 1), problem)
            if (.not. allocated(problem)) n = n + 1
            ! The remaining runs would exceed the limit too.
            if (solutions(min(n + 1, most))%exceeds_limit) exit
        end do
        reference%t = first%t
        reference%q = 0*first%q
        reference%qd = 0*first%qd
        do i = 1, n
            reference%q = reference%q + solutions(i)%q/n
            reference%qd = reference%qd + solutions(i)%qd/n
        end do
        reference%agreement_q = 0.0_wp
        reference%agreement_qd = 0.0_wp
        do i = 1, n
            call include_solution(scene, solutions(i), reference)
        end do
        reference%origin = ''
        if (n > 1) reference%origin = 'the mean of '//to_text(n)//' runs of '
    end subroutine compute_mean

    !> Extend the uncertainty of a reference so that it includes a solution.
    subroutine include_solution(scene, solution, reference)
        type(scene_type), intent(in) :: scene
        type(sampler_type), intent(in) :: solution
        type(reference_type), intent(inout) :: reference
        integer :: j

        do j = 1, size(reference%t)
            reference%agreement_q = max(reference%agreement_q, largest(scene, solution%q(:, j) - reference%q(:, j)))
            reference%agreement_qd = max(reference%agreement_qd, largest(scene, solution%qd(:, j) - reference%qd(:, j)))
        end do
    end subroutine include_solution

    !> Record the motion at the times that the last step has passed.
    subroutine observe(self, simulation, occasion, error)
        class(sampler_type), intent(inout) :: self
        class(simulation_type), intent(inout) :: simulation
        !> `at_start`, `at_step` or `at_end`.
        integer, intent(in) :: occasion
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: slack

        if (occasion == at_start) then
            if (allocated(self%q)) deallocate (self%q, self%qd, self%energy)
            allocate (self%q(simulation%model%n, size(self%t)), self%qd(simulation%model%n, size(self%t)))
            allocate (self%energy(0:size(self%t)))
            self%n_recorded = 0
            call system_clock(self%started)
            call self%record(simulation, error)
            return
        end if
        if (occasion == at_end) return
        do while (self%n_recorded < size(self%t))
            ! By rounding, a time may lie just after the step although it is the end of the step.
            slack = 1.0e-9_wp*simulation%last_step
            if (self%t(self%n_recorded + 1) > simulation%state%t + slack) exit
            self%n_recorded = self%n_recorded + 1
            call simulation%look_at(min(self%t(self%n_recorded), simulation%state%t), error)
            if (.not. allocated(error)) call self%record(simulation, error)
            call simulation%look_back()
            if (allocated(error)) return
        end do
        self%steps_since_clock = self%steps_since_clock + 1
        if (self%steps_since_clock >= steps_between_clocks) call self%check_time(error)
    end subroutine observe

    !> Record the state, and the energy if the model defines it.
    subroutine record(self, simulation, error)
        class(sampler_type), intent(inout) :: self
        class(simulation_type), intent(inout) :: simulation
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: kinetic, potential
        integer :: stat

        if (self%n_recorded > 0) then
            self%q(:, self%n_recorded) = simulation%state%q
            self%qd(:, self%n_recorded) = simulation%state%qd
        end if
        potential = 0.0_wp
        call simulation%kinetic_energy(kinetic, stat)
        if (stat == 0 .and. associated(simulation%model%potential_energy)) call simulation%potential_energy(potential, stat)
        self%energy(self%n_recorded) = kinetic + potential
        if (stat /= 0) call set_error(error, stat, 'the energy could not be evaluated')
    end subroutine record

    !> Stop a run that exceeds its time limit.
    subroutine check_time(self, error)
        class(sampler_type), intent(inout) :: self
        type(error_type), allocatable, intent(out) :: error
        integer(long) :: now, rate

        self%steps_since_clock = 0
        call system_clock(now, rate)
        self%exceeds_limit = real(now - self%started, wp)/real(rate, wp) > self%most_seconds
        if (self%exceeds_limit) call set_error(error, status_step_limit, 'the run took more than its '// &
            to_text(self%most_seconds)//' s', 'give more time by --budget')
    end subroutine check_time

    !> Largest component of a difference, in units of the coordinate scales.
    pure real(wp) function largest(scene, difference)
        type(scene_type), intent(in) :: scene
        !> Difference of coordinates or velocities (n).
        real(wp), intent(in) :: difference(:)

        if (allocated(scene%model%coordinate_scale)) then
            largest = maxval(abs(difference)/scene%model%coordinate_scale)
        else
            largest = maxval(abs(difference))
        end if
    end function largest

    !> Largest distance of the coordinates from their start.
    real(wp) function motion_of(scene, reference)
        type(scene_type), intent(in) :: scene
        type(reference_type), intent(in) :: reference
        integer :: i

        motion_of = 0.0_wp
        do i = 1, size(reference%t)
            motion_of = max(motion_of, largest(scene, reference%q(:, i) - scene%q))
        end do
    end function motion_of

    !> Median of some values.
    pure real(wp) function median(values)
        real(wp), intent(in) :: values(:)
        real(wp) :: sorted(size(values)), value
        integer :: i, j

        sorted = values
        do i = 2, size(sorted)
            value = sorted(i)
            j = i - 1
            do while (j >= 1)
                if (sorted(j) <= value) exit
                sorted(j + 1) = sorted(j)
                j = j - 1
            end do
            sorted(j + 1) = value
        end do
        median = 0.5_wp*(sorted((size(sorted) + 1)/2) + sorted(size(sorted)/2 + 1))
    end function median
end module tandem_io_study_measure
