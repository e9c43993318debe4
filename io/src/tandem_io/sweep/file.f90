! SPDX-License-Identifier: MIT
!> Reads the file of a sweep. Every error shows the line, and what may stand there.
module tandem_io_sweep_file
    use tandem, only: atom_type, error_type, is_number, is_text, to_text, value_type, wp
    use tandem_io_scene, only: interpret_scene, open_scene, read_scene, scene_type
    use tandem_io_scene_ledger, only: key_length
    use tandem_io_scene_reader, only: not_negative, positive, reader_type
    use tandem_io_scene_registry, only: scene_model_type
    use tandem_io_scene_shipped, only: find_scene
    use tandem_io_scene_source, only: set_input_error
    use tandem_io_scene_text, only: to_toml
    use tandem_io_study_files, only: read_whole
    use tandem_io_study_program, only: program_settings
    use tandem_io_sweep_carriers, only: atom_to_toml, count_elements_of, with_element
    use tandem_io_sweep_columns, only: read_columns
    use tandem_io_sweep_kept, only: kept_type, of_event, of_figure, take_names, take_times
    use tandem_io_sweep_plan, only: input_type, is_from_file, is_listed, is_log_uniform, is_normal, is_uniform, name_length, &
        plan_type, points_names, sobol_points
    use tandem_io_sweep_sobol, only: most_columns
    implicit none (type, external)
    private

    public :: read_sweep, settings_of

    !> Most cases, values of a list, and columns of the table.
    real(wp), parameter :: most_cases = 1.0e9_wp
    character(len=*), parameter :: no_slash = 'must have no slash, since it names a dataset'
    integer, parameter :: most_values = 1000000, most_outputs = 100000
    character(len=4), parameter :: lists_names(2) = [character(len=4) :: 'grid', 'rows']
    character(len=6), parameter :: spacing_names(2) = [character(len=6) :: 'linear', 'log']

contains

    !> Read the file of a sweep, and the scene that it names.
    subroutine read_sweep(path, models, plan, error)
        character(len=*), intent(in) :: path
        !> The models that the scene may name.
        type(scene_model_type), intent(in) :: models(:)
        type(plan_type), intent(inout) :: plan
        type(error_type), allocatable, intent(out) :: error
        type(reader_type) :: reader, base
        type(scene_type) :: scene

        call reader%open_sources(path, [character(len=1) ::], kind='sweep')
        call reader%check_tables([character(len=key_length) :: 'sweep'], [character(len=key_length) :: 'vary', 'keep'], &
            [character(len=key_length) ::], 'a sweep')
        plan%path = path
        call read_whole(path, plan%text)
        if (.not. allocated(plan%text)) plan%text = ''
        call read_table(reader, plan)
        call read_inputs(reader, plan)
        if (.not. reader%failed()) call read_base(reader, models, plan, base, scene)
        call make_carriers(reader, base, plan)
        call check_inputs(reader, models, plan)
        call read_kept(reader, scene, plan)
        call check_size(reader, plan)
        if (reader%failed()) call move_alloc(reader%error, error)
    end subroutine read_sweep

    !> [sweep]
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
        call reader%get('scene', plan%scene_path, 'a name, or a path from the folder of this file', required=.true.)
        call reader%get_list('set', settings)
        length = 1
        if (.not. allocated(settings)) then
            allocate (settings)
            allocate (settings%atoms(0))
        end if
        do i = 1, size(settings%atoms)
            if (settings%atoms(i)%kind /= is_text) then
                call reader%refuse('set', 'must be a list of texts, as in ["time.end=2.0"]')
                return
            end if
            length = max(length, len(settings%atoms(i)%text))
        end do
        allocate (character(len=length) :: plan%settings(size(settings%atoms)))
        do i = 1, size(settings%atoms)
            plan%settings(i) = settings%atoms(i)%text
        end do
        call reader%get('draws', plan%draws, positive, 'random cases at each place of the grid')
        points = points_names(plan%points)
        call reader%get('points', points, points_names)
        plan%points = findloc(points_names, points, dim=1)
        call reader%get('seed', plan%seed, not_negative, 'of all that is random')
        call reader%get('shift', plan%is_shifted, "whether Sobol' points are shifted at random")
        lists = lists_names(1)
        call reader%get('lists', lists, lists_names)
        plan%is_side_by_side = lists == 'rows'
        call reader%get('indices', plan%is_for_indices, "whether draws are arranged for Sobol' indices")
        call reader%get('max_seconds', plan%max_seconds, not_negative, 's', 'of a case; 0 for no limit')
        if (allocated(plan%folder)) deallocate (plan%folder)
        call reader%get('trajectories', plan%folder, 'folder for the whole motion of each case')
        if (allocated(plan%folder)) plan%folder = trim(plan%folder)
        if (.not. allocated(plan%folder)) plan%folder = ''
        exists = plan%folder == ''
        if (.not. exists) inquire (file=plan%folder//'/.', exist=exists)
        if (.not. exists) call reader%refuse('trajectories', 'must be a folder that exists')
        allocate (plan%inputs(0))
        call reader%get('csv', file, 'file of cases: keys in its first line, then a line a case')
        if (.not. reader%failed() .and. file /= '') call read_file(reader, plan, beside(plan%path, file))
        call reader%close_table()
    end subroutine read_table

    !> The file of cases.
    subroutine read_file(reader, plan, path)
        type(reader_type), intent(inout) :: reader
        type(plan_type), intent(inout) :: plan
        character(len=*), intent(in) :: path
        character(len=name_length), allocatable :: names(:)
        type(atom_type), allocatable :: atoms(:, :)
        character(len=:), allocatable :: problem
        type(input_type), allocatable :: inputs(:)
        integer :: i

        call read_columns(path, names, atoms, plan%file_sum, problem)
        if (problem /= '') then
            call reader%refuse('csv', problem)
            return
        end if
        allocate (inputs(size(names)))
        do i = 1, size(names)
            inputs(i)%name = names(i)
            inputs(i)%kind = is_from_file
            allocate (inputs(i)%values, source=atoms(i, :))
            call split_key(trim(names(i)), inputs(i), problem)
            if (problem /= '') call reader%refuse('csv', 'has a column "'//trim(names(i))//'", which '//problem)
            if (any(names(:i - 1) == names(i))) call reader%refuse('csv', 'has two columns "'//trim(names(i))//'"')
        end do
        call move_alloc(inputs, plan%inputs)
    end subroutine read_file

    !> The tables [[vary]].
    subroutine read_inputs(reader, plan)
        type(reader_type), intent(inout) :: reader
        type(plan_type), intent(inout) :: plan
        type(input_type), allocatable :: inputs(:)
        character(len=:), allocatable :: key, name, unit, problem
        integer :: i, n

        if (reader%failed()) return
        n = size(plan%inputs)
        allocate (inputs(n + reader%count_tables('vary')))
        inputs(:n) = plan%inputs
        do i = 1, size(inputs) - n
            associate (input => inputs(n + i))
                call reader%open_element('vary', i)
                if (allocated(key)) deallocate (key)
                if (allocated(unit)) deallocate (unit)
                call reader%get('key', key, 'of the scene: table.key, or table.key[i] for an element of a list', required=.true.)
                if (reader%failed()) return
                name = key
                call reader%get('name', name, 'of its column; the key where there is none')
                call reader%get('unit', unit, 'of it, for the table')
                if (reader%failed()) return
                call split_key(key, input, problem)
                if (problem /= '') call reader%refuse('key', problem)
                if (len_trim(name) > name_length) call reader%refuse('name', 'must not be longer than '//to_text(name_length))
                if (index(name, '/') > 0 .or. name == '.') call reader%refuse('name', no_slash)
                input%name = name
                input%unit = unit
                if (any(inputs(:n + i - 1)%name == input%name)) then
                    call reader%refuse(trim(merge('name', 'key ', reader%source_of('name') >= 0)), &
                        'gives the name of another input, "'//trim(input%name)//'"')
                end if
                call read_values(reader, input)
                call reader%close_table()
            end associate
        end do
        if (reader%failed()) return
        call move_alloc(inputs, plan%inputs)
        if (size(plan%inputs) == 0) call set_input_error(reader%error, plan%path// &
            ' varies nothing; give tables [[vary]], or csv in [sweep]')
    end subroutine read_inputs

    !> From `table.key[i]` to its parts.
    subroutine split_key(key, input, problem)
        character(len=*), intent(in) :: key
        type(input_type), intent(inout) :: input
        character(len=:), allocatable, intent(out) :: problem
        integer :: bracket, dot, stat

        problem = ''
        input%path = trim(key)
        input%element = 0
        bracket = index(key, '[', back=.true.)
        if (bracket > 1 .and. key(len_trim(key):len_trim(key)) == ']') then
            input%path = key(:bracket - 1)
            stat = 1
            if (verify(key(bracket + 1:len_trim(key) - 1), '0123456789') == 0) then
                read (key(bracket + 1:len_trim(key) - 1), *, iostat=stat) input%element
            end if
            if (stat /= 0 .or. input%element < 1) problem = 'must have the number of an element in its brackets, from 1 on'
        end if
        dot = index(input%path, '.')
        if (dot < 2 .or. dot == len(input%path) .or. scan(input%path, ' =') > 0) then
            problem = 'must be table.key, as in model.mass or body.wheel.mass'
        end if
        if (index(input%path//'.', 'output.') == 1) problem = 'must not be one of [output], which sweeps do not look at'
    end subroutine split_key

    !> The values of an input: one of several ways to give them.
    subroutine read_values(reader, input)
        type(reader_type), intent(inout) :: reader
        type(input_type), intent(inout) :: input
        character(len=11), parameter :: ways(5) = [character(len=11) :: 'values', 'from', 'uniform', 'log_uniform', 'normal']
        character(len=7), parameter :: of_range(3) = [character(len=7) :: 'to', 'count', 'spacing']
        integer, parameter :: kinds(5) = [is_listed, is_listed, is_uniform, is_log_uniform, is_normal]
        type(value_type), allocatable :: values
        real(wp), allocatable :: pair(:)
        integer :: i, way, n

        n = 0
        way = 0
        do i = 1, size(ways)
            if (reader%source_of(trim(ways(i))) < 0) cycle
            n = n + 1
            way = i
        end do
        do i = 1, size(ways)
            if (i /= way) call reader%propose(trim(ways(i)))
        end do
        do i = 1, size(of_range)
            if (way == 2) exit
            call reader%propose(trim(of_range(i)))
            if (reader%source_of(trim(of_range(i))) >= 0) call reader%refuse(trim(of_range(i)), 'belongs to from, which is missing')
        end do
        if (n /= 1) then
            call reader%refuse('key', trim(merge('needs its values:', 'must have one:   ', n == 0))// &
                ' one of values, from (with to and count), uniform, log_uniform, normal')
            return
        end if
        select case (way)
        case (1)
            call reader%get_list('values', values)
            if (reader%failed()) return
            call move_alloc(values%atoms, input%values)
            if (size(input%values) > most_values) call reader%refuse('values', 'are more than '//to_text(most_values))
            if (any(input%values%kind /= input%values(1)%kind)) call reader%refuse('values', &
                'must be numbers, or texts, or truth values, not some of each')
        case (2)
            call read_range(reader, input)
        case default
            input%kind = kinds(way)
            allocate (pair(2), source=0.0_wp)
            call reader%get_reals(trim(ways(way)), pair, 2)
            if (reader%failed()) return
            input%a = pair(1)
            input%b = pair(2)
            if (input%kind == is_normal) then
                if (.not. input%b > 0.0_wp) call reader%refuse('normal', 'must be [mean, standard deviation], the latter positive')
            else if (.not. input%b > input%a) then
                call reader%refuse(trim(ways(way)), 'must be [lower, upper], the latter larger')
            else if (input%kind == is_log_uniform .and. .not. input%a > 0.0_wp) then
                call reader%refuse('log_uniform', 'must have positive ends')
            end if
        end select
    end subroutine read_values

    !> Numbers from one to another.
    subroutine read_range(reader, input)
        type(reader_type), intent(inout) :: reader
        type(input_type), intent(inout) :: input
        character(len=6) :: spacing
        real(wp) :: from, to
        integer :: count, i

        from = 0.0_wp
        to = 0.0_wp
        count = 0
        spacing = 'linear'
        call reader%get('from', from, required=.true.)
        call reader%get('to', to, required=.true.)
        if (reader%source_of('count') < 0) call reader%refuse('from', 'needs to and count')
        call reader%get('count', count, positive, 'of values, both ends included')
        call reader%get('spacing', spacing, spacing_names)
        if (count > most_values) call reader%refuse('count', 'must be at most '//to_text(most_values))
        if (count == 1) call reader%refuse('count', 'must be at least 2, so that both ends are there')
        if (spacing == 'log' .and. .not. (from > 0.0_wp .and. to > 0.0_wp)) then
            call reader%refuse('spacing', 'can be log between positive numbers only')
        end if
        if (reader%failed()) return
        allocate (input%values(count))
        do i = 1, count
            associate (value => input%values(i)%number, u => real(i - 1, wp)/real(count - 1, wp))
                if (spacing == 'log') then
                    value = exp(log(from) + (log(to) - log(from))*u)
                else
                    value = from + (to - from)*u
                end if
            end associate
        end do
        input%values(1)%number = from
        input%values(count)%number = to
    end subroutine read_range

    !> The scene without what is varied.
    subroutine read_base(reader, models, plan, base, scene)
        type(reader_type), intent(inout) :: reader
        type(scene_model_type), intent(in) :: models(:)
        type(plan_type), intent(inout) :: plan
        type(reader_type), intent(inout) :: base
        type(scene_type), intent(inout) :: scene
        type(error_type), allocatable :: error
        character(len=:), allocatable :: path

        call reader%open_table('sweep')
        path = plan%scene_path
        if (index(path, '/') > 0 .or. index(path, '.toml') > 0) path = beside(plan%path, path)
        call find_scene(path, plan%scene_path, error)
        if (allocated(error)) then
            call reader%refuse('scene', 'cannot be found: '//error%message)
            return
        end if
        call open_scene(plan%scene_path, plan%settings, models, base)
        call interpret_scene(plan%scene_path, models, base, scene, error)
        if (allocated(error)) then
            call set_input_error(reader%error, plan%path//': the scene cannot be read: '//error%message)
        else
            call move_alloc(scene%text, plan%scene_text)
        end if
    end subroutine read_base

    !> The settings that carry the inputs, with typical values.
    subroutine make_carriers(reader, base, plan)
        type(reader_type), intent(inout) :: reader
        type(reader_type), intent(in) :: base
        type(plan_type), intent(inout) :: plan
        character(len=:), allocatable :: known, text
        integer :: i, j, dot

        allocate (character(len=1) :: plan%carriers(0))
        if (reader%failed()) return
        do i = 1, size(plan%inputs)
            associate (input => plan%inputs(i))
                dot = index(input%path, '.', back=.true.)
                known = base%value_of(input%path(:dot - 1), input%path(dot + 1:))
                if (input%unit == '') input%unit = base%unit_of(input%path(:dot - 1), input%path(dot + 1:))
                do j = 1, i - 1
                    if (plan%inputs(j)%path == input%path) exit
                end do
                if (j < i) input%setting = plan%inputs(j)%setting
                if (j < i .and. (input%element == 0 .or. plan%inputs(min(j, i))%element == 0)) then
                    call refuse_input(reader, plan, i, 'gives '//input%path//' a second time')
                    return
                end if
                if (input%element > count_elements_of(known)) then
                    call refuse_input(reader, plan, i, 'names an element that is not there: '//input%path//' '// &
                        trim(merge('is no list of numbers in the scene', 'has fewer elements                ', &
                        count_elements_of(known) == 0)))
                    return
                end if
                if (input%element == 0) then
                    text = input%path//'='//atom_to_toml(input%typical(), verify(known, '+-0123456789') == 0)
                else
                    text = input%path//'='//known
                    if (j < i) text = trim(plan%carriers(input%setting))
                    text = with_element(text, input%element, atom_to_toml(input%typical(), .false.))
                end if
                if (input%setting == 0) input%setting = size(plan%carriers) + 1
                call put_carrier(plan, input%setting, text)
            end associate
        end do
        call plan%complete()
    end subroutine make_carriers

    !> Give a carrier its text, which may be longer than all others; one behind the last is added.
    subroutine put_carrier(plan, i, text)
        type(plan_type), intent(inout) :: plan
        integer, intent(in) :: i
        character(len=*), intent(in) :: text
        character(len=max(len(plan%carriers), len(text))) :: carriers(max(i, size(plan%carriers)))

        carriers(:size(plan%carriers)) = plan%carriers
        carriers(i) = text
        deallocate (plan%carriers)
        allocate (plan%carriers, source=carriers)
    end subroutine put_carrier

    !> Whether the scene takes the inputs: typical values of all, and each text of a list.
    subroutine check_inputs(reader, models, plan)
        type(reader_type), intent(inout) :: reader
        type(scene_model_type), intent(in) :: models(:)
        type(plan_type), intent(in) :: plan
        type(scene_type), allocatable :: scene
        type(error_type), allocatable :: error
        character(len=max(len(plan%settings), len(plan%carriers)) + 4200) :: settings(size(plan%settings) + size(plan%carriers))
        character(len=:), allocatable :: last
        integer :: i, j

        if (reader%failed()) return
        settings(:size(plan%settings)) = plan%settings
        settings(size(plan%settings) + 1:) = plan%carriers
        allocate (scene)
        call read_scene(plan%scene_path, settings, scene, error, models=models)
        if (allocated(error)) then
            last = error%message
            ! Which of them is to blame: the first that cannot be with those before it.
            do i = 1, size(plan%carriers)
                call read_scene(plan%scene_path, settings(:size(plan%settings) + i), scene, error, models=models)
                if (allocated(error) .or. i == size(plan%carriers)) exit
            end do
            if (allocated(error)) last = error%message
            call refuse_input(reader, plan, findloc(plan%inputs%setting, i, dim=1), 'is refused by the scene: '//last)
            return
        end if
        do i = 1, size(plan%inputs)
            if (.not. plan%inputs(i)%holds_texts) cycle
            associate (input => plan%inputs(i), setting => settings(size(plan%settings) + plan%inputs(i)%setting))
                do j = 2, merge(size(input%values), 1, input%kind == is_listed)
                    setting = input%path//'='//atom_to_toml(input%values(j), .false.)
                    call read_scene(plan%scene_path, settings, scene, error, models=models)
                    if (.not. allocated(error)) cycle
                    call refuse_input(reader, plan, i, 'is refused by the scene: '//error%message)
                    return
                end do
                setting = plan%carriers(input%setting)
            end associate
        end do
    end subroutine check_inputs

    !> An error about an input, shown where it was given.
    subroutine refuse_input(reader, plan, i, problem)
        type(reader_type), intent(inout) :: reader
        type(plan_type), intent(in) :: plan
        integer, intent(in) :: i
        character(len=*), intent(in) :: problem

        if (plan%inputs(i)%kind == is_from_file) then
            call reader%open_table('sweep')
            call reader%refuse('csv', 'has a column "'//trim(plan%inputs(i)%name)//'", which '//problem)
        else
            call reader%open_element('vary', i - count(plan%inputs%kind == is_from_file))
            call reader%refuse('key', problem)
        end if
    end subroutine refuse_input

    !> The tables [[keep]]; without any, all coordinates at the end.
    subroutine read_kept(reader, scene, plan)
        type(reader_type), intent(inout) :: reader
        type(scene_type), intent(in) :: scene
        type(plan_type), intent(inout) :: plan
        character(len=:), allocatable :: problem, quantity, name, unit
        character(len=12) :: take
        integer :: i

        if (reader%failed()) return
        allocate (plan%kept(reader%count_tables('keep')))
        do i = 1, size(plan%kept)
            associate (kept => plan%kept(i))
                call reader%open_element('keep', i)
                if (allocated(quantity)) deallocate (quantity)
                if (allocated(name)) deallocate (name)
                if (allocated(unit)) deallocate (unit)
                call reader%get('quantity', quantity, required=.true.)
                call reader%get('name', name, 'of its column')
                call reader%get('unit', unit, 'of it, for the table')
                take = 'end'
                if (reader%source_of('take') >= 0) then
                    call reader%get('take', take, take_names(:size(take_names) - 1))
                    kept%take = findloc(take_names, take, dim=1)
                else
                    call reader%propose('take')
                end if
                call read_times(reader, scene, kept)
                if (reader%failed()) return
                kept%quantity = trim(quantity)
                call kept%resolve(scene, problem)
                if (problem /= '') call reader%refuse(trim(merge('take    ', 'quantity', index(problem, 'take') > 0 .and. &
                    reader%source_of('take') >= 0)), problem)
                if (reader%failed()) return
                if (unit /= '') kept%unit = unit
                if (index(name, '/') > 0 .or. name == '.') call reader%refuse('name', no_slash)
                if (len_trim(name) > len(kept%name)) call reader%refuse('name', 'must not be longer than '//to_text(len(kept%name)))
                kept%name = name
                if (name == '') kept%name = default_name(kept)
                if (any(plan%kept(:i - 1)%name == kept%name)) call reader%refuse('quantity', 'has the name of another, "'// &
                    trim(kept%name)//'"; give it a name')
                call reader%close_table()
            end associate
        end do
        if (reader%failed() .or. size(plan%kept) > 0) return
        deallocate (plan%kept)
        allocate (plan%kept(scene%model%n))
        do i = 1, size(plan%kept)
            plan%kept(i)%quantity = 'q:q'//to_text(i)
            if (allocated(scene%model%coordinate_name)) plan%kept(i)%quantity = 'q:'//trim(scene%model%coordinate_name(i))
            call plan%kept(i)%resolve(scene, problem)
            plan%kept(i)%name = default_name(plan%kept(i))
        end do
    end subroutine read_kept

    !> The times at which a quantity is kept, if it is.
    subroutine read_times(reader, scene, kept)
        type(reader_type), intent(inout) :: reader
        type(scene_type), intent(in) :: scene
        type(kept_type), intent(inout) :: kept
        type(value_type), allocatable :: times
        integer :: i

        call reader%get_list('at', times)
        if (.not. allocated(times) .or. reader%failed()) return
        if (reader%source_of('take') >= 0) call reader%refuse('at', 'gives the times at which it is taken; leave out take')
        kept%take = take_times
        if (any(times%atoms%kind /= is_number)) then
            call reader%refuse('at', 'must be a list of times')
            return
        end if
        kept%times = times%atoms%number
        do i = 2, size(kept%times)
            if (.not. kept%times(i) > kept%times(i - 1)) call reader%refuse('at', 'must be ascending times')
        end do
        if (kept%times(1) < scene%t_start) call reader%refuse('at', 'must not begin before the start of the run, '// &
            to_toml(scene%t_start))
    end subroutine read_times

    !> The name of a column: the quantity and what is taken of it.
    pure function default_name(kept) result(name)
        type(kept_type), intent(in) :: kept
        character(len=len(kept%name)) :: name
        integer :: i

        name = kept%quantity
        if (name(:2) == 'q:') name = name(3:)
        if (kept%kind /= of_figure .and. kept%take /= take_times) name = trim(name)//'_'//take_names(kept%take)
        if (kept%kind == of_figure) name = name(index(name, ':') + 1:)
        do i = 1, len_trim(name)
            if (scan(name(i:i), ':/ ') > 0) name(i:i) = '.'
        end do
    end function default_name

    !> Whether the sweep is one that can be done.
    subroutine check_size(reader, plan)
        type(reader_type), intent(inout) :: reader
        type(plan_type), intent(inout) :: plan
        real(wp) :: cases
        integer :: i, n

        if (reader%failed()) return
        call reader%open_table('sweep')
        if (plan%n_drawn == 0 .and. reader%source_of('draws') >= 0 .and. plan%draws > 1) then
            call reader%refuse('draws', 'are asked for, but no input is drawn: vary one by uniform, log_uniform or normal')
        end if
        if (plan%is_for_indices .and. plan%n_drawn < 1) call reader%refuse('indices', 'need inputs that are drawn')
        if (plan%is_for_indices .and. plan%n_places*plan%n_rows > 1) then
            call reader%refuse('indices', 'need all inputs to be drawn, not listed')
        end if
        if (plan%is_for_indices .and. plan%draws < 8) call reader%refuse('indices', 'need draws, at least 8')
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
            ' cases; there may be a thousand million')
        if (plan%n_outputs() > most_outputs) call set_input_error(reader%error, plan%path//' keeps '// &
            to_text(plan%n_outputs())//' numbers of each case; there may be '//to_text(most_outputs))
    end subroutine check_size

    !> What the records of a sweep depend on: its file, the scene with every default, the file of cases, and the program.
    function settings_of(plan) result(settings)
        type(plan_type), intent(in) :: plan
        character(len=:), allocatable :: settings

        settings = plan%text//new_line('a')//plan%scene_text//new_line('a')//'cases = "'//trim(plan%file_sum)//'"'// &
            new_line('a')//program_settings()
    end function settings_of

    !> A path from the folder of another file.
    pure function beside(file, path) result(joined)
        character(len=*), intent(in) :: file, path
        character(len=:), allocatable :: joined

        joined = path
        if (path(1:1) == '/') return
        joined = file(:index(file, '/', back=.true.))//path
    end function beside
end module tandem_io_sweep_file
