! SPDX-License-Identifier: MIT
!> A chart that serves explicit steppers alone: what only implicit ones ask for ends with a failure here, unless it is overridden.
!> Its `initialize` refuses them before.
module tandem_chart_explicit
    use tandem_chart, only: chart_type
    use tandem_kinds, only: wp
    use tandem_status, only: status_newton_failed
    implicit none (type, external)
    private

    public :: explicit_chart_type

    !> A chart for explicit steppers alone: what implicit stages ask of a chart is refused.
    type, abstract, extends(chart_type) :: explicit_chart_type
    contains
        procedure :: factor_stage, reuse_stage, matrix_cost, correct_stage, expect_pairs
        procedure :: find_residual, solve_real, solve_pair, move_rates, filter_error
    end type explicit_chart_type

contains

    !> There is no Newton matrix.
    subroutine factor_stage(self, t, q, qd, qdd, ha, stat)
        class(explicit_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:), qdd(:)
        real(wp), intent(in) :: ha
        integer, intent(out) :: stat

        stat = status_newton_failed
    end subroutine factor_stage

    !> There is none.
    subroutine reuse_stage(self, ha, can)
        class(explicit_chart_type), intent(inout) :: self
        real(wp), intent(in) :: ha
        logical, intent(out) :: can

        can = .false.
    end subroutine reuse_stage

    pure real(wp) function matrix_cost(self)
        class(explicit_chart_type), intent(in) :: self

        matrix_cost = 1.0_wp
    end function matrix_cost

    !> No stage is corrected.
    subroutine correct_stage(self, t, q, qd, ha, rate_q, rate_qd, change, stat)
        class(explicit_chart_type), intent(inout) :: self
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:)
        real(wp), intent(in) :: ha
        real(wp), intent(inout), contiguous :: rate_q(:), rate_qd(:)
        real(wp), intent(out) :: change
        integer, intent(out) :: stat

        change = huge(1.0_wp)
        stat = status_newton_failed
    end subroutine correct_stage

    !> Explicit steps solve for no pairs.
    subroutine expect_pairs(self, ratios)
        class(explicit_chart_type), intent(inout) :: self
        complex(wp), intent(in), contiguous :: ratios(:)
    end subroutine expect_pairs

    !> No stage has a residual.
    subroutine find_residual(self, stage, t, q, qd, rate_q, rate_qd, residual, stat)
        class(explicit_chart_type), intent(inout) :: self
        integer, intent(in) :: stage
        real(wp), intent(in) :: t
        real(wp), intent(in), contiguous :: q(:), qd(:)
        real(wp), intent(inout), contiguous :: rate_q(:), rate_qd(:)
        real(wp), intent(inout), contiguous :: residual(:)
        integer, intent(out) :: stat

        stat = status_newton_failed
    end subroutine find_residual

    !> Corrections that nobody has asked for are zero.
    subroutine solve_real(self, x)
        class(explicit_chart_type), intent(inout) :: self
        real(wp), intent(inout), contiguous :: x(:)

        x = 0.0_wp
    end subroutine solve_real

    !> Nor are there any of pairs.
    subroutine solve_pair(self, k, x, y)
        class(explicit_chart_type), intent(inout) :: self
        integer, intent(in) :: k
        real(wp), intent(inout), contiguous :: x(:), y(:)

        x = 0.0_wp
        y = 0.0_wp
    end subroutine solve_pair

    !> No stage moves.
    subroutine move_rates(self, stage, q, qd, ha, correction, rate_q, rate_qd, change, stat)
        class(explicit_chart_type), intent(inout) :: self
        integer, intent(in) :: stage
        real(wp), intent(in), contiguous :: q(:), qd(:)
        real(wp), intent(in) :: ha
        real(wp), intent(in), contiguous :: correction(:)
        real(wp), intent(inout), contiguous :: rate_q(:), rate_qd(:)
        real(wp), intent(out) :: change
        integer, intent(out) :: stat

        change = huge(1.0_wp)
        stat = status_newton_failed
    end subroutine move_rates

    !> Errors of explicit steps are what they are.
    subroutine filter_error(self, error_q, error_qd)
        class(explicit_chart_type), intent(inout) :: self
        real(wp), intent(inout), contiguous :: error_q(:), error_qd(:)
    end subroutine filter_error
end module tandem_chart_explicit
