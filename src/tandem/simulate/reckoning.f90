! SPDX-License-Identifier: MIT
!> What a run has cost so far, and what another stepper would have.
submodule(tandem_simulation) tandem_simulate_reckoning
    implicit none (type, external)

contains

    module procedure statistics
        statistics_ = self%tally
        ! Where an implicit stepper has taken over, that was heeded.
        statistics_%is_stiff = self%stiffness%is_stiff .and. self%switching%switches == 0
        statistics_%stiff_from = self%stiffness%since
        statistics_%stiff_steps = self%stiffness%steps
        statistics_%switches = self%switching%switches
        statistics_%implicit_steps = self%switching%count_implicit(self%tally%steps)
        if (associated(self%model) .and. .not. self%switching%is_on) call weigh_implicit(self, statistics_)
        if (allocated(self%chart)) statistics_%counts_type = self%chart%counts
        associate (local => self%local_error)
            if (local%steps == 0) return
            statistics_%local_error = local%largest
            statistics_%local_error_steps = local%steps
            ! Steps in no full window count like the others.
            statistics_%local_error_sum = local%total*real(self%tally%steps, wp)/real(local%steps, wp)
        end associate
    end procedure statistics

    !> What an implicit stepper would have cost, and whether it is worth advice: estimates are right to a factor of two.
    subroutine weigh_implicit(self, statistics_)
        class(simulation_type), intent(in) :: self
        type(statistics_type), intent(inout) :: statistics_
        real(wp), parameter :: worth = 0.5_wp

        associate (s => statistics_, model => self%model)
            s%implicit_part = self%stiffness%part_of_implicit(s%steps + s%rejected + s%failed, self%method%stages, &
                merge(0, model%n, model%provides_derivatives == need_all_derivatives))
            if (s%implicit_part > 0.0_wp .and. s%implicit_part < worth) s%advised = implicit_advice
        end associate
    end subroutine weigh_implicit
end submodule tandem_simulate_reckoning
