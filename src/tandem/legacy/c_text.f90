! SPDX-License-Identifier: MIT
!> Conversion of C strings, terminated by a NUL, to Fortran texts.
module tandem_legacy_c_text
    use, intrinsic :: iso_c_binding, only: c_associated, c_char, c_f_pointer, c_ptr, c_size_t
    implicit none (type, external)
    private

    public :: text_of, value_of

    !> Largest length of names and values. A text without a terminator is truncated to this length.
    integer(c_size_t), parameter :: longest_text = 256
    !> Largest length of a text that contains a list of numbers.
    integer(c_size_t), parameter :: longest_value = 1048576

    interface
        !> strnlen of the C library: length of a text, of which at most `limit` characters are examined.
        pure integer(c_size_t) function strnlen(chars, limit) bind(C)
            import :: c_ptr, c_size_t
            implicit none (type, external)
            type(c_ptr), value :: chars
            integer(c_size_t), value :: limit
        end function strnlen
    end interface

contains

    !> Length of a C text; 0 for NULL.
    pure integer function length_of(chars)
        type(c_ptr), intent(in) :: chars

        length_of = 0
        if (c_associated(chars)) length_of = int(strnlen(chars, longest_text))
    end function length_of

    pure integer function value_length(chars)
        type(c_ptr), intent(in) :: chars

        value_length = 0
        if (c_associated(chars)) value_length = int(strnlen(chars, longest_value))
    end function value_length

    !> A C text that may be long; empty for NULL.
    function value_of(chars) result(text)
        type(c_ptr), intent(in) :: chars
        character(len=value_length(chars)) :: text

        call copy(chars, text)
    end function value_of

    !> A C text; empty for NULL.
    function text_of(chars) result(text)
        type(c_ptr), intent(in) :: chars
        character(len=length_of(chars)) :: text

        call copy(chars, text)
    end function text_of

    !> Copy as many characters as there is space for.
    subroutine copy(chars, text)
        type(c_ptr), intent(in) :: chars
        character(len=*), intent(out) :: text
        character(kind=c_char), pointer :: list(:)
        integer :: i

        if (len(text) == 0) return
        call c_f_pointer(chars, list, [len(text)])
        do i = 1, len(text)
            text(i:i) = list(i)
        end do
    end subroutine copy
end module tandem_legacy_c_text
