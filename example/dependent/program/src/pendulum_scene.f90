!> Reads the pendulum from a scene.
module pendulum_scene
    use pendulum, only: pendulum_type
    use tandem, only: model_type, wp
    use tandem_command_line, only: positive, reader_type
    implicit none (type, external)
    private

    public :: read_pendulum

contains

    !> The parameters from [model], the start from [initial]. An error stays in the reader, with its file and line.
    subroutine read_pendulum(reader, model, q, qd)
        class(reader_type), intent(inout) :: reader
        class(model_type), allocatable, intent(out) :: model
        !> Coordinates and velocities at the start.
        real(wp), allocatable, intent(out) :: q(:), qd(:)
        type(pendulum_type), allocatable :: pendulum
        real(wp) :: angle

        allocate (pendulum)
        call reader%open_table('model')
        call reader%get('mass', pendulum%mass, positive, 'kg')
        call reader%get('length', pendulum%length, positive, 'm', 'of the rod')
        call reader%get('gravity', pendulum%gravity, unit='m/s^2')
        call reader%close_table()
        if (reader%failed()) return
        call pendulum%define()

        angle = 1.0_wp
        call reader%open_table('initial')
        call reader%get('angle', angle, unit='rad', help='from the lowest point, at rest')
        q = pendulum%length*[sin(angle), -cos(angle)]
        qd = [0.0_wp, 0.0_wp]
        call move_alloc(pendulum, model)
    end subroutine read_pendulum
end module pendulum_scene
