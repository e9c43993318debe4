! SPDX-License-Identifier: MIT
!> Report of a run: its settings, cost and errors, and the quantities that were computed or omitted.
module tandem_cli_report
    use tandem, only: derivative_name, error_type, find_error_warnings, global_error_type, long, mechanism_type, &
        n_derivatives, n_reasons, n_terms, new_stepper, options_type, projects_stages, properties_type, reason_name, &
        simulation_type, statistics_type, status_output_failed, term_name, warning_type, wp
    use tandem_cli_messages, only: print_to_stderr, say
    use tandem_cli_moves, only: moves_text
    use tandem_io, only: scene_type, to_toml, trajectory_type
    use tandem_status, only: status_interrupted
    use tandem_stepper, only: stepper_type
    implicit none (type, external)
    private

    public :: chart_text, print_warnings_on_stderr, cost_text, print_report, print_warnings, print_line, short, count_text, counted

    !> Indentation of the text after its label, and width of a line.
    integer, parameter :: indent = 18, width = 110

    !> Text of items separated by commas.
    type :: phrase_type
        character(len=:), allocatable :: text
    contains
        procedure :: add
    end type phrase_type

contains

    !> Print the report of a run.
    subroutine print_report(scene, simulation, trajectory, error, global_error, estimate_error)
        type(scene_type), intent(in) :: scene
        type(simulation_type), intent(in) :: simulation
        type(trajectory_type), intent(in) :: trajectory
        !> Error that ended the run, if any.
        type(error_type), allocatable, intent(in) :: error
        !> Estimated error of the run, if requested and successful.
        class(global_error_type), intent(in) :: global_error
        !> Reason why the estimate failed.
        type(error_type), allocatable, intent(in) :: estimate_error
        type(statistics_type) :: s
        character(len=:), allocatable :: steps

        s = simulation%statistics()
        call say(scene%name//': '//scene%description)
        associate (options => scene%options)
            steps = 'h = '//to_toml(options%step)//' s'
            if (options%is_adaptive()) steps = tolerances(options, scene%model%n)
            call print_line('solver', trim(options%stepper)//', '//steps//', '//chart_text(simulation)//' '// &
                trim(options%chart)//', refresh '//trim(options%refresh))
            if (simulation%cost%dense > 0.0_wp) call print_line('cost of a step', cost_text(simulation))
        end associate
        if (allocated(error)) then
            call print_line('time', to_toml(scene%t_start)//' to '//short(simulation%state%t, 6)//' s of '// &
                to_toml(scene%t_end)//' s: '//trim(merge('INTERRUPTED', 'FAILED     ', error%stat == status_interrupted))// &
                ' after '//counted(s%steps, 'step'))
        else if (simulation%is_stopped) then
            call print_line('time', to_toml(scene%t_start)//' to '//short(simulation%state%t, 6)//' s of '// &
                to_toml(scene%t_end)//' s in '//counted(s%steps, 'step')//', stopped by "'//trim(simulation%stopped_by)// &
                '" at t = '//short(simulation%state%t, 12)//' s')
        else
            call print_line('time', to_toml(scene%t_start)//' to '//to_toml(scene%t_end)//' s in '// &
                counted(s%steps, 'step'))
        end if
        if (size(scene%events) > 0) call print_events(scene, simulation)
        if (simulation%n_crossings > 0) call print_crossings(simulation)
        if (scene%options%is_adaptive() .and. s%steps > 0) call print_line('step sizes', short(s%smallest_step, 3)//' to '// &
            short(s%largest_step, 3)//' s, '//counted(s%rejected, 'step')//' rejected for the error, '// &
            count_text(s%failed)//' not completed')
        if (s%is_stiff .or. s%advised /= '') call print_line('stiff', stiff(s, scene%options%is_adaptive()))
        if (s%switches > 0) call print_line('methods', counted(s%switches, 'exchange')//', '//count_text(s%implicit_steps)// &
            ' steps implicit')
        call print_line('charts', charts(s))
        call print_line('run time', short(s%wall_seconds, 3)//' s, CPU '//short(s%cpu_seconds, 3)//' s, '// &
            short(1.0e6_wp*s%wall_seconds/real(max(1_long, s%steps), wp), 3)//' microseconds per step')
        call print_line('largest errors', 'position '//short(s%position_error, 2)//', velocity '// &
            short(s%velocity_error, 2)//', acceleration '//short(s%acceleration_error, 2)// &
            ' over all steps (tolerance '//to_toml(scene%options%constraint_tolerance)//", on each row's natural scale)")
        if (s%local_error_steps > 0) call print_line('local error', short(s%local_error, 2)//' per step at most, '// &
            short(s%local_error_sum, 2)//' summed over the run, without amplification by the motion')
        if (allocated(estimate_error)) call print_line('error at end', 'not known: '//estimate_error%message)
        if (global_error%is_known) then
            call print_line('error at end', error_at_end(global_error, scene))
        else if (.not. (allocated(estimate_error) .or. allocated(error) .or. simulation%is_stopped)) then
            call print_line('error at end', 'not estimated; use --error for a second run')
        end if
        call print_warnings(simulation)
        call print_error_warnings(simulation, global_error, estimate_error)
        if (s%gamma_noise > 0.0_wp) then
            call print_line('noise of gamma', short(s%gamma_noise, 2)// &
                ' of its natural scale, since the model leaves gamma to differences')
        end if
        call print_line('start moved', 'q by '//short(s%start_moved_q, 2)//', qd by '//short(s%start_moved_qd, 2))
        if (allocated(scene%assembly)) call print_line('assembled', moves_text(scene%model, scene%assembly))
        select type (model => scene%model)
        class is (mechanism_type)
            if (.not. maxval(abs(model%gravity)) > 0.0_wp) call print_line('gravity', 'no gravity ([gravity] vector is not given)')
        end select
        if (s%velocity_jump > 0.0_wp) call print_line('velocity jump', short(s%velocity_jump, 6))
        call print_energy(trajectory)
        call print_line('output', scene%output%file//', '//rows_text(trajectory, error))
        call print_line('computed', computed(s))
        call print_line('left out', left_out(s, scene))
    end subroutine print_report

    !> Estimated error of the run.
    function error_at_end(global_error, scene) result(text)
        class(global_error_type), intent(in) :: global_error
        type(scene_type), intent(in) :: scene
        character(len=:), allocatable :: text

        associate (g => global_error)
            text = 'q '//short(g%error_q, 2)//name_of(g%worst_q)//', qd '//short(g%error_qd, 2)//name_of(g%worst_qd)//', '// &
                short(g%largest, 2)//' of |y| + scale at most, at t = '//short(g%t_largest, 3)//' s, '
            if (g%is_bound) then
                text = text//'an upper bound, by a second run with ten times the tolerance'
            else if (scene%options%is_adaptive()) then
                text = text//'estimated by a second run with a tenth of the tolerance'
            else
                text = text//'estimated by a second run with half the step'
            end if
            text = text//' ('//count_text(g%right_hand_sides)//' right-hand sides, '//short(g%seconds, 3)//' s)'
        end associate
    contains
        !> Name of a coordinate in parentheses, if it has one.
        function name_of(i) result(name)
            integer, intent(in) :: i
            character(len=:), allocatable :: name

            name = ''
            if (.not. (allocated(scene%model%coordinate_name) .or. scene%model%composes_labels)) return
            name = ' ('//scene%model%coordinate_label(i)//')'
        end function name_of
    end function error_at_end

    !> Print the warnings of a run.
    subroutine print_warnings(simulation)
        type(simulation_type), intent(in) :: simulation
        integer :: i

        if (.not. allocated(simulation%warnings)) return
        do i = 1, size(simulation%warnings)
            call print_line(trim(merge('note   ', 'WARNING', simulation%warnings(i)%is_note)), simulation%warnings(i)%text)
        end do
    end subroutine print_warnings

    !> Print warnings about the accuracy of the result.
    subroutine print_error_warnings(simulation, global_error, estimate_error)
        type(simulation_type), intent(in) :: simulation
        !> Estimated error of the run; reason why the estimate failed.
        class(global_error_type), intent(in) :: global_error
        type(error_type), allocatable, intent(in) :: estimate_error
        type(warning_type), allocatable :: warnings(:)
        integer :: i

        call find_error_warnings(simulation%options, simulation%statistics(), warnings, global_error, estimate_error)
        do i = 1, size(warnings)
            call print_line('WARNING', warnings(i)%text)
        end do
    end subroutine print_error_warnings

    !> Print all warnings on stderr, for a run without report.
    subroutine print_warnings_on_stderr(simulation, global_error, estimate_error)
        type(simulation_type), intent(in) :: simulation
        class(global_error_type), intent(in) :: global_error
        type(error_type), allocatable, intent(in) :: estimate_error
        type(warning_type), allocatable :: warnings(:)
        integer :: i

        if (allocated(simulation%warnings)) then
            do i = 1, size(simulation%warnings)
                call print_to_stderr(trim(merge('note:   ', 'WARNING:', simulation%warnings(i)%is_note))//' '// &
                    simulation%warnings(i)%text)
            end do
        end if
        call find_error_warnings(simulation%options, simulation%statistics(), warnings, global_error, estimate_error)
        do i = 1, size(warnings)
            call print_to_stderr('WARNING: '//warnings(i)%text)
        end do
    end subroutine print_warnings_on_stderr

    !> Warning about an explicit stepper on a stiff model, with a recommended stepper if there is one.
    function stiff(s, is_adaptive) result(text)
        type(statistics_type), intent(in) :: s
        !> True if steps are chosen by error control.
        logical, intent(in) :: is_adaptive
        character(len=:), allocatable :: text

        text = 'steps are shorter than the motion requires'
        if (s%is_stiff) text = 'from t = '//short(s%stiff_from, 4)//' s, steps are limited by stability, not by accuracy'
        if (s%advised /= '') then
            text = text//', '//trim(s%advised)//' would take about '//count_text(int(max(1, nint(100*s%implicit_part)), long))// &
                ' % of the work, estimated from the smoothness of the motion'
        else if (is_adaptive) then
            text = text//', but an implicit stepper would hardly be faster'
        else
            text = 'from t = '//short(s%stiff_from, 4)//' s, steps are at the limit of stability, an implicit stepper (radau5) '// &
                'could take larger ones'
        end if
    end function stiff

    !> Tolerances of the steps; if they differ, the range.
    function tolerances(options, n) result(text)
        type(options_type), intent(in) :: options
        !> Number of coordinates.
        integer, intent(in) :: n
        character(len=:), allocatable :: text
        real(wp) :: rtol(n, 2), atol(n, 2)

        call options%fill_tolerances(rtol(:, 1), rtol(:, 2), atol(:, 1), atol(:, 2))
        text = 'rtol '//range_of(rtol)//', atol '//range_of(atol)
    end function tolerances

    !> Range of some numbers, or their common value.
    function range_of(values) result(text)
        real(wp), intent(in) :: values(:, :)
        character(len=:), allocatable :: text

        text = to_toml(minval(values))
        if (maxval(values) > minval(values)) text = text//' to '//to_toml(maxval(values))
    end function range_of

    !> Print the number and the first times of each event.
    subroutine print_events(scene, simulation)
        type(scene_type), intent(in) :: scene
        type(simulation_type), intent(in) :: simulation
        !> Number of times printed per event.
        integer, parameter :: most_times = 4
        character(len=:), allocatable :: times
        integer :: i, k, n

        do i = 1, size(scene%events)
            times = ''
            n = 0
            do k = 1, simulation%n_events
                if (simulation%events(k)%number /= i) cycle
                n = n + 1
                if (n == 1) times = ' at t = '
                if (n > 1 .and. n <= most_times) times = times//', '
                if (n <= most_times) times = times//short(simulation%events(k)%t, 9)
            end do
            if (n > most_times) times = times//', ...'
            if (n > 0) times = times//' s'
            call print_line(trim(merge('event', '     ', i == 1)), trim(scene%events(i)%name)//' '// &
                counted(int(n, long), 'time')//times)
        end do
    end subroutine print_events

    !> Print number, first times with errors, and largest error of the singular configurations that were passed.
    subroutine print_crossings(simulation)
        type(simulation_type), intent(in) :: simulation
        !> Number of times shown.
        integer, parameter :: most_times = 4
        character(len=:), allocatable :: times
        integer :: k

        times = ' at t = '
        associate (n => simulation%n_crossings, crossings => simulation%crossings)
            do k = 1, min(n, most_times)
                if (k > 1) times = times//', '
                times = times//short(crossings(k)%t, 9)//' s ('//short(crossings(k)%error, 1)//')'
            end do
            if (n > most_times) times = times//', ...'
            call print_line('singular', 'passed '//counted(int(n, long), 'time')//times//'; estimated errors in parentheses, '// &
                short(maxval(crossings(:n)%error), 2)//' of |y| + scale at most')
        end associate
    end subroutine print_crossings

    !> Contents of the result file.
    function rows_text(trajectory, error) result(text)
        type(trajectory_type), intent(in) :: trajectory
        type(error_type), allocatable, intent(in) :: error
        character(len=:), allocatable :: text

        text = counted(trajectory%rows, 'row')
        if (.not. allocated(error)) return
        if (error%stat == status_output_failed) text = 'INCOMPLETE: the file could not be completed'
    end function rows_text

    !> Print the energy and its drift, if they were written.
    subroutine print_energy(trajectory)
        type(trajectory_type), intent(in) :: trajectory
        character(len=:), allocatable :: name, text

        associate (energy => trajectory%energy)
            if (.not. (energy%has_kinetic .or. energy%has_potential)) return
            name = 'kinetic + potential'
            if (.not. energy%has_potential) name = 'kinetic'
            if (.not. energy%has_kinetic) name = 'potential'
            text = name//' '//short(energy%at_start, 9)//' J at the start, off by '//short(energy%deviation, 2)// &
                ' J at most at the rows'
            if (abs(energy%at_start) > 0.0_wp) then
                text = text//' ('//short(energy%deviation/abs(energy%at_start), 2)//' of it)'
            end if
        end associate
        call print_line('energy', text)
    end subroutine print_energy

    !> Number of charts, and the reasons for changing charts.
    function charts(s) result(text)
        type(statistics_type), intent(in) :: s
        character(len=:), allocatable :: text
        type(phrase_type) :: phrase
        integer :: i

        do i = 1, n_reasons
            if (s%charts_by(i) > 0) call phrase%add(trim(reason_name(i))//' '//count_text(s%charts_by(i)))
        end do
        text = count_text(s%charts)
        if (allocated(phrase%text)) text = text//': '//phrase%text
    end function charts

    !> Computed quantities and the numbers of evaluations.
    function computed(s) result(text)
        type(statistics_type), intent(in) :: s
        character(len=:), allocatable :: text
        type(phrase_type) :: phrase
        integer :: i

        call add_count(phrase, 'right-hand sides', s%right_hand_sides)
        do i = 1, n_terms
            call add_count(phrase, trim(term_name(i)), s%terms(i))
        end do
        call add_count(phrase, 'calls of evaluate', s%fused_calls)
        call add_count(phrase, 'implicit stages', s%implicit_stages)
        call add_count(phrase, 'Newton corrections', s%newton_corrections)
        call add_count(phrase, 'Newton matrices', s%newton_matrices)
        call add_count(phrase, 'factorizations of Newton matrices', s%newton_factorizations)
        do i = 1, n_derivatives
            call add_count(phrase, trim(derivative_name(i)), s%derivatives(i))
        end do
        call add_count(phrase, 'terms for derivatives by differences', s%difference_evaluations)
        call add_count(phrase, 'terms for gamma by differences', s%gamma_evaluations)
        call add_count(phrase, 'corrections of u', s%position_corrections)
        call add_count(phrase, 'corrections of B', s%b_corrections)
        call add_count(phrase, 'corrections of H', s%h_corrections)
        call add_count(phrase, 'factorizations of Phi_q U', s%position_factorizations)
        call add_count(phrase, 'factorizations of C', s%constraint_factorizations)
        call add_count(phrase, "factorizations of D'M D", s%mass_factorizations)
        call add_count(phrase, 'factorizations for bases', s%basis_factorizations)
        call add_count(phrase, 'multipliers', s%multipliers)
        call add_count(phrase, 'kinetic energies', s%kinetic_energies)
        call add_count(phrase, 'potential energies', s%potential_energies)
        text = phrase%text
    end function computed

    !> Quantities that were not computed because the scene does not need them.
    function left_out(s, scene) result(text)
        type(statistics_type), intent(in) :: s
        type(scene_type), intent(in) :: scene
        character(len=:), allocatable :: text
        type(phrase_type) :: phrase
        type(properties_type) :: properties
        class(stepper_type), allocatable :: stepper
        integer :: i

        if (scene%model%n_holonomic == 0) call phrase%add('holonomic constraints (the model has none)')
        if (scene%model%n_nonholonomic == 0) call phrase%add('nonholonomic constraints (the model has none)')
        do i = 1, n_terms
            if (s%terms(i) > 0) cycle
            select case (trim(term_name(i)))
            case ('nu')
                call phrase%add('nu (C qd = 0)')
            case default
                call phrase%add(trim(term_name(i))//' (the model has none)')
            end select
        end do
        if (scene%model%constant_mass) call phrase%add('further evaluations of the mass matrix (it is constant)')
        if (s%multipliers == 0) call phrase%add('multipliers (not requested)')
        if (s%kinetic_energies + s%potential_energies == 0) call phrase%add('energies (not requested)')
        call new_stepper(scene%options%stepper, stepper)
        properties = stepper%properties()
        if (properties%implicit .or. s%implicit_steps > 0) then
            do i = 1, n_derivatives
                if (s%derivatives(i) == 0) call phrase%add(trim(derivative_name(i))//' (zero or by differences)')
            end do
        else
            call phrase%add('derivatives (the stepper is explicit)')
        end if
        if (.not. (properties%implicit .or. projects_stages(scene%options))) then
            call phrase%add('projection of stages (steps meet the constraints at their ends)')
        end if
        text = 'nothing'
        if (allocated(phrase%text)) text = phrase%text
    end function left_out

    !> Name of the kind of chart.
    pure function chart_text(simulation) result(text)
        type(simulation_type), intent(in) :: simulation
        character(len=:), allocatable :: text

        text = trim(merge('sparse', 'dense ', simulation%is_sparse))//' chart'
    end function chart_text

    !> Estimated costs by which the kind of chart was chosen.
    pure function cost_text(simulation) result(text)
        type(simulation_type), intent(in) :: simulation
        character(len=:), allocatable :: text

        text = 'estimated from the pattern of C and M: '//short(simulation%cost%sparse/simulation%cost%dense, 2)// &
            ' on a sparse chart relative to a dense one'
    end function cost_text

    !> Add an item if its count is not zero.
    subroutine add_count(phrase, name, number)
        type(phrase_type), intent(inout) :: phrase
        character(len=*), intent(in) :: name
        integer(long), intent(in) :: number

        if (number > 0) call phrase%add(name//' '//count_text(number))
    end subroutine add_count

    !> Add an item.
    subroutine add(self, item)
        class(phrase_type), intent(inout) :: self
        character(len=*), intent(in) :: item

        if (allocated(self%text)) then
            self%text = self%text//', '//item
        else
            self%text = item
        end if
    end subroutine add

    !> Print a label and a text, on several lines if necessary.
    subroutine print_line(label, text)
        character(len=*), intent(in) :: label, text
        character(len=:), allocatable :: rest, head
        integer :: last

        head = '  '//label//repeat(' ', max(1, indent - 2 - len(label)))
        rest = text
        do
            last = len(rest)
            if (last > width - indent) last = index(rest(:width - indent), ', ', back=.true.)
            if (last == 0) last = len(rest)
            call say(head//rest(:last))
            if (last == len(rest)) return
            rest = rest(last + 2:)
            head = repeat(' ', indent)
        end do
    end subroutine print_line

    !> A number with a few significant digits.
    pure function short(value, digits) result(text)
        real(wp), intent(in) :: value
        !> Number of digits.
        integer, intent(in) :: digits
        character(len=:), allocatable :: text
        character(len=32) :: buffer
        character(len=12) :: edit
        real(wp) :: rounded

        write (edit, '("(es32.", i0, "e3)")') digits - 1
        write (buffer, edit) value
        read (buffer, *) rounded
        text = to_toml(rounded)
    end function short

    !> Count without blanks.
    pure function count_text(number) result(text)
        integer(long), intent(in) :: number
        character(len=:), allocatable :: text
        character(len=24) :: buffer

        write (buffer, '(i0)') number
        text = trim(buffer)
    end function count_text

    !> Count with the name of the counted items.
    pure function counted(number, name) result(text)
        integer(long), intent(in) :: number
        character(len=*), intent(in) :: name
        character(len=:), allocatable :: text

        text = count_text(number)//' '//name
        if (number /= 1) text = text//'s'
    end function counted
end module tandem_cli_report
