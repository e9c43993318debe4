! SPDX-License-Identifier: MIT
!> Builds the rolling disk from a scene.
module tandem_io_scene_rolling_disk
    use tandem, only: model_type, positive, reader_type, rolling_disk_type, wp
    implicit none (type, external)
    private

    public :: build_rolling_disk

contains

    !> Build the model with its parameters, and its start.
    subroutine build_rolling_disk(reader, model, q, qd)
        class(reader_type), intent(inout) :: reader
        class(model_type), allocatable, intent(out) :: model
        !> Coordinates and velocities at the start (n).
        real(wp), allocatable, intent(out) :: q(:), qd(:)
        type(rolling_disk_type), allocatable :: disk
        real(wp), parameter :: right_angle = acos(0.0_wp)
        real(wp) :: omega(3), tilt

        allocate (disk)
        call reader%open_table('model')
        call reader%get('mass', disk%mass, positive, 'kg', 'of the disk')
        call reader%get('inertia', disk%inertia, positive, 'kg m^2', "about the axis x' and the diameters y', z'")
        call reader%get('radius', disk%radius, positive, 'm', 'of the disk')
        call reader%get('gravity', disk%gravity, unit='m/s^2', help='downwards')
        call reader%close_table()
        if (reader%failed()) return
        call disk%define()
        disk%is_ready_made = .true.

        omega = [-1.0_wp, 0.01_wp, 0.0_wp]
        tilt = 0.0_wp
        call reader%open_table('initial')
        call reader%get('omega', omega, unit='rad/s', help="angular velocity about x', y', z'")
        call reader%get('tilt', tilt, unit='rad', help='turn about y, away from the upright y-z plane')
        if (abs(tilt) >= right_angle) call reader%refuse('tilt', 'must lie between -pi/2 and pi/2')
        if (reader%failed()) return
        allocate (q(disk%n), qd(disk%n))
        call disk%start(omega, tilt, q, qd)
        call move_alloc(disk, model)
    end subroutine build_rolling_disk
end module tandem_io_scene_rolling_disk
