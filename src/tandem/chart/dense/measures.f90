! SPDX-License-Identifier: MIT
!> Measures along a step: independence and turn of C, and the distance from the origin for policies.
submodule(tandem_chart_dense) tandem_chart_dense_measures
    implicit none (type, external)

contains

    module procedure do_measure
        stat = status_ok
        if (iand(need, need_rank) /= 0) call self%measure_rank(t_from, q_from, t, q, measure, stat)
        if (iand(need, need_line) /= 0) stat = self%find_loss_ahead(t_from, q_from, t, q)
        if (iand(need, need_policy) /= 0) call measure_policy(self, t, q, qd, measure, stat)
        if (iand(need, need_independence) /= 0) call self%measure_independence(t, q, measure%independence, stat)
        if (stat /= status_ok .or. iand(need, need_change + need_contraction) == 0 .or. self%m == 0) return
        call self%move_to(t, q, stat)
        if (stat /= status_ok) return
        if (iand(need, need_change) /= 0) measure%change = self%change_from(self%start%jacobian)
        if (iand(need, need_contraction) /= 0) then
            self%work%trial = q - q_from
            measure%contraction = self%position%contraction(self%start%jacobian, self%model%terms%jacobian, self%work%trial, &
                least_bend)
        end if
    end procedure do_measure

    !> |v|, |w|, the condition and the iterations, or |D| and |Fbar|.
    subroutine measure_policy(self, t, q, qd, measure, stat)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:)
        type(measure_type), intent(inout) :: measure
        integer, intent(out) :: stat

        self%failure%row = 0
        call self%move_to(t, q, stat)
        if (stat == status_ok .and. self%watch%condition) call self%complete_velocity_basis(stat)
        if (stat /= status_ok) return
        measure%corrections = max(self%position%most_corrections, self%velocity_basis%most_corrections)
        self%position%most_corrections = 0
        self%velocity_basis%most_corrections = 0
        associate (terms => self%model%terms, watch => self%watch)
            if (watch%v) measure%v = length_outside(self%basis%q(:, :self%nh), (q - self%q0)/self%basis_scale)
            if (watch%w) measure%w = length_outside(self%basis%q(:, :self%m), (qd - self%qd0)/self%basis_scale)
            if (watch%condition .and. self%mode%is_implicit) then
                ! The condition number of the reduced Newton matrix (81).
                measure%condition = 1.0_wp/max(self%stage%reciprocal_condition(), tiny(1.0_wp))
            else if (watch%condition) then
                call watch%condition_of(terms%mass, self%velocity_basis%null_space, terms%jacobian, measure%condition)
            end if
            if (watch%secants) then
                self%counts%basis_factorizations = self%counts%basis_factorizations + 1
                call watch%measure_secants(terms%jacobian, self%basis_scale, self%basis%q(:, :self%m), measure%d, measure%fbar)
            end if
        end associate
    end subroutine measure_policy
end submodule tandem_chart_dense_measures
