! SPDX-License-Identifier: MIT
!> tandem show: a complete scene in TOML, as accepted by `tandem run`.
module tandem_cli_show
    use tandem, only: error_type
    use tandem_cli_arguments, only: arguments_type
    use tandem_cli_messages, only: print_to_stderr, done, input_wrong, say
    use tandem_io, only: check_target, find_scene, read_scene, scene_type, write_drawing
    implicit none (type, external)
    private

    public :: show

contains

    !> Print a scene with all defaults, or write its drawing to a file.
    subroutine show(arguments, code)
        type(arguments_type), intent(in) :: arguments
        !> Exit code.
        integer, intent(out) :: code
        type(scene_type) :: scene
        type(error_type), allocatable :: error
        character(len=:), allocatable :: path, drawing
        logical :: is_new

        call find_scene(arguments%scene, path, error)
        if (.not. allocated(error)) call read_scene(path, arguments%settings, scene, error, models=arguments%models)
        drawing = arguments%value_of('--drawing', '')
        if (.not. allocated(error) .and. drawing /= '') call check_target(drawing, arguments%force, is_new, error)
        if (.not. allocated(error) .and. drawing /= '') call write_drawing(drawing, scene%text, scene%model, error)
        if (allocated(error)) then
            call print_to_stderr(error%message)
            code = input_wrong
            return
        end if
        ! The text ends with a newline already.
        if (drawing == '') call say(scene%text(:len(scene%text) - 1))
        code = done
    end subroutine show
end module tandem_cli_show
