! SPDX-License-Identifier: MIT
!> Table of the procedures that C and Fortran 77 callers can provide: their names, which are those of the components of
!> `procedure_model_type`, and the types of their argument lists.
module tandem_legacy_terms
    implicit none (type, external)
    private

    public :: term_row_type, terms, n_callbacks, find_term, names_of_kind
    public :: of_position, of_motion, of_direction
    public :: a_holonomic, a_holonomic_jacobian, a_holonomic_rate, a_nonholonomic_jacobian, a_nonholonomic_rhs, a_mass_matrix
    public :: a_potential_energy, a_nu_derivative, a_constraint_acceleration, an_inertia_force, an_applied_force
    public :: a_kinetic_energy, a_gamma_q, a_gamma_qd, a_force_q, a_force_qd
    public :: a_jacobian_derivative, a_reaction_derivative, a_mass_derivative

    !> Types of argument lists: (t, q), (t, q, qd), and (t, q, x) with a constant vector x.
    integer, parameter :: of_position = 1, of_motion = 2, of_direction = 3

    !> Indices of the procedures in the table below.
    integer, parameter :: a_holonomic = 1, a_holonomic_jacobian = 2, a_holonomic_rate = 3, a_nonholonomic_jacobian = 4
    integer, parameter :: a_nonholonomic_rhs = 5, a_mass_matrix = 6, a_potential_energy = 7, a_nu_derivative = 8
    integer, parameter :: a_constraint_acceleration = 9, an_inertia_force = 10, an_applied_force = 11, a_kinetic_energy = 12
    integer, parameter :: a_gamma_q = 13, a_gamma_qd = 14, a_force_q = 15, a_force_qd = 16
    integer, parameter :: a_jacobian_derivative = 17, a_reaction_derivative = 18, a_mass_derivative = 19
    !> Number of procedures.
    integer, parameter :: n_callbacks = 19

    !> Row of the table.
    type :: term_row_type
        !> Name of the component of `procedure_model_type`.
        character(len=24) :: name
        !> `of_position`, `of_motion` or `of_direction`.
        integer :: kind
    end type term_row_type

    !> The table of procedures.
    type(term_row_type), parameter :: terms(n_callbacks) = [ &
        term_row_type('holonomic', of_position), &
        term_row_type('holonomic_jacobian', of_position), &
        term_row_type('holonomic_rate', of_position), &
        term_row_type('nonholonomic_jacobian', of_position), &
        term_row_type('nonholonomic_rhs', of_position), &
        term_row_type('mass_matrix', of_position), &
        term_row_type('potential_energy', of_position), &
        term_row_type('nu_derivative', of_position), &
        term_row_type('constraint_acceleration', of_motion), &
        term_row_type('inertia_force', of_motion), &
        term_row_type('applied_force', of_motion), &
        term_row_type('kinetic_energy', of_motion), &
        term_row_type('gamma_q', of_motion), &
        term_row_type('gamma_qd', of_motion), &
        term_row_type('force_q', of_motion), &
        term_row_type('force_qd', of_motion), &
        term_row_type('jacobian_derivative', of_direction), &
        term_row_type('reaction_derivative', of_direction), &
        term_row_type('mass_derivative', of_direction)]

contains

    !> Index of the procedure with a name in lower case; 0 if there is none.
    pure integer function find_term(name)
        !> Name, trailing blanks allowed.
        character(len=*), intent(in) :: name

        do find_term = n_callbacks, 1, -1
            if (terms(find_term)%name == name) return
        end do
    end function find_term

    !> Names of the procedures with one type of argument list, separated by commas, for messages.
    pure function names_of_kind(kind) result(text)
        !> `of_position`, `of_motion` or `of_direction`.
        integer, intent(in) :: kind
        character(len=2*n_callbacks + sum(len_trim(terms%name), terms%kind == kind)) :: text
        integer :: i

        text = ''
        do i = 1, n_callbacks
            if (terms(i)%kind /= kind) cycle
            if (text /= '') text = trim(text)//','
            text = trim(text)//' '//terms(i)%name
        end do
        text = adjustl(text)
    end function names_of_kind
end module tandem_legacy_terms
