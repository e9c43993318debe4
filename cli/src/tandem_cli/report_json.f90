! SPDX-License-Identifier: MIT
!> Report of a run as one JSON object: settings, status, figures and warnings.
module tandem_cli_report_json
    use tandem, only: error_type, figure_reader_type, find_error_warnings, global_error_type, long, simulation_type, status_name, &
        tell_figures, warning_type, wp
    use tandem_cli_messages, only: say
    use tandem_io, only: json_type, scene_type, trajectory_type
    use tandem_status, only: status_ok
    implicit none (type, external)
    private

    public :: print_report_json

    !> Writes figures of a run as members of a JSON object.
    type, extends(figure_reader_type) :: member_writer_type
        type(json_type) :: json
    contains
        procedure :: count => add_count, value => add_value
    end type member_writer_type

contains

    !> Print the object. See `print_report` for the arguments.
    subroutine print_report_json(scene, simulation, trajectory, error, global_error, estimate_error)
        type(scene_type), intent(in) :: scene
        type(simulation_type), intent(in) :: simulation
        type(trajectory_type), intent(in) :: trajectory
        type(error_type), allocatable, intent(in) :: error
        class(global_error_type), intent(in) :: global_error
        type(error_type), allocatable, intent(in) :: estimate_error
        type(member_writer_type) :: writer

        associate (json => writer%json)
            call json%begin_object()
            call json%add('scene', scene%name)
            call json%add('model', scene%model_name)
            call json%add('stepper', scene%options%stepper)
            if (allocated(error)) then
                call json%add('status', status_name(error%stat))
                call json%add('message', error%message)
            else
                call json%add('status', status_name(status_ok))
                call json%add('message', '')
            end if
            call json%add('t_start', scene%t_start)
            call json%add('t_end', scene%t_end)
            call json%add('t', simulation%state%t)
            call json%add('q', simulation%state%q)
            call json%add('qd', simulation%state%qd)
            call json%add('stopped_by', trim(simulation%stopped_by))
            call json%add('file', scene%output%file)
            call json%add('rows', trajectory%rows)
            call json%begin_object('figures')
        end associate
        call tell_figures(simulation%statistics(), writer)
        call writer%json%end_object()
        call add_events(scene, simulation, writer%json)
        if (simulation%n_crossings > 0) call add_crossings(simulation, writer%json)
        call add_error(global_error, estimate_error, writer%json)
        call add_warnings(simulation, global_error, estimate_error, writer%json)
        call writer%json%end_object()
        call say(writer%json%text)
    end subroutine print_report_json

    !> Add the singular configurations that were passed.
    subroutine add_crossings(simulation, json)
        type(simulation_type), intent(in) :: simulation
        type(json_type), intent(inout) :: json
        integer :: i

        call json%begin_array('singular')
        do i = 1, simulation%n_crossings
            call json%begin_object()
            call json%add('t', simulation%crossings(i)%t)
            call json%add('error', simulation%crossings(i)%error)
            call json%end_object()
        end do
        call json%end_array()
    end subroutine add_crossings

    !> Add the recorded events.
    subroutine add_events(scene, simulation, json)
        type(scene_type), intent(in) :: scene
        type(simulation_type), intent(in) :: simulation
        type(json_type), intent(inout) :: json
        integer :: i

        call json%begin_array('events')
        do i = 1, merge(simulation%n_events, 0, allocated(simulation%events))
            call json%begin_object()
            call json%add('name', scene%events(simulation%events(i)%number)%name)
            call json%add('t', simulation%events(i)%t)
            call json%end_object()
        end do
        call json%end_array()
    end subroutine add_events

    !> Error at the end of the run, null if unknown.
    subroutine add_error(global_error, estimate_error, json)
        class(global_error_type), intent(in) :: global_error
        type(error_type), allocatable, intent(in) :: estimate_error
        type(json_type), intent(inout) :: json

        call json%begin_object('error_at_end')
        call json%add('is_known', global_error%is_known)
        if (allocated(estimate_error)) call json%add('message', estimate_error%message)
        if (global_error%is_known) then
            call json%add('q', global_error%error_q)
            call json%add('qd', global_error%error_qd)
            call json%add('largest', global_error%largest)
            call json%add('t_largest', global_error%t_largest)
            call json%add('is_bound', global_error%is_bound)
            call json%add('right_hand_sides', global_error%right_hand_sides)
            call json%add('seconds', global_error%seconds)
        end if
        call json%end_object()
    end subroutine add_error

    !> Add all warnings.
    subroutine add_warnings(simulation, global_error, estimate_error, json)
        type(simulation_type), intent(in) :: simulation
        class(global_error_type), intent(in) :: global_error
        type(error_type), allocatable, intent(in) :: estimate_error
        type(json_type), intent(inout) :: json
        type(warning_type), allocatable :: warnings(:)
        integer :: i

        call json%begin_array('warnings')
        if (allocated(simulation%warnings)) then
            do i = 1, size(simulation%warnings)
                call json%add('', simulation%warnings(i)%text)
            end do
        end if
        call find_error_warnings(simulation%options, simulation%statistics(), warnings, global_error, estimate_error)
        do i = 1, size(warnings)
            call json%add('', warnings(i)%text)
        end do
        call json%end_array()
    end subroutine add_warnings

    !> Write a counter.
    subroutine add_count(self, name, number)
        class(member_writer_type), intent(inout) :: self
        character(len=*), intent(in) :: name
        integer(long), intent(in) :: number

        call self%json%add(name, number)
    end subroutine add_count

    !> Write a number.
    subroutine add_value(self, name, number)
        class(member_writer_type), intent(inout) :: self
        character(len=*), intent(in) :: name
        real(wp), intent(in) :: number

        call self%json%add(name, number)
    end subroutine add_value
end module tandem_cli_report_json
