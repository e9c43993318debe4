! SPDX-License-Identifier: MIT
!> Queries of a run: multipliers and energies at any state, and statistics of the whole run.
submodule(tandem_simulation) tandem_simulate_answers
    use tandem_model_timer, only: of_kinetic_energy, of_potential_energy
    implicit none (type, external)

contains

    module procedure multipliers
        integer :: stat

        lambda = 0.0_wp
        if (self%is_ready) call self%chart%find_multipliers(self%state%t, self%state%q, self%state%qd, self%state%qdd, lambda, stat)
    end procedure multipliers

    module procedure kinetic_energy
        energy = 0.0_wp
        stat = status_invalid_option
        if (.not. self%is_ready) return
        call self%energy%find(self%model, self%state%t, self%state%q, self%state%qd, self%chart%counts, energy, stat)
    end procedure kinetic_energy

    module procedure potential_energy
        energy = 0.0_wp
        stat = status_invalid_option
        if (.not. self%is_ready) return
        self%chart%counts%potential_energies = self%chart%counts%potential_energies + 1
        if (associated(self%model%state%timer)) call self%model%state%timer%begin_call(of_potential_energy)
        call self%model%potential_energy(self%state%t, self%state%q, energy, stat)
        if (associated(self%model%state%timer)) call self%model%state%timer%end_call()
    end procedure potential_energy

    module procedure statistics
        statistics_ = self%tally
        ! Stiffness is not reported once an implicit stepper has taken over.
        statistics_%is_stiff = self%auto%stiffness%is_stiff .and. self%auto%switching%switches == 0
        statistics_%stiff_from = self%auto%stiffness%since
        statistics_%stiff_steps = self%auto%stiffness%steps
        statistics_%dense_error_q = self%between%output%largest_q
        statistics_%dense_error_qd = self%between%output%largest_qd
        statistics_%event_evaluations = self%watch%evaluations
        statistics_%switches = self%auto%switching%switches
        statistics_%implicit_steps = self%auto%switching%count_implicit(self%tally%steps)
        if (associated(self%model)) statistics_%has_ready_made_model = self%model%is_ready_made
        if (associated(self%model) .and. .not. self%auto%switching%is_on) call estimate_implicit_cost(self, statistics_)
        if (allocated(self%chart)) statistics_%counts_type = self%chart%counts
        associate (local => self%local_error)
            if (local%steps == 0) return
            statistics_%local_error = local%largest
            statistics_%local_error_steps = local%steps
            ! Extrapolate the sum to steps outside of complete windows.
            statistics_%local_error_sum = local%total*real(self%tally%steps, wp)/real(local%steps, wp)
        end associate
    end procedure statistics

    !> Estimate the cost with an implicit stepper, and decide whether to advise its use. Estimates are accurate to a factor of two.
    subroutine estimate_implicit_cost(self, statistics_)
        class(simulation_type), intent(in) :: self
        type(statistics_type), intent(inout) :: statistics_
        real(wp), parameter :: worth = 0.5_wp

        associate (s => statistics_, model => self%model)
            s%implicit_part = self%auto%stiffness%part_of_implicit(s%steps + s%rejected + s%failed, self%method%stages, &
                merge(0, model%n, model%provides_derivatives == need_all_derivatives))
            if (s%implicit_part > 0.0_wp .and. s%implicit_part < worth) s%advised = implicit_advice
        end associate
    end subroutine estimate_implicit_cost
end submodule tandem_simulate_answers
