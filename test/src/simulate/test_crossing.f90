! SPDX-License-Identifier: MIT
!> Tests of crossings of singular configurations: parallelograms, an antiparallelogram and a slider-crank of equal lengths continue
!> on their branch, with the motion of their reduced equation; configurations that are only near are not crossed.
module test_crossing
    use asserts, only: check_below, check_close, check_count, check_failure, check_no_failure, check_true
    use large_runs, only: begin, controlled
    use linkage_turns, only: antiparallel, gravity, parallel, ratio, row, slider, turn
    use model_centric_slider, only: centric_slider_type
    use model_crank_pair, only: crank_pair_type
    use model_four_bar, only: four_bar_type
    use runs, only: choose, run
    use tandem, only: change_stepper, failure_type => error_type, long, mechanism_type, options_type, simulation_type, &
        statistics_type, stepper_names, wp
    use tandem_io, only: find_scene, read_scene, scene_type
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_crossing

contains

    !> The suite.
    subroutine collect_crossing(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('a-parallelogram-turns-like-a-pendulum', test_parallelogram), &
            new_unittest('many-turns-cost-no-accuracy', test_many_turns), &
            new_unittest('a-row-of-four-bars-turns-like-a-pendulum', test_row), &
            new_unittest('a-slider-crank-passes-its-pivot', test_slider), &
            new_unittest('an-antiparallelogram-stays-one', test_antiparallelogram), &
            new_unittest('estimated-errors-cover-the-true-ones', test_estimates), &
            new_unittest('a-linkage-that-only-comes-near-turns-off', test_near), &
            new_unittest('a-run-may-stop-there-instead', test_stop), &
            new_unittest('a-motion-that-turns-around-there', test_slow), &
            new_unittest('a-start-in-a-singular-configuration', test_start), &
            new_unittest('a-start-between-branches-is-refused', test_undetermined_start)]
    end subroutine collect_crossing

    !> The state of antiparallel cranks.
    subroutine place_antiparallel(angle, rate, q, qd)
        real(wp), intent(in) :: angle, rate
        real(wp), intent(out) :: q(4), qd(4)
        real(wp) :: psi, d

        psi = 2*atan2(ratio*sin(angle/2), cos(angle/2))
        d = ratio/(cos(angle/2)**2 + ratio**2*sin(angle/2)**2)
        q = [cos(angle), sin(angle), 2 + cos(psi), sin(psi)]
        qd = rate*[-sin(angle), cos(angle), -d*sin(psi), d*cos(psi)]
    end subroutine place_antiparallel

    !> Every stepper, with controlled and with fixed steps, for three turns: seven crossings. Errors of steps of the second order
    !> add up to more.
    subroutine test_parallelogram(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: t_end = 3.0_wp
        type(crank_pair_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        real(wp) :: q(4), qd(4), angle, rate, bound
        integer :: i, k

        call model%define()
        angle = 1.0_wp
        rate = -6.0_wp
        call turn(parallel, t_end, angle, rate)
        do i = 1, size(stepper_names)
            do k = 1, 2
                options = choose(stepper=trim(stepper_names(i)), step=merge(5.0e-4_wp, 2.0e-3_wp, stepper_names(i) == 'trapezoid'))
                bound = 1.0e-5_wp
                if (stepper_names(i) == 'trapezoid') bound = 1.0e-3_wp
                if (k == 2) then
                    if (stepper_names(i) == 'rk4') cycle
                    call change_stepper(options, options%stepper, rtol=1.0e-8_wp)
                    bound = 1.0e-6_wp
                    if (stepper_names(i) == 'trapezoid') bound = 1.0e-3_wp
                end if
                call model%start(1.0_wp, -6.0_wp, q, qd)
                call run(simulation, model, options, 0.0_wp, q, qd, t_end, failure)
                call check_no_failure(error, failure)
                call model%start(angle, rate, q, qd)
                call check_close(error, simulation%state%q, q, bound, trim(stepper_names(i))//': q at the end')
                call check_close(error, simulation%state%qd, qd, 10*bound, trim(stepper_names(i))//': qd at the end')
                if (allocated(error)) return
                call check_true(error, simulation%n_crossings >= 6, trim(stepper_names(i))//': crossings are recorded')
                if (allocated(error)) return
            end do
        end do
    end subroutine test_parallelogram

    !> After a thousand turns, angles have rounding errors of 1e-12. Without forces, cranks go on to turn uniformly, twenty more
    !> times.
    subroutine test_many_turns(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: start = 6283.0_wp, rate = 8.0_wp, t_end = 16.0_wp
        type(four_bar_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        real(wp) :: q(9), qd(9)

        model%length = 1.0_wp
        model%g = 0.0_wp
        call model%define()
        call model%start(start, rate, q, qd)
        options = choose(stepper='dop853')
        call change_stepper(options, options%stepper, rtol=1.0e-10_wp)
        call run(simulation, model, options, 0.0_wp, q, qd, t_end, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call check_true(error, simulation%n_crossings >= 40, 'crossings are recorded')
        if (allocated(error)) return
        ! Tolerances are relative to the angle.
        call check_close(error, simulation%state%q(3:3), [start + rate*t_end], 1.0e-10_wp*start, 'angle')
        if (allocated(error)) return
        call check_below(error, maxval(simulation%crossings(:simulation%n_crossings)%error), 1.0e-9_wp, 'estimated errors')
    end subroutine test_many_turns

    !> The benchmark of the IFToMM over 10 s, with both charts: ten crossings, in which n ranks are lost at once.
    subroutine test_row(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: n(3) = [1, 2, 10]
        character(len=6), parameter :: kinds(2) = ['dense ', 'sparse']
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: angle, rate
        integer :: i, k

        do i = 1, size(n)
            angle = 0.0_wp
            rate = 1.0_wp
            call turn(row, 10.0_wp, angle, rate, gravity*((n(i) + 1)/2.0_wp + n(i))/((n(i) + 1)/3.0_wp + n(i)))
            do k = 1, size(kinds)
                call begin('four_bars', 2*n(i) + 1, controlled(1.0e-10_wp, trim(kinds(k))), mechanism, simulation, error)
                if (allocated(error)) return
                call simulation%integrate(10.0_wp, failure)
                call check_no_failure(error, failure)
                if (allocated(error)) return
                call check_close(error, simulation%state%q(1:2), 0.5_wp*[sin(angle), cos(angle)], 1.0e-7_wp, 'centre of a bar')
                call check_close(error, simulation%state%qd(3:3), [-rate], 1.0e-7_wp, 'angular velocity')
                call check_true(error, simulation%n_crossings >= 8, 'crossings are recorded')
                if (allocated(error)) return
            end do
        end do
    end subroutine test_row

    !> Two turns through the position in which the slider is at the pivot.
    subroutine test_slider(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=7), parameter :: steppers(3) = [character(len=7) :: 'dop853', 'radau5', 'sdirk54']
        type(centric_slider_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        real(wp) :: q(3), qd(3), angle, rate
        integer :: i

        call model%define()
        angle = 0.3_wp
        rate = 7.0_wp
        call turn(slider, 3.0_wp, angle, rate)
        do i = 1, size(steppers)
            options = choose(stepper=trim(steppers(i)))
            call change_stepper(options, options%stepper, rtol=1.0e-10_wp)
            call model%start(0.3_wp, 7.0_wp, q, qd)
            call run(simulation, model, options, 0.0_wp, q, qd, 3.0_wp, failure)
            call check_no_failure(error, failure)
            call model%start(angle, rate, q, qd)
            call check_close(error, simulation%state%q, q, 1.0e-7_wp, trim(steppers(i))//': q at the end')
            if (allocated(error)) return
            call check_true(error, simulation%n_crossings >= 2, 'crossings are recorded')
            if (allocated(error)) return
        end do
    end subroutine test_slider

    !> Antiparallel cranks pass the flat position and stay antiparallel.
    subroutine test_antiparallelogram(error)
        type(error_type), allocatable, intent(out) :: error
        type(crank_pair_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        real(wp) :: q(4), qd(4), angle, rate
        integer :: i

        call model%define()
        do i = 1, 2
            angle = 1.0_wp
            rate = -8.0_wp
            call place_antiparallel(angle, rate, q, qd)
            call turn(antiparallel, 3.0_wp, angle, rate)
            options = choose(stepper=merge('dop853', 'radau5', i == 1))
            call change_stepper(options, options%stepper, rtol=1.0e-10_wp)
            call run(simulation, model, options, 0.0_wp, q, qd, 3.0_wp, failure)
            call check_no_failure(error, failure)
            call place_antiparallel(angle, rate, q, qd)
            call check_close(error, simulation%state%q, q, 1.0e-7_wp, 'q at the end')
            if (allocated(error)) return
            call check_true(error, simulation%n_crossings >= 3, 'crossings are recorded')
            if (allocated(error)) return
        end do
    end subroutine test_antiparallelogram

    !> The error of one crossing, from the state before it to the state behind it, at most the estimated one in 95 of 100 cases.
    subroutine test_estimates(error)
        type(error_type), allocatable, intent(out) :: error
        type(crank_pair_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        real(wp) :: q(4), qd(4), angle, rate, before(2)
        integer :: i, n_covered

        call model%define()
        n_covered = 0
        do i = 1, 100
            options = choose(stepper='dop853')
            call change_stepper(options, options%stepper, rtol=10.0_wp**(-5 - mod(i, 7)))
            call model%start(0.9_wp + 0.003_wp*i, -4.0_wp - 0.07_wp*i, q, qd)
            call simulation%initialize(model, options, 0.0_wp, q, qd, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            do while (simulation%n_crossings == 0)
                before = [atan2(simulation%state%q(2), simulation%state%q(1)), norm2(simulation%state%qd(1:2))]
                call simulation%step(2.0_wp, failure)
                call check_no_failure(error, failure)
                if (allocated(error)) return
            end do
            angle = before(1)
            rate = -before(2)
            call turn(parallel, simulation%last_step, angle, rate)
            call model%start(angle, rate, q, qd)
            if (max(maxval(abs(simulation%state%q - q)/(1 + abs(q))), maxval(abs(simulation%state%qd - qd)/(1 + abs(qd)))) <= &
                simulation%crossings(1)%error) n_covered = n_covered + 1
        end do
        call check_true(error, n_covered >= 95, 'estimates cover the errors')
    end subroutine test_estimates

    !> Lengths that differ by 1e-4 to 1e-12 separate the branches: the linkage comes near the flat position and turns off, or the
    !> run stops. For differences from 1e-9 on it does not matter if configurations are passed.
    subroutine test_near(error)
        type(error_type), allocatable, intent(out) :: error
        type(four_bar_type), target :: model
        type(simulation_type) :: passing, stopping
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        real(wp) :: q(9), qd(9)
        integer :: i

        do i = 4, 12
            model%length = [1.0_wp, 1.0_wp, 1.0_wp, 1.0_wp - 10.0_wp**(-i)]
            model%g = 0.0_wp
            call model%define()
            options = choose(stepper='dop853')
            call change_stepper(options, options%stepper, rtol=1.0e-9_wp)
            call model%start(2.5_wp, 2.0_wp, q, qd)
            options%singular = 'pass'
            call run(passing, model, options, 0.0_wp, q, qd, 0.6_wp, failure)
            call check_count(error, passing%n_crossings, 0, 'crossings')
            if (allocated(error)) return
            if (i > 9) cycle
            call check_no_failure(error, failure)
            options%singular = 'stop'
            call run(stopping, model, options, 0.0_wp, q, qd, 0.6_wp, failure)
            if (allocated(failure)) cycle
            call check_close(error, passing%state%q, stopping%state%q, 1.0e-3_wp, 'q at the end')
            if (allocated(error)) return
        end do
    end subroutine test_near

    !> The option.
    subroutine test_stop(error)
        type(error_type), allocatable, intent(out) :: error
        type(crank_pair_type), target :: model
        type(scene_type), target :: scene
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        character(len=:), allocatable :: path
        real(wp) :: q(4), qd(4)

        call model%define()
        call model%start(1.0_wp, -6.0_wp, q, qd)
        options = choose(stepper='dop853')
        call change_stepper(options, options%stepper, rtol=1.0e-8_wp)
        options%singular = 'stop'
        call run(simulation, model, options, 0.0_wp, q, qd, 3.0_wp, failure)
        call check_failure(error, failure, 'rank_deficient', 'depend')
        if (allocated(error)) return
        call check_count(error, simulation%n_crossings, 0, 'crossings')
        if (allocated(error)) return
        ! Steps of this accuracy creep through the first dead centre, at 0.168 s, and turn onto the other branch.
        call find_scene('centric_slider_crank', path, failure)
        if (.not. allocated(failure)) call read_scene(path, [character(len=1) ::], scene, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        options = controlled(3.0e-12_wp, 'dense', 'radau5')
        options%singular = 'stop'
        call simulation%initialize(scene%model, options, scene%t_start, scene%q, scene%qd, failure, scene%assembly)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call simulation%integrate(1.0_wp, failure)
        ! Which row is named first depends on rounding.
        call check_failure(error, failure, 'rank_deficient', '"pin y"')
        if (.not. allocated(error)) call check_failure(error, failure, 'rank_deficient', '" with "')
        if (.not. allocated(error)) call check_below(error, simulation%state%t, 0.169_wp, 'time of the stop')
    end subroutine test_stop

    !> Cranks that reach the flat position with hardly any velocity, turn around just behind or before it, and return. They stay a
    !> parallelogram; a run ends by name if two crossings follow each other too closely.
    subroutine test_slow(error)
        type(error_type), allocatable, intent(out) :: error
        type(crank_pair_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        real(wp) :: q(4), qd(4), angle, rate
        integer :: i, n_named

        n_named = 0
        call model%define()
        options = choose(stepper='dop853')
        call change_stepper(options, options%stepper, rtol=1.0e-8_wp)
        do i = 2, 21
            angle = -1.0_wp
            rate = sqrt(2*gravity*sin(1.0_wp)) + (-1)**i*10.0_wp**(-i/2)
            call model%start(angle, rate, q, qd)
            call run(simulation, model, options, 0.0_wp, q, qd, 3.0_wp, failure)
            if (allocated(failure)) then
                n_named = n_named + 1
                call check_failure(error, failure, 'rank_deficient', 'not passed')
            else
                call turn(parallel, 3.0_wp, angle, rate)
                call model%start(angle, rate, q, qd)
                call check_close(error, simulation%state%q, q, 1.0e-6_wp, 'cranks')
            end if
            if (allocated(error)) return
        end do
        call check_true(error, n_named <= 2, 'most motions are passed')
    end subroutine test_slow

    !> Starts in the flat position continue on the branch of their velocity, resume bitwise before their first step, and end where a
    !> short run ends.
    subroutine test_start(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=7), parameter :: steppers(4) = [character(len=7) :: 'dop853', 'radau5', 'rk4', 'radau5']
        character(len=10), parameter :: charts(4) = [character(len=10) :: 'every_step', 'every_step', 'every_step', 'adaptive']
        real(wp), parameter :: bounds(4) = [1.0e-7_wp, 1.0e-7_wp, 1.0e-5_wp, 1.0e-7_wp]
        type(crank_pair_type), target :: model, other
        type(simulation_type) :: simulation, again
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        integer(long), allocatable :: words(:)
        real(wp) :: q(4), qd(4), angle, rate, t_end
        integer :: i, k

        call model%define()
        call other%define()
        do k = 1, size(steppers)
            options = choose(stepper=trim(steppers(k)), step=1.0e-3_wp)
            if (steppers(k) /= 'rk4') call change_stepper(options, options%stepper, rtol=1.0e-10_wp)
            options%chart = charts(k)
            do i = 1, 4
                ! The third run is short, the fourth has a velocity of the branch that rounding has changed.
                t_end = merge(2.0e-2_wp, 2.0_wp, i == 3)
                angle = 0.0_wp
                rate = 5.0_wp
                call start_of(merge(antiparallel, parallel, i == 2), q, qd)
                if (i == 4) qd = qd*(1 + 1.0e-15_wp*[1, -1, 2, 1])
                call simulation%initialize(model, options, 0.0_wp, q, qd, failure)
                call check_no_failure(error, failure)
                if (allocated(error)) return
                call check_close(error, simulation%state%qd, qd, 1.0e-13_wp, 'the velocity is kept')
                call simulation%save_state(words, failure)
                call check_no_failure(error, failure)
                call simulation%integrate(t_end, failure)
                call check_no_failure(error, failure)
                if (allocated(error)) return
                call turn(merge(antiparallel, parallel, i == 2), t_end, angle, rate)
                call start_of(merge(antiparallel, parallel, i == 2), q, qd)
                call check_close(error, simulation%state%q, q, bounds(k), 'q at the end')
                call check_close(error, simulation%state%qd, qd, 10*bounds(k), 'qd at the end')
                call check_true(error, simulation%n_crossings > 0, 'the start is recorded')
                angle = 0.0_wp
                rate = 5.0_wp
                call start_of(merge(antiparallel, parallel, i == 2), q, qd)
                call again%initialize(other, options, 0.0_wp, q, qd, failure)
                call check_no_failure(error, failure)
                call again%restore_state(words, failure)
                call check_no_failure(error, failure)
                call again%integrate(t_end, failure)
                call check_no_failure(error, failure)
                if (allocated(error)) return
                call check_true(error, all(abs(again%state%q - simulation%state%q) <= 0.0_wp), 'a resumed run is the same')
            end do
        end do

    contains

        subroutine start_of(kind, q, qd)
            integer, intent(in) :: kind
            real(wp), intent(out) :: q(4), qd(4)

            if (kind == parallel) then
                call model%start(angle, rate, q, qd)
            else
                call place_antiparallel(angle, rate, q, qd)
            end if
        end subroutine start_of
    end subroutine test_start

    !> Velocities of no branch, and none.
    subroutine test_undetermined_start(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: rates(2, 4) = reshape([1.0_wp, 0.5_wp, 1.0_wp, 1.0001_wp, 1.0_wp, -2.99_wp, 0.0_wp, 0.0_wp], [2, 4])
        type(crank_pair_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        real(wp) :: q(4), qd(4)
        integer :: i

        call model%define()
        options = choose(stepper='dop853')
        call change_stepper(options, options%stepper, rtol=1.0e-10_wp)
        do i = 1, size(rates, 2)
            call model%start(0.0_wp, 1.0_wp, q, qd)
            qd = [0.0_wp, rates(1, i), 0.0_wp, rates(2, i)]
            call simulation%initialize(model, options, 0.0_wp, q, qd, failure)
            if (i < 4) then
                call check_failure(error, failure, 'rank_deficient', 'the velocity belongs to no branch')
            else
                call check_failure(error, failure, 'rank_deficient', 'the velocity is zero')
            end if
            if (allocated(error)) return
        end do
    end subroutine test_undetermined_start
end module test_crossing
