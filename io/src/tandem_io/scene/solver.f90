! SPDX-License-Identifier: MIT
!> Reads the table [solver]: the keys are the options, and what values may be is theirs to say; here their word gets the line of
!> the file.
module tandem_io_scene_solver
    use tandem, only: option_row_type, option_visitor_type, options_type, wp
    use tandem_io_scene_reader, only: reader_type
    implicit none (type, external)
    private

    public :: read_solver

    !> Reads one option after the other.
    type, extends(option_visitor_type) :: option_reader_type
        class(reader_type), pointer :: reader => null()
        !> Number of coordinates.
        integer :: n = 0
    contains
        procedure :: take => read_option
    end type option_reader_type

contains

    !> The options of a run.
    subroutine read_solver(reader, n, options)
        class(reader_type), intent(inout), target :: reader
        !> Number of coordinates.
        integer, intent(in) :: n
        !> The defaults before, the options after.
        type(options_type), intent(inout) :: options
        type(option_reader_type) :: option_reader

        option_reader%reader => reader
        option_reader%n = n
        call reader%open_table('solver')
        call options%visit(option_reader)
        call reader%close_table()
    end subroutine read_solver

    !> Read an option under its key, and refuse a number that cannot be.
    subroutine read_option(self, row, number, whole, word, list, choices)
        class(option_reader_type), intent(inout) :: self
        type(option_row_type), intent(in) :: row
        real(wp), intent(inout), optional :: number
        integer, intent(inout), optional :: whole
        character(len=*), intent(inout), optional :: word
        real(wp), allocatable, intent(inout), optional :: list(:)
        character(len=*), intent(in), optional :: choices(:)
        character(len=len(row%name)) :: key
        integer :: i

        key = row%name
        if (row%key /= '') key = row%key
        if (present(word)) then
            call self%reader%get(trim(key), word, choices, trim(row%help))
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
