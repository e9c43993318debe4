! SPDX-License-Identifier: MIT
!> HDF5 operations of a resumed run: opening the existing file, removing rows, and arrays of integers that are not rows.
submodule(tandem_io_output_hdf5) tandem_io_output_hdf5_resuming
    use hdf5, only: h5_integer_kind, h5dopen_f, h5dread_f, h5kind_to_type, h5ldelete_f, h5lexists_f, &
        h5sget_simple_extent_dims_f, h5sget_simple_extent_ndims_f
    implicit none (type, external)

contains

    module procedure open_to_append
        !> Space for the data before the first row and for some rows, bytes.
        integer(c_int64_t), parameter :: room = 2**19
        integer(hid_t) :: access
        integer(c_int64_t) :: size
        integer :: stat

        call start_library(stat)
        call self%check(stat, 'start HDF5')
        if (allocated(self%problem)) return
        ! Indices may refer to data that a killed writer has written after the end stated in the superblock: this part must not be
        ! overwritten.
        inquire (file=path, size=size)
        call self%guard%lock(path)
        ! On a full disk the file is left unchanged.
        call clear_reason()
        if (.not. self%guard%has_room(room)) then
            call self%check(-1, 'make '//path//' larger')
            return
        end if
        call self%guard%repair(size)
        self%datasets = datasets
        call make_access(access, .true., self%driver, self%datasets)
        call clear_reason()
        call h5fopen_f(path, h5f_acc_rdwr_f, self%file, stat, access_prp=access)
        call self%check(stat, 'open '//path)
        if (stat /= 0) self%file = -1_hid_t
        call h5pclose_f(access, stat)
    end procedure open_to_append

    module procedure open_dataset
        integer :: stat

        dataset = -1_hid_t
        if (allocated(self%problem)) return
        call h5dopen_f(self%file, path, dataset, stat)
        call self%check(stat, 'find '//path)
        if (stat /= 0) dataset = -1_hid_t
    end procedure open_dataset

    module procedure rows_of
        integer(hsize_t) :: sizes(2), largest(2)
        integer(hid_t) :: space
        integer :: rank, stat

        rows = 0
        if (allocated(self%problem)) return
        call h5dget_space_f(dataset, space, stat)
        call h5sget_simple_extent_ndims_f(space, rank, stat)
        if (rank == 1 .or. rank == 2) then
            call h5sget_simple_extent_dims_f(space, sizes(3 - rank:), largest(3 - rank:), stat)
            rows = int(sizes(2), long)
        end if
        call h5sclose_f(space, stat)
    end procedure rows_of

    module procedure add_words
        integer(hid_t) :: space, properties
        integer :: stat

        dataset = -1_hid_t
        if (allocated(self%problem)) return
        call h5screate_simple_f(1, [0_hsize_t], space, stat, [h5s_unlimited_f])
        call h5pcreate_f(h5p_dataset_create_f, properties, stat)
        call h5pset_chunk_f(properties, 1, [int(chunk, hsize_t)], stat)
        call h5dcreate_f(self%file, path, h5t_std_i64le, space, dataset, stat, properties)
        call self%check(stat, 'make '//path)
        call h5pclose_f(properties, stat)
        call h5sclose_f(space, stat)
    end procedure add_words

    module procedure write_words
        integer(hid_t) :: file_space, memory_space
        integer(long) :: length
        integer :: stat

        length = max(self%rows_of(dataset), size(words, kind=long))
        if (allocated(self%problem)) return
        call clear_reason()
        call h5dset_extent_f(dataset, [int(length, hsize_t)], stat)
        call self%check(stat, 'extend '//path)
        call h5dget_space_f(dataset, file_space, stat)
        associate (block => [size(words, kind=hsize_t)])
            call h5sselect_hyperslab_f(file_space, h5s_select_set_f, [0_hsize_t], block, stat)
            call h5screate_simple_f(1, block, memory_space, stat)
        end associate
        call h5dwrite_f(dataset, h5kind_to_type(long, h5_integer_kind), c_loc(words), stat, memory_space, file_space)
        call self%check(stat, 'write '//path)
        call h5sclose_f(memory_space, stat)
        call h5sclose_f(file_space, stat)
    end procedure write_words

    module procedure get_words
        integer(hid_t) :: dataset
        type(c_ptr) :: start
        integer :: stat

        call self%open_dataset(path, dataset)
        allocate (words(self%rows_of(dataset)))
        if (allocated(self%problem)) return
        start = c_loc(words)
        stat = 0
        if (size(words) > 0) call h5dread_f(dataset, h5kind_to_type(long, h5_integer_kind), start, stat)
        call self%check(stat, 'read '//path)
        call h5dclose_f(dataset, stat)
    end procedure get_words

    module procedure cut
        integer :: stat

        if (allocated(self%problem)) return
        associate (sizes => [int(width, hsize_t), int(rows, hsize_t)], first => merge(2, 1, width == 0))
            call h5dset_extent_f(dataset, sizes(first:), stat)
        end associate
        call self%check(stat, 'cut '//path)
    end procedure cut

    module procedure remove
        logical :: exists
        integer :: stat

        if (allocated(self%problem)) return
        call h5lexists_f(self%file, path, exists, stat)
        if (exists) call h5ldelete_f(self%file, path, stat)
        call self%check(stat, 'remove '//path)
    end procedure remove
end submodule tandem_io_output_hdf5_resuming
