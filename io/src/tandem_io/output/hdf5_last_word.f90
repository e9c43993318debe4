! SPDX-License-Identifier: MIT
!> Replacement of a text in a file that accepts no more data.
submodule(tandem_io_output_hdf5) tandem_io_output_hdf5_last_word
    use hdf5, only: h5aclose_f, h5aopen_by_name_f, h5awrite_f, h5fget_filesize_f
    use tandem_io_output_hdf5_texts, only: make_text_type, read_text, set_letters
    implicit none (type, external)

contains

    !> Replace a text of the root after a failed write, provided that it needs no new space. Data that HDF5 still buffers must not
    !> be written: the new access properties have a separate driver, so that HDF5 treats the file as another one and reads it from
    !> the disk. HDF5 stores texts in collections with some free space, which it uses after reading a text of the collection. If the
    !> free space is too small, the file is left unchanged.
    module procedure replace_text
        character(len=:), allocatable :: old
        character(kind=c_char), allocatable, target :: letters(:)
        type(c_ptr), target :: start(1)
        integer(hid_t) :: access, file, attribute, text_type
        integer(c_int64_t) :: driver, size
        integer(hsize_t) :: new_size
        integer :: stat, ignored

        ! A file truncated by another process is left unchanged: it must not look like a valid result.
        if (.not. (self%guard%still_exists() .and. self%guard%is_whole())) return
        call self%guard%lock(path)
        ! Data must not be written after the end stated in the superblock (see `open_to_append`), and the file must not be truncated
        ! when it is closed.
        inquire (file=path, size=size)
        call self%guard%repair(size)
        call make_access(access, .true., driver, 0)
        call h5fopen_f(path, h5f_acc_rdwr_f, file, stat, access_prp=access)
        call h5pclose_f(access, ignored)
        if (stat == 0) call h5aopen_by_name_f(file, '/', name, attribute, stat)
        if (stat == 0) then
            call read_text(attribute, old, ignored)
            call set_letters([value], letters, start)
            call make_text_type(text_type)
            call h5awrite_f(attribute, text_type, c_loc(start), stat)
            call h5tclose_f(text_type, ignored)
        end if
        if (stat == 0) call h5fget_filesize_f(file, new_size, stat)
        ! A file that has grown is not closed: the change then never reaches the disk.
        if (stat == 0 .and. new_size == size) then
            call h5aclose_f(attribute, stat)
            call h5fclose_f(file, stat)
            if (stat == 0) call release_driver(driver)
        end if
    end procedure replace_text
end submodule tandem_io_output_hdf5_last_word
