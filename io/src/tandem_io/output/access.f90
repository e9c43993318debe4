! SPDX-License-Identifier: MIT
!> Settings of HDF5 for a file that must stay whole at any end of the program: the mode "single writer, multiple readers" (SWMR).
module tandem_io_output_access
    use hdf5, only: h5f_libver_v110_f, h5p_file_access_f, h5pclose_f, h5pcreate_f, h5pset_alignment_f, h5pset_cache_f, &
        h5pset_libver_bounds_f, h5pset_meta_block_size_f, h5pset_small_data_block_size_f, hid_t, hsize_t, size_t
    use, intrinsic :: iso_c_binding, only: c_bool, c_int, c_int64_t
    implicit none (type, external)
    private

    public :: make_access, make_reading_access, release_driver, start_swmr, end_of, forget_small_gaps, let_metadata_go, &
        many_datasets

    !> Pieces of metadata begin at multiples of this (bytes).
    integer(hsize_t), parameter :: slot = 1024
    !> Number of datasets from which a file is treated as one of many datasets.
    integer, parameter :: many_datasets = 250

    interface
        !> From now on, write metadata to the disk in an order that keeps the file whole at every moment.
        function h5f_start_swmr_write(file) result(stat) bind(c, name='H5Fstart_swmr_write')
            import :: c_int, c_int64_t
            implicit none (type, external)
            integer(c_int64_t), value :: file
            integer(c_int) :: stat
        end function h5f_start_swmr_write

        !> End of the last allocated piece of the file.
        function h5f_get_eoa(file, address) result(stat) bind(c, name='H5Fget_eoa')
            import :: c_int, c_int64_t
            implicit none (type, external)
            integer(c_int64_t), value :: file
            integer(c_int64_t), intent(out) :: address
            integer(c_int) :: stat
        end function h5f_get_eoa

        !> Select the driver of driver.c for a file: without HDF5's mark "open for writing", and never shorter than it
        !> says. Its number, or a negative one.
        function set_driver(access) result(driver) bind(c, name='tandem_driver_set')
            import :: c_int64_t
            implicit none (type, external)
            integer(c_int64_t), value :: access
            integer(c_int64_t) :: driver
        end function set_driver

        !> Release a driver, if there is one, after closing its file.
        subroutine release_driver(driver) bind(c, name='tandem_driver_release')
            import :: c_int64_t
            implicit none (type, external)
            integer(c_int64_t), value :: driver
        end subroutine release_driver

        !> Keep all metadata of a file's objects in memory while it is open (metadata.c).
        function keep_metadata(access) result(stat) bind(c, name='tandem_metadata_keep')
            import :: c_int, c_int64_t
            implicit none (type, external)
            integer(c_int64_t), value :: access
            integer(c_int) :: stat
        end function keep_metadata

        !> Release most of the metadata kept in memory, before the file is closed.
        subroutine let_metadata_go(file) bind(c, name='tandem_metadata_let_go')
            import :: c_int64_t
            implicit none (type, external)
            integer(c_int64_t), value :: file
        end subroutine let_metadata_go

        !> Set how HDF5 records free space in a file.
        function h5p_set_file_space_strategy(creation, strategy, persist, threshold) result(stat) &
            bind(c, name='H5Pset_file_space_strategy')
            import :: c_bool, c_int, c_int64_t
            implicit none (type, external)
            integer(c_int64_t), value :: creation, threshold
            integer(c_int), value :: strategy
            logical(c_bool), value :: persist
            integer(c_int) :: stat
        end function h5p_set_file_space_strategy

        !> Set file locking by HDF5.
        function h5p_set_file_locking(access, use, ignore_where_disabled) result(stat) bind(c, name='H5Pset_file_locking')
            import :: c_bool, c_int, c_int64_t
            implicit none (type, external)
            integer(c_int64_t), value :: access
            logical(c_bool), value :: use, ignore_where_disabled
            integer(c_int) :: stat
        end function h5p_set_file_locking
    end interface

contains

    !> Make the properties with which a file is opened; the caller closes them. Properties of a file that grows: the format of HDF5
    !> 1.10; no locks, since a guard locks the file, and readers may be there when it is opened again at the end of a run; and room
    !> taken in large pieces, so that the end of the file that the superblock states, which plain readers believe, seldom changes
    !> and is ahead of the rows. Unused room is given back when the file is closed. Rows go to the disk past HDF5's
    !> cache: a failure then shows before anything on the disk says that they are there.
    !>
    !> The system may end a program for good between two pages of a write. Pieces of metadata, most of them smaller than `slot`,
    !> begin at multiples of it, so that none of them spans two pages: the header of a dataset, which changes with every flush,
    !> is on the disk in its old or its new state.
    subroutine make_access(access, grows, driver, datasets)
        integer(hid_t), intent(out) :: access
        logical, intent(in) :: grows
        !> The file's driver, which the caller gives back after closing the file; negative if it is not this library's own.
        integer(c_int64_t), intent(out) :: driver
        !> How many datasets grow in the file, or will.
        integer, intent(in) :: datasets
        integer(hsize_t), parameter :: piece = 2**20
        integer :: stat

        call h5pcreate_f(h5p_file_access_f, access, stat)
        driver = -1
        if (.not. grows) return
        driver = set_driver(int(access, c_int64_t))
        if (driver < 0) then
            ! No file can be opened with that.
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

    !> Do not record gaps smaller than a slot in a new file: no slot begins in them, except in a small piece that was freed.
    !> HDF5 searches all gaps for each new piece, so that the work grows with the square of their number. 0 on success.
    integer function forget_small_gaps(creation)
        !> The properties with which the file is made.
        integer(hid_t), intent(in) :: creation
        integer(c_int), parameter :: as_ever = 0

        forget_small_gaps = int(h5p_set_file_space_strategy(int(creation, c_int64_t), as_ever, .false._c_bool, &
            int(slot, c_int64_t)))
    end function forget_small_gaps

    !> Make the properties with which a possibly damaged file is opened; the caller closes them, and releases the driver.
    subroutine make_reading_access(access, driver)
        integer(hid_t), intent(out) :: access
        integer(c_int64_t), intent(out) :: driver
        integer :: stat

        call h5pcreate_f(h5p_file_access_f, access, stat)
        driver = set_driver(int(access, c_int64_t))
    end subroutine make_reading_access

    !> Allow only appending rows to an open file from now on; 0 on success.
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
