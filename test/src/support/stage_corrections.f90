! SPDX-License-Identifier: MIT
!> Newton corrections of one implicit stage, as steppers make them.
module stage_corrections
    use tandem, only: wp
    use tandem_chart, only: goal_type
    use tandem_chart_implicit, only: implicit_chart_type
    implicit none (type, external)
    private

    public :: correct_stage

contains

    !> One correction of a stage whose increments are ha times its rates.
    subroutine correct_stage(chart, is_first, t, ha, q, qd, rate_q, rate_qd, change, stat)
        class(implicit_chart_type), intent(inout) :: chart
        !> True if q are predicted coordinates.
        logical, intent(in) :: is_first
        real(wp), intent(in) :: t, ha
        real(wp), intent(inout), contiguous :: q(:), qd(:), rate_q(:), rate_qd(:)
        !> See `update` of the chart.
        real(wp), intent(out) :: change
        integer, intent(out) :: stat
        real(wp) :: residual(chart%n_residual), rate(chart%n, 2)

        change = huge(1.0_wp)
        rate(:, 1) = rate_q
        rate(:, 2) = rate_qd
        call chart%find_residual(goal_type(is_iterate=.true., is_first=is_first, stage=1), t, ha*rate, q, qd, rate, residual, stat)
        if (stat == 0) call chart%solve(residual)
        if (stat == 0) call chart%update(1, q, qd, ha, residual, rate, change, stat)
        rate_q = rate(:, 1)
        rate_qd = rate(:, 2)
    end subroutine correct_stage
end module stage_corrections
