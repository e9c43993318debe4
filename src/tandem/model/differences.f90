! SPDX-License-Identifier: MIT
!> Finite differences that replace missing procedures of a model: gamma, and the derivatives for implicit steppers.
module tandem_model_differences
    use tandem_kinds, only: wp
    use tandem_linalg_kernels, only: add_product, add_transposed_product
    use tandem_model, only: model_type
    use tandem_model_derivatives, only: derivatives_type, n_derivatives, need_acceleration_q, need_acceleration_qd, &
        need_all_derivatives, need_dynamics_q, need_dynamics_qd, need_velocity_q
    use tandem_model_evaluator, only: evaluator_type
    use tandem_model_terms, only: need_force, need_gamma, need_jacobian, need_mass, need_nu
    use tandem_model_timer, only: of_evaluate_derivatives, of_force_q, of_force_qd, of_gamma_q, of_gamma_qd, &
        of_jacobian_derivative, of_mass_derivative, of_nu_derivative, of_reaction_derivative
    use tandem_pack, only: pack_type
    use tandem_status, only: status_callback_failed, status_not_evaluable, status_ok
    use tandem_model_counts, only: counts_type
    implicit none (type, external)
    private

    public :: differences_type

    type :: differences_type
        private
        class(model_type), pointer :: model => null()
        !> Evaluates the model at displaced points.
        type(evaluator_type) :: probe
        !> Terms of the model; true if the model has its own gamma.
        integer :: has = 0
        logical :: has_gamma = .false., has_constraints = .false.
        !> True for fourth-order central differences, which are more accurate than a Newton matrix requires.
        logical, public :: is_central = .false.
        real(wp), allocatable :: q(:), qd(:), scale(:), displaced(:)
        !> 1 over the time scale of the model.
        real(wp) :: rate = 1.0_wp
        !> Residuals at a displaced point and at the point itself: velocity, acceleration (m), dynamics (n).
        real(wp), allocatable :: velocity(:), acceleration(:), dynamics(:), velocity0(:), acceleration0(:), dynamics0(:)
        !> Work space of single derivative procedures: (m, n) and (n, n).
        real(wp), allocatable :: block_m(:, :), block_n(:, :)
    contains
        procedure, public :: initialize, evaluate_gamma, evaluate_derivatives, has_all_derivatives, pack_state
        procedure :: set_single, differentiate, difference_by, residuals
    end type differences_type

    !> Bits of terms for which single procedures are missing, so that differences are required.
    integer, parameter :: from_jacobian = 1, from_nu = 2, from_gamma = 4, from_mass = 8, from_reaction = 16, from_force = 32

contains

    !> Attach a checked model.
    subroutine initialize(self, model, scale, saves_memory)
        class(differences_type), intent(inout) :: self
        class(model_type), intent(inout), target :: model
        !> Coordinate scales (n).
        real(wp), intent(in) :: scale(:)
        !> True to omit matrices that a model with gamma and all five derivatives does not use; default false.
        logical, intent(in), optional :: saves_memory
        logical :: is_lean
        integer :: m, n

        self%model => model
        is_lean = .false.
        if (present(saves_memory)) is_lean = saves_memory .and. iand(model%provides, need_gamma) /= 0 .and. &
            model%provides_derivatives == need_all_derivatives
        call self%probe%initialize(model, compressed=is_lean .and. allocated(model%pattern))
        self%has = self%probe%has
        self%has_gamma = iand(self%has, need_gamma) /= 0
        n = model%n
        m = model%n_constraints()
        self%has_constraints = m > 0
        self%scale = scale
        self%rate = 1.0_wp/model%time_scale
        self%q = spread(0.0_wp, 1, n)
        self%qd = self%q
        self%displaced = self%q
        self%dynamics = self%q
        self%dynamics0 = self%q
        self%velocity = spread(0.0_wp, 1, m)
        self%acceleration = self%velocity
        self%velocity0 = self%velocity
        self%acceleration0 = self%velocity
        if (allocated(self%block_m)) deallocate (self%block_m, self%block_n)
        allocate (self%block_m(m, merge(0, n, is_lean)), self%block_n(n, merge(0, n, is_lean)), source=0.0_wp)
    end subroutine initialize

    !> gamma = d/ds (C qd - nu)(t + s, q + s qd) at s = 0, by a central difference of fourth order.
    subroutine evaluate_gamma(self, t, q, qd, gamma, counts, stat)
        class(differences_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:)
        !> gamma (m).
        real(wp), intent(out), contiguous :: gamma(:)
        type(counts_type), intent(inout) :: counts
        !> A status code.
        integer, intent(out) :: stat
        !> Displacements in units of s; weights times s.
        real(wp), parameter :: place(4) = [-2.0_wp, -1.0_wp, 1.0_wp, 2.0_wp]
        real(wp), parameter :: weight(4) = [1.0_wp, -8.0_wp, 8.0_wp, -1.0_wp]/12.0_wp
        !> eps**(1/5) balances the rounding error eps/s and the truncation error s**4.
        real(wp), parameter :: balance = epsilon(1.0_wp)**0.2_wp
        real(wp) :: s, speed
        integer :: i

        stat = status_ok
        gamma = 0.0_wp
        speed = maxval(abs(qd)/max(abs(q), self%scale))
        s = balance/max(speed, self%rate)
        do i = 1, 4
            self%displaced = q + place(i)*s*qd
            call self%probe%evaluate(need_jacobian + need_nu, t + place(i)*s, self%displaced, qd, counts, stat)
            if (stat /= status_ok) return
            counts%gamma_evaluations = counts%gamma_evaluations + 1
            gamma = gamma - (weight(i)/s)*self%probe%terms%nu
            call add_product(self%probe%terms%jacobian, qd, weight(i)/s, gamma)
        end do
        ! Rounding error of C qd divided by s, relative to at least the natural scale of the row.
        associate (c => self%probe%terms%jacobian)
            do i = 1, size(gamma)
                counts%gamma_noise = max(counts%gamma_noise, epsilon(1.0_wp)*sum(abs(c(i, :)*qd))/s/ &
                    max(self%rate**2*sum(abs(c(i, :))*self%scale) + abs(gamma(i)), tiny(1.0_wp)))
            end do
        end associate
    end subroutine evaluate_gamma

    !> Set all five derivatives: by procedures of the model as far as it has them, by differences otherwise.
    subroutine evaluate_derivatives(self, t, q, qd, qdd, lambda, derivatives, counts, stat)
        class(differences_type), intent(inout) :: self
        !> Time, coordinates, velocities, accelerations (n), multipliers (m).
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:), qdd(:), lambda(:)
        type(derivatives_type), intent(inout) :: derivatives
        type(counts_type), intent(inout) :: counts
        !> A status code.
        integer, intent(out) :: stat
        integer :: missing_q, missing_qd, i

        stat = 0
        missing_q = 0
        missing_qd = 0
        associate (model => self%model, fused => self%model%provides_derivatives)
            if (fused /= 0) then
                if (associated(model%state%timer)) call model%state%timer%begin_call(of_evaluate_derivatives + fused)
                call model%evaluate_derivatives(fused, t, q, qd, qdd, lambda, derivatives, stat)
                do i = 1, n_derivatives
                    if (btest(fused, i - 1)) counts%derivatives(i) = counts%derivatives(i) + 1
                end do
            end if
            if (stat == 0) call self%set_single(fused, t, q, qd, qdd, lambda, derivatives, counts, missing_q, missing_qd, stat)
            if (associated(model%state%timer)) call model%state%timer%end_call()
            if (stat /= 0) then
                stat = merge(status_not_evaluable, status_callback_failed, stat > 0)
                return
            end if
            if (missing_q /= 0) then
                call self%differentiate(.false., missing_q, fused, t, q, qd, qdd, lambda, derivatives, counts, stat)
            end if
            if (stat == status_ok .and. missing_qd /= 0) then
                call self%differentiate(.true., missing_qd, fused, t, q, qd, qdd, lambda, derivatives, counts, stat)
            end if
        end associate
    end subroutine evaluate_derivatives

    !> Set the derivatives that the fused procedure does not provide from single procedures of the model, and list the missing
    !> parts.
    subroutine set_single(self, fused, t, q, qd, qdd, lambda, derivatives, counts, missing_q, missing_qd, stat)
        class(differences_type), intent(inout) :: self
        !> Sums already set.
        integer, intent(in) :: fused
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:), qdd(:), lambda(:)
        type(derivatives_type), intent(inout) :: derivatives
        type(counts_type), intent(inout) :: counts
        !> Parts to be replaced by differences, sums of the parameters above.
        integer, intent(out) :: missing_q, missing_qd
        !> Status of the procedures.
        integer, intent(out) :: stat

        missing_q = 0
        missing_qd = 0
        stat = 0
        if (self%has_constraints) call add_single_constraints(self, fused, t, q, qd, qdd, derivatives, counts, missing_q, &
            missing_qd, stat)
        if (stat == 0) call add_single_dynamics(self, fused, t, q, qd, qdd, lambda, derivatives, counts, missing_q, missing_qd, &
            stat)
    end subroutine set_single

    !> Set the derivatives of the constraints.
    subroutine add_single_constraints(self, fused, t, q, qd, qdd, derivatives, counts, missing_q, missing_qd, stat)
        class(differences_type), intent(inout) :: self
        integer, intent(in) :: fused
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:), qdd(:)
        type(derivatives_type), intent(inout) :: derivatives
        type(counts_type), intent(inout) :: counts
        integer, intent(inout) :: missing_q, missing_qd
        integer, intent(out) :: stat

        stat = 0
        associate (model => self%model, d => derivatives)
            if (iand(fused, need_velocity_q) == 0) then
                d%velocity_q = 0.0_wp
                if (model%gives(of_jacobian_derivative)) then
                    call model%evaluate_part(of_jacobian_derivative, t, q, qd, d%velocity_q, stat)
                    if (stat /= 0) return
                else
                    missing_q = ior(missing_q, from_jacobian)
                end if
                if (model%gives(of_nu_derivative)) then
                    call model%evaluate_part(of_nu_derivative, t, q, qd, self%block_m, stat)
                    if (stat /= 0) return
                    d%velocity_q = d%velocity_q - self%block_m
                else if (iand(self%has, need_nu) /= 0) then
                    missing_q = ior(missing_q, from_nu)
                end if
                if (iand(missing_q, from_jacobian + from_nu) == 0) counts%derivatives(1) = counts%derivatives(1) + 1
            end if
            if (iand(fused, need_acceleration_q) == 0) then
                d%acceleration_q = 0.0_wp
                if (model%gives(of_jacobian_derivative)) then
                    call model%evaluate_part(of_jacobian_derivative, t, q, qdd, d%acceleration_q, stat)
                    if (stat /= 0) return
                else
                    missing_q = ior(missing_q, from_jacobian)
                end if
                if (model%gives(of_gamma_q)) then
                    call model%evaluate_part(of_gamma_q, t, q, qd, self%block_m, stat)
                    if (stat /= 0) return
                    d%acceleration_q = d%acceleration_q + self%block_m
                else
                    missing_q = ior(missing_q, from_gamma)
                end if
                if (iand(missing_q, from_jacobian + from_gamma) == 0) counts%derivatives(2) = counts%derivatives(2) + 1
            end if
            if (iand(fused, need_acceleration_qd) == 0) then
                d%acceleration_qd = 0.0_wp
                if (model%gives(of_gamma_qd)) then
                    call model%evaluate_part(of_gamma_qd, t, q, qd, d%acceleration_qd, stat)
                    if (stat /= 0) return
                else
                    missing_qd = ior(missing_qd, from_gamma)
                end if
                if (iand(missing_qd, from_gamma) == 0) counts%derivatives(3) = counts%derivatives(3) + 1
            end if
        end associate
    end subroutine add_single_constraints

    !> Set the derivatives of the equations of motion.
    subroutine add_single_dynamics(self, fused, t, q, qd, qdd, lambda, derivatives, counts, missing_q, missing_qd, stat)
        class(differences_type), intent(inout) :: self
        integer, intent(in) :: fused
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:), qdd(:), lambda(:)
        type(derivatives_type), intent(inout) :: derivatives
        type(counts_type), intent(inout) :: counts
        integer, intent(inout) :: missing_q, missing_qd
        integer, intent(out) :: stat

        stat = 0
        associate (model => self%model, d => derivatives)
            if (iand(fused, need_dynamics_q) == 0) then
                d%dynamics_q = 0.0_wp
                if (.not. model%constant_mass) then
                    if (model%gives(of_mass_derivative)) then
                        call model%evaluate_part(of_mass_derivative, t, q, qdd, d%dynamics_q, stat)
                        if (stat /= 0) return
                    else
                        missing_q = ior(missing_q, from_mass)
                    end if
                end if
                if (self%has_constraints) then
                    if (model%gives(of_reaction_derivative)) then
                        call model%evaluate_part(of_reaction_derivative, t, q, lambda, self%block_n, stat)
                        if (stat /= 0) return
                        d%dynamics_q = d%dynamics_q + self%block_n
                    else
                        missing_q = ior(missing_q, from_reaction)
                    end if
                end if
                if (model%gives(of_force_q)) then
                    call model%evaluate_part(of_force_q, t, q, qd, self%block_n, stat)
                    if (stat /= 0) return
                    d%dynamics_q = d%dynamics_q - self%block_n
                else if (iand(self%has, need_force) /= 0) then
                    missing_q = ior(missing_q, from_force)
                end if
                if (iand(missing_q, from_mass + from_reaction + from_force) == 0) counts%derivatives(4) = counts%derivatives(4) + 1
            end if
            if (iand(fused, need_dynamics_qd) == 0) then
                d%dynamics_qd = 0.0_wp
                if (model%gives(of_force_qd)) then
                    call model%evaluate_part(of_force_qd, t, q, qd, d%dynamics_qd, stat)
                    d%dynamics_qd = -d%dynamics_qd
                else if (iand(self%has, need_force) /= 0) then
                    missing_qd = ior(missing_qd, from_force)
                end if
                if (iand(missing_qd, from_force) == 0) counts%derivatives(5) = counts%derivatives(5) + 1
            end if
        end associate
    end subroutine add_single_dynamics

    !> Add differences of the missing parts with respect to q or qd.
    subroutine differentiate(self, by_qd, missing, fused, t, q, qd, qdd, lambda, derivatives, counts, stat)
        class(differences_type), intent(inout) :: self
        logical, intent(in) :: by_qd
        integer, intent(in) :: missing, fused
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:), qdd(:), lambda(:)
        type(derivatives_type), intent(inout) :: derivatives
        type(counts_type), intent(inout) :: counts
        integer, intent(out) :: stat
        real(wp), allocatable :: sums(:)
        integer :: j

        self%q = q
        self%qd = qd
        if (self%is_central) then
            allocate (sums(2*size(self%velocity) + size(q)), source=0.0_wp)
        else
            call self%residuals(missing, t, qd, qdd, lambda, counts, stat)
            if (stat /= status_ok) return
            self%velocity0 = self%velocity
            self%acceleration0 = self%acceleration
            self%dynamics0 = self%dynamics
        end if
        do j = 1, size(q)
            call self%difference_by(by_qd, j, missing, t, qd, qdd, lambda, counts, sums, stat)
            if (stat /= status_ok) return
            self%q(j) = q(j)
            self%qd(j) = qd(j)
            associate (d => derivatives)
                if (by_qd) then
                    if (iand(missing, from_gamma) /= 0) d%acceleration_qd(:, j) = self%acceleration
                    if (iand(missing, from_force) /= 0) d%dynamics_qd(:, j) = self%dynamics
                else
                    if (iand(fused, need_velocity_q) == 0) d%velocity_q(:, j) = d%velocity_q(:, j) + self%velocity
                    if (iand(fused, need_acceleration_q) == 0) d%acceleration_q(:, j) = d%acceleration_q(:, j) + self%acceleration
                    if (iand(fused, need_dynamics_q) == 0) d%dynamics_q(:, j) = d%dynamics_q(:, j) + self%dynamics
                end if
            end associate
        end do
    end subroutine differentiate

    !> Derivative of the missing parts with respect to entry j of self%q or self%qd, which remains displaced: a forward difference
    !> from the stored residuals, or a central difference.
    subroutine difference_by(self, by_qd, j, missing, t, qd, qdd, lambda, counts, sums, stat)
        class(differences_type), intent(inout) :: self
        logical, intent(in) :: by_qd
        integer, intent(in) :: j, missing
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: qd(:), qdd(:), lambda(:)
        type(counts_type), intent(inout) :: counts
        !> Work space of central differences.
        real(wp), intent(inout), allocatable :: sums(:)
        integer, intent(out) :: stat
        !> Displacements and weights of the fourth-order difference.
        real(wp), parameter :: place(4) = [-2.0_wp, -1.0_wp, 1.0_wp, 2.0_wp], weight(4) = [1.0_wp, -8.0_wp, 8.0_wp, -1.0_wp]/12.0_wp
        real(wp) :: x, scale, moved, delta
        integer :: i

        x = merge(self%qd(j), self%q(j), by_qd)
        scale = self%scale(j)*merge(self%rate, 1.0_wp, by_qd)
        if (.not. allocated(sums)) then
            moved = x + sqrt(epsilon(1.0_wp))*max(abs(x), scale)
            call look(moved)
            if (stat /= status_ok) return
            delta = moved - x
            self%velocity = (self%velocity - self%velocity0)/delta
            self%acceleration = (self%acceleration - self%acceleration0)/delta
            self%dynamics = (self%dynamics - self%dynamics0)/delta
            return
        end if
        ! A power of two makes displacements exact. eps**(1/5) balances rounding and truncation errors.
        delta = 2.0_wp**nint(log(epsilon(1.0_wp)**0.2_wp*max(abs(x), scale))/log(2.0_wp))
        sums = 0.0_wp
        do i = 1, 4
            call look(x + place(i)*delta)
            if (stat /= status_ok) return
            sums = sums + weight(i)/delta*[self%velocity, self%acceleration, self%dynamics]
        end do
        associate (m => size(self%velocity))
            self%velocity = sums(:m)
            self%acceleration = sums(m + 1:2*m)
            self%dynamics = sums(2*m + 1:)
        end associate

    contains

        subroutine look(displaced)
            real(wp), intent(in) :: displaced

            if (by_qd) then
                self%qd(j) = displaced
            else
                self%q(j) = displaced
            end if
            call self%residuals(missing, t, qd, qdd, lambda, counts, stat)
        end subroutine look
    end subroutine difference_by

    !> True if no derivative needs differences.
    pure logical function has_all_derivatives(self) result(has_all)
        class(differences_type), intent(in) :: self
        logical :: has(n_derivatives)
        integer :: i

        associate (model => self%model)
            has = [(btest(model%provides_derivatives, i - 1), i=1, n_derivatives)]
            has(1) = has(1) .or. (model%gives(of_jacobian_derivative) .and. &
                (model%gives(of_nu_derivative) .or. iand(self%has, need_nu) == 0))
            has(2) = has(2) .or. (model%gives(of_jacobian_derivative) .and. model%gives(of_gamma_q))
            has(3) = has(3) .or. model%gives(of_gamma_qd)
            has(:3) = has(:3) .or. .not. self%has_constraints
            has(4) = has(4) .or. ((model%constant_mass .or. model%gives(of_mass_derivative)) .and. &
                (model%gives(of_reaction_derivative) .or. .not. self%has_constraints) .and. &
                (model%gives(of_force_q) .or. iand(self%has, need_force) == 0))
            has(5) = has(5) .or. model%gives(of_force_qd) .or. iand(self%has, need_force) == 0
        end associate
        has_all = all(has)
    end function has_all_derivatives

    !> Missing parts of C qd - nu, C qdd + gamma and M qdd + C' lambda - S - Q_A at self%q. C is multiplied by the velocity qd,
    !> which is constant; gamma and the forces are evaluated with self%qd.
    subroutine residuals(self, missing, t, qd, qdd, lambda, counts, stat)
        class(differences_type), intent(inout) :: self
        integer, intent(in) :: missing
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: qd(:), qdd(:), lambda(:)
        type(counts_type), intent(inout) :: counts
        integer, intent(out) :: stat
        integer :: need

        need = 0
        if (iand(missing, from_jacobian + from_reaction) /= 0) need = ior(need, need_jacobian)
        if (iand(missing, from_nu) /= 0) need = ior(need, need_nu)
        if (iand(missing, from_gamma) /= 0 .and. self%has_gamma) need = ior(need, need_gamma)
        if (iand(missing, from_mass) /= 0) need = ior(need, need_mass)
        if (iand(missing, from_force) /= 0) need = ior(need, need_force)
        counts%difference_evaluations = counts%difference_evaluations + 1
        self%velocity = 0.0_wp
        self%acceleration = 0.0_wp
        self%dynamics = 0.0_wp
        stat = status_ok
        if (iand(missing, from_gamma) /= 0 .and. .not. self%has_gamma) then
            call self%evaluate_gamma(t, self%q, self%qd, self%acceleration, counts, stat)
            if (stat /= status_ok) return
        end if
        call self%probe%evaluate(need, t, self%q, self%qd, counts, stat)
        if (stat == status_ok .and. iand(missing, from_force) /= 0) call self%probe%add_friction(t, self%q, self%qd, lambda, stat)
        if (stat /= status_ok) return
        associate (terms => self%probe%terms)
            if (iand(missing, from_jacobian) /= 0) then
                call add_product(terms%jacobian, qd, 1.0_wp, self%velocity)
                call add_product(terms%jacobian, qdd, 1.0_wp, self%acceleration)
            end if
            if (iand(missing, from_nu) /= 0) self%velocity = self%velocity - terms%nu
            if (iand(missing, from_gamma) /= 0 .and. self%has_gamma) self%acceleration = self%acceleration + terms%gamma
            if (iand(missing, from_mass) /= 0) call add_product(terms%mass, qdd, 1.0_wp, self%dynamics)
            if (iand(missing, from_reaction) /= 0) call add_transposed_product(terms%jacobian, lambda, 1.0_wp, self%dynamics)
            if (iand(missing, from_force) /= 0) self%dynamics = self%dynamics - terms%force
        end associate
    end subroutine residuals

    !> Pack the last evaluation, because a constant mass matrix is not evaluated again.
    subroutine pack_state(self, pack)
        class(differences_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call self%probe%pack_state(pack)
    end subroutine pack_state
end module tandem_model_differences
