! SPDX-License-Identifier: MIT
!> tandem check: sizes, rank and consistency of the start of a scene, and a comparison of every procedure of its model with finite
!> differences.
module tandem_cli_check
    use tandem, only: census_type, error_type, finding_type, mechanism_type, simulation_type, take_census, to_text, verify_model, wp
    use tandem_cli_arguments, only: arguments_type
    use tandem_cli_messages, only: print_to_stderr, done, message_for_scene, input_wrong, padded, run_failed, say
    use tandem_cli_moves, only: moves_text
    use tandem_cli_report, only: chart_text, cost_text, print_warnings
    use tandem_io, only: brief, find_scene, json_type, read_scene, scene_type
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)
    private

    public :: check

    !> Number of states at which procedures are compared.
    integer, parameter :: n_states = 10
    !> Largest number of bodies whose names are printed.
    integer, parameter :: most_names = 20
    !> Width of the names of procedures.
    integer, parameter :: name_width = 43

contains

    !> Check a scene. The exit code is 1 if a procedure is wrong, 2 if the scene cannot be started.
    subroutine check(arguments, code)
        type(arguments_type), intent(in) :: arguments
        !> Exit code.
        integer, intent(out) :: code
        type(scene_type), target :: scene
        type(simulation_type) :: simulation
        type(finding_type), allocatable :: findings(:)
        type(error_type), allocatable :: error, start_error
        character(len=:), allocatable :: path

        call find_scene(arguments%scene, path, error)
        if (.not. allocated(error)) call read_scene(path, arguments%settings, scene, error, models=arguments%models)
        if (.not. allocated(error)) then
            call verify_model(scene%model, scene%t_start, scene%q, scene%qd, n_states, findings, error)
        end if
        if (allocated(error)) then
            call print_to_stderr(error%message)
            code = input_wrong
            return
        end if
        ! Test the start, with its rank and constraint errors.
        call simulation%initialize(scene%model, scene%options, scene%t_start, scene%q, scene%qd, start_error, scene%assembly)
        if (arguments%json) then
            call print_json(scene, findings, simulation, start_error)
        else
            call print_check(scene, findings)
            call print_mechanism(scene, simulation, start_error)
            if (.not. allocated(start_error)) call print_start(scene, simulation)
        end if
        code = merge(done, run_failed, all(findings%passed))
        if (.not. allocated(start_error)) return
        call print_to_stderr(message_for_scene(start_error))
        code = input_wrong
    end subroutine check

    !> Print sizes, and one line per procedure with the location and the number of errors.
    subroutine print_check(scene, findings)
        type(scene_type), intent(in) :: scene
        type(finding_type), intent(in) :: findings(:)
        character(len=:), allocatable :: place, verdict
        integer :: i

        associate (model => scene%model)
            verdict = ', '//counted(model%n - model%n_constraints(), 'degree', 's')//' of freedom'
            ! The constraints of a mechanism are printed with its rows, which may be redundant.
            select type (model)
            class is (mechanism_type)
                verdict = ''
            end select
            call say(scene%name//': n = '//to_text(model%n)//', '//to_text(model%n_holonomic)// &
                ' holonomic and '//to_text(model%n_nonholonomic)//' nonholonomic constraints'//verdict)
        end associate
        call say('procedures compared with differences at '//to_text(n_states)//' random states:')
        do i = 1, size(findings)
            associate (finding => findings(i))
                if (finding%passed) then
                    call say(padded('  '//trim(finding%name), name_width)//'right, within '//brief(finding%error))
                    cycle
                end if
                if (finding%row == 0) then
                    call say(padded('  '//trim(finding%name), name_width)//'FAILED: the procedure could not be evaluated')
                    cycle
                end if
                place = 'row '//to_text(finding%row)
                if (finding%column > 0) place = place//', column '//to_text(finding%column)// &
                    ' ('//scene%model%coordinate_label(finding%column)//')'
                verdict = 'FAILED: no number: '
                if (ieee_is_finite(finding%error)) verdict = 'WRONG by '//brief(finding%error)//' of its largest entry: '
                call say(padded('  '//trim(finding%name), name_width)//verdict//place//' is '//to_text(finding%value)// &
                    ', differences give '//to_text(finding%expected))
            end associate
        end do
    end subroutine print_check

    !> A count with the counted word.
    pure function counted(n, word, many, one) result(text)
        integer, intent(in) :: n
        !> The word, its ending in the plural, and its ending in the singular.
        character(len=*), intent(in) :: word, many
        character(len=*), intent(in), optional :: one
        character(len=:), allocatable :: text

        text = to_text(n)//' '//word
        if (n /= 1) then
            text = text//many
        else if (present(one)) then
            text = text//one
        end if
    end function counted

    !> Print bodies, rows by element, degrees of freedom and start of a mechanism.
    subroutine print_mechanism(scene, simulation, start_error)
        type(scene_type), intent(inout) :: scene
        type(simulation_type), intent(in) :: simulation
        type(error_type), allocatable, intent(in) :: start_error
        type(census_type) :: census
        character(len=:), allocatable :: bodies
        logical :: is_known
        integer :: i, width

        call count_mechanism(scene, simulation, start_error, census, is_known)
        if (.not. is_known) return
        select type (model => scene%model)
        class is (mechanism_type)
            bodies = ''
            do i = 1, min(size(model%bodies), most_names)
                bodies = bodies//merge(', ', ': ', i > 1)//trim(model%bodies(i)%name)
            end do
            if (size(model%bodies) > most_names) bodies = bodies//', ...'
            call say(counted(size(model%bodies), 'bod', 'ies', 'y')//bodies)
        end select
        width = max(24, maxval([0, len_trim(census%elements%name)]) + 4)
        if (size(census%elements) > 0) call say(padded('rows of', width)//padded('type', 18)//'position  velocity  redundant')
        do i = 1, size(census%elements)
            associate (element => census%elements(i))
                call say(padded('  '//trim(element%name), width)//padded(trim(element%kind), 18)// &
                    padded(to_text(element%n_position), 10)//padded(to_text(element%n_velocity), 10)//to_text(element%n_redundant))
            end associate
        end do
        call say('degrees of freedom: '//to_text(census%position_freedom)//' at position level, '// &
            to_text(census%velocity_freedom)//' at velocity level')
    end subroutine print_mechanism

    !> Count at the start of the run, or at the state of the scene if it cannot be started.
    subroutine count_mechanism(scene, simulation, start_error, census, is_known)
        type(scene_type), intent(inout) :: scene
        type(simulation_type), intent(in) :: simulation
        type(error_type), allocatable, intent(in) :: start_error
        type(census_type), intent(out) :: census
        !> True if the model is a mechanism that could be evaluated.
        logical, intent(out) :: is_known
        real(wp) :: q(scene%model%n)
        integer :: stat

        is_known = .false.
        q = scene%q
        if (.not. allocated(start_error)) q = simulation%state%q
        select type (model => scene%model)
        class is (mechanism_type)
            call take_census(model, scene%t_start, q, scene%qd, census, stat)
            is_known = stat == 0
        end select
    end subroutine count_mechanism

    !> Print the start.
    subroutine print_start(scene, simulation)
        type(scene_type), intent(in) :: scene
        type(simulation_type), intent(in) :: simulation
        character(len=:), allocatable :: rank

        if (allocated(scene%assembly)) call say('start assembled: '//moves_text(scene%model, scene%assembly))
        rank = 'full rank '//to_text(scene%model%n_constraints())
        if (simulation%n_redundant > 0) rank = 'rank '//to_text(scene%model%n_constraints() - simulation%n_redundant)// &
            ' of '//to_text(scene%model%n_constraints())
        call say('start: C has '//rank//', the errors of position, velocity and acceleration are '// &
            brief(simulation%errors(1))//', '// &
            brief(simulation%errors(2))//', '//brief(simulation%errors(3))//' of their rows'' natural scales')
        if (simulation%cost%dense > 0.0_wp) then
            call say(chart_text(simulation)//': the cost of a step is '//cost_text(simulation))
        else
            call say(chart_text(simulation))
        end if
        call print_warnings(simulation)
    end subroutine print_start

    !> Print the results as one JSON object.
    subroutine print_json(scene, findings, simulation, start_error)
        type(scene_type), intent(inout) :: scene
        type(finding_type), intent(in) :: findings(:)
        type(simulation_type), intent(in) :: simulation
        type(error_type), allocatable, intent(in) :: start_error
        type(json_type) :: json
        type(census_type) :: census
        logical :: is_known
        integer :: i

        call json%begin_object()
        call json%add('scene', scene%name)
        call json%add('n', scene%model%n)
        call json%add('n_holonomic', scene%model%n_holonomic)
        call json%add('n_nonholonomic', scene%model%n_nonholonomic)
        call json%begin_array('procedures')
        do i = 1, size(findings)
            call json%begin_object()
            call json%add('name', findings(i)%name)
            call json%add('passed', findings(i)%passed)
            call json%add('error', findings(i)%error)
            call json%add('row', findings(i)%row)
            call json%add('column', findings(i)%column)
            call json%add('value', findings(i)%value)
            call json%add('expected', findings(i)%expected)
            call json%end_object()
        end do
        call json%end_array()
        call count_mechanism(scene, simulation, start_error, census, is_known)
        if (is_known) then
            call json%add('position_freedom', census%position_freedom)
            call json%add('velocity_freedom', census%velocity_freedom)
            call json%begin_array('elements')
            do i = 1, size(census%elements)
                call json%begin_object()
                call json%add('name', trim(census%elements(i)%name))
                call json%add('type', trim(census%elements(i)%kind))
                call json%add('position_rows', census%elements(i)%n_position)
                call json%add('velocity_rows', census%elements(i)%n_velocity)
                call json%add('redundant_rows', census%elements(i)%n_redundant)
                call json%end_object()
            end do
            call json%end_array()
        end if
        call json%begin_object('start')
        call json%add('passed', .not. allocated(start_error))
        if (allocated(start_error)) then
            call json%add('message', start_error%message)
        else
            call json%add('redundant', simulation%n_redundant)
            call json%add('position_error', simulation%errors(1))
            call json%add('velocity_error', simulation%errors(2))
            call json%add('acceleration_error', simulation%errors(3))
        end if
        call json%end_object()
        call json%end_object()
        call say(json%text)
    end subroutine print_json
end module tandem_cli_check
