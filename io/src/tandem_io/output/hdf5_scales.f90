! SPDX-License-Identifier: MIT
!> Dimension scales: datasets that label the rows or the columns of other datasets. With a scale, readers find the times of rows.
!>
!> Each scale has a list of the datasets that use it. The library rewrites this list for every new user, so that time and file size
!> grow with the square of the number of datasets. Therefore this module writes the attributes of row scales itself, in the
!> library's format, and writes the list only once.
submodule(tandem_io_output_hdf5) tandem_io_output_hdf5_scales
    use hdf5, only: h5aclose_f, h5acreate_f, h5awrite_f, h5dopen_f, h5lexists_f, h5rcreate_f, h5t_compound_f, h5t_native_integer, &
        h5t_std_ref_obj, h5tcreate_f, h5tinsert_f, h5tvlen_create_f, hobj_ref_t_f, size_t
    use, intrinsic :: iso_c_binding, only: c_null_ptr, c_size_t
    implicit none (type, external)

    !> Scales of one dimension; user of a scale, with the dimension that it labels.
    type, bind(c) :: scales_type
        integer(c_size_t) :: n
        type(c_ptr) :: scales
    end type scales_type
    type, bind(c) :: user_type
        integer(c_int64_t) :: dataset
        integer(c_int) :: dimension, unused
    end type user_type

    interface
        !> Turn a dataset into a dimension scale. The C function is called because the Fortran interface needs another library.
        function h5ds_set_scale(dataset, name) result(stat) bind(c, name='H5DSset_scale')
            import :: c_char, c_int, c_int64_t
            implicit none (type, external)
            integer(c_int64_t), value :: dataset
            character(kind=c_char), intent(in) :: name(*)
            integer(c_int) :: stat
        end function h5ds_set_scale

        !> Attach a scale to a dimension of a dataset, counted from 0 in C order.
        function h5ds_attach_scale(dataset, scale, dimension) result(stat) bind(c, name='H5DSattach_scale')
            import :: c_int, c_int64_t
            implicit none (type, external)
            integer(c_int64_t), value :: dataset, scale
            integer(c_int), value :: dimension
            integer(c_int) :: stat
        end function h5ds_attach_scale
    end interface

contains

    module procedure make_scale
        character(kind=c_char) :: letters(len(name) + 1)
        integer :: i, stat

        do i = 1, len(name)
            letters(i) = name(i:i)
        end do
        letters(len(name) + 1) = c_null_char
        stat = int(h5ds_set_scale(int(dataset, c_int64_t), letters))
        call self%check(stat, 'make a scale of '//path)
    end procedure make_scale

    !> Rows are the first dimension in C order.
    module procedure scale_rows
        type(hobj_ref_t_f), target :: reference
        type(scales_type), target :: scales(rank)
        integer(hid_t) :: kind_of_list
        integer :: stat

        if (allocated(self%problem)) return
        call h5rcreate_f(scale, '.', reference, stat)
        scales = scales_type(0_c_size_t, c_null_ptr)
        scales(1) = scales_type(1_c_size_t, c_loc(reference))
        call h5tvlen_create_f(h5t_std_ref_obj, kind_of_list, stat)
        call write_list(self, dataset, path, 'DIMENSION_LIST', kind_of_list, rank, c_loc(scales))
    end procedure scale_rows

    module procedure list_users
        type(hobj_ref_t_f), target :: reference
        type(user_type), allocatable, target :: users(:)
        integer(hid_t) :: kind_of_user
        integer :: i, stat

        if (allocated(self%problem) .or. size(datasets) == 0) return
        allocate (users(size(datasets)))
        do i = 1, size(datasets)
            call h5rcreate_f(datasets(i), '.', reference, stat)
            users(i) = user_type(int(reference%ref, c_int64_t), 0_c_int, 0_c_int)
        end do
        call h5tcreate_f(h5t_compound_f, int(storage_size(users)/8, size_t), kind_of_user, stat)
        call h5tinsert_f(kind_of_user, 'dataset', 0_size_t, h5t_std_ref_obj, stat)
        call h5tinsert_f(kind_of_user, 'dimension', int(storage_size(0_c_int64_t)/8, size_t), h5t_native_integer, stat)
        call write_list(self, scale, path, 'REFERENCE_LIST', kind_of_user, size(users), c_loc(users))
    end procedure list_users

    !> Write an attribute that is a list, and release the type of its entries.
    subroutine write_list(self, dataset, path, name, kind_of_entry, n, entries)
        class(hdf5_type), intent(inout) :: self
        integer(hid_t), intent(in) :: dataset, kind_of_entry
        character(len=*), intent(in) :: path, name
        integer, intent(in) :: n
        type(c_ptr), intent(in) :: entries
        integer(hid_t) :: space, attribute
        integer :: stat

        call h5screate_simple_f(1, [int(n, hsize_t)], space, stat)
        call h5acreate_f(dataset, name, kind_of_entry, space, attribute, stat)
        call self%check(stat, 'attach the time to '//path)
        if (stat == 0) then
            call h5awrite_f(attribute, kind_of_entry, entries, stat)
            call self%check(stat, 'attach the time to '//path)
            call h5aclose_f(attribute, stat)
        end if
        call h5sclose_f(space, stat)
        call h5tclose_f(kind_of_entry, stat)
    end subroutine write_list

    module procedure name_columns
        integer(hid_t) :: other
        integer :: stat
        logical :: exists

        if (allocated(self%problem)) return
        call h5lexists_f(self%file, scale, exists, stat)
        call self%check(stat, 'look for '//scale)
        if (.not. exists) call self%put_strings(scale, names)
        if (allocated(self%problem)) return
        call h5dopen_f(self%file, scale, other, stat)
        call self%check(stat, 'find '//scale)
        if (stat /= 0) return
        if (.not. exists) call self%make_scale(other, scale, 'name')
        stat = int(h5ds_attach_scale(int(dataset, c_int64_t), int(other, c_int64_t), 1_c_int))
        call self%check(stat, 'attach the names to '//path)
        call h5dclose_f(other, stat)
    end procedure name_columns
end submodule tandem_io_output_hdf5_scales
