! SPDX-License-Identifier: MIT
!> Reads the tables [[event]]: watched quantities, and actions.
module tandem_io_scene_events
    use tandem, only: label_length, model_type, reader_type, threshold_event_type, to_text, wp
    use tandem_io_scene_text, only: listed, nearest_name
    implicit none (type, external)
    private

    public :: read_events

    !> Largest length of a path /GROUP/NAME/WHAT.
    integer, parameter :: path_length = label_length + 40
    character(len=7), parameter :: directions(-1:1) = [character(len=7) :: 'falling', 'both', 'rising']
    character(len=6), parameter :: actions(2) = [character(len=6) :: 'record', 'stop']

contains

    !> Read the events of a scene.
    subroutine read_events(reader, model, events)
        class(reader_type), intent(inout) :: reader
        !> Model whose coordinates, constraint rows and quantities can be watched.
        class(model_type), intent(inout) :: model
        type(threshold_event_type), allocatable, intent(out) :: events(:)
        character(len=:), allocatable :: name, watch, change
        character(len=7) :: direction
        character(len=6) :: action
        integer :: i

        allocate (events(reader%n_of('event')))
        do i = 1, size(events)
            associate (event => events(i))
                call reader%open_table('event', i)
                name = ''
                watch = ''
                call reader%get('name', name, 'in messages', .true.)
                if (len_trim(name) > label_length) call reader%refuse('name', 'must not be longer than '//to_text(label_length))
                event%name = name
                if (any(events(:i - 1)%name == event%name)) call reader%refuse('name', 'is the name of another event')
                call reader%get('watch', watch, 'a coordinate, "qd:COORDINATE", "lambda:ROW", "/PATH"', .true.)
                if (index(watch, '/') == 1) then
                    call find_measured(reader, model, watch, event)
                else
                    call find_quantity(reader, model, watch, event)
                end if
                call reader%get('value', event%value, help='at which it happens')
                direction = 'both'
                call reader%get('direction', direction, directions)
                event%direction = findloc(directions, direction, dim=1) - 2
                action = 'record'
                call reader%get('action', action, actions)
                event%stops = action == 'stop'
                if (allocated(change)) deallocate (change)
                if (reader%gives('change')) then
                    call reader%get('change', change, 'of the model, with semicolons between')
                    call read_changes(reader, model, change, event)
                else
                    call reader%propose('change')
                end if
                call reader%close_table()
            end associate
        end do
    end subroutine read_events

    !> Find the measured quantity with a path, /GROUP/NAME/WHAT. For a vector, .x, .y or .z is appended to the path.
    subroutine find_measured(reader, model, watch, event)
        class(reader_type), intent(inout) :: reader
        class(model_type), intent(in) :: model
        character(len=*), intent(in) :: watch
        type(threshold_event_type), intent(inout) :: event
        character(len=*), parameter :: axis(3) = ['x', 'y', 'z']
        character(len=path_length), allocatable :: paths(:)
        character(len=:), allocatable :: path, wanted
        integer :: i, k, n, dot

        if (reader%failed()) return
        event%quantity = 'shown'
        dot = index(watch, '.', back=.true.)
        k = 0
        if (dot > 0) k = findloc(axis, watch(dot + 1:), dim=1)
        path = watch
        if (k > 0) path = watch(:dot - 1)
        n = 0
        allocate (paths(0))
        if (allocated(model%quantities)) then
            do i = 1, size(model%quantities)
                associate (quantity => model%quantities(i))
                    if (quantity%place() /= path) then
                        paths = [character(len=path_length) :: paths, quantity%place()]
                        n = n + max(1, quantity%width)
                        cycle
                    end if
                    if (.not. quantity%of_state .or. quantity%width > size(axis)) then
                        call reader%refuse('watch', 'cannot be watched: choose a position, a velocity, a force or an energy')
                    else if (quantity%width > 0 .and. k == 0) then
                        call reader%refuse('watch', 'has three entries: append .x, .y or .z')
                    else if (quantity%width == 0 .and. k > 0) then
                        call reader%refuse('watch', 'is a scalar: remove the suffix')
                    end if
                    event%index = n + max(1, k)
                    event%needs_multipliers = quantity%of_multipliers
                    return
                end associate
            end do
        end if
        wanted = path
        path = 'is not an output of the model'
        if (nearest_name(wanted, paths) /= '') path = path//'; did you mean "'//nearest_name(wanted, paths)//'"?'
        if (size(paths) > 0) path = path//'; there are '//listed(paths)
        call reader%refuse('watch', path)
    end subroutine find_measured

    !> Read the changes made by an event: texts that the model interprets, separated by semicolons.
    subroutine read_changes(reader, model, change, event)
        class(reader_type), intent(inout) :: reader
        class(model_type), intent(inout) :: model
        character(len=*), intent(in) :: change
        type(threshold_event_type), intent(inout) :: event
        character(len=2*len(event%words)) :: problem
        real(wp) :: nowhere(model%n)
        integer :: from, length

        if (reader%failed()) return
        nowhere = 0.0_wp
        event%changes = .true.
        allocate (event%words(0))
        from = 1
        do while (from <= len(change))
            length = index(change(from:)//';', ';') - 1
            if (length > len(event%words)) then
                problem = 'has a change longer than '//to_text(len(event%words))//' characters'
            else
                call model%change(change(from:from + length - 1), .true., 0.0_wp, nowhere, problem)
            end if
            if (problem /= '') then
                call reader%refuse('change', trim(problem))
                return
            end if
            event%words = [character(len=len(event%words)) :: event%words, change(from:from + length - 1)]
            from = from + length + 1
        end do
    end subroutine read_changes

    !> Find the coordinate, velocity or multiplier with a name.
    subroutine find_quantity(reader, model, watch, event)
        class(reader_type), intent(inout) :: reader
        class(model_type), intent(in) :: model
        character(len=*), intent(in) :: watch
        type(threshold_event_type), intent(inout) :: event
        character(len=label_length), allocatable :: names(:)
        character(len=:), allocatable :: wanted, problem
        integer :: i

        if (reader%failed()) return
        event%quantity = 'q'
        wanted = trim(watch)
        if (index(watch, 'qd:') == 1) event%quantity = 'qd'
        if (index(watch, 'lambda:') == 1) event%quantity = 'lambda'
        if (event%quantity /= 'q') wanted = trim(adjustl(watch(index(watch, ':') + 1:)))
        if (event%quantity == 'lambda') then
            allocate (names(model%n_constraints()))
            do i = 1, size(names)
                names(i) = model%row_name(i)
            end do
            problem = 'is not a constraint; valid names: '
        else
            allocate (names(model%n))
            do i = 1, size(names)
                names(i) = model%coordinate_label(i)
            end do
            problem = 'is not a coordinate; valid names: '
        end if
        event%index = findloc(names == wanted, .true., dim=1)
        if (event%index > 0) return
        problem = problem//listed(names)
        if (nearest_name(wanted, names) /= '') problem = problem//'; did you mean "'//nearest_name(wanted, names)//'"?'
        if (allocated(model%quantities)) problem = problem// &
            '; quantities of the result file are watched by path, such as /joints/NAME/angle or /sensors/NAME'
        call reader%refuse('watch', problem)
    end subroutine find_quantity
end module tandem_io_scene_events
