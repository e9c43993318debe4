! SPDX-License-Identifier: MIT
!> A series of a result file: the time, a field or a quantity. It consists of a dataset that grows by rows and a buffer of rows that
!> are not yet written.
module tandem_io_output_series
    use hdf5, only: hid_t
    use tandem, only: label_length, long, model_type, quantity_type, wp
    use tandem_fletcher, only: fletcher_type
    use tandem_io_output_fields, only: each_constraint, each_coordinate, field_type, fields, one
    use tandem_io_output_hdf5, only: hdf5_type
    implicit none (type, external)
    private

    public :: series_type, label_columns, width_of

    !> A dataset and its unwritten rows.
    type :: series_type
        !> Index in `fields`; 0 for the time; -i for quantity i of the model.
        integer :: field = 0
        !> Numbers per row; 0 for one number per row, without the second dimension.
        integer :: width = 0
        character(len=:), allocatable :: path
        integer(hid_t) :: dataset = -1_hid_t
        real(wp), allocatable :: rows(:, :)
        !> Checksum of the written rows.
        type(fletcher_type) :: sum
    contains
        procedure :: make, append
    end type series_type

    !> Names of the datasets with the labels of columns, which all series of a group share.
    character(len=10), parameter :: columns(each_coordinate:each_constraint) = ['coordinate', 'constraint']

contains

    !> Create the dataset, or open it for a resumed run, and allocate the buffer.
    subroutine make(self, file, field, model, capacity, chunk, is_resumed, time)
        class(series_type), intent(inout) :: self
        type(hdf5_type), intent(inout) :: file
        !> Index of the field; 0 for the time; -i for quantity i.
        integer, intent(in) :: field
        class(model_type), intent(in) :: model
        !> Rows of the buffer, and rows per chunk of the file.
        integer, intent(in) :: capacity, chunk
        !> True if the dataset exists.
        logical, intent(in) :: is_resumed
        !> Dataset of the time; absent for the time itself.
        integer(hid_t), intent(in), optional :: time
        character(len=label_length), allocatable :: names(:), units(:)

        self%field = field
        allocate (self%rows(max(1, width_of(field, model)), capacity))
        self%path = '/trajectory/time'
        if (field < 0) then
            call make_quantity(self, file, model%quantities(-field), chunk, is_resumed, time)
            return
        else if (field > 0) then
            self%path = '/'//trim(fields(field)%group)//'/'//trim(fields(field)%name)
            if (fields(field)%width /= one) self%width = width_of(field, model)
        end if
        if (is_resumed) then
            call file%open_dataset(self%path, self%dataset)
        else if (field == 0) then
            call file%add_dataset(self%path, 0, chunk, .false., self%dataset)
            call file%attach(self%path, 'unit', 's')
            call file%attach(self%path, 'meaning', 'the time of each row')
        else
            call file%add_dataset(self%path, self%width, chunk, fields(field)%counts, self%dataset, time)
            ! Readers look for the scales of a dataset in its own group.
            call file%link('/trajectory/time', '/'//trim(fields(field)%group)//'/time')
            call file%attach(self%path, 'meaning', fields(field)%meaning)
            if (fields(field)%width == one) then
                call file%attach(self%path, 'unit', fields(field)%unit)
                return
            end if
            call label_columns(model, fields(field), names, units)
            call file%name_columns(self%dataset, self%path, &
                '/'//trim(fields(field)%group)//'/'//trim(columns(fields(field)%width)), names)
            call file%attach(self%path, 'names', names)
            if (size(units) > 0) call file%attach(self%path, 'units', units)
        end if
    end subroutine make

    !> Create or open the dataset of a quantity, in the group of its sensor.
    subroutine make_quantity(self, file, quantity, chunk, is_resumed, time)
        class(series_type), intent(inout) :: self
        type(hdf5_type), intent(inout) :: file
        type(quantity_type), intent(in) :: quantity
        integer, intent(in) :: chunk
        logical, intent(in) :: is_resumed
        integer(hid_t), intent(in), optional :: time
        character(len=1), parameter :: axes(3) = ['x', 'y', 'z']
        character(len=2), parameter :: parameters(4) = ['e0', 'e1', 'e2', 'e3']
        character(len=:), allocatable :: group

        self%path = quantity%place()
        group = self%path(:index(self%path, '/', back=.true.) - 1)
        self%width = quantity%width
        if (is_resumed) then
            call file%open_dataset(self%path, self%dataset)
            return
        end if
        call file%add_dataset(self%path, self%width, chunk, .false., self%dataset, time)
        call file%link('/trajectory/time', group//'/time')
        call file%attach(self%path, 'meaning', trim(quantity%meaning))
        call file%attach(self%path, 'unit', trim(quantity%unit))
        if (quantity%width == size(axes)) call file%attach(self%path, 'names', axes)
        if (quantity%width == size(parameters)) call file%attach(self%path, 'names', parameters)
        if (quantity%between(2) /= '') call file%attach(self%path, 'between', quantity%between)
        if (quantity%undetermined /= '') call file%attach(self%path, 'undetermined', trim(quantity%undetermined))
    end subroutine make_quantity

    !> Write the rows of the buffer.
    subroutine append(self, file, before, gathered)
        class(series_type), intent(inout), target :: self
        type(hdf5_type), intent(inout) :: file
        !> Number of rows in the dataset, and in the buffer.
        integer(long), intent(in) :: before
        integer, intent(in) :: gathered
        real(wp), pointer :: numbers(:)

        call file%append(self%dataset, self%path, self%width, before, gathered, self%rows)
        numbers(1:size(self%rows)) => self%rows
        call self%sum%add(numbers(:size(self%rows, 1)*gathered))
    end subroutine append

    !> Names and units of the columns of a field; no units if the model has none.
    subroutine label_columns(model, field, names, units)
        class(model_type), intent(in) :: model
        type(field_type), intent(in) :: field
        character(len=label_length), allocatable, intent(out) :: names(:), units(:)
        character(len=4), parameter :: per(0:2) = [character(len=4) :: '', '/s', '/s^2']
        integer :: i

        select case (field%width)
        case (one)
            return
        case (each_constraint)
            allocate (names(model%n_constraints()), units(0))
            if (model%has_units(of_multipliers=.true.)) then
                deallocate (units)
                allocate (units(size(names)))
            end if
            do i = 1, size(names)
                names(i) = model%row_name(i)
                if (size(units) > 0) units(i) = model%unit_of_multiplier(i)
            end do
        case default
            allocate (names(model%n), units(model%n))
            do i = 1, model%n
                names(i) = model%coordinate_label(i)
                units(i) = '1'
                if (model%has_units(of_multipliers=.false.)) units(i) = model%unit_of_coordinate(i)
                units(i) = trim(units(i))//per(-field%rate)
            end do
        end select
    end subroutine label_columns

    !> Numbers per row of a series; 1 for the time.
    pure integer function width_of(field, model)
        integer, intent(in) :: field
        class(model_type), intent(in) :: model

        width_of = 1
        if (field < 0) width_of = max(1, model%quantities(-field)%width)
        if (field <= 0) return
        if (fields(field)%width == each_coordinate) width_of = model%n
        if (fields(field)%width == each_constraint) width_of = model%n_constraints()
    end function width_of
end module tandem_io_output_series
