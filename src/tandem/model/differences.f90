! SPDX-License-Identifier: MIT
!> Finite differences in place of missing procedures of a model: gamma, and the derivatives for implicit steppers.
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
        !> True for derivatives of higher accuracy than a Newton matrix needs: central differences of fourth order.
        logical, public :: is_central = .false.
        real(wp), allocatable :: q(:), qd(:), scale(:), displaced(:)
        !> 1 over the time scale of the model.
        real(wp) :: rate = 1.0_wp
        !> Residuals at the point and at a displaced one: velocity, acceleration (m), dynamics (n).
        real(wp), allocatable :: velocity(:), acceleration(:), dynamics(:), velocity0(:), acceleration0(:), dynamics0(:)
        !> Work space for single derivative procedures (m, n), (n, n).
        real(wp), allocatable :: block_m(:, :), block_n(:, :)
    contains
        procedure, public :: initialize, evaluate_gamma, evaluate_derivatives, has_all_derivatives, pack_state
        procedure :: residuals
    end type differences_type

    !> Displacements and weights of central differences of fourth order.
    real(wp), parameter :: place(4) = [-2.0_wp, -1.0_wp, 1.0_wp, 2.0_wp], weight(4) = [1.0_wp, -8.0_wp, 8.0_wp, -1.0_wp]/12.0_wp

    !> Bits for terms of single procedures to be replaced by differences.
    integer, parameter :: from_jacobian = 1, from_nu = 2, from_gamma = 4, from_mass = 8, from_reaction = 16, from_force = 32

contains

    !> Attach a checked model.
    subroutine initialize(self, model, scale, saves_memory)
        class(differences_type), intent(inout) :: self
        class(model_type), intent(inout), target :: model
        !> Coordinate scales (n).
        real(wp), intent(in) :: scale(:)
        !> True to leave out matrices that a model with gamma and all five sums does not need; default false.
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
        !> eps**(1/5) balances rounding, eps / s, against truncation, s**4.
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
        ! Rounding of C qd over s, relative to the natural scale of the row at least.
        associate (c => self%probe%terms%jacobian)
            do i = 1, size(gamma)
                counts%gamma_noise = max(counts%gamma_noise, epsilon(1.0_wp)*sum(abs(c(i, :)*qd))/s/ &
                    max(self%rate**2*sum(abs(c(i, :))*self%scale) + abs(gamma(i)), tiny(1.0_wp)))
            end do
        end associate
    end subroutine evaluate_gamma

    !> All five derivatives: the model's own ones, and differences of its terms for the rest.
    subroutine evaluate_derivatives(self, t, q, qd, qdd, lambda, derivatives, counts, stat)
        class(differences_type), intent(inout) :: self
        !> Time, coordinates, velocities, accelerations (n), multipliers (m).
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:), qdd(:), lambda(:)
        type(derivatives_type), intent(inout) :: derivatives
        type(counts_type), intent(inout) :: counts
        !> A status code.
        integer, intent(out) :: stat
        real(wp), allocatable :: sums(:)
        !> Parts to be replaced by differences with respect to q and to qd, sums of the parameters above.
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
            if (stat == 0 .and. self%has_constraints) call set_constraints()
            if (stat == 0) call set_dynamics()
            if (associated(model%state%timer)) call model%state%timer%end_call()
        end associate
        if (stat /= 0) then
            stat = merge(status_not_evaluable, status_callback_failed, stat > 0)
            return
        end if
        if (missing_q /= 0) call differentiate(.false., missing_q)
        if (stat == status_ok .and. missing_qd /= 0) call differentiate(.true., missing_qd)

    contains

        !> True if the fused procedure has set a sum.
        logical function has_sum(need)
            integer, intent(in) :: need

            has_sum = iand(self%model%provides_derivatives, need) /= 0
        end function has_sum

        !> Add a single procedure of the model to a sum, or mark the part as missing.
        subroutine add_part(part, v, factor, block, sum, bit, missing)
            integer, intent(in) :: part, bit
            !> Further argument of the part.
            real(wp), intent(in) :: v(:), factor
            !> Work space.
            real(wp), intent(inout) :: block(:, :), sum(:, :)
            integer, intent(inout) :: missing

            if (stat /= 0) return
            if (.not. self%model%gives(part)) then
                missing = ior(missing, bit)
                return
            end if
            call self%model%evaluate_part(part, t, q, v, block, stat)
            if (stat == 0) sum = sum + factor*block
        end subroutine add_part

        !> Count a sum without missing parts.
        subroutine count_sum(i, missing)
            integer, intent(in) :: i, missing

            if (stat == 0 .and. missing == 0) counts%derivatives(i) = counts%derivatives(i) + 1
        end subroutine count_sum

        !> Set the sums of the constraints that the fused procedure does not provide.
        subroutine set_constraints()
            associate (d => derivatives, block => self%block_m)
                if (.not. has_sum(need_velocity_q)) then
                    d%velocity_q = 0.0_wp
                    call add_part(of_jacobian_derivative, qd, 1.0_wp, block, d%velocity_q, from_jacobian, missing_q)
                    call add_part(of_nu_derivative, qd, -1.0_wp, block, d%velocity_q, if_any(from_nu, need_nu), missing_q)
                    call count_sum(1, iand(missing_q, from_jacobian + from_nu))
                end if
                if (.not. has_sum(need_acceleration_q)) then
                    d%acceleration_q = 0.0_wp
                    call add_part(of_jacobian_derivative, qdd, 1.0_wp, block, d%acceleration_q, from_jacobian, missing_q)
                    call add_part(of_gamma_q, qd, 1.0_wp, block, d%acceleration_q, from_gamma, missing_q)
                    call count_sum(2, iand(missing_q, from_jacobian + from_gamma))
                end if
                if (.not. has_sum(need_acceleration_qd)) then
                    d%acceleration_qd = 0.0_wp
                    call add_part(of_gamma_qd, qd, 1.0_wp, block, d%acceleration_qd, from_gamma, missing_qd)
                    call count_sum(3, iand(missing_qd, from_gamma))
                end if
            end associate
        end subroutine set_constraints

        !> Set the sums of the equations of motion.
        subroutine set_dynamics()
            associate (d => derivatives, block => self%block_n, of_force => if_any(from_force, need_force))
                if (.not. has_sum(need_dynamics_q)) then
                    d%dynamics_q = 0.0_wp
                    if (.not. self%model%constant_mass) then
                        call add_part(of_mass_derivative, qdd, 1.0_wp, block, d%dynamics_q, from_mass, missing_q)
                    end if
                    if (self%has_constraints) then
                        call add_part(of_reaction_derivative, lambda, 1.0_wp, block, d%dynamics_q, from_reaction, missing_q)
                    end if
                    call add_part(of_force_q, qd, -1.0_wp, block, d%dynamics_q, of_force, missing_q)
                    call count_sum(4, iand(missing_q, from_mass + from_reaction + from_force))
                end if
                if (.not. has_sum(need_dynamics_qd)) then
                    d%dynamics_qd = 0.0_wp
                    call add_part(of_force_qd, qd, -1.0_wp, block, d%dynamics_qd, of_force, missing_qd)
                    call count_sum(5, iand(missing_qd, from_force))
                end if
            end associate
        end subroutine set_dynamics

        !> A bit if the model has a term, else 0.
        integer function if_any(bit, need)
            integer, intent(in) :: bit, need

            if_any = merge(bit, 0, iand(self%has, need) /= 0)
        end function if_any

        !> Add differences of the missing parts, with respect to q or to qd.
        subroutine differentiate(by_qd, missing)
            logical, intent(in) :: by_qd
            integer, intent(in) :: missing
            integer :: j

            self%q = q
            self%qd = qd
            if (self%is_central) then
                sums = spread(0.0_wp, 1, 2*size(self%velocity) + size(q))
            else
                call self%residuals(missing, t, qd, qdd, lambda, counts, stat)
                if (stat /= status_ok) return
                self%velocity0 = self%velocity
                self%acceleration0 = self%acceleration
                self%dynamics0 = self%dynamics
            end if
            do j = 1, size(q)
                call difference_by(by_qd, j, missing)
                if (stat /= status_ok) return
                associate (d => derivatives)
                    if (by_qd) then
                        if (iand(missing, from_gamma) /= 0) d%acceleration_qd(:, j) = self%acceleration
                        if (iand(missing, from_force) /= 0) d%dynamics_qd(:, j) = self%dynamics
                    else
                        if (.not. has_sum(need_velocity_q)) d%velocity_q(:, j) = d%velocity_q(:, j) + self%velocity
                        if (.not. has_sum(need_acceleration_q)) d%acceleration_q(:, j) = d%acceleration_q(:, j) + self%acceleration
                        if (.not. has_sum(need_dynamics_q)) d%dynamics_q(:, j) = d%dynamics_q(:, j) + self%dynamics
                    end if
                end associate
            end do
        end subroutine differentiate

        !> Derivative of the missing parts with respect to entry j of q or qd: a forward difference from the stored residuals, or a
        !> central one.
        subroutine difference_by(by_qd, j, missing)
            logical, intent(in) :: by_qd
            integer, intent(in) :: j, missing
            real(wp) :: x, size_of_x, moved, delta
            integer :: k

            x = merge(qd(j), q(j), by_qd)
            size_of_x = max(abs(x), self%scale(j)*merge(self%rate, 1.0_wp, by_qd))
            if (.not. self%is_central) then
                moved = x + sqrt(epsilon(1.0_wp))*size_of_x
                delta = moved - x
                call displace(by_qd, j, moved, missing)
                self%velocity = (self%velocity - self%velocity0)/delta
                self%acceleration = (self%acceleration - self%acceleration0)/delta
                self%dynamics = (self%dynamics - self%dynamics0)/delta
                return
            end if
            ! A power of two makes the displacements exact to the last digit of x: eps**(1/5) balances rounding and truncation.
            delta = 2.0_wp**nint(log(epsilon(1.0_wp)**0.2_wp*size_of_x)/log(2.0_wp))
            sums = 0.0_wp
            do k = 1, 4
                call displace(by_qd, j, x + place(k)*delta, missing)
                if (stat /= status_ok) return
                sums = sums + weight(k)/delta*[self%velocity, self%acceleration, self%dynamics]
            end do
            associate (m => size(self%velocity))
                self%velocity = sums(:m)
                self%acceleration = sums(m + 1:2*m)
                self%dynamics = sums(2*m + 1:)
            end associate
        end subroutine difference_by

        !> Residuals with a displaced entry of q or qd.
        subroutine displace(by_qd, j, x, missing)
            logical, intent(in) :: by_qd
            integer, intent(in) :: j, missing
            real(wp), intent(in) :: x

            if (by_qd) then
                self%qd(j) = x
            else
                self%q(j) = x
            end if
            call self%residuals(missing, t, qd, qdd, lambda, counts, stat)
            self%q(j) = q(j)
            self%qd(j) = qd(j)
        end subroutine displace
    end subroutine evaluate_derivatives

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

    !> Missing parts of C qd - nu, C qdd + gamma and M qdd + C' lambda - S - Q_A at self%q. C is multiplied by the constant velocity
    !> qd; gamma and the forces are evaluated with self%qd.
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

    !> State of the last evaluation: a constant mass matrix is not evaluated again.
    subroutine pack_state(self, pack)
        class(differences_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call self%probe%pack_state(pack)
    end subroutine pack_state
end module tandem_model_differences
