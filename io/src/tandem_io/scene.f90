! SPDX-License-Identifier: MIT
!> A scene: all data of a run, read from a TOML file and from settings of the command line.
module tandem_io_scene
    use tandem, only: assembly_type, error_type, model_type, motion_name_length, not_negative, options_type, positive, &
        reader_type, equilibrium_search_type, shown_type, threshold_event_type, wp
    use tandem_io_output_fields, only: default_fields, field_names, output_type
    use tandem_io_scene_assembly, only: read_assembly
    use tandem_io_scene_complete, only: complete_text
    use tandem_io_scene_description, only: description_type, key_length
    use tandem_io_scene_events, only: read_events
    use tandem_io_scene_registry, only: scene_model_type, shipped_models
    use tandem_io_scene_equilibrium, only: read_equilibrium, move_to_equilibrium
    use tandem_io_scene_solver, only: read_solver
    use tandem_io_scene_source, only: check_limits
    use tandem_io_scene_text, only: to_toml
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)
    private

    public :: scene_type, read_scene, repeat_scene, open_scene, interpret_scene

    !> Tables of a scene, in the order in which they are read and shown.
    character(len=key_length), parameter :: tables(6) = &
        [character(len=key_length) :: 'scene', 'model', 'initial', 'time', 'solver', 'output']
    !> Tables that may occur several times.
    character(len=key_length), parameter :: arrays(1) = [character(len=key_length) :: 'event']
    !> Smallest number of rows of a run with error control if the scene does not specify rows; enough for a plot of the motion.
    integer, parameter :: default_rows = 300

    type :: scene_type
        !> Name of the scene; by default the name of its file.
        character(len=:), allocatable :: name
        !> Description in one line, and group in which the scene is listed.
        character(len=:), allocatable :: description, list_group
        !> Name of the model.
        character(len=key_length) :: model_name = ''
        !> Model with its parameters, defined.
        class(model_type), allocatable :: model
        !> Options of the solver.
        type(options_type) :: options
        !> Coordinates and velocities at the start (n).
        real(wp), allocatable :: q(:), qd(:)
        !> Settings for assembling the start; not allocated if the start is not assembled.
        type(assembly_type), allocatable :: assembly
        !> True if the start is moved to an equilibrium; names of the motions of a steady motion; result of the search for either.
        logical :: is_equilibrium = .false.
        character(len=motion_name_length), allocatable :: steady(:)
        type(equilibrium_search_type), allocatable :: search
        !> Start and end of the run.
        real(wp) :: t_start = 0.0_wp, t_end = 0.0_wp
        !> Output fields and file.
        type(output_type) :: output
        !> Events; may be empty.
        type(threshold_event_type), allocatable :: events(:)
        !> Complete scene in TOML with all defaults. Reading this text yields the same scene.
        character(len=:), allocatable :: text
        !> Keys with their values, and the models that a scene may name; used by `repeat_scene`.
        type(description_type) :: keys
        type(scene_model_type), allocatable :: models(:)
    end type scene_type

contains

    !> Read a scene. Error messages show the file, the line, and the allowed values.
    subroutine read_scene(path, settings, scene, error, text, models)
        !> Path of a TOML file; for a text, its name in messages.
        character(len=*), intent(in) :: path
        !> Settings `table.key=value`, which override the file, and `--unset table.key`, which remove a key. Later settings override
        !> earlier ones.
        character(len=*), intent(in) :: settings(:)
        type(scene_type), intent(out) :: scene
        type(error_type), allocatable, intent(out) :: error
        !> Text of the scene, which replaces the file.
        character(len=*), intent(in), optional :: text
        !> Models that the scene may name; `shipped_models()` if absent.
        type(scene_model_type), intent(in), optional :: models(:)
        type(scene_model_type), allocatable :: known(:)
        type(description_type) :: description

        if (present(models)) then
            allocate (known, source=models)
        else
            allocate (known, source=shipped_models())
        end if
        call open_scene(path, settings, known, description, error, text)
        if (.not. allocated(error)) call interpret_scene(description, known, scene, error)
    end subroutine read_scene

    !> Build a scene again from its keys, with a separate model. The components `text`, `keys` and `models` are not set.
    subroutine repeat_scene(scene, again, error)
        type(scene_type), intent(in) :: scene
        type(scene_type), intent(out) :: again
        type(error_type), allocatable, intent(out) :: error

        call interpret_scene(scene%keys, scene%models, again, error, is_brief=.true.)
    end subroutine repeat_scene

    !> Read the file and the settings of a scene, and check that all tables are known.
    subroutine open_scene(path, settings, models, description, error, text)
        character(len=*), intent(in) :: path, settings(:)
        !> Models that the scene may name.
        type(scene_model_type), intent(in) :: models(:)
        type(description_type), intent(out) :: description
        type(error_type), allocatable, intent(out) :: error
        character(len=*), intent(in), optional :: text

        call description%open(path, settings, tables, arrays, additional_tables(models), error, text)
    end subroutine open_scene

    !> Names of the additional tables of some models.
    pure function additional_tables(models) result(names)
        type(scene_model_type), intent(in) :: models(:)
        character(len=key_length), allocatable :: names(:)
        integer :: i

        allocate (names(0))
        do i = 1, size(models)
            if (allocated(models(i)%tables)) names = [character(len=key_length) :: names, models(i)%tables]
        end do
    end function additional_tables

    !> Build a scene from its keys.
    subroutine interpret_scene(description, models, scene, error, is_brief, lines)
        type(description_type), intent(in), target :: description
        type(scene_model_type), intent(in) :: models(:)
        type(scene_type), intent(out) :: scene
        type(error_type), allocatable, intent(out) :: error
        !> True to read only the values of keys that were checked before; `text`, `keys` and `models` are then not set.
        logical, intent(in), optional :: is_brief
        !> Lines of the complete scene.
        type(shown_type), allocatable, intent(out), optional :: lines(:)
        type(reader_type) :: reader
        character(len=key_length), allocatable :: names(:)
        integer :: i

        if (present(is_brief)) reader%is_brief = is_brief
        call reader%take_tables(description%entries, arrays)
        names = models%name
        call read_names(reader, description%path, names, scene)
        do i = 1, size(models)
            if (reader%failed() .or. models(i)%name /= scene%model_name) cycle
            if (.not. allocated(models(i)%tables)) then
                if (.not. reader%is_brief) call description%refuse_tables(reader%error)
            else if (allocated(description%fault)) then
                allocate (reader%error, source=description%fault)
            end if
            if (.not. reader%failed()) call models(i)%build(reader, scene%model, scene%q, scene%qd)
            exit
        end do
        if (.not. reader%failed()) then
            call reader%open_table('scene')
            call reader%close_table()
            call reader%open_table('initial')
        end if
        call read_start(reader, scene)
        call read_time(reader, scene)
        if (.not. reader%failed()) call read_solver(reader, scene%model%n, scene%options)
        call check_work(reader, 'solver', 'step', scene%options%step, scene)
        call read_output(reader, scene)
        call check_work(reader, 'output', 'interval', scene%output%interval, scene)
        if (.not. reader%failed()) call read_events(reader, scene%model, scene%events)
        if (reader%failed()) then
            call description%explain(reader, error)
            return
        end if
        if (.not. reader%is_brief) then
            scene%keys = description
            allocate (scene%models, source=models)
            scene%text = complete_text(reader%shown(:reader%n_shown))
            if (present(lines)) lines = reader%shown(:reader%n_shown)
            ! The text with the defaults of many events may exceed the limits for reading.
            call check_limits(description%path//' with every default', scene%text, error)
            if (allocated(error)) return
        end if
        if (scene%is_equilibrium .or. size(scene%steady) > 0) call move_start(scene, error)
    end subroutine interpret_scene

    !> Move the start to an equilibrium or a steady motion.
    subroutine move_start(scene, error)
        type(scene_type), intent(inout) :: scene
        type(error_type), allocatable, intent(out) :: error

        allocate (scene%search)
        call move_to_equilibrium(scene%model, scene%is_equilibrium, scene%steady, scene%t_start, scene%q, scene%qd, &
            scene%search, error, scene%assembly)
    end subroutine move_start

    !> Read the table [scene], which stays open.
    subroutine read_names(reader, path, model_names, scene)
        type(reader_type), intent(inout) :: reader
        character(len=*), intent(in) :: path, model_names(:)
        type(scene_type), intent(inout) :: scene
        character(len=*), parameter :: letters = 'abcdefghijklmnopqrstuvwxyzABCDEFGHIJKLMNOPQRSTUVWXYZ0123456789_-.'
        integer :: last

        scene%name = path(index(path, '/', back=.true.) + 1:)
        last = index(scene%name, '.toml', back=.true.) - 1
        if (last > 0) scene%name = scene%name(:last)
        if (verify(scene%name, letters) > 0 .or. scene%name(1:1) == '.') scene%name = 'scene'
        scene%description = 'no description'
        call reader%open_table('scene')
        call reader%get('name', scene%name, 'of the run and its files: letters, digits, _, - and dots')
        if (verify(scene%name, letters) > 0 .or. scene%name(1:1) == '.') then
            call reader%refuse('name', 'must be letters, digits, _, - and dots, since it names files')
        end if
        call reader%get('description', scene%description, 'for tandem list')
        call reader%get('model', scene%model_name, model_names, required=.true.)
        scene%list_group = 'scenes'
        call reader%get('group', scene%list_group, 'of scenes, under which tandem list shows it')
    end subroutine read_names

    !> Complete the table [initial], of which the model has read its own keys; q and qd can be given instead.
    subroutine read_start(reader, scene)
        type(reader_type), intent(inout) :: reader
        type(scene_type), intent(inout) :: scene

        integer :: source

        if (reader%failed()) return
        source = max(reader%source_of('q'), reader%source_of('qd'))
        associate (n => scene%model%n)
            if (source >= 0) then
                call reader%hide(source, 'cannot be combined with q and qd, which define the complete start')
                call reader%get_numbers('q', [n], scene%q, help='coordinates '//listed_coordinates(scene%model), required=.true.)
                call reader%get_numbers('qd', [n], scene%qd, help='velocities', required=.true.)
            else
                call reader%remark('or instead q and qd: '//to_toml(n)//' numbers each, for '//listed_coordinates(scene%model))
                call reader%propose('q')
                call reader%propose('qd')
            end if
        end associate
        if (.not. (all(ieee_is_finite(scene%q)) .and. all(ieee_is_finite(scene%qd)))) then
            call reader%refuse('q', 'and qd are not finite for these values of [model] and [initial]')
        end if
        call read_assembly(reader, scene%model, scene%assembly)
        call read_equilibrium(reader, scene%model, scene%is_equilibrium, scene%steady)
        call reader%close_table()
    end subroutine read_start

    !> Names of coordinates in one line. If there are many, only the first and the last are listed, because the length of a line is
    !> limited.
    pure function listed_coordinates(model) result(text)
        class(model_type), intent(in) :: model
        character(len=:), allocatable :: text
        integer, parameter :: most = 30
        integer :: i

        text = ''
        do i = 1, model%n
            if (model%n > most .and. i >= most .and. i < model%n) cycle
            if (i == model%n .and. model%n > most) then
                text = text//' ... '
            else if (i > 1) then
                text = text//', '
            end if
            text = text//model%coordinate_label(i)
        end do
    end function listed_coordinates

    !> Read the table [time].
    subroutine read_time(reader, scene)
        type(reader_type), intent(inout) :: reader
        type(scene_type), intent(inout) :: scene

        call reader%open_table('time')
        call reader%get('start', scene%t_start, unit='s', help='of the run')
        call reader%get('end', scene%t_end, unit='s', help='of the run', required=.true.)
        if (.not. scene%t_end > scene%t_start) then
            call reader%refuse('end', 'must be after the start, '//to_toml(scene%t_start))
        end if
        call reader%close_table()
    end subroutine read_time

    !> Refuse a step or an interval so small that the number of steps or rows would be too large.
    subroutine check_work(reader, table, key, h, scene)
        type(reader_type), intent(inout) :: reader
        character(len=*), intent(in) :: table, key
        !> The step or the interval; 0 if it is not used.
        real(wp), intent(in) :: h
        type(scene_type), intent(in) :: scene

        if (reader%failed() .or. .not. h > 0.0_wp) return
        if ((scene%t_end - scene%t_start)/h <= real(huge(1), wp)) return
        call reader%open_table(table)
        if (reader%source_of(key) >= 0) then
            call reader%refuse(key, 'must be larger: at most '//to_toml(huge(1))//' are possible until the end, '// &
                to_toml(scene%t_end))
        else
            call reader%open_table('time')
            call reader%refuse('end', 'must be earlier: at most '//to_toml(huge(1))//' steps of '//to_toml(h)// &
                ' s are possible until then')
        end if
    end subroutine check_work

    !> Read the table [output].
    subroutine read_output(reader, scene)
        type(reader_type), intent(inout) :: reader
        type(scene_type), intent(inout) :: scene
        character(len=:), allocatable :: problem
        integer :: rows

        if (reader%failed()) return
        scene%output%file = scene%name//'.h5'
        scene%output%fields = default_fields
        call reader%open_table('output')
        call reader%replace([character(len=8) :: 'every', 'rows'], by=['interval'])
        call reader%replace([character(len=8) :: 'interval', 'rows'], by=['every'])
        call reader%replace([character(len=8) :: 'interval', 'every'], by=['rows'])
        rows = merge(default_rows, 0, scene%options%is_adaptive() .and. .not. (reader%gives('every') .or. reader%gives('interval')))
        call reader%get('file', scene%output%file, 'result file; overridden by --output')
        call reader%get('every', scene%output%every, positive, 'steps between rows')
        call reader%get('interval', scene%output%interval, unit='s', &
            help='time between rows, by dense output; 0 for rows at steps')
        if (.not. scene%output%interval >= 0.0_wp) call reader%refuse('interval', 'must be positive, or 0 for rows at steps')
        if (scene%output%every > 1 .and. scene%output%interval > 0.0_wp) call reader%refuse('every', &
            'has no effect together with interval; remove one of them (--unset output.every)')
        call reader%get('rows', rows, not_negative, &
            'smallest number of rows, by dense output if there are fewer steps; 0 for rows at steps; '// &
            to_toml(default_rows)//' with error control if neither every nor interval is given, else 0')
        if (rows > 0 .and. (scene%output%every > 1 .or. scene%output%interval > 0.0_wp)) call reader%refuse('rows', &
            'has no effect together with every or interval; remove one of them (--unset output.rows)')
        if (rows > 0) scene%output%spacing = (scene%t_end - scene%t_start)/rows
        call reader%get('flush', scene%output%flush, not_negative, 's', &
            'largest wall time before rows, and the state for tandem resume, are written to disk')
        call reader%get('fields', scene%output%fields, field_names, 'fields to write, in addition to the time')
        problem = scene%output%problem(scene%model)
        if (problem /= '') call reader%refuse('fields', problem)
        call reader%close_table()
    end subroutine read_output
end module tandem_io_scene
