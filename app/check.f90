! SPDX-License-Identifier: MIT
!> tandem check: sizes, rank and consistency of the start of a scene, and every procedure of its model against differences.
module tandem_app_check
    use tandem, only: error_type, finding_type, simulation_type, to_text, verify_model
    use tandem_app_arguments, only: arguments_type
    use tandem_app_help, only: help
    use tandem_app_messages, only: complain, done, in_scene_words, input_wrong, padded, run_failed, say
    use tandem_app_moves, only: moves_text
    use tandem_app_report, only: print_warnings
    use tandem_io, only: brief, find_scene, read_scene, scene_type
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)
    private

    public :: check

    !> States at which procedures are compared.
    integer, parameter :: n_states = 10
    !> Columns of the names of procedures.
    integer, parameter :: name_width = 43

contains

    !> Check a scene. The exit code is 1 where a procedure is wrong, 2 where the scene cannot be started.
    subroutine check(arguments, code)
        type(arguments_type), intent(inout) :: arguments
        !> Exit code.
        integer, intent(out) :: code
        type(scene_type), target :: scene
        type(finding_type), allocatable :: findings(:)
        type(error_type), allocatable :: error, start_error
        character(len=:), allocatable :: path

        call arguments%parse([character(len=8) :: '--set', '--help'], .true., error)
        if (.not. allocated(error) .and. arguments%help) then
            call help(code)
            return
        end if
        if (.not. allocated(error)) call find_scene(arguments%scene, path, error)
        if (.not. allocated(error)) call read_scene(path, arguments%settings, scene, error)
        if (.not. allocated(error)) then
            call verify_model(scene%model, scene%t_start, scene%q, scene%qd, n_states, findings, error)
        end if
        if (allocated(error)) then
            call complain(error%message)
            code = input_wrong
            return
        end if
        associate (model => scene%model)
            call say(scene%name//': n = '//to_text(model%n)//', '//to_text(model%n_holonomic)// &
                ' holonomic and '//to_text(model%n_nonholonomic)//' nonholonomic constraints, '// &
                to_text(model%n - model%n_constraints())//' degrees of freedom')
        end associate
        call print_findings(scene, findings)
        call print_start(scene, start_error)
        code = merge(done, run_failed, all(findings%passed))
        if (.not. allocated(start_error)) return
        call complain(in_scene_words(start_error))
        code = input_wrong
    end subroutine check

    !> One line a procedure; the place and the numbers of what is wrong.
    subroutine print_findings(scene, findings)
        type(scene_type), intent(in) :: scene
        type(finding_type), intent(in) :: findings(:)
        character(len=:), allocatable :: place, verdict
        integer :: i

        call say('procedures against differences at '//to_text(n_states)//' random states:')
        do i = 1, size(findings)
            associate (finding => findings(i))
                if (finding%passed) then
                    call say(padded('  '//trim(finding%name), name_width)//'right, within '//brief(finding%error))
                    cycle
                end if
                if (finding%row == 0) then
                    call say(padded('  '//trim(finding%name), name_width)//'FAILED: the procedure could not be evaluated')
                    cycle
                end if
                place = 'row '//to_text(finding%row)
                if (finding%column > 0) place = place//', column '//to_text(finding%column)// &
                    ' ('//scene%model%coordinate_label(finding%column)//')'
                verdict = 'FAILED: no number: '
                if (ieee_is_finite(finding%error)) verdict = 'WRONG by '//brief(finding%error)//' of its largest entry: '
                call say(padded('  '//trim(finding%name), name_width)//verdict//place//' is '//to_text(finding%value)// &
                    ', differences give '//to_text(finding%expected))
            end associate
        end do
    end subroutine print_findings

    !> Whether the simulation would start, with the rank and how far it is off the constraints.
    subroutine print_start(scene, error)
        type(scene_type), intent(inout), target :: scene
        type(error_type), allocatable, intent(out) :: error
        type(simulation_type) :: simulation
        character(len=:), allocatable :: rank

        call simulation%initialize(scene%model, scene%options, scene%t_start, scene%q, scene%qd, error, scene%assembly)
        if (allocated(error)) return
        if (allocated(scene%assembly)) call say('start assembled: '//moves_text(scene%model, scene%assembly))
        rank = 'full rank '//to_text(scene%model%n_constraints())
        if (simulation%n_redundant > 0) rank = 'rank '//to_text(scene%model%n_constraints() - simulation%n_redundant)// &
            ' of '//to_text(scene%model%n_constraints())
        call say('start: C has '//rank//', the errors of position, velocity and acceleration are '// &
            brief(simulation%errors(1))//', '// &
            brief(simulation%errors(2))//', '//brief(simulation%errors(3))//' of their rows'' natural scales')
        call print_warnings(simulation)
    end subroutine print_start
end module tandem_app_check
