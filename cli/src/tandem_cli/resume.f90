! SPDX-License-Identifier: MIT
!> tandem resume: continues an interrupted run from the checkpoint in its result file; the results are appended to this file.
module tandem_cli_resume
    use tandem, only: error_type, pack_type, set_error, simulation_type, to_text, wp
    use tandem_cli_arguments, only: arguments_type
    use tandem_cli_interruption, only: interruptible_error_type, watch_signals
    use tandem_cli_messages, only: print_to_stderr, input_wrong
    use tandem_cli_run, only: execute_run, initialize_run
    use tandem_io, only: description_type, interpret_scene, open_scene, read_snapshot, scene_type, snapshot_type, trajectory_type
    use tandem_status, only: status_invalid_checkpoint, status_invalid_option
    implicit none (type, external)
    private

    public :: resume

    !> Settings that may be changed: those that determine the end of the run.
    character(len=*), parameter :: changeable(5) = [character(len=22) :: 'time.end', 'solver.max_steps', &
        'solver.max_evaluations', 'solver.max_seconds', 'solver.max_events']

contains

    !> Continue a run.
    subroutine resume(arguments, code)
        type(arguments_type), intent(in) :: arguments
        !> Exit code.
        integer, intent(out) :: code
        type(scene_type), target :: scene
        type(simulation_type) :: simulation
        type(trajectory_type), target :: trajectory
        type(interruptible_error_type), target :: global_error
        type(error_type), allocatable :: error

        call check_settings(arguments%settings, error)
        ! The file is claimed before it is read, so that no other process can change it in between.
        if (.not. allocated(error)) call trajectory%claim(arguments%scene, error)
        if (.not. allocated(error)) call prepare(arguments, scene, simulation, trajectory, global_error, error)
        if (allocated(error)) then
            call print_to_stderr(error%message)
            code = input_wrong
            return
        end if
        call execute_run(arguments, scene, simulation, trajectory, global_error, code)
    end subroutine resume

    !> Refuse settings that would change the motion.
    subroutine check_settings(settings, error)
        character(len=*), intent(in) :: settings(:)
        type(error_type), allocatable, intent(out) :: error
        integer :: i, length

        do i = 1, size(settings)
            length = max(0, index(settings(i), '=') - 1)
            if (length == 0) length = len_trim(settings(i))
            if (any(settings(i) (:length) == changeable)) cycle
            if (index(settings(i), '--unset ') == 1) then
                if (any(settings(i) (len('--unset ') + 1:) == changeable(2:))) cycle
            end if
            call set_error(error, status_invalid_option, 'resume cannot set '//settings(i) (:length)// &
                ', which would change the run', 'set '//listed(changeable)//' only')
            return
        end do
    end subroutine check_settings

    !> Prepare the run up to its first step: read scene and state from the file. The file is not changed if this fails.
    subroutine prepare(arguments, scene, simulation, trajectory, global_error, error)
        type(arguments_type), intent(in) :: arguments
        type(scene_type), intent(inout), target :: scene
        type(simulation_type), intent(inout) :: simulation
        type(trajectory_type), intent(inout) :: trajectory
        type(interruptible_error_type), intent(inout), target :: global_error
        type(error_type), allocatable, intent(out) :: error
        type(snapshot_type) :: snapshot
        type(description_type) :: keys
        type(pack_type) :: pack
        character(len=64) :: problem
        real(wp) :: saved_end
        integer :: i

        call read_snapshot(arguments%scene, snapshot, error)
        if (.not. allocated(error)) call open_scene('the scene in '//arguments%scene, [character(len=1) ::], arguments%models, &
            keys, error, snapshot%scene)
        saved_end = keys%entries%number_at('time.end')
        do i = 1, size(arguments%settings)
            if (.not. allocated(error)) call keys%apply(trim(arguments%settings(i)), error)
        end do
        if (.not. allocated(error)) call interpret_scene(keys, arguments%models, scene, error)
        if (.not. allocated(error)) call initialize_run(scene, simulation, global_error, error)
        if (.not. allocated(error) .and. snapshot%is_before_start) then
            call start_again(arguments%scene, scene, simulation, trajectory, global_error, error)
            return
        end if
        if (.not. allocated(error)) call simulation%restore_state(snapshot%simulation, error)
        if (allocated(error)) return
        call pack%begin_reading('watcher', snapshot%watcher, problem)
        if (problem == '') call global_error%pack_state(pack)
        if (problem /= '' .or. pack%has_failed) then
            call set_error(error, status_invalid_checkpoint, 'cannot resume from '//arguments%scene//': its checkpoint is damaged')
            return
        end if
        call check_end(arguments, scene, saved_end, snapshot, simulation, error)
        if (allocated(error)) return
        scene%output%file = arguments%scene
        ! Signals are caught only when the file is about to change; until then they end the program at once.
        call watch_signals()
        call trajectory%resume(scene%output, simulation, snapshot, scene%text, error, global_error)
    end subroutine prepare

    !> Start a run again that was killed before its first state was saved.
    subroutine start_again(path, scene, simulation, trajectory, global_error, error)
        character(len=*), intent(in) :: path
        type(scene_type), intent(inout), target :: scene
        type(simulation_type), intent(in) :: simulation
        type(trajectory_type), intent(inout) :: trajectory
        type(interruptible_error_type), intent(inout), target :: global_error
        type(error_type), allocatable, intent(out) :: error

        scene%output%file = path
        call watch_signals()
        call trajectory%open(scene%output, simulation, error, scene%text, 'tandem resume '//path, force=.true., &
            watcher=global_error)
    end subroutine start_again

    !> Check the end of the run. A complete run can only be continued to a later end. A run that was killed between its end and its
    !> report counts as complete. No run can be ended before the time that it has reached. If only the error of a complete run is
    !> requested, no step is taken.
    subroutine check_end(arguments, scene, saved_end, snapshot, simulation, error)
        type(arguments_type), intent(in) :: arguments
        type(scene_type), intent(in) :: scene
        !> End time stored in the file.
        real(wp), intent(in) :: saved_end
        type(snapshot_type), intent(in) :: snapshot
        type(simulation_type), intent(in) :: simulation
        type(error_type), allocatable, intent(out) :: error
        character(len=:), allocatable :: run, here

        run = 'the run in '//arguments%scene//' is '
        here = to_text(simulation%state%t)
        if (snapshot%is_complete .and. simulation%is_stopped) then
            if (.not. arguments%error) call set_error(error, status_invalid_option, run//'complete: "'// &
                trim(simulation%stopped_by)//'" stopped it at t = '//here, &
                'there is nothing to continue; --error estimates its error')
        else if (simulation%state%t >= scene%t_end .and. scene%t_end < saved_end) then
            call set_error(error, status_invalid_option, run//'already at t = '//here//', which is not before the end '// &
                to_text(scene%t_end), 'set a later end by --set time.end=TIME; its end was '//to_text(saved_end))
        else if (snapshot%is_complete .and. simulation%state%t >= scene%t_end .and. .not. arguments%error) then
            call set_error(error, status_invalid_option, run//'complete: t = '//here, &
                'set a later end by --set time.end=TIME; --error estimates its error')
        end if
    end subroutine check_end

    !> Words separated by commas.
    pure function listed(words) result(text)
        character(len=*), intent(in) :: words(:)
        character(len=:), allocatable :: text
        integer :: i

        text = trim(words(1))
        do i = 2, size(words)
            text = text//', '//trim(words(i))
        end do
    end function listed
end module tandem_cli_resume
