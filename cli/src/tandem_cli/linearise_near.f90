! SPDX-License-Identifier: MIT
!> tandem linearise --near: eigenvalues of a large mechanism nearest to a shift, at an equilibrium or about a steady motion.
module tandem_cli_linearise_near
    use tandem, only: error_type, is_input_error, most_nearest, nearest_type, set_error, to_text, wp
    use tandem_cli_arguments, only: arguments_type
    use tandem_cli_linearisation_table, only: eigenvalue_text, print_body_motions, shape_text
    use tandem_cli_messages, only: print_to_stderr, done, message_for_scene, input_wrong, padded, run_failed, say
    use tandem_io, only: brief, json_type, scene_type, write_nearest
    use tandem_number_text, only: read_number
    use tandem_status, only: status_invalid_option
    implicit none (type, external)
    private

    public :: linearise_near

    !> Default number of modes.
    integer, parameter :: usual_modes = 10

contains

    !> Find the modes at the start of a scene.
    subroutine linearise_near(arguments, scene, code)
        type(arguments_type), intent(in) :: arguments
        type(scene_type), intent(inout), target :: scene
        !> Exit code.
        integer, intent(out) :: code
        type(nearest_type) :: nearest
        type(error_type), allocatable :: error
        complex(wp) :: shift
        integer :: n_modes

        code = input_wrong
        n_modes = usual_modes
        call read_shift(arguments%value_of('--near', ''), shift, error)
        if (.not. allocated(error)) call arguments%count_of('--modes', most_nearest/2, n_modes, error)
        if (.not. allocated(error)) call refuse_others(arguments, error)
        if (allocated(error)) then
            call print_to_stderr(error%message)
            return
        end if
        ! A complex pair counts as one mode.
        call nearest%find(scene%model, scene%t_start, scene%q, shift, 2*n_modes, error, scene%qd)
        if (.not. allocated(error) .and. arguments%value_of('--output', '') /= '') call write_nearest( &
            arguments%value_of('--output', ''), scene%text, scene%model, nearest, error)
        if (allocated(error)) then
            call print_to_stderr(message_for_scene(error))
            code = merge(input_wrong, run_failed, is_input_error(error%stat))
            return
        end if
        if (arguments%json) then
            call print_json(scene, nearest)
        else
            call print_nearest(scene, nearest)
            if (arguments%shapes) call print_body_motions(scene%model, nearest%q, nearest%values, nearest%shapes)
        end if
        code = done
        if (nearest%is_complete) return
        call print_to_stderr('only '//to_text(size(nearest%values))//' eigenvalues converged; take a shift nearer to those '// &
            'that are wanted')
        code = run_failed
    end subroutine linearise_near

    !> Read a shift `RE` or `RE,IM`.
    subroutine read_shift(text, shift, error)
        character(len=*), intent(in) :: text
        complex(wp), intent(out) :: shift
        type(error_type), allocatable, intent(out) :: error
        real(wp) :: parts(2)
        logical :: is_read
        integer :: comma

        parts = 0.0_wp
        comma = index(text//',', ',')
        call read_number(text(:comma - 1), parts(1), is_read)
        if (is_read .and. comma <= len(text)) call read_number(text(comma + 1:), parts(2), is_read)
        shift = cmplx(parts(1), parts(2), wp)
        if (is_read) return
        call set_error(error, status_invalid_option, 'tandem linearise needs a shift after --near, RE or RE,IM such as '// &
            '0 or 0,30, not "'//text//'"')
    end subroutine read_shift

    !> Refuse options for other linearisations.
    subroutine refuse_others(arguments, error)
        type(arguments_type), intent(in) :: arguments
        type(error_type), allocatable, intent(out) :: error
        character(len=8), parameter :: others(2) = [character(len=8) :: '--at', '--period']
        integer :: i

        do i = 1, size(others)
            if (arguments%value_of(trim(others(i)), '') == '') cycle
            call set_error(error, status_invalid_option, '--near cannot be combined with '//trim(others(i)), &
                'eigenvalues near a shift are those of an equilibrium or of a steady motion')
            return
        end do
    end subroutine refuse_others

    !> Print the result as text, with one eigenvalue per complex pair.
    subroutine print_nearest(scene, it)
        type(scene_type), intent(in) :: scene
        type(nearest_type), intent(in) :: it
        integer :: i
        logical :: has_pairs

        has_pairs = .not. abs(aimag(it%shift)) > 0.0_wp
        call say(scene%name//trim(merge(' in a steady motion', ' at rest           ', it%frame%moves))// &
            ': the eigenvalues nearest to '//complex_text(it%shift))
        if (it%frame%moves) call say('moves along '//rates_text(it))
        if (it%n_redundant > 0) call say(to_text(it%n_redundant)//' redundant rows are omitted')
        call say('')
        call say(padded('eigenvalue [1/s]', 46)//padded('frequency', 14)//padded('damping', 12)//padded('error', 10)//'shape')
        do i = 1, size(it%values)
            associate (value => it%values(i))
                if (has_pairs .and. aimag(value) < -it%error(i)) cycle
                call say(eigenvalue_text(value, has_pairs)//padded(brief(abs(aimag(value))/(2*acos(-1.0_wp)))//' Hz', 14)// &
                    padded(brief(-real(value, wp)/max(abs(value), tiny(1.0_wp))), 12)//padded(brief(it%error(i)), 10)// &
                    shape_text(scene%model, it%shapes(:, i), abs(aimag(value)) > 0.0_wp))
            end associate
        end do
    end subroutine print_nearest

    !> Motions of the steady motion with their rates; only the first few if there are many.
    function rates_text(it) result(text)
        type(nearest_type), intent(in) :: it
        character(len=:), allocatable :: text
        integer, parameter :: most = 8
        integer :: i

        text = ''
        do i = 1, min(most, size(it%frame%rates))
            text = text//', '//trim(it%frame%names(i))//' '//to_text(it%frame%rates(i))
        end do
        text = text(3:)//merge(', ...', '     ', size(it%frame%rates) > most)
        text = trim(text)//' (per second)'
    end function rates_text

    !> A complex number as text.
    function complex_text(value) result(text)
        complex(wp), intent(in) :: value
        character(len=:), allocatable :: text

        text = to_text(real(value, wp))
        if (abs(aimag(value)) > 0.0_wp) text = text//' + '//to_text(aimag(value))//' i'
    end function complex_text

    !> Print the result as one JSON object; mode shapes are written by --output only.
    subroutine print_json(scene, it)
        type(scene_type), intent(in) :: scene
        type(nearest_type), intent(in) :: it
        type(json_type) :: json
        integer :: i

        call json%begin_object()
        call json%add('scene', scene%name)
        call json%add('time', it%t)
        call json%add('kind', trim(merge('steady motion', 'equilibrium  ', it%frame%moves)))
        call json%add('residual', it%residual)
        call json%add('shift', [real(it%shift, wp), aimag(it%shift)])
        call json%add('complete', it%is_complete)
        call json%add('redundant_rows', it%n_redundant)
        call json%add('products', it%products)
        call json%add('factor_entries', it%factor_entries)
        call json%begin_object('steady')
        do i = 1, size(it%frame%rates)
            call json%add(trim(it%frame%names(i)), it%frame%rates(i))
        end do
        call json%end_object()
        call json%begin_array('eigenvalues')
        do i = 1, size(it%values)
            call json%add('', [real(it%values(i), wp), aimag(it%values(i))])
        end do
        call json%end_array()
        call json%add('errors', it%error)
        call json%end_object()
        call say(json%text)
    end subroutine print_json
end module tandem_cli_linearise_near
