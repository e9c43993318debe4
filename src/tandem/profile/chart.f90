! SPDX-License-Identifier: MIT
!> The chart of a simulation with time measurement of its operations.
!>
!> It extends the chart instead of forwarding to one, so that its data and counters are the same variables: steps give identical
!> results. Operations not listed here take negligible time, or are done once.
module tandem_profile_chart
    use tandem_kinds, only: wp
    use tandem_profile_ledger, only: mark_type, profile_type
    use tandem_profile_parts, only: part_acceleration, part_correction, part_stage, part_energy, part_errors, part_filter, &
        part_health, part_matrix, part_multipliers, part_position, part_projection, part_rank, part_refresh, part_renew, &
        part_reuse, part_velocity
    use tandem_status, only: status_ok
    use tandem_chart, only: health_type
    use tandem_chart_dense, only: own_chart_type => dense_chart_type
    implicit none (type, external)
    private

    public :: profiled_chart_type

    !> Pass one, with its `profile` set, to `initialize` of the simulation.
    type, extends(own_chart_type) :: profiled_chart_type
        !> Measured times; must outlive the simulation.
        type(profile_type), pointer :: profile => null()
    contains
        procedure :: renew, refresh
        procedure :: restore_position, restore_velocity, solve_dynamics, restore_motion, restore_near
        procedure :: factor_stage, reuse_stage
        procedure :: stage_residual, solve_real, solve_pair, update_stage, filter_error
        procedure :: multipliers, project_velocity, constraint_errors
        procedure :: measure_rank, measure_health, kinetic_energy, loss_ahead
    end type profiled_chart_type

contains

    include 'booking.inc'

    subroutine restore_motion(self, t, increment, increment_qd, q, qd, qdd, stat)
        class(profiled_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t, increment(self%n), increment_qd(self%n)
        real(wp), intent(out) :: q(self%n), qd(self%n), qdd(self%n)
        integer, intent(out) :: stat

        ! As in the chart itself: data of the last point is invalid.
        call self%forget()
        call self%restore_position(t, increment, q, stat)
        if (stat == status_ok) call self%restore_velocity(t, q, increment_qd, qd, stat)
        if (stat == status_ok) call self%solve_dynamics(t, q, qd, qdd, stat)
    end subroutine restore_motion

    subroutine measure_health(self, t, q, qd, health, stat)
        class(profiled_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:)
        type(health_type), intent(out) :: health
        integer, intent(out) :: stat
        type(mark_type) :: mark

        call self%profile%enter(part_health, mark)
        call self%own_chart_type%measure_health(t, q, qd, health, stat)
        call self%profile%leave(mark)
    end subroutine measure_health
end module tandem_profile_chart
