! SPDX-License-Identifier: MIT
!> Datasets that grow by rows.
submodule(tandem_io_output_hdf5) tandem_io_output_hdf5_rows
    use hdf5, only: h5t_str_nullpad_f, h5tset_strpad_f
    implicit none (type, external)

contains

    module procedure add_dataset
        integer(hid_t) :: space, properties, stored
        integer :: stat, rank

        dataset = -1_hid_t
        if (allocated(self%problem)) return
        rank = merge(1, 2, width == 0)
        associate (sizes => [int(width, hsize_t), 0_hsize_t], largest => [int(width, hsize_t), h5s_unlimited_f], &
            chunks => [int(width, hsize_t), int(chunk, hsize_t)], first => 3 - rank)
            call h5screate_simple_f(rank, sizes(first:), space, stat, largest(first:))
            call self%check(stat, 'make '//path)
            call h5pcreate_f(h5p_dataset_create_f, properties, stat)
            call h5pset_chunk_f(properties, rank, chunks(first:), stat)
            call self%check(stat, 'make '//path)
        end associate
        if (allocated(self%problem)) return
        stored = merge(h5t_std_i64le, h5t_ieee_f64le, counts)
        if (present(texts)) then
            call make_fixed_type(texts, stored)
            call h5tset_strpad_f(stored, h5t_str_nullpad_f, stat)
        end if
        call h5dcreate_f(self%file, path, stored, space, dataset, stat, properties)
        call self%check(stat, 'make '//path)
        if (present(texts)) call h5tclose_f(stored, stat)
        call h5pclose_f(properties, stat)
        call h5sclose_f(space, stat)
        if (allocated(self%problem)) return
        if (present(scale)) then
            call self%scale_rows(dataset, path, rank, scale)
        else
            call self%make_scale(dataset, path, 'time')
        end if
    end procedure add_dataset

    module procedure append
        call append_values(self, dataset, path, width, before, rows, h5t_native_double, c_loc(values))
    end procedure append

    module procedure append_texts
        character(kind=c_char), target :: letters(len(values), size(values))
        integer(hid_t) :: text_type
        integer :: i, j, stat

        if (allocated(self%problem) .or. size(values) == 0) return
        do i = 1, size(values)
            do j = 1, len(values)
                letters(j, i) = values(i) (j:j)
            end do
        end do
        call make_fixed_type(len(values), text_type)
        call append_values(self, dataset, path, 0, before, size(values), text_type, c_loc(letters))
        call h5tclose_f(text_type, stat)
    end procedure append_texts

    !> Append rows of any type.
    subroutine append_values(self, dataset, path, width, before, rows, memory_type, values)
        class(hdf5_type), intent(inout) :: self
        integer(hid_t), intent(in) :: dataset, memory_type
        character(len=*), intent(in) :: path
        integer, intent(in) :: width, rows
        integer(long), intent(in) :: before
        type(c_ptr), intent(in) :: values
        integer(hid_t) :: file_space, memory_space
        integer :: stat, rank

        if (allocated(self%problem) .or. rows == 0) return
        call clear_reason()
        rank = merge(1, 2, width == 0)
        associate (sizes => [int(width, hsize_t), int(before + rows, hsize_t)], start => [0_hsize_t, int(before, hsize_t)], &
            block => [int(width, hsize_t), int(rows, hsize_t)], first => 3 - rank)
            call h5dset_extent_f(dataset, sizes(first:), stat)
            call self%check(stat, 'extend '//path)
            call h5dget_space_f(dataset, file_space, stat)
            call self%check(stat, 'extend '//path)
            if (allocated(self%problem)) return
            call h5sselect_hyperslab_f(file_space, h5s_select_set_f, start(first:), block(first:), stat)
            call h5screate_simple_f(rank, block(first:), memory_space, stat)
        end associate
        call h5dwrite_f(dataset, memory_type, values, stat, memory_space, file_space)
        call self%check(stat, 'write '//path)
        call h5sclose_f(memory_space, stat)
        call h5sclose_f(file_space, stat)
    end subroutine append_values
end submodule tandem_io_output_hdf5_rows
