! SPDX-License-Identifier: MIT
!> A kept result of a case: a quantity of the motion, and the operation that reduces it to a number.
module tandem_io_sweep_kept
    use tandem, only: figure_reader_type, label_length, long, model_type, statistics_type, tell_figures, to_text, wp
    use tandem_io_scene, only: scene_type
    use tandem_io_scene_text, only: listed, nearest_name
    use tandem_number_text, only: read_number
    use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
    implicit none (type, external)
    private

    public :: kept_type, take_names, take_default, take_end, take_start, take_min, take_max, take_time_of_min, take_time_of_max
    public :: take_mean, take_first, take_last, take_count, take_times, find_figure
    public :: of_q, of_qd, of_qdd, of_lambda, of_kinetic, of_potential, of_energy, of_error, of_step, of_sensor, of_event, of_figure
    public :: of_estimate

    !> Operations that reduce a quantity to a number, in the order of their names.
    integer, parameter :: take_default = 0, take_end = 1, take_start = 2, take_min = 3, take_max = 4, take_time_of_min = 5, &
        take_time_of_max = 6, take_mean = 7, take_first = 8, take_last = 9, take_count = 10, take_times = 11
    !> Names of the operations.
    character(len=12), parameter :: take_names(11) = [character(len=12) :: 'end', 'start', 'min', 'max', 'time_of_min', &
        'time_of_max', 'mean', 'first', 'last', 'count', 'times']

    !> Kinds of quantities.
    integer, parameter :: of_q = 1, of_qd = 2, of_qdd = 3, of_lambda = 4, of_kinetic = 5, of_potential = 6, of_energy = 7, &
        of_error = 8, of_step = 9, of_sensor = 10, of_event = 11, of_figure = 12, of_estimate = 13

    !> Quantities without an index: names, kinds, indices and units.
    character(len=18), parameter :: simple_names(7) = [character(len=18) :: 'kinetic_energy', 'potential_energy', 'energy', &
        'position_error', 'velocity_error', 'acceleration_error', 'step']
    integer, parameter :: simple_kinds(7) = [of_kinetic, of_potential, of_energy, of_error, of_error, of_error, of_step]
    integer, parameter :: simple_indices(7) = [1, 1, 1, 1, 2, 3, 1]
    character(len=4), parameter :: simple_units(7) = [character(len=4) :: 'J', 'J', 'J', '1', '1', '1', 's']

    !> Errors estimated by a second run of a case: the error at the end and the largest error at all compared times, both relative
    !> to the scale of each coordinate; the max-norms of the errors of q and of qd at the end.
    character(len=7), parameter :: estimate_names(4) = [character(len=7) :: 'end', 'largest', 'q', 'qd']

    !> One entry of `[[keep]]`.
    type :: kept_type
        !> Name in the table, quantity as given in the file, and unit.
        character(len=160) :: name = ''
        character(len=:), allocatable :: quantity
        character(len=label_length) :: unit = ''
        !> One of the kinds above, and index among quantities of this kind.
        integer :: kind = of_q, index = 1
        integer :: take = take_default
        !> Times at which the quantity is evaluated; not allocated if it is reduced to one number.
        real(wp), allocatable :: times(:)
        !> Name of the figure.
        character(len=:), allocatable :: figure
    contains
        procedure :: width, resolve
        procedure, private :: find_indexed, find_sensor
    end type kept_type

    !> Searches for one figure of a run.
    type, extends(figure_reader_type) :: finder_type
        character(len=:), allocatable :: name
        real(wp) :: number = 0.0_wp
        logical :: is_found = .false.
        !> Names of all figures, for messages.
        character(len=:), allocatable :: names
    contains
        procedure :: count => take_count_of, value => take_value_of
    end type finder_type

contains

    !> Number of values per case.
    pure integer function width(self)
        class(kept_type), intent(in) :: self

        width = 1
        if (allocated(self%times)) width = size(self%times)
    end function width

    !> Find the quantity in a scene.
    subroutine resolve(self, scene, problem)
        class(kept_type), intent(inout) :: self
        type(scene_type), intent(in) :: scene
        !> Reason why the quantity does not exist; empty if it exists.
        character(len=:), allocatable, intent(out) :: problem
        type(statistics_type) :: statistics
        character(len=:), allocatable :: wanted
        real(wp) :: number
        integer :: i, colon

        problem = ''
        colon = index(self%quantity, ':')
        wanted = trim(adjustl(self%quantity(colon + 1:)))
        select case (self%quantity(:max(0, colon - 1)))
        case ('q')
            call self%find_indexed(scene%model, of_q, wanted, problem)
        case ('qd')
            call self%find_indexed(scene%model, of_qd, wanted, problem)
        case ('qdd')
            call self%find_indexed(scene%model, of_qdd, wanted, problem)
        case ('lambda')
            call self%find_indexed(scene%model, of_lambda, wanted, problem)
        case ('sensor')
            call self%find_sensor(scene%model, wanted, problem)
        case ('event')
            self%kind = of_event
            self%unit = 's'
            self%index = findloc(scene%events%name == wanted, .true., dim=1)
            if (self%index == 0) problem = 'is not an event of the scene; valid names: '//listed(scene%events%name)
        case ('figure')
            self%kind = of_figure
            self%figure = wanted
            call find_figure(statistics, wanted, number, problem)
        case ('error')
            self%kind = of_estimate
            self%index = findloc(estimate_names == wanted, .true., dim=1)
            if (self%index == 0) problem = 'is not an error of a run; valid names: '//listed(estimate_names)
            if (self%index == 1 .or. self%index == 2) self%unit = '1'
        case ('')
            i = findloc(simple_names == wanted, .true., dim=1)
            if (i == 0) then
                call self%find_indexed(scene%model, of_q, wanted, problem)
                if (problem /= '') problem = problem//'; or '//listed(simple_names)// &
                    ', q:, qd:, qdd:, lambda:, sensor:, event:, figure: or error: followed by a name'
            else
                self%kind = simple_kinds(i)
                self%index = simple_indices(i)
                self%unit = simple_units(i)
            end if
        case default
            problem = 'must begin with one of q:, qd:, qdd:, lambda:, sensor:, event:, figure:, error:'
        end select
        if (problem /= '') return
        if (any(self%kind == [of_potential, of_energy]) .and. .not. associated(scene%model%potential_energy)) then
            problem = 'is the potential energy, which the model does not have'
        end if
        if (self%take == take_default) then
            self%take = take_end
            if (self%kind == of_event) self%take = take_first
        end if
        if (self%kind == of_event .neqv. any(self%take == [take_first, take_last, take_count])) then
            problem = 'cannot have take = "'//trim(take_names(self%take))//'"; an event has first, last or count, others do not'
        else if (any(self%kind == [of_figure, of_estimate]) .and. self%take /= take_end) then
            problem = 'is a number of the complete run: remove take and at'
        end if
        if (self%take == take_time_of_min .or. self%take == take_time_of_max) self%unit = 's'
        if (self%take == take_count) self%unit = '1'
    end subroutine resolve

    !> Find a coordinate or a constraint row by its name.
    subroutine find_indexed(self, model, kind, wanted, problem)
        class(kept_type), intent(inout) :: self
        class(model_type), intent(in) :: model
        integer, intent(in) :: kind
        character(len=*), intent(in) :: wanted
        character(len=:), allocatable, intent(inout) :: problem
        character(len=label_length), allocatable :: names(:)
        integer :: i, n
        logical :: is_found

        n = model%n
        if (kind == of_lambda) n = model%n_constraints()
        self%kind = kind
        ! The index found in the model of an earlier case is usually valid here too.
        is_found = self%index >= 1 .and. self%index <= n
        if (is_found) is_found = label_of(self%index) == wanted
        if (.not. is_found) then
            allocate (names(n))
            do i = 1, n
                names(i) = label_of(i)
            end do
            self%index = findloc(names == wanted, .true., dim=1)
        end if
        if (self%index == 0) then
            problem = '"'//wanted//'" is not a '//trim(merge('constraint', 'coordinate', kind == of_lambda))//'; valid names: '// &
                listed(names(:min(n, 30)))
            if (nearest_name(wanted, names) /= '') problem = problem//'; did you mean "'//nearest_name(wanted, names)//'"?'
            return
        end if
        if (kind == of_lambda) then
            if (model%has_units(of_multipliers=.true.)) self%unit = model%unit_of_multiplier(self%index)
        else if (model%has_units(of_multipliers=.false.)) then
            self%unit = model%unit_of_coordinate(self%index)
            if (kind /= of_q) self%unit = trim(self%unit)//trim(merge('/s  ', '/s^2', kind == of_qd))
        end if
    contains
        !> Name of a coordinate or a constraint row.
        function label_of(i) result(label)
            integer, intent(in) :: i
            character(len=label_length) :: label

            if (kind == of_lambda) then
                label = model%row_name(i)
            else
                label = model%coordinate_label(i)
            end if
        end function label_of
    end subroutine find_indexed

    !> Find a number of a sensor, `NAME/WHAT` or `NAME/WHAT[i]`.
    subroutine find_sensor(self, model, wanted, problem)
        class(kept_type), intent(inout) :: self
        class(model_type), intent(in) :: model
        character(len=*), intent(in) :: wanted
        character(len=:), allocatable, intent(inout) :: problem
        character(len=:), allocatable :: path
        integer :: i, bracket, element, before
        logical :: is_read

        self%kind = of_sensor
        self%index = 0
        problem = 'needs a model with sensors'
        if (.not. allocated(model%quantities)) return
        path = wanted
        element = 0
        bracket = index(wanted, '[')
        if (bracket > 0) then
            path = wanted(:bracket - 1)
            call read_number(wanted(bracket + 1:len(wanted) - 1), element, is_read)
            if (.not. is_read .or. wanted(len(wanted):) /= ']') element = -1
        end if
        before = 0
        do i = 1, size(model%quantities)
            associate (quantity => model%quantities(i))
                if (quantity%path == path) then
                    problem = '"'//path//'" is a single number; write it without [ ]'
                    if (quantity%width > 0) problem = '"'//path//'" has '//to_text(quantity%width)// &
                        ' numbers; write which, as in '//path//'[1]'
                    if (element < min(1, quantity%width) .or. element > quantity%width) return
                    self%index = before + max(1, element)
                    self%unit = quantity%unit
                    problem = ''
                    return
                end if
                before = before + max(1, quantity%width)
            end associate
        end do
        problem = 'is not a quantity of a sensor; valid names: '//listed(model%quantities(:min(30, size(model%quantities)))%path)
        if (nearest_name(path, model%quantities%path) /= '') problem = problem//'; did you mean "'// &
            nearest_name(path, model%quantities%path)//'"?'
    end subroutine find_sensor

    !> Find a figure of a run by its name.
    subroutine find_figure(statistics, name, number, problem)
        type(statistics_type), intent(in) :: statistics
        character(len=*), intent(in) :: name
        !> NaN if the figure does not exist.
        real(wp), intent(out) :: number
        character(len=:), allocatable, intent(out) :: problem
        type(finder_type) :: finder

        finder%name = name
        finder%names = ''
        call tell_figures(statistics, finder)
        problem = ''
        number = finder%number
        if (finder%is_found) return
        number = ieee_value(1.0_wp, ieee_quiet_nan)
        problem = 'is not a figure of a run; valid names: '//finder%names(3:)
    end subroutine find_figure

    !> Compare a counter with the requested figure.
    subroutine take_count_of(self, name, number)
        class(finder_type), intent(inout) :: self
        character(len=*), intent(in) :: name
        integer(long), intent(in) :: number

        call self%value(name, real(number, wp))
    end subroutine take_count_of

    !> Compare a number with the requested figure.
    subroutine take_value_of(self, name, number)
        class(finder_type), intent(inout) :: self
        character(len=*), intent(in) :: name
        real(wp), intent(in) :: number

        self%names = self%names//', '//name
        if (name /= self%name) return
        self%number = number
        self%is_found = .true.
    end subroutine take_value_of
end module tandem_io_sweep_kept
