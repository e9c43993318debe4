! SPDX-License-Identifier: MIT
!> Short runs of every stepper on every scene, for a tool that counts instructions and allocations. Prints one line per run: scene,
!> stepper, control, steps. `tools/bench_count.py` calls it.
program count
    use, intrinsic :: iso_fortran_env, only: error_unit, output_unit
    use tandem, only: error_type, new_stepper, options_type, properties_type, simulation_type, statistics_type, stepper_names, wp
    use tandem_io, only: find_scene, read_scene, scene_type
    use tandem_stepper, only: stepper_type
    implicit none (type, external)
    character(len=24), parameter :: names(5) = [character(len=24) :: 'rolling_disk', 'articulated_vehicle', 'motorcycle', &
        'motorcycle_chopper', 'motorcycle_stiff']
    real(wp), parameter :: step = 2.0e-3_wp, tolerance = 1.0e-8_wp
    integer :: i, j

    do i = 1, size(names)
        do j = 1, size(stepper_names)
            call run(trim(names(i)), trim(stepper_names(j)), .true.)
            call run(trim(names(i)), trim(stepper_names(j)), .false.)
        end do
    end do

contains

    !> Run with fixed steps or under error control, if the stepper supports that.
    subroutine run(name, stepper, is_fixed)
        character(len=*), intent(in) :: name, stepper
        logical, intent(in) :: is_fixed
        class(stepper_type), allocatable :: method
        type(properties_type) :: properties
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(options_type) :: options
        type(scene_type) :: scene
        type(error_type), allocatable :: error
        character(len=32), allocatable :: settings(:)
        character(len=:), allocatable :: path
        logical :: is_stiff

        call new_stepper(stepper, method)
        properties = method%properties()
        is_stiff = name == 'motorcycle_stiff'
        if (is_stiff .and. .not. properties%implicit) return
        if (.not. is_fixed .and. properties%estimate_order == 0) return
        allocate (settings(0))
        if (is_stiff) settings = [character(len=32) :: 'model.stiffness=1.5e7', 'model.damping=1.5e6']
        call find_scene(name(:merge(len('motorcycle'), len(name), is_stiff)), path, error)
        if (.not. allocated(error)) call read_scene(path, settings, scene, error)
        options%stepper = stepper
        if (is_fixed) options%step = step
        if (.not. is_fixed) options%rtol = tolerance
        if (.not. allocated(error)) call simulation%initialize(scene%model, options, scene%t_start, scene%q, scene%qd, error)
        if (.not. allocated(error)) call simulation%integrate(merge(0.4_wp, 10.0_wp, is_fixed), error)
        if (allocated(error)) then
            write (error_unit, '(2a)') 'count: ', error%message
            error stop 1
        end if
        statistics = simulation%statistics()
        write (output_unit, '(a, 1x, a, 1x, a, 1x, i0)') name, stepper, trim(merge('h=2e-3   ', 'rtol=1e-8', is_fixed)), &
            statistics%steps
    end subroutine run
end program count
