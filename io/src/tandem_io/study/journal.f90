! SPDX-License-Identifier: MIT
!> The rows of a study on disk. Complete rows are appended, so that a study can be interrupted at any time and resumed later.
!>
!> NAME.csv contains the rows, NAME.toml their settings and program. A later study with the same settings and program continues from
!> the existing rows; otherwise it starts again. NAME.h5 contains the table with units and descriptions once it is complete.
module tandem_io_study_journal
    use tandem, only: error_type, long, set_error, status_output_failed, to_text, wp
    use tandem_io_output_hdf5, only: hdf5_type
    use tandem_io_output_target, only: check_target, is_result
    use tandem_io_study_csv, only: csv_line, split_csv_line
    use tandem_io_study_files, only: make_folder, read_whole, replace_file, write_whole
    use tandem_io_study_program, only: program_settings
    use tandem_io_study_table, only: cell_length, column_type, count_column, table_type, text_column
    use tandem_io_version, only: format_version, tandem_version
    implicit none (type, external)
    private

    public :: journal_type

    character(len=*), parameter :: newline = new_line('a')

    type :: journal_type
        !> Rows computed so far.
        type(table_type) :: table
        !> Number of rows read from an earlier study.
        integer :: resumed = 0
        !> True if rows with other settings were discarded.
        logical :: started_anew = .false.
        !> Path of the files without extension.
        character(len=:), allocatable :: path
        !> Data on which the rows depend, in TOML: the settings and the program.
        character(len=:), allocatable, private :: settings
        integer, private :: unit = 0
        logical, private :: is_open = .false.
    contains
        procedure :: open, beginning, append, close, write_hdf5
        procedure, private :: read_rows
    end type journal_type

contains

    !> Open the journal NAME in a folder, which is created if necessary, and read its rows.
    subroutine open(self, folder, name, columns, settings, force, error)
        class(journal_type), intent(inout) :: self
        character(len=*), intent(in) :: folder, name
        !> Columns of the table.
        type(column_type), intent(in) :: columns(:)
        !> Settings on which the rows depend, in TOML; the program is added.
        character(len=*), intent(in) :: settings
        !> True to discard existing rows, and to overwrite files that do not belong to a study.
        logical, intent(in) :: force
        type(error_type), allocatable, intent(out) :: error
        character(len=:), allocatable :: found, text
        logical :: exists, is_new
        integer :: stat, row

        self%path = folder//'/'//name
        self%settings = settings//program_settings()
        self%resumed = 0
        self%started_anew = .false.
        call self%table%initialize(columns)
        call make_folder(folder, error)
        if (allocated(error)) return
        inquire (file=self%path//'.h5', exist=exists)
        ! The HDF5 table of an earlier study is written again from the rows.
        if (exists) call check_target(self%path//'.h5', force .or. is_result(self%path//'.h5'), is_new, error)
        if (allocated(error)) return
        inquire (file=self%path//'.csv', exist=exists)
        call read_whole(self%path//'.toml', found)
        if (exists .and. .not. force) then
            if (.not. allocated(found)) then
                call set_error(error, status_output_failed, self%path//'.csv exists, but not the '//name// &
                    '.toml of a study', 'choose another folder, or overwrite with --force')
                return
            end if
            if (found == self%settings) call self%read_rows()
        end if
        self%resumed = self%table%rows()
        self%started_anew = exists .and. allocated(found) .and. self%resumed == 0
        ! Old rows are removed before new settings are written, so that rows never exist with wrong settings.
        text = heading(columns)//newline
        do row = 1, self%resumed
            text = text//csv_line(self%table%cells(:, row))//newline
        end do
        call write_whole(self%path//'.csv', text, error)
        if (.not. allocated(error)) call write_whole(self%path//'.toml', self%settings, error)
        if (allocated(error)) return
        open (newunit=self%unit, file=self%path//'.csv', status='old', action='write', position='append', iostat=stat)
        self%is_open = stat == 0
        if (stat /= 0) call set_error(error, status_output_failed, 'cannot append to '//self%path//'.csv')
    end subroutine open

    !> Remark about existing rows; empty if there are none.
    function beginning(self) result(text)
        class(journal_type), intent(in) :: self
        character(len=:), allocatable :: text

        text = ''
        if (self%resumed > 0) text = 'continues with the '//to_text(self%resumed)//' rows of '//self%path//'.csv'
        if (self%started_anew) text = 'starts anew, since '//self%path// &
            '.csv holds rows of other settings or of another build of tandem, or is empty'
    end function beginning

    !> Append a row and flush it to the file.
    subroutine append(self, cells, error)
        class(journal_type), intent(inout) :: self
        character(len=*), intent(in) :: cells(:)
        type(error_type), allocatable, intent(out) :: error
        integer :: stat

        call self%table%add(cells)
        write (self%unit, '(a)', iostat=stat) csv_line(cells)
        if (stat == 0) flush (self%unit, iostat=stat)
        if (stat /= 0) call set_error(error, status_output_failed, 'cannot append to '//self%path//'.csv')
    end subroutine append

    !> Close the file of rows.
    subroutine close(self)
        class(journal_type), intent(inout) :: self

        if (self%is_open) close (self%unit)
        self%is_open = .false.
    end subroutine close

    !> Write the table as HDF5: a group with one dataset per column.
    subroutine write_hdf5(self, group, about, names, values, error)
        class(journal_type), intent(inout) :: self
        !> Name of the group, such as `precision`.
        character(len=*), intent(in) :: group
        !> Remark about the table.
        character(len=*), intent(in) :: about
        !> Names and values of additional attributes of the group.
        character(len=*), intent(in) :: names(:)
        real(wp), intent(in) :: values(:)
        type(error_type), allocatable, intent(out) :: error
        type(hdf5_type) :: file
        real(wp), allocatable :: numbers(:)
        integer(long), allocatable :: counts(:)
        character(len=:), allocatable :: path, name
        integer :: i, row

        associate (table => self%table)
            call file%create(self%path//'.h5.new')
            call file%attach('/', 'format_version', int(format_version, long))
            call file%attach('/', 'tandem_version', tandem_version)
            call file%attach('/', 'study', group)
            call file%attach('/', 'about', about)
            call file%attach('/', 'settings', self%settings)
            call file%add_group('/'//group)
            do i = 1, size(names)
                call file%attach('/'//group, trim(names(i)), values(i))
            end do
            allocate (numbers(table%rows()), counts(table%rows()))
            do i = 1, size(table%columns)
                name = trim(table%columns(i)%name)
                path = '/'//group//'/'//name
                select case (table%columns(i)%kind)
                case (text_column)
                    call file%put(path, table%cells(i, :))
                case (count_column)
                    do row = 1, table%rows()
                        counts(row) = table%count_at(row, name)
                    end do
                    call file%put(path, counts)
                case default
                    do row = 1, table%rows()
                        numbers(row) = table%real_at(row, name)
                    end do
                    call file%put(path, numbers)
                end select
                if (table%columns(i)%kind /= text_column) call file%attach(path, 'unit', trim(table%columns(i)%unit))
                call file%attach(path, 'meaning', trim(table%columns(i)%meaning))
            end do
        end associate
        call file%close()
        if (allocated(file%problem)) then
            call set_error(error, status_output_failed, self%path//'.h5: '//file%problem)
        else
            call replace_file(self%path//'.h5', self%path//'.h5.new', error)
        end if
    end subroutine write_hdf5

    !> First line of the file: the names of the columns.
    pure function heading(columns) result(line)
        type(column_type), intent(in) :: columns(:)
        character(len=:), allocatable :: line
        integer :: i

        line = ''
        do i = 1, size(columns)
            line = line//','//csv_line([columns(i)%name])
        end do
        line = line(2:)
    end function heading

    !> Read the rows of the file, up to the first incomplete one, which an interruption has left.
    subroutine read_rows(self)
        class(journal_type), intent(inout) :: self
        character(len=:), allocatable :: text
        character(len=cell_length) :: cells(size(self%table%columns))
        logical :: whole
        integer :: first, last

        call read_whole(self%path//'.csv', text)
        if (.not. allocated(text)) return
        first = index(text, newline) + 1
        if (text(:first - 1) /= heading(self%table%columns)//newline) return
        do
            last = first + index(text(first:), newline) - 1
            if (last < first) return
            call split_csv_line(text(first:last - 1), cells, whole)
            if (.not. whole) return
            call self%table%add(cells)
            first = last + 1
        end do
    end subroutine read_rows
end module tandem_io_study_journal
