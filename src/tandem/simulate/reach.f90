! SPDX-License-Identifier: MIT
!> Largest step on one chart.
!>
!> The position on a chart is found by Newton's iteration with C of its origin, which converges ever more slowly with the distance
!> and finally not at all: for a body that turns by theta, C of its Euler parameters leaves the part 1 - cos(theta/2) of a
!> correction, so that no step turns it by half a turn. The part that the last step would have left is taken for the cosine of an
!> angle, which grows with the length of steps; its growth per time is taken from the last two measured steps. If a step fails
!> although the predicted angle is small, later steps stay below that angle: the motion turns faster than before, or stages are far
!> from the manifold.
module tandem_simulate_reach
    use tandem_chart, only: chart_type, measure_type, need_contraction
    use tandem_kinds, only: wp
    use tandem_pack, only: pack_type
    use tandem_stepper_state, only: state_type
    implicit none (type, external)
    private

    public :: reach_type

    !> The largest angle of a step before the first failure (rad), and the lower bound of the limit after failures.
    real(wp), parameter :: farthest = 1.4_wp, nearest = 0.4_wp
    !> Limit of the next steps relative to the angle of a failed step, and the factor by which each of them raises it.
    real(wp), parameter :: below = 0.75_wp, rise = 1.003_wp
    !> Largest growth of the angle per time from one measured step to the next that is expected to continue.
    real(wp), parameter :: fastest_growth = 1.3_wp
    !> Below this part of the limit at most `most_skipped` steps are left unmeasured, unless they grow by this factor.
    real(wp), parameter :: small = 0.25_wp, grown = 1.5_wp
    integer, parameter :: most_skipped = 4

    type :: reach_type
        !> The largest angle (rad); the angle of the last measured step, over its length (rad/s); that length; the number of steps
        !> since then.
        real(wp), private :: limit = farthest, rate = 0.0_wp, length = 0.0_wp
        integer, private :: skipped = 0
    contains
        procedure :: begin, find_longest, note_failure, pack_state
    end type reach_type

contains

    !> Begin a run.
    subroutine begin(self)
        class(reach_type), intent(out) :: self
    end subroutine begin

    !> The longest step after the one from `start`, where its chart was made, to `arrived`, where its rank was measured.
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
        self%limit = min(rise*self%limit, farthest)
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

    !> A step of size h could not be completed.
    pure subroutine note_failure(self, h)
        class(reach_type), intent(inout) :: self
        real(wp), intent(in) :: h

        if (self%rate*h > nearest) self%limit = max(nearest, min(self%limit, below*self%rate*h))
    end subroutine note_failure

    !> The limit and the last measurement.
    subroutine pack_state(self, pack)
        class(reach_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%limit, self%rate, self%length)
        call pack%item(self%skipped)
    end subroutine pack_state
end module tandem_simulate_reach
