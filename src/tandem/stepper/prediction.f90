! SPDX-License-Identifier: MIT
!> Start values for the rates of an implicit stage.
!>
!> The polynomial through the nearest past stages misses what is particular to a stage: the stages of a method of stage order 1
!> are off the motion by some J h^2 y'', a different part of it each. But a stage misses in this step about as it did in the steps
!> before. So what each stage's polynomial missed is kept, over ha^2, and its extrapolation of order 0 (the last miss) ... 2 over
!> the last steps is added: of whichever order would have been best in the last step, or nothing, where that was best.
module tandem_stepper_prediction
    use tandem_kinds, only: wp
    use tandem_pack, only: pack_type
    use tandem_stepper_history, only: history_type
    implicit none (type, external)
    private

    public :: prediction_type

    !> Misses kept for each stage.
    integer, parameter :: depth = 3
    !> Weights of the last, the last but one, ... miss, for nothing and for extrapolation of order 0 ... 2.
    real(wp), parameter :: weight(depth, 0:depth) = reshape([ &
        0.0_wp, 0.0_wp, 0.0_wp, &
        1.0_wp, 0.0_wp, 0.0_wp, &
        2.0_wp, -1.0_wp, 0.0_wp, &
        3.0_wp, -3.0_wp, 1.0_wp], [depth, depth + 1])

    type :: prediction_type
        private
        !> Misses over ha^2, newest first, velocities and accelerations: (2 n, depth, stages); how many there are, and what is used
        !> of them (stages).
        real(wp), allocatable :: miss(:, :, :)
        integer, allocatable :: n_kept(:), order(:)
        !> Start of the step of the newest miss (stages).
        real(wp), allocatable :: t_start(:)
        !> The last extrapolation of past stages (n), a miss (2 n), what misses are measured by (2 n).
        real(wp), allocatable :: plain_q(:), plain_qd(:), new(:), weight_of(:)
    contains
        procedure, public :: allocate => allocate_prediction, forget, predict, learn, pack_state
    end type prediction_type

contains

    !> Allocate for a number of stages.
    subroutine allocate_prediction(self, scale, stages)
        class(prediction_type), intent(inout) :: self
        !> Coordinate scales (n).
        real(wp), intent(in) :: scale(:)
        integer, intent(in) :: stages
        integer :: n

        n = size(scale)
        self%weight_of = [1.0_wp/scale, 1.0_wp/scale]
        if (allocated(self%miss)) deallocate (self%miss, self%n_kept, self%order, self%t_start, self%plain_q, self%plain_qd, &
            self%new)
        allocate (self%miss(2*n, depth, stages), self%t_start(stages), self%plain_q(n), self%plain_qd(n), self%new(2*n), &
            source=0.0_wp)
        allocate (self%n_kept(stages), self%order(stages), source=0)
    end subroutine allocate_prediction

    !> Forget the misses: the past says nothing about the next step.
    pure subroutine forget(self)
        class(prediction_type), intent(inout) :: self

        self%n_kept = 0
        self%order = 0
    end subroutine forget

    !> Rates to start a stage from.
    subroutine predict(self, history, stage, t, ha, rate_q, rate_qd)
        class(prediction_type), intent(inout) :: self
        type(history_type), intent(in) :: history
        !> Number of the stage, its time, and h a_ii.
        integer, intent(in) :: stage
        real(wp), intent(in) :: t, ha
        !> Rates (n).
        real(wp), intent(out), contiguous :: rate_q(:), rate_qd(:)
        real(wp) :: factor
        integer :: i, n

        call history%extrapolate(t, self%plain_q, self%plain_qd)
        rate_q = self%plain_q
        rate_qd = self%plain_qd
        n = size(rate_q)
        do i = 1, self%order(stage)
            factor = ha**2*weight(i, self%order(stage))
            rate_q = rate_q + factor*self%miss(:n, i, stage)
            rate_qd = rate_qd + factor*self%miss(n + 1:, i, stage)
        end do
    end subroutine predict

    !> Learn from the solution of the stage that was predicted last.
    subroutine learn(self, stage, t_start, ha, rate_q, rate_qd)
        class(prediction_type), intent(inout) :: self
        integer, intent(in) :: stage
        !> Start of the step and h a_ii.
        real(wp), intent(in) :: t_start, ha
        !> The solution (n).
        real(wp), intent(in), contiguous :: rate_q(:), rate_qd(:)
        real(wp) :: error, least, left
        integer :: best, i, k, n

        n = size(rate_q)
        self%new(:n) = (rate_q - self%plain_q)/ha**2
        self%new(n + 1:) = (rate_qd - self%plain_qd)/ha**2
        associate (miss => self%miss(:, :, stage), kept => self%n_kept(stage))
            ! A step that is tried again replaces what its first trial taught.
            if (kept > 0 .and. abs(t_start - self%t_start(stage)) <= 0.0_wp) then
                miss(:, 1) = self%new
                return
            end if
            best = 0
            least = huge(1.0_wp)
            do k = 0, kept
                error = 0.0_wp
                do i = 1, 2*n
                    left = self%new(i) - (weight(1, k)*miss(i, 1) + weight(2, k)*miss(i, 2) + weight(3, k)*miss(i, 3))
                    error = error + abs(left)*self%weight_of(i)
                end do
                if (error >= least) cycle
                least = error
                best = k
            end do
            do i = depth, 2, -1
                miss(:, i) = miss(:, i - 1)
            end do
            miss(:, 1) = self%new
            kept = min(kept + 1, depth)
            self%order(stage) = best
            ! There was nothing to compare with: try.
            if (kept == 1) self%order(stage) = 1
        end associate
        self%t_start(stage) = t_start
    end subroutine learn

    !> The misses.
    subroutine pack_state(self, pack)
        class(prediction_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%miss)
        call pack%item(self%n_kept, self%order)
        call pack%item(self%t_start)
    end subroutine pack_state
end module tandem_stepper_prediction
