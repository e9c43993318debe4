! SPDX-License-Identifier: MIT
!> Start values for the rates of an implicit stage.
!>
!> The polynomial through the nearest past stages misses the particular error of a stage: stages of a method of stage order 1 differ
!> from the motion by some J h^2 y'', with a factor of their own. But this error of a stage, the miss, varies slowly from step to
!> step. The misses of each stage's polynomial, over ha^2, are therefore stored and extrapolated over the last steps, by a
!> polynomial of the degree that would have been best in the last step; nothing is added if that was best. The backward differences
!> of the misses are stored: the error of the polynomial of degree k - 1 was the difference k.
module tandem_stepper_prediction
    use tandem_kinds, only: wp
    use tandem_pack, only: pack_type
    use tandem_stepper_history, only: history_type
    implicit none (type, external)
    private

    public :: prediction_type

    !> Number of differences stored for each stage: order 0 is the last miss itself.
    integer, parameter :: depth = 6
    !> Number of steps of equal size after which the next ones are expected to be equal: then differences of high order are more
    !> accurate than past stages of this step, whose errors have other factors. Otherwise as many of each are used.
    integer, parameter :: many_alike = 12, nodes(2) = [5, 3], most_kept(2) = [3, depth]

    type :: prediction_type
        private
        !> Differences of misses over ha^2, velocities and accelerations: (2 n, depth, stages); numbers of stored and of used ones
        !> (stages).
        real(wp), allocatable :: miss(:, :, :)
        integer, allocatable :: n_kept(:), order(:)
        !> Start of the step of the newest miss (stages).
        real(wp), allocatable :: t_start(:)
        !> ha of the last step; number of preceding steps with the same ha; 2 if there are `many_alike` of these, else 1.
        real(wp) :: ha = 0.0_wp
        integer :: n_alike = 0, way = 1
        !> Last extrapolation of past stages (n), a miss (2 n), weights of misses (2 n).
        real(wp), allocatable :: plain_q(:), plain_qd(:), new(:), weight_of(:)
    contains
        procedure, public :: allocate => allocate_prediction, forget, predict, learn, pack_state
    end type prediction_type

contains

    !> Allocate for a number of stages.
    subroutine allocate_prediction(self, scale, time_scale, stages)
        class(prediction_type), intent(inout) :: self
        !> Coordinate scales (n), and time scale.
        real(wp), intent(in) :: scale(:), time_scale
        integer, intent(in) :: stages
        integer :: n

        n = size(scale)
        self%weight_of = [1.0_wp/scale, time_scale/scale]
        if (allocated(self%miss)) deallocate (self%miss, self%n_kept, self%order, self%t_start, self%plain_q, self%plain_qd, &
            self%new)
        allocate (self%miss(2*n, depth, stages), self%t_start(stages), self%plain_q(n), self%plain_qd(n), self%new(2*n), &
            source=0.0_wp)
        allocate (self%n_kept(stages), self%order(stages), source=0)
    end subroutine allocate_prediction

    !> Remove the misses: the past does not apply to the next step.
    pure subroutine forget(self)
        class(prediction_type), intent(inout) :: self

        self%n_kept = 0
        self%order = 0
    end subroutine forget

    !> Start values of the rates of a stage.
    subroutine predict(self, history, stage, t, ha, rate_q, rate_qd, q)
        class(prediction_type), intent(inout) :: self
        type(history_type), intent(in) :: history
        !> Number of the stage, its time, and h a_ii.
        integer, intent(in) :: stage
        real(wp), intent(in) :: t, ha
        !> Rates (n).
        real(wp), intent(out), contiguous :: rate_q(:), rate_qd(:)
        !> Coordinates (n).
        real(wp), intent(out), contiguous :: q(:)
        integer :: i, j, n

        if (stage == 1) call compare_step(self, ha)
        call history%extrapolate(t, self%plain_q, self%plain_qd, nodes(self%way), q)
        n = size(rate_q)
        self%new = 0.0_wp
        do j = self%order(stage), 1, -1
            do i = 1, 2*n
                self%new(i) = self%new(i) + self%miss(i, j, stage)
            end do
        end do
        do i = 1, n
            rate_q(i) = self%plain_q(i) + ha**2*self%new(i)
            rate_qd(i) = self%plain_qd(i) + ha**2*self%new(n + i)
        end do
    end subroutine predict

    !> Compare the step size with that of the previous steps.
    pure subroutine compare_step(self, ha)
        type(prediction_type), intent(inout) :: self
        real(wp), intent(in) :: ha
        !> Steps of a grid differ by the rounding of the time.
        real(wp), parameter :: rounding = 1.0e-6_wp
        integer :: way

        self%n_alike = merge(min(self%n_alike + 1, many_alike), 0, abs(ha - self%ha) <= rounding*ha)
        self%ha = ha
        way = merge(2, 1, self%n_alike == many_alike)
        if (way == self%way) return
        ! Stored misses belong to another polynomial.
        self%way = way
        call self%forget()
    end subroutine compare_step

    !> Store the miss of the stage that was predicted last, given its solution.
    subroutine learn(self, stage, t_start, ha, rate_q, rate_qd)
        class(prediction_type), intent(inout) :: self
        integer, intent(in) :: stage
        !> Start of the step and h a_ii.
        real(wp), intent(in) :: t_start, ha
        !> The solution (n).
        real(wp), intent(in), contiguous :: rate_q(:), rate_qd(:)
        real(wp) :: change, error(0:depth)
        integer :: i, j, n, n_new

        n = size(rate_q)
        do i = 1, n
            self%new(i) = (rate_q(i) - self%plain_q(i))/ha**2
            self%new(n + i) = (rate_qd(i) - self%plain_qd(i))/ha**2
        end do
        associate (kept => self%n_kept(stage))
            ! A repeated step replaces the miss of its first trial.
            if (kept > 0 .and. abs(t_start - self%t_start(stage)) <= 0.0_wp) then
                do i = 1, 2*n
                    change = self%new(i) - self%miss(i, 1, stage)
                    do j = 1, kept
                        self%miss(i, j, stage) = self%miss(i, j, stage) + change
                    end do
                end do
                return
            end if
            n_new = min(kept + 1, most_kept(self%way))
            do j = 0, n_new - 1
                error(j) = size_of(2*n, self%new, self%weight_of)
                do i = 1, 2*n
                    change = self%new(i)
                    self%new(i) = change - self%miss(i, j + 1, stage)
                    self%miss(i, j + 1, stage) = change
                end do
            end do
            if (n_new == kept) error(kept) = size_of(2*n, self%new, self%weight_of)
            self%order(stage) = minloc(error(:kept), dim=1) - 1
            ! Without a comparison, use the new difference.
            if (kept == 0) self%order(stage) = 1
            kept = min(kept + 1, most_kept(self%way))
        end associate
        self%t_start(stage) = t_start
    end subroutine learn

    !> sum |x| w, in independent partial sums.
    pure real(wp) function size_of(n, x, weight)
        integer, intent(in) :: n
        real(wp), intent(in) :: x(n), weight(n)
        integer, parameter :: lanes = 8
        real(wp) :: sums(lanes)
        integer :: i, l

        sums = 0.0_wp
        do i = 0, n - lanes, lanes
            do l = 1, lanes
                sums(l) = sums(l) + abs(x(i + l))*weight(i + l)
            end do
        end do
        do i = n - modulo(n, lanes) + 1, n
            sums(1) = sums(1) + abs(x(i))*weight(i)
        end do
        size_of = sum(sums)
    end function size_of

    !> Pack the misses.
    subroutine pack_state(self, pack)
        class(prediction_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%miss)
        call pack%item(self%n_kept, self%order)
        call pack%item(self%t_start)
        call pack%item(self%ha)
        call pack%item(self%n_alike, self%way)
    end subroutine pack_state
end module tandem_stepper_prediction
