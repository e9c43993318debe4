! SPDX-License-Identifier: MIT
!> Implicit stages: the Newton matrix, its use, and the filter of errors.
submodule(tandem_chart_dense) tandem_chart_dense_implicit_stage
    implicit none (type, external)

contains

    module procedure factor_stage
        self%failed_row = 0
        call self%move_with(t, q, qd, stat)
        if (stat == status_ok) call self%complete_velocity_basis(stat)
        if (stat /= status_ok) return
        associate (terms => self%model%terms, r => self%velocity_basis%right_inverse, d => self%velocity_basis%null_space)
            call self%dynamics%multipliers(terms%mass, r, terms%force, qdd, self%lambda)
            call self%rows%evaluate_derivatives(self%differences, self%model%kept, t, q, qd, qdd, self%lambda, &
                self%derivatives, self%counts, stat)
            if (stat /= status_ok) then
                self%failed_term = 'a derivative'
                return
            end if
            if (self%follows_stiffness) call self%metric%load(terms%mass, self%derivatives%dynamics_qd, &
                self%derivatives%dynamics_q, self%basis_scale, self%scale)
            call follow_stiffness(self, ha)
            call self%complete_velocity_basis(stat)
            if (stat /= status_ok) return
            call self%position%get_b_phi(terms%jacobian, self%b_phi, self%counts, stat)
            if (stat /= status_ok) return
            if (self%friction%n > 0) then
                call self%friction%find_left_basis(self%model, self%dynamics, d, r, stat)
                if (stat /= status_ok) return
                call self%stage%form(terms, self%derivatives, self%v_basis, self%v_dual, self%w_basis, self%w_dual, &
                    self%position%u_basis(:, :self%nh), self%b_phi, d, self%friction%left_basis, r, .not. self%metric%is_on)
            else
                call self%stage%form(terms, self%derivatives, self%v_basis, self%v_dual, self%w_basis, self%w_dual, &
                    self%position%u_basis(:, :self%nh), self%b_phi, d, d, r, .not. self%metric%is_on)
            end if
            call self%stage%factor(ha, stat)
        end associate
        self%stage_segment = self%model%segment()
        self%counts%newton_matrices = self%counts%newton_matrices + 1
        self%counts%newton_factorizations = self%counts%newton_factorizations + 1
    end procedure factor_stage

    module procedure reuse_stage
        can = self%stage_segment == self%model%segment()
        if (.not. can) return
        call follow_stiffness(self, ha)
        call self%stage%adapt(ha, self%v_basis, self%v_dual, self%w_basis, self%w_dual, self%counts%newton_factorizations, can)
    end procedure reuse_stage

    !> Adapt the chart's complements to the metric for ha. Other complements define another chart: not within a step.
    subroutine follow_stiffness(self, ha)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: ha
        logical :: has_changed

        if (.not. (self%follows_stiffness .and. self%may_lean) .or. self%m == 0) return
        call self%metric%set(ha, self%basis%q(:, :self%m), self%basis%q(:, self%m + 1:), has_changed)
        if (.not. has_changed) return
        call self%place_bases()
        call self%stage%enter_chart(.not. self%metric%is_on)
        ! X has changed, and R and D with it.
        call self%point%forget_velocity_basis()
    end subroutine follow_stiffness

    !> Cost of a new Newton matrix, in corrections.
    module procedure matrix_cost
        matrix_cost = self%cost
    end procedure matrix_cost

    module procedure correct_stage
        self%failed_row = 0
        self%may_lean = .false.
        change = 0.0_wp
        call self%move_with(t, q, qd, stat)
        if (stat == status_ok) call self%find_velocity_basis(stat)
        if (stat /= status_ok) return
        call self%stage%correct(self%model%terms, self%velocity_basis, self%v_basis, self%v_dual, self%x_basis, self%w_basis, &
            self%w_dual, qd, rate_q, rate_qd, self%change_q, self%change_qd)
        call judge_correction(self, q, qd, ha, rate_q, rate_qd, change, stat)
    end procedure correct_stage

    !> Measure the size of the last correction, and check that the rates are finite.
    subroutine judge_correction(self, q, qd, ha, rate_q, rate_qd, change, stat)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in), contiguous :: q(:), qd(:), rate_q(:), rate_qd(:)
        real(wp), intent(in) :: ha
        real(wp), intent(out) :: change
        integer, intent(out) :: stat
        integer :: j

        stat = status_ok
        change = 0.0_wp
        do j = 1, self%n
            change = max(change, abs(ha*self%change_q(j))/max(abs(q(j)), self%scale(j)), &
                abs(ha*self%change_qd(j))/max(abs(qd(j)), self%rate*self%scale(j)))
        end do
        if (.not. sum(abs(rate_qd)) + sum(abs(rate_q)) <= huge(1.0_wp)) then
            stat = status_not_finite
            call self%name_infinite(stat)
        end if
        self%counts%newton_corrections = self%counts%newton_corrections + 1
    end subroutine judge_correction

    module procedure expect_pairs
        call self%stage%expect_pairs(ratios)
    end procedure expect_pairs

    !> The residual of a stage at the restored point. This chart stores nothing under the number of the stage.
    module procedure find_residual
        self%failed_row = 0
        self%may_lean = .false.
        call self%move_with(t, q, qd, stat)
        if (stat == status_ok) call self%find_velocity_basis(stat)
        if (stat /= status_ok) return
        call self%stage%find_residual(self%model%terms, self%velocity_basis, self%v_basis, self%v_dual, self%x_basis, &
            self%w_basis, self%w_dual, qd, rate_q, rate_qd, self%change_q)
        call self%stage%get_residual(residual)
    end procedure find_residual

    module procedure solve_real
        call self%stage%solve_real(self%v_basis, self%v_dual, self%w_basis, self%w_dual, x)
    end procedure solve_real

    module procedure solve_pair
        call self%stage%solve_pair(self%v_basis, self%v_dual, self%w_basis, self%w_dual, k, x, y)
    end procedure solve_pair

    module procedure move_rates
        call self%stage%move_rates(self%v_basis, self%w_basis, correction, rate_q, rate_qd, self%change_q, self%change_qd)
        call judge_correction(self, q, qd, ha, rate_q, rate_qd, change, stat)
    end procedure move_rates

    module procedure filter_error
        call self%stage%filter(self%v_basis, self%v_dual, self%w_basis, self%w_dual, error_q, error_qd)
        if (self%point%has_velocity_basis) call self%stage%restore_error(self%model%terms%jacobian, self%velocity_basis, &
            self%x_basis, error_qd)
    end procedure filter_error
end submodule tandem_chart_dense_implicit_stage
