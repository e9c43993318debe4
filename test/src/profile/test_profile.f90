! SPDX-License-Identifier: MIT
!> The profile of a run: identical results bit by bit, calls equal to the counters, and times that sum to the total.
module test_profile
    use asserts, only: check_below, check_close, check_count, check_no_failure, check_true
    use model_belt_wheel, only: belt_wheel_type
    use model_redundant, only: redundant_type
    use model_sleigh, only: sleigh_type
    use runs, only: get_start, new_scene, scene_names
    use subjects, only: new_subject, subject_names
    use tandem, only: change_stepper, failure_type => error_type, long, mark_type, model_type, n_derivatives, n_part_groups, &
        n_parts, n_terms, observer_type, options_type, part_group, part_group_name, part_name, part_open, part_rows, &
        part_start, part_watch, profile_type, profiled_observer_type, simulation_type, statistics_type, &
        stepper_names, term_name, terms_of_part, to_text, wp
    use tandem_io_output_observers, only: observer_list_type
    use tandem_profile_parts, only: part_acceleration, part_control, part_correction, part_derivatives, part_energy, part_matrix, &
        part_multipliers, part_renew, part_terms
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_profile

    character(len=14), parameter :: names(10) = [character(len=14) :: subject_names, scene_names(3:4), 'belt_wheel', 'redundant']
    integer, parameter :: n_steps = 25

    !> A run and its data.
    type :: case_type
        type(simulation_type) :: simulation
        class(model_type), allocatable :: model, inner
        type(profile_type) :: profile
        real(wp), allocatable :: q(:), qd(:)
    end type case_type

    !> Asks for multipliers and the kinetic energy at every step.
    type, extends(observer_type) :: curious_type
    contains
        procedure :: observe
    end type curious_type

contains

    subroutine collect_profile(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('a-profiled-run-takes-the-same-course', test_same), &
            new_unittest('calls-agree-with-the-counters', test_calls), &
            new_unittest('segments-and-jumps', test_segments), &
            new_unittest('observers-and-what-they-ask-for', test_observers), &
            new_unittest('times-belong-to-the-innermost-part', test_times), &
            new_unittest('the-clock-is-taken-off', test_clock), &
            new_unittest('every-part-has-a-name-and-a-group', test_names)]
    end subroutine collect_profile

    !> Complete state of the simulation, over all steppers, with fixed steps and with an error estimate.
    subroutine test_same(error)
        type(error_type), allocatable, intent(out) :: error
        type(case_type), target :: plain, profiled
        type(options_type) :: options
        integer :: i, k, stepper

        do i = 1, size(names)
            do stepper = 1, size(stepper_names)
                do k = 1, 2
                    if (k == 2 .and. stepper_names(stepper) == 'rk4') cycle
                    options = options_of(stepper, k == 2)
                    call make(plain, names(i))
                    call set_up(plain, options, .false., error)
                    call make(profiled, names(i))
                    call set_up(profiled, options, .true., error)
                    call take_steps(plain, error)
                    call take_steps(profiled, error)
                    call check_same(error, profiled%simulation, plain%simulation, trim(names(i))//' by '//stepper_names(stepper))
                    if (allocated(error)) return
                end do
            end do
        end do
    end subroutine test_same

    !> Numbers that both count.
    subroutine test_calls(error)
        type(error_type), allocatable, intent(out) :: error
        type(case_type), target :: run
        type(statistics_type) :: s
        character(len=:), allocatable :: what
        integer :: i, stepper, k, part

        do i = 1, size(names)
            do stepper = 1, size(stepper_names)
                call make(run, names(i))
                call set_up(run, options_of(stepper, .false.), .true., error)
                call take_steps(run, error)
                if (allocated(error)) return
                s = run%simulation%statistics()
                what = trim(names(i))//' by '//trim(stepper_names(stepper))//': '
                associate (calls => run%profile%calls)
                    call check_count(error, sum(calls(part_terms + 1:part_derivatives)), int(s%fused_calls), &
                        what//'calls of evaluate')
                    call check_count(error, calls(part_correction), int(s%newton_corrections), what//'corrections')
                    call check_count(error, calls(part_matrix), int(s%newton_matrices), what//'Newton matrices')
                    ! The start makes one or two more, to measure its constraint errors.
                    call check_true(error, calls(part_renew) >= s%charts .and. calls(part_renew) <= s%charts + 3, what//'charts')
                    do k = 1, n_derivatives
                        ! The skater's are single procedures, of which several make one derivative.
                        if (names(i) /= 'skater') call check_count(error, sum(pack(calls(part_derivatives + 1:), &
                            [(btest(part, k - 1), part=1, n_parts - part_derivatives)])), int(s%derivatives(k)), &
                            what//'derivatives')
                    end do
                    do k = 1, n_terms
                        ! Two procedures make C or the forces where a model has both.
                        if (any(term_name(k) == ['jacobian', 'nu      ', 'force   ']) .and. any(names(i) == &
                            [character(len=14) :: 'heavy_top', 'belt_wheel', 'skater'])) cycle
                        call check_count(error, sum(pack(calls, [(btest(terms_of_part(part), k - 1), part=1, n_parts)])), &
                            int(s%terms(k)), what//term_name(k))
                    end do
                    if (stepper_names(stepper) == 'rk4') call check_true(error, calls(part_acceleration) >= 4*s%steps, &
                        what//'accelerations')
                end associate
                if (allocated(error)) return
            end do
        end do
    end subroutine test_calls

    !> Breakpoints and a jump of nu are followed.
    subroutine test_segments(error)
        type(error_type), allocatable, intent(out) :: error
        type(case_type), target :: plain, profiled
        type(options_type) :: options
        integer :: stepper

        do stepper = 1, size(stepper_names)
            options = options_of(stepper, .false.)
            options%chart = 'adaptive'
            call make(plain, 'sleigh')
            call set_up(plain, options, .false., error)
            call make(profiled, 'sleigh')
            call set_up(profiled, options, .true., error)
            call take_steps(plain, error)
            call take_steps(profiled, error)
            call check_same(error, profiled%simulation, plain%simulation, 'sleigh by '//stepper_names(stepper))
            if (allocated(error)) return
            call check_true(error, profiled%model%segment > 1, 'the sleigh has passed a breakpoint')
            call check_count(error, profiled%model%segment, plain%model%segment, 'segment')
        end do
    end subroutine test_segments

    !> The time of an observer, including its calls of the chart and the model. Nested as for `tandem run --profile`: a list with
    !> one timed observer, which is a list.
    subroutine test_observers(error)
        type(error_type), allocatable, intent(out) :: error
        type(case_type), target :: run
        type(curious_type), target :: curious
        type(profiled_observer_type), target :: observer
        type(observer_list_type), target :: inner, outer
        type(failure_type), allocatable :: failure
        real(wp) :: own

        call make(run, 'disk')
        call set_up(run, options_of(1, .false.), .true., error)
        call inner%add(curious)
        observer%inner => inner
        observer%profile => run%profile
        observer%part = part_rows
        call outer%add(observer)
        call run%simulation%integrate(n_steps*0.004_wp, failure, outer)
        call run%profile%finish()
        call check_no_failure(error, failure)
        if (allocated(error)) return
        associate (calls => run%profile%calls)
            call check_count(error, calls(part_rows), n_steps + 2, 'calls of the observer')
            call check_count(error, calls(part_multipliers), n_steps + 2, 'multipliers')
            call check_count(error, calls(part_energy), n_steps + 2, 'kinetic energies')
            own = run%profile%seconds(part_rows)
            call check_true(error, run%profile%whole_seconds(part_rows) > own + run%profile%seconds(part_multipliers), &
                'what an observer asks for is its time too')
            call check_close(error, [run%profile%bare_seconds() + run%profile%output_seconds()], [run%profile%total()], &
                1.0e-12_wp, 'integration and output')
        end associate
    end subroutine test_observers

    !> Parts within parts, each kept busy for a known time at least.
    subroutine test_times(error)
        type(error_type), allocatable, intent(out) :: error
        type(profile_type) :: profile
        type(mark_type) :: outer, inner
        real(wp), parameter :: unit = 2.0e-3_wp
        real(wp) :: spent(3), total
        integer :: part

        call profile%begin()
        spent(1) = busy(unit)
        call profile%enter(part_start, outer)
        spent(2) = busy(2*unit)
        call profile%enter(part_watch, inner)
        spent(3) = busy(4*unit)
        call profile%leave(inner)
        spent(2) = spent(2) + busy(unit)
        call profile%leave(outer)
        spent(1) = spent(1) + busy(unit)
        call profile%finish()
        ! Other processes take time between the two clocks: bounds apply from below only, the sum is exact.
        call check_true(error, profile%seconds(part_control) >= spent(1) - 1.0e-6_wp, 'time around')
        call check_true(error, profile%seconds(part_start) >= spent(2) - 1.0e-6_wp, 'time of the outer part')
        call check_true(error, profile%seconds(part_watch) >= spent(3) - 1.0e-6_wp, 'time of the inner part')
        call check_close(error, [profile%whole_seconds(part_start)], &
            [profile%seconds(part_start) + profile%seconds(part_watch)], 1.0e-12_wp, 'a part with all that is within it')
        total = sum([(profile%seconds(part), part=1, n_parts)])
        call check_close(error, [total], [profile%total()], 1.0e-12_wp, 'the sum of the parts')
        call check_close(error, [profile%total() + profile%clock_seconds()], [profile%measured], 1.0e-12_wp, &
            'corrected for the clock')
        call check_true(error, all(profile%calls([part_start, part_watch]) == 1) .and. sum(profile%calls) == 2, 'calls')
        call check_count(error, profile%pairs, 2, 'pairs of readings')
        ! The clock of the processor may be as coarse as 10 ms.
        call check_true(error, profile%processor >= 0.0_wp .and. profile%processor <= profile%measured + 0.02_wp, &
            'time of the processor')
    end subroutine test_times

    !> The time of an empty part is almost zero after the subtraction of the clock, and a comparison corrects for its cost in a run.
    subroutine test_clock(error)
        type(error_type), allocatable, intent(out) :: error
        type(profile_type) :: profile
        type(mark_type) :: mark
        integer, parameter :: n = 20000
        real(wp) :: loop, clocked
        integer :: i

        call profile%begin()
        do i = 1, n
            call profile%enter(part_start, mark)
            call profile%leave(mark)
        end do
        call profile%finish()
        call check_count(error, profile%calls(part_start), n, 'calls')
        loop = profile%cost_in_loop
        call check_true(error, loop > 1.0e-9_wp .and. loop < 1.0e-5_wp, 'two readings cost some nanoseconds')
        call check_close(error, [profile%clock_seconds()], [n*loop], 1.0e-9_wp, 'what is taken off without a comparison')
        ! A run that is faster without clocks, by half as much again as their cost in a loop.
        clocked = profile%measured
        call profile%compare(clocked, clocked - 1.5_wp*loop*n, profile%pairs)
        call check_close(error, [profile%total()], [profile%plain], 1.0e-9_wp, 'the time without clocks')
        call check_close(error, [profile%clock_seconds()], [1.5_wp*loop*n], 1.0e-9_wp, 'what was taken off')
        ! One that takes longer, or far less, was disturbed.
        call profile%compare(clocked, 2*clocked, profile%pairs)
        call check_close(error, [profile%clock_seconds()], [n*loop], 1.0e-9_wp, 'never less than in a loop')
        call profile%compare(clocked, clocked - 10*loop*n, profile%pairs)
        call check_close(error, [profile%clock_seconds()], [3*n*loop], 1.0e-9_wp, 'never more than three times that')
    end subroutine test_clock

    !> All parts have different, nonempty names.
    subroutine test_names(error)
        type(error_type), allocatable, intent(out) :: error
        integer :: i, k

        do i = 1, n_parts
            call check_true(error, part_name(i) /= '' .and. part_group(i) >= 1 .and. part_group(i) <= n_part_groups, &
                'part '//to_text(i)//' has a name and a group')
            call check_true(error, part_group_name(part_group(i)) /= '', 'group of part '//to_text(i))
            do k = 1, i - 1
                call check_true(error, part_name(i) /= part_name(k) .or. part_group(i) /= part_group(k), &
                    'parts '//to_text(k)//' and '//to_text(i)//' differ')
            end do
        end do
        call check_true(error, part_name(part_terms + 18) == 'evaluate: jacobian mass', 'terms of evaluate')
        call check_true(error, part_name(part_open) == 'opening and closing', 'a part of output')
    end subroutine test_names

    !> Fixed steps or error control.
    function options_of(stepper, is_adaptive) result(options)
        integer, intent(in) :: stepper
        logical, intent(in) :: is_adaptive
        type(options_type) :: options

        options%stepper = stepper_names(stepper)
        options%step = 0.004_wp
        if (is_adaptive) call change_stepper(options, options%stepper, rtol=1.0e-7_wp)
    end function options_of

    !> A model and its start.
    subroutine make(self, name)
        type(case_type), intent(inout) :: self
        character(len=*), intent(in) :: name
        type(belt_wheel_type), allocatable :: wheel
        type(sleigh_type), allocatable :: sleigh
        type(redundant_type), allocatable :: redundant
        real(wp) :: qdd(2), lambda(2)

        if (allocated(self%q)) deallocate (self%q, self%qd)
        select case (name)
        case ('belt_wheel')
            allocate (wheel)
            call wheel%define()
            allocate (self%q(2), self%qd(2))
            call wheel%solution(0.0_wp, self%q, self%qd, qdd, lambda)
            call move_alloc(wheel, self%model)
        case ('sleigh')
            allocate (sleigh)
            call sleigh%define(0.05_wp)
            self%q = [0.0_wp, 0.0_wp, 0.3_wp]
            self%qd = [0.0_wp, 0.0_wp, -sleigh%speed(1)/sleigh%arm]
            call move_alloc(sleigh, self%model)
        case ('redundant')
            call new_scene('knife_edge', self%inner)
            call get_start('knife_edge', self%q, self%qd)
            allocate (redundant)
            call move_alloc(redundant, self%model)
            select type (model => self%model)
            class is (redundant_type)
                call model%wrap(self%inner, [1], [2.0_wp], 'a copy')
            end select
        case default
            if (any(name == subject_names)) then
                call new_subject(trim(name), self%model, self%q, self%qd)
            else
                call new_scene(trim(name), self%model)
                call get_start(trim(name), self%q, self%qd)
            end if
        end select
    end subroutine make

    !> The simulation of it.
    subroutine set_up(self, options, is_profiled, error)
        type(case_type), intent(inout), target :: self
        type(options_type), intent(in) :: options
        logical, intent(in) :: is_profiled
        type(error_type), allocatable, intent(inout) :: error
        type(failure_type), allocatable :: failure

        if (allocated(error)) return
        if (is_profiled) then
            call self%profile%begin()
            self%model%state%timer => self%profile
        end if
        call self%simulation%initialize(self%model, options, 0.0_wp, self%q, self%qd, failure)
        call check_no_failure(error, failure)
    end subroutine set_up

    !> Steps one by one, which books no time.
    subroutine take_steps(self, error)
        type(case_type), intent(inout) :: self
        type(error_type), allocatable, intent(inout) :: error
        type(failure_type), allocatable :: failure
        integer :: i

        do i = 1, n_steps
            if (allocated(error)) return
            call self%simulation%step(1.0e3_wp, failure)
            call check_no_failure(error, failure)
        end do
    end subroutine take_steps

    !> Complete states of two simulations, word by word.
    subroutine check_same(error, one, other, what)
        type(error_type), allocatable, intent(inout) :: error
        type(simulation_type), intent(inout) :: one, other
        character(len=*), intent(in) :: what
        integer(long), allocatable :: found(:), expected(:)
        type(failure_type), allocatable :: failure

        if (allocated(error)) return
        call one%save_state(found, failure)
        if (.not. allocated(failure)) call other%save_state(expected, failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call check_count(error, size(found), size(expected), what//': length of the state')
        if (allocated(error)) return
        call check_true(error, all(found == expected), what//': the same state and counters')
    end subroutine check_same

    !> Use processor time.
    real(wp) function busy(seconds)
        !> Smallest time; the actual time is returned.
        real(wp), intent(in) :: seconds
        integer(long) :: from, now, rate

        call system_clock(from, rate)
        do
            call system_clock(now)
            busy = real(now - from, wp)/real(rate, wp)
            if (busy >= seconds) exit
        end do
    end function busy

    subroutine observe(self, simulation, occasion, error)
        class(curious_type), intent(inout) :: self
        class(simulation_type), intent(inout) :: simulation
        integer, intent(in) :: occasion
        type(failure_type), allocatable, intent(out) :: error
        real(wp) :: lambda(simulation%model%n_constraints()), energy
        integer :: stat

        call simulation%multipliers(lambda)
        call simulation%kinetic_energy(energy, stat)
        if (stat /= 0) error stop 'observe: no energy'
    end subroutine observe
end module test_profile
