! SPDX-License-Identifier: MIT
!> Terms of the equations of motion at one point (t, q, qd), and the bits that denote them in a need mask.
module tandem_model_terms
    use tandem_kinds, only: wp
    use tandem_model_pattern, only: pattern_type
    use tandem_pack, only: pack_type
    implicit none (type, external)
    private

    public :: terms_type, n_terms, term_name
    public :: need_phi, need_jacobian, need_nu, need_gamma, need_mass, need_force

    !> Phi(t, q), the holonomic constraints (1).
    integer, parameter :: need_phi = 1
    !> C(t, q) = [Phi_q; E] (3), holonomic rows first.
    integer, parameter :: need_jacobian = 2
    !> nu(t, q) = [-Phi_t; e], the right-hand side of the velocity constraints (6).
    integer, parameter :: need_nu = 4
    !> gamma(t, q, qd) of the acceleration constraints C qdd = -gamma (7), (8).
    integer, parameter :: need_gamma = 8
    !> M(q), the mass matrix (35).
    integer, parameter :: need_mass = 16
    !> S(q, qd) + Q_A(t, q, qd), inertia and applied forces (35).
    integer, parameter :: need_force = 32

    !> Number of terms; term i has the bit 2**(i - 1).
    integer, parameter :: n_terms = 6
    !> Names in reports, in the order of the bits.
    character(len=12), parameter :: term_name(n_terms) = &
        [character(len=12) :: 'phi', 'jacobian', 'nu', 'gamma', 'mass', 'force']

    !> Values of the terms. A term that the model lacks remains zero.
    type :: terms_type
        !> Phi (nh).
        real(wp), allocatable :: phi(:)
        !> True if C and M are compressed according to the model's pattern, see `tandem_model_pattern`.
        logical :: is_compressed = .false.
        !> C (nh + nd, n), compressed (nh + nd, width).
        real(wp), allocatable :: jacobian(:, :)
        !> Blocks of C, if a chart requests them, see `tandem_model_pattern`.
        real(wp), allocatable :: blocks(:)
        !> nu (nh + nd).
        real(wp), allocatable :: nu(:)
        !> gamma (nh + nd).
        real(wp), allocatable :: gamma(:)
        !> M (n, n), compressed (n, mass_width).
        real(wp), allocatable :: mass(:, :)
        !> S + Q_A (n).
        real(wp), allocatable :: force(:)
    contains
        procedure :: allocate => allocate_terms, pack_state
    end type terms_type

contains

    !> Allocate all terms, set to zero.
    pure subroutine allocate_terms(self, n, n_holonomic, n_nonholonomic, fills_mass, pattern, has_jacobian)
        class(terms_type), intent(inout) :: self
        !> Numbers of coordinates, holonomic and nonholonomic constraints.
        integer, intent(in) :: n, n_holonomic, n_nonholonomic
        !> If false, M is allocated but not set. Its memory is then never touched, which is for models that set more than the
        !> requested terms.
        logical, intent(in), optional :: fills_mass
        !> If present, C and M are compressed.
        type(pattern_type), intent(in), optional :: pattern
        !> If false, C has no columns.
        logical, intent(in), optional :: has_jacobian
        integer :: m, width, mass_width

        self%is_compressed = present(pattern)
        width = n
        mass_width = n
        if (present(pattern)) then
            width = pattern%width
            mass_width = pattern%mass_width
        end if
        if (present(has_jacobian)) width = merge(width, 0, has_jacobian)
        m = n_holonomic + n_nonholonomic
        ! Avoid temporaries, which would fragment the memory.
        if (allocated(self%phi)) deallocate (self%phi, self%nu, self%gamma, self%force, self%jacobian, self%mass)
        allocate (self%phi(n_holonomic), self%nu(m), self%gamma(m), self%force(n), self%jacobian(m, width), source=0.0_wp)
        allocate (self%mass(n, mass_width))
        if (present(fills_mass)) then
            if (.not. fills_mass) return
        end if
        self%mass = 0.0_wp
    end subroutine allocate_terms

    !> Pack all values.
    subroutine pack_state(self, pack)
        class(terms_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%phi)
        call pack%item(self%jacobian)
        call pack%item(self%nu, self%gamma)
        call pack%item(self%mass)
        call pack%item(self%force)
    end subroutine pack_state
end module tandem_model_terms
