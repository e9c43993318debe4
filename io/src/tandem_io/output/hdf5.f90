! SPDX-License-Identifier: MIT
!> Operations of HDF5 for results: groups, attributes, and datasets that grow by rows. Objects are identified by their path.
!>
!> The first failure is stored as text in `problem`; later calls do nothing, so that callers need not check after each call.
!>
!> HDF5 has one state per process. For all users of HDF5 in the process, this module disables the printing of HDF5's error stack and
!> the closing of open objects at program exit.
module tandem_io_output_hdf5
    use hdf5, only: h5dclose_f, h5dcreate_f, h5dget_space_f, h5dset_extent_f, h5dwrite_f, h5eset_auto_f, h5f_acc_rdwr_f, &
        h5f_acc_trunc_f, h5f_scope_global_f, h5fclose_f, h5fcreate_f, h5fflush_f, h5fopen_f, h5gclose_f, h5gcreate_f, h5open_f, &
        h5p_dataset_create_f, h5p_file_create_f, h5p_group_create_f, h5pclose_f, h5pcreate_f, h5pset_attr_phase_change_f, &
        h5pset_chunk_f, h5s_select_set_f, h5s_unlimited_f, h5sclose_f, h5screate_simple_f, h5sselect_hyperslab_f, &
        h5t_ieee_f64le, h5t_native_double, h5t_std_i64le, h5tclose_f, hid_t, hsize_t
    use tandem, only: long, wp
    use tandem_fletcher, only: fletcher_type
    use tandem_io_output_access, only: end_of, ignore_small_gaps, release_metadata, make_access, many_datasets, &
        make_reading_access, release_driver, start_swmr
    use tandem_io_output_guard, only: clear_reason, guard_type, system_reason
    use tandem_io_output_hdf5_texts, only: make_fixed_type
    use, intrinsic :: iso_c_binding, only: c_char, c_int, c_int64_t, c_loc, c_null_char, c_ptr
    implicit none (type, external)
    private

    public :: hdf5_type, start_library

    !> Largest number of attributes stored in the header of their object. HDF5 writes a header such that it is consistent at every
    !> moment; its alternative storage for many attributes is not.
    integer, parameter :: most_attributes = 1000
    !> Message if the file is shorter than the data written to it.
    character(len=*), parameter :: was_cut = &
        'another process truncated or overwrote the file during the run; its content is lost'

    type :: hdf5_type
        !> The first failure; not allocated if there is none.
        character(len=:), allocatable :: problem
        integer(hid_t), private :: file = -1_hid_t
        !> Driver of the file; negative if HDF5 uses its own driver.
        integer(c_int64_t), private :: driver = -1
        !> Number of datasets that grow.
        integer, private :: datasets = 0
        !> True while rows are being appended.
        logical, private :: is_growing = .false.
        type(guard_type), private :: guard
    contains
        procedure :: create, start_appending, reopen, flush, close, unlock
        procedure :: add_group, add_dataset, append, append_texts, close_dataset
        procedure, private :: check
        ! Attributes.
        generic :: attach => attach_integer, attach_real, attach_string, attach_strings
        procedure, private :: attach_integer, attach_real, attach_string, attach_strings
        procedure :: reserve, reserve_text, detach_all, get_attribute, get_text, replace_text
        ! Whole datasets.
        generic :: put => put_integers, put_reals, put_strings, put_matrix
        procedure, private :: put_integers, put_reals, put_strings, put_matrix
        procedure :: add_column, fill_column, name_columns, list_users
        procedure, private :: make_scale, scale_rows
        procedure :: link, open_to_read, get
        ! Resumed runs.
        procedure :: open_to_append, open_dataset, rows_of, cut, remove, add_words, write_words, get_words
        ! Contents of the file and their integrity.
        procedure :: has, sum_rows, read_all
    end type hdf5_type

    interface
        !> Disable the closing of open objects at program exit, which would crash after a failed write.
        function h5_do_not_close_at_exit() result(stat) bind(c, name='H5dont_atexit')
            import :: c_int
            implicit none (type, external)
            integer(c_int) :: stat
        end function h5_do_not_close_at_exit
    end interface

    interface
        !> Turn a dataset into a dimension scale with a name.
        module subroutine make_scale(self, dataset, path, name)
            implicit none (type, external)
            class(hdf5_type), intent(inout) :: self
            integer(hid_t), intent(in) :: dataset
            !> Path of the dataset, for messages; name of the scale.
            character(len=*), intent(in) :: path, name
        end subroutine make_scale

        !> Attach a scale to the rows of a dataset without scales.
        module subroutine scale_rows(self, dataset, path, rank, scale)
            implicit none (type, external)
            class(hdf5_type), intent(inout) :: self
            integer(hid_t), intent(in) :: dataset
            !> Path of the dataset, for messages.
            character(len=*), intent(in) :: path
            !> Number of dimensions of the dataset.
            integer, intent(in) :: rank
            integer(hid_t), intent(in) :: scale
        end subroutine scale_rows

        !> Write the list of all datasets whose rows a scale labels.
        module subroutine list_users(self, scale, path, datasets)
            implicit none (type, external)
            class(hdf5_type), intent(inout) :: self
            integer(hid_t), intent(in) :: scale
            !> Path of the scale, for messages.
            character(len=*), intent(in) :: path
            integer(hid_t), intent(in) :: datasets(:)
        end subroutine list_users

        !> Create a dataset without rows and leave it open. Its shape in C and Python is (rows) or (rows, width).
        module subroutine add_dataset(self, path, width, chunk, counts, dataset, scale, texts)
            implicit none (type, external)
            class(hdf5_type), intent(inout) :: self
            character(len=*), intent(in) :: path
            !> Numbers per row; 0 for one number per row, without the second dimension.
            integer, intent(in) :: width
            !> Rows per chunk.
            integer, intent(in) :: chunk
            !> True if integers are stored.
            logical, intent(in) :: counts
            !> Identifier of the open dataset.
            integer(hid_t), intent(out) :: dataset
            !> Scale of the rows, to be passed to `list_users` later. If absent, the dataset becomes a scale itself.
            integer(hid_t), intent(in), optional :: scale
            !> Length of the stored texts; absent for numbers.
            integer, intent(in), optional :: texts
        end subroutine add_dataset

        !> Append rows to a dataset.
        module subroutine append(self, dataset, path, width, before, rows, values)
            implicit none (type, external)
            class(hdf5_type), intent(inout) :: self
            integer(hid_t), intent(in) :: dataset
            !> Path of the dataset, for messages.
            character(len=*), intent(in) :: path
            !> Numbers per row; 0 for one number per row, without the second dimension.
            integer, intent(in) :: width
            !> Number of existing rows, and of rows to append.
            integer(long), intent(in) :: before
            integer, intent(in) :: rows
            !> The rows, one per column; columns after the first `rows` are ignored.
            real(wp), intent(in), contiguous, target :: values(:, :)
        end subroutine append

        !> Append texts to a dataset of texts, without trailing blanks.
        module subroutine append_texts(self, dataset, path, before, values)
            implicit none (type, external)
            class(hdf5_type), intent(inout) :: self
            integer(hid_t), intent(in) :: dataset
            !> Path of the dataset, for messages.
            character(len=*), intent(in) :: path
            !> Number of existing rows.
            integer(long), intent(in) :: before
            character(len=*), intent(in) :: values(:)
        end subroutine append_texts

        !> Open a file whose datasets are to be extended; the caller then opens the datasets and calls `start_appending`. A mark
        !> left by a killed writer is removed first.
        module subroutine open_to_append(self, path, datasets)
            implicit none (type, external)
            class(hdf5_type), intent(inout) :: self
            character(len=*), intent(in) :: path
            !> Number of datasets that grow.
            integer, intent(in) :: datasets
        end subroutine open_to_append

        !> Open an existing dataset.
        module subroutine open_dataset(self, path, dataset)
            implicit none (type, external)
            class(hdf5_type), intent(inout) :: self
            character(len=*), intent(in) :: path
            integer(hid_t), intent(out) :: dataset
        end subroutine open_dataset

        !> Number of rows of a dataset; 0 if unknown.
        module function rows_of(self, dataset) result(rows)
            implicit none (type, external)
            class(hdf5_type), intent(inout) :: self
            integer(hid_t), intent(in) :: dataset
            integer(long) :: rows
        end function rows_of

        !> Create an empty array of 64-bit integers that are not rows of the result, and leave it open.
        module subroutine add_words(self, path, chunk, dataset)
            implicit none (type, external)
            class(hdf5_type), intent(inout) :: self
            character(len=*), intent(in) :: path
            !> Numbers per chunk.
            integer, intent(in) :: chunk
            integer(hid_t), intent(out) :: dataset
        end subroutine add_words

        !> Overwrite the beginning of an array created by `add_words`, which is extended if it is too short.
        module subroutine write_words(self, dataset, path, words)
            implicit none (type, external)
            class(hdf5_type), intent(inout) :: self
            integer(hid_t), intent(in) :: dataset
            character(len=*), intent(in) :: path
            integer(long), intent(in), contiguous, target :: words(:)
        end subroutine write_words

        !> Read an array created by `add_words`.
        module subroutine get_words(self, path, words)
            implicit none (type, external)
            class(hdf5_type), intent(inout) :: self
            character(len=*), intent(in) :: path
            integer(long), allocatable, target, intent(out) :: words(:)
        end subroutine get_words

        !> True if an object with this path exists; its group must exist.
        module function has(self, path) result(is_there)
            implicit none (type, external)
            class(hdf5_type), intent(inout) :: self
            character(len=*), intent(in) :: path
            logical :: is_there
        end function has

        !> Read the first rows of a dataset of numbers or texts, and compute their checksums row by row.
        module subroutine sum_rows(self, path, early_rows, rows, early, sum, all_rows)
            implicit none (type, external)
            class(hdf5_type), intent(inout) :: self
            character(len=*), intent(in) :: path
            !> Numbers of rows covered by `early` and by `sum`; all rows if there are fewer.
            integer(long), intent(in) :: early_rows, rows
            type(fletcher_type), intent(out) :: early, sum
            !> Number of rows of the dataset.
            integer(long), intent(out) :: all_rows
        end subroutine sum_rows

        !> Read every object of the file with all its attributes; damage is reported in `problem`.
        module subroutine read_all(self, unreadable_texts, text_checksum)
            implicit none (type, external)
            class(hdf5_type), intent(inout) :: self
            !> Number of unreadable text attributes.
            integer, intent(out) :: unreadable_texts
            !> Checksum of the text attributes that stay constant during a run.
            integer(long), intent(out) :: text_checksum
        end subroutine read_all

        !> Truncate a dataset to its first rows.
        module subroutine cut(self, dataset, path, width, rows)
            implicit none (type, external)
            class(hdf5_type), intent(inout) :: self
            integer(hid_t), intent(in) :: dataset
            character(len=*), intent(in) :: path
            !> Numbers per row; 0 for one number per row, without the second dimension.
            integer, intent(in) :: width
            integer(long), intent(in) :: rows
        end subroutine cut

        !> Remove a group with all its contents, if it exists.
        module subroutine remove(self, path)
            implicit none (type, external)
            class(hdf5_type), intent(inout) :: self
            character(len=*), intent(in) :: path
        end subroutine remove

        !> Write an integer attribute of an object.
        module subroutine attach_integer(self, path, name, value)
            implicit none (type, external)
            class(hdf5_type), intent(inout) :: self
            !> Path of the object, and the attribute's name.
            character(len=*), intent(in) :: path, name
            integer(long), intent(in) :: value
        end subroutine attach_integer

        !> Write a real attribute of an object.
        module subroutine attach_real(self, path, name, value)
            implicit none (type, external)
            class(hdf5_type), intent(inout) :: self
            character(len=*), intent(in) :: path, name
            real(wp), intent(in) :: value
        end subroutine attach_real

        !> Write a text attribute of an object, without trailing blanks.
        module subroutine attach_string(self, path, name, value)
            implicit none (type, external)
            class(hdf5_type), intent(inout) :: self
            character(len=*), intent(in) :: path, name, value
        end subroutine attach_string

        !> Write an attribute of an object that is an array of texts, without trailing blanks.
        module subroutine attach_strings(self, path, name, values)
            implicit none (type, external)
            class(hdf5_type), intent(inout) :: self
            character(len=*), intent(in) :: path, name, values(:)
        end subroutine attach_strings

        !> Write the attribute `meaning` of an object, and reserve space for attributes that follow after `start_appending`. The
        !> space is contiguous, so that it is written at once.
        module subroutine reserve(self, path, bytes, meaning)
            implicit none (type, external)
            class(hdf5_type), intent(inout) :: self
            character(len=*), intent(in) :: path
            !> Reserved space: about 40 bytes plus the value for each attribute; at most 64000.
            integer, intent(in) :: bytes
            character(len=*), intent(in) :: meaning
        end subroutine reserve

        !> Reserve space for a text that is written after `start_appending`.
        module subroutine reserve_text(self, path, name)
            implicit none (type, external)
            class(hdf5_type), intent(inout) :: self
            character(len=*), intent(in) :: path, name
        end subroutine reserve_text

        !> Remove all attributes of an object except `meaning`.
        module subroutine detach_all(self, path)
            implicit none (type, external)
            class(hdf5_type), intent(inout) :: self
            character(len=*), intent(in) :: path
        end subroutine detach_all

        !> Read an integer attribute; 0 if it does not exist.
        module subroutine get_attribute(self, path, name, value, is_there)
            implicit none (type, external)
            class(hdf5_type), intent(inout) :: self
            !> Path of the object, and name of the attribute.
            character(len=*), intent(in) :: path, name
            integer(long), target, intent(out) :: value
            logical, intent(out) :: is_there
        end subroutine get_attribute

        !> Read a text attribute; blank if it does not exist or is unreadable.
        module subroutine get_text(self, path, name, value)
            implicit none (type, external)
            class(hdf5_type), intent(inout) :: self
            !> Path of the object, and name of the attribute.
            character(len=*), intent(in) :: path, name
            character(len=:), allocatable, intent(out) :: value
        end subroutine get_text

        !> Replace a text of the root after a failed write, provided that it needs no new space. The next call must be `close`.
        module subroutine replace_text(self, path, name, value)
            implicit none (type, external)
            class(hdf5_type), intent(inout) :: self
            !> Path of the file, and name of the attribute.
            character(len=*), intent(in) :: path, name
            character(len=*), intent(in) :: value
        end subroutine replace_text

        !> Create a dataset of integers (rows).
        module subroutine put_integers(self, path, values)
            implicit none (type, external)
            class(hdf5_type), intent(inout) :: self
            character(len=*), intent(in) :: path
            integer(long), intent(in) :: values(:)
        end subroutine put_integers

        !> Create a dataset of real numbers (rows).
        module subroutine put_reals(self, path, values)
            implicit none (type, external)
            class(hdf5_type), intent(inout) :: self
            character(len=*), intent(in) :: path
            real(wp), intent(in) :: values(:)
        end subroutine put_reals

        !> Create a dataset from a matrix, in row-major order, or replace the values of one of equal size.
        module subroutine put_matrix(self, path, values)
            implicit none (type, external)
            class(hdf5_type), intent(inout) :: self
            character(len=*), intent(in) :: path
            real(wp), intent(in) :: values(:, :)
        end subroutine put_matrix

        !> Create a dataset of texts (rows), without trailing blanks.
        module subroutine put_strings(self, path, values)
            implicit none (type, external)
            class(hdf5_type), intent(inout) :: self
            character(len=*), intent(in) :: path, values(:)
        end subroutine put_strings

        !> Open a file for reading.
        module subroutine open_to_read(self, path)
            implicit none (type, external)
            class(hdf5_type), intent(inout) :: self
            character(len=*), intent(in) :: path
        end subroutine open_to_read

        !> Create a dataset of known size and leave it open. Its shape in C and Python is (rows) or (rows, width).
        module subroutine add_column(self, path, width, rows, counts, dataset)
            implicit none (type, external)
            class(hdf5_type), intent(inout) :: self
            character(len=*), intent(in) :: path
            !> Numbers per row; 0 for one number per row, without the second dimension.
            integer, intent(in) :: width
            integer(long), intent(in) :: rows
            !> True if integers are stored.
            logical, intent(in) :: counts
            integer(hid_t), intent(out) :: dataset
        end subroutine add_column

        !> Write some rows of a dataset created by `add_column`.
        module subroutine fill_column(self, dataset, path, width, before, values)
            implicit none (type, external)
            class(hdf5_type), intent(inout) :: self
            integer(hid_t), intent(in) :: dataset
            !> Path of the dataset, for messages.
            character(len=*), intent(in) :: path
            integer, intent(in) :: width
            !> Number of rows before these.
            integer(long), intent(in) :: before
            !> Rows, one per column.
            real(wp), intent(in), contiguous, target :: values(:, :)
        end subroutine fill_column

        !> Label the columns of a dataset by a dimension scale of texts, which is created if it does not exist.
        module subroutine name_columns(self, dataset, path, scale, names)
            implicit none (type, external)
            class(hdf5_type), intent(inout) :: self
            integer(hid_t), intent(in) :: dataset
            !> Paths of the dataset, for messages, and of the scale.
            character(len=*), intent(in) :: path, scale
            character(len=*), intent(in) :: names(:)
        end subroutine name_columns

        !> Add a second path to an existing object, unless this path exists.
        module subroutine link(self, path, second)
            implicit none (type, external)
            class(hdf5_type), intent(inout) :: self
            character(len=*), intent(in) :: path, second
        end subroutine link

        !> Read a dataset of numbers: (width, rows), with width 1 for one number per row.
        module subroutine get(self, path, values)
            implicit none (type, external)
            class(hdf5_type), intent(inout) :: self
            character(len=*), intent(in) :: path
            !> Not allocated if the dataset is unreadable.
            real(wp), allocatable, target, intent(out) :: values(:, :)
        end subroutine get
    end interface

contains

    !> Create a file; an existing file with this path is overwritten.
    subroutine create(self, path, datasets)
        class(hdf5_type), intent(inout) :: self
        character(len=*), intent(in) :: path
        !> Number of datasets that grow; absent if `start_appending` is not called.
        integer, intent(in), optional :: datasets
        logical :: grows
        integer(hid_t) :: access, properties
        integer :: stat

        call start_library(stat)
        call self%check(stat, 'start HDF5')
        if (allocated(self%problem)) return
        grows = present(datasets)
        self%datasets = 0
        if (grows) self%datasets = datasets
        ! Lock the file before its old contents are overwritten: other runs then see that it is in use.
        if (grows) call self%guard%lock(path)
        call make_access(access, grows, self%driver, self%datasets)
        call clear_reason()
        call h5pcreate_f(h5p_file_create_f, properties, stat)
        call h5pset_attr_phase_change_f(properties, most_attributes, most_attributes, stat)
        if (self%datasets >= many_datasets) call self%check(ignore_small_gaps(properties), 'create '//path)
        call h5fcreate_f(path, h5f_acc_trunc_f, self%file, stat, properties, access)
        call self%check(stat, 'create '//path)
        call h5pclose_f(properties, stat)
        call h5pclose_f(access, stat)
    end subroutine create

    !> Restrict further operations to appending rows and writing attributes. From now on, the file contains all data of the last
    !> flush however the program ends (HDF5's mode "single writer, multiple readers"). Groups, datasets and space for new attributes
    !> (`reserve`) must exist already. A text attribute that is being overwritten may be unreadable for a moment.
    subroutine start_appending(self, path)
        class(hdf5_type), intent(inout) :: self
        !> Path of the file.
        character(len=*), intent(in) :: path

        if (allocated(self%problem)) return
        call self%check(start_swmr(self%file), 'make '//path//' ready for rows')
        self%is_growing = .not. allocated(self%problem)
    end subroutine start_appending

    !> Open the file again after `close`, to add data.
    subroutine reopen(self, path)
        class(hdf5_type), intent(inout) :: self
        character(len=*), intent(in) :: path
        integer(hid_t) :: access
        integer :: stat

        if (allocated(self%problem)) return
        if (.not. self%guard%still_exists()) then
            self%problem = 'the file was removed or replaced after the run'
            return
        end if
        call make_access(access, .true., self%driver, self%datasets)
        call clear_reason()
        call h5fopen_f(path, h5f_acc_rdwr_f, self%file, stat, access_prp=access)
        call self%check(stat, 'open '//path//' again')
        if (stat /= 0) self%file = -1_hid_t
        call h5pclose_f(access, stat)
        call self%start_appending(path)
    end subroutine reopen

    !> Write all data to the disk.
    subroutine flush(self)
        class(hdf5_type), intent(inout) :: self
        integer :: stat

        if (allocated(self%problem)) return
        ! Check before the flush too, because the flush may extend a file that was truncated.
        if (self%guard%is_whole()) then
            call self%guard%repair(end_of(self%file))
            call clear_reason()
            call h5fflush_f(self%file, h5f_scope_global_f, stat)
            call self%check(stat, 'write the rows to disk')
            if (allocated(self%problem)) return
        end if
        if (.not. self%guard%still_exists()) then
            self%problem = 'the file was removed or replaced during the run'
        else if (.not. self%guard%is_whole()) then
            self%problem = was_cut
        end if
    end subroutine flush

    !> Close the file if it is open. After a failure HDF5 is not called again, because its buffered data would damage the file. Data
    !> of a growing file that were not flushed may be lost to readers if the program ends during the call.
    subroutine close(self, keeps_lock)
        class(hdf5_type), intent(inout) :: self
        !> True to keep the file locked against other writers until `unlock`; default false.
        logical, intent(in), optional :: keeps_lock
        logical :: keeps_lock_
        integer :: stat

        keeps_lock_ = .false.
        if (present(keeps_lock)) keeps_lock_ = keeps_lock
        if (self%file >= 0 .and. .not. allocated(self%problem)) then
            call clear_reason()
            if (self%datasets >= many_datasets) call release_metadata(int(self%file, c_int64_t))
            call h5fclose_f(self%file, stat)
            call self%check(stat, 'write the rows to disk')
            if (stat == 0) call release_driver(self%driver)
            if (.not. allocated(self%problem)) call self%guard%trim()
        end if
        self%file = -1_hid_t
        self%driver = -1
        self%is_growing = .false.
        if (.not. keeps_lock_) call self%guard%release()
    end subroutine close

    !> Unlock the file for other writers.
    subroutine unlock(self)
        class(hdf5_type), intent(inout) :: self

        call self%guard%release()
    end subroutine unlock

    !> Create a group.
    subroutine add_group(self, path)
        class(hdf5_type), intent(inout) :: self
        character(len=*), intent(in) :: path
        integer(hid_t) :: group, properties
        integer :: stat

        if (allocated(self%problem)) return
        call h5pcreate_f(h5p_group_create_f, properties, stat)
        call h5pset_attr_phase_change_f(properties, most_attributes, most_attributes, stat)
        call h5gcreate_f(self%file, path, group, stat, gcpl_id=properties)
        call self%check(stat, 'make the group '//path)
        if (stat == 0) call h5gclose_f(group, stat)
        call h5pclose_f(properties, stat)
    end subroutine add_group

    !> Close a dataset, if it is open.
    subroutine close_dataset(self, dataset)
        class(hdf5_type), intent(inout) :: self
        integer(hid_t), intent(inout) :: dataset
        integer :: stat

        if (dataset >= 0 .and. .not. allocated(self%problem)) then
            call h5dclose_f(dataset, stat)
            call self%check(stat, 'write the rows to disk')
        end if
        dataset = -1_hid_t
    end subroutine close_dataset

    !> Record the first failure.
    subroutine check(self, stat, action)
        class(hdf5_type), intent(inout) :: self
        !> Status returned by HDF5.
        integer, intent(in) :: stat
        !> Attempted action, as an infinitive.
        character(len=*), intent(in) :: action

        character(len=:), allocatable :: reason

        if (stat >= 0 .or. allocated(self%problem)) return
        reason = trim(system_reason())
        if (self%is_growing .and. .not. self%guard%is_whole()) then
            self%problem = was_cut
            return
        end if
        self%problem = 'HDF5 could not '//action
        if (reason /= '') self%problem = self%problem//' ('//reason//')'
    end subroutine check

    !> Start the library, unless it runs already, and disable its error output, because failures are reported by this module.
    subroutine start_library(stat)
        integer, intent(out) :: stat

        ! This call has no effect after the library has been started.
        stat = int(h5_do_not_close_at_exit())
        call h5open_f(stat)
        if (stat == 0) call h5eset_auto_f(0, stat)
    end subroutine start_library
end module tandem_io_output_hdf5
