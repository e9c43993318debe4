! SPDX-License-Identifier: MIT
!> output SCENE [SETTING...]: additional time for the result file, medians of alternating runs with and without it.
program output
    use, intrinsic :: iso_fortran_env, only: error_unit, output_unit
    use tandem, only: error_type, simulation_type, statistics_type, wp
    use tandem_bench_clock, only: cpu_seconds, wall_seconds
    use tandem_io, only: find_scene, read_scene, scene_type, trajectory_type
    use tandem_io_study_measure, only: median
    implicit none (type, external)
    integer, parameter :: rounds = 5
    type(scene_type), target :: scene
    type(error_type), allocatable :: error
    character(len=256), allocatable :: settings(:)
    character(len=256) :: name
    character(len=:), allocatable :: path
    !> Processor time and wall time (2), without and with the file.
    real(wp) :: bare(2, rounds), written(2, rounds)
    type(statistics_type) :: statistics
    integer :: i

    if (command_argument_count() == 0) error stop 2
    call get_command_argument(1, name)
    allocate (settings(command_argument_count() - 1))
    do i = 1, size(settings)
        call get_command_argument(1 + i, settings(i))
    end do
    call find_scene(trim(name), path, error)
    if (.not. allocated(error)) call read_scene(path, settings, scene, error)
    do i = 1, rounds
        if (.not. allocated(error)) call time(.false., bare(:, i))
        if (.not. allocated(error)) call time(.true., written(:, i))
    end do
    if (allocated(error)) then
        write (error_unit, '(2a)') 'output: ', error%message
        error stop 1
    end if
    write (output_unit, '(a, i0, 4(a, f0.3), a)') trim(name)//': ', statistics%steps, ' steps, ', median(bare(1, :)), &
        ' s; with the file the processor takes + ', 100*(median(written(1, :)/bare(1, :)) - 1.0_wp), ' %, the clock + ', &
        100*(median(written(2, :)/bare(2, :)) - 1.0_wp), ' %, ', 1.0e3_wp*median(written(2, :) - bare(2, :)), ' ms'

contains

    !> One run.
    subroutine time(writes, seconds)
        logical, intent(in) :: writes
        !> Processor time and wall time.
        real(wp), intent(out) :: seconds(2)
        type(simulation_type) :: simulation
        type(trajectory_type), target :: trajectory
        type(error_type), allocatable :: run_error

        call simulation%initialize(scene%model, scene%options, scene%t_start, scene%q, scene%qd, error)
        if (allocated(error)) return
        seconds = [cpu_seconds(), wall_seconds()]
        if (writes) then
            call trajectory%open(scene%output, simulation, error, scene%text, 'output', .true.)
            if (allocated(error)) return
            call simulation%integrate(scene%t_end, run_error, trajectory)
            call trajectory%close(simulation, run_error, error)
        else
            call simulation%integrate(scene%t_end, run_error)
        end if
        seconds = [cpu_seconds(), wall_seconds()] - seconds
        statistics = simulation%statistics()
        if (allocated(run_error)) call move_alloc(run_error, error)
    end subroutine time
end program output
