! SPDX-License-Identifier: MIT
!> Writes what a run has cost, and how wrong it was, as attributes of /report.
module tandem_io_output_report
    use tandem, only: derivative_name, find_doubts, global_error_type, long, n_derivatives, n_reasons, n_terms, reason_name, &
        simulation_type, term_name
    use tandem_io_output_hdf5, only: hdf5_type
    use tandem_simulate_warning, only: add_warning, warning_type
    implicit none (type, external)
    private

    public :: write_report, write_global_error

    character(len=*), parameter :: place = '/report'

contains

    !> Write or replace the report.
    subroutine write_report(file, simulation)
        type(hdf5_type), intent(inout) :: file
        class(simulation_type), intent(in) :: simulation
        type(warning_type), allocatable :: warnings(:), doubts(:)
        integer :: i

        associate (s => simulation%statistics())
            call file%attach(place, 'steps', s%steps)
            call file%attach(place, 'rejected', s%rejected)
            call file%attach(place, 'failed', s%failed)
            call file%attach(place, 'smallest_step', min(s%smallest_step, s%largest_step))
            call file%attach(place, 'largest_step', s%largest_step)
            call file%attach(place, 'stiff', merge(1_long, 0_long, s%is_stiff))
            call file%attach(place, 'stiff_from', s%stiff_from)
            call file%attach(place, 'stiff_steps', s%stiff_steps)
            call file%attach(place, 'charts', s%charts)
            do i = 1, n_reasons
                call file%attach(place, 'charts_by_'//as_name(reason_name(i)), s%charts_by(i))
            end do
            call file%attach(place, 'right_hand_sides', s%right_hand_sides)
            do i = 1, n_terms
                call file%attach(place, 'evaluations_'//trim(term_name(i)), s%terms(i))
            end do
            call file%attach(place, 'fused_calls', s%fused_calls)
            call file%attach(place, 'newton_matrices', s%newton_matrices)
            call file%attach(place, 'newton_factorizations', s%newton_factorizations)
            call file%attach(place, 'newton_corrections', s%newton_corrections)
            call file%attach(place, 'implicit_stages', s%implicit_stages)
            do i = 1, n_derivatives
                call file%attach(place, 'evaluations_'//trim(derivative_name(i)), s%derivatives(i))
            end do
            call file%attach(place, 'difference_evaluations', s%difference_evaluations)
            call file%attach(place, 'gamma_evaluations', s%gamma_evaluations)
            call file%attach(place, 'gamma_noise', s%gamma_noise)
            call file%attach(place, 'position_corrections', s%position_corrections)
            call file%attach(place, 'B_corrections', s%b_corrections)
            call file%attach(place, 'H_corrections', s%h_corrections)
            call file%attach(place, 'position_factorizations', s%position_factorizations)
            call file%attach(place, 'constraint_factorizations', s%constraint_factorizations)
            call file%attach(place, 'mass_factorizations', s%mass_factorizations)
            call file%attach(place, 'basis_factorizations', s%basis_factorizations)
            call file%attach(place, 'multipliers', s%multipliers)
            call file%attach(place, 'kinetic_energies', s%kinetic_energies)
            call file%attach(place, 'potential_energies', s%potential_energies)
            call file%attach(place, 'largest_position_error', s%position_error)
            call file%attach(place, 'largest_velocity_error', s%velocity_error)
            call file%attach(place, 'largest_acceleration_error', s%acceleration_error)
            call file%attach(place, 'local_error', s%local_error)
            call file%attach(place, 'local_error_sum', s%local_error_sum)
            call file%attach(place, 'local_error_steps', s%local_error_steps)
            call file%attach(place, 'dense_error', s%dense_error)
            call file%attach(place, 'velocity_gap', s%velocity_gap)
            call file%attach(place, 'start_moved_q', s%start_moved_q)
            call file%attach(place, 'start_moved_qd', s%start_moved_qd)
            call file%attach(place, 'velocity_jump', s%velocity_jump)
            call file%attach(place, 'wall_seconds', s%wall_seconds)
            call file%attach(place, 'cpu_seconds', s%cpu_seconds)
            if (allocated(simulation%events)) then
                call file%attach(place, 'events', int(simulation%n_events, long))
                call file%attach(place, 'event_evaluations', s%event_evaluations)
            end if
        end associate
        allocate (warnings(0))
        if (allocated(simulation%warnings)) warnings = simulation%warnings
        call find_doubts(simulation%options, simulation%statistics(), doubts)
        do i = 1, size(doubts)
            call add_warning(warnings, doubts(i)%text)
        end do
        if (size(warnings) > 0) call file%attach(place, 'warnings', texts_of(warnings))
    end subroutine write_report

    !> Write the error of the run, which is known, and a warning where it is large.
    subroutine write_global_error(file, simulation, global_error)
        type(hdf5_type), intent(inout) :: file
        class(simulation_type), intent(in) :: simulation
        class(global_error_type), intent(in) :: global_error
        type(warning_type), allocatable :: before(:), doubts(:)

        associate (g => global_error)
            call file%attach(place, 'global_error_q', g%error_q)
            call file%attach(place, 'global_error_qd', g%error_qd)
            call file%attach(place, 'global_error', g%relative)
            call file%attach(place, 'global_error_largest', g%largest)
            call file%attach(place, 'global_error_time', g%t_largest)
            call file%attach(place, 'global_error_is_bound', merge(1_long, 0_long, g%is_bound))
            call file%attach(place, 'global_error_right_hand_sides', g%right_hand_sides)
            call file%attach(place, 'global_error_seconds', g%seconds)
        end associate
        call find_doubts(simulation%options, simulation%statistics(), before)
        call find_doubts(simulation%options, simulation%statistics(), doubts, global_error)
        if (size(doubts) > size(before)) call file%attach(place, 'global_error_warning', doubts(size(doubts))%text)
    end subroutine write_global_error

    !> Warnings as texts of one length.
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

    !> Words as a name: blanks become underscores, bars vanish.
    pure function as_name(words) result(name)
        character(len=*), intent(in) :: words
        character(len=:), allocatable :: name
        integer :: i

        name = ''
        do i = 1, len_trim(words)
            if (words(i:i) == ' ') then
                name = name//'_'
            else if (words(i:i) /= '|') then
                name = name//words(i:i)
            end if
        end do
    end function as_name
end module tandem_io_output_report
