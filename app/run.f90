! SPDX-License-Identifier: MIT
!> tandem run: runs a scene, writes the result file, prints a report.
module tandem_app_run
    use tandem, only: at_end, error_type, short_run, simulation_type, statistics_type, status_output_failed
    use tandem_app_arguments, only: arguments_type
    use tandem_app_help, only: help
    use tandem_app_interruption, only: caught_signal, interruptible_error_type, interruption_type, watch_signals
    use tandem_app_messages, only: complain, done, input_wrong, run_failed, signalled
    use tandem_app_progress, only: progress_type
    use tandem_app_report, only: print_report
    use tandem_app_rescue, only: save_last_state
    use tandem_io, only: find_scene, observer_list_type, read_scene, scene_type, trajectory_type
    use tandem_status, only: status_interrupted
    implicit none (type, external)
    private

    public :: run, carry_out, set_up

contains

    !> Run a scene.
    subroutine run(arguments, code)
        type(arguments_type), intent(inout) :: arguments
        !> Exit code.
        integer, intent(out) :: code
        type(scene_type), target :: scene
        type(simulation_type) :: simulation
        type(trajectory_type), target :: trajectory
        type(interruptible_error_type), target :: global_error
        type(error_type), allocatable :: error

        call watch_signals()
        call arguments%parse([character(len=10) :: '--set', '--output', '--error', '--no-error', '--quiet', &
            '--force', '--help'], .true., error)
        if (.not. allocated(error) .and. arguments%help) then
            call help(code)
            return
        end if
        if (.not. allocated(error)) call prepare(arguments, scene, simulation, trajectory, global_error, error)
        if (allocated(error)) then
            call complain(error%message)
            code = input_wrong
            return
        end if

        call carry_out(arguments, scene, simulation, trajectory, global_error, code)
    end subroutine run

    !> The run itself, or the rest of one, and what comes after it.
    subroutine carry_out(arguments, scene, simulation, trajectory, global_error, code)
        type(arguments_type), intent(in) :: arguments
        type(scene_type), intent(in) :: scene
        type(simulation_type), intent(inout) :: simulation
        type(trajectory_type), intent(inout), target :: trajectory
        !> Watches what it costs nothing to watch.
        type(interruptible_error_type), intent(inout), target :: global_error
        !> Exit code.
        integer, intent(out) :: code
        type(error_type), allocatable :: error, output_error, estimate_error

        call integrate(arguments, scene, simulation, trajectory, global_error, error)
        ! The file is complete before the second run begins, which may be ended or killed.
        call trajectory%close(simulation, error, output_error)
        if (allocated(output_error) .and. .not. allocated(error)) call move_alloc(output_error, error)
        if (.not. allocated(error) .and. wants_estimate(arguments, simulation)) then
            call estimate(scene, global_error, estimate_error)
            call trajectory%add_error(global_error, error)
        end if
        call print_report(scene, simulation, trajectory, error, global_error, estimate_error)
        code = done
        if (is_interruption(estimate_error)) code = signalled + caught_signal()
        if (.not. allocated(error)) return
        call complain(error%message)
        code = run_failed
        if (is_interruption(error)) code = signalled + caught_signal()
        if (error%stat == status_output_failed) call save_last_state(scene, simulation)
    end subroutine carry_out

    !> Whether a signal has ended a run.
    pure logical function is_interruption(error)
        type(error_type), allocatable, intent(in) :: error

        is_interruption = .false.
        if (allocated(error)) is_interruption = error%stat == status_interrupted
    end function is_interruption

    !> Everything up to the first step. The result file is made last, so that an error of the input leaves nothing behind.
    subroutine prepare(arguments, scene, simulation, trajectory, global_error, error)
        type(arguments_type), intent(in) :: arguments
        type(scene_type), intent(inout), target :: scene
        type(simulation_type), intent(inout) :: simulation
        type(trajectory_type), intent(inout) :: trajectory
        type(interruptible_error_type), intent(inout), target :: global_error
        type(error_type), allocatable, intent(out) :: error
        character(len=:), allocatable :: path

        call find_scene(arguments%scene, path, error)
        if (allocated(error)) return
        call read_scene(path, arguments%settings, scene, error)
        if (allocated(error)) return
        call set_up(scene, simulation, global_error, error)
        if (allocated(error)) return
        if (scene%output%file == path) then
            allocate (error)
            error%message = 'the result file '//path//' is the scene itself; choose another'
            return
        end if
        call trajectory%open(scene%output, simulation, error, scene%text, command_line(), arguments%force, global_error)
    end subroutine prepare

    !> A simulation at the start of its scene, and what watches it.
    subroutine set_up(scene, simulation, global_error, error)
        type(scene_type), intent(inout), target :: scene
        type(simulation_type), intent(inout) :: simulation
        type(interruptible_error_type), intent(inout) :: global_error
        type(error_type), allocatable, intent(out) :: error
        integer :: i

        call simulation%initialize(scene%model, scene%options, scene%t_start, scene%q, scene%qd, error, scene%assembly)
        if (allocated(error)) return
        if (allocated(scene%assembly)) then
            ! What was assembled is where a second run starts.
            scene%q = simulation%state%q
            scene%qd = simulation%state%qd
        end if
        do i = 1, size(scene%events)
            call simulation%add_event(scene%events(i))
        end do
        call global_error%initialize(scene%model%n, scene%t_start, scene%t_end)
    end subroutine set_up

    !> The run, watched by the result file and by the progress.
    subroutine integrate(arguments, scene, simulation, trajectory, global_error, error)
        type(arguments_type), intent(in) :: arguments
        type(scene_type), intent(in) :: scene
        type(simulation_type), intent(inout) :: simulation
        type(trajectory_type), intent(inout), target :: trajectory
        !> Watches what it costs nothing to watch.
        type(interruptible_error_type), intent(inout), target :: global_error
        type(error_type), allocatable, intent(out) :: error
        type(progress_type), target :: progress
        type(interruption_type), target :: interruption
        type(observer_list_type) :: observers

        call observers%add(global_error)
        call observers%add(interruption)
        progress = progress_type(t_start=simulation%state%t, t_end=scene%t_end)
        if (.not. arguments%quiet) call observers%add(progress)
        ! Last, because it saves what the others have seen.
        call observers%add(trajectory)
        if (simulation%is_stopped .or. simulation%state%t >= scene%t_end) then
            ! The run was killed between its end and its report.
            call observers%observe(simulation, at_end, error)
        else
            call simulation%integrate(scene%t_end, error, observers)
        end if
    end subroutine integrate

    !> Whether to make a second run: on request, and for a short run without it.
    logical function wants_estimate(arguments, simulation)
        type(arguments_type), intent(in) :: arguments
        type(simulation_type), intent(in) :: simulation
        type(statistics_type) :: statistics

        statistics = simulation%statistics()
        wants_estimate = arguments%error .or. (statistics%wall_seconds <= short_run .and. .not. arguments%no_error)
    end function wants_estimate

    !> The second run, with a model of its own, since a run may change its model.
    subroutine estimate(scene, global_error, error)
        type(scene_type), intent(in) :: scene
        type(interruptible_error_type), intent(inout) :: global_error
        type(error_type), allocatable, intent(out) :: error
        type(scene_type), target :: again
        character(len=1) :: no_settings(0)

        call read_scene('the scene', no_settings, again, error, scene%text)
        if (.not. allocated(error)) call global_error%estimate(again%model, scene%options, scene%q, scene%qd, error)
    end subroutine estimate

    !> The command line as it was typed, about.
    function command_line() result(text)
        character(len=:), allocatable :: text
        integer :: length

        call get_command(length=length)
        allocate (character(len=length) :: text)
        if (length > 0) call get_command(text)
    end function command_line
end module tandem_app_run
