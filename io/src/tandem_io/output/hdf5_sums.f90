! SPDX-License-Identifier: MIT
!> Contents of a file and their integrity: all objects, and checksums of the rows of datasets.
submodule(tandem_io_output_hdf5) tandem_io_output_hdf5_sums
    use hdf5, only: h5dget_type_f, h5dread_f, h5lexists_f, h5sget_simple_extent_dims_f, h5sget_simple_extent_ndims_f, &
        h5t_string_f, h5tget_class_f, h5tget_size_f, size_t
    implicit none (type, external)

    !> Number of bytes read at once; largest valid number of words in a row.
    integer(long), parameter :: piece = 2_long**20, longest_row = 2_long**24

    interface
        !> Read all contents except rows. Returns the number of unreadable texts; negative after another failure (contents.c).
        function c_read_all(file, sum) result(stat) bind(c, name='tandem_contents_read')
            import :: c_int, c_int64_t
            implicit none (type, external)
            integer(c_int64_t), value :: file
            integer(c_int64_t), intent(out) :: sum
            integer(c_int) :: stat
        end function c_read_all
    end interface

contains

    module procedure has
        integer :: stat

        is_there = .false.
        if (allocated(self%problem)) return
        call h5lexists_f(self%file, path, is_there, stat)
        call self%check(stat, 'find '//path)
        is_there = is_there .and. stat == 0
    end procedure has

    module procedure read_all
        unreadable_texts = 0
        text_checksum = 0
        if (allocated(self%problem)) return
        unreadable_texts = int(c_read_all(int(self%file, c_int64_t), text_checksum))
        call self%check(unreadable_texts, 'read its content')
    end procedure read_all

    module procedure sum_rows
        integer(hid_t) :: dataset, space, text_type
        integer(hsize_t) :: sizes(2), largest(2)
        integer(size_t) :: length
        integer(long) :: at, last, next, words, rows_at_once
        logical :: are_texts
        integer :: rank, class, stat

        all_rows = 0
        call self%open_dataset(path, dataset)
        if (allocated(self%problem)) return
        call h5dget_type_f(dataset, text_type, stat)
        call h5tget_class_f(text_type, class, stat)
        call h5tget_size_f(text_type, length, stat)
        call h5tclose_f(text_type, stat)
        are_texts = class == h5t_string_f
        call h5dget_space_f(dataset, space, stat)
        call h5sget_simple_extent_ndims_f(space, rank, stat)
        sizes = 1
        if (rank == 1 .or. rank == 2) then
            call h5sget_simple_extent_dims_f(space, sizes(3 - rank:), largest(3 - rank:), stat)
            all_rows = int(sizes(2), long)
        else
            call self%check(-1, 'read '//path)
        end if
        call h5sclose_f(space, stat)
        words = int(sizes(1), long)
        if (are_texts) words = words*((int(length, long) + 7)/8)
        if (words > longest_row) call self%check(-1, 'read '//path)
        last = min(rows, all_rows)
        rows_at_once = max(1_long, piece/max(8*words, 8_long))
        at = 0
        do while (at < last .and. .not. allocated(self%problem))
            next = min(at + rows_at_once, last)
            ! The first part must end at the last row of the first checksum.
            if (at < early_rows) next = min(next, early_rows)
            call add_piece(self, dataset, path, rank, [sizes(1), int(next - at, hsize_t)], at, merge(int(length), 0, are_texts), &
                sum)
            at = next
            if (at == early_rows) early = sum
        end do
        if (early_rows >= last) early = sum
        call h5dclose_f(dataset, stat)
    end procedure sum_rows

    !> Add rows of a dataset to a checksum: numbers as 8-byte reals, texts padded with blanks to whole words.
    subroutine add_piece(self, dataset, path, rank, block, before, length, sum)
        class(hdf5_type), intent(inout) :: self
        integer(hid_t), intent(in) :: dataset
        character(len=*), intent(in) :: path
        integer, intent(in) :: rank
        !> Numbers per row, and number of rows.
        integer(hsize_t), intent(in) :: block(2)
        !> Number of preceding rows.
        integer(long), intent(in) :: before
        !> Length of a text; 0 for numbers.
        integer, intent(in) :: length
        type(fletcher_type), intent(inout) :: sum
        real(wp), target :: values(merge(1_hsize_t, block(1), length > 0), block(2))
        character(kind=c_char), target :: letters(length, block(2))
        type(c_ptr) :: buffer
        integer(hid_t) :: file_space, memory_space, memory_type
        integer :: first, stat, i

        first = 3 - rank
        call h5dget_space_f(dataset, file_space, stat)
        associate (start => [0_hsize_t, int(before, hsize_t)])
            call h5sselect_hyperslab_f(file_space, h5s_select_set_f, start(first:), block(first:), stat)
        end associate
        call h5screate_simple_f(rank, block(first:), memory_space, stat)
        if (length > 0) then
            call make_fixed_type(length, memory_type)
            buffer = c_loc(letters)
            call h5dread_f(dataset, memory_type, buffer, stat, memory_space, file_space)
            call self%check(stat, 'read '//path)
            call h5tclose_f(memory_type, stat)
        else
            buffer = c_loc(values)
            call h5dread_f(dataset, h5t_native_double, buffer, stat, memory_space, file_space)
            call self%check(stat, 'read '//path)
        end if
        call h5sclose_f(memory_space, stat)
        call h5sclose_f(file_space, stat)
        if (allocated(self%problem)) return
        do i = 1, size(values, 2)
            if (length > 0) then
                call sum%add(words_of(letters(:, i)))
            else
                call sum%add(values(:, i))
            end if
        end do
    end subroutine add_piece

    !> Letters as 64-bit words, padded with blanks.
    pure function words_of(letters) result(words)
        character(kind=c_char), intent(in) :: letters(:)
        integer(long) :: words((size(letters) + 7)/8)
        character(kind=c_char) :: padded(8*size(words))

        padded = ' '
        padded(:size(letters)) = letters
        words = transfer(padded, words)
    end function words_of
end submodule tandem_io_output_hdf5_sums
