! SPDX-License-Identifier: MIT
!> Tests of rank loss in simulations: with singular = 'stop' the planar four-bar stops in its flat position, where its rank changes;
!> Bricard's mechanism, which lacks a rank everywhere, runs, and a disk that falls flat on its plane stops there.
module test_singular
    use asserts, only: check_below, check_close, check_count, check_failure, check_no_failure, check_stopped, check_text, &
        check_true
    use model_bricard, only: bricard_type
    use model_crank_pair, only: crank_pair_type
    use model_crossing, only: crossing_type
    use model_four_bar, only: crank_rocker, four_bar_type
    use model_sleigh, only: sleigh_type
    use rank_checks, only: all_warnings, check_multipliers, check_same_motion, n_warnings
    use ranks, only: bricard_angle
    use runs, only: choose, run
    use tandem, only: change_stepper, chart_policies, failure_type => error_type, options_type, projections, rolling_disk_type, &
        simulation_type, stepper_names, wp
    use testdrive, only: error_type, new_unittest, unittest_type
    use watch, only: energy_watch_type, error_watch_type
    implicit none (type, external)
    private

    public :: collect_singular

    real(wp), parameter :: pi = 4*atan(1.0_wp)
    character(len=7), parameter :: steppers(3) = [character(len=7) :: 'rk4', 'dop853', 'sdirk54']

contains

    !> The suite.
    subroutine collect_singular(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('a-flat-four-bar-cannot-start-where-runs-stop', test_flat_start), &
            new_unittest('four-bar-stops-at-its-flat-position', test_through_flat), &
            new_unittest('four-bar-stops-at-its-flat-position-in-one-chart', test_through_flat_in_one_chart), &
            new_unittest('four-bar-stops-where-a-run-ends-flat', test_end_flat), &
            new_unittest('crank-pairs-stop-neither-late-nor-early', test_crank_pairs), &
            new_unittest('a-bead-does-not-turn-off-where-its-curves-cross', test_crossing), &
            new_unittest('crank-rocker-runs-through', test_crank_rocker), &
            new_unittest('bricard-runs-with-one-redundant-row', test_bricard), &
            new_unittest('bricard-stops-where-a-missing-row-was-needed', test_missing_row), &
            new_unittest('a-disk-stops-flat-on-its-plane', test_flat_disk), &
            new_unittest('a-disk-that-rises-again-runs-through', test_rising_disk), &
            new_unittest('a-row-that-turns-too-far-in-a-step-is-no-loss', test_turned_row)]
    end subroutine collect_singular

    !> All rods on one line: the four rows in x are dependent there.
    subroutine test_flat_start(error)
        type(error_type), allocatable, intent(out) :: error
        type(four_bar_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        real(wp) :: q(9), qd(9)
        integer :: i, k

        options = choose(stepper='rk4')
        options%singular = 'stop'
        do k = 1, 2
            if (k == 2) model%length = [0.7_wp, 1.2_wp, 0.7_wp, 1.2_wp]
            call model%define()
            do i = 0, 3
                call model%start(pi*mod(i, 2), real(i/2, wp), q, qd)
                call simulation%initialize(model, options, 0.0_wp, q, qd, failure)
                call check_failure(error, failure, 'rank_deficient', 'joint')
                if (allocated(error)) return
                call check_text(error, failure%message, ' x')
            end do
        end do
    end subroutine test_flat_start

    !> Cranks that swing down through the flat position, with error control: no step size passes it, which the orientation of the
    !> pivot columns alone would allow for some, and no run ends far above it.
    subroutine test_crank_pairs(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=7), parameter :: controlled(3) = [character(len=7) :: 'dop853', 'dopri5', 'sdirk54']
        type(crank_pair_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        real(wp) :: q(4), qd(4), angle
        integer :: i, j, k

        call model%define()
        do k = 1, size(controlled)
            do j = 5, 8
                do i = 0, merge(60, 10, k == 1)
                    options = choose(stepper=trim(controlled(k)))
                    call change_stepper(options, options%stepper, rtol=10.0_wp**(-j))
                    options%singular = 'stop'
                    call model%start(1.0_wp, -3.0_wp - 0.2_wp*i, q, qd)
                    call run(simulation, model, options, 0.0_wp, q, qd, 2.0_wp, failure)
                    call check_failure(error, failure, 'rank_deficient', 'depend')
                    if (allocated(error)) return
                    angle = atan2(simulation%state%q(2), simulation%state%q(1))
                    call check_below(error, abs(angle), 1.0e-3_wp, 'angle from the flat position')
                    if (allocated(error)) return
                end do
            end do
        end do
    end subroutine test_crank_pairs

    !> A bead moves on the circle towards the line that crosses it. Short steps near the crossing find the line as well as the
    !> circle: a run may find neither, but must never continue along the line and report success. Stages on the manifold reach the
    !> line in long steps, and report the loss of rank in most runs; ends alone come so near that corrections diverge.
    subroutine test_crossing(error)
        type(error_type), allocatable, intent(out) :: error
        type(crossing_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        real(wp) :: angle
        integer :: i, j, k, n_named(2)

        n_named = 0
        do j = 1, 2
            do k = 1, 2
                options = choose(stepper=merge('dopri5', 'dop853', k == 1))
                options%projection = projections(1 + j)
                do i = 0, 59
                    angle = 0.4_wp + 0.012_wp*i
                    call change_stepper(options, options%stepper, rtol=10.0_wp**(-3.0_wp - 0.05_wp*i))
                    options%atol = options%rtol
                    model%k = 0.02_wp + 0.004_wp*i
                    call model%define()
                    call run(simulation, model, options, 0.0_wp, [cos(angle), sin(angle)], [sin(angle), -cos(angle)], &
                        angle + model%k + 0.8_wp, failure)
                    if (allocated(failure)) then
                        if (index(failure%message, 'rank_deficient') > 0) n_named(j) = n_named(j) + 1
                        call check_close(error, simulation%state%q(2:), [-model%k], 1.0e-2_wp, 'y of the end')
                    else
                        call check_close(error, [norm2(simulation%state%q)], [1.0_wp], 1.0e-9_wp, 'radius')
                    end if
                    if (allocated(error)) return
                end do
            end do
        end do
        call check_true(error, n_named(1) > 60, 'most runs with stages on the manifold say why they end')
    end subroutine test_crossing

    !> Run a parallelogram without gravity, at 1 rad/s, until its expected stop: in the flat position, which is `ahead` of its
    !> start.
    subroutine check_through_flat(options, ahead, t_end, error)
        type(options_type), intent(in) :: options
        real(wp), intent(in) :: ahead, t_end
        type(error_type), allocatable, intent(inout) :: error
        type(four_bar_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(options_type) :: stopping
        real(wp) :: q(9), qd(9), step

        stopping = options
        stopping%singular = 'stop'
        model%g = 0.0_wp
        call model%define()
        call model%start(pi - ahead, 1.0_wp, q, qd)
        call run(simulation, model, stopping, 0.0_wp, q, qd, t_end, failure)
        call check_failure(error, failure, 'rank_deficient', 'joint')
        if (allocated(error)) return
        call check_count(error, n_warnings(simulation), 0, 'warnings')
        step = merge(options%max_step, options%step, options%is_adaptive())
        ! A step that would end a hundredth of a step before it, with multipliers that grow like the inverse of the distance, may be
        ! impossible too: the distance is then slightly more than one step.
        call check_below(error, abs(simulation%state%t - ahead), 1.02_wp*step, trim(options%stepper)// &
            ': distance of the stop from the flat position')
        call check_below(error, maxval(simulation%errors), 1.0e-12_wp, trim(options%stepper)//': constraint errors there')
        ! The crank turns uniformly until then.
        call model%start(pi - ahead + simulation%state%t, 1.0_wp, q, qd)
        call check_close(error, simulation%state%q, q, 1.0e-6_wp, trim(options%stepper)//': q at the stop')
    end subroutine check_through_flat

    !> Steps of 1e-2 end in the flat position, half a step from it, and a hundredth of a step before and after it.
    subroutine test_through_flat(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: ahead(4) = [0.5_wp, 0.505_wp, 0.5001_wp, 0.4999_wp]
        type(options_type) :: options
        integer :: i, l

        do l = 1, size(steppers)
            options = choose(stepper=trim(steppers(l)), step=1.0e-2_wp)
            if (steppers(l) == 'dop853') then
                call change_stepper(options, options%stepper, rtol=1.0e-8_wp)
                options%max_step = 0.1_wp
            end if
            do i = 1, size(ahead)
                call check_through_flat(options, ahead(i), 1.0_wp, error)
            end do
        end do
    end subroutine test_through_flat

    !> The same with a single chart.
    subroutine test_through_flat_in_one_chart(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: ahead(2) = [0.2_wp, 0.205_wp]
        type(options_type) :: options
        integer :: i, l

        do l = 1, size(steppers), 2
            do i = 1, size(ahead)
                options = choose(stepper=trim(steppers(l)), step=1.0e-2_wp, chart='adaptive')
                call check_through_flat(options, ahead(i), 0.5_wp, error)
            end do
        end do
    end subroutine test_through_flat_in_one_chart

    !> A run that ends in the flat position, for any step size.
    subroutine test_end_flat(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options
        integer :: l

        do l = 1, size(steppers)
            options = choose(stepper=trim(steppers(l)), step=1.3e-2_wp)
            if (steppers(l) == 'dop853') then
                call change_stepper(options, options%stepper, rtol=1.0e-8_wp)
                options%max_step = 0.1_wp
            end if
            call check_through_flat(options, 0.3_wp, 0.3_wp, error)
        end do
    end subroutine test_end_flat

    !> The control: three turns, never flat.
    subroutine test_crank_rocker(error)
        type(error_type), allocatable, intent(out) :: error
        type(four_bar_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        real(wp) :: q(9), qd(9)
        integer :: i, l

        model%length = crank_rocker
        call model%define()
        call model%start(0.3_wp, 8.0_wp, q, qd)
        do i = 1, 2
            do l = 1, size(steppers)
                options = choose(stepper=trim(steppers(l)), step=5.0e-3_wp, chart=chart_policies(i))
                if (steppers(l) == 'dop853') call change_stepper(options, options%stepper, rtol=1.0e-8_wp)
                call run(simulation, model, options, 0.0_wp, q, qd, 2.5_wp, failure)
                call check_no_failure(error, failure)
                call check_count(error, n_warnings(simulation), 0, 'warnings of the crank-rocker')
                call check_true(error, simulation%state%q(3) > 6*pi, 'the crank turns three times')
            end do
        end do
    end subroutine test_crank_rocker

    !> From rest in the cube for 2 s: one of 35 rows is redundant all the time, but not always the same ones: after 1.25 s, at angle
    !> = -pi/2, most rows are needed that could be dropped before.
    subroutine test_bricard(error)
        type(error_type), allocatable, intent(out) :: error
        type(bricard_type), target :: model, fewer
        type(simulation_type) :: simulation, without
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        type(energy_watch_type) :: energy
        type(error_watch_type) :: errors
        real(wp) :: q(35), qd(35), bound
        integer :: i, l, named

        call model%define()
        call model%start(0.0_wp, 0.0_wp, q, qd)
        ! `P6 axis 2` can be dropped everywhere.
        fewer%left_out = 30
        call fewer%define()
        do l = 2, 3
            options = choose(stepper=trim(steppers(l)), step=1.0e-2_wp)
            if (steppers(l) == 'dop853') call change_stepper(options, options%stepper, rtol=1.0e-8_wp)
            call run(without, fewer, options, 0.0_wp, q, qd, 2.0_wp, failure)
            call check_no_failure(error, failure)
            errors = error_watch_type()
            call run(simulation, model, options, 0.0_wp, q, qd, 2.0_wp, failure, errors)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call check_count(error, n_warnings(simulation), 1, 'warnings')
            named = 0
            do i = 1, 35
                if (index(all_warnings(simulation), model%row_name(i)) > 0) named = named + 1
            end do
            call check_true(error, named > 0, 'the warning names a row: '//all_warnings(simulation))
            call check_below(error, maxval(errors%errors), 1.0e-12_wp, trim(steppers(l))//': constraint errors of all rows')
            ! The choice of the missing row changes only rounding, and with error control repeated steps: the tolerance.
            bound = merge(1.0e-8_wp, 1.0e-11_wp, steppers(l) == 'dop853')
            call check_same_motion(error, simulation, without, bound)
            call check_multipliers(error, simulation, without, 100*bound)
            call run(simulation, model, options, 0.0_wp, q, qd, 2.0_wp, failure, energy)
            call check_no_failure(error, failure)
            ! Thirty times the tolerance; sdirk54 is of fourth order: (1e-2)**4 times (rates of 4/s)**4.
            call check_below(error, energy%deviation, merge(3.0e-7_wp, 3.0e-6_wp, steppers(l) == 'dop853'), &
                trim(steppers(l))//': deviation of the energy')
        end do
    end subroutine test_bricard

    !> Without `P3 y` the rank is 34 of 34 until angle = -pi/2, where it drops to 33.
    subroutine test_missing_row(error)
        type(error_type), allocatable, intent(out) :: error
        type(bricard_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        real(wp) :: q(35), qd(35)
        integer :: l

        model%left_out = 12
        call model%define()
        call model%start(0.0_wp, 0.0_wp, q, qd)
        do l = 2, 3
            options = choose(stepper=trim(steppers(l)), step=1.0e-2_wp)
            if (steppers(l) == 'dop853') then
                call change_stepper(options, options%stepper, rtol=1.0e-8_wp)
                options%max_step = 0.05_wp
            end if
            options%singular = 'stop'
            call run(simulation, model, options, 0.0_wp, q, qd, 2.0_wp, failure)
            call check_failure(error, failure, 'rank_deficient')
            if (allocated(error)) return
            call check_count(error, n_warnings(simulation), 0, 'warnings')
            ! One step at 2.2 rad/s.
            call check_below(error, abs(bricard_angle(simulation%state%q) + pi/2), 2.3_wp* &
                merge(options%max_step, options%step, options%is_adaptive()), trim(steppers(l))//': distance of the stop in angle')
        end do
    end subroutine test_missing_row

    !> A disk falls flat on its plane, where every point of its rim is a contact point: the massless contact point may go anywhere.
    !> No stepper passes this, for any step size.
    subroutine test_flat_disk(error)
        type(error_type), allocatable, intent(out) :: error
        !> Fixed steps, or the tolerances; the disk takes 0.74 s from a tilt of 0.5.
        real(wp), parameter :: steps(3) = [1.0e-3_wp, 1.0e-3_wp, 1.0e-2_wp], tolerances(4) = [1.0e-4_wp, 1.0e-6_wp, 1.0e-8_wp, &
            1.0e-10_wp]
        type(options_type) :: options
        integer :: i, l

        do l = 1, size(stepper_names)
            do i = 1, size(steps)
                options = choose(stepper=trim(stepper_names(l)), step=steps(i))
                if (i == 2) options%chart = 'adaptive'
                call check_flat_disk(options, error)
                options%projection = 'step_ends'
                if (any(stepper_names(l) == ['trapezoid', 'sdirk54  ', 'radau5   '])) cycle
                call check_flat_disk(options, error)
                if (allocated(error)) return
            end do
            if (stepper_names(l) == 'rk4') cycle
            do i = 1, size(tolerances)
                ! It would take too many steps.
                if (stepper_names(l) == 'trapezoid' .and. tolerances(i) < 1.0e-7_wp) cycle
                options = choose(stepper=trim(stepper_names(l)))
                call change_stepper(options, options%stepper, rtol=tolerances(i))
                options%atol = tolerances(i)
                call check_flat_disk(options, error)
                if (allocated(error)) return
            end do
        end do
    end subroutine test_flat_disk

    !> The disk of the scene, from rest at a tilt of 0.5, without a spin about its axis, and with 1e-6 rad/s.
    subroutine check_flat_disk(options, error)
        type(options_type), intent(in) :: options
        type(error_type), allocatable, intent(inout) :: error
        type(rolling_disk_type), target :: disk
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: q(9), qd(9), spin
        integer :: k

        if (allocated(error)) return
        call disk%define()
        do k = 0, 1
            spin = k*1.0e-6_wp
            call disk%start([spin, 0.0_wp, 0.0_wp], 0.5_wp, q, qd)
            call run(simulation, disk, options, 0.0_wp, q, qd, 2.0_wp, failure)
            call check_failure(error, failure, 'singular_mass', 'no constraint determines')
            if (allocated(error)) return
            ! It falls with 3.6 m/s: less than two steps above the plane, and never below; less than three with radau5, whose stages
            ! are solved together, with start values two steps ahead. Controlled steps come nearer.
            associate (rz => simulation%state%q(3))
                call check_true(error, rz > 0.0_wp, trim(options%stepper)//': it is above the plane')
                call check_below(error, rz, merge(1.0e-3_wp, 3.6_wp*options%step* &
                    merge(3, 2, options%stepper == 'radau5'), options%is_adaptive()), trim(options%stepper)// &
                    ': height where it stops')
            end associate
            if (allocated(error)) return
        end do
    end subroutine check_flat_disk

    !> The control: with a spin that steps can follow, the disk comes near the plane, and its contact point moves round the rim
    !> until it rises again. Its height is that of two steppers.
    subroutine test_rising_disk(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type), target :: disk
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        real(wp) :: q0(9), qd0(9), height(2)
        integer :: k

        call disk%define()
        call disk%start([0.3_wp, 0.0_wp, 0.0_wp], 0.5_wp, q0, qd0)
        do k = 1, 2
            options = choose(stepper=merge('dop853', 'dopri5', k == 1))
            call change_stepper(options, options%stepper, rtol=1.0e-10_wp)
            options%atol = 1.0e-10_wp
            call run(simulation, disk, options, 0.0_wp, q0, qd0, 1.2_wp, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            height(k) = simulation%state%q(3)
        end do
        call check_close(error, height(:1), height(2:), 1.0e-6_wp, 'height')
    end subroutine test_rising_disk

    !> A sleigh turns by 2 rad in a step: its only row has its previous length and the opposite direction. This is not a loss of
    !> rank, and the row cannot be dropped; the step is too large.
    subroutine test_turned_row(error)
        type(error_type), allocatable, intent(out) :: error
        type(sleigh_type), target :: sleigh
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: q(3), qd(3), spin
        integer :: i, l

        call sleigh%define(1.0_wp)
        ! The explicit ones: Newton's iteration does not get as far.
        do l = 1, 2
            do i = 0, 4
                spin = 2.0e3_wp + 2.0e2_wp*i
                call sleigh%motion(0.0_wp, [0.0_wp, 0.0_wp, 0.3_wp, 1.0_wp, spin], q, qd)
                call run(simulation, sleigh, choose(stepper=trim(steppers(l)), step=1.0e-3_wp), 0.0_wp, q, qd, 0.1_wp, failure)
                ! If the first steps succeed, their velocity may be too large for the next ones.
                call check_stopped(error, failure, [character(len=10) :: 'chart_left', 'not_finite'], 'smaller step', &
                    trim(steppers(l)))
                if (allocated(error)) return
            end do
        end do
    end subroutine test_turned_row
end module test_singular
