! SPDX-License-Identifier: MIT
!> Builds the articulated vehicle from a scene.
module tandem_io_scene_articulated_vehicle
    use tandem, only: articulated_vehicle_type, model_type, positive, reader_type, wp
    implicit none (type, external)
    private

    public :: build_articulated_vehicle

    !> Smallest nonzero steering frequency, rad/s; the period of a smaller frequency would overflow.
    real(wp), parameter :: slowest = 1.0e-300_wp

contains

    !> Build the model with its parameters, and its start.
    subroutine build_articulated_vehicle(reader, model, q, qd)
        class(reader_type), intent(inout) :: reader
        class(model_type), allocatable, intent(out) :: model
        !> Coordinates and velocities at the start (n).
        real(wp), allocatable, intent(out) :: q(:), qd(:)
        type(articulated_vehicle_type), allocatable :: vehicle
        real(wp) :: speed

        allocate (vehicle)
        call reader%open_table('model')
        call reader%get('mass', vehicle%mass, positive, 'kg', 'of each chassis')
        call reader%get('inertia', vehicle%inertia, positive, 'kg m^2', 'of each chassis')
        call reader%get('half_length', vehicle%half_length, positive, 'm', 'from a centre to its axle and to the joint')
        call reader%get('amplitude', vehicle%amplitude, unit='rad', help='of the steering amplitude sin(frequency t)')
        call reader%get('frequency', vehicle%frequency, unit='rad/s', help='of the steering, for one period; 0 for none')
        if (abs(vehicle%frequency) > 0.0_wp .and. abs(vehicle%frequency) < slowest) then
            call reader%refuse('frequency', 'must be 0, or at least 1e-300 in size')
        end if
        call reader%close_table()
        if (reader%failed()) return
        call vehicle%define()
        vehicle%is_ready_made = .true.

        speed = 15.0_wp
        call reader%open_table('initial')
        call reader%get('speed', speed, unit='m/s', help='along x, straight ahead')
        if (reader%failed()) return
        allocate (q(vehicle%n), qd(vehicle%n))
        call vehicle%start(speed, q, qd)
        call move_alloc(vehicle, model)
    end subroutine build_articulated_vehicle
end module tandem_io_scene_articulated_vehicle
