! SPDX-License-Identifier: MIT
!> Tests of the simulation object: stepping from outside, legs, the time grid, observers, independence, reports.
module test_simulation
    use asserts, only: check_below, check_close, check_count, check_failure, check_no_failure, check_true
    use model_pendulum, only: pendulum_type
    use reference, only: read_reference, reference_type
    use runs, only: choose, get_start, new_scene, run, scene_names
    use tandem, only: at_end, at_start, at_step, failure_type => error_type, long, model_type, observer_type, options_type, &
        rolling_disk_type, simulation_type, statistics_type, wp
    use tandem_io, only: find_scene, read_scene, scene_type
    use testdrive, only: error_type, new_unittest, unittest_type
    use, intrinsic :: ieee_arithmetic, only: ieee_quiet_nan, ieee_value
    implicit none (type, external)
    private

    public :: collect_simulation

    !> Counts the occasions and stores their order.
    type, extends(observer_type) :: occasion_watch_type
        integer :: starts = 0, steps = 0, ends = 0
        logical :: in_order = .true.
        real(wp) :: last_time = -huge(1.0_wp)
    contains
        procedure :: observe
    end type occasion_watch_type

contains

    !> The suite.
    subroutine collect_simulation(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('the-start-is-complete-after-initialize', test_start), &
            new_unittest('without-an-accepted-start-there-is-no-run', test_no_run), &
            new_unittest('stepping-from-outside-is-integrating', test_step), &
            new_unittest('two-legs-on-the-grid-are-one-run', test_legs), &
            new_unittest('the-end-is-met-exactly', test_end), &
            new_unittest('the-grid-has-no-summed-rounding', test_grid), &
            new_unittest('a-start-time-that-is-not-zero-shifts-the-grid', test_shift), &
            new_unittest('a-rest-too-short-to-matter-is-merged', test_sliver), &
            new_unittest('observers-see-start-steps-and-end-in-order', test_observer), &
            new_unittest('two-simulations-never-meet', test_two), &
            new_unittest('copies-of-a-model-are-models-of-their-own', test_copies), &
            new_unittest('a-simulation-can-be-initialized-again', test_again), &
            new_unittest('kinetic-energy-is-half-qd-m-qd', test_kinetic_energy), &
            new_unittest('energy-of-a-pendulum-is-constant', test_energy), &
            new_unittest('multipliers-of-a-pendulum-are-its-tension', test_tension), &
            new_unittest('errors-of-the-current-state-are-at-hand', test_errors), &
            new_unittest('seconds-are-counted', test_seconds)]
    end subroutine collect_simulation

    subroutine observe(self, simulation, occasion, error)
        class(occasion_watch_type), intent(inout) :: self
        class(simulation_type), intent(inout) :: simulation
        integer, intent(in) :: occasion
        type(failure_type), allocatable, intent(out) :: error

        select case (occasion)
        case (at_start)
            self%in_order = self%in_order .and. self%starts == 0 .and. self%steps == 0 .and. self%ends == 0
            self%starts = self%starts + 1
        case (at_step)
            self%in_order = self%in_order .and. self%starts == 1 .and. self%ends == 0 .and. &
                simulation%state%t > self%last_time
            self%steps = self%steps + 1
        case (at_end)
            self%in_order = self%in_order .and. .not. simulation%state%t > self%last_time
            self%ends = self%ends + 1
        case default
            self%in_order = .false.
        end select
        self%last_time = simulation%state%t
    end subroutine observe

    !> q, qd, qdd and the multipliers before the first step, against the references.
    subroutine test_start(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(reference_type) :: table
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: lambda(:)
        integer :: k

        do k = 1, size(scene_names)
            call new_scene(trim(scene_names(k)), model)
            call read_reference(trim(scene_names(k)), table)
            call simulation%initialize(model, options, 0.0_wp, table%q(:, 1), table%qd(:, 1), failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            lambda = table%lambda(:, 1)
            call simulation%multipliers(lambda)
            call check_close(error, simulation%state%q, table%q(:, 1), 1.0e-15_wp, 'q')
            call check_close(error, simulation%state%qd, table%qd(:, 1), 1.0e-14_wp, 'qd')
            ! The stiff spring has 1e-9 N for the last digit of its length.
            call check_close(error, simulation%state%qdd, table%qdd(:, 1), 1.0e-12_wp*max(1.0_wp, maxval(abs(table%qdd(:, 1)))), &
                'qdd')
            call check_close(error, lambda, table%lambda(:, 1), 1.0e-12_wp*max(1.0_wp, maxval(abs(table%lambda(:, 1)))), 'lambda')
        end do
    end subroutine test_start

    !> No operation succeeds or crashes if `initialize` was not called or has failed, also after a previous run.
    subroutine test_no_run(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(simulation_type) :: never, refused, again
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)

        call refuse_all(never, error)
        call model%define()
        call model%start(0.5_wp, 0.0_wp, q, qd)
        call refused%initialize(model, choose(step=1.0e-2_wp), 0.0_wp, 2*q, qd, failure)
        call check_failure(error, failure, 'inconsistent_start', 'rod')
        call refuse_all(refused, error)
        call again%initialize(model, choose(step=1.0e-2_wp), 0.0_wp, q, qd, failure)
        if (.not. allocated(failure)) call again%integrate(1.0_wp, failure)
        call check_no_failure(error, failure)
        call again%initialize(model, choose(step=-1.0_wp), 0.0_wp, q, qd, failure)
        call check_failure(error, failure, 'invalid_option', 'step')
        call refuse_all(again, error)
    end subroutine test_no_run

    !> Every procedure that needs a run.
    subroutine refuse_all(simulation, error)
        type(simulation_type), intent(inout) :: simulation
        type(error_type), allocatable, intent(inout) :: error
        character(len=*), parameter :: why = 'there is no run'
        type(failure_type), allocatable :: failure
        integer(long), allocatable :: words(:)
        real(wp) :: lambda(1), energy
        integer :: stat

        call simulation%integrate(2.0_wp, failure)
        call check_failure(error, failure, 'invalid_option', why)
        call simulation%step(2.0_wp, failure)
        call check_failure(error, failure, 'invalid_option', why)
        call simulation%look_at(0.0_wp, failure)
        call check_failure(error, failure, 'invalid_option', why)
        call simulation%save_state(words, failure)
        call check_failure(error, failure, 'invalid_checkpoint', why)
        lambda = 1.0_wp
        call simulation%multipliers(lambda)
        call check_below(error, abs(lambda(1)), 0.0_wp, 'multiplier')
        call simulation%kinetic_energy(energy, stat)
        call check_true(error, stat /= 0, 'no kinetic energy')
        call simulation%potential_energy(energy, stat)
        call check_true(error, stat /= 0, 'no potential energy')
        call simulation%look_back()
    end subroutine refuse_all

    !> A disk shortly before its first dip.
    subroutine roll(simulation, model, t_end, error)
        type(simulation_type), intent(inout) :: simulation
        type(rolling_disk_type), intent(inout), target :: model
        real(wp), intent(in) :: t_end
        type(error_type), allocatable, intent(inout) :: error
        type(failure_type), allocatable :: failure
        real(wp) :: q(9), qd(9)

        call model%define()
        call model%start([-3.0_wp, 0.2_wp, 0.1_wp], 0.1_wp, q, qd)
        call run(simulation, model, choose(step=5.0e-3_wp), 0.0_wp, q, qd, t_end, failure)
        call check_no_failure(error, failure)
    end subroutine roll

    subroutine test_step(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type), target :: model, other
        type(simulation_type) :: integrated, stepped
        type(failure_type), allocatable :: failure
        integer :: i

        call roll(integrated, model, 1.0_wp, error)
        call roll(stepped, other, 5.0e-3_wp, error)
        call stepped%step(stepped%state%t, failure)
        call check_failure(error, failure, 'invalid_option', 'must be after the current time')
        call stepped%step(ieee_value(1.0_wp, ieee_quiet_nan), failure)
        call check_failure(error, failure, 'invalid_option', 'must be after the current time')
        do i = 2, 200
            call stepped%step(1.0_wp, failure)
            call check_no_failure(error, failure)
        end do
        call check_close(error, [stepped%state%t], [integrated%state%t], 0.0_wp, 't')
        call check_close(error, stepped%state%q, integrated%state%q, 0.0_wp, 'q')
        call check_close(error, stepped%state%qdd, integrated%state%qdd, 0.0_wp, 'qdd')
    end subroutine test_step

    subroutine test_legs(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type), target :: model, other
        type(simulation_type) :: one, two
        type(failure_type), allocatable :: failure

        call roll(one, model, 1.0_wp, error)
        call roll(two, other, 0.5_wp, error)
        call two%integrate(1.0_wp, failure)
        call check_no_failure(error, failure)
        call check_close(error, two%state%q, one%state%q, 0.0_wp, 'q')
        call check_close(error, two%state%qd, one%state%qd, 0.0_wp, 'qd')
    end subroutine test_legs

    subroutine test_end(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type), target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        real(wp), parameter :: t_end = 0.1234567_wp

        call roll(simulation, model, t_end, error)
        statistics = simulation%statistics()
        call check_close(error, [simulation%state%t], [t_end], 0.0_wp, 't')
        call check_count(error, statistics%steps, 25, 'steps')
        call check_below(error, abs(simulation%last_step - (t_end - 0.12_wp)), 1.0e-15_wp, 'error of the last step''s size')
        call check_true(error, .not. simulation%on_grid, 'the end lies beside the grid')
        call check_count(error, simulation%grid_steps, 24, 'steps on the grid')
    end subroutine test_end

    subroutine test_grid(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)
        ! Otherwise product and difference may be fused to one operation, which rounds once.
        real(wp), volatile :: t
        integer :: i

        call model%define()
        call model%start(0.3_wp, 0.0_wp, q, qd)
        call simulation%initialize(model, choose(step=0.1_wp), 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
        do i = 1, 1000
            call simulation%step(1000.0_wp, failure)
            call check_no_failure(error, failure)
            t = i*0.1_wp
            call check_close(error, [simulation%state%t], [t], 0.0_wp, 't')
            if (allocated(error)) return
        end do
    end subroutine test_grid

    subroutine test_shift(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(simulation_type) :: early, late
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)

        call model%define()
        call model%start(0.3_wp, 0.0_wp, q, qd)
        call run(early, model, choose(step=0.125_wp), -1.0_wp, q, qd, 0.0_wp, failure)
        call check_no_failure(error, failure)
        call check_close(error, [early%state%t], [0.0_wp], 0.0_wp, 't')
        call run(late, model, choose(step=0.125_wp), 7.0_wp, q, qd, 8.0_wp, failure)
        call check_no_failure(error, failure)
        ! Nothing depends on time here, and the steps are exact numbers.
        call check_close(error, late%state%q, early%state%q, 0.0_wp, 'q')
    end subroutine test_shift

    subroutine test_sliver(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type), target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        real(wp) :: t_end

        t_end = nearest(0.1_wp, 1.0_wp)
        call roll(simulation, model, t_end, error)
        statistics = simulation%statistics()
        call check_count(error, statistics%steps, 20, 'steps')
        call check_close(error, [simulation%state%t], [t_end], 0.0_wp, 't')
        call check_true(error, simulation%on_grid, 'the end counts as a point of the grid')
    end subroutine test_sliver

    subroutine test_observer(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(simulation_type) :: simulation
        type(occasion_watch_type) :: watch
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)

        call model%define()
        call model%start(0.3_wp, 0.0_wp, q, qd)
        call run(simulation, model, choose(step=0.1_wp), 0.0_wp, q, qd, 1.0_wp, failure, watch)
        call check_no_failure(error, failure)
        call check_count(error, watch%starts, 1, 'starts')
        call check_count(error, watch%steps, 10, 'steps')
        call check_count(error, watch%ends, 1, 'ends')
        call check_true(error, watch%in_order, 'start, steps and end come in order')
    end subroutine test_observer

    !> Alternating steps of two simulations, each with its own model.
    subroutine test_two(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type), target :: disk, other_disk
        type(pendulum_type), target :: pendulum, other_pendulum
        type(simulation_type) :: roll_alone, swing_alone, roll_together, swing_together
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2)
        integer :: i

        call roll(roll_alone, disk, 0.5_wp, error)
        call pendulum%define()
        call pendulum%start(0.3_wp, 0.0_wp, q, qd)
        call run(swing_alone, pendulum, choose(step=5.0e-3_wp), 0.0_wp, q, qd, 0.5_wp, failure)
        call check_no_failure(error, failure)
        call roll(roll_together, other_disk, 5.0e-3_wp, error)
        call other_pendulum%define()
        call run(swing_together, other_pendulum, choose(step=5.0e-3_wp), 0.0_wp, q, qd, 5.0e-3_wp, failure)
        call check_no_failure(error, failure)
        do i = 2, 100
            call roll_together%step(0.5_wp, failure)
            call check_no_failure(error, failure)
            call swing_together%step(0.5_wp, failure)
            call check_no_failure(error, failure)
        end do
        call check_close(error, roll_together%state%q, roll_alone%state%q, 0.0_wp, 'q of the disk')
        call check_close(error, swing_together%state%q, swing_alone%state%q, 0.0_wp, 'q of the pendulum')
    end subroutine test_two

    !> Copies of one description, made before and after runs with it, run in turns: each as the description of a scene that is read
    !> anew.
    subroutine test_copies(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=*), parameter :: names(4) = [character(len=17) :: 'a03_andrews', 'mechanism_vehicle', 'trailers', &
            'motorcycle']
        integer, parameter :: n_steps = 5
        character(len=:), allocatable :: path
        type(scene_type), allocatable, target :: scene, fresh
        class(model_type), allocatable, target :: before, after
        type(simulation_type), allocatable :: alone, one, two, three
        type(failure_type), allocatable :: failure
        integer :: i, k

        do k = 1, size(names)
            allocate (scene, fresh, alone, one, two, three)
            call find_scene(trim(names(k)), path, failure)
            if (.not. allocated(failure)) call read_scene(path, [character(len=1) ::], scene, failure)
            if (.not. allocated(failure)) call read_scene(path, [character(len=1) ::], fresh, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            allocate (before, source=scene%model)
            call start(one, scene%model)
            call advance(one)
            allocate (after, source=scene%model)
            call start(alone, fresh%model)
            do i = 1, n_steps
                call advance(alone)
            end do
            call start(two, before)
            call start(three, after)
            do i = 1, n_steps
                if (i > 1) call advance(one)
                call advance(two)
                call advance(three)
            end do
            call check_close(error, one%state%q, alone%state%q, 0.0_wp, trim(names(k))//': the original')
            call check_close(error, two%state%q, alone%state%q, 0.0_wp, trim(names(k))//': a copy before the run')
            call check_close(error, three%state%q, alone%state%q, 0.0_wp, trim(names(k))//': a copy after a step')
            if (allocated(error)) return
            deallocate (scene, fresh, alone, one, two, three, before, after)
        end do

    contains

        subroutine start(simulation, model)
            type(simulation_type), intent(inout) :: simulation
            class(model_type), intent(inout), target :: model

            call simulation%initialize(model, scene%options, scene%t_start, scene%q, scene%qd, failure)
            call check_no_failure(error, failure)
        end subroutine start

        subroutine advance(simulation)
            type(simulation_type), intent(inout) :: simulation

            call simulation%step(scene%t_end, failure)
            call check_no_failure(error, failure)
        end subroutine advance
    end subroutine test_copies

    subroutine test_again(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: model
        type(rolling_disk_type), target :: disk, fresh_disk
        type(simulation_type) :: simulation, fresh
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)

        call new_scene('vehicle', model)
        call get_start('vehicle', q, qd)
        call run(simulation, model, choose(chart='paper', refresh='refine', v_limit=10.0_wp), 0.0_wp, q, qd, 0.1_wp, failure)
        call check_no_failure(error, failure)
        call roll(simulation, disk, 0.5_wp, error)
        call roll(fresh, fresh_disk, 0.5_wp, error)
        call check_close(error, simulation%state%q, fresh%state%q, 0.0_wp, 'q')
    end subroutine test_again

    subroutine test_kinetic_energy(error)
        type(error_type), allocatable, intent(out) :: error
        class(model_type), allocatable, target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: q(:), qd(:)
        !> The references' energies at t = 0.
        real(wp), parameter :: expected(5) = [337500.0_wp, 7.500625005_wp, 9.0_wp, 0.35_wp, 0.0_wp]
        real(wp) :: energy
        integer :: k, stat

        do k = 1, size(scene_names)
            call new_scene(trim(scene_names(k)), model)
            call get_start(trim(scene_names(k)), q, qd)
            call simulation%initialize(model, options, 0.0_wp, q, qd, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call simulation%kinetic_energy(energy, stat)
            call check_count(error, stat, 0, 'status')
            call check_below(error, abs(energy - expected(k)), 1.0e-15_wp*max(1.0_wp, expected(k)), scene_names(k)//': error of T')
        end do
    end subroutine test_kinetic_energy

    subroutine test_energy(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2), kinetic, potential, first
        integer :: stat

        call model%define()
        call model%start(1.5_wp, 1.0_wp, q, qd)
        call simulation%initialize(model, choose(step=1.0e-3_wp), 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
        call simulation%kinetic_energy(kinetic, stat)
        call simulation%potential_energy(potential, stat)
        first = kinetic + potential
        call check_below(error, abs(kinetic - 0.5_wp*2*0.8_wp**2), 1.0e-15_wp, 'error of T')
        call check_below(error, abs(potential + 2*9.81_wp*0.8_wp*cos(1.5_wp)), 1.0e-14_wp, 'error of V')
        call simulation%integrate(2.0_wp, failure)
        call check_no_failure(error, failure)
        call simulation%kinetic_energy(kinetic, stat)
        call simulation%potential_energy(potential, stat)
        ! (omega h)**4 = 1e-10 with omega of 3 to 5 rad/s, times the constants of the method.
        call check_below(error, abs(kinetic + potential - first), 1.0e-9_wp, 'change of the energy')
    end subroutine test_energy

    !> lambda = (tension)/length = m (rate**2 + g cos(angle)/length).
    subroutine test_tension(error)
        type(error_type), allocatable, intent(out) :: error
        type(pendulum_type), target :: model
        type(simulation_type) :: simulation
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        real(wp) :: q(2), qd(2), lambda(1)

        call model%define()
        call model%start(0.6_wp, 1.7_wp, q, qd)
        call simulation%initialize(model, options, 0.0_wp, q, qd, failure)
        call check_no_failure(error, failure)
        call simulation%multipliers(lambda)
        call check_close(error, lambda, [2*(1.7_wp**2 + 9.81_wp*cos(0.6_wp)/0.8_wp)], 1.0e-13_wp, 'lambda')
    end subroutine test_tension

    subroutine test_errors(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type), target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics

        call roll(simulation, model, 0.5_wp, error)
        statistics = simulation%statistics()
        call check_true(error, simulation%errors(1) <= statistics%position_error .and. &
            simulation%errors(2) <= statistics%velocity_error .and. simulation%errors(3) <= statistics%acceleration_error, &
            'the current errors are not above the largest ones')
        call check_true(error, maxval(simulation%errors) > 0.0_wp, 'rounding is seen')
    end subroutine test_errors

    subroutine test_seconds(error)
        type(error_type), allocatable, intent(out) :: error
        type(rolling_disk_type), target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: first, second
        type(failure_type), allocatable :: failure

        call roll(simulation, model, 1.0_wp, error)
        first = simulation%statistics()
        call simulation%integrate(2.0_wp, failure)
        call check_no_failure(error, failure)
        second = simulation%statistics()
        call check_true(error, first%wall_seconds > 0.0_wp .and. second%wall_seconds > first%wall_seconds, 'wall time adds up')
        call check_true(error, second%cpu_seconds >= first%cpu_seconds, 'processor time adds up')
    end subroutine test_seconds
end module test_simulation
