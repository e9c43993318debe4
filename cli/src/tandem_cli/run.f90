! SPDX-License-Identifier: MIT
!> tandem run: runs a scene, writes the result file, and prints a report.
module tandem_cli_run
    use tandem, only: at_end, error_type, mark_type, part_open, part_start, profile_type, short_run, &
        simulation_type, statistics_type, status_output_failed, wp
    use tandem_cli_arguments, only: arguments_type
    use tandem_cli_interruption, only: caught_signal, interruptible_error_type, interruption_type, watch_signals
    use tandem_cli_messages, only: print_to_stderr, done, message_for_scene, input_wrong, run_failed, signalled
    use tandem_cli_profile_table, only: print_profile
    use tandem_cli_profiling, only: profiling_type
    use tandem_cli_progress, only: progress_type
    use tandem_cli_report, only: print_warnings_on_stderr, print_report
    use tandem_cli_report_json, only: print_report_json
    use tandem_cli_rescue, only: save_last_state
    use tandem_io, only: find_scene, is_same_file, observer_list_type, read_scene, repeat_scene, scene_type, trajectory_type
    use tandem_status, only: status_interrupted
    implicit none (type, external)
    private

    public :: run, execute_run, initialize_run

contains

    !> Run a scene.
    subroutine run(arguments, code)
        type(arguments_type), intent(in) :: arguments
        !> Exit code.
        integer, intent(out) :: code
        type(scene_type), target :: scene
        type(simulation_type) :: simulation
        type(trajectory_type), target :: trajectory
        type(interruptible_error_type), target :: global_error
        type(profiling_type), allocatable, target :: profiling
        type(error_type), allocatable :: error

        if (arguments%profile) allocate (profiling)
        call prepare(arguments, scene, simulation, trajectory, global_error, error, profiling)
        if (allocated(error)) then
            call print_to_stderr(message_for_scene(error))
            code = input_wrong
            return
        end if

        call execute_run(arguments, scene, simulation, trajectory, global_error, code, profiling)
    end subroutine run

    !> Carry out a new or resumed run, and write its output.
    subroutine execute_run(arguments, scene, simulation, trajectory, global_error, code, profiling)
        type(arguments_type), intent(in) :: arguments
        type(scene_type), intent(in) :: scene
        type(simulation_type), intent(inout) :: simulation
        type(trajectory_type), intent(inout), target :: trajectory
        !> Error estimator, which observes the run at negligible cost.
        type(interruptible_error_type), intent(inout), target :: global_error
        !> Exit code.
        integer, intent(out) :: code
        !> Time measurement, if requested.
        type(profiling_type), intent(inout), optional, target :: profiling
        type(error_type), allocatable :: error, output_error, estimate_error, profile_error
        type(mark_type) :: mark
        logical :: was_interrupted

        call integrate(arguments, scene, simulation, trajectory, global_error, error, profiling)
        was_interrupted = is_interruption(error)
        ! The file is completed before the second run begins, because a signal may end the program during the second run.
        if (present(profiling)) call profiling%profile%enter(part_open, mark)
        call trajectory%close(simulation, error, output_error, more_follows=.true.)
        if (present(profiling)) call profiling%profile%leave(mark)
        ! A file that could not be written cannot be resumed, even if a signal has ended the run. Report the former error.
        if (allocated(output_error) .and. (was_interrupted .or. .not. allocated(error))) call move_alloc(output_error, error)
        if (present(profiling)) then
            call profiling%profile%finish()
            if (.not. allocated(error)) call compare(scene, simulation, profiling%profile, profile_error)
            if (.not. allocated(output_error)) call trajectory%add_profile(profiling%profile, output_error)
            if (allocated(output_error) .and. .not. allocated(error)) call move_alloc(output_error, error)
        end if
        if (.not. allocated(error) .and. wants_estimate(arguments, simulation)) then
            call estimate(scene, global_error, estimate_error)
            call trajectory%add_error(simulation, global_error, error)
        end if
        call trajectory%release()
        if (arguments%json) then
            call print_report_json(scene, simulation, trajectory, error, global_error, estimate_error)
        else if (arguments%quiet) then
            call print_warnings_on_stderr(simulation, global_error, estimate_error)
        else
            call print_report(scene, simulation, trajectory, error, global_error, estimate_error)
            if (present(profiling)) call print_profile(profiling%profile)
        end if
        code = done
        if (is_interruption(profile_error)) code = signalled + caught_signal()
        if (is_interruption(estimate_error)) code = signalled + caught_signal()
        if (.not. allocated(error)) return
        call print_to_stderr(error%message)
        code = run_failed
        if (was_interrupted) code = signalled + caught_signal()
        if (allocated(output_error) .and. error%stat /= status_output_failed) call print_to_stderr(output_error%message)
        if (allocated(output_error) .or. error%stat == status_output_failed) call save_last_state(scene, simulation)
    end subroutine execute_run

    !> True if a signal has ended a run.
    pure logical function is_interruption(error)
        type(error_type), allocatable, intent(in) :: error

        is_interruption = .false.
        if (allocated(error)) is_interruption = error%stat == status_interrupted
    end function is_interruption

    !> Prepare the run up to its first step. The result file is created last, so that no file is left after an input error.
    subroutine prepare(arguments, scene, simulation, trajectory, global_error, error, profiling)
        type(arguments_type), intent(in) :: arguments
        type(scene_type), intent(inout), target :: scene
        type(simulation_type), intent(inout) :: simulation
        type(trajectory_type), intent(inout) :: trajectory
        type(interruptible_error_type), intent(inout), target :: global_error
        type(error_type), allocatable, intent(out) :: error
        type(profiling_type), intent(inout), optional, target :: profiling
        character(len=:), allocatable :: path
        type(mark_type) :: mark

        call find_scene(arguments%scene, path, error)
        if (allocated(error)) return
        call read_scene(path, arguments%settings, scene, error, models=arguments%models)
        if (allocated(error)) return
        ! Signals are caught only from here on, so that they end the program while it reads a scene from a pipe.
        call watch_signals()
        call initialize_run(scene, simulation, global_error, error, profiling)
        if (allocated(error)) return
        if (is_same_file(scene%output%file, path)) then
            allocate (error)
            error%message = 'the result file '//scene%output%file//' is the scene itself; choose another'
            return
        end if
        if (present(profiling)) then
            trajectory%profile => profiling%profile
            call profiling%profile%enter(part_open, mark)
        end if
        call trajectory%open(scene%output, simulation, error, scene%text, command_line(), arguments%force, global_error)
        if (present(profiling)) call profiling%profile%leave(mark)
    end subroutine prepare

    !> Initialize a simulation at the start of its scene, with events and error estimator.
    subroutine initialize_run(scene, simulation, global_error, error, profiling)
        type(scene_type), intent(inout), target :: scene
        type(simulation_type), intent(inout) :: simulation
        type(interruptible_error_type), intent(inout) :: global_error
        type(error_type), allocatable, intent(out) :: error
        !> Time measurement, which begins here.
        type(profiling_type), intent(inout), optional, target :: profiling
        type(mark_type) :: mark
        integer :: i

        if (present(profiling)) then
            call profiling%begin(scene%model)
            call profiling%profile%enter(part_start, mark)
        end if
        call simulation%initialize(scene%model, scene%options, scene%t_start, scene%q, scene%qd, error, scene%assembly)
        if (present(profiling)) call profiling%profile%leave(mark)
        if (allocated(error)) return
        if (allocated(scene%assembly)) then
            ! The second run starts from the assembled state.
            scene%q = simulation%state%q
            scene%qd = simulation%state%qd
        end if
        do i = 1, size(scene%events)
            call simulation%add_event(scene%events(i))
        end do
        call global_error%initialize(scene%model%n, scene%t_start, scene%t_end)
    end subroutine initialize_run

    !> Integrate with observers for the result file and the progress.
    subroutine integrate(arguments, scene, simulation, trajectory, global_error, error, profiling)
        type(arguments_type), intent(in) :: arguments
        type(scene_type), intent(in) :: scene
        type(simulation_type), intent(inout) :: simulation
        type(trajectory_type), intent(inout), target :: trajectory
        !> Error estimator, which observes the run at negligible cost.
        type(interruptible_error_type), intent(inout), target :: global_error
        type(error_type), allocatable, intent(out) :: error
        type(profiling_type), intent(inout), optional, target :: profiling
        type(progress_type), target :: progress
        type(interruption_type), target :: interruption
        type(observer_list_type), target :: watchers
        type(observer_list_type) :: observers

        call watchers%add(global_error)
        call watchers%add(interruption)
        progress = progress_type(t_start=simulation%state%t, t_end=scene%t_end)
        if (.not. arguments%quiet) call watchers%add(progress)
        ! The file observes last, because it stores data of the other observers.
        if (present(profiling)) then
            call profiling%observe(watchers, trajectory, observers)
        else
            observers = watchers
            call observers%add(trajectory)
        end if
        if (simulation%is_stopped .or. simulation%state%t >= scene%t_end) then
            ! A resumed run that was killed between its end and its report takes no step.
            call observers%observe(simulation, at_end, error)
        else
            call simulation%integrate(scene%t_end, error, observers)
        end if
    end subroutine integrate

    !> Measure the cost of the clocks. The beginning of the run, at most a tenth of a second, is repeated alternately with and
    !> without clocks. The smallest processor times are compared, which are least affected by other programs.
    subroutine compare(scene, simulation, profile, error)
        type(scene_type), intent(in) :: scene
        !> The completed run.
        type(simulation_type), intent(in) :: simulation
        type(profile_type), intent(inout) :: profile
        !> Set after a signal.
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: longest = 0.1_wp, long_enough = 1.0_wp
        integer, parameter :: least_rounds = 4, most_rounds = 20
        type(profiling_type), target :: profiling
        type(statistics_type) :: statistics
        real(wp) :: t_end, clocked, plain, seconds, total
        integer :: i

        statistics = simulation%statistics()
        t_end = scene%t_start + (simulation%state%t - scene%t_start)*min(1.0_wp, longest/max(statistics%wall_seconds, longest))
        if (.not. t_end > scene%t_start) return
        clocked = huge(1.0_wp)
        plain = huge(1.0_wp)
        total = 0.0_wp
        do i = 1, most_rounds
            call time_again(scene, t_end, seconds, error)
            if (allocated(error)) return
            plain = min(plain, seconds)
            total = total + seconds
            call time_again(scene, t_end, seconds, error, profiling)
            if (allocated(error)) return
            clocked = min(clocked, seconds)
            total = total + seconds
            if (i >= least_rounds .and. total > long_enough) exit
        end do
        call profile%compare(clocked, plain, profiling%profile%pairs)
    end subroutine compare

    !> Measure the time of the beginning of a run without output.
    subroutine time_again(scene, t_end, seconds, error, profiling)
        type(scene_type), intent(in) :: scene
        real(wp), intent(in) :: t_end
        !> Processor time without the initialization.
        real(wp), intent(out) :: seconds
        type(error_type), allocatable, intent(out) :: error
        !> Time measurement of the parts, if present.
        type(profiling_type), intent(inout), optional, target :: profiling
        type(scene_type), target :: again
        type(simulation_type) :: simulation
        type(interruptible_error_type) :: global_error
        type(interruption_type) :: interruption
        type(statistics_type) :: statistics

        seconds = 0.0_wp
        call repeat_scene(scene, again, error)
        if (.not. allocated(error)) call initialize_run(again, simulation, global_error, error, profiling)
        if (.not. allocated(error)) call simulation%integrate(t_end, error, interruption)
        statistics = simulation%statistics()
        seconds = statistics%cpu_seconds
    end subroutine time_again

    !> True if the error is estimated by a second run: on request, and by default for a short run.
    logical function wants_estimate(arguments, simulation)
        type(arguments_type), intent(in) :: arguments
        type(simulation_type), intent(in) :: simulation
        type(statistics_type) :: statistics

        statistics = simulation%statistics()
        wants_estimate = arguments%error .or. (statistics%cpu_seconds <= short_run .and. .not. arguments%no_error)
    end function wants_estimate

    !> Estimate the error by a second run. It has a separate model, because a run may change its model.
    subroutine estimate(scene, global_error, error)
        type(scene_type), intent(in) :: scene
        type(interruptible_error_type), intent(inout) :: global_error
        type(error_type), allocatable, intent(out) :: error
        type(scene_type), target :: again

        call repeat_scene(scene, again, error)
        if (.not. allocated(error)) call global_error%estimate(again%model, scene%options, scene%q, scene%qd, error)
    end subroutine estimate

    !> Command line, approximately as typed.
    function command_line() result(text)
        character(len=:), allocatable :: text
        integer :: length

        call get_command(length=length)
        allocate (character(len=length) :: text)
        if (length > 0) call get_command(text)
    end function command_line
end module tandem_cli_run
