! SPDX-License-Identifier: MIT
!> Implicit stages: the Newton matrix, its use, and the filter of errors.
submodule(tandem_chart_dense) tandem_chart_dense_implicit_stage
    implicit none (type, external)

contains

    module procedure do_factor
        self%failure%row = 0
        call self%stage%expect_pairs(ratios)
        call self%move_with(t, q, qd, stat)
        if (stat == status_ok) call self%complete_velocity_basis(stat)
        if (stat /= status_ok) return
        associate (terms => self%model%terms, r => self%velocity_basis%right_inverse, d => self%velocity_basis%null_space)
            call self%dynamics%multipliers(terms%mass, r, terms%force, qdd, self%work%lambda)
            if (allocated(self%rows%dropped)) then
                call self%rows%expand(self%model%kept, self%work%lambda)
                call self%differences%evaluate_derivatives(t, q, qd, qdd, self%rows%lambda, self%rows%derivatives, self%counts, &
                    stat)
                call self%rows%take(self%model%kept, self%derivatives)
            else
                call self%differences%evaluate_derivatives(t, q, qd, qdd, self%work%lambda, self%derivatives, self%counts, stat)
            end if
            if (stat /= status_ok) then
                self%failure%term = 'a derivative'
                return
            end if
            if (self%follows_stiffness) call self%metric%load(terms%mass, self%derivatives%dynamics_qd, &
                self%derivatives%dynamics_q, self%basis_scale, self%scale)
            call follow_stiffness(self, ha)
            call self%complete_velocity_basis(stat)
            if (stat /= status_ok) return
            call self%position%get_b_phi(terms%jacobian, self%work%b_phi, self%counts, stat)
            if (stat /= status_ok) return
            if (self%friction%n > 0) then
                call self%friction%find_left_basis(self%model, self%dynamics, d, r, stat)
                if (stat /= status_ok) return
                call form(self%friction%left_basis)
            else
                call form(d)
            end if
            call self%stage%factor(ha, stat)
        end associate
        self%stage_segment = self%model%segment()
        self%counts%newton_matrices = self%counts%newton_matrices + 1
        self%counts%newton_factorizations = self%counts%newton_factorizations + 1

    contains

        !> The matrix, with a matrix to the left of the gradients of the dynamics.
        subroutine form(left_basis)
            real(wp), intent(in), contiguous :: left_basis(:, :)

            call self%stage%form(self%model%terms, self%derivatives, self%bases, self%position%u_basis(:, :self%nh), &
                self%work%b_phi, self%velocity_basis, left_basis, .not. self%metric%is_on)
        end subroutine form
    end procedure do_factor

    module procedure do_reuse
        call self%stage%expect_pairs(ratios)
        can = self%stage_segment == self%model%segment()
        if (.not. can) return
        call follow_stiffness(self, ha)
        call self%stage%adapt(ha, self%bases, &
            self%counts%newton_factorizations, can)
    end procedure do_reuse

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

    !> One correction per level with factors of the stage's first iterate, or restored points.
    module procedure do_find_residual
        !> Change of a stage's coordinates, relative to them, after which its factors are made again.
        real(wp), parameter :: far = 1.0e-3_wp

        self%failure%row = 0
        self%may_lean = .false.
        if (restores(self)) then
            call self%restore_position(t, increment(:, 1), step_end, q, stat)
            if (stat == status_ok) call self%restore_velocity(t, q, increment(:, 2), step_end, qd, stat)
            if (stat == status_ok) call residual_at(self, t, q, qd, rate, residual, stat)
            return
        end if
        associate (iterate => self%iterates(goal%stage), terms => self%model%terms)
            ! Factors are made again after large changes, which the factors of the first iterate would follow too slowly.
            if (goal%is_first .or. iterate%drift > far) then
                call begin_stage(self, iterate, t, increment(:, 1), q, stat)
            else
                call continue_stage(self, iterate, t, increment(:, 1), q, stat)
            end if
            if (stat /= status_ok) return
            qd = self%qd0 + increment(:, 2)
            if (self%m > 0) call iterate%correct_velocity(terms%jacobian, terms%nu, self%bases%x, qd)
            call self%move_with(t, q, qd, stat)
            if (stat /= status_ok) return
            call self%stage%find_residual(terms, self%velocity_basis, self%bases, qd, rate(:, 1), rate(:, 2), self%work%change_q, &
                iterate)
            call self%stage%get_residual(residual)
        end associate
    end procedure do_find_residual

    !> True if iterates are restored completely: also close to a loss of rank, where small errors of a point are large ones of its
    !> rates.
    pure logical function restores(self)
        class(dense_chart_type), intent(in) :: self
        !> Part of the largest independence so far.
        real(wp), parameter :: close = 1.0e-2_wp

        restores = self%mode%restores_iterates .or. self%independence < close*self%best_independence
    end function restores

    !> The residual of a stage at a restored point.
    subroutine residual_at(self, t, q, qd, rate, residual, stat)
        class(dense_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:)
        real(wp), intent(inout), contiguous :: rate(:, :), residual(:)
        integer, intent(out) :: stat

        call self%move_with(t, q, qd, stat)
        if (stat == status_ok) call self%find_velocity_basis(stat)
        if (stat /= status_ok) return
        call self%stage%find_residual(self%model%terms, self%velocity_basis, self%bases, qd, rate(:, 1), rate(:, 2), &
            self%work%change_q)
        call self%stage%get_residual(residual)
    end subroutine residual_at

    !> The first iterate of a stage: from predicted coordinates, brought near the manifold.
    subroutine begin_stage(self, iterate, t, increment, q, stat)
        class(dense_chart_type), intent(inout) :: self
        type(stage_iterate_type), intent(inout) :: iterate
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: increment(:)
        !> Predicted coordinates (n), then those of the iterate.
        real(wp), intent(inout), contiguous :: q(:)
        integer, intent(out) :: stat
        logical :: is_near
        integer :: j

        stat = status_ok
        is_near = .true.
        if (self%nh > 0) then
            ! The basis of range(Phi_q') is the dual of U, which vanishes on V.
            self%work%trial = (self%q0 + increment - q)/self%basis_scale
            do j = 1, self%nh
                self%position%u(j) = dot_product(self%basis%q(:, j), self%work%trial)
            end do
        end if
        q = self%q0 + increment
        if (self%nh > 0) then
            call approach(self, iterate, t, q, stat)
            is_near = stat == status_ok
            if (.not. is_near) then
                ! The prediction is not used again: it may not even be finite.
                self%position%u = 0.0_wp
                call self%restore_position(t, increment, step_end, q, stat)
                if (stat /= status_ok) return
                iterate%u = self%position%u(:self%nh)
            end if
        end if
        call self%move_to(t, q, stat)
        if (stat == status_ok .and. .not. is_near) call iterate%factor_position(self%model%terms%jacobian, &
            self%position%u_basis(:, :self%nh), stat)
        if (stat /= status_ok) return
        call iterate%factor_velocity(self%model%terms%jacobian, self%bases%x, stat)
        iterate%moved_q = 0.0_wp
        iterate%drift = 0.0_wp
        self%counts%constraint_factorizations = self%counts%constraint_factorizations + min(self%m, 1)
    end subroutine begin_stage

    !> Bring predicted coordinates near the manifold, by the factor of Phi_q U there: one correction squares a small error.
    subroutine approach(self, iterate, t, q, stat)
        class(dense_chart_type), intent(inout) :: self
        type(stage_iterate_type), intent(inout) :: iterate
        real(wp), intent(in) :: t
        !> q0 + xi, then the coordinates (n).
        real(wp), intent(inout), contiguous :: q(:)
        integer, intent(out) :: stat
        !> Largest correction whose square may be left, in coordinate scales; largest number of corrections; slowest contraction.
        real(wp), parameter :: small = 1.0e-3_wp, slow = 0.5_wp
        integer, parameter :: most = 8
        real(wp) :: error, last_size, size_now
        integer :: j, k

        iterate%u = self%position%u(:self%nh)
        associate (u_basis => self%position%u_basis(:, :self%nh))
            call add_product(u_basis, iterate%u, -1.0_wp, q)
            last_size = huge(1.0_wp)
            do k = 1, most
                call self%model%evaluate_phi(t, q, self%counts, stat)
                if (stat == status_ok .and. k == 1) then
                    call self%move_to(t, q, stat)
                    if (stat == status_ok) call iterate%factor_position(self%model%terms%jacobian, u_basis, stat)
                    self%counts%position_factorizations = self%counts%position_factorizations + 1
                end if
                if (stat /= status_ok) return
                size_now = 0.0_wp
                call self%position%judge(self%model%terms%phi, error)
                stat = status_position_diverged
                if (.not. error <= huge(1.0_wp)) return
                ! Corrections by rounding would accumulate from stage to stage with a wrong Jacobian.
                if (self%position%is_restored(error)) exit
                call iterate%correct_position(self%model%terms%phi, u_basis, q)
                self%counts%position_corrections = self%counts%position_corrections + 1
                do j = 1, self%n
                    size_now = max(size_now, abs(iterate%moved_q(j))/self%scale(j))
                end do
                if (size_now <= small) exit
                if (.not. size_now < slow*last_size) return
                last_size = size_now
            end do
        end associate
        stat = status_ok
        self%position%u(:self%nh) = iterate%u
        self%point%has_phi = .false.
    end subroutine approach

    !> A later iterate.
    subroutine continue_stage(self, iterate, t, increment, q, stat)
        class(dense_chart_type), intent(inout) :: self
        type(stage_iterate_type), intent(inout) :: iterate
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: increment(:)
        real(wp), intent(inout), contiguous :: q(:)
        integer, intent(out) :: stat
        real(wp) :: error

        stat = status_ok
        q = self%q0 + increment
        if (self%nh > 0) then
            associate (u_basis => self%position%u_basis(:, :self%nh))
                call add_product(u_basis, iterate%u, -1.0_wp, q)
                call self%model%evaluate_phi(t, q, self%counts, stat)
                if (stat /= status_ok) then
                    call self%fail_term()
                    return
                end if
                iterate%moved_q = 0.0_wp
                call self%position%judge(self%model%terms%phi, error)
                if (.not. self%position%is_restored(error)) then
                    call iterate%correct_position(self%model%terms%phi, u_basis, q)
                    self%counts%position_corrections = self%counts%position_corrections + 1
                end if
            end associate
            self%position%u(:self%nh) = iterate%u
            self%point%has_phi = .false.
        end if
        call self%move_to(t, q, stat)
    end subroutine continue_stage

    module procedure do_solve
        call self%stage%solve_real(self%bases, x)
    end procedure do_solve

    module procedure do_solve_pair
        call self%stage%solve_pair(self%bases, k, x, y)
    end procedure do_solve_pair

    !> Add the correction, measure its size, and check that the rates are finite.
    module procedure do_update
        real(wp) :: left, turned, sum_of_rates, unit_q, unit_qd
        integer :: j

        stat = status_ok
        call self%stage%move_rates(self%bases, correction, rate(:, 1), rate(:, 2), self%work%change_q, &
            self%work%change_qd)
        self%counts%newton_corrections = self%counts%newton_corrections + 1
        change = 0.0_wp
        turned = 0.0_wp
        left = 0.0_wp
        sum_of_rates = 0.0_wp
        associate (iterate => self%iterates(stage))
            do j = 1, self%n
                unit_q = 1.0_wp/max(abs(q(j)), self%scale(j))
                unit_qd = 1.0_wp/max(abs(qd(j)), self%rate*self%scale(j))
                turned = max(turned, abs(ha*self%work%change_q(j))*unit_q)
                change = max(change, abs(ha*self%work%change_qd(j))*unit_qd)
                left = max(left, abs(iterate%moved_q(j))*unit_q, &
                    max(abs(iterate%moved_qd(j)), abs(ha*iterate%moved_qdd(j)))*unit_qd)
                sum_of_rates = sum_of_rates + (abs(rate(j, 1)) + abs(rate(j, 2)))
            end do
            change = max(change, turned)
            if (.not. sum_of_rates <= huge(1.0_wp)) then
                stat = status_not_finite
                call self%name_infinite(stat)
            end if
            if (restores(self)) return
            ! The factors miss the part of the point's last corrections by which C has turned since.
            change = max(change, min(iterate%drift, 1.0_wp)*left)
            iterate%drift = iterate%drift + turned
        end associate
    end procedure do_update

    module procedure do_filter
        call self%stage%filter(self%bases, error_q, error_qd)
        if (self%point%has_velocity_basis) call self%stage%restore_error(self%model%terms%jacobian, self%velocity_basis, &
            self%bases%x, error_qd)
    end procedure do_filter
end submodule tandem_chart_dense_implicit_stage
