! SPDX-License-Identifier: MIT
!> tandem linearise: linear equations, eigenvalues and modes of small motions about the start, an equilibrium, a steady motion, or a
!> state of a run.
module tandem_cli_linearise
    use tandem, only: error_type, floquet_type, inputs_type, linearisation_type, of_motion, set_error, simulation_type, wp
    use tandem_cli_arguments, only: arguments_type
    use tandem_cli_linearisation_json, only: print_linearisation_json
    use tandem_cli_linearisation_table, only: print_body_motions, print_linearisation, print_multipliers
    use tandem_cli_linearise_near, only: linearise_near
    use tandem_cli_messages, only: print_to_stderr, done, message_for_scene, input_wrong, run_failed
    use tandem_io, only: check_target, find_scene, read_scene, scene_type, write_linearisation
    use tandem_status, only: status_invalid_option, status_no_equilibrium
    implicit none (type, external)
    private

    public :: linearise

contains

    !> Linearise a scene.
    subroutine linearise(arguments, code)
        type(arguments_type), intent(in) :: arguments
        !> Exit code.
        integer, intent(out) :: code
        type(scene_type), target :: scene
        type(simulation_type) :: simulation
        type(linearisation_type) :: linearisation
        type(error_type), allocatable :: error
        character(len=:), allocatable :: path
        type(floquet_type), allocatable :: floquet
        type(inputs_type) :: inputs
        real(wp) :: time, period
        logical :: is_new
        integer :: i

        code = input_wrong
        call find_scene(arguments%scene, path, error)
        if (.not. allocated(error)) call read_scene(path, arguments%settings, scene, error, models=arguments%models)
        time = scene%t_start
        period = 0.0_wp
        if (.not. allocated(error)) call arguments%number_of('--at', scene%t_start, time, error)
        if (.not. allocated(error)) call arguments%number_of('--period', 0.0_wp, period, error)
        if (.not. allocated(error) .and. arguments%value_of('--period', '') /= '' .and. .not. period > 0.0_wp) call set_error( &
            error, status_invalid_option, 'the period must be a positive number')
        if (.not. allocated(error) .and. arguments%value_of('--output', '') /= '') call check_target( &
            arguments%value_of('--output', ''), arguments%force, is_new, error)
        if (.not. allocated(error) .and. arguments%value_of('--near', '') /= '') then
            call linearise_near(arguments, scene, code)
            return
        end if
        if (.not. allocated(error)) call simulation%initialize(scene%model, scene%options, scene%t_start, scene%q, scene%qd, &
            error, scene%assembly)
        if (allocated(error)) then
            call print_to_stderr(message_for_scene(error))
            if (error%stat == status_no_equilibrium) code = run_failed
            return
        end if
        code = run_failed
        if (time > scene%t_start) call simulation%integrate(time, error)
        associate (state => simulation%state)
            if (.not. allocated(error)) call linearisation%make(scene%model, state%t, state%q, state%qd, error)
        end associate
        if (.not. allocated(error) .and. period > 0.0_wp) then
            allocate (floquet)
            call floquet%find(linearisation, scene%model, period, error)
        end if
        if (.not. allocated(error)) call inputs%make(linearisation, scene%model, error)
        if (.not. allocated(error) .and. arguments%value_of('--output', '') /= '') call write_linearisation( &
            arguments%value_of('--output', ''), scene%text, scene%model, linearisation, inputs, error)
        if (allocated(error)) then
            call print_to_stderr(error%message)
            return
        end if
        if (arguments%json) then
            call print_linearisation_json(scene, linearisation, inputs, floquet)
        else
            call print_linearisation(scene, linearisation)
            if (arguments%shapes) call print_body_motions(scene%model, linearisation%q, pack(linearisation%spectrum%values, &
                linearisation%spectrum%cause == of_motion), linearisation%spectrum%shapes(:, pack([(i, i=1, &
                size(linearisation%spectrum%cause))], linearisation%spectrum%cause == of_motion)))
            if (allocated(floquet)) call print_multipliers(floquet)
        end if
        code = done
    end subroutine linearise
end module tandem_cli_linearise
