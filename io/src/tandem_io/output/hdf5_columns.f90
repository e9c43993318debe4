! SPDX-License-Identifier: MIT
!> Datasets of known size that are written in blocks of rows, for tables too large for memory.
submodule(tandem_io_output_hdf5) tandem_io_output_hdf5_columns
    implicit none (type, external)

    interface
        !> Enable or disable the recording of creation times of objects.
        function h5p_set_obj_track_times(properties, tracks) result(stat) bind(c, name='H5Pset_obj_track_times')
            use, intrinsic :: iso_c_binding, only: c_bool, c_int, c_int64_t
            implicit none (type, external)
            integer(c_int64_t), value :: properties
            logical(c_bool), value :: tracks
            integer(c_int) :: stat
        end function h5p_set_obj_track_times
    end interface

contains

    module procedure add_column
        use, intrinsic :: iso_c_binding, only: c_bool
        integer(hid_t) :: space, properties
        integer :: stat, rank

        dataset = -1_hid_t
        if (allocated(self%problem)) return
        rank = merge(1, 2, width == 0)
        associate (sizes => [int(width, hsize_t), int(rows, hsize_t)])
            call h5screate_simple_f(rank, sizes(3 - rank:), space, stat)
        end associate
        call self%check(stat, 'make '//path)
        if (stat /= 0) return
        call h5pcreate_f(h5p_dataset_create_f, properties, stat)
        stat = int(h5p_set_obj_track_times(int(properties, c_int64_t), .false._c_bool))
        call h5dcreate_f(self%file, path, merge(h5t_std_i64le, h5t_ieee_f64le, counts), space, dataset, stat, properties)
        call self%check(stat, 'make '//path)
        call h5pclose_f(properties, stat)
        call h5sclose_f(space, stat)
    end procedure add_column

    module procedure fill_column
        integer(hid_t) :: file_space, memory_space
        type(c_ptr) :: data
        integer :: stat, rank

        if (allocated(self%problem) .or. size(values) == 0) return
        call clear_reason()
        rank = merge(1, 2, width == 0)
        associate (start => [0_hsize_t, int(before, hsize_t)], &
            block => [int(width, hsize_t), size(values, 2, kind=hsize_t)], first => 3 - rank)
            call h5dget_space_f(dataset, file_space, stat)
            call self%check(stat, 'write '//path)
            if (stat /= 0) return
            call h5sselect_hyperslab_f(file_space, h5s_select_set_f, start(first:), block(first:), stat)
            call h5screate_simple_f(rank, block(first:), memory_space, stat)
        end associate
        data = c_loc(values)
        call h5dwrite_f(dataset, h5t_native_double, data, stat, memory_space, file_space)
        call self%check(stat, 'write '//path)
        call h5sclose_f(memory_space, stat)
        call h5sclose_f(file_space, stat)
    end procedure fill_column
end submodule tandem_io_output_hdf5_columns
