! SPDX-License-Identifier: MIT
!> Start values for the rates of an implicit stage.
!>
!> The polynomial through the nearest past stages ignores the particular error of each stage: stages of a method of stage order 1
!> deviate from the motion by some J h^2 y'', with a factor that depends on the stage. The deviation of a stage from its polynomial,
!> over ha^2, therefore varies slowly from step to step. Deviations are stored per stage and extrapolated to the next step. The
!> degree of this extrapolation is the one that would have been best in the last step; no correction is added if that was best.
!> Backward differences of the deviations are stored: the error of the extrapolation of degree k - 1 is the difference of order k.
module tandem_stepper_prediction
    use tandem_kinds, only: wp
    use tandem_pack, only: pack_type
    use tandem_stepper_history, only: history_type
    implicit none (type, external)
    private

    public :: prediction_type

    !> Number of differences stored per stage. The difference of order 0 is the last deviation.
    integer, parameter :: depth = 6
    !> After `many_alike` steps of equal size, the next steps are expected to be equal too. Differences of high order are then more
    !> accurate than additional past stages, whose own errors have other factors. Before, past stages and differences are used
    !> alike.
    integer, parameter :: many_alike = 12, nodes(2) = [5, 3], most_kept(2) = [3, depth]

    type :: prediction_type
        private
        !> Differences of deviations over ha^2, of velocities and of accelerations: (2 n, depth, stages). Numbers of stored and of
        !> used differences (stages).
        real(wp), allocatable :: deviation(:, :, :)
        integer, allocatable :: n_kept(:), order(:)
        !> Start of the step of the last deviation (stages).
        real(wp), allocatable :: t_start(:)
        !> ha of the last step; number of preceding steps with the same ha; 2 after `many_alike` such steps, otherwise 1: index in
        !> `nodes` and `most_kept`.
        real(wp) :: ha = 0.0_wp
        integer :: n_alike = 0, rule = 1
        !> Last extrapolation of past stages (n), a deviation (2 n), weights of deviations (2 n).
        real(wp), allocatable :: polynomial_q(:), polynomial_qd(:), new(:), weight_of(:)
    contains
        procedure, public :: allocate => allocate_prediction, clear, predict, store_deviation, pack_state
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
        if (allocated(self%deviation)) deallocate (self%deviation, self%n_kept, self%order, self%t_start, self%polynomial_q, &
            self%polynomial_qd, self%new)
        allocate (self%deviation(2*n, depth, stages), self%t_start(stages), source=0.0_wp)
        allocate (self%polynomial_q(n), self%polynomial_qd(n), self%new(2*n), source=0.0_wp)
        allocate (self%n_kept(stages), self%order(stages), source=0)
    end subroutine allocate_prediction

    !> Remove all deviations, because the past does not apply to the next step.
    pure subroutine clear(self)
        class(prediction_type), intent(inout) :: self

        self%n_kept = 0
        self%order = 0
    end subroutine clear

    !> Predict the rates and the coordinates of a stage.
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
        call history%extrapolate(t, self%polynomial_q, self%polynomial_qd, nodes(self%rule), q)
        n = size(rate_q)
        self%new = 0.0_wp
        do j = self%order(stage), 1, -1
            do i = 1, 2*n
                self%new(i) = self%new(i) + self%deviation(i, j, stage)
            end do
        end do
        do i = 1, n
            rate_q(i) = self%polynomial_q(i) + ha**2*self%new(i)
            rate_qd(i) = self%polynomial_qd(i) + ha**2*self%new(n + i)
        end do
    end subroutine predict

    !> Select the numbers of past stages and of differences by comparing the step size with previous ones.
    pure subroutine compare_step(self, ha)
        type(prediction_type), intent(inout) :: self
        real(wp), intent(in) :: ha
        !> Equal steps of a time grid differ by rounding errors of the time.
        real(wp), parameter :: rounding = 1.0e-6_wp
        integer :: rule

        self%n_alike = merge(min(self%n_alike + 1, many_alike), 0, abs(ha - self%ha) <= rounding*ha)
        self%ha = ha
        rule = merge(2, 1, self%n_alike == many_alike)
        if (rule == self%rule) return
        ! Stored deviations are from another polynomial.
        self%rule = rule
        call self%clear()
    end subroutine compare_step

    !> Store the deviation of the stage that was predicted last, given its solution.
    subroutine store_deviation(self, stage, t_start, ha, rate_q, rate_qd)
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
            self%new(i) = (rate_q(i) - self%polynomial_q(i))/ha**2
            self%new(n + i) = (rate_qd(i) - self%polynomial_qd(i))/ha**2
        end do
        associate (kept => self%n_kept(stage))
            ! A repeated step replaces the deviation of its first attempt.
            if (kept > 0 .and. abs(t_start - self%t_start(stage)) <= 0.0_wp) then
                do i = 1, 2*n
                    change = self%new(i) - self%deviation(i, 1, stage)
                    do j = 1, kept
                        self%deviation(i, j, stage) = self%deviation(i, j, stage) + change
                    end do
                end do
                return
            end if
            n_new = min(kept + 1, most_kept(self%rule))
            do j = 0, n_new - 1
                error(j) = size_of(2*n, self%new, self%weight_of)
                do i = 1, 2*n
                    change = self%new(i)
                    self%new(i) = change - self%deviation(i, j + 1, stage)
                    self%deviation(i, j + 1, stage) = change
                end do
            end do
            if (n_new == kept) error(kept) = size_of(2*n, self%new, self%weight_of)
            self%order(stage) = minloc(error(:kept), dim=1) - 1
            ! Use the first stored difference, since there is no other one to compare it with.
            if (kept == 0) self%order(stage) = 1
            kept = min(kept + 1, most_kept(self%rule))
        end associate
        self%t_start(stage) = t_start
    end subroutine store_deviation

    !> sum |x| w. Several partial sums allow pipelining.
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

    !> Pack the deviations.
    subroutine pack_state(self, pack)
        class(prediction_type), intent(inout) :: self
        type(pack_type), intent(inout) :: pack

        call pack%item(self%deviation)
        call pack%item(self%n_kept, self%order)
        call pack%item(self%t_start)
        call pack%item(self%ha)
        call pack%item(self%n_alike, self%rule)
    end subroutine pack_state
end module tandem_stepper_prediction
