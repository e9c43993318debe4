! SPDX-License-Identifier: MIT
!> Reads the table [solver]. Its keys are the solver options, whose table defines the valid values. Messages show the line of the
!> file.
module tandem_io_scene_solver
    use tandem, only: complete_options, conflict_type, default_rtol, default_step, error_type, find_conflict, &
        option_row_type, option_visitor_type, options_type, reader_type, steppers_without_estimate, wp
    implicit none (type, external)
    private

    public :: read_solver

    !> Reads one option after the other.
    type, extends(option_visitor_type) :: option_reader_type
        class(reader_type), pointer :: reader => null()
        !> Number of coordinates.
        integer :: n = 0
        !> Stepper of the scene; true if the scene gives a step; true if it gives a tolerance. The defaults of other options depend
        !> on these.
        character(len=16) :: stepper = ''
        logical :: gives_step = .false., gives_tolerance = .false.
    contains
        procedure :: take => read_option
    end type option_reader_type

contains

    !> Read the options of a run; options that are not given have their defaults. A step on the command line overrides tolerances of
    !> the file, and tolerances on the command line override its step.
    subroutine read_solver(reader, n, options)
        class(reader_type), intent(inout), target :: reader
        !> Number of coordinates.
        integer, intent(in) :: n
        !> Defaults on entry, options on return.
        type(options_type), intent(inout) :: options
        character(len=*), parameter :: of_control(6) = [character(len=10) :: 'rtol', 'rtol_qd', 'atol', 'atol_qd', 'first_step', &
            'max_step']
        type(option_reader_type) :: option_reader
        type(options_type) :: asked
        type(conflict_type) :: conflict
        type(error_type), allocatable :: error

        option_reader%reader => reader
        option_reader%n = n
        call reader%open_table('solver')
        call reader%replace(of_control, by=['step'])
        call reader%replace(['step'], by=of_control(:2))
        option_reader%gives_tolerance = reader%gives('rtol') .or. reader%gives('rtol_qd')
        option_reader%gives_step = reader%gives('step')
        call options%visit(option_reader)
        call reader%close_table()
        if (reader%failed()) return
        asked = options
        if (.not. option_reader%gives_step) asked%step = 0.0_wp
        if (.not. option_reader%gives_tolerance) asked%rtol = 0.0_wp
        call find_conflict(asked, conflict)
        if (conflict%name /= '') call reader%refuse(key_of(conflict%name), trim(conflict%problem)//'; '//trim(conflict%remedy)// &
            ' (--unset solver.'//key_of(conflict%name)//' removes it)')
        if (.not. reader%failed()) call complete_options(options, error)
    end subroutine read_solver

    !> Key of an option. A list per coordinate has the same key as the number that it replaces.
    pure function key_of(name) result(key)
        character(len=*), intent(in) :: name
        character(len=:), allocatable :: key

        select case (name)
        case ('rtol_q', 'atol_q')
            key = name(:4)
        case ('btol')
            key = 'Btol'
        case ('htol')
            key = 'Htol'
        case default
            key = trim(name)
        end select
    end function key_of

    !> Read an option, and refuse an invalid value.
    subroutine read_option(self, row, number, whole, word, list, choices)
        class(option_reader_type), intent(inout) :: self
        type(option_row_type), intent(in) :: row
        real(wp), intent(inout), optional :: number
        integer, intent(inout), optional :: whole
        character(len=*), intent(inout), optional :: word
        real(wp), allocatable, intent(inout), optional :: list(:)
        character(len=*), intent(in), optional :: choices(:)
        character(len=len(row%name)) :: key
        logical :: is_fixed
        integer :: i

        key = row%name
        if (row%key /= '') key = row%key
        if (.not. (self%gives_step .or. self%gives_tolerance)) then
            is_fixed = any(steppers_without_estimate == self%stepper)
            if (row%name == 'step' .and. is_fixed) number = default_step
            if (row%name == 'rtol' .and. .not. is_fixed) number = default_rtol
        end if
        if (present(word)) then
            call self%reader%get(trim(key), word, choices, trim(row%help))
            if (key == 'stepper') self%stepper = word
        else if (present(whole)) then
            call self%reader%get(trim(key), whole, help=trim(row%help))
            call judge(real(whole, wp))
        else if (present(number)) then
            if (present(list)) then
                call self%reader%get_for_each(trim(key), self%n, list, number, help=trim(row%help))
            else
                call self%reader%get(trim(key), number, unit=trim(row%unit), help=trim(row%help))
            end if
            call judge(number)
        else if (row%key == '') then
            call self%reader%get_for_each(trim(key), self%n, list, help=trim(row%help))
        end if
        if (.not. present(list)) return
        if (.not. allocated(list)) return
        do i = 1, size(list)
            call judge(list(i))
        end do
    contains
        subroutine judge(value)
            real(wp), intent(in) :: value

            if (row%problem_of(value) /= '') call self%reader%refuse(trim(key), trim(row%problem_of(value)))
        end subroutine judge
    end subroutine read_option
end module tandem_io_scene_solver
