! SPDX-License-Identifier: MIT
!> Comparison of the paper's numerical results with those of tandem: Tables 2 to 4, charts, energies and lane changes.
!>
!> Source: E. J. Haug, Mechanics Based Design of Structures and Machines, 2016, doi 10.1080/15397734.2016.1273783, sections 7 to 9.
!> The runs use the methods of the paper: its charts and limits, bases by singular value decomposition, and its iterations for u, B
!> and H with its tolerances.
module tandem_io_study_paper
    use tandem, only: at_end, error_type, model_type, need_gamma, need_jacobian, need_nu, need_phi, observer_type, options_type, &
        set_error, simulation_type, to_text, wp
    use tandem_io_scene, only: interpret_scene, open_scene, scene_type
    use tandem_io_scene_description, only: description_type
    use tandem_io_scene_registry, only: shipped_models
    use tandem_io_scene_shipped, only: find_scene
    use tandem_io_scene_text, only: to_toml
    use tandem_io_study_journal, only: journal_type
    use tandem_io_study_table, only: brief, cell_length, column_type, real_column, text_column
    use tandem_model_evaluator, only: evaluator_type
    use tandem_model_counts, only: counts_type
    implicit none (type, external)
    private

    public :: paper_type, paper_columns

    !> Columns of the table.
    type(column_type), parameter :: paper_columns(9) = [ &
        column_type('place', 'place', text_column, '', 'source in the paper'), &
        column_type('scene', 'scene', text_column, '', 'name of the scene'), &
        column_type('stepper', 'stepper', text_column, '', 'name of the stepper'), &
        column_type('step', 'h', real_column, 's', 'the step'), &
        column_type('tolerance', 'Tol', real_column, '1', 'utol = Btol = Htol'), &
        column_type('quantity', 'quantity', text_column, '', 'what it is'), &
        column_type('paper', 'paper', text_column, '', 'what the paper prints; empty where it says nothing'), &
        column_type('ours', 'ours', real_column, '', 'what this program finds; energies as a part of that at the start'), &
        column_type('difference', '', text_column, '', 'comment on the difference')]

    !> Results of a run stated in the paper; texts are empty if they are not stated.
    type :: run_type
        character(len=20) :: scene
        character(len=12) :: stepper
        character(len=8) :: place
        real(wp) :: step, tolerance, intol
        !> Exponents of ten of the three constraint errors; 0 if not stated.
        integer :: exponents(3)
        !> Number of charts; significant figures of the energy; flag for the lane change.
        integer :: charts, figures
        logical :: has_lane
    end type run_type

    !> Runs of sections 7, 8 and 9.
    type(run_type), parameter :: runs(19) = [ &
        run_type('articulated_vehicle', 'sdirk54', 'table 2', 1e-3_wp, 1e-6_wp, 1e-4_wp, [-11, -7, -7], 0, 0, .false.), &
        run_type('articulated_vehicle', 'sdirk54', 'table 2', 1e-3_wp, 1e-9_wp, 1e-4_wp, [-13, -11, -11], 0, 0, .false.), &
        run_type('articulated_vehicle', 'sdirk54', 'table 2', 1e-3_wp, 1e-12_wp, 1e-4_wp, [-13, -13, -13], 0, 0, .false.), &
        run_type('rolling_disk', 'sdirk54', 'table 3', 1e-3_wp, 1e-6_wp, 1e-7_wp, [-7, -6, -5], 0, 0, .false.), &
        run_type('rolling_disk', 'sdirk54', 'table 3', 1e-3_wp, 1e-9_wp, 1e-7_wp, [-10, -14, -12], 0, 0, .false.), &
        run_type('rolling_disk', 'sdirk54', 'table 3', 1e-3_wp, 1e-12_wp, 1e-7_wp, [-15, -13, -12], 0, 0, .false.), &
        run_type('motorcycle', 'sdirk54', 'table 4', 1e-3_wp, 1e-6_wp, 1e-6_wp, [-10, -8, -7], 0, 0, .false.), &
        run_type('motorcycle', 'sdirk54', 'table 4', 1e-3_wp, 1e-9_wp, 1e-6_wp, [-13, -13, -13], 0, 0, .false.), &
        run_type('motorcycle', 'sdirk54', 'table 4', 1e-3_wp, 1e-12_wp, 1e-6_wp, [-15, -14, -14], 0, 0, .false.), &
        run_type('articulated_vehicle', 'rk4', 'text', 1e-3_wp, 1e-10_wp, 1e-4_wp, 0, 22, 5, .false.), &
        run_type('articulated_vehicle', 'trapezoid', 'text', 1e-3_wp, 1e-10_wp, 1e-4_wp, 0, 22, 5, .false.), &
        run_type('articulated_vehicle', 'sdirk54', 'text', 1e-3_wp, 1e-10_wp, 1e-4_wp, 0, 22, 5, .false.), &
        run_type('rolling_disk', 'rk4', 'text', 1e-3_wp, 1e-7_wp, 1e-7_wp, 0, 127, 7, .false.), &
        run_type('rolling_disk', 'trapezoid', 'text', 1e-4_wp, 1e-7_wp, 1e-7_wp, 0, 0, 7, .false.), &
        run_type('rolling_disk', 'sdirk54', 'text', 1e-3_wp, 1e-7_wp, 1e-7_wp, 0, 127, 7, .false.), &
        run_type('motorcycle', 'rk4', 'text', 1e-3_wp, 1e-7_wp, 1e-6_wp, 0, 8, 6, .true.), &
        run_type('motorcycle', 'trapezoid', 'text', 1e-3_wp, 1e-7_wp, 1e-6_wp, 0, 8, 6, .true.), &
        run_type('motorcycle', 'sdirk54', 'text', 1e-3_wp, 1e-7_wp, 1e-6_wp, 0, 8, 6, .true.), &
        run_type('motorcycle_chopper', 'sdirk54', 'text', 1e-3_wp, 1e-7_wp, 1e-6_wp, 0, 0, 6, .true.)]

    !> Records the quantities of the paper: constraint errors in the units of their rows, and the energy.
    type, extends(observer_type) :: figures_type
        !> Max-norms of the position, velocity and acceleration errors over all steps.
        real(wp) :: errors(3) = 0.0_wp
        !> Largest change of the energy, relative to the energy at the start.
        real(wp) :: energy_change = 0.0_wp
        !> Separate model for evaluations, which leaves the model of the run unaffected.
        class(model_type), allocatable :: twin
        type(evaluator_type), private :: evaluator
        type(counts_type), private :: counts
        real(wp), private :: energy_at_start = 0.0_wp
        logical, private :: has_begun = .false.
    contains
        procedure :: observe
    end type figures_type

    type :: paper_type
        !> Rows computed so far.
        type(journal_type) :: journal
        integer, private :: current = 0
        !> Keys of the scene of the last run, and name of the scene.
        type(description_type), private :: keys
        character(len=:), allocatable, private :: opened
    contains
        procedure :: next_run
        procedure, nopass :: total
        procedure, private :: is_there, put
    end type paper_type

contains

    !> Number of runs.
    pure integer function total()
        total = size(runs)
    end function total

    !> Carry out the next run with missing rows, and append the rows; `finished` if there is none.
    subroutine next_run(self, finished, what, error)
        class(paper_type), intent(inout) :: self
        logical, intent(out) :: finished
        !> Description of the run.
        character(len=:), allocatable, intent(out) :: what
        type(error_type), allocatable, intent(out) :: error
        integer :: k

        what = ''
        do
            self%current = self%current + 1
            k = self%current
            finished = k > size(runs)
            if (finished) return
            ! The last row of a run is the energy for runs of the text, and the acceleration for runs of a table.
            if (runs(k)%place == 'text' .and. self%is_there(runs(k), last_of(runs(k)))) cycle
            if (runs(k)%place /= 'text' .and. self%is_there(runs(k), 'acceleration error')) cycle
            exit
        end do
        what = trim(runs(k)%scene)//', '//trim(runs(k)%stepper)//', tolerance '//brief(runs(k)%tolerance)
        call do_run(self, runs(k), error)
    end subroutine next_run

    !> Last quantity of a run.
    pure function last_of(run) result(name)
        type(run_type), intent(in) :: run
        character(len=:), allocatable :: name

        name = 'energy change'
        if (run%has_lane) name = 'lane change [m]'
    end function last_of

    !> Carry out a run and append its rows.
    subroutine do_run(self, run, error)
        class(paper_type), intent(inout) :: self
        type(run_type), intent(in) :: run
        type(error_type), allocatable, intent(out) :: error
        character(len=*), parameter :: levels(3) = [character(len=18) :: 'position error', 'velocity error', 'acceleration error']
        type(scene_type), target :: scene
        type(simulation_type) :: simulation
        type(figures_type) :: figures
        type(options_type) :: options
        character(len=:), allocatable :: path
        character(len=16) :: printed
        real(wp) :: on_scale(3)
        integer :: i, charts

        if (.not. allocated(self%opened)) self%opened = ''
        if (self%opened /= run%scene) then
            call find_scene(trim(run%scene), path, error)
            if (.not. allocated(error)) call open_scene(path, [character(len=1) ::], shipped_models(), self%keys, error)
            if (allocated(error)) return
            self%opened = trim(run%scene)
        end if
        call interpret_scene(self%keys, shipped_models(), scene, error)
        if (allocated(error)) return
        options = options_type(stepper=run%stepper, step=run%step, chart='paper', refresh='refine', basis='svd', &
            constraint_tolerance=run%tolerance, utol=run%tolerance, btol=run%tolerance, htol=run%tolerance)
        if (run%stepper /= 'rk4') options%intol = run%intol
        select case (run%scene)
        case ('articulated_vehicle')
            options%v_limit = 10.0_wp
        case ('rolling_disk')
            options%v_limit = 0.7_wp
        case default
            options%v_limit = 20.0_wp
        end select
        allocate (figures%twin, source=scene%model)
        call simulation%initialize(scene%model, options, scene%t_start, scene%q, scene%qd, error)
        if (.not. allocated(error)) call simulation%integrate(scene%t_end, error, figures)
        if (allocated(error)) return
        associate (s => simulation%statistics())
            on_scale = [s%position_error, s%velocity_error, s%acceleration_error]
            charts = int(s%charts)
        end associate
        if (run%place /= 'text') then
            do i = 1, 3
                write (printed, '("E", i0)') run%exponents(i)
                call self%put(run, trim(levels(i)), trim(printed), to_toml(figures%errors(i)), &
                    about_error(run, i, figures%errors(i), on_scale(i)), error)
                if (allocated(error)) return
            end do
            return
        end if
        printed = ''
        if (run%charts > 0) printed = to_text(run%charts)
        call self%put(run, 'charts', trim(printed), to_text(charts), about_charts(charts, run%charts), error)
        if (.not. allocated(error)) call self%put(run, 'energy change', to_text(run%figures)//' figures', &
            to_toml(figures%energy_change), about_energy(run, figures%energy_change), error)
        if (run%has_lane .and. .not. allocated(error)) call self%put(run, 'lane change [m]', 'about 4', &
            to_toml(abs(simulation%state%q(1))), 'the same, as far as the paper states', error)
    end subroutine do_run

    !> Append a row, unless it exists.
    subroutine put(self, run, quantity, printed, ours, difference, error)
        class(paper_type), intent(inout) :: self
        type(run_type), intent(in) :: run
        !> Quantity, its value in the paper, its value computed here, and a remark about the difference.
        character(len=*), intent(in) :: quantity, printed, ours, difference
        type(error_type), allocatable, intent(out) :: error
        character(len=cell_length) :: cells(size(paper_columns))

        if (self%is_there(run, quantity)) return
        associate (table => self%journal%table)
            cells = table%new_row()
            call table%put(cells, 'place', trim(run%place))
            call table%put(cells, 'scene', trim(run%scene))
            call table%put(cells, 'stepper', trim(run%stepper))
            call table%put(cells, 'step', run%step)
            call table%put(cells, 'tolerance', run%tolerance)
            call table%put(cells, 'quantity', quantity)
            call table%put(cells, 'paper', printed)
            call table%put(cells, 'ours', ours)
            call table%put(cells, 'difference', difference)
        end associate
        call self%journal%append(cells, error)
    end subroutine put

    !> True if a row exists.
    logical function is_there(self, run, quantity)
        class(paper_type), intent(in) :: self
        type(run_type), intent(in) :: run
        character(len=*), intent(in) :: quantity
        integer :: row

        associate (table => self%journal%table)
            do row = table%rows(), 1, -1
                is_there = table%text_at(row, 'place') == run%place .and. table%text_at(row, 'scene') == run%scene .and. &
                    table%text_at(row, 'stepper') == run%stepper .and. table%text_at(row, 'quantity') == quantity .and. &
                    abs(table%real_at(row, 'tolerance')/run%tolerance - 1.0_wp) < 1.0e-9_wp
                if (is_there) return
            end do
        end associate
        is_there = .false.
    end function is_there

    !> Remark about a constraint error.
    function about_error(run, level, ours, on_scale) result(text)
        type(run_type), intent(in) :: run
        !> Level of the constraint: 1 position, 2 velocity, 3 acceleration.
        integer, intent(in) :: level
        !> Error in the units of its row, and on its natural scale.
        real(wp), intent(in) :: ours, on_scale
        character(len=:), allocatable :: text
        integer :: decades

        decades = nint(log10(max(ours, tiny(1.0_wp)))) - run%exponents(level)
        if (abs(decades) <= 1) then
            text = 'the same order of magnitude'
        else if (decades < 0) then
            text = to_text(-decades)//' decades less: the last correction of u leaves far less than Tol'
            if (level == 2) text = to_text(-decades)//' decades less: H, good to Tol, acts on a violation that is small already'
        else if (on_scale <= 1.1_wp*run%tolerance) then
            text = to_text(decades)//" decades more: Tol is met on the row's natural scale, where it is "//brief(on_scale)
        else
            text = to_text(decades)//' decades more: '//brief(on_scale)//' on the natural scale; Tol bounds u, B and H, not this'
        end if
    end function about_error

    !> Remark about the number of charts.
    function about_charts(ours, printed) result(text)
        integer, intent(in) :: ours, printed
        character(len=:), allocatable :: text

        text = 'the same, the initial chart counted'
        if (printed == 0) text = 'not stated in the paper'
        if (printed /= 0 .and. ours /= printed) text = 'different: |v| exceeds its limit after other steps'
    end function about_charts

    !> Remark about the energy.
    function about_energy(run, ours) result(text)
        type(run_type), intent(in) :: run
        real(wp), intent(in) :: ours
        character(len=:), allocatable :: text
        integer :: figures

        figures = floor(-log10(max(ours, epsilon(1.0_wp))))
        select case (run%scene)
        case ('articulated_vehicle')
            text = 'the kinetic energy'
        case ('rolling_disk')
            text = 'the total energy (the kinetic one varies from 7.5 to 56 J)'
        case default
            text = 'the total energy, on which the steering does work'
        end select
        text = text//', constant to '//to_text(figures)//' figures'
        if (figures < run%figures) text = text//', fewer than printed'
    end function about_energy

    !> Record the errors and the energy of a state.
    subroutine observe(self, simulation, occasion, error)
        class(figures_type), intent(inout) :: self
        class(simulation_type), intent(inout) :: simulation
        !> `at_start`, `at_step`, `at_event` or `at_end`.
        integer, intent(in) :: occasion
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: kinetic, potential
        integer :: stat

        if (occasion == at_end) return
        if (.not. self%has_begun) call self%evaluator%initialize(self%twin)
        self%twin%segment = simulation%model%segment
        associate (state => simulation%state, terms => self%evaluator%terms)
            call self%evaluator%evaluate(need_phi + need_jacobian + need_nu + need_gamma, state%t, state%q, state%qd, &
                self%counts, stat)
            if (stat == 0) then
                self%errors(1) = max(self%errors(1), maxval(abs(terms%phi)))
                self%errors(2) = max(self%errors(2), maxval(abs(matmul(terms%jacobian, state%qd) - terms%nu)))
                self%errors(3) = max(self%errors(3), maxval(abs(matmul(terms%jacobian, state%qdd) + terms%gamma)))
                call simulation%kinetic_energy(kinetic, stat)
            end if
        end associate
        potential = 0.0_wp
        if (stat == 0 .and. associated(simulation%model%potential_energy)) call simulation%potential_energy(potential, stat)
        if (stat /= 0) then
            call set_error(error, stat, 'the figures could not be evaluated at t = '//to_text(simulation%state%t))
            return
        end if
        if (.not. self%has_begun) self%energy_at_start = kinetic + potential
        self%has_begun = .true.
        self%energy_change = max(self%energy_change, abs(kinetic + potential - self%energy_at_start)/abs(self%energy_at_start))
    end subroutine observe
end module tandem_io_study_paper
