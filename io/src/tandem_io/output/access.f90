! SPDX-License-Identifier: MIT
!> Access properties of HDF5 for a file that must stay consistent however the program ends: the mode "single writer, multiple
!> readers" (SWMR).
module tandem_io_output_access
    use hdf5, only: h5f_libver_v110_f, h5p_file_access_f, h5pclose_f, h5pcreate_f, h5pset_alignment_f, h5pset_cache_f, &
        h5pset_libver_bounds_f, h5pset_meta_block_size_f, h5pset_small_data_block_size_f, hid_t, hsize_t, size_t
    use, intrinsic :: iso_c_binding, only: c_bool, c_int, c_int64_t
    implicit none (type, external)
    private

    public :: make_access, make_reading_access, release_driver, start_swmr, end_of, ignore_small_gaps, release_metadata, &
        many_datasets

    !> Alignment of metadata, bytes.
    integer(hsize_t), parameter :: slot = 1024
    !> Number of datasets above which the settings for many datasets are used.
    integer, parameter :: many_datasets = 250

    interface
        !> From now on, write metadata in an order that keeps the file consistent at every moment.
        function h5f_start_swmr_write(file) result(stat) bind(c, name='H5Fstart_swmr_write')
            import :: c_int, c_int64_t
            implicit none (type, external)
            integer(c_int64_t), value :: file
            integer(c_int) :: stat
        end function h5f_start_swmr_write

        !> End of the last allocated block of the file.
        function h5f_get_eoa(file, address) result(stat) bind(c, name='H5Fget_eoa')
            import :: c_int, c_int64_t
            implicit none (type, external)
            integer(c_int64_t), value :: file
            integer(c_int64_t), intent(out) :: address
            integer(c_int) :: stat
        end function h5f_get_eoa

        !> Select the driver of driver.c, which omits HDF5's mark "open for writing" and never lets the file be shorter than its
        !> superblock states. Returns the number of the driver; negative after a failure.
        function set_driver(access) result(driver) bind(c, name='tandem_driver_set')
            import :: c_int64_t
            implicit none (type, external)
            integer(c_int64_t), value :: access
            integer(c_int64_t) :: driver
        end function set_driver

        !> Release a driver after closing its file; no effect for a negative number.
        subroutine release_driver(driver) bind(c, name='tandem_driver_release')
            import :: c_int64_t
            implicit none (type, external)
            integer(c_int64_t), value :: driver
        end subroutine release_driver

        !> Keep all metadata of open files in memory (metadata.c).
        function keep_metadata(access) result(stat) bind(c, name='tandem_metadata_keep')
            import :: c_int, c_int64_t
            implicit none (type, external)
            integer(c_int64_t), value :: access
            integer(c_int) :: stat
        end function keep_metadata

        !> Release most of the metadata kept in memory, before the file is closed.
        subroutine release_metadata(file) bind(c, name='tandem_metadata_release')
            import :: c_int64_t
            implicit none (type, external)
            integer(c_int64_t), value :: file
        end subroutine release_metadata

        !> Select how HDF5 records free space in a file.
        function h5p_set_file_space_strategy(creation, strategy, persist, threshold) result(stat) &
            bind(c, name='H5Pset_file_space_strategy')
            import :: c_bool, c_int, c_int64_t
            implicit none (type, external)
            integer(c_int64_t), value :: creation, threshold
            integer(c_int), value :: strategy
            logical(c_bool), value :: persist
            integer(c_int) :: stat
        end function h5p_set_file_space_strategy

        !> Enable or disable file locking by HDF5.
        function h5p_set_file_locking(access, use, ignore_where_disabled) result(stat) bind(c, name='H5Pset_file_locking')
            import :: c_bool, c_int, c_int64_t
            implicit none (type, external)
            integer(c_int64_t), value :: access
            logical(c_bool), value :: use, ignore_where_disabled
            integer(c_int) :: stat
        end function h5p_set_file_locking
    end interface

contains

    !> Create the properties with which a file is opened; the caller closes them. Properties of a growing file:
    !>
    !> - The format of HDF5 1.10.
    !> - No locking by HDF5: a guard locks the file, and readers may have it open when it is reopened at the end of a run.
    !> - Space is allocated in large blocks, so that the end of the file stated in the superblock seldom changes and lies after the
    !>   rows; plain readers rely on it. Unused space is released when the file is closed.
    !> - Rows bypass HDF5's cache, so that a failed write is noticed before any metadata refer to the rows.
    !>
    !> The system may kill a program between two pages of a write. Blocks of metadata are aligned to `slot`, and most are smaller,
    !> so that they do not span two pages. In particular, the header of a dataset, which changes with every flush, is on the disk
    !> either in its old or in its new state.
    subroutine make_access(access, grows, driver, datasets)
        integer(hid_t), intent(out) :: access
        logical, intent(in) :: grows
        !> Driver of the file, to be released after closing the file; negative if HDF5 uses its own driver.
        integer(c_int64_t), intent(out) :: driver
        !> Number of datasets that grow.
        integer, intent(in) :: datasets
        integer(hsize_t), parameter :: piece = 2**20
        integer :: stat

        call h5pcreate_f(h5p_file_access_f, access, stat)
        driver = -1
        if (.not. grows) return
        driver = set_driver(int(access, c_int64_t))
        if (driver < 0) then
            ! Without the driver no file must be opened.
            call h5pclose_f(access, stat)
            access = -1_hid_t
            return
        end if
        call h5pset_libver_bounds_f(access, h5f_libver_v110_f, h5f_libver_v110_f, stat)
        stat = int(h5p_set_file_locking(int(access, c_int64_t), .false._c_bool, .true._c_bool))
        call h5pset_cache_f(access, 0, 1_size_t, 0_size_t, 0.75, stat)
        call h5pset_alignment_f(access, 1_hsize_t, slot, stat)
        call h5pset_small_data_block_size_f(access, piece, stat)
        call h5pset_meta_block_size_f(access, piece/16, stat)
        if (datasets >= many_datasets) stat = int(keep_metadata(int(access, c_int64_t)))
    end subroutine make_access

    !> Do not record gaps smaller than a slot in a new file. No aligned block fits into such a gap, and HDF5 searches all recorded
    !> gaps for each new block, so that the work would grow with the square of their number. Returns 0 on success.
    integer function ignore_small_gaps(creation)
        !> Properties with which the file is created.
        integer(hid_t), intent(in) :: creation
        integer(c_int), parameter :: default_strategy = 0

        ignore_small_gaps = int(h5p_set_file_space_strategy(int(creation, c_int64_t), default_strategy, .false._c_bool, &
            int(slot, c_int64_t)))
    end function ignore_small_gaps

    !> Create the properties for opening a possibly damaged file. The caller closes them and releases the driver.
    subroutine make_reading_access(access, driver)
        integer(hid_t), intent(out) :: access
        integer(c_int64_t), intent(out) :: driver
        integer :: stat

        call h5pcreate_f(h5p_file_access_f, access, stat)
        driver = set_driver(int(access, c_int64_t))
    end subroutine make_reading_access

    !> Restrict an open file to appending rows; 0 on success.
    integer function start_swmr(file)
        integer(hid_t), intent(in) :: file

        start_swmr = int(h5f_start_swmr_write(int(file, c_int64_t)))
    end function start_swmr

    !> End of an open file after the next flush; 0 if unknown.
    integer(c_int64_t) function end_of(file)
        integer(hid_t), intent(in) :: file

        if (h5f_get_eoa(int(file, c_int64_t), end_of) < 0) end_of = 0
    end function end_of
end module tandem_io_output_access
