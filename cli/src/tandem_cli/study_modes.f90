! SPDX-License-Identifier: MIT
!> tandem study modes: eigenvalues as functions of a parameter of a scene, and changes of stability.
module tandem_cli_study_modes
    use tandem, only: cause_name, error_type, is_input_error, kind_name, of_motion, set_error, to_text, wp
    use tandem_cli_arguments, only: arguments_type
    use tandem_cli_messages, only: print_to_stderr, done, message_for_scene, input_wrong, padded, run_failed, say
    use tandem_io, only: at_meeting, at_pair, brief, crossing_name, find_scene, json_type, locus_point_type, modes_type
    use tandem_number_text, only: read_number
    use tandem_status, only: status_invalid_option
    implicit none (type, external)
    private

    public :: study_modes

    !> Largest number of samples.
    integer, parameter :: most_samples = 10000

contains

    !> Compute the samples and the critical values, and print them.
    subroutine study_modes(arguments, code)
        type(arguments_type), intent(in) :: arguments
        !> Exit code.
        integer, intent(out) :: code
        type(modes_type) :: study
        type(error_type), allocatable :: error
        real(wp) :: ends(2)
        integer :: n, i

        call find_scene(arguments%scene, study%path, error)
        if (.not. allocated(error)) call read_over(arguments%value_of('--over', ''), study%key, ends, n, error)
        if (.not. allocated(error)) then
            study%settings = arguments%settings
            allocate (study%models, source=arguments%models)
            allocate (study%points(n))
            call study%open(ends(1), error)
            do i = 1, n
                if (allocated(error)) exit
                call study%sample(ends(1) + (ends(2) - ends(1))*(i - 1)/(n - 1), study%points(i), error)
            end do
        end if
        if (.not. allocated(error)) call study%find_critical(error)
        if (.not. allocated(error) .and. arguments%value_of('--output', '') /= '') call study%write_csv( &
            arguments%value_of('--output', ''), error)
        if (allocated(error)) then
            call print_to_stderr(message_for_scene(error))
            code = merge(input_wrong, run_failed, is_input_error(error%stat))
            return
        end if
        if (is_constant(study)) call print_to_stderr('the eigenvalues do not change with '//study%key//'; check the key')
        if (arguments%json) then
            call print_json(study)
        else
            call print_loci(study)
        end if
        code = done
    end subroutine study_modes

    !> True if all samples have the same eigenvalues.
    pure logical function is_constant(study)
        type(modes_type), intent(in) :: study
        integer :: i

        is_constant = .true.
        do i = 2, size(study%points)
            if (size(study%points(i)%values) /= size(study%points(1)%values)) then
                is_constant = .false.
            else
                is_constant = is_constant .and. .not. any(abs(study%points(i)%values - study%points(1)%values) > 0.0_wp)
            end if
        end do
    end function is_constant

    !> Read the option `KEY=a:b:n`.
    subroutine read_over(text, key, ends, n, error)
        character(len=*), intent(in) :: text
        character(len=:), allocatable, intent(out) :: key
        real(wp), intent(out) :: ends(2)
        integer, intent(out) :: n
        type(error_type), allocatable, intent(out) :: error
        integer :: equals, first, last
        logical :: is_read

        ends = 0.0_wp
        n = 0
        is_read = .false.
        equals = index(text, '=')
        first = index(text, ':')
        last = index(text, ':', back=.true.)
        key = text(:max(equals - 1, 0))
        if (equals > 1 .and. first > equals .and. last > first) then
            call read_number(text(equals + 1:first - 1), ends(1), is_read)
            if (is_read) call read_number(text(first + 1:last - 1), ends(2), is_read)
            if (is_read) call read_number(text(last + 1:), n, is_read)
        end if
        if (is_read .and. n >= 2 .and. n <= most_samples .and. ends(2) > ends(1)) return
        call set_error(error, status_invalid_option, 'tandem study modes needs --over KEY=a:b:n, such as '// &
            'parameters.speed=0:10:41, not "'//text//'"', 'a is less than b, and n from 2 to '//to_text(most_samples))
    end subroutine read_over

    !> Print the result as text.
    subroutine print_loci(study)
        type(modes_type), intent(in) :: study
        character(len=:), allocatable :: line
        character(len=24) :: number
        integer :: i

        call say(padded(study%key, 18)//'  eigenvalues that neither symmetries nor families explain [1/s]')
        do i = 1, size(study%points)
            call say(padded(to_text(study%points(i)%value), 18)//values_text(study%points(i)))
        end do
        call say('')
        if (size(study%critical) == 0) call say('no critical value between them')
        do i = 1, size(study%critical)
            associate (it => study%critical(i))
                write (number, '(f0.13)') it%value
                line = 'critical at '//trim(number)//' +- '//brief(it%uncertainty)
                select case (it%crossing)
                case (at_pair)
                    line = line//': a pair at +- '//to_text(aimag(it%eigenvalue))//' i (Hopf), which grows '
                case (at_meeting)
                    line = line//': two pairs meet at +- '//to_text(aimag(it%eigenvalue))//' i, of which one grows '
                case default
                    line = line//': a real eigenvalue is zero, which grows '
                end select
                call say(line//trim(merge('beyond', 'before', it%grows_beyond))//' it')
            end associate
        end do
    end subroutine print_loci

    !> Eigenvalues of the motion at one sample, one per complex pair.
    function values_text(point) result(text)
        type(locus_point_type), intent(in) :: point
        character(len=:), allocatable :: text
        character(len=16) :: re, im
        integer :: i

        text = ''
        do i = 1, size(point%values)
            if (point%cause(i) /= of_motion .or. aimag(point%values(i)) < 0.0_wp) cycle
            write (re, '(g0.5)') real(point%values(i), wp)
            text = text//'  '//trim(adjustl(re))
            if (.not. aimag(point%values(i)) > 0.0_wp) cycle
            write (im, '(g0.5)') aimag(point%values(i))
            text = text//' +- '//trim(adjustl(im))//' i'
        end do
        if (trim(kind_name(point%kind)) == 'instant') text = text//'  (not steady)'
    end function values_text

    !> Print the result as one JSON object.
    subroutine print_json(study)
        type(modes_type), intent(in) :: study
        type(json_type) :: json
        integer :: i, k

        call json%begin_object()
        call json%add('key', study%key)
        call json%begin_array('rows')
        do i = 1, size(study%points)
            associate (point => study%points(i))
                call json%begin_object()
                call json%add('value', point%value)
                call json%add('kind', kind_name(point%kind))
                call json%begin_array('eigenvalues')
                do k = 1, size(point%values)
                    call json%add('', [real(point%values(k), wp), aimag(point%values(k))])
                end do
                call json%end_array()
                call json%add('causes', cause_name(point%cause))
                call json%end_object()
            end associate
        end do
        call json%end_array()
        call json%begin_array('critical')
        do i = 1, size(study%critical)
            associate (it => study%critical(i))
                call json%begin_object()
                call json%add('value', it%value)
                call json%add('uncertainty', it%uncertainty)
                call json%add('crossing', crossing_name(it%crossing))
                call json%add('eigenvalue', [real(it%eigenvalue, wp), aimag(it%eigenvalue)])
                call json%add('grows_beyond', it%grows_beyond)
                call json%end_object()
            end associate
        end do
        call json%end_array()
        call json%end_object()
        call say(json%text)
    end subroutine print_json
end module tandem_cli_study_modes
