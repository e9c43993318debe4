! SPDX-License-Identifier: MIT
!> Parameters of a mechanism: named numbers, each given by a number or by an expression of the others, in any order.
module tandem_mechanism_parameters
    use tandem_error, only: error_type, set_error
    use tandem_kinds, only: wp
    use tandem_mechanism_expression, only: check_name, expression_type, parse_expression
    use tandem_status, only: status_invalid_model
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)
    private

    public :: resolve_parameters, check_parameter_name, reserved_names

    !> Variables of functions of time and of laws, which would hide a parameter of the same name.
    character(len=6), parameter :: reserved_names(4) = [character(len=6) :: 't', 'length', 'angle', 'rate']

contains

    !> Refuse invalid names of parameters and of repetition indices.
    subroutine check_parameter_name(name, error)
        character(len=*), intent(in) :: name
        type(error_type), allocatable, intent(out) :: error

        call check_name(name, error)
        if (allocated(error)) return
        if (any(reserved_names == name)) call set_error(error, status_invalid_model, '"'//name// &
            '" is reserved in expressions, as the variable of a function or a law', 'choose another name')
    end subroutine check_parameter_name

    !> Evaluate all parameters.
    subroutine resolve_parameters(names, texts, values, error, key)
        !> One name and one text each; trailing blanks are ignored.
        character(len=*), intent(in) :: names(:), texts(:)
        !> One value each, finite unless there is an error.
        real(wp), intent(out) :: values(:)
        type(error_type), allocatable, intent(out) :: error
        !> Prefix of names in messages, such as 'parameters.'.
        character(len=*), intent(in), optional :: key
        type(expression_type), allocatable :: expressions(:)
        logical :: is_known(size(names))
        character(len=:), allocatable :: prefix, names_in_circle
        integer :: i
        logical :: has_changed

        prefix = ''
        if (present(key)) prefix = key
        values = 0.0_wp
        allocate (expressions(size(names)))
        do i = 1, size(names)
            call check_parameter_name(trim(names(i)), error)
            if (allocated(error)) return
            if (any(names(:i - 1) == names(i))) then
                call set_error(error, status_invalid_model, 'there are two parameters "'//trim(names(i))//'"', 'rename one of them')
                return
            end if
        end do
        do i = 1, size(names)
            call parse_expression(expressions(i), trim(texts(i)), names, error, key=prefix//trim(names(i)))
            if (allocated(error)) return
        end do
        is_known = .false.
        has_changed = .true.
        do while (has_changed)
            has_changed = .false.
            do i = 1, size(names)
                if (is_known(i)) cycle
                if (expressions(i)%first_outside(is_known) > 0) cycle
                values(i) = expressions(i)%value(values)
                if (.not. ieee_is_finite(values(i))) then
                    call set_error(error, status_invalid_model, prefix//trim(names(i))//': "'//trim(texts(i))// &
                        '" does not yield a finite number', &
                        'correct the expression or the parameters in it')
                    return
                end if
                is_known(i) = .true.
                has_changed = .true.
            end do
        end do
        if (all(is_known)) return
        call find_circle(names, expressions, is_known, names_in_circle)
        call set_error(error, status_invalid_model, 'parameters depend on each other cyclically: '//names_in_circle, &
            'give one of them as a number')
    end subroutine resolve_parameters

    !> A circle among the unknown parameters, as names joined by arrows; long ones are cut.
    pure subroutine find_circle(names, expressions, is_known, text)
        character(len=*), intent(in) :: names(:)
        type(expression_type), intent(in) :: expressions(:)
        logical, intent(in) :: is_known(:)
        character(len=:), allocatable, intent(out) :: text
        integer, parameter :: longest = 10
        integer :: i, first, n

        ! After as many steps as there are parameters, the walk is in a circle.
        first = findloc(is_known, .false., dim=1)
        do i = 1, size(names)
            first = expressions(first)%first_outside(is_known)
        end do
        ! Report the circle from its first parameter in the given order.
        i = first
        do n = 1, size(names)
            i = expressions(i)%first_outside(is_known)
            first = min(first, i)
        end do
        text = trim(names(first))
        i = expressions(first)%first_outside(is_known)
        n = 1
        do while (i /= first .and. n < longest)
            text = text//' -> '//trim(names(i))
            i = expressions(i)%first_outside(is_known)
            n = n + 1
        end do
        if (i /= first) text = text//' -> ...'
        text = text//' -> '//trim(names(first))
    end subroutine find_circle
end module tandem_mechanism_parameters
