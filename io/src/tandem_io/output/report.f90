! SPDX-License-Identifier: MIT
!> Writes the cost and the error of a run as attributes of /report.
module tandem_io_output_report
    use tandem, only: figure_reader_type, find_error_warnings, global_error_type, long, simulation_type, tell_figures, wp
    use tandem_io_output_hdf5, only: hdf5_type
    use tandem_simulate_warning, only: add_warning, warning_type
    implicit none (type, external)
    private

    public :: write_report, write_global_error

    character(len=*), parameter :: group_path = '/report'

    !> Writes figures of a run as attributes.
    type, extends(figure_reader_type) :: attacher_type
        type(hdf5_type), pointer :: file => null()
    contains
        procedure :: count => attach_count, value => attach_value
    end type attacher_type

contains

    !> Write or replace the report.
    subroutine write_report(file, simulation)
        type(hdf5_type), intent(inout), target :: file
        class(simulation_type), intent(in) :: simulation
        type(warning_type), allocatable :: warnings(:), error_warnings(:)
        type(attacher_type) :: attacher
        integer :: i

        attacher%file => file
        call tell_figures(simulation%statistics(), attacher)
        if (allocated(simulation%events)) call file%attach(group_path, 'events', int(simulation%n_events, long))
        allocate (warnings(0))
        if (allocated(simulation%warnings)) warnings = simulation%warnings
        call find_error_warnings(simulation%options, simulation%statistics(), error_warnings)
        do i = 1, size(error_warnings)
            call add_warning(warnings, error_warnings(i)%text)
        end do
        if (size(warnings) > 0) call file%attach(group_path, 'warnings', texts_of(warnings))
    end subroutine write_report

    !> Write the global error of the run, and a warning if it is large.
    subroutine write_global_error(file, simulation, global_error)
        type(hdf5_type), intent(inout) :: file
        class(simulation_type), intent(in) :: simulation
        class(global_error_type), intent(in) :: global_error
        type(warning_type), allocatable :: before(:), error_warnings(:)

        associate (g => global_error)
            call file%attach(group_path, 'global_error_q', g%error_q)
            call file%attach(group_path, 'global_error_qd', g%error_qd)
            call file%attach(group_path, 'global_error', g%relative)
            call file%attach(group_path, 'global_error_largest', g%largest)
            call file%attach(group_path, 'global_error_time', g%t_largest)
            call file%attach(group_path, 'global_error_is_bound', merge(1_long, 0_long, g%is_bound))
            call file%attach(group_path, 'global_error_right_hand_sides', g%right_hand_sides)
            call file%attach(group_path, 'global_error_seconds', g%seconds)
        end associate
        call find_error_warnings(simulation%options, simulation%statistics(), before)
        call find_error_warnings(simulation%options, simulation%statistics(), error_warnings, global_error)
        associate (n => size(error_warnings))
            if (n > size(before)) call file%attach(group_path, 'global_error_warning', error_warnings(n)%text)
        end associate
    end subroutine write_global_error

    !> Convert warnings to texts of equal length.
    pure function texts_of(warnings) result(texts)
        type(warning_type), intent(in) :: warnings(:)
        character(len=:), allocatable :: texts(:)
        integer :: i, longest

        longest = 1
        do i = 1, size(warnings)
            longest = max(longest, len(warnings(i)%text))
        end do
        allocate (character(len=longest) :: texts(size(warnings)))
        do i = 1, size(warnings)
            texts(i) = warnings(i)%text
        end do
    end function texts_of

    !> Write a counter.
    subroutine attach_count(self, name, number)
        class(attacher_type), intent(inout) :: self
        character(len=*), intent(in) :: name
        integer(long), intent(in) :: number

        call self%file%attach(group_path, name, number)
    end subroutine attach_count

    !> Write a number.
    subroutine attach_value(self, name, number)
        class(attacher_type), intent(inout) :: self
        character(len=*), intent(in) :: name
        real(wp), intent(in) :: number

        call self%file%attach(group_path, name, number)
    end subroutine attach_value
end module tandem_io_output_report
