! SPDX-License-Identifier: MIT
!> Builds the motorcycle from a scene; the angle of the fork selects a standard motorcycle or a chopper.
module tandem_io_scene_motorcycle
    use tandem, only: model_type, motorcycle_type, not_negative, positive, reader_type, wp
    implicit none (type, external)
    private

    public :: build_motorcycle

    !> Smallest nonzero steering frequency, rad/s; the period of a smaller frequency would overflow.
    real(wp), parameter :: slowest = 1.0e-300_wp

contains

    !> Build the model with its parameters, and its start.
    subroutine build_motorcycle(reader, model, q, qd)
        class(reader_type), intent(inout) :: reader
        class(model_type), allocatable, intent(out) :: model
        !> Coordinates and velocities at the start (n).
        real(wp), allocatable, intent(out) :: q(:), qd(:)
        type(motorcycle_type), allocatable :: motorcycle
        real(wp), parameter :: right_angle = acos(0.0_wp)
        real(wp) :: speed
        integer :: stat

        allocate (motorcycle)
        associate (m => motorcycle)
            call reader%open_table('model')
            call reader%get('mass', m%mass, positive, 'kg', 'of the chassis')
            call reader%get('inertia', m%inertia, positive, 'kg m^2', "of the chassis about x', y', z'")
            call reader%get('gravity', m%gravity, unit='m/s^2', help='downwards')
            call reader%get('fork_angle', m%fork_angle, unit='rad', help='from the vertical: 0.2 standard, pi/4 chopper')
            if (abs(m%fork_angle) >= right_angle) call reader%refuse('fork_angle', 'must lie between -pi/2 and pi/2')
            call reader%get('stiffness', m%stiffness, positive, 'N/m', 'of the front suspension')
            call reader%get('damping', m%damping, not_negative, 'N s/m', 'of the front suspension')
            call reader%get('amplitude', m%amplitude, unit='rad', help='of the steering -amplitude sin(frequency t)')
            call reader%get('frequency', m%frequency, unit='rad/s', help='of the steering, for one period; 0 for none')
            if (abs(m%frequency) > 0.0_wp .and. abs(m%frequency) < slowest) then
                call reader%refuse('frequency', 'must be 0, or at least 1e-300 in size')
            end if
            call reader%get('driving_force', m%driving_force, unit='N', help="along the chassis' y'")
            call reader%get('wheel_radius', m%wheel_radius, positive, 'm', 'of the three wheels')
            call reader%get('rear_length', m%rear_length, positive, 'm', 'from the centre back to the rear axle')
            call reader%get('half_track', m%half_track, positive, 'm', 'half the distance of the rear wheels')
            call reader%get('fork_forward', m%fork_forward, positive, 'm', 'from the centre forward to the top of the fork')
            call reader%get('fork_height', m%fork_height, positive, 'm', 'of the top of the fork above the centre')
            call reader%get('free_length', m%free_length, not_negative, 'm', &
                'of the spring; 0 for (fork_height + mass gravity/(2 stiffness))/cos(fork_angle)')
            call reader%close_table()
        end associate
        if (reader%failed()) return
        call motorcycle%define()
        motorcycle%is_ready_made = .true.

        speed = 15.0_wp
        call reader%open_table('initial')
        call reader%get('speed', speed, unit='m/s', help='along y, in the static equilibrium')
        if (reader%failed()) return
        allocate (q(motorcycle%n), qd(motorcycle%n))
        call motorcycle%start(speed, q, qd, stat)
        if (stat /= 0) call reader%refuse('speed', &
            'requires an equilibrium at the start, and none exists for the parameters of [model]')
        call move_alloc(motorcycle, model)
    end subroutine build_motorcycle
end module tandem_io_scene_motorcycle
