! SPDX-License-Identifier: MIT
!> Start values for the rates of an implicit stage.
!>
!> The polynomial through the nearest past stages misses what is particular to a stage: the stages of a method of stage order 1
!> are off the motion by some J h^2 y'', a different part of it each. But a stage misses in this step about as it did in the steps
!> before. So what each stage's polynomial missed is kept, over ha^2, and extrapolated over the last steps, by a polynomial of
!> whichever degree would have been best in the last step; nothing is added where that was best. Kept are the backward differences
!> of the misses: the polynomial of degree k - 1 was off by the difference k.
module tandem_stepper_prediction
    use tandem_kinds, only: wp
    use tandem_pack, only: pack_type
    use tandem_stepper_history, only: history_type
    implicit none (type, external)
    private

    public :: prediction_type

    !> Differences kept for each stage: of order 0, the last miss itself, and so on.
    integer, parameter :: depth = 6
    !> After so many steps of the same length the next ones are taken to be alike: then differences of high order tell more than
    !> past stages of this step, which are off by other parts of it. Else as many of one and of the other.
    integer, parameter :: many_alike = 12, nodes(2) = [5, 3], most_kept(2) = [3, depth]

    type :: prediction_type
        private
        !> Differences of misses over ha^2, velocities and accelerations: (2 n, depth, stages); how many there are, and what is used
        !> of them (stages).
        real(wp), allocatable :: miss(:, :, :)
        integer, allocatable :: n_kept(:), order(:)
        !> Start of the step of the newest miss (stages).
        real(wp), allocatable :: t_start(:)
        !> ha of the last step, how many before it had the same, and whether these are many: 2, else 1.
        real(wp) :: ha = 0.0_wp
        integer :: n_alike = 0, way = 1
        !> The last extrapolation of past stages (n), a miss (2 n), what misses are measured by (2 n).
        real(wp), allocatable :: plain_q(:), plain_qd(:), new(:), weight_of(:)
    contains
        procedure, public :: allocate => allocate_prediction, forget, predict, learn, pack_state
    end type prediction_type

contains

    !> Allocate for a number of stages.
    subroutine allocate_prediction(self, scale, time_scale, stages)
        class(prediction_type), intent(inout) :: self
        !> Coordinate scales (n), and the time scale.
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
        integer :: i, j, n

        if (stage == 1) call compare_step(self, ha)
        call history%extrapolate(t, self%plain_q, self%plain_qd, nodes(self%way))
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

    !> Whether the steps are alike.
    pure subroutine compare_step(self, ha)
        type(prediction_type), intent(inout) :: self
        real(wp), intent(in) :: ha
        !> A step of the grid differs from the next by rounding of the time.
        real(wp), parameter :: rounding = 1.0e-6_wp
        integer :: way

        self%n_alike = merge(min(self%n_alike + 1, many_alike), 0, abs(ha - self%ha) <= rounding*ha)
        self%ha = ha
        way = merge(2, 1, self%n_alike == many_alike)
        if (way == self%way) return
        ! Misses of another polynomial.
        self%way = way
        call self%forget()
    end subroutine compare_step

    !> Learn from the solution of the stage that was predicted last.
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
            ! A step that is tried again replaces what its first trial taught.
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
            ! There was nothing to compare with: try.
            if (kept == 0) self%order(stage) = 1
            kept = min(kept + 1, most_kept(self%way))
        end associate
        self%t_start(stage) = t_start
    end subroutine learn

    !> sum |x| w, in sums that do not wait for one another.
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

    !> The misses.
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
