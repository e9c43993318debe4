! SPDX-License-Identifier: MIT
!> Evaluates the terms of a model: the fused procedure where the model has one, single procedures for the rest, nothing for
!> terms that the model lacks, a constant mass matrix once. Counts what it does.
module tandem_model_evaluator
    use tandem_kinds, only: wp
    use tandem_model, only: model_type
    use tandem_model_terms, only: n_terms, need_force, need_gamma, need_jacobian, need_mass, need_nu, need_phi, &
        term_name, terms_type
    use tandem_status, only: status_callback_failed, status_not_evaluable, status_ok
    use tandem_tangent_counts, only: counts_type
    implicit none (type, external)
    private

    public :: evaluator_type

    type :: evaluator_type
        !> The values of the last evaluation of each term.
        type(terms_type) :: terms
        !> The terms that the model has, a sum of need bits.
        integer :: has = 0
        !> The term that failed last, empty for the fused procedure.
        character(len=12) :: failed_term = ''
        class(model_type), pointer, private :: model => null()
        logical, private :: mass_is_known = .false.
        !> Work space: one of the two forces (n).
        real(wp), allocatable, private :: part(:)
    contains
        procedure :: initialize
        procedure :: evaluate
        procedure, private :: evaluate_single
        procedure, private :: evaluate_jacobian
        procedure, private :: evaluate_nu
        procedure, private :: evaluate_force
    end type evaluator_type

contains

    !> Attach a checked model.
    subroutine initialize(self, model)
        class(evaluator_type), intent(inout) :: self
        class(model_type), intent(inout), target :: model

        self%model => model
        self%mass_is_known = .false.
        call self%terms%allocate(model%n, model%n_holonomic, model%n_nonholonomic)
        self%part = spread(0.0_wp, 1, model%n)
        self%has = model%provides
        if (model%n_holonomic > 0) self%has = ior(self%has, need_phi)
        if (model%n_constraints() > 0) self%has = ior(self%has, need_jacobian)
        if (associated(model%constraint_acceleration)) self%has = ior(self%has, need_gamma)
        if (associated(model%holonomic_rate) .or. associated(model%nonholonomic_rhs)) self%has = ior(self%has, need_nu)
        self%has = ior(self%has, need_mass)
        if (associated(model%inertia_force) .or. associated(model%applied_force)) self%has = ior(self%has, need_force)
    end subroutine initialize

    !> Evaluate the terms of a need mask that the model has.
    subroutine evaluate(self, need, t, q, qd, counts, stat)
        class(evaluator_type), intent(inout) :: self
        !> The terms wanted, a sum of need bits.
        integer, intent(in) :: need
        !> Time, coordinates (n), velocities (n; any where neither gamma nor force is wanted).
        real(wp), intent(in) :: t, q(:), qd(:)
        type(counts_type), intent(inout) :: counts
        !> A status code.
        integer, intent(out) :: stat
        integer :: wanted, fused, i

        wanted = iand(need, self%has)
        if (self%mass_is_known) wanted = iand(wanted, not(need_mass))
        stat = 0
        if (wanted == 0) return
        do i = 1, n_terms
            if (btest(wanted, i - 1)) counts%terms(i) = counts%terms(i) + 1
        end do
        fused = iand(wanted, self%model%provides)
        if (fused /= 0) then
            counts%fused_calls = counts%fused_calls + 1
            self%failed_term = 'evaluate'
            call self%model%evaluate(fused, t, q, qd, self%terms, stat)
            wanted = wanted - fused
        end if
        if (stat == 0 .and. wanted /= 0) call self%evaluate_single(wanted, t, q, qd, stat)
        if (stat == 0) then
            if (iand(need, need_mass) /= 0) self%mass_is_known = self%model%constant_mass
        else
            stat = merge(status_not_evaluable, status_callback_failed, stat > 0)
        end if
    end subroutine evaluate

    !> Evaluate terms by the model's single procedures.
    subroutine evaluate_single(self, wanted, t, q, qd, stat)
        class(evaluator_type), intent(inout) :: self
        integer, intent(in) :: wanted
        real(wp), intent(in) :: t, q(:), qd(:)
        !> The procedure's own status.
        integer, intent(out) :: stat

        stat = status_ok
        associate (model => self%model, terms => self%terms)
            if (iand(wanted, need_phi) /= 0) then
                self%failed_term = term_name(1)
                call model%holonomic(t, q, terms%phi, stat)
                if (stat /= 0) return
            end if
            if (iand(wanted, need_jacobian) /= 0) then
                call self%evaluate_jacobian(t, q, stat)
                if (stat /= 0) return
            end if
            if (iand(wanted, need_nu) /= 0) then
                call self%evaluate_nu(t, q, stat)
                if (stat /= 0) return
            end if
            if (iand(wanted, need_gamma) /= 0) then
                self%failed_term = term_name(4)
                call model%constraint_acceleration(t, q, qd, terms%gamma, stat)
                if (stat /= 0) return
            end if
            if (iand(wanted, need_mass) /= 0) then
                self%failed_term = term_name(5)
                call model%mass_matrix(q, terms%mass, stat)
                if (stat /= 0) return
            end if
            if (iand(wanted, need_force) /= 0) call self%evaluate_force(t, q, qd, stat)
        end associate
    end subroutine evaluate_single

    !> C = [Phi_q; E].
    subroutine evaluate_jacobian(self, t, q, stat)
        class(evaluator_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        integer, intent(out) :: stat

        stat = 0
        associate (model => self%model, nh => self%model%n_holonomic, c => self%terms%jacobian)
            self%failed_term = term_name(2)
            if (nh > 0) call model%holonomic_jacobian(t, q, c(:nh, :), stat)
            if (stat == 0 .and. model%n_nonholonomic > 0) call model%nonholonomic_jacobian(t, q, c(nh + 1:, :), stat)
        end associate
    end subroutine evaluate_jacobian

    !> nu = [-Phi_t; e].
    subroutine evaluate_nu(self, t, q, stat)
        class(evaluator_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        integer, intent(out) :: stat

        stat = 0
        associate (model => self%model, nh => self%model%n_holonomic, nu => self%terms%nu)
            self%failed_term = term_name(3)
            if (associated(model%holonomic_rate)) then
                call model%holonomic_rate(t, q, nu(:nh), stat)
                nu(:nh) = -nu(:nh)
            end if
            if (stat == 0 .and. associated(model%nonholonomic_rhs)) call model%nonholonomic_rhs(t, q, nu(nh + 1:), stat)
        end associate
    end subroutine evaluate_nu

    !> S + Q_A, of which the model may have either or both.
    subroutine evaluate_force(self, t, q, qd, stat)
        class(evaluator_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        integer, intent(out) :: stat

        associate (model => self%model, force => self%terms%force)
            self%failed_term = term_name(6)
            if (.not. associated(model%inertia_force)) then
                call model%applied_force(t, q, qd, force, stat)
                return
            end if
            call model%inertia_force(q, qd, force, stat)
            if (stat /= 0 .or. .not. associated(model%applied_force)) return
            call model%applied_force(t, q, qd, self%part, stat)
            force = force + self%part
        end associate
    end subroutine evaluate_force
end module tandem_model_evaluator
