! SPDX-License-Identifier: MIT
!> Reads the tables [[event]]: what is watched, and what happens there.
module tandem_io_scene_events
    use tandem, only: label_length, model_type, threshold_event_type, to_text
    use tandem_io_scene_reader, only: reader_type
    use tandem_io_scene_text, only: listed, nearest_name
    implicit none (type, external)
    private

    public :: read_events

    character(len=7), parameter :: directions(-1:1) = [character(len=7) :: 'falling', 'both', 'rising']
    character(len=6), parameter :: actions(2) = [character(len=6) :: 'record', 'stop']

contains

    !> The events of a scene, none where it has none.
    subroutine read_events(reader, model, events)
        class(reader_type), intent(inout) :: reader
        !> The model, whose coordinates and constraint rows can be watched.
        class(model_type), intent(in) :: model
        type(threshold_event_type), allocatable, intent(out) :: events(:)
        character(len=:), allocatable :: name, watch
        character(len=7) :: direction
        character(len=6) :: action
        integer :: i

        allocate (events(reader%count_tables('event')))
        do i = 1, size(events)
            associate (event => events(i))
                call reader%open_element('event', i)
                if (allocated(name)) deallocate (name, watch)
                call reader%get('name', name, 'in messages', .true.)
                if (len_trim(name) > label_length) call reader%refuse('name', 'must not be longer than '//to_text(label_length))
                event%name = name
                if (any(events(:i - 1)%name == event%name)) call reader%refuse('name', 'is the name of another event')
                call reader%get('watch', watch, 'a coordinate, "qd:COORDINATE" or "lambda:CONSTRAINT"', .true.)
                call find_quantity(reader, model, watch, event)
                call reader%get('value', event%value, help='at which it happens')
                direction = 'both'
                call reader%get('direction', direction, directions)
                event%direction = findloc(directions, direction, dim=1) - 2
                action = 'record'
                call reader%get('action', action, actions)
                event%stops = action == 'stop'
                call reader%close_table()
            end associate
        end do
    end subroutine read_events

    !> What a text names.
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
            problem = 'names no constraint; there are '
        else
            allocate (names(model%n))
            do i = 1, size(names)
                names(i) = 'q'//to_text(i)
                if (allocated(model%coordinate_name)) names(i) = model%coordinate_name(i)
            end do
            problem = 'names no coordinate; there are '
        end if
        event%index = findloc(names == wanted, .true., dim=1)
        if (event%index > 0) return
        problem = problem//listed(names)
        if (nearest_name(wanted, names) /= '') problem = problem//'; did you mean "'//nearest_name(wanted, names)//'"?'
        call reader%refuse('watch', problem)
    end subroutine find_quantity
end module tandem_io_scene_events
