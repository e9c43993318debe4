! SPDX-License-Identifier: MIT
!> motion SCENE [SETTING...]: cost of a run of a scene without a result file, and its end. Prints the processor time of its start
!> and of its steps in s, the smallest of the repeats, the number of steps, and dense or sparse; then a line `name q qd` for each
!> coordinate.
program motion
    use, intrinsic :: iso_fortran_env, only: error_unit, output_unit
    use tandem, only: error_type, simulation_type, statistics_type, wp
    use tandem_bench_clock, only: cpu_seconds
    use tandem_io, only: find_scene, read_scene, scene_type
    implicit none (type, external)
    !> Repeat until there are three runs and this time has passed (s).
    real(wp), parameter :: enough = 0.02_wp
    type(scene_type), target :: scene
    type(error_type), allocatable :: error
    type(statistics_type) :: statistics
    character(len=256), allocatable :: settings(:)
    character(len=256) :: name
    character(len=:), allocatable :: path
    real(wp), allocatable :: q(:), qd(:)
    real(wp) :: least, spent, seconds
    logical :: is_sparse
    integer :: i, repeats

    if (command_argument_count() == 0) error stop 2
    call get_command_argument(1, name)
    allocate (settings(command_argument_count() - 1))
    do i = 1, size(settings)
        call get_command_argument(1 + i, settings(i))
    end do
    call find_scene(trim(name), path, error)
    if (.not. allocated(error)) call read_scene(path, settings, scene, error)
    if (.not. allocated(error)) call assemble()
    least = huge(least)
    spent = 0.0_wp
    repeats = 0
    do while (.not. allocated(error) .and. (repeats < 3 .or. spent < enough))
        call time(seconds)
        least = min(least, seconds)
        spent = spent + seconds
        repeats = repeats + 1
        if (spent > 3.0_wp) exit
    end do
    if (allocated(error)) then
        write (error_unit, '(2a)') 'motion: ', error%message
        stop 1, quiet=.true.
    end if
    write (output_unit, '(es12.5, 1x, i0, 1x, a)') least, statistics%steps, trim(merge('sparse', 'dense ', is_sparse))
    do i = 1, size(q)
        write (output_unit, '(a, 2(1x, es25.17e3))') scene%model%coordinate_label(i), q(i), qd(i)
    end do

contains

    !> Move the start onto its constraints, if the scene requests it; runs begin there.
    subroutine assemble()
        type(simulation_type) :: simulation

        if (.not. allocated(scene%assembly)) return
        call simulation%initialize(scene%model, scene%options, scene%t_start, scene%q, scene%qd, error, scene%assembly)
        if (allocated(error)) return
        scene%q = simulation%state%q
        scene%qd = simulation%state%qd
    end subroutine assemble

    !> One run from the start.
    subroutine time(taken)
        real(wp), intent(out) :: taken
        type(simulation_type) :: simulation

        taken = cpu_seconds()
        call simulation%initialize(scene%model, scene%options, scene%t_start, scene%q, scene%qd, error)
        if (.not. allocated(error)) call simulation%integrate(scene%t_end, error)
        taken = cpu_seconds() - taken
        if (allocated(error)) return
        statistics = simulation%statistics()
        is_sparse = simulation%is_sparse
        q = simulation%state%q
        qd = simulation%state%qd
    end subroutine time
end program motion
