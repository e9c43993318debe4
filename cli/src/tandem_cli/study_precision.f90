! SPDX-License-Identifier: MIT
!> tandem study precision: error against run time of every stepper, for ranges of step sizes and tolerances.
module tandem_cli_study_precision
    use tandem, only: error_type, is_input_error, stepper_choices, stepper_names, to_text, wp
    use tandem_cli_arguments, only: arguments_type
    use tandem_cli_messages, only: print_to_stderr, done, message_for_scene, input_wrong, run_failed, say
    use tandem_cli_study_json, only: print_table_json
    use tandem_cli_study_progress, only: study_progress_type
    use tandem_io, only: brief, find_scene, make_reference, nearest_name, precision_columns, precision_type, read_reference, &
        read_scene, reference_type, scene_type, prepare_scene, table_type, to_toml, write_reference
    implicit none (type, external)
    private

    public :: study_precision

    !> Values of the options.
    type :: request_type
        character(len=:), allocatable :: folder, reference
        character(len=16), allocatable :: steppers(:)
        integer :: samples = 40, repeats = 3
        real(wp) :: budget = 5.0_wp
    end type request_type

    !> Largest time of each reference run, seconds.
    real(wp), parameter :: reference_seconds = 60.0_wp

contains

    !> Study all scenes, one after the other.
    subroutine study_precision(arguments, code)
        type(arguments_type), intent(in) :: arguments
        !> Exit code.
        integer, intent(out) :: code
        type(scene_type), allocatable :: scenes(:)
        type(request_type) :: request
        type(error_type), allocatable :: error
        integer :: i

        call read_request(arguments, request, error)
        if (.not. allocated(error)) call read_scenes(arguments, scenes, error)
        code = input_wrong
        if (.not. allocated(error)) then
            do i = 1, size(scenes)
                if (i > 1 .and. .not. (arguments%quiet .or. arguments%json)) call say('')
                call study_scene(arguments, request, scenes(i), code, error)
                if (allocated(error)) exit
            end do
        end if
        if (allocated(error)) then
            call print_to_stderr(message_for_scene(error))
        else
            code = done
        end if
    end subroutine study_precision

    !> Read the options of the command line.
    subroutine read_request(arguments, request, error)
        type(arguments_type), intent(in) :: arguments
        type(request_type), intent(inout) :: request
        type(error_type), allocatable, intent(out) :: error
        character(len=:), allocatable :: names, name
        integer :: comma

        if (arguments%quick) then
            request%repeats = 1
            request%budget = 0.5_wp
        end if
        request%folder = arguments%value_of('--output', 'study')
        request%reference = arguments%value_of('--reference', '')
        call arguments%count_of('--samples', 10000, request%samples, error)
        if (.not. allocated(error)) call arguments%count_of('--repeats', 1000, request%repeats, error)
        if (.not. allocated(error)) call arguments%number_of('--budget', 1.0e-3_wp, request%budget, error)
        if (allocated(error)) return
        names = arguments%value_of('--steppers', '')
        if (names == '') then
            request%steppers = stepper_names
            return
        end if
        allocate (request%steppers(0))
        do while (names /= '')
            comma = index(names//',', ',')
            name = names(:comma - 1)
            names = names(min(comma + 1, len(names) + 1):)
            if (any(name == stepper_choices)) then
                request%steppers = [character(len=16) :: request%steppers, name]
                cycle
            end if
            allocate (error)
            error%message = 'there is no stepper "'//name//'"'
            name = nearest_name(name, stepper_choices)
            if (name /= '') error%message = error%message//'; did you mean "'//name//'"?'
            return
        end do
    end subroutine read_request

    !> Read all scenes. This is done before any run, so that an invalid scene is reported before long runs of other scenes.
    subroutine read_scenes(arguments, scenes, error)
        type(arguments_type), intent(in) :: arguments
        type(scene_type), allocatable, intent(out) :: scenes(:)
        type(error_type), allocatable, intent(out) :: error
        character(len=:), allocatable :: path
        integer :: i, j

        allocate (scenes(size(arguments%scenes)))
        do i = 1, size(scenes)
            call find_scene(trim(arguments%scenes(i)), path, error)
            if (allocated(error)) return
            call read_scene(path, arguments%settings, scenes(i), error, models=arguments%models)
            if (.not. allocated(error)) call prepare_scene(scenes(i), error)
            if (allocated(error)) return
            do j = 1, i - 1
                if (scenes(j)%name /= scenes(i)%name) cycle
                allocate (error)
                error%message = 'two scenes have the name "'//scenes(i)%name//'", which names files; study them one by one'
                return
            end do
        end do
    end subroutine read_scenes

    !> Study a scene, print its table, and write its files.
    subroutine study_scene(arguments, request, scene, code, error)
        type(arguments_type), intent(in) :: arguments
        type(request_type), intent(in) :: request
        type(scene_type), intent(inout), target :: scene
        !> Exit code; set after an error.
        integer, intent(out) :: code
        type(error_type), allocatable, intent(out) :: error
        type(precision_type) :: study
        type(study_progress_type) :: progress
        character(len=:), allocatable :: beginning
        logical :: finished

        code = input_wrong
        progress%quiet = arguments%quiet
        if (request%reference /= '') then
            call read_reference(request%reference, scene%t_start, scene%t_end, scene%q, scene%qd, request%samples, &
                study%reference, error)
            if (allocated(error)) return
        end if
        call study%journal%open(request%folder, 'precision_'//scene%name, precision_columns, &
            settings_of(scene, request), arguments%force, error)
        if (allocated(error)) return
        beginning = study%journal%beginning()
        if (beginning /= '') call progress%remark(scene%name//': '//beginning)
        if (request%reference == '') call get_reference(request, scene, study, progress, error)
        if (allocated(error)) then
            if (.not. is_input_error(error%stat)) code = run_failed
            return
        end if
        code = run_failed
        study%budget = request%budget
        study%repeats = request%repeats
        call study%start(scene, request%steppers)
        do
            call progress%show(scene%name//': measures row '//to_text(study%journal%table%rows() + 1))
            call study%next_row(finished, error)
            if (finished .or. allocated(error)) exit
            call progress%remark(scene%name//', '//row_text(study%journal%table))
        end do
        call progress%clear()
        call study%journal%close()
        if (allocated(error)) return
        call study%journal%write_hdf5('precision', about(study), [character(len=12) :: 'agreement_q', &
            'agreement_qd', 'floor_q'], [study%reference%agreement_q, study%reference%agreement_qd, study%floor_q()], error)
        if (allocated(error)) return
        if (arguments%json) then
            call print_table_json(study%journal%table, scene%name)
        else if (.not. arguments%quiet) then
            call print_study(scene, study)
        end if
    end subroutine study_scene

    !> Settings on which the rows depend, in addition to the program.
    function settings_of(scene, request) result(text)
        type(scene_type), intent(in) :: scene
        type(request_type), intent(in) :: request
        character(len=:), allocatable :: text
        character(len=*), parameter :: newline = new_line('a')

        text = scene%text//newline//'[study]'//newline//'reference = '//to_toml(request%reference)//newline// &
            'samples = '//to_toml(request%samples)//newline//'repeats = '//to_toml(request%repeats)//newline
    end function settings_of

    !> Read the reference of an earlier study, or compute it.
    subroutine get_reference(request, scene, study, progress, error)
        type(request_type), intent(in) :: request
        type(scene_type), intent(inout), target :: scene
        type(precision_type), intent(inout) :: study
        type(study_progress_type), intent(inout) :: progress
        type(error_type), allocatable, intent(out) :: error
        character(len=:), allocatable :: path

        path = study%journal%path//'_reference.txt'
        if (study%journal%resumed > 0) then
            call read_reference(path, scene%t_start, scene%t_end, scene%q, scene%qd, request%samples, study%reference, error)
            if (.not. allocated(error)) return
            deallocate (error)
        end if
        call progress%show(scene%name//': makes the reference')
        call make_reference(scene, request%samples, reference_seconds, study%reference, error)
        if (.not. allocated(error)) call write_reference(path, scene%name, study%reference, error)
    end subroutine get_reference

    !> Row as text for the progress line.
    function row_text(table) result(text)
        type(table_type), intent(in) :: table
        character(len=:), allocatable :: text
        integer :: row

        row = table%rows()
        text = table%text_at(row, 'stepper')//', '//table%text_at(row, 'control')//' '//table%text_at(row, 'value')//': '
        if (table%text_at(row, 'status') /= 'complete') then
            text = text//table%text_at(row, 'status')
        else
            text = text//'error '//brief(table%real_at(row, 'error_q'))//', '//brief(table%real_at(row, 'wall_seconds'))//' s'
        end if
    end function row_text

    !> Description of the errors.
    function about(study) result(text)
        type(precision_type), intent(in) :: study
        character(len=:), allocatable :: text

        associate (reference => study%reference)
            text = 'errors: the largest over '//to_text(size(reference%t))//' times up to t = '// &
                to_toml(reference%t(size(reference%t)))//' s; reference: '//reference%origin
            if (reference%agreement_q >= 0.0_wp) then
                text = text//'; these runs differ from it by '//brief(reference%agreement_q)//' in q and '// &
                    brief(reference%agreement_qd)//' in qd at most: errors of less than ten times that are not quoted'
            else
                text = text//', without stated accuracy'
            end if
        end associate
    end function about

    !> Print the table, its reference, and a recommendation.
    subroutine print_study(scene, study)
        type(scene_type), intent(in) :: scene
        type(precision_type), intent(in) :: study
        type(table_type) :: table
        character(len=:), allocatable :: text
        real(wp) :: worst(3)
        integer :: i, row

        table = study%journal%table
        worst = 0.0_wp
        do row = 1, table%rows()
            worst(1) = max(worst(1), table%real_at(row, 'position_error'))
            worst(2) = max(worst(2), table%real_at(row, 'velocity_error'))
            worst(3) = max(worst(3), table%real_at(row, 'acceleration_error'))
            if (table%count_at(row, 'at_floor') == 0) cycle
            call table%put(table%cells(:, row), 'error_q', '<'//brief(study%floor_q()))
            table%cells(table%index_of('order'), row) = ''
        end do
        call say(scene%name//': '//scene%description)
        call say(about(study))
        call say(table%header())
        do row = 1, table%rows()
            if (row > 1) then
                if (table%text_at(row, 'stepper')//table%text_at(row, 'control') /= &
                    table%text_at(row - 1, 'stepper')//table%text_at(row - 1, 'control')) call say('')
            end if
            call say(table%line(row))
        end do
        call say('constraint errors of all runs, on natural scales: position '//brief(worst(1))// &
            ', velocity '//brief(worst(2))//', acceleration '//brief(worst(3)))
        do i = 2, 12, 2
            if (10.0_wp**(-i) < study%floor_q()) exit
            row = study%cheapest(10.0_wp**(-i))
            if (row == 0) exit
            text = '1e-'//to_text(i)//': '//table%text_at(row, 'stepper')//', '//table%text_at(row, 'control')//' '// &
                table%text_at(row, 'value')//', '//brief(table%real_at(row, 'cpu_seconds'))//' s'
            call say('the shortest run with an error q of at most '//text)
        end do
        call say('files: '//study%journal%path//'.csv, .h5; picture: tandem plot '//study%journal%path//'.h5')
    end subroutine print_study
end module tandem_cli_study_precision
