! SPDX-License-Identifier: MIT
!> Runs for several tests.
module runs
    use model_heavy_top, only: heavy_top_type
    use model_knife_edge, only: knife_edge_type
    use model_stiff_pendulum, only: stiff_pendulum_type
    use reference, only: read_reference, reference_type
    use tandem, only: articulated_vehicle_type, failure_type => error_type, model_type, motorcycle_type, observer_type, &
        options_type, rolling_disk_type, simulation_type, wp
    implicit none (type, external)
    private

    public :: run, run_to, choose, new_scene, get_start, scene_names

    !> Scenes with a reference solution, and names of their tables.
    character(len=14), parameter :: scene_names(5) = [character(len=14) :: 'vehicle', 'disk', 'heavy_top', 'knife_edge', &
        'stiff_pendulum']

contains

    !> Initialize a simulation and integrate it to t_end.
    subroutine run(simulation, model, options, t, q, qd, t_end, failure, observer)
        type(simulation_type), intent(inout) :: simulation
        class(model_type), intent(inout), target :: model
        type(options_type), intent(in) :: options
        real(wp), intent(in) :: t, q(:), qd(:), t_end
        type(failure_type), allocatable, intent(out) :: failure
        class(observer_type), intent(inout), optional :: observer

        call simulation%initialize(model, options, t, q, qd, failure)
        if (.not. allocated(failure)) call simulation%integrate(t_end, failure, observer)
    end subroutine run

    !> The state (q, qd) that a scene reaches at t_end from its start at t = 0, one column each.
    subroutine run_to(scene, options, t_end, state, failure)
        character(len=*), intent(in) :: scene
        type(options_type), intent(in) :: options
        real(wp), intent(in) :: t_end
        real(wp), allocatable, intent(out) :: state(:, :)
        type(failure_type), allocatable, intent(out) :: failure
        class(model_type), allocatable, target :: model
        type(simulation_type) :: simulation
        real(wp), allocatable :: q(:), qd(:)

        call new_scene(scene, model)
        call get_start(scene, q, qd)
        call run(simulation, model, options, 0.0_wp, q, qd, t_end, failure)
        state = reshape([simulation%state%q, simulation%state%qd], [model%n, 2])
    end subroutine run_to

    !> Options for fixed steps, of 1 ms if not given, with some others chosen; v_limit only with the chart that has it.
    function choose(step, chart, refresh, v_limit, tolerance, stepper) result(options)
        real(wp), intent(in), optional :: step, v_limit, tolerance
        character(len=*), intent(in), optional :: chart, refresh, stepper
        type(options_type) :: options

        if (present(stepper)) options%stepper = stepper
        options%step = 1.0e-3_wp
        if (present(step)) options%step = step
        if (present(chart)) options%chart = chart
        if (present(refresh)) options%refresh = refresh
        if (present(v_limit) .and. options%chart == 'paper') options%v_limit = v_limit
        if (present(tolerance)) options%constraint_tolerance = tolerance
    end function choose

    !> A scene of `scene_names`, with the parameters of its reference solution, or the paper's motorcycle or chopper.
    subroutine new_scene(name, model)
        character(len=*), intent(in) :: name
        class(model_type), allocatable, intent(out) :: model
        type(articulated_vehicle_type), allocatable :: vehicle
        type(rolling_disk_type), allocatable :: disk
        type(heavy_top_type), allocatable :: heavy_top
        type(knife_edge_type), allocatable :: knife_edge
        type(stiff_pendulum_type), allocatable :: stiff_pendulum
        type(motorcycle_type), allocatable :: motorcycle

        select case (name)
        case ('vehicle')
            allocate (vehicle)
            call vehicle%define()
            call move_alloc(vehicle, model)
        case ('disk')
            allocate (disk)
            call disk%define()
            call move_alloc(disk, model)
        case ('heavy_top')
            allocate (heavy_top)
            call heavy_top%define()
            call move_alloc(heavy_top, model)
        case ('knife_edge')
            allocate (knife_edge)
            call knife_edge%define()
            call move_alloc(knife_edge, model)
        case ('stiff_pendulum')
            allocate (stiff_pendulum)
            call stiff_pendulum%define()
            call move_alloc(stiff_pendulum, model)
        case ('motorcycle', 'chopper')
            allocate (motorcycle)
            if (name == 'chopper') then
                motorcycle%fork_angle = atan(1.0_wp)
                motorcycle%amplitude = 0.0078_wp
            end if
            call motorcycle%define()
            call move_alloc(motorcycle, model)
        case default
            error stop 'new_scene: unknown scene'
        end select
    end subroutine new_scene

    !> The start of a scene at t = 0: of its reference solution, or the motorcycle's equilibrium at 15 m/s.
    subroutine get_start(name, q, qd)
        character(len=*), intent(in) :: name
        real(wp), allocatable, intent(out) :: q(:), qd(:)
        class(model_type), allocatable :: model
        type(reference_type) :: table
        integer :: stat

        if (name == 'motorcycle' .or. name == 'chopper') then
            allocate (q(10), qd(10), source=0.0_wp)
            call new_scene(name, model)
            select type (model)
            class is (motorcycle_type)
                call model%start(15.0_wp, q, qd, stat)
                if (stat /= 0) error stop 'get_start: no equilibrium'
            end select
            return
        end if
        call read_reference(name, table)
        allocate (q, source=table%q(:, 1))
        allocate (qd, source=table%qd(:, 1))
    end subroutine get_start
end module runs
