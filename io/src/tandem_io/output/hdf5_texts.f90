! SPDX-License-Identifier: MIT
!> Texts in HDF5: types of variable and of fixed length, and conversion to C strings.
module tandem_io_output_hdf5_texts
    use hdf5, only: h5aget_space_f, h5aread_f, h5dvlen_reclaim_f, h5p_default_f, h5sclose_f, h5t_cset_utf8_f, h5t_fortran_s1, &
        h5t_string, h5tclose_f, h5tcopy_f, h5tset_cset_f, h5tset_size_f, hid_t, size_t
    use, intrinsic :: iso_c_binding, only: c_associated, c_char, c_f_pointer, c_loc, c_null_char, c_null_ptr, c_ptr, c_size_t
    implicit none (type, external)
    private

    public :: make_text_type, make_fixed_type, set_letters, read_text

    interface
        function c_length(text) result(length) bind(c, name='strlen')
            import :: c_ptr, c_size_t
            implicit none (type, external)
            type(c_ptr), value :: text
            integer(c_size_t) :: length
        end function c_length
    end interface

contains

    !> Create the type of texts of variable length in UTF-8.
    subroutine make_text_type(text_type)
        integer(hid_t), intent(out) :: text_type
        integer :: stat

        call h5tcopy_f(h5t_string, text_type, stat)
        call h5tset_cset_f(text_type, h5t_cset_utf8_f, stat)
    end subroutine make_text_type

    !> Create the type of texts of fixed length in UTF-8, as in Fortran. Only such texts can be appended.
    subroutine make_fixed_type(length, text_type)
        integer, intent(in) :: length
        integer(hid_t), intent(out) :: text_type
        integer :: stat

        call h5tcopy_f(h5t_fortran_s1, text_type, stat)
        call h5tset_size_f(text_type, int(length, size_t), stat)
        call h5tset_cset_f(text_type, h5t_cset_utf8_f, stat)
    end subroutine make_fixed_type

    !> Convert texts to C strings: letters terminated by null, and a pointer to each string.
    subroutine set_letters(values, letters, starts)
        character(len=*), intent(in) :: values(:)
        character(kind=c_char), allocatable, target, intent(out) :: letters(:)
        type(c_ptr), intent(out) :: starts(:)
        integer :: i, j, at

        allocate (letters(sum(len_trim(values) + 1)))
        at = 0
        do i = 1, size(values)
            starts(i) = c_loc(letters(at + 1))
            do j = 1, len_trim(values(i))
                letters(at + j) = values(i) (j:j)
            end do
            at = at + len_trim(values(i)) + 1
            letters(at) = c_null_char
        end do
    end subroutine set_letters

    !> Read a text attribute of variable length.
    subroutine read_text(attribute, value, stat)
        integer(hid_t), intent(in) :: attribute
        character(len=:), allocatable, intent(out) :: value
        !> 0 on success.
        integer, intent(out) :: stat
        character(kind=c_char), pointer :: letters(:)
        type(c_ptr), target :: start(1)
        type(c_ptr) :: buffer
        integer(hid_t) :: text_type, space
        integer :: length, i, ignored

        length = 0
        start = c_null_ptr
        buffer = c_loc(start)
        call make_text_type(text_type)
        call h5aread_f(attribute, text_type, buffer, stat)
        if (c_associated(start(1))) length = int(c_length(start(1)))
        allocate (character(len=length) :: value)
        if (length > 0) then
            call c_f_pointer(start(1), letters, [length])
            do i = 1, length
                value(i:i) = letters(i)
            end do
        end if
        if (c_associated(start(1))) then
            call h5aget_space_f(attribute, space, ignored)
            call h5dvlen_reclaim_f(text_type, space, h5p_default_f, buffer, ignored)
            call h5sclose_f(space, ignored)
        end if
        call h5tclose_f(text_type, ignored)
    end subroutine read_text
end module tandem_io_output_hdf5_texts
