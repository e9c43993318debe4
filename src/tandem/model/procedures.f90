! SPDX-License-Identifier: MIT
!> Models with one procedure per term.
!>
!> Associate the procedures of the terms that the model has; a term without a procedure is zero. A model may also associate
!> `evaluate` for the terms in `provides`; single procedures are called for all other terms. Likewise, differences replace
!> derivatives that neither `evaluate_derivatives` nor a single procedure provides.
module tandem_model_procedures
    use tandem_kinds, only: wp
    use tandem_model, only: model_type
    use tandem_model_terms, only: need_force, need_gamma, need_jacobian, need_mass, need_nu, need_phi, terms_type
    use tandem_model_timer, only: of_applied_force, of_constraint_acceleration, of_force_q, of_force_qd, of_gamma_q, of_gamma_qd, &
        of_holonomic, of_holonomic_jacobian, of_holonomic_rate, of_inertia_force, of_jacobian_derivative, of_mass_derivative, &
        of_mass_matrix, of_nonholonomic_jacobian, of_nonholonomic_rhs, of_nu_derivative, of_reaction_derivative
    use tandem_status, only: status_ok
    implicit none (type, external)
    private

    public :: procedure_model_type

    !> A model with single procedures. They are not bound to this type: their first argument is of `class(model_type)`.
    type, extends(model_type) :: procedure_model_type
        !> Phi(t, q) (nh); required if nh > 0.
        procedure(vector_of_position), pointer, nopass :: holonomic => null()
        !> Phi_q(t, q) (nh, n); required if nh > 0.
        procedure(matrix_of_position), pointer, nopass :: holonomic_jacobian => null()
        !> Phi_t(t, q) (nh); required if Phi depends on time.
        procedure(vector_of_position), pointer, nopass :: holonomic_rate => null()
        !> E(t, q) (nd, n); required if nd > 0.
        procedure(matrix_of_position), pointer, nopass :: nonholonomic_jacobian => null()
        !> e(t, q) (nd); required if e is not zero.
        procedure(vector_of_position), pointer, nopass :: nonholonomic_rhs => null()
        !> gamma(t, q, qd) (nh + nd) of C qdd = -gamma (8). If missing, it is computed by differences of C and nu along the motion,
        !> whose noise, which is reported, limits the accuracy.
        procedure(vector_of_motion), pointer, nopass :: constraint_acceleration => null()
        !> M(q) (n, n), symmetric; required.
        procedure(mass_interface), pointer, nopass :: mass_matrix => null()
        !> S(q, qd) (n); required if it is not zero.
        procedure(inertia_interface), pointer, nopass :: inertia_force => null()
        !> Q_A(t, q, qd) (n); required if it is not zero.
        procedure(vector_of_motion), pointer, nopass :: applied_force => null()
        !> C2(q, x) = (C x)_q (nh + nd, n) for a constant x (72). This derivative and the following ones are for implicit steppers
        !> only.
        procedure(direction_derivative), pointer, nopass :: jacobian_derivative => null()
        !> nu_q (nh + nd, n).
        procedure(matrix_of_position), pointer, nopass :: nu_derivative => null()
        !> gamma_q and gamma_qd (nh + nd, n) (71).
        procedure(matrix_of_motion), pointer, nopass :: gamma_q => null(), gamma_qd => null()
        !> M2(q, x) = (M x)_q (n, n) for a constant x (60).
        procedure(mass_derivative_interface), pointer, nopass :: mass_derivative => null()
        !> (C' lambda)_q (n, n) for constant multipliers (64).
        procedure(direction_derivative), pointer, nopass :: reaction_derivative => null()
        !> (S + Q_A)_q and (S + Q_A)_qd (n, n).
        procedure(matrix_of_motion), pointer, nopass :: force_q => null(), force_qd => null()
    contains
        procedure :: has_terms, gives, evaluate_single, evaluate_part
    end type procedure_model_type

    abstract interface
        !> Evaluate a vector that depends on time and position.
        subroutine vector_of_position(self, t, q, value, stat)
            import :: model_type, wp
            implicit none (type, external)
            class(model_type), intent(inout) :: self
            !> Time.
            real(wp), intent(in) :: t
            !> Coordinates (n).
            real(wp), intent(in) :: q(:)
            !> The complete vector.
            real(wp), intent(out) :: value(:)
            !> 0 ok, > 0 cannot be evaluated here, < 0 stop.
            integer, intent(out) :: stat
        end subroutine vector_of_position

        !> Evaluate a matrix that depends on time and position, with one row per constraint and one column per coordinate.
        subroutine matrix_of_position(self, t, q, value, stat)
            import :: model_type, wp
            implicit none (type, external)
            class(model_type), intent(inout) :: self
            real(wp), intent(in) :: t, q(:)
            !> The complete matrix, including zeros.
            real(wp), intent(out) :: value(:, :)
            integer, intent(out) :: stat
        end subroutine matrix_of_position

        !> Evaluate a vector that depends on time, position and velocity.
        subroutine vector_of_motion(self, t, q, qd, value, stat)
            import :: model_type, wp
            implicit none (type, external)
            class(model_type), intent(inout) :: self
            !> Time, coordinates (n), velocities (n).
            real(wp), intent(in) :: t, q(:), qd(:)
            real(wp), intent(out) :: value(:)
            integer, intent(out) :: stat
        end subroutine vector_of_motion

        !> Evaluate a matrix that depends on time, position and velocity.
        subroutine matrix_of_motion(self, t, q, qd, value, stat)
            import :: model_type, wp
            implicit none (type, external)
            class(model_type), intent(inout) :: self
            real(wp), intent(in) :: t, q(:), qd(:)
            real(wp), intent(out) :: value(:, :)
            integer, intent(out) :: stat
        end subroutine matrix_of_motion

        !> Evaluate the mass matrix.
        subroutine mass_interface(self, q, value, stat)
            import :: model_type, wp
            implicit none (type, external)
            class(model_type), intent(inout) :: self
            real(wp), intent(in) :: q(:)
            real(wp), intent(out) :: value(:, :)
            integer, intent(out) :: stat
        end subroutine mass_interface

        !> Evaluate the inertia force, which does not depend on time.
        subroutine inertia_interface(self, q, qd, value, stat)
            import :: model_type, wp
            implicit none (type, external)
            class(model_type), intent(inout) :: self
            real(wp), intent(in) :: q(:), qd(:)
            real(wp), intent(out) :: value(:)
            integer, intent(out) :: stat
        end subroutine inertia_interface

        !> Evaluate the derivative of C x or C'x with respect to q for a constant x.
        subroutine direction_derivative(self, t, q, x, value, stat)
            import :: model_type, wp
            implicit none (type, external)
            class(model_type), intent(inout) :: self
            !> Time, coordinates (n), and x: (n) for C x, (nh + nd) for C' x.
            real(wp), intent(in) :: t, q(:), x(:)
            real(wp), intent(out) :: value(:, :)
            integer, intent(out) :: stat
        end subroutine direction_derivative

        !> Evaluate the derivative of M x with respect to q for a constant x.
        subroutine mass_derivative_interface(self, q, x, value, stat)
            import :: model_type, wp
            implicit none (type, external)
            class(model_type), intent(inout) :: self
            real(wp), intent(in) :: q(:), x(:)
            real(wp), intent(out) :: value(:, :)
            integer, intent(out) :: stat
        end subroutine mass_derivative_interface
    end interface

contains

    !> Terms that the model provides, a sum of need bits.
    pure integer function has_terms(self)
        class(procedure_model_type), intent(in) :: self

        has_terms = self%model_type%has_terms()
        if (associated(self%constraint_acceleration)) has_terms = ior(has_terms, need_gamma)
        if (associated(self%holonomic_rate) .or. associated(self%nonholonomic_rhs)) has_terms = ior(has_terms, need_nu)
        if (associated(self%inertia_force) .or. associated(self%applied_force)) has_terms = ior(has_terms, need_force)
    end function has_terms

    !> True if the model has a procedure for a part of the derivatives.
    pure logical function gives(self, part)
        class(procedure_model_type), intent(in) :: self
        integer, intent(in) :: part

        select case (part)
        case (of_jacobian_derivative); gives = associated(self%jacobian_derivative)
        case (of_nu_derivative); gives = associated(self%nu_derivative)
        case (of_gamma_q); gives = associated(self%gamma_q)
        case (of_gamma_qd); gives = associated(self%gamma_qd)
        case (of_mass_derivative); gives = associated(self%mass_derivative)
        case (of_reaction_derivative); gives = associated(self%reaction_derivative)
        case (of_force_q); gives = associated(self%force_q)
        case (of_force_qd); gives = associated(self%force_qd)
        case default; gives = .false.
        end select
    end function gives

    !> Evaluate a part of the derivatives by a single procedure.
    subroutine evaluate_part(self, part, t, q, v, value, stat)
        class(procedure_model_type), intent(inout) :: self
        integer, intent(in) :: part
        real(wp), intent(in) :: t, q(:), v(:)
        real(wp), intent(out) :: value(:, :)
        integer, intent(out) :: stat

        if (associated(self%state%timer)) call self%state%timer%begin_call(part)
        select case (part)
        case (of_jacobian_derivative); call self%jacobian_derivative(self, t, q, v, value, stat)
        case (of_nu_derivative); call self%nu_derivative(self, t, q, value, stat)
        case (of_gamma_q); call self%gamma_q(self, t, q, v, value, stat)
        case (of_gamma_qd); call self%gamma_qd(self, t, q, v, value, stat)
        case (of_mass_derivative); call self%mass_derivative(self, q, v, value, stat)
        case (of_reaction_derivative); call self%reaction_derivative(self, t, q, v, value, stat)
        case (of_force_q); call self%force_q(self, t, q, v, value, stat)
        case (of_force_qd); call self%force_qd(self, t, q, v, value, stat)
        case default
            value = 0.0_wp
            stat = -1
        end select
    end subroutine evaluate_part

    !> Evaluate terms by single procedures.
    subroutine evaluate_single(self, wanted, t, q, qd, terms, part, failed_term, stat)
        class(procedure_model_type), intent(inout) :: self
        integer, intent(in) :: wanted
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type), intent(inout) :: terms
        real(wp), intent(inout) :: part(:)
        integer, intent(out) :: failed_term, stat

        stat = status_ok
        failed_term = 0
        if (iand(wanted, need_phi) /= 0) then
            failed_term = 1
            if (associated(self%state%timer)) call self%state%timer%begin_call(of_holonomic)
            call self%holonomic(self, t, q, terms%phi, stat)
            if (stat /= 0) return
        end if
        if (iand(wanted, need_jacobian) /= 0) then
            failed_term = 2
            call evaluate_jacobian(self, t, q, terms%jacobian, stat)
            if (stat /= 0) return
        end if
        if (iand(wanted, need_nu) /= 0) then
            failed_term = 3
            call evaluate_nu(self, t, q, terms%nu, stat)
            if (stat /= 0) return
        end if
        if (iand(wanted, need_gamma) /= 0) then
            failed_term = 4
            if (associated(self%state%timer)) call self%state%timer%begin_call(of_constraint_acceleration)
            call self%constraint_acceleration(self, t, q, qd, terms%gamma, stat)
            if (stat /= 0) return
        end if
        if (iand(wanted, need_mass) /= 0) then
            failed_term = 5
            if (associated(self%state%timer)) call self%state%timer%begin_call(of_mass_matrix)
            call self%mass_matrix(self, q, terms%mass, stat)
            if (stat /= 0) return
        end if
        if (iand(wanted, need_force) /= 0) then
            failed_term = 6
            call evaluate_force(self, t, q, qd, terms%force, part, stat)
        end if
    end subroutine evaluate_single

    !> C = [Phi_q; E].
    subroutine evaluate_jacobian(self, t, q, c, stat)
        class(procedure_model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(inout) :: c(:, :)
        integer, intent(out) :: stat

        stat = 0
        associate (nh => self%n_holonomic)
            if (nh > 0) then
                if (associated(self%state%timer)) call self%state%timer%begin_call(of_holonomic_jacobian)
                call self%holonomic_jacobian(self, t, q, c(:nh, :), stat)
            end if
            if (stat /= 0 .or. self%n_nonholonomic == 0) return
            if (associated(self%state%timer)) call self%state%timer%begin_call(of_nonholonomic_jacobian)
            call self%nonholonomic_jacobian(self, t, q, c(nh + 1:, :), stat)
        end associate
    end subroutine evaluate_jacobian

    !> nu = [-Phi_t; e].
    subroutine evaluate_nu(self, t, q, nu, stat)
        class(procedure_model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:)
        real(wp), intent(inout) :: nu(:)
        integer, intent(out) :: stat

        stat = 0
        associate (nh => self%n_holonomic)
            if (associated(self%holonomic_rate)) then
                if (associated(self%state%timer)) call self%state%timer%begin_call(of_holonomic_rate)
                call self%holonomic_rate(self, t, q, nu(:nh), stat)
                nu(:nh) = -nu(:nh)
            end if
            if (stat /= 0 .or. .not. associated(self%nonholonomic_rhs)) return
            if (associated(self%state%timer)) call self%state%timer%begin_call(of_nonholonomic_rhs)
            call self%nonholonomic_rhs(self, t, q, nu(nh + 1:), stat)
        end associate
    end subroutine evaluate_nu

    !> Set S + Q_A. A model may have either force or both.
    subroutine evaluate_force(self, t, q, qd, force, part, stat)
        class(procedure_model_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:)
        real(wp), intent(inout) :: force(:), part(:)
        integer, intent(out) :: stat

        if (.not. associated(self%inertia_force)) then
            if (associated(self%state%timer)) call self%state%timer%begin_call(of_applied_force)
            call self%applied_force(self, t, q, qd, force, stat)
            return
        end if
        if (associated(self%state%timer)) call self%state%timer%begin_call(of_inertia_force)
        call self%inertia_force(self, q, qd, force, stat)
        if (stat /= 0 .or. .not. associated(self%applied_force)) return
        if (associated(self%state%timer)) call self%state%timer%begin_call(of_applied_force)
        call self%applied_force(self, t, q, qd, part, stat)
        force = force + part
    end subroutine evaluate_force
end module tandem_model_procedures
