! SPDX-License-Identifier: MIT
!> Statistics by name, for callers who cannot see `statistics_type`: all its scalar components, those of `counts_type` among them,
!> by their names, and the number of redundant rows. tools/interface.py compares the list with the types. And all that a run has to
!> warn of.
module tandem_legacy_figures
    use tandem_error, only: error_type, set_error
    use tandem_kinds, only: wp
    use tandem_legacy_settings, only: lower_case
    use tandem_simulate_error_warnings, only: find_error_warnings
    use tandem_simulate_warning, only: add_warning, warning_type
    use tandem_simulation, only: simulation_type
    use tandem_status, only: status_invalid_option
    implicit none (type, external)
    private

    public :: find_warnings, get_figure

    character(len=*), parameter :: names = 'steps, rejected, failed, smallest_step, largest_step, charts, position_error, '// &
        'velocity_error, acceleration_error, start_moved_q, start_moved_qd, velocity_jump, wall_seconds, cpu_seconds, '// &
        'right_hand_sides, position_corrections, b_corrections, h_corrections, position_factorizations, '// &
        'constraint_factorizations, mass_factorizations, basis_factorizations, fused_calls, newton_matrices, '// &
        'newton_factorizations, newton_corrections, implicit_stages, difference_evaluations, gamma_evaluations, gamma_noise, '// &
        'n_redundant, local_error, local_error_sum, local_error_steps, velocity_gap, t_gap, dense_error, is_stiff, '// &
        'stiff_from, stiff_steps, start_evaluations, multipliers, kinetic_energies, potential_energies, event_evaluations'

contains

    !> One figure of a run; counters are exact up to 2**53.
    subroutine get_figure(simulation, name, value, error)
        !> The run.
        type(simulation_type), intent(in) :: simulation
        !> Name of a component, in either case.
        character(len=*), intent(in) :: name
        !> Its value; 0 where there is no such figure.
        real(wp), intent(out) :: value
        !> invalid_option where there is no such figure.
        type(error_type), allocatable, intent(out) :: error

        value = 0.0_wp
        associate (s => simulation%statistics())
            select case (lower_case(name))
            case ('steps'); value = real(s%steps, wp)
            case ('rejected'); value = real(s%rejected, wp)
            case ('failed'); value = real(s%failed, wp)
            case ('smallest_step'); if (s%steps > 0) value = s%smallest_step
            case ('largest_step'); value = s%largest_step
            case ('charts'); value = real(s%charts, wp)
            case ('position_error'); value = s%position_error
            case ('velocity_error'); value = s%velocity_error
            case ('acceleration_error'); value = s%acceleration_error
            case ('start_moved_q'); value = s%start_moved_q
            case ('start_moved_qd'); value = s%start_moved_qd
            case ('velocity_jump'); value = s%velocity_jump
            case ('wall_seconds'); value = s%wall_seconds
            case ('cpu_seconds'); value = s%cpu_seconds
            case ('right_hand_sides'); value = real(s%right_hand_sides, wp)
            case ('position_corrections'); value = real(s%position_corrections, wp)
            case ('b_corrections'); value = real(s%b_corrections, wp)
            case ('h_corrections'); value = real(s%h_corrections, wp)
            case ('position_factorizations'); value = real(s%position_factorizations, wp)
            case ('constraint_factorizations'); value = real(s%constraint_factorizations, wp)
            case ('mass_factorizations'); value = real(s%mass_factorizations, wp)
            case ('basis_factorizations'); value = real(s%basis_factorizations, wp)
            case ('fused_calls'); value = real(s%fused_calls, wp)
            case ('newton_matrices'); value = real(s%newton_matrices, wp)
            case ('newton_factorizations'); value = real(s%newton_factorizations, wp)
            case ('newton_corrections'); value = real(s%newton_corrections, wp)
            case ('implicit_stages'); value = real(s%implicit_stages, wp)
            case ('difference_evaluations'); value = real(s%difference_evaluations, wp)
            case ('gamma_evaluations'); value = real(s%gamma_evaluations, wp)
            case ('gamma_noise'); value = s%gamma_noise
            case ('n_redundant'); value = real(simulation%n_redundant, wp)
            case ('local_error'); value = s%local_error
            case ('local_error_sum'); value = s%local_error_sum
            case ('local_error_steps'); value = real(s%local_error_steps, wp)
            case ('velocity_gap'); value = s%velocity_gap
            case ('t_gap'); value = s%t_gap
            case ('dense_error'); value = s%dense_error
            case ('is_stiff'); value = merge(1.0_wp, 0.0_wp, s%is_stiff)
            case ('stiff_from'); value = s%stiff_from
            case ('stiff_steps'); value = real(s%stiff_steps, wp)
            case ('start_evaluations'); value = real(s%start_evaluations, wp)
            case ('multipliers'); value = real(s%multipliers, wp)
            case ('kinetic_energies'); value = real(s%kinetic_energies, wp)
            case ('potential_energies'); value = real(s%potential_energies, wp)
            case ('event_evaluations'); value = real(s%event_evaluations, wp)
            case default
                call set_error(error, status_invalid_option, '"'//trim(name)//'" is not a statistic', 'there are '//names)
            end select
        end associate
    end subroutine get_figure

    !> What a report would warn of: what the run has noticed, then what there is to doubt about its errors.
    subroutine find_warnings(simulation, warnings)
        !> The run.
        type(simulation_type), intent(in) :: simulation
        !> None where all is well.
        type(warning_type), allocatable, intent(out) :: warnings(:)
        type(warning_type), allocatable :: doubts(:)
        integer :: i

        allocate (warnings(0))
        if (allocated(simulation%warnings)) then
            do i = 1, size(simulation%warnings)
                call add_warning(warnings, simulation%warnings(i)%text)
            end do
        end if
        call find_error_warnings(simulation%options, simulation%statistics(), doubts)
        do i = 1, size(doubts)
            call add_warning(warnings, doubts(i)%text)
        end do
    end subroutine find_warnings
end module tandem_legacy_figures
