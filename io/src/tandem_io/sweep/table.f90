! SPDX-License-Identifier: MIT
!> The table of a sweep: an HDF5 file with one dataset per input and output and one row per case, and a copy as comma-separated
!> values. Both files are made from the journal in blocks of rows when all cases are finished; then they replace older files.
module tandem_io_sweep_table
    use hdf5, only: hid_t
    use tandem, only: error_type, is_text, is_truth, long, set_error, status_output_failed, to_text, wp
    use tandem_io_output_hdf5, only: hdf5_type
    use tandem_io_scene_text, only: to_toml
    use tandem_io_study_csv, only: csv_line
    use tandem_io_study_files, only: remove_file, replace_file
    use tandem_io_sweep_disk, only: sync_file, sync_folder_of
    use tandem_io_sweep_journal, only: sweep_journal_type
    use tandem_io_sweep_kept, only: kept_type, take_names, take_times
    use tandem_io_sweep_plan, only: input_type, is_choice, is_log_normal, is_log_uniform, is_normal, is_triangular, is_uniform, &
        plan_type
    use tandem_io_sweep_record, only: message_length, name_of_status, record_type
    use tandem_io_sweep_summary, only: index_type, sensitivities
    use tandem_io_version, only: format_version, tandem_version
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite
    implicit none (type, external)
    private

    public :: write_table, csv_path, input_path, output_path, indices_path

    !> Rows per block, and largest number of failures whose message is in the table; the statuses are complete.
    integer, parameter :: block = 4096, most_messages = 100000
    character(len=*), parameter :: about_status = '0 done; else a code of doc/statuses.md, -101 the process of the case ended, '// &
        '-102 the case did not return'

    !> Datasets of the table while they are written.
    type :: columns_type
        integer(hid_t), allocatable :: inputs(:), outputs(:)
        integer(hid_t) :: case = -1_hid_t, status = -1_hid_t, seconds = -1_hid_t
    end type columns_type

contains

    !> Path of the comma-separated values of a table.
    pure function csv_path(path) result(csv)
        character(len=*), intent(in) :: path
        character(len=:), allocatable :: csv
        integer :: dot

        dot = index(path, '.', back=.true.)
        if (dot <= index(path, '/', back=.true.) + 1) dot = len(path) + 1
        csv = path(:dot - 1)//'.csv'
        if (csv == path) csv = path//'.csv'
    end function csv_path

    !> Path of the dataset of an input.
    pure function input_path(input) result(path)
        type(input_type), intent(in) :: input
        character(len=:), allocatable :: path

        path = '/inputs/'//trim(input%name)
    end function input_path

    !> Path of the dataset of a kept quantity.
    pure function output_path(kept) result(path)
        type(kept_type), intent(in) :: kept
        character(len=:), allocatable :: path

        path = '/outputs/'//trim(kept%name)
    end function output_path

    !> Write both files. All cases must be in the journal.
    subroutine write_table(path, plan, journal, error)
        !> Path of the HDF5 file.
        character(len=*), intent(in) :: path
        type(plan_type), intent(in) :: plan
        type(sweep_journal_type), intent(inout) :: journal
        type(error_type), allocatable, intent(out) :: error
        type(hdf5_type) :: file
        type(columns_type) :: columns
        integer :: unit, stat, unit_stat
        character(len=:), allocatable :: csv

        csv = csv_path(path)
        call file%create(path//'.new')
        call write_description(file, plan, journal)
        call add_columns(file, plan, columns)
        open (newunit=unit, file=csv//'.new', status='replace', action='write', iostat=unit_stat)
        stat = unit_stat
        if (stat == 0) write (unit, '(a)', iostat=stat) heading(plan)
        if (stat == 0) call write_rows(file, plan, journal, columns, unit, stat, error)
        if (.not. allocated(error)) call write_failures(file, journal, error)
        if (plan%is_for_indices .and. .not. allocated(error)) call write_indices(file, plan)
        call file%close()
        if (stat == 0) flush (unit, iostat=stat)
        if (unit_stat == 0) close (unit, iostat=unit_stat)
        if (stat == 0) stat = unit_stat
        ! Both files must be on the disk before either is renamed, and their new names before the caller removes the journal.
        if (.not. (allocated(error) .or. allocated(file%problem)) .and. stat == 0) then
            call sync_file(csv//'.new', error)
            if (.not. allocated(error)) call sync_file(path//'.new', error)
            if (.not. allocated(error)) call replace_file(csv, csv//'.new', error)
            if (.not. allocated(error)) call replace_file(path, path//'.new', error)
            if (.not. allocated(error)) call sync_folder_of(path, error)
            if (.not. allocated(error)) return
        end if
        call remove_file(csv//'.new')
        call remove_file(path//'.new')
        if (allocated(error)) return
        if (allocated(file%problem)) then
            call set_error(error, status_output_failed, path//': '//file%problem, 'free space and start again; no case is lost')
        else
            call set_error(error, status_output_failed, csv//' cannot be written', 'free space and start again; no case is lost')
        end if
    end subroutine write_table

    !> Write the attributes, texts and groups of the table.
    subroutine write_description(file, plan, journal)
        type(hdf5_type), intent(inout) :: file
        type(plan_type), intent(in) :: plan
        type(sweep_journal_type), intent(in) :: journal

        call file%attach('/', 'format_version', int(format_version, long))
        call file%attach('/', 'tandem_version', tandem_version)
        call file%attach('/', 'about', 'a sweep: datasets of inputs and outputs, one row per case')
        call file%attach('/', 'cases', plan%n_cases())
        call file%attach('/', 'failed', journal%failed)
        call file%attach('/', 'seed', int(plan%seed, long))
        call file%attach('/', 'draws', int(plan%draws, long))
        call file%attach('/', 'design', trim(merge('indices', 'plain  ', plan%is_for_indices)))
        ! The texts are datasets because attributes are limited to 64 kB.
        call file%put('/sweep', [plan%text])
        call file%put('/scene', [plan%scene_text])
        call file%add_group('/inputs')
        call file%add_group('/outputs')
        call file%add_group('/failures')
    end subroutine write_description

    !> Create the datasets, without values.
    subroutine add_columns(file, plan, columns)
        type(hdf5_type), intent(inout) :: file
        type(plan_type), intent(in) :: plan
        type(columns_type), intent(inout) :: columns
        character(len=:), allocatable :: path
        integer(long) :: rows
        integer :: i

        rows = plan%n_cases()
        allocate (columns%inputs(size(plan%inputs)), columns%outputs(size(plan%kept)))
        call file%add_column('/case', 0, rows, .true., columns%case)
        do i = 1, size(plan%inputs)
            path = input_path(plan%inputs(i))
            associate (input => plan%inputs(i))
                call file%add_column(path, 0, rows, input%holds_texts, columns%inputs(i))
                call file%attach(path, 'unit', trim(input%unit))
                call file%attach(path, 'key', key_of(input))
                call file%attach(path, 'values', source_of_values(input))
                if (input%holds_texts) call file%attach(path, 'labels', labels_of(input))
            end associate
        end do
        do i = 1, size(plan%kept)
            path = output_path(plan%kept(i))
            associate (kept => plan%kept(i))
                call file%add_column(path, merge(kept%width(), 0, kept%take == take_times), rows, .false., columns%outputs(i))
                call file%attach(path, 'unit', trim(kept%unit))
                call file%attach(path, 'quantity', kept%quantity)
                call file%attach(path, 'take', trim(take_names(kept%take)))
                if (kept%take == take_times) call file%put(path//'.times', kept%times)
            end associate
        end do
        call file%add_column('/status', 0, rows, .true., columns%status)
        call file%attach('/status', 'meaning', about_status)
        call file%add_column('/seconds', 0, rows, .false., columns%seconds)
        call file%attach('/seconds', 'unit', 's')
        call file%attach('/seconds', 'meaning', 'wall time of the case')
    end subroutine add_columns

    !> Key of an input, with the index of its element.
    pure function key_of(input) result(key)
        type(input_type), intent(in) :: input
        character(len=:), allocatable :: key

        key = input%path
        if (input%element > 0) key = key//'['//to_text(input%element)//']'
    end function key_of

    !> Source or distribution of the values of an input.
    pure function source_of_values(input) result(source)
        type(input_type), intent(in) :: input
        character(len=:), allocatable :: source

        select case (input%kind)
        case (is_uniform)
            source = 'uniform'
        case (is_log_uniform)
            source = 'log_uniform'
        case (is_normal)
            source = 'normal'
        case (is_log_normal)
            source = 'log_normal'
        case (is_triangular)
            source = 'triangular'
        case (is_choice)
            source = 'choice'
        case default
            source = 'listed'
        end select
    end function source_of_values

    !> Texts represented by the numbers 1, 2, ... of an input.
    function labels_of(input) result(labels)
        type(input_type), intent(in) :: input
        character(len=:), allocatable :: labels(:)
        character(len=:), allocatable :: label
        integer :: i, length

        length = 5
        do i = 1, size(input%values)
            if (allocated(input%values(i)%text)) length = max(length, len(input%values(i)%text))
        end do
        allocate (character(len=length) :: labels(size(input%values)))
        do i = 1, size(input%values)
            call get_label(input, i, label)
            labels(i) = label
        end do
    end function labels_of

    !> Value of a list as text.
    subroutine get_label(input, i, label)
        type(input_type), intent(in) :: input
        integer, intent(in) :: i
        character(len=:), allocatable, intent(out) :: label

        select case (input%values(i)%kind)
        case (is_text)
            label = input%values(i)%text
        case (is_truth)
            label = to_toml(input%values(i)%truth)
        case default
            label = to_toml(input%values(i)%number)
        end select
    end subroutine get_label

    !> Write all rows, block by block.
    subroutine write_rows(file, plan, journal, columns, unit, stat, error)
        type(hdf5_type), intent(inout) :: file
        type(plan_type), intent(in) :: plan
        type(sweep_journal_type), intent(inout) :: journal
        type(columns_type), intent(inout) :: columns
        !> Fortran unit of the comma-separated values; status of the last write.
        integer, intent(in) :: unit
        integer, intent(out) :: stat
        type(error_type), allocatable, intent(out) :: error
        real(wp), allocatable :: inputs(:, :), outputs(:, :), others(:, :)
        type(record_type) :: record
        integer(long) :: before, case
        integer :: i, n, rows

        stat = 0
        allocate (inputs(size(plan%inputs), block), outputs(plan%n_outputs(), block), others(3, block))
        do before = 0, plan%n_cases() - 1, block
            rows = int(min(int(block, long), plan%n_cases() - before))
            do i = 1, rows
                case = before + i
                call journal%read(case, record, error)
                if (allocated(error)) return
                call plan%numbers_of(case, inputs(:, i))
                outputs(:, i) = record%values
                others(:, i) = [real(case, wp), real(record%status, wp), record%seconds]
                if (stat == 0) write (unit, '(a)', iostat=stat) row_of(plan, inputs(:, i), record)
            end do
            do i = 1, size(plan%inputs)
                call file%fill_column(columns%inputs(i), input_path(plan%inputs(i)), 0, before, components_of(inputs, i, 1, rows))
            end do
            n = 1
            do i = 1, size(plan%kept)
                associate (width => plan%kept(i)%width())
                    call file%fill_column(columns%outputs(i), output_path(plan%kept(i)), &
                        merge(width, 0, plan%kept(i)%take == take_times), before, components_of(outputs, n, width, rows))
                    n = n + width
                end associate
            end do
            call file%fill_column(columns%case, '/case', 0, before, components_of(others, 1, 1, rows))
            call file%fill_column(columns%status, '/status', 0, before, components_of(others, 2, 1, rows))
            call file%fill_column(columns%seconds, '/seconds', 0, before, components_of(others, 3, 1, rows))
            if (allocated(file%problem) .or. stat /= 0) return
        end do
        do i = 1, size(columns%inputs)
            call file%close_dataset(columns%inputs(i))
        end do
        do i = 1, size(columns%outputs)
            call file%close_dataset(columns%outputs(i))
        end do
        call file%close_dataset(columns%case)
        call file%close_dataset(columns%status)
        call file%close_dataset(columns%seconds)
    end subroutine write_rows

    !> Some components of the rows of a block.
    pure function components_of(values, first, width, columns) result(part)
        real(wp), intent(in) :: values(:, :)
        integer, intent(in) :: first, width, columns
        real(wp) :: part(width, columns)

        part = values(first:first + width - 1, :columns)
    end function components_of

    !> Write the messages of failed cases.
    subroutine write_failures(file, journal, error)
        type(hdf5_type), intent(inout) :: file
        type(sweep_journal_type), intent(inout) :: journal
        type(error_type), allocatable, intent(out) :: error
        integer(long), allocatable :: cases(:)
        character(len=24), allocatable :: names(:)
        character(len=message_length), allocatable :: messages(:)
        type(record_type) :: record
        integer(long) :: case
        integer :: n, most

        most = int(min(journal%failed, int(most_messages, long)))
        allocate (cases(most), names(most), messages(most))
        n = 0
        do case = journal%first, journal%last
            if (n == most) exit
            call journal%read(case, record, error)
            if (allocated(error)) return
            if (record%status == 0) cycle
            n = n + 1
            cases(n) = case
            names(n) = name_of_status(record%status)
            messages(n) = record%message
        end do
        call file%put('/failures/case', cases)
        call file%put('/failures/status', names)
        call file%put('/failures/message', messages)
    end subroutine write_failures

    !> Path of the dataset of Sobol' indices of an output.
    pure function indices_path(kept) result(path)
        type(kept_type), intent(in) :: kept
        character(len=:), allocatable :: path

        path = '/indices/'//trim(kept%name)
    end function indices_path

    !> Write the Sobol' indices of every output that is a single number.
    subroutine write_indices(file, plan)
        type(hdf5_type), intent(inout) :: file
        type(plan_type), intent(in) :: plan
        type(index_type) :: indices(plan%n_drawn)
        real(wp), allocatable :: values(:, :)
        real(wp) :: rows(4, plan%n_drawn)
        character(len=:), allocatable :: path
        integer :: i, j, blocks
        integer(hid_t) :: dataset

        call file%add_group('/indices')
        call file%put('/indices/inputs', pack(plan%inputs%name, [(plan%inputs(j)%is_drawn(), j=1, size(plan%inputs))]))
        do i = 1, size(plan%kept)
            if (plan%kept(i)%take == take_times) cycle
            call file%get(output_path(plan%kept(i)), values)
            if (allocated(file%problem)) return
            call sensitivities(values(1, :), plan%n_drawn, plan%seed, blocks, indices)
            path = indices_path(plan%kept(i))
            call file%add_column(path, 4, int(plan%n_drawn, long), .false., dataset)
            do j = 1, plan%n_drawn
                rows(:, j) = [indices(j)%first, indices(j)%first_error, indices(j)%total, indices(j)%total_error]
            end do
            call file%fill_column(dataset, path, 4, 0_long, rows)
            call file%close_dataset(dataset)
            call file%attach(path, 'columns', [character(len=20) :: 'first order', 'its 95 %', 'total', 'its 95 %'])
            call file%attach(path, 'blocks', int(blocks, long))
        end do
    end subroutine write_indices

    !> Header line of the comma-separated values.
    pure function heading(plan) result(line)
        type(plan_type), intent(in) :: plan
        character(len=:), allocatable :: line
        integer :: i, j

        line = 'case'
        do i = 1, size(plan%inputs)
            line = line//','//csv_line([plan%inputs(i)%name])
        end do
        do i = 1, size(plan%kept)
            associate (kept => plan%kept(i))
                do j = 1, kept%width()
                    if (kept%take == take_times) then
                        line = line//','//csv_line([trim(kept%name)//'@'//to_toml(kept%times(j))])
                    else
                        line = line//','//csv_line([kept%name])
                    end if
                end do
            end associate
        end do
        line = line//',status,seconds,message'
    end function heading

    !> Row of the comma-separated values.
    function row_of(plan, inputs, record) result(line)
        type(plan_type), intent(in) :: plan
        real(wp), intent(in) :: inputs(:)
        type(record_type), intent(in) :: record
        character(len=:), allocatable :: line, label
        character(len=20) :: buffer
        integer :: i

        write (buffer, '(i0)') record%case
        line = trim(buffer)
        do i = 1, size(inputs)
            if (plan%inputs(i)%holds_texts) then
                call get_label(plan%inputs(i), nint(inputs(i)), label)
                line = line//','//csv_line([label])
            else
                line = line//','//trim(digits_of(inputs(i)))
            end if
        end do
        do i = 1, size(record%values)
            line = line//','//trim(digits_of(record%values(i)))
        end do
        line = line//','//trim(name_of_status(record%status))//','//trim(digits_of(record%seconds))//','//csv_line([record%message])
    end function row_of

    !> Number with 15 digits, or with as many as needed to reproduce it exactly; blank if it is not finite.
    function digits_of(value) result(text)
        real(wp), intent(in) :: value
        character(len=25) :: text
        real(wp) :: back

        text = ''
        if (.not. ieee_is_finite(value)) return
        write (text, '(es22.14e3)') value
        read (text, *) back
        if (back < value .or. back > value) write (text, '(es24.16e3)') value
        text = adjustl(text)
    end function digits_of
end module tandem_io_sweep_table
