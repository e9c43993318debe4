! SPDX-License-Identifier: MIT
!> Reads the inputs of a sweep, given by tables [[vary]] and by the file of cases, and checks that the scene accepts them.
module tandem_io_sweep_inputs
    use tandem, only: atom_type, error_type, positive, reader_type, shown_type, to_text, value_type, wp
    use tandem_io_scene, only: interpret_scene, scene_type
    use tandem_io_scene_complete, only: unit_in, value_in
    use tandem_io_scene_description, only: description_type
    use tandem_io_scene_registry, only: scene_model_type
    use tandem_io_scene_source, only: set_input_error
    use tandem_io_sweep_carriers, only: atom_to_toml, count_elements_of, with_element
    use tandem_io_sweep_columns, only: read_columns
    use tandem_io_sweep_plan, only: input_type, is_choice, is_from_file, is_listed, is_log_normal, is_log_uniform, is_normal, &
        is_triangular, is_uniform, name_length, no_slash, reserved_names, plan_type
    use tandem_number_text, only: read_number
    implicit none (type, external)
    private

    public :: read_cases, read_inputs, make_carriers, check_inputs, refuse_input

    !> Largest number of values in a list.
    integer, parameter :: most_values = 1000000
    character(len=6), parameter :: spacing_names(2) = [character(len=6) :: 'linear', 'log']

contains

    !> Read the file of cases.
    subroutine read_cases(reader, plan, path)
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
    end subroutine read_cases

    !> Read the tables [[vary]].
    subroutine read_inputs(reader, plan)
        type(reader_type), intent(inout) :: reader
        type(plan_type), intent(inout) :: plan
        type(input_type), allocatable :: inputs(:)
        character(len=:), allocatable :: key, name, unit, problem
        integer :: i, n

        if (reader%failed()) return
        n = size(plan%inputs)
        allocate (inputs(n + reader%n_of('vary')))
        inputs(:n) = plan%inputs
        do i = 1, size(inputs) - n
            associate (input => inputs(n + i))
                call reader%open_table('vary', i)
                key = ''
                unit = ''
                call reader%get('key', key, 'of the scene: table.key, or table.key[i] for an element of a list', required=.true.)
                if (reader%failed()) return
                name = key
                call reader%get('name', name, 'of its column; default: the key')
                call reader%get('unit', unit, 'unit in the table')
                if (reader%failed()) return
                call split_key(key, input, problem)
                if (problem /= '') call reader%refuse('key', problem)
                if (len_trim(name) > name_length) call reader%refuse('name', 'must not be longer than '//to_text(name_length))
                if (index(name, '/') > 0 .or. name == '.') call reader%refuse('name', no_slash)
                if (any(reserved_names == name)) call reader%refuse('name', 'must not be "'//trim(name)// &
                    '", which is reserved in the table')
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
            ' has no inputs; add tables [[vary]], or csv in [sweep]')
    end subroutine read_inputs

    !> Split `table.key[i]` into path and element.
    subroutine split_key(key, input, problem)
        character(len=*), intent(in) :: key
        type(input_type), intent(inout) :: input
        character(len=:), allocatable, intent(out) :: problem
        integer :: bracket, dot
        logical :: is_read

        problem = ''
        input%path = trim(key)
        input%element = 0
        bracket = index(key, '[', back=.true.)
        if (bracket > 1 .and. key(len_trim(key):len_trim(key)) == ']') then
            input%path = key(:bracket - 1)
            call read_number(key(bracket + 1:len_trim(key) - 1), input%element, is_read)
            if (input%element < 1) problem = 'must have the index of an element, from 1, in its brackets'
        end if
        dot = index(input%path, '.')
        if (dot < 2 .or. dot == len(input%path) .or. scan(input%path, ' =') > 0) then
            problem = 'must be table.key, as in model.mass or body.wheel.mass'
        end if
        if (index(input%path//'.', 'output.') == 1) problem = 'must not be one of [output], which sweeps ignore'
    end subroutine split_key

    !> Read the values of an input, which can be specified in several ways.
    subroutine read_values(reader, input)
        type(reader_type), intent(inout) :: reader
        type(input_type), intent(inout) :: input
        character(len=11), parameter :: specs(8) = [character(len=11) :: 'values', 'from', 'uniform', 'log_uniform', 'normal', &
            'log_normal', 'triangular', 'choice']
        integer, parameter :: kinds(8) = [is_listed, is_listed, is_uniform, is_log_uniform, is_normal, is_log_normal, &
            is_triangular, is_choice]
        integer :: i, spec, n

        n = 0
        spec = 0
        do i = 1, size(specs)
            if (reader%source_of(trim(specs(i))) < 0) cycle
            n = n + 1
            spec = i
        end do
        do i = 1, size(specs)
            if (i /= spec) call reader%propose(trim(specs(i)))
        end do
        if (spec /= 2) call refuse_keys(reader, [character(len=7) :: 'to', 'count', 'spacing'], 'belongs to from, which is missing')
        if (spec < 5 .or. spec > 6) call refuse_keys(reader, ['limits'], 'belongs to normal or log_normal, which is missing')
        if (n /= 1) then
            call reader%refuse('key', trim(merge('needs its values:', 'must have one:   ', n == 0))// &
                ' one of values, from (with to and count), uniform, log_uniform, normal, log_normal, triangular, choice')
            return
        end if
        input%kind = kinds(spec)
        if (specs(spec) == 'from') then
            call read_range(reader, input)
        else if (any(input%kind == [is_listed, is_choice])) then
            call read_list(reader, trim(specs(spec)), input)
        else
            call read_distribution(reader, trim(specs(spec)), input)
        end if
    end subroutine read_values

    !> Refuse keys that are valid only together with another key.
    subroutine refuse_keys(reader, keys, problem)
        type(reader_type), intent(inout) :: reader
        character(len=*), intent(in) :: keys(:), problem
        integer :: i

        do i = 1, size(keys)
            call reader%propose(trim(keys(i)))
            if (reader%source_of(trim(keys(i))) >= 0) call reader%refuse(trim(keys(i)), problem)
        end do
    end subroutine refuse_keys

    !> Read a list of values.
    subroutine read_list(reader, key, input)
        type(reader_type), intent(inout) :: reader
        character(len=*), intent(in) :: key
        type(input_type), intent(inout) :: input
        type(value_type), allocatable :: values

        call reader%get_list(key, values)
        if (reader%failed()) return
        call move_alloc(values%atoms, input%values)
        if (size(input%values) > most_values) call reader%refuse(key, 'are more than '//to_text(most_values))
        if (any(input%values%kind /= input%values(1)%kind)) call reader%refuse(key, &
            'must be all numbers, all strings or all truth values')
    end subroutine read_list

    !> Read the parameters of a distribution.
    subroutine read_distribution(reader, key, input)
        type(reader_type), intent(inout) :: reader
        character(len=*), intent(in) :: key
        type(input_type), intent(inout) :: input
        real(wp), allocatable :: numbers(:)
        integer :: n

        n = merge(3, 2, input%kind == is_triangular)
        allocate (numbers(n), source=0.0_wp)
        call reader%get_numbers(key, [n], numbers)
        if (reader%failed()) return
        input%a = numbers(1)
        input%b = numbers(n)
        select case (input%kind)
        case (is_normal)
            if (.not. input%b > 0.0_wp) call reader%refuse(key, 'must be [mean, standard deviation], the latter positive')
        case (is_log_normal)
            if (.not. input%b > 0.0_wp) call reader%refuse(key, 'must be [mean, standard deviation] of the logarithm, the '// &
                'latter positive')
        case (is_triangular)
            input%mode = numbers(2)
            if (.not. (input%b > input%a .and. input%mode >= input%a .and. input%mode <= input%b)) then
                call reader%refuse(key, 'must be [lower, most likely, upper], in that order')
            end if
        case default
            if (.not. input%b > input%a) then
                call reader%refuse(key, 'must be [lower, upper], the latter larger')
            else if (input%kind == is_log_uniform .and. .not. input%a > 0.0_wp) then
                call reader%refuse(key, 'must have positive ends')
            end if
        end select
        if (any(input%kind == [is_normal, is_log_normal])) call read_limits(reader, input)
    end subroutine read_distribution

    !> Read the limits of a truncated distribution.
    subroutine read_limits(reader, input)
        type(reader_type), intent(inout) :: reader
        type(input_type), intent(inout) :: input
        real(wp), parameter :: least = 1.0e-12_wp
        real(wp), allocatable :: limits(:)

        input%is_limited = reader%source_of('limits') >= 0
        allocate (limits(2), source=0.0_wp)
        if (.not. input%is_limited) call reader%propose('limits')
        if (input%is_limited) call reader%get_numbers('limits', [2], limits)
        if (reader%failed() .or. .not. input%is_limited) return
        input%low = limits(1)
        input%high = limits(2)
        if (.not. input%high > input%low) then
            call reader%refuse('limits', 'must be [lower, upper], the latter larger')
        else if (input%kind == is_log_normal .and. .not. input%low > 0.0_wp) then
            call reader%refuse('limits', 'must be positive, as log_normal values are')
        else if (.not. input%probability_within() > least) then
            call reader%refuse('limits', 'contain less than 1e-12 of the distribution')
        end if
    end subroutine read_limits

    !> Read a range of numbers with linear or logarithmic spacing.
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
        if (count == 1) call reader%refuse('count', 'must be at least 2, to include both ends')
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

    !> Define the settings that pass the inputs to the scene, with typical values.
    subroutine make_carriers(reader, lines, plan)
        type(reader_type), intent(inout) :: reader
        !> The complete scene.
        type(shown_type), intent(in) :: lines(:)
        type(plan_type), intent(inout) :: plan
        character(len=:), allocatable :: known, text
        integer :: i, j, dot
        logical :: given_twice

        allocate (character(len=1) :: plan%carriers(0))
        if (reader%failed()) return
        do i = 1, size(plan%inputs)
            associate (input => plan%inputs(i))
                dot = index(input%path, '.', back=.true.)
                known = value_in(lines, input%path(:dot - 1), input%path(dot + 1:))
                if (input%unit == '') input%unit = unit_in(lines, input%path(:dot - 1), input%path(dot + 1:))
                do j = 1, i - 1
                    if (plan%inputs(j)%path == input%path) exit
                end do
                if (j < i) input%setting = plan%inputs(j)%setting
                if (j < i) given_twice = any([input%element, plan%inputs(j)%element] == 0) .or. &
                    any(plan%inputs(:i - 1)%element == input%element .and. plan%inputs(:i - 1)%setting == input%setting)
                if (j < i .and. given_twice) then
                    call refuse_input(reader, plan, i, 'gives '//input%path//' a second time')
                    return
                end if
                ! The scene itself refuses all other unknown keys, but accepts an unknown parameter, which would have no effect.
                if (known == '' .and. index(input%path, 'parameters.') == 1) then
                    call refuse_input(reader, plan, i, 'is not a parameter of the scene: '//input%path)
                    return
                end if
                if (input%element > count_elements_of(known)) then
                    call refuse_input(reader, plan, i, 'names an element that does not exist: '//input%path//' '// &
                        trim(merge('is not a list of numbers in the scene', 'has fewer elements                   ', &
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

    !> Set the text of a carrier, which may be longer than the existing ones; if `i` is larger than their number, add a carrier.
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

    !> Check that the scene accepts typical values of all inputs, and each text of a list.
    subroutine check_inputs(reader, models, plan)
        type(reader_type), intent(inout) :: reader
        type(scene_model_type), intent(in) :: models(:)
        type(plan_type), intent(inout) :: plan
        type(scene_type), allocatable :: scene
        type(description_type) :: keys
        type(error_type), allocatable :: error
        character(len=:), allocatable :: last
        integer :: i, j

        if (reader%failed()) return
        keys = plan%scene_keys
        allocate (scene)
        do i = 1, size(plan%carriers)
            call plan%scene_keys%apply(trim(plan%carriers(i)), error)
            if (allocated(error)) exit
        end do
        if (.not. allocated(error)) call interpret_scene(plan%scene_keys, models, scene, error)
        if (allocated(error)) then
            last = error%message
            ! Find the first input that is refused together with the inputs before it.
            do i = 1, size(plan%carriers)
                call keys%apply(trim(plan%carriers(i)), error)
                if (.not. allocated(error)) call interpret_scene(keys, models, scene, error)
                if (allocated(error) .or. i == size(plan%carriers)) exit
            end do
            if (allocated(error)) last = error%message
            call refuse_input(reader, plan, findloc(plan%inputs%setting, i, dim=1), 'is refused by the scene: '//last)
            return
        end if
        do i = 1, size(plan%inputs)
            if (.not. plan%inputs(i)%holds_texts) cycle
            associate (input => plan%inputs(i))
                keys = plan%scene_keys
                do j = 2, merge(size(input%values), 1, any(input%kind == [is_listed, is_choice]))
                    call keys%change(plan%n_settings + input%setting, input%element, input%values(j))
                    call interpret_scene(keys, models, scene, error)
                    if (.not. allocated(error)) cycle
                    call refuse_input(reader, plan, i, 'is refused by the scene: '//error%message)
                    return
                end do
            end associate
        end do
    end subroutine check_inputs

    !> Set an error about an input that shows its line.
    subroutine refuse_input(reader, plan, i, problem)
        type(reader_type), intent(inout) :: reader
        type(plan_type), intent(in) :: plan
        integer, intent(in) :: i
        character(len=*), intent(in) :: problem

        if (plan%inputs(i)%kind == is_from_file) then
            call reader%open_table('sweep')
            call reader%refuse('csv', 'has a column "'//trim(plan%inputs(i)%name)//'", which '//problem)
        else
            call reader%open_table('vary', i - count(plan%inputs%kind == is_from_file))
            call reader%refuse('key', problem)
        end if
    end subroutine refuse_input
end module tandem_io_sweep_inputs
