! SPDX-License-Identifier: MIT
!> Converts parsed TOML values to Fortran. On failure, each procedure returns the reason in `problem` and keeps the value.
module tandem_io_scene_values
    use tandem, only: wp
    use tandem_io_scene_source, only: source_type
    use tandem_io_scene_text, only: to_toml
    use tomlf, only: len, toml_array, toml_keyval, toml_table, toml_value
    use tomlf_constants, only: tfi, tfr, toml_type
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)
    private

    public :: convert, place_of

    !> Longest text, in bytes: that of a path.
    integer, parameter :: longest = 4096

    !> Convert to a number, an integer, a truth value, a text, an array of numbers, or an array of texts.
    interface convert
        module procedure convert_real
        module procedure convert_integer
        module procedure convert_logical
        module procedure convert_string
        module procedure convert_reals
        module procedure convert_strings
    end interface convert

contains

    !> Position of a value in its source.
    integer function place_of(source, found)
        class(source_type), intent(in) :: source
        class(toml_value), intent(in) :: found

        place_of = found%origin
        select type (found)
        type is (toml_keyval)
            if (found%origin_value > 0) place_of = found%origin_value
        class default
            ! For lists and inline tables the parser reports the key alone.
            place_of = source%value_of(found%origin)
        end select
    end function place_of

    !> A finite number; an integer will do.
    subroutine convert_real(source, found, value, problem)
        class(source_type), intent(in) :: source
        class(toml_value), intent(in) :: found
        real(wp), intent(inout) :: value
        character(len=:), allocatable, intent(out) :: problem
        real(tfr), pointer :: number
        integer(tfi), pointer :: whole

        problem = 'must be a number, not '//kind_of(found)
        select type (found)
        type is (toml_keyval)
            select case (found%get_type())
            case (toml_type%float)
                call found%get(number)
                problem = 'must be a finite number'
                if (.not. ieee_is_finite(number)) return
                value = number
                problem = ''
            case (toml_type%int)
                call found%get(whole)
                problem = 'has too many digits for an integer; write a decimal point'
                if (has_overflown(source, found)) return
                value = real(whole, wp)
                problem = ''
            case default
                return
            end select
        end select
    end subroutine convert_real

    !> An integer.
    subroutine convert_integer(source, found, value, problem)
        class(source_type), intent(in) :: source
        class(toml_value), intent(in) :: found
        integer, intent(inout) :: value
        character(len=:), allocatable, intent(out) :: problem
        integer(tfi), pointer :: whole

        problem = 'must be an integer, not '//kind_of(found)
        select type (found)
        type is (toml_keyval)
            if (found%get_type() /= toml_type%int) return
            call found%get(whole)
            problem = 'must lie between -'//to_toml(huge(value))//' and '//to_toml(huge(value))
            if (has_overflown(source, found) .or. abs(whole) > huge(value)) return
            value = int(whole)
            problem = ''
        end select
    end subroutine convert_integer

    !> True or false.
    subroutine convert_logical(source, found, value, problem)
        class(source_type), intent(in) :: source
        class(toml_value), intent(in) :: found
        logical, intent(inout) :: value
        character(len=:), allocatable, intent(out) :: problem
        logical, pointer :: truth

        problem = 'must be true or false, not '//kind_of(found)
        select type (found)
        type is (toml_keyval)
            if (found%get_type() /= toml_type%boolean) return
            call found%get(truth)
            value = truth
            problem = ''
        end select
    end subroutine convert_logical

    !> A text, not empty and without control characters.
    subroutine convert_string(source, found, value, problem)
        class(source_type), intent(in) :: source
        class(toml_value), intent(in) :: found
        character(len=:), allocatable, intent(inout) :: value
        character(len=:), allocatable, intent(out) :: problem
        character(len=:), pointer :: text
        integer :: i

        problem = 'must be a text in quotes, not '//kind_of(found)
        select type (found)
        type is (toml_keyval)
            if (found%get_type() /= toml_type%string) return
            call found%get(text)
            problem = 'must not be empty'
            if (len_trim(text) == 0) return
            problem = 'must not be longer than '//to_toml(longest)//' bytes'
            if (len(text) > longest) return
            problem = 'must not hold control characters'
            do i = 1, len(text)
                if (iachar(text(i:i)) < 32 .or. iachar(text(i:i)) == 127) return
            end do
            value = text
            problem = ''
        end select
    end subroutine convert_string

    !> An array of finite numbers.
    subroutine convert_reals(source, found, values, problem)
        class(source_type), intent(in) :: source
        class(toml_value), intent(inout) :: found
        real(wp), allocatable, intent(inout) :: values(:)
        character(len=:), allocatable, intent(out) :: problem
        class(toml_value), pointer :: element
        real(wp), allocatable :: read_values(:)
        integer :: i

        problem = 'must be an array of numbers, not '//kind_of(found)
        select type (found)
        type is (toml_array)
            read_values = spread(0.0_wp, 1, len(found))
            do i = 1, len(found)
                call found%get(i, element)
                call convert_real(source, element, read_values(i), problem)
                if (problem /= '') then
                    problem = 'element '//to_toml(i)//' '//problem
                    return
                end if
            end do
            values = read_values
            problem = ''
        end select
    end subroutine convert_reals

    !> An array of texts; longer ones than `values` can hold are refused.
    subroutine convert_strings(source, found, values, problem)
        class(source_type), intent(in) :: source
        class(toml_value), intent(inout) :: found
        character(len=*), allocatable, intent(inout) :: values(:)
        character(len=:), allocatable, intent(out) :: problem
        class(toml_value), pointer :: element
        character(len=:), allocatable :: text
        character(len=len(values)), allocatable :: read_values(:)
        integer :: i

        problem = 'must be an array of texts in quotes, not '//kind_of(found)
        select type (found)
        type is (toml_array)
            allocate (read_values(len(found)))
            do i = 1, len(found)
                call found%get(i, element)
                call convert_string(source, element, text, problem)
                if (problem == '' .and. len(text) > len(values)) problem = 'is too long'
                if (problem /= '') then
                    problem = 'element '//to_toml(i)//' '//problem
                    return
                end if
                read_values(i) = text
            end do
            call move_alloc(read_values, values)
            problem = ''
        end select
    end subroutine convert_strings

    !> True if an integer may have more digits than 64 bits hold, in base 16 too; the parser would wrap it around.
    logical function has_overflown(source, found)
        class(source_type), intent(in) :: source
        type(toml_keyval), intent(in) :: found
        integer, parameter :: most_digits = 17

        has_overflown = .false.
        if (found%origin_value < 1 .or. found%origin_value > source%context%top) return
        associate (token => source%context%token(found%origin_value))
            has_overflown = token%last - token%first + 1 > most_digits
        end associate
    end function has_overflown

    !> The kind of a value in words.
    function kind_of(found) result(text)
        class(toml_value), intent(in) :: found
        character(len=:), allocatable :: text

        text = 'something else'
        select type (found)
        type is (toml_table)
            text = 'a table'
        type is (toml_array)
            text = 'an array'
        type is (toml_keyval)
            select case (found%get_type())
            case (toml_type%string)
                text = 'a text'
            case (toml_type%int)
                text = 'an integer'
            case (toml_type%float)
                text = 'a number with a fraction'
            case (toml_type%boolean)
                text = 'true or false'
            case (toml_type%datetime)
                text = 'a date'
            case default
                text = 'no value'
            end select
        end select
    end function kind_of
end module tandem_io_scene_values
