! SPDX-License-Identifier: MIT
!> Calls the procedures of a model for the requested terms: the fused one if the model has it, single ones for the rest.
module tandem_model_calls
    use tandem_kinds, only: wp
    use tandem_model, only: model_type
    use tandem_model_terms, only: need_force, need_gamma, need_jacobian, need_mass, need_nu, need_phi, terms_type
    use tandem_model_timer, only: of_applied_force, of_constraint_acceleration, of_evaluate, of_holonomic, of_holonomic_jacobian, &
        of_holonomic_rate, of_inertia_force, of_mass_matrix, of_nonholonomic_jacobian, of_nonholonomic_rhs
    use tandem_status, only: status_ok
    implicit none (type, external)
    private

    public :: evaluate_terms

contains

    !> Evaluate terms: the fused procedure for the terms it provides, single procedures for the rest.
    subroutine evaluate_terms(model, wanted, t, q, qd, terms, part, failed_term, stat)
        class(model_type), intent(inout) :: model
        integer, intent(in) :: wanted
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type), intent(inout) :: terms
        !> Work space (n).
        real(wp), intent(inout) :: part(:)
        !> Index of the term whose procedure failed, 0 for the fused one.
        integer, intent(out) :: failed_term
        !> Status of the procedure.
        integer, intent(out) :: stat
        integer :: fused

        stat = 0
        failed_term = 0
        fused = iand(wanted, model%provides)
        if (fused /= 0) then
            if (associated(model%timer)) call model%timer%begin_call(of_evaluate + fused)
            call model%evaluate(fused, t, q, qd, terms, stat)
        end if
        if (stat == 0 .and. wanted /= fused) call evaluate_single(model, wanted - fused, t, q, qd, terms, part, failed_term, stat)
        if (associated(model%timer)) call model%timer%end_call()
    end subroutine evaluate_terms

    !> Evaluate terms by the model's single procedures.
    subroutine evaluate_single(model, wanted, t, q, qd, terms, part, failed_term, stat)
        class(model_type), intent(inout) :: model
        integer, intent(in) :: wanted
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type), intent(inout) :: terms
        real(wp), intent(inout) :: part(:)
        integer, intent(out) :: failed_term, stat

        stat = status_ok
        failed_term = 0
        if (iand(wanted, need_phi) /= 0) then
            failed_term = 1
            if (associated(model%timer)) call model%timer%begin_call(of_holonomic)
            call model%holonomic(t, q, terms%phi, stat)
            if (stat /= 0) return
        end if
        if (iand(wanted, need_jacobian) /= 0) then
            failed_term = 2
            call evaluate_jacobian(model, t, q, terms%jacobian, stat)
            if (stat /= 0) return
        end if
        if (iand(wanted, need_nu) /= 0) then
            failed_term = 3
            call evaluate_nu(model, t, q, terms%nu, stat)
            if (stat /= 0) return
        end if
        if (iand(wanted, need_gamma) /= 0) then
            failed_term = 4
            if (associated(model%timer)) call model%timer%begin_call(of_constraint_acceleration)
            call model%constraint_acceleration(t, q, qd, terms%gamma, stat)
            if (stat /= 0) return
        end if
        if (iand(wanted, need_mass) /= 0) then
            failed_term = 5
            if (associated(model%timer)) call model%timer%begin_call(of_mass_matrix)
            call model%mass_matrix(q, terms%mass, stat)
            if (stat /= 0) return
        end if
        if (iand(wanted, need_force) /= 0) then
            failed_term = 6
            call evaluate_force(model, t, q, qd, terms%force, part, stat)
        end if
    end subroutine evaluate_single

    !> C = [Phi_q; E].
    subroutine evaluate_jacobian(model, t, q, c, stat)
        class(model_type), intent(inout) :: model
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(inout) :: c(:, :)
        integer, intent(out) :: stat

        stat = 0
        associate (nh => model%n_holonomic)
            if (nh > 0) then
                if (associated(model%timer)) call model%timer%begin_call(of_holonomic_jacobian)
                call model%holonomic_jacobian(t, q, c(:nh, :), stat)
            end if
            if (stat /= 0 .or. model%n_nonholonomic == 0) return
            if (associated(model%timer)) call model%timer%begin_call(of_nonholonomic_jacobian)
            call model%nonholonomic_jacobian(t, q, c(nh + 1:, :), stat)
        end associate
    end subroutine evaluate_jacobian

    !> nu = [-Phi_t; e].
    subroutine evaluate_nu(model, t, q, nu, stat)
        class(model_type), intent(inout) :: model
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(inout) :: nu(:)
        integer, intent(out) :: stat

        stat = 0
        associate (nh => model%n_holonomic)
            if (associated(model%holonomic_rate)) then
                if (associated(model%timer)) call model%timer%begin_call(of_holonomic_rate)
                call model%holonomic_rate(t, q, nu(:nh), stat)
                nu(:nh) = -nu(:nh)
            end if
            if (stat /= 0 .or. .not. associated(model%nonholonomic_rhs)) return
            if (associated(model%timer)) call model%timer%begin_call(of_nonholonomic_rhs)
            call model%nonholonomic_rhs(t, q, nu(nh + 1:), stat)
        end associate
    end subroutine evaluate_nu

    !> S + Q_A; a model may have either or both.
    subroutine evaluate_force(model, t, q, qd, force, part, stat)
        class(model_type), intent(inout) :: model
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(inout) :: force(:), part(:)
        integer, intent(out) :: stat

        if (.not. associated(model%inertia_force)) then
            if (associated(model%timer)) call model%timer%begin_call(of_applied_force)
            call model%applied_force(t, q, qd, force, stat)
            return
        end if
        if (associated(model%timer)) call model%timer%begin_call(of_inertia_force)
        call model%inertia_force(q, qd, force, stat)
        if (stat /= 0 .or. .not. associated(model%applied_force)) return
        if (associated(model%timer)) call model%timer%begin_call(of_applied_force)
        call model%applied_force(t, q, qd, part, stat)
        force = force + part
    end subroutine evaluate_force
end module tandem_model_calls
