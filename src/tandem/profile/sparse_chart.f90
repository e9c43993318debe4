! SPDX-License-Identifier: MIT
!> The same for sparse charts. Points, velocities and accelerations of a step are separate operations of the chart itself.
module tandem_profile_sparse_chart
    use tandem_kinds, only: wp
    use tandem_profile_ledger, only: mark_type, profile_type
    use tandem_profile_parts, only: part_acceleration, part_correction, part_stage, part_energy, part_errors, part_filter, &
        part_matrix, part_multipliers, part_position, part_projection, part_rank, part_refresh, part_renew, part_reuse, &
        part_velocity
    use tandem_chart_sparse, only: own_chart_type => sparse_chart_type
    implicit none (type, external)
    private

    public :: profiled_chart_type

    !> Pass one, with its `profile` set, to `initialize` of the simulation.
    type, extends(own_chart_type) :: profiled_chart_type
        !> Measured times; must outlive the simulation.
        type(profile_type), pointer :: profile => null()
    contains
        procedure :: renew, refresh, restore_position, restore_velocity, solve_dynamics
        procedure :: factor_stage, reuse_stage
        procedure :: stage_residual, solve_real, solve_pair, update_stage, filter_error
        procedure :: restore_near, multipliers, project_velocity, constraint_errors
        procedure :: measure_rank, kinetic_energy, loss_ahead
    end type profiled_chart_type

contains

    include 'booking.inc'
end module tandem_profile_sparse_chart
