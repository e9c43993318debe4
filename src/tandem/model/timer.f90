! SPDX-License-Identifier: MIT
!> Interface of timers, which measure the times of calls of a model's procedures and of operations of a chart. Without a timer, the
!> overhead is one test of a pointer per call or operation.
module tandem_model_timer
    use tandem_model_terms, only: n_terms
    implicit none (type, external)
    private

    public :: timer_type
    public :: of_holonomic, of_holonomic_jacobian, of_holonomic_rate, of_nonholonomic_jacobian, of_nonholonomic_rhs, &
        of_constraint_acceleration, of_mass_matrix, of_inertia_force, of_applied_force, of_kinetic_energy, of_potential_energy, &
        of_jacobian_derivative, of_nu_derivative, of_gamma_q, of_gamma_qd, of_mass_derivative, of_reaction_derivative, &
        of_force_q, of_force_qd, of_evaluate, of_evaluate_derivatives
    public :: n_operations, of_origin, of_refresh, of_position, of_velocity, of_acceleration, of_errors, of_rank, of_policy, &
        of_multipliers, of_energy, of_projection, of_matrix, of_reuse, of_correction, of_stage, of_filter

    !> Numbers of calls: single procedures, in the order of `procedure_model_type`. For the fused procedures, the need mask is added
    !> to the number.
    integer, parameter :: of_holonomic = 1, of_holonomic_jacobian = 2, of_holonomic_rate = 3, of_nonholonomic_jacobian = 4, &
        of_nonholonomic_rhs = 5, of_constraint_acceleration = 6, of_mass_matrix = 7, of_inertia_force = 8, &
        of_applied_force = 9, of_kinetic_energy = 10, of_potential_energy = 11, of_jacobian_derivative = 12, &
        of_nu_derivative = 13, of_gamma_q = 14, of_gamma_qd = 15, of_mass_derivative = 16, of_reaction_derivative = 17, &
        of_force_q = 18, of_force_qd = 19, of_evaluate = 19, of_evaluate_derivatives = of_evaluate + 2**n_terms - 1

    !> Numbers of operations of charts.
    integer, parameter :: of_origin = 1, of_refresh = 2, of_position = 3, of_velocity = 4, of_acceleration = 5, of_errors = 6, &
        of_rank = 7, of_policy = 8, of_multipliers = 9, of_energy = 10, of_projection = 11
    !> Numbers of operations of Newton's iteration; number of all operations.
    integer, parameter :: of_matrix = 12, of_reuse = 13, of_correction = 14, of_stage = 15, of_filter = 16, n_operations = 16

    type, abstract :: timer_type
    contains
        procedure(begin_call_interface), deferred :: begin_call
        procedure(end_call_interface), deferred :: end_call
        procedure(begin_call_interface), deferred :: begin_operation
        procedure(end_call_interface), deferred :: end_operation
    end type timer_type

    abstract interface
        !> A procedure is about to be called, after the end of any previous call, or an operation begins, possibly within another
        !> one.
        subroutine begin_call_interface(self, number)
            import :: timer_type
            implicit none (type, external)
            class(timer_type), intent(inout) :: self
            !> One of the numbers of this module.
            integer, intent(in) :: number
        end subroutine begin_call_interface

        !> The current call has ended, or the operation that began last.
        subroutine end_call_interface(self)
            import :: timer_type
            implicit none (type, external)
            class(timer_type), intent(inout) :: self
        end subroutine end_call_interface
    end interface
end module tandem_model_timer
