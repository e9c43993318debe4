! SPDX-License-Identifier: MIT
!> Statistics of a run by name, for callers without access to `statistics_type`: those of reports (`tandem_simulate_figures`) and
!> the number of redundant rows. Also lists all warnings of a run.
module tandem_legacy_figures
    use tandem_error, only: error_type, set_error
    use tandem_kinds, only: long, wp
    use tandem_legacy_error_watch, only: error_watch_type
    use tandem_names, only: lower_case
    use tandem_simulate_error_warnings, only: find_error_warnings
    use tandem_simulate_figures, only: figure_reader_type, tell_figures
    use tandem_simulate_global_error, only: global_error_type
    use tandem_simulate_warning, only: add_warning, warning_type
    use tandem_simulation, only: simulation_type
    use tandem_status, only: status_invalid_option
    implicit none (type, external)
    private

    public :: find_warnings, get_figure

    !> Length of the name of a statistic.
    integer, parameter :: name_length = 40

    !> Finds the statistic with a name, given in lower case.
    type, extends(figure_reader_type) :: finder_type
        character(len=name_length) :: name = ''
        !> Length of the name, since comparing lengths excludes most other names.
        integer :: length = 0
        logical :: found = .false.
        real(wp) :: number = 0.0_wp
    contains
        procedure :: count => find_count, value => find_value
    end type finder_type

    !> Lists the names of all statistics.
    type, extends(figure_reader_type) :: lister_type
        character(len=:), allocatable :: names
    contains
        procedure :: count => list_count, value => list_value
    end type lister_type

contains

    !> Value of one statistic of a run; counters are exact up to 2**53.
    subroutine get_figure(simulation, global_error, name, value, error)
        !> The run, and its error as estimated by a second run.
        type(simulation_type), intent(in) :: simulation
        type(global_error_type), intent(in) :: global_error
        !> Name of the statistic in upper or lower case.
        character(len=*), intent(in) :: name
        !> Value; 0 if there is no such statistic.
        real(wp), intent(out) :: value
        !> invalid_option if there is no such statistic.
        type(error_type), allocatable, intent(out) :: error
        type(finder_type) :: finder
        type(lister_type) :: lister

        finder%name = lower_case(name)
        select case (finder%name)
        case ('n_redundant')
            value = real(simulation%n_redundant, wp)
            return
        case ('position_error', 'velocity_error', 'acceleration_error') ! Names in version 1006.
            finder%name = 'largest_'//trim(finder%name)
        case ('is_stiff') ! As above.
            finder%name = 'stiff'
        case default ! The name of a figure.
        end select
        finder%length = len_trim(finder%name)
        if (len_trim(name) <= name_length) then
            call tell_figures(simulation%statistics(), finder)
            call pass_global_error(global_error, finder)
        end if
        value = finder%number
        if (finder%found) return
        lister%names = 'n_redundant'
        call tell_figures(simulation%statistics(), lister)
        call pass_global_error(global_error, lister)
        call set_error(error, status_invalid_option, '"'//trim(name)//'" is not a statistic', 'there are '//lister%names)
    end subroutine get_figure

    !> Pass the statistics of a second run, if one was made, to a reader, by their names in reports.
    subroutine pass_global_error(global_error, reader)
        type(global_error_type), intent(in) :: global_error
        class(figure_reader_type), intent(inout) :: reader

        if (.not. global_error%is_known) return
        call reader%value('global_error_q', global_error%error_q)
        call reader%value('global_error_qd', global_error%error_qd)
        call reader%value('global_error', global_error%relative)
        call reader%value('global_error_largest', global_error%largest)
        call reader%value('global_error_time', global_error%t_largest)
        call reader%count('global_error_is_bound', merge(1_long, 0_long, global_error%is_bound))
        call reader%count('global_error_right_hand_sides', global_error%right_hand_sides)
        call reader%value('global_error_seconds', global_error%seconds)
    end subroutine pass_global_error

    subroutine find_count(self, name, number)
        class(finder_type), intent(inout) :: self
        character(len=*), intent(in) :: name
        integer(long), intent(in) :: number

        call self%value(name, real(number, wp))
    end subroutine find_count

    subroutine find_value(self, name, number)
        class(finder_type), intent(inout) :: self
        character(len=*), intent(in) :: name
        real(wp), intent(in) :: number

        if (self%found .or. len(name) /= self%length) return
        if (lower_case(name) /= self%name) return
        self%found = .true.
        self%number = number
    end subroutine find_value

    subroutine list_count(self, name, number)
        class(lister_type), intent(inout) :: self
        character(len=*), intent(in) :: name
        integer(long), intent(in) :: number

        self%names = self%names//', '//lower_case(name)
    end subroutine list_count

    subroutine list_value(self, name, number)
        class(lister_type), intent(inout) :: self
        character(len=*), intent(in) :: name
        real(wp), intent(in) :: number

        self%names = self%names//', '//lower_case(name)
    end subroutine list_value

    !> All warnings: those of the run, followed by those about its estimated error.
    subroutine find_warnings(simulation, watch, warnings)
        !> The run, and its estimated error.
        type(simulation_type), intent(in) :: simulation
        type(error_watch_type), intent(in) :: watch
        !> Warnings; empty if there are none.
        type(warning_type), allocatable, intent(out) :: warnings(:)
        type(warning_type), allocatable :: error_warnings(:)
        integer :: i

        allocate (warnings(0))
        if (allocated(simulation%warnings)) then
            do i = 1, size(simulation%warnings)
                call add_warning(warnings, simulation%warnings(i)%text)
            end do
        end if
        call find_error_warnings(simulation%options, simulation%statistics(), error_warnings, watch%global_error, watch%failure)
        do i = 1, size(error_warnings)
            call add_warning(warnings, error_warnings(i)%text)
        end do
    end subroutine find_warnings
end module tandem_legacy_figures
