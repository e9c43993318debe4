! SPDX-License-Identifier: MIT
!> Set-up of a simulation: checks the request, clears the results of an earlier run, and allocates work space.
submodule(tandem_simulation) tandem_simulate_setup
    use tandem_model_terms, only: need_nu
    use tandem_model_segment, only: find_segment
    implicit none (type, external)

contains

    module procedure initialize
        self%is_ready = .false.
        call check_input(model, options, t, q, qd, error)
        if (allocated(error)) return
        call clear_run(self)
        self%model => model
        self%options = options
        if (present(stepper)) then
            self%method = stepper%properties()
            self%options%stepper = self%method%name
            call complete_options(self%options, error, self%method%estimate_order > 0)
        else
            call complete_options(self%options, error)
        end if
        if (allocated(error)) return
        self%t_start = t
        self%attempts%counted_from = t
        self%attempts%creeps_from = t
        call self%work%set(options%max_evaluations, options%max_seconds)
        if (present(stepper)) allocate (self%own%stepper, source=stepper)
        call self%allocate_stepper(is_partner=.false.)
        self%method = self%stepper%properties()
        self%auto%explicit_method = self%method
        call check_method(self%method, self%options, error)
        if (allocated(error)) return
        if (present(control)) then
            allocate (self%control, source=control)
        else
            allocate (self%control)
        end if
        self%stepper%projects_stages = projects_stages(self%options)
        if (present(chart)) allocate (self%own%chart, source=chart)
        if (present(chart)) then
            self%is_sparse = is_sparse_chart(chart)
        else
            call choose_chart(model, self%options, self%method%implicit, self%is_sparse, self%cost)
        end if
        call find_segment(model, t, error)
        if (allocated(error)) return
        ! Set in place, because copies would fragment the memory.
        call self%state%begin(t, q, qd)
        call model%arrive(t, self%state%q, .true.)
        call model%set_time_scale(t, self%state%q, self%state%qd)
        ! Before the chart allocates its memory.
        if (present(assembly)) call assemble(model, assembly, t, self%state%q, self%state%qd, error)
        if (allocated(error)) return
        call model%arrive(t, self%state%q, .false.)
        call self%allocate_chart()
        if (.not. self%has_surplus_rows()) call self%chart%attach(model, self%options, &
            self%method%implicit, self%method%damps, error)
        if (allocated(error)) return
        call allocate_work(self, model%scales(), model%time_scale)
        call self%next%allocate(model%n)
        call self%crossing%initialize(model%n_constraints() > 0, options%singular == singular_modes(1), model%n)
        call self%accept_start(error)
        self%is_ready = .not. allocated(error)
        call self%crossing%note(self%state)
        if (.not. present(assembly)) return
        self%tally%start_moved_q = maxval(abs(self%state%q - q))
        self%tally%start_moved_qd = maxval(abs(self%state%qd - qd))
    end procedure initialize

    module procedure allocate_stepper
        if (is_partner) then
            call new_stepper(self%auto%explicit_method%partner, self%stepper)
        else if (allocated(self%own%stepper)) then
            if (allocated(self%stepper)) deallocate (self%stepper)
            allocate (self%stepper, source=self%own%stepper)
        else
            call new_stepper(self%options%stepper, self%stepper)
        end if
    end procedure allocate_stepper

    !> Refuse a model, options or a start that is invalid for any run.
    subroutine check_input(model, options, t, q, qd, error)
        class(model_type), intent(inout) :: model
        type(options_type), intent(in) :: options
        real(wp), intent(in) :: t, q(:), qd(:)
        type(error_type), allocatable, intent(out) :: error

        call check_model(model, error)
        if (allocated(error)) return
        call options%check_sizes(model%n, error)
        if (.not. allocated(error)) call options%check(error)
        if (allocated(error)) return
        if (size(q) /= model%n .or. size(qd) /= model%n) then
            call set_error(error, status_invalid_option, 'q0 and qd0 have '//to_text(size(q))//' and '// &
                to_text(size(qd))//' entries, the model has n = '//to_text(model%n), 'give n entries each')
            return
        end if
        if (.not. (ieee_is_finite(t) .and. all(ieee_is_finite(q)) .and. all(ieee_is_finite(qd)))) then
            call set_error(error, status_invalid_option, 'the start time, q0 or qd0 is not finite', 'use finite numbers')
            return
        end if
    end subroutine check_input

    !> Refuse options that the stepper does not support.
    subroutine check_method(method, options, error)
        type(properties_type), intent(in) :: method
        type(options_type), intent(in) :: options
        type(error_type), allocatable, intent(out) :: error

        if (method%order < 1 .or. method%estimate_order < 0 .or. method%name == '') then
            call set_error(error, status_invalid_option, 'the user-supplied stepper "'//trim(method%name)//'" has order '// &
                to_text(method%order)//' and estimates of order '//to_text(method%estimate_order), &
                'its properties must have a name, an order of at least 1 and estimate_order >= 0')
        else if (method%partner /= '' .and. .not. any(stepper_choices == method%partner)) then
            call set_error(error, status_invalid_option, 'the stepper "'//trim(method%name)//'" has the partner "'// &
                trim(method%partner)//'", which is unknown', 'name a stepper of tandem, or none')
        else if (.not. (method%has_fixed_steps() .or. options%is_adaptive())) then
            call set_error(error, status_invalid_option, 'step is given, but '//trim(options%stepper)//' chooses between '// &
                trim(merge('orders ', 'methods', method%varies))//' by their cost under error control', &
                'give rtol instead of step, or choose a method for fixed steps')
        else if (options%is_adaptive() .and. method%estimate_order == 0) then
            call set_error(error, status_invalid_option, 'rtol is given, but '//trim(options%stepper)// &
                ' has no error estimate', 'give step instead of rtol, or choose another stepper')
        else if (options%projection == projections(3) .and. method%implicit) then
            call set_error(error, status_invalid_option, 'projection = "'//trim(options%projection)//'", but the stages of '// &
                trim(options%stepper)//' are implicit: Newton''s iteration solves for points of the manifold', &
                'remove it, or use an explicit stepper')
        end if
    end subroutine check_method

    !> Clear the results of an earlier run.
    subroutine clear_run(self)
        class(simulation_type), intent(inout) :: self

        self%tally = statistics_type()
        self%auto%stiffness = stiffness_type()
        self%between%next_look = huge(1.0_wp)
        self%grid_steps = 0
        self%on_grid = .true.
        self%last_step = 0.0_wp
        self%attempts%cause = status_ok
        self%attempts%is_interrupted = .false.
        self%lost_rank = lost_rank_type()
        self%n_crossings = 0
        call self%attempts%reach%begin()
        self%attempts%count = 0
        self%attempts%count_of_look = 0
        self%attempts%n_collapsed = 0
        call self%attempts%slowing%restart()
        self%attempts%has_overlooked = .false.
        self%renewal%is_done = .false.
        self%n_redundant = 0
        self%renewal%reason = 0
        self%n_events = 0
        self%is_stopped = .false.
        self%stopped_by = ''
        self%watch = event_watch_type()
        if (allocated(self%warnings)) deallocate (self%warnings)
        if (allocated(self%own%chart)) deallocate (self%own%chart)
        self%energy = kinetic_energy_type()
        if (allocated(self%own%stepper)) deallocate (self%own%stepper)
        if (allocated(self%control)) deallocate (self%control)
        if (allocated(self%events)) deallocate (self%events)
    end subroutine clear_run

    module procedure watch_constraints
        ! The velocity gap of implicit steps also contains the remaining error of Newton's iterations, which shorter steps do not
        ! reduce.
        call self%local_error%allow_gap(merge(huge(1.0_wp), warning_limit(self%options), self%method%implicit))
        ! Constraints that depend on time impose motions.
        call self%local_error%count_imposed(self%method%implicit .and. iand(self%model%has_terms(), need_nu) /= 0)
    end procedure watch_constraints

    !> Allocate states, and the work space of estimates, controllers and steps.
    subroutine allocate_work(self, scale, time_scale)
        class(simulation_type), intent(inout) :: self
        real(wp), intent(in) :: scale(:), time_scale
        class(stepper_type), allocatable :: partner
        type(properties_type) :: of_partner
        real(wp), allocatable :: largest_q(:)

        if (allocated(self%model%coordinate_period)) allocate (largest_q(self%model%n), &
            source=merge(self%model%coordinate_period/2, huge(1.0_wp), self%model%coordinate_period > 0.0_wp))
        call self%control%initialize(self%options, scale, time_scale, self%method, largest_q)
        call self%local_error%initialize(scale, 1.0_wp/time_scale, self%options%is_adaptive() .or. self%method%order > 5, &
            largest_q)
        call watch_constraints(self)
        if (self%method%stability_limit > 0.0_wp .and. self%options%is_adaptive()) then
            call self%auto%stiffness%smoothness%initialize(self%model%n)
        end if
        if (self%method%partner /= '') then
            call new_stepper(self%method%partner, partner)
            of_partner = partner%properties()
        end if
        call self%auto%switching%begin(self%method%partner /= '', scale, time_scale, self%t_start, of_partner%estimate_order)
        self%stepper%time_scale = time_scale
        call self%stepper%initialize(scale, self%options%newton_tolerance())
        self%start = state_type()
        self%end_is_apart = .false.
        call self%between%output%initialize()
    end subroutine allocate_work
end submodule tandem_simulate_setup
