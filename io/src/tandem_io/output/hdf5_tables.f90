! SPDX-License-Identifier: MIT
!> Datasets that are written or read in a single call.
submodule(tandem_io_output_hdf5) tandem_io_output_hdf5_tables
    use hdf5, only: h5_integer_kind, h5dopen_f, h5dread_f, h5f_acc_rdonly_f, h5kind_to_type, h5lcreate_hard_f, h5lexists_f, &
        h5sget_simple_extent_dims_f, h5sget_simple_extent_ndims_f, h5sget_simple_extent_npoints_f
    use tandem_io_output_hdf5_texts, only: make_text_type, set_letters
    implicit none (type, external)

contains

    module procedure put_integers
        integer(long), target :: copy(size(values))

        copy = values
        call put_values(self, path, h5t_std_i64le, h5kind_to_type(long, h5_integer_kind), c_loc(copy), [size(values)])
    end procedure put_integers

    module procedure put_reals
        real(wp), target :: copy(size(values))

        copy = values
        call put_values(self, path, h5t_ieee_f64le, h5t_native_double, c_loc(copy), [size(values)])
    end procedure put_reals

    module procedure put_matrix
        real(wp), target :: copy(size(values, 2), size(values, 1))
        integer :: stat
        logical :: exists

        if (allocated(self%problem)) return
        copy = transpose(values)
        call h5lexists_f(self%file, path, exists, stat)
        if (exists) then
            call replace_reals(self, path, copy)
        else
            call put_values(self, path, h5t_ieee_f64le, h5t_native_double, c_loc(copy), shape(copy))
        end if
    end procedure put_matrix

    !> Replace all values of a dataset.
    subroutine replace_reals(self, path, values)
        class(hdf5_type), intent(inout) :: self
        character(len=*), intent(in) :: path
        real(wp), intent(in), target, contiguous :: values(:, :)
        integer(hid_t) :: dataset, space
        integer(hsize_t) :: n
        integer :: stat

        call h5dopen_f(self%file, path, dataset, stat)
        call self%check(stat, 'find '//path)
        if (stat /= 0) return
        call h5dget_space_f(dataset, space, stat)
        call h5sget_simple_extent_npoints_f(space, n, stat)
        call h5sclose_f(space, stat)
        if (n == size(values)) then
            call h5dwrite_f(dataset, h5t_native_double, c_loc(values), stat)
            call self%check(stat, 'write '//path)
        else
            self%problem = path//' has another size'
        end if
        call h5dclose_f(dataset, stat)
    end subroutine replace_reals

    module procedure put_strings
        character(kind=c_char), allocatable, target :: letters(:)
        type(c_ptr), target :: starts(size(values))
        integer(hid_t) :: text_type
        integer :: stat

        call set_letters(values, letters, starts)
        call make_text_type(text_type)
        call put_values(self, path, text_type, text_type, c_loc(starts), [size(values)])
        call h5tclose_f(text_type, stat)
    end procedure put_strings

    !> Create a dataset with all its values.
    subroutine put_values(self, path, file_type, memory_type, values, sizes)
        class(hdf5_type), intent(inout) :: self
        character(len=*), intent(in) :: path
        integer(hid_t), intent(in) :: file_type, memory_type
        type(c_ptr), intent(in) :: values
        !> Sizes of the dimensions, in Fortran order.
        integer, intent(in) :: sizes(:)
        integer(hid_t) :: space, dataset
        integer :: stat

        if (allocated(self%problem)) return
        call h5screate_simple_f(size(sizes), int(sizes, hsize_t), space, stat)
        call h5dcreate_f(self%file, path, file_type, space, dataset, stat)
        call self%check(stat, 'make '//path)
        if (stat == 0) then
            if (all(sizes > 0)) call h5dwrite_f(dataset, memory_type, values, stat)
            call self%check(stat, 'write '//path)
            call h5dclose_f(dataset, stat)
        end if
        call h5sclose_f(space, stat)
    end subroutine put_values

    module procedure link
        integer :: stat
        logical :: exists

        if (allocated(self%problem)) return
        call h5lexists_f(self%file, second, exists, stat)
        if (exists) return
        call h5lcreate_hard_f(self%file, path, self%file, second, stat)
        call self%check(stat, 'make '//second)
    end procedure link

    module procedure open_to_read
        integer(hid_t) :: access
        integer :: stat

        call start_library(stat)
        call self%check(stat, 'start HDF5')
        if (allocated(self%problem)) return
        call make_reading_access(access, self%driver)
        call h5fopen_f(path, h5f_acc_rdonly_f, self%file, stat, access_prp=access)
        call self%check(stat, 'open '//path)
        if (stat /= 0) self%file = -1_hid_t
        call h5pclose_f(access, stat)
    end procedure open_to_read

    module procedure get
        integer(hid_t) :: dataset, space
        integer(hsize_t) :: sizes(2), largest(2)
        type(c_ptr) :: buffer
        integer :: stat, rank

        if (allocated(self%problem)) return
        call h5dopen_f(self%file, path, dataset, stat)
        call self%check(stat, 'find '//path)
        if (stat /= 0) return
        call h5dget_space_f(dataset, space, stat)
        call h5sget_simple_extent_ndims_f(space, rank, stat)
        if (rank == 1 .or. rank == 2) then
            sizes = 1
            call h5sget_simple_extent_dims_f(space, sizes(3 - rank:), largest(3 - rank:), stat)
            allocate (values(sizes(1), sizes(2)))
            stat = 0
            buffer = c_loc(values)
            if (size(values) > 0) call h5dread_f(dataset, h5t_native_double, buffer, stat)
        else
            stat = -1
        end if
        call self%check(stat, 'read '//path)
        if (stat /= 0 .and. allocated(values)) deallocate (values)
        call h5sclose_f(space, stat)
        call h5dclose_f(dataset, stat)
    end procedure get
end submodule tandem_io_output_hdf5_tables
