! SPDX-License-Identifier: MIT
!> Measures several solvers of one problem. Every solver runs over a range of tolerances or step sizes; then, in several rounds, all
!> of them are timed in turn, so that other load of the machine affects all alike. Times are processor times without the
!> preparation, and medians over the rounds; a ratio is the median of the ratios of each round.
module tandem_bench_measure
    use tandem, only: long, wp
    use tandem_bench_clock, only: cpu_seconds
    use tandem_bench_solver, only: problem_type, solver_holder_type, solver_type
    use, intrinsic :: ieee_arithmetic, only: ieee_is_finite, ieee_quiet_nan, ieee_value
    implicit none (type, external)
    private

    public :: point_type, series_type, measure_series, time_to_error

    !> One run of one solver.
    type :: point_type
        !> Tolerance or step size, and the largest error of the compared coordinates at the end.
        real(wp) :: control = 0.0_wp, error = 0.0_wp
        !> Seconds of each round (rounds), and of the preparation.
        real(wp), allocatable :: seconds(:)
        real(wp) :: preparation = 0.0_wp
        integer(long) :: steps = 0, rejected = 0, evaluations = 0
        !> Runs of one round.
        integer :: runs = 1
    end type point_type

    !> The complete runs of one solver, the loosest first.
    type :: series_type
        type(point_type), allocatable :: points(:)
    end type series_type

    !> Smallest duration of a timing; duration of a run that ends its series.
    real(wp), parameter :: least_seconds = 2.0e-3_wp, most_seconds = 0.5_wp

contains

    !> Measure all solvers of a problem.
    subroutine measure_series(problem, solvers, rounds, series)
        type(problem_type), intent(in) :: problem
        type(solver_holder_type), intent(inout), target :: solvers(:)
        integer, intent(in) :: rounds
        !> One per solver.
        type(series_type), allocatable, intent(out) :: series(:)
        integer :: i, j, round

        allocate (series(size(solvers)))
        do i = 1, size(solvers)
            call explore(problem, solvers(i)%solver, rounds, series(i))
        end do
        do round = 1, rounds
            do j = 1, maxval([(size(series(i)%points), i=1, size(series))])
                do i = 1, size(solvers)
                    if (j <= size(series(i)%points)) call time(problem, solvers(i)%solver, round, series(i)%points(j))
                end do
            end do
        end do
    end subroutine measure_series

    !> Find the runs of a solver: half decades of tolerances, or step sizes by powers of two.
    subroutine explore(problem, solver, rounds, series)
        type(problem_type), intent(in) :: problem
        class(solver_type), intent(inout), target :: solver
        integer, intent(in) :: rounds
        type(series_type), intent(out) :: series
        type(point_type) :: point
        real(wp) :: seconds
        integer :: k, stat

        allocate (series%points(0))
        allocate (point%seconds(rounds), source=0.0_wp)
        do k = 4, 27
            point%control = 10.0_wp**(-0.5_wp*k)
            if (solver%is_fixed) point%control = 0.5_wp*2.0_wp**(4 - k)
            call solver%prepare(problem, point%control, stat)
            if (stat /= 0) cycle
            seconds = cpu_seconds()
            call solver%run(stat)
            seconds = cpu_seconds() - seconds
            if (stat == 0) then
                point%error = maxval(abs(solver%q(:problem%compared) - problem%q_end(:problem%compared)))
                point%steps = solver%steps
                point%rejected = solver%rejected
                point%evaluations = solver%evaluations
                point%runs = max(1, ceiling(least_seconds/max(seconds, 1.0e-6_wp)))
                if (ieee_is_finite(point%error)) series%points = [series%points, point]
            end if
            if (seconds > most_seconds) exit
        end do
    end subroutine explore

    !> Time a run.
    subroutine time(problem, solver, round, point)
        type(problem_type), intent(in) :: problem
        class(solver_type), intent(inout), target :: solver
        integer, intent(in) :: round
        type(point_type), intent(inout) :: point
        real(wp) :: begun, prepared
        integer :: i, stat

        point%preparation = 0.0_wp
        do i = 1, point%runs
            begun = cpu_seconds()
            call solver%prepare(problem, point%control, stat)
            prepared = cpu_seconds()
            call solver%run(stat)
            point%seconds(round) = point%seconds(round) + (cpu_seconds() - prepared)/point%runs
            point%preparation = point%preparation + (prepared - begun)/point%runs
        end do
    end subroutine time

    !> Time for a given error: interpolated between the adjacent runs in logarithmic scales. Accidentally small errors do not count:
    !> the error of a run is the largest of those that are at least as tight. NaN outside of the range of the runs.
    pure real(wp) function time_to_error(series, error, round) result(seconds)
        type(series_type), intent(in) :: series
        real(wp), intent(in) :: error
        integer, intent(in) :: round
        real(wp) :: errors(size(series%points)), weight
        integer :: i

        seconds = ieee_value(1.0_wp, ieee_quiet_nan)
        associate (points => series%points)
            if (size(points) == 0) return
            errors(size(points)) = points(size(points))%error
            do i = size(points) - 1, 1, -1
                errors(i) = max(errors(i + 1), points(i)%error)
            end do
            if (errors(size(points)) > error) return
            if (errors(1) <= error) then
                seconds = points(1)%seconds(round)
                return
            end if
            do i = 2, size(points)
                if (errors(i) <= error) exit
            end do
            weight = log(errors(i - 1)/error)/log(errors(i - 1)/max(errors(i), tiny(1.0_wp)))
            seconds = points(i - 1)%seconds(round)*(points(i)%seconds(round)/points(i - 1)%seconds(round))**weight
        end associate
    end function time_to_error
end module tandem_bench_measure
