! SPDX-License-Identifier: MIT
!> The terms of a model at a point, gathered without the library's evaluator.
module terms_at
    use tandem, only: model_type, need_force, need_gamma, need_jacobian, need_mass, need_nu, need_phi, terms_type, wp
    implicit none (type, external)
    private

    public :: get_terms, all_terms

    !> Every term.
    integer, parameter :: all_terms = need_phi + need_jacobian + need_nu + need_gamma + need_mass + need_force

contains

    !> Every term of a model at (t, q, qd); stat is the worst status of the calls.
    subroutine get_terms(model, t, q, qd, terms, stat)
        class(model_type), intent(inout) :: model
        real(wp), intent(in) :: t, q(:), qd(:)
        type(terms_type), intent(inout) :: terms
        integer, intent(out) :: stat
        real(wp) :: force(size(q))
        integer :: found(9)

        found = 0
        call terms%allocate(model%n, model%n_holonomic, model%n_nonholonomic)
        if (associated(model%evaluate)) call model%evaluate(model%provides, t, q, qd, terms, found(1))
        associate (nh => model%n_holonomic, missing => iand(all_terms, not(model%provides)))
            if (wanted(need_phi) .and. nh > 0) call model%holonomic(t, q, terms%phi, found(2))
            if (wanted(need_jacobian)) then
                if (nh > 0) call model%holonomic_jacobian(t, q, terms%jacobian(:nh, :), found(3))
                if (model%n_nonholonomic > 0) call model%nonholonomic_jacobian(t, q, terms%jacobian(nh + 1:, :), found(4))
            end if
            if (wanted(need_nu)) then
                if (associated(model%holonomic_rate)) call model%holonomic_rate(t, q, terms%nu(:nh), found(5))
                terms%nu(:nh) = -terms%nu(:nh)
                if (associated(model%nonholonomic_rhs)) call model%nonholonomic_rhs(t, q, terms%nu(nh + 1:), found(5))
            end if
            if (wanted(need_gamma) .and. model%n_constraints() > 0) then
                call model%constraint_acceleration(t, q, qd, terms%gamma, found(6))
            end if
            if (wanted(need_mass)) call model%mass_matrix(q, terms%mass, found(7))
            if (wanted(need_force)) then
                if (associated(model%inertia_force)) call model%inertia_force(q, qd, terms%force, found(8))
                if (associated(model%applied_force)) then
                    call model%applied_force(t, q, qd, force, found(9))
                    terms%force = terms%force + force
                end if
            end if
        end associate
        stat = found(maxloc(abs(found), dim=1))

    contains

        !> True if a term must come from the single procedures.
        logical function wanted(bit)
            integer, intent(in) :: bit

            wanted = iand(model%provides, bit) == 0
        end function wanted
    end subroutine get_terms
end module terms_at
