! SPDX-License-Identifier: MIT
!> Last attempts to solve the stages of a step of Radau IIA with three stages before it fails.
submodule(tandem_stepper_radau) tandem_stepper_radau_rescue
    use tandem_stepper_radau_tableau, only: a => a3
    implicit none (type, external)

    !> A = L U, where U has a unit diagonal; l(:, i) is the row of stage i.
    real(wp), parameter :: u12 = a(2, 1)/a(1, 1), u13 = a(3, 1)/a(1, 1), l22 = a(2, 2) - a(1, 2)*u12, &
        l32 = a(2, 3) - a(1, 3)*u12, u23 = (a(3, 2) - a(1, 2)*u13)/l22
    real(wp), parameter :: l(3, 3) = reshape([a(1, 1), 0.0_wp, 0.0_wp, a(1, 2), l22, 0.0_wp, &
        a(1, 3), l32, a(3, 3) - a(1, 3)*u13 - l32*u23], [3, 3])

    !> Largest number of corrections of an iteration that does not begin with a prediction. Many corrections cost less than a failed
    !> step.
    integer, parameter :: many = 60

contains

    module procedure rescue
        !> Largest number of matrices made at the middle of the step.
        integer, parameter :: most_matrices = 2
        integer :: k

        call continue_from_short(self, chart, state, h, t_end, stat)
        do k = 1, most_matrices
            if (stat /= status_newton_failed) exit
            ! The motion at the middle of the last iterate may be closer to the stages than the extrapolation.
            associate (m => self%tableau)
                call self%newton%renew(chart, state%t + m%c(2)*h, self%q(:, 2), self%qd(:, 2), self%rate(:, 2, 2), &
                    m%diagonal*h, stat)
            end associate
            self%newton%is_outdated = .true.
            if (stat /= status_ok) exit
            call start_all_stages(self, state%q, state%qd, state%qdd)
            call self%iterate(chart, h, t_end, many, stat)
        end do
        if (stat == status_newton_failed) then
            call start_all_stages(self, state%q, state%qd, state%qdd)
            call sweep_stages(self, chart, h, t_end, stat)
        end if
    end procedure rescue

    !> Find start values from the ends of shorter steps, each four times as long as the previous one; the last one is the step
    !> itself. At the end of a short step a fast transient has decayed, whereas extrapolating the rates at the start would continue
    !> it.
    subroutine continue_from_short(self, chart, state, h, t_end, stat)
        class(radau_type), intent(inout) :: self
        class(implicit_chart_type), intent(inout) :: chart
        type(state_type), intent(in) :: state
        real(wp), intent(in) :: h, t_end
        integer, intent(out) :: stat
        integer, parameter :: most_quarters = 3
        real(wp) :: part, t
        logical :: can
        integer :: k

        stat = status_newton_failed
        do k = most_quarters, 0, -1
            if (stat == status_ok) then
                call start_all_stages(self, self%q(:, 3), self%rate(:, 1, 3), self%rate(:, 2, 3))
            else
                call start_all_stages(self, state%q, state%qd, state%qdd)
            end if
            part = h*0.25_wp**k
            t = state%t + part
            if (k == 0) t = t_end
            call chart%reuse(self%tableau%diagonal*part, self%newton%ratios, can)
            stat = status_ok
            if (.not. can) call self%newton%renew(chart, state%t, state%q, state%qd, state%qdd, self%tableau%diagonal*part, stat)
            if (stat == status_ok) call self%iterate(chart, part, t, many, stat)
        end do
    end subroutine continue_from_short

    !> Use the same coordinates and rates as start values for all stages.
    subroutine start_all_stages(self, q, rate_q, rate_qd)
        class(radau_type), intent(inout) :: self
        real(wp), intent(in) :: q(size(self%increment, 1)), rate_q(size(self%increment, 1)), rate_qd(size(self%increment, 1))
        integer :: i

        do i = 3, 1, -1
            self%q(:, i) = q
            self%rate(:, 1, i) = rate_q
            self%rate(:, 2, i) = rate_qd
        end do
    end subroutine start_all_stages

    !> Solve the stages one after the other, each with its own matrix, in repeated sweeps. This is required if no matrix fits all
    !> stages, because the system is stiff at the end of the step and not at its start. L replaces A for new rates and A - L applies
    !> to old rates. Each sweep reduces the error to at most 0.67, for any Jacobian of each stage on the test equation in the left
    !> half-plane; to 0.51 if the stiffness grows along the step; to 0.35 if it is constant. Source: P. J. van der Houwen, J. J. B.
    !> de Swart, Triangularly implicit iteration methods for ODE-IVP solvers, SIAM J. Sci. Comput. 18, 1997; the factors were
    !> computed for this method.
    subroutine sweep_stages(self, chart, h, t_end, stat)
        class(radau_type), intent(inout) :: self
        class(implicit_chart_type), intent(inout) :: chart
        !> Step size and end of the step.
        real(wp), intent(in) :: h, t_end
        integer, intent(out) :: stat
        !> Largest number of sweeps.
        integer, parameter :: most_sweeps = 80
        !> Sweeps that converge reduce the change to at most 0.6 in this number; others only cost matrices.
        integer, parameter :: window = 10
        real(wp), parameter :: least_reduction = 0.7_wp
        real(wp) :: change, changes(window), earlier, last_change, stage_change, theta
        integer :: i, k, n

        n = size(self%increment, 1)
        last_change = huge(1.0_wp)
        changes = huge(1.0_wp)
        do k = 1, most_sweeps
            self%residual(:n, :) = self%rate(:, 1, :)
            self%residual(n + 1:2*n, :) = self%rate(:, 2, :)
            change = 0.0_wp
            do i = 1, 3
                call solve_single_stage(self, chart, i, h, t_end, stage_change, stat)
                if (stat /= status_ok) return
                change = max(change, stage_change)
            end do
            theta = change/last_change
            last_change = max(change, tiny(1.0_wp))
            earlier = changes(modulo(k, window) + 1)
            changes(modulo(k, window) + 1) = change
            if (k == 1) cycle
            if (change <= self%rounding_limit .and. .not. theta < 0.95_wp) exit
            if (theta < 0.95_wp .and. theta*change <= (1.0_wp - theta)*self%tolerance) exit
            if (change > least_reduction*earlier) stat = status_newton_failed
            if (stat /= status_ok) return
        end do
        if (k > most_sweeps) then
            stat = status_newton_failed
            return
        end if
        ! Make the matrix of the method, for the error estimate and for reuse in the next step.
        call self%newton%renew(chart, t_end, self%q(:, 3), self%qd(:, 3), self%rate(:, 2, 3), self%tableau%diagonal*h, stat)
        self%newton%is_outdated = .true.
        self%remainder = 1.0_wp
    end subroutine sweep_stages

    !> Solve one stage, given the new rates of the previous stages.
    subroutine solve_single_stage(self, chart, i, h, t_end, first_change, stat)
        class(radau_type), intent(inout) :: self
        class(implicit_chart_type), intent(inout) :: chart
        !> Index of the stage.
        integer, intent(in) :: i
        real(wp), intent(in) :: h, t_end
        !> First correction, which reflects the changes of the rates of the other stages.
        real(wp), intent(out) :: first_change
        integer, intent(out) :: stat
        !> Largest number of corrections; size, relative to the first correction, below which corrections are negligible within a
        !> sweep.
        integer, parameter :: most_corrections = 6
        real(wp), parameter :: enough = 0.05_wp
        real(wp) :: change, t
        integer :: j, k, n

        n = size(self%increment, 1)
        first_change = 0.0_wp
        t = self%t_start + self%tableau%c(i)*h
        if (i == 3) t = t_end
        associate (base => self%newton%base, rate => self%newton%rate, q => self%newton%q, qd => self%newton%qd)
            rate = self%rate(:, :, i)
            base(:, 1) = self%start_dq
            base(:, 2) = self%start_dqd
            do j = 1, 3
                base(:, 1) = base(:, 1) + h*(a(j, i) - l(j, i))*self%residual(:n, j)
                base(:, 2) = base(:, 2) + h*(a(j, i) - l(j, i))*self%residual(n + 1:2*n, j)
            end do
            do j = 1, i - 1
                base = base + h*l(j, i)*self%rate(:, :, j)
            end do
            do k = 1, most_corrections
                if (k == 1) then
                    call self%newton%restore(chart, t, h*l(i, i), stat)
                    if (stat == status_ok) call self%newton%renew(chart, t, q, qd, rate(:, 2), h*l(i, i), stat)
                    if (stat /= status_ok) exit
                end if
                call self%newton%correct(chart, i, k == 1, t, h*l(i, i), change, stat)
                if (stat /= status_ok) exit
                if (k == 1) first_change = change
                if (change <= max(enough*first_change, self%tolerance)) exit
            end do
            self%rate(:, :, i) = rate
            self%q(:, i) = q
            self%qd(:, i) = qd
        end associate
    end subroutine solve_single_stage
end submodule tandem_stepper_radau_rescue
