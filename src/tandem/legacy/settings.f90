! SPDX-License-Identifier: MIT
!> Options by name, for callers who cannot see `options_type`. The names are those of its components, in either case.
module tandem_legacy_settings
    use tandem_error, only: error_type, set_error
    use tandem_kinds, only: wp
    use tandem_options, only: options_type
    use tandem_status, only: status_invalid_option
    implicit none (type, external)
    private

    public :: set_real_option, set_integer_option, set_text_option, lower_case

    character(len=*), parameter :: reals = 'step, rtol, atol, first_step, max_step, constraint_tolerance, utol, btol, '// &
        'htol, intol, v_limit, w_limit, condition_limit, secant_limit, start_tolerance, max_seconds'
    character(len=*), parameter :: integers = 'max_steps, max_evaluations, max_events, iteration_limit, constant_mass'
    character(len=*), parameter :: texts = 'stepper, chart, refresh, basis, projection'

contains

    !> Set an option whose value is a real number. Values are checked when a run starts.
    subroutine set_real_option(options, name, value, error)
        type(options_type), intent(inout) :: options
        !> Name of a component.
        character(len=*), intent(in) :: name
        real(wp), intent(in) :: value
        !> invalid_option where there is no such option.
        type(error_type), allocatable, intent(out) :: error

        select case (lower_case(name))
        case ('step'); options%step = value
        case ('rtol'); options%rtol = value
        case ('atol'); options%atol = value
        case ('first_step'); options%first_step = value
        case ('max_step'); options%max_step = value
        case ('constraint_tolerance'); options%constraint_tolerance = value
        case ('utol'); options%utol = value
        case ('btol'); options%btol = value
        case ('htol'); options%htol = value
        case ('intol'); options%intol = value
        case ('v_limit'); options%v_limit = value
        case ('w_limit'); options%w_limit = value
        case ('condition_limit'); options%condition_limit = value
        case ('secant_limit'); options%secant_limit = value
        case ('start_tolerance'); options%start_tolerance = value
        case ('max_seconds'); options%max_seconds = value
        case default; call refuse(name, 'a real option', reals, error)
        end select
    end subroutine set_real_option

    !> Set an option whose value is an integer.
    subroutine set_integer_option(options, name, value, error)
        type(options_type), intent(inout) :: options
        character(len=*), intent(in) :: name
        integer, intent(in) :: value
        !> invalid_option where there is no such option.
        type(error_type), allocatable, intent(out) :: error

        select case (lower_case(name))
        case ('max_steps'); options%max_steps = value
        case ('max_evaluations'); options%max_evaluations = value
        case ('max_events'); options%max_events = value
        case ('iteration_limit'); options%iteration_limit = value
        case default; call refuse(name, 'an integer option', integers, error)
        end select
    end subroutine set_integer_option

    !> Set an option whose value is a word.
    subroutine set_text_option(options, name, value, error)
        type(options_type), intent(inout) :: options
        character(len=*), intent(in) :: name
        !> The word, in either case.
        character(len=*), intent(in) :: value
        !> invalid_option where there is no such option, or the word is longer than any of its values.
        type(error_type), allocatable, intent(out) :: error

        select case (lower_case(name))
        case ('stepper'); call set_word(options%stepper)
        case ('chart'); call set_word(options%chart)
        case ('refresh'); call set_word(options%refresh)
        case ('basis'); call set_word(options%basis)
        case ('projection'); call set_word(options%projection)
        case default; call refuse(name, 'a text option', texts, error)
        end select

    contains

        subroutine set_word(option)
            character(len=*), intent(inout) :: option

            if (len_trim(value) > len(option)) then
                call set_error(error, status_invalid_option, lower_case(name)//' = "'//trim(value)//'" is unknown')
            else
                option = lower_case(value)
            end if
        end subroutine set_word
    end subroutine set_text_option

    subroutine refuse(name, what, known, error)
        character(len=*), intent(in) :: name, what, known
        type(error_type), allocatable, intent(out) :: error

        call set_error(error, status_invalid_option, '"'//trim(name)//'" is not '//what, 'there are '//known)
    end subroutine refuse

    !> A name in lower case, without trailing blanks.
    pure function lower_case(name) result(lower)
        character(len=*), intent(in) :: name
        character(len=len_trim(name)) :: lower
        integer :: i

        lower = name
        do i = 1, len(lower)
            if (lower(i:i) >= 'A' .and. lower(i:i) <= 'Z') lower(i:i) = achar(iachar(lower(i:i)) + 32)
        end do
    end function lower_case
end module tandem_legacy_settings
