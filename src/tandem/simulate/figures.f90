! SPDX-License-Identifier: MIT
!> List of all statistics of a run by name. It is the only source of the attributes of reports, of JSON output, and of the
!> statistics of the C and Fortran 77 interfaces.
module tandem_simulate_figures
    use tandem_kinds, only: long, wp
    use tandem_model_derivatives, only: derivative_name, n_derivatives
    use tandem_model_terms, only: n_terms, term_name
    use tandem_simulate_statistics, only: n_reasons, reason_name, statistics_type
    implicit none (type, external)
    private

    public :: figure_reader_type, tell_figures

    !> Reader of statistics. Extend this type.
    type, abstract :: figure_reader_type
    contains
        procedure(count_interface), deferred :: count
        procedure(value_interface), deferred :: value
    end type figure_reader_type

    abstract interface
        !> Receive a counter.
        subroutine count_interface(self, name, number)
            import :: figure_reader_type, long
            implicit none (type, external)
            class(figure_reader_type), intent(inout) :: self
            !> Name in lower case, except for B and H.
            character(len=*), intent(in) :: name
            integer(long), intent(in) :: number
        end subroutine count_interface

        !> Receive a number.
        subroutine value_interface(self, name, number)
            import :: figure_reader_type, wp
            implicit none (type, external)
            class(figure_reader_type), intent(inout) :: self
            character(len=*), intent(in) :: name
            real(wp), intent(in) :: number
        end subroutine value_interface
    end interface

contains

    !> Pass all statistics to a reader; see `statistics_type` and `counts_type` for their meaning.
    subroutine tell_figures(s, reader)
        type(statistics_type), intent(in) :: s
        class(figure_reader_type), intent(inout) :: reader
        integer :: i

        call reader%count('steps', s%steps)
        call reader%count('rejected', s%rejected)
        call reader%count('failed', s%failed)
        call reader%value('smallest_step', min(s%smallest_step, s%largest_step))
        call reader%value('largest_step', s%largest_step)
        call reader%count('stiff', merge(1_long, 0_long, s%is_stiff))
        call reader%value('stiff_from', s%stiff_from)
        call reader%count('stiff_steps', s%stiff_steps)
        call reader%value('implicit_part', s%implicit_part)
        call reader%count('switches', s%switches)
        call reader%count('implicit_steps', s%implicit_steps)
        call reader%count('charts', s%charts)
        do i = 1, n_reasons
            call reader%count('charts_by_'//trim(as_name(reason_name(i))), s%charts_by(i))
        end do
        call reader%count('right_hand_sides', s%right_hand_sides)
        do i = 1, n_terms
            call reader%count('evaluations_'//trim(term_name(i)), s%terms(i))
        end do
        call reader%count('fused_calls', s%fused_calls)
        call reader%count('start_evaluations', s%start_evaluations)
        call reader%count('newton_matrices', s%newton_matrices)
        call reader%count('newton_factorizations', s%newton_factorizations)
        call reader%count('newton_corrections', s%newton_corrections)
        call reader%count('implicit_stages', s%implicit_stages)
        do i = 1, n_derivatives
            call reader%count('evaluations_'//trim(derivative_name(i)), s%derivatives(i))
        end do
        call reader%count('difference_evaluations', s%difference_evaluations)
        call reader%count('gamma_evaluations', s%gamma_evaluations)
        call reader%value('gamma_noise', s%gamma_noise)
        call reader%count('position_corrections', s%position_corrections)
        call reader%count('B_corrections', s%b_corrections)
        call reader%count('H_corrections', s%h_corrections)
        call reader%count('position_factorizations', s%position_factorizations)
        call reader%count('constraint_factorizations', s%constraint_factorizations)
        call reader%count('mass_factorizations', s%mass_factorizations)
        call reader%count('basis_factorizations', s%basis_factorizations)
        call reader%count('multipliers', s%multipliers)
        call reader%count('kinetic_energies', s%kinetic_energies)
        call reader%count('potential_energies', s%potential_energies)
        call reader%value('largest_position_error', s%position_error)
        call reader%value('largest_velocity_error', s%velocity_error)
        call reader%value('largest_acceleration_error', s%acceleration_error)
        call reader%value('local_error', s%local_error)
        call reader%value('local_error_sum', s%local_error_sum)
        call reader%count('local_error_steps', s%local_error_steps)
        call reader%value('dense_error', max(s%dense_error_q, s%dense_error_qd))
        call reader%value('dense_error_q', s%dense_error_q)
        call reader%value('dense_error_qd', s%dense_error_qd)
        call reader%value('velocity_gap', s%velocity_gap)
        call reader%value('t_gap', s%t_gap)
        call reader%value('start_moved_q', s%start_moved_q)
        call reader%value('start_moved_qd', s%start_moved_qd)
        call reader%value('velocity_jump', s%velocity_jump)
        call reader%count('crossings', s%crossings)
        call reader%value('crossing_error', s%crossing_error)
        call reader%count('event_evaluations', s%event_evaluations)
        call reader%value('wall_seconds', s%wall_seconds)
        call reader%value('cpu_seconds', s%cpu_seconds)
    end subroutine tell_figures

    !> Convert a text to a name: blanks become underscores, vertical bars are removed.
    pure function as_name(words) result(name)
        character(len=*), intent(in) :: words
        ! A deferred length would be static memory, which threads would share.
        character(len=len_trim(words)) :: name
        integer :: i, n

        name = ''
        n = 0
        do i = 1, len(name)
            if (words(i:i) == '|') cycle
            n = n + 1
            name(n:n) = merge('_', words(i:i), words(i:i) == ' ')
        end do
    end function as_name
end module tandem_simulate_figures
