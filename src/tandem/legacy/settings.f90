! SPDX-License-Identifier: MIT
!> Options by name, for callers who cannot see `options_type`. The names are those of its components, in either case. A value that
!> cannot be is refused at once, and the one before stays; how options go together is seen when a run starts.
module tandem_legacy_settings
    use tandem_error, only: error_type, set_error
    use tandem_kinds, only: wp
    use tandem_options, only: options_type
    use tandem_status, only: status_invalid_option
    use tandem_stepper_factory, only: check_stepper
    implicit none (type, external)
    private

    public :: set_real_option, set_integer_option, set_text_option, lower_case

    character(len=*), parameter :: reals = 'step, rtol, atol, first_step, max_step, constraint_tolerance, utol, btol, '// &
        'htol, intol, v_limit, w_limit, condition_limit, secant_limit, start_tolerance, max_seconds'
    character(len=*), parameter :: integers = 'max_steps, max_evaluations, max_events, iteration_limit, constant_mass'
    character(len=*), parameter :: texts = 'stepper, chart, refresh, basis, projection'

contains

    !> Set an option whose value is a real number.
    subroutine set_real_option(options, name, value, error)
        type(options_type), intent(inout) :: options
        !> Name of a component.
        character(len=*), intent(in) :: name
        real(wp), intent(in) :: value
        !> invalid_option where there is no such option, or its value cannot be.
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: changed

        changed = options
        select case (lower_case(name))
        case ('step'); changed%step = value
        case ('rtol'); changed%rtol = value
        case ('atol'); changed%atol = value
        case ('first_step'); changed%first_step = value
        case ('max_step'); changed%max_step = value
        case ('constraint_tolerance'); changed%constraint_tolerance = value
        case ('utol'); changed%utol = value
        case ('btol'); changed%btol = value
        case ('htol'); changed%htol = value
        case ('intol'); changed%intol = value
        case ('v_limit'); changed%v_limit = value
        case ('w_limit'); changed%w_limit = value
        case ('condition_limit'); changed%condition_limit = value
        case ('secant_limit'); changed%secant_limit = value
        case ('start_tolerance'); changed%start_tolerance = value
        case ('max_seconds'); changed%max_seconds = value
        case default; call refuse(name, 'a real option', reals, error)
        end select
        call take(options, changed, error)
    end subroutine set_real_option

    !> Set an option whose value is an integer.
    subroutine set_integer_option(options, name, value, error)
        type(options_type), intent(inout) :: options
        character(len=*), intent(in) :: name
        integer, intent(in) :: value
        !> invalid_option where there is no such option, or its value cannot be.
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: changed

        changed = options
        select case (lower_case(name))
        case ('max_steps'); changed%max_steps = value
        case ('max_evaluations'); changed%max_evaluations = value
        case ('max_events'); changed%max_events = value
        case ('iteration_limit'); changed%iteration_limit = value
        case default; call refuse(name, 'an integer option', integers, error)
        end select
        call take(options, changed, error)
    end subroutine set_integer_option

    !> Set an option whose value is a word.
    subroutine set_text_option(options, name, value, error)
        type(options_type), intent(inout) :: options
        character(len=*), intent(in) :: name
        !> The word, in either case.
        character(len=*), intent(in) :: value
        !> invalid_option where there is no such option, or no such word for it.
        type(error_type), allocatable, intent(out) :: error
        !> What stands for a word that is longer than any of an option's values, with the marks of a quotation.
        character(len=*), parameter :: too_long = '"?"'
        type(options_type) :: changed
        integer :: i

        changed = options
        select case (lower_case(name))
        case ('stepper'); changed%stepper = word(len(changed%stepper))
        case ('chart'); changed%chart = word(len(changed%chart))
        case ('refresh'); changed%refresh = word(len(changed%refresh))
        case ('basis'); changed%basis = word(len(changed%basis))
        case ('projection'); changed%projection = word(len(changed%projection))
        case default; call refuse(name, 'a text option', texts, error)
        end select
        call take(options, changed, error)
        if (.not. allocated(error)) return
        i = index(error%message, too_long)
        if (i > 0) error%message = error%message(:i)//trim(value)//error%message(i + len(too_long) - 1:)

    contains

        !> The word; one that an option has no room for must not become another by being cut.
        pure function word(room)
            integer, intent(in) :: room
            character(len=room) :: word

            word = lower_case(value)
            if (len_trim(value) > room) word = too_long(2:len(too_long) - 1)
        end function word
    end subroutine set_text_option

    !> Take changed options over if they can be.
    subroutine take(options, changed, error)
        type(options_type), intent(inout) :: options
        type(options_type), intent(in) :: changed
        type(error_type), allocatable, intent(inout) :: error

        if (.not. allocated(error)) call check_stepper(changed%stepper, error)
        if (.not. allocated(error)) call changed%check(error)
        if (.not. allocated(error)) options = changed
    end subroutine take

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
