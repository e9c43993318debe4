! SPDX-License-Identifier: MIT
!> Tests of the stepper that switches from dop853 to radau5 and back during a run.
module test_auto
    use asserts, only: check_below, check_count, check_no_failure, check_true
    use model_stiff_pendulum, only: stiff_pendulum_type
    use runs, only: get_start, new_scene
    use tandem, only: at_step, event_type, failure_type => error_type, long, model_type, motorcycle_type, new_stepper, &
        observer_type, options_type, properties_type, simulation_type, statistics_type, stepper_choices, wp
    use tandem_stepper, only: stepper_type
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_auto

    !> Evaluates the middle of every step: distance of the motion from the mean of the ends, and constraints.
    type, extends(observer_type) :: looker_type
        real(wp) :: t_last = 0.0_wp, constraint = 0.0_wp
        !> States in the middle of steps (t, x, y) and their number.
        real(wp), allocatable :: seen(:, :)
        integer :: n = 0
    contains
        procedure :: observe
    end type looker_type

    !> The pendulum hangs below its pivot.
    type, extends(event_type) :: below_type
    contains
        procedure :: evaluate
    end type below_type

contains

    !> The suite.
    subroutine collect_auto(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('auto-is-a-stepper-by-name', test_name), &
            new_unittest('auto-with-a-fixed-step-is-rk4', test_fixed_step), &
            new_unittest('auto-is-dop853-where-nothing-is-stiff', test_explicit), &
            new_unittest('auto-costs-little-more-than-the-better-method', test_cost), &
            new_unittest('auto-begins-with-implicit-steps-where-stability-asks-for-far-shorter-ones', test_beginning), &
            new_unittest('auto-stays-explicit-where-a-spring-rings', test_ringing), &
            new_unittest('auto-follows-a-spring-that-stiffens-and-softens', test_there_and_back), &
            new_unittest('auto-keeps-dense-output-and-events-across-switches', test_events), &
            new_unittest('auto-goes-on-bitwise-from-a-checkpoint', test_checkpoint)]
    end subroutine collect_auto

    !> A pendulum on a spring of frequency ratio R, damped half critically by default, that starts slowly from 1 rad.
    subroutine set_up(model, ratio, options, simulation, failure, stiffens_at, softens_at, damping, beyond)
        type(stiff_pendulum_type), intent(inout), target :: model
        real(wp), intent(in) :: ratio
        type(options_type), intent(in) :: options
        type(simulation_type), intent(inout) :: simulation
        type(failure_type), allocatable, intent(out) :: failure
        real(wp), intent(in), optional :: stiffens_at, softens_at
        !> Damping relative to the critical one, and stretch of the spring beyond its balance.
        real(wp), intent(in), optional :: damping, beyond
        real(wp) :: stretch

        model%k = 9.81_wp*ratio**2
        model%c = sqrt(model%k)
        if (present(damping)) model%c = 2*damping*model%c
        model%has_stretch = .true.
        model%has_derivatives = .true.
        if (present(stiffens_at)) model%stiffens_at = stiffens_at
        if (present(softens_at)) model%softens_at = softens_at
        call model%define()
        stretch = 9.81_wp*cos(1.0_wp)/model%k
        if (present(beyond)) stretch = stretch + beyond
        call simulation%initialize(model, options, 0.0_wp, [(1 + stretch)*sin(1.0_wp), -(1 + stretch)*cos(1.0_wp), stretch], &
            spread(0.0_wp, 1, 3), failure)
    end subroutine set_up

    !> The name, and the stated partner.
    subroutine test_name(error)
        type(error_type), allocatable, intent(out) :: error
        class(stepper_type), allocatable :: stepper
        type(properties_type) :: properties

        call check_true(error, any(stepper_choices == 'auto'), 'auto can be asked for')
        call new_stepper('auto', stepper)
        properties = stepper%properties()
        call check_true(error, properties%name == 'auto' .and. properties%partner == 'radau5', 'auto and its partner')
    end subroutine test_name

    !> A fixed step gives no error for the choice, and it is rk4.
    subroutine test_fixed_step(error)
        type(error_type), allocatable, intent(out) :: error
        type(stiff_pendulum_type), target :: model
        type(simulation_type) :: simulation
        type(failure_type), allocatable :: failure

        call set_up(model, 10.0_wp, options_type(stepper='auto', step=1.0e-3_wp), simulation, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call check_true(error, simulation%options%stepper == 'rk4', 'auto with a fixed step is rk4')
    end subroutine test_fixed_step

    !> The same run bit by bit, at nearly the same cost; also if a smooth motion becomes rough, such as that of the disk which falls
    !> over.
    subroutine test_explicit(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=10), parameter :: scenes(4) = [character(len=10) :: 'vehicle', 'disk', 'heavy_top', 'knife_edge']
        class(model_type), allocatable, target :: model
        type(simulation_type) :: plain, auto
        type(statistics_type) :: of_plain, of_auto
        type(failure_type), allocatable :: failure
        real(wp), parameter :: rtols(2) = [1.0e-7_wp, 1.0e-9_wp], ends(2) = [2.0_wp, 10.0_wp]
        real(wp), allocatable :: q(:), qd(:)
        integer :: i, j

        do j = 0, 2*size(scenes) - 1
            i = 1 + j/2
            associate (rtol => rtols(1 + mod(j, 2)), t_end => ends(1 + mod(j, 2)))
                call new_scene(trim(scenes(i)), model)
                call get_start(trim(scenes(i)), q, qd)
                call plain%initialize(model, options_type(stepper='dop853', rtol=rtol), 0.0_wp, q, qd, failure)
                if (.not. allocated(failure)) call plain%integrate(t_end, failure)
                if (.not. allocated(failure)) call auto%initialize(model, options_type(stepper='auto', rtol=rtol), 0.0_wp, q, qd, &
                    failure)
                if (.not. allocated(failure)) call auto%integrate(t_end, failure)
                call check_no_failure(error, failure)
                if (allocated(error)) return
                of_plain = plain%statistics()
                of_auto = auto%statistics()
                call check_true(error, all(abs(plain%state%q - auto%state%q) <= 0.0_wp), trim(scenes(i))//': the same motion')
                call check_count(error, of_auto%switches, 0, trim(scenes(i))//': switches')
                ! The estimates of the largest eigenvalue before the first step.
                call check_count(error, of_auto%right_hand_sides, int(of_plain%right_hand_sides) + 2, &
                    trim(scenes(i))//': evaluations')
                if (allocated(error)) return
                deallocate (model)
            end associate
        end do
    end subroutine test_explicit

    !> The work of a run in explicit stages: an implicit step is worth 40.
    pure real(wp) function work_of(s, n_implicit)
        type(statistics_type), intent(in) :: s
        integer(long), intent(in) :: n_implicit
        real(wp) :: part

        part = real(n_implicit, wp)/real(s%steps, wp)
        work_of = real(s%steps + s%rejected + s%failed, wp)*(12*(1 - part) + 40*part)
    end function work_of

    !> Pendulums of all degrees of stiffness: right to the tolerance, and hardly more work than with the better of both. The
    !> detection takes twenty additional explicit steps.
    subroutine test_cost(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: ratios(8) = [3.0_wp, 10.0_wp, 30.0_wp, 1.0e2_wp, 3.0e2_wp, 1.0e3_wp, 1.0e6_wp, 1.0e8_wp]
        real(wp), parameter :: rtols(2) = [1.0e-4_wp, 1.0e-6_wp]
        type(stiff_pendulum_type), target :: model
        type(simulation_type) :: fine, simulation
        type(statistics_type) :: s
        type(failure_type), allocatable :: failure
        real(wp) :: work(3)
        integer(long) :: n_implicit
        integer :: i, j, k
        character(len=6), parameter :: steppers(3) = ['dop853', 'radau5', 'auto  ']

        do i = 1, size(ratios)
            call set_up(model, ratios(i), options_type(stepper='radau5', rtol=1.0e-10_wp), fine, failure)
            if (.not. allocated(failure)) call fine%integrate(10.0_wp, failure)
            do j = 1, size(rtols)
                work = huge(1.0_wp)
                ! Beyond 1e3 the explicit method does not finish.
                do k = merge(2, 1, ratios(i) > 2.0e3_wp), size(steppers)
                    if (.not. allocated(failure)) call set_up(model, ratios(i), options_type(stepper=steppers(k), rtol=rtols(j)), &
                        simulation, failure)
                    if (.not. allocated(failure)) call simulation%integrate(10.0_wp, failure)
                    call check_no_failure(error, failure)
                    if (allocated(error)) return
                    s = simulation%statistics()
                    n_implicit = s%implicit_steps
                    if (k == 2) n_implicit = s%steps
                    work(k) = work_of(s, n_implicit)
                end do
                call check_below(error, maxval(abs(simulation%state%q(:2) - fine%state%q(:2))), 10*rtols(j), 'position')
                call check_below(error, work(3), 1.2_wp*min(work(1), work(2)) + 12*20, 'work')
                ! If stability would limit the steps from the start, no explicit steps at all.
                if (ratios(i) > 2.0e3_wp) call check_count(error, s%implicit_steps, int(s%steps), 'implicit steps')
                if (allocated(error)) return
            end do
        end do
    end subroutine test_cost

    !> A motorcycle in balance with increasingly stiff suspensions: the run with radau5 from its first step on, except for
    !> occasional estimates of the largest eigenvalue.
    subroutine test_beginning(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: times(3) = [300.0_wp, 1.0e3_wp, 1.0e4_wp], rtols(2) = [1.0e-4_wp, 1.0e-6_wp]
        type(motorcycle_type), target :: model
        type(simulation_type) :: plain, auto
        type(statistics_type) :: of_plain, of_auto
        type(failure_type), allocatable :: failure
        real(wp) :: q(10), qd(10)
        integer :: i, j, stat

        do i = 1, size(times)
            model%stiffness = 1.5e4_wp*times(i)
            model%damping = 1.5e3_wp*times(i)
            call model%define()
            call model%start(15.0_wp, q, qd, stat)
            do j = 1, size(rtols)
                call plain%initialize(model, options_type(stepper='radau5', rtol=rtols(j)), 0.0_wp, q, qd, failure)
                if (.not. allocated(failure)) call plain%integrate(10.0_wp, failure)
                if (.not. allocated(failure)) call auto%initialize(model, options_type(stepper='auto', rtol=rtols(j)), 0.0_wp, &
                    q, qd, failure)
                if (.not. allocated(failure)) call auto%integrate(10.0_wp, failure)
                call check_no_failure(error, failure)
                if (allocated(error)) return
                of_plain = plain%statistics()
                of_auto = auto%statistics()
                call check_count(error, of_auto%implicit_steps, int(of_auto%steps), 'implicit steps')
                call check_count(error, of_auto%steps, int(of_plain%steps), 'steps')
                call check_below(error, real(of_auto%right_hand_sides, wp), 1.1_wp*real(of_plain%right_hand_sides, wp), &
                    'evaluations')
                call check_below(error, maxval(abs(auto%state%q - plain%state%q)), rtols(j), 'distance of the two runs')
                if (allocated(error)) return
            end do
        end do
    end subroutine test_beginning

    !> Undamped and stretched beyond its balance: the spring oscillates, and steps must follow its frequency, regardless of the
    !> length of the first implicit one.
    subroutine test_ringing(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: ratios(2) = [30.0_wp, 300.0_wp]
        type(stiff_pendulum_type), target :: model
        type(simulation_type) :: simulation
        type(statistics_type) :: s
        type(failure_type), allocatable :: failure
        real(wp) :: work(2)
        character(len=6), parameter :: steppers(2) = ['dop853', 'auto  ']
        integer :: i, k

        do i = 1, size(ratios)
            do k = 1, size(steppers)
                call set_up(model, ratios(i), options_type(stepper=steppers(k), rtol=1.0e-6_wp), simulation, failure, &
                    damping=0.0_wp, beyond=1.0e-2_wp)
                if (.not. allocated(failure)) call simulation%integrate(2.0_wp, failure)
                call check_no_failure(error, failure)
                if (allocated(error)) return
                s = simulation%statistics()
                work(k) = work_of(s, s%implicit_steps)
            end do
            call check_below(error, work(2), 1.2_wp*work(1) + 12*20, 'work')
            if (allocated(error)) return
        end do
    end subroutine test_ringing

    !> Soft, a thousand times as stiff from 1 s to 3 s, and soft again: the explicit method, the implicit one, and the explicit one.
    subroutine test_there_and_back(error)
        type(error_type), allocatable, intent(out) :: error
        real(wp), parameter :: ratios(2) = [20.0_wp, 40.0_wp], rtols(2) = [1.0e-4_wp, 1.0e-6_wp]
        type(stiff_pendulum_type), target :: model
        type(simulation_type) :: fine, simulation
        type(statistics_type) :: s
        type(failure_type), allocatable :: failure
        integer(long) :: n
        integer :: i, j

        do i = 1, size(ratios)
            call set_up(model, ratios(i), options_type(stepper='radau5', rtol=1.0e-10_wp), fine, failure, 1.0_wp, 3.0_wp)
            if (.not. allocated(failure)) call fine%integrate(5.0_wp, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            do j = 1, size(rtols)
                call set_up(model, ratios(i), options_type(stepper='auto', rtol=rtols(j)), simulation, failure, 1.0_wp, 3.0_wp)
                if (.not. allocated(failure)) call simulation%integrate(1.0_wp, failure)
                s = simulation%statistics()
                call check_count(error, s%implicit_steps, 0, 'implicit steps while the spring is soft')
                if (.not. allocated(failure)) call simulation%integrate(2.9_wp, failure)
                s = simulation%statistics()
                call check_true(error, s%implicit_steps > 10, 'implicit steps while the spring is stiff')
                n = s%implicit_steps
                if (.not. allocated(failure)) call simulation%integrate(3.5_wp, failure)
                s = simulation%statistics()
                n = s%implicit_steps
                if (.not. allocated(failure)) call simulation%integrate(5.0_wp, failure)
                call check_no_failure(error, failure)
                if (allocated(error)) return
                s = simulation%statistics()
                call check_true(error, s%implicit_steps == n, 'no implicit steps where it is soft again')
                call check_below(error, maxval(abs(simulation%state%q(:2) - fine%state%q(:2))), 10*rtols(j), 'position')
                if (allocated(error)) return
            end do
        end do
    end subroutine test_there_and_back

    !> The angle from the vertical, x of the mass.
    subroutine evaluate(self, t, q, qd, lambda, value, stat)
        class(below_type), intent(inout) :: self
        real(wp), intent(in) :: t, q(:), qd(:), lambda(:)
        real(wp), intent(out) :: value
        integer, intent(out) :: stat

        value = q(1)
        stat = 0
    end subroutine evaluate

    !> Evaluate the middle of the last step.
    subroutine observe(self, simulation, occasion, error)
        class(looker_type), intent(inout) :: self
        class(simulation_type), intent(inout) :: simulation
        integer, intent(in) :: occasion
        type(failure_type), allocatable, intent(out) :: error
        real(wp) :: t

        if (occasion /= at_step) return
        t = simulation%state%t - 0.5_wp*simulation%last_step
        call simulation%look_at(t, error)
        if (.not. allocated(error) .and. self%n < size(self%seen, 2)) then
            self%n = self%n + 1
            self%seen(:, self%n) = [t, simulation%state%q(:2)]
            self%constraint = max(self%constraint, maxval(simulation%errors))
        end if
        call simulation%look_back()
    end subroutine observe

    !> Events and dense output are those of a run that does not switch.
    subroutine test_events(error)
        type(error_type), allocatable, intent(out) :: error
        type(stiff_pendulum_type), target :: model, other
        type(simulation_type) :: fine, simulation
        type(below_type), target :: event, same
        type(looker_type) :: looker
        type(statistics_type) :: s
        type(failure_type), allocatable :: failure
        integer :: i

        event%name = 'below'
        same%name = 'below'
        allocate (looker%seen(3, 2000), source=0.0_wp)
        call set_up(model, 10.0_wp, options_type(stepper='auto', rtol=1.0e-6_wp), simulation, failure, 1.0_wp, 3.0_wp)
        if (.not. allocated(failure)) call simulation%add_event(event)
        if (.not. allocated(failure)) call simulation%integrate(5.0_wp, failure, looker)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        s = simulation%statistics()
        call check_true(error, s%switches >= 2, 'there and back')
        call check_below(error, looker%constraint, 1.0e-12_wp, 'constraint errors within steps')
        call set_up(other, 10.0_wp, options_type(stepper='radau5', rtol=1.0e-10_wp), fine, failure, 1.0_wp, 3.0_wp)
        if (.not. allocated(failure)) call fine%add_event(same)
        do i = 1, looker%n
            if (allocated(failure)) exit
            call fine%integrate(looker%seen(1, i), failure)
            ! Ten tolerances, as for steps: the interpolants' own error is below that here.
            call check_below(error, maxval(abs(fine%state%q(:2) - looker%seen(2:, i))), 1.0e-5_wp, 'position within a step')
            if (allocated(error)) return
        end do
        if (.not. allocated(failure)) call fine%integrate(5.0_wp, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call check_count(error, int(simulation%n_events, long), fine%n_events, 'passes')
        if (allocated(error)) return
        do i = 1, fine%n_events
            call check_below(error, abs(fine%events(i)%t - simulation%events(i)%t), 1.0e-5_wp, 'time of a pass')
        end do
    end subroutine test_events

    !> Saved after every step, around both switches too.
    subroutine test_checkpoint(error)
        type(error_type), allocatable, intent(out) :: error
        type(stiff_pendulum_type), target :: model, other
        type(simulation_type) :: whole, again
        type(statistics_type) :: s
        type(options_type) :: options
        type(failure_type), allocatable :: failure
        integer(long), allocatable :: words(:), last(:)
        real(wp) :: q(3), qd(3)
        integer :: i

        options = options_type(stepper='auto', rtol=1.0e-5_wp, chart='adaptive')
        call set_up(model, 10.0_wp, options, whole, failure, 0.5_wp, 1.0_wp)
        if (.not. allocated(failure)) call whole%integrate(2.0_wp, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        s = whole%statistics()
        q = whole%state%q
        qd = whole%state%qd
        call check_true(error, s%switches >= 2, 'there and back')
        call set_up(other, 10.0_wp, options, again, failure, 0.5_wp, 1.0_wp)
        call set_up(model, 10.0_wp, options, whole, failure, 0.5_wp, 1.0_wp)
        do i = 1, int(s%steps) - 1
            if (.not. allocated(failure)) call whole%step(2.0_wp, failure)
            if (.not. allocated(failure)) call whole%save_state(words, failure)
            ! The other one has already continued to the end, with another method.
            if (.not. allocated(failure)) call again%restore_state(words, failure)
            if (.not. allocated(failure)) call again%save_state(last, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call check_true(error, size(last) == size(words), 'as much is restored as was saved')
            if (allocated(error)) return
            call check_true(error, all(last == words), 'what is restored is what was saved')
            if (.not. allocated(failure)) call again%integrate(2.0_wp, failure)
            call check_no_failure(error, failure)
            call check_true(error, all(abs(again%state%q - q) <= 0.0_wp) .and. all(abs(again%state%qd - qd) <= 0.0_wp), &
                'the same end')
            if (allocated(error)) return
        end do
    end subroutine test_checkpoint
end module test_auto
