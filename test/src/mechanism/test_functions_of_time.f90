! SPDX-License-Identifier: MIT
!> Tests of kinks of functions of time, in any number, and of pulses narrower than steps: against closed forms and against signs at
!> many times.
module test_functions_of_time
    use asserts, only: check_below, check_close, check_count, check_failure, check_no_failure, check_true
    use mechanism_checks, only: go
    use tandem, only: expression_function, expression_type, failure_type => error_type, mechanism_type, options_type, &
        parse_expression, simulation_type, statistics_type, to_text, wp
    use tandem_linalg_random, only: random_vector
    use tandem_mechanism_interval, only: interval_type
    use tandem_mechanism_piecewise, only: piecewise_type
    use testdrive, only: error_type, new_unittest, unittest_type
    implicit none (type, external)
    private

    public :: collect_functions_of_time

    real(wp), parameter :: pi = acos(-1.0_wp)

contains

    !> The suite.
    subroutine collect_functions_of_time(testsuite)
        type(unittest_type), allocatable, intent(out) :: testsuite(:)

        testsuite = [ &
            new_unittest('kinks-of-random-nested-periodic-functions', test_random_kinks), &
            new_unittest('a-search-goes-on-where-it-has-ended', test_windows), &
            new_unittest('arguments-that-touch-zero-have-no-kink', test_touching), &
            new_unittest('kinks-without-end-are-refused', test_endless), &
            new_unittest('a-force-switched-a-thousand-times-a-second', test_switching), &
            new_unittest('bounds-of-second-derivatives', test_curvatures), &
            new_unittest('a-pulse-narrower-than-steps', test_pulse), &
            new_unittest('a-look-ahead-changes-no-step', test_look_ahead), &
            new_unittest('a-motion-with-a-narrow-bump', test_bump), &
            new_unittest('a-fixed-step-that-passes-over-a-pulse-warns', test_fixed_steps), &
            new_unittest('smooth-functions-do-not-shorten-steps', test_smooth)]
    end subroutine collect_functions_of_time

    !> The pieces of an expression of the time.
    subroutine parse(pieces, text, error)
        type(piecewise_type), intent(out) :: pieces
        character(len=*), intent(in) :: text
        type(error_type), allocatable, intent(inout) :: error
        type(expression_type) :: expression
        type(failure_type), allocatable :: failure

        call parse_expression(expression, text, ['t'], failure)
        call check_no_failure(error, failure)
        if (.not. allocated(error)) call pieces%initialize(expression, 1)
    end subroutine parse

    !> All kinks between two times in their order, by as many searches as necessary.
    subroutine find_all(pieces, from, to, places, n_searches, failure)
        type(piecewise_type), intent(in) :: pieces
        real(wp), intent(in) :: from, to
        real(wp), allocatable, intent(out) :: places(:)
        integer, intent(out) :: n_searches
        type(failure_type), allocatable, intent(out) :: failure
        real(wp), allocatable :: more(:)
        integer, allocatable :: orders(:)
        real(wp) :: here, there, first
        integer :: i, k

        allocate (places(0))
        here = from
        n_searches = 0
        do while (here < to)
            there = to
            call pieces%find_kinks(here, there, more, orders, failure)
            if (allocated(failure)) return
            places = [places, more]
            n_searches = n_searches + 1
            here = there
        end do
        do i = 2, size(places)
            first = places(i)
            do k = i - 1, 1, -1
                if (places(k) <= first) exit
                places(k + 1) = places(k)
            end do
            places(k + 1) = first
        end do
    end subroutine find_all

    !> A random expression with kinks, of sums, products and functions of sines.
    recursive subroutine make_text(depth, seed, text)
        integer, intent(in) :: depth
        integer, intent(inout) :: seed
        character(len=:), allocatable, intent(out) :: text
        character(len=11), parameter :: kinked(7) = [character(len=11) :: 'abs', 'sign', 'step', 'ramp', 'smooth_step', 'sin', &
            'cos']
        character(len=:), allocatable :: first, second
        real(wp) :: r(4)

        r = random_vector(seed, size(r))
        if (depth == 0) then
            text = 'sin('//to_text(exp(3*r(1)))//'*t + ('//to_text(3*r(2))//'))'
            return
        end if
        call make_text(depth - 1, seed, first)
        call make_text(depth - 1, seed, second)
        if (r(1) > 0.7_wp) then
            text = 'max('//first//', '//second//')'
        else if (r(1) > 0.4_wp) then
            text = '('//first//'*'//second//')'
        else if (r(1) > 0.0_wp) then
            text = '('//first//' + ('//to_text(r(3))//')*'//second//')'
        else
            text = trim(kinked(1 + modulo(int(100*abs(r(4))), size(kinked))))//'('//first//' + ('//to_text(r(2))//'))'
        end if
    end subroutine make_text

    !> Every change of sign of an argument between close times is found, and nothing else.
    subroutine test_random_kinks(error)
        type(error_type), allocatable, intent(out) :: error
        integer, parameter :: n_cases = 60, n_times = 20000
        real(wp), parameter :: end = 7.0_wp
        type(piecewise_type) :: pieces
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: places(:), now(:), before(:), rates(:)
        character(len=:), allocatable :: first, second, third, text
        real(wp) :: t
        integer :: i, k, n, n_changes, n_searches, n_found, seed

        seed = 7
        n_changes = 0
        n_found = 0
        do i = 1, n_cases
            call make_text(3, seed, first)
            call make_text(2, seed, second)
            call make_text(2, seed, third)
            text = 'abs('//first//')*step('//second//') + ramp('//third//')'
            call parse(pieces, text, error)
            if (allocated(error)) return
            call find_all(pieces, 0.0_wp, end, places, n_searches, failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            n = pieces%expression%n_kinks()
            allocate (now(n), before(n), rates(n))
            n_found = n_found + size(places)
            call pieces%expression%evaluate_kinks([0.0_wp], [1.0_wp], before, rates)
            do k = 1, n_times
                t = end*k/n_times
                call pieces%expression%evaluate_kinks([t], [1.0_wp], now, rates)
                if (any(now*before < 0.0_wp)) then
                    n_changes = n_changes + count(now*before < 0.0_wp)
                    call check_true(error, any(places <= t .and. places >= t - end/n_times), 'a kink at '//to_text(t)//' of '//text)
                    if (allocated(error)) return
                end if
                before = now
            end do
            do k = 1, size(places)
                call pieces%expression%evaluate_kinks([places(k)*(1 - 1.0e-11_wp)], [1.0_wp], before, rates)
                call pieces%expression%evaluate_kinks([places(k)*(1 + 1.0e-11_wp)], [1.0_wp], now, rates)
                call check_true(error, any(now*before <= 0.0_wp), 'no kink at '//to_text(places(k))//' of '//text)
                if (allocated(error)) return
            end do
            deallocate (now, before, rates)
        end do
        call check_true(error, n_changes > 1000, 'there are many kinks: '//to_text(n_changes))
        call check_true(error, n_found >= n_changes, 'all are found')
    end subroutine test_random_kinks

    !> 50 Hz over a minute: 5999 kinks between the ends, each where it belongs, in several searches.
    subroutine test_windows(error)
        type(error_type), allocatable, intent(out) :: error
        type(piecewise_type) :: pieces
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: places(:)
        integer :: i, n_searches

        call parse(pieces, 'step(sin(2*pi*50*t))', error)
        if (allocated(error)) return
        call find_all(pieces, 0.0_wp, 60.0_wp, places, n_searches, failure)
        call check_no_failure(error, failure)
        call check_count(error, size(places), 5999, 'kinks')
        if (allocated(error)) return
        call check_close(error, places, [(i/100.0_wp, i=1, 5999)], 1.0e-12_wp, 'kinks')
        call check_true(error, n_searches > 3, 'several searches')
    end subroutine test_windows

    !> A zero that is touched, one that is kept, and one avoided by rounding only.
    subroutine test_touching(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=36), parameter :: texts(5) = [character(len=36) :: 'abs(1 + sin(3*t))', &
            'ramp(max(t - 50, t - 50))', 'abs((t - 1)^2)', 'ramp(1.0001 - sin(200*t))', 'abs(ramp(-1 - abs(t)))']
        type(piecewise_type) :: pieces
        type(failure_type), allocatable :: failure
        real(wp), allocatable :: places(:)
        integer :: i, n_searches

        do i = 1, size(texts)
            call parse(pieces, trim(texts(i)), error)
            if (allocated(error)) return
            call find_all(pieces, 0.0_wp, 10.0_wp, places, n_searches, failure)
            call check_no_failure(error, failure)
            call check_count(error, size(places), 0, 'kinks of '//trim(texts(i)))
            if (allocated(error)) return
        end do
        ! A pair at a distance of 2e-7, and a zero of third order.
        call parse(pieces, 'step(1e-14 - (t - 5.0001)^2) + abs((t - 2)^3)', error)
        call find_all(pieces, 0.0_wp, 10.0_wp, places, n_searches, failure)
        call check_no_failure(error, failure)
        call check_count(error, size(places), 3, 'kinks')
        if (.not. allocated(error)) call check_close(error, places, [2.0_wp, 5.0001_wp - 1.0e-7_wp, 5.0001_wp + 1.0e-7_wp], &
            1.0e-9_wp, 'kinks')
    end subroutine test_touching

    !> Switching whose frequency increases without bound.
    subroutine test_endless(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type) :: mechanism
        type(failure_type), allocatable :: failure

        call push(mechanism, 'step(sin(1/t))', error)
        if (allocated(error)) return
        call mechanism%define(failure)
        call check_failure(error, failure, 'invalid_model', 'too close to each other')
    end subroutine test_endless

    !> A mass driven by a force of 1 N times a function of time.
    subroutine push(mechanism, text, error)
        type(mechanism_type), intent(inout) :: mechanism
        character(len=*), intent(in) :: text
        type(error_type), allocatable, intent(inout) :: error
        type(expression_type) :: expression
        type(failure_type), allocatable :: failure

        mechanism%planar = .true.
        mechanism%times = [0.0_wp, 2.0_wp]
        call mechanism%add_body('m', 1.0_wp, [0.0_wp, 0.0_wp], failure)
        call check_no_failure(error, failure)
        call parse_expression(expression, text, ['t'], failure)
        call check_no_failure(error, failure)
        call mechanism%add_load('f', 'm', failure, force=[1.0_wp, 0.0_wp], motion=expression_function(expression))
        call check_no_failure(error, failure)
    end subroutine push

    !> At 1 kHz the velocity is half the time, and after whole periods the place is t^2/4 + t/8000.
    subroutine test_switching(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        real(wp), parameter :: t = 2.0_wp

        call push(mechanism, 'step(sin(2*pi*1000*t))', error)
        call go(mechanism, 1.0e-9_wp, t, simulation, error)
        if (allocated(error)) return
        call check_close(error, simulation%state%qd(:1), [t/2], 1.0e-12_wp, 'velocity')
        call check_close(error, simulation%state%q(:1), [t**2/4 + t/8000], 1.0e-12_wp, 'place')
    end subroutine test_switching

    !> Second derivatives of every operation are within their bounds, which are tight in short intervals.
    subroutine test_curvatures(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=26), parameter :: texts(*) = [character(len=26) :: 'sin(t)*cos(2*t)', 'exp(t)/(1 + t^2)', '(1 + t)^t', &
            '(1 + t)^2.5', 't^3 - t', 'tan(0.5*t)', 'asin(0.4*t)', 'acos(0.4*t)', 'atan(2*t)', 'atan2(sin(t), 2 + t)', &
            'sinh(t)', 'cosh(t)', 'tanh(t)', 'log(1 + t)', 'sqrt(1 + t)', 'abs(t - 5)*t', 'min(t, 5)^2', 'smooth_step(t/3)', &
            '-exp(-((t - 1)/0.3)^2)', '2^t', '1/(t + 0.5)', 'ramp(t)*t', 'sign(t)*t^2 + step(t)*t^3']
        type(expression_type) :: expression
        type(failure_type), allocatable :: failure
        type(interval_type) :: values(1), rates(1), bounds(1)
        real(wp) :: ends(2), f(3), t
        integer :: i, j, k, seed

        seed = 5
        do i = 1, size(texts)
            call parse_expression(expression, trim(texts(i)), ['t'], failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            do j = 1, 20
                ends = 0.1_wp + abs(random_vector(seed, 2))
                ends(2) = ends(1) + merge(ends(2), 1.0e-6_wp, j > 10)
                call expression%enclose_parts(1, expression%list_parts(1), ends(1), ends(2), values, rates, curvatures=bounds)
                do k = 0, 10
                    t = ends(1) + real(k, wp)/10*(ends(2) - ends(1))
                    call expression%evaluate_along([t], [1.0_wp], f(1), f(2), f(3))
                    call check_true(error, f(3) >= bounds(1)%low - 1.0e-13_wp .and. f(3) <= bounds(1)%high + 1.0e-13_wp, &
                        trim(texts(i))//' at t = '//to_text(t)//': '//to_text(f(3))//' is not between '// &
                        to_text(bounds(1)%low)//' and '//to_text(bounds(1)%high))
                    if (j <= 10) call check_below(error, bounds(1)%high - bounds(1)%low, 1.0e-3_wp, trim(texts(i)))
                end do
            end do
        end do
    end subroutine test_curvatures

    !> Steps of many sizes through functions with pulses give the same results with one object that looks ahead and with a new one
    !> for each step.
    subroutine test_look_ahead(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=56), parameter :: texts(*) = [character(len=56) :: 'sin(3*t) + t', '5*exp(-((t - 1)/0.003)^2) + t', &
            'sin(t)^2 + cos(t)^2', 'exp(-((t - 0.4)/1e-4)^2) + sin(200*t)', 'tanh((t - 0.7)/1e-4) + t', &
            '0.1*t + 1e-6*exp(-((t - 1)/0.001)^2)', 'smooth_step(t, 0.2, 0.3) - smooth_step(t, 0.4, 0.41)']
        type(piecewise_type) :: pieces, fresh, held
        real(wp) :: t, h, sizes(400)
        logical :: rates, between
        integer :: i, k, n_hidden, seed

        seed = 3
        n_hidden = 0
        do i = 1, size(texts)
            call parse(pieces, trim(texts(i)), error)
            if (allocated(error)) return
            rates = mod(i, 2) == 0
            between = i > 2
            fresh = pieces
            sizes = abs(random_vector(seed, size(sizes)))
            t = 0.0_wp
            do k = 1, size(sizes)
                h = 3.0e-2_wp*sizes(k)
                held = fresh
                if (held%hides(t, t + h, between, rates)) n_hidden = n_hidden + 1
                held = fresh
                call check_true(error, held%hides(t, t + h, between, rates) .eqv. pieces%hides(t, t + h, between, rates), &
                    trim(texts(i))//' from '//to_text(t)//' to '//to_text(t + h))
                t = t + h
            end do
        end do
        call check_true(error, n_hidden > 2, 'pulses are hidden from some of the steps: '//to_text(n_hidden))
    end subroutine test_look_ahead

    !> The momentum of a Gaussian pulse, with every stepper that has an error estimate; and of another pulse, which steps would
    !> sample at a time that is half of theirs.
    subroutine test_pulse(error)
        type(error_type), allocatable, intent(out) :: error
        character(len=9), parameter :: steppers(6) = [character(len=9) :: 'dop853', 'dopri5', 'radau5', 'sdirk54', 'trapezoid', &
            'auto']
        integer :: i

        do i = 1, size(steppers)
            call check(steppers(i))
            if (allocated(error)) return
        end do

    contains

        subroutine check(stepper)
            character(len=*), intent(in) :: stepper
            type(mechanism_type), target :: mechanism
            type(simulation_type) :: simulation

            call push(mechanism, '1000*exp(-((t - 1)/0.001)^2) + 1e4*exp(-((t - 0.4)/0.0001)^2)', error)
            call go(mechanism, 1.0e-7_wp, 2.0_wp, simulation, error, trim(stepper))
            if (allocated(error)) return
            call check_below(error, abs(simulation%state%qd(1) - 2*sqrt(pi)), 1.0e-3_wp, trim(stepper))
        end subroutine check
    end subroutine test_pulse

    !> A slider whose imposed motion has a bump of a micrometre and a millisecond: steps detect its rate.
    subroutine test_bump(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics
        type(options_type) :: options
        type(expression_type) :: expression
        type(failure_type), allocatable :: failure

        mechanism%planar = .true.
        mechanism%times = [0.0_wp, 2.0_wp]
        call mechanism%add_body('cart', 1.0_wp, [0.0_wp, 0.0_wp], failure, inertia=[1.0_wp])
        call check_no_failure(error, failure)
        call parse_expression(expression, '0.1*t + 1e-6*exp(-((t - 1)/0.001)^2)', ['t'], failure)
        call check_no_failure(error, failure)
        call mechanism%add_joint('rail', 'prismatic', 'ground', 'cart', failure, at=[0.0_wp, 0.0_wp], axis=[1.0_wp, 0.0_wp], &
            motion=expression_function(expression))
        call check_no_failure(error, failure)
        call mechanism%define(failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        options%stepper = 'dop853'
        options%rtol = 1.0e-9_wp
        call simulation%initialize(mechanism, options, 0.0_wp, [0.0_wp, 0.0_wp, 0.0_wp], [0.1_wp, 0.0_wp, 0.0_wp], failure)
        call check_no_failure(error, failure)
        if (allocated(error)) return
        call simulation%integrate(2.0_wp, failure)
        call check_no_failure(error, failure)
        statistics = simulation%statistics()
        call check_true(error, statistics%smallest_step < 1.0e-3_wp .and. statistics%steps > 20, 'steps see the bump')
    end subroutine test_bump

    !> One warning, and none for sufficiently short steps.
    subroutine test_fixed_steps(error)
        type(error_type), allocatable, intent(out) :: error

        call check(0.1_wp, 1)
        call check(1.0e-4_wp, 0)

    contains

        subroutine check(step, n_warnings)
            real(wp), intent(in) :: step
            integer, intent(in) :: n_warnings
            type(mechanism_type), target :: mechanism
            type(simulation_type) :: simulation
            type(options_type) :: options
            type(failure_type), allocatable :: failure
            integer :: n

            if (allocated(error)) return
            call push(mechanism, '1000*exp(-((t - 0.0567)/0.001)^2) + 1000*exp(-((t - 0.2345)/0.001)^2)', error)
            call mechanism%define(failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            options%stepper = 'rk4'
            options%step = step
            call simulation%initialize(mechanism, options, 0.0_wp, [0.0_wp, 0.0_wp], [0.0_wp, 0.0_wp], failure)
            call check_no_failure(error, failure)
            if (allocated(error)) return
            call simulation%integrate(0.3_wp, failure)
            call check_no_failure(error, failure)
            n = 0
            if (allocated(simulation%warnings)) n = size(simulation%warnings)
            call check_count(error, n, n_warnings, 'warnings at '//to_text(step))
        end subroutine check
    end subroutine test_fixed_steps

    !> The closed form with no more steps than without bounds on functions of time.
    subroutine test_smooth(error)
        type(error_type), allocatable, intent(out) :: error
        type(mechanism_type), target :: mechanism
        type(simulation_type) :: simulation
        type(statistics_type) :: statistics

        call push(mechanism, 'sin(t)^2 + cos(t)^2 + t*exp(-t) - t/(2 + sin(t)) + smooth_step(t, 0, 5)', error)
        call go(mechanism, 1.0e-9_wp, 2.0_wp, simulation, error)
        if (allocated(error)) return
        statistics = simulation%statistics()
        call check_true(error, statistics%steps < 16, 'few steps: '//to_text(int(statistics%steps)))
    end subroutine test_smooth
end module test_functions_of_time
