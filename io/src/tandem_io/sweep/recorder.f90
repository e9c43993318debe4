! SPDX-License-Identifier: MIT
!> The observer of a case: evaluates the kept quantities during the run.
module tandem_io_sweep_recorder
    use tandem, only: at_end, at_event, at_start, error_type, global_error_type, observer_type, set_error, simulation_type, &
        to_text, wp
    use tandem_io_scene, only: scene_type
    use tandem_io_sweep_kept, only: find_figure, kept_type, of_energy, of_error, of_estimate, of_event, of_figure, of_kinetic, &
        of_lambda, of_potential, of_q, of_qd, of_qdd, of_sensor, take_count, take_end, take_first, take_last, take_max, &
        take_mean, take_min, take_start, take_time_of_max, take_time_of_min, take_times
    use tandem_status, only: status_callback_failed, status_invalid_option
    use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
    implicit none (type, external)
    private

    public :: recorder_type

    type, extends(observer_type) :: recorder_type
        !> Kept quantities; their values, one after the other, NaN if missing.
        type(kept_type), allocatable :: kept(:)
        real(wp), allocatable :: values(:)
        !> For each quantity: index of its first value, number of its times that have passed, value at the last evaluation, and
        !> extreme value.
        integer, allocatable, private :: first(:), n_passed(:)
        real(wp), allocatable, private :: last(:), extreme(:)
        real(wp), private :: t_start = 0.0_wp, t_last = 0.0_wp
        !> True if quantities are evaluated at steps; true if they are evaluated at times between steps.
        logical, private :: evaluates_at_steps = .false., evaluates_between = .false.
        !> Sensors and multipliers at the current state.
        real(wp), allocatable, private :: sensors(:), lambda(:)
        logical, private :: needs_sensors = .false., needs_lambda = .false.
        !> True if errors of the run are requested, which require a second run.
        logical :: needs_estimate = .false.
    contains
        procedure :: initialize, resolve, observe, take_estimate
        procedure, private :: begin, take_step, take_between, finish, evaluate_shared, value_now
    end type recorder_type

contains

    !> Prepare the recorder for all cases of a sweep.
    subroutine initialize(self, kept)
        class(recorder_type), intent(inout) :: self
        !> Kept quantities; their indices must be resolved.
        type(kept_type), intent(in) :: kept(:)
        integer :: i, n

        allocate (self%kept, source=kept)
        allocate (self%first(size(kept)), self%n_passed(size(kept)), self%last(size(kept)), self%extreme(size(kept)))
        n = 0
        do i = 1, size(kept)
            self%first(i) = n + 1
            n = n + kept(i)%width()
        end do
        allocate (self%values(n))
        self%needs_sensors = any(kept%kind == of_sensor)
        self%needs_lambda = any(kept%kind == of_lambda)
        self%needs_estimate = any(kept%kind == of_estimate)
        self%evaluates_at_steps = any(kept%take >= take_min .and. kept%take <= take_mean)
        self%evaluates_between = any(kept%take == take_times)
    end subroutine initialize

    !> Find the kept quantities in the scene of a case, whose model may have other coordinates than the previous one.
    subroutine resolve(self, scene, error)
        class(recorder_type), intent(inout) :: self
        type(scene_type), intent(in) :: scene
        !> Set if the scene lacks a kept quantity.
        type(error_type), allocatable, intent(out) :: error
        character(len=:), allocatable :: problem
        integer :: i

        do i = 1, size(self%kept)
            ! These quantities exist in every run.
            if (any(self%kept(i)%kind == [of_figure, of_error, of_estimate])) cycle
            call self%kept(i)%resolve(scene, problem)
            if (problem == '') cycle
            call set_error(error, status_invalid_option, 'the quantity "'//trim(self%kept(i)%name)//'", '// &
                self%kept(i)%quantity//', '//problem, &
                'vary only parameters that preserve it in the model, or keep another quantity')
            return
        end do
    end subroutine resolve

    !> Evaluate the kept quantities that are due.
    subroutine observe(self, simulation, occasion, error)
        class(recorder_type), intent(inout) :: self
        class(simulation_type), intent(inout) :: simulation
        !> `at_start`, `at_step`, `at_event` or `at_end`.
        integer, intent(in) :: occasion
        type(error_type), allocatable, intent(out) :: error

        select case (occasion)
        case (at_start)
            call self%begin(simulation, error)
        case (at_end)
            call self%finish(simulation, error)
        case default
            if (self%evaluates_between) call self%take_between(simulation, occasion == at_event, error)
            if (self%evaluates_at_steps) then
                if (.not. allocated(error)) call self%take_step(simulation, error)
            else if (simulation%model%measures_every_step .and. self%needs_sensors) then
                ! Angles are continued beyond one revolution from step to step.
                if (.not. allocated(error)) call self%evaluate_shared(simulation, error)
            end if
        end select
        if (self%evaluates_between .and. occasion /= at_end) call announce_next_times(self, simulation)
    end subroutine observe

    !> Announce the next times between steps at which quantities are evaluated.
    subroutine announce_next_times(self, simulation)
        class(recorder_type), intent(in) :: self
        class(simulation_type), intent(inout) :: simulation
        integer :: i

        do i = 1, size(self%kept)
            if (self%kept(i)%take /= take_times) cycle
            if (self%n_passed(i) < size(self%kept(i)%times)) call simulation%expect_look(self%kept(i)%times(self%n_passed(i) + 1))
        end do
    end subroutine announce_next_times

    !> Evaluate quantities at the start of the run.
    subroutine begin(self, simulation, error)
        class(recorder_type), intent(inout) :: self
        class(simulation_type), intent(inout) :: simulation
        type(error_type), allocatable, intent(out) :: error
        integer :: i, stat

        call resize(self%lambda, simulation%model%n_constraints())
        i = 0
        if (allocated(simulation%model%quantities)) i = sum(max(1, simulation%model%quantities%width))
        call resize(self%sensors, i)
        self%values = ieee_value(1.0_wp, ieee_quiet_nan)
        self%n_passed = 0
        self%t_start = simulation%state%t
        self%t_last = self%t_start
        call self%evaluate_shared(simulation, error)
        if (allocated(error)) return
        stat = 0
        do i = 1, size(self%kept)
            associate (kept => self%kept(i))
                if (any(kept%kind == [of_event, of_figure]) .or. kept%take == take_end) cycle
                self%last(i) = self%value_now(simulation, i, stat)
                self%extreme(i) = self%last(i)
                select case (kept%take)
                case (take_start, take_min, take_max)
                    self%values(self%first(i)) = self%last(i)
                case (take_time_of_min, take_time_of_max)
                    self%values(self%first(i)) = self%t_start
                case (take_mean)
                    self%values(self%first(i)) = 0.0_wp
                case (take_times)
                    do while (self%n_passed(i) < size(kept%times))
                        if (kept%times(self%n_passed(i) + 1) > self%t_start) exit
                        self%n_passed(i) = self%n_passed(i) + 1
                        if (.not. kept%times(self%n_passed(i)) < self%t_start) then
                            self%values(self%first(i) + self%n_passed(i) - 1) = self%last(i)
                        end if
                    end do
                case default
                    continue
                end select
            end associate
        end do
        call report_failure(stat, simulation, error)
    end subroutine begin

    !> Allocate an array of a given size.
    pure subroutine resize(numbers, n)
        real(wp), allocatable, intent(inout) :: numbers(:)
        integer, intent(in) :: n

        if (allocated(numbers)) then
            if (size(numbers) == n) return
            deallocate (numbers)
        end if
        allocate (numbers(n))
    end subroutine resize

    !> Update extremes and means at the end of a step.
    subroutine take_step(self, simulation, error)
        class(recorder_type), intent(inout) :: self
        class(simulation_type), intent(inout) :: simulation
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: value
        integer :: i, stat

        call self%evaluate_shared(simulation, error)
        if (allocated(error)) return
        stat = 0
        associate (t => simulation%state%t)
            do i = 1, size(self%kept)
                if (self%kept(i)%take < take_min .or. self%kept(i)%take > take_mean) cycle
                value = self%value_now(simulation, i, stat)
                associate (output => self%values(self%first(i)))
                    select case (self%kept(i)%take)
                    case (take_min, take_time_of_min)
                        if (value < self%extreme(i)) then
                            self%extreme(i) = value
                            output = merge(value, t, self%kept(i)%take == take_min)
                        end if
                    case (take_max, take_time_of_max)
                        if (value > self%extreme(i)) then
                            self%extreme(i) = value
                            output = merge(value, t, self%kept(i)%take == take_max)
                        end if
                    case default
                        ! Integral up to this step by the trapezoidal rule.
                        output = output + 0.5_wp*(t - self%t_last)*(self%last(i) + value)
                    end select
                end associate
                self%last(i) = value
            end do
            self%t_last = t
        end associate
        call report_failure(stat, simulation, error)
    end subroutine take_step

    !> Evaluate quantities at requested times within the last step, by dense output.
    subroutine take_between(self, simulation, is_before_event, error)
        class(recorder_type), intent(inout) :: self
        class(simulation_type), intent(inout) :: simulation
        !> True to exclude the end of the step, which is evaluated after the event has changed the state.
        logical, intent(in) :: is_before_event
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: end_of_step, t
        integer :: i, stat

        end_of_step = simulation%state%t
        stat = 0
        do i = 1, size(self%kept)
            if (self%kept(i)%take /= take_times) cycle
            associate (times => self%kept(i)%times)
                do while (self%n_passed(i) < size(times))
                    t = times(self%n_passed(i) + 1)
                    if (t > end_of_step .or. (is_before_event .and. .not. t < end_of_step)) exit
                    call simulation%look_at(t, error)
                    if (.not. allocated(error)) call self%evaluate_shared(simulation, error)
                    if (.not. allocated(error)) then
                        self%n_passed(i) = self%n_passed(i) + 1
                        self%values(self%first(i) + self%n_passed(i) - 1) = self%value_now(simulation, i, stat)
                    end if
                    call simulation%look_back()
                    if (allocated(error)) return
                end do
            end associate
        end do
        call report_failure(stat, simulation, error)
    end subroutine take_between

    !> Evaluate quantities that are defined at the end of the run.
    subroutine finish(self, simulation, error)
        class(recorder_type), intent(inout) :: self
        class(simulation_type), intent(inout) :: simulation
        type(error_type), allocatable, intent(out) :: error
        character(len=:), allocatable :: problem
        integer :: i, stat

        call self%evaluate_shared(simulation, error)
        if (allocated(error)) return
        stat = 0
        do i = 1, size(self%kept)
            associate (kept => self%kept(i), output => self%values(self%first(i)))
                if (kept%kind == of_estimate) then
                    cycle
                else if (kept%kind == of_figure) then
                    call find_figure(simulation%statistics(), kept%figure, output, problem)
                else if (kept%kind == of_event) then
                    call take_event(simulation, kept, output)
                else if (kept%take == take_end) then
                    output = self%value_now(simulation, i, stat)
                else if (kept%take == take_mean) then
                    output = output/(simulation%state%t - self%t_start)
                end if
            end associate
        end do
        call report_failure(stat, simulation, error)
    end subroutine finish

    !> Store the errors estimated by a second run.
    subroutine take_estimate(self, global_error)
        class(recorder_type), intent(inout) :: self
        type(global_error_type), intent(in) :: global_error
        integer :: i

        do i = 1, size(self%kept)
            if (self%kept(i)%kind /= of_estimate) cycle
            associate (output => self%values(self%first(i)))
                select case (self%kept(i)%index)
                case (1)
                    output = global_error%relative
                case (2)
                    output = global_error%largest
                case (3)
                    output = global_error%error_q
                case default
                    output = global_error%error_qd
                end select
            end associate
        end do
    end subroutine take_estimate

    !> Time or number of occurrences of an event.
    subroutine take_event(simulation, kept, value)
        class(simulation_type), intent(in) :: simulation
        type(kept_type), intent(in) :: kept
        !> Unchanged if the event did not occur.
        real(wp), intent(inout) :: value
        integer :: i, n

        n = 0
        do i = 1, simulation%n_events
            if (simulation%events(i)%number /= kept%index) cycle
            n = n + 1
            if (kept%take == take_last .or. (kept%take == take_first .and. n == 1)) value = simulation%events(i)%t
        end do
        if (kept%take == take_count) value = real(n, wp)
    end subroutine take_event

    !> Evaluate the sensors and multipliers, which several quantities may share, at the current state.
    subroutine evaluate_shared(self, simulation, error)
        class(recorder_type), intent(inout) :: self
        class(simulation_type), intent(inout) :: simulation
        type(error_type), allocatable, intent(out) :: error
        integer :: stat

        stat = 0
        associate (state => simulation%state)
            if (self%needs_sensors) call simulation%model%measure(state%t, state%q, state%qd, state%qdd, self%sensors, stat)
        end associate
        if (self%needs_lambda) call simulation%multipliers(self%lambda)
        call report_failure(stat, simulation, error)
    end subroutine evaluate_shared

    !> Value of a quantity at the current state.
    real(wp) function value_now(self, simulation, i, stat) result(value)
        class(recorder_type), intent(in) :: self
        class(simulation_type), intent(inout) :: simulation
        integer, intent(in) :: i
        !> Set to a nonzero value if the evaluation fails.
        integer, intent(inout) :: stat
        real(wp) :: other
        integer :: problem

        problem = 0
        value = 0.0_wp
        associate (index => self%kept(i)%index)
            select case (self%kept(i)%kind)
            case (of_q)
                value = simulation%state%q(index)
            case (of_qd)
                value = simulation%state%qd(index)
            case (of_qdd)
                value = simulation%state%qdd(index)
            case (of_lambda)
                value = self%lambda(index)
            case (of_kinetic)
                call simulation%kinetic_energy(value, problem)
            case (of_potential)
                call simulation%potential_energy(value, problem)
            case (of_energy)
                call simulation%kinetic_energy(value, problem)
                if (problem == 0) call simulation%potential_energy(other, problem)
                if (problem == 0) value = value + other
            case (of_error)
                value = simulation%errors(index)
            case (of_sensor)
                value = self%sensors(index)
            case default
                value = simulation%last_step
            end select
        end associate
        if (problem /= 0) stat = problem
    end function value_now

    !> Set an error if an evaluation has failed.
    subroutine report_failure(stat, simulation, error)
        integer, intent(in) :: stat
        class(simulation_type), intent(in) :: simulation
        type(error_type), allocatable, intent(out) :: error

        if (stat /= 0) call set_error(error, status_callback_failed, 'a kept quantity could not be evaluated at t = '// &
            to_text(simulation%state%t))
    end subroutine report_failure
end module tandem_io_sweep_recorder
