! SPDX-License-Identifier: MIT
!> Reads the file of a sweep. Every error message shows the line and the allowed values. Inputs are read in `inputs.f90`, kept
!> quantities in `keeping.f90`.
module tandem_io_sweep_file
    use tandem, only: error_type, is_text, not_negative, positive, reader_type, shown_type, to_text, value_type, wp
    use tandem_io_path, only: is_regular
    use tandem_io_scene, only: interpret_scene, open_scene, scene_type
    use tandem_io_scene_description, only: description_type, key_length
    use tandem_io_scene_registry, only: scene_model_type
    use tandem_io_scene_shipped, only: find_scene
    use tandem_io_scene_source, only: read_text, set_input_error
    use tandem_io_scene_text, only: to_toml
    use tandem_io_study_program, only: program_settings
    use tandem_io_sweep_inputs, only: check_inputs, make_carriers, read_cases, read_inputs, refuse_input
    use tandem_io_sweep_keeping, only: read_kept
    use tandem_io_sweep_plan, only: is_listed, plan_type, points_names, sobol_points
    use tandem_io_sweep_sobol, only: most_columns
    implicit none (type, external)
    private

    public :: read_sweep, settings_of

    !> Largest number of cases, and of columns of the table.
    real(wp), parameter :: most_cases = 1.0e9_wp
    integer, parameter :: most_outputs = 100000
    character(len=4), parameter :: lists_names(2) = [character(len=4) :: 'grid', 'rows']

contains

    !> Read the file of a sweep and the scene that it names.
    subroutine read_sweep(path, models, plan, error)
        character(len=*), intent(in) :: path
        !> Models that the scene may name.
        type(scene_model_type), intent(in) :: models(:)
        type(plan_type), intent(inout) :: plan
        type(error_type), allocatable, intent(out) :: error
        type(description_type), target :: description
        type(reader_type) :: reader
        type(shown_type), allocatable :: lines(:)
        type(scene_type) :: scene
        character(len=key_length), parameter :: arrays(2) = [character(len=key_length) :: 'vary', 'keep']

        ! The text is read only once: a pipe is empty after the first reading, and a file may change.
        call read_text(path, 'sweep', plan%text, error)
        if (allocated(error)) return
        call description%open(path, [character(len=1) ::], [character(len=key_length) :: 'sweep'], arrays, &
            [character(len=key_length) ::], error, plan%text, 'sweep')
        if (allocated(error)) return
        call reader%take_tables(description%entries, arrays)
        plan%path = path
        call read_table(reader, plan)
        call read_inputs(reader, plan)
        if (.not. reader%failed()) call read_base(reader, models, plan, lines, scene)
        if (.not. reader%failed()) call make_carriers(reader, lines, plan)
        call check_inputs(reader, models, plan)
        call read_kept(reader, scene, plan)
        call check_size(reader, plan)
        if (reader%failed()) call description%explain(reader, error)
    end subroutine read_sweep

    !> Read the table [sweep].
    subroutine read_table(reader, plan)
        type(reader_type), intent(inout) :: reader
        type(plan_type), intent(inout) :: plan
        type(value_type), allocatable :: settings
        character(len=:), allocatable :: file
        character(len=6) :: points
        character(len=4) :: lists
        logical :: exists
        integer :: i, length

        call reader%open_table('sweep')
        plan%scene_path = ''
        call reader%get('scene', plan%scene_path, 'a name, or a path relative to the folder of this file', required=.true.)
        call reader%get_list('set', settings)
        length = 1
        if (.not. allocated(settings)) then
            allocate (settings)
            allocate (settings%atoms(0))
        end if
        do i = 1, size(settings%atoms)
            if (settings%atoms(i)%kind /= is_text) then
                call reader%refuse('set', 'must be a list of strings, as in ["time.end=2.0"]')
                return
            end if
            length = max(length, len(settings%atoms(i)%text))
        end do
        allocate (character(len=length) :: plan%settings(size(settings%atoms)))
        do i = 1, size(settings%atoms)
            plan%settings(i) = settings%atoms(i)%text
        end do
        call reader%get('draws', plan%draws, positive, 'random cases per grid point')
        points = points_names(plan%points)
        call reader%get('points', points, points_names)
        plan%points = findloc(points_names, points, dim=1)
        call reader%get('seed', plan%seed, not_negative, 'of the random numbers')
        call reader%get('shift', plan%is_shifted, "true: Sobol' points are randomly shifted")
        lists = lists_names(1)
        call reader%get('lists', lists, lists_names)
        plan%is_side_by_side = lists == 'rows'
        call reader%get('indices', plan%is_for_indices, "true: draws are arranged for Sobol' indices")
        call reader%get('max_seconds', plan%max_seconds, not_negative, 's', 'largest time of a case; 0 for no limit')
        plan%folder = ''
        call reader%get('trajectories', plan%folder, 'folder for the complete motion of each case')
        plan%folder = trim(plan%folder)
        exists = plan%folder == ''
        if (.not. exists) inquire (file=plan%folder//'/.', exist=exists)
        if (.not. exists) call reader%refuse('trajectories', 'must be a folder that exists')
        allocate (plan%inputs(0))
        file = ''
        call reader%get('csv', file, 'file of cases: keys in its first line, then one line per case')
        plan%cases_path = ''
        if (.not. reader%failed() .and. file /= '') then
            plan%cases_path = beside(plan%path, file)
            call read_cases(reader, plan, plan%cases_path)
        end if
        call reader%close_table()
    end subroutine read_table

    !> Read the scene without the varied inputs.
    subroutine read_base(reader, models, plan, lines, scene)
        type(reader_type), intent(inout) :: reader
        type(scene_model_type), intent(in) :: models(:)
        type(plan_type), intent(inout) :: plan
        !> Lines of the complete scene.
        type(shown_type), allocatable, intent(out) :: lines(:)
        type(scene_type), intent(inout) :: scene
        type(error_type), allocatable :: error
        character(len=:), allocatable :: path
        logical :: exists

        call reader%open_table('sweep')
        path = plan%scene_path
        if (index(path, '/') > 0 .or. index(path, '.toml') > 0) path = beside(plan%path, path)
        call find_scene(path, plan%scene_path, error)
        if (allocated(error)) then
            call reader%refuse('scene', 'cannot be found: '//error%message)
            return
        end if
        inquire (file=plan%scene_path, exist=exists)
        if (exists .and. .not. is_regular(plan%scene_path)) then
            call reader%refuse('scene', 'must be a regular file, since it is read several times: '//plan%scene_path)
            return
        end if
        call open_scene(plan%scene_path, plan%settings, models, plan%scene_keys, error)
        if (.not. allocated(error)) call interpret_scene(plan%scene_keys, models, scene, error, lines=lines)
        if (allocated(error)) then
            call set_input_error(reader%error, plan%path//': the scene cannot be read: '//error%message)
        else
            call move_alloc(scene%text, plan%scene_text)
            plan%n_settings = plan%scene_keys%n_settings()
        end if
    end subroutine read_base

    !> Refuse a sweep that is inconsistent or too large.
    subroutine check_size(reader, plan)
        type(reader_type), intent(inout) :: reader
        type(plan_type), intent(inout) :: plan
        real(wp) :: cases
        integer :: i, n

        if (reader%failed()) return
        call reader%open_table('sweep')
        if (plan%n_drawn == 0 .and. reader%source_of('draws') >= 0 .and. plan%draws > 1) then
            call reader%refuse('draws', 'have no effect, since no input is random: vary one by uniform, log_uniform or normal')
        end if
        if (plan%is_for_indices .and. plan%n_drawn < 1) call reader%refuse('indices', 'require random inputs')
        if (plan%is_for_indices .and. plan%n_points*plan%n_rows > 1) then
            call reader%refuse('indices', 'require all inputs to be random, not listed')
        end if
        if (plan%is_for_indices .and. plan%draws < 8) call reader%refuse('indices', 'require draws of at least 8')
        n = merge(2, 1, plan%is_for_indices)*plan%n_drawn
        if (plan%points == sobol_points .and. n > most_columns) call reader%refuse('points', 'can be sobol for '// &
            to_text(most_columns)//' columns at most, and there are '//to_text(n))
        if (plan%is_side_by_side) then
            n = 0
            do i = 1, size(plan%inputs)
                if (plan%inputs(i)%kind /= is_listed) cycle
                if (n > 0 .and. size(plan%inputs(i)%values) /= n) then
                    call refuse_input(reader, plan, i, 'has '//to_text(size(plan%inputs(i)%values))// &
                        ' values, another list has '//to_text(n)//': with lists = "rows" all must be equally long')
                    return
                end if
                n = size(plan%inputs(i)%values)
            end do
        end if
        cases = real(plan%n_rows, wp)*real(plan%n_draws, wp)
        do i = 1, size(plan%inputs)
            if (plan%inputs(i)%kind == is_listed .and. .not. plan%is_side_by_side) cases = cases*size(plan%inputs(i)%values)
        end do
        if (cases > most_cases) call set_input_error(reader%error, plan%path//' has '//to_toml(cases)// &
            ' cases; the limit is 1e9')
        if (plan%n_outputs() > most_outputs) call set_input_error(reader%error, plan%path//' keeps '// &
            to_text(plan%n_outputs())//' numbers per case; the limit is '//to_text(most_outputs))
    end subroutine check_size

    !> Data on which the records of a sweep depend: the file of the sweep, the complete scene, the file of cases, and the program.
    function settings_of(plan) result(settings)
        type(plan_type), intent(in) :: plan
        character(len=:), allocatable :: settings

        settings = plan%text//new_line('a')//plan%scene_text//new_line('a')//'cases = "'//trim(plan%file_sum)//'"'// &
            new_line('a')//program_settings()
    end function settings_of

    !> Path relative to the folder of a file, or to the working folder if the file is a pipe of the shell.
    pure function beside(file, path) result(joined)
        character(len=*), intent(in) :: file, path
        character(len=:), allocatable :: joined

        joined = path
        if (path(1:1) == '/' .or. index(file, '/dev/') == 1 .or. index(file, '/proc/') == 1) return
        joined = file(:index(file, '/', back=.true.))//path
    end function beside
end module tandem_io_sweep_file
