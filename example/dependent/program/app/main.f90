!> tandem with the pendulum beside the shipped models.
program main
    use pendulum_scene, only: read_pendulum
    use tandem_command_line, only: command_line, scene_model_type
    implicit none (type, external)
    integer :: code

    call command_line(code, [scene_model_type('pendulum', read_pendulum)])
    stop code, quiet=.true.
end program main
