! SPDX-License-Identifier: MIT
!> Error of a whole run, including the amplification of local errors by the motion, estimated from a second, more accurate run.
!>
!> Observe the run with this observer, then call `estimate` with a second instance of the model. The second run has half the step
!> size, or a tenth of the tolerances. The error of the first run is the difference between both runs, plus the error of the second
!> run, which follows from the ratio of their errors (Richardson extrapolation). Source: Hairer, Norsett, Wanner, Solving Ordinary
!> Differential Equations I, section II.4.
module tandem_simulate_global_error
    use tandem_chart, only: chart_type
    use tandem_error, only: error_type, set_error, to_text
    use tandem_kinds, only: long, wp
    use tandem_model, only: model_type
    use tandem_pack, only: pack_type
    use tandem_option_rules, only: complete_options
    use tandem_options, only: options_type
    use tandem_simulate_statistics, only: statistics_type
    use tandem_simulate_step_control, only: step_control_type
    use tandem_simulation, only: at_end, at_event, at_step, observer_type, simulation_type
    use tandem_status, only: status_invalid_option, status_work_limit
    use tandem_stepper, only: properties_type, stepper_type
    use tandem_stepper_factory, only: new_stepper
    implicit none (type, external)
    private

    public :: global_error_type

    !> Largest number of times at which the runs are compared: at the end of the first step after each hundredth of the run, which
    !> costs the observed run nothing, and at the end of the run.
    integer, parameter :: n_times = 102
    !> Tolerances of the second run relative to those of the first; smallest tolerance.
    real(wp), parameter :: part = 0.1_wp, smallest = 1.0e-15_wp
    !> If the largest step exceeds this fraction of the run, the end of the run may have shortened it.
    real(wp), parameter :: cut_fraction = 0.3_wp

    !> Observes a run and compares it with a second run.
    type, extends(observer_type) :: global_error_type
        !> Number of coordinates.
        integer :: n = 0
        !> True if the error was estimated.
        logical :: is_known = .false.
        !> True if it was not estimated because both runs together reached `max_seconds`.
        logical :: is_out_of_time = .false.
        !> True if the error is only a bound: the tolerances cannot be reduced, so that the second run has larger ones.
        logical :: is_bound = .false.
        !> Errors of q and qd at the end of the run in the maximum norm; coordinates with these errors.
        real(wp) :: error_q = 0.0_wp, error_qd = 0.0_wp
        integer :: worst_q = 1, worst_qd = 1
        !> Error at the end of the run; largest error at all times compared, and its time. Maximum over q and qd, relative to scale
        !> + |y|.
        real(wp) :: relative = 0.0_wp, largest = 0.0_wp, t_largest = 0.0_wp
        !> Cost of the second run: evaluations of the right-hand side, and wall time (s).
        integer(long) :: right_hand_sides = 0
        real(wp) :: seconds = 0.0_wp
        real(wp), private :: t_start = 0.0_wp, t_end = 0.0_wp, due = 0.0_wp
        !> Times of comparison (n_times), q and qd of the first run at these times (n, 2, n_times); number of times.
        real(wp), allocatable, private :: t(:), state(:, :, :)
        !> Longest step of the first run since the previous time of comparison (n_times); end of its last step.
        real(wp), allocatable, private :: longest(:)
        real(wp), private :: t_last = 0.0_wp
        !> Number of steps since the previous time of comparison, and the sum of their sizes to the power p + 1, to which errors of
        !> steps are proportional (n_times, the first and the second run). Steps over singular configurations are left out.
        real(wp), allocatable, private :: steps(:, :), powers(:, :)
        !> Number of singular configurations that the run has passed.
        integer, private :: n_crossings = 0
        integer, private :: n_seen = 0, n_taken = 0
        !> True if events have changed or stopped the first run, because the second run has no events.
        logical, private :: is_changed = .false., is_stopped = .false.
        !> True if both runs could be evaluated at the time (n_times).
        logical, private :: is_there(n_times) = .true.
        integer(long), private :: work = 0
        !> Largest step of the first run, and its duration (s).
        real(wp), private :: largest_step = 0.0_wp, seconds_of_first = 0.0_wp
        !> Differences between both runs.
        real(wp), allocatable, private :: difference(:, :, :)
        logical, private :: is_second = .false.
    contains
        procedure :: initialize, observe, estimate, pack_state
        procedure, private :: choose_second, count_step, take, evaluate
    end type global_error_type

contains

    !> Begin, before the run starts.
    subroutine initialize(self, n, t_start, t_end)
        class(global_error_type), intent(inout) :: self
        !> Number of coordinates.
        integer, intent(in) :: n
        !> Start and end of the run.
        real(wp), intent(in) :: t_start, t_end

        self%n = n
        self%is_known = .false.
        self%is_out_of_time = .false.
        self%is_second = .false.
        self%n_taken = 0
        self%n_seen = 0
        self%is_changed = .false.
        self%is_stopped = .false.
        self%is_there = .true.
        self%t_start = t_start
        self%t_end = t_end
        self%due = t_start
        self%longest = spread(0.0_wp, 1, n_times)
        self%t_last = t_start
        if (allocated(self%steps)) deallocate (self%steps, self%powers)
        allocate (self%steps(n_times, 2), self%powers(n_times, 2), source=0.0_wp)
        self%n_crossings = 0
        self%t = spread(t_end, 1, n_times)
        if (allocated(self%state)) deallocate (self%state, self%difference)
        allocate (self%state(n, 2, n_times), self%difference(n, 2, n_times), source=0.0_wp)
    end subroutine initialize

    !> Store the state if the last step has passed a time of comparison.
    subroutine observe(self, simulation, occasion, error)
        class(global_error_type), intent(inout) :: self
        class(simulation_type), intent(inout) :: simulation
        !> `at_start`, `at_step`, `at_end` or `at_event`.
        integer, intent(in) :: occasion
        type(error_type), allocatable, intent(out) :: error
        type(error_type), allocatable :: failure
        type(statistics_type) :: statistics
        real(wp) :: t_step, hundredth
        integer :: k
        logical :: is_missing

        if (occasion == at_event) self%is_changed = .true.
        self%is_stopped = simulation%is_stopped
        t_step = simulation%state%t
        if (.not. self%is_second) then
            if (occasion == at_end) then
                statistics = simulation%statistics()
                self%largest_step = statistics%largest_step
                self%seconds_of_first = statistics%wall_seconds
            end if
            k = min(self%n_seen + 1, n_times)
            self%longest(k) = max(self%longest(k), t_step - self%t_last)
            call self%count_step(simulation, k, 1)
            ! If a restored run continues at its very end, the observer is not called during its last step.
            is_missing = occasion == at_end .and. t_step >= self%t_end .and. self%t(max(1, self%n_seen)) < t_step
            if (.not. is_missing .and. (occasion /= at_step .or. .not. (t_step >= self%due .or. t_step >= self%t_end))) return
            statistics = simulation%statistics()
            self%work = statistics%right_hand_sides
            ! The last entry is reserved for the end of the run.
            if (self%n_seen >= n_times - 1 .and. t_step < self%t_end) return
            hundredth = (self%t_end - self%t_start)/100.0_wp
            self%due = self%t_start + hundredth*(1.0_wp + aint((t_step - self%t_start)/hundredth + 1.0e-6_wp))
            self%n_seen = self%n_seen + 1
            self%t(self%n_seen) = t_step
            call self%take(simulation%state%q, simulation%state%qd)
            return
        end if
        call self%count_step(simulation, min(self%n_taken + 1, n_times), 2)
        do while (self%n_taken < self%n_seen)
            if (self%t(self%n_taken + 1) > t_step) exit
            call simulation%look_at(self%t(self%n_taken + 1), failure)
            call self%take(simulation%state%q, simulation%state%qd)
            ! A failed evaluation between steps does not end the run.
            if (allocated(failure)) self%is_there(self%n_taken) = .false.
            call simulation%look_back()
        end do
    end subroutine observe

    !> Count a step of the first or the second run.
    subroutine count_step(self, simulation, k, which)
        class(global_error_type), intent(inout) :: self
        class(simulation_type), intent(in) :: simulation
        !> Index of the next time of comparison; 1 or 2.
        integer, intent(in) :: k, which

        associate (t => simulation%state%t, h => simulation%state%t - self%t_last)
            if (h > 0.0_wp .and. simulation%n_crossings == self%n_crossings) then
                self%steps(k, which) = self%steps(k, which) + 1.0_wp
                self%powers(k, which) = self%powers(k, which) + h**(simulation%method%order + 1)
            end if
            self%t_last = t
        end associate
        self%n_crossings = simulation%n_crossings
    end subroutine count_step

    !> Store a state of the first run, or a difference of the second run.
    subroutine take(self, q, qd)
        class(global_error_type), intent(inout) :: self
        real(wp), intent(in) :: q(:), qd(:)

        self%n_taken = self%n_taken + 1
        associate (k => self%n_taken)
            if (self%is_second) then
                self%difference(:, 1, k) = abs(q - self%state(:, 1, k))
                self%difference(:, 2, k) = abs(qd - self%state(:, 2, k))
            else
                self%state(:, 1, k) = q
                self%state(:, 2, k) = qd
            end if
        end associate
    end subroutine take

    !> Integrate the second run, and compare both runs.
    subroutine estimate(self, model, options, q, qd, error, chart, stepper, control)
        class(global_error_type), intent(inout) :: self
        !> Second instance of the model, equal to the model of the first run at its start.
        class(model_type), intent(inout), target :: model
        !> Options of the run.
        type(options_type), intent(in) :: options
        !> Start of the run (n).
        real(wp), intent(in) :: q(:), qd(:)
        !> Reason for which the error is unknown: events changed or stopped the run, the run did not reach its end, or the second
        !> run failed.
        type(error_type), allocatable, intent(out) :: error
        !> User-defined chart, stepper and step size controller of the run, if any.
        class(chart_type), intent(in), optional :: chart
        class(stepper_type), intent(in), optional :: stepper
        class(step_control_type), intent(in), optional :: control
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(options_type) :: first, second
        type(properties_type) :: method
        class(stepper_type), allocatable :: named
        real(wp) :: of_step, ratio
        integer :: k

        if (self%is_changed .or. (self%is_stopped .and. self%t(max(1, self%n_seen)) < self%t_end)) then
            call set_error(error, status_invalid_option, 'an event has '//trim(merge('changed', 'stopped', self%is_changed))// &
                ' the run, and the second run does not watch events', 'compare with a run with smaller tolerances or steps')
            return
        end if
        if (self%t(max(1, self%n_seen)) < self%t_end .or. self%n_seen == 0) then
            call set_error(error, status_invalid_option, 'the run to compare with has not reached its end', &
                'pass this object to integrate as the observer of the complete run')
            return
        end if
        if (present(stepper)) then
            method = stepper%properties()
        else
            call new_stepper(options%stepper, named)
            method = named%properties()
        end if
        first = options
        call complete_options(first, error, method%estimate_order > 0)
        if (allocated(error)) return
        call self%choose_second(first, method, second, of_step)
        ratio = of_step**method%order
        self%is_bound = ratio > 1.0_wp
        ! The work of the second run is bounded too; it should be two or three times that of the first run. Both runs together must
        ! not take more time than is allowed for the first one.
        if (options%max_seconds > 0.0_wp) second%max_seconds = max(options%max_seconds - self%seconds_of_first, tiny(1.0_wp))
        second%max_steps = huge(1)
        second%max_evaluations = int(min(int(huge(1), long), 10000 + 20*self%work))
        call simulation%initialize(model, second, self%t_start, q, qd, error, chart=chart, stepper=stepper, &
            control=control)
        if (allocated(error)) return
        self%is_second = .true.
        self%steps(:, 2) = 0.0_wp
        self%powers(:, 2) = 0.0_wp
        self%n_taken = 0
        self%t_last = self%t_start
        self%n_crossings = 0
        if (first%is_adaptive()) then
            ! Steps of the second run end at the times of comparison, because dense output in long steps may be less accurate than
            ! either run. They are also limited to less than the steps of the first run, even if tolerances do not determine them,
            ! since equal steps would give no difference. Fixed steps of half the size satisfy both conditions.
            do k = 1, self%n_seen
                call simulation%limit_steps(of_step*self%longest(k))
                call simulation%integrate(self%t(k), error, self)
                if (allocated(error)) exit
            end do
        else
            call simulation%integrate(self%t_end, error, self)
        end if
        statistics = simulation%statistics()
        self%right_hand_sides = statistics%right_hand_sides
        self%seconds = statistics%wall_seconds
        if (allocated(error)) then
            self%is_out_of_time = error%stat == status_work_limit .and. second%max_seconds > 0.0_wp .and. &
                self%right_hand_sides < second%max_evaluations
            if (self%is_out_of_time) call set_error(error, status_work_limit, 'the run and a second one together take longer '// &
                'than max_seconds = '//to_text(options%max_seconds), 'raise max_seconds')
            return
        end if
        if (.not. self%is_bound) call add_second(self, ratio)
        if (simulation%n_crossings > 0) call add_crossings(self, simulation, model)
        call self%evaluate(model)
    end subroutine estimate

    !> Add the error of the second run to each difference. It is a fraction of that of the first run. The tolerances give the
    !> expected fraction, the actual steps a larger one if they have not become smaller as expected. Errors of oscillating motions
    !> change their sign, at different times in both runs: the fraction is one of the difference, or of its root mean square shortly
    !> before if that is larger.
    subroutine add_second(self, expected)
        class(global_error_type), intent(inout) :: self
        !> Ratio of the errors of both runs that follows from the options.
        real(wp), intent(in) :: expected
        !> Part of the run over which the mean is taken; largest ratio that steps give; least number of steps for it: the sizes of
        !> first and last steps do not follow from their errors.
        real(wp), parameter :: recent = 0.03_wp, largest_ratio = 0.5_wp, least_steps = 20.0_wp
        real(wp) :: sums(2), ratio(n_times), squares(size(self%state, 1), 2)
        integer :: j, k, n

        ratio(:) = expected
        sums(:) = 0.0_wp
        do k = 1, self%n_seen
            ! Error control makes the errors of all steps of the first run about equal.
            if (all(self%powers(k, :) > 0.0_wp)) sums = sums + self%steps(k, 1)*[1.0_wp, self%powers(k, 2)/self%powers(k, 1)]
            if (sums(1) >= least_steps) ratio(k) = max(expected, min(sums(2)/sums(1), largest_ratio))
        end do
        ! Backwards: a mean is one of the differences before.
        do k = self%n_seen, 1, -1
            squares(:, :) = 0.0_wp
            n = 0
            do j = k, 1, -1
                if (self%t(j) < self%t(k) - recent*(self%t_end - self%t_start)) exit
                if (.not. self%is_there(j)) cycle
                squares(:, :) = squares + self%difference(:, :, j)**2
                n = n + 1
            end do
            self%difference(:, :, k) = self%difference(:, :, k) + &
                ratio(k)/(1.0_wp - ratio(k))*max(self%difference(:, :, k), sqrt(squares/max(n, 1)))
        end do
    end subroutine add_second

    !> Add the errors of steps over singular configurations: rounding limits them, so that they are no smaller in the second run.
    subroutine add_crossings(self, simulation, model)
        class(global_error_type), intent(inout) :: self
        !> The second run.
        class(simulation_type), intent(in) :: simulation
        class(model_type), intent(in) :: model
        real(wp) :: scale(size(self%state, 1)), error
        integer :: i, j, k

        scale = model%scales()
        error = 0.0_wp
        i = 1
        do k = 1, self%n_seen
            do while (i <= simulation%n_crossings)
                if (simulation%crossings(i)%t > self%t(k)) exit
                error = error + simulation%crossings(i)%error
                i = i + 1
            end do
            do j = 1, size(scale)
                self%difference(j, 1, k) = self%difference(j, 1, k) + error*(scale(j) + abs(self%state(j, 1, k)))
                self%difference(j, 2, k) = self%difference(j, 2, k) + error*(scale(j)/model%time_scale + abs(self%state(j, 2, k)))
            end do
        end do
    end subroutine add_crossings

    !> Choose the options of the second run.
    subroutine choose_second(self, options, method, second, of_step)
        class(global_error_type), intent(in) :: self
        type(options_type), intent(in) :: options
        type(properties_type), intent(in) :: method
        type(options_type), intent(out) :: second
        !> Ratio of its step sizes to those of the first run.
        real(wp), intent(out) :: of_step
        real(wp) :: factor
        logical :: is_short

        second = options
        if (.not. options%is_adaptive()) then
            second%step = 0.5_wp*options%step
            ! If the end of the run has shortened the steps, use half of their actual size, since half of the allowed size could be
            ! as long.
            if (self%largest_step > 0.0_wp) second%step = min(second%step, 0.5_wp*self%largest_step)
            of_step = 0.5_wp
            return
        end if
        is_short = self%largest_step > cut_fraction*(self%t_end - self%t_start)
        factor = part
        if (part*options%relative_tolerance() < smallest) factor = merge(1.0_wp, 1.0_wp/part, is_short)
        second%rtol = factor*options%rtol
        second%atol = factor*options%atol
        if (allocated(second%rtol_q)) second%rtol_q = factor*second%rtol_q
        if (allocated(second%rtol_qd)) second%rtol_qd = factor*second%rtol_qd
        if (allocated(second%atol_q)) second%atol_q = factor*second%atol_q
        if (allocated(second%atol_qd)) second%atol_qd = factor*second%atol_qd
        ! The step size follows from an error estimate of order p^ + 1, whereas the error per unit of time is of order p.
        of_step = factor**(1.0_wp/real(method%estimate_order + 1, wp))
        if (is_short) of_step = min(of_step, 0.7_wp)
        ! Looser tolerances allow larger steps, up to any limit on the step size.
        if (of_step > 1.0_wp .and. options%max_step > 0.0_wp) second%max_step = of_step*options%max_step
    end subroutine choose_second

    !> Pack the observed data of the first run, so that a restored run can be observed. The end of the run may be different.
    subroutine pack_state(self, pack)
        class(global_error_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%t_start, self%due)
        call pack%item(self%t, self%longest)
        call pack%item(self%t_last)
        call pack%item(self%steps)
        call pack%item(self%powers)
        call pack%item(self%n_crossings)
        call pack%item(self%state)
        call pack%item(self%n_seen)
        call pack%item(self%is_changed, self%is_stopped)
        call pack%item(self%work)
        if (.not. pack%is_reading) return
        ! The last entry is reserved for the end of the run.
        self%n_seen = min(self%n_seen, n_times - 1)
        self%n_taken = self%n_seen
    end subroutine pack_state

    !> Evaluate the norms of the differences.
    subroutine evaluate(self, model)
        class(global_error_type), intent(inout) :: self
        class(model_type), intent(in) :: model
        real(wp) :: scale(size(self%state, 1)), relative
        integer :: i, k

        scale = model%scales()
        self%largest = 0.0_wp
        relative = 0.0_wp
        self%t_largest = self%t_end
        do k = 1, self%n_seen
            if (.not. self%is_there(k)) cycle
            relative = 0.0_wp
            do i = 1, 2
                relative = max(relative, maxval(self%difference(:, i, k)/(scale/merge(1.0_wp, model%time_scale, i == 1) + &
                    abs(self%state(:, i, k)))))
            end do
            if (relative > self%largest) self%t_largest = self%t(k)
            self%largest = max(self%largest, relative)
        end do
        self%relative = relative
        self%worst_q = maxloc(self%difference(:, 1, self%n_seen), dim=1)
        self%worst_qd = maxloc(self%difference(:, 2, self%n_seen), dim=1)
        self%error_q = self%difference(self%worst_q, 1, self%n_seen)
        self%error_qd = self%difference(self%worst_qd, 2, self%n_seen)
        self%is_known = .true.
    end subroutine evaluate
end module tandem_simulate_global_error
