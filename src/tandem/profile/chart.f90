! SPDX-License-Identifier: MIT
!> The chart of a simulation that books the time of what it is asked for.
!>
!> It extends the chart instead of forwarding to one, so that its numbers and counters are the same variables: a step takes the
!> same course. What is not here is of no account, or done once.
module tandem_profile_chart
    use tandem_kinds, only: wp
    use tandem_profile_ledger, only: mark_type, profile_type
    use tandem_profile_parts, only: part_acceleration, part_correction, part_coupled, part_energy, part_errors, part_filter, &
        part_health, part_matrix, part_multipliers, part_position, part_projection, part_rank, part_refresh, part_renew, &
        part_reuse, part_velocity
    use tandem_status, only: status_ok
    use tandem_chart, only: health_type
    use tandem_chart_dense, only: dense_chart_type
    implicit none (type, external)
    private

    public :: profiled_chart_type

    !> Give one with its `profile` to `initialize` of the simulation.
    type, extends(dense_chart_type) :: profiled_chart_type
        !> Where the time is booked; it must outlive the simulation.
        type(profile_type), pointer :: profile => null()
    contains
        procedure :: renew
        procedure :: refresh
        procedure :: restore_position
        procedure :: restore_velocity
        procedure :: solve_dynamics
        procedure :: restore_motion
        procedure :: restore_near
        procedure :: factor_stage
        procedure :: reuse_stage
        procedure :: correct_stage
        procedure :: find_residual
        procedure :: solve_real
        procedure :: solve_pair
        procedure :: move_rates
        procedure :: filter_error
        procedure :: multipliers
        procedure :: project_velocity
        procedure :: constraint_errors
        procedure :: measure_rank
        procedure :: measure_health
        procedure :: kinetic_energy
        procedure :: loss_ahead
    end type profiled_chart_type

contains

    subroutine renew(self, t, q, qd, stat)
        class(profiled_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:)
        integer, intent(out) :: stat
        type(mark_type) :: mark

        call self%profile%enter(part_renew, mark)
        call self%dense_chart_type%renew(t, q, qd, stat)
        call self%profile%leave(mark)
    end subroutine renew

    subroutine refresh(self, t, q, stat)
        class(profiled_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:)
        integer, intent(out) :: stat
        type(mark_type) :: mark

        call self%profile%enter(part_refresh, mark)
        call self%dense_chart_type%refresh(t, q, stat)
        call self%profile%leave(mark)
    end subroutine refresh

    subroutine restore_position(self, t, increment, q, stat)
        class(profiled_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in) :: increment(self%n)
        real(wp), intent(out) :: q(self%n)
        integer, intent(out) :: stat
        type(mark_type) :: mark

        call self%profile%enter(part_position, mark)
        call self%dense_chart_type%restore_position(t, increment, q, stat)
        call self%profile%leave(mark)
    end subroutine restore_position

    subroutine restore_velocity(self, t, q, increment, qd, stat)
        class(profiled_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in) :: q(self%n)
        real(wp), intent(in) :: increment(self%n)
        real(wp), intent(out) :: qd(self%n)
        integer, intent(out) :: stat
        type(mark_type) :: mark

        call self%profile%enter(part_velocity, mark)
        call self%dense_chart_type%restore_velocity(t, q, increment, qd, stat)
        call self%profile%leave(mark)
    end subroutine restore_velocity

    subroutine solve_dynamics(self, t, q, qd, qdd, stat)
        class(profiled_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in) :: q(self%n), qd(self%n)
        real(wp), intent(out) :: qdd(self%n)
        integer, intent(out) :: stat
        type(mark_type) :: mark

        call self%profile%enter(part_acceleration, mark)
        call self%dense_chart_type%solve_dynamics(t, q, qd, qdd, stat)
        call self%profile%leave(mark)
    end subroutine solve_dynamics

    subroutine restore_motion(self, t, increment, increment_qd, q, qd, qdd, stat)
        class(profiled_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in) :: increment(self%n), increment_qd(self%n)
        real(wp), intent(out) :: q(self%n), qd(self%n), qdd(self%n)
        integer, intent(out) :: stat

        ! As in the chart itself: what is known of the last point is not looked at.
        call self%forget()
        call self%restore_position(t, increment, q, stat)
        if (stat == status_ok) call self%restore_velocity(t, q, increment_qd, qd, stat)
        if (stat == status_ok) call self%solve_dynamics(t, q, qd, qdd, stat)
    end subroutine restore_motion

    subroutine restore_near(self, t, q, qd, stat)
        class(profiled_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(inout) :: q(self%n), qd(self%n)
        integer, intent(out) :: stat
        type(mark_type) :: mark

        call self%profile%enter(part_position, mark)
        call self%dense_chart_type%restore_near(t, q, qd, stat)
        call self%profile%leave(mark)
    end subroutine restore_near

    subroutine factor_stage(self, t, q, qd, qdd, ha, stat)
        class(profiled_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:), qdd(:)
        real(wp), intent(in) :: ha
        integer, intent(out) :: stat
        type(mark_type) :: mark

        call self%profile%enter(part_matrix, mark)
        call self%dense_chart_type%factor_stage(t, q, qd, qdd, ha, stat)
        call self%profile%leave(mark)
    end subroutine factor_stage

    subroutine reuse_stage(self, ha, can)
        class(profiled_chart_type), intent(inout) :: self
        real(wp), intent(in) :: ha
        logical, intent(out) :: can
        type(mark_type) :: mark

        call self%profile%enter(part_reuse, mark)
        call self%dense_chart_type%reuse_stage(ha, can)
        call self%profile%leave(mark)
    end subroutine reuse_stage

    subroutine correct_stage(self, t, q, qd, ha, rate_q, rate_qd, change, stat)
        class(profiled_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:)
        real(wp), intent(in) :: ha
        real(wp), intent(inout), contiguous :: rate_q(:), rate_qd(:)
        real(wp), intent(out) :: change
        integer, intent(out) :: stat
        type(mark_type) :: mark

        call self%profile%enter(part_correction, mark)
        call self%dense_chart_type%correct_stage(t, q, qd, ha, rate_q, rate_qd, change, stat)
        call self%profile%leave(mark)
    end subroutine correct_stage

    subroutine find_residual(self, stage, t, q, qd, rate_q, rate_qd, residual, stat)
        class(profiled_chart_type), intent(inout) :: self
        integer, intent(in) :: stage
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:)
        real(wp), intent(inout), contiguous :: rate_q(:), rate_qd(:)
        real(wp), intent(inout), contiguous :: residual(:)
        integer, intent(out) :: stat
        type(mark_type) :: mark

        call self%profile%enter(part_coupled, mark)
        call self%dense_chart_type%find_residual(stage, t, q, qd, rate_q, rate_qd, residual, stat)
        call self%profile%leave(mark)
    end subroutine find_residual

    subroutine solve_real(self, x)
        class(profiled_chart_type), intent(inout) :: self
        real(wp), intent(inout), contiguous :: x(:)
        type(mark_type) :: mark

        call self%profile%enter(part_coupled, mark)
        call self%dense_chart_type%solve_real(x)
        call self%profile%leave(mark)
    end subroutine solve_real

    subroutine solve_pair(self, k, x, y)
        class(profiled_chart_type), intent(inout) :: self
        integer, intent(in) :: k
        real(wp), intent(inout), contiguous :: x(:), y(:)
        type(mark_type) :: mark

        call self%profile%enter(part_coupled, mark)
        call self%dense_chart_type%solve_pair(k, x, y)
        call self%profile%leave(mark)
    end subroutine solve_pair

    subroutine move_rates(self, stage, q, qd, ha, correction, rate_q, rate_qd, change, stat)
        class(profiled_chart_type), intent(inout) :: self
        integer, intent(in) :: stage
        real(wp), intent(in), contiguous :: q(:), qd(:)
        real(wp), intent(in) :: ha
        real(wp), intent(in), contiguous :: correction(:)
        real(wp), intent(inout), contiguous :: rate_q(:), rate_qd(:)
        real(wp), intent(out) :: change
        integer, intent(out) :: stat
        type(mark_type) :: mark

        call self%profile%enter(part_correction, mark)
        call self%dense_chart_type%move_rates(stage, q, qd, ha, correction, rate_q, rate_qd, change, stat)
        call self%profile%leave(mark)
    end subroutine move_rates

    subroutine filter_error(self, error_q, error_qd)
        class(profiled_chart_type), intent(inout) :: self
        real(wp), intent(inout), contiguous :: error_q(:), error_qd(:)
        type(mark_type) :: mark

        call self%profile%enter(part_filter, mark)
        call self%dense_chart_type%filter_error(error_q, error_qd)
        call self%profile%leave(mark)
    end subroutine filter_error

    subroutine multipliers(self, t, q, qd, qdd, lambda, stat)
        class(profiled_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:), qdd(:)
        real(wp), intent(out), contiguous :: lambda(:)
        integer, intent(out) :: stat
        type(mark_type) :: mark

        call self%profile%enter(part_multipliers, mark)
        call self%dense_chart_type%multipliers(t, q, qd, qdd, lambda, stat)
        call self%profile%leave(mark)
    end subroutine multipliers

    subroutine project_velocity(self, t, q, qd, stat)
        class(profiled_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:)
        real(wp), intent(inout), contiguous :: qd(:)
        integer, intent(out) :: stat
        type(mark_type) :: mark

        call self%profile%enter(part_projection, mark)
        call self%dense_chart_type%project_velocity(t, q, qd, stat)
        call self%profile%leave(mark)
    end subroutine project_velocity

    subroutine constraint_errors(self, t, q, qd, qdd, errors, rows, stat)
        class(profiled_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:), qdd(:)
        real(wp), intent(out) :: errors(3)
        integer, intent(out) :: rows(3)
        integer, intent(out) :: stat
        type(mark_type) :: mark

        call self%profile%enter(part_errors, mark)
        call self%dense_chart_type%constraint_errors(t, q, qd, qdd, errors, rows, stat)
        call self%profile%leave(mark)
    end subroutine constraint_errors

    subroutine measure_rank(self, t_from, q_from, t, q, room, stat)
        class(profiled_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t_from, t
        real(wp), intent(in), contiguous :: q_from(:), q(:)
        real(wp), intent(out) :: room
        integer, intent(out) :: stat
        type(mark_type) :: mark

        call self%profile%enter(part_rank, mark)
        call self%dense_chart_type%measure_rank(t_from, q_from, t, q, room, stat)
        call self%profile%leave(mark)
    end subroutine measure_rank

    subroutine measure_health(self, t, q, qd, health, stat)
        class(profiled_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:)
        type(health_type), intent(out) :: health
        integer, intent(out) :: stat
        type(mark_type) :: mark

        call self%profile%enter(part_health, mark)
        call self%dense_chart_type%measure_health(t, q, qd, health, stat)
        call self%profile%leave(mark)
    end subroutine measure_health

    subroutine kinetic_energy(self, t, q, qd, energy, stat)
        class(profiled_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:)
        real(wp), intent(out) :: energy
        integer, intent(out) :: stat
        type(mark_type) :: mark

        call self%profile%enter(part_energy, mark)
        call self%dense_chart_type%kinetic_energy(t, q, qd, energy, stat)
        call self%profile%leave(mark)
    end subroutine kinetic_energy

    integer function loss_ahead(self, t, q, qd, h)
        class(profiled_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:)
        real(wp), intent(in) :: h
        type(mark_type) :: mark

        call self%profile%enter(part_rank, mark)
        loss_ahead = self%dense_chart_type%loss_ahead(t, q, qd, h)
        call self%profile%leave(mark)
    end function loss_ahead
end module tandem_profile_chart
