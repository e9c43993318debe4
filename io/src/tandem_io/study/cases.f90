! SPDX-License-Identifier: MIT
!> The stiff and extreme cases of the stability study: descriptions and scenes.
module tandem_io_study_cases
    use tandem, only: articulated_vehicle_type, error_type, model_type, motorcycle_type, rolling_disk_type, set_error, to_text, wp
    use tandem_io_scene, only: scene_type
    use tandem_io_scene_text, only: to_toml
    use tandem_io_study_bushing, only: bushing_type
    use tandem_io_study_hidden, only: hidden_type
    use tandem_io_study_quadratic, only: quadratic_type
    use tandem_status, only: status_invalid_model
    implicit none (type, external)
    private

    public :: case_type, case_name_length, case_names, case_groups, build_case

    !> Largest length of the name of a case or a group.
    integer, parameter :: case_name_length = 24

    !> Row of the table of cases: name, group, and a number that measures how extreme the case is.
    type :: entry_type
        character(len=case_name_length) :: name, group
        real(wp) :: number
    end type entry_type

    real(wp), parameter :: pi = 4.0_wp*atan(1.0_wp)

    !> The cases. The name up to the last underscore selects the scene, see `build_case`.
    type(entry_type), parameter :: entries(64) = [ &
        entry_type('motorcycle_1', 'stiff', 1.0_wp), &
        entry_type('motorcycle_1e2', 'stiff', 1.0e2_wp), &
        entry_type('motorcycle_1e4', 'stiff', 1.0e4_wp), &
        entry_type('motorcycle_1e6', 'stiff', 1.0e6_wp), &
        entry_type('spring_1e2', 'stiff', 1.0e2_wp), &
        entry_type('spring_1e4', 'stiff', 1.0e4_wp), &
        entry_type('spring_1e6', 'stiff', 1.0e6_wp), &
        entry_type('spring_1e8', 'stiff', 1.0e8_wp), &
        entry_type('damped_1e2', 'stiff', 1.0e2_wp), &
        entry_type('damped_1e4', 'stiff', 1.0e4_wp), &
        entry_type('damped_1e6', 'stiff', 1.0e6_wp), &
        entry_type('damped_1e8', 'stiff', 1.0e8_wp), &
        entry_type('slow_1e1', 'stiff', 1.0e1_wp), &
        entry_type('slow_1e2', 'stiff', 1.0e2_wp), &
        entry_type('slow_1e3', 'stiff', 1.0e3_wp), &
        entry_type('slow_1e4', 'stiff', 1.0e4_wp), &
        entry_type('slow_1e5', 'stiff', 1.0e5_wp), &
        entry_type('slow_1e6', 'stiff', 1.0e6_wp), &
        entry_type('bushing_1e6', 'stiff', 1.0e6_wp), &
        entry_type('bushing_1e8', 'stiff', 1.0e8_wp), &
        entry_type('bushing_1e10', 'stiff', 1.0e10_wp), &
        entry_type('flat_1e-1', 'disk', 1.0e-1_wp), &
        entry_type('flat_1e-2', 'disk', 1.0e-2_wp), &
        entry_type('flat_1e-3', 'disk', 1.0e-3_wp), &
        entry_type('falling', 'disk', 0.0_wp), &
        entry_type('falling_1e-6', 'disk', 1.0e-6_wp), &
        entry_type('spinning_1e3', 'disk', 1.0e3_wp), &
        entry_type('rolling_1e3', 'disk', 1.0e3_wp), &
        entry_type('rest', 'disk', 0.0_wp), &
        entry_type('edge', 'disk', 1.0e-3_wp), &
        entry_type('steering_90', 'vehicle', pi/2), &
        entry_type('steering_180', 'vehicle', pi), &
        entry_type('speed_0', 'vehicle', 0.0_wp), &
        entry_type('speed_1e4', 'vehicle', 1.0e4_wp), &
        entry_type('masses_1e-12', 'masses', 1.0e-12_wp), &
        entry_type('masses_1e-8', 'masses', 1.0e-8_wp), &
        entry_type('masses_1e-4', 'masses', 1.0e-4_wp), &
        entry_type('masses_1e4', 'masses', 1.0e4_wp), &
        entry_type('masses_1e8', 'masses', 1.0e8_wp), &
        entry_type('light_1e-12', 'masses', 1.0e-12_wp), &
        entry_type('light_0', 'masses', 0.0_wp), &
        entry_type('diskunits_km', 'units', 1.0e-3_wp), &
        entry_type('diskunits_um', 'units', 1.0e6_wp), &
        entry_type('vehicleunits_km', 'units', 1.0e-3_wp), &
        entry_type('vehicleunits_um', 'units', 1.0e6_wp), &
        entry_type('motorunits_km', 'units', 1.0e-3_wp), &
        entry_type('motorunits_um', 'units', 1.0e6_wp), &
        entry_type('step_1e-6', 'steps', 1.0e-6_wp), &
        entry_type('step_1e-5', 'steps', 1.0e-5_wp), &
        entry_type('step_1e-3', 'steps', 1.0e-3_wp), &
        entry_type('step_1e-1', 'steps', 1.0e-1_wp), &
        entry_type('step_1', 'steps', 1.0_wp), &
        entry_type('parallel_1e-2', 'parallel', 1.0e-2_wp), &
        entry_type('parallel_1e-4', 'parallel', 1.0e-4_wp), &
        entry_type('parallel_1e-8', 'parallel', 1.0e-8_wp), &
        entry_type('parallel_1e-12', 'parallel', 1.0e-12_wp), &
        entry_type('kink', 'kinks', 0.0_wp), &
        entry_type('hiddenkink', 'kinks', 0.0_wp), &
        entry_type('jump', 'kinks', 0.0_wp), &
        entry_type('hiddenjump', 'kinks', 0.0_wp), &
        entry_type('motorjump', 'kinks', 0.0_wp), &
        entry_type('hiddenmotorjump', 'kinks', 0.0_wp), &
        entry_type('milliondisk', 'million', 1.0e6_wp), &
        entry_type('millionvehicle', 'million', 1.0e6_wp)]

    integer :: index_of_entry
    !> Names and groups of the cases, in the same order.
    character(len=case_name_length), parameter :: case_names(size(entries)) = [(entries(index_of_entry)%name, &
        index_of_entry=1, size(entries))]
    character(len=case_name_length), parameter :: case_groups(size(entries)) = [(entries(index_of_entry)%group, &
        index_of_entry=1, size(entries))]

    !> A case: a scene, and the criteria for its results.
    type, extends(scene_type) :: case_type
        character(len=case_name_length) :: group = ''
        !> True if there are runs with fixed steps; true if there are runs with error control; their tolerance.
        logical :: with_step = .true., with_rtol = .true.
        real(wp) :: rtol = 1.0e-6_wp
        !> Model for the reference solution; not allocated if it is the model of the case.
        class(model_type), allocatable :: true_model
        !> Steppers for the reference solution, and their tolerances.
        character(len=16) :: judges(2) = [character(len=16) :: 'dop853', 'dopri5']
        real(wp) :: judges_rtol(2) = [1.0e-13_wp, 1.0e-12_wp]
        !> True if the exact motion is rest.
        logical :: is_at_rest = .false.
        !> True if the run is too long for a reference solution; instead, the energy, the constraints and the memory are checked.
        logical :: is_endless = .false.
        !> Units of the coordinates relative to the same case in metres (n); not allocated if the case is in metres.
        real(wp), allocatable :: units(:)
        !> Time limit of a run, seconds.
        real(wp) :: most_seconds = 5.0_wp
    end type case_type

contains

    !> Build a case by its name.
    subroutine build_case(name, subject, error, in_metres)
        character(len=*), intent(in) :: name
        type(case_type), intent(out) :: subject
        type(error_type), allocatable, intent(out) :: error
        !> True to build a case that uses other units in metres.
        logical, intent(in), optional :: in_metres
        real(wp) :: unit
        integer :: i, stat

        i = findloc(case_names == name, .true., dim=1)
        if (i == 0) then
            call set_error(error, status_invalid_model, 'there is no case "'//name//'"')
            return
        end if
        subject%name = trim(name)
        subject%group = entries(i)%group
        subject%model_name = name
        subject%options%atol = 0.0_wp
        unit = entries(i)%number
        if (present(in_metres)) unit = merge(1.0_wp, unit, in_metres)
        call fill_case(name, entries(i)%number, unit, subject, stat)
        if (stat /= 0) call set_error(error, status_invalid_model, 'the case "'//name//'" has no start')
    end subroutine build_case

    !> Set description, scene and run of a case.
    subroutine fill_case(name, x, unit, subject, stat)
        character(len=*), intent(in) :: name
        !> Number that measures how extreme the case is, and unit of length.
        real(wp), intent(in) :: x, unit
        type(case_type), intent(inout) :: subject
        !> Nonzero if the start cannot be computed.
        integer, intent(out) :: stat

        stat = 0
        select case (name(:index(name//'_', '_') - 1))
        case ('motorcycle')
            call build_stiff_motorcycle(subject, x, stat)
        case ('spring', 'damped')
            call build_spring(subject, x, name(1:1) == 'd')
        case ('slow')
            call build_slow(subject, x)
        case ('bushing')
            call build_bushing(subject, x)
        case ('flat')
            call build_flat(subject, x)
        case ('falling')
            subject%description = 'the disk falls flat from a tilt of 0.1, spinning at '//to_toml(x)//' rad/s'
            call build_disk(subject, [x, 0.0_wp, 0.0_wp], 0.1_wp, 1.0_wp, 2.0_wp, 1.0e-2_wp)
            ! Flat on the plane the motion of the disk ends, so that no run can be complete.
            subject%is_at_rest = .true.
        case ('spinning')
            subject%description = 'the disk spins about its diameter at 1000 rad/s, tilted by 0.1'
            call build_disk(subject, [0.0_wp, 0.0_wp, x], 0.1_wp, 1.0_wp, 0.05_wp, 1.0e-4_wp)
        case ('rolling')
            subject%description = 'the disk rolls at 1000 rad/s'
            call build_disk(subject, [-x, 0.01_wp, 0.0_wp], 0.1_wp, 1.0_wp, 0.05_wp, 1.0e-4_wp)
        case ('rest')
            subject%description = 'the disk rests upright: nothing may move'
            call build_disk(subject, [0.0_wp, 0.0_wp, 0.0_wp], 0.0_wp, 1.0_wp, 2.0_wp, 1.0e-2_wp)
            subject%is_at_rest = .true.
        case ('edge')
            subject%description = 'the disk stands on its edge, tilted by 0.001'
            call build_disk(subject, [0.0_wp, 0.0_wp, 0.0_wp], x, 1.0_wp, 2.0_wp, 1.0e-2_wp)
        case ('steering')
            subject%description = 'the vehicle steers through '//to_text(nint(x*180/pi))//' degrees'
            call build_vehicle(subject, 15.0_wp, x, 1.0_wp, 3.0_wp, 1.0e-3_wp)
        case ('speed')
            subject%description = 'the vehicle at '//to_toml(x)//' m/s'
            call build_vehicle(subject, x, 0.017_wp, 1.0_wp, 1.0_wp, 1.0e-3_wp)
            subject%is_at_rest = .not. x > 0.0_wp
        case ('masses')
            call build_masses(subject, x)
        case ('light')
            call build_light(subject, x)
        case ('diskunits')
            subject%description = 'the disk in units of '//to_toml(1/x)//' m'
            call build_disk(subject, [-1.0_wp, 0.01_wp, 0.0_wp], 0.0_wp, unit, 5.0_wp, 1.0e-2_wp)
        case ('vehicleunits')
            subject%description = 'the vehicle in units of '//to_toml(1/x)//' m'
            call build_vehicle(subject, 15.0_wp, 0.1_wp, unit, 5.0_wp, 1.0e-2_wp)
        case ('motorunits')
            subject%description = 'the motorcycle in units of '//to_toml(1/x)//' m'
            call build_motorcycle(subject, unit, 5.0_wp, stat)
        case ('step')
            subject%description = 'the disk with steps of '//to_toml(x)//' s'
            call build_disk(subject, [-1.0_wp, 0.01_wp, 0.0_wp], 0.0_wp, 1.0_wp, min(10.0_wp, 3.0e4_wp*x), x)
            subject%with_rtol = .false.
            ! The limit allows thirty thousand steps on a busy machine.
            subject%most_seconds = 60.0_wp
        case ('parallel')
            call build_parallel(subject, x)
        case ('kink', 'hiddenkink')
            subject%description = 'the vehicle, whose steering has a kink'//note_of(name)
            call build_vehicle(subject, 15.0_wp, 0.1_wp, 1.0_wp, 8.0_wp, 1.0e-2_wp)
            if (index(name, 'hidden') == 1) call hide(subject)
        case ('jump', 'hiddenjump')
            subject%description = 'the vehicle, whose steering jumps back from 0.1 rad'//note_of(name)
            call build_vehicle(subject, 15.0_wp, 0.1_wp, 1.0_wp, 3.0_wp, 1.0e-2_wp)
            subject%model%breakpoints = [pi/2]
            subject%model%nu_jumps = [.true.]
            if (index(name, 'hidden') == 1) call hide(subject)
        case ('motorjump', 'hiddenmotorjump')
            subject%description = 'the motorcycle, whose steering rate jumps'//note_of(name)
            call build_motorcycle(subject, 1.0_wp, 8.0_wp, stat)
            if (index(name, 'hidden') == 1) call hide(subject)
        case ('milliondisk')
            subject%description = 'a million steps of the disk'
            call build_disk(subject, [-10.0_wp, 0.01_wp, 0.0_wp], 0.0_wp, 1.0_wp, 1.0e-3_wp*x, 1.0e-3_wp)
            call make_endless(subject)
        case ('millionvehicle')
            subject%description = 'a million steps of the vehicle'
            call build_vehicle(subject, 15.0_wp, 0.017_wp, 1.0_wp, 1.0e-3_wp*x, 1.0e-3_wp)
            call make_endless(subject)
        case default
            stat = 1
        end select
    end subroutine fill_case

    !> Remark about undeclared breakpoints for the description of a case; empty if all are declared.
    pure function note_of(name) result(text)
        character(len=*), intent(in) :: name
        character(len=merge(12, 0, index(name, 'hidden') == 1)) :: text

        text = ', undeclared'
    end function note_of

    !> Hide the breakpoints of a case from all runs except the reference.
    subroutine hide(subject)
        type(case_type), intent(inout) :: subject
        type(hidden_type) :: hidden

        call hidden%hide(subject%model)
        call move_alloc(subject%model, subject%true_model)
        allocate (subject%model, source=hidden)
    end subroutine hide

    !> Restrict a case to fixed steps, with a large time limit.
    subroutine make_endless(subject)
        type(case_type), intent(inout) :: subject

        subject%with_rtol = .false.
        subject%is_endless = .true.
        subject%most_seconds = 300.0_wp
    end subroutine make_endless

    !> Build the rolling disk with a given tilt and angular velocity.
    subroutine build_disk(subject, omega, tilt, unit, t_end, step)
        type(case_type), intent(inout) :: subject
        real(wp), intent(in) :: omega(3), tilt, t_end, step
        !> Number of length units per metre.
        real(wp), intent(in) :: unit
        type(rolling_disk_type) :: disk

        disk%radius = unit*disk%radius
        disk%gravity = unit*disk%gravity
        disk%inertia = unit**2*disk%inertia
        call disk%define()
        allocate (subject%q(9), subject%qd(9))
        call disk%start(omega, tilt, subject%q, subject%qd)
        call set_units(subject, disk, [unit, unit, unit, 1.0_wp, 1.0_wp, 1.0_wp, 1.0_wp, unit, unit])
        allocate (subject%model, source=disk)
        subject%t_end = t_end
        subject%options%step = step
    end subroutine build_disk

    !> Convert the scales of a model to other units.
    subroutine set_units(subject, model, units)
        type(case_type), intent(inout) :: subject
        class(model_type), intent(inout) :: model
        real(wp), intent(in) :: units(:)

        if (maxval(abs(units - 1.0_wp)) <= 0.0_wp) return
        subject%units = units
        model%coordinate_scale = units
    end subroutine set_units

    !> Build the nearly flat disk. It precesses about a nearly fixed centre, five per cent slower than in steady motion, so that it
    !> nods. In steady motion Omega**2 sin(alpha) = m g R / I, and the angular velocity is Omega sin(alpha) towards the contact.
    subroutine build_flat(subject, alpha)
        type(case_type), intent(inout) :: subject
        !> Angle between the disk and the plane.
        real(wp), intent(in) :: alpha
        real(wp), parameter :: slower = 0.95_wp
        type(rolling_disk_type) :: disk
        real(wp) :: precession, t_end

        precession = sqrt(disk%mass*disk%gravity*disk%radius/(disk%inertia(2)*sin(alpha)))
        t_end = 4*pi/precession
        subject%description = 'the disk whirls at '//to_toml(alpha)//' rad from flat'
        call build_disk(subject, [0.0_wp, 0.0_wp, slower*precession*sin(alpha)], pi/2 - alpha, 1.0_wp, t_end, t_end/500)
    end subroutine build_flat

    !> Build the articulated vehicle.
    subroutine build_vehicle(subject, speed, amplitude, unit, t_end, step)
        type(case_type), intent(inout) :: subject
        real(wp), intent(in) :: speed, amplitude, unit, t_end, step
        type(articulated_vehicle_type) :: vehicle

        vehicle%half_length = unit*vehicle%half_length
        vehicle%inertia = unit**2*vehicle%inertia
        vehicle%amplitude = amplitude
        call vehicle%define()
        allocate (subject%q(6), subject%qd(6))
        call vehicle%start(unit*speed, subject%q, subject%qd)
        call set_units(subject, vehicle, [unit, unit, 1.0_wp, unit, unit, 1.0_wp])
        allocate (subject%model, source=vehicle)
        subject%t_end = t_end
        subject%options%step = step
    end subroutine build_vehicle

    !> Build the motorcycle. Forces scale with the unit of length, so that stiffness and damping are unchanged.
    subroutine build_motorcycle(subject, unit, t_end, stat)
        type(case_type), intent(inout) :: subject
        real(wp), intent(in) :: unit, t_end
        integer, intent(out) :: stat
        type(motorcycle_type) :: motorcycle

        motorcycle%inertia = unit**2*motorcycle%inertia
        motorcycle%gravity = unit*motorcycle%gravity
        motorcycle%wheel_radius = unit*motorcycle%wheel_radius
        motorcycle%rear_length = unit*motorcycle%rear_length
        motorcycle%half_track = unit*motorcycle%half_track
        motorcycle%fork_forward = unit*motorcycle%fork_forward
        motorcycle%fork_height = unit*motorcycle%fork_height
        call motorcycle%define()
        allocate (subject%q(10), subject%qd(10))
        call motorcycle%start(unit*15.0_wp, subject%q, subject%qd, stat)
        call set_units(subject, motorcycle, [unit, unit, unit, 1.0_wp, 1.0_wp, 1.0_wp, 1.0_wp, unit, unit, unit])
        allocate (subject%model, source=motorcycle)
        subject%t_end = t_end
        subject%options%step = 1.0e-2_wp
    end subroutine build_motorcycle

    !> Build the motorcycle in the equilibrium of its suspension. Afterwards stiffness and damping are multiplied by a factor.
    subroutine build_stiff_motorcycle(subject, factor, stat)
        type(case_type), intent(inout) :: subject
        real(wp), intent(in) :: factor
        integer, intent(out) :: stat

        subject%description = 'the motorcycle, its suspension '//to_toml(factor)//' times as stiff and as damped'
        call build_motorcycle(subject, 1.0_wp, 1.0_wp, stat)
        select type (motorcycle => subject%model)
        type is (motorcycle_type)
            motorcycle%free_length = motorcycle%spring_length()
            motorcycle%stiffness = factor*motorcycle%stiffness
            motorcycle%damping = factor*motorcycle%damping
        end select
        if (factor > 1.0e3_wp) then
            ! Explicit steppers would need millions of steps, and rounding would limit their errors.
            subject%judges = [character(len=16) :: 'sdirk54', 'trapezoid']
            subject%judges_rtol = [1.0e-11_wp, 1.0e-9_wp]
        end if
    end subroutine build_stiff_motorcycle

    !> Build a pendulum (x, y, s) on a spring of length s, with k l = ratio m g. Without damping it starts level, and the spring
    !> follows the slow motion. With a tenth of the critical damping it starts at 45 degrees with an unstretched spring, which
    !> oscillates.
    subroutine build_spring(subject, ratio, is_damped)
        type(case_type), intent(inout) :: subject
        real(wp), intent(in) :: ratio
        logical, intent(in) :: is_damped
        real(wp), parameter :: g = 9.81_wp
        type(quadratic_type) :: pendulum
        real(wp) :: angle

        call pendulum%prepare('pendulum on a spring', 3, 1)
        pendulum%a(1, 1, 1) = 1.0_wp
        pendulum%a(2, 2, 1) = 1.0_wp
        pendulum%a(3, 3, 1) = -1.0_wp
        pendulum%masses(:2) = 1.0_wp
        pendulum%stiffness(3, 3) = ratio*g
        pendulum%force = [0.0_wp, -g, ratio*g]
        angle = 0.0_wp
        if (is_damped) then
            pendulum%damping(3, 3) = 0.2_wp*sqrt(ratio*g)
            angle = -pi/4
        end if
        subject%description = 'a pendulum on a spring, k l = '//to_toml(ratio)//' m g'
        if (is_damped) subject%description = subject%description//', damped'
        subject%q = [cos(angle), sin(angle), 1.0_wp]
        subject%qd = spread(0.0_wp, 1, 3)
        allocate (subject%model, source=pendulum)
        subject%t_end = 1.0_wp
        subject%options%step = 1.0e-2_wp
        if (ratio > 1.0e7_wp) then
            ! The frequency is thirty thousand radians per second.
            subject%t_end = 0.25_wp
            subject%judges_rtol = [1.0e-11_wp, 1.0e-10_wp]
        end if
    end subroutine build_spring

    !> Build a pendulum (x, y, stretch) on a spring whose frequency is `ratio` times that of the pendulum, with half the critical
    !> damping. It starts at rest at 1 rad with the spring in equilibrium, and moves as slowly as a rigid pendulum.
    subroutine build_slow(subject, ratio)
        type(case_type), intent(inout) :: subject
        real(wp), intent(in) :: ratio
        real(wp), parameter :: g = 9.81_wp, angle = 1.0_wp
        type(quadratic_type) :: pendulum
        real(wp) :: stretch

        subject%description = 'a slow pendulum on a damped spring '//to_toml(ratio)//' times as fast'
        call pendulum%prepare('slow pendulum on a spring', 3, 1)
        pendulum%a(1, 1, 1) = 1.0_wp
        pendulum%a(2, 2, 1) = 1.0_wp
        pendulum%a(3, 3, 1) = -1.0_wp
        pendulum%b(3, 1) = -1.0_wp
        pendulum%c = -0.5_wp
        pendulum%masses(:2) = 1.0_wp
        pendulum%force = [0.0_wp, -g, 0.0_wp]
        pendulum%stiffness(3, 3) = ratio**2*g
        pendulum%damping(3, 3) = ratio*sqrt(g)
        stretch = cos(angle)/ratio**2
        subject%q = [(1 + stretch)*sin(angle), -(1 + stretch)*cos(angle), stretch]
        subject%qd = spread(0.0_wp, 1, 3)
        allocate (subject%model, source=pendulum)
        subject%t_end = 2.0_wp
        subject%options%step = 1.0e-2_wp
        if (ratio > 2.0e2_wp) then
            ! Explicit steppers would need hundreds of thousands of steps.
            subject%judges = [character(len=16) :: 'radau5', 'sdirk54']
            subject%judges_rtol = [1.0e-10_wp, 1.0e-8_wp]
        end if
    end subroutine build_slow

    !> Build the vehicle with a bushing that has half the critical damping.
    subroutine build_bushing(subject, stiffness)
        type(case_type), intent(inout) :: subject
        real(wp), intent(in) :: stiffness
        type(bushing_type) :: bushing

        subject%description = 'the vehicle with a bushing of '//to_toml(stiffness)//' N/m as its joint'
        bushing%vehicle%amplitude = 0.1_wp
        call bushing%vehicle%define()
        bushing%stiffness = stiffness
        bushing%damping = sqrt(stiffness*bushing%vehicle%mass/2)
        call bushing%define()
        allocate (subject%q(6), subject%qd(6))
        call bushing%vehicle%start(15.0_wp, subject%q, subject%qd)
        allocate (subject%model, source=bushing)
        subject%t_end = 3.0_wp
        subject%options%step = 1.0e-2_wp
    end subroutine build_bushing

    !> Build two point masses on two rods, starting at rest at 45 degrees.
    subroutine build_masses(subject, ratio)
        type(case_type), intent(inout) :: subject
        !> Ratio of the lower mass to the upper one.
        real(wp), intent(in) :: ratio
        real(wp), parameter :: g = 9.81_wp
        type(quadratic_type) :: pendulum
        integer :: i

        subject%description = 'a double pendulum, the lower mass '//to_toml(ratio)//' times the upper one'
        call pendulum%prepare('double pendulum', 4, 2)
        do i = 1, 2
            pendulum%a(i, i, 1) = 1.0_wp
            pendulum%a(i, i, 2) = 1.0_wp
            pendulum%a(i + 2, i + 2, 2) = 1.0_wp
            pendulum%a(i, i + 2, 2) = -1.0_wp
            pendulum%a(i + 2, i, 2) = -1.0_wp
        end do
        pendulum%c = -0.5_wp
        pendulum%masses = [1.0_wp, 1.0_wp, ratio, ratio]
        pendulum%force = [0.0_wp, -g, 0.0_wp, -ratio*g]
        subject%q = sqrt(0.5_wp)*[1, -1, 2, -2]
        subject%qd = spread(0.0_wp, 1, 4)
        allocate (subject%model, source=pendulum)
        subject%t_end = 1.0_wp
        subject%options%step = 1.0e-3_wp
        if (ratio > 1.0e7_wp) subject%t_end = 0.5_wp
    end subroutine build_masses

    !> Build a mass on a spring, with a damped light mass attached to it by a second spring.
    subroutine build_light(subject, mass)
        type(case_type), intent(inout) :: subject
        real(wp), intent(in) :: mass
        type(quadratic_type) :: chain

        subject%description = 'a mass, and one of '//to_toml(mass)//' kg on a spring that nothing else holds'
        call chain%prepare('light mass', 2, 0)
        chain%masses = [1.0_wp, mass]
        chain%stiffness = reshape([2.0_wp, -1.0_wp, -1.0_wp, 1.0_wp], [2, 2])
        chain%damping(2, 2) = sqrt(mass)
        subject%q = [1.0_wp, 1.0_wp]
        subject%qd = spread(0.0_wp, 1, 2)
        allocate (subject%model, source=chain)
        subject%t_end = 1.0_wp
        subject%options%step = 1.0e-2_wp
        ! The light mass amplifies rounding of a force of 1 N to an acceleration of 1e-4 m/s^2.
        subject%judges = [character(len=16) :: 'sdirk54', 'dopri5']
        subject%judges_rtol = [1.0e-9_wp, 1.0e-8_wp]
        ! Without mass the motion is not unique, and the run must be refused.
        subject%is_at_rest = .not. mass > 0.0_wp
    end subroutine build_light

    !> Build a point on a unit sphere and on a second unit sphere displaced by eps along z. It swings in the plane z = 0, as for a
    !> sphere and a plane, which is the case eps = 1.
    subroutine build_parallel(subject, eps)
        type(case_type), intent(inout) :: subject
        real(wp), intent(in) :: eps
        real(wp), parameter :: g = 9.81_wp
        type(quadratic_type) :: point
        integer :: i

        subject%description = 'a point on two spheres that meet at an angle of '//to_toml(eps)
        call point%prepare('point on two spheres', 3, 2)
        do i = 1, 3
            point%a(i, i, :) = 1.0_wp
        end do
        point%b(3, 2) = 1.0_wp
        point%c = -0.5_wp
        point%masses = 1.0_wp
        point%force(2) = -g
        subject%q = [1.0_wp, 0.0_wp, 0.0_wp]
        subject%qd = spread(0.0_wp, 1, 3)
        allocate (subject%true_model, source=point)
        point%b(3, 2) = eps
        allocate (subject%model, source=point)
        subject%t_end = 2.0_wp
        subject%options%step = 1.0e-2_wp
    end subroutine build_parallel
end module tandem_io_study_cases
