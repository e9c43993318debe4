! SPDX-License-Identifier: MIT
!> Largest step for which one chart suffices.
!>
!> The position on a chart is found by Newton's iteration with C of the chart's origin. The iteration converges more slowly with
!> increasing distance, and finally diverges. For a body that rotates by theta, each correction with C of its Euler parameters
!> leaves the fraction 1 - cos(theta/2) of the error, so that no step can rotate it by pi. The fraction that would have remained in
!> the last step is interpreted as one minus the cosine of an angle. This angle grows with the step size; its rate of growth is
!> taken from the last two measured steps. If a step fails although the predicted angle is small, later steps are limited to less
!> than this angle: the rotation has accelerated, or stages are far from the manifold.
module tandem_simulate_reach
    use tandem_chart, only: chart_type, measure_type, need_contraction
    use tandem_kinds, only: wp
    use tandem_pack, only: pack_type
    use tandem_stepper_state, only: state_type
    implicit none (type, external)
    private

    public :: reach_type

    !> Largest angle of a step before the first failure (rad); smallest limit after failures.
    real(wp), parameter :: largest_angle = 1.4_wp, smallest_limit = 0.4_wp
    !> Limit after a failure, relative to the angle of the failed step; factor by which each later step raises the limit.
    real(wp), parameter :: below = 0.75_wp, rise = 1.003_wp
    !> Largest growth of the rate between two measured steps that is assumed to continue.
    real(wp), parameter :: fastest_growth = 1.3_wp
    !> Fraction of the limit below which up to `most_skipped` steps are not measured, unless the step size grows by the factor
    !> `grown`.
    real(wp), parameter :: small = 0.25_wp, grown = 1.5_wp
    integer, parameter :: most_skipped = 4

    type :: reach_type
        !> Largest angle (rad); angle of the last measured step divided by its size (rad/s); this size; number of steps since then.
        real(wp), private :: limit = largest_angle, rate = 0.0_wp, length = 0.0_wp
        integer, private :: skipped = 0
    contains
        procedure :: begin, find_longest, note_failure, pack_state
    end type reach_type

contains

    !> Begin a run.
    subroutine begin(self)
        class(reach_type), intent(out) :: self
    end subroutine begin

    !> Longest step after the one from `start`, the origin of its chart, to `arrived`, at which its rank was measured.
    subroutine find_longest(self, chart, start, arrived, longest)
        class(reach_type), intent(inout) :: self
        class(chart_type), intent(inout) :: chart
        type(state_type), intent(in) :: start, arrived
        real(wp), intent(out) :: longest
        type(measure_type) :: measure
        real(wp) :: growth, h, last_rate
        integer :: stat

        h = arrived%t - start%t
        growth = 1.0_wp
        self%limit = min(rise*self%limit, largest_angle)
        self%skipped = self%skipped + 1
        if (self%skipped > most_skipped .or. h > grown*self%length .or. self%rate*h > small*self%limit) then
            call chart%measure(need_contraction, start%t, start%q, arrived%t, arrived%q, arrived%qd, measure, stat)
            last_rate = self%rate
            self%rate = acos(1.0_wp - min(measure%contraction, 2.0_wp))/h
            self%length = h
            self%skipped = 0
            if (last_rate > 0.0_wp) growth = min(max(self%rate/last_rate, 1.0_wp), fastest_growth)
        end if
        longest = huge(1.0_wp)
        if (self%rate > 0.0_wp) longest = self%limit/(growth*self%rate)
    end subroutine find_longest

    !> Record that a step of size h failed.
    pure subroutine note_failure(self, h)
        class(reach_type), intent(inout) :: self
        real(wp), intent(in) :: h

        if (self%rate*h > smallest_limit) self%limit = max(smallest_limit, min(self%limit, below*self%rate*h))
    end subroutine note_failure

    !> Pack the limit and the last measurement.
    subroutine pack_state(self, pack)
        class(reach_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%limit, self%rate, self%length)
        call pack%item(self%skipped)
    end subroutine pack_state
end module tandem_simulate_reach
