! SPDX-License-Identifier: MIT
!> Attributes of the objects of a file: numbers and texts.
submodule(tandem_io_output_hdf5) tandem_io_output_hdf5_attributes
    use hdf5, only: h5_index_name_f, h5_integer_kind, h5_iter_inc_f, h5aclose_f, h5acreate_f, h5adelete_by_idx_f, h5adelete_f, &
        h5aexists_f, h5aget_name_by_idx_f, h5aget_num_attrs_f, h5aopen_by_name_f, h5aopen_f, h5aread_f, h5awrite_f, &
        h5kind_to_type, h5oclose_f, h5oopen_f, h5s_scalar_f, h5screate_f
    use tandem_io_output_hdf5_texts, only: make_text_type, read_text, set_letters
    implicit none (type, external)

contains

    module procedure attach_integer
        integer(long), target :: copy

        copy = value
        if (allocated(self%problem)) return
        call attach_value(self, path, name, h5t_std_i64le, h5kind_to_type(long, h5_integer_kind), c_loc(copy), -1)
    end procedure attach_integer

    module procedure attach_real
        real(wp), target :: copy

        copy = value
        call attach_value(self, path, name, h5t_ieee_f64le, h5t_native_double, c_loc(copy), -1)
    end procedure attach_real

    module procedure attach_string
        call attach_texts(self, path, name, [value], -1)
    end procedure attach_string

    module procedure attach_strings
        call attach_texts(self, path, name, values, size(values))
    end procedure attach_strings

    !> Write texts of variable length in UTF-8, which Python reads as str.
    subroutine attach_texts(self, path, name, values, length)
        class(hdf5_type), intent(inout) :: self
        character(len=*), intent(in) :: path, name, values(:)
        !> Length of the array; -1 for a single text.
        integer, intent(in) :: length
        character(kind=c_char), allocatable, target :: letters(:)
        character(len=:), allocatable :: old
        type(c_ptr), target :: starts(size(values))
        integer(hid_t) :: text_type
        integer :: stat

        if (allocated(self%problem)) return
        ! HDF5 can reuse the space of the old text only after reading it.
        if (length < 0) call self%get_text(path, name, old)
        call set_letters(values, letters, starts)
        call make_text_type(text_type)
        call attach_value(self, path, name, text_type, text_type, c_loc(starts), length)
        call h5tclose_f(text_type, stat)
    end subroutine attach_texts

    !> Write an attribute. A scalar overwrites an existing one; an array is created again, because its length may differ.
    subroutine attach_value(self, path, name, file_type, memory_type, values, length)
        class(hdf5_type), intent(inout) :: self
        character(len=*), intent(in) :: path, name
        integer(hid_t), intent(in) :: file_type, memory_type
        type(c_ptr), intent(in) :: values
        !> Length of an array; -1 for a scalar.
        integer, intent(in) :: length
        integer(hid_t) :: object, attribute
        logical :: exists
        integer :: stat, ignored

        if (allocated(self%problem)) return
        call h5oopen_f(self%file, path, object, stat)
        call self%check(stat, 'open '//path)
        if (stat /= 0) return
        call h5aexists_f(object, name, exists, stat)
        if (exists .and. length >= 0) then
            call h5adelete_f(object, name, stat)
            exists = .false.
        end if
        if (exists) then
            call h5aopen_f(object, name, attribute, stat)
        else
            call make_attribute(object, name, file_type, length, attribute, stat)
        end if
        call self%check(stat, 'make the attribute '//name//' of '//path)
        if (stat == 0) then
            call h5awrite_f(attribute, memory_type, values, stat)
            call h5aclose_f(attribute, ignored)
            if (stat /= 0 .and. exists) then
                ! HDF5 1.14 does not overwrite unreadable texts.
                call h5adelete_f(object, name, ignored)
                call make_attribute(object, name, file_type, length, attribute, stat)
                if (stat == 0) call h5awrite_f(attribute, memory_type, values, stat)
                call h5aclose_f(attribute, ignored)
            end if
            call self%check(stat, 'write the attribute '//name//' of '//path)
        end if
        call h5oclose_f(object, stat)
    end subroutine attach_value

    !> Create an attribute and leave it open.
    subroutine make_attribute(object, name, file_type, length, attribute, stat)
        integer(hid_t), intent(in) :: object, file_type
        character(len=*), intent(in) :: name
        !> Length of an array; -1 for a scalar.
        integer, intent(in) :: length
        integer(hid_t), intent(out) :: attribute
        !> Status returned by HDF5.
        integer, intent(out) :: stat
        integer(hid_t) :: space
        integer :: ignored

        if (length < 0) then
            call h5screate_f(h5s_scalar_f, space, stat)
        else
            call h5screate_simple_f(1, [int(length, hsize_t)], space, stat)
        end if
        call h5acreate_f(object, name, file_type, space, attribute, stat)
        call h5sclose_f(space, ignored)
    end subroutine make_attribute

    !> The space is occupied by an attribute that is deleted afterwards. HDF5 reuses the space of a deleted attribute as long as
    !> another attribute follows it.
    module procedure reserve
        character(len=*), parameter :: name = 'room'
        integer(hid_t) :: object, attribute
        integer :: stat

        if (allocated(self%problem)) return
        call h5oopen_f(self%file, path, object, stat)
        call make_attribute(object, name, h5t_std_i64le, bytes/8, attribute, stat)
        call self%check(stat, 'reserve space for attributes of '//path)
        if (stat == 0) then
            call h5aclose_f(attribute, stat)
            call self%attach(path, 'meaning', meaning)
            call h5adelete_f(object, name, stat)
        end if
        call h5oclose_f(object, stat)
    end procedure reserve

    !> Reserve space for a text of some hundred letters, so that it can be written on a full disk. HDF5 stores texts in collections
    !> of 4 kB, which may grow, and does not remove old texts. Each of the five texts written here takes a quarter of a collection:
    !> after the last one, a collection has enough free space, unless the free space at the beginning happened to fit all five
    !> exactly.
    module procedure reserve_text
        integer, parameter :: times = 5, length = 1024
        integer :: i

        do i = 1, times
            call self%attach(path, name, repeat('.', length))
        end do
        call self%attach(path, name, '')
    end procedure reserve_text

    module procedure detach_all
        character(len=len('meaning') + 1) :: name
        integer(hid_t) :: object
        integer(hsize_t) :: kept
        integer :: i, n, stat

        if (allocated(self%problem)) return
        call h5oopen_f(self%file, path, object, stat)
        call self%check(stat, 'open '//path)
        if (stat /= 0) return
        call h5aget_num_attrs_f(object, n, stat)
        kept = 0
        do i = 1, n
            call h5aget_name_by_idx_f(object, '.', h5_index_name_f, h5_iter_inc_f, kept, name, stat)
            if (name == 'meaning') then
                kept = kept + 1
            else
                call h5adelete_by_idx_f(object, '.', h5_index_name_f, h5_iter_inc_f, kept, stat)
            end if
            call self%check(stat, 'remove the attributes of '//path)
        end do
        call h5oclose_f(object, stat)
    end procedure detach_all

    module procedure get_attribute
        integer(hid_t) :: attribute
        type(c_ptr) :: start
        integer :: stat

        value = 0
        is_there = .false.
        if (allocated(self%problem)) return
        start = c_loc(value)
        call h5aopen_by_name_f(self%file, path, name, attribute, stat)
        if (stat /= 0) return
        call h5aread_f(attribute, h5kind_to_type(long, h5_integer_kind), start, stat)
        is_there = stat == 0
        call h5aclose_f(attribute, stat)
    end procedure get_attribute

    module procedure get_text
        integer(hid_t) :: attribute
        integer :: stat

        value = ''
        if (allocated(self%problem)) return
        call h5aopen_by_name_f(self%file, path, name, attribute, stat)
        if (stat /= 0) return
        call read_text(attribute, value, stat)
        if (stat /= 0) value = ''
        call h5aclose_f(attribute, stat)
    end procedure get_text
end submodule tandem_io_output_hdf5_attributes
