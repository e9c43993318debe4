! SPDX-License-Identifier: MIT
!> Checkpoints of a simulation: a continued run is bitwise equal to an uninterrupted one in its complete state, and saving changes
!> nothing; damaged or unrelated data is refused.
module test_checkpoint
    use asserts, only: check_failure, check_no_failure, check_true
    use checkpoint_cases, only: case_type, set_up, take_steps
    use tandem, only: change_stepper, at_event, at_step, failure_type => error_type, long, observer_type, options_type, pack_type, &
        simulation_type, statistics_type, stepper_names, to_text, wp
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_checkpoint

    character(len=14), parameter :: scenes(9) = [character(len=14) :: 'vehicle', 'disk', 'heavy_top', 'knife_edge', &
        'stiff_pendulum', 'motorcycle', 'belt_wheel', 'redundant', 'turning_rows']
    !> Number of steps of a run, and of states saved.
    integer, parameter :: n_steps = 45, n_moments = 3

    !> Saves the state of a run, and also tries to at invalid moments.
    type, extends(observer_type) :: saver_type
        real(wp) :: save_from = 0.0_wp
        integer :: n_refused = 0
        integer(long), allocatable :: words(:), unsaved(:)
        type(failure_type), allocatable :: refusal
    contains
        procedure :: observe => save_later
    end type saver_type

contains

    subroutine collect_checkpoint(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('fixed_steps', test_fixed_steps), &
            new_unittest('controlled_steps', test_controlled_steps), &
            new_unittest('projection_at_ends', test_projection), &
            new_unittest('breakpoints', test_breakpoints), &
            new_unittest('events', test_events), &
            new_unittest('integrate', test_integrate), &
            new_unittest('work_limits', test_work_limits), &
            new_unittest('goes_on_after_any_work_limit', test_any_work_limit), &
            new_unittest('refusals', test_refusals), &
            new_unittest('damage', test_damage)]
    end subroutine collect_checkpoint

    !> Every scene, stepper, policy, refresh mode and basis with fixed steps.
    subroutine test_fixed_steps(error)
        type(error_type), allocatable, intent(out) :: error

        call try_all(0.0_wp, error)
    end subroutine test_fixed_steps

    !> The same with an error estimate.
    subroutine test_controlled_steps(error)
        type(error_type), allocatable, intent(out) :: error

        call try_all(1.0e-7_wp, error)
    end subroutine test_controlled_steps

    !> All combinations, three moments each.
    subroutine try_all(rtol, error)
        real(wp), intent(in) :: rtol
        type(error_type), allocatable, intent(inout) :: error
        character(len=10), parameter :: policies(4) = [character(len=10) :: 'every_step', 'adaptive', 'distance', 'effort']
        type(options_type) :: options
        integer :: scene, stepper, policy, way, seed

        seed = 1
        do scene = 1, size(scenes)
            do stepper = 1, size(stepper_names)
                if (rtol > 0.0_wp .and. stepper_names(stepper) == 'rk4') cycle
                do policy = 1, size(policies)
                    do way = 1, 2
                        options = options_type()
                        options%stepper = stepper_names(stepper)
                        options%rtol = rtol
                        if (.not. rtol > 0.0_wp) options%step = merge(0.0005_wp, 0.004_wp, scenes(scene) == 'stiff_pendulum')
                        options%refresh = merge('factor', 'refine', way == 1)
                        options%chart = policies(policy)
                        ! The paper's limits: on distances, and on condition and iterations.
                        if (policy > 2) options%chart = 'paper'
                        if (policy == 3) options%v_limit = 0.02_wp
                        if (policy == 3) options%w_limit = 0.05_wp
                        if (policy == 4) options%condition_limit = 1.0e4_wp
                        if (policy == 4) options%iteration_limit = 2
                        call try(trim(scenes(scene)), options, seed, .false., error)
                        if (allocated(error)) return
                    end do
                end do
            end do
        end do
    end subroutine try_all

    !> Explicit steps projected at their ends, fixed and controlled, with kept charts.
    subroutine test_projection(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options
        integer :: scene, stepper, policy, seed

        seed = 31
        do scene = 1, size(scenes)
            do stepper = 1, 3
                do policy = 1, 2
                    options = options_type(stepper=stepper_names(stepper), step=0.004_wp, projection='step_ends')
                    if (scenes(scene) == 'stiff_pendulum') options%step = 0.0005_wp
                    options%chart = merge('every_step', 'adaptive  ', policy == 1)
                    call try(trim(scenes(scene)), options, seed, .false., error)
                    if (stepper_names(stepper) == 'rk4') cycle
                    call change_stepper(options, options%stepper, rtol=1.0e-7_wp)
                    call try(trim(scenes(scene)), options, seed, .false., error)
                end do
            end do
        end do
    end subroutine test_projection

    !> A jump of nu, with charts kept across it.
    subroutine test_breakpoints(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options
        integer :: stepper, seed

        seed = 11
        do stepper = 1, size(stepper_names)
            options = options_type()
            options%stepper = stepper_names(stepper)
            options%chart = 'adaptive'
            options%step = 0.004_wp
            call try('sleigh', options, seed, .true., error)
            if (stepper_names(stepper) == 'rk4') cycle
            options%step = 0.0_wp
            options%rtol = 1.0e-8_wp
            call try('sleigh', options, seed, .true., error)
        end do
    end subroutine test_breakpoints

    !> Recording, bouncing and kicking events with multipliers and memories, saved after every step.
    subroutine test_events(error)
        type(error_type), allocatable, intent(out) :: error
        type(options_type) :: options
        integer :: stepper, seed

        seed = 21
        do stepper = 1, size(stepper_names)
            options = options_type()
            options%stepper = stepper_names(stepper)
            options%step = 0.02_wp
            call try('pendulum', options, seed, .true., error)
            if (stepper_names(stepper) == 'rk4') cycle
            options%step = 0.0_wp
            options%rtol = 1.0e-5_wp
            options%chart = 'adaptive'
            call try('pendulum', options, seed, .true., error)
        end do
    end subroutine test_events

    !> A run, and the same run continued at some of its steps by simulations that are new, or that have run elsewhere.
    subroutine try(scene, options, seed, everywhere, error)
        character(len=*), intent(in) :: scene
        type(options_type), intent(in) :: options
        integer, intent(inout) :: seed
        !> True to save after every step.
        logical, intent(in) :: everywhere
        type(error_type), allocatable, intent(inout) :: error
        type(case_type), target :: plain, saved, again, late
        type(failure_type), allocatable :: failure
        integer(long), allocatable :: expected(:), words(:), last(:)
        character(len=:), allocatable :: name
        integer :: moment(n_moments), n, i, k

        if (allocated(error)) return
        n = merge(n_steps, 2*n_steps, scene /= 'pendulum')
        name = scene//', '//trim(options%stepper)//', '//trim(options%chart)//', '//options%refresh//', '//options%projection
        do i = 1, n_moments
            seed = mod(1103*seed + 12345, 99991)
            moment(i) = 1 + mod(seed, n_steps - 5)
        end do
        call set_up(plain, scene, options, failure)
        call take_steps(plain, n, failure)
        if (.not. allocated(failure)) call plain%simulation%save_state(expected, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return

        if (scene == 'pendulum') then
            associate (events => plain%simulation%events(:plain%simulation%n_events))
                call check_true(error, all([(any(events%number == i), i=1, 4)]), name//': all four events until t = '// &
                    to_text(plain%simulation%state%t))
            end associate
        end if
        call set_up(saved, scene, options, failure)
        do i = 1, n
            call take_steps(saved, 1, failure)
            if (.not. (everywhere .or. any(moment == i))) cycle
            call saved%simulation%save_state(words, failure)
            call check_no_failure(error, failure)
            ! The first time it is a new simulation; later it is one that has run on.
            if (.not. associated(again%simulation%model)) call set_up(again, scene, options, failure)
            call again%simulation%restore_state(words, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call again%simulation%save_state(last, failure)
            call check_same(error, last, words, name//', what was restored after step '//to_text(i))
            call take_steps(again, n - i, failure)
            if (.not. allocated(failure)) call again%simulation%save_state(last, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call check_same(error, last, expected, name//', taken up after step '//to_text(i))
            call check_statistics(again, plain, name, error)
        end do
        call saved%simulation%save_state(last, failure)
        call check_same(error, last, expected, name//', saved on the way')
        call set_up(late, scene, options, failure)
        if (.not. allocated(failure)) call late%simulation%restore_state(last, failure)
        call check_no_failure(error, failure)
        if (.not. allocated(error)) call check_public(late%simulation, saved%simulation, name, error)
        k = count([(abs(saved%simulation%state%q(i) - plain%simulation%state%q(i)) > 0.0_wp, i=1, plain%model%n)])
        call check_true(error, k == 0, name//': saving changes nothing')
    end subroutine try

    !> Public results of a restored simulation, including dense output of a step taken by another one.
    subroutine check_public(one, other, name, error)
        type(simulation_type), intent(inout) :: one, other
        character(len=*), intent(in) :: name
        type(error_type), allocatable, intent(inout) :: error
        type(failure_type), allocatable :: failure
        real(wp) :: t, end_of_step
        integer :: k

        call check_true(error, all(abs(one%errors - other%errors) <= 0.0_wp) .and. abs(one%last_step - other%last_step) <= 0.0_wp, &
            name//': equal errors and last step')
        call check_true(error, (one%on_grid .eqv. other%on_grid) .and. one%grid_steps == other%grid_steps .and. &
            (one%is_stopped .eqv. other%is_stopped) .and. one%n_redundant == other%n_redundant, name//': equal figures')
        end_of_step = other%state%t
        do k = 1, 3
            t = end_of_step - 0.25_wp*k*other%last_step
            call one%look_at(t, failure)
            if (.not. allocated(failure)) call other%look_at(t, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call check_true(error, all(abs(one%state%q - other%state%q) <= 0.0_wp) .and. &
                all(abs(one%state%qdd - other%state%qdd) <= 0.0_wp), name//': equal looks into the last step')
        end do
        call one%look_back()
        call other%look_back()
    end subroutine check_public

    !> Rows are equal, word by word.
    subroutine check_same(error, found, expected, what)
        type(error_type), allocatable, intent(inout) :: error
        integer(long), intent(in) :: found(:), expected(:)
        character(len=*), intent(in) :: what

        call check_true(error, size(found) == size(expected), what//': equal lengths')
        if (allocated(error)) return
        call check_true(error, all(found == expected), what//': word '//to_text(findloc(found == expected, .false., dim=1))// &
            ' and after it are equal')
    end subroutine check_same

    !> Public results are equal too.
    subroutine check_statistics(one, other, name, error)
        type(case_type), intent(in) :: one, other
        character(len=*), intent(in) :: name
        type(error_type), allocatable, intent(inout) :: error
        type(statistics_type) :: a, b

        a = one%simulation%statistics()
        b = other%simulation%statistics()
        call check_true(error, a%right_hand_sides == b%right_hand_sides .and. a%steps == b%steps .and. a%charts == b%charts .and. &
            a%newton_matrices == b%newton_matrices .and. abs(a%local_error_sum - b%local_error_sum) <= 0.0_wp .and. &
            abs(a%position_error - b%position_error) <= 0.0_wp .and. one%simulation%n_events == other%simulation%n_events, &
            name//': equal statistics')
    end subroutine check_statistics

    !> Saved by an observer of `integrate`: the continued run ends in the same state, and its time includes both parts.
    subroutine test_integrate(error)
        type(error_type), allocatable, intent(out) :: error
        type(case_type), target :: whole, again
        type(saver_type) :: saver
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        type(statistics_type) :: before, after
        integer(long), allocatable :: words(:)

        options%stepper = 'sdirk54'
        options%rtol = 1.0e-6_wp
        options%chart = 'adaptive'
        call set_up(whole, 'pendulum', options, failure)
        saver%save_from = 0.5_wp
        call whole%simulation%integrate(1.5_wp, failure, saver)
        call check_no_failure(error, failure)
        call check_true(error, saver%n_refused > 0, 'between an event and its action there is nothing to save')
        if (allocated(error)) return
        call check_failure(error, saver%refusal, 'invalid_checkpoint', 'is pending')
        call set_up(again, 'pendulum', options, failure)
        call again%simulation%restore_state(saver%words, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        before = again%simulation%statistics()
        call check_true(error, before%wall_seconds > 0.0_wp, 'the time until then is kept')
        call check_true(error, again%simulation%state%t < 0.6_wp, 'the time of the state')
        call again%simulation%integrate(1.5_wp, failure)
        call check_no_failure(error, failure)
        call check_true(error, all(abs(again%simulation%state%q - whole%simulation%state%q) <= 0.0_wp) .and. &
            all(abs(again%simulation%state%qd - whole%simulation%state%qd) <= 0.0_wp), 'equal ends')
        call check_statistics(again, whole, 'integrate', error)
        after = again%simulation%statistics()
        call check_true(error, after%wall_seconds > before%wall_seconds, 'the time of the rest is added')
        ! An evaluation ends at the saved state, and the last step still has its dense output.
        call whole%simulation%look_at(whole%simulation%state%t - 0.5_wp*whole%simulation%last_step, failure)
        call again%simulation%save_state(words, failure)
        call again%simulation%restore_state(words, failure)
        if (.not. allocated(failure)) call again%simulation%look_at(again%simulation%state%t - 0.5_wp*again%simulation%last_step, &
            failure)
        call check_no_failure(error, failure)
        call check_true(error, all(abs(again%simulation%state%q - whole%simulation%state%q) <= 0.0_wp), 'equal looks')
        call again%simulation%save_state(words, failure)
        call check_true(error, abs(again%simulation%state%t - 1.5_wp) <= 0.0_wp, 'back at the end')
    end subroutine test_integrate

    !> Save the state of the first step from a time on.
    subroutine save_later(self, simulation, occasion, error)
        class(saver_type), intent(inout) :: self
        class(simulation_type), intent(inout) :: simulation
        integer, intent(in) :: occasion
        type(failure_type), allocatable, intent(out) :: error

        if (occasion == at_event) then
            call simulation%save_state(self%unsaved, self%refusal)
            if (allocated(self%refusal)) self%n_refused = self%n_refused + 1
        end if
        if (occasion /= at_step .or. simulation%state%t < self%save_from .or. allocated(self%words)) return
        call simulation%save_state(self%words, error)
    end subroutine save_later

    !> Wherever a limit on the work ends a run, also between two attempts of a step, it continues as without the limit.
    subroutine test_any_work_limit(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=10), parameter :: steppers(3) = [character(len=10) :: 'dopri5', 'dop853', 'sdirk54']
        character(len=10), parameter :: policies(3) = [character(len=10) :: 'every_step', 'adaptive', 'paper']
        type(case_type), target :: whole, first, second
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        type(statistics_type) :: statistics
        integer(long), allocatable :: words(:)
        integer :: scene, stepper, policy, way, most, i, n_between
        character(len=60) :: what

        n_between = 0
        do scene = 1, 3
            do stepper = 1, size(steppers)
                do policy = 1, size(policies)
                    do way = 1, 2
                        what = trim(scenes(scene))//', '//trim(steppers(stepper))//', '//policies(policy)
                        ! Long first steps, which are rejected or fail.
                        options = options_type(stepper=steppers(stepper), rtol=1.0e-3_wp, first_step=1.0_wp, &
                            chart=policies(policy), refresh=merge('factor', 'refine', way == 1))
                        if (options%chart == 'paper') options%v_limit = 0.2_wp
                        call set_up(whole, trim(scenes(scene)), options, failure)
                        call whole%simulation%integrate(2.0_wp, failure)
                        if (allocated(failure)) cycle
                        statistics = whole%simulation%statistics()
                        most = int(min(statistics%right_hand_sides, 150_long))
                        do i = 1, most - 1, 7
                            options%max_evaluations = i
                            call set_up(first, trim(scenes(scene)), options, failure)
                            call first%simulation%integrate(2.0_wp, failure)
                            ! The last step may end the run before the limit is checked.
                            if (.not. allocated(failure)) exit
                            call check_failure(error, failure, 'work_limit', 'max_evaluations')
                            if (allocated(error)) return
                            statistics = first%simulation%statistics()
                            if (statistics%rejected + statistics%failed > 0) n_between = n_between + 1
                            call first%simulation%save_state(words, failure)
                            options%max_evaluations = 0
                            call set_up(second, trim(scenes(scene)), options, failure)
                            call second%simulation%restore_state(words, failure)
                            call check_no_failure(error, failure)
                            call second%simulation%integrate(2.0_wp, failure)
                            call check_no_failure(error, failure)
                            call check_true(error, all(abs(second%simulation%state%q - whole%simulation%state%q) <= 0.0_wp), &
                                trim(what)//', limit '//to_text(i)//': q')
                            if (allocated(error)) return
                        end do
                    end do
                end do
            end do
        end do
        call check_true(error, n_between > 100, 'many of them after tries that were not kept')
    end subroutine test_any_work_limit

    !> Limits on work include the cost of the first part.
    subroutine test_work_limits(error)
        type(error_type), allocatable, intent(out) :: error
        type(case_type), target :: first, second
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        integer(long), allocatable :: words(:)
        integer(long) :: now, from, rate

        options%max_evaluations = 100
        call set_up(first, 'knife_edge', options, failure)
        call take_steps(first, 15, failure)
        call first%simulation%save_state(words, failure)
        call set_up(second, 'knife_edge', options, failure)
        call second%simulation%restore_state(words, failure)
        call take_steps(first, 100, failure)
        call check_failure(error, failure, 'work_limit', 'max_evaluations')
        if (allocated(error)) return
        deallocate (failure)
        call take_steps(second, 100, failure)
        call check_failure(error, failure, 'work_limit', 'max_evaluations')
        call check_true(error, abs(first%simulation%state%t - second%simulation%state%t) <= 0.0_wp, 'both end at one time')
        if (allocated(error)) return

        ! The first part has used all of the time.
        options%max_evaluations = 0
        options%max_seconds = 0.02_wp
        call set_up(first, 'knife_edge', options, failure)
        call take_steps(first, 1, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call system_clock(from, rate)
        do
            call system_clock(now)
            if (real(now - from, wp) > options%max_seconds*real(rate, wp)) exit
        end do
        call first%simulation%save_state(words, failure)
        call set_up(second, 'knife_edge', options, failure)
        call second%simulation%restore_state(words, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call second%simulation%integrate(1.0e6_wp, failure)
        call check_failure(error, failure, 'work_limit', 'max_seconds')
        call check_true(error, abs(first%simulation%state%t - second%simulation%state%t) <= 0.0_wp, &
            'no step is taken when the time is spent')
    end subroutine test_work_limits

    !> Unrelated data is refused without effect on the simulation. The message states the remedy.
    subroutine test_refusals(error)
        type(error_type), allocatable, intent(out) :: error
        type(case_type), target :: run, other
        type(simulation_type) :: empty
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        type(pack_type) :: pack
        integer(long), allocatable :: words(:), unread(:)
        integer :: number
        character(len=*), parameter :: other_row = 'use a state saved by save_state of this version, or restart the run'
        character(len=*), parameter :: other_set_up = 'set up the simulation as when it was saved'
        character(len=*), parameter :: other_items = 'make pack_state of your model and events list the same items'

        call empty%save_state(words, failure)
        call check_failure(error, failure, 'invalid_checkpoint', 'there is no run to save')
        options%step = 1.0e-3_wp
        call set_up(run, 'pendulum', options, failure)
        call take_steps(run, 10, failure)
        call run%simulation%save_state(words, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call empty%restore_state(words, failure)
        call check_failure(error, failure, 'invalid_checkpoint', 'there is no simulation to restore; call initialize first')
        call refused(run, words(:0), 'it is empty or truncated', other_row, error)
        call refused(run, words(:size(words) - 1), 'it is truncated', other_row, error)
        unread = words
        unread(3) = unread(3) + 1
        call refused(run, unread, 'it was written by a newer version of tandem', other_row, error)
        unread(3) = 0
        call refused(run, unread, 'it was written by an older version of tandem', other_row, error)
        unread(1) = 0
        call refused(run, unread, 'it is not a checkpoint', other_row, error)
        number = 1
        call pack%begin_writing()
        call pack%item(number)
        call pack%end_writing('mine', unread)
        call refused(run, unread, 'it is not a checkpoint', other_row, error)

        call set_up(other, 'disk', options, failure)
        call refused(other, words, 'the model is "pendulum" there, not "rolling_disk"', other_set_up, error)
        options%step = 2.0e-3_wp
        call set_up(other, 'pendulum', options, failure)
        call refused(other, words, 'it was saved with a different step', other_set_up, error)
        options = options_type(stepper='dopri5', step=1.0e-3_wp)
        call set_up(other, 'pendulum', options, failure)
        call refused(other, words, 'it was saved with a different stepper', other_set_up, error)
        options = options_type(utol=1.0e-13_wp, step=1.0e-3_wp)
        call set_up(other, 'pendulum', options, failure)
        call refused(other, words, 'it was saved with a different utol', other_set_up, error)
        options = options_type(step=1.0e-3_wp)
        call set_up(other, 'pendulum', options, failure)
        other%model%breakpoints = [0.005_wp]
        call refused(other, words, 'it was saved with different breakpoints', other_set_up, error)
        other%model%breakpoints = [0.5_wp]
        other%model%nu_jumps = [.true.]
        call refused(other, words, 'it was saved with different breakpoints', other_set_up, error)
        ! Breakpoints after the time up to which both are complete may differ.
        other%model%state%breakpoints_until = 0.4_wp
        call other%simulation%restore_state(words, failure)
        call check_no_failure(error, failure)
        other%model%state%breakpoints_until = huge(1.0_wp)
        deallocate (other%model%breakpoints, other%model%nu_jumps)
        other%model%constant_mass = .not. other%model%constant_mass
        call refused(other, words, 'its mass matrix is '//trim(merge('not constant', 'constant    ', &
            other%model%constant_mass)), other_set_up, error)
        other%model%mass_blocks = [1, 1]
        call refused(other, words, 'it was saved with different blocks of the mass matrix', other_set_up, error)
        deallocate (other%model%mass_blocks)
        other%model%constant_mass = .not. other%model%constant_mass
        other%model%coordinate_scale = [2.0_wp, 1.0_wp]
        call refused(other, words, 'it was saved with different scales of coordinates', other_set_up, error)
        deallocate (other%model%coordinate_scale)
        other%kick%name = 'push'
        call refused(other, words, 'event 2 is "kick" there, not "push"', other_set_up, error)
        call other%simulation%add_event(other%beat)
        call refused(other, words, 'it has 4 events watched, not 5', other_set_up, error)
        call set_up(other, 'pendulum', options, failure)
        other%kick%lists_more = .true.
        call refused(other, words, 'its items differ from those read here', other_items, error)
        ! Limits that only end a run may change.
        other%kick%lists_more = .false.
        options%max_steps = 1000
        call set_up(other, 'pendulum', options, failure)
        call other%simulation%restore_state(words, failure)
        call check_no_failure(error, failure)
    end subroutine test_refusals

    subroutine refused(self, words, why, advice, error)
        type(case_type), intent(inout) :: self
        integer(long), intent(in) :: words(:)
        character(len=*), intent(in) :: why, advice
        type(error_type), allocatable, intent(inout) :: error
        type(failure_type), allocatable :: failure

        call self%simulation%restore_state(words, failure)
        call check_failure(error, failure, 'invalid_checkpoint', 'the state cannot be restored: '//why//'; '//advice)
    end subroutine refused

    !> With any flipped bit, the array is refused.
    subroutine test_damage(error)
        type(error_type), allocatable, intent(out) :: error
        type(case_type), target :: run
        type(failure_type), allocatable :: failure
        type(options_type) :: options
        integer(long), allocatable :: words(:)
        integer :: i, bit

        call set_up(run, 'disk', options, failure)
        call take_steps(run, 3, failure)
        call run%simulation%save_state(words, failure)
        do i = 1, size(words)
            bit = mod(7*i, 64)
            words(i) = ieor(words(i), ishft(1_long, bit))
            call run%simulation%restore_state(words, failure)
            call check_true(error, allocated(failure), 'refused with a wrong bit in word '//to_text(i))
            words(i) = ieor(words(i), ishft(1_long, bit))
        end do
        call run%simulation%restore_state(words, failure)
        call check_no_failure(error, failure)
    end subroutine test_damage
end module test_checkpoint
