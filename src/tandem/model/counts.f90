! SPDX-License-Identifier: MIT
!> Counters of the work of a chart. Tests use them to show that no work is repeated.
module tandem_model_counts
    use tandem_kinds, only: long, wp
    use tandem_model_derivatives, only: n_derivatives
    use tandem_model_terms, only: n_terms
    use tandem_pack, only: pack_type
    implicit none (type, external)
    private

    public :: counts_type

    type :: counts_type
        !> Evaluations of the index-0 right-hand side.
        integer(long) :: right_hand_sides = 0
        !> Corrections of u (17), of B (20) and of H (29).
        integer(long) :: position_corrections = 0, b_corrections = 0, h_corrections = 0
        !> Numbers of factorisations: of Phi_q U, of C, of D' M D, and QR or SVD for bases.
        integer(long) :: position_factorizations = 0, constraint_factorizations = 0, mass_factorizations = 0
        integer(long) :: basis_factorizations = 0
        !> Evaluations of each term of the model, see `term_name`; calls of the fused procedure.
        integer(long) :: terms(n_terms) = 0, fused_calls = 0
        !> Evaluations of C in the search for integrable rows, once at the start.
        integer(long) :: start_evaluations = 0
        !> Newton matrices of implicit stages, each with evaluations of derivatives; their factorisations, which a change of the
        !> step size repeats without derivatives; corrections of stages; stages.
        integer(long) :: newton_matrices = 0, newton_factorizations = 0, newton_corrections = 0, implicit_stages = 0
        !> Evaluations of each derivative by the model's own procedures, see `derivative_name`; evaluations of terms for finite
        !> differences in place of derivatives and of gamma.
        integer(long) :: derivatives(n_derivatives) = 0, difference_evaluations = 0, gamma_evaluations = 0
        !> Largest noise of a gamma that is computed by differences, on the natural scale of its row; 0 for a model that provides
        !> gamma.
        real(wp) :: gamma_noise = 0.0_wp
        !> Evaluations, on request only, of the multipliers, of the kinetic and of the potential energy.
        integer(long) :: multipliers = 0, kinetic_energies = 0, potential_energies = 0
    contains
        procedure :: pack_state
    end type counts_type

contains

    !> Pack all counters.
    subroutine pack_state(self, pack)
        class(counts_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%right_hand_sides, self%position_corrections, self%b_corrections, self%h_corrections)
        call pack%item(self%position_factorizations, self%constraint_factorizations, self%mass_factorizations)
        call pack%item(self%basis_factorizations)
        call pack%fixed(self%terms)
        call pack%item(self%fused_calls, self%start_evaluations, self%newton_matrices, self%newton_factorizations)
        call pack%item(self%newton_corrections, self%implicit_stages)
        call pack%fixed(self%derivatives)
        call pack%item(self%difference_evaluations, self%gamma_evaluations)
        call pack%item(self%gamma_noise)
        call pack%item(self%multipliers, self%kinetic_energies, self%potential_energies)
    end subroutine pack_state
end module tandem_model_counts
