! SPDX-License-Identifier: MIT
!> tandem list: the named scenes, and the steppers.
module tandem_cli_list
    use tandem, only: error_type, new_stepper, properties_type, stepper_choices, to_text
    use tandem_cli_arguments, only: arguments_type
    use tandem_cli_messages, only: done, say
    use tandem_io, only: json_type, path_length, read_scene, scene_type, shipped_scenes
    use tandem_stepper, only: stepper_type
    implicit none (type, external)
    private

    public :: list

    !> Line of a scene, and group in which it is listed.
    type :: line_type
        character(len=:), allocatable :: text, group
    end type line_type

contains

    !> Print scenes and steppers, one line each.
    subroutine list(arguments, code)
        type(arguments_type), intent(in) :: arguments
        !> Exit code.
        integer, intent(out) :: code

        code = done
        if (arguments%json) then
            call list_as_json(arguments)
            return
        end if
        call list_scenes(arguments)
        call say('')
        call list_steppers()
    end subroutine list

    !> Print the scenes.
    subroutine list_scenes(arguments)
        type(arguments_type), intent(in) :: arguments
        character(len=path_length), allocatable :: paths(:)
        type(scene_type) :: scene
        type(error_type), allocatable :: error
        type(line_type), allocatable :: lines(:)
        character(len=:), allocatable :: group
        integer :: i, k

        allocate (paths, source=shipped_scenes())
        if (size(paths) == 0) then
            call say('No scenes were found; set TANDEM_SCENES to their folder.')
            return
        end if
        call say(row('scene', 'model', 'description'))
        allocate (lines(size(paths)))
        do i = 1, size(paths)
            call read_scene(trim(paths(i)), [character(len=1) ::], scene, error, models=arguments%models)
            lines(i)%group = 'scenes that cannot be read'
            if (allocated(error)) then
                lines(i)%text = row(trim(paths(i)), '', 'has an error, see tandem show '//trim(paths(i)))
            else
                lines(i)%text = row(file_name(trim(paths(i))), trim(scene%model_name), scene%description)
                lines(i)%group = scene%list_group
            end if
        end do
        ! Groups appear in the order of their first scenes.
        do i = 1, size(lines)
            group = lines(i)%group
            if (group == '') cycle
            call say(group//':')
            do k = i, size(lines)
                if (lines(k)%group /= group) cycle
                call say(lines(k)%text)
                lines(k)%group = ''
            end do
        end do
    end subroutine list_scenes

    !> Print the steppers.
    subroutine list_steppers()
        class(stepper_type), allocatable :: stepper
        type(properties_type) :: properties
        integer :: i

        call say(row('stepper', 'order, stages', 'kind, stability'))
        do i = 1, size(stepper_choices)
            call new_stepper(stepper_choices(i), stepper)
            properties = stepper%properties()
            call say(row(trim(properties%name), to_text(properties%order)//', '// &
                to_text(properties%stages), trim(kind_of(properties))//', '// &
                trim(properties%stability)))
        end do
    end subroutine list_steppers

    !> Explicit, implicit, or both.
    pure function kind_of(properties) result(kind)
        type(properties_type), intent(in) :: properties
        character(len=8) :: kind

        kind = merge('implicit', 'explicit', properties%implicit)
        if (properties%partner /= '') kind = 'both'
    end function kind_of

    !> Print the list as one JSON object.
    subroutine list_as_json(arguments)
        type(arguments_type), intent(in) :: arguments
        character(len=path_length), allocatable :: paths(:)
        class(stepper_type), allocatable :: stepper
        type(properties_type) :: properties
        type(scene_type) :: scene
        type(error_type), allocatable :: error
        type(json_type) :: json
        integer :: i

        allocate (paths, source=shipped_scenes())
        call json%begin_object()
        call json%begin_array('scenes')
        do i = 1, size(paths)
            call read_scene(trim(paths(i)), [character(len=1) ::], scene, error, models=arguments%models)
            call json%begin_object()
            call json%add('name', file_name(trim(paths(i))))
            call json%add('path', paths(i))
            if (allocated(error)) then
                call json%add('error', error%message)
            else
                call json%add('model', scene%model_name)
                call json%add('group', scene%list_group)
                call json%add('description', scene%description)
            end if
            call json%end_object()
        end do
        call json%end_array()
        call json%begin_array('steppers')
        do i = 1, size(stepper_choices)
            call new_stepper(stepper_choices(i), stepper)
            properties = stepper%properties()
            call json%begin_object()
            call json%add('name', properties%name)
            call json%add('order', properties%order)
            call json%add('stages', properties%stages)
            call json%add('implicit', properties%implicit)
            call json%add('stability', properties%stability)
            call json%end_object()
        end do
        call json%end_array()
        call json%end_object()
        call say(json%text)
    end subroutine list_as_json

    !> Name of a scene file.
    pure function file_name(path) result(name)
        character(len=*), intent(in) :: path
        character(len=:), allocatable :: name

        name = path(index(path, '/', back=.true.) + 1:len(path) - len('.toml'))
    end function file_name

    !> Line with three columns.
    pure function row(first, second, third) result(line)
        character(len=*), intent(in) :: first, second, third
        character(len=:), allocatable :: line
        integer, parameter :: widths(2) = [22, 22]

        line = first//repeat(' ', max(1, widths(1) - len(first)))
        line = line//second//repeat(' ', max(1, sum(widths) - len(line) - len(second)))//third
    end function row
end module tandem_cli_list
