! SPDX-License-Identifier: MIT
!> What a chart has done: the counters behind the claim that a scene pays for nothing that it does not need.
module tandem_tangent_counts
    use tandem_kinds, only: long
    use tandem_model_terms, only: n_terms
    implicit none
    private

    public :: counts_type

    type :: counts_type
        !> Evaluations of the index-0 right-hand side.
        integer(long) :: right_hand_sides = 0
        !> Corrections of u (17), of B (20) and of H (29).
        integer(long) :: position_corrections = 0, b_corrections = 0, h_corrections = 0
        !> Factorisations: of Phi_q U, of C, of D' M D, and QR or SVD for bases.
        integer(long) :: position_factorizations = 0, constraint_factorizations = 0, mass_factorizations = 0
        integer(long) :: basis_factorizations = 0
        !> Evaluations of each term of the model, see `term_name`; calls of the fused procedure.
        integer(long) :: terms(n_terms) = 0, fused_calls = 0
        !> Computations of the multipliers, of kinetic and of potential energy: only where somebody asked.
        integer(long) :: multipliers = 0, kinetic_energies = 0, potential_energies = 0
    end type counts_type
end module tandem_tangent_counts
