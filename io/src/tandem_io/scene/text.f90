! SPDX-License-Identifier: MIT
!> Values as TOML text that reads back to the same value, and procedures for messages about keys.
module tandem_io_scene_text
    use tandem, only: wp
    use tandem_names, only: nearest_name
    use tomlf_utils, only: toml_escape_string
    implicit none (type, external)
    private

    public :: to_toml, listed, nearest_name

    !> Convert a value to TOML: real, integer, truth value, text, and arrays of reals and of texts.
    interface to_toml
        module procedure real_to_toml
        module procedure integer_to_toml
        module procedure logical_to_toml
        module procedure string_to_toml
        module procedure reals_to_toml
        module procedure strings_to_toml
    end interface to_toml

contains

    !> Shortest decimal representation that reads back to the same number: 0.001, 15.0, 1e-12.
    pure function real_to_toml(value) result(text)
        !> Must be finite.
        real(wp), intent(in) :: value
        character(len=:), allocatable :: text
        character(len=40) :: buffer
        character(len=:), allocatable :: digits
        character(len=12) :: edit
        integer :: precision, exponent, point, stat
        real(wp) :: back

        ! 17 significant digits always suffice.
        do precision = 1, 17
            write (edit, '("(es40.", i0, "e4)")') precision - 1
            write (buffer, edit) abs(value)
            read (buffer, *, iostat=stat) back
            if (stat == 0 .and. .not. (back < abs(value) .or. back > abs(value))) exit
        end do
        buffer = adjustl(buffer)
        point = index(buffer, 'E')
        digits = buffer(1:1)//buffer(3:point - 1)
        read (buffer(point + 1:), *) exponent
        if (exponent >= -4 .and. exponent < 0) then
            text = '0.'//repeat('0', -exponent - 1)//digits
        else if (exponent >= 0 .and. exponent < 15) then
            digits = digits//repeat('0', max(0, exponent + 2 - len(digits)))
            text = digits(:exponent + 1)//'.'//digits(exponent + 2:)
        else
            text = digits(1:1)
            if (len(digits) > 1) text = text//'.'//digits(2:)
            text = text//'e'//integer_to_toml(exponent)
        end if
        if (sign(1.0_wp, value) < 0.0_wp) text = '-'//text
    end function real_to_toml

    !> An integer.
    pure function integer_to_toml(value) result(text)
        integer, intent(in) :: value
        character(len=:), allocatable :: text
        character(len=12) :: buffer

        write (buffer, '(i0)') value
        text = trim(buffer)
    end function integer_to_toml

    !> true or false.
    pure function logical_to_toml(value) result(text)
        logical, intent(in) :: value
        character(len=:), allocatable :: text

        text = trim(merge('true ', 'false', value))
    end function logical_to_toml

    !> A quoted text.
    function string_to_toml(value) result(text)
        character(len=*), intent(in) :: value
        character(len=:), allocatable :: text

        call toml_escape_string(value, text)
    end function string_to_toml

    !> Array of numbers, on several lines if it is long.
    pure function reals_to_toml(values) result(text)
        real(wp), intent(in) :: values(:)
        character(len=:), allocatable :: text
        character(len=:), allocatable :: number
        integer, parameter :: widest = 100
        integer :: i, width

        text = '['
        width = 0
        do i = 1, size(values)
            number = real_to_toml(values(i))
            if (i > 1) text = text//','
            width = width + len(number) + 2
            if (width > widest) then
                text = text//new_line('a')//'   '
                width = len(number) + 6
            end if
            if (i > 1) text = text//' '
            text = text//number
        end do
        text = text//']'
    end function reals_to_toml

    !> Array of quoted texts on one line, without trailing blanks.
    function strings_to_toml(values) result(text)
        character(len=*), intent(in) :: values(:)
        character(len=:), allocatable :: text
        integer :: i

        text = '['
        do i = 1, size(values)
            if (i > 1) text = text//', '
            text = text//string_to_toml(trim(values(i)))
        end do
        text = text//']'
    end function strings_to_toml

    !> Names separated by commas.
    pure function listed(names) result(text)
        !> Names with trailing blanks, which are dropped; may be empty.
        character(len=*), intent(in) :: names(:)
        character(len=:), allocatable :: text
        integer :: i

        text = ''
        do i = 1, size(names)
            if (i > 1) text = text//', '
            text = text//trim(names(i))
        end do
    end function listed
end module tandem_io_scene_text
